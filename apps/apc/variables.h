/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shared data of a simulation: the newest sample of each variable, and the history of measurements,
 * setpoints and outputs. What the store mem: is in one process, without its locks and checks: a campaign
 * reads and writes it some ten million times.
 */
#ifndef APC_VARIABLES_H
#define APC_VARIABLES_H

#include <apcbase.h>

#include "samples.h"

struct variables {
    struct apc_sample *newest[APC_TABLE_END]; /* by id; seq 0: none */
    size_t n[APC_TABLE_END];
    struct samples history;
};

void variables_free(struct variables *v);
/* As apc_store_read(). */
void variables_read(const struct variables *v, struct apc_sample *samples, size_t n);
/* As apc_store_append() by the one writer that a table has: the seq of each sample is the next. 0 or
 * APC_ENOMEM. */
int variables_append(struct variables *v, const struct apc_sample *samples, size_t n);
/* As apc_store_put(). */
int variables_put(struct variables *v, struct apc_sample *samples, size_t n);

#endif
