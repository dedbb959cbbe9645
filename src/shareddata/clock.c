/* SPDX-License-Identifier: BSD-3-Clause */
/* The clock of a simulated plant, which its store shares. */
#include <stdatomic.h>
#include <string.h>

#include "base/base_internal.h"
#include "shareddata/shareddata_internal.h"

static double clock_number(const _Atomic uint64_t *word)
{
    const uint64_t bits = atomic_load_explicit(word, memory_order_relaxed);
    double number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

static void put_clock_number(_Atomic uint64_t *word, double number)
{
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    atomic_store_explicit(word, bits, memory_order_relaxed);
}

/* Returns 1: there are such words; 0: none, or an error. */
static int pace_of(struct apc_store *store, struct apc_store_pace **words, bool lock)
{
    APC_STORE_PASS(store, pace, pace_of(inner, words, lock));
    const int rc = apc_store_enter(store, NULL, 0);
    *words = NULL;
    if (rc < 0 || !store->ops->pace) {
        return rc;
    }
    return store->ops->pace(store, words, lock);
}

static void pace_unlock(struct apc_store *store)
{
    while (!store->ops->unlock) {
        store = store->inner;
    }
    store->ops->unlock(store);
}

int apc_store_clock(struct apc_store *store, struct apc_store_clock *clock)
{
    struct apc_store_pace *words;
    struct apc_store_clock all = {.size = 0};
    const int rc = pace_of(store, &words, false);
    if (rc > 0) {
        all = (struct apc_store_clock){
            .now = (apc_ns)atomic_load_explicit(&words->now, memory_order_relaxed),
            .asked = clock_number(&words->asked),
            .reached = clock_number(&words->reached),
            .steps = atomic_load_explicit(&words->steps, memory_order_relaxed),
            .rewind = (apc_ns)atomic_load_explicit(&words->rewind, memory_order_relaxed)};
    }
    apc_result_copy(clock, &all, sizeof all);
    return rc < 0 ? rc : all.now != 0;
}

/* @p rewind: 0: it goes on. */
static int order_pace(struct apc_store *store, double asked, uint64_t steps, apc_ns rewind)
{
    struct apc_store_pace *words;
    const int rc = pace_of(store, &words, true);
    const bool simulated = rc > 0 && atomic_load_explicit(&words->now, memory_order_relaxed) != 0;
    if (simulated) {
        put_clock_number(&words->asked, asked);
        atomic_store_explicit(&words->steps, asked > 0 ? 0 : steps, memory_order_relaxed);
    }
    if (simulated && rewind > 0) {
        atomic_store_explicit(&words->rewind, (uint64_t)rewind, memory_order_relaxed);
    }
    if (rc > 0) {
        pace_unlock(store);
    }
    return rc < 0 || simulated
               ? (rc < 0 ? rc : 0)
               : apc_fail(&store->why, APC_ESTATE, "the plant is not simulated: its time is real");
}

int apc_store_set_speed(struct apc_store *store, double asked, uint64_t steps)
{
    return asked >= 0
               ? order_pace(store, asked, steps, 0)
               : apc_fail(store ? &store->why : NULL, APC_EINVAL, "a speed of %g: must be 0 or more", asked);
}

int apc_store_rewind(struct apc_store *store, apc_ns to)
{
    struct apc_store_clock clock = {.size = sizeof clock};
    const int rc = apc_store_clock(store, &clock);
    if (rc > 0 && (to <= 0 || to > clock.now)) {
        return apc_fail(&store->why, APC_EINVAL, "there is no way back to a time that is to come");
    }
    return rc < 0 ? rc : order_pace(store, 0, 0, to);
}

int apc_store_follow(struct apc_store *store)
{
    APC_STORE_PASS(store, follow, apc_store_follow(inner));
    struct apc_store_clock clock = {.size = sizeof clock};
    const int rc = apc_store_clock(store, &clock);
    return rc > 0 ? store->ops->follow(store) : rc;
}

int64_t apc_store_begin_tick(struct apc_store *store)
{
    struct apc_store_pace *words;
    const int rc = pace_of(store, &words, true);
    if (rc <= 0) {
        return rc < 0 ? rc
                      : apc_fail(&store->why, APC_EINVAL, "the store cannot be that of a simulated plant");
    }
    atomic_store_explicit(&words->held, 1, memory_order_relaxed);
    return (int64_t)atomic_exchange_explicit(&words->outside, 0, memory_order_relaxed);
}

int apc_store_end_tick(struct apc_store *store, apc_ns now, double reached)
{
    struct apc_store_pace *words;
    const int rc = pace_of(store, &words, false);
    if (rc <= 0) {
        return rc < 0 ? rc
                      : apc_fail(&store->why, APC_EINVAL, "the store cannot be that of a simulated plant");
    }
    const uint64_t steps = atomic_load_explicit(&words->steps, memory_order_relaxed);
    const bool held = atomic_exchange_explicit(&words->held, 0, memory_order_relaxed) != 0;
    put_clock_number(&words->reached, reached);
    atomic_store_explicit(&words->now, (uint64_t)now, memory_order_relaxed);
    if (held) {
        atomic_store_explicit(&words->steps, steps > 0 ? steps - 1 : 0, memory_order_relaxed);
        pace_unlock(store);
    }
    return 0;
}
