/* SPDX-License-Identifier: BSD-3-Clause */
/* How well a loop was controlled: figures of each event of a run, and of all of it. */
#ifndef APC_FIGURES_H
#define APC_FIGURES_H

#include "record/course.h"

/* NAN: there is no such figure. HUGE_VAL: it never came to an end, or the plant diverged. */
enum metric {
    METRIC_IAE,       /* integral of |r - z| */
    METRIC_ISE,       /* of (r - z)^2 */
    METRIC_ITAE,      /* of t |r - z|, t since the event */
    METRIC_OVERSHOOT, /* of a step: beyond the new setpoint, in % of the step */
    METRIC_SETTLING,  /* of a step: s until z stays within 5 % of it */
    METRIC_PEAK,      /* of what is no step of this loop: the largest |r - z| */
    METRIC_RETURN,    /* of the same: s until z stays near r again */
    METRIC_EFFORT,    /* sum of all changes of what the plant was given */
    METRIC_WITHOUT,   /* % of the time without control */
    METRICS
};

const char *metric_name(enum metric metric); /* for people: "settling s" */
const char *metric_key(enum metric metric);  /* for programs: "settling_s" */

/* One of the loops: its measurement, setpoint and output by their places. */
struct loop {
    char name[APC_TAG_LEN]; /* of the measurement; where there are several controllers, the loop's own */
    size_t y, z;
    struct wire u; /* for the plant, or the setpoint of a loop below */
};

/* What begins at an instant: the run, a new setpoint, or a new value of a disturbance. */
struct event {
    enum { EVENT_START = 1, EVENT_SETPOINT, EVENT_DISTURBANCE } kind;
    size_t which;
    double t, from, to; /* from and to of the start: nothing */
};

/* The part of a run from one event to the next, as one loop saw it; several events may coincide. */
struct part {
    double from, to;
    size_t first, n; /* of the events that begin it */
    bool step;       /* the loop's own setpoint moved */
    double figure[METRICS];
};

/* The figures of one loop. */
struct metrics {
    struct part *part;      /* [n_parts], one after another */
    double figure[METRICS]; /* of the whole run: sums and shares over its parts, or the worst of them */
};

/* The figures of a run. */
struct figures {
    struct loop *loop;
    struct metrics *of; /* [n_loops] */
    size_t n_loops;
    struct event *event; /* by time */
    size_t n_events, n_parts;
};

/* As the laws pair measurements, setpoints and outputs; room for controllers_loops() of them. Returns how
 * many, or APC_ENOMEM. */
int metrics_loops(const struct experiment *e, struct loop *loop);

/* Returns 0 or APC_ENOMEM; figures_free() in either case. */
int figures_make(struct figures *f, const struct course *c, const struct experiment *e);
void figures_free(struct figures *f);

/* Of the setpoint or disturbance whose event it is: the name. */
const char *figures_variable(const struct event *event, const struct experiment *e);
/* "r 10 -> 20", "load 0 -> -0.15", "start"; several with "; " between them. */
void figures_name_part(const struct figures *f, const struct part *part, const struct experiment *e,
                       char *text, size_t size);

#endif
