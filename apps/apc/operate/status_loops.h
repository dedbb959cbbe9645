/* SPDX-License-Identifier: BSD-3-Clause */
/* The loops of a plant with what they do, a table a controller: for apc status. */
#ifndef APC_STATUS_LOOPS_H
#define APC_STATUS_LOOPS_H

#include "apc/common/cli.h"
#include "apc/common/mode_reason.h"
#include "common/timing.h"
#include "files/files.h"
#include "status_plan.h"

enum { LOOP_TARGET, LOOP_ACTUAL, LOOP_SP, LOOP_OWNER, LOOP_PV, LOOP_OP, LOOP_ROWS };

struct status_loops {
    const struct cli_plant *plant;
    struct apc_sample *row;      /* [loops][LOOP_ROWS]; table 0: it has none */
    struct apc_vector *tick;     /* [controllers] */
    char (*reason)[REASON_LEN];  /* [loops] "": its mode is the target */
    const struct timing *timing; /* "lateness" of the tasks */
    struct status_plan *plan;    /* [controllers] */
    struct plant_view view;
    struct ramps ramps;
    apc_ns now;
};

/* Read them. Returns 0, APC_ENOMEM or the store's error; status_loops_free() in either case. */
int status_loops_load(struct status_loops *s, struct apc_store *store, const struct cli_plant *plant,
                      const struct timing *timing);
/* No more than what stands beside an entry of @p n samples: notes and, if asked for, ramps. */
int status_entries_load(struct status_loops *s, struct apc_store *store, const struct cli_plant *plant,
                        const struct apc_sample *of, size_t n, bool ramps);
void status_loops_free(struct status_loops *s);
/* The loop that has that setpoint or output; NULL: none has. */
const struct loops_loop *status_loop_of_entry(const struct loops *loops, const struct apc_sample *of);

/* Longer without a new sample than @p period lets expect: a measurement or an output is stale then. */
bool status_is_stale(const struct cli_tags *tags, const struct apc_sample *sample, apc_ns now);
/* Does any of them show that variable? */
bool status_loops_have(const struct status_loops *s, const struct apc_sample *variable);
/* Whose the setpoint of a loop is that another one or the scheduler moves; NULL: nobody else does. */
const char *status_loops_owner(const struct status_loops *s, size_t loop);
/* What stands between an entry and its effect; NULL: nothing. */
const struct entry_note *status_loops_entry(const struct status_loops *s, size_t loop);
/* A line a ramp: of variable @p of, NULL: of all. */
void status_ramps_show(const struct status_loops *s, const struct apc_sample *of);
/* An array of them. */
void status_ramps_json(const struct status_loops *s, struct text *t);
/* A table a controller. Returns 0 or APC_ENOMEM. */
int status_loops_show(const struct status_loops *s, bool colour);
/* Members "controllers" and "loops", two arrays. */
void status_loops_json(const struct status_loops *s, struct text *t);

#endif
