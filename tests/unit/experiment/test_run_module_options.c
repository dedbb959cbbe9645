/* SPDX-License-Identifier: BSD-3-Clause */
/* What a controller is told of those above and below it, where several take turns: who they are, and how long
 * each may stay away.
 */
#include "check.h"

#include <stdio.h>

#include "experiment/experiment_parts.h"
#include "modules/controller.h"

#define S  APC_NS_PER_S
#define MS APC_NS_PER_MS

/* Of upper, upper2 and upper3 the second is the slowest; of base and base2 the first; of smooth and smooth2
 * the second; both selectors are as slow. */
static const char text[] =
    "name = \"options\"; duration = 10.0;\n"
    "measurements = ( { name = \"y\"; low = -9.0; high = 9.0; }, { name = \"w\"; period = 5.0; } );\n"
    "setpoints = ( { name = \"r\"; low = -5.0; high = 5.0; initial = 1.5; }, { name = \"s\"; initial = 5.0; "
    "}, { name = \"s2\"; }, { name = \"s3\"; } );\n"
    "outputs = ( { name = \"u\"; low = -2.0; high = 2.0; fault = 1.0; }, { name = \"v\"; low = 1.0; high = "
    "2.0; } );\n"
    "signals = ( { name = \"f\"; low = -9.0; high = 9.0; }, { name = \"want\"; low = 2.0; high = 9.0; },\n"
    "            { name = \"allow\"; low = -9.0; high = -3.0; } );\n"
    "plant = { external = true; period = 0.25; };\n"
    "client = { period = 0.1; };\n"
    "controllers = (\n"
    "  { name = \"smooth\"; law = \"filter\"; period = 0.5; measurements = [\"y\"]; outputs = [\"f\"]; },\n"
    "  { name = \"base\"; law = \"pi\"; period = 0.5; mode = \"Cas\"; hold = 7.0; measurements = [\"f\"];\n"
    "    setpoints = [\"r\"]; outputs = [\"u\"]; },\n"
    "  { name = \"upper\"; law = \"pi\"; period = 1.0; measurements = [\"w\"]; setpoints = [\"s\"]; outputs "
    "= [\"r\"]; },\n"
    "  { name = \"level\"; law = \"pi\"; period = 2.0; measurements = [\"y\"]; setpoints = [ \"s2\" ]; "
    "outputs = [\"want\"]; },\n"
    "  { name = \"guard\"; law = \"pi\"; period = 3.0; measurements = [\"y\"]; setpoints = [ \"s3\" ]; "
    "outputs = [\"allow\"]; },\n"
    "  { name = \"choose\"; law = \"select\"; period = 0.4; measurements = [\"want\", \"allow\"]; outputs = "
    "[\"v\"];\n"
    "    settings = { select = \"low\"; }; },\n"
    "  { name = \"smooth2\"; shadow = true; law = \"filter\"; period = 0.75; measurements = [\"y\"]; outputs "
    "= [\"f\"]; },\n"
    "  { name = \"base2\"; shadow = true; law = \"pid\"; period = 0.25; mode = \"Cas\"; measurements = "
    "[\"y\"];\n"
    "    setpoints = [\"r\"]; outputs = [\"u\"]; },\n"
    "  { name = \"upper2\"; shadow = true; law = \"pid\"; period = 1.5; measurements = [\"y\"]; setpoints = "
    "[\"s\"];\n"
    "    outputs = [\"r\"]; },\n"
    "  { name = \"upper3\"; shadow = true; law = \"pi\"; period = 0.5; measurements = [\"w\"]; setpoints = "
    "[\"s\"];\n"
    "    outputs = [\"r\"]; },\n"
    "  { name = \"choose2\"; shadow = true; law = \"select\"; period = 0.8; measurements = [\"want\", "
    "\"allow\"];\n"
    "    outputs = [\"v\"]; settings = { select = \"high\"; }; } );\n";

static struct experiment e;
static struct apc_error why;

static const struct controller *named(const char *name)
{
    const struct controller *c = e.controllers;
    while (strcmp(c->name, name) != 0)
        c++;
    return c;
}

static struct apc_controller *core_of(const char *name)
{
    struct apc_controller *core;
    if (module_controller(&e, named(name), false, &core, &why) < 0)
        fail_msg("%s: %s", name, why.text);
    return core;
}

/* These and nobody else, in this order, by their numbers. */
static void assert_group(const struct apc_controller_group *group, const char *const *names)
{
    size_t n = 0;
    for (; names[n]; n++) {
        assert_true(n < group->n);
        assert_int_equal(group->number[n], named(names[n])->number);
    }
    assert_int_equal(group->n, n);
}

static int set_up(void **state)
{
    const struct experiment_source source = {.file = "test", .text = text};
    (void)state;
    if (experiment_parse(&e, &source, EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    experiment_free(&e);
    return 0;
}

static void all_that_may_move_a_setpoint_are_waited_for_as_the_slowest(void **state)
{
    static const char *const bases[] = {"base", "base2"}, *const uppers[] = {"upper", "upper2", "upper3",
                                                                             NULL};
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct apc_controller *core = core_of(bases[i]);
        assert_string_equal(core->setpoint[0].name, "r");
        assert_near(core->setpoint[0].low, -5.0, 0.0);
        assert_near(core->setpoint[0].high, 5.0, 0.0);
        assert_int_equal(core->setpoint[0].above, named("upper")->first_loop);
        assert_int_equal(core->setpoint[0].above_number, named("upper")->number);
        assert_int_equal(core->setpoint[0].above_period, 1500 * MS);
        assert_group(&core->above[0].who, uppers);
        assert_int_equal(core->loop[0].id, 1);
        assert_near(core->loop[0].fault, 1.0, 0.0);
        assert_int_equal(core->loop[0].hold, i == 0 ? 7 * S : 750 * MS);
        apc_controller_destroy(core);
    }
}

static void all_that_may_take_an_output_are_waited_for_as_the_slowest(void **state)
{
    static const char *const uppers[] = {"upper", "upper2", "upper3"}, *const bases[] = {"base", "base2",
                                                                                         NULL};
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        struct apc_controller *core = core_of(uppers[i]);
        assert_int_equal(core->loop[0].setpoint, 1);
        assert_int_equal(core->loop[0].id, 0);
        assert_int_equal(core->loop[0].below, named("base")->first_loop);
        assert_int_equal(core->loop[0].below_tick, named("base")->number);
        assert_int_equal(core->loop[0].below_period, 500 * MS);
        assert_near(core->loop[0].fault, 1.5, 0.0); /* the setpoint's first value */
        assert_group(&core->below[0].who, bases);
        assert_int_equal(core->setpoint[0].above, 0);
        apc_controller_destroy(core);
    }
}

static void a_signal_that_is_selected_is_told_of_by_whoever_selects(void **state)
{
    static const char *const selectors[] = {"choose", "choose2", NULL};
    static const struct {
        const char *name;
        int signal;
        double fault; /* 0, or what is nearest to it */
    } of[] = {{"level", 4, 2.0}, {"guard", 5, -3.0}};
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct apc_controller *core = core_of(of[i].name);
        assert_int_equal(core->loop[0].signal, of[i].signal);
        assert_int_equal(core->loop[0].below_tick, named("choose")->number);
        assert_int_equal(core->loop[0].below_period, 800 * MS);
        assert_near(core->loop[0].fault, of[i].fault, 0.0);
        assert_group(&core->below[0].who, selectors);
        apc_controller_destroy(core);
    }
    struct apc_controller *core = core_of("smooth"); /* nobody selects what it calculates */
    assert_int_equal(core->loop[0].signal, 3);
    assert_int_equal(core->loop[0].below_tick, 0);
    apc_controller_destroy(core);
    for (size_t i = 0; selectors[i]; i++) {
        core = core_of(selectors[i]);
        assert_int_equal(core->n_inputs, 2); /* both tell of both */
        apc_controller_destroy(core);
    }
    core = core_of("base");
    assert_int_equal(core->n_inputs, 0);
    apc_controller_destroy(core);
}

/* Three periods and 0.1 s. */
static void a_measurement_may_stay_away_as_long_as_it_takes_to_come(void **state)
{
    static const struct {
        const char *name;
        size_t y;
        apc_ns horizon;
    } of[] = {{"smooth", 0, 3 * 250 * MS + 100 * MS}, /* the plant is slower than the client */
              {"upper", 0, 15 * S + 100 * MS},        /* it comes seldom */
              {"base", 0, 3 * 750 * MS + 100 * MS},   /* it is calculated, by the slower one perhaps */
              {"choose", 0, 6 * S + 100 * MS},
              {"choose2", 1, 9 * S + 100 * MS}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct apc_controller *core = core_of(of[i].name);
        assert_int_equal(core->horizon[of[i].y], of[i].horizon);
        apc_controller_destroy(core);
    }
    e.client.rhythm.period = 400 * MS;
    struct apc_controller *core = core_of("smooth");
    assert_int_equal(core->horizon[0], 3 * 400 * MS + 100 * MS);
    apc_controller_destroy(core);
    assert_int_equal(module_command_period(&e), 800 * MS); /* the slowest of those that command the plant */
    assert_int_equal(module_patience(&e), 200 * MS);
    e.client.rhythm.period = 5 * S;
    assert_int_equal(module_patience(&e), S);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(all_that_may_move_a_setpoint_are_waited_for_as_the_slowest),
        T(all_that_may_take_an_output_are_waited_for_as_the_slowest),
        T(a_signal_that_is_selected_is_told_of_by_whoever_selects),
        T(a_measurement_may_stay_away_as_long_as_it_takes_to_come),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
