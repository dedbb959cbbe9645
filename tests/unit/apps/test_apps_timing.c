/* SPDX-License-Identifier: BSD-3-Clause */
/* The windows of the tasks put together again. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "common/timing.h"
#include "shareddata/shareddata_internal.h"

#include <math.h>

#define MAX_BINS 4

/* Of glibc, for programs that replace an allocator; sanitizers bring their own. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FAILING 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define FAILING 0
#endif
#endif
#ifndef FAILING
#define FAILING 1
#endif

static int allocations;
static int fail_at = -1; /* the allocation with this number fails */

#if FAILING
extern void *__libc_realloc(void *p, size_t size);

void *realloc(void *p, size_t size)
{
    return allocations++ == fail_at ? NULL : __libc_realloc(p, size);
}
#endif

static struct apc_store *store;

static int open_store(void **state)
{
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    return apc_store_init(store) < 0;
}

static int close_store(void **state)
{
    (void)state;
    apc_store_close(store);
    return 0;
}

/* A window of values of which each bucket holds one: low = high = value. */
static void put(apc_ns time, const char *task, const char *quantity, uint64_t missed, size_t n,
                const int64_t *values, const int64_t *counts)
{
    struct apc_timing_row row = {.time = time,
                                 .period = 1000,
                                 .missed = missed,
                                 .max = n ? values[n - 1] : 0,
                                 .bin_low = values,
                                 .bin_high = values,
                                 .bin_count = counts,
                                 .n_bins = n};
    double sum = 0, squares = 0;
    snprintf(row.task, sizeof row.task, "%s", task);
    snprintf(row.quantity, sizeof row.quantity, "%s", quantity);
    for (size_t i = 0; i < n; i++) {
        row.count += (uint64_t)counts[i];
        sum += (double)(values[i] * counts[i]);
    }
    row.mean = n ? sum / (double)row.count : 0;
    for (size_t i = 0; i < n; i++)
        squares += (double)counts[i] * ((double)values[i] - row.mean) * ((double)values[i] - row.mean);
    row.sd = n ? sqrt(squares / (double)row.count) : 0;
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
}

static struct timing load(const char *quantity)
{
    struct timing t;
    assert_int_equal(timing_load(&t, store, &(struct apc_range){0}, quantity), 0);
    return t;
}

static void windows_add_up_to_what_one_window_would_have_said(void **state)
{
    const int64_t a[] = {-5, 10, 20}, na[] = {1, 2, 1}, b[] = {10, 30}, nb[] = {3, 993};
    (void)state;
    put(1, "client", "lateness", 2, 3, a, na);
    put(2, "client", "lateness", 3, 2, b, nb);
    struct timing t = load(NULL);
    assert_int_equal(t.n, 1);
    const struct timing_series *s = timing_find(&t, "client", "lateness");
    assert_non_null(s);
    assert_int_equal(s->count, 1000);
    assert_int_equal(s->missed, 5);
    assert_int_equal(s->period, 1000);
    assert_int_equal(s->max, 30);
    assert_int_equal(timing_min(s), -5);
    assert_int_equal(s->n_bins, 4); /* 10 once */
    assert_int_equal(s->bins[1].low, 10);
    assert_int_equal(s->bins[1].count, 5);
    double mean = (-5 + 5 * 10 + 20 + 993 * 30) / 1000.0, squares = 0;
    for (size_t i = 0; i < s->n_bins; i++)
        squares +=
            (double)s->bins[i].count * ((double)s->bins[i].low - mean) * ((double)s->bins[i].low - mean);
    assert_near(s->mean, mean, 1e-9);
    assert_near(s->sd, sqrt(squares / 1000), 1e-9);
    timing_free(&t);
    assert_int_equal(t.n, 0);
}

static void percentiles_are_those_of_the_nearest_rank(void **state)
{
    const int64_t v[] = {1, 2, 3, 4}, n[] = {500, 490, 9, 1}, m[] = {501, 489, 8, 2};
    (void)state;
    put(1, "plant", "run", 0, 4, v, n);
    struct timing t = load("run");
    assert_int_equal(t.series[0].p50, 1);
    assert_int_equal(t.series[0].p99, 2);
    assert_int_equal(t.series[0].p999, 3);
    timing_free(&t);
    put(2, "client", "run", 0, 4, v, m);
    t = load("run");
    assert_string_equal(t.series[0].task, "client"); /* in order of task */
    assert_int_equal(t.series[0].p50, 1);
    assert_int_equal(t.series[0].p99, 2);
    assert_int_equal(t.series[0].p999, 4);
    timing_free(&t);
    put(3, "solo", "run", 0, 1, v, (const int64_t[]){1});
    t = load("run");
    assert_int_equal(timing_find(&t, "solo", "run")->p50, 1);
    assert_int_equal(timing_find(&t, "solo", "run")->p999, 1);
    timing_free(&t);
}

static void no_percentile_lies_above_the_greatest_value(void **state)
{
    const int64_t low[] = {100}, high[] = {199}, n[] = {7};
    struct apc_timing_row row = {.time = 1,
                                 .task = "plant",
                                 .quantity = "run",
                                 .count = 7,
                                 .mean = 120,
                                 .max = 150,
                                 .bin_low = low,
                                 .bin_high = high,
                                 .bin_count = n,
                                 .n_bins = 1};
    (void)state;
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
    struct timing t = load(NULL);
    assert_int_equal(t.series[0].p50, 150);
    assert_int_equal(t.series[0].p99, 150);
    timing_free(&t);
    row.max = 250; /* of a bucket that is not there: the bucket's edge bounds it */
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
    t = load(NULL);
    assert_int_equal(t.series[0].p50, 199);
    assert_int_equal(t.series[0].max, 250);
    timing_free(&t);
}

static void a_task_that_did_not_tick_still_misses_its_ticks(void **state)
{
    const int64_t v[] = {-30, -20}, n[] = {1, 1};
    (void)state;
    put(1, "controller", "lateness", 40, 0, v, n);
    struct timing t = load(NULL);
    const struct timing_series *s = timing_find(&t, "controller", "lateness");
    assert_non_null(s);
    assert_int_equal(s->count, 0);
    assert_int_equal(s->missed, 40);
    assert_int_equal(s->max, 0);
    assert_int_equal(s->p50, 0);
    assert_int_equal(timing_min(s), 0);
    timing_free(&t);
    put(2, "controller", "lateness", 2, 2, v, n);
    t = load(NULL);
    s = timing_find(&t, "controller", "lateness");
    assert_int_equal(s->missed, 42);
    assert_int_equal(s->max, -20); /* of those that ran */
    assert_near(s->mean, -25, 1e-9);
    timing_free(&t);
}

static int fail_after_some(struct apc_store *s, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    const int64_t v[] = {5}, n[] = {1};
    const struct apc_timing_row row = {.task = "plant",
                                       .quantity = "run",
                                       .count = 1,
                                       .bin_low = v,
                                       .bin_high = v,
                                       .bin_count = n,
                                       .n_bins = 1};
    (void)s, (void)range;
    assert_int_equal(fn(ctx, &row), 0);
    return APC_ECONN;
}

static void a_store_that_fails_meanwhile_fails_it(void **state)
{
    const struct apc_store_ops *real = store->ops;
    struct apc_store_ops ops = *real;
    struct timing t;
    (void)state;
    ops.timing = fail_after_some;
    store->ops = &ops;
    assert_int_equal(timing_load(&t, store, &(struct apc_range){0}, NULL), APC_ECONN);
    store->ops = real;
    assert_int_equal(t.series[0].p50, 0); /* nothing is made of half of it */
    timing_free(&t);
}

/* A bucket without a value is none: its edges say nothing of what was measured. */
static void an_empty_bucket_is_left_out(void **state)
{
    const int64_t v[] = {1, 7, 90}, n[] = {0, 4, 0};
    (void)state;
    put(1, "plant", "run", 0, 3, v, n);
    struct timing t = load(NULL);
    assert_int_equal(t.series[0].n_bins, 1);
    assert_int_equal(timing_min(&t.series[0]), 7);
    assert_int_equal(t.series[0].p999, 7);
    timing_free(&t);
}

static void series_are_told_apart_and_chosen_by_quantity(void **state)
{
    const int64_t v[] = {1}, n[] = {1};
    (void)state;
    put(1, "plant", "run", 0, 1, v, n);
    put(2, "plant", "jitter", 0, 1, v, n);
    put(3, "client", "run", 0, 1, v, n);
    struct timing t = load(NULL);
    assert_int_equal(t.n, 3);
    assert_string_equal(t.series[0].quantity, "jitter");
    assert_string_equal(t.series[1].task, "client");
    assert_string_equal(t.series[2].task, "plant");
    assert_null(timing_find(&t, "client", "jitter"));
    assert_ptr_equal(timing_find(&t, "plant", "run"), &t.series[2]);
    timing_free(&t);
    t = load("jitter");
    assert_int_equal(t.n, 1);
    assert_string_equal(t.series[0].task, "plant");
    timing_free(&t);
    t = load("lateness");
    assert_int_equal(t.n, 0);
    assert_null(timing_find(&t, "plant", "lateness"));
    timing_free(&t);
}

static void many_windows_take_the_memory_of_their_different_buckets(void **state)
{
    const int64_t n[] = {1, 1, 1, 1};
    (void)state;
    for (int i = 0; i < 500; i++) {
        const int64_t v[] = {i % 7, 10 + i % 7, 20 + i % 7, 30 + i % 7};
        put(i + 1, "plant", "run", 1, MAX_BINS, v, n);
    }
    struct timing t = load(NULL);
    uint64_t sum = 0;
    assert_int_equal(t.series[0].n_bins, 28);
    assert_true(t.series[0].capacity <= 4 * (28 + MAX_BINS));
    for (size_t i = 0; i < 28; i++) {
        sum += t.series[0].bins[i].count;
        assert_true(i == 0 || t.series[0].bins[i].low > t.series[0].bins[i - 1].low);
    }
    assert_int_equal(sum, 2000);
    assert_int_equal(t.series[0].missed, 500);
    timing_free(&t);
}

static void without_memory_it_is_said_and_nothing_is_left(void **state)
{
    const int64_t v[] = {10, 30}, n[] = {1, 1};
    int rc = APC_ENOMEM;
    (void)state;
    if (!FAILING)
        skip();
    put(1, "plant", "run", 0, 2, v, n);
    put(2, "client", "run", 0, 2, v, n);
    for (int k = 0; rc < 0; k++) {
        struct timing t;
        allocations = 0;
        fail_at = k;
        rc = timing_load(&t, store, &(struct apc_range){0}, NULL);
        fail_at = -1;
        assert_true(rc == 0 ? t.n == 2 && k >= 4 : rc == APC_ENOMEM);
        timing_free(&t);
    }
}

static void a_series_is_a_line_of_csv(void **state)
{
    const int64_t v[] = {10, 30}, n[] = {1, 1};
    char *text = NULL;
    size_t size;
    (void)state;
    put(1, "plant", "run", 4, 2, v, n);
    struct timing t = load(NULL);
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    timing_csv(out, &t.series[0]);
    fclose(out);
    assert_string_equal(text, "plant,run,1000,2,4,20.0,10.0,10,10,30,30,30\n");
    free(text);
    timing_free(&t);
}

#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, open_store, close_store)

int main(void)
{
    const struct CMUnitTest tests[] = {
        WITH_STORE(windows_add_up_to_what_one_window_would_have_said),
        WITH_STORE(percentiles_are_those_of_the_nearest_rank),
        WITH_STORE(no_percentile_lies_above_the_greatest_value),
        WITH_STORE(a_task_that_did_not_tick_still_misses_its_ticks),
        WITH_STORE(a_store_that_fails_meanwhile_fails_it),
        WITH_STORE(an_empty_bucket_is_left_out),
        WITH_STORE(series_are_told_apart_and_chosen_by_quantity),
        WITH_STORE(many_windows_take_the_memory_of_their_different_buckets),
        WITH_STORE(without_memory_it_is_said_and_nothing_is_left),
        WITH_STORE(a_series_is_a_line_of_csv),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
