/* SPDX-License-Identifier: BSD-3-Clause */
/* Where the response of a loop, its ticks of a period taken together, is critical: 1 in size, or real. */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>

#include "analyze/analyze_internal.h"

/* The eigenvalues of the response of all ticks of a period, taken together. */
struct roots {
    struct open open;
    double complex *root; /* [m] the largest first */
    size_t place;         /* of the one that is looked at */
    bool lowest;          /* its least size, and not the greatest */
};

static int by_crossing_size(const void *a, const void *b)
{
    const double x = apc_cabs(*(const double complex *)a), y = apc_cabs(*(const double complex *)b);

    return x > y ? -1 : x < y;
}

static int roots_at(struct roots *r, double w)
{
    struct open *o = &r->open;
    int rc = loop_frequency_response(o, w);

    if (rc == 0)
        rc = eigenvalues(o->m, o->L, r->root);
    if (rc == 0)
        qsort(r->root, o->m, sizeof(*r->root), by_crossing_size);
    return rc;
}

/* Its size or, where the lowest is sought, one over that. */
static int size_at(void *ctx, double w, double *value)
{
    struct roots *r = ctx;
    const int rc = roots_at(r, w);
    const double size = rc == 0 ? apc_cabs(r->root[r->place]) : r->lowest ? HUGE_VAL : 0.0;

    *value = r->lowest ? 1.0 / size : size;
    return rc == APC_ESOLVER ? 0 : rc;
}

static int roots_create(struct roots *r, const struct apc_loop *loop, size_t of, const double *later)
{
    int rc;

    *r = (struct roots){0};
    rc = open_create(&r->open, loop, of, later);
    if (rc == 0 && !(r->root = calloc(r->open.m + 1, sizeof(*r->root))))
        rc = APC_ENOMEM;
    return rc;
}

static void roots_free(struct roots *r)
{
    free(r->root);
    open_free(&r->open);
}

static int keep_crossing(struct crossings *c, double w, size_t place, double complex root)
{
    const double phase = apc_carg(-root);

    if (c->n == c->room) {
        const size_t room = c->room ? 2 * c->room : 32;
        struct crossing *more = realloc(c->at, room * sizeof(*more));

        if (!more)
            return APC_ENOMEM;
        c->at = more;
        c->room = room;
    }
    c->at[c->n++] = (struct crossing){w, phase > 0.0 ? phase : phase + 2.0 * M_PI, place};
    return 0;
}

static int keep_gain(struct crossings *c, double complex root)
{
    if (!(creal(root) < 0.0))
        return 0;
    if (c->n_gain == c->room_gain) {
        const size_t room = c->room_gain ? 2 * c->room_gain : 32;
        double *more = realloc(c->gain, room * sizeof(*more));

        if (!more)
            return APC_ENOMEM;
        c->gain = more;
        c->room_gain = room;
    }
    c->gain[c->n_gain++] = -1.0 / creal(root);
    return 0;
}

/* Where the root of place @p i is 1 in size, between two frequencies. */
static int cross_between(struct roots *r, size_t i, double low, double high, bool above, struct crossings *to)
{
    double middle = low;
    int rc = 0;

    for (int k = 0; k < 60 && rc == 0 && high - low > 1e-14 * low; k++) {
        middle = (low + high) / 2.0;
        rc = roots_at(r, middle);
        if (rc == 0)
            *((apc_cabs(r->root[i]) >= 1.0) == above ? &low : &high) = middle;
    }
    if (rc == APC_ESOLVER)
        return 0; /* a pole: no crossing but a jump */
    return rc < 0 ? rc : keep_crossing(to, middle, i, r->root[i]);
}

/* And where it is real, and negative. */
static int turn_between(struct roots *r, size_t i, double low, double high, double complex at_low,
                        struct crossings *to)
{
    int rc = 0;

    for (int k = 0; k < 50 && rc == 0 && high - low > 1e-12 * low; k++) {
        const double middle = (low + high) / 2.0;

        rc = roots_at(r, middle);
        if (rc == 0)
            *((cimag(r->root[i]) > 0.0) == (cimag(at_low) > 0.0) ? &low : &high) = middle;
    }
    return rc == APC_ESOLVER ? 0 : rc < 0 ? rc : keep_gain(to, r->root[i]);
}

/* A size that stands out by the middle of three frequencies without reaching 1: does it, in between? */
static int touch_between(struct roots *r, size_t i, const double *w, const double *size, struct crossings *to)
{
    double top, at = w[1];
    int rc;

    r->place = i;
    r->lowest = size[1] >= 1.0;
    top = r->lowest ? 1.0 / size[1] : size[1];
    rc = frequency_climb(size_at, r, w[0], w[2], &top, &at);
    if (rc < 0 || top < 1.0 || at == w[1])
        return rc;
    rc = cross_between(r, i, w[0], at, r->lowest, to);
    return rc < 0 ? rc : cross_between(r, i, at, w[2], !r->lowest, to);
}

static int touches(struct roots *r, const struct frequency_grid *grid, const double *size, size_t k,
                   struct crossings *to)
{
    const size_t m = r->open.m;
    int rc = 0;

    for (size_t i = 0; i < m && rc == 0; i++) {
        const double of[] = {size[(k - 2) * m + i], size[(k - 1) * m + i], size[k * m + i]};

        if (stands_out(of))
            rc = touch_between(r, i, grid->w + k - 2, of, to);
    }
    return rc;
}

/* Between the frequencies before @p k and @p k. */
static int crossings_at(struct roots *r, const struct frequency_grid *grid, const double *size,
                        const double complex *root, size_t k, struct crossings *to)
{
    const size_t m = r->open.m;
    int rc = 0;

    for (size_t i = 0; i < m && rc == 0; i++) {
        const double before = size[(k - 1) * m + i], now = size[k * m + i];
        const double complex was = root[(k - 1) * m + i], is = root[k * m + i];

        if (isnan(before) || isnan(now))
            continue;
        if ((before >= 1.0) != (now >= 1.0))
            rc = cross_between(r, i, grid->w[k - 1], grid->w[k], before >= 1.0, to);
        if (rc == 0 && (cimag(was) > 0.0) != (cimag(is) > 0.0) && (creal(was) < 0.0 || creal(is) < 0.0))
            rc = turn_between(r, i, grid->w[k - 1], grid->w[k], was, to);
    }
    return rc < 0 || k < 2 ? rc : touches(r, grid, size, k, to);
}

static int find_crossings(struct roots *r, const struct frequency_grid *grid, struct crossings *to)
{
    const size_t m = r->open.m;
    double complex *root = calloc(grid->n * m + 1, sizeof(*root));
    double *size = calloc(grid->n * m + 1, sizeof(*size));
    int rc = root && size ? 0 : APC_ENOMEM;

    for (size_t k = 0; k < grid->n && rc == 0; k++) {
        rc = roots_at(r, grid->w[k]);
        for (size_t i = 0; i < m; i++) {
            root[k * m + i] = rc == 0 ? r->root[i] : 0.0;
            size[k * m + i] = rc == 0 ? apc_cabs(r->root[i]) : (double)NAN;
        }
        rc = rc == APC_ESOLVER ? 0 : rc;
    }
    for (size_t k = 1; k < grid->n && rc == 0; k++)
        rc = crossings_at(r, grid, size, root, k, to);
    for (size_t i = 0; i < m && grid->n > 0 && rc == 0; i++) /* all are real at the end, to rounding */
        rc = keep_gain(to, root[(grid->n - 1) * m + i]);
    for (size_t i = 0; i < m && grid->n > 0 && rc == 0; i++) /* and at 0 */
        rc = keep_gain(to, root[i]);
    free(size);
    free(root);
    return rc;
}

int response_crossings(const struct apc_loop *loop, size_t of, const double complex *root, size_t n,
                       struct crossings *to)
{
    const double period = apc_ns_to_s(loop->setup.period);
    double *now = calloc(loop->n_out, sizeof(*now));
    struct frequency_grid grid = {0};
    struct roots r = {0};
    int rc = now ? 0 : APC_ENOMEM;

    *to = (struct crossings){0};
    if (rc == 0)
        rc = roots_create(&r, loop, of, now);
    if (rc == 0)
        rc = frequency_grid_create(&grid, period, M_PI / period, root, n);
    if (rc == 0)
        rc = find_crossings(&r, &grid, to);
    frequency_grid_free(&grid);
    roots_free(&r);
    free(now);
    return rc;
}

void crossings_free(struct crossings *c)
{
    free(c->at);
    free(c->gain);
}

/* By secants of the logarithm of its size. */
int response_follow(const struct apc_loop *loop, size_t of, const double *later, struct crossing *crossing)
{
    const double top = M_PI / apc_ns_to_s(loop->setup.period);
    struct roots r = {0};
    int rc = roots_create(&r, loop, of, later);
    double w = crossing->w, step = 1e-6 * w, before = 0.0, w_before = 0.0, most = 0.1 * w;

    for (int k = 0; k < 40 && rc == 0; k++) {
        double here;

        rc = roots_at(&r, w);
        if (rc < 0)
            break;
        here = apc_log(apc_cabs(r.root[crossing->place]));
        if (fabs(here) < 1e-13 || fabs(step) < 1e-14 * w) {
            const double phase = apc_carg(-r.root[crossing->place]);

            *crossing = (struct crossing){w, phase > 0.0 ? phase : phase + 2.0 * M_PI, crossing->place};
            break;
        }
        step = k == 0 ? step : -here * (w - w_before) / (here - before);
        if (!isfinite(step) || !(fabs(w + step - crossing->w) < most) || !(w + step < top) || k == 39)
            rc = APC_ERANGE;
        w_before = w;
        before = here;
        w += step;
    }
    roots_free(&r);
    return rc == APC_ESOLVER ? APC_ERANGE : rc;
}
