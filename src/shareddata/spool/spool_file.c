/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The spool's file. Everything that is acknowledged is on disk: a record is written and fdatasync'd in the
 * call that appends it, which costs what the commit that it stands for would have cost. A record that could
 * not be written whole is cut off again.
 *
 * Draining moves the head. The head goes to disk before the room behind it is given back (as a hole), so
 * what is found damaged from the head on was never drained.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* fallocate, memfd_create */
#endif
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/base_internal.h"
#include "shareddata/spool/spool.h"

#define VERSION   2
#define MAGIC     0x5a7c0e1eu /* of a record */
#define OLD_MAGIC 0x5a7c0e1du /* of one in a file of version 1 */

enum { SAMPLE = 56, EVENT = 272, BATCH = 1000 };
enum { AT_VERSION = 8, AT_CRC = 12, AT_WRITER = 16, AT_STORE = 80, AT_TEXT_END = 2128, AT_HEAD = 4080 };

static const char magic[8] = {'a', 'p', 'c', 's', 'p', 'o', 'o', 'l'};

/* ---- Bytes ---------------------------------------------------------------------------------- */

static void put_bits(unsigned char *at, uint64_t value, size_t bytes)
{
    for (size_t i = 0; i < bytes; i++) {
        at[i] = (unsigned char)(value >> 8 * i);
    }
}

static uint64_t get_bits(const unsigned char *at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++) {
        value |= (uint64_t)at[i] << 8 * i;
    }
    return value;
}

/* CRC-32C: Castagnoli's polynomial, reflected (RFC 3720, B.4). */
static void make_crc(uint32_t table[256])
{
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int bit = 0; bit < 8; bit++) {
            c = c & 1 ? c >> 1 ^ 0x82f63b78u : c >> 1;
        }
        table[i] = c;
    }
}

static uint32_t crc_of(const struct apc_spool_file *file, const unsigned char *data, size_t n)
{
    uint32_t c = 0xffffffffu;
    for (size_t i = 0; i < n; i++) {
        c = c >> 8 ^ file->crc[(c ^ data[i]) & 0xff];
    }
    return ~c;
}

static int sick(const struct apc_spool_file *file, const char *what, struct apc_error *why)
{
    return apc_fail(why, APC_ESTORE, "spool %s %s: %s", file->path, what, strerror(errno));
}

/* All of it, or false. */
static bool write_at(int fd, const unsigned char *data, size_t n, uint64_t at)
{
    while (n > 0) {
        ssize_t wrote = pwrite(fd, data, n, (off_t)at);
        if (wrote < 0 && errno == EINTR) {
            continue;
        }
        if (wrote <= 0) {
            return false;
        }
        data += wrote;
        n -= (size_t)wrote;
        at += (uint64_t)wrote;
    }
    return true;
}

static bool read_spool_at(int fd, unsigned char *data, size_t n, uint64_t at)
{
    while (n > 0) {
        ssize_t got = pread(fd, data, n, (off_t)at);
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got <= 0) {
            return false;
        }
        data += got;
        n -= (size_t)got;
        at += (uint64_t)got;
    }
    return true;
}

static int reserve_spool(struct apc_spool_file *file, size_t size)
{
    if (size > file->buffer_size) {
        unsigned char *grown = realloc(file->buffer, size);
        if (!grown) {
            return APC_ENOMEM;
        }
        file->buffer = grown;
        file->buffer_size = size;
    }
    return 0;
}

/* ---- Items ---------------------------------------------------------------------------------- */

/* Tables by name: their numbers are the library's own and may change. A name has eight letters at most. */
static void put_spool_sample(unsigned char *at, const struct apc_sample *s)
{
    const char *name = apc_table_name(s->table);
    uint64_t value;
    memcpy(&value, &s->value, sizeof value);
    memset(at, 0, 8);
    for (size_t i = 0; i < 8 && name[i]; i++) {
        at[i] = (unsigned char)name[i];
    }
    put_bits(at + 8, (uint64_t)s->id, 4);
    put_bits(at + 12, s->status, 4);
    put_bits(at + 16, (uint64_t)s->seq, 8);
    put_bits(at + 24, (uint64_t)s->time, 8);
    put_bits(at + 32, value, 8);
    memset(at + 40, 0, 16); /* seqs that an output of version 1 was computed from */
}

void apc_spool_get_sample(const struct apc_spool_file *file, size_t i, struct apc_sample *s)
{
    const unsigned char *at = file->buffer + APC_SPOOL_RECORD + i * SAMPLE;
    char name[9] = "";
    uint64_t value = get_bits(at + 32, 8);
    memcpy(name, at, 8);
    *s = (struct apc_sample){.table = apc_table_parse(name),
                             .id = (int)get_bits(at + 8, 4),
                             .status = (apc_status)get_bits(at + 12, 4),
                             .seq = (int64_t)get_bits(at + 16, 8),
                             .time = (apc_ns)get_bits(at + 24, 8)};
    memcpy(&s->value, &value, sizeof s->value);
}

/* As the store will have it: whether it stands there already is asked by its texts. */
static void put_spool_event(unsigned char *at, const struct apc_event *event)
{
    const struct apc_event e = apc_event_row(event);
    put_bits(at, (uint64_t)event->time, 8);
    put_bits(at + 8, (uint64_t)e.severity, 8);
    memcpy(at + 16, e.source, sizeof e.source);
    memcpy(at + 48, e.kind, sizeof e.kind);
    memcpy(at + 80, e.text, sizeof e.text);
}

void apc_spool_get_event(const struct apc_spool_file *file, size_t i, struct apc_event *e)
{
    const unsigned char *at = file->buffer + APC_SPOOL_RECORD + i * EVENT;
    e->time = (apc_ns)get_bits(at, 8);
    e->severity = (enum apc_event_severity)get_bits(at + 8, 8);
    memcpy(e->source, at + 16, sizeof e->source);
    memcpy(e->kind, at + 48, sizeof e->kind);
    memcpy(e->text, at + 80, sizeof e->text);
}

/* ---- Records -------------------------------------------------------------------------------- */

size_t apc_spool_record_size(enum apc_spool_kind kind, size_t n)
{
    return APC_SPOOL_RECORD + n * (kind == APC_SPOOL_EVENTS ? EVENT : SAMPLE);
}

/* What the head in the buffer says of its record. */
static int read_head(const struct apc_spool_file *file, struct apc_spool_record *record)
{
    const unsigned char *h = file->buffer;
    const uint64_t magic_number = get_bits(h, 4);
    if (magic_number == OLD_MAGIC) {
        record->kind = (enum apc_spool_kind)get_bits(h + 8, 4);
        record->n = (uint32_t)get_bits(h + 12, 4);
    } else {
        record->kind = (enum apc_spool_kind)h[8];
        record->n = (uint32_t)get_bits(h + 9, 3);
    }
    bool known =
        magic_number == OLD_MAGIC || (magic_number == MAGIC && crc_of(file, h, 12) == get_bits(h + 12, 4));
    if (!known || record->kind < APC_SPOOL_SAMPLES || record->kind > APC_SPOOL_BASE || record->n < 1 ||
        record->n > APC_STORE_SAMPLES_MAX) {
        record->n = 0;
        return APC_EPROTO;
    }
    return 0;
}

int apc_spool_record_read(struct apc_spool_file *file, uint64_t at, struct apc_spool_record *record)
{
    *record = (struct apc_spool_record){.at = at};
    if (!read_spool_at(file->fd, file->buffer, APC_SPOOL_RECORD, at) || read_head(file, record) != 0) {
        return APC_EPROTO;
    }
    size_t size = apc_spool_record_size(record->kind, record->n);
    int err = reserve_spool(file, size);
    if (err) {
        return err;
    }
    const size_t from = get_bits(file->buffer, 4) == OLD_MAGIC ? 8 : APC_SPOOL_RECORD;
    if (!read_spool_at(file->fd, file->buffer + APC_SPOOL_RECORD, size - APC_SPOOL_RECORD,
                       at + APC_SPOOL_RECORD) ||
        crc_of(file, file->buffer + from, size - from) != get_bits(file->buffer + 4, 4)) {
        return APC_EPROTO;
    }
    return 0;
}

void apc_spool_count(struct apc_spool_file *file, const struct apc_spool_record *record, int sign)
{
    uint64_t n = sign < 0 ? -(uint64_t)record->n : record->n;
    if (record->kind == APC_SPOOL_SAMPLES) {
        file->stats.samples += n;
    } else if (record->kind == APC_SPOOL_EVENTS) {
        file->stats.events += n;
    }
    file->stats.bytes = file->end - file->head;
}

/* What the oldest waiting record is, which must be in the buffer. */
static apc_ns first_time(const struct apc_spool_file *file, const struct apc_spool_record *record)
{
    struct apc_sample s;
    struct apc_event e;
    if (record->kind == APC_SPOOL_EVENTS) {
        apc_spool_get_event(file, 0, &e);
        return e.time;
    }
    apc_spool_get_sample(file, 0, &s);
    return s.time;
}

/* ---- Header and head ------------------------------------------------------------------------- */

static bool write_head(const struct apc_spool_file *file, uint64_t head)
{
    unsigned char bytes[16] = {0};
    put_bits(bytes, head, 8);
    put_bits(bytes + 8, crc_of(file, bytes, 8), 4);
    return write_at(file->fd, bytes, sizeof bytes, AT_HEAD) && fdatasync(file->fd) == 0;
}

/* Nothing waits: back to the header alone. The shorter file first, or holes would lie behind the head. */
static int empty(struct apc_spool_file *file, struct apc_error *why)
{
    if (ftruncate(file->fd, APC_SPOOL_HEADER) != 0 || !write_head(file, APC_SPOOL_HEADER)) {
        return sick(file, "cannot be emptied", why);
    }
    file->head = file->end = file->floor = APC_SPOOL_HEADER;
    file->stats.samples = file->stats.events = file->stats.bytes = 0;
    file->stats.oldest = 0;
    return 0;
}

int apc_spool_write_header(struct apc_spool_file *file, struct apc_error *why)
{
    unsigned char *h = file->buffer;
    memset(h, 0, APC_SPOOL_HEADER);
    memcpy(h, magic, sizeof magic);
    put_bits(h + AT_VERSION, VERSION, 4);
    memcpy(h + AT_WRITER, file->writer, strlen(file->writer));
    memcpy(h + AT_STORE, file->store, strlen(file->store));
    put_bits(h + AT_CRC, crc_of(file, h + AT_WRITER, AT_TEXT_END - AT_WRITER), 4);
    if (!write_at(file->fd, h, APC_SPOOL_HEADER, 0)) {
        return sick(file, "cannot be written", why);
    }
    return empty(file, why);
}

/* Into the file's texts. Returns 0, APC_EINVAL: no spool of ours, APC_EPROTO: its header is damaged. */
static int read_header(struct apc_spool_file *file, uint64_t size, struct apc_error *why)
{
    unsigned char *h = file->buffer;
    memset(h, 0, APC_SPOOL_HEADER);
    size_t n = size < APC_SPOOL_HEADER ? (size_t)size : APC_SPOOL_HEADER;
    if (!read_spool_at(file->fd, h, n, 0)) {
        return sick(file, "cannot be read", why);
    }
    if (memcmp(h, magic, sizeof magic) != 0) {
        return apc_fail(why, APC_EINVAL, "%s is there, and is no spool of libapc: give another name",
                        file->path);
    }
    const uint64_t version = get_bits(h + AT_VERSION, 4);
    if (version < 1 || version > VERSION) {
        return apc_fail(
            why, APC_EINVAL,
            "spool %s is of version %u, this library knows up to %d: drain it with the libapc that "
            "wrote it, or move it away",
            file->path, (unsigned)version, VERSION);
    }
    if (crc_of(file, h + AT_WRITER, AT_TEXT_END - AT_WRITER) != get_bits(h + AT_CRC, 4)) {
        return apc_fail(why, APC_EPROTO,
                        "spool %s: its header is damaged, so nobody knows whose it is: move it away",
                        file->path);
    }
    snprintf(file->writer, sizeof file->writer, "%.63s", (const char *)h + AT_WRITER);
    snprintf(file->store, sizeof file->store, "%.2047s", (const char *)h + AT_STORE);
    /* A head that is damaged or beyond the end (cut back, but not yet said): from the first record on. */
    file->head = get_bits(h + AT_HEAD, 8);
    if (crc_of(file, h + AT_HEAD, 8) != get_bits(h + AT_HEAD + 8, 4) || file->head < APC_SPOOL_HEADER ||
        file->head > size) {
        file->head = APC_SPOOL_HEADER;
    }
    file->floor = file->head;
    file->end = size;
    return 0;
}

/* ---- Opening and closing -------------------------------------------------------------------- */

static void sync_folder(const char *path)
{
    char folder[512];
    snprintf(folder, sizeof folder, "%s", path);
    char *slash = strrchr(folder, '/');
    if (slash) {
        slash[1] = '\0';
    }
    int fd = open(slash ? folder : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0) {
        (void)fsync(fd);
        close(fd);
    }
}

static int check_owner(const struct apc_spool_file *file, const char *writer, const char *store,
                       struct apc_error *why)
{
    if (strcmp(file->writer, writer) != 0) {
        return apc_fail(why, APC_EINVAL, "spool %s is of writer %s, not of %s: give another name", file->path,
                        file->writer, writer);
    }
    if (strcmp(file->store, store) != 0) {
        return apc_fail(why, APC_EINVAL,
                        "spool %s is for the store %.120s, not for %.120s: drain it there, or move it away",
                        file->path, file->store, store);
    }
    return 0;
}

int apc_spool_descriptor(const struct apc_spool_file *file, const char *path, int flags)
{
    return file->memory ? memfd_create("apc-spool", MFD_CLOEXEC)
                        : open(path, O_RDWR | O_CREAT | O_CLOEXEC | flags, 0600);
}

static int open_locked(struct apc_spool_file *file, uint64_t *size, struct apc_error *why)
{
    struct stat st;
    file->fd = apc_spool_descriptor(file, file->path, 0);
    if (file->fd < 0) {
        return sick(file, "cannot be opened", why);
    }
    if (flock(file->fd, LOCK_EX | LOCK_NB) != 0) {
        return errno == EWOULDBLOCK
                   ? apc_fail(why, APC_EBUSY, "spool %s is in use by another process", file->path)
                   : sick(file, "cannot be locked", why);
    }
    if (fstat(file->fd, &st) != 0 || !S_ISREG(st.st_mode)) {
        return apc_fail(why, APC_EINVAL, "spool %s is no regular file", file->path);
    }
    *size = (uint64_t)st.st_size;
    return 0;
}

/* Records are going to be written as they are now: an older library must not take them for damage. */
static int raise_version(struct apc_spool_file *file, struct apc_error *why)
{
    unsigned char version[4];
    put_bits(version, VERSION, sizeof version);
    return write_at(file->fd, version, sizeof version, AT_VERSION) ? 0 : sick(file, "cannot be written", why);
}

/* A header that was never whole belongs to a writer that died while it made the file. */
static int open_header(struct apc_spool_file *file, uint64_t size, const char *writer, const char *store,
                       struct apc_error *why)
{
    int err = size > 0 ? read_header(file, size, why) : 0;
    if (err == 0 && size > APC_SPOOL_HEADER) {
        err = check_owner(file, writer, store, why);
        return err ? err : raise_version(file, why);
    }
    if (err && err != APC_EPROTO) {
        return err;
    }
    snprintf(file->writer, sizeof file->writer, "%s", writer);
    snprintf(file->store, sizeof file->store, "%s", store);
    if (size > APC_SPOOL_HEADER) { /* whose records these are nobody knows */
        file->stats.damaged++;
        return apc_spool_set_aside(file, "damaged", false, why);
    }
    err = apc_spool_write_header(file, why);
    if (!file->memory) {
        sync_folder(file->path);
    }
    return err;
}

int apc_spool_open(struct apc_spool_file *file, const char *path, const char *writer, const char *store,
                   uint64_t capacity, apc_spool_fn fn, void *ctx, struct apc_error *why)
{
    uint64_t size = 0;
    memset(file, 0, sizeof *file);
    file->fd = -1;
    file->capacity = file->stats.capacity = capacity;
    if (strlen(path) >= sizeof file->path - 64) {
        return apc_fail(why, APC_EINVAL, "the spool's path is too long");
    }
    file->memory = !*path;
    snprintf(file->path, sizeof file->path, "%s", file->memory ? "in memory" : path);
    make_crc(file->crc);
    int err = reserve_spool(file, APC_SPOOL_HEADER);
    if (err) {
        return apc_fail(why, err, "out of memory");
    }
    err = open_locked(file, &size, why);
    if (!err) {
        err = open_header(file, size, writer, store, why);
    }
    if (!err) {
        err = apc_spool_recover(file, fn, ctx, why);
    }
    if (err) {
        if (file->fd >= 0) {
            close(file->fd);
        }
        free(file->buffer);
    }
    return err;
}

int apc_spool_to_memory(struct apc_spool_file *file, const struct apc_error *why)
{
    struct apc_spool_file new = *file;
    new.fd = memfd_create("apc-spool", MFD_CLOEXEC);
    new.memory = true;
    new.capacity = new.capacity < APC_SPOOL_IN_MEMORY ? new.capacity : APC_SPOOL_IN_MEMORY;
    new.stats.capacity = new.capacity;
    snprintf(new.path, sizeof new.path, "in memory");
    snprintf(new.stats.instead, sizeof new.stats.instead, "%.*s", (int)sizeof new.stats.instead - 1,
             why->text);
    if (new.fd < 0 || apc_spool_write_header(&new, NULL) != 0) {
        if (new.fd >= 0) {
            close(new.fd);
        }
        return APC_ESTORE;
    }
    (void)unlink(file->path);
    close(file->fd);
    *file = new;
    return 0;
}

void apc_spool_close(struct apc_spool_file *file)
{
    if (apc_spool_empty(file) && !file->memory) {
        (void)unlink(file->path);
    }
    close(file->fd);
    free(file->buffer);
}

/* Count what waits, also behind what is damaged. */
static void count_spooled(struct apc_spool_file *file)
{
    struct apc_spool_record record;
    for (uint64_t at = file->head; at < file->end;
         at = record.at + apc_spool_record_size(record.kind, record.n)) {
        bool found = apc_spool_find(file, at, &record);
        if (found ? record.at != at : !apc_spool_torn(file, at)) {
            file->stats.damaged = 1;
        }
        if (!found) {
            return;
        }
        if (file->stats.oldest == 0 && record.kind != APC_SPOOL_BASE) {
            file->stats.oldest = first_time(file, &record);
        }
        apc_spool_count(file, &record, 1);
    }
}

int apc_spool_look(const char *path, struct apc_spool_info *info, struct apc_error *why)
{
    struct apc_spool_info all = {.size = 0};
    struct apc_spool_file file = {.fd = -1};
    struct stat st;
    int err = 0;
    if (!path || !info || strlen(path) >= sizeof file.path) {
        return apc_fail(why, APC_EINVAL, "which spool?");
    }
    snprintf(file.path, sizeof file.path, "%s", path);
    make_crc(file.crc);
    file.fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a FIFO would wait for a writer */
    if (file.fd < 0) {
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "spool %s cannot be opened: %s",
                        path, strerror(errno));
    }
    if (reserve_spool(&file, APC_SPOOL_HEADER) != 0) {
        err = apc_fail(why, APC_ENOMEM, "out of memory");
    }
    /* What its writer drains just now looks like damage, but not the next time. */
    for (int tries = 0; !err && tries < 3 && (tries == 0 || file.stats.damaged); tries++) {
        file.stats = (struct apc_spool_stats){0};
        if (fstat(file.fd, &st) != 0 || !S_ISREG(st.st_mode)) {
            err = apc_fail(why, APC_EINVAL, "spool %s is no regular file", path);
        } else if (st.st_size >= APC_SPOOL_HEADER) { /* else its writer has just begun it */
            err = read_header(&file, (uint64_t)st.st_size, why);
        }
        if (!err) {
            count_spooled(&file);
        }
    }
    all.stats = file.stats;
    snprintf(all.writer, sizeof all.writer, "%s", file.writer);
    snprintf(all.store, sizeof all.store, "%.*s", (int)sizeof all.store - 1, file.store);
    apc_result_copy(info, &all, sizeof all);
    free(file.buffer);
    close(file.fd);
    return err;
}

void apc_spool_left(const char *path, const char *writer, const char *store, apc_spool_fn fn, void *ctx)
{
    struct apc_spool_file file = {.fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
    struct stat st;
    int err = 0;
    if (file.fd < 0) {
        return;
    }
    snprintf(file.path, sizeof file.path, "%s", path);
    make_crc(file.crc);
    if (reserve_spool(&file, APC_SPOOL_HEADER) == 0 && fstat(file.fd, &st) == 0 && S_ISREG(st.st_mode) &&
        st.st_size > APC_SPOOL_HEADER && read_header(&file, (uint64_t)st.st_size, NULL) == 0 &&
        check_owner(&file, writer, store, NULL) == 0) {
        (void)apc_spool_go_through(&file, fn, ctx, &err);
    }
    free(file.buffer);
    close(file.fd);
}

/* ---- Appending ------------------------------------------------------------------------------ */

int apc_spool_put(struct apc_spool_file *file, enum apc_spool_kind kind, const void *items, size_t n,
                  struct apc_error *why)
{
    struct apc_spool_record record = {.at = file->end, .kind = kind, .n = (uint32_t)n};
    size_t size = apc_spool_record_size(kind, n);
    if (file->end + size - file->floor > file->capacity) {
        return apc_fail(why, APC_ESTORE, "spool %s is full (%llu bytes): new rows are lost", file->path,
                        (unsigned long long)file->capacity);
    }
    if (reserve_spool(file, size)) {
        return apc_fail(why, APC_ENOMEM, "out of memory for a spool's record of %zu", n);
    }
    for (size_t i = 0; i < n; i++) {
        if (kind == APC_SPOOL_EVENTS) {
            put_spool_event(file->buffer + APC_SPOOL_RECORD + i * EVENT, (const struct apc_event *)items + i);
        } else {
            put_spool_sample(file->buffer + APC_SPOOL_RECORD + i * SAMPLE,
                             (const struct apc_sample *)items + i);
        }
    }
    put_bits(file->buffer, MAGIC, 4);
    put_bits(file->buffer + 4, crc_of(file, file->buffer + APC_SPOOL_RECORD, size - APC_SPOOL_RECORD), 4);
    put_bits(file->buffer + 8, kind, 1);
    put_bits(file->buffer + 9, n, 3);
    put_bits(file->buffer + 12, crc_of(file, file->buffer, 12), 4);
    if (!write_at(file->fd, file->buffer, size, file->end) || fdatasync(file->fd) != 0) {
        int err = sick(file, "cannot be written: new rows are lost", why);
        (void)!ftruncate(file->fd, (off_t)file->end);
        return err;
    }
    file->end += size;
    if (file->stats.oldest == 0 && kind != APC_SPOOL_BASE) {
        file->stats.oldest = first_time(file, &record);
    }
    apc_spool_count(file, &record, 1);
    return 0;
}

/* ---- Draining ------------------------------------------------------------------------------- */

static int reserve_batch(struct apc_spool_batch *b, enum apc_spool_kind kind, size_t n)
{
    size_t capacity = n > BATCH ? n : BATCH;
    if (kind == APC_SPOOL_EVENTS && n > b->n_events) {
        struct apc_event *events = realloc(b->events, capacity * sizeof *events);
        if (!events) {
            return APC_ENOMEM;
        }
        b->events = events;
        b->n_events = capacity;
    }
    if (kind != APC_SPOOL_EVENTS && n > b->n_samples) {
        struct apc_sample *samples = realloc(b->samples, capacity * sizeof *samples);
        if (!samples) {
            return APC_ENOMEM;
        }
        b->samples = samples;
        b->n_samples = capacity;
    }
    return 0;
}

int apc_spool_peek(struct apc_spool_file *file, struct apc_spool_batch *b, struct apc_error *why)
{
    struct apc_spool_record record;
    b->n = 0;
    b->begin = b->end = file->head;
    while (b->end < file->end) {
        if (apc_spool_record_read(file, b->end, &record) != 0) {
            if (b->n > 0) {
                return 0; /* these first */
            }
            return apc_fail(why, APC_EPROTO, "spool %s is damaged at byte %llu", file->path,
                            (unsigned long long)b->end);
        }
        if (record.kind != APC_SPOOL_BASE) {
            if (b->n > 0 && (record.kind != b->kind || b->n + record.n > BATCH)) {
                return 0;
            }
            int err = reserve_batch(b, record.kind, b->n + record.n);
            if (err) {
                return apc_fail(why, err, "out of memory for a batch of the spool");
            }
            b->kind = record.kind;
            for (size_t i = 0; i < record.n; i++) {
                if (record.kind == APC_SPOOL_EVENTS) {
                    apc_spool_get_event(file, i, &b->events[b->n++]);
                } else {
                    apc_spool_get_sample(file, i, &b->samples[b->n++]);
                }
            }
        }
        b->end += apc_spool_record_size(record.kind, record.n);
    }
    return 0;
}

int apc_spool_advance(struct apc_spool_file *file, const struct apc_spool_batch *b, struct apc_error *why)
{
    struct apc_spool_record record;
    file->stats.drained += b->n;
    if (b->end == file->end) {
        return empty(file, why);
    }
    if (!write_head(file, b->end)) {
        return sick(file, "cannot be written", why);
    }
    file->head = b->end;
    if (b->kind == APC_SPOOL_EVENTS) {
        file->stats.events -= b->n;
    } else {
        file->stats.samples -= b->n;
    }
    file->stats.bytes = file->end - file->head;
    if (fallocate(file->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, APC_SPOOL_HEADER,
                  (off_t)(file->head - APC_SPOOL_HEADER)) == 0) {
        file->floor = file->head;
    }
    if (apc_spool_record_read(file, file->head, &record) == 0) {
        file->stats.oldest = first_time(file, &record);
    }
    return 0;
}
