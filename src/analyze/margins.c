/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Margins are where an eigenvalue of the map leaves the unit circle while outputs are multiplied by a factor
 * (its size: gain; its angle: phase) or act later: that holds for any pattern of ticks, where a frequency
 * response does not.
 */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "base/base_internal.h"

#define ON_CIRCLE 1e-10  /* so near to it counts as unstable */
#define MOST      1000.0 /* factors */
#define RATIO     1.08   /* of two factors tried one after the other */
#define PRECISION 1e-7
#define ANGLES    45 /* of a half turn, tried one after the other */

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
            A[i * n + j] = apc_complex(Z[i * 2 * n + j], Z[i * 2 * n + n + j]);
    }
    if (rc == 0)
        rc = eigenvalues(n, A, value ? value : own);
    *largest = 0.0;
    for (size_t i = 0; i < n && rc == 0; i++)
        *largest = fmax(*largest, apc_cabs((value ? value : own)[i]));
    free(Z);
    free(A);
    return rc;
}

static int by_margin_size(const void *a, const void *b)
{
    const double x = apc_cabs(*(const double complex *)a), y = apc_cabs(*(const double complex *)b);

    return x > y ? -1 : x < y;
}

size_t apc_loop_states(const struct apc_loop *loop)
{
    const struct schedule schedule = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    struct machine m;
    const int rc = machine_create(&m, loop, &schedule, NULL);

    machine_free(&m);
    return rc < 0 ? 0 : m.n;
}

int apc_loop_poles(const struct apc_loop *loop, double *re, double *im)
{
    const struct schedule schedule = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    double complex *value = NULL;
    struct machine m;
    double largest;
    int rc = machine_create(&m, loop, &schedule, NULL);

    if (rc == 0 && !(value = calloc(m.n, sizeof(*value))))
        rc = APC_ENOMEM;
    if (rc == 0)
        rc = radius(&m, NULL, &largest, value);
    if (rc == 0)
        qsort(value, m.n, sizeof(*value), by_margin_size);
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
    double largest; /* pole, of the loop as it is */
    int rc;
};

static bool concerned(const struct trial *t, size_t o)
{
    return t->of == APC_LOOP_WHOLE ? t->loop->to[o] != APC_LOOP_NOWHERE : t->of == o;
}

/* Is the loop stable where what is tried is @p value? */
static bool is_stable_at(struct trial *t, double value)
{
    const struct apc_loop_setup *s = &t->loop->setup;
    const struct schedule schedule = {
        .period = s->period, .n = s->n_ticks, .tick = s->tick, .delay = t->delay};
    struct machine delayed, *m = t->nominal;
    double largest = HUGE_VAL;

    if (t->rc < 0)
        return false;
    for (size_t o = 0; o < t->loop->n_out; o++) {
        t->factor[o] = !concerned(t, o)     ? 1.0
                       : t->by == BY_FACTOR ? value
                       : t->by == BY_ANGLE  ? apc_complex(apc_cos(value), -apc_sin(value))
                                            : 1.0;
        t->delay[o] = t->by == BY_DELAY && concerned(t, o) ? value : 0.0;
    }
    if (t->by == BY_DELAY) {
        t->rc = machine_create(&delayed, t->loop, &schedule, NULL);
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

        *(is_stable_at(t, middle) ? &good : &bad) = middle;
    }
    return good;
}

static int by_margin_frequency(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return x < y ? -1 : x > y;
}

/* Values to try, away from one that holds. */
struct tries {
    double *at;
    size_t n;
};

/*
 * @p steps [n_steps] and, between each two of @p critical [n], where the response says that stability is lost
 * or comes back, one: however narrow a window is, it is not stepped over.
 */
static int tries_create(struct tries *tries, const double *steps, size_t n_steps, double *critical, size_t n)
{
    tries->at = calloc(n_steps + n + 1, sizeof(*tries->at));
    tries->n = 0;
    if (!tries->at)
        return APC_ENOMEM;
    for (size_t k = 0; k < n_steps; k++)
        tries->at[tries->n++] = steps[k];
    if (n > 0)
        qsort(critical, n, sizeof(*critical), by_margin_frequency);
    for (size_t k = 1; k < n; k++)
        tries->at[tries->n++] = (critical[k - 1] + critical[k]) / 2.0;
    qsort(tries->at, tries->n, sizeof(*tries->at), by_margin_frequency);
    return 0;
}

/* The last value that holds, from @p good on, up or down; @p none where all that are tried do. */
static double first_border(struct trial *t, const struct tries *tries, double good, bool up, double none)
{
    const double begin = good;

    for (size_t k = 0; k < tries->n && t->rc == 0; k++) {
        const double next = tries->at[up ? k : tries->n - 1 - k];

        if (up ? next <= begin : next >= begin)
            continue;
        if (!is_stable_at(t, next))
            return border(t, good, next);
        good = next;
    }
    return none;
}

static void gain_margins(struct trial *t, struct crossings *found, struct apc_loop_margins *to)
{
    enum { STEPS = 90 }; /* RATIO^90 is MOST */
    double steps[2 * STEPS];
    struct tries tries;
    size_t n = 0, kept = 0;

    for (int k = 1; k < STEPS && apc_pow(RATIO, k) < MOST; k++) {
        steps[n++] = apc_pow(RATIO, k);
        steps[n++] = apc_pow(RATIO, -k);
    }
    for (size_t k = 0; k < found->n_gain; k++) {
        if (found->gain[k] > 1.0 / MOST && found->gain[k] < MOST)
            found->gain[kept++] = found->gain[k];
    }
    t->rc = tries_create(&tries, steps, n, found->gain, kept);
    t->by = BY_FACTOR;
    if (t->rc == 0) {
        to->gain = first_border(t, &tries, 1.0, true, HUGE_VAL);
        to->gain_low = first_border(t, &tries, 1.0, false, 0.0);
    }
    free(tries.at);
}

/* What lags by so much at w lags as much less at -w: the border is that of lag or lead, whichever is nearer. */
static double phase_margin(struct trial *t, const struct crossings *found)
{
    double steps[ANGLES], *critical = calloc(found->n + 1, sizeof(*critical)), phase = HUGE_VAL;
    struct tries tries = {0};

    for (int k = 0; k < ANGLES; k++)
        steps[k] = (k + 1) * M_PI / ANGLES;
    for (size_t k = 0; k < found->n && critical; k++)
        critical[k] = fmin(found->at[k].phase, 2.0 * M_PI - found->at[k].phase);
    t->rc = critical ? tries_create(&tries, steps, ANGLES, critical, found->n) : APC_ENOMEM;
    t->by = BY_ANGLE;
    if (t->rc == 0)
        phase = first_border(t, &tries, 0.0, true, HUGE_VAL);
    free(tries.at);
    free(critical);
    return phase * 180.0 / M_PI;
}

/* Up to here a delay is looked for in the map, in which each period of it is a state more. */
#define LONG   8.0 /* periods */
#define ROUNDS 30

/*
 * A delay of whole periods turns the response and does nothing else; so what is left is a part of one, which
 * hardly counts beside them: from one to the next the answer settles at once. @p delay is about where the
 * crossing is critical; returns where it is.
 */
static double follow_delay(struct trial *t, struct crossing crossing, double delay)
{
    const double period = apc_ns_to_s(t->loop->setup.period);
    double before = -1.0;

    for (int k = 0; k < ROUNDS && fabs(delay - before) > PRECISION * delay; k++) {
        const double part = fmod(delay, period);
        int rc;

        for (size_t o = 0; o < t->loop->n_out; o++)
            t->delay[o] = concerned(t, o) ? part : 0.0;
        rc = response_follow(t->loop, t->of, t->delay, &crossing);
        if (rc == APC_ERANGE)
            break;
        if (rc < 0) {
            t->rc = rc;
            break;
        }
        before = delay;
        delay = part + crossing.phase / crossing.w;
        delay += round((before - delay) * crossing.w / (2.0 * M_PI)) * 2.0 * M_PI / crossing.w;
    }
    return delay;
}

/* Of all crossings the delays that are critical, up to so many periods. */
static int critical_delays(struct trial *t, const struct crossings *found, double **list, size_t *n)
{
    const double most = (LONG + 1.0) * apc_ns_to_s(t->loop->setup.period);
    size_t room = 1;

    for (size_t k = 0; k < found->n; k++)
        room += (size_t)(most * found->at[k].w / (2.0 * M_PI)) + 2;
    *n = 0;
    *list = calloc(room, sizeof(**list));
    if (!*list)
        return APC_ENOMEM;
    for (size_t k = 0; k < found->n && t->rc == 0; k++) {
        const struct crossing *c = &found->at[k];
        double delay = c->phase / c->w;

        while (delay <= most && t->rc == 0) {
            (*list)[(*n)++] = follow_delay(t, *c, delay);
            delay += 2.0 * M_PI / c->w;
        }
    }
    return t->rc;
}

/* The loop bears so many periods: which crossing is critical first? */
static double long_delay_margin(struct trial *t, const struct crossings *found)
{
    const double period = apc_ns_to_s(t->loop->setup.period), least = LONG * period;
    double first = HUGE_VAL, delay = HUGE_VAL;

    /* what is left beside whole periods moves each by less than one */
    for (int round = 0; round < 2; round++) {
        for (size_t k = 0; k < found->n && t->rc == 0; k++) {
            const struct crossing *c = &found->at[k];
            double next = c->phase / c->w;

            if (next < least - period)
                next += ceil((least - period - next) * c->w / (2.0 * M_PI)) * 2.0 * M_PI / c->w;
            if (round == 0)
                first = fmin(first, next);
            while (round == 1 && next <= first + period) {
                const double exact = follow_delay(t, *c, next);

                if (exact >= least * (1.0 - PRECISION))
                    delay = fmin(delay, exact);
                next += 2.0 * M_PI / c->w;
            }
        }
    }
    return delay;
}

/* Of outputs that act several times in a period the response of whole periods says all but what parts of one
 * do; so short steps go as well, up to long delays. */
static double delay_margin(struct trial *t, const struct crossings *found)
{
    enum { STEPS = 100 };
    const double period = apc_ns_to_s(t->loop->setup.period), most = LONG * period;
    double steps[STEPS], *critical = NULL, first = period, delay = HUGE_VAL;
    struct tries tries = {0};
    size_t n = 0, n_critical = 0;

    t->by = BY_DELAY;
    t->rc = critical_delays(t, found, &critical, &n_critical);
    for (size_t k = 0; k < n_critical; k++)
        first = fmin(first, critical[k]);
    first = fmax(first, period / 64.0) / 4.0;
    while (n + 1 < STEPS && first * apc_pow(1.1, (double)n) < most) {
        steps[n] = first * apc_pow(1.1, (double)n);
        n++;
    }
    steps[n++] = most;
    if (t->rc == 0)
        t->rc = tries_create(&tries, steps, n, critical, n_critical);
    if (t->rc == 0)
        delay = first_border(t, &tries, 0.0, true, HUGE_VAL);
    if (t->rc == 0 && delay == HUGE_VAL)
        delay = long_delay_margin(t, found);
    free(tries.at);
    free(critical);
    return delay;
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* Poles of the loop closed and cut open and, where all is asked for, the zeros, which its poles go to as the
 * gain grows. @p root [3 * n of the map]. */
static int find_roots(struct trial *t, bool zeros, double complex *root, size_t *n)
{
    static const double gain[] = {1.0, 0.0, 1e6};
    const size_t kinds = zeros ? 3 : 2;
    double largest;
    int rc = 0;

    *n = 0;
    for (size_t k = 0; k < kinds && rc == 0; k++) {
        for (size_t o = 0; o < t->loop->n_out; o++)
            t->factor[o] = concerned(t, o) ? gain[k] : 1.0;
        rc = radius(t->nominal, t->factor, &largest, root + *n);
        *n += t->nominal->n;
        if (k == 0)
            t->largest = largest;
    }
    return rc;
}

static int measure_margins(struct trial *t, const double *scale, bool peaks_only, struct apc_loop_margins *to)
{
    const bool reaches = t->of == APC_LOOP_WHOLE || t->loop->to[t->of] != APC_LOOP_NOWHERE;
    double complex *root = calloc(3 * t->nominal->n + 1, sizeof(*root));
    struct crossings found = {0};
    size_t n = 0;

    t->rc = root ? find_roots(t, !peaks_only, root, &n) : APC_ENOMEM;
    to->stable = t->rc == 0 && t->largest < 1.0 - ON_CIRCLE;
    if (t->rc < 0 || !to->stable)
        goto out;
    to->gain = to->gain_low = to->phase = to->delay = to->jitter = (double)NAN;
    t->rc = response_peaks(t->loop, t->of, scale, root, root + t->nominal->n, t->nominal->n, to);
    if (t->rc < 0 || peaks_only)
        goto out;
    t->rc = response_crossings(t->loop, t->of, root + t->nominal->n, n - t->nominal->n, &found);
    if (t->rc == 0)
        gain_margins(t, &found, to);
    if (t->rc == 0)
        to->phase = phase_margin(t, &found);
    if (t->rc == 0 && reaches)
        to->delay = delay_margin(t, &found);
    if (t->rc == 0 && t->of != APC_LOOP_WHOLE)
        t->rc = jitter_margin(t->loop, t->of, root, t->nominal->n, &to->jitter);
out:
    crossings_free(&found);
    free(root);
    return t->rc;
}

static int find_margins(const struct apc_loop *loop, size_t of, const double *scale, bool peaks_only,
                        struct apc_loop_margins *margins, struct apc_error *why)
{
    const struct schedule schedule = {
        .period = loop->setup.period, .n = loop->setup.n_ticks, .tick = loop->setup.tick};
    struct apc_loop_margins m = {.size = sizeof(m)};
    struct machine nominal;
    struct trial t = {.loop = loop, .nominal = &nominal, .of = of, .by = BY_DELAY};
    int rc;

    if (of != APC_LOOP_WHOLE && of >= loop->n_out)
        return apc_fail(why, APC_EINVAL,
                        "margins: there is no output %zu: they count from 0, and there are %zu", of + 1,
                        loop->n_out);
    rc = machine_create(&nominal, loop, &schedule, why);
    t.factor = calloc(loop->n_out, sizeof(*t.factor));
    t.delay = calloc(loop->n_out, sizeof(*t.delay));
    if (rc == 0)
        rc = t.factor && t.delay ? measure_margins(&t, scale, peaks_only, &m) : APC_ENOMEM;
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
    return find_margins(loop, of, scale, false, margins, why);
}

int apc_loop_peaks(const struct apc_loop *loop, size_t of, const double *scale,
                   struct apc_loop_margins *margins, struct apc_error *why)
{
    return find_margins(loop, of, scale, true, margins, why);
}
