/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The tables of the SQLite store. Samples of all variables stand in one table in the order in which they
 * came, so that a tick touches its last page and little else; sqlite_blocks.c says how they are found.
 * The header's application_id says that the file is ours, its user_version which tables it has. The views
 * are for people and their tools.
 */
#include "shareddata/migrations.h"
#include "shareddata/sqlite/sqlite.h"

#define VECTOR "length(value) / 8 AS n, value"
#define VIEW(name, number, columns)                                                                          \
    "CREATE VIEW " name " AS SELECT variable >> 4 AS id, seq,"                                               \
    " strftime('%Y-%m-%dT%H:%M:%S', time / 1000000 - (time % 1000000 < 0), 'unixepoch') ||"                  \
    " printf('.%06dZ', (time % 1000000 + 1000000) % 1000000) AS time, status, " columns                      \
    " FROM sample WHERE variable & 15 = " number ";"

static const char tables[] =
    /* variable: id * 16 + number of the table (enum apc_table, never to be renumbered). time: us of Unix
     * time. value has no type: a column of REAL loses the sign of -0.0. A vector is a row whose value is a
     * blob: its elements, each 8 bytes, little end first. */
    "CREATE TABLE sample (pos INTEGER PRIMARY KEY, variable INTEGER NOT NULL, seq INTEGER NOT NULL,"
    " previous INTEGER NOT NULL, time INTEGER NOT NULL, status INTEGER NOT NULL, value NOT NULL,"
    " sensor_seq INTEGER, setpoint_seq INTEGER, origin INTEGER, author INTEGER);"
    "CREATE TABLE variable (variable INTEGER PRIMARY KEY, seq INTEGER NOT NULL, pos INTEGER NOT NULL,"
    " count INTEGER NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL);"
    "CREATE TABLE block (variable INTEGER NOT NULL, seq INTEGER NOT NULL, pos INTEGER NOT NULL,"
    " count INTEGER NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL, PRIMARY KEY (variable, seq))"
    " WITHOUT ROWID;"
    "CREATE TABLE claim (variable INTEGER PRIMARY KEY, record INTEGER NOT NULL);"
    "CREATE TABLE author (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);"
    "CREATE TABLE catalogue (revision INTEGER PRIMARY KEY CHECK (revision > 0), time INTEGER NOT NULL,"
    " kind TEXT NOT NULL CHECK (kind IN ('live', 'history')), text TEXT NOT NULL);"
    "CREATE TABLE tag (table_number INTEGER NOT NULL, id INTEGER NOT NULL,"
    " name TEXT NOT NULL CHECK (name <> ''), unit TEXT NOT NULL, description TEXT NOT NULL,"
    " low REAL NOT NULL, high REAL NOT NULL, number INTEGER NOT NULL DEFAULT 0,"
    " controller TEXT NOT NULL DEFAULT '', area TEXT NOT NULL DEFAULT '',"
    " length INTEGER NOT NULL DEFAULT 0, step REAL NOT NULL DEFAULT 0, period REAL NOT NULL DEFAULT 0,"
    " display_low REAL NOT NULL DEFAULT 0, display_high REAL NOT NULL DEFAULT 0,"
    " PRIMARY KEY (table_number, id), UNIQUE (table_number, name)) WITHOUT ROWID;"
    "CREATE TABLE event (id INTEGER PRIMARY KEY AUTOINCREMENT, time INTEGER NOT NULL, severity INTEGER NOT "
    "NULL,"
    " source TEXT NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL);"
    "CREATE INDEX event_time ON event (time);"
    "CREATE TABLE timing (id INTEGER PRIMARY KEY AUTOINCREMENT, time INTEGER NOT NULL, task TEXT NOT NULL,"
    " quantity TEXT NOT NULL CHECK (quantity IN ('lateness', 'jitter', 'run')), period INTEGER NOT NULL,"
    " missed INTEGER NOT NULL, count INTEGER NOT NULL, mean REAL NOT NULL, sd REAL NOT NULL,"
    " p50 INTEGER NOT NULL, p99 INTEGER NOT NULL, max INTEGER NOT NULL,"
    " bins BLOB NOT NULL);" /* low, high, count of all, each 8 bytes, little end first */
    "CREATE INDEX timing_time ON timing (time);";

static const char views[] =
    VIEW("sensor", "1", "value") VIEW("actuator", "2", "value, origin, sensor_seq, setpoint_seq")
        VIEW("setpoint", "3", "value, origin, author") VIEW("dim", "4", "value")
            VIEW("opmode", "5", "value, author") VIEW("tuning", "6", "value, author")
                VIEW("manual", "7", "value, author") VIEW("actual", "9", "value, origin")
                    VIEW("estimate", "10", "value") VIEW("alarm", "11", "value") VIEW("tick", "12", VECTOR)
                        VIEW("plan", "13", VECTOR) VIEW("prediction", "14", VECTOR);

#define VERSION 4 /* 1 to 3 were before the first release */

static int query_number(struct apc_sqlite *sq, const char *sql, int64_t *out)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, sql, &statement);
    if (!err) {
        err = apc_sqlite_step(sq, statement);
    }
    *out = err > 0 ? sqlite3_column_int64(statement, 0) : 0;
    sqlite3_finalize(statement);
    return err < 0 ? err : 0;
}

/* The version of the tables; 0 when there is nothing in the file. */
static int version_of(struct apc_sqlite *sq, int64_t *version)
{
    int64_t application = 0, objects = 0;
    int err = query_number(sq, "PRAGMA application_id", &application);
    if (!err) {
        err = query_number(sq, "PRAGMA user_version", version);
    }
    if (!err) {
        err = query_number(sq, "SELECT count(*) FROM sqlite_schema", &objects);
    }
    if (!err && application != APC_SQLITE_APPLICATION && (application != 0 || objects > 0)) {
        return apc_fail(&sq->base.why, APC_ESCHEMA,
                        "%s is another program's database: name a file that does not exist yet", sq->given);
    }
    if (!err && application == APC_SQLITE_APPLICATION && *version > VERSION) {
        return apc_fail(&sq->base.why, APC_ESCHEMA,
                        "%s has tables of version %d, this library knows %d: upgrade libapc", sq->given,
                        (int)*version, VERSION);
    }
    if (!err && application == APC_SQLITE_APPLICATION && *version > 0 && *version < VERSION) {
        return apc_fail(&sq->base.why, APC_ESCHEMA,
                        "%s has tables of version %d, from before the first release: run apc init of "
                        "commit " APC_FORMER_COMMIT " on it (sql/README.md)",
                        sq->given, (int)*version);
    }
    if (application == 0) {
        *version = 0;
    }
    return err;
}

int apc_sqlite_another(struct apc_sqlite *sq)
{
    int64_t version = 0;
    return version_of(sq, &version);
}

int apc_sqlite_check(struct apc_sqlite *sq)
{
    int64_t version = 0;
    int err = version_of(sq, &version);
    if (!err && version != VERSION) {
        return apc_fail(&sq->base.why, APC_ESCHEMA,
                        "%s has no tables; needed are those of version %d: run `apc init`", sq->given,
                        VERSION);
    }
    return err;
}

static int make_file(struct apc_sqlite *sq, int64_t *had)
{
    char pragmas[100];
    int err = version_of(sq, had);
    if (err || *had == VERSION) {
        return err;
    }
    sqlite3_snprintf(sizeof pragmas, pragmas, "PRAGMA application_id = %d; PRAGMA user_version = %d",
                     APC_SQLITE_APPLICATION, VERSION);
    const char *const steps[] = {tables, views, pragmas};
    for (size_t i = 0; !err && i < sizeof steps / sizeof steps[0]; i++) {
        err = apc_sqlite_run(sq, steps[i]);
    }
    return err;
}

int apc_sqlite_init(struct apc_store *store)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int64_t had = 0;
    apc_sqlite_drop(sq); /* what else is prepared was for the tables as they were */
    int err = apc_sqlite_open(sq, true);
    if (!err) {
        err = apc_sqlite_begin(sq, APC_SQLITE_WRITE);
    }
    if (!err) {
        err = apc_sqlite_end(sq, make_file(sq, &had));
    }
    apc_sqlite_drop(sq);
    return err ? err : had == VERSION ? apc_store_version() : 0;
}
