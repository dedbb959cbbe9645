/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Store and forward, shared by its files: spool_file.c (the file: what is on disk), spool_recover.c (what an
 * earlier writer left in it), spool_identity.c (whose it is), spool.c (the store that wraps another one).
 *
 * The file: a header of 4096 bytes, then records, one for each append. Numbers have the lowest byte first.
 *
 *   header   0 "apcspool"  8 version  12 CRC-32C of 16 to 2128  16 writer[64]  80 store[2048]
 *            4080 head  4088 CRC-32C of the head
 *   record   0 magic  4 CRC-32C of the items  8 kind (1 byte)  9 count (3 bytes)
 *            12 CRC-32C of what stands before it  16 items
 *
 * So a head that is whole but for its record's end was cut short by a crash, and any other is damage. Records
 * of version 1 (their own magic  4 CRC-32C of all that follows  8 kind  12 count  16 items) are still read.
 *
 * The head is where the first record lies that is still to be drained; what is before it is a hole. A record
 * is on disk before it is acknowledged; the head is on disk before the hole is made; the file is cut back to
 * its header when nothing is left.
 */
#ifndef APC_SPOOL_H
#define APC_SPOOL_H

#include "shareddata/shareddata_internal.h"

enum { APC_SPOOL_HEADER = 4096, APC_SPOOL_RECORD = 16 }; /* bytes */
#define APC_SPOOL_IN_MEMORY ((uint64_t)16 << 20)         /* instead of a file */

enum apc_spool_kind {
    APC_SPOOL_SAMPLES = 1,
    APC_SPOOL_EVENTS,
    APC_SPOOL_BASE /* samples that were in the store already: from which seq a writer counts on */
};

struct apc_spool_file {
    int fd;
    bool memory; /* no file: it ends with the process */
    char path[512], writer[64], store[2048];
    uint64_t capacity; /* bytes of waiting records */
    uint64_t floor;    /* from here on the file takes room on the disk */
    uint64_t head, end;
    struct apc_spool_stats stats;
    uint32_t crc[256];
    unsigned char *buffer; /* one record; only grows */
    size_t buffer_size;
};

/** Records of one kind from the head on, as many as make a batch. Memory is kept and only grows. */
struct apc_spool_batch {
    enum apc_spool_kind kind;
    uint64_t begin, end;           /* in the file */
    size_t n, n_samples, n_events; /* used; there is room for */
    struct apc_sample *samples;    /* one of these two */
    struct apc_event *events;
};

/** Told of every sample (also of kind BASE) that waits in a file when it is opened, in order. */
typedef int (*apc_spool_fn)(void *ctx, enum apc_spool_kind kind, const struct apc_sample *sample);

/* ---- spool_file.c -------------------------------------------------------------------------- */

/** Open or make the file ("": in memory), lock it, recover what is in it. APC_EBUSY: another process has it.
 * APC_EINVAL: it is not a spool, or another writer's, or for another store. On failure *file needs no close.
 */
int apc_spool_open(struct apc_spool_file *file, const char *path, const char *writer, const char *store,
                   uint64_t capacity, apc_spool_fn fn, void *ctx, struct apc_error *why);
/** Tell of what waits in a file that apc_spool_open() refused, as far as it can be read; it stays as it is. */
void apc_spool_left(const char *path, const char *writer, const char *store, apc_spool_fn fn, void *ctx);
/** Go on in memory: nothing waits in the file, and the disk will not have it, which @p why says. [tick]
 * Returns 0 or APC_ESTORE. */
int apc_spool_to_memory(struct apc_spool_file *file, const struct apc_error *why);
/** Removes the file when nothing waits in it. */
void apc_spool_close(struct apc_spool_file *file);
/** Append one record; it is on disk on return. APC_ESTORE: full, or the disk would not take it; then the
 * file is as it was. [tick] */
int apc_spool_put(struct apc_spool_file *file, enum apc_spool_kind kind, const void *items, size_t n,
                  struct apc_error *why);
/** The next batch, n = 0 when nothing waits. [tick] Returns 0, or APC_ESTORE: unreadable or damaged. */
int apc_spool_peek(struct apc_spool_file *file, struct apc_spool_batch *batch, struct apc_error *why);
/** The batch has been drained. [tick] */
int apc_spool_advance(struct apc_spool_file *file, const struct apc_spool_batch *batch,
                      struct apc_error *why);
static inline bool apc_spool_empty(const struct apc_spool_file *file)
{
    return file->end == APC_SPOOL_HEADER;
}

/** A header and a head into an empty file, on disk on return. */
int apc_spool_write_header(struct apc_spool_file *file, struct apc_error *why);
/** The descriptor of file @p path, made if need be, or of memory. -1 with errno. */
int apc_spool_descriptor(const struct apc_spool_file *file, const char *path, int flags);

/** A record's place and kind. */
struct apc_spool_record {
    uint64_t at;
    enum apc_spool_kind kind;
    uint32_t n;
};
size_t apc_spool_record_size(enum apc_spool_kind kind, size_t n);
/** Read the record at @p at into file->buffer and check it. Returns 0, or APC_EPROTO: there is none; n is
 * then how many items it would have, 0 when not even its beginning is one. */
int apc_spool_record_read(struct apc_spool_file *file, uint64_t at, struct apc_spool_record *record);
/** Item @p i of the record in file->buffer. */
void apc_spool_get_sample(const struct apc_spool_file *file, size_t i, struct apc_sample *s);
void apc_spool_get_event(const struct apc_spool_file *file, size_t i, struct apc_event *e);
/** Count a waiting record in (+1) or out (-1) of the figures. */
void apc_spool_count(struct apc_spool_file *file, const struct apc_spool_record *record, int sign);

/* ---- spool_recover.c ----------------------------------------------------------------------- */

/** Keep the file as it is as PATH.@p suffix-TIME, and go on with a new one, which gets the records that are
 * whole, or none. The name is in @p why, also on success. */
int apc_spool_set_aside(struct apc_spool_file *file, const char *suffix, bool keep_records,
                        struct apc_error *why);
/** The next whole record from @p at on; false when there is none. */
bool apc_spool_find(struct apc_spool_file *file, uint64_t at, struct apc_spool_record *record);
/** Is what lies at @p at, and is no record, the last one, cut short? */
bool apc_spool_torn(struct apc_spool_file *file, uint64_t at);
/** Tell of the records from the head on. Returns where the first one is that is none. */
uint64_t apc_spool_go_through(struct apc_spool_file *file, apc_spool_fn fn, void *ctx, int *err);
/** Go through the records from the head on: cut off a torn tail, set a damaged file aside. */
int apc_spool_recover(struct apc_spool_file *file, apc_spool_fn fn, void *ctx, struct apc_error *why);

/* ---- spool_identity.c ---------------------------------------------------------------------- */

/** Which store a URI means, without secrets; for postgresql: also what the environment says. */
void apc_spool_identity(const char *uri, char *text, size_t size);

/* ---- spool.c ------------------------------------------------------------------------------- */

/** How long to leave a store alone that was away @p away times in a row and made the last call wait so long:
 * as long as that, then twice, then four times. A short stall is not made longer, and one that lasts holds
 * the caller up for a fifth of its time. */
apc_ns apc_spool_pause(apc_ns waited, unsigned away, const struct apc_store_config *config);
/** A store that spools what @p inner cannot take. @p inner becomes its own, also on failure. */
int apc_spool_wrap(struct apc_store **store, struct apc_store *inner, const char *uri, const char *path,
                   uint64_t capacity, struct apc_error *why);

#endif
