/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the four daemons have in common: options, experiment, log, signals, one periodic task, and the
 * records of it. The main thread waits for a signal; meanwhile, over a store connection of its own, it
 * records events and the timing of the task, so that nothing of that stands in the task's way. A third thread
 * (process_watchdog.h) looks after the two.
 */
#ifndef APC_DAEMON_H
#define APC_DAEMON_H

#include <stdatomic.h>

#include <apcmodules.h>
#include <apcsockets.h>
#include <apcstore.h>
#include <apctimer.h>

#include "common/option.h"
#include "experiment/experiment.h"

struct daemon;

struct program {
    const char *name;                 /* "apc-controller" */
    const char *doc;                  /* one paragraph for --help */
    const char *task;                 /* "client": of the timing rows */
    unsigned parts;                   /* enum experiment_parts */
    bool ordinary;                    /* its ticks need no real time: they run under SCHED_OTHER, and
                                         its memory is not locked */
    bool store_optional;              /* runs without a store, then keeps no records */
    const char *spools;               /* "measurements": what the task writes is spooled; NULL: it is not */
    const struct option_spec *extra;  /* options of its own, or NULL; they go into `own` */
    void (*choose)(struct daemon *d); /* after the experiment was read: which part of it this is, by d->name
                                         and d->task_name. It exits where there is none. NULL: as above */
};

struct daemon_options {
    const char *config, *store, *spool, *timer, *log_level, *start, *after;
    bool spin, hold_latency;
    struct experiment_overrides overrides;
    void *own;
};

struct recorder;
struct process_watchdog;

/* What was last said of a spool. */
struct spool_watch {
    bool waiting;
    apc_ns age; /* the greatest while something waits */
    uint64_t drained, damaged;
    int blocked;
    bool instead; /* it is in memory */
};

struct daemon {
    const struct program *program;
    char name[APC_TAG_LEN]; /* of who writes, in messages, events, claims and spools */
    const char *task_name;  /* in timing rows */
    struct daemon_options options;
    struct experiment experiment;
    struct apc_log *log;
    struct apc_executive *executive;
    struct recorder *recorder;
    struct process_watchdog *process_watchdog;
    apc_ns start; /* UTC of t = 0, as given by --start; 0: not given */
    bool asks;    /* it is not known yet: daemon_store() asks for it, or else daemon_run() */
    bool has_store;
    apc_ns store_timeout; /* of the task's store; see daemon_timeout() */
    apc_ns store_pause;   /* longest before it is tried again; 0: the library's default */
    apc_ns (*look)(
        void *ctx); /* called by the main thread, with look_ctx, once a second and as much sooner as it says;
                                * may be NULL */
    void *look_ctx;
    struct spool_watch records, task; /* the main thread's; the task's */

    apc_task_fn tick;
    void *tick_ctx;
    _Atomic bool inside; /* the tick */
    _Atomic bool idle;   /* its ticks do nothing that a timing row is for */
    bool began;          /* there was a tick */
    int64_t last;        /* that a predecessor ran; -1: none is known */
};

/* Read the command line, the environment and the experiment. Returns 0, or an error already reported;
 * --help and --version exit. daemon_close() in either case. */
int daemon_open(struct daemon *d, const struct program *program, void *own, int argc, char **argv);

/* How long one operation of a store may keep a task of this period: two of them leave it well within the time
 * after which it counts as hung, and connecting takes some tens of milliseconds. */
apc_ns daemon_timeout(apc_ns period);

/* Open the task's store and become the one writer of @variables, as by apc_store_claim_set(). Waits some
 * seconds for a dead predecessor's claim to go. Returns 0, 1 when a signal came meanwhile, or an error
 * already reported. */
int daemon_store(struct daemon *d, struct apc_store **store, struct apc_sample *variables, size_t n);

/* The store of the main thread, for d->look; NULL: there is none. */
struct apc_store *daemon_records(const struct daemon *d);

/* After the task has used its store: tell of what its spool holds back, and has stored later. [tick] */
void daemon_spool(struct daemon *d, const struct apc_store *store);

/* What a tick returns for the outcome of its store operations: 0 to go on and try again, or, after saying so,
 * the error that ends the daemon: another writer has the table, or the schema is not ours. [tick] */
int daemon_fatal(struct daemon *d, const struct apc_store *store, int rc);

/* Run tick on the experiment's grid until a signal comes or the task fails. The index in the tick counts
 * from the run's t = 0, or, without --start, from 1970 (so that every machine has the same grid). A tick that
 * does not return does not keep the process: it then ends here. */
int daemon_run(struct daemon *d, struct rhythm rhythm, apc_task_fn tick, void *ctx);

/* Queue an event for the records and log it. Never waits. [tick] */
void daemon_event(struct daemon *d, enum apc_event_severity severity, const char *kind, const char *fmt, ...)
    APC_PRINTF(4, 5);
/* The same of what came to pass at @p mono, before it was noticed. [tick] */
void daemon_event_at(struct daemon *d, apc_ns mono, enum apc_event_severity severity, const char *kind,
                     const char *fmt, ...) APC_PRINTF(5, 6);
/* The event of a core's notice, if there is one. [tick] */
void daemon_notice(struct daemon *d, const struct apc_notice *notice);
/* Likewise. [tick] */
void daemon_notice_at(struct daemon *d, const struct apc_notice *notice, apc_ns mono);

/* Say on stderr why the program ends. Returns err. */
int daemon_error(const struct daemon *d, int err, const char *fmt, ...) APC_PRINTF(3, 4);

/* Free everything. Returns the exit code for rc. */
int daemon_close(struct daemon *d, int rc);

#endif
