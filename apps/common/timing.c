/* SPDX-License-Identifier: BSD-3-Clause */
#include "common/timing.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"

static size_t find_timing_series(const struct timing *timing, const char *task, const char *quantity)
{
    size_t i = 0;
    while (i < timing->n &&
           (strcmp(timing->series[i].task, task) != 0 || strcmp(timing->series[i].quantity, quantity) != 0))
        i++;
    return i;
}

const struct timing_series *timing_find(const struct timing *timing, const char *task, const char *quantity)
{
    size_t i = find_timing_series(timing, task, quantity);
    return i < timing->n ? &timing->series[i] : NULL;
}

static struct timing_series *series_of_row(struct timing *timing, const struct apc_timing_row *row)
{
    size_t i = find_timing_series(timing, row->task, row->quantity);
    if (i < timing->n)
        return &timing->series[i];
    struct timing_series *series = realloc(timing->series, (timing->n + 1) * sizeof *series);
    if (!series)
        return NULL;
    timing->series = series;
    struct timing_series *s = &series[timing->n++];
    *s = (struct timing_series){0};
    memcpy(s->task, row->task, sizeof s->task);
    memcpy(s->quantity, row->quantity, sizeof s->quantity);
    return s;
}

static int by_low(const void *a, const void *b)
{
    const struct apc_bin *x = a, *y = b;
    return (x->low > y->low) - (x->low < y->low);
}

/* Rising, each bucket once. */
static void compact(struct timing_series *s)
{
    size_t n = 0;
    if (s->n_bins == 0)
        return;
    qsort(s->bins, s->n_bins, sizeof *s->bins, by_low);
    for (size_t i = 1; i < s->n_bins; i++)
        if (s->bins[i].low == s->bins[n].low)
            s->bins[n].count += s->bins[i].count;
        else
            s->bins[++n] = s->bins[i];
    s->n_bins = n + 1;
}

/* Room for n more. Compacting first keeps the memory to the number of different buckets, however long the
 * history. */
static int reserve_series(struct timing_series *s, size_t n)
{
    if (s->n_bins + n <= s->capacity)
        return 0;
    compact(s);
    if (2 * (s->n_bins + n) <= s->capacity)
        return 0;
    struct apc_bin *bins = realloc(s->bins, 4 * (s->n_bins + n) * sizeof *bins);
    if (!bins)
        return APC_ENOMEM;
    s->bins = bins;
    s->capacity = 4 * (s->n_bins + n);
    return 0;
}

/* Mean and variance of two sets together, from those of each. */
static void pool(struct timing_series *s, const struct apc_timing_row *row)
{
    double n = (double)s->count, m = (double)row->count, apart = row->mean - s->mean;
    double squares = s->sd * s->sd * n + row->sd * row->sd * m + apart * apart * n * m / (n + m);
    s->mean += apart * m / (n + m);
    s->sd = sqrt(squares / (n + m));
    s->count += row->count;
}

static int take_timing_series_row(void *ctx, const struct apc_timing_row *row)
{
    struct timing *timing = ctx;
    if (timing->quantity && strcmp(row->quantity, timing->quantity) != 0)
        return 0;
    struct timing_series *s = series_of_row(timing, row);
    if (!s || reserve_series(s, row->n_bins) < 0)
        return timing->failed = APC_ENOMEM;
    for (size_t i = 0; i < row->n_bins; i++)
        if (row->bin_count[i] > 0)
            s->bins[s->n_bins++] =
                (struct apc_bin){row->bin_low[i], row->bin_high[i], (uint64_t)row->bin_count[i]};
    s->period = row->period;
    s->missed += row->missed;
    if (row->count == 0) /* it did not tick */
        return 0;
    s->max = s->count == 0 || row->max > s->max ? row->max : s->max;
    pool(s, row);
    return 0;
}

/* The bucket that the value of rank ceil(share * count) lies in; no value lies above max. */
static apc_ns series_percentile(const struct timing_series *s, unsigned permille)
{
    uint64_t rank = s->count / 1000 * permille + (s->count % 1000 * permille + 999) / 1000, below = 0;
    for (size_t i = 0; i < s->n_bins; i++) {
        below += s->bins[i].count;
        if (below >= rank)
            return s->bins[i].high < s->max ? s->bins[i].high : s->max;
    }
    return s->max;
}

static int by_name(const void *a, const void *b)
{
    const struct timing_series *x = a, *y = b;
    int order = strcmp(x->quantity, y->quantity);
    return order ? order : strcmp(x->task, y->task);
}

int timing_load(struct timing *timing, struct apc_store *store, const struct apc_range *range,
                const char *quantity)
{
    *timing = (struct timing){.quantity = quantity};
    int rc = apc_store_timing(store, range, take_timing_series_row, timing);
    if (timing->failed)
        return timing->failed;
    for (size_t i = 0; i < timing->n && rc >= 0; i++) {
        struct timing_series *s = &timing->series[i];
        compact(s);
        s->p50 = series_percentile(s, 500);
        s->p99 = series_percentile(s, 990);
        s->p999 = series_percentile(s, 999);
    }
    if (timing->n > 0)
        qsort(timing->series, timing->n, sizeof *timing->series, by_name);
    return rc < 0 ? rc : 0;
}

apc_ns timing_min(const struct timing_series *s)
{
    return s->n_bins ? s->bins[0].low : 0;
}

void timing_csv(FILE *out, const struct timing_series *s)
{
    csv_put(out, s->task);
    fprintf(out,
            ",%s,%" PRId64 ",%" PRIu64 ",%" PRIu64 ",%.1f,%.1f,%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRId64
            ",%" PRId64 "\n",
            s->quantity, s->period, s->count, s->missed, s->mean, s->sd, timing_min(s), s->p50, s->p99,
            s->p999, s->max);
}

void timing_free(struct timing *timing)
{
    for (size_t i = 0; i < timing->n; i++)
        free(timing->series[i].bins);
    free(timing->series);
    *timing = (struct timing){0};
}
