/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory outside the tick: history, events, timing, housekeeping. Rings are read
 * while they are written: what has been overwritten before its turn is left out, which can only be the
 * oldest.
 */
#include <limits.h>
#include <stdlib.h>

#include "base/text.h"
#include "shareddata/shm/shm.h"

static int no_memory_for_rows(struct apc_shm *shm, uint64_t rows)
{
    return apc_fail(&shm->base.why, APC_ENOMEM, "out of memory for %llu rows", (unsigned long long)rows);
}

/* ---- History --------------------------------------------------------------------------------- */

/* A row of a ring; false when it has been overwritten. */
static bool load_cell(const struct apc_shm_cell *cell, uint64_t ordinal, uint64_t words[8])
{
    if (!cell || apc_word_get(&cell->mark) != ordinal + 1) {
        return false;
    }
    apc_words_get(words, &cell->mark, 8);
    return apc_shm_unchanged(&cell->mark, ordinal + 1);
}

static int by_sample_seq(const void *a, const void *b)
{
    const struct apc_sample *x = (const struct apc_sample *)a, *y = (const struct apc_sample *)b;
    return (x->seq > y->seq) - (x->seq < y->seq);
}

/* What the ring of a version still holds above @p after, and the version's own sample, in rising seq, at the
 * end of @p out, which has room for @p capacity. Returns how many. */
static size_t load_sample_ring(const struct apc_shm *shm, const struct apc_shm_slot *slot,
                               const uint64_t version[8], enum apc_table table, int id, int64_t after,
                               struct apc_sample *out, size_t capacity)
{
    const uint64_t head = version[0], kept = version[7] >> 8, extents = version[7] & 0xff;
    const struct apc_sample newest = apc_shm_sample(table, id, version);
    bool sorted = true, complete = false;
    size_t at = capacity;
    uint64_t words[8];
    for (uint64_t o = head; o > head - kept && at > 1; o--) {
        if (!load_cell(apc_shm_cell(shm, slot, extents, o - 1), o - 1, words)) {
            break;
        }
        if ((int64_t)words[1] <= after) {
            continue;
        }
        out[--at] = apc_shm_sample(table, id, words);
        sorted = sorted && (at + 1 == capacity || out[at].seq < out[at + 1].seq);
        complete = complete || out[at].seq == newest.seq;
    }
    if (!complete) { /* too many late ones came after it */
        out[--at] = newest;
    }
    if (!sorted || !complete) {
        qsort(out + at, capacity - at, sizeof *out, by_sample_seq);
    }
    return capacity - at;
}

static int corrupt(struct apc_shm *shm)
{
    return apc_fail(&shm->base.why, APC_ESTORE, "shm:%s is corrupt", shm->name);
}

/* The slot is looked for after the generation was taken: one of a transaction that failed is another
 * variable's later. */
int apc_shm_load_newest(struct apc_shm *shm, uint64_t key, const struct apc_shm_slot **slot,
                        uint64_t version[8])
{
    const uint64_t began = apc_shm_generation(shm);
    for (int tries = 0; tries < APC_SHM_TRIES; tries++) { /* two commits within some ns are no rule */
        const uint64_t g = apc_shm_generation(shm);
        *slot = apc_shm_find(shm, key, NULL);
        const int there = *slot ? apc_shm_load(*slot, g, version) : 0;
        if (there >= 0) {
            return there;
        }
    }
    return apc_shm_lost(shm, began);
}

/* Of a variable of samples. */
static int load_sample_version(struct apc_shm *shm, uint64_t key, const struct apc_shm_slot **slot,
                               uint64_t version[8])
{
    const int there = apc_shm_load_newest(shm, key, slot, version);
    const uint64_t kept = there > 0 ? version[7] >> 8 : 0;
    return kept > apc_shm_shown(apc_shm_capacity(APC_SHM_EXTENTS)) || (there > 0 && kept > version[0])
               ? corrupt(shm)
               : there;
}

int apc_shm_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_sample_fn fn, void *ctx)
{
    struct apc_shm *shm = apc_shm_of(store);
    uint64_t version[8];
    int err = apc_shm_ready(shm);
    if (err) {
        return err;
    }
    const struct apc_shm_slot *slot;
    const int there = load_sample_version(shm, apc_shm_key(table, id), &slot, version);
    if (there <= 0) {
        return there;
    }
    const uint64_t kept = version[7] >> 8;
    const int64_t newer = (int64_t)version[1] - range->after; /* seqs: no more rows than that */
    if (newer <= 0) {
        return 0;
    }
    const size_t most = (size_t)(kept < (uint64_t)newer ? kept : (uint64_t)newer) + 1;
    struct apc_sample *row = (struct apc_sample *)malloc(most * sizeof *row);
    if (!row) {
        return no_memory_for_rows(shm, kept);
    }
    size_t first = most - load_sample_ring(shm, slot, version, table, id, range->after, row, most), n = 0;
    for (; first < most; first++) {
        if (apc_shm_within(range, row[first].time)) {
            row[n++] = row[first];
        }
    }
    first = range->last > 0 && n > range->last ? n - range->last : 0;
    int count = 0;
    store->streaming = true;
    for (bool ended = false; !ended && first < n; first++) {
        count++;
        ended = fn(ctx, &row[first]) != 0;
    }
    store->streaming = false;
    free(row);
    return count;
}

int apc_shm_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity)
{
    struct apc_shm *shm = apc_shm_of(store);
    size_t n = 0;
    uint64_t version[8], key;
    int err = apc_shm_ready(shm);
    if (err) {
        return err;
    }
    struct apc_sample *all = (struct apc_sample *)malloc(shm->variables * sizeof *all);
    if (!all) {
        return no_memory_for_rows(shm, shm->variables);
    }
    for (size_t i = 0; i < shm->variables && (key = apc_word_get(&shm->slot[i].key)) != 0; i++) {
        const struct apc_shm_slot *slot;
        const int there = apc_shm_load_newest(shm, key, &slot, version);
        if (there < 0) {
            free(all);
            return there;
        }
        if (there > 0) {
            all[n++] = (struct apc_sample){.table = (enum apc_table)(key >> 32), .id = (int)(uint32_t)key};
        }
    }
    return apc_variables_give(all, n, variables, capacity);
}

/* ---- Events and timing: rings of records ------------------------------------------------------- */

static bool sane_ends(const struct apc_shm_log *log, const struct apc_shm_ends *ends)
{
    return ends->kept <= log->capacity && ends->kept <= ends->head;
}

/* Of all rings, as of one moment. */
static int load_counters(struct apc_shm *shm, struct apc_shm_counters *c)
{
    const struct apc_shm_meta *meta = &shm->header->meta;
    const uint64_t g = apc_shm_generation(shm);
    for (int tries = 0; tries < APC_SHM_TRIES; tries++) {
        uint64_t was;
        const int current = apc_shm_current(meta->mark, apc_shm_generation(shm), &was);
        if (current >= 0) {
            apc_words_get(c, meta->counters[current], APC_SHM_COUNTERS);
            if (apc_shm_unchanged(&meta->mark[current], was)) {
                return 0;
            }
        }
    }
    return apc_shm_lost(shm, g);
}

/* The first @p words of a record; false when it has been overwritten. */
static bool load_log_record(const struct apc_shm_log *log, uint64_t ordinal, void *out, size_t words)
{
    const apc_word *at = log->record + (size_t)(ordinal % log->capacity) * log->words;
    if (apc_word_get(at) != ordinal + 1) {
        return false;
    }
    apc_words_get(out, at + 1, words);
    return apc_shm_unchanged(at, ordinal + 1);
}

/* Copies of the records to give, in order: those of order[i].at for i in first..n-1. */
struct selection {
    uint64_t *record; /* each its arrival and then its words, of which the first is its time */
    struct entry {
        apc_ns time;
        uint64_t arrival;
        size_t at;
    } * order;
    size_t words, first, n;
};

static int by_arrival(const void *a, const void *b)
{
    const struct entry *x = (const struct entry *)a, *y = (const struct entry *)b;
    return (x->arrival > y->arrival) - (x->arrival < y->arrival);
}

static int by_event_time(const void *a, const void *b)
{
    const struct entry *x = (const struct entry *)a, *y = (const struct entry *)b;
    return x->time != y->time ? (x->time > y->time) - (x->time < y->time) : by_arrival(a, b);
}

static void free_selection(struct selection *s)
{
    free(s->record);
    free(s->order);
}

static const void *selected(const struct selection *s, size_t i)
{
    return s->record + s->order[i].at * s->words + 1;
}

/* Of the rings @p name to @p last, whose records are alike. */
static int select_records(struct apc_shm *shm, enum apc_shm_log_name name, enum apc_shm_log_name last,
                          const struct apc_range *range, struct selection *s)
{
    struct apc_shm_counters counters;
    const struct apc_shm_ends *const ends = counters.log;
    int err = load_counters(shm, &counters);
    size_t most = 1, at = 0;
    *s = (struct selection){.words = shm->log[name].words - 1};
    for (enum apc_shm_log_name log = name; !err && log <= last; log++) {
        err = sane_ends(&shm->log[log], &ends[log]) ? 0 : corrupt(shm);
        most += (size_t)ends[log].kept;
    }
    if (err) {
        return err;
    }
    s->record = (uint64_t *)calloc(most, s->words * sizeof *s->record);
    s->order = (struct entry *)calloc(most, sizeof *s->order);
    if (!s->record || !s->order) {
        free_selection(s);
        return no_memory_for_rows(shm, most);
    }
    for (enum apc_shm_log_name log = name; log <= last; log++) {
        for (uint64_t o = ends[log].head; o > ends[log].head - ends[log].kept; o--, at++) {
            uint64_t *record = s->record + at * s->words;
            if (!load_log_record(&shm->log[log], o - 1, record, s->words)) {
                break;
            }
            if (record[0] < (uint64_t)range->after) {
                break; /* and so are those before it */
            }
            if (apc_shm_within(range, (apc_ns)record[1])) {
                s->order[s->n++] = (struct entry){.time = (apc_ns)record[1], .arrival = record[0], .at = at};
            }
        }
    }
    qsort(s->order, s->n, sizeof *s->order, name == APC_SHM_TIMING ? by_event_time : by_arrival);
    s->first = range->last > 0 && s->n > range->last ? s->n - range->last : 0;
    return 0;
}

static bool is_of_kind(const struct apc_event *event, const char *kind)
{
    return strncmp(event->kind, kind, sizeof event->kind) == 0;
}

static enum apc_shm_log_name ring_of(const struct apc_event *event)
{
    const bool chatter = is_of_kind(event, "link") || is_of_kind(event, "measurement");
    return is_of_kind(event, "operator")                   ? APC_SHM_ACTIONS
           : is_of_kind(event, "access")                   ? APC_SHM_ACCESS
           : is_of_kind(event, "alarm")                    ? APC_SHM_ALARMS
           : chatter && event->severity != APC_EVENT_ALARM ? APC_SHM_CHATTER
                                                           : APC_SHM_EVENTS;
}

int apc_shm_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_shm_write w;
    int err = apc_shm_ready(shm);
    if (!err) {
        err = apc_shm_begin(shm, &w);
    }
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        const struct apc_event row = apc_event_row(&events[i]);
        apc_shm_write_record(&w, ring_of(&row), &row, sizeof row / 8);
    }
    apc_shm_commit(&w);
    return (int)n;
}

int apc_shm_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct selection s;
    int err = apc_shm_ready(shm), count = 0;
    if (!err) {
        err = select_records(shm, APC_SHM_EVENTS, APC_SHM_ALARMS, range, &s);
    }
    if (err) {
        return err;
    }
    store->streaming = true;
    for (bool ended = false; !ended && s.first < s.n; s.first++) {
        struct apc_event event;
        memcpy(&event, selected(&s, s.first), sizeof event);
        event.number = (int64_t)s.order[s.first].arrival + 1;
        count++;
        ended = fn(ctx, &event) != 0;
    }
    store->streaming = false;
    free_selection(&s);
    return count;
}

/* Neighbours are merged, as many as it takes, so that no more than APC_SHM_BINS are left. */
static void put_bins(struct apc_shm_timing *t, const struct apc_timing_row *r)
{
    const size_t merged = r->n_bins > 0 ? (r->n_bins + APC_SHM_BINS - 1) / APC_SHM_BINS : 1;
    const size_t n = (r->n_bins + merged - 1) / merged;
    for (size_t i = 0; i < r->n_bins; i++) {
        const size_t at = i / merged;
        if (i % merged == 0) {
            t->bins[at] = r->bin_low[i];
            t->bins[2 * n + at] = 0;
        }
        t->bins[n + at] = r->bin_high[i];
        t->bins[2 * n + at] += r->bin_count[i];
    }
    t->n_bins = (int64_t)n;
}

int apc_shm_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_shm_write w;
    int err = apc_shm_ready(shm);
    if (!err) {
        err = apc_shm_begin(shm, &w);
    }
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        const struct apc_timing_row r = apc_timing_stored(&rows[i]);
        struct apc_shm_timing t = {.time = r.time,
                                   .period = r.period,
                                   .missed = (int64_t)r.missed,
                                   .count = (int64_t)r.count,
                                   .mean = r.mean,
                                   .sd = r.sd,
                                   .p50 = r.p50,
                                   .p99 = r.p99,
                                   .max = r.max};
        memcpy(t.task, r.task, sizeof t.task);
        text_clean(t.quantity, r.quantity, sizeof t.quantity);
        put_bins(&t, &r);
        apc_shm_write_record(&w, APC_SHM_TIMING, &t, sizeof t / 8);
    }
    apc_shm_commit(&w);
    return (int)n;
}

static int shm_give_timing(const struct apc_shm_timing *t, uint64_t arrival, apc_timing_fn fn, void *ctx)
{
    const size_t n = t->n_bins < APC_SHM_BINS ? (size_t)t->n_bins : APC_SHM_BINS;
    struct apc_timing_row row = {.time = t->time,
                                 .period = t->period,
                                 .missed = (uint64_t)t->missed,
                                 .count = (uint64_t)t->count,
                                 .mean = t->mean,
                                 .sd = t->sd,
                                 .p50 = t->p50,
                                 .p99 = t->p99,
                                 .max = t->max,
                                 .bin_low = n > 0 ? t->bins : NULL,
                                 .bin_high = n > 0 ? t->bins + n : NULL,
                                 .bin_count = n > 0 ? t->bins + 2 * n : NULL,
                                 .n_bins = n,
                                 .number = (int64_t)arrival + 1};
    text_clean(row.task, t->task, sizeof row.task);
    text_clean(row.quantity, t->quantity, sizeof row.quantity);
    return fn(ctx, &row);
}

int apc_shm_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct selection s;
    int err = apc_shm_ready(shm), count = 0;
    if (!err) {
        err = select_records(shm, APC_SHM_TIMING, APC_SHM_TIMING, range, &s);
    }
    if (err) {
        return err;
    }
    store->streaming = true;
    for (bool ended = false; !ended && s.first < s.n; s.first++) {
        count++;
        ended = shm_give_timing((const struct apc_shm_timing *)selected(&s, s.first),
                                s.order[s.first].arrival, fn, ctx) != 0;
    }
    store->streaming = false;
    free_selection(&s);
    return count;
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* How many of a ring's oldest are older than @p before. */
static uint64_t old_samples(const struct apc_shm *shm, const struct apc_shm_slot *slot,
                            const uint64_t version[8], apc_ns before)
{
    const uint64_t head = version[0], kept = version[7] >> 8, extents = version[7] & 0xff;
    uint64_t n = 0, words[8];
    while (n < kept &&
           (!load_cell(apc_shm_cell(shm, slot, extents, head - kept + n), head - kept + n, words) ||
            (apc_ns)words[2] < before)) {
        n++;
    }
    return n;
}

/* One variable's: a transaction of its own, so that no writer waits for more. The newest stays in the slot. */
static int shm_drop_samples(struct apc_shm *shm, struct apc_shm_slot *slot, apc_ns before)
{
    struct apc_shm_write w;
    const uint64_t key = apc_word_get(&slot->key);
    const struct apc_shm_slot *found;
    uint64_t version[8];
    int there = load_sample_version(shm, key, &found, version);
    if (there <= 0 || old_samples(shm, found, version, before) == 0) {
        return there < 0 ? there : 0;
    }
    int err = apc_shm_begin(shm, &w);
    if (err) {
        return err;
    }
    if ((there = load_sample_version(shm, key, &found, version)) <= 0 || found != slot) {
        apc_shm_unlock(shm);
        return there < 0 ? there : 0;
    }
    const uint64_t n = old_samples(shm, slot, version, before);
    const bool all = n == version[7] >> 8; /* the newest, too, if it is as old, but that stays in the slot */
    const struct apc_sample newest = apc_shm_sample(APC_SENSOR, 0, version);
    int from, to = apc_shm_version(&w, slot->mark, &from);
    version[7] -= n << 8;
    apc_words_put(&slot->version[to].mark, version, 8);
    apc_shm_commit(&w);
    return (int)n - (all && newest.time < before);
}

/* Of one ring of records, only the oldest can go. */
static int drop_records(struct apc_shm *shm, enum apc_shm_log_name name, apc_ns before)
{
    struct apc_shm_write w;
    int err = apc_shm_begin(shm, &w);
    if (err) {
        return err;
    }
    struct apc_shm_ends *ends = &apc_shm_count(&w)->log[name];
    if (!sane_ends(&shm->log[name], ends)) {
        apc_shm_unlock(shm);
        return corrupt(shm);
    }
    int n = 0;
    uint64_t record[2]; /* its arrival, its time */
    while (ends->kept > 0 && (!load_log_record(&shm->log[name], ends->head - ends->kept, record, 2) ||
                              (apc_ns)record[1] < before)) {
        ends->kept--;
        n++;
    }
    if (n > 0) {
        apc_shm_commit(&w);
    } else {
        apc_shm_unlock(shm);
    }
    return n;
}

int apc_shm_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct apc_shm *shm = apc_shm_of(store);
    const apc_ns now = apc_clock_utc(NULL);
    int err = apc_shm_ready(shm), dropped = 0;
    for (size_t i = 0; err >= 0 && i < shm->variables; i++) {
        struct apc_shm_slot *slot = &shm->slot[i];
        const uint64_t key = apc_word_get(&slot->key);
        const enum apc_table table = (enum apc_table)(key >> 32);
        const apc_ns kept = key != 0 ? apc_table_kept(keep, table) : 0;
        if (kept > 0) {
            err = apc_table_vectors(table) ? apc_shm_drop_vectors(shm, slot, now - kept)
                                           : shm_drop_samples(shm, slot, now - kept);
            dropped += err > 0 ? err : 0;
        }
    }
    for (enum apc_shm_log_name name = APC_SHM_EVENTS; err >= 0 && name < APC_SHM_LOGS; name++) {
        const apc_ns kept = name == APC_SHM_TIMING ? keep->timing : keep->events;
        if (kept > 0) {
            err = drop_records(shm, name, now - kept);
            dropped += err > 0 ? err : 0;
        }
    }
    return err < 0 ? err : dropped;
}

int apc_shm_room(struct apc_store *store, struct apc_store_room *room)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_shm_counters counters;
    int err = apc_shm_ready(shm);
    if (!err) {
        err = load_counters(shm, &counters);
    }
    if (err) {
        return err;
    }
    const uint64_t lacking = apc_word_get(&shm->header->lacking);
    *room = (struct apc_store_room){
        .variables = counters.variables,
        .variables_max = shm->variables,
        .cells = counters.cells,
        .cells_max = shm->cells,
        .refused = apc_word_get(&shm->header->refused),
        .refused_at = (apc_ns)apc_word_get(&shm->header->refused_at),
        .full = lacking != 0,
        .table = (enum apc_table)(lacking >> 32),
        .id = (int)(uint32_t)lacking,
        .tags_max = shm->tags,
        .catalogue_max = shm->text_size,
    };
    return 1;
}
