/* SPDX-License-Identifier: BSD-3-Clause */
/* The working set of apc_qp: which rows are in it, and M_W M_W' + 1/s = L d L', kept through every change. */
#include "predict/qp_internal.h"

#define DEPENDENT 1e-20 /* of |M_i|^2: what is left of a row beside W when it depends on it */
#define DOUBTFUL  1e-6  /* from here on a difference of squares no longer says what is left */

/** x[j] = b[j] - L_j x for j from @p from to before @p to, each sum as qp_dot() has it. Where b and x are one
 * it is solved in place. An element waits for the one before it, but only within eight. */
static inline void forward_substitute(const double *L, const double *b, double *x, size_t from, size_t to)
{
    while (from < to) {
        const size_t done = from / 8 * 8, end = to < done + 8 ? to : done + 8;
        double sum[8] = {0.0};

        for (size_t j = from; j < end; j++)
            sum[j - done] = qp_dot(done, L + qp_packed(j), x);
        for (size_t j = from; j < end; j++) {
            const double *row = L + qp_packed(j);

            x[j] = b[j] - (sum[j - done] + qp_rest(j - done, row + done, x + done));
        }
        from = end;
    }
}

/** Rows of M that are at @p j, j + 1, ... of W, from the first column on that is not 0 in all of them, which
 * comes back. */
static inline size_t four_rows(const struct apc_qp *qp, size_t j, const double *row[4])
{
    size_t from, first = qp->n;

    for (size_t q = 0; q < 4; q++) {
        row[q] = qp_row(qp, qp->work[j + q], &from);
        first = from < first ? from : first;
    }
    for (size_t q = 0; q < 4; q++)
        row[q] += first;
    return first;
}

/** y = (M_W M_W' + 1/s)^-1 (what L's row k stands for), @p k rows. */
QP_LANES static void back(const struct apc_qp *qp, size_t k, double *y)
{
    for (; k % 4; k--)
        qp_add(k - 1, -y[k - 1], qp->L + qp_packed(k - 1), y);
    for (; k > 0; k -= 4) {
        const double *a = qp->L + qp_packed(k - 1), *b = qp->L + qp_packed(k - 2);
        const double *c = qp->L + qp_packed(k - 3), *d = qp->L + qp_packed(k - 4);
        double *end = y + k - 4, scale[4];

        scale[0] = -end[3];
        end[2] += scale[0] * a[k - 2];
        scale[1] = -end[2];
        end[1] = (end[1] + scale[0] * a[k - 3]) + scale[1] * b[k - 3];
        scale[2] = -end[1];
        end[0] = ((end[0] + scale[0] * a[k - 4]) + scale[1] * b[k - 4]) + scale[2] * c[k - 4];
        scale[3] = -end[0];
        qp_add_each(k - 4, scale, (const double *const[]){a, b, c, d}, y);
    }
}

QP_LANES void qp_working_set_solve(const struct apc_qp *qp, size_t k, double *y)
{
    forward_substitute(qp->L, y, y, 0, k);
    for (size_t j = 0; j < k; j++)
        y[j] *= qp->inverse[j];
    back(qp, k, y);
}

QP_LANES void qp_working_set_right_hand_sides(struct apc_qp *qp, size_t at)
{
    for (size_t j = at; j < qp->k; j++) {
        size_t i = qp->work[j];
        double sign = qp->state[i] > 0 ? 1.0 : -1.0;

        qp->rhs[j] = -(sign > 0.0 ? qp->high[i] : qp->low[i]) - qp_row_dot(qp, i, qp->q);
        if (qp->give[j] > 0.0)
            qp->rhs[j] += sign * qp->linear[i] * qp->give[j];
    }
    if (qp->solved > at)
        qp->solved = at;
}

/** v -= M_W' y of the first @p k rows of W, row after row. */
static inline void subtract_rows(const struct apc_qp *qp, size_t k, const double *y, double *v)
{
    size_t j = 0;

    for (; j + 4 <= k; j += 4) {
        const double scale[4] = {-y[j], -y[j + 1], -y[j + 2], -y[j + 3]}, *row[4];
        const size_t first = four_rows(qp, j, row);

        qp_add_each(qp->n - first, scale, row, v + first);
    }
    for (; j < k; j++)
        qp_row_add(qp, qp->work[j], -y[j], v);
}

/**
 * |M_i|^2 beside W, W being the first @p k rows, by projecting row i itself: twice, as rounding asks for
 * (Giraud, Langou and Rozloznik 2005). A violated soft row of W gives way, and so does not hold the row.
 */
QP_LANES static double left_beside(struct apc_qp *qp, size_t i, size_t k)
{
    double *rest = qp->g, *y = qp->carry, give = 0.0, left;

    memset(rest, 0, qp->n * sizeof(*rest));
    qp_row_add(qp, i, 1.0, rest);
    memcpy(y, qp->L + qp_packed(k), k * sizeof(*y));
    back(qp, k, y);
    subtract_rows(qp, k, y, rest);
    for (size_t j = 0; j < k; j++)
        give += y[j] * y[j] * qp->give[j];
    left = qp_dot(qp->n, rest, rest) + give;
    if (left <= 0.01 * DEPENDENT * qp->size[i] * qp->size[i])
        return left; /* the second time leaves no more */
    for (size_t j = 0; j < k; j++)
        y[j] = qp_row_dot(qp, qp->work[j], rest) - y[j] * qp->give[j];
    qp_working_set_solve(qp, k, y);
    subtract_rows(qp, k, y, rest);
    return qp_dot(qp->n, rest, rest) + give;
}

/** Row i, in the state that it is in, at place k of W. */
static void place_in_working_set(struct apc_qp *qp, size_t k, size_t i)
{
    qp->work[k] = (unsigned)i;
    qp->give[k] = qp->state[i] == 2 || qp->state[i] == -2 ? 1.0 / qp->square[i] : 0.0;
    qp_interval(qp, i, &qp->least[k], &qp->most_of[k]);
}

/** Elements j of row k of L, from @p from to before @p to, each still times d[j]. */
static inline void eliminate(struct apc_qp *qp, size_t k, size_t from, size_t to)
{
    forward_substitute(qp->L, qp->G + qp_packed(k), qp->L + qp_packed(k), from, to);
}

/** Row k of L is eliminated: d[k]. False when nothing is left. */
QP_LANES static bool pivot(struct apc_qp *qp, size_t k)
{
    size_t i = qp->work[k];
    double *row = qp->L + qp_packed(k), give = qp->give[k], gram = qp->G[qp_packed(k) + k],
           left = gram + give;

    left -= qp_scale(k, qp->inverse, row);
    if (left - give < DOUBTFUL * gram)
        left = left_beside(qp, i, k) + give;
    qp->inverse[k] = 1.0 / left;
    return left > DEPENDENT * gram;
}

/** Elements of row k of G from @p from to before @p to. */
static inline void gram(struct apc_qp *qp, size_t k, size_t from, size_t to)
{
    const size_t n = qp->n, i = qp->work[k], own = i < n ? i : 0;
    double *G = qp->G + qp_packed(k);
    size_t zeros;
    const double *row = qp_row(qp, i, &zeros);

    for (size_t j = from; j < to; j++) {
        const size_t o = qp->work[j], bound = o < n && o > own ? o : own;
        size_t first, start;
        const double *other = qp_row(qp, o, &first);

        first = first < zeros ? zeros : first;
        start = bound + (first - bound) / 8 * 8; /* whatever is left out, the lanes are the same */
        G[j] = qp_dot(n - start, row + start, other + start);
    }
}

QP_LANES bool qp_working_set_append(struct apc_qp *qp, size_t i, double lambda)
{
    const size_t k = qp->k;
    const bool known = qp->tried == i;

    if (k >= qp->rows)
        return false;
    place_in_working_set(qp, k, i);
    qp->tried = (unsigned)qp->rows;
    for (size_t j = 0; j < k; j += 8) { /* sums of G while those of L wait for each other */
        const size_t end = j + 8 < k ? j + 8 : k;

        if (!known)
            gram(qp, k, j, end);
        eliminate(qp, k, j, end);
    }
    qp->G[qp_packed(k) + k] = qp->size[i] * qp->size[i];
    if (!pivot(qp, k)) {
        qp->tried = (unsigned)i;
        return false;
    }
    qp->lambda[k] = lambda;
    qp->k = k + 1;
    qp->settled = false;
    qp_working_set_right_hand_sides(qp, k);
    return true;
}

/** memmove() to a lower place, in fours: up to three numbers behind the last one come along. */
static inline void move_down(size_t n, const double *from, double *to)
{
    for (size_t i = 0; i < n; i += 4)
        *(apc_lanes *)(to + i) = QP_FOUR(from + i);
}

/** A packed triangle without row and column @p at; each row has @p diagonal elements more than columns before
 * it. */
QP_LANES static void strike(double *packed, size_t at, size_t k)
{
    for (size_t r = at + 1; r < k; r++) {
        double *to = packed + qp_packed(r - 1);
        const double *row = packed + qp_packed(r);

        move_down(at, row, to);
        move_down(r - at, row + at + 1, to + at);
    }
}

/** Row r from its column @p from on, @p rest being what the columns before left over; then its pivot. */
QP_LANES static double update_factor_row(struct apc_qp *qp, size_t r, size_t from, double rest, double alpha)
{
    double *row = qp->L + qp_packed(r), old = 1.0 / qp->inverse[r];

    for (size_t p = from; p < r; p++) {
        rest -= qp->carry[p] * row[p];
        row[p] += qp->beta[p] * rest;
    }
    qp->carry[r] = rest;
    qp->inverse[r] = 1.0 / (old + alpha * rest * rest);
    qp->beta[r] = alpha * rest * qp->inverse[r];
    return alpha * (old * qp->inverse[r]);
}

/*
 * What row @p at held up, sqrt(d) times its column of L, is given back to the rows behind it: a rank-one
 * update, row after row (Gill, Golub, Murray and Saunders 1974, method C1). Each element waits for the one
 * before it, so four rows go side by side.
 */
QP_LANES static void rank_one_update(struct apc_qp *qp, size_t at, double alpha)
{
    size_t r = at;

    for (; r + 4 <= qp->k; r += 4) {
        double *a = qp->L + qp_packed(r), *b = qp->L + qp_packed(r + 1), *c = qp->L + qp_packed(r + 2);
        double *d = qp->L + qp_packed(r + 3), *rest = qp->carry + r;
        double w = rest[0], x = rest[1], y = rest[2], z = rest[3];

        for (size_t p = at; p < r; p++) {
            double carry = qp->carry[p], beta = qp->beta[p];

            w -= carry * a[p];
            x -= carry * b[p];
            y -= carry * c[p];
            z -= carry * d[p];
            a[p] += beta * w;
            b[p] += beta * x;
            c[p] += beta * y;
            d[p] += beta * z;
        }
        alpha = update_factor_row(qp, r, r, w, alpha);
        alpha = update_factor_row(qp, r + 1, r, x, alpha);
        alpha = update_factor_row(qp, r + 2, r, y, alpha);
        alpha = update_factor_row(qp, r + 3, r, z, alpha);
    }
    for (; r < qp->k; r++)
        alpha = update_factor_row(qp, r, at, qp->carry[r], alpha);
}

QP_LANES void qp_working_set_remove(struct apc_qp *qp, size_t at)
{
    size_t k = qp->k, behind = k - at - 1;
    double alpha = 1.0 / qp->inverse[at];
    double *const of_row[] = {qp->lambda, qp->rhs, qp->inverse, qp->least, qp->most_of, qp->give};

    for (size_t r = at + 1; r < k; r++)
        qp->carry[r - 1] = qp->L[qp_packed(r) + at];
    strike(qp->G, at, qp->tried < qp->rows ? k + 1 : k);
    strike(qp->L, at, k);
    memmove(qp->work + at, qp->work + at + 1, behind * sizeof(*qp->work));
    for (size_t q = 0; q < sizeof of_row / sizeof of_row[0]; q++)
        move_down(behind, of_row[q] + at + 1, of_row[q] + at);
    qp->k = k - 1;
    qp->settled = false;
    if (qp->solved > at)
        qp->solved = at;
    if (qp->fresh > at)
        qp->fresh = at;
    rank_one_update(qp, at, alpha);
}

QP_LANES void qp_working_set_target(struct apc_qp *qp)
{
    forward_substitute(qp->L, qp->rhs, qp->z, qp->solved, qp->k);
    qp->solved = qp->k;
    for (size_t j = 0; j < qp->k; j++)
        qp->target[j] = qp->z[j] * qp->inverse[j];
    back(qp, qp->k, qp->target);
}

void qp_working_set_dual_direction(const struct apc_qp *qp, double *move)
{
    memcpy(move, qp->L + qp_packed(qp->k), qp->k * sizeof(*move));
    back(qp, qp->k, move);
}

QP_LANES void qp_working_set_subtract_rows(const struct apc_qp *qp, const double *lambda, double *v)
{
    size_t j = 0;

    for (; j + 4 <= qp->k; j += 4) { /* rows of J have their zeros */
        const double *row[4];
        const size_t first = four_rows(qp, j, row);

        qp_add_four(qp->n - first, lambda + j, row, v + first);
    }
    for (; j < qp->k; j++)
        qp_row_add(qp, qp->work[j], -lambda[j], v);
}

/** Elements of rows k to k + 3 of L, of the columns before k: the four rows are the four lanes. */
QP_LANES static void eliminate_rows(struct apc_qp *qp, size_t k)
{
    const double *G[4];
    double *L[4], *x = qp->spare;

    for (size_t q = 0; q < 4; q++) {
        G[q] = qp->G + qp_packed(k + q);
        L[q] = qp->L + qp_packed(k + q);
    }
    for (size_t j = 0; j < k; j++) {
        const double *row = qp->L + qp_packed(j);
        apc_lanes sum[8] = {{0.0}}, rest = {0.0, 0.0, 0.0, 0.0}, own = {G[0][j], G[1][j], G[2][j], G[3][j]};
        size_t i = 0;

        for (; i + 8 <= j; i += 8)
            for (size_t l = 0; l < 8; l++) /* the lanes of qp_dot() */
                sum[l] += row[i + l] * QP_FOUR(x + 4 * (i + l));
        for (; i < j; i++)
            rest += row[i] * QP_FOUR(x + 4 * i);
        own -= ((((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]))) + rest);
        *(apc_lanes *)(x + 4 * j) = own;
        for (size_t q = 0; q < 4; q++)
            L[q][j] = own[q];
    }
}

/** G as it is with W in the order of its rows; row r of W was at was[r]. */
static void reorder(struct apc_qp *qp, size_t from, size_t k, const unsigned *was)
{
    for (size_t r = from; r < k; r++) {
        const size_t a = was[r];
        const double *row = qp->G + qp_packed(a);
        double *to = qp->spare + qp_packed(r);

        for (size_t c = 0; c <= r; c++)
            to[c] = was[c] < a ? row[was[c]] : qp->G[qp_packed(was[c]) + a];
    }
    memcpy(qp->G + qp_packed(from), qp->spare + qp_packed(from),
           (qp_packed(k) - qp_packed(from)) * sizeof(*qp->G));
}

QP_LANES void qp_working_set_settle(struct apc_qp *qp)
{
    size_t k = 0, same = 0;
    unsigned *was = qp->order + qp->rows;

    memcpy(qp->beta, qp->lambda, qp->k * sizeof(*qp->beta));
    memcpy(qp->carry, qp->rhs, qp->k * sizeof(*qp->carry));
    for (size_t j = 0; j < qp->k; j++)
        qp->order[qp->work[j]] = (unsigned)j;
    for (size_t i = 0; i < qp->rows; i++)
        if (qp->state[i] && qp->fixed[i] == 0.0) {
            if (k == same && k < qp->fresh && qp->work[k] == i)
                same++;
            was[k] = qp->order[i];
            place_in_working_set(qp, k++, i);
        }
    for (size_t r = same; r < k; r++) {
        qp->lambda[r] = qp->beta[was[r]];
        qp->rhs[r] = qp->carry[was[r]];
    }
    reorder(qp, same, k, was);
    qp->tried = (unsigned)qp->rows;
    for (size_t r = same; r < k; r += 4) {
        const size_t end = r + 4 < k ? r + 4 : k;

        if (r + 4 <= k)
            eliminate_rows(qp, r);
        for (size_t q = r; q < end; q++) {
            eliminate(qp, q, r + 4 <= k ? r : 0, q);
            (void)pivot(qp, q);
        }
    }
    if (qp->solved > same)
        qp->solved = same;
    qp->fresh = k;
    qp->settled = true;
}
