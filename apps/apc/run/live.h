/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The live line of a run: time, setpoint, y, u and mode of its loop (of two: mode, y and setpoint of each; of
 * more: how many are in which mode), worst lateness, and a bar when the run has an end. A value that is old,
 * uncertain or bad says so, and so does the line when the plant stands at its safe value.
 *
 * The same process does what the experiment's actions ask an operator for. It is one of its own: a store that
 * hangs, or shared memory that somebody cuts short, must not stop whoever looks after the daemons.
 */
#ifndef APC_LIVE_H
#define APC_LIVE_H

#include <apcstore.h>

#include "experiment/experiment.h"

struct live;

/* Begin; t = 0 is at @start, UTC, and at @zero, monotonic. Returns 0, APC_ENOMEM or APC_ESYS. */
int live_start(struct live **live, const char *store, const struct experiment *e, apc_ns start, apc_ns zero,
               double duration);
/* A message of its own above the line, and an event of the records. */
void live_say(struct live *live, enum apc_event_severity severity, const char *fmt, ...) APC_PRINTF(3, 4);
/* End the line; @p whole: after showing it once more. NULL is legal. */
void live_end(struct live *live, bool whole);

#endif
