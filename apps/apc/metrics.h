/* SPDX-License-Identifier: BSD-3-Clause */
/* How well a loop was controlled: figures of measurement i against setpoint i, and of output i. */
#ifndef APC_METRICS_H
#define APC_METRICS_H

#include "common/experiment.h"
#include "samples.h"

/*
 * Between two samples a value stays as it was. A step is a change of the setpoint, the first one among them;
 * one smaller than a tenth of the largest counts as none. What no step shows (no setpoint changed, never
 * settled) is NAN.
 */
enum metric {
    METRIC_IAE,       /* integral of |r - y| */
    METRIC_ISE,       /* of (r - y)^2 */
    METRIC_ITAE,      /* of t |r - y|, t since the last step */
    METRIC_OVERSHOOT, /* beyond the new setpoint, in % of the step: the largest of all steps */
    METRIC_SETTLING,  /* s until y stays within 5 % of the step: the longest of all steps */
    METRIC_EFFORT,    /* sum of |u_k+1 - u_k| */
    METRICS
};

const char *metric_name(enum metric metric);

/* The loops that there are figures of: as many as have a measurement, a setpoint and an output. */
size_t metrics_loops(const struct experiment *e);
/* Of loop @p loop, from 0. The samples of each variable must be in order of time, until @p end in s. */
void metrics_of(const struct samples *s, size_t loop, apc_ns start, double end, double figure[METRICS]);

/* The largest step of setpoint @p id, the first one from where measurement @p id begins; NAN: there is none.
 */
double metrics_step(const struct samples *s, int id);

/* A table of them for people. Returns 0 or APC_ENOMEM. */
int metrics_print(const struct samples *s, const struct experiment *e, double end, FILE *out);

#endif
