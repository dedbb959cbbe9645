/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Events and timing rows from one store into another. They have a number in FROM only. Those of before the
 * start, and those of an append whose outcome is not known, are looked up in TO by all their members; the
 * rest are new.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/history/replication.h"

static bool are_same_events(const struct apc_event *a, const struct apc_event *b)
{
    return a->time == b->time && a->severity == b->severity && strcmp(a->source, b->source) == 0 &&
           strcmp(a->kind, b->kind) == 0 && strcmp(a->text, b->text) == 0;
}

static bool are_same_timing(const struct apc_timing_row *a, const struct apc_timing_row *b)
{
    return a->time == b->time && strcmp(a->task, b->task) == 0 && strcmp(a->quantity, b->quantity) == 0 &&
           a->period == b->period && a->missed == b->missed && a->count == b->count && a->p50 == b->p50 &&
           a->p99 == b->p99 && a->max == b->max && a->n_bins == b->n_bins;
}

static int mark_known_event(void *ctx, const struct apc_event *e)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    size_t i = 0;
    while (i < f->records && (f->there[i] || !are_same_events(&f->event[i], e))) {
        i++;
    }
    f->there[i] = true;
    return 0;
}

static int mark_known_timing(void *ctx, const struct apc_timing_row *row)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    size_t i = 0;
    while (i < f->records && (f->there[i] || !are_same_timing(&f->timing_row[i], row))) {
        i++;
    }
    f->there[i] = true;
    return 0;
}

/* Where TO can have what lies between two times. */
static struct apc_range target_range(apc_ns first, apc_ns last)
{
    return (struct apc_range){.since = first, .until = last < INT64_MAX - 1000 ? last + 1000 : 0};
}

static void see_number(int64_t *highest, int64_t number)
{
    *highest = number > *highest ? number : *highest;
}

/* Once some were sent, those that are there may be these. */
static void see_found(struct apc_replication_cursor *c, int64_t number)
{
    if (!c->sent) {
        see_number(&c->found, number);
    }
}

/* The batch has been appended, or could not be. */
static int end_batch(struct apc_replication *f, uint64_t *of, int stored)
{
    f->records = 0;
    if (stored < 0) {
        return f->failed = apc_replication_fail_to(f, stored);
    }
    apc_replication_count(f, of, stored);
    return 0;
}

/* Where TO refuses one for what it says, the others go without it. */
static int append_event_batch(struct apc_replication *f, size_t n)
{
    int rc = apc_store_append_events(f->to, f->event, n), stored = 0;
    const bool singly = rc == APC_ERANGE;
    for (size_t i = 0; singly && i < n; i++) {
        rc = apc_store_append_events(f->to, &f->event[i], 1);
        if (rc < 0 && rc != APC_ERANGE) {
            return rc;
        }
        f->stats.refused += rc == APC_ERANGE;
        stored += rc > 0;
    }
    return singly ? stored : rc;
}

static int append_timing_batch(struct apc_replication *f, size_t n)
{
    int rc = apc_store_append_timing(f->to, f->timing_row, n), stored = 0;
    const bool singly = rc == APC_ERANGE;
    for (size_t i = 0; singly && i < n; i++) {
        rc = apc_store_append_timing(f->to, &f->timing_row[i], 1);
        if (rc < 0 && rc != APC_ERANGE) {
            return rc;
        }
        f->stats.refused += rc == APC_ERANGE;
        stored += rc > 0;
    }
    return singly ? stored : rc;
}

static int flush_event_batch(struct apc_replication *f)
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
        const struct apc_range range = target_range(first, last);
        rc = apc_store_events(f->to, &range, mark_known_event, f);
    }
    for (size_t i = 0; i < f->records; i++) {
        if (f->there[i]) {
            see_found(&f->events, f->event[i].number);
        } else {
            f->event[new ++] = f->event[i];
        }
    }
    f->events.sent = f->events.sent || new > 0;
    return end_batch(f, &f->stats.events, rc < 0 ? rc : append_event_batch(f, new));
}

static int flush_timing_batch(struct apc_replication *f)
{
    size_t new = 0;
    int rc = 0;
    memset(f->there, 0, sizeof f->there);
    if (f->records > 0 && f->timing.doubtful) {
        const struct apc_range range =
            target_range(f->timing_row[0].time, f->timing_row[f->records - 1].time); /* they come by time */
        rc = apc_store_timing(f->to, &range, mark_known_timing, f);
    }
    for (size_t i = 0; i < f->records; i++) {
        if (f->there[i]) {
            see_found(&f->timing, f->timing_row[i].number);
        } else {
            f->timing_row[new ++] = f->timing_row[i];
        }
    }
    f->timing.sent = f->timing.sent || new > 0;
    return end_batch(f, &f->stats.timing, rc < 0 ? rc : append_timing_batch(f, new));
}

/* Two that are alike stay in one batch: else the second would find the first one's copy. */
static int replicate_event(void *ctx, const struct apc_event *e)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    if ((f->records == APC_FORWARD_EVENTS ||
         (f->records > APC_FORWARD_EVENTS / 2 && e->time != f->event[f->records - 1].time)) &&
        flush_event_batch(f) < 0) {
        return 1;
    }
    f->event[f->records++] = *e;
    see_number(&f->number, e->number);
    return 0;
}

static int replicate_timing(void *ctx, const struct apc_timing_row *row)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    const size_t n = row->n_bins;
    if ((f->records == APC_FORWARD_TIMING ||
         (f->records > APC_FORWARD_TIMING / 2 && row->time != f->timing_row[f->records - 1].time)) &&
        flush_timing_batch(f) < 0) {
        return 1;
    }
    int64_t *bins = (int64_t *)realloc(f->bins[f->records], (3 * n + 1) * sizeof *bins);
    if (!bins) {
        f->failed = apc_replication_no_memory(f);
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
    see_number(&f->number, row->number);
    return 0;
}

/* ---- Both ----------------------------------------------------------------------------------- */

struct count {
    int64_t until; /* of which number */
    int64_t n;
};

/* What differs between events and timing rows. */
struct kind {
    struct apc_replication_cursor *cursor;
    uint64_t *lost, *untold;
    int (*give)(struct apc_replication *f, const struct apc_range *range);
    int (*flush)(struct apc_replication *f);
    int (*count)(struct apc_store *store, const struct apc_range *range, struct count *c);
};

static int give_events(struct apc_replication *f, const struct apc_range *range)
{
    return apc_store_events(f->from, range, replicate_event, f);
}

static int replicate_timing_range(struct apc_replication *f, const struct apc_range *range)
{
    return apc_store_timing(f->from, range, replicate_timing, f);
}

static int count_event(void *ctx, const struct apc_event *e)
{
    struct count *c = (struct count *)ctx;
    c->n += e->number <= c->until;
    return 0;
}

static int count_events(struct apc_store *store, const struct apc_range *range, struct count *c)
{
    return apc_store_events(store, range, count_event, c);
}

static int count_timing_row(void *ctx, const struct apc_timing_row *row)
{
    struct count *c = (struct count *)ctx;
    c->n += row->number <= c->until;
    return 0;
}

static int count_timing(struct apc_store *store, const struct apc_range *range, struct count *c)
{
    return apc_store_timing(store, range, count_timing_row, c);
}

/* So many were overwritten. */
static int count_lost_records(struct apc_replication *f, const struct kind *k, uint64_t n)
{
    *k->lost += n;
    *k->untold += n;
    return n > 0 ? apc_replication_tell_gap(f) : 0;
}

/* After a start: how many FROM has above the last one that TO had, where it had any at all; of what was
 * before a history began it has no gap. */
static int begin_to_count(struct apc_replication *f, const struct kind *k)
{
    const int64_t found = k->cursor->found;
    const struct apc_range above = {.after = found};
    struct count held = {.until = f->number};
    const int rc = k->cursor->had ? k->count(f->from, &above, &held) : 0;
    if (rc < 0) {
        return apc_replication_fail_from(f, rc);
    }
    const uint64_t lost = k->cursor->had ? (uint64_t)(f->number - found - held.n) : 0;
    k->cursor->begun = true;
    return count_lost_records(f, k, lost);
}

/* All that have come since the last time. */
static int move_records(struct apc_replication *f, const struct kind *k)
{
    struct apc_replication_cursor *c = k->cursor;
    const struct apc_range range = {.after = c->number}, newest = {.last = 1};
    const bool numbers = f->from->ops->numbers;
    struct count had = {.until = INT64_MAX};
    const int asked = numbers && !c->asked ? k->count(f->to, &newest, &had) : 0;
    if (asked < 0) {
        return apc_replication_fail_to(f, asked);
    }
    c->had = c->asked ? c->had : had.n > 0;
    c->asked = true;
    f->records = 0;
    f->number = c->number;
    f->failed = 0;
    const int given = k->give(f, &range);
    if (f->failed == 0 && given < 0) {
        f->failed = apc_replication_fail_from(f, given);
    }
    if (f->failed == 0 && numbers && c->begun) { /* before TO has what follows them */
        const uint64_t missed = (uint64_t)(f->number - c->number - given);
        f->failed = count_lost_records(f, k, missed - c->missed);
        c->missed = missed;
    }
    if (f->failed == 0) {
        k->flush(f);
    }
    if (f->failed == 0 && numbers && !c->begun) {
        f->failed = begin_to_count(f, k);
    }
    c->number = f->failed == 0 ? f->number : c->number;
    c->missed = f->failed == 0 ? 0 : c->missed;
    c->doubtful = f->failed < 0; /* some of them may have been moved */
    return f->failed;
}

int apc_replication_events(struct apc_replication *f)
{
    const struct kind events = {&f->events,  &f->stats.lost.events, &f->gap.events,
                                give_events, flush_event_batch,     count_events};
    return move_records(f, &events);
}

int apc_replication_records(struct apc_replication *f)
{
    const struct kind timing = {&f->timing,         &f->stats.lost.timing,
                                &f->gap.timing,     replicate_timing_range,
                                flush_timing_batch, count_timing};
    const int rc = apc_replication_events(f);
    return rc == 0 ? move_records(f, &timing) : rc;
}
