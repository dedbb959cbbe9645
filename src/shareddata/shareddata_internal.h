/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What a store is inside. A store is one file (or a few) with a table of operations; store.c and
 * store_records.c check the arguments of every public function, so that an operation only ever sees good
 * ones, and dispatches.
 *
 * To add a store: write its file with a `const struct apc_store_ops apc_NAME_store`, name it here and in
 * the list of open.c, and to that of tests/support/stores.c, which every test of stores goes
 * through.
 */
#ifndef APC_SHAREDDATA_INTERNAL_H
#define APC_SHAREDDATA_INTERNAL_H

#include "apcstore.h"

/** Most samples of one call: bounds every buffer's size. */
#define APC_STORE_SAMPLES_MAX ((size_t)1 << 20)

/** The options with the defaults filled in. */
struct apc_store_config {
    char name[64];
    apc_ns timeout, backoff_min, backoff_max;
    bool chunks, spool_or_memory;
};

/** The clock of a plant that is simulated: words that its store shares. All are written under its writers' lock. */
struct apc_store_pace {
    _Atomic uint64_t now;            /* UTC; 0: the plant is none that is simulated */
    _Atomic uint64_t asked, reached; /* doubles */
    _Atomic uint64_t steps;          /* to be made while it is paused */
    _Atomic uint64_t held;           /* a tick is being made */
    _Atomic uint64_t outside;        /* rows that people's programs have written between ticks */
    _Atomic uint64_t rewind;         /* UTC: to where it is to go back; 0: it goes on */
};

struct apc_store_ops;

/** A store's own struct begins with it. */
struct apc_store {
    const struct apc_store_ops *ops;
    struct apc_store *inner; /* behind it, if there is one: it does what this one has no operation for */
    struct apc_store_config config;
    struct apc_error why;
    struct apc_store_stats stats;
    uint64_t claim; /* number of its newest one; 0: none, or they have none */
    apc_ns instant; /* that it shows; 0: now */
    bool streaming; /* a caller's function is running: it may not call the store */
    int64_t *seq;   /* of the samples of the running append of rows, as they came */
    size_t n_seq;
    struct apc_sample *loop; /* targets to which the running put's mode of all goes as well: table and id */
    size_t n_loops;
};

/** Contracts as in apcstore.h. Failures leave their text in store->why. */
struct apc_store_ops {
    const char *scheme; /* with the colon */
    bool spreads;       /* it writes the mode of all to each loop by itself */
    bool numbers;       /* its events, and its timing rows, are numbered as they come, none is left out */
    int (*open)(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                struct apc_error *why);
    void (*close)(struct apc_store *store);
    /* What the store behind it answered to a call that began then; NULL: its text is this one's. */
    int (*answered)(struct apc_store *store, int rc, apc_ns began);
    bool (*connected)(const struct apc_store *store);
    void (*stats)(const struct apc_store *store, struct apc_store_stats *stats); /* NULL: store->stats */
    int (*version)(const struct apc_store *store); /* when connected; NULL: always apc_store_version() */
    int (*connect)(struct apc_store *store);
    int (*read)(struct apc_store *store, struct apc_sample *samples, size_t n);
    int (*append)(struct apc_store *store, const struct apc_sample *samples, size_t n);
    int (*put)(struct apc_store *store, struct apc_sample *samples, size_t n);
    int (*swap)(struct apc_store *store, struct apc_sample *samples, size_t n);
    int (*wait)(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout);
    int (*variables)(struct apc_store *store, struct apc_sample *variables, size_t capacity);
    int (*history)(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_sample_fn fn, void *ctx);
    int (*history_bins)(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                        size_t n, apc_history_bin_fn fn, void *ctx);
    /* Of each of these, all of one table, its row of the highest seq with since <= time < until, where the
     * record has the next seq as well; of others seq is 0. NULL: that is no quicker than one after another. */
    int (*newest_within)(struct apc_store *store, struct apc_sample *samples, size_t n, apc_ns since,
                         apc_ns until);
    int (*get_tags)(struct apc_store *store, struct apc_tag *tags, size_t capacity);
    int (*append_events)(struct apc_store *store, const struct apc_event *events, size_t n);
    int (*events)(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
    int (*append_timing)(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
    int (*timing)(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);
    int (*read_rows)(struct apc_store *store, struct apc_rows *rows);
    int (*append_rows)(struct apc_store *store, const struct apc_rows *rows);
    int (*vectors)(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_vector_fn fn, void *ctx);
    int (*claim_set)(struct apc_store *store, struct apc_sample *variables, size_t n);
    int (*release)(struct apc_store *store, const struct apc_sample *variables, size_t n);
    int (*holder)(struct apc_store *store, const struct apc_sample *variable,
                  uint64_t *holder); /* may be NULL */
    int (*seize)(struct apc_store *store, struct apc_sample *variables, size_t n,
                 uint64_t holder); /* with it */
    int (*author)(struct apc_store *store, const char *name);
    int (*author_name)(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);
    int (*describe)(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue);
    int (*catalogue)(struct apc_store *store, char *text, size_t size, int64_t *revision);
    /* The one that was in force at a time, or the first; NULL: there is only the present one. */
    int (*catalogue_at)(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision);
    int (*behind)(struct apc_store *store, struct apc_behind *behind);      /* NULL: there is no history */
    int (*requests)(struct apc_store *store, apc_request_fn fn, void *ctx); /* NULL: none can be made */
    int (*answer)(struct apc_store *store, int64_t id, int64_t seq, const char *outcome);
    int (*keep_history)(struct apc_store *store); /* NULL: it cannot be one, and nobody asks */
    int (*is_history)(struct apc_store *store);
    int (*ask)(struct apc_store *store, struct apc_request *request);
    int (*asked)(struct apc_store *store, int64_t id, char *outcome, size_t size);
    int64_t (*first)(struct apc_store *store);                 /* seqs begin above it; NULL: above 0 */
    int (*count_from)(struct apc_store *store, int64_t first); /* NULL: it cannot be told to */
    int (*init)(struct apc_store *store);
    int (*maintain)(struct apc_store *store, const struct apc_retention *keep);
    int64_t (*forget)(struct apc_store *store, apc_ns before); /* NULL: it keeps all that is not old */
    int (*room)(struct apc_store *store, struct apc_store_room *room);  /* NULL: it has no fixed one */
    int (*plants)(struct apc_store *store, apc_plant_fn fn, void *ctx); /* NULL: it is of one plant */
    int (*restore)(struct apc_store *store, const char *from, char *kept, size_t size);
    /* NULL: its plant is never simulated. The words, under the writers' lock until unlock() where @lock. */
    int (*pace)(struct apc_store *store, struct apc_store_pace **words, bool lock);
    void (*unlock)(struct apc_store *store);
    int (*follow)(struct apc_store *store);
};

extern const struct apc_store_ops apc_postgresql_store;
extern const struct apc_store_ops apc_postgres_store; /* libpq's other spelling */
extern const struct apc_store_ops apc_sqlite_store;
extern const struct apc_store_ops apc_mem_store;
extern const struct apc_store_ops apc_shm_store;

/** Where bin @p i of apc_store_history_bins() begins; i = n is where the last one ends. */
static inline apc_ns apc_bin_edge(apc_ns since, apc_ns until, size_t n, size_t i)
{
    uint64_t span =
        (uint64_t)until - (uint64_t)since; /* may exceed apc_ns; the product below never overflows */
    return (apc_ns)((uint64_t)since + span / n * i + span % n * i / n);
}

/** Is the number one of a table? */
static inline bool apc_table_known(enum apc_table table)
{
    return table >= APC_SENSOR && table < APC_TABLE_END;
}

/** Do people write it, and programs on their behalf, so that it has no one writer? */
static inline bool apc_table_shared(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_TUNING || table == APC_MANUAL;
}

/** Do its rows bear numbers of something else, some of which are left out? A law publishes nothing at a tick at which
 * it has no answer; a plan has the seq of its setpoint, of which others are written by people. */
static inline bool apc_table_leaves_out(enum apc_table table)
{
    return table == APC_ESTIMATE || table == APC_PREDICTION || table == APC_PLAN;
}

/** Are old samples of it packed? */
static inline bool apc_table_packed(enum apc_table table)
{
    return table == APC_SENSOR || table == APC_ACTUATOR || table == APC_SETPOINT || table == APC_ACTUAL ||
           table == APC_ESTIMATE;
}

/** Is it the target mode of all loops? What is put there is written to each, unless the same put names it. */
static inline bool apc_is_of_all(const struct apc_sample *s)
{
    return s->table == APC_OPMODE && s->id == 0;
}

/** What a row of it makes the target of loop @p k of the store's, whose newest is @p newest. */
static inline struct apc_sample apc_loop_row(const struct apc_store *store, const struct apc_sample *of_all,
                                             size_t k, int64_t newest)
{
    struct apc_sample s = *of_all;
    s.id = store->loop[k].id;
    s.seq = newest + 1;
    s.origin = of_all->seq;
    return s;
}

/** How long rows of the table are to be kept; 0: for ever. */
static inline apc_ns apc_table_kept(const struct apc_retention *keep, enum apc_table table)
{
    return table == APC_TICK || table == APC_PREDICTION ? keep->ticks : keep->samples;
}

/* ---- store.c --------------------------------------------------------------------------------- */

/** A public function begins with it where an operation may be left to the store behind, @p call, which checks. */
#define APC_STORE_PASS(store, operation, call)                                                               \
    do {                                                                                                     \
        if ((store) && !(store)->ops->operation && (store)->inner && !(store)->streaming) {                  \
            struct apc_store *inner = (store)->inner;                                                        \
            const apc_ns pass_began = apc_clock_mono(NULL);                                                  \
            return apc_store_passed((store), (call), pass_began);                                            \
        }                                                                                                    \
    } while (0)
int apc_store_passed(struct apc_store *store, int rc, apc_ns began);

/** Every operation begins with it: the store can be used, @p array holds @p n. Returns 0 or an error. */
int apc_store_enter(struct apc_store *store, const void *array, size_t n);
/** Every one that changes something: the same, and it is no past. */
int apc_store_enter_change(struct apc_store *store, const void *array, size_t n);
int apc_store_check_variable(struct apc_store *store, enum apc_table table, int id);
/** @p range may be NULL; has_fn: there is a function for the rows. */
int apc_store_check_range(struct apc_store *store, const struct apc_range *range, bool has_fn);

/* ---- store_records.c ------------------------------------------------------------------------- */

/** The catalogue that was in force at a time, or the first one, as far as the store keeps former ones. As
 * apc_store_catalogue(). */
int apc_store_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision);

/* ---- rows.c: for stores without a server, what PostgreSQL's constraints say ------------------ */

/** Stored times are whole microseconds, rounded down. */
static inline apc_ns apc_time_stored(apc_ns time)
{
    apc_ns rest = time % 1000;
    return time - rest - (rest < 0 && time >= INT64_MIN + 1000 ? 1000 : 0);
}

/** May they be stored? Returns 0 or APC_ESTORE. */
int apc_rows_check(struct apc_store *store, const struct apc_sample *samples, size_t n);
int apc_vectors_check(struct apc_store *store, const struct apc_vector *vectors, size_t n);
/** A row of append_rows whose table people write follows @p newest: it gets its seq, or 0. Is it to be
 * stored?
 */
static inline bool apc_rows_next(struct apc_sample *s, int64_t newest)
{
    if (!apc_table_shared(s->table)) {
        return true;
    }
    const bool fits = (s->seq == APC_SEQ_ANY || s->seq == newest) && newest < APC_SEQ_MAX;
    s->seq = fits ? newest + 1 : 0;
    return fits;
}
/** Say that a sample's seq would be above APC_SEQ_MAX. Returns APC_ESTORE. */
int apc_rows_seq_failure(struct apc_store *store, const struct apc_sample *sample);
/** The operation variables, from @p all that there are, in any order; frees them. Returns @p n. */
int apc_variables_give(struct apc_sample *all, size_t n, struct apc_sample *variables, size_t capacity);

/* ---- failover.c ------------------------------------------------------------------------------ */

/** Above which seqs of new variables begin. */
int64_t apc_store_first(struct apc_store *store);
/** How many rows there are behind @p stored up to @p newest, where numbers begin above @p first. */
uint64_t apc_rows_between(int64_t first, int64_t stored, int64_t newest);

/* ---- tags.c ---------------------------------------------------------------------------------- */

/** All that a store has, to be freed. Returns 0, APC_ENOMEM or an error of the store's. */
int apc_tags_load(struct apc_store *store, struct apc_tag **tags, size_t *n);
/** That of the variable of @p like; NULL: there is none. */
const struct apc_tag *apc_tag_of(const struct apc_tag *tags, size_t n, const struct apc_tag *like);
bool apc_tags_alike(const struct apc_tag *a, const struct apc_tag *b);
/** Is the @p other of the same experiment, as far as both tell? Returns 0, or APC_EPERM with the text. */
int apc_tags_compare(const struct apc_tag *here, size_t n, const struct apc_tag *other, size_t n_other,
                     struct apc_error *why);

/* ---- claims.c -------------------------------------------------------------------------------- */

struct apc_claims {
    struct apc_sample *at; /* table and id; to be freed */
    size_t n;
};
/** Room for @p n more. */
int apc_claims_reserve(struct apc_store *store, struct apc_claims *c, size_t n);
/** There is room. */
void apc_claims_add(struct apc_claims *c, const struct apc_sample *variables, size_t n);
void apc_claims_drop(struct apc_claims *c, const struct apc_sample *variables, size_t n);

/** As they are stored: texts are one line and show as they are (base/text.h). */
struct apc_event apc_event_row(const struct apc_event *event);
struct apc_timing_row apc_timing_stored(const struct apc_timing_row *row);
void apc_tag_clean(struct apc_tag *tag);

/** Check tags and give a copy, to be freed, in the order of table and id. Returns 0, APC_ESTORE, APC_ENOMEM. */
int apc_tags_sort(struct apc_store *store, const struct apc_tag *tags, size_t n, struct apc_tag **sorted);

/** Intervals that are being filled. */
struct apc_bins {
    struct apc_bin_sum *bin; /* [n], to be freed */
    size_t n;
    apc_ns since, until;
    int64_t last; /* the highest seq of those taken whole */
    size_t at;    /* the bin that was used last, and its edges; from == to: none was */
    apc_ns from, to;
};
int apc_bins_make(struct apc_store *store, struct apc_bins *bins, apc_ns since, apc_ns until, size_t n);
/** A sample, in any order; an apc_sample_fn. */
int apc_bins_add(void *bins, const struct apc_sample *sample);
/** One that another store has made, before any sample; an apc_history_bin_fn. */
int apc_bins_take(void *bins, const struct apc_history_bin *bin);
/** What a part of bin @p i has; @p final: seq of its last value. In any order. */
void apc_bins_merge(struct apc_bins *bins, size_t i, const struct apc_history_bin *part, int64_t final);
/** As the operation history_bins does. */
int apc_bins_give(struct apc_store *store, struct apc_bins *bins, apc_history_bin_fn fn, void *ctx);
/** The operation history_bins, made from the store's own history. */
int apc_bins_by_history(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                        size_t n, apc_history_bin_fn fn, void *ctx);

#endif
