/* SPDX-License-Identifier: BSD-3-Clause */
/* The live line of a run: time, setpoint, y, u, mode, worst lateness, and a bar when the run has an end. */
#ifndef APC_LIVE_H
#define APC_LIVE_H

#include <apcshareddata.h>

#include "common/experiment.h"

struct live;

int live_create(struct live **live, struct apc_store *store, const struct experiment *e, apc_ns start,
                double duration);
void live_destroy(struct live *live);
/* Read and print; unless it is the last time, only now and then where stdout is no terminal. A store that is
 * away is said on the line; it is no error. */
void live_show(struct live *live, bool last);
/* A message of its own above the line. */
void live_say(struct live *live, const char *fmt, ...) APC_PRINTF(2, 3);
/* End the line. */
void live_end(struct live *live);

#endif
