/* SPDX-License-Identifier: BSD-3-Clause */
/* A run whose shared data and whose record are two stores: the live one, and the history. */
#ifndef APC_KEEP_H
#define APC_KEEP_H

#include <apcstore.h>

/* What the live store still has, and the history has not got. Returns 0 when it has all, or an error. */
int recovery_finish(const char *live, const char *history, apc_ns timeout, struct apc_error *why);

/*
 * The memory of a run of the folder @p dir that was killed: what waits in spools goes there, and all of it
 * into its history, or where the folder does not say which, into @p store; then it is freed. Returns 1, 0
 * when there is none, or why it is still there; APC_EBUSY: the run goes on.
 */
int recovery_of_killed_run(const char *dir, const char *store, apc_ns timeout, struct apc_error *why);

#endif
