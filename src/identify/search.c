/* SPDX-License-Identifier: BSD-3-Clause */
#include "identify/search.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/parts.h"

#define ARM_UNKNOWNS 3     /* log tau, log tau, dead time */
#define WHITE        1e-16 /* of y's variance: what rounding leaves */
#define STEPS_MOST   64    /* of all inputs before all runs; one of each is always there */
#define NOTHING      746.0 /* exp(-746) is 0 */

/* ---- Columns ------------------------------------------------------------------------------------- */

/* An integrator stands still where the plant was at rest. */
static bool drifts(const struct shape *shape)
{
    return shape->integrating && !shape->rest;
}

size_t search_base(const struct search *s, const struct shape *shape)
{
    return drifts(shape) ? 2 * s->runs : s->runs;
}

/* Response, and its rate where there is a zero. */
static size_t answers_of(const struct arm *arm)
{
    return 1 + (size_t)arm->zero;
}

/* The first column of what the input's steps do, as a run begins. */
static size_t step_column(const struct search *s, const struct arm *arm, bool rest)
{
    return answers_of(arm) + (rest ? 0 : arm->lag.order * s->runs);
}

size_t search_arm(const struct search *s, const struct arm *arm, bool rest)
{
    return arm->none ? 0 : step_column(s, arm, rest) + arm->levels * answers_of(arm) * s->runs;
}

double search_moved(const struct search *s, const struct shape *shape, size_t run)
{
    size_t at = search_base(s, shape);
    double sum = 0.0;

    for (size_t j = 0; j < s->inputs; j++) {
        const struct arm *arm = &shape->arm[j];

        for (size_t i = 0; i < arm->levels && !arm->none; i++)
            sum += s->value[at + step_column(s, arm, shape->rest) + answers_of(arm) * (i * s->runs + run)];
        at += search_arm(s, arm, shape->rest);
    }
    return sum;
}

static size_t arm_unknowns(const struct arm *arm)
{
    return arm->none ? 0 : arm->lag.order + 1;
}

size_t search_linear(const struct search *s, const struct shape *shape)
{
    size_t n = search_base(s, shape);

    for (size_t j = 0; j < s->inputs; j++)
        n += search_arm(s, &shape->arm[j], shape->rest);
    return n;
}

size_t search_unknowns(const struct search *s, const struct shape *shape)
{
    size_t n = 0;

    for (size_t j = 0; j < s->inputs; j++)
        n += arm_unknowns(&shape->arm[j]);
    return n;
}

/* Of a run the first and the number of samples. */
static size_t part_of(const struct search *s, size_t run, size_t *n)
{
    const size_t end = apc_record_end(s->record, run);

    *n = apc_record_run(s->record, run).n;
    return end - *n;
}

static void whiten_runs(const struct search *s, double *x)
{
    for (size_t g = 0; g < s->runs; g++) {
        size_t n, begin = part_of(s, g, &n);

        apc_whiten(x + begin, n, s->noise, s->n_noise, x + begin);
    }
}

void search_finish(const struct search *s, double *column)
{
    whiten_runs(s, column);
    for (size_t k = 0; k < s->n; k++)
        column[k] = s->counts[k] ? column[k] : 0.0;
}

int search_respond(const struct search *s, const struct apc_lag *lag, size_t j, double *w, double *rate)
{
    int rc = 0;

    for (size_t g = 0; g < s->runs && rc == 0; g++) {
        size_t n, begin = part_of(s, g, &n);

        const double *u = s->record->u + begin * s->inputs + j;

        rc = apc_lag_response(lag, s->record->Ts, *u, u, s->inputs, n, w + begin, rate ? rate + begin : NULL);
    }
    return rc;
}

void search_fill_rest(const struct search *s, double tau, size_t run, double *column)
{
    size_t n, begin = part_of(s, run, &n);

    memset(column, 0, s->n * sizeof(*column));
    for (size_t k = 0; k < n && (double)k * s->record->Ts / tau < NOTHING; k++)
        column[begin + k] = apc_exp(-(double)k * s->record->Ts / tau);
}

/* What a step of the input does, as each run begins in columns of each, then of those that stepped a sample
 * earlier. */
static int fill_steps(const struct search *s, const struct arm *arm, double *column)
{
    const size_t answers = answers_of(arm), n = apc_record_longest(s->record) + arm->since + arm->levels;
    const double one = 1.0;
    const int rc =
        apc_lag_response(&arm->lag, s->record->Ts, 0.0, &one, 0, n, s->step, arm->zero ? s->step + n : NULL);

    memset(column, 0, arm->levels * s->runs * answers * s->n * sizeof(*column));
    for (size_t i = 0; i < arm->levels * s->runs * answers && rc == 0; i++) {
        const double *answer = s->step + i % answers * n + arm->since + i / answers / s->runs;
        double *to = column + i * s->n;
        size_t samples, begin = part_of(s, i / answers % s->runs, &samples);

        memcpy(to + begin, answer, samples * sizeof(*to));
        search_finish(s, to);
    }
    return rc;
}

/* Response, rate, and what is left in lags @p from to @p to - 1: the first of each run, then those of the
 * next lag; and what a step does. */
static int fill_lags(const struct search *s, const struct arm *arm, size_t j, bool rest, size_t from,
                     size_t to, double *column)
{
    const size_t answers = answers_of(arm);
    int rc = search_respond(s, &arm->lag, j, column, arm->zero ? column + s->n : NULL);

    for (size_t i = 0; i < answers; i++)
        search_finish(s, column + i * s->n);
    for (size_t i = from * s->runs; i < to * s->runs; i++) {
        search_fill_rest(s, arm->lag.tau[i / s->runs], i % s->runs, column + (answers + i) * s->n);
        search_finish(s, column + (answers + i) * s->n);
    }
    if (rc == 0 && arm->levels)
        rc = fill_steps(s, arm, column + step_column(s, arm, rest) * s->n);
    return rc;
}

int search_fill_arm(const struct search *s, const struct arm *arm, size_t j, bool rest, double *column)
{
    return arm->none ? 0 : fill_lags(s, arm, j, rest, 0, rest ? 0 : arm->lag.order, column);
}

/* A level of each run and, where the plant integrates and was not at rest, a slope. */
void search_fill_base(const struct search *s, const struct shape *shape)
{
    memset(s->Q, 0, search_base(s, shape) * s->n * sizeof(*s->Q));
    for (size_t g = 0; g < s->runs; g++) {
        size_t n, begin = part_of(s, g, &n);

        for (size_t k = 0; k < n; k++) {
            s->Q[g * s->n + begin + k] = 1.0;
            if (drifts(shape))
                s->Q[(s->runs + g) * s->n + begin + k] = (double)k / (double)n;
        }
    }
    for (size_t i = 0; i < search_base(s, shape); i++)
        search_finish(s, s->Q + i * s->n);
}

void search_set_noise(struct search *s, const double *a, size_t order)
{
    const struct apc_record *r = s->record;

    for (size_t i = 0; i < order; i++)
        s->noise[i] = a[i];
    s->n_noise = order;
    for (size_t k = 0; k < s->n; k++)
        s->y[k] = r->y[k * r->ny + s->output];
    whiten_runs(s, s->y);
    s->rows = 0;
    for (size_t k = 0; k < s->n; k++) {
        s->counts[k] = isfinite(s->y[k]) != 0;
        s->y[k] = s->counts[k] ? s->y[k] : 0.0;
        s->rows += s->counts[k];
    }
}

/* ---- The errors of a shape ------------------------------------------------------------------------ */

void search_project(struct search *s, size_t from, size_t to)
{
    for (size_t i = from; i < to; i++) {
        const double *q = s->Q + i * s->n;

        s->along[i] = apc_column_dot(q, s->e, s->n);
        for (size_t k = 0; k < s->n; k++)
            s->e[k] -= s->along[i] * q[k];
    }
}

/* Schwarz' criterion, the autoregression among what is fitted; the less the better. */
static double score_of_search(const struct search *s, double left, size_t parameters)
{
    const double least = WHITE * apc_column_dot(s->y, s->y, s->n), n = (double)s->n;

    return n * apc_log(fmax(left, least) / (double)s->rows) + (double)(parameters + s->n_noise) * apc_log(n);
}

int search_evaluate(struct search *s, struct shape *shape)
{
    size_t at = search_base(s, shape);
    int rc = 0;

    search_fill_base(s, shape);
    for (size_t j = 0; j < s->inputs && rc == 0; j++) {
        rc = search_fill_arm(s, &shape->arm[j], j, shape->rest, s->Q + at * s->n);
        at += search_arm(s, &shape->arm[j], shape->rest);
    }
    if (rc < 0)
        return rc;
    apc_qr_extend(s->n, 0, at, s->Q, s->R, s->width);
    memcpy(s->e, s->y, s->n * sizeof(*s->e));
    search_project(s, 0, at);
    apc_qr_solve(at, s->R, s->width, s->along, s->value);
    shape->left = apc_column_dot(s->e, s->e, s->n);
    shape->score = score_of_search(s, shape->left, at + search_unknowns(s, shape));
    return 0;
}

double search_shortest(const struct search *s)
{
    return s->record->Ts / 50.0;
}

double search_longest(const struct search *s)
{
    return 50.0 * (double)s->n * s->record->Ts;
}

void search_move(const struct search *s, struct arm *arm, size_t q, double step)
{
    const double Ts = s->record->Ts;

    if (q < arm->lag.order)
        arm->lag.tau[q] = fmin(fmax(arm->lag.tau[q] * apc_exp(step), search_shortest(s)), search_longest(s));
    else
        arm->lag.dead_time = fmin(fmax(arm->lag.dead_time + step * Ts, 0.0), s->dead_time_max);
}

/* How the errors move with unknown @p q of arm @p j, whose columns begin at @p at: only what it moves is
 * filled. */
static int differentiate_shape(struct search *s, const struct shape *shape, size_t j, size_t at, size_t q,
                               double *out)
{
    const double h = 1e-4;
    const struct arm *arm = &shape->arm[j];
    const size_t answers = answers_of(arm), to = shape->rest || q == arm->lag.order ? q : q + 1,
                 steps = step_column(s, arm, shape->rest);
    struct arm up = *arm, down = *arm;
    double width = 2.0 * h;
    int rc;

    search_move(s, &up, q, h);
    search_move(s, &down, q, -h);
    if (q == arm->lag.order)
        width = (up.lag.dead_time - down.lag.dead_time) / s->record->Ts;
    rc = fill_lags(s, &up, j, shape->rest, q, to, s->plus);
    if (rc == 0)
        rc = fill_lags(s, &down, j, shape->rest, q, to, s->minus);
    memset(out, 0, s->n * sizeof(*out));
    for (size_t c = 0; c < search_arm(s, arm, shape->rest) && rc == 0; c++) {
        if (c >= answers && c < steps && (c < answers + q * s->runs || c >= answers + to * s->runs))
            continue;
        const double *plus = s->plus + c * s->n, *minus = s->minus + c * s->n;

        for (size_t k = 0; k < s->n; k++)
            out[k] += s->value[at + c] * (plus[k] - minus[k]) / width;
    }
    return rc;
}

int search_differentiate(struct search *s, const struct shape *shape)
{
    size_t at = search_base(s, shape), to = search_linear(s, shape);
    int rc = 0;

    for (size_t j = 0; j < s->inputs && rc == 0; j++) {
        for (size_t q = 0; q < arm_unknowns(&shape->arm[j]) && rc == 0; q++, to++)
            rc = differentiate_shape(s, shape, j, at, q, s->Q + to * s->n);
        at += search_arm(s, &shape->arm[j], shape->rest);
    }
    if (rc == 0)
        apc_qr_extend(s->n, search_linear(s, shape), to, s->Q, s->R, s->width);
    return rc;
}

void search_copy(const struct search *s, struct shape *to, const struct shape *from)
{
    struct arm *arm = to->arm;

    memcpy(arm, from->arm, s->inputs * sizeof(*arm));
    *to = *from;
    to->arm = arm;
}

static void step_shape(const struct search *s, struct shape *shape, const double *step)
{
    for (size_t j = 0; j < s->inputs; j++) {
        for (size_t q = 0; q < arm_unknowns(&shape->arm[j]); q++)
            search_move(s, &shape->arm[j], q, fmin(fmax(*step++, -20.0), 20.0));
    }
}

/* Evaluate trial where nothing of what led to it is overwritten: behind the first @p columns. */
static int try_aside(struct search *s, size_t columns)
{
    struct search aside = *s;

    aside.Q = s->Q + columns * s->n;
    aside.R = s->R + s->width * s->width;
    aside.along = s->along + s->width;
    aside.value = s->value + s->width;
    aside.e = s->e + s->n;
    return search_evaluate(&aside, &s->trial);
}

int search_look_ahead(struct search *s, struct shape *shape, double *score)
{
    const size_t first = search_linear(s, shape), m = search_unknowns(s, shape);
    int rc = search_evaluate(s, shape);

    if (rc == 0)
        rc = search_differentiate(s, shape);
    if (rc == 0) {
        search_project(s, first, first + m);
        *score = score_of_search(s, apc_column_dot(s->e, s->e, s->n), first + m);
    }
    return rc;
}

int search_refine(struct search *s, struct shape *shape)
{
    const size_t first = search_linear(s, shape), m = search_unknowns(s, shape);
    double damping = 1e-3;
    int rc = search_evaluate(s, shape);

    for (int iteration = 0, idle = 0; iteration < 60 && idle < 2 && rc == 0; iteration++) {
        const double before = shape->left;
        bool better = false;

        if (iteration > 0)
            rc = search_evaluate(s, shape);
        if (rc == 0)
            rc = search_differentiate(s, shape);
        if (rc < 0)
            break;
        search_project(s, first, first + m);
        while (!better && damping < 1e3 && rc == 0) {
            apc_qr_damped(m, s->R + first * s->width + first, s->width, s->along + first, damping, s->small,
                          s->small_R, s->small + 2 * m * (m + 1));
            search_copy(s, &s->trial, shape);
            step_shape(s, &s->trial, s->small + 2 * m * (m + 1));
            rc = try_aside(s, first + m);
            better = rc == 0 && s->trial.left < before;
            damping *= better ? 0.1 : 10.0;
        }
        if (!better)
            break;
        search_copy(s, shape, &s->trial);
        damping = fmax(damping, 1e-12);
        idle = before - shape->left < 1e-6 * before ? idle + 1 : 0;
    }
    return rc == 0 ? search_evaluate(s, shape) : rc;
}

/* ---- Memory ------------------------------------------------------------------------------ */

int search_open(struct search *s)
{
    const size_t n = s->n, m = s->inputs * ARM_UNKNOWNS;
    size_t linear;

    s->runs = apc_record_runs(s->record);
    s->levels_most = STEPS_MOST / (s->runs * s->inputs);
    s->levels_most = s->levels_most < 1 ? 1 : s->levels_most > LEVELS ? LEVELS : s->levels_most;
    s->arm_columns = 2 + 2 * s->runs + 2 * s->runs * s->levels_most;
    linear = s->inputs * s->arm_columns + 2 * s->runs;

    s->width = linear + m;
    const struct apc_part parts[] = {APC_PART(s->counts, n),
                                     APC_PART(s->best.arm, s->inputs),
                                     APC_PART(s->trial.arm, s->inputs),
                                     APC_PART(s->grown.arm, 4 * s->inputs),
                                     APC_PART(s->Q, (s->width + linear) * n),
                                     APC_PART(s->y, n),
                                     APC_PART(s->e, 2 * n),
                                     APC_PART(s->plus, s->arm_columns * n),
                                     APC_PART(s->minus, s->arm_columns * n),
                                     APC_PART(s->R, 2 * s->width * s->width),
                                     APC_PART(s->along, 2 * s->width),
                                     APC_PART(s->value, 2 * s->width),
                                     APC_PART(s->small, (2 * m + 2) * (m + 2) + s->width),
                                     APC_PART(s->small_R, m * m),
                                     APC_PART(s->step, 2 * (n + LEVELS))};
    s->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return s->memory ? 0 : APC_ENOMEM;
}

void search_close(struct search *s)
{
    free(s->memory);
}
