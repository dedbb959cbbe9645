/* SPDX-License-Identifier: BSD-3-Clause */
#include "daemon/worker.h"

#include <errno.h>
#include <string.h>

/* Returns 0, or ETIMEDOUT. */
static int wait_until(struct worker *w, apc_ns at)
{
    const struct timespec time = {.tv_sec = (time_t)(at / APC_NS_PER_S),
                                  .tv_nsec = (long)(at % APC_NS_PER_S)};
    return pthread_cond_timedwait(&w->changed, &w->mutex, &time);
}

static void *run_worker(void *ctx)
{
    struct worker *const w = ctx;
    bool last = false;
    pthread_mutex_lock(&w->mutex);
    while (!last) {
        last = w->end;
        w->due = false;
        w->since = apc_clock_mono(NULL);
        pthread_mutex_unlock(&w->mutex);
        const apc_ns pause = w->step(w->ctx, last), now = apc_clock_mono(NULL);
        pthread_mutex_lock(&w->mutex);
        w->since = 0;
        int e = 0;
        while (!w->due && !w->end && e == 0)
            e = wait_until(w, pause < WORKER_IDLE - now ? now + pause : WORKER_IDLE);
    }
    w->gone = true;
    pthread_cond_broadcast(&w->changed);
    pthread_mutex_unlock(&w->mutex);
    return NULL;
}

int worker_init(struct worker *w, worker_step *step, void *ctx, struct apc_error *why)
{
    pthread_condattr_t attr;
    int e = pthread_condattr_init(&attr);
    if (!e) {
        e = pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
        e = e ? e : pthread_cond_init(&w->changed, &attr);
        pthread_condattr_destroy(&attr);
    }
    if (e || apc_mutex_init(&w->mutex) < 0)
        return apc_fail(why, APC_ENOMEM, "no thread: out of memory");
    w->step = step;
    w->ctx = ctx;
    return 0;
}

int worker_start(struct worker *w, struct apc_error *why)
{
    const int e = pthread_create(&w->thread, NULL, run_worker, w);
    w->begun = !e;
    return e ? apc_fail(why, APC_ESYS, "no thread: %s", strerror(e)) : 0;
}

void worker_wake(struct worker *w)
{
    pthread_mutex_lock(&w->mutex);
    w->due = true;
    pthread_cond_broadcast(&w->changed);
    pthread_mutex_unlock(&w->mutex);
}

apc_ns worker_busy(struct worker *w)
{
    const apc_ns now = apc_clock_mono(NULL);
    pthread_mutex_lock(&w->mutex);
    const apc_ns since = w->since;
    pthread_mutex_unlock(&w->mutex);
    return since ? now - since : 0;
}

void worker_stop(struct worker *w)
{
    if (!w->begun)
        return;
    pthread_mutex_lock(&w->mutex);
    w->end = true;
    pthread_cond_broadcast(&w->changed);
    pthread_mutex_unlock(&w->mutex);
}

bool worker_join(struct worker *w, apc_ns until)
{
    if (!w->begun)
        return true;
    worker_stop(w);
    pthread_mutex_lock(&w->mutex);
    int e = 0;
    while (!w->gone && e == 0)
        e = wait_until(w, until);
    const bool gone = w->gone;
    pthread_mutex_unlock(&w->mutex);
    if (gone)
        pthread_join(w->thread, NULL);
    w->begun = !gone;
    return gone;
}
