/* SPDX-License-Identifier: BSD-3-Clause */
/* A recorded run over a simulated one. */
#ifndef APC_COMPARE_H
#define APC_COMPARE_H

#include <stdio.h>

#include "run/run_internal.h"
#include "run/samples.h"

/*
 * For each variable of run folder @p dir: how far its samples lie from the simulated ones that are next to
 * them in time, in the variable's unit and in percent of the largest step of the setpoint (of an output: of
 * what it spans). With @p figure, not NULL: both as FIGURE.svg and FIGURE.png, too. The samples must be in
 * order of time. Returns 0 or a negative error.
 */
int compare_run(const struct samples *simulated, const struct experiment *e, const char *dir,
                const char *figure, FILE *out, struct apc_error *why);

#endif
