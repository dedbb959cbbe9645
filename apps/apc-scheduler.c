/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-scheduler: writes the setpoint sequence, one step a period. A step that the store would not take
 * is tried again about every second; a scheduler that was restarted in the middle of a step writes that
 * step only if nobody has written since it began.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/daemon.h"

static const struct program program = {
    .name = "apc-scheduler",
    .doc = "Write a sequence of setpoints into the shared data.",
    .task = "scheduler",
};

struct shell {
    struct daemon *d;
    pthread_mutex_t mutex; /* of all below: the timer's thread and the main thread take turns */
    struct apc_store *store;
    struct apc_scheduler_options options;
    struct apc_sample *step;
    bool pending;
};

static int put(struct shell *s, bool say)
{
    apc_ns now = apc_clock_utc(NULL);
    for (size_t i = 0; i < s->options.nz; i++)
        s->step[i].time = now;
    int rc = apc_store_put(s->store, s->step, s->options.nz);
    if (rc < 0 && say)
        daemon_event(s->d, APC_EVENT_WARNING, "store", "setpoint not written, trying again: %s",
                     apc_store_error(s->store));
    if (rc >= 0 && !say)
        daemon_event(s->d, APC_EVENT_INFO, "store", "setpoint written after trying again");
    s->pending = rc < 0;
    return rc;
}

static void choose(struct shell *s, uint64_t index)
{
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    apc_scheduler_step(&s->options, index, now, s->step);
}

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    pthread_mutex_lock(&s->mutex);
    choose(s, tick->index);
    int rc = put(s, true);
    pthread_mutex_unlock(&s->mutex);
    return daemon_fatal(s->d, s->store, rc == APC_ECONFLICT ? 0 : rc);
}

static void on_look(void *ctx)
{
    struct shell *s = ctx;
    pthread_mutex_lock(&s->mutex);
    if (s->pending)
        put(s, false);
    pthread_mutex_unlock(&s->mutex);
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
    int rc = apc_store_read(s->store, s->step, s->options.nz);
    bool written = rc >= 0;
    for (size_t i = 0; i < s->options.nz && rc >= 0; i++)
        written = written && s->step[i].seq > 0 && s->step[i].time >= zero + (apc_ns)index * period;
    if (rc >= 0 && !written) {
        choose(s, index);
        rc = put(s, true);
    }
    return rc;
}

static int open_shell(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    s->options = (struct apc_scheduler_options){.size = sizeof s->options,
                                                .nz = e->dim.nz,
                                                .steps = e->scheduler.steps,
                                                .sequence = e->scheduler.sequence,
                                                .repeat = e->scheduler.repeat};
    /* Without a start a sequence that repeats lies on the grid of 1970; one that does not, begins now. */
    if (!s->d->start && !e->scheduler.repeat)
        s->d->start = apc_clock_utc(NULL) - e->scheduler.rhythm.phase;
    s->step = calloc(e->dim.nz, sizeof *s->step);
    int64_t *last = calloc(e->dim.nz, sizeof *last);
    int rc = s->step && last ? 0 : APC_ENOMEM;
    s->d->store_timeout = daemon_timeout(e->scheduler.rhythm.period);
    if (rc == 0)
        rc = daemon_store(s->d, &s->store, APC_SETPOINT, e->dim.nz, last);
    if (rc == 0)
        rc = catch_up(s);
    free(last);
    s->d->look = on_look;
    s->d->look_ctx = s;
    return rc;
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct shell s = {.d = &d};
    int rc = pthread_mutex_init(&s.mutex, NULL) ? APC_ESYS : 0;
    if (rc == 0)
        rc = daemon_open(&d, &program, NULL, argc, argv);
    if (rc == 0)
        rc = open_shell(&s);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.scheduler.rhythm, on_tick, &s);
    apc_store_close(s.store);
    free(s.step);
    return daemon_close(&d, rc);
}
