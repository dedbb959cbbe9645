/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Who is told of new alarms: a command of the experiment file, run once for each, one after another, by a
 * thread of its own; at once, or when nobody has acknowledged it for some time, and again until somebody has;
 * not in quiet hours. What it has not done within its time is killed; what waits while it runs is bounded.
 * That it fails, and that it works again, is an event.
 */
#ifndef APC_ALARMS_NOTIFIER_H
#define APC_ALARMS_NOTIFIER_H

#include "daemon/daemon.h"

struct notifier;

/* d and is must outlive it. Returns 0, or an error already reported. */
int notifier_start(struct notifier **notifier, struct daemon *d, const struct alarm_notice *is);
/* An alarm is raised: a new row of table alarm. again: it may have been told before. Never waits for the
 * command. [tick] */
void notifier_tell(struct notifier *notifier, const struct apc_sample *row, bool again);
/* A row of any other state: what is acknowledged is not told later. [tick] */
void notifier_follow(struct notifier *notifier, const struct apc_sample *row);
/* Ends a command that runs; what waits is not told. NULL is legal. */
void notifier_stop(struct notifier *notifier);

/* A message that tells of nothing. Returns whether the command took it; if not, @p why says what came. */
bool notifier_try(const struct experiment *e, const struct alarm_notice *is, char *why, size_t size);

#endif
