/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The problem of predictive control, as its files share it: mpc.c makes it and tells of it, mpc_weights.c
 * makes H, mpc_target.c finds steady states, mpc_solve.c the moves.
 */
#ifndef APC_MPC_INTERNAL_H
#define APC_MPC_INTERNAL_H

#include "predict/mpc.h"
#include "predict/predict_internal.h"
#include "predict/qp_internal.h"
#include "predict/target.h"

struct apc_mpc {
    const struct apc_linear *model;
    size_t N, blocks, nu, ny, nd, nc, n, m; /* n moves, m rows */
    size_t n_rates;                         /* rows of rates, before those of limits and of zones */
    size_t *first;                          /* [blocks] sample that a block begins with */
    size_t *block_at;                       /* [N] block that a sample is in */
    size_t *columns; /* [N] of G's rows of a sample: the moves from there on come after it. Eights, or n */
    struct apc_mpc_change {
        size_t move, j;
    } * rate_of;                        /* [n_rates] the move that a row ends with, its input */
    size_t *row_of_limit, *row_of_zone; /* [ny] first of N rows; SIZE_MAX: none */
    unsigned *rank;                     /* [ny] */
    unsigned ranks;
    bool terminal;
    bool ends;                  /* with a terminal weight, this time */
    bool easy_stale;            /* easy_qp is of another G */
    bool easy_waits;            /* easy_qp does not know the rows of room yet */
    bool aims;                  /* at steady states */
    bool few;                   /* changes of the working set are counted, as time is */
    unsigned steps, steps_left; /* of a search for steady states, in a call */
    bool reachable;             /* as in the result */
    bool (*enough)(void *ctx);
    apc_target_linearise *linearise; /* what y does is said from outside */
    void *ctx;
    struct apc_linear *rest; /* of steady states and what comes after N: the model, or what is linear there */

    double *memory;
    double *G;      /* [N * ny * n] */
    double *Gx;     /* [n * nc] of the state at N, move after move */
    double *F, *Fx; /* [nx * (N * ny)], [nx * nx]: y of the samples, x at N from each state, one after another
                     */
    double *A, *H, *H_easy; /* [m * n], [n * n] */
    double *q, *s, *r, *zone, *least, *price;
    double *worth;       /* [N * ny] price w of the samples of the last call */
    const double *curve; /* as of apc_mpc_follow(), while it runs */
    double damping;      /* of moves from there, over how prices bend, so that the problem is convex */
    double *bent;        /* [n] what both have in the gradient */
    double *P, *PG;      /* [(nc + nu)^2], [(nc + nu) * n] of the terminal weight */
    double *riccati;
    double *square, *easy, *none;        /* [n + m] weights of soft rows; none: zeros */
    double *low, *high;                  /* [n + m] */
    double *f, *v, *broken;              /* [n]; moves that break least of limits that were looked at */
    double *free_y, *target_y, *pulling; /* [N * ny] */
    double *target_u, *target_x, *near;  /* [N * nu], [nc], [nc] of sample 1 */
    double *u_last;                      /* [nu] of the last call */
    double *x, *next, *input;            /* [nx], [nx], [nu + nd] */
    double *aim_low, *aim_high;          /* [ny] */
    double *difference, *far;            /* [nc + nu] */
    signed char *room;                   /* [n + m] */
    unsigned *paced;                     /* [nu] the first move's bounds that are its rate's */
    struct apc_qp *qp, *easy_qp;
    struct apc_target *target;
};

/* The weight of y in the cost itself; a zone's is that of its rows. */
static inline double tracked(const struct apc_mpc *p, size_t c)
{
    return p->zone[c] > 0.0 ? 0.0 : p->q[c];
}

/* Samples whose y is in the sum: the last one is in the terminal weight, if there is one. */
static inline size_t summed(const struct apc_mpc *p)
{
    return p->ends ? p->N - 1 : p->N;
}

/* The weight of a move's distance from its target; the last one's is in the terminal weight as well. */
static inline double reference_weight(const struct apc_mpc *p, size_t block, size_t j)
{
    return p->ends && block + 1 == p->blocks ? 0.0 : p->r[j];
}

/* memcpy() of a few, without a call. */
static inline void mpc_copy(size_t n, const double *from, double *to)
{
    for (size_t k = 0; k < n; k++)
        to[k] = from[k];
}

/** Rates, limits and zones, as rows of A, from G. */
void mpc_make_rows(struct apc_mpc *p);
/** What a move costs while limits are given up. Returns as apc_qp_set(). */
int mpc_make_easy(struct apc_mpc *p, struct apc_error *why);

/** Is each output somebody else's? */
bool mpc_is_bound(const struct apc_mpc *p, const struct apc_mpc_call *call);
/** As where nothing else is known, or can be changed. */
void mpc_set_references(struct apc_mpc *p, const struct apc_mpc_call *call);
/** The steady states of all samples. Returns 0, or as apc_target_find() or apc_target_search(). */
int mpc_find_targets(struct apc_mpc *p, const struct apc_mpc_call *call, unsigned *solves);

#endif
