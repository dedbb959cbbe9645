/* SPDX-License-Identifier: BSD-3-Clause */
/* Signals that one controller calculates and another one measures: values, quality, modes, in virtual time. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "simulated.h"

#include <apcrun.h>

#include "experiment/experiment.h"

static const char override[] = APC_SOURCE_DIR "/experiments/double-tank-override.conf";

/* y through a ratio to the signal s, and s through another one to the output u: u = 2 s, s = 1 - y / 2. */
enum { Y = 1, S };           /* ids in table sensor */
enum { TAKE_U = 1, MAKE_S }; /* loops */
#define CHAIN(more)                                                                                          \
    "name = \"chain\"; duration = 60.0;"                                                                     \
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0; } );"                                      \
    "setpoints = ( { name = \"r\"; initial = 0.0; } );"                                                      \
    "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; fault = -1.0; initial = 2.0; } );"                \
    "signals = ( { name = \"s\"; unit = \"V\"; low = -4.0; high = 4.0; } );"                                 \
    "plant = { model = \"first-order\"; period = 0.1; };"                                                    \
    "client = { period = 0.1; };"                                                                            \
    "controllers = ("                                                                                        \
    "  { name = \"take\"; law = \"leadlag\"; period = 0.5; hold = 3.0; measurements = [\"s\"]; "             \
    "setpoints = [\"r\"]; outputs = [\"u\"]; tuning = ( { K = 2.0; } ); },"                                  \
    "  { name = \"make\"; law = \"leadlag\"; period = 0.5; hold = 2.0; measurements = [\"y\"]; "             \
    "outputs = [\"s\"]; tuning = ( { K = -0.5; bias = 1.0; } ); } );" more

/* ---- Runs --------------------------------------------------------------------------------- */

/* Of a file, with one setting changed, or of a text. */
static struct apc_simulation *begin_with(const char *file, const char *text, const char *path,
                                         const char *value)
{
    struct apc_experiment *e;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    if (apc_experiment_load(&e, file, text, &why) < 0 ||
        (path && apc_experiment_set(e, path, value, &why) < 0) ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

static struct apc_simulation *begin(const char *text)
{
    return begin_with("signals.conf", text, NULL, NULL);
}

/* ---- A chain ------------------------------------------------------------------------------ */

/*
 * Promise(experiment/calculated-signals-taken): Calculated signals: taken at the tick that follows, within
 *   their limits, moved by hand, Bad down the chain and back, stale when their controller is gone.
 */
static void a_signal_is_taken_at_the_very_tick_that_follows(void **state)
{
    struct apc_simulation *s = begin(CHAIN(""));
    struct apc_value by_name;
    (void)state;
    for (double t = 0.55; t < 20; t += 0.5) {
        run(s, t - 0.45); /* before the client's next tick */
        const struct apc_sample y = newest(s, APC_SENSOR, Y), made = newest(s, APC_SENSOR, S),
                                u = newest(s, APC_ACTUATOR, 1);
        assert_int_equal(made.status, APC_GOOD);
        assert_near(made.value, 1 - y.value / 2, 0);
        assert_near(u.value, 2 * made.value, 0);
        assert_int_equal(u.time - made.time, 10 * APC_NS_PER_MS); /* the phase of who stands below */
        run(s, t);
    }
    assert_int_equal(apc_simulation_read(s, "s", &by_name), 0);
    assert_near(by_name.value, newest(s, APC_SENSOR, S).value, 0);
    apc_simulation_destroy(s);
}

/* Promise(experiment/calculated-signals-taken) */
static void a_signal_keeps_its_limits_and_says_so(void **state)
{
    struct apc_simulation *s = begin(CHAIN("actions = ( { at = 5.2; set = \"s.bias\"; value = 100.0; } );"));
    (void)state;
    run(s, 10);
    assert_near(newest(s, APC_SENSOR, S).value, 4, 0);
    assert_int_equal(newest(s, APC_SENSOR, S).status, APC_GOOD_LIMITED_HIGH);
    assert_near(newest(s, APC_ACTUATOR, 1).value, 8, 0);
    apc_simulation_destroy(s);
}

/* Promise(experiment/calculated-signals-taken) */
static void what_is_bad_stays_bad_down_the_chain_and_comes_back(void **state)
{
    struct apc_simulation *s =
        begin(CHAIN("network = { outages = ( [10.0, 24.0] ); };")); /* no measurement comes */
    (void)state;
    run(s, 10.3);
    const double held = newest(s, APC_SENSOR, S).value;
    run(s, 11.6);
    assert_int_equal(mode_of(s, MAKE_S), APC_MODE_AUTO);
    assert_int_equal(newest(s, APC_SENSOR, S).status, APC_UNCERTAIN_LAST_USABLE);
    assert_int_equal(newest(s, APC_ACTUATOR, 1).status, APC_GOOD); /* what is uncertain can be used */
    run(s, 13.6);
    assert_int_equal(mode_of(s, MAKE_S), APC_MODE_LO);
    assert_int_equal(apc_status_severity(newest(s, APC_SENSOR, S).status), APC_SEVERITY_BAD);
    assert_near(newest(s, APC_SENSOR, S).value, held, 0); /* no value is its substitute */
    assert_int_equal(newest(s, APC_ACTUATOR, 1).status, APC_UNCERTAIN_LAST_USABLE);
    run(s, 18);
    assert_int_equal(mode_of(s, TAKE_U), APC_MODE_LO);
    assert_near(newest(s, APC_ACTUATOR, 1).value, -1, 0);
    run(s, 30);
    assert_int_equal(mode_of(s, MAKE_S), APC_MODE_AUTO);
    assert_int_equal(mode_of(s, TAKE_U), APC_MODE_AUTO);
    assert_near(newest(s, APC_ACTUATOR, 1).value, 2 * newest(s, APC_SENSOR, S).value, 0);
    apc_simulation_destroy(s);
}

/* Promise(experiment/calculated-signals-taken) */
static void a_signal_is_stale_when_its_controller_is_gone(void **state)
{
    struct apc_simulation *s = begin(CHAIN(""));
    (void)state;
    run(s, 10.2);
    assert_int_equal(apc_simulation_do(s, "kill", "make"), 0);
    const int64_t last = newest(s, APC_SENSOR, S).seq;
    run(s, 11.4); /* not yet: 3 periods of its own, and 100 ms */
    assert_int_equal(newest(s, APC_ACTUATOR, 1).status, APC_GOOD);
    run(s, 12.2);
    assert_int_equal(newest(s, APC_ACTUATOR, 1).status, APC_UNCERTAIN_LAST_USABLE);
    run(s, 16);
    assert_int_equal(mode_of(s, TAKE_U), APC_MODE_LO);
    assert_int_equal(newest(s, APC_SENSOR, S).seq, last);
    assert_int_equal(apc_simulation_do(s, "start", "make"), 0);
    run(s, 20);
    assert_true(newest(s, APC_SENSOR, S).seq > last);
    assert_int_equal(mode_of(s, TAKE_U), APC_MODE_AUTO);
    apc_simulation_destroy(s);
}

/* Promise(experiment/calculated-signals-taken) */
static void an_operator_moves_a_signal_as_any_output(void **state)
{
    struct apc_simulation *s = begin(CHAIN(""));
    (void)state;
    run(s, 10.2);
    assert_int_equal(apc_simulation_mode(s, "s", APC_MODE_MAN), 0);
    run(s, 10.7);
    const double at = newest(s, APC_SENSOR, S).value;
    run(s, 12.2);
    assert_int_equal(mode_of(s, MAKE_S), APC_MODE_MAN);
    assert_int_equal(mode_of(s, TAKE_U), APC_MODE_AUTO);
    assert_near(newest(s, APC_SENSOR, S).value, at, 0);
    assert_int_equal(apc_simulation_write(s, "s", -1.5), 0);
    assert_int_equal(apc_simulation_write(s, "s", 4.5), APC_ERANGE);
    assert_int_equal(apc_simulation_write(s, "y", 1.0), APC_ENOTFOUND); /* nobody calculates it */
    run(s, 13.2);
    assert_near(newest(s, APC_SENSOR, S).value, -1.5, 0);
    assert_near(newest(s, APC_ACTUATOR, 1).value, -3, 0);
    assert_int_equal(apc_simulation_mode(s, "make", APC_MODE_AUTO), 0);
    run(s, 14.2);
    assert_int_equal(mode_of(s, MAKE_S), APC_MODE_AUTO);
    apc_simulation_destroy(s);
}

/* ---- Override ------------------------------------------------------------------------------ */

enum { UPPER_LEVEL = 3, WANT, ALLOW }; /* ids in table sensor */
enum { UPPER_LOOP = 1, WANT_LOOP, ALLOW_LOOP, U_LOOP };

static double value_of(struct apc_simulation *s, const char *name)
{
    struct apc_value value;
    if (apc_simulation_read(s, name, &value) < 0)
        fail_msg("%s", apc_simulation_error(s));
    return value.value;
}

/* Promise(laws/select) */
static void who_is_not_selected_neither_winds_up_nor_falls_asleep(void **state)
{
    struct apc_simulation *s = begin_with(override, NULL, NULL, NULL);
    int lost = 0;
    (void)state;
    run(s, 70); /* r is out of reach */
    for (double t = 70.7; t < 120; t += 0.5) {
        run(s, t);
        const double u = value_of(s, "u"), want = value_of(s, "want");
        assert_near(u, fmin(fmin(want, value_of(s, "allow")), 13), 0);
        assert_true(want < u + 1); /* it could go to 20 */
        lost += want > u;
    }
    assert_true(lost > 50);
    run(s, 121.2); /* r falls: the loop has the pump at once */
    assert_near(value_of(s, "u"), value_of(s, "want"), 0);
    assert_near(value_of(s, "u.selected"), 1, 0);
    assert_true(value_of(s, "u") < 10);
    /* and while it has, the other one stays below its limit, too */
    run(s, 180);
    assert_true(value_of(s, "allow") < 17);
    apc_simulation_destroy(s);
}

/* Promise(laws/select) */
static void a_selector_comes_back_from_its_operator_without_a_bump(void **state)
{
    struct apc_simulation *s = begin_with(override, NULL, NULL, NULL);
    (void)state;
    run(s, 5.2);
    assert_int_equal(apc_simulation_mode(s, "u", APC_MODE_MAN), 0);
    run(s, 5.7);
    assert_int_equal(apc_simulation_write(s, "u", 7), 0);
    run(s, 20.2);
    for (int loop = WANT_LOOP; loop <= ALLOW_LOOP; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_IMAN);
    for (int signal = WANT; signal <= ALLOW; signal++) {
        assert_near(newest(s, APC_SENSOR, signal).value, 7, 0);
        assert_int_equal(newest(s, APC_SENSOR, signal).status, APC_UNCERTAIN_INITIAL);
    }
    assert_int_equal(apc_simulation_mode(s, "u", APC_MODE_AUTO), 0);
    run(s, 20.7);
    assert_int_equal(mode_of(s, U_LOOP), APC_MODE_AUTO);
    assert_near(value_of(s, "u"), 7, 0);
    run(s, 21.2); /* the loops go on from there */
    for (int loop = WANT_LOOP; loop <= ALLOW_LOOP; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    assert_near(value_of(s, "u"), 7, 1e-9);
    run(s, 59);
    assert_near(value_of(s, "h2"), 0.18, 0.01);
    apc_simulation_destroy(s);
}

/* Promise(laws/select) */
static void a_selector_leaves_out_what_is_bad(void **state)
{
    struct apc_simulation *s = begin_with(override, NULL, "measurements.h1.faults",
                                          "( { kind = \"dropout\"; at = 65.0; duration = 15.0; } )");
    (void)state;
    run(s, 64.7); /* the pump is at its limit; then the upper tank would allow less */
    run(s, 79);
    for (int signal = UPPER_LEVEL; signal <= ALLOW; signal++)
        assert_int_equal(apc_status_severity(newest(s, APC_SENSOR, signal).status),
                         signal == WANT ? APC_SEVERITY_GOOD : APC_SEVERITY_BAD);
    assert_int_equal(mode_of(s, U_LOOP), APC_MODE_AUTO);
    assert_near(value_of(s, "u.selected"), 1, 0);
    assert_near(value_of(s, "u"), fmin(value_of(s, "want"), 13), 0);
    run(s, 90);
    for (int loop = UPPER_LOOP; loop <= U_LOOP; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    run(s, 115);
    assert_near(value_of(s, "h1"), 0.2, 0.01);
    apc_simulation_destroy(s);
}

/* Promise(laws/select) */
static void a_restart_between_two_ticks_changes_no_bit_of_what_is_selected(void **state)
{
    struct apc_simulation *s = begin_with(override, NULL, NULL, NULL),
                          *lived = begin_with(override, NULL, NULL, NULL);
    (void)state;
    for (double t = 5.2; t < 130; t += 7) {
        run(s, t);
        for (int k = 0; k < 2; k++) {
            const char *name = k ? "levels" : "choose";
            assert_int_equal(apc_simulation_do(s, "kill", name), 0);
            assert_int_equal(apc_simulation_do(s, "start", name), 0);
        }
        run(lived, t + 3.5);
        run(s, t + 3.5);
        for (int signal = WANT; signal <= ALLOW; signal++)
            assert_near(newest(s, APC_SENSOR, signal).value, newest(lived, APC_SENSOR, signal).value, 0);
    }
    apc_simulation_destroy(s);
    apc_simulation_destroy(lived);
}

/* ---- What is wanted of a signal ------------------------------------------------------------- */

#define KEYS(y, r, u, more)                                                                                  \
    "name = \"keys\";\n"                                                                                     \
    "measurements = ( { name = \"y\"; low = 0.0; high = 10.0; " y " } );\n"                                  \
    "setpoints = ( { name = \"r\"; initial = 1.0; " r " } );\n"                                              \
    "outputs = ( { name = \"u\"; unit = \"V\"; low = -1.0; high = 1.0; " u " } );\n"                         \
    "plant = { model = \"first-order\"; period = 0.1; }; client = { period = 0.1; };\n"                      \
    "controller = { law = \"pi\"; period = 0.5; " more " };\n"

static int parse(struct experiment *e, const char *text, struct apc_error *why)
{
    return experiment_parse(e, &(struct experiment_source){.file = "keys.conf", .text = text},
                            EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
}

/*
 * Promise(experiment/area-scale-period): Area, scale, period, soft limits, rates, alarms: checked with
 *   their line; tags have what a page needs, laws are told the rest.
 */
static void what_is_wanted_of_a_signal_reaches_its_tag_and_its_law(void **state)
{
    struct experiment e;
    struct apc_error why;
    size_t n;
    (void)state;
    if (parse(&e,
              KEYS("area = \"unit1/reactor\"; display = [-2.0, 12.0]; soft = [1.0, 9.0]; critical = true; "
                   "period "
                   "= 60.0; alarms = ( { kind = \"high\"; limit = 9.5; priority = 2; delay = 5.0; message = "
                   "\"full\"; }, { kind = \"low\"; limit = 0.5; }, { kind = \"bad\"; } );",
                   "area = \"unit1\";", "rate = 0.2;", "rate = [0.5];"),
              &why) < 0)
        fail_msg("%s", why.text);
    struct apc_tag *tags = provision_tags(&e, &n);
    assert_non_null(tags);
    assert_int_equal(tags[0].table, APC_SENSOR);
    assert_string_equal(tags[0].area, "unit1/reactor");
    assert_near(tags[0].display_low, -2, 0);
    assert_near(tags[0].display_high, 12, 0);
    assert_near(tags[0].period, 60, 0);
    assert_string_equal(tags[1].area, "unit1");
    assert_true(tags[1].display_low == tags[1].display_high);
    free(tags);
    assert_true(module_horizon(&e, (struct wire){APC_SENSOR, 0}) == 180 * APC_NS_PER_S + 100 * APC_NS_PER_MS);

    const struct apc_law_setup setup = module_law_setup(&e.controllers[0]);
    assert_string_equal(setup.y[0].name, "y");
    assert_near(setup.y[0].low, 0, 0);
    assert_near(setup.y[0].soft_low, 1, 0);
    assert_near(setup.y[0].soft_high, 9, 0);
    assert_true(setup.y[0].critical);
    assert_string_equal(setup.z[0].name, "r");
    assert_false(setup.z[0].critical);
    assert_string_equal(setup.u[0].name, "u");
    assert_string_equal(setup.u[0].unit, "V");
    assert_near(setup.u[0].high, 1, 0);
    assert_near(setup.u[0].rate, 0.2, 0); /* the lower of the two */
    assert_near(e.controllers[0].rate[0], 0.2, 0);
    experiment_free(&e);
}

static double told_soft[2];

static int spy(struct apc_law_call *c)
{
    told_soft[0] = c->y_low[0];
    told_soft[1] = c->y_high[0];
    c->u[0] = 0;
    return APC_LAW_GOOD;
}

/* Promise(experiment/area-scale-period) */
static void soft_limits_are_told_at_each_tick(void **state)
{
    static const struct apc_law law = {.abi = APC_LAW_ABI, .name = "spy", .compute = spy};
    const struct apc_signal_view view[] = {{.name = "y", .soft_low = 1, .soft_high = 9}, {.name = "u"}};
    const struct apc_controller_options options = {.size = sizeof options,
                                                   .law = &law,
                                                   .dim = {1, 0, 1, 0},
                                                   .period = APC_NS_PER_S,
                                                   .horizon = 4 * APC_NS_PER_S,
                                                   .view = view};
    struct apc_controller *c;
    struct apc_error why;
    (void)state;
    if (apc_controller_create(&c, &options, &why) < 0)
        fail_msg("%s", why.text);
    struct apc_rows *in = apc_controller_in(c);
    for (size_t i = 0; i < in->n_samples; i++)
        if (in->sample[i].table == APC_SENSOR || in->sample[i].table == APC_OPMODE)
            in->sample[i] = (struct apc_sample){.table = in->sample[i].table,
                                                .id = 1,
                                                .seq = 1,
                                                .time = APC_NS_PER_S,
                                                .value = APC_MODE_AUTO};
    apc_controller_resume(c, 0);
    apc_controller_compute(c, (struct apc_now){APC_NS_PER_S, APC_NS_PER_S}, 0, true, NULL);
    assert_near(told_soft[0], 1, 0);
    assert_near(told_soft[1], 9, 0);
    apc_controller_destroy(c);
}

static void what_a_loop_calculates_has_no_effort_on_the_plant(void **state)
{
    struct apc_simulation *s = begin_with(override, NULL, NULL, NULL);
    struct apc_figure figure[32] = {{.size = sizeof *figure}};
    bool calculated = false;
    (void)state;
    run(s, 300);
    const int n = apc_simulation_figures(s, figure, sizeof figure / sizeof *figure);
    assert_in_range(n, 1, sizeof figure / sizeof *figure);
    for (int i = 0; i < n; i++) {
        calculated |= strstr(figure[i].loop, "want") != NULL;
        assert_true(isnan(figure[i].effort) == (strstr(figure[i].loop, "want") != NULL));
    }
    assert_true(calculated);
    apc_simulation_destroy(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_a_loop_calculates_has_no_effort_on_the_plant),
        cmocka_unit_test(a_signal_is_taken_at_the_very_tick_that_follows),
        cmocka_unit_test(a_signal_keeps_its_limits_and_says_so),
        cmocka_unit_test(what_is_bad_stays_bad_down_the_chain_and_comes_back),
        cmocka_unit_test(a_signal_is_stale_when_its_controller_is_gone),
        cmocka_unit_test(an_operator_moves_a_signal_as_any_output),
        cmocka_unit_test(who_is_not_selected_neither_winds_up_nor_falls_asleep),
        cmocka_unit_test(a_selector_comes_back_from_its_operator_without_a_bump),
        cmocka_unit_test(a_selector_leaves_out_what_is_bad),
        cmocka_unit_test(a_restart_between_two_ticks_changes_no_bit_of_what_is_selected),
        cmocka_unit_test(what_is_wanted_of_a_signal_reaches_its_tag_and_its_law),
        cmocka_unit_test(soft_limits_are_told_at_each_tick),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
