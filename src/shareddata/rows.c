/* SPDX-License-Identifier: BSD-3-Clause */
/* What the tables' constraints are in PostgreSQL, for the stores that have no server to check them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "shareddata/shareddata_internal.h"

__extension__ typedef unsigned __int128 uwide;

/* ---- Samples ------------------------------------------------------------------------------- */

int apc_rows_check(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &samples[i];
        if (s->seq > APC_SEQ_MAX) {
            return apc_rows_seq_failure(store, s);
        }
        if ((s->table == APC_DIM || s->table == APC_OPMODE || s->table == APC_ALARM) &&
            trunc(s->value) != s->value) {
            return apc_fail(&store->why, APC_ESTORE, "%s %d: %g breaks value_whole: expected a whole number",
                            apc_table_name(s->table), s->id, s->value);
        }
    }
    return 0;
}

int apc_vectors_check(struct apc_store *store, const struct apc_vector *vectors, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (vectors[i].seq > APC_SEQ_MAX) {
            return apc_rows_seq_failure(store,
                                        &(struct apc_sample){.table = vectors[i].table, .id = vectors[i].id});
        }
    }
    return 0;
}

int apc_rows_seq_failure(struct apc_store *store, const struct apc_sample *s)
{
    return apc_fail(&store->why, APC_ESTORE, "%s %d: the next seq breaks seq_in_range: expected below 2^53",
                    apc_table_name(s->table), s->id);
}

static int by_variable(const void *a, const void *b)
{
    const struct apc_sample *x = (const struct apc_sample *)a, *y = (const struct apc_sample *)b;
    return x->table != y->table ? (x->table > y->table) - (x->table < y->table)
                                : (x->id > y->id) - (x->id < y->id);
}

int apc_variables_give(struct apc_sample *all, size_t n, struct apc_sample *variables, size_t capacity)
{
    qsort(all, n, sizeof *all, by_variable);
    for (size_t i = 0; i < n && i < capacity; i++) {
        variables[i] = (struct apc_sample){.table = all[i].table, .id = all[i].id};
    }
    free(all);
    return (int)n;
}

/* ---- Events and timing rows ------------------------------------------------------------------ */

struct apc_event apc_event_row(const struct apc_event *e)
{
    struct apc_event row = {.time = apc_time_stored(e->time), .severity = e->severity};
    text_clean(row.source, e->source, sizeof row.source);
    text_clean(row.kind, e->kind, sizeof row.kind);
    text_clean(row.text, e->text, sizeof row.text);
    return row;
}

struct apc_timing_row apc_timing_stored(const struct apc_timing_row *r)
{
    struct apc_timing_row row = *r;
    row.time = apc_time_stored(r->time);
    text_clean(row.task, r->task, sizeof row.task);
    return row;
}

void apc_tag_clean(struct apc_tag *t)
{
    text_clean(t->name, t->name, sizeof t->name);
    text_clean(t->unit, t->unit, sizeof t->unit);
    text_clean(t->description, t->description, sizeof t->description);
    text_clean(t->controller, t->controller, sizeof t->controller);
    text_clean(t->area, t->area, sizeof t->area);
}

/* ---- Tags ---------------------------------------------------------------------------------- */

static int by_variable_name(const void *a, const void *b)
{
    const struct apc_tag *x = (const struct apc_tag *)a, *y = (const struct apc_tag *)b;
    return x->table != y->table ? (x->table > y->table) - (x->table < y->table) : strcmp(x->name, y->name);
}

static int by_key(const void *a, const void *b)
{
    const struct apc_tag *x = (const struct apc_tag *)a, *y = (const struct apc_tag *)b;
    return x->table != y->table ? (x->table > y->table) - (x->table < y->table)
                                : (x->id > y->id) - (x->id < y->id);
}

int apc_tags_sort(struct apc_store *store, const struct apc_tag *tags, size_t n, struct apc_tag **sorted)
{
    struct apc_tag *t = (struct apc_tag *)calloc(n ? n : 1, sizeof *t);
    if (!t) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for %zu tags", n);
    }
    for (size_t i = 0; i < n; i++) {
        t[i] = tags[i];
        apc_tag_clean(&t[i]);
    }
    int err = 0;
    qsort(t, n, sizeof *t, by_variable_name);
    for (size_t i = 0; !err && i < n; i++) {
        if (t[i].name[0] == '\0' || (i > 0 && by_variable_name(&t[i - 1], &t[i]) == 0)) {
            err =
                apc_fail(&store->why, APC_ESTORE, "%s %d: the name \"%s\" is %s", apc_table_name(t[i].table),
                         t[i].id, t[i].name, t[i].name[0] ? "another one's too" : "empty");
        }
    }
    qsort(t, n, sizeof *t, by_key);
    for (size_t i = 1; !err && i < n; i++) {
        if (by_key(&t[i - 1], &t[i]) == 0) {
            err = apc_fail(&store->why, APC_ESTORE, "%s %d is described twice", apc_table_name(t[i].table),
                           t[i].id);
        }
    }
    if (err) {
        free(t);
        t = NULL;
    }
    *sorted = t;
    return err;
}

/* ---- Bins ---------------------------------------------------------------------------------- */

struct apc_bin_sum {
    struct apc_history_bin b;
    long double sum; /* of values below 1e300: cannot overflow */
    int64_t final;   /* seq of the last value */
};

int apc_bins_make(struct apc_store *store, struct apc_bins *bins, apc_ns since, apc_ns until, size_t n)
{
    *bins = (struct apc_bins){
        .bin = (struct apc_bin_sum *)calloc(n, sizeof *bins->bin), .n = n, .since = since, .until = until};
    return bins->bin ? 0 : apc_fail(&store->why, APC_ENOMEM, "out of memory for %zu bins", n);
}

/* The highest i whose edge, since + span * i / n rounded down, is not above the time. Samples come one after
 * the other, so it is nearly always the bin of the one before. */
static struct apc_bin_sum *highest_bin_of(struct apc_bins *x, apc_ns time)
{
    if (time < x->from || time >= x->to) {
        const uwide into = (uwide)((uint64_t)time - (uint64_t)x->since) + 1;
        x->at = (size_t)((into * x->n - 1) / ((uint64_t)x->until - (uint64_t)x->since));
        x->from = apc_bin_edge(x->since, x->until, x->n, x->at);
        x->to = apc_bin_edge(x->since, x->until, x->n, x->at + 1);
    }
    return &x->bin[x->at];
}

int apc_bins_add(void *bins, const struct apc_sample *s)
{
    struct apc_bins *x = (struct apc_bins *)bins;
    if (s->time < x->since || s->time >= x->until) {
        return 0; /* 0 is no bound to a range, but one to bins */
    }
    struct apc_bin_sum *bin = highest_bin_of(x, s->time);
    struct apc_history_bin *b = &bin->b;
    if (apc_status_severity(s->status) == APC_SEVERITY_BAD) {
        b->bad++;
    } else {
        b->min = b->count == 0 || s->value < b->min ? s->value : b->min;
        b->max = b->count == 0 || s->value > b->max ? s->value : b->max;
        b->last = s->seq > bin->final ? s->value : b->last;
        bin->final = s->seq > bin->final ? s->seq : bin->final;
        bin->sum += (long double)s->value;
        b->count++;
    }
    b->worst = s->status > b->worst ? s->status : b->worst;
    b->seq = s->seq > b->seq ? s->seq : b->seq;
    return 0;
}

void apc_bins_merge(struct apc_bins *x, size_t i, const struct apc_history_bin *part, int64_t final)
{
    struct apc_bin_sum *bin = &x->bin[i];
    struct apc_history_bin *b = &bin->b;
    if (part->count > 0) {
        b->min = b->count == 0 || part->min < b->min ? part->min : b->min;
        b->max = b->count == 0 || part->max > b->max ? part->max : b->max;
        b->last = final > bin->final ? part->last : b->last;
        bin->final = final > bin->final ? final : bin->final;
        bin->sum += (long double)part->mean * (long double)part->count;
        b->count += part->count;
    }
    b->bad += part->bad;
    b->worst = part->worst > b->worst ? part->worst : b->worst;
    b->seq = part->seq > b->seq ? part->seq : b->seq;
}

int apc_bins_take(void *bins, const struct apc_history_bin *bin)
{
    struct apc_bins *x = (struct apc_bins *)bins;
    *highest_bin_of(x, bin->from) =
        (struct apc_bin_sum){.b = *bin, .sum = (long double)bin->mean * (long double)bin->count};
    x->last = bin->seq > x->last ? bin->seq : x->last;
    return 0;
}

int apc_bins_give(struct apc_store *store, struct apc_bins *x, apc_history_bin_fn fn, void *ctx)
{
    int count = 0;
    store->streaming = true;
    for (size_t i = 0, ended = 0; i < x->n && !ended; i++) {
        struct apc_history_bin *b = &x->bin[i].b;
        if (b->seq > 0) {
            b->from = apc_bin_edge(x->since, x->until, x->n, i);
            b->until = apc_bin_edge(x->since, x->until, x->n, i + 1);
            b->mean = b->count ? (double)(x->bin[i].sum / (long double)b->count) : 0;
            count++;
            ended = fn(ctx, b) != 0;
        }
    }
    store->streaming = false;
    return count;
}

int apc_bins_by_history(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                        size_t n, apc_history_bin_fn fn, void *ctx)
{
    struct apc_bins x;
    const struct apc_range range = {.since = since, .until = until};
    int count = apc_bins_make(store, &x, since, until, n);
    if (count == 0) {
        count = store->ops->history(store, table, id, &range, apc_bins_add, &x);
    }
    if (count >= 0) {
        count = apc_bins_give(store, &x, fn, ctx);
    }
    free(x.bin);
    return count;
}
