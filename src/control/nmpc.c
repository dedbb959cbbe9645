/* SPDX-License-Identifier: BSD-3-Clause */
/* What nonlinear predictive control does at a tick: real-time iterations of Gauss and Newton, by multiple
 * shooting, and outputs that act late. */
#include <math.h>
#include <string.h>

#include "base/base_internal.h"
#include "control/mpc.h"

enum { BEGIN = 5 };
#define BEND  1e-3 /* of an output's deviation: steps to see how what is paid bends */
#define STILL 1e-7 /* of a move, over its output's deviation: more steps of Newton's are not worth it */

/* ---- Outputs that act late --------------------------------------------------------------------------- */

void apc_nmpc_take_past(struct apc_law_mpc *p)
{
    for (size_t j = 0; j < p->dim.nu; j++)
        p->input[j] = p->past[p->whole[j] * p->dim.nu + j];
}

void apc_nmpc_predict(struct apc_law_mpc *p, double *x, const double *u)
{
    const size_t nu = p->dim.nu;

    for (size_t part = 0; part < p->parts; part++) {
        for (size_t j = 0; j < nu; j++) {
            const size_t ago = p->whole[j] + (p->bit[j] > p->begins[part]);

            p->input[j] = ago ? p->past[(ago - 1) * nu + j] : u[j];
        }
        (void)apc_estimator_predict(part + 1 < p->parts ? p->part[part] : p->estimator, x, p->input);
    }
    memcpy(apc_mpc_past_of(p, x), p->past, p->late_most * nu * sizeof(*x));
}

/* ---- The problem -------------------------------------------------------------------------------------- */

/* Moves and nodes that nmpc starts from: those of the last solution, as many samples later as it is old;
 * without one, everything as it is. */
static void shift_trajectory(struct apc_law_mpc *p)
{
    const size_t nu = p->dim.nu, nx = p->model->nx_plant, age = (size_t)*apc_mpc_age_of(p, p->x);
    const double *nodes = apc_mpc_nodes_of(p, p->x);

    if (age)
        apc_mpc_shift_plan(p, age);
    for (size_t b = 0; b < p->blocks && !age; b++)
        memcpy(p->shifted + b * nu, p->u_last, nu * sizeof(*p->shifted));
    for (size_t i = 0; i < p->N; i++)
        memcpy(p->nodes + i * nx, age ? nodes + (i + age < p->N ? i + age : p->N - 1) * nx : p->start,
               nx * sizeof(*p->nodes));
}

/* How what is paid bends about moves as they stand; NULL: nothing is paid, or no run leads from them. *@p rc:
 * APC_ETIMEDOUT. */
static const double *bend_of_prices(struct apc_law_mpc *p, const double *d, int *rc)
{
    const size_t ny = p->dim.ny;
    bool paid = false;

    for (size_t k = 0; k < p->N * ny; k++) {
        p->worth[k] = p->price[k % ny] * p->w[k + ny];
        paid = paid || p->worth[k] != 0.0;
    }
    for (size_t j = 0; j < p->dim.nu; j++)
        p->bend[j] = BEND * p->dev_u[j];
    if (paid)
        *rc = apc_shooting_bend(p->shoot, p->start, d, p->shifted, p->past, p->worth, p->bend, p->curve,
                                apc_mpc_late, p);
    paid = paid && *rc == 0;
    *rc = *rc == APC_ESOLVER ? 0 : *rc;
    return paid ? p->curve : NULL;
}

static int linearise_here(struct apc_law_mpc *p, const double *d)
{
    int rc = apc_shooting_linearise(p->shoot, p->start, d, p->shifted, p->past, p->nodes, p->G, p->free_y);
    const double *curve = rc == 0 ? bend_of_prices(p, d, &rc) : NULL;

    if (rc < 0)
        return rc;
    apc_shooting_end(p->shoot, p->nodes, p->past, p->Gx, p->free_x);
    return apc_mpc_follow(p->mpc, p->G, p->free_y, p->Gx, p->free_x, curve, p->shifted);
}

/* The problem about moves and nodes as they stand. Where the model is not defined there, or so steep that
 * there is no problem, about the present. */
static int linearize_trajectory(struct apc_law_mpc *p, const double *d)
{
    int rc = linearise_here(p, d);

    if (rc < 0 && rc != APC_ETIMEDOUT) {
        *apc_mpc_age_of(p, p->x) = 0.0;
        shift_trajectory(p);
        rc = linearise_here(p, d);
    }
    return rc;
}

/* Has the last step changed next to nothing? */
static bool stands_still(const struct apc_law_mpc *p)
{
    double most = 0.0;

    for (size_t k = 0; k < p->dim.nu * p->blocks; k++)
        most = fmax(most, fabs(p->plan[k] - p->shifted[k]) / p->dev_u[k % p->dim.nu]);
    return most < STILL;
}

static void keep_nodes(struct apc_law_mpc *p)
{
    if (p->result.rc == 0)
        memcpy(apc_mpc_nodes_of(p, p->x), p->nodes, p->N * p->model->nx_plant * sizeof(*p->nodes));
}

/* One step: a plan about moves and nodes as they stand, as long as there is time. */
static void sqp_step(struct apc_law_mpc *p, const struct apc_mpc_call *call, const double *d)
{
    p->result.rc = apc_mpc_late(p) ? APC_ETIMEDOUT : linearize_trajectory(p, d);
    if (p->result.rc == 0)
        apc_mpc_solve(p->mpc, call, p->plan, &p->result);
}

/* The present, when the plan begins to act, but for whole periods. Steady states are sought from the last one
 * on, unless there is none, or one where no model holds, from which a search need not find back. */
static int begin_nmpc(struct apc_law_mpc *p, const double *d)
{
    const size_t nx = p->model->nx_plant, nu = p->dim.nu;
    int rc = 0;

    memcpy(p->start, p->x, nx * sizeof(*p->start));
    apc_shooting_measure(p->shoot, p->input + nu);
    if (p->late > 0.0) {
        apc_nmpc_take_past(p);
        rc = apc_shooting_advance(p->shoot, p->start, p->input, d, p->late);
    }
    shift_trajectory(p);
    if (!(*apc_mpc_age_of(p, p->x) > 0.0) ||
        !apc_shooting_holds(p->shoot, apc_mpc_steady_state_of(p, p->x))) {
        memcpy(apc_mpc_steady_state_of(p, p->x), p->start, nx * sizeof(*p->start));
        memcpy(apc_mpc_steady_state_of(p, p->x) + p->nc, p->u_last, nu * sizeof(*p->u_last));
    }
    return rc;
}

/* BEGIN steps at least where there is nothing to go on from. */
void apc_nmpc_solve(struct apc_law_mpc *p, const struct apc_mpc_call *call)
{
    const double *d = p->x + p->model->nx_plant;
    const size_t least = *apc_mpc_age_of(p, p->x) > 0.0 ? 1 : BEGIN,
                 steps = p->newton > least ? p->newton : least;
    bool done = false;

    p->result = (struct apc_mpc_result){.rc = begin_nmpc(p, d)};
    if (p->result.rc == 0)
        apc_mpc_targets(p->mpc, call, apc_mpc_steady_state_of(p, p->x),
                        apc_mpc_steady_state_of(p, p->x) + p->nc, &p->result);
    for (size_t k = 0; k < steps && !done && p->result.rc == 0; k++) {
        const struct apc_mpc_result before = p->result;

        sqp_step(p, call, d);
        if (p->result.rc < 0 && (k >= least || (k > 0 && !apc_mpc_late(p)))) {
            p->result = before; /* that step has an answer of its own */
            break;
        }
        p->result.iterations += before.iterations;
        if (p->result.rc == 0) {
            done = k + 1 >= least && stands_still(p);
            apc_shooting_move(p->shoot, p->plan, p->nodes);
            memcpy(p->shifted, p->plan, p->dim.nu * p->blocks * sizeof(*p->plan));
        }
    }
    keep_nodes(p);
}
