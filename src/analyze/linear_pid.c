/* SPDX-License-Identifier: BSD-3-Clause */
/* The margins of a PID loop that is known by its transfer function alone, as it ticks. */
#include "linear.h"

enum { LAGS = 3, MOST_PERIODS = 60 };

/* dx/dt = a x + b v, w = c x + d v: one after the other they are the plant. */
struct lag {
    double a, b, c, d;
};

static size_t lags_of_transfer(const struct apc_transfer *g, struct lag lag[LAGS])
{
    double zero = g->zero;
    size_t n = 0;
    for (int i = 0; i < 2; i++)
        if (g->tau[i] > 0.0) {
            lag[n++] =
                (struct lag){-1.0 / g->tau[i], 1.0 / g->tau[i], 1.0 - zero / g->tau[i], zero / g->tau[i]};
            zero = 0.0;
        }
    if (g->integrating)
        lag[n++] = (struct lag){0.0, 1.0, 1.0, zero};
    return n;
}

/* @p u of one input: what reaches each lag is a sum of states, and the input. */
static void plant_of_lags(double gain, const struct lag *lag, size_t n, double *A, double *B, double *C,
                          double *D)
{
    double reaches[LAGS] = {0.0}, direct = gain;
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < n; k++)
            A[i * n + k] = k == i ? lag[i].a : lag[i].b * reaches[k];
        B[i] = lag[i].b * direct;
        for (size_t k = 0; k < n; k++)
            reaches[k] = k == i ? lag[i].c : lag[i].d * reaches[k];
        direct *= lag[i].d;
    }
    for (size_t k = 0; k < n; k++)
        C[k] = reaches[k];
    *D = direct;
}

int linear_margins_of_pid(const struct apc_transfer *g, const struct apc_pid_tuning *t, double Ts,
                          struct apc_margins *margins, struct apc_error *why)
{
    struct lag lag[LAGS];
    const size_t n = lags_of_transfer(g, lag), to = 0;
    double A[LAGS * LAGS], B[LAGS], C[LAGS], D;
    const double derivative = t->Kp * t->tau_d / Ts, integral = t->tau_i > 0.0 ? t->Kp * Ts / t->tau_i : 0.0;
    /* of what has been integrated, and the measurement before */
    const double state[] = {t->tau_i > 0.0, 0.0, 0.0, 0.0}, in[] = {-integral, 1.0},
                 out[] = {1.0, derivative}, through = -t->Kp - derivative;
    const struct apc_loop_source measured = {APC_FROM_MEASUREMENT, 0};
    const struct apc_loop_controller pid = {2, 1, 1, state, in, out, &through, &measured, &to};
    const struct apc_loop_tick tick = {.controller = 0};
    struct apc_loop_setup setup = {.size = sizeof setup,
                                   .plant = {.nx = n, .nu = 1, .ny = 1, .A = A, .B = B, .C = C, .D = &D},
                                   .n_controllers = 1,
                                   .controller = &pid,
                                   .n_ticks = 1,
                                   .tick = &tick};
    struct apc_loop_margins of = {.size = sizeof of};
    struct apc_loop *loop = NULL;
    if (g->dead_time > MOST_PERIODS * Ts) /* half a period is little of it */
        return apc_tune_margins(g, t, Ts, margins, why);
    plant_of_lags(g->gain, lag, n, A, B, C, &D);
    int rc = apc_period_from_s(Ts, &setup.period, why);
    setup.plant.period = setup.period;
    if (rc == 0)
        rc = apc_ns_from_s(g->dead_time, &setup.plant.dead_time);
    if (rc == 0)
        rc = apc_loop_create(&loop, &setup, why);
    if (rc == 0)
        rc = apc_loop_margins(loop, 0, NULL, &of, why);
    apc_loop_destroy(loop);
    *margins = (struct apc_margins){sizeof *margins, of.gain, of.phase, of.delay, of.sensitivity, of.stable};
    return rc;
}
