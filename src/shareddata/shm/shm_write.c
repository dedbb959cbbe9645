/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory: the writers' lock, transactions, recovery. See shm.h for why a writer may be
 * killed at any instruction.
 *
 * The order of every change is: mark, fence, words; and after all of them the generation. A mark above the
 * generation is what recovery looks for, and what tells a slow reader that its version has gone. To store it
 * releases what former writers did: who sees the one version go sees how the other has fared.
 */
#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <signal.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "shareddata/shm/shm.h"

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

/* ---- Recovery -------------------------------------------------------------------------------- */

static void spoil_marks(apc_word mark[2], uint64_t g)
{
    for (int i = 0; i < 2; i++) {
        if (apc_word_get(&mark[i]) > g) {
            atomic_store_explicit(&mark[i], APC_SHM_SPOILED, memory_order_release);
        }
    }
}

static struct apc_shm_counters counters_of(const struct apc_shm *shm, uint64_t g)
{
    const struct apc_shm_meta *meta = &shm->header->meta;
    struct apc_shm_counters c = {0};
    uint64_t was;
    int current = apc_shm_current(meta->mark, g, &was);
    if (current >= 0) {
        apc_words_get(&c, meta->counters[current], APC_SHM_COUNTERS);
    }
    return c;
}

/* The lock is held: nothing above the generation has happened. */
static void recover_transaction(struct apc_shm *shm)
{
    struct apc_shm_header *h = shm->header;
    const uint64_t g = apc_shm_generation(shm);
    spoil_marks(h->meta.mark, g);
    spoil_marks(h->tags_mark, g);
    const struct apc_shm_counters c = counters_of(shm, g);
    for (size_t i = 0; i < shm->index_size; i++) {
        if (atomic_load_explicit(&shm->index[i], memory_order_relaxed) > c.variables) {
            atomic_store_explicit(&shm->index[i], 0, memory_order_relaxed);
        }
    }
    /* New slots are taken one after the other. They are freed from the last to the first, so that whoever has
     * to go on with that finds those that are left. */
    size_t i = (size_t)(c.variables < shm->variables ? c.variables : shm->variables);
    while (i < shm->variables && apc_word_get(&shm->slot[i].key) != 0) {
        i++;
    }
    for (; i > c.variables; i--) {
        apc_word_put(&shm->slot[i - 1].mark[0], 0);
        apc_word_put(&shm->slot[i - 1].mark[1], 0);
        atomic_store_explicit(&shm->slot[i - 1].key, 0, memory_order_release);
    }
    for (; i > 0; i--) {
        spoil_marks(shm->slot[i - 1].mark, g);
    }
}

/* ---- Lock ------------------------------------------------------------------------------------ */

static int wait_for_lock(struct apc_shm *shm)
{
    const apc_ns until = apc_clock_mono(NULL) + shm->base.config.timeout;
    const struct timespec deadline = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                      .tv_nsec = (long)(until % APC_NS_PER_S)};
    int e = pthread_mutex_clocklock(&shm->header->writer, CLOCK_MONOTONIC, &deadline);
#ifdef __SANITIZE_THREAD__ /* GCC's does not know that function */
    if (e == 0 || e == EOWNERDEAD) {
        __tsan_mutex_pre_lock(&shm->header->writer, 0);
        __tsan_mutex_post_lock(&shm->header->writer, 0, 0);
    }
#endif
    return e;
}

/*
 * glibc ends a process that waits for a robust mutex whose owner does not exist: the kernel marks it when a
 * thread ends, so there is none such, unless somebody has written over it. Its number goes only after that,
 * so that a mark which has come meanwhile is seen at the second look.
 */
static bool is_ownerless(const pthread_mutex_t *mutex)
{
    const uint32_t held = (uint32_t)__atomic_load_n(&mutex->__data.__lock, __ATOMIC_ACQUIRE);
    const pid_t owner = (pid_t)(held & FUTEX_TID_MASK);
    return owner != 0 && !(held & FUTEX_OWNER_DIED) && kill(owner, 0) < 0 && errno == ESRCH &&
           (uint32_t)__atomic_load_n(&mutex->__data.__lock, __ATOMIC_ACQUIRE) == held;
}

int apc_shm_lock(struct apc_shm *shm)
{
    pthread_mutex_t *const writer = &shm->header->writer;
    bool damaged = writer->__data.__kind != shm->lock_kind;
    int e = damaged ? EINVAL : pthread_mutex_trylock(writer);
    if (e == EBUSY) {
        damaged = is_ownerless(writer);
        e = damaged ? EINVAL : wait_for_lock(shm);
    }
    if (damaged) {
        return apc_fail(
            &shm->base.why, APC_ESTORE,
            "shm:%s: %s is corrupt: its writers' lock is damaged. Stop what uses it, keep it with "
            "`apc copy`, and remove it",
            shm->name, shm->path);
    }
    if (e == EOWNERDEAD) { /* and until the unlock again, if we die too */
        recover_transaction(shm);
        e = pthread_mutex_consistent(&shm->header->writer);
    }
    if (e == ETIMEDOUT) {
        return apc_fail(&shm->base.why, APC_ETIMEDOUT,
                        "shm:%s: another writer has held the lock for too long", shm->name);
    }
    return e ? apc_fail(&shm->base.why, APC_ESTORE, "shm:%s: the writers' lock is broken (error %d)",
                        shm->name, e)
             : 0;
}

void apc_shm_unlock(struct apc_shm *shm)
{
    pthread_mutex_unlock(&shm->header->writer);
}

/* ---- Transaction ------------------------------------------------------------------------------ */

int apc_shm_begin(struct apc_shm *shm, struct apc_shm_write *w)
{
    int err = apc_shm_lock(shm);
    if (!err && (err = apc_shm_fenced(shm)) != 0) {
        apc_shm_unlock(shm);
    }
    if (!err) {
        w->shm = shm;
        w->generation = apc_shm_generation(shm) + 1;
        w->counted = false;
    }
    return err;
}

struct apc_shm_counters *apc_shm_count(struct apc_shm_write *w)
{
    if (!w->counted) {
        w->counters = counters_of(w->shm, w->generation - 1);
        w->counted = true;
    }
    return &w->counters;
}

int apc_shm_version(struct apc_shm_write *w, apc_word mark[2], int *from)
{
    uint64_t was;
    *from = apc_shm_current(mark, w->generation, &was);
    int to = *from == 0 ? 1 : 0;
    if (*from >= 0 && was == w->generation) {
        return *from; /* made already, in this transaction */
    }
    atomic_store_explicit(&mark[to], w->generation, memory_order_release);
    atomic_thread_fence(memory_order_release);
    return to;
}

void apc_shm_commit(struct apc_shm_write *w)
{
    struct apc_shm_header *h = w->shm->header;
    if (w->counted) {
        int from, to = apc_shm_version(w, h->meta.mark, &from);
        apc_words_put(h->meta.counters[to], &w->counters, APC_SHM_COUNTERS);
    }
    atomic_store_explicit(&h->generation, w->generation, memory_order_release);
    /* A waiter notes the tick in `waiting`, then sleeps while tick is that; here it is the other way round.
     * Only a note of a tick that has passed is erased. */
    const uint32_t tick = 1 + atomic_fetch_add_explicit(&h->tick, 1, memory_order_seq_cst);
    uint32_t noted = atomic_load_explicit(&h->waiting, memory_order_seq_cst);
    apc_shm_unlock(w->shm);
    if (noted != 0) {
        if (noted != tick) {
            atomic_compare_exchange_strong(&h->waiting, &noted, 0);
        }
        syscall(SYS_futex, &h->tick, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
    }
}

/* Leave everything as it was, unlock. */
static void give_up(struct apc_shm_write *w)
{
    recover_transaction(w->shm);
    apc_shm_unlock(w->shm);
}

int apc_shm_finish(struct apc_shm_write *w, int err, int count)
{
    if (err < 0) {
        give_up(w);
    } else if (count > 0) {
        apc_shm_commit(w);
    } else {
        apc_shm_unlock(w->shm);
    }
    return err < 0 ? err : count;
}

/* ---- Slots ----------------------------------------------------------------------------------- */

/* Where in the index it is, or the free place where it belongs; NULL when there is neither. */
static _Atomic uint32_t *shm_index_place(const struct apc_shm *shm, uint64_t key)
{
    const size_t mask = shm->index_size - 1;
    size_t i = (size_t)(key * UINT64_C(0x9E3779B97F4A7C15) >> 32) & mask;
    for (size_t tries = 0; tries <= mask; tries++, i = (i + 1) & mask) {
        uint32_t number = atomic_load_explicit(&shm->index[i], memory_order_relaxed);
        if (number == 0 || (number <= shm->variables && apc_word_get(&shm->slot[number - 1].key) == key)) {
            return &shm->index[i];
        }
    }
    return NULL;
}

struct apc_shm_slot *apc_shm_look_up(const struct apc_shm *shm, uint64_t key, uint32_t *hint)
{
    const _Atomic uint32_t *at = shm_index_place(shm, key);
    const uint32_t number = at ? atomic_load_explicit(at, memory_order_relaxed) : 0;
    if (number == 0 || number > shm->variables) {
        return NULL;
    }
    if (hint) {
        *hint = number - 1;
    }
    return &shm->slot[number - 1];
}

int apc_shm_no_room(struct apc_shm_write *w, uint64_t key)
{
    struct apc_shm_header *h = w->shm->header;
    apc_word_put(&h->refused, apc_word_get(&h->refused) + 1);
    apc_word_put(&h->refused_at, (uint64_t)apc_clock_utc(NULL));
    apc_word_put(&h->lacking, key);
    return apc_shm_too_small(w->shm, "is full: it has no room for %s %d",
                             apc_table_name((enum apc_table)(key >> 32)), (int)(uint32_t)key);
}

static struct apc_shm_slot *add_slot(struct apc_shm_write *w, uint64_t key)
{
    struct apc_shm *shm = w->shm;
    _Atomic uint32_t *at = shm_index_place(shm, key);
    struct apc_shm_counters *counters = apc_shm_count(w);
    if (!at || counters->variables >= shm->variables) {
        apc_shm_no_room(w, key);
        return NULL;
    }
    const size_t number = (size_t)counters->variables++;
    struct apc_shm_slot *slot = &shm->slot[number];
    apc_word_put(&slot->mark[0], 0); /* of a transaction that was not finished */
    apc_word_put(&slot->mark[1], 0);
    atomic_store_explicit(&slot->owner, 0, memory_order_relaxed);
    apc_word_put(&slot->key, key);
    atomic_store_explicit(at, (uint32_t)(number + 1), memory_order_relaxed);
    return slot;
}

struct apc_shm_slot *apc_shm_find_or_add(struct apc_shm_write *w, uint64_t key, uint32_t *hint)
{
    struct apc_shm_slot *slot = apc_shm_find(w->shm, key, hint);
    return slot ? slot : add_slot(w, key);
}

int64_t apc_shm_newest_seq(const struct apc_shm_write *w, enum apc_table table, int id)
{
    const struct apc_shm_slot *slot = apc_shm_find(w->shm, apc_shm_key(table, id), NULL);
    uint64_t was;
    const int current = slot ? apc_shm_current(slot->mark, w->generation, &was) : -1;
    return current < 0 ? 0 : (int64_t)apc_word_get(&slot->version[current].seq);
}

int64_t apc_shm_last_seq(const struct apc_shm_write *w, enum apc_table table, int id)
{
    const int64_t newest = apc_shm_newest_seq(w, table, id);
    return newest > 0 ? newest : apc_shm_first(w->shm);
}

/* ---- Rings of cells --------------------------------------------------------------------------- */

/* One more extent, if there are cells for it. Returns how many there are then. */
static uint64_t grow_ring(struct apc_shm_write *w, struct apc_shm_slot *slot, uint64_t extents)
{
    struct apc_shm_counters *counters = apc_shm_count(w);
    if (!apc_shm_may_grow(w->shm, counters->cells, extents, 1, false)) {
        return extents;
    }
    atomic_store_explicit(&slot->extent[extents], (uint32_t)counters->cells, memory_order_relaxed);
    counters->cells += apc_shm_capacity(extents + 1) - apc_shm_capacity(extents);
    return extents + 1;
}

/* What a transaction does with one slot. */
struct version {
    uint64_t seq, head, kept, extents;
};

static struct version load_cell_version(const struct apc_shm_cell *v)
{
    const uint64_t ring = apc_word_get(&v->ring);
    return (struct version){.seq = apc_word_get(&v->seq),
                            .head = apc_word_get(&v->mark),
                            .kept = ring >> 8,
                            .extents = ring & 0xff};
}

/* Is the seq, which is not above the newest, there; or is it older than what the ring still holds? */
static bool sample_ring_holds(const struct apc_shm *shm, const struct apc_shm_slot *slot,
                              const struct version *v, uint64_t seq)
{
    const uint64_t back = v->seq - seq; /* most count by one */
    const struct apc_shm_cell *cell = NULL;
    if (back == 0) {
        return true;
    }
    if (back < v->kept && (cell = apc_shm_cell(shm, slot, v->extents, v->head - 1 - back)) != NULL &&
        apc_word_get(&cell->seq) == seq) {
        return true;
    }
    uint64_t oldest = UINT64_MAX;
    for (uint64_t o = v->head - v->kept; o < v->head; o++) {
        cell = apc_shm_cell(shm, slot, v->extents, o);
        if (cell && apc_word_get(&cell->mark) == o + 1) {
            const uint64_t found = apc_word_get(&cell->seq);
            oldest = found < oldest ? found : oldest;
            if (found == seq) {
                return true;
            }
        }
    }
    return v->head > v->kept && seq < oldest;
}

/* Field by field: to copy a struct that was just filled in costs more than all the rest. */
static void put_words(struct apc_shm_cell *c, const struct apc_sample *s, apc_ns time)
{
    uint64_t value;
    memcpy(&value, &s->value, sizeof value);
    apc_word_put(&c->seq, (uint64_t)s->seq);
    apc_word_put(&c->time, (uint64_t)apc_time_stored(time));
    apc_word_put(&c->value, value);
    apc_word_put(&c->origin, (uint64_t)s->origin);
    apc_word_put(&c->status, (uint64_t)s->author << 32 | s->status);
}

/* Into the ring behind its head. */
static int put_sample_cell(struct apc_shm_write *w, struct apc_shm_slot *slot, struct version *v,
                           const struct apc_sample *s, apc_ns time)
{
    const uint64_t capacity = apc_shm_capacity(v->extents);
    if (v->head >= apc_shm_shown(capacity) && v->head <= capacity &&
        v->extents < APC_SHM_EXTENTS) { /* it never went round */
        v->extents = grow_ring(w, slot, v->extents);
    }
    struct apc_shm_cell *cell = apc_shm_cell(w->shm, slot, v->extents, v->head);
    if (!cell) {
        return v->extents ? apc_fail(&w->shm->base.why, APC_ESTORE, "shm:%s is corrupt", w->shm->name)
                          : apc_shm_no_room(w, apc_word_get(&slot->key));
    }
    apc_word_put(&cell->mark, 0);
    atomic_thread_fence(memory_order_release);
    put_words(cell, s, time);
    apc_word_put(&cell->mark, ++v->head);
    __builtin_prefetch(cell + 1, 1); /* the next one's: it has long gone from the caches */
    const uint64_t shown = apc_shm_shown(apc_shm_capacity(v->extents));
    v->kept = v->kept < shown ? v->kept + 1 : shown;
    return 0;
}

/* What people write to a simulated plant takes effect at its next tick. */
static apc_ns time_of_row(struct apc_shm_header *h, const struct apc_sample *s)
{
    const uint64_t now = apc_word_get(&h->pace.now);
    if (now == 0 || apc_word_get(&h->pace.held) != 0 || !apc_table_shared(s->table)) {
        return s->time;
    }
    apc_word_put(&h->pace.outside, apc_word_get(&h->pace.outside) + 1);
    return (apc_ns)now;
}

int apc_shm_write_sample(struct apc_shm_write *w, const struct apc_sample *s, uint32_t *hint)
{
    struct apc_shm_slot *slot = apc_shm_find_or_add(w, apc_shm_key(s->table, s->id), hint);
    struct version v = {0};
    if (!slot) {
        return APC_ESTORE;
    }
    uint64_t was;
    int from = apc_shm_current(slot->mark, w->generation, &was);
    if (from >= 0) {
        v = load_cell_version(&slot->version[from]);
        if ((uint64_t)s->seq <= v.seq && sample_ring_holds(w->shm, slot, &v, (uint64_t)s->seq)) {
            return 0;
        }
    }
    const apc_ns time = time_of_row(w->shm->header, s);
    int err = put_sample_cell(w, slot, &v, s, time);
    if (err) {
        return err;
    }
    struct apc_shm_cell *to = &slot->version[apc_shm_version(w, slot->mark, &from)];
    if ((uint64_t)s->seq > v.seq) {
        put_words(to, s, time);
    } else if (to != &slot->version[from]) { /* a late one: the newest stays */
        uint64_t words[8];
        apc_words_get(words, &slot->version[from].mark, 8);
        apc_words_put(&to->mark, words, 8);
    }
    apc_word_put(&to->mark, v.head);
    apc_word_put(&to->ring, v.kept << 8 | v.extents);
    apc_shm_has_room(w, apc_word_get(&slot->key));
    return 1;
}

/* ---- Rings of records ------------------------------------------------------------------------- */

void apc_shm_write_record(struct apc_shm_write *w, enum apc_shm_log_name name, const void *record,
                          size_t words)
{
    const struct apc_shm_log *log = &w->shm->log[name];
    struct apc_shm_counters *counters = apc_shm_count(w);
    struct apc_shm_ends *ends = &counters->log[name];
    apc_word *at = log->record + (size_t)(ends->head % log->capacity) * log->words;
    uint64_t arrival = name == APC_SHM_TIMING ? ends->head : 0;
    for (size_t i = APC_SHM_EVENTS; name != APC_SHM_TIMING && i < APC_SHM_TIMING; i++) {
        arrival += counters->log[i].head;
    }
    apc_word_put(&at[0], 0);
    atomic_thread_fence(memory_order_release);
    apc_word_put(&at[1], arrival);
    apc_words_put(&at[2], record, words);
    apc_word_put(&at[0], ++ends->head);
    const uint64_t shown = apc_shm_shown(log->capacity);
    ends->kept = ends->kept < shown ? ends->kept + 1 : shown;
}
