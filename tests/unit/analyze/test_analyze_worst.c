/* SPDX-License-Identifier: BSD-3-Clause */
/* The worst of the models that a record allows. */
#include <math.h>

#include "analyze/linear.h"
#include "check.h"

#define TS 0.1

static const struct apc_transfer lag = {.gain = 2.0, .tau = {10.0}, .dead_time = 2.0};
static const struct apc_pid_tuning calm = {.Kp = 0.8, .tau_i = 10.0}, brisk = {.Kp = 3.2, .tau_i = 10.0};

static struct linear_worst worst_of(const struct apc_transfer *error, const struct apc_pid_tuning *t)
{
    struct linear_worst w;
    struct apc_error why;
    if (linear_worst(&w, &lag, error, t, TS, &why) < 0)
        fail_msg("%s", why.text);
    return w;
}

static void what_is_certain_has_no_worst(void **state)
{
    (void)state;
    const struct linear_worst w = worst_of(&(struct apc_transfer){.gain = 0.0}, &calm);
    assert_memory_equal(&w.g, &lag, sizeof lag);
    assert_int_equal(w.unstable, 0);
}

/* A loop of one lag that cancels it: the more gain, the less margin. */
static void the_worst_has_the_most_gain(void **state)
{
    (void)state;
    const struct apc_transfer error = {.gain = 0.1};
    const struct linear_worst w = worst_of(&error, &calm), again = worst_of(&error, &calm);
    assert_true(w.g.gain > 2.0 + 1.5 * 0.1 && w.g.gain < 2.0 + 4.0 * 0.1);
    assert_near(w.g.tau[0], lag.tau[0], 0.0);
    assert_memory_equal(&w, &again, sizeof w);
    assert_int_equal(w.unstable, 0);
}

/* Of brisk the limit is a gain of 2.5: with a deviation of a quarter of it some are beyond, and more with a half. */
static void models_that_make_it_unstable_are_counted(void **state)
{
    (void)state;
    const struct linear_worst some = worst_of(&(struct apc_transfer){.gain = 0.5}, &brisk),
                              more = worst_of(&(struct apc_transfer){.gain = 1.0}, &brisk);
    assert_true(some.unstable > 2 && some.unstable < LINEAR_WORST_OF / 2);
    assert_true(more.unstable > some.unstable);
    assert_true(some.g.gain > 2.5);
}

/* Promise(page/worst): The workbench and `apc tune --suggest` show what a tuning does with the worst of 50 models that
 *   the record allows. */
static void what_the_record_does_not_tell_is_uncertain(void **state)
{
    (void)state;
    const struct linear_worst w = worst_of(&(struct apc_transfer){.dead_time = (double)NAN}, &calm);
    assert_true(w.g.dead_time > 2.0 + 1.5 * 2.0 / 1.96);
    const struct linear_worst lags = worst_of(&(struct apc_transfer){.tau = {(double)NAN}}, &calm);
    assert_true(lags.g.tau[0] >= 0.05 * 10.0 && lags.g.tau[0] < 10.0);
    assert_near(lags.g.tau[1], 0.0, 0.0);
}

static void a_tuning_that_is_none_is_refused(void **state)
{
    (void)state;
    struct linear_worst w;
    struct apc_error why;
    assert_int_equal(linear_worst(&w, &lag, &lag, &(struct apc_pid_tuning){.Kp = (double)NAN}, TS, &why),
                     APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_certain_has_no_worst),
        cmocka_unit_test(the_worst_has_the_most_gain),
        cmocka_unit_test(models_that_make_it_unstable_are_counted),
        cmocka_unit_test(what_the_record_does_not_tell_is_uncertain),
        cmocka_unit_test(a_tuning_that_is_none_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
