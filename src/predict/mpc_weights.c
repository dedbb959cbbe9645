/* SPDX-License-Identifier: BSD-3-Clause */
/* The weights of moves and of what comes after the horizon: H of the program. */
#include "predict/mpc_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"

#define DAMPING 1e9 /* of moves: beyond it nothing moves */

/* q y_c^2 of the state, into Q [(nc + nu)^2]. */
static void weigh_state(const struct apc_mpc *p, size_t c, double q, double *Q)
{
    const struct apc_linear *m = p->rest;
    const double *row = m->C + c * m->nx;

    for (size_t i = 0; i < p->nc; i++) {
        for (size_t j = 0; j < p->nc; j++)
            Q[i * (p->nc + p->nu) + j] += q * row[i] * row[j];
    }
}

/*
 * What comes after N costs (x_N - x_t, u_N-1 - u_t)' P (...): the regulator of the model whose state has the
 * last u as well and whose input is the move.
 */
static int weigh_terminal(struct apc_mpc *p, struct apc_error *why)
{
    const struct apc_linear *m = p->rest;
    const size_t nc = p->nc, nu = p->nu, na = nc + nu, inputs = nu + p->nd;
    double *at = p->riccati, *A = apc_carve(&at, na * na), *Q = apc_carve(&at, na * na),
           *B = apc_carve(&at, na * nu), *K = apc_carve(&at, na * nu), *R = apc_carve(&at, nu * nu);

    memset(p->riccati, 0, (size_t)(at - p->riccati) * sizeof(*at));
    for (size_t i = 0; i < nc; i++) {
        memcpy(A + i * na, m->A + i * m->nx, nc * sizeof(*A));
        for (size_t j = 0; j < nu; j++)
            A[i * na + nc + j] = B[i * nu + j] = m->B[i * inputs + j];
    }
    for (size_t j = 0; j < nu; j++) {
        A[(nc + j) * na + nc + j] = B[(nc + j) * nu + j] = 1.0;
        Q[(nc + j) * na + nc + j] = p->r[j];
        R[j * nu + j] = p->s[j];
    }
    for (size_t c = 0; c < p->ny; c++)
        weigh_state(p, c, tracked(p, c), Q);
    if (apc_riccati_in(at, na, nu, A, B, Q, R, p->P, K, NULL) < 0) {
        /* what no y with a weight shows, the others being out of service perhaps, stays where it is aimed */
        for (size_t j = 0; j < nu; j++)
            Q[(nc + j) * na + nc + j] += 1e-6 * p->s[j];
        for (size_t c = 0; c < p->ny; c++)
            weigh_state(p, c, p->least[c], Q);
        if (apc_riccati_in(at, na, nu, A, B, Q, R, p->P, K, NULL) < 0)
            return apc_fail(
                why, APC_ESOLVER,
                "predictive control: the model cannot be stabilised: a mode that does not die out "
                "by itself is moved by no output, or seen in no measurement");
    }
    for (size_t i = 0; i < na; i++) {
        for (size_t k = 0; k < p->n; k++) {
            double sum = k >= p->n - nu ? p->P[i * na + nc + k - (p->n - nu)] : 0.0;

            for (size_t l = 0; l < nc; l++)
                sum += p->P[i * na + l] * p->Gx[k * nc + l];
            p->PG[i * p->n + k] = sum;
        }
    }
    for (size_t a = 0; a < p->n; a++) {
        for (size_t k = 0; k < p->n; k++) {
            double sum = a >= p->n - nu ? p->PG[(nc + a - (p->n - nu)) * p->n + k] : 0.0;

            for (size_t l = 0; l < nc; l++)
                sum += p->Gx[a * nc + l] * p->PG[l * p->n + k];
            p->H[a * p->n + k] += sum;
        }
    }
    return 0;
}

/* What move @p a, of output @p j, is damped by: as much as prices bend along it. */
static double bend_of(const struct apc_mpc *p, const double *curve, size_t a, size_t j)
{
    return fmax(fabs(curve[a * p->n + a]), p->s[j]);
}

static int make_hessian(struct apc_mpc *p, struct apc_error *why)
{
    const size_t n = p->n, nu = p->nu;
    int rc = 0;

    memset(p->H, 0, n * n * sizeof(*p->H));
    for (size_t i = 0, c = 0; i < summed(p) * p->ny; i++, c = c + 1 < p->ny ? c + 1 : 0) {
        const double *row = p->G + i * n, q = tracked(p, c);

        for (size_t a = 0; q > 0.0 && a < n; a++) {
            for (size_t b = 0; b <= a; b++)
                p->H[a * n + b] += q * row[a] * row[b];
        }
    }
    for (size_t block = 0; block < p->blocks; block++) {
        for (size_t j = 0; j < nu; j++) {
            const size_t k = block * nu + j;

            p->H[k * n + k] += p->s[j] * (block + 1 < p->blocks ? 2.0 : 1.0) + reference_weight(p, block, j);
            if (block > 0)
                p->H[k * n + k - nu] -= p->s[j];
        }
    }
    for (size_t a = 0, j = 0; p->curve && a < n; a++, j = j + 1 < nu ? j + 1 : 0) {
        for (size_t b = 0; b <= a; b++)
            p->H[a * n + b] += p->curve[a * n + b];
        p->H[a * n + a] += p->damping * bend_of(p, p->curve, a, j);
    }
    if (p->ends)
        rc = weigh_terminal(p, why);
    if (rc < 0)
        return rc;
    return apc_qp_set(p->qp, p->H, p->A, NULL) == 0
               ? 0
               : apc_fail(why, APC_EINVAL,
                          "predictive control: the weights leave a combination of moves free: give each u "
                          "a weight of moves, or each combination of them a y that it moves");
}

static void copy_weights(struct apc_mpc *p, const struct apc_mpc_weights *w)
{
    memcpy(p->q, w->q, p->ny * sizeof(*p->q));
    memcpy(p->zone, w->zone, p->ny * sizeof(*p->zone));
    memcpy(p->s, w->s, p->nu * sizeof(*p->s));
    memcpy(p->r, w->r, p->nu * sizeof(*p->r));
    memset(p->least, 0, p->ny * sizeof(*p->least));
    memset(p->price, 0, p->ny * sizeof(*p->price));
    if (w->price)
        memcpy(p->price, w->price, p->ny * sizeof(*p->price));
    if (w->least)
        memcpy(p->least, w->least, p->ny * sizeof(*p->least));
}

int apc_mpc_tune(struct apc_mpc *p, const struct apc_mpc_weights *weights, struct apc_error *why)
{
    size_t sought = 0;
    int rc;

    copy_weights(p, weights);
    for (size_t c = 0; c < p->ny; c++)
        sought += tracked(p, c) > 0.0;
    rc = make_hessian(p, why);
    if (rc == 0)
        rc = apc_target_tune(p->target, sought, p->r, p->s, why);
    if (rc < 0)
        return rc;
    for (size_t c = 0; c < p->ny; c++) {
        for (size_t i = 0; i < p->N && p->row_of_zone[c] != SIZE_MAX; i++)
            p->square[p->n + p->row_of_zone[c] + i] = p->zone[c] > 0.0 ? p->q[c] : 0.0;
    }
    return apc_qp_soft(p->qp, p->none, p->square);
}

/* With what prices bend about moves @p plan: going from there is damped until it is convex; where that helps no
 * more, they do not bend. */
static int make_bent_hessian(struct apc_mpc *p, const double *curve, const double *plan)
{
    const size_t n = p->n, nu = p->nu;
    int rc = APC_EINVAL;

    memset(p->bent, 0, n * sizeof(*p->bent));
    p->curve = curve;
    p->damping = 0.0;
    while (curve && rc == APC_EINVAL && p->damping < DAMPING) {
        rc = make_hessian(p, NULL);
        for (size_t a = 0; a < n && rc == 0; a++) {
            p->bent[a] = -p->damping * bend_of(p, curve, a, a % nu) * (plan[a] - p->model->u0[a % nu]);
            for (size_t b = 0; b < n; b++)
                p->bent[a] -= curve[a > b ? a * n + b : b * n + a] * (plan[b] - p->model->u0[b % nu]);
        }
        p->damping = fmax(1.0 / 64.0, 4.0 * p->damping);
    }
    p->curve = NULL;
    return rc == 0 ? 0 : make_hessian(p, NULL);
}

int apc_mpc_follow(struct apc_mpc *p, const double *G, const double *free_y, const double *Gx,
                   const double *free_x, const double *curve, const double *plan)
{
    int rc;

    memcpy(p->G, G, p->N * p->ny * p->n * sizeof(*G));
    memcpy(p->free_y, free_y, p->N * p->ny * sizeof(*free_y));
    apc_matrix_transpose(p->nc, p->n, Gx, p->Gx);
    memcpy(p->x, free_x, p->nc * sizeof(*free_x));
    p->easy_stale = true;
    mpc_make_rows(p);
    p->ends = p->terminal && p->aims;
    rc = make_bent_hessian(p, curve, plan);
    if (rc < 0 && p->ends) {
        p->ends = false;
        rc = make_bent_hessian(p, curve, plan);
    }
    return rc;
}
