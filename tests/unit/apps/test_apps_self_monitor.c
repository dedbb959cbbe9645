/* SPDX-License-Identifier: BSD-3-Clause */
/* What a daemon looks out for: steps of the wall clock, ticks missed in a row, a history that lags. */
#include "check.h"
#include "daemon/self_monitor.h"

#include <apctimer.h>

#define HOUR (3600 * APC_NS_PER_S)

/* Both clocks in one's hand. From reading number `away` on, `gap` has passed: as after a SIGSTOP. */
struct hand {
    apc_ns mono, utc;
    int readings, away;
    apc_ns gap;
};

static apc_ns passing(struct hand *h)
{
    h->mono += 30;
    h->utc += 30;
    if (++h->readings == h->away) {
        h->mono += h->gap;
        h->utc += h->gap;
    }
    return 0;
}

static apc_ns hand_mono(void *ctx)
{
    struct hand *h = ctx;
    return passing(h) + h->mono;
}

static apc_ns hand_utc(void *ctx)
{
    struct hand *h = ctx;
    return passing(h) + h->utc;
}

static void move(struct hand *h, apc_ns by)
{
    h->mono += by;
    h->utc += by;
}

static void a_step_either_way_is_seen_once_and_slewing_is_not(void **state)
{
    struct hand h = {.mono = HOUR, .utc = 1800000000 * APC_NS_PER_S};
    const struct apc_clock clock = {hand_mono, hand_utc, &h};
    struct clock_watch w;
    (void)state;

    clock_watch_init(&w, &clock);
    move(&h, APC_NS_PER_S);
    assert_int_equal(clock_watch_look(&w), 0);
    h.utc += HOUR;
    assert_near(apc_ns_to_s(clock_watch_look(&w)), 3600, 1e-6);
    move(&h, APC_NS_PER_S);
    assert_int_equal(clock_watch_look(&w), 0);
    h.utc -= HOUR;
    assert_near(apc_ns_to_s(clock_watch_look(&w)), -3600, 1e-6);
    assert_int_equal(clock_watch_look(&w), 0);
    for (int i = 0; i < 1000; i++) { /* 500 ppm, as the kernel slews at most, add up to half a second */
        move(&h, APC_NS_PER_S);
        h.utc += APC_NS_PER_S / 2000;
        assert_int_equal(clock_watch_look(&w), 0);
    }
}

static void half_a_second_is_no_step_and_a_nanosecond_more_is(void **state)
{
    static const apc_ns half = APC_NS_PER_S / 2;
    struct hand h = {.mono = HOUR, .utc = 1800000000 * APC_NS_PER_S};
    const struct apc_clock clock = {hand_mono, hand_utc, &h};
    struct clock_watch w;
    (void)state;

    clock_watch_init(&w, &clock);
    for (int sign = -1; sign <= 1; sign += 2) {
        h.utc += sign * half;
        assert_int_equal(clock_watch_look(&w), 0);
        h.utc += sign * (half + 1);
        assert_int_equal(clock_watch_look(&w), sign * (half + 1));
    }
}

static void a_process_that_was_stopped_between_two_readings_saw_no_step(void **state)
{
    bool was_away = true;
    (void)state;
    for (int away = 1; was_away; away++) { /* between any two */
        struct hand h = {.mono = HOUR, .utc = 2 * HOUR, .away = away, .gap = 3 * APC_NS_PER_S};
        const struct apc_clock clock = {hand_mono, hand_utc, &h};
        struct clock_watch w;
        clock_watch_init(&w, &clock);
        assert_int_equal(clock_watch_look(&w), 0);
        was_away = h.readings >= away;
        assert_true(was_away || away > 2);
    }
}

static void ten_in_a_row_are_an_alarm_until_there_are_fewer(void **state)
{
    struct overrun_watch w = {0};
    (void)state;
    assert_int_equal(overrun_watch_look(&w, 0, 0), OVERRUN_SAME);
    assert_int_equal(overrun_watch_look(&w, APC_OVERRUN_ALARM - 1, 0), OVERRUN_SAME);
    assert_int_equal(overrun_watch_look(&w, APC_OVERRUN_ALARM, 1), OVERRUN_BEGAN);
    assert_int_equal(overrun_watch_look(&w, 5000, 1), OVERRUN_SAME);
    assert_int_equal(overrun_watch_look(&w, 0, 1), OVERRUN_ENDED);
    assert_int_equal(overrun_watch_look(&w, 0, 1), OVERRUN_SAME);
}

static void the_tenth_is_the_first_that_is_one_too_many(void **state)
{
    struct overrun_watch w = {0};
    (void)state;
    assert_int_equal(overrun_watch_look(&w, APC_OVERRUN_ALARM, 0), OVERRUN_BEGAN);
    assert_int_equal(overrun_watch_look(&w, APC_OVERRUN_ALARM, 0), OVERRUN_SAME);
    assert_int_equal(overrun_watch_look(&w, APC_OVERRUN_ALARM - 1, 0), OVERRUN_ENDED);
}

static void an_alarm_between_two_looks_is_not_lost(void **state)
{
    struct overrun_watch w = {0};
    (void)state;
    assert_int_equal(overrun_watch_look(&w, 0, 3), OVERRUN_BEGAN);
    assert_int_equal(overrun_watch_look(&w, 0, 3), OVERRUN_ENDED);
}

static void a_callback_that_hangs_is_one_alarm(void **state)
{
    struct overrun_watch w = {0};
    (void)state;
    assert_int_equal(overrun_watch_look(&w, 40, 0), OVERRUN_BEGAN); /* not counted before it returns */
    assert_int_equal(overrun_watch_look(&w, 60, 0), OVERRUN_SAME);
    assert_int_equal(overrun_watch_look(&w, 0, 1), OVERRUN_ENDED);
    assert_int_equal(overrun_watch_look(&w, 0, 1), OVERRUN_SAME);
}

/* Promise(run/ready-once-watchdog) */
static void a_task_ticks_unless_ticks_are_missed_and_none_returns(void **state)
{
    struct tick_watch w = {0};
    (void)state;
    assert_true(tick_watch_look(&w, 0, 0)); /* its first tick is still to come */
    assert_true(tick_watch_look(&w, 0, 0));
    assert_true(tick_watch_look(&w, 1, 0));
    assert_true(tick_watch_look(&w, 2, 7));  /* an overrun, but it came back */
    assert_true(tick_watch_look(&w, 2, 7));  /* and waits for its next instant */
    assert_false(tick_watch_look(&w, 2, 8)); /* it hangs */
    assert_false(tick_watch_look(&w, 2, 9));
    assert_false(tick_watch_look(&w, 2, 8));
    assert_true(tick_watch_look(&w, 3, 9)); /* back */
    assert_true(tick_watch_look(&w, 4, 0));
    assert_false(tick_watch_look(&w, 4, 1));
}

static void a_task_that_hangs_in_its_first_tick_does_not_tick(void **state)
{
    struct tick_watch w = {0};
    (void)state;
    assert_true(tick_watch_look(&w, 0, 0));
    assert_false(tick_watch_look(&w, 0, 1));
}

/* Promise(run/link-that-flaps) */
static void of_a_state_that_flaps_a_few_changes_are_told_and_then_how_it_is(void **state)
{
    struct state_watch w = {.up = true};
    apc_ns now = HOUR;
    int told = 0;
    (void)state;
    assert_int_equal(state_watch_look(&w, true, now), CHANGE_NONE);
    for (int i = 0; i < STATE_CHANGES; i++)
        assert_int_equal(state_watch_look(&w, i % 2, now), CHANGE_ONE);
    for (int i = 0; i < 3000; i++) { /* ten changes a second for five minutes */
        now += APC_NS_PER_S / 10;
        told += state_watch_look(&w, i % 2, now) != CHANGE_NONE;
    }
    assert_int_equal(told, 20); /* one every fifteen seconds */
    assert_int_equal(state_watch_look(&w, true, now += STATE_AGAIN), CHANGE_NONE); /* nothing is new */
    for (int i = 0; i < 3; i++)
        now += STATE_AGAIN;
    for (int i = 0; i < STATE_CHANGES; i++)
        assert_int_equal(state_watch_look(&w, i % 2, now), CHANGE_ONE);
    assert_int_equal(state_watch_look(&w, false, now), CHANGE_NONE); /* held back, */
    assert_int_equal(state_watch_look(&w, false, now + STATE_AGAIN - 1), CHANGE_NONE);
    assert_int_equal(state_watch_look(&w, false, now + STATE_AGAIN), CHANGE_ONE); /* and told all the same */
}

/* Whatever it does: who heard all that was told knows a pause after the last change how it is, and never had
 * more words than are allowed. */
/*
 * Promise(run/link-that-flaps): A listener to what is told of a link that flaps knows 15 s after its last
 *   change how it is.
 */
static void who_hears_all_that_is_told_knows_the_state(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 200; seed++) {
        struct state_watch w = {.up = true};
        struct apc_random random;
        bool up = true, believed = true;
        apc_ns now = HOUR, changed = now;
        unsigned words = 0;
        apc_random_init(&random, seed, "flaps");
        for (int i = 0; i < 2000; i++) {
            now += (apc_ns)(apc_random_uniform(&random) * 2e9);
            if (apc_random_uniform(&random) < (i / 300 % 2 ? 0.5 : 0.01)) {
                up = !up;
                changed = now;
            }
            if (state_watch_look(&w, up, now) != CHANGE_NONE) {
                believed = w.up;
                words++;
            }
            if (now - changed > STATE_AGAIN)
                assert_int_equal(believed, up);
        }
        assert_true(words <= STATE_CHANGES + (now - HOUR) / STATE_AGAIN);
    }
}

#define LATE (LAG_LIMIT + 1)

/*
 * Promise(stores/history-merely-slow): A history that is merely slow is told once, and once when it has
 *   caught up.
 */
static void a_history_that_is_slow_is_told_once_and_once_when_it_has_all(void **state)
{
    struct lag_watch w = {.away = false};
    (void)state;
    for (int i = 0; i < 2; i++) { /* again and again */
        assert_int_equal(lag_watch_look(&w, false, 0, 1), LAG_SAME);
        assert_int_equal(lag_watch_look(&w, false, 9, LAG_LIMIT), LAG_SAME); /* no more than a hiccup */
        assert_int_equal(lag_watch_look(&w, false, 9, LATE), LAG_SLOW);
        assert_int_equal(lag_watch_look(&w, false, 9, 3 * LATE), LAG_SAME);
        assert_int_equal(lag_watch_look(&w, false, 0, 3 * LATE), LAG_SAME); /* nobody has looked since */
        assert_int_equal(lag_watch_look(&w, false, 0, 1), LAG_ENDED);
        assert_int_equal(w.late, 3 * LATE);
        assert_int_equal(lag_watch_look(&w, false, 0, 1), LAG_SAME);
        assert_int_equal(w.late, 1); /* of the next trouble only its own counts */
    }
}

static void a_history_has_all_when_nothing_is_behind_and_its_last_was_in_time(void **state)
{
    struct lag_watch w = {.away = false};
    (void)state;
    assert_int_equal(lag_watch_look(&w, false, 9, LATE), LAG_SLOW);
    assert_int_equal(lag_watch_look(&w, false, 1, 1), LAG_SAME); /* one row is behind */
    assert_int_equal(lag_watch_look(&w, false, 0, LATE), LAG_SAME);
    assert_int_equal(lag_watch_look(&w, true, 0, 1), LAG_AWAY);
    assert_int_equal(lag_watch_look(&w, true, 0, 1), LAG_SAME);
    assert_int_equal(lag_watch_look(&w, false, 0, LAG_LIMIT), LAG_ENDED);
}

/* Promise(stores/history-merely-slow) */
static void a_history_that_was_away_catches_up_without_being_called_slow(void **state)
{
    struct lag_watch w = {.away = false};
    (void)state;
    assert_int_equal(lag_watch_look(&w, true, 9, 1), LAG_AWAY);
    assert_int_equal(lag_watch_look(&w, true, 9, 2 * LATE), LAG_SAME);
    assert_int_equal(lag_watch_look(&w, false, 9, 3 * LATE), LAG_SAME);
    assert_int_equal(lag_watch_look(&w, true, 9, 4 * LATE), LAG_SAME); /* the same outage */
    assert_int_equal(lag_watch_look(&w, false, 9, 5 * LATE), LAG_SAME);
    assert_int_equal(lag_watch_look(&w, false, 0, 0), LAG_ENDED);
    assert_int_equal(w.late, 5 * LATE);
    assert_int_equal(lag_watch_look(&w, false, 9, LATE), LAG_SLOW);
    assert_int_equal(lag_watch_look(&w, true, 9, LATE), LAG_AWAY); /* a slow one may go */
    assert_int_equal(lag_watch_look(&w, false, 0, 0), LAG_ENDED);
    assert_int_equal(lag_watch_look(&w, true, 0, 0), LAG_AWAY);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_step_either_way_is_seen_once_and_slewing_is_not),
        cmocka_unit_test(half_a_second_is_no_step_and_a_nanosecond_more_is),
        cmocka_unit_test(a_process_that_was_stopped_between_two_readings_saw_no_step),
        cmocka_unit_test(ten_in_a_row_are_an_alarm_until_there_are_fewer),
        cmocka_unit_test(the_tenth_is_the_first_that_is_one_too_many),
        cmocka_unit_test(an_alarm_between_two_looks_is_not_lost),
        cmocka_unit_test(a_callback_that_hangs_is_one_alarm),
        cmocka_unit_test(a_task_ticks_unless_ticks_are_missed_and_none_returns),
        cmocka_unit_test(a_task_that_hangs_in_its_first_tick_does_not_tick),
        cmocka_unit_test(a_history_that_is_slow_is_told_once_and_once_when_it_has_all),
        cmocka_unit_test(a_history_has_all_when_nothing_is_behind_and_its_last_was_in_time),
        cmocka_unit_test(a_history_that_was_away_catches_up_without_being_called_slow),
        cmocka_unit_test(of_a_state_that_flaps_a_few_changes_are_told_and_then_how_it_is),
        cmocka_unit_test(who_hears_all_that_is_told_knows_the_state),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
