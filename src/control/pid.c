/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * PID in standard form, one loop for each output; the equations are in pid_loop.h. Setting `measurement` says
 * which y each output controls and `setpoint` to which z (as written, from 1; by default 1, 2, ... and the
 * measurement's number), so that a plant with several inputs can be paired as its interaction asks for.
 * Setting `feed_forward` names the measured disturbance that Kff times its value is added for (0: none).
 */
#include "control/control_internal.h"
#include "control/pid_loop.h"

enum { KFF = PID_TUNING, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    PID_PARAMS(""),
    [KFF] = {"Kff", "", "feed-forward gain, from the measured disturbance", 0.0, -1e6, 1e6},
};

enum { MEASUREMENT, SETPOINT, FEED_FORWARD, PARTS };
static const char *const settings[] = {"measurement", "setpoint", "feed_forward", NULL};

/* The constants: PARTS vectors [nu] of numbers from 1. */
static struct pid_loop loop(const struct apc_law_call *c, size_t i)
{
    const double *k = c->constant + i, *p = c->tuning + i * N_TUNING;
    size_t nu = c->dim.nu, disturbance = (size_t)k[FEED_FORWARD * nu];

    return (struct pid_loop){.p = p,
                             .x = c->x + i * PID_STATES,
                             .h = c->Ts,
                             .y = c->y[(size_t)k[MEASUREMENT * nu] - 1],
                             .r = c->z[(size_t)k[SETPOINT * nu] - 1],
                             .feed_forward = disturbance ? p[KFF] * c->y[disturbance - 1] : 0.0};
}

static int configure(const struct apc_law_setup *s, struct apc_law_size *size, double *k,
                     struct apc_error *why)
{
    const struct apc_dim *d = &s->dim;
    int rc;

    *size = (struct apc_law_size){.constants = PARTS * d->nu, .states = PID_STATES * d->nu};
    if (!k)
        return 0;
    for (size_t i = 0; i < d->nu; i++)
        k[i] = (double)i + 1.0;
    rc = apc_setting_indices(s, settings[MEASUREMENT], d->nu, 1, d->ny, k, why);
    for (size_t i = 0; i < d->nu; i++)
        k[SETPOINT * d->nu + i] = k[i];
    if (rc == 0)
        rc = apc_setting_indices(s, settings[SETPOINT], d->nu, 1, d->nz, k + SETPOINT * d->nu, why);
    if (rc == 0)
        rc = apc_setting_indices(s, settings[FEED_FORWARD], d->nu, 0, d->ny, k + FEED_FORWARD * d->nu, why);
    for (size_t i = 0; i < d->nu && rc == 0; i++) {
        if (k[i] > (double)d->ny || k[SETPOINT * d->nu + i] > (double)d->nz)
            rc = apc_fail(
                why, APC_EINVAL,
                "law pid: output %zu would control measurement %g to setpoint %g, but there are %zu and "
                "%zu; settings \"measurement\" and \"setpoint\" pair them",
                i + 1, k[i], k[SETPOINT * d->nu + i], d->ny, d->nz);
    }
    return rc;
}

static int pairing(const struct apc_law_setup *s, struct apc_pair *pair, struct apc_error *why)
{
    return apc_law_pairing_of(&apc_law_pid, s, MEASUREMENT, SETPOINT, pair, why);
}

static void reset(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop l = loop(c, i);

        apc_pid_reset(&l);
    }
}

static void compute(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop l = loop(c, i);

        c->u[i] = apc_pid_limit(&l, apc_pid_wanted(&l), &c->limited[i]);
    }
}

static void update(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop l = loop(c, i);

        apc_pid_update(&l, c->u[i], 0.0);
    }
}

static void track(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop l = loop(c, i);

        apc_pid_track(&l, c->u[i], c->gap);
    }
}

static int check_tuning(const struct apc_dim *dim, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_pid, dim, p, PID_U_MIN, PID_U_MAX, why);
}

const struct apc_law apc_law_pid = {
    .abi = APC_LAW_ABI,
    .name = "pid",
    .description = "PID in standard form, one loop for each output, paired at will",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .reset = reset,
    .compute = compute,
    .update = update,
    .track = track,
    .settings = settings,
    .configure = configure,
    .pairing = pairing,
    .check = check_tuning,
};
