/* SPDX-License-Identifier: BSD-3-Clause */
/* A recorded run over a simulated one. */
#ifndef APC_COMPARE_H
#define APC_COMPARE_H

#include <stdio.h>

#include "experiment/experiment.h"
#include "record/record.h"

struct compare {
    const struct samples *simulated; /* in order of time, as the next one */
    const struct samples
        *unchanged;     /* of a run that goes on otherwise: how it would have gone on; NULL: as recorded */
    double from;        /* s, when it does; 0: it does not */
    const char *dir;    /* of the recorded run */
    const char *figure; /* all of it as FIGURE.svg and FIGURE.png; NULL: none */
};

/*
 * For each variable of the run: how far its samples, from that time on, lie from the simulated ones that are
 * next to them in time, in the variable's unit and in percent of the largest step of the setpoint (of an
 * output: of what it spans). Returns 0 or a negative error.
 */
int compare_run(const struct compare *c, const struct experiment *e, FILE *out, struct apc_error *why);

#endif
