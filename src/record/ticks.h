/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What each tick of each controller was made from, as a run folder keeps it: ticks.db, a store of its own
 * with the controllers' tick rows, the plans of setpoints, the rows of setpoint, opmode, manual, tuning and
 * actual that they name, and what the laws published.
 */
#ifndef APC_RUN_TICKS_H
#define APC_RUN_TICKS_H

#include "samples.h"

#define TICKS_FILE "ticks.db"

/* The ticks in @p file, to be read or written by whom no tick waits for: as long as a busy disk takes.
 * Returns 0 or a negative error. */
int ticks_open(struct apc_store **ticks, const char *file, struct apc_error *why);
/* From the run's store, of a range, into the folder. Returns 0 or a negative error. */
int ticks_keep(const char *dir, struct apc_store *from, const struct experiment *e,
               const struct apc_range *range, struct apc_error *why);

/* The tick rows of one controller, or the plans of one setpoint, by seq. */
struct ticks {
    struct tick_row {
        int64_t seq;
        apc_ns time;
        size_t n, first; /* values, and where they begin */
    } * at;
    double *value;
    size_t n, room, n_values, values_room;
};

/* Those that a store has of number @p id of @p table, from @p since on. Returns 0, APC_ENOMEM or the store's
 * error; ticks_free() in either case. */
int ticks_load(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id, apc_ns since);
void ticks_free(struct ticks *ticks);
/* NULL: it is not on record. */
const struct tick_row *ticks_find(const struct ticks *ticks, int64_t seq);

#endif
