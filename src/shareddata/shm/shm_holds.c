/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * How long shared memory keeps what has gone nowhere else: its rings grow on paper here as shm_write.c and
 * shm_vectors.c let them grow.
 */
#include <math.h>
#include <stdlib.h>

#include "shareddata/shm/shm.h"

struct ring {
    double period;
    uint64_t width, extents; /* cells of a row */
    bool vectors, stuck;
};

/** A ring with so many extents is full. */
struct growth {
    double time;
    struct ring *ring;
};

static int by_hold_time(const void *a, const void *b)
{
    const double x = ((const struct growth *)a)->time, y = ((const struct growth *)b)->time;
    return (x > y) - (x < y);
}

static double shown_for(const struct ring *r, uint64_t extents)
{
    return r->period * (double)apc_shm_shown(apc_shm_capacity(extents));
}

static uint64_t extents_of(const struct ring *r)
{
    return r->vectors ? APC_SHM_VECTORS : APC_SHM_EXTENTS;
}

/* All rings as they begin, and in the end the time until the first begins to lose what it showed. */
static double grow_all(const struct apc_shm *shm, struct ring *ring, size_t n, struct growth *growth,
                       uint64_t used)
{
    double held = (double)INFINITY;
    size_t m = 0;
    for (size_t i = 0; i < n; i++) {
        for (uint64_t e = 1; ring[i].period > 0 && e < extents_of(&ring[i]); e++) {
            growth[m++] = (struct growth){shown_for(&ring[i], e), &ring[i]};
        }
    }
    qsort(growth, m, sizeof *growth, by_hold_time);
    for (size_t i = 0; i < m; i++) {
        struct ring *r = growth[i].ring;
        r->stuck = r->stuck || !apc_shm_may_grow(shm, used, r->extents, r->width, r->vectors);
        if (!r->stuck) {
            used += (apc_shm_capacity(r->extents + 1) - apc_shm_capacity(r->extents)) * r->width;
            r->extents++;
        }
    }
    for (size_t i = 0; i < n; i++) {
        const double this = ring[i].period > 0 ? shown_for(&ring[i], ring[i].extents) : held;
        held = this < held ? this : held;
    }
    return held;
}

unsigned apc_shm_timing_rows(unsigned mib)
{
    struct apc_shm shm = {.fd = -1};
    if (mib < 1 || mib > APC_SHM_MIB_MAX) {
        return 0;
    }
    apc_shm_lay_out(&shm, mib, NULL);
    return (unsigned)apc_shm_shown(shm.log[APC_SHM_TIMING].capacity);
}

double apc_shm_holds(unsigned mib, const struct apc_tag *variables, size_t n)
{
    struct apc_shm shm = {.fd = -1};
    uint64_t used = 0;
    double held = 0;
    if (mib < 1 || mib > APC_SHM_MIB_MAX || (n > 0 && !variables)) {
        return 0;
    }
    apc_shm_lay_out(&shm, mib, NULL);
    struct ring *ring = (struct ring *)calloc(n + 1, sizeof *ring);
    struct growth *growth = (struct growth *)calloc(n + 1, APC_SHM_EXTENTS * sizeof *growth);
    for (size_t i = 0; ring && i < n; i++) {
        const struct apc_tag *tag = &variables[i];
        const bool vectors = apc_table_vectors(tag->table);
        ring[i] = (struct ring){
            .period = tag->period,
            .width = vectors ? apc_shm_width(tag->length > 0 ? (size_t)tag->length : 0) : 1,
            .extents = 1,
            .vectors = vectors,
        };
        used += apc_shm_capacity(1) * ring[i].width;
    }
    if (ring && growth && n <= shm.tags && n <= shm.variables && used <= shm.cells) {
        held = grow_all(&shm, ring, n, growth, used);
    }
    free(ring);
    free(growth);
    return held;
}
