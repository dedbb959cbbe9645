/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory: claims. A claimant is a record, a name in the header and a lock on one byte of
 * the segment's file; the slots of its variables say its number. The lock belongs to the handle's open file
 * (F_OFD_SETLK), so it ends with the handle or with its process, however that ends, whichever of its threads
 * came first; what still says its number then is nobody's. (A robust mutex would belong to a thread.)
 *
 * All of it is read and changed under the writers' lock only.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>

#include "shareddata/shm/shm.h"

static struct flock shm_lock_byte_of(uint32_t record)
{
    return (struct flock){.l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = (off_t)record, .l_len = 1};
}

/* Is the record another one's who lives? */
static bool is_shm_claimant_alive(const struct apc_shm *shm, uint32_t record)
{
    struct flock lock = shm_lock_byte_of(record);
    return record != 0 && record != shm->record && record <= APC_SHM_CLAIMANTS &&
           fcntl(shm->fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

/* What a former claimant of that number left is not ours. */
static void disown(const struct apc_shm *shm, uint32_t record)
{
    for (size_t i = 0; i < shm->variables && apc_word_get(&shm->slot[i].key) != 0; i++) {
        if (atomic_load_explicit(&shm->slot[i].owner, memory_order_relaxed) == record) {
            atomic_store_explicit(&shm->slot[i].owner, 0, memory_order_relaxed);
        }
    }
}

static struct apc_shm_claimant *own(const struct apc_shm *shm)
{
    return &shm->header->claimant[shm->record - 1];
}

static uint64_t highest_number(const struct apc_shm *shm)
{
    uint64_t highest = 0;
    for (size_t i = 0; i < APC_SHM_CLAIMANTS; i++) {
        const uint64_t number = apc_word_get(&shm->header->claimant[i].number);
        highest = number > highest ? number : highest;
    }
    return highest;
}

/* Above all that there are, so that a clock which steps back repeats none. */
static uint64_t next_number(const struct apc_shm *shm)
{
    const uint64_t now = (uint64_t)(apc_clock_utc(NULL) / 1000), highest = highest_number(shm);
    return now > highest ? now : highest + 1;
}

/* The number is that of the taking: he may have come before others, and have been refused until now. */
static void number_taking(struct apc_shm *shm)
{
    if (apc_word_get(&own(shm)->number) < highest_number(shm)) {
        apc_word_put(&own(shm)->number, next_number(shm));
    }
    shm->base.claim = apc_word_get(&own(shm)->number);
}

/* One that was fenced begins anew, with nothing. */
static void leave_fenced(struct apc_shm *shm)
{
    if (shm->record == 0 || apc_word_get(&own(shm)->number) != 0) {
        return;
    }
    struct flock lock = shm_lock_byte_of(shm->record);
    lock.l_type = F_UNLCK;
    (void)fcntl(shm->fd, F_OFD_SETLK, &lock);
    shm->record = 0;
    shm->claims.n = 0;
}

/* A record of this handle's own. */
static int take_claimant_record(struct apc_shm *shm)
{
    leave_fenced(shm);
    for (uint32_t record = 1; shm->record == 0 && record <= APC_SHM_CLAIMANTS; record++) {
        struct flock lock = shm_lock_byte_of(record);
        if (fcntl(shm->fd, F_OFD_SETLK, &lock) == 0) {
            disown(shm, record);
            shm->record = record;
            memcpy(own(shm)->name, shm->base.config.name, sizeof own(shm)->name - 1);
            apc_word_put(&own(shm)->number, next_number(shm));
        } else if (errno != EAGAIN && errno != EACCES) {
            return apc_fail(&shm->base.why, APC_ESYS, "shm:%s: cannot lock a byte of its file", shm->name);
        }
    }
    return shm->record != 0
               ? 0
               : apc_fail(&shm->base.why, APC_ESTORE, "shm:%s has %d writers, and no room for more",
                          shm->name, APC_SHM_CLAIMANTS);
}

/* @other: a record that need not be asked. */
static int check_claims(struct apc_shm_write *w, const struct apc_sample *variables, size_t n, uint32_t other)
{
    struct apc_shm *shm = w->shm;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *v = &variables[i];
        const struct apc_shm_slot *slot = apc_shm_find_or_add(w, apc_shm_key(v->table, v->id), NULL);
        const uint32_t owner = slot ? atomic_load_explicit(&slot->owner, memory_order_relaxed) : 0;
        if (!slot) {
            return APC_ESTORE;
        }
        if (owner != other && is_shm_claimant_alive(shm, owner)) {
            return apc_fail(
                &shm->base.why, APC_EBUSY, "%s %d of shm:%s is already written by %.55s: stop it first",
                apc_table_name(v->table), v->id, shm->name, shm->header->claimant[owner - 1].name);
        }
    }
    return 0;
}

/* Whose claim has that number: a record, or 0. */
static uint32_t record_of(const struct apc_shm *shm, uint64_t number)
{
    uint32_t record = number != 0 ? APC_SHM_CLAIMANTS : 0;
    while (record > 0 && apc_word_get(&shm->header->claimant[record - 1].number) != number) {
        record--;
    }
    return record;
}

static void fence_claimant(struct apc_shm *shm, uint32_t record)
{
    struct apc_shm_claimant *other = &shm->header->claimant[record - 1];
    apc_word_put(&own(shm)->number, next_number(shm)); /* above the other's, whenever this one began */
    memcpy(other->name, own(shm)->name, sizeof other->name);
    apc_word_put(&other->number, 0);
    disown(shm, record);
}

int apc_shm_fenced(struct apc_shm *shm)
{
    return shm->record == 0 || apc_word_get(&own(shm)->number) != 0
               ? 0
               : apc_fail(&shm->base.why, APC_EBUSY, "%.55s has taken over what this program wrote to shm:%s",
                          own(shm)->name, shm->name);
}

int apc_shm_take(struct apc_shm *shm, struct apc_sample *variables, size_t n, uint64_t holder)
{
    struct apc_shm_write w;
    leave_fenced(shm);
    int err = apc_shm_begin(shm, &w);
    if (err) {
        return err;
    }
    err = take_claimant_record(shm);
    const uint32_t other = record_of(shm, holder);
    if (!err) {
        err = check_claims(&w, variables, n, other);
    }
    if (!err && other != 0 && other != shm->record) {
        fence_claimant(shm, other);
    }
    for (size_t i = 0; !err && i < n; i++) {
        struct apc_shm_slot *slot =
            apc_shm_find_or_add(&w, apc_shm_key(variables[i].table, variables[i].id), NULL);
        atomic_store_explicit(&slot->owner, shm->record, memory_order_relaxed);
        variables[i].seq = apc_shm_last_seq(&w, variables[i].table, variables[i].id);
    }
    if (!err) {
        number_taking(shm);
    }
    return apc_shm_finish(&w, err, 1) < 0 ? err : 0;
}

int apc_shm_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (!err) {
        err = apc_claims_reserve(store, &shm->claims, n);
    }
    if (!err) {
        err = apc_shm_take(shm, variables, n, holder);
    }
    if (!err) {
        apc_claims_add(&shm->claims, variables, n);
    }
    return err;
}

int apc_shm_claim(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    return apc_shm_seize(store, variables, n, 0);
}

int apc_shm_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (!err) {
        err = apc_shm_lock(shm);
    }
    if (err) {
        return err;
    }
    const struct apc_shm_slot *slot = apc_shm_find(shm, apc_shm_key(variable->table, variable->id), NULL);
    const uint32_t owner = slot ? atomic_load_explicit(&slot->owner, memory_order_relaxed) : 0;
    const bool lives = owner != 0 && (owner == shm->record || is_shm_claimant_alive(shm, owner));
    *holder = lives ? apc_word_get(&shm->header->claimant[owner - 1].number) : 0;
    apc_shm_unlock(shm);
    return 0;
}

int apc_shm_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (!err) {
        err = apc_shm_lock(shm);
    }
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        struct apc_shm_slot *slot = apc_shm_find(shm, apc_shm_key(variables[i].table, variables[i].id), NULL);
        if (slot && atomic_load_explicit(&slot->owner, memory_order_relaxed) == shm->record) {
            atomic_store_explicit(&slot->owner, 0, memory_order_relaxed);
        }
    }
    apc_shm_unlock(shm);
    apc_claims_drop(&shm->claims, variables, n);
    leave_fenced(shm);
    return 0;
}
