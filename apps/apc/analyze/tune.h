/* SPDX-License-Identifier: BSD-3-Clause */
/* apc tune --suggest: better numbers for the PID loops of a run, from what the run tells of the plant. */
#ifndef APC_TUNE_H
#define APC_TUNE_H

#include "apc/identify/identify.h"

enum suggest_rule { SUGGEST_SIMC, SUGGEST_LAMBDA, SUGGEST_RELAY, SUGGEST_RULES };

struct suggest_options {
    const char *run; /* or, with a model, an experiment file; NULL: nothing is suggested */
    const char *model, *figure;
    enum suggest_rule rule;
    double tau_c; /* s; 0: the dead time */
    bool apply, force, closed;
};

/* Transfer functions by the names of their signals; gain 0: there is none. */
struct suggest_model {
    char input[IDENTIFY_SIGNALS][APC_TAG_LEN], output[IDENTIFY_SIGNALS][APC_TAG_LEN];
    size_t inputs, outputs;
    struct apc_transfer g[IDENTIFY_SIGNALS * IDENTIFY_SIGNALS], error[IDENTIFY_SIGNALS * IDENTIFY_SIGNALS];
    struct apc_validation judged[IDENTIFY_SIGNALS]; /* of each output, by the record; of a model file zeros */
};
/* Those of o->model, into a model of zeros. Returns 0, APC_ENOTFOUND, APC_EPROTO, or APC_EINVAL. */
int suggest_read_model(const struct suggest_options *o, struct suggest_model *model, struct apc_error *why);

/* Numbers as apc tune takes them: name[i], to value[i]. */
struct suggestion {
    char (*name)[APC_TAG_LEN];
    double *value;
    size_t n;
};

/* Show what is suggested. Returns 0 or a negative error; suggestion_free() in either case. */
int suggest(const struct suggest_options *o, struct suggestion *s, struct apc_error *why);
void suggestion_free(struct suggestion *s);

#endif
