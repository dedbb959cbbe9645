/* SPDX-License-Identifier: BSD-3-Clause */
/* From the records of a run, whether its plant was controlled. */
#ifndef APC_EVIDENCE_H
#define APC_EVIDENCE_H

#include "control.h"
#include "run/run_internal.h"

/* From when on the plant of a run that began at @p start is to be commanded: the controllers that do that
 * have ticked once, or had a fair time for it, and it has waited for a command as long as it ever does.
 * Returns 0 or a negative error. */
int evidence_begin(struct apc_store *store, const struct experiment *e, apc_ns start, apc_ns *begin);

/* Give @p control the events of the range, and when an output was out of service (all loops that it has), in
 * their order. Returns 0 or a negative error. */
int evidence_take(struct apc_store *store, const struct experiment *e, const struct apc_range *range,
                  struct control *control);

#endif
