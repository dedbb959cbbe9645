/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A Smith predictor, for a plant that answers late: cc -shared -fPIC -o smith.so smith.c -lm. PI control of
 * what a model of the plant, gain / (tau s + 1), says that y would be without its dead time:
 *
 *     e_k = z_k - (y_k + m_k - m_{k-n}),  u_k = Kp e_k + I_k,  m_{k+1} = a m_k + gain (1 - a) u_k
 *
 * n being the dead time in periods. settings = { model = [10.0, 10.0, 8.0]; } are gain, tau and dead time in
 * s; with more than one output a row of them for each.
 */
#include <apccontrol.h>
#include <math.h>
#include <stdlib.h>

static const struct apc_param tuning[] = {{"Kp", "", "proportional gain", 0.2, -1e6, 1e6},
                                          {"tau_i", "s", "integral time", 10.0, 1e-3, 1e9}};
static const char *const settings[] = {"model", NULL};

enum { KP, TAU_I };
enum { INTEGRAL, NOW, PAST }; /* the model's output now, and those of the last n ticks, the oldest first */

#define PERIODS_MAX 10000.0

struct smith {
    double pole, gain;
    size_t periods;
};

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    const struct apc_setting *model = apc_setting_find(setup, "model");
    const double *own;
    struct smith *s;

    if (setup->dim.ny != 1 || setup->dim.nz != 1)
        return apc_fail(why, APC_EINVAL, "law smith: needs a measurement and a setpoint for each output");
    if (!model || model->text || model->columns != 3 || model->rows <= setup->output)
        return apc_fail(
            why, APC_EINVAL,
            "law smith: needs settings = { model = [gain, tau, dead time]; }, a row for each output");
    own = model->value + 3 * setup->output;
    if (!(own[1] > 0.0) || !(own[2] >= 0.0) || own[2] / setup->Ts > PERIODS_MAX)
        return apc_fail(why, APC_EINVAL,
                        "law smith: tau is %g s and the dead time %g s; above 0, and from 0 to %g periods",
                        own[1], own[2], PERIODS_MAX);
    s = (struct smith *)malloc(sizeof(*s));
    if (!s)
        return apc_fail(why, APC_ENOMEM, "law smith: no memory");
    s->pole = exp(-setup->Ts / own[1]);
    s->gain = own[0] * (1.0 - s->pole);
    s->periods = (size_t)round(own[2] / setup->Ts);
    needs->states = PAST + s->periods;
    *self = s;
    return 0;
}

static const struct smith *instance(const struct apc_law_call *c)
{
    return (const struct smith *)c->self;
}

/* As if the plant had long been at rest where it is. */
static void reset(struct apc_law_call *c)
{
    for (size_t i = NOW; i < PAST + instance(c)->periods; i++)
        c->x[i] = c->y[0];
}

static double error(const struct apc_law_call *c)
{
    double then = instance(c)->periods > 0 ? c->x[PAST] : c->x[NOW];

    return c->z[0] - (c->y[0] + c->x[NOW] - then);
}

static int compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[KP] * error(c) + c->x[INTEGRAL];
    return APC_LAW_GOOD;
}

static void track(struct apc_law_call *c)
{
    if (c->gap) /* what the plant did meanwhile is not known */
        reset(c);
    c->x[INTEGRAL] = c->u[0] - c->tuning[KP] * error(c);
}

static void update(struct apc_law_call *c)
{
    const struct smith *s = instance(c);
    size_t last = NOW + s->periods;
    double e = error(c);

    c->x[INTEGRAL] = c->u[0] - c->tuning[KP] * e + c->tuning[KP] * c->Ts / c->tuning[TAU_I] * e;
    for (size_t i = PAST; i < last; i++)
        c->x[i] = c->x[i + 1];
    if (last > NOW)
        c->x[last] = c->x[NOW];
    c->x[NOW] = s->pole * c->x[NOW] + s->gain * c->u[0];
}

APC_LAW_EXPORT(.name = "smith", .description = "PI control with a Smith predictor", .n_tuning = 2,
               .tuning = tuning, .reset = reset, .compute = compute, .update = update, .track = track,
               .settings = settings, .create = create, .destroy = free);
