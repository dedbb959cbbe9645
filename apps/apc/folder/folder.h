/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A run folder, the whole record of a run: run.conf (the experiment file as it was), record.conf (what was
 * in force beside it: experiment/experiment.h), law.so and plant.so (plant.fmu) when they were no built-in ones;
 * samples.csv, samples.columns, ticks.db, operation.csv, written.csv, signals.csv, events.csv, timing.csv and
 * timing-summary.csv; one log a daemon, report.svg and report.png. docs/run-folder.md describes them.
 */
#ifndef APC_FOLDER_H
#define APC_FOLDER_H

#include <apcstore.h>
#include <apctimer.h>

#include "experiment/experiment.h"

/* What the record says beside the experiment. */
struct folder_metadata {
    const char *by;                   /* the command */
    const char *timer, *store, *host; /* NULL: in virtual time */
    const char *live;                 /* the store in memory beside that; NULL: there is none */
    apc_ns start;                     /* t = 0: UTC */
};

/*
 * Make an empty folder runs/NAME-TIME, or with a number behind it where there is one already: of several that
 * begin in the same second each gets its own. Its path goes to @p dir.
 */
int folder_choose(char *dir, size_t size, const char *name, struct apc_error *why);
/* Make the folder and its parents. One that is not empty is refused, unless @p force. */
int folder_make(const char *dir, bool force, struct apc_error *why);
/*
 * The same for @p e and what its record consists of, under names which folder_keep()
 * makes the real ones: until then a run that was there before keeps its own.
 */
int folder_create(const char *dir, const struct experiment *e, bool force, struct apc_error *why);
/* From here on the folder is this run's: what else was there of another one goes. */
int folder_keep(const char *dir, const struct experiment *e, const struct folder_metadata *metadata,
                struct apc_error *why);
/* t = 0 of the run is known now. */
int folder_begins(const char *dir, apc_ns start, struct apc_error *why);
/* Its folder has got this name, and its record's store, store.db within, with it. @p live: the store in memory, under
 * the name that it has got; NULL: there is none any more. */
int folder_moved(const char *dir, const char *live, struct apc_error *why);
/* A copy of the file @p from, whole or not at all. */
int folder_copy(const char *dir, const char *name, const char *from, struct apc_error *why);
/* Take back what folder_create() made, when nothing has been added. */
void folder_discard(const char *dir, const struct experiment *e);

/*
 * Write what the store recorded since and until (UTC; 0: all) as CSV, with times relative to @p start, and
 * into the record when the run @p ended, in s; 0: just after its last sample. Each file appears whole or not
 * at all.
 */
int folder_export(const char *dir, struct apc_store *store, const struct experiment *e, apc_ns start,
                  double ended, apc_ns since, apc_ns until, struct apc_error *why);

/* What the files of @p dir hold as a store in memory, t = 0 at @p zero: samples, modes, tuning, events, what laws
 * published; not the alarms' journal, which no file has. Returns 0 or a negative error; to be closed in either case. */
int folder_store(struct apc_store **store, const char *dir, const struct experiment *e, apc_ns zero,
                 struct apc_error *why);

#define COLUMNS_FILE "samples.columns"

/* Make samples.columns of samples.csv: what Python reads faster. Where it cannot be there is none. */
void folder_columns(const char *dir);

/* What people wrote to a simulated plant, each row at the tick at which it took effect. Returns 0 or an error. */
struct samples;
int folder_put_written(const char *dir, const struct samples *written, apc_ns start, struct apc_error *why);
/* The same of what has come to it from row @p from on, behind what is there: as people go on. */
int folder_add_written(const char *dir, const struct samples *written, size_t from, apc_ns start,
                       struct apc_error *why);

/* Rows of modes, tuning and manual outputs, or of tuning alone, that an operator wrote in the run whose folder
 * @p e is of: what a computation from its file leaves out. */
unsigned long long folder_operated(const struct experiment *e, bool tuning);

/* Refuse to write over a file, but for an empty one and what is no regular file. */
int folder_spare(const char *path, bool force, struct apc_error *why);
/* What was written to @p part becomes @p path, which may be there as a plain file and not as a device. Returns 0, or
 * an error and @p part is gone. */
int folder_replace(const char *part, const char *path, struct apc_error *why);

#endif
