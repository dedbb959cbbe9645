/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The executive "virtual": a queue of events and no waiting.
 *
 * The queue is a binary heap ordered by time, rank and sequence number. No two events compare equal, so the
 * order of a run does not depend on how the heap was filled: it is the same everywhere.
 *
 * A task has at most two events in the queue, its next tick and the end of its present one; room for both is
 * made with the task, so that ticking never allocates.
 *
 * An execution time is drawn when the callback returns. For the rest of apc_task_tick() the clock is ahead by
 * it, so that the statistics, the overrun policy and the instant of the next tick come out as they do in real
 * time, in the code that is common to all executives. Then the clock is set back: other events happen before
 * the end of the execution time, where `finish` is called.
 *
 * Every task has a CPU of its own. Modelling several on one would take preemption; a task that is kept
 * waiting by others is modelled by its jitter.
 */
#include "base/base_internal.h"
#include "timer/timer_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define FIRST        APC_NS_PER_S /* monotonic time at the beginning; 0 means "now" in a task's options */
#define TASK_EVENTS  2
#define FIRST_EVENTS 64

struct event {
    apc_ns at;
    uint64_t sequence;
    apc_virtual_fn fn;
    void *ctx;
    int rank;
};

struct virtual
{
    struct apc_clock clock;
    apc_ns now, ahead;
    apc_ns utc, utc_at; /* the wall clock showed utc at the monotonic time utc_at */
    double drift;
    struct event *heap; /* heap[0] comes first */
    size_t n, capacity;
    size_t reserved; /* for tasks */
    uint64_t sequence;
    bool running, stop;
};

struct virtual_task {
    struct virtual *virtual;
    apc_task_fn fn;
    void *ctx;
    struct apc_virtual_model model;
    struct apc_random jitter, execution;
};

/* ---- The clock ---- */

static apc_ns mono(void *ctx)
{
    const struct virtual *v = ctx;
    return v->now + v->ahead;
}

static apc_ns utc(void *ctx)
{
    const struct virtual *v = ctx;
    apc_ns gone = v->now + v->ahead - v->utc_at;
    return v->utc + gone + (v->drift != 0.0 ? (apc_ns)((double)gone * v->drift) : 0);
}

/* ---- The queue ---- */

static bool event_is_before(const struct event *a, const struct event *b)
{
    if (a->at != b->at)
        return a->at < b->at;
    return a->rank != b->rank ? a->rank < b->rank : a->sequence < b->sequence;
}

static inline void sift_up(struct virtual *v, size_t i, struct event event)
{
    for (size_t parent; i > 0 && event_is_before(&event, &v->heap[parent = (i - 1) / 2]); i = parent)
        v->heap[i] = v->heap[parent];
    v->heap[i] = event;
}

static void sift_down(struct virtual *v, size_t i, struct event event)
{
    for (size_t child; (child = 2 * i + 1) < v->n; i = child) {
        if (child + 1 < v->n && event_is_before(&v->heap[child + 1], &v->heap[child]))
            child++;
        if (event_is_before(&event, &v->heap[child]))
            break;
        v->heap[i] = v->heap[child];
    }
    v->heap[i] = event;
}

static void push(struct virtual *v, apc_ns at, int rank, apc_virtual_fn fn, void *ctx)
{
    sift_up(v, v->n++, (struct event){at, v->sequence++, fn, ctx, rank});
}

static struct event pop(struct virtual *v)
{
    struct event first = v->heap[0];
    if (--v->n > 0)
        sift_down(v, 0, v->heap[v->n]);
    return first;
}

/* Room for @more events of tasks, or for one other beside all that tasks may yet need. */
static int make_event_room(struct virtual *v, size_t more)
{
    size_t needed = v->n + v->reserved + more, capacity = v->capacity;
    if (needed <= capacity)
        return 0;
    while (capacity < needed)
        capacity = capacity ? 2 * capacity : FIRST_EVENTS;
    struct event *heap = realloc(v->heap, capacity * sizeof *heap);
    if (!heap)
        return APC_ENOMEM;
    v->heap = heap;
    v->capacity = capacity;
    return 0;
}

/* ---- Tasks ---- */

static apc_ns draw_delay(const struct apc_distribution *d, struct apc_random *random)
{
    apc_ns ns = 0;
    double seconds = d->kind ? apc_distribution_draw(d, random) : 0.0;
    /* some 30 years for what no time can hold: it must not become none at all */
    return seconds > 0.0 && apc_ns_from_s(fmin(seconds, 1e9), &ns) == 0 ? ns : 0;
}

/* In the place of the task's own function. */
static int call_delayed(void *ctx, const struct apc_tick *tick)
{
    struct virtual_task *own = ctx;
    int result = own->fn(own->ctx, tick);
    own->virtual->ahead = draw_delay(&own->model.execution, &own->execution);
    return result;
}

static void on_finish(void *ctx)
{
    struct virtual_task *own = ((struct apc_task *)ctx)->own;
    own->model.finish(own->ctx);
}

static void on_virtual_tick(void *ctx);

static void push_tick(struct apc_task *task, apc_ns not_before)
{
    struct virtual_task *own = task->own;
    apc_ns at = apc_task_due(task), late = draw_delay(&own->model.jitter, &own->jitter);

    if (at == INT64_MAX || late > INT64_MAX - at) /* never */
        return;
    at += late;
    push(own->virtual, at > not_before ? at : not_before, own->model.rank, on_virtual_tick, task);
}

static void on_virtual_tick(void *ctx)
{
    struct apc_task *task = ctx;
    struct virtual_task *own = task->own;
    struct virtual *v = own->virtual;
    const uint64_t ticks = atomic_load_explicit(&task->ticks, memory_order_relaxed);

    bool more = apc_task_tick(task);
    const apc_ns finished = v->now + v->ahead;
    bool called = atomic_load_explicit(&task->ticks, memory_order_relaxed) != ticks;

    v->ahead = 0;
    if (called && own->model.finish && finished > v->now)
        push(v, finished, own->model.rank, on_finish, task);
    if (more)
        push_tick(task, finished);
    if (called && own->model.finish && finished == v->now)
        own->model.finish(own->ctx);
}

/* Take out what is queued for the task. */
static void forget_events(struct virtual *v, const struct apc_task *task)
{
    size_t kept = 0, n = v->n;
    for (size_t i = 0; i < n; i++)
        if (v->heap[i].ctx != task || (v->heap[i].fn != on_virtual_tick && v->heap[i].fn != on_finish))
            v->heap[kept++] = v->heap[i];
    v->n = 0;
    while (v->n < kept) {
        struct event event = v->heap[v->n];
        sift_up(v, v->n++, event);
    }
}

static int virtual_prepare(struct apc_task *task)
{
    struct virtual *v = task->executive->own;
    struct virtual_task *own = calloc(1, sizeof *own);

    if (!own || make_event_room(v, TASK_EVENTS) < 0) {
        free(own);
        return APC_ENOMEM;
    }
    v->reserved += TASK_EVENTS;
    *own = (struct virtual_task){.virtual = v, .fn = task->fn, .ctx = task->ctx};
    task->fn = call_delayed;
    task->ctx = own;
    task->own = own;
    return 0;
}

static int virtual_start(struct apc_task *task, struct apc_error *why)
{
    (void)why;
    apc_task_begin(task);
    push_tick(task, ((struct virtual_task *)task->own)->virtual->now);
    return 0;
}

static void virtual_halt(struct apc_task *task)
{
    forget_events(task->executive->own, task);
}

static void virtual_release(struct apc_task *task)
{
    ((struct virtual *)task->executive->own)->reserved -= TASK_EVENTS;
    free(task->own);
}

static int open_virtual(struct apc_executive *executive)
{
    struct virtual *v = calloc(1, sizeof *v);
    if (!v)
        return APC_ENOMEM;
    v->clock = (struct apc_clock){.mono = mono, .utc = utc, .ctx = v};
    v->now = v->utc_at = FIRST;
    v->utc = executive->begin;
    executive->mono = executive->utc = &v->clock;
    executive->own = v;
    return 0;
}

static void close_virtual(struct apc_executive *executive)
{
    struct virtual *v = executive->own;
    free(v->heap);
    free(v);
}

const struct apc_executive_ops apc_executive_virtual = {.name = "virtual",
                                                        .own_clock = true,
                                                        .open = open_virtual,
                                                        .close = close_virtual,
                                                        .prepare = virtual_prepare,
                                                        .start = virtual_start,
                                                        .halt = virtual_halt,
                                                        .release = virtual_release};

/* ---- Its own functions ---- */

static struct virtual *virtual_of(const struct apc_executive *executive)
{
    return executive && executive->ops == &apc_executive_virtual ? executive->own : NULL;
}

bool apc_executive_is_virtual(const struct apc_executive *executive)
{
    return virtual_of(executive) != NULL;
}

int64_t apc_virtual_run(struct apc_executive *executive, apc_ns until)
{
    struct virtual *v = virtual_of(executive);
    int64_t handled = 0;

    if (!v || v->running || until < v->now)
        return APC_EINVAL;
    v->running = true;
    for (v->stop = false; !v->stop && v->n > 0 && v->heap[0].at <= until; handled++) {
        struct event event = pop(v);
        v->now = event.at;
        event.fn(event.ctx);
    }
    if (!v->stop)
        v->now = until;
    v->running = false;
    return handled;
}

int apc_virtual_stop(struct apc_executive *executive)
{
    struct virtual *v = virtual_of(executive);
    if (!v)
        return APC_EINVAL;
    v->stop = true;
    return 0;
}

int apc_virtual_at(struct apc_executive *executive, apc_ns at, int rank, apc_virtual_fn fn, void *ctx)
{
    struct virtual *v = virtual_of(executive);
    if (!v || !fn || at < v->now)
        return APC_EINVAL;
    if (make_event_room(v, 1) < 0)
        return APC_ENOMEM;
    push(v, at, rank, fn, ctx);
    return 0;
}

int apc_virtual_set_clock(struct apc_executive *executive, apc_ns step, double drift)
{
    struct virtual *v = virtual_of(executive);
    if (!v || !(fabs(drift) < 1.0))
        return APC_EINVAL;
    v->utc = utc(v) + step;
    v->utc_at = v->now + v->ahead;
    v->drift = drift;
    return 0;
}

static void name_stream(struct apc_random *random, uint64_t seed, const struct apc_task *task,
                        const char *what)
{
    char name[64];
    snprintf(name, sizeof name, "task.%s.%s", task->name, what);
    apc_random_init(random, seed, name);
}

int apc_virtual_set_model(struct apc_task *task, const struct apc_virtual_model *model, struct apc_error *why)
{
    struct apc_virtual_model m = {.size = sizeof m};
    int rc;

    if (!task || !virtual_of(task->executive))
        return apc_fail(why, APC_EINVAL, "a model is for a task of the executive 'virtual'");
    if (task->state != APC_TASK_IDLE)
        return apc_fail(why, APC_ESTATE, "task '%s' was started before: its model comes first", task->name);
    if ((rc = apc_options_copy(&m, sizeof m, model, "apc_virtual_model", why)) < 0)
        return rc;
    struct virtual_task *own = task->own;
    own->model = m;
    name_stream(&own->jitter, m.seed, task, "jitter");
    name_stream(&own->execution, m.seed, task, "execution");
    return 0;
}
