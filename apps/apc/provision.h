/* SPDX-License-Identifier: BSD-3-Clause */
/* Describe an experiment in the store: dimensions, tags, first tuning and mode. */
#ifndef APC_PROVISION_H
#define APC_PROVISION_H

#include <apcshareddata.h>

#include "common/experiment.h"

enum provision {
    PROVISION_KEEP, /* tuning and mode that are there stay: a plant that is being set up again */
    PROVISION_RESET /* tuning and mode become the file's, manual outputs nobody's: an experiment that is being
                       run */
};

#define PROVISION_TEXT 400

/*
 * Is what the store describes this experiment: the same name, the same signals with the same units? Returns
 * 0, also when it describes nothing yet, APC_EPERM with the difference in @p why, or the store's error.
 */
int provision_check(struct apc_store *store, const struct experiment *e, char why[PROVISION_TEXT]);

/* Are the signals of a description this experiment's: names, units, how many? 0, or APC_EPERM and why. */
int provision_compare(const struct experiment *e, const struct apc_tag *tag, size_t n,
                      char why[PROVISION_TEXT]);
/* What the experiment's variables are called and may be: *n of them, to be freed; NULL without memory. */
struct apc_tag *provision_tags(const struct experiment *e, size_t *n);

/* The experiment must have been loaded with its law. Returns 0 or the store's error. */
int provision(struct apc_store *store, const struct experiment *e, enum provision how);

#endif
