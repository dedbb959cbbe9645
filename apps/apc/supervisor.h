/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The daemons of a run as child processes: started together, started again when one dies, stopped in
 * order. Their messages go into one log file each.
 */
#ifndef APC_SUPERVISOR_H
#define APC_SUPERVISOR_H

#include <stdbool.h>
#include <sys/types.h>

#include <apcbase.h>

#define DAEMONS 5

struct child {
    const char *name;     /* "apc-plant" */
    const char *extra[3]; /* options of its own, up to a NULL */
    bool aside;           /* no part of the loop: no task, and the run goes on without it */
    pid_t pid;            /* 0: not running */
    apc_ns started;       /* monotonic; while it is not running: when to start it again */
    unsigned failures;    /* in a row, each soon after its start */
    unsigned restarts;
    int status; /* with which it ended the last time, as of waitpid() */
    char log[600];
};

struct supervisor {
    char folder[512]; /* of the programs */
    const char *config, *timer, *dir;
    bool spin, hold_latency;
    apc_ns start; /* monotonic: t = 0 */
    struct child
        child[DAEMONS]; /* in the order in which they are started; stopped in reverse; name NULL: none */
};

/* Find the programs beside this one, start all. On failure those started have been stopped. */
int supervisor_start(struct supervisor *s, struct apc_error *why);
/*
 * Look after the children; never waits. A child that died is started again, after a pause that grows while it
 * fails. Returns how many were (who, and how it had ended, is in why), or APC_ESTATE when one would not run
 * from the beginning, or will not run again: its last message is in why. Of a child aside that is no error:
 * it is given up.
 */
int supervisor_check(struct supervisor *s, struct apc_error *why);
/* SIGTERM, the last started first, each gets some seconds; then SIGKILL. Returns 0, or APC_ETIMEDOUT when
 * that was needed. */
int supervisor_stop(struct supervisor *s);

#endif
