/* SPDX-License-Identifier: BSD-3-Clause */
/* From the records of a run, whether its plant was controlled. */
#ifndef APC_CONTROL_HISTORY_H
#define APC_CONTROL_HISTORY_H

#include "control_verdict.h"
#include "experiment/experiment.h"

/* From when on the plant of a run that began at @p start is to be commanded: the controllers that do that
 * have ticked once, or had a fair time for it, and it has waited for a command as long as it ever does.
 * Returns 0 or a negative error. */
int control_history_begin(struct apc_store *store, const struct experiment *e, apc_ns start, apc_ns *begin);

/* What a record has not got of the measurements of its range. */
struct missing {
    const char *empty; /* a measurement of which there is no row; NULL: of each there is one */
    const char *name;  /* of which the most rows are missing; NULL: none is, of any */
    uint64_t rows, of; /* so many, of so many that there were */
};

/* Give @p control the transitions of the range in their order: the witness's events, which outputs were at
 * their fault value, and when one was out of service (all loops that it has). The names that it and
 * @p missing get are @p e's. Returns 0 or a negative error. */
int control_history_read(struct apc_store *store, const struct experiment *e, const struct apc_range *range,
                         struct control *control, struct missing *missing);

#endif
