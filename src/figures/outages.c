/* SPDX-License-Identifier: BSD-3-Clause */
#include <stdlib.h>

#include "figures_internal.h"

/* One variable while its rows pass by. */
struct outage_walk {
    struct outages *out;
    size_t tag;
    apc_ns from, until, patience;
    apc_ns last; /* row; 0: none yet */
    apc_ns bad;  /* since when they are; 0: they are not */
    apc_status status;
    int rc;
};

static void keep_outage(struct outage_walk *w, apc_ns from, apc_ns until, apc_status status)
{
    struct outages *o = w->out;
    from = from > w->from ? from : w->from;
    until = until < w->until ? until : w->until;
    if (from >= until || w->rc < 0)
        return;
    if (o->n == o->room) {
        struct outage *at = reallocarray(o->at, 2 * o->room + 64, sizeof *at);
        if (!at) {
            w->rc = APC_ENOMEM;
            return;
        }
        o->at = at;
        o->room = 2 * o->room + 64;
    }
    o->at[o->n++] = (struct outage){
        .from = from, .until = until, .table = o->tag[w->tag].table, .status = status, .tag = w->tag, .n = 1};
}

static void end_bad(struct outage_walk *w, apc_ns time)
{
    if (w->bad > 0)
        keep_outage(w, w->bad, time, w->status);
    w->bad = 0;
}

/* Up to the next row, or to the end. */
static void pass_gap(struct outage_walk *w, apc_ns time)
{
    if (w->last == 0 || time - w->last <= w->patience)
        return;
    end_bad(w, w->last);
    keep_outage(w, w->last, time, APC_GOOD);
}

static int take_outage_row(void *ctx, const struct apc_sample *row)
{
    struct outage_walk *w = ctx;
    pass_gap(w, row->time);
    if (apc_status_severity(row->status) != APC_SEVERITY_BAD)
        end_bad(w, row->time);
    else if (w->bad == 0) {
        w->bad = row->time;
        w->status = row->status;
    }
    w->last = row->time;
    return w->rc;
}

static int walk_variable(struct outages *o, struct apc_store *store, size_t i, apc_ns from, apc_ns until)
{
    const struct apc_tag *tag = &o->tag[i];
    const struct apc_range before = {.until = from, .last = 1}, range = {.since = from, .until = until};
    struct outage_walk w = {.out = o, .tag = i, .from = from, .until = until};
    apc_ns period = 0;
    (void)apc_ns_from_s(tag->period, &period);
    if ((tag->table != APC_SENSOR && tag->table != APC_ACTUATOR) || period == 0)
        return 0;
    w.patience = row_patience(period);
    int rc = from > 0 ? apc_store_history(store, tag->table, tag->id, &before, take_outage_row, &w) : 0;
    if (rc >= 0)
        rc = apc_store_history(store, tag->table, tag->id, &range, take_outage_row, &w);
    pass_gap(&w, until);
    end_bad(&w, until);
    return w.rc < 0 ? w.rc : rc < 0 ? rc : 0;
}

static int by_begin(const void *x, const void *y)
{
    const struct outage *a = x, *b = y;
    return a->from != b->from ? (a->from > b->from) - (a->from < b->from)
                              : (a->tag > b->tag) - (a->tag < b->tag);
}

static bool close_to(apc_ns a, apc_ns b)
{
    return (a > b ? a - b : b - a) <= APC_NS_PER_S;
}

/* Variables that went and came together. */
static void join_outages(struct outages *o)
{
    size_t n = 0;
    for (size_t i = 0; i < o->n; i++) {
        const struct outage next = o->at[i];
        size_t k = n;
        while (k > 0 && close_to(o->at[k - 1].from, next.from) &&
               (o->at[k - 1].until <= next.from || o->at[k - 1].table != next.table ||
                o->at[k - 1].status != next.status || !close_to(o->at[k - 1].until, next.until)))
            k--;
        if (k > 0 && close_to(o->at[k - 1].from, next.from))
            o->at[k - 1].n++;
        else
            o->at[n++] = next;
    }
    o->n = n;
}

static apc_ns count_down(const struct outages *o)
{
    apc_ns down = 0, counted = 0;
    for (const struct outage *at = o->at; at < o->at + o->n; at++) {
        const apc_ns from = at->from > counted ? at->from : counted;
        down += at->until > from ? at->until - from : 0;
        counted = at->until > counted ? at->until : counted;
    }
    return down;
}

int outages_of_store(struct outages *o, struct apc_store *store, apc_ns from, apc_ns until)
{
    const int n = apc_store_get_tags(store, NULL, 0);
    *o = (struct outages){.tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *o->tag)};
    int rc = n < 0 ? n : o->tag ? apc_store_get_tags(store, o->tag, (size_t)n) : APC_ENOMEM;
    o->n_tags = (size_t)(rc < 0 ? 0 : rc < n ? rc : n);
    for (size_t i = 0; i < o->n_tags && rc >= 0; i++)
        rc = walk_variable(o, store, i, from, until);
    if (o->n > 0)
        qsort(o->at, o->n, sizeof *o->at, by_begin);
    o->down = count_down(o);
    join_outages(o);
    return rc < 0 ? rc : 0;
}

void outages_free(struct outages *o)
{
    free(o->tag);
    free(o->at);
    *o = (struct outages){0};
}
