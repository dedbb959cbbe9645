/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Condensed: the moves v = u - u0 of the blocks are the only unknowns, y of sample i is what would come with
 * v = 0 plus G_i v, G made of step responses once. So bounds on u need no rows, and the program has the size
 * of the moves, not of the horizon. What would come with v = 0 is linear as well, in the state: F is made
 * once; only where disturbances are measured it is gone through sample by sample.
 */
#include "predict/mpc_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"

/* While limits are given up, what a move costs beside their violation. */
#define EASY 1e-4

/* ---- Making -------------------------------------------------------------------------------------- */

static int check_mpc_options(const struct apc_mpc_options *o, struct apc_error *why)
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
static void step_responses(struct apc_mpc *p)
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

void mpc_make_rows(struct apc_mpc *p)
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
    p->first = calloc(p->blocks + 2 * p->ny + 2 * p->N, sizeof(*p->first));
    p->rate_of = calloc(p->n, sizeof(*p->rate_of));
    p->rank = calloc(p->ny, sizeof(*p->rank));
    if (!p->first || !p->rank || !p->rate_of)
        return APC_ENOMEM;
    p->row_of_limit = p->first + p->blocks;
    p->row_of_zone = p->row_of_limit + p->ny;
    p->block_at = p->row_of_zone + p->ny;
    p->columns = p->block_at + p->N;
    for (size_t b = 0; b + 1 < p->blocks; b++)
        p->first[b + 1] = p->first[b] + o->block[b];
    for (size_t i = 0, b = 0; i < p->N; i++) {
        b += b + 1 < p->blocks && i == p->first[b + 1];
        p->block_at[i] = b;
    }
    for (size_t i = 0; i < p->N; i++) {
        const size_t moves = (p->block_at[i + 1 < p->N ? i + 1 : i] + 1) * p->nu,
                     eights = (moves + 7) / 8 * 8;

        p->columns[i] = eights < p->n ? eights : p->n;
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

static int allocate_mpc(struct apc_mpc *p)
{
    const size_t n = p->n, m = p->m, ny = p->ny, nu = p->nu, N = p->N, nx = p->model->nx, na = p->nc + nu;
    const size_t of_terminal =
        p->terminal ? 3 * na * na + 2 * na * nu + nu * nu + apc_riccati_room(na, nu) : 0;
    const struct apc_part parts[] = {APC_PART(p->room, n + m),
                                     APC_PART(p->paced, nu),
                                     APC_PART_COPY(p->u_last, nu, p->model->u0),
                                     APC_PART(p->G, N * ny * n),
                                     APC_PART(p->Gx, n * p->nc),
                                     APC_PART(p->F, nx * N * ny),
                                     APC_PART(p->Fx, nx * nx),
                                     APC_PART(p->A, m * n),
                                     APC_PART(p->H, n * n),
                                     APC_PART(p->H_easy, n * n),
                                     APC_PART(p->q, ny),
                                     APC_PART(p->zone, ny),
                                     APC_PART(p->least, ny),
                                     APC_PART(p->price, ny),
                                     APC_PART(p->worth, N * ny),
                                     APC_PART(p->s, nu),
                                     APC_PART(p->r, nu),
                                     APC_PART(p->P, na * na),
                                     APC_PART(p->PG, na * n),
                                     APC_PART(p->riccati, of_terminal),
                                     APC_PART(p->square, n + m),
                                     APC_PART(p->none, n + m),
                                     APC_PART(p->easy, n + m),
                                     APC_PART(p->low, n + m),
                                     APC_PART(p->high, n + m),
                                     APC_PART(p->f, n),
                                     APC_PART(p->bent, n),
                                     APC_PART(p->v, n),
                                     APC_PART(p->broken, n),
                                     APC_PART(p->free_y, N * ny),
                                     APC_PART(p->target_y, N * ny),
                                     APC_PART(p->pulling, N * ny),
                                     APC_PART(p->target_u, N * nu),
                                     APC_PART(p->target_x, p->nc),
                                     APC_PART(p->near, p->nc),
                                     APC_PART(p->x, nx),
                                     APC_PART(p->next, nx),
                                     APC_PART(p->input, nu + p->nd),
                                     APC_PART(p->aim_low, ny),
                                     APC_PART(p->aim_high, ny),
                                     APC_PART(p->difference, na),
                                     APC_PART(p->far, na)};

    p->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return p->memory ? 0 : APC_ENOMEM;
}

/* While limits are being given up, a move costs little: of its effect on y. */
int mpc_make_easy(struct apc_mpc *p, struct apc_error *why)
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
                                      .ctx = options->ctx,
                                      .definite = true};
    struct apc_mpc *p;
    int rc = check_mpc_options(options, why);

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
    if (count_rows(p, options) < 0 || allocate_mpc(p) < 0)
        rc = apc_fail(why, APC_ENOMEM, "predictive control: no memory");
    p->steps = p->few ? options->iterations : (unsigned)(10 * (p->n + p->m));
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
        step_responses(p);
        mpc_make_rows(p);
        rc = apc_values_ok(p->G, p->N * p->ny * p->n) && apc_values_ok(p->F, m->nx * p->N * p->ny)
                 ? mpc_make_easy(p, why)
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
    free(mpc->rate_of);
    free(mpc->rank);
    free(mpc->first);
    free(mpc);
}

/* ---- What came of it -------------------------------------------------------------------------------- */

QP_LANES static void respond_to_moves(const struct apc_mpc *p, double *y)
{
    for (size_t i = 0, k = 0; i < p->N; i++) {
        for (size_t c = 0; c < p->ny; c++, k++)
            y[k] = p->free_y[k] + qp_dot(p->columns[i], p->G + k * p->n, p->v);
    }
}

/* v of a plan. */
static void inputs_of_plan(const struct apc_mpc *p, const double *plan)
{
    const double *u0 = p->model->u0;
    double *v = p->v;

    for (size_t b = 0; b < p->blocks; b++, v += p->nu, plan += p->nu) {
        for (size_t j = 0; j < p->nu; j++)
            v[j] = plan[j] - u0[j];
    }
}

/* Of samples: y's distance from its target or, in a zone, from its edge. */
static double cost_of_y(const struct apc_mpc *p, const double *y)
{
    const size_t end = summed(p);
    double sum = 0.0;

    for (size_t i = 0, k = 0; i < p->N; i++) {
        for (size_t c = 0; c < p->ny; c++, k++) {
            double away = y[k] - p->target_y[k];

            if (p->zone[c] > 0.0 && p->row_of_zone[c] != SIZE_MAX) {
                const size_t row = p->n + p->row_of_zone[c] + i;
                const double inside = y[k] - p->free_y[k];

                away = fmax(fmax(inside - p->high[row], p->low[row] - inside), 0.0);
            } else if (i >= end) {
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

            sum += 0.5 * (p->s[j] * move * move + reference_weight(p, b, j) * away * away);
        }
    }
    return sum;
}

/* What comes after the horizon, with the plan in v. */
QP_LANES static double cost_of_rest(struct apc_mpc *p, const double *plan)
{
    const size_t nc = p->nc, nu = p->nu, na = nc + nu;
    double sum = 0.0;
    size_t k = 0;

    for (size_t i = 0; i < nc; i++)
        p->far[i] = p->x[i] - p->target_x[i];
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

double apc_mpc_predict(struct apc_mpc *p, const double *plan, double *y)
{
    inputs_of_plan(p, plan);
    respond_to_moves(p, y);
    return cost_of_y(p, y) + apc_matrix_dot(p->worth, y, p->N * p->ny) + cost_of_moves(p, plan) +
           (p->ends && p->aims ? cost_of_rest(p, plan) : 0.0);
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

/* The next row from @p k on that holds the plan back; n: there is none. Nearly all do not. */
static size_t next_held(const signed char *rows, size_t k, size_t n)
{
    static const signed char none[8];

    while (k < n && !rows[k])
        k += k + 8 <= n && !memcmp(rows + k, none, 8) ? 8 : 1;
    return k;
}

void apc_mpc_limiting(const struct apc_mpc *p, const signed char *rows, unsigned *u, unsigned *y)
{
    memset(u, 0, p->nu * sizeof(*u));
    memset(y, 0, p->ny * sizeof(*y));
    for (size_t k = next_held(rows, 0, p->n); k < p->n; k = next_held(rows, k + 1, p->n)) {
        const size_t j = k % p->nu;
        const unsigned paced = k < p->nu ? p->paced[j] : 0;

        if (rows[k] < 0)
            u[j] |= paced & APC_MPC_FALLS ? APC_MPC_FALLS : APC_MPC_LOW;
        else
            u[j] |= paced & APC_MPC_RISES ? APC_MPC_RISES : APC_MPC_HIGH;
    }
    rows += p->n;
    for (size_t k = next_held(rows, 0, p->n_rates); k < p->n_rates; k = next_held(rows, k + 1, p->n_rates))
        u[p->rate_of[k].j] |= rows[k] < 0 ? APC_MPC_FALLS : APC_MPC_RISES;
    for (size_t c = 0; c < p->ny; c++) {
        const size_t begin = p->row_of_limit[c], end = begin != SIZE_MAX ? begin + p->N : begin;

        for (size_t k = next_held(rows, begin, end); k < end; k = next_held(rows, k + 1, end))
            y[c] |= rows[k] < 0 ? APC_MPC_LOW : APC_MPC_HIGH;
    }
}

/* Which of the pair of limits @p pair [2 * n] of signal @p i, low ones first, a multiplier is of. */
static void price_limit(double *pair, size_t n, size_t i, double multiplier)
{
    pair[multiplier > 0.0 ? n + i : i] += fabs(multiplier);
}

void apc_mpc_multipliers(const struct apc_mpc *p, double *u, double *y)
{
    const double *row = apc_qp_multipliers(p->qp);

    memset(u, 0, 4 * p->nu * sizeof(*u));
    memset(y, 0, 2 * p->ny * sizeof(*y));
    for (size_t k = 0; k < p->n; k++) {
        const size_t j = k % p->nu;
        const unsigned pace = row[k] > 0.0 ? APC_MPC_RISES : APC_MPC_FALLS;

        price_limit(k < p->nu && p->paced[j] & pace ? u + 2 * p->nu : u, p->nu, j, row[k]);
    }
    row += p->n;
    for (size_t k = 0; k < p->n_rates; k++)
        price_limit(u + 2 * p->nu, p->nu, p->rate_of[k].j, row[k]);
    for (size_t c = 0; c < p->ny; c++)
        for (size_t i = 0; p->row_of_limit[c] != SIZE_MAX && i < p->N; i++)
            price_limit(y, p->ny, c, row[p->row_of_limit[c] + i]);
}

signed char *apc_mpc_room(struct apc_mpc *p)
{
    return p->room;
}
