/* SPDX-License-Identifier: BSD-3-Clause */
/* What is written along with what an operator writes to a loop under another one. */
#include <stdlib.h>

#include "experiment/experiment.h"
#include "operate/operate.h"
#include "shareddata/shareddata_internal.h"
#include "stores.h"

/* v1 and v2 of base; upper.r1 moves the setpoint of v1. */
static struct loops_controller controllers[] = {{.name = "base", .number = 1, .first = 0, .n = 2},
                                                {.name = "upper", .number = 2, .first = 2, .n = 1}};
static struct loops_loop all[] = {
    {.name = "v1", .id = 1, .table = APC_ACTUATOR, .output = 1, .measurement = 1, .setpoint = 1, .above = 2},
    {.name = "v2", .id = 2, .table = APC_ACTUATOR, .output = 2, .measurement = 2, .setpoint = 2, .above = -1},
    {.name = "upper.r1",
     .id = 3,
     .controller = 1,
     .table = APC_SETPOINT,
     .output = 1,
     .measurement = 1,
     .setpoint = 3,
     .above = -1}};
static const struct loops loops = {.at = all, .n = 3, .controller = controllers, .n_controllers = 2};

static struct apc_sample wanted(enum apc_table table, int id, double value)
{
    return (struct apc_sample){
        .table = table, .id = id, .seq = APC_SEQ_ANY, .time = APC_NS_PER_S, .value = value};
}

static void put(struct apc_store *store, enum apc_table table, int id, double value)
{
    struct apc_sample s = wanted(table, id, value);
    ok(store, apc_store_put(store, &s, 1));
}

/* The loop above moves r1 to this, in Cas; it is in force. */
static void move(struct apc_store *store, double value)
{
    struct apc_sample now = newest(store, APC_SETPOINT, 1);
    struct apc_sample rows[] = {
        {.table = APC_SETPOINT, .id = 1, .seq = now.seq, .time = 1000, .value = value, .origin = 1},
        {.table = APC_ACTUAL,
         .id = apc_variable_number(APC_SETPOINT, 1),
         .seq = newest(store, APC_ACTUAL, apc_variable_number(APC_SETPOINT, 1)).seq + 1,
         .time = 1000,
         .value = value,
         .origin = now.seq + 1}};
    const struct apc_rows both = {.size = sizeof both, .sample = rows, .n_samples = 2};
    assert_int_equal(apc_store_append_rows(store, &both), 2);
}

static void in_cas(struct apc_store *store)
{
    put(store, APC_OPMODE, 1, APC_MODE_CAS);
    put(store, APC_SETPOINT, 1, 6);
    move(store, 6.5);
}

static int write_rows(struct apc_store *store, struct apc_sample *samples, size_t n, struct owner_rows *with)
{
    int rc = owner_put(store, &loops, samples, n, with);
    for (size_t i = 0; i < n && rc == 0; i++) {
        const struct apc_sample now = newest(store, samples[i].table, samples[i].id);
        assert_int_equal(now.seq, samples[i].seq);
        assert_near(now.value, samples[i].value, 0);
    }
    return rc;
}

static void test_a_setpoint_of_a_loop_in_cas_opens_the_cascade(void **state)
{
    struct apc_sample r1 = wanted(APC_SETPOINT, 1, 5);
    struct owner_rows with;
    in_cas(*state);
    r1.author = (uint32_t)apc_store_author(*state, "joe");
    assert_true(r1.author > 0);
    assert_int_equal(write_rows(*state, &r1, 1, &with), 0);
    assert_int_equal(with.n, 1);
    assert_true(with.at[0].table == APC_OPMODE && with.at[0].id == 1 && with.at[0].seq == 2);
    assert_near(newest(*state, APC_OPMODE, 1).value, APC_MODE_AUTO, 0);
    assert_int_equal(newest(*state, APC_OPMODE, 1).author, r1.author); /* and it was his doing */
    free(with.at);
}

static void test_a_setpoint_of_a_loop_in_another_mode_is_all_that_is_written(void **state)
{
    static const enum apc_mode modes[] = {APC_MODE_AUTO, APC_MODE_MAN, APC_MODE_OOS};
    for (size_t i = 0; i < 3; i++) {
        struct apc_sample r1 = wanted(APC_SETPOINT, 1, (double)i);
        struct owner_rows with;
        put(*state, APC_OPMODE, 1, modes[i]);
        assert_int_equal(write_rows(*state, &r1, 1, &with), 0);
        assert_int_equal(with.n, 0);
        assert_near(newest(*state, APC_OPMODE, 1).value, modes[i], 0);
        free(with.at);
    }
}

static void test_a_mode_that_leaves_cas_keeps_the_setpoint_that_is_in_force(void **state)
{
    struct apc_sample mode = wanted(APC_OPMODE, 1, APC_MODE_AUTO);
    struct owner_rows with;
    in_cas(*state);
    const struct apc_sample before = newest(*state, APC_SETPOINT, 1);
    struct apc_sample late = {.table = APC_SETPOINT, .id = 1, .seq = before.seq, .value = 9, .origin = 2};
    assert_int_equal(write_rows(*state, &mode, 1, &with), 0);
    free(with.at);
    const struct apc_rows row = {.size = sizeof row, .sample = &late, .n_samples = 1};
    ok(*state, apc_store_append_rows(*state, &row)); /* what the loop above was about to write is left out */
    assert_int_equal(late.seq, 0);
    const struct apc_sample after = newest(*state, APC_SETPOINT, 1);
    assert_true(after.seq == before.seq + 1 && after.origin == 0);
    assert_near(after.value, 6.5, 0);
}

/* trial has v1 as well; the switch says who acts, whatever was known when the loops were loaded. */
static void test_the_target_of_a_loop_in_shadow_takes_nothing_along(void **state)
{
    const int choice = LOOPS_ACTING(APC_ACTUATOR, 1);
    struct loops_controller by[] = {{.name = "base", .number = 1, .n = 1, .choice = choice, .acts = true},
                                    {.name = "upper", .number = 2, .first = 1, .n = 1, .acts = true},
                                    {.name = "trial", .number = 3, .first = 2, .n = 1, .choice = choice}};
    struct loops_loop two[] = {all[0], all[2], all[0]};
    two[0].above = two[2].above = 1;
    two[2].id = 4;
    two[2].controller = 2;
    const struct loops both = {.at = two, .n = 3, .controller = by, .n_controllers = 3};
    for (int acts = 1; acts <= 3; acts += 2) {
        const int acting = acts == 1 ? 1 : 4, other = acts == 1 ? 4 : 1;
        struct apc_sample mode = wanted(APC_OPMODE, other, APC_MODE_AUTO), setpoint;
        struct owner_rows with;
        in_cas(*state);
        put(*state, APC_OPMODE, 4, APC_MODE_CAS);
        put(*state, APC_OPMODE, choice, acts);
        ok(*state, owner_put(*state, &both, &mode, 1, &with));
        assert_int_equal(with.n, 0);
        free(with.at);
        mode = wanted(APC_OPMODE, acting, APC_MODE_AUTO);
        ok(*state, owner_put(*state, &both, &mode, 1, &with));
        assert_int_equal(with.n, 1);
        assert_int_equal(with.at[0].table, APC_SETPOINT);
        free(with.at);
        in_cas(*state);
        put(*state, APC_OPMODE, 4, APC_MODE_CAS);
        setpoint = wanted(APC_SETPOINT, 1, 7);
        ok(*state, owner_put(*state, &both, &setpoint, 1, &with)); /* which is taken from both */
        assert_int_equal(with.n, 2);
        free(with.at);
        assert_near(newest(*state, APC_OPMODE, 1).value, APC_MODE_AUTO, 0);
        assert_near(newest(*state, APC_OPMODE, 4).value, APC_MODE_AUTO, 0);
    }
}

static void test_a_mode_that_comes_to_cas_gives_the_setpoint_away_as_it_is(void **state)
{
    struct apc_sample mode = wanted(APC_OPMODE, 1, APC_MODE_CAS);
    struct owner_rows with;
    put(*state, APC_OPMODE, 1, APC_MODE_AUTO);
    move(*state, 6.5);
    put(*state, APC_SETPOINT, 1, 4);
    assert_int_equal(write_rows(*state, &mode, 1, &with), 0);
    assert_int_equal(with.n, 1);
    assert_near(newest(*state, APC_SETPOINT, 1).value, 4, 0);
    free(with.at);
}

static void test_of_all_loops_those_under_another_one_keep_their_setpoints(void **state)
{
    struct apc_sample mode = wanted(APC_OPMODE, 0, APC_MODE_MAN);
    struct owner_rows with;
    in_cas(*state);
    put(*state, APC_SETPOINT, 2, 3);
    assert_int_equal(write_rows(*state, &mode, 1, &with), 0);
    assert_int_equal(with.n, 1);
    assert_true(with.at[0].table == APC_SETPOINT && with.at[0].id == 1);
    assert_int_equal(newest(*state, APC_SETPOINT, 2).seq, 1);
    free(with.at);
}

static void test_target_and_setpoint_of_one_loop_are_written_as_they_are_given(void **state)
{
    struct apc_sample both[] = {wanted(APC_SETPOINT, 1, 5), wanted(APC_OPMODE, 1, APC_MODE_MAN)};
    struct owner_rows with;
    in_cas(*state);
    assert_int_equal(write_rows(*state, both, 2, &with), 0);
    assert_int_equal(with.n, 0);
    free(with.at);
}

static void test_what_is_no_longer_as_the_caller_knew_it_is_not_written(void **state)
{
    struct apc_sample r1 = wanted(APC_SETPOINT, 1, 5), plain = wanted(APC_SETPOINT, 2, 5);
    struct owner_rows with;
    in_cas(*state);
    put(*state, APC_SETPOINT, 2, 3);
    r1.seq = 1;
    plain.seq = 0;
    assert_int_equal(owner_put(*state, &loops, &r1, 1, &with), APC_ECONFLICT);
    assert_true(r1.seq == 2);
    assert_near(r1.value, 6.5, 0);
    assert_int_equal(owner_put(*state, &loops, &plain, 1, &with), APC_ECONFLICT);
    assert_true(plain.seq == 1);
    assert_int_equal(newest(*state, APC_OPMODE, 1).seq, 1);
    assert_int_equal(newest(*state, APC_SETPOINT, 1).seq, 2);
}

/* ---- What is planned ----------------------------------------------------------------------------------- */

static const struct apc_store_ops *real;
static struct apc_store *faster; /* who writes between two calls, once */

static int do_read(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    const int rc = real->read(s, samples, n);
    struct apc_store *other = faster;
    faster = NULL;
    if (other)
        put(other, APC_OPMODE, 1, APC_MODE_CAS);
    return rc;
}

static void test_a_cascade_is_opened_as_it_was_seen_or_not_at_all(void **state)
{
    const struct action local = {
        .kind = ACTION_WRITE, .to = wanted(APC_OPMODE, 1, APC_MODE_AUTO), .n = 1, .local = true};
    struct apc_store *store = *state, *other = NULL;
    struct apc_store_ops ops;
    in_cas(store);
    ok(store, apc_store_open(&other, store_uri, NULL, NULL));
    real = store->ops;
    ops = *real;
    ops.read = do_read;
    store->ops = &ops;
    faster = other;
    assert_int_equal(action_do(store, &loops, NULL, 0, &local, APC_NS_PER_S, "joe"), APC_ECONFLICT);
    assert_null(faster);
    assert_int_equal(newest(store, APC_OPMODE, 1).seq, 2);
    assert_near(newest(store, APC_OPMODE, 1).value, APC_MODE_CAS, 0);
    assert_int_equal(action_do(store, &loops, NULL, 0, &local, APC_NS_PER_S, "joe"), 0);
    assert_near(newest(store, APC_OPMODE, 1).value, APC_MODE_AUTO, 0);
    assert_int_equal(newest(store, APC_OPMODE, 1).seq, 3);
    store->ops = real;
    apc_store_close(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_setpoint_of_a_loop_in_cas_opens_the_cascade),
        T(test_a_setpoint_of_a_loop_in_another_mode_is_all_that_is_written),
        T(test_a_mode_that_leaves_cas_keeps_the_setpoint_that_is_in_force),
        T(test_the_target_of_a_loop_in_shadow_takes_nothing_along),
        T(test_a_mode_that_comes_to_cas_gives_the_setpoint_away_as_it_is),
        T(test_of_all_loops_those_under_another_one_keep_their_setpoints),
        T(test_target_and_setpoint_of_one_loop_are_written_as_they_are_given),
        T(test_what_is_no_longer_as_the_caller_knew_it_is_not_written),
        T(test_a_cascade_is_opened_as_it_was_seen_or_not_at_all),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
