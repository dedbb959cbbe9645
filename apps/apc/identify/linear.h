/* SPDX-License-Identifier: BSD-3-Clause */
/* Linear systems x' = A x + B u, y = C x + D u: what LAPACK tells of them. Matrices are row-major. */
#ifndef APC_LINEAR_H
#define APC_LINEAR_H

#include <complex.h>
#include <stdbool.h>
#include <stddef.h>

#include <apcbase.h>

/*
 * Load LAPACK, before all else here. Not linked, because some builds of it start threads when they are
 * loaded: a signal meant for apc run would end the process in one of those. Returns 0, or APC_ENOTFOUND.
 */
int linear_load(struct apc_error *why);

struct linear {
    size_t nx, nu, ny;
    double *a, *b, *c, *d; /* [nx * nx], [nx * nu], [ny * nx], [ny * nu] */
};

/* The eigenvalues of A into pole[nx]. Returns 0, APC_ENOMEM or APC_ESOLVER. */
int linear_poles(const struct linear *sys, double complex *pole);

/*
 * The invariant zeros, at infinity left out, into zero[nx]; returns how many. APC_ESTATE: degenerate, an
 * input without an effect of its own, so that every number is a zero; or as above. Any number of inputs and
 * outputs.
 */
int linear_zeros(const struct linear *sys, double complex *zero);

/* D - C A^-1 B into gain[ny * nu]. APC_ESTATE: there is a pole at 0; or as above. */
int linear_gain(const struct linear *sys, double *gain);

/* The relative gain array of a square gain[n * n]: gain times, element by element, the transpose of its
 * inverse (Bristol 1966). APC_ESTATE: the gain is singular; or as above. */
int linear_rga(const double *gain, size_t n, double *rga);

#endif
