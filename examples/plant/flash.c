/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A plant with algebraic equations, a flash drum: cc -shared -fPIC -o flash.so flash.c -lm
 *
 * Benzene and toluene at constant pressure. States are the liquid in the drum and its mole fraction of
 * benzene. Temperature, vapour's mole fraction and vapour flow follow at once: liquid and vapour are in
 * equilibrium (Raoult's law, Antoine's equation), and no heat is stored. In the paper's Listing 6 f is
 * x' = f(t, x, args) and residual 0 = g(t, x, args).
 */
#include <apcplant.h>
#include <math.h>

#define F      u[2] /* disturbances come after the inputs */
#define Z_FEED u[3]
#define T      x[2] /* algebraic variables after the states */
#define Y      x[3]
#define V      x[4]

/*                                      name       unit       description                initial low high */
static const struct apc_param param[] = {
    {"P", "kPa", "pressure", 101.325, 20.0, 500.0},
    {"cp", "kJ/kmol/K", "heat capacity of the liquid", 155.0, 50.0, 500.0},
    {"lambda", "kJ/kmol", "heat of vaporisation", 32000.0, 1e4, 1e5},
    {"T_feed", "degC", "temperature of the feed", 90.0, 0.0, 110.0},
    {"Kv", "kmol^0.5/s", "outlet's valve", 0.0062, 1e-4, 0.1}};
static const struct apc_param state[] = {{"M", "kmol", "liquid in the drum", 10.0, 0.1, 20.0},
                                         {"x", "", "mole fraction of benzene in it", 0.4, 0.0, 1.0}};
static const struct apc_param algebraic[] = {
    {"T", "degC", "temperature", 95.0, 0.0, 200.0},
    {"y", "", "mole fraction of benzene in the vapour", 0.6, 0.0, 1.0},
    {"V", "kmol/s", "flow of the vapour", 0.01, -1.0, 1.0}};
static const struct apc_param input[] = {{"Q", "kW", "heating", 350.0, 0.0, 1000.0},
                                         {"valve", "%", "outlet of the liquid", 50.0, 0.0, 100.0}};
static const struct apc_param disturbance[] = {{"F", "kmol/s", "flow of the feed", 0.02, 0.0, 0.05},
                                               {"z", "", "mole fraction of benzene in it", 0.5, 0.0, 1.0}};
static const struct apc_param output[] = {{"T", "degC", "temperature", 0.0, 0.0, 0.0},
                                          {"M", "kmol", "liquid in the drum", 0.0, 0.0, 0.0}};

static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double liquid = p[4] * u[1] / 100.0 * sqrt(fmax(x[0], 0.0));
    dx[0] = F - V - liquid;
    dx[1] = (F * (Z_FEED - x[1]) - V * (Y - x[1])) / fmax(x[0], 0.1);
    return 0;
}

/* kPa */
static double benzene(double temperature)
{
    return 0.133322 * pow(10.0, 6.90565 - 1211.033 / (temperature + 220.79));
}

static double toluene(double temperature)
{
    return 0.133322 * pow(10.0, 6.95464 - 1344.8 / (temperature + 219.482));
}

/* 0 = residual */
static int residual(double t, const double *x, const double *u, const double *p, double *r)
{
    r[0] = x[1] * benzene(T) / p[0] + (1.0 - x[1]) * toluene(T) / p[0] - 1.0; /* the liquid boils */
    r[1] = x[1] * benzene(T) / p[0] - Y;
    r[2] = (u[0] + F * p[1] * (p[3] - T)) / p[2] - V; /* the heat makes vapour */
    return 0;
}

static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    y[0] = T;
    y[1] = x[0];
}

const struct apc_model apc_model = {
    .abi = APC_MODEL_ABI,
    .name = "flash",
    .description = "flash drum for benzene and toluene",
    .nx = 2,
    .nu = 2,
    .nd = 2,
    .ny = 2,
    .np = 5,
    .nz = 3,
    .param = param,
    .state = state,
    .algebraic = algebraic,
    .input = input,
    .disturbance = disturbance,
    .output = output,
    .f = f,
    .residual = residual,
    .g = g,
};
