/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The daemons of a run as child processes: started together, started again when one dies or no longer ticks,
 * stopped in order. That they tick they say over a socket, as to systemd: READY=1, WATCHDOG=1. Their messages
 * go into one log file each.
 */
#ifndef APC_SUPERVISOR_H
#define APC_SUPERVISOR_H

#include <stdbool.h>
#include <sys/types.h>

#include <apcbase.h>

#define SUPERVISOR_LOOK (250 * APC_NS_PER_MS)
#define SUPERVISOR_LEAD (2 * APC_NS_PER_S) /* t = 0 lies at most twice that, and its grid, after the start */

struct child {
    const char *name;     /* "apc-plant"; NULL: it was given up */
    char title[64];       /* "apc-controller base": for messages, and for its log; "": as its name */
    const char *extra[7]; /* options of its own, up to a NULL; borrowed */
    bool aside;           /* no part of the loop: no task, and the run goes on without it */
    apc_ns period;        /* of its task; 0: it has none, or is not judged by it */
    int listener;         /* a socket to be handed over as systemd does; 0: none */
    int asks;             /* on which it asks for t = 0; 0: it knows */
    pid_t pid;            /* 0: not running */
    apc_ns started;       /* monotonic; while it is not running: when to start it again */
    apc_ns ticked;        /* monotonic; when it last said so */
    int64_t last_tick;    /* its index; -1: none */
    bool hung;            /* was killed because it did not tick */
    unsigned failures;    /* in a row, each soon after its start */
    unsigned restarts;
    bool down, raised; /* supervisor_down(); supervisor_up(), and it is about to be started */
    unsigned faults;   /* how often it hung, or a signal such as SIGSEGV ended it */
    int status;        /* with which it ended the last time, as of waitpid() */
    char log[600];
};

struct supervisor {
    char folder[512]; /* of the programs */
    const char *config, *timer, *dir;
    bool spin, hold_latency;
    apc_ns start;        /* monotonic: t = 0; of a real plant supervisor_start() chooses it */
    apc_ns chosen;       /* the same in UTC, when it was chosen */
    apc_ns simulated;    /* t = 0 of a simulated plant, UTC; 0: time is real */
    int notify;          /* the socket */
    apc_ns heard;        /* monotonic; when it was last listened to; 0: never */
    char meeting[32];    /* folder that it lies in */
    struct child *child; /* [n] in the order in which they are started; stopped in reverse */
    size_t n;
};

/* Find the programs beside this one, start all; SIGUSR1 to those that run already, which begin anew. t = 0 is chosen when
 * the daemons are ready for it: soon on a machine at rest, later on a busy one. On failure all have been stopped. */
int supervisor_start(struct supervisor *s, struct apc_error *why);
/* Wait until @p timeout, or a signal, listening to the children meanwhile: their socket holds a few messages
 * only (ten, unless net.unix.max_dgram_qlen says more), and many children say more than that between two
 * looks. */
void supervisor_wait(struct supervisor *s, apc_ns timeout);
/*
 * Look after the children; never waits. To be called at least every SUPERVISOR_LOOK. One that has not ticked
 * for max(3 periods, 1 s) is killed within a second more. A child that died is started again, after a pause
 * that grows while it fails. Returns how many were (who, and how it had ended, is in why), or APC_ESTATE when
 * one would not run from the beginning, or will not run again: its last message is in why. Of a child aside
 * that is no error: it is given up.
 */
int supervisor_check(struct supervisor *s, struct apc_error *why);
/* Kill a child, as an experiment asks for: it stays down until it is started again; neither is a fault. */
void supervisor_down(struct child *child);
void supervisor_up(struct child *child);
/* SIGTERM, the last started first, each gets some seconds; then SIGKILL. Returns 0, or APC_ESTATE when one of
 * the loop needed that or ended with an error: which, in why. */
int supervisor_stop(struct supervisor *s, struct apc_error *why);

#endif
