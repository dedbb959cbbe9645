/* SPDX-License-Identifier: BSD-3-Clause */
/* Alarms of an experiment in virtual time: which ones it raises, in the same order each time, and their
 * figures. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "run/alarms.h"
#include "run/simulation.h"

struct run {
    struct experiment e;
    struct simulation s;
    struct alarm_journal journal;
};

static void begin(struct run *r, const char *file)
{
    struct apc_error why;
    if (experiment_load(&r->e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&r->s, &r->e, r->e.seed, &why) < 0 || simulation_run(&r->s, r->e.duration) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(alarm_journal_load(&r->journal, r->s.store, r->e.n_alarms, NULL), 0);
}

static void end(struct run *r)
{
    alarm_journal_free(&r->journal);
    simulation_destroy(&r->s);
    experiment_free(&r->e);
}

#define PUMP APC_SOURCE_DIR "/experiments/alarms/pump-failure.conf"

static const char *name_of(const struct run *r, const struct alarm_transition *t)
{
    return r->e.alarm[t->alarm - 1].name;
}

static void a_scenario_raises_its_alarms_in_order_and_the_same_each_time(void **state)
{
    static const char *const raised[] = {"h2.deviation", "F2.at-limit", "h2.low"};
    struct run a, b;
    size_t n = 0;
    (void)state;
    begin(&a, PUMP);
    begin(&b, PUMP);
    assert_int_equal(a.journal.n, b.journal.n);
    for (size_t i = 0; i < a.journal.n; i++) {
        const struct alarm_transition *t = &a.journal.at[i];
        assert_memory_equal(t, &b.journal.at[i], sizeof *t);
        assert_int_equal(t->number, i + 1);
        assert_int_not_equal(t->before, 0);
        if (!alarm_is_raised(t))
            continue;
        assert_true(n < sizeof raised / sizeof *raised);
        assert_string_equal(name_of(&a, t), raised[n++]);
    }
    assert_int_equal(n, sizeof raised / sizeof *raised);
    end(&b);
    end(&a);
}

static void without_a_failure_there_is_no_alarm(void **state)
{
    struct experiment e;
    struct simulation s;
    struct alarm_journal journal;
    struct apc_error why;
    const struct experiment_setting set = {"duration", "290.0"};
    (void)state;
    if (experiment_load(&e, PUMP, EXPERIMENT_MODEL | EXPERIMENT_LAW,
                        &(struct experiment_overrides){.set = &set, .n_set = 1}, &why) < 0 ||
        simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, e.duration) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(alarm_journal_load(&journal, s.store, e.n_alarms, NULL), 0);
    assert_int_equal(journal.n, 0);
    alarm_journal_free(&journal);
    simulation_destroy(&s);
    experiment_free(&e);
}

/* ---- Figures ------------------------------------------------------------------------------ */

#define S APC_NS_PER_S
#define T (INT64_C(1700000000) * S)

static void add(struct alarm_journal *j, double t, int alarm, enum apc_alarm_state to)
{
    const int64_t number = (int64_t)j->n + 1;
    j->at[j->n++] = (struct alarm_transition){
        .number = number, .time = T + (apc_ns)(t * 1e9), .alarm = alarm, .state = to};
}

static void floods_chattering_and_standing_alarms_are_counted(void **state)
{
    struct alarm alarm[3] = {{.is = {.priority = 1}}, {.is = {.priority = 4}}, {.is = {.priority = 4}}};
    const struct experiment e = {.alarm = alarm, .n_alarms = 3};
    struct alarm_transition rows[60];
    struct alarm_journal journal = {.at = rows};
    struct alarm_figures f;
    (void)state;
    /* One every 20 s that goes again after 10 s: eleven in the first ten minutes. */
    for (int i = 0; i < 11; i++) {
        add(&journal, 20.0 * i, 2, APC_ALARM_UNACKED);
        add(&journal, 20.0 * i + 10, 2, APC_ALARM_RETURNED);
    }
    add(&journal, 400, 2, APC_ALARM_NORMAL);
    add(&journal, 1000, 1, APC_ALARM_UNACKED);
    add(&journal, 1030, 1, APC_ALARM_ACKED);
    add(&journal, 1100, 3, APC_ALARM_SHELVED);
    add(&journal, 1200, 3, APC_ALARM_SHELVED_ACTIVE);
    assert_int_equal(alarm_figures_make(&f, &journal, &e, T, T + 1000 * S + 25 * 3600 * S), 0);
    assert_int_equal(f.raised, 12);
    assert_int_equal(f.by_priority[0], 1);
    assert_int_equal(f.by_priority[3], 11);
    assert_int_equal(f.peak, 11);
    assert_int_equal(f.floods, 1);
    assert_int_equal(f.chattering, 1);
    assert_int_equal(f.standing, 1);
    assert_int_equal(f.stale, 1);
    assert_int_equal(f.unacked, 0);
    assert_int_equal(f.acknowledged, 2);
    assert_near(f.to_acknowledge, 215, 1e-9);
    assert_near(apc_ns_to_s(f.alarm[1].active), 110, 1e-9);
    assert_near(f.per_hour, 12 / (25 + 1000 / 3600.0), 1e-9);
    assert_int_equal(f.alarm[2].raised, 0);
    assert_int_equal(f.alarm[2].state, APC_ALARM_SHELVED_ACTIVE);
    alarm_figures_free(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_scenario_raises_its_alarms_in_order_and_the_same_each_time),
        cmocka_unit_test(without_a_failure_there_is_no_alarm),
        cmocka_unit_test(floods_chattering_and_standing_alarms_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
