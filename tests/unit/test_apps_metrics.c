/* SPDX-License-Identifier: BSD-3-Clause */
/* The figures of a loop, on samples whose figures are known by hand. */
#include "check.h"

#include <stdlib.h>

#include "apc/metrics.h"

static struct samples samples;

static void add(enum apc_table table, double t, double value)
{
    struct apc_sample s = {.table = table, .id = 1, .value = value};
    assert_int_equal(apc_ns_from_s(t, &s.time), 0);
    assert_int_equal(samples_add(&samples, &s), 0);
}

static int empty(void **state)
{
    (void)state;
    samples_free(&samples);
    return 0;
}

/* r goes from 0 to 10 at 1 s and to 6 at 10 s; y follows in steps. */
static void figures_are_those_by_hand(void **state)
{
    double f[METRICS];
    (void)state;
    add(APC_SETPOINT, 0, 0);
    add(APC_SENSOR, 0, 0);
    add(APC_ACTUATOR, 0, 1);
    add(APC_SETPOINT, 1, 10);
    add(APC_SENSOR, 2, 4);
    add(APC_ACTUATOR, 2, 3);
    add(APC_SENSOR, 3, 12);
    add(APC_SENSOR, 4, 10.4);
    add(APC_ACTUATOR, 4, 2.5);
    add(APC_SETPOINT, 10, 6);
    add(APC_SENSOR, 11, 5.5);
    add(APC_SENSOR, 12, 5.9);
    metrics_of(&samples, 0, 0, 20, f);
    /* |e|: 0 in 0..1, 10 in 1..2, 6 in 2..3, 2 in 3..4, .4 in 4..10, 4.4 in 10..11, .5 in 11..12, .1
     * in 12..20 */
    assert_near(f[METRIC_IAE], 10 + 6 + 2 + 2.4 + 4.4 + 0.5 + 0.8, 1e-9);
    assert_near(f[METRIC_ISE], 100 + 36 + 4 + 6 * 0.16 + 19.36 + 0.25 + 8 * 0.01, 1e-9);
    assert_near(f[METRIC_ITAE], 10 * 0.5 + 6 * 1.5 + 2 * 2.5 + 0.4 * 36 + 4.4 * 0.5 + 0.5 * 1.5 + 0.1 * 48,
                1e-9);
    assert_near(f[METRIC_OVERSHOOT], 20, 1e-9); /* 12 of 10; then 0.5 of 4 is 12.5 */
    assert_near(f[METRIC_SETTLING], 2,
                1e-9); /* last outside 9.5..10.5 at 3 s; then outside 5.8..6.2 at 11 s */
    assert_near(f[METRIC_EFFORT], 2 + 0.5, 1e-9);
    assert_near(metrics_step(&samples, 1), 10, 0);
}

static void a_loop_that_does_not_settle_has_no_settling_time(void **state)
{
    double f[METRICS];
    (void)state;
    add(APC_SENSOR, 0, 0);
    add(APC_SETPOINT, 0, 1);
    add(APC_SENSOR, 1, 0.9);
    metrics_of(&samples, 0, 0, 5, f);
    assert_true(isnan(f[METRIC_SETTLING]));
    assert_near(f[METRIC_OVERSHOOT], 0, 0);
}

static void an_offset_at_the_start_is_no_step_beside_larger_ones(void **state)
{
    double f[METRICS];
    (void)state;
    add(APC_SETPOINT, 0, 10);
    add(APC_SENSOR, 0, 9.9);
    add(APC_SENSOR, 1, 11);
    add(APC_SETPOINT, 2, 20);
    add(APC_SENSOR, 3, 20.2);
    metrics_of(&samples, 0, 0, 5, f);
    assert_near(f[METRIC_OVERSHOOT], 2, 1e-9);
}

static void without_samples_there_are_no_figures(void **state)
{
    double f[METRICS];
    (void)state;
    metrics_of(&samples, 0, 0, 5, f);
    assert_near(f[METRIC_IAE], 0, 0);
    assert_true(isnan(f[METRIC_OVERSHOOT]) && isnan(f[METRIC_SETTLING]));
    assert_true(isnan(metrics_step(&samples, 1)));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(figures_are_those_by_hand, empty),
        cmocka_unit_test_teardown(a_loop_that_does_not_settle_has_no_settling_time, empty),
        cmocka_unit_test_teardown(an_offset_at_the_start_is_no_step_beside_larger_ones, empty),
        cmocka_unit_test_teardown(without_samples_there_are_no_figures, empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
