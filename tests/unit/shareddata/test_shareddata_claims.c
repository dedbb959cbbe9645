/* SPDX-License-Identifier: BSD-3-Clause */
/* Claims on sets of variables: what every store must do. */
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "stores.h"

static struct apc_sample variable(enum apc_table table, int id)
{
    return (struct apc_sample){.table = table, .id = id, .seq = -1};
}

static int claim_one(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_sample v = variable(table, id);
    return apc_store_claim_set(store, &v, 1);
}

static int release_one(struct apc_store *store, enum apc_table table, int id)
{
    const struct apc_sample v = variable(table, id);
    return apc_store_release(store, &v, 1);
}

/* A server frees a claim as soon as it has ended the session. */
static int claim_soon(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    int err = APC_EBUSY;
    for (int tries = 0; err == APC_EBUSY && tries < 1000; tries++) {
        err = apc_store_claim_set(store, variables, n);
        usleep(err == APC_EBUSY ? 10000 : 0);
    }
    return err;
}

static void test_a_claim_gives_the_newest_seq_of_each_variable(void **state)
{
    double value[1] = {1};
    struct apc_sample s[2] = {sample(APC_ACTUATOR, 3, 17, 1), sample(APC_SETPOINT, 2, APC_SEQ_ANY, 1)};
    struct apc_vector t = {.table = APC_TICK, .id = 9, .seq = 5, .n = 1, .value = value};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = s, .n_samples = 2, .vector = &t, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(*state, &rows), 3);
    struct apc_sample v[5] = {variable(APC_TICK, 9), variable(APC_ACTUATOR, 3), variable(APC_ACTUATOR, 1),
                              variable(APC_SETPOINT, 2), variable(APC_ACTUAL, 0)};
    ok(*state, apc_store_claim_set(*state, v, 5));
    assert_true(v[0].seq == 5 && v[1].seq == 17 && v[2].seq == 0 && v[3].seq == 1 && v[4].seq == 0);
    ok(*state, apc_store_claim_set(*state, v, 5)); /* it is ours already */
    assert_true(v[0].seq == 5 && v[0].table == APC_TICK && v[0].id == 9);
}

static void test_two_writers_share_a_table_but_no_variable(void **state)
{
    struct apc_store *second = stores_open();
    struct apc_sample mine[2] = {variable(APC_ACTUATOR, 1), variable(APC_TICK, 1)},
                      theirs[2] = {variable(APC_ACTUATOR, 2), variable(APC_TICK, 2)};
    ok(*state, apc_store_claim_set(*state, mine, 2));
    ok(second, apc_store_claim_set(second, theirs, 2));
    assert_int_equal(claim_one(second, APC_ACTUATOR, 1), APC_EBUSY);
    assert_int_equal(claim_one(*state, APC_TICK, 2), APC_EBUSY);
    apc_store_close(second);
    ok(*state, claim_soon(*state, theirs, 2));
}

/* Promise(stores/claim-set-variables) */
static void test_a_refusal_names_the_variable_and_the_holder(void **state)
{
    struct apc_store *second = stores_open();
    ok(*state, claim_one(*state, APC_ACTUATOR, 2));
    struct apc_sample v[2] = {variable(APC_ESTIMATE, 7), variable(APC_ACTUATOR, 2)};
    assert_int_equal(apc_store_claim_set(second, v, 2), APC_EBUSY);
    assert_non_null(strstr(apc_store_error(second), "actuator 2"));
    assert_non_null(strstr(apc_store_error(second), "already written by test"));
    apc_store_close(second);
}

/*
 * Promise(stores/claim-set-variables): A claim is of a set of variables, all or none; who is refused is
 *   told the variable and the holder.
 */
static void test_all_are_claimed_or_none(void **state)
{
    struct apc_store *second = stores_open(), *third = stores_open();
    ok(*state, claim_one(*state, APC_ACTUATOR, 2));
    struct apc_sample v[3] = {variable(APC_ACTUATOR, 1), variable(APC_ACTUATOR, 2), variable(APC_ACTUAL, 4)};
    assert_int_equal(apc_store_claim_set(second, v, 3), APC_EBUSY);
    ok(third, claim_one(third, APC_ACTUAL, 4));
    ok(third, claim_one(third, APC_ACTUATOR, 1));
    apc_store_close(second);
    apc_store_close(third);
}

static void test_what_is_released_may_be_claimed_by_another(void **state)
{
    struct apc_store *second = stores_open();
    struct apc_sample v[2] = {variable(APC_ACTUATOR, 1), variable(APC_PLAN, 1)};
    ok(*state, apc_store_claim_set(*state, v, 2));
    ok(second, release_one(second, APC_PLAN, 1)); /* not theirs: nothing happens */
    assert_int_equal(claim_one(second, APC_PLAN, 1), APC_EBUSY);
    ok(*state, release_one(*state, APC_PLAN, 1));
    ok(second, claim_one(second, APC_PLAN, 1));
    assert_int_equal(claim_one(*state, APC_PLAN, 1), APC_EBUSY);
    assert_int_equal(claim_one(second, APC_ACTUATOR, 1), APC_EBUSY); /* the rest is ours still */
    ok(second, release_one(second, APC_PLAN, 1));
    ok(*state, claim_one(*state, APC_PLAN, 1));
    apc_store_close(second);
}

static void test_people_write_what_a_program_has_claimed(void **state)
{
    struct apc_store *second = stores_open();
    ok(*state, claim_one(*state, APC_SETPOINT, 1));
    struct apc_sample s = sample(APC_SETPOINT, 1, 0, 5);
    ok(second, apc_store_put(second, &s, 1));
    assert_int_equal(s.seq, 1);
    apc_store_close(second);
}

static void test_a_claim_that_makes_no_sense_is_refused(void **state)
{
    assert_int_equal(claim_one(*state, APC_TABLE_END, 1), APC_EINVAL);
    assert_int_equal(claim_one(*state, APC_SENSOR, -1), APC_EINVAL);
    assert_int_equal(apc_store_claim_set(*state, NULL, 1), APC_EINVAL);
    assert_int_equal(release_one(*state, APC_TABLE_END, 1), APC_EINVAL);
    assert_int_equal(apc_store_claim_set(*state, NULL, 0), 0);
    assert_int_equal(apc_store_release(*state, NULL, 0), 0);
}

/* Does this kind of store number its claims? */
static bool numbered(void)
{
    return strncmp(store_kind->name, "shm", 3) == 0 || strncmp(store_kind->name, "postgresql", 10) == 0;
}

static uint64_t holder_of(struct apc_store *store, enum apc_table table, int id)
{
    const struct apc_sample v = variable(table, id);
    uint64_t holder = 1;
    ok(store, apc_store_holder(store, &v, &holder));
    return holder;
}

static void test_a_store_says_whether_it_numbers_claims(void **state)
{
    struct apc_sample v = variable(APC_ACTUATOR, 1);
    uint64_t holder = 7;
    const int expected = numbered() ? 0 : APC_EINVAL;
    assert_int_equal(apc_store_holder(*state, &v, &holder), expected);
    assert_int_equal(apc_store_seize(*state, &v, 1, 0), expected);
    assert_true(numbered() || strstr(apc_store_error(*state), "numbers no claims"));
    assert_int_equal(apc_store_holder(*state, &v, NULL), APC_EINVAL);
    assert_int_equal(apc_store_holder(*state, NULL, &holder), APC_EINVAL);
    v.table = APC_TABLE_END;
    assert_int_equal(apc_store_seize(*state, &v, 1, 0), APC_EINVAL);
}

static void test_each_claim_has_a_greater_number(void **state)
{
    if (!numbered()) {
        return;
    }
    assert_int_equal(holder_of(*state, APC_ACTUATOR, 1), 0);
    ok(*state, claim_one(*state, APC_ACTUATOR, 1));
    const uint64_t first = holder_of(*state, APC_ACTUATOR, 1);
    assert_true(first > 0);
    ok(*state, claim_one(*state, APC_TICK, 1)); /* the same claimant's */
    assert_true(holder_of(*state, APC_TICK, 1) == first);
    struct apc_store *second = stores_open();
    ok(second, claim_one(second, APC_ACTUATOR, 2));
    assert_true(holder_of(*state, APC_ACTUATOR, 2) > first);
    assert_true(holder_of(second, APC_ACTUATOR, 1) == first);
    apc_store_close(second);
    ok(*state, release_one(*state, APC_ACTUATOR, 1));
    assert_int_equal(holder_of(*state, APC_ACTUATOR, 1), 0);
}

/* A writer's commands are told by it from those of writers before, also where he came first and was refused. */
/* Promise(modes/client-slept-took) */
static void test_the_number_of_a_claim_is_that_of_its_taking(void **state)
{
    struct apc_store *second = stores_open(), *third = stores_open();
    assert_true(apc_store_claimed(*state) == 0);
    ok(*state, claim_one(*state, APC_SENSOR, 1));
    const uint64_t first = apc_store_claimed(*state);
    assert_int_equal(first > 0, numbered());
    assert_int_equal(claim_one(second, APC_SENSOR, 1), APC_EBUSY);
    ok(*state, release_one(*state, APC_SENSOR, 1));
    ok(third, claim_one(third, APC_SENSOR, 1));
    const uint64_t its = apc_store_claimed(third);
    ok(third, release_one(third, APC_SENSOR, 1));
    ok(second, claim_one(second, APC_SENSOR, 1));
    if (numbered()) {
        assert_true(its > first && apc_store_claimed(second) > its);
    }
    apc_store_close(second);
    apc_store_close(third);
}

static int append_one(struct apc_store *store, enum apc_table table, int id, int64_t seq)
{
    const struct apc_sample s = sample(table, id, seq, (double)seq);
    int stored = APC_ECONN;
    for (int tries = 0; stored == APC_ECONN && tries < 1000; tries++) { /* a session that was ended */
        stored = apc_store_append(store, &s, 1);
        usleep(stored == APC_ECONN ? 10000 : 0);
    }
    return stored;
}

/* Promise(modes/process-stands-takes) */
static void test_who_lives_is_fenced_by_who_seizes(void **state)
{
    if (!numbered()) {
        return;
    }
    struct apc_store *second = stores_open();
    struct apc_sample mine[2] = {variable(APC_ACTUATOR, 1), variable(APC_TICK, 1)};
    ok(*state, apc_store_claim_set(*state, mine, 2));
    assert_int_equal(append_one(*state, APC_ACTUATOR, 1, 4), 1);
    const uint64_t first = holder_of(second, APC_ACTUATOR, 1);

    ok(second, apc_store_seize(second, mine, 1, first));
    assert_true(mine[0].seq == 4);
    assert_true(holder_of(second, APC_ACTUATOR, 1) > first);
    assert_int_equal(holder_of(second, APC_TICK, 1), 0); /* all that he had is free */
    assert_int_equal(append_one(*state, APC_ACTUATOR, 1, 5), APC_EBUSY);
    assert_int_equal(append_one(*state, APC_ACTUATOR, 3, 1), APC_EBUSY); /* not even what nobody has */
    assert_int_equal(append_one(second, APC_ACTUATOR, 1, 5), 1);
    assert_int_equal(claim_one(*state, APC_ACTUATOR, 1), APC_EBUSY); /* he begins anew */
    ok(*state, apc_store_release(*state, mine, 2));
    ok(*state, claim_one(*state, APC_ACTUATOR, 3));
    assert_int_equal(append_one(*state, APC_ACTUATOR, 3, 1), 1);
    apc_store_close(second);
}

/* Promise(modes/process-stands-takes) */
static void test_only_the_claim_that_was_seen_is_seized(void **state)
{
    if (!numbered()) {
        return;
    }
    struct apc_store *second = stores_open(), *third = stores_open();
    struct apc_sample v[2] = {variable(APC_ACTUATOR, 1), variable(APC_ACTUATOR, 2)};
    ok(*state, claim_one(*state, APC_ACTUATOR, 1));
    const uint64_t first = holder_of(second, APC_ACTUATOR, 1);
    ok(second, apc_store_seize(second, v, 1, first));
    assert_int_equal(apc_store_seize(third, v, 1, first), APC_EBUSY); /* another was faster */
    assert_int_equal(apc_store_seize(third, v, 1, 0), APC_EBUSY);

    ok(third, claim_one(third, APC_ACTUATOR, 2));
    const uint64_t now = holder_of(third, APC_ACTUATOR, 1);
    assert_int_equal(append_one(second, APC_ACTUATOR, 1, 1), 1);
    assert_true(now > first && holder_of(third, APC_ACTUATOR, 2) > 0);
    apc_store_close(second);
    apc_store_close(third);
}

enum { RIVALS = 4, TURNS = 25 };
static atomic_int holders, turns;

/* Takes and gives back the same set again and again. Returns what went wrong. */
static void *compete(void *unused)
{
    const char *wrong = NULL;
    struct apc_store *store = stores_open();
    struct apc_sample v[2] = {variable(APC_ACTUATOR, 1), variable(APC_TICK, 1)};
    (void)unused;
    while (!wrong && atomic_load(&turns) < RIVALS * TURNS) {
        int err = apc_store_claim_set(store, v, 2);
        if (err == 0) {
            wrong = atomic_fetch_add(&holders, 1) == 0 ? NULL : "two have it";
            atomic_fetch_sub(&holders, 1);
            atomic_fetch_add(&turns, 1);
            wrong = apc_store_release(store, v, 2) == 0 ? wrong : "not released";
        } else if (err != APC_EBUSY) {
            wrong = "neither claimed nor busy";
        }
    }
    apc_store_close(store);
    return (void *)(uintptr_t)wrong;
}

/* Promise(stores/claim-set-variables) */
static void test_of_rivals_one_at_a_time_has_it(void **state)
{
    pthread_t thread[RIVALS];
    (void)state;
    atomic_store(&turns, 0);
    for (int i = 0; i < RIVALS; i++) {
        assert_int_equal(pthread_create(&thread[i], NULL, compete, NULL), 0);
    }
    for (int i = 0; i < RIVALS; i++) {
        void *wrong = NULL;
        assert_int_equal(pthread_join(thread[i], &wrong), 0);
        if (wrong) {
            fail_msg("%s", (const char *)wrong);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_claim_gives_the_newest_seq_of_each_variable),
        T(test_two_writers_share_a_table_but_no_variable),
        T(test_a_refusal_names_the_variable_and_the_holder),
        T(test_all_are_claimed_or_none),
        T(test_what_is_released_may_be_claimed_by_another),
        T(test_people_write_what_a_program_has_claimed),
        T(test_a_claim_that_makes_no_sense_is_refused),
        T(test_a_store_says_whether_it_numbers_claims),
        T(test_each_claim_has_a_greater_number),
        T(test_the_number_of_a_claim_is_that_of_its_taking),
        T(test_who_lives_is_fenced_by_who_seizes),
        T(test_only_the_claim_that_was_seen_is_seized),
        T(test_of_rivals_one_at_a_time_has_it),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
