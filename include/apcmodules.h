/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcmodules.h
 * The cores of the modules: scheduler, plant server, client, controller. A core is given the time and
 * its inputs and gives back its outputs. It reads no clock, opens no socket, talks to no store, and
 * allocates nothing after it was made: the same core runs in real time and in virtual time. Waiting
 * and input/output belong to the shell around it. A core is used by one thread at a time.
 *
 * Where ticks coincide the order is: scheduler, plant, client, controller.
 */
#ifndef APCMODULES_H
#define APCMODULES_H

#include "apcbase.h"
#include "apccontrol.h"
#include "apcplant.h"
#include "apcsockets.h"
#include "apctimer.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The two times of an instant: durations and deadlines by mono, records by utc. */
struct apc_now {
    apc_ns mono, utc;
};

/** The events of a tick, for the shell to log and to record. */
struct apc_notice {
    enum apc_notice_kind {
        APC_NOTICE_NONE = 0,
        APC_NOTICE_MODE,      /**< the actual mode changed */
        APC_NOTICE_HOLD,      /**< measurement stale or Bad: output held */
        APC_NOTICE_FAULT,     /**< held too long: fault value */
        APC_NOTICE_FAILED,    /**< the plant cannot be computed: its measurements are Bad */
        APC_NOTICE_RECOVERED, /**< measurement good again, after any of these three */
        APC_NOTICE_TRIP,      /**< the plant's watchdog went to the safe value */
        APC_NOTICE_RESUMED,   /**< the plant takes commands again */
        APC_NOTICE_REJECTED,  /**< a value that must not reach the plant was kept out */
        APC_NOTICE_RIVALS,    /**< two clients command the plant and take it from each other */
        APC_NOTICE_POOR,      /**< the law's answers are usable, but not what is wanted; or good again */
        APC_NOTICE_SAID,      /**< what the law says for itself */
        APC_NOTICE_FENCED,    /**< a client commands that another one has taken the place of */
        APC_NOTICE_CLOCK      /**< who commands has a claim ahead of the plant's clock */
    } kind;
    char text[160];
};

/* ---- Freshness ---------------------------------------------------------------------------- */

/**
 * Is a variable still being written? Judged by its seq (or stamp) changing, on the monotonic clock, so
 * that a clock step makes nothing look old or new. For the very first look the age by UTC decides.
 */
struct apc_freshness {
    int64_t mark;   /**< seq, or stamp, last seen */
    apc_ns changed; /**< mono when it changed */
    apc_ns looked;  /**< mono of the last look, where it is dated */
    bool seen;
};
/** Look at a sample's @p mark (0: there is no sample) and its source time; true when fresh. [tick] */
APC_API bool apc_freshness_look(struct apc_freshness *f, int64_t mark, apc_ns source_time, struct apc_now now,
                                apc_ns horizon);
/**
 * The same for rows whose time stamp says when they were written, as those of another controller. A new row
 * counts from that time, if it lies between two looks. So a row that was written just after a rare look is
 * not taken for new at the next one. [tick]
 */
APC_API bool apc_freshness_dated(struct apc_freshness *f, int64_t mark, apc_ns written, struct apc_now now,
                                 apc_ns horizon);

/* ---- Source times -------------------------------------------------------------------------- */

/** Is the clock right that a plant dates its measurements by? Zeroed: nothing was seen. */
struct apc_dating {
    bool seen, wrong;
    unsigned looks;      /**< samples in a row for which it was wrong */
    apc_ns time, looked; /**< source time last seen, and when */
    apc_ns off;          /**< by how much it was off then: ahead is positive */
};
/** So many in a row are the plant's fault. For fewer, this computer's own clock may have been stepped. */
#define APC_DATING_SURE 3
#define APC_DATING_OFF  (10 * APC_NS_PER_S)                         /**< what is no further off is right */
#define APC_DATING_FAR  (INT64_C(100) * 366 * 86400 * APC_NS_PER_S) /**< as far off as is told */
/**
 * Look at a sample that is new, of source @p time, at @p now; the run began at @p since (0: it is not known),
 * all UTC. Returns the time for the record: the source's, or that of arrival where the clock is wrong or the
 * sample is from before the run. The latter happens where a plant gives the time of a value's last change.
 * [tick]
 */
APC_API apc_ns apc_dating_look(struct apc_dating *dating, apc_ns time, apc_ns now, apc_ns since);

/* ---- Watchdog ------------------------------------------------------------------------------ */

/**
 * Is a plant commanded? It is as long as commands come, and new ones among them. One who repeats a command
 * keeps the link alive, but is no sign of life of the controller. Zeroed but for the limits: it never was.
 */
struct apc_watchdog {
    apc_ns link;     /**< without a command for longer it trips, ... */
    apc_ns command;  /**< ... and without a new one */
    bool commanded;  /**< there is a command that has not run out */
    bool ever;       /**< there was one; then: */
    apc_ns stamp;    /**< of the newest */
    apc_ns given;    /**< mono of the last */
    apc_ns changed;  /**< mono of the last with a new stamp */
    apc_ns deadline; /**< mono: when it will trip, if none comes */
    apc_ns tripped;  /**< mono: when it did so last */
};
/** Set the limits: 3 periods + 100 ms, of the client and of the controller. [setup] */
APC_API struct apc_watchdog apc_watchdog_make(apc_ns link_period, apc_ns command_period);
/** A command has come, known by its @p stamp. It ends a trip only when that is a new one. [tick] */
APC_API void apc_watchdog_take(struct apc_watchdog *watchdog, apc_ns mono, apc_ns stamp);
/** To be asked before anything else: true when it has tripped since the last look, at its deadline. [tick] */
APC_API bool apc_watchdog_trips(struct apc_watchdog *watchdog, apc_ns mono);

/* ---- Scheduler ---------------------------------------------------------------------------- */

/** A setpoint that it moves. */
struct apc_scheduler_setpoint {
    const char *name; /**< as people call it; borrowed */
    int id;           /**< in table setpoint */
    int owner;        /**< in table opmode: 0 Local, the operator moves it; 1 Remote, as without a row */
};

struct apc_scheduler_options {
    size_t size;
    size_t nz;                              /**< required: setpoints */
    const struct apc_scheduler_setpoint *z; /**< [nz] required; copied */
    size_t steps;                           /**< required: length of the sequence */
    const double *sequence;                 /**< [steps * nz] required: step after step; borrowed */
    apc_ns period;                          /**< required: from step to step */
    bool repeat;                            /**< begin again after the last step, or keep it */
};

struct apc_scheduler;

/** A plan, a vector of table apc_table APC_PLAN, has so many pairs at most: seconds from its time on, rising,
 * and the value from then on. The first is 0 and the value of the setpoint's row of the same seq and time,
 * whose plan it is. */
#define APC_PLAN_PAIRS 128

/** Returns 0, APC_EINVAL or APC_ENOMEM, with a text in why. [setup] */
APC_API int apc_scheduler_create(struct apc_scheduler **scheduler,
                                 const struct apc_scheduler_options *options, struct apc_error *why);
APC_API void apc_scheduler_destroy(struct apc_scheduler *scheduler); /**< NULL is legal. [setup] */

/** The rows that it reads and those that it writes: one snapshot before each compute, one append after it.
 * They live as long as the scheduler. [any] */
APC_API struct apc_rows *apc_scheduler_in(struct apc_scheduler *scheduler);
APC_API struct apc_rows *apc_scheduler_out(struct apc_scheduler *scheduler); /**< Likewise. [any] */

/** Begin in the middle of a step that began at @p since. Rows written since then are not written again, but
 * for those that gave the setpoint back. After in was read, before the first compute. [setup] */
APC_API void apc_scheduler_resume(struct apc_scheduler *scheduler, uint64_t step, apc_ns since);

/**
 * Fill out with the rows due in step number @p step of the grid, @p age after it began. These are the missing
 * steps of the setpoints that are Remote, each with its plan. Each says the newest row that was read, so that
 * it is left out if another write was faster. The notice reports once which became Local or Remote. Called at
 * each step, and in between to see whether the owner changed. Returns how many setpoints. [tick]
 */
APC_API int apc_scheduler_compute(struct apc_scheduler *scheduler, struct apc_now now, uint64_t step,
                                  apc_ns age, struct apc_notice *notice);
/** The outcome of out: @p stored, with the seqs of its rows. Returns false if something is still due: another
 * write was faster, or nothing was stored. Then read and compute again. [tick] */
APC_API bool apc_scheduler_update(struct apc_scheduler *scheduler, bool stored);

/* ---- Plant server ------------------------------------------------------------------------- */

/** What may go wrong with a sensor. Times are since the plant's first tick. */
struct apc_sensor_fault {
    enum apc_sensor_fault_kind {
        APC_FAULT_STUCK = 1, /**< it keeps its last value */
        APC_FAULT_DRIFT,     /**< size is added for each second since it began */
        APC_FAULT_DROPOUT,   /**< Bad */
        APC_FAULT_SPIKE,     /**< size is added */
        APC_FAULT_BIAS,      /**< size is added as long as it lasts */
        APC_FAULT_NOISE,     /**< a normal error of standard deviation size is added, drawn at each look */
        APC_FAULT_FROZEN     /**< what it shows has the time at which it began */
    } kind;
    apc_ns at, duration; /**< duration 0: for ever; a spike, however short, is seen at one tick at least */
    double size;
};

/** How a sensor shows an output: value + noise + faults, rounded to its steps. Zeros: as it is. */
struct apc_sensor {
    apc_ns period;  /**< how often it looks, from the plant's first tick on, as a laboratory does: in between
                       its  last value stands, with the time of that; 0: at each tick */
    double noise;   /**< standard deviation of a normal error, drawn at each look */
    double quantum; /**< the step between two values that it can show; 0: none */
    const struct apc_sensor_fault *fault; /**< [n_faults]; borrowed */
    size_t n_faults;
};

/** What may go wrong with an actuator, as sensors' faults do. Each makes of the command where the actuator
 * stands from a tick on; of several in the list, each takes what the one before it made. */
struct apc_actuator_fault {
    enum apc_actuator_fault_kind {
        APC_ACTUATOR_STUCK = 1,  /**< stays where it was */
        APC_ACTUATOR_STICTION,   /**< sticks within (size + jump) / 2 of where it is; beyond, it slips */
        APC_ACTUATOR_BACKLASH,   /**< of width size */
        APC_ACTUATOR_RATE,       /**< goes no faster than size in 1 s */
        APC_ACTUATOR_SATURATION, /**< goes no farther than low and high */
        APC_ACTUATOR_REVERSE,    /**< goes the wrong way: low is high */
        APC_ACTUATOR_POWER       /**< has none: goes to low, its safe position */
    } kind;
    apc_ns at, duration; /**< duration 0: for ever */
    double size, jump;   /**< units of the input; of stiction: deadband and stickband together, slip jump */
    double low, high;
};

struct apc_actuator {
    const struct apc_actuator_fault *fault; /**< [n_faults]; borrowed */
    size_t n_faults;
};

/** From @p at on, since the plant's first tick, disturbance @p k, from 0, is @p value. */
struct apc_disturbance {
    size_t k;
    apc_ns at;
    double value;
};

/** Zero means default, but for those marked required. */
struct apc_plantserver_options {
    size_t size;
    struct apc_plant *plant;       /**< required; borrowed */
    const struct apc_model *model; /**< required; borrowed */
    const double *safe;            /**< [nu] value without a fresh command; NULL: zeros; copied */
    const double *low, *high;      /**< [nu] limits of the inputs; NULL: none; copied */
    apc_ns link_period;    /**< required: of the client. Trips 3 of them + 100 ms after the last frame */
    apc_ns command_period; /**< required: of the controller. Trips 3 of them + 100 ms after the last new
                              command */
    uint64_t seed;         /**< of all noise: the same seed, the same numbers */
    const double *noise;   /**< [nx] process noise: standard deviation of a random walk in 1 s,
                              added to each state at each tick; NULL: none; copied */
    const struct apc_disturbance *disturbance; /**< [n_disturbances] by rising time; borrowed */
    size_t n_disturbances;
    const struct apc_sensor *sensor; /**< [ny]; NULL: ideal ones; borrowed */
    const double *initial; /**< [nu] input at the first tick, of a plant that is running already: until a
                              command comes or the watchdog trips; NULL: the safe value; copied */
    const struct apc_actuator *actuator; /**< [nu]; NULL: ideal ones; borrowed */
};
struct apc_plantserver;

/** [setup] Returns 0, APC_EINVAL (an option that makes no sense), APC_ENOMEM. */
APC_API int apc_plantserver_create(struct apc_plantserver **server,
                                   const struct apc_plantserver_options *options, struct apc_error *why);
APC_API void apc_plantserver_destroy(struct apc_plantserver *server); /**< NULL is legal. [setup] */
/** From now on noise, disturbances, sensors and actuators are those of @p options; its other members are
 * ignored. Disturbances of the past, and the seed, are ignored too. [setup] Returns 0 or APC_EINVAL; then
 * nothing has changed. */
APC_API int apc_plantserver_change(struct apc_plantserver *server,
                                   const struct apc_plantserver_options *options, struct apc_error *why);
/**
 * Advance the plant to @p now, the scheduled time of the tick, with the input that was sampled at the
 * previous one. Within the interval the safe value acts from the watchdog's instant on, and disturbances
 * change at their very instants. Then publish y as the sensors show it, and sample the input for the next
 * interval. Returns 0 or APC_ESOLVER, then y is Bad; the notice says so once, and once that it is over.
 * [tick]
 */
APC_API int apc_plantserver_tick(struct apc_plantserver *server, struct apc_now now,
                                 struct apc_notice *notice);
/**
 * Answer one request of connection @p connection: take the command, reply with the newest y. A command is
 * refused as a whole when its count is wrong. A value that is Bad, not finite or outside the limits never
 * reaches the plant; the notice tells of the first such command since one was accepted. A connection older
 * than the newest that sent a command may only query. The notice tells of one that commands nevertheless,
 * once a minute while that continues. Returns the reply's length, or APC_EPROTO, APC_EPERM: close the
 * connection. [tick]
 */
APC_API int apc_plantserver_request(struct apc_plantserver *server, struct apc_now now, uint64_t connection,
                                    const char *request, size_t length, char *reply, size_t size,
                                    struct apc_notice *notice);
/** Its watchdog: when it tripped, which may lie before the call that told of it. [any] */
APC_API const struct apc_watchdog *apc_plantserver_watchdog(const struct apc_plantserver *server);
/** The newest connection that sent a command; 0: none yet. [any] */
APC_API uint64_t apc_plantserver_commander(const struct apc_plantserver *server);
/** The present command to the plant's actuators: [nu]; true when it is the safe value. [tick] */
APC_API bool apc_plantserver_input(const struct apc_plantserver *server, double *u);
/** The plant's own outputs, before its sensors, at the last tick at which it could be solved: [ny], the
 * server's memory. [tick] */
APC_API const double *apc_plantserver_output(const struct apc_plantserver *server);
/** The oldest source time, UTC, of the present measurements; 0: some have not been taken yet. No later reply
 * has an older one, unless the clock steps back. [tick] */
APC_API apc_ns apc_plantserver_oldest(const struct apc_plantserver *server);

/* ---- Client ------------------------------------------------------------------------------- */

struct apc_client_options {
    size_t size;
    size_t ny, nu;         /**< required */
    apc_ns command_period; /**< required: of the controller. A command older than 3 of them + 100 ms is not
                              sent */
    const int64_t *last;   /**< [ny] newest seq of each sensor; NULL: zeros; copied */
    apc_ns since; /**< UTC at which this run began; a command that the client finds at its start with an
                     earlier source time is a former run's and is not sent, until a new one comes */
    /** [ny] What each sensor can show; NULL, or infinite: anything. A measurement is BadOutOfRange when it is
     * beyond by 2.5 % of the span below, or by 6.25 % above (3.6 and 21 mA of 4 to 20), until it is back
     * within 1.25 % and 3.125 %. Where one end is infinite, any excess at the other one counts. Copied. */
    const double *low, *high;
    /** [ny] for measurements that come seldom, from a plant that may give each reading a time of its own. The
     * same value with the same status is a new sample only when it is this much later; NULL, 0: always.
     * Copied.
     */
    const apc_ns *apart;
};
struct apc_client;

/** [setup] Returns 0, APC_EINVAL (an option that makes no sense), APC_ENOMEM. */
APC_API int apc_client_create(struct apc_client **client, const struct apc_client_options *options,
                              struct apc_error *why);
APC_API void apc_client_destroy(struct apc_client *client); /**< NULL is legal. [setup] */
/**
 * The command for the plant: the newest actuator samples @p u [nu] into @p out [nu]. One is Bad there where
 * it must not be written: it is missing, Bad itself, not finite, or no longer fresh. @p u is NULL when the
 * store could not be read: then all are Bad. Returns how many are to be written. [tick]
 */
APC_API size_t apc_client_command(struct apc_client *client, struct apc_now now, const struct apc_sample *u,
                                  struct apc_value *out);
/**
 * Of what the plant answered, @p y [ny], the sensor samples for the store: those whose source time, value or
 * status is new, with the next seq. A reading with the same time, value and status has not been sampled since. Returns
 * how many went into @p out [ny]. [tick]
 */
APC_API size_t apc_client_measurements(struct apc_client *client, const struct apc_value *y,
                                       struct apc_sample *out);
/** Was measurement @p i, from 0, beyond its range when it was last new, and is it Bad for that? [tick] */
APC_API bool apc_client_outside(const struct apc_client *client, size_t i);

/* ---- The state of a loop ------------------------------------------------------------------ */

/**
 * A loop is one output with what belongs to it. It is in one of these states, and docs/modes.md says which
 * when. The numbers stand in tick rows.
 */
enum apc_loop_state {
    APC_LOOP_OOS = 1, /**< out of service: nothing goes out */
    APC_LOOP_MAN,     /**< the operator's output */
    APC_LOOP_AUTO,    /**< the law's, by the loop's own setpoint */
    APC_LOOP_CAS,     /**< the law's, by the setpoint of a controller above */
    APC_LOOP_INIT,    /**< the loop below does not take the output: initialises to its setpoint */
    APC_LOOP_HOLD,    /**< no input or no answer of the law: the last output */
    APC_LOOP_BACKUP,  /**< for too long: the backup law's */
    APC_LOOP_FAULT,   /**< for too long: the fault value */
    APC_LOOP_SHADOW,  /**< another controller acts; this one goes along */
    APC_LOOP_END
};

/** What is the case at a tick. */
struct apc_loop_inputs {
    enum apc_mode target; /**< the wanted mode: Man, Auto or Cas; any other is OOS */
    bool acting;          /**< this controller acts on the output, and has claimed it */
    bool setpoint;        /**< the output is the setpoint of another loop, below; else it is an actuator */
    bool taken;           /**< what it goes to takes it; an actuator always does */
    bool invited;         /**< not taken, but the loop below asks to be initialised */
    bool input;           /**< measurements are usable and fresh, and there is a setpoint of any age */
    bool law;             /**< the law's answer is usable: good, suboptimal or late */
    bool expired;         /**< held, or without good answers, for too long */
    bool backup;          /**< there is a backup law, and its inputs are usable or, in Backup, were lately */
    bool bare;            /**< it has no input, or gave no usable answer, at this tick */
    bool remote;          /**< the setpoint is a controller's above, which is alive and was initialised */
};

/** What goes out, within limits and rates but for the fault value. */
enum apc_loop_output {
    APC_PUT_NONE = 0, /**< nothing is written; what acts is the row that is in force */
    APC_PUT_LAW,
    APC_PUT_OPERATOR, /**< the operator's, else the last one */
    APC_PUT_LAST,     /**< where none ever went out: none */
    APC_PUT_FAULT,    /**< the fault value */
    APC_PUT_BACKUP,   /**< the backup law's */
    APC_PUT_BELOW     /**< the setpoint that is in force in the loop below */
};

/** What a law is asked to do; together, in this order. */
enum apc_loop_ask {
    APC_ASK_TRACK_FIRST = 1, /**< before it computes: track what went out last */
    APC_ASK_COMPUTE = 2,     /**< also where its answer does not go out, but is published */
    APC_ASK_TRACK = 4,       /**< what really goes out */
    APC_ASK_UPDATE = 8,
    APC_ASK_PREDICT = 16 /**< it rests, but for a law that estimates: it updates without the measurement */
};

/** What a loop does at a tick. */
struct apc_loop_move {
    enum apc_loop_state state;
    enum apc_mode actual;
    enum apc_loop_output output;
    unsigned law, backup; /**< enum apc_loop_ask, of the law and of the backup law; 0: it rests */
    apc_status status;    /**< of the output's row, where one is written; the law's with its limit bits */
    const char *reason;   /**< why the loop is not as wanted; NULL: it is. Static */
};

/**
 * The move of a loop that was in @p state (0 or any other number: in none yet). Total, pure, and settled in
 * one step: with the same inputs the new state stays. The answer of a law that was not asked yet is assumed to
 * be usable. When it is not, ask again from the same @p state with law false, and do what that move says, but
 * do not compute once more. [tick]
 */
APC_API struct apc_loop_move apc_loop_next(enum apc_loop_state state, const struct apc_loop_inputs *inputs);

/* ---- Controller --------------------------------------------------------------------------- */

/** A controller that may act in the place of another one, which has the same outputs. */
struct apc_controller_peer {
    int number; /**< its own: the value of the switch, and id of its tick row */
    int mode;   /**< id in table opmode of its loop; of one that selects: any */
};
/** Those that may, by a switch. */
struct apc_controller_peers {
    int acting;                           /**< id of the switch, in table opmode */
    size_t n;                             /**< 0: there are none */
    const struct apc_controller_peer *at; /**< [n]; not used after creation */
};

/** A setpoint of a controller, and within which limits it is taken. Values are in its own unit. */
struct apc_controller_setpoint {
    const char *name;    /**< for notices; NULL: its id; borrowed */
    int id;              /**< in table setpoint */
    double low, high;    /**< a row outside is refused, and the one before it stays in force */
    int above;           /**< id in table opmode of the loop above that moves it in Cas; 0: there is none */
    apc_ns above_period; /**< required with it: of that loop's controller; with peers the longest */
    int above_number;    /**< with peers: of that controller */
    struct apc_controller_peers above_peers;
};

/** An output of a controller: a loop. Values are in the output's own unit. */
struct apc_controller_loop {
    const char *name;    /**< for notices; NULL: its number; borrowed */
    int id;              /**< of the output, in table actuator; with setpoint or signal: none */
    int mode;            /**< id in table opmode of its target mode */
    int manual;          /**< id in table manual of the operator's output; default: as mode */
    double low, high;    /**< limits; what goes out never leaves them */
    double rate;         /**< at most so many units a second; 0: as fast as it likes */
    double fault;        /**< what goes out when it was held too long */
    apc_ns hold;         /**< how long to hold before that; default 3 periods */
    int setpoint;        /**< id of the setpoint of a loop below that it moves; 0: none */
    int below;           /**< with it: id in table opmode of that loop's target */
    int below_tick;      /**< with it: id of the tick row of that loop's controller; with signal: of the one
                              that has its outcome, as its law selects; 0: none */
    apc_ns below_period; /**< required with it: of that controller; with peers the longest */
    struct apc_controller_peers below_peers; /**< of that controller */
    int signal; /**< instead: id in table sensor of the signal that it calculates; 0: none. It never is
                     at the fault value, but Bad, so who takes it can tell */
};

/** The law that acts on actuators while the one proper cannot: of the same dimensions and period, with the
 * same limits. What it publishes is not written. */
struct apc_controller_backup {
    const struct apc_law *law; /**< required; borrowed */
    size_t n_setting;
    const struct apc_setting *setting; /**< these as those of the law proper */
    const struct apc_law_plant *plant;
    const struct apc_param *param;
    const double *start;
};

/** Zero means default, but for those marked required. */
struct apc_controller_options {
    size_t size;
    int number;                /**< id of its tick row; default 1 */
    const struct apc_law *law; /**< required; borrowed */
    struct apc_dim dim;        /**< required: of the law, so of this controller only */
    apc_ns period;             /**< required */
    apc_ns budget;             /**< how long the law may compute at a tick; default half the period */
    bool real_time;            /**< mono is the system's clock: the law is told when its budget ends */
    apc_ns horizon;            /**< required: a measurement that did not change for so long is stale. Of the
                                  measurement's own rhythm, not the controller's: 3 periods of the client or of
                                  the plant, whichever is slower, + 100 ms */
    unsigned shed_after; /**< after so many ticks in a row without a good answer of the law a loop goes to
                            its backup law or fault value; default: as many as the longest hold has periods */
    const int *y, *d;    /**< [ny], [nd] ids in table sensor; NULL: 1, 2, ...; copied */
    const apc_ns *y_horizon, *d_horizon; /**< [ny], [nd] of single ones, such as what another controller
                            calculates; NULL or 0: horizon; copied */
    const bool *told; /**< [ny] of those that another controller calculates: table actual tells it the
                         outcome, if the law selects; NULL: none; copied */
    const struct apc_controller_setpoint *z; /**< [nz]; NULL: ids 1, 2, ... without limits; copied */
    const struct apc_controller_loop *loop;  /**< [nu]; NULL: ids 1, 2, ... without limits; copied */
    int tuning;                              /**< id of the first tuning; the others follow; default 1 */
    int estimate, prediction; /**< ids of the first number and of the first vector that the law publishes, in
                                 these tables; the others follow; 0: they are not written */
    int acting;  /**< id in table opmode of the switch that says by its number which controller of these
                    outputs acts; 0: there is none, and this one does */
    bool shadow; /**< with it: another one acts as long as the switch is not set */
    int output;  /**< id in table estimate of its first output, as it puts it out or would; the others
                    follow; 0: they are not written */
    const struct apc_signal_view *view; /**< [ny + nz + nu + nd] what is known of the signals, for the laws;
                                           soft limits are also told at each tick; NULL: nothing; the names
                                           are borrowed */
    size_t n_setting;
    const struct apc_setting *setting; /**< of the law; [n_setting]; not used after creation */
    const struct apc_law_plant *plant; /**< linear model for a law that wants one, or NULL; as setting */
    const struct apc_param *param; /**< [law->n_tuning] limits of the parameters, narrowed; NULL: the law's
                                      own; borrowed */
    const double *start; /**< [apc_law_parameters()] the tuning in force until the store has a good one;
                            NULL: the initial ones; copied */
    const struct apc_controller_backup
        *backup; /**< its parameters have the ids behind those of the law; NULL:
                    none; not used after creation, but for what it borrows */
};

/**
 * A controller: its law, and loops that stand each by itself, with one state, mode, hold and fault an output
 * (docs/modes.md). It knows no store. Around it stands a shell, which reads apc_controller_in(), computes,
 * appends apc_controller_out(), and says what became of that, in this order, as in the paper:
 *
 *     rc = apc_store_read_rows(store, apc_controller_in(controller));
 *     apc_controller_compute(controller, now, tick->index, rc >= 0, &notice);
 *     rc = apc_store_append_rows(store, apc_controller_out(controller));
 *     apc_controller_update(controller, rc < 0 ? -1 : 1);
 */
struct apc_controller;

/** [setup] Returns 0, APC_EINVAL (an option or a setting of the law is wrong, or a tick row would have more
 * than APC_ELEMENTS_MAX numbers), APC_ENOMEM, or the error of the law's create(). On failure @p why has the
 * reason, and *@p controller is NULL. */
APC_API int apc_controller_create(struct apc_controller **controller,
                                  const struct apc_controller_options *options, struct apc_error *why);
APC_API void apc_controller_destroy(struct apc_controller *controller); /**< NULL is legal. [setup] */

/**
 * What it reads at each tick, for apc_store_read_rows(): measurements, disturbances, setpoints, target modes,
 * manual outputs, tuning, its outputs as they stand; of loops above and below what they say. The controller's
 * own memory, as all rows here; table and id stay as they are. [any]
 */
APC_API struct apc_rows *apc_controller_in(struct apc_controller *controller);
/**
 * The rows that the last tick wrote, for apc_store_append_rows(), which sets the seqs of setpoints. Outputs
 * come first, then setpoints that were put back, the outcome of requests (table actual) where it changed, and
 * what the law published where it was asked. The last one is the tick row: all inputs of this tick, and all
 * that the next tick needs. All are one transaction. While another controller acts neither outputs nor
 * setpoints nor their outcomes are among them. [any]
 */
APC_API struct apc_rows *apc_controller_out(struct apc_controller *controller);
/** The rows that a restart continues from, for apc_store_read_rows(): its newest tick row, its rows in tables
 * actual and estimate. Fill it, then apc_controller_resume(). [any] */
APC_API struct apc_rows *apc_controller_former(struct apc_controller *controller);

/**
 * Go on from apc_controller_former() as the store filled it; to be called also where nothing is stored,
 * before the first tick. That is bumpless. It takes the law's own state when the same law with the same
 * constants stored it: the same build of a plug-in, the same version of a built-in law. From another law of
 * the same dimensions it takes the last output. A row is not taken when it has other dimensions, is from
 * before @p since, UTC, and so of another run, is Bad, or has invalid numbers. Nor is an operator's output
 * that is older than the resumed row or, without one, than @p since (0: not known; then any that is there
 * already). Returns 1 when it resumed, 0 when it starts afresh. [setup]
 */
APC_API int apc_controller_resume(struct apc_controller *controller, apc_ns since);

/**
 * Compute from apc_controller_in() as the store filled it; @p have is false where it could not be read. @p
 * tick is the index on the controller's grid, for laws that go by it. Fills apc_controller_out(). Returns how
 * many rows it has. [tick]
 */
APC_API int apc_controller_compute(struct apc_controller *controller, struct apc_now now, uint64_t tick,
                                   bool have, struct apc_notice *notice);
/** The other notices of that tick, one loop's at each call; false: that is all. The first, and most severe,
 * is the @p notice of apc_controller_compute(), where that was asked for one. [tick] */
APC_API bool apc_controller_noticed(struct apc_controller *controller, struct apc_notice *notice);
/** The terms of the law's answer at that tick, for output @p i, from 0, before limits: the first @p most into
 * @p term. Returns how many there are; 0: the output is not the law's, or the law reports none (`pi`, `pid`,
 * `mpc`, `nmpc` do). [any] */
APC_API size_t apc_controller_terms(struct apc_controller *controller, size_t i, struct apc_law_term *term,
                                    size_t most);
/**
 * The outcome of apc_controller_out(): 1 the rows are stored, and the law's state goes on; 0 they are
 * certainly not; -1 unknown, because the answer was lost. In that case the next apc_controller_compute() that
 * has rows sees whether they are there. A row by swap that was left out has seq 0. [tick]
 */
APC_API void apc_controller_update(struct apc_controller *controller, int written);
/**
 * Of a controller with a switch: does that, as it was read for the last tick, name it? The one that is not
 * named writes no output from that tick on, and its shell gives the claims on the outputs back. The one that
 * is named acts from the first tick on for which apc_controller_claimed() says that it holds them. Its shell
 * claims them after a tick, so that the next read has all rows that another one wrote. [tick]
 */
APC_API bool apc_controller_named(const struct apc_controller *controller);
/** Whether the outputs are claimed; at first they are not. [tick] */
APC_API void apc_controller_claimed(struct apc_controller *controller, bool claimed);
/** Field number @p field, from 0, of the tick row: its name, where it begins, how many values it has. False:
 * there are no more. [any] */
APC_API bool apc_controller_tick_field(const struct apc_controller *controller, size_t field,
                                       const char **name, size_t *offset, size_t *length);
/** At how many ticks the law gave no usable output, and the last one was held. [any] */
APC_API uint64_t apc_controller_failures(const struct apc_controller *controller);

#ifdef __cplusplus
}
#endif
#endif
