/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: one writer a table, and waiting for a change.
 *
 * A claim is a lock on one byte of the file FILE-claims, one byte a table. The lock belongs to the open file
 * (F_OFD_SETLK): it ends when the store is closed and when the process ends, however it ends, and it holds
 * between two stores of one process as well. (It is not in the database file itself: to close any descriptor
 * of that one would take away SQLite's own locks.) Beside the byte stands who holds it, for the refusal.
 *
 * Waiting: a commit writes to the database file, which inotify tells. The watch is set before the look, so a
 * change is either seen by the look or ends the wait. What inotify does not tell (its limits are used up, the
 * file lives on another host) a look now and then finds.
 */
#include "shareddata/sqlite.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#define SLOT     128                  /* bytes for a holder's name; the table's number times it is where */
#define LOOK     APC_NS_PER_S         /* between two looks of a waiter whom inotify tells */
#define LOOK_OFT (20 * APC_NS_PER_MS) /* and of one whom it does not */

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
}

/* Who holds the table, in text. */
static void name_holder(const struct apc_sqlite *sq, enum apc_table table, char text[SLOT])
{
    ssize_t n = pread(sq->claims, text, SLOT - 1, (off_t)table * SLOT);
    text[n > 0 ? n : 0] = '\0';
    if (!text[0]) {
        snprintf(text, SLOT, "a writer that has just come");
    }
}

static int lock_table(struct apc_sqlite *sq, enum apc_table table)
{
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = (off_t)table * SLOT, .l_len = 1};
    char text[SLOT];
    int err = open_claims(sq);
    if (err) {
        return err;
    }
    if (fcntl(sq->claims, F_OFD_SETLK, &lock) == 0) {
        memset(text, 0, sizeof text);
        snprintf(text, sizeof text, "%s (process %ld)", sq->base.config.name, (long)getpid());
        /* The lock is what counts; without the name the refusal is only less telling. */
        (void)!pwrite(sq->claims, text, sizeof text, (off_t)table * SLOT);
        return 0;
    }
    if (errno != EAGAIN && errno != EACCES) {
        return fail_claims(sq, errno);
    }
    name_holder(sq, table, text);
    return apc_fail(&sq->base.why, APC_EBUSY, "table %s of %s is already written by %s: stop it first",
                    apc_table_name(table), sq->given, text);
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
    if (sq->claims >= 0 && claims_stand(sq)) {
        return 0;
    }
    drop_claims(sq);
    for (enum apc_table table = APC_SENSOR; !err && table < APC_TABLE_END; table++) {
        if (sq->claimed[table]) {
            err = lock_table(sq, table);
        }
    }
    if (err) { /* all or none: the next operation tries again */
        drop_claims(sq);
    }
    return err;
}

int apc_sqlite_claim(struct apc_store *store, enum apc_table table, size_t n, int64_t *last)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter(sq);
    if (!err) {
        err = lock_table(sq, table);
    }
    if (err) {
        return err;
    }
    sq->claimed[table] = true;
    err =
        apc_sqlite_begin(sq, APC_SQLITE_READ); /* after the lock: what the former writer committed is seen */
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && i < n; i++) {
        struct apc_sample s = {.table = table, .id = (int)i + 1};
        err = apc_sqlite_newest(sq, &s);
        last[i] = s.seq;
    }
    return apc_sqlite_end(sq, err);
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
static int look(struct apc_sqlite *sq, const struct apc_sample *seen, size_t n)
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
            found = look(sq, seen, n);
        }
        apc_ns left = end - apc_clock_mono(NULL);
        if (found != 0 || left <= 0) {
            return found;
        }
        await_change(sq, left);
    }
}
