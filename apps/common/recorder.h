/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Events and the timing of one task, into the store. Events are queued by any thread and never wait;
 * recorder_flush(), called by the main thread, writes them. While the store is away events stay queued
 * (the oldest go when the queue is full, and are counted) and timing goes into a longer window.
 */
#ifndef APC_RECORDER_H
#define APC_RECORDER_H

#include <apcshareddata.h>
#include <apctimer.h>

struct recorder;

/* store may be NULL: nothing is recorded. It becomes the recorder's. */
int recorder_create(struct recorder **recorder, struct apc_store *store, const char *task);
void recorder_destroy(struct recorder *recorder);
void recorder_event(struct recorder *recorder, const struct apc_event *event);
/* Write out what is queued, and the timing of task since the last time. Returns 0 or why it could not. */
int recorder_flush(struct recorder *recorder, const struct apc_task *task, apc_ns period);
const char *recorder_error(const struct recorder *recorder);

#endif
