/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What a writer left behind. Its last record may be cut short, because it was killed or the disk was full:
 * that one was never acknowledged, and goes. Anything else that is no record may be damage to what was
 * acknowledged: then the whole file is kept under another name for people to look at, and what is still
 * readable, before and behind the damage, goes on in a new one.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "shareddata/spool/spool.h"

/* A record's size is a multiple of eight. */
bool apc_spool_find(struct apc_spool_file *file, uint64_t at, struct apc_spool_record *record)
{
    while (at < file->end && apc_spool_record_read(file, at, record) != 0) {
        at += 8;
    }
    return at < file->end;
}

bool apc_spool_torn(struct apc_spool_file *file, uint64_t at)
{
    struct apc_spool_record record;
    (void)apc_spool_record_read(file, at, &record);
    return file->end - at < APC_SPOOL_RECORD ||
           (record.n > 0 && at + apc_spool_record_size(record.kind, record.n) > file->end &&
            !apc_spool_find(file, at + 8, &record));
}

static int copy_records(struct apc_spool_file *file, int to, uint64_t *end)
{
    struct apc_spool_record record;
    for (uint64_t at = file->head; apc_spool_find(file, at, &record);) {
        size_t size = apc_spool_record_size(record.kind, record.n);
        if (pwrite(to, file->buffer, size, (off_t)*end) != (ssize_t)size) {
            return APC_ESTORE;
        }
        *end += size;
        at = record.at + size;
    }
    return 0;
}

/* The new file takes the old one's name in one step, so that a crash leaves one or the other. */
int apc_spool_set_aside(struct apc_spool_file *file, const char *suffix, bool keep_records,
                        struct apc_error *why)
{
    char aside[600], fresh[600], stamp[APC_TIME_LEN];
    struct apc_spool_file new = *file;
    snprintf(aside, sizeof aside, "%s.%s-%s", file->path, suffix,
             apc_time_format(apc_clock_utc(NULL), stamp));
    snprintf(fresh, sizeof fresh, "%s.new", file->path);
    new.fd = apc_spool_descriptor(file, fresh, O_TRUNC);
    int err = new.fd < 0 || flock(new.fd, LOCK_EX | LOCK_NB) != 0 ? APC_ESTORE : 0;
    uint64_t end = APC_SPOOL_HEADER;
    if (!err) {
        err = apc_spool_write_header(&new, why); /* uses the buffer: before the records */
    }
    if (!err && keep_records) {
        err = copy_records(file, new.fd, &end);
    }
    if (!err && file->memory) {
        snprintf(aside, sizeof aside, "nothing: it was in memory");
    } else if (!err &&
               (fsync(new.fd) != 0 || link(file->path, aside) != 0 || rename(fresh, file->path) != 0)) {
        err = APC_ESTORE;
    }
    new.buffer = file->buffer;
    new.buffer_size = file->buffer_size;
    if (err) {
        (void)apc_fail(why, err, "spool %s is damaged, and %s cannot be made: %s", file->path, aside,
                       strerror(errno));
        if (new.fd >= 0) {
            close(new.fd);
        }
        return err;
    }
    close(file->fd);
    *file = new;
    file->head = file->floor = APC_SPOOL_HEADER;
    file->end = end;
    snprintf(file->stats.aside, sizeof file->stats.aside, "%.*s", (int)sizeof file->stats.aside - 1, aside);
    return 0;
}

uint64_t apc_spool_go_through(struct apc_spool_file *file, apc_spool_fn fn, void *ctx, int *err)
{
    struct apc_spool_record record;
    uint64_t at = file->head;
    file->stats.samples = file->stats.events = 0;
    file->stats.oldest = 0;
    while (at < file->end && apc_spool_record_read(file, at, &record) == 0) {
        for (size_t i = 0; i < record.n && *err == 0; i++) {
            struct apc_sample s;
            struct apc_event e;
            if (record.kind == APC_SPOOL_EVENTS) {
                apc_spool_get_event(file, i, &e);
                s.time = e.time;
            } else {
                apc_spool_get_sample(file, i, &s);
                *err = fn(ctx, record.kind, &s);
            }
            if (file->stats.oldest == 0 && record.kind != APC_SPOOL_BASE) {
                file->stats.oldest = s.time;
            }
        }
        apc_spool_count(file, &record, 1);
        at += apc_spool_record_size(record.kind, record.n);
    }
    return at;
}

int apc_spool_recover(struct apc_spool_file *file, apc_spool_fn fn, void *ctx, struct apc_error *why)
{
    int err = 0;
    uint64_t good = apc_spool_go_through(file, fn, ctx, &err);
    if (!err && good < file->end && !apc_spool_torn(file, good)) {
        file->stats.damaged++;
        err = apc_spool_set_aside(file, "damaged", true, why);
        if (!err) {
            good = apc_spool_go_through(file, fn, ctx, &err);
        }
    }
    if (!err && good < file->end) {
        file->stats.torn += file->end - good;
        file->end = good;
        if (ftruncate(file->fd, (off_t)good) != 0 || fdatasync(file->fd) != 0) {
            err = apc_fail(why, APC_ESTORE, "spool %s: its torn end cannot be cut off: %s", file->path,
                           strerror(errno));
        }
    }
    file->stats.bytes = file->end - file->head;
    return err == APC_EPROTO || err == APC_ENOMEM
               ? apc_fail(why, err, "spool %s cannot be taken over: %s", file->path, apc_err_text(err))
               : err;
}
