/* SPDX-License-Identifier: BSD-3-Clause */
/* The laws there are: built in, one file each, or the user's own from a shared object. */
#include "base/base_internal.h"
#include "control/control_internal.h"

int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why)
{
    if (law->abi != APC_LAW_ABI)
        return apc_fail(why, APC_EINVAL,
                        "%s: made for version %u of struct apc_law, this is %u; compile it anew", from,
                        law->abi, APC_LAW_ABI);
    if (!law->name || !law->name[0])
        return apc_fail(why, APC_EINVAL, "%s: its apc_law has no name", from);
    if (!law->compute)
        return apc_fail(why, APC_EINVAL, "%s: law %s has no function compute", from, law->name);
    return apc_params_check(law->tuning, law->n_tuning, from, why);
}

static int check(const void *law, const char *from, struct apc_error *why)
{
    return apc_law_check(law, from, why);
}

int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why)
{
    static const struct apc_built_in built_in[] = {{"pi", &apc_law_pi}};
    static const struct apc_plugin_kind kind = {.what = "law",
                                                .symbol = "apc_law",
                                                .built_in = built_in,
                                                .n_built_in = sizeof(built_in) / sizeof(built_in[0]),
                                                .check = check};
    const void *found;
    int rc;

    if (!law)
        return apc_fail(why, APC_EINVAL, "apc_law_find: law must not be NULL");
    rc = apc_plugin_find(&kind, name, &found, handle, why);
    *law = found;
    return rc;
}
