/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Margins are where an eigenvalue of the map leaves the unit circle while outputs are multiplied by a factor
 * (its size: gain; its angle: phase) or act later: that holds for any pattern of ticks, where a frequency
 * response does not.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "base/base_internal.h"

#define ON_CIRCLE 1e-10  /* so near to it counts as unstable */
#define MOST      1000.0 /* factors */
#define RATIO     1.08   /* of two factors tried one after the other */
#define PRECISION 1e-7

/* ---- The map --------------------------------------------------------------------------------- */

static int radius(struct machine *m, const double complex *factor, double *largest, double complex *value)
{
    const size_t n = m->n;
    double *Z = calloc(2 * n * n, sizeof(*Z));
    double complex *A = calloc(n * (n + 1), sizeof(*A)), *own = A ? A + n * n : NULL;
    struct ride ride = {.Z = Z, .width = 2 * n, .factor = factor};
    int rc = Z && A ? 0 : APC_ENOMEM;

    for (size_t i = 0; i < n && rc == 0; i++)
        Z[i * 2 * n + i] = 1.0;
    if (rc == 0)
        rc = machine_ride(m, &ride);
    for (size_t i = 0; i < n && rc == 0; i++) {
        for (size_t j = 0; j < n; j++)
            A[i * n + j] = complex_of(Z[i * 2 * n + j], Z[i * 2 * n + n + j]);
    }
    if (rc == 0)
        rc = eigenvalues(n, A, value ? value : own);
    *largest = 0.0;
    for (size_t i = 0; i < n && rc == 0; i++)
        *largest = fmax(*largest, cabs((value ? value : own)[i]));
    free(Z);
    free(A);
    return rc;
}

static int by_size(const void *a, const void *b)
{
    const double x = cabs(*(const double complex *)a), y = cabs(*(const double complex *)b);

    return x > y ? -1 : x < y;
}

size_t apc_loop_states(const struct apc_loop *loop)
{
    const struct course course = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    struct machine m;
    const int rc = machine_create(&m, loop, &course, NULL);

    machine_free(&m);
    return rc < 0 ? 0 : m.n;
}

int apc_loop_poles(const struct apc_loop *loop, double *re, double *im)
{
    const struct course course = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    double complex *value = NULL;
    struct machine m;
    double largest;
    int rc = machine_create(&m, loop, &course, NULL);

    if (rc == 0 && !(value = calloc(m.n, sizeof(*value))))
        rc = APC_ENOMEM;
    if (rc == 0)
        rc = radius(&m, NULL, &largest, value);
    if (rc == 0)
        qsort(value, m.n, sizeof(*value), by_size);
    for (size_t i = 0; i < m.n && rc == 0; i++) {
        re[i] = creal(value[i]);
        im[i] = cimag(value[i]);
    }
    free(value);
    machine_free(&m);
    return rc;
}

/* ---- Changes that it bears ------------------------------------------------------------------- */

struct trial {
    const struct apc_loop *loop;
    struct machine *nominal;
    double complex *factor; /* [n_out] */
    double *delay;          /* [n_out] */
    size_t of;
    enum { BY_FACTOR, BY_ANGLE, BY_DELAY } by;
    int rc;
};

static bool concerned(const struct trial *t, size_t o)
{
    return t->of == APC_LOOP_WHOLE ? t->loop->to[o] != APC_LOOP_NOWHERE : t->of == o;
}

/* Is the loop stable where what is tried is @p value? */
static bool holds(struct trial *t, double value)
{
    const struct apc_loop_setup *s = &t->loop->setup;
    const struct course course = {.period = s->period, .n = s->n_ticks, .tick = s->tick, .delay = t->delay};
    struct machine delayed, *m = t->nominal;
    double largest = HUGE_VAL;

    if (t->rc < 0)
        return false;
    for (size_t o = 0; o < t->loop->n_out; o++) {
        t->factor[o] = !concerned(t, o)     ? 1.0
                       : t->by == BY_FACTOR ? value
                       : t->by == BY_ANGLE  ? complex_of(cos(value), -sin(value))
                                            : 1.0;
        t->delay[o] = t->by == BY_DELAY && concerned(t, o) ? value : 0.0;
    }
    if (t->by == BY_DELAY) {
        t->rc = machine_create(&delayed, t->loop, &course, NULL);
        m = &delayed;
    }
    if (t->rc == 0)
        t->rc = radius(m, t->factor, &largest, NULL);
    if (t->by == BY_DELAY)
        machine_free(&delayed);
    return t->rc == 0 && largest < 1.0 - ON_CIRCLE;
}

/* Between @p good and @p bad. */
static double border(struct trial *t, double good, double bad)
{
    while (fabs(bad - good) > PRECISION * fmax(fabs(good), fabs(bad)) && t->rc == 0) {
        const double middle = (good + bad) / 2.0;

        *(holds(t, middle) ? &good : &bad) = middle;
    }
    return good;
}

static double gain_margin(struct trial *t, bool up)
{
    double good = 1.0;

    t->by = BY_FACTOR;
    for (int k = 1; pow(RATIO, k) < MOST && t->rc == 0; k++) {
        const double next = pow(RATIO, up ? k : -k);

        if (!holds(t, next))
            return border(t, good, next);
        good = next;
    }
    return up ? HUGE_VAL : 0.0;
}

static double phase_margin(struct trial *t)
{
    const double step = 4.0 * M_PI / 180.0;
    double good = 0.0;

    t->by = BY_ANGLE;
    for (int k = 1; k <= 45 && t->rc == 0; k++) {
        if (!holds(t, k * step))
            return border(t, good, k * step) * 180.0 / M_PI;
        good = k * step;
    }
    return HUGE_VAL;
}

/* From here on a delay is looked for in the frequency response: in the map each period of it is a state more.
 */
#define LONG  8.0 /* periods */
#define TRIES 30

/* A delay of whole periods turns the response and does nothing else; so what is left is a part of one, which
 * hardly counts beside them: from one to the next the answer settles at once. The loop bears a period. */
static double long_delay_margin(struct trial *t)
{
    const double period = apc_ns_to_s(t->loop->setup.period);
    double found = 0.0, before = -1.0, more = 0.0;

    for (int k = 0; k < TRIES && fabs(found - before) > PRECISION * found; k++) {
        const double part = fmod(found, period);

        for (size_t o = 0; o < t->loop->n_out; o++)
            t->delay[o] = concerned(t, o) ? part : 0.0;
        t->rc = response_delay(t->loop, t->of, t->delay, &more);
        if (t->rc < 0 || more == HUGE_VAL)
            return HUGE_VAL;
        before = found;
        found = part + more;
    }
    return found;
}

/* @p first: what the frequency response says, where the looking begins: well below it, with short steps. Of
 * outputs that act several times in a period it does not say all: HUGE_VAL is no answer. */
static double delay_margin(struct trial *t, double first)
{
    const double period = apc_ns_to_s(t->loop->setup.period), most = LONG * period;
    double good = 0.0, next = fmin(first, period) / 4.0;

    t->by = BY_DELAY;
    while (next <= most && t->rc == 0) {
        if (!holds(t, next))
            return border(t, good, next);
        good = next;
        next *= 1.1;
    }
    return t->rc == 0 ? long_delay_margin(t) : HUGE_VAL;
}

/* ---- All of it ------------------------------------------------------------------------------- */

static int measure(struct trial *t, const double *scale, bool peaks_only, struct apc_loop_margins *to)
{
    double first = HUGE_VAL;
    int rc;

    to->stable = holds(t, 0.0);
    if (t->rc < 0 || !to->stable)
        return t->rc;
    to->gain = to->gain_least = to->phase = to->delay = to->jitter = (double)NAN;
    rc = response_peaks(t->loop, t->of, scale, to, &first);
    if (rc < 0 || peaks_only)
        return rc;
    to->gain = gain_margin(t, true);
    to->gain_least = gain_margin(t, false);
    to->phase = phase_margin(t);
    if (t->of == APC_LOOP_WHOLE || t->loop->to[t->of] != APC_LOOP_NOWHERE)
        to->delay = delay_margin(t, first);
    if (t->rc == 0 && t->of != APC_LOOP_WHOLE)
        t->rc = jitter_margin(t->loop, t->of, &to->jitter);
    return t->rc;
}

static int find(const struct apc_loop *loop, size_t of, const double *scale, bool peaks_only,
                struct apc_loop_margins *margins, struct apc_error *why)
{
    const struct course course = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    struct apc_loop_margins m = {.size = sizeof(m)};
    struct machine nominal;
    struct trial t = {.loop = loop, .nominal = &nominal, .of = of, .by = BY_DELAY};
    int rc;

    if (of != APC_LOOP_WHOLE && of >= loop->n_out)
        return apc_fail(why, APC_EINVAL, "margins: output %zu of %zu", of + 1, loop->n_out);
    rc = machine_create(&nominal, loop, &course, why);
    t.factor = calloc(loop->n_out, sizeof(*t.factor));
    t.delay = calloc(loop->n_out, sizeof(*t.delay));
    if (rc == 0)
        rc = t.factor && t.delay ? measure(&t, scale, peaks_only, &m) : APC_ENOMEM;
    if (rc < 0)
        rc = apc_fail(why, rc, "margins: %s", apc_err_text(rc));
    else
        apc_result_copy(margins, &m, sizeof(m));
    free(t.factor);
    free(t.delay);
    machine_free(&nominal);
    return rc;
}

int apc_loop_margins(const struct apc_loop *loop, size_t of, const double *scale,
                     struct apc_loop_margins *margins, struct apc_error *why)
{
    return find(loop, of, scale, false, margins, why);
}

int apc_loop_peaks(const struct apc_loop *loop, size_t of, const double *scale,
                   struct apc_loop_margins *margins, struct apc_error *why)
{
    return find(loop, of, scale, true, margins, why);
}
