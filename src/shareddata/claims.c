/* SPDX-License-Identifier: BSD-3-Clause */
/* The variables that a handle has claimed, to be claimed anew with its next connection. */
#include <stdlib.h>

#include "shareddata/shareddata_internal.h"

static size_t find_claim(const struct apc_claims *c, const struct apc_sample *v)
{
    size_t i = 0;
    while (i < c->n && (c->at[i].table != v->table || c->at[i].id != v->id)) {
        i++;
    }
    return i;
}

int apc_claims_reserve(struct apc_store *store, struct apc_claims *c, size_t n)
{
    struct apc_sample *at = (struct apc_sample *)realloc(c->at, (c->n + n) * sizeof *at);
    if (!at) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for a claim of %zu", n);
    }
    c->at = at;
    return 0;
}

void apc_claims_add(struct apc_claims *c, const struct apc_sample *variables, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (find_claim(c, &variables[i]) == c->n) {
            c->at[c->n++] = (struct apc_sample){.table = variables[i].table, .id = variables[i].id};
        }
    }
}

void apc_claims_drop(struct apc_claims *c, const struct apc_sample *variables, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const size_t at = find_claim(c, &variables[i]);
        if (at < c->n) {
            c->at[at] = c->at[--c->n];
        }
    }
}
