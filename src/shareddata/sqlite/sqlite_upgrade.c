/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: version 4 of the tables, as sql/0004-loops.sql makes it. What version 1 kept for one
 * controller becomes that of its loops: its actual mode, opmode id 1, goes to table actual, and its target,
 * id 0, is put under each loop's id. All of it is the transaction of apc_store_init(); no row of a process
 * value is touched.
 */
#include "shareddata/sqlite/sqlite.h"

#include <ctype.h>
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LOOPS_MAX 65535
#define SPARE     1048576 /* seqs that must be left above the newest, or they begin anew */

/* ---- Who is still there ----------------------------------------------------------------------- */

/* Does the process have that file open? */
static bool has_open(int proc, const char *pid, const struct stat *file)
{
    char path[64];
    struct stat st;
    bool found = false;
    snprintf(path, sizeof path, "%.20s/fd", pid);
    int fd = openat(proc, path, O_RDONLY | O_DIRECTORY | O_CLOEXEC); /* another user's are not shown */
    DIR *list = fd >= 0 ? fdopendir(fd) : NULL;
    if (!list) {
        if (fd >= 0) {
            close(fd);
        }
        return false;
    }
    for (const struct dirent *e; !found && (e = readdir(list));) {
        found = fstatat(fd, e->d_name, &st, 0) == 0 && st.st_dev == file->st_dev && st.st_ino == file->st_ino;
    }
    closedir(list);
    return found;
}

static void name_process(int proc, const char *pid, char *text, size_t size)
{
    char path[64], name[32] = "a program";
    snprintf(path, sizeof path, "%.20s/comm", pid);
    int fd = openat(proc, path, O_RDONLY | O_CLOEXEC);
    const ssize_t n = fd >= 0 ? read(fd, name, sizeof name - 1) : -1;
    if (fd >= 0) {
        close(fd);
    }
    if (n > 0) {
        name[n] = '\0';
        name[strcspn(name, "\n")] = '\0';
    }
    snprintf(text, size, "%s (process %.20s)", name, pid);
}

/* Another process that has the file open, in text; false: none that this user may see. */
static bool find_process(const struct apc_sqlite *sq, char *text, size_t size)
{
    struct stat file;
    bool found = false;
    DIR *list = stat(sq->path, &file) == 0 ? opendir("/proc") : NULL;
    if (!list) {
        return false;
    }
    for (const struct dirent *e; !found && (e = readdir(list));) {
        if (isdigit((unsigned char)e->d_name[0]) && strtol(e->d_name, NULL, 10) != (long)getpid() &&
            has_open(dirfd(list), e->d_name, &file)) {
            found = true;
            name_process(dirfd(list), e->d_name, text, size);
        }
    }
    closedir(list);
    return found;
}

int apc_sqlite_alone(struct apc_sqlite *sq)
{
    char who[APC_SQLITE_HOLDER];
    int err = apc_sqlite_holder(sq, who);
    if (err == 0 && find_process(sq, who, sizeof who)) {
        err = 1;
    }
    return err > 0 ? apc_fail(&sq->base.why, APC_EBUSY,
                              "%s has tables of an older version and is in use by %s: stop it first",
                              sq->given, who)
                   : err;
}

/* ---- What was of one controller --------------------------------------------------------------- */

/* Run it with ?1. */
static int run_with(struct apc_sqlite *sq, const char *sql, int64_t number)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, sql, &statement);
    if (!err) {
        sqlite3_bind_int64(statement, 1, number);
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    return err;
}

/* The rows of the block at hand become rows of each loop, numbered from *@p seq on. */
static int move_block(struct apc_sqlite *sq, int loops, int64_t *seq)
{
    const struct apc_sqlite_loaded *l = &sq->loaded;
    int err = 0;
    for (size_t i = 0; err >= 0 && i < l->n; i++) {
        struct apc_sample s = l->rows[i].sample;
        s.table = APC_ACTUAL;
        s.seq = (*seq)++;
        for (int loop = 1; err >= 0 && loop <= loops; loop++) {
            s.id = apc_variable_number(APC_OPMODE, loop);
            err = apc_sqlite_append_one(sq, &s);
        }
        if (err >= 0) {
            sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_DROP_SAMPLE);
            sqlite3_bind_int64(statement, 1, l->rows[i].pos);
            err = apc_sqlite_step(sq, statement);
        }
    }
    return err < 0 ? err : 0;
}

/* The history of the one actual mode becomes that of each loop's. */
static int move_actual(struct apc_sqlite *sq, int loops)
{
    const int64_t former = apc_sqlite_variable(APC_OPMODE, 1);
    struct apc_sqlite_block b;
    int64_t from = 0, seq = 1;
    int found = 0;
    while (found >= 0 && (found = apc_sqlite_next_block(sq, former, from, INT64_MIN, INT64_MAX, &b)) > 0) {
        found = apc_sqlite_load(sq, former, &b);
        if (!found) {
            found = move_block(sq, loops, &seq);
        }
        from = b.seq + 1;
    }
    sq->loaded.variable = -1;
    if (found >= 0) {
        found = run_with(sq, "DELETE FROM block WHERE variable = ?1", former);
    }
    return found < 0 ? found : run_with(sq, "DELETE FROM variable WHERE variable = ?1", former);
}

/* Each loop has the target that was everybody's. Those of loop 1 go on from @p former, the newest seq that
 * was under its id: who has seen that must see that there is a newer one. */
static int put_targets(struct apc_sqlite *sq, int loops, int64_t former)
{
    struct apc_sample of_all = {.table = APC_OPMODE, .id = 0};
    int err = apc_sqlite_newest(sq, &of_all);
    for (int loop = 1; err >= 0 && of_all.seq > 0 && loop <= loops; loop++) {
        struct apc_sample s = of_all;
        s.id = loop;
        s.seq = (loop == 1 && former < APC_SEQ_MAX - SPARE ? former : 0) + 1;
        s.origin = of_all.seq <= APC_SEQ_MAX ? of_all.seq : 0;
        err = apc_sqlite_append_one(sq, &s);
    }
    return err < 0 ? err : 0;
}

/* Names are those that `apc init FILE` gives as well. ?1: how many loops there are. */
#define LOOPS                                                                                                \
    "WITH RECURSIVE n (i) AS (SELECT 1 WHERE ?1 > 0 UNION ALL SELECT i + 1 FROM n WHERE i < ?1),"            \
    " loop (i, name) AS (SELECT i, coalesce((SELECT name FROM tag WHERE table_number = 2 AND id = i),"       \
    " 'u' || i) FROM n) "
#define TAGS "INSERT INTO tag (table_number, id, name, unit, description, low, high, controller) "
static const char *const tags[] = {
    "DELETE FROM tag WHERE table_number = 5 AND id = 1 AND ?1 >= 0",
    LOOPS TAGS "SELECT 5, i, CASE name WHEN 'mode' THEN 'mode.1' ELSE name END, '',"
               " 'target mode: 0 Man, 1 Auto, 2 out of service, 3 Cas', 0, 3, 'controller' FROM loop",
    LOOPS TAGS
    "SELECT 9, i * 16 + 5, CASE WHEN ?1 = 1 THEN 'mode.actual' WHEN length(CAST(name AS BLOB)) > 51"
    " THEN 'mode.actual.' || i ELSE name || '.mode.actual' END, '',"
    " 'actual mode; besides 4 initialising, 5 at the fault value', 0, 5, 'controller' FROM loop",
    "UPDATE tag SET number = id * 16 + table_number WHERE ?1 >= 0",
};

int apc_sqlite_make_loops(struct apc_sqlite *sq)
{
    struct apc_sample dim = {.table = APC_DIM, .id = 3}, former = {.table = APC_OPMODE, .id = 1};
    int err = apc_sqlite_newest(sq, &dim);
    const int loops = dim.seq > 0 && dim.value >= 1 && dim.value <= LOOPS_MAX ? (int)dim.value : 0;
    if (!err) {
        err = apc_sqlite_newest(sq, &former);
    }
    if (!err) {
        err = move_actual(sq, loops);
    }
    if (!err) {
        err = put_targets(sq, loops, former.seq);
    }
    for (size_t i = 0; !err && i < sizeof tags / sizeof *tags; i++) {
        err = run_with(sq, tags[i], loops);
    }
    return err;
}
