/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Cascade control, a pair of PID loops: the outer loop's output is the inner one's setpoint. The equations
 * are in pid_loop.h. Settings `outer`, `inner` and `setpoint` name the measurements and the setpoint of each
 * pair (from 1; by default 1.., after those nu + 1.., and 1..).
 *
 * Windup goes through both: while the inner output is cut, the outer integral leaves out what would drive it
 * further out. In mode Man, and after every other break, the outer loop begins where the inner measurement
 * is.
 */
#include "control/control_internal.h"
#include "control/pid_loop.h"

enum { OUTER, INNER };
enum { N_TUNING = 2 * PID_TUNING, N_STATES = 2 * PID_STATES };

static const struct apc_param tuning[N_TUNING] = {PID_PARAMS("outer_"), PID_PARAMS("inner_")};

static const char *const settings[] = {"outer", "inner", "setpoint", NULL};

static int cascade_ports(const struct apc_law_setup *s, size_t output, struct apc_law_ports *p,
                         struct apc_error *why)
{
    const struct apc_dim *d = &s->dim;
    const size_t most[] = {d->ny, d->ny, d->nz};
    size_t number[] = {output + 1, d->nu + output + 1, output + 1};

    if (d->ny < 2 || d->ny < d->nu || d->nz < 1)
        return apc_fail(
            why, APC_EINVAL,
            "law cascade: needs an outer and an inner measurement and a setpoint for each output; there "
            "are %zu measurements, %zu setpoints, %zu outputs",
            d->ny, d->nz, d->nu);
    for (size_t part = 0; part < sizeof(number) / sizeof(number[0]); part++) {
        int rc = apc_setting_index(s, settings[part], d->nu, output, 1, most[part], &number[part], why);

        if (rc < 0)
            return rc;
        if (number[part] > most[part])
            return apc_fail(why, APC_EINVAL,
                            "law cascade: \"%s\" of output %zu would be %zu, but there are %zu",
                            settings[part], output + 1, number[part], most[part]);
    }
    *p = (struct apc_law_ports){.ny = 2,
                                .nz = 1,
                                .y = {[OUTER] = (int)number[0] - 1, [INNER] = (int)number[1] - 1},
                                .z = {(int)number[2] - 1}};
    return 0;
}

static size_t cascade_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return N_STATES;
}

static struct pid_loop outer_loop(const struct apc_law_call *c)
{
    return (struct pid_loop){.p = c->tuning, .x = c->x, .h = c->Ts, .y = c->y[OUTER], .r = c->z[0]};
}

static struct pid_loop inner_loop(const struct apc_law_call *c, double r)
{
    return (struct pid_loop){
        .p = c->tuning + PID_TUNING, .x = c->x + PID_STATES, .h = c->Ts, .y = c->y[INNER], .r = r};
}

/* The inner setpoint. */
static double outer_output(const struct pid_loop *outer)
{
    unsigned limited = 0;

    return apc_pid_limit(outer, apc_pid_wanted(outer), &limited);
}

static void cascade_reset(struct apc_law_call *c)
{
    const struct pid_loop outer = outer_loop(c);
    struct pid_loop inner;

    apc_pid_reset(&outer);
    inner = inner_loop(c, outer_output(&outer));
    apc_pid_reset(&inner);
}

static int cascade_compute(struct apc_law_call *c)
{
    const struct pid_loop outer = outer_loop(c);
    const struct pid_loop inner = inner_loop(c, outer_output(&outer));

    c->u[0] = apc_pid_limit(&inner, apc_pid_wanted(&inner), &c->limited[0]);
    return APC_LAW_GOOD;
}

/* Which way the outer loop's output has no effect: while the inner one's is cut, or cannot be followed. */
static unsigned held_outside(const struct pid_loop *inner, double u, unsigned held)
{
    double beyond = apc_pid_wanted(inner) - u;

    if (beyond > 0.0)
        held |= APC_LIMITED_HIGH;
    if (beyond < 0.0)
        held |= APC_LIMITED_LOW;
    return inner->p[PID_KP] < 0.0 ? apc_law_mirrored(held) : inner->p[PID_KP] > 0.0 ? held : 0u;
}

static void cascade_update(struct apc_law_call *c)
{
    const struct pid_loop outer = outer_loop(c);
    const struct pid_loop inner = inner_loop(c, outer_output(&outer));

    apc_pid_update(&outer, inner.r, held_outside(&inner, c->u[0], c->limited[0]));
    apc_pid_update(&inner, c->u[0], c->limited[0]);
}

static void cascade_track(struct apc_law_call *c)
{
    const struct pid_loop outer = outer_loop(c);
    struct pid_loop inner = inner_loop(c, 0.0);

    apc_pid_track(&outer, inner.y, c->gap);
    inner.r = outer_output(&outer);
    apc_pid_track(&inner, c->u[0], c->gap);
}

static int cascade_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    int rc = apc_law_check_order(&apc_law_cascade, setup, p, PID_U_MIN, PID_U_MAX, why);

    if (rc < 0)
        return rc;
    return apc_law_check_order(&apc_law_cascade, setup, p, PID_TUNING + PID_U_MIN, PID_TUNING + PID_U_MAX,
                               why);
}

const struct apc_law apc_law_cascade = {
    .abi = APC_LAW_ABI,
    .name = "cascade",
    .description = "two PID loops, the outer one giving the inner one's setpoint",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = cascade_n_state,
    .reset = cascade_reset,
    .compute = cascade_compute,
    .update = cascade_update,
    .track = cascade_track,
    .settings = settings,
    .ports = cascade_ports,
    .check = cascade_check_tuning,
};
