/* SPDX-License-Identifier: BSD-3-Clause */
/* Steady states of a linear model, and the one that fits references and limits best. */
#ifndef APC_TARGET_H
#define APC_TARGET_H

#include "apclinear.h"
#include "apcqp.h"

struct apc_target;

/* The model is borrowed. */
int apc_target_create(struct apc_target **target, struct apc_linear *model, struct apc_error *why);
void apc_target_destroy(struct apc_target *target); /* NULL is legal */

/* How many outputs are to be at a setpoint; weights of each input's distance from its reference, and of its moves,
 * both >= 0 [nu]: where setpoints or limits leave inputs a choice and nothing is preferred, the latter say what
 * a unit of each is worth. Returns 0 or APC_EINVAL. [tick] */
int apc_target_tune(struct apc_target *target, size_t sought, const double *r, const double *s,
                    struct apc_error *why);

struct apc_target_call {
    const double *unknown;          /* [nx - nx_plant - nx_held] */
    const double *drift;            /* [nx_plant + nx_held] that x0 gains in a period; NULL: x0 is at rest */
    const double *d;                /* [nd] */
    const double *reference, *cost; /* [nu]; cost NULL: none */
    const double *low, *high;       /* [nu] */
    const double *y_low, *y_high;   /* [ny] to lie between; the same: to be there */
    const double *q;                /* [ny] how much a distance from there counts */
    const unsigned *rank;           /* [ny] */
    unsigned ranks;
    /* Of a search: how many steps are left to it, which it counts down, and whether time is up; NULL: any */
    unsigned *left;
    bool (*enough)(void *ctx);
    void *ctx; /* of both */
};
/*
 * x [nx_plant + nx_held], u [nu], y [ny]: all y between their limits if that is possible, *reachable says so;
 * else those of rank 1 as near as possible, of rank 2 as near as that allows, and so on. Returns 0, or the
 * error of the quadratic program: then nothing is filled in. [tick]
 */
int apc_target_find(struct apc_target *target, const struct apc_target_call *call, double *x, double *u,
                    double *y, bool *reachable);

/* The model of a target, which is its caller's to change, and drift: linear at x, u [nu]. Returns 0, or an
 * error: it is not defined there. */
typedef int apc_target_linearise(void *ctx, const double *x, const double *u, struct apc_linear *model,
                                 double *drift);
/*
 * The same of a nonlinear model, by steps of Newton from x, u, which are filled in; call->drift is not looked
 * at. Returns 0, the error of @p linearise or of the quadratic program, APC_ESOLVER: no end to it, or
 * APC_ETIMEDOUT: no step or no time was left; x and u are then where it came to, to begin with the next time.
 * After any other error they and y are of no use. [tick]
 */
int apc_target_search(struct apc_target *target, const struct apc_target_call *call,
                      apc_target_linearise *linearise, double *x, double *u, double *y, bool *reachable);

#endif
