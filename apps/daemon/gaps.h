/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What a history will not have is an event in the live store, before the history gets what follows: so
 * whoever moves on after this process has ended finds the word.
 */
#ifndef APC_COMMON_GAPS_H
#define APC_COMMON_GAPS_H

#include "apcbase.h"
#include "apcstore.h"

struct gap_teller {
    struct apc_store *live;
    const char *source;  /* of the events */
    struct apc_log *log; /* where they are written as well; NULL: nowhere */
};

/* For apc_replication_tell(): ctx is a struct gap_teller. */
int gap_tell(void *ctx, const struct apc_replication_gap *gap);

#endif
