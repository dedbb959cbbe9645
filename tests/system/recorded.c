/* SPDX-License-Identifier: BSD-3-Clause */
/* recorded RUN STORE: the samples and what was operated, of a run in virtual time, at their times in a store. */
#include <stdio.h>
#include <stdlib.h>

#include "record/record.h"
#include "simulation/simulation.h"

static int put_file(struct apc_store *store, const char *dir, const char *name, struct apc_error *why)
{
    struct samples all = {0};
    int rc = samples_read(&all, dir, name, why);
    for (size_t i = 0; i < all.n && rc >= 0; i++) {
        if (all.at[i].seq == 1) {
            struct apc_sample mine = all.at[i];
            rc = apc_store_claim_set(store, &mine, 1);
        }
        all.at[i].time += SIMULATION_BEGIN;
    }
    for (size_t i = 0; i < all.n && rc >= 0; i += 4096)
        rc = apc_store_append(store, &all.at[i], all.n - i < 4096 ? all.n - i : 4096);
    samples_free(&all);
    return rc < 0 && !why->text[0] ? apc_fail(why, rc, "%s: %s", name, apc_store_error(store)) : rc;
}

int main(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    int rc = argc == 3 ? apc_store_open(&store, argv[2], NULL, &why) : APC_EINVAL;
    if (rc == 0)
        rc = put_file(store, argv[1], "samples.csv", &why);
    if (rc >= 0)
        rc = put_file(store, argv[1], "operation.csv", &why);
    if (rc < 0)
        fprintf(stderr, "recorded: %s\n", why.text);
    apc_store_close(store);
    return rc < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
