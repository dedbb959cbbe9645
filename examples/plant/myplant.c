/* SPDX-License-Identifier: BSD-3-Clause */
/* Your own plant, a tank: cc -shared -fPIC -o myplant.so myplant.c -lm */
#include <apcplant.h>
#include <math.h>

/*                                      name  unit     description           initial low   high */
static const struct apc_param param[] = {{"A", "m2", "cross section", 0.5, 0.001, 100.0},
                                         {"a", "m2", "area of the outlet", 0.019, 1e-6, 1.0}};

static const struct apc_param state[] = {{"h", "m", "level", 0.0, 0.0, 10.0}};
static const struct apc_param input[] = {{"q", "m3/s", "inflow", 0.01, 0.0, 0.1}};

/* dh/dt = (inflow - outflow) / A: level h is x[0], the inflow in m3/s u[0]. */
static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    dx[0] = (u[0] - p[1] * sqrt(2.0 * 9.81 * fmax(x[0], 0.0))) / p[0];
    return 0;
}

/* The level is measured. */
static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    y[0] = x[0];
}

const struct apc_model apc_model = {
    .abi = APC_MODEL_ABI,
    .name = "myplant",
    .description = "a tank",
    .nx = 1,
    .nu = 1,
    .ny = 1,
    .np = 2,
    .param = param,
    .state = state,
    .input = input,
    .f = f,
    .g = g,
};
