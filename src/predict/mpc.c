/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Condensed: the moves v = u - u0 of the blocks are the only unknowns, y of sample i is what would come with
 * v = 0 plus G_i v, G made of step responses once. So bounds on u need no rows, and the program has the size
 * of the moves, not of the horizon. What would come with v = 0 is linear as well, in the state: F is made
 * once; only where disturbances are measured it is gone through sample by sample.
 */
#include "predict/mpc.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "predict/predict_internal.h"
#include "predict/qp_internal.h"
#include "predict/target.h"

/* While limits are given up, what a move costs beside their violation. Solving again, from where that led,
 * takes away what this has pulled. */
#define EASY 1e-4
enum { AGAIN = 3 };
/* What is allowed to a rank beyond what it breaks, over the size of y, so that the ranks after it have a
 * place to look in; where they look in vain, more. What is told as broken. */
#define LITTLE 1e-8
#define MUCH   2e-4
#define BROKEN 1e-6

struct apc_mpc {
    const struct apc_linear *model;
    size_t N, blocks, nu, ny, nd, nc, n, m; /* n moves, m rows */
    size_t n_rates;                         /* rows of rates, before those of limits and of zones */
    size_t *first;                          /* [blocks] sample that a block begins with */
    size_t *block_at;                       /* [N] block that a sample is in */
    struct apc_mpc_change {
        size_t move, j;
    } * rate_of;                        /* [n_rates] the move that a row ends with, its input */
    size_t *row_of_limit, *row_of_zone; /* [ny] first of N rows; SIZE_MAX: none */
    unsigned *rank;                     /* [ny] */
    unsigned ranks;
    bool terminal;
    bool ends;       /* with a terminal weight, this time */
    bool easy_stale; /* easy_qp is of another G */
    bool easy_waits; /* easy_qp does not know the rows of room yet */
    bool aims;       /* at steady states */
    bool few;        /* changes of the working set are counted, as time is */
    bool reachable;  /* as in the result */
    bool (*enough)(void *ctx);
    apc_target_linearise *linearise; /* what y does is said from outside */
    void *ctx;
    struct apc_linear *rest; /* of steady states and what comes after N: the model, or what is linear there */

    double *memory;
    double *G;      /* [N * ny * n] */
    double *Gx;     /* [n * nc] of the state at N, move after move */
    double *F, *Fx; /* [nx * (N * ny)], [nx * nx]: y of the samples, x at N from each state, one after another
                     */
    double *A, *H, *H_easy; /* [m * n], [n * n] */
    double *q, *s, *r, *zone, *least;
    double *P, *PG; /* [(nc + nu)^2], [(nc + nu) * n] of the terminal weight */
    double *riccati;
    double *square, *easy, *none;        /* [n + m] weights of soft rows; none: zeros */
    double *low, *high;                  /* [n + m] */
    double *f, *v, *broken;              /* [n]; moves that break least of limits that were looked at */
    double *free_y, *target_y, *pulling; /* [N * ny] */
    double *target_u, *target_x, *near;  /* [N * nu], [nc], [nc] of sample 1 */
    double *u_last;                      /* [nu] of the last call */
    double *x, *next, *input;            /* [nx], [nx], [nu + nd] */
    double *aim_low, *aim_high;          /* [ny] */
    double *difference, *far;            /* [nc + nu] */
    signed char *room;                   /* [n + m] */
    unsigned *paced;                     /* [nu] the first move's bounds that are its rate's */
    struct apc_qp *qp, *easy_qp;
    struct apc_target *target;
};

/* ---- Making -------------------------------------------------------------------------------------- */

static int check(const struct apc_mpc_options *o, struct apc_error *why)
{
    size_t samples = 0;

    if (!o->model || !o->horizon || !o->blocks || !o->block)
        return apc_fail(why, APC_EINVAL, "predictive control: a model, a horizon and blocks are required");
    if (!o->model->nu || !o->model->ny)
        return apc_fail(why, APC_EINVAL, "predictive control: the model has %zu inputs and %zu outputs",
                        o->model->nu, o->model->ny);
    for (size_t b = 0; b < o->blocks; b++) {
        if (o->block[b] == 0 || samples >= o->horizon)
            return apc_fail(why, APC_EINVAL,
                            "predictive control: block %zu of %zu begins at sample %zu of %zu; blocks have a "
                            "sample at least, and begin before the horizon ends",
                            b + 1, o->blocks, samples, o->horizon);
        samples += o->block[b];
    }
    return 0;
}

/* Step responses into G: a block's is that of its beginning less that of the one after it. */
static void respond(struct apc_mpc *p)
{
    const struct apc_linear *m = p->model;
    double *S = p->free_y; /* [N * ny], not needed yet */

    for (size_t j = 0; j < p->nu; j++) {
        memcpy(p->input, m->u0, (p->nu + p->nd) * sizeof(*p->input));
        p->input[j] += 1.0;
        for (size_t b = 0; b < p->blocks; b++) {
            const size_t begin = p->first[b], end = b + 1 < p->blocks ? p->first[b + 1] : p->N + 1;
            const size_t column = b * p->nu + j;

            memcpy(p->x, m->x0, m->nx * sizeof(*p->x));
            for (size_t i = 0; i <= p->N; i++) {
                p->input[j] = m->u0[j] + (i >= begin && i < end ? 1.0 : 0.0);
                if (i > 0) {
                    apc_linear_output(m, p->x, p->input, S);
                    for (size_t c = 0; c < p->ny; c++)
                        p->G[((i - 1) * p->ny + c) * p->n + column] = S[c] - m->y0[c];
                }
                if (i == p->N)
                    break;
                apc_linear_next(m, p->x, p->input, p->next);
                memcpy(p->x, p->next, m->nx * sizeof(*p->x));
            }
            for (size_t k = 0; k < p->nc; k++)
                p->Gx[column * p->nc + k] = p->x[k] - m->x0[k];
        }
    }
}

/* P [n * n] = A^times; A is destroyed; work [n * n] */
static void raise_power(size_t n, double *A, size_t times, double *P, double *work)
{
    memset(P, 0, n * n * sizeof(*P));
    for (size_t i = 0; i < n; i++)
        P[i * n + i] = 1.0;
    for (; times > 0; times /= 2) {
        if (times % 2) {
            apc_matrix_multiply(n, n, n, P, A, work);
            memcpy(P, work, n * n * sizeof(*P));
        }
        apc_matrix_multiply(n, n, n, A, A, work);
        memcpy(A, work, n * n * sizeof(*A));
    }
}

static int respond_to_state(struct apc_mpc *p)
{
    const struct apc_linear *m = p->model;
    const size_t nx = m->nx, ny = p->ny;
    double *work = calloc(3 * nx * nx + 2 * ny * nx, sizeof(*work)), *at = work;
    double *A = apc_carve(&at, nx * nx), *power = apc_carve(&at, nx * nx), *scratch = apc_carve(&at, nx * nx),
           *row = apc_carve(&at, ny * nx), *next = apc_carve(&at, ny * nx);

    if (!work)
        return APC_ENOMEM;
    memcpy(row, m->C, ny * nx * sizeof(*row));
    for (size_t i = 0; i < p->N; i++) {
        apc_matrix_multiply(ny, nx, nx, row, m->A, next);
        memcpy(row, next, ny * nx * sizeof(*row));
        for (size_t k = 0; k < nx; k++) {
            for (size_t c = 0; c < ny; c++)
                p->F[(k * p->N + i) * ny + c] = row[c * nx + k];
        }
    }
    if (p->terminal) {
        memcpy(A, m->A, nx * nx * sizeof(*A));
        raise_power(nx, A, p->N, power, scratch);
        apc_matrix_transpose(nx, nx, power, p->Fx);
    }
    free(work);
    return 0;
}

static void make_rows(struct apc_mpc *p)
{
    for (size_t k = 0; k < p->n_rates; k++) {
        p->A[k * p->n + p->rate_of[k].move] = 1.0;
        p->A[k * p->n + p->rate_of[k].move - p->nu] = -1.0;
    }
    for (size_t c = 0; c < p->ny; c++) {
        for (size_t i = 0; i < p->N; i++) {
            const double *row = p->G + (i * p->ny + c) * p->n;

            if (p->row_of_limit[c] != SIZE_MAX)
                memcpy(p->A + (p->row_of_limit[c] + i) * p->n, row, p->n * sizeof(*row));
            if (p->row_of_zone[c] != SIZE_MAX)
                memcpy(p->A + (p->row_of_zone[c] + i) * p->n, row, p->n * sizeof(*row));
        }
    }
}

static int count_rows(struct apc_mpc *p, const struct apc_mpc_options *o)
{
    p->first = calloc(p->blocks + 2 * p->ny + p->N, sizeof(*p->first));
    p->rate_of = calloc(p->n, sizeof(*p->rate_of));
    p->rank = calloc(p->ny, sizeof(*p->rank));
    if (!p->first || !p->rank || !p->rate_of)
        return APC_ENOMEM;
    p->row_of_limit = p->first + p->blocks;
    p->row_of_zone = p->row_of_limit + p->ny;
    p->block_at = p->row_of_zone + p->ny;
    for (size_t b = 0; b + 1 < p->blocks; b++)
        p->first[b + 1] = p->first[b] + o->block[b];
    for (size_t i = 0, b = 0; i < p->N; i++) {
        b += b + 1 < p->blocks && i == p->first[b + 1];
        p->block_at[i] = b;
    }
    for (size_t b = 1; b < p->blocks; b++) {
        for (size_t j = 0; j < p->nu; j++) {
            if (o->rate && o->rate[j])
                p->rate_of[p->n_rates++] = (struct apc_mpc_change){.move = b * p->nu + j, .j = j};
        }
    }
    p->m = p->n_rates;
    p->ranks = 1;
    for (size_t c = 0; c < p->ny; c++) {
        p->rank[c] = o->rank ? o->rank[c] : 1;
        p->ranks = p->rank[c] > p->ranks ? p->rank[c] : p->ranks;
        p->row_of_limit[c] = p->row_of_zone[c] = SIZE_MAX;
        if (o->limits && o->limits[c]) {
            p->row_of_limit[c] = p->m;
            p->m += p->N;
        }
    }
    for (size_t c = 0; c < p->ny; c++) {
        if (!o->zone || !o->zone[c])
            continue;
        p->row_of_zone[c] = p->m;
        p->m += p->N;
    }
    return 0;
}

static int allocate(struct apc_mpc *p)
{
    const size_t n = p->n, m = p->m, ny = p->ny, nu = p->nu, N = p->N, nx = p->model->nx, na = p->nc + nu;
    const size_t of_terminal =
        p->terminal ? 3 * na * na + 2 * na * nu + nu * nu + apc_riccati_room(na, nu) : 0;
    double *at = calloc(N * ny * n + p->nc * n + nx * N * ny + nx * nx + m * n + 2 * n * n + 3 * ny + 2 * nu +
                            na * na + na * n + of_terminal + 5 * (n + m) + 3 * n + 3 * N * ny + N * nu +
                            2 * p->nc + 2 * nx + 2 * nu + p->nd + 2 * ny + 2 * na,
                        sizeof(*at));

    p->memory = at;
    p->room = calloc(n + m, sizeof(*p->room));
    p->paced = calloc(nu, sizeof(*p->paced));
    if (!at || !p->room || !p->paced)
        return APC_ENOMEM;
    p->G = apc_carve(&at, N * ny * n);
    p->Gx = apc_carve(&at, n * p->nc);
    p->F = apc_carve(&at, nx * N * ny);
    p->Fx = apc_carve(&at, nx * nx);
    p->A = apc_carve(&at, m * n);
    p->H = apc_carve(&at, n * n);
    p->H_easy = apc_carve(&at, n * n);
    p->q = apc_carve(&at, ny);
    p->zone = apc_carve(&at, ny);
    p->least = apc_carve(&at, ny);
    p->s = apc_carve(&at, nu);
    p->r = apc_carve(&at, nu);
    p->P = apc_carve(&at, na * na);
    p->PG = apc_carve(&at, na * n);
    p->riccati = apc_carve(&at, of_terminal);
    p->square = apc_carve(&at, n + m);
    p->none = apc_carve(&at, n + m);
    p->easy = apc_carve(&at, n + m);
    p->low = apc_carve(&at, n + m);
    p->high = apc_carve(&at, n + m);
    p->f = apc_carve(&at, n);
    p->v = apc_carve(&at, n);
    p->broken = apc_carve(&at, n);
    p->free_y = apc_carve(&at, N * ny);
    p->target_y = apc_carve(&at, N * ny);
    p->pulling = apc_carve(&at, N * ny);
    p->target_u = apc_carve(&at, N * nu);
    p->target_x = apc_carve(&at, p->nc);
    p->near = apc_carve(&at, p->nc);
    p->x = apc_carve(&at, nx);
    p->next = apc_carve(&at, nx);
    p->input = apc_carve(&at, nu + p->nd);
    p->aim_low = apc_carve(&at, ny);
    p->aim_high = apc_carve(&at, ny);
    p->difference = apc_carve(&at, na);
    p->far = apc_carve(&at, na);
    p->u_last = memcpy(apc_carve(&at, nu), p->model->u0, nu * sizeof(*at));
    return 0;
}

/* While limits are being given up, a move costs little: of its effect on y. */
static int make_easy(struct apc_mpc *p, struct apc_error *why)
{
    for (size_t k = 0; k < p->n; k++) {
        double effect = 0.0;

        for (size_t i = 0; i < p->N * p->ny; i++)
            effect += p->G[i * p->n + k] * p->G[i * p->n + k];
        p->H_easy[k * p->n + k] = EASY * (effect > 0.0 ? effect : 1.0);
    }
    return apc_qp_set(p->easy_qp, p->H_easy, p->A, why);
}

static int copy_model(struct apc_mpc *p, struct apc_error *why)
{
    const struct apc_linear *m = p->model;
    const size_t inputs = m->nu + m->nd;
    int rc = apc_linear_allocate(&p->rest, m->nx, m->nu, m->nd, m->ny, why);

    if (rc < 0)
        return rc;
    p->rest->Ts = m->Ts;
    p->rest->nx_plant = m->nx_plant;
    p->rest->nx_held = m->nx_held;
    memcpy(p->rest->A, m->A, m->nx * m->nx * sizeof(*m->A));
    memcpy(p->rest->B, m->B, m->nx * inputs * sizeof(*m->B));
    memcpy(p->rest->C, m->C, m->ny * m->nx * sizeof(*m->C));
    memcpy(p->rest->D, m->D, m->ny * inputs * sizeof(*m->D));
    memcpy(p->rest->x0, m->x0, m->nx * sizeof(*m->x0));
    memcpy(p->rest->u0, m->u0, inputs * sizeof(*m->u0));
    memcpy(p->rest->y0, m->y0, m->ny * sizeof(*m->y0));
    return 0;
}

int apc_mpc_create(struct apc_mpc **mpc, const struct apc_mpc_options *options, struct apc_error *why)
{
    const struct apc_linear *m = options->model;
    const struct apc_qp_options qp = {.size = sizeof(qp),
                                      .iterations = options->iterations,
                                      .enough = options->enough,
                                      .ctx = options->ctx};
    struct apc_mpc *p;
    int rc = check(options, why);

    *mpc = NULL;
    if (rc < 0)
        return rc;
    p = calloc(1, sizeof(*p));
    if (!p)
        return apc_fail(why, APC_ENOMEM, "predictive control: no memory");
    p->model = m;
    p->N = options->horizon;
    p->blocks = options->blocks;
    p->nu = m->nu;
    p->ny = m->ny;
    p->nd = m->nd;
    p->nc = m->nx_plant + m->nx_held;
    p->n = p->nu * p->blocks;
    p->terminal = p->ends = options->terminal;
    p->linearise = options->linearise;
    p->few = options->iterations > 0;
    p->enough = options->enough;
    p->ctx = options->ctx;
    if (count_rows(p, options) < 0 || allocate(p) < 0)
        rc = apc_fail(why, APC_ENOMEM, "predictive control: no memory");
    if (rc == 0)
        rc = copy_model(p, why);
    if (rc == 0)
        rc = apc_target_create(&p->target, p->rest, why);
    if (rc == 0)
        rc = apc_qp_create(&p->qp, p->n, p->m, &qp, why);
    if (rc == 0)
        rc = apc_qp_create(&p->easy_qp, p->n, p->m, &qp, why);
    if (rc == 0 && respond_to_state(p) < 0)
        rc = apc_fail(why, APC_ENOMEM, "predictive control: no memory");
    if (rc == 0) {
        respond(p);
        make_rows(p);
        rc = apc_values_ok(p->G, p->N * p->ny * p->n) && apc_values_ok(p->F, m->nx * p->N * p->ny)
                 ? make_easy(p, why)
                 : apc_fail(why, APC_EINVAL,
                            "predictive control: within the horizon of %zu samples an unstable mode of the "
                            "model grows beyond all numbers: take a shorter horizon or period",
                            p->N);
    }
    if (rc < 0)
        apc_mpc_destroy(p);
    else
        *mpc = p;
    return rc;
}

void apc_mpc_destroy(struct apc_mpc *mpc)
{
    if (!mpc)
        return;
    apc_target_destroy(mpc->target);
    apc_linear_destroy(mpc->rest);
    apc_qp_destroy(mpc->easy_qp);
    apc_qp_destroy(mpc->qp);
    free(mpc->memory);
    free(mpc->paced);
    free(mpc->room);
    free(mpc->rate_of);
    free(mpc->rank);
    free(mpc->first);
    free(mpc);
}

/* ---- Weights ------------------------------------------------------------------------------------- */

/* The weight of y in the cost itself; a zone's is that of its rows. */
static double tracked(const struct apc_mpc *p, size_t c)
{
    return p->zone[c] > 0.0 ? 0.0 : p->q[c];
}

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

/* Samples whose y is in the sum: the last one is in the terminal weight, if there is one. */
static size_t summed(const struct apc_mpc *p)
{
    return p->ends ? p->N - 1 : p->N;
}

/* The weight of a move's distance from its target; the last one's is in the terminal weight as well. */
static double wished(const struct apc_mpc *p, size_t block, size_t j)
{
    return p->ends && block + 1 == p->blocks ? 0.0 : p->r[j];
}

static int weigh(struct apc_mpc *p, struct apc_error *why)
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

            p->H[k * n + k] += p->s[j] * (block + 1 < p->blocks ? 2.0 : 1.0) + wished(p, block, j);
            if (block > 0)
                p->H[k * n + k - nu] -= p->s[j];
        }
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
    if (w->least)
        memcpy(p->least, w->least, p->ny * sizeof(*p->least));
}

int apc_mpc_tune(struct apc_mpc *p, const struct apc_mpc_weights *weights, struct apc_error *why)
{
    int rc;

    copy_weights(p, weights);
    rc = weigh(p, why);
    if (rc == 0)
        rc = apc_target_tune(p->target, p->r, p->s, why);
    if (rc < 0)
        return rc;
    for (size_t c = 0; c < p->ny; c++) {
        for (size_t i = 0; i < p->N && p->row_of_zone[c] != SIZE_MAX; i++)
            p->square[p->n + p->row_of_zone[c] + i] = p->zone[c] > 0.0 ? p->q[c] : 0.0;
    }
    return apc_qp_soft(p->qp, p->none, p->square);
}

int apc_mpc_follow(struct apc_mpc *p, const double *G, const double *free_y, const double *Gx,
                   const double *free_x)
{
    int rc;

    memcpy(p->G, G, p->N * p->ny * p->n * sizeof(*G));
    memcpy(p->free_y, free_y, p->N * p->ny * sizeof(*free_y));
    apc_matrix_transpose(p->nc, p->n, Gx, p->Gx);
    memcpy(p->x, free_x, p->nc * sizeof(*free_x));
    p->easy_stale = true;
    make_rows(p);
    p->ends = p->terminal && p->aims;
    rc = weigh(p, NULL);
    if (rc < 0 && p->ends) {
        p->ends = false;
        rc = weigh(p, NULL);
    }
    return rc;
}

/* ---- Solving ------------------------------------------------------------------------------------- */

/* fmin() and fmax() of numbers, without a call. */
static inline double lesser(double a, double b)
{
    return a < b ? a : b;
}

static inline double greater(double a, double b)
{
    return a > b ? a : b;
}

/* What comes with v = 0. */
QP_LANES static void coast(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    const struct apc_linear *m = p->model;
    const size_t rows = p->N * p->ny;

    for (size_t i = 0; i < p->N; i++)
        memcpy(p->free_y + i * p->ny, m->y0, p->ny * sizeof(*p->free_y));
    memcpy(p->x, m->x0, m->nx * sizeof(*p->x));
    for (size_t k = 0; k < m->nx; k++) {
        const double away = call->x[k] - m->x0[k];

        qp_add(rows, away, p->F + k * rows, p->free_y);
        if (p->terminal)
            qp_add(m->nx, away, p->Fx + k * m->nx, p->x);
    }
}

/* The same with measured disturbances. */
static void coast_disturbed(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    const struct apc_linear *m = p->model;

    memcpy(p->x, call->x, m->nx * sizeof(*p->x));
    memcpy(p->input, m->u0, p->nu * sizeof(*p->input));
    for (size_t i = 0; i <= p->N; i++) {
        for (size_t k = 0; k < p->nd; k++)
            p->input[p->nu + k] = call->d[i * p->nd + k];
        if (i > 0)
            apc_linear_output(m, p->x, p->input, p->free_y + (i - 1) * p->ny);
        if (i == p->N)
            return;
        apc_linear_next(m, p->x, p->input, p->next);
        memcpy(p->x, p->next, m->nx * sizeof(*p->x));
    }
}

/* Where y of sample i is to be: at its setpoint or in its zone, within its limits. Returns false where the
 * setpoint itself lies outside. */
static bool aim(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i)
{
    bool inside = true;

    for (size_t c = 0; c < p->ny; c++) {
        const bool limited = p->row_of_limit[c] != SIZE_MAX;
        const double low = limited ? call->y_low[c] : -HUGE_VAL, high = limited ? call->y_high[c] : HUGE_VAL;
        const double w = call->w[i * p->ny + c];

        p->aim_low[c] = p->q[c] > 0.0 ? w - p->zone[c] : low;
        p->aim_high[c] = p->q[c] > 0.0 ? w + p->zone[c] : high;
        inside = inside && p->aim_low[c] <= high && p->aim_high[c] >= low;
        p->aim_low[c] = fmin(fmax(p->aim_low[c], low), high);
        p->aim_high[c] = fmin(fmax(p->aim_high[c], low), high);
    }
    return inside;
}

static bool same(const double *row, size_t i, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (row[i * n + k] != row[(i - 1) * n + k])
            return false;
    }
    return true;
}

/* Is each output somebody else's? */
static bool is_bound(const struct apc_mpc *p, const struct apc_mpc_call *call)
{
    size_t given = 0;

    while (given < p->nu && call->given[given])
        given++;
    return given == p->nu;
}

/* Nothing else is known of them, or can be changed. */
static void aim_at_setpoints(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    p->aims = false;
    p->reachable = true;
    for (size_t i = 1; i <= p->N; i++) {
        p->reachable = aim(p, call, i) && p->reachable;
        for (size_t c = 0; c < p->ny; c++)
            p->target_y[(i - 1) * p->ny + c] =
                p->q[c] > 0.0 ? (p->aim_low[c] + p->aim_high[c]) / 2.0 : call->w[i * p->ny + c];
        memcpy(p->target_u + (i - 1) * p->nu, call->u_wish, p->nu * sizeof(*call->u_wish));
    }
}

/* Of sample i, as aim() says; a nonlinear model's from where target_x and u are. */
static int find_target(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i, double *u, double *y,
                       bool *reachable)
{
    const struct apc_target_call of = {.unknown = call->x + p->nc,
                                       .d = call->d ? call->d + i * p->nd : NULL,
                                       .wish = call->u_wish,
                                       .cost = call->u_cost,
                                       .low = p->low,
                                       .high = p->high,
                                       .y_low = p->aim_low,
                                       .y_high = p->aim_high,
                                       .q = p->q,
                                       .rank = p->rank,
                                       .ranks = p->ranks};
    int rc;

    if (!p->linearise)
        return apc_target_find(p->target, &of, p->target_x, u, y, reachable);
    rc = apc_target_search(p->target, &of, p->linearise, p->ctx, p->target_x, u, y, reachable);
    for (size_t c = 0; c < p->ny && rc == 0 && *reachable; c++) {
        if (p->q[c] > 0.0 && p->aim_low[c] == p->aim_high[c])
            y[c] = p->aim_low[c];
    }
    return rc;
}

static int find_targets(struct apc_mpc *p, const struct apc_mpc_call *call, unsigned *solves)
{
    const size_t ny = p->ny, nu = p->nu;

    p->aims = p->reachable = true;
    for (size_t k = 0; k < nu; k++) {
        p->low[k] = call->given[k] ? call->u_last[k] : call->low[k];
        p->high[k] = call->given[k] ? call->u_last[k] : call->high[k];
    }
    for (size_t i = 1; i <= p->N; i++) {
        double *y = p->target_y + (i - 1) * ny, *u = p->target_u + (i - 1) * nu;
        bool inside, reachable;
        int rc;

        if (i > 1 && same(call->w, i, p->ny) && (!call->d || same(call->d, i, p->nd))) {
            memcpy(y, y - ny, ny * sizeof(*y));
            memcpy(u, u - nu, nu * sizeof(*u));
            continue;
        }
        inside = aim(p, call, i);
        if (p->linearise && i > 1)
            memcpy(u, u - nu, nu * sizeof(*u));
        rc = find_target(p, call, i, u, y, &reachable);
        ++*solves;
        if (rc < 0)
            return rc;
        p->reachable = p->reachable && inside && reachable;
        if (p->linearise && i == 1)
            memcpy(p->near, p->target_x, p->nc * sizeof(*p->near));
    }
    return 0;
}

void apc_mpc_aim(struct apc_mpc *p, const struct apc_mpc_call *call, double *x, double *u)
{
    unsigned solves = 0;

    memcpy(p->target_x, x, p->nc * sizeof(*x));
    memcpy(p->target_u, u, p->nu * sizeof(*u));
    if (is_bound(p, call) || find_targets(p, call, &solves) < 0) {
        aim_at_setpoints(p, call);
        return;
    }
    memcpy(x, p->near, p->nc * sizeof(*x));
    memcpy(u, p->target_u, p->nu * sizeof(*u));
}

/* f = G' q (free_y - target_y), four rows at a time. */
QP_LANES static void pull(struct apc_mpc *p)
{
    const size_t n = p->n, rows = summed(p) * p->ny;
    size_t i = 0;

    memset(p->f, 0, n * sizeof(*p->f));
    for (size_t c = 0; i < rows; i++, c = c + 1 < p->ny ? c + 1 : 0)
        p->pulling[i] = tracked(p, c) * (p->target_y[i] - p->free_y[i]);
    for (i = 0; i + 4 <= rows; i += 4) {
        const double *row = p->G + i * n, *const four[] = {row, row + n, row + 2 * n, row + 3 * n};

        qp_add_four(n, p->pulling + i, four, p->f);
    }
    for (; i < rows; i++)
        qp_add(n, -p->pulling[i], p->G + i * n, p->f);
}

QP_LANES static void gradient(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    const struct apc_linear *m = p->model;
    const size_t n = p->n, nu = p->nu, nc = p->nc, na = nc + nu;

    pull(p);
    for (size_t block = 0; block < p->blocks; block++) {
        const size_t sample = p->first[block];
        const double *u = p->target_u + (sample > 0 ? sample - 1 : 0) * nu;

        for (size_t j = 0; j < nu; j++) {
            p->f[block * nu + j] -= wished(p, block, j) * (u[j] - m->u0[j]);
            if (block == 0)
                p->f[j] -= p->s[j] * (call->u_last[j] - m->u0[j]);
        }
    }
    if (!p->ends)
        return;
    for (size_t i = 0; i < nc; i++)
        p->difference[i] = p->x[i] - p->target_x[i];
    for (size_t j = 0; j < nu; j++)
        p->difference[nc + j] = m->u0[j] - p->target_u[(p->N - 1) * nu + j];
    for (size_t i = 0; i < na; i++)
        qp_add(n, p->difference[i], p->PG + i * n, p->f);
}

/* Limits of the moves. A u that stands outside comes back as fast as its rate allows. */
static void bound_moves(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    for (size_t b = 0; b < p->blocks; b++) {
        for (size_t j = 0; j < p->nu; j++) {
            const double u0 = p->model->u0[j], last = call->u_last[j],
                         reach = call->step[j] * (double)(b + 1);
            double low = lesser(call->low[j], last + reach), high = greater(call->high[j], last - reach);

            if (b == 0) {
                p->paced[j] = (last - reach > low ? (unsigned)APC_MPC_FALLS : 0u) |
                              (last + reach < high ? (unsigned)APC_MPC_RISES : 0u);
                low = greater(low, last - reach);
                high = lesser(high, last + reach);
            }
            p->low[b * p->nu + j] = (call->given[j] ? last : low) - u0;
            p->high[b * p->nu + j] = (call->given[j] ? last : high) - u0;
        }
    }
    for (size_t k = 0; k < p->n_rates; k++) {
        const double step = call->step[p->rate_of[k].j];

        p->low[p->n + k] = -step;
        p->high[p->n + k] = step;
    }
}

/* Zones; while limits are given up they wait. */
static void bound_zones(struct apc_mpc *p, const struct apc_mpc_call *call, bool wait)
{
    for (size_t c = 0; c < p->ny; c++) {
        const bool active = !wait && p->zone[c] > 0.0 && p->q[c] > 0.0;
        double *low = p->low + p->n + p->row_of_zone[c], *high = p->high + p->n + p->row_of_zone[c];

        for (size_t i = 0; i < p->N && p->row_of_zone[c] != SIZE_MAX; i++) {
            const double w = call->w[(i + 1) * p->ny + c] - p->free_y[i * p->ny + c];

            low[i] = active ? w - p->zone[c] : -HUGE_VAL;
            high[i] = active ? w + p->zone[c] : HUGE_VAL;
        }
    }
}

static void bound_output(struct apc_mpc *p, const struct apc_mpc_call *call, size_t c, bool wait)
{
    double *low = p->low + p->n + p->row_of_limit[c], *high = p->high + p->n + p->row_of_limit[c];

    for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++) {
        const double y = p->free_y[i * p->ny + c];

        low[i] = wait ? -HUGE_VAL : call->y_low[c] - y;
        high[i] = wait ? HUGE_VAL : call->y_high[c] - y;
    }
}

static int solve(struct apc_mpc *p, struct apc_qp *qp, struct apc_mpc_result *result)
{
    struct apc_qp_result r = {.size = sizeof(r)};
    int rc = apc_qp_solve(qp, p->f, p->low, p->high, p->v, &r);

    result->solves++;
    result->iterations += r.iterations;
    return rc;
}

/* Widen the limits of one y by what the plan breaks them, and a little, so that it can be done again. Returns
 * true when it does break them. */
static bool widen(struct apc_mpc *p, size_t c, double share)
{
    double *low = p->low + p->n + p->row_of_limit[c], *high = p->high + p->n + p->row_of_limit[c];
    bool broken = false;

    for (size_t i = 0; i < p->N; i++) {
        const double y = apc_matrix_dot(p->G + (i * p->ny + c) * p->n, p->v, p->n);
        const double size = 1.0 + fabs(y), room = share * size;

        broken = broken || y < low[i] - BROKEN * size || y > high[i] + BROKEN * size;
        low[i] = fmin(low[i], y - room);
        high[i] = fmax(high[i], y + room);
    }
    return broken;
}

/* To begin the next solve from where this one led. */
static void pull_to_plan(struct apc_mpc *p)
{
    for (size_t k = 0; k < p->n; k++)
        p->f[k] = -p->H_easy[k * p->n + k] * p->v[k];
}

/* What the limits of a rank are broken by at least. A pull may be too weak for its solve to come to an end:
 * that one would have changed next to nothing. */
static int break_least(struct apc_mpc *p, struct apc_mpc_result *result)
{
    const int rc = solve(p, p->easy_qp, result);
    bool moves = rc == 0;

    for (int again = 1; again < AGAIN && moves; again++) {
        pull_to_plan(p);
        moves = solve(p, p->easy_qp, result) == 0;
        for (size_t k = 0; k < p->n && !moves; k++)
            p->v[k] = -p->f[k] / p->H_easy[k * p->n + k];
    }
    pull_to_plan(p);
    return rc;
}

/* Rank by rank, from the first: what it breaks of its limits, at least, is allowed to it from then on. */
static int give_up(struct apc_mpc *p, const struct apc_mpc_call *call, double room,
                   struct apc_mpc_result *result)
{
    int rc = p->easy_stale ? make_easy(p, NULL) : 0;

    p->easy_stale = false;
    if (p->easy_waits)
        apc_qp_start(p->easy_qp, p->room);
    p->easy_waits = false;
    bound_zones(p, call, true);
    for (size_t b = 0; b < p->blocks; b++) {
        for (size_t j = 0; j < p->nu; j++) {
            const size_t k = b * p->nu + j;

            p->f[k] = -p->H_easy[k * p->n + k] * (call->u_last[j] - p->model->u0[j]);
        }
    }
    for (size_t c = 0; c < p->ny; c++)
        bound_output(p, call, c, true);
    for (unsigned rank = 1; rank <= p->ranks && rc == 0; rank++) {
        memset(p->easy, 0, (p->n + p->m) * sizeof(*p->easy));
        for (size_t c = 0; c < p->ny; c++) {
            if (p->rank[c] != rank)
                continue;
            bound_output(p, call, c, false);
            for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++)
                p->easy[p->n + p->row_of_limit[c] + i] = 1.0;
        }
        (void)apc_qp_soft(p->easy_qp, p->none, p->easy);
        rc = break_least(p, result);
        if (rc == 0)
            memcpy(p->broken, p->v, p->n * sizeof(*p->v));
        for (size_t c = 0; c < p->ny && rc == 0; c++) {
            if (p->rank[c] == rank && p->row_of_limit[c] != SIZE_MAX && widen(p, c, room) &&
                !result->given_up)
                result->given_up = rank;
        }
    }
    return rc;
}

/* Was there no time to go on, or no more of what stands for it? */
static bool is_cut(const struct apc_mpc *p, int rc)
{
    return (rc == APC_ETIMEDOUT && p->few) || (p->enough && p->enough(p->ctx));
}

/* Without limits that cannot be kept. What they leave may be a single point, and rounding does not find it:
 * then there are still the moves that break least, and setpoints have to wait. */
static void solve_without(struct apc_mpc *p, const struct apc_mpc_call *call, struct apc_mpc_result *result)
{
    double room = LITTLE;

    do {
        result->given_up = 0;
        result->rc = give_up(p, call, room, result);
        if (result->rc == 0) {
            gradient(p, call);
            bound_zones(p, call, false);
            result->rc = solve(p, p->qp, result);
        }
        room *= 10.0;
    } while (result->rc < 0 && room <= MUCH && !is_cut(p, result->rc));
    if (result->rc < 0 && result->given_up && !is_cut(p, result->rc)) {
        memcpy(p->v, p->broken, p->n * sizeof(*p->v));
        result->rc = 0;
    }
}

void apc_mpc_solve(struct apc_mpc *p, const struct apc_mpc_call *call, double *plan,
                   struct apc_mpc_result *result)
{
    *result = (struct apc_mpc_result){0};
    memcpy(p->u_last, call->u_last, p->nu * sizeof(*p->u_last));
    if (!p->linearise && p->nd)
        coast_disturbed(p, call);
    else if (!p->linearise)
        coast(p, call);
    if (!p->linearise && is_bound(p, call))
        aim_at_setpoints(p, call);
    else if (!p->linearise)
        result->rc = find_targets(p, call, &result->solves);
    if (result->rc < 0)
        return;
    result->reachable = p->reachable;
    gradient(p, call);
    bound_moves(p, call);
    bound_zones(p, call, false);
    for (size_t c = 0; c < p->ny; c++)
        bound_output(p, call, c, false);
    result->rc = solve(p, p->qp, result);
    if (result->rc == APC_ERANGE || (result->rc == APC_ETIMEDOUT && !is_cut(p, result->rc)))
        solve_without(p, call, result);
    for (size_t b = 0; b < p->blocks && result->rc == 0; b++) {
        for (size_t j = 0, k = b * p->nu; j < p->nu; j++, k++)
            plan[k] = p->model->u0[j] + lesser(greater(p->v[k], p->low[k]), p->high[k]);
    }
}

QP_LANES static void respond_to_moves(const struct apc_mpc *p, double *y)
{
    for (size_t i = 0; i < p->N * p->ny; i++)
        y[i] = p->free_y[i] + qp_dot(p->n, p->G + i * p->n, p->v);
}

/* v of a plan. */
static void take_plan(const struct apc_mpc *p, const double *plan)
{
    for (size_t b = 0; b < p->blocks; b++) {
        for (size_t j = 0; j < p->nu; j++)
            p->v[b * p->nu + j] = plan[b * p->nu + j] - p->model->u0[j];
    }
}

void apc_mpc_predict(const struct apc_mpc *p, const double *plan, double *y)
{
    take_plan(p, plan);
    respond_to_moves(p, y);
}

/* Of samples: y's distance from its target or, in a zone, from its edge. */
static double cost_of_y(const struct apc_mpc *p, const double *y)
{
    double sum = 0.0;

    for (size_t i = 0; i < p->N; i++) {
        for (size_t c = 0; c < p->ny; c++) {
            const size_t k = i * p->ny + c;
            double away = y[k] - p->target_y[k];

            if (p->zone[c] > 0.0 && p->row_of_zone[c] != SIZE_MAX) {
                const size_t row = p->n + p->row_of_zone[c] + i;
                const double inside = y[k] - p->free_y[k];

                away = fmax(fmax(inside - p->high[row], p->low[row] - inside), 0.0);
            } else if (i >= summed(p)) {
                continue;
            }
            sum += 0.5 * p->q[c] * away * away;
        }
    }
    return sum;
}

static double cost_of_moves(const struct apc_mpc *p, const double *plan)
{
    const double *before = p->u_last;
    double sum = 0.0;

    for (size_t b = 0; b < p->blocks; b++, before = plan, plan += p->nu) {
        const size_t sample = p->first[b];
        const double *aimed = p->target_u + (sample > 0 ? sample - 1 : 0) * p->nu;

        for (size_t j = 0; j < p->nu; j++) {
            const double move = plan[j] - before[j], away = plan[j] - aimed[j];

            sum += 0.5 * (p->s[j] * move * move + wished(p, b, j) * away * away);
        }
    }
    return sum;
}

/* What comes after the horizon. */
QP_LANES static double cost_of_rest(struct apc_mpc *p, const double *plan)
{
    const size_t nc = p->nc, nu = p->nu, na = nc + nu;
    double sum = 0.0;
    size_t k = 0;

    for (size_t i = 0; i < nc; i++)
        p->far[i] = p->x[i] - p->target_x[i];
    take_plan(p, plan);
    for (; k + 4 <= p->n; k += 4) {
        const double *row = p->Gx + k * nc;

        qp_add_each(nc, p->v + k, (const double *const[]){row, row + nc, row + 2 * nc, row + 3 * nc}, p->far);
    }
    for (; k < p->n; k++)
        qp_add(nc, p->v[k], p->Gx + k * nc, p->far);
    for (size_t j = 0; j < nu; j++)
        p->far[nc + j] = plan[p->n - nu + j] - p->target_u[(p->N - 1) * nu + j];
    for (size_t i = 0; i < na; i++)
        sum += 0.5 * p->far[i] * apc_matrix_dot(p->P + i * na, p->far, na);
    return fmax(sum, 0.0); /* rounding */
}

double apc_mpc_cost(struct apc_mpc *p, const double *plan, const double *y)
{
    return cost_of_y(p, y) + cost_of_moves(p, plan) + (p->ends && p->aims ? cost_of_rest(p, plan) : 0.0);
}

void apc_mpc_target(const struct apc_mpc *p, size_t i, double *y, double *u)
{
    memcpy(y, p->target_y + (i - 1) * p->ny, p->ny * sizeof(*y));
    memcpy(u, p->target_u + (i - 1) * p->nu, p->nu * sizeof(*u));
}

const double *apc_mpc_move(const struct apc_mpc *p, const double *plan, size_t i)
{
    return plan + p->block_at[i < p->N ? i : p->N - 1] * p->nu;
}

size_t apc_mpc_rows(const struct apc_mpc *p)
{
    return p->n + p->m;
}

const signed char *apc_mpc_active(const struct apc_mpc *p)
{
    return apc_qp_rows(p->qp);
}

void apc_mpc_start(struct apc_mpc *p)
{
    apc_qp_start(p->qp, p->room);
    p->easy_waits = true;
}

void apc_mpc_limiting(const struct apc_mpc *p, const signed char *rows, unsigned *u, unsigned *y)
{
    memset(u, 0, p->nu * sizeof(*u));
    memset(y, 0, p->ny * sizeof(*y));
    for (size_t b = 0, k = 0; b < p->blocks; b++) {
        for (size_t j = 0; j < p->nu; j++, k++) {
            const unsigned paced = b == 0 ? p->paced[j] : 0;

            if (rows[k] < 0)
                u[j] |= paced & APC_MPC_FALLS ? APC_MPC_FALLS : APC_MPC_LOW;
            else if (rows[k] > 0)
                u[j] |= paced & APC_MPC_RISES ? APC_MPC_RISES : APC_MPC_HIGH;
        }
    }
    for (size_t k = 0; k < p->n_rates; k++)
        if (rows[p->n + k])
            u[p->rate_of[k].j] |= rows[p->n + k] < 0 ? APC_MPC_FALLS : APC_MPC_RISES;
    for (size_t c = 0; c < p->ny; c++)
        for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++)
            if (rows[p->n + p->row_of_limit[c] + i])
                y[c] |= rows[p->n + p->row_of_limit[c] + i] < 0 ? APC_MPC_LOW : APC_MPC_HIGH;
}

signed char *apc_mpc_room(struct apc_mpc *p)
{
    return p->room;
}
