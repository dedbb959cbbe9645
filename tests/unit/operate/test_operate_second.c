/* SPDX-License-Identifier: BSD-3-Clause */
/* Two persons write: one asks, another approves or refuses. */
#include <stdlib.h>
#include <string.h>

#define OPERATED_SECOND "second_person = 300.0; "
#include "operated_plant.h"

#define S APC_NS_PER_S

static struct known_plant plant;

static int set_up(void **state)
{
    (void)state;
    open_operated_plant();
    ticked(BASE, 0);
    ticked(UPPER, 0);
    return known_load(&plant, store);
}

static int tear_down(void **state)
{
    (void)state;
    known_free(&plant);
    apc_store_close(store);
    return 0;
}

/* As a front end does; over < 0: a stop. Returns the fault's code, "": it is written. */
static const char *writes_at(apc_ns time, const char *author, const char *name, unsigned kind, double value,
                             double over, struct change_fault *why)
{
    struct change_target to;
    struct change change;
    struct operation o = {
        .plant = &plant.view, .change = &change, .n = 1, .author = author, .note = "", .time = time};

    assert_int_equal(change_find(&plant.view, name, kind, &to, why), 0);
    change_make(&plant.view, &to, value, &change);
    change.over = over > 0 ? over : 0;
    change.stop = over < 0;
    assert_int_equal(operation_read(&o, store), 0);
    const int rc = operation_begin(&o, store, why);
    operation_end(&o);
    return rc < 0 ? why->code : "";
}

static void asks(const char *author, const char *name, unsigned kind, double value, double over)
{
    struct change_fault why;
    if (strcmp(writes_at(0, author, name, kind, value, over, &why), "second") != 0)
        fail_msg("%s", why.text);
}

/* Returns the fault's code, "": it is done. */
static const char *answers(const char *author, const char *name, bool refuses, struct change_fault *why)
{
    struct approval approval = {0};
    struct operation o = {.plant = &plant.view, .author = author};
    int rc = operation_approve(&o, store, 0, name, refuses, &approval, why);
    if (rc == 0)
        rc = refuses ? operation_refuse(&o, store, why) : operation_begin(&o, store, why);
    operation_end(&o);
    free(approval.row);
    free(o.change);
    return rc < 0 ? why->code : "";
}

static int waits(void)
{
    struct waiting *waiting;
    const int n = waiting_load(&waiting, store, &plant.view);
    free(waiting);
    return n;
}

static struct apc_event last;

static int take_event(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    if (!strcmp(event->kind, "operator") && !strstr(event->text, "taken Local"))
        last = *event;
    return 0;
}

static void on_record(const char *author, const char *text)
{
    const struct apc_range all = {.last = 100};
    memset(&last, 0, sizeof last);
    assert_true(apc_store_events(store, &all, take_event, NULL) >= 0);
    assert_string_equal(last.text, text);
    assert_string_equal(last.source, author);
}

static double w(void)
{
    return newest(APC_SETPOINT, SET_W).value;
}

/* Promise(modes/two-persons): Where the file asks for a second person a write waits until somebody else approves it,
 *   whatever the front end, and the record says who has asked and who has approved. */
static void what_one_has_asked_for_another_approves(void **state)
{
    struct change_fault why;
    const int64_t before = newest(APC_SETPOINT, SET_W).seq;
    (void)state;

    assert_string_equal(writes_at(0, "anna", "w", CHANGE_SETPOINT, 12, 0, &why), "second");
    assert_string_equal(why.text, "w: 5 -> 12 waits 300 s for a second person");
    assert_int_equal(why.err, APC_EPERM);
    assert_int_equal(newest(APC_SETPOINT, SET_W).seq, before);
    assert_int_equal(waits(), 1);
    on_record("anna", "w: 5 -> 12 waits 300 s for a second person");

    assert_string_equal(answers("otto", "w", false, &why), "");
    assert_near(w(), 12, 0);
    assert_int_equal(waits(), 0);
    on_record("otto", "w: 5 -> 12 (requested by anna)");
    assert_string_equal(answers("otto", "w", false, &why), "second");
    assert_string_equal(why.text, "nothing of \"w\" waits for a second person");
}

/* Promise(modes/two-persons) */
static void nobody_approves_what_he_has_asked_for(void **state)
{
    struct change_fault why;
    (void)state;

    asks("anna", "w", CHANGE_SETPOINT, 12, 0);
    assert_string_equal(answers("anna", "setpoint.2", false, &why), "second");
    assert_string_equal(why.text, "anna requested it, so another person must approve it: w waits");
    assert_string_equal(writes_at(0, "", "u.Kp", CHANGE_TUNING, 0.3, 0, &why), "second");
    assert_string_equal(why.text, "u.Kp needs two persons, and the first one is not known: log in first");
    assert_near(w(), 5, 0);
    assert_int_equal(waits(), 1);
}

/* Whoever it was might be the one who approves it. */
static void what_nobody_known_has_asked_for_is_not_approved(void **state)
{
    struct change_fault why;
    (void)state;

    append((struct apc_sample){
        .table = APC_SETPOINT, .id = LOOPS_ASKED(SET_W), .time = apc_clock_utc(NULL), .value = 12});
    assert_string_equal(answers("otto", "w", false, &why), "second");
    assert_string_equal(
        why.text, "the person who requested w is not known, so it cannot be approved: request it again");
    assert_near(w(), 5, 0);
    assert_string_equal(answers("otto", "w", true, &why), "");
    assert_int_equal(waits(), 0);
}

/* Promise(modes/two-persons) */
static void what_waits_is_asked_for_once_and_withdrawn_or_refused(void **state)
{
    struct change_fault why;
    (void)state;

    asks("anna", "w", CHANGE_SETPOINT, 12, 0);
    assert_string_equal(writes_at(0, "otto", "w", CHANGE_SETPOINT, 7, 0, &why), "second");
    assert_memory_equal(why.text, "w waits for a second person: anna requested 12, 0.", 50);
    assert_string_equal(answers("anna", "w", true, &why), "");
    on_record("anna", "w: 5 -> 12 refused (requested by anna)");
    asks("otto", "w", CHANGE_SETPOINT, 7, 0);
    assert_string_equal(answers("anna", "w", true, &why), "");
    assert_int_equal(waits(), 0);
    assert_near(w(), 5, 0);
}

static void what_is_not_approved_in_time_is_asked_for_again(void **state)
{
    struct change_fault why;
    (void)state;

    assert_string_equal(writes_at(apc_clock_utc(NULL) - 301 * S, "anna", "w", CHANGE_SETPOINT, 12, 0, &why),
                        "second");
    assert_string_equal(answers("otto", "w", false, &why), "second");
    assert_string_equal(why.text, "the request of anna had to be approved within 300 s: request w again");
    asks("otto", "w", CHANGE_SETPOINT, 7, 0);
    assert_string_equal(answers("anna", "w", false, &why), "");
    assert_near(w(), 7, 0);
}

/* An output is written in Man alone, also where that changed while it waited. */
static void what_cannot_be_written_meanwhile_is_not(void **state)
{
    struct change_fault why;
    (void)state;

    append((struct apc_sample){.table = APC_OPMODE, .id = LOOP_U, .time = 1, .value = APC_MODE_MAN});
    asks("anna", "u", CHANGE_OUTPUT, 3, 0);
    append((struct apc_sample){.table = APC_OPMODE, .id = LOOP_U, .time = 2, .value = APC_MODE_AUTO});
    assert_string_equal(answers("otto", "u", false, &why), "mode");
    append((struct apc_sample){.table = APC_OPMODE, .id = LOOP_U, .time = 3, .value = APC_MODE_MAN});
    assert_string_equal(answers("otto", "u", false, &why), "");
    assert_near(newest(APC_MANUAL, LOOP_U).value, 3, 0);
}

/* An output and its loop's mode have one name; what was never approved is in nobody's way. */
static void of_two_that_wait_under_one_name_it_is_said_which(void **state)
{
    const apc_ns former = apc_clock_utc(NULL) - 301 * S;
    struct change_fault why;
    (void)state;

    append((struct apc_sample){.table = APC_OPMODE, .id = LOOP_U, .time = 1, .value = APC_MODE_MAN});
    assert_string_equal(writes_at(former, "anna", "u", CHANGE_MODE, APC_MODE_AUTO, 0, &why), "second");
    assert_string_equal(writes_at(former, "anna", "u", CHANGE_OUTPUT, 2, 0, &why), "second");
    asks("anna", "u", CHANGE_MODE, APC_MODE_AUTO, 0);
    assert_string_equal(answers("otto", "u", true, &why), "");
    asks("anna", "u", CHANGE_OUTPUT, 3, 0);
    asks("anna", "u", CHANGE_MODE, APC_MODE_AUTO, 0);
    assert_string_equal(answers("otto", "u", false, &why), "second");
    assert_non_null(strstr(why.text, "two of \"u\" wait: say which, "));
    assert_string_equal(answers("otto", "manual.1", false, &why), "");
    assert_near(newest(APC_MANUAL, LOOP_U).value, 3, 0);
    assert_string_equal(answers("otto", "u", true, &why), "");
    assert_int_equal(waits(), 0);
}

/* Its tuning and modes; a ramp ends at once, as that is the safe side. */
static void all_of_a_controller_takes_two_and_a_ramp_is_stopped_by_one(void **state)
{
    struct change_fault why;
    (void)state;

    asks("anna", "u.Kp", CHANGE_TUNING, 0.3, 0);
    asks("anna", "u", CHANGE_MODE, APC_MODE_MAN, 0);
    assert_int_equal(waits(), 2);
    assert_string_equal(writes_at(0, "anna", "r", CHANGE_SETPOINT, 2, 0, &why), "");
    assert_string_equal(writes_at(0, "anna", "upper.r", CHANGE_MODE, APC_MODE_MAN, 0, &why), "");

    asks("anna", "w", CHANGE_SETPOINT, 8, 60);
    assert_string_equal(answers("otto", "w", false, &why), "");
    assert_near(newest(APC_SETPOINT, LOOPS_RATE(SET_W)).value, 0.05, 1e-12);
    assert_string_equal(writes_at(0, "anna", "w", CHANGE_SETPOINT, 0, -1, &why), "");
}

/* Two approve at once: one of them. Somebody refuses between the look and the write: nothing is written. */
static void of_two_at_once_one_has_his_way(void **state)
{
    struct change_fault why;
    struct approval approval = {0};
    struct operation o = {.plant = &plant.view, .author = "otto"};
    (void)state;

    asks("anna", "w", CHANGE_SETPOINT, 12, 0);
    assert_int_equal(operation_approve(&o, store, 0, "w", false, &approval, &why), 0);
    assert_string_equal(answers("carl", "w", true, &why), "");
    assert_int_equal(operation_begin(&o, store, &why), APC_ECONFLICT);
    assert_string_equal(why.code, "second");
    assert_string_equal(why.text, "another user has approved or refused it just now");
    assert_near(w(), 5, 0);
    operation_end(&o);
    free(approval.row);
    free(o.change);
}

/* Promise(run/reason-has-room): A reason that its event has no room for is refused before anything is written. */
static void a_reason_that_its_event_has_no_room_for_is_refused(void **state)
{
    char reason[81] = {0}, *room;
    const char note[] =
        " (from 2001:0db8:0000:0000:0000:0000:1428:57ab, through the gateway of the eastern works)";
    struct change change;
    struct change_target to;
    struct change_fault why;
    struct approval approval = {0};
    struct operation o = {
        .plant = &plant.view, .change = &change, .n = 1, .author = "anna", .note = note, .reason = reason};
    (void)state;

    memset(reason, 'x', 80);
    assert_int_equal(change_find(&plant.view, "w", CHANGE_SETPOINT, &to, &why), 0);
    change_make(&plant.view, &to, 12, &change);
    assert_int_equal(operation_read(&o, store), 0);
    assert_int_equal(operation_begin(&o, store, &why), APC_EINVAL);
    assert_string_equal(why.code, "value");
    assert_int_equal(waits(), 0);
    room = strstr(why.text, "at most ");
    assert_non_null(room);
    reason[strtol(room + 8, NULL, 10)] = '\0'; /* as it says */
    assert_int_equal(operation_begin(&o, store, &why), APC_EPERM);
    assert_string_equal(why.code, "second");
    assert_int_equal(waits(), 1);
    on_record("anna", last.text);
    assert_string_equal(last.text + 191 - strlen(reason), reason);

    struct operation no = {.plant = &plant.view, .author = "bob", .note = note, .reason = reason};
    memset(reason, 'x', 80);
    assert_int_equal(operation_approve(&no, store, 0, "w", true, &approval, &why), 0);
    assert_int_equal(operation_refuse(&no, store, &why), APC_EINVAL);
    assert_int_equal(waits(), 1);
    free(approval.row);
    free(no.change);
}

static struct apc_request of_all = {
    .id = 1, .left = S, .table = APC_OPMODE, .value = APC_MODE_MAN, .seq = -1, .author = "anna"};
static char outcome[192];

static int give_of_all(void *ctx, apc_request_fn fn, void *fn_ctx)
{
    (void)ctx;
    (void)fn(fn_ctx, &of_all);
    return 1;
}

static int take_outcome(void *ctx, int64_t id, int64_t seq, const char *text)
{
    (void)ctx;
    (void)id;
    assert_int_equal(seq, 0);
    snprintf(outcome, sizeof outcome, "%s", text);
    return 0;
}

/* Promise(modes/two-persons) */
static void the_mode_of_all_from_a_history_is_no_way_round(void **state)
{
    const struct requests_source from = {
        .give = give_of_all, .answer = take_outcome, .marks = REQUESTS_OF_HISTORY};
    const int64_t before = newest(APC_OPMODE, LOOP_U).seq;
    struct requests *requests;
    struct apc_error error;
    (void)state;

    of_all.time = apc_clock_utc(NULL) / 1000 * 1000;
    assert_int_equal(requests_create_of(&requests, store, &from, 60 * S, &error), 0);
    assert_int_equal(requests_step(requests), 0);
    assert_string_equal(outcome, "refused: the modes of base take two persons: ask for one loop at a time");
    assert_int_equal(newest(APC_OPMODE, LOOP_U).seq, before);
    requests_destroy(requests);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(what_one_has_asked_for_another_approves),
        T(nobody_approves_what_he_has_asked_for),
        T(what_nobody_known_has_asked_for_is_not_approved),
        T(what_waits_is_asked_for_once_and_withdrawn_or_refused),
        T(what_is_not_approved_in_time_is_asked_for_again),
        T(what_cannot_be_written_meanwhile_is_not),
        T(of_two_that_wait_under_one_name_it_is_said_which),
        T(all_of_a_controller_takes_two_and_a_ramp_is_stopped_by_one),
        T(of_two_at_once_one_has_his_way),
        T(a_reason_that_its_event_has_no_room_for_is_refused),
        T(the_mode_of_all_from_a_history_is_no_way_round),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
