/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc_qp where H is singular: proximal points. The problem of a step is that of H + E with the gradient f - E c.
 * It is strictly convex, so the dual method solves it; what E adds to the gradient, E (x - c), is the dual
 * residual of x in the problem itself. Along an eigenvector of H whose value is h of E's a step leaves 1 / (1 + h)
 * of the way. So steps end at once but where h is small; there, or where H does not hold x at all, they become
 * parallel, and one goes all the way: to the least value on that line, or the first limit. Where neither stands
 * in the way the objective falls for ever, and the step is the certificate.
 *
 * c is 0 at first: what comes back does not depend on the solve before.
 */
#include "predict/qp_internal.h"

#define SHARE    1e-5  /* of E in H */
#define MORE     100.0 /* times as much, where rounding was in the way of an answer */
#define MOST     1e-1
#define FLOOR    1e-2  /* of the largest scale of a variable: the least */
#define ROUNDING 1e3   /* times n DBL_EPSILON: of H's diagonal, what its pivots may be below zero */
#define GOAL     1e-10 /* dual residual, of its terms, at which steps end */
#define WEAK     1e-2  /* of E: H, along a step */
#define LEVEL    1e-10 /* what a row changes along a direction, of its terms, where it does not change */
#define STEPS    200   /* at the most */

/** What a variable counts in E: as in H, or, where it is not in it, by its column of A. */
static void scale_shift(struct apc_qp *qp)
{
    const size_t n = qp->n;
    double most = 0.0, widest = 0.0;

    for (size_t i = 0; i < n; i++) {
        double width = 0.0;

        for (size_t r = 0; r < qp->m; r++)
            width += qp->A[r * n + i] * qp->A[r * n + i];
        qp->shift[i] = width;
        widest = width > widest ? width : widest;
        most = fabs(qp->own[i]) > most ? fabs(qp->own[i]) : most;
    }
    if (most == 0.0)
        most = 1.0;
    for (size_t i = 0; i < n; i++) {
        double scale = qp->own[i] / most;

        if (scale <= (double)n * DBL_EPSILON)
            scale = widest > 0.0 && qp->shift[i] > 0.0 ? qp->shift[i] / widest : 1.0;
        qp->root[i] = sqrt(most * scale);
        qp->shift[i] = SHARE * most * (scale > FLOOR ? scale : FLOOR);
    }
    qp->share = SHARE;
}

static size_t factor_with(struct apc_qp *qp, double share)
{
    const size_t n = qp->n;

    for (size_t i = 0; i < n; i++)
        qp->H[i * n + i] = qp->own[i] + share * qp->shift[i];
    return qp_invert(qp, 0.0);
}

size_t qp_proximal_factor(struct apc_qp *qp)
{
    const size_t n = qp->n;
    size_t pivot;

    for (size_t i = 0; i < n; i++)
        qp->own[i] = qp->H[i * n + i];
    scale_shift(qp);
    pivot = factor_with(qp, ROUNDING * (double)n * DBL_EPSILON / SHARE);
    return pivot ? pivot : factor_with(qp, 1.0);
}

/** The same H with another share of E. The working set stays. */
static void change_share(struct apc_qp *qp, double share)
{
    const double times = share / qp->share;

    for (size_t i = 0; i < qp->n; i++)
        qp->shift[i] *= times;
    qp->share = share;
    (void)factor_with(qp, 1.0);
    qp_transform(qp);
    qp->k = qp->rows + 1;
}

QP_LANES double qp_gradient_scale(const struct apc_qp *qp)
{
    const size_t n = qp->n;
    double most = 0.0;

    for (size_t i = 0; i < n; i++) {
        double terms = fabs(qp->f[i]) + fabs(qp->multiplier[i]);

        for (size_t j = 0; j < n; j++)
            terms += fabs(qp->H[i * n + j] * qp->x[j]);
        for (size_t r = 0; r < qp->m; r++)
            terms += fabs(qp->multiplier[n + r] * qp->A[r * n + i]);
        most = terms > most * qp->root[i] ? terms / qp->root[i] : most;
    }
    return most;
}

void qp_proximal_gradient(struct apc_qp *qp)
{
    for (size_t i = 0; i < qp->n; i++) {
        qp->g[i] -= qp->shift[i] * (qp->x[i] - qp->centre[i]);
        qp->e[i] -= qp->shift[i] * qp->x[i];
    }
}

/** Is the working set that of the step before? It is kept for the next one. */
static bool is_same_working_set(struct apc_qp *qp)
{
    const bool same = memcmp(qp->former, qp->state, qp->rows) == 0;

    memcpy(qp->former, qp->state, qp->rows);
    return same;
}

/** How much row i changes along the way, 0 where that is rounding; *@p value is what it is at the centre. */
static double row_along(const struct apc_qp *qp, size_t i, double *value)
{
    const size_t n = qp->n;
    double along = 0.0, terms = 0.0;

    if (i < n) {
        *value = qp->centre[i];
        return sqrt(qp->shift[i]) * fabs(qp->way[i]) > LEVEL * qp->length ? qp->way[i] : 0.0;
    }
    *value = qp_dot(n, qp->A + (i - n) * n, qp->centre);
    for (size_t j = 0; j < n; j++) {
        const double term = qp->A[(i - n) * n + j] * qp->way[j];

        along += term;
        terms += fabs(term);
    }
    return fabs(along) > LEVEL * terms ? along : 0.0;
}

/** v'Hv, 0 where that is rounding; *@p length is v'Ev. */
QP_LANES static double curvature_along(const struct apc_qp *qp, const double *v, double *length)
{
    const size_t n = qp->n;
    double curvature = 0.0, size = 0.0;

    *length = 0.0;
    for (size_t i = 0; i < n; i++) {
        curvature += v[i] * (qp_dot(n, qp->H + i * n, v) - qp->shift[i] * v[i]);
        size += sqrt(qp->H[i * n + i]) * fabs(v[i]);
        *length += qp->shift[i] * v[i] * v[i];
    }
    return curvature > 8.0 * (double)n * DBL_EPSILON * size * size ? curvature : 0.0;
}

/** Of the way, along which the objective falls by @p slope at first and bends by @p curvature: how much of it leads to
 * the least value; *@p end where the first limit is that does not hold x already. */
static double least_along(const struct apc_qp *qp, double slope, double curvature, double *end)
{
    *end = HUGE_VAL;
    for (size_t i = 0; i < qp->rows; i++) {
        const double limits[2] = {qp->low[i], qp->high[i]};
        double along, value;

        if (qp->state[i] == 1 || qp->state[i] == -1 || (limits[0] == -HUGE_VAL && limits[1] == HUGE_VAL))
            continue;
        along = row_along(qp, i, &value);
        if (qp->state[i])
            curvature += qp->square[i] * along * along;
        for (size_t q = 0; q < 2 && along != 0.0; q++) {
            const double far = (limits[q] - value) / along;

            if (far > 0.0 && far < *end)
                *end = far;
        }
    }
    return curvature > 0.0 ? slope / curvature : HUGE_VAL;
}

/** The variables that run off. */
static void unboundedness_certificate(struct apc_qp *qp)
{
    double most = 0.0;

    memset(qp->side, 0, qp->rows);
    for (size_t i = 0; i < qp->n; i++)
        most = fabs(qp->way[i]) > most ? fabs(qp->way[i]) : most;
    for (size_t i = 0; i < qp->n; i++)
        if (fabs(qp->way[i]) > LEVEL * most)
            qp->side[i] = qp->way[i] > 0.0 ? 1 : -1;
}

/**
 * The next centre, in the working set of the step before: conjugate gradients, of which the step is the
 * preconditioned one. Where H is weak beside E along the step, it is first seen whether that is so because the other
 * parts of the step have not died away yet. False where the objective falls for ever.
 */
static bool next_centre(struct apc_qp *qp)
{
    const size_t n = qp->n;
    double *move = qp->move, length, curvature, slope, share, least, end;

    for (size_t i = 0; i < n; i++)
        move[i] = qp->x[i] - qp->centre[i];
    curvature = curvature_along(qp, move, &length);
    slope = length + curvature;
    share = qp->fell > 0.0 ? slope / qp->fell : 0.0;
    if (curvature < WEAK * length && curvature < 0.5 * qp->bent * length) {
        qp->bent = curvature / length;
        qp->fell = 0.0;
        memcpy(qp->centre, qp->x, n * sizeof(*qp->x));
        return true;
    }
    if (curvature < WEAK * length)
        qp->bent = 0.0;
    for (size_t i = 0; i < n; i++)
        qp->way[i] = move[i] + share * qp->way[i];
    if (share > 0.0)
        curvature = curvature_along(qp, qp->way, &length);
    qp->length = sqrt(length);
    least = least_along(qp, slope, curvature, &end);
    if (least == HUGE_VAL && end == HUGE_VAL)
        return false;
    qp->fell = least <= end ? slope : 0.0;
    if (least > end && share > 0.0)
        memcpy(qp->centre, qp->x, n * sizeof(*qp->x)); /* the step itself is within all limits */
    else
        for (size_t i = 0; i < n; i++)
            qp->centre[i] += (least <= end ? least : end) * qp->way[i];
    return true;
}

/** All steps with one E. */
static enum apc_qp_status step_to_optimum(struct apc_qp *qp, const double *f, unsigned *steps)
{
    const size_t n = qp->n;

    memset(qp->centre, 0, n * sizeof(*qp->centre));
    memset(qp->former, 3, qp->rows); /* no state */
    for (unsigned step = 1;; step++) {
        enum apc_qp_status status;

        for (size_t i = 0; i < n; i++)
            qp->slope[i] = f[i] - qp->shift[i] * qp->centre[i];
        qp->f = qp->slope;
        status = qp_solve_definite(qp);
        ++*steps;
        if (status != APC_QP_OPTIMAL)
            return status;
        qp->f = f;
        qp_proximal_gradient(qp);
        if (qp_is_stationary(qp, GOAL) || step == STEPS)
            return APC_QP_OPTIMAL; /* or what is left is looked at, as after every solve */
        if (!is_same_working_set(qp)) {
            qp->fell = 0.0;
            qp->bent = HUGE_VAL;
            memcpy(qp->centre, qp->x, n * sizeof(*qp->x));
        } else if (!next_centre(qp)) {
            unboundedness_certificate(qp);
            return APC_QP_UNBOUNDED;
        }
    }
}

enum apc_qp_status qp_proximal_point(struct apc_qp *qp, const double *f, unsigned *steps)
{
    unsigned changes = 0;
    enum apc_qp_status status;

    if (qp->share != SHARE)
        change_share(qp, SHARE);
    for (;;) {
        status = step_to_optimum(qp, f, steps);
        changes += qp->changes;
        if (status == APC_QP_UNBOUNDED || (status == APC_QP_OPTIMAL && qp_is_sound(qp)) ||
            (status == APC_QP_LIMIT && qp->limited) || (qp->enough && qp->enough(qp->ctx)) ||
            qp->share >= MOST)
            break;
        qp->changes = 0; /* no answer, for rounding; that rows contradict may be rounding as well */
        apc_qp_start(qp, NULL);
        change_share(qp, MORE * qp->share);
    }
    qp->changes = changes;
    return status;
}
