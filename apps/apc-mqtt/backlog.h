/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the live store gets, on its way to a broker: moved into the queue, a store in a file, by an
 * apc_replication, and published from there, of each variable in its order, until it was acknowledged. How far
 * that has come stands in a file beside the queue; who was killed before it was written publishes some rows
 * again, under the same seq. What was acknowledged and is some minutes old is dropped from the queue.
 *
 * What the broker refuses stays in the queue, with all that follows it of this variable, and is tried again,
 * a row at a time; the other variables go on.
 */
#ifndef APC_MQTT_BACKLOG_H
#define APC_MQTT_BACKLOG_H

#include <apcstore.h>

#include "broker.h"
#include "files/files.h"

struct backlog;

/* Both stores stay the caller's and are nobody else's meanwhile; @queue lies in FILE. @name is what the
 * experiment is called. */
int backlog_create(struct backlog **backlog, struct apc_store *live, struct apc_store *queue,
                   const char *file, struct broker *broker, struct apc_error *why);
void backlog_destroy(struct backlog *b);

/* Take what is new into the queue, for up to @timeout. As apc_replication_step(). */
int backlog_take(struct backlog *b, apc_ns timeout);
const char *backlog_error(const struct backlog *b);
void backlog_stats(const struct backlog *b, struct apc_replication_stats *stats);
/* Publish a portion, and wait for its acknowledgement up to @timeout. Returns 1: there is more; 0; an error
 * of the queue or its file, which backlog_sent_error() says. */
int backlog_send(struct backlog *b, apc_ns timeout);
const char *backlog_sent_error(const struct backlog *b);

/* Does the broker refuse some of the variables? */
bool backlog_refused(const struct backlog *b);

/* The variables that are published, as the members of an object behind others. */
void backlog_describe(struct backlog *b, struct text *t);

#endif
