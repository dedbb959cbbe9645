/* SPDX-License-Identifier: BSD-3-Clause */
/* The controller's making. What it reads and writes is in controller_rows.c, what it does in
 * controller_tick.c. */
#include "base/base_internal.h"
#include "control/control_internal.h"
#include "modules/modules_internal.h"

#include <stdlib.h>
#include <string.h>

#define LAW_SIZE_MAX 1000000 /* a law that wants more than this has counted wrong */

static int take_options(struct apc_controller_options *o, const struct apc_controller_options *options,
                        struct apc_error *why)
{
    const struct apc_dim *d = &o->dim;
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_controller_options", why);

    if (rc < 0)
        return rc;
    if (!o->law)
        return apc_fail(why, APC_EINVAL, "controller: a law is required");
    rc = apc_law_check(o->law, "controller", why);
    if (rc < 0)
        return rc;
    if (!d->ny || d->ny > APC_VECTOR_MAX || d->nz > APC_VECTOR_MAX || !d->nu || d->nu > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL,
                        "controller: ny is %zu, nz %zu, nu %zu; none may exceed %d, ny and nu not be 0",
                        d->ny, d->nz, d->nu, APC_VECTOR_MAX);
    if (o->law->accepts && !o->law->accepts(d))
        return apc_fail(why, APC_EINVAL,
                        "controller: law %s does not work with %zu measurements, %zu setpoints, %zu outputs",
                        o->law->name, d->ny, d->nz, d->nu);
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
    double *at = calloc(ny + 3 * nz + c->n_x + 5 * nu + 2 * c->n_tuning, sizeof(*at));

    c->memory = at;
    c->marks = calloc(ny + 2 * nz + 2 * nu + c->n_tuning, sizeof(*c->marks));
    c->fresh = calloc(ny, sizeof(*c->fresh));
    c->limited = calloc(nu, sizeof(*c->limited));
    if (!c->memory || !c->marks || !c->fresh || !c->limited)
        return APC_ENOMEM;
    c->y = carve(&at, ny);
    c->z = carve(&at, nz);
    c->x = carve(&at, c->n_x);
    c->u = carve(&at, nu);
    c->trial = carve(&at, nu);
    c->low = carve(&at, nu);
    c->high = carve(&at, nu);
    c->fault = carve(&at, nu);
    c->z_low = carve(&at, nz);
    c->z_high = carve(&at, nz);
    c->tuning = carve(&at, c->n_tuning);
    c->offered = carve(&at, c->n_tuning);
    c->y_seq = c->marks;
    c->z_seq = c->y_seq + ny;
    c->u_seq = c->z_seq + nz;
    c->manual_seq = c->u_seq + nu;
    c->setpoint_seq = c->manual_seq + nu;
    c->tuning_seq = c->setpoint_seq + nz;
    return 0;
}

/* Let the law make its constants and say how many states it has. */
static int configure(struct apc_controller *c, const struct apc_controller_options *o, struct apc_error *why)
{
    const struct apc_law *law = o->law;
    const struct apc_law_setup setup = {
        .dim = c->dim, .Ts = c->Ts, .n_setting = o->n_setting, .setting = o->setting, .plant = o->plant};
    struct apc_law_size size = {.states = law->n_state ? law->n_state(&c->dim) : 0};
    int rc = apc_law_check_settings(law, &setup, why);

    if (rc == 0 && law->configure)
        rc = law->configure(&setup, &size, NULL, why);
    if (rc < 0)
        return rc;
    if (size.states > LAW_SIZE_MAX || size.constants > LAW_SIZE_MAX || law->n_tuning > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL,
                        "controller: law %s wants %zu states, %zu constants and %zu tuning parameters an "
                        "output; too many",
                        law->name, size.states, size.constants, law->n_tuning);
    c->n_x = size.states;
    c->n_constant = size.constants;
    c->constant = calloc(c->n_constant + 1, sizeof(*c->constant));
    c->pair = calloc(c->dim.nu, sizeof(*c->pair));
    if (!c->constant || !c->pair)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    rc = apc_law_pairing(law, &setup, c->pair, why);
    if (rc == 0 && law->configure)
        rc = law->configure(&setup, &size, c->constant, why);
    if (rc == 0 && !apc_values_ok(c->constant, c->n_constant))
        rc = apc_fail(why, APC_EINVAL, "controller: law %s made a constant that is no finite number",
                      law->name);
    return rc;
}

/* The tuning that the controller begins with. */
static int take_tuning(struct apc_controller *c, const struct apc_controller_options *o,
                       struct apc_error *why)
{
    const struct apc_law *law = o->law;

    c->param = o->param ? o->param : law->tuning;
    for (size_t i = 0; i < c->n_tuning; i++) {
        const struct apc_param *narrow = &c->param[i % law->n_tuning], *own = &law->tuning[i % law->n_tuning];

        if (!(narrow->low >= own->low && narrow->low <= narrow->high && narrow->high <= own->high))
            return apc_fail(why, APC_EINVAL, "controller: limits of %s: %g to %g do not lie within %g to %g",
                            own->name, narrow->low, narrow->high, own->low, own->high);
        c->tuning[i] = o->tuning ? o->tuning[i] : narrow->initial;
        if (!apc_param_accepts(narrow, c->tuning[i]))
            return apc_fail(why, APC_EINVAL,
                            "controller: %s of output %zu begins with %g, not within %g to %g", own->name,
                            i / law->n_tuning + 1, c->tuning[i], narrow->low, narrow->high);
    }
    memcpy(c->offered, c->tuning, c->n_tuning * sizeof(*c->offered));
    c->offer_ok = true;
    return apc_law_check_tuning(law, &c->dim, c->tuning, why);
}

static int fill(struct apc_controller *c, const struct apc_controller_options *o, struct apc_error *why)
{
    const struct apc_law *law = o->law;
    int rc;

    c->law = law;
    c->dim = o->dim;
    c->Ts = apc_ns_to_s(o->period);
    rc = configure(c, o, why);
    if (rc < 0)
        return rc;
    c->n_tuning = c->dim.nu * law->n_tuning;
    c->horizon = o->horizon;
    c->loss = apc_loss_limit(o->period);
    c->hold = o->hold ? o->hold : 3 * o->period;
    c->target = APC_MODE_OOS;
    c->mode = APC_MODE_OOS;
    apc_controller_mark(c);
    if (allocate(c) < 0)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
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
    free(controller->pair);
    free(controller->constant);
    free(controller->limited);
    free(controller->fresh);
    free(controller->marks);
    free(controller->memory);
    free(controller);
}
