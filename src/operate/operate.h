/* SPDX-License-Identifier: BSD-3-Clause */
/* What people do to a plant, and what becomes of it. */
#ifndef APC_OPERATE_H
#define APC_OPERATE_H

#include <apcmodules.h>
#include <apcstore.h>

#include "files/files.h"

/* ---- Loops ---------------------------------------------------------------------------------- */

/*
 * The loops and controllers of a plant as its store describes them, for whoever shows or moves them. An id of
 * table opmode whose tag names a controller is a loop, and the tag's name is the loop's; loops stand in the
 * order of their controllers.
 */

/* Ids of table opmode from here on are other switches: kind x this + apc_variable_number() of what they are
 * of. */
#define LOOPS_IDS 65536
/* That of a setpoint that the scheduler moves: whose it is, 0 Local, the operator's, 1 Remote, as it is
 * without a row. */
#define LOOPS_OWNER(setpoint) (LOOPS_IDS + apc_variable_number(APC_SETPOINT, setpoint))
/* That of an output: the number of the controller that acts on it. */
#define LOOPS_ACTING(table, output) (2 * LOOPS_IDS + apc_variable_number(table, output))
/* Of table dim, behind those of the loops: the step of a variable above which a write has to be confirmed. */
#define LOOPS_STEP(table, variable) (4 * LOOPS_IDS + apc_variable_number(table, variable))
/* The same: how long a write to it waits for a second person, s. Of all that a controller has, modes and tuning, it
 * stands under APC_TICK and the controller's number. */
#define LOOPS_SECOND(table, variable) (5 * LOOPS_IDS + apc_variable_number(table, variable))

/* Of tables setpoint and manual, behind those of the variables: of one on a ramp its target, and how fast it goes
 * there, 1/s; 0: it is on none. */
#define LOOPS_RAMP(variable) (7 * LOOPS_IDS + (variable))
#define LOOPS_RATE(variable) (8 * LOOPS_IDS + (variable))
/* Of a variable that operators write, in its own table: what somebody has asked for, and in how many s. */
#define LOOPS_ASKED(variable)      (10 * LOOPS_IDS + (variable))
#define LOOPS_ASKED_OVER(variable) (13 * LOOPS_IDS + (variable))

/* Of table opmode: fault number @p i of a simulated plant, from 0: 1 from its row on, 0 no more. Those of the experiment are
 * below LOOPS_FAULT_OWN, more than there can be; behind them is one of each kind for each signal. */
#define LOOPS_FAULT(i)   (9 * LOOPS_IDS + 1 + (int)(i))
#define LOOPS_FAULT_MOST 5000 /* of these latter ones, which have */
#define LOOPS_FAULT_OWN  (LOOPS_IDS - 1 - LOOPS_FAULT_MOST)
/* Of table tuning: numbers of their own; @p i begins at LOOPS_FAULT_OWN. */
#define LOOPS_FAULT_NUMBER(i, k) (9 * LOOPS_IDS + 1 + 12 * (int)(i) + (int)(k))
static inline bool loops_is_fault(const struct apc_sample *row)
{
    return (row->table == APC_OPMODE || row->table == APC_TUNING) && row->id / LOOPS_IDS == 9;
}

struct loops_controller {
    char name[APC_TAG_LEN];
    int number;      /* id of its tick row */
    apc_ns period;   /* 0: not said */
    size_t first, n; /* its loops */
    int choice;      /* id in table opmode of the switch that says who acts on its outputs; 0: it does */
    bool acts;       /* as loops_choose() was told last */
};

struct loops_loop {
    char name[APC_TAG_LEN]; /* "u1"; "upper.r1" of one that moves a setpoint, "trial.u1" of one in shadow */
    int id;                 /* of its target, in table opmode */
    int manual;             /* of what an operator puts out, in table manual; 0: not described */
    int would; /* of what it puts out or in shadow would, in table estimate; 0: it has its output alone */
    size_t controller;         /* its place */
    enum apc_table table;      /* of its output: actuator, setpoint, sensor; 0: not described */
    int output;                /* id in it */
    int measurement, setpoint; /* ids of what it controls, and to what; 0: none */
    int above;                 /* place of the loop that moves its setpoint in Cas; -1: none does */
};

struct loops_step {
    int id; /* LOOPS_STEP(), LOOPS_SECOND() */
    double most;
};

struct loops {
    struct loops_loop *at;
    size_t n;
    struct loops_controller *controller;
    size_t n_controllers;
    int *scheduled; /* [n_scheduled] ids of the setpoints that the scheduler moves, in rising order */
    size_t n_scheduled;
    struct loops_step *step; /* [n_steps] */
    size_t n_steps;
};

/* From the tags of a store, its table dim, and its switches of who acts. n is 0 where no loops are described.
 * Returns 0, APC_ENOMEM or the store's error; loops_free() in either case. */
int loops_load(struct loops *loops, struct apc_store *store, const struct apc_tag *tag, size_t n);
void loops_free(struct loops *loops);

/* The switch of that id, of table opmode, says this number. True: another one acts. */
bool loops_choose(struct loops *loops, int id, double number);

/* NULL: there is none. By the name of an output it is the loop of the controller that acts on it; that of a
 * certain one is CONTROLLER.OUTPUT. */
const struct loops_loop *loops_find(const struct loops *loops, const char *name);
const struct loops_controller *loops_controller(const struct loops *loops, const char *name);
/* Who takes a variable that is described so: of setpoints and outputs the one that acts. NULL: nobody. */
const struct loops_controller *loops_taker(const struct loops *loops, const struct apc_tag *tag);
/* The one that has this as its output, its setpoint, its target mode or its manual output; of several with an
 * output in common the one that acts. */
const struct loops_loop *loops_of(const struct loops *loops, enum apc_table table, int id);

/* Does the scheduler move this setpoint? */
bool loops_scheduled(const struct loops *loops, int setpoint);
/* The greatest step of a setpoint or an output that needs no confirmation; 0: any. */
double loops_step(const struct loops *loops, enum apc_table table, int id);
/* How long a write to it waits for a second person, s; 0: it needs none. */
double loops_second(const struct loops *loops, enum apc_table table, int id);
/* Is an event of that source said by that controller? By "apc-controller", or with its name where there are
 * several. */
bool loops_is_from(const struct loops *loops, const struct loops_controller *controller, const char *source);
/* Is it such a switch, and what does its newest row say? */
bool loops_is_owner_id(int id); /* of table opmode */
bool loops_is_owner(const struct apc_sample *row);
bool loops_is_local(const struct apc_sample *owner);
const char *loops_owner_name(bool local); /* "Local", "Remote" */
/* The setpoint whose owner a row of table opmode says: a switch, or the target of its loop. 0: none. */
int loops_owned(const struct loops *loops, const struct apc_sample *row);

/* ---- Entries -------------------------------------------------------------------------------- */

/* What is known of a loop, of one moment; of rows seq 0: there is none. */
struct entry_seen {
    struct apc_sample target, actual; /* its modes */
    struct apc_sample output;
    bool stopped; /* its controller is known not to tick */
    bool safe;    /* the plant says that it takes no output */
};

struct entry_note {
    const char
        *code; /* "stopped", "safe", "oos", "shadow", "tracking", "fault", "backup", "man", "shed", "held",
                         "low", "high", "both" */
    const char *text;
};

/* What a loop follows instead of an entry, or what holds it back; of several the first, from which the others
 * follow. NULL: nothing does. [tick] */
const struct entry_note *entry_note(const struct entry_seen *seen);
/* {"code", "text"}, or null. */
void entry_note_json(const struct entry_note *note, struct text *t);

/* ---- Changes -------------------------------------------------------------------------------- */

/*
 * What somebody wants to write, whoever brings it: the command line, the page, a history, a broker, Python.
 * Here is found what is meant, and said what is wrong with it: each front end translates the code, and passes
 * the sentence on.
 */

#define CHANGE_TEXT   DECIMAL_LEN /* a value in words */
#define CHANGE_REASON 80          /* bytes: an event has little more room */

struct change_fault {
    int err;          /* enum apc_err: an exit code, an exception */
    const char *code; /* "variable": there is none; "value"; "limits"; "mode": not as its loop is; "stale":
                         somebody was faster; "role"; "confirm"; "second"; of an operation, as it says there; static */
    char text[240];   /* which? what was expected? */
};
/* Fill it in. Returns @p err. */
int change_fail(struct change_fault *why, int err, const char *code, const char *fmt, ...) APC_PRINTF(4, 5);

enum change_kind { CHANGE_SETPOINT = 1, CHANGE_OUTPUT = 2, CHANGE_TUNING = 4, CHANGE_MODE = 8 };

/* The plant as whoever asks has it. */
struct plant_view {
    const struct apc_tag *tag;
    size_t n;
    const struct loops *loops;
};
const struct apc_tag *plant_tag(const struct plant_view *plant, enum apc_table table,
                                int id); /* NULL: none */

/* The same as the store describes it. Returns 0, APC_ENOMEM or the store's error; known_free() in either
 * case. */
struct known_plant {
    struct apc_tag *tag;
    struct loops loops;
    struct plant_view view;
};
int known_load(struct known_plant *plant, struct apc_store *store);
void known_free(struct known_plant *plant);

struct change_target {
    char name[APC_TAG_LEN]; /* of what an operator puts out: that of the output */
    enum apc_table table;   /* where it is written */
    int id;
    double low, high;
    double step;                   /* the greatest that needs no confirmation; 0: any */
    double second;                 /* s that a write waits for a second person; 0: it needs none */
    const struct loops_loop *loop; /* loops_of() it */
};

/* By its name, or as "setpoint.1"; an output as well by its loop's; with CHANGE_MODE, which goes with no
 * other, a loop. All return 0, or an error with @p why. */
int change_find(const struct plant_view *plant, const char *name, unsigned kinds, struct change_target *to,
                struct change_fault *why);
int change_at(const struct plant_view *plant, enum apc_table table, int id, struct change_target *to,
              struct change_fault *why);
/* Is it a setpoint, an output, tuning, a mode or an owner? Alarms and requests are switches of table opmode as well. */
bool change_is_of(const struct apc_tag *tag);

int change_number(const char *text, double *value, struct change_fault *why);
int change_mode(const char *text, double *mode, struct change_fault *why); /* "Man", whatever its letters */
int change_reason(const char *reason, struct change_fault *why);
/* May it be that? Within its limits; a mode that the loop can be in. */
int change_check(const struct change_target *to, double value, struct change_fault *why);
/* The two of these, for those that have no store. @p below: a controller moves its setpoint. */
int change_limits(const char *name, double low, double high, double value, struct change_fault *why);
int change_cascade(const char *loop, bool below, double mode, struct change_fault *why);
/* May it be written while the target @p mode of its loop is this? Of others than these the mode is of no
 * account. */
bool change_asks_mode(const struct change_target *to);
int change_now(const struct plant_view *plant, const struct change_target *to, const struct apc_sample *mode,
               struct change_fault *why);

/* What else may be in the way, in words. */
int change_stale(const char *name, const struct apc_sample *now, struct change_fault *why);
int change_role(const char *user, const char *role, const char *wanted, struct change_fault *why);
/* A simulated plant that goes back does again what people did then, and nothing else: "simulation", or 0. */
int change_in_past(struct apc_store *store, struct change_fault *why);

/* The shortest that reads back the same, from six digits on; modes and owners by name; "none". Both return
 * text. */
char *change_text(const struct apc_sample *sample, char text[CHANGE_TEXT]);
/* "3.2 s", "40 s", "5 min"; "2.0 s ahead" of what is to come. Returns text. */
char *change_age(apc_ns age, char text[CHANGE_TEXT]);

/* ---- Owner ---------------------------------------------------------------------------------- */

/*
 * What an operator writes, with what hangs on it. A setpoint that somebody else moves has an owner. Where
 * that is a loop above, the setpoint is its while the target of its own is Cas, else the operator's; where it
 * is the scheduler, a switch says so (LOOPS_OWNER). Whoever changes the owner writes it and the setpoint
 * together, each only if nobody did since it was looked at.
 */

/* Rows that were written besides. Of table opmode: the setpoint was another's, and is the operator's now. */
struct owner_rows {
    struct apc_sample *at; /* free() */
    size_t n;
};

/*
 * Write operator variables as one, as apc_store_swap() does it: seq is the newest that the caller knows, or
 * APC_SEQ_ANY, and becomes that of the row. A setpoint that is another's takes along what makes it Local, the
 * target Auto or the switch; a target that comes to Cas or goes from it, and a switch that changes, take the
 * setpoint along, as it is in force. Returns 0, APC_ECONFLICT (a seq was not the newest; or, after ten tries,
 * somebody was always faster: then @p samples are what is newest), APC_ENOMEM or the store's error. What is
 * written leaves its ramp, unless a rate is among the samples.
 */
int owner_put(struct apc_store *store, const struct loops *loops, struct apc_sample *samples, size_t n,
              struct owner_rows *with);

/* ---- Outcome -------------------------------------------------------------------------------- */

/*
 * What became of an operator's write: one judgement for all who show it. The controller that acts on a
 * variable says in its row of table actual which row of the variable it has looked at, and what came of that;
 * its tick row says that it lives.
 */

enum outcome {
    OUTCOME_WAITING = 1, /* its controller has not come to it, or to the mode, yet */
    OUTCOME_APPLIED,     /* it is in force */
    OUTCOME_SUPERSEDED,  /* a newer row came after it */
    OUTCOME_REFUSED,     /* outcome_refusal() finds why */
    OUTCOME_NOBODY       /* its controller does not tick: outcome_age() */
};

/* What is known of a write, of one moment. */
struct outcome_seen {
    const struct apc_sample *write;  /* as it was stored: table, id, seq, value */
    const struct apc_sample *actual; /* newest of apc_variable_number() of that; seq 0: there is none */
    const struct apc_vector *tick;   /* newest of its controller; seq 0: it has never ticked */
    apc_ns period;                   /* of its controller; 0: not known */
    apc_ns now;                      /* UTC */
};

/* A mode that was written for all loops, under id 0, has an outcome in each loop: that of the loop's own row.
 * [tick] */
enum outcome outcome_of(const struct outcome_seen *seen);

/* How long ago it ticked; 0: just now, or never, or by a clock that is ahead of this one. [tick] */
apc_ns outcome_age(const struct outcome_seen *seen);

/*
 * With which words something was refused since @p since, UTC: of the events that say so the last one that
 * names @p name, or the last one. Returns whether there is one. The event may come a little after the row.
 * [setup]
 */
bool outcome_refusal(struct apc_store *store, const char *name, apc_ns since, char *text, size_t size);

/* ---- Operation ------------------------------------------------------------------------------- */

/*
 * A write on its way, in steps of which none waits: whoever brings it waits between them as he can.
 *
 *     operation_ready()    would anybody apply it?
 *     operation_begin()    write it, with its events
 *     operation_poll()     what has become of it? operation_look() and change_judge()
 *     operation_finish()   that, in words
 *
 * Who has what was seen from somewhere else, as a page that follows the whole plant, fills it in and asks
 * change_takes(), change_judge(), change_finish(). What he has seen is late: before he refuses for that, he asks
 * operation_ready(), followed.
 */

struct change {
    struct change_target to;
    const struct loops_controller *by; /* who takes it; NULL: nobody */
    struct apc_sample before;          /* what was in force: operation_read() */
    struct apc_sample after; /* value; seq: the newest that its author knows, or APC_SEQ_ANY, then its own */
    double over;   /* s that it takes, linearly, to value; after.seq is then of where it begins. 0: at once */
    bool stop;     /* its ramp ends where it is: operation_begin() fills value in */
    int64_t along; /* of a switch of the scheduler: seq of the setpoint that was written with it */
    int64_t ticked; /* seq of the tick that operation_ready() saw first, or that was followed */
    bool ticks;     /* who follows its controller has seen it tick lately: change_takes() */

    struct apc_sample newest; /* as seen last, their tables and ids from the first: the variable */
    struct apc_sample actual; /* what is in force; of a switch the setpoint */
    struct apc_sample mode;   /* the target of its loop, where change_asks_mode(); else without a table */
    struct apc_vector tick;
    apc_ns period; /* of its controller; 0: not known */
    enum outcome outcome;
    char refusal[160]; /* with which words; "": not known */
};

/* What one has asked for, and another approves. */
struct approval {
    char asker[APC_AUTHOR_LEN];
    struct apc_sample *row; /* [n] that wait until then; free() */
    size_t n;
};

struct operation {
    const struct plant_view *plant;
    struct change *change; /* [n] in one transaction */
    size_t n;
    bool confirmed;     /* great steps are meant: change_step() */
    const char *group;  /* they are target modes, of all loops of this: "mode"; NULL: they are not */
    const char *author; /* "": nobody who is known */
    const char *note;   /* behind each event: " (from 10.0.0.1)"; NULL: nothing */
    const char *reason; /* behind that, as change_reason() takes it; NULL, "": none */
    const struct apc_sample *mark;   /* a row that is written with them; NULL: none */
    const struct approval *approval; /* operation_approve() has filled it in; NULL: it is no such */
    int (*record)(void *ctx, struct apc_store *store, const struct apc_event *event,
                  size_t n); /* NULL: appended */
    void *ctx;
    bool followed; /* change.ticks and .ticked are given, 0: none was seen; operation_ready() does not wait */

    apc_ns time;            /* of the rows and events, UTC; 0: operation_begin() fills it in */
    struct owner_rows with; /* what was written besides: operation_end() */
    apc_ns asked, begun;    /* monotonic: first operation_ready(), operation_begin() */
    apc_ns refused;         /* the same: when it was first seen to be refused; 0: it was not */
};

/* Is the step from what is in force before too great to be made without a confirmation? Returns 0, or APC_EPERM
 * with "confirm". operation_begin() asks it. */
int change_step(const struct change *change, struct change_fault *why);
/* Fill one in: what was found is to become @p value, whatever is newest. */
void change_make(const struct plant_view *plant, const struct change_target *to, double value,
                 struct change *change);
/* May a ramp take that long, s? Returns 0, or APC_ERANGE with "value". */
int change_over(double over, struct change_fault *why);
/* "r: 10 -> 12", "u mode: Auto -> Man", "r: 10 -> 50 over 60 s"; @p group NULL: by its own name. Returns text. */
char *change_words(const struct change *change, const char *group, char *text, size_t size);
/* How long what a controller that ticks does in time may take. */
apc_ns change_patience(const struct change *change);
/* By what was seen, of that moment, UTC. */
enum outcome change_judge(const struct change *change, apc_ns utc);
/* Its outcome in words: "applied"; "superseded: it is 13 now"; "refused: too much"; "written, but ...". Returns
 * @p said->err: 0; APC_ECONFLICT "superseded"; APC_EPERM "refused"; APC_ETIMEDOUT "nobody", "unconfirmed". */
int change_finish(const struct change *change, apc_ns utc, struct change_fault *said);
/* Its controller has never ticked, or not lately: "no controller applies it: ..." Returns APC_EPERM. */
int change_nobody(const struct change *change, apc_ns utc, struct change_fault *why);

/* For who has followed the ticks of its controller: the last came @p age ago; < 0: none has.
 * Returns 0, or APC_EPERM with "nobody". */
int change_takes(const struct change *change, apc_ns age, apc_ns utc, struct change_fault *why);

/* Are all of them the same change? Then they are told of as one. */
bool operation_is_one(const struct operation *o);
/* Fill in what is in force before. Returns 0 or the store's error, as operation_look() does. */
int operation_read(struct operation *o, struct apc_store *store);
int operation_look(struct operation *o, struct apc_store *store);
/* Does each controller tick that it is for? An age by the clocks of two hosts is no proof that it does not: then
 * a tick is waited for. Returns 1, 0: not known yet, or an error: APC_EPERM with "nobody", or the store's. */
int operation_ready(struct operation *o, struct apc_store *store, struct change_fault *why);
/* Returns 0, or an error: "confirm"; "second", nothing was written but that it is asked for, or is already; "ramp", there is none to stop, or no value to begin at; APC_ECONFLICT, "stale", then newest is; "unknown": it may have been written; "store";
 * "record": it was written, but its event was not. */
int operation_begin(struct operation *o, struct apc_store *store, struct change_fault *why);
/* Before anything is written: has each of its events, with @p also, room for the reason? Returns 0, or APC_EINVAL
 * with "value". operation_begin() and operation_refuse() ask it. */
int operation_fits(const struct operation *o, const char *also, struct change_fault *why);
/* Its events alone, with @p also said in each. Returns 0, APC_ENOMEM or the store's error. */
int operation_record(const struct operation *o, struct apc_store *store, const char *also);
/* Returns 1: all is settled, or has taken too long; 0: not yet; or the store's error. */
int operation_poll(struct operation *o, struct apc_store *store);
#define UNDO_WITHIN (60 * APC_NS_PER_S) /* that a last write may be ago */
/*
 * Fill in what takes back the last write of o->author, of setpoints, outputs, modes, owners or tuning: change
 * [n], to be freed. operation_begin() finds who comes between. @p only: of this time alone, UTC, to the
 * microsecond; 0: whichever is the last. Returns 0, or an error: "undo", there is none within UNDO_WITHIN, or it
 * is another one; "stale", somebody has written since; "value", "mode", "limits": what was before cannot be
 * written as things stand; "store".
 */
int operation_undo(struct operation *o, struct apc_store *store, apc_ns only, struct change_fault *why);
/* Is everything of it for what is newest, and may it be written as things stand? Returns 0, or an error with "stale",
 * "mode". */
int operation_check(const struct operation *o, struct apc_store *store, struct change_fault *why);

/*
 * Two persons. Where a variable's `second` is above 0, operation_begin() writes what is asked for beside it, in its
 * table: value is what it is to become, origin the seq that it is for (0: whatever is newest), and under its own id
 * in how many s; Good as long as it waits. All rows of what was asked for at once have their time and their author.
 */
struct waiting {
    struct change_target to;
    struct apc_sample row, over;
    char asker[APC_AUTHOR_LEN];
    apc_ns until; /* UTC, of all that was asked for at once */
};
/* All that waits, and what waited until its time was over, in the order of the tags; free() @p asked in either case.
 * Returns how many, APC_ENOMEM or the store's error. */
int waiting_load(struct waiting **asked, struct apc_store *store, const struct plant_view *plant);
/*
 * Fill in what was asked for at once: at @p only, UTC, to the microsecond, or, where that is 0, of a variable of that
 * name, or TABLE.ID. change [n] and approval->row, to be freed, in either case. Then operation_begin() writes it, and
 * operation_refuse() lets nobody write it; who has asked may do the latter. Returns 0, or an error: "second", nothing
 * waits, its time is over, or o->author has asked; "stale", "value", "limits", "mode" as of operation_undo();
 * "store".
 */
int operation_approve(struct operation *o, struct apc_store *store, apc_ns only, const char *name,
                      bool refuses, struct approval *approval, struct change_fault *why);
/* Returns APC_ECONFLICT with "second": somebody else was faster. */
int change_approved(struct change_fault *why);
/* Returns 0, or an error: that of change_approved(); "store", "record". */
int operation_refuse(struct operation *o, struct apc_store *store, struct change_fault *why);
/* For operation_begin(): does it need a second person? Then ask: returns an error, as that does. 0: it needs none. */
int operation_ask(struct operation *o, struct apc_store *store, uint32_t author, struct change_fault *why);

/* What people had set at an instant, by the store as it stood then. */
struct retake {
    struct apc_store *past;
    const struct apc_tag *tag; /* [n] as variables were described then; NULL: as they are now */
    size_t n;
    const char *const *name; /* [n_names] of loops, controllers or variables; none: all */
    size_t n_names;
};
/*
 * Fill in what makes tuning, modes, and setpoints that people moved then, what they were: change [n], to be freed,
 * of those that differ; n is 0 where none does. What the scheduler or a loop above moved then becomes theirs again;
 * outputs stay as they are. Each is for what was newest when it was looked at. Returns 0, or an error: "variable",
 * it is gone, or there is none of that name; "value", "limits", "mode": it has no certain value then, or cannot be
 * written as things stand; "store".
 */
int operation_retake(struct operation *o, struct apc_store *store, const struct retake *of,
                     struct change_fault *why);
/* For who can wait: until something happens, for as long at most. Returns 0 or the store's error. */
int operation_wait(const struct operation *o, struct apc_store *store, apc_ns most);
/* Of the one at place @p i, as change_finish(). */
int operation_finish(const struct operation *o, size_t i, struct change_fault *said);
void operation_end(struct operation *o);
/* The row made a setpoint the operator's: "r taken Local, cascade open". Returns text; NULL: it did not. */
char *operation_taken(const struct operation *o, const struct apc_sample *row, char *text, size_t size);

/* ---- Promotion ------------------------------------------------------------------------------- */

/* Which of several controllers of the same outputs acts: a switch, and how far the one that is to act has come. */
struct promotion {
    const struct loops *loops;
    const struct loops_controller *to;
    struct apc_sample choice, target,
        actual;             /* the switch; of its first loop the target and the actual mode */
    struct apc_vector tick; /* of its own: its first two numbers say what made it */
    double mark[2];
};

/* Returns 0, or an error: "variable", there is no such controller; "second", one of them takes two persons; "mode", no
 * other one has its outputs. */
int promotion_find(struct promotion *p, const struct loops *loops, const char *name,
                   struct change_fault *why);
int promotion_look(struct promotion *p, struct apc_store *store); /* 0 or the store's error */
/* Who acts by the last look; NULL: nobody knows. */
const struct loops_controller *promotion_acting(const struct promotion *p);
/* It acts, as far as is seen: out of service, if that is what is wanted, nobody can see who does. */
bool promotion_is_done(const struct promotion *p);
int promotion_silent(const struct promotion *p, struct change_fault *why); /* it does not tick: APC_EPERM */
int promotion_stale(const struct promotion *p,
                    struct change_fault *why); /* it is not as described: APC_EPERM */
/* Is its target another mode than out of service? 0 or APC_EPERM. */
int promotion_in_service(const struct promotion *p, struct change_fault *why);
/* Write it, unless the switch is another's since the last look. The caller records @event then, which has @p note before
 * the reason. Returns 0, or an error: "simulation", "stale", "unknown", "store". */
int promotion_put(struct promotion *p, struct apc_store *store, const char *author, const char *note,
                  const char *reason, struct apc_event *event, struct change_fault *why);

/* ---- Ramps ----------------------------------------------------------------------------------- */

/*
 * Setpoints and manual outputs on their way to a target. Who asks for it writes target, rate and where it begins
 * in one transaction, under his name; the controller that takes the variable moves it from then on, look by look,
 * under no name. Where it is is its own newest row, and time is counted while the mover lives: so one that was
 * restarted goes on from there, and no step of a clock moves anything. The ramp ends at its target, when anybody
 * else writes to the variable, or when the loop of a manual output leaves Man.
 */
struct ramp {
    struct apc_sample rate, target, now, mode; /* newest rows; mode of table 0: it does not matter */
    const struct apc_tag *tag;
    int64_t moved; /* seq of the row that it was moved to; 0: not yet */
    apc_ns last;   /* mono: when */
    int refused;   /* with which error the store refused its last step; 0: it did not */
};

struct ramps {
    const struct plant_view *plant;
    struct ramp *at; /* [n] what may be on one */
    size_t n;
    struct apc_sample *row; /* [3 n] */
    int choice, number;     /* who acts on its outputs; 0: it does */
    bool acts;              /* as long as nobody has said who does */
};

/* Of what a controller takes; @p of NULL: of all. ramps_free() in either case. Returns 0 or APC_ENOMEM. */
int ramps_init(struct ramps *ramps, const struct plant_view *plant, const struct loops_controller *of);
void ramps_free(struct ramps *ramps);
/* What is on its way has a rate above 0. Returns how many are, or the store's error. */
int ramps_read(struct ramps *ramps, struct apc_store *store);
/* How long it still takes, s. */
double ramp_to_go(const struct ramp *ramp);

/* Told of one that ended, "r: the ramp arrived at 50", or that the store refuses to move; and of each row that was
 * written. */
struct ramp_told {
    void *ctx;
    void (*say)(void *ctx, enum apc_event_severity severity, const char *text);
    void (*moved)(void *ctx, const struct apc_sample *row); /* NULL: nobody wants to know */
};
/* One look: move what is on its way; where the store refuses one the others go on. Returns how many are on their
 * way, or the error of a store that is away or cannot be read. */
int ramps_step(struct ramps *ramps, struct apc_store *store, struct apc_now now,
               const struct ramp_told *told);

/* ---- Log book -------------------------------------------------------------------------------- */

/*
 * What people enter, of kind "log", and with what they take over a shift, of kind "handover": events under their
 * names, beside those of what they write. An entry of a signal begins with its name: "y1: cleaned".
 */
#define LOGBOOK_TEXT 180 /* bytes of an entry; an event has little more room */

struct logbook_entry {
    const char *author;
    const char *signal; /* what it is of; "" or NULL: nothing certain */
    const char *text;
    bool signs; /* a handover */
};

/* Check it and make its event, but for the time. Returns 0, or an error with "variable" or "value". */
int logbook_make(const struct plant_view *plant, const struct logbook_entry *entry, struct apc_event *event,
                 struct change_fault *why);
/* Enter it now. What the same author has entered within a minute is not entered again: time is that one's then. @p
 * seen: UTC, the newest entry that whoever signs has read, and there is none that is newer; < 0: whatever there is.
 * Returns 1, 0: it is there already; or an error with "stale", "unknown" or "store". */
bool logbook_is_entry(const struct apc_event *event); /* or a handover */
int logbook_add(struct apc_store *store, apc_ns seen, struct apc_event *event, struct change_fault *why);

/* ---- Requests ------------------------------------------------------------------------------- */

/*
 * What people ask of a history, or at a broker, brought to the live store. A request is done once: the row
 * that it becomes and the mark that it has been done are one transaction of the live store, so whoever is
 * killed when, the mark says what the history was not told any more. The mark is a row of table opmode in one
 * of REQUESTS_MARKS places: value is the request's id, time is when it was asked for, origin the seq of the
 * row. It takes the place of the mark of the earliest time, so what was asked for later than that, and has no
 * mark, has not been done; of what is as early or earlier nobody knows. A database that comes back older asks
 * for what has been done, under the same id and time; or for something new, under an id that was given out
 * before, at a later time.
 *
 * What is too old, by the database's clock or by ours, what lies outside its limits, and what no controller
 * would take now, is not written: it would come into force when nobody expects it any more.
 */

#define REQUESTS_MARKS 64
/* Ids in table opmode of the marks, by who brings them. */
#define REQUESTS_OF_HISTORY (5 * 65536)
#define REQUESTS_OF_BROKER  (6 * 65536)

struct requests;

/* Where requests come from, and are answered: as apc_store_requests() and apc_store_answer(). */
struct requests_source {
    void *ctx;
    int (*give)(void *ctx, apc_request_fn fn, void *fn_ctx);
    int (*answer)(void *ctx, int64_t id, int64_t seq, const char *outcome);
    const char *(*error)(void *ctx);
    int marks;    /* the first of its REQUESTS_MARKS ids */
    apc_ns ahead; /* of our clock a request may be; 0: as much as it may be old */
};

/* Both stay the caller's and are nobody else's meanwhile. @p most is how old a request may become. Returns 0
 * or APC_ENOMEM. */
int requests_create(struct requests **requests, struct apc_store *live, struct apc_store *history,
                    apc_ns most, struct apc_error *why);
/* The same of another source. */
int requests_create_of(struct requests **requests, struct apc_store *live, const struct requests_source *from,
                       apc_ns most, struct apc_error *why);
void requests_destroy(struct requests *requests);
/* Bring what is new, and say what became of what is settled. Returns how many are still to be answered, or an
 * error after which it may be called again. */
int requests_step(struct requests *requests);
const char *requests_error(const struct requests *requests);

/* ---- Standby -------------------------------------------------------------------------------- */

/*
 * One that stands by for a controller: it follows the ticks that the other one stores, and takes its place
 * when none has come for two looks in a row, a look a period. So the other one may miss a tick, and has a
 * successor within three periods. Who had the place lives perhaps, and only hangs: he is fenced
 * (apc_store_seize()), so of what he still writes nothing is stored.
 */

struct standby {
    struct apc_sample *mine; /* what the place consists of; the last is the tick row */
    size_t n;
    apc_ns period;

    bool looked;
    apc_ns time; /* of the last look, monotonic */
    int64_t seq; /* that it found */
    unsigned missing;
    uint64_t holder; /* at the first look without a tick; 0: none, or the store numbers no claims */
};

/* Begin to follow. */
void standby_follow(struct standby *s);
/* One look, once a period. @p former as of apc_controller_former(). Returns 1: the place is ours, and former
 * has to be read once more; 0; or an error of the store's. */
int standby_look(struct standby *s, struct apc_store *store, struct apc_rows *former, apc_ns mono);

#endif
