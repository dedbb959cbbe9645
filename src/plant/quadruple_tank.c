/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The quadruple-tank process (Johansson, The Quadruple-Tank Process: A Multivariable Laboratory Process with
 * an Adjustable Zero, IEEE Transactions on Control Systems Technology 8(3), 2000). Two pumps, four tanks,
 * each pump feeding a lower and, through a valve set to g1 or g2, the upper tank of the other side:
 *
 *   A1 h1' = g1 k1 v1 + q3 - q1,       A2 h2' = g2 k2 v2 + q4 - q2,
 *   A3 h3' = (1 - g2) k2 v2 - q3,      A4 h4' = (1 - g1) k1 v1 - q4,     qi = ai sqrt(2 g hi)
 *
 * and yi = kc hi for the lower two. With g1 + g2 > 1 both zeros lie in the left half plane, with less one
 * lies in the right: the two operating points of the paper are two models here. The pumps do not run
 * backwards. What rises over the brim, at h_max, runs off within seconds and is lost.
 */
#include "plant/plant_internal.h"

#define PARAM(g1, g2, k1, k2)                                                                                \
    {                                                                                                        \
        {"A1", "cm2", "cross section of tank 1", 28.0, 1e-3, 1e6},                                           \
            {"A2", "cm2", "cross section of tank 2", 32.0, 1e-3, 1e6},                                       \
            {"A3", "cm2", "cross section of tank 3", 28.0, 1e-3, 1e6},                                       \
            {"A4", "cm2", "cross section of tank 4", 32.0, 1e-3, 1e6},                                       \
            {"a1", "cm2", "outlet of tank 1", 0.071, 0.0, 1e3},                                              \
            {"a2", "cm2", "outlet of tank 2", 0.057, 0.0, 1e3},                                              \
            {"a3", "cm2", "outlet of tank 3", 0.071, 0.0, 1e3},                                              \
            {"a4", "cm2", "outlet of tank 4", 0.057, 0.0, 1e3},                                              \
            {"g1", "", "share of pump 1 that goes to tank 1, the rest to tank 4", g1, 0.0, 1.0},             \
            {"g2", "", "share of pump 2 that goes to tank 2, the rest to tank 3", g2, 0.0, 1.0},             \
            {"k1", "cm3/s/V", "pump 1", k1, 0.0, 1e3}, {"k2", "cm3/s/V", "pump 2", k2, 0.0, 1e3},            \
            {"kc", "V/cm", "level sensors", 0.5, 1e-6, 1e6}, {"g", "cm/s2", "gravity", 981.0, 0.0, 1e5},     \
            {"h_max", "cm", "height of the tanks", 20.0, 1e-3, 1e6},                                         \
    }
#define STATE(h1, h2, h3, h4)                                                                                \
    {                                                                                                        \
        {"h1", "cm", "level of tank 1", h1, 0.0, 1e6}, {"h2", "cm", "level of tank 2", h2, 0.0, 1e6},        \
            {"h3", "cm", "level of tank 3", h3, 0.0, 1e6}, {"h4", "cm", "level of tank 4", h4, 0.0, 1e6},    \
    }
#define INPUT(v)                                                                                             \
    {                                                                                                        \
        {"v1", "V", "pump 1", v, 0.0, 10.0}, {"v2", "V", "pump 2", v, 0.0, 10.0},                            \
    }

enum { A = 0, OUTLET = 4, G1 = 8, G2, K1, K2, KC, GRAVITY, H_MAX, N_PARAM };

static const struct apc_param minimum_param[N_PARAM] = PARAM(0.70, 0.60, 3.33, 3.35),
                              nonminimum_param[N_PARAM] = PARAM(0.43, 0.34, 3.14, 3.29);
static const struct apc_param minimum_state[] = STATE(12.4, 12.7, 1.8, 1.4),
                              nonminimum_state[] = STATE(12.6, 13.0, 4.8, 4.9);
static const struct apc_param minimum_input[] = INPUT(3.0), nonminimum_input[] = INPUT(3.15);
static const struct apc_param disturbance[] = {
    {"d3", "cm3/s", "flow into tank 3", 0.0, 0.0, 100.0},
    {"d4", "cm3/s", "flow into tank 4", 0.0, 0.0, 100.0},
};
static const struct apc_param output[] = {
    {"y1", "V", "level of tank 1, measured", 0.0, 0.0, 0.0},
    {"y2", "V", "level of tank 2, measured", 0.0, 0.0, 0.0},
};

static int quadruple_tank_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double pump1 = p[K1] * fmax(u[0], 0.0), pump2 = p[K2] * fmax(u[1], 0.0);
    double q[4];

    (void)t;
    for (int i = 0; i < 4; i++)
        q[i] = apc_outflow(p[OUTLET + i], p[GRAVITY], x[i]);
    dx[0] = (p[G1] * pump1 + q[2] - q[0]) / p[A];
    dx[1] = (p[G2] * pump2 + q[3] - q[1]) / p[A + 1];
    dx[2] = ((1.0 - p[G2]) * pump2 + u[2] - q[2]) / p[A + 2];
    dx[3] = ((1.0 - p[G1]) * pump1 + u[3] - q[3]) / p[A + 3];
    for (int i = 0; i < 4; i++)
        dx[i] -= fmax(x[i] - p[H_MAX], 0.0) * 1.0; /* 1/s */
    return 0;
}

static void quadruple_tank_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u;
    y[0] = p[KC] * x[0];
    y[1] = p[KC] * x[1];
}

#define MODEL(name_, description_, param_, state_, input_)                                                   \
    {                                                                                                        \
        .abi = APC_MODEL_ABI, .name = name_, .description = description_, .nx = 4, .nu = 2, .nd = 2,         \
        .ny = 2, .np = N_PARAM, .param = param_, .state = state_, .input = input_,                           \
        .disturbance = disturbance, .output = output, .f = quadruple_tank_f, .g = quadruple_tank_g,          \
    }

const struct apc_model apc_model_quadruple_tank = MODEL(
    "quadruple-tank", "quadruple-tank process, minimum phase", minimum_param, minimum_state, minimum_input);
const struct apc_model apc_model_quadruple_tank_nonminimum =
    MODEL("quadruple-tank-nonminimum", "quadruple-tank process, non-minimum phase", nonminimum_param,
          nonminimum_state, nonminimum_input);
