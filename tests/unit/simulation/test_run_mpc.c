/* SPDX-License-Identifier: BSD-3-Clause */
/* Predictive control in a run in which a measurement is Bad for a while, as a step comes. */
/*
 * Promise(run/lost-bad-measurement)
 * Promise(laws/mpc)
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "simulated.h"

#include <apcrun.h>
#include <apcstore.h>

#define FROM  190.0 /* s: y1 is Bad; r1 steps at 200 s */
#define UNTIL 230.0

static struct apc_error why;

/* The shipped experiment with @p more said of y1; @p hold: for how long what is Bad is controlled. */
static struct apc_simulation *begin(const char *more, const char *hold)
{
    static const char name[] = "name = \"y1\";";
    static char file[8192], text[9216];
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    FILE *f = fopen(APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", "r");
    assert_non_null(f);
    file[fread(file, 1, sizeof file - 1, f)] = '\0';
    fclose(f);
    char *at = strstr(file, name);
    assert_non_null(at);
    at += strlen(name);
    snprintf(text, sizeof text, "%.*s faults = ( { kind = \"dropout\"; at = %g; duration = %g; } ); %s %s",
             (int)(at - file), file, FROM, UNTIL - FROM, more, at);
    if (apc_experiment_load(&e, "mpc.conf", text, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.hold", hold, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

static void it_goes_on_by_what_it_estimates(void **state)
{
    struct apc_simulation *s = begin("", "[60, 60]");
    (void)state;
    for (double t = FROM + 2; t < UNTIL; t += 1) {
        run(s, t);
        assert_int_equal(apc_status_severity(newest(s, APC_SENSOR, 1).status), APC_SEVERITY_BAD);
        for (int id = 1; id <= 2; id++)
            assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
    }
    run(s, UNTIL + 1);
    assert_int_equal(newest(s, APC_SENSOR, 1).status, APC_GOOD);
    assert_near(newest(s, APC_SENSOR, 1).value, 7.1315, 0.05);
    assert_near(newest(s, APC_SENSOR, 2).value, 6.3915, 0.05);
    apc_simulation_destroy(s);
}

static void without_a_critical_one_it_stops_after_its_hold(void **state)
{
    struct apc_simulation *s = begin("critical = true;", "[10, 10]");
    (void)state;
    run(s, FROM + 8);
    assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, 1).status), APC_SEVERITY_GOOD);
    run(s, FROM + 12);
    for (int id = 1; id <= 2; id++)
        assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_UNCERTAIN);
    apc_simulation_destroy(s);
}

/* The shipped experiment with two settings changed. */
static struct apc_simulation *begin_with(const char *path, const char *value, const char *sequence)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, path, value, &why) < 0 ||
        apc_experiment_set(e, "scheduler.sequence", sequence, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

struct count {
    const char *says;
    int n;
};

static int count_event(void *ctx, const struct apc_event *event)
{
    struct count *c = ctx;
    c->n += !strcmp(event->kind, "law") && strstr(event->text, c->says);
    return 0;
}

/* Of an output that was held, or went to its fault value. */
static int count_held(void *ctx, const struct apc_event *event)
{
    *(int *)ctx += strstr(event->text, "output held") || strstr(event->text, "fault value");
    return 0;
}

/* How often it was told of the law's answers. */
static int told(struct apc_simulation *s, const char *says)
{
    struct count c = {says, 0};
    assert_true(apc_store_events(apc_simulation_store(s), &(struct apc_range){0}, count_event, &c) >= 0);
    return c.n;
}

/* y1 high and y2 low is more than the pumps can do: v2 stands at 0. */
/*
 * Promise(laws/input-saturated-higher): With an input saturated the higher rank keeps its setpoint within 1
 *   %; what cannot be had, and a plan that is not found in time, are told with a sentence, and their end.
 */
static void with_an_input_saturated_the_higher_rank_keeps_its_setpoint(void **state)
{
    static const double wanted[] = {9.5, 2.0};
    (void)state;
    for (int first = 0; first < 2; first++) {
        struct apc_simulation *s = begin_with("controller.settings.rank", first == 0 ? "[1, 2]" : "[2, 1]",
                                              "( [6.1315, 6.3915], [9.5, 2.0] )");
        run(s, 180);
        assert_int_equal(told(s, ""), 0);
        run(s, 600);
        assert_near(newest(s, APC_ACTUATOR, 2).value, 0.0, 1e-9);
        assert_near(newest(s, APC_SENSOR, 1 + first).value, wanted[first], 0.01 * wanted[first]);
        assert_true(fabs(newest(s, APC_SENSOR, 2 - first).value - wanted[1 - first]) >
                    0.1 * wanted[1 - first]);
        /* what is estimated to disturb may bring it into reach for a while */
        assert_int_equal(told(s, "law mpc: no steady state within the limits has these setpoints: goes to "
                                 "the nearest"),
                         told(s, "law mpc: good again") + 1);
        apc_simulation_destroy(s);
    }
}

/* Promise(laws/input-saturated-higher) */
static void what_is_out_of_reach_for_a_while_is_told_and_its_end(void **state)
{
    struct apc_simulation *s = begin_with("controller.settings.setpoint_preview", "0",
                                          "( [6.1315, 6.3915], [9.5, 2.0], [6.1315, 6.3915] )");
    (void)state;
    run(s, 600);
    assert_true(told(s, "goes to the nearest") >= 1 && told(s, "goes to the nearest") <= 2);
    assert_int_equal(told(s, "law mpc: good again"), told(s, "goes to the nearest"));
    apc_simulation_destroy(s);
}

/* One pump by hand, and noise at the edge of what the other can do: four-tank-mpc as it is. */
static void what_is_out_of_reach_now_and_then_is_told_once(void **state)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/four-tank-mpc.conf", NULL, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    run(s, 0);
    assert_int_equal(told(s, "goes to the nearest"), 1);
    assert_true(told(s, "good again") <= 1);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(laws/input-saturated-higher) */
static void a_plan_that_is_not_found_in_time_is_told(void **state)
{
    struct apc_simulation *s =
        begin_with("controller.settings.iterations", "1", "( [6.1315, 6.3915], [9.5, 2.0] )");
    (void)state;
    run(s, 300);
    assert_true(told(s, "law mpc: no plan in time, after 1 changes: the former one continues") >= 1);
    apc_simulation_destroy(s);
}

/* Two changes of the working set in a tick, and a step that takes nine: once this law was shed for ever. */
/* Promise(laws/too-little-time) */
static void with_little_to_compute_by_it_is_late_for_a_while_and_reaches_its_setpoints(void **state)
{
    static const double wanted[] = {7.1315, 5.3915};
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.iterations", "2", &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    run(s, 560);
    assert_true(told(s, "no plan in time") >= 1);
    for (int id = 1; id <= 2; id++) {
        assert_int_equal(newest(s, APC_ACTUATOR, id).status, APC_GOOD);
        assert_near(newest(s, APC_SENSOR, id).value, wanted[id - 1], 0.01);
    }
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Each time that the loops below take up they need a plan of more changes than that: while they did not
 * follow, everything was given. */
/* Promise(laws/too-little-time) */
static void over_loops_with_little_to_compute_by_it_acts_all_the_same(void **state)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/two-layers-mpc.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, "controllers.upper.settings.iterations", "2", &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    run(s, 390);
    assert_near(newest(s, APC_SENSOR, 1).value, 7.1315, 0.02);
    assert_near(newest(s, APC_SENSOR, 2).value, 6.3915, 0.02);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* So far that the weak pull of moves beside what is broken is lost in rounding. */
static void limits_far_out_of_reach_are_given_up(void **state)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/four-tank-mpc.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, "controller.measurement_tuning", "( { y_max = 1.0; }, { } )", &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    run(s, 60);
    assert_int_equal(told(s, "limits of measurements of rank 1 cannot be kept"), 1);
    assert_int_equal(told(s, "no plan in time"), 0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* y2 comes every 10 s, and its setpoint steps at 400 s. In between it is estimated: what is expected of a
 * sample is far nearer to it than the one before. */
/* Promise(laws/measurement-period-own) */
static void a_sample_of_a_laboratory_counts_once_and_its_course_in_between_is_known(void **state)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    double unexpected = 0.0, moved = 0.0;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.steady", "0", &why) < 0 ||
        apc_experiment_set(e, "measurements.y2.period", "10", &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    for (int k = 1; k <= 55; k++) {
        run(s, 10 * k - 0.01);
        const struct apc_sample before = newest(s, APC_SENSOR, 2);
        const double expected = 0.5 * newest(s, APC_ESTIMATE, 16).value; /* of h2, cm */
        assert_int_equal(before.seq, k);                                 /* that of the first tick is one */
        assert_int_equal(newest(s, APC_SENSOR, 1).seq, 50 * k);
        for (int id = 1; id <= 2; id++)
            assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
        run(s, 10 * k + 0.1); /* until the client has it */
        unexpected += fabs(newest(s, APC_SENSOR, 2).value - expected);
        moved += fabs(newest(s, APC_SENSOR, 2).value - before.value);
    }
    assert_near(newest(s, APC_SENSOR, 2).value, 5.3915, 0.02);
    assert_true(moved > 1.0 && unexpected < 0.3 * moved);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* With which what it estimates would run away. */
/* Promise(laws/measurement-period-own) */
static void a_gain_that_stays_is_refused_for_what_comes_seldom(void **state)
{
    struct apc_experiment *e = NULL;
    (void)state;
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_experiment_set(e, "measurements.y2.period", "0.5", &why), 0);
    assert_int_equal(apc_experiment_set(e, "measurements.y2.period", "0.6", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "y2 comes every 0.6 s, and law mpc ticks every 0.5 s"));
    assert_non_null(strstr(why.text, "steady = 0"));
    assert_int_equal(apc_experiment_set(e, "controller.settings.steady", "0", &why), 0);
    assert_int_equal(apc_experiment_set(e, "measurements.y2.period", "0.6", &why), 0);
    assert_int_equal(apc_experiment_set(e, "controller.settings.steady", "1", &why), APC_EINVAL);
    apc_experiment_destroy(e);
}

/* A range of y1 that is narrower than what a model knows of a plant, or no range at all. */
/*
 * Promise(laws/mpc-steady-states): `mpc` and the steady states that it aims at have an answer for ranges of
 *   measurements however narrow, also of no width or nearly touching.
 */
static void with_a_range_however_narrow_it_goes_on(void **state)
{
    static const char *const high[] = {"7.0001", "7.00001", "7.0"};
    (void)state;
    for (size_t i = 0; i < sizeof high / sizeof *high; i++) {
        struct apc_experiment *e = NULL;
        struct apc_simulation *s = NULL;
        int held = 0;
        if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", NULL, &why) < 0 ||
            apc_experiment_set(e, "controller.y1.y_min", "7.0", &why) < 0 ||
            apc_experiment_set(e, "controller.y1.y_max", high[i], &why) < 0 ||
            apc_simulation_create(&s, e, NULL, &why) < 0)
            fail_msg("%s", why.text);
        run(s, 100.0);
        assert_true(apc_store_events(apc_simulation_store(s), &(struct apc_range){0}, count_held, &held) >=
                    0);
        assert_int_equal(held, 0);
        assert_near(newest(s, APC_SENSOR, 1).value, 7.0, 0.01);
        apc_simulation_destroy(s);
        apc_experiment_destroy(e);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_goes_on_by_what_it_estimates),
        cmocka_unit_test(without_a_critical_one_it_stops_after_its_hold),
        cmocka_unit_test(with_an_input_saturated_the_higher_rank_keeps_its_setpoint),
        cmocka_unit_test(what_is_out_of_reach_for_a_while_is_told_and_its_end),
        cmocka_unit_test(what_is_out_of_reach_now_and_then_is_told_once),
        cmocka_unit_test(a_plan_that_is_not_found_in_time_is_told),
        cmocka_unit_test(a_sample_of_a_laboratory_counts_once_and_its_course_in_between_is_known),
        cmocka_unit_test(a_gain_that_stays_is_refused_for_what_comes_seldom),
        cmocka_unit_test(limits_far_out_of_reach_are_given_up),
        cmocka_unit_test(with_a_range_however_narrow_it_goes_on),
        cmocka_unit_test(with_little_to_compute_by_it_is_late_for_a_while_and_reaches_its_setpoints),
        cmocka_unit_test(over_loops_with_little_to_compute_by_it_acts_all_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
