/* SPDX-License-Identifier: BSD-3-Clause */
/* The grid against a slow, obviously right model in 128-bit integers. */
#include "check.h"
#include "timer/timer_internal.h"
#include "timer_test.h"

#define CASES 200000

__extension__ typedef __int128 wide;

/* Any magnitude with equal chance, the ends of the range among them. */
static apc_ns any_time(uint64_t *state)
{
    uint64_t bits = xorshift(state) >> xorshift(state) % 64;
    switch (xorshift(state) % 8) {
    case 0:
        return INT64_MAX - (apc_ns)(bits >> 32);
    case 1:
        return INT64_MIN + (apc_ns)(bits >> 32);
    default:
        return (apc_ns)bits;
    }
}

static apc_ns any_period(uint64_t *state)
{
    return (apc_ns)(xorshift(state) >> (1 + xorshift(state) % 62)) + 1;
}

static wide exact_time(apc_ns start, apc_ns period, uint64_t index)
{
    return (wide)start + (wide)index * period;
}

static void time_of_a_tick_is_exact_and_saturates(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int i = 0; i < CASES; i++) {
        apc_ns start = any_time(&random), period = any_period(&random);
        uint64_t index = xorshift(&random) >> xorshift(&random) % 64;
        wide exact = exact_time(start, period, index);
        assert_true(apc_grid_time(start, period, index) == (exact > INT64_MAX ? INT64_MAX : (apc_ns)exact));
    }
    assert_true(apc_grid_time(INT64_MIN, INT64_MAX, 2) == INT64_MAX - 1);
    assert_true(apc_grid_time(INT64_MIN, INT64_MAX, 3) == INT64_MAX);
    assert_true(apc_grid_time(INT64_MAX, 1, 1) == INT64_MAX);
    assert_true(apc_grid_time(0, 1, UINT64_MAX) == INT64_MAX);
    assert_true(apc_grid_time(-5, 7, 0) == -5);
}

static void next_is_the_smallest_index_not_before_now(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int i = 0; i < CASES; i++) {
        apc_ns start = any_time(&random), period = any_period(&random), now = any_time(&random);
        uint64_t next = apc_grid_next(start, period, now);
        assert_true(exact_time(start, period, next) >= now);
        assert_true(next == 0 || exact_time(start, period, next - 1) < now);
    }
    assert_int_equal(apc_grid_next(100, 10, INT64_MIN), 0);
    assert_int_equal(apc_grid_next(100, 10, 100), 0);
    assert_int_equal(apc_grid_next(100, 10, 101), 1);
    assert_int_equal(apc_grid_next(100, 10, 110), 1);
    assert_true(apc_grid_next(INT64_MIN, 1, INT64_MAX) == UINT64_MAX);
}

static void next_and_time_invert_each_other(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int i = 0; i < CASES; i++) {
        apc_ns start = (apc_ns)(xorshift(&random) >> 2), period = (any_period(&random) >> 20) + 1;
        uint64_t index = xorshift(&random) >> 46;
        assert_true(apc_grid_next(start, period, apc_grid_time(start, period, index)) == index);
    }
}

static void newest_is_the_largest_index_not_after_now_but_never_before_due(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int i = 0; i < CASES; i++) {
        apc_ns start = any_time(&random), period = any_period(&random), now = any_time(&random);
        uint64_t due = xorshift(&random) >> xorshift(&random) % 64;
        uint64_t newest = apc_grid_newest(start, period, due, now);
        assert_true(newest >= due);
        assert_true(newest == due || exact_time(start, period, newest) <= now);
        assert_true(newest == UINT64_MAX || exact_time(start, period, newest + 1) > now);
    }
}

static void resume_is_later_than_the_tick_that_ran_and_not_before_now(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int i = 0; i < CASES; i++) {
        apc_ns start = any_time(&random), period = any_period(&random), now = any_time(&random);
        uint64_t index = xorshift(&random) >> (1 + xorshift(&random) % 63);
        uint64_t next = apc_grid_resume(start, period, index, now);
        assert_true(next > index);
        assert_true(exact_time(start, period, next) >= now);
        assert_true(next == index + 1 || exact_time(start, period, next - 1) < now);
    }
    assert_int_equal(apc_grid_resume(0, 10, 4, 50), 5); /* tick 5 exactly now: not missed */
    assert_int_equal(apc_grid_resume(0, 10, 4, 51), 6);
}

/* The life of a task under random delays, by the two rules alone. */
/* Promise(run/callbacks-never-overlap) */
static void every_tick_up_to_due_is_run_or_missed_and_calls_are_in_time(void **state)
{
    uint64_t random = seed();
    (void)state;
    for (int life = 0; life < 1000; life++) {
        apc_ns start = (apc_ns)(xorshift(&random) >> 4), period = 1 + (apc_ns)(xorshift(&random) >> 34);
        apc_ns now = start;
        uint64_t due = 0, calls = 0, missed = 0;
        for (int i = 0; i < 50; i++) {
            apc_ns wake = apc_grid_time(start, period, due);
            now = now > wake ? now : wake;
            if (xorshift(&random) % 4 == 0)
                now += (apc_ns)(xorshift(&random) % (5 * (uint64_t)period)); /* woken late */
            uint64_t index = apc_grid_newest(start, period, due, now);
            missed += index - due;
            assert_true(now - apc_grid_time(start, period, index) < period);
            calls++;
            now += (apc_ns)(xorshift(&random) % (2 * (uint64_t)period)); /* the callback */
            due = apc_grid_resume(start, period, index, now);
            missed += due - (index + 1);
            assert_true(calls + missed == due);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(time_of_a_tick_is_exact_and_saturates),
        cmocka_unit_test(next_is_the_smallest_index_not_before_now),
        cmocka_unit_test(next_and_time_invert_each_other),
        cmocka_unit_test(newest_is_the_largest_index_not_after_now_but_never_before_due),
        cmocka_unit_test(resume_is_later_than_the_tick_that_ran_and_not_before_now),
        cmocka_unit_test(every_tick_up_to_due_is_run_or_missed_and_calls_are_in_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
