/* SPDX-License-Identifier: BSD-3-Clause */
/* A live store and the history of it, as one. */
#ifndef APC_SEAM_H
#define APC_SEAM_H

#include "shareddata/shareddata_internal.h"

/** In the author of a row that came from the history: the number is one of its names. */
#define APC_SEAM_AUTHOR (UINT32_C(1) << 31)

/** Both become its own, also on failure. */
int apc_federated_wrap(struct apc_store **store, struct apc_store *live, struct apc_store *history,
                       struct apc_error *why);

#endif
