/* SPDX-License-Identifier: BSD-3-Clause */
/* The search for parameters of a model of differential equations: what is known as it goes on. */
#ifndef APC_IDENTIFY_PARAMETERS_H
#define APC_IDENTIFY_PARAMETERS_H

#include "identify/identify_internal.h"
#include "plant/plant_internal.h"

#define NOISE_MOST 8

struct unknown {
    enum kind { STATE, BEFORE, PARAMETER, DEAD_TIME } kind;
    size_t run, at; /* a state or an input of which run; which one */
    double low, high, size;
};

struct fit {
    struct apc_record r;
    struct apc_parameters s;
    struct apc_plant_options plant;
    const struct apc_model *model;
    size_t runs, inputs, rows;            /* rows: n * ny */
    size_t m, first;                      /* unknowns, of which the first are states and levels */
    size_t levels;                        /* of each input before each run; 0: it was as at first */
    struct unknown *unknown;              /* [m] */
    double *p, *x0, dead_time;            /* [np], [runs * nx], s */
    double *before;                       /* [runs * LEVELS * inputs] a sample before a run, two, ... */
    double *value, *trial, *step, *along; /* [m], [m], [2 * m], [m] */
    double *y, *plus, *minus, *e, *room;  /* [rows] */
    double *Q, *R, *small, *small_R;      /* [rows * m], [m * m]; of a step */
    double *deviation, *noise;            /* [ny], [ny * NOISE_MOST]: what the errors are like */
    double *u, *out;                      /* [nu], [model's ny] */
    int *order;                           /* [ny] */
    void *memory;
};

/* Do inputs act that were before a run? */
bool fit_acts_late(const struct fit *f);
/* y [n * ny] as the numbers in p, x0, before and dead_time say. APC_ESOLVER: they have no answer. */
int fit_run(struct fit *f, double *y, struct apc_error *why);
/* e = what is measured without y, weighed. Returns its sum of squares. */
double fit_misfit(const struct fit *f, const double *y, double *e);
/* How many errors count. */
size_t fit_counted(const struct fit *f);
/* Q R = how y moves with each unknown. */
int fit_differentiate(struct fit *f, struct apc_error *why);
/* A sought-for number that does nothing, or nothing that others do not do as well: those are named. */
int fit_check_apart(const struct fit *f, struct apc_error *why);
void fit_put(struct fit *f, size_t q, double value);
/* The unknowns, where they are now: states, levels, and what is sought. */
void fit_set_unknowns(struct fit *f);

/* parameters_search.c: downhill from where it is; and the first time, which looks around, and before. */
int fit_search(struct fit *f, double *left, struct apc_error *why);
int fit_find(struct fit *f, double *left, struct apc_error *why);

#endif
