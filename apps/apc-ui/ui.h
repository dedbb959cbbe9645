/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The daemon's parts and threads:
 *
 *     server   (one, libmicrohttpd's)  takes requests, answers what is in memory, feeds the streams
 *     writers, readers  (some)         answer what takes a store, or long: each has a store of its own
 *     computer (one)                   answers what is computed from the record
 *     live     (one)                   waits in the store for newer samples: model, stream, writes
 *     records  (one)                   looks each second for events, timing, descriptions, users
 *     behind   (one)                   asks how far the history is behind the live store, where there are two
 *     main                             signals; each second the beat and what has to be closed
 *
 * The model is what is newest, under one mutex that nobody holds while he waits for anything else.
 */
#ifndef APC_UI_H
#define APC_UI_H

#include <stdatomic.h>

#include <apcalarm.h>
#include <apcstore.h>
#include <apctimer.h>

#include "apc-ui/plant/plant.h"
#include "apc-ui/plant/writes.h"
#include "apc-ui/server/session.h"
#include "apc-ui/server/stream.h"
#include "common/room.h"
#include "record/record.h"

struct files;
struct server;

struct ui_options {
    const char *store, *listen, *users, *page, *tls_cert, *tls_key, *spool;
    const char *graphic;  /* the file of the drawing; NULL: CONFIG's name, with .svg, if there is one */
    const char *displays; /* the folder of displays; NULL: CONFIG's name, with .displays */
    const char *plants;   /* the file of the addresses of other plants' pages, or NULL */
    const char *names[8]; /* --name, up to a NULL */
    bool allow_plaintext;
    double session; /* s */
    double idle;    /* s until the page logs out who may write; 0: it does not */
};

/* Figures of a histogram of the last minutes. */
struct duration_stats {
    pthread_mutex_t mutex;
    struct apc_histogram *past, *now; /* `now` becomes `past` when it is old enough */
    apc_ns since;
    uint64_t count; /* since the start */
    double sum;     /* s */
};
int duration_stats_init(struct duration_stats *m);
void duration_stats_free(struct duration_stats *m);
void duration_stats_record(struct duration_stats *m, apc_ns value);
void duration_stats_summary(struct duration_stats *m, struct apc_summary *summary);

/* What a task said last about one quantity, or about all of them since the daemon began. */
struct task_figures {
    apc_ns time; /* end of the window, UTC */
    uint64_t count;
    double mean, sum; /* ns; s */
    apc_ns p50, p99, max;
};

enum { LATENESS = 0, JITTER, RUN, QUANTITIES };
extern const char *const quantity_names[QUANTITIES];

#define TASKS 64
#define LINKS 16

struct task {
    char name[32];
    apc_ns period, heard; /* heard: when the last window came, monotonic */
    uint64_t missed, missed_total;
    struct task_figures last[QUANTITIES], total[QUANTITIES];
};

struct link_state {
    char name[32];
    bool up;
    apc_ns since;
    char text[192];
    uint64_t changes;
};

#define TROUBLE_LEN 192

/* What stands, whatever scrolls away: told by events, judged by ticks. */
struct standing {
    bool external;                /* the plant, as far as anybody has said */
    int safe;                     /* it is at its safe value or, external, given no command: 1, 0; -1:
                                     nobody has said */
    apc_ns safe_since;            /* UTC */
    char (*trouble)[TROUBLE_LEN]; /* [loops] what was complained of last and has not been taken back, or "" */
};

/* What the history has not got of the live store. */
struct behind {
    int state; /* 1; 0: there is one store, or nobody has looked yet; negative: it is away, the error */
    uint64_t rows;
    bool nothing;        /* it has no row yet, and late means nothing */
    apc_ns late, oldest; /* oldest: source time of the oldest sample in memory, UTC; 0: none */
    char why[300];
};

/* How a simulated plant went when it was looked at last. */
struct simulated_plant {
    apc_ns latest; /* UTC of the plant, as far as it was seen */
    bool rewound;  /* it was later once: what is known of it never was */
    int state;     /* 1; 0: its time is real; APC_ESTATE: nobody simulates it any more, or another error */
    struct apc_store_clock clock;
    char why[300];
};

struct model {
    pthread_mutex_t mutex;
    struct simulated_plant simulated;
    struct plant plant;
    struct apc_sample *now; /* [count] as plant.tag; behind them what became of all that people may want */
    apc_ns *moved;          /* [count] monotonic: when the seq was last seen to move; 0: never */
    size_t count;
    struct apc_vector *tick;  /* [plant.loops.n_controllers] no element of them, only when they were */
    apc_ns *ticked;           /* [plant.loops.n_controllers] as moved */
    struct apc_vector alarms; /* of who evaluates them, without value; id 0: there are none */
    double alarm_numbers[APC_ALARMS_TICK];
    apc_ns alarms_period, alarms_ticked;  /* as the controllers' */
    int64_t catalogue;                    /* its revision: also what an alarm says is described there */
    struct text alarms_are, alarms_stand; /* as JSON; empty: there are none */
    struct text plant_zipped;             /* what is told of all that; empty: it is to be made */
    unsigned zipped_of;                   /* revision of the plant then */
    bool connected;
    apc_ns since; /* UTC */
    char error[300];
    uint64_t connects;
    struct apc_store_room
        room; /* of the live store; cells_max 0: it has no fixed one, or nobody has looked */
    struct task task[TASKS];
    size_t tasks;
    struct task exchange; /* apc-client's with the plant: only RUN */
    struct link_state link[LINKS];
    size_t links;
    struct apc_spool_stats spool; /* of all spools of the folder */
    struct text ramps;            /* what is on one, as JSON; empty: nothing is */
    struct standing standing;
    struct behind looked, behind; /* of the last look; what is told */
};

/* ---- server/audit.c ---- */
#define REFUSED 32

struct audit {
    pthread_mutex_t mutex;
    struct apc_event event[256]; /* that wait for the store */
    size_t waiting;
    struct refusals { /* of one user, or of all strangers */
        struct apc_event last;
        apc_ns due;
        uint64_t more; /* that have no row yet */
    } refused[REFUSED];
};

struct ui;
int audit_init(struct audit *audit);
void audit_free(struct audit *audit);
/* Write an event, now or as soon as the store takes it. */
void audit(struct ui *ui, struct apc_store *store, const struct apc_event *event);
/* Something was tried and refused. A flood of them leaves a row now and then, with their number. */
void audit_refusal(struct ui *ui, const char *user, const char *address, const char *what, const char *why);
/* What waits. Returns 0 or the store's error. */
int audit_flush(struct ui *ui, struct apc_store *store);

/* ---- api/api_alarm.c ---- */
/* The alarms as the handlers know them: who writes waits for nobody who reads long. */
enum { DESK_PAST = 0, DESK_WRITES, DESK_TRIAL, DESKS };
struct desk {
    pthread_mutex_t mutex; /* held while the store is asked */
    struct alarm_summary board;
};
int desks_init(struct desk desk[DESKS]);
void desks_free(struct desk desk[DESKS]);

/* ---- api/api_plants.c ---- */
/* The plants of the database, as they were told last. */
struct listing {
    pthread_mutex_t mutex; /* held while the store is asked */
    struct text json;
    char why[320]; /* they could not be told; "": they were */
    apc_ns made;   /* monotonic; 0: never */
};
int listing_init(struct listing *listing);
void listing_free(struct listing *listing);

/* ---- api/api_health.c ---- */
/* What was judged of the loops, in the windows that were asked for last. */
struct judged;
struct verdicts {
    struct judged *kept; /* of the thread that computes alone */
    pthread_mutex_t mutex;
    struct loop_verdict {
        char name[APC_TAG_LEN];
        const char *health;
    } * loop; /* [n] of the newest window that is complete */
    size_t n;
    apc_ns until; /* its end, UTC; 0: there is none */
};
int verdicts_init(struct verdicts *verdicts);
void verdicts_free(struct verdicts *verdicts);

struct ui {
    struct ui_options options;
    struct apc_log *log;
    struct model model;
    struct stream *stream;
    struct writes *writes;
    struct sessions sessions;
    struct backoff backoff;
    struct duration_stats reads, stores, lag; /* reading, writing; source time to message */
    pthread_mutex_t users_mutex;
    char users_path[4096];
    struct users users, tokens;
    _Atomic bool open; /* no users: who runs the server is engineer, on this host */
    bool tls;
    int port;
    apc_ns began;
    struct files *files;
    struct text graphic; /* an SVG; empty: there is none */
    char displays[4096]; /* their folder; "": there is none */
    struct server *server;
    _Atomic apc_ns round[2];      /* when the live and the records thread began their last one, monotonic */
    _Atomic uint32_t stopping;    /* what pauses waits for it: ui_stop() */
    _Atomic unsigned writing;     /* requests that a writer has not done with yet */
    _Atomic uint64_t requests[6]; /* answered, by the hundreds of their status */

    struct audit audit;
    struct desk desk[DESKS];
    struct listing listing;
    struct verdicts verdicts;
};

/* ---- server/ui.c ---- */
int ui_open_store(struct ui *ui, const char *name, apc_ns timeout, struct apc_store **store,
                  struct apc_error *why); /* timeout 0: the library's default */
/* Wait a little, unless it is time to stop. */
void ui_pause(struct ui *ui, apc_ns pause);
void ui_stop(struct ui *ui); /* its threads end, and no pause goes on */

/* ---- server/users.c ---- */
/* Take the files of users and tokens as they are now; damaged: of each, that it is, and it was said. */
void ui_look_users(struct ui *ui, bool damaged[2]);

/* ---- plant/model.c ---- */
int model_init(struct model *m);
void model_free(struct model *m);
/* Read them from the store. Returns 0 or its error. */
int model_load(struct model *m, struct apc_store *store);
/* Of an event: what of it stands. */
void model_take_event(struct model *m, const struct apc_event *event);
void model_state_json(struct ui *ui, struct text *t);
apc_ns model_age(const struct model *m, size_t i, apc_ns now); /* locked; < 0: no sample yet */
/* It should come again and again, and did not in time, or never did. Locked. */
bool model_stale(const struct model *m, size_t i, apc_ns now);
/* How long ago a controller ticked, as it was seen to. < 0: it never did. Locked. */
apc_ns model_tick_age(const struct model *m, size_t controller, apc_ns now);

/* Does the controller tick? 1, 0; -1: how often it should is not known. Locked. */
int model_ticks(const struct model *m, size_t controller, apc_ns now);
bool model_alarms_live(const struct model *m, apc_ns now); /* somebody evaluates them. Locked. */
/* What does not tick, a line each, for people. Returns how many. Locked. */
size_t model_silent(const struct model *m, apc_ns now, struct text *t);
void control_json(const struct model *m, apc_ns now, struct text *t); /* locked */
void model_store(struct ui *ui, bool connected, const char *error);
void model_room(struct ui *ui, const struct apc_store_room *room);
/* It is full: what is said of that; @named: with the variable's name. Returns whether it is. Locked. */
bool model_full(const struct model *m, bool named, char text[ROOM_LEN]);
void store_state_members(const struct model *m, struct text *t); /* locked */
bool model_connected(struct ui *ui);

/* ---- plant/alarms.c ---- */
struct alarm_watch {
    struct alarm_summary board;
    struct alarm_told { /* of one alarm, what was told of it */
        struct text json;
        int64_t seq;
        apc_ns shelved;
        bool first_out;
    } * told;           /* [board.e.n_alarms]; NULL: there are none */
    int64_t looked;     /* seq of the tick row at the last look; 0: there was none */
    double transitions; /* the number of the last one then */
};
/* Which there are, by the catalogue: into the model. Returns 0 or the store's error: what is wrong with a
 * catalogue is no reason to show nothing of the plant. */
int alarm_watch_describe(struct alarm_watch *watch, struct ui *ui, struct apc_store *store);
/* How they stand, if by the newest tick row of apc-alarms that may be new: into the model and the stream. */
int alarm_watch_look(struct alarm_watch *watch, struct ui *ui, struct apc_store *store,
                     const struct apc_vector *tick);
void alarm_watch_free(struct alarm_watch *watch);

/* ---- plant/alarms_json.c ---- */
void alarms_described_json(const struct experiment *e, struct text *t);
void alarm_stands_json(const struct alarm_now *now, struct apc_store *store, struct text *t);
/* Members of the two: what an alarm is, whatever becomes of it, and how it stands. */
void alarm_described_members(const struct alarm *alarm, struct text *t);
void alarm_stands_members(const struct alarm_now *now, struct apc_store *store, struct text *t);
void alarm_author_member(struct apc_store *store, uint32_t author, struct text *t);

/* ---- plant/history_lag.c ---- */
/* A look at it. What is seldom written is for a moment as late as it is seldom: two looks must agree on it. */
void model_behind(struct model *m, const struct behind *now);
void behind_json(const struct model *m, struct text *t); /* locked */

/* ---- plant/simulated.c ---- */
/* Returns whether it goes back, or its simulation is about to begin. */
bool model_look_simulated(struct model *m, struct apc_store *store);
/* store_simulated(); one that begins, once somebody has gone back, is that of the simulated plant already. */
int model_simulated(struct model *m, struct apc_store *store, struct apc_store_clock *clock,
                    struct apc_error *why);
void simulated_json(const struct model *m, struct text *t); /* locked */
bool model_rewound(struct model *m);

/* ---- threads, in plant: until ui->stopping; arg is the ui ---- */
void *live_thread(void *arg);
void *records_thread(void *arg);
void *behind_thread(void *arg);

/* ---- plant/records.c ---- */
void event_json(const struct apc_event *event, struct text *t);
void task_json(const struct task *task, apc_ns now, struct text *t);
void summary_json(const struct apc_summary *summary, struct text *t);
void window_json(const struct task_figures *window, struct text *t); /* NULL, or nothing in it: null */

#endif
