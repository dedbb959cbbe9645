/* SPDX-License-Identifier: BSD-3-Clause */
/* The spools of a folder: what daemons keep back while the store is away. */
#ifndef APC_SPOOLS_H
#define APC_SPOOLS_H

#include <apcstore.h>

#define SPOOLS_MAX 32

struct spools {
    struct apc_spool_info info[SPOOLS_MAX];
    char path[SPOOLS_MAX][512];
    size_t n;
};

/* Look into every *.spool of the folder, in order of name. Returns 0 or the first error: those that can be
 * read are there all the same. */
int spools_look(struct spools *spools, const char *dir, struct apc_error *why);

/* Store what waits in them, and remove them; one that cannot be does not keep the others. Returns 0, or why
 * something is left. */
int spools_drain(const char *dir, const char *uri, apc_ns timeout, struct apc_error *why);

#endif
