/* SPDX-License-Identifier: BSD-3-Clause */
/* The store of a program. */
#ifndef APC_STOREURI_H
#define APC_STOREURI_H

#include <apcstore.h>

/* For the help of the option. */
#define STORE_HELP                                                                                           \
    "Shared data: postgresql://host/db#schema, sqlite:FILE, shm:NAME, shm:NAME+HISTORY [APC_STORE]"

/* apc_store_open(), but for the memory of this very process, which no other program would see. */
int store_open(struct apc_store **store, const char *uri, const struct apc_store_options *options,
               struct apc_error *why);
#define STORE_BEGINS "nobody simulates the plant yet: its `apc run --speed` begins"
/* Is the plant of a store one that `apc run --speed` simulates? 1; 0: its time is real; APC_ESTATE: nobody does yet, or
 * any more, and its time stands still; or the store's error. Sets the clock but for an error of the store's. */
int store_simulated(struct apc_store *store, struct apc_store_clock *clock, struct apc_error *why);
/* Is, or was, the plant of a store that is there simulated? While it is, the process's UTC is the plant's from now on.
 */
bool store_follow(const char *uri);
/* Is it the URI of a store, and no file? */
bool store_is_uri(const char *text);
/* Of LIVE+HISTORY the live store's own URI, which may be in @p room; else @p uri. */
const char *store_live(const char *uri, char room[256]);
/* Which store a URI means, without passwords, and for "postgresql:" with what the environment says. */
void store_name(const char *uri, char *name, size_t size);

#endif
