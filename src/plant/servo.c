/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A servo motor, the standard example of TrueTime (Cervin et al., How Does Control Timing Affect
 * Performance?, IEEE Control Systems Magazine 23(3), 2003): G(s) = K / (s (tau s + 1)), K = 1000, tau = 1 s.
 *
 *   angle' = speed,  tau speed' = -speed + K (u + load)
 */
#include "plant/plant_internal.h"

static const struct apc_param param[] = {
    {"K", "", "gain", 1000.0, -1e6, 1e6},
    {"tau", "s", "time constant", 1.0, 1e-6, 1e6},
};
static const struct apc_param state[] = {
    {"angle", "rad", "angle", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
    {"speed", "rad/s", "angular speed", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
};
static const struct apc_param input[] = {{"u", "V", "voltage", 0.0, -10.0, 10.0}};
static const struct apc_param disturbance[] = {{"load", "V", "load torque, as voltage", 0.0, -10.0, 10.0}};
static const struct apc_param output[] = {{"angle", "rad", "angle", 0.0, 0.0, 0.0}};

static int servo_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    dx[0] = x[1];
    dx[1] = (-x[1] + p[0] * (u[0] + u[1])) / p[1];
    return 0;
}

static void servo_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

const struct apc_model apc_model_servo = {
    .name = "servo",
    .description = "servo motor, TrueTime's example",
    APC_MODEL_DISTURBED,
    .f = servo_f,
    .g = servo_g,
};
