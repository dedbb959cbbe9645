/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-scheduler: writes the setpoint sequence, one step a period, to the setpoints that are Remote. Once
 * a second it looks whether one was given back to it, and four times whether a step is still due that the
 * store would not take. A scheduler that was restarted in the middle of a step writes that step only where nobody has written
 * since it began.
 *
 * Two threads write, the task its step and the main thread what it finds when it looks, but one at a time:
 * `writing` says that somebody is, and a step that comes meanwhile is left to it. So nobody holds the mutex
 * while it waits for the store, and the task waits for no thread that does.
 */
#include "daemon/daemon.h"
#include <pthread.h>

static const struct program program = {
    .name = "apc-scheduler",
    .doc = "Write a sequence of setpoints into the shared data.",
    .task = "scheduler",
};

#define TRIES 3 /* where somebody is faster; then it is looked at later */

struct shell {
    struct daemon *d;
    pthread_mutex_t mutex;    /* of the next five; inherits priority */
    struct apc_scheduler_at { /* where the sequence is */
        uint64_t step;
        apc_ns began; /* mono */
    } at;
    uint64_t chosen, written; /* steps; 0: there was none */
    bool writing, failing;
    struct apc_store *store; /* whose turn it is to write */
    struct apc_scheduler *core;
};

/* Write what is due. */
static int put_due_setpoints(struct shell *s, struct apc_scheduler_at at)
{
    struct apc_notice notice;
    bool done = false;
    int rc = 0;
    for (int i = 0; i < TRIES && !done && rc >= 0; i++) {
        rc = apc_store_read_rows(s->store, apc_scheduler_in(s->core));
        if (rc < 0)
            break;
        const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
        const int n = apc_scheduler_compute(s->core, now, at.step, now.mono - at.began, &notice);
        daemon_notice(s->d, &notice);
        rc = n > 0 ? apc_store_append_rows(s->store, apc_scheduler_out(s->core)) : 0;
        done = apc_scheduler_update(s->core, rc >= 0);
    }
    return rc < 0 ? rc : done;
}

static void report_scheduler_store(struct shell *s, int rc)
{
    if (rc < 0 && !s->failing)
        daemon_event(s->d, APC_EVENT_WARNING, "store", "setpoint not written, trying again: %s",
                     apc_store_error(s->store));
    if (rc > 0 && s->failing)
        daemon_event(s->d, APC_EVENT_INFO, "store", "setpoint written after trying again");
    s->failing = rc < 0 || (rc == 0 && s->failing);
}

/* Write what is due, and what comes to be due meanwhile; nothing when somebody does so already, or no step
 * has begun. */
static int look_for_due(struct shell *s)
{
    int rc = 1;
    pthread_mutex_lock(&s->mutex);
    if (s->writing || s->chosen == 0) {
        pthread_mutex_unlock(&s->mutex);
        return 0;
    }
    s->writing = true;
    do {
        const uint64_t chosen = s->chosen;
        const struct apc_scheduler_at at = s->at;
        pthread_mutex_unlock(&s->mutex);
        rc = put_due_setpoints(s, at);
        if (s->failing || s->written != chosen) /* else nothing was due, as far as is known */
            report_scheduler_store(s, rc);
        pthread_mutex_lock(&s->mutex);
        if (rc > 0)
            s->written = chosen;
        if (chosen == s->chosen)
            break;
    } while (rc > 0);
    s->writing = false;
    pthread_mutex_unlock(&s->mutex);
    return rc < 0 ? rc : 0;
}

static void choose_step(struct shell *s, uint64_t step, apc_ns began)
{
    pthread_mutex_lock(&s->mutex);
    s->at = (struct apc_scheduler_at){step, began};
    s->chosen++;
    pthread_mutex_unlock(&s->mutex);
}

static int on_scheduler_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    choose_step(s, tick->index, tick->scheduled);
    return daemon_fatal(s->d, s->store, look_for_due(s));
}

static apc_ns on_look(void *ctx)
{
    return look_for_due(ctx) < 0 ? APC_NS_PER_S / 4 : APC_NS_PER_S;
}

/* Started in the middle of a step: is it in the store already, or was there nobody to write it? */
static int catch_up(struct shell *s)
{
    const apc_ns period = s->d->experiment.scheduler.rhythm.period;
    const apc_ns zero = s->d->start + s->d->experiment.scheduler.rhythm.phase, now = apc_clock_utc(NULL);
    if (now < zero)
        return 0;
    const apc_ns age = (now - zero) % period;
    int rc = apc_store_read_rows(s->store, apc_scheduler_in(s->core));
    if (rc < 0)
        return rc;
    apc_scheduler_resume(s->core, (uint64_t)((now - zero) / period), now - age);
    choose_step(s, (uint64_t)((now - zero) / period), apc_clock_mono(NULL) - age);
    return look_for_due(s);
}

static int open_scheduler(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_error why;
    if (e->scheduler.steps == 0)
        return daemon_error(s->d, APC_EINVAL, "%s has no scheduler: nothing is to be written", e->file);
    int rc = module_scheduler(e, &s->core, &why);
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", why.text);
    s->d->store_timeout = daemon_timeout(e->scheduler.rhythm.period);
    rc = daemon_store(s->d, &s->store, apc_scheduler_in(s->core)->sample, e->scheduler.n);
    /* Without a start a sequence that repeats lies on the grid of 1970; one that does not, begins now. */
    if (!s->d->start && !e->scheduler.repeat)
        s->d->start = apc_clock_utc(NULL) - e->scheduler.rhythm.phase;
    if (rc == 0)
        rc = catch_up(s);
    s->d->look = on_look;
    s->d->look_ctx = s;
    return rc;
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct shell s = {.d = &d};
    int rc = apc_mutex_init(&s.mutex);
    if (rc == 0)
        rc = daemon_open(&d, &program, NULL, argc, argv);
    if (rc == 0)
        rc = open_scheduler(&s);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.scheduler.rhythm, on_scheduler_tick, &s);
    apc_store_close(s.store);
    apc_scheduler_destroy(s.core);
    return daemon_close(&d, rc);
}
