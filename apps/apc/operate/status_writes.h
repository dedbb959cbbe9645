/* SPDX-License-Identifier: BSD-3-Clause */
/* Which setpoints, modes, tunings and manual outputs stand as somebody wrote them, and who: for apc status. */
#ifndef APC_STATUS_WRITES_H
#define APC_STATUS_WRITES_H

#include "apc/common/cli.h"
#include "files/files.h"

struct status_writes {
    const struct cli_tags *tags;
    struct apc_sample *row;         /* [n] latest first */
    char (*author)[APC_AUTHOR_LEN]; /* [n] */
    size_t n;
};

/* Returns 0, APC_ENOMEM or the store's error; status_writes_free() in either case. */
int status_writes_load(struct status_writes *w, struct apc_store *store, const struct cli_tags *tags);
void status_writes_free(struct status_writes *w);
/* A table of the last ones; nothing where there is none. Returns 0 or APC_ENOMEM. */
int status_writes_show(const struct status_writes *w, bool colour);
/* `"writes":[...]`, all of them. */
void status_writes_json(const struct status_writes *w, apc_ns now, struct text *t);

#endif
