/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store of one process: `mem:` alone is its handle's own, `mem:NAME` is shared by every handle of that
 * name in the process, whatever its thread, and goes with the last of them. For virtual time and for tests.
 *
 * One mutex guards all of a store. A variable's samples are one array in rising seq, so the newest is its
 * last, a repeat is found by bisection, and history is a walk. An array that is full doubles: between
 * those moments, ever rarer, append and read allocate nothing. Everything that may fail comes before the
 * first change, so an operation is done as a whole or not at all.
 *
 * A caller's own function is never run under the mutex: rows go to it in batches of copies, and the walk
 * then goes on behind the last row given, whatever came or went in between.
 */
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "shareddata/shareddata_internal.h"

struct variable {
    enum apc_table table;
    int id;
    struct apc_sample *row; /* in rising seq */
    size_t n, capacity;
    size_t want; /* rows of the running append, at most */
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
    const struct apc_store *writer[APC_TABLE_END];
    struct variable *variable;
    size_t n, capacity;
    uint32_t *index; /* a hash table of 2 * capacity: 1 + the number of a variable, or 0 */
    struct apc_tag *tag;
    size_t n_tags;
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

/* The process' named memories. Only opening and closing touch them. */
static pthread_mutex_t names_mutex = PTHREAD_MUTEX_INITIALIZER;
static struct memory *names;

static struct mem *mem_of(struct apc_store *store)
{
    return (struct mem *)store;
}

static int no_memory(struct apc_store *store)
{
    return apc_fail(&store->why, APC_ENOMEM, "out of memory");
}

/* Room for @p n more of what @p array holds @p used of. It doubles, so n rows cost log n moves. */
static int grow(struct apc_store *store, void **array, size_t *capacity, size_t used, size_t n, size_t size)
{
    if (*capacity - used >= n) {
        return 0;
    }
    size_t most = 2 * *capacity > used + n ? 2 * *capacity : used + n;
    void *bigger = realloc(*array, (most < 16 ? 16 : most) * size);
    if (!bigger) {
        return no_memory(store);
    }
    *array = bigger;
    *capacity = most < 16 ? 16 : most;
    return 0;
}

/* ---- Life ---------------------------------------------------------------------------------- */

static void destroy_memory(struct memory *m)
{
    for (size_t i = 0; i < m->n; i++) {
        free(m->variable[i].row);
    }
    for (size_t i = 0; i < m->n_timings; i++) {
        free((void *)(uintptr_t)m->timing[i].row.bin_low);
    }
    free(m->variable);
    free(m->index);
    free(m->tag);
    free(m->event);
    free(m->timing);
    pthread_cond_destroy(&m->changed);
    pthread_mutex_destroy(&m->mutex);
    free(m);
}

static struct memory *create_memory(void)
{
    struct memory *m = (struct memory *)calloc(1, sizeof *m);
    pthread_condattr_t attr;
    if (!m || pthread_condattr_init(&attr) != 0) {
        free(m);
        return NULL;
    }
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    int e = pthread_cond_init(&m->changed, &attr);
    pthread_condattr_destroy(&attr);
    if (e == 0 && apc_mutex_init(&m->mutex) != 0) {
        pthread_cond_destroy(&m->changed);
        e = 1;
    }
    if (e) {
        free(m);
        return NULL;
    }
    return m;
}

/* The memory of that name, or a new one. */
static struct memory *find_memory(const char *name)
{
    struct memory *m = NULL;
    pthread_mutex_lock(&names_mutex);
    for (m = name[0] ? names : NULL; m && strcmp(m->name, name) != 0; m = m->next) {
    }
    if (!m) {
        m = create_memory();
        if (m && name[0]) {
            memcpy(m->name, name, strlen(name) + 1);
            m->next = names;
            names = m;
        }
    }
    if (m) {
        m->handles++;
    }
    pthread_mutex_unlock(&names_mutex);
    return m;
}

static void leave_memory(struct memory *m)
{
    pthread_mutex_lock(&names_mutex);
    bool last = --m->handles == 0;
    for (struct memory **at = &names; last && *at; at = &(*at)->next) {
        if (*at == m) {
            *at = m->next;
            break;
        }
    }
    pthread_mutex_unlock(&names_mutex);
    if (last) {
        destroy_memory(m);
    }
}

static void close_store(struct apc_store *store)
{
    struct memory *m = mem_of(store)->memory;
    pthread_mutex_lock(&m->mutex);
    for (int table = 0; table < APC_TABLE_END; table++) {
        if (m->writer[table] == store) {
            m->writer[table] = NULL;
        }
    }
    pthread_mutex_unlock(&m->mutex);
    leave_memory(m);
    free(store);
}

static int open_store(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                      struct apc_error *why)
{
    const char *name = uri + strlen(apc_mem_store.scheme);
    if (strlen(name) >= sizeof((struct memory *)0)->name) {
        return apc_fail(why, APC_EINVAL, "\"%.40s...\": the name is longer than 63 bytes", uri);
    }
    struct mem *mem = (struct mem *)calloc(1, sizeof *mem);
    if (mem) {
        mem->memory = find_memory(name);
    }
    if (!mem || !mem->memory) {
        free(mem);
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    mem->base.ops = &apc_mem_store;
    mem->base.config = *config;
    *store = &mem->base;
    return 0;
}

static bool connected(const struct apc_store *store)
{
    return ((const struct mem *)store)->connected;
}

/* Every operation begins with it; on success the mutex is held. */
static void begin_bare(struct apc_store *store)
{
    struct mem *mem = mem_of(store);
    if (!mem->connected) {
        mem->connected = true;
        store->stats.connects++;
    }
    store->stats.round_trips++;
    pthread_mutex_lock(&mem->memory->mutex);
}

static void end(struct apc_store *store)
{
    pthread_mutex_unlock(&mem_of(store)->memory->mutex);
}

static int begin(struct apc_store *store)
{
    begin_bare(store);
    if (mem_of(store)->memory->version == 0) {
        end(store);
        return apc_fail(&store->why, APC_ESCHEMA, "mem:%s has no tables yet: run apc_store_init()",
                        mem_of(store)->memory->name);
    }
    return 0;
}

static int connect_store(struct apc_store *store)
{
    int err = begin(store);
    if (!err) {
        end(store);
    }
    return err;
}

static int init(struct apc_store *store)
{
    struct memory *m = mem_of(store)->memory;
    begin_bare(store);
    int had = m->version;
    m->version = apc_store_version();
    end(store);
    return had;
}

/* ---- Variables ------------------------------------------------------------------------------ */

static size_t hash(enum apc_table table, int id, size_t size)
{
    uint64_t key = (uint64_t)table << 32 | (uint32_t)id;
    return (size_t)(key * UINT64_C(0x9E3779B97F4A7C15) >> 32) & (size - 1);
}

/* Where it is in the index, or the empty place where it belongs. */
static uint32_t *place(const struct memory *m, enum apc_table table, int id)
{
    for (size_t i = hash(table, id, 2 * m->capacity);; i = (i + 1) & (2 * m->capacity - 1)) {
        uint32_t number = m->index[i];
        if (number == 0 || (m->variable[number - 1].id == id && m->variable[number - 1].table == table)) {
            return &m->index[i];
        }
    }
}

static struct variable *find(const struct memory *m, enum apc_table table, int id)
{
    uint32_t number = m->n > 0 ? *place(m, table, id) : 0;
    return number ? &m->variable[number - 1] : NULL;
}

/* Twice the variables, and a new index. */
static int grow_variables(struct apc_store *store, struct memory *m)
{
    size_t capacity = m->capacity ? 2 * m->capacity : 64;
    uint32_t *index = (uint32_t *)calloc(2 * capacity, sizeof *index);
    struct variable *variable = (struct variable *)realloc(m->variable, capacity * sizeof *variable);
    if (variable) {
        m->variable = variable;
    }
    if (!index || !variable) {
        free(index);
        return no_memory(store);
    }
    free(m->index);
    m->index = index;
    m->capacity = capacity;
    for (size_t i = 0; i < m->n; i++) {
        *place(m, variable[i].table, variable[i].id) = (uint32_t)(i + 1);
    }
    return 0;
}

static int find_or_add(struct apc_store *store, enum apc_table table, int id, struct variable **found)
{
    struct memory *m = mem_of(store)->memory;
    *found = find(m, table, id);
    if (*found) {
        return 0;
    }
    if (m->n == m->capacity) {
        int err = grow_variables(store, m);
        if (err) {
            return err;
        }
    }
    m->variable[m->n] = (struct variable){.table = table, .id = id};
    *found = &m->variable[m->n++];
    *place(m, table, id) = (uint32_t)m->n;
    return 0;
}

/* The first row whose seq is not below @p seq. */
static size_t lower_bound(const struct variable *v, int64_t seq)
{
    size_t low = 0, high = v->n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (v->row[middle].seq < seq) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

static void copy_newest(const struct memory *m, struct apc_sample *s)
{
    const struct variable *v = find(m, s->table, s->id);
    if (v && v->n > 0) {
        *s = v->row[v->n - 1];
    } else {
        *s = (struct apc_sample){.table = s->table, .id = s->id, .status = APC_BAD_NO_DATA};
    }
}

static int64_t newest_seq(const struct memory *m, enum apc_table table, int id)
{
    const struct variable *v = find(m, table, id);
    return v && v->n > 0 ? v->row[v->n - 1].seq : 0;
}

/* ---- Read and write -------------------------------------------------------------------------- */

static int read_newest(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    int err = begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        copy_newest(mem_of(store)->memory, &samples[i]);
    }
    end(store);
    return 0;
}

/* Room for all of them. */
static int reserve(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    struct memory *m = mem_of(store)->memory;
    struct variable *v = NULL;
    size_t counted = 0;
    int err = 0;
    for (; !err && counted < n; counted += !err) {
        err = find_or_add(store, samples[counted].table, samples[counted].id, &v);
        if (!err) {
            v->want++;
        }
    }
    for (size_t i = 0; i < counted; i++) {
        v = &m->variable[*place(m, samples[i].table, samples[i].id) - 1];
        if (!err && v->want > 0) {
            err = grow(store, (void **)&v->row, &v->capacity, v->n, v->want, sizeof *v->row);
        }
        v->want = 0;
    }
    return err;
}

/* Field by field: to copy a struct that was just filled in costs more than all the rest. */
static void set_row(struct apc_sample *row, const struct apc_sample *s)
{
    const bool actuator = s->table == APC_ACTUATOR;
    row->table = s->table;
    row->id = s->id;
    row->seq = s->seq;
    row->time = apc_time_stored(s->time);
    row->value = s->value;
    row->status = s->status;
    row->sensor_seq = actuator ? s->sensor_seq : 0;
    row->setpoint_seq = actuator ? s->setpoint_seq : 0;
}

/* There is room. Returns whether the seq was free. */
static bool insert(struct memory *m, const struct apc_sample *s)
{
    struct variable *v = &m->variable[*place(m, s->table, s->id) - 1];
    size_t at = v->n == 0 || v->row[v->n - 1].seq < s->seq ? v->n : lower_bound(v, s->seq);
    if (at < v->n && v->row[at].seq == s->seq) {
        return false;
    }
    if (at < v->n) {
        memmove(&v->row[at + 1], &v->row[at], (v->n - at) * sizeof *v->row);
    }
    set_row(&v->row[at], s);
    v->n++;
    return true;
}

/* Insert all and wake those who wait. Returns how many seq were free. */
static int insert_all(struct memory *m, const struct apc_sample *samples, size_t n)
{
    int count = 0;
    for (size_t i = 0; i < n; i++) {
        count += insert(m, &samples[i]);
    }
    if (m->waiters > 0) {
        pthread_cond_broadcast(&m->changed);
    }
    return count;
}

static int append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    int err = apc_rows_check(store, samples, n);
    if (!err) {
        err = begin(store);
    }
    if (err) {
        return err;
    }
    err = reserve(store, samples, n);
    int count = err ? 0 : insert_all(mem_of(store)->memory, samples, n);
    end(store);
    return err ? err : count;
}

/* Each becomes its variable's next. */
static int write_next(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct memory *m = mem_of(store)->memory;
    int err = reserve(store, samples, n);
    for (size_t i = 0; !err && i < n; i++) {
        if (newest_seq(m, samples[i].table, samples[i].id) >= APC_SEQ_MAX) {
            err = apc_rows_seq_failure(store, &samples[i]);
        }
    }
    if (!err) {
        for (size_t i = 0; i < n; i++) {
            samples[i].seq = newest_seq(m, samples[i].table, samples[i].id) + 1;
        }
        insert_all(m, samples, n);
    }
    return err;
}

static int put_or_swap(struct apc_store *store, struct apc_sample *samples, size_t n, bool compare)
{
    struct memory *m = mem_of(store)->memory;
    int err = apc_rows_check(store, samples, n);
    if (!err) {
        err = begin(store);
    }
    if (err) {
        return err;
    }
    bool newest = true;
    for (size_t i = 0; compare && i < n; i++) {
        newest = newest && samples[i].seq == newest_seq(m, samples[i].table, samples[i].id);
    }
    if (newest) {
        err = write_next(store, samples, n);
    } else {
        for (size_t i = 0; i < n; i++) {
            copy_newest(m, &samples[i]);
        }
        err = apc_fail(&store->why, APC_ECONFLICT, "someone else has changed it meanwhile");
    }
    end(store);
    return err;
}

static int put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    return put_or_swap(store, samples, n, false);
}

static int swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    return put_or_swap(store, samples, n, true);
}

static int claim(struct apc_store *store, enum apc_table table, size_t n, int64_t *last)
{
    struct memory *m = mem_of(store)->memory;
    int err = begin(store);
    if (err) {
        return err;
    }
    if (m->writer[table] && m->writer[table] != store) {
        err = apc_fail(&store->why, APC_EBUSY, "table %s of mem:%s is already written by %s: stop it first",
                       apc_table_name(table), m->name, m->writer[table]->config.name);
    } else {
        m->writer[table] = store;
        for (size_t i = 0; i < n; i++) {
            last[i] = newest_seq(m, table, (int)i + 1);
        }
    }
    end(store);
    return err;
}

static bool any_newer(const struct memory *m, const struct apc_sample *seen, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (newest_seq(m, seen[i].table, seen[i].id) > seen[i].seq) {
            return true;
        }
    }
    return false;
}

static int wait_newer(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    struct memory *m = mem_of(store)->memory;
    const apc_ns now = apc_clock_mono(NULL), until = timeout < INT64_MAX - now ? now + timeout : INT64_MAX;
    const struct timespec deadline = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                      .tv_nsec = (long)(until % APC_NS_PER_S)};
    int err = begin(store);
    if (err) {
        return err;
    }
    m->waiters++;
    bool newer = any_newer(m, seen, n);
    for (int e = timeout > 0 ? 0 : 1; !newer && e == 0; newer = any_newer(m, seen, n)) {
        e = pthread_cond_timedwait(&m->changed, &m->mutex, &deadline);
    }
    m->waiters--;
    end(store);
    return newer;
}

/* ---- History --------------------------------------------------------------------------------- */

static bool within(const struct apc_range *range, apc_ns time)
{
    return (range->since == 0 || time >= range->since) && (range->until == 0 || time < range->until);
}

/* From which seq on, so that the rows within the range are the newest range->last. */
static int64_t first_seq(const struct variable *v, const struct apc_range *range)
{
    size_t left = range->last;
    for (size_t i = v->n; left > 0 && i > 0; i--) {
        left -= within(range, v->row[i - 1].time);
        if (left == 0) {
            return v->row[i - 1].seq;
        }
    }
    return 0;
}

#define BATCH 128

/* Copies of up to BATCH rows from *next on; *next is where to go on. */
static size_t copy_rows(const struct variable *v, const struct apc_range *range, int64_t *next, int64_t last,
                        struct apc_sample *out)
{
    size_t n = 0;
    for (size_t i = lower_bound(v, *next); i < v->n && v->row[i].seq <= last && n < BATCH; i++) {
        if (within(range, v->row[i].time)) {
            out[n++] = v->row[i];
        }
        *next = v->row[i].seq + 1;
    }
    return n;
}

static int history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_sample_fn fn, void *ctx)
{
    struct memory *m = mem_of(store)->memory;
    struct apc_sample row[BATCH];
    int64_t next = -1, last = 0;
    int count = 0;
    size_t n = BATCH;
    while (n == BATCH) {
        int err = begin(store);
        if (err) {
            return err;
        }
        const struct variable *v = find(m, table, id);
        if (v && next < 0) {
            next = first_seq(v, range);
            last = newest_seq(m, table, id);
        }
        n = v ? copy_rows(v, range, &next, last, row) : 0;
        end(store);
        store->streaming = true;
        for (size_t i = 0; i < n; i++) {
            count += count < INT_MAX;
            if (fn(ctx, &row[i]) != 0) {
                n = 0;
            }
        }
        store->streaming = false;
    }
    return count;
}

static int variables(struct apc_store *store, struct apc_sample *out, size_t capacity)
{
    struct memory *m = mem_of(store)->memory;
    size_t n = 0;
    int err = begin(store);
    if (err) {
        return err;
    }
    struct apc_sample *all = (struct apc_sample *)malloc((m->n + 1) * sizeof *all);
    for (size_t i = 0; all && i < m->n; i++) {
        if (m->variable[i].n > 0) {
            all[n++] = m->variable[i].row[0];
        }
    }
    end(store);
    return all ? apc_variables_give(all, n, out, capacity) : no_memory(store);
}

/* ---- Tags ---------------------------------------------------------------------------------- */

static int put_tags(struct apc_store *store, const struct apc_tag *tags, size_t n)
{
    struct memory *m = mem_of(store)->memory;
    struct apc_tag *sorted = NULL;
    int err = apc_tags_sort(store, tags, n, &sorted);
    if (!err) {
        err = begin(store);
    }
    if (!err) {
        struct apc_tag *former = m->tag;
        m->tag = sorted;
        m->n_tags = n;
        end(store);
        sorted = former;
    }
    free(sorted);
    return err ? err : (int)n;
}

static int get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct memory *m = mem_of(store)->memory;
    int err = begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < capacity && i < m->n_tags; i++) {
        tags[i] = m->tag[i];
    }
    int n = (int)m->n_tags;
    end(store);
    return n;
}

/* ---- Events -------------------------------------------------------------------------------- */

static int append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    struct memory *m = mem_of(store)->memory;
    int err = begin(store);
    if (err) {
        return err;
    }
    err = grow(store, (void **)&m->event, &m->events_capacity, m->n_events, n, sizeof *m->event);
    for (size_t i = 0; !err && i < n; i++) {
        m->event[m->n_events++] = apc_event_row(&events[i]);
    }
    end(store);
    return err ? err : (int)n;
}

/* The number of the first event, so that those within the range are the newest range->last. */
static uint64_t first_event(const struct memory *m, const struct apc_range *range)
{
    size_t left = range->last, i = m->n_events;
    while (i > 0 && (range->last == 0 || left > 0)) {
        left -= within(range, m->event[--i].time);
    }
    return m->dropped_events + i;
}

/* The next event within the range. */
static bool next_event(const struct memory *m, const struct apc_range *range, uint64_t *next, uint64_t until,
                       struct apc_event *out)
{
    *next = *next < m->dropped_events ? m->dropped_events : *next;
    while (*next < until) {
        const struct apc_event *e = &m->event[(*next)++ - m->dropped_events];
        if (within(range, e->time)) {
            *out = *e;
            return true;
        }
    }
    return false;
}

static int events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct memory *m = mem_of(store)->memory;
    int err = begin(store);
    if (err) {
        return err;
    }
    uint64_t next = first_event(m, range), until = m->dropped_events + m->n_events;
    int count = 0;
    bool ended = false;
    struct apc_event e;
    while (!ended && next_event(m, range, &next, until, &e)) {
        end(store);
        store->streaming = true;
        count += count < INT_MAX;
        ended = fn(ctx, &e) != 0;
        store->streaming = false;
        begin_bare(store);
    }
    end(store);
    return count;
}

/* ---- Timing -------------------------------------------------------------------------------- */

/* Copy a row's buckets into one allocation, or none. */
static int copy_bins(struct apc_store *store, struct apc_timing_row *row)
{
    const size_t n = row->n_bins, size = n * sizeof(int64_t);
    int64_t *bins = n > 0 ? (int64_t *)malloc(3 * size) : NULL;
    if (n > 0 && !bins) {
        return no_memory(store);
    }
    if (n > 0) {
        memcpy(bins, row->bin_low, size);
        memcpy(bins + n, row->bin_high, size);
        memcpy(bins + 2 * n, row->bin_count, size);
    }
    row->bin_low = bins;
    row->bin_high = n > 0 ? bins + n : NULL;
    row->bin_count = n > 0 ? bins + 2 * n : NULL;
    return 0;
}

static void free_bins(const struct apc_timing_row *row)
{
    free((void *)(uintptr_t)row->bin_low);
}

/* The first row that does not come before (time, number). */
static size_t timing_bound(const struct memory *m, apc_ns time, uint64_t number)
{
    size_t i = m->n_timings;
    while (i > 0 && (m->timing[i - 1].row.time > time ||
                     (m->timing[i - 1].row.time == time && m->timing[i - 1].number >= number))) {
        i--;
    }
    return i;
}

static int append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    struct memory *m = mem_of(store)->memory;
    int err = apc_timing_check(store, rows, n);
    struct apc_timing_row *copy = err ? NULL : (struct apc_timing_row *)calloc(n, sizeof *copy);
    size_t copied = 0;
    if (!err && !copy) {
        err = no_memory(store);
    }
    for (; !err && copied < n; copied += !err) {
        copy[copied] = apc_timing_stored(&rows[copied]);
        err = copy_bins(store, &copy[copied]);
    }
    if (!err && (err = begin(store)) == 0) {
        err = grow(store, (void **)&m->timing, &m->timings_capacity, m->n_timings, n, sizeof *m->timing);
        for (size_t i = 0; !err && i < n; i++) {
            size_t at = timing_bound(m, copy[i].time, m->next_timing);
            memmove(&m->timing[at + 1], &m->timing[at], (m->n_timings++ - at) * sizeof *m->timing);
            m->timing[at] = (struct timing){.row = copy[i], .number = m->next_timing++};
        }
        end(store);
    }
    for (size_t i = 0; err && i < copied; i++) {
        free_bins(&copy[i]);
    }
    free(copy);
    return err ? err : (int)n;
}

static size_t first_timing(const struct memory *m, const struct apc_range *range)
{
    size_t left = range->last, i = m->n_timings;
    while (i > 0 && (range->last == 0 || left > 0)) {
        left -= within(range, m->timing[--i].row.time);
    }
    return i;
}

static int timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct memory *m = mem_of(store)->memory;
    int err = begin(store);
    if (err) {
        return err;
    }
    const uint64_t until = m->next_timing;
    size_t i = first_timing(m, range);
    int count = 0;
    bool ended = false;
    while (!err && !ended && i < m->n_timings) {
        struct timing t = m->timing[i++];
        if (t.number >= until || !within(range, t.row.time)) {
            continue;
        }
        err = copy_bins(store, &t.row);
        if (!err) {
            end(store);
            store->streaming = true;
            count += count < INT_MAX;
            ended = fn(ctx, &t.row) != 0;
            store->streaming = false;
            free_bins(&t.row);
            begin_bare(store);
            i = timing_bound(m, t.row.time, t.number + 1);
        }
    }
    end(store);
    return err ? err : count;
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* The newest stays whatever its age. */
static int drop_samples(struct variable *v, apc_ns before)
{
    size_t kept = 0;
    const size_t n = v->n;
    for (size_t i = 0; i < n; i++) {
        if (v->row[i].time >= before || i + 1 == n) {
            v->row[kept++] = v->row[i];
        }
    }
    v->n = kept;
    return (int)(n - kept);
}

/* Events are numbered as they came: only the oldest ones can go. */
static int drop_events(struct memory *m, apc_ns before)
{
    size_t n = 0;
    while (n < m->n_events && m->event[n].time < before) {
        n++;
    }
    m->n_events -= n;
    m->dropped_events += n;
    memmove(m->event, m->event + n, m->n_events * sizeof *m->event);
    return (int)n;
}

static int drop_timings(struct memory *m, apc_ns before)
{
    size_t n = 0;
    while (n < m->n_timings && m->timing[n].row.time < before) {
        free_bins(&m->timing[n++].row);
    }
    m->n_timings -= n;
    memmove(m->timing, m->timing + n, m->n_timings * sizeof *m->timing);
    return (int)n;
}

static int maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct memory *m = mem_of(store)->memory;
    const apc_ns now = apc_clock_utc(NULL);
    int err = begin(store), dropped = 0;
    if (err) {
        return err;
    }
    for (size_t i = 0; keep->samples > 0 && i < m->n; i++) {
        dropped += drop_samples(&m->variable[i], now - keep->samples);
    }
    if (keep->events > 0 && m->n_events > 0) {
        dropped += drop_events(m, now - keep->events);
    }
    if (keep->timing > 0 && m->n_timings > 0) {
        dropped += drop_timings(m, now - keep->timing);
    }
    end(store);
    return dropped;
}

const struct apc_store_ops apc_mem_store = {
    .scheme = "mem:",
    .open = open_store,
    .close = close_store,
    .connected = connected,
    .connect = connect_store,
    .read = read_newest,
    .append = append,
    .claim = claim,
    .put = put,
    .swap = swap,
    .wait = wait_newer,
    .variables = variables,
    .history = history,
    .history_bins = apc_bins_by_history,
    .put_tags = put_tags,
    .get_tags = get_tags,
    .append_events = append_events,
    .events = events,
    .append_timing = append_timing,
    .timing = timing,
    .init = init,
    .maintain = maintain,
};
