/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store.
 *
 *     ingest    batches of 1000 samples, 100 variables with 10 each: apc_store_append(), and by hand one
 *               INSERT from arrays and one binary COPY into the same tables; for comparison a COPY into a
 *               plain table with the key alone, which has no newest values, no partitions and wakes nobody
 *     historian from shm: into the same tables by apc_replication_step(), beside the COPY
 *     newest    of 100 variables, in a short and in a long history over 53 weekly partitions:
 *               apc_store_read(), and by hand the search of the history that would do without tables of
 *               newest values
 *     tick      as bench/tick
 */
#include <stdlib.h>
#include <unistd.h>

#include "pgbinary.h"
#include "store.h"
#include "tick.h"

#define VARIABLES 100
#define EACH      10
#define BATCH     (VARIABLES * EACH)

static void execute(PGconn *conn, const char *sql)
{
    PQclear(tick_execute(conn, sql));
}

/* A plant's schema, empty. */
static void make_schema(PGconn *conn, const char *schema)
{
    char sql[160];

    snprintf(sql, sizeof sql, "SET client_min_messages = warning; DROP SCHEMA IF EXISTS %s CASCADE", schema);
    execute(conn, sql);
    struct apc_store *store = tick_open_store(schema);
    if (apc_store_init(store) < 0)
        die("%s", apc_store_error(store));
    apc_store_close(store);
}

/* ---- Ingest ---------------------------------------------------------------------------------- */

struct ingest {
    struct apc_store *store; /* or */
    PGconn *conn;
    int64_t seq, time; /* of the last sample of each variable; us since PostgreSQL's origin */
    struct apc_sample samples[BATCH];
    char columns[5][20 + 12 * BATCH];
    char rows[19 + BATCH * (2 + 5 * 4 + 36) + 2];
};

static struct ingest *ingest_open(const char *schema, bool by_hand)
{
    struct ingest *g = allocate(1, sizeof *g);

    g->time = apc_clock_utc(NULL) / APC_NS_PER_US - PG_EPOCH_US;
    if (by_hand)
        g->conn = tick_connect(schema);
    else
        g->store = tick_open_store(schema);
    return g;
}

static void ingest_close(struct ingest *g)
{
    apc_store_close(g->store);
    PQfinish(g->conn);
    free(g);
}

static void append_once(void *ctx)
{
    struct ingest *g = ctx;

    for (int i = 0; i < BATCH; i++)
        g->samples[i] = (struct apc_sample){.table = APC_SENSOR,
                                            .id = i % VARIABLES + 1,
                                            .seq = g->seq + 1 + i / VARIABLES,
                                            .time = (g->time + PG_EPOCH_US + i) * APC_NS_PER_US,
                                            .value = i};
    g->seq += EACH;
    g->time += BATCH;
    int n = apc_store_append(g->store, g->samples, BATCH);
    if (n != BATCH)
        die("%d of %d samples were new: %s", n, BATCH, apc_store_error(g->store));
}

static void unnest_once(void *ctx)
{
    static const uint32_t types[5] = {23, 20, 1184, 20, 701};
    struct ingest *g = ctx;
    char *at[5];
    const char *values[5];
    int lengths[5];
    static const int binary[5] = {1, 1, 1, 1, 1};

    for (int k = 0; k < 5; k++)
        at[k] = begin_array(g->columns[k], types[k], BATCH);
    for (int i = 0; i < BATCH; i++) {
        at[0] = add_int4(at[0], (uint32_t)(i % VARIABLES + 1));
        at[1] = add_int8(at[1], g->seq + 1 + i / VARIABLES);
        at[2] = add_int8(at[2], g->time + i);
        at[3] = add_int8(at[3], 0);
        at[4] = add_int8(at[4], bits(i));
    }
    g->seq += EACH;
    g->time += BATCH;
    for (int k = 0; k < 5; k++) {
        values[k] = g->columns[k];
        lengths[k] = (int)(at[k] - g->columns[k]);
    }
    PQclear(tick_expect(g->conn, PQexecPrepared(g->conn, "ingest", 5, values, lengths, binary, 1)));
}

static void copy_once(void *ctx)
{
    struct ingest *g = ctx;
    char *at = g->rows;

    memcpy(at, "PGCOPY\n\377\r\n\0\0\0\0\0\0\0\0\0", 19);
    at += 19;
    for (int i = 0; i < BATCH; i++) {
        memcpy(at, "\0\5", 2);
        at = add_int4(at + 2, (uint32_t)(i % VARIABLES + 1));
        at = add_int8(at, g->seq + 1 + i / VARIABLES);
        at = add_int8(at, g->time + i);
        at = add_int8(at, 0);
        at = add_int8(at, bits(i));
    }
    memcpy(at, "\377\377", 2);
    at += 2;
    g->seq += EACH;
    g->time += BATCH;
    PGresult *begun = PQexec(g->conn, "COPY sensor (id, seq, time, status, value) FROM STDIN BINARY");
    if (PQresultStatus(begun) != PGRES_COPY_IN || PQputCopyData(g->conn, g->rows, (int)(at - g->rows)) != 1 ||
        PQputCopyEnd(g->conn, NULL) != 1)
        die("%s", PQerrorMessage(g->conn));
    PQclear(begun);
    PQclear(tick_expect(g->conn, PQgetResult(g->conn)));
    PQclear(PQgetResult(g->conn));
}

static void ingest(struct bench *b, PGconn *conn)
{
    static const char *const schemas[] = {"bench_append", "bench_unnest", "bench_copy"};

    for (size_t i = 0; i < 3; i++)
        make_schema(conn, schemas[i]);
    execute(
        conn,
        "DROP SCHEMA IF EXISTS bench_plain CASCADE; CREATE SCHEMA bench_plain;"
        "CREATE TABLE bench_plain.sensor (id integer, seq bigint, time timestamptz NOT NULL, status bigint "
        "NOT NULL, value double precision NOT NULL, PRIMARY KEY (id, seq))");
    struct ingest *append = ingest_open("bench_append", false), *unnest = ingest_open("bench_unnest", true),
                  *copy = ingest_open("bench_copy", true), *plain = ingest_open("bench_plain", true);
    PQclear(
        tick_expect(unnest->conn,
                    PQprepare(unnest->conn, "ingest",
                              "INSERT INTO sensor (id, seq, time, status, value) SELECT * FROM"
                              " unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[])",
                              0, NULL)));
    struct bench_row rows[] = {
        {.name = "by hand: INSERT from arrays", .once = unnest_once, .ctx = unnest},
        {.name = "by hand: binary COPY", .once = copy_once, .ctx = copy},
        {.name = "libapc: apc_store_append()", .once = append_once, .ctx = append},
        {.name = "COPY into a plain table", .once = copy_once, .ctx = plain},
    };
    for (size_t i = 1; i < 4; i++)
        rows[i].to[0] = &rows[0];
    rows[2].to[1] = &rows[1];
    b->reference[0] = "INSERT";
    b->reference[1] = "COPY";
    b->reference[2] = NULL;
    b->calls = 50;
    b->budget = APC_NS_PER_S;
    bench_run(b, "ingest, 1000 samples", BATCH, rows, 4);
    ingest_close(append);
    ingest_close(unnest);
    ingest_close(copy);
    ingest_close(plain);
}

/* ---- Historian ------------------------------------------------------------------------------- */

struct historian {
    struct ingest *live;
    struct apc_store *history;
    struct apc_replication *forward;
};

static void forward_once(void *ctx)
{
    struct historian *h = ctx;

    append_once(h->live);
    const int n = apc_replication_step(h->forward, 60 * APC_NS_PER_S);
    if (n != BATCH)
        die("%d of %d samples were moved: %s", n, BATCH, apc_replication_error(h->forward));
}

/* What apc-historian does with a batch that the live store got, beside a COPY of it. */
static void historian(struct bench *b, PGconn *conn)
{
    struct historian h = {.live = allocate(1, sizeof *h.live)};
    struct apc_error why = {""};
    char uri[64], path[64];

    make_schema(conn, "bench_copy");
    make_schema(conn, "bench_forward");
    struct ingest *copy = ingest_open("bench_copy", true);
    snprintf(uri, sizeof uri, "shm:bench-historian-%d", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.bench-historian-%d", (int)getpid());
    h.live->time = copy->time;
    h.history = tick_open_store("bench_forward");
    if (apc_store_open(&h.live->store, uri, NULL, &why) < 0 || apc_store_init(h.live->store) < 0 ||
        apc_replication_create(&h.forward, h.live->store, h.history, &why) < 0)
        die("%s: %s", uri, why.text);
    struct bench_row rows[] = {
        {.name = "by hand: binary COPY", .once = copy_once, .ctx = copy},
        {.name = "libapc: append, apc_forward_step()",
         .once = forward_once,
         .ctx = &h,
         .to = {&rows[0]},
         .goal = "1.25"},
    };
    b->reference[0] = "COPY";
    b->reference[1] = NULL;
    bench_run(b, "historian, 1000 samples", BATCH, rows, 2);
    apc_replication_destroy(h.forward);
    apc_store_close(h.history);
    ingest_close(h.live);
    ingest_close(copy);
    unlink(path);
}

/* ---- Newest ---------------------------------------------------------------------------------- */

#define SHORT 10000
#define LONG  10000000
#define SLICE 500000
#define TIME  (180 * APC_NS_PER_S) /* for making the long history; what is there then has to do */

/*
 * A history of @p rows samples over the last 52 weeks, made by the server. The trigger rests meanwhile: it
 * would take the longest part of the time; the last samples go through it. Returns how many rows there are.
 */
static size_t fill(PGconn *admin, const char *schema, size_t rows)
{
    const apc_ns end = apc_clock_mono(NULL) + TIME;
    size_t done = 0;
    char sql[600];

    make_schema(admin, schema);
    PGconn *conn = tick_connect(schema);
    execute(conn, "SET synchronous_commit = off");
    execute(conn, "SELECT make_week('sensor', date_trunc('week', now() AT TIME ZONE 'UTC')::date - 7 * w,"
                  " current_date) FROM generate_series(1, 52) AS w");
    execute(conn, "ALTER TABLE sensor DISABLE TRIGGER appended");
    while (done < rows && apc_clock_mono(NULL) < end) {
        size_t slice = rows - done < SLICE ? rows - done : SLICE;
        snprintf(
            sql, sizeof sql,
            "INSERT INTO sensor SELECT id, seq, now() - interval '52 weeks' * (1 - seq / %zu::float8), 0, seq"
            " FROM generate_series(%zu, %zu) AS seq, generate_series(1, %d) AS id",
            rows / VARIABLES, done / VARIABLES + 1, (done + slice) / VARIABLES, VARIABLES);
        execute(conn, sql);
        done += slice;
    }
    execute(conn, "ALTER TABLE sensor ENABLE TRIGGER appended");
    snprintf(sql, sizeof sql,
             "INSERT INTO sensor SELECT id, %zu, now(), 0, 1 FROM generate_series(1, %d) AS id",
             rows / VARIABLES + 1, VARIABLES);
    execute(conn, sql);
    execute(conn, "VACUUM ANALYZE sensor");
    execute(conn, "VACUUM ANALYZE sensor_newest");
    PQfinish(conn);
    return done;
}

struct newest {
    struct apc_store *store; /* or */
    PGconn *conn;
    struct apc_sample samples[VARIABLES];
    char ids[20 + 8 * VARIABLES];
};

static struct newest *newest_open(const char *schema, bool by_hand)
{
    struct newest *w = allocate(1, sizeof *w);
    char *at = begin_array(w->ids, 23, VARIABLES);

    for (int i = 0; i < VARIABLES; i++) {
        w->samples[i] = (struct apc_sample){.table = APC_SENSOR, .id = i + 1};
        at = add_int4(at, (uint32_t)i + 1);
    }
    if (by_hand) {
        w->conn = tick_connect(schema);
        PQclear(tick_expect(
            w->conn,
            PQprepare(w->conn, "newest",
                      "SELECT n.* FROM unnest($1::int4[]) AS v (id) CROSS JOIN LATERAL"
                      " (SELECT seq, time, status, value FROM sensor WHERE id = v.id ORDER BY seq DESC"
                      " LIMIT 1) AS n",
                      0, NULL)));
    } else {
        w->store = tick_open_store(schema);
    }
    return w;
}

static void newest_close(struct newest *w)
{
    apc_store_close(w->store);
    PQfinish(w->conn);
    free(w);
}

static void read_once(void *ctx)
{
    struct newest *w = ctx;

    if (apc_store_read(w->store, w->samples, VARIABLES) < 0)
        die("%s", apc_store_error(w->store));
    if (w->samples[VARIABLES - 1].seq == 0)
        die("there is no newest sample");
}

static void search_once(void *ctx)
{
    struct newest *w = ctx;
    const char *const values[1] = {w->ids};
    const int lengths[1] = {sizeof w->ids}, binary[1] = {1};

    PGresult *result = tick_expect(w->conn, PQexecPrepared(w->conn, "newest", 1, values, lengths, binary, 1));
    if (PQntuples(result) != VARIABLES)
        die("%d newest samples instead of %d", PQntuples(result), VARIABLES);
    PQclear(result);
}

static void newest(struct bench *b, PGconn *conn)
{
    fill(conn, "bench_short", SHORT);
    size_t rows_of_long = fill(conn, "bench_long", LONG);
    execute(conn, "CHECKPOINT");
    struct newest *ways[4] = {newest_open("bench_short", false), newest_open("bench_long", false),
                              newest_open("bench_short", true), newest_open("bench_long", true)};
    struct bench_row rows[] = {
        {.name = "libapc: short history", .once = read_once, .ctx = ways[0]},
        {.name = "libapc: long history", .once = read_once, .ctx = ways[1]},
        {.name = "searched: short history", .once = search_once, .ctx = ways[2]},
        {.name = "searched: long history", .once = search_once, .ctx = ways[3]},
    };
    char title[64];

    rows[1].to[0] = &rows[0];
    rows[3].to[0] = &rows[2];
    rows[2].to[1] = &rows[0];
    rows[3].to[1] = &rows[1];
    b->reference[0] = "short";
    b->reference[1] = "libapc";
    b->reference[2] = NULL;
    b->calls = 50;
    b->budget = 400 * APC_NS_PER_MS;
    snprintf(title, sizeof title, "newest of 100: %d, %.0e rows", SHORT, (double)rows_of_long);
    bench_run(b, title, VARIABLES, rows, 4);
    for (size_t i = 0; i < 4; i++)
        newest_close(ways[i]);
    execute(conn, "DROP SCHEMA bench_long CASCADE");
}

/* ---- All ------------------------------------------------------------------------------------- */

void bench_postgresql(struct bench *b)
{
    static const size_t sizes[] = {1, 10, 100, 1000};
    PGconn *conn = tick_connect(NULL);

    ingest(b, conn);
    historian(b, conn);
    newest(b, conn);
    b->reference[0] = "floor";
    b->reference[1] = "by hand";
    b->reference[2] = "listing";
    b->calls = 50;
    b->budget = 400 * APC_NS_PER_MS;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        tick_run(b, conn, sizes[i]);
    PQfinish(conn);
}
