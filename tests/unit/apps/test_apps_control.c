/* SPDX-License-Identifier: BSD-3-Clause */
/* Whether a plant was controlled, from the events it left. */
#include <stdio.h>

#include "apc/run/control_history.h"
#include "check.h"

enum { NO, YES };

static struct apc_event event(apc_ns time, const char *source, const char *kind,
                              enum apc_event_severity severity)
{
    struct apc_event e = {.time = time, .severity = severity};
    snprintf(e.source, sizeof e.source, "%s", source);
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    return e;
}

/* What is heard of it: -1, or whether the plant is commanded. */
static int heard(bool external, const char *source, const char *kind, enum apc_event_severity severity)
{
    const struct apc_event e = event(1, source, kind, severity);
    struct control c;
    bool commanded;
    control_begin(&c, external, 20, 0);
    return control_hears(&c, &e, &commanded) ? commanded : -1;
}

/* Promise(run/plant-already-needs) */
static void who_knows_is_heard_and_nobody_else(void **state)
{
    (void)state;
    assert_int_equal(heard(false, "apc-plant", "watchdog", APC_EVENT_INFO), YES);
    assert_int_equal(heard(false, "apc-plant", "watchdog", APC_EVENT_ALARM), NO);
    assert_int_equal(heard(false, "apc-plant", "start", APC_EVENT_INFO), NO); /* it waits for a command */
    assert_int_equal(heard(false, "apc-plant", "overrun", APC_EVENT_ALARM), -1);
    assert_int_equal(heard(false, "apc-client", "watchdog", APC_EVENT_INFO), -1);
    assert_int_equal(heard(true, "apc-client", "command", APC_EVENT_INFO), YES);
    assert_int_equal(heard(true, "apc-client", "command", APC_EVENT_WARNING), NO);
    assert_int_equal(heard(true, "apc-client", "start", APC_EVENT_INFO), NO);
    assert_int_equal(heard(true, "apc-client", "link", APC_EVENT_WARNING), -1);
    assert_int_equal(heard(true, "apc-plant", "watchdog", APC_EVENT_INFO), -1); /* somebody else's */
}

static enum control_verdict judged(const struct control *c, apc_ns hold)
{
    char why[400];
    return control_judge(c, 0, hold, why, sizeof why);
}

static void a_plant_that_was_never_commanded_stood_at_its_safe_value_all_the_time(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 20, 100);
    control_command(&c, 90, false);
    control_end(&c, 400);
    assert_false(c.ever);
    assert_int_equal(c.open.longest, 300);
    assert_int_equal(c.open.start, 100);
    assert_int_equal(judged(&c, 1000), CONTROL_OPEN); /* however long it is held */
}

/* Promise(run/run-not-controlled) */
static void the_longest_time_without_control_is_found_with_its_beginning(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 20, 100);
    control_command(&c, 110, true); /* 10 */
    control_command(&c, 200, false);
    control_command(&c, 230, true); /* 30 */
    control_command(&c, 240, true);
    control_command(&c, 300, false);
    control_command(&c, 310, false);
    control_command(&c, 320, true); /* 20 */
    control_end(&c, 900);
    assert_int_equal(c.open.longest, 30);
    assert_int_equal(c.open.start, 200);
    assert_int_equal(c.open.times, 3);
    assert_int_equal(c.open.total, 60);
    assert_int_equal(judged(&c, 29), CONTROL_OPEN);
    control_command(&c, 900, false);
    control_end(&c, 931); /* to the end */
    assert_int_equal(c.open.longest, 31);
    assert_int_equal(c.open.start, 900);
}

/*
 * Promise(run/run-not-controlled): A run that was not controlled ends with 1 and says why in its last line,
 *   events and report; one in which an output was to be out of service does not, for that time, nor one
 *   that started late.
 */
static void what_is_out_of_service_is_not_to_be_commanded(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, true, 20, 100);
    control_excuse(&c, 100, true); /* from the beginning */
    control_excuse(&c, 500, false);
    control_command(&c, 510, true);
    assert_int_equal(c.open.longest, 10);
    assert_int_equal(c.open.start, 500);
    control_excuse(&c, 600, true);
    control_command(&c, 605, false);
    control_end(&c, 900);
    assert_int_equal(c.open.longest, 10);
    control_excuse(&c, 1000, false);
    control_end(&c, 1020); /* and nobody commanded it */
    assert_int_equal(c.open.longest, 20);
    assert_int_equal(c.open.start, 1000);
    control_command(&c, 1030, true);
    control_command(&c, 1100, false); /* lost, and only then taken out of service */
    control_excuse(&c, 1150, true);
    control_end(&c, 2000);
    assert_int_equal(c.open.longest, 50);
    assert_int_equal(c.open.start, 1100);
}

/* Promise(run/verdict-run-somebody) */
static void fault_values_are_no_control(void **state)
{
    struct control c;
    char why[400];
    (void)state;
    control_begin(&c, false, 20, 0);
    control_fault(&c, 5, "u"); /* the first that goes out */
    control_command(&c, 10, true);
    control_end(&c, 200);
    assert_true(c.ever && !c.controlled);
    assert_int_equal(control_judge(&c, 0, 1000, why, sizeof why), CONTROL_OPEN);
    assert_string_equal(why, "the loop was never closed: the output u stood at its fault value");
    control_fault(&c, 200, NULL);
    control_end(&c, 1200); /* at last the law's */
    assert_int_equal(judged(&c, 1000), CONTROL_CLOSED);
    assert_int_equal(judged(&c, 199), CONTROL_OPEN);
}

static void one_spell_follows_the_other_without_a_gap(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 20, 0);
    control_command(&c, 0, true);
    control_fault(&c, 100, "u"); /* then also the plant is lost, and the output is better before that is */
    control_command(&c, 120, false);
    control_fault(&c, 150, NULL);
    control_command(&c, 160, true);
    control_end(&c, 1000);
    assert_int_equal(c.open.longest, 60);
    assert_int_equal(c.open.times, 1);
    assert_int_equal(c.faulty.total, 50);
    assert_int_equal(c.bare.total, 40);
}

static void what_is_better_just_before_a_trip_never_came_to_the_plant(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 20, 0);
    control_command(&c, 0, true);
    control_fault(&c, 10, "u");
    control_fault(&c, 100, NULL);
    control_command(&c, 119, false);
    control_command(&c, 200, true);
    control_fault(&c, 210, "u");
    control_fault(&c, 300, NULL);
    control_command(&c, 320, false); /* this one may have */
    control_end(&c, 400);
    assert_int_equal(c.open.longest, 190);
    assert_int_equal(c.open.total, 190 + 90 + 80);
}

/* Promise(run/verdict-run-somebody) */
static void again_and_again_is_more_than_hold_and_a_hundredth_in_sum(void **state)
{
    struct control c;
    char why[400];
    (void)state;
    control_begin(&c, false, 20, 0);
    for (apc_ns t = 0; t < 20 * 500; t += 500) {
        control_command(&c, t, true);
        control_fault(&c, t + 100, "u");
        control_fault(&c, t + 120, NULL);
    }
    control_end(&c, 10000);
    assert_int_equal(c.open.total, 400);
    assert_int_equal(judged(&c, 19), CONTROL_OPEN);
    assert_int_equal(judged(&c, 20), CONTROL_AGAIN);
    assert_int_equal(judged(&c, 399), CONTROL_AGAIN);
    assert_int_equal(judged(&c, 400), CONTROL_CLOSED);
    control_end(&c, 40001);
    assert_int_equal(control_judge(&c, 0, 20, why, sizeof why), CONTROL_CLOSED);
}

/* Two controllers of a plant and one above them, each with its first tick at so many seconds after the start;
 * 0: it never ticks. */
static apc_ns begin_of(double first, double second, double above)
{
    enum { N = 3 };
    static const apc_ns start = 1000 * APC_NS_PER_S;
    const double at[N] = {first, second, above};
    struct wire u[N] = {{APC_ACTUATOR, 0}, {APC_ACTUATOR, 1}, {APC_SETPOINT, 0}};
    struct controller c[N] = {{.number = 1}};
    struct apc_store *store = NULL;
    struct apc_error why;
    double value = 0;
    apc_ns begin = 0;
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0);
    for (int i = 0; i < N; i++) {
        c[i].number = i + 1;
        c[i].dim.nu = 1;
        c[i].u = &u[i];
        c[i].rhythm.period = (i + 1) * APC_NS_PER_S / 10;
        for (int k = -1; k < 3 && at[i] > 0; k++) { /* before the start is no tick of this run */
            struct apc_vector tick = {.table = APC_TICK, .id = i + 1, .seq = k + 2, .n = 1, .value = &value};
            tick.time = start + (apc_ns)((k < 0 ? -5 : at[i] + k) * 1e9);
            const struct apc_rows rows = {.size = sizeof rows, .vector = &tick, .n_vectors = 1};
            assert_int_equal(apc_store_append_rows(store, &rows), 1);
        }
    }
    const struct experiment e = {.controllers = c, .n_controllers = N};
    assert_int_equal(control_history_begin(store, &e, start, &begin), 0);
    apc_store_close(store);
    return begin - start - 3 * APC_NS_PER_S / 5 - 100 * APC_NS_PER_MS; /* for which the plant waits */
}

/* Promise(run/run-not-controlled) */
static void a_start_has_its_grace_until_each_controller_has_ticked(void **state)
{
    (void)state;
    assert_int_equal(begin_of(0.25, 0.75, 9),
                     750 * APC_NS_PER_MS); /* one that does not command it is no matter */
    assert_int_equal(begin_of(0.5, 0.25, 0.125), 500 * APC_NS_PER_MS);
    assert_int_equal(begin_of(0.25, 30, 0), 2 * APC_NS_PER_S); /* not for ever */
    assert_int_equal(begin_of(0, 0.25, 0), 250 * APC_NS_PER_MS);
    assert_int_equal(begin_of(0, 0, 0), 0); /* they never came */
}

/* ---- Random schedules of faults -------------------------------------------------------------- */

#define MS      APC_NS_PER_MS
#define RAN     (60 * APC_NS_PER_S)
#define CLIENT  (100 * MS)
#define COMMAND (200 * MS)
#define HOLD    (2000 * MS)
#define GRID    (10 * MS)
#define EDGE    (5 * GRID)

/* One minute of a client, a controller and a device, all of which fail as it comes. */
struct minute {
    struct apc_store *store;
    struct experiment e;
    struct controller controller;
    struct wire wire;
    struct signal y, u;
    struct apc_client *client;
    struct apc_watchdog watchdog;
    struct apc_random random;
    apc_ns zero; /* UTC */
    struct apc_sample row;
    apc_ns seen;      /* when the controller's newest measurement came */
    int64_t measured; /* seq of that */
    bool told;        /* the state that was told */
    /* The device's side. */
    struct {
        apc_ns at;
        bool fresh, fault;
    } write[RAN / CLIENT + 1];
    size_t writes;
    apc_ns stamp;
};

enum trouble { WELL, LINK_DOWN, BUSY, LOCAL, NO_CONTROLLER, SENSOR_DEAD, TROUBLES };

static double draw(struct minute *m)
{
    return apc_random_uniform(&m->random);
}

static void tell_command(struct minute *m, apc_ns t, bool commanded)
{
    struct apc_event e =
        event(m->zero + t, "apc-client", "command", commanded ? APC_EVENT_INFO : APC_EVENT_WARNING);
    assert_int_equal(apc_store_append_events(m->store, &e, 1), 1);
}

/* The law as long as there are measurements, then what went out last, then the fault value. */
static void controller_tick(struct minute *m, apc_ns t, enum trouble trouble)
{
    const apc_ns stale = 3 * CLIENT + 100 * MS;
    if (trouble == NO_CONTROLLER)
        return;
    m->row.seq++;
    m->row.time = m->zero + t;
    m->row.status = t - m->seen > stale + HOLD ? APC_UNCERTAIN_SUBSTITUTE
                    : t - m->seen > stale      ? APC_UNCERTAIN_LAST_USABLE
                                               : APC_GOOD;
    assert_int_equal(apc_store_append(m->store, &m->row, 1), 1);
}

static void client_tick(struct minute *m, apc_ns t, enum trouble trouble)
{
    struct apc_value command;
    const bool all = apc_client_command(m->client, (struct apc_now){.mono = t, .utc = m->zero + t}, &m->row,
                                        &command) == 1;
    const bool reached = trouble != LINK_DOWN && !(trouble == BUSY && draw(m) < 0.3);
    const bool takes = all && reached && trouble != LOCAL;
    if (apc_watchdog_trips(&m->watchdog, t))
        tell_command(m, m->watchdog.tripped, false);
    const bool before = m->watchdog.commanded;
    if (takes) {
        apc_watchdog_take(&m->watchdog, t, command.time);
        m->write[m->writes].at = t;
        m->write[m->writes].fresh = command.time != m->stamp;
        m->write[m->writes++].fault = command.status == APC_UNCERTAIN_SUBSTITUTE;
        m->stamp = command.time;
    }
    if (m->watchdog.commanded && !before)
        tell_command(m, t, true);
    if (!reached)
        return;
    const struct apc_sample y = {.table = APC_SENSOR, .id = 1, .seq = ++m->measured, .time = m->zero + t};
    assert_int_equal(apc_store_append(m->store, &y, 1), 1);
    if (trouble != SENSOR_DEAD)
        m->seen = t;
}

/* Long spells of trouble, short ones, or next to none. */
static void live_through(struct minute *m)
{
    static const double spells[] = {6.0, 1.2, 0.8, 0.2};
    const double calm = 0.2 + 12 * draw(m) * draw(m), spell = spells[apc_random_next(&m->random) % 4];
    enum trouble trouble = WELL;
    apc_ns until = 0;
    for (apc_ns t = 0; t < RAN; t += CLIENT) {
        if (t >= until) {
            trouble =
                trouble == WELL ? 1 + (enum trouble)(apc_random_next(&m->random) % (TROUBLES - 1)) : WELL;
            until = t + (apc_ns)((trouble == WELL ? calm : spell) * 2 * draw(m) * 1e9);
        }
        if (t % COMMAND == 0)
            controller_tick(m, t, trouble);
        client_tick(m, t + GRID, trouble);
    }
}

struct seen {
    apc_ns longest, total;
    unsigned times;
    bool ever, controlled;
};

/* What somebody sees who stands beside the device with a clock, and looks a hundred times a second. */
static struct seen from_the_plant(const struct minute *m, apc_ns begin)
{
    struct seen seen = {0};
    apc_ns spell = 0;
    for (apc_ns t = 0; t < RAN; t += GRID) {
        apc_ns frame = -RAN, fresh = -RAN;
        bool fault = false;
        for (size_t i = 0; i < m->writes && m->write[i].at <= t; i++) {
            frame = m->write[i].at;
            fresh = m->write[i].fresh ? frame : fresh;
            fault = m->write[i].fault;
        }
        const bool commanded = t - frame <= 3 * CLIENT + 100 * MS && t - fresh <= 3 * COMMAND + 100 * MS;
        seen.ever |= commanded;
        seen.controlled |= commanded && !fault;
        if (t < begin)
            continue;
        seen.times += spell == 0 && (!commanded || fault);
        spell = commanded && !fault ? 0 : spell + GRID;
        seen.total += spell ? GRID : 0;
        seen.longest = spell > seen.longest ? spell : seen.longest;
    }
    return seen;
}

static bool near(apc_ns a, apc_ns b, apc_ns by)
{
    return a - b <= by && b - a <= by;
}

static void prepare_minute(struct minute *m, uint64_t seed)
{
    const struct apc_client_options options = {
        .size = sizeof options, .ny = 1, .nu = 1, .command_period = COMMAND, .since = APC_NS_PER_S};
    double value = 0;
    *m = (struct minute){.zero = INT64_C(1700000000) * APC_NS_PER_S,
                         .wire = {APC_ACTUATOR, 0},
                         .watchdog = apc_watchdog_make(CLIENT, COMMAND),
                         .row = {.table = APC_ACTUATOR, .id = 1},
                         .y = {.tag.name = "y"},
                         .u = {.tag.name = "u"}};
    m->controller = (struct controller){
        .number = 1, .first_loop = 1, .mode = APC_MODE_AUTO, .dim.nu = 1, .u = &m->wire, .hold = HOLD};
    m->controller.rhythm.period = COMMAND;
    m->e = (struct experiment){.controllers = &m->controller,
                               .n_controllers = 1,
                               .dim = {.ny = 1, .nu = 1},
                               .y = &m->y,
                               .u = &m->u,
                               .plant.external = true};
    apc_random_init(&m->random, seed, "minute");
    assert_int_equal(apc_store_open(&m->store, "mem:", NULL, NULL), 0);
    assert_true(apc_store_init(m->store) >= 0);
    assert_int_equal(apc_client_create(&m->client, &options, NULL), 0);
    const struct apc_vector tick = {
        .table = APC_TICK, .id = 1, .seq = 1, .time = m->zero, .n = 1, .value = &value};
    struct apc_vector ticks[] = {tick};
    const struct apc_rows rows = {.size = sizeof rows, .vector = ticks, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(m->store, &rows), 1);
}

/* 0: too near to a limit to be told apart on a grid. */
static enum control_verdict expected(const struct seen *s, apc_ns counted)
{
    const apc_ns edges = (s->times + 1) * EDGE;
    if (s->total == 0)
        return CONTROL_CLOSED;
    if (near(s->longest, HOLD, EDGE))
        return 0;
    if (!s->ever || !s->controlled || s->longest > HOLD)
        return CONTROL_OPEN;
    if (near(s->total, HOLD, edges) || near(s->total, counted / CONTROL_SHARE, edges))
        return 0;
    return s->total > HOLD && s->total > counted / CONTROL_SHARE ? CONTROL_AGAIN : CONTROL_CLOSED;
}

/*
 * Promise(run/verdict-run-somebody): The verdict on a run is that of somebody who stands beside the plant,
 *   whatever link, device and sensors do; fault values are no control, nor is a loop that is open again and
 *   again.
 */
static void the_verdict_is_that_of_one_who_stands_beside_the_plant(void **state)
{
    unsigned verdicts[CONTROL_OPEN + 1] = {0};
    (void)state;
    for (uint64_t seed = 1; seed <= 200; seed++) {
        struct minute m;
        struct control c;
        struct missing missing;
        apc_ns begin;
        char why[400] = "";

        prepare_minute(&m, seed);
        live_through(&m);
        assert_int_equal(control_history_begin(m.store, &m.e, m.zero, &begin), 0);
        control_begin(&c, true, m.watchdog.link, begin);
        const struct apc_range range = {.since = m.zero, .until = m.zero + RAN};
        assert_int_equal(control_history_read(m.store, &m.e, &range, &c, &missing), 0);
        control_end(&c, m.zero + RAN);

        const struct seen seen = from_the_plant(&m, begin - m.zero);
        const enum control_verdict should = expected(&seen, RAN - (begin - m.zero)),
                                   is = control_judge(&c, m.zero, HOLD, why, sizeof why);
        if (should != 0 && should != is)
            fail_msg(
                "schedule %d: verdict %d, \"%s\"; beside the plant it is %d: %.2f s at most, %.2f s in %u",
                (int)seed, (int)is, why, (int)should, apc_ns_to_s(seen.longest), apc_ns_to_s(seen.total),
                seen.times);
        assert_near(apc_ns_to_s(c.open.longest), apc_ns_to_s(seen.longest), apc_ns_to_s(EDGE));
        assert_near(apc_ns_to_s(c.open.total), apc_ns_to_s(seen.total), (seen.times + 1) * apc_ns_to_s(EDGE));
        assert_null(missing.name);
        verdicts[should]++;
        apc_client_destroy(m.client);
        apc_store_close(m.store);
    }
    print_message("too near to a limit %u, closed %u, again and again %u, open %u\n", verdicts[0],
                  verdicts[CONTROL_CLOSED], verdicts[CONTROL_AGAIN], verdicts[CONTROL_OPEN]);
    assert_true(verdicts[0] < 60 && verdicts[CONTROL_CLOSED] > 10 && verdicts[CONTROL_AGAIN] > 10 &&
                verdicts[CONTROL_OPEN] > 10);
}

/* Promise(run/verdict-run-somebody) */
static void rows_that_are_not_in_the_record_are_counted_by_their_numbers(void **state)
{
    struct minute m;
    struct control c;
    struct missing missing;
    (void)state;
    prepare_minute(&m, 1);
    const struct apc_range range = {.since = m.zero, .until = m.zero + RAN};
    control_begin(&c, true, m.watchdog.link, m.zero);
    assert_int_equal(control_history_read(m.store, &m.e, &range, &c, &missing), 0);
    assert_string_equal(missing.empty, "y");
    assert_null(missing.name);
    for (int64_t seq = 7; seq < 40; seq++) { /* and a clock that was away for a while */
        const apc_ns time = m.zero + seq + (seq > 20 && seq < 30 ? 2 * RAN : 0);
        const struct apc_sample rows[] = {
            {.table = APC_ACTUATOR, .id = 1, .seq = 2 * seq, .time = m.zero + seq},
            {.table = APC_SENSOR, .id = 1, .seq = seq, .time = time}};
        assert_int_equal(apc_store_append(m.store, rows, seq % 8 ? 2 : 1), seq % 8 ? 2 : 1);
    }
    assert_int_equal(control_history_read(m.store, &m.e, &range, &c, &missing), 0);
    assert_null(missing.empty);
    assert_string_equal(missing.name, "y");
    assert_int_equal(missing.rows, 4);
    assert_int_equal(missing.of, 33);
    apc_client_destroy(m.client);
    apc_store_close(m.store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(who_knows_is_heard_and_nobody_else),
        cmocka_unit_test(a_plant_that_was_never_commanded_stood_at_its_safe_value_all_the_time),
        cmocka_unit_test(the_longest_time_without_control_is_found_with_its_beginning),
        cmocka_unit_test(what_is_out_of_service_is_not_to_be_commanded),
        cmocka_unit_test(fault_values_are_no_control),
        cmocka_unit_test(one_spell_follows_the_other_without_a_gap),
        cmocka_unit_test(what_is_better_just_before_a_trip_never_came_to_the_plant),
        cmocka_unit_test(again_and_again_is_more_than_hold_and_a_hundredth_in_sum),
        cmocka_unit_test(the_verdict_is_that_of_one_who_stands_beside_the_plant),
        cmocka_unit_test(rows_that_are_not_in_the_record_are_counted_by_their_numbers),
        cmocka_unit_test(a_start_has_its_grace_until_each_controller_has_ticked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
