/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * PID in standard form; the equations are in pid_loop.h. Setting `measurement` says which y each output
 * controls and `setpoint` to which z (as written, from 1; by default 1, 2, ... and the measurement's number),
 * so that a plant with several inputs can be paired as its interaction asks for. Setting `feed_forward` names
 * the measurement that Kff times its value is added for, or, numbered on after them, the disturbance (0:
 * none).
 */
#include "control/control_internal.h"
#include "control/pid_loop.h"

enum { KFF = PID_TUNING, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    PID_PARAMS(""),
    [KFF] = {"Kff", "", "feed-forward gain, from the measured disturbance", 0.0, -1e6, 1e6},
};

static const char *const settings[] = {"measurement", "setpoint", "feed_forward", NULL};

static int pid_ports(const struct apc_law_setup *s, size_t output, struct apc_law_ports *p,
                     struct apc_error *why)
{
    const struct apc_dim *d = &s->dim;
    size_t y = output + 1, z, from = 0;
    int rc = apc_setting_index(s, "measurement", d->nu, output, 1, d->ny, &y, why);

    z = y;
    if (rc == 0)
        rc = apc_setting_index(s, "setpoint", d->nu, output, 1, d->nz, &z, why);
    if (rc == 0)
        rc = apc_setting_index(s, "feed_forward", d->nu, output, 0, d->ny + d->nd, &from, why);
    if (rc < 0)
        return rc;
    if (y > d->ny || z > d->nz)
        return apc_fail(
            why, APC_EINVAL,
            "law pid: output %zu would control measurement %zu to setpoint %zu, but there are %zu and "
            "%zu; settings \"measurement\" and \"setpoint\" pair them",
            output + 1, y, z, d->ny, d->nz);
    *p = (struct apc_law_ports){.ny = 1, .nz = 1, .y = {(int)y - 1}, .z = {(int)z - 1}};
    if (from > d->ny)
        p->d[p->nd++] = (int)(from - d->ny) - 1;
    else if (from > 0)
        p->y[p->ny++] = (int)from - 1;
    return 0;
}

static struct pid_loop loop(const struct apc_law_call *c)
{
    const double *from = c->dim.nd > 0 ? c->d : c->dim.ny > 1 ? c->y + 1 : NULL;

    return (struct pid_loop){.p = c->tuning,
                             .x = c->x,
                             .h = c->Ts,
                             .y = c->y[0],
                             .r = c->z[0],
                             .feed_forward = from ? c->tuning[KFF] * *from : 0.0};
}

static size_t pid_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return PID_STATES;
}

static void pid_reset(struct apc_law_call *c)
{
    const struct pid_loop l = loop(c);

    apc_pid_reset(&l);
}

static int pid_compute(struct apc_law_call *c)
{
    const struct pid_loop l = loop(c);

    c->u[0] = apc_pid_limit(&l, apc_pid_wanted(&l), &c->limited[0]);
    return APC_LAW_GOOD;
}

static void pid_update(struct apc_law_call *c)
{
    const struct pid_loop l = loop(c);

    apc_pid_update(&l, c->u[0], c->limited[0]);
}

static void pid_track(struct apc_law_call *c)
{
    const struct pid_loop l = loop(c);

    apc_pid_track(&l, c->u[0], c->gap);
}

size_t apc_pid_terms(const struct apc_law_call *c, struct apc_law_term *term, size_t most)
{
    const struct pid_loop l = loop(c);

    return apc_pid_loop_terms(&l, term, most);
}

static int pid_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_pid, setup, p, PID_U_MIN, PID_U_MAX, why);
}

const struct apc_law apc_law_pid = {
    .abi = APC_LAW_ABI,
    .name = "pid",
    .description = "PID in standard form, paired at will",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = pid_n_state,
    .reset = pid_reset,
    .compute = pid_compute,
    .update = pid_update,
    .track = pid_track,
    .settings = settings,
    .ports = pid_ports,
    .check = pid_check_tuning,
};
