/* SPDX-License-Identifier: BSD-3-Clause */
/* What a law that plans ahead says of its last plan, as its controller published it: for apc status. */
#ifndef APC_STATUS_PLAN_H
#define APC_STATUS_PLAN_H

#include "apc/common/cli.h"
#include "files/files.h"

struct status_plan {
    const struct cli_tags *tags;
    const char *controller;
    struct apc_sample
        *row; /* [n] result, iterations, ..., limits, estimates; none of a law that does not plan */
    size_t n;
};

/* Returns 0, APC_ENOMEM or the store's error; status_plan_free() in either case. */
int status_plan_load(struct status_plan *p, struct apc_store *store, const struct cli_tags *tags,
                     const char *controller);
void status_plan_free(struct status_plan *p);
/* A line; nothing where there is no plan. */
void status_plan_show(const struct status_plan *p, apc_ns now);
/* `,"plan":{...}`; nothing where there is none. */
void status_plan_json(const struct status_plan *p, apc_ns now, struct text *t);

#endif
