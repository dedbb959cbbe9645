/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One that stands by for a controller: it follows the ticks that the other one stores, and takes its place
 * when none has come for two looks in a row, a look a period. So the other one may miss a tick, and has a
 * successor within three periods. Who had the place lives perhaps, and only hangs: he is fenced
 * (apc_store_seize()), so of what he still writes nothing is stored.
 */
#ifndef APC_RUN_STANDBY_H
#define APC_RUN_STANDBY_H

#include <apcmodules.h>
#include <apcstore.h>

struct standby {
    struct apc_sample *mine; /* what the place consists of; the last is the tick row */
    size_t n;
    apc_ns period;

    bool looked;
    apc_ns time; /* of the last look, monotonic */
    int64_t seq; /* that it found */
    unsigned missing;
    uint64_t holder; /* at the first look without a tick; 0: none, or the store numbers no claims */
};

/* Begin to follow. */
void standby_follow(struct standby *s);
/* One look, once a period. @p former as of apc_controller_former(). Returns 1: the place is ours, and former
 * has to be read once more; 0; or an error of the store's. */
int standby_look(struct standby *s, struct apc_store *store, struct apc_rows *former, apc_ns mono);

#endif
