/* SPDX-License-Identifier: BSD-3-Clause */
/* The models there are: built in, one file each, or the user's own from a shared object. */
#include "base/base_internal.h"
#include "plant/plant_internal.h"

int apc_model_check(const struct apc_model *model, const char *from, struct apc_error *why)
{
    if (model->abi != APC_MODEL_ABI)
        return apc_fail(why, APC_EINVAL,
                        "%s: made for version %u of struct apc_model, this is %u; compile it anew", from,
                        model->abi, APC_MODEL_ABI);
    if (!model->name || !model->name[0])
        return apc_fail(why, APC_EINVAL, "%s: its apc_model has no name", from);
    if (!model->f || !model->g)
        return apc_fail(why, APC_EINVAL, "%s: model %s needs both functions, f and g", from, model->name);
    if (!model->nx || !model->nu || !model->ny)
        return apc_fail(why, APC_EINVAL,
                        "%s: model %s has %zu states, %zu inputs, %zu outputs; each must be at least 1", from,
                        model->name, model->nx, model->nu, model->ny);
    return apc_params_check(model->param, model->np, from, why);
}

static int check(const void *model, const char *from, struct apc_error *why)
{
    return apc_model_check(model, from, why);
}

int apc_model_find(const char *name, const struct apc_model **model, void **handle, struct apc_error *why)
{
    static const struct apc_built_in built_in[] = {{"first-order", &apc_model_first_order}};
    static const struct apc_plugin_kind kind = {.what = "model",
                                                .symbol = "apc_model",
                                                .built_in = built_in,
                                                .n_built_in = sizeof(built_in) / sizeof(built_in[0]),
                                                .check = check};
    const void *found;
    int rc;

    if (!model)
        return apc_fail(why, APC_EINVAL, "apc_model_find: model must not be NULL");
    rc = apc_plugin_find(&kind, name, &found, handle, why);
    *model = found;
    return rc;
}
