/* SPDX-License-Identifier: BSD-3-Clause */
/* Steady states of a linear model, and the one that fits wishes and limits best. */
#ifndef APC_TARGET_H
#define APC_TARGET_H

#include "apclinear.h"
#include "apcqp.h"

struct apc_target;

int apc_target_create(struct apc_target **target, const struct apc_linear *model, struct apc_error *why);
void apc_target_destroy(struct apc_target *target); /* NULL is legal */

/* Weights of each input's distance from its wish, >= 0 [nu]. Returns 0 or APC_EINVAL. [tick] */
int apc_target_tune(struct apc_target *target, const double *r, struct apc_error *why);

struct apc_target_call {
    const double *unknown;        /* [nx - nx_plant - nx_held] */
    const double *d;              /* [nd] */
    const double *wish, *cost;    /* [nu]; cost NULL: none */
    const double *low, *high;     /* [nu] */
    const double *y_low, *y_high; /* [ny] to lie between; the same: to be there */
    const double *q;              /* [ny] how much a distance from there counts */
    const unsigned *rank;         /* [ny] */
    unsigned ranks;
};
/*
 * x [nx_plant + nx_held], u [nu], y [ny]: all y between their limits if that is possible, *reachable says so;
 * else those of rank 1 as near as possible, of rank 2 as near as that allows, and so on. Returns 0, or the
 * error of the quadratic program: then nothing is filled in. [tick]
 */
int apc_target_find(struct apc_target *target, const struct apc_target_call *call, double *x, double *u,
                    double *y, bool *reachable);

#endif
