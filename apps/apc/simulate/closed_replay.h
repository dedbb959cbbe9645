/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay --closed: figures of what would have been beside those on record. */
#ifndef APC_CLOSED_REPLAY_H
#define APC_CLOSED_REPLAY_H

#include "files/files.h"
#include "simulation/simulation.h"

/* Of the record @of of @name, with what its overrides say: for people or, where that is not NULL, into @json. Where @figure
 * is not NULL, recorded and otherwise as FIGURE.svg and FIGURE.png. Returns 0 or a negative error. */
int closed_replay(const char *name, const struct replay_range *of, const char *figure, struct text *json,
                  struct apc_error *why);

#endif
