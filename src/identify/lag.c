/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Sampled lags, exact for any dead time: of the inputs of d and d - 1 periods ago the former acts for the
 * first a seconds of a period, where the dead time is (d - 1) Ts + a, the latter for the rest.
 */
#include "identify/identify_internal.h"

#include <math.h>
#include <string.h>

#define STATES 3

/* x1' = (u - x1) / tau1, x2' = (x1 - x2) / tau2, and behind them x' = what comes. */
static size_t equations(const struct apc_lag *lag, double *A, double *b)
{
    const size_t n = lag->order + lag->integrating;

    memset(A, 0, sizeof(double[STATES * STATES]));
    memset(b, 0, sizeof(double[STATES]));
    for (size_t i = 0; i < n; i++) {
        const double rate = i < lag->order ? 1.0 / lag->tau[i] : 1.0;

        if (i < lag->order)
            A[i * n + i] = -rate;
        if (i == 0)
            b[i] = rate;
        else
            A[i * n + i - 1] = rate;
    }
    return n;
}

/* The recursion of a lag: Phi, what the older and the younger of two inputs add, and its rate, A x + b u. */
struct recursion {
    double Phi[STATES * STATES], old[STATES], young[STATES], A[STATES * STATES], b[STATES];
    size_t d;
};

/* Inlined for each number of states, so that its loops are none. */
static inline void recur(const struct recursion *r, const size_t states, double before, const double *u,
                         size_t stride, size_t n, double *w, double *rate)
{
    double x[STATES] = {0}, next[STATES];

    for (size_t k = 0; k < n; k++) {
        const double old = k < r->d ? 0.0 : u[(k - r->d) * stride] - before,
                     young = r->d == 0 || k + 1 < r->d ? 0.0 : u[(k + 1 - r->d) * stride] - before;

        w[k] = x[states - 1];
        if (rate)
            rate[k] = states == 1
                          ? r->b[0] * old + r->A[0] * x[0]
                          : r->A[states * states - 2] * x[states - 2] + r->A[states * states - 1] * w[k];
        for (size_t i = 0; i < states; i++) {
            next[i] = r->old[i] * old + r->young[i] * young;
            for (size_t j = 0; j < states; j++)
                next[i] += r->Phi[i * states + j] * x[j];
        }
        for (size_t i = 0; i < states; i++)
            x[i] = next[i];
    }
}

int apc_lag_response(const struct apc_lag *lag, double Ts, double before, const double *u, size_t stride,
                     size_t n, double *w, double *rate)
{
    const double periods = lag->dead_time / Ts;
    struct recursion r = {.d = (size_t)ceil(periods - 1e-9)};
    const double late = r.d == 0 ? 0.0 : fmax(Ts - (lag->dead_time - ((double)r.d - 1.0) * Ts), 0.0);
    double phi[STATES * STATES];
    const size_t states = equations(lag, r.A, r.b);
    int rc = apc_linear_sample(states, 1, r.A, r.b, Ts, r.Phi, r.old, NULL);

    if (rc == 0 && late > 0.0)
        rc = apc_linear_sample(states, 1, r.A, r.b, late, phi, r.young, NULL);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < states; i++)
        r.old[i] -= r.young[i];
    if (states == 1)
        recur(&r, 1, before, u, stride, n, w, rate);
    else if (states == 2)
        recur(&r, 2, before, u, stride, n, w, rate);
    else
        recur(&r, STATES, before, u, stride, n, w, rate);
    return 0;
}
