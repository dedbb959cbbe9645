/* SPDX-License-Identifier: BSD-3-Clause */
/* The store in shared memory: samples. See shm.h. */
#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "shareddata/shm/shm.h"

/* ---- Read ---------------------------------------------------------------------------------- */

struct apc_sample apc_shm_sample(enum apc_table table, int id, const uint64_t words[8])
{
    struct apc_sample s = {.table = table,
                           .id = id,
                           .seq = (int64_t)words[1],
                           .time = (apc_ns)words[2],
                           .status = (apc_status)words[5],
                           .author = (uint32_t)(words[5] >> 32),
                           .origin = (int64_t)words[4]};
    memcpy(&s.value, &words[3], sizeof s.value);
    return s;
}

int apc_shm_load(const struct apc_shm_slot *slot, uint64_t g, uint64_t version[8])
{
    uint64_t was;
    const int current = apc_shm_current(slot->mark, g, &was);
    if (current < 0) {
        return current == -1 ? 0 : -1;
    }
    apc_words_get(version, &slot->version[current].mark, 8);
    return apc_shm_unchanged(&slot->mark[current], was) ? 1 : -1;
}

/* The newest of generation @p g. Returns false when it is lost: then only table and id are left. */
static inline bool load_sample(struct apc_shm *shm, uint64_t g, struct apc_sample *s, uint32_t *hint)
{
    const struct apc_shm_slot *slot = apc_shm_find(shm, apc_shm_key(s->table, s->id), hint);
    uint64_t was = 0;
    const int current = slot ? apc_shm_current(slot->mark, g, &was) : -1;
    if (current < 0) {
        *s = (struct apc_sample){
            .table = s->table, .id = s->id, .status = APC_BAD_NO_DATA, .origin = apc_shm_first(shm)};
        return current == -1;
    }
    /* Field by field: words that are put down and picked up again as a struct cost more than all the rest. */
    const struct apc_shm_cell *v = &slot->version[current];
    const uint64_t value = apc_word_get(&v->value);
    s->seq = (int64_t)apc_word_get(&v->seq);
    s->time = (apc_ns)apc_word_get(&v->time);
    memcpy(&s->value, &value, sizeof value);
    const uint64_t status = apc_word_get(&v->status);
    s->status = (apc_status)status;
    s->author = (uint32_t)(status >> 32);
    s->origin = (int64_t)apc_word_get(&v->origin);
    return apc_shm_unchanged(&slot->mark[current], was);
}

/* The @p i-th of rows, samples first, of generation @p g. */
static inline bool load_generation_row(struct apc_shm *shm, uint64_t g, struct apc_rows *rows, size_t i)
{
    uint32_t *hint = apc_shm_hint(shm->read_hint, i);
    return i < rows->n_samples ? load_sample(shm, g, &rows->sample[i], hint)
                               : apc_shm_load_vector(shm, g, &rows->vector[i - rows->n_samples], hint);
}

/* All of one generation, those first that were lost the last time. */
static bool load_generation(struct apc_shm *shm, struct apc_rows *rows, size_t *first)
{
    const uint64_t g = apc_shm_generation(shm);
    const size_t n = rows->n_samples + rows->n_vectors;
    for (size_t k = 0, i = *first; k < n; k++, i = i + 1 < n ? i + 1 : 0) {
        if (!load_generation_row(shm, g, rows, i)) {
            *first = i;
            return false;
        }
    }
    return true;
}

int apc_shm_lost(struct apc_shm *shm, uint64_t g)
{
    return apc_shm_generation(shm) == g
               ? apc_fail(&shm->base.why, APC_ESTORE, "shm:%s is corrupt", shm->name)
               : apc_fail(&shm->base.why, APC_ETIMEDOUT, "shm:%s changes too fast to be read", shm->name);
}

static int shm_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (err) {
        return err;
    }
    size_t first = 0;
    for (int tries = 0; tries < APC_SHM_TRIES; tries++) {
        if (load_generation(shm, rows, &first)) {
            return 0;
        }
    }
    for (size_t i = 0; i < rows->n_samples + rows->n_vectors; i++) {
        const uint64_t g = apc_shm_generation(shm);
        bool whole = false;
        for (int tries = 0; !whole && tries < APC_SHM_TRIES; tries++) {
            whole = load_generation_row(shm, apc_shm_generation(shm), rows, i);
        }
        if (!whole) {
            return apc_shm_lost(shm, g);
        }
    }
    return 0;
}

static int shm_read_newest(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_rows rows = {.sample = samples, .n_samples = n};
    return shm_read_rows(store, &rows);
}

/* ---- Write --------------------------------------------------------------------------------- */

/* Write all, or nothing when one fails. Returns how many were stored. */
static int write_all(struct apc_shm_write *w, const struct apc_sample *samples, size_t n)
{
    int count = 0, err = 0;
    for (size_t i = 0; err >= 0 && i < n; i++) {
        err = apc_shm_write_sample(w, &samples[i], apc_shm_hint(w->shm->write_hint, i));
        count += err > 0;
    }
    return apc_shm_finish(w, err, count);
}

static int begin_shm_samples(struct apc_store *store, const struct apc_sample *samples, size_t n,
                             struct apc_shm_write *w)
{
    int err = apc_rows_check(store, samples, n);
    if (!err) {
        err = apc_shm_ready(apc_shm_of(store));
    }
    return err ? err : apc_shm_begin(apc_shm_of(store), w);
}

static int shm_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    struct apc_shm_write w;
    int err = begin_shm_samples(store, samples, n, &w);
    return err ? err : write_all(&w, samples, n);
}

int apc_shm_write_loops(struct apc_shm_write *w, const struct apc_sample *s)
{
    const struct apc_store *store = &w->shm->base;
    int err = 0;
    for (size_t k = 0; apc_is_of_all(s) && err >= 0 && k < store->n_loops; k++) {
        const int64_t seq = apc_shm_last_seq(w, APC_OPMODE, store->loop[k].id);
        const struct apc_sample row = apc_loop_row(store, s, k, seq);
        err = seq < APC_SEQ_MAX ? apc_shm_write_sample(w, &row, NULL)
                                : apc_rows_seq_failure(&w->shm->base, &row);
    }
    return err < 0 ? err : 0;
}

/* Nobody else writes meanwhile. */
static void newest_of_writer(const struct apc_shm_write *w, struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        load_sample(w->shm, w->generation, &samples[i], NULL);
    }
}

/* Each becomes its variable's next. */
static int shm_write_next(struct apc_shm_write *w, struct apc_sample *samples, size_t n)
{
    int err = 0;
    for (size_t i = 0; err >= 0 && i < n; i++) {
        const int64_t seq = apc_shm_last_seq(w, samples[i].table, samples[i].id);
        if (seq >= APC_SEQ_MAX) {
            err = apc_rows_seq_failure(&w->shm->base, &samples[i]);
        } else {
            samples[i].seq = seq + 1;
            err = apc_shm_write_sample(w, &samples[i], apc_shm_hint(w->shm->write_hint, i));
        }
        if (err >= 0) {
            err = apc_shm_write_loops(w, &samples[i]);
        }
    }
    return apc_shm_finish(w, err, 1) < 0 ? err : 0;
}

static int shm_put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_shm_write w;
    int err = begin_shm_samples(store, samples, n, &w);
    return err ? err : shm_write_next(&w, samples, n);
}

static int shm_swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_shm_write w;
    int err = begin_shm_samples(store, samples, n, &w);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        if (samples[i].seq != apc_shm_newest_seq(&w, samples[i].table, samples[i].id)) {
            newest_of_writer(&w, samples, n);
            apc_shm_unlock(w.shm);
            return apc_fail(&store->why, APC_ECONFLICT, "someone else has changed it meanwhile");
        }
    }
    return shm_write_next(&w, samples, n);
}

/* ---- Wait ---------------------------------------------------------------------------------- */

/* A writer may die between its commit and waking us, and the segment may be removed: look every so often. */
#define SLICE (500 * APC_NS_PER_MS)

static bool shm_any_newer(struct apc_shm *shm, const struct apc_sample *seen, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_shm_slot *slot;
        uint64_t words[8];
        const int there = apc_shm_load_newest(shm, apc_shm_key(seen[i].table, seen[i].id), &slot, words);
        if (there < 0 || (there > 0 && (int64_t)words[1] > seen[i].seq)) { /* who reads it is told why not */
            return true;
        }
    }
    return false;
}

static int shm_wait_newer(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    struct apc_shm *shm = apc_shm_of(store);
    const apc_ns now = apc_clock_mono(NULL), until = timeout < INT64_MAX - now ? now + timeout : INT64_MAX;
    for (;;) {
        int err = apc_shm_ready(shm);
        if (err) {
            return err;
        }
        struct apc_shm_header *h = shm->header;
        const uint32_t tick = atomic_load_explicit(&h->tick, memory_order_acquire);
        if (shm_any_newer(shm, seen, n)) {
            return 1;
        }
        apc_ns left = timeout > 0 ? until - apc_clock_mono(NULL) : 0;
        if (left <= 0) {
            return 0;
        }
        left = left < SLICE ? left : SLICE;
        const struct timespec slice = {.tv_nsec = (long)left};
        atomic_store_explicit(&h->waiting, tick, memory_order_relaxed);
        atomic_thread_fence(memory_order_seq_cst); /* and only then the futex looks at the tick */
        syscall(SYS_futex, &h->tick, FUTEX_WAIT, tick, &slice, NULL, 0);
    }
}

/* ---- The store ------------------------------------------------------------------------------ */

static bool shm_connected(const struct apc_store *store)
{
    return ((const struct apc_shm *)store)->header != NULL;
}

static int shm_connect(struct apc_store *store)
{
    return apc_shm_ready(apc_shm_of(store));
}

/* ---- From which numbers on ----------------------------------------------------------------- */

static int64_t first(struct apc_store *store)
{
    return apc_shm_ready(apc_shm_of(store)) == 0 ? apc_shm_first(apc_shm_of(store)) : 0;
}

static int count_from(struct apc_store *store, int64_t first)
{
    const int err = apc_shm_ready(apc_shm_of(store));
    if (!err) {
        apc_word_put(&apc_shm_of(store)->header->first, (uint64_t)first);
    }
    return err;
}

const struct apc_store_ops apc_shm_store = {
    .scheme = "shm:",
    .numbers = true,
    .open = apc_shm_open,
    .close = apc_shm_close,
    .connected = shm_connected,
    .connect = shm_connect,
    .read = shm_read_newest,
    .append = shm_append,
    .claim_set = apc_shm_claim,
    .release = apc_shm_release,
    .holder = apc_shm_holder,
    .seize = apc_shm_seize,
    .put = shm_put,
    .swap = shm_swap,
    .read_rows = shm_read_rows,
    .append_rows = apc_shm_append_rows,
    .vectors = apc_shm_vectors,
    .wait = shm_wait_newer,
    .variables = apc_shm_variables,
    .history = apc_shm_history,
    .history_bins = apc_bins_by_history,
    .author = apc_shm_author,
    .author_name = apc_shm_author_name,
    .describe = apc_shm_describe,
    .catalogue = apc_shm_catalogue,
    .get_tags = apc_shm_get_tags,
    .append_events = apc_shm_append_events,
    .events = apc_shm_events,
    .append_timing = apc_shm_append_timing,
    .timing = apc_shm_timing,
    .first = first,
    .count_from = count_from,
    .init = apc_shm_init,
    .maintain = apc_shm_maintain,
    .room = apc_shm_room,
    .pace = apc_shm_pace,
    .unlock = apc_shm_unlock_pace,
    .follow = apc_shm_follow,
};
