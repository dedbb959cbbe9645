/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: claims, and waiting for a change.
 *
 * A claimant is a record of the file FILE-claims, a locked byte and a name; table claim says which variables
 * are whose. The lock belongs to the open file (F_OFD_SETLK): it ends when the store is closed and when the
 * process ends, however it ends, and it holds between two stores of one process as well. (It is not in the
 * database file itself: to close any descriptor of that one would take away SQLite's own locks.) What a
 * claimant left who is gone is nobody's, and is cleared by whoever gets its number.
 *
 * Waiting: a commit writes to the database file, which inotify tells. The watch is set before the look, so a
 * change is either seen by the look or ends the wait. What inotify does not tell (its limits are used up, the
 * file lives on another host) a look now and then finds.
 */
#include "shareddata/sqlite/sqlite.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#define SLOT      APC_SQLITE_HOLDER /* the record's number times it is where */
#define CLAIMANTS 256
#define LOOK      APC_NS_PER_S         /* between two looks of a waiter whom inotify tells */
#define LOOK_OFT  (20 * APC_NS_PER_MS) /* and of one whom it does not */

/* ---- Claims --------------------------------------------------------------------------------- */

static int fail_claims(struct apc_sqlite *sq, int error)
{
    return apc_fail(&sq->base.why, error == EACCES || error == EROFS ? APC_EPERM : APC_ESYS,
                    "%s-claims, which says who writes what: %s", sq->given, strerror(error));
}

static int open_claims(struct apc_sqlite *sq)
{
    char path[PATH_MAX + 8];
    struct stat database, st;
    if (sq->claims >= 0) {
        return 0;
    }
    snprintf(path, sizeof path, "%s-claims", sq->path);
    mode_t mode = stat(sq->path, &database) == 0 ? database.st_mode & 0666 : 0600;
    sq->claims = open(path, O_RDWR | O_CREAT | O_CLOEXEC, mode);
    if (sq->claims < 0) {
        return fail_claims(sq, errno);
    }
    if (fstat(sq->claims, &st) == 0 && st.st_size == 0) {
        (void)fchmod(sq->claims, mode); /* who may write the database may claim, whatever the umask was */
    }
    return 0;
}

static void drop_claims(struct apc_sqlite *sq)
{
    if (sq->claims >= 0) {
        close(sq->claims);
    }
    sq->claims = -1;
    sq->record = 0;
}

static struct flock sqlite_lock_byte_of(uint32_t record)
{
    return (struct flock){
        .l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = (off_t)record * SLOT, .l_len = 1};
}

/* Is the record another one's who lives? */
static bool is_sqlite_claimant_alive(const struct apc_sqlite *sq, uint32_t record)
{
    struct flock lock = sqlite_lock_byte_of(record);
    return record != sq->record && fcntl(sq->claims, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

/* Who holds it, in text. */
static void name_holder(const struct apc_sqlite *sq, uint32_t record, char text[SLOT])
{
    ssize_t n = pread(sq->claims, text, SLOT - 1, (off_t)record * SLOT);
    text[n > 0 ? n : 0] = '\0';
    if (!text[0]) {
        snprintf(text, SLOT, "a writer that has just come");
    }
}

int apc_sqlite_holder(struct apc_sqlite *sq, char text[SLOT])
{
    int err = open_claims(sq);
    for (uint32_t record = 1; !err && record <= CLAIMANTS; record++) {
        if (is_sqlite_claimant_alive(sq, record)) {
            name_holder(sq, record, text);
            return 1;
        }
    }
    return err;
}

/* A record of this handle's own. */
static int take_claim_record(struct apc_sqlite *sq)
{
    char text[SLOT] = {0};
    int err = open_claims(sq);
    if (err || sq->record != 0) {
        return err;
    }
    for (uint32_t record = 1; record <= CLAIMANTS; record++) {
        struct flock lock = sqlite_lock_byte_of(record);
        if (fcntl(sq->claims, F_OFD_SETLK, &lock) == 0) {
            snprintf(text, sizeof text, "%s (process %ld)", sq->base.config.name, (long)getpid());
            /* The lock is what counts; without the name the refusal is only less telling. */
            (void)!pwrite(sq->claims, text, sizeof text, (off_t)record * SLOT);
            sq->record = record;
            sq->fresh = true;
            return 0;
        }
        if (errno != EAGAIN && errno != EACCES) {
            return fail_claims(sq, errno);
        }
    }
    return apc_fail(&sq->base.why, APC_ESTORE, "%s has %d writers, and no room for more", sq->given,
                    CLAIMANTS);
}

/* Of one number, or of two; out is NULL where no row comes back. */
static int run_claim(struct apc_sqlite *sq, const char *sql, int64_t first, int64_t second, int64_t *out)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(sq, sql, &statement);
    if (!found) {
        sqlite3_bind_int64(statement, 1, first);
        if (sqlite3_bind_parameter_count(statement) > 1) {
            sqlite3_bind_int64(statement, 2, second);
        }
        found = apc_sqlite_step(sq, statement);
    }
    if (found > 0 && out) {
        *out = sqlite3_column_int64(statement, 0);
    }
    sqlite3_finalize(statement);
    return found;
}

/* The variable becomes ours, and its seq the newest. */
static int claim_variable(struct apc_sqlite *sq, struct apc_sample *v)
{
    const int64_t variable = apc_sqlite_variable(v->table, v->id);
    int64_t owner = 0;
    char text[SLOT];
    int err = run_claim(sq, "SELECT record FROM claim WHERE variable = ?1", variable, 0, &owner);
    if (err < 0) {
        return err;
    }
    if (err > 0 && is_sqlite_claimant_alive(sq, (uint32_t)owner)) {
        name_holder(sq, (uint32_t)owner, text);
        return apc_fail(&sq->base.why, APC_EBUSY, "%s %d of %s is already written by %s: stop it first",
                        apc_table_name(v->table), v->id, sq->given, text);
    }
    err = run_claim(sq, "REPLACE INTO claim VALUES (?1, ?2)", variable, sq->record, NULL);
    if (!err) {
        struct apc_sample newest = {.table = v->table, .id = v->id};
        err = apc_sqlite_newest(sq, &newest);
        v->seq = newest.seq;
    }
    return err;
}

/* All or none, in a transaction: what a former claimant of our number left is not ours. */
static int claim_variables(struct apc_sqlite *sq, struct apc_sample *variables, size_t n)
{
    int err = take_claim_record(sq);
    if (!err) {
        err = apc_sqlite_begin(sq, APC_SQLITE_WRITE);
    }
    if (err) {
        return err;
    }
    if (sq->fresh) {
        err = run_claim(sq, "DELETE FROM claim WHERE record = ?1", sq->record, 0, NULL);
    }
    for (size_t i = 0; !err && i < n; i++) {
        err = claim_variable(sq, &variables[i]);
    }
    err = apc_sqlite_end(sq, err);
    sq->fresh = sq->fresh && err;
    return err;
}

/* The lock file that is open may have been removed: then others would not see our locks. */
static bool claims_stand(const struct apc_sqlite *sq)
{
    char path[PATH_MAX + 8];
    struct stat ours, theirs;
    snprintf(path, sizeof path, "%s-claims", sq->path);
    return stat(path, &theirs) == 0 && fstat(sq->claims, &ours) == 0 && ours.st_dev == theirs.st_dev &&
           ours.st_ino == theirs.st_ino;
}

int apc_sqlite_renew_claims(struct apc_sqlite *sq)
{
    int err = 0;
    const bool stand = sq->claims < 0 ? sq->claimed.n == 0 : claims_stand(sq);
    if (stand && !sq->reopened) {
        return 0;
    }
    if (!stand) {
        drop_claims(sq);
    }
    if (sq->claimed.n > 0) {
        err = claim_variables(sq, sq->claimed.at, sq->claimed.n);
    }
    if (err) { /* all or none: the next operation tries again */
        drop_claims(sq);
    }
    sq->reopened = err != 0;
    return err;
}

int apc_sqlite_claim(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter(sq);
    if (!err) {
        err = apc_claims_reserve(store, &sq->claimed, n);
    }
    if (!err) {
        err = claim_variables(sq, variables, n);
    }
    if (!err) {
        apc_claims_add(&sq->claimed, variables, n);
    }
    return err;
}

int apc_sqlite_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && i < n; i++) {
        err = run_claim(sq, "DELETE FROM claim WHERE variable = ?1 AND record = ?2",
                        apc_sqlite_variable(variables[i].table, variables[i].id), sq->record, NULL);
    }
    err = apc_sqlite_end(sq, err);
    if (!err) {
        apc_claims_drop(&sq->claimed, variables, n);
    }
    return err;
}

/* ---- Waiting -------------------------------------------------------------------------------- */

static void set_watch(struct apc_sqlite *sq)
{
    char events[4096];
    if (sq->watch >= 0) {
        while (read(sq->watch, events, sizeof events) > 0) {
            /* what is told up to here, the look will see */
        }
        return;
    }
    sq->watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    if (sq->watch >= 0 &&
        inotify_add_watch(sq->watch, sq->path, IN_MODIFY | IN_ATTRIB | IN_MOVE_SELF | IN_DELETE_SELF) < 0) {
        close(sq->watch);
        sq->watch = -1;
    }
}

/* 1 when one of them is newer than seen. */
static int look_for_newer(struct apc_sqlite *sq, const struct apc_sample *seen, size_t n)
{
    bool newer = false;
    int err = apc_sqlite_begin(sq, APC_SQLITE_READ);
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && !newer && i < n; i++) {
        struct apc_sample s = {.table = seen[i].table, .id = seen[i].id};
        err = apc_sqlite_newest(sq, &s);
        newer = s.seq > seen[i].seq;
    }
    return apc_sqlite_end(sq, err ? err : newer);
}

static void await_change(const struct apc_sqlite *sq, apc_ns left)
{
    const apc_ns most = sq->watch >= 0 ? LOOK : LOOK_OFT;
    struct pollfd fd = {.fd = sq->watch, .events = POLLIN}; /* -1 is passed over */
    left = left < most ? left : most;
    ppoll(&fd, 1, &(struct timespec){.tv_sec = left / APC_NS_PER_S, .tv_nsec = left % APC_NS_PER_S}, NULL);
}

int apc_sqlite_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    const apc_ns now = apc_clock_mono(NULL), end = timeout > INT64_MAX - now ? INT64_MAX : now + timeout;
    for (;;) {
        int found = apc_sqlite_enter(sq);
        if (found == 0) {
            set_watch(sq);
            found = look_for_newer(sq, seen, n);
        }
        apc_ns left = end - apc_clock_mono(NULL);
        if (found != 0 || left <= 0) {
            return found;
        }
        await_change(sq, left);
    }
}
