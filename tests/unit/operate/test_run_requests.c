/* SPDX-License-Identifier: BSD-3-Clause */
/* What people ask for from afar: what is refused, with which words, and what becomes of what is written. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "operated_plant.h"

#define S    APC_NS_PER_S
#define MOST (60 * S)

static struct requests *requests;
static struct apc_request asked;
static struct apc_error why;

/* ---- Where requests come from ---------------------------------------------------------------- */

static struct {
    int64_t id, seq;
    char outcome[192];
    int n, give_fails, answer_fails;
} said;

static int give(void *ctx, apc_request_fn fn, void *fn_ctx)
{
    (void)ctx;
    if (said.give_fails)
        return said.give_fails;
    (void)fn(fn_ctx, &asked);
    return 1;
}

static int answer(void *ctx, int64_t id, int64_t seq, const char *outcome)
{
    (void)ctx;
    said.id = id;
    said.seq = seq;
    said.n++;
    snprintf(said.outcome, sizeof said.outcome, "%s", outcome ? outcome : "(to come)");
    return said.answer_fails;
}

static const char *source_error(void *ctx)
{
    (void)ctx;
    return "nobody is there";
}

/* ---- The plant ------------------------------------------------------------------------------- */

static int set_up(void **state)
{
    const struct requests_source from = {
        .give = give, .answer = answer, .error = source_error, .marks = REQUESTS_OF_BROKER};
    (void)state;
    memset(&said, 0, sizeof said);
    asked.id = 0;
    open_operated_plant();
    ticked(BASE, 0);
    ticked(UPPER, 0);
    return requests_create_of(&requests, store, &from, MOST, &why);
}

static int tear_down(void **state)
{
    (void)state;
    requests_destroy(requests);
    apc_store_close(store);
    return 0;
}

static void ask(enum apc_table table, int variable, double value)
{
    asked = (struct apc_request){.id = asked.id + 1,
                                 .time = apc_clock_utc(NULL) / 1000 * 1000, /* as stores keep it */
                                 .age = S / 10,
                                 .left = 3600 * S,
                                 .table = table,
                                 .variable = variable,
                                 .value = value,
                                 .seq = -1,
                                 .author = "ann",
                                 .role = "apc_operator",
                                 .reason = "because"};
}

static int step(void)
{
    const int rc = requests_step(requests);
    if (rc < 0)
        fail_msg("%s", requests_error(requests));
    return rc;
}

/* It is answered at once, and nothing was written. */
static void assert_refused(const char *with)
{
    const int64_t before = newest(asked.table, asked.variable).seq;
    assert_int_equal(step(), 0);
    assert_int_equal(said.id, asked.id);
    assert_int_equal(said.seq, 0);
    assert_has(said.outcome, with);
    assert_int_equal(newest(asked.table, asked.variable).seq, before);
}

/* It is written, and asked for again with its row's number. */
static int64_t assert_written(void)
{
    assert_int_equal(step(), 1);
    assert_int_equal(said.id, asked.id);
    assert_string_equal(said.outcome, "(to come)");
    const struct apc_sample row = newest(asked.table, asked.variable);
    assert_int_equal(said.seq, row.seq);
    assert_near(row.value, asked.value, 0);
    assert_int_equal(row.author, apc_store_author(store, "ann"));
    asked.seq = row.seq;
    return row.seq;
}

static void assert_settled(const char *outcome)
{
    assert_int_equal(step(), 0);
    assert_int_equal(said.seq, asked.seq);
    assert_string_equal(said.outcome, outcome);
}

static void assert_open(void)
{
    const int before = said.n;
    assert_int_equal(step(), 1);
    assert_int_equal(said.n, before);
}

static char told[4096]; /* a line for each event */

static int take_event(void *ctx, const struct apc_event *event)
{
    const size_t n = strlen(told);
    (void)ctx;
    snprintf(told + n, sizeof told - n, "%s\n", event->text);
    assert_string_equal(event->kind, "operator");
    assert_string_equal(event->source, "ann");
    return 0;
}

static const char *events(void)
{
    told[0] = '\0';
    assert_true(apc_store_events(store, &(struct apc_range){.since = 0}, take_event, NULL) >= 0);
    return told;
}

/* ---- Refused --------------------------------------------------------------------------------- */

static void what_is_asked_for_at_another_time_is_too_late(void **state)
{
    (void)state;
    ask(APC_SETPOINT, SET_R, 2);
    asked.age = MOST + 5 * S; /* whatever our clock says */
    assert_refused(
        "refused: too late, it was requested 65.0 s ago by the database's clock, and 60 s are allowed");
    ask(APC_SETPOINT, SET_R, 2);
    asked.time -= MOST + 5 * S;
    assert_refused(" s ago by the loop's clock, and 60 s are allowed");
    ask(APC_SETPOINT, SET_R, 2);
    asked.left = -4 * S;
    assert_refused("refused: too late, it was to be done until 4.0 s ago");
    ask(APC_SETPOINT, SET_R, 2);
    asked.left = 0;
    assert_refused("refused: too late, it was to be done until ");
    ask(APC_SETPOINT, SET_R, 2);
    asked.time += MOST + 5 * S;
    assert_refused(" s ahead: a clock is wrong");
    ask(APC_SETPOINT, SET_R, 2);
    asked.time += 1800 * S;
    asked.age = -MOST - 5 * S;
    assert_refused("refused: it comes from ");
    ask(APC_SETPOINT, SET_R, 2);
    asked.time += MOST - 5 * S; /* a little */
    asked.age = 5 * S - MOST;
    assert_written();
    ask(APC_SETPOINT, SET_R, 2);
    asked.time -= MOST - 10 * S;
    asked.age = MOST - 10 * S;
    asked.left = 1;
    assert_written();
}

static void what_makes_no_sense_is_refused_with_its_reason(void **state)
{
    static const struct {
        enum apc_table table;
        int variable;
        double value;
        const char *said;
    } cases[] = {
        {APC_SETPOINT, SET_R, 50.5, "refused: r = 50.5 lies outside its limits -50 to 50"},
        {APC_SETPOINT, SET_R, -50.5, "refused: r = -50.5 lies outside its limits -50 to 50"},
        {APC_SETPOINT, 9, 1, "refused: setpoint.9 is not described, so its limits are not known"},
        {APC_TUNING, 99, 1, "refused: tuning.99 is not described"},
        {APC_OPMODE, LOOP_U, 1.5, "refused: 1.5 is no mode: 0 Man, 1 Auto, 2 out of service, 3 Cas"},
        {APC_OPMODE, LOOP_U, 4, "refused: u = 4 lies outside its limits 0 to 3"},
        {APC_SETPOINT, SET_R, (double)NAN, "refused: \"nan\" is not a finite number"},
        {APC_OPMODE, 0, 4, "refused: mode = 4 lies outside its limits 0 to 3"},
        {APC_OPMODE, 0, 0.5, "refused: 0.5 is no mode"},
        {APC_OPMODE, LOOP_R, APC_MODE_CAS,
         "refused: upper.r cannot be in Cas: no controller moves its setpoint"},
        {APC_OPMODE, REQUESTS_OF_HISTORY, 1, "is written by programs only"},
        {APC_OPMODE, REQUESTS_OF_BROKER + 3, 1, "is written by programs only"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        ask(cases[i].table, cases[i].variable, cases[i].value);
        assert_refused(cases[i].said);
    }
    assert_string_equal(events(), "");
}

static void what_nobody_would_apply_is_not_written(void **state)
{
    (void)state;
    ticked(BASE, 40 * S);
    ask(APC_SETPOINT, SET_R, 2);
    assert_refused(
        "refused: no controller applies it: controller base's last tick was 40 s ago. Nothing was written");
    ticked(BASE, 3 * S); /* three periods, and a little more */
    assert_written();
}

static void what_has_never_ticked_applies_nothing(void **state)
{
    struct experiment e;
    const struct experiment_source source = {.file = "test", .text = operated_text};
    (void)state;
    apc_store_close(store);
    assert_int_equal(experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why), 0);
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0 && provision(store, &e, PROVISION_KEEP) >= 0);
    experiment_free(&e);
    requests_destroy(requests);
    assert_int_equal(requests_create_of(&requests, store,
                                        &(struct requests_source){.give = give,
                                                                  .answer = answer,
                                                                  .error = source_error,
                                                                  .marks = REQUESTS_OF_BROKER},
                                        MOST, &why),
                     0);
    ask(APC_SETPOINT, SET_W, 2);
    assert_refused(
        "refused: no controller applies it: controller upper has never ticked. Nothing was written");
    ask(APC_OPMODE, 0, APC_MODE_MAN); /* whoever comes will */
    assert_written();
    assert_settled("written");
}

/* ---- Written --------------------------------------------------------------------------------- */

static void what_was_written_is_settled_by_what_its_controller_says(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    const int64_t seq = assert_written();
    const struct apc_sample mark = newest(APC_OPMODE, REQUESTS_OF_BROKER); /* the first that is free */
    assert_near(mark.value, (double)asked.id, 0);
    assert_int_equal(mark.time, asked.time);
    assert_int_equal(mark.origin, seq);
    assert_open();
    became(APC_TUNING, KP, seq - 1, 0.2, APC_GOOD); /* it has not looked yet */
    assert_open();
    became(APC_TUNING, KP, seq, 0.4, APC_GOOD);
    assert_settled("applied");
    became(APC_TUNING, KP, seq + 1, 0.7, APC_GOOD);
    assert_settled("superseded: it is 0.7 now");
    assert_string_equal(events(), "u.Kp: 0.2 -> 0.4 (request 1 of apc_operator): because\n");
    assert_int_equal(newest(APC_TUNING, KP).seq, seq); /* it was done once */
}

static void a_refusal_is_told_with_its_words_or_after_a_while_without(void **state)
{
    struct apc_event event = {.severity = APC_EVENT_WARNING, .kind = "rejected", .source = "base"};
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    const int64_t seq = assert_written();
    became(APC_TUNING, KP, seq, 0.2, APC_BAD);
    assert_open(); /* the words may still come */
    append((struct apc_sample){.table = APC_ACTUAL,
                               .id = apc_variable_number(APC_TUNING, KP),
                               .time = apc_clock_utc(NULL) - 2 * S,
                               .value = 0.2,
                               .origin = seq,
                               .status = APC_BAD});
    assert_settled("refused: 0.2 stays in force");
    event.time = asked.time - 1; /* of an earlier one */
    snprintf(event.text, sizeof event.text, "Kp: it was too much");
    assert_int_equal(apc_store_append_events(store, &event, 1), 1);
    assert_settled("refused: 0.2 stays in force");
    event.time = asked.time;
    snprintf(event.text, sizeof event.text, "Kp = 0.4: it is too much");
    assert_int_equal(apc_store_append_events(store, &event, 1), 1);
    assert_settled("refused: Kp = 0.4: it is too much");
}

static void an_output_is_for_loops_in_man(void **state)
{
    (void)state;
    append((struct apc_sample){
        .table = APC_OPMODE, .id = LOOP_U, .time = apc_clock_utc(NULL), .value = APC_MODE_AUTO});
    ask(APC_MANUAL, LOOP_U, 3);
    assert_refused("refused: u is controlled in mode Auto: set the target mode of u to Man first");
    append((struct apc_sample){
        .table = APC_OPMODE, .id = LOOP_U, .time = apc_clock_utc(NULL), .value = APC_MODE_MAN});
    ask(APC_SETPOINT, SET_R, 3);
    assert_refused("refused: r follows y while u is in Man");
    ask(APC_MANUAL, LOOP_U, 21);
    assert_refused("refused: u = 21 lies outside its limits -20 to 20");
    ask(APC_MANUAL, LOOP_U, 3);
    const int64_t seq = assert_written();
    append((struct apc_sample){.table = APC_ACTUAL,
                               .id = apc_variable_number(APC_MANUAL, LOOP_U),
                               .time = apc_clock_utc(NULL) - 2 * S,
                               .origin = seq,
                               .status = APC_BAD});
    assert_settled("refused: its loop is not in Man");
    assert_string_equal(events(), "u: no value yet -> 3 (request 4 of apc_operator): because\n");
}

static void what_is_not_confirmed_for_long_is_settled_so(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    assert_written();
    asked.age = MOST + 3 * S; /* as long as anybody may ask, three periods and 2 s */
    assert_open();
    asked.age = MOST + 4 * S;
    assert_settled("written, but controller base does not confirm it");
    ask(APC_OPMODE, 0, APC_MODE_AUTO); /* of all: each loop has its own row */
    assert_written();
    assert_settled("written");
}

static void what_opens_a_cascade_or_is_the_schedulers_is_said(void **state)
{
    (void)state;
    ask(APC_SETPOINT, SET_R, 2);
    asked.reason[0] = '\0';
    assert_written();
    assert_near(newest(APC_OPMODE, LOOP_U).value, APC_MODE_AUTO, 0);
    append((struct apc_sample){
        .table = APC_OPMODE, .id = LOOPS_OWNER(SET_W), .time = apc_clock_utc(NULL), .value = 1});
    ask(APC_SETPOINT, SET_W, 7);
    assert_written();
    assert_near(newest(APC_OPMODE, LOOPS_OWNER(SET_W)).value, 0, 0);
    char expected[400];
    snprintf(expected, sizeof expected,
             "r: 1 -> 2 (request %lld of apc_operator)\nr taken Local, cascade open (request %lld of "
             "apc_operator)\n"
             "w: 5 -> 7 (request %lld of apc_operator): because\nw taken Local, the scheduler stands aside "
             "(request %lld of apc_operator): because\n",
             (long long)asked.id - 1, (long long)asked.id - 1, (long long)asked.id, (long long)asked.id);
    assert_string_equal(events(), expected);
}

/* Promise(links/broker-named-signals) */
static void what_comes_from_ahead_is_refused_where_its_source_says_so(void **state)
{
    const struct requests_source from = {
        .give = give, .answer = answer, .error = source_error, .marks = REQUESTS_OF_BROKER, .ahead = S};

    (void)state;
    requests_destroy(requests);
    assert_int_equal(requests_create_of(&requests, store, &from, MOST, &why), 0);
    ask(APC_TUNING, KP, 0.4);
    asked.time += 5 * S;
    asked.age = -5 * S;
    assert_refused("s ahead: a clock is wrong");
    ask(APC_TUNING, KP, 0.4);
    asked.time += S / 2;
    asked.age = -S / 2;
    (void)assert_written();
}

/* ---- Once ------------------------------------------------------------------------------------ */

static void who_was_ended_before_he_answered_answers_and_does_it_no_more(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    const int64_t seq = assert_written();
    asked.seq = -1; /* the answer was lost; its event is there */
    assert_int_equal(step(), 1);
    assert_string_equal(said.outcome, "(to come)");
    assert_int_equal(said.seq, seq);
    assert_int_equal(newest(APC_TUNING, KP).seq, seq);
    const char *once = strchr(events(), '\n');
    assert_string_equal(once, "\n");
}

/* The row and its mark are there, its event is not. */
static void an_event_that_is_missing_is_made_up_for(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    append((struct apc_sample){.table = APC_OPMODE,
                               .id = REQUESTS_OF_BROKER + 7,
                               .time = asked.time,
                               .value = (double)asked.id,
                               .origin = 2});
    became(APC_TUNING, KP, 2, 0.4, APC_GOOD);
    assert_int_equal(step(), 0);
    assert_int_equal(said.seq, 2);
    assert_string_equal(said.outcome, "applied");
    char expected[100];
    snprintf(expected, sizeof expected, "u.Kp: no value yet -> 0.4 (request %lld of apc_operator): because\n",
             (long long)asked.id);
    assert_string_equal(events(), expected);
}

/* Whatever their ids are: a recipe, of one time. */
/* Promise(links/broker-named-signals) */
static void as_many_of_one_time_as_there_are_marks_are_done_each_once(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.0);
    const struct apc_request first = asked;
    for (int k = 0; k < REQUESTS_MARKS; k++) {
        asked = first;
        asked.id = 1 + REQUESTS_MARKS * (int64_t)k;
        asked.value = 0.01 * k;
        (void)assert_written();
    }
    for (int k = 0; k < REQUESTS_MARKS; k++) { /* and again */
        const int64_t seq = newest(APC_TUNING, KP).seq;
        asked = first;
        asked.id = 1 + REQUESTS_MARKS * (int64_t)k;
        asked.value = 0.01 * k;
        assert_true(step() >= 0);
        assert_int_equal(newest(APC_TUNING, KP).seq, seq);
        assert_true(said.seq > 0);
    }
    /* that of which nobody can say whether it was */
    asked.id = 7;
    assert_refused("refused: later requests were carried out, and whether this one was is not known: look at "
                   "the value, then ask again");
    asked.id = 8;
    asked.time -= S;
    assert_refused("refused: later requests were carried out, and whether this one was is not known: look at "
                   "the value, then ask again");
    asked.time += S + APC_NS_PER_US;
    (void)assert_written();
}

static void a_source_that_fails_is_said_and_asked_again(void **state)
{
    (void)state;
    ask(APC_TUNING, KP, 0.4);
    said.give_fails = APC_ECONN;
    assert_int_equal(requests_step(requests), APC_ECONN);
    assert_string_equal(requests_error(requests), "nobody is there");
    said.give_fails = 0;
    said.answer_fails = APC_ETIMEDOUT;
    assert_int_equal(requests_step(requests), APC_ETIMEDOUT);
    assert_string_equal(requests_error(requests), "nobody is there");
    assert_near(newest(APC_TUNING, KP).value, 0.4, 0);
    said.answer_fails = 0;
    assert_int_equal(step(), 1);
    assert_int_equal(newest(APC_TUNING, KP).seq, said.seq);
    assert_string_equal(requests_error(requests), "");
}

/* The limit that is named is the one beyond which it lies, whatever its sign. */
static void a_value_beyond_its_only_limit_is_told_which(void **state)
{
    static const struct {
        double low, high, value;
        const char *text;
    } of[] = {{5.0, APC_VALUE_MAX, 3.0, "q = 3 lies below its limit 5"},
              {-APC_VALUE_MAX, -5.0, -3.0, "q = -3 lies above its limit -5"},
              {-APC_VALUE_MAX, 5.0, 6.0, "q = 6 lies above its limit 5"},
              {-5.0, APC_VALUE_MAX, -6.0, "q = -6 lies below its limit -5"},
              {-APC_VALUE_MAX, APC_VALUE_MAX, 1e300, "q = 1e+300 lies above its limit 1e+300"},
              {-5.0, -4.0, 3.0, "q = 3 lies outside its limits -5 to -4"}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct change_fault fault;
        assert_int_equal(change_limits("q", of[i].low, of[i].high, of[i].value, &fault), APC_ERANGE);
        assert_string_equal(fault.text, of[i].text);
    }
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(what_was_written_is_settled_by_what_its_controller_says),
        T(what_is_asked_for_at_another_time_is_too_late),
        T(what_makes_no_sense_is_refused_with_its_reason),
        T(what_nobody_would_apply_is_not_written),
        T(what_has_never_ticked_applies_nothing),
        T(a_refusal_is_told_with_its_words_or_after_a_while_without),
        T(an_output_is_for_loops_in_man),
        cmocka_unit_test(a_value_beyond_its_only_limit_is_told_which),
        T(what_is_not_confirmed_for_long_is_settled_so),
        T(what_opens_a_cascade_or_is_the_schedulers_is_said),
        T(who_was_ended_before_he_answered_answers_and_does_it_no_more),
        T(an_event_that_is_missing_is_made_up_for),
        T(as_many_of_one_time_as_there_are_marks_are_done_each_once),
        T(what_comes_from_ahead_is_refused_where_its_source_says_so),
        T(a_source_that_fails_is_said_and_asked_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
