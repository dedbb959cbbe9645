/* SPDX-License-Identifier: BSD-3-Clause */
/* Where each sample is to be: steady states at the setpoints, or the nearest. */
#include "predict/mpc_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"

/* Where y of sample i is to be: at its setpoint or in its zone, within its limits. Returns false where the
 * setpoint itself lies outside. */
static bool set_reference(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i)
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

static bool is_same_as_before(const double *row, size_t i, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (row[i * n + k] != row[(i - 1) * n + k])
            return false;
    }
    return true;
}

/* Is each output somebody else's? */
bool mpc_is_bound(const struct apc_mpc *p, const struct apc_mpc_call *call)
{
    size_t given = 0;

    while (given < p->nu && call->given[given])
        given++;
    return given == p->nu;
}

/* Y of sample i at its setpoint, where no steady state says more. Returns as set_reference(). */
static bool reference_at_setpoint(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i)
{
    const bool inside = set_reference(p, call, i);

    for (size_t c = 0; c < p->ny; c++)
        p->target_y[(i - 1) * p->ny + c] =
            p->q[c] > 0.0 ? (p->aim_low[c] + p->aim_high[c]) / 2.0 : call->w[i * p->ny + c];
    return inside;
}

/* Nothing else is known of them, or can be changed. */
void mpc_set_references(struct apc_mpc *p, const struct apc_mpc_call *call)
{
    p->aims = false;
    p->reachable = true;
    for (size_t i = 1; i <= p->N; i++) {
        p->reachable = reference_at_setpoint(p, call, i) && p->reachable;
        memcpy(p->target_u + (i - 1) * p->nu, call->u_reference, p->nu * sizeof(*call->u_reference));
    }
}

/* Of sample i, as set_reference() says; a nonlinear model's from where target_x and u are. */
static int find_target(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i, double *u, double *y,
                       bool *reachable)
{
    const struct apc_target_call of = {.unknown = call->x + p->nc,
                                       .d = call->d ? call->d + i * p->nd : NULL,
                                       .reference = call->u_reference,
                                       .cost = call->u_cost,
                                       .low = p->low,
                                       .high = p->high,
                                       .y_low = p->aim_low,
                                       .y_high = p->aim_high,
                                       .q = p->q,
                                       .rank = p->rank,
                                       .ranks = p->ranks,
                                       .left = &p->steps_left,
                                       .enough = p->enough,
                                       .ctx = p->ctx};
    int rc;

    if (!p->linearise)
        return apc_target_find(p->target, &of, p->target_x, u, y, reachable);
    rc = apc_target_search(p->target, &of, p->linearise, p->target_x, u, y, reachable);
    for (size_t c = 0; c < p->ny && rc == 0 && *reachable; c++) {
        if (p->q[c] > 0.0 && p->aim_low[c] == p->aim_high[c])
            y[c] = p->aim_low[c];
    }
    return rc;
}

/* No step is left to the search: setpoints of samples from i on, without what comes after the horizon. */
static void leave_rest(struct apc_mpc *p, const struct apc_mpc_call *call, size_t i)
{
    p->aims = false;
    for (; i <= p->N; i++) {
        (void)reference_at_setpoint(p, call, i);
        memcpy(p->target_u + (i - 1) * p->nu, p->target_u + (i - 2) * p->nu, p->nu * sizeof(*p->target_u));
    }
}

int mpc_find_targets(struct apc_mpc *p, const struct apc_mpc_call *call, unsigned *solves)
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

        if (i > 1 && is_same_as_before(call->w, i, p->ny) &&
            (!call->d || is_same_as_before(call->d, i, p->nd))) {
            mpc_copy(ny, y - ny, y);
            mpc_copy(nu, u - nu, u);
            continue;
        }
        inside = set_reference(p, call, i);
        if (p->linearise && i > 1)
            memcpy(u, u - nu, nu * sizeof(*u));
        rc = find_target(p, call, i, u, y, &reachable);
        ++*solves;
        if (rc == APC_ETIMEDOUT && i > 1) {
            leave_rest(p, call, i);
            return 0;
        }
        if (rc < 0)
            return rc;
        p->reachable = p->reachable && inside && reachable;
        if (p->linearise && i == 1)
            memcpy(p->near, p->target_x, p->nc * sizeof(*p->near));
    }
    return 0;
}

void apc_mpc_targets(struct apc_mpc *p, const struct apc_mpc_call *call, double *x, double *u,
                     struct apc_mpc_result *result)
{
    unsigned solves = 0;
    int rc;

    memcpy(p->target_x, x, p->nc * sizeof(*x));
    memcpy(p->target_u, u, p->nu * sizeof(*u));
    p->steps_left = p->steps;
    rc = mpc_is_bound(p, call) ? APC_ESOLVER : mpc_find_targets(p, call, &solves);
    if (rc == 0 || rc == APC_ETIMEDOUT) {
        memcpy(x, rc == 0 ? p->near : p->target_x, p->nc * sizeof(*x));
        memcpy(u, p->target_u, p->nu * sizeof(*u));
    }
    if (rc == APC_ETIMEDOUT) {
        result->rc = rc;
        result->iterations += p->steps - p->steps_left;
    }
    if (rc < 0)
        mpc_set_references(p, call);
}
