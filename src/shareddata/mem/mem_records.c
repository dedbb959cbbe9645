/* SPDX-License-Identifier: BSD-3-Clause */
/* The store in memory: authors, descriptions, events, timing. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/mem/mem.h"

/* ---- Authors -------------------------------------------------------------------------------- */

int apc_mem_author(struct apc_store *store, const char *name)
{
    struct memory *m = apc_mem_of(store)->memory;
    size_t i = 0;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    while (i < m->n_authors && strcmp(m->author[i], name) != 0) {
        i++;
    }
    if (i == m->n_authors) {
        err = apc_mem_grow(store, (void **)&m->author, &m->authors_capacity, i, 1, sizeof *m->author);
        if (!err) {
            memcpy(m->author[m->n_authors++], name, APC_AUTHOR_LEN);
        }
    }
    apc_mem_end(store);
    return err ? err : (int)i + 1;
}

int apc_mem_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    const bool known = number <= m->n_authors;
    if (known) {
        memcpy(name, m->author[number - 1], APC_AUTHOR_LEN);
    }
    apc_mem_end(store);
    return known ? 0 : APC_ENOTFOUND;
}

/* ---- What the plant is ---------------------------------------------------------------------- */

int apc_mem_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    struct memory *m = apc_mem_of(store)->memory;
    struct apc_tag *sorted = NULL;
    char *text = catalogue ? strdup(catalogue) : NULL;
    int err = catalogue && !text ? apc_mem_no_memory(store) : apc_tags_sort(store, tags, n, &sorted);
    if (!err) {
        err = apc_mem_begin(store);
    }
    if (!err) {
        struct apc_tag *former = m->tag;
        m->tag = sorted;
        m->n_tags = n;
        sorted = former;
        if (text && (!m->catalogue || strcmp(m->catalogue, text) != 0)) {
            char *was = m->catalogue;
            m->catalogue = text;
            m->revision++;
            text = was;
        }
        apc_mem_end(store);
    }
    free(text);
    free(sorted);
    return err ? err : (int)n;
}

int apc_mem_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    const size_t length = m->catalogue ? strlen(m->catalogue) : 0;
    if (size > 0) {
        const size_t given = length < size ? length : size - 1;
        memcpy(text, m->catalogue ? m->catalogue : "", given);
        text[given] = '\0';
    }
    *revision = m->revision;
    apc_mem_end(store);
    return (int)length;
}

int apc_mem_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < capacity && i < m->n_tags; i++) {
        tags[i] = m->tag[i];
    }
    int n = (int)m->n_tags;
    apc_mem_end(store);
    return n;
}

/* ---- Events -------------------------------------------------------------------------------- */

int apc_mem_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    err = apc_mem_grow(store, (void **)&m->event, &m->events_capacity, m->n_events, n, sizeof *m->event);
    for (size_t i = 0; !err && i < n; i++) {
        m->event[m->n_events++] = apc_event_row(&events[i]);
    }
    apc_mem_end(store);
    return err ? err : (int)n;
}

/* The number of the first event, so that those within the range are the newest range->last. */
static uint64_t first_event(const struct memory *m, const struct apc_range *range)
{
    size_t left = range->last, i = m->n_events;
    while (i > 0 && (range->last == 0 || left > 0)) {
        left -= apc_mem_within(range, m->event[--i].time);
    }
    i += m->dropped_events;
    return i > (uint64_t)range->after ? i : (uint64_t)range->after;
}

/* The next event within the range. */
static bool next_event(const struct memory *m, const struct apc_range *range, uint64_t *next, uint64_t until,
                       struct apc_event *out)
{
    *next = *next < m->dropped_events ? m->dropped_events : *next;
    while (*next < until) {
        const struct apc_event *e = &m->event[(*next)++ - m->dropped_events];
        if (apc_mem_within(range, e->time)) {
            *out = *e;
            out->number = (int64_t)*next;
            return true;
        }
    }
    return false;
}

int apc_mem_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    uint64_t next = first_event(m, range), until = m->dropped_events + m->n_events;
    int count = 0;
    bool ended = false;
    struct apc_event e;
    while (!ended && next_event(m, range, &next, until, &e)) {
        apc_mem_end(store);
        store->streaming = true;
        count += count < INT_MAX;
        ended = fn(ctx, &e) != 0;
        store->streaming = false;
        apc_mem_begin_bare(store);
    }
    apc_mem_end(store);
    return count;
}

/* ---- Timing -------------------------------------------------------------------------------- */

/* Copy a row's buckets into one allocation, or none. */
static int copy_bins(struct apc_store *store, struct apc_timing_row *row)
{
    const size_t n = row->n_bins, size = n * sizeof(int64_t);
    int64_t *bins = n > 0 ? (int64_t *)malloc(3 * size) : NULL;
    if (n > 0 && !bins) {
        return apc_mem_no_memory(store);
    }
    if (n > 0) {
        memcpy(bins, row->bin_low, size);
        memcpy(bins + n, row->bin_high, size);
        memcpy(bins + 2 * n, row->bin_count, size);
    }
    row->bin_low = bins;
    row->bin_high = n > 0 ? bins + n : NULL;
    row->bin_count = n > 0 ? bins + 2 * n : NULL;
    return 0;
}

static void free_bins(const struct apc_timing_row *row)
{
    free((void *)(uintptr_t)row->bin_low);
}

/* The first row that does not come before (time, number). */
static size_t timing_bound(const struct memory *m, apc_ns time, uint64_t number)
{
    size_t i = m->n_timings;
    while (i > 0 && (m->timing[i - 1].row.time > time ||
                     (m->timing[i - 1].row.time == time && m->timing[i - 1].number >= number))) {
        i--;
    }
    return i;
}

int apc_mem_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    struct memory *m = apc_mem_of(store)->memory;
    struct apc_timing_row *copy = calloc(n, sizeof *copy);
    int err = copy ? 0 : apc_mem_no_memory(store);
    size_t copied = 0;
    for (; !err && copied < n; copied += !err) {
        copy[copied] = apc_timing_stored(&rows[copied]);
        err = copy_bins(store, &copy[copied]);
    }
    if (!err && (err = apc_mem_begin(store)) == 0) {
        err = apc_mem_grow(store, (void **)&m->timing, &m->timings_capacity, m->n_timings, n,
                           sizeof *m->timing);
        for (size_t i = 0; !err && i < n; i++) {
            size_t at = timing_bound(m, copy[i].time, m->next_timing);
            memmove(&m->timing[at + 1], &m->timing[at], (m->n_timings++ - at) * sizeof *m->timing);
            m->timing[at] = (struct timing){.row = copy[i], .number = m->next_timing++};
        }
        apc_mem_end(store);
    }
    for (size_t i = 0; err && i < copied; i++) {
        free_bins(&copy[i]);
    }
    free(copy);
    return err ? err : (int)n;
}

static size_t first_timing(const struct memory *m, const struct apc_range *range)
{
    size_t left = range->last, i = m->n_timings;
    while (i > 0 && (range->last == 0 || left > 0)) {
        left -= apc_mem_within(range, m->timing[--i].row.time);
    }
    return i;
}

int apc_mem_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    const uint64_t until = m->next_timing;
    size_t i = first_timing(m, range);
    int count = 0;
    bool ended = false;
    while (!err && !ended && i < m->n_timings) {
        struct timing t = m->timing[i++];
        if (t.number >= until || t.number < (uint64_t)range->after || !apc_mem_within(range, t.row.time)) {
            continue;
        }
        t.row.number = (int64_t)t.number + 1;
        err = copy_bins(store, &t.row);
        if (!err) {
            apc_mem_end(store);
            store->streaming = true;
            count += count < INT_MAX;
            ended = fn(ctx, &t.row) != 0;
            store->streaming = false;
            free_bins(&t.row);
            apc_mem_begin_bare(store);
            i = timing_bound(m, t.row.time, t.number + 1);
        }
    }
    apc_mem_end(store);
    return err ? err : count;
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* Events are numbered as they came: only the oldest ones can go. */
int apc_mem_drop_events(struct memory *m, apc_ns before)
{
    size_t n = 0;
    while (n < m->n_events && m->event[n].time < before) {
        n++;
    }
    m->n_events -= n;
    m->dropped_events += n;
    memmove(m->event, m->event + n, m->n_events * sizeof *m->event);
    return (int)n;
}

int apc_mem_drop_timings(struct memory *m, apc_ns before)
{
    size_t n = 0;
    while (n < m->n_timings && m->timing[n].row.time < before) {
        free_bins(&m->timing[n++].row);
    }
    m->n_timings -= n;
    memmove(m->timing, m->timing + n, m->n_timings * sizeof *m->timing);
    return (int)n;
}

void apc_mem_free_records(struct memory *m)
{
    for (size_t i = 0; i < m->n_timings; i++) {
        free_bins(&m->timing[i].row);
    }
    free(m->author);
    free(m->catalogue);
    free(m->tag);
    free(m->event);
    free(m->timing);
}
