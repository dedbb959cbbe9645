/* SPDX-License-Identifier: BSD-3-Clause */
/* What other settings of an alarm would have given on the record, beside a count that is written a second time. */
#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "record/record.h"
#include "simulation/simulation.h"

#define S       APC_NS_PER_S
#define BEGIN   (INT64_C(1700000000) * S)
#define SECONDS 7200
#define RATE    5 /* samples a second */
#define N       (SECONDS * RATE)

/* ---- Counted a second time ----------------------------------------------------------------- */

struct level {
    double value[N];
    bool bad[N], masked[SECONDS];
};

struct count {
    size_t raised, missed;
    double later, longest;
};

/* Seconds are looked at one after another; those with a sample before the first one only. */
static void condition(const struct level *r, const struct apc_alarm *a, double on, double off,
                      double deadband, bool *told)
{
    bool raw = false, is = false;
    int changed = 0;
    for (int s = 0; s < SECONDS; s++) {
        const int k = RATE * s; /* the sample of that very instant */
        const double beyond = a->kind == APC_ALARM_HIGH ? r->value[k] - a->limit : a->limit - r->value[k];
        const bool before = raw;
        if (!r->bad[k])
            raw = raw ? beyond > -deadband : beyond > 0;
        if (raw != before)
            changed = s;
        if (raw != is && s - changed >= (raw ? on : off))
            is = raw;
        told[s] = is && !r->masked[s];
    }
}

static struct count count(const bool *is, const bool *other)
{
    struct count c = {0};
    for (int s = 0; s < SECONDS; s++)
        c.raised += other[s] && (s == 0 || !other[s - 1]);
    for (int s = 0, from; s < SECONDS; s++) {
        if (!is[s])
            continue;
        int told = -1;
        for (from = s; s < SECONDS && is[s]; s++)
            if (told < 0 && other[s])
                told = s;
        if (told >= 0)
            c.later = fmax(c.later, told - from);
        else if (s < SECONDS) {
            c.missed++;
            c.longest = fmax(c.longest, s - from);
        }
    }
    return c;
}

/* ---- Records ------------------------------------------------------------------------------ */

/* A level that wanders about its limit, with noise; its sensor fails now and then. */
static void draw_level(struct level *r, unsigned seed)
{
    struct apc_random random;
    double level = 0;
    apc_random_init(&random, seed, "level");
    memset(r, 0, sizeof *r);
    for (int k = 0; k < N; k++) {
        level = 0.998 * level + 0.05 * apc_random_normal(&random);
        r->value[k] = level + 0.2 * apc_random_normal(&random);
        r->bad[k] = k % 1000 > 950;
    }
    for (int s = 0; s < SECONDS; s++)
        r->masked[s] = s % 1500 > 1200;
}

static struct apc_store *empty_store(void)
{
    struct apc_store *store = NULL;
    struct apc_error why;
    if (apc_store_open(&store, "mem:", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_init(store) >= 0);
    return store;
}

static struct apc_store *store_of(const struct level *r)
{
    struct apc_store *store = empty_store();
    for (int k = 0; k < N; k++) {
        const struct apc_sample row = {.table = APC_SENSOR,
                                       .id = 1,
                                       .seq = k + 1,
                                       .time = BEGIN + k * (S / RATE),
                                       .value = r->value[k],
                                       .status = r->bad[k] ? APC_BAD_OUT_OF_RANGE : APC_GOOD};
        assert_true(apc_store_append(store, &row, 1) >= 0);
    }
    int64_t seq = 0;
    for (int s = 0; s < SECONDS; s++)
        if (r->masked[s] != (s > 0 && r->masked[s - 1])) { /* a little late, as a process is */
            seq++;
            const struct apc_sample row = {.table = APC_ALARM,
                                           .id = 1,
                                           .seq = seq,
                                           .time = BEGIN + s * S + S / 1000,
                                           .value = r->masked[s] ? APC_ALARM_SUPPRESSED : APC_ALARM_NORMAL,
                                           .origin = seq};
            assert_true(apc_store_append(store, &row, 1) >= 0);
        }
    return store;
}

static void compare_trial(const struct level *r, const struct alarm_trial *t, const struct apc_alarm *a)
{
    static bool is[SECONDS], other[SECONDS];
    const double on = apc_ns_to_s(a->on_delay), off = apc_ns_to_s(a->off_delay);
    condition(r, a, on, off, a->deadband, is);
    for (size_t i = 0; i < t->n; i++) {
        const struct alarm_try *one = &t->at[i];
        condition(r, a, one->setting == ALARM_ON_DELAY ? one->value : on,
                  one->setting == ALARM_OFF_DELAY ? one->value : off,
                  one->setting == ALARM_DEADBAND ? one->value : a->deadband, other);
        const struct count c = count(is, other);
        print_message("%s %g: %zu, %zu missed, %g s later\n", alarm_setting_name(one->setting), one->value,
                      c.raised, c.missed, c.later);
        assert_int_equal(one->raised, c.raised);
        assert_int_equal(one->missed, c.missed);
        assert_near(apc_ns_to_s(one->later), c.later, 1e-9);
        assert_near(apc_ns_to_s(one->longest), c.longest, 1e-9);
    }
}

static struct alarm_trial tried(struct apc_store *store, const struct apc_alarm *is)
{
    struct alarm alarm = {.is = *is, .name = "y.high"};
    const struct experiment e = {.alarm = &alarm, .n_alarms = 1, .alarms.rhythm.period = S};
    const struct apc_range range = {.since = BEGIN - 3600 * S, .until = BEGIN + SECONDS * S};
    struct alarm_trial t;
    struct apc_error why;
    if (alarm_trial_make(&t, store, &e, &alarm, BEGIN + 100 * S, &range, 0, &why) < 0)
        fail_msg("%s", why.text);
    alarm_trial_free(&t);
    assert_int_equal(t.since, BEGIN); /* where its record begins */
    return t;
}

/* Promise(alarms): `apc alarm try` counts what an on-delay, an off-delay and a deadband would have given on the
 *   record, by the code that evaluates alarms. The counts are those of a second, simple count. */
static void each_setting_gives_what_a_second_count_gives(void **state)
{
    const struct apc_alarm alarms[] = {
        {.name = "y.high", .kind = APC_ALARM_HIGH, .limit = 0.5},
        {.name = "y.low", .kind = APC_ALARM_LOW, .limit = -0.5, .deadband = 0.03, .on_delay = 3 * S},
        {.name = "y.high", .kind = APC_ALARM_HIGH, .limit = 0.1, .off_delay = 7 * S, .latching = true}};
    static struct level r;
    (void)state;
    for (size_t i = 0; i < sizeof alarms / sizeof *alarms; i++) {
        struct apc_alarm a = alarms[i];
        a.table = APC_SENSOR;
        a.id = a.priority = 1;
        draw_level(&r, (unsigned)i + 1);
        struct apc_store *store = store_of(&r);
        const struct alarm_trial t = tried(store, &a);
        assert_true(t.n > 10 && t.at[0].raised > 20);
        compare_trial(&r, &t, &a);
        apc_store_close(store);
    }
}

static void the_smallest_value_that_does_nearly_as_much_as_the_largest_is_proposed(void **state)
{
    struct alarm_trial t;
    struct apc_error why;
    const struct apc_alarm a = {
        .name = "y.high", .kind = APC_ALARM_HIGH, .table = APC_SENSOR, .id = 1, .limit = 1, .priority = 1};
    (void)state;
    if (alarm_trial_begin(&t, &a, 10, &(struct apc_sample){.table = APC_ALARM, .id = 1}, BEGIN, S, &why) < 0)
        fail_msg("%s", why.text);
    for (int s = 0; s < 1000; s++) /* for 4 s of ten beyond it, and 0.15 below it at most */
        alarm_trial_row(&t, &(struct apc_sample){.table = APC_SENSOR,
                                                 .id = 1,
                                                 .seq = s + 1,
                                                 .time = BEGIN + s * S,
                                                 .value = s % 10 < 4 ? 1.5 : 0.85});
    alarm_trial_end(&t, BEGIN + 1000 * S);
    alarm_trial_free(&t);
    assert_int_equal(t.at[0].raised, 100);
    size_t n = 0;
    for (size_t i = 0; i < t.n; i++) {
        const struct alarm_try *one = &t.at[i];
        n += one->proposed;
        if (!one->proposed)
            continue;
        assert_near(one->value,
                    one->setting == ALARM_ON_DELAY    ? 5
                    : one->setting == ALARM_OFF_DELAY ? 10
                                                      : 0.2,
                    1e-12);
        assert_int_equal(one->raised, one->setting == ALARM_ON_DELAY ? 0 : 1);
        assert_int_equal(one->missed, one->setting == ALARM_ON_DELAY ? 100 : 0);
        assert_near(apc_ns_to_s(one->longest), one->setting == ALARM_ON_DELAY ? 4 : 0, 0);
    }
    assert_int_equal(n, 3);
}

/* ---- Real ones ----------------------------------------------------------------------------- */

static void as_they_are_the_alarms_of_a_run_come_as_the_journal_has_them(void **state)
{
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    size_t n = 0;
    (void)state;
    if (experiment_load(&e, APC_SOURCE_DIR "/experiments/alarms/pump-failure.conf",
                        EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, e.duration) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < e.n_alarms; i++) {
        const struct apc_range range = {.since = SIMULATION_BEGIN,
                                        .until = SIMULATION_BEGIN + (apc_ns)(e.duration * 1e9)};
        struct alarm_trial t;
        if (e.alarm[i].is.kind == APC_ALARM_STOPPED)
            continue;
        if (alarm_trial_make(&t, s.store, &e, &e.alarm[i], SIMULATION_BEGIN, &range, 0, &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(t.at[0].raised, t.recorded);
        n += t.recorded;
        alarm_trial_free(&t);
    }
    assert_int_equal(n, 3);
    simulation_destroy(&s);
    experiment_free(&e);
}

/* The instant that is known of the evaluations may be of one that came later after its time than the others. */
static void an_alarm_of_the_first_evaluation_counts(void **state)
{
    struct alarm alarm = {.is = {.name = "y.high",
                                 .kind = APC_ALARM_HIGH,
                                 .table = APC_SENSOR,
                                 .id = 1,
                                 .limit = 0.5,
                                 .priority = 1},
                          .name = "y.high"};
    const struct experiment e = {.alarm = &alarm, .n_alarms = 1, .alarms.rhythm.period = S};
    const struct apc_sample rows[] = {{.table = APC_SENSOR, .id = 1, .seq = 1, .time = BEGIN, .value = 1},
                                      {.table = APC_ALARM,
                                       .id = 1,
                                       .seq = 1,
                                       .time = BEGIN + S / 4,
                                       .value = APC_ALARM_UNACKED,
                                       .origin = 1}};
    struct apc_store *store = empty_store();
    struct alarm_trial t;
    struct apc_error why;
    (void)state;
    assert_true(apc_store_append(store, rows, 2) >= 0);
    const struct apc_range range = {.since = BEGIN - S, .until = BEGIN + 9 * S};
    if (alarm_trial_make(&t, store, &e, &alarm, BEGIN + 5 * S + S / 3, &range, 0, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(t.since, BEGIN);
    assert_int_equal(t.recorded, 1);
    assert_int_equal(t.at[0].raised, 1);
    alarm_trial_free(&t);
    apc_store_close(store);
}

/* Evaluated second by second this would take minutes; and it is asked for what there is, not for each ten minutes. */
static void where_nothing_is_recorded_nothing_is_evaluated(void **state)
{
    static const struct {
        apc_ns time;
        double value;
    } recorded[] = {{S, -1}, {101 * S, 1}, {BEGIN, -1}, {BEGIN + 10 * S, 1}}; /* half a century apart */
    struct alarm alarm = {
        .is = {.name = "y.high", .kind = APC_ALARM_HIGH, .table = APC_SENSOR, .id = 1, .priority = 1},
        .name = "y.high"};
    const struct experiment e = {.alarm = &alarm, .n_alarms = 1, .alarms.rhythm.period = S};
    const struct apc_range range = {.since = S, .until = BEGIN + 3600 * S};
    struct apc_store *store = empty_store();
    struct alarm_trial t;
    struct apc_error why;
    (void)state;
    for (int i = 0; i < 4; i++) {
        const struct apc_sample row = {
            .table = APC_SENSOR, .id = 1, .seq = i + 1, .time = recorded[i].time, .value = recorded[i].value};
        assert_int_equal(apc_store_append(store, &row, 1), 1);
    }
    if (alarm_trial_make(&t, store, &e, &alarm, S, &range, 0, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(t.n > 10);
    for (size_t i = 0; i < t.n; i++) {
        const struct alarm_try *one = &t.at[i];
        assert_int_equal(one->raised, one->setting == ALARM_OFF_DELAY && one->value >= 10 ? 1 : 2);
        assert_int_equal(one->missed, 0);
        assert_near(apc_ns_to_s(one->later), one->setting == ALARM_ON_DELAY ? one->value : 0, 0);
    }
    alarm_trial_free(&t);
    apc_store_close(store);
}

static void what_cannot_be_tried_is_said(void **state)
{
    struct alarm alarm = {
        .is = {.name = "pi.stopped", .kind = APC_ALARM_STOPPED, .table = APC_TICK, .id = 1}};
    const struct experiment e = {.alarm = &alarm, .n_alarms = 1, .alarms.rhythm.period = S};
    static struct level r;
    struct apc_store *store = store_of(&r);
    struct alarm_trial t;
    struct apc_error why;
    (void)state;
    const struct apc_range range = {.since = BEGIN, .until = BEGIN + SECONDS * S};
    assert_int_equal(alarm_trial_make(&t, store, &e, &alarm, 0, &range, 0, &why), APC_EINVAL);
    alarm_trial_free(&t);
    alarm.is = (struct apc_alarm){
        .name = "y.high", .kind = APC_ALARM_HIGH, .table = APC_SENSOR, .id = 2, .priority = 1};
    assert_int_equal(alarm_trial_make(&t, store, &e, &alarm, 0, &range, 0, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "y.high"));
    alarm_trial_free(&t);
    alarm.is.id = 1;
    assert_int_equal(alarm_trial_make(&t, store, &e, &alarm, 0, &range, 1, &why), APC_ETIMEDOUT);
    alarm_trial_free(&t);
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_setting_gives_what_a_second_count_gives),
        cmocka_unit_test(the_smallest_value_that_does_nearly_as_much_as_the_largest_is_proposed),
        cmocka_unit_test(as_they_are_the_alarms_of_a_run_come_as_the_journal_has_them),
        cmocka_unit_test(an_alarm_of_the_first_evaluation_counts),
        cmocka_unit_test(where_nothing_is_recorded_nothing_is_evaluated),
        cmocka_unit_test(what_cannot_be_tried_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
