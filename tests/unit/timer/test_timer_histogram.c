/* SPDX-License-Identifier: BSD-3-Clause */
#include "apctimer.h"
#include "check.h"
#include "timer_test.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT  ((INT64_C(1) << 42) - 1)
#define VALUES 20000

/* Of any magnitude below the limit, either sign. */
static apc_ns any_value(uint64_t *state)
{
    apc_ns magnitude = (apc_ns)((xorshift(state) >> 22) >> xorshift(state) % 42);
    return xorshift(state) % 2 ? magnitude : -magnitude;
}

static struct apc_histogram *make(void)
{
    struct apc_histogram *h;
    assert_int_equal(apc_histogram_create(&h), 0);
    return h;
}

static int by_value(const void *a, const void *b)
{
    apc_ns x = *(const apc_ns *)a, y = *(const apc_ns *)b;
    return (x > y) - (x < y);
}

static bool within_1_percent(apc_ns got, apc_ns exact)
{
    apc_ns error = got > exact ? got - exact : exact - got;
    return error <= (exact < 0 ? -exact : exact) / 100;
}

static void an_empty_histogram_sums_up_to_zeros(void **state)
{
    struct apc_histogram *h = make();
    const struct apc_summary zeros = {0};
    struct apc_summary summary;
    (void)state;
    apc_histogram_summary(h, &summary);
    assert_memory_equal(&summary, &zeros, sizeof zeros);
    assert_int_equal(apc_histogram_bins(h, NULL, 0), 0);
    apc_histogram_destroy(h);
    apc_histogram_destroy(NULL);
}

static void a_bucket_holds_its_value_and_is_narrower_than_1_percent(void **state)
{
    const apc_ns edges[] = {0,   1,   -1,  255, -255,  256,    -256,     257,
                            258, 511, 512, 513, LIMIT, -LIMIT, LIMIT - 1};
    uint64_t random = seed();
    struct apc_histogram *h = make();
    (void)state;
    for (size_t i = 0; i < VALUES; i++) {
        apc_ns value = i < sizeof edges / sizeof *edges ? edges[i] : any_value(&random);
        apc_ns magnitude = value < 0 ? -value : value;
        struct apc_bin bin;
        apc_histogram_clear(h);
        apc_histogram_record(h, value);
        assert_int_equal(apc_histogram_bins(h, &bin, 1), 1);
        assert_int_equal(bin.count, 1);
        assert_true(bin.low <= value && value <= bin.high);
        if (magnitude < 256)
            assert_true(bin.low == value && bin.high == value);
        else
            assert_true((bin.high - bin.low) * 100 < magnitude);
    }
    apc_histogram_destroy(h);
}

static void neighbouring_buckets_touch_and_rise(void **state)
{
    struct apc_histogram *h = make();
    (void)state;
    for (apc_ns value = -70000; value <= 70000; value++)
        apc_histogram_record(h, value);
    size_t n = apc_histogram_bins(h, NULL, 0);
    struct apc_bin *bins = calloc(n, sizeof *bins);
    assert_non_null(bins);
    assert_int_equal(apc_histogram_bins(h, bins, n), n);
    for (size_t i = 1; i < n; i++)
        assert_true(bins[i].low == bins[i - 1].high + 1);
    for (size_t i = 1; i + 1 < n; i++)
        assert_true(bins[i].count == (uint64_t)(bins[i].high - bins[i].low + 1));
    free(bins);
    apc_histogram_destroy(h);
}

static void values_beyond_the_limit_count_as_the_limit(void **state)
{
    struct apc_histogram *h = make();
    struct apc_summary summary;
    (void)state;
    apc_histogram_record(h, INT64_MAX);
    apc_histogram_record(h, INT64_MIN);
    apc_histogram_summary(h, &summary);
    assert_true(summary.min == -LIMIT && summary.max == LIMIT);
    assert_near(summary.mean, 0.0, 0.0);
    apc_histogram_destroy(h);
}

/* Two-pass sums in long double. */
static void check_against_sorted(struct apc_histogram *h, apc_ns *values, size_t n)
{
    struct apc_summary s;
    long double sum = 0, squares = 0;

    qsort(values, n, sizeof *values, by_value);
    for (size_t i = 0; i < n; i++)
        sum += (long double)values[i];
    long double mean = sum / (long double)n;
    for (size_t i = 0; i < n; i++)
        squares += ((long double)values[i] - mean) * ((long double)values[i] - mean);
    double sd = (double)sqrtl(squares / (long double)(n - 1));

    apc_histogram_summary(h, &s);
    assert_int_equal(s.count, n);
    assert_true(s.min == values[0] && s.max == values[n - 1]);
    assert_near(s.mean, (double)mean, 1e-12 * (fabs((double)mean) + sd));
    assert_near(s.sd, sd, 1e-12 * sd);
    assert_true(within_1_percent(s.p50, values[(n * 500 + 999) / 1000 - 1]));
    assert_true(within_1_percent(s.p99, values[(n * 990 + 999) / 1000 - 1]));
    assert_true(within_1_percent(s.p999, values[(n * 999 + 999) / 1000 - 1]));
}

static void a_summary_agrees_with_the_sorted_values(void **state)
{
    uint64_t random = seed();
    apc_ns *values = calloc(VALUES, sizeof *values);
    (void)state;
    assert_non_null(values);
    for (size_t n = 2; n <= VALUES; n *= 10) {
        struct apc_histogram *h = make();
        for (size_t i = 0; i < n; i++)
            apc_histogram_record(h, values[i] = any_value(&random));
        check_against_sorted(h, values, n);
        apc_histogram_destroy(h);
    }
    free(values);
}

static void a_small_spread_about_a_large_mean_is_not_lost(void **state)
{
    struct apc_histogram *h = make();
    struct apc_summary s;
    (void)state;
    for (int i = 0; i < 1000000; i++)
        apc_histogram_record(h, INT64_C(4000000000000) + (i % 2 ? 1 : -1));
    apc_histogram_summary(h, &s);
    assert_near(s.mean, 4e12, 0.0);
    assert_near(s.sd, 1.0, 1e-6);
    apc_histogram_destroy(h);
}

static void small_values_have_their_spread(void **state)
{
    static const struct {
        apc_ns value[3];
        int n;
        double variance;
    } cases[] = {
        {{7}, 1, 0}, {{7, 7, 7}, 3, 0}, {{0, 1}, 2, 0.5}, {{-1, 0}, 2, 0.5}, {{1, 2, 2}, 3, 1.0 / 3}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_histogram *h = make();
        struct apc_summary s;
        for (int k = 0; k < cases[i].n; k++)
            apc_histogram_record(h, cases[i].value[k]);
        apc_histogram_summary(h, &s);
        assert_near(s.sd * s.sd, cases[i].variance, 1e-12);
        apc_histogram_destroy(h);
    }
}

static void merging_is_recording_both(void **state)
{
    uint64_t random = seed();
    struct apc_histogram *a = make(), *b = make(), *both = make(), *none = make();
    struct apc_summary merged, expected;
    (void)state;
    for (int i = 0; i < VALUES; i++) {
        apc_ns value = any_value(&random);
        apc_histogram_record(i % 3 ? a : b, value);
        apc_histogram_record(both, value);
    }
    apc_histogram_merge(a, b);
    apc_histogram_merge(a, none);
    apc_histogram_merge(none, a);
    apc_histogram_summary(both, &expected);
    apc_histogram_summary(a, &merged);
    assert_memory_equal(&merged, &expected, sizeof merged);
    apc_histogram_summary(none, &merged);
    assert_memory_equal(&merged, &expected, sizeof merged);
    apc_histogram_destroy(a);
    apc_histogram_destroy(b);
    apc_histogram_destroy(both);
    apc_histogram_destroy(none);
}

static void a_window_holds_what_was_recorded_since_the_last(void **state)
{
    uint64_t random = seed();
    struct apc_histogram *live = make(), *mark = make(), *window = make();
    apc_ns values[1000];
    (void)state;
    for (size_t round = 1; round <= 5; round++) {
        struct apc_histogram *alone = make();
        struct apc_summary got, expected;
        for (size_t i = 0; i < 200 * round; i++) {
            values[i] = any_value(&random) / (apc_ns)round; /* later windows lie inside the first */
            apc_histogram_record(live, values[i]);
            apc_histogram_record(alone, values[i]);
        }
        apc_histogram_window(window, mark, live);
        apc_histogram_summary(window, &got);
        apc_histogram_summary(alone, &expected);
        assert_int_equal(got.count, expected.count);
        assert_true(got.mean == expected.mean && got.sd == expected.sd);
        assert_true(within_1_percent(got.min, expected.min) && within_1_percent(got.max, expected.max));
        assert_true(within_1_percent(got.p50, expected.p50) && within_1_percent(got.p99, expected.p99));
        apc_histogram_destroy(alone);
    }
    struct apc_summary nothing;
    apc_histogram_window(window, mark, live);
    apc_histogram_summary(window, &nothing);
    assert_int_equal(nothing.count, 0);
    assert_int_equal(apc_histogram_bins(window, NULL, 0), 0);
    apc_histogram_destroy(live);
    apc_histogram_destroy(mark);
    apc_histogram_destroy(window);
}

/* As a recorder has it, which has one window for all that it cuts. */
static void a_window_has_nothing_of_another_that_reached_farther(void **state)
{
    struct apc_histogram *far = make(), *near = make(), *mark[] = {make(), make()}, *window = make();
    struct apc_summary summary;
    struct apc_bin bin;
    (void)state;
    apc_histogram_record(far, LIMIT);
    apc_histogram_record(far, -LIMIT);
    apc_histogram_window(window, mark[0], far);
    assert_int_equal(apc_histogram_bins(window, NULL, 0), 2);
    apc_histogram_record(near, 3);
    apc_histogram_window(window, mark[1], near);
    assert_int_equal(apc_histogram_bins(window, &bin, 1), 1);
    assert_true(bin.low == 3 && bin.high == 3 && bin.count == 1);
    apc_histogram_summary(window, &summary);
    assert_true(summary.count == 1 && summary.p50 == 3 && summary.p999 == 3);
    apc_histogram_destroy(far);
    apc_histogram_destroy(near);
    apc_histogram_destroy(mark[0]);
    apc_histogram_destroy(mark[1]);
    apc_histogram_destroy(window);
}

/* The second has most likely the memory of the first. */
static void a_new_one_holds_nothing_of_what_its_memory_held(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int round = 0; round < 2; round++) {
        struct apc_histogram *h = make();
        for (int i = 0; i < (round ? 0 : VALUES); i++)
            apc_histogram_record(h, any_value(&random));
        apc_histogram_record(h, LIMIT);
        apc_histogram_record(h, -LIMIT);
        assert_true(round == 0 || apc_histogram_bins(h, NULL, 0) == 2);
        apc_histogram_destroy(h);
    }
}

struct writing {
    struct apc_histogram *h;
    atomic_bool stop;
    uint64_t written;
};

/* 1, 2, 3, ...: count n implies max n, min 1, mean (n + 1) / 2. Any mixture of two states breaks that. */
static void *write_flat_out(void *arg)
{
    struct writing *w = arg;
    while (!atomic_load(&w->stop))
        apc_histogram_record(w->h, (apc_ns)++w->written);
    return NULL;
}

static void a_reader_never_sees_a_torn_summary(void **state)
{
    struct writing w = {.h = make()};
    struct apc_histogram *mark = make(), *window = make();
    pthread_t thread;
    uint64_t last = 0, in_windows = 0, torn = 0;
    struct apc_summary s;
    (void)state;
    assert_int_equal(pthread_create(&thread, NULL, write_flat_out, &w), 0);
    for (int i = 0; i < 2000 || last == 0; i++) {
        apc_histogram_summary(w.h, &s);
        if (s.count > 0)
            torn += s.count < last || s.min != 1 || s.max != (apc_ns)s.count || s.p50 > s.max ||
                    s.p50 < s.min || s.mean != ((double)s.count + 1) / 2;
        last = s.count;
        apc_histogram_window(window, mark, w.h);
        apc_histogram_summary(window, &s);
        in_windows += s.count;
    }
    atomic_store(&w.stop, true);
    assert_int_equal(pthread_join(thread, NULL), 0);
    apc_histogram_window(window, mark, w.h);
    apc_histogram_summary(window, &s);
    assert_int_equal(torn, 0);
    assert_int_equal(in_windows + s.count, w.written);
    apc_histogram_destroy(w.h);
    apc_histogram_destroy(mark);
    apc_histogram_destroy(window);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_empty_histogram_sums_up_to_zeros),
        cmocka_unit_test(a_bucket_holds_its_value_and_is_narrower_than_1_percent),
        cmocka_unit_test(neighbouring_buckets_touch_and_rise),
        cmocka_unit_test(values_beyond_the_limit_count_as_the_limit),
        cmocka_unit_test(a_summary_agrees_with_the_sorted_values),
        cmocka_unit_test(a_small_spread_about_a_large_mean_is_not_lost),
        cmocka_unit_test(small_values_have_their_spread),
        cmocka_unit_test(merging_is_recording_both),
        cmocka_unit_test(a_window_holds_what_was_recorded_since_the_last),
        cmocka_unit_test(a_window_has_nothing_of_another_that_reached_farther),
        cmocka_unit_test(a_new_one_holds_nothing_of_what_its_memory_held),
        cmocka_unit_test(a_reader_never_sees_a_torn_summary),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
