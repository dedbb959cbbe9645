/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A thread beside the task of a daemon, for what may wait for a disk, a database or a peer as long as it
 * takes: the task only wakes it, and reads what it left under the mutex, which nobody holds while he waits.
 */
#ifndef APC_WORKER_H
#define APC_WORKER_H

#include <apcbase.h>
#include <pthread.h>

/*
 * Called in the thread, without the mutex, when it is woken; first at the start. `last`: the end is wanted,
 * and there will be no other call. Returns after how long it is to be called again though nobody wakes it.
 */
typedef apc_ns worker_step(void *ctx, bool last);
#define WORKER_IDLE INT64_MAX /* only when somebody does */

struct worker {
    pthread_mutex_t mutex; /* of all below, and of what its owner shares with it; inherits priority */
    pthread_cond_t changed;
    pthread_t thread;
    worker_step *step;
    void *ctx;
    bool begun, due, end, gone;
    apc_ns since; /* monotonic: of the step that is under way; 0: none */
};

/* The worker outlives the process's main(), should it not end. Negative: as of errors, with a sentence. */
int worker_init(struct worker *w, worker_step *step, void *ctx, struct apc_error *why);
int worker_start(struct worker *w, struct apc_error *why);
void worker_wake(struct worker *w);
/* For how long the step that is under way has been; 0: none is. */
apc_ns worker_busy(struct worker *w);
/* Asks for the end; of several that end by the same time each is asked first. */
void worker_stop(struct worker *w);
/* The same, and waits until then (monotonic). True: it has ended, or never began, and its memory is free. */
bool worker_join(struct worker *w, apc_ns until);

#endif
