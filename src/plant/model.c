/* SPDX-License-Identifier: BSD-3-Clause */
/* The models there are: built in, one file each, or the user's own from a shared object. */
#include "base/base_internal.h"
#include "plant/fmu.h"

static const struct apc_model *const models[] = {
    &apc_model_first_order,     &apc_model_servo,          &apc_model_double_tank,
    &apc_model_pendulum,        &apc_model_quadruple_tank, &apc_model_quadruple_tank_nonminimum,
    &apc_model_four_tank,       &apc_model_van_de_vusse,   &apc_model_adiabatic_cstr,
    &apc_model_temperature_lab, &apc_model_hundred,
};
#define N_MODELS (sizeof(models) / sizeof(models[0]))

const struct apc_model *apc_model_built_in(size_t i)
{
    return i < N_MODELS ? models[i] : NULL;
}

static int check_tables(const struct apc_model *model, const char *from, struct apc_error *why)
{
    int rc = apc_params_check(model->param, model->np, from, why);

    if (rc == 0 && model->state)
        rc = apc_params_check(model->state, model->nx, from, why);
    if (rc == 0 && apc_model_nz(model) && model->algebraic)
        rc = apc_params_check(model->algebraic, model->nz, from, why);
    if (rc == 0 && model->input)
        rc = apc_params_check(model->input, model->nu, from, why);
    if (rc == 0 && model->disturbance)
        rc = apc_params_check(model->disturbance, model->nd, from, why);
    for (size_t i = 0; rc == 0 && model->output && i < model->ny; i++) {
        if (!model->output[i].name)
            rc = apc_fail(why, APC_EINVAL, "%s: output %zu has no name", from, i + 1);
    }
    return rc;
}

int apc_model_check(const struct apc_model *model, const char *from, struct apc_error *why)
{
    if (model->abi < 2 || model->abi > APC_MODEL_ABI)
        return apc_fail(why, APC_EINVAL,
                        "%s: made for version %u of struct apc_model, this is %u: compile it again", from,
                        model->abi, APC_MODEL_ABI);
    if (!model->name || !model->name[0])
        return apc_fail(why, APC_EINVAL, "%s: its apc_model has no name", from);
    if (!model->f || !model->g)
        return apc_fail(why, APC_EINVAL, "%s: model %s needs both functions, f and g", from, model->name);
    if (!model->nx || !model->nu || !model->ny)
        return apc_fail(why, APC_EINVAL,
                        "%s: model %s has %zu states, %zu inputs, %zu outputs; each must be at least 1", from,
                        model->name, model->nx, model->nu, model->ny);
    if (apc_model_nz(model) && !model->residual)
        return apc_fail(
            why, APC_EINVAL,
            "%s: model %s has %zu algebraic variables, and no function residual of their equations", from,
            model->name, model->nz);
    return check_tables(model, from, why);
}

static int check_model_plugin(const void *model, const char *from, struct apc_error *why)
{
    return apc_model_check(model, from, why);
}

int apc_model_find(const char *name, const struct apc_model **model, void **handle, struct apc_error *why)
{
    struct apc_built_in built_in[N_MODELS];
    const struct apc_plugin_kind kind = {.what = "model",
                                         .symbol = "apc_model",
                                         .built_in = built_in,
                                         .n_built_in = N_MODELS,
                                         .check = check_model_plugin};
    const void *found;
    int rc;

    if (!model)
        return apc_fail(why, APC_EINVAL, "apc_model_find: model must not be NULL");
    if (name && handle && apc_fmu_is_one(name)) {
        *model = NULL;
        *handle = NULL;
        return apc_fmu_open(name, model, handle, why);
    }
    for (size_t i = 0; i < N_MODELS; i++)
        built_in[i] = (struct apc_built_in){models[i]->name, models[i]};
    rc = apc_plugin_find(&kind, name, &found, handle, why);
    *model = found;
    return rc;
}

void apc_param_initials(const struct apc_param *param, size_t n, double *value)
{
    for (size_t i = 0; i < n; i++)
        value[i] = param ? param[i].initial : 0.0;
}

int apc_model_take(const struct apc_model *model, double *value, const double *given,
                   const struct apc_param *table, size_t n, const char *what, struct apc_error *why)
{
    apc_param_initials(table, n, value);
    for (size_t i = 0; given && i < n; i++) {
        value[i] = given[i];
        if (!table && !apc_value_ok(value[i]))
            return apc_fail(why, APC_EINVAL, "%s: %s %zu is not a finite number", model->name, what, i + 1);
        if (table && !apc_param_accepts(&table[i], value[i]))
            return apc_fail(why, APC_EINVAL, "%s: %s %s is %.15g; it must lie in %.15g to %.15g", model->name,
                            what, table[i].name, value[i], table[i].low, table[i].high);
    }
    return 0;
}

int apc_model_derivative(const struct apc_model *model, double t, const double *x, const double *u,
                         const double *p, double *dx, struct apc_error *why)
{
    const size_t nx = model->nx, nz = apc_model_nz(model);

    if (model->f(t, x, u, p, dx))
        return apc_fail(why, APC_ESOLVER, "%s: the model is not defined there", model->name);
    if (nz && model->residual(t, x, u, p, dx + nx))
        return apc_fail(why, APC_ESOLVER, "%s: its algebraic equations are not defined there", model->name);
    for (size_t i = 0; i < nx + nz; i++) {
        if (!apc_value_ok(dx[i]))
            return apc_fail(why, APC_ESOLVER, "%s: %s %zu is not a finite number", model->name,
                            i < nx ? "the derivative of state" : "algebraic equation",
                            i < nx ? i + 1 : i - nx + 1);
    }
    return 0;
}
