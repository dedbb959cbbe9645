/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Frequencies to look at. What a loop does there changes over a ratio of frequencies, which a grid of decades
 * sees, and near the poles and zeros that lie by the circle, each in a band as narrow as its distance from
 * it: so from each of these frequencies go out at distances that double, from half of that until the grid is
 * finer.
 */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>

#include "analyze/analyze_internal.h"

#define PER_DECADE 60
#define DECADES    5
#define RESONANT   0.25 /* damping below which a pole has a band of its own */
#define SLOWEST    1e-4 /* rad in a period: what turns by less is an integrator, to rounding */
#define NARROWEST  1e-8 /* band, of its frequency */
#define CLIMBS     36   /* steps between neighbours, each to 0.618 of the one before */
#define WORTH      0.5  /* of the highest point seen: from there on a climb is worth it */

static int by_frequency(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return x < y ? -1 : x > y;
}

static int add_frequency(struct frequency_grid *grid, double w, double top)
{
    if (!(w > 0.0 && w <= top))
        return 0;
    if (grid->n == grid->room) {
        const size_t room = grid->room ? 2 * grid->room : 512;
        double *more = realloc(grid->w, room * sizeof(*more));

        if (!more)
            return APC_ENOMEM;
        grid->w = more;
        grid->room = room;
    }
    grid->w[grid->n++] = w;
    return 0;
}

/* About @p w, with a band so wide. */
static int add_frequency_band(struct frequency_grid *grid, double w, double width, double top)
{
    const double spacing = w * apc_log(10.0) / PER_DECADE;
    double by = fmax(width, NARROWEST * w) / 2.0;
    int rc = add_frequency(grid, w, top);

    while (by < spacing && rc == 0) {
        rc = add_frequency(grid, w - by, top);
        if (rc == 0)
            rc = add_frequency(grid, w + by, top);
        by *= 2.0;
    }
    return rc;
}

int frequency_grid_create(struct frequency_grid *grid, double period, double top, const double complex *root,
                          size_t n)
{
    const double turn = 2.0 * M_PI / period;
    double bottom = top * apc_pow(10.0, -DECADES);
    size_t kept = 0;
    int rc = 0;

    *grid = (struct frequency_grid){0};
    for (size_t i = 0; i < n && rc == 0; i++) {
        const double width = fabs(apc_log(apc_cabs(root[i]))), angle = fabs(apc_carg(root[i]));

        if (width > SLOWEST * 1e-4 && isfinite(width))
            bottom = fmin(bottom, 0.1 * width / period);
        if (!(width < RESONANT * angle) || angle < SLOWEST)
            continue;
        for (size_t k = 0; (double)k * turn <= top && rc == 0;
             k++) { /* where there are more ticks, aliases */
            rc = add_frequency_band(grid, (double)k * turn + angle / period, width / period, top);
            if (rc == 0)
                rc = add_frequency_band(grid, (double)(k + 1) * turn - angle / period, width / period, top);
        }
    }
    for (int k = 0; rc == 0; k++) {
        const double w = top * apc_pow(10.0, -(double)k / PER_DECADE);

        if (k > 0 && w < bottom)
            break;
        rc = add_frequency(grid, w, top);
    }
    if (rc < 0)
        return rc;
    qsort(grid->w, grid->n, sizeof(*grid->w), by_frequency);
    for (size_t i = 0; i < grid->n; i++) {
        if (kept == 0 || grid->w[i] > grid->w[kept - 1] * (1.0 + 1e-12))
            grid->w[kept++] = grid->w[i];
    }
    grid->n = kept;
    return 0;
}

void frequency_grid_free(struct frequency_grid *grid)
{
    free(grid->w);
}

int frequency_climb(frequency_function *f, void *ctx, double low, double high, double *top, double *at)
{
    double a = low + 0.381966 * (high - low), b = low + 0.618034 * (high - low), fa, fb = 0.0;
    int rc = f(ctx, a, &fa);

    if (rc == 0)
        rc = f(ctx, b, &fb);
    for (int k = 0; rc == 0; k++) {
        if (fmax(fa, fb) > *top) {
            *top = fmax(fa, fb);
            *at = fa > fb ? a : b;
        }
        if (k == CLIMBS)
            break;
        if (fa > fb) {
            high = b;
            b = a;
            fb = fa;
            a = low + 0.381966 * (high - low);
            rc = f(ctx, a, &fa);
        } else {
            low = a;
            a = b;
            fa = fb;
            b = low + 0.618034 * (high - low);
            rc = f(ctx, b, &fb);
        }
    }
    return rc;
}

int frequency_grid_top(const struct frequency_grid *grid, const double *value, frequency_function *f,
                       void *ctx, double *top, double *at)
{
    double highest = 0.0;
    int rc = 0;

    for (size_t k = 0; k < grid->n; k++) {
        if (value[k] > highest) {
            highest = *top = value[k];
            *at = grid->w[k];
        }
    }
    for (size_t k = 0; k < grid->n && rc == 0; k++) {
        const size_t before = k > 0 ? k - 1 : k, after = k + 1 < grid->n ? k + 1 : k;

        if (value[k] >= value[before] && value[k] >= value[after] && value[k] > WORTH * highest)
            rc = frequency_climb(f, ctx, grid->w[before], grid->w[after], top, at);
    }
    return rc;
}
