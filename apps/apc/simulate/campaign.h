/* SPDX-License-Identifier: BSD-3-Clause */
/* One experiment over many seeds: the figures of every run and what they are together. */
#ifndef APC_CAMPAIGN_H
#define APC_CAMPAIGN_H

#include <stdio.h>

#include "trial.h"
#include "worker_pool.h"

struct campaign_options {
    uint64_t seed; /* of the first run; the next has the next */
    unsigned runs;
    unsigned jobs;       /* processes; 0: one a CPU. The results do not depend on it */
    const char *csv;     /* a file for the figures of each run, "-" for stdout, or NULL */
    const char *against; /* such a file of another campaign, to compare with run by run; or NULL */
    bool json;           /* on stdout, in place of the tables */
    FILE *talk;          /* where the summary goes */
};

struct campaign {
    const struct experiment *e;
    const struct campaign_options *options;
    const struct loop *loop;
    size_t loops, stride; /* bytes: from one trial to the next */
    struct worker_pool *pool;
    void *trials;
    double *former; /* [runs * loops * METRICS] of the campaign to compare with; NULL: none */
};

/*
 * Ctrl-C ends it after the runs that are under way, with a summary of those there were. Returns 0, or the
 * first error of a run (the others go on) or of the campaign itself.
 */
int campaign_run(const struct experiment *e, const struct campaign_options *options, struct apc_error *why);

/* The parts of it, for several campaigns at once: of the same loops, with the same options. campaigns_end()
 * in either case. Each loop of room is controllers_loops(). */
int campaigns_make(struct campaign *campaign, size_t n, const struct experiment *e, struct loop *loop,
                   const struct campaign_options *options, struct apc_error *why);
int campaigns_run(struct campaign *campaign, size_t n, struct apc_error *why);
void campaigns_end(struct campaign *campaign, size_t n);

/* What came of one of its runs. */
struct trial *campaign_trial(const struct campaign *c, unsigned run);

#endif
