/* SPDX-License-Identifier: BSD-3-Clause */
/* A record in closed loop: closed_record.c reads it, closed.c simulates it. */
#ifndef APC_CLOSED_INTERNAL_H
#define APC_CLOSED_INTERNAL_H

#include "simulation.h"

/* As it was described then, and with what @p overrides say. Returns 0 or an error. */
int closed_experiment(const struct closed *c, struct experiment *e,
                      const struct experiment_overrides *overrides, struct apc_error *why);
/* Of a part, its scheduler is at the step that was due then: @p e goes on with it. Returns 0 or an error. */
int closed_shift_scheduler(const struct closed *c, struct experiment *e, struct apc_error *why);
/* What the model makes of the outputs on record. Returns 0 or an error. */
int closed_estimate(struct closed *c, struct apc_error *why);
/* Samples, for qsort(). */
int closed_by_variable_and_time(const void *left, const void *right);

#endif
