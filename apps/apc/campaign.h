/* SPDX-License-Identifier: BSD-3-Clause */
/* One experiment over many seeds: the figures of every run and what they are together. */
#ifndef APC_CAMPAIGN_H
#define APC_CAMPAIGN_H

#include <stdio.h>

#include "run/run_internal.h"

struct campaign_options {
    uint64_t seed; /* of the first run; the next has the next */
    unsigned runs;
    unsigned jobs;       /* processes; 0: one a CPU. The results do not depend on it */
    const char *csv;     /* a file for the figures of each run, "-" for stdout, or NULL */
    const char *against; /* such a file of another campaign, to compare with run by run; or NULL */
    bool json;           /* on stdout, in place of the tables */
    FILE *talk;          /* where the summary goes */
};

/*
 * Ctrl-C ends it after the runs that are under way, with a summary of those there were. Returns 0, or the
 * first error of a run (the others go on) or of the campaign itself.
 */
int campaign_run(const struct experiment *e, const struct campaign_options *options, struct apc_error *why);

#endif
