/* SPDX-License-Identifier: BSD-3-Clause */
/* Alarms of an experiment in virtual time: which ones it raises, in the same order each time, and their
 * figures. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "record/record.h"
#include "simulation/simulation.h"

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

#define S APC_NS_PER_S

#define PUMP APC_SOURCE_DIR "/experiments/alarms/pump-failure.conf"

static const char *name_of(const struct run *r, const struct alarm_transition *t)
{
    return r->e.alarm[t->alarm - 1].name;
}

static bool is_same(const struct alarm_transition *a, const struct alarm_transition *b)
{
    return a->number == b->number && a->seq == b->seq && a->time == b->time && a->alarm == b->alarm &&
           a->before == b->before && a->state == b->state && a->status == b->status && a->author == b->author;
}

/* Promise(alarms): `apc simulate` raises the same alarms in the same order each time. */
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
        assert_true(is_same(t, &b.journal.at[i]));
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

/* Whichever of the alarms moved, and when: what is asked for is a part of the whole. */
static void a_journal_of_a_window_is_that_part_of_the_whole(void **state)
{
    struct run r;
    struct alarm_journal part;
    (void)state;
    begin(&r, PUMP);
    const size_t n = r.journal.n;
    assert_true(n > 4);
    for (size_t from = 0; from < n; from++) {
        const struct apc_range windows[] = {{.since = r.journal.at[from].time},
                                            {.last = n - from},
                                            {.last = n - from, .until = r.journal.at[n - 1].time + 1}};
        for (size_t i = 0; i < sizeof windows / sizeof *windows; i++) {
            assert_int_equal(alarm_journal_load(&part, r.s.store, r.e.n_alarms, &windows[i]), 0);
            assert_true(part.n >= n - from && (i == 0 || part.n == n - from));
            for (size_t k = 0; k < part.n; k++)
                assert_int_equal(part.at[k].number, r.journal.at[n - part.n + k].number);
            alarm_journal_free(&part);
        }
    }
    end(&r);
}

/* Of which the numbers are missing: an older one is among the last then, whichever alarm it is of. */
static void of_alarms_that_are_gone_the_last_are_those_before(void **state)
{
    struct alarm_journal journal;
    struct apc_error why;
    struct apc_store *store = NULL;
    const struct apc_range range = {.last = 10};
    struct apc_sample row[11];
    (void)state;
    for (int i = 0; i < 11; i++)
        row[i] = (struct apc_sample){.table = APC_ALARM,
                                     .id = i < 10 ? 1 : 2,
                                     .seq = i < 10 ? i + 1 : 1,
                                     .time = (i + 1) * S,
                                     .value = APC_ALARM_UNACKED,
                                     .origin = i < 9    ? i + 1
                                               : i == 9 ? 100
                                                        : 85};
    if (apc_store_open(&store, "mem:", NULL, &why) < 0 || apc_store_init(store) < 0 ||
        apc_store_append(store, row, 11) != 11)
        fail_msg("%s", store ? apc_store_error(store) : why.text);
    assert_int_equal(alarm_journal_load(&journal, store, 2, &range), 0);
    assert_int_equal(journal.n, 10);
    assert_int_equal(journal.at[8].number, 85);
    alarm_journal_free(&journal);
    apc_store_close(store);
}

/* ---- Ticks that are missed ----------------------------------------------------------------- */

/* Raised how often, where each tick of the controller takes that long. */
static size_t overruns(const char *execution)
{
    char text[600];
    const struct experiment_source source = {.file = "a.conf", .text = text};
    struct run r;
    struct apc_error why;
    size_t n = 0;
    snprintf(text, sizeof text,
             "name = \"a\"; duration = 120.0; measurements = ( { name = \"y\"; } );\n"
             "setpoints = ( { name = \"r\"; initial = 1.0; } ); outputs = ( { name = \"u\"; } );\n"
             "plant = { model = \"first-order\"; period = 0.1; }; client = { period = 0.1; };\n"
             "controller = { law = \"pi\"; period = 0.5; execution = %s;\n"
             "  alarms = ( { kind = \"overrun\"; } ); };\n"
             "alarms = { period = 2.0; };",
             execution);
    if (experiment_parse(&r.e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&r.s, &r.e, r.e.seed, &why) < 0 || simulation_run(&r.s, r.e.duration) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(alarm_journal_load(&r.journal, r.s.store, r.e.n_alarms, NULL), 0);
    for (size_t i = 0; i < r.journal.n; i++)
        n += alarm_is_raised(&r.journal.at[i]);
    end(&r);
    return n;
}

/* Promise(alarms/ticks-controller-missed) */
static void ticks_that_take_longer_than_the_period_raise_an_overrun(void **state)
{
    (void)state;
    assert_int_equal(overruns("0.1"), 0);
    assert_int_equal(overruns("1.1"), 1);
}

/* ---- A store that is kept ------------------------------------------------------------------ */

/* As apc-alarms does it, once, after a start. */
static void evaluate(const struct experiment *e, struct apc_store *store)
{
    struct apc_alarms *alarms = NULL;
    struct apc_error why;
    if (module_alarms(e, &alarms, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_read_rows(store, apc_alarms_former(alarms)) >= 0);
    apc_alarms_resume(alarms);
    assert_true(apc_store_read_rows(store, apc_alarms_in(alarms)) >= 0);
    (void)apc_alarms_compute(alarms, (struct apc_now){.mono = 1, .utc = apc_clock_utc(NULL)}, NULL);
    assert_true(apc_store_append_rows(store, apc_alarms_out(alarms)) >= 0);
    apc_alarms_destroy(alarms);
}

static struct apc_sample newest(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    assert_true(apc_store_read(store, &s, 1) >= 0);
    return s;
}

static void wanted(struct apc_store *store, enum apc_alarm_switch which, int alarm, double value)
{
    struct apc_sample request = {
        .table = APC_OPMODE, .id = apc_alarm_switch_id(which, alarm), .time = S, .value = value};
    if (apc_store_put(store, &request, 1) < 0)
        fail_msg("%s", apc_store_error(store));
}

static enum apc_alarm_state state_of(struct apc_store *store, int alarm)
{
    const struct apc_sample row = newest(store, APC_ALARM, alarm);
    return row.seq > 0 ? (enum apc_alarm_state)(int)row.value : APC_ALARM_NORMAL;
}

static void what_was_of_another_alarm_is_nothing_of_the_one_that_has_its_number_now(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct apc_store *store = NULL;
    (void)state;
    if (experiment_load(&e, PUMP, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        apc_store_open(&store, "mem:", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_init(store) >= 0 && e.n_alarms >= 3);
    if (provision(store, &e, PROVISION_KEEP) < 0)
        fail_msg("%s", apc_store_error(store));
    wanted(store, APC_ALARM_SERVICE, 1, 1);
    wanted(store, APC_ALARM_SHELF, 2, (double)(apc_clock_utc(NULL) / S + 3600));
    wanted(store, APC_ALARM_SERVICE, 3, 1);
    evaluate(&e, store);
    assert_int_equal(state_of(store, 1), APC_ALARM_OUT_OF_SERVICE);
    assert_int_equal(state_of(store, 2), APC_ALARM_SHELVED);
    const struct apc_sample third = newest(store, APC_ALARM, 3);

    assert_int_equal(provision(store, &e, PROVISION_RESET), 0); /* the same alarms stay as they are */
    assert_int_equal(state_of(store, 1), APC_ALARM_OUT_OF_SERVICE);

    const struct alarm first = e.alarm[0];
    memcpy(e.alarm[0].name, e.alarm[1].name, sizeof first.name);
    memcpy(e.alarm[1].name, first.name, sizeof first.name);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    for (int i = 1; i <= 2; i++) {
        assert_int_equal(state_of(store, i), APC_ALARM_NORMAL);
        assert_int_equal(newest(store, APC_ALARM, i).origin, third.origin + i);
    }
    const struct apc_sample once = newest(store, APC_ALARM, 1);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0); /* once */
    assert_int_equal(newest(store, APC_ALARM, 1).seq, once.seq);
    evaluate(&e, store);
    assert_int_equal(state_of(store, 1), APC_ALARM_NORMAL);
    assert_int_equal(state_of(store, 2), APC_ALARM_NORMAL);
    assert_int_equal(newest(store, APC_ALARM, 3).seq, third.seq);
    for (int i = 1; i <= 2; i++) { /* and the switches are what is in force */
        const int id = apc_alarm_switch_id(i == 1 ? APC_ALARM_SERVICE : APC_ALARM_SHELF, i);
        assert_near(newest(store, APC_ACTUAL, apc_variable_number(APC_OPMODE, id)).value, 0, 0);
    }

    /* An alarm that was left out for a while is another one as well. */
    const size_t all = e.n_alarms;
    e.n_alarms = 2;
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    e.n_alarms = all;
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    assert_int_equal(state_of(store, 3), APC_ALARM_NORMAL);
    apc_store_close(store);
    experiment_free(&e);
}

/* ---- Figures ------------------------------------------------------------------------------ */

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
        cmocka_unit_test(a_journal_of_a_window_is_that_part_of_the_whole),
        cmocka_unit_test(of_alarms_that_are_gone_the_last_are_those_before),
        cmocka_unit_test(ticks_that_take_longer_than_the_period_raise_an_overrun),
        cmocka_unit_test(what_was_of_another_alarm_is_nothing_of_the_one_that_has_its_number_now),
        cmocka_unit_test(floods_chattering_and_standing_alarms_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
