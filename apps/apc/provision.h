/* SPDX-License-Identifier: BSD-3-Clause */
/* Describe an experiment in the store: dimensions, tags, first tuning and mode. */
#ifndef APC_PROVISION_H
#define APC_PROVISION_H

#include <apcshareddata.h>

#include "common/experiment.h"

enum provision {
    PROVISION_KEEP, /* tuning and mode that are there stay: a plant that is being set up again */
    PROVISION_RESET /* tuning and mode become the file's: an experiment that is being run */
};

/* The experiment must have been loaded with its law. Returns 0 or the store's error. */
int provision(struct apc_store *store, const struct experiment *e, enum provision how);

#endif
