/* SPDX-License-Identifier: BSD-3-Clause */
#include "identify/search.h"

#include <apcmath.h>

#include <math.h>
#include <string.h>

#define DECISIVE 10.0 /* a difference of scores that leaves no doubt */
#define LAGS     24   /* that are tried */

/* ---- Where to begin -------------------------------------------------------------------------------- */

/* The shift of response @p w that explains most of e, beside the first @p width columns, which are
 * orthonormal;
 * @p column is room. True where it is more than @p most, which it then becomes. */
static bool look_along(struct search *s, const double *w, size_t width, double *column, double *most,
                       double *dead_time)
{
    const size_t shifts = (size_t)(s->dead_time_max / s->record->Ts);
    bool found = false;

    for (size_t d = 0; d <= shifts; d += 1 + d / 20) {
        double along, length, left;

        for (size_t k = 0; k < s->n; k++)
            column[k] = k < d ? 0.0 : w[k - d];
        for (size_t g = 1; g < s->runs; g++) { /* nothing of one run comes into the next */
            const size_t end = apc_record_end(s->record, g), begin = apc_record_end(s->record, g - 1);

            memset(column + begin, 0, (d < end - begin ? d : end - begin) * sizeof(*column));
        }
        search_finish(s, column);
        along = apc_column_dot(column, s->e, s->n);
        left = length = apc_column_dot(column, column, s->n);
        for (size_t i = 0; i < width; i++) {
            const double a = apc_column_dot(s->Q + i * s->n, column, s->n);

            left -= a * a;
        }
        if (left > 1e-8 * length && along * along / left > *most) {
            *most = along * along / left;
            *dead_time = (double)d * s->record->Ts;
            found = true;
        }
    }
    return found;
}

/* Of the arm @p j the lag and dead time that leave least, of the other arms those before @p known being what
 * they are and the rest not there yet: every shift of every lag. */
static int search_lag_and_delay(struct search *s, struct shape *shape, size_t j, size_t known)
{
    const double Ts = s->record->Ts, longest = 2.0 * (double)s->n;
    const size_t left = shape->arm[j].lag.order * s->runs; /* what is left of the beginnings */
    struct arm best = shape->arm[j];
    double most = -1.0;
    size_t fixed = search_base(s, shape);
    int rc = 0;

    search_fill_base(s, shape);
    for (size_t i = 0; i < known && rc == 0; i++) {
        if (i == j)
            continue;
        rc = search_fill_arm(s, &shape->arm[i], i, shape->rest, s->Q + fixed * s->n);
        fixed += search_arm(s, &shape->arm[i], shape->rest);
    }
    apc_qr_extend(s->n, 0, fixed, s->Q, s->R, s->width);
    for (size_t l = 0; l < (left ? LAGS : 1) && rc == 0; l++) {
        struct arm arm = shape->arm[j];

        arm.lag.tau[0] = Ts / 3.0 * apc_pow(longest, (double)l / (LAGS - 1));
        arm.lag.dead_time = 0.0;
        rc = search_respond(s, &arm.lag, j, s->plus, NULL);
        for (size_t i = 0; i < left; i++) {
            search_fill_rest(s, arm.lag.tau[0], i, s->Q + (fixed + i) * s->n);
            search_finish(s, s->Q + (fixed + i) * s->n);
        }
        apc_qr_extend(s->n, fixed, fixed + left, s->Q, s->R, s->width);
        memcpy(s->e, s->y, s->n * sizeof(*s->e));
        search_project(s, 0, fixed + left);
        if (look_along(s, s->plus, fixed + left, s->Q + (fixed + left) * s->n, &most, &arm.lag.dead_time))
            best = arm;
    }
    shape->arm[j] = best;
    return rc;
}

static int begin_shape(struct search *s, struct shape *shape, bool integrating)
{
    int rc = 0;

    search_set_noise(s, NULL, 0);
    shape->integrating = integrating;
    shape->rest = false;
    for (size_t j = 0; j < s->inputs; j++)
        shape->arm[j] = (struct arm){
            .lag = {.order = integrating ? 0 : 1, .integrating = integrating, .tau = {s->record->Ts}}};
    for (size_t round = 0; round < (s->inputs > 1 ? 3 : 1); round++) {
        for (size_t j = 0; j < s->inputs && rc == 0; j++)
            rc = search_lag_and_delay(s, shape, j, round == 0 ? j : s->inputs);
    }
    return rc == 0 ? search_refine(s, shape) : rc;
}

/* ---- Structure ------------------------------------------------------------------------------------ */

/* Refine grown, and take it instead of @p shape where it is better, or @p must be. */
static int compete(struct search *s, struct shape *shape, bool must)
{
    int rc = search_refine(s, &s->grown);

    if (rc == 0 && (must || s->grown.score < shape->score))
        search_copy(s, shape, &s->grown);
    return rc;
}

/* One lag more, from several beginnings. */
static int add_lag(struct search *s, struct shape *shape, size_t j, bool must)
{
    static const double split[][3] = {{1.0, 0.25, 0.125}, {0.6, 0.6, 0.3}, {1.0, 0.02, 0.0}};
    const struct arm from = shape->arm[j];
    int rc = 0;

    for (size_t i = 0; i < sizeof split / sizeof *split && rc == 0; i++) {
        struct arm *arm = &s->grown.arm[j];
        const double tau = from.lag.order ? from.lag.tau[0] : fmax(from.lag.dead_time, s->record->Ts);

        search_copy(s, &s->grown, shape);
        *arm = from;
        arm->lag.order = from.lag.order + 1;
        arm->lag.tau[0] = tau * (from.lag.order ? split[i][0] : split[i][1]);
        arm->lag.tau[1] = tau * split[i][1];
        arm->lag.dead_time = fmax(from.lag.dead_time - tau * split[i][2], 0.0);
        rc = compete(s, shape, must && i == 0);
    }
    return rc;
}

/* A zero, not beside an integrator, which it could undo: one that answers the wrong way at first looks like
 * dead time, so from less of that too. */
static int add_zero(struct search *s, struct shape *shape, size_t j)
{
    const struct arm from = shape->arm[j];
    int rc = 0;

    for (int i = 0; i < 3 && rc == 0; i++) {
        search_copy(s, &s->grown, shape);
        s->grown.arm[j] = from;
        s->grown.arm[j].zero = true;
        s->grown.arm[j].lag.dead_time = from.lag.dead_time * (2 - i) / 2.0;
        rc = compete(s, shape, false);
    }
    return rc;
}

static void set_levels(const struct search *s, struct shape *shape, bool rest, size_t since, size_t levels)
{
    shape->rest = rest;
    for (size_t j = 0; j < s->inputs; j++) {
        shape->arm[j].since = since;
        shape->arm[j].levels = levels;
    }
}

static size_t most_levels(const struct search *s, const struct shape *shape)
{
    size_t most = 0;

    for (size_t j = 0; j < s->inputs; j++)
        most = shape->arm[j].levels > most ? shape->arm[j].levels : most;
    return most;
}

/* A move before the record that was taken for one at its first sample, or for none, made the dead time too
 * short: begin with those that are as much longer as the levels go back, too. Where no better one is promised,
 * none is sought. */
static int try_levels(struct search *s, struct shape *shape, size_t since, size_t levels)
{
    const size_t later[] = {0, levels / 2, levels - 1};
    struct shape from = {.arm = s->grown.arm + 3 * s->inputs};
    int rc = 0;

    for (size_t i = 0; i < 6 && rc == 0; i++) {
        const size_t at = i % 3;
        double promised = HUGE_VAL;

        if (at == 0)
            search_copy(s, &from, shape);
        else if (later[at] == later[at - 1])
            continue;
        search_copy(s, &s->grown, &from);
        set_levels(s, &s->grown, i < 3, since, levels);
        for (size_t j = 0; j < s->inputs; j++)
            search_move(s, &s->grown.arm[j], s->grown.arm[j].lag.order, (double)later[at]);
        rc = search_look_ahead(s, &s->grown, &promised);
        if (rc == 0 && promised < shape->score)
            rc = compete(s, shape, false);
    }
    return rc;
}

/* The longest dead time. */
static double periods_of_delay(const struct search *s, const struct shape *shape)
{
    double longest = 0.0;

    for (size_t j = 0; j < s->inputs; j++)
        longest = fmax(longest, shape->arm[j].lag.dead_time);
    return longest / s->record->Ts;
}

/* What came before: was the plant at rest, and were the inputs what they were at first? A record may begin
 * with the first move, which acts after the dead time as any other does, or soon after it, and it may begin on
 * the way. One step, wherever it is, is asked before many: of one that had to take along all levels up to it,
 * a second lag, which lets the first sample be anything, would be the cheaper account. Asked before there are
 * more lags, which would be made up for what came before. */
static int fit_initial_conditions(struct search *s, struct shape *shape)
{
    size_t most;
    int rc = 0;

    for (int i = 0; i < 4 && rc == 0; i++) {
        bool other = shape->rest != (i % 2 == 0);

        for (size_t j = 0; j < s->inputs; j++)
            other |= shape->arm[j].since > 0 || shape->arm[j].levels != (size_t)(i / 2 == 0);
        search_copy(s, &s->grown, shape);
        set_levels(s, &s->grown, i % 2 == 0, 0, i / 2 == 0);
        rc = other ? compete(s, shape, false) : 0;
    }
    for (size_t since = 1; since < LEVELS && (double)since <= periods_of_delay(s, shape) + 1.0 && rc == 0;
         since++)
        rc = try_levels(s, shape, since, 1);
    for (size_t levels = 2; levels > 0 && levels <= s->levels_most && rc == 0;) {
        rc = try_levels(s, shape, 0, levels);
        levels = apc_record_more_levels(
            levels, fmin(periods_of_delay(s, shape) + (double)levels, s->dead_time_max / s->record->Ts));
    }
    most = most_levels(s, shape);
    for (size_t j = 0; j < s->inputs && s->inputs > 1 && most > 0 && rc == 0; j++) {
        search_copy(s, &s->grown, shape);
        s->grown.arm[j].levels = shape->arm[j].levels ? 0 : most;
        rc = compete(s, shape, false);
    }
    return rc;
}

/* Where the dead time is a multiple of the period the errors have an edge, and there may be a valley to each
 * side of it. */
static int try_neighbouring_delay(struct search *s, struct shape *shape)
{
    int rc = 0;

    for (size_t i = 0; i < 2 * s->inputs && rc == 0; i++) {
        search_copy(s, &s->grown, shape);
        search_move(s, &s->grown.arm[i / 2], s->grown.arm[i / 2].lag.order, i % 2 ? 0.9 : -0.9);
        rc = compete(s, shape, false);
    }
    return rc;
}

static int grow_shape(struct search *s, struct shape *shape)
{
    const unsigned most = s->order ? s->order : 2;
    size_t parts;
    int rc = fit_initial_conditions(s, shape);

    if (rc == 0)
        rc = try_neighbouring_delay(s, shape);
    parts = search_linear(s, shape) + search_unknowns(s, shape);
    for (size_t j = 0; j < s->inputs && rc == 0; j++) {
        unsigned before = most + 1;

        while (shape->arm[j].lag.order < most && shape->arm[j].lag.order != before && rc == 0) {
            before = shape->arm[j].lag.order;
            rc = add_lag(s, shape, j, s->order != 0);
        }
        if (shape->arm[j].lag.order == 2 && !shape->integrating && !shape->arm[j].zero && rc == 0)
            rc = add_zero(s, shape, j);
    }
    return rc == 0 && search_linear(s, shape) + search_unknowns(s, shape) != parts
               ? fit_initial_conditions(s, shape)
               : rc;
}

/* An input that the output can do without: what it seems to do is then a chance, of so many dead times and
 * lags that were tried. One is left. */
static int drop_input(struct search *s)
{
    size_t left = s->inputs;
    int rc = 0;

    for (size_t j = 0; j < s->inputs && left > 1 && rc == 0; j++) {
        search_copy(s, &s->grown, &s->best);
        s->grown.arm[j].none = true;
        rc = compete(s, &s->best, false);
        left -= s->best.arm[j].none;
    }
    return rc;
}

/* Is a lag longer than the record? Then nobody can tell it from an integrator. */
static bool endless(const struct search *s, const struct shape *shape)
{
    for (size_t j = 0; j < s->inputs; j++) {
        for (size_t i = 0; i < shape->arm[j].lag.order; i++) {
            if (shape->arm[j].lag.tau[i] > (double)apc_record_longest(s->record) * s->record->Ts)
                return true;
        }
    }
    return false;
}

/* Take the errors of a shape for what is to be expected of them, and find it anew. */
static int whiten(struct search *s, struct shape *shape)
{
    double a[NOISE_MOST];
    int order, rc;

    search_set_noise(s, NULL, 0);
    rc = search_evaluate(s, shape);
    for (size_t k = 0; k < s->n; k++)
        s->e[k] = s->counts[k] ? s->e[k] : (double)NAN;
    for (size_t g = 1; g < s->runs; g++) /* so that none hangs on those of the run before */
        s->e[apc_record_end(s->record, g - 1)] = (double)NAN;
    order = apc_autoregression(s->e, s->n, NOISE_MOST, a);
    if (rc < 0 || order < 0)
        return rc < 0 ? rc : order;
    search_set_noise(s, a, (size_t)order);
    return search_refine(s, shape);
}

/*
 * From where the search has begun: what seems to be structure may be noise with a colour, and the other way
 * round, so both are tried first.
 */
static int find_from(struct search *s, const struct shape *begun, bool noise_first, bool eager)
{
    struct shape candidate = {.arm = s->grown.arm + 2 * s->inputs};
    int rc = 0;

    search_copy(s, &candidate, begun);
    search_set_noise(s, NULL, 0);
    if (!noise_first)
        rc = grow_shape(s, &candidate);
    if (rc == 0)
        rc = whiten(s, &candidate);
    if (rc == 0)
        rc = grow_shape(s, &candidate);
    if (rc == 0 && candidate.score < s->best.score + (eager ? DECISIVE : 0.0))
        search_copy(s, &s->best, &candidate);
    return rc;
}

int search_shape(struct search *s, enum apc_identify_integrating integrating)
{
    struct shape begun = {.arm = s->grown.arm + s->inputs};
    int rc = 0;

    s->best.score = HUGE_VAL;
    for (int i = 0; i < 2 && rc == 0; i++) {
        const bool eager = i == 1 && endless(s, &s->best);

        if (integrating == (i ? APC_INTEGRATING_NO : APC_INTEGRATING_YES))
            continue;
        rc = begin_shape(s, &begun, i == 1);
        if (rc == 0)
            rc = find_from(s, &begun, false, eager);
        if (rc == 0)
            rc = find_from(s, &begun, true, eager && !s->best.integrating);
    }
    for (int round = 0; round < 2 && rc == 0; round++) {
        rc = whiten(s, &s->best);
        if (rc == 0)
            rc = grow_shape(s, &s->best);
        if (rc == 0)
            rc = try_neighbouring_delay(s, &s->best);
    }
    return rc == 0 ? drop_input(s) : rc;
}
