/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A measurement, filtered and looked at: where y lies within valid_low and valid_high, u is
 *
 *     u_k = u_{k-1} + H / (tau + H) (y_k - u_{k-1})
 *
 * H being the time since y was new before: a sample of a laboratory counts once, for as long as it took.
 * Between two of them u stays. A y outside its range is no measurement: u is held, and then Bad.
 */
#include "control/control_internal.h"

#include <stdio.h>

enum { TAU, VALID_LOW, VALID_HIGH, N_TUNING };
enum { LAST, SINCE, N_STATES }; /* u; s since y was new */

static const struct apc_param tuning[N_TUNING] = {
    [TAU] = {"tau", "s", "time constant of the filter; 0: none", 0.0, 0.0, 1e9},
    [VALID_LOW] = {"valid_low", "", "what lies below is no measurement", -1e9, -1e9, 1e9},
    [VALID_HIGH] = {"valid_high", "", "what lies above is no measurement", 1e9, -1e9, 1e9},
};

static int filter_ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                        struct apc_error *why)
{
    (void)setup, (void)output, (void)why;
    p->nz = p->nd = 0;
    return 0;
}

static bool filter_accepts(const struct apc_dim *dim)
{
    return dim->ny >= dim->nu;
}

static bool valid(const struct apc_law_call *c)
{
    return c->y[0] >= c->tuning[VALID_LOW] && c->y[0] <= c->tuning[VALID_HIGH];
}

static size_t filter_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return N_STATES;
}

static void filter_reset(struct apc_law_call *c)
{
    c->x[LAST] = c->y[0];
}

static int filter_compute(struct apc_law_call *c)
{
    const double since = c->x[SINCE] + c->Ts;

    if (!valid(c)) {
        (void)snprintf(c->why, APC_LAW_WHY, "has %g, not within %g to %g", c->y[0], c->tuning[VALID_LOW],
                       c->tuning[VALID_HIGH]);
        return APC_LAW_INFEASIBLE;
    }
    c->u[0] =
        c->y_new[0] ? c->x[LAST] + since / (c->tuning[TAU] + since) * (c->y[0] - c->x[LAST]) : c->x[LAST];
    return APC_LAW_GOOD;
}

static void filter_update(struct apc_law_call *c)
{
    c->x[LAST] = c->u[0];
    c->x[SINCE] = c->y_new[0] && valid(c) ? 0.0 : c->x[SINCE] + c->Ts;
}

static void filter_track(struct apc_law_call *c)
{
    c->x[LAST] = c->u[0];
}

static int filter_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_filter, setup, p, VALID_LOW, VALID_HIGH, why);
}

const struct apc_law apc_law_filter = {
    .abi = APC_LAW_ABI,
    .name = "filter",
    .description = "a measurement filtered, and refused outside its range",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = filter_n_state,
    .accepts = filter_accepts,
    .reset = filter_reset,
    .compute = filter_compute,
    .update = filter_update,
    .track = filter_track,
    .ports = filter_ports,
    .check = filter_check_tuning,
};
