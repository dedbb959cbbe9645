/* SPDX-License-Identifier: BSD-3-Clause */
/* What stands out in the response of a loop: peaks of its sensitivities, and its crossover. */
#include <math.h>
#include <stdlib.h>

#include "analyze/analyze_internal.h"

struct peaks {
    struct open open;
    const double *scale;
    double complex *S, *T; /* [m * m] */
    bool lowest;           /* of |L|, and not the highest */
};

/* The largest singular value of M [m * m], by the power method: a peak needs no more. */
static double largest_gain(size_t m, const double complex *M)
{
    double size = 0.0, sum = 0.0;
    double complex x[64], y[64];

    if (m == 1)
        return apc_cabs(M[0]);
    for (size_t i = 0; i < m; i++)
        x[i] = 1.0 + 0.1 * (double)i;
    for (int k = 0; k < 100; k++) {
        for (size_t i = 0; i < m; i++) {
            y[i] = 0.0;
            for (size_t j = 0; j < m; j++)
                y[i] += M[i * m + j] * x[j];
        }
        sum = 0.0;
        for (size_t j = 0; j < m; j++) {
            x[j] = 0.0;
            for (size_t i = 0; i < m; i++)
                x[j] += conj(M[i * m + j]) * y[i];
            sum += creal(x[j]) * creal(x[j]) + cimag(x[j]) * cimag(x[j]);
        }
        if (!(sum > 0.0))
            return 0.0;
        size = sqrt(sqrt(sum));
        for (size_t j = 0; j < m; j++)
            x[j] /= sqrt(sum);
    }
    return size;
}

/* L at @p w, in scaled outputs, into T. */
static int open_at(struct peaks *p, double w)
{
    const struct open *o = &p->open;
    const size_t m = o->m;
    const int rc = loop_frequency_response(&p->open, w);

    for (size_t i = 0; i < m && rc == 0; i++) {
        for (size_t j = 0; j < m; j++)
            p->T[i * m + j] = o->L[i * m + j] * (p->scale ? p->scale[o->of[j]] / p->scale[o->of[i]] : 1.0);
    }
    return rc;
}

/* Of 1 / (1 + L) and L / (1 + L) at @p w, as large as they are in scaled outputs. */
static int peaks_at(struct peaks *p, double w, double *s, double *t)
{
    struct open *o = &p->open;
    const size_t m = o->m;
    const int rc = open_at(p, w);

    if (rc < 0)
        return rc;
    for (size_t i = 0; i < m * m; i++) {
        p->S[i] = i % (m + 1) == 0 ? 1.0 : 0.0;
        o->L[i] = p->S[i] + p->T[i];
    }
    if (complex_solve(m, m, o->L, p->S))
        return APC_ESOLVER;
    for (size_t i = 0; i < m * m; i++)
        p->T[i] = (i % (m + 1) == 0 ? 1.0 : 0.0) - p->S[i];
    *s = largest_gain(m, p->S);
    *t = largest_gain(m, p->T);
    return 0;
}

/* The highest Nyquist frequency of those cut open; where one acts several times in a period nearly that,
 * which is an alias of 0, where integrators are. */
static double nyquist(const struct open *o)
{
    size_t most = 1;

    for (size_t k = 0; k < o->m; k++)
        most = o->ticks[k] > most ? o->ticks[k] : most;
    return (most > 1 ? 0.98 : 1.0) * M_PI * (double)most / apc_ns_to_s(o->loop->setup.period);
}

/* On a pole of the open loop there is no response, and no peak. */
static int sensitivity_at(void *ctx, double w, double *s)
{
    double t;
    const int rc = peaks_at(ctx, w, s, &t);

    *s = rc < 0 ? 0.0 : *s;
    return rc == APC_ESOLVER ? 0 : rc;
}

static int complementary_at(void *ctx, double w, double *t)
{
    double s;
    const int rc = peaks_at(ctx, w, &s, t);

    *t = rc < 0 ? 0.0 : *t;
    return rc == APC_ESOLVER ? 0 : rc;
}

/* |L|, beyond all on a pole; where the lowest is sought, one over that. */
static int gain_at(void *ctx, double w, double *gain)
{
    struct peaks *p = ctx;
    const int rc = open_at(p, w);

    *gain = rc == 0 ? largest_gain(p->open.m, p->T) : HUGE_VAL;
    *gain = p->lowest ? 1.0 / *gain : *gain;
    return rc == APC_ESOLVER ? 0 : rc;
}

/* Below @p high |L| is 1 somewhere above @p low. */
static int crossover_between(struct peaks *p, double low, double high, double *crossover)
{
    double gain;
    int rc = gain_at(p, high, &gain);
    const bool above = gain >= 1.0;

    for (int round = 0; round < 50 && rc == 0; round++) {
        *crossover = (low + high) / 2.0;
        rc = gain_at(p, *crossover, &gain);
        *((gain >= 1.0) == above ? &high : &low) = *crossover;
    }
    return rc;
}

/* The highest frequency at which |L| is 1: from the top of the grid down, also between two of its
 * frequencies. */
static int find_crossover(struct peaks *p, const struct frequency_grid *grid, double *crossover)
{
    double gain[3] = {0.0}, top, at; /* of frequency k and of those above it */
    int rc = 0;

    *crossover = (double)NAN;
    for (size_t k = grid->n; k-- > 0 && rc == 0;) {
        gain[2] = gain[1];
        gain[1] = gain[0];
        rc = gain_at(p, grid->w[k], &gain[0]);
        if (rc < 0 || k + 1 >= grid->n)
            continue;
        if (k + 2 < grid->n && stands_out(gain)) {
            p->lowest = gain[1] >= 1.0;
            top = p->lowest ? 1.0 / gain[1] : gain[1];
            at = grid->w[k + 1];
            rc = frequency_climb(gain_at, p, grid->w[k], grid->w[k + 2], &top, &at);
            p->lowest = false;
            if (rc == 0 && top >= 1.0 && at != grid->w[k + 1])
                return crossover_between(p, at, grid->w[k + 2], crossover);
        }
        if (rc == 0 && (gain[0] >= 1.0) != (gain[1] >= 1.0))
            return crossover_between(p, grid->w[k], grid->w[k + 1], crossover);
    }
    return rc;
}

static int find_peaks(struct peaks *p, const struct frequency_grid *grid, struct apc_loop_margins *to)
{
    double *s = calloc(2 * grid->n + 1, sizeof(*s)), *t = s + grid->n, at;
    int rc = s ? 0 : APC_ENOMEM;

    for (size_t k = 0; k < grid->n && rc == 0; k++) {
        rc = peaks_at(p, grid->w[k], &s[k], &t[k]);
        if (rc == APC_ESOLVER) { /* just on a pole of the open loop */
            s[k] = t[k] = 0.0;
            rc = 0;
        }
    }
    if (rc == 0)
        rc = frequency_grid_top(grid, s, sensitivity_at, p, &to->sensitivity, &to->at);
    if (rc == 0)
        rc = frequency_grid_top(grid, t, complementary_at, p, &to->complementary, &at);
    free(s);
    return rc;
}

/* Peaks are narrow where poles of the closed loop are, the gain where those of the open one are. */
static int survey(struct peaks *p, const double complex *closed, const double complex *cut, size_t n,
                  struct apc_loop_margins *to)
{
    const double period = apc_ns_to_s(p->open.loop->setup.period), top = nyquist(&p->open);
    struct frequency_grid grid;
    int rc = frequency_grid_create(&grid, period, top, closed, n);

    if (rc == 0)
        rc = find_peaks(p, &grid, to);
    frequency_grid_free(&grid);
    if (rc < 0)
        return rc;
    rc = frequency_grid_create(&grid, period, top, cut, n);
    if (rc == 0)
        rc = find_crossover(p, &grid, &to->crossover);
    frequency_grid_free(&grid);
    return rc;
}

int response_peaks(const struct apc_loop *loop, size_t of, const double *scale, const double complex *closed,
                   const double complex *cut, size_t n, struct apc_loop_margins *to)
{
    struct peaks p = {.scale = scale};
    int rc = open_create(&p.open, loop, of, NULL);
    const size_t m = p.open.m;

    p.S = calloc(2 * m * m + 1, sizeof(*p.S));
    p.T = p.S + m * m;
    if (rc == 0)
        rc = !p.S ? APC_ENOMEM : m == 0 || m > 64 ? APC_EINVAL : survey(&p, closed, cut, n, to);
    free(p.S);
    open_free(&p.open);
    return rc;
}
