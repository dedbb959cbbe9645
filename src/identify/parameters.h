/* SPDX-License-Identifier: BSD-3-Clause */
/* The search for parameters of a model of differential equations: what is known as it goes on. */
#ifndef APC_IDENTIFY_PARAMETERS_H
#define APC_IDENTIFY_PARAMETERS_H

#include "identify/identify_internal.h"
#include "plant/plant_internal.h"

#define NOISE_MOST 8

struct unknown {
    enum kind { STATE, BEFORE, PROCESS, MEASURED, PARAMETER, DEAD_TIME } kind;
    size_t run, at; /* a state or an input of which run; which one */
    double low, high, size;
};

struct fit {
    struct apc_record r;
    struct apc_parameters s;
    struct apc_plant_options plant;
    const struct apc_model *model;
    size_t runs, inputs;
    size_t samples, rows;                 /* n * ny, by likelihood twice; rows: behind them one a prior */
    size_t m, first;                      /* unknowns, of which the first are states, levels and noises */
    size_t levels;                        /* of each input before each run; 0: it was as at first */
    struct unknown *unknown;              /* [m] */
    double *p, *x0, dead_time;            /* [np], [runs * nx], s */
    double *before;                       /* [runs * LEVELS * inputs] a sample before a run, two, ... */
    double *value, *trial, *step, *along; /* [m], [m], [2 * m], [m] */
    double *y, *plus, *minus, *e, *room;  /* [rows] */
    double *Q, *R, *small, *small_R;      /* [rows * m], [m * m]; of a step */
    double *deviation, *noise;            /* [ny], [ny * NOISE_MOST]: what the errors are like */
    double scatter;                       /* of errors so weighed: 1 until it is known what is left */
    double *u, *out;                      /* [nu + nd], [model's ny] */
    bool filtered;                        /* by likelihood: y has what was expected, and its variances */
    const size_t *noisy;                  /* [n_noisy] states with process noise */
    size_t n_noisy;
    double *process, *measured; /* [nx], [ny] deviations: of a random walk in 1 s, of a sample */
    double *scale;              /* [nx] process noise that is seen as well as that of samples */
    unsigned steps;             /* of integration, a period */
    int *order;                 /* [ny] */
    void *memory;
};

/* Do inputs act that were before a run? */
bool fit_acts_late(const struct fit *f);
/* y [n * ny] as the numbers in p, x0, before and dead_time say. APC_ESOLVER: they have no answer. */
int fit_run(struct fit *f, double *y, struct apc_error *why);
/* e = what is measured without y, weighed, and how far parameters are from what was known of them. Returns the
 * sum of squares; by likelihood minus the logarithm. */
double fit_misfit(const struct fit *f, const double *y, double *e);
/* The part that priors have in it, in units of squares; e [s.n]. */
double fit_prior_misfit(const struct fit *f, double *e);
/* How many errors count. */
size_t fit_counted(const struct fit *f);
/* Q R = how y moves with each unknown. */
int fit_differentiate(struct fit *f, struct apc_error *why);
/* A sought-for number that does nothing, or nothing that others do not do as well: those are named. */
int fit_check_apart(const struct fit *f, struct apc_error *why);
/* f->u = what acts from sample @p k of run @p g on. */
void fit_take_inputs(struct fit *f, size_t g, const struct apc_record *run, double k);
void fit_put(struct fit *f, size_t q, double value);
/* The unknowns, where they are now: states, levels, and what is sought. */
void fit_set_unknowns(struct fit *f);

/* likelihood.c: the same of y and its variances [2 * n * ny], as an extended Kalman filter expects them. */
int fit_filter(struct fit *f, double *y, struct apc_error *why);
double fit_surprise(const struct fit *f, const double *y, double *e);
void fit_weigh_filtered(const struct fit *f, double *column);
/* Which states are noisy: of->noisy, or all of them, [*all] to be freed. */
int fit_check_noisy(const struct apc_model *model, struct apc_likelihood *of, size_t **all,
                    struct apc_error *why);
/* From where f is: the noises are unknown too from now on. */
int fit_begin_filter(struct fit *f, struct apc_error *why);
/* Of what was found; @p left: of the search. */
int fit_report_likelihood(struct fit *f, double left, struct apc_likelihood *of, struct apc_error *why);
/* Intervals of the profile likelihood, from there; @p error: standard errors. f is then where it was. */
int fit_profile(struct fit *f, double left, const double *error, struct apc_interval *interval,
                struct apc_error *why);
double fit_standard_error(struct fit *f, double variance, size_t q, double *g);

/* parameters_search.c: downhill from where it is; and the first time, which looks around, and before. */
int fit_search(struct fit *f, double *left, struct apc_error *why);
int fit_find(struct fit *f, double *left, struct apc_error *why);

#endif
