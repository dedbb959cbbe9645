/* SPDX-License-Identifier: BSD-3-Clause */
/* Records from a store: what it has of a window of time. */
#include "grid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ROWS_MOST 10000000

struct collecting {
    struct reading *r;
    struct series *to;
    apc_ns *zero; /* the time that counts as 0 s; 0: not known yet */
    int rc;
};

static int collect_stored_row(void *ctx, const struct apc_sample *row)
{
    struct collecting *c = ctx;
    struct series *s = c->to;

    if (*c->zero == 0)
        *c->zero = row->time;
    const double t = 1e-9 * (double)(row->time - *c->zero);
    if (s->n > 0 && !(t > s->t[s->n - 1])) /* the clock was put back */
        return 0;
    if (s->n == ROWS_MOST) {
        c->rc =
            apc_fail(c->r->why, APC_EINVAL, "%s: more than %d samples of \"%s\" in that time: --from, --to",
                     c->r->file, ROWS_MOST, s->name);
        return 1;
    }
    c->rc = series_add(c->r, s, t,
                       apc_status_severity(row->status) == APC_SEVERITY_BAD ? (double)NAN : row->value);
    return c->rc;
}

static int read_series(struct reading *r, struct apc_store *store, const struct known *known, bool input,
                       struct collecting *c)
{
    const struct identify_selection *selection = r->selection;
    const struct apc_range range = {.since = selection->since, .until = selection->until},
                           before = {.until = selection->since, .last = 1};
    int rc = 0;

    if (input && selection->since > 0) /* what is in force when the window begins */
        rc = apc_store_history(store, known->table, known->id, &before, collect_stored_row, c);
    if (rc >= 0 && c->rc == 0)
        rc = apc_store_history(store, known->table, known->id, &range, collect_stored_row, c);
    if (c->rc < 0)
        return c->rc;
    return rc < 0 ? apc_fail(r->why, rc, "%s: %s", r->file, apc_store_error(store)) : 0;
}

static int read_known_variables(struct reading *r, struct apc_store *store, struct known **known, size_t *n)
{
    struct apc_tag *tag = NULL;
    int there = apc_store_get_tags(store, NULL, 0);

    *known = NULL;
    *n = 0;
    if (there >= 0) {
        tag = calloc((size_t)there + 1, sizeof *tag);
        *known = calloc((size_t)there + 1, sizeof **known);
        if (!tag || !*known) {
            free(tag);
            return apc_fail(r->why, APC_ENOMEM, "out of memory");
        }
        const int now = apc_store_get_tags(store, tag, (size_t)there);
        there = now < there ? now : there;
    }
    for (int i = 0; i < there; i++) {
        (*known)[i] = (struct known){.table = tag[i].table, .id = tag[i].id, .period = tag[i].period};
        memcpy((*known)[i].name, tag[i].name, sizeof tag[i].name);
        memcpy((*known)[i].unit, tag[i].unit, sizeof tag[i].unit);
    }
    free(tag);
    if (there < 0)
        return apc_fail(r->why, there, "%s: %s", r->file, apc_store_error(store));
    *n = (size_t)there;
    return 0;
}

int stored_read(struct reading *r)
{
    struct known *known = NULL;
    struct series **of = NULL;
    apc_ns zero = r->selection->since;
    size_t n = 0;
    int rc = read_known_variables(r, r->store, &known, &n);

    if (rc == 0 && !(of = calloc(n + 1, sizeof(struct series *))))
        rc = apc_fail(r->why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = series_choose(r, known, n, of);
    for (int pass = 0; pass < 2 && rc == 0; pass++) /* measurements first: they say when it begins */
        for (size_t i = 0; i < n && rc == 0; i++) {
            const bool input = of[i] >= r->input && of[i] < r->input + r->inputs;
            if (of[i] && input == (pass == 1))
                rc = read_series(r, r->store, &known[i], input,
                                 &(struct collecting){.r = r, .to = of[i], .zero = &zero});
        }
    free(of);
    free(known);
    return rc;
}
