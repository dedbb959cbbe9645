/* SPDX-License-Identifier: BSD-3-Clause */
/* What a law in a process of its own consists of: process.c keeps the process and asks it, process_law.c
 * makes a struct apc_law and its instances of it. */
#ifndef APC_CONTROL_PROCESS_PARTS_H
#define APC_CONTROL_PROCESS_PARTS_H

#include "base/subprocess.h"
#include "control/process/process.h"

enum kind { CREATE = 1, DESTROY, RESET, COMPUTE, UPDATE, TRACK };

struct header {
    uint32_t kind, instance, number, result; /* number: of the request, in its answer as well */
};

struct instance {
    struct process *of;
    struct instance *next;
    uint32_t number;
    struct apc_dim dim;
    size_t tuning, states, n_ahead, published;
    struct apc_published *what;
    char *texts, *setup; /* of what; as it was sent */
    size_t setup_length;
    unsigned char *request, *answer; /* a header, then numbers; room behind the answer for why */
    size_t n_request, n_answer;      /* numbers */
};

struct process {
    struct apc_plugin plugin;
    struct apc_law law;
    char *texts; /* of the law's description */
    struct apc_param *param;
    enum apc_law_scope *scope;
    const char **settings;
    bool resets, updates, tracks;
    uint32_t mark;
    apc_ns timeout;

    struct apc_subprocess own; /* of its lock is all below, too */
    uint32_t asked;            /* number of the newest request */
    bool waiting;              /* which has not been answered */
    unsigned falls;
    bool given_up;
    struct instance *instances;
    uint32_t instance;      /* number of the newest */
    double told_at;         /* s of the schedule; below 0: nothing was told */
    char told[APC_LAW_SAY]; /* what was, without the bytes before it */
};

/* The caller holds the lock, or is alone with @p p. */

/* Start it; it has not said anything yet. */
int apc_process_begin(struct process *p, struct apc_error *why);
/* Anew, with all instances that it had. */
bool apc_process_revive(struct apc_subprocess *own);
/* Is there a process to be asked? */
bool apc_process_is_there(struct process *p, bool live);
/* The text with which it answers in set-up, into @p text [APC_SUBPROCESS_MESSAGE + 1]; "error TEXT" is why. */
int apc_process_hear(struct process *p, char *text, struct apc_error *why);
/* Tell it of an instance; its answer as above. */
int apc_process_introduce(struct process *p, const struct instance *i, char *text, struct apc_error *why);

/* With the lock taken here: ask, and take x or, of compute, the rest out of the answer. [tick] */
int apc_process_ask(const struct apc_law_call *c, enum kind kind);

#endif
