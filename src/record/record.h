/* SPDX-License-Identifier: BSD-3-Clause */
/* What is kept of a run, and what is read from it. */
#ifndef APC_RECORD_H
#define APC_RECORD_H

#include <stdbool.h>
#include <stdio.h>

#include <apcstore.h>
#include <apcstore.h> /* APC_TAG_LEN */
#include <apctimer.h> /* struct apc_bin */

#include "experiment/experiment.h"
#include "operate/operate.h"

/* ---- Samples -------------------------------------------------------------------------------- */

/* The samples of a run: measurements, setpoints, outputs, and the file samples.csv. */

struct samples {
    struct apc_sample *at;
    size_t n, room;
};

int samples_add(struct samples *s, const struct apc_sample *sample); /* 0 or APC_ENOMEM */
void samples_free(struct samples *s);
/* By time; at one time in the order of the loop: setpoint, measurement, output. */
void samples_sort(struct samples *s);
/* Those of DIR/NAME, samples.csv or operation.csv, in the order of the file, times counted from the start of
 * the run, and the seq of each variable counted from 1. Returns 0 or a negative error; samples_free() in
 * either case. */
int samples_read(struct samples *s, const char *dir, const char *name, struct apc_error *why);
/* What a run writes at its end is not there: says who makes it. */
int samples_missing(const char *dir, const char *name, struct apc_error *why);
/* Each row of a file as such, with its time as a number: to @p take, which returns 0 or a negative error. */
int samples_each(const char *path, int (*take)(void *ctx, double t, const struct apc_sample *sample),
                 void *ctx, struct apc_error *why);
/* Those that a store has in a range, sorted. Returns 0, APC_ENOMEM or the store's error. */
int samples_collect(struct samples *s, struct apc_store *store, const struct experiment *e,
                    const struct apc_range *range);
/* Those of one variable. */
int samples_collect_one(struct samples *s, struct apc_store *store, enum apc_table table, int id,
                        const struct apc_range *range);
/* Modes, target and actual, tuning, operator's outputs, ramps of setpoints: of each the newest before the range,
 * and those in it; by time. */
int samples_collect_operation(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range);
/* The numbers that laws published: in the range only, by time. */
int samples_collect_published(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range);
/* After those that @s has, in their order. Returns 0 or APC_ENOMEM. */
int samples_append(struct samples *s, const struct samples *more);
/* With the header; times in seconds since @start. */
void samples_write(const struct samples *s, apc_ns start, FILE *out);
void samples_write_rows(const struct samples *s, apc_ns start, FILE *out); /* without it */

/* ---- Ticks ---------------------------------------------------------------------------------- */

/*
 * What each tick of each controller was made from, as a run folder keeps it: ticks.db, a store of its own
 * with the controllers' tick rows, the plans of setpoints, the rows of setpoint, opmode, manual, tuning and
 * actual that they name, and what the laws published.
 */

#define TICKS_FILE   "ticks.db"
#define WRITTEN_FILE "written.csv" /* of apc run --speed */

/* The ticks in @p file, to be read or written by whom no tick waits for: as long as a busy disk takes.
 * Returns 0 or a negative error. */
int ticks_open(struct apc_store **ticks, const char *file, struct apc_error *why);
/* From the run's store, of a range, into the folder. Returns 0 or a negative error. */
int ticks_keep(const char *dir, struct apc_store *from, const struct experiment *e,
               const struct apc_range *range, struct apc_error *why);

/* The tick rows of one controller, or the plans of one setpoint, by seq. */
struct ticks {
    struct tick_row {
        int64_t seq;
        apc_ns time;
        size_t n, first; /* values, and where they begin */
    } * at;
    double *value;
    size_t n, room, n_values, values_room;
    int64_t end; /* the last seq that is taken; 0: there is no such */
    bool full;   /* no memory for more */
};

/* Those that a store has of number @p id of @p table, from @p since on. Returns 0, APC_ENOMEM or the store's
 * error; ticks_free() in either case. */
int ticks_load(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id, apc_ns since);
/* Behind those that are there, which are older: of a range. The same. */
int ticks_add(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id,
              const struct apc_range *range);
/* Where seqs lack, as a range of time leaves out what a clock that was set back has overtaken: up to @p most before each
 * that follows, and before the first of all if @p first, as far as the store has them. Returns as ticks_add(). */
int ticks_fill(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id, size_t most,
               bool first);
/* Does a tick row name samples of it by their seq? */
bool ticks_name(enum apc_table table);
void ticks_free(struct ticks *ticks);
/* NULL: it is not on record. */
const struct tick_row *ticks_find(const struct ticks *ticks, int64_t seq);

/* ---- Trajectories --------------------------------------------------------------------------- */

/*
 * The trajectories of a run, of which its figures are made: what the plant put out, what was wanted, what the plant
 * was given, and when nobody controlled it. Times are in s since the start of the run.
 */

struct curve {
    struct curve_point {
        double t, value;
    } * at;
    size_t n, room;
};

struct trajectory {
    struct apc_dim dim;
    struct curve *output;   /* [ny] at each tick of the plant; between them they are straight lines */
    struct curve *setpoint; /* [nz] its changes */
    struct curve *input;    /* [nu] its changes, as the plant was given them */
    struct curve *target;   /* [nz] of a ramp: changes of where it goes, and of how fast it does, 1/s */
    struct curve *rate;     /* [nz] 0, or without a point: on none */
    struct curve without;   /* changes between 0 and 1: the plant is not under the law's control */
    double end;             /* s */
    double gap;    /* s: farther apart two points of an output have a hole between them; HUGE_VAL: never */
    bool measured; /* output is what was measured of it: that is all there is of a run in real time */
    bool diverged; /* the plant, at the end */
    bool failed;   /* out of memory: it is not whole */
};

int trajectory_create(struct trajectory *c, const struct apc_dim *dim); /* 0 or APC_ENOMEM */
void trajectory_free(struct trajectory *c);

/* A new value, if it is one: not that of the last point. Times do not go back. */
void trajectory_change(struct trajectory *c, struct curve *curve, double t, double value);
/* A point, new or not. */
void trajectory_add(struct trajectory *c, struct curve *curve, double t, double value);

/*
 * Those that the samples of a run in real time tell, their times counted from @p start. There was no
 * control while an output was not the law's, or while outputs or measurements stayed away for longer than the
 * plant waits for them. Returns 0 or APC_ENOMEM; trajectory_free() in either case.
 */
int trajectory_of_samples(struct trajectory *c, const struct samples *samples, const struct experiment *e,
                          apc_ns start);

/* What @p operation has of ramps, by time: times before @p start as well. Out of memory: failed. */
void trajectory_add_ramps(struct trajectory *c, const struct samples *operation, apc_ns start);

/* The file plant.csv of a run folder: what simulation knows of the plant and nobody measured. Reading returns
 * APC_ENOTFOUND when there is none; trajectory_free() in either case. */
int trajectory_write(const struct trajectory *c, const char *dir, struct apc_error *why);
int trajectory_read(struct trajectory *c, const char *dir, const struct apc_dim *dim, struct apc_error *why);

/* Of the run in folder @p dir: the plant's own if it has them, or else that of its samples; with the ramps of its
 * setpoints. */
int trajectory_load(struct trajectory *c, const char *dir, const struct experiment *e, struct apc_error *why);

/* ---- Prediction ----------------------------------------------------------------------------- */

/* What predictive laws expected at an instant, over their horizons, beside what came of it. */

/* Of one measurement what was predicted, or of one output what was planned. */
struct prediction_trajectory {
    char name[APC_TAG_LEN], unit[APC_TAG_LEN]; /* of the variable */
    enum apc_table table;                      /* the variable: of sensor, actuator or setpoint */
    int id;
    int prediction;    /* id of the row in table prediction */
    apc_ns made, step; /* when */
    apc_ns first;      /* after that: when the first value is for */
    apc_ns patience;   /* how long a row of the variable stands for what is */
    size_t n;
    double *expected, *came; /* [n]; came is NAN where nothing is on record, or it is Bad */
};

struct prediction {
    struct prediction_trajectory *trajectory;
    size_t n;
};

/* The variable of @p table that a name beside it is of: "y1.prediction" or, of several controllers,
 * "upper.y1.prediction" is of y1, with @p end ".prediction". NULL: of none that is there. */
const struct apc_tag *prediction_variable(const struct apc_tag *published, const char *end,
                                          enum apc_table table, const struct apc_tag *tag, size_t n);

/*
 * What stood at @p at: of each variable whose tag says that a law expects it, the newest row until then,
 * unless its horizon was over. The store's times are @p offset later. Nothing of what came is known yet.
 * Returns 0, APC_ENOMEM or the store's error; prediction_free() in either case.
 */
int prediction_load(struct prediction *o, struct apc_store *published, const struct apc_tag *tag, size_t n,
                    apc_ns at, apc_ns offset);
/* What came, from rows by time. */
void prediction_take(struct prediction *o, const struct apc_sample *rows, size_t n);
/* The same from a store's history until @p now, whose times are those of @p o. Returns 0, APC_ENOMEM or the
 * store's error. */
int prediction_take_store(struct prediction *o, struct apc_store *store, apc_ns now);
void prediction_free(struct prediction *o);

/* Of value @p k: how long after it was made. */
static inline double prediction_ahead(const struct prediction_trajectory *c, size_t k)
{
    return apc_ns_to_s(c->first + c->step * (apc_ns)k);
}

/* ---- Report data ---------------------------------------------------------------------------- */

/* What the report is drawn from: the CSV files of a run folder, read into memory. */

struct report_point {
    double t, value; /* t in s since the start of the run */
    enum apc_severity severity;
    bool limited; /* a limit held it back */
    size_t line;  /* of the file: keeps the order of points of the same time */
};

/* The samples of one variable in order of time. */
struct report_series {
    struct report_point *points;
    size_t n, capacity;
};

/* The variables of one kind: id i is series[i - 1]. */
struct report_group {
    struct report_series *series;
    size_t n; /* highest id in the file */
};

/* What was out of the ordinary. */
struct report_event {
    double t;
    bool alarm; /* or a warning */
    char kind[32];
};

/* (t_{k+1} - t_k) - period of one task, in ns. */
struct report_jitter {
    char task[APC_TAG_LEN];
    struct apc_bin *bins;
    size_t n_bins, capacity;
    uint64_t count, missed;
    double period, mean, sd;
};

struct report_data {
    struct report_group y, z, u;
    struct report_group published; /* by id of the estimate */
    struct report_group mode;      /* of loop i: actual ones; not Good where it differs from the target */
    struct report_jitter *jitter;  /* [n_jitter] in the order of the file */
    size_t n_jitter;
    struct report_event *event; /* [n_events] by time; none where there is no events.csv */
    size_t n_events, events_room;
    double begin, end; /* s: 0 and the time of the last sample of all, or what is left of these */
    const struct prediction *expected; /* to be laid over it; NULL: nothing */
};

/* Fill *data, which report_free() takes back also after a failure. Returns as report_write() does. */
int report_read(struct report_data *data, const char *dir, struct apc_error *why);
void report_free(struct report_data *data);

/* Leave what happened from @p begin to @p end, and what was in force before it. */
void report_clip(struct report_data *data, double begin, double end);

/* Of one task; NULL: nothing is known of it. */
struct report_jitter *report_jitter_of(const struct report_data *data, const char *task);

/* ---- Alarms --------------------------------------------------------------------------------- */

/*
 * What alarms did: the journal of a store, all transitions in their order, and the figures by which
 * ANSI/ISA-18.2 (16.) and EEMUA 191 judge how many there are.
 */

#define ALARMS_WINDOW         (600 * APC_NS_PER_S) /* alarms are counted by ten minutes */
#define ALARMS_FLOOD          10                   /* more in one: nobody can follow */
#define ALARMS_CHATTER        3                    /* one alarm so often within: */
#define ALARMS_CHATTER_WINDOW (60 * APC_NS_PER_S)
#define ALARMS_STALE          (86400 * APC_NS_PER_S) /* standing for longer */

struct alarm_transition {
    int64_t number, seq; /* in the journal; of its row */
    apc_ns time;
    int alarm;
    enum apc_alarm_state before, state; /* before 0: not known */
    apc_status status;
    uint32_t author;
    char *reason; /* as somebody gave it; NULL: nobody did, or nobody looked it up */
};

struct alarm_journal {
    struct alarm_transition *at; /* [n] by number */
    size_t n;
};

/* Those of alarms 1 .. @n in the range, whose `last` is of all of them together. Returns 0, APC_ENOMEM or the
 * store's error; alarm_journal_free() in either case. */
int alarm_journal_load(struct alarm_journal *journal, struct apc_store *store, size_t n,
                       const struct apc_range *range);
/* What somebody looks for in a journal. */
struct alarm_search {
    bool *of;        /* [n]: the alarms */
    uint32_t states; /* 1 << state of those that they went to; 0: any */
    int64_t before;  /* lower numbers alone, beside a range's until; 0: any */
};
#define ALARM_SEARCH_MOST 1000000 /* transitions that are looked at */
/* The same of those, and APC_ERANGE: there are too many to look at. */
int alarm_journal_find(struct alarm_journal *journal, struct apc_store *store, size_t n,
                       const struct apc_range *range, const struct alarm_search *search);
/* The reasons, out of the events of what people did. Returns 0, APC_ENOMEM or the store's error. */
int alarm_journal_reasons(struct alarm_journal *journal, struct apc_store *store, const struct experiment *e);
void alarm_journal_free(struct alarm_journal *journal);

/* Is an alarm raised by it: shown to operators as new? */
bool alarm_is_raised(const struct alarm_transition *t);

/* Of a new row of table alarm: the event that it is raised. Returns false where it is not, or is another row. */
bool alarm_event(const struct experiment *e, const struct apc_sample *row, struct apc_event *event);

/* Of one alarm. */
struct alarm_figure {
    size_t raised;
    apc_ns first;  /* time, when it was raised first; 0: it was not */
    apc_ns active; /* for how long it was active, masked or not */
    apc_ns since;  /* from when on it has been standing; 0: it is not */
    bool chatters;
    enum apc_alarm_state state; /* at the end */
};

struct alarm_figures {
    struct alarm_figure *alarm; /* [n] */
    size_t n;
    double hours;
    size_t raised, by_priority[APC_ALARM_PRIORITIES];
    double per_hour;
    size_t windows, floods, peak; /* of ten minutes: how many, those with a flood, the most in one */
    size_t chattering, standing, stale, unacked;
    size_t acknowledged;
    double to_acknowledge; /* s, mean; NAN: none was */
};

/* Of a journal that reaches from @since to @until. Returns 0 or APC_ENOMEM; alarm_figures_free() in either
 * case.
 */
int alarm_figures_make(struct alarm_figures *figures, const struct alarm_journal *journal,
                       const struct experiment *e, apc_ns since, apc_ns until);
void alarm_figures_free(struct alarm_figures *figures);

/* ---- Alarm trial ----------------------------------------------------------------------------- */

/*
 * What an alarm would have done with other settings: what was recorded of its signal is evaluated again, at the
 * same period, by the core that apc-alarms runs, with all settings at once. While the record has the alarm
 * shelved, suppressed or out of service, none of them is raised.
 */

enum alarm_setting { ALARM_AS_IS, ALARM_ON_DELAY, ALARM_OFF_DELAY, ALARM_DEADBAND, ALARM_SETTINGS };
#define ALARM_TRIES 18 /* most of an alarm */

/* One setting, the others as they are. */
struct alarm_try {
    enum alarm_setting setting;
    double value; /* s, or in the unit of the condition */
    size_t raised;
    apc_ns later;               /* by how much an alarm that it raises comes later than as it is, at most */
    size_t missed;              /* alarms that it does not raise at all: */
    apc_ns longest;             /* the longest one */
    bool proposed;              /* the smallest value that does nearly all of what more of it would */
    enum apc_alarm_state state; /* while it is evaluated */
    bool told;                  /* of what stands as it is */
};

struct alarm_trial {
    apc_ns since, until; /* of the record */
    size_t recorded;     /* how often it was raised there */
    struct alarm_try at[ALARM_TRIES];
    size_t n; /* the first is as it is */
    struct apc_alarms *core;
    apc_ns tick, period;  /* the next evaluation */
    apc_ns settle, quiet; /* for so long after a row, until then, an evaluation may find something else */
    apc_ns began;         /* since when it stands, as it is; 0: it does not */
};

/* The core of it: rows of the alarm's signals and of table alarm, by time, in; counts out. A row of table alarm
 * is of the time of the tick that wrote it. @stood is the alarm's newest row before, seq 0: none; its id is that of
 * the alarm. @scale is what a deadband is a twentieth of at most; 0: none is tried. Evaluated from @tick on. Returns
 * 0 or APC_ENOMEM with a text in @why; alarm_trial_free() in either case.
 */
int alarm_trial_begin(struct alarm_trial *trial, const struct apc_alarm *alarm, double scale,
                      const struct apc_sample *stood, apc_ns tick, apc_ns period, struct apc_error *why);
void alarm_trial_row(struct alarm_trial *trial, const struct apc_sample *row);
void alarm_trial_end(struct alarm_trial *trial, apc_ns until); /* evaluated before that; what is proposed */
void alarm_trial_free(struct alarm_trial *trial);

/* Of an alarm of a store, one of @e. @ticked is when alarms were evaluated once, 0: not known; @give_up when there is no more
 * time (mono), 0: never. Returns 0, APC_EINVAL (its condition is no signal's), APC_ENOTFOUND (there is no record), APC_ETIMEDOUT,
 * APC_ENOMEM or the store's error, with a text in @why; alarm_trial_free() in either case. */
int alarm_trial_make(struct alarm_trial *trial, struct apc_store *store, const struct experiment *e,
                     const struct alarm *alarm, apc_ns ticked, const struct apc_range *range, apc_ns give_up,
                     struct apc_error *why);

const char *alarm_setting_name(enum alarm_setting setting); /* "on-delay" and so on. Static. */
void alarm_trial_members(const struct alarm_trial *trial, const char *alarm, struct text *t);

/* ---- Alarm summary -------------------------------------------------------------------------- */

/* The alarms of a store as they stand, and what people want of them: for whoever shows or acknowledges them. */

#define ALARMS_BURST (60 * APC_NS_PER_S) /* at most between two that came together */
#define COMINGS      4                   /* of one alarm that are kept in mind */

/* When one was raised. */
struct alarm_raised {
    int64_t seq;           /* of the newest row that counts already; 0: none does */
    apc_ns last;           /* time; 0: not, or nobody knows */
    apc_ns began[COMINGS]; /* the newest first: one that comes again within a burst has come once */
};

/* Of one alarm: its newest row; the newest of each switch, and what became of that. */
struct alarm_now {
    struct apc_sample *row, *request[3], *actual[3]; /* request: ALARM_SWITCH() */
    struct alarm_raised raised;                      /* alarm_summary_mark(): this and the next */
    bool first_out;
};
#define ALARM_SWITCH(which) ((which)-APC_ALARM_ACK)

struct alarm_summary {
    struct experiment e;  /* as the store describes it */
    int64_t revision;     /* of the catalogue that this is of; 0: of none */
    struct alarm_now *at; /* [e.n_alarms] */
    struct alarm_coming { /* room for those of all alarms */
        const char *area;
        apc_ns time;
        struct alarm_now *of;
    } * coming;
    struct apc_sample *memory;
    struct apc_vector tick;
    double numbers[APC_ALARMS_TICK];
    struct apc_rows rows;
};

/* From the catalogue of a store; of a summary that is open, only where the catalogue is another than before.
 * Zeroed before the first time. Returns 0, APC_ENOTFOUND (it describes no alarms), or another error with a
 * text in @why; alarm_summary_close() in either case. */
int alarm_summary_open(struct alarm_summary *summary, struct apc_store *store, struct apc_error *why);
void alarm_summary_close(struct alarm_summary *summary);
/* What is newest. Returns 0 or the store's error. */
int alarm_summary_read(struct alarm_summary *summary, struct apc_store *store);

/* Of what was read: when each was raised, and which are first out. An alarm's history is looked into when it has moved
 * by more than one row since the last time, 64 rows back. Returns 0 or the store's error. */
int alarm_summary_mark(struct alarm_summary *summary, struct apc_store *store);
/* The core of it: of the alarms of one area, each of which came within ALARMS_BURST of the one before, those that came
 * first, at one evaluation, and stand. None did where all came at once. */
void alarm_summary_first_out(struct alarm_summary *summary);

/* NULL: there is none of that name. */
const struct alarm_now *alarm_summary_find(const struct alarm_summary *summary, const char *name);
const struct alarm *alarm_summary_alarm(const struct alarm_summary *summary, const struct alarm_now *now);
enum apc_alarm_state alarm_summary_state(const struct alarm_now *now);
/* When shelving that is in force ends, UTC; 0: it is not shelved. */
apc_ns alarm_summary_shelved(const struct alarm_now *now);

/* Is somebody evaluating them, at @utc? */
bool alarm_summary_lives(const struct alarm_summary *summary, apc_ns utc);

/* May shelving end then, @value as it is written? False, with a reason in @why: that is past, or too far. */
bool alarm_summary_may_shelve(const struct alarm_summary *summary, const struct alarm_now *now, double value,
                              apc_ns utc, struct apc_error *why);
/*
 * What is wanted of an alarm, as a row to be written; @value of APC_ALARM_SHELF and APC_ALARM_SERVICE as they
 * are written, of APC_ALARM_ACK what was seen is taken. Returns false, with a reason in @why, where it makes
 * no sense for the alarm as it stands: nothing to acknowledge, somebody has already, too long. @store knows
 * who that somebody is; NULL: nobody does.
 */
bool alarm_summary_want(const struct alarm_summary *summary, const struct alarm_now *now,
                        struct apc_store *store, enum apc_alarm_switch which, double value, apc_ns utc,
                        struct apc_sample *request, struct apc_error *why);
/* The same in words, as the record has it; @reason may be NULL. */
void alarm_summary_words(const char *name, const struct apc_sample *request, const char *reason, char *text,
                         size_t size);
/* What became of it, as of the last read. */
enum outcome alarm_summary_outcome(const struct alarm_summary *summary, const struct alarm_now *now,
                                   const struct apc_sample *request, apc_ns utc);
/* With which words it was refused: of the events since the tick that did the first one of this alarm. False:
 * it is not there; it may come a little later. */
bool alarm_summary_refusal(const struct alarm_summary *summary, const struct alarm_now *now,
                           const struct apc_sample *request, struct apc_store *store, char *text,
                           size_t size);

#endif
