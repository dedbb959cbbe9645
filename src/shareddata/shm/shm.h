/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory, shared by its files: shm_segment.c (what the segment is: made, checked,
 * mapped), shm_write.c (the writers' lock, transactions, recovery), shm.c (samples), shm_rows.c (history,
 * events, timing, housekeeping), shm_catalogue.c (tags, catalogue, authors), shm_vectors.c (vectors),
 * shm_claim.c, shm_clock.c (of a simulated plant).
 *
 * One segment, /dev/shm/apc.NAME
 * ------------------------------
 * header | index | slots | tags | catalogue | logs | cells
 *
 * A variable has a slot, found by a hash index. The slot holds its newest sample, twice: in two versions. Its
 * history is a ring of cells, which grows from 4 to 16, 64, ... 262144 while there are cells left. Events, in
 * three kinds, and timing rows are rings as well. Three quarters of a ring are shown: what a writer may be
 * overwriting is not.
 *
 * Old or new
 * ----------
 * `generation` counts the transactions; to store it is the one instruction that commits. A writer, who
 * holds the lock, makes generation g + 1: of whatever has two versions (a slot, the tags, the counters of
 * `meta`) it overwrites the one that is not current, after it has marked it by g + 1; cells and records it
 * only writes where nobody looks as long as the heads of generation g hold. Readers take generation g, then
 * of each thing the version with the highest mark not above g, and look again whether its mark has stayed.
 * So what a writer is doing, or did not live to finish, is invisible, and all of it becomes visible at once.
 * A reader holds no lock, and nobody waits for it.
 *
 * Who gets the lock of a dead writer (a robust mutex: the kernel says so) makes all marks above g
 * APC_SHM_SPOILED before it begins: recovery. It can be killed in the middle of that, too. An operation that
 * fails half-way does the same.
 *
 * A mark above all generations is not 0, for 0 says that there never was anything: of a version that was
 * there and was spoiled, a reader who is late must not believe that. The first version is written first, and
 * the second only while the first is current: so a second of 0 beside a first above g says that there was
 * nothing at g.
 *
 * A reader that takes long may find both versions of a slot already newer than its g. Then it begins again
 * with a newer g and that slot first. A writer at full speed could keep it from ever finishing a long list:
 * after APC_SHM_TRIES it takes each sample by itself, whole and newest, but maybe not of one moment.
 *
 * Shared words are atomic and relaxed where a mark guards them, so that there is no data race in C's sense.
 * The index, and marks of cells and records, are relaxed as well: a reader of generation g looks for nothing
 * that was not there before g, which it has acquired. A mark tells it only what was overwritten since.
 */
#ifndef APC_SHM_H
#define APC_SHM_H

#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/types.h>

#include "shareddata/shareddata_internal.h"

#define APC_SHM_TRIES     1000
#define APC_SHM_SPOILED   UINT64_MAX
#define APC_SHM_EXTENTS   9  /* of a ring: 4, 12, 48, ... 196608 cells */
#define APC_SHM_FREELY    7  /* of samples; a further one only while half of all cells stay free */
#define APC_SHM_RESERVE   8  /* this part of all cells is for first extents only: rings do not grow into it */
#define APC_SHM_SHARE     16 /* of vectors the same goes for one that takes more than this part of all */
#define APC_SHM_VECTORS   8  /* extents of a ring of vectors */
#define APC_SHM_BINS      256 /* of a timing row; more are merged */
#define APC_SHM_MIB       32  /* of a segment when the URI does not say */
#define APC_SHM_MIB_MAX   65536
#define APC_SHM_NAME_MAX  200
#define APC_SHM_CLAIMANTS 256 /* handles that have a claim */
#define APC_SHM_AUTHORS   1024

typedef _Atomic uint64_t apc_word;

/* ---- What lies in the segment ---------------------------------------------------------------- */

/** What never changes. */
struct apc_shm_constants {
    char magic[16];
    uint32_t layout, header_size; /* of this library's structs */
    char machine[16];             /* whose words and lock they are */
    uint64_t mib;                 /* everything's size follows from it */
    uint64_t checksum;            /* of what stands before it */
};

/** A ring's first ordinal is head - kept. */
struct apc_shm_ends {
    uint64_t head, kept;
};

/** What people did ("operator"), who came ("access"), what comes and goes ("link", "measurement", but for
 * alarms) and alarms ("alarm") have rings of their own: no chatter and no flood pushes out what matters. */
enum apc_shm_log_name {
    APC_SHM_EVENTS,
    APC_SHM_ACTIONS,
    APC_SHM_ACCESS,
    APC_SHM_CHATTER,
    APC_SHM_ALARMS,
    APC_SHM_TIMING,
    APC_SHM_LOGS
};

/** Counters of the whole: two versions. */
struct apc_shm_counters {
    uint64_t variables, cells; /* in use */
    struct apc_shm_ends log[APC_SHM_LOGS];
};
#define APC_SHM_COUNTERS (sizeof(struct apc_shm_counters) / sizeof(uint64_t))

struct apc_shm_meta {
    apc_word mark[2];
    apc_word counters[2][APC_SHM_COUNTERS];
};

/** Who claims. */
struct apc_shm_claimant {
    char name[56];   /* of one that is fenced: of who fenced it */
    apc_word number; /* above all former ones; 0: it is fenced, and writes nothing any more */
};

struct apc_shm_header {
    struct apc_shm_constants constants;
    _Alignas(64) apc_word generation; /* of the last commit */
    apc_word first;                   /* seqs of new variables begin above it */
    _Atomic uint32_t tick;            /* a futex: changes with every commit */
    apc_word refused, refused_at;     /* rows that found no room; when the last one came, UTC */
    apc_word lacking;                 /* the variable of that one, until a row of it is written; or 0 */
    _Alignas(64) pthread_mutex_t writer;
    _Atomic uint32_t waiting; /* the tick that someone may sleep on, or 0 */
    struct apc_store_pace pace;
    _Alignas(64) struct apc_shm_meta meta;
    apc_word tags_mark[2], n_tags[2], revision[2], text_length[2]; /* tags and catalogue have one mark */
    apc_word authors; /* so many names, which stay: it is stored after the name */
    apc_word author[APC_SHM_AUTHORS][APC_AUTHOR_LEN / 8];
    struct apc_shm_claimant claimant[APC_SHM_CLAIMANTS]; /* guarded by the writers' lock */
};

/** A sample, and of a slot's version its ring. Eight words: a cache line. */
struct apc_shm_cell {
    apc_word mark; /* of a cell: 1 + its ordinal, or 0 while it is written. Of a version: the ring's head */
    apc_word seq, time, value, origin;
    apc_word status; /* and above it the author */
    apc_word spare;
    apc_word ring; /* of a version: extents in the low byte, above it how many cells are kept */
};

struct apc_shm_slot {
    apc_word key; /* table and id; 0: free */
    apc_word mark[2];
    _Atomic uint32_t extent[APC_SHM_EXTENTS]; /* first cell of each */
    _Atomic uint32_t owner;                   /* 1 + number of a claimant; 0: nobody */
    _Alignas(64) struct apc_shm_cell version[2];
};

/** A timing row's record; the buckets' lows, highs and counts follow each other. */
struct apc_shm_timing {
    apc_ns time;
    char task[32], quantity[16];
    int64_t period, missed, count;
    double mean, sd;
    int64_t p50, p99, max, n_bins;
    int64_t bins[3 * APC_SHM_BINS];
};

/* ---- A handle -------------------------------------------------------------------------------- */

/** A ring of records: each a mark, 1 + its ordinal, its place among all events, or among all timing rows, and
 * then its words, of which the first is its time. */
struct apc_shm_log {
    apc_word *record;
    size_t words; /* of a record with its mark */
    size_t capacity;
};

#define APC_SHM_HINTS 16384 /* a controller of a thousand loops of pi reads 10 000 variables */

struct apc_shm {
    struct apc_store base;
    char path[APC_SHM_NAME_MAX + 16];
    const char *name; /* in path */
    uint64_t mib;
    int fd;
    ino_t inode;
    dev_t device;
    apc_ns checked;  /* when path was last seen to lead to what is mapped */
    uint32_t record; /* as a claimant; 0: none */
    int lock_kind;   /* what glibc has in a whole writers' lock; another one is damaged */
    struct apc_claims claims;
    struct apc_shm_header *header; /* NULL: not connected */
    size_t size, variables, index_size, cells, tags, text_size;
    _Atomic uint32_t *index; /* 1 + number of a slot; 0: free */
    struct apc_shm_slot *slot;
    apc_word *tag[2], *text[2];
    struct apc_shm_log log[APC_SHM_LOGS];
    struct apc_shm_cell *cell;
    uint32_t read_hint[APC_SHM_HINTS], write_hint[APC_SHM_HINTS]; /* slots of the last time's samples */
};

/** The hint of the @p i-th thing of a call; NULL: it has none. */
static inline uint32_t *apc_shm_hint(uint32_t *hints, size_t i)
{
    return i < APC_SHM_HINTS ? &hints[i] : NULL;
}

static inline struct apc_shm *apc_shm_of(struct apc_store *store)
{
    return (struct apc_shm *)store;
}

/* ---- Words ----------------------------------------------------------------------------------- */

static inline uint64_t apc_word_get(const apc_word *w)
{
    return atomic_load_explicit(w, memory_order_relaxed);
}

static inline void apc_word_put(apc_word *w, uint64_t value)
{
    atomic_store_explicit(w, value, memory_order_relaxed);
}

static inline void apc_words_get(void *to, const apc_word *from, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        uint64_t word = apc_word_get(&from[i]);
        memcpy((char *)to + 8 * i, &word, 8);
    }
}

static inline void apc_words_put(apc_word *to, const void *from, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        uint64_t word;
        memcpy(&word, (const char *)from + 8 * i, 8);
        apc_word_put(&to[i], word);
    }
}

/** Which of two versions is the current one of generation @p g: 0 or 1, -1: none, -2: both are newer. *@p was
 * is its mark: who holds no lock sees after reading whether it still is, apc_shm_unchanged(). Who sees the first
 * go has to see how the second fared. */
static inline int apc_shm_current(const apc_word mark[2], uint64_t g, uint64_t *was)
{
    uint64_t a = atomic_load_explicit(&mark[0], memory_order_acquire);
    uint64_t b = atomic_load_explicit(&mark[1], memory_order_relaxed);
    if (a > g) {
        a = 0;
        if (b > g) {
            return -2;
        }
    } else if (b > g) {
        b = 0;
    }
    *was = b > a ? b : a;
    return *was == 0 ? -1 : b > a;
}

/** After reading a version, or a cell: was its mark @p value all the time? */
static inline bool apc_shm_unchanged(const apc_word *mark, uint64_t value)
{
    atomic_thread_fence(memory_order_acquire);
    return apc_word_get(mark) == value;
}

static inline uint64_t apc_shm_generation(const struct apc_shm *shm)
{
    return atomic_load_explicit(&shm->header->generation, memory_order_acquire);
}

static inline uint64_t apc_shm_key(enum apc_table table, int id)
{
    return (uint64_t)table << 32 | (uint32_t)id;
}

/* ---- shm_segment.c ----------------------------------------------------------------------------- */

int apc_shm_open(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                 struct apc_error *why);
void apc_shm_close(struct apc_store *store);
int apc_shm_init(struct apc_store *store);
/** Sizes, and with @p base addresses, of everything in a segment of @p mib. */
void apc_shm_lay_out(struct apc_shm *shm, uint64_t mib, char *base);
/** Connect, or see whether the segment is still the one of that name: every operation begins with it. */
int apc_shm_ready(struct apc_shm *shm);

/* ---- shm_write.c ------------------------------------------------------------------------------- */

/** A transaction: the lock is held. */
struct apc_shm_write {
    struct apc_shm *shm;
    uint64_t generation;              /* that it makes */
    struct apc_shm_counters counters; /* once they are needed: apc_shm_count() */
    bool counted;
};

/** Take the writers' lock, before the timeout. */
int apc_shm_lock(struct apc_shm *shm);
/** The clock of a simulated plant (shareddata_internal.h). */
int apc_shm_pace(struct apc_store *store, struct apc_store_pace **words, bool lock);
void apc_shm_unlock_pace(struct apc_store *store);
int apc_shm_follow(struct apc_store *store);
void apc_shm_unlock(struct apc_shm *shm);

int apc_shm_begin(struct apc_shm *shm, struct apc_shm_write *w);
/** The counters, to be changed. */
struct apc_shm_counters *apc_shm_count(struct apc_shm_write *w);
/** End a transaction that has written @p count things, or failed with @p err. Returns @p err or @p count. */
int apc_shm_finish(struct apc_shm_write *w, int err, int count);
/** Make it visible, unlock, wake those who wait. */
void apc_shm_commit(struct apc_shm_write *w);
/** The version to write of two; the former one, or -1, is *@p from. */
int apc_shm_version(struct apc_shm_write *w, apc_word mark[2], int *from);

/** The variable's slot, or NULL; *@p hint (may be NULL) becomes its number. */
struct apc_shm_slot *apc_shm_look_up(const struct apc_shm *shm, uint64_t key, uint32_t *hint);
/** The same; @p hint is where it was the last time. */
static inline struct apc_shm_slot *apc_shm_find(const struct apc_shm *shm, uint64_t key, uint32_t *hint)
{
    return hint && apc_word_get(&shm->slot[*hint].key) == key ? &shm->slot[*hint]
                                                              : apc_shm_look_up(shm, key, hint);
}
/** The same, in a transaction that makes it where there is none; NULL when there is no room. */
struct apc_shm_slot *apc_shm_find_or_add(struct apc_shm_write *w, uint64_t key, uint32_t *hint);
/** The newest seq of a variable, as the transaction sees it; 0: it has no row. */
int64_t apc_shm_newest_seq(const struct apc_shm_write *w, enum apc_table table, int id);
/** The same; where it has no row, that above which its seqs begin. */
int64_t apc_shm_last_seq(const struct apc_shm_write *w, enum apc_table table, int id);
/** A variable's row finds no room: that is known to everybody, until a row of it is written. Returns
 * APC_ESTORE. */
int apc_shm_no_room(struct apc_shm_write *w, uint64_t key);
/* "shm:NAME ", what it lacks, and the way to a larger one. Returns APC_ESTORE. */
int apc_shm_too_small(struct apc_shm *shm, const char *format, ...) __attribute__((format(printf, 2, 3)));
/** A row of it was written. */
static inline void apc_shm_has_room(struct apc_shm_write *w, uint64_t key)
{
    if (apc_word_get(&w->shm->header->lacking) == key) {
        apc_word_put(&w->shm->header->lacking, 0);
    }
}
/** Write one sample. Returns 1, 0 when its seq was taken, APC_ESTORE when there is no room. */
int apc_shm_write_sample(struct apc_shm_write *w, const struct apc_sample *s, uint32_t *hint);
/** After a sample: where it is the mode of all, that of each loop. Returns 0 or an error. */
int apc_shm_write_loops(struct apc_shm_write *w, const struct apc_sample *s);
/** Write one record of @p words words. */
void apc_shm_write_record(struct apc_shm_write *w, enum apc_shm_log_name name, const void *record,
                          size_t words);

/** Cells of the first @p extents: 0, 4, 16, 64, ... */
static inline uint64_t apc_shm_capacity(uint64_t extents)
{
    return extents > 0 ? UINT64_C(1) << (2 * extents & 63) : 0;
}

/** A ring of @p extents of rows of @p width cells, of samples or of @p vectors, while @p used cells are: may
 * it have one extent more? One that may not goes round in what it has, and its oldest rows give way. */
static inline bool apc_shm_may_grow(const struct apc_shm *shm, uint64_t used, uint64_t extents,
                                    uint64_t width, bool vectors)
{
    if (extents >= APC_SHM_EXTENTS) {
        return false;
    }
    const uint64_t more = (apc_shm_capacity(extents + 1) - apc_shm_capacity(extents)) * width;
    const bool freely =
        vectors ? extents == 0 || more <= shm->cells / APC_SHM_SHARE : extents < APC_SHM_FREELY;
    const uint64_t reserve = extents > 0 ? shm->cells / APC_SHM_RESERVE : 0;
    return shm->cells - used >= more + reserve && (freely || used + more <= shm->cells / 2);
}

/** In which extent a position of a ring lies. */
static inline int apc_shm_extent(uint64_t position)
{
    return (63 - __builtin_clzll(position | 1)) / 2;
}

/** A ring's cell by its ordinal, NULL when the slot makes no sense. @p extents as in the version. */
static inline struct apc_shm_cell *apc_shm_cell(const struct apc_shm *shm, const struct apc_shm_slot *slot,
                                                uint64_t extents, uint64_t ordinal)
{
    const uint64_t position = ordinal & (apc_shm_capacity(extents) - 1);
    if (extents < 1 || extents > APC_SHM_EXTENTS) {
        return NULL;
    }
    const int extent = apc_shm_extent(position);
    const uint64_t at = atomic_load_explicit(&slot->extent[extent], memory_order_relaxed) + position -
                        (extent > 0 ? apc_shm_capacity((uint64_t)extent) : 0);
    return at < shm->cells ? &shm->cell[at] : NULL;
}

/** How much of a ring is shown. */
static inline uint64_t apc_shm_shown(uint64_t capacity)
{
    return capacity - capacity / 4;
}

/* ---- shm.c, shm_rows.c: operations ------------------------------------------------------------- */

static inline int64_t apc_shm_first(const struct apc_shm *shm)
{
    return (int64_t)apc_word_get(&shm->header->first);
}

/** A slot's version of generation @p g: 1, 0: none, -1: lost, take a newer generation. */
int apc_shm_load(const struct apc_shm_slot *slot, uint64_t g, uint64_t version[8]);
/** The variable's version as of now, and its slot: 1, 0: it has none, or an error. */
int apc_shm_load_newest(struct apc_shm *shm, uint64_t key, const struct apc_shm_slot **slot,
                        uint64_t version[8]);
/** What has two versions was lost APC_SHM_TRIES times in a row: APC_ETIMEDOUT, or APC_ESTORE when nothing was
 * committed since generation @p g, which then is no reason. */
int apc_shm_lost(struct apc_shm *shm, uint64_t g);
static inline bool apc_shm_within(const struct apc_range *range, apc_ns time)
{
    return (range->since == 0 || time >= range->since) && (range->until == 0 || time < range->until);
}

/** The sample in a version's or cell's words. */
struct apc_sample apc_shm_sample(enum apc_table table, int id, const uint64_t words[8]);

int apc_shm_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity);
int apc_shm_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_sample_fn fn, void *ctx);
int apc_shm_append_events(struct apc_store *store, const struct apc_event *events, size_t n);
int apc_shm_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
int apc_shm_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
int apc_shm_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);
int apc_shm_maintain(struct apc_store *store, const struct apc_retention *keep);
int apc_shm_room(struct apc_store *store, struct apc_store_room *room);

/* ---- shm_catalogue.c --------------------------------------------------------------------------- */

int apc_shm_author(struct apc_store *store, const char *name);
int apc_shm_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);
int apc_shm_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue);
int apc_shm_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision);
int apc_shm_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity);

/* ---- shm_claim.c ------------------------------------------------------------------------------- */

/** Claim what nobody else has claimed who lives, but for @p holder; seqs become the newest. Returns 0,
 * APC_EBUSY, ... */
int apc_shm_take(struct apc_shm *shm, struct apc_sample *variables, size_t n, uint64_t holder);
/** May this handle write? Returns 0, or APC_EBUSY: it was fenced. The lock is held. */
int apc_shm_fenced(struct apc_shm *shm);
int apc_shm_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder);
int apc_shm_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder);
int apc_shm_claim(struct apc_store *store, struct apc_sample *variables, size_t n);
int apc_shm_release(struct apc_store *store, const struct apc_sample *variables, size_t n);

/* ---- shm_vectors.c ----------------------------------------------------------------------------- */

/** Cells of a row of so many elements: a power of two. */
uint64_t apc_shm_width(size_t elements);
/** The newest of generation @p g. Returns false when it is lost. */
bool apc_shm_load_vector(struct apc_shm *shm, uint64_t g, struct apc_vector *v, uint32_t *hint);
int apc_shm_append_rows(struct apc_store *store, const struct apc_rows *rows);
int apc_shm_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_vector_fn fn, void *ctx);
/** Of one variable what is older, but the newest stays. Returns how many went. */
int apc_shm_drop_vectors(struct apc_shm *shm, struct apc_shm_slot *slot, apc_ns before);

#endif
