/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Two tanks, the upper one draining into the lower one, whose level is controlled; mass balances with
 * Torricelli's law, as in every text book (for instance Astrom and Wittenmark, Computer-Controlled Systems).
 *
 *   A1 h1' = k u - a1 sqrt(2 g h1),  A2 h2' = a1 sqrt(2 g h1) - a2 sqrt(2 g h2) - leak
 *
 * The pump does not run backwards.
 */
#include "plant/plant_internal.h"

static const struct apc_param param[] = {
    {"A1", "m2", "cross section of tank 1", 0.5, 1e-6, 1e6},
    {"A2", "m2", "cross section of tank 2", 0.25, 1e-6, 1e6},
    {"a1", "m2", "outlet of tank 1", 0.019, 0.0, 1e3},
    {"a2", "m2", "outlet of tank 2", 0.016, 0.0, 1e3},
    {"k", "m3/s/V", "pump", 0.003, 0.0, 1e3},
    {"g", "m/s2", "gravity", 9.81, 0.0, 1e3},
};
static const struct apc_param state[] = {
    {"h1", "m", "level of tank 1", 0.0, 0.0, APC_VALUE_MAX},
    {"h2", "m", "level of tank 2", 0.0, 0.0, APC_VALUE_MAX},
};
static const struct apc_param input[] = {{"u", "V", "pump voltage", 10.0, 0.0, 20.0}};
static const struct apc_param disturbance[] = {{"leak", "m3/s", "drawn from tank 2", 0.0, 0.0, 1.0}};
static const struct apc_param output[] = {
    {"h2", "m", "level of tank 2", 0.0, 0.0, 0.0},
    {"h1", "m", "level of tank 1", 0.0, 0.0, 0.0},
};

static int double_tank_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    double q1 = apc_outflow(p[2], p[5], x[0]), q2 = apc_outflow(p[3], p[5], x[1]);

    (void)t;
    if (x[1] > 0.0)
        q2 += u[1];
    dx[0] = (p[4] * fmax(u[0], 0.0) - q1) / p[0];
    dx[1] = (q1 - q2) / p[1];
    return 0;
}

static void double_tank_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[1];
    y[1] = x[0];
}

const struct apc_model apc_model_double_tank = {
    .name = "double-tank",
    .description = "two tanks in series",
    APC_MODEL_DISTURBED,
    .f = double_tank_f,
    .g = double_tank_g,
};
