/* SPDX-License-Identifier: BSD-3-Clause */
/* Alarms of an experiment file: what it says is what is loaded; what it must not say is refused with its
 * line. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "experiment/experiment.h"

#define S APC_NS_PER_S

/* Its lines, each with the place for the alarms of one thing. */
enum place { Y1, Y2, SIGNAL, SETPOINT, U1, U2, PLANT, CONTROLLER, CALCULATES, ROOT, PLACES };
static const char *const lines[PLACES] = {
    [Y1] = "name = \"a\"; measurements = ( { name = \"y1\"; low = 0.0; high = 10.0; area = \"left\"; %s },",
    [Y2] = "  { name = \"y2\"; low = -5.0; high = 5.0; %s } );",
    [SIGNAL] = "signals = ( { name = \"sum\"; low = 0.0; high = 8.0; %s } );",
    [SETPOINT] = "setpoints = ( { name = \"r1\"; low = 0.0; high = 10.0; %s }, { name = \"r2\"; } );",
    [U1] = "outputs = ( { name = \"u1\"; low = 0.0; high = 4.0; %s },",
    [U2] = "  { name = \"u2\"; %s } );",
    [PLANT] = "plant = { model = \"quadruple-tank\"; period = 0.25; }; client = { period = %s; };",
    [CONTROLLER] =
        "controllers = ( { name = \"c\"; law = \"pi\"; period = 2.0; measurements = [\"y1\", \"y2\"]; "
        "setpoints = [\"r1\", \"r2\"]; outputs = [\"u1\", \"u2\"]; %s },",
    [CALCULATES] = "  { name = \"d\"; law = \"leadlag\"; period = 1.0; measurements = [\"y1\"]; outputs = "
                   "[\"sum\"]; %s } );",
    [ROOT] = "%s"};

static struct experiment e;
static struct apc_error why;

static int load(const char *const text[PLACES])
{
    char all[9000] = "";
    for (int i = 0; i < PLACES; i++) {
        const char *at = strstr(lines[i], "%s"), *put = text[i] ? text[i] : i == PLANT ? "0.5" : "";
        const size_t used = strlen(all);
        snprintf(all + used, sizeof all - used, "%.*s%s%s\n", (int)(at - lines[i]), lines[i], put, at + 2);
    }
    return experiment_parse(&e, &(struct experiment_source){.file = "a.conf", .text = all},
                            EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why);
}

static int load_one(enum place place, const char *text)
{
    const char *at[PLACES] = {NULL};
    at[place] = text;
    return load(at);
}

static const struct alarm *find(const char *name)
{
    for (size_t i = 0; i < e.n_alarms; i++)
        if (!strcmp(e.alarm[i].name, name))
            return &e.alarm[i];
    fail_msg("there is no alarm %s", name);
    return NULL;
}

/* ---- What is loaded --------------------------------------------------------------------------- */

static const char *const all[PLACES] = {
    [Y1] = "alarms = ( { kind = \"low\"; limit = 2.0; deadband = 0.5; delay = 1.5; off_delay = 2.5; priority "
           "= 1; "
           "latching = true; message = \"m\"; consequence = \"q\"; response = \"p\"; area = \"other\"; }, "
           "{ kind = \"high\"; limit = 9.0; }, { kind = \"high\"; name = \"second\"; limit = 9.5; priority = "
           "4; }, "
           "{ kind = \"deviation\"; from = \"r1\"; limit = 1.0; deadband = 1.0; }, "
           "{ kind = \"rate\"; limit = 3.0; }, { kind = \"frozen\"; deadband = 20.0; delay = 86400.0; }, "
           "{ kind = \"bad\"; } );",
    [Y2] = "alarms = ( { kind = \"high-high\"; limit = 5.0; deadband = 10.0; suppress = { signal = \"u1\"; "
           "below = "
           "0.5; above = 3.5; hold = 10.0; }; }, { kind = \"low-low\"; limit = -5.0; deadband = 10.0; }, "
           "{ kind = \"low\"; limit = -4.0; suppress = { signal = \"sum\"; above = 1.0; }; } );",
    [SIGNAL] =
        "alarms = ( { kind = \"high\"; limit = 8.0; suppress = { alarm = \"c.stopped\"; hold = 300.0; }; }, "
        "{ kind = \"bad\"; } );",
    [SETPOINT] = "alarms = ( { kind = \"low\"; limit = 0.0; } );",
    [U1] = "alarms = ( { kind = \"at-limit\"; }, { kind = \"mode\"; suppress = { alarm = \"second\"; }; } );",
    [U2] = "alarms = ( { kind = \"mode\"; } );",
    [CONTROLLER] = "alarms = ( { kind = \"stopped\"; }, { kind = \"overrun\"; } );",
    [CALCULATES] = "alarms = ( { kind = \"overrun\"; limit = 5; off_delay = 0.0; } );",
    [ROOT] = "alarms = { period = 0.25; shelve_max = 60.0; };"};

static void everything_is_loaded_as_it_stands_there(void **state)
{
    const struct {
        const char *name;
        enum apc_alarm_kind kind;
        enum apc_table table;
        int id;
        double limit, deadband;
        apc_ns horizon;
        int priority;
        const char *area;
    } of[] = {
        {"y1.low", APC_ALARM_LOW, APC_SENSOR, 1, 2.0, 0.5, 16 * S / 10, 1, "other"},
        {"y1.high", APC_ALARM_HIGH, APC_SENSOR, 1, 9.0, 0.0, 16 * S / 10, 3, "left"},
        {"second", APC_ALARM_HIGH, APC_SENSOR, 1, 9.5, 0.0, 16 * S / 10, 4, "left"},
        {"y1.deviation", APC_ALARM_DEVIATION, APC_SENSOR, 1, 1.0, 1.0, 16 * S / 10, 3, "left"},
        {"y1.rate", APC_ALARM_RATE, APC_SENSOR, 1, 3.0, 0.0, 16 * S / 10, 3, "left"},
        {"y1.frozen", APC_ALARM_FROZEN, APC_SENSOR, 1, 0.0, 20.0, 16 * S / 10, 3, "left"},
        {"y1.bad", APC_ALARM_BAD, APC_SENSOR, 1, 0.0, 0.0, 16 * S / 10, 3, "left"},
        {"y2.high-high", APC_ALARM_HIGH_HIGH, APC_SENSOR, 2, 5.0, 10.0, 16 * S / 10, 3, ""},
        {"y2.low-low", APC_ALARM_LOW_LOW, APC_SENSOR, 2, -5.0, 10.0, 16 * S / 10, 3, ""},
        {"y2.low", APC_ALARM_LOW, APC_SENSOR, 2, -4.0, 0.0, 16 * S / 10, 3, ""},
        {"sum.high", APC_ALARM_HIGH, APC_SENSOR, 3, 8.0, 0.0, 31 * S / 10, 3, ""},
        {"sum.bad", APC_ALARM_BAD, APC_SENSOR, 3, 0.0, 0.0, 31 * S / 10, 3, ""},
        {"r1.low", APC_ALARM_LOW, APC_SETPOINT, 1, 0.0, 0.0, 0, 3, ""},
        {"u1.at-limit", APC_ALARM_AT_LIMIT, APC_ACTUATOR, 1, 0.0, 0.0, 0, 3, ""},
        {"u1.mode", APC_ALARM_MODE, APC_OPMODE, 1, 0.0, 0.0, 0, 3, ""},
        {"u2.mode", APC_ALARM_MODE, APC_OPMODE, 2, 0.0, 0.0, 0, 3, ""},
        {"c.stopped", APC_ALARM_STOPPED, APC_TICK, 1, 0.0, 0.0, 61 * S / 10, 3, ""},
        {"c.overrun", APC_ALARM_OVERRUN, APC_TICK, 1, 1.0, 0.0, 61 * S / 10, 3, ""},
        {"d.overrun", APC_ALARM_OVERRUN, APC_TICK, 2, 5.0, 0.0, 31 * S / 10, 3, ""},
    };
    (void)state;
    if (load(all) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.n_alarms, sizeof of / sizeof *of);
    for (size_t i = 0; i < e.n_alarms; i++) {
        const struct alarm *alarm = &e.alarm[i];
        const struct apc_alarm *a = &alarm->is;
        assert_string_equal(alarm->name, of[i].name);
        assert_ptr_equal(a->name, alarm->name);
        assert_int_equal(a->kind, of[i].kind);
        assert_int_equal(a->table, of[i].table);
        assert_int_equal(a->id, of[i].id);
        assert_near(a->limit, of[i].limit, 0);
        assert_near(a->deadband, of[i].deadband, 0);
        assert_int_equal(a->horizon, of[i].horizon);
        assert_int_equal(a->priority, of[i].priority);
        assert_string_equal(alarm->area, of[i].area);
        assert_int_equal(a->latching, i == 0);
        assert_int_equal(a->on_delay, i == 0 ? 15 * S / 10 : a->kind == APC_ALARM_FROZEN ? 86400 * S : 0);
        assert_int_equal(a->off_delay, i == 0                                       ? 25 * S / 10
                                       : a->kind == APC_ALARM_OVERRUN && a->id == 1 ? 60 * S
                                                                                    : 0);
        assert_int_equal(a->other_table, a->kind == APC_ALARM_DEVIATION ? APC_SETPOINT : 0);
        assert_int_equal(a->other, a->kind == APC_ALARM_DEVIATION);
        assert_string_equal(alarm->message, i == 0 ? "m" : "");
        assert_string_equal(alarm->consequence, i == 0 ? "q" : "");
        assert_string_equal(alarm->response, i == 0 ? "p" : "");
    }
    assert_near(find("u1.at-limit")->is.low, 0.0, 0);
    assert_near(find("u1.at-limit")->is.high, 4.0, 0);
    assert_int_equal(e.alarms.rhythm.period, S / 4);
    assert_int_equal(e.alarms.rhythm.overrun, APC_OVERRUN_SKIP);
    assert_int_equal(e.alarms.shelve_max, 60 * S);
    experiment_free(&e);
}

static void what_suppresses_an_alarm_is_found(void **state)
{
    const struct {
        const char *name;
        struct apc_alarm_suppression by;
    } of[] = {{"y2.high-high", {0, APC_ACTUATOR, 1, 0.5, 3.5, 10 * S}},
              {"y2.low", {0, APC_SENSOR, 3, -HUGE_VAL, 1.0, 0}},
              {"sum.high", {17, 0, 0, -HUGE_VAL, HUGE_VAL, 300 * S}},
              {"u1.mode", {3, 0, 0, -HUGE_VAL, HUGE_VAL, 0}},
              {"u2.mode", {0, 0, 0, -HUGE_VAL, HUGE_VAL, 0}}};
    (void)state;
    if (load(all) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct apc_alarm_suppression *is = &find(of[i].name)->is.suppression, *by = &of[i].by;
        assert_int_equal(is->alarm, by->alarm);
        assert_int_equal(is->table, by->table);
        assert_int_equal(is->id, by->id);
        assert_int_equal(is->hold, by->hold);
        assert_false(is->below < by->below || is->below > by->below);
        assert_false(is->above < by->above || is->above > by->above);
    }
    experiment_free(&e);
}

static void alarms_are_evaluated_as_often_as_measurements_come_within_reason(void **state)
{
    static const struct {
        const char *client;
        apc_ns period;
    } of[] = {{"0.05", S / 10}, {"0.1", S / 10}, {"0.75", 3 * S / 4}, {"1.0", S}, {"4.0", S}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        if (load_one(PLANT, of[i].client) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(e.alarms.rhythm.period, of[i].period);
        assert_int_equal(e.alarms.shelve_max, 8 * 3600 * S);
        assert_int_equal(e.n_alarms, 0);
        experiment_free(&e);
    }
}

/* ---- Who is told ------------------------------------------------------------------------------ */

static apc_ns quiet_at(const char *quiet, const char *utc)
{
    char text[128];
    apc_ns at = 0;
    snprintf(text, sizeof text, "alarms = { notify = ( { command = \"a\"; quiet = \"%s\"; } ); };", quiet);
    if (load_one(ROOT, text) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_time_parse(utc, &at), 0);
    const apc_ns left = alarm_notice_quiet(&e.alarms.notice[0], at);
    experiment_free(&e);
    return left;
}

static void quiet_hours_are_of_the_local_day(void **state)
{
    const apc_ns m = 60 * S;
    (void)state;
    assert_int_equal(setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3", 1), 0);
    tzset();
    assert_int_equal(quiet_at("22:00-06:00", "2026-01-10T20:59:59Z"), 0);
    assert_int_equal(quiet_at("22:00-06:00", "2026-01-10T21:00:00Z"), 480 * m);
    assert_int_equal(quiet_at("22:00-06:00", "2026-01-10T23:30:00Z"), 330 * m);
    assert_int_equal(quiet_at("22:00-06:00", "2026-01-11T04:59:30Z"), 30 * S);
    assert_int_equal(quiet_at("22:00-06:00", "2026-01-11T05:00:00Z"), 0);
    assert_int_equal(quiet_at("12:00-13:30", "2026-01-10T10:59:59Z"), 0);
    assert_int_equal(quiet_at("12:00-13:30", "2026-01-10T11:15:00Z"), 75 * m);
    assert_int_equal(quiet_at("12:00-13:30", "2026-01-10T12:30:00Z"), 0);
    assert_int_equal(quiet_at("22:00-06:00", "2026-03-28T21:30:00Z"), 390 * m);  /* a night without 02:00 */
    assert_int_equal(quiet_at("22:00-06:00", "2026-10-24T20:30:00Z"), 510 * m);  /* one that has it twice */
    assert_in_range(quiet_at("22:00-02:45", "2026-10-25T01:30:00Z"), m, 15 * m); /* which 02:45 is open */
    assert_int_equal(unsetenv("TZ"), 0);
    tzset();
}

static void by_default_somebody_is_told_at_once_and_of_all(void **state)
{
    const struct alarm_notice *is = e.alarms.notice;
    (void)state;
    if (load_one(
            ROOT,
            "alarms = { notify = ( { command = \"a\"; }, { command = \"b\"; priority = 2; after = 300.0; "
            "repeat = 900.0; details = false; } ); };") < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.alarms.n_notices, 2);
    assert_int_equal(is[0].priority, 4);
    assert_true(is[0].after == 0 && is[0].repeat == 0 && is[0].details && is[0].timeout == 10 * S);
    assert_true(is[1].after == 300 * S && is[1].repeat == 900 * S && !is[1].details);
    assert_int_equal(alarm_notice_quiet(&is[0], 0), 0);
    experiment_free(&e);
}

/* ---- What is refused -------------------------------------------------------------------------- */

/* Of one kind if they have names, levels that touch nothing, and what is not of one thing is not compared. */
static void what_looks_like_a_mistake_and_is_none(void **state)
{
    static const struct {
        enum place at;
        const char *text;
    } of[] = {
        {Y1, "alarms = ( { kind = \"low\"; limit = 5.0; }, { kind = \"high\"; limit = 5.1; } );"},
        {Y1, "alarms = ( { kind = \"low\"; limit = 5.0; }, { kind = \"rate\"; limit = 1.0; } );"},
        {Y1, "alarms = ( { kind = \"high\"; limit = 5.0; }, { kind = \"rate\"; limit = 1.0; } );"},
        {Y1, "alarms = ( { kind = \"low\"; limit = 0.0; deadband = 10.0; } );"},
        {Y1, "alarms = ( { kind = \"high\"; limit = 10.0; deadband = 10.0; } );"},
        {Y1, "alarms = ( { kind = \"bad\"; suppress = { signal = \"u1\"; below = 2.0; above = 2.0; }; } );"},
        {Y1, "alarms = ( { kind = \"low\"; limit = 1.0; suppress = { alarm = \"y1.bad\"; }; }, { kind = "
             "\"high\"; "
             "limit = 9.0; suppress = { alarm = \"y1.low\"; }; }, { kind = \"bad\"; } );"},
        {Y1, "alarms = ( );"},
        {ROOT, "alarms = { shelve_max = 1.0; };"},
        {ROOT, "alarms = { shelve_max = 604800.0; };"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        if (load_one(of[i].at, of[i].text) < 0)
            fail_msg("%s: %s", of[i].text, why.text);
        experiment_free(&e);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(everything_is_loaded_as_it_stands_there),
        cmocka_unit_test(what_suppresses_an_alarm_is_found),
        cmocka_unit_test(alarms_are_evaluated_as_often_as_measurements_come_within_reason),
        cmocka_unit_test(quiet_hours_are_of_the_local_day),
        cmocka_unit_test(by_default_somebody_is_told_at_once_and_of_all),
        cmocka_unit_test(what_looks_like_a_mistake_and_is_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
