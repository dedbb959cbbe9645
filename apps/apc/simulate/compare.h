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

/* ---- Its figure ----------------------------------------------------------------------------- */

/* The samples of one variable: by time, in s. */
struct trace {
    double *t, *value;
    size_t n;
};

struct compare_variable {
    const struct apc_tag *tag;
    struct trace simulated, recorded, unchanged;
    struct trace setpoint; /* simulated, of a measurement that has one */
};

struct compare_figure {
    const char *title, *label;         /* label: of what is simulated */
    const struct compare_variable *of; /* [n] a panel each, of those with both */
    size_t n;
    double begin, from, end; /* s; from: a line is there; 0: none is */
};

/* Those of @tag, by time since @start. Returns 0 or APC_ENOMEM; trace_free() in either case. */
int trace_take(struct trace *trace, const struct samples *s, apc_ns start, const struct apc_tag *tag);
void trace_free(struct trace *trace);
/* As NAME.svg and NAME.png, which is said. Returns 0 or a negative error. */
int compare_draw(const struct compare_figure *f, const char *name, FILE *out, struct apc_error *why);

#endif
