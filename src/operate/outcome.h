/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What became of an operator's write: one judgement for all who show it. The controller that acts on a
 * variable says in its row of table actual which row of the variable it has looked at, and what came of that;
 * its tick row says that it lives.
 */
#ifndef APC_RUN_OUTCOME_H
#define APC_RUN_OUTCOME_H

#include <apcstore.h>

enum outcome {
    OUTCOME_WAITING = 1, /* its controller has not come to it, or to the mode, yet */
    OUTCOME_APPLIED,     /* it is in force */
    OUTCOME_SUPERSEDED,  /* a newer row came after it */
    OUTCOME_REFUSED,     /* outcome_refusal() finds why */
    OUTCOME_NOBODY       /* its controller does not tick: outcome_age() */
};

/* What is known of a write, of one moment. */
struct outcome_seen {
    const struct apc_sample *write;  /* as it was stored: table, id, seq, value */
    const struct apc_sample *actual; /* newest of apc_variable_number() of that; seq 0: there is none */
    const struct apc_vector *tick;   /* newest of its controller; seq 0: it has never ticked */
    apc_ns period;                   /* of its controller; 0: not known */
    apc_ns now;                      /* UTC */
};

/* A mode that was written for all loops, under id 0, has an outcome in each loop: that of the loop's own row.
 * [tick] */
enum outcome outcome_of(const struct outcome_seen *seen);

/* How long ago it ticked; 0: just now, or never, or by a clock that is ahead of this one. [tick] */
apc_ns outcome_age(const struct outcome_seen *seen);

/*
 * With which words something was refused since @p since, UTC: of the events that say so the last one that
 * names @p name, or the last one. Returns whether there is one. The event may come a little after the row.
 * [setup]
 */
bool outcome_refusal(struct apc_store *store, const char *name, apc_ns since, char *text, size_t size);

#endif
