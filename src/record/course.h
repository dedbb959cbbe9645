/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The course of a run, of which its figures are made: what the plant put out, what was wanted, what the plant
 * was given, and when nobody controlled it. Times are in s since the start of the run.
 */
#ifndef APC_COURSE_H
#define APC_COURSE_H

#include "samples.h"

struct curve {
    struct curve_point {
        double t, value;
    } * at;
    size_t n, room;
};

struct course {
    struct apc_dim dim;
    struct curve *output;   /* [ny] at each tick of the plant; between them they are straight lines */
    struct curve *setpoint; /* [nz] its changes */
    struct curve *input;    /* [nu] its changes, as the plant was given them */
    struct curve without;   /* changes between 0 and 1: the plant is not under the law's control */
    double end;             /* s */
    double gap;    /* s: farther apart two points of an output have a hole between them; HUGE_VAL: never */
    bool measured; /* output is what was measured of it: that is all there is of a run in real time */
    bool diverged; /* the plant, at the end */
    bool failed;   /* out of memory: it is not whole */
};

int course_create(struct course *c, const struct apc_dim *dim); /* 0 or APC_ENOMEM */
void course_free(struct course *c);

/* A new value, if it is one: not that of the last point. Times do not go back. */
void course_change(struct course *c, struct curve *curve, double t, double value);
/* A point, new or not. */
void course_add(struct course *c, struct curve *curve, double t, double value);

/*
 * The course as the samples of a run in real time tell it, their times counted from @p start. There was no
 * control while an output was not the law's, or while outputs or measurements stayed away for longer than the
 * plant waits for them. Returns 0 or APC_ENOMEM; course_free() in either case.
 */
int course_of_samples(struct course *c, const struct samples *samples, const struct experiment *e,
                      apc_ns start);

/* The file plant.csv of a run folder: what simulation knows of the plant and nobody measured. Reading returns
 * APC_ENOTFOUND when there is none; course_free() in either case. */
int course_write(const struct course *c, const char *dir, struct apc_error *why);
int course_read(struct course *c, const char *dir, const struct apc_dim *dim, struct apc_error *why);

/* Of the run in folder @p dir: the plant's own if it has them, or else that of its samples. */
int course_load(struct course *c, const char *dir, const struct experiment *e, struct apc_error *why);

#endif
