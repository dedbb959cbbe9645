/* SPDX-License-Identifier: BSD-3-Clause */
/* What controllers would have done in a recorded run. */
#ifndef APC_REPLAY_H
#define APC_REPLAY_H

#include "operate/loops.h"
#include "record/ticks.h"

/* How the outputs of one loop differ. */
struct replay_difference {
    uint64_t ticks, same;
    double sum, worst, at, low, high; /* of the recorded ones: low, high */
};

#define REPLAY_TEXT 300

/* One controller of the run. */
struct replay_controller {
    const struct controller *of;
    struct apc_controller *core;
    struct ticks ticks; /* recorded */
    uint64_t same;      /* ticks at which all of the row came out again */
    uint64_t restarts;  /* found by what came out: it went on from its stored row */
    apc_ns begins; /* of the first tick, where what it went on from is not on record any more; 0: all are */
    char first[REPLAY_TEXT]; /* which tick is the first that differs, and why; "": none does */
    struct apc_now now;      /* of the tick before */
    const double *row;       /* of the tick before, recorded; NULL: there is none */
};

/* Called as the replay goes on; t in s since the start of the run. Either may be NULL. */
struct replay_watch {
    void (*output)(void *ctx, double t, const char *loop, double recorded, double replayed);
    void (*notice)(void *ctx, double t, const char *text); /* of the replayed controllers, but for modes */
    void *ctx;
};

struct replay {
    struct experiment e;
    struct replay_controller *controller; /* [e.n_controllers] */
    struct replay_difference *difference; /* [loops.n] */
    struct loops loops;

    /* its own */
    struct samples samples; /* what the tick rows name, by table, id, seq */
    struct ticks *plan;     /* [e.dim.nz] and of plans */
    struct apc_sample lost; /* the last plan that is not on record */
    apc_ns start;           /* t = 0 in the record */
    bool other_law;
    struct replay_watch watch;
    struct apc_error why;
};

/* The record of the run in folder @p dir, and its controllers or, where there is one, with the law that
 * overrides name. Returns 0 or a negative error; replay_free() in either case. */
int replay_load(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                struct apc_error *why);
/* Once. Returns 0 or why it ended, with a text in r->why. */
int replay_run(struct replay *r, const struct replay_watch *watch);
/*
 * Instead: simulate the run anew and compare the tick rows, all but times and the numbers of rows: the first
 * that differs is in `first` of its controller. Returns 0 or a negative error with a text in r->why.
 */
int replay_virtual(struct replay *r);
void replay_free(struct replay *r);

#endif
