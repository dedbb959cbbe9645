/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"

#include <math.h>

bool apc_param_accepts(const struct apc_param *param, double value)
{
    return value >= param->low && value <= param->high && apc_value_ok(value);
}

int apc_params_check(const struct apc_param *param, size_t n, const char *owner, struct apc_error *why)
{
    if (n && !param)
        return apc_fail(why, APC_EINVAL, "%s: announces %zu parameters but has no table of them", owner, n);
    for (size_t i = 0; i < n; i++) {
        if (!param[i].name)
            return apc_fail(why, APC_EINVAL, "%s: parameter %zu has no name", owner, i + 1);
        if (!apc_param_accepts(&param[i], param[i].initial))
            return apc_fail(why, APC_EINVAL,
                            "%s: parameter %s starts at %.15g, outside its own range %.15g to %.15g", owner,
                            param[i].name, param[i].initial, param[i].low, param[i].high);
    }
    return 0;
}
