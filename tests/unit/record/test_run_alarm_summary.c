/* SPDX-License-Identifier: BSD-3-Clause */
/* What may be wanted of an alarm as it stands, and what became of it. */
#include "check.h"

#include <stdio.h>

#include "record/record.h"

#define S   APC_NS_PER_S
#define NOW (1000000 * S)

static struct alarm high = {.name = "y.high"};
static struct apc_sample row, wish[3], actual[3];
static const struct alarm_now now = {
    .row = &row, .wish = {&wish[0], &wish[1], &wish[2]}, .actual = {&actual[0], &actual[1], &actual[2]}};
static struct alarm_summary summary;

static int begin(void **state)
{
    (void)state;
    summary = (struct alarm_summary){.at = (struct alarm_now *)(uintptr_t)&now};
    summary.e.alarm = &high;
    summary.e.n_alarms = 1;
    summary.e.alarms.shelve_max = 8 * 3600 * S;
    summary.e.alarms.rhythm.period = 10 * S;
    summary.tick = (struct apc_vector){.table = APC_TICK, .seq = 5, .time = NOW};
    row = (struct apc_sample){
        .table = APC_ALARM, .id = 1, .seq = 4, .time = NOW - S, .value = APC_ALARM_UNACKED};
    for (int i = 0; i < 3; i++) {
        wish[i] = (struct apc_sample){.table = APC_OPMODE, .id = 65536 * (APC_ALARM_ACK + i) + 1, .seq = 7};
        actual[i] = (struct apc_sample){.table = APC_ACTUAL, .seq = 2, .origin = 7};
    }
    return 0;
}

/* NULL: it may be. */
static void assert_want(enum apc_alarm_switch which, double value, const char *reason)
{
    struct apc_sample to = {.value = -77.0};
    struct apc_error why = {""};
    const bool may = alarm_summary_want(&summary, &now, NULL, which, value, NOW, &to, &why);
    assert_string_equal(why.text, reason ? reason : "");
    assert_int_equal(may, !reason);
    assert_int_equal(to.table, APC_OPMODE);
    assert_int_equal(to.id, wish[ALARM_WISH(which)].id);
    assert_int_equal(to.seq, 7);
    assert_int_equal(to.time, NOW);
    assert_near(to.value, which == APC_ALARM_ACK ? (double)row.seq : value, 0.0);
}

static void what_nobody_has_acknowledged_can_be_once(void **state)
{
    static const struct {
        enum apc_alarm_state is;
        bool may;
    } states[] = {{APC_ALARM_NORMAL, false},         {APC_ALARM_UNACKED, true},
                  {APC_ALARM_ACKED, false},          {APC_ALARM_RETURNED, true},
                  {APC_ALARM_LATCHED_UNACKED, true}, {APC_ALARM_LATCHED, true},
                  {APC_ALARM_SHELVED, false},        {APC_ALARM_SUPPRESSED_ACTIVE, false},
                  {APC_ALARM_OUT_OF_SERVICE, false}};
    char reason[100];
    (void)state;
    for (size_t i = 0; i < sizeof states / sizeof *states; i++) {
        row.value = states[i].is;
        snprintf(reason, sizeof reason, "y.high: there is nothing to acknowledge: it is %s",
                 apc_alarm_state_name(states[i].is));
        assert_want(APC_ALARM_ACK, 0, states[i].may ? NULL : reason);
    }
    row.seq = 0; /* never evaluated, or no state: normal */
    assert_want(APC_ALARM_ACK, 0, "y.high: there is nothing to acknowledge: it is Normal");
    row.seq = 4;
    row.value = 77;
    assert_want(APC_ALARM_ACK, 0, "y.high: there is nothing to acknowledge: it is Normal");
}

/* Until its evaluation has looked at it. */
/* Promise(alarms/acknowledge-once-told) */
static void who_acknowledges_after_another_is_told(void **state)
{
    static const char said[] = "y.high: somebody has just acknowledged it"; /* not: it is Unacknowledged */
    (void)state;
    wish[0].value = 4; /* of this very row */
    assert_want(APC_ALARM_ACK, 0, NULL);
    actual[0].origin = 6;
    assert_want(APC_ALARM_ACK, 0, said);
    wish[0].value = 5;
    assert_want(APC_ALARM_ACK, 0, said);
    wish[0].value = 3; /* of a former one */
    assert_want(APC_ALARM_ACK, 0, NULL);
}

/* Promise(alarms/acknowledge-once-told) */
static void shelving_ends_in_time(void **state)
{
    const double at = 1e6, most = 8 * 3600;
    static const char past[] = "y.high: the end of shelving is in the past",
                      far[] = "y.high may be shelved for up to 8 h",
                      none[] = "y.high: it is not shelved: it is Unacknowledged Active";
    (void)state;
    assert_want(APC_ALARM_SHELF, at + 60, NULL);
    assert_want(APC_ALARM_SHELF, -at - 60, NULL); /* once */
    assert_want(APC_ALARM_SHELF, at, past);
    assert_want(APC_ALARM_SHELF, -at, past);
    assert_want(APC_ALARM_SHELF, at - 60, past);
    assert_want(APC_ALARM_SHELF, at + most, NULL);
    assert_want(APC_ALARM_SHELF, at + most + 1, NULL); /* it took a second to be sent */
    assert_want(APC_ALARM_SHELF, at + most + 2, far);
    assert_want(APC_ALARM_SHELF, -at - most - 2, far);
    summary.e.alarms.shelve_max = 90 * 60 * S;
    assert_want(APC_ALARM_SHELF, at + most, "y.high may be shelved for up to 1.5 h");
    summary.e.alarms.shelve_max = 30 * 60 * S;
    assert_want(APC_ALARM_SHELF, at + most, "y.high may be shelved for up to 30 min");
    summary.e.alarms.shelve_max = 45 * S;
    assert_want(APC_ALARM_SHELF, at + most, "y.high may be shelved for up to 45 s");
    assert_want(APC_ALARM_SHELF, 0, none);
    actual[1].value = -at - 60;
    assert_int_equal(alarm_summary_shelved(&now), NOW + 60 * S);
    assert_want(APC_ALARM_SHELF, 0, NULL);
    actual[1].seq = 0;
    assert_int_equal(alarm_summary_shelved(&now), 0);
    assert_want(APC_ALARM_SHELF, 0, none);
    assert_want(APC_ALARM_SERVICE, 0, NULL);
    assert_want(APC_ALARM_SERVICE, 1, NULL);
}

/* Three periods and 0.1 s. */
static void alarms_are_evaluated_as_long_as_ticks_come(void **state)
{
    (void)state;
    assert_true(alarm_summary_lives(&summary, NOW));
    assert_true(alarm_summary_lives(&summary, NOW + 30 * S + S / 10));
    assert_false(alarm_summary_lives(&summary, NOW + 30 * S + S / 10 + 1));
    assert_true(alarm_summary_lives(&summary, NOW - 3600 * S)); /* of a clock that is ahead */
    summary.tick.seq = 0;
    assert_false(alarm_summary_lives(&summary, NOW));
}

static void what_became_of_a_wish_is_that_of_its_own_switch(void **state)
{
    (void)state;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++)
            actual[k].origin = k == i ? 7 : 6;
        for (int k = 0; k < 3; k++)
            assert_int_equal(alarm_summary_outcome(&summary, &now, &wish[k], NOW),
                             k == i ? OUTCOME_APPLIED : OUTCOME_WAITING);
    }
    actual[2].status = APC_BAD;
    assert_int_equal(alarm_summary_outcome(&summary, &now, &wish[2], NOW), OUTCOME_REFUSED);
    actual[2].origin = 8;
    assert_int_equal(alarm_summary_outcome(&summary, &now, &wish[2], NOW), OUTCOME_SUPERSEDED);
    assert_int_equal(alarm_summary_outcome(&summary, &now, &wish[0], NOW + 31 * S), OUTCOME_NOBODY);
    assert_ptr_equal(alarm_summary_find(&summary, "y.high"), &now);
    assert_null(alarm_summary_find(&summary, "y.low"));
    assert_ptr_equal(alarm_summary_alarm(&summary, &now), &high);
}

#define T(name) cmocka_unit_test_setup(name, begin)

static void words_say_what_is_wanted(void **state)
{
    static const struct {
        enum apc_alarm_switch which;
        double value;
        const char *reason, *words;
    } cases[] = {{APC_ALARM_ACK, 4, NULL, "y.high: acknowledged"},
                 {APC_ALARM_ACK, 4, "seen", "y.high: acknowledged (seen)"},
                 {APC_ALARM_SHELF, 1e9, "", "y.high: shelved until 2001-09-09T01:46:40Z"},
                 {APC_ALARM_SHELF, -1e9, "test", "y.high: shelved until 2001-09-09T01:46:40Z, once (test)"},
                 {APC_ALARM_SHELF, 0, NULL, "y.high: not shelved any more"},
                 {APC_ALARM_SERVICE, 1, NULL, "y.high: out of service"},
                 {APC_ALARM_SERVICE, 0, NULL, "y.high: in service"}};
    char text[100];
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct apc_sample to = {.id = apc_alarm_switch_id(cases[i].which, 1), .value = cases[i].value};
        alarm_summary_words("y.high", &to, cases[i].reason, text, sizeof text);
        assert_string_equal(text, cases[i].words);
    }
}

/*
 * Promise(alarms/acknowledge-once-told): Of those who acknowledge at once one does, and the others are
 *   told; who is refused is told his own refusal; shelving has an end; a killed apc-alarms forgets nothing;
 *   a flood loses no transition.
 */
static void a_refusal_is_ones_own(void **state)
{
    static const struct apc_event events[] = {
        {.time = NOW - S,
         .severity = APC_EVENT_WARNING,
         .kind = "rejected",
         .text = "y.high: not acknowledged: of another, before"},
        {.time = NOW + 1,
         .severity = APC_EVENT_WARNING,
         .kind = "rejected",
         .text = "y.high-high: not acknowledged: of another alarm"},
        {.time = NOW + 2, .severity = APC_EVENT_ALARM, .kind = "alarm", .text = "y.high: too high"},
        {.time = NOW + 3,
         .severity = APC_EVENT_WARNING,
         .kind = "rejected",
         .text = "y.high: not acknowledged: one's own"},
        {.time = NOW + 4,
         .severity = APC_EVENT_WARNING,
         .kind = "rejected",
         .text = "y.high: not acknowledged: of another, later"}};
    const struct apc_sample to = {.id = apc_alarm_switch_id(APC_ALARM_ACK, 1), .seq = 8};
    struct apc_store *store;
    struct apc_error why;
    char text[100];
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_int_equal(apc_store_init(store), 0);
    actual[ALARM_WISH(APC_ALARM_ACK)].origin = 8;
    actual[ALARM_WISH(APC_ALARM_ACK)].time = NOW;
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_true(apc_store_append_events(store, events, 3) >= 0);
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_true(apc_store_append_events(store, events + 3, 2) >= 0);
    assert_true(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_string_equal(text, "y.high: not acknowledged: one's own");
    actual[ALARM_WISH(APC_ALARM_ACK)].origin = 9; /* it was another that was looked at */
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(what_nobody_has_acknowledged_can_be_once),
        T(who_acknowledges_after_another_is_told),
        T(shelving_ends_in_time),
        T(alarms_are_evaluated_as_long_as_ticks_come),
        T(what_became_of_a_wish_is_that_of_its_own_switch),
        T(words_say_what_is_wanted),
        T(a_refusal_is_ones_own),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
