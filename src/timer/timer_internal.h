/* SPDX-License-Identifier: BSD-3-Clause */
/* What the files of the timer room share. An executive is one file behind struct apc_executive_ops. */
#ifndef APC_TIMER_INTERNAL_H
#define APC_TIMER_INTERNAL_H

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include "apctimer.h"

#define APC_TASK_NAME_LEN    16 /* what the kernel keeps of a thread's name, with its terminator */
#define APC_PRIORITY_DEFAULT 80

/* ---- grid.c ---- */

/** The newest tick whose instant is not after @p now, but never one before @p due. */
uint64_t apc_grid_newest(apc_ns start, apc_ns period, uint64_t due, apc_ns now);
/** The tick to wait for when tick @p index has ended at @p now: the first not yet past, @p index + 1 or
 * later. */
uint64_t apc_grid_resume(apc_ns start, apc_ns period, uint64_t index, apc_ns now);

/* ---- spin_margin.c ---- */

#define APC_MARGIN_WINDOW 1000
#define APC_MARGIN_BINS   512 /* of a microsecond; the last takes all that is longer */

struct apc_margin {
    apc_ns margin, cap;
    unsigned n, at;        /* how many of the ring are filled, and which is next */
    unsigned level, above; /* the percentile, and how many are above it */
    uint16_t ring[APC_MARGIN_WINDOW], bin[APC_MARGIN_BINS];
};

/** The margin of a task of @p period that has learned nothing: as long as it may be. */
void apc_margin_init(struct apc_margin *m, apc_ns period);
/** Take into account that a wake-up came so late. [tick] */
void apc_margin_learn(struct apc_margin *m, apc_ns lateness);

/* ---- machine.c ---- */

/** A descriptor to be kept open, or -1. */
int apc_hold_latency(struct apc_log *log);
void apc_lock_memory(struct apc_log *log);

/* ---- executive.c ---- */

/** One implementation. A task's thread or timer lives in task->own. */
struct apc_executive_ops {
    const char *name;
    bool spins;     /* its tasks can */
    bool own_clock; /* it is one, and takes no other */
    int (*open)(struct apc_executive *executive);
    void (*close)(struct apc_executive *executive);
    int (*prepare)(struct apc_task *task); /**< allocate task->own */
    int (*start)(struct apc_task *task, struct apc_error *why);
    void (*halt)(struct apc_task *task); /**< no tick runs, and none will, once it returns */
    void (*release)(struct apc_task *task);
};

extern const struct apc_executive_ops apc_executive_deadline;
extern const struct apc_executive_ops apc_executive_posix;
extern const struct apc_executive_ops apc_executive_virtual;

struct apc_executive {
    const struct apc_executive_ops *ops;
    const struct apc_clock *mono; /* waits and periods: the system's, unless time itself is virtual */
    const struct apc_clock *utc;  /* stamps only: may be injected */
    struct apc_log *log;
    atomic_uint tasks;
    atomic_bool warned; /* of a refused priority: once is enough */
    int latency;        /* descriptor of the held latency, or -1 */
    apc_ns begin;       /* UTC, of virtual time */
    void *own;
};

/* ---- task.c ---- */

enum apc_task_state {
    APC_TASK_IDLE = 1, /* made, not started */
    APC_TASK_STARTING,
    APC_TASK_STARTED,
    APC_TASK_STOPPING,
    APC_TASK_STOPPED
};

struct apc_task {
    struct apc_executive *executive;
    apc_task_fn fn;
    void *ctx;
    struct apc_task_options options; /* checked, defaults filled in */
    char name[APC_TASK_NAME_LEN];
    void *own;

    /* Shared by the callers of start, stop and wait; a tick takes it only to end the task. */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    enum apc_task_state state;
    bool ended; /* by itself */
    int result;

    _Atomic pthread_t runner; /* the thread inside the callback, else 0, which is no thread in glibc */

    /* The tick's own: one thread at a time, handed over by the executive with a lock or a join. */
    apc_ns epoch;      /* monotonic time of tick 0; before 0 when that was long ago */
    uint64_t due;      /* every tick before it has run or is counted as missed */
    uint64_t expected; /* 1 + index of the last call: what the next has if nothing is missed */
    apc_ns started;    /* last call */

    /* Written by the tick, read by anyone. */
    _Atomic uint64_t ticks, missed;
    _Atomic uint64_t in_a_row, alarms; /* of missed, and how often that came to APC_OVERRUN_ALARM */
    _Atomic apc_ns next;               /* the instant of `due`; INT64_MAX when there is none to come */
    _Atomic apc_ns spin_margin, spun,
        lasted; /* spun: time spent on it out of the time that the task lasted */
    struct apc_histogram *lateness, *jitter, *run;
};

/** Fix the grid, and the first tick to run: as the options say, or now. */
void apc_task_begin(struct apc_task *task);
/** The instant of the next tick. */
apc_ns apc_task_due(const struct apc_task *task);
bool apc_task_is_due(const struct apc_task *task);
/** Run the tick that is due. False: the task has ended and must not be ticked again. [tick] */
bool apc_task_tick(struct apc_task *task);

/* ---- thread.c ---- */

/**
 * Attributes for the threads of @p task that pthread_create() has been seen to accept: stack, signals
 * blocked, CPU, SCHED_FIFO or, when that is not permitted, SCHED_OTHER. To be destroyed by the caller.
 */
int apc_task_thread_attr(struct apc_task *task, pthread_attr_t *attr, struct apc_error *why);
/** Every signal but those a fault raises: handlers belong on the application's own threads. */
void apc_task_signals(sigset_t *set);
/** The CPU that the options ask for, which is not "any". */
void apc_task_cpus(const struct apc_task *task, cpu_set_t *cpus);
/** Touch all of the calling thread's stack, so that no tick takes a page fault for it. */
void apc_task_touch_stack(void);

#endif
