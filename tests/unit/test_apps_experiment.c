/* SPDX-License-Identifier: BSD-3-Clause */
/* What an experiment file says is what is loaded; what it must not say is refused with its line. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "common/experiment.h"
#include "common/nearest.h"

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
    assert_int_equal(e.controller.rhythm.phase, 30 * APC_NS_PER_MS); /* what there is without one */
    assert_int_equal(e.controller.rhythm.overrun, APC_OVERRUN_BURST);
    assert_int_equal(e.client.rhythm.overrun, APC_OVERRUN_SKIP);
    assert_int_equal(e.controller.mode, APC_MODE_AUTO);
    assert_int_equal(e.controller.hold, 6 * APC_NS_PER_S); /* 3 periods */
    assert_int_equal(e.scheduler.steps, 2);
    assert_false(e.scheduler.repeat);
    for (int i = 0; i < 4; i++)
        assert_same(e.scheduler.sequence[i], i + 1);
    assert_false(e.controller.plugin.chosen);
    assert_false(e.plant.plugin.chosen);
    experiment_free(&e);
}

/* The columns "default" of docs/experiment-file.md, by a file of what is required. */
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
    experiment_outputs(&e, &low, &high, &safe, &fault);
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
    assert_int_equal(e.controller.rhythm.phase, 30 * APC_NS_PER_MS);
    assert_int_equal(e.scheduler.rhythm.phase, 0);
    assert_int_equal(e.plant.rhythm.overrun, APC_OVERRUN_SKIP);
    assert_int_equal(e.controller.mode, APC_MODE_AUTO);
    assert_int_equal(e.controller.hold, 6 * APC_NS_PER_S);
    assert_true(e.scheduler.repeat);
    experiment_free(&e);
}

static void an_output_is_safe_at_0_or_at_the_limit_next_to_it(void **state)
{
    struct experiment e;
    struct apc_error why;
    double low[2], high[2], safe[2], fault[2];
    (void)state;
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    experiment_outputs(&e, low, high, safe, fault);
    assert_same(low[0], 1);
    assert_same(high[0], 9);
    assert_same(safe[0], 1);
    assert_same(fault[0], 2);
    assert_same(safe[1], -1);
    assert_same(fault[1], -1); /* the safe one */
    experiment_free(&e);
}

static void each_output_has_its_own_tuning_and_the_laws_where_none_is_given(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(load(&e, 0, NULL, &why), 0);
    const struct apc_law *law = e.controller.law;
    for (size_t i = 0; i < e.dim.nu; i++)
        for (size_t j = 0; j < law->n_tuning; j++) {
            double wanted = i == 0 && !strcmp(law->tuning[j].name, "Kp")      ? 3
                            : i == 1 && !strcmp(law->tuning[j].name, "tau_i") ? 4
                                                                              : law->tuning[j].initial;
            assert_same(e.controller.tuning[i * law->n_tuning + j], wanted);
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
    assert_string_equal(e.controller.law->name, "pid");
    assert_string_equal(e.plant.model->name, "four-tank");
    assert_true(e.controller.plugin.chosen);
    assert_true(e.plant.plugin.chosen);
    assert_same(e.controller.tuning[0], e.controller.law->tuning[0].initial);
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
    assert_null(e.controller.law);
    assert_null(e.plant.model);
    experiment_free(&e);
    assert_int_equal(experiment_load(&e, path, EXPERIMENT_LAW, NULL, &why), 0);
    assert_non_null(e.controller.law);
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

static void a_mistake_is_refused_with_its_line_and_reason(void **state)
{
    static const struct {
        size_t line;
        const char *instead, *reason;
    } mistake[] = {
        {1, "", "1: \"name\" is missing in the file"},
        {1, "name = \"\";", "1: \"name\" must have at least one character"},
        {1, "name = \"a/b\";", "1: \"name\" is \"a/b\": it names a folder"},
        {1, "name = \".a\";", "it names a folder"},
        {1, "name = \"e\"; duration = -1.0;", "\"duration\" is -1: must be from 0"},
        {1, "name = \"e\"; duration = \"long\";", "\"duration\" must be a finite number"},
        {1, "name = \"e\"; seed = 9007199254740993L;",
         "\"seed\" must be from 0 to 9007199254740992, a whole number"},
        {1, "name = \"e\"; seed = -1;", "\"seed\" must be from 0"},
        {1, "name = \"e\"; seed = 1.0;", "a whole number"},
        {1, "name = \"e\"; seed = 2147483648;",
         "1: 2147483648 is beyond 32 bits: write 2147483648.0 or 2147483648L"},
        {1, "name = \"e\"; seed = -2147483649;", "-2147483649 is beyond 32 bits"},
        {1, "name = \"e\"; seed = 99999999999999999999;", "is beyond 32 bits"},
        {1, "name = \"e\"; titel = \"e\";",
         "unknown setting \"titel\" in the file; known are: name, title, "},
        {1, "name = \"e\"; titel = \"e\";", "did you mean \"title\"?"},
        {1, "name = \"e\"; title = 1;", "\"title\" must be text in double quotes"},
        {1, "name = \"e\"; clock = ();\n\n  network = {", "the file ends within a group"},
        {1, "name = = 3;", "1: syntax error at \"name = = 3;\""},
        {1, "/* \n\n */ name = = 3;", "3: syntax error"},
        {1, "@include \"a\"", "1: @include is not taken"},
        {2, "measurements = ( 3, 4 );", "2: expected a group"},
        {2, "measurements = [3.0, 4.0];", "\"measurements\" must be a list"},
        {2, "measurements = ( );", "\"measurements\" must name 1 to 4096 variables"},
        {2, "measurements = ( { name = \"y\"; }, { name = \"y\"; } );", "two variables are called \"y\""},
        {2, "measurements = ( { name = \"sensor.1\"; } );", "which a command line takes for something else"},
        {2, "measurements = ( { name = \"-1\"; } );", "which a command line takes for something else"},
        {2, "measurements = ( { name = \"a=b\"; } );", "which a command line takes for something else"},
        {2, "measurements = ( { name = \"y\"; safe = 1.0; } );", "unknown setting \"safe\" in the file"},
        {2, "measurements = ( { name = \"a\\tb\"; } );", "no line breaks or tabs"},
        {3, "setpoints = ( { name = \"r\"; noise = 1.0; } );", "3: unknown setting \"noise\""},
        {3, "setpoints = ( { name = \"r\"; low = 2.0; high = 1.0; } );", "\"high\" is 1: must be from 2"},
        {3, "setpoints = ( { name = \"u1\"; }, { name = \"r2\"; } );", "4: two variables are called \"u1\""},
        {4, "outputs = ( { name = \"u\"; low = 0.0; high = 1.0; safe = 1.5; } );",
         "\"safe\" is 1.5: must be from 0 to 1"},
        {4, "outputs = ( { name = \"u\"; low = 0.0; high = 1.0; fault = -0.5; } );", "\"fault\" is -0.5"},
        {5, "", "\"plant\" is missing in the file"},
        {5, "plant = 3;", "5: \"plant\" must be a group"},
        {5, "plant = { model = \"servo\"; period = 0.5; };",
         "model servo has 1 outputs and 1 inputs; the file names 2 measurements and 2 outputs"},
        {5, "plant = { model = \"quadruple-tank\"; };", "\"period\" is missing in plant"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.0; };", "\"period\" of plant: "},
        {5, "plant = { model = \"quadruple-tank\"; period = true; };",
         "\"period\" must be a number of seconds"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; phase = 0.5; };",
         "\"phase\" is 0.5: must be below the period"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; phase = -0.1; };",
         "\"phase\" is -0.1: must be from 0 to 3600"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; overrun = \"later\"; };",
         "\"overrun\" must be \"skip\", \"burst\" or \"stop\""},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; x0 = [1.0]; };",
         "expected 4 numbers in brackets"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:h:65536\"; };",
         "must be tcp:HOST:PORT"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp::1\"; };",
         "must be tcp:HOST:PORT"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:h:\"; };",
         "must be tcp:HOST:PORT"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; listen = \"tcp:h:1x\"; };",
         "must be tcp:HOST:PORT"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; noise = { h9 = 1.0; }; };",
         "has no state \"h9\"; there are: "},
        {5,
         "plant = { model = \"quadruple-tank\"; period = 0.5; disturbances = ( { name = \"d9\"; at = 1.0; "
         "value = 1.0; } ); };",
         "has no disturbance \"d9\""},
        {6, "client = { period = 1.0; link = \"tcp:h:0\"; };",
         "\"link\" is \"tcp:h:0\": must be tcp:HOST:PORT"},
        {6, "client = { period = 1.0; link = \"tcp://h:1\"; };", "must be tcp:HOST:PORT"},
        {6, "client = { period = 6.2; };", "6: \"period\" of client is 6.2 s, of controller 2 s: at most 3"},
        {7, "controller = { law = \"pi\"; period = 2.0; mode = \"auto\"; };",
         "\"mode\" must be \"Auto\" or \"Man\""},
        {7, "controller = { law = \"pi\"; period = 2.0; hold = -1.0; };",
         "\"hold\" is -1: must be from 0 to 86400"},
        {7, "controller = { law = \"pi\"; period = 2.0; tuning = ( { } ); };",
         "\"tuning\" must have one group for each of the 2 outputs"},
        {7, "controller = { law = \"pi\"; period = 2.0; tuning = ( { }, 3 ); };",
         "expected a group: { Kp = 1.0; ... }"},
        {7, "controller = { law = \"pi\"; period = 2.0; tuning = ( { Kq = 1.0; }, { } ); };",
         "pi has no parameter \"Kq\": did you mean \"Kp\"?"},
        {7, "controller = { law = \"pi\"; period = 2.0; settings = { a = 1.0; }; };",
         "unknown setting \"a\" in settings; there are none"},
        {5, "plant = { model = \"quadruple-tank\"; period = 0.5; hold = 1.0; };",
         "unknown setting \"hold\" in plant"},
        {6, "client = { period = 1.0; hold = 1.0; };", "unknown setting \"hold\" in client"},
        {7, "controller = { law = \"pi\"; period = 2.0; holt = 1.0; };",
         "unknown setting \"holt\" in controller"},
        {8, "scheduler = { period = 10.0; sequence = ( [1.0, 1.0] ); hold = 1.0; };",
         "unknown setting \"hold\" in scheduler"},
        {8, "scheduler = { period = 10.0; sequence = ( ); };", "\"sequence\" must have at least one step"},
        {8, "scheduler = { period = 10.0; sequence = ( [1.0] ); };", "expected 2 numbers in brackets"},
        {8, "scheduler = { period = 10.0; sequence = ( (1.0, true) ); };",
         "element 2 must be a finite number"},
        {8, "scheduler = { period = 10.0; sequence = ( [3.5, 1.0] ); };",
         "8: setpoint r1 = 3.5 lies outside its limits -1 to 3"},
        {8, "scheduler = { period = 10.0; sequence = ( [-1.5, 1.0] ); };", "setpoint r1 = -1.5 lies outside"},
        {8, "scheduler = { period = 10.0; sequence = ( [1.0, 1.0] ); repeat = 1; };",
         "\"repeat\" must be true or false"},
    };
    struct experiment e;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof mistake / sizeof *mistake; i++) {
        int rc = load(&e, mistake[i].line, mistake[i].instead, &why);
        if (rc >= 0)
            fail_msg("taken: %s", mistake[i].instead);
        if (!strstr(why.text, mistake[i].reason) || strncmp(why.text, path, strlen(path)) != 0)
            fail_msg("%s: said \"%s\", not \"%s\"", mistake[i].instead, why.text, mistake[i].reason);
        assert_null(e.y); /* it is empty */
        assert_null(e.scheduler.sequence);
    }
}

static void a_file_that_is_not_there_or_no_text_is_refused(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    assert_int_equal(experiment_load(&e, "/nowhere/at.all", 0, NULL, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "/nowhere/at.all: cannot be read"));
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    assert_int_equal(fwrite("name\0", 1, 5, out), 5);
    fclose(out);
    assert_int_equal(experiment_load(&e, path, 0, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "is no text"));
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
        cmocka_unit_test(a_mistake_is_refused_with_its_line_and_reason),
        cmocka_unit_test(a_file_that_is_not_there_or_no_text_is_refused),
        cmocka_unit_test(the_nearest_name_is_one_that_is_alike),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
