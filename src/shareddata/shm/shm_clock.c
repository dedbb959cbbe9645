/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The clock of a simulated plant. Who simulates has the writers' lock for the whole of a tick, and its own
 * transactions take it once more. The lock goes to who has waited longest (PTHREAD_PRIO_INHERIT: the kernel hands it
 * over), so between two ticks everybody who waits gets his turn, at any speed.
 */
#include <stdlib.h>
#include <sys/mman.h>

#include "shareddata/shm/shm.h"

int apc_shm_pace(struct apc_store *store, struct apc_store_pace **words, bool lock)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (!err && lock) {
        err = apc_shm_lock(shm);
    }
    *words = err ? NULL : &shm->header->pace;
    return err ? err : 1;
}

void apc_shm_unlock_pace(struct apc_store *store)
{
    apc_shm_unlock(apc_shm_of(store));
}

static apc_ns utc_of_plant(void *header)
{
    return (apc_ns)apc_word_get(
        &((struct apc_shm_header *)header)->pace.now); /* by itself: it guards nothing */
}

/* A mapping of its own, and for good: the process asks for the time at any time, also when the store is closed. */
int apc_shm_follow(struct apc_store *store)
{
    struct apc_shm *shm = apc_shm_of(store);
    void *header = mmap(NULL, sizeof *shm->header, PROT_READ, MAP_SHARED, shm->fd, 0);
    struct apc_clock *clock = header == MAP_FAILED ? NULL : (struct apc_clock *)calloc(1, sizeof *clock);
    if (!clock) {
        return apc_fail(&store->why, APC_ENOMEM, "shm:%s: its clock cannot be mapped", shm->name);
    }
    *clock = (struct apc_clock){.mono = apc_clock_system()->mono, .utc = utc_of_plant, .ctx = header};
    apc_clock_follow(clock);
    return 1;
}
