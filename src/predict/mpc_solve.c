/* SPDX-License-Identifier: BSD-3-Clause */
/* The moves, and what becomes of limits that cannot be kept. */
#include "predict/mpc_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"

/* Of solves from where the one before led: they take away what the pull of moves has done. */
enum { AGAIN = 3 };
/* What is allowed to a rank beyond what it breaks, over the size of y, so that the ranks after it have a
 * place to look in; where they look in vain, more. What is told as broken. */
#define LITTLE 1e-8
#define MUCH   2e-4
#define BROKEN 1e-6

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
    const size_t nx = m->nx, rows = p->N * p->ny;
    double *away = p->next;
    size_t k = 0;

    for (size_t i = 0; i < p->N; i++)
        mpc_copy(p->ny, m->y0, p->free_y + i * p->ny);
    memcpy(p->x, m->x0, nx * sizeof(*p->x));
    for (size_t i = 0; i < nx; i++)
        away[i] = call->x[i] - m->x0[i];
    for (; k + 4 <= nx; k += 4) {
        const double *row = p->F + k * rows, *end = p->Fx + k * nx;

        qp_add_each(rows, away + k, (const double *const[]){row, row + rows, row + 2 * rows, row + 3 * rows},
                    p->free_y);
        if (p->terminal)
            qp_add_each(nx, away + k, (const double *const[]){end, end + nx, end + 2 * nx, end + 3 * nx},
                        p->x);
    }
    for (; k < nx; k++) {
        qp_add(rows, away[k], p->F + k * rows, p->free_y);
        if (p->terminal)
            qp_add(nx, away[k], p->Fx + k * nx, p->x);
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

/* f = G' q (free_y - target_y), four rows at a time. */
QP_LANES static void pull(struct apc_mpc *p)
{
    const size_t n = p->n, ny = p->ny, rows = summed(p) * ny;
    size_t i = 0;

    memset(p->f, 0, n * sizeof(*p->f));
    for (size_t c = 0; c < ny; c++) {
        const double q = tracked(p, c);

        for (i = c; i < rows; i += ny)
            p->pulling[i] = q * (p->target_y[i] - p->free_y[i]);
    }
    for (i = 0; i + 4 <= rows; i += 4) {
        const double *row = p->G + i * n, *const four[] = {row, row + n, row + 2 * n, row + 3 * n};

        qp_add_four(p->columns[(i + 3) / ny], p->pulling + i, four, p->f);
    }
    for (; i < rows; i++)
        qp_add(n, -p->pulling[i], p->G + i * n, p->f);
}

/* What y costs by its price; terminal weight or not, of all samples. */
static void pull_by_prices(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    for (size_t k = 0; k < p->N * p->ny; k++) {
        const double price = p->price[k % p->ny];

        p->worth[k] = price != 0.0 ? price * call->w[k + p->ny] : 0.0;
        if (p->worth[k] != 0.0)
            qp_add(p->n, p->worth[k], p->G + k * p->n, p->f);
    }
    for (size_t k = 0; k < p->n && p->linearise; k++)
        p->f[k] += p->bent[k];
}

/* Away from where moves want to be, and from what acts now. */
static void pull_to_reference(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    const size_t nu = p->nu;

    for (size_t j = 0; j < nu; j++) {
        const double u0 = p->model->u0[j];

        for (size_t b = 0; b < p->blocks && p->r[j] > 0.0; b++) {
            const size_t sample = p->first[b] > 0 ? p->first[b] - 1 : 0;

            p->f[b * nu + j] -= reference_weight(p, b, j) * (p->target_u[sample * nu + j] - u0);
        }
        p->f[j] -= p->s[j] * (call->u_last[j] - u0);
    }
}

QP_LANES static void mpc_gradient(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    const struct apc_linear *m = p->model;
    const size_t n = p->n, nu = p->nu, nc = p->nc, na = nc + nu;
    size_t i = 0;

    pull(p);
    pull_by_prices(p, call);
    pull_to_reference(p, call);
    if (!p->ends)
        return;
    for (size_t k = 0; k < nc; k++)
        p->difference[k] = p->x[k] - p->target_x[k];
    for (size_t j = 0; j < nu; j++)
        p->difference[nc + j] = m->u0[j] - p->target_u[(p->N - 1) * nu + j];
    for (; i + 4 <= na; i += 4) {
        const double *row = p->PG + i * n, *const four[] = {row, row + n, row + 2 * n, row + 3 * n};

        qp_add_each(n, p->difference + i, four, p->f);
    }
    for (; i < na; i++)
        qp_add(n, p->difference[i], p->PG + i * n, p->f);
}

/* Limits of one input's moves, the first within reach of what acts now. One that stands outside comes back as
 * fast as its rate allows. */
static void bound_moves(struct apc_mpc *p, const struct apc_mpc_call *call, size_t j)
{
    const double u0 = p->model->u0[j], last = call->u_last[j], step = call->step[j], least = call->low[j],
                 most = call->high[j];
    double *low = p->low + j, *high = p->high + j;

    for (size_t b = 0; b < p->blocks; b++, low += p->nu, high += p->nu) {
        const double reach = step * (double)(b + 1);

        *low = (call->given[j] ? last : lesser(least, last + reach)) - u0;
        *high = (call->given[j] ? last : greater(most, last - reach)) - u0;
    }
    const double first = lesser(least, last + step), end = greater(most, last - step);

    p->paced[j] = (last - step > first ? (unsigned)APC_MPC_FALLS : 0u) |
                  (last + step < end ? (unsigned)APC_MPC_RISES : 0u);
    if (call->given[j])
        return;
    p->low[j] = greater(first, last - step) - u0;
    p->high[j] = lesser(end, last + step) - u0;
}

static void bound_rates(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    double *low = p->low + p->n, *high = p->high + p->n;

    for (size_t k = 0; k < p->n_rates; k++) {
        const double step = call->step[p->rate_of[k].j];

        low[k] = -step;
        high[k] = step;
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

static void bound_controlled(struct apc_mpc *p, const struct apc_mpc_call *call, size_t c, bool wait)
{
    double *low = p->low + p->n + p->row_of_limit[c], *high = p->high + p->n + p->row_of_limit[c];
    const double least = wait ? -HUGE_VAL : call->y_low[c], most = wait ? HUGE_VAL : call->y_high[c];
    const double *y = p->free_y + c;

    for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++, y += p->ny) {
        low[i] = least - *y;
        high[i] = most - *y;
    }
}

static int solve_mpc_qp(struct apc_mpc *p, struct apc_qp *qp, struct apc_mpc_result *result)
{
    struct apc_qp_result r = {.size = sizeof(r)};
    int rc = apc_qp_solve(qp, p->f, p->low, p->high, p->v, &r);

    result->solves++;
    result->iterations += r.iterations;
    return rc;
}

/* Widen the limits of one y by what the plan breaks them, and a little, so that it can be done again. */
static void relax_limits(struct apc_mpc *p, size_t c, double share)
{
    double *low = p->low + p->n + p->row_of_limit[c], *high = p->high + p->n + p->row_of_limit[c];

    for (size_t i = 0; i < p->N; i++) {
        const double y = apc_matrix_dot(p->G + (i * p->ny + c) * p->n, p->v, p->n);
        const double room = share * (1.0 + fabs(y));

        low[i] = fmin(low[i], y - room);
        high[i] = fmax(high[i], y + room);
    }
}

/* Does the plan break the limits of y? */
static bool breaks(const struct apc_mpc *p, const struct apc_mpc_call *call, size_t c)
{
    for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++) {
        const double moved = apc_matrix_dot(p->G + (i * p->ny + c) * p->n, p->v, p->n),
                     y = p->free_y[i * p->ny + c] + moved, much = BROKEN * (1.0 + fabs(moved));

        if (y < call->y_low[c] - much || y > call->y_high[c] + much)
            return true;
    }
    return false;
}

/* The lowest rank whose limits the plan breaks; 0: none. */
static unsigned broken_rank(const struct apc_mpc *p, const struct apc_mpc_call *call)
{
    unsigned lowest = 0;

    for (size_t c = 0; c < p->ny; c++) {
        if ((!lowest || p->rank[c] < lowest) && breaks(p, call, c))
            lowest = p->rank[c];
    }
    return lowest;
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
    const int rc = solve_mpc_qp(p, p->easy_qp, result);
    bool moves = rc == 0;

    for (int again = 1; again < AGAIN && moves; again++) {
        pull_to_plan(p);
        moves = solve_mpc_qp(p, p->easy_qp, result) == 0;
        for (size_t k = 0; k < p->n && !moves; k++)
            p->v[k] = -p->f[k] / p->H_easy[k * p->n + k];
    }
    pull_to_plan(p);
    return rc;
}

/* Rank by rank, from the first: what it breaks of its limits, at least, is allowed to it from then on. *@p
 * found: there are moves that break least, at least of the first rank. */
static int relax_by_rank(struct apc_mpc *p, const struct apc_mpc_call *call, double room,
                         struct apc_mpc_result *result, bool *found)
{
    int rc = p->easy_stale ? mpc_make_easy(p, NULL) : 0;

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
        bound_controlled(p, call, c, true);
    for (unsigned rank = 1; rank <= p->ranks && rc == 0; rank++) {
        memset(p->easy, 0, (p->n + p->m) * sizeof(*p->easy));
        for (size_t c = 0; c < p->ny; c++) {
            if (p->rank[c] != rank)
                continue;
            bound_controlled(p, call, c, false);
            for (size_t i = 0; i < p->N && p->row_of_limit[c] != SIZE_MAX; i++)
                p->easy[p->n + p->row_of_limit[c] + i] = 1.0;
        }
        (void)apc_qp_soft(p->easy_qp, p->none, p->easy);
        rc = break_least(p, result);
        if (rc < 0)
            break;
        memcpy(p->broken, p->v, p->n * sizeof(*p->v));
        *found = true;
        for (size_t c = 0; c < p->ny; c++) {
            if (p->rank[c] == rank && p->row_of_limit[c] != SIZE_MAX)
                relax_limits(p, c, room);
        }
    }
    return rc;
}

/* Was there no time to go on, or no more of what stands for it? */
static bool is_cut(const struct apc_mpc *p, int rc)
{
    return (rc == APC_ETIMEDOUT && p->few) || (p->enough && p->enough(p->ctx));
}

/* Without limits that cannot be kept, or leave so little that rounding does not find it. What is left may be
 * a single point even then: there are still the moves that break least, and setpoints have to wait. */
static void solve_without(struct apc_mpc *p, const struct apc_mpc_call *call, struct apc_mpc_result *result)
{
    double room = LITTLE;
    bool found = false;

    do {
        result->rc = relax_by_rank(p, call, room, result, &found);
        if (result->rc == 0) {
            mpc_gradient(p, call);
            bound_zones(p, call, false);
            result->rc = solve_mpc_qp(p, p->qp, result);
        }
        room *= 10.0;
    } while (result->rc < 0 && room <= MUCH && !is_cut(p, result->rc));
    if (result->rc < 0 && is_cut(p, result->rc)) {
        result->rc = APC_ETIMEDOUT;
    } else if (result->rc < 0 && found) {
        memcpy(p->v, p->broken, p->n * sizeof(*p->v));
        result->rc = 0;
        result->waits = true;
    }
    if (result->rc == 0)
        result->given_up = broken_rank(p, call);
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
    if (!p->linearise && mpc_is_bound(p, call))
        mpc_set_references(p, call);
    else if (!p->linearise)
        result->rc = mpc_find_targets(p, call, &result->solves);
    if (result->rc < 0)
        return;
    result->reachable = p->reachable;
    mpc_gradient(p, call);
    for (size_t j = 0; j < p->nu; j++)
        bound_moves(p, call, j);
    bound_rates(p, call);
    bound_zones(p, call, false);
    for (size_t c = 0; c < p->ny; c++)
        bound_controlled(p, call, c, false);
    result->rc = solve_mpc_qp(p, p->qp, result);
    if (result->rc < 0 && !(result->rc == APC_ETIMEDOUT && is_cut(p, result->rc)))
        solve_without(p, call, result);
    for (size_t j = 0; j < p->nu && result->rc == 0; j++) {
        const double u0 = p->model->u0[j];

        for (size_t k = j; k < p->n; k += p->nu)
            plan[k] = u0 + lesser(greater(p->v[k], p->low[k]), p->high[k]);
    }
}
