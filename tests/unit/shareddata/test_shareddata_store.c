/* SPDX-License-Identifier: BSD-3-Clause */
/* What every store must do. A new store joins by a line in tests/support/stores.c. */
#include <inttypes.h>
#include <locale.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "comma_locale.h"
#include "shareddata/shareddata_internal.h"
#include "stores.h"

static int count_sample(void *ctx, const struct apc_sample *s)
{
    (void)s;
    ++*(int *)ctx;
    return 0;
}

static int rows_of(struct apc_store *store, enum apc_table table, int id)
{
    int n = 0;
    ok(store, apc_store_history(store, table, id, NULL, count_sample, &n));
    return n;
}

/* ---- Read and append ----------------------------------------------------------------------- */

static void test_a_variable_without_samples_reads_as_no_data(void **state)
{
    struct apc_sample s = newest(*state, APC_SENSOR, 7);
    assert_int_equal(s.table, APC_SENSOR);
    assert_int_equal(s.id, 7);
    assert_int_equal(s.seq, 0);
    assert_int_equal(s.status, APC_BAD_NO_DATA);
}

static void test_every_member_of_a_sample_comes_back(void **state)
{
    const struct apc_sample in = {.table = APC_ACTUATOR,
                                  .id = 3,
                                  .seq = (INT64_C(1) << 53) - 1,
                                  .time = INT64_C(1769860800123456000),
                                  .value = -0.1,
                                  .status = APC_BAD_OUT_OF_SERVICE,
                                  .origin = 41,
                                  .author = 7};
    assert_int_equal(apc_store_append(*state, &in, 1), 1);
    struct apc_sample out = newest(*state, APC_ACTUATOR, 3);
    assert_memory_equal(&out.value, &in.value, sizeof in.value);
    assert_true(out.seq == in.seq && out.time == in.time && out.status == in.status);
    assert_true(out.origin == 41 && out.author == 7);
}

static void test_values_of_every_size_come_back_bit_for_bit(void **state)
{
    const double values[] = {
        0.0,     -0.0,         1.0 / 3.0,           -1.0 / 3.0,          5e-324, -5e-324, 2.5e-308,
        1.7e-10, 9.999999e299, nextafter(1e300, 0), -nextafter(1e300, 0)};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        struct apc_sample s = sample(APC_SENSOR, 1, (int64_t)i + 1, values[i]);
        assert_int_equal(apc_store_append(*state, &s, 1), 1);
        struct apc_sample out = newest(*state, APC_SENSOR, 1);
        assert_memory_equal(&out.value, &values[i], sizeof values[i]);
    }
}

static void test_what_is_no_value_is_refused_and_nothing_is_written(void **state)
{
    const double values[] = {1e300, -1e300, 1.7e308, (double)NAN, (double)INFINITY, -(double)INFINITY};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        for (int first = 0; first < 2; first++) { /* wherever it stands */
            struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 1, 1.0), sample(APC_SETPOINT, 2, 1, 1.0)};
            s[first].value = values[i];
            assert_int_equal(apc_store_append(*state, s, 2), APC_EINVAL);
            assert_int_equal(apc_store_put(*state, s, 2), APC_EINVAL);
            s[0].seq = s[1].seq = 0;
            assert_int_equal(apc_store_swap(*state, s, 2), APC_EINVAL);
        }
    }
    assert_int_equal(rows_of(*state, APC_SETPOINT, 1), 0);
    assert_int_equal(rows_of(*state, APC_SETPOINT, 2), 0);
}

static void test_arguments_that_make_no_sense_are_refused(void **state)
{
    struct apc_store *store = *state;
    const struct apc_sample bad[] = {
        sample(APC_SENSOR, -1, 1, 1),   sample(APC_SENSOR, 1, 0, 1),
        sample(APC_SENSOR, 1, -5, 1),   sample((enum apc_table)0, 1, 1, 1),
        sample(APC_TABLE_END, 1, 1, 1), sample((enum apc_table) - 3, 1, 1, 1),
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct apc_sample s[2] = {bad[i], sample(APC_SENSOR, 2, 1, 1)};
        assert_int_equal(apc_store_append(store, &bad[i], 1), APC_EINVAL);
        assert_true(apc_store_error(store)[0] != '\0');
        assert_int_equal(apc_store_append(store, s, 2), APC_EINVAL);
        if (bad[i].table != APC_SENSOR || bad[i].id < 0) { /* no seq is asked for there */
            assert_int_equal(apc_store_read(store, s, 2), APC_EINVAL);
            assert_int_equal(apc_store_put(store, s, 2), APC_EINVAL);
            assert_int_equal(apc_store_swap(store, s, 2), APC_EINVAL);
            assert_int_equal(apc_store_claim_set(store, s, 2), APC_EINVAL);
            assert_int_equal(apc_store_release(store, s, 2), APC_EINVAL);
        }
    }
    assert_int_equal(rows_of(store, APC_SENSOR, 2), 0);
    struct apc_sample s = sample(APC_TABLE_END, 1, 1, 1);
    int64_t last[1];
    assert_int_equal(apc_store_read(store, &s, 1), APC_EINVAL);
    assert_int_equal(apc_store_read(store, NULL, 1), APC_EINVAL);
    assert_int_equal(apc_store_append(store, &s, SIZE_MAX / 2), APC_EINVAL);
    assert_int_equal(apc_store_claim(store, APC_TABLE_END, 1, last), APC_EINVAL);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_store_read(NULL, &s, 1), APC_EINVAL);
    assert_int_equal(apc_store_read(store, NULL, 0), 0);
    assert_int_equal(apc_store_append(store, NULL, 0), 0);
    struct apc_sample twice[2] = {sample(APC_SETPOINT, 1, 0, 1), sample(APC_SETPOINT, 1, 0, 2)};
    assert_int_equal(apc_store_put(store, twice, 2), APC_EINVAL);
}

static void test_a_put_of_many_values_names_each_variable_once(void **state)
{
    enum { MOST = 4096 };
    static struct apc_sample s[MOST + 1];
    for (int i = 0; i <= MOST; i++) {
        s[i] = sample(APC_TUNING, i, 0, i);
    }
    assert_int_equal(apc_store_put(*state, s, MOST + 1), APC_EINVAL);
    const struct {
        int one, other;
    } twins[] = {{0, 1}, {0, 99}, {1, 2}, {57, 58}, {98, 99}};
    for (size_t i = 0; i < sizeof twins / sizeof twins[0]; i++) {
        s[twins[i].other].id = twins[i].one;
        assert_int_equal(apc_store_put(*state, s, 100), APC_EINVAL);
        assert_int_equal(apc_store_swap(*state, s, 100), APC_EINVAL);
        s[twins[i].other].table = APC_MANUAL; /* another one of that number */
        s[twins[i].other].id = 200;
        ok(*state, apc_store_put(*state, s, 100));
        s[twins[i].other] = sample(APC_TUNING, twins[i].other, 0, 0);
    }
    ok(*state, apc_store_put(*state, s, MOST));
    assert_near(newest(*state, APC_TUNING, MOST - 1).value, MOST - 1, 0);
}

static void test_samples_of_mixed_tables_in_any_order_are_kept_apart(void **state)
{
    enum { N = 300 };
    struct apc_sample in[N], out[N];
    for (int i = 0; i < N; i++) {
        enum apc_table table = (enum apc_table)(1 + (i * 5) % APC_MANUAL);
        in[i] = sample(table, N - i, 5, i);
        out[i] = (struct apc_sample){.table = table, .id = N - i};
    }
    assert_int_equal(apc_store_append(*state, in, N), N);
    ok(*state, apc_store_read(*state, out, N));
    for (int i = 0; i < N; i++) {
        assert_true(out[i].table == in[i].table && out[i].id == in[i].id && out[i].seq == 5);
        assert_near(out[i].value, i, 0);
    }
}

static void test_the_same_variable_may_be_read_twice_at_once(void **state)
{
    struct apc_sample in = sample(APC_SENSOR, 1, 1, 4.5);
    assert_int_equal(apc_store_append(*state, &in, 1), 1);
    struct apc_sample out[3] = {
        {.table = APC_SENSOR, .id = 1}, {.table = APC_SENSOR, .id = 2}, {.table = APC_SENSOR, .id = 1}};
    ok(*state, apc_store_read(*state, out, 3));
    assert_near(out[0].value, 4.5, 0);
    assert_int_equal(out[1].seq, 0);
    assert_near(out[2].value, 4.5, 0);
}

/* Promise(stores/stores-suite) */
static void test_an_append_repeated_changes_nothing_and_counts_nothing(void **state)
{
    struct apc_sample s[3] = {sample(APC_SENSOR, 1, 1, 1), sample(APC_SENSOR, 2, 1, 2),
                              sample(APC_ACTUATOR, 1, 1, 3)};
    assert_int_equal(apc_store_append(*state, s, 3), 3);
    s[0].value = 99; /* whoever was first keeps the seq */
    s[1].time += 3600 * APC_NS_PER_S;
    assert_int_equal(apc_store_append(*state, s, 3), 0);
    struct apc_sample more[3] = {s[0], s[1], sample(APC_ACTUATOR, 1, 2, 4)};
    assert_int_equal(apc_store_append(*state, more, 3), 1);
    assert_near(newest(*state, APC_SENSOR, 1).value, 1, 0);
    assert_int_equal(rows_of(*state, APC_SENSOR, 1), 1);
    assert_int_equal(rows_of(*state, APC_ACTUATOR, 1), 2);
}

static void test_a_foreign_row_at_the_next_seq_makes_the_count_short_and_keeps_no_other_out(void **state)
{
    struct apc_store *foreign = stores_open();
    struct apc_sample first[2] = {sample(APC_SENSOR, 1, 1, 1), sample(APC_SENSOR, 2, 1, 2)};
    assert_int_equal(apc_store_append(*state, first, 2), 2);
    struct apc_sample theirs = sample(APC_SENSOR, 2, 2, 99);
    assert_int_equal(apc_store_append(foreign, &theirs, 1), 1);
    apc_store_close(foreign);

    struct apc_sample next[4] = {sample(APC_SENSOR, 1, 2, 1), sample(APC_SENSOR, 2, 2, 2),
                                 sample(APC_SENSOR, 3, 2, 3), sample(APC_ESTIMATE, 1, 2, 4)};
    assert_int_equal(apc_store_append(*state, next, 4), 3);
    for (int i = 0; i < 4; i++) {
        struct apc_sample s = newest(*state, next[i].table, next[i].id);
        assert_int_equal(s.seq, 2);
        assert_near(s.value, i == 1 ? 99 : next[i].value, 0);
    }
    assert_int_equal(apc_store_append(*state, next, 4), 0); /* exact for each call, not in sum */
    struct apc_sample twice[2] = {sample(APC_SENSOR, 4, 1, 1), sample(APC_SENSOR, 4, 1, 2)};
    assert_int_equal(apc_store_append(*state, twice, 2), 1);
    twice[0].seq = 2; /* one that is there, behind one that is not */
    assert_int_equal(apc_store_append(*state, twice, 2), 1);
    assert_int_equal(newest(*state, APC_SENSOR, 4).seq, 2);
}

static void test_a_seq_that_leaves_no_room_to_count_on_is_refused(void **state)
{
    const int64_t highest = (INT64_C(1) << 53) - 1;
    struct apc_sample s = sample(APC_TUNING, 1, 1, 1);
    s.seq = INT64_MAX;
    assert_int_equal(apc_store_append(*state, &s, 1), APC_ESTORE);
    s.seq = highest + 1;
    assert_int_equal(apc_store_append(*state, &s, 1), APC_ESTORE);
    s.seq = highest;
    assert_int_equal(apc_store_append(*state, &s, 1), 1);
    assert_int_equal(apc_store_put(*state, &s, 1), APC_ESTORE);
    assert_non_null(strstr(apc_store_error(*state), "seq_in_range"));
}

static void test_an_append_larger_than_any_buffer_is_still_one(void **state)
{
    enum { N = 25000 }; /* over a MB: neither side's socket holds it */
    struct apc_sample *s = malloc(N * sizeof *s);
    assert_non_null(s);
    for (int i = 0; i < N; i++) {
        s[i] = sample(APC_SENSOR, i, 1, i);
    }
    assert_int_equal(apc_store_append(*state, s, N), N);
    for (int i = 0; i < N; i++) {
        s[i] = (struct apc_sample){.table = APC_SENSOR, .id = i};
    }
    ok(*state, apc_store_read(*state, s, N));
    for (int i = 0; i < N; i++) {
        assert_near(s[i].value, i, 0);
    }
    free(s);
}

/* Promise(stores/stores-suite) */
static void test_one_bad_row_keeps_the_whole_append_out(void **state)
{
    /* A fractional dimension is refused by the store itself, after the others were taken. */
    const struct apc_sample s[3] = {sample(APC_SENSOR, 1, 1, 1), sample(APC_DIM, 1, 1, 1.5),
                                    sample(APC_ESTIMATE, 1, 1, 1)};
    assert_int_equal(apc_store_append(*state, s, 3), APC_ESTORE);
    assert_non_null(strstr(apc_store_error(*state), "dim"));
    assert_null(strchr(apc_store_error(*state), '\n'));
    assert_int_equal(rows_of(*state, APC_SENSOR, 1), 0);
    assert_int_equal(rows_of(*state, APC_ESTIMATE, 1), 0);
    struct apc_sample good = sample(APC_DIM, 1, 1, 2);
    assert_int_equal(apc_store_append(*state, &good, 1), 1); /* and it goes on */
}

/*
 * Promise(run/step-wall-clock)
 * Promise(stores/stores-suite): All stores do the same, by one suite.
 */
static void test_newest_is_the_highest_seq_when_the_clock_steps_back(void **state)
{
    struct apc_sample before = sample(APC_SENSOR, 1, 10, 1), after = sample(APC_SENSOR, 1, 11, 2);
    before.time = INT64_C(1769864400) * APC_NS_PER_S;
    after.time = before.time - 3600 * APC_NS_PER_S;
    assert_int_equal(apc_store_append(*state, &before, 1), 1);
    assert_int_equal(apc_store_append(*state, &after, 1), 1);
    struct apc_sample s = newest(*state, APC_SENSOR, 1);
    assert_int_equal(s.seq, 11);
    assert_near(s.value, 2, 0);
    assert_true(s.time == after.time);
    struct apc_sample late = sample(APC_SENSOR, 1, 9, 3); /* from a spool */
    assert_int_equal(apc_store_append(*state, &late, 1), 1);
    assert_int_equal(newest(*state, APC_SENSOR, 1).seq, 11);
}

static void test_times_before_1970_are_kept(void **state)
{
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    s.time = -1500; /* 1.5 us before: whole microseconds are kept, the rest is cut off downwards */
    assert_int_equal(apc_store_append(*state, &s, 1), 1);
    assert_true(newest(*state, APC_SENSOR, 1).time == -2000);
}

static void test_two_plants_in_one_database_do_not_see_each_other(void **state)
{
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(*state, &s, 1), 1);
    void *other = NULL;
    assert_int_equal(stores_set_up(&other), 0);
    assert_int_equal(newest(other, APC_SENSOR, 1).seq, 0);
    apc_store_close(other);
}

/* ---- Claim and put --------------------------------------------------------------------------- */

static void test_a_claim_gives_the_newest_seq_of_each_id(void **state)
{
    const struct apc_sample s[2] = {sample(APC_ACTUATOR, 1, 17, 1), sample(APC_ACTUATOR, 3, 4, 1)};
    assert_int_equal(apc_store_append(*state, s, 2), 2);
    int64_t last[4] = {-1, -1, -1, -1};
    ok(*state, apc_store_claim(*state, APC_ACTUATOR, 4, last));
    assert_int_equal(last[0], 17);
    assert_int_equal(last[1], 0);
    assert_int_equal(last[2], 4);
    assert_int_equal(last[3], 0);
    ok(*state, apc_store_claim(*state, APC_ACTUATOR, 4, last)); /* it is ours already */
    assert_int_equal(apc_store_claim(*state, APC_ACTUATOR, 0, last), 0);
}

/*
 * Promise(run/second-controller-client): A second controller or client is refused, and told who is there.
 */
static void test_a_second_writer_is_refused_by_name_until_the_first_has_gone(void **state)
{
    struct apc_store *second = stores_open(), *third = stores_open();
    int64_t last[1];
    ok(*state, apc_store_claim(*state, APC_ACTUATOR, 1, last));
    assert_int_equal(apc_store_claim(second, APC_ACTUATOR, 1, last), APC_EBUSY);
    assert_non_null(strstr(apc_store_error(second), "actuator"));
    assert_non_null(strstr(apc_store_error(second), "already written by test"));
    ok(second, apc_store_claim(second, APC_SENSOR, 1, last)); /* another table is free */
    assert_int_equal(apc_store_claim(third, APC_SENSOR, 1, last), APC_EBUSY);
    apc_store_close(second); /* which frees it, on a server as soon as that has ended the session */
    int err = APC_EBUSY;
    for (int tries = 0; err == APC_EBUSY && tries < 1000; tries++) {
        err = apc_store_claim(third, APC_SENSOR, 1, last);
        usleep(err == APC_EBUSY ? 10000 : 0);
    }
    ok(third, err);
    apc_store_close(third);
}

static void test_put_takes_the_next_seq(void **state)
{
    struct apc_sample s[3] = {sample(APC_TUNING, 2, 0, 0.2), sample(APC_OPMODE, 0, 0, 1),
                              sample(APC_TUNING, 1, 0, 10)};
    ok(*state, apc_store_put(*state, s, 3));
    assert_true(s[0].seq == 1 && s[1].seq == 1 && s[2].seq == 1);
    ok(*state, apc_store_put(*state, s, 1));
    assert_int_equal(s[0].seq, 2);
    struct apc_sample out = newest(*state, APC_TUNING, 2);
    assert_int_equal(out.seq, 2);
    assert_near(out.value, 0.2, 0);
    assert_true(out.time == s[0].time);
}

static void test_a_put_is_all_or_nothing(void **state)
{
    struct apc_sample s[2] = {sample(APC_TUNING, 1, 0, 1), sample(APC_OPMODE, 0, 0, 0.5)};
    assert_int_equal(apc_store_put(*state, s, 2), APC_ESTORE);
    assert_int_equal(rows_of(*state, APC_TUNING, 1), 0);
}

enum { PUTTERS = 2, PUTS = 60 };

struct putter {
    int number, failed;
    int64_t seq[PUTS];
};

/* Puts until accepted; APC_ECONFLICT is an honest answer, a lost or doubled update is not. */
static void *put_many(void *arg)
{
    struct putter *p = arg;
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .timeout = 20 * APC_NS_PER_S};
    if (apc_store_open(&store, store_uri, &options, NULL) != 0) {
        p->failed = 1;
        return NULL;
    }
    for (int i = 0; i < PUTS && !p->failed; i++) {
        struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 0, p->number * 1000 + i),
                                  sample(APC_SETPOINT, 2, 0, i)};
        int err = APC_ECONFLICT;
        for (int tries = 0; tries < 1000 && err == APC_ECONFLICT; tries++) {
            err = apc_store_put(store, s, 2);
        }
        p->failed = err != 0;
        p->seq[i] = s[0].seq;
    }
    apc_store_close(store);
    return NULL;
}

static int collect(void *ctx, const struct apc_sample *s)
{
    ((double *)ctx)[s->seq] = s->value;
    return s->seq > PUTTERS * PUTS;
}

static void test_concurrent_puts_lose_and_double_nothing(void **state)
{
    static struct putter putters[PUTTERS];
    pthread_t threads[PUTTERS];
    for (int i = 0; i < PUTTERS; i++) {
        putters[i] = (struct putter){.number = i};
        assert_int_equal(pthread_create(&threads[i], NULL, put_many, &putters[i]), 0);
    }
    for (int i = 0; i < PUTTERS; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(putters[i].failed, 0);
    }
    double values[PUTTERS * PUTS + 2];
    assert_int_equal(apc_store_history(*state, APC_SETPOINT, 1, NULL, collect, values), PUTTERS * PUTS);
    for (int i = 0; i < PUTTERS; i++) {
        for (int k = 0; k < PUTS; k++) {
            assert_near(values[putters[i].seq[k]], i * 1000 + k, 0); /* each where its writer was told */
        }
    }
    assert_int_equal(rows_of(*state, APC_SETPOINT, 2), PUTTERS * PUTS);
}

/* ---- Swap ------------------------------------------------------------------------------------ */

static void test_a_swap_takes_the_next_seq_when_the_newest_is_the_one_expected(void **state)
{
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 0, 5), sample(APC_OPMODE, 0, 0, 1)};
    s[0].time = 7000;
    s[1].status = APC_UNCERTAIN;
    ok(*state, apc_store_swap(*state, s, 2)); /* seq 0: there is none yet */
    assert_true(s[0].seq == 1 && s[1].seq == 1);
    s[0].value = 6;
    ok(*state, apc_store_swap(*state, s, 1));
    assert_int_equal(s[0].seq, 2);
    struct apc_sample setpoint = newest(*state, APC_SETPOINT, 1), mode = newest(*state, APC_OPMODE, 0);
    assert_int_equal(setpoint.seq, 2);
    assert_near(setpoint.value, 6, 0);
    assert_true(setpoint.time == 7000);
    assert_int_equal(mode.seq, 1);
    assert_int_equal(mode.status, APC_UNCERTAIN);
}

static void test_a_swap_that_is_too_late_writes_nothing_and_shows_what_is_newest(void **state)
{
    struct apc_sample first[2] = {sample(APC_SETPOINT, 1, 0, 5), sample(APC_TUNING, 2, 0, 50)};
    ok(*state, apc_store_put(*state, first, 2));
    ok(*state, apc_store_put(*state, first, 1)); /* setpoint 1 is now at seq 2 */
    struct apc_sample late[3] = {sample(APC_TUNING, 2, 1, -1), sample(APC_SETPOINT, 1, 1, -1),
                                 sample(APC_SETPOINT, 9, 0, -1)};
    assert_int_equal(apc_store_swap(*state, late, 3), APC_ECONFLICT);
    assert_true(late[0].seq == 1 && late[1].seq == 2 && late[2].seq == 0);
    assert_near(late[0].value, 50, 0);
    assert_near(late[1].value, 5, 0);
    assert_int_equal(late[2].status, APC_BAD_NO_DATA);
    assert_int_equal(rows_of(*state, APC_TUNING, 2), 1);
    assert_int_equal(rows_of(*state, APC_SETPOINT, 1), 2);
    assert_int_equal(rows_of(*state, APC_SETPOINT, 9), 0);
    late[1].value = 8;
    ok(*state, apc_store_swap(*state, late, 3)); /* with what it has been shown */
    assert_true(late[0].seq == 2 && late[1].seq == 3 && late[2].seq == 1);
    assert_near(newest(*state, APC_SETPOINT, 1).value, 8, 0);
}

static void test_a_swap_into_a_gap_of_the_history_is_too_late_as_well(void **state)
{
    struct apc_sample s[2] = {sample(APC_MANUAL, 1, 1, 1), sample(APC_MANUAL, 1, 5, 5)};
    assert_int_equal(apc_store_append(*state, s, 2), 2);
    struct apc_sample gap = sample(APC_MANUAL, 1, 1, -1), ahead = sample(APC_MANUAL, 1, 7, -1);
    assert_int_equal(apc_store_swap(*state, &gap, 1), APC_ECONFLICT); /* seq 2 would be free */
    assert_int_equal(gap.seq, 5);
    assert_int_equal(apc_store_swap(*state, &ahead, 1), APC_ECONFLICT);
    assert_int_equal(rows_of(*state, APC_MANUAL, 1), 2);
}

static void test_a_swap_that_makes_no_sense_is_refused(void **state)
{
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 0, 1), sample(APC_SETPOINT, 1, 0, 2)};
    assert_int_equal(apc_store_swap(*state, s, 2), APC_EINVAL); /* twice the same */
    s[1] = sample(APC_SETPOINT, 2, -1, 1);
    assert_int_equal(apc_store_swap(*state, s, 2), APC_EINVAL);
    s[1] = sample(APC_SETPOINT, 2, 0, (double)NAN);
    assert_int_equal(apc_store_swap(*state, s, 2), APC_EINVAL);
    s[1] =
        sample(APC_OPMODE, 0, 0, 0.5); /* refused by the store itself: and the other is not written either */
    assert_int_equal(apc_store_swap(*state, s, 2), APC_ESTORE);
    assert_int_equal(rows_of(*state, APC_SETPOINT, 1), 0);
    assert_int_equal(apc_store_swap(*state, NULL, 0), 0);
    s[1] = sample(APC_OPMODE, 0, 0, 1);
    ok(*state, apc_store_swap(*state, s, 2)); /* and it goes on */
}

enum { SWAPPERS = 3, SWAPS = 40 };

/* Each adds one to a value that all of them share: what is lost or doubled shows in the sum. */
static void *swap_many(void *arg)
{
    int *failed = arg;
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .timeout = 20 * APC_NS_PER_S};
    *failed = apc_store_open(&store, store_uri, &options, NULL);
    struct apc_sample s[2] = {{.table = APC_SETPOINT, .id = 1}, {.table = APC_TUNING, .id = 1}};
    *failed = *failed ? *failed : apc_store_read(store, s, 2);
    for (int done = 0; !*failed && done < SWAPS;) {
        for (int i = 0; i < 2; i++) {
            s[i].value = s[i].seq ? s[i].value + 1 : 1;
            s[i].status = APC_GOOD;
        }
        int err = apc_store_swap(store, s, 2);
        done += err == 0;
        *failed = err == APC_ECONFLICT ? 0 : err;
    }
    apc_store_close(store);
    return NULL;
}

static void test_concurrent_swaps_lose_and_double_nothing(void **state)
{
    pthread_t threads[SWAPPERS];
    int failed[SWAPPERS];
    for (int i = 0; i < SWAPPERS; i++) {
        assert_int_equal(pthread_create(&threads[i], NULL, swap_many, &failed[i]), 0);
    }
    for (int i = 0; i < SWAPPERS; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(failed[i], 0);
    }
    const enum apc_table tables[2] = {APC_SETPOINT, APC_TUNING};
    for (int i = 0; i < 2; i++) {
        struct apc_sample s = newest(*state, tables[i], 1);
        assert_near(s.value, SWAPPERS * SWAPS, 0);
        assert_int_equal(s.seq, SWAPPERS * SWAPS);
        assert_int_equal(rows_of(*state, tables[i], 1), SWAPPERS * SWAPS);
    }
}

/* ---- Wait ------------------------------------------------------------------------------------ */

static void test_a_wait_tells_what_is_there_already_and_what_is_not(void **state)
{
    struct apc_sample seen[2] = {{.table = APC_SENSOR, .id = 1}, {.table = APC_SETPOINT, .id = 2}};
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 0);
    struct apc_sample s[2] = {sample(APC_SETPOINT, 2, 3, 1), sample(APC_SETPOINT, 1, 9, 1)};
    assert_int_equal(apc_store_append(*state, s, 2), 2);
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 1);
    assert_int_equal(apc_store_wait(*state, seen, 2, 60 * APC_NS_PER_S), 1);
    assert_int_equal(apc_store_wait(*state, seen, 1, 0), 0); /* sensor 1 alone */
    seen[1].seq = 2;
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 1);
    seen[1].seq = 3;
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 0);
    assert_int_equal(apc_store_wait(*state, seen, 2, 20 * APC_NS_PER_MS), 0);
    assert_int_equal(apc_store_wait(*state, NULL, 0, 60 * APC_NS_PER_S), 0);
    assert_int_equal(apc_store_wait(*state, seen, 2, -1), APC_EINVAL);
    seen[0].table = APC_TABLE_END;
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), APC_EINVAL);
    assert_int_equal(newest(*state, APC_SETPOINT, 2).seq, 3); /* and the store goes on */
}

/* Promise(stores/stores-suite) */
static void test_a_wait_sees_every_way_of_writing(void **state)
{
    struct apc_store *writer = stores_open();
    struct apc_sample seen = {.table = APC_SETPOINT, .id = 1}, s = sample(APC_SETPOINT, 1, 1, 1);
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 0);
    assert_int_equal(apc_store_append(writer, &s, 1), 1);
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 1);
    seen.seq = 1;
    ok(writer, apc_store_put(writer, &s, 1));
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 1);
    seen.seq = 2;
    ok(writer, apc_store_swap(writer, &s, 1));
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 1);
    seen.seq = 3;
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 0);
    struct apc_sample old = sample(APC_SETPOINT, 1, 0, 1); /* in the place of none: not newer than seen */
    old.seq = 2;
    assert_int_equal(apc_store_append(writer, &old, 1), 0);
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 0);
    apc_store_close(writer);
}

enum { VOLLEYS = 300 };

/* Answers each sensor sample by an actuator sample with the same seq and value. */
static void *play(void *arg)
{
    int *failed = arg;
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .timeout = 20 * APC_NS_PER_S};
    *failed = apc_store_open(&store, store_uri, &options, NULL);
    struct apc_sample seen = {.table = APC_SENSOR, .id = 1};
    while (!*failed && seen.seq < VOLLEYS) {
        int64_t before = seen.seq;
        int woken = apc_store_wait(store, &seen, 1, 60 * APC_NS_PER_S);
        int err = apc_store_read(store, &seen, 1);
        struct apc_sample answer = sample(APC_ACTUATOR, 1, seen.seq, seen.value);
        *failed = woken != 1 || err || seen.seq != before + 1 || apc_store_append(store, &answer, 1) != 1;
    }
    apc_store_close(store);
    return NULL;
}

static void test_two_waiters_wake_each_other_and_miss_nothing(void **state)
{
    pthread_t thread;
    int failed = 0, woken = 1, appended = 1;
    assert_int_equal(pthread_create(&thread, NULL, play, &failed), 0);
    struct apc_sample seen = {.table = APC_ACTUATOR, .id = 1};
    for (int i = 1; i <= VOLLEYS && woken == 1 && appended == 1; i++) {
        struct apc_sample ball = sample(APC_SENSOR, 1, i, i);
        appended = apc_store_append(*state, &ball, 1);
        woken = apc_store_wait(*state, &seen, 1, 60 * APC_NS_PER_S);
        seen.seq = i;
    }
    pthread_join(thread, NULL);
    assert_int_equal(appended, 1);
    assert_int_equal(woken, 1);
    assert_int_equal(failed, 0);
    assert_int_equal(newest(*state, APC_ACTUATOR, 1).seq, VOLLEYS);
}

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

/* ---- Tags, events, timing ---------------------------------------------------------------------- */

static void test_tags_come_back_in_order(void **state)
{
    struct apc_tag in[3] = {
        {.table = APC_SETPOINT, .id = 1, .name = "TIC-1", .unit = "K", .low = 0, .high = 20},
        {.table = APC_SENSOR,
         .id = 2,
         .name = "TT-2",
         .low = -APC_VALUE_MAX,
         .high = APC_VALUE_MAX,
         .controller = "upper",
         .area = "unit1/reactor",
         .display_low = -1.5,
         .display_high = 2.5,
         .period = APC_VALUE_MAX,
         .step = 0.5,
         .length = 40},
        {.table = APC_SENSOR,
         .id = 1,
         .name = "TIC-1",
         .unit = "\xc2\xb0"
                 "C",
         .description = "O'Brien's; \"tank\"",
         .low = -5,
         .high = 5},
    };
    assert_int_equal(apc_store_put_tags(*state, in, 3), 3);
    struct apc_tag out[2];
    assert_int_equal(apc_store_get_tags(*state, out, 2), 3); /* all in all */
    assert_int_equal(out[0].table, APC_SENSOR);
    assert_int_equal(out[0].id, 1);
    assert_string_equal(out[0].name, "TIC-1");
    assert_string_equal(out[0].unit, "\xc2\xb0"
                                     "C");
    assert_string_equal(out[0].description, "O'Brien's; \"tank\"");
    assert_int_equal(out[1].id, 2);
    assert_near(out[1].high, 1e300, 0);
    assert_string_equal(out[1].controller, "upper");
    assert_string_equal(out[1].area, "unit1/reactor");
    assert_near(out[1].display_low, -1.5, 0);
    assert_near(out[1].display_high, 2.5, 0);
    assert_near(out[1].period, APC_VALUE_MAX, 0);
    assert_near(out[1].step, 0.5, 0);
    assert_int_equal(out[1].length, 40);
    assert_string_equal(out[0].controller, "");
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 3);
}

static void test_tags_are_replaced_as_a_whole_and_may_change_names(void **state)
{
    struct apc_tag in[3] = {{.table = APC_SENSOR, .id = 1, .name = "A", .high = 1},
                            {.table = APC_SENSOR, .id = 2, .name = "B", .high = 2},
                            {.table = APC_SETPOINT, .id = 1, .name = "A", .high = 3}};
    assert_int_equal(apc_store_put_tags(*state, in, 3), 3);
    struct apc_tag swapped[2] = {in[0], in[1]}, out[3];
    swapped[0].id = 2;
    swapped[1].id = 1;
    assert_int_equal(apc_store_put_tags(*state, swapped, 2), 2);
    assert_int_equal(apc_store_get_tags(*state, out, 3), 2); /* the setpoint's has gone */
    assert_string_equal(out[0].name, "B");
    assert_near(out[0].high, 2, 0);
    assert_string_equal(out[1].name, "A");

    in[1].name[0] = 'A'; /* twice in one table */
    assert_int_equal(apc_store_put_tags(*state, in, 3), APC_ESTORE);
    in[1] = in[0]; /* the same variable twice */
    assert_int_equal(apc_store_put_tags(*state, in, 2), APC_ESTORE);
    in[0].low = 2; /* limits upside down */
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    in[0].low = 0;
    in[0].display_low = (double)NAN;
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    in[0].display_low = 0;
    in[0].period = -1;
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    assert_int_equal(apc_store_get_tags(*state, out, 3), 2); /* nothing half done */
    assert_string_equal(out[0].name, "B");

    assert_int_equal(apc_store_put_tags(*state, NULL, 0), 0);
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 0);
}

/* Of twelve, in three tables, in any order. */
static void test_a_name_is_found_twice_wherever_it_stands(void **state)
{
    static const enum apc_table tables[] = {APC_SENSOR, APC_ACTUATOR, APC_SETPOINT};
    struct apc_tag tag[12] = {{0}};
    for (int i = 0; i < 12; i++) {
        tag[i] = (struct apc_tag){.table = tables[i % 3], .id = 1 + i / 3, .high = 1};
        snprintf(tag[i].name, sizeof tag[i].name, "%c", 'a' + i / 3);
    }
    assert_int_equal(apc_store_put_tags(*state, tag, 12), 12); /* the same ones, each in its table */
    for (int i = 0; i < 12; i++) {
        for (int k = i % 3; k < i; k += 3) { /* of the same table */
            char kept = tag[i].name[0];
            tag[i].name[0] = tag[k].name[0];
            assert_int_equal(apc_store_put_tags(*state, tag, 12), APC_ESTORE);
            tag[i].name[0] = kept;
            int id = tag[i].id;
            tag[i].id = tag[k].id;
            assert_int_equal(apc_store_put_tags(*state, tag, 12), APC_ESTORE);
            tag[i].id = id;
        }
    }
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 12);
}

static int keep_event(void *ctx, const struct apc_event *e)
{
    struct apc_event **next = ctx;
    *(*next)++ = *e;
    return 0;
}

/*
 * Promise(stores/plant-stands-every): What the plant is stands in every store, each text a revision; a
 *   number says who wrote a row, and stays.
 */
static void test_the_catalogue_comes_with_the_tags_and_each_text_is_a_revision(void **state)
{
    struct apc_store *store = *state;
    const struct apc_tag tag[2] = {{.table = APC_SENSOR, .id = 1, .name = "A"},
                                   {.table = APC_SENSOR, .id = 2, .name = "A"}};
    static const char text[] = "name = \"tank\"; # 20 \xc2\xb0"
                               "C\n";
    char out[64];
    int64_t revision = 7;
    memset(out, 'x', sizeof out);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 0); /* none */
    assert_string_equal(out, "");
    assert_int_equal(revision, 0);
    assert_int_equal(apc_store_describe(store, tag, 1, text), 1);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), sizeof text - 1);
    assert_string_equal(out, text);
    assert_int_equal(revision, 1);
    assert_int_equal(apc_store_describe(store, tag, 1, text), 1); /* as it was */
    assert_int_equal(apc_store_put_tags(store, tag, 1), 1);
    assert_int_equal(apc_store_describe(store, tag, 2, "b"), APC_ESTORE); /* tags that are none: no text */
    assert_int_equal(apc_store_catalogue(store, NULL, 0, &revision), sizeof text - 1);
    assert_int_equal(revision, 1);

    for (size_t size = 1; size < sizeof text; size++) { /* as much as there is room for */
        memset(out, 'x', sizeof out);
        assert_int_equal(apc_store_catalogue(store, out, size, NULL), sizeof text - 1);
        assert_int_equal(strlen(out), size - 1);
        assert_memory_equal(out, text, size - 1);
        assert_int_equal(out[size], 'x');
    }
    assert_int_equal(apc_store_describe(store, NULL, 0,
                                        "\xff"
                                        "b"),
                     0);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 2);
    assert_string_equal(out, "?b"); /* a byte that is no character */
    assert_int_equal(revision, 2);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), 0);
    assert_int_equal(apc_store_describe(store, tag, 1, ""), 1);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 0);
    assert_int_equal(revision, 3);

    struct apc_store *other = stores_open(); /* for all who use it */
    assert_int_equal(apc_store_catalogue(other, NULL, 0, &revision), 0);
    assert_int_equal(revision, 3);
    apc_store_close(other);
}

/* Promise(stores/plant-stands-every) */
static void test_a_catalogue_of_many_bytes_is_whole_or_refused(void **state)
{
    struct apc_store *store = *state;
    enum { LENGTH = 200001 };
    char *text = malloc(APC_CATALOGUE_MAX + 2), *out = malloc(LENGTH + 1);
    assert_true(text && out);
    memset(text, 'a', APC_CATALOGUE_MAX + 1);
    for (size_t i = 0; i < LENGTH; i++) {
        text[i] = (char)('a' + i % 26);
    }
    text[APC_CATALOGUE_MAX + 1] = '\0';
    assert_int_equal(apc_store_describe(store, NULL, 0, text), APC_EINVAL);
    text[LENGTH] = '\0';
    assert_int_equal(apc_store_describe(store, NULL, 0, text), 0);
    assert_int_equal(apc_store_catalogue(store, out, LENGTH + 1, NULL), LENGTH);
    assert_string_equal(out, text);
    free(text);
    free(out);
}

static int keep_first(void *ctx, const struct apc_sample *s)
{
    *(struct apc_sample *)ctx = *s;
    return 1;
}

/* Promise(stores/plant-stands-every) */
static void test_an_author_has_a_number_that_stays(void **state)
{
    struct apc_store *store = *state, *other = stores_open();
    char name[APC_AUTHOR_LEN], longest[APC_AUTHOR_LEN + 1];
    const int anna = apc_store_author(store, "anna"), bert = apc_store_author(other, "bert");
    assert_true(anna > 0 && bert > 0 && anna != bert);
    assert_int_equal(apc_store_author(other, "anna"), anna);
    ok(store, apc_store_author_name(store, (uint32_t)bert, name));
    assert_string_equal(name, "bert");
    assert_int_equal(apc_store_author_name(store, 0, name), APC_ENOTFOUND);
    assert_string_equal(name, "");
    assert_int_equal(apc_store_author_name(store, 2000000000, name), APC_ENOTFOUND);
    memset(longest, 'a', sizeof longest);
    longest[APC_AUTHOR_LEN] = '\0';
    assert_int_equal(apc_store_author(store, longest), APC_EINVAL);
    assert_int_equal(apc_store_author(store, ""), APC_EINVAL);
    assert_int_equal(apc_store_author(store, NULL), APC_EINVAL);
    longest[APC_AUTHOR_LEN - 1] = '\0';
    const int last = apc_store_author(store, longest);
    assert_true(last > 0);
    ok(other, apc_store_author_name(other, (uint32_t)last, name));
    assert_string_equal(name, longest);

    struct apc_sample s = sample(APC_SETPOINT, 1, 0, 3); /* and stands in what he writes */
    s.author = (uint32_t)anna;
    ok(store, apc_store_put(store, &s, 1));
    s.author = (uint32_t)bert;
    ok(store, apc_store_swap(store, &s, 1));
    assert_int_equal(newest(other, APC_SETPOINT, 1).author, bert);
    struct apc_sample first = {.seq = 0};
    assert_int_equal(apc_store_history(other, APC_SETPOINT, 1, NULL, keep_first, &first), 1);
    assert_int_equal(first.author, anna);
    apc_store_close(other);
}

static void test_events_come_back_in_order(void **state)
{
    const struct apc_event in[3] = {
        {.time = 1000,
         .severity = APC_EVENT_INFO,
         .source = "operator",
         .kind = "mode",
         .text = "Man -> Auto"},
        {.time = 3000,
         .severity = APC_EVENT_ALARM,
         .source = "apc-plant",
         .kind = "watchdog",
         .text = "it's \xc3\xa4 \xff cut"},
        {.time = 2000, .severity = APC_EVENT_WARNING, .source = "apc-client", .kind = "link", .text = ""},
    };
    assert_int_equal(apc_store_append_events(*state, in, 3), 3);
    struct apc_event out[3], *next = out;
    assert_int_equal(apc_store_events(*state, NULL, keep_event, &next), 3);
    assert_true(out[0].time == 1000 && out[1].time == 3000 && out[2].time == 2000);
    assert_int_equal(out[1].severity, APC_EVENT_ALARM);
    assert_string_equal(out[0].source, "operator");
    assert_string_equal(out[0].kind, "mode");
    assert_string_equal(out[0].text, "Man -> Auto");
    assert_string_equal(out[1].text, "it's \xc3\xa4 ? cut"); /* not lost for one bad byte */
    next = out;
    assert_int_equal(apc_store_events(*state, &(struct apc_range){.last = 2}, keep_event, &next), 2);
    assert_true(out[0].time == 3000 && out[1].time == 2000);
    next = out;
    assert_int_equal(
        apc_store_events(*state, &(struct apc_range){.since = 2000, .until = 3000}, keep_event, &next), 1);
    assert_string_equal(out[0].source, "apc-client");
    struct apc_event bad = {.severity = (enum apc_event_severity)9};
    assert_int_equal(apc_store_append_events(*state, &bad, 1), APC_EINVAL);
}

/* Every length of UTF-8 at both ends of what is well-formed, and just beyond. */
/* Promise(incoming/text-of-others) */
static void test_a_text_keeps_its_characters_and_no_other_byte(void **state)
{
    static const struct {
        const char *in, *out;
    } texts[] = {{"\x7e", "\x7e"},
                 {"\xc2\xa0", "\xc2\xa0"},
                 {"two\nlines\r\n\tthree\xe2\x80\xa8", "two lines   three "},
                 {"\x1b[2J\x7f", "?[2J?"},
                 {"\xc2\x9b[31m", "?[31m"},
                 {"a\xe2\x80\xae"
                  "b\xe2\x81\xa9"
                  "c\xd8\x9c",
                  "a?b?c?"},
                 {"\xdf\xbf", "\xdf\xbf"},
                 {"\xe0\xa0\x80", "\xe0\xa0\x80"},
                 {"\xed\x9f\xbf", "\xed\x9f\xbf"},
                 {"\xef\xbf\xbd", "\xef\xbf\xbd"},
                 {"\xf0\x90\x80\x80", "\xf0\x90\x80\x80"},
                 {"\xf4\x8f\xbf\xbd", "\xf4\x8f\xbf\xbd"},
                 {"\x80", "?"},
                 {"\xbf", "?"},
                 {"\xc0\x80", "??"},
                 {"\xc1\xbf", "??"},
                 {"\xc2", "?"},
                 {"\xc2z", "?z"},
                 {"\xe0\x9f\xbf", "???"},
                 {"\xed\xa0\x80", "???"},
                 {"\xe1\x80z", "??z"},
                 {"\xf0\x8f\xbf\xbf", "????"},
                 {"\xf4\x90\x80\x80", "????"},
                 {"\xf1\x80\x80", "???"},
                 {"\xf5\x80\x80\x80", "????"},
                 {"\xff\xfe", "??"}};
    enum { N = sizeof texts / sizeof texts[0] };
    struct apc_event in[N], out[N], *next = out;
    for (int i = 0; i < N; i++) {
        in[i] = (struct apc_event){.time = 1000, .severity = APC_EVENT_INFO, .source = "s", .kind = "k"};
        snprintf(in[i].text, sizeof in[i].text, "%s", texts[i].in);
    }
    assert_int_equal(apc_store_append_events(*state, in, N), N);
    assert_int_equal(apc_store_events(*state, NULL, keep_event, &next), N);
    for (int i = 0; i < N; i++) {
        assert_string_equal(out[i].text, texts[i].out);
    }
}

static int keep_task(void *ctx, const struct apc_timing_row *row)
{
    snprintf(ctx, sizeof row->task, "%s", row->task);
    return 0;
}

/* Who writes, what is described, and which task was measured is shown in one line too; a catalogue has its
 * lines. */
/* Promise(incoming/text-of-others) */
static void test_names_are_one_line_that_shows_as_it_is(void **state)
{
    struct apc_store *store = *state;
    const struct apc_tag tag = {.table = APC_SENSOR,
                                .id = 1,
                                .name = "y\n1",
                                .unit = "\x1b[2J",
                                .description = "level\xe2\x80\xae",
                                .controller = "\xc2\x9b",
                                .area = "a\tb",
                                .high = 1};
    const struct apc_timing_row row = {.time = 1000, .task = "client\n\x1b", .quantity = "run", .period = 1};
    struct apc_tag is;
    char name[APC_AUTHOR_LEN], text[40], task[sizeof row.task] = "";
    const int author = apc_store_author(store, "anna\n\x1b[31m");
    assert_true(author > 0);
    ok(store, apc_store_author_name(store, (uint32_t)author, name));
    assert_string_equal(name, "anna ?[31m");
    assert_int_equal(apc_store_author(store, "anna ?[31m"), author);
    ok(store, apc_store_describe(store, &tag, 1, "a = 1;\n\tb = \"\x1b\";\n"));
    assert_int_equal(apc_store_get_tags(store, &is, 1), 1);
    assert_string_equal(is.name, "y 1");
    assert_string_equal(is.unit, "?[2J");
    assert_string_equal(is.description, "level?");
    assert_string_equal(is.controller, "?");
    assert_string_equal(is.area, "a b");
    assert_true(apc_store_catalogue(store, text, sizeof text, NULL) > 0);
    assert_string_equal(text, "a = 1;\n\tb = \"?\";\n");
    ok(store, apc_store_append_timing(store, &row, 1));
    assert_int_equal(apc_store_timing(store, NULL, keep_task, task), 1);
    assert_string_equal(task, "client ?");
}

struct timings {
    struct apc_timing_row rows[4];
    int64_t bins[4][3];
    size_t n;
};

static int keep_timing(void *ctx, const struct apc_timing_row *row)
{
    struct timings *t = ctx;
    if (row->n_bins == 2) {
        t->bins[t->n][0] = row->bin_low[1];
        t->bins[t->n][1] = row->bin_high[1];
        t->bins[t->n][2] = row->bin_count[1];
    }
    t->rows[t->n++] = *row;
    return 0;
}

static void test_timing_rows_come_back_with_their_buckets(void **state)
{
    const int64_t low[2] = {-5, 10}, high[2] = {10, 20}, count[2] = {3, 4};
    const struct apc_timing_row in[2] = {
        {.time = 5000,
         .task = "controller",
         .quantity = "jitter",
         .period = 2000000000,
         .missed = 1,
         .count = 7,
         .mean = -0.25,
         .sd = 1.5,
         .p50 = -3,
         .p99 = 15,
         .max = 19,
         .bin_low = low,
         .bin_high = high,
         .bin_count = count,
         .n_bins = 2},
        {.time = 4000, .task = "client", .quantity = "run"},
    };
    assert_int_equal(apc_store_append_timing(*state, in, 2), 2);
    struct timings t = {0};
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 2);
    assert_string_equal(t.rows[0].task, "client"); /* by time */
    assert_int_equal(t.rows[0].n_bins, 0);
    assert_string_equal(t.rows[1].quantity, "jitter");
    assert_true(t.rows[1].period == 2000000000 && t.rows[1].missed == 1 && t.rows[1].count == 7);
    assert_true(t.rows[1].p50 == -3 && t.rows[1].p99 == 15 && t.rows[1].max == 19);
    assert_near(t.rows[1].mean, -0.25, 0);
    assert_near(t.rows[1].sd, 1.5, 0);
    assert_true(t.bins[1][0] == 10 && t.bins[1][1] == 20 && t.bins[1][2] == 4);
    struct timings newest_one = {0};
    assert_int_equal(apc_store_timing(*state, &(struct apc_range){.last = 1}, keep_timing, &newest_one), 1);
    assert_string_equal(newest_one.rows[0].task, "controller");
}

static void test_a_timing_row_is_of_a_task_s_quantity_or_refused_with_all_the_others(void **state)
{
    const int64_t edge[1] = {1};
    const struct apc_timing_row
        good = {.time = 1000, .task = "t", .quantity = "lateness", .period = 1},
        bad[] = {
            {.task = "t", .quantity = "speed"},
            {.task = "t", .quantity = "latenes"},
            {.task = "t", .quantity = ""},
            {.task = "t", .quantity = "run", .period = -1},
            {.task = "t", .quantity = "run", .mean = (double)NAN},
            {.task = "t", .quantity = "run", .sd = HUGE_VAL},
            {.task = "t", .quantity = "run", .missed = UINT64_MAX},
            {.task = "t", .quantity = "run", .count = UINT64_MAX},
            {.task = "t", .quantity = "run", .missed = (uint64_t)INT64_MAX + 1},
            {.task = "t", .quantity = "run", .count = (uint64_t)INT64_MAX + 1},
            {.task = "t", .quantity = "run", .n_bins = 1},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_high = edge, .bin_count = edge},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_low = edge, .bin_count = edge},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_low = edge, .bin_high = edge},
        };
    struct timings t = {0};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        for (int at = 0; at < 3; at++) {
            struct apc_timing_row rows[3] = {good, good, good};
            rows[at] = bad[i];
            assert_true(apc_store_append_timing(*state, rows, 3) < 0);
            assert_true(apc_store_append_timing(*state, rows + at, 1) < 0);
        }
    }
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 0);
    assert_int_equal(apc_store_append_timing(*state, &good, 1), 1);
    const struct apc_timing_row most = {
        .task = "t", .quantity = "run", .missed = INT64_MAX, .count = INT64_MAX};
    assert_int_equal(apc_store_append_timing(*state, &most, 1), 1);
    assert_int_equal(apc_store_append_timing(*state, NULL, 0), 0);
    assert_int_equal(apc_store_append_timing(*state, NULL, 1), APC_EINVAL);
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 2);
    assert_true(t.rows[0].missed == INT64_MAX && t.rows[0].count == INT64_MAX); /* by time */
    assert_string_equal(t.rows[1].quantity, "lateness");
    assert_int_equal(t.rows[1].period, 1);
}

/* Row i of time i * 7 % N, but the last, which is of the same time as the one before it; i % 4 buckets. */
enum { TIMINGS = 150 };

static int timing_number(apc_ns time)
{
    for (int i = 0; i < TIMINGS - 1; i++) {
        if (i * 7 % TIMINGS == time / 1000) {
            return i;
        }
    }
    return -1;
}

struct walk {
    apc_ns last;
    int given, most, twins;
};

static int check_timing(void *ctx, const struct apc_timing_row *row)
{
    struct walk *w = ctx;
    const bool twin = w->given > 0 && row->time == w->last;
    const int i = twin ? TIMINGS - 1 : timing_number(row->time);
    assert_true(w->given == 0 || row->time >= w->last);
    w->last = row->time;
    w->twins += twin;
    assert_int_equal(row->count, i); /* of two of one time the one that came first is first */
    assert_int_equal(row->n_bins, i % 4);
    for (int b = 0; b < i % 4; b++) {
        assert_true(row->bin_low[b] == 10 * b + i && row->bin_high[b] == 10 * b + i + 9 &&
                    row->bin_count[b] == b + 1);
    }
    return ++w->given == w->most;
}

static void test_timing_rows_come_in_order_of_time_within_their_bounds(void **state)
{
    static int64_t low[TIMINGS][4], high[TIMINGS][4];
    static const int64_t count[4] = {1, 2, 3, 4};
    static struct apc_timing_row rows[TIMINGS];
    for (int i = 0; i < TIMINGS; i++) {
        for (int b = 0; b < 4; b++) {
            low[i][b] = 10 * b + i;
            high[i][b] = low[i][b] + 9;
        }
        const int k = i < TIMINGS - 1 ? i : i - 1;
        rows[i] = (struct apc_timing_row){.time = k * 7 % TIMINGS * 1000,
                                          .task = "t",
                                          .quantity = "run",
                                          .count = (uint64_t)i,
                                          .bin_low = low[i],
                                          .bin_high = high[i],
                                          .bin_count = count,
                                          .n_bins = (size_t)(i % 4)};
    }
    assert_int_equal(apc_store_append_timing(*state, rows, 40), 40);
    assert_int_equal(apc_store_append_timing(*state, rows + 40, TIMINGS - 40), TIMINGS - 40);
    struct walk w = {0};
    assert_int_equal(apc_store_timing(*state, NULL, check_timing, &w), TIMINGS);
    assert_int_equal(w.twins, 1);
    const struct {
        struct apc_range range;
        int given;
        apc_ns last;
    } cases[] = {
        {{.since = 5000, .until = 9000}, 4, 8000},
        {{.until = 9000, .last = 2}, 2, 8000},
        {{.since = 140000, .last = 99}, 9, 149000},
        {{.since = 150000}, 0, 0},
        {{.last = 1}, 1, 149000},
        {{.last = TIMINGS + 1}, TIMINGS, 149000},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        w = (struct walk){0};
        assert_int_equal(apc_store_timing(*state, &cases[i].range, check_timing, &w), cases[i].given);
        assert_int_equal(w.given, cases[i].given);
        assert_int_equal(w.last, cases[i].last);
    }
    w = (struct walk){.most = 3};
    assert_int_equal(apc_store_timing(*state, NULL, check_timing, &w), 3);
    assert_int_equal(w.given, 3);
}

/* ---- Housekeeping ------------------------------------------------------------------------------ */

#define HOUR (3600 * APC_NS_PER_S)

static int count_event(void *ctx, const struct apc_event *e)
{
    (void)e;
    ++*(int *)ctx;
    return 0;
}

static int keep_one_event(void *ctx, const struct apc_event *e)
{
    *(struct apc_event *)ctx = *e;
    return 0;
}

static int count_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)row;
    ++*(int *)ctx;
    return 0;
}

/* A store that drops in larger pieces counts those. */
static void assert_dropped(int dropped, int rows)
{
    if (strncmp(store_uri, "postgres", 8) == 0) {
        assert_in_range(dropped, 1, rows);
    } else {
        assert_int_equal(dropped, rows);
    }
}

static int count_from(void *ctx, const struct apc_sample *s)
{
    assert_int_equal(s->seq, ++*(int64_t *)ctx);
    return 0;
}

/* More than any store keeps in one place: blocks, batches, extents. */
static void test_maintenance_goes_through_a_long_history(void **state)
{
    struct apc_store *store = *state;
    enum { OLD = 700, N = 1300, VARIABLES = 3 };
    const apc_ns now = apc_clock_utc(NULL) / 1000 * 1000;
    static struct apc_sample s[N];
    for (int id = 1; id <= VARIABLES; id++) {
        for (int i = 0; i < N; i++) {
            s[i] = sample(APC_SENSOR, id, i + 1, i);
            s[i].time = i < OLD ? i * APC_NS_PER_S : now + (i - N) * APC_NS_PER_MS;
        }
        assert_int_equal(apc_store_append(store, s, N), N);
    }
    const struct apc_retention keep = {.size = sizeof keep, .samples = 24 * HOUR};
    assert_dropped(apc_store_maintain(store, &keep), VARIABLES * OLD);
    for (int id = 1; id <= VARIABLES; id++) {
        int64_t last = OLD, late = N - 10;
        assert_int_equal(apc_store_history(store, APC_SENSOR, id, NULL, count_from, &last), N - OLD);
        assert_int_equal(
            apc_store_history(store, APC_SENSOR, id, &(struct apc_range){.last = 10}, count_from, &late), 10);
        assert_int_equal(newest(store, APC_SENSOR, id).seq, N);
    }
    assert_int_equal(apc_store_maintain(store, &keep), 0);
}

/* Promise(stores/stores-suite) */
static void test_maintenance_drops_what_is_old_and_keeps_the_newest_of_each_variable(void **state)
{
    struct apc_store *store = *state;
    const apc_ns now = apc_clock_utc(NULL), times[4] = {0, 1, now - HOUR, now};
    struct apc_sample s[12];
    for (int i = 0; i < 12; i++) {
        s[i] = sample(i % 2 ? APC_SENSOR : APC_TUNING, 1 + i / 8, 1 + i / 2 % 4, i);
        s[i].time = times[i / 2 % 4];
    }
    /* Variable 1 of each table: two from 1970, two of today; variable 2: the two from 1970 only. */
    assert_int_equal(apc_store_append(store, s, 12), 12);
    const struct apc_event events[2] = {{.time = 0, .severity = APC_EVENT_INFO, .kind = "start"},
                                        {.time = now, .severity = APC_EVENT_INFO, .kind = "stop"}};
    assert_int_equal(apc_store_append_events(store, events, 2), 2);
    const struct apc_timing_row rows[2] = {{.time = 0, .task = "t", .quantity = "run"},
                                           {.time = now, .task = "t", .quantity = "run"}};
    assert_int_equal(apc_store_append_timing(store, rows, 2), 2);

    assert_int_equal(apc_store_maintain(store, NULL), 0);
    assert_int_equal(rows_of(store, APC_SENSOR, 1), 4);
    struct apc_retention keep = {.size = sizeof keep, .samples = 24 * HOUR};
    assert_dropped(apc_store_maintain(store, &keep), 6);
    const enum apc_table tables[2] = {APC_TUNING, APC_SENSOR};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(rows_of(store, tables[i], 1), 2);
        assert_int_equal(rows_of(store, tables[i], 2), 1);
        struct apc_sample recent = newest(store, tables[i], 1), ancient = newest(store, tables[i], 2);
        assert_true(recent.seq == 4 && recent.time / 1000 == now / 1000);
        assert_true(ancient.seq == 2 && ancient.time / 1000 == 0);
        assert_near(ancient.value, 10 + i, 0);
    }
    int n = 0;
    assert_int_equal(apc_store_events(store, NULL, count_event, &n), 2); /* not asked for */
    keep = (struct apc_retention){.size = sizeof keep, .events = 24 * HOUR, .timing = 24 * HOUR};
    assert_dropped(apc_store_maintain(store, &keep), 2);
    struct apc_event left;
    assert_int_equal(apc_store_events(store, NULL, keep_one_event, &left), 1);
    assert_string_equal(left.kind, "stop");
    assert_int_equal(apc_store_timing(store, NULL, count_timing, &n), 1);
    assert_int_equal(apc_store_maintain(store, &keep), 0);          /* there is nothing left to do */
    assert_int_equal(apc_store_append_events(store, events, 1), 1); /* old, but it has just come */
    assert_int_equal(apc_store_events(store, &(struct apc_range){.last = 1}, keep_one_event, &left), 1);
    assert_string_equal(left.kind, "start");

    int64_t last[2];
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last)); /* writers count on */
    assert_true(last[0] == 4 && last[1] == 2);
    struct apc_sample next = sample(APC_SENSOR, 2, 3, 1);
    assert_int_equal(apc_store_append(store, &next, 1), 1);
    keep.events = -1;
    assert_int_equal(apc_store_maintain(store, &keep), APC_EINVAL);
}

static void test_samples_of_any_time_are_kept_before_and_after_maintenance(void **state)
{
    const apc_ns now = apc_clock_utc(NULL), year = 366 * 24 * HOUR;
    const apc_ns times[] = {now + 200 * year, now - 50 * year, now + year, -year, now,
                            now - year,       now + HOUR};
    enum { N = sizeof times / sizeof times[0] };
    for (int round = 0; round < 3; round++) {
        for (int i = 0; i < N; i++) {
            struct apc_sample s = sample(APC_SENSOR, 1, round * N + i + 1, i);
            s.time = times[i];
            assert_int_equal(apc_store_append(*state, &s, 1), 1);
            assert_int_equal(apc_store_append(*state, &s, 1), 0); /* once, wherever it is kept */
            s.time = now;
            assert_int_equal(apc_store_append(*state, &s, 1), 0); /* and whatever its time is */
        }
        assert_int_equal(rows_of(*state, APC_SENSOR, 1), (round + 1) * N);
        assert_int_equal(apc_store_maintain(*state, NULL), 0);
        assert_int_equal(rows_of(*state, APC_SENSOR, 1), (round + 1) * N);
        assert_int_equal(newest(*state, APC_SENSOR, 1).seq, (round + 1) * N);
    }
}

/* ---- Set-up, text ------------------------------------------------------------------------------ */

static void test_init_again_changes_nothing(void **state)
{
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(*state, &s, 1), 1);
    assert_int_equal(apc_store_init(*state), apc_store_version());
    assert_int_equal(newest(*state, APC_SENSOR, 1).seq, 1);
}

static void test_counters_and_connected_tell_the_truth(void **state)
{
    struct apc_store *store = stores_open();
    struct apc_store_stats before = {.size = sizeof before}, after = before;
    assert_false(apc_store_connected(store));
    ok(store, apc_store_connect(store));
    assert_true(apc_store_connected(store));
    apc_store_stats(store, &before);
    assert_int_equal(before.connects, 1);
    newest(store, APC_SENSOR, 1);
    newest(store, APC_SENSOR, 1);
    apc_store_stats(store, &after);
    assert_int_equal(after.connects, 1);
    assert_int_equal(after.round_trips - before.round_trips, 2);
    apc_store_close(store);
    apc_store_close(NULL);
    (void)state;
}

static int stop_sample(void *ctx, const struct apc_sample *s)
{
    (void)ctx;
    (void)s;
    return 1;
}

static int stop_bin(void *ctx, const struct apc_history_bin *bin)
{
    (void)ctx;
    (void)bin;
    return 1;
}

#define counts(store, call)                                                                                  \
    do {                                                                                                     \
        struct apc_store_stats counted = {.size = sizeof counted}, now = counted;                            \
        apc_store_stats(store, &counted);                                                                    \
        ok(store, call);                                                                                     \
        apc_store_stats(store, &now);                                                                        \
        if (now.round_trips <= counted.round_trips || now.connects != counted.connects) {                    \
            fail_msg("%s: %d round trips, %d connects more", #call,                                          \
                     (int)(now.round_trips - counted.round_trips), (int)(now.connects - counted.connects));  \
        }                                                                                                    \
    } while (0)

static void test_an_empty_store_is_empty_and_no_error(void **state)
{
    struct apc_store *store = *state;
    const struct apc_retention keep = {.size = sizeof keep, .samples = 1, .events = 1, .timing = 1};
    struct apc_sample s[1];
    struct apc_tag tags[1];
    int64_t last[1] = {7};
    int n = 0;
    assert_int_equal(apc_store_variables(store, s, 1), 0);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, stop_sample, NULL), 0);
    assert_int_equal(apc_store_history_bins(store, APC_SENSOR, 1, 0, HOUR, 2, stop_bin, NULL), 0);
    assert_int_equal(apc_store_get_tags(store, tags, 1), 0);
    assert_int_equal(apc_store_events(store, NULL, count_event, &n), 0);
    assert_int_equal(apc_store_timing(store, NULL, count_timing, &n), 0);
    assert_int_equal(apc_store_maintain(store, &keep), 0);
    assert_int_equal(apc_store_put_tags(store, NULL, 0), 0);
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    assert_int_equal(last[0], 0);
}

static void test_each_operation_is_counted(void **state)
{
    struct apc_store *store = *state;
    struct apc_sample s = sample(APC_TUNING, 1, 1, 1);
    const struct apc_event event = {.severity = APC_EVENT_INFO};
    const struct apc_timing_row row = {.quantity = "run"};
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    const struct apc_retention keep = {.size = sizeof keep, .samples = HOUR, .events = HOUR, .timing = HOUR};
    struct apc_tag tags[1];
    char name[APC_AUTHOR_LEN];
    int64_t last[1];
    int n = 0;
    newest(store, APC_TUNING, 1); /* connected */
    counts(store, apc_store_append(store, &s, 1));
    counts(store, apc_store_put(store, &s, 1));
    counts(store, apc_store_swap(store, &s, 1));
    if (strncmp(store_uri, "postgres", 8) != 0) { /* where a notification says it */
        counts(store, apc_store_wait(store, &s, 1, 0));
    }
    counts(store, apc_store_claim(store, APC_SENSOR, 1, last));
    counts(store, apc_store_variables(store, &s, 1));
    counts(store, apc_store_history(store, APC_TUNING, 1, NULL, stop_sample, NULL));
    counts(store, apc_store_history_bins(store, APC_TUNING, 1, 0, HOUR, 2, stop_bin, NULL));
    counts(store, apc_store_put_tags(store, &tag, 1));
    counts(store, apc_store_get_tags(store, tags, 1));
    counts(store, apc_store_describe(store, &tag, 1, "text"));
    counts(store, apc_store_catalogue(store, NULL, 0, NULL));
    counts(store, apc_store_author(store, "anna"));
    counts(store, apc_store_author_name(store, 1, name));
    counts(store, apc_store_append_events(store, &event, 1));
    counts(store, apc_store_events(store, NULL, count_event, &n));
    counts(store, apc_store_append_timing(store, &row, 1));
    counts(store, apc_store_timing(store, NULL, count_timing, &n));
    counts(store, apc_store_maintain(store, &keep));
}

/* Promise(run/numbers-frames-csv) */
static void test_a_comma_locale_changes_no_value(void **state)
{
    if (!comma_locale()) {
        skip();
    }
    char text[16];
    snprintf(text, sizeof text, "%.1f", 0.5);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 3.75);
    int appended = apc_store_append(*state, &s, 1);
    struct apc_sample out = {.table = APC_SENSOR, .id = 1};
    int err = apc_store_read(*state, &out, 1);
    setlocale(LC_ALL, "C");
    assert_string_equal(text, "0,5"); /* it was in force */
    assert_int_equal(appended, 1);
    assert_int_equal(err, 0);
    assert_near(out.value, 3.75, 0);
}

static void test_options_of_a_newer_library_are_refused(void **state)
{
    struct {
        struct apc_store_options options;
        int unknown;
    } newer = {.options = {.size = sizeof newer}, .unknown = 1};
    struct apc_store *store = (struct apc_store *)state;
    assert_int_equal(apc_store_open(&store, store_uri, &newer.options, NULL), APC_EINVAL);
    assert_null(store);
    newer.unknown = 0;
    assert_int_equal(apc_store_open(&store, store_uri, &newer.options, NULL), 0);
    apc_store_close(store);
    newer.options.size = 0;
    assert_int_equal(apc_store_open(&store, store_uri, &newer.options, NULL), APC_EINVAL);
    newer.options = (struct apc_store_options){.size = sizeof newer.options, .timeout = -1};
    assert_int_equal(apc_store_open(&store, store_uri, &newer.options, NULL), APC_EINVAL);
}

#define T(name) cmocka_unit_test_setup_teardown(name, stores_set_up, stores_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_variable_without_samples_reads_as_no_data),
        T(test_every_member_of_a_sample_comes_back),
        T(test_values_of_every_size_come_back_bit_for_bit),
        T(test_what_is_no_value_is_refused_and_nothing_is_written),
        T(test_arguments_that_make_no_sense_are_refused),
        T(test_a_put_of_many_values_names_each_variable_once),
        T(test_samples_of_mixed_tables_in_any_order_are_kept_apart),
        T(test_the_same_variable_may_be_read_twice_at_once),
        T(test_an_append_repeated_changes_nothing_and_counts_nothing),
        T(test_a_foreign_row_at_the_next_seq_makes_the_count_short_and_keeps_no_other_out),
        T(test_a_seq_that_leaves_no_room_to_count_on_is_refused),
        T(test_an_append_larger_than_any_buffer_is_still_one),
        T(test_one_bad_row_keeps_the_whole_append_out),
        T(test_newest_is_the_highest_seq_when_the_clock_steps_back),
        T(test_times_before_1970_are_kept),
        T(test_two_plants_in_one_database_do_not_see_each_other),
        T(test_a_claim_gives_the_newest_seq_of_each_id),
        T(test_a_second_writer_is_refused_by_name_until_the_first_has_gone),
        T(test_put_takes_the_next_seq),
        T(test_a_put_is_all_or_nothing),
        T(test_concurrent_puts_lose_and_double_nothing),
        T(test_a_swap_takes_the_next_seq_when_the_newest_is_the_one_expected),
        T(test_a_swap_that_is_too_late_writes_nothing_and_shows_what_is_newest),
        T(test_a_swap_into_a_gap_of_the_history_is_too_late_as_well),
        T(test_a_swap_that_makes_no_sense_is_refused),
        T(test_concurrent_swaps_lose_and_double_nothing),
        T(test_a_wait_tells_what_is_there_already_and_what_is_not),
        T(test_a_wait_sees_every_way_of_writing),
        T(test_two_waiters_wake_each_other_and_miss_nothing),
        T(test_history_comes_in_rising_seq_within_its_bounds),
        T(test_samples_of_one_time_are_all_kept),
        T(test_history_ends_when_its_function_says_so),
        T(test_a_store_refuses_to_be_used_from_inside_its_history),
        T(test_nor_from_inside_any_other_stream),
        T(test_rows_that_the_store_refuses_are_as_they_were),
        T(test_a_name_is_found_twice_wherever_it_stands),
        T(test_a_history_names_what_a_row_comes_from),
        T(test_variables_are_those_that_have_samples),
        T(test_a_bin_holds_what_lies_within_it),
        T(test_bins_divide_what_cannot_be_divided_evenly),
        T(test_a_bin_may_be_all_of_time_and_there_may_be_as_many_as_allowed),
        T(test_bins_end_when_their_function_says_so_and_refuse_what_makes_no_sense),
        T(test_tags_come_back_in_order),
        T(test_tags_are_replaced_as_a_whole_and_may_change_names),
        T(test_the_catalogue_comes_with_the_tags_and_each_text_is_a_revision),
        T(test_a_catalogue_of_many_bytes_is_whole_or_refused),
        T(test_an_author_has_a_number_that_stays),
        T(test_events_come_back_in_order),
        T(test_a_text_keeps_its_characters_and_no_other_byte),
        T(test_names_are_one_line_that_shows_as_it_is),
        T(test_timing_rows_come_back_with_their_buckets),
        T(test_a_timing_row_is_of_a_task_s_quantity_or_refused_with_all_the_others),
        T(test_timing_rows_come_in_order_of_time_within_their_bounds),
        T(test_maintenance_drops_what_is_old_and_keeps_the_newest_of_each_variable),
        T(test_maintenance_goes_through_a_long_history),
        T(test_samples_of_any_time_are_kept_before_and_after_maintenance),
        T(test_init_again_changes_nothing),
        T(test_counters_and_connected_tell_the_truth),
        T(test_an_empty_store_is_empty_and_no_error),
        T(test_each_operation_is_counted),
        T(test_a_comma_locale_changes_no_value),
        T(test_options_of_a_newer_library_are_refused),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
