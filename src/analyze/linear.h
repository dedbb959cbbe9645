/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The closed loop of an experiment around an operating point: its plant and its laws made linear, and the
 * instants at which it samples, computes and acts, as virtual time has them.
 */
#ifndef APC_LINEAR_LOOP_H
#define APC_LINEAR_LOOP_H

#include <apcanalysis.h>
#include <apctune.h>

#include "experiment/experiment.h"

/* A manipulated input or a disturbance at the operating point, by name. */
struct linear_at {
    const char *name;
    double value;
};

struct linear_how {
    const struct linear_at *at; /* [n_at] */
    size_t n_at;
    double faster; /* controllers tick so many times as often; 0: as they do */
    bool prompt;   /* nothing takes any time: sampled, computed and acting at one instant */
};

struct linear_loop {
    struct apc_loop *loop;
    const struct apc_model *model; /* the plant's, by its states */
    double *x, *u, *y;             /* the operating point: [nx], [nu + nd], [ny] */
    double *scale;                 /* [outputs] the width of each output's range, or 1 */
    size_t *output;                /* [outputs] number of the loop, as controllers_loop() has it */
    struct apc_loop_setup setup;
    struct apc_loop_controller *controller;
    struct apc_law_linear **law;
    struct apc_loop_source *source;
    struct apc_loop_tick *tick;
    size_t *to, *chosen;     /* [setup.n_controllers] by their place in the experiment */
    void *memory, *matrices; /* of the arrays; of what the setup points to */
};

/* Returns 0 or a negative error with what to do in why; linear_loop_free() in either case. */
int linear_loop_create(struct linear_loop *l, const struct experiment *e, const struct linear_how *how,
                       struct apc_error *why);
void linear_loop_free(struct linear_loop *l);

/* When its outputs change the plant's input that was written at @written, or the newest measurement is of
 * that is there at @at: ns since a tick of the plant. */
apc_ns linear_acts(const struct experiment *e, apc_ns written);
apc_ns linear_sampled(const struct experiment *e, apc_ns at);

/* ---- Linear cost ---------------------------------------------------------------------------- */

/*
 * How far the experiment's own noise moves its measurements, around an operating point, and what each part of
 * its timing adds to that.
 */

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

/* ---- Margins of a tuning -------------------------------------------------------------------- */

/* Of the loop of @p g and a PID controller that ticks each @p Ts s, measures and acts at that instant; by half a
 * period, as apc_tune_margins(), where a dead time of many periods leaves nothing of the difference. Returns 0 or a
 * negative error. */
int linear_margins_of_pid(const struct apc_transfer *g, const struct apc_pid_tuning *t, double Ts,
                          struct apc_margins *margins, struct apc_error *why);

#define LINEAR_WORST_OF 50
struct linear_worst {
    struct apc_transfer
        g;           /* with which the tuning does worst: it is unstable, or its sensitivity is the largest */
    size_t unstable; /* with so many of them */
};
/* Of LINEAR_WORST_OF models that are drawn with standard errors @p error around @p g, each number by itself; NAN: the
 * record does not tell it. Returns 0 or a negative error. */
int linear_worst(struct linear_worst *w, const struct apc_transfer *g, const struct apc_transfer *error,
                 const struct apc_pid_tuning *t, double Ts, struct apc_error *why);

/* The share of draws that are @x at most. */
double distribution_below(const struct apc_distribution *d, double x);

#endif
