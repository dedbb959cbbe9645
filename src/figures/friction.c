/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Does an actuator stick? Whether the record of output and measurement is explained better by a linear plant
 * behind friction than by a linear plant alone, whatever the controller and the disturbances do: the idea of
 * Jelali (Control Eng. Practice 16, 2008), with the friction of He, Wang, Pottmann and Qin (2007) and a search
 * over all its sizes.
 */
#include "figures_internal.h"

#include <math.h>
#include <stdlib.h>

#include "apcmath.h"
#include "base/parts.h"

enum { OLD = 6, LAGS = 24, UNKNOWNS = OLD + LAGS, SIZES = 18, JUMPS = 4, TOGETHER = 8 };

void lagged_products(const double *a, const double *b, size_t n, size_t m, double *to)
{
    for (size_t k = 0; k <= m; k += TOGETHER) {
        const size_t lags = m + 1 - k < TOGETHER ? m + 1 - k : TOGETHER, all = k + TOGETHER - 1;
        double sum[TOGETHER] = {0};
        for (size_t j = 0; j < lags; j++)
            for (size_t t = k + j; t < all && t < n; t++)
                sum[j] += a[t] * b[t - k - j];
        for (size_t t = all; t < n; t++)
            for (size_t j = 0; j < TOGETHER; j++)
                sum[j] += a[t] * b[t - k - j];
        for (size_t j = 0; j < lags; j++)
            to[k + j] = sum[j] / (double)n;
    }
}

/* Mean 0 and variance 1. Returns what the deviations were divided by; 0: it never changes. */
static double standardize(const double *from, size_t n, double *to)
{
    double mean = 0, sum = 0;
    for (size_t i = 0; i < n; i++)
        mean += from[i] / (double)n;
    for (size_t i = 0; i < n; i++)
        sum += (from[i] - mean) * (from[i] - mean);
    const double sd = sqrt(sum / (double)n);
    for (size_t i = 0; i < n; i++)
        to[i] = sd > 0 ? (from[i] - mean) / sd : 0;
    return sd;
}

/* Where an actuator stands that sticks within @size + @jump, and slips by @jump. */
static void stick(const double *command, size_t n, double size, double jump, double *position)
{
    double at = command[0];
    for (size_t i = 0; i < n; i++) {
        if (fabs(command[i] - at) > (size + jump) / 2)
            at = command[i] > at ? command[i] - (size - jump) / 2 : command[i] + (size - jump) / 2;
        position[i] = at;
    }
}

struct fit {
    size_t n;
    double *y, *u, *position, *input; /* [n] of mean 0 and variance 1, but position */
    double own[UNKNOWNS + 1];         /* lagged_products() of y with itself */
};

/* b' A^-1 b of a symmetric A, by Cholesky's factors, which replace it; NAN: it is not positive definite. */
static double explained_by(double *A, const double *b)
{
    double x[UNKNOWNS], sum = 0;
    for (size_t i = 0; i < UNKNOWNS; i++) {
        x[i] = b[i];
        for (size_t j = 0; j <= i; j++) {
            double *const to = &A[i * UNKNOWNS + j];
            for (size_t k = 0; k < j; k++)
                *to -= A[i * UNKNOWNS + k] * A[j * UNKNOWNS + k];
            *to = i == j ? sqrt(*to) : *to / A[j * UNKNOWNS + j];
        }
        for (size_t k = 0; k < i; k++)
            x[i] -= A[i * UNKNOWNS + k] * x[k];
        x[i] /= A[i * UNKNOWNS + i];
        sum += x[i] * x[i];
    }
    return sum;
}

/* The variance that y(t) = sum a y(t - i) + sum b v(t - j) + e leaves, of 1; 1 where v never changes. */
static double unexplained(const struct fit *f, const double *v)
{
    double ahead[UNKNOWNS + 1], behind[UNKNOWNS + 1], self[UNKNOWNS + 1];
    double A[UNKNOWNS * UNKNOWNS], b[UNKNOWNS];
    lagged_products(f->y, v, f->n, LAGS, behind); /* y(t) v(t - k) */
    lagged_products(v, f->y, f->n, OLD, ahead);   /* y(t - k) v(t) */
    lagged_products(v, v, f->n, LAGS, self);
    for (size_t i = 0; i < UNKNOWNS; i++) {
        for (size_t j = 0; j < UNKNOWNS; j++) {
            const size_t low = i < j ? i : j, high = i < j ? j : i;
            double *const to = &A[i * UNKNOWNS + j];
            if (high < OLD)
                *to = f->own[high - low];
            else if (low >= OLD)
                *to = self[high - low];
            else /* y(t - 1 - low) v(t - 1 - (high - OLD)) */
                *to = high - OLD >= low ? behind[high - OLD - low] : ahead[low - (high - OLD)];
        }
        A[i * UNKNOWNS + i] *= 1 + 1e-8;
        b[i] = i < OLD ? f->own[i + 1] : behind[i - OLD + 1];
    }
    const double explained = explained_by(A, b);
    return isnan(explained) ? 1 : f->own[0] - explained;
}

static double span(const double *v, size_t n)
{
    double low = v[0], high = v[0];
    for (size_t i = 1; i < n; i++) {
        low = fmin(low, v[i]);
        high = fmax(high, v[i]);
    }
    return high - low;
}

static void try_frictions(struct friction *f, struct fit *fit, double unit)
{
    static const double jumps[JUMPS] = {0, 0.3, 0.6, 1.0};
    const double most = 1.1 * span(fit->u, fit->n), linear = unexplained(fit, fit->u);
    double best = linear, size = most;
    for (int i = 0; i < SIZES; i++) {
        for (int k = 0; k < JUMPS; k++) {
            stick(fit->u, fit->n, size, jumps[k] * size, fit->position);
            if (!(standardize(fit->position, fit->n, fit->input) > 1e-3))
                continue;
            const double left = unexplained(fit, fit->input);
            if (left > 0 && left < best) {
                best = left;
                f->size = size * unit;
            }
        }
        size /= 1.3;
    }
    if (linear > 0 && best < linear) {
        f->share = 1 - best / linear;
        f->evidence = (double)fit->n / 2 * apc_log(linear / best);
    }
}

int friction_find(struct friction *f, const double *u, const double *y, size_t n)
{
    struct fit fit = {.n = n};
    const struct apc_part parts[] = {APC_PART(fit.y, n), APC_PART(fit.u, n), APC_PART(fit.position, n),
                                     APC_PART(fit.input, n)};
    void *const memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    *f = (struct friction){0};
    if (!memory)
        return APC_ENOMEM;
    const double unit = standardize(u, n, fit.u);
    if (standardize(y, n, fit.y) > 0 && unit > 0 && n > (size_t)4 * UNKNOWNS) {
        lagged_products(fit.y, fit.y, n, OLD, fit.own);
        try_frictions(f, &fit, unit);
    }
    free(memory);
    return 0;
}
