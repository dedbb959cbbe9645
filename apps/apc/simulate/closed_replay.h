/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay --closed: figures of what would have been beside those on record. */
#ifndef APC_CLOSED_REPLAY_H
#define APC_CLOSED_REPLAY_H

#include "experiment/experiment.h"
#include "files/files.h"

/* Of the run in folder @dir with what @overrides say: for people or, where that is not NULL, into @json. Returns 0 or
 * a negative error. */
int closed_replay(const char *dir, const struct experiment_overrides *overrides, struct text *json,
                  struct apc_error *why);

#endif
