/* SPDX-License-Identifier: BSD-3-Clause */
/* The parts of a loop's health. */
#ifndef APC_FIGURES_INTERNAL_H
#define APC_FIGURES_INTERNAL_H

#include "figures.h"

/* Least squares and correlations over lags: to[k] is the mean of a[t] b[t - k], k = 0 to m < n. */
void lagged_products(const double *a, const double *b, size_t n, size_t m, double *to);

/* How long a row stands for what is: as the plant's watchdog has it. */
apc_ns row_patience(apc_ns period);

/* What friction of an actuator explains. */
struct friction {
    double size;     /* deadband and stickband together, units of the output; 0: none explains more */
    double evidence; /* logarithm of how much likelier the record is with it */
    double share;    /* of what a linear plant leaves unexplained */
};
/* Of @n ticks of output @u and measurement @y. Returns 0 or APC_ENOMEM. */
int friction_find(struct friction *f, const double *u, const double *y, size_t n);

/* The ticks of a loop while its record passes by, and where its longest stretch in service with one setpoint
 * lies. */
struct stretch {
    double *y, *r, *u, *measured;
    size_t n, room, n_measured, room_measured;
    size_t begin, longest, longest_n;
    apc_ns last, period; /* of ticks */
    bool follows;        /* its setpoint moves all the time: a loop above gives it */
    int rc;              /* APC_ENOMEM: rows are missing */
};
void stretch_measured(struct stretch *to, double value);
void stretch_tick(struct stretch *to, apc_ns time, double y, double r, double u);
void stretch_break(struct stretch *to);
/* Its health, and it is freed. Returns 0 or APC_ENOMEM. */
int stretch_judge(struct stretch *of, double limited, double horizon, struct health *h);

#endif
