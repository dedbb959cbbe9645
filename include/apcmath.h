/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcmath.h
 * Elementary functions with the same result, to the last bit, on every machine.
 *
 * The C library picks its own by processor, and those of another version give others: with them the same
 * simulation is another one elsewhere. These consist of additions, multiplications, divisions and square
 * roots alone, which IEEE 754 defines to the bit. Plants and laws of your own that call them keep the promise
 * that the same seed gives the same run, and that a record can be replayed on another machine.
 *
 * Arguments and results are as in Annex F of ISO C, also of zeros, infinities and NaN; errno and the
 * floating-point exceptions are not part of it. The error is below 1 unit in the last place unless a function
 * says otherwise. Numbers are rounded to nearest, and a * b + c is not contracted into one operation.
 */
#ifndef APCMATH_H
#define APCMATH_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** e^x. [any] [tick] */
APC_API double apc_exp(double x);
/** e^x - 1, as precise where that is small. [any] [tick] */
APC_API double apc_expm1(double x);
/** The natural logarithm. [any] [tick] */
APC_API double apc_log(double x);
/** The logarithm to base 2. [any] [tick] */
APC_API double apc_log2(double x);
/** The logarithm to base 10. [any] [tick] */
APC_API double apc_log10(double x);
/** x^y; of y = 2 it is x * x. [any] [tick] */
APC_API double apc_pow(double x, double y);
/** The sine of an angle in rad. [any] [tick] */
APC_API double apc_sin(double x);
/** The cosine of an angle in rad. [any] [tick] */
APC_API double apc_cos(double x);
/** The angle in rad whose tangent is x. [any] [tick] */
APC_API double apc_atan(double x);
/** The angle of the point (x, y) in rad, -pi to pi. [any] [tick] */
APC_API double apc_atan2(double y, double x);
/** sqrt(x^2 + y^2); it overflows only where that does. [any] [tick] */
APC_API double apc_hypot(double x, double y);
/** The logarithm of the gamma function of x > 0, within 1e-14 (1 + |result|); NaN of others. [any] [tick] */
APC_API double apc_lgamma(double x);

#ifdef __cplusplus
}
#endif

#endif
