/* SPDX-License-Identifier: BSD-3-Clause */
/* The working set of apc_qp: which rows are in it, and M_W M_W' + 1/s = L d L', kept through every change. */
#include "predict/qp_internal.h"

#define DEPENDENT 1e-20 /* of |M_i|^2: what is left of a row beside W when it depends on it */
#define DOUBTFUL  1e-6  /* from here on a difference of squares no longer says what is left */

/** y = (M_W M_W' + 1/s)^-1 (what L's row k stands for), @p k rows. */
QP_LANES static void back(const struct apc_qp *qp, size_t k, double *y)
{
    for (size_t j = k; j-- > 1;)
        qp_add(j, -y[j], qp->L + qp_packed(j), y);
}

QP_LANES void qp_work_solve(const struct apc_qp *qp, size_t k, double *y)
{
    for (size_t j = 0; j < k; j++)
        y[j] -= qp_dot(j, qp->L + qp_packed(j), y);
    for (size_t j = 0; j < k; j++)
        y[j] *= qp->inverse[j];
    back(qp, k, y);
}

QP_LANES void qp_work_sides(struct apc_qp *qp, size_t at)
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

/**
 * |M_i|^2 beside W, W being the first @p k rows, by projecting row i itself: twice, as rounding asks for
 * (Giraud, Langou and Rozloznik 2005). A violated soft row of W gives way, and so does not hold the row.
 */
QP_LANES static double left_beside(struct apc_qp *qp, size_t i, size_t k)
{
    double *rest = qp->g, *y = qp->carry, give = 0.0;

    memset(rest, 0, qp->n * sizeof(*rest));
    qp_row_add(qp, i, 1.0, rest);
    memcpy(y, qp->L + qp_packed(k), k * sizeof(*y));
    back(qp, k, y);
    for (int round = 0;; round++) {
        for (size_t j = 0; j < k; j++)
            qp_row_add(qp, qp->work[j], -y[j], rest);
        if (round == 1)
            break;
        for (size_t j = 0; j < k; j++) {
            give += y[j] * y[j] * qp->give[j];
            y[j] = qp_row_dot(qp, qp->work[j], rest) - y[j] * qp->give[j];
        }
        qp_work_solve(qp, k, y);
    }
    return qp_dot(qp->n, rest, rest) + give;
}

/** Row i, in the state that it is in, at place k of W. */
static void place(struct apc_qp *qp, size_t k, size_t i)
{
    qp->work[k] = (unsigned)i;
    qp->give[k] = qp->state[i] == 2 || qp->state[i] == -2 ? 1.0 / qp->square[i] : 0.0;
    qp_interval(qp, i, &qp->least[k], &qp->most_of[k]);
}

/** Elements j of row k of L, from @p from to before @p to, each still times d[j]. */
static inline void eliminate(struct apc_qp *qp, size_t k, size_t from, size_t to)
{
    double *row = qp->L + qp_packed(k);
    const double *gram = qp->G + qp_packed(k);

    for (size_t j = from; j < to; j++)
        row[j] = gram[j] - qp_dot(j, qp->L + qp_packed(j), row);
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

QP_LANES bool qp_work_append(struct apc_qp *qp, size_t i, double lambda)
{
    size_t k = qp->k, from;
    const double *row = qp_row(qp, i, &from);
    double *gram = qp->G + qp_packed(k);

    if (k >= qp->rows)
        return false;
    place(qp, k, i);
    for (size_t j = 0; j < k; j++) {
        size_t start;
        const double *other = qp_row(qp, qp->work[j], &start);

        if (start < from)
            start = from;
        gram[j] = qp_dot(qp->n - start, row + start, other + start);
    }
    gram[k] = qp->size[i] * qp->size[i];
    eliminate(qp, k, 0, k);
    if (!pivot(qp, k))
        return false;
    qp->lambda[k] = lambda;
    qp->k = k + 1;
    qp->settled = false;
    qp_work_sides(qp, k);
    return true;
}

/** A packed triangle without row and column @p at; each row has @p diagonal elements more than columns before
 * it. */
static void strike(double *packed, size_t at, size_t k)
{
    for (size_t r = at + 1; r < k; r++) {
        double *to = packed + qp_packed(r - 1);
        const double *row = packed + qp_packed(r);

        memmove(to, row, at * sizeof(*to));
        memmove(to + at, row + at + 1, (r - at) * sizeof(*to));
    }
}

/** Row r from its column @p from on, @p rest being what the columns before left over; then its pivot. */
static double give_row(struct apc_qp *qp, size_t r, size_t from, double rest, double alpha)
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
QP_LANES static void give_back(struct apc_qp *qp, size_t at, double alpha)
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
        alpha = give_row(qp, r, r, w, alpha);
        alpha = give_row(qp, r + 1, r, x, alpha);
        alpha = give_row(qp, r + 2, r, y, alpha);
        alpha = give_row(qp, r + 3, r, z, alpha);
    }
    for (; r < qp->k; r++)
        alpha = give_row(qp, r, at, qp->carry[r], alpha);
}

void qp_work_remove(struct apc_qp *qp, size_t at)
{
    size_t k = qp->k, behind = k - at - 1;
    double alpha = 1.0 / qp->inverse[at];

    for (size_t r = at + 1; r < k; r++)
        qp->carry[r - 1] = qp->L[qp_packed(r) + at];
    strike(qp->G, at, k);
    strike(qp->L, at, k);
    memmove(qp->work + at, qp->work + at + 1, behind * sizeof(*qp->work));
    memmove(qp->lambda + at, qp->lambda + at + 1, behind * sizeof(*qp->lambda));
    memmove(qp->rhs + at, qp->rhs + at + 1, behind * sizeof(*qp->rhs));
    memmove(qp->inverse + at, qp->inverse + at + 1, behind * sizeof(*qp->inverse));
    memmove(qp->least + at, qp->least + at + 1, behind * sizeof(*qp->least));
    memmove(qp->most_of + at, qp->most_of + at + 1, behind * sizeof(*qp->most_of));
    memmove(qp->give + at, qp->give + at + 1, behind * sizeof(*qp->give));
    qp->k = k - 1;
    qp->settled = false;
    if (qp->solved > at)
        qp->solved = at;
    if (qp->fresh > at)
        qp->fresh = at;
    give_back(qp, at, alpha);
}

QP_LANES void qp_work_target(struct apc_qp *qp)
{
    for (size_t j = qp->solved; j < qp->k; j++)
        qp->z[j] = qp->rhs[j] - qp_dot(j, qp->L + qp_packed(j), qp->z);
    qp->solved = qp->k;
    for (size_t j = 0; j < qp->k; j++)
        qp->target[j] = qp->z[j] * qp->inverse[j];
    back(qp, qp->k, qp->target);
}

void qp_work_against(const struct apc_qp *qp, double *move)
{
    memcpy(move, qp->L + qp_packed(qp->k), qp->k * sizeof(*move));
    back(qp, qp->k, move);
}

QP_LANES void qp_work_pull(const struct apc_qp *qp, const double *lambda, double *v)
{
    size_t n = qp->n, j = 0;

    for (; j + 4 <= qp->k; j += 4) { /* rows of J have their zeros */
        size_t from[4], first = n;
        const double *row[4];

        for (size_t q = 0; q < 4; q++) {
            row[q] = qp_row(qp, qp->work[j + q], &from[q]);
            first = from[q] < first ? from[q] : first;
        }
        qp_add_four(n - first, lambda + j, row, first, v + first);
    }
    for (; j < qp->k; j++)
        qp_row_add(qp, qp->work[j], -lambda[j], v);
}

QP_LANES void qp_work_settle(struct apc_qp *qp)
{
    size_t k = 0, same = 0;

    /* value has room for the place of each row: nobody needs it before it is made anew. */
    memcpy(qp->beta, qp->lambda, qp->k * sizeof(*qp->beta));
    memcpy(qp->carry, qp->rhs, qp->k * sizeof(*qp->carry));
    for (size_t j = 0; j < qp->k; j++)
        qp->value[qp->work[j]] = (double)j;
    for (size_t i = 0; i < qp->rows; i++)
        if (qp->state[i] && qp->fixed[i] == 0.0) {
            if (k == same && k < qp->fresh && qp->work[k] == i)
                same++;
            place(qp, k++, i);
        }
    for (size_t r = same; r < k; r++) {
        size_t a = (size_t)qp->value[qp->work[r]];

        qp->lambda[r] = qp->beta[a];
        qp->rhs[r] = qp->carry[a];
        for (size_t c = 0; c <= r; c++) {
            size_t b = (size_t)qp->value[qp->work[c]];

            qp->spare[qp_packed(r) + c] = qp->G[a > b ? qp_packed(a) + b : qp_packed(b) + a];
        }
    }
    memcpy(qp->G + qp_packed(same), qp->spare + qp_packed(same),
           (qp_packed(k) - qp_packed(same)) * sizeof(*qp->G));
    for (size_t r = same; r < k;
         r += 4) { /* each element waits for the one before it: four rows side by side */
        size_t end = r + 4 < k ? r + 4 : k;

        for (size_t j = 0; j < r; j++)
            for (size_t q = r; q < end; q++)
                eliminate(qp, q, j, j + 1);
        for (size_t q = r; q < end; q++) {
            eliminate(qp, q, r, q);
            (void)pivot(qp, q);
        }
    }
    if (qp->solved > same)
        qp->solved = same;
    qp->fresh = k;
    qp->settled = true;
}
