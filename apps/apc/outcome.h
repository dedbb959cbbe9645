/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What becomes of an operator's write. The controller says with each tick how many rows of operators it has
 * looked at (the sum of their seqs), what it puts out and which mode it is in; from that follows for each
 * change whether it was applied, superseded by a newer one, or refused.
 */
#ifndef APC_OUTCOME_H
#define APC_OUTCOME_H

#include "operate.h"

struct outcome {
    struct cli_tags tags;
    struct apc_sample *row; /* [n] the operators' variables, then the controller's */
    size_t n, operators;    /* of these the operators' */
    size_t taken;           /* the index of how many rows were taken; actual mode and outputs follow */
    apc_ns patience;        /* for what a controller that ticks does in time */
};

/*
 * Before a write: is there a controller that ticks? Returns EXIT_OK, or an exit code after saying that nobody
 * would apply it; outcome_free() in either case.
 */
int outcome_prepare(struct outcome *outcome, const struct cli *cli, struct apc_store *store);
/* After it: wait for what becomes of each change, and say so. Returns EXIT_OK when all were applied. */
int outcome_await(struct outcome *outcome, const struct cli *cli, struct apc_store *store,
                  struct change *changes, size_t n);
void outcome_free(struct outcome *outcome);

#endif
