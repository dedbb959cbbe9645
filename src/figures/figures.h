/* SPDX-License-Identifier: BSD-3-Clause */
/* How well a loop was controlled: figures of each event of a run, and of all of it. */
#ifndef APC_FIGURES_H
#define APC_FIGURES_H

#include "operate/operate.h"
#include "record/record.h"

/* NAN: there is no such figure. HUGE_VAL: it never came to an end, or the plant diverged. */
enum metric {
    METRIC_IAE,          /* integral of |r - z| */
    METRIC_ISE,          /* of (r - z)^2 */
    METRIC_ITAE,         /* of t |r - z|, t since the event */
    METRIC_OVERSHOOT,    /* of a step: beyond the new setpoint, in % of the step */
    METRIC_SETTLING,     /* of a step: s until z stays within 5 % of it */
    METRIC_PEAK,         /* of what is no step of this loop: the largest |r - z| */
    METRIC_RECOVERY,     /* of the same: s until z stays near r again */
    METRIC_EFFORT,       /* total variation: sum of all changes of what the plant was given */
    METRIC_UNCONTROLLED, /* % of the time without control */
    METRICS
};

const char *metric_name(enum metric metric); /* for people: "settling s" */
const char *metric_key(enum metric metric);  /* for programs: "settling_s" */
/* What the key was before; NULL: the same. Deprecated: JSON gives both for one more version. */
const char *metric_former_key(enum metric metric);

/* One of the loops: its measurement, setpoint and output by their places. */
struct loop {
    char name[APC_TAG_LEN]; /* of the measurement; where there are several controllers, the loop's own */
    size_t y, z;
    struct wire u; /* for the plant, or the setpoint of a loop below */
};

/* What begins at an instant: the run, a new setpoint, a ramp to one, or a new value of a disturbance. */
struct event {
    enum { EVENT_START = 1, EVENT_SETPOINT, EVENT_DISTURBANCE } kind;
    size_t which;
    double t, from, to; /* from and to of the start: nothing */
    double over;        /* s: the setpoint went there on a ramp; 0: at once */
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
int figures_make(struct figures *f, const struct trajectory *c, const struct experiment *e);
void figures_free(struct figures *f);

/* Share of the time, added up over the measurements, that they lay beyond their limits. */
double figures_beyond(const struct experiment *e, const struct trajectory *c);

/* Of the setpoint or disturbance whose event it is: the name. */
const char *figures_variable(const struct event *event, const struct experiment *e);
/* "r 10 -> 20", "load 0 -> -0.15", "start"; several with "; " between them. */
void figures_name_part(const struct figures *f, const struct part *part, const struct experiment *e,
                       char *text, size_t size);

/* ---- Health --------------------------------------------------------------------------------- */

/* What a loop did, tick by tick, while its controller had it and its setpoint stood. */
struct health_series {
    const double *y, *r, *u; /* [n] measurement, setpoint, output */
    size_t n;
    double period;          /* s */
    const double *measured; /* [n_measured] each row of the measurement once */
    size_t n_measured;
    double limited; /* share of the time at a limit */
    double horizon; /* s that the least variance looks ahead: dead time and a period for the Harris index */
};

/* From the worst on. */
enum health_verdict {
    HEALTH_SENSOR = 1, /* the measurement stands still, jumps, or has steps */
    HEALTH_VALVE,      /* friction explains the record */
    HEALTH_TIGHT,      /* it swings by itself, near the limit of stability */
    HEALTH_PERIODIC,   /* something outside swings */
    HEALTH_SWINGS,     /* one of the two, and the record is too short to say which */
    HEALTH_LIMITED,    /* its output is at a limit too often to be judged */
    HEALTH_SLOW,       /* deviations last far beyond the horizon */
    HEALTH_UNKNOWN,    /* too little is on record, or nothing moves */
    HEALTH_GOOD
};

/* NAN: there is no such figure. */
struct health {
    enum health_verdict verdict;
    size_t n;          /* ticks that were judged */
    double least;      /* s that HEALTH_TICKS of them take */
    double index;      /* least variance that any controller could have, over that on record: 1 is the best */
    double swing;      /* s, of a regular oscillation of the deviation */
    double regularity; /* above 1: it is one (Thornhill, Huang and Zhang, 2003) */
    double lasting;    /* its correlation many swings later over that after one */
    double friction;   /* deadband and stickband, units of the output */
    double explained;  /* by it: share of what a linear plant leaves */
    double still;      /* s that the measurement stood still, longest */
    double jumps;      /* single rows far off, share */
    double step;       /* of the measurement, its resolution */
    double travel, reversals; /* of the output: per hour */
};

/* Ticks that it takes to judge. */
#define HEALTH_TICKS 500

/* Returns 0 or APC_ENOMEM. */
int health_judge(struct health *h, const struct health_series *s);
const char *health_name(enum health_verdict verdict);  /* "tight": for programs, and tables */
const char *health_words(enum health_verdict verdict); /* what it means, and what to do */

/* ---- KPIs ----------------------------------------------------------------------------------- */

/*
 * KPIs: not how well a loop followed an event (figures.h), but what its controller was worth over
 * days: how long it was in service, how long at its limits, how much quieter the measurement was with it than
 * without, and how well its predictions came true.
 */

/* Measurements, and periods of the controller, in service and out of it, from which on the two are compared. */
#define KPIS_LEAST 50

/* Shares are of the window, 0 to 1. NAN: there is no such figure. */
struct kpis_loop {
    char name[APC_TAG_LEN], measurement[APC_TAG_LEN]; /* "": what is calculated */
    int id;                                           /* of its target, in table opmode */
    apc_ns from, until;                               /* what was on record; the same: nothing */
    double service; /* in Auto or Cas with its law's own answer: neither held, nor at its fault value, nor the
                       backup law's, nor gone */
    double low, high;             /* its output stood at that limit */
    double mode[APC_MODE_LO + 1]; /* by actual mode, while its controller ticked, or had it out of service */
    double stopped;               /* it did not */
    double iae;           /* integral of |setpoint - measurement|, while both were known; NAN: never */
    double with, without; /* standard deviation of measurement less setpoint, in service and out of it */
    double benefit;       /* 1 - with / without: by how much the loop is quieter in service */
    struct health health; /* verdict 0: nobody asked */
};

/* Of what one law publishes over a horizon about one of its measurements. */
struct kpis_prediction {
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
struct kpis_limit {
    int id; /* in table estimate */
    char name[APC_TAG_LEN];
    enum apc_table table; /* the variable: of sensor, actuator or setpoint */
    int variable;         /* its id */
    uint64_t plans;
    double low, high, falls, rises;
};

struct kpis {
    apc_ns from, until;
    struct kpis_loop *loop;
    size_t n_loops;
    struct kpis_prediction *prediction;
    size_t n_predictions;
    struct kpis_limit *limit;
    size_t n_limits;
};

/*
 * Of the window from <= t < until. @p process (setpoints, measurements, outputs) and @p operation (actual
 * modes at least) are by time; rows from before the window count as far as they still hold in it. @p tag
 * describes all variables. @p published: the store with what the laws published, whose times are @p offset
 * later; NULL: none. Returns 0, APC_ENOMEM or the store's error; kpis_free() in either case.
 */
struct kpis_source {
    const struct apc_tag *tag;
    size_t n_tags;
    const struct loops *loops;
    const struct samples *process, *operation;
    struct apc_store *published;
    apc_ns offset, from, until;
    const double *horizon; /* of health_series; NULL: health is not asked for */
};
int kpis_make(struct kpis *m, const struct kpis_source *source);
/* Of a store's history, t in UTC, as far as there is a record. Returns 0, APC_ENOTFOUND (no loops are
 * described, or nothing was recorded), APC_ERANGE (it takes more than @p most rows), APC_ENOMEM or the
 * store's error; kpis_free() in either case. */
int kpis_of_store(struct kpis *m, struct apc_store *store, apc_ns from, apc_ns until, size_t most);

struct health_asked {
    double horizon; /* of health_series */
    size_t newest;  /* rows of each variable that are looked at, at most; 0: all */
    apc_ns give_up; /* monotonic: then no further loop is begun */
};
/* The health of a store's loops from m->from until m->until, one after another: m->n_loops of them have been
 * judged before, at first none, of the same catalogue. Returns how many are left, APC_ENOTFOUND (no loops are
 * described), APC_ENOMEM or the store's error; kpis_free() in either case. */
int health_of_store(struct kpis *m, struct apc_store *store, const struct health_asked *asked);
bool kpis_on_record(const struct kpis *m); /* is any of its loops? */
/* The worst first. */
void kpis_sort_by_health(struct kpis *m);
void kpis_free(struct kpis *m);

/* ---- Outages -------------------------------------------------------------------------------- */

/* When there was no value that can be used: of variables that went and came together one. */
struct outage {
    apc_ns from, until;
    enum apc_table table; /* APC_SENSOR, or APC_ACTUATOR: its controller wrote none */
    apc_status status;    /* of the rows, the first of them; APC_GOOD: there were none */
    size_t tag, n;        /* place of the first variable, and of how many it was */
};

struct outages {
    struct apc_tag *tag;
    size_t n_tags;
    struct outage *at; /* [n] by time */
    size_t n, room;
    apc_ns down; /* for how long there was at least one */
};

/* Of the measurements and outputs of a store, from <= t < until. What was never on record was not missed. Returns 0,
 * APC_ENOMEM or the store's error; outages_free() in either case. */
int outages_of_store(struct outages *outages, struct apc_store *store, apc_ns from, apc_ns until);
void outages_free(struct outages *outages);

#endif
