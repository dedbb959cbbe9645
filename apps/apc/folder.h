/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A run folder: run.conf (the experiment file as it was), samples.csv, events.csv, timing.csv and
 * timing-summary.csv, one log a daemon, report.svg and report.png.
 */
#ifndef APC_FOLDER_H
#define APC_FOLDER_H

#include <apcshareddata.h>
#include <apctimer.h>

#include "common/experiment.h"

/*
 * Make the folder (and its parents) and put a copy of the experiment file there, which folder_keep() gives
 * its name: until then a run that was there before keeps its own.
 */
int folder_create(const char *dir, const char *experiment_file, struct apc_error *why);
int folder_keep(const char *dir, struct apc_error *why);
/* Take back what folder_create() made, when nothing has been added. */
void folder_discard(const char *dir);

/*
 * Write what the store recorded since and until (UTC) as CSV, with times relative to start. Each file appears
 * whole or not at all.
 */
int folder_export(const char *dir, struct apc_store *store, const struct experiment *e, apc_ns start,
                  apc_ns since, apc_ns until, struct apc_error *why);

#endif
