/* SPDX-License-Identifier: BSD-3-Clause */
/* Work that falls into independent jobs, for all processors. */
#ifndef APC_FARM_H
#define APC_FARM_H

#include <stdatomic.h>

#include <apcbase.h>

#define FARM_LINE 64 /* bytes of a cache line: no two processes write the same one */

/* Memory that the processes share: this, and what they leave behind it. */
struct farm {
    atomic_uint next, done; /* jobs taken; of `all`, made */
    atomic_bool stop;       /* somebody asked for an end: no more jobs are taken */
    unsigned jobs, all;     /* all: what progress is counted in */
    const char *what;       /* that is: "runs" */
};

/* Zeros, @p size bytes behind the farm, from *@p results on, a cache line's begin. NULL: no memory. */
struct farm *farm_create(size_t size, void **results);
void farm_destroy(struct farm *farm, size_t size);

/*
 * Call @p work for each job, from 0 on, in @p processes (0: one a CPU), each of which takes the next one that
 * is left. It counts `done` up itself. With progress on stderr, if that is a terminal. The first Ctrl-C lets
 * the jobs at hand come to their end, a second one ends them. Returns 0, or APC_ESYS: a process died, what it
 * had at hand is missing.
 */
int farm_run(struct farm *farm, unsigned processes, void (*work)(void *ctx, unsigned job), void *ctx,
             struct apc_error *why);

#endif
