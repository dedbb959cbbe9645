/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Events and timing rows from one store into another. They have a number in FROM only. Those of before the
 * start, and those of an append whose outcome is not known, are looked up in TO by all their members; the
 * rest are new.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/forward.h"

static bool same_event(const struct apc_event *a, const struct apc_event *b)
{
    return a->time == b->time && a->severity == b->severity && strcmp(a->source, b->source) == 0 &&
           strcmp(a->kind, b->kind) == 0 && strcmp(a->text, b->text) == 0;
}

static bool same_timing(const struct apc_timing_row *a, const struct apc_timing_row *b)
{
    return a->time == b->time && strcmp(a->task, b->task) == 0 && strcmp(a->quantity, b->quantity) == 0 &&
           a->period == b->period && a->missed == b->missed && a->count == b->count && a->p50 == b->p50 &&
           a->p99 == b->p99 && a->max == b->max && a->n_bins == b->n_bins;
}

static int mark_event(void *ctx, const struct apc_event *e)
{
    struct apc_forward *f = (struct apc_forward *)ctx;
    size_t i = 0;
    while (i < f->records && (f->there[i] || !same_event(&f->event[i], e))) {
        i++;
    }
    f->there[i] = true;
    return 0;
}

static int mark_timing(void *ctx, const struct apc_timing_row *row)
{
    struct apc_forward *f = (struct apc_forward *)ctx;
    size_t i = 0;
    while (i < f->records && (f->there[i] || !same_timing(&f->timing_row[i], row))) {
        i++;
    }
    f->there[i] = true;
    return 0;
}

/* Where TO can have what lies between two times. */
static struct apc_range span(apc_ns first, apc_ns last)
{
    return (struct apc_range){.since = first, .until = last < INT64_MAX - 1000 ? last + 1000 : 0};
}

/* The batch has been appended, or could not be. */
static int end_batch(struct apc_forward *f, uint64_t *of, int stored)
{
    f->records = 0;
    if (stored < 0) {
        return f->failed = apc_forward_fail_to(f, stored);
    }
    apc_forward_count(f, of, stored);
    return 0;
}

static int flush_events(struct apc_forward *f)
{
    apc_ns first = INT64_MAX, last = INT64_MIN;
    size_t new = 0;
    int rc = 0;
    memset(f->there, 0, sizeof f->there);
    for (size_t i = 0; i < f->records; i++) {
        first = f->event[i].time < first ? f->event[i].time : first;
        last = f->event[i].time > last ? f->event[i].time : last;
    }
    if (f->records > 0 && f->events.doubtful) {
        const struct apc_range range = span(first, last);
        rc = apc_store_events(f->to, &range, mark_event, f);
    }
    for (size_t i = 0; i < f->records; i++) {
        if (!f->there[i]) {
            f->event[new ++] = f->event[i];
        }
    }
    return end_batch(f, &f->stats.events, rc < 0 ? rc : apc_store_append_events(f->to, f->event, new));
}

static int flush_timing(struct apc_forward *f)
{
    struct apc_timing_row rows[APC_FORWARD_TIMING];
    size_t new = 0;
    int rc = 0;
    memset(f->there, 0, sizeof f->there);
    if (f->records > 0 && f->timing.doubtful) {
        const struct apc_range range =
            span(f->timing_row[0].time, f->timing_row[f->records - 1].time); /* they come by time */
        rc = apc_store_timing(f->to, &range, mark_timing, f);
    }
    for (size_t i = 0; i < f->records; i++) {
        if (!f->there[i]) {
            rows[new ++] = f->timing_row[i];
        }
    }
    return end_batch(f, &f->stats.timing, rc < 0 ? rc : apc_store_append_timing(f->to, rows, new));
}

static void see_number(struct apc_forward *f, int64_t number)
{
    f->number = number > f->number ? number : f->number;
}

/* Two that are alike stay in one batch: else the second would find the first one's copy. */
static int take_event(void *ctx, const struct apc_event *e)
{
    struct apc_forward *f = (struct apc_forward *)ctx;
    if ((f->records == APC_FORWARD_EVENTS ||
         (f->records > APC_FORWARD_EVENTS / 2 && e->time != f->event[f->records - 1].time)) &&
        flush_events(f) < 0) {
        return 1;
    }
    f->event[f->records++] = *e;
    see_number(f, e->number);
    return 0;
}

static int take_timing(void *ctx, const struct apc_timing_row *row)
{
    struct apc_forward *f = (struct apc_forward *)ctx;
    const size_t n = row->n_bins;
    if ((f->records == APC_FORWARD_TIMING ||
         (f->records > APC_FORWARD_TIMING / 2 && row->time != f->timing_row[f->records - 1].time)) &&
        flush_timing(f) < 0) {
        return 1;
    }
    int64_t *bins = (int64_t *)realloc(f->bins[f->records], (3 * n + 1) * sizeof *bins);
    if (!bins) {
        f->failed = apc_forward_no_memory(f);
        return 1;
    }
    if (n > 0) {
        memcpy(bins, row->bin_low, n * sizeof *bins);
        memcpy(bins + n, row->bin_high, n * sizeof *bins);
        memcpy(bins + 2 * n, row->bin_count, n * sizeof *bins);
    }
    f->bins[f->records] = bins;
    struct apc_timing_row *to = &f->timing_row[f->records++];
    *to = *row;
    to->bin_low = bins;
    to->bin_high = bins + n;
    to->bin_count = bins + 2 * n;
    see_number(f, row->number);
    return 0;
}

/* All that have come since the last time, as `give` streams them. */
static int move_records(struct apc_forward *f, struct apc_forward_cursor *c,
                        int (*give)(struct apc_forward *f, const struct apc_range *range),
                        int (*flush)(struct apc_forward *f))
{
    const struct apc_range range = {.after = c->number};
    f->records = 0;
    f->number = c->number;
    f->failed = 0;
    const int given = give(f, &range);
    if (f->failed == 0 && given < 0) {
        f->failed = apc_forward_fail_from(f, given);
    }
    if (f->failed == 0 && flush(f) == 0) {
        c->number = f->number;
    }
    c->doubtful = f->failed < 0; /* some of them may have been moved */
    return f->failed;
}

static int give_events(struct apc_forward *f, const struct apc_range *range)
{
    return apc_store_events(f->from, range, take_event, f);
}

static int give_timing(struct apc_forward *f, const struct apc_range *range)
{
    return apc_store_timing(f->from, range, take_timing, f);
}

int apc_forward_records(struct apc_forward *f)
{
    const int rc = move_records(f, &f->events, give_events, flush_events);
    return rc == 0 ? move_records(f, &f->timing, give_timing, flush_timing) : rc;
}
