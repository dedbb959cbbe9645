/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One PostgreSQL connection that never makes its user wait beyond a deadline.
 *
 * libpq's own waits have no bound that holds: with packets dropped, statement_timeout, keepalives and
 * tcp_user_timeout all leave a caller hanging for half a minute or for ever. So libpq is used only
 * asynchronously, every wait is a poll() of ours, and when the deadline passes the connection is closed:
 * a late answer can then never be taken for that of a later question. PQfinish() does not block, because
 * the connection is in non-blocking mode, where libpq sends its goodbye only if the socket takes it.
 *
 * An operation is: queue statements, one Sync, wait for all answers. The server runs what lies between
 * two Syncs as one transaction and commits it at the Sync, so one operation is one transaction and one
 * round trip; it has failed if anything at all before the Sync's answer is an error, a failing commit
 * included.
 */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <time.h>

#include "shareddata/postgresql/postgresql.h"

/* ---- Waiting ------------------------------------------------------------------------------ */

/* Until the socket is ready, but not past the deadline: 1, 0 when the time is up, or APC_ESYS. */
static int poll_socket(struct apc_pg *pg, short events, apc_ns deadline)
{
    for (;;) {
        apc_ns left = deadline - apc_clock_mono(NULL);
        if (left <= 0) {
            return 0;
        }
        struct pollfd fd = {.fd = PQsocket(pg->conn), .events = events};
        struct timespec timeout = {.tv_sec = left / APC_NS_PER_S, .tv_nsec = left % APC_NS_PER_S};
        int ready = ppoll(&fd, 1, &timeout, NULL);
        if (ready > 0) {
            return 1;
        }
        if (ready < 0 && errno != EINTR) {
            return apc_fail(&pg->base.why, APC_ESYS, "cannot wait for the database: %s", strerror(errno));
        }
    }
}

int apc_pg_wait_socket(struct apc_pg *pg, short events)
{
    int ready = poll_socket(pg, events, pg->deadline);
    return ready > 0 ? 0 : ready < 0 ? ready : apc_pg_timed_out(pg);
}

/* One may have come already, along with the answer to an operation. */
int apc_pg_await_notify(struct apc_pg *pg, apc_ns deadline)
{
    for (;;) {
        bool any = false;
        for (PGnotify *n = PQnotifies(pg->conn); n; n = PQnotifies(pg->conn)) {
            PQfreemem(n);
            any = true;
        }
        if (any) {
            return 1;
        }
        int ready = poll_socket(pg, POLLIN, deadline);
        if (ready <= 0) {
            return ready;
        }
        if (!PQconsumeInput(pg->conn)) {
            return apc_pg_lost(pg);
        }
    }
}

/* Until PQgetResult() will not block. Reads while it writes, or both sides could wait for each other. */
static int await_result(struct apc_pg *pg)
{
    for (;;) {
        int unsent = PQflush(pg->conn);
        if (unsent < 0) {
            return apc_pg_lost(pg);
        }
        if (!PQisBusy(pg->conn)) {
            return 0;
        }
        int err = apc_pg_wait_socket(pg, (short)(POLLIN | (unsent ? POLLOUT : 0)));
        if (err) {
            apc_pg_drop(pg);
            return err;
        }
        if (!PQconsumeInput(pg->conn)) {
            return apc_pg_lost(pg);
        }
    }
}

/* ---- One operation ------------------------------------------------------------------------ */

void apc_pg_param(struct apc_pg_params *p, const char *binary, size_t length)
{
    p->values[p->n] = binary;
    p->lengths[p->n] = (int)length;
    p->formats[p->n++] = 1;
}

void apc_pg_param_text(struct apc_pg_params *p, const char *text)
{
    p->values[p->n] = text;
    p->formats[p->n++] = 0;
}

int apc_pg_not_queued(struct apc_pg *pg)
{
    int err = apc_pg_fail(pg, PQstatus(pg->conn) == CONNECTION_BAD ? APC_ECONN : APC_ENOMEM,
                          "cannot talk to the database", PQerrorMessage(pg->conn));
    apc_pg_drop(pg);
    return err;
}

int apc_pg_send(struct apc_pg *pg, const char *sql, const struct apc_pg_params *p)
{
    return PQsendQueryParams(pg->conn, sql, p->n, NULL, p->values, p->lengths, p->formats, 1)
               ? 0
               : apc_pg_not_queued(pg);
}

int apc_pg_send_prepared(struct apc_pg *pg, const char *name, const struct apc_pg_params *p)
{
    return PQsendQueryPrepared(pg->conn, name, p->n, p->values, p->lengths, p->formats, 1)
               ? 0
               : apc_pg_not_queued(pg);
}

/* Where the answers to an operation have got to. */
struct progress {
    int statement;
    bool between; /* statements: the last one's results are through */
    bool ended;   /* with the Sync's answer */
};

static int take_result(struct apc_pg *pg, PGresult *result, struct progress *at, apc_pg_result_fn fn,
                       void *ctx)
{
    switch (PQresultStatus(result)) {
    case PGRES_PIPELINE_SYNC:
        at->ended = true;
        return 0;
    case PGRES_COMMAND_OK:
    case PGRES_SINGLE_TUPLE:
    case PGRES_TUPLES_OK:
        return fn ? fn(ctx, at->statement, result) : 0;
    case PGRES_PIPELINE_ABORTED:
        return 0; /* the error came before */
    case PGRES_FATAL_ERROR:
        return apc_pg_refused(pg, result);
    default:
        return apc_fail(&pg->base.why, APC_EPROTO, "the database gave an answer of an unexpected kind");
    }
}

static int take_next(struct apc_pg *pg, struct progress *at, apc_pg_result_fn fn, void *ctx)
{
    int err = await_result(pg);
    if (err) {
        return err;
    }
    PGresult *result = PQgetResult(pg->conn);
    if (!result) {
        if (PQstatus(pg->conn) == CONNECTION_BAD || at->between) {
            return apc_pg_lost(pg);
        }
        at->between = true;
        at->statement++;
        return 0;
    }
    at->between = false;
    err = take_result(pg, result, at, fn, ctx);
    PQclear(result);
    return err;
}

int apc_pg_finish(struct apc_pg *pg, apc_pg_result_fn fn, void *ctx)
{
    return apc_pg_finish_by_rows(pg, -1, fn, ctx);
}

int apc_pg_finish_by_rows(struct apc_pg *pg, int by_rows, apc_pg_result_fn fn, void *ctx)
{
    if (!PQpipelineSync(pg->conn)) {
        return apc_pg_not_queued(pg);
    }
    pg->base.stats.round_trips++;
    pg->unreplicated = false;
    struct progress at = {0};
    struct apc_error first; /* what failed first says why; the rest is its consequence */
    int failed = 0;
    while (pg->conn && !at.ended) {
        if (at.between && at.statement == by_rows) {
            PQsetSingleRowMode(pg->conn); /* or they come all at once, which gives the same */
        }
        int err = take_next(pg, &at, failed ? NULL : fn, ctx);
        if (err && !failed) {
            failed = err;
            first = pg->base.why;
        }
    }
    if (failed) {
        pg->base.why = first;
        if (failed == APC_ECONN || failed == APC_EPROTO || failed == APC_ESCHEMA) {
            apc_pg_drop(pg);
        }
    }
    return failed;
}

void apc_pg_drop(struct apc_pg *pg)
{
    apc_pg_remember(pg);
    PQfinish(pg->conn);
    pg->conn = NULL;
    pg->listening = 0;
    pg->packed = false;
}

/* ---- Outside pipeline mode ---------------------------------------------------------------- */

int apc_pg_command(struct apc_pg *pg, const char *sql, PGresult **result)
{
    if (!PQsendQuery(pg->conn, sql)) {
        return apc_pg_not_queued(pg);
    }
    pg->base.stats.round_trips++;
    PGresult *last = NULL;
    int failed = 0;
    for (;;) {
        int err = await_result(pg);
        if (err) {
            PQclear(last);
            return err;
        }
        PGresult *r = PQgetResult(pg->conn);
        if (!r) {
            break;
        }
        PQclear(last);
        last = r;
        if (PQresultStatus(r) != PGRES_COMMAND_OK && PQresultStatus(r) != PGRES_TUPLES_OK && !failed) {
            failed = apc_pg_refused(pg, r);
        }
    }
    if (!failed && result) {
        *result = last;
        return 0;
    }
    PQclear(last);
    return failed;
}
