/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An experiment in virtual time: the cores of its modules on the executive "virtual" and the exchange
 * inproc:, in one process.
 */
#ifndef APC_SIMULATION_H
#define APC_SIMULATION_H

#include <signal.h>

#include <apcexchange.h>

#include "figures/figures.h"
#include "operate/operate.h"
#include "record/record.h"

#define SIMULATION_BEGIN (INT64_C(946684800) * APC_NS_PER_S) /* UTC of t = 0: 2000-01-01 */

/* One of its tasks: "scheduler", where there is one, "plant", "client", and each controller by its name. */
struct simulation_task {
    const char *name;
    apc_ns period;
    struct apc_task *task;
};

/* A controller in it. */
struct simulated {
    struct simulation *s;
    const struct controller *of;
    struct apc_controller *core; /* NULL: it was killed */
    struct apc_store *store;     /* of its own where it takes turns, for its claims */
    bool claimed;                /* its outputs are */
    bool ticks;                  /* its tick has begun, and what it made is to take effect */
    bool holds;                  /* an output of its is not the law's */
    bool hangs;                  /* by a fault: it makes no tick */
    uint64_t held, failures;     /* ticks at which that was so; of the law, until it was killed */
    struct ramps ramps;          /* that people asked for; at NULL: nobody has written anything yet */
};

/* Made by simulation_create(), to be read by anyone. */
struct simulation {
    const struct experiment *e;
    uint64_t seed;
    struct apc_executive *executive;
    const struct apc_clock *clock;
    struct simulation_task *task; /* [n_tasks] */
    size_t n_tasks;
    struct apc_exchange *exchange;
    apc_ns zero;   /* monotonic, of t = 0 */
    apc_ns before; /* that its controllers had been ticking by then: of a part of a run */

    struct apc_plant *plant;
    struct apc_plantserver *server;
    struct apc_client *client;
    struct simulated *controller;    /* [e->n_controllers] */
    struct apc_scheduler *scheduler; /* NULL: there is none */
    uint64_t step;                   /* it is at, once it has begun, */
    apc_ns step_began;               /* mono, then */
    bool schedules;                  /* it has */
    struct simulation_past *past;    /* of its experiment; NULL: it has none */
    const struct playback
        *playback; /* what a run in real time did until it goes on; NULL: all is simulated */
    const struct samples
        *repeats;    /* its rows, or those of simulation_repeat_writes(); NULL: there are none */
    size_t repeated; /* of them */
    /* By people, also in a run that is repeated, at the time from which on each is in effect. */
    struct samples written;
    struct apc_alarms *alarms; /* NULL: there are none */
    struct apc_store *store;   /* mem:, a name of its own; or shm:, shared */
    char uri[256];
    bool shared; /* with programs of people, who write while it goes on: simulation_pace() */

    /* what the shells keep between two of their events */
    void *memory; /* of the arrays of numbers of inputs and outputs */
    struct apc_sample *u, *y;
    struct apc_value *command, *answer; /* of the exchange that is under way */
    struct apc_now plant_now;
    apc_ns answered; /* UTC: the exchange that began last brings nothing older */
    struct clock_step *clock_steps;
    struct action_step *action_steps;
    const struct action *call; /* what simulation_operate() does */
    struct loops loops;
    struct apc_tag *tags; /* [n_tags] of the experiment's variables */
    size_t n_tags;
    struct plant_view view; /* of these, for ramps */
    bool on_ramps;          /* something is on its way */
    bool link_down;
    bool *outside; /* [ny] measurements that are beyond their ranges */

    struct trajectory
        trajectory; /* of the plant, by the monotonic clock: a step of the wall clock is none of time */
    double *now;    /* [nu] what the plant is given */
    struct apc_histogram *round_trip; /* of the exchanges that had a reply */
    _Atomic uint64_t in_vain;         /* those that had none */
    apc_ns sent_at;

    void (*watch)(void *ctx, apc_ns t); /* simulation_watch() */
    void *watch_ctx;
    void (*measured)(void *ctx, struct apc_sample *y, size_t n); /* before they are stored; NULL: nobody */
    void *measured_ctx;

    size_t n_faults;
    struct simulated_fault {
        int64_t seen;             /* seq of the row that started or stopped it, as far as it is seen */
        apc_ns at;                /* when it begins by the experiment, which has that again afterwards */
        bool waits;               /* until its condition is true */
    } * fault;                    /* [n_faults] */
    struct apc_sample *fault_row; /* [n_faults] */
    bool faults_wait;             /* some do */
    bool link_lost;               /* by a fault */
    struct simulated_plant_fault {
        bool acts, held; /* held: at what the model takes at most */
    } * plant_fault;     /* [e->plant.n_faults] */

    int64_t handled;                 /* events of the executive */
    double ended;                    /* s since t = 0 */
    volatile sig_atomic_t interrupt; /* it is asked to end */
    bool interrupted;                /* and did */
    int rc;                          /* why it ended early, with its text in why */
    struct apc_error why;
};

/* Ticks at which a controller's outputs were held or at their fault value, over all of them; at which a law
 * gave no usable output. */
uint64_t simulation_held(const struct simulation *s);
uint64_t simulation_failures(const struct simulation *s);
uint64_t simulated_failures(const struct simulated *c);

/* Of an experiment that has a past, its simulation is that until then. Returns 0 or a negative error;
 * simulation_destroy() in either case. */
int simulation_create(struct simulation *s, const struct experiment *e, uint64_t seed, struct apc_error *why);
/* Until simulation_branch(), which must come at the end of @p playback, what it holds takes the place of all that
 * controllers, scheduler, alarms and people do. */
struct playback;
int simulation_create_after(struct simulation *s, const struct experiment *e, uint64_t seed,
                            const struct playback *playback, struct apc_error *why);
/*
 * Go on until @until, in s: what happens at that very instant is not part of it. Returns 0, or why it ended
 * before, for good (also in s->rc, s->why): what has happened until then is kept. So it is when
 * simulation_interrupt() was called meanwhile, which a signal handler may do; that is no error.
 */
int simulation_run(struct simulation *s, double until);
void simulation_interrupt(struct simulation *s);
/*
 * The same, and what is final of its samples goes to @take (NULL: nobody wants them) as it goes on, piece by
 * piece in the order of samples.csv, and out of its store; also the rest, whatever ended it. The store keeps
 * the newest of each variable, what people and alarms did, and events. @take returns 0 or a negative error.
 */
typedef int simulation_take_fn(void *ctx, const struct samples *rows);
int simulation_stream(struct simulation *s, double until, simulation_take_fn *take, void *ctx);
/*
 * In a store that other programs use as well (shm:), into which the experiment was put, and whose clock it becomes:
 * simulation_create() otherwise. simulation_pace() goes on until @until at the speed that the store asks for, tick of
 * the plant by tick. What people write takes effect at the next one, as their actions in the experiment do at that
 * time: so the same writes at the same ticks give the same samples at any speed. It ends early where people rewind it,
 * which the clock tells. Returns as simulation_run().
 */
struct pace_watch {
    bool (*look)(void *ctx);                 /* every 20 ms or so; true: that is the end */
    void (*written)(void *ctx, size_t from); /* simulation.written has grown from there on */
    void *ctx;
    bool repeats; /* what was: to all others it begins yet */
};
#define SPEED_MOST 1000
int simulation_create_shared(struct simulation *s, const struct experiment *e, uint64_t seed, const char *uri,
                             struct apc_error *why);
int simulation_pace(struct simulation *s, double until, const struct pace_watch *watch);
/* The plant's tick next to @t, since t = 0; 0 is one. */
apc_ns simulation_nearest_tick(const struct experiment *e, apc_ns t);
/* What people wrote in another run of it, as simulation.written has it, each at its time and before all else of that
 * instant. Of a simulation that has not begun, or of which the past has ended; @rows outlive it. Returns 0 or APC_ENOMEM. */
int simulation_repeat_writes(struct simulation *s, const struct samples *rows);
/*
 * From now on the experiment is @p e, of which those actions happen that are to come; the one before must
 * have had none to come. Both have to outlive the simulation. Controllers that are others go on as daemons do
 * that are started again. Returns 0, APC_EINVAL (it differs in something that does not change in a run, which
 * is named), or why the simulation ended.
 */
int simulation_branch(struct simulation *s, const struct experiment *e, struct apc_error *why);
/* Parts of it: an event at the very instant that the simulation has come to, and what may be done in one. */
int simulation_happen(struct simulation *s, apc_virtual_fn event, void *ctx);
int simulation_start(struct simulated *c, struct apc_error *why);
void simulation_kill(struct simulated *c);
void simulation_do(struct simulation *s, const struct action *action, const char *who);
void simulation_look(struct simulation *s); /* the scheduler, for what is due */
int simulation_schedule_actions(struct simulation *s, apc_ns from);
/* What an operator does, now. Returns 0 or why it ended. */
int simulation_operate(struct simulation *s, const struct action *action);
/* @watch is called at each instant of the plant, @t since t = 0, where actions that have a time are done: before all
 * else of that instant, behind those. Returns 0 or APC_ENOMEM. */
int simulation_watch(struct simulation *s, void (*watch)(void *ctx, apc_ns t), void *ctx);
void simulation_destroy(struct simulation *s);

/* What people wrote in the run whose folder @p e is of, for simulation_repeat_writes(). Returns 1; 0: it has no such
 * file; or an error. samples_free() in any case. */
int simulation_written(const struct experiment *e, struct samples *rows, struct apc_error *why);

/* ---- Past ----------------------------------------------------------------------------------- */

/*
 * The past of a run in real time, up to the time from which a simulation goes on: what its plant was given,
 * and what its controllers go on from, as its folder has it.
 */

struct playback {
    struct samples rows;     /* outputs, setpoints and calculated signals, by time, in that of a simulation */
    struct apc_store *ticks; /* all else, in that of the run */
    apc_ns start, end;       /* UTC of its t = 0, and of its last instant */
    apc_ns before;           /* its controllers had been ticking for so long by then */
};

/* Of a run from p->start until p->end, from its store p->ticks, and samples, of which the times are since that start.
 * Returns 0 or an error. */
int playback_take(struct playback *p, const struct samples *process, const struct experiment *e);
/* Of the run in folder @p dir until @p end, since its start. Returns 0 or a negative error; playback_free() in
 * either case. */
int playback_load(struct playback *p, const char *dir, const struct experiment *e, apc_ns end,
                  struct apc_error *why);
/* Into the store of a simulation: of each variable that is not among the rows the newest. Returns 0 or the
 * error of one of the two. */
int playback_end(const struct playback *p, struct apc_store *to);
void playback_free(struct playback *p);

/* ---- Replay --------------------------------------------------------------------------------- */

/* What controllers would have done in a recorded run. */

/* How the outputs of one loop differ. */
struct replay_difference {
    uint64_t ticks, same;
    double sum, worst, at, low, high; /* of the recorded ones: low, high */
    apc_ns differs,
        since; /* of the first that differs, and whence the ticks before it were computed; 0: none does */
};

#define REPLAY_TEXT 300

/* What came of the ticks of one controller. */
struct replay_figures {
    uint64_t judged; /* compared, but for those of which the record has not all */
    uint64_t same;   /* of them all of the row came out again */
    uint64_t
        lost; /* of a store: not the same, and a row that they name or ticks before them are not on record */
    uint64_t
        others; /* of a store: of a law, settings or a model that no description of it has; not replayed */
    uint64_t restarts; /* found by what came out: it went on from its stored row */
    apc_ns begins; /* of the first tick, where what it went on from is not on record any more; 0: all are */
    apc_ns other;  /* the first of `others`; 0: there is none */
    apc_ns differs, loses;   /* when the first that differs is, and the first that is lost */
    char first[REPLAY_TEXT]; /* which tick is the first that differs, and why; "": none does */
    char lacks[REPLAY_TEXT]; /* the same of the first that is lost */
};

/* One controller of the run. */
struct replay_controller {
    const struct controller *of;
    struct apc_controller *core;
    struct ticks ticks; /* recorded */
    apc_ns first, last; /* of all on record, of a part too, for why_find(); first > last: there are none */
    struct replay_figures figures;
    struct apc_now now;     /* of the tick before */
    struct apc_now ticking; /* of this one */
    const double *row;      /* of the tick before, recorded; NULL: there is none */
};

struct replay;
/* Called as the replay goes on; t in s since the start of the run. Each may be NULL. */
struct replay_watch {
    void (*output)(void *ctx, double t, const char *loop, double recorded, double replayed);
    void (*notice)(void *ctx, double t, const char *text); /* of the replayed controllers, but for modes */
    void (*computed)(void *ctx, const struct replay *r, const struct replay_controller *rc,
                     const struct tick_row *at); /* its answer stands in the controller */
    void *ctx;
};

struct replay {
    struct experiment e;
    struct replay_controller *controller; /* [e.n_controllers] */
    struct replay_difference *difference; /* [loops.n] */
    struct loops loops;

    /* its own */
    struct apc_tag *tags; /* [n_tags] of the experiment's variables */
    size_t n_tags;
    struct samples samples; /* what the tick rows name, by table, id, seq */
    struct replay_stray {   /* and what of it had to be looked for */
        struct apc_sample sample;
        int64_t lacks_until; /* seq; 0: it is there; else from its own on the record has none below this */
        struct replay_stray *next;
    } * stray;
    struct apc_store *store; /* where; NULL: nowhere */
    struct ticks *plan;      /* [e.dim.nz] and of plans */
    struct apc_sample lost;  /* the last plan that is not on record */
    apc_ns start;            /* t = 0 in the record */
    bool other_law;
    apc_ns since,
        until;      /* ticks before it, and from then on, are computed and not judged; until = 0: no end */
    apc_ns began;   /* of a store: t = 0 of what is told */
    bool of_store;  /* a part of its record, in real time, for why_find(): its texts say UTC */
    apc_ns give_up; /* why_find() has no answer when the monotonic clock is past it; 0: it takes its time */
    bool more;      /* and there may be older ticks than those that were taken */
    char other_build[150]; /* what made the run, where it was not this one; "": it was, or nobody knows */
    struct replay_watch watch;
    struct apc_error why;
};

/* The record of the run in folder @p dir, and its controllers or, where there is one, with the law that
 * overrides name. Returns 0 or a negative error; replay_free() in either case. */
int replay_load(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                struct apc_error *why);
/* Open the ticks of that folder, as a store. Returns 0 or a negative error. */
int replay_open_ticks(struct apc_store **ticks, const char *dir, struct apc_error *why);
/* Of a loop's record in a store: what the ticks within @p over until @p until need, and @p lead ticks before. */
struct replay_part {
    struct apc_store *store;
    const char *dir; /* of the run folder whose ticks `store` has; NULL: it is of a plant */
    const char *loop;
    apc_ns over, until; /* until: INT64_MAX: the newest */
    size_t lead;
    bool built_in; /* a law or plant of the user's own is refused, before any of it is loaded */
    const struct experiment *simulated; /* whose simulation's store it is; NULL: of a run in real time */
};
/* The same of that part, for why_find(), with the experiment that was simulated, or as the store's catalogue has it,
 * and had it then where it keeps former ones. */
int replay_load_part(struct replay *r, const struct replay_part *part, struct apc_error *why);
/* A time of the record, for people. */
const char *replay_time(const struct replay *r, apc_ns time, char text[APC_TIME_LEN]);
/* Once. Returns 0 or why it ended, with a text in r->why. */
int replay_run(struct replay *r, const struct replay_watch *watch);
/*
 * Instead: simulate the run anew and compare the tick rows, all but times and the numbers of rows: the first
 * that differs is in `first` of its controller. Returns 0 or a negative error with a text in r->why.
 */
int replay_virtual(struct replay *r);
void replay_free(struct replay *r);

/* ---- A season ------------------------------------------------------------------------------- */

/*
 * Ticks of a record, whatever their number: over restarts, and changes of tuning, mode, law and settings. A store
 * says with which experiment each was made; a run folder has one.
 */
struct replay_range {
    struct apc_store *store;
    const char *dir;     /* of the run folder whose ticks `store` has; NULL: it is of a plant */
    apc_ns since, until; /* UTC */
    bool exact;    /* these are from a season that was opened before; else it begins with its first tick */
    apc_ns window; /* of so much the rows are in memory at once */
    const char *controller;                       /* NULL: all */
    const struct experiment_overrides *overrides; /* a law, settings: its own tuning holds; NULL: what ran */
    bool own_tuning;                              /* it holds without these as well */
};

struct season {
    struct replay_range of; /* with `since` and `until` of what there is: since >= until: nothing */
    struct season_controller {
        char name[APC_TAG_LEN];
        struct replay_figures figures;
    } * controller;
    size_t n_controllers;
    struct season_loop {
        char name[APC_TAG_LEN];
        struct replay_difference difference;
    } * loop;
    size_t n_loops;

    /* its own */
    struct season_revision {
        apc_ns since; /* in force from then on */
        struct replay replay;
        bool usable, wanted;
        struct apc_error why; /* if it is not usable */
    } * revision;             /* [n] how the experiment was described, the newest last */
    size_t n;
    bool former; /* a former description than that in force is replayed */
    struct replay_watch watch;
};
/* Returns 0, APC_ENOTFOUND (no such controller) or another error; season_close() in either case, before that of the
 * store. Times of @watch are since @of->since, of a folder since its start. */
int season_open(struct season *s, const struct replay_range *of, const struct replay_watch *watch,
                struct apc_error *why);
/* Where the window that begins at @since ends. */
apc_ns season_window(const struct season *s, apc_ns since);
/* The ticks of a window: what comes of them is added. Windows are independent of each other. Returns 0 or an error. */
int season_replay(struct season *s, apc_ns since, apc_ns until, struct apc_error *why);
/* Add what came of a later window, in a season of the same range. */
void season_add(struct season *to, const struct season_controller *controller,
                const struct season_loop *loop);
void season_close(struct season *s);
/* Was the tick row of that controller, of which the first two numbers are there, made as the store describes it: by its
 * law, its settings, its model? What nobody can tell, as of a law of the user's own, is: 1. Returns 1, 0 or an error. */
int simulation_as_described(struct apc_store *store, const char *name, const struct apc_vector *tick,
                            struct apc_error *why);

/* ---- Why a tick differs ---------------------------------------------------------------------- */

/*
 * What a tick that differs from its record comes from: a law or a setting that did not run, each left out alone; or a
 * row at odds with the tick that names it, each put right alone. The tick is computed again: each cause is proved.
 */
struct differs {
    char output[APC_TAG_LEN]; /* of a loop; "": the law's memory alone differs */
    apc_ns time;
    double recorded, replayed;
    struct differs_cause {
        char name[160];
        const char *kind;
        double recorded, replayed; /* NAN: of what is no number */
        double effect;             /* on the output: replayed less without it */
    } * cause;                     /* [n] the greatest effect first */
    size_t n;
    struct differs_term {
        char name[APC_TAG_LEN], of[APC_TAG_LEN]; /* of: a signal; "": the output itself */
        double recorded, replayed;               /* NAN: not known */
    } * term;                                    /* [n_terms] */
    size_t n_terms;
    double together;           /* what is of no cause alone */
    char unknown[REPLAY_TEXT]; /* why not all is told; "": it is */
};

/* Of a loop's tick under the law and the settings of @p of, computed from @p since on, 0: from the first. */
int differs_of_candidate(struct differs *d, const struct replay_range *of, const char *loop, apc_ns time,
                         apc_ns since, struct apc_error *why);
/* Of a controller's tick under the law that ran, or one in its place where no description has its mark. Both return 0
 * or an error with a text in @p why; differs_free() in either case. */
int differs_of_record(struct differs *d, const struct replay_range *of, const char *controller, apc_ns time,
                      struct apc_error *why);
void differs_free(struct differs *d);

/* ---- In closed loop -------------------------------------------------------------------------- */

#define CLOSED_NOTES 40

/*
 * What would have been in a recorded run under another law or other settings of it: what acted on each measurement
 * besides the model of the plant, and what the model leaves out, is estimated from the record, and acts again.
 */
struct closed {
    struct experiment was;
    struct samples all; /* of the record, by time since `start` */
    apc_ns start;       /* UTC of its t = 0, */
    apc_ns since, end;  /* since when it begins and ends; since > 0: it goes on from what was in force then */
    char note[CLOSED_NOTES][REPLAY_TEXT]; /* [n_notes] what else is to be known of it */
    size_t n_notes;

    /* its own */
    struct replay_range of;
    char *text;                        /* of the experiment that the store describes */
    struct playback played;            /* whose store is that of the range */
    struct samples recorded, modelled; /* measurements, by variable and time */
    struct samples written;            /* by people and the scheduler, and what they found */
    apc_ns zero;                       /* UTC, from which ticks are counted */
    struct closed_model {
        struct closed_spread {
            uint64_t n;
            double mean, squares;
        } measured, modelled, left;
    } * model;          /* [ny] */
    struct action *gap; /* [n_gaps] in which a controller had no ticks, where that is known */
    size_t n_gaps;
    bool gaps_known, failed;
};

/* Of a run folder or a store. Only since, until, store and dir of @p of are looked at. Returns 0 or a negative error;
 * closed_free() in either case, before that of the store. */
int closed_load(struct closed *c, const struct replay_range *of, struct apc_error *why);
/* That record with what overrides say, NULL: as it was, into @made, by time since its start. Returns 0 or an error. */
int closed_run(struct closed *c, const struct experiment_overrides *overrides, struct samples *made,
               struct apc_error *why);
/* From its beginning on that controller of @p c->was acts, whoever did then. Returns 0 or APC_ENOMEM. */
int closed_promote(struct closed *c, const struct controller *to);
/* How much of what moved measurement @p k is not the model's: 0: nothing; 1: as much as all that it, or the model,
 * moved. */
double closed_left_out(const struct closed *c, size_t k);
/* Rows of a record or of what would have been, by time: what is in force at @p from, and what comes until @p until.
 * Returns 0 or APC_ENOMEM. */
int closed_window(struct samples *to, const struct samples *of, apc_ns from, apc_ns until);
/* How well its loops were controlled then. Returns 0 or APC_ENOMEM; figures_free() in either case. */
int closed_figures(struct figures *f, const struct samples *of, const struct experiment *e, apc_ns from,
                   apc_ns until);
void closed_free(struct closed *c);

/* ---- Why ------------------------------------------------------------------------------------ */

/*
 * Why an output of a recorded run moved. Of each input of its controller that changed, the ticks of the move are
 * computed again with that input as it was before them: the difference is what the input contributed. Nothing is
 * said of ticks that do not come out of the record bit for bit.
 */

enum why_kind {
    WHY_SETPOINT = 1, /* with what it is to become, to a law that looks ahead */
    WHY_MEASUREMENT,
    WHY_DISTURBANCE,
    WHY_TUNING,
    WHY_MODE,   /* the target of a loop of the same controller */
    WHY_MANUAL, /* an operator's output */
    WHY_BELOW,  /* what takes the output: how it can follow */
    WHY_ABOVE,  /* mode of the loop that moves a setpoint */
    WHY_ACTING, /* which of several controllers acts */
    WHY_LAW     /* it was late, or failed */
};

struct why_cause {
    enum why_kind kind;
    size_t element;              /* of its kind, in its controller */
    const struct apc_tag *tag;   /* of the variable; NULL: it has none */
    const struct apc_tag *moves; /* the output that an operator's value is for; else NULL */
    double before, now;          /* NAN: of what is no number */
    apc_status status_before, status;
    const struct apc_sample *row; /* that came; NULL: it is not a row, or not on record */
    double effect;                /* on the output: less with it as it was before */
};

struct why {
    const struct replay_controller *by;
    const char *loop; /* its name */
    const struct apc_tag *output;
    size_t element;
    const struct tick_row *before, *tick;
    double u_before, u;
    enum apc_loop_state state_before, state;
    char reason[144];        /* why the loop is not as wanted; "": it is */
    unsigned blocked;        /* enum apc_limited: how what takes it cannot follow */
    unsigned limited;        /* the same: how a limit of the law, or of its rate, held it back */
    double low, high;        /* its limits */
    struct why_cause *cause; /* [n] the greatest effect first */
    size_t n;
    struct why_term {
        const char *name;
        char of[APC_TAG_LEN]; /* signal; "": the output itself */
        double before, now;   /* NAN: not known; before the first tick, or not the law's */
    } * term;                 /* [n_terms] as of apc_controller_terms(), but those of signals that are 0 */
    size_t n_terms;
    double earlier;  /* what it moves without any of them: integral action, ramps, filters */
    double together; /* what they do only together */
    size_t lead;     /* so many ticks were computed before those of the move */
    bool restarted;  /* no answer: its controller was started anew within the move */
    bool cut;        /* it begins with the first tick on record, which is not the first of the run */
};

/* Why did @p loop move within the ticks after @p from until @p until, UTC, the last of which is not younger? Both
 * of one controller's ticks; @p from not before its last tick: that tick alone. After replay_load(), as often as
 * wanted. Returns 0, APC_ENOTFOUND (no such loop, or no tick there), APC_ESTATE (a tick does not come out of the
 * record again), or another error, with a text in @why; why_free() in either case. */
int why_find(struct why *w, struct replay *r, const char *loop, apc_ns from, apc_ns until,
             struct apc_error *why);
/* The loop above that wrote the row of a setpoint, at its time; NULL: somebody else did. */
const char *why_above(const struct replay *r, const struct why_cause *cause);
void why_free(struct why *w);

/* The same as it is asked for and told. */
struct why_question {
    struct replay *replay; /* room for the part of the record that is needed, zeroed at first */
    struct apc_store *store;
    const char *dir; /* of the run folder whose ticks `store` has; NULL: it is of a plant */
    const struct experiment
        *simulated; /* whose simulation's store it is: times are since its start; or NULL */
    const char *loop;
    apc_ns at, over; /* at: INT64_MAX: the last tick; over: 0: one tick */
    bool built_in;   /* laws and plants of the user's own are not loaded, but refused */
    apc_ns give_up;  /* no answer when the monotonic clock is past it; 0: however long it takes */
    unsigned depth;  /* so many loops below it were told before */
};
/* As why_find(); the replay has to live as long as @p w, and is the caller's to free. */
int why_ask(struct why *w, const struct why_question *q, struct apc_error *why);
/* The setpoint by which a loop above moved it; NULL: none did. And the question why that did, with room for its
 * name. */
const struct why_cause *why_moved_above(const struct why *w, const struct why_question *q);
struct why_question why_question_above(const struct why_question *q, const struct why_cause *moved,
                                       char loop[APC_TAG_LEN]);

/* Who wrote the row of a cause, and in which words, as the operators' events say; "": none does. */
struct why_author {
    char source[APC_TAG_LEN], text[200];
};
/* Returns 0 or an error with a text in @p why. */
int why_find_author(const struct why_question *q, const struct why_cause *cause, struct why_author *author,
                    struct apc_error *why);
const char *why_kind_name(enum why_kind kind);
const char *why_state_name(enum apc_loop_state state);
const char *why_cause_name(const struct why *w, const struct why_cause *cause);

/* The answer's members as JSON, with those of the loops above, of which one that cannot be explained says so.
 * Returns as why_find(): then what is in @p t is of no use. */
struct text;
int why_json(const struct why_question *q, struct text *t, struct apc_error *why);

/* ---- A loop on a model ---------------------------------------------------------------------- */

/*
 * A loop from an output of the plant to a measurement, as its controller would do with the tuning that it has in the
 * experiment: at rest at @y0 and @u0 until its setpoint moves by @step, with which the curves begin; at half of them
 * @load is added to its output on the way to the plant.
 */
struct loop_preview {
    const struct experiment *e; /* with its laws; no switch has the controller's outputs */
    size_t loop;                /* as controllers_loop() has it */
    struct apc_transfer g;      /* what its output moves */
    double y0, u0, step, load;
    size_t n;      /* ticks */
    double Ts;     /* result: s */
    double *y, *u; /* result: [n] */
};
/* Returns 0 or a negative error; loop_preview_free() in either case. */
int loop_preview_run(struct loop_preview *p, struct apc_error *why);
void loop_preview_free(struct loop_preview *p);

#endif
