/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A steady state satisfies (I - A) x - B u = e, where e is what disturbances do. With the QR decomposition of
 * the transposed coefficients, M' = (Q1 Q2) (R; 0), all of them are Q1 R'^-1 e + Q2 z: as many free numbers z
 * as inputs, integrating plants included. What is sought is z.
 */
#include "predict/target.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/matrix.h"
#include "base/parts.h"

/* Of two inputs' weights, where their units are far apart. */
#define LEAST_SHARE 1e-8

struct apc_target {
    struct apc_linear *model;
    size_t nc, n; /* states that inputs move; of x and u together */
    double *Q;    /* [n * n], then R of [n * nc] */
    double *R;
    double *rows; /* [(nu + ny) * nu] of z: u, then y */
    double *H, *f, *z, *found;
    double largest;          /* of the weights that were given */
    bool loose;              /* setpoints leave some u free */
    double *weight;          /* [nu] */
    double *point, *e;       /* [n], [nc] */
    double *low, *high;      /* [nu + nu + ny] z is free; then rows */
    double *square, *linear; /* [nu + nu + ny] */
    double *y;               /* [ny] where z = 0 */
    double *drift;           /* [nc] */
    double *reach, *moved;   /* [nu] of a search: how far a step may go, how far the last one went */
    double *longer;          /* [nu] by how much the next step may be */
    double *lowest, *highest;
    double *from_x, *from_u; /* [nc], [nu] */
    struct apc_qp *qp;
    double *memory;
};

/* y of (x, u), deviations both. */
static double output(const struct apc_linear *m, size_t c, const double *point, size_t stride)
{
    const size_t nc = m->nx_plant + m->nx_held, inputs = m->nu + m->nd;
    double sum = 0.0;

    for (size_t i = 0; i < nc; i++)
        sum += m->C[c * m->nx + i] * point[i * stride];
    for (size_t j = 0; j < m->nu; j++)
        sum += m->D[c * inputs + j] * point[(nc + j) * stride];
    return sum;
}

/* From the model as it is now. */
static int target_rows(struct apc_target *t, struct apc_error *why)
{
    const struct apc_linear *m = t->model;
    const size_t nc = t->nc, n = t->n, nu = m->nu, inputs = nu + m->nd;

    for (size_t i = 0; i < nc; i++) {
        for (size_t j = 0; j < nc; j++)
            t->R[j * nc + i] = (i == j ? 1.0 : 0.0) - m->A[i * m->nx + j];
        for (size_t j = 0; j < nu; j++)
            t->R[(nc + j) * nc + i] = -m->B[i * inputs + j];
    }
    if (apc_matrix_decompose(n, nc, t->R, t->Q, t->point))
        return apc_fail(
            why, APC_EINVAL,
            "the model has no steady state for some disturbance: a state that integrates is moved by no "
            "input");
    for (size_t j = 0; j < nu; j++) {
        for (size_t k = 0; k < nu; k++)
            t->rows[j * nu + k] = t->Q[(nc + j) * n + nc + k];
    }
    for (size_t c = 0; c < m->ny; c++) {
        for (size_t k = 0; k < nu; k++)
            t->rows[(nu + c) * nu + k] = output(m, c, t->Q + nc + k, n);
    }
    return 0;
}

static int fill_target_rows(struct apc_target *t, struct apc_error *why)
{
    const size_t nu = t->model->nu;
    const struct apc_qp_options options = {.size = sizeof(options), .definite = true};
    int rc = target_rows(t, why);

    for (size_t k = 0; k < nu; k++) {
        t->low[k] = -HUGE_VAL;
        t->high[k] = HUGE_VAL;
    }
    return rc == 0 ? apc_qp_create(&t->qp, nu, nu + t->model->ny, &options, why) : rc;
}

int apc_target_create(struct apc_target **target, struct apc_linear *model, struct apc_error *why)
{
    const size_t nu = model->nu, ny = model->ny, nc = model->nx_plant + model->nx_held, n = nc + nu;
    struct apc_target *t = calloc(1, sizeof(*t));
    int rc = 0;

    *target = NULL;
    if (!t)
        return apc_fail(why, APC_ENOMEM, "steady states: no memory");
    *t = (struct apc_target){.model = model, .nc = nc, .n = n};
    const struct apc_part parts[] = {APC_PART(t->Q, n * n),
                                     APC_PART(t->R, n * nc),
                                     APC_PART(t->rows, (nu + ny) * nu),
                                     APC_PART(t->H, nu * nu),
                                     APC_PART(t->f, nu),
                                     APC_PART(t->z, nu),
                                     APC_PART(t->found, nu),
                                     APC_PART(t->weight, nu),
                                     APC_PART(t->reach, nu),
                                     APC_PART(t->moved, nu),
                                     APC_PART(t->longer, nu),
                                     APC_PART(t->lowest, nu),
                                     APC_PART(t->highest, nu),
                                     APC_PART(t->drift, nc),
                                     APC_PART(t->from_x, nc),
                                     APC_PART(t->from_u, nu),
                                     APC_PART(t->point, n),
                                     APC_PART(t->e, nc),
                                     APC_PART(t->low, 2 * nu + ny),
                                     APC_PART(t->high, 2 * nu + ny),
                                     APC_PART(t->square, 2 * nu + ny),
                                     APC_PART(t->linear, 2 * nu + ny),
                                     APC_PART(t->y, ny)};

    t->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    rc = t->memory ? fill_target_rows(t, why) : apc_fail(why, APC_ENOMEM, "steady states: no memory");
    if (rc < 0)
        apc_target_destroy(t);
    else
        *target = t;
    return rc;
}

void apc_target_destroy(struct apc_target *target)
{
    if (!target)
        return;
    apc_qp_destroy(target->qp);
    free(target->memory);
    free(target);
}

/* H, and the program, from weights and rows. */
static int weigh_target(struct apc_target *t, struct apc_error *why)
{
    const size_t nu = t->model->nu;
    double known = 0.0;

    memset(t->H, 0, nu * nu * sizeof(*t->H));
    for (size_t j = 0; j < nu; j++) {
        for (size_t a = 0; a < nu; a++) {
            for (size_t b = 0; b < nu; b++)
                t->H[a * nu + b] += t->weight[j] * t->rows[j * nu + a] * t->rows[j * nu + b];
        }
    }
    /* u may say nothing of a combination of z: an integrating state at rest is anywhere. Where setpoints
     * leave u free this has a say, which must not hang on units. */
    for (size_t a = 0; a < nu; a++)
        known += t->H[a * nu + a];
    for (size_t c = 0; c < t->model->ny; c++) {
        const double *row = t->rows + (nu + c) * nu, size = apc_matrix_dot(row, row, nu);
        const double share =
            t->loose && known > 0.0 && size > 0.0 ? 1e-9 * known / size : 1e-9 * fmax(t->largest, 1.0);

        for (size_t a = 0; a < nu; a++) {
            for (size_t b = 0; b < nu; b++)
                t->H[a * nu + b] += share * row[a] * row[b];
        }
    }
    return apc_qp_set(t->qp, t->H, t->rows, why);
}

int apc_target_tune(struct apc_target *t, size_t sought, const double *r, const double *s,
                    struct apc_error *why)
{
    const size_t nu = t->model->nu;
    double dearest = 0.0;

    t->loose = sought < nu;
    t->largest = 0.0;
    for (size_t j = 0; j < nu; j++) {
        t->largest = fmax(t->largest, r[j]);
        dearest = fmax(dearest, s[j]);
    }
    for (size_t j = 0; j < nu;
         j++) { /* where setpoints leave u free, it stays near its reference all the same */
        const double share = dearest > 0.0 ? fmax(s[j] / dearest, LEAST_SHARE) : 1.0;

        t->weight[j] = fmax(r[j], (t->largest > 0.0 ? 1e-6 * t->largest : 1.0) * share);
    }
    return weigh_target(t, why);
}

/* The point of z = 0: least of all steady states under these disturbances. */
static void origin(struct apc_target *t, const struct apc_target_call *call)
{
    const struct apc_linear *m = t->model;
    const size_t nc = t->nc, n = t->n, unknown = m->nx - nc, inputs = m->nu + m->nd;

    for (size_t i = 0; i < nc; i++) {
        double e = call->drift ? call->drift[i] : 0.0;

        for (size_t k = 0; k < unknown; k++)
            e += m->A[i * m->nx + nc + k] * (call->unknown[k] - m->x0[nc + k]);
        for (size_t k = 0; k < m->nd; k++)
            e += m->B[i * inputs + m->nu + k] * (call->d[k] - m->u0[m->nu + k]);
        for (size_t k = 0; k < i; k++) /* R' is lower triangular */
            e -= t->R[k * nc + i] * t->e[k];
        t->e[i] = e / t->R[i * nc + i];
    }
    for (size_t i = 0; i < n; i++) {
        t->point[i] = 0.0;
        for (size_t k = 0; k < nc; k++)
            t->point[i] += t->Q[i * n + k] * t->e[k];
    }
    for (size_t c = 0; c < m->ny; c++) {
        t->y[c] = m->y0[c] + output(m, c, t->point, 1);
        for (size_t k = 0; k < unknown; k++)
            t->y[c] += m->C[c * m->nx + nc + k] * (call->unknown[k] - m->x0[nc + k]);
        for (size_t k = 0; k < m->nd; k++)
            t->y[c] += m->D[c * inputs + m->nu + k] * (call->d[k] - m->u0[m->nu + k]);
    }
}

/* How much more a distance from a setpoint is to count than one from a reference. Solving again, from where that
 * led, takes away what the reference has pulled. */
enum { AGAIN = 3 };
/* What is allowed to a rank beyond what it has reached, over the size of y; where the ranks after it find
 * nothing there, more. */
#define LITTLE 1e-9
#define MUCH   1e-4

static double stress(const struct apc_target *t, const double *q)
{
    const size_t nu = t->model->nu;
    double references = 0.0, setpoints = 0.0;

    for (size_t k = 0; k < nu; k++)
        references += t->H[k * nu + k];
    for (size_t c = 0; c < t->model->ny; c++)
        setpoints += q[c] * apc_matrix_dot(t->rows + (nu + c) * nu, t->rows + (nu + c) * nu, nu);
    return setpoints > 0.0 ? 1e4 * references / setpoints : 1.0;
}

/* The next solve begins from where the last one that had an answer led. */
static void pull_to_found(struct apc_target *t)
{
    const size_t nu = t->model->nu;

    apc_matrix_multiply(nu, nu, 1, t->H, t->found, t->f);
    for (size_t i = 0; i < nu; i++)
        t->f[i] = -t->f[i];
}

/* As near as can be, into found, which is as it was where there is no answer. */
static int approach(struct apc_target *t)
{
    int rc = 0;

    for (int k = 0; k < AGAIN && rc == 0; k++) {
        rc = apc_qp_solve(t->qp, t->f, t->low, t->high, t->z, NULL);
        if (rc < 0)
            return k > 0 ? 0 : rc;
        memcpy(t->found, t->z, t->model->nu * sizeof(*t->z));
        pull_to_found(t);
    }
    return 0;
}

/* Rows of ranks from @p first to @p last: what they have reached is their limit, with some room. */
static void hold_ranks(struct apc_target *t, const struct apc_target_call *call, unsigned first,
                       unsigned last, double share)
{
    const size_t nu = t->model->nu;
    double *low = t->low + 2 * nu, *high = t->high + 2 * nu;

    for (size_t c = 0; c < t->model->ny; c++) {
        const double y = apc_matrix_dot(t->rows + (nu + c) * nu, t->found, nu),
                     room = share * (1.0 + fabs(y));

        if (call->rank[c] < first || call->rank[c] > last || !(call->q[c] > 0.0))
            continue;
        low[c] = fmin(low[c], y - room);
        high[c] = fmax(high[c], y + room);
        t->square[2 * nu + c] = 0.0;
    }
}

/* Rank by rank: what a rank has reached is a limit to those after it. That may leave so little that rounding
 * does not find it: then some more, and in the end the ranks from there on wait. */
static int relax_target_by_rank(struct apc_target *t, const struct apc_target_call *call)
{
    const size_t nu = t->model->nu, ny = t->model->ny;
    double *low = t->low + 2 * nu, *high = t->high + 2 * nu, *square = t->square + 2 * nu;
    const double factor = stress(t, call->q);
    double room;
    int rc;

    for (unsigned rank = 1; rank <= call->ranks; rank++) {
        for (size_t c = 0; c < ny; c++) {
            if (call->rank[c] < rank)
                continue;
            square[c] = call->rank[c] == rank ? factor * call->q[c] : 0.0;
            low[c] = square[c] > 0.0 ? call->y_low[c] - t->y[c] : -HUGE_VAL;
            high[c] = square[c] > 0.0 ? call->y_high[c] - t->y[c] : HUGE_VAL;
        }
        (void)apc_qp_soft(t->qp, t->linear, t->square);
        rc = approach(t);
        room = LITTLE;
        while (rc < 0 && rank > 1 && room < MUCH / 2.0) {
            room *= 10.0;
            hold_ranks(t, call, 1, rank - 1, room);
            rc = approach(t);
        }
        if (rc < 0 && rank == 1)
            return rc;
        if (rc < 0)
            break;
        hold_ranks(t, call, rank, rank, LITTLE);
    }
    memcpy(t->z, t->found, nu * sizeof(*t->z));
    return 0;
}

int apc_target_find(struct apc_target *t, const struct apc_target_call *call, double *x, double *u, double *y,
                    bool *reachable)
{
    const struct apc_linear *m = t->model;
    const size_t nu = m->nu, ny = m->ny, nc = t->nc;
    int rc;

    origin(t, call);
    memset(t->f, 0, nu * sizeof(*t->f));
    for (size_t j = 0; j < nu; j++) {
        double here = m->u0[j] + t->point[nc + j],
               slope = t->weight[j] * (here - call->reference[j]) + (call->cost ? call->cost[j] : 0.0);

        for (size_t k = 0; k < nu; k++)
            t->f[k] += slope * t->rows[j * nu + k];
        t->low[nu + j] = call->low[j] - here;
        t->high[nu + j] = call->high[j] - here;
    }
    memset(t->square, 0, (2 * nu + ny) * sizeof(*t->square));
    for (size_t c = 0; c < ny; c++) {
        t->low[2 * nu + c] = call->y_low[c] - t->y[c];
        t->high[2 * nu + c] = call->y_high[c] - t->y[c];
    }
    (void)apc_qp_soft(t->qp, NULL, NULL);
    rc = apc_qp_solve(t->qp, t->f, t->low, t->high, t->z, NULL);
    *reachable = rc == 0;
    if (rc < 0 && rc != APC_EINVAL)
        rc = relax_target_by_rank(t, call);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < t->n; i++)
        t->point[i] += apc_matrix_dot(t->Q + i * t->n + nc, t->z, nu);
    for (size_t i = 0; i < nc; i++)
        x[i] = m->x0[i] + t->point[i];
    for (size_t j = 0; j < nu; j++)
        u[j] = fmin(fmax(m->u0[j] + t->point[nc + j], call->low[j]), call->high[j]);
    for (size_t c = 0; c < ny; c++)
        y[c] = t->y[c] + apc_matrix_dot(t->rows + (nu + c) * nu, t->z, nu);
    return 0;
}

/* ---- Of a nonlinear model ------------------------------------------------------------------------ */

/* Newton's steps of any length lead to most setpoints that can be reached; to others, and to the nearest
 * where there is none, short ones do. */
enum { SEARCH = 60, CAREFUL = 16 };
/* Of a state or input, over its size: the next step would be the square of that; what is near enough where at
 * the top of a curve there is no end to it. */
#define STILL      1e-8
#define ALL_BUT_IT 1e-5

/* Where an input turns back, as at the top of a curve, it goes half as far. Returns by how much the farthest
 * moves. */
static double take_target_step(struct apc_target *t, const double *x, const double *u)
{
    const struct apc_linear *m = t->model;
    double most = 0.0;

    for (size_t i = 0; i < t->nc; i++)
        most = fmax(most, fabs(x[i] - m->x0[i]) / (1.0 + fabs(x[i])));
    for (size_t j = 0; j < m->nu; j++) {
        const double by = u[j] - m->u0[j];

        if (by * t->moved[j] < 0.0) {
            t->reach[j] = fmin(t->reach[j], fabs(t->moved[j])) / 2.0;
            t->longer[j] = 1.0;
        } else {
            t->reach[j] *= t->longer[j];
        }
        t->moved[j] = by;
        most = fmax(most, fabs(by) / (1.0 + fabs(u[j])));
    }
    return most;
}

/* Is there a step left? */
static bool may_step(const struct apc_target_call *call)
{
    if (call->enough && call->enough(call->ctx))
        return false;
    return !call->left || (*call->left > 0 && (*call->left)--);
}

static int walk(struct apc_target *t, const struct apc_target_call *call, apc_target_linearise *linearise,
                double *x, double *u, double *y, bool *reachable)
{
    const struct apc_linear *m = t->model;
    struct apc_target_call of = *call;
    double most = HUGE_VAL;

    of.drift = t->drift;
    of.low = t->lowest;
    of.high = t->highest;
    memset(t->moved, 0, m->nu * sizeof(*t->moved));
    for (size_t j = 0; j < m->nu; j++)
        t->longer[j] = 2.0;
    for (int k = 0; k < SEARCH && most > STILL; k++) {
        int rc = may_step(call) ? linearise(call->ctx, x, u, t->model, t->drift) : APC_ETIMEDOUT;

        for (size_t j = 0; j < m->nu; j++) {
            t->lowest[j] = fmin(fmax(u[j] - t->reach[j], call->low[j]), call->high[j]);
            t->highest[j] = fmax(fmin(u[j] + t->reach[j], call->high[j]), call->low[j]);
        }
        if (rc == 0)
            rc = target_rows(t, NULL);
        if (rc == 0)
            rc = weigh_target(t, NULL);
        if (rc == 0)
            rc = apc_target_find(t, &of, x, u, y, reachable);
        if (rc < 0)
            return rc;
        most = take_target_step(t, x, u);
    }
    return most <= ALL_BUT_IT ? 0 : APC_ESOLVER;
}

int apc_target_search(struct apc_target *t, const struct apc_target_call *call,
                      apc_target_linearise *linearise, double *x, double *u, double *y, bool *reachable)
{
    const size_t nu = t->model->nu;
    int rc;

    memcpy(t->from_x, x, t->nc * sizeof(*x));
    memcpy(t->from_u, u, nu * sizeof(*u));
    for (size_t j = 0; j < nu; j++)
        t->reach[j] = HUGE_VAL;
    rc = walk(t, call, linearise, x, u, y, reachable);
    if (rc == APC_ETIMEDOUT || (rc == 0 && *reachable))
        return rc;
    memcpy(x, t->from_x, t->nc * sizeof(*x));
    memcpy(u, t->from_u, nu * sizeof(*u));
    for (size_t j = 0; j < nu; j++)
        t->reach[j] = (call->high[j] - call->low[j]) / (double)CAREFUL;
    return walk(t, call, linearise, x, u, y, reachable);
}
