/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An inverted pendulum on a cart, with the numbers of the Control Tutorials for MATLAB and Simulink
 * (Messner and Tilbury, University of Michigan). phi is the angle from upright, positive when the pendulum
 * leans towards smaller s; unlike there the equations are not linearised:
 *
 *   (M + m) s'' + b s' - m l phi'' cos phi + m l phi'^2 sin phi = F + push
 *   (I + m l^2) phi'' - m g l sin phi = m l s'' cos phi
 */
#include "plant/plant_internal.h"

static const struct apc_param param[] = {
    {"M", "kg", "mass of the cart", 0.5, 1e-6, 1e6},
    {"m", "kg", "mass of the pendulum", 0.2, 1e-6, 1e6},
    {"b", "N s/m", "friction of the cart", 0.1, 0.0, 1e6},
    {"l", "m", "from the pivot to the pendulum's centre of mass", 0.3, 1e-6, 1e6},
    {"I", "kg m2", "moment of inertia of the pendulum", 0.006, 0.0, 1e6},
    {"g", "m/s2", "gravity", 9.8, 0.0, 1e3},
};
static const struct apc_param state[] = {
    {"s", "m", "position of the cart", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
    {"v", "m/s", "speed of the cart", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
    {"phi", "rad", "angle of the pendulum from upright", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
    {"omega", "rad/s", "angular speed of the pendulum", 0.0, -APC_VALUE_MAX, APC_VALUE_MAX},
};
static const struct apc_param input[] = {{"F", "N", "force on the cart", 0.0, -100.0, 100.0}};
static const struct apc_param disturbance[] = {{"push", "N", "another force on the cart", 0.0, -1e3, 1e3}};
static const struct apc_param output[] = {
    {"s", "m", "position of the cart", 0.0, 0.0, 0.0},
    {"phi", "rad", "angle of the pendulum from upright", 0.0, 0.0, 0.0},
};

static int pendulum_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double mass = p[0] + p[1], ml = p[1] * p[3], inertia = p[4] + ml * p[3];
    const double sine = apc_sin(x[2]), cosine = apc_cos(x[2]), coupling = ml * cosine;
    const double force = u[0] + u[1] - p[2] * x[1] - ml * x[3] * x[3] * sine, torque = ml * p[5] * sine;
    const double determinant = mass * inertia - coupling * coupling; /* above 0: M is */

    (void)t;
    dx[0] = x[1];
    dx[1] = (inertia * force + coupling * torque) / determinant;
    dx[2] = x[3];
    dx[3] = (coupling * force + mass * torque) / determinant;
    return 0;
}

static void pendulum_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
    y[1] = x[2];
}

const struct apc_model apc_model_pendulum = {
    .name = "pendulum",
    .description = "inverted pendulum on a cart",
    APC_MODEL_DISTURBED,
    .f = pendulum_f,
    .g = pendulum_g,
};
