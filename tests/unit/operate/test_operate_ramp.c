/* SPDX-License-Identifier: BSD-3-Clause */
/* Setpoints and manual outputs on their way: who begins, moves and ends it, and what a restart makes of it. */
#include <stdlib.h>
#include <string.h>

#include "shareddata/shareddata_internal.h"

#include "operated_plant.h"

#define S APC_NS_PER_S

static struct known_plant plant;
static struct ramps ramps;
static struct apc_now now;
static char ended[200];
static int warnings;

static void take_said(void *ctx, enum apc_event_severity severity, const char *text)
{
    (void)ctx;
    warnings += severity == APC_EVENT_WARNING;
    snprintf(ended, sizeof ended, "%s", text);
}

/* A mover that knows nothing. */
static void restart_mover(void)
{
    ramps_free(&ramps);
    assert_int_equal(ramps_init(&ramps, &plant.view, NULL), 0);
}

static int set_up(void **state)
{
    (void)state;
    open_operated_plant();
    ended[0] = '\0';
    warnings = 0;
    now = (struct apc_now){.mono = 50 * S, .utc = apc_clock_utc(NULL)};
    assert_int_equal(known_load(&plant, store), 0);
    return ramps_init(&ramps, &plant.view, NULL);
}

static int tear_down(void **state)
{
    (void)state;
    ramps_free(&ramps);
    known_free(&plant);
    apc_store_close(store);
    return 0;
}

/* One look, so much later. Returns how many are on their way. */
static int look(apc_ns later)
{
    const struct ramp_told told = {.say = take_said};
    now.mono += later;
    now.utc += later;
    return ramps_step(&ramps, store, now, &told);
}

static void looks(int n)
{
    while (n-- > 0)
        (void)look(S / 4);
}

/* A write as a front end brings it; over 0: at once. Returns the fault's code, "": none. */
static const char *writes(const char *author, const char *name, unsigned kind, double value, double over,
                          struct change_fault *why)
{
    struct change_target to;
    struct change change;
    struct operation o = {.plant = &plant.view, .change = &change, .n = 1, .author = author, .time = now.utc};

    assert_int_equal(change_find(&plant.view, name, kind, &to, why), 0);
    change_make(&plant.view, &to, value, &change);
    change.over = over > 0 ? over : 0;
    change.stop = over < 0;
    assert_int_equal(operation_read(&o, store), 0);
    const int rc = operation_begin(&o, store, why);
    operation_end(&o);
    return rc < 0 ? why->code : "";
}

static void wrote(const char *author, const char *name, unsigned kind, double value, double over)
{
    struct change_fault why;
    assert_string_equal(writes(author, name, kind, value, over, &why), "");
}

static double w(void)
{
    return newest(APC_SETPOINT, SET_W).value;
}

static bool is_on_ramp(enum apc_table table, int id)
{
    return newest(table, LOOPS_RATE(id)).value > 0;
}

/* Promise(modes/ramp): A ramp goes linearly from what is in force to its target, and ends there. */
static void a_ramp_goes_linearly_to_its_target(void **state)
{
    (void)state;
    wrote("anna", "w", CHANGE_SETPOINT, 13, 4); /* from 5: 2 a second */
    assert_near(w(), 5, 0);
    assert_true(newest(APC_OPMODE, LOOPS_OWNER(SET_W)).value == 0.0); /* it is hers */
    assert_int_equal(look(0), 1);
    assert_near(w(), 5, 0);
    assert_int_equal(look(S / 4), 1);
    assert_near(w(), 5.5, 1e-12);
    looks(7);
    assert_near(w(), 9, 1e-12);
    assert_int_equal(ramps_read(&ramps, store), 1);
    for (size_t i = 0; i < ramps.n; i++)
        if (ramps.at[i].rate.value > 0)
            assert_near(ramp_to_go(&ramps.at[i]), 2, 1e-12);
    looks(8);
    assert_near(w(), 13, 0);
    assert_false(is_on_ramp(APC_SETPOINT, SET_W));
    assert_string_equal(ended, "w: the ramp arrived at 13");
    assert_int_equal(newest(APC_SETPOINT, SET_W).author, 0);
    assert_true(newest(APC_SETPOINT, LOOPS_RAMP(SET_W)).author > 0);
    assert_int_equal(look(S), 0);
}

/* Promise(modes/ramp-restart): Neither a restart of what moves a ramp, nor a step of a clock, nor a store that was away
 *   makes the setpoint jump. */
static void who_begins_anew_goes_on_from_where_it_is(void **state)
{
    (void)state;
    wrote("anna", "w", CHANGE_SETPOINT, 13, 4);
    look(0);
    looks(4);
    assert_near(w(), 7, 1e-12);
    restart_mover();
    now.utc -= 3600 * S; /* the clock was stepped */
    assert_int_equal(look(100 * S), 1);
    assert_near(w(), 7, 0);
    looks(1);
    assert_near(w(), 7.5, 1e-12);
    look(100 * S); /* a long silence counts as one second */
    assert_near(w(), 9.5, 1e-12);
}

/* Promise(modes/ramp-ends): A write, a stop and a mode other than Man end a ramp where it is. */
static void whoever_writes_ends_it(void **state)
{
    struct change_fault why;
    (void)state;

    wrote("anna", "w", CHANGE_SETPOINT, 13, 4);
    look(0);
    looks(4);
    wrote("otto", "w", CHANGE_SETPOINT, 6, 0);
    assert_false(is_on_ramp(APC_SETPOINT, SET_W));
    looks(4);
    assert_near(w(), 6, 0);

    wrote("anna", "w", CHANGE_SETPOINT, 13, 7); /* by a program that knows nothing of ramps */
    look(0);
    looks(4);
    struct apc_sample foreign = {.table = APC_SETPOINT, .id = SET_W, .time = now.utc, .value = 2};
    assert_int_equal(apc_store_put(store, &foreign, 1), 0);
    assert_int_equal(look(S / 4), 0);
    assert_false(is_on_ramp(APC_SETPOINT, SET_W));
    assert_near(w(), 2, 0);
    assert_string_equal(ended, "w: the ramp ended: it is 2");

    wrote("anna", "w", CHANGE_SETPOINT, 10, 8);
    look(0);
    looks(4);
    assert_string_equal(writes("otto", "w", CHANGE_SETPOINT, 0, -1, &why), "");
    looks(4);
    assert_near(w(), 3, 1e-12);
    assert_string_equal(writes("otto", "w", CHANGE_SETPOINT, 0, -1, &why), "ramp");
    assert_string_equal(why.text, "w is on no ramp: there is nothing to stop");
}

/* While the mover was away somebody else wrote, who knows nothing of ramps. */
static void who_begins_anew_leaves_what_somebody_wrote_meanwhile(void **state)
{
    (void)state;
    wrote("anna", "w", CHANGE_SETPOINT, 13, 4);
    look(0);
    looks(2);
    struct apc_sample foreign = {.table = APC_SETPOINT, .id = SET_W, .time = now.utc, .value = 2};
    foreign.author = (uint32_t)apc_store_author(store, "otto");
    assert_int_equal(apc_store_put(store, &foreign, 1), 0);
    restart_mover();
    assert_int_equal(look(S), 0);
    looks(2);
    assert_near(w(), 2, 0);
}

/* Promise(modes/ramp-ends) */
static void an_output_is_on_its_way_in_man_alone(void **state)
{
    struct change_fault why;
    const struct apc_sample out = {.table = APC_ACTUATOR, .id = 1, .value = 4, .time = now.utc};
    (void)state;

    wrote("otto", "u", CHANGE_MODE, APC_MODE_MAN, 0);
    assert_string_equal(writes("anna", "u", CHANGE_OUTPUT, 12, 4, &why), "ramp");
    assert_string_equal(why.text, "u has no value that a ramp could begin at: set it first");
    append(out);
    wrote("anna", "u", CHANGE_OUTPUT, 12, 4);
    look(0);
    looks(4);
    assert_near(newest(APC_MANUAL, 1).value, 6, 1e-12);
    wrote("otto", "u", CHANGE_MODE, APC_MODE_AUTO, 0);
    assert_int_equal(look(S / 4), 0);
    assert_false(is_on_ramp(APC_MANUAL, 1));
    assert_near(newest(APC_MANUAL, 1).value, 6, 1e-12);
    assert_string_equal(ended, "u: the ramp ended, as its loop is not in Man, at 6");
}

/* Promise(modes/confirm-great-step) */
static void the_whole_step_has_to_be_confirmed(void **state)
{
    struct change_fault why;
    (void)state;
    assert_string_equal(writes("anna", "w", CHANGE_SETPOINT, 15.5, 600, &why), "confirm");
    assert_int_equal(change_over(0, &why), APC_ERANGE);
    assert_int_equal(change_over(366 * 86400 + 1, &why), APC_ERANGE);
    assert_string_equal(why.code, "value");
}

/* Promise(modes/undo) */
static void a_ramp_is_undone_though_it_has_been_moved_since(void **state)
{
    struct change_fault why;
    struct operation o = {.plant = &plant.view, .author = "anna"};
    (void)state;

    wrote("anna", "r", CHANGE_SETPOINT, 1, 0);
    now.utc += S;
    wrote("anna", "r", CHANGE_SETPOINT, 9, 4);
    look(0);
    looks(4);
    assert_near(newest(APC_SETPOINT, SET_R).value, 3, 1e-12);
    assert_int_equal(operation_undo(&o, store, 0, &why), 0);
    assert_int_equal(operation_begin(&o, store, &why), 0);
    operation_end(&o);
    free(o.change);
    looks(4);
    assert_near(newest(APC_SETPOINT, SET_R).value, 1, 0);
    assert_false(is_on_ramp(APC_SETPOINT, SET_R));

    now.utc += S;
    wrote("anna", "r", CHANGE_SETPOINT, 9, 4);
    looks(2);
    wrote("otto", "r", CHANGE_SETPOINT, 2, 0);
    o = (struct operation){.plant = &plant.view, .author = "anna"};
    assert_int_equal(operation_undo(&o, store, 0, &why), APC_ECONFLICT);
    assert_string_equal(why.text, "r was changed since by otto: it is 2 now");
    operation_end(&o);
    free(o.change);
}

static int stuck; /* the setpoint that the store refuses to swap */
static const struct apc_store_ops *whole;

static int swap_but_one(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (samples[i].table == APC_SETPOINT && samples[i].id == stuck)
            return apc_fail(&s->why, APC_ESTORE, "row %d is locked", stuck);
    return whole->swap(s, samples, n);
}

/* Promise(modes/ramp-refused): A ramp that the store refuses to move is told of once, and holds up no other one. */
static void one_that_the_store_refuses_holds_up_no_other(void **state)
{
    struct apc_store_ops refusing = *store->ops;
    (void)state;
    wrote("anna", "r", CHANGE_SETPOINT, 9, 4); /* from 1: before w in every look */
    wrote("anna", "w", CHANGE_SETPOINT, 13, 4);
    look(0);
    whole = store->ops;
    refusing.swap = swap_but_one;
    store->ops = &refusing;
    stuck = SET_R;
    assert_int_equal(look(S / 4), 2);
    assert_near(newest(APC_SETPOINT, SET_R).value, 1, 0);
    assert_near(w(), 5.5, 1e-12);
    assert_string_equal(ended, "r: the ramp stands still at 1: row 1 is locked");
    looks(3);
    assert_near(w(), 7, 1e-12);
    assert_int_equal(warnings, 1);
    store->ops = whole;
    looks(1);
    assert_near(newest(APC_SETPOINT, SET_R).value, 3, 1e-12); /* a second is made up for */
    assert_near(w(), 7.5, 1e-12);
    assert_int_equal(warnings, 1);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(a_ramp_goes_linearly_to_its_target),
        T(who_begins_anew_goes_on_from_where_it_is),
        T(whoever_writes_ends_it),
        T(who_begins_anew_leaves_what_somebody_wrote_meanwhile),
        T(one_that_the_store_refuses_holds_up_no_other),
        T(an_output_is_on_its_way_in_man_alone),
        T(the_whole_step_has_to_be_confirmed),
        T(a_ramp_is_undone_though_it_has_been_moved_since),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
