/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A controller's tick on PostgreSQL, n loops: read what the law needs, write what it made, durably.
 *
 *     floor       two bare SELECT 1: what two round trips cost
 *     by hand     two round trips written for these very tables with libpq: the reference for libapc,
 *                 on the paper's rows (mode, tuning, y, z; u) and on all rows that apc-controller touches
 *     libapc      the store on the paper's rows; and apc-controller's whole tick
 *     listing     one statement a value, as in the paper's listing 5
 *
 * Each way has a schema of its own, made anew for each n, with the same history in it.
 */
#include "bench.h"
#include "tick.h"

#define HISTORY 20000 /* rows in each of sensor, setpoint and actuator, whatever n is */

enum way { FLOOR, HAND, STORE, HAND_FULL, CONTROL, LISTING, WAYS };

static const char *const schemas[WAYS] = {[HAND] = "bench_hand",
                                          [STORE] = "bench_store",
                                          [HAND_FULL] = "bench_hand_full",
                                          [CONTROL] = "bench_control",
                                          [LISTING] = "bench_listing"};

static void prepare(PGconn *conn, const char *schema, size_t n)
{
    static const char *const tables[] = {"sensor", "setpoint", "actuator"};
    char sql[320];

    snprintf(sql, sizeof sql, "SET client_min_messages = warning; DROP SCHEMA IF EXISTS %s CASCADE", schema);
    PQclear(tick_execute(conn, sql));
    struct apc_store *store = tick_open_store(schema);
    store_prepare(store, n);
    apc_store_close(store);
    for (size_t i = 0; i < sizeof tables / sizeof tables[0]; i++) {
        snprintf(sql, sizeof sql,
                 "INSERT INTO %s.%s (id, seq, time, status, value)"
                 " SELECT id, seq, now(), 0, sin(id + seq)"
                 " FROM generate_series(1, %zu) AS seq, generate_series(1, %zu) AS id",
                 schema, tables[i], HISTORY / n, n);
        PQclear(tick_execute(conn, sql));
    }
}

static void prepare_all(PGconn *conn, size_t n)
{
    for (size_t i = 0; i < WAYS; i++)
        if (schemas[i])
            prepare(conn, schemas[i], n);
    PQclear(tick_execute(conn, "VACUUM ANALYZE"));
    PQclear(tick_execute(conn, "CHECKPOINT"));
}

void tick_run(struct bench *b, PGconn *conn, size_t n)
{
    struct hand *hand, *hand_full;
    struct store *store;
    struct control *control;
    struct listing *listing;
    char title[32];

    prepare_all(conn, n);
    hand = hand_open(schemas[HAND], n, TICK_PAPER);
    store = store_open(schemas[STORE], n);
    hand_full = hand_open(schemas[HAND_FULL], n, TICK_FULL);
    control = control_open(tick_open_store(schemas[CONTROL]), n);
    listing = listing_open(schemas[LISTING], n);

    struct bench_row rows[WAYS] = {
        [FLOOR] = {.name = "floor: two SELECT 1", .once = floor_once, .ctx = conn},
        [HAND] = {.name = "by hand: mode, tuning, y, z; u", .once = hand_once, .ctx = hand},
        [STORE] = {.name = "libapc store: the same rows", .once = store_once, .ctx = store},
        [HAND_FULL] = {.name = "by hand: all rows of a controller", .once = hand_once, .ctx = hand_full},
        [CONTROL] = {.name = "libapc: apc-controller's tick", .once = control_once, .ctx = control},
        [LISTING] = {.name = "listing: one statement a value", .once = listing_once, .ctx = listing},
    };
    for (size_t i = HAND; i < WAYS; i++) {
        rows[i].to[0] = &rows[FLOOR];
        rows[i].to[1] = i == STORE ? &rows[HAND] : i == CONTROL ? &rows[HAND_FULL] : NULL;
        rows[i].to[2] = i == LISTING ? NULL : &rows[LISTING];
    }
    snprintf(title, sizeof title, "n = %zu", n);
    bench_run(b, title, n, rows, WAYS);

    hand_close(hand);
    store_close(store);
    hand_close(hand_full);
    control_close(control);
    listing_close(listing);
}

/* The settings that decide what a commit costs. */
void tick_describe(PGconn *conn, char *text, size_t size)
{
    PGresult *result = tick_execute(
        conn, "SELECT concat('PostgreSQL ', current_setting('server_version'), ', fsync ',"
              " current_setting('fsync'), ', synchronous_commit ', current_setting('synchronous_commit'),"
              " ', wal_sync_method ', current_setting('wal_sync_method'), ', shared_buffers ',"
              " current_setting('shared_buffers'),"
              " CASE WHEN inet_server_addr() IS NULL THEN ', unix socket' ELSE ', TCP' END)");
    snprintf(text, size, "%s", PQgetvalue(result, 0, 0));
    PQclear(result);
}
