/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The temperature control lab, two heaters on a board, as the linear model of its Python package (Kantor's
 * and Hedengren's TCLab, the simulator of `tclab.TCLabModel`):
 *
 *   H1' = P1 Q1 / 5720 + (Ta - H1) / 20 - (H1 - H2) / 100,
 *   H2' = P2 Q2 / 5720 + (Ta - H2) / 20 + (H1 - H2) / 100,   Ti' = (Hi - Ti) / 140
 *
 * The real sensors have noise of 0.043 degC and steps of 0.3223 degC; an experiment gives them to its
 * measurements with `noise` and `quantum`.
 */
#include "plant/plant_internal.h"

enum { P1, P2, N_PARAM };

static const struct apc_param param[N_PARAM] = {
    {"P1", "", "power of heater 1", 200.0, 0.0, 1e6},
    {"P2", "", "power of heater 2", 100.0, 0.0, 1e6},
};
static const struct apc_param state[] = {
    {"H1", "degC", "temperature of heater 1", 21.0, -APC_KELVIN, 1e4},
    {"H2", "degC", "temperature of heater 2", 21.0, -APC_KELVIN, 1e4},
    {"T1", "degC", "temperature of sensor 1", 21.0, -APC_KELVIN, 1e4},
    {"T2", "degC", "temperature of sensor 2", 21.0, -APC_KELVIN, 1e4},
};
static const struct apc_param input[] = {
    {"Q1", "%", "heater 1", 0.0, 0.0, 100.0},
    {"Q2", "%", "heater 2", 0.0, 0.0, 100.0},
};
static const struct apc_param disturbance[] = {{"Ta", "degC", "ambient temperature", 21.0, -50.0, 100.0}};
static const struct apc_param output[] = {
    {"T1", "degC", "temperature of sensor 1", 0.0, 0.0, 0.0},
    {"T2", "degC", "temperature of sensor 2", 0.0, 0.0, 0.0},
};

static int temperature_lab_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double across = (x[0] - x[1]) / 100.0;

    (void)t;
    dx[0] = p[P1] * u[0] / 5720.0 + (u[2] - x[0]) / 20.0 - across;
    dx[1] = p[P2] * u[1] / 5720.0 + (u[2] - x[1]) / 20.0 + across;
    dx[2] = (x[0] - x[2]) / 140.0;
    dx[3] = (x[1] - x[3]) / 140.0;
    return 0;
}

static void temperature_lab_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[2];
    y[1] = x[3];
}

const struct apc_model apc_model_temperature_lab = {
    .name = "temperature-lab",
    .description = "temperature control lab: two heaters",
    APC_MODEL_DISTURBED,
    .f = temperature_lab_f,
    .g = temperature_lab_g,
};
