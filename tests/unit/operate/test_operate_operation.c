/* SPDX-License-Identifier: BSD-3-Clause */
/* The steps of a write: what is asked before, what is written and recorded, and what is said of it afterwards. */
#include <stdlib.h>
#include <string.h>

#include "operated_plant.h"

#define S APC_NS_PER_S

static struct known_plant plant;

/* What one operator writes. */
struct desk {
    struct operation operation;
    struct change change[2];
};

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

/* One more change: this variable is to become @p value. */
static void wants(struct desk *d, const char *author, const char *name, unsigned kind, double value)
{
    struct change_target to;
    struct change_fault why;

    if (change_find(&plant.view, name, kind, &to, &why) < 0)
        fail_msg("%s", why.text);
    change_make(&plant.view, &to, value, &d->change[d->operation.n]);
    d->operation.plant = &plant.view;
    d->operation.change = d->change;
    d->operation.author = author;
    d->operation.n++;
}

/* Of u.Kp. */
static struct desk desk_of(const char *author, double value)
{
    struct desk d = {0};

    wants(&d, author, "u.Kp", CHANGE_TUNING, value);
    d.operation.change = NULL; /* it is about to move */
    return d;
}

static void begin(struct desk *d)
{
    struct change_fault why;

    d->operation.change = d->change;
    assert_int_equal(operation_read(&d->operation, store), 0);
    if (operation_begin(&d->operation, store, &why) < 0)
        fail_msg("%s", why.text);
}

static int poll(struct desk *d)
{
    return operation_poll(&d->operation, store);
}

/* As if so much longer had been waited. */
static void waited(struct desk *d, apc_ns more)
{
    d->operation.asked -= d->operation.asked ? more : 0;
    d->operation.begun -= d->operation.begun ? more : 0;
    d->operation.refused -= d->operation.refused ? more : 0;
}

static void finish(struct desk *d, size_t i, int err, const char *code, const char *text)
{
    struct change_fault said;

    assert_int_equal(operation_finish(&d->operation, i, &said), err);
    assert_string_equal(said.code, code);
    if (strncmp(said.text, text, strlen(text)) != 0)
        fail_msg("\"%s\" instead of \"%s\"", said.text, text);
}

static struct {
    int n;
    char text[8][256];
} events;

static int take_event(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    if (!strcmp(event->kind, "operator") && events.n < 8)
        snprintf(events.text[events.n++], sizeof events.text[0], "%s: %s", event->source, event->text);
    return 0;
}

static void read_events(void)
{
    const struct apc_range all = {.last = 100};

    memset(&events, 0, sizeof events);
    assert_true(apc_store_events(store, &all, take_event, NULL) >= 0);
}

/* ---- Before ---------------------------------------------------------------------------------- */

static void who_ticks_is_ready_at_once(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    assert_int_equal(operation_ready(&d.operation, store, &why), 1);
}

/* Of a tick that is old by the clocks of two hosts it is not known: the next one says. */
static void a_controller_by_another_clock_is_known_by_its_next_tick(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    for (int sign = -1; sign < 2; sign += 2) {
        d.operation.asked = 0;
        ticked(BASE, sign * 3600 * S);
        assert_int_equal(operation_ready(&d.operation, store, &why), 0);
        ticked(BASE, sign * 3600 * S);
        assert_int_equal(operation_ready(&d.operation, store, &why), 1);
    }
}

static void who_is_gone_is_named_and_nothing_is_written(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    const int64_t before = newest(APC_TUNING, KP).seq;
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    ticked(BASE, 300 * S);
    assert_int_equal(operation_ready(&d.operation, store, &why), 0);
    waited(&d, change_patience(&d.change[0]));
    assert_int_equal(operation_ready(&d.operation, store, &why), APC_EPERM);
    assert_string_equal(why.code, "nobody");
    assert_string_equal(
        why.text, "no controller applies it: controller base's last tick was 5 min ago. Nothing was written");
    assert_int_equal(newest(APC_TUNING, KP).seq, before);
    read_events();
    assert_int_equal(events.n, 0);
}

/* Who follows the ticks is a little behind, and does not wait: the store says. */
static void who_follows_the_ticks_is_told_of_newer_ones(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    d.operation.followed = true;
    ticked(BASE, 300 * S);
    assert_int_equal(operation_ready(&d.operation, store, &why),
                     APC_EPERM); /* none was seen, and it is old */
    assert_string_equal(why.code, "nobody");
    d.change[0].ticked = d.change[0].tick.seq;
    assert_int_equal(operation_ready(&d.operation, store, &why), APC_EPERM); /* that was seen */
    ticked(BASE, 300 * S);
    assert_int_equal(operation_ready(&d.operation, store, &why), 1); /* by another clock it was just now */
    d.change[0].ticked = 0;
    ticked(BASE, 0);
    assert_int_equal(operation_ready(&d.operation, store, &why), 1);
    ticked(BASE,
           -300 * S); /* the clock of its host is ahead; of several changes this one was seen to be taken */
    assert_int_equal(operation_look(&d.operation, store), 0);
    d.change[0].ticked = d.change[0].tick.seq;
    d.change[0].ticks = true;
    assert_int_equal(operation_ready(&d.operation, store, &why), 1);
    d.change[0].ticks = false;
    assert_int_equal(operation_ready(&d.operation, store, &why), APC_EPERM);
}

static void who_has_said_that_it_stops_is_not_ready(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct apc_event stop = {.time = apc_clock_utc(NULL) + S,
                             .severity = APC_EVENT_INFO,
                             .kind = "stop",
                             .source = "apc-controller base"};
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    assert_int_equal(apc_store_append_events(store, &stop, 1), 1);
    assert_int_equal(operation_ready(&d.operation, store, &why), 0);
}

/* ---- Written, and what became of it ------------------------------------------------------------ */

static void what_is_in_force_is_settled_and_on_record(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    (void)state;

    begin(&d);
    assert_int_equal(poll(&d), 0);
    assert_int_equal(newest(APC_TUNING, KP).seq, d.change[0].after.seq);
    became(APC_TUNING, KP, d.change[0].after.seq, 0.3, APC_GOOD);
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, 0, "applied", "applied");
    became(APC_TUNING, KP, d.change[0].after.seq + 1, 0.4, APC_GOOD); /* it was in force */
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, 0, "applied", "applied");
    read_events();
    assert_int_equal(events.n, 1);
    assert_string_equal(events.text[0], "anna: u.Kp: 0.2 -> 0.3");
}

static void a_controller_that_never_answers_is_waited_for_so_long_only(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    (void)state;

    begin(&d);
    assert_int_equal(poll(&d), 0);
    assert_int_equal(operation_wait(&d.operation, store, 0), 0);
    waited(&d, change_patience(&d.change[0]));
    ticked(BASE, 0);
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, APC_ETIMEDOUT, "unconfirmed", "written, but controller base does not confirm it");
}

/* It was there when it was asked, and is not when it is waited for. */
static void a_controller_that_dies_in_between_is_said_to_be_gone(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    assert_int_equal(operation_ready(&d.operation, store, &why), 1);
    begin(&d);
    ticked(BASE, 300 * S);         /* that was its last one */
    assert_int_equal(poll(&d), 0); /* another may take its place */
    waited(&d, change_patience(&d.change[0]));
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, APC_ETIMEDOUT, "nobody",
           "written, but no controller applies it: controller base's last tick was 5 min ago");
}

static void who_takes_its_place_applies_it(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    (void)state;

    begin(&d);
    ticked(BASE, 300 * S);
    assert_int_equal(poll(&d), 0);
    ticked(BASE, 0);
    became(APC_TUNING, KP, d.change[0].after.seq, 0.3, APC_GOOD);
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, 0, "applied", "applied");
}

static void a_refusal_waits_for_its_words_but_not_for_long(void **state)
{
    (void)state;
    for (int words = 0; words < 2; words++) {
        struct desk d = desk_of("anna", 0.3 + words);
        struct apc_event event = {
            .severity = APC_EVENT_WARNING, .kind = "rejected", .text = "u.Kp: it is too much"};

        begin(&d);
        became(APC_TUNING, KP, d.change[0].after.seq, 0.2, APC_BAD);
        assert_int_equal(poll(&d), 0);
        event.time = d.operation.time + APC_NS_PER_MS;
        if (words)
            assert_int_equal(apc_store_append_events(store, &event, 1), 1);
        waited(&d, words ? 0 : S);
        assert_int_equal(poll(&d), 1);
        finish(&d, 0, APC_EPERM, "refused",
               words ? "refused: u.Kp: it is too much" : "refused: 0.2 stays in force");
    }
}

static void of_several_all_are_waited_for(void **state)
{
    struct desk d = {0};
    (void)state;

    wants(&d, "anna", "u.Kp", CHANGE_TUNING, 0.3);
    wants(&d, "anna", "upper.r.Kp", CHANGE_TUNING, 0.4);
    begin(&d);
    became(APC_TUNING, d.change[0].to.id, d.change[0].after.seq, 0.3, APC_GOOD);
    assert_int_equal(poll(&d), 0);
    ticked(BASE, 0);
    ticked(UPPER, 0);
    waited(&d, change_patience(&d.change[1]));
    assert_int_equal(poll(&d), 1);
    finish(&d, 0, 0, "applied", "applied");
    finish(&d, 1, APC_ETIMEDOUT, "unconfirmed", "written, but controller upper does not confirm it");
    read_events();
    assert_int_equal(events.n, 2);
}

/* ---- Two operators ------------------------------------------------------------------------------ */

/* Both saw the same: the second is told, with what is newest, and nothing of his is on record. */
static void of_two_who_saw_the_same_one_is_told(void **state)
{
    struct desk anna = desk_of("anna", 0.3), otto = desk_of("otto", 0.4);
    const int64_t seen = newest(APC_TUNING, KP).seq;
    struct change_fault why;
    (void)state;

    anna.change[0].after.seq = otto.change[0].after.seq = seen;
    begin(&anna);
    otto.operation.change = otto.change;
    assert_int_equal(operation_begin(&otto.operation, store, &why), APC_ECONFLICT);
    assert_string_equal(why.code, "stale");
    assert_string_equal(why.text, "u.Kp was changed meanwhile: it is 0.3 now");
    assert_int_equal(otto.change[0].newest.seq, seen + 1);
    assert_near(newest(APC_TUNING, KP).value, 0.3, 0);
    read_events();
    assert_int_equal(events.n, 1);
    operation_end(&anna.operation);
    operation_end(&otto.operation);
}

/* Each takes whatever is newest: both are written, and each is told what became of his own. */
static void of_two_who_wrote_the_first_is_superseded(void **state)
{
    struct desk anna = desk_of("anna", 0.3), otto = desk_of("otto", 0.4);
    (void)state;

    begin(&anna);
    begin(&otto);
    assert_true(poll(&anna) == 0 && poll(&otto) == 0);
    became(APC_TUNING, KP, otto.change[0].after.seq, 0.4, APC_GOOD);
    assert_true(poll(&anna) == 1 && poll(&otto) == 1);
    finish(&anna, 0, APC_ECONFLICT, "superseded", "superseded: it is 0.4 now");
    finish(&otto, 0, 0, "applied", "applied");
    read_events();
    assert_string_equal(events.text[0], "anna: u.Kp: 0.2 -> 0.3");
    assert_string_equal(events.text[1], "otto: u.Kp: 0.3 -> 0.4");
}

/* ---- Undone -------------------------------------------------------------------------------------- */

/* Written so long ago, and taken. */
static void wrote(const char *author, const char *name, unsigned kind, double value, apc_ns ago)
{
    struct desk d = {0};

    wants(&d, author, name, kind, value);
    d.operation.confirmed = true;
    d.operation.time = apc_clock_utc(NULL) - ago;
    begin(&d);
    operation_end(&d.operation);
}

/* Returns "", or the code of why not, with the sentence in @p why. */
static const char *undo(const char *author, apc_ns only, struct change_fault *why)
{
    struct operation o = {.plant = &plant.view, .author = author, .note = " (undo)"};

    *why = (struct change_fault){.code = ""};
    if (operation_undo(&o, store, only, why) == 0 && operation_read(&o, store) == 0)
        (void)operation_begin(&o, store, why);
    operation_end(&o);
    free(o.change);
    return why->code;
}

/* Promise(modes/undo): One's last write within a minute is taken back by one command, unless somebody has written
 *   to it since: then that one is named. */
static void ones_last_write_is_taken_back(void **state)
{
    struct change_fault why;
    (void)state;

    assert_string_equal(undo("anna", 0, &why), "undo");
    assert_string_equal(why.text, "there is nothing to undo: anna has written nothing for a minute");
    wrote("anna", "w", CHANGE_SETPOINT, 40, 0); /* a great step, which takes it from the scheduler */
    wrote("anna", "u.Kp", CHANGE_TUNING, 0.3, 0);
    wrote("otto", "r", CHANGE_SETPOINT, 3, 0);
    assert_string_equal(undo("anna", 0, &why), "");
    assert_true(newest(APC_TUNING, KP).value == 0.2 && newest(APC_SETPOINT, SET_W).value == 40.0);
    assert_string_equal(undo("anna", 0, &why), ""); /* that one again */
    assert_true(newest(APC_TUNING, KP).value == 0.3);
    read_events();
    assert_string_equal(events.text[events.n - 1], "anna: u.Kp: 0.2 -> 0.3 (undo)");
    const struct apc_sample kp = newest(APC_TUNING, KP);
    assert_string_equal(undo("anna", kp.time - APC_NS_PER_S, &why), "undo");
    assert_string_equal(undo("anna", kp.time, &why), "");
}

/* Promise(modes/undo) */
static void who_came_after_is_named_and_nothing_is_written(void **state)
{
    struct change_fault why;
    (void)state;

    wrote("anna", "u.Kp", CHANGE_TUNING, 0.3, 10 * S);
    wrote("otto", "u.Kp", CHANGE_TUNING, 0.4, 0);
    assert_string_equal(undo("anna", 0, &why), "stale");
    assert_string_equal(why.text, "u.Kp was changed since by otto: it is 0.4 now");
    assert_true(newest(APC_TUNING, KP).value == 0.4);
    assert_string_equal(undo("otto", 0, &why), "");
    wrote("carl", "u.Kp", CHANGE_TUNING, 0.5, 61 * S);
    assert_string_equal(undo("carl", 0, &why), "undo");
}

/* Promise(modes/undo) */
static void what_was_taken_from_its_owner_is_his_again(void **state)
{
    struct change_fault why;
    (void)state;

    wrote("anna", "w", CHANGE_SETPOINT, 8, 0);
    struct apc_sample owner = newest(APC_OPMODE, LOOPS_OWNER(SET_W));
    assert_true(loops_is_local(&owner));
    assert_string_equal(undo("anna", 0, &why), "");
    owner = newest(APC_OPMODE, LOOPS_OWNER(SET_W));
    assert_false(loops_is_local(&owner));
    wrote("otto", "r", CHANGE_SETPOINT, 3, 0); /* which takes Auto along */
    assert_true(newest(APC_OPMODE, LOOP_U).value == (double)APC_MODE_AUTO);
    assert_string_equal(undo("otto", 0, &why), "");
    assert_true(newest(APC_OPMODE, LOOP_U).value == (double)APC_MODE_CAS);
    append((struct apc_sample){
        .table = APC_SETPOINT, .id = SET_R, .value = 4, .time = apc_clock_utc(NULL)}); /* by the loop above */
    assert_string_equal(undo("otto", 0, &why), "");
    assert_true(newest(APC_OPMODE, LOOP_U).value == (double)APC_MODE_AUTO);
    assert_true(newest(APC_SETPOINT, SET_R).value == 3.0);
}

/* Promise(modes/undo) */
static void an_output_goes_back_to_what_went_out_before(void **state)
{
    const apc_ns tick = apc_clock_utc(NULL) - 3600 * S; /* by a clock of its own */
    struct change_fault why;
    struct apc_sample out = {.table = APC_ACTUATOR, .id = 1, .value = 5, .time = tick}, actual;
    (void)state;

    wrote("otto", "u", CHANGE_MODE, APC_MODE_MAN, 0);
    wrote("anna", "u", CHANGE_OUTPUT, 12, 0);
    assert_string_equal(undo("anna", 0, &why), "value");
    assert_string_equal(why.text, "u had no good value before: set it");
    append(out);
    actual = (struct apc_sample){.table = APC_ACTUAL, .time = tick + S, .value = 12};
    actual.id = apc_variable_number(APC_MANUAL, newest(APC_MANUAL, 1).id);
    actual.origin = newest(APC_MANUAL, 1).seq;
    append(actual);
    for (int i = 1; i <= 3; i++) {
        out.time = tick + i * S;
        out.value = 12;
        append(out);
    }
    assert_string_equal(undo("anna", 0, &why), "");
    assert_true(newest(APC_MANUAL, 1).value == 5.0);
    wrote("anna", "u", CHANGE_OUTPUT, 13, 0);
    wrote("otto", "u", CHANGE_MODE, APC_MODE_AUTO, 0);
    assert_string_equal(undo("anna", 0, &why), "mode");
    assert_string_equal(why.text, "u is controlled in mode Auto: set the target mode of u to Man first");
}

/* ---- Records ------------------------------------------------------------------------------------ */

static int cannot_record(void *ctx, struct apc_store *live, const struct apc_event *event, size_t n)
{
    (void)ctx;
    (void)live;
    (void)event;
    (void)n;
    return APC_ECONN;
}

/* Promise(modes/confirm-great-step): A step of more than its `confirm` is written with a confirmation alone, and by
 *   nobody who cannot be asked. */
static void a_great_step_is_confirmed_or_not_written(void **state)
{
    struct desk d = {0};
    struct change_fault why;
    const int64_t before = newest(APC_SETPOINT, SET_W).seq;

    (void)state;
    wants(&d, "anna", "w", CHANGE_SETPOINT, 15.5); /* from 5 */
    assert_true(d.change[0].to.step == 10.0);
    d.operation.change = d.change;
    assert_int_equal(operation_read(&d.operation, store), 0);
    assert_int_equal(operation_begin(&d.operation, store, &why), APC_EPERM);
    assert_string_equal(why.code, "confirm");
    assert_string_equal(why.text, "w: 5 -> 15.5 is a step of more than 10, which has to be confirmed");
    assert_int_equal(newest(APC_SETPOINT, SET_W).seq, before);
    d.operation.confirmed = true;
    begin(&d);
    assert_true(newest(APC_SETPOINT, SET_W).value == 15.5);
    operation_end(&d.operation);
    memset(&d, 0, sizeof d);
    wants(&d, "anna", "w", CHANGE_SETPOINT, 5.5); /* as far as it goes without */
    begin(&d);
    operation_end(&d.operation);
}

static void what_is_written_and_not_recorded_is_said(void **state)
{
    struct desk d = desk_of("anna", 0.3);
    struct change_fault why;
    (void)state;

    d.operation.change = d.change;
    d.operation.record = cannot_record;
    assert_int_equal(operation_begin(&d.operation, store, &why), APC_ECONN);
    assert_string_equal(why.code, "record");
    assert_near(newest(APC_TUNING, KP).value, 0.3, 0);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(who_ticks_is_ready_at_once),
        T(a_controller_by_another_clock_is_known_by_its_next_tick),
        T(who_is_gone_is_named_and_nothing_is_written),
        T(who_follows_the_ticks_is_told_of_newer_ones),
        T(who_has_said_that_it_stops_is_not_ready),
        T(what_is_in_force_is_settled_and_on_record),
        T(a_controller_that_never_answers_is_waited_for_so_long_only),
        T(a_controller_that_dies_in_between_is_said_to_be_gone),
        T(who_takes_its_place_applies_it),
        T(a_refusal_waits_for_its_words_but_not_for_long),
        T(of_several_all_are_waited_for),
        T(of_two_who_saw_the_same_one_is_told),
        T(of_two_who_wrote_the_first_is_superseded),
        T(a_great_step_is_confirmed_or_not_written),
        T(ones_last_write_is_taken_back),
        T(who_came_after_is_named_and_nothing_is_written),
        T(what_was_taken_from_its_owner_is_his_again),
        T(an_output_goes_back_to_what_went_out_before),
        T(what_is_written_and_not_recorded_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
