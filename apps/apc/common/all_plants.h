/* SPDX-License-Identifier: BSD-3-Clause */
/* The plants of a database, for what is done with all of them: `--all`. */
#ifndef APC_SEVERAL_H
#define APC_SEVERAL_H

#include "cli.h"

struct all_plants {
    struct apc_store_plant *plant;
    size_t n;
};
/* Those that this user may look at in the database of --store. Returns 0, or an error already said. */
int all_plants_load(struct all_plants *all, const struct cli *cli);
void all_plants_free(struct all_plants *all);
/* The store of one of them: that of --store with another schema. NULL: out of memory. For free(). */
char *all_plants_store(const struct cli *cli, const char *schema);
/* apc status --all. Returns an exit code. */
int all_plants_show(const struct cli *cli);

#endif
