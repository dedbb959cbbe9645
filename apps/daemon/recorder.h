/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Events and the timing of one task, into the store. Events are queued by any thread and never wait;
 * recorder_flush(), called by the main thread, writes them. While the store is away events go into its
 * spool, or, without one, stay queued (when the queue is full the oldest go, and an event says how many);
 * timing goes into a longer window. Events of a link that comes and goes all the time are counted: after six
 * in a minute one event stands for those of ten seconds.
 */
#ifndef APC_RECORDER_H
#define APC_RECORDER_H

#include <apcstore.h>
#include <apctimer.h>

/* What the timing calls the exchanges of apc-client with the plant: as tasks of which only "run" is known,
 * from the request sent to the reply read; missed: those that failed. */
#define TASK_EXCHANGE "exchange"

/* So many rows of each task, and one of each TASK_EXCHANGE, come in every window. */
#define RECORDER_QUANTITIES 3
#define RECORDER_WINDOW     (5 * APC_NS_PER_S)

struct recorder;

/* store may be NULL: nothing is recorded. It becomes the recorder's. */
int recorder_create(struct recorder **recorder, struct apc_store *store, const char *task);
void recorder_destroy(struct recorder *recorder);
void recorder_event(struct recorder *recorder, const struct apc_event *event);
/* From now on also record a histogram of the daemon's own as the "run" of @p task, and how often it failed as
 * "missed". Both live until the last flush. */
void recorder_measure(struct recorder *recorder, const char *task, const struct apc_histogram *run,
                      const _Atomic uint64_t *failed);
/* So many ticks were missed before the task began: nobody ran it then. [tick] */
void recorder_absent(struct recorder *recorder, uint64_t missed);
/* Write out what is queued, the timing of task (NULL: not now) since the last time, and a portion of the
 * spool; each once, also when a commit's answer does not come. Returns 0 when the store is there and has
 * taken it. */
int recorder_flush(struct recorder *recorder, const struct apc_task *task, apc_ns period);
struct apc_store *recorder_store(const struct recorder *recorder); /* NULL: none */

#endif
