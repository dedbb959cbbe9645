/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the record of a loop shows: how much quieter it could be (Harris, Can. J. Chem. Eng. 67, 1989), whether
 * it swings, and whether sensor, valve, tuning or something outside is to blame. Where the record cannot tell,
 * the answer is that.
 */
#include "figures_internal.h"

#include <math.h>
#include <stdlib.h>

#include "base/parts.h"

static const double none = (double)NAN;

/* Nothing of these was fitted to a plant: test_figures_health.c counts what they get wrong. */
enum { ORDER = 30, LAGS = 1500, CROSSINGS = 11, COARSE = 8, FAR = 15 };
static const double strong = 0.1;    /* correlation a swing later, of an oscillation that counts */
static const double undamped = 0.55; /* of it is left FAR swings later, where nothing damps it */
static const double often_limited = 0.2, poor = 0.2, quantized = 0.25, jump_share = 5e-4;
static const size_t friction_ticks = 10000; /* of each half that are looked at */
static const double each_half = 6, both_halves = 20, least_share = 0.005; /* evidence of friction */

/* ---- Sensor ------------------------------------------------------------------------------- */

static int by_magnitude(const void *left, const void *right)
{
    const double a = *(const double *)left, b = *(const double *)right;
    return (a > b) - (a < b);
}

static double deviation(const double *v, size_t n)
{
    double mean = 0, sum = 0;
    for (size_t i = 0; i < n; i++)
        mean += v[i] / (double)n;
    for (size_t i = 0; i < n; i++)
        sum += (v[i] - mean) * (v[i] - mean);
    return sqrt(sum / (double)n);
}

/* The longest time that the measurement stood still while the output moved on; 0 where standing still is what
 * it usually does. */
static double stood_still(const struct health_series *s)
{
    size_t run = 0, longest = 0, changes = 1;
    for (size_t i = 1; i < s->n; i++) {
        const bool still = s->y[i] == s->y[i - 1];
        changes += !still;
        run = !still ? 0 : run + (s->u[i] < s->u[i - 1] || s->u[i] > s->u[i - 1]);
        longest = run > longest ? run : longest;
    }
    return longest >= 30 && longest > 10 * (s->n / changes) ? (double)longest * s->period : 0;
}

/* Rows that leave their neighbours and come back, and the smallest step between two rows. */
static void judge_rows(struct health *h, const struct health_series *s, double *step)
{
    const double *const y = s->measured;
    const size_t n = s->n_measured;
    size_t same = 0, jumps = 0;
    double smallest = HUGE_VAL;
    for (size_t i = 1; i < n; i++) {
        step[i - 1] = fabs(y[i] - y[i - 1]);
        same += !(step[i - 1] > 0);
        if (step[i - 1] > 0)
            smallest = fmin(smallest, step[i - 1]);
    }
    qsort(step, n - 1, sizeof *step, by_magnitude);
    const double far = fmax(12 * step[(n - 1) / 2], 3 * deviation(y, n));
    for (size_t i = 1; i + 1 < n; i++)
        jumps += (y[i] - y[i - 1]) * (y[i + 1] - y[i]) < 0 &&
                 fmin(fabs(y[i] - y[i - 1]), fabs(y[i + 1] - y[i])) > far;
    h->jumps = jumps > 2 ? (double)jumps / (double)n : 0;
    h->step = (double)same > 0.3 * (double)n && smallest < HUGE_VAL ? smallest : 0;
}

static bool blames_sensor(struct health *h, const struct health_series *s, double *work)
{
    h->still = stood_still(s);
    if (s->n_measured >= HEALTH_TICKS)
        judge_rows(h, s, work);
    return h->still > 0 || h->jumps > jump_share ||
           h->step > quantized * deviation(s->measured, s->n_measured);
}

/* ---- Output ------------------------------------------------------------------------------- */

static void judge_output(struct health *h, const struct health_series *s)
{
    double travel = 0, last = 0;
    size_t reversals = 0;
    for (size_t i = 1; i < s->n; i++) {
        const double move = s->u[i] - s->u[i - 1];
        travel += fabs(move);
        reversals += move * last < 0;
        if (move < 0 || move > 0)
            last = move;
    }
    const double hours = (double)s->n * s->period / 3600;
    h->travel = travel / hours;
    h->reversals = (double)reversals / hours;
}

/* In each half of the record, and of about one size: what was there by chance is in one. */
static int blames_valve(struct health *h, const struct health_series *s, bool *blamed)
{
    const size_t half = s->n / 2, looked = half < friction_ticks ? half : friction_ticks;
    struct friction a, b = {0};
    int rc = friction_find(&a, s->u, s->y, looked);
    if (rc == 0)
        rc = friction_find(&b, s->u + s->n - looked, s->y + s->n - looked, looked);
    *blamed = fmin(a.evidence, b.evidence) > each_half && a.evidence + b.evidence > both_halves &&
              fmin(a.share, b.share) > least_share && a.size < 2 * b.size && b.size < 2 * a.size;
    if (*blamed) {
        h->friction = (a.size + b.size) / 2;
        h->explained = (a.share + b.share) / 2;
    }
    return rc;
}

/* ---- Deviation ---------------------------------------------------------------------------- */

/* By autocorrelation, r[0] = 1. */
static double least_variance(const double *r, size_t ahead)
{
    double a[ORDER + 1] = {0}, kept[ORDER + 1], psi[ORDER + 1] = {1}, left = 1, sum = 0;
    for (size_t k = 1; k <= ORDER && left > 1e-12; k++) { /* Levinson's recursion: e(t) = sum a e(t - k) */
        double reflection = r[k];
        for (size_t i = 1; i < k; i++)
            reflection -= a[i] * r[k - i];
        reflection /= left;
        for (size_t i = 1; i < k; i++)
            kept[i] = a[i] - reflection * a[k - i];
        for (size_t i = 1; i < k; i++)
            a[i] = kept[i];
        a[k] = reflection;
        left *= 1 - reflection * reflection;
    }
    for (size_t t = 0; t < ahead; t++) { /* psi: of the last ORDER + 1 times */
        double next = t == 0 ? 1 : 0;
        for (size_t i = 1; i <= ORDER && i <= t; i++)
            next += a[i] * psi[(t - i) % (ORDER + 1)];
        psi[t % (ORDER + 1)] = next;
        sum += next * next;
    }
    return fmin(1, left * sum);
}

/* The largest correlation within one swing from @p from on. */
static double envelope(const double *r, size_t lags, double from, double swing)
{
    double most = 0;
    for (size_t k = (size_t)from; k <= (size_t)(from + swing) && k <= lags; k++)
        most = fmax(most, fabs(r[k]));
    return most;
}

/* Of a regular oscillation of @p least lags or more in the autocorrelation: a false return leaves @p h as it is. */
static bool swings(struct health *h, const double *r, size_t lags, double period, double least)
{
    double at[CROSSINGS], mean = 0, spread = 0;
    size_t n = 0;
    for (size_t k = 1; k <= lags && n < CROSSINGS; k++)
        if (r[k - 1] * r[k] < 0)
            at[n++] = (double)k - 1 + fabs(r[k - 1]) / (fabs(r[k - 1]) + fabs(r[k]));
    if (n < 6)
        return false;
    mean = 2 * (at[n - 1] - at[0]) / (double)(n - 1);
    for (size_t i = 1; i < n; i++)
        spread += (2 * (at[i] - at[i - 1]) - mean) * (2 * (at[i] - at[i - 1]) - mean) / (double)(n - 2);
    const double regularity = mean / (3 * sqrt(spread)), once = envelope(r, lags, mean, mean);
    if (!(regularity > 1 && mean >= least && once > strong))
        return false;
    const double far = fmin(FAR, (double)lags / mean - 1.5);
    h->swing = mean * period;
    h->regularity = regularity;
    h->lasting = far >= 8 ? envelope(r, lags, far * mean, mean) / once : none;
    return true;
}

/* Fine, where a loop at its limit may swing in less than three ticks, and for slow ones of means over some ticks. */
static bool finds_swing(struct health *h, const double *e, size_t n, double period, double *work, double *r)
{
    bool found = false;
    for (size_t coarse = 1; coarse <= COARSE && !found; coarse *= COARSE) {
        const size_t m = n / coarse, lags = m / 3 < LAGS ? m / 3 : LAGS;
        for (size_t i = 0; i < m; i++) {
            work[i] = 0;
            for (size_t k = 0; k < coarse; k++)
                work[i] += e[i * coarse + k] / (double)coarse;
        }
        lagged_products(work, work, m, lags, r);
        for (size_t k = lags + 1; k-- > 0;)
            r[k] /= r[0];
        found = swings(h, r, lags, period * (double)coarse, coarse == 1 ? 2.2 : 3.0);
    }
    return found;
}

/* Ticks until a deviation is forgotten. */
static size_t memory_of(const double *r, size_t lags)
{
    size_t k = 0;
    while (k < lags && r[k] > 0.3)
        k++;
    return k;
}

/* ---- All of it ---------------------------------------------------------------------------- */

static enum health_verdict of_deviation(struct health *h, const struct health_series *s, const double *e,
                                        double *work, double *r)
{
    const double horizon = s->horizon > 0 ? s->horizon : 10 * s->period;
    const size_t ahead = (size_t)fmax(1, round(horizon / s->period)),
                 lags = s->n / 3 < LAGS ? s->n / 3 : LAGS;
    lagged_products(e, e, s->n, lags, r);
    for (size_t k = lags + 1; k-- > 0;)
        r[k] /= r[0];
    h->index = least_variance(r, ahead);
    const bool lasts = memory_of(r, lags) > 2 * ahead;
    if (finds_swing(h, e, s->n, s->period, work, r))
        return isnan(h->lasting) ? HEALTH_SWINGS : h->lasting > undamped ? HEALTH_PERIODIC : HEALTH_TIGHT;
    return h->index < poor && lasts ? HEALTH_SLOW : HEALTH_GOOD;
}

int health_judge(struct health *h, const struct health_series *s)
{
    const size_t n = s->n > s->n_measured ? s->n : s->n_measured;
    double *e, *work, *r, mean = 0;
    bool valve = false;
    const struct apc_part parts[] = {APC_PART(e, s->n), APC_PART(work, n), APC_PART(r, LAGS + 1)};
    *h = (struct health){.verdict = HEALTH_UNKNOWN,
                         .n = s->n,
                         .least = HEALTH_TICKS * s->period,
                         .index = none,
                         .swing = none,
                         .regularity = none,
                         .lasting = none,
                         .friction = none,
                         .explained = none,
                         .still = none,
                         .jumps = none,
                         .step = none,
                         .travel = none,
                         .reversals = none};
    if (s->n < HEALTH_TICKS)
        return 0;
    void *const memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!memory)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->n; i++)
        mean += (s->y[i] - s->r[i]) / (double)s->n;
    for (size_t i = 0; i < s->n; i++)
        e[i] = s->y[i] - s->r[i] - mean;
    judge_output(h, s);
    int rc = 0;
    if (blames_sensor(h, s, work))
        h->verdict = HEALTH_SENSOR;
    else if (s->limited > often_limited) {
        h->verdict = HEALTH_LIMITED;
        if (deviation(e, s->n) > 0)
            (void)finds_swing(h, e, s->n, s->period, work, r);
    } else if ((rc = blames_valve(h, s, &valve)) == 0 && deviation(e, s->n) > 0) {
        const enum health_verdict seen = of_deviation(h, s, e, work, r);
        h->verdict = valve ? HEALTH_VALVE : seen;
    }
    free(memory);
    return rc;
}

static const struct {
    const char *name, *words;
} verdicts[] = {
    [HEALTH_SENSOR] = {"sensor", "the measurement is not reliable: repair the sensor first"},
    [HEALTH_VALVE] = {"valve", "the valve sticks or has backlash: repair it before you tune"},
    [HEALTH_TIGHT] = {"tight", "the loop oscillates by itself: less gain, or a longer integral time"},
    [HEALTH_PERIODIC] = {"periodic",
                         "an oscillation from outside never dies down: look for loops of this period"},
    [HEALTH_SWINGS] = {"oscillates", "it oscillates; the record is too short to find the cause"},
    [HEALTH_LIMITED] = {"limited", "the output is at a limit too often to be judged"},
    [HEALTH_SLOW] = {"slow",
                     "deviations last: more gain, or a slow disturbance that feedforward could reject"},
    [HEALTH_UNKNOWN] = {"unknown", "fewer than 500 ticks in service at one setpoint, or nothing moves"},
    [HEALTH_GOOD] = {"good", "the record shows nothing to repair"},
};

const char *health_name(enum health_verdict verdict)
{
    return verdicts[verdict].name;
}

const char *health_words(enum health_verdict verdict)
{
    return verdicts[verdict].words;
}
