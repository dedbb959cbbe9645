/* SPDX-License-Identifier: BSD-3-Clause */
/* What may be wanted of an alarm as it stands, and what became of it. */
#include "check.h"

#include <stdio.h>

#include "record/record.h"

#define S   APC_NS_PER_S
#define NOW (1000000 * S)

static struct alarm high = {.name = "y.high"};
static struct apc_sample row, request[3], actual[3];
static const struct alarm_now now = {.row = &row,
                                     .request = {&request[0], &request[1], &request[2]},
                                     .actual = {&actual[0], &actual[1], &actual[2]}};
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
        request[i] =
            (struct apc_sample){.table = APC_OPMODE, .id = 65536 * (APC_ALARM_ACK + i) + 1, .seq = 7};
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
    assert_int_equal(to.id, request[ALARM_SWITCH(which)].id);
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
    request[0].value = 4; /* of this very row */
    assert_want(APC_ALARM_ACK, 0, NULL);
    actual[0].origin = 6;
    assert_want(APC_ALARM_ACK, 0, said);
    request[0].value = 5;
    assert_want(APC_ALARM_ACK, 0, said);
    request[0].value = 3; /* of a former one */
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

static void what_became_of_a_request_is_that_of_its_own_switch(void **state)
{
    (void)state;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++)
            actual[k].origin = k == i ? 7 : 6;
        for (int k = 0; k < 3; k++)
            assert_int_equal(alarm_summary_outcome(&summary, &now, &request[k], NOW),
                             k == i ? OUTCOME_APPLIED : OUTCOME_WAITING);
    }
    actual[2].status = APC_BAD;
    assert_int_equal(alarm_summary_outcome(&summary, &now, &request[2], NOW), OUTCOME_REFUSED);
    actual[2].origin = 8;
    assert_int_equal(alarm_summary_outcome(&summary, &now, &request[2], NOW), OUTCOME_SUPERSEDED);
    assert_int_equal(alarm_summary_outcome(&summary, &now, &request[0], NOW + 31 * S), OUTCOME_NOBODY);
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
    actual[ALARM_SWITCH(APC_ALARM_ACK)].origin = 8;
    actual[ALARM_SWITCH(APC_ALARM_ACK)].time = NOW;
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_true(apc_store_append_events(store, events, 3) >= 0);
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_true(apc_store_append_events(store, events + 3, 2) >= 0);
    assert_true(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    assert_string_equal(text, "y.high: not acknowledged: one's own");
    actual[ALARM_SWITCH(APC_ALARM_ACK)].origin = 9; /* it was another that was looked at */
    assert_false(alarm_summary_refusal(&summary, &now, &to, store, text, sizeof text));
    apc_store_close(store);
}

/* ---- First out ----------------------------------------------------------------------------- */

#define ALARMS 7

/* Rows of alarms as apc-alarms writes them, and the summary of them. */
static struct alarm alarms[ALARMS] = {{.name = "a", .area = "left"},  {.name = "b", .area = "right"},
                                      {.name = "c", .area = "left"},  {.name = "d", .area = "left"},
                                      {.name = "e", .area = "left/"}, {.name = "f", .area = ""},
                                      {.name = "g", .area = "left/"}};
static struct apc_sample rows[ALARMS];
static struct alarm_now at[ALARMS];
static struct alarm_coming coming[ALARMS * COMINGS];
static struct alarm_summary plant;

static int begin_plant(void **state)
{
    (void)state;
    plant = (struct alarm_summary){.at = at, .coming = coming};
    plant.e.alarm = alarms;
    plant.e.n_alarms = ALARMS;
    for (int i = 0; i < ALARMS; i++) {
        rows[i] = (struct apc_sample){.table = APC_ALARM, .id = i + 1, .value = APC_ALARM_NORMAL};
        at[i] = (struct alarm_now){.row = &rows[i]};
    }
    return 0;
}

static void go(char name, double s, enum apc_alarm_state to)
{
    struct apc_sample *newest = &rows[name - 'a'];
    newest->seq++;
    newest->time = NOW + (apc_ns)(s * 1e9);
    newest->value = to;
}

/* The names of those that are. */
static void assert_first_out(struct apc_store *store, const char *expected)
{
    char marked[ALARMS + 1] = "";
    size_t n = 0;
    assert_int_equal(alarm_summary_mark(&plant, store), 0);
    for (int i = 0; i < ALARMS; i++)
        if (at[i].first_out)
            marked[n++] = alarms[i].name[0];
    marked[n] = '\0';
    assert_string_equal(marked, expected);
}

/* Each row is seen, so the history is asked for nothing: there is none. */
static void see(char name, double s, enum apc_alarm_state to, const char *expected)
{
    go(name, s, to);
    assert_first_out(NULL, expected);
}

/* Promise(alarms/first-out): Of the alarms of an area that come within a minute one of another, the first one is marked
 *   as first out while it stands; of no other alarm is that said. */
static void of_those_that_come_together_in_an_area_the_first_is_marked(void **state)
{
    (void)state;
    assert_first_out(NULL, "");
    see('c', 0, APC_ALARM_UNACKED, ""); /* alone */
    see('b', 10, APC_ALARM_UNACKED, "");
    see('e', 10, APC_ALARM_UNACKED, "");
    see('f', 10, APC_ALARM_UNACKED, ""); /* of other areas */
    see('a', 60, APC_ALARM_UNACKED, "c");
    see('c', 70, APC_ALARM_ACKED, "c");
    see('d', 120, APC_ALARM_UNACKED, "c"); /* a minute after the one before, two after the first */
    see('b', 300, APC_ALARM_ACKED, "c");
    see('d', 300, APC_ALARM_RETURNED, "c");
    see('d', 310, APC_ALARM_NORMAL, "c");
    see('c', 320, APC_ALARM_NORMAL, ""); /* it has gone, and the next one was not the first */
}

static void bursts_of_one_area_are_apart_by_more_than_a_minute(void **state)
{
    (void)state;
    see('a', 0, APC_ALARM_UNACKED, "");
    see('c', 60 + 1e-6, APC_ALARM_UNACKED, "");
    see('d', 100, APC_ALARM_UNACKED, "c");
    see('b', 100, APC_ALARM_UNACKED, "c");
    see('a', 110, APC_ALARM_RETURNED, "c");
    see('a', 110, APC_ALARM_UNACKED, "c"); /* again, with the others */
    see('e', 120, APC_ALARM_UNACKED, "c");
    see('g', 130, APC_ALARM_UNACKED, "ce"); /* of each area one */
}

static void of_those_that_come_at_one_evaluation_all_are_the_first_or_none(void **state)
{
    (void)state;
    go('c', 0, APC_ALARM_UNACKED);
    see('d', 0, APC_ALARM_UNACKED, "");
    see('a', 1, APC_ALARM_UNACKED, "cd");
    see('c', 2, APC_ALARM_SHELVED_ACTIVE, "d"); /* which is not announced */
    see('d', 3, APC_ALARM_SUPPRESSED_ACTIVE, "");
    see('d', 4, APC_ALARM_LATCHED_UNACKED, "d");
}

static void one_that_comes_again_is_where_it_was(void **state)
{
    (void)state;
    see('d', 0, APC_ALARM_UNACKED, "");
    for (int i = 1; i <= 10; i++) { /* it chatters */
        see('d', 10 * i - 5, APC_ALARM_NORMAL, "");
        see('d', 10 * i, APC_ALARM_UNACKED, i < 4 ? "" : "d");
        if (i == 3)
            see('a', 35, APC_ALARM_UNACKED, "d");
    }
    see('d', 105, APC_ALARM_NORMAL, "");
    see('d', 500, APC_ALARM_UNACKED, ""); /* alone; and what it began is still its own */
    see('c', 80, APC_ALARM_UNACKED, "");
    for (int i = 1; i < COMINGS; i++) {
        see('d', 500 + 100 * i - 1, APC_ALARM_NORMAL, "");
        see('d', 500 + 100 * i, APC_ALARM_UNACKED, i < COMINGS - 1 ? "" : "a"); /* too often to be known */
    }
}

static void keep_rows(struct apc_store *store, const char *names)
{
    for (; *names; names++)
        assert_int_equal(apc_store_append(store, &rows[*names - 'a'], 1), 1);
}

static void who_looks_for_the_first_time_finds_it_in_the_history(void **state)
{
    struct apc_store *store;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_int_equal(apc_store_init(store), 0);
    go('d', 0, APC_ALARM_UNACKED);
    go('c', 20, APC_ALARM_UNACKED);
    keep_rows(store, "cd");
    go('d', 30, APC_ALARM_ACKED);
    go('c', 30, APC_ALARM_ACKED);
    keep_rows(store, "cd");
    assert_first_out(store, "d");
    assert_int_equal(at[3].raised.last, NOW);
    assert_first_out(NULL, "d"); /* nothing has moved: nothing is asked */
    for (int i = 0; i < ALARMS; i++)
        at[i].raised = (struct alarm_raised){0};
    go('d', 40, APC_ALARM_NORMAL);
    keep_rows(store, "d");
    assert_first_out(store, ""); /* it came before what stands, and has gone */
    go('d', 300, APC_ALARM_UNACKED);
    keep_rows(store, "d");
    go('d', 310, APC_ALARM_ACKED); /* two rows at once, one of them not yet in the history */
    assert_first_out(store, "");
    go('a', 320, APC_ALARM_UNACKED);
    assert_first_out(store, "d");
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(what_nobody_has_acknowledged_can_be_once),
        T(who_acknowledges_after_another_is_told),
        T(shelving_ends_in_time),
        T(alarms_are_evaluated_as_long_as_ticks_come),
        T(what_became_of_a_request_is_that_of_its_own_switch),
        T(words_say_what_is_wanted),
        T(a_refusal_is_ones_own),
        cmocka_unit_test_setup(of_those_that_come_together_in_an_area_the_first_is_marked, begin_plant),
        cmocka_unit_test_setup(bursts_of_one_area_are_apart_by_more_than_a_minute, begin_plant),
        cmocka_unit_test_setup(of_those_that_come_at_one_evaluation_all_are_the_first_or_none, begin_plant),
        cmocka_unit_test_setup(one_that_comes_again_is_where_it_was, begin_plant),
        cmocka_unit_test_setup(who_looks_for_the_first_time_finds_it_in_the_history, begin_plant),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
