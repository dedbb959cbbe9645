/* SPDX-License-Identifier: BSD-3-Clause */
/* --set PATH=VALUE, any number of times. */
#ifndef APC_SETTING_H
#define APC_SETTING_H

#include "cli.h"
#include "experiment/experiment.h"

#define SETTINGS 64

struct setting_list {
    struct experiment_setting at[SETTINGS];
    size_t n;
};

/* @arg is cut in two. A usage error where it is no PATH=VALUE. */
void setting_add(void *setting_list, char *arg, const struct argp_state *state);

#endif
