/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A log that never makes its caller wait for a terminal, a pipe or a disk.
 *
 * Writers copy their message into a slot of a ring under a mutex that is held for that copy only; a
 * thread of its own formats and writes lines. The mutex inherits priority, so that a SCHED_FIFO task
 * cannot be held up behind the log's thread by something in between. A full ring drops the new message
 * and counts it; the count comes out as a line of its own when there is room again.
 *
 * The thread writes only when poll() says that it will not have to wait, so that a reader who has stopped
 * reading cannot keep it: closing the log gives up when it takes nothing for GRACE_MS.
 */
#include "apcbase.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/text.h"

#define SLOTS    256
#define MESSAGE  400
#define NAME_LEN 80
#define GRACE_MS 500
#define LOOK_MS  50 /* between two looks whether the log is being closed */

struct message {
    apc_ns utc;
    enum apc_log_level level;
    char text[MESSAGE];
};

struct apc_log {
    int fd;
    enum apc_log_level level;
    char name[NAME_LEN];
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t filled;
    bool closing;
    bool stuck; /* the writer's: it is closing, and the reader takes nothing */
    size_t first, count;
    unsigned long dropped;
    struct message ring[SLOTS];
};

static const char *const level_names[] = {
    [APC_LOG_ERROR] = "error", [APC_LOG_WARN] = "warn", [APC_LOG_INFO] = "info", [APC_LOG_DEBUG] = "debug"};

enum apc_log_level apc_log_level_parse(const char *name)
{
    for (int level = APC_LOG_ERROR; name && level <= APC_LOG_DEBUG; level++)
        if (!strcmp(level_names[level], name))
            return (enum apc_log_level)level;
    return (enum apc_log_level)0;
}

static bool closing(struct apc_log *log)
{
    pthread_mutex_lock(&log->mutex);
    bool is = log->closing;
    pthread_mutex_unlock(&log->mutex);
    return is;
}

static bool wait_for_room(struct apc_log *log)
{
    struct pollfd p = {.fd = log->fd, .events = POLLOUT};
    for (int looks = 0; !log->stuck && poll(&p, 1, LOOK_MS) <= 0;)
        log->stuck = closing(log) && ++looks > GRACE_MS / LOOK_MS;
    return !log->stuck;
}

static void write_log_text(struct apc_log *log, const char *text, size_t length)
{
    while (length > 0 && wait_for_room(log)) {
        ssize_t n = write(log->fd, text, length);
        if (n < 0 && (errno == EINTR || errno == EAGAIN))
            continue;
        if (n <= 0)
            return; /* nowhere left to complain to */
        text += n;
        length -= (size_t)n;
    }
}

/* In quotes, those in it and backslashes escaped. */
static char *quote(char *to, const char *text)
{
    char instead;

    *to++ = '"';
    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        if (*text == '"' || *text == '\\')
            *to++ = '\\';
        if (instead)
            *to++ = instead;
        else
            to = mempcpy(to, text, n);
    }
    *to++ = '"';
    return to;
}

/* time=... level=... name=... msg="..."; a name of several words, as "apc-controller base", is quoted too. */
static void write_line(struct apc_log *log, const struct message *m)
{
    char time[APC_TIME_LEN], line[2 * (MESSAGE + NAME_LEN) + 80], *at = line;
    at += snprintf(line, sizeof line, "time=%s level=%s name=", apc_time_format(m->utc, time),
                   level_names[m->level]);
    at = strpbrk(log->name, " \"\\") ? quote(at, log->name) : stpcpy(at, log->name);
    at = quote(stpcpy(at, " msg="), m->text);
    *at++ = '\n';
    write_log_text(log, line, (size_t)(at - line));
}

static void *writer(void *arg)
{
    struct apc_log *log = arg;
    struct message m = {0};
    pthread_mutex_lock(&log->mutex);
    for (;;) {
        while (log->count == 0 && !log->closing)
            pthread_cond_wait(&log->filled, &log->mutex);
        if (log->count == 0)
            break;
        m = log->ring[log->first];
        log->first = (log->first + 1) % SLOTS;
        log->count--;
        unsigned long dropped = log->dropped;
        log->dropped = 0;
        pthread_mutex_unlock(&log->mutex);
        write_line(log, &m);
        if (dropped > 0) {
            m.level = APC_LOG_WARN;
            snprintf(m.text, sizeof m.text, "%lu messages were dropped: the log's reader is too slow",
                     dropped);
            write_line(log, &m);
        }
        pthread_mutex_lock(&log->mutex);
    }
    pthread_mutex_unlock(&log->mutex);
    return NULL;
}

/* Handlers of signals belong on the application's own threads. */
static int start_writer(struct apc_log *log)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int err = pthread_create(&log->thread, NULL, writer, log);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return err;
}

int apc_log_create(struct apc_log **out, int fd, const char *name, enum apc_log_level level)
{
    if (!out)
        return APC_EINVAL;
    *out = NULL;
    if (fd < 0 || !name || level < APC_LOG_ERROR || level > APC_LOG_DEBUG)
        return APC_EINVAL;
    struct apc_log *log = calloc(1, sizeof *log);
    if (!log)
        return APC_ENOMEM;
    log->fd = fd;
    log->level = level;
    snprintf(log->name, sizeof log->name, "%s", name);
    if (apc_mutex_init(&log->mutex) < 0)
        goto out_free;
    if (pthread_cond_init(&log->filled, NULL))
        goto out_mutex;
    if (start_writer(log))
        goto out_cond;
    *out = log;
    return 0;
out_cond:
    pthread_cond_destroy(&log->filled);
out_mutex:
    pthread_mutex_destroy(&log->mutex);
out_free:
    free(log);
    return APC_ESYS;
}

void apc_log_destroy(struct apc_log *log)
{
    if (!log)
        return;
    pthread_mutex_lock(&log->mutex);
    log->closing = true;
    pthread_cond_signal(&log->filled);
    pthread_mutex_unlock(&log->mutex);
    pthread_join(log->thread, NULL);
    pthread_cond_destroy(&log->filled);
    pthread_mutex_destroy(&log->mutex);
    free(log);
}

void apc_log_write(struct apc_log *log, enum apc_log_level level, const char *fmt, ...)
{
    if (!log || level > log->level)
        return;
    struct message m = {.utc = apc_clock_utc(NULL), .level = level};
    va_list args;
    va_start(args, fmt);
    vsnprintf(m.text, sizeof m.text, fmt, args);
    va_end(args);

    pthread_mutex_lock(&log->mutex);
    if (log->count == SLOTS) {
        log->dropped++;
    } else {
        log->ring[(log->first + log->count++) % SLOTS] = m;
        pthread_cond_signal(&log->filled);
    }
    pthread_mutex_unlock(&log->mutex);
}
