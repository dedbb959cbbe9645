/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * How far the experiment's own noise moves its measurements, around an operating point, and what each part of
 * its timing adds to that.
 */
#ifndef APC_LINEAR_COST_H
#define APC_LINEAR_COST_H

#include "linear_loop.h"

/* Each with all that stands before it. */
enum linear_cause {
    COST_IDEAL,   /* more often, and at once */
    COST_PERIOD,  /* as often as they tick, and at once */
    COST_LATENCY, /* with what passes on average from a measurement to what follows from it */
    COST_JITTER,  /* which is not always the same */
    COST_LOSS,    /* and frames are lost */
    COST_CAUSES
};

struct linear_cost {
    bool known[COST_CAUSES];
    double *y[COST_CAUSES]; /* [dim.ny] mean squares; HUGE_VAL: it grows without bound */
    double faster;          /* of COST_IDEAL: how often, in ticks of a period */
    char unknown[160];      /* why the last of them are not */
    double *memory;
};

/* @l is the loop of @how. Returns 0 or a negative error; linear_cost_free() in either case. */
int linear_cost_create(struct linear_cost *c, const struct experiment *e, const struct linear_loop *l,
                       const struct linear_how *how, struct apc_error *why);
void linear_cost_free(struct linear_cost *c);

/* The share of draws that are @x at most. */
double distribution_below(const struct apc_distribution *d, double x);

#endif
