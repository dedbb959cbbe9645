/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store, in files beside this program: on the disk that the build folder is on.
 *
 *     tick      append n samples of n variables, durable: apc_store_append(), and two prepared transactions
 *               written by hand for the same rows. "history, newest" appends to a table in the order of
 *               arrival and updates a table of newest values, which is the fastest way that was found to keep
 *               both; "(id, seq) key" is one table with the key that names a sample, which is what one writes
 *               first
 *     newest    of n variables, in a short and in a long history
 */
#include <ftw.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <apcstore.h>

#include "store.h"

#define LOADED  100000 /* rows that are there before a tick is measured */
#define BATCH   10000
#define SHORT   10000
#define LONG    10000000
#define PATIENT (180 * APC_NS_PER_S) /* for the long history */

static char folder[4200];

/* ---- The folder ------------------------------------------------------------------------------ */

static int remove_one(const char *path, const struct stat *st, int type, struct FTW *ftw)
{
    (void)st;
    (void)type;
    (void)ftw;
    return remove(path);
}

static void remove_folder(void)
{
    nftw(folder, remove_one, 8, FTW_DEPTH | FTW_PHYS);
}

const char *bench_folder(void)
{
    char program[4096];
    if (folder[0])
        return folder;
    ssize_t n = readlink("/proc/self/exe", program, sizeof program - 1);
    program[n > 0 ? n : 0] = '\0';
    if (!strrchr(program, '/'))
        die("cannot find where this program is");
    *strrchr(program, '/') = '\0';
    snprintf(folder, sizeof folder, "%s/sqlite.XXXXXX", program);
    if (!mkdtemp(folder))
        die("cannot make %s", folder);
    atexit(remove_folder);
    return folder;
}

/* ---- Ours ------------------------------------------------------------------------------------ */

struct ours {
    struct apc_store *store;
    int n;
    int64_t seq; /* of the last sample of each variable */
    struct apc_sample samples[BATCH];
};

static void fill(struct ours *o, int rows)
{
    for (int i = 0; i < rows; i++)
        o->samples[i] = (struct apc_sample){.table = APC_SENSOR,
                                            .id = i % o->n + 1,
                                            .seq = o->seq + 1 + i / o->n,
                                            .time = (o->seq + 1 + i / o->n) * APC_NS_PER_MS,
                                            .value = 0.1 * i};
    o->seq += rows / o->n;
    int stored = apc_store_append(o->store, o->samples, (size_t)rows);
    if (stored != rows)
        die("%d of %d samples were new: %s", stored, rows, apc_store_error(o->store));
}

static struct ours *ours_open(const char *name, int n)
{
    struct ours *o = allocate(1, sizeof *o);
    struct apc_error why;
    char uri[sizeof folder + 64];
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 60 * APC_NS_PER_S};

    o->n = n;
    snprintf(uri, sizeof uri, "sqlite:%s/%s-%d.db", bench_folder(), name, n);
    if (apc_store_open(&o->store, uri, &options, &why) < 0)
        die("%s", why.text);
    if (apc_store_init(o->store) < 0)
        die("%s", apc_store_error(o->store));
    return o;
}

static void ours_close(struct ours *o)
{
    apc_store_close(o->store);
    free(o);
}

static void append_once(void *ctx)
{
    struct ours *o = ctx;
    fill(o, o->n);
}

static void read_once(void *ctx)
{
    struct ours *o = ctx;
    for (int i = 0; i < o->n; i++)
        o->samples[i] = (struct apc_sample){.table = APC_SENSOR, .id = i + 1};
    if (apc_store_read(o->store, o->samples, (size_t)o->n) < 0)
        die("%s", apc_store_error(o->store));
    if (o->samples[o->n - 1].seq == 0)
        die("there is no newest sample");
}

/* ---- By hand --------------------------------------------------------------------------------- */

struct hand {
    sqlite3 *db;
    sqlite3_stmt *begin, *insert, *update, *commit; /* update: NULL without a table of newest values */
    int n;
    int64_t seq;
};

static void run(struct hand *h, const char *sql)
{
    if (sqlite3_exec(h->db, sql, NULL, NULL, NULL) != SQLITE_OK)
        die("%s: %s", sql, sqlite3_errmsg(h->db));
}

static sqlite3_stmt *prepare(struct hand *h, const char *sql)
{
    sqlite3_stmt *statement;
    if (sqlite3_prepare_v3(h->db, sql, -1, SQLITE_PREPARE_PERSISTENT, &statement, NULL) != SQLITE_OK)
        die("%s: %s", sql, sqlite3_errmsg(h->db));
    return statement;
}

static void step(struct hand *h, sqlite3_stmt *statement)
{
    if (sqlite3_step(statement) != SQLITE_DONE)
        die("%s", sqlite3_errmsg(h->db));
    sqlite3_reset(statement);
}

static void bind_and_step(struct hand *h, sqlite3_stmt *statement, int i)
{
    sqlite3_bind_int64(statement, 1, i % h->n + 1);
    sqlite3_bind_int64(statement, 2, h->seq + 1 + i / h->n);
    sqlite3_bind_int64(statement, 3, (h->seq + 1 + i / h->n) * 1000);
    sqlite3_bind_int64(statement, 4, 0);
    sqlite3_bind_double(statement, 5, 0.1 * i);
    step(h, statement);
}

static void insert(struct hand *h, int rows)
{
    step(h, h->begin);
    for (int i = 0; i < rows; i++) {
        bind_and_step(h, h->insert, i);
        if (h->update)
            bind_and_step(h, h->update, i);
    }
    step(h, h->commit);
    h->seq += rows / h->n;
}

#define COLUMNS                                                                                              \
    "id INTEGER NOT NULL, seq INTEGER NOT NULL, time INTEGER NOT NULL, status INTEGER NOT NULL, value NOT "  \
    "NULL"

static struct hand *hand_open(const char *name, int n, bool newest)
{
    struct hand *h = allocate(1, sizeof *h);
    char path[sizeof folder + 64];

    h->n = n;
    snprintf(path, sizeof path, "%s/%s-%d.db", bench_folder(), name, n);
    if (sqlite3_open(path, &h->db) != SQLITE_OK)
        die("%s: %s", path, sqlite3_errmsg(h->db));
    run(h, "PRAGMA journal_mode = PERSIST; PRAGMA synchronous = FULL; PRAGMA cache_size = -8000");
    if (newest)
        run(h, "CREATE TABLE sensor (" COLUMNS ");"
               "CREATE TABLE newest (id INTEGER PRIMARY KEY, seq INTEGER NOT NULL, time INTEGER NOT NULL,"
               " status INTEGER NOT NULL, value NOT NULL)");
    else
        run(h, "CREATE TABLE sensor (" COLUMNS ", PRIMARY KEY (id, seq)) WITHOUT ROWID");
    h->begin = prepare(h, "BEGIN IMMEDIATE");
    h->insert = prepare(h, "INSERT INTO sensor VALUES (?1, ?2, ?3, ?4, ?5)");
    h->update = newest ? prepare(h, "REPLACE INTO newest VALUES (?1, ?2, ?3, ?4, ?5)") : NULL;
    h->commit = prepare(h, "COMMIT");
    return h;
}

static void hand_close(struct hand *h)
{
    sqlite3_finalize(h->begin);
    sqlite3_finalize(h->insert);
    sqlite3_finalize(h->update);
    sqlite3_finalize(h->commit);
    sqlite3_close(h->db);
    free(h);
}

static void insert_once(void *ctx)
{
    struct hand *h = ctx;
    insert(h, h->n);
}

/* ---- Measurements ---------------------------------------------------------------------------- */

static void tick(struct bench *b, int n)
{
    struct ours *ours = ours_open("tick", n);
    struct hand *newest = hand_open("newest", n, true), *key = hand_open("key", n, false);
    struct bench_row rows[] = {
        {.name = "by hand: history, newest", .once = insert_once, .ctx = newest},
        {.name = "by hand: (id, seq) key", .once = insert_once, .ctx = key},
        {.name = "libapc: apc_store_append()", .once = append_once, .ctx = ours},
    };
    char title[64];

    for (int done = 0; done < LOADED; done += BATCH) {
        fill(ours, BATCH);
        insert(newest, BATCH);
        insert(key, BATCH);
    }
    rows[2].to[0] = &rows[0];
    rows[2].to[1] = &rows[1];
    b->reference[0] = "newest";
    b->reference[1] = "key";
    b->reference[2] = NULL;
    b->calls = 50;
    b->budget = 400 * APC_NS_PER_MS;
    snprintf(title, sizeof title, "sqlite: tick, n = %d", n);
    bench_run(b, title, (size_t)n, rows, 3);
    ours_close(ours);
    hand_close(newest);
    hand_close(key);
}

static void newest(struct bench *b, int n)
{
    struct ours *ways[2] = {ours_open("short", n), ours_open("long", n)};
    struct bench_row rows[] = {
        {.name = "libapc: short history", .once = read_once, .ctx = ways[0]},
        {.name = "libapc: long history", .once = read_once, .ctx = ways[1], .to = {&rows[0]}},
    };
    const apc_ns begin = apc_clock_mono(NULL);
    int long_rows = 0;
    char title[64];

    fill(ways[0], SHORT);
    for (; long_rows < LONG && apc_clock_mono(NULL) - begin < PATIENT; long_rows += BATCH)
        fill(ways[1], BATCH);
    b->reference[0] = "short";
    b->reference[1] = NULL;
    b->calls = 200;
    b->budget = 400 * APC_NS_PER_MS;
    snprintf(title, sizeof title, "sqlite: newest of %d: %d, %.0e rows", n, SHORT, (double)long_rows);
    bench_run(b, title, (size_t)n, rows, 2);
    ours_close(ways[0]);
    ours_close(ways[1]);
}

void bench_sqlite(struct bench *b)
{
    tick(b, 10);
    tick(b, 100);
    tick(b, 1000);
    newest(b, 100);
}
