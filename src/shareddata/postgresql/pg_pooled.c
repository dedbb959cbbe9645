/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A pooler between a store and its server. What a store needs lasts as long as a session: its search_path,
 * which is the plant, the prepared statements, the claims. A pooler in transaction mode hands the session to
 * others between two transactions, so a tick of one plant could be written to another: it is refused. In
 * session mode all is as without it.
 *
 * Only a pooler answers with a process number that is not the server's. Then a second connection asks which
 * process it got: where that is ours, which stands idle at that moment, sessions are shared. Where they are
 * many and others are quicker, the set-up sees it, which asks again who answers.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

int apc_pg_fail_pooled(struct apc_pg *pg)
{
    return apc_fail(
        &pg->base.why, APC_ECONN,
        "a pooler between here and the database hands each transaction another session of the server "
        "(pgbouncer: pool_mode = transaction), but a store needs one of its own: connect to the "
        "server itself, or by pool_mode = session");
}

/* The process that answers a second connection; 0: there is none to be had, which says nothing. */
static int32_t process_of_another(const struct apc_pg *pg)
{
    struct apc_pg *other = (struct apc_pg *)calloc(1, sizeof *other);
    PGresult *result = NULL;
    int32_t pid = 0;
    if (!other) {
        return 0;
    }
    other->base.ops = pg->base.ops;
    other->base.config = pg->base.config;
    other->base.config.timeout /= 4; /* in session mode it may have to wait for one that ends */
    other->uri = pg->uri;
    memcpy(other->hosts, pg->hosts, sizeof other->hosts);
    if (apc_pg_connect_bare(other) == 0 &&
        apc_pg_command(other, "SELECT pg_catalog.pg_backend_pid()", &result) == 0) {
        pid = (int32_t)strtol(PQgetvalue(result, 0, 0), NULL, 10);
    }
    PQclear(result);
    apc_pg_drop(other);
    free(other);
    return pid;
}

int apc_pg_look_for_pooler(struct apc_pg *pg)
{
    const bool direct = PQbackendPID(pg->conn) == pg->session.pid;
    return !direct && process_of_another(pg) == pg->session.pid ? apc_pg_fail_pooled(pg) : 0;
}
