/* SPDX-License-Identifier: BSD-3-Clause */
/* Laws in a process of their own. */
#ifndef APC_CONTROL_PROCESS_H
#define APC_CONTROL_PROCESS_H

#include "control/control_internal.h"

/** Is the law of that path a program of its own, not a shared object? */
bool apc_law_is_process(const char *name);
/** Start it and ask what it is; as apc_law_find(). [setup] */
int apc_law_process_open(const char *file, const struct apc_law **law, void **handle, struct apc_error *why);
/** A mark of its file; 0: @p law is none of these. [setup] */
uint32_t apc_law_process_mark(const struct apc_law *law);

#endif
