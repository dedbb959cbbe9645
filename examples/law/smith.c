/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A Smith predictor, for a plant that answers late: cc -shared -fPIC -o smith.so smith.c -lm. PI control of
 * what a model of the plant, gain / (tau s + 1), says that y would be without its dead time:
 *
 *     e_k = z_k - (y_k + m_k - m_{k-n}),  u_k = Kp e_k + I_k,  m_{k+1} = a m_k + gain (1 - a) u_k
 *
 * n being the dead time in periods. settings = { model = [10.0, 10.0, 8.0]; } are gain, tau and dead time in
 * s.
 */
#include <apccontrol.h>
#include <math.h>

static const struct apc_param tuning[] = {{"Kp", "", "proportional gain", 0.2, -1e6, 1e6},
                                          {"tau_i", "s", "integral time", 10.0, 1e-3, 1e9}};
static const char *const settings[] = {"model", NULL};

enum { KP, TAU_I };
enum { POLE, GAIN, PERIODS, CONSTANTS };
enum { INTEGRAL, NOW, PAST }; /* the model's output now, and those of the last n ticks, the oldest first */

#define PERIODS_MAX 10000.0

static int configure(const struct apc_law_setup *setup, struct apc_law_size *size, double *constant,
                     struct apc_error *why)
{
    const struct apc_setting *model = apc_setting_find(setup, "model");
    double n;

    if (setup->dim.ny != 1 || setup->dim.nz != 1 || setup->dim.nu != 1)
        return apc_fail(why, APC_EINVAL, "law smith: one measurement, one setpoint, one output");
    if (!model || model->n != 3 || !(model->value[1] > 0.0) || !(model->value[2] >= 0.0))
        return apc_fail(why, APC_EINVAL, "law smith: needs settings = { model = [gain, tau, dead time]; }");
    n = round(model->value[2] / setup->Ts);
    if (n > PERIODS_MAX)
        return apc_fail(why, APC_EINVAL, "law smith: a dead time of %g periods; %g at most", n, PERIODS_MAX);
    size->constants = CONSTANTS;
    size->states = PAST + (size_t)n;
    if (constant) {
        constant[POLE] = exp(-setup->Ts / model->value[1]);
        constant[GAIN] = model->value[0] * (1.0 - constant[POLE]);
        constant[PERIODS] = n;
    }
    return 0;
}

/* As if the plant had long been at rest where it is. */
static void reset(struct apc_law_call *c)
{
    for (size_t i = NOW; i < PAST + (size_t)c->constant[PERIODS]; i++)
        c->x[i] = c->y[0];
}

static double error(const struct apc_law_call *c)
{
    double then = c->constant[PERIODS] > 0.0 ? c->x[PAST] : c->x[NOW];

    return c->z[0] - (c->y[0] + c->x[NOW] - then);
}

static void compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[KP] * error(c) + c->x[INTEGRAL];
}

static void track(struct apc_law_call *c)
{
    if (c->gap) /* what the plant did meanwhile is not known */
        reset(c);
    c->x[INTEGRAL] = c->u[0] - c->tuning[KP] * error(c);
}

static void update(struct apc_law_call *c)
{
    size_t last = NOW + (size_t)c->constant[PERIODS];
    double e = error(c);

    c->x[INTEGRAL] = c->u[0] - c->tuning[KP] * e + c->tuning[KP] * c->Ts / c->tuning[TAU_I] * e;
    for (size_t i = PAST; i < last; i++)
        c->x[i] = c->x[i + 1];
    if (last > NOW)
        c->x[last] = c->x[NOW];
    c->x[NOW] = c->constant[POLE] * c->x[NOW] + c->constant[GAIN] * c->u[0];
}

const struct apc_law apc_law = {
    .abi = APC_LAW_ABI,
    .name = "smith",
    .description = "PI control with a Smith predictor",
    .n_tuning = 2,
    .tuning = tuning,
    .reset = reset,
    .compute = compute,
    .update = update,
    .track = track,
    .settings = settings,
    .configure = configure,
};
