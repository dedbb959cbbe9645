/* SPDX-License-Identifier: BSD-3-Clause */
#include "storeuri.h"

#include <string.h>

int store_open(struct apc_store **store, const char *uri, const struct apc_store_options *options,
               struct apc_error *why)
{
    if (strncmp(uri, "mem:", 4) == 0)
        return apc_fail(why, APC_EINVAL,
                        "\"%.40s\" is the memory of one process, which ends with it and which no other sees: "
                        "expected postgresql:, sqlite:FILE or shm:NAME",
                        uri);
    return apc_store_open(store, uri, options, why);
}
