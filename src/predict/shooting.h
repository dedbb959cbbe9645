/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Multiple shooting: what a nonlinear model does over a horizon, linear about a trajectory that need not be
 * one yet. Each interval is integrated from its own node, so that an unstable plant does not run away on
 * paper; where the end of one and the beginning of the next differ, the linear prediction closes the gap.
 *
 * u is constant over each of the intervals, and over blocks of them as in predict/mpc.h; unknown disturbances
 * stay what they are.
 */
#ifndef APC_SHOOT_H
#define APC_SHOOT_H

#include "apclinear.h"
#include "apcplant.h"
#include "predict/nested.h"

struct apc_shooting;

/* All is copied but the model. */
struct apc_shooting_options {
    const struct apc_model *model;
    const double *p;           /* [np]; NULL: the model's own */
    struct apc_nested *nested; /* its loops, borrowed, whose states are behind its own; NULL: none */
    double Ts;                 /* s, of an interval */
    unsigned steps;            /* of Runge and Kutta in each */
    size_t horizon, blocks;
    const unsigned *block;                    /* [blocks] */
    const struct apc_linear_unknown *unknown; /* [n_unknown] as of an extended estimator */
    size_t n_unknown;
    const double *u0;    /* [nu] */
    const double *delay; /* [nu] s by which an input acts later, from 0; NULL: zeros */
};

int apc_shooting_create(struct apc_shooting **shoot, const struct apc_shooting_options *options,
                        struct apc_error *why);
void apc_shooting_destroy(struct apc_shooting *shoot); /* NULL is legal */
/* Why the model said nothing, where it can say why; "": it cannot. [tick] */
const char *apc_shooting_error(const struct apc_shooting *shoot);
/* Is x in the ranges where the model holds? [tick] */
bool apc_shooting_holds(const struct apc_shooting *shoot, const double *x);
/* The model's own disturbances [nd] from now on, before unknown ones add to them. [tick] */
void apc_shooting_measure(struct apc_shooting *shoot, const double *own);
/* x [nx] on by t, with u [nu] and unknown disturbances d [n_unknown]. Returns 0, or APC_ESOLVER: the model is
 * not defined there, x is as it was. [tick] */
int apc_shooting_advance(struct apc_shooting *shoot, double *x, const double *u, const double *d, double t);
/*
 * About nodes [horizon * nx], the states at the ends of the intervals, the first of which begins at x [nx],
 * and about moves plan [blocks * nu]: y of the ends is free_y + G (u - u0), free_y [horizon * ny], G [horizon
 * * ny * n]. What a delay lets act before the plan does is past, row a - 1 [nu] of a periods ago; NULL where
 * there is no delay. What acts on y at once is that at the end of the interval. Returns 0, or APC_ESOLVER:
 * the model is not defined at some node. [tick]
 */
int apc_shooting_linearise(struct apc_shooting *shoot, const double *x, const double *d, const double *plan,
                           const double *past, const double *nodes, double *G, double *free_y);
/*
 * How the sum of worth y bends, worth [horizon * ny], y of the ends as a run from x with moves about @p plan
 * has them: its second derivatives, the lower half of @p curve [n * n], by differences over step [nu].
 * Returns 0, APC_ESOLVER as above, or APC_ETIMEDOUT where @p enough says so. [tick]
 */
int apc_shooting_bend(struct apc_shooting *shoot, const double *x, const double *d, const double *plan,
                      const double *past, const double *worth, const double *step, double *curve,
                      bool (*enough)(void *ctx), void *ctx);
/* The nodes to where the last linearisation has them with other moves. [tick] */
void apc_shooting_move(const struct apc_shooting *shoot, const double *plan, double *nodes);
/* x at the end of the horizon, of the last linearisation, and then former inputs that are still to act, as
 * apclinear.h has them: free_x [nc] + Gx [nc * n] (u - u0). [tick] */
void apc_shooting_end(const struct apc_shooting *shoot, const double *nodes, const double *past, double *Gx,
                      double *free_x);
/* Linear at x, u: an interval into A and B of @p to, which has the former inputs in its state; y into its C
 * and D; its point x0, u0, y0; drift [nc] = what x gains. What is measured of disturbances is in these, and
 * so has columns of zeros. Returns as apc_shooting_advance(). [tick] */
int apc_shooting_sample(struct apc_shooting *shoot, const double *x, const double *u, const double *d,
                        struct apc_linear *to, double *drift);

#endif
