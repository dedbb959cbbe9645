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

int apc_lag_response(const struct apc_lag *lag, double Ts, const double *u, size_t stride, size_t n,
                     double *w, double *rate)
{
    const double periods = lag->dead_time / Ts;
    const size_t d = (size_t)ceil(periods - 1e-9);
    const double late = d == 0 ? 0.0 : fmax(Ts - (lag->dead_time - ((double)d - 1.0) * Ts), 0.0);
    double A[STATES * STATES], b[STATES], Phi[STATES * STATES], phi[STATES * STATES], whole[STATES],
        part[STATES] = {0};
    double x[STATES] = {0}, next[STATES];
    const size_t states = equations(lag, A, b);
    int rc = apc_linear_sample(states, 1, A, b, Ts, Phi, whole, NULL);

    if (rc == 0 && late > 0.0)
        rc = apc_linear_sample(states, 1, A, b, late, phi, part, NULL);
    for (size_t k = 0; k < n && rc == 0; k++) {
        const double old = k < d ? 0.0 : u[(k - d) * stride] - u[0],
                     young = d == 0 || k + 1 < d ? 0.0 : u[(k + 1 - d) * stride] - u[0];

        w[k] = x[states - 1];
        if (rate)
            rate[k] = states == 1 ? b[0] * old + A[0] * x[0]
                                  : A[states * states - 2] * x[states - 2] + A[states * states - 1] * w[k];
        for (size_t i = 0; i < states; i++) {
            next[i] = (whole[i] - part[i]) * old + part[i] * young;
            for (size_t j = 0; j < states; j++)
                next[i] += Phi[i * states + j] * x[j];
        }
        memcpy(x, next, sizeof x);
    }
    return rc;
}
