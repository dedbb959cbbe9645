/* SPDX-License-Identifier: BSD-3-Clause */
/* What <complex.h> and a division of complex numbers leave to the C library and to the compiler's, by the
 * functions of apcmath.h. Of finite numbers. */
#ifndef APC_COMPLEX_H
#define APC_COMPLEX_H

#include <apcmath.h>

#include <complex.h>
#include <math.h>
#include <string.h>

static inline double complex apc_complex(double re, double im)
{
    const double part[2] = {re, im};
    double complex z;
    memcpy(&z, part, sizeof z);
    return z;
}

/* a / b by Smith's algorithm: the larger part of b is divided by. */
static inline double complex apc_cdivide(double complex a, double complex b)
{
    const double x = creal(b), y = cimag(b);
    if (fabs(x) >= fabs(y)) {
        const double part = y / x, below = x + y * part;
        return apc_complex((creal(a) + cimag(a) * part) / below, (cimag(a) - creal(a) * part) / below);
    }
    const double part = x / y, below = x * part + y;
    return apc_complex((creal(a) * part + cimag(a)) / below, (cimag(a) * part - creal(a)) / below);
}

static inline double apc_cabs(double complex z)
{
    return apc_hypot(creal(z), cimag(z));
}

static inline double apc_carg(double complex z)
{
    return apc_atan2(cimag(z), creal(z));
}

static inline double complex apc_cexp(double complex z)
{
    const double size = apc_exp(creal(z));
    return apc_complex(size * apc_cos(cimag(z)), size * apc_sin(cimag(z)));
}

static inline double complex apc_clog(double complex z)
{
    return apc_complex(apc_log(apc_cabs(z)), apc_carg(z));
}

/* The one with a real part of 0 or above. */
static inline double complex apc_csqrt(double complex z)
{
    const double size = apc_cabs(z), a = sqrt(0.5 * (size + fabs(creal(z))));
    if (size == 0.0)
        return apc_complex(0.0, cimag(z));
    const double b = 0.5 * cimag(z) / a;
    return creal(z) >= 0.0 ? apc_complex(a, b) : apc_complex(fabs(b), copysign(a, cimag(z)));
}

#endif
