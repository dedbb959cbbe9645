/* SPDX-License-Identifier: BSD-3-Clause */
/* The ways in which bench_tick does a controller's tick. Each works in a schema of its own. */
#ifndef APC_BENCH_TICK_H
#define APC_BENCH_TICK_H

#include <libpq-fe.h>

#include <apcmodules.h>
#include <apcshareddata.h>

/* The law of the ways that have no controller core: the paper's PI for n loops, which share a tuning: Kp,
 * tau_i. */
#define TUNING 2
#define TS     2.0

struct bench;

/* What a tick touches. */
enum tick_rows {
    TICK_PAPER = 1, /* reads mode, tuning, n sensors, n setpoints; writes n actuators */
    TICK_FULL /* what apc-controller touches: a mode and a tuning for each loop, also manual outputs and the
                 outputs as they stand; writes a tick row as well */
};

/* ---- tick_run.c: all ways, in turn ----------------------------------------------------------- */

/* Measure them for @p n loops on the database of @p conn, in schemas that are made anew. The bench has three
 * references: the floor, by hand, the listing. */
void tick_run(struct bench *b, PGconn *conn, size_t n);
/* One line about the server: version and the settings that decide what a commit costs. */
void tick_describe(PGconn *conn, char *text, size_t size);

/* ---- tick_libpq.c: plain libpq --------------------------------------------------------------- */

/* A connection whose search_path is @p schema (NULL: as it comes). */
PGconn *tick_connect(const char *schema);
/* Run SQL. Returns the result, to be cleared; dies unless it went well. */
PGresult *tick_execute(PGconn *conn, const char *sql);
/* Dies unless it went well. Returns @p result. */
PGresult *tick_expect(PGconn *conn, PGresult *result);

/* Two SELECT 1, one after the other: what two round trips cost, whatever they do. */
void floor_once(void *conn);

/* As the paper's listing 5 does it: one statement a value. */
struct listing;
struct listing *listing_open(const char *schema, size_t n);
void listing_once(void *listing);
void listing_close(struct listing *listing);

/* ---- tick_hand.c: the reference --------------------------------------------------------------- */

struct hand;
struct hand *hand_open(const char *schema, size_t n, enum tick_rows rows);
void hand_once(void *hand);
void hand_close(struct hand *hand);

/* ---- tick_apc.c: with libapc ----------------------------------------------------------------- */

/* A store on that schema, with more patience than any row needs. */
struct apc_store *tick_open_store(const char *schema);
/* Make the store's tables, with one row of everything that a controller reads but sensors and setpoints. */
void store_prepare(struct apc_store *store, size_t n);

/* The store alone, on the paper's rows. */
struct store;
struct store *store_open(const char *schema, size_t n);
void store_once(void *store);
void store_close(struct store *store);

/* What apc-controller does at a tick, with n PI loops, on a store that is closed with it; and how many
 * numbers stand in its tick row. */
struct control {
    struct apc_store *store;
    struct apc_controller *core;
    uint64_t tick;
};
size_t control_row(size_t n);
struct control *control_open(struct apc_store *store, size_t n);
void control_once(void *control);
void control_close(struct control *control);

#endif
