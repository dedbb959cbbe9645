/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A process of its own for what this one must not suffer from: a law in Python, an FMU. What it does to its
 * process, it does to no other: it may hang, exit, be killed, print without end.
 *
 * It holds the other end of a pair of sockets (SOCK_SEQPACKET: a message is whole or is not there) as its
 * descriptor 3. What it prints goes into a pipe that never makes it wait: what does not fit is gone. Who
 * keeps a subprocess asks it with its lock held, but where `starting` says that it is in other hands.
 */
#ifndef APC_BASE_SUBPROCESS_H
#define APC_BASE_SUBPROCESS_H

#include "base/base_internal.h"

#include <pthread.h>
#include <stdatomic.h>
#include <sys/types.h>

#define APC_SUBPROCESS_MESSAGE (1 << 17) /* bytes of a message, which a socket takes at once */
#define APC_SUBPROCESS_SAID    1024      /* of what it printed, the last so many bytes are kept */

struct apc_subprocess {
    const char *file; /* what it is there for, in sentences for people */
    /* Start it and tell it all that it has to know. [setup], and by a thread of its own */
    bool (*revive)(struct apc_subprocess *subprocess);

    pthread_mutex_t lock; /* of all below */
    int socket, output;   /* -1: there is no process */
    pid_t pid, owner;     /* owner: whose it is; a process that was forked since has to start its own */
    apc_ns since;         /* mono: of the newest request; of the last start */
    bool starting;
    pid_t started; /* of the process whose thread `starter` is; 0: there is none */
    pthread_t starter;
    atomic_bool parting; /* what is being started is not waited for any more */
    char end[64];        /* how it ended */
    char said[APC_SUBPROCESS_SAID];
    size_t n_said;
    uint64_t lost; /* bytes that were printed before those */
};

/* There is no process yet. Returns 0 or APC_ESYS. */
int apc_subprocess_open(struct apc_subprocess *c, const char *file, bool (*revive)(struct apc_subprocess *));
/* End the process, and what starts it. */
void apc_subprocess_close(struct apc_subprocess *c);
/* The same for what tidies up and ends when its socket is closed: it is given the time. */
void apc_subprocess_release(struct apc_subprocess *c);

/* The caller holds the lock, or is alone with @p c. */

/* Start @p argv, found as the shell does, with @p extra ("NAME=VALUE"; NULL: nothing) in its environment, and
 * as nice as this process; of its SCHED_FIFO or SCHED_RR one priority less. It has not said anything yet.
 * Returns 0, or APC_ESYS and in @p why only what the system says. [setup] */
int apc_subprocess_begin(struct apc_subprocess *c, char *const argv[], char *extra, struct apc_error *why);
/* End it, and say in `end` how it ended; it hung: it is killed. */
void apc_subprocess_bury(struct apc_subprocess *c, bool hung);
/* After a fork: what is the parent's is not asked. [tick] */
void apc_subprocess_disown(struct apc_subprocess *c);
/* A message, whole. [tick] */
bool apc_subprocess_give(const struct apc_subprocess *c, const void *from, size_t n);
/* Returns the bytes, 0 when it has ended, -1: nothing by @p until (mono), or it is parted with. [tick] */
ssize_t apc_subprocess_take(const struct apc_subprocess *c, void *to, size_t size, apc_ns until);
/* Take what it has printed out of the pipe. [tick] */
void apc_subprocess_listen(struct apc_subprocess *c);
/* The end of that, on one line, into @p text; then it is forgotten. [tick] */
void apc_subprocess_said(struct apc_subprocess *c, char *text, size_t size);
/* Have it revived by a thread of an ordinary priority: until `starting` is false, it is not to be touched.
 * [tick] */
void apc_subprocess_start(struct apc_subprocess *c);

/* These take the lock: nobody starts it any more. Until it has been started, or has failed to. [setup] */
void apc_subprocess_settle(struct apc_subprocess *c);
/* The same, at once: what is being started has failed. [setup] */
void apc_subprocess_part(struct apc_subprocess *c);

#endif
