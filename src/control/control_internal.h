/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_CONTROL_INTERNAL_H
#define APC_CONTROL_INTERNAL_H

#include "apccontrol.h"

/** Check a law from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL. */
int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why);

#endif
