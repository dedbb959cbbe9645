/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A model with PI loops around it, whose setpoints are its inputs: u = gain (r - y) + I within the input's
 * range, I' = gain (r - y) / tau, which waits where u is at an end of it. An input without a loop is the
 * model's. Its states are the model's and, behind them, I of each loop.
 */
#ifndef APC_NESTED_H
#define APC_NESTED_H

#include "apclinear.h"
#include "apcplant.h"

struct apc_nested;

struct apc_nested_loop {
    bool there;
    size_t y; /* that it holds, from 0 */
    double gain, tau;
};

/* The loops [nu] and p [np] (NULL: the model's own) are copied. */
int apc_nested_create(struct apc_nested **nested, const struct apc_model *model, const double *p,
                      const struct apc_nested_loop *loop, struct apc_error *why);
void apc_nested_destroy(struct apc_nested *nested); /* NULL is legal */
size_t apc_nested_states(const struct apc_nested *nested);
/* As f and g of a model. One at a time. [tick] */
int apc_nested_slope(struct apc_nested *nested, const double *x, const double *u, double *dx);
void apc_nested_output(struct apc_nested *nested, const double *x, const double *u, double *y);
const char *apc_nested_error(const struct apc_nested *nested); /* as apc_reduced_error() [tick] */
/*
 * From the model, linear at a steady state x0 [nx], u0 [nu + nd], y0 [ny] by A [nx * nx], B [nx * (nu + nd)],
 * C [ny * nx], D [ny * (nu + nd)], the same of it with its loops: A, B, C, x0, u0 of its own sizes; D is the
 * same. Returns 0, or APC_EINVAL: an input acts on a measurement at once.
 */
int apc_nested_linearise(const struct apc_nested *nested, const struct apc_linear_continuous *from, double *A,
                         double *B, double *C, double *x0, double *u0, struct apc_error *why);

#endif
