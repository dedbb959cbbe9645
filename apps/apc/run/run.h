/* SPDX-License-Identifier: BSD-3-Clause */
/* What one `apc run` is, shared by its files: run.c (the daemons), run_simulated.c (what is there instead of
 * them), run_prepare.c (before), run_finish.c (after). */
#ifndef APC_RUN_H
#define APC_RUN_H

#include <limits.h>
#include <signal.h>

#include "apc/common/cli.h"
#include "apc/folder/segment.h"
#include "apc/folder/store_folder.h"
#include "experiment/experiment.h"
#include "live.h"
#include "record/record.h"
#include "supervisor.h"

struct run_options {
    double duration; /* s; < 0: the file's */
    const char *out, *timer, *history;
    bool spin, hold_latency, no_ui, force;
    const char *pace; /* --speed; NULL: in real time, with daemons */
    double speed;
    double from;          /* s: until then it is what was in the run whose folder it is; 0: not */
    char from_store[400]; /* instead, what is in this store on record, */
    apc_ns from_utc;      /* until then; "": in none */
    struct experiment_overrides overrides;
};

struct run {
    struct cli cli;
    struct run_options options;
    struct experiment e;
    struct apc_store *store;
    struct apc_store *guard; /* --speed: claims the first measurement while it simulates */
    struct supervisor daemons;
    struct live *live;
    char page[64];           /* ADDRESS:PORT of the operator's page; "": none */
    int listener;            /* its socket */
    char graphic[PATH_MAX];  /* the drawing beside the file, which may not be there; "": not looked for yet */
    char displays[PATH_MAX]; /* the folder of displays beside the file */
    struct apc_error failure;    /* why the run is none; "": nothing known */
    apc_ns start, begin, finish; /* t = 0: UTC then, monotonic; monotonic end, 0: none */
    apc_ns stopped;              /* monotonic: when it was ended */
    size_t controllers;          /* the first one's place among the daemons */
    size_t done;                 /* of the experiment's actions */
    struct samples written;      /* --from: what people wrote before it */
    struct store_folder past;    /* what was, of a store */
    apc_ns rewind; /* UTC of the simulated plant to which people want to go back; 0: they do not */
    pid_t parent;  /* it ends with that process, whose second run it is; 0: with none */
    pid_t rewound; /* the page's process, from the run that was rewound; 0: there is none */
    char dir[512], config[544], store_name[400], live_name[128], host[256];
    struct segment segment;          /* the store in memory, if it was given none */
    char own_history[PATH_MAX + 32]; /* URI of a file in dir; "": it was given one, or a store alone */
    char live_uri[256];              /* of --store LIVE+HISTORY */
    char *history;                   /* its URI, with a path that holds in any folder; NULL: there is none */
    char *both;                      /* LIVE+HISTORY, likewise */
    bool made_store;                 /* own_history was not there before */
    const char *record;              /* URI of the store that holds the record in the end */
};

/* ---- run_prepare.c: each returns 0 or a negative error, having said why. */

int run_prepare_folder(struct run *r);
/* Nobody named a store: memory of its own, and the record, if nobody said where, in the run folder. */
int run_embed_store(struct run *r);
/* Live store and history as one, for those who look on. */
int run_join_stores(struct run *r);
/* The store is this experiment's and nobody else's, and so is the history, if it is there. */
int run_prepare_store(struct run *r);
/* t = 0 is chosen, and from now on the folder is this run's. */
int run_keep_folder(struct run *r);
/* The run did not come about: what was made for it goes. */
void run_discard(const struct run *r);
/* Both in one, if the live store is memory; else the store. */
const char *run_store(const struct run *r);

/* ---- run_simulated.c */

/* Until the end, a signal, or a failure, which is in r->failure. */
void run_simulated(struct run *r, const sigset_t *signals);

/* ---- run_rewind.c */

/* Of the run that was rewound, whose process this was: the page's process, socket and drawing, the name of the store. */
void run_take_over(struct run *r);
/* What was is a run folder by itself, and is set aside: a process finishes it. This one becomes the run that goes on from
 * there. Returns, having said why, only if that cannot be. */
int run_rewind(struct run *r);
/* Of what was set aside, let go what is finished. */
void run_look_aside(void);
/* All of it is finished. */
void run_await_aside(void);

/* ---- run_finish.c */

/* The record is made whole, judged and reported. Returns 0 or a negative error, having said why. */
int run_finish(struct run *r);

#endif
