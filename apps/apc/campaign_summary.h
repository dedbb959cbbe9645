/* SPDX-License-Identifier: BSD-3-Clause */
/* What the runs of a campaign gave, and what is said of them together. */
#ifndef APC_CAMPAIGN_SUMMARY_H
#define APC_CAMPAIGN_SUMMARY_H

#include <stdatomic.h>

#include "campaign.h"
#include "run/figures.h"

/* Shared by all processes; the results lie behind it. */
struct board {
    atomic_uint next, done;
    atomic_bool stop;
};

/* figure[loop * METRICS + metric] lies behind each. */
struct result {
    bool made, diverged;
    int rc;
    uint64_t held, failures; /* ticks: output not the law's; the law gave no usable output */
    char why[200];
};

struct campaign {
    const struct experiment *e;
    const struct campaign_options *options;
    const struct loop *loop;
    size_t loops, first, stride; /* bytes: to the first result, of one with its figures */
    struct board *board;
    double *former; /* [runs * loops * METRICS] of the campaign to compare with; NULL: none */
};

struct result *campaign_result(const struct campaign *c, unsigned run);
double *campaign_figures(const struct campaign *c, unsigned run);

/* All return 0 or a negative error. */
int summary_read(struct campaign *c, struct apc_error *why); /* c->former, from options->against */
int summary_print(const struct campaign *c, struct apc_error *why);
int summary_csv(const struct campaign *c, struct apc_error *why);
/* Tell of the runs that failed: the first one's error; also when runs are missing that nobody stopped. */
int summary_failures(const struct campaign *c, struct apc_error *why);

#endif
