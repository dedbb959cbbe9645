/* SPDX-License-Identifier: BSD-3-Clause */
/* A model with its parameters and its state; which integrator moves it is this file's choice alone. */
#include "base/base_internal.h"
#include "plant/plant_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct apc_plant {
    const struct apc_model *model;
    const struct apc_integrator *integrator;
    void *solver;
    double t;
    double *x; /* [nx] */
    double *p; /* [np] */
    struct apc_error error;
};

static int take_parameters(struct apc_plant *plant, const double *p, struct apc_error *why)
{
    const struct apc_model *model = plant->model;

    for (size_t i = 0; i < model->np; i++) {
        plant->p[i] = p ? p[i] : model->param[i].initial;
        if (!apc_param_accepts(&model->param[i], plant->p[i]))
            return apc_fail(why, APC_EINVAL, "%s: parameter %s is %g; it must lie in %g to %g", model->name,
                            model->param[i].name, plant->p[i], model->param[i].low, model->param[i].high);
    }
    return 0;
}

static int take_state(struct apc_plant *plant, const double *x0, struct apc_error *why)
{
    if (!x0)
        x0 = plant->model->x0;
    for (size_t i = 0; x0 && i < plant->model->nx; i++) {
        if (!apc_value_ok(x0[i]))
            return apc_fail(why, APC_EINVAL, "%s: initial state %zu is not a finite number",
                            plant->model->name, i + 1);
        plant->x[i] = x0[i];
    }
    return 0;
}

static int take_options(struct apc_integrator_options *ours, const struct apc_integrator_options *theirs,
                        struct apc_error *why)
{
    int rc = apc_options_copy(ours, sizeof(*ours), theirs, "apc_integrator_options", why);

    if (rc < 0)
        return rc;
    if (ours->rtol == 0.0)
        ours->rtol = 1e-8;
    if (ours->atol == 0.0)
        ours->atol = 1e-10;
    if (!(ours->rtol > 0.0 && ours->rtol < 1.0 && ours->atol > 0.0 && isfinite(ours->atol)))
        return apc_fail(why, APC_EINVAL,
                        "integrator: rtol is %g, must lie in 0 to 1; atol is %g, must be above 0", ours->rtol,
                        ours->atol);
    return 0;
}

int apc_plant_create(struct apc_plant **plant, const struct apc_model *model, const double *p,
                     const double *x0, const struct apc_integrator_options *options, struct apc_error *why)
{
    struct apc_integrator_options o = {0};
    struct apc_plant *new = NULL;
    int rc;

    if (!plant)
        return apc_fail(why, APC_EINVAL, "apc_plant_create: plant must not be NULL");
    *plant = NULL;
    if (!model)
        return apc_fail(why, APC_EINVAL, "apc_plant_create: model must not be NULL");
    rc = apc_model_check(model, "apc_plant_create", why);
    if (rc < 0)
        return rc;
    rc = take_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        goto no_memory;
    new->model = model;
    new->integrator = &apc_integrator_cvode;
    new->x = calloc(model->nx, sizeof(*new->x));
    new->p =
        calloc(model->np + 1, sizeof(*new->p)); /* + 1: a model without parameters gets a valid pointer too */
    if (!new->x || !new->p)
        goto no_memory;
    rc = take_parameters(new, p, why);
    if (rc == 0)
        rc = take_state(new, x0, why);
    if (rc == 0)
        rc = new->integrator->create(&new->solver, model, new->p, o.rtol, o.atol, why);
    if (rc < 0)
        goto out;
    *plant = new;
    return 0;

no_memory:
    rc = apc_fail(why, APC_ENOMEM, "no memory for plant %s", model->name);
out:
    apc_plant_destroy(new);
    return rc;
}

void apc_plant_destroy(struct apc_plant *plant)
{
    if (!plant)
        return;
    plant->integrator->destroy(plant->solver);
    free(plant->p);
    free(plant->x);
    free(plant);
}

int apc_plant_advance(struct apc_plant *plant, double dt, const double *u)
{
    int rc;

    if (!(dt >= 0.0) || !isfinite(dt))
        return apc_fail(&plant->error, APC_ESOLVER, "cannot advance by %g s", dt);
    for (size_t i = 0; i < plant->model->nu; i++) {
        if (!isfinite(u[i]))
            return apc_fail(&plant->error, APC_ESOLVER, "input %zu is not a finite number", i + 1);
    }
    if (dt == 0.0)
        return 0;
    rc = plant->integrator->step(plant->solver, plant->t, dt, u, plant->x, &plant->error);
    if (rc == 0)
        plant->t += dt;
    return rc;
}

void apc_plant_output(const struct apc_plant *plant, const double *u, double *y)
{
    plant->model->g(plant->t, plant->x, u, plant->p, y);
}

const double *apc_plant_state(const struct apc_plant *plant)
{
    return plant->x;
}

double apc_plant_time(const struct apc_plant *plant)
{
    return plant->t;
}

const char *apc_plant_error(const struct apc_plant *plant)
{
    return plant->error.text;
}
