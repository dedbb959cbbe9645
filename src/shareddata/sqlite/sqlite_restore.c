/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: a backup in a file's place. All of it is written into the file in one transaction: what a
 * killed writer left in the journal is rolled back first, by the file that it is of, and who has the file
 * open sees all of the backup or nothing. A file that is moved into the place of another gets that one's
 * journal.
 */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "shareddata/sqlite/sqlite.h"

/* ---- What it comes from ---------------------------------------------------------------------- */

/* The one value of a query: a number, or whether it is that text. */
static int query_value(sqlite3 *db, const char *sql, const char *text, int64_t *out)
{
    sqlite3_stmt *statement = NULL;
    int rc = sqlite3_prepare_v2(db, sql, -1, &statement, NULL);
    rc = rc == SQLITE_OK ? sqlite3_step(statement) : rc;
    if (rc == SQLITE_ROW) {
        const char *said = (const char *)sqlite3_column_text(statement, 0);
        *out = text ? said && strcmp(said, text) == 0 : sqlite3_column_int64(statement, 0);
    }
    sqlite3_finalize(statement);
    return rc == SQLITE_ROW ? SQLITE_OK : rc;
}

static bool is_same(const char *a, const char *b)
{
    struct stat x, y;
    return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

/* Nothing is put in a record's place that is none, or that cannot be read. For reading only: a backup with a
 * journal of its own that has not been rolled back is refused by that. */
static int check_source(struct apc_sqlite *sq, const char *from)
{
    struct apc_error *why = &sq->base.why;
    sqlite3 *source = NULL;
    int64_t application = 0, whole = 0;
    int rc = sqlite3_open_v2(from, &source, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, NULL), err = 0;
    rc = rc == SQLITE_OK ? query_value(source, "PRAGMA application_id", NULL, &application) : rc;
    if (rc == SQLITE_OK && application == APC_SQLITE_APPLICATION) {
        rc = query_value(source, "PRAGMA quick_check(1)", "ok", &whole);
    }
    if ((rc & 0xFF) == SQLITE_CANTOPEN) {
        err = apc_fail(why, APC_ENOTFOUND, "%s cannot be opened", from);
    } else if (rc != SQLITE_OK && rc != SQLITE_NOTADB && (rc & 0xFF) != SQLITE_CORRUPT) {
        err = apc_fail(why, APC_ESTORE, "%s cannot be read: %s", from, sqlite3_errmsg(source));
    } else if (rc == SQLITE_NOTADB || (rc == SQLITE_OK && application != APC_SQLITE_APPLICATION)) {
        err = apc_fail(why, APC_ESCHEMA, "%s is no record of libapc's", from);
    } else if (!whole) {
        err = apc_fail(why, APC_ESTORE, "%s is damaged", from);
    }
    sqlite3_close_v2(source);
    return err;
}

/* ---- What was there -------------------------------------------------------------------------- */

static int copy_aside(struct apc_sqlite *sq, const char *kept)
{
    sqlite3 *aside = NULL;
    sqlite3_backup *backup = NULL;
    int rc = sqlite3_open_v2(kept, &aside, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, NULL);
    if (rc == SQLITE_OK) {
        backup = sqlite3_backup_init(aside, "main", sq->db, "main");
        rc = backup ? sqlite3_backup_step(backup, -1) : sqlite3_errcode(aside);
        const int ended = backup ? sqlite3_backup_finish(backup) : rc;
        rc = rc == SQLITE_DONE ? ended : rc;
    }
    const int err = rc == SQLITE_OK
                        ? 0
                        : apc_fail(&sq->base.why, (rc & 0xFF) == SQLITE_FULL ? APC_EFULL : APC_ESTORE,
                                   "what is there cannot be kept as %s: %s", kept, sqlite3_errstr(rc));
    sqlite3_close_v2(aside);
    return err;
}

/* It stays beside the file: who restores the wrong way round has lost nothing. */
static int keep_former_file(struct apc_sqlite *sq, char *kept, size_t size)
{
    char time[APC_TIME_LEN];
    int64_t tables = 0;
    const int rc = query_value(sq->db, "SELECT count(*) FROM sqlite_schema", NULL, &tables);
    if (rc != SQLITE_OK) {
        return apc_sqlite_fail(sq, rc);
    }
    if (tables == 0) {
        return 0;
    }
    snprintf(kept, size, "%s.replaced-%s", sq->path, apc_time_format(apc_clock_utc(NULL), time));
    int err = apc_sqlite_make(sq, kept);
    err = err ? err : copy_aside(sq, kept);
    if (err) {
        unlink(kept);
        kept[0] = '\0';
    }
    return err;
}

/* ---- The one for the other ------------------------------------------------------------------- */

/* Commands that a query makes of the two files' tables; their names are quoted. */
static const char *const steps[] = {
    "SELECT group_concat(printf('DROP %s main.\"%w\";', type, name), '') FROM main.sqlite_schema"
    " WHERE type IN ('table', 'view') AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\'",
    "SELECT group_concat(sql || ';', '') FROM source.sqlite_schema"
    " WHERE type = 'table' AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\'",
    "SELECT group_concat(printf('INSERT INTO main.\"%w\" SELECT * FROM source.\"%w\";', name, name), '')"
    " FROM source.sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\'",
    "SELECT group_concat(printf('DELETE FROM main.\"%w\"; INSERT INTO main.\"%w\" SELECT * FROM "
    "source.\"%w\";',"
    " name, name, name), '') FROM source.sqlite_schema WHERE name = 'sqlite_sequence'",
    "SELECT group_concat(sql || ';', '') FROM source.sqlite_schema WHERE type <> 'table' AND sql NOT NULL",
};

static int run_made(struct apc_sqlite *sq, const char *query)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, query, &statement);
    const int row = err ? err : apc_sqlite_step(sq, statement);
    const char *said = row > 0 ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    char *made = said ? sqlite3_mprintf("%s", said) : NULL; /* the query must have ended when tables go */
    sqlite3_finalize(statement);
    err = row < 0 ? row : 0;
    if (!err && said && !made) {
        err = apc_fail(&sq->base.why, APC_ENOMEM, "out of memory");
    }
    err = !err && made ? apc_sqlite_run(sq, made) : err;
    sqlite3_free(made);
    return err;
}

static int attach_backup(struct apc_sqlite *sq, const char *from)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, "ATTACH ?1 AS source", &statement);
    if (!err) {
        sqlite3_bind_text(statement, 1, from, -1, SQLITE_STATIC);
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    return err;
}

/* The lock of the one is held already, that of the other from its first row on. */
static int replace(struct apc_sqlite *sq)
{
    int64_t version = 0;
    char pragmas[100];
    int err = apc_sqlite_run(sq, "BEGIN; SELECT count(*) FROM source.sqlite_schema");
    const int rc = err ? SQLITE_OK : query_value(sq->db, "PRAGMA source.user_version", NULL, &version);
    err = rc == SQLITE_OK ? err : apc_sqlite_fail(sq, rc);
    sq->deadline = INT64_MAX; /* it takes as long as it takes */
    for (size_t i = 0; !err && i < sizeof steps / sizeof steps[0]; i++) {
        err = run_made(sq, steps[i]);
    }
    if (!err) {
        snprintf(pragmas, sizeof pragmas, "PRAGMA main.application_id = %d; PRAGMA main.user_version = %d",
                 APC_SQLITE_APPLICATION, (int)version);
        err = apc_sqlite_run(sq, pragmas);
    }
    return apc_sqlite_end(sq, err);
}

/* Nobody else is in the file from the first lock on until it is closed. */
static int restore(struct apc_sqlite *sq, const char *from, char *kept, size_t size)
{
    char holder[APC_SQLITE_HOLDER];
    int err = apc_sqlite_another(sq);
    if (!err) {
        err = apc_sqlite_run(sq, "PRAGMA main.locking_mode = EXCLUSIVE; BEGIN EXCLUSIVE; COMMIT");
    }
    if (!err) {
        err = apc_sqlite_holder(sq, holder);
        err = err > 0 ? apc_fail(&sq->base.why, APC_EBUSY, "%s is being written by %s: stop it first",
                                 sq->given, holder)
                      : err;
    }
    err = err ? err : keep_former_file(sq, kept, size);
    err = err ? err : attach_backup(sq, from);
    return err ? err : replace(sq);
}

int apc_sqlite_restore(struct apc_store *store, const char *from, char *kept, size_t size)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    const bool there = access(sq->given, F_OK) == 0;
    int err = is_same(from, sq->given) ? apc_fail(&sq->base.why, APC_EINVAL, "%s is that file itself", from)
                                       : check_source(sq, from);
    apc_sqlite_drop(sq);
    if (!err) {
        err = apc_sqlite_open(sq, true);
        err = err ? err : restore(sq, from, kept, size);
        apc_sqlite_drop(sq);
        if (err && !there) {
            unlink(sq->given); /* an empty one, which was made for it */
        }
    }
    return err;
}
