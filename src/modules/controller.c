/* SPDX-License-Identifier: BSD-3-Clause */
/* The controller's making. What it reads and writes is in controller_rows.c, what it does in
 * controller_tick.c. */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int take_options(struct apc_controller_options *o, const struct apc_controller_options *options,
                        struct apc_error *why)
{
    const struct apc_dim *d = &o->dim;
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_controller_options", why);

    if (rc < 0)
        return rc;
    if (!o->law)
        return apc_fail(why, APC_EINVAL, "controller: a law is required");
    if (!d->ny || d->ny > APC_VECTOR_MAX || d->nz > APC_VECTOR_MAX || !d->nu || d->nu > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL,
                        "controller: ny is %zu, nz %zu, nu %zu; none may exceed %d, ny and nu not be 0",
                        d->ny, d->nz, d->nu, APC_VECTOR_MAX);
    if (!apc_period_ok(o->period) || !apc_period_ok(o->horizon) || (o->hold && !apc_period_ok(o->hold)))
        return apc_fail(
            why, APC_EINVAL,
            "controller: period and horizon must be above 0, hold not below, none above 366 days");
    return 0;
}

static double *carve(double **at, size_t n)
{
    double *p = *at;

    *at += n;
    return p;
}

static int allocate(struct apc_controller *c)
{
    size_t ny = c->dim.ny, nz = c->dim.nz, nu = c->dim.nu;
    size_t n_published = apc_instances_size(c->instances).published;
    double *at =
        calloc(4 * ny + (c->n_ahead + 2) * nz + c->n_x + 7 * nu + 2 * c->n_tuning + n_published, sizeof(*at));

    c->memory = at;
    c->marks = calloc(ny + 2 * nz + 2 * nu + c->n_tuning, sizeof(*c->marks));
    c->fresh = calloc(ny, sizeof(*c->fresh));
    c->limited = calloc(2 * nu, sizeof(*c->limited));
    c->who = calloc(nu, sizeof(*c->who));
    c->y_status = calloc(ny, sizeof(*c->y_status));
    c->y_new = calloc(ny, sizeof(*c->y_new));
    if (!c->memory || !c->marks || !c->fresh || !c->limited || !c->who || !c->y_status || !c->y_new)
        return APC_ENOMEM;
    c->held = c->limited + nu;
    c->y = carve(&at, ny);
    c->z = carve(&at, c->n_ahead * nz);
    c->y_age = carve(&at, ny);
    c->y_low = carve(&at, ny);
    c->y_high = carve(&at, ny);
    c->x = carve(&at, c->n_x);
    c->u = carve(&at, nu);
    c->u_last = carve(&at, nu);
    c->rate = carve(&at, nu);
    c->trial = carve(&at, nu);
    c->low = carve(&at, nu);
    c->high = carve(&at, nu);
    c->fault = carve(&at, nu);
    c->z_low = carve(&at, nz);
    c->z_high = carve(&at, nz);
    c->tuning = carve(&at, c->n_tuning);
    c->offered = carve(&at, c->n_tuning);
    c->published = carve(&at, n_published);
    c->y_seq = c->marks;
    c->z_seq = c->y_seq + ny;
    c->u_seq = c->z_seq + nz;
    c->manual_seq = c->u_seq + nu;
    c->setpoint_seq = c->manual_seq + nu;
    c->tuning_seq = c->setpoint_seq + nz;
    return 0;
}

/* Make the law's instances, and learn how much they want. */
static int instantiate(struct apc_controller *c, const struct apc_controller_options *o,
                       struct apc_error *why)
{
    const struct apc_law_setup setup = {.size = sizeof(setup),
                                        .dim = c->dim,
                                        .Ts = c->Ts,
                                        .n_setting = o->n_setting,
                                        .setting = o->setting,
                                        .plant = o->plant};
    struct apc_instances_size size;
    int rc = apc_instances_create(&c->instances, o->law, &setup, why);

    if (rc < 0)
        return rc;
    size = apc_instances_size(c->instances);
    c->n_instances = size.instances;
    c->n_x = size.states;
    c->n_tuning = size.tuning;
    c->n_ahead = size.n_ahead;
    return 0;
}

/* What a call of the law works on; u is the caller's. */
static void prepare(struct apc_controller *c)
{
    for (size_t i = 0; i < c->dim.ny; i++) {
        c->y_low[i] = -HUGE_VAL;
        c->y_high[i] = HUGE_VAL;
    }
    for (size_t i = 0; i < c->dim.nu; i++) {
        c->rate[i] = HUGE_VAL;
        c->u_last[i] = (double)NAN;
    }
    c->call = (struct apc_law_call){.dim = c->dim,
                                    .Ts = c->Ts,
                                    .y = c->y,
                                    .z = c->z,
                                    .tuning = c->tuning,
                                    .x = c->x,
                                    .y_status = c->y_status,
                                    .y_age = c->y_age,
                                    .y_new = c->y_new,
                                    .n_ahead = c->n_ahead,
                                    .low = c->low,
                                    .high = c->high,
                                    .rate = c->rate,
                                    .y_low = c->y_low,
                                    .y_high = c->y_high,
                                    .u_last = c->u_last,
                                    .out = c->who,
                                    .published = c->published,
                                    .why = c->why,
                                    .budget = c->Ts};
}

/* The tuning that the controller begins with. */
static int take_tuning(struct apc_controller *c, const struct apc_controller_options *o,
                       struct apc_error *why)
{
    const struct apc_law *law = o->law;

    c->param = o->param ? o->param : law->tuning;
    for (size_t i = 0; i < c->n_tuning; i++) {
        const struct apc_law_parameter at = apc_instances_parameter(c->instances, i);
        const struct apc_param *narrow = &c->param[at.number], *own = &law->tuning[at.number];

        if (!(narrow->low >= own->low && narrow->low <= narrow->high && narrow->high <= own->high))
            return apc_fail(why, APC_EINVAL, "controller: limits of %s: %g to %g do not lie within %g to %g",
                            own->name, narrow->low, narrow->high, own->low, own->high);
        c->tuning[i] = o->tuning ? o->tuning[i] : narrow->initial;
        if (!apc_param_accepts(narrow, c->tuning[i]))
            return apc_fail(why, APC_EINVAL,
                            "controller: %s of output %zu begins with %g, not within %g to %g", own->name,
                            at.of + 1, c->tuning[i], narrow->low, narrow->high);
    }
    memcpy(c->offered, c->tuning, c->n_tuning * sizeof(*c->offered));
    c->offer_ok = true;
    return apc_instances_check(c->instances, c->tuning, why);
}

static int fill(struct apc_controller *c, const struct apc_controller_options *o, struct apc_error *why)
{
    const struct apc_law *law = o->law;
    int rc;

    c->law = law;
    c->dim = o->dim;
    c->Ts = apc_ns_to_s(o->period);
    rc = instantiate(c, o, why);
    if (rc < 0)
        return rc;
    c->horizon = o->horizon;
    c->loss = apc_loss_limit(o->period);
    c->hold = o->hold ? o->hold : 3 * o->period;
    c->target = APC_MODE_OOS;
    c->mode = APC_MODE_OOS;
    apc_controller_mark(c);
    if (allocate(c) < 0)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    prepare(c);
    for (size_t i = 0; i < c->dim.nu; i++)
        c->manual_seq[i] = -1; /* not looked at yet */
    rc = take_tuning(c, o, why);
    if (rc == 0)
        rc = apc_limits_copy(c->z_low, c->z_high, o->z_low, o->z_high, c->dim.nz, why);
    if (rc == 0)
        rc = apc_limits_copy(c->low, c->high, o->low, o->high, c->dim.nu, why);
    return rc < 0 ? rc : apc_fallback_copy(c->fault, o->fault, c->low, c->high, c->dim.nu, "fault", why);
}

int apc_controller_create(struct apc_controller **controller, const struct apc_controller_options *options,
                          struct apc_error *why)
{
    struct apc_controller_options o = {0};
    struct apc_controller *new = NULL;
    int rc;

    if (!controller)
        return apc_fail(why, APC_EINVAL, "apc_controller_create: controller must not be NULL");
    *controller = NULL;
    rc = take_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    rc = fill(new, &o, why);
    if (rc < 0) {
        apc_controller_destroy(new);
        return rc;
    }
    *controller = new;
    return 0;
}

void apc_controller_destroy(struct apc_controller *controller)
{
    if (!controller)
        return;
    apc_instances_destroy(controller->instances);
    free(controller->y_new);
    free(controller->y_status);
    free(controller->who);
    free(controller->limited);
    free(controller->fresh);
    free(controller->marks);
    free(controller->memory);
    free(controller);
}
