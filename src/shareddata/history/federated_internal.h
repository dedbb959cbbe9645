/* SPDX-License-Identifier: BSD-3-Clause */
/* Inside the files federated*.c: a live store and its history behind one handle. */
#ifndef APC_SHAREDDATA_SEAM_INTERNAL_H
#define APC_SHAREDDATA_SEAM_INTERNAL_H

#include "base/base_internal.h"
#include "shareddata/history/federated.h"

struct apc_federated {
    struct apc_store base; /* before the live one */
    struct apc_store *history;
    bool checked;       /* the history is of this experiment */
    apc_ns quiet_until; /* monotonic: it is left alone so long */
    unsigned away;      /* times in a row that it was */
    int failed;         /* the last time, because of reason */
    struct apc_error reason;
};

/* May the history be asked? */
bool apc_federated_has_history(struct apc_federated *s);
/* It answered so to what began then. Without it there is less to give, and no failure. */
int apc_federated_answered(struct apc_federated *s, int rc, apc_ns began, const char *text);

int apc_federated_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
int apc_federated_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);

#endif
