/* SPDX-License-Identifier: BSD-3-Clause */
/* The store in memory, between its files: mem.c says how it works. */
#ifndef APC_SHAREDDATA_MEM_H
#define APC_SHAREDDATA_MEM_H

#include <pthread.h>

#include "shareddata/shareddata_internal.h"

struct mem_vector {
    int64_t seq;
    apc_ns time;
    apc_status status;
    uint32_t n;
    size_t at; /* of its elements among the variable's */
};

/* It has rows of one kind. */
struct variable {
    enum apc_table table;
    int id;
    struct apc_sample *row;    /* in rising seq */
    struct mem_vector *vector; /* likewise */
    size_t n, capacity;
    double *value; /* elements of vectors, in order of arrival */
    size_t n_values, values_capacity;
    const struct apc_store *writer; /* who has claimed it */
    uint64_t reservation;           /* the last one with rows of it, */
    size_t want, want_values;       /* how many, and elements of vectors */
};

struct timing {
    struct apc_timing_row row; /* its buckets are the allocation that starts at bin_low */
    uint64_t number;           /* order of arrival */
};

/* What the handles of one name share. */
struct memory {
    char name[64];
    struct memory *next; /* of those with a name */
    size_t handles;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    unsigned waiters;
    int version; /* 0: there is no schema yet */
    struct variable *variable;
    size_t n, capacity;
    uint32_t *index; /* a hash table of 2 * capacity: 1 + the number of a variable, or 0 */
    uint64_t reservations;
    apc_ns forgotten; /* older rows of tables that grow have gone, and none comes any more */
    struct apc_tag *tag;
    size_t n_tags;
    char *catalogue; /* NULL: there is none */
    int64_t revision;
    char (*author)[APC_AUTHOR_LEN]; /* names of the numbers from 1 on */
    size_t n_authors, authors_capacity;
    struct apc_event *event; /* in order of arrival */
    size_t n_events, events_capacity;
    uint64_t dropped_events; /* so many came before event[0] */
    struct timing *timing;   /* in rising (time, number) */
    size_t n_timings, timings_capacity;
    uint64_t next_timing;
};

struct mem {
    struct apc_store base;
    struct memory *memory;
    bool connected;
};

static inline struct mem *apc_mem_of(struct apc_store *store)
{
    return (struct mem *)store;
}

static inline bool apc_mem_within(const struct apc_range *range, apc_ns time)
{
    return (range->since == 0 || time >= range->since) && (range->until == 0 || time < range->until);
}

static inline int apc_mem_no_memory(struct apc_store *store)
{
    return apc_fail(&store->why, APC_ENOMEM, "out of memory");
}

/* One row more, of so many elements, beside those of @p v that this reservation has counted. */
static inline void apc_mem_want(struct variable *v, uint64_t reservation, size_t elements)
{
    if (v->reservation != reservation) {
        v->reservation = reservation;
        v->want = v->want_values = 0;
    }
    v->want++;
    v->want_values += elements;
}

/* Room for @p n more of what @p array holds @p used of. It doubles, so n rows cost log n moves. */
int apc_mem_grow(struct apc_store *store, void **array, size_t *capacity, size_t used, size_t n, size_t size);

/* Every operation begins with it; on success the mutex is held until apc_mem_end(). */
int apc_mem_begin(struct apc_store *store);
/* The same where there need be no tables yet, or still are some. */
void apc_mem_begin_bare(struct apc_store *store);
void apc_mem_end(struct apc_store *store);

/* ---- mem.c, with the mutex held ------------------------------------------------------------------ */

static inline int64_t apc_mem_seq(const struct variable *v, size_t i)
{
    return v->vector ? v->vector[i].seq : v->row[i].seq;
}

static inline apc_ns apc_mem_time(const struct variable *v, size_t i)
{
    return v->vector ? v->vector[i].time : v->row[i].time;
}

static inline void apc_mem_wake(struct memory *m)
{
    if (m->waiters > 0) {
        pthread_cond_broadcast(&m->changed);
    }
}

struct variable *apc_mem_find(const struct memory *m, enum apc_table table, int id);
int apc_mem_find_or_add(struct apc_store *store, enum apc_table table, int id, struct variable **found);
/* The first row whose seq is not below @p seq. */
size_t apc_mem_lower_bound(const struct variable *v, int64_t seq);
/* The newest sample of @p s's variable. */
void apc_mem_newest(const struct memory *m, struct apc_sample *s);
int64_t apc_mem_newest_seq(const struct memory *m, enum apc_table table, int id);
/* From which seq on, so that the rows within the range are the newest range->last. */
int64_t apc_mem_first_seq(const struct variable *v, const struct apc_range *range);
/* Room for all of them. */
int apc_mem_reserve(struct apc_store *store, const struct apc_sample *samples, size_t n);
/* There is room. Returns whether the seq was free. */
bool apc_mem_insert(struct memory *m, const struct apc_sample *s);
/* Room for the targets of all loops. */
int apc_mem_reserve_loops(struct apc_store *store);
/* After a sample, there is room: where it is the mode of all, that of each loop. */
void apc_mem_insert_loops(struct apc_store *store, const struct apc_sample *s);

/* ---- mem_vectors.c ---------------------------------------------------------------------------- */

int apc_mem_read_rows(struct apc_store *store, struct apc_rows *rows);
int apc_mem_append_rows(struct apc_store *store, const struct apc_rows *rows);
int apc_mem_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_vector_fn fn, void *ctx);
/* Of what is older, but the newest stays; with the mutex held. Returns how many went. */
int apc_mem_drop_vectors(struct variable *v, apc_ns before);

/* ---- mem_records.c ---------------------------------------------------------------------------- */

int apc_mem_author(struct apc_store *store, const char *name);
int apc_mem_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);
int apc_mem_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue);
int apc_mem_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision);
int apc_mem_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity);
int apc_mem_append_events(struct apc_store *store, const struct apc_event *events, size_t n);
int apc_mem_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
int apc_mem_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
int apc_mem_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);
/* Of what is older; with the mutex held. They return how many went. */
int apc_mem_drop_events(struct memory *m, apc_ns before);
int apc_mem_drop_timings(struct memory *m, apc_ns before);
void apc_mem_free_records(struct memory *m);

#endif
