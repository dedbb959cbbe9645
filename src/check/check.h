/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Scenarios: an experiment in virtual time with faults and what people do, and what is expected of it
 * (docs/commissioning.md). Expectations are read before the run, of which nothing but trajectories is kept; judging is
 * a function of these.
 */
#ifndef APC_CHECK_H
#define APC_CHECK_H

#include "experiment/experiment.h"
#include "record/record.h"

/* ---- Trajectories --------------------------------------------------------------------------- */

/* What a trajectory is of: a variable of the record, or of the plant itself, which nobody has of a real one. */
struct check_source {
    enum apc_table table;
    int id;
    bool plant;     /* its own output, or what it was told */
    apc_ns horizon; /* a value is known for so long, or until the next one; 0: until the next one */
    char name[APC_TAG_LEN], unit[APC_TAG_LEN];
};

struct check_point {
    apc_ns t; /* since t = 0 */
    double value;
    bool known;  /* false: it is Bad */
    bool others; /* of an output: it is not its law's */
};

struct check_trajectory {
    struct check_point *at; /* by time */
    size_t n, room;
};

int check_add(struct check_trajectory *trajectory, struct check_point point); /* 0 or APC_ENOMEM */

/* ---- Expectations --------------------------------------------------------------------------- */

enum check_kind {
    CHECK_BELOW = 1, /* than number */
    CHECK_AT_MOST,
    CHECK_ABOVE,
    CHECK_AT_LEAST,
    CHECK_FAULT, /* of an output: number, and not as its law says */
    CHECK_SAFE,  /* of what the plant was told: number */
    CHECK_ALARM, /* stands and is active */
    CHECK_MODE   /* number */
};

enum check_form {
    CHECK_NEVER = 1,
    CHECK_ALWAYS,
    CHECK_WITHIN, /* at an instant from `from` until `until` */
    CHECK_AT,     /* at `until` */
    CHECK_SETTLES,
    CHECK_ACKNOWLEDGES
};

#define CHECK_TEXT 200

struct expectation {
    char text[CHECK_TEXT]; /* as it stands in the file */
    enum check_form form;
    enum check_kind kind;
    size_t trajectory;  /* what it is about */
    bool all;           /* of acknowledging: every alarm */
    size_t setpoint;    /* of settling: the trajectory of the setpoint */
    double number;      /* of the kind; of settling the band, */
    bool percent;       /* of the step */
    apc_ns time;        /* of settling, acknowledging: in which it is to be done */
    apc_ns from, until; /* what is looked at */
};

/* What expectations are about: each once. */
struct check_sources {
    struct check_source *at;
    size_t n, room;
};

/*
 * Read @p text, of which names are @p e's; what it is about is added to @p sources. Returns 0, or a negative
 * error with what is wrong in @p why: what can never be judged is refused.
 */
int check_parse(struct expectation *x, const char *text, const struct experiment *e,
                struct check_sources *sources, struct apc_error *why);

/* ---- Judging -------------------------------------------------------------------------------- */

#define CHECK_NEAR 7

enum check_is {
    CHECK_HELD = 1,
    CHECK_FAILED,
    CHECK_UNKNOWN /* nobody can say: that is no success either */
};

struct check_verdict {
    enum check_is is;
    apc_ns at;                           /* it held, failed, or from when on nothing is known, */
    apc_ns until;                        /* until then; INT64_MAX: the end */
    double value;                        /* then; NAN: none */
    double closest;                      /* to what must not, or was to be; NAN: none */
    apc_ns closest_at;                   /* then */
    char why[64];                        /* of CHECK_UNKNOWN; "": no value */
    struct check_point near[CHECK_NEAR]; /* what was around it */
    size_t n_near;
};

/*
 * What became of it; @p end: nothing is known from then on, INT64_MAX: it is to the end. A Bad or stale value is
 * not known: it neither makes a condition true nor false.
 */
struct check_verdict check_judge(const struct expectation *x, const struct check_sources *sources,
                                 const struct check_trajectory *trajectories, apc_ns end);
/* In words: "at 8.4 s", "y2 = 19.9 cm at 312.4 s". */
void check_words(const struct expectation *x, const struct check_verdict *v,
                 const struct check_sources *sources, char *text, size_t size);

/*
 * Of a share of runs in which something held, in @p held of @p n: the least that it is with 95 % confidence, by
 * Clopper and Pearson (Biometrika 26, 1934), one-sided.
 */
double check_share_least(unsigned held, unsigned n);

/* The output that answers for what failed, and its move until then. */
struct check_move {
    char loop[APC_TAG_LEN];
    apc_ns at, over; /* at: since t = 0 */
};

struct scenario;
/* Of expectation @p i, of which @p v says that it failed. Returns 1; 0: no loop answers for it; or APC_ENOMEM. */
int check_find_move(struct check_move *move, const struct scenario *scenario, size_t i,
                    const struct check_verdict *v);

/* ---- Scenarios ------------------------------------------------------------------------------ */

/* What happens once a condition becomes true. */
struct scenario_trigger {
    size_t expectation; /* that it does */
    apc_ns after;
    enum scenario_trigger_what {
        TRIGGER_ACTION = 1,
        TRIGGER_SENSOR,
        TRIGGER_ACTUATOR,
        TRIGGER_PLANT,
        TRIGGER_DISTURBANCE
    } what;
    struct action action;
    size_t fault; /* its place in e.faults, e.actuator_faults or e.plant.fault */
    struct apc_disturbance disturbance;
    char path[APC_TAG_LEN + 56]; /* of the list in the experiment that has it, or of a fault itself */
    char *text;                  /* what it is there, behind its time; NULL: a fault */
};

struct scenario {
    char file[EXPERIMENT_PATH], title[128];
    struct experiment e;    /* with what the scenario says */
    bool session;           /* it is of a run that people operated, */
    struct samples written; /* and this is what they did */
    unsigned runs;
    uint64_t seed;              /* of the first one */
    double share;               /* of them in which each expectation is to hold; 1: all, without more ado */
    struct expectation *expect; /* behind those of the file what the triggers are waiting for */
    size_t n_expect;
    struct check_sources sources;
    struct scenario_trigger *trigger;
    size_t n_triggers;
};

/* With @p set [n] over what the file says. @p session: the folder of a run that people operated, which is judged, instead
 * of the experiment that the file names, which may be one as well; NULL: none. Returns 0, or a negative error with FILE:LINE
 * and reason in @p why; scenario_free() in either case. */
int scenario_load(struct scenario *scenario, const char *file, const char *session,
                  const struct experiment_setting *set, size_t n, struct apc_error *why);
/* The same run with the file's actions instead of what people did, but for an instructor's faults, to compare with. As
 * scenario_load(). */
int scenario_load_reference(struct scenario *reference, const struct scenario *session,
                            struct apc_error *why);
void scenario_free(struct scenario *scenario);

/* What became of a run before its end. */
struct check_end {
    int rc; /* 0: it came to its end */
    double ended;
    char why[200];
};

/* One run of it, and what becomes of each expectation: @p verdict [n_expect]. Returns 0 or APC_ENOMEM, or the
 * error of a run that could not begin. */
int scenario_run(const struct scenario *scenario, uint64_t seed, struct check_verdict *verdict,
                 struct check_end *end);
/* The same run once more, all of which its store keeps until @p look returns; the text of its experiment says when
 * each condition came true, so that it makes this run by itself. Returns what @p look does, or as scenario_run() with
 * a text in @p why. */
struct simulation;
int scenario_rerun(const struct scenario *scenario, uint64_t seed,
                   int (*look)(void *ctx, const struct simulation *s), void *ctx, struct apc_error *why);

/* ---- Sessions ------------------------------------------------------------------------------- */

/* Of an alarm; NAN: there is no such figure. */
enum session_alarm {
    SESSION_RAISED,  /* how often */
    SESSION_FIRST,   /* s: when first */
    SESSION_SLOWEST, /* s: how long the slowest acknowledgement took; HUGE_VAL: there was none */
    SESSION_ACTIVE,  /* s: for how long */
    SESSION_ALARM
};

/* The figures of a run of a session's experiment, in memory that processes may share. */
struct session_run {
    bool made;
    int rc;
    char why[200];
    double ended, beyond; /* s; s that measurements lay beyond their limits, added up */
    double of[];          /* IAE of each loop of metrics_loops(), then those of alarms */
};
size_t session_run_size(const struct scenario *of); /* bytes */
void session_run_make(struct session_run *run, const struct scenario *of);
double *session_alarm(struct session_run *run, const struct scenario *of, size_t i); /* [SESSION_ALARM] */

/* The next from number *@i on that the actions of the file do, but for acknowledging; NULL: none. */
const struct action *session_next_action(const struct scenario *reference, size_t *i);
/* When people first wrote to what it writes to, from @from on, s; NAN: never. */
double session_done(const struct scenario *session, const struct action *action, double from);

#endif
