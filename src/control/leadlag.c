/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Lead and lag, for feed-forward: u = bias + K w, w = (T_lead s + 1) / (T_lag s + 1) d, by backward
 * differences:
 *
 *     w_k = (T_lag w_{k-1} + T_lead (d_k - d_{k-1}) + h d_k) / (T_lag + h)
 *
 * d is the disturbance of the output's number, where there is one, else the measurement of its number. pid
 * adds what this gives by its setting feed_forward, with Kff = 1.
 */
#include "control/control_internal.h"

enum { K, T_LEAD, T_LAG, BIAS, N_TUNING };
enum { LAST_W, LAST_D, N_STATES };

static const struct apc_param tuning[N_TUNING] = {
    [K] = {"K", "", "gain at rest", 1.0, -1e6, 1e6},
    [T_LEAD] = {"T_lead", "s", "lead time", 0.0, 0.0, 1e9},
    [T_LAG] = {"T_lag", "s", "lag time", 0.0, 0.0, 1e9},
    [BIAS] = {"bias", "", "output where d is 0", 0.0, -1e9, 1e9},
};

static int leadlag_ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                         struct apc_error *why)
{
    if (output >= setup->dim.nd && output >= setup->dim.ny)
        return apc_fail(why, APC_EINVAL,
                        "law leadlag: output %zu has neither disturbance nor measurement %zu", output + 1,
                        output + 1);
    p->nz = 0;
    p->ny = p->nd ? 0 : 1;
    return 0;
}

static double input(const struct apc_law_call *c)
{
    return c->dim.nd > 0 ? c->d[0] : c->y[0];
}

/* w, but for its former value. */
static double leadlag_change(const struct apc_law_call *c)
{
    return c->tuning[T_LEAD] * (input(c) - c->x[LAST_D]) + c->Ts * input(c);
}

static double filtered(const struct apc_law_call *c)
{
    return (c->tuning[T_LAG] * c->x[LAST_W] + leadlag_change(c)) / (c->tuning[T_LAG] + c->Ts);
}

static size_t leadlag_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return N_STATES;
}

/* As if d had long been what it is. */
static void leadlag_reset(struct apc_law_call *c)
{
    c->x[LAST_W] = c->x[LAST_D] = input(c);
}

static int leadlag_compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[BIAS] + c->tuning[K] * filtered(c);
    return APC_LAW_GOOD;
}

static void leadlag_update(struct apc_law_call *c)
{
    c->x[LAST_W] = filtered(c);
    c->x[LAST_D] = input(c);
}

/* The difference dies out with T_lag; without it, or with K = 0, there is nothing that could hold it. */
static void leadlag_track(struct apc_law_call *c)
{
    const double gain = c->tuning[K], lag = c->tuning[T_LAG];

    if (c->gap)
        leadlag_reset(c);
    if ((gain < 0.0 || gain > 0.0) && lag > 0.0)
        c->x[LAST_W] = ((c->u[0] - c->tuning[BIAS]) / gain * (lag + c->Ts) - leadlag_change(c)) / lag;
}

const struct apc_law apc_law_leadlag = {
    .abi = APC_LAW_ABI,
    .name = "leadlag",
    .description = "lead and lag of a measured disturbance, for feed-forward",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = leadlag_n_state,
    .reset = leadlag_reset,
    .compute = leadlag_compute,
    .update = leadlag_update,
    .track = leadlag_track,
    .ports = leadlag_ports,
};
