/* SPDX-License-Identifier: BSD-3-Clause */
/* In the place of sqlite.c and its parts, in a libapc without SQLite. */
#include "shareddata/shareddata_internal.h"

static int refuse_sqlite(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                         struct apc_error *why)
{
    (void)store, (void)config;
    return apc_fail(why, APC_ESTATE,
                    "store \"%s\": this libapc was built without SQLite (-DAPC_SQLITE=OFF), so there is no "
                    "sqlite:; install libsqlite3-dev and build it again, or use shm:NAME or postgresql:",
                    uri);
}

const struct apc_store_ops apc_sqlite_store = {.scheme = "sqlite:", .open = refuse_sqlite};
