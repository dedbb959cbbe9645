/* SPDX-License-Identifier: BSD-3-Clause */
/* What every store must do: the past of a variable, row by row and in bins. */
#include "comma_locale.h"
#include "shareddata/shareddata_internal.h"
#include "stores.h"

/* ---- History --------------------------------------------------------------------------------- */

struct seen {
    struct apc_store *store;
    int64_t first, last, previous;
    int count, stop_after, inner;
    bool falling;
};

static int see(void *ctx, const struct apc_sample *s)
{
    struct seen *seen = ctx;
    seen->first = seen->count == 0 ? s->seq : seen->first;
    seen->falling = seen->falling || s->seq <= seen->previous;
    seen->previous = seen->last = s->seq;
    if (seen->store) {
        struct apc_sample inner = {.table = APC_SENSOR, .id = 1};
        seen->inner = apc_store_read(seen->store, &inner, 1);
    }
    return ++seen->count == seen->stop_after;
}

static void append_many(struct apc_store *store, int id, int n)
{
    static struct apc_sample s[10000];
    for (int done = 0; done < n;) {
        int some = n - done < 10000 ? n - done : 10000;
        for (int i = 0; i < some; i++) {
            s[i] = sample(APC_SENSOR, id, done + i + 1, done + i);
        }
        assert_int_equal(apc_store_append(store, s, (size_t)some), some);
        done += some;
    }
}

static void test_history_comes_in_rising_seq_within_its_bounds(void **state)
{
    append_many(*state, 1, 2000); /* at 1000 us * seq */
    const struct {
        struct apc_range range;
        int count, first, last;
    } cases[] = {
        {{0}, 2000, 1, 2000},
        {{.last = 3}, 3, 1998, 2000},
        {{.last = 5000}, 2000, 1, 2000},
        {{.last = 512}, 512, 1489, 2000},
        {{.since = 100 * APC_NS_PER_MS}, 1901, 100, 2000},
        {{.since = 100 * APC_NS_PER_MS + 1}, 1900, 101, 2000},
        {{.until = 100 * APC_NS_PER_MS}, 99, 1, 99},
        {{.until = 100 * APC_NS_PER_MS + 1}, 100, 1, 100},
        {{.since = 100 * APC_NS_PER_MS, .until = 200 * APC_NS_PER_MS, .last = 10}, 10, 190, 199},
        {{.since = 200 * APC_NS_PER_MS, .until = 100 * APC_NS_PER_MS}, 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct seen seen = {0};
        assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, &cases[i].range, see, &seen),
                         cases[i].count);
        assert_int_equal(seen.count, cases[i].count);
        assert_int_equal(seen.first, cases[i].first);
        assert_int_equal(seen.last, cases[i].last);
        assert_false(seen.falling);
    }
}

/* Reported of InfluxDB again and again: of two points of one time the later one takes the place of the other. */
static void test_samples_of_one_time_are_all_kept(void **state)
{
    for (int i = 1; i <= 5; i++) { /* in one transaction, and each in its own */
        struct apc_sample s[] = {sample(APC_SENSOR, 1, 2 * i - 1, i), sample(APC_SENSOR, 1, 2 * i, -i)};
        s[0].time = s[1].time = APC_NS_PER_S;
        ok(*state, apc_store_append(*state, s, 2));
    }
    const struct apc_range at = {.since = APC_NS_PER_S, .until = APC_NS_PER_S + 1}, last = {.last = 3};
    struct seen all = {0}, newest = {0};
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, &at, see, &all), 10);
    assert_true(all.first == 1 && all.last == 10 && !all.falling);
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, &last, see, &newest), 3);
    assert_true(newest.first == 8 && newest.last == 10 && !newest.falling);
}

static void test_history_ends_when_its_function_says_so(void **state)
{
    append_many(*state, 1, 2000);
    struct seen seen = {.stop_after = 700};
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, NULL, see, &seen), 700);
    assert_int_equal(newest(*state, APC_SENSOR, 1).seq, 2000); /* the store goes on */
}

static void test_a_store_refuses_to_be_used_from_inside_its_history(void **state)
{
    append_many(*state, 1, 3);
    struct seen seen = {.store = *state};
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, NULL, see, &seen), 3);
    assert_int_equal(seen.inner, APC_ESTATE);
}

/* The store, and what it said to somebody who used it meanwhile. */
struct meddler {
    struct apc_store *store;
    int said;
};

static void meddle(struct meddler *m)
{
    struct apc_sample s = sample(APC_SENSOR, 1, 0, 0);
    m->said = apc_store_read(m->store, &s, 1);
}

static int meddle_event(void *ctx, const struct apc_event *e)
{
    (void)e;
    meddle(ctx);
    return 0;
}

static int meddle_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)row;
    meddle(ctx);
    return 0;
}

static int meddle_vector(void *ctx, const struct apc_vector *v)
{
    (void)v;
    meddle(ctx);
    return 0;
}

static int meddle_bin(void *ctx, const struct apc_history_bin *bin)
{
    (void)bin;
    meddle(ctx);
    return 0;
}

static void assert_meddled(struct meddler *m, int count)
{
    assert_int_equal(count, 1);
    assert_int_equal(m->said, APC_ESTATE);
    meddle(m);
    assert_int_equal(m->said, 0); /* and it goes on */
}

/* Who is refused by the store may give the same rows again. */
static int spoil(struct apc_store *store, const struct apc_rows *rows)
{
    for (size_t i = 0; i < rows->n_samples; i++) {
        rows->sample[i].seq = 1000 + (int64_t)i;
    }
    return apc_fail(&store->why, APC_ESTORE, "spoiled");
}

static void test_rows_that_the_store_refuses_are_as_they_were(void **state)
{
    struct apc_store *store = *state;
    const struct apc_store_ops *real = store->ops;
    struct apc_store_ops ops = *real;
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, APC_SEQ_ANY, 1), sample(APC_SENSOR, 1, 1, 1)};
    const struct apc_rows rows = {.size = sizeof rows, .sample = s, .n_samples = 2};
    ops.append_rows = spoil;
    store->ops = &ops;
    assert_int_equal(apc_store_append_rows(store, &rows), APC_ESTORE);
    store->ops = real;
    assert_true(s[0].seq == APC_SEQ_ANY && s[1].seq == 1);
    assert_int_equal(apc_store_append_rows(store, &rows), 2);
    assert_int_equal(s[0].seq, 1);
}

static void test_nor_from_inside_any_other_stream(void **state)
{
    double value = 1;
    const struct apc_event e = {.time = 1000, .severity = APC_EVENT_INFO};
    const struct apc_timing_row row = {.time = 1000, .quantity = "run", .task = "t"};
    struct apc_vector v = {.table = APC_TICK, .id = 1, .seq = 1, .time = 1000, .n = 1, .value = &value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    struct meddler m = {.store = *state};
    append_many(*state, 1, 1);
    assert_int_equal(apc_store_append_rows(*state, &rows), 1);
    assert_int_equal(apc_store_append_events(*state, &e, 1), 1);
    assert_int_equal(apc_store_append_timing(*state, &row, 1), 1);
    assert_meddled(&m, apc_store_events(*state, NULL, meddle_event, &m));
    assert_meddled(&m, apc_store_timing(*state, NULL, meddle_timing, &m));
    assert_meddled(&m, apc_store_vectors(*state, APC_TICK, 1, NULL, meddle_vector, &m));
    assert_meddled(&m, apc_store_history_bins(*state, APC_SENSOR, 1, 1, APC_NS_PER_S, 1, meddle_bin, &m));
}

static int follow_origin(void *ctx, const struct apc_sample *s)
{
    assert_int_equal(s->origin, s->seq == 1 ? 7 : 0);
    (void)ctx;
    return 0;
}

static void test_a_history_names_what_a_row_comes_from(void **state)
{
    struct apc_sample s[2] = {sample(APC_ACTUATOR, 1, 1, 1), sample(APC_ACTUATOR, 1, 2, 1)};
    s[0].origin = 7;
    assert_int_equal(apc_store_append(*state, s, 2), 2);
    assert_int_equal(apc_store_history(*state, APC_ACTUATOR, 1, NULL, follow_origin, NULL), 2);
}

static void test_variables_are_those_that_have_samples(void **state)
{
    assert_int_equal(apc_store_variables(*state, NULL, 0), 0);
    const struct apc_sample s[6] = {sample(APC_ESTIMATE, 1000000, 1, 1), sample(APC_SENSOR, 2, 1, 1),
                                    sample(APC_SENSOR, 2, 2, 1),         sample(APC_OPMODE, 0, 1, 1),
                                    sample(APC_SENSOR, 1, 7, 1),         sample(APC_ACTUATOR, 3, 1, 1)};
    assert_int_equal(apc_store_append(*state, s, 6), 6);
    struct apc_sample v[5];
    assert_int_equal(apc_store_variables(*state, v, 4), 5); /* in all */
    assert_int_equal(apc_store_variables(*state, v, 5), 5);
    assert_true(v[0].table == APC_SENSOR && v[0].id == 1);
    assert_true(v[1].table == APC_SENSOR && v[1].id == 2);
    assert_true(v[2].table == APC_ACTUATOR && v[2].id == 3);
    assert_true(v[3].table == APC_OPMODE && v[3].id == 0);
    assert_true(v[4].table == APC_ESTIMATE && v[4].id == 1000000);
}

/* ---- History in bins ------------------------------------------------------------------------- */

enum { BINS_MAX = 8 };

struct bins {
    struct apc_history_bin bin[BINS_MAX];
    size_t n, stop_after;
    struct apc_store *store;
    int inner;
};

static int keep_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct bins *bins = ctx;
    if (bins->n < BINS_MAX) {
        bins->bin[bins->n] = *bin;
    }
    if (bins->store) {
        struct apc_sample s = {.table = APC_SENSOR, .id = 1};
        bins->inner = apc_store_read(bins->store, &s, 1);
    }
    return ++bins->n == bins->stop_after;
}

static int bins_of(struct apc_store *store, apc_ns since, apc_ns until, size_t n, struct bins *bins)
{
    return apc_store_history_bins(store, APC_SENSOR, 1, since, until, n, keep_bin, bins);
}

/* Times in us, since that is what every store keeps. */
static void append_at(struct apc_store *store, int64_t seq, apc_ns us, double value, apc_status status)
{
    struct apc_sample s = sample(APC_SENSOR, 1, seq, value);
    s.time = us * APC_NS_PER_US;
    s.status = status;
    assert_int_equal(apc_store_append(store, &s, 1), 1);
}

/* Promise(server/history-events-timing) */
static void test_a_bin_holds_what_lies_within_it(void **state)
{
    append_at(*state, 1, 99, 1000, APC_GOOD); /* before */
    append_at(*state, 2, 100, 4, APC_GOOD);
    append_at(*state, 3, 119, -8, APC_UNCERTAIN_LAST_USABLE);
    append_at(*state, 4, 110, 1.5, APC_GOOD); /* the clock stepped back: last is by seq */
    append_at(*state, 5, 112, 777, APC_BAD_OUT_OF_SERVICE);
    append_at(*state, 6, 120, 3, APC_GOOD); /* the second bin's first moment */
    append_at(*state, 7, 165, 0, APC_BAD_NO_COMMUNICATION);
    append_at(*state, 8, 160, 0, APC_BAD_SENSOR_FAILURE);
    append_at(*state, 9, 200, 2000, APC_GOOD); /* after */
    struct apc_sample other = sample(APC_SENSOR, 2, 1, 9);
    other.time = 110 * APC_NS_PER_US;
    assert_int_equal(apc_store_append(*state, &other, 1), 1);

    struct bins b = {0};
    assert_int_equal(bins_of(*state, 100000, 200000, 5, &b), 3);
    assert_int_equal(b.n, 3);
    assert_true(b.bin[0].from == 100000 && b.bin[0].until == 120000);
    assert_int_equal(b.bin[0].count, 3);
    assert_int_equal(b.bin[0].bad, 1);
    assert_near(b.bin[0].min, -8, 0);
    assert_near(b.bin[0].max, 4, 0);
    assert_near(b.bin[0].mean, -2.5 / 3, 1e-15);
    assert_near(b.bin[0].last, 1.5, 0);
    assert_int_equal(b.bin[0].worst, APC_BAD_OUT_OF_SERVICE);
    assert_int_equal(b.bin[0].seq, 5);

    assert_true(b.bin[1].from == 120000 && b.bin[1].until == 140000);
    assert_true(b.bin[1].count == 1 && b.bin[1].bad == 0 && b.bin[1].seq == 6);
    assert_near(b.bin[1].min, 3, 0);
    assert_near(b.bin[1].last, 3, 0);
    assert_int_equal(b.bin[1].worst, APC_GOOD);

    assert_true(b.bin[2].from == 160000 && b.bin[2].until == 180000); /* the one before it is empty */
    assert_true(b.bin[2].count == 0 && b.bin[2].bad == 2 && b.bin[2].seq == 8);
    assert_true(b.bin[2].min == 0 && b.bin[2].max == 0 && b.bin[2].mean == 0 && b.bin[2].last == 0);
    assert_int_equal(b.bin[2].worst, APC_BAD_SENSOR_FAILURE);
}

static void test_bins_divide_what_cannot_be_divided_evenly(void **state)
{
    /* 10 us in three bins: they begin at 0, 3.333 and 6.666 us. */
    for (int i = 0; i < 10; i++) {
        append_at(*state, i + 1, i, i, APC_GOOD);
    }
    struct bins b = {0};
    assert_int_equal(bins_of(*state, 0, 10000, 3, &b), 3);
    const int counts[3] = {4, 3, 3}, begins[4] = {0, 3333, 6666, 10000};
    for (int i = 0; i < 3; i++) {
        assert_int_equal(b.bin[i].count, counts[i]);
        assert_true(b.bin[i].from == begins[i] && b.bin[i].until == begins[i + 1]);
    }
    /* A bin may be shorter than what times are kept to; before 1970, and bounds between two of them. */
    struct apc_sample s = sample(APC_SENSOR, 1, 11, 11);
    s.time = -2000;
    assert_int_equal(apc_store_append(*state, &s, 1), 1);
    struct bins c = {0};
    assert_int_equal(bins_of(*state, -2001, 999, 3000, &c), 2);
    assert_true(c.bin[0].from == -2000 && c.bin[0].until == -1999 && c.bin[0].seq == 11);
    assert_true(c.bin[1].from == 0 && c.bin[1].until == 1 && c.bin[1].seq == 1);
    struct bins d = {0};
    assert_int_equal(bins_of(*state, 1, 2000, 1, &d), 1);
    assert_int_equal(d.bin[0].count, 1);
    assert_near(d.bin[0].last, 1, 0);
}

static void test_a_bin_may_be_all_of_time_and_there_may_be_as_many_as_allowed(void **state)
{
    append_many(*state, 1, 2000); /* at 1000 us * seq */
    struct bins b = {0};
    assert_int_equal(bins_of(*state, INT64_MIN, INT64_MAX, 1, &b), 1);
    assert_int_equal(b.bin[0].count, 2000);
    assert_near(b.bin[0].mean, 1999.0 / 2, 0);
    assert_near(b.bin[0].max, 1999, 0);
    assert_near(b.bin[0].last, 1999, 0);
    struct bins c = {0};
    assert_int_equal(bins_of(*state, 0, 2001 * APC_NS_PER_MS, APC_HISTORY_BINS, &c), 2000);
    assert_int_equal(c.n, 2000);
    struct bins none = {0};
    assert_int_equal(bins_of(*state, 3000 * APC_NS_PER_MS, 4000 * APC_NS_PER_MS, 10, &none), 0);
    struct apc_sample before = sample(APC_SENSOR, 1, 3000, 7); /* 0 is a bound like others */
    before.time = -APC_NS_PER_S;
    assert_int_equal(apc_store_append(*state, &before, 1), 1);
    struct bins since = {0}, until = {0};
    assert_int_equal(bins_of(*state, 0, APC_NS_PER_S, 1, &since), 1);
    assert_int_equal(since.bin[0].count, 999);
    assert_int_equal(bins_of(*state, -2 * APC_NS_PER_S, 0, 1, &until), 1);
    assert_int_equal(until.bin[0].count, 1);
}

static void test_bins_end_when_their_function_says_so_and_refuse_what_makes_no_sense(void **state)
{
    append_many(*state, 1, 2000);
    struct bins b = {.stop_after = 3, .store = *state};
    assert_int_equal(bins_of(*state, 0, 2001 * APC_NS_PER_MS, 100, &b), 3);
    assert_int_equal(b.inner, APC_ESTATE);
    assert_int_equal(newest(*state, APC_SENSOR, 1).seq, 2000); /* the store goes on */
    assert_int_equal(bins_of(*state, 0, 1, 0, &b), APC_EINVAL);
    assert_int_equal(bins_of(*state, 0, 1, APC_HISTORY_BINS + 1, &b), APC_EINVAL);
    assert_int_equal(bins_of(*state, 1, 1, 1, &b), APC_EINVAL);
    assert_int_equal(apc_store_history_bins(*state, APC_SENSOR, 1, 0, 1, 1, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_store_history_bins(*state, APC_SENSOR, -1, 0, 1, 1, keep_bin, &b), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_history_comes_in_rising_seq_within_its_bounds),
        T(test_samples_of_one_time_are_all_kept),
        T(test_history_ends_when_its_function_says_so),
        T(test_a_store_refuses_to_be_used_from_inside_its_history),
        T(test_nor_from_inside_any_other_stream),
        T(test_rows_that_the_store_refuses_are_as_they_were),
        T(test_a_history_names_what_a_row_comes_from),
        T(test_variables_are_those_that_have_samples),
        T(test_a_bin_holds_what_lies_within_it),
        T(test_bins_divide_what_cannot_be_divided_evenly),
        T(test_a_bin_may_be_all_of_time_and_there_may_be_as_many_as_allowed),
        T(test_bins_end_when_their_function_says_so_and_refuse_what_makes_no_sense),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
