/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A hundred first-order processes in ten areas, for what depends on how many loops there are:
 *
 *   tau_a x' = -x + K u + d_a,  y = x
 *
 * Those of an area have its time constant, and what disturbs one of them disturbs all. Areas do not know of
 * each other.
 */
#include "plant/plant_internal.h"

#define AREAS ((size_t)10)
#define EACH  ((size_t)10)

static const struct apc_param param[] = {
    {"K", "", "gain", 1.0, -1e6, 1e6},
    {"tau", "s", "time constant of the fastest area", 1.0, 1e-6, 1e6},
};

/* Time constants of the areas, in multiples of the fastest. */
static const double slower[AREAS] = {1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 12.0, 15.0, 20.0};

#define TEN(m, a) m(a, 0), m(a, 1), m(a, 2), m(a, 3), m(a, 4), m(a, 5), m(a, 6), m(a, 7), m(a, 8), m(a, 9)
#define ALL(m)                                                                                               \
    TEN(m, 0), TEN(m, 1), TEN(m, 2), TEN(m, 3), TEN(m, 4), TEN(m, 5), TEN(m, 6), TEN(m, 7), TEN(m, 8),       \
        TEN(m, 9)
#define STATE(a, i)                                                                                          \
    {                                                                                                        \
        "x" #a #i, "", "state of process " #i " of area " #a, 0.0, -APC_VALUE_MAX, APC_VALUE_MAX             \
    }
#define INPUT(a, i)                                                                                          \
    {                                                                                                        \
        "u" #a #i, "", "input of process " #i " of area " #a, 0.0, -100.0, 100.0                             \
    }
#define OUTPUT(a, i)                                                                                         \
    {                                                                                                        \
        "y" #a #i, "", "output of process " #i " of area " #a, 0.0, 0.0, 0.0                                 \
    }
#define LOAD(a)                                                                                              \
    {                                                                                                        \
        "d" #a, "", "load of area " #a, 0.0, -100.0, 100.0                                                   \
    }

static const struct apc_param state[] = {ALL(STATE)};
static const struct apc_param input[] = {ALL(INPUT)};
static const struct apc_param output[] = {ALL(OUTPUT)};
static const struct apc_param disturbance[] = {LOAD(0), LOAD(1), LOAD(2), LOAD(3), LOAD(4),
                                               LOAD(5), LOAD(6), LOAD(7), LOAD(8), LOAD(9)};

static int hundred_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double *d = &u[AREAS * EACH];

    (void)t;
    for (size_t i = 0; i < AREAS * EACH; i++)
        dx[i] = (-x[i] + p[0] * u[i] + d[i / EACH]) / (p[1] * slower[i / EACH]);
    return 0;
}

static void hundred_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)u;
    (void)p;
    for (size_t i = 0; i < AREAS * EACH; i++)
        y[i] = x[i];
}

const struct apc_model apc_model_hundred = {
    .name = "hundred",
    .description = "a hundred first-order processes in ten areas",
    APC_MODEL_DISTURBED,
    .f = hundred_f,
    .g = hundred_g,
};
