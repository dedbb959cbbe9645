/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apctimer.h
 * The first principle of the paper: timers and threads. Periodic tasks on an executive, their timing
 * statistics, and the paper's own wrapper of POSIX interval timers (section "Timers and Threading").
 * Needs POSIX.1-2008, which gcc's own dialects give; with -std=c11 define _POSIX_C_SOURCE as 200809L.
 */
#ifndef APCTIMER_H
#define APCTIMER_H

#include <signal.h>
#include <time.h>

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- The paper's functions (Listings 1 and 2) --------------------------------------------- */

/**
 * A POSIX interval timer that calls @p fnc in a thread of its own (SIGEV_THREAD), as in Listing 2, on
 * CLOCK_MONOTONIC. Returns the timer, or (timer_t)0 with errno set (with glibc, 0 is never a timer of this
 * kind). Delete it with timer_delete().
 *
 * Such a timer gives fewer guarantees than a task below. Callbacks of one timer may overlap when one takes
 * longer than the period. One may still run, or even begin, after stop_apctimer() and timer_delete()
 * returned, so @p args must outlive them. Missed ticks are not counted. [setup]
 */
APC_API timer_t create_apctimer(void (*fnc)(union sigval), void *args);
/**
 * First call at once, then every @p Ts seconds. Returns 0, APC_EINVAL (@p Ts not 10 us to 366 days, or
 * timer 0) or APC_ESYS. [setup]
 */
APC_API int start_apctimer(timer_t timer, double Ts);
/** No further expiry. A callback on its way still runs. Returns 0, APC_EINVAL (timer 0), APC_ESYS. [setup] */
APC_API int stop_apctimer(timer_t timer);

/* ---- The grid ----------------------------------------------------------------------------- */

/**
 * Ticks lie on start + k * period, k = 0, 1, ..., whatever happened before: a late tick never moves
 * the next one. Pure functions. @p period must be > 0.
 */

/** Time of tick @p index. Saturates at INT64_MAX. [tick] */
APC_API apc_ns apc_grid_time(apc_ns start, apc_ns period, uint64_t index);
/** Smallest index whose time is >= @p now; 0 before the start. [tick] */
APC_API uint64_t apc_grid_next(apc_ns start, apc_ns period, apc_ns now);

/* ---- Timing statistics -------------------------------------------------------------------- */

/**
 * A log-linear histogram of signed nanoseconds in the manner of HdrHistogram. It is exact below 256 ns; above
 * that buckets are less than 1 % of their value. Anything beyond +-(2^42 - 1) ns (73 min) counts as that. No
 * allocation after create; one writer, any readers, and neither waits for the other.
 */
struct apc_histogram;

APC_API int apc_histogram_create(struct apc_histogram **histogram);  /**< [setup] 0 or APC_ENOMEM */
APC_API void apc_histogram_destroy(struct apc_histogram *histogram); /**< NULL is legal. [setup] */
APC_API void apc_histogram_record(struct apc_histogram *histogram, apc_ns value); /**< one thread. [tick] */
APC_API void
apc_histogram_clear(struct apc_histogram *histogram); /**< while no other thread writes it. [any] */
/** Add all of @p from, which may be running, to @p to, which no other thread writes meanwhile. [any] */
APC_API void apc_histogram_merge(struct apc_histogram *to, const struct apc_histogram *from);
/**
 * What @p live recorded since @p mark last saw it goes into @p window (its old content is lost), and
 * @p mark, empty at first, catches up: the way to cut a running histogram into windows. A window's min
 * and max are within 1 %. [any; @p mark and @p window are the caller's alone]
 */
APC_API void apc_histogram_window(struct apc_histogram *window, struct apc_histogram *mark,
                                  const struct apc_histogram *live);

/**
 * In nanoseconds; zeros when count is 0. Count, mean, sd (of a sample: n - 1), min and max are exact and of
 * one instant. p50, p99 and p999 are by nearest rank: the smallest recorded value that 50, 99 or 99.9 % of
 * all do not exceed, to within 1 %.
 */
struct apc_summary {
    uint64_t count;
    double mean, sd;
    apc_ns min, p50, p99, p999, max;
};
/** Also while it is being written. [any] */
APC_API void apc_histogram_summary(const struct apc_histogram *histogram, struct apc_summary *summary);

/** One filled bucket: @p low <= value <= @p high. */
struct apc_bin {
    apc_ns low, high;
    uint64_t count;
};
/**
 * Up to @p capacity filled buckets in rising order into @p bins. Returns how many there are in all;
 * call with capacity 0 to ask. [any]
 */
APC_API size_t apc_histogram_bins(const struct apc_histogram *histogram, struct apc_bin *bins,
                                  size_t capacity);

/** What a task knows of its own timing. */
struct apc_timing {
    size_t size;                 /**< sizeof the struct, set by the caller: no more than that is filled */
    uint64_t ticks;              /**< calls that returned */
    uint64_t missed;             /**< as apc_task_missed() */
    struct apc_summary lateness; /**< started - scheduled */
    struct apc_summary jitter;   /**< (t_{k+1} - t_k) - period of started, where no tick was missed between */
    struct apc_summary run;      /**< time in the callback */
    apc_ns spin_margin;          /**< how long before its tick the task wakes up now; 0 without spin */
    double spin_share;           /**< of one CPU, spent on spinning, from the start to the last tick */
};

/* ---- Executives and tasks ----------------------------------------------------------------- */

/** The arguments of one call of a task. Times are monotonic except utc. */
struct apc_tick {
    uint64_t index; /**< k of the grid, from 0 (aligned: from the first k to come); missed ticks leave gaps */
    apc_ns scheduled; /**< start + k * period */
    apc_ns started;   /**< when the callback really began */
    apc_ns utc;       /**< wall clock at that instant, for records */
    uint64_t missed;  /**< ticks skipped since the previous call */
};

/**
 * Return 0 to go on; anything else ends the task, and apc_task_wait() gives it. Runs with all signals
 * blocked but those of faults, on a stack of 512 KiB, never twice at a time.
 */
typedef int (*apc_task_fn)(void *ctx, const struct apc_tick *tick);

/**
 * How ticks are treated whose instants pass while the callback runs, or while the process does not. A tick
 * whose instant is exactly now has not passed.
 */
enum apc_overrun {
    /**
     * Default: count and skip them. A task that wakes up late runs the newest tick that is due: one call
     * stands for the whole gap and is less than a period late. A task whose callback ran too long waits for
     * the next instant of the grid.
     */
    APC_OVERRUN_SKIP = 1,
    APC_OVERRUN_BURST, /**< run them one after another until caught up: none is missed */
    APC_OVERRUN_STOP   /**< end the task with APC_EOVERRUN as soon as one is missed */
};

/** Zero means default. */
struct apc_task_options {
    size_t size; /**< sizeof(struct apc_task_options) */
    const char
        *name;     /**< of the task, and of its thread if it has one; 15 bytes at most; default "apc-task" */
    apc_ns period; /**< required */
    apc_ns start;  /**< monotonic time of tick 0, not in the past; 0: now. Or UTC, see aligned */
    enum apc_overrun overrun;
    int priority; /**< SCHED_FIFO 1..99, or SCHED_OTHER where not permitted; 0: 80; -1: SCHED_OTHER */
    int cpu;      /**< 1 + number of the CPU to stay on; 0: any */
    /**
     * The grid is one of the wall clock, so that tasks on several machines tick together and agree on k.
     * start is the UTC of tick 0, past or to come (0: 1970); the task begins with the first tick that is not
     * past. A later step of the wall clock does not move the grid.
     */
    bool aligned;
    /**
     * Wake up early by a margin, which the task learns from how late it has been woken up, and spin until the
     * instant. Costs at most an eighth of a CPU; the numbers are in struct apc_timing. Executive "deadline".
     */
    bool spin;
};

struct apc_executive;
struct apc_task;

struct apc_executive_options {
    size_t size;
    /** NULL: the system's. Outlives the executive. A real-time executive asks an injected one for utc only;
     * executive "virtual" is its own clock and takes none. */
    const struct apc_clock *clock;
    struct apc_log *log; /**< NULL: silent */
    /* The following is done if the process may. If not, a line in the log says so, and the executive runs
     * without it. */
    /**
     * Hold /dev/cpu_dma_latency at 0 while the executive lives, which takes root: no CPU enters a sleep state
     * that takes long to leave. It halves the lateness; idle CPUs then use full power.
     */
    bool hold_latency;
    /**
     * mlockall(): keep all memory of the process, also what it will use, in RAM until it ends. Takes
     * CAP_IPC_LOCK or an unlimited RLIMIT_MEMLOCK: under a limit, later allocations would fail.
     */
    bool lock_memory;
    apc_ns begin; /**< executive "virtual": the UTC at which it begins */
};

/**
 * An executive by name: "deadline" (one thread a task, absolute sleeps, SCHED_FIFO when allowed), "posix"
 * (SIGEV_THREAD interval timers as in the paper, made safe) or "virtual" (below). [setup] Returns 0,
 * APC_EINVAL (unknown name, a clock for "virtual"), APC_ENOMEM. "posix" keeps a page of memory until the
 * process ends: see src/timer/posix.c.
 */
APC_API int apc_executive_create(struct apc_executive **executive, const char *name,
                                 const struct apc_executive_options *options, struct apc_error *why);
/** 0, or APC_ESTATE while it still has tasks. NULL is legal. [setup] */
APC_API int apc_executive_destroy(struct apc_executive *executive);

/** Make a task; it does not run yet. [setup] Returns 0, APC_EINVAL, APC_ENOMEM. */
APC_API int apc_task_create(struct apc_executive *executive, const struct apc_task_options *options,
                            apc_task_fn fn, void *ctx, struct apc_task **task, struct apc_error *why);
/**
 * Begin; the first call may come before this returns. The task's thread or timer exists when this returns
 * 0; on failure nothing was started, and it may be tried again. [setup] Returns 0, APC_EINVAL (start in the
 * past), APC_ESTATE (started before), APC_ESYS, APC_ENOMEM.
 */
APC_API int apc_task_start(struct apc_task *task, struct apc_error *why);
/**
 * No callback runs after this returns. Harmless when repeated, at the same time too, or before the start.
 * Not from the task's own callback (APC_ESTATE). [setup]
 */
APC_API int apc_task_stop(struct apc_task *task);
/**
 * Wait until the task has ended by itself or been stopped, at most @p timeout. Returns 0 when it has, and in
 * @p result, if that is not NULL, what its callback returned, APC_EOVERRUN (APC_OVERRUN_STOP), or 0: it was
 * stopped. Else @p result is left alone: APC_ETIMEDOUT when it did not end in time, APC_ESTATE before the
 * start and from the task's own callback, APC_EINVAL. [setup]
 */
APC_API int apc_task_wait(struct apc_task *task, apc_ns timeout, int *result);
/** Stops first if need be. NULL is legal. Does nothing when called from the task's own callback. [setup] */
APC_API void apc_task_destroy(struct apc_task *task);

/** Numbers since the start, from any thread while the task runs. [any] */
APC_API void apc_task_timing(const struct apc_task *task, struct apc_timing *timing);
/**
 * Ticks that did not run although their time came, with those that a callback which has not returned is
 * missing now (but for APC_OVERRUN_BURST, which may still run them; stopping the task counts them). [any]
 */
APC_API uint64_t apc_task_missed(const struct apc_task *task);

/** So many ticks missed in a row are an alarm. */
#define APC_OVERRUN_ALARM 10
/**
 * Ticks missed in a row: since the last call around which none was, with those that a callback which has not
 * returned is missing now (with APC_OVERRUN_BURST: by how many the task is behind). 0 when it has ended.
 * @p alarms, if not NULL, is how often that reached APC_OVERRUN_ALARM: counted when a callback begins late or
 * returns, also if it was too brief to be seen here. [any]
 */
APC_API uint64_t apc_task_overruns(const struct apc_task *task, uint64_t *alarms);

enum apc_task_histogram { APC_LATENESS = 1, APC_JITTER, APC_RUN };
/** The task's own histogram, to read or merge; lives as long as the task. [any] */
APC_API const struct apc_histogram *apc_task_histogram(const struct apc_task *task,
                                                       enum apc_task_histogram which);

/* ---- Virtual time ------------------------------------------------------------------------- */

/**
 * The executive "virtual" waits for nothing: apc_virtual_run() goes from event to event, and between them no
 * time passes. Its tasks are made, started and stopped as any others, with the same grid, overrun policies
 * and statistics. They run on the thread that calls apc_virtual_run(); apc_task_wait() there takes no timeout
 * but 0. Events of one instant come in the order of their rank, then of their request: the same program gives
 * the same events, every time. The functions below answer APC_EINVAL to another executive. One thread at a
 * time uses such an executive and all that runs on it.
 */

/**
 * What time the executive has: monotonic from 1 s on, and UTC from apc_executive_options.begin on. Lives as
 * long as the executive. Of a real-time executive: what it was given, or the system's. [any]
 */
APC_API const struct apc_clock *apc_executive_clock(const struct apc_executive *executive);

APC_API bool apc_executive_is_virtual(const struct apc_executive *executive); /**< [any] */

/**
 * Handle all events up to and including the monotonic time @p until; then it is @p until. Returns their
 * number, or APC_EINVAL, also for a time that is past. Not from inside an event. [setup]
 */
APC_API int64_t apc_virtual_run(struct apc_executive *executive, apc_ns until);
/** End apc_virtual_run() after the present event; the time stays. The next apc_virtual_run() goes on. [tick] */
APC_API int apc_virtual_stop(struct apc_executive *executive);

typedef void (*apc_virtual_fn)(void *ctx);
/**
 * Call @p fn at the monotonic time @p at, once. Returns 0, APC_EINVAL (a time that is past), APC_ENOMEM.
 * Each task needs no more memory than it got when it was made; these do. [setup]
 */
APC_API int apc_virtual_at(struct apc_executive *executive, apc_ns at, int rank, apc_virtual_fn fn,
                           void *ctx);

/**
 * Step the wall clock by @p step, and let it gain from now on @p drift seconds a second on the monotonic one
 * (1e-6: 1 ppm; -1 < drift < 1). [tick]
 */
APC_API int apc_virtual_set_clock(struct apc_executive *executive, apc_ns step, double drift);

/** How a task behaves in virtual time. Zero: a perfect one, which starts in time and takes none. */
struct apc_virtual_model {
    size_t size;
    int rank; /**< its place among coinciding events: lower ones come first */
    /** Seconds from the instant of a tick to its call, and from the call to its end; a draw below 0 counts as
     * 0. kind 0: none. What they borrow outlives the task. */
    struct apc_distribution jitter, execution;
    uint64_t seed;         /**< of both, in streams of their own named after the task */
    apc_virtual_fn finish; /**< called with the task's ctx at the end of the execution time, when what
                               the callback has made is to take effect; NULL: nothing to call */
};
/** Before the start. [setup] Returns 0, APC_EINVAL, APC_ESTATE (started). */
APC_API int apc_virtual_set_model(struct apc_task *task, const struct apc_virtual_model *model,
                                  struct apc_error *why);

#ifdef __cplusplus
}
#endif
#endif
