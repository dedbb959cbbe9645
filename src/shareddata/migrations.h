/* SPDX-License-Identifier: BSD-3-Clause */
/* The files of sql/, built into the library. */
#ifndef APC_MIGRATIONS_H
#define APC_MIGRATIONS_H

#include <stdbool.h>

struct apc_migration {
    int number;  /* 1, 2, ...: the version that it makes ... */
    bool repair; /* ... unless it mends the version before it, and leaves the number as it is */
    const char *name;
    const char *sql; /* the schema is the first of the search_path */
};

/* What was made before the first release, and lacks something: that commit's `apc init` is the one way. */
#define APC_FORMER_COMMIT "1f068024"

extern const struct apc_migration apc_migrations[];
extern const int apc_migration_count;

#endif
