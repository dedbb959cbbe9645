/* SPDX-License-Identifier: BSD-3-Clause */
/* The KPIs of a window of a run folder, or of a store's history. */
#ifndef APC_WINDOW_H
#define APC_WINDOW_H

#include "figures/figures.h"
#include "record/record.h"

/* Of the run in @p dir, t in s since its start; NAN: from its start, to its end. Returns 0 or a negative
 * error; kpis_free() in either case. @p horizon: of kpis_source. */
int window_of_run(struct kpis *m, const struct experiment *e, const char *dir, double from, double until,
                  const double *horizon, struct apc_error *why);
/* Of a store, t in UTC, as far as there is a record. */
int window_of_store(struct kpis *m, struct apc_store *store, apc_ns from, apc_ns until,
                    struct apc_error *why);
/* The health of its loops from m->from until m->until. */
int health_window_of_store(struct kpis *m, struct apc_store *store, const struct health_asked *asked,
                           struct apc_error *why);
/* What was expected at @p at of the run in @p dir, s since its start, and what came of it: prediction_free() in
 * either case. */
int window_prediction_of_run(struct prediction *o, const struct experiment *e, const char *dir, double at,
                             struct apc_error *why);
int window_prediction_of_store(struct prediction *o, struct apc_store *store, apc_ns at,
                               struct apc_error *why);

#endif
