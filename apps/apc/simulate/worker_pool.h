/* SPDX-License-Identifier: BSD-3-Clause */
/* Work that falls into independent jobs, for all processors. */
#ifndef APC_WORKER_POOL_H
#define APC_WORKER_POOL_H

#include <stdatomic.h>

#include <apcbase.h>

#define CACHE_LINE 64 /* bytes of a cache line: no two processes write the same one */

/* Memory that the processes share: this, and what they leave behind it. */
struct worker_pool {
    atomic_uint next, done; /* jobs taken; of `all`, made */
    atomic_bool stop;       /* somebody asked for an end: no more jobs are taken */
    unsigned jobs, all;     /* all: what progress is counted in */
    const char *what;       /* that is: "runs" */
};

/* Zeros, @p size bytes behind the pool, from *@p results on, a cache line's begin. NULL: no memory. */
struct worker_pool *worker_pool_create(size_t size, void **results);
void worker_pool_destroy(struct worker_pool *pool, size_t size);

/*
 * Call @p work for each job, from 0 on, in @p processes (0: one a CPU), each of which takes the next one that
 * is left. It counts `done` up itself. With progress on stderr, if that is a terminal. The first Ctrl-C lets
 * the jobs at hand come to their end, a second one ends them. Returns 0, or APC_ESYS: a process died, what it
 * had at hand is missing.
 */
int worker_pool_run(struct worker_pool *pool, unsigned processes, void (*work)(void *ctx, unsigned job),
                    void *ctx, struct apc_error *why);

#endif
