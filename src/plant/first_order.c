/* SPDX-License-Identifier: BSD-3-Clause */
/* The plant of the paper's experiment: dx/dt = (-x + K u) / tau, y = x. */
#include "plant/plant_internal.h"

static const struct apc_param param[] = {
    {"K", "", "gain", 10.0, -1e6, 1e6},
    {"tau", "s", "time constant", 10.0, 1e-6, 1e9},
};

static const struct apc_param state[] = {{"x", "", "state", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX}};
static const struct apc_param input[] = {{"u", "", "manipulated variable", 0.0, -10.0, 10.0}};
static const struct apc_param output[] = {{"y", "", "measurement", 0.0, 0.0, 0.0}};

static int first_order_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    dx[0] = (-x[0] + p[0] * u[0]) / p[1];
    return 0;
}

static void first_order_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)u;
    (void)p;
    y[0] = x[0];
}

const struct apc_model apc_model_first_order = {
    .name = "first-order",
    .description = "first-order plant of the paper",
    APC_MODEL_TABLES,
    .f = first_order_f,
    .g = first_order_g,
};
