/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The executive "deadline": a thread a task, which sleeps until the absolute instant of its next tick.
 *
 * The sleep is a wait with a deadline on the semaphore `stop`: ETIMEDOUT is the tick, success is the order
 * to stop. There is no gap between looking for the order and going to sleep, so a stop takes effect at
 * once even when the period is an hour, and an order that comes during the callback is met on the next
 * wait, also when that wait's instant has already passed.
 *
 * A task that spins sleeps until a margin before the instant, then reads the clock until it has come, looking
 * for the order to stop in between. The margin follows from how late those sleeps ended (spin_margin.c), which is
 * not the lateness of the ticks. A sleep whose instant was past when it began says nothing and is not learned
 * from, and learning comes after the callback: it delays none.
 *
 * deadline_halt() posts and joins: what the thread wrote is seen by whoever comes after.
 */
#include "timer/timer_internal.h"

#include <assert.h>
#include <errno.h>
#include <semaphore.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>

struct deadline {
    pthread_t thread;
    sem_t ready, stop;
    /* The thread's own, of a task that spins: */
    struct apc_margin margin;
    apc_ns begun, late; /* how late the last sleep ended; -1: it was none */
    apc_ns spun, now;   /* altogether; when the last wait ended */
};

static int deadline_prepare(struct apc_task *task)
{
    struct deadline *own = calloc(1, sizeof *own);
    if (!own)
        return APC_ENOMEM;
    sem_init(&own->ready, 0, 0);
    sem_init(&own->stop, 0, 0);
    apc_margin_init(&own->margin, task->options.period);
    task->own = own;
    return 0;
}

static void deadline_release(struct apc_task *task)
{
    struct deadline *own = task->own;
    sem_destroy(&own->stop);
    sem_destroy(&own->ready);
    free(own);
}

/* True at the instant @at, false when stop was posted before. */
static bool sleep_until(sem_t *stop, apc_ns at)
{
    const struct timespec t = {.tv_sec = at / APC_NS_PER_S, .tv_nsec = at % APC_NS_PER_S};
    int rc;
    do
        rc = sem_clockwait(stop, CLOCK_MONOTONIC, &t);
    while (rc < 0 && errno == EINTR);
    assert(rc == 0 || errno == ETIMEDOUT);
    return rc < 0;
}

static void relax(void)
{
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__) || defined(__arm__)
    __asm__ volatile("yield");
#endif
}

static bool ordered_to_stop(struct deadline *own)
{
    int posts = 0;
    sem_getvalue(&own->stop, &posts);
    return posts > 0;
}

/* As sleep_until(), by a sleep that ends before @at, and spinning. */
static bool spin_until(struct deadline *own, const struct apc_clock *mono, apc_ns at)
{
    const apc_ns early = at - own->margin.margin;
    bool sleeps = apc_clock_mono(mono) < early;
    if (!sleep_until(&own->stop, early))
        return false;
    const apc_ns woke = apc_clock_mono(mono);
    own->late = sleeps ? woke - early : -1;
    for (own->now = woke; own->now < at; own->now = apc_clock_mono(mono)) {
        if (ordered_to_stop(own))
            return false;
        relax();
    }
    own->spun += own->now - woke;
    return true;
}

static void learn_margin(struct apc_task *task, struct deadline *own)
{
    if (own->late >= 0)
        apc_margin_learn(&own->margin, own->late);
    atomic_store_explicit(&task->spin_margin, own->margin.margin, memory_order_relaxed);
    atomic_store_explicit(&task->spun, own->spun, memory_order_relaxed);
    atomic_store_explicit(&task->lasted, own->now - own->begun, memory_order_relaxed);
}

static bool wait_for_tick(struct apc_task *task, struct deadline *own)
{
    if (task->options.spin)
        return spin_until(own, task->executive->mono, apc_task_due(task));
    return sleep_until(&own->stop, apc_task_due(task));
}

static void *run_deadline_task(void *arg)
{
    struct apc_task *task = arg;
    struct deadline *own = task->own;

    pthread_setname_np(pthread_self(), task->name);
    prctl(PR_SET_TIMERSLACK, 1UL); /* SCHED_OTHER sleeps are otherwise rounded up by 50 us */
    apc_task_touch_stack();
    own->begun = apc_clock_mono(task->executive->mono);
    apc_task_begin(task); /* a start "now" is when the thread is ready for it */
    sem_post(&own->ready);
    for (bool more = true; more && wait_for_tick(task, own);) {
        more = apc_task_tick(task);
        if (task->options.spin)
            learn_margin(task, own);
    }
    return NULL;
}

static int deadline_start(struct apc_task *task, struct apc_error *why)
{
    struct deadline *own = task->own;
    pthread_attr_t attr;

    int err = apc_task_thread_attr(task, &attr, why);
    if (err < 0)
        return err;
    err = pthread_create(&own->thread, &attr, run_deadline_task, task);
    pthread_attr_destroy(&attr);
    if (err)
        return apc_fail(why, APC_ESYS, "task '%s': no thread: %s", task->name, strerror(err));
    while (sem_wait(&own->ready) < 0)
        assert(errno == EINTR);
    return 0;
}

static void deadline_halt(struct apc_task *task)
{
    struct deadline *own = task->own;
    sem_post(&own->stop);
    pthread_join(own->thread, NULL);
}

const struct apc_executive_ops apc_executive_deadline = {.name = "deadline",
                                                         .spins = true,
                                                         .prepare = deadline_prepare,
                                                         .start = deadline_start,
                                                         .halt = deadline_halt,
                                                         .release = deadline_release};
