/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Van de Vusse's reactions A -> B -> C, 2 A -> D in a stirred tank with a cooling jacket, the benchmark of
 * Klatt and Engell (Gain-scheduling trajectory control of a continuous stirred tank reactor, Computers &
 * Chemical Engineering 22(4-5), 1998). Its gain from F to cB changes sign and its zeros cross over near the
 * maximum of cB.
 *
 *   cA' = F (cA0 - cA) - k1 cA - k3 cA^2
 *   cB' = -F cB + k1 cA - k2 cB
 *   T'  = -(k1 cA dH1 + k2 cB dH2 + k3 cA^2 dH3) / (rho Cp) + F (Tin - T) + Kw AR (TK - T) / (rho Cp VR)
 *   TK' = (Q + Kw AR (T - TK)) / (mK CpK)
 *   k1 = k2 = k0 exp(-E1 / T), k3 = k03 exp(-E3 / T), T in K
 *
 * The source counts in hours; F, Q and the rate constants keep that, the model's time is in seconds.
 */
#include "plant/plant_internal.h"

enum { K0, E1, K03, E3, DH1, DH2, DH3, RHO, CP, KW, AR, VR, MK, CPK, N_PARAM };

static const struct apc_param param[N_PARAM] = {
    {"k0", "1/h", "frequency factor of A -> B and B -> C", 1.287e12, 0.0, 1e20},
    {"E1", "K", "their activation temperature", 9758.3, 0.0, 1e6},
    {"k03", "L/mol/h", "frequency factor of 2 A -> D", 9.043e9, 0.0, 1e20},
    {"E3", "K", "its activation temperature", 8560.0, 0.0, 1e6},
    {"dH1", "kJ/mol", "enthalpy of A -> B", 4.2, -1e4, 1e4},
    {"dH2", "kJ/mol", "enthalpy of B -> C", -11.0, -1e4, 1e4},
    {"dH3", "kJ/mol", "enthalpy of 2 A -> D", -41.85, -1e4, 1e4},
    {"rho", "kg/L", "density", 0.9342, 1e-6, 1e3},
    {"Cp", "kJ/kg/K", "heat capacity", 3.01, 1e-6, 1e3},
    {"Kw", "kJ/h/m2/K", "heat transfer to the jacket", 4032.0, 0.0, 1e9},
    {"AR", "m2", "area of the jacket", 0.215, 0.0, 1e6},
    {"VR", "L", "volume", 10.01, 1e-6, 1e9},
    {"mK", "kg", "mass of the coolant", 5.0, 1e-6, 1e9},
    {"CpK", "kJ/kg/K", "heat capacity of the coolant", 2.0, 1e-6, 1e3},
};
static const struct apc_param state[] = {
    {"cA", "mol/L", "concentration of A", 2.14, 0.0, 1e3},
    {"cB", "mol/L", "concentration of B", 1.0903, 0.0, 1e3},
    {"T", "degC", "temperature", 114.194, -APC_KELVIN, 1e4},
    {"TK", "degC", "temperature of the coolant", 112.910, -APC_KELVIN, 1e4},
};
static const struct apc_param input[] = {
    {"F", "1/h", "feed per volume", 14.19, 0.0, 50.0},
    {"Q", "kJ/h", "heat given to the coolant", -1113.5, -9000.0, 0.0},
};
static const struct apc_param disturbance[] = {
    {"cA0", "mol/L", "concentration of A in the feed", 5.10, 0.0, 20.0},
    {"Tin", "degC", "temperature of the feed", 104.9, -50.0, 300.0},
};
static const struct apc_param output[] = {
    {"cB", "mol/L", "concentration of B", 0.0, 0.0, 0.0},
    {"T", "degC", "temperature", 0.0, 0.0, 0.0},
};

static int van_de_vusse_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double kelvin = x[2] + APC_KELVIN, feed = fmax(u[0], 0.0), per_s = 1.0 / 3600.0;
    double r1, r2, r3, wall;

    (void)t;
    if (!(kelvin > 0.0))
        return 1;
    r1 = p[K0] * apc_exp(-p[E1] / kelvin) * x[0];
    r2 = p[K0] * apc_exp(-p[E1] / kelvin) * x[1];
    r3 = p[K03] * apc_exp(-p[E3] / kelvin) * x[0] * x[0];
    wall = p[KW] * p[AR] * (x[3] - x[2]);
    dx[0] = per_s * (feed * (u[2] - x[0]) - r1 - r3);
    dx[1] = per_s * (-feed * x[1] + r1 - r2);
    dx[2] = per_s * (-(r1 * p[DH1] + r2 * p[DH2] + r3 * p[DH3]) / (p[RHO] * p[CP]) + feed * (u[3] - x[2]) +
                     wall / (p[RHO] * p[CP] * p[VR]));
    dx[3] = per_s * (u[1] - wall) / (p[MK] * p[CPK]);
    return 0;
}

static void van_de_vusse_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[1];
    y[1] = x[2];
}

const struct apc_model apc_model_van_de_vusse = {
    .name = "van-de-vusse",
    .description = "Van de Vusse's reactions in a cooled stirred tank",
    APC_MODEL_DISTURBED,
    .f = van_de_vusse_f,
    .g = van_de_vusse_g,
};
