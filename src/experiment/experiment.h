/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An experiment as the library and its own programs know it: one plant, its client, controllers and
 * scheduler, read from a file in libconfig's syntax, of which every program takes its part
 * (docs/experiment-file.md). Programs of others use apcrun.h.
 */
#ifndef APC_EXPERIMENT_H
#define APC_EXPERIMENT_H

#include <apcalarm.h>
#include <apcbase.h>
#include <apcexchange.h>
#include <apclinear.h>
#include <apcmodules.h>
#include <apcplant.h>
#include <apcsockets.h>
#include <apcstore.h>
#include <apctimer.h>

/* ---- The world around the modules, in virtual time ------------------------------------------ */

struct network_model {
    struct apc_network_options options; /* outages in time since the start of the run */
    struct apc_outage *outages;         /* those of the options */
};

/* How one task keeps time. */
struct task_model {
    struct apc_distribution execution, jitter; /* kind 0: none */
};

/* From @at since the start on: a step of the wall clock, and how much it gains a second. */
struct clock_change {
    apc_ns at, step;
    double drift;
};

/* Histograms that were read for distributions; they live as long as these. */
struct recordings {
    struct recording {
        struct apc_share *shares;
    } * at;
    size_t n;
};

struct models {
    struct network_model network;
    struct clock_change *clock;
    size_t n_clock;
    struct recordings recordings;
};

/* delay=normal(0.004,0.001),loss=0.01,outage=10-12,... in place of, or in addition to, what the file says. */
int models_network(struct models *m, const char *spec, struct apc_error *why);

/* How late task @name of a run began, and how long it took, as its folder has it. */
int models_recorded(struct models *m, const char *run, const char *name, struct task_model *task,
                    struct apc_error *why);

/* ---- The experiment ------------------------------------------------------------------------- */

/* One measurement, setpoint or manipulated variable. */
struct signal {
    struct apc_tag tag;
    double safe, fault;         /* manipulated variables only */
    double initial;             /* theirs, and a setpoint's; NAN: it has none */
    double soft_low, soft_high; /* of measurements and calculated signals; -+HUGE_VAL: none */
    double confirm;             /* greatest step of a write that needs no confirmation; 0: any */
    double second;              /* s that a write waits for a second person; 0: it needs none */
    double rate;                /* greatest change in 1 s, of what a controller puts out; 0: any */
    apc_ns period;              /* of a measurement that comes seldom; 0: the client's */
    bool critical;              /* a law that is whole cannot do without it */
};

struct rhythm {
    apc_ns period, phase;
    enum apc_overrun overrun;
    struct task_model model; /* in virtual time */
};

/* From a time on, since the plant's first tick, a disturbance is another one, a parameter is off by so much more each
 * second, the link is lost, or a controller hangs or is killed. FAULT_NEVER: as an instructor says. */
struct plant_fault {
    enum fault_of {
        FAULT_OF_SENSOR,
        FAULT_OF_ACTUATOR,
        FAULT_OF_LINK,
        FAULT_HANGS, /* of a controller, */
        FAULT_KILLS, /* which is started again at its end */
        FAULT_OF_DISTURBANCE,
        FAULT_OF_PARAMETER
    } of;
    size_t k;            /* of the controllers, disturbances or parameters */
    apc_ns at, duration; /* duration 0: for ever */
    double size;
    bool of_file;
};

/* A law or a model, as apc_law_find() and apc_model_find() take it. */
struct plugin {
    char name[512];
    bool chosen; /* instead of the file's: its own tuning or parameters hold */
};

/* Is a model of that name an FMU, or in Python: a file that runs by itself? */
bool is_fmu(const char *name);
/* Is a law or a model the user's own: a plug-in, or one that runs by itself? */
bool is_of_user(const char *name);

/* A signal of the experiment, by its place among those of its table. */
struct wire {
    enum apc_table table;
    size_t at;
};

#define EXPERIMENT_PATH    512
#define EXPERIMENT_NAME    640 /* of a model's variable: other tools make long ones */
#define EXPERIMENT_SETTING (EXPERIMENT_NAME + 128)

/* What a controller has to do with. Its outputs go to the plant, are setpoints of another controller, or
 * calculated signals. */
struct controller {
    char name[APC_TAG_LEN];
    struct apc_dim dim;
    struct wire *y, *z, *u, *d; /* [dim.ny], [dim.nz], [dim.nu], [dim.nd] */
    struct rhythm rhythm;
    bool shadow;    /* of the one before it that has the same outputs: it acts where it is promoted */
    unsigned depth; /* how many controllers stand above it, one above another: those tick before it */

    /* Ids in the store, over all controllers in the order of the file. */
    int number;                           /* of its tick row */
    int first_loop;                       /* of its outputs' loops, in table opmode */
    int first_tuning;                     /* of its parameters; 0 where its law is not known */
    int first_estimate, first_prediction; /* of what its law publishes: numbers, vectors; so are these */
    int n_published;                      /* of both */
    int acting;       /* of the switch in table opmode that says who acts on its outputs; 0: there is none */
    int first_output; /* with it: of its outputs as it would put them out, among the numbers */

    char law_name[256]; /* in the file */
    const char *former; /* a former name in the file of a setting or parameter of its law; NULL: none */
    struct plugin plugin;
    const struct apc_law *law;
    struct apc_pair *pair;       /* [dim.nu] by its law; NULL: that is not known */
    double *tuning;              /* [apc_law_parameters()] */
    struct apc_param *param;     /* [law->n_tuning] the law's, with the limits of this experiment */
    struct apc_setting *setting; /* [n_setting] */
    size_t n_setting;
    double *values;                   /* memory of the settings */
    double *linear;                   /* memory of plant; NULL: no operating point is given */
    size_t *disturbance;              /* likewise: [nd] */
    double *believed;                 /* [model->np] what its law takes for the plant's parameters */
    char model_file[EXPERIMENT_PATH]; /* "": none */
    struct apc_linear *sampled;       /* from it, or from the controller's group */
    struct apc_law_plant plant;
    enum apc_mode mode; /* at first; Cas: of the loops that have one above */
    apc_ns hold, budget;
    double second;       /* s that a write of modes and tuning waits for a second person; 0: it needs none */
    unsigned shed_after; /* 0: as many ticks as hold has */
    bool standby;        /* `apc run` starts two, of which one acts */
    double *rate;        /* [dim.nu] units a second; 0: as fast as it likes */
    struct apc_signal_view
        *view; /* [dim.ny + dim.nz + dim.nu + dim.nd], for its law; a backup's are the same */
    void *law_handle;
    struct controller *backup; /* the same but for law, tuning and settings: in its place where it cannot act;
                                  NULL: none */
};

/* What is to be done at a time of the run. */
struct action {
    apc_ns at; /* since t = 0 */
    enum action_kind { ACTION_WRITE = 1, ACTION_KILL, ACTION_START } kind;
    struct apc_sample to; /* the variable of the operator's, and its value, */
    size_t n;             /* and of how many ids from this one on: a controller's loops */
    bool local;           /* to is written only where a loop is in Cas: else its setpoint is Local already */
    int alarm;            /* that is acknowledged, its number; 0: none */
    size_t controller;    /* that is killed or started, by its place */
};

/* An alarm: what is evaluated, and what people are told. */
struct alarm {
    struct apc_alarm is;
    char name[APC_TAG_LEN], area[APC_TAG_LEN * 2];
    char message[APC_TAG_LEN * 2], consequence[256], response[256]; /* "": not said */
};

/* Who is told of an alarm that is raised: a command of the shell. */
#define ALARM_NOTICES 4
#define ALARM_COMMAND 512
struct alarm_notice {
    char command[ALARM_COMMAND];
    int priority; /* of those that are as grave as that, or graver */
    apc_ns timeout;
    apc_ns after;                /* not acknowledged so long since it was raised; 0: at once */
    apc_ns repeat;               /* again, until it is acknowledged; 0: once */
    int quiet_from, quiet_until; /* minutes of the local day; equal: there are no quiet hours */
    bool details;                /* the message names experiment, alarm and texts */
};
/* How long quiet hours last from @p utc on; 0: these are none. */
apc_ns alarm_notice_quiet(const struct alarm_notice *is, apc_ns utc);

struct experiment {
    char file[EXPERIMENT_PATH]; /* it was loaded from */
    char *text;                 /* it was read from */
    char name[APC_TAG_LEN];
    char title[128];
    double duration; /* s; 0: until it is stopped */
    uint64_t seed;   /* of all that is random */
    struct apc_dim dim;
    struct signal *y, *z, *u;                   /* [dim.ny + n_signals], [dim.nz], [dim.nu] */
    size_t n_signals;                           /* that controllers calculate; behind the measurements */
    struct apc_sensor *sensor;                  /* [dim.ny] */
    struct apc_sensor_fault *faults;            /* of all sensors */
    struct apc_actuator *actuator;              /* [dim.nu] */
    struct apc_actuator_fault *actuator_faults; /* of all actuators */

    struct {
        struct rhythm rhythm; /* of an external one: how often its measurements are new */
        bool external;        /* not ours to start; then there may be no model */
        char name[256];       /* of the model, in the file */
        struct plugin plugin;
        const struct apc_model *model;
        double *p, *x0;                  /* [model->np]; [model->nx] or NULL */
        struct apc_distribution *spread; /* [model->np] of p, which is its mean; kind 0: p is what it is */
        char listen[128];
        char identity[EXPERIMENT_PATH]; /* of tls:, where the file says it; else "" */
        const char **clients;           /* [n_clients] that may command, of tls: */
        size_t n_clients;
        char integrator[16];
        struct apc_plant_options options; /* but for the integrator, which is above */
        double *noise;                    /* [model->nx] or NULL */
        struct apc_disturbance *disturbance;
        size_t n_disturbances;
        struct plant_fault *fault; /* [n_faults] the link's, those of controllers and of what the model has */
        size_t n_faults, n_timed;  /* n_timed: of the file */
    } plant;
    struct {
        struct rhythm rhythm;
        char link[128];
        char identity[EXPERIMENT_PATH];   /* as the plant's */
        struct apc_modbus_options modbus; /* size 0: it is no such link */
        struct apc_modbus_point *points;  /* of modbus */
    } client;
    struct {
        struct rhythm rhythm;
        struct wire *z; /* [n] the setpoints that it moves */
        size_t n;
        double *sequence; /* [steps * n] */
        size_t steps;     /* 0: there is no scheduler */
        bool repeat;
    } scheduler;

    struct controller *controllers; /* [n_controllers], at least one */
    size_t n_controllers;

    struct {
        double history; /* s that the live store is to keep while the history is away, */
        int64_t size;   /* in so many MiB at most */
    } live;

    struct action *action; /* [n_actions] by time */
    size_t n_actions;

    struct alarm *alarm; /* [n_alarms], number i with id i in table alarm */
    size_t n_alarms;
    struct {
        struct rhythm rhythm;
        apc_ns shelve_max;
        struct alarm_notice notice[ALARM_NOTICES];
        size_t n_notices;
    } alarms;

    struct models models; /* of virtual time */
    char net[512];        /* of a run's record: --net, already in models; "": none */
    apc_ns start;         /* of a run's record: t = 0, UTC; 0: none */
    double past;          /* s: until then it is what was, in the run folder past_dir; 0: it has no past */
    char past_dir[EXPERIMENT_PATH];

    void *model_handle;
};

/* Which plug-ins to resolve: a client needs neither the law nor the model. */
enum experiment_parts { EXPERIMENT_MODEL = 1, EXPERIMENT_LAW = 2 };

/* From the command line, instead of what the file says; NULL: the file's. Of several controllers a law says
 * whose it is: "base=./my.so". */
struct experiment_overrides {
    const char *law, *model;
    const char *model_file; /* of a controller, "CONTROLLER=" before it where there are several; its path is
                               from the working folder */
    const struct experiment_setting *set; /* [n_set] one after another */
    size_t n_set;
};

/* As apc_experiment_set() takes it. */
struct experiment_setting {
    const char *path, *value;
};

/*
 * An experiment file or, with what is recorded there (record.conf), a run folder. Returns 0, or a negative
 * error with "FILE:LINE: ..." in why; the experiment is then empty.
 */
int experiment_load(struct experiment *e, const char *file, unsigned parts,
                    const struct experiment_overrides *overrides, struct apc_error *why);
void experiment_free(struct experiment *e);

/*
 * The number that a path leads to, of a distribution its mean; where the file does not say it the law's own,
 * or NAN: nobody knows. Returns 0, APC_ENOTFOUND (no such setting), APC_EINVAL (it is no number), APC_ENOMEM.
 */
int experiment_value(const struct experiment *e, const char *path, double *value, struct apc_error *why);

/*
 * What of the file holds the setting that a path leads to, as a line to paste: "tuning = (...);" of a
 * controller's parameter. *@line is to be freed. Returns 0, APC_ENOTFOUND or APC_ENOMEM.
 */
int experiment_line(const struct experiment *e, const char *path, char **line, struct apc_error *why);

/* The plant's parameters in the run of @p seed, p [model->np]: where the file gives a distribution, a draw
 * within the parameter's limits. Returns 0, or APC_ERANGE: none lies there. */
int experiment_draw(const struct experiment *e, uint64_t seed, double *p, struct apc_error *why);

/* The experiment's text with its model files in it, so that it is whole: *text, to be freed. Returns 0 or a
 * negative error. */
int model_files_embed(const struct experiment *e, char **text, struct apc_error *why);

/* A model file by itself (docs/experiment-file.md): transfer functions, or a state space. */
struct model_file {
    size_t inputs, outputs, nx; /* nx: of a state space */
    char (*input)[APC_TAG_LEN], (*output)[APC_TAG_LEN];
    struct apc_transfer *g;                     /* [outputs * inputs], gain 0: none; NULL: a state space */
    apc_ns period;                              /* 0: in continuous time */
    double *A, *B, *C, *D, *K, *x0, *dead_time; /* of a state space; K: NULL where it has none */
    double *u0, *y0;                            /* [inputs], [outputs] */
    double *space;                              /* its memory */
};
/* Returns 0, or a negative error with "FILE:LINE: ..." in why; model_file_free() in either case. */
int model_file_load(struct model_file *model, const char *file, struct apc_error *why);
void model_file_free(struct model_file *model);

struct record;
struct experiment_source {
    const char *file, *text;     /* file: named in messages, and where relative paths begin */
    const char *change;          /* what was changed in it, for messages; NULL: nothing */
    const struct record *record; /* of a run */
};
/* The same from its text, but for settings. */
int experiment_parse(struct experiment *e, const struct experiment_source *from, unsigned parts,
                     const struct experiment_overrides *overrides, struct apc_error *why);
/* With the settings of @overrides too, which hold over those of the text and of the record. */
int experiment_parse_changed(struct experiment *e, const struct experiment_source *from, unsigned parts,
                             const struct experiment_overrides *overrides, struct apc_error *why);

/* The text that a store has of it, to be freed in either case; *revision 0: none. Returns its length or an error. */
int experiment_text(struct apc_store *store, char **text, int64_t *revision, struct apc_error *why);
/* APC_EPERM where a law or the plant is the user's own, which not everybody may have run: "..., so @instead". */
int experiment_refuse_own(const struct experiment_source *from, const char *instead, struct apc_error *why);
/* The same, parsed. Returns 1; 0: there is none; or an error with a text in @p why. experiment_free() in any case. */
int experiment_stored(struct experiment *e, struct apc_store *store, int64_t *revision,
                      struct apc_error *why);
/* How the variables were described as of @past, an apc_store_past() of @now: *tags [*n] to be freed; NULL: as they
 * are now. @refusal: as of experiment_refuse_own(); NULL: whatever law it is. Returns 0 or an error. */
int experiment_tags_then(struct apc_store *past, struct apc_store *now, const char *refusal,
                         struct apc_tag **tags, size_t *n, struct apc_error *why);

/*
 * The text of an experiment file with the setting at @path changed or added: *changed, to be freed. @path
 * goes through groups by their members, through lists by `name` or [INDEX], and from a controller to the
 * tuning of its outputs ("controller.Kp", "controllers.base.u1.Kp"). Returns 0, APC_ENOTFOUND or APC_ENOMEM;
 * whether it is an experiment still is not looked at.
 */
int experiment_change(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why);
/* The same with @element behind those of the list at @path, which may not be there yet. */
int experiment_append(const char *text, const char *path, const char *element, char **changed,
                      struct apc_error *why);
/* The same without the setting at @path; @value is NULL. */
int experiment_remove(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why);
/* Of PATH=VALUE: the = behind PATH, NULL where there is none: one within a quoted name of a model ('a=b') is the
 * name's. */
char *setting_equals(const char *text);
/* A setting of a file as text, as a value of experiment_change(): *text, to be freed. Returns 0 or APC_ENOMEM. */
struct config_setting_t;
int experiment_setting_text(const struct config_setting_t *setting, char **text);
/* What is said anew is no longer what is on record. */
void experiment_forget(struct record *record, const char *path);

/* The first controller that selects among signals, of which @p signal is one; NULL: none. */
const struct controller *controllers_selector(const struct experiment *e, struct wire signal);
/* The controller whose setpoint it is; NULL: none. */
const struct controller *controllers_taker(const struct experiment *e, struct wire setpoint);

/* An output of a controller, with what belongs to it. */
struct controller_loop {
    const struct controller *of;
    size_t u; /* by its place among the controller's outputs */
};
/* How many there are, and number @p n of them, from 0: the one with id n + 1 in table opmode. */
size_t controllers_loops(const struct experiment *e);
struct controller_loop controllers_loop(const struct experiment *e, size_t n);
/* What runs the controller calls itself, in events: "apc-controller", of several "apc-controller base". */
void controllers_program(const struct experiment *e, const struct controller *c, char name[APC_TAG_LEN]);
/* Where the loop's parameter called @p name is among its controller's, with its id in table tuning; NULL: its law has
 * none of that name. */
double *controllers_loop_parameter(const struct controller_loop *loop, const char *name, int *id);
/* Its output. */
const struct apc_tag *controllers_output(const struct experiment *e, struct controller_loop loop);
/* Its id in table opmode, and of the operator's output in table manual. */
int controllers_loop_id(struct controller_loop loop);
/* "u", or "upper.r1" where the output is a setpoint, "trial.u" in shadow. A calculated signal has no other's
 * name. */
void controllers_loop_name(const struct experiment *e, struct controller_loop loop, char name[APC_TAG_LEN]);
/* The loop that has the setpoint as its own, and the loop that puts out the setpoint, output or signal; of is
 * NULL: none. */
struct controller_loop controllers_below(const struct experiment *e, struct wire setpoint);
/* That of this controller; NULL has none. */
struct controller_loop controllers_below_in(const struct controller *c, struct wire setpoint);
struct controller_loop controllers_above(const struct experiment *e, struct wire output);
/* All of them, as a store describes them. Returns 0 or APC_ENOMEM; loops_free() in either case. */
struct loops;
int controllers_describe(const struct experiment *e, struct loops *loops);
/* Is there a loop above it? */
bool controllers_is_below(const struct experiment *e, struct controller_loop loop);

/* Whether steps of rk4 are short enough for the plant, linear around where it starts. Returns 0, or
 * APC_ERANGE with a text in why: what should decay grows without bound then. */
int experiment_check_steps(const struct experiment *e, struct apc_error *why);

/* ---- Options of its modules, for daemons and simulation alike -------------------------------------------- */

/* How many tuning parameters it has, those of its backup law included: they stand behind its own. */
size_t controllers_parameters(const struct controller *c);

/* What its law is made from. */
struct apc_law_setup module_law_setup(const struct controller *c);

/* What is in the store before anybody writes: modes, tuning, setpoints that have an initial value. [n], to be
 * freed; NULL: out of memory. */
struct apc_sample *module_first(const struct experiment *e, apc_ns time, size_t *n);

/* How long it may be between two commands: the period of the slowest controller that gives any. */
apc_ns module_command_period(const struct experiment *e);

/* A measurement or calculated signal that did not change for so long is stale: by its own rhythm. */
apc_ns module_horizon(const struct experiment *e, struct wire wire);

/* One member of the manipulated variables as an array for the modules: out[dim.nu]. */
void module_outputs(const struct experiment *e, double *low, double *high, double *safe, double *fault);

/* The plant and the module that serves it, as the file describes them; both or, with an error in why, none. The
 * experiment must outlive them. */
int module_plant(const struct experiment *e, struct apc_plant **plant, struct apc_plantserver **server,
                 struct apc_error *why);
/* These return 0 or a negative error with its text in why. */
int module_controller(const struct experiment *e, const struct controller *c, bool real_time,
                      struct apc_controller **controller, struct apc_error *why);
int module_scheduler(const struct experiment *e, struct apc_scheduler **scheduler, struct apc_error *why);
int module_alarms(const struct experiment *e, struct apc_alarms **alarms, struct apc_error *why);
/* Id of their tick row: behind those of the controllers. */
int module_alarms_number(const struct experiment *e);
/*
 * Before the first tick of a controller, and after each: where the outputs have a switch, claim them if it
 * names this controller, and give them back if it does not; *@p claimed is whether it has them. Returns 0, or
 * the store's error; with APC_EBUSY the other one has not come to it yet.
 */
int module_take_turns(const struct controller *c, struct apc_controller *core, struct apc_store *store,
                      bool *claimed);
int module_client(const struct experiment *e, const int64_t *last, apc_ns since, struct apc_client **client,
                  struct apc_error *why);

/* How long the client waits for a reply. */
apc_ns module_patience(const struct experiment *e);

/* Severity, kind and text of what a core noticed; its kind must not be APC_NOTICE_NONE. */
void notice_event(const struct apc_notice *notice, struct apc_event *event);
/* The same of a measurement that came to lie beyond its range, or within it again. */
void notice_range(const struct apc_tag *y, bool outside, double value, struct apc_event *event);

/* ---- A controller by itself ------------------------------------------------------------------ */

/* Without store and processes: whoever has its measurements asks it, as an FMU's importer does. */
struct standalone;

enum standalone_kind {
    STANDALONE_INPUT = 1, /* measurements, those of disturbances, setpoints */
    STANDALONE_OUTPUT,
    STANDALONE_PARAMETER, /* tuning, the output in Man */
    STANDALONE_MODE       /* target mode, a whole number */
};

struct standalone_variable {
    enum standalone_kind kind;
    struct apc_tag tag;
    double start, value;
    bool changed; /* since the last tick */
};

typedef void standalone_tell_fn(void *ctx, const struct apc_notice *notice);

/* The controller @p name, NULL: the only one, and can it be by itself? Returns 0 or a negative error. */
int standalone_find(const struct experiment *e, const char *name, const struct controller **found,
                    struct apc_error *why);
/* Of the experiment file @p from. Returns 0 or a negative error. */
int standalone_create(struct standalone **standalone, const struct experiment_source *from, const char *name,
                      struct apc_error *why);
void standalone_destroy(struct standalone *s); /* NULL is legal */
const struct experiment *standalone_experiment(const struct standalone *s);
const struct controller *standalone_controller(const struct standalone *s);
/* [*n]; they live as long as @p s. */
const struct standalone_variable *standalone_variables(const struct standalone *s, size_t *n);
/* A measurement that is no number is Bad. */
void standalone_set(struct standalone *s, size_t i, double value);
/* The next tick, a period after the one before; outputs are those that the law makes of the inputs now. */
void standalone_tick(struct standalone *s, standalone_tell_fn *tell, void *ctx);

/* ---- What an operator does ------------------------------------------------------------------ */

/* What @p name stands for among the experiment's variables @p tags [n], to be read, or to be written by an
 * operator: then an output is its manual value. Returns 0, or APC_ENOTFOUND with a text in why. */
int action_find(const struct experiment *e, const struct apc_tag *tags, size_t n, const char *name,
                bool write, struct apc_tag *found, struct apc_error *why);
/* May it be set to that? 0, or APC_ERANGE with a text. */
int action_check(const struct apc_tag *tag, double value, struct apc_error *why);
/* Whose mode @p name is: a loop's, by its output or its own name, or those of all loops of a controller.
 * Fills action->to and n. Returns 0 or a negative error. */
int action_find_mode(const struct experiment *e, const char *name, enum apc_mode mode, struct action *action,
                     struct apc_error *why);
/* Promote the controller called @p name: it is to act. Fills action->to and n. Returns 0 or a negative error. */
int action_find_promotion(const struct experiment *e, const char *name, struct action *action,
                          struct apc_error *why);
/* Give the setpoint called @p name to who moves it, a loop above or the scheduler (@p remote), or take it
 * from there, as it is. Fills action->to, n and local. Returns 0 or a negative error. */
int action_find_owner(const struct experiment *e, const char *name, bool remote, struct action *action,
                      struct apc_error *why);
/* An action that has a condition, `when` and `after`, which are the caller's, instead of a time; a mistake is a
 * failure of @p s. */
struct settings;
void experiment_read_action(struct settings *s, const struct config_setting_t *group,
                            const struct experiment *e, struct action *action);
/* The same of a disturbance. */
void experiment_read_disturbance(struct settings *s, const struct config_setting_t *group,
                                 const struct experiment *e, struct apc_disturbance *change);
/* What an operator is to write: put it as owner_put() does, and an event of @p source that tells of it. An alarm
 * is acknowledged as it stands; where there is nothing to acknowledge only the event is put. Returns 0 or the store's error. */
int action_do(struct apc_store *store, const struct loops *loops, const struct apc_tag *tags, size_t n,
              const struct action *action, apc_ns now, const char *source);

/* ---- Its description in the store ----------------------------------------------------------- */

enum provision {
    PROVISION_KEEP, /* tuning and mode that are there stay: a plant that is being set up again */
    PROVISION_RESET /* tuning and mode become the file's, manual outputs nobody's: an experiment that is being
                       run */
};

#define PROVISION_TEXT 400

/*
 * Is what the store describes this experiment: the same name, the same signals with the same units? Returns
 * 0, also when it describes nothing yet, APC_EPERM with the difference in @p why, or the store's error.
 */
int provision_check(struct apc_store *store, const struct experiment *e, char why[PROVISION_TEXT]);

/* Are the signals of a description this experiment's: names, units, how many? 0, or APC_EPERM and why. */
int provision_compare(const struct experiment *e, const struct apc_tag *tag, size_t n,
                      char why[PROVISION_TEXT]);
/* What the experiment's variables are called and may be: *n of them, to be freed; NULL without memory. */
struct apc_tag *provision_tags(const struct experiment *e, size_t *n);

/* The experiment must have been loaded with its law. Returns 0 or the store's error. */
int provision(struct apc_store *store, const struct experiment *e, enum provision how);

/* ---- Record --------------------------------------------------------------------------------- */

/*
 * record.conf in a run folder: what was in force beside what run.conf, the experiment file as it was, says.
 * Whoever loads DIR/run.conf, or DIR, gets what ran, with the plug-ins that lie there.
 */

#define RECORD_FILE     "record.conf"
#define PAST_FOLDER     "past" /* of what was until it went on otherwise, a run folder within */
#define RECORD_HASH_LEN 65     /* SHA-256 in hexadecimal digits */
#define RECORD_LAW_LEN  64     /* of the name of a file in the folder */

/* A law or a model of the run. */
struct record_plugin {
    char name[512]; /* built in, or the path of the copy in the run folder; "": there is no record */
    bool chosen;    /* by --law or --plant: its own tuning or parameters held, not the file's */
};

struct record {
    bool there;
    apc_ns start;    /* t = 0: UTC; 0: in virtual time */
    double duration; /* s that it ran or, where it never came to its end, was to run; 0: not known; NAN: what
                        the file says holds */
    double past;     /* s: until then it is what the folder past in it says; 0: it has none */
    uint64_t seed;
    bool file_seed; /* instead of it the file's holds */
    char net[512];  /* --net, "" without */
    struct record_plugin model;
    struct record_plugin *law; /* [n_laws] of each controller, in the order of the file */
    size_t n_laws;
};

/*
 * What is recorded beside the experiment file @p file, which is a run's only when it is called run.conf.
 * Returns 0, also when there is nothing, or a negative error: damaged, or a file is not the one that ran.
 * record_free() in either case.
 */
int record_read(struct record *record, const char *file, struct apc_error *why);
void record_free(struct record *record);

/* The file of an experiment, of a run folder its run.conf: *text, to be freed, and what is recorded beside it. Returns 0
 * or a negative error. */
int experiment_read(const char *name, char path[EXPERIMENT_PATH], struct record *record, char **text,
                    struct apc_error *why);

/*
 * Fault number @p i: those of the experiment's measurements, then those of its outputs. Behind these stands one of each kind
 * for each of them, the link, each controller, disturbance and parameter of the plant, which waits for an instructor: when it
 * begins, since the plant's first tick, and its numbers are of this run (LOOPS_FAULT). kind NULL: there are no more.
 */
#define FAULT_NEVER INT64_MAX
enum fault_number {
    FAULT_SIZE,
    FAULT_JUMP,
    FAULT_LOW,
    FAULT_HIGH,
    FAULT_DURATION, /* s; 0: for ever */
    FAULT_AT,       /* s since the start, not earlier */
    FAULT_IF,       /* enum fault_if: once it is true as well */
    FAULT_IF_TABLE, /* of what variable */
    FAULT_IF_ID,
    FAULT_IF_LIMIT,
    FAULT_BECAME, /* enum fault_became, as the simulation has seen; 0: nothing yet */
    FAULT_NUMBERS
};
enum fault_became { FAULT_BEGAN = 1, FAULT_HELD /* it goes no farther: the model takes no more */ };
enum fault_if {
    FAULT_IF_NONE,
    FAULT_IF_BELOW,
    FAULT_IF_NOT_ABOVE,
    FAULT_IF_ABOVE,
    FAULT_IF_NOT_BELOW,
    FAULT_IF_ALARM
};
struct experiment_fault {
    const char *signal, *kind;
    enum fault_of of;
    size_t k; /* which of them */
    apc_ns *at, *duration;
    double *number[FAULT_HIGH + 1]; /* NULL: it has none */
    unsigned takes;                 /* of FAULT_SIZE to FAULT_HIGH, 1 << each: its kind */
    int row;                        /* id of LOOPS_FAULT() */
    int numbers; /* id of the first of LOOPS_FAULT_NUMBER(); 0: they are the experiment's */
    bool of_file;
};
struct experiment_fault experiment_fault(const struct experiment *e, size_t i);
/* Of these last ones, of a measurement or an output. */
#define EXPERIMENT_SENSOR_KINDS   ((size_t)APC_FAULT_FROZEN)
#define EXPERIMENT_ACTUATOR_KINDS ((size_t)APC_ACTUATOR_POWER)
/* Its place among the plant's; n_faults: there is none. @kind NULL: of any. */
size_t experiment_find_plant_fault(const struct experiment *e, const char *signal, const char *kind);

/* Those of the experiment of a store. */
struct faults {
    struct experiment e;
    struct apc_sample *row;    /* [n] newest of each, seq 0: nobody started or stopped it */
    struct apc_sample *number; /* [n * FAULT_NUMBERS] */
    size_t n;
};
enum fault_state { FAULT_WAITS, FAULT_TIMED, FAULT_STARTED, FAULT_STOPPED, FAULT_AT_LIMIT };
/* Returns 0 or an error with a text in @p why; faults_close() in either case. */
int faults_open(struct faults *f, struct apc_store *store, struct apc_error *why);
void faults_close(struct faults *f);
/* Is it the experiment's, or has somebody started it? */
bool faults_listed(const struct faults *f, size_t i);
enum fault_state faults_state(const struct faults *f, size_t i);
const char *fault_state_name(enum fault_state state);
/* How somebody has started it, as faults_find() reads it; "": it has nothing of that. */
#define FAULT_TEXT 320
const char *faults_words(const struct faults *f, size_t i, char text[FAULT_TEXT]);
struct text;
void faults_json(const struct faults *f, struct text *t);

/* What somebody starts or stops. */
struct fault_order {
    size_t i; /* SIZE_MAX: the power of the plant, of all its sensors and actuators */
    double number[FAULT_NUMBERS];
};
/*
 * "3", as they are listed; or "y bias size=2 at=50 duration=10 when=u > 3", where what follows the kind may be left out but
 * for what the kind takes, and to stop it altogether. Returns 0, or APC_EINVAL or APC_ENOTFOUND with a text in @p why.
 */
int faults_find(const struct faults *f, const char *text, bool start, struct fault_order *order,
                struct apc_error *why);
/* At the next tick of the plant it starts or stops. Returns 0 or the store's error. */
int faults_order(const struct faults *f, struct apc_store *store, const struct fault_order *order, bool start,
                 const char *who);

/* The folder of the run whose run.conf @p e was read from; false: it is no run's. */
bool experiment_run_dir(const struct experiment *e, char dir[EXPERIMENT_PATH]);

/* Where a run's data are and its record goes, as it was named to people; "": not recorded. */
struct record_stores {
    char live[128], history[512];
};

/* Those of the run folder @p dir. Returns 0, or a negative error: it is none, or its record is damaged. */
int record_stores(struct record_stores *stores, const char *dir, struct apc_error *why);

/*
 * What made a run, of which each may give other bits: CVODE is another solver in another version, and is not always a
 * part of libapc.
 */
struct record_build {
    char libapc[16], cvode[32], machine[32]; /* "": not recorded */
};

/* This one. */
void record_build_here(struct record_build *build);
/* That of the run folder @p dir. Returns 0, or a negative error: it is none, or its record is damaged. */
int record_build(struct record_build *build, const char *dir, struct apc_error *why);

/* SHA-256 of a file. Returns 0, or a negative error with the reason in why. */
int record_hash(const char *path, char hash[RECORD_HASH_LEN], struct apc_error *why);

#endif
