/* SPDX-License-Identifier: BSD-3-Clause */
/* A sensor that shows more than it can, in virtual time: no number of it is used, and it is said. */
#include "check.h"

#include <math.h>
#include <string.h>

#include "modules/controller.h"
#include "operate/operate.h"
#include "simulation/simulation.h"

static const char text[] =
    "name = \"range\"; duration = 100.0;\n"
    "measurements = ( { name = \"y\"; low = 0.0; high = 20.0;\n"
    "  faults = ( { kind = \"drift\"; at = 30.0; duration = 20.0; size = 1000.0; } ); } );\n"
    "setpoints = ( { name = \"r\"; initial = 5.0; } ); outputs = ( { name = \"u\"; low = -1.0; high = 1.0; "
    "fault = 0.25; } );\n"
    "plant = { model = \"first-order\"; period = 0.1; }; client = { period = 0.1; };\n"
    "controller = { law = \"pi\"; period = 0.5; hold = 5.0; };\n";

static int find_event(void *ctx, const struct apc_event *event)
{
    const char **wanted = ctx; /* in this order; found ones go */
    if (*wanted[0] && !strcmp(event->source, "apc-client") && strstr(event->text, wanted[0]))
        memmove(wanted, wanted + 1, 2 * sizeof *wanted);
    return 0;
}

/*
 * Promise(incoming/beyond-its-range)
 * Promise(incoming/other-ways)
 */
static void beyond_its_range_it_is_bridged_then_the_fault_value_and_back(void **state)
{
    const char *wanted[] = {"beyond its range, 0 to 20: Bad", "y is within its range again", ""};
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    const struct experiment_source from = {.file = "range.conf", .text = text};
    double held = 0;
    (void)state;
    if (experiment_parse(&e, &from, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&s, &e, 1, &why) < 0)
        fail_msg("%s", why.text);
    for (int t = 1; t <= 100; t++) {
        struct apc_sample y = {.table = APC_SENSOR, .id = 1};
        struct apc_controller *c = s.controller[0].core;
        assert_int_equal(simulation_run(&s, t), 0);
        assert_int_equal(apc_store_read(s.store, &y, 1), 0);
        assert_int_equal(y.status, t > 30 && t <= 50 ? APC_BAD_OUT_OF_RANGE : APC_GOOD);
        assert_true(fabs(c->y[0]) <= 20.0);
        if (t == 31)
            held = c->u[0];
        if (t == 34)
            assert_near(c->u[0], held, 0.0);
        if (t > 37 && t <= 50)
            assert_near(c->u[0], 0.25, 0.0);
    }
    assert_true(apc_store_events(s.store, NULL, find_event, wanted) > 0);
    assert_string_equal(wanted[0], "");
    simulation_destroy(&s);
    experiment_free(&e);
}

/* Of a session that is judged, or rewound, there are more runs than one. */
static void a_fault_that_was_stopped_begins_in_the_next_run_as_ever(void **state)
{
    const struct experiment_source from = {.file = "range.conf", .text = text};
    struct apc_sample stop = {
        .table = APC_OPMODE, .id = LOOPS_FAULT(0), .seq = 1, .time = SIMULATION_BEGIN + 35 * APC_NS_PER_S};
    const struct samples stopped = {.at = &stop, .n = 1};
    struct apc_sample y = {.table = APC_SENSOR, .id = 1};
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    (void)state;
    if (experiment_parse(&e, &from, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    for (int run = 0; run < 2; run++) {
        if (simulation_create(&s, &e, 1, &why) < 0)
            fail_msg("%s", why.text);
        assert_true(run > 0 || simulation_repeat_writes(&s, &stopped) >= 0);
        assert_int_equal(simulation_run(&s, 40), 0);
        assert_int_equal(apc_store_read(s.store, &y, 1), 0);
        assert_int_equal(y.status, run > 0 ? APC_BAD_OUT_OF_RANGE : APC_GOOD);
        simulation_destroy(&s);
    }
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(beyond_its_range_it_is_bridged_then_the_fault_value_and_back),
        cmocka_unit_test(a_fault_that_was_stopped_begins_in_the_next_run_as_ever),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
