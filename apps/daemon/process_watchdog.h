/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The one thread of a daemon that nothing else can hold up, whatever hangs: a callback, a store, a log's
 * reader. It takes the signals, tells the watchdog (systemd's, or that of `apc run`) that the task ticks, and
 * ends the process when it does not end by itself.
 */
#ifndef APC_WARDEN_H
#define APC_WARDEN_H

#include <apctimer.h>

#define WARDEN_PATIENCE (1800 * APC_NS_PER_MS) /* for the process to end, once it was told to */

struct process_watchdog;

/* Take over SIGTERM and SIGINT: before any other thread is made, so that all of them leave these to it.
 * Returns 0, APC_ENOMEM or APC_ESYS. */
int process_watchdog_create(struct process_watchdog **process_watchdog);
/* Wait for a signal. Returns it, also when it came before; 0 after @p timeout. One thread. */
int process_watchdog_wait(struct process_watchdog *process_watchdog, apc_ns timeout);
/* From now on tell the watchdog that @p task of this period ticks, as long as it does, one to five times a second. The task
 * lives until process_watchdog_ending(). */
void process_watchdog_watch(struct process_watchdog *process_watchdog, const struct apc_task *task,
                            apc_ns period);
/* A tick has returned. [tick] */
void process_watchdog_ticked(struct process_watchdog *process_watchdog, uint64_t index);
/* A word to who started this process, in the form of sd_notify(); never waits. */
void process_watchdog_tell(const struct process_watchdog *process_watchdog, const char *text);
/* The process is about to end; should it not, it does so with @p code after WARDEN_PATIENCE. */
void process_watchdog_ending(struct process_watchdog *process_watchdog, int code);
void process_watchdog_destroy(struct process_watchdog *process_watchdog); /* NULL is legal */

#endif
