/* SPDX-License-Identifier: BSD-3-Clause */
/* What is said of the runs of a campaign together. */
#ifndef APC_CAMPAIGN_SUMMARY_H
#define APC_CAMPAIGN_SUMMARY_H

#include "campaign.h"
#include "statistic.h"

/* Values, and whose they are: room for all runs. */
struct column {
    double *value;
    uint64_t *seed;
    size_t n;
};

/* Of the runs that have this figure; with @former of the differences to the other campaign's of the same
 * seed. @column is scratch. */
struct statistic summary_of(const struct campaign *c, size_t loop, enum metric metric, const double *former,
                            struct column *column);

/* All return 0 or a negative error. */
int summary_read(struct campaign *c, struct apc_error *why); /* c->former, from options->against */
int summary_print(const struct campaign *c, struct apc_error *why);
int summary_csv(const struct campaign *c, struct apc_error *why);
/* Tell of the runs that failed: the first one's error; also when runs are missing that nobody stopped. */
int summary_failures(const struct campaign *c, struct apc_error *why);

#endif
