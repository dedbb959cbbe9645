/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Former sessions: a claim belongs to a session, and the server may go on with a session long after our
 * end of it is closed (its disk hangs, or the network has gone without a word). The claim is then refused
 * to us, by ourselves. So the store remembers each session in which it asked for a claim, and at the next
 * connect, before it asks again, has the server end those that are left. While one does not end, the
 * answer is APC_ECONN, as for any other trouble with the connection; and once none is left, a claim that
 * is refused is somebody else's for certain. An append of ours that the old session had under way can then
 * not come after those of the new one either.
 *
 * A session is named by its process and when that began: unique over restarts and over several servers.
 * It leaves pg_stat_activity after it has released its locks (PostgreSQL's ShutdownPostgres() runs before
 * pgstat_beshutdown_hook()). A role may end its own sessions.
 */
#include "shareddata/postgresql/postgresql.h"

#define FORMER                                                                                               \
    " FROM pg_stat_activity a JOIN unnest($1::int4[], $2::timestamptz[]) AS f (pid, start)"                  \
    " ON a.pid = f.pid AND a.backend_start = f.start"

/* The server looks after 0 and 100 ms whether the session has ended. */
#define PATIENCE (200 * APC_NS_PER_MS)

void apc_pg_remember(struct apc_pg *pg)
{
    if (pg->session.claimant && pg->n_former < APC_PG_FORMER_MAX) {
        pg->former[pg->n_former++] = pg->session;
    }
    pg->session = (struct apc_pg_session){0};
}

struct names {
    char pids[APC_PG_ARRAY_SIZE(APC_PG_FORMER_MAX, 4)], starts[APC_PG_ARRAY_SIZE(APC_PG_FORMER_MAX, 8)];
};

static void add_former(const struct apc_pg *pg, struct apc_pg_params *p, struct names *names)
{
    struct apc_pg_array pids = {.data = names->pids, .capacity = sizeof names->pids},
                        starts = {.data = names->starts, .capacity = sizeof names->starts};
    apc_pg_array_begin(&pids, APC_PG_INT4, pg->n_former); /* they fit: nothing is allocated */
    apc_pg_array_begin(&starts, APC_PG_TIMESTAMPTZ, pg->n_former);
    for (size_t i = 0; i < pg->n_former; i++) {
        apc_pg_array_int4(&pids, pg->former[i].pid);
        apc_pg_array_int8(&starts, pg->former[i].start);
    }
    apc_pg_param(p, pids.data, pids.length);
    apc_pg_param(p, starts.data, starts.length);
}

static int take_left(void *ctx, int statement, PGresult *result)
{
    struct apc_pg *pg = (struct apc_pg *)ctx;
    (void)statement;
    if (PQnfields(result) != 2) {
        return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    pg->n_former = 0;
    for (int row = 0; row < PQntuples(result) && pg->n_former < APC_PG_FORMER_MAX; row++) {
        pg->former[pg->n_former++] = (struct apc_pg_session){.pid = (int32_t)apc_pg_cell(result, row, 0),
                                                             .start = apc_pg_cell(result, row, 1),
                                                             .claimant = true};
    }
    return 0;
}

int apc_pg_end_former(struct apc_pg *pg)
{
    if (pg->n_former == 0) {
        return 0;
    }
    struct names names;
    struct apc_pg_params p = {0};
    add_former(pg, &p, &names);
    apc_ns quarter = pg->base.config.timeout / 4;
    char wait[8];
    apc_pg_put_int8(wait, (quarter < PATIENCE ? quarter : PATIENCE) / APC_NS_PER_MS);
    struct apc_pg_params ending = p;
    apc_pg_param(&ending, wait, sizeof wait);
    int err = apc_pg_send(pg, "SELECT pg_terminate_backend(a.pid, $3::int8)" FORMER, &ending);
    if (!err) {
        err = apc_pg_finish(pg, NULL, NULL);
    }
    if (err && !pg->conn) {
        return err;
    }
    /* Where that is not permitted, the server's own time has to pass. */
    err = apc_pg_send(pg, "SELECT a.pid::int8, a.backend_start" FORMER, &p);
    if (!err) {
        err = apc_pg_finish(pg, take_left, pg);
    }
    if (!err && pg->n_former > 0) {
        err =
            apc_fail(&pg->base.why, APC_ECONN,
                     "our former session (server process %d) still holds its tables: waiting for the server "
                     "to end it",
                     (int)pg->former[0].pid);
    }
    return err;
}
