/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The segment: made, checked, mapped. It is made without a name and gets it when it is complete, so there is
 * no half-made one, whoever is killed when; of two that make one, the second finds the name taken and uses
 * the first's. All of its memory is there from the beginning (posix_fallocate): a full /dev/shm refuses to
 * make it and kills nobody later. What does not look like ours is never written.
 *
 * Whoever removes /dev/shm/apc.NAME makes another one possible. A handle looks every 100 ms whether the name
 * still leads to what it has mapped: for the price of a clock reading per operation, and not of a system
 * call.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "shareddata/shm/shm.h"

#define DIRECTORY      "/dev/shm" /* where shm_open() keeps them as well */
#define LAYOUT         15
#define CHECK_INTERVAL (100 * APC_NS_PER_MS)

static const char magic[16] = "libapc shm\r\n\x1a\n";

/* An emulator runs programs of another processor beside this one's: glibc's mutex has another size there. */
#if defined(__x86_64__)
static const char machine[16] = "x86-64";
#elif defined(__aarch64__) && !defined(__AARCH64EB__)
static const char machine[16] = "arm64";
#else
static const char machine[16] = "others";
#endif

#define EVENT_WORDS  (sizeof(struct apc_event) / 8 + 2)
#define TIMING_WORDS (sizeof(struct apc_shm_timing) / 8 + 2)

_Static_assert(sizeof(struct apc_event) % 8 == 0 && sizeof(struct apc_tag) % 8 == 0, "copied by words");
_Static_assert(sizeof(struct apc_shm_slot) == 192 && sizeof(struct apc_shm_cell) == 64, "cache lines");
_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2 && ATOMIC_INT_LOCK_FREE == 2, "shared by processes");

/* What has the size that it was made with is made anew, larger. */
int apc_shm_too_small(struct apc_shm *shm, const char *format, ...)
{
    char lacks[128];
    va_list args;
    va_start(args, format);
    vsnprintf(lacks, sizeof lacks, format, args);
    va_end(args);
    return apc_fail(&shm->base.why, APC_ESTORE,
                    "shm:%s %s: stop its programs, remove " DIRECTORY "/apc.%s, and use shm:%s?size=%llu",
                    shm->name, lacks, shm->name, shm->name, 2 * (unsigned long long)shm->mib);
}

/* ---- Layout -------------------------------------------------------------------------------- */

static size_t take_segment_bytes(size_t *at, size_t bytes)
{
    size_t begin = *at;
    *at = (begin + bytes + 63) & ~(size_t)63;
    return begin;
}

void apc_shm_lay_out(struct apc_shm *shm, uint64_t mib, char *base)
{
    size_t at = 0;
    shm->size = (size_t)mib << 20;
    shm->variables = (size_t)mib * 1600;
    shm->tags = (size_t)mib * 64;
    shm->text_size = (size_t)mib << 14;
    shm->index_size = 4096;
    while (shm->index_size < 2 * shm->variables) {
        shm->index_size *= 2;
    }
    shm->log[APC_SHM_EVENTS] = (struct apc_shm_log){.words = EVENT_WORDS, .capacity = (size_t)mib * 32};
    shm->log[APC_SHM_ACTIONS] = (struct apc_shm_log){.words = EVENT_WORDS, .capacity = (size_t)mib * 32};
    shm->log[APC_SHM_ACCESS] = (struct apc_shm_log){.words = EVENT_WORDS, .capacity = (size_t)mib * 8};
    shm->log[APC_SHM_CHATTER] = (struct apc_shm_log){.words = EVENT_WORDS, .capacity = (size_t)mib * 16};
    shm->log[APC_SHM_ALARMS] = (struct apc_shm_log){.words = EVENT_WORDS, .capacity = (size_t)mib * 16};
    shm->log[APC_SHM_TIMING] = (struct apc_shm_log){.words = TIMING_WORDS, .capacity = (size_t)mib * 16};
    take_segment_bytes(&at, sizeof(struct apc_shm_header));
    const size_t index = take_segment_bytes(&at, shm->index_size * sizeof *shm->index);
    const size_t slot = take_segment_bytes(&at, shm->variables * sizeof *shm->slot);
    const size_t tag[2] = {take_segment_bytes(&at, shm->tags * sizeof(struct apc_tag)),
                           take_segment_bytes(&at, shm->tags * sizeof(struct apc_tag))};
    const size_t text[2] = {take_segment_bytes(&at, shm->text_size), take_segment_bytes(&at, shm->text_size)};
    for (size_t i = 0; i < APC_SHM_LOGS; i++) {
        const size_t records = take_segment_bytes(&at, shm->log[i].capacity * shm->log[i].words * 8);
        shm->log[i].record = base ? (apc_word *)(void *)(base + records) : NULL;
    }
    shm->cells = (shm->size - at) / sizeof *shm->cell;
    if (base) {
        shm->index = (_Atomic uint32_t *)(void *)(base + index);
        shm->slot = (struct apc_shm_slot *)(void *)(base + slot);
        shm->tag[0] = (apc_word *)(void *)(base + tag[0]);
        shm->tag[1] = (apc_word *)(void *)(base + tag[1]);
        shm->text[0] = (apc_word *)(void *)(base + text[0]);
        shm->text[1] = (apc_word *)(void *)(base + text[1]);
        shm->cell = (struct apc_shm_cell *)(void *)(base + at);
    }
}

/* FNV-1a. */
static uint64_t checksum(const struct apc_shm_constants *c)
{
    uint64_t sum = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < offsetof(struct apc_shm_constants, checksum); i++) {
        sum = (sum ^ ((const unsigned char *)c)[i]) * UINT64_C(0x100000001b3);
    }
    return sum;
}

/* ---- Open and close ------------------------------------------------------------------------- */

static int parse_uri(struct apc_shm *shm, const char *uri, struct apc_error *why)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    const char *name = uri + strlen("shm:");
    size_t length = strspn(name, allowed);
    if (length == 0 || length > APC_SHM_NAME_MAX || (name[length] != '\0' && name[length] != '?')) {
        return apc_fail(why, APC_EINVAL,
                        "\"%.60s\": expected shm:NAME of up to %d letters, digits, '.', '_', '-'", uri,
                        APC_SHM_NAME_MAX);
    }
    shm->mib = APC_SHM_MIB;
    if (name[length] == '?') {
        const char *value = name + length + strlen("?size=");
        char *end = NULL;
        if (strncmp(name + length, "?size=", strlen("?size=")) != 0 || value[0] < '0' || value[0] > '9') {
            return apc_fail(why, APC_EINVAL, "\"%.300s\": expected shm:NAME?size=MIB", uri);
        }
        errno = 0;
        shm->mib = strtoull(value, &end, 10);
        if (errno || *end != '\0' || shm->mib < 1 || shm->mib > APC_SHM_MIB_MAX) {
            return apc_fail(why, APC_EINVAL, "\"%.300s\": expected a size of 1 to %d MiB", uri,
                            APC_SHM_MIB_MAX);
        }
    }
    snprintf(shm->path, sizeof shm->path, DIRECTORY "/apc.%.*s", (int)length, name);
    shm->name = shm->path + strlen(DIRECTORY "/apc.");
    return 0;
}

static int make_mutex(pthread_mutex_t *mutex)
{
    pthread_mutexattr_t attr;
    if (pthread_mutexattr_init(&attr) != 0) {
        return APC_ESYS;
    }
    int e = pthread_mutexattr_setpshared(&attr, PTHREAD_PROCESS_SHARED);
    e = e ? e : pthread_mutexattr_setrobust(&attr, PTHREAD_MUTEX_ROBUST);
    e = e ? e : pthread_mutexattr_setprotocol(&attr, PTHREAD_PRIO_INHERIT);
    e = e ? e
          : pthread_mutexattr_settype(&attr, PTHREAD_MUTEX_RECURSIVE); /* who simulates holds it for a tick */
    e = e ? e : pthread_mutex_init(mutex, &attr);
    pthread_mutexattr_destroy(&attr);
    return e ? APC_ESYS : 0;
}

int apc_shm_open(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                 struct apc_error *why)
{
    struct apc_shm *shm = (struct apc_shm *)calloc(1, sizeof *shm);
    if (!shm) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    shm->base.ops = &apc_shm_store;
    shm->base.config = *config;
    shm->fd = -1;
    int err = parse_uri(shm, uri, why);
    pthread_mutex_t whole;
    if (!err && make_mutex(&whole) != 0) {
        err = apc_fail(why, APC_ESYS, "shm:%s: cannot make a robust mutex", shm->name);
    }
    if (err) {
        free(shm);
        return err;
    }
    shm->lock_kind = whole.__data.__kind;
    pthread_mutex_destroy(&whole);
    *store = &shm->base;
    return 0;
}

/* The claims go with the descriptor. */
static void drop_segment(struct apc_shm *shm)
{
    if (shm->header) {
        munmap(shm->header, shm->size);
        shm->header = NULL;
    }
    if (shm->fd >= 0) {
        close(shm->fd);
        shm->fd = -1;
    }
    shm->record = 0;
}

void apc_shm_close(struct apc_store *store)
{
    drop_segment(apc_shm_of(store));
    free(apc_shm_of(store)->claims.at);
    free(store);
}

/* ---- Connect --------------------------------------------------------------------------------- */

static int system_failure(struct apc_shm *shm, int err, const char *what)
{
    char text[128];
    return apc_fail(&shm->base.why, err, "shm:%s: cannot %s %s: %s", shm->name, what, shm->path,
                    strerror_r(errno, text, sizeof text));
}

static int refuse_segment(struct apc_shm *shm, const char *why)
{
    return apc_fail(&shm->base.why, APC_ESTORE, "shm:%s: %s %s: left as it is; remove it to make a new one",
                    shm->name, shm->path, why);
}

static int refuse_maker(struct apc_shm *shm, const char *maker, const char *copy)
{
    return apc_fail(
        &shm->base.why, APC_ESCHEMA,
        "shm:%s: %s is of %s: stop what uses it, keep it with %s `apc copy` if it is worth it, and "
        "remove it",
        shm->name, shm->path, maker, copy);
}

/* Was it made by programs like this one? */
static int check_maker(struct apc_shm *shm, const struct apc_shm_constants *c)
{
    char maker[100];
    if (c->layout != LAYOUT && __builtin_bswap32(c->layout) <= UINT16_MAX) {
        return refuse_maker(shm, "a processor with the other byte order", "that one's");
    }
    if (c->layout != LAYOUT) { /* where that has its checksum, that version alone knows */
        snprintf(maker, sizeof maker, "another version of libapc (layout %u, not %d)", (unsigned)c->layout,
                 LAYOUT);
        return refuse_maker(shm, maker, "that version's");
    }
    if (c->checksum != checksum(c)) {
        return refuse_segment(shm, "is corrupt: its header's checksum is wrong");
    }
    if (memcmp(c->machine, machine, sizeof machine) != 0) {
        snprintf(maker, sizeof maker, "programs for %.15s processors, and this one is for %s", c->machine,
                 machine);
        return refuse_maker(shm, maker, "their");
    }
    if (c->header_size != sizeof(struct apc_shm_header)) {
        snprintf(maker, sizeof maker, "programs with another C library (a header of %u bytes, not %zu)",
                 (unsigned)c->header_size, sizeof(struct apc_shm_header));
        return refuse_maker(shm, maker, "their");
    }
    return 0;
}

/* Is it a store of ours, and this user's? Its constants are read without mapping it. */
static int check_segment(struct apc_shm *shm, const struct stat *st)
{
    struct apc_shm_constants c;
    if (!S_ISREG(st->st_mode)) {
        return refuse_segment(shm, "is no file");
    }
    if (st->st_uid != geteuid() || (st->st_mode & 077) != 0) {
        return apc_fail(&shm->base.why, APC_EPERM,
                        "shm:%s: %s belongs to user %u with mode %03o: expected this user's own, mode 600",
                        shm->name, shm->path, (unsigned)st->st_uid, (unsigned)st->st_mode & 0777);
    }
    if (pread(shm->fd, &c, sizeof c, 0) != (ssize_t)sizeof c || memcmp(c.magic, magic, sizeof magic) != 0) {
        return refuse_segment(shm, "is no store of libapc");
    }
    const int err = check_maker(shm, &c);
    if (err) {
        return err;
    }
    if (c.mib < 1 || c.mib > APC_SHM_MIB_MAX || (uint64_t)st->st_size != c.mib << 20) {
        return refuse_segment(shm, "is corrupt: it has not the size that its header says");
    }
    apc_shm_lay_out(shm, c.mib, NULL);
    return 0;
}

static int map(struct apc_shm *shm, uint64_t mib)
{
    void *base = mmap(NULL, (size_t)mib << 20, PROT_READ | PROT_WRITE, MAP_SHARED, shm->fd, 0);
    if (base == MAP_FAILED) {
        return system_failure(shm, errno == ENOMEM ? APC_ENOMEM : APC_ESYS, "map");
    }
    shm->header = (struct apc_shm_header *)base;
    apc_shm_lay_out(shm, mib, (char *)base);
    return 0;
}

static apc_ns coarse_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
    return (apc_ns)t.tv_sec * APC_NS_PER_S + t.tv_nsec;
}

static int attach_segment(struct apc_shm *shm)
{
    struct stat st;
    if (fstat(shm->fd, &st) != 0) {
        return system_failure(shm, APC_ESYS, "look at");
    }
    int err = check_segment(shm, &st);
    if (!err) {
        err = map(shm, shm->size >> 20);
    }
    if (err) {
        return err;
    }
    shm->inode = st.st_ino;
    shm->device = st.st_dev;
    shm->checked = coarse_now();
    memset(shm->read_hint, 0, sizeof shm->read_hint);
    memset(shm->write_hint, 0, sizeof shm->write_hint);
    shm->base.stats.connects++;
    return shm->claims.n > 0 ? apc_shm_take(shm, shm->claims.at, shm->claims.n, 0) : 0;
}

/* The one there is. APC_ENOTFOUND: there is none. */
static int connect_existing(struct apc_shm *shm)
{
    drop_segment(shm);
    shm->fd = open(shm->path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (shm->fd < 0) {
        return errno == ENOENT ? APC_ENOTFOUND
                               : system_failure(shm, errno == EACCES ? APC_EPERM : APC_ESTORE, "open");
    }
    int err = attach_segment(shm);
    if (err) {
        drop_segment(shm);
    }
    return err;
}

int apc_shm_ready(struct apc_shm *shm)
{
    shm->base.stats.round_trips++;
    if (shm->header) {
        const apc_ns now = coarse_now();
        struct stat st;
        if (now - shm->checked < CHECK_INTERVAL) {
            return 0;
        }
        if (stat(shm->path, &st) == 0 && st.st_ino == shm->inode && st.st_dev == shm->device &&
            (uint64_t)st.st_size == shm->size) { /* cut short, the rest would be SIGBUS */
            shm->checked = now;
            return 0;
        }
    }
    int err = connect_existing(shm);
    if (err == APC_ENOTFOUND) {
        err = apc_fail(&shm->base.why, APC_ESCHEMA, "shm:%s: there is no %s yet: run apc init", shm->name,
                       shm->path);
    }
    return err;
}

/* ---- Make ------------------------------------------------------------------------------------ */

/* A new segment holds zeros. */
static int fill_segment(struct apc_shm *shm)
{
    struct apc_shm_header *h = shm->header;
    if (make_mutex(&h->writer) != 0) {
        return apc_fail(&shm->base.why, APC_ESYS, "shm:%s: cannot make a robust mutex", shm->name);
    }
    apc_word_put(&h->generation, 1);
    atomic_store(&h->tick, 1);
    apc_word_put(&h->meta.mark[0], 1);
    apc_word_put(&h->tags_mark[0], 1);
    h->constants = (struct apc_shm_constants){.layout = LAYOUT, .header_size = sizeof *h, .mib = shm->mib};
    memcpy(h->constants.magic, magic, sizeof magic);
    memcpy(h->constants.machine, machine, sizeof machine);
    h->constants.checksum = checksum(&h->constants);
    return 0;
}

/* A file without a name, complete. */
static int make_unnamed(struct apc_shm *shm)
{
    drop_segment(shm);
    shm->fd = open(DIRECTORY, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (shm->fd < 0 || fchmod(shm->fd, 0600) != 0) {
        return system_failure(shm, APC_ESTORE, "make");
    }
    int e = EINTR;
    while (e == EINTR) {
        e = posix_fallocate(shm->fd, 0, (off_t)(shm->mib << 20));
    }
    if (e) {
        struct statvfs fs = {0};
        char text[128];
        statvfs(DIRECTORY, &fs);
        return apc_fail(
            &shm->base.why, APC_ESTORE,
            "shm:%s: it needs %llu MiB of " DIRECTORY ", which has %llu free (%s): enlarge that, or "
            "use shm:%s?size=MIB",
            shm->name, (unsigned long long)shm->mib, (unsigned long long)fs.f_bavail * fs.f_frsize >> 20,
            strerror_r(e, text, sizeof text), shm->name);
    }
    int err = map(shm, shm->mib);
    return err ? err : fill_segment(shm);
}

static int give_name(struct apc_shm *shm)
{
    char unnamed[32];
    snprintf(unnamed, sizeof unnamed, "/proc/self/fd/%d", shm->fd);
    if (linkat(AT_FDCWD, unnamed, AT_FDCWD, shm->path, AT_SYMLINK_FOLLOW) != 0 && errno != EEXIST) {
        return system_failure(shm, APC_ESTORE, "make");
    }
    return 0; /* ours, or that of someone who was faster */
}

int apc_shm_init(struct apc_store *store)
{
    struct apc_shm *shm = apc_shm_of(store);
    store->stats.round_trips++;
    int err = connect_existing(shm);
    if (err != APC_ENOTFOUND) {
        return err ? err : apc_store_version();
    }
    err = make_unnamed(shm);
    if (!err) {
        err = give_name(shm);
    }
    drop_segment(shm);
    if (!err) {
        err = connect_existing(shm);
    }
    return err == APC_ENOTFOUND
               ? apc_fail(&store->why, APC_ESTORE, "shm:%s: %s was removed at once", shm->name, shm->path)
               : err;
}
