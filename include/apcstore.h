/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcstore.h
 * The second principle of the paper: shared data, as a store of time-stamped tables that may be anywhere. The
 * paper's own functions, on PostgreSQL, are in apcshareddata.h; a program that uses only this header needs no
 * header of libpq.
 */
#ifndef APCSTORE_H
#define APCSTORE_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Stores ------------------------------------------------------------------------------- */

/** Zero means default. */
struct apc_store_options {
    size_t size;
    const char *name;   /**< who is writing: application_name, and in refusals; default "libapc" */
    apc_ns timeout;     /**< for every operation, connecting included; default 2 s */
    apc_ns backoff_min; /**< first pause after a failed connect; default 100 ms */
    apc_ns backoff_max; /**< longest pause; default 5 s. Pauses double and are jittered */
    const char *spool;  /**< file for what the store cannot take at the moment; "": in memory, which ends with
                             the process; NULL: none. See below */
    uint64_t spool_size; /**< most bytes that may wait in it; default 256 MiB */
    bool chunks; /**< of a history in PostgreSQL: where apc_store_append() gets four or more samples of a
                    variable whose seqs follow each other, they become one row, which costs the server a
                    third. See apc_store_maintain(), `packed` */
    bool spool_or_memory; /**< where the spool cannot be on disk (full, read-only, no rights, no folder, no
                             descriptors), when it is opened or while nothing waits in it. Then it is in
                             memory, of at most 16 MiB, and stats.spool.instead says why. Else APC_ESTORE */
};

struct apc_store;

/** Bytes that hold the name of who wrote a row, with its terminator. */
#define APC_AUTHOR_LEN 64

/**
 * A store by URI (which one: docs/stores.md):
 * - `sqlite:FILE`, a file.
 * - `shm:NAME`, POSIX shared memory, for the processes of one user on one host (and in one PID namespace),
 *   until the machine stops or /dev/shm/apc.NAME is removed. It has the newest value and a recent history of
 *   every variable. `shm:NAME?size=MIB`, looked at by apc_store_init() only, makes it larger or smaller
 *   than 32 MiB. What no longer fits takes the place of the oldest; a new variable that does not, too many
 *   tags and a call of too many rows are refused with APC_ESTORE. Durable means: survives any process, not
 *   the machine.
 * - `mem:`, this process' memory, for virtual time and for tests: `mem:` alone is the handle's own.
 *   `mem:NAME` (at most 63 bytes) is shared by all handles of that name, of any thread, and gone when the
 *   last of them is closed. Its ticks allocate only when a variable's history doubles.
 * - `postgresql:` (the environment's database: PGHOST, PGSERVICE, ...) or `postgresql://...`, any libpq URI;
 *   `#NAME` at its end chooses the schema NAME, one a plant, default `apc`. A standby is refused, because a
 *   store is for writing, unless target_session_attrs in the URI or PGTARGETSESSIONATTRS says otherwise.
 * - `shm:NAME+HISTORY`, as well of mem:, where HISTORY is the URI of the store into which an apc_replication
 *   moves the rows of the first one. The newest rows, and all writes, are the live store's; older rows are
 *   the history's as far as it goes, and then the live store's, each row once. Rows of variables are told
 *   apart by seq; events and timing, whose numbers differ in the two, by their content. While the history is
 *   away, or where it is another experiment's, there is as much past as the live store has; the operation
 *   succeeds, and apc_store_error() says so after it. A number of an author that came with a row
 *   is one for this handle only.
 *
 * Nothing is connected yet: every operation connects when it has to, waits no longer than the timeout, and
 * after a failed connect to a server answers APC_ECONN at once until a jittered pause is over. One thread at
 * a time. [setup] Returns 0, APC_EINVAL (unknown scheme, malformed URI, not our spool), APC_EBUSY,
 * APC_ESTORE (the spool cannot be used), APC_ENOMEM.
 */
APC_API int apc_store_open(struct apc_store **store, const char *uri, const struct apc_store_options *options,
                           struct apc_error *why);
/** How much of a URI, from its beginning, is that of the live store: all of it, unless there is a `+HISTORY`.
 * [any] */
APC_API size_t apc_store_live(const char *uri);
struct apc_tag;
/**
 * For how long `shm:NAME?size=`@p mib keeps all rows of @p variables, of which each comes every `period` s
 * (0: only now and then), a vector with `length` elements. [setup] Returns s, INFINITY where none comes
 * regularly, 0 where there is no room for them (or for this to be found out).
 */
APC_API double apc_shm_holds(unsigned mib, const struct apc_tag *variables, size_t n);
/** How many timing rows `shm:NAME?size=`@p mib keeps; 0: of no such size. [any] */
APC_API unsigned apc_shm_timing_rows(unsigned mib);
APC_API void apc_store_close(struct apc_store *store); /**< NULL is legal. [setup] */
/** One line about the last failure; lives until the next call. [tick] */
APC_API const char *apc_store_error(const struct apc_store *store);
/** As of its last operation. [tick] */
APC_API bool apc_store_connected(const struct apc_store *store);

/** What waits in a spool, and what became of it since it was opened. */
struct apc_spool_stats {
    uint64_t samples, events; /**< waiting */
    uint64_t bytes, capacity; /**< they take, they may take */
    apc_ns oldest;            /**< source time of the first of them; 0: nothing waits */
    uint64_t drained;         /**< samples and events that went on to the store */
    uint64_t refused;         /**< samples and events: full, or the disk would not. Never acknowledged */
    uint64_t torn;            /**< bytes of a last, unfinished record, cut off when it was opened */
    int blocked;       /**< the error with which the store, which is there, refuses what is next; or 0 */
    uint64_t damaged;  /**< times that the file was set aside; by apc_spool_look(): 1 if it has to be ... */
    char aside[256];   /**< ... and as what, the last time */
    char instead[256]; /**< why it is in memory and not in its file; empty: it is where it should be */
};

/** Counters since it was opened. */
struct apc_store_stats {
    size_t size; /**< sizeof the struct, set by the caller: no more than that is filled */
    uint64_t connects;
    uint64_t round_trips;         /**< times it waited for the server */
    struct apc_spool_stats spool; /**< zeros: it has none. Last, as it may grow */
};
/** Zeros for NULL. [tick] */
APC_API void apc_store_stats(const struct apc_store *store, struct apc_store_stats *stats);

/*
 * Store and forward: a store with a spool acknowledges apc_store_append() and apc_store_append_events() also
 * while it is away (APC_ECONN, APC_ETIMEDOUT) or its disk is full (APC_EFULL). The rows are on disk in the
 * spool when the call returns. apc_store_error() then says why the store is offline. Once something waits,
 * everything goes through the spool, in order; apc_store_connect(), apc_store_append() and
 * apc_store_append_events() each drain a portion when the store is there, for about a tenth of the timeout.
 * While it is offline it is asked only now and then: after a call that waited, it is left alone for the same
 * time, the second time for twice that time, then for four times.
 *
 * - apc_store_claim() finds what a former writer left; `last` counts it in. When the store is offline it
 * succeeds if records wait, which say how far the writer had come. The claim is then taken before they drain;
 * if another writer has it (APC_EBUSY), they continue to wait. With an empty spool it is APC_ECONN, as
 *   without one.
 * - apc_store_read() gives, while the store is offline, the value that was last read or appended through this
 *   store. It has its own seq and time, and status UncertainLastUsableValue unless it is worse. APC_ECONN if
 *   one of the variables was never seen.
 * - APC_EBUSY, APC_ESCHEMA and APC_ECONFLICT from an append, met while draining, leave its rows in the spool.
 * - A spool that is full keeps what it has: a new append is then refused with APC_ESTORE, and counted in
 *   `refused`. What was acknowledged is never thrown away.
 * - Samples drain once: see apc_store_append(). A sample whose seq another writer took meanwhile, with
 *   another value, is found: the spool is set aside as FILE.conflict-TIME, and the answer is APC_ECONFLICT.
 *   Events that may have been stored already are looked up, if this user may read events, and left out if
 *   they are there.
 * - A spool of another writer (options->name) or for another store is refused by apc_store_open(), one that
 *   another process has in use too. One that is damaged is kept as FILE.damaged-TIME; what is readable
 *   goes on.
 *
 * All else goes to the store itself. Commands (setpoints, outputs, modes, tuning) must not be spooled: they
 * would come late and look new.
 */

/** A spool as it lies on disk. */
struct apc_spool_info {
    size_t size;                  /**< sizeof the struct, set by the caller: no more than that is filled */
    char writer[64], store[256];  /**< whose, and for which store, without secrets */
    struct apc_spool_stats stats; /**< last, as it may grow */
};
/** Look into a spool that another process may have in use. Behind what is damaged, too: then stats.damaged is
 * 1. [setup] Returns 0, APC_ENOTFOUND, APC_ESYS, APC_EPROTO: its header is damaged, APC_EINVAL: it is none.
 */
APC_API int apc_spool_look(const char *file, struct apc_spool_info *info, struct apc_error *why);

/*
 * Operations return 0 or a count, else an error. APC_ESCHEMA: run `apc init`; APC_EBUSY: the claim went to
 * another writer; APC_EFULL: the disk is full, nothing was written. APC_ESTORE: refused (constraint, damage,
 * ...); APC_ESTATE: called from inside the store's own history function. Also APC_ECONN, APC_ETIMEDOUT,
 * APC_EPERM, APC_EINVAL. Times are kept to the microsecond.
 *
 * After APC_ECONN or APC_ETIMEDOUT a write may or may not have taken place. To repeat it is harmless for
 * apc_store_append, apc_store_claim, apc_store_put_tags and apc_store_init. A repeated apc_store_put,
 * apc_store_append_events or apc_store_append_timing may write the same a second time: a put once more the
 * same value, under the next seq.
 */

/** Connect now instead of at the first operation. [setup] */
APC_API int apc_store_connect(struct apc_store *store);

/**
 * The newest sample of each of @p n variables, over any tables, in one round trip. In: table and id;
 * out: the rest. A variable without a sample gets seq 0, status BadNoData. Returns 0. [tick]
 */
APC_API int apc_store_read(struct apc_store *store, struct apc_sample *samples, size_t n);

/**
 * Append @p n samples, over any tables, atomically and in one round trip (two when a row is
 * there already); on return they are durable.
 * (table, id, seq) names a sample: one that is already there is left alone while the others are stored, so an
 * append whose answer was lost may be repeated. Returns how many this very call stored. Less than @p n: the
 * seq of the rest were taken, by an earlier try (or twice in this one) or, without one, by another writer.
 * [tick]
 */
APC_API int apc_store_append(struct apc_store *store, const struct apc_sample *samples, size_t n);

/**
 * apc_store_claim_set() of a table's ids 1..n; @p last gets the newest seq of each. While it is this store's
 * own former session, which the server has not been able to end yet, the answer is APC_ECONN: go on trying.
 * [setup]
 */
APC_API int apc_store_claim(struct apc_store *store, enum apc_table table, size_t n, int64_t *last);

/**
 * Become the one writer of @p n variables, of any tables, beside those that this store has claimed already;
 * all of them or none, as long as it is open or until apc_store_release(). In: table and id; out: seq, the
 * newest (0: none), from which the writer goes on counting. A lost connection takes the claims along; they
 * are renewed with the next connection. APC_EBUSY: another writer has one of them; apc_store_error() names
 * the variable and the writer. Of setpoints the claim is among programs: what people put needs none. [setup]
 */
APC_API int apc_store_claim_set(struct apc_store *store, struct apc_sample *variables, size_t n);
/** Give variables back, so that another writer may claim them; those that are not ours are left alone.
 * [setup] */
APC_API int apc_store_release(struct apc_store *store, const struct apc_sample *variables, size_t n);
/** The number of the claim that has a variable, larger than that of any claim before it; 0: it has no holder,
 * or the holder is gone. Returns 0; APC_EINVAL: this kind of store numbers none. Over shm: and postgresql:.
 * [setup] */
APC_API int apc_store_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder);
/**
 * Become the one writer, as by apc_store_claim_set(), of variables that the claim @p holder has, though its
 * writer lives: the successor of a writer that hangs or is cut off. The former writer is fenced: all that it
 * claimed is free, and all that it still writes through that handle is refused with APC_EBUSY, also writes on
 * their way. Over shm: until it releases or claims something; over postgresql: its session is ended, so both
 * have to be of the same role (else APC_EPERM). APC_EBUSY: another claim has one of them. [setup]
 */
APC_API int apc_store_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder);

/** The number of the newest claim of this store itself, also one renewed with a connection. It is larger than
 * that of any claim before it, so that a plant can tell an older writer's command from a newer one's
 * (apc_exchange_claim()). 0: it has claimed nothing, or is of a kind that numbers none. [any] */
APC_API uint64_t apc_store_claimed(const struct apc_store *store);

/**
 * Write operator variables (setpoint, opmode, tuning, manual), which have no single writer: read the newest,
 * append the successor with the sample's value, status, time and author, and try again when someone else was
 * faster.
 * seq is filled in. Returns 0, or APC_ECONFLICT after ten tries: then nothing was written. [setup]
 */
APC_API int apc_store_put(struct apc_store *store, struct apc_sample *samples, size_t n);

/**
 * Compare and set: as apc_store_put(), but each samples[i].seq is the newest one that the caller knows (0:
 * there is none). Nothing is written unless all of them are still the newest. Otherwise the answer is
 * APC_ECONFLICT, and @p samples are what is newest now, as from apc_store_read(). Returns 0 with the new seqs
 * filled in. After APC_ECONN or APC_ETIMEDOUT it may have taken place: a repeat then answers APC_ECONFLICT
 * and shows the caller's own values. [setup]
 */
APC_API int apc_store_swap(struct apc_store *store, struct apc_sample *samples, size_t n);

/**
 * The newest rows of variables over any tables, samples and vectors, of one moment and in one round trip. In:
 * table and id, of a vector also room and value. Out: the rest, as of apc_store_read(). @p n of a vector is
 * its length, of which no more than room elements are given: n > room says how much room it takes. A vector
 * without a row gets seq 0, n 0, status BadNoData. Returns 0. [tick]
 */
APC_API int apc_store_read_rows(struct apc_store *store, struct apc_rows *rows);

/**
 * Append rows over any tables in one transaction and one round trip (two when a row is there already); on
 * return they are durable.
 *
 * Rows of a table with one writer carry their seq and are stored as by apc_store_append(). A row of setpoint,
 * opmode, tuning or manual carries in seq the newest that the caller knows (0: there is none), or
 * APC_SEQ_ANY: whatever it is. On return its seq is that of the row, or 0: another writer was faster, and
 * only this row was left out. The same variable twice: the first goes before the second.
 *
 * Returns how many rows this very call stored. After APC_ECONN or APC_ETIMEDOUT, seq are as they were, and a
 * repeat leaves out what is there already: of one of the four tables the caller then looks at what is newest.
 * [tick]
 */
APC_API int apc_store_append_rows(struct apc_store *store, const struct apc_rows *rows);

/**
 * The author number of @p name (1 to 63 bytes) in its writes: a new name gets one, which stays. In PostgreSQL
 * each of the database's users has names of its own, and may write under those only. Returns the number,
 * above 0, APC_EINVAL: the name is empty or too long, or an error. [setup]
 */
APC_API int apc_store_author(struct apc_store *store, const char *name);
/** Whose number it is. Returns 0, APC_ENOTFOUND or an error; then @p name is empty. [setup] */
APC_API int apc_store_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);

/**
 * Wait until one of @p n variables has a sample newer than its @p seen[i].seq, no longer than @p timeout
 * (0: only look; longer by the store's own timeout at most when it cannot be reached). Of @p seen only table,
 * id and seq are looked at. Returns 1 when there is one (a read then gives it), at once when it is there
 * already; 0 when the time is up; an error as soon as the store is lost. The next call finds the rows that
 * were written meanwhile. A change between a read and the wait is never missed. n = 0 returns 0 at once.
 * [setup]
 */
APC_API int apc_store_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout);

/**
 * The variables that have samples, described or not: table and id of up to @p capacity, in that order.
 * Returns how many there are in all. [setup]
 */
APC_API int apc_store_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity);

/** Called for each row in rising seq; return nonzero to end early. */
typedef int (*apc_sample_fn)(void *ctx, const struct apc_sample *sample);

/** Zero means: no bound. */
struct apc_range {
    apc_ns since, until; /**< source time, since <= t < until */
    size_t last;         /**< at most so many, the newest */
    int64_t after;       /**< only rows whose seq, of events and timing whose number, is above it */
};
/** History of one variable, streamed in bounded memory. Returns the number of rows given. [setup] */
APC_API int apc_store_history(struct apc_store *store, enum apc_table table, int id,
                              const struct apc_range *range, apc_sample_fn fn, void *ctx);

/** Called for each row in rising seq; return nonzero to end early. The values live until it returns. */
typedef int (*apc_vector_fn)(void *ctx, const struct apc_vector *vector);
/** History of one variable of a table of vectors. Returns the number of rows given. [setup] */
APC_API int apc_store_vectors(struct apc_store *store, enum apc_table table, int id,
                              const struct apc_range *range, apc_vector_fn fn, void *ctx);

/** The contents of an interval of a variable's history: the samples of source time from <= t < until. */
struct apc_history_bin {
    apc_ns from, until;
    uint64_t count, bad;         /**< samples that are not Bad; samples that are */
    double min, max, mean, last; /**< of those not Bad; last: of the highest seq. 0 when count is 0. The last
                                    place of mean depends on how the store has added them up */
    apc_status worst;            /**< the highest status code among all: of the worst severity */
    int64_t seq;                 /**< the highest of all */
};
/** Called for each bin in rising time; return nonzero to end early. */
typedef int (*apc_history_bin_fn)(void *ctx, const struct apc_history_bin *bin);
/**
 * History of one variable in @p n intervals (1..APC_HISTORY_BINS) of equal length, made by the server. Bin i
 * begins at @p since + i * (@p until - @p since) / n, rounded down to the nanosecond, and ends where the next
 * one begins. Bins without samples are left out. Streamed in bounded memory. All of it has to be read before
 * the first bin comes: give the store a timeout for that. Returns the number of bins given. [setup]
 */
APC_API int apc_store_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since,
                                   apc_ns until, size_t n, apc_history_bin_fn fn, void *ctx);
#define APC_HISTORY_BINS 100000

/** How far a history is behind its live store. */
struct apc_behind {
    size_t size;   /**< in: of this struct */
    uint64_t rows; /**< samples and vectors that it has not got */
    apc_ns time;   /**< for how long the first of these has waited, if those of a variable came evenly */
    bool nothing;  /**< it has no row yet of all that the live store has: there is no such time */
};
/** Of `LIVE+HISTORY`, as of now. Returns 1; 0: it is one store, with no history; or an error, with the
 * reason why the history cannot be asked. [setup] */
APC_API int apc_store_behind(struct apc_store *store, struct apc_behind *behind);

/** The room of a store whose size is fixed when it is made. */
struct apc_store_room {
    size_t size;                       /**< in: of this struct */
    uint64_t variables, variables_max; /**< that have rows; that it can hold */
    uint64_t cells, cells_max;         /**< of 64 bytes, for rows: taken, and never given back; in all */
    uint64_t refused;                  /**< rows that found no room, since it was made */
    apc_ns refused_at;                 /**< when the last of them came, UTC; 0: there was none */
    bool full;            /**< a variable's row found no room, and none of that variable was written since */
    enum apc_table table; /**< while it is full: which variable's */
    int id;
    uint64_t tags_max;      /**< descriptions that it can hold */
    uint64_t catalogue_max; /**< bytes of a catalogue that it can hold, with its terminator */
};
/** How full it is, as of now. Rows of variables that have some go on then, the oldest give way. Returns 1; 0:
 * this kind of store has no fixed room; or an error. [setup] */
APC_API int apc_store_room(struct apc_store *store, struct apc_store_room *room);

/* ---- Descriptions, events, timing --------------------------------------------------------- */

#define APC_TAG_LEN 64

/** What a variable is called and may be. */
struct apc_tag {
    enum apc_table table;
    int id;
    char name[APC_TAG_LEN], unit[APC_TAG_LEN], description[APC_TAG_LEN * 2];
    double low, high;                 /**< limits, inclusive; -APC_VALUE_MAX and APC_VALUE_MAX: none */
    char controller[APC_TAG_LEN];     /**< whose it is; "": nobody's. Of table opmode, ids that have one are
                                         loops:     the tag's name is the loop's */
    char area[APC_TAG_LEN * 2];       /**< where in the plant: "unit1/reactor"; "": not said */
    double display_low, display_high; /**< ends of its scale; equal: not said */
    double period;                    /**< how often it comes, s; 0: not said */
    double step; /**< of a vector: s from element to element; 0: its elements are not spaced in time */
    int length;  /**< of a vector: its elements; 0: not said, or a sample */
};
/** Replace all descriptions by these, at once or not at all; for the schema's owner. Returns @p n. [setup] */
APC_API int apc_store_put_tags(struct apc_store *store, const struct apc_tag *tags, size_t n);
/**
 * The same, and with it, at once, what the plant is: @p catalogue, the experiment file's text in force, up to
 * APC_CATALOGUE_MAX bytes; NULL: it stays. A text that is another than before is the next revision. [setup]
 */
APC_API int apc_store_describe(struct apc_store *store, const struct apc_tag *tags, size_t n,
                               const char *catalogue);
#define APC_CATALOGUE_MAX (16 << 20)
/**
 * The catalogue in force, up to @p size bytes with its terminator (NULL and 0: none), and its revision, which
 * counts from 1; 0: there is none, which is no error. Returns the length of all of it. [setup]
 */
APC_API int apc_store_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision);
/** Up to @p capacity tags in order of table and id; returns how many there are in all. [setup] */
APC_API int apc_store_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity);

enum apc_event_severity { APC_EVENT_INFO = 1, APC_EVENT_WARNING, APC_EVENT_ALARM };

/** Something that happened: an operator's action, a mode change, loss of a connection, overruns. */
struct apc_event {
    apc_ns time;
    enum apc_event_severity severity;
    char source[32]; /**< the program, or the operator's name */
    /** "start", "stop", "mode", "operator", "link", "store", "measurement", "rejected", "watchdog",
     * "overrun", "clock", "alarm", "log", "handover", "health" */
    char kind[32];
    char text[192];
    int64_t number; /**< out: rises in the order in which they came to this store; from 1 */
};
/** All or none of them. Returns @p n; or APC_ERANGE besides the rest: the store refuses one for what it says,
 * a time that is far ahead, and always will. [setup] */
APC_API int apc_store_append_events(struct apc_store *store, const struct apc_event *events, size_t n);
typedef int (*apc_event_fn)(void *ctx, const struct apc_event *event);
/** Events in rising order. Returns the number given. [setup] */
APC_API int apc_store_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn,
                             void *ctx);

/** One histogram over one window, as stored. Nanoseconds. */
struct apc_timing_row {
    apc_ns time;       /**< end of the window, UTC */
    char task[32];     /**< "controller", ... */
    char quantity[16]; /**< "lateness", "jitter" or "run" */
    apc_ns period;
    uint64_t missed; /**< in the window */
    uint64_t count;
    double mean, sd;
    apc_ns p50, p99, max;
    const int64_t *bin_low, *bin_high, *bin_count; /**< filled buckets, n_bins of each */
    size_t n_bins;
    int64_t number; /**< out: as an event's */
};
/** All or none of them. Returns as apc_store_append_events() does. [setup] */
APC_API int apc_store_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
typedef int (*apc_timing_fn)(void *ctx, const struct apc_timing_row *row);
/** Rows in rising time; the bins live until fn returns. Returns the number given. [setup] */
APC_API int apc_store_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn,
                             void *ctx);

/* ---- From one store into another ---------------------------------------------------------- */

/**
 * Replication of one store into another: samples and vectors of all variables, events, timing, descriptions
 * with the catalogue, names of authors. Each row once, those of a variable in the order of their seqs, under
 * the seqs that they have. A restart goes on from the newest row of each variable in TO. Events and timing
 * have no seq: after a start, and after an append whose outcome is not known, it looks up which of them TO
 * has. What is missing in TO below its newest is not seen.
 */
struct apc_replication;

/** Of what was moved, and is to be moved. */
struct apc_replication_stats {
    size_t size;                               /**< in: of this struct */
    uint64_t samples, vectors, events, timing; /**< stored, since it was made */
    uint64_t
        behind; /**< samples and vectors that TO does not have yet: at most, as of the last read of FROM */
    bool away;  /**< the last step failed with TO, not with FROM */
    /** Rows that FROM no longer had when their turn came: seqs are missing in TO. */
    struct {
        uint64_t times, rows; /**< so many variables, each time that it was found; so many seqs in all */
        apc_ns since, until;  /**< source time of the rows before the oldest and after the newest of them */
    } gap;
    struct {
        uint64_t events, timing;
    } lost; /**< so many of these were overwritten in FROM before their turn came; at most, if nothing is left
                 there of what TO had at the start */
    uint64_t older; /**< so many times TO had less than it had taken, a backup that was restored: it is sent
                       again */
    /** Rows of TO that differ from FROM's row of the same number: another writer wrote there. They stay.
     */
    struct {
        uint64_t rows;
        enum apc_table table; /**< the last of them, with id and seq */
        int id;
        int64_t seq;
    } other;
    uint64_t refused; /**< events and rows of timing that TO refuses for what they say: APC_ERANGE */
};

/** Rows that FROM no longer had when their turn came, since the last report. */
struct apc_replication_gap {
    size_t size;             /**< of this struct */
    uint64_t variables;      /**< of so many rows are missing; 0: of none */
    apc_ns since, until;     /**< ... all of which lie between these source times */
    uint64_t events, timing; /**< so many of these are missing, at most */
};
/** Record it durably: it may call FROM. Returns 0; or an error of FROM's, and is called again. */
typedef int (*apc_replication_gap_fn)(void *ctx, const struct apc_replication_gap *gap);

/**
 * From @p from into @p to, both open; they stay the caller's, and nothing else uses them meanwhile. Nothing
 * is read yet. [setup] Returns 0, APC_EINVAL or APC_ENOMEM.
 */
APC_API int apc_replication_create(struct apc_replication **replication, struct apc_store *from,
                                   struct apc_store *to, struct apc_error *why);
APC_API void apc_replication_destroy(struct apc_replication *replication); /**< NULL is legal. [setup] */
/** Set the function that apc_replication_step() calls for gaps: before TO gets the rows after a gap. An event
 * that it records in FROM goes to TO before them. So each gap is reported, whenever a process ends. [setup]
 */
APC_API void apc_replication_tell(struct apc_replication *replication, apc_replication_gap_fn fn, void *ctx);
/**
 * Move what FROM has, in batches, until TO has it all or @p timeout has passed; a store that hangs is waited
 * for up to its own timeout. What it writes in TO it claims, so that there is one who does. Of samples and
 * vectors what TO has at the end of a whole step is FROM's as of one moment.
 *
 * Returns how many rows it stored, 0: TO had it all; or an error, after which it may be called again:
 * - APC_EPERM: TO belongs to another experiment. APC_EBUSY: another process writes it.
 * - APC_ECONFLICT: TO has rows that are newer than FROM's, or others under the same numbers, so that it has
 *   not got them from there, or from one whose clock was wrong.
 * - that of a store. [setup]
 */
APC_API int apc_replication_step(struct apc_replication *replication, apc_ns timeout);
/**
 * How much of FROM's room is left before it overwrites what TO has not got, of the variable where it is
 * least: 1 none of that is used, 0 the next row is lost. 1 as well while FROM overwrites nothing, as far as
 * two calls can tell. It reads all that FROM holds. [setup]
 */
APC_API double apc_replication_left(struct apc_replication *replication);
/** One line about the last failure; lives until the next call. [any] */
APC_API const char *apc_replication_error(const struct apc_replication *replication);
APC_API void apc_replication_stats(const struct apc_replication *replication,
                                   struct apc_replication_stats *stats); /**< [any] */

/**
 * A new live store continues from its history, before anything else is written in it: for each variable that
 * it lacks it takes the newest row, under its own seq. So the requests of people and the state of controllers
 * are there again, and seqs rise above all that went before. A live store without events gets one that says
 * since when nothing is on record. Where the history does not answer, seqs begin at (seconds since
 * 2020-01-02) x 2^20 instead (`shm:` only), above all that has been given out by then. Returns how many rows
 * it took over; or an error and why: also that of the history. [setup]
 */
APC_API int apc_store_take_over(struct apc_store *live, struct apc_store *history, struct apc_error *why);

/* ---- What people ask of a history --------------------------------------------------------- */

/** A write that a person requests in table `request` of a history, because the loop is elsewhere. */
struct apc_request {
    int64_t id;           /**< where it came first, in no order of time */
    apc_ns time;          /**< when it was asked for; with id it is one and no other */
    apc_ns age, left;     /**< since then, and until it must not be done any more, by the history's clock */
    enum apc_table table; /**< setpoint, opmode, tuning or manual */
    int variable;         /**< its id in that table */
    double value;
    int64_t seq; /**< of the row that it became, as far as it was answered; -1: nothing was said yet */
    char author[APC_AUTHOR_LEN];  /**< who asks, as the program says */
    char role[APC_AUTHOR_LEN];    /**< the database's user who did */
    char reason[APC_TAG_LEN * 2]; /**< for people; may be empty */
};
/** Called for each in rising id; return nonzero to end early. */
typedef int (*apc_request_fn)(void *ctx, const struct apc_request *request);
/** Those whose outcome has not been said, up to 64 of them. Of `postgresql:` only; of others there are none.
 * Returns the number given. [setup] */
APC_API int apc_store_requests(struct apc_store *store, apc_request_fn fn, void *ctx);
/** Answer a request that has no answer yet: @p seq of its row in the live store, 0: there is none;
 * @p outcome up to 191 bytes, NULL: that is still to come. Returns 0 or an error. [setup] */
APC_API int apc_store_answer(struct apc_store *store, int64_t id, int64_t seq, const char *outcome);
/** Say that the store is a history: a historian writes it, and what people want is asked for in
 * `postgresql:`, for its owner to say, and refused with APC_EPERM in `sqlite:`. Returns 1, 0 where that was
 * said before, or cannot be: nothing is described there yet, or of other kinds; or an error. [setup] */
APC_API int apc_store_keep_history(struct apc_store *store);
/** Has that been said? Returns 1, 0 or an error. [setup] */
APC_API int apc_store_is_history(struct apc_store *store);
/** Ask for @p request's value of its table and variable, under its author's name and with its reason. It gets
 * its id. Returns 0 or an error. [setup] */
APC_API int apc_store_ask(struct apc_store *store, struct apc_request *request);
/** What became of it, when that has been said: 1, 0: that is still to come, or an error. [setup] */
APC_API int apc_store_asked(struct apc_store *store, int64_t id, char *outcome, size_t size);

/* ---- A store as it was ------------------------------------------------------------------------ */

/**
 * A store as it stood at @p time, UTC, for reading: who reads what is newest gets the row that was newest
 * then, by its source time. So it is with histories, events and timing, which end there, and with the
 * catalogue, where the store keeps former ones; descriptions of variables are those of now. Writes are
 * refused with APC_EPERM.
 *
 * Where rows are missing in the record behind the one that is given, its status is UncertainLastUsableValue
 * instead of Good. apc_store_error() names one such place after an operation that succeeded, and says where
 * the experiment was described otherwise. Where the clock was set back, the last row of that time is given.
 *
 * @p store stays the caller's and open, and is not used meanwhile. [setup] Returns 0, APC_EINVAL (a time in
 * the future) or APC_ENOMEM.
 */
APC_API int apc_store_past(struct apc_store **past, struct apc_store *store, apc_ns time,
                           struct apc_error *why);

/* ---- Stores of a simulated plant -------------------------------------------------------------- */
/**
 * The clock of a plant that one process simulates, in a store `shm:` (also of LIVE+HISTORY). Its time
 * advances only while that process makes a tick. Other writers wait until the tick is made; people's writes
 * get the time of the next tick, before which they take effect.
 */
struct apc_store_clock {
    size_t size;
    apc_ns now;     /**< UTC of the plant */
    double asked;   /**< plant time / time; 0: it is paused; INFINITY: as fast as possible */
    double reached; /**< within the last second; below 0: the simulation has not started */
    uint64_t steps; /**< ticks still to run while it is paused */
    apc_ns rewind;  /**< UTC of the plant to which it is to go back; 0: it goes on */
};
/** Returns 1; 0, with zeros, if the plant is not simulated; or an error. [setup] */
APC_API int apc_store_clock(struct apc_store *store, struct apc_store_clock *clock);
/** Another speed, from 0 on, or INFINITY, and so many ticks where it is 0. Returns 0, APC_EINVAL, APC_ESTATE
 * (the plant is not simulated), or an error. [setup] */
APC_API int apc_store_set_speed(struct apc_store *store, double asked, uint64_t steps);
/** The plant is to go back to the time @p to, UTC, and to be paused there. Who simulates ends this store, and begins one
 * of the same name. Returns as apc_store_set_speed(). [setup] */
APC_API int apc_store_rewind(struct apc_store *store, apc_ns to);
/** The process's UTC becomes the store's, apc_clock_follow(), until the process ends. Returns as apc_store_clock().
 * [setup] */
APC_API int apc_store_follow(struct apc_store *store);
/** For who simulates: a tick begins. Returns how many rows others have written since the last one, or an error.
 * [setup] */
APC_API int64_t apc_store_begin_tick(struct apc_store *store);
/** And ends: @p now is the time of the next one. Without a tick that began: the plant is simulated from then on, and
 * paused. Returns 0 or an error. [setup] */
APC_API int apc_store_end_tick(struct apc_store *store, apc_ns now, double reached);

/** The instant that a store shows, UTC: that of apc_store_past(), of others now. [any] */
APC_API apc_ns apc_store_now(const struct apc_store *store);

/* ---- Set-up ------------------------------------------------------------------------------- */

/**
 * Make the schema, or bring an older one up to date, repairs included; harmless when it is current. Returns
 * the version it had (0: none; a newer one that this library works with is left alone), or APC_ESCHEMA when
 * it is newer than that. [setup]
 */
APC_API int apc_store_init(struct apc_store *store);

/** How long to keep what, by source time; zero: for ever. */
struct apc_retention {
    size_t size;
    apc_ns samples, events, timing;
    apc_ns ticks;  /**< tables tick and prediction, which grow fastest; samples are all other tables */
    apc_ns packed; /**< older samples of sensor, actuator, setpoint, actual and estimate are packed, a whole
                      week at a time, over sqlite: 1024 of a variable: less room, the same history; zero:
                      none are. By these two only */
};
/**
 * Housekeeping, as often as you like, while others use the store: make room ahead for what will come, and
 * drop what is older than @p keep (NULL: drop nothing). The newest sample of each variable stays in any case,
 * also in its history. What is dropped is at least as old, but a store that drops in larger pieces keeps some
 * of it until the whole piece is. For the schema's owner. [setup]
 * Returns the number of rows or pieces dropped, and of weeks or chunks packed, or an error.
 */
APC_API int apc_store_maintain(struct apc_store *store, const struct apc_retention *keep);
/**
 * Over `mem:`, for a program that takes the rows out as they become final. It drops the rows of sensor,
 * actuator, setpoint, actual and estimate, and all vectors, that are older than @p before, UTC. The newest of
 * each variable stays. From then on a row of those five tables that is as old is refused: who took the rows
 * out would never see it. [setup] Returns how many went, or an error; APC_EINVAL for a store of another kind.
 */
APC_API int64_t apc_store_forget(struct apc_store *store, apc_ns before);

/** A plant of a database: a schema with libapc's tables. */
struct apc_store_plant {
    size_t size;
    char schema[64]; /**< the part behind the # of its store's URI */
    bool owned;      /**< this user owns its tables and may call init and maintain */
    apc_ns newest;   /**< source time of its newest measurement, UTC; 0: none, or not for this user to read */
};
/** Called for each, by name; return nonzero to end early. */
typedef int (*apc_plant_fn)(void *ctx, const struct apc_store_plant *plant);
/**
 * Replace the content of a store of `sqlite:` by that of the backup file @p from, at once for all processes
 * that have it open; a missing store is made. The former content is kept in a file beside it, whose name @p
 * kept gets ("": there was none). [setup] Returns 0, APC_EBUSY: a process writes it, APC_ENOTFOUND,
 * APC_ESCHEMA: the one or the other is no record, APC_ESTORE: damaged, or as apc_store_init().
 */
APC_API int apc_store_restore(struct apc_store *store, const char *from, char *kept, size_t size);
/**
 * The plants in the database of a store of `postgresql:` that its user may look at; the schema of its own URI
 * need not be there. It opens another connection for that: claims of this store are taken again by its next
 * operation. Returns the number given; APC_EINVAL for a store of another kind; or as apc_store_connect().
 * [setup]
 */
APC_API int apc_store_plants(struct apc_store *store, apc_plant_fn fn, void *ctx);
/** The version of the tables that this library makes and knows. It works with a newer one as well if that
 * says so. [any] */
APC_API int apc_store_version(void);
/** The version of the tables that the store is connected to; 0: not connected. [any] */
APC_API int apc_store_tables_version(const struct apc_store *store);

#ifdef __cplusplus
}
#endif
#endif
