/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What an operator writes to loops, with what hangs on it. A setpoint that a loop above moves is that loop's
 * while the target of its own is Cas, else the operator's; so whoever changes the owner writes target and
 * setpoint together, each only if nobody did since it was looked at.
 */
#ifndef APC_RUN_OWNER_H
#define APC_RUN_OWNER_H

#include "loops.h"

/* Rows that were written besides. Of table opmode: the loop was in Cas, and is the operator's now. */
struct owner_rows {
    struct apc_sample *at; /* free() */
    size_t n;
};

/*
 * Write operator variables as one, as apc_store_swap() does it: seq is the newest that the caller knows, or
 * APC_SEQ_ANY, and becomes that of the row. A setpoint whose loop's target is Cas takes the target Auto
 * along; a target that comes to Cas or goes from it takes the setpoint along, as it is in force. Returns 0,
 * APC_ECONFLICT (a seq was not the newest; or, after ten tries, somebody was always faster: then @p samples
 * are what is newest), APC_ENOMEM or the store's error.
 */
int owner_put(struct apc_store *store, const struct loops *loops, struct apc_sample *samples, size_t n,
              struct owner_rows *with);

#endif
