/* SPDX-License-Identifier: BSD-3-Clause */
/* What an experiment file says is what is loaded; what it must not say is refused with its line. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "check.h"
#include "experiment/experiment.h"
#include "files/files.h"

static char dir[] = "/tmp/apc-experiment.XXXXXX";
static char path[64];

/* Lines 1 to 9, so that a mistake's line is known. */
static const char *const good[] = {
    "name = \"two\"; duration = 60.0; seed = 7;",
    "measurements = ( { name = \"y1\"; unit = \"m\"; low = 0.0; high = 2.0; }, { name = \"y2\"; } );",
    "setpoints = ( { name = \"r1\"; low = -1.0; high = 3.0; }, { name = \"r2\"; } );",
    "outputs = ( { name = \"u1\"; low = 1.0; high = 9.0; fault = 2.0; }, { name = \"u2\"; low = -9.0; high = "
    "-1.0; } );",
    "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:127.0.0.1:4000\"; };",
    "client = { period = 1.0; phase = 0.25; link = \"tcp:127.0.0.1:4000\"; };",
    "controller = { law = \"pi\"; period = 2.0; overrun = \"burst\"; tuning = ( { Kp = 3.0; }, { tau_i = "
    "4.0; } ); };",
    "scheduler = { period = 10.0; sequence = ( [1.0, 2.0], [3.0, 4.0] ); repeat = false; };",
    ""};
#define LINES (sizeof good / sizeof *good)

/* With line @p line replaced; 0: as it is. */
static int load(struct experiment *e, size_t line, const char *instead, struct apc_error *why)
{
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    for (size_t i = 0; i < LINES; i++)
        fprintf(out, "%s\n", i + 1 == line ? instead : good[i]);
    assert_int_equal(fclose(out), 0);
    return experiment_load(e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
}

static void assert_same(double a, double b)
{
    if (a < b || a > b)
        fail_msg("%.17g is not %.17g", a, b);
}

/*
 * Promise(experiment/stands-loaded-not): What stands there is loaded; what is not given has the default
 *   that is stated.
 */
static void everything_is_loaded_as_it_stands_there(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (load(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.name, "two");
    assert_string_equal(e.title, "two"); /* without one */
    assert_same(e.duration, 60);
    assert_int_equal(e.seed, 7);
    assert_int_equal(e.dim.ny, 2);
    assert_int_equal(e.dim.nz, 2);
    assert_int_equal(e.dim.nu, 2);
    assert_string_equal(e.y[0].tag.name, "y1");
    assert_string_equal(e.y[0].tag.unit, "m");
    assert_int_equal(e.y[1].tag.id, 2);
    assert_int_equal(e.y[1].tag.table, APC_SENSOR);
    assert_same(e.y[1].tag.low, -APC_VALUE_MAX);
    assert_same(e.y[1].tag.high, APC_VALUE_MAX);
    assert_same(e.z[0].tag.low, -1);
    assert_same(e.z[0].tag.high, 3);
    assert_int_equal(e.plant.rhythm.period, APC_NS_PER_S / 2);
    assert_int_equal(e.plant.rhythm.phase, 0);
    assert_int_equal(e.client.rhythm.phase, APC_NS_PER_S / 4);
    assert_int_equal(e.controllers->rhythm.phase, 30 * APC_NS_PER_MS); /* what there is without one */
    assert_int_equal(e.controllers->rhythm.overrun, APC_OVERRUN_BURST);
    assert_int_equal(e.client.rhythm.overrun, APC_OVERRUN_SKIP);
    assert_int_equal(e.controllers->mode, APC_MODE_AUTO);
    assert_int_equal(e.controllers->hold, 6 * APC_NS_PER_S); /* 3 periods */
    assert_int_equal(e.scheduler.steps, 2);
    assert_false(e.scheduler.repeat);
    for (int i = 0; i < 4; i++)
        assert_same(e.scheduler.sequence[i], i + 1);
    assert_false(e.controllers->plugin.chosen);
    assert_false(e.plant.plugin.chosen);
    experiment_free(&e);
}

/* The columns "default" of docs/experiment-file.md, by a file of what is required. */
/* Promise(experiment/stands-loaded-not) */
static void what_is_not_given_has_its_default(void **state)
{
    static const char least[] = "name = \"least\";\n"
                                "measurements = ( { name = \"y\"; } );\n"
                                "setpoints = ( { name = \"r\"; } );\n"
                                "outputs = ( { name = \"u\"; } );\n"
                                "plant = { model = \"first-order\"; period = 0.5; };\n"
                                "client = { period = 1.0; };\n"
                                "controller = { law = \"pi\"; period = 2.0; };\n"
                                "scheduler = { period = 10.0; sequence = ( [1.0] ); };\n";
    struct experiment e;
    struct apc_error why;
    double low, high, safe, fault;
    FILE *out = fopen(path, "w");
    (void)state;
    assert_non_null(out);
    assert_true(fputs(least, out) >= 0);
    assert_int_equal(fclose(out), 0);
    if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.title, "least");
    assert_same(e.duration, 0);
    assert_int_equal(e.seed, 1);
    module_outputs(&e, &low, &high, &safe, &fault);
    assert_same(low, -APC_VALUE_MAX);
    assert_same(high, APC_VALUE_MAX);
    assert_same(safe, 0);
    assert_same(fault, 0);
    assert_string_equal(e.y[0].tag.unit, "");
    assert_string_equal(e.y[0].tag.description, "");
    assert_same(e.sensor[0].noise, 0);
    assert_same(e.sensor[0].quantum, 0);
    assert_string_equal(e.plant.listen, "tcp:127.0.0.1:43051");
    assert_string_equal(e.client.link, "tcp:127.0.0.1:43051");
    assert_same(e.plant.options.dead_time, 0);
    assert_int_equal(e.plant.n_disturbances, 0);
    assert_null(e.plant.noise);
    for (size_t i = 0; i < e.plant.model->np; i++)
        assert_same(e.plant.p[i], e.plant.model->param[i].initial);
    assert_int_equal(e.plant.rhythm.phase, 0);
    assert_int_equal(e.client.rhythm.phase, 10 * APC_NS_PER_MS);
    assert_int_equal(e.controllers->rhythm.phase, 30 * APC_NS_PER_MS);
    assert_int_equal(e.scheduler.rhythm.phase, 0);
    assert_int_equal(e.plant.rhythm.overrun, APC_OVERRUN_SKIP);
    assert_int_equal(e.controllers->mode, APC_MODE_AUTO);
    assert_int_equal(e.controllers->hold, 6 * APC_NS_PER_S);
    assert_true(e.scheduler.repeat);
    experiment_free(&e);
}

/* Promise(experiment/stands-loaded-not) */
static void an_output_is_safe_at_0_or_at_the_limit_next_to_it(void **state)
{
    struct experiment e;
    struct apc_error why;
    double low[2], high[2], safe[2], fault[2];
    (void)state;
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    module_outputs(&e, low, high, safe, fault);
    assert_same(low[0], 1);
    assert_same(high[0], 9);
    assert_same(safe[0], 1);
    assert_same(fault[0], 2);
    assert_same(safe[1], -1);
    assert_same(fault[1], -1); /* the safe one */
    experiment_free(&e);
}

/* Promise(experiment/stands-loaded-not) */
static void each_output_has_its_own_tuning_and_the_laws_where_none_is_given(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    const struct apc_law *law = e.controllers->law;
    for (size_t i = 0; i < e.dim.nu; i++)
        for (size_t j = 0; j < law->n_tuning; j++) {
            double wanted = i == 0 && !strcmp(law->tuning[j].name, "Kp")      ? 3
                            : i == 1 && !strcmp(law->tuning[j].name, "tau_i") ? 4
                                                                              : law->tuning[j].initial;
            assert_same(e.controllers->tuning[i * law->n_tuning + j], wanted);
        }
    experiment_free(&e);
}

static void what_the_command_line_chooses_brings_its_own_tuning_and_parameters(void **state)
{
    const struct experiment_overrides overrides = {.law = "pid", .model = "four-tank"};
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(
        load(&e, 5,
             "plant = { model = \"quadruple-tank\"; period = 0.5; parameters = { nonsense = 1.0; }; };",
             &why),
        APC_EINVAL);
    if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.controllers->law->name, "pid");
    assert_string_equal(e.plant.model->name, "four-tank");
    assert_true(e.controllers->plugin.chosen);
    assert_true(e.plant.plugin.chosen);
    assert_same(e.controllers->tuning[0], e.controllers->law->tuning[0].initial);
    for (size_t i = 0; i < e.plant.model->np; i++)
        assert_same(e.plant.p[i], e.plant.model->param[i].initial);
    experiment_free(&e);
    const struct experiment_overrides magic = {.law = "magic"};
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    experiment_free(&e);
    assert_int_equal(experiment_load(&e, path, EXPERIMENT_LAW, &magic, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "--law: "));
}

static void what_is_not_needed_is_not_resolved(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    experiment_free(&e);
    assert_int_equal(experiment_load(&e, path, 0, NULL, &why), 0);
    assert_null(e.controllers->law);
    assert_null(e.plant.model);
    experiment_free(&e);
    assert_int_equal(experiment_load(&e, path, EXPERIMENT_LAW, NULL, &why), 0);
    assert_non_null(e.controllers->law);
    assert_null(e.plant.model);
    experiment_free(&e);
}

static void a_law_with_an_operating_point_needs_the_model(void **state)
{
    static const char point[] =
        "controller = { law = \"lqg\"; period = 2.0; operating_point = { u = [3.0, -3.0]; "
        "x = [1.0, 1.0, 1.0, 1.0]; }; };";
    struct experiment e;
    struct apc_error why;
    (void)state;
    (void)load(&e, 7, point, &why);
    experiment_free(&e);
    assert_int_equal(experiment_load(&e, path, 0, NULL, &why), 0);
    assert_null(e.plant.model);
    experiment_free(&e);
}

/* Promise(experiment/16-mib-text) */
static void a_file_has_at_most_16_mib(void **state)
{
    static const char line[] = "                                                               \n";
    struct experiment e;
    struct apc_error why;
    (void)state;
    for (int one_more = 0; one_more < 2; one_more++) {
        FILE *out = fopen(path, "w");
        assert_non_null(out);
        for (int i = 0; i < 16 << 14; i++)
            assert_true(fputs(line, out) >= 0);
        fputs(one_more ? "\n" : "", out);
        fclose(out);
        assert_true(experiment_load(&e, path, 0, NULL, &why) < 0);
        assert_int_equal(strstr(why.text, "is larger than 16 MiB") != NULL, one_more);
    }
}

/* Promise(experiment/misspelled-missing-name) */
static void an_edge_is_still_within(void **state)
{
    static const struct {
        size_t line;
        const char *instead;
    } edge[] = {
        {1, "name = \"e\"; seed = 9007199254740992L;"},
        {1, "name = \"e\"; seed = 2147483647;"},
        {1, "name = \"e\"; seed = 0; /* 3000000000 */ # 3000000000"},
        {1, "name = \"e\"; title = \"3000000000 \\\" 3000000000\"; // 3000000000"},
        {2, "measurements = ( { name = \"r1\"; }, { name = \"u1\"; } );"},
        {4, "outputs = ( { name = \"a\"; low = 0.0; high = 1.0; safe = 1.0; }, { name = \"b\"; low = 5.0; "
            "high = 5.0; } );"},
        {5,
         "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:127.0.0.1:0\"; steps = 1; };"},
        {5,
         "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:h:65535\"; phase = 0.499; };"},
        {6, "client = { period = 6.1; };"},
        {6, "client = { period = 1.0; link = \"tcp:[::1]:1\"; };"},
        {7, "controller = { law = \"pi\"; period = 2.0; mode = \"Man\"; hold = 0.0; };"},
        {8, "scheduler = { period = 10.0; sequence = ( [-1.0, 2.0], [3.0, 4.0] ); };"},
    };
    struct experiment e;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof edge / sizeof *edge; i++) {
        if (load(&e, edge[i].line, edge[i].instead, &why) < 0)
            fail_msg("%s: %s", edge[i].instead, why.text);
        experiment_free(&e);
    }
}

/* One that is not ours to start: without a model, and with one for what needs it. */
/* Promise(run/plant-already-needs) */
static void an_external_plant_is_named_by_its_client_alone(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct apc_plant *plant;
    struct apc_plantserver *server;
    (void)state;
    if (load(&e, 5, "plant = { external = true; };", &why) < 0)
        fail_msg("%s", why.text);
    assert_true(e.plant.external);
    assert_null(e.plant.model);
    assert_int_equal(e.plant.rhythm.period, e.client.rhythm.period);
    assert_int_equal(e.plant.rhythm.phase, 0);
    assert_int_equal(module_plant(&e, &plant, &server, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "the plant is external"));
    experiment_free(&e);
    if (load(&e, 5, "plant = { external = true; period = 3.0; model = \"quadruple-tank\"; };", &why) < 0)
        fail_msg("%s", why.text);
    assert_true(e.plant.external);
    assert_non_null(e.plant.model);
    assert_int_equal(e.plant.rhythm.period, 3 * APC_NS_PER_S);
    experiment_free(&e);
    if (load(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_false(e.plant.external);
    experiment_free(&e);
}

/*
 * Promise(experiment/actions-taken-time): Actions: taken by time, refused with their line; done at the
 *   instant in virtual time, not before it in a real run.
 */
static void actions_are_taken_by_time(void **state)
{
    static const struct {
        double at;
        enum apc_table table;
        int id;
        double value;
    } expected[] = {{0, APC_OPMODE, 1, APC_MODE_MAN}, {1, APC_OPMODE, 2, APC_MODE_AUTO},
                    {2, APC_MANUAL, 2, -3},           {5, APC_SETPOINT, 1, 2},
                    {5, APC_TUNING, 6, 0.5}, /* Kp of u2: pi has five parameters */
                    {5, APC_SETPOINT, 1, 1}};
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (load(&e, LINES,
             "actions = ( { at = 5.0; set = \"r1\"; value = 2.0; }, { at = 2; set = \"u2\"; value = -3; },"
             " { at = 5.0; set = \"u2.Kp\"; value = 0.5; }, { at = 5.0; set = \"setpoint.1\"; value = 1; },"
             " { at = 0.0; mode = \"controller\"; value = \"Man\"; },"
             " { at = 9.0; start = \"controller\"; }, { at = 8.0; kill = \"controller\"; },"
             " { at = 1.0; mode = \"u2\"; value = \"Auto\"; } );",
             &why) < 0)
        fail_msg("%s", why.text);
    const size_t n = sizeof expected / sizeof *expected;
    assert_int_equal(e.n_actions, n + 2);
    assert_int_equal(e.action[0].n, 2); /* loops of the controller */
    assert_int_equal(e.action[1].n, 1);
    assert_int_equal(e.action[n].kind, ACTION_KILL);
    assert_int_equal(e.action[n + 1].kind, ACTION_START);
    for (size_t i = 0; i < n; i++) {
        assert_int_equal(e.action[i].kind, ACTION_WRITE);
        assert_int_equal(e.action[i].at, (apc_ns)(expected[i].at * 1e9));
        assert_int_equal(e.action[i].to.table, expected[i].table);
        assert_int_equal(e.action[i].to.id, expected[i].id);
        assert_same(e.action[i].to.value, expected[i].value);
    }
    experiment_free(&e);
}

#define MODBUS(more)                                                                                         \
    "plant = { external = true; }; client = { period = 1.0; link = \"modbus:plc:502\"; modbus = { " more     \
    " }; };"
#define Y1_Y2 "{ name = \"y1\"; at = \"input:0\"; }, { name = \"sensor.2\"; at = \"discrete:7\"; }"
#define U1_U2                                                                                                \
    "{ name = \"u1\"; at = \"holding:1\"; }, { name = \"u2\"; at = \"holding:65535\"; type = \"int16\"; }"

/* Line 5 and what stood in line 6. */
static int load_modbus(struct experiment *e, const char *line, struct apc_error *why)
{
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    for (size_t i = 0; i < LINES; i++)
        fprintf(out, "%s\n", i == 4 ? line : i == 5 ? "" : good[i]);
    assert_int_equal(fclose(out), 0);
    return experiment_load(e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
}

/* Promise(links/types-word-order) */
static void a_map_is_loaded_as_it_stands_there(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (load_modbus(
            &e,
            MODBUS(
                "unit = 9; word_order = \"low\"; watchdog = \"holding:40\"; life = \"coil:41\"; life_limit "
                "= 2.5; map = ( { name = \"u1\"; at = \"holding:1\"; type = \"float32\"; word_order = "
                "\"high\"; scale = -0.5; offset = 3; }, " Y1_Y2
                ", { name = \"u2\"; at = \"holding:65535\"; type = \"int16\"; } ); read_back = true;"),
            &why) < 0)
        fail_msg("%s", why.text);
    const struct apc_modbus_options *o = &e.client.modbus;
    assert_string_equal(e.client.link, "modbus:plc:502");
    assert_int_equal(o->unit, 9);
    assert_true(o->read_back);
    assert_int_equal(o->u[0].area, APC_MODBUS_HOLDING);
    assert_int_equal(o->u[0].type, APC_MODBUS_F32);
    assert_int_equal(o->u[0].address, 1);
    assert_false(o->u[0].low_word_first);
    assert_same(o->u[0].scale, -0.5);
    assert_same(o->u[0].offset, 3);
    assert_same(o->u[0].safe, e.u[0].safe);
    assert_same(o->u[1].safe, e.u[1].safe);
    assert_int_equal(o->u[1].area, APC_MODBUS_HOLDING);
    assert_int_equal(o->u[1].type, APC_MODBUS_S16);
    assert_int_equal(o->y[1].type, APC_MODBUS_BIT);
    assert_int_equal(o->y[0].area, APC_MODBUS_INPUT);
    assert_int_equal(o->y[0].type, APC_MODBUS_U16);
    assert_true(o->y[0].low_word_first);
    assert_same(o->y[0].scale, 1);
    assert_int_equal(o->y[1].area, APC_MODBUS_DISCRETE);
    assert_int_equal(o->y[1].address, 7);
    assert_int_equal(o->watchdog->address, 40);
    assert_int_equal(o->life->area, APC_MODBUS_COIL);
    assert_int_equal(o->life_limit, 5 * APC_NS_PER_S / 2);
    experiment_free(&e);
    if (load_modbus(&e, MODBUS("map = ( " Y1_Y2 ", " U1_U2 " );"), &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.client.modbus.unit, 1);
    assert_null(e.client.modbus.watchdog);
    assert_null(e.client.modbus.watchdogs);
    assert_null(e.client.modbus.life);
    assert_false(e.client.modbus.read_back);
    experiment_free(&e);
    if (load_modbus(
            &e,
            MODBUS("map = ( " Y1_Y2 ", { name = \"u1\"; at = \"holding:0\"; }, "
                   "{ name = \"u2\"; at = \"holding:1\"; type = \"int16\"; watchdog = \"holding:9\"; } );"),
            &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.client.modbus.watchdogs[0].area, 0);
    assert_int_equal(e.client.modbus.watchdogs[1].area, APC_MODBUS_HOLDING);
    assert_int_equal(e.client.modbus.watchdogs[1].type, APC_MODBUS_U16);
    assert_int_equal(e.client.modbus.watchdogs[1].address, 9);
    experiment_free(&e);
}

/* However it is written: as the sheet of the device has it. */
static void a_code_for_no_value_is_taken_as_it_is_written(void **state)
{
    static const struct {
        const char *y1;
        uint64_t code;
    } cases[] = {
        {"type = \"int16\"; no_value = 0x8000;", 0x8000},
        {"type = \"int16\"; no_value = -32768;", 0x8000},
        {"type = \"uint16\"; no_value = 65535;", 0xFFFF},
        {"type = \"int32\"; no_value = 0x80000000;", 0x80000000},
        {"type = \"uint32\"; no_value = 0xFFFFFFFF;", 0xFFFFFFFF},
        {"type = \"uint32\"; no_value = -1;", 0xFFFFFFFF},
        {"type = \"int64\"; no_value = 0x8000000000000000L;", 0x8000000000000000},
        {"type = \"uint64\"; no_value = 0xFFFFFFFFFFFFFFFFL;", 0xFFFFFFFFFFFFFFFF},
        {"type = \"float32\"; no_value = -9999;", 0xC61C3C00},
        {"type = \"float32\"; no_value = [-9999.0];", 0xC61C3C00},
        {"type = \"float64\"; no_value = -9999.0;", 0xC0C3878000000000},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct experiment e;
        struct apc_error why;
        char line[800];
        snprintf(line, sizeof line,
                 MODBUS("byte_order = \"low\"; block = 10; map = ( " U1_U2
                        ", { name = \"y1\"; at = \"input:1\"; unit = 3; %s }, { name = \"y2\"; at = "
                        "\"input:9.12\"; byte_order = \"high\"; } );"),
                 cases[i].y1);
        if (load_modbus(&e, line, &why) < 0)
            fail_msg("%s: %s", cases[i].y1, why.text);
        const struct apc_modbus_point *y = e.client.modbus.y;
        assert_int_equal(y[0].n_no_value, 1);
        assert_true(y[0].no_value[0] == cases[i].code);
        assert_int_equal(y[0].unit, 3);
        assert_true(y[0].low_byte_first);
        assert_int_equal(y[1].type, APC_MODBUS_FLAG);
        assert_int_equal(y[1].bit, 12);
        assert_int_equal(y[1].unit, 0);
        assert_false(y[1].low_byte_first);
        assert_int_equal(e.client.modbus.block, 10);
        experiment_free(&e);
    }
}

static void a_file_that_is_not_there_or_no_text_is_refused(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(experiment_load(&e, "/nowhere/at.all", 0, NULL, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "/nowhere/at.all: there is no such file or folder"));
    assert_int_equal(experiment_load(&e, APC_SOURCE_DIR "/tests", 0, NULL, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "/tests is no run folder: it has no run.conf"));
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    assert_int_equal(fwrite("name\0", 1, 5, out), 5);
    fclose(out);
    assert_int_equal(experiment_load(&e, path, 0, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "is no text"));
    /* Latin-1 would go into signals.csv and onto the page; in a remark it harms nobody */
    static const char latin[] = "# 20 \xb0"
                                "C\nname = \"x\";\ntitle = \"20 \xb0"
                                "C\";\n";
    out = fopen(path, "w");
    assert_non_null(out);
    assert_int_equal(fwrite(latin, 1, sizeof latin - 1, out), sizeof latin - 1);
    fclose(out);
    assert_int_equal(experiment_load(&e, path, 0, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, ":3: the byte 0xB0 is not UTF-8: save the file in UTF-8"));
}

/* A name or a message that drives a terminal, or reads as another one, is refused however it is written. */
/* Promise(incoming/text-of-others) */
static void a_text_that_controls_how_it_is_shown_is_refused(void **state)
{
    static const struct {
        const char *title, *why;
    } texts[] = {{"tank\\x1b[2J", ":2: the character U+001B controls how text is shown"},
                 {"tank\x1b[2J", ":2: the character U+001B controls how text is shown"},
                 {"tank\xc2\x9b", ":2: the character U+009B"},
                 {"tank\xe2\x80\xae", ":2: the character U+202E"},
                 {"tank\\xff", ":2: the byte 0xFF is not UTF-8"}};
    struct experiment_source from = {.file = "tank.conf"};
    struct experiment e;
    struct apc_error why;
    char text[200];

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        snprintf(text, sizeof text, "name = \"x\";\ntitle = \"%s\";\n", texts[i].title);
        from.text = text;
        assert_int_equal(experiment_parse(&e, &from, 0, NULL, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, texts[i].why));
    }
}

static void the_nearest_name_is_one_that_is_alike(void **state)
{
    static const struct {
        const char *wanted, *nearest;
    } of[] = {{"Kq", "Kp"},      {"taui", "tau_i"}, {"tau_d", "tau_d"},
              {"ubar", "u_bar"}, {"gain", NULL},    {"", NULL}};
    static const char *const names[] = {"Kp", "Ki", "tau_i", "tau_d", "u_bar"}; /* Kq: the first of two */
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct nearest nearest = {.wanted = of[i].wanted};
        for (size_t j = 0; j < sizeof names / sizeof *names; j++)
            nearest_look(&nearest, names[j]);
        if (of[i].nearest)
            assert_string_equal(nearest.name, of[i].nearest);
        else
            assert_null(nearest.name);
    }
}

/* ---- Of a plant and its sensors ----------------------------------------------------------- */

static void all_of_a_plant_and_its_sensors_is_loaded(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (load(
            &e, 5,
            "plant = { model = \"quadruple-tank\"; period = 0.5; parameters = { A1 = 30.0; };\n"
            "x0 = [1.0, 2.0, 3.0, 4.0]; integrator = \"rk4\"; rtol = 1e-7; atol = 1e-9; steps = 4; dead_time "
            "= 0.25;\n"
            "noise = { h2 = 0.5; h4 = 0.25; }; phase = 0.125; overrun = \"stop\";\n"
            "disturbances = ( { name = \"d3\"; at = 20.0; value = 0.5; }, { name = \"d4\"; at = 10.0; value "
            "= 0.25; },\n"
            "  { name = \"d3\"; at = 20.0; value = 0.0; }, { name = \"d3\"; at = 5.0; value = 1.0; } ); };",
            &why) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < e.plant.model->np; i++)
        assert_same(e.plant.p[i],
                    strcmp(e.plant.model->param[i].name, "A1") ? e.plant.model->param[i].initial : 30);
    for (int i = 0; i < 4; i++)
        assert_same(e.plant.x0[i], i + 1);
    assert_string_equal(e.plant.integrator, "rk4");
    assert_same(e.plant.options.rtol, 1e-7);
    assert_same(e.plant.options.atol, 1e-9);
    assert_int_equal(e.plant.options.steps, 4);
    assert_same(e.plant.options.dead_time, 0.25);
    assert_int_equal(e.plant.options.size, sizeof e.plant.options);
    assert_same(e.plant.noise[0], 0);
    assert_same(e.plant.noise[1], 0.5);
    assert_same(e.plant.noise[2], 0);
    assert_same(e.plant.noise[3], 0.25);
    assert_int_equal(e.plant.rhythm.phase, 125 * APC_NS_PER_MS);
    assert_int_equal(e.plant.rhythm.overrun, APC_OVERRUN_STOP);
    /* by time; at one time as they stand there */
    static const struct {
        const char *name;
        double at, value;
    } wanted[] = {{"d3", 5, 1}, {"d4", 10, 0.25}, {"d3", 20, 0.5}, {"d3", 20, 0}};
    assert_int_equal(e.plant.n_disturbances, 4);
    for (size_t i = 0; i < 4; i++) {
        const struct apc_disturbance *is = &e.plant.disturbance[i];
        assert_string_equal(e.plant.model->disturbance[is->k].name, wanted[i].name);
        assert_same(apc_ns_to_s(is->at), wanted[i].at);
        assert_same(is->value, wanted[i].value);
    }
    experiment_free(&e);
    if (load(&e, 2,
             "measurements = ( { name = \"y1\"; noise = 0.5; faults = ( { kind = \"stuck\"; at = 1.0; },\n"
             "{ kind = \"drift\"; at = 2.0; duration = 3.0; size = -0.5; } ); }, { name = \"y2\"; quantum = "
             "0.25; period = 30.0;\n"
             "faults = ( { kind = \"dropout\"; at = 0.0; }, { kind = \"spike\"; at = 4.0; size = 7.0; } ); } "
             ");",
             &why) < 0)
        fail_msg("%s", why.text);
    assert_same(e.sensor[0].noise, 0.5);
    assert_same(e.sensor[0].quantum, 0);
    assert_same(e.sensor[1].quantum, 0.25);
    assert_int_equal(e.sensor[0].period, 0);
    assert_int_equal(e.sensor[1].period, 30 * APC_NS_PER_S);
    assert_int_equal(e.sensor[0].n_faults, 2 + EXPERIMENT_SENSOR_KINDS); /* which an instructor may start */
    assert_int_equal(e.sensor[1].n_faults, 2 + EXPERIMENT_SENSOR_KINDS);
    assert_int_equal(e.sensor[0].fault[0].kind, APC_FAULT_STUCK);
    assert_int_equal(e.sensor[0].fault[0].at, APC_NS_PER_S);
    assert_int_equal(e.sensor[0].fault[0].duration, 0);
    assert_int_equal(e.sensor[0].fault[1].kind, APC_FAULT_DRIFT);
    assert_int_equal(e.sensor[0].fault[1].duration, 3 * APC_NS_PER_S);
    assert_same(e.sensor[0].fault[1].size, -0.5);
    assert_int_equal(e.sensor[1].fault[0].kind, APC_FAULT_DROPOUT);
    assert_int_equal(e.sensor[1].fault[1].kind, APC_FAULT_SPIKE);
    assert_same(e.sensor[1].fault[1].size, 7);
    experiment_free(&e);
    if (load(&e, 4,
             "outputs = ( { name = \"u1\"; low = 1.0; high = 9.0; safe = 3.0; initial = 4.0; }, { name = "
             "\"u2\"; low = -9.0; high = -1.0; initial = -2.0; description = \"it\"; } );",
             &why) < 0)
        fail_msg("%s", why.text);
    assert_same(e.u[0].fault, 3); /* the safe one */
    assert_same(e.u[0].initial, 4);
    assert_same(e.u[1].initial, -2);
    assert_same(e.u[1].safe, -1);
    assert_string_equal(e.u[1].tag.description, "it");
    experiment_free(&e);
}

static void a_plant_and_its_server_are_made_both_or_none(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct apc_plant *plant;
    struct apc_plantserver *server;
    (void)state;
    assert_int_equal(load(&e, 5,
                          "plant = { model = \"quadruple-tank\"; period = 0.5; disturbances = ( { name = "
                          "\"d3\"; at = 1.0; value = 0.1; } ); };",
                          &why),
                     0);
    assert_int_equal(module_plant(&e, &plant, &server, &why), 0);
    assert_non_null(plant);
    assert_non_null(server);
    apc_plantserver_destroy(server);
    apc_plant_destroy(plant);
    e.plant.disturbance[0].k = 99;
    assert_true(module_plant(&e, &plant, &server, &why) < 0);
    assert_null(plant);
    assert_null(server);
    experiment_free(&e);
}

/* ---- Steps of rk4 ------------------------------------------------------------------------- */

static int integrate(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    (void)x;
    (void)p;
    dx[0] = u[0];
    return 0;
}

static void show(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)u;
    (void)p;
    y[0] = x[0];
}

static const double *linear;
static size_t states;

static int decay(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    (void)u;
    (void)p;
    for (size_t i = 0; i < states; i++) {
        dx[i] = 0;
        for (size_t k = 0; k < states; k++)
            dx[i] += linear[i * states + k] * x[k];
    }
    return 0;
}

/* The fastest of several, which may turn: each of these matrices has its largest eigenvalue beside it. */
static void the_fastest_of_several_poles_says_how_long_a_step_may_be(void **state)
{
    static const double turning[] = {-1, 4, -4, -1}, coupled[] = {-2, 1, 1, -2},
                        far[] = {-1, 100, 0, 0, -2, 50, 0, 0, -3}, three[] = {0, 1, 0, 0, 0, 1, -5, -7, -3};
    static const struct {
        const double *a;
        size_t n;
        double radius;
    } of[] = {{turning, 2, 4.123105625617661}, {coupled, 2, 3}, {far, 3, 3}, {three, 3, 2.23606797749979}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        struct apc_error why;
        assert_int_equal(
            load(&e, 5,
                 "plant = { model = \"quadruple-tank\"; period = 0.5; integrator = \"rk4\"; steps = "
                 "1; listen = \"tcp:127.0.0.1:4000\"; };",
                 &why),
            0);
        const struct apc_model *const real = e.plant.model;
        struct apc_model model = *real;
        double x0[3] = {0};
        double *const given = e.plant.x0;
        linear = of[i].a;
        model.nx = states = of[i].n;
        model.f = decay;
        model.g = show;
        model.ny = 1;
        e.plant.model = &model;
        e.plant.x0 = x0;
        for (int k = -1; k <= 1; k += 2) {
            e.plant.rhythm.period = (apc_ns)(2.8 / of[i].radius * (1 + k * 1e-5) * 1e9);
            const int rc = experiment_check_steps(&e, &why);
            if (rc != (k > 0 ? APC_ERANGE : 0))
                fail_msg("matrix %zu: %d: %s", i, rc, why.text);
        }
        e.plant.model = real;
        e.plant.x0 = given;
        experiment_free(&e);
    }
}

static void steps_of_rk4_that_are_too_long_are_told_of(void **state)
{
    static const struct {
        const char *how;
        const char *reason; /* NULL: short enough */
    } of[] = {
        {"period = 27.5; integrator = \"rk4\"; steps = 1;", NULL}, /* 2.75 of pole times step */
        {"period = 28.5; integrator = \"rk4\"; steps = 1;",
         "steps of 28.5 s of rk4 are too long for a pole of 0.1/s: what should decay grows; plant.steps = 3 "
         "would do"},
        {"period = 55.0; integrator = \"rk4\"; steps = 2;", NULL},
        {"period = 100.0; integrator = \"rk4\"; steps = 2;", "steps of 50 s of rk4 are too long"},
        {"period = 275.0; integrator = \"rk4\";", NULL}, /* ten steps where the file says none */
        {"period = 285.0; integrator = \"rk4\";", "plant.steps = 29 would do"},
        {"period = 285.0;", NULL},
    };
    char text[900];
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        struct apc_error why;
        FILE *out = fopen(path, "w");
        assert_non_null(out);
        snprintf(text, sizeof text,
                 "name = \"one\"; measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; } );\n"
                 "outputs = ( { name = \"u\"; } ); plant = { model = \"first-order\"; %s };\n"
                 "client = { period = 5.0; }; controller = { law = \"pi\"; period = 5.0; };\n"
                 "scheduler = { period = 5.0; sequence = ( [0.0] ); };\n",
                 of[i].how);
        fputs(text, out);
        fclose(out);
        if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
            fail_msg("%s", why.text);
        int rc = experiment_check_steps(&e, &why);
        if (rc != (of[i].reason ? APC_ERANGE : 0))
            fail_msg("%s: %d", of[i].how, rc);
        if (of[i].reason && !strstr(why.text, of[i].reason))
            fail_msg("%s: said \"%s\"", of[i].how, why.text);
        struct apc_model integrator = *e.plant.model; /* of which nothing decays: no step is too long */
        integrator.f = integrate;
        integrator.g = show;
        e.plant.model = &integrator;
        assert_int_equal(experiment_check_steps(&e, &why), 0);
        experiment_free(&e);
    }
}

/* ---- Of a law ----------------------------------------------------------------------------- */

static void limits_narrow_what_a_law_allows(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (load(&e, 7,
             "controller = { law = \"pi\"; period = 2.0; tuning = ( { Kp = 1.0; }, { Kp = 3.0; } ); limits = "
             "{ Kp = [1.0, 3.0]; }; };",
             &why) < 0)
        fail_msg("%s", why.text);
    for (size_t j = 0; j < e.controllers->law->n_tuning; j++) {
        const struct apc_param *is = &e.controllers->param[j], *was = &e.controllers->law->tuning[j];
        const bool narrowed = !strcmp(was->name, "Kp");
        assert_string_equal(is->name, was->name);
        assert_same(is->low, narrowed ? 1 : was->low);
        assert_same(is->high, narrowed ? 3 : was->high);
    }
    experiment_free(&e);
    /* what the command line chooses is not bound by them, and another law may have other parameters */
    const struct experiment_overrides overrides = {.law = "pid"};
    assert_true(load(&e, 7,
                     "controller = { law = \"pi\"; period = 2.0; tuning = ( { Kp = 1.0; }, { Kp = 4.0; } ); "
                     "limits = { Kp = [1.0, 3.0]; }; };",
                     &why) < 0);
    assert_non_null(strstr(why.text, "Kp of output 2 is 4, outside its \"limits\", 1 to 3"));
    assert_int_equal(experiment_load(&e, path, EXPERIMENT_LAW, &overrides, &why), 0);
    assert_same(e.controllers->param[0].low, e.controllers->law->tuning[0].low);
    experiment_free(&e);
}

/* What it does not say is the model's; what it says goes before. */
static void an_operating_point_is_the_models_own_as_far_as_the_file_does_not_say(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    for (int says = 0; says < 2; says++) {
        if (load(&e, 7,
                 says ? "controller = { law = \"pi\"; period = 2.0; operating_point = { u = [3.5, 2.5]; }; };"
                      : "controller = { law = \"pi\"; period = 2.0; operating_point = { }; };",
                 &why) < 0)
            fail_msg("%s", why.text);
        const struct apc_model *m = e.plant.model;
        const struct apc_law_plant *at = &e.controllers->plant;
        double dx[4], y[2];
        assert_int_equal(at->nx, m->nx);
        assert_same(at->u0[0], says ? 3.5 : m->input[0].initial);
        assert_same(at->u0[1], says ? 2.5 : m->input[1].initial);
        double u[8]; /* its disturbances as they are undisturbed */
        assert_true(m->nu + m->nd <= 8);
        memcpy(u, at->u0, m->nu * sizeof *u);
        for (size_t i = 0; i < m->nd; i++)
            u[m->nu + i] = m->disturbance[i].initial;
        assert_int_equal(m->f(0, at->x0, u, e.controllers->believed, dx), 0);
        m->g(0, at->x0, u, e.controllers->believed, y);
        for (size_t i = 0; i < m->nx; i++)
            assert_true(dx[i] < 1e-9 && dx[i] > -1e-9);
        for (size_t i = 0; i < m->ny; i++)
            assert_same(at->y0[i], y[i]);
        experiment_free(&e);
    }
}

/* The Smith predictor of the examples takes a row for each output; texts are the law's to understand. */
/* Promise(laws/settings-numbers) */
static void a_setting_is_a_number_an_array_rows_or_a_text(void **state)
{
    static const struct {
        const char *setting;
        int rc;
    } of[] = {
        {"model = ( [10.0, 5.0, 8.0], [20.0, 6.0, 4.0] )", 0},
        {"model = [10.0, 5.0, 8.0]", APC_EINVAL},
        {"model = ( [10.0, 5.0, 8.0], [20.0, 6.0] )", APC_EINVAL},
        {"model = ( [10.0, 5.0, 8.0], 20.0 )", APC_EINVAL},
        {"model = \"a.mod\"", APC_EINVAL},
    };
    char text[500];
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        struct apc_error why;
        snprintf(text, sizeof text,
                 "controller = { law = \"" APC_EXAMPLES_DIR
                 "/smith.so\"; period = 2.0; settings = { %s; }; };",
                 of[i].setting);
        const int rc = load(&e, 7, text, &why);
        if (rc != of[i].rc)
            fail_msg("%s: %d: %s", of[i].setting, rc, rc < 0 ? why.text : "");
        if (rc == 0) {
            assert_int_equal(e.controllers->setting->rows, 2);
            assert_int_equal(e.controllers->setting->columns, 3);
            assert_same(e.controllers->setting->value[4], 6.0);
            experiment_free(&e);
        }
    }
}

/* ---- The record of a run ------------------------------------------------------------------ */

static void in_run(char *to, size_t size, const char *name)
{
    snprintf(to, size, "%s/%s", dir, name);
}

static void write_record(const char *text)
{
    char record[96];
    in_run(record, sizeof record, "record.conf");
    FILE *out = fopen(record, "w");
    assert_non_null(out);
    fputs(text, out);
    fclose(out);
}

static void a_run_folder_is_loaded_as_it_ran(void **state)
{
    char conf[96], record[96], hash[RECORD_HASH_LEN], text[1500];
    struct experiment e;
    struct apc_error why;
    (void)state;
    in_run(conf, sizeof conf, "run.conf");
    in_run(record, sizeof record, "record.conf");
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    experiment_free(&e);
    assert_int_equal(rename(path, conf), 0);
    if (experiment_load(&e, dir, EXPERIMENT_LAW, NULL, &why) < 0) /* nothing is recorded: as the file says */
        fail_msg("%s", why.text);
    assert_string_equal(e.file, conf);
    assert_same(e.duration, 60);
    assert_int_equal(e.start, 0);
    experiment_free(&e);
    assert_int_equal(record_hash(conf, hash, &why), 0);
    assert_int_equal(strspn(hash, "0123456789abcdef"), 64);
    assert_int_equal(strlen(hash), 64);
    static const char form[] = "%s duration = 20.0; seed = %s; net = \"loss=0.25\"; experiment = { sha256 = "
                               "\"%s\"; };\n"
                               "law = { name = \"pid\"; chosen = true; };\n"
                               "plant = { name = \"quadruple-tank\"; };\n";
    snprintf(text, sizeof text, form, "start = \"2026-01-01T00:00:00Z\"; ended = 12.5;", "-1L", hash);
    write_record(text);
    if (experiment_load(&e, dir, EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_same(e.duration, 12.5);
    assert_true(e.seed == UINT64_MAX);
    assert_int_equal(e.start, INT64_C(1767225600) * APC_NS_PER_S);
    assert_string_equal(e.net, "loss=0.25");
    assert_same(e.models.network.options.loss, 0.25);
    assert_string_equal(e.controllers->law->name, "pid");
    assert_true(e.controllers->plugin.chosen);
    assert_false(e.plant.plugin.chosen);
    experiment_free(&e);
    /* the command line goes before it */
    const struct experiment_overrides overrides = {.law = "pi"};
    snprintf(text, sizeof text, form, "", "5", hash);
    write_record(text);
    assert_int_equal(experiment_load(&e, conf, EXPERIMENT_LAW, &overrides, &why), 0);
    assert_string_equal(e.controllers->law->name, "pi");
    assert_same(e.duration, 20); /* it never came to its end */
    assert_int_equal(e.start, 0);
    assert_int_equal(e.seed, 5);
    experiment_free(&e);

    static const struct {
        const char *text, *reason;
    } of[] = {
        {"seed = 1; experiment = { sha256 = \"$\"; };", "\"duration\" is missing"},
        {"duration = 1.0; experiment = { sha256 = \"$\"; };", "\"seed\" is missing"},
        {"duration = 1.0; seed = 1;", "\"experiment\" is missing"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"0$\"; };", "is too long: at most 64 bytes"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"abc\"; };",
         "run.conf is not the file that ran: its SHA-256 is no longer the recorded one"},
        {"duration = 1.0; seed = 1; experiment = { };", "\"sha256\" is missing"},
        {"duration = -1.0; seed = 1; experiment = { sha256 = \"$\"; };", "\"duration\" is -1"},
        {"duration = 31622401.0; seed = 1; experiment = { sha256 = \"$\"; };",
         "\"duration\" is 31622401: must be"},
        {"duration = 1.0; ended = -1.0; seed = 1; experiment = { sha256 = \"$\"; };", "\"ended\" is -1"},
        {"start = \"soon\"; duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; };",
         "\"start\" is \"soon\": must be a time"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; };", "\"law\" is missing"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { name = \"pi\"; };",
         "\"plant\" is missing"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { chosen = true; };",
         "\"name\" is missing"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { name = \"pi\"; lie = 1; };",
         "unknown setting \"lie\""},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { name = \"pi\"; file = "
         "\"../a.so\"; sha256 = \"0\"; };",
         "\"file\" is \"../a.so\": must lie in the run folder"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { name = \"pi\"; file = "
         "\"a.so\"; sha256 = \"0\"; };",
         "/a.so: cannot be read: No such file"},
        {"duration = 1.0; seed = 1; experiment = { sha256 = \"$\"; }; law = { name = \"pi\"; file = "
         "\"run.conf\"; };",
         "\"sha256\" is missing"},
        {"duration = ", "record.conf:1: syntax error"},
    };
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const char *mark = strchr(of[i].text, '$');
        const int before = mark ? (int)(mark - of[i].text) : (int)strlen(of[i].text);
        snprintf(text, sizeof text, "%.*s%s%s", before, of[i].text, mark ? hash : "", mark ? mark + 1 : "");
        write_record(text);
        if (experiment_load(&e, dir, 0, NULL, &why) >= 0)
            fail_msg("taken: %s", of[i].text);
        if (!strstr(why.text, of[i].reason) || !strstr(why.text, "record.conf:"))
            fail_msg("%s: said \"%s\", not \"%s\"", of[i].text, why.text, of[i].reason);
        assert_null(e.y);
    }
    remove(record);
    remove(conf);
}

static void a_hash_is_that_of_all_bytes(void **state)
{
    char hash[RECORD_HASH_LEN];
    struct apc_error why;
    (void)state;
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fputs("abc", out);
    fclose(out);
    assert_int_equal(record_hash(path, hash, &why), 0);
    assert_string_equal(hash, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    out = fopen(path, "w");
    assert_non_null(out);
    for (int i = 0; i < 1000000; i++) /* more than one block: NIST's long test */
        fputc('a', out);
    fclose(out);
    assert_int_equal(record_hash(path, hash, &why), 0);
    assert_string_equal(hash, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
    assert_int_equal(record_hash("/nowhere/at.all", hash, &why), APC_ESYS);
    assert_non_null(strstr(why.text, "/nowhere/at.all: cannot be read: No such file"));
}

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(dir))
        return -1;
    snprintf(path, sizeof path, "%s/two.conf", dir);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    remove(path);
    return rmdir(dir);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(everything_is_loaded_as_it_stands_there),
        cmocka_unit_test(what_is_not_given_has_its_default),
        cmocka_unit_test(an_output_is_safe_at_0_or_at_the_limit_next_to_it),
        cmocka_unit_test(each_output_has_its_own_tuning_and_the_laws_where_none_is_given),
        cmocka_unit_test(what_the_command_line_chooses_brings_its_own_tuning_and_parameters),
        cmocka_unit_test(what_is_not_needed_is_not_resolved),
        cmocka_unit_test(a_law_with_an_operating_point_needs_the_model),
        cmocka_unit_test(a_file_has_at_most_16_mib),
        cmocka_unit_test(an_edge_is_still_within),
        cmocka_unit_test(an_external_plant_is_named_by_its_client_alone),
        cmocka_unit_test(a_map_is_loaded_as_it_stands_there),
        cmocka_unit_test(actions_are_taken_by_time),
        cmocka_unit_test(a_code_for_no_value_is_taken_as_it_is_written),
        cmocka_unit_test(a_file_that_is_not_there_or_no_text_is_refused),
        cmocka_unit_test(a_text_that_controls_how_it_is_shown_is_refused),
        cmocka_unit_test(the_nearest_name_is_one_that_is_alike),
        cmocka_unit_test(all_of_a_plant_and_its_sensors_is_loaded),
        cmocka_unit_test(a_plant_and_its_server_are_made_both_or_none),
        cmocka_unit_test(steps_of_rk4_that_are_too_long_are_told_of),
        cmocka_unit_test(the_fastest_of_several_poles_says_how_long_a_step_may_be),
        cmocka_unit_test(limits_narrow_what_a_law_allows),
        cmocka_unit_test(an_operating_point_is_the_models_own_as_far_as_the_file_does_not_say),
        cmocka_unit_test(a_setting_is_a_number_an_array_rows_or_a_text),
        cmocka_unit_test(a_run_folder_is_loaded_as_it_ran),
        cmocka_unit_test(a_hash_is_that_of_all_bytes),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
