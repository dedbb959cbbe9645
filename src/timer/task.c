/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The task: what is the same on every executive.
 *
 * An executive decides in which thread apc_task_tick() runs and waits for apc_task_due() in between; it
 * owes the task that ticks never overlap, each seeing what the one before wrote, and that after halt()
 * none runs. Everything else is here: which tick of the grid to run, what was missed, the statistics, the
 * end. The statistics are recorded after the callback, where they delay nobody.
 *
 * State goes IDLE, STARTING, STARTED, STOPPING, STOPPED under the lock, and back from STARTING to IDLE
 * when starting failed. A task that ended by itself stays STARTED, with `ended` set, until someone stops
 * it, for its thread or timer still has to be collected.
 */
#include "base/base_internal.h"
#include "timer/timer_internal.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* ---- The tick ---- */

apc_ns apc_task_due(const struct apc_task *task)
{
    return apc_grid_time(task->epoch, task->options.period, task->due);
}

static void publish_next(struct apc_task *task)
{
    atomic_store_explicit(&task->next, apc_task_due(task), memory_order_relaxed);
}

static void publish_none(struct apc_task *task)
{
    atomic_store_explicit(&task->next, INT64_MAX, memory_order_relaxed);
    atomic_store_explicit(&task->in_a_row, 0, memory_order_relaxed);
}

void apc_task_begin(struct apc_task *task)
{
    const struct apc_task_options *o = &task->options;
    const struct apc_clock *mono = task->executive->mono;

    if (o->aligned) {
        apc_ns offset = apc_clock_offset(task->executive->utc, mono);
        task->epoch = (apc_ns)((uint64_t)o->start - (uint64_t)offset);
        task->due = apc_grid_next(task->epoch, o->period, apc_clock_mono(mono));
    } else {
        task->epoch = o->start ? o->start : apc_clock_mono(mono);
    }
    task->expected = task->due;
    publish_next(task);
}

bool apc_task_is_due(const struct apc_task *task)
{
    return apc_clock_mono(task->executive->mono) >= apc_task_due(task);
}

/*
 * Count the ticks from due up to @index as missed. Returns how many. `next` moves first: a reader, who takes
 * them the other way round, may for an instant miss some but counts none twice.
 */
static uint64_t skip_to(struct apc_task *task, uint64_t index)
{
    uint64_t missed = index - task->due;
    uint64_t before = atomic_load_explicit(&task->in_a_row, memory_order_relaxed);

    task->due = index;
    publish_next(task);
    if (missed > 0) {
        atomic_fetch_add_explicit(&task->missed, missed, memory_order_release);
        atomic_store_explicit(&task->in_a_row, before + missed, memory_order_relaxed);
    }
    if (before < APC_OVERRUN_ALARM && before + missed >= APC_OVERRUN_ALARM)
        atomic_fetch_add_explicit(&task->alarms, 1, memory_order_relaxed);
    return missed;
}

static bool end_task(struct apc_task *task, int result)
{
    pthread_mutex_lock(&task->lock);
    task->ended = true;
    task->result = result;
    publish_none(task);
    pthread_cond_broadcast(&task->changed);
    pthread_mutex_unlock(&task->lock);
    return false;
}

static void record_tick(struct apc_task *task, const struct apc_tick *tick, apc_ns finished)
{
    apc_histogram_record(task->lateness, tick->started - tick->scheduled);
    if (task->started > 0 && tick->missed == 0)
        apc_histogram_record(task->jitter, tick->started - task->started - task->options.period);
    apc_histogram_record(task->run, finished - tick->started);
    task->started = tick->started;
    atomic_store_explicit(&task->ticks, atomic_load_explicit(&task->ticks, memory_order_relaxed) + 1,
                          memory_order_relaxed); /* nobody else counts */
}

/* Call the function with tick task->due, which began at @now. Returns what it returned. */
static int call_task(struct apc_task *task, apc_ns now, apc_ns *finished)
{
    struct apc_tick tick = {.index = task->due,
                            .scheduled = apc_task_due(task),
                            .started = now,
                            .utc = apc_clock_utc(task->executive->utc),
                            .missed = task->due - task->expected};

    atomic_store_explicit(&task->runner, pthread_self(), memory_order_relaxed);
    int result = task->fn(task->ctx, &tick);
    atomic_store_explicit(&task->runner, (pthread_t)0, memory_order_relaxed);

    *finished = apc_clock_mono(task->executive->mono);
    record_tick(task, &tick, *finished);
    task->expected = ++task->due;
    return result;
}

bool apc_task_tick(struct apc_task *task)
{
    const apc_ns period = task->options.period;
    const enum apc_overrun overrun = task->options.overrun;
    apc_ns now = apc_clock_mono(task->executive->mono), finished;
    uint64_t missed = 0; /* before the call, then also during it */

    if (overrun != APC_OVERRUN_BURST)
        missed = skip_to(task, apc_grid_newest(task->epoch, period, task->due, now));
    if (missed > 0 && overrun == APC_OVERRUN_STOP)
        return end_task(task, APC_EOVERRUN);

    int result = call_task(task, now, &finished);
    if (overrun != APC_OVERRUN_BURST)
        missed += skip_to(task, apc_grid_resume(task->epoch, period, task->due - 1, finished));
    else
        publish_next(task);
    if (missed == 0 && atomic_load_explicit(&task->in_a_row, memory_order_relaxed) > 0)
        atomic_store_explicit(&task->in_a_row, 0, memory_order_relaxed);
    if (result == 0 && missed > 0 && overrun == APC_OVERRUN_STOP)
        result = APC_EOVERRUN;
    return result == 0 || end_task(task, result);
}

/* ---- Making one ---- */

static int check_options(struct apc_task_options *o, struct apc_error *why)
{
    apc_ns period;
    long cpus = sysconf(_SC_NPROCESSORS_CONF);

    if (!o->name)
        o->name = "apc-task";
    if (strlen(o->name) >= APC_TASK_NAME_LEN)
        return apc_fail(why, APC_EINVAL, "task name '%.64s': at most %d bytes", o->name,
                        APC_TASK_NAME_LEN - 1);
    if (apc_period_from_s(apc_ns_to_s(o->period), &period, why) < 0)
        return APC_EINVAL;
    if (o->start < 0)
        return apc_fail(why, APC_EINVAL, "task '%s': start %lld ns: expected %s", o->name,
                        (long long)o->start,
                        o->aligned ? "a time since 1970" : "a monotonic time, or 0 for now");
    if (o->overrun == 0)
        o->overrun = APC_OVERRUN_SKIP;
    if (o->overrun < APC_OVERRUN_SKIP || o->overrun > APC_OVERRUN_STOP)
        return apc_fail(why, APC_EINVAL, "task '%s': overrun policy %d: expected skip, burst or stop",
                        o->name, (int)o->overrun);
    if (o->priority == 0)
        o->priority = APC_PRIORITY_DEFAULT;
    if (o->priority < -1 || o->priority > 99)
        return apc_fail(
            why, APC_EINVAL,
            "task '%s': priority %d: expected 1 to 99 for SCHED_FIFO, 0 for %d, -1 for SCHED_OTHER", o->name,
            o->priority, APC_PRIORITY_DEFAULT);
    if (o->cpu < 0 || (o->cpu > 0 && o->cpu > cpus))
        return apc_fail(why, APC_EINVAL,
                        "task '%s': cpu %d: expected 1 to %ld (1 + its number), or 0 for any", o->name,
                        o->cpu, cpus);
    return 0;
}

static void free_task(struct apc_task *task)
{
    apc_histogram_destroy(task->lateness);
    apc_histogram_destroy(task->jitter);
    apc_histogram_destroy(task->run);
    pthread_cond_destroy(&task->changed);
    pthread_mutex_destroy(&task->lock);
    free(task);
}

static struct apc_task *new_task(struct apc_executive *executive, const struct apc_task_options *options)
{
    struct apc_task *task = calloc(1, sizeof *task);
    if (!task)
        return NULL;
    task->executive = executive;
    task->options = *options;
    memcpy(task->name, options->name, strlen(options->name) + 1);
    task->options.name = task->name;
    task->state = APC_TASK_IDLE;
    atomic_init(&task->next, INT64_MAX);
    pthread_mutex_init(&task->lock, NULL); /* with default attributes these two cannot fail */
    pthread_cond_init(&task->changed, NULL);
    if (apc_histogram_create(&task->lateness) < 0 || apc_histogram_create(&task->jitter) < 0 ||
        apc_histogram_create(&task->run) < 0) {
        free_task(task);
        return NULL;
    }
    return task;
}

int apc_task_create(struct apc_executive *executive, const struct apc_task_options *options, apc_task_fn fn,
                    void *ctx, struct apc_task **task, struct apc_error *why)
{
    struct apc_task_options o = {0};
    int err;

    if (!task)
        return apc_fail(why, APC_EINVAL, "no place for the task");
    *task = NULL;
    if (!executive || !options || !fn)
        return apc_fail(why, APC_EINVAL, "a task needs an executive, options with a period, and a function");
    if ((err = apc_options_copy(&o, sizeof o, options, "apc_task_options", why)) < 0 ||
        (err = check_options(&o, why)) < 0)
        return err;
    if (o.spin && !executive->ops->spins)
        return apc_fail(why, APC_EINVAL,
                        "task '%s': a task of the executive '%s' cannot spin: use 'deadline'", o.name,
                        executive->ops->name);

    struct apc_task *t = new_task(executive, &o);
    if (!t)
        return apc_fail(why, APC_ENOMEM, "no memory for task '%s'", o.name);
    t->fn = fn;
    t->ctx = ctx;
    if ((err = executive->ops->prepare(t)) < 0) {
        free_task(t);
        return apc_fail(why, err, "task '%s': no memory for its timer", o.name);
    }
    atomic_fetch_add(&executive->tasks, 1);
    *task = t;
    return 0;
}

/* ---- Starting and stopping ---- */

static void set_state(struct apc_task *task, enum apc_task_state state)
{
    pthread_mutex_lock(&task->lock);
    task->state = state;
    pthread_cond_broadcast(&task->changed);
    pthread_mutex_unlock(&task->lock);
}

/* Only the thread itself can have stored its own id, so the answer cannot change meanwhile. */
static bool called_from_inside(const struct apc_task *task)
{
    return pthread_equal(atomic_load_explicit(&task->runner, memory_order_relaxed), pthread_self());
}

int apc_task_start(struct apc_task *task, struct apc_error *why)
{
    if (!task)
        return apc_fail(why, APC_EINVAL, "no task to start");
    pthread_mutex_lock(&task->lock);
    bool idle = task->state == APC_TASK_IDLE;
    if (idle)
        task->state = APC_TASK_STARTING;
    pthread_mutex_unlock(&task->lock);
    if (!idle)
        return apc_fail(why, APC_ESTATE, "task '%s' was started before; make a new one", task->name);

    int err;
    apc_ns late = apc_clock_mono(task->executive->mono) - task->options.start;
    if (task->options.start != 0 && !task->options.aligned && late > 0)
        err = apc_fail(why, APC_EINVAL, "task '%s': its start lies %g s in the past", task->name,
                       apc_ns_to_s(late));
    else
        err = task->executive->ops->start(task, why);
    if (err < 0)
        publish_none(task);
    set_state(task, err < 0 ? APC_TASK_IDLE : APC_TASK_STARTED);
    return err;
}

int apc_task_stop(struct apc_task *task)
{
    if (!task)
        return APC_EINVAL;
    if (called_from_inside(task))
        return APC_ESTATE;

    pthread_mutex_lock(&task->lock);
    while (task->state == APC_TASK_STARTING || task->state == APC_TASK_STOPPING)
        pthread_cond_wait(&task->changed, &task->lock);
    bool running = task->state == APC_TASK_STARTED;
    if (running)
        task->state = APC_TASK_STOPPING;
    pthread_mutex_unlock(&task->lock);
    if (!running)
        return 0;

    task->executive->ops->halt(task);
    /* What was due and will never run is missed too; not the newest, which may have just been on its way. */
    if (!task->ended)
        skip_to(task, apc_grid_newest(task->epoch, task->options.period, task->due,
                                      apc_clock_mono(task->executive->mono)));
    publish_none(task);
    set_state(task, APC_TASK_STOPPED);
    return 0;
}

static struct timespec deadline_after(apc_ns timeout)
{
    apc_ns now = apc_clock_mono(NULL);
    apc_ns at = timeout <= 0 ? now : timeout > INT64_MAX - now ? INT64_MAX : now + timeout;
    return (struct timespec){.tv_sec = at / APC_NS_PER_S, .tv_nsec = at % APC_NS_PER_S};
}

int apc_task_wait(struct apc_task *task, apc_ns timeout, int *result)
{
    if (!task)
        return APC_EINVAL;
    if (called_from_inside(task))
        return APC_ESTATE;

    const struct timespec deadline = deadline_after(timeout);
    int rc = timeout > 0 ? 0 : ETIMEDOUT, err = 0; /* a wait that is over still costs a switch of threads */
    pthread_mutex_lock(&task->lock);
    while (rc == 0 && task->state != APC_TASK_IDLE && task->state != APC_TASK_STOPPED && !task->ended)
        rc = pthread_cond_clockwait(&task->changed, &task->lock, CLOCK_MONOTONIC, &deadline);
    if (task->state == APC_TASK_IDLE)
        err = APC_ESTATE;
    else if (task->state != APC_TASK_STOPPED && !task->ended)
        err = APC_ETIMEDOUT;
    else if (result)
        *result = task->result;
    pthread_mutex_unlock(&task->lock);
    return err;
}

void apc_task_destroy(struct apc_task *task)
{
    if (!task || apc_task_stop(task) == APC_ESTATE)
        return;
    struct apc_executive *executive = task->executive;
    executive->ops->release(task);
    free_task(task);
    atomic_fetch_sub(&executive->tasks, 1);
}

/* ---- Numbers ---- */

void apc_task_timing(const struct apc_task *task, struct apc_timing *timing)
{
    const apc_ns lasted = atomic_load_explicit(&task->lasted, memory_order_relaxed);
    const double spun = (double)atomic_load_explicit(&task->spun, memory_order_relaxed);
    struct apc_timing all = {.ticks = atomic_load_explicit(&task->ticks, memory_order_relaxed),
                             .missed = apc_task_missed(task),
                             .spin_margin = atomic_load_explicit(&task->spin_margin, memory_order_relaxed),
                             .spin_share = lasted > 0 ? spun / (double)lasted : 0.0};

    apc_histogram_summary(task->lateness, &all.lateness);
    apc_histogram_summary(task->jitter, &all.jitter);
    apc_histogram_summary(task->run, &all.run);
    apc_result_copy(timing, &all, sizeof(all));
}

/* Ticks whose instants have passed since that of the one that is due, or runs. */
static uint64_t ticks_behind(const struct apc_task *task)
{
    apc_ns now = apc_clock_mono(task->executive->mono);
    apc_ns next = atomic_load_explicit(&task->next, memory_order_relaxed);
    return now > next ? (uint64_t)(now - next - 1) / (uint64_t)task->options.period : 0;
}

uint64_t apc_task_missed(const struct apc_task *task)
{
    uint64_t missed = atomic_load_explicit(&task->missed, memory_order_acquire);
    return missed + (task->options.overrun == APC_OVERRUN_BURST ? 0 : ticks_behind(task));
}

uint64_t apc_task_overruns(const struct apc_task *task, uint64_t *alarms)
{
    if (alarms)
        *alarms = atomic_load_explicit(&task->alarms, memory_order_relaxed);
    return atomic_load_explicit(&task->in_a_row, memory_order_relaxed) + ticks_behind(task);
}

const struct apc_histogram *apc_task_histogram(const struct apc_task *task, enum apc_task_histogram which)
{
    switch (which) {
    case APC_LATENESS:
        return task->lateness;
    case APC_JITTER:
        return task->jitter;
    case APC_RUN:
        return task->run;
    }
    return NULL;
}
