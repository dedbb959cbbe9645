/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Waiting for a change: LISTEN, then look, then wait for a notification, which a trigger sends with each
 * commit that wrote what people write. In that order nothing is missed: a commit after the LISTEN notifies,
 * one before it is seen by the look. The other tables are looked at again and again: a notifying commit takes
 * a lock of the whole server until it is durable, which a tick must not.
 *
 * The waiter has a connection of its own, made at the first wait: notifications would otherwise pile up on
 * the connection of a tick while nobody waits.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

#define PERIOD (50 * APC_NS_PER_MS)

void apc_pg_close_waiter(struct apc_pg *pg)
{
    if (pg->waiter) {
        pg->waiter->uri = NULL; /* it was lent */
        pg->base.ops->close(&pg->waiter->base);
        pg->waiter = NULL;
    }
}

static int open_waiter(struct apc_pg *pg)
{
    if (pg->waiter) {
        return 0;
    }
    struct apc_pg *waiter = (struct apc_pg *)calloc(1, sizeof *waiter);
    if (!waiter) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory");
    }
    waiter->base.ops = pg->base.ops;
    waiter->base.config = pg->base.config;
    memcpy(waiter->schema, pg->schema, sizeof waiter->schema);
    waiter->uri = pg->uri;
    waiter->random = pg->random + 1;
    pg->waiter = waiter;
    return 0;
}

static int take_channel(void *ctx, int statement, PGresult *result)
{
    (void)statement;
    *(int64_t *)ctx = PQntuples(result) == 1 && PQnfields(result) == 1 ? apc_pg_cell(result, 0, 0) : 0;
    return 0;
}

/* A channel is a table's; names of schemas could be too long for one. */
static int listen_to(struct apc_pg *w, enum apc_table table)
{
    struct apc_pg_params p = {0};
    int64_t oid = 0;
    apc_pg_param_text(&p, apc_table_name(table));
    int err = apc_pg_send(w, "SELECT to_regclass($1)::oid::int8", &p);
    if (!err) {
        err = apc_pg_finish(w, take_channel, &oid);
    }
    char sql[64];
    snprintf(sql, sizeof sql, "LISTEN apc_%" PRId64, oid);
    if (!err) {
        err = apc_pg_send(w, sql, &(struct apc_pg_params){0});
    }
    return err ? err : apc_pg_finish(w, NULL, NULL);
}

static int listen_to_all(struct apc_pg *w, const struct apc_sample *seen, size_t n)
{
    int err = apc_pg_begin(w);
    for (size_t i = 0; !err && i < n; i++) {
        uint32_t bit = UINT32_C(1) << seen[i].table;
        if (!(w->listening & bit)) {
            err = listen_to(w, seen[i].table);
            w->listening |= err ? 0 : bit;
        }
    }
    return err;
}

/* 1 when one is newer, 0, or an error. */
static int look_for_change(struct apc_pg *w, const struct apc_sample *seen, size_t n, struct apc_sample *now)
{
    memcpy(now, seen, n * sizeof *now);
    int err = apc_pg_read(&w->base, now, n);
    for (size_t i = 0; !err && i < n; i++) {
        if (now[i].seq > seen[i].seq) {
            return 1;
        }
    }
    return err;
}

static int wait_for_change_until(struct apc_pg *w, const struct apc_sample *seen, size_t n,
                                 struct apc_sample *now, apc_ns deadline)
{
    bool polled = false;
    for (size_t i = 0; i < n; i++) {
        polled = polled || !apc_table_shared(seen[i].table);
    }
    for (;;) {
        int result = listen_to_all(w, seen, n);
        result = result ? result : look_for_change(w, seen, n, now);
        if (result) {
            return result;
        }
        if (w->listening == 0) {
            continue; /* the look had to connect anew */
        }
        const apc_ns next = polled ? apc_clock_mono(NULL) + PERIOD : deadline;
        result = apc_pg_await_notify(w, next < deadline ? next : deadline);
        if (result < 0 || (result == 0 && next >= deadline)) {
            return result;
        }
    }
}

int apc_pg_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    struct apc_pg *pg = apc_pg_of(store);
    apc_ns now = apc_clock_mono(NULL), deadline = timeout > INT64_MAX - now ? INT64_MAX : now + timeout;
    int result = open_waiter(pg);
    if (result) {
        return result;
    }
    struct apc_sample *newest = (struct apc_sample *)malloc(n * sizeof *newest);
    if (!newest) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu variables", n);
    }
    result = wait_for_change_until(pg->waiter, seen, n, newest, deadline);
    free(newest);
    if (result < 0) {
        pg->base.why = pg->waiter->base.why;
    }
    return result;
}
