/* SPDX-License-Identifier: BSD-3-Clause */
/* Whether a plant was controlled, from the events it left. */
#include <stdio.h>

#include "apc/control.h"
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plant_that_was_never_commanded_stood_at_its_safe_value_all_the_time),
        cmocka_unit_test(the_longest_time_without_control_is_found_with_its_beginning),
        cmocka_unit_test(a_plant_that_was_started_again_stands_at_its_safe_value),
        cmocka_unit_test(what_is_out_of_service_is_not_to_be_commanded),
        cmocka_unit_test(what_others_say_is_no_matter),
        cmocka_unit_test(an_external_plant_is_what_its_client_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
