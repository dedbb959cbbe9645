/* SPDX-License-Identifier: BSD-3-Clause */
/* Who will apply an operator's changes, and what becomes of them: operate/operate.h, as a command says it. */
#ifndef APC_OUTCOME_H
#define APC_OUTCOME_H

#include "operate.h"

struct waiting {
    const struct operation *operation;
    struct apc_sample *actual; /* [n] what became of each change */
    struct apc_vector *tick;   /* [controllers] newest of each; none was read: seq 0 */
    apc_ns *period;            /* [controllers] */
    apc_ns patience;           /* for what a controller that ticks does in time */
};

/*
 * Before a write: does each controller tick that it is for? Returns EXIT_OK, or an exit code after saying
 * that nobody would apply it; outcome_free() in either case.
 */
int outcome_prepare(struct waiting *waiting, const struct cli *cli, struct apc_store *store,
                    const struct operation *operation);
/* After it: wait for what becomes of each change, and say so. Returns EXIT_OK when all were applied. */
int outcome_await(struct waiting *waiting, const struct cli *cli, struct apc_store *store);
void outcome_free(struct waiting *waiting);

#endif
