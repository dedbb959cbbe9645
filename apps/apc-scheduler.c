/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-scheduler: writes the setpoint sequence, one step a period. A step that the store would not take
 * is tried again about every second; a scheduler that was restarted in the middle of a step writes that
 * step only if nobody has written since it began.
 *
 * Two threads write, the task its step and the main thread one that was not taken, but one at a time:
 * `writing` says that somebody is, and a step that comes meanwhile is left to it. So nobody holds the mutex
 * while it waits for the store, and the task waits for no thread that does.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/daemon.h"

static const struct program program = {
    .name = "apc-scheduler",
    .doc = "Write a sequence of setpoints into the shared data.",
    .task = "scheduler",
};

struct shell {
    struct daemon *d;
    struct apc_scheduler_options options;
    pthread_mutex_t mutex; /* of the next four; inherits priority */
    struct apc_sample *step;
    uint64_t chosen, written; /* steps */
    bool writing, failing;
    struct apc_store *store; /* whose turn it is to write */
    struct apc_sample *out;
};

static int put(struct shell *s)
{
    apc_ns now = apc_clock_utc(NULL);
    for (size_t i = 0; i < s->options.nz; i++)
        s->out[i].time = now;
    int rc = apc_store_put(s->store, s->out, s->options.nz);
    if (rc < 0 && !s->failing)
        daemon_event(s->d, APC_EVENT_WARNING, "store", "setpoint not written, trying again: %s",
                     apc_store_error(s->store));
    if (rc >= 0 && s->failing)
        daemon_event(s->d, APC_EVENT_INFO, "store", "setpoint written after trying again");
    s->failing = rc < 0;
    return rc;
}

/* Write what was chosen last, and what is chosen meanwhile; nothing when somebody does so already. */
static int write_step(struct shell *s)
{
    int rc = 0;
    pthread_mutex_lock(&s->mutex);
    if (s->writing) {
        pthread_mutex_unlock(&s->mutex);
        return 0;
    }
    s->writing = true;
    while (rc >= 0 && s->written != s->chosen) {
        const uint64_t chosen = s->chosen;
        memcpy(s->out, s->step, s->options.nz * sizeof *s->out);
        pthread_mutex_unlock(&s->mutex);
        rc = put(s);
        pthread_mutex_lock(&s->mutex);
        if (rc >= 0)
            s->written = chosen;
    }
    s->writing = false;
    pthread_mutex_unlock(&s->mutex);
    return rc;
}

static void choose(struct shell *s, uint64_t index)
{
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    pthread_mutex_lock(&s->mutex);
    apc_scheduler_step(&s->options, index, now, s->step);
    for (size_t i = 0; i < s->options.nz; i++)
        s->step[i].id = (int)s->d->experiment.scheduler.z[i].at + 1;
    s->chosen++;
    pthread_mutex_unlock(&s->mutex);
}

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    choose(s, tick->index);
    int rc = write_step(s);
    return daemon_fatal(s->d, s->store, rc == APC_ECONFLICT ? 0 : rc);
}

static void on_look(void *ctx)
{
    write_step(ctx);
}

/* Started in the middle of a step: is it in the store already, or was there nobody to write it? */
static int catch_up(struct shell *s)
{
    const apc_ns period = s->d->experiment.scheduler.rhythm.period;
    const apc_ns zero = s->d->start + s->d->experiment.scheduler.rhythm.phase, now = apc_clock_utc(NULL);
    if (now < zero)
        return 0;
    uint64_t index = (uint64_t)((now - zero) / period);
    choose(s, index);
    memcpy(s->out, s->step, s->options.nz * sizeof *s->out);
    int rc = apc_store_read(s->store, s->out, s->options.nz);
    bool written = rc >= 0;
    for (size_t i = 0; i < s->options.nz && rc >= 0; i++)
        written = written && s->out[i].seq > 0 && s->out[i].time >= zero + (apc_ns)index * period;
    if (written)
        s->written = s->chosen;
    return rc < 0 ? rc : write_step(s);
}

static int open_shell(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    if (e->scheduler.steps == 0)
        return daemon_error(s->d, APC_EINVAL, "%s has no scheduler: nothing is to be written", e->file);
    s->options = (struct apc_scheduler_options){.size = sizeof s->options,
                                                .nz = e->scheduler.n,
                                                .steps = e->scheduler.steps,
                                                .sequence = e->scheduler.sequence,
                                                .repeat = e->scheduler.repeat};
    /* Without a start a sequence that repeats lies on the grid of 1970; one that does not, begins now. */
    if (!s->d->start && !e->scheduler.repeat)
        s->d->start = apc_clock_utc(NULL) - e->scheduler.rhythm.phase;
    s->step = calloc(e->dim.nz, sizeof *s->step);
    s->out = calloc(e->dim.nz, sizeof *s->out);
    int rc = s->step && s->out ? 0 : APC_ENOMEM;
    s->d->store_timeout = daemon_timeout(e->scheduler.rhythm.period);
    for (size_t i = 0; i < s->options.nz && rc == 0; i++)
        s->out[i] = (struct apc_sample){.table = APC_SETPOINT, .id = (int)e->scheduler.z[i].at + 1};
    if (rc == 0)
        rc = daemon_store(s->d, &s->store, s->out, s->options.nz);
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
        rc = open_shell(&s);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.scheduler.rhythm, on_tick, &s);
    apc_store_close(s.store);
    free(s.step);
    free(s.out);
    return daemon_close(&d, rc);
}
