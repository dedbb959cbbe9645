/* SPDX-License-Identifier: BSD-3-Clause */
/* What every store must do. A new store joins by a line in tests/support/stores.c. */
#include <locale.h>
#include <pthread.h>
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
