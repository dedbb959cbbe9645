/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory: vectors, and rows of both kinds together. See shm.h.
 *
 * A vector is a row of 2^shift cells: the mark that a cell has, seq, time, status with the length, and the
 * elements. A variable's rows are a ring like that of samples, in extents that its slot's version names; the
 * newest row is not copied into the version but found by it, for what a version shows is not overwritten
 * before the ring has gone a quarter of its way round. A reader to whom that happens begins again.
 *
 * How wide a row is follows from the longest vector so far, in powers of two: nobody has to say a length
 * beforehand, and none can be wrong. A longer one moves the rows into a new ring; readers of older
 * generations go on in the old one, which nobody uses any more. That takes the time of copying what the ring
 * holds, at most 14 times in a variable's life, and all that is left behind is less than the last ring.
 */
#include <limits.h>
#include <stdlib.h>

#include "shareddata/shm/shm.h"

#define EXTENTS   APC_SHM_VECTORS
#define HEAD      4  /* words of a row before its elements */
#define SHIFT_MAX 14 /* room for APC_ELEMENTS_MAX */

/** A version of a variable of vectors. */
struct ring {
    uint64_t seq;        /* of the newest */
    uint64_t head, kept; /* ordinals head - kept .. head - 1 */
    uint64_t back;       /* the newest is head - 1 - back */
    uint64_t extents, shift;
    uint32_t extent[EXTENTS]; /* first cell of each */
};

static struct ring unpack_ring(const uint64_t words[8])
{
    struct ring r = {.head = words[0],
                     .seq = words[1],
                     .extents = words[7] & 0xff,
                     .shift = words[7] >> 8 & 0xff,
                     .kept = words[7] >> 16 & 0xffffff,
                     .back = words[7] >> 40};
    memcpy(r.extent, &words[3], sizeof r.extent);
    return r;
}

static void pack_ring(const struct ring *r, uint64_t words[8])
{
    words[0] = r->head;
    words[1] = r->seq;
    words[2] = 0;
    memcpy(&words[3], r->extent, sizeof r->extent);
    words[7] = r->back << 40 | r->kept << 16 | r->shift << 8 | r->extents;
}

/* A row by its ordinal; NULL when the ring makes no sense. */
static apc_word *row_at(const struct apc_shm *shm, const struct ring *r, uint64_t ordinal)
{
    if (r->extents < 1 || r->extents > EXTENTS || r->shift > SHIFT_MAX) {
        return NULL;
    }
    const uint64_t position = ordinal & (apc_shm_capacity(r->extents) - 1);
    const int extent = apc_shm_extent(position);
    const uint64_t in = position - (extent > 0 ? apc_shm_capacity((uint64_t)extent) : 0);
    const uint64_t at = r->extent[extent] + (in << r->shift);
    return at + (UINT64_C(1) << r->shift) <= shm->cells ? &shm->cell[at].mark : NULL;
}

static uint64_t room_of(uint64_t shift)
{
    return (UINT64_C(8) << shift) - HEAD;
}

uint64_t apc_shm_width(size_t elements)
{
    uint64_t shift = 0;
    while (room_of(shift) < elements) {
        shift++;
    }
    return UINT64_C(1) << shift;
}

/* ---- Read ---------------------------------------------------------------------------------- */

/* The row's words up to its first @p room elements; false when it has been overwritten. */
static bool load_vector_row(const apc_word *row, uint64_t ordinal, uint64_t shift, struct apc_vector *out)
{
    if (!row || apc_word_get(row) != ordinal + 1) {
        return false;
    }
    const uint64_t status = apc_word_get(&row[3]), n = status >> 32;
    out->seq = (int64_t)apc_word_get(&row[1]);
    out->time = (apc_ns)apc_word_get(&row[2]);
    out->status = (apc_status)status;
    out->n = (uint32_t)n;
    if (n > room_of(shift)) {
        return false;
    }
    if (out->room > 0 && n > 0) {
        apc_words_get(out->value, row + HEAD, n < out->room ? n : out->room);
    }
    return apc_shm_unchanged(row, ordinal + 1);
}

bool apc_shm_load_vector(struct apc_shm *shm, uint64_t g, struct apc_vector *v, uint32_t *hint)
{
    const struct apc_shm_slot *slot = apc_shm_find(shm, apc_shm_key(v->table, v->id), hint);
    uint64_t words[8];
    const int there = slot ? apc_shm_load(slot, g, words) : 0;
    if (there > 0) {
        const struct ring r = unpack_ring(words);
        const uint64_t newest = r.head - 1 - r.back;
        return load_vector_row(row_at(shm, &r, newest), newest, r.shift, v);
    }
    v->seq = v->time = 0;
    v->n = 0;
    v->status = APC_BAD_NO_DATA;
    return there == 0;
}

/* ---- Write --------------------------------------------------------------------------------- */

/* One more extent, if there are cells for it. */
static void grow_vector_ring(struct apc_shm_write *w, struct ring *r)
{
    const uint64_t rows = apc_shm_capacity(r->extents + 1) - apc_shm_capacity(r->extents);
    struct apc_shm_counters *counters = apc_shm_count(w);
    if (!apc_shm_may_grow(w->shm, counters->cells, r->extents, UINT64_C(1) << r->shift, true)) {
        return;
    }
    r->extent[r->extents++] = (uint32_t)counters->cells;
    counters->cells += rows << r->shift;
}

/* The row behind the head, to be filled: nobody takes it for one until end_row(). */
static apc_word *begin_vector_row(struct apc_shm_write *w, struct ring *r, uint64_t key)
{
    const uint64_t capacity = apc_shm_capacity(r->extents);
    if (r->head >= apc_shm_shown(capacity) && r->head <= capacity && r->extents < EXTENTS) {
        grow_vector_ring(w, r); /* it never went round */
    }
    apc_word *row = row_at(w->shm, r, r->head);
    if (row) {
        apc_word_put(&row[0], 0);
        atomic_thread_fence(memory_order_release);
    } else if (r->extents > 0) {
        apc_fail(&w->shm->base.why, APC_ESTORE, "shm:%s is corrupt", w->shm->name);
    } else {
        apc_shm_no_room(w, key);
    }
    return row;
}

static void end_row(struct ring *r, apc_word *row)
{
    apc_word_put(&row[0], ++r->head);
    const uint64_t shown = apc_shm_shown(apc_shm_capacity(r->extents));
    r->kept = r->kept < shown ? r->kept + 1 : shown;
}

/* A ring of wider rows, into which the rows move. */
static int widen_vector_ring(struct apc_shm_write *w, struct ring *r, uint64_t key, uint64_t shift)
{
    const struct ring former = *r;
    *r = (struct ring){.seq = former.seq, .back = former.back, .shift = shift};
    for (uint64_t o = former.head - former.kept; o < former.head; o++) {
        const apc_word *from = row_at(w->shm, &former, o);
        apc_word *to = from ? begin_vector_row(w, r, key) : NULL;
        if (!to) {
            return APC_ESTORE;
        }
        const uint64_t n = apc_word_get(&from[3]) >> 32, room = room_of(former.shift);
        for (uint64_t i = 1; i < HEAD + (n < room ? n : room); i++) {
            apc_word_put(&to[i], apc_word_get(&from[i]));
        }
        end_row(r, to);
    }
    return former.kept == 0 || r->back < r->kept ? 0 : apc_shm_no_room(w, key);
}

/* Is the seq, which is not above the newest, there; or is it older than what the ring can hold? */
static bool vector_ring_holds(const struct apc_shm *shm, const struct ring *r, uint64_t seq)
{
    uint64_t oldest = UINT64_MAX;
    for (uint64_t o = r->head; o > r->head - r->kept; o--) {
        const apc_word *row = row_at(shm, r, o - 1);
        const uint64_t found = row ? apc_word_get(&row[1]) : 0;
        oldest = found < oldest ? found : oldest;
        if (found == seq) {
            return true;
        }
    }
    return (r->head > r->kept && seq < oldest) ||
           r->back + 2 > apc_shm_shown(apc_shm_capacity(r->extents)); /* it would push the newest out */
}

static int write_vector_row(struct apc_shm_write *w, struct ring *r, const struct apc_vector *v)
{
    const uint64_t shift = (uint64_t)__builtin_ctzll(apc_shm_width(v->n));
    const uint64_t key = apc_shm_key(v->table, v->id);
    int err = shift > r->shift ? widen_vector_ring(w, r, key, shift) : 0;
    apc_word *row = err ? NULL : begin_vector_row(w, r, key);
    if (!row) {
        return APC_ESTORE;
    }
    apc_word_put(&row[1], (uint64_t)v->seq);
    apc_word_put(&row[2], (uint64_t)apc_time_stored(v->time));
    apc_word_put(&row[3], (uint64_t)v->n << 32 | v->status);
    if (v->n > 0) {
        apc_words_put(row + HEAD, v->value, v->n);
    }
    end_row(r, row);
    if ((uint64_t)v->seq > r->seq) {
        r->seq = (uint64_t)v->seq;
        r->back = 0;
    } else {
        r->back++;
    }
    return 0;
}

/* Returns 1, 0 when its seq was taken, APC_ESTORE when there is no room. */
static int write_vector(struct apc_shm_write *w, const struct apc_vector *v, uint32_t *hint)
{
    struct apc_shm_slot *slot = apc_shm_find_or_add(w, apc_shm_key(v->table, v->id), hint);
    struct ring r = {0};
    uint64_t words[8];
    if (!slot) {
        return APC_ESTORE;
    }
    uint64_t was;
    int from = apc_shm_current(slot->mark, w->generation, &was);
    if (from >= 0) {
        apc_words_get(words, &slot->version[from].mark, 8);
        r = unpack_ring(words);
        if ((uint64_t)v->seq <= r.seq && vector_ring_holds(w->shm, &r, (uint64_t)v->seq)) {
            return 0;
        }
    }
    int err = write_vector_row(w, &r, v);
    if (!err) {
        pack_ring(&r, words);
        apc_words_put(&slot->version[apc_shm_version(w, slot->mark, &from)].mark, words, 8);
        apc_shm_has_room(w, apc_shm_key(v->table, v->id));
    }
    return err ? err : 1;
}

int apc_shm_append_rows(struct apc_store *store, const struct apc_rows *rows)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_shm_write w;
    int err = apc_rows_check(store, rows->sample, rows->n_samples), count = 0;
    if (!err) {
        err = apc_vectors_check(store, rows->vector, rows->n_vectors);
    }
    if (!err) {
        err = apc_shm_ready(shm);
    }
    if (!err) {
        err = apc_shm_begin(shm, &w);
    }
    if (err) {
        return err;
    }
    for (size_t i = 0; err >= 0 && i < rows->n_samples; i++) {
        struct apc_sample *s = &rows->sample[i];
        const int64_t last = apc_table_shared(s->table) ? apc_shm_last_seq(&w, s->table, s->id) : 0;
        if (s->seq == 0 && last == apc_shm_first(shm)) {
            s->seq = last;
        }
        if (apc_rows_next(s, last)) {
            err = apc_shm_write_sample(&w, s, apc_shm_hint(shm->write_hint, i));
            count += err > 0;
            err = err > 0 ? apc_shm_write_loops(&w, s) : err;
        }
    }
    for (size_t i = 0; err >= 0 && i < rows->n_vectors; i++) {
        err = write_vector(&w, &rows->vector[i], apc_shm_hint(shm->write_hint, rows->n_samples + i));
        count += err > 0;
    }
    return apc_shm_finish(&w, err, count);
}

/* ---- History --------------------------------------------------------------------------------- */

/* Rows at hand, each with its elements behind it. */
struct found {
    struct apc_vector *row;
    double *value;
    size_t n;
};

static int by_vector_seq(const void *a, const void *b)
{
    const struct apc_vector *x = (const struct apc_vector *)a, *y = (const struct apc_vector *)b;
    return (x->seq > y->seq) - (x->seq < y->seq);
}

/* What the ring still holds, in rising seq. */
static int load_vector_ring(struct apc_shm *shm, const struct ring *r, enum apc_table table, int id,
                            const struct apc_range *range, struct found *f)
{
    const size_t room = (size_t)room_of(r->shift);
    const int64_t newer = (int64_t)r->seq - range->after; /* seqs: no more rows than that */
    if (newer <= 0) {
        return 0;
    }
    const size_t most = (size_t)(r->kept < (uint64_t)newer ? r->kept : (uint64_t)newer);
    f->row = (struct apc_vector *)calloc(most + 1, sizeof *f->row);
    f->value = (double *)calloc(most + 1, room * sizeof *f->value);
    if (!f->row || !f->value) {
        return apc_fail(&shm->base.why, APC_ENOMEM, "out of memory for %llu rows",
                        (unsigned long long)r->kept);
    }
    for (uint64_t o = r->head; o > r->head - r->kept && f->n < most; o--) {
        struct apc_vector *row = &f->row[f->n];
        *row = (struct apc_vector){
            .table = table, .id = id, .room = (uint32_t)room, .value = f->value + f->n * room};
        if (!load_vector_row(row_at(shm, r, o - 1), o - 1, r->shift, row)) {
            break;
        }
        f->n += row->seq > range->after && apc_shm_within(range, row->time);
    }
    qsort(f->row, f->n, sizeof *f->row, by_vector_seq);
    return 0;
}

static int load_vector_version(struct apc_shm *shm, uint64_t key, const struct apc_shm_slot **slot,
                               struct ring *r)
{
    uint64_t words[8];
    const int there = apc_shm_load_newest(shm, key, slot, words);
    if (there > 0) {
        *r = unpack_ring(words);
        if (r->kept > r->head || r->extents > EXTENTS || r->shift > SHIFT_MAX ||
            r->kept > apc_shm_shown(apc_shm_capacity(r->extents))) {
            return apc_fail(&shm->base.why, APC_ESTORE, "shm:%s is corrupt", shm->name);
        }
    }
    return there;
}

int apc_shm_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_vector_fn fn, void *ctx)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct found f = {0};
    struct ring r;
    int err = apc_shm_ready(shm), count = 0;
    if (err) {
        return err;
    }
    const struct apc_shm_slot *slot;
    const int there = load_vector_version(shm, apc_shm_key(table, id), &slot, &r);
    err = there > 0 ? load_vector_ring(shm, &r, table, id, range, &f) : there;
    store->streaming = true;
    size_t first = range->last > 0 && f.n > range->last ? f.n - range->last : 0;
    for (bool ended = err < 0; !ended && first < f.n; first++) {
        count++;
        ended = fn(ctx, &f.row[first]) != 0;
    }
    store->streaming = false;
    free(f.row);
    free(f.value);
    return err < 0 ? err : count;
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* How many of the oldest are older than @p before; the newest is none of them. */
static uint64_t old_rows(const struct apc_shm *shm, const struct ring *r, apc_ns before)
{
    uint64_t n = 0;
    while (n + 1 + r->back < r->kept) {
        const apc_word *row = row_at(shm, r, r->head - r->kept + n);
        if (row && apc_word_get(row) == r->head - r->kept + n + 1 &&
            (apc_ns)apc_word_get(&row[2]) >= before) {
            break;
        }
        n++;
    }
    return n;
}

int apc_shm_drop_vectors(struct apc_shm *shm, struct apc_shm_slot *slot, apc_ns before)
{
    struct apc_shm_write w;
    const uint64_t key = apc_word_get(&slot->key);
    const struct apc_shm_slot *found;
    struct ring r;
    uint64_t words[8];
    int there = load_vector_version(shm, key, &found, &r);
    if (there <= 0 || old_rows(shm, &r, before) == 0) {
        return there < 0 ? there : 0;
    }
    int err = apc_shm_begin(shm, &w);
    if (err) {
        return err;
    }
    if ((there = load_vector_version(shm, key, &found, &r)) <= 0 || found != slot) {
        apc_shm_unlock(shm);
        return there < 0 ? there : 0;
    }
    const uint64_t n = old_rows(shm, &r, before);
    int from, to = apc_shm_version(&w, slot->mark, &from);
    r.kept -= n;
    pack_ring(&r, words);
    apc_words_put(&slot->version[to].mark, words, 8);
    apc_shm_commit(&w);
    return (int)n;
}
