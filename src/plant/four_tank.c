/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The modified four-tank system of DTU (Azam and Jorgensen, Modeling and simulation of a modified quadruple
 * tank system, IEEE ICCSCE 2015): the quadruple tank with flows that disturb the upper tanks; the masses are
 * the states.
 *
 *   m1' = rho (g1 F1 + q3 - q1),              m2' = rho (g2 F2 + q4 - q2),
 *   m3' = rho ((1 - g2) F2 + F3 - q3),        m4' = rho ((1 - g1) F1 + F4 - q4),
 *   qi = ai sqrt(2 g hi),  hi = mi / (rho Ai)
 */
#include "plant/plant_internal.h"

enum { OUTLET, A, GRAVITY, RHO, G1, G2, N_PARAM };

static const struct apc_param param[N_PARAM] = {
    {"a", "cm2", "outlet of each tank", 1.2272, 0.0, 1e3},
    {"A", "cm2", "cross section of each tank", 380.1327, 1e-3, 1e6},
    {"g", "cm/s2", "gravity", 981.0, 0.0, 1e5},
    {"rho", "g/cm3", "density", 1.0, 1e-6, 1e3},
    {"g1", "", "share of F1 that goes to tank 1, the rest to tank 4", 0.6, 0.0, 1.0},
    {"g2", "", "share of F2 that goes to tank 2, the rest to tank 3", 0.7, 0.0, 1.0},
};
static const struct apc_param state[] = {
    {"m1", "g", "mass in tank 1", 17612.0124, 0.0, 1e9},
    {"m2", "g", "mass in tank 2", 29640.6695, 0.0, 1e9},
    {"m3", "g", "mass in tank 3", 4644.2195, 0.0, 1e9},
    {"m4", "g", "mass in tank 4", 9378.4931, 0.0, 1e9},
};
static const struct apc_param input[] = {
    {"F1", "cm3/s", "pump 1", 300.0, 0.0, 500.0},
    {"F2", "cm3/s", "pump 2", 300.0, 0.0, 500.0},
};
static const struct apc_param disturbance[] = {
    {"F3", "cm3/s", "flow into tank 3", 100.0, 0.0, 500.0},
    {"F4", "cm3/s", "flow into tank 4", 150.0, 0.0, 500.0},
};
static const struct apc_param output[] = {
    {"h1", "cm", "level of tank 1", 0.0, 0.0, 0.0},
    {"h2", "cm", "level of tank 2", 0.0, 0.0, 0.0},
};

/* Out of a tank with so much in it. */
static double flow(const double *p, double mass)
{
    return apc_outflow(p[OUTLET], p[GRAVITY], mass / (p[RHO] * p[A]));
}

static int four_tank_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double f1 = fmax(u[0], 0.0), f2 = fmax(u[1], 0.0);

    (void)t;
    dx[0] = p[RHO] * (p[G1] * f1 + flow(p, x[2]) - flow(p, x[0]));
    dx[1] = p[RHO] * (p[G2] * f2 + flow(p, x[3]) - flow(p, x[1]));
    dx[2] = p[RHO] * ((1.0 - p[G2]) * f2 + fmax(u[2], 0.0) - flow(p, x[2]));
    dx[3] = p[RHO] * ((1.0 - p[G1]) * f1 + fmax(u[3], 0.0) - flow(p, x[3]));
    return 0;
}

static void four_tank_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u;
    y[0] = x[0] / (p[RHO] * p[A]);
    y[1] = x[1] / (p[RHO] * p[A]);
}

const struct apc_model apc_model_four_tank = {
    .name = "four-tank",
    .description = "modified four-tank system with disturbance flows",
    APC_MODEL_DISTURBED,
    .f = four_tank_f,
    .g = four_tank_g,
};
