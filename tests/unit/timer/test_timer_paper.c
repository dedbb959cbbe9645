/* SPDX-License-Identifier: BSD-3-Clause */
/* The paper's three functions, called as its Listing 1 does. */
#include "apctimer.h"
#include "check.h"
#include "timer_test.h"

/* Never freed while the process lives: a callback may come after timer_delete(). */
static sem_t called;

static void callback(union sigval value)
{
    sem_post(value.sival_ptr);
}

static void a_timer_calls_at_once_and_again_and_can_be_stopped_and_restarted(void **state)
{
    struct itimerspec left;
    timer_t timer = create_apctimer(callback, &called);
    (void)state;
    assert_true(timer != (timer_t)0);

    assert_int_equal(start_apctimer(timer, 3600.0), 0);
    assert_true(posted(&called)); /* the first call does not wait for the period */
    assert_int_equal(timer_gettime(timer, &left), 0);
    assert_int_equal(left.it_interval.tv_sec, 3600);
    assert_int_equal(left.it_interval.tv_nsec, 0);

    assert_int_equal(start_apctimer(timer, 0.0025), 0);
    for (int i = 0; i < 5; i++)
        assert_true(posted(&called));
    assert_int_equal(timer_gettime(timer, &left), 0);
    assert_int_equal(left.it_interval.tv_sec, 0);
    assert_int_equal(left.it_interval.tv_nsec, 2500000);

    assert_int_equal(stop_apctimer(timer), 0);
    assert_int_equal(timer_gettime(timer, &left), 0);
    assert_int_equal(left.it_value.tv_sec, 0);
    assert_int_equal(left.it_value.tv_nsec, 0);
    assert_int_equal(stop_apctimer(timer), 0);
    assert_int_equal(timer_delete(timer), 0);
}

static void seconds_and_nanoseconds_of_a_period_are_split_right(void **state)
{
    const struct {
        double Ts;
        long s, ns;
    } cases[] = {{2.5, 2, 500000000}, {0.00001, 0, 10000},     {0.999999999, 0, 999999999},
                 {1.0, 1, 0},         {150.2, 150, 200000000}, {31622400.0, 31622400, 0}};
    timer_t timer = create_apctimer(callback, &called);
    struct itimerspec left;
    (void)state;
    assert_true(timer != (timer_t)0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(start_apctimer(timer, cases[i].Ts), 0);
        assert_int_equal(timer_gettime(timer, &left), 0);
        assert_int_equal(stop_apctimer(timer), 0);
        assert_int_equal(left.it_interval.tv_sec, cases[i].s);
        assert_int_equal(left.it_interval.tv_nsec, cases[i].ns);
    }
    assert_int_equal(timer_delete(timer), 0);
}

static void a_senseless_period_leaves_the_timer_as_it_was(void **state)
{
    const double bad[] = {0.0,  -1.0, 0.000009, 31622401.0, (double)NAN, (double)INFINITY, -(double)INFINITY,
                          1e300};
    timer_t timer = create_apctimer(callback, &called);
    struct itimerspec left;
    (void)state;
    assert_true(timer != (timer_t)0);
    assert_int_equal(start_apctimer(timer, 3600.0), 0);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(start_apctimer(timer, bad[i]), APC_EINVAL);
    assert_int_equal(timer_gettime(timer, &left), 0);
    assert_int_equal(left.it_interval.tv_sec, 3600);
    assert_int_equal(timer_delete(timer), 0);
}

static void no_function_and_no_timer_are_refused(void **state)
{
    (void)state;
    errno = 0;
    assert_true(create_apctimer(NULL, NULL) == (timer_t)0);
    assert_int_equal(errno, EINVAL);
    assert_int_equal(start_apctimer((timer_t)0, 1.0), APC_EINVAL);
    assert_int_equal(stop_apctimer((timer_t)0), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_timer_calls_at_once_and_again_and_can_be_stopped_and_restarted),
        cmocka_unit_test(seconds_and_nanoseconds_of_a_period_are_split_right),
        cmocka_unit_test(a_senseless_period_leaves_the_timer_as_it_was),
        cmocka_unit_test(no_function_and_no_timer_are_refused),
    };
    if (!REAL_TIMERS)
        return 77;
    sem_init(&called, 0, 0);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
