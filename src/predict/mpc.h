/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The problem of linear predictive control, for a law around it: from an estimated state to the moves to
 * come.
 *
 * Over the predicted samples i = 1..N, with u constant within each block b of moves,
 *     sum of q (y_i - target_i)^2 / 2  +  sum of s (u_b - u_b-1)^2 / 2  +  sum of r (u_b - u_target)^2 / 2
 * and, where there is a terminal weight, what all of this would cost after N without limits; and the sum of
 * price w_i y_i, whose setpoints w are what a unit of y costs in sample i. Limits and rates
 * of u are hard; those of y are hard as long as there is a way, else they are given up in order of rank, the
 * highest number first, each no more than it must be. A y with a zone costs nothing within it.
 *
 * Targets are steady states of the model: those of the setpoints where limits allow, else the nearest, rank
 * by rank.
 *
 * Everything is allocated at creation. A solution depends on the call alone, not on the calls before it.
 */
#ifndef APC_MPC_H
#define APC_MPC_H

#include "apclinear.h"
#include "apcqp.h"
#include "predict/target.h"

struct apc_mpc;

/* Arrays are copied; the model is borrowed. Zero or NULL means default. */
struct apc_mpc_options {
    const struct apc_linear *model; /* required */
    size_t horizon;                 /* N, required */
    size_t blocks;                  /* required */
    const unsigned *block;          /* [blocks] samples that each lasts; the last one goes on to the end */
    const unsigned *rank;           /* [ny] 1 is given up last; default 1 */
    const bool *limits, *zone;      /* [ny] has limits, may get a zone; default none */
    const bool *rate;               /* [nu] has a rate; default none */
    bool terminal;
    /* Of a nonlinear model: `model` is what it is at rest somewhere, with its dead times, and what y does is
     * said from outside. NULL: it does as `model` says. */
    apc_target_linearise *linearise;
    unsigned iterations;       /* of a solve of apc_qp, and of a search for steady states; 0: ten for each
                                  move and row */
    bool (*enough)(void *ctx); /* of both */
    void *ctx;                 /* of all three */
};

/* What an engineer turns. [ny] or [nu], in order; all >= 0. */
struct apc_mpc_weights {
    const double *q;     /* of each y; 0: not controlled */
    const double *s;     /* of moves */
    const double *r;     /* of each u's distance from where it wants to be */
    const double *zone;  /* half its width; 0: y is to be at its setpoint */
    const double *price; /* [ny] of each y with q = 0, any sign; NULL: zeros */
    const double *least; /* [ny] of each y, in the terminal weight only, and only where the others leave a
                            mode that does not die out by itself without any; NULL: zeros */
};

struct apc_mpc_call {
    const double *x;              /* [nx] estimated, with unknown disturbances */
    const double *w;              /* [(N + 1) * ny] setpoints, row 0 now */
    const double *d;              /* [(N + 1) * nd] measured disturbances */
    const double *u_last;         /* [nu] that acts now */
    const double *u_reference;    /* [nu] where u wants to be, as far as setpoints leave it free */
    const double *u_cost;         /* [nu] of a steady u, per unit; NULL: none */
    const double *low, *high;     /* [nu] */
    const double *step;           /* [nu] most that u may change from one sample to the next */
    const double *y_low, *y_high; /* [ny] */
    const bool *given;            /* [nu] stays at u_last, whatever we want */
};

struct apc_mpc_result {
    int rc;              /* as of apc_qp_solve() */
    unsigned iterations; /* of all solves */
    unsigned solves;
    unsigned given_up; /* the lowest rank whose limits the plan breaks; 0: it keeps all */
    bool waits;        /* limits leave too little room to calculate with: the plan keeps them, as well as can
                          be, and sees to nothing else */
    bool reachable;    /* steady states at the setpoints lie within the limits */
};

int apc_mpc_create(struct apc_mpc **mpc, const struct apc_mpc_options *options, struct apc_error *why);
void apc_mpc_destroy(struct apc_mpc *mpc); /* NULL is legal */
/* Take weights: returns 0, or APC_EINVAL (they leave something free: no unique answer), APC_ESOLVER (no
 * regulator without limits has this model and these weights, so there is no terminal weight); there is
 * nothing to solve then until others are taken. [tick], of order n^2 N ny with n = nu * blocks. */
int apc_mpc_tune(struct apc_mpc *mpc, const struct apc_mpc_weights *weights, struct apc_error *why);
/* plan [blocks * nu] = the moves, block after block. Without an answer it is as it was. [tick] */
void apc_mpc_solve(struct apc_mpc *mpc, const struct apc_mpc_call *call, double *plan,
                   struct apc_mpc_result *result);
/*
 * Of a nonlinear model, before each solution: first where it is to come to rest, sought near x [nx_plant +
 * nx_held], u [nu], which become where sample 1 is aimed at. Where no steady state is found, y is to be at
 * its setpoint and u at its reference, and x and u stay. Where that takes more steps than a solve may change its
 * working set, or time is up: samples after the first are aimed at their setpoints; while not even the first
 * has its steady state, result's rc is APC_ETIMEDOUT, and x and u are where to go on. [tick]
 */
void apc_mpc_targets(struct apc_mpc *mpc, const struct apc_mpc_call *call, double *x, double *u,
                     struct apc_mpc_result *result);
/*
 * Then, for each solution: y = free_y + G (u - u0), free_y [N * ny], G [N * ny * n] with n = nu * blocks, of
 * samples 1..N and the plan's moves; u0 is the model's; so the state at N, free_x [nc], Gx [nc * n] with nc
 * = nx_plant + nx_held. Where there is no steady state, or no regulator there, it goes without a terminal
 * weight. Where prices bend, @p curve [n * n], its lower half, is how about moves @p plan; NULL: not at all.
 * Where the problem is not convex with it, going from there costs as much more as makes it so. Returns as
 * apc_mpc_tune(). [tick], of order n^2 N ny.
 */
int apc_mpc_follow(struct apc_mpc *mpc, const double *G, const double *free_y, const double *Gx,
                   const double *free_x, const double *curve, const double *plan);
/* What the plan does: y [N * ny], of samples 1..N; of the last call. Returns the sum above, of that and the
 * plan: without prices never below 0. [tick] */
double apc_mpc_predict(struct apc_mpc *mpc, const double *plan, double *y);
/* Steady state aimed at by sample i (1..N) of the last call: y [ny], u [nu]. [tick] */
void apc_mpc_target(const struct apc_mpc *mpc, size_t i, double *y, double *u);
/* The u [nu] that acts in sample i, from 0. [tick] */
const double *apc_mpc_move(const struct apc_mpc *mpc, const double *plan, size_t i);
/* The working set that a solution ended with, or came to in time: to be kept, also over a restart, and to
 * begin the next one with: apc_mpc_rows() numbers. [tick] */
size_t apc_mpc_rows(const struct apc_mpc *mpc);
const signed char *apc_mpc_active(const struct apc_mpc *mpc);
/* [apc_mpc_rows()] the mpc's own: what apc_mpc_start() begins the next solution with. [tick] */
signed char *apc_mpc_room(struct apc_mpc *mpc);
void apc_mpc_start(struct apc_mpc *mpc);
/* What holds a plan back, as bits: a limit, or that it falls or rises as fast as it may. */
enum { APC_MPC_LOW = 1, APC_MPC_HIGH = 2, APC_MPC_FALLS = 4, APC_MPC_RISES = 8 };
/* Of each u [nu] and y [ny], wherever in the horizon, by a working set; rates are those of the last call.
 * [tick] */
void apc_mpc_limiting(const struct apc_mpc *mpc, const signed char *rows, unsigned *u, unsigned *y);
/* What the last solution would cost less for each unit that a limit gave way, over all of the horizon: u [4 * nu]
 * the low limits, the high ones, steps down, steps up; y [2 * ny] low, high. Of a plan that waits nothing is
 * told by it. [any] */
void apc_mpc_multipliers(const struct apc_mpc *mpc, double *u, double *y);

#endif
