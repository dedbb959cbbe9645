/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The search for the transfer functions to one output. What is linear in the error (gains, leads, where y
 * begins) is found by least squares inside of what is not (time constants, dead times): variable projection
 * (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973) in Kaufman's form, damped as Marquardt did.
 */
#ifndef APC_IDENTIFY_SEARCH_H
#define APC_IDENTIFY_SEARCH_H

#include "identify/identify_internal.h"

#define NOISE_MOST 8

/* What leads from an input to the output. */
struct arm {
    struct apc_lag lag;
    bool zero;
    bool none; /* nothing, as far as the record shows: it has no columns and no unknowns */
    /* Of the input before each run, 0: it was as at first: steps of each run's own, one `since` samples before
     * its first, one a sample before that, ... */
    size_t levels, since;
};

struct shape {
    struct arm *arm; /* [inputs] */
    bool integrating, rest;
    double left; /* sum of squared errors */
    double score;
};

struct search {
    const struct apc_record *record;
    size_t n, inputs, output, runs, width;
    size_t levels_most;
    size_t arm_columns; /* of an arm at most: response, its rate, what is left of each run's beginning in each
                           lag, and the same two of each step to a level */
    double dead_time_max;
    unsigned order; /* 0: to be found */
    double noise[NOISE_MOST];
    size_t n_noise;
    bool *counts; /* [n] samples whose error counts */
    size_t rows;
    double *y, *e;           /* [n] whitened, 0 where it does not count; what is left of it */
    double *Q, *R, *along;   /* [n * width], [width * width], [width] */
    double *value;           /* [width] of the linear ones */
    double *plus, *minus;    /* [n * arm_columns] */
    double *small, *small_R; /* of a step */
    double *step;            /* [2 * (n + LEVELS)] what the input's step does, and its rate */
    void *memory;
    struct shape best, trial, grown;
};

int search_open(struct search *s); /* 0 or APC_ENOMEM; search_close() in either case */
void search_close(struct search *s);

/* Columns of the least squares: what y has without inputs, then those of each arm. */
size_t search_base(const struct search *s, const struct shape *shape);
size_t search_arm(const struct search *s, const struct arm *arm, bool rest);
size_t search_linear(const struct search *s, const struct shape *shape); /* all of them */
size_t search_unknowns(const struct search *s, const struct shape *shape);
/* After search_evaluate(): how much of each run's first inputs, times their gains, came with its levels. */
double search_moved(const struct search *s, const struct shape *shape, size_t run);
void search_fill_base(const struct search *s, const struct shape *shape);
int search_fill_arm(const struct search *s, const struct arm *arm, size_t j, bool rest, double *column);
/* w [n], and its rate unless NULL: what a lag makes of input @p j, each run by itself. Returns 0 or
 * APC_ENOMEM. */
int search_respond(const struct search *s, const struct apc_lag *lag, size_t j, double *w, double *rate);
/* What is left of a run's beginning in a lag: 0 in the other runs. */
void search_fill_rest(const struct search *s, double tau, size_t run, double *column);
/* Whiten a column as the errors are, 0 where they do not count. */
void search_finish(const struct search *s, double *column);

/* What errors are expected to be like, and so which samples count, and y. */
void search_set_noise(struct search *s, const double *a, size_t order);
/* The least squares of what is linear: value, e, left, score. */
int search_evaluate(struct search *s, struct shape *shape);
/* After that: how the errors move with each unknown, behind the linear columns. */
int search_differentiate(struct search *s, const struct shape *shape);
/* Take from e what columns from..to-1 explain: along. */
void search_project(struct search *s, size_t from, size_t to);
/* The score that a step to all sides from where the shape is would lead to, were all linear. */
int search_look_ahead(struct search *s, struct shape *shape, double *score);
/* Gauss and Newton's iteration from where the shape is. */
int search_refine(struct search *s, struct shape *shape);
void search_copy(const struct search *s, struct shape *to, const struct shape *from);
/* Unknown @q of an arm moves by @step: the log of a time constant, then the dead time in periods. */
void search_move(const struct search *s, struct arm *arm, size_t q, double step);
/* Between what a time constant is sought. */
double search_shortest(const struct search *s);
double search_longest(const struct search *s);

/* shape.c: best = the structure and the numbers that predict best. */
int search_shape(struct search *s, enum apc_identify_integrating integrating);

#endif
