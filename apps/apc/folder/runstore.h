/* SPDX-License-Identifier: BSD-3-Clause */
/* A run folder stands for the stores of its run. */
#ifndef APC_RUNSTORE_H
#define APC_RUNSTORE_H

#include <stddef.h>

#include <apcbase.h>

#define RUNSTORE_LEN 1200

struct runstore {
    char live[160];             /* "shm:..." that is there; "": there is none */
    char history[RUNSTORE_LEN]; /* "": not known, as one with a password */
};

/* Those of the run folder @p dir, wherever it has been moved to. Returns 0 or an error in @p why. */
int runstore_find(struct runstore *r, const char *dir, struct apc_error *why);
/* The URI of both, or of the one that there is. */
int runstore_uri(const char *dir, char uri[RUNSTORE_LEN], struct apc_error *why);
/* The run folder whose record a store's URI names. Returns 0 or APC_ENOTFOUND: it is no run's. */
int runstore_folder(const char *uri, char dir[RUNSTORE_LEN]);
/* Is the live store of @p uri shared memory that is not there? */
bool runstore_gone(const char *uri);

#endif
