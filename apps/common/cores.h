/* SPDX-License-Identifier: BSD-3-Clause */
/* The modules' cores as an experiment file describes them: for the daemons and for the simulation alike. */
#ifndef APC_CORES_H
#define APC_CORES_H

#include <apcmodules.h>

#include "experiment.h"

/* All return 0 or a negative error with its text in why. The plant's is experiment_plant(). */
int cores_controller(const struct experiment *e, struct apc_controller **controller, struct apc_error *why);
int cores_client(const struct experiment *e, const int64_t *last, apc_ns since, struct apc_client **client,
                 struct apc_error *why);

/* How long the client waits for a reply. */
apc_ns cores_patience(const struct experiment *e);
/* No frame between them is longer. */
size_t cores_frame_max(const struct experiment *e);

#endif
