/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An exothermic reaction A + 2 B -> products in an adiabatic stirred tank (Wahlgreen, Schroll-Fleischer,
 * Boiroux, Ritschel, Wu, Huusom, Jorgensen, Nonlinear Model Predictive Control for an Exothermic Reaction in
 * an Adiabatic CSTR, ACODS 2020). Between two folds it has three steady states, of which the middle one is
 * unstable.
 *
 *   cA' = F/V (cAin - cA) - r,  cB' = F/V (cBin - cB) - 2 r,  T' = F/V (Tin - T) + beta r,
 *   r = k0 exp(-E / T) cA cB, T in K
 */
#include "plant/plant_internal.h"

enum { LN_K0, E, BETA, V, N_PARAM };

static const struct apc_param param[N_PARAM] = {
    {"ln_k0", "ln L/mol/s", "logarithm of the frequency factor", 24.6, -100.0, 100.0},
    {"E", "K", "activation temperature", 8500.0, 0.0, 1e6},
    {"beta", "K L/mol", "rise of temperature with conversion", 133.779, -1e6, 1e6},
    {"V", "L", "volume", 0.105, 1e-9, 1e9},
};
static const struct apc_param state[] = {
    {"cA", "mol/L", "concentration of A", 0.8, 0.0, 1e3},
    {"cB", "mol/L", "concentration of B", 1.2, 0.0, 1e3},
    {"T", "degC", "temperature", 0.5, -APC_KELVIN, 1e4},
};
static const struct apc_param input[] = {{"F", "mL/min", "feed", 500.0, 0.0, 1000.0}};
static const struct apc_param disturbance[] = {
    {"cAin", "mol/L", "concentration of A in the feed", 0.8, 0.0, 10.0},
    {"cBin", "mol/L", "concentration of B in the feed", 1.2, 0.0, 10.0},
    {"Tin", "degC", "temperature of the feed", 0.5, -50.0, 100.0},
};
static const struct apc_param output[] = {{"T", "degC", "temperature", 0.0, 0.0, 0.0}};

static int adiabatic_cstr_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double kelvin = x[2] + APC_KELVIN, dilution = fmax(u[0], 0.0) / 60e3 / p[V]; /* 1/s */
    double r;

    (void)t;
    if (!(kelvin > 0.0))
        return 1;
    r = apc_exp(p[LN_K0] - p[E] / kelvin) * x[0] * x[1];
    dx[0] = dilution * (u[1] - x[0]) - r;
    dx[1] = dilution * (u[2] - x[1]) - 2.0 * r;
    dx[2] = dilution * (u[3] - x[2]) + p[BETA] * r;
    return 0;
}

static void adiabatic_cstr_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[2];
}

const struct apc_model apc_model_adiabatic_cstr = {
    .name = "adiabatic-cstr",
    .description = "exothermic reaction in an adiabatic stirred tank",
    APC_MODEL_DISTURBED,
    .f = adiabatic_cstr_f,
    .g = adiabatic_cstr_g,
};
