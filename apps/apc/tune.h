/* SPDX-License-Identifier: BSD-3-Clause */
/* apc tune --suggest: better numbers for the PID loops of a run, from what the run tells of the plant. */
#ifndef APC_TUNE_H
#define APC_TUNE_H

#include "cli.h"

enum suggest_rule { SUGGEST_SIMC, SUGGEST_LAMBDA, SUGGEST_RELAY, SUGGEST_RULES };

struct suggest_options {
    const char *run; /* NULL: nothing is suggested */
    enum suggest_rule rule;
    double tau_c; /* s; 0: the dead time */
    bool apply;
};

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
