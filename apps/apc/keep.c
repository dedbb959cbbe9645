/* SPDX-License-Identifier: BSD-3-Clause */
#include "keep.h"

#include <stdlib.h>

#include <unistd.h>

#include "common/storeuri.h"
#include "runstore.h"
#include "segment.h"
#include "spools.h"

#define STEP (5 * APC_NS_PER_S)

struct resume {
    struct apc_store *live;
    int rc;
};

static int resume_sample(void *ctx, const struct apc_sample *s)
{
    struct resume *r = ctx;
    struct apc_sample row = *s;
    row.author = 0; /* a number of the history's own */
    r->rc = apc_store_append(r->live, &row, 1);
    return 1;
}

static int resume_vector(void *ctx, const struct apc_vector *v)
{
    struct resume *r = ctx;
    struct apc_vector row = *v;
    const struct apc_rows rows = {.size = sizeof rows, .vector = &row, .n_vectors = 1};
    r->rc = apc_store_append_rows(r->live, &rows);
    return 1;
}

static bool is_in(const struct apc_sample *variables, int n, const struct apc_sample *like)
{
    for (int i = 0; i < n; i++)
        if (variables[i].table == like->table && variables[i].id == like->id)
            return true;
    return false;
}

/* Those that have samples; the list goes to free(). Returns how many or an error. */
static int list(struct apc_store *store, struct apc_sample **variables)
{
    const int n = apc_store_variables(store, NULL, 0);
    *variables = n > 0 ? calloc((size_t)n, sizeof **variables) : NULL;
    if (n > 0 && !*variables)
        return APC_ENOMEM;
    const int there = n > 0 ? apc_store_variables(store, *variables, (size_t)n) : n;
    return there < n ? there : n;
}

int keep_resume(struct apc_store *live, struct apc_store *history, struct apc_error *why)
{
    const struct apc_range newest = {.last = 1};
    struct resume r = {.live = live};
    struct apc_sample *has = NULL, *had = NULL;
    const int n_has = list(live, &has), n_had = list(history, &had);
    int rc = n_had;
    for (int i = 0; i < n_had && n_has >= 0 && rc >= 0 && r.rc >= 0; i++)
        if (had[i].table != APC_STATE && !is_in(has, n_has, &had[i]))
            rc = apc_table_vectors(had[i].table)
                     ? apc_store_vectors(history, had[i].table, had[i].id, &newest, resume_vector, &r)
                     : apc_store_history(history, had[i].table, had[i].id, &newest, resume_sample, &r);
    free(has);
    free(had);
    if (rc < 0)
        return apc_fail(why, rc, "the history: %s", apc_store_error(history));
    rc = n_has < 0 ? n_has : r.rc;
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(live)) : 0;
}

int keep_finish(const char *live, const char *history, apc_ns timeout, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = timeout};
    struct apc_store *from = NULL, *to = NULL;
    struct apc_forward *f = NULL;
    int rc = store_open(&from, live, &options, why);
    if (rc == 0)
        rc = store_open(&to, history, &options, why);
    if (rc == 0)
        rc = apc_forward_create(&f, from, to, why);
    if (rc == 0) {
        while ((rc = apc_forward_step(f, STEP)) > 0)
            ;
        if (rc < 0)
            apc_fail(why, rc, "the history: %s", apc_forward_error(f));
    }
    apc_forward_destroy(f);
    apc_store_close(from);
    apc_store_close(to);
    return rc;
}

int keep_left(const char *dir, const char *store, apc_ns timeout, struct apc_error *why)
{
    struct runstore r;
    struct segment segment;
    if (runstore_find(&r, dir, why) < 0 || !r.live[0]) /* spools may lie anywhere */
        return 0;
    const char *history = r.history[0] ? r.history : store;
    int rc = segment_adopt(&segment, r.live, why);
    if (rc <= 0)
        return rc;
    rc = history ? spools_drain(dir, r.live, timeout, why)
                 : apc_fail(why, APC_EINVAL, "%s does not say where its record goes: give --store URI", dir);
    if (rc == 0 || rc == APC_EPROTO) {
        const int kept = keep_finish(r.live, history, timeout, why);
        rc = kept < 0 ? kept : rc;
        if (kept == 0)
            segment_remove(&segment);
    }
    close(segment.lock);
    return rc < 0 ? rc : 1;
}
