/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Sampling of a linear model, and the discrete Riccati equation by the structure-preserving doubling
 * algorithm (Chu, Fan, Lin, Wang: Structure-preserving algorithms for periodic discrete-time algebraic
 * Riccati equations, International Journal of Control 77(8), 2004). docs/rationale.md says why this is not
 * left to LAPACK.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apclinear.h"
#include "base/matrix.h"
#include "predict/predict_internal.h"

/* exp([A B; 0 0] Ts) = [Ad Bd; 0 I] */
int apc_linear_sample(size_t nx, size_t nu, const double *A, const double *B, double Ts, double *Ad,
                      double *Bd, struct apc_error *why)
{
    size_t n = nx + nu;
    double *M = calloc(6 * n * n + 1, sizeof(*M));
    int rc;

    if (!M)
        return apc_fail(why, APC_ENOMEM, "apc_linear_sample: no memory");
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < nx; j++)
            M[i * n + j] = A[i * nx + j] * Ts;
        for (size_t j = 0; j < nu; j++)
            M[i * n + nx + j] = B[i * nu + j] * Ts;
    }
    rc = apc_matrix_exponential(n, M, M + n * n, M + 2 * n * n);
    for (size_t i = 0; i < nx && rc == 0; i++) {
        memcpy(Ad + i * nx, M + (n + i) * n, nx * sizeof(*Ad));
        memcpy(Bd + i * nu, M + (n + i) * n + nx, nu * sizeof(*Bd));
    }
    free(M);
    return rc == 0
               ? 0
               : apc_fail(why, APC_EINVAL, "apc_linear_sample: an element of the model is no finite number");
}

/* ---- The Riccati equation ------------------------------------------------------------------------ */

/* Room for the iteration, all [n * n] but where it says so, n = nx. */
struct riccati {
    size_t n, m;
    double *A, *G, *H;     /* of the present step */
    double *W, *X, *Y, *T; /* intermediates */
    double *small;         /* [nu * nu] */
    double *Bt, *BtP;      /* [nu * nx] */
};

static void symmetrise(size_t n, double *M)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++)
            M[i * n + j] = M[j * n + i] = (M[i * n + j] + M[j * n + i]) / 2.0;
    }
}

/* G = B R^-1 B'. Returns nonzero where R is singular. */
static int factor_riccati(struct riccati *r, const double *A, const double *B, const double *Q,
                          const double *R)
{
    memcpy(r->A, A, r->n * r->n * sizeof(*A));
    memcpy(r->H, Q, r->n * r->n * sizeof(*Q));
    memcpy(r->small, R, r->m * r->m * sizeof(*R));
    apc_matrix_transpose(r->n, r->m, B, r->Bt);
    memcpy(r->BtP, r->Bt, r->n * r->m * sizeof(*r->BtP));
    if (apc_matrix_solve(r->m, r->n, r->small, r->BtP))
        return -1;
    apc_matrix_multiply(r->n, r->m, r->n, B, r->BtP, r->G);
    return 0;
}

/*
 * One step, which goes twice as far as all before: with W = I + G H,
 *     A <- A W^-1 A,   G <- G + A W^-1 G A',   H <- H + A' H W^-1 A.
 * Returns how much H changed, relative to it; NaN where W is singular.
 */
static double doubling(struct riccati *r)
{
    size_t n = r->n, all = n * n * sizeof(double);
    double change = 0.0;

    apc_matrix_multiply(n, n, n, r->G, r->H, r->W);
    for (size_t i = 0; i < n; i++)
        r->W[i * n + i] += 1.0;
    memcpy(r->T, r->W, all);
    memcpy(r->X, r->A, all);
    memcpy(r->Y, r->G, all);
    if (apc_matrix_solve(n, n, r->T, r->X) || apc_matrix_solve(n, n, r->W, r->Y))
        return (double)NAN;
    apc_matrix_multiply(n, n, n, r->A, r->Y, r->W); /* A W^-1 G, then times A' */
    apc_matrix_transpose(n, n, r->A, r->T);
    apc_matrix_multiply(n, n, n, r->W, r->T, r->Y);
    for (size_t i = 0; i < n * n; i++)
        r->G[i] += r->Y[i];
    apc_matrix_multiply(n, n, n, r->T, r->H, r->W); /* A' H, then times W^-1 A */
    apc_matrix_multiply(n, n, n, r->W, r->X, r->Y);
    for (size_t i = 0; i < n * n; i++)
        r->H[i] += r->Y[i];
    apc_matrix_multiply(n, n, n, r->A, r->X, r->T);
    memcpy(r->A, r->T, all);
    symmetrise(n, r->G);
    symmetrise(n, r->H);
    change = apc_matrix_norm(n, r->Y) / fmax(apc_matrix_norm(n, r->H), 1e-300);
    return apc_matrix_norm(n, r->H) > 0.0 ? change : 0.0;
}

/* K = (R + B'PB)^-1 B'PA */
static int gain(struct riccati *r, const double *A, const double *B, const double *R, const double *P,
                double *K)
{
    apc_matrix_multiply(r->m, r->n, r->n, r->Bt, P, r->BtP);
    apc_matrix_multiply(r->m, r->n, r->m, r->BtP, B, r->small);
    for (size_t i = 0; i < r->m * r->m; i++)
        r->small[i] += R[i];
    apc_matrix_multiply(r->m, r->n, r->n, r->BtP, A, K);
    return apc_matrix_solve(r->m, r->n, r->small, K);
}

/*
 * A step of Newton's method (Kleinman's): P = F'PF + Q + K'RK with F = A - BK, summed by squaring F, and its
 * K. It takes away the rounding errors of the doubling. Returns how much P changed, relative to it; NaN when
 * F is not stable.
 */
static double kleinman_step(struct riccati *r, const double *A, const double *B, const double *Q,
                            const double *R, double *P, double *K)
{
    size_t n = r->n, m = r->m, all = n * n * sizeof(double);
    double change, before;

    apc_matrix_transpose(m, n, K, r->T);
    apc_matrix_multiply(n, m, m, r->T, R, r->Y);
    apc_matrix_multiply(n, m, n, r->Y, K, r->W);
    for (size_t i = 0; i < n * n; i++)
        r->W[i] += Q[i];
    apc_matrix_multiply(n, m, n, B, K, r->X);
    for (size_t i = 0; i < n * n; i++)
        r->X[i] = A[i] - r->X[i];
    change = HUGE_VAL;
    for (int k = 0; k < 40 && change > 1e-17 * apc_matrix_norm(n, r->W); k++) {
        apc_matrix_transpose(n, n, r->X, r->T);
        apc_matrix_multiply(n, n, n, r->T, r->W, r->Y);
        apc_matrix_multiply(n, n, n, r->Y, r->X, r->T);
        for (size_t i = 0; i < n * n; i++)
            r->W[i] += r->T[i];
        change = apc_matrix_norm(n, r->T);
        apc_matrix_multiply(n, n, n, r->X, r->X, r->Y);
        memcpy(r->X, r->Y, all);
    }
    if (!(apc_matrix_norm(n, r->X) < 1.0))
        return (double)NAN;
    symmetrise(n, r->W);
    before = apc_matrix_norm(n, r->W);
    for (size_t i = 0; i < n * n; i++)
        r->T[i] = r->W[i] - P[i];
    memcpy(P, r->W, all);
    return gain(r, A, B, R, P, K) ? (double)NAN : apc_matrix_norm(n, r->T) / fmax(before, 1e-300);
}

static bool solve_riccati(struct riccati *r, const double *A, const double *B, const double *Q,
                          const double *R, double *P, double *K)
{
    double change = 1.0, before = HUGE_VAL;

    for (int k = 0; k < 60 && change > 1e-15; k++)
        change = doubling(r);
    if (!(change <= 1e-15))
        return false;
    memcpy(P, r->H, r->n * r->n * sizeof(*P));
    if (gain(r, A, B, R, P, K))
        return false;
    for (int k = 0; k < 20 && change < before; k++) {
        before = k > 0 ? change : HUGE_VAL;
        change = kleinman_step(r, A, B, Q, R, P, K);
        if (!(change >= 0.0))
            return false;
    }
    return true;
}

size_t apc_riccati_room(size_t nx, size_t nu)
{
    return 7 * nx * nx + nu * nu + 2 * nu * nx + 1;
}

int apc_riccati_in(double *memory, size_t nx, size_t nu, const double *A, const double *B, const double *Q,
                   const double *R, double *P, double *K, struct apc_error *why)
{
    struct riccati r = {.n = nx, .m = nu};
    double **const square[] = {&r.A, &r.G, &r.H, &r.W, &r.X, &r.Y, &r.T};
    double *at = memory;

    for (size_t i = 0; i < sizeof(square) / sizeof(square[0]); i++, at += nx * nx)
        *square[i] = at;
    r.small = at;
    r.Bt = r.small + nu * nu;
    r.BtP = r.Bt + nu * nx;
    if (factor_riccati(&r, A, B, Q, R))
        return apc_fail(why, APC_EINVAL, "apc_riccati_solve: R must be positive definite");
    if (!solve_riccati(&r, A, B, Q, R, P, K))
        return apc_fail(
            why, APC_ESOLVER,
            "the Riccati equation has no stabilising solution: a mode that does not die out by itself "
            "is not reached by the input (for an observer: by the noise), or not seen in what has a "
            "weight (for an observer: in the measurements)");
    return 0;
}

int apc_riccati_solve(size_t nx, size_t nu, const double *A, const double *B, const double *Q,
                      const double *R, double *P, double *K, struct apc_error *why)
{
    double *memory = calloc(apc_riccati_room(nx, nu), sizeof(*memory));
    int rc;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "apc_riccati_solve: no memory");
    rc = apc_riccati_in(memory, nx, nu, A, B, Q, R, P, K, why);
    free(memory);
    return rc;
}
