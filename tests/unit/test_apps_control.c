/* SPDX-License-Identifier: BSD-3-Clause */
/* Whether a plant was controlled, from the events it left. */
#include <stdio.h>

#include "apc/evidence.h"
#include "check.h"

static struct apc_event event(apc_ns time, const char *source, const char *kind,
                              enum apc_event_severity severity)
{
    struct apc_event e = {.time = time, .severity = severity};
    snprintf(e.source, sizeof e.source, "%s", source);
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    return e;
}

static void take(struct control *c, apc_ns time, const char *kind, enum apc_event_severity severity)
{
    const struct apc_event e = event(time, "apc-plant", kind, severity);
    control_take(c, &e);
}

static void a_plant_that_was_never_commanded_stood_at_its_safe_value_all_the_time(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 100);
    take(&c, 90, "start", APC_EVENT_INFO);
    control_end(&c, 400);
    assert_false(c.ever);
    assert_false(c.commanded);
    assert_int_equal(c.longest, 300);
    assert_int_equal(c.start, 100);
}

static void the_longest_time_without_control_is_found_with_its_beginning(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 100);
    take(&c, 110, "watchdog", APC_EVENT_INFO); /* 10 */
    assert_true(c.commanded && c.ever);
    take(&c, 200, "watchdog", APC_EVENT_ALARM);
    assert_false(c.commanded);
    take(&c, 230, "watchdog", APC_EVENT_INFO); /* 30 */
    take(&c, 240, "watchdog", APC_EVENT_INFO); /* as before */
    take(&c, 300, "watchdog", APC_EVENT_ALARM);
    take(&c, 310, "watchdog", APC_EVENT_ALARM); /* since 300 */
    take(&c, 320, "watchdog", APC_EVENT_INFO);  /* 20 */
    control_end(&c, 900);
    assert_int_equal(c.longest, 30);
    assert_int_equal(c.start, 200);
    take(&c, 900, "watchdog", APC_EVENT_ALARM);
    control_end(&c, 931); /* to the end */
    assert_int_equal(c.longest, 31);
    assert_int_equal(c.start, 900);
}

static void a_plant_that_was_started_again_stands_at_its_safe_value(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 100);
    take(&c, 110, "watchdog", APC_EVENT_INFO);
    take(&c, 200, "start", APC_EVENT_INFO);
    assert_false(c.commanded);
    take(&c, 260, "watchdog", APC_EVENT_INFO);
    assert_int_equal(c.longest, 60);
    assert_int_equal(c.start, 200);
}

static void what_is_out_of_service_is_not_to_be_commanded(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, true, 100);
    control_excuse(&c, 100, true); /* from the beginning */
    control_excuse(&c, 500, false);
    control_excuse(&c, 500, false);
    struct apc_event e = event(510, "apc-client", "command", APC_EVENT_INFO); /* 10 after it came back */
    control_take(&c, &e);
    assert_int_equal(c.longest, 10);
    assert_int_equal(c.start, 500);
    control_excuse(&c, 600, true);
    e = event(605, "apc-client", "command", APC_EVENT_WARNING);
    control_take(&c, &e);
    control_end(&c, 900);
    assert_int_equal(c.longest, 10);
    control_excuse(&c, 1000, false);
    control_end(&c, 1020); /* and nobody commanded it */
    assert_int_equal(c.longest, 20);
    assert_int_equal(c.start, 1000);
    e = event(1030, "apc-client", "command", APC_EVENT_INFO);
    control_take(&c, &e);
    e = event(1100, "apc-client", "command",
              APC_EVENT_WARNING); /* lost, and only then taken out of service */
    control_take(&c, &e);
    control_excuse(&c, 1150, true);
    control_end(&c, 2000);
    assert_int_equal(c.longest, 50);
    assert_int_equal(c.start, 1100);
}

static void what_others_say_is_no_matter(void **state)
{
    struct control c;
    (void)state;
    control_begin(&c, false, 100);
    const struct apc_event foreign = event(150, "apc-client", "watchdog", APC_EVENT_INFO);
    control_take(&c, &foreign);
    assert_false(c.ever);
    take(&c, 160, "overrun", APC_EVENT_INFO);
    assert_false(c.ever);
    take(&c, 170, "watchdog", APC_EVENT_INFO);
    take(&c, 180, "overrun", APC_EVENT_ALARM);
    assert_true(c.commanded);
}

/* Of an external plant its client says when it is given commands. */
static void an_external_plant_is_what_its_client_says(void **state)
{
    struct control c;
    struct apc_event e = event(150, "apc-client", "command", APC_EVENT_INFO);
    (void)state;
    control_begin(&c, true, 100);
    take(&c, 120, "watchdog", APC_EVENT_INFO); /* of somebody else's plant */
    assert_false(c.ever);
    control_take(&c, &e);
    assert_true(c.commanded && c.ever);
    e = event(170, "apc-client", "command", APC_EVENT_WARNING);
    control_take(&c, &e);
    e = event(190, "apc-client", "start", APC_EVENT_INFO);
    control_take(&c, &e);
    control_end(&c, 300);
    assert_int_equal(c.longest, 130);
    assert_int_equal(c.start, 170);
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
    assert_int_equal(evidence_begin(store, &e, start, &begin), 0);
    apc_store_close(store);
    return begin - start - 3 * APC_NS_PER_S / 5 - 100 * APC_NS_PER_MS; /* for which the plant waits */
}

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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plant_that_was_never_commanded_stood_at_its_safe_value_all_the_time),
        cmocka_unit_test(the_longest_time_without_control_is_found_with_its_beginning),
        cmocka_unit_test(a_plant_that_was_started_again_stands_at_its_safe_value),
        cmocka_unit_test(what_is_out_of_service_is_not_to_be_commanded),
        cmocka_unit_test(what_others_say_is_no_matter),
        cmocka_unit_test(an_external_plant_is_what_its_client_says),
        cmocka_unit_test(a_start_has_its_grace_until_each_controller_has_ticked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
