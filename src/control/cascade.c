/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Cascade control, one pair of PID loops for each output: the outer loop's output is the inner one's
 * setpoint. The equations are in pid_loop.h. Settings `outer`, `inner` and `setpoint` name the measurements
 * and the setpoint of each pair (from 1; by default 1.., after those nu + 1.., and 1..).
 *
 * Windup goes through both: while the inner output is cut, the outer integral leaves out what would drive it
 * further out. In mode Man, and after every other break, the outer loop begins where the inner measurement
 * is.
 */
#include "control/control_internal.h"
#include "control/pid_loop.h"

enum { N_TUNING = 2 * PID_TUNING, N_STATES = 2 * PID_STATES };

static const struct apc_param tuning[N_TUNING] = {PID_PARAMS("outer_"), PID_PARAMS("inner_")};

enum { OUTER, INNER, SETPOINT, PARTS };
static const char *const settings[] = {"outer", "inner", "setpoint", NULL};

static struct pid_loop outer_loop(const struct apc_law_call *c, size_t i)
{
    const double *k = c->constant + i;

    return (struct pid_loop){.p = c->tuning + i * N_TUNING,
                             .x = c->x + i * N_STATES,
                             .h = c->Ts,
                             .y = c->y[(size_t)k[OUTER * c->dim.nu] - 1],
                             .r = c->z[(size_t)k[SETPOINT * c->dim.nu] - 1]};
}

static struct pid_loop inner_loop(const struct apc_law_call *c, size_t i, double r)
{
    return (struct pid_loop){.p = c->tuning + i * N_TUNING + PID_TUNING,
                             .x = c->x + i * N_STATES + PID_STATES,
                             .h = c->Ts,
                             .y = c->y[(size_t)c->constant[INNER * c->dim.nu + i] - 1],
                             .r = r};
}

/* The inner setpoint. */
static double outer_output(const struct pid_loop *outer)
{
    unsigned limited = 0;

    return apc_pid_limit(outer, apc_pid_wanted(outer), &limited);
}

static int configure(const struct apc_law_setup *s, struct apc_law_size *size, double *k,
                     struct apc_error *why)
{
    const struct apc_dim *d = &s->dim;
    int rc = 0;

    *size = (struct apc_law_size){.constants = PARTS * d->nu, .states = N_STATES * d->nu};
    if (d->ny < 2 || d->ny < d->nu || d->nz < 1)
        return apc_fail(
            why, APC_EINVAL,
            "law cascade: needs an outer and an inner measurement and a setpoint for each output; there "
            "are %zu measurements, %zu setpoints, %zu outputs",
            d->ny, d->nz, d->nu);
    if (!k)
        return 0;
    for (size_t i = 0; i < d->nu; i++) {
        k[OUTER * d->nu + i] = (double)i + 1.0;
        k[INNER * d->nu + i] = (double)(d->nu + i) + 1.0;
        k[SETPOINT * d->nu + i] = (double)i + 1.0;
    }
    for (size_t part = 0; part < PARTS && rc == 0; part++) {
        size_t most = part == SETPOINT ? d->nz : d->ny;
        double *of = k + part * d->nu;

        rc = apc_setting_indices(s, settings[part], d->nu, 1, most, of, why);
        for (size_t i = 0; i < d->nu && rc == 0; i++)
            if (of[i] > (double)most)
                rc = apc_fail(why, APC_EINVAL,
                              "law cascade: \"%s\" of output %zu would be %g, but there are %zu",
                              settings[part], i + 1, of[i], most);
    }
    return rc;
}

static int pairing(const struct apc_law_setup *s, struct apc_pair *pair, struct apc_error *why)
{
    return apc_law_pairing_of(&apc_law_cascade, s, OUTER, SETPOINT, pair, why);
}

static void reset(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop outer = outer_loop(c, i);
        struct pid_loop inner;

        apc_pid_reset(&outer);
        inner = inner_loop(c, i, outer_output(&outer));
        apc_pid_reset(&inner);
    }
}

static void compute(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop outer = outer_loop(c, i);
        const struct pid_loop inner = inner_loop(c, i, outer_output(&outer));

        c->u[i] = apc_pid_limit(&inner, apc_pid_wanted(&inner), &c->limited[i]);
    }
}

static void update(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop outer = outer_loop(c, i);
        const struct pid_loop inner = inner_loop(c, i, outer_output(&outer));
        double beyond = apc_pid_wanted(&inner) - c->u[i];

        apc_pid_update(&outer, inner.r, beyond * inner.p[PID_KP]);
        apc_pid_update(&inner, c->u[i], 0.0);
    }
}

static void track(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct pid_loop outer = outer_loop(c, i);
        struct pid_loop inner = inner_loop(c, i, 0.0);

        apc_pid_track(&outer, inner.y, c->gap);
        inner.r = outer_output(&outer);
        apc_pid_track(&inner, c->u[i], c->gap);
    }
}

static int check_tuning(const struct apc_dim *dim, const double *p, struct apc_error *why)
{
    int rc = apc_law_check_order(&apc_law_cascade, dim, p, PID_U_MIN, PID_U_MAX, why);

    if (rc < 0)
        return rc;
    return apc_law_check_order(&apc_law_cascade, dim, p, PID_TUNING + PID_U_MIN, PID_TUNING + PID_U_MAX, why);
}

const struct apc_law apc_law_cascade = {
    .abi = APC_LAW_ABI,
    .name = "cascade",
    .description = "two PID loops for each output, the outer one giving the inner one's setpoint",
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
