/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Inside the controller, whose loops stand each by itself: one state, mode, hold and fault an output.
 *
 * controller.c makes it and does a tick; inputs.c takes what the shared data say and gathers the inputs of each
 * loop; loop.c finds from them what the loop does; law.c asks the law; rows.c lays out what is read and
 * written; cascade.c has what loops above and below have to do with each other; fast_path.c says of which loops a
 * tick need not ask all this again.
 */
#ifndef APC_MODULES_CONTROLLER_H
#define APC_MODULES_CONTROLLER_H

#include "control/control_internal.h"
#include "modules/modules_internal.h"

/** A loop, besides what apc_loop remembers. */
struct apc_controller_state {
    struct apc_loop_memory loop;
    struct apc_loop_inputs inputs;
    enum apc_loop_state from; /* move follows from it and the inputs; 0: it does not */
    struct apc_loop_move move;
    enum apc_mode target, actual;
    apc_ns since;           /* when the law's output ceased to go out */
    int64_t seq;            /* of its newest output */
    bool there;             /* u holds an output */
    bool put;               /* the last tick wrote it */
    double wanted;          /* the operator's output, which the rate may keep u from */
    double would;           /* what the law would put out, were this controller acting; NaN: nothing */
    int setpoint;           /* number of the one that it is shown and judged by; -1: none */
    struct apc_notice note; /* what it has to tell of this tick */
    char trouble[144];      /* why there is no input, or no answer of the law */
};

/** The controllers that may be the one above or below, and who is. */
struct apc_controller_group {
    struct apc_sample *choice; /* NULL: there is no other */
    int *number;               /* [n]; with choice */
    size_t n, now;             /* n: none of them */
};

/** What a loop sees of the one below, which has its output as its setpoint, or of who selects its signal. */
struct apc_controller_below {
    struct apc_controller_group who;
    struct apc_sample *target;  /* [who.n] of a setpoint's loop */
    struct apc_sample *actual;  /* value of the setpoint. Of a signal: what became of it */
    struct apc_vector *tick;    /* [who.n] of the controllers below */
    struct apc_freshness fresh; /* of that which acts */
    bool taken, invited;
    bool returned; /* what was selected came back: */
    double value;
};

/** A measurement of a law that selects, of which whoever calculates it is told what became. */
struct apc_controller_input {
    size_t y, loop;
};

/** What is seen of who moves a setpoint from above. */
struct apc_controller_above {
    struct apc_controller_group who;
    struct apc_sample *mode;    /* [who.n] actual one of the loop above */
    struct apc_freshness fresh; /* of the setpoint's row */
    size_t loop;                /* whose setpoint it is */
    bool remote;
    bool put; /* the setpoint in force is to be written */
};

/** An instance of a law. */
struct apc_controller_instance {
    bool begun;            /* x was filled, from a measurement or a former run's */
    bool gap;              /* x knows no recent y */
    bool updating;         /* x goes on as soon as what went out acts */
    bool retuned;          /* trial is what it gives with the tuning before */
    bool answered;         /* at this tick: what it publishes is of now */
    int result;            /* of its answer at this tick; -1: it was not asked */
    bool poor;             /* it was told that its answers are sub-optimal or late */
    unsigned good;         /* answers in a row */
    bool gone;             /* a replay: at this tick its process did not answer, or not well */
    char why[APC_LAW_WHY]; /* of the last one */
    char say[APC_LAW_SAY]; /* what it said, and nobody was told yet */
};

/** The law of a controller, or the one that acts in its place while it cannot. */
struct apc_controller_law {
    const struct apc_law *definition; /* NULL: there is none */
    struct apc_instances *instances;
    struct apc_instances_size size;
    const struct apc_param *param;            /* [definition->n_tuning] */
    size_t first;                             /* of its parameters, among those of both laws */
    struct apc_controller_instance *instance; /* [size.instances], and x to offered: those of both laws stand
                                                 one behind the other */
    double *x;                                /* [size.states] */
    double *tuning, *offered;                 /* [size.tuning] in force; wanted by the operator */
    double *published;                        /* NULL: nothing */
    double *trial;                            /* [nu] asked for */
    unsigned *limited;                        /* [nu] enum apc_limited, of trial */
    enum apc_law_output *decides;             /* [nu] on each output */
    struct apc_law_call call;                 /* what it is asked with */
    bool offer_ok;                            /* it may have what is offered, all of it together */
    bool offer_new;                           /* of the tuning a row is new at this tick */
};

/** Fields of a tick row, in their order. */
enum apc_tick_field {
    APC_TICK_MARK,       /* of the dimensions; of the law: whose the row is */
    APC_TICK_INDEX,      /* of the tick on the controller's grid */
    APC_TICK_STATE,      /* [nu] enum apc_loop_state */
    APC_TICK_HELD,       /* [nu] s since holding began; -1: it does not hold */
    APC_TICK_POOR,       /* [nu] as in struct apc_loop_memory */
    APC_TICK_LINKED,     /* [nu] as in struct apc_loop_memory, */
    APC_TICK_ASKED,      /* [nu] both */
    APC_TICK_U,          /* [nu] what goes out */
    APC_TICK_THERE,      /* [nu] 0: there is no u yet */
    APC_TICK_LAST,       /* [nu] what went out before it; u where nothing did */
    APC_TICK_BLOCKED,    /* [nu] enum apc_limited: how what takes it could not follow */
    APC_TICK_TARGET,     /* [nu] the wanted mode, the last one that was taken */
    APC_TICK_MANUAL,     /* [nu] where the operator wants it */
    APC_TICK_WANTED,     /* [nz + 2 nu] seqs of setpoints, targets, manual outputs that were looked at */
    APC_TICK_Y,          /* [ny] the last usable ones */
    APC_TICK_Y_SEQ,      /* [ny] */
    APC_TICK_Y_STATUS,   /* [ny] what else the law was told of each at this tick */
    APC_TICK_Y_AGE,      /* [ny] */
    APC_TICK_Y_NEW,      /* [ny] */
    APC_TICK_D,          /* [nd] */
    APC_TICK_D_SEQ,      /* [nd] */
    APC_TICK_D_STATUS,   /* [nd] Bad: it was not usable */
    APC_TICK_Z,          /* [nz] those in force */
    APC_TICK_Z_SEQ,      /* [nz] */
    APC_TICK_ABOVE,      /* [nz] seq of the actual mode of the loop above that was looked at; 0: none */
    APC_TICK_BELOW,      /* [4 nu] of an output that is a setpoint: seqs of its newest row, and of the loop
                            below its actual value, target, tick row; of a signal that is selected: of what
                            became of it, second, and of who told it the tick row, last */
    APC_TICK_PEER,       /* [nz, nu, nz] where controllers take turns: numbers of those above and below that
                            were seen to act, 0: there is no other; seqs of what another one told of the
                            setpoints */
    APC_TICK_TUNING,     /* [tuning] in force. From here on it is the law's, then the backup law's */
    APC_TICK_TUNING_SEQ, /* [tuning] of the rows that were looked at */
    APC_TICK_PLAN,       /* [nz] of a law that looks ahead: seq of the plan that was looked at */
    APC_TICK_PLANNED,    /* [nz] likewise: 1: it is that of the setpoint in force, and told what is to come */
    APC_TICK_BEGUN,      /* [instances] 0: there is no x yet */
    APC_TICK_GAP,        /* [instances] 1: x knows no recent y */
    APC_TICK_UPDATING,   /* [instances] 1: x goes on by an update with the y, z, d, u of this row */
    APC_TICK_RESULT,     /* [instances] enum apc_law_result of the answer; -1: it was not asked */
    APC_TICK_X,          /* [states] */
    APC_TICK_FIELDS
};
/** Element of APC_TICK_INDEX, in the row of any controller. */
#define APC_TICK_INDEX_AT 2

struct apc_controller {
    struct apc_controller_law law, backup;
    struct apc_instances_size size; /* of both together */
    struct apc_dim dim;
    double Ts;
    double budget;   /* s that compute is given */
    bool real_time;  /* mono is the system's */
    apc_ns deadline; /* the budget's end at this tick; 0: virtual time */
    apc_ns loss;     /* an output older than that the plant no longer follows */
    unsigned shed_after;
    double mark[2];                           /* whole numbers by which stored rows are known */
    struct apc_controller_setpoint *setpoint; /* [nz] */
    struct apc_controller_loop *loop;         /* [nu] */
    struct apc_controller_state *state;       /* [nu] */
    struct apc_controller_instance *instance; /* [size.instances] */
    struct apc_controller_below *below;       /* [nu] */
    struct apc_controller_above *above;       /* [nz] */

    void *memory;                  /* of the arrays above and below, but for what rows.c and cascade.c make */
    double *y, *y_age, *z, *d, *x; /* last usable inputs; z, d [n_ahead] rows; the laws' state */
    double *u, *last;              /* [nu] what goes out; what went out before, NaN: nothing */
    double *went;                  /* [nu] u, or what was selected instead of it */
    double *low, *high, *rate;     /* [nu] */
    double *y_low, *y_high;        /* [ny] */
    double *tuning, *offered;      /* [size.tuning] in force; wanted by the operator */
    int64_t *y_seq, *d_seq, *z_seq; /* of the rows that the inputs come from */
    int64_t *plan_seq;              /* [nz] */
    int64_t *looked;                /* [n_wanted] of the rows that were looked at; -1: none was yet */
    bool *y_new, *ok, *refused, *rests,
        *planned;                /* [ny]; [ny + nd] y, d are usable; [n_wanted]; [nz]; [nz] */
    bool *fast_path;             /* [nu] as fast_path.c says */
    bool *open;                  /* [nz] something may have to be taken, or told, of the setpoint */
    apc_status *y_status;        /* [ny] */
    unsigned *blocked;           /* [nu] of enum apc_limited: how what takes the output cannot follow, */
    unsigned *y_limited;         /* [ny] how a measurement cannot move an output */
    enum apc_law_output *given;  /* [nu] that a law decides on none */
    struct apc_freshness *fresh; /* [ny + nd] */
    apc_ns *horizon;             /* [ny + nd] */

    /* Wanted are setpoints, target modes, manual outputs, tunings, in this order, as in `in`. */
    size_t n_wanted;
    struct apc_sample *samples;         /* all those of in, out, former, and those below */
    struct apc_vector *vectors;         /* of in, and of out */
    struct apc_controller_input *input; /* [n_inputs], of [ny] */
    size_t n_inputs;
    size_t n_actual;                  /* n_wanted + n_inputs */
    struct apc_sample *actual, *told; /* [n_actual] what became of it; what is written of that */
    bool untold;                      /* of the tuning something may have to be written */
    bool telling;                     /* told is not what actual is: rows were put since */
    bool looking;                     /* of setpoints, modes, manual outputs the tick row has not all */
    struct apc_vector *out_row;       /* first of out */
    struct apc_vector former_row;
    int estimate, prediction;  /* ids of the first of what the law publishes; 0: it is not written */
    int output;                /* id of the first output in table estimate; likewise */
    struct apc_sample *choice; /* the switch that says who acts, and [nz + n_inputs] what whoever acts
                                  tells of setpoints and inputs; NULL: this one does */
    int *numbers;              /* all those of groups */
    bool shadow;               /* not while nobody set it */
    bool claimed, acting;      /* the outputs are; at this tick */
    bool cascaded, selected;   /* it has loops above or below; signals of which is told what became of them */
    struct apc_rows in, out, former;
    double *row, *former_values;
    struct apc_vector *plan;            /* [nz] of in; NULL: no law looks ahead */
    double *plan_values;                /* [nz * 2 APC_PLAN_PAIRS] */
    size_t offset[APC_TICK_FIELDS + 1]; /* of the fields in a tick row */
    int64_t seq;                        /* of the newest tick row */
    uint64_t index;
    double t;
    apc_ns since;           /* a manual output that is found at first counts if it is younger */
    apc_ns resumed_at;      /* of the tick row that was taken over, until that is settled; else 0 */
    bool pending;           /* whether the last rows act is not known */
    bool awaits;            /* they do, and laws go on as soon as it is read what was selected */
    size_t said, said_of;   /* of so many loops the notice tells, of this one first */
    struct apc_notice note; /* of this tick, what is no loop's */
    size_t heard;           /* so many loops were asked for what else they have to tell */
    bool failed;            /* the law gave no usable output at this tick */
    uint64_t failures;      /* at so many ticks */
};

/* ---- inputs.c */

/** Where what is wanted of a table begins in the arrays [n_wanted]. [tick] */
static inline size_t apc_controller_wanted(const struct apc_controller *controller, enum apc_table table)
{
    const size_t mode = controller->dim.nz, manual = mode + controller->dim.nu,
                 tuning = manual + controller->dim.nu;

    return table == APC_SETPOINT ? 0 : table == APC_OPMODE ? mode : table == APC_MANUAL ? manual : tuning;
}
/** Take the target modes and the tuning that are wanted. [tick] */
void apc_controller_take_wanted(struct apc_controller *controller, struct apc_notice *notice);
/** The newest row of what loop @p i puts out, whoever wrote it. [tick] */
static inline const struct apc_sample *apc_controller_output(const struct apc_controller *controller,
                                                             size_t i)
{
    return &controller->in.sample[controller->dim.ny + controller->dim.nd + controller->n_wanted + i];
}
/** Whose tuning number @p i is, of all. [tick] */
static inline struct apc_controller_law *apc_controller_tuned(struct apc_controller *controller, size_t i)
{
    return i < controller->backup.first ? &controller->law : &controller->backup;
}
/** Take measurements, disturbances, setpoints; @p have: in was read. [tick] */
void apc_controller_take_inputs(struct apc_controller *controller, struct apc_now now, bool have,
                                struct apc_notice *notice);
/** The plans that the row which was taken over was made with, where they are the newest still. [tick] */
void apc_controller_recall_plans(struct apc_controller *controller);
/** Take the operator's output of loop @p i, if it is new. [tick] */
void apc_controller_take_manual(struct apc_controller *controller, size_t i, apc_ns utc,
                                struct apc_notice *notice);
/** Find whether this controller acts. [tick] */
void apc_controller_take_choice(struct apc_controller *controller);
/** Of table actual, what stands there is what was told. */
void apc_controller_take_told(struct apc_controller *controller, size_t k, const struct apc_sample *newest);
/** Gather the inputs of loop @p i, and its move, both with a usable answer of the law assumed. [tick] */
void apc_controller_gather(struct apc_controller *controller, size_t i, bool have, struct apc_now now);
/* @p mono of a punctual tick, counted from where loop @p i began to hold. */
apc_ns apc_controller_punctual(const struct apc_controller *controller, size_t i, apc_ns mono);
/** Say of everything that is wanted what became of it. [tick] */
void apc_controller_confirm(struct apc_controller *controller);

/* ---- cascade.c */

/** How many samples and vectors are read of loops above and below. [setup] */
size_t apc_controller_cascade_rows(const struct apc_controller *controller, size_t *vectors);
/** Name them, the samples from @p at on. Returns 0 or APC_ENOMEM. [setup] */
int apc_controller_name_cascade(struct apc_controller *controller, struct apc_sample *at);
/** Find who of the group acts. Returns whether that is another one than before. [tick] */
bool apc_controller_find_acting(struct apc_controller_group *group);
/** May loop @p i be asked for Cas? [tick] */
bool apc_controller_is_below(const struct apc_controller *controller, size_t i);
/** Look at what has output @p i as its setpoint, and what is in force there. [tick] */
void apc_controller_look_below(struct apc_controller *controller, size_t i, struct apc_now now);
/** Something else is in force than what loop @p i put: the law goes on from that. [tick] */
void apc_controller_find_in_force(struct apc_controller *controller, size_t i, double value);
/** Look at who moves setpoint @p k. Returns whether its newest row is to be taken. [tick] */
bool apc_controller_look_above(struct apc_controller *controller, size_t k, const struct apc_sample *newest,
                               struct apc_now now);
/** Setpoint @p k after it was taken, or was not. [tick] */
void apc_controller_own_setpoint(struct apc_controller *controller, size_t k,
                                 const struct apc_sample *newest);
/** What setpoint @p k says to the loop above. [tick] */
apc_status apc_controller_handshake(const struct apc_controller *controller, size_t k);

/* ---- selector_feedback.c */

/** Find the measurements of which who calculates them is told; @p told as in the options. Returns how many.
 * [setup] */
size_t apc_controller_find_inputs(struct apc_controller *controller, const bool *told);
/** Say what became of them. [tick] */
void apc_controller_tell_inputs(struct apc_controller *controller);
/** Look what became of the own signals. [tick] */
void apc_controller_look_at_selected(struct apc_controller *controller, bool have, struct apc_now now);
/** Is output @p i a signal of which is told what became of it? [tick] */
static inline bool apc_controller_is_selected(const struct apc_controller *controller, size_t i)
{
    return controller->loop[i].signal && controller->loop[i].below_tick;
}

/* ---- fast_path.c */

/** At the next tick no loop is on the fast path, and every setpoint open. [any] */
void apc_controller_stir(struct apc_controller *controller);
/** Find which loops stay on the fast path, with all rows taken. [tick] */
void apc_controller_keep_fast_path(struct apc_controller *controller);
/** Find, at the end of a tick, which loops are on it from now on. [tick] */
void apc_controller_leave_fast_path(struct apc_controller *controller);

/* ---- law.c */

/** What the laws are asked with, once all is allocated. [setup] */
void apc_controller_lay_out_calls(struct apc_controller *controller);
/** All calls are of the tick that the controller is at now. [tick] */
void apc_controller_date_calls(struct apc_controller *controller);
/** The tuning that is offered into force, without a bump. [tick] */
void apc_controller_retune(struct apc_controller *controller);
/** Go on from the row that was taken over. [tick] */
void apc_controller_settle(struct apc_controller *controller, struct apc_now now);
/** Ask the laws; with that the loops have their moves and outputs. [tick] */
void apc_controller_run(struct apc_controller *controller, struct apc_now now, bool have,
                        struct apc_notice *notice);
/** The laws' x goes on; @p selected: also of those that wait for what was selected of their outputs. [tick] */
void apc_controller_update_laws(struct apc_controller *controller, bool selected);

/* ---- rows.c */

int apc_controller_lay_out(struct apc_controller *controller, const struct apc_controller_options *options,
                           struct apc_error *why);
/** Good, with OPC UA's limit bits for enum apc_limited. [tick] */
apc_status apc_controller_limited(unsigned limited);
/** Does what was told say what became of number @p k of what is wanted, or is there nothing to tell? [tick] */
bool apc_controller_is_quiet(const struct apc_controller *controller, size_t k);
/** Fill out. [tick] */
void apc_controller_put(struct apc_controller *controller, struct apc_now now);

/** Note what came to pass with loop @p i; when it is so with all, no loop is named. [tick] */
void apc_controller_note_refused(struct apc_controller *controller, struct apc_notice *notice,
                                 const char *text);
void apc_controller_note(struct apc_controller *controller, size_t i, struct apc_notice *notice,
                         enum apc_notice_kind kind, const char *fmt, ...) APC_PRINTF(5, 6);

#endif
