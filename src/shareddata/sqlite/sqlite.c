/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: a file, and no server. Every operation is one transaction or, for long ones, a row of
 * short ones: a reader holds up each commit for as long as its transaction is open, so none is open while the
 * caller's function runs.
 *
 * The file has a rollback journal, never a write-ahead log: SQLite before 3.51.3 may lose commits when
 * several processes reset the log, and a process that has an older library than ours is nothing we could see.
 * The journal file stays (PERSIST: no directory entry comes and goes with each commit), and synchronous =
 * FULL syncs it, the database and the journal's end before a commit returns.
 *
 * Deadlines hold for locks (the busy handler) and for the CPU (the progress handler). A disk that hangs in
 * fsync() is beyond them.
 */
#include "shareddata/sqlite/sqlite.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define PATH_LEN  504                  /* of a file: what SQLite takes, 512, without "-journal" */
#define PAUSE_MIN (APC_NS_PER_MS / 10) /* between two tries for a lock; commits take about a millisecond */
#define PAUSE_MAX (4 * APC_NS_PER_MS)
#define OPCODES   1000 /* of SQLite's machine between two looks at the clock */

#define ROWS "SELECT variable, previous, seq, time, status, value, origin, author, pos FROM sample"

static const char *const texts[APC_SQLITE_STATEMENTS] = {
    [APC_SQLITE_READ] = "BEGIN",
    [APC_SQLITE_WRITE] = "BEGIN IMMEDIATE",
    [APC_SQLITE_COMMIT] = "COMMIT",
    [APC_SQLITE_ROLLBACK] = "ROLLBACK",
    [APC_SQLITE_NEWEST] = "SELECT s.seq, s.time, s.status, s.value, s.origin,"
                          " s.author"
                          " FROM variable v JOIN sample s ON s.pos = v.pos WHERE v.variable = ?1",
    [APC_SQLITE_MARK] = "PRAGMA application_id = 1634755377", /* APC_SQLITE_APPLICATION, which it is */
    [APC_SQLITE_VARIABLE] = "SELECT seq, pos, count, first, last FROM variable WHERE variable = ?1",
    [APC_SQLITE_GROW] = "UPDATE variable SET pos = grow(seq, pos, count, first, last), seq = ?2,"
                        " count = count + 1, first = iif(first < ?3, first, ?3),"
                        " last = iif(last > ?3, last, ?3)"
                        " WHERE variable = ?1 AND seq < ?2",
    [APC_SQLITE_LAST_POS] = "SELECT max(pos) FROM sample",
    [APC_SQLITE_PUT_VARIABLE] = "REPLACE INTO variable VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [APC_SQLITE_NEXT_BLOCK] =
        "SELECT seq, pos, count, first, last FROM block WHERE variable = ?1 AND seq >= ?2"
        " AND last >= ?3 AND first < ?4 ORDER BY seq LIMIT 1",
    [APC_SQLITE_FORMER_BLOCK] = "SELECT seq, pos, count, first, last FROM block WHERE variable = ?1"
                                " AND seq < ?2 AND last >= ?3 AND first < ?4 ORDER BY seq DESC LIMIT 1",
    [APC_SQLITE_PUT_BLOCK] = "REPLACE INTO block VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [APC_SQLITE_DROP_BLOCK] = "DELETE FROM block WHERE variable = ?1 AND seq = ?2",
    [APC_SQLITE_ROWS_UP] = ROWS " WHERE pos >= ?1 ORDER BY pos",
    [APC_SQLITE_ROWS_DOWN] = ROWS " WHERE pos <= ?1 ORDER BY pos DESC",
    [APC_SQLITE_INSERT] = "INSERT INTO sample VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, NULL, NULL, ?8, ?9)",
    [APC_SQLITE_LINK] = "UPDATE sample SET previous = ?2 WHERE pos = ?1",
    [APC_SQLITE_DROP_SAMPLE] = "DELETE FROM sample WHERE pos = ?1",
};

/* ---- Times ---------------------------------------------------------------------------------- */

int64_t apc_sqlite_time(apc_ns utc)
{
    return utc / 1000 - (utc % 1000 < 0);
}

int64_t apc_sqlite_bound(apc_ns utc, int64_t none)
{
    return utc == 0 || utc > INT64_MAX - 999 ? none : apc_sqlite_time(utc + 999);
}

apc_ns apc_sqlite_ns(int64_t us)
{
    return us > INT64_MAX / 1000 ? INT64_MAX : us < INT64_MIN / 1000 ? INT64_MIN : us * 1000;
}

/* ---- Errors --------------------------------------------------------------------------------- */

static bool is_disk_full(int error)
{
    return error == ENOSPC || error == EDQUOT || error == EFBIG;
}

/* The last error of the file system: of the journal when that one says that there is no room, else of the
 * file. */
static int system_error(const struct apc_sqlite *sq)
{
    sqlite3_file *journal = NULL;
    int error = 0;
    if (sqlite3_file_control(sq->db, "main", SQLITE_FCNTL_JOURNAL_POINTER, &journal) == SQLITE_OK &&
        journal && journal->pMethods) {
        journal->pMethods->xFileControl(journal, SQLITE_FCNTL_LAST_ERRNO, &error);
    }
    if (!is_disk_full(error)) {
        sqlite3_file_control(sq->db, "main", SQLITE_FCNTL_LAST_ERRNO, &error);
    }
    return error;
}

/* SQLite would make the log, and says that there is no file, or none that can be written. */
static int no_log(struct apc_sqlite *sq)
{
    return apc_fail(&sq->base.why, APC_EPERM,
                    "%s has a write-ahead log, which cannot be read where nothing can be written: copy it to "
                    "where it can, with the files beside it, or before it is brought here run sqlite3 FILE "
                    "'PRAGMA journal_mode = DELETE'",
                    sq->given);
}

/* What the file system says, where SQLite only says that something went wrong. */
static int fail_system(struct apc_sqlite *sq, int code, int error)
{
    struct apc_error *why = &sq->base.why;
    if (is_disk_full(error)) {
        return apc_fail(why, APC_EFULL, "%s: there is no room left for it: %s", sq->given, strerror(error));
    }
    if ((code & 0xFF) == SQLITE_CANTOPEN && error == ENOENT && access(sq->path, F_OK) == 0) {
        return no_log(sq);
    }
    if (error == EACCES || error == EPERM || error == EROFS) {
        return apc_fail(why, APC_EPERM, "%s: it, its folder and what is beside it must be writable: %s",
                        sq->given, strerror(error));
    }
    return apc_fail(why, APC_ECONN, "%s: %s%s%s", sq->given, sqlite3_errstr(code), error ? ": " : "",
                    error ? strerror(error) : "");
}

int apc_sqlite_fail(struct apc_sqlite *sq, int code)
{
    struct apc_error *why = &sq->base.why;
    switch (code & 0xFF) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return apc_fail(why, APC_ETIMEDOUT, "%s was locked by another process for %g s", sq->given,
                        apc_ns_to_s(sq->base.config.timeout));
    case SQLITE_INTERRUPT:
        return apc_fail(why, APC_ETIMEDOUT, "%s did not answer within %g s", sq->given,
                        apc_ns_to_s(sq->base.config.timeout));
    case SQLITE_NOMEM:
        return apc_fail(why, APC_ENOMEM, "out of memory");
    case SQLITE_NOTADB:
        return apc_fail(why, APC_ESCHEMA, "%s is no SQLite database", sq->given);
    case SQLITE_CORRUPT:
        return apc_sqlite_damaged(sq);
    case SQLITE_FULL:
        return apc_fail(why, APC_EFULL, "%s: there is no room left for it: the disk is full", sq->given);
    case SQLITE_READONLY:
        return apc_fail(why, APC_EPERM,
                        code == SQLITE_READONLY_DIRECTORY
                            ? "%s: its folder is read-only for this user, where a journal or write-ahead log "
                              "has to be made"
                            : "%s is read-only for this user",
                        sq->given);
    case SQLITE_IOERR:
        return fail_system(sq, code, system_error(sq));
    case SQLITE_CANTOPEN:
        return fail_system(sq, code, sqlite3_system_errno(sq->db));
    default:
        return apc_fail(why, APC_ESTORE, "%s: %s", sq->given, sqlite3_errmsg(sq->db));
    }
}

int apc_sqlite_damaged(struct apc_sqlite *sq)
{
    return apc_fail(&sq->base.why, APC_ESTORE,
                    "%s is damaged: copy what can be read to another store with `apc copy`", sq->given);
}

/* ---- Statements ----------------------------------------------------------------------------- */

sqlite3_stmt *apc_sqlite_use(struct apc_sqlite *sq, enum apc_sqlite_sql which)
{
    return sq->statements[which];
}

int apc_sqlite_prepare(struct apc_sqlite *sq, const char *sql, sqlite3_stmt **statement)
{
    int rc = sqlite3_prepare_v3(sq->db, sql, -1, 0, statement, NULL);
    return rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
}

int apc_sqlite_step(struct apc_sqlite *sq, sqlite3_stmt *statement)
{
    int rc = sqlite3_step(statement);
    if (rc == SQLITE_ROW) {
        return 1;
    }
    int err = rc == SQLITE_DONE ? 0 : apc_sqlite_fail(sq, rc); /* the reset would change the message */
    sqlite3_reset(statement);
    return err;
}

#define NEAR 8 /* rows that are stepped over in the time that one takes to be looked up */

int apc_sqlite_find_row(struct apc_sqlite *sq, enum apc_sqlite_sql which, int64_t from, int64_t pos)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, which);
    int64_t far = which == APC_SQLITE_ROWS_UP ? pos - from : from - pos;
    if (from == 0 || far < 1 || far > NEAR) { /* one that came late lies the other way */
        sqlite3_reset(statement);
        sqlite3_bind_int64(statement, 1, pos);
        far = 1;
    }
    int found = 0;
    do {
        found = apc_sqlite_step(sq, statement);
    } while (found > 0 && sqlite3_column_int64(statement, 8) != pos && --far > 0);
    return found > 0 ? sqlite3_column_int64(statement, 8) == pos : found;
}

int apc_sqlite_run(struct apc_sqlite *sq, const char *sql)
{
    int rc = sqlite3_exec(sq->db, sql, NULL, NULL, NULL);
    return rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
}

/* ---- Deadlines ------------------------------------------------------------------------------ */

/* Somebody else has a lock: wait a little, with a jitter so that two waiters do not march in step. */
static int on_busy(void *ctx, int tries)
{
    struct apc_sqlite *sq = (struct apc_sqlite *)ctx;
    apc_ns left = sq->deadline - apc_clock_mono(NULL);
    if (left <= 0) {
        return 0;
    }
    apc_ns pause = tries < 6 ? PAUSE_MIN << tries : PAUSE_MAX;
    sq->random = sq->random * UINT64_C(6364136223846793005) + 1;
    pause -= (apc_ns)(sq->random >> 33) % (pause / 2);
    pause = pause < left ? pause : left;
    nanosleep(&(struct timespec){.tv_nsec = pause}, NULL);
    return 1;
}

static int on_progress(void *ctx)
{
    const struct apc_sqlite *sq = (const struct apc_sqlite *)ctx;
    return apc_clock_mono(NULL) >= sq->deadline;
}

/* ---- Opening -------------------------------------------------------------------------------- */

void apc_sqlite_drop(struct apc_sqlite *sq)
{
    for (size_t i = 0; i < APC_SQLITE_STATEMENTS; i++) {
        sqlite3_finalize(sq->statements[i]);
        sq->statements[i] = NULL;
    }
    if (sq->watch >= 0) {
        close(sq->watch);
    }
    sq->watch = -1;
    sqlite3_close_v2(sq->db);
    sq->db = NULL;
    sq->reopened = true;
}

/* Of a file that is to be made. SQLite would only say that there is none. */
static int check_folder(struct apc_sqlite *sq)
{
    char folder[sizeof sq->path];
    memcpy(folder, sq->path, sizeof folder);
    char *slash = strrchr(folder, '/'); /* an absolute path has one */
    slash[slash == folder] = '\0';
    if (access(folder, W_OK | X_OK) == 0) {
        return 0;
    }
    const int error = errno;
    return apc_fail(&sq->base.why, error == EACCES || error == EROFS ? APC_EPERM : APC_ECONN,
                    "%s cannot be made: its folder: %s", sq->given, strerror(error));
}

/* The file's own name, so that all who mean it agree on the names of what stands beside it. */
static int resolve(struct apc_sqlite *sq, bool make)
{
    struct stat st;
    if (realpath(sq->given, sq->path)) {
        if (stat(sq->path, &st) != 0 || S_ISREG(st.st_mode)) {
            return 0;
        }
        return apc_fail(&sq->base.why, APC_EINVAL, "%s is no file", sq->given);
    }
    int error = errno;
    if (error == ENOENT && make) {
        memcpy(sq->path, sq->given, sizeof sq->path);
        return check_folder(sq);
    }
    return apc_fail(&sq->base.why, error == EACCES ? APC_EPERM : APC_ECONN, "%s cannot be opened: %s%s",
                    sq->given, strerror(error), error == ENOENT ? "; `apc init` makes it" : "");
}

/* For its user alone, whatever the umask; SQLite makes what stands beside it alike. A file that is there is
 * not even opened: to close a descriptor of it would take away the locks of this process. */
int apc_sqlite_make(struct apc_sqlite *sq, const char *path)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0 && errno != EEXIST) {
        return fail_system(sq, SQLITE_CANTOPEN, errno);
    }
    if (fd >= 0) {
        close(fd);
    }
    return 0;
}

/* A log that somebody switched on goes, if nobody else has the file open; otherwise we do. */
static int set_journal(struct apc_sqlite *sq)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, "PRAGMA journal_mode = PERSIST", &statement);
    if (!err) {
        err = apc_sqlite_step(sq, statement);
    }
    if (err > 0) {
        const char *mode = (const char *)sqlite3_column_text(statement, 0);
        err =
            mode && strcmp(mode, "wal") == 0
                ? apc_fail(&sq->base.why, APC_ESTORE,
                           "%s has a write-ahead log, which is not safe between processes: stop who uses it, "
                           "then sqlite3 FILE 'PRAGMA journal_mode = DELETE'",
                           sq->given)
                : 0;
    }
    sqlite3_finalize(statement);
    return err;
}

static int prepare_statements(struct apc_sqlite *sq, size_t from, size_t to)
{
    for (size_t i = from; i < to; i++) {
        int rc =
            sqlite3_prepare_v3(sq->db, texts[i], -1, SQLITE_PREPARE_PERSISTENT, &sq->statements[i], NULL);
        if (rc != SQLITE_OK) {
            return apc_sqlite_fail(sq, rc);
        }
    }
    return 0;
}

int apc_sqlite_prepare_all(struct apc_sqlite *sq)
{
    return prepare_statements(sq, APC_SQLITE_NEWEST, APC_SQLITE_STATEMENTS);
}

static int set_up_file(struct apc_sqlite *sq, bool make)
{
    sqlite3_extended_result_codes(sq->db, 1);
    sqlite3_busy_handler(sq->db, on_busy, sq);
    sqlite3_progress_handler(sq->db, OPCODES, on_progress, sq);
    sqlite3_db_config(sq->db, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    int err = apc_sqlite_run(sq, "PRAGMA trusted_schema = OFF; PRAGMA synchronous = FULL;"
                                 "PRAGMA journal_size_limit = 4194304; PRAGMA cache_size = -8000");
    if (!err && !make) {
        err = apc_sqlite_check(sq); /* first: nothing of another's file is changed */
    }
    if (!err && !sqlite3_db_readonly(sq->db, "main")) {
        err = set_journal(sq);
    }
    if (!err) {
        int rc = apc_sqlite_make_function(sq);
        err = rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
    }
    if (!err) {
        err = prepare_statements(sq, 0, APC_SQLITE_NEWEST);
    }
    if (!err && !make) {
        err = apc_sqlite_prepare_all(sq);
    }
    return err;
}

int apc_sqlite_open(struct apc_sqlite *sq, bool make)
{
    struct stat st;
    sq->deadline = apc_clock_mono(NULL) + sq->base.config.timeout;
    int err = resolve(sq, make);
    if (!err && make) {
        err = apc_sqlite_make(sq, sq->path);
    }
    if (err) {
        return err;
    }
    int rc = sqlite3_open_v2(sq->path, &sq->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, NULL);
    err = rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
    if (!err && (stat(sq->path, &st) != 0 || !realpath(sq->given, sq->path))) {
        err = apc_fail(&sq->base.why, APC_ECONN, "%s has just vanished", sq->given);
    }
    if (!err) {
        sq->device = st.st_dev;
        sq->inode = st.st_ino;
        err = apc_sqlite_check_journal(sq);
    }
    if (!err) {
        err = set_up_file(sq, make);
    }
    if (err) {
        apc_sqlite_drop(sq);
        return err;
    }
    sq->base.stats.connects++;
    return 0;
}

/* The open file may have been moved away, removed, replaced: what is named by the path counts. */
static bool still_there(const struct apc_sqlite *sq)
{
    struct stat st;
    return stat(sq->given, &st) == 0 && st.st_dev == sq->device && st.st_ino == sq->inode;
}

int apc_sqlite_enter(struct apc_sqlite *sq)
{
    int err = 0;
    sq->deadline = apc_clock_mono(NULL) + sq->base.config.timeout;
    if (sq->db && !still_there(sq)) {
        apc_sqlite_drop(sq);
    }
    if (!sq->db) {
        err = apc_sqlite_open(sq, false);
    }
    return err ? err : apc_sqlite_renew_claims(sq);
}

/* ---- Transactions --------------------------------------------------------------------------- */

int apc_sqlite_begin(struct apc_sqlite *sq, enum apc_sqlite_sql how)
{
    sq->base.stats.round_trips++;
    sq->loaded.variable = -1;
    sq->pos = 0;
    int err = apc_sqlite_step(sq, apc_sqlite_use(sq, how));
    if (!err && how == APC_SQLITE_WRITE && sq->statements[APC_SQLITE_MARK]) {
        err = apc_sqlite_step(sq, apc_sqlite_use(sq, APC_SQLITE_MARK));
        return err ? apc_sqlite_end(sq, err) : 0;
    }
    return err;
}

int apc_sqlite_enter_begin(struct apc_sqlite *sq, enum apc_sqlite_sql how)
{
    int err = apc_sqlite_enter(sq);
    return err ? err : apc_sqlite_begin(sq, how);
}

int apc_sqlite_end(struct apc_sqlite *sq, int result)
{
    if (result >= 0) {
        int err = apc_sqlite_step(sq, apc_sqlite_use(sq, APC_SQLITE_COMMIT));
        result = err ? err : result;
    }
    if (result < 0) {
        for (size_t i = APC_SQLITE_NEWEST; i < APC_SQLITE_STATEMENTS; i++) {
            sqlite3_reset(sq->statements[i]);
        }
        if (!sqlite3_get_autocommit(sq->db)) { /* SQLite may have rolled back by itself */
            struct apc_error why = sq->base.why;
            apc_sqlite_step(sq, apc_sqlite_use(sq, APC_SQLITE_ROLLBACK));
            sq->base.why = why;
        }
        if (result == APC_ECONN || !sqlite3_get_autocommit(sq->db)) {
            apc_sqlite_drop(sq);
        }
    }
    return result;
}

/* ---- Operations ----------------------------------------------------------------------------- */

static int sqlite_read_newest(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_READ);
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && i < n; i++) {
        err = apc_sqlite_newest(sq, &samples[i]);
    }
    return apc_sqlite_end(sq, err);
}

static int sqlite_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int count = 0, err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    for (size_t i = 0; err >= 0 && i < n; i++) {
        err = apc_sqlite_append_one(sq, &samples[i]);
        count += err > 0;
    }
    return apc_sqlite_end(sq, err < 0 ? err : count);
}

/* The seqs of the newest become those that were written, if they were. */
static int end_put(struct apc_sqlite *sq, struct apc_sample *samples, size_t n, int err)
{
    for (size_t i = 0; err >= 0 && i < n; i++) {
        struct apc_sample next = samples[i];
        next.seq++;
        err = apc_sqlite_append_one(sq, &next);
        err = err < 0 ? err : apc_sqlite_append_loops(sq, &next);
    }
    err = apc_sqlite_end(sq, err < 0 ? err : 0);
    for (size_t i = 0; err == 0 && i < n; i++) {
        samples[i].seq++;
    }
    return err;
}

/* The lock of the transaction keeps every other writer out between reading the newest and writing the next. */
static int sqlite_put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    err = apc_sqlite_check_live(sq);
    for (size_t i = 0; !err && i < n; i++) {
        struct apc_sample newest = {.table = samples[i].table, .id = samples[i].id};
        err = apc_sqlite_newest(sq, &newest);
        samples[i].seq = newest.seq;
    }
    return end_put(sq, samples, n, err);
}

static int sqlite_swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    bool same = true;
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    err = apc_sqlite_check_live(sq);
    for (size_t i = 0; !err && i < n; i++) {
        struct apc_sample newest = {.table = samples[i].table, .id = samples[i].id};
        err = apc_sqlite_newest(sq, &newest);
        same = same && newest.seq == samples[i].seq;
    }
    for (size_t i = 0; !err && !same && i < n; i++) {
        err = apc_sqlite_newest(sq, &samples[i]);
    }
    if (!err && !same) {
        err = apc_fail(&store->why, APC_ECONFLICT, "changed by someone else meanwhile");
    }
    return end_put(sq, samples, n, err);
}

/* ---- Life ----------------------------------------------------------------------------------- */

static void sqlite_close(struct apc_store *store)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    apc_sqlite_drop(sq);
    if (sq->claims >= 0) {
        close(sq->claims);
    }
    free(sq->element);
    free(sq->claimed.at);
    free(sq);
}

static int sqlite_open(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                       struct apc_error *why)
{
    const char *path = uri + strlen(apc_sqlite_store.scheme);
    struct apc_sqlite *sq = (struct apc_sqlite *)calloc(1, sizeof *sq);
    if (!sq) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    sq->base.ops = &apc_sqlite_store;
    sq->base.config = *config;
    sq->random = ((uint64_t)apc_clock_mono(NULL) ^ (uint64_t)(uintptr_t)sq) | 1;
    sq->claims = sq->watch = -1;
    /* Absolute, so that it names the same file when the program goes to another folder. */
    size_t length = 0;
    if (path[0] != '/' && path[0] && getcwd(sq->given, sizeof sq->given)) {
        length = strlen(sq->given);
        sq->given[length++] = '/';
    }
    if (!path[0]) {
        free(sq);
        return apc_fail(why, APC_EINVAL, "%s: expected sqlite:FILE, the path of a file", uri);
    }
    if (length + strlen(path) > PATH_LEN) {
        free(sq);
        return apc_fail(why, APC_EINVAL, "sqlite:%.40s...: the file's path is too long: at most %d bytes",
                        path, PATH_LEN);
    }
    memcpy(sq->given + length, path, strlen(path) + 1);
    *store = &sq->base;
    return 0;
}

static bool sqlite_connected(const struct apc_store *store)
{
    return ((const struct apc_sqlite *)store)->db != NULL;
}

static int sqlite_connect(struct apc_store *store)
{
    return apc_sqlite_enter(apc_sqlite_of(store));
}

const struct apc_store_ops apc_sqlite_store = {
    .scheme = "sqlite:",
    .open = sqlite_open,
    .close = sqlite_close,
    .connected = sqlite_connected,
    .connect = sqlite_connect,
    .read = sqlite_read_newest,
    .append = sqlite_append,
    .claim_set = apc_sqlite_claim,
    .release = apc_sqlite_release,
    .put = sqlite_put,
    .swap = sqlite_swap,
    .read_rows = apc_sqlite_read_rows,
    .append_rows = apc_sqlite_append_rows,
    .vectors = apc_sqlite_vectors,
    .wait = apc_sqlite_wait,
    .variables = apc_sqlite_variables,
    .history = apc_sqlite_history,
    .history_bins = apc_sqlite_history_bins,
    .author = apc_sqlite_author,
    .author_name = apc_sqlite_author_name,
    .describe = apc_sqlite_describe,
    .catalogue = apc_sqlite_catalogue,
    .catalogue_at = apc_sqlite_catalogue_at,
    .keep_history = apc_sqlite_keep_history,
    .is_history = apc_sqlite_is_history,
    .ask = apc_sqlite_ask,
    .get_tags = apc_sqlite_get_tags,
    .append_events = apc_sqlite_append_events,
    .events = apc_sqlite_events,
    .append_timing = apc_sqlite_append_timing,
    .timing = apc_sqlite_timing,
    .init = apc_sqlite_init,
    .maintain = apc_sqlite_maintain,
    .restore = apc_sqlite_restore,
};
