/* SPDX-License-Identifier: BSD-3-Clause */
/* What controllers say of themselves: why a loop is not in the mode that is wanted of it, or is in it by its
 * backup law. */
#ifndef APC_REASON_H
#define APC_REASON_H

#include "operate/operate.h"

#define REASON_LEN 192

/*
 * In @p text, from the events about that loop since it went to its actual mode or, where none tells, from
 * the modes alone. Returns @p text; NULL: all is as wanted, or one of them is not there.
 */
const char *mode_reason_find(struct apc_store *store, const struct loops *loops,
                             const struct loops_loop *loop, const struct apc_sample *target,
                             const struct apc_sample *actual, char text[REASON_LEN]);

#endif
