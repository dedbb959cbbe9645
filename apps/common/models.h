/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the world around the modules is like in virtual time: the network, the execution times and the jitter
 * of the tasks, the wall clock. Of an experiment file, but for the daemons; the network also from `--net`.
 */
#ifndef APC_MODELS_H
#define APC_MODELS_H

#include <apcsockets.h>

#include "settings.h"

struct network_model {
    struct apc_network_options options; /* outages in time since the start of the run */
    struct apc_outage *outages;         /* those of the options */
};

/* How one task keeps time. */
struct task_model {
    struct apc_distribution execution, jitter; /* kind 0: none */
};

/* From @at since the start on: a step of the wall clock, and how much it gains a second. */
struct clock_change {
    apc_ns at, step;
    double drift;
};

/* Histograms that were read for distributions; they live as long as these. */
struct recordings {
    struct recording {
        struct apc_share *shares;
    } * at;
    size_t n;
};

struct models {
    struct network_model network;
    struct clock_change *clock;
    size_t n_clock;
    struct recordings recordings;
};

/* "network" and "clock" of the file's root. */
void models_read(struct settings *s, const config_setting_t *root, struct models *m);
/* "execution" and "jitter" in the group of task @name. */
void models_read_task(struct settings *s, const config_setting_t *group, const char *name,
                      struct task_model *task, struct recordings *recordings);
void models_free(struct models *m);

/* delay=normal(0.004,0.001),loss=0.01,outage=10-12,... in place of, or in addition to, what the file says. */
int models_network(struct models *m, const char *spec, struct apc_error *why);

#endif
