/* SPDX-License-Identifier: BSD-3-Clause */
/* The states of an alarm against the standard's table, and when its condition is there. */
#include "check.h"

#include <math.h>

#include "modules/alarm.h"
#include "modules/controller.h"

#define S APC_NS_PER_S

/* ---- States ------------------------------------------------------------------------------- */

/* The states by their letters in ISA-18.2; small while the condition is there, O and o shelved once. */
static const char letters[] = "?ABCDEFGgOoHhIi";

/* All that changes something: the standard's figure, arrow by arrow. */
static const struct {
    enum apc_alarm_event event;
    bool latching;
    const char *arrows;
} figure[] = {
    {APC_ALARM_COMES, false, "AB DB EB FB Gg Oo Hh Ii"},
    {APC_ALARM_COMES, true, "AB DB EB FB Gg Oo Hh Ii"},
    {APC_ALARM_GOES, false, "BD CA gG oA hH iI"},
    {APC_ALARM_GOES, true, "BE CF gG oA hH iI"},
    {APC_ALARM_ACKNOWLEDGE, false, "BC DA EF"},
    {APC_ALARM_ACKNOWLEDGE, true, "BC DA EF"},
    {APC_ALARM_RESET, false, "FA"},
    {APC_ALARM_RESET, true, "FA"},
    {APC_ALARM_SHELVE, false, "AG DG EG FG Bg Cg OG og HG hg IG ig"},
    {APC_ALARM_SHELVE, true, "AG DG EG FG Bg Cg OG og HG hg IG ig"},
    {APC_ALARM_SHELVE_ONCE, false, "AO DO EO FO Bo Co GO go HO ho IO io"},
    {APC_ALARM_SHELVE_ONCE, true, "AO DO EO FO Bo Co GO go HO ho IO io"},
    {APC_ALARM_UNSHELVE, false, "GA gB OA oB"},
    {APC_ALARM_UNSHELVE, true, "GA gB OA oB"},
    {APC_ALARM_SUPPRESS, false, "AH DH EH FH Bh Ch GH gh OH oh IH ih"},
    {APC_ALARM_SUPPRESS, true, "AH DH EH FH Bh Ch GH gh OH oh IH ih"},
    {APC_ALARM_UNSUPPRESS, false, "HA hB"},
    {APC_ALARM_UNSUPPRESS, true, "HA hB"},
    {APC_ALARM_REMOVE, false, "AI DI EI FI Bi Ci GI gi OI oi HI hi"},
    {APC_ALARM_REMOVE, true, "AI DI EI FI Bi Ci GI gi OI oi HI hi"},
    {APC_ALARM_RESTORE, false, "IA iB"},
    {APC_ALARM_RESTORE, true, "IA iB"},
};
#define ROWS (sizeof figure / sizeof *figure)

static char expected(char from, const char *arrows)
{
    for (; *arrows; arrows += arrows[2] ? 3 : 2)
        if (*arrows == from)
            return arrows[1];
    return from;
}

/*
 * Promise(alarms/alarm-state-isa): Each alarm is in one state of ISA-18.2, by its table, cell by cell; the
 *   journal is whole and in order whatever happens.
 */
static void each_state_and_event_is_as_in_the_standard(void **state)
{
    (void)state;
    assert_int_equal(ROWS, 2 * (APC_ALARM_EVENTS - 1));
    for (size_t i = 0; i < ROWS; i++)
        for (int from = 1; from < APC_ALARM_STATES; from++) {
            const enum apc_alarm_state to =
                apc_alarm_next((enum apc_alarm_state)from, figure[i].event, figure[i].latching);
            const char wanted = expected(letters[from], figure[i].arrows);
            if (letters[to] != wanted)
                fail_msg("event %d%s in %c leads to %c, not %c", figure[i].event,
                         figure[i].latching ? " (latching)" : "", letters[from], letters[to], wanted);
        }
}

static void what_is_no_state_is_normal_and_what_is_no_event_changes_nothing(void **state)
{
    (void)state;
    for (int i = -1; i <= APC_ALARM_STATES; i += APC_ALARM_STATES + 1) {
        assert_int_equal(apc_alarm_next((enum apc_alarm_state)i, APC_ALARM_COMES, false), APC_ALARM_UNACKED);
        assert_null(apc_alarm_state_name((enum apc_alarm_state)i));
        assert_false(apc_alarm_is_masked((enum apc_alarm_state)i) ||
                     apc_alarm_is_standing((enum apc_alarm_state)i));
    }
    assert_null(apc_alarm_state_name((enum apc_alarm_state)0));
    for (int from = 1; from < APC_ALARM_STATES; from++)
        for (int event = -1; event <= APC_ALARM_EVENTS; event++)
            if (event < 1 || event == APC_ALARM_EVENTS)
                assert_int_equal(
                    apc_alarm_next((enum apc_alarm_state)from, (enum apc_alarm_event)event, true), from);
}

/* What Part 9 says of each, beside the letters: Active, Unacknowledged, Latched, Masked. */
static void each_state_says_what_part_9_asks(void **state)
{
    static const char *const of[] = {"?",  "",  "AU", "A", "U",  "UL", "L", "M",
                                     "AM", "M", "AM", "M", "AM", "M",  "AM"};
    (void)state;
    for (int i = 1; i < APC_ALARM_STATES; i++) {
        const enum apc_alarm_state s = (enum apc_alarm_state)i;
        assert_int_equal(apc_alarm_is_active(s), strchr(of[i], 'A') != NULL);
        assert_int_equal(apc_alarm_is_unacked(s), strchr(of[i], 'U') != NULL);
        assert_int_equal(apc_alarm_is_latched(s), strchr(of[i], 'L') != NULL);
        assert_int_equal(apc_alarm_is_masked(s), strchr(of[i], 'M') != NULL);
        assert_int_equal(apc_alarm_is_standing(s), *of[i] && !strchr(of[i], 'M'));
        for (int j = 1; j < i; j++)
            assert_string_not_equal(apc_alarm_state_name(s), apc_alarm_state_name((enum apc_alarm_state)j));
    }
}

/* ---- Conditions --------------------------------------------------------------------------- */

/* An alarm, and what it is judged by: one look a second. */
struct world {
    struct apc_alarm alarm;
    struct apc_alarm_condition condition;
    struct apc_sample signal, other;
    struct apc_vector tick;
    double element[APC_TICK_INDEX_AT + 1];
    apc_ns now;
};

static struct world begin(enum apc_alarm_kind kind)
{
    return (struct world){
        .alarm = {.name = "a", .kind = kind, .limit = 8, .deadband = 1, .low = 0, .high = 10},
        .signal = {.status = APC_GOOD},
        .other = {.status = APC_GOOD}};
}

static bool look(struct world *w)
{
    const bool two = w->alarm.kind == APC_ALARM_DEVIATION || w->alarm.kind == APC_ALARM_MODE;
    const struct apc_alarm_inputs in = {
        .signal = &w->signal, .other = two ? &w->other : NULL, .tick = &w->tick};
    w->tick.value = w->element;
    w->now += S;
    return apc_alarm_judge(&w->condition, &w->alarm, &in,
                           (struct apc_now){.mono = w->now, .utc = 1700000000 * S + w->now});
}

static bool show(struct world *w, double value)
{
    w->signal.seq++;
    w->signal.time = 1700000000 * S + w->now + S;
    w->signal.value = value;
    return look(w);
}

static void a_level_comes_above_its_limit_and_goes_below_the_deadband(void **state)
{
    struct world high = begin(APC_ALARM_HIGH), low = begin(APC_ALARM_LOW);
    (void)state;
    assert_false(look(&high)); /* nothing is known */
    assert_false(show(&high, 8));
    assert_true(show(&high, 8.01));
    assert_true(show(&high, 7.01));
    assert_false(show(&high, 7));
    assert_false(show(&low, 8));
    assert_true(show(&low, 7.99));
    assert_true(show(&low, 8.99));
    assert_false(show(&low, 9));
    low.alarm.kind = APC_ALARM_LOW_LOW;
    assert_true(show(&low, 7));
    high.alarm.kind = APC_ALARM_HIGH_HIGH;
    assert_true(show(&high, 9));
    high.alarm.deadband = 0;
    assert_false(show(&high, 8));
}

static void a_delay_counts_from_when_it_began(void **state)
{
    struct world w = begin(APC_ALARM_HIGH);
    (void)state;
    w.alarm.on_delay = 3 * S;
    w.alarm.off_delay = 2 * S;
    for (int i = 0; i < 3; i++)
        assert_false(show(&w, 9));
    assert_false(show(&w, 7)); /* it begins anew */
    for (int i = 0; i < 3; i++)
        assert_false(show(&w, 9));
    assert_true(show(&w, 9));
    assert_true(show(&w, 7));
    assert_true(show(&w, 9));
    assert_true(show(&w, 7));
    assert_true(show(&w, 7));
    assert_false(show(&w, 7));
}

static void what_cannot_be_judged_stays_as_it_was(void **state)
{
    struct world w = begin(APC_ALARM_HIGH);
    (void)state;
    w.alarm.horizon = 2 * S;
    assert_true(show(&w, 9));
    w.signal.status = APC_BAD;
    assert_true(show(&w, 0));
    assert_true(w.condition.poor);
    w.signal.status = APC_UNCERTAIN;
    assert_false(show(&w, 0));
    assert_false(w.condition.poor);
    for (int i = 0; i < 4; i++)
        assert_false(look(&w));
    assert_true(w.condition.poor); /* stale */
    w.alarm.on_delay = 2 * S;
    assert_false(show(&w, 9));
    w.signal.status = APC_BAD;
    assert_false(show(&w, 0)); /* on its way, and then unknown */
    assert_true(show(&w, 0));
}

static void a_deviation_is_from_the_other_on_either_side(void **state)
{
    struct world w = begin(APC_ALARM_DEVIATION);
    (void)state;
    w.other.value = 100;
    assert_false(show(&w, 0)); /* there is no other one */
    assert_true(w.condition.poor);
    w.other.seq = 1;
    assert_true(show(&w, 0));
    assert_true(show(&w, 107.5));
    assert_false(show(&w, 107));
    assert_true(show(&w, 91));
    w.other.status = APC_BAD;
    assert_true(show(&w, 100));
}

static void a_rate_is_from_sample_to_sample_by_their_own_times(void **state)
{
    struct world w = begin(APC_ALARM_RATE);
    (void)state;
    assert_false(show(&w, 100));
    assert_false(show(&w, 108));
    assert_true(show(&w, 99));
    assert_true(look(&w)); /* nothing new */
    w.now += 9 * S;
    assert_false(show(&w, 150)); /* in 11 s */
    w.signal.time -= S;
    w.signal.seq++;
    w.signal.value = 1e9;
    assert_false(look(&w)); /* a clock that went back gives no rate */
}

static void what_does_not_change_is_frozen(void **state)
{
    struct world w = begin(APC_ALARM_FROZEN);
    (void)state;
    w.alarm.on_delay = 3 * S;
    assert_false(show(&w, 5));
    for (int i = 0; i < 3; i++)
        assert_false(show(&w, 5 + 0.3 * i));
    assert_true(show(&w, 4));
    assert_true(look(&w));
    assert_false(show(&w, 3.9));
    assert_false(show(&w, 3.9));
    w.now += 60 * S;
    assert_true(show(&w, 3.9));
}

static void bad_is_also_what_does_not_come_any_more(void **state)
{
    struct world w = begin(APC_ALARM_BAD);
    (void)state;
    w.alarm.horizon = 3 * S;
    for (int i = 0; i < 4; i++)
        assert_false(look(&w)); /* it may still come */
    assert_true(look(&w));
    assert_false(show(&w, 0));
    w.signal.status = APC_BAD_SENSOR_FAILURE;
    assert_true(show(&w, 0));
    w.signal.status = APC_UNCERTAIN;
    assert_false(show(&w, 0));
    for (int i = 0; i < 3; i++)
        assert_false(look(&w));
    assert_true(look(&w));
}

static void an_output_is_at_a_limit_on_either_side(void **state)
{
    struct world w = begin(APC_ALARM_AT_LIMIT);
    (void)state;
    assert_false(show(&w, 9.99));
    assert_true(show(&w, 10));
    assert_true(show(&w, 9.5));
    assert_false(show(&w, 8.5));
    assert_true(show(&w, 0));
    assert_true(show(&w, 1));
    assert_false(show(&w, 1.1));
}

static void a_mode_is_judged_once_the_controller_has_seen_the_target(void **state)
{
    struct world w = begin(APC_ALARM_MODE);
    (void)state;
    w.signal.seq = 7;
    w.signal.value = APC_MODE_CAS;
    assert_false(look(&w)); /* no controller has ticked */
    w.other = (struct apc_sample){.seq = 1, .origin = 6, .value = APC_MODE_AUTO};
    assert_false(look(&w));
    w.other.origin = 7;
    assert_true(look(&w));
    w.other.value = APC_MODE_CAS;
    assert_false(look(&w));
}

static void a_controller_is_stopped_when_its_ticks_stay_away(void **state)
{
    struct world w = begin(APC_ALARM_STOPPED);
    (void)state;
    w.alarm.horizon = 3 * S;
    for (int i = 0; i < 4; i++)
        assert_false(look(&w));
    assert_true(look(&w));
    w.tick = (struct apc_vector){.seq = 1, .time = 1700000000 * S + w.now};
    assert_false(look(&w));
    for (int i = 0; i < 2; i++)
        assert_false(look(&w));
    assert_true(look(&w));
}

/* A tick row; a controller's is longer than what is read of it. */
static bool tick(struct world *w, int64_t seq, double index)
{
    w->tick.seq = seq;
    w->tick.n = 40;
    w->element[APC_TICK_INDEX_AT] = index;
    return look(w);
}

static struct world begin_overrun(double limit)
{
    struct world w = begin(APC_ALARM_OVERRUN);
    w.alarm.limit = limit;
    return w;
}

/*
 * Promise(alarms/ticks-controller-missed): Ticks that a controller missed are an alarm, in virtual time as
 *   well; rows that the evaluation passed over, and a controller that begins anew, are none.
 */
static void a_tick_that_is_missed_is_an_overrun_once(void **state)
{
    struct world w = begin_overrun(1);
    (void)state;
    assert_false(look(&w)); /* no row yet */
    assert_false(tick(&w, 7, 1000));
    assert_false(tick(&w, 8, 1001));
    assert_true(tick(&w, 9, 1003));
    assert_false(tick(&w, 10, 1004));
    assert_true(tick(&w, 11, 1006));
    assert_true(tick(&w, 12, 1008));
    assert_false(look(&w)); /* the same row */
    assert_false(look(&w));
    assert_true(tick(&w, 13, 9000));
    w.tick.seq = 0;
    assert_false(look(&w));
    assert_false(tick(&w, 14, 9001));
}

/* Promise(alarms/ticks-controller-missed) */
static void an_overrun_has_a_limit_and_its_delays(void **state)
{
    struct world w = begin_overrun(3), none = begin_overrun(0);
    (void)state;
    assert_false(tick(&w, 1, 0));
    assert_false(tick(&w, 2, 3));
    assert_true(tick(&w, 3, 7));
    assert_false(tick(&w, 4, 10));
    w.alarm.off_delay = 2 * S;
    assert_true(tick(&w, 5, 20));
    assert_true(tick(&w, 6, 21));
    assert_true(tick(&w, 7, 22));
    assert_true(tick(&w, 8, 30)); /* from here the delay counts anew */
    assert_true(tick(&w, 9, 31));
    assert_true(tick(&w, 10, 32));
    assert_false(tick(&w, 11, 33));
    assert_false(tick(&none, 1, 0));
    assert_false(tick(&none, 2, 1)); /* none missed is no overrun, whatever the limit */
    assert_true(tick(&none, 3, 3));
}

/* Promise(alarms/ticks-controller-missed) */
static void rows_that_were_passed_over_are_no_overrun(void **state)
{
    struct world w = begin_overrun(1);
    (void)state;
    assert_false(tick(&w, 1, 1));
    assert_false(tick(&w, 101, 101));
    assert_true(tick(&w, 201, 202));
    assert_false(tick(&w, 301, 302));
    assert_false(tick(&w, 500, 350)); /* more rows than ticks */
    assert_false(tick(&w, 501, 351));
}

/* Promise(alarms/ticks-controller-missed) */
static void a_controller_or_a_store_that_begins_anew_is_no_overrun(void **state)
{
    struct world w = begin_overrun(1);
    (void)state;
    assert_false(tick(&w, 50, 1000));
    assert_false(tick(&w, 51, 0)); /* another grid */
    assert_false(tick(&w, 52, 1));
    assert_true(tick(&w, 53, 3));
    assert_false(tick(&w, 54, 3)); /* the same tick again */
    assert_false(tick(&w, 3, 2000));
    assert_false(tick(&w, 4, 2001));
    assert_true(tick(&w, 5, 2003));
}

/* Promise(alarms/ticks-controller-missed) */
static void a_row_without_a_usable_index_is_passed_over(void **state)
{
    const double of[] = {(double)NAN, HUGE_VAL, -HUGE_VAL, -1, 1e300, 0x1p53 + 2};
    struct world w = begin_overrun(1);
    int64_t seq = 1;
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_false(tick(&w, seq++, of[i]));
    assert_false(tick(&w, seq, (double)seq));
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        assert_false(tick(&w, ++seq, of[i]));
        ++seq;
        assert_false(tick(&w, seq, (double)seq));
    }
    w.tick.n = APC_TICK_INDEX_AT;
    w.tick.seq = ++seq;
    w.element[APC_TICK_INDEX_AT] = 1e6;
    assert_false(look(&w));
    ++seq;
    assert_true(tick(&w, seq, (double)seq + 1));
}

int main(void)
{
#define EACH(name) cmocka_unit_test(name)
    const struct CMUnitTest tests[] = {
        EACH(each_state_and_event_is_as_in_the_standard),
        EACH(what_is_no_state_is_normal_and_what_is_no_event_changes_nothing),
        EACH(each_state_says_what_part_9_asks),
        EACH(a_level_comes_above_its_limit_and_goes_below_the_deadband),
        EACH(a_delay_counts_from_when_it_began),
        EACH(what_cannot_be_judged_stays_as_it_was),
        EACH(a_deviation_is_from_the_other_on_either_side),
        EACH(a_rate_is_from_sample_to_sample_by_their_own_times),
        EACH(what_does_not_change_is_frozen),
        EACH(bad_is_also_what_does_not_come_any_more),
        EACH(an_output_is_at_a_limit_on_either_side),
        EACH(a_mode_is_judged_once_the_controller_has_seen_the_target),
        EACH(a_controller_is_stopped_when_its_ticks_stay_away),
        EACH(a_tick_that_is_missed_is_an_overrun_once),
        EACH(an_overrun_has_a_limit_and_its_delays),
        EACH(rows_that_were_passed_over_are_no_overrun),
        EACH(a_controller_or_a_store_that_begins_anew_is_no_overrun),
        EACH(a_row_without_a_usable_index_is_passed_over),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
