/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller whose loops stand each by itself: one state, mode, hold and fault an output.
 *
 * core.c makes it and does a tick; facts.c takes what the shared data say and gathers the facts of each loop;
 * loop.c finds from them what the loop does; law.c asks the law; rows.c lays out what is read and written;
 * cascade.c has what loops above and below have to do with each other.
 */
#ifndef APC_MODULES_CORE_H
#define APC_MODULES_CORE_H

#include "control/control_internal.h"
#include "modules/modules_internal.h"

/** A setpoint, and within which limits it is taken. */
struct apc_core_setpoint {
    int id;
    double low, high;
    int above;           /**< id in table opmode of the loop above that moves it in Cas; 0: there is none */
    apc_ns above_period; /**< required with it: of that loop's controller */
};

/** An output of a controller: a loop. */
struct apc_core_loop {
    const char *name;    /**< for notices; NULL: its number; borrowed */
    int id;              /**< of the output, in table actuator, and of the operator's, in table manual */
    int mode;            /**< id in table opmode of its target mode */
    double low, high;    /**< limits; what goes out never leaves them */
    double rate;         /**< at most so many units a second; 0: as fast as it likes */
    double fault;        /**< what goes out when it was held too long */
    apc_ns hold;         /**< how long to hold before that; default 3 periods */
    int setpoint;        /**< id of the setpoint of a loop below that it moves; 0: an actuator */
    int below;           /**< with it: id in table opmode of that loop's target */
    int below_tick;      /**< with it: id of the tick row of that loop's controller */
    apc_ns below_period; /**< required with it: of that controller */
};

/** Zero means default, but for those marked required. */
struct apc_core_options {
    size_t size;
    int number;                /**< id of its tick row; default 1 */
    const struct apc_law *law; /**< required; borrowed */
    struct apc_dim dim;        /**< required */
    apc_ns period;             /**< required */
    apc_ns horizon;            /**< required: a measurement that did not change for so long is stale. Of the
                                  measurement's own rhythm, not the controller's: 3 periods of the client or of
                                  the plant, whichever is slower, + 100 ms */
    unsigned shed_after; /**< after so many ticks in a row without a good answer of the law a loop goes to
                            its fault value; default: as many as the longest hold has periods */
    const int *y, *d;    /**< [ny], [nd] ids in table sensor; NULL: 1, 2, ...; copied */
    const bool *spare;   /**< [ny] a law that is whole can do without it for a while; NULL: none; copied */
    const struct apc_core_setpoint *z; /**< [nz]; NULL: ids 1, 2, ... without limits; copied */
    const struct apc_core_loop *loop;  /**< [nu]; NULL: ids 1, 2, ... without limits; copied */
    int tuning;                        /**< id of the first tuning; the others follow; default 1 */
    size_t n_setting;
    const struct apc_setting *setting; /**< of the law; [n_setting]; not used after creation */
    const struct apc_law_plant *plant; /**< linear model for a law that wants one, or NULL; as setting */
    const struct apc_param *param; /**< [law->n_tuning] limits of the parameters, narrowed; NULL: the law's
                                      own; borrowed */
    const double *start; /**< [all of them] the tuning in force until the store has a good one; NULL: the
                            initial ones; copied */
};

struct apc_core;

int apc_core_create(struct apc_core **core, const struct apc_core_options *options, struct apc_error *why);
void apc_core_destroy(struct apc_core *core);
struct apc_rows *apc_core_in(struct apc_core *core);
struct apc_rows *apc_core_out(struct apc_core *core);
struct apc_rows *apc_core_former(struct apc_core *core);
int apc_core_resume(struct apc_core *core, apc_ns since);
int apc_core_compute(struct apc_core *core, struct apc_now now, uint64_t tick, bool have,
                     struct apc_notice *notice);
void apc_core_update(struct apc_core *core, int written);
uint64_t apc_core_failures(const struct apc_core *core);

/* ---- Inside ------------------------------------------------------------------------------- */

/** A loop, besides what apc_loop remembers. */
struct apc_core_state {
    struct apc_loop loop;
    struct apc_loop_facts facts;
    struct apc_loop_move move;
    enum apc_mode target, actual;
    apc_ns since;         /* when the law's output ceased to go out */
    int64_t seq;          /* of its newest output */
    bool there;           /* u holds an output */
    int64_t y_seq, z_seq; /* which the law made of these; 0: it did not */
    bool put;             /* the last tick wrote it */
    double wanted;        /* the operator's output, which the rate may keep u from */
    int setpoint;         /* number of the one that it is shown and judged by; -1: none */
    char trouble[144];    /* why there is no input, or no answer of the law */
};

/** What a loop sees of the one below, which has its output as its setpoint. */
struct apc_core_below {
    const struct apc_sample *rows; /* target; actual value of the setpoint */
    const struct apc_vector *tick; /* of the controller below */
    struct apc_freshness fresh;    /* of that */
    bool taken, invited;
};

/** What is seen of who moves a setpoint from above. */
struct apc_core_above {
    const struct apc_sample *mode; /* actual one of the loop above */
    struct apc_freshness fresh;    /* of the setpoint's row */
    size_t loop;                   /* whose setpoint it is */
    bool remote;
    bool put; /* the setpoint in force is to be written */
};

/** An instance of the law. */
struct apc_core_instance {
    bool begun;    /* x was filled, from a measurement or a former run's */
    bool gap;      /* x knows no recent y */
    bool updating; /* x goes on as soon as what went out acts */
    bool retuned;  /* trial is what it gives with the tuning before */
};

/** Fields of a tick row, in their order. */
enum apc_tick_field {
    APC_TICK_MARK,       /* of the dimensions; of the law: whose the row is */
    APC_TICK_INDEX,      /* of the tick on the controller's grid */
    APC_TICK_STATE,      /* [nu] enum apc_loop_state */
    APC_TICK_HELD,       /* [nu] s since holding began; -1: it does not hold */
    APC_TICK_POOR,       /* [nu] as in struct apc_loop */
    APC_TICK_LINKED,     /* [nu] as in struct apc_loop, */
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
    APC_TICK_Z,          /* [nz] those in force */
    APC_TICK_Z_SEQ,      /* [nz] */
    APC_TICK_TUNING,     /* [tuning] in force. From here on it is the law's */
    APC_TICK_TUNING_SEQ, /* [tuning] of the rows that were looked at */
    APC_TICK_BEGUN,      /* [instances] 0: there is no x yet */
    APC_TICK_GAP,        /* [instances] 1: x knows no recent y */
    APC_TICK_UPDATING,   /* [instances] 1: x goes on by an update with the y, z, d, u of this row */
    APC_TICK_X,          /* [states] */
    APC_TICK_FIELDS
};

struct apc_core {
    struct apc_instances *law;
    struct apc_instances_size size;
    bool whole;
    struct apc_dim dim;
    double Ts;
    apc_ns horizon, loss; /* an output older than loss the plant no longer follows */
    unsigned shed_after;
    double mark[2];                     /* whole numbers by which stored rows are known */
    const struct apc_param *param;      /* [law->n_tuning] */
    const struct apc_law *definition;   /* of the law */
    struct apc_core_setpoint *setpoint; /* [nz] */
    struct apc_core_loop *loop;         /* [nu] */
    struct apc_core_state *state;       /* [nu] */
    struct apc_core_instance *instance; /* [size.instances] */
    struct apc_core_below *below;       /* [nu] */
    struct apc_core_above *above;       /* [nz] */

    double *doubles;               /* all those below */
    double *y, *y_age, *z, *d, *x; /* last usable inputs; z, d [n_ahead] rows; the law's state */
    double *u, *last, *trial;      /* [nu] what goes out; what went out before, NaN: nothing; asked for */
    double *low, *high, *rate;     /* [nu] */
    double *y_low, *y_high;        /* [ny] */
    double *tuning, *offered;      /* [size.tuning] in force; wanted by the operator */
    double *force;                 /* [n_wanted] the value in force of what is wanted */
    double *published;
    int64_t *seqs;                  /* all those below */
    int64_t *y_seq, *d_seq, *z_seq; /* of the rows that the inputs come from */
    int64_t *looked;                /* [n_wanted] of the rows that were looked at; -1: none was yet */
    bool *flags;                    /* all those below */
    bool *y_new, *ok, *refused, *spare, *rests; /* [ny]; [ny + nd] y, d are usable; [n_wanted]; [ny]; [nz] */
    apc_status *y_status;                       /* [ny] */
    unsigned *limited,
        *blocked; /* [nu] enum apc_limited: of trial; how what takes the output cannot follow */
    enum apc_law_output *decides, *given; /* [nu] on each output; that the law decides on none */
    struct apc_freshness *fresh;          /* [ny + nd] */
    bool offer_ok;                        /* the law may have what is offered, all of it together */

    /* Wanted are setpoints, target modes, manual outputs, tunings, in this order, as in `in`. */
    size_t n_wanted;
    struct apc_sample *samples;       /* all those of in, out, former, and those below */
    struct apc_vector *vectors;       /* of in */
    struct apc_sample *actual, *told; /* [n_wanted] what became of it; what is written of that */
    struct apc_vector out_row, former_row;
    struct apc_rows in, out, former;
    double *row, *former_values;
    size_t offset[APC_TICK_FIELDS + 1]; /* of the fields in a tick row */
    int64_t seq;                        /* of the newest tick row */
    uint64_t index;
    double t;
    apc_ns since;         /* a manual output that is found at first counts if it is younger */
    apc_ns resumed_at;    /* of the tick row that was taken over, until that is settled; else 0 */
    bool adopts;          /* which tuning was in force then is not known */
    bool pending;         /* whether the last rows act is not known */
    size_t said, said_of; /* of so many loops the notice tells, of this one first */
    bool failed;          /* the law gave no usable output at this tick */
    uint64_t failures;    /* at so many ticks */
};

/* ---- facts.c */

/** Where what is wanted of a table begins in the arrays [n_wanted]. [tick] */
size_t apc_core_wanted(const struct apc_core *core, enum apc_table table);
/** Take the target modes and the tuning that are wanted. [tick] */
void apc_core_take_wanted(struct apc_core *core, struct apc_notice *notice);
/** The newest row of what loop @p i puts out, whoever wrote it. [tick] */
const struct apc_sample *apc_core_output(const struct apc_core *core, size_t i);
/** Take measurements, disturbances, setpoints; @p have: in was read. [tick] */
void apc_core_take_inputs(struct apc_core *core, struct apc_now now, bool have, struct apc_notice *notice);
/** Take the operator's output of loop @p i, if it is new. [tick] */
void apc_core_take_manual(struct apc_core *core, size_t i, apc_ns utc, struct apc_notice *notice);
/** Gather the facts of loop @p i, and its move, both with a usable answer of the law assumed. [tick] */
void apc_core_gather(struct apc_core *core, size_t i, bool have, struct apc_now now);
/** Say of everything that is wanted what became of it. [tick] */
void apc_core_confirm(struct apc_core *core);

/* ---- cascade.c */

/** How many samples and vectors are read of loops above and below. [setup] */
size_t apc_core_cascade_rows(const struct apc_core *core, size_t *vectors);
/** Name them, the samples from @p at on. [setup] */
void apc_core_name_cascade(struct apc_core *core, struct apc_sample *at);
/** May loop @p i be asked for Cas? [tick] */
bool apc_core_is_below(const struct apc_core *core, size_t i);
/** Look at what has output @p i as its setpoint, and what is in force there. [tick] */
void apc_core_look_below(struct apc_core *core, size_t i, struct apc_now now);
/** Look at who moves setpoint @p k. Returns whether its newest row is to be taken. [tick] */
bool apc_core_look_above(struct apc_core *core, size_t k, const struct apc_sample *newest,
                         struct apc_now now);
/** Setpoint @p k after it was taken, or was not. [tick] */
void apc_core_own_setpoint(struct apc_core *core, size_t k, const struct apc_sample *newest);
/** What setpoint @p k says to the loop above. [tick] */
apc_status apc_core_handshake(const struct apc_core *core, size_t k);

/* ---- law.c */

/** The tuning that is offered into force, without a bump. [tick] */
void apc_core_retune(struct apc_core *core);
/** Go on from the row that was taken over. [tick] */
void apc_core_settle(struct apc_core *core, struct apc_now now);
/** Instance @p k and its loops: moves, outputs. [tick] */
void apc_core_run(struct apc_core *core, size_t k, struct apc_now now, bool have, struct apc_notice *notice);
/** The law's x goes on. [tick] */
void apc_core_update_instance(struct apc_core *core, size_t k);

/* ---- rows.c */

/** Name, offset and length of a field of the tick row. False: there are no more. [any] */
bool apc_core_tick_field(const struct apc_core *core, size_t field, const char **name, size_t *offset,
                         size_t *length);
int apc_core_lay_out(struct apc_core *core, const struct apc_core_options *options, struct apc_error *why);
/** Fill out. [tick] */
void apc_core_put(struct apc_core *core, struct apc_now now);

/** Note what came to pass with loop @p i; when it is so with all, no loop is named. [tick] */
void apc_core_note(struct apc_core *core, size_t i, struct apc_notice *notice, enum apc_notice_kind kind,
                   const char *fmt, ...) APC_PRINTF(5, 6);

#endif
