/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The past of a run in real time, up to the time from which a simulation goes on: what its plant was given,
 * and what its controllers go on from, as its folder has it.
 */
#ifndef APC_PAST_H
#define APC_PAST_H

#include "record/samples.h"

struct past {
    struct samples rows;     /* outputs, setpoints and calculated signals, by time, in that of a simulation */
    struct apc_store *ticks; /* all else, in that of the run */
    apc_ns start, end;       /* UTC of its t = 0, and of its last instant */
};

/* Of the run in folder @p dir until @p end, since its start. Returns 0 or a negative error; past_free() in
 * either case. */
int past_load(struct past *p, const char *dir, const struct experiment *e, apc_ns end, struct apc_error *why);
/* Into the store of a simulation: of each variable that is not among the rows the newest. Returns 0 or the
 * error of one of the two. */
int past_end(const struct past *p, struct apc_store *to);
void past_free(struct past *p);

#endif
