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

#include "shareddata/mem/mem.h"

/* The process' named memories. Only opening and closing touch them. */
static pthread_mutex_t names_mutex = PTHREAD_MUTEX_INITIALIZER;
static struct memory *names;

int apc_mem_grow(struct apc_store *store, void **array, size_t *capacity, size_t used, size_t n, size_t size)
{
    if (*capacity - used >= n) {
        return 0;
    }
    size_t most = 2 * *capacity > used + n ? 2 * *capacity : used + n;
    void *bigger = realloc(*array, (most < 16 ? 16 : most) * size);
    if (!bigger) {
        return apc_mem_no_memory(store);
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
        free(m->variable[i].vector);
        free(m->variable[i].value);
    }
    free(m->variable);
    free(m->index);
    apc_mem_free_records(m);
    pthread_cond_destroy(&m->changed);
    pthread_mutex_destroy(&m->mutex);
    free(m);
}

static struct memory *create_memory(void)
{
    struct memory *m = (struct memory *)calloc(1, sizeof *m);
    pthread_condattr_t attr;
    if (m) {
        m->forgotten = INT64_MIN;
    }
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

static void mem_close(struct apc_store *store)
{
    struct memory *m = apc_mem_of(store)->memory;
    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i < m->n; i++) {
        if (m->variable[i].writer == store) {
            m->variable[i].writer = NULL;
        }
    }
    pthread_mutex_unlock(&m->mutex);
    leave_memory(m);
    free(store);
}

static int mem_open(struct apc_store **store, const char *uri, const struct apc_store_config *config,
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

static bool mem_connected(const struct apc_store *store)
{
    return ((const struct mem *)store)->connected;
}

void apc_mem_begin_bare(struct apc_store *store)
{
    struct mem *mem = apc_mem_of(store);
    if (!mem->connected) {
        mem->connected = true;
        store->stats.connects++;
    }
    store->stats.round_trips++;
    pthread_mutex_lock(&mem->memory->mutex);
}

void apc_mem_end(struct apc_store *store)
{
    pthread_mutex_unlock(&apc_mem_of(store)->memory->mutex);
}

int apc_mem_begin(struct apc_store *store)
{
    apc_mem_begin_bare(store);
    if (apc_mem_of(store)->memory->version == 0) {
        apc_mem_end(store);
        return apc_fail(&store->why, APC_ESCHEMA, "mem:%s has no tables yet: run apc_store_init()",
                        apc_mem_of(store)->memory->name);
    }
    return 0;
}

static int mem_connect(struct apc_store *store)
{
    int err = apc_mem_begin(store);
    if (!err) {
        apc_mem_end(store);
    }
    return err;
}

static int mem_init(struct apc_store *store)
{
    struct memory *m = apc_mem_of(store)->memory;
    apc_mem_begin_bare(store);
    int had = m->version;
    m->version = apc_store_version();
    apc_mem_end(store);
    return had;
}

/* ---- Variables ------------------------------------------------------------------------------ */

static size_t hash(enum apc_table table, int id, size_t size)
{
    uint64_t key = (uint64_t)table << 32 | (uint32_t)id;
    return (size_t)(key * UINT64_C(0x9E3779B97F4A7C15) >> 32) & (size - 1);
}

/* Where it is in the index, or the empty place where it belongs. */
static uint32_t *mem_index_place(const struct memory *m, enum apc_table table, int id)
{
    for (size_t i = hash(table, id, 2 * m->capacity);; i = (i + 1) & (2 * m->capacity - 1)) {
        uint32_t number = m->index[i];
        if (number == 0 || (m->variable[number - 1].id == id && m->variable[number - 1].table == table)) {
            return &m->index[i];
        }
    }
}

struct variable *apc_mem_find(const struct memory *m, enum apc_table table, int id)
{
    uint32_t number = m->n > 0 ? *mem_index_place(m, table, id) : 0;
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
        return apc_mem_no_memory(store);
    }
    free(m->index);
    m->index = index;
    m->capacity = capacity;
    for (size_t i = 0; i < m->n; i++) {
        /* NOLINTNEXTLINE(clang-analyzer-core.CallAndMessage): the first n came along from before realloc() */
        *mem_index_place(m, variable[i].table, variable[i].id) = (uint32_t)(i + 1);
    }
    return 0;
}

int apc_mem_find_or_add(struct apc_store *store, enum apc_table table, int id, struct variable **found)
{
    struct memory *m = apc_mem_of(store)->memory;
    *found = apc_mem_find(m, table, id);
    if (*found) {
        return 0;
    }
    if (m->n == m->capacity) {
        int err = grow_variables(store, m);
        if (err) {
            return err;
        }
    }
    /* NOLINTNEXTLINE(clang-analyzer-core.NullDereference): there are capacity of them, more than n */
    m->variable[m->n] = (struct variable){.table = table, .id = id};
    *found = &m->variable[m->n++];
    *mem_index_place(m, table, id) = (uint32_t)m->n;
    return 0;
}

size_t apc_mem_lower_bound(const struct variable *v, int64_t seq)
{
    size_t low = 0, high = v->n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (apc_mem_seq(v, middle) < seq) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

void apc_mem_newest(const struct memory *m, struct apc_sample *s)
{
    const struct variable *v = apc_mem_find(m, s->table, s->id);
    if (v && v->n > 0) {
        *s = v->row[v->n - 1];
    } else {
        *s = (struct apc_sample){.table = s->table, .id = s->id, .status = APC_BAD_NO_DATA};
    }
}

int64_t apc_mem_newest_seq(const struct memory *m, enum apc_table table, int id)
{
    const struct variable *v = apc_mem_find(m, table, id);
    return v && v->n > 0 ? apc_mem_seq(v, v->n - 1) : 0;
}

/* ---- Read and write -------------------------------------------------------------------------- */

static int mem_read_newest(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        apc_mem_newest(apc_mem_of(store)->memory, &samples[i]);
    }
    apc_mem_end(store);
    return 0;
}

static bool is_forgotten(const struct memory *m, const struct apc_sample *s)
{
    return s->time < m->forgotten && apc_table_packed(s->table) && apc_time_stored(s->time) < m->forgotten;
}

int apc_mem_reserve(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    const uint64_t reservation = ++apc_mem_of(store)->memory->reservations;
    struct variable *v = NULL;
    int err = 0;
    for (size_t i = 0; !err && i < n; i++) {
        err = is_forgotten(apc_mem_of(store)->memory, &samples[i])
                  ? apc_fail(&store->why, APC_ESTATE, "%s %d: a row older than those that were forgotten",
                             apc_table_name(samples[i].table), samples[i].id)
                  : apc_mem_find_or_add(store, samples[i].table, samples[i].id, &v);
        if (!err) {
            apc_mem_want(v, reservation, 0);
            err = apc_mem_grow(store, (void **)&v->row, &v->capacity, v->n, v->want, sizeof *v->row);
        }
    }
    return err;
}

/* Field by field: to copy a struct that was just filled in costs more than all the rest. */
static void set_row(struct apc_sample *row, const struct apc_sample *s)
{
    row->table = s->table;
    row->id = s->id;
    row->seq = s->seq;
    row->time = apc_time_stored(s->time);
    row->value = s->value;
    row->status = s->status;
    row->origin = s->origin;
    row->author = s->author;
}

bool apc_mem_insert(struct memory *m, const struct apc_sample *s)
{
    struct variable *v = &m->variable[*mem_index_place(m, s->table, s->id) - 1];
    size_t at = v->n == 0 || v->row[v->n - 1].seq < s->seq ? v->n : apc_mem_lower_bound(v, s->seq);
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

int apc_mem_reserve_loops(struct apc_store *store)
{
    const struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_reserve(store, store->loop, store->n_loops);
    for (size_t k = 0; !err && k < store->n_loops; k++) {
        if (apc_mem_newest_seq(m, APC_OPMODE, store->loop[k].id) >= APC_SEQ_MAX) {
            err = apc_rows_seq_failure(store, &store->loop[k]);
        }
    }
    return err;
}

void apc_mem_insert_loops(struct apc_store *store, const struct apc_sample *s)
{
    struct memory *m = apc_mem_of(store)->memory;
    for (size_t k = 0; apc_is_of_all(s) && k < store->n_loops; k++) {
        const struct apc_sample row =
            apc_loop_row(store, s, k, apc_mem_newest_seq(m, APC_OPMODE, store->loop[k].id));
        apc_mem_insert(m, &row);
    }
}

/* Insert all and wake those who wait. Returns how many seq were free. */
static int insert_all(struct memory *m, const struct apc_sample *samples, size_t n)
{
    int count = 0;
    for (size_t i = 0; i < n; i++) {
        count += apc_mem_insert(m, &samples[i]);
    }
    apc_mem_wake(m);
    return count;
}

static int mem_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    int err = apc_rows_check(store, samples, n);
    if (!err) {
        err = apc_mem_begin(store);
    }
    if (err) {
        return err;
    }
    err = apc_mem_reserve(store, samples, n);
    int count = err ? 0 : insert_all(apc_mem_of(store)->memory, samples, n);
    apc_mem_end(store);
    return err ? err : count;
}

/* Each becomes its variable's next. */
static int mem_write_next(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_reserve(store, samples, n);
    if (!err) {
        err = apc_mem_reserve_loops(store);
    }
    for (size_t i = 0; !err && i < n; i++) {
        if (apc_mem_newest_seq(m, samples[i].table, samples[i].id) >= APC_SEQ_MAX) {
            err = apc_rows_seq_failure(store, &samples[i]);
        }
    }
    if (!err) {
        for (size_t i = 0; i < n; i++) {
            samples[i].seq = apc_mem_newest_seq(m, samples[i].table, samples[i].id) + 1;
            apc_mem_insert_loops(store, &samples[i]);
        }
        insert_all(m, samples, n);
    }
    return err;
}

static int put_or_swap(struct apc_store *store, struct apc_sample *samples, size_t n, bool compare)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_rows_check(store, samples, n);
    if (!err) {
        err = apc_mem_begin(store);
    }
    if (err) {
        return err;
    }
    bool newest = true;
    for (size_t i = 0; compare && i < n; i++) {
        newest = newest && samples[i].seq == apc_mem_newest_seq(m, samples[i].table, samples[i].id);
    }
    if (newest) {
        err = mem_write_next(store, samples, n);
    } else {
        for (size_t i = 0; i < n; i++) {
            apc_mem_newest(m, &samples[i]);
        }
        err = apc_fail(&store->why, APC_ECONFLICT, "someone else has changed it meanwhile");
    }
    apc_mem_end(store);
    return err;
}

static int mem_put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    return put_or_swap(store, samples, n, false);
}

static int mem_swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    return put_or_swap(store, samples, n, true);
}

static int mem_claim(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    struct memory *m = apc_mem_of(store)->memory;
    struct variable *v = NULL;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && i < n; i++) {
        err = apc_mem_find_or_add(store, variables[i].table, variables[i].id, &v);
        if (!err && v->writer && v->writer != store) {
            err = apc_fail(&store->why, APC_EBUSY, "%s %d of mem:%s is already written by %s: stop it first",
                           apc_table_name(v->table), v->id, m->name, v->writer->config.name);
        }
    }
    for (size_t i = 0; !err && i < n; i++) {
        v = &m->variable[*mem_index_place(m, variables[i].table, variables[i].id) - 1];
        v->writer = store;
        variables[i].seq = apc_mem_newest_seq(m, variables[i].table, variables[i].id);
    }
    apc_mem_end(store);
    return err;
}

static int mem_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    const struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        struct variable *v = apc_mem_find(m, variables[i].table, variables[i].id);
        if (v && v->writer == store) {
            v->writer = NULL;
        }
    }
    apc_mem_end(store);
    return 0;
}

static bool mem_any_newer(const struct memory *m, const struct apc_sample *seen, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (apc_mem_newest_seq(m, seen[i].table, seen[i].id) > seen[i].seq) {
            return true;
        }
    }
    return false;
}

static int mem_wait_newer(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    struct memory *m = apc_mem_of(store)->memory;
    const apc_ns now = apc_clock_mono(NULL), until = timeout < INT64_MAX - now ? now + timeout : INT64_MAX;
    const struct timespec deadline = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                      .tv_nsec = (long)(until % APC_NS_PER_S)};
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    m->waiters++;
    bool newer = mem_any_newer(m, seen, n);
    for (int e = timeout > 0 ? 0 : 1; !newer && e == 0; newer = mem_any_newer(m, seen, n)) {
        e = pthread_cond_timedwait(&m->changed, &m->mutex, &deadline);
    }
    m->waiters--;
    apc_mem_end(store);
    return newer;
}

/* ---- History --------------------------------------------------------------------------------- */

int64_t apc_mem_first_seq(const struct variable *v, const struct apc_range *range)
{
    size_t left = range->last;
    int64_t first = 0;
    for (size_t i = v->n; left > 0 && i > 0; i--) {
        left -= apc_mem_within(range, apc_mem_time(v, i - 1));
        first = left == 0 ? apc_mem_seq(v, i - 1) : 0;
    }
    return first > range->after ? first : range->after + 1;
}

#define BATCH 128

/* Copies of up to BATCH rows from *next on; *next is where to go on. */
static size_t mem_copy_rows(const struct variable *v, const struct apc_range *range, int64_t *next,
                            int64_t last, struct apc_sample *out)
{
    size_t n = 0;
    for (size_t i = apc_mem_lower_bound(v, *next); i < v->n && v->row[i].seq <= last && n < BATCH; i++) {
        if (apc_mem_within(range, v->row[i].time)) {
            out[n++] = v->row[i];
        }
        *next = v->row[i].seq + 1;
    }
    return n;
}

static int mem_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                       apc_sample_fn fn, void *ctx)
{
    struct memory *m = apc_mem_of(store)->memory;
    struct apc_sample row[BATCH];
    int64_t next = -1, last = 0;
    int count = 0;
    size_t n = BATCH;
    while (n == BATCH) {
        int err = apc_mem_begin(store);
        if (err) {
            return err;
        }
        const struct variable *v = apc_mem_find(m, table, id);
        if (v && next < 0) {
            next = apc_mem_first_seq(v, range);
            last = apc_mem_newest_seq(m, table, id);
        }
        n = v ? mem_copy_rows(v, range, &next, last, row) : 0;
        apc_mem_end(store);
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

static int mem_variables(struct apc_store *store, struct apc_sample *out, size_t capacity)
{
    struct memory *m = apc_mem_of(store)->memory;
    size_t n = 0;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    struct apc_sample *all = (struct apc_sample *)malloc((m->n + 1) * sizeof *all);
    for (size_t i = 0; all && i < m->n; i++) {
        if (m->variable[i].n > 0) {
            all[n++] = (struct apc_sample){.table = m->variable[i].table, .id = m->variable[i].id};
        }
    }
    apc_mem_end(store);
    return all ? apc_variables_give(all, n, out, capacity) : apc_mem_no_memory(store);
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* The newest stays whatever its age. */
static int mem_drop_samples(struct variable *v, apc_ns before)
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

static int mem_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct memory *m = apc_mem_of(store)->memory;
    const apc_ns now = apc_clock_utc(NULL);
    int err = apc_mem_begin(store), dropped = 0;
    if (err) {
        return err;
    }
    for (size_t i = 0; i < m->n; i++) {
        struct variable *v = &m->variable[i];
        const apc_ns kept = apc_table_kept(keep, v->table);
        if (kept > 0) {
            dropped += v->vector ? apc_mem_drop_vectors(v, now - kept) : mem_drop_samples(v, now - kept);
        }
    }
    if (keep->events > 0 && m->n_events > 0) {
        dropped += apc_mem_drop_events(m, now - keep->events);
    }
    if (keep->timing > 0 && m->n_timings > 0) {
        dropped += apc_mem_drop_timings(m, now - keep->timing);
    }
    apc_mem_end(store);
    return dropped;
}

static int64_t mem_forget(struct apc_store *store, apc_ns before)
{
    struct memory *m = apc_mem_of(store)->memory;
    int64_t gone = 0;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    m->forgotten = before > m->forgotten ? before : m->forgotten;
    for (size_t i = 0; i < m->n; i++) {
        struct variable *v = &m->variable[i];
        gone += v->vector                    ? apc_mem_drop_vectors(v, before)
                : apc_table_packed(v->table) ? mem_drop_samples(v, before)
                                             : 0;
    }
    apc_mem_end(store);
    return gone;
}

const struct apc_store_ops apc_mem_store = {
    .scheme = "mem:",
    .open = mem_open,
    .close = mem_close,
    .connected = mem_connected,
    .connect = mem_connect,
    .read = mem_read_newest,
    .append = mem_append,
    .claim_set = mem_claim,
    .release = mem_release,
    .put = mem_put,
    .swap = mem_swap,
    .read_rows = apc_mem_read_rows,
    .append_rows = apc_mem_append_rows,
    .vectors = apc_mem_vectors,
    .wait = mem_wait_newer,
    .variables = mem_variables,
    .history = mem_history,
    .history_bins = apc_bins_by_history,
    .author = apc_mem_author,
    .author_name = apc_mem_author_name,
    .describe = apc_mem_describe,
    .catalogue = apc_mem_catalogue,
    .get_tags = apc_mem_get_tags,
    .append_events = apc_mem_append_events,
    .events = apc_mem_events,
    .append_timing = apc_mem_append_timing,
    .timing = apc_mem_timing,
    .init = mem_init,
    .maintain = mem_maintain,
    .forget = mem_forget,
};
