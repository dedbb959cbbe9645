/* SPDX-License-Identifier: BSD-3-Clause */
/* In the place of postgresql.c and its parts, and of the paper's functions, in a libapc without PostgreSQL. */
#include "shareddata/shareddata_internal.h"

static int refuse_postgresql(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                             struct apc_error *why)
{
    (void)store, (void)uri, (void)config;
    return apc_fail(
        why, APC_ESTATE,
        "this libapc was built without PostgreSQL (-DAPC_POSTGRESQL=OFF), so there is no "
        "postgresql:; install libpq-dev and build it again, or use a store in a file, sqlite:FILE");
}

const struct apc_store_ops apc_postgresql_store = {.scheme = "postgresql:", .open = refuse_postgresql};
const struct apc_store_ops apc_postgres_store = {.scheme = "postgres:", .open = refuse_postgresql};
