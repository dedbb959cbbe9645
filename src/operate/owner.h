/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What an operator writes, with what hangs on it. A setpoint that somebody else moves has an owner. Where
 * that is a loop above, the setpoint is its while the target of its own is Cas, else the operator's; where it
 * is the scheduler, a switch says so (LOOPS_OWNER). Whoever changes the owner writes it and the setpoint
 * together, each only if nobody did since it was looked at.
 */
#ifndef APC_RUN_OWNER_H
#define APC_RUN_OWNER_H

#include "loops.h"

/* Rows that were written besides. Of table opmode: the setpoint was another's, and is the operator's now. */
struct owner_rows {
    struct apc_sample *at; /* free() */
    size_t n;
};

/*
 * Write operator variables as one, as apc_store_swap() does it: seq is the newest that the caller knows, or
 * APC_SEQ_ANY, and becomes that of the row. A setpoint that is another's takes along what makes it Local, the
 * target Auto or the switch; a target that comes to Cas or goes from it, and a switch that changes, take the
 * setpoint along, as it is in force. Returns 0, APC_ECONFLICT (a seq was not the newest; or, after ten tries,
 * somebody was always faster: then @p samples are what is newest), APC_ENOMEM or the store's error.
 */
int owner_put(struct apc_store *store, const struct loops *loops, struct apc_sample *samples, size_t n,
              struct owner_rows *with);

#endif
