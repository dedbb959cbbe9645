/* SPDX-License-Identifier: BSD-3-Clause */
/* Signals that one controller calculates and another one measures: values, quality, modes, in virtual time.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#include <apcrun.h>

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

static struct apc_simulation *begin(const char *text)
{
    struct apc_experiment *e;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    if (apc_experiment_load(&e, "signals.conf", text, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

static void run(struct apc_simulation *s, double until)
{
    if (apc_simulation_run(s, until) < 0)
        fail_msg("%s", apc_simulation_error(s));
}

static struct apc_sample newest(struct apc_simulation *s, enum apc_table table, int id)
{
    struct apc_sample row = {.table = table, .id = id};
    assert_int_equal(apc_store_read(apc_simulation_store(s), &row, 1), 0);
    return row;
}

static enum apc_mode mode_of(struct apc_simulation *s, int loop)
{
    return (enum apc_mode)newest(s, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop)).value;
}

/* ---- A chain ------------------------------------------------------------------------------ */

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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_signal_is_taken_at_the_very_tick_that_follows),
        cmocka_unit_test(a_signal_keeps_its_limits_and_says_so),
        cmocka_unit_test(what_is_bad_stays_bad_down_the_chain_and_comes_back),
        cmocka_unit_test(a_signal_is_stale_when_its_controller_is_gone),
        cmocka_unit_test(an_operator_moves_a_signal_as_any_output),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
