/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A setpoint on its way: u follows z, which is kept within z_min and z_max, by `rate` at most, up and down:
 *
 *     u_k = u_{k-1} + (z_k - u_{k-1}, within -+rate h)
 *
 * It begins at z, or, after track, at what it takes over. What it gives is meant to be another loop's
 * setpoint.
 */
#include "control/control_internal.h"

enum { RATE, Z_MIN, Z_MAX, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    [RATE] = {"rate", "1/s", "fastest change; 0: any", 0.0, 0.0, 1e9},
    [Z_MIN] = {"z_min", "", "least setpoint", -1e9, -1e9, 1e9},
    [Z_MAX] = {"z_max", "", "greatest setpoint", 1e9, -1e9, 1e9},
};

static int ramp_ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                      struct apc_error *why)
{
    (void)setup, (void)output, (void)why;
    p->ny = p->nd = 0; /* a lost measurement is none of its business */
    return 0;
}

static size_t ramp_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

static bool ramp_accepts(const struct apc_dim *dim)
{
    return dim->nz >= dim->nu;
}

static void ramp_reset(struct apc_law_call *c)
{
    unsigned limited = 0;

    c->x[0] = apc_law_cut(c->z[0], c->tuning[Z_MIN], c->tuning[Z_MAX], &limited);
}

static int ramp_compute(struct apc_law_call *c)
{
    const double *p = c->tuning, step = p[RATE] * c->Ts;
    double u = apc_law_cut(c->z[0], p[Z_MIN], p[Z_MAX], &c->limited[0]);

    c->u[0] = step > 0.0 ? apc_law_cut(u, c->x[0] - step, c->x[0] + step, &c->limited[0]) : u;
    return APC_LAW_GOOD;
}

static void ramp_keep(struct apc_law_call *c)
{
    c->x[0] = c->u[0];
}

static int ramp_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_ramp, setup, p, Z_MIN, Z_MAX, why);
}

const struct apc_law apc_law_ramp = {
    .abi = APC_LAW_ABI,
    .name = "ramp",
    .description = "a setpoint within limits and at a rate",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = ramp_n_state,
    .accepts = ramp_accepts,
    .reset = ramp_reset,
    .compute = ramp_compute,
    .update = ramp_keep,
    .track = ramp_keep,
    .ports = ramp_ports,
    .check = ramp_check_tuning,
};
