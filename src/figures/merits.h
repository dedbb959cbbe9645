/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Figures of merit: not how well a loop followed an event (figures.h), but what its controller was worth over
 * days: how long it was in service, how long at its limits, how much quieter the measurement was with it than
 * without, and how well its predictions came true.
 */
#ifndef APC_MERITS_H
#define APC_MERITS_H

#include "operate/loops.h"
#include "record/samples.h"

/* Shares are of the window, 0 to 1. NAN: there is no such figure. */
struct merits_loop {
    char name[APC_TAG_LEN];
    int id;         /* of its target, in table opmode */
    double service; /* in Auto or Cas with its law's own answer: neither held, nor at its fault value, nor the
                       backup law's, nor gone */
    double low, high;     /* its output stood at that limit */
    double with, without; /* standard deviation of measurement less setpoint, in service and out of it */
    double benefit;       /* 1 - with / without: by how much the loop is quieter in service */
};

/* Of what one law publishes over a horizon about one of its measurements. */
struct merits_prediction {
    int id; /* in table prediction */
    char name[APC_TAG_LEN];
    int measurement; /* its id */
    apc_ns patience; /* how long a row of it stands for what is */
    double step;     /* s */
    size_t length;   /* steps */
    size_t n_first, n_last;
    double first,
        last; /* rms of what was measured less what had been predicted, one step and all steps ahead */
};

/* What held a law's plans back, by variable: share of its plans. */
struct merits_limit {
    int id; /* in table estimate */
    char name[APC_TAG_LEN];
    enum apc_table table; /* the variable: of sensor, actuator or setpoint */
    int variable;         /* its id */
    uint64_t plans;
    double low, high, falls, rises;
};

struct merits {
    apc_ns from, until;
    struct merits_loop *loop;
    size_t n_loops;
    struct merits_prediction *prediction;
    size_t n_predictions;
    struct merits_limit *limit;
    size_t n_limits;
};

/*
 * Of the window from <= t < until. @p process (setpoints, measurements, outputs) and @p operation (actual
 * modes at least) are by time; rows from before the window count as far as they still hold in it. @p tag
 * describes all variables. @p published: the store with what the laws published, whose times are @p offset
 * later; NULL: none. Returns 0, APC_ENOMEM or the store's error; merits_free() in either case.
 */
struct merits_source {
    const struct apc_tag *tag;
    size_t n_tags;
    const struct loops *loops;
    const struct samples *process, *operation;
    struct apc_store *published;
    apc_ns offset, from, until;
};
int merits_make(struct merits *m, const struct merits_source *source);
/* Of a store's history, t in UTC, as far as there is a record. Returns 0, APC_ENOTFOUND (no loops are
 * described, or nothing was recorded), APC_ERANGE (it takes more than @p most rows), APC_ENOMEM or the
 * store's error; merits_free() in either case. */
int merits_of_store(struct merits *m, struct apc_store *store, apc_ns from, apc_ns until, size_t most);
void merits_free(struct merits *m);

#endif
