/* SPDX-License-Identifier: BSD-3-Clause */
/* A campaign for each of several values of one number of an experiment. */
#ifndef APC_SWEEP_H
#define APC_SWEEP_H

#include "campaign.h"

struct sweep {
    char path[EXPERIMENT_SETTING];
    double from, to;
    unsigned n;
};

/* PATH=FROM..TO:N. Returns 0, or APC_EINVAL and why. */
int sweep_parse(const char *text, struct sweep *sweep, struct apc_error *why);
/* Value number @p i, as it stands in a file. */
void sweep_value(const struct sweep *sweep, unsigned i, char text[40]);

/* The runs of each value, @p e [sweep->n], and what they are: a table, or CSV (options->csv), or JSON; with
 * @p figure also a figure, FIGURE.svg and .png. @p now is the number that the file has; NAN: none. */
int sweep_run(const struct sweep *sweep, const struct experiment *e, double now,
              const struct campaign_options *options, const char *figure, struct apc_error *why);

#endif
