/* SPDX-License-Identifier: BSD-3-Clause */
/* The timing of the tasks over some time: the windows in the store put together. */
#ifndef APC_TIMING_H
#define APC_TIMING_H

#include <stdio.h>

#include <apcstore.h>
#include <apctimer.h> /* struct apc_bin */

/* One quantity of one task. Nanoseconds; percentiles by nearest rank, to the width of a bucket. Zeros where
 * it did not tick: count 0. */
struct timing_series {
    char task[32], quantity[16]; /* as in struct apc_timing_row */
    apc_ns period;
    uint64_t count, missed;
    double mean, sd;
    apc_ns p50, p99, p999, max;
    struct apc_bin *bins; /* rising */
    size_t n_bins, capacity;
};

struct timing {
    const char *quantity;         /* the one to load; NULL: all */
    struct timing_series *series; /* by quantity, then by task */
    size_t n;
    int failed; /* APC_ENOMEM */
};

/* Returns 0, APC_ENOMEM or the store's error. timing_free() in either case. */
int timing_load(struct timing *timing, struct apc_store *store, const struct apc_range *range,
                const char *quantity);
void timing_free(struct timing *timing);
/* NULL: it has not reported. */
const struct timing_series *timing_find(const struct timing *timing, const char *task, const char *quantity);

apc_ns timing_min(const struct timing_series *series); /* to the width of a bucket */

/* One line of CSV. */
#define TIMING_HEADER "task,quantity,period_ns,count,missed,mean_ns,sd_ns,min_ns,p50_ns,p99_ns,p999_ns,max_ns"
void timing_csv(FILE *out, const struct timing_series *series);

#endif
