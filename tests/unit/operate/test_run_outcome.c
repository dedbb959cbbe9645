/* SPDX-License-Identifier: BSD-3-Clause */
/* What became of a write, by the rows that a controller leaves in a store. */
#include <stdio.h>

#include "operate/operate.h"
#include "stores.h"

#define S      APC_NS_PER_S
#define PERIOD (2 * S)
#define NOW    (1000 * S)

/* An operator writes; this is the row. */
static struct apc_sample put(struct apc_store *store, enum apc_table table, int id, double value)
{
    struct apc_sample s = {.table = table, .id = id, .time = NOW - S, .value = value};
    ok(store, apc_store_put(store, &s, 1));
    return s;
}

static int64_t next_seq(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_vector v = {.table = table, .id = id};
    struct apc_sample s = {.table = table, .id = id};
    struct apc_rows rows = {.size = sizeof rows};
    if (apc_table_vectors(table)) {
        rows.vector = &v;
        rows.n_vectors = 1;
    } else {
        rows.sample = &s;
        rows.n_samples = 1;
    }
    ok(store, apc_store_read_rows(store, &rows));
    return 1 + (apc_table_vectors(table) ? v.seq : s.seq);
}

/* Its controller ticks. */
static void tick(struct apc_store *store, apc_ns at)
{
    double value = 1;
    struct apc_vector v = {.table = APC_TICK,
                           .id = 1,
                           .seq = next_seq(store, APC_TICK, 1),
                           .time = at,
                           .n = 1,
                           .room = 1,
                           .value = &value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
}

/* Its controller has looked at row @p seq of it, and says what is in force. */
static void look(struct apc_store *store, const struct apc_sample *of, int64_t seq, double value,
                 apc_status status)
{
    const int number = apc_variable_number(of->table, of->id);
    struct apc_sample s = {.table = APC_ACTUAL,
                           .id = number,
                           .seq = next_seq(store, APC_ACTUAL, number),
                           .time = NOW,
                           .value = value,
                           .status = status,
                           .origin = seq};
    const struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1};
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
}

static enum outcome outcome_now(struct apc_store *store, const struct apc_sample *write, apc_ns *age)
{
    struct apc_sample actual = {.table = APC_ACTUAL, .id = apc_variable_number(write->table, write->id)};
    struct apc_vector newest = {.table = APC_TICK, .id = 1};
    struct apc_rows rows = {
        .size = sizeof rows, .sample = &actual, .n_samples = 1, .vector = &newest, .n_vectors = 1};
    const struct outcome_seen seen = {
        .write = write, .actual = &actual, .tick = &newest, .period = PERIOD, .now = NOW};
    ok(store, apc_store_read_rows(store, &rows));
    if (age)
        *age = outcome_age(&seen);
    return outcome_of(&seen);
}

#define assert_outcome(store, write, expected)                                                               \
    assert_int_equal((int)outcome_now(store, write, NULL), (int)(expected))

static void test_it_waits_until_its_controller_has_looked_at_it(void **state)
{
    const struct apc_sample w = put(*state, APC_TUNING, 3, 0.2);
    tick(*state, NOW - S);
    assert_outcome(*state, &w, OUTCOME_WAITING);
    look(*state, &w, w.seq, 0.2, APC_GOOD);
    assert_outcome(*state, &w, OUTCOME_APPLIED);
}

static void test_of_two_writes_the_older_one_is_superseded(void **state)
{
    const struct apc_sample first = put(*state, APC_SETPOINT, 1, 7), second = put(*state, APC_SETPOINT, 1, 8);
    tick(*state, NOW - S);
    look(*state, &second, second.seq, 8, APC_GOOD);
    assert_outcome(*state, &first, OUTCOME_SUPERSEDED);
    assert_outcome(*state, &second, OUTCOME_APPLIED);
}

static void test_what_its_controller_calls_bad_is_refused(void **state)
{
    const struct apc_sample z = put(*state, APC_SETPOINT, 1, 1e9), u = put(*state, APC_MANUAL, 1, 1e9);
    tick(*state, NOW - S);
    look(*state, &z, z.seq, 5, APC_BAD);
    look(*state, &u, u.seq, 5, APC_BAD);
    assert_outcome(*state, &z, OUTCOME_REFUSED);
    assert_outcome(*state, &u, OUTCOME_REFUSED);
}

static void test_a_mode_that_is_not_reached_yet_is_waited_for(void **state)
{
    const struct apc_sample w = put(*state, APC_OPMODE, 2, APC_MODE_CAS);
    tick(*state, NOW - S);
    look(*state, &w, w.seq, APC_MODE_AUTO, APC_UNCERTAIN);
    assert_outcome(*state, &w, OUTCOME_WAITING);
    look(*state, &w, w.seq, APC_MODE_CAS, APC_GOOD);
    assert_outcome(*state, &w, OUTCOME_APPLIED);
}

static void test_a_setpoint_of_a_loop_without_input_is_waited_for(void **state)
{
    const struct apc_sample w = put(*state, APC_SETPOINT, 1, 7);
    tick(*state, NOW - S);
    look(*state, &w, w.seq, 7, APC_UNCERTAIN);
    assert_outcome(*state, &w, OUTCOME_WAITING);
}

/* Its status is what two loops say to each other, whatever became of what an operator wrote. */
static void test_of_a_setpoint_under_another_loop_the_value_tells(void **state)
{
    static const apc_status handshake[] = {APC_GOOD_LOCAL_OVERRIDE, APC_UNCERTAIN_INITIAL, APC_GOOD,
                                           APC_GOOD_LIMITED_HIGH};
    tick(*state, NOW - S);
    for (size_t i = 0; i < sizeof handshake / sizeof *handshake; i++) {
        const struct apc_sample w = put(*state, APC_SETPOINT, 1, 7);
        look(*state, &w, w.seq, 7, handshake[i]);
        assert_outcome(*state, &w, OUTCOME_APPLIED);
        look(*state, &w, w.seq, 6.5, handshake[i]);
        assert_outcome(*state, &w, OUTCOME_REFUSED);
    }
}

static void test_a_controller_that_does_not_tick_applies_nothing_and_its_age_is_said(void **state)
{
    apc_ns age = -1;
    const struct apc_sample w = put(*state, APC_SETPOINT, 1, 7);
    assert_int_equal((int)outcome_now(*state, &w, &age), (int)OUTCOME_NOBODY);
    assert_int_equal(age, 0); /* it never did */
    tick(*state, NOW - 3 * PERIOD - S);
    assert_int_equal((int)outcome_now(*state, &w, &age), (int)OUTCOME_NOBODY);
    assert_int_equal(age, 3 * PERIOD + S);
    tick(*state, NOW - 3 * PERIOD);
    assert_outcome(*state, &w, OUTCOME_WAITING);
    tick(*state, NOW + S); /* of a host whose clock is ahead */
    assert_int_equal((int)outcome_now(*state, &w, &age), (int)OUTCOME_WAITING);
    assert_int_equal(age, 0);
}

static void test_what_was_applied_stays_so_when_its_controller_stops(void **state)
{
    const struct apc_sample w = put(*state, APC_SETPOINT, 1, 7), late = put(*state, APC_SETPOINT, 1, 8);
    tick(*state, NOW - 100 * S);
    look(*state, &w, w.seq, 7, APC_GOOD);
    assert_outcome(*state, &w, OUTCOME_APPLIED);
    assert_outcome(*state, &late, OUTCOME_NOBODY);
    look(*state, &late, late.seq, 7, APC_BAD);
    assert_outcome(*state, &late, OUTCOME_REFUSED);
}

static void say(struct apc_store *store, apc_ns time, const char *kind, const char *text)
{
    struct apc_event e = {.time = time, .severity = APC_EVENT_WARNING, .source = "apc-controller"};
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    snprintf(e.text, sizeof e.text, "%s", text);
    ok(store, apc_store_append_events(store, &e, 1));
}

static void test_why_it_was_refused_is_what_the_event_says(void **state)
{
    char text[192] = "";
    say(*state, NOW - S, "rejected", "Kp refused: before");
    say(*state, NOW + S, "mode", "Kp is no reason");
    assert_false(outcome_refusal(*state, "Kp", NOW, text, sizeof text));
    say(*state, NOW + S, "rejected", "tuning refused: tau_i < h");
    assert_true(outcome_refusal(*state, "Kp", NOW, text, sizeof text)); /* the only one */
    assert_string_equal(text, "tuning refused: tau_i < h");
    say(*state, NOW + S, "rejected", "Kp refused: 7 is not within 0 to 5");
    say(*state, NOW + 2 * S, "rejected", "tau_i refused: 0 is not within 1 to 5");
    assert_true(outcome_refusal(*state, "Kp", NOW, text, sizeof text));
    assert_string_equal(text, "Kp refused: 7 is not within 0 to 5");
}

/* Reported of Orion and of Cog: what belongs to MOBA_test2 is taken for what belongs to MOBA_test. */
static void test_why_another_was_refused_is_no_answer_though_its_name_has_this_one_in_it(void **state)
{
    static const char *const others[] = {"r2 refused: 9 is above 5", "y.r refused: 9 is above 5",
                                         "r.high refused: after a reset", "tracker-r refused"};
    char text[192] = "";
    say(*state, NOW + S, "rejected", "mode r: refused, 9 is above 5.");
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        say(*state, NOW + (2 + (apc_ns)i) * S, "rejected", others[i]);
    assert_true(outcome_refusal(*state, "r", NOW, text, sizeof text));
    assert_string_equal(text, "mode r: refused, 9 is above 5.");
    assert_true(outcome_refusal(*state, "y.r", NOW, text, sizeof text));
    assert_string_equal(text, others[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_it_waits_until_its_controller_has_looked_at_it),
        T(test_of_two_writes_the_older_one_is_superseded),
        T(test_what_its_controller_calls_bad_is_refused),
        T(test_a_mode_that_is_not_reached_yet_is_waited_for),
        T(test_a_setpoint_of_a_loop_without_input_is_waited_for),
        T(test_of_a_setpoint_under_another_loop_the_value_tells),
        T(test_a_controller_that_does_not_tick_applies_nothing_and_its_age_is_said),
        T(test_what_was_applied_stays_so_when_its_controller_stops),
        T(test_why_it_was_refused_is_what_the_event_says),
        T(test_why_another_was_refused_is_no_answer_though_its_name_has_this_one_in_it),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
