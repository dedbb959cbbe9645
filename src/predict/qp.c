/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc_qp: a dual active-set method, after Goldfarb and Idnani (1983). The multipliers always stay where the
 * dual problem allows them (its feasible set knows neither f nor limits, which is why any former solution is
 * a place to begin). A step leads to W's own optimum. The ratio test cuts it short where a multiplier reaches
 * an end of its interval: this row is the blocking constraint, which is dropped, or turns soft. After a full
 * step the row that is violated most, measured in w, is the entering constraint. The dual objective rises
 * with each step, so no working set comes twice; where steps have no length, the lowest row is taken instead,
 * which cannot go round for ever either.
 *
 * A row that depends on W cannot be added as long as W is what it is. A partial step, along the dependency,
 * changes no x, costs nothing and gains its violation, until a row of W is dropped. Where none ever is, the
 * rows contradict, and the direction is the certificate of infeasibility.
 */
#include "base/base_internal.h"
#include "predict/qp_internal.h"

#include <float.h>
#include <math.h>

#define REFINE                                                                                               \
    1e-13 /* dual residual, of a variable's own scale, from which on one more step is asked for              \
           */
#define VOUCH       1e-9 /* and up to which an answer is called optimal */
#define REFINEMENTS 3

/* ---- Rows ------------------------------------------------------------------------------------- */

void qp_interval(const struct apc_qp *qp, size_t i, double *low, double *high)
{
    bool equation = qp->low[i] == qp->high[i], violated = qp->state[i] == 2 || qp->state[i] == -2;
    double most = !qp_soft(qp, i) || violated ? HUGE_VAL : qp->linear[i],
           least = violated ? qp->linear[i] : 0.0;

    *low = qp->state[i] > 0 ? least : -most;
    *high = qp->state[i] > 0 ? most : -least;
    if (equation && !violated)
        *low = -most, *high = most;
    if (equation && violated && least == 0.0)
        *low = -HUGE_VAL, *high = HUGE_VAL;
}

/** Row @p i becomes one of F at multiplier @p lambda, or (0) no longer is. */
static void fix_multiplier(struct apc_qp *qp, size_t i, double lambda)
{
    qp_row_add(qp, i, lambda - qp->fixed[i], qp->q);
    qp->fixed[i] = lambda;
    qp->shifted = true;
    qp_working_set_right_hand_sides(qp, 0);
}

/* ---- A point ---------------------------------------------------------------------------------- */

QP_LANES static void evaluate_rows(struct apc_qp *qp)
{
    size_t n = qp->n;

    memcpy(qp->value, qp->x, n * sizeof(*qp->x));
    for (size_t r = 0; r < qp->m; r++) {
        const double *row = qp->A + r * n;
        const unsigned *column = qp->column + r * n;
        double sum = 0.0;

        if (qp->low[n + r] == -HUGE_VAL && qp->high[n + r] == HUGE_VAL)
            continue; /* of no consequence */
        if (qp->filled[r] > n / 4) {
            sum = qp_dot(n, row, qp->x);
        } else {
            for (unsigned c = 0; c < qp->filled[r]; c++)
                sum += row[column[c]] * qp->x[column[c]];
        }
        qp->value[n + r] = sum;
    }
}

/** x = J w and its rows, from the multipliers as they stand. */
QP_LANES static void primal_point(struct apc_qp *qp)
{
    size_t n = qp->n;

    for (size_t i = 0; i < n; i++)
        qp->w[i] = -qp->q[i];
    qp_working_set_subtract_rows(qp, qp->lambda, qp->w);
    for (size_t p = 0; p < qp->waiting; p++)
        qp_row_add(qp, qp->pending[p].row, -qp->pending[p].lambda, qp->w);
    for (size_t i = 0; i < n; i++)
        qp->x[i] = qp_dot(n - i, qp->J + i * n + i, qp->w + i);
    evaluate_rows(qp);
}

/** Where row @p at of W ought to be minus where it is. */
static double primal_residual(const struct apc_qp *qp, size_t at)
{
    size_t i = qp->work[at];
    double sign = qp->state[i] > 0 ? 1.0 : -1.0;
    double excess = (qp->lambda[at] - sign * qp->linear[i]) * qp->give[at];

    return (sign > 0.0 ? qp->high[i] : qp->low[i]) + excess - qp->value[i];
}

/* ---- Steps: ratio test, drop, partial step ---------------------------------------------------- */

static void queue_entering(struct apc_qp *qp, size_t i, double lambda, double direction)
{
    qp->pending[qp->waiting++] = (struct apc_qp_pending){(unsigned)i, lambda, direction};
}

/**
 * The multiplier of row @p i, which is not in W, has come to an end of its interval, @p lambda. Returns
 * true when it goes on from there in another state: @p direction is where it wants to.
 */
static bool pass_multiplier_bound(struct apc_qp *qp, size_t i, double lambda, double *direction)
{
    int sign = lambda > 0.0 ? 1 : -1;

    qp->changes++;
    if (lambda == 0.0) {
        qp->state[i] = 0;
        return false;
    }
    if (qp->state[i] == 2 || qp->state[i] == -2) {
        qp->state[i] = (signed char)sign;
        *direction = -sign;
        return true;
    }
    qp->state[i] = (signed char)(2 * sign);
    *direction = sign;
    if (qp->square[i] > 0.0)
        return true;
    fix_multiplier(qp, i, lambda);
    return false;
}

/** Drop the row at @p at from W, its multiplier being at an end of its interval. */
static void drop_constraint(struct apc_qp *qp, size_t at)
{
    size_t i = qp->work[at];
    double lambda = qp->lambda[at], direction;

    qp_working_set_remove(qp, at);
    if (pass_multiplier_bound(qp, i, lambda, &direction))
        queue_entering(qp, i, lambda, direction);
}

/** May four rows of W, from @p j on, go @p most of the way along @p move? */
static inline bool none_blocks(const struct apc_qp *qp, const double *move, double most, size_t j)
{
    const apc_lanes step = QP_FOUR(move + j), to = QP_FOUR(qp->lambda + j) + most * step;
    const apc_masks held = (~(step <= 0.0) & ~(to <= QP_FOUR(qp->most_of + j))) |
                           (~(step >= 0.0) & ~(to >= QP_FOUR(qp->least + j)));

    return !qp_any(&held);
}

/** The ratio test: how far the multipliers may go along @p move, at the longest @p most. *@p at is the place of the
 * blocking constraint, whose multiplier comes to its end *@p end; k: none blocks, the step is a full one. */
QP_LANES static double ratio_test(const struct apc_qp *qp, const double *move, double most, bool careful,
                                  size_t *at, double *end)
{
    double best = most, steepest = 0.0;

    *at = qp->k;
    for (size_t j = 0; j < qp->k; j++) {
        double bound, step;

        while (j + 4 <= qp->k && none_blocks(qp, move, most, j))
            j += 4;
        if (j == qp->k)
            break;
        bound = move[j] > 0.0 ? qp->most_of[j] : qp->least[j];

        if (move[j] == 0.0 || (move[j] > 0.0 ? qp->lambda[j] + most * move[j] <= bound
                                             : qp->lambda[j] + most * move[j] >= bound))
            continue;
        step = (bound - qp->lambda[j]) / move[j];
        if (step < 0.0)
            step = 0.0;
        if (step > best || (step == best && *at < qp->k &&
                            (careful ? qp->work[*at] < qp->work[j] : steepest >= fabs(move[j]))))
            continue;
        if (step == best && *at == qp->k)
            continue; /* the whole way: nobody is in it */
        best = step;
        steepest = fabs(move[j]);
        *at = j;
        *end = bound;
    }
    return best;
}

/** The certificate of infeasibility: the row that waits, and those of W that hold it, contradict each other. */
static void infeasibility_certificate(struct apc_qp *qp, const struct apc_qp_pending *last,
                                      const double *move)
{
    double most = 1.0;

    memset(qp->side, 0, qp->rows);
    for (size_t j = 0; j < qp->k; j++)
        most = fabs(move[j]) > most ? fabs(move[j]) : most;
    for (size_t j = 0; j < qp->k; j++)
        if (fabs(move[j]) > 1e-9 * most)
            qp->side[qp->work[j]] = move[j] > 0.0 ? 1 : -1;
    qp->side[last->row] = last->direction > 0.0 ? 1 : -1;
}

/**
 * A row that has come back to its limit from beyond it, and depends on W: does it gain nothing by going on?
 * Then it would only change places with a row of W, and that one with it, for ever: it is one of F instead.
 */
static bool would_cycle(struct apc_qp *qp, const struct apc_qp_pending *last, const double *move)
{
    const size_t i = last->row;
    const double sign = last->lambda > 0.0 ? 1.0 : -1.0, limit = sign > 0.0 ? qp->high[i] : qp->low[i];
    double gain;

    if (last->lambda == 0.0 || fabs(last->lambda) != qp->linear[i] || last->direction == sign ||
        qp->state[i] != (signed char)sign)
        return false;
    primal_point(qp);
    gain = last->direction * (qp->value[i] - limit);
    for (size_t j = 0; j < qp->k; j++)
        gain -= move[j] * primal_residual(qp, j);
    return gain <= 0.5 * qp_allowance(qp, limit);
}

/** A partial step, of multipliers alone, for the row that waits last and depends on W: until a row of W is dropped, or
 * its own multiplier is at an end. Returns false when nothing blocks: infeasible. */
static bool partial_step(struct apc_qp *qp)
{
    struct apc_qp_pending *last = &qp->pending[qp->waiting - 1];
    double low, high, own, end = 0.0, length, *move = qp->carry;
    size_t at;

    memset(move, 0, qp->k * sizeof(*move));
    if (qp->size[last->row] > 0.0) /* a row of zeros depends on nothing */
        qp_working_set_dual_direction(qp, move);
    for (size_t j = 0; j < qp->k; j++)
        move[j] *= -last->direction;
    if (would_cycle(qp, last, move)) {
        qp->state[last->row] = (signed char)(2 * qp->state[last->row]);
        fix_multiplier(qp, last->row, last->lambda);
        qp->waiting--;
        return true;
    }
    qp_interval(qp, last->row, &low, &high);
    own = last->direction > 0.0 ? high - last->lambda : last->lambda - low;
    length = ratio_test(qp, move, own, false, &at, &end);
    if (!isfinite(length)) {
        infeasibility_certificate(qp, last, move);
        return false;
    }
    for (size_t j = 0; j < qp->k; j++)
        qp->lambda[j] += length * move[j];
    last->lambda += last->direction * length;
    if (at < qp->k) {
        qp->lambda[at] = end;
        drop_constraint(qp, at);
        return true;
    }
    last->lambda = last->direction > 0.0 ? high : low;
    if (!pass_multiplier_bound(qp, last->row, last->lambda, &last->direction))
        qp->waiting--;
    return true;
}

static void add_constraint(struct apc_qp *qp, size_t i, double sign)
{
    if (qp->fixed[i] != 0.0) {
        double lambda = qp->fixed[i];

        fix_multiplier(qp, i, 0.0);
        qp->state[i] = (signed char)sign;
        queue_entering(qp, i, lambda, fabs(sign) > 1.0 ? sign / 2.0 : -sign);
    } else {
        qp->state[i] = (signed char)(qp->linear[i] == 0.0 && qp->square[i] > 0.0 ? 2.0 * sign : sign);
        queue_entering(qp, i, 0.0, sign);
    }
    qp->changes++;
}

/* ---- A solve ---------------------------------------------------------------------------------- */

/** q from f and F alone, F in the order of its rows. */
QP_LANES static void transformed_gradient(struct apc_qp *qp)
{
    size_t n = qp->n, i = 0;

    memset(qp->q, 0, n * sizeof(*qp->q));
    for (; i + 4 <= n; i += 4) { /* J's zeros are there */
        const double *row = qp->J + i * n + i;

        qp_add_each(n - i, qp->f + i, (const double *const[]){row, row + n, row + 2 * n, row + 3 * n},
                    qp->q + i);
    }
    for (; i < n; i++)
        qp_add(n - i, qp->f[i], qp->J + i * n + i, qp->q + i);
    for (i = 0; i < qp->rows; i++)
        if (qp->fixed[i] != 0.0)
            qp_row_add(qp, i, qp->fixed[i], qp->q);
    qp->shifted = false;
}

/** Row i, if it still has the limit on its side, begins at the multiplier that it had. */
static void warm_start_row(struct apc_qp *qp, size_t i)
{
    double lambda = qp->multiplier[i], low, high;
    int sign = qp->state[i] > 0 ? 1 : -1;

    qp->state[i] = 0;
    qp->fixed[i] = 0.0;
    if (!isfinite(sign > 0 ? qp->high[i] : qp->low[i]) || qp->size[i] == 0.0)
        return;
    if (qp_soft(qp, i) && sign * lambda >= qp->linear[i] && qp->square[i] == 0.0) {
        qp->state[i] = (signed char)(2 * sign);
        qp->fixed[i] = sign * qp->linear[i];
        qp_row_add(qp, i, qp->fixed[i], qp->q);
        return;
    }
    qp->state[i] = (signed char)(qp_soft(qp, i) && sign * lambda >= qp->linear[i] ? 2 * sign : sign);
    qp_interval(qp, i, &low, &high);
    if (!qp_working_set_append(qp, i, lambda < low ? low : lambda > high ? high : lambda))
        qp->state[i] = 0;
}

/** The working set of the former solve, as far as it still may be one. */
static void warm_start(struct apc_qp *qp)
{
    bool anew = qp->k > qp->rows;

    qp->waiting = 0;
    qp->tried = (unsigned)qp->rows;
    if (anew) {
        qp->k = qp->fresh = 0;
        memset(qp->fixed, 0, qp->rows * sizeof(*qp->fixed));
    }
    for (size_t i = 0; i < qp->rows; i++)
        if (qp->fixed[i] != 0.0 && !isfinite(qp->fixed[i] > 0.0 ? qp->high[i] : qp->low[i])) {
            qp->fixed[i] = 0.0;
            qp->state[i] = 0;
        }
    transformed_gradient(qp);
    for (size_t j = qp->k; j-- > 0;) {
        size_t i = qp->work[j];

        qp_interval(qp, i, &qp->least[j], &qp->most_of[j]);
        if (isfinite(qp->state[i] > 0 ? qp->high[i] : qp->low[i]) && qp->lambda[j] >= qp->least[j] &&
            qp->lambda[j] <= qp->most_of[j])
            continue;
        qp_working_set_remove(qp, j);
        qp->state[i] = 0;
    }
    qp_working_set_right_hand_sides(qp, 0);
    for (size_t i = 0; anew && i < qp->rows; i++)
        if (qp->state[i])
            warm_start_row(qp, i);
    if (anew && qp->k > 0)
        qp_working_set_right_hand_sides(qp, 0); /* F may have come after */
}

/** The dual active-set method, after Goldfarb and Idnani: until no row is violated. */
static enum apc_qp_status dual_active_set(struct apc_qp *qp)
{
    unsigned still = 0; /* steps without length */

    for (;;) {
        bool careful = still > qp->rows;
        double sign = 0.0, end = 0.0, length, *move = qp->carry;
        size_t at, i;

        while (qp->waiting > 0) {
            const struct apc_qp_pending *last = &qp->pending[qp->waiting - 1];

            if (qp->size[last->row] > 0.0 && qp_working_set_append(qp, last->row, last->lambda))
                qp->waiting--;
            else if (qp->changes >= qp->most)
                return APC_QP_LIMIT;
            else if (!partial_step(qp))
                return APC_QP_INFEASIBLE;
        }
        if (qp->changes > 0 && (qp->changes >= qp->most || (qp->enough && qp->enough(qp->ctx))))
            return APC_QP_LIMIT;
        qp_working_set_target(qp);
        for (size_t j = 0; j < qp->k; j++)
            move[j] = qp->target[j] - qp->lambda[j];
        length = ratio_test(qp, move, 1.0, careful, &at, &end);
        if (at < qp->k) {
            for (size_t j = 0; j < qp->k; j++)
                qp->lambda[j] += length * move[j];
            qp->lambda[at] = end;
            still = length > 0.0 ? 0 : still + 1;
            drop_constraint(qp, at);
            continue;
        }
        memcpy(qp->lambda, qp->target, qp->k * sizeof(*qp->lambda));
        primal_point(qp);
        i = qp_entering(qp, careful, &sign);
        if (i < qp->rows) {
            add_constraint(qp, i, sign);
            continue;
        }
        if (qp->settled && !qp->shifted)
            return APC_QP_OPTIMAL;
        qp_working_set_settle(qp);
        if (qp->shifted) {
            transformed_gradient(qp);
            qp_working_set_right_hand_sides(qp, 0);
        }
    }
}

/** Hx + f + (I, A')multipliers into g, Hx into e. */
QP_LANES static void lagrangian_gradient(struct apc_qp *qp)
{
    size_t n = qp->n;

    for (size_t i = 0; i < n; i++) {
        qp->e[i] = qp_dot(n, qp->H + i * n, qp->x);
        qp->g[i] = qp->e[i] + qp->f[i] + qp->multiplier[i];
    }
    for (size_t r = 0; r < qp->m; r++) {
        double lambda = qp->multiplier[n + r];

        if (lambda == 0.0)
            continue;
        if (qp->filled[r] > n / 4)
            qp_add(n, lambda, qp->A + r * n, qp->g);
        else
            for (unsigned c = 0; c < qp->filled[r]; c++)
                qp->g[qp->column[r * n + c]] += lambda * qp->A[r * n + qp->column[r * n + c]];
    }
}

static void publish_multipliers(struct apc_qp *qp)
{
    memcpy(qp->multiplier, qp->fixed, qp->rows * sizeof(*qp->fixed));
    for (size_t j = 0; j < qp->k; j++)
        qp->multiplier[qp->work[j]] = qp->lambda[j];
    for (size_t p = 0; p < qp->waiting; p++)
        qp->multiplier[qp->pending[p].row] = qp->pending[p].lambda;
    for (size_t i = qp->n; i < qp->rows; i++) {
        double sign, much;

        if (qp->size[i] > 0.0 || !qp_soft(qp, i))
            continue;
        much = qp_violation_of(qp, i, &sign);
        qp->multiplier[i] = much > 0.0 ? sign * (qp->linear[i] + qp->square[i] * much) : 0.0;
    }
}

QP_LANES bool qp_is_stationary(const struct apc_qp *qp, double share)
{
    const double scale = qp->proximal ? qp_gradient_scale(qp)
                                      : sqrt(qp_dot(qp->n, qp->w, qp->w)) + sqrt(qp_dot(qp->n, qp->q, qp->q));
    apc_masks off = {0};
    size_t i = 0;

    for (; i + 4 <= qp->n; i += 4) {
        const apc_lanes g = QP_FOUR(qp->g + i), most = share * (QP_FOUR(qp->root + i) * scale + DBL_MIN);

        off |= (g > most) | (g < -most);
    }
    for (; i < qp->n; i++)
        if (fabs(qp->g[i]) > share * (qp->root[i] * scale + DBL_MIN))
            return false;
    return !qp_any(&off);
}

static bool active_rows_hold(const struct apc_qp *qp, double share)
{
    for (size_t j = 0; j < qp->k; j++) {
        size_t i = qp->work[j];

        if (fabs(primal_residual(qp, j)) >
            share * qp_allowance(qp, qp->state[i] > 0 ? qp->high[i] : qp->low[i]))
            return false;
    }
    return true;
}

/** One step of refinement on the final working set. */
QP_LANES static void refine_iteratively(struct apc_qp *qp)
{
    size_t n = qp->n;
    double *y = qp->target;

    memset(qp->e, 0, n * sizeof(*qp->e));
    for (size_t i = 0; i < n; i++)
        qp_add(n - i, -qp->g[i], qp->J + i * n + i, qp->e + i);
    for (size_t j = 0; j < qp->k; j++)
        y[j] = qp_row_dot(qp, qp->work[j], qp->e) - primal_residual(qp, j);
    qp_working_set_solve(qp, qp->k, y);
    for (size_t j = 0; j < qp->k; j++)
        qp->lambda[j] += y[j];
    qp_working_set_subtract_rows(qp, y, qp->e);
    for (size_t i = 0; i < n; i++)
        qp->x[i] += qp_dot(n - i, qp->J + i * n + i, qp->e + i);
    evaluate_rows(qp);
    publish_multipliers(qp);
    lagrangian_gradient(qp);
}

/** Look at what dual_active_set() found. False when a row has to come in or leave after all, which it now does. */
static bool verify_optimality(struct apc_qp *qp)
{
    double sign, most = 0.0;
    size_t i;
    int round;

    publish_multipliers(qp);
    lagrangian_gradient(qp);
    for (round = 0; round < REFINEMENTS && !(qp_is_stationary(qp, REFINE) && active_rows_hold(qp, 0.1));
         round++)
        refine_iteratively(qp);
    if (round == 0)
        return true;
    for (size_t j = 0; j < qp->k; j++)
        most = fabs(qp->lambda[j]) > most ? fabs(qp->lambda[j]) : most;
    for (size_t j = 0; j < qp->k; j++) {
        double low = qp->least[j], high = qp->most_of[j], lambda = qp->lambda[j];

        qp->lambda[j] = lambda < low ? low : lambda > high ? high : lambda;
        qp->multiplier[qp->work[j]] = qp->lambda[j];
        if (fabs(qp->lambda[j] - lambda) > VOUCH * most) {
            drop_constraint(qp, j);
            return false;
        }
    }
    i = qp_entering(qp, false, &sign);
    if (i < qp->rows) {
        add_constraint(qp, i, sign);
        return false;
    }
    lagrangian_gradient(qp);
    return true;
}

enum apc_qp_status qp_solve_definite(struct apc_qp *qp)
{
    enum apc_qp_status status;

    warm_start(qp);
    do
        status = dual_active_set(qp);
    while (status == APC_QP_OPTIMAL && !verify_optimality(qp));
    return status;
}

/** Are four rows, from @p i on, within their limits, and does none of them pull? */
static inline bool are_inactive(const struct apc_qp *qp, size_t i)
{
    const apc_lanes value = QP_FOUR(qp->value + i);
    const apc_masks busy = (QP_FOUR(qp->multiplier + i) != 0.0) | ~(value <= QP_FOUR(qp->high + i)) |
                           ~(value >= QP_FOUR(qp->low + i));

    return !qp_any(&busy);
}

/** Figures of the point as it stands. Needs lagrangian_gradient(). */
QP_LANES static void measure_solution(const struct apc_qp *qp, struct apc_qp_result *r)
{
    r->objective = 0.5 * qp_dot(qp->n, qp->x, qp->e) + qp_dot(qp->n, qp->x, qp->f);
    for (size_t i = 0; i < qp->n; i++)
        r->dual = fabs(qp->g[i]) > r->dual ? fabs(qp->g[i]) : r->dual;
    for (size_t i = 0; i < qp->rows; i++)
        r->active += qp->state[i] != 0;
    for (size_t i = 0; i < qp->rows; i++) {
        double lambda, above, below, excess, off = 0.0;

        while (i + 4 <= qp->rows && are_inactive(qp, i))
            i += 4;
        if (i == qp->rows)
            break;
        lambda = qp->multiplier[i];
        above = qp->value[i] - qp->high[i];
        below = qp->low[i] - qp->value[i];
        excess = above > below ? above : below;
        if (lambda == 0.0 && excess <= 0.0)
            continue;
        if (lambda != 0.0)
            off = lambda * (lambda > 0.0 ? above : below);
        if (qp_soft(qp, i) && excess > 0.0) {
            r->soft += qp->linear[i] * excess + 0.5 * qp->square[i] * excess * excess;
            off = (fabs(lambda) - qp->linear[i] - qp->square[i] * excess) * excess;
        } else if (excess > r->primal) {
            r->primal = excess;
        }
        r->gap = fabs(off) > r->gap ? fabs(off) : r->gap;
    }
}

/** Is what is left of the gradient no more than rounding of its terms? Where rows pull against each other
 * these are larger than what x itself weighs. */
static bool cancels(const struct apc_qp *qp)
{
    const size_t n = qp->n;

    for (size_t i = 0; i < n; i++) {
        double terms = fabs(qp->e[i]) + fabs(qp->f[i]) + fabs(qp->multiplier[i]);

        for (size_t r = 0; r < qp->m; r++)
            terms += fabs(qp->multiplier[n + r] * qp->A[r * n + i]);
        if (!(fabs(qp->g[i]) <= VOUCH * terms))
            return false;
    }
    return true;
}

bool qp_is_sound(const struct apc_qp *qp)
{
    return (qp_is_stationary(qp, VOUCH) || cancels(qp)) && active_rows_hold(qp, 1.0);
}

static void copy_qp_result(struct apc_qp_result *to, const struct apc_qp_result *ours)
{
    size_t size = to ? to->size : 0;

    if (size <= sizeof size)
        return;
    memcpy(to, ours, size < sizeof(*ours) ? size : sizeof(*ours));
    to->size = size;
}

static int refuse_problem(struct apc_qp *qp, double *x, struct apc_qp_result *result,
                          enum apc_qp_status status, int err)
{
    memset(x, 0, qp->n * sizeof(*x));
    copy_qp_result(result, &(struct apc_qp_result){.status = status});
    return err;
}

static inline bool are_limits(const double *low, const double *high)
{
    const apc_lanes from = QP_FOUR(low), to = QP_FOUR(high);
    const apc_masks wrong = ~(from <= to) | ~(from < HUGE_VAL) | ~(to > -HUGE_VAL);

    return !qp_any(&wrong);
}

/** f and limits are numbers, no low above its high. */
QP_LANES static int problem_is_finite(struct apc_qp *qp, const double *f, const double *low,
                                      const double *high)
{
    size_t crossing = qp->rows, rest = qp->rows;

    if (!qp_all_finite(qp->n, f))
        return APC_EINVAL;
    while (rest >= 4 && are_limits(low + rest - 4, high + rest - 4))
        rest -= 4;
    for (size_t i = rest; i-- > 0;) {
        if (low[i] <= high[i] && low[i] < HUGE_VAL && high[i] > -HUGE_VAL)
            continue;
        if (!(low[i] > high[i]) || low[i] == HUGE_VAL || high[i] == -HUGE_VAL)
            return APC_EINVAL;
        crossing = i;
    }
    if (crossing == qp->rows)
        return 0;
    memset(qp->side, 0, qp->rows);
    qp->side[crossing] = 1;
    return APC_ERANGE;
}

int apc_qp_solve(struct apc_qp *qp, const double *f, const double *low, const double *high, double *x,
                 struct apc_qp_result *result)
{
    struct apc_qp_result ours = {.size = sizeof ours};
    int err;

    if (!qp || !x)
        return APC_EINVAL;
    err = qp->ready && f && low && high ? problem_is_finite(qp, f, low, high) : APC_EINVAL;
    if (err)
        return refuse_problem(qp, x, result, err == APC_ERANGE ? APC_QP_INFEASIBLE : APC_QP_NUMBERS, err);
    qp->f = f;
    qp->low = low;
    qp->high = high;
    qp->changes = 0;
    ours.status = qp->proximal ? qp_proximal_point(qp, f, &ours.steps) : qp_solve_definite(qp);
    if (ours.status != APC_QP_OPTIMAL) {
        primal_point(qp);
        publish_multipliers(qp);
        lagrangian_gradient(qp);
        if (qp->proximal)
            qp_proximal_gradient(qp);
    }
    qp->f = f;
    if (ours.status != APC_QP_INFEASIBLE && ours.status != APC_QP_UNBOUNDED)
        for (size_t i = 0; i < qp->rows; i++) { /* of an equation the multiplier says which side it is */
            double at = low[i] == high[i] && qp->multiplier[i] != 0.0 ? qp->multiplier[i] : qp->state[i];

            qp->side[i] = qp->state[i] ? (at > 0.0 ? 1 : -1) : 0;
        }
    ours.iterations = qp->changes;
    measure_solution(qp, &ours);
    if (!qp_all_finite(qp->n, qp->x) || !isfinite(ours.dual)) {
        apc_qp_start(qp, NULL);
        return refuse_problem(qp, x, result, APC_QP_NUMBERS, APC_ESOLVER);
    }
    memcpy(x, qp->x, qp->n * sizeof(*x));
    if (ours.status == APC_QP_OPTIMAL && !qp_is_sound(qp))
        ours.status = APC_QP_NUMBERS;
    for (size_t p = 0; p < qp->waiting;
         p++) /* a solve that ended on the way begins without them the next time */
        qp->state[qp->pending[p].row] = 0;
    copy_qp_result(result, &ours);
    return ours.status == APC_QP_OPTIMAL   ? 0
           : ours.status == APC_QP_LIMIT   ? APC_ETIMEDOUT
           : ours.status == APC_QP_NUMBERS ? APC_ESOLVER
                                           : APC_ERANGE;
}
