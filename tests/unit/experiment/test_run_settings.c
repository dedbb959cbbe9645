/* SPDX-License-Identifier: BSD-3-Clause */
/* Settings over those of the file; plants whose parameters are drawn; what a law believes of them. */
#include "check.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment/experiment.h"
#include "experiment/experiment_parts.h"
#include "operate/operate.h"
#include "scratch.h"
#include "simulation/simulation.h"

static const char world[] =
    "name = \"world\"; duration = 12.0; seed = 5;\n"
    "measurements = ( { name = \"y1\"; }, { name = \"y2\"; } );\n"
    "setpoints = ( { name = \"r1\"; initial = 6.2; }, { name = \"r2\"; initial = 6.3; } );\n"
    "outputs = ( { name = \"v1\"; low = 0.0; high = 10.0; }, { name = \"v2\"; low = 0.0; high = 10.0; } );\n"
    "plant = { model = \"quadruple-tank\"; period = 0.5; };\n"
    "client = { period = 0.5; };\n"
    "controllers = ( { name = \"base\"; law = \"lqg\"; period = 2.0; measurements = [\"y1\", \"y2\"];\n"
    "  setpoints = [\"r1\", \"r2\"]; outputs = [\"v1\", \"v2\"]; operating_point = { u = [3.0, 3.0]; };\n"
    "  tuning = ( { u_max = 10.0; }, { u_max = 9.0; } ); } );\n";

static struct apc_error why;

static int try_set(struct experiment *e, const struct experiment_setting *set, size_t n)
{
    const struct experiment_overrides overrides = {.set = set, .n_set = n};
    scratch_write("world.conf", world);
    return experiment_load(e, scratch_path("world.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides,
                           &why);
}

static void load(struct experiment *e, const struct experiment_setting *set, size_t n)
{
    if (try_set(e, set, n) < 0)
        fail_msg("%s", why.text);
}

/* Reported of a reader of YAML: 0010 is taken for 8. Files of other machines have \r, and a byte order mark. */
static void a_number_with_zeros_before_it_is_decimal_on_whatever_machine_it_was_written(void **state)
{
    static const char *const durations[] = {"010", "0010.0", "10.", "1e1", "+10", "0x0A"};
    const char *const rest = strchr(world, ';') + 1, *const behind = strchr(rest, ';') + 1;
    (void)state;
    for (size_t i = 0; i < sizeof durations / sizeof *durations; i++) {
        struct experiment e;
        char text[sizeof world + 100], *to = text;
        to += snprintf(to, sizeof text, "\xef\xbb\xbfname = \"world\";\r\nduration = %s;\r\n", durations[i]);
        for (const char *from = behind; *from; from++) {
            if (*from == '\n')
                *to++ = '\r';
            *to++ = *from;
        }
        *to = '\0';
        scratch_write("other.conf", text);
        if (experiment_load(&e, scratch_path("other.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) <
            0)
            fail_msg("%s: %s", durations[i], why.text);
        assert_near(e.duration, 10.0, 0.0);
        experiment_free(&e);
    }
}

/* Place of a parameter of the model. */
static size_t at(const struct experiment *e, const char *name)
{
    size_t i = 0;
    while (strcmp(e->plant.model->param[i].name, name) != 0)
        i++;
    return i;
}

static void later_settings_hold_over_former_ones_and_over_the_file(void **state)
{
    static const struct experiment_setting set[] = {{"duration", "7"},
                                                    {"plant.parameters.A1", "30"},
                                                    {"controllers.base.v2.u_max", "8"},
                                                    {"duration", "9"}};
    struct experiment e;
    double value;
    (void)state;
    load(&e, set, 4);
    assert_near(e.duration, 9, 0);
    assert_near(e.plant.p[at(&e, "A1")], 30, 0);
    assert_int_equal(experiment_value(&e, "controllers.base.v2.u_max", &value, &why), 0);
    assert_near(value, 8, 0);
    assert_non_null(strstr(e.text, "parameters = { A1 = 30; }")); /* what a run folder keeps */
    experiment_free(&e);
}

/* Promise(laws/former) */
static void a_former_name_of_a_law_s_setting_is_taken_unless_the_present_one_is_there_too(void **state)
{
    static const char predictive[] =
        "{ name = \"base\"; law = \"mpc\"; period = 2.0; "
        "measurements = [\"y1\", \"y2\"]; setpoints = [\"r1\", \"r2\"]; "
        "outputs = [\"v1\", \"v2\"]; operating_point = { u = [3.0, 3.0]; }; "
        "limits = { move = [0.1, 9.0]; }; tuning = ( { move = 0.5; wish = 2.0; }, { } ); "
        "settings = { y_dev = [1.0, 2.0]; u_dev = [3.0, 4.0]; preview = 0; }; }";
    static const struct experiment_setting set[] = {{"controllers.[0]", predictive},
                                                    {"controllers.base.v1.move_suppression", "0.7"},
                                                    {"controllers.base.v2.move", "0.9"},
                                                    {"controllers.base.settings.setpoint_preview", "1"},
                                                    {"controllers.base.settings.y_dev.[1]", "5.0"}},
                                           both[] = {{"controllers.[0]", predictive},
                                                     {"controllers.base.tuning",
                                                      "( { wish = 1.0; reference_weight = 2.0; }, { } )"}},
                                           unknown = {"controllers.base.v1.move", "0.5"};
    struct experiment e;
    double value;
    (void)state;
    load(&e, set, 5);
    const struct controller *c = e.controllers;
    assert_int_equal(experiment_value(&e, "controllers.base.v1.move", &value, &why), 0);
    assert_near(value, 0.7, 0);
    assert_near(c->tuning[0], 0.7, 0);
    assert_near(c->tuning[1], 2.0, 0);
    assert_int_equal(experiment_value(&e, "controllers.base.v2.move_suppression", &value, &why), 0);
    assert_near(value, 0.9, 0);
    assert_near(c->param[0].low, 0.1, 0);
    assert_int_equal(c->n_setting, 3);
    assert_string_equal(c->setting[0].name, "y_scale");
    assert_near(c->setting[0].value[1], 5.0, 0);
    assert_string_equal(c->setting[2].name, "setpoint_preview");
    assert_near(c->setting[2].value[0], 1.0, 0);
    assert_non_null(c->former); /* to be warned of */
    size_t n;
    struct apc_tag *tags = provision_tags(&e, &n);
    struct loops loops;
    struct change_target to;
    struct change_fault fault;
    assert_int_equal(controllers_describe(&e, &loops), 0);
    const struct plant_view plant = {tags, n, &loops};
    assert_int_equal(change_find(&plant, "v2.move", CHANGE_TUNING, &to, &fault), 0);
    assert_string_equal(to.name, "v2.move_suppression");
    assert_int_equal(change_find(&plant, "v2.mov", CHANGE_TUNING, &to, &fault), APC_ENOTFOUND);
    assert_int_equal(action_find(&e, tags, n, "v2.move", true, tags, &why), 0);
    assert_string_equal(tags->name, "v2.move_suppression");
    loops_free(&loops);
    free(tags);
    experiment_free(&e);
    assert_int_equal(try_set(&e, both, 2), APC_EINVAL);
    assert_has(why.text, "\"wish\" is the former name of \"reference_weight\", and both are given");
    assert_int_equal(try_set(&e, &unknown, 1), APC_EINVAL); /* of lqg it never was */
    assert_has(why.text, "has no parameter \"move\"");
    load(&e, NULL, 0);
    assert_null(e.controllers->former);
    experiment_free(&e);
}

static void the_backup_laws_tuning_is_set_by_the_name_of_its_output(void **state)
{
    static const struct experiment_setting set[] = {{"controllers.base.backup.law", "pid"},
                                                    {"controllers.base.v2.backup.Kp", "7"},
                                                    {"controllers.base.v1.backup.Kp", "5"},
                                                    {"controllers.base.v1.backup.tau_i", "50"}};
    struct experiment e;
    double value;
    (void)state;
    load(&e, set, 4);
    assert_int_equal(experiment_value(&e, "controllers.base.v1.backup.Kp", &value, &why), 0);
    assert_near(value, 5, 0);
    assert_int_equal(experiment_value(&e, "controllers.base.v2.backup.tau_i", &value, &why), 0);
    assert_near(value, 10, 0); /* as the law has it, where nobody said */
    assert_non_null(strstr(e.text, "tuning = ({ Kp = 5; tau_i = 50; }, { Kp = 7; })"));
    experiment_free(&e);
}

static void what_is_wrong_is_said_of_what_was_set_or_of_the_file(void **state)
{
    static const struct experiment_setting high[] = {{"plant.parameters.A1", "30"},
                                                     {"controllers.base.period", "-1"}},
                                           unknown[] = {{"controllers.bsae.period", "1"}},
                                           good[] = {{"seed", "3"}};
    struct experiment e;
    (void)state;
    assert_int_equal(try_set(&e, high, 2), APC_EINVAL);
    assert_has(why.text, "plant.parameters.A1 = 30, controllers.base.period = -1: \"period\" of ");
    assert_int_equal(try_set(&e, unknown, 1), APC_ENOTFOUND);
    assert_has(why.text, "did you mean \"base\"?");
    const struct experiment_overrides overrides = {.set = good, .n_set = 1};
    scratch_write("broken.conf", "name = \"broken\";\nname2 = 1;\n");
    assert_int_equal(
        experiment_load(&e, scratch_path("broken.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, &why),
        APC_EINVAL);
    assert_has(why.text, "broken.conf:2: unknown setting \"name2\"");
}

/* Promise(simulation/set-file-would) */
static void a_setting_of_a_law_or_model_that_is_not_there_is_refused(void **state)
{
    static const struct {
        const char *path;
        bool refused;
    } of[] = {{"controllers.base.v1.u_max", true},
              {"controllers.base.settings.q", true},
              {"controllers.[0].tuning.[0].u_max", true},
              {"controllers.base.period", false},
              {"controllers.base.hold", false},
              {"plant.parameters.A1", true},
              {"plant.noise.h1", true},
              {"plant.period", false}};
    const struct experiment_overrides pi = {.law = "base=pi"},
                                      tanks = {.law = "base=pi", .model = "quadruple-tank"};
    struct experiment e;
    (void)state;
    scratch_write("world.conf", world);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct experiment_setting set = {of[i].path,
                                               strstr(of[i].path, "settings") ? "[1.0, 1.0]" : "1"};
        struct experiment_overrides overrides = strncmp(of[i].path, "plant", 5) ? pi : tanks;
        overrides.set = &set;
        overrides.n_set = 1;
        int rc = experiment_load(&e, scratch_path("world.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW,
                                 &overrides, &why);
        if ((rc < 0) != of[i].refused)
            fail_msg("%s: %d, %s", of[i].path, rc, why.text);
        if (of[i].refused)
            assert_has(why.text, "another one was chosen, which has its own");
        experiment_free(&e);
    }
}

/* It would pass for text, of which the law would say that it is none of its numbers. */
static void what_begins_as_a_list_and_is_none_is_refused(void **state)
{
    static const char *const value[] = {"[0, 0.01]", " [1.0, 2.0", "( [1.0], ", "{ a = 1.0 ", "[1.0, b]"};
    struct experiment e;
    (void)state;
    scratch_write("world.conf", world);
    for (size_t i = 0; i < sizeof value / sizeof *value; i++) {
        const struct experiment_setting set = {"controllers.base.settings", value[i]};
        const struct experiment_overrides overrides = {.set = &set, .n_set = 1};
        assert_int_equal(experiment_load(&e, scratch_path("world.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW,
                                         &overrides, &why),
                         APC_EINVAL);
        assert_has(why.text, "is no list or group");
        experiment_free(&e);
    }
    load(&e, (const struct experiment_setting[]){{"title", "a draft"}, {"title", "(a draft"}},
         2); /* where text was it is text */
    experiment_free(&e);
}

/* Promise(simulation/drawn-plant-seed) */
static void a_parameter_is_drawn_for_each_seed_and_the_law_has_its_mean(void **state)
{
    static const struct experiment_setting set[] = {{"plant.parameters.A1", "normal(30, 2)"},
                                                    {"plant.parameters.A2", "uniform(20, 30)"}};
    struct experiment e;
    double p[32], again[32], mean = 0, square = 0;
    (void)state;
    load(&e, set, 2);
    const size_t a1 = at(&e, "A1"), a2 = at(&e, "A2"), a3 = at(&e, "A3"), np = e.plant.model->np;
    assert_true(np <= 32);
    assert_near(e.plant.p[a1], 30, 0);
    assert_near(e.plant.p[a2], 25, 0);
    assert_near(e.controllers->plant.p[a1], 30, 0);
    for (unsigned seed = 1; seed <= 1000; seed++) {
        assert_int_equal(experiment_draw(&e, seed, p, &why), 0);
        assert_int_equal(experiment_draw(&e, seed, again, &why), 0);
        assert_memory_equal(p, again, np * sizeof *p);
        assert_near(p[a3], e.plant.p[a3], 0);
        assert_true(p[a2] >= 20 && p[a2] <= 30);
        mean += p[a1] / 1000;
        square += (p[a1] - 30) * (p[a1] - 30) / 1000;
    }
    assert_near(mean, 30, 0.2);
    assert_near(square, 4, 0.6);
    experiment_free(&e);
}

/* Of a simulation: the level that only the plant's own parameters say. */
static double level(const struct experiment *e, uint64_t seed)
{
    struct simulation s;
    if (simulation_create(&s, e, seed, &why) < 0 || simulation_run(&s, e->duration) < 0)
        fail_msg("%s", why.text);
    struct apc_sample newest = {.table = APC_SENSOR, .id = 1};
    assert_true(apc_store_read(s.store, &newest, 1) >= 0);
    simulation_destroy(&s);
    return newest.value;
}

/* Promise(simulation/drawn-plant-seed) */
static void the_plant_runs_with_what_was_drawn(void **state)
{
    struct experiment e;
    double p[32];
    char value[40];
    (void)state;
    load(&e, &(struct experiment_setting){"plant.parameters.A1", "normal(30, 2)"}, 1);
    const double drawn = level(&e, 8), other = level(&e, 9);
    assert_int_equal(experiment_draw(&e, 8, p, &why), 0);
    snprintf(value, sizeof value, "%.17g", p[at(&e, "A1")]);
    experiment_free(&e);
    assert_true(drawn != other);
    /* the same plant, told of by its number, under a controller that believes the mean */
    const struct experiment_setting told[] = {{"plant.parameters.A1", value},
                                              {"controllers.base.operating_point.parameters.A1", "30.0"}};
    load(&e, told, 2);
    assert_near(level(&e, 8), drawn, 0);
    experiment_free(&e);
    load(&e, told, 1); /* its controller knows it: that is another loop */
    assert_true(level(&e, 8) != drawn);
    experiment_free(&e);
}

static void a_draw_keeps_to_the_parameter_s_limits_or_is_refused(void **state)
{
    struct experiment e;
    double p[32];
    (void)state;
    load(&e, &(struct experiment_setting){"plant.parameters.A1", "normal(1, 5)"}, 1);
    const struct apc_param *param = &e.plant.model->param[at(&e, "A1")];
    for (unsigned seed = 1; seed <= 200; seed++) {
        assert_int_equal(experiment_draw(&e, seed, p, &why), 0);
        assert_true(p[at(&e, "A1")] >= param->low && p[at(&e, "A1")] <= param->high);
    }
    e.plant.spread[at(&e, "A1")] = (struct apc_distribution){.kind = APC_UNIFORM, .a = -5, .b = -4};
    assert_int_equal(experiment_draw(&e, 1, p, &why), APC_ERANGE);
    assert_has(why.text, "none of 1000 draws of the plant's parameter A1 lay within its limits");
    struct simulation s;
    assert_int_equal(simulation_create(&s, &e, 1, &why), APC_ERANGE);
    simulation_destroy(&s);
    experiment_free(&e);
}

/* Promise(links/variable-fmu-name) */
static void parameters_stand_in_a_group_or_a_list(void **state)
{
    static const struct {
        const char *value, *reason; /* reason NULL: it is taken */
    } of[] = {
        {"{ A1 = 30.0; A2 = 31.0; }", NULL},
        {"( { name = \"A1\"; value = 30.0; }, { value = 31.0; name = \"A2\"; } )", NULL},
        {"( { name = \"A1\"; value = \"uniform(29, 31)\"; }, { name = \"A2\"; value = 31.0; } )", NULL},
        {"( { name = \"A1\"; value = 30.0; }, { name = \"A1\"; value = 31.0; } )", "\"A1\" is there twice"},
        {"( { name = \"A1\"; } )", "expected a group: { name = \"...\"; value = ...; }"},
        {"( { value = 1.0; } )", "expected a group: { name"},
        {"( { name = 1; value = 1.0; } )", "expected a group: { name"},
        {"( 1.0 )", "expected a group: { name"},
        {"( { name = \"A1\"; value = 30.0; unit = \"m\"; } )", "unknown setting \"unit\""},
        {"( { name = \"A1\"; value = true; } )", "\"A1\" is \"true\": must be a number"},
        {"( { name = \"tank.A1\"; value = 1.0; } )", "has no parameter \"tank.A1\""},
        {"7", "\"parameters\" must be a group: parameters = { NAME = VALUE; }, or a list"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        const struct experiment_setting set = {"plant.parameters", of[i].value};
        const int rc = try_set(&e, &set, 1);
        if ((rc == 0) != !of[i].reason)
            fail_msg("%s: %s", of[i].value, rc < 0 ? why.text : "is taken");
        if (rc < 0) {
            assert_has(why.text, of[i].reason);
            continue;
        }
        assert_near(e.plant.p[at(&e, "A1")], 30.0, 0);
        assert_near(e.plant.p[at(&e, "A2")], 31.0, 0);
        experiment_free(&e);
    }
}

static void process_noise_stands_in_a_list_as_well(void **state)
{
    struct experiment e;
    (void)state;
    load(&e, &(struct experiment_setting){"plant.noise", "( { name = \"h2\"; value = 0.25; } )"}, 1);
    assert_near(e.plant.noise[1], 0.25, 0);
    experiment_free(&e);
}

static void the_number_that_is_there_is_told(void **state)
{
    static const struct {
        const char *path;
        double value;
    } number[] = {{"duration", 12},
                  {"controllers.base.period", 2},
                  {"controllers.base.v2.u_max", 9},
                  {"controllers.base.v1.tau_b", 10},
                  {"controllers.base.operating_point.u.[1]", 3},
                  {"plant.parameters.A1", 28},
                  {"plant.parameters.A2", 25}};
    static const struct {
        const char *path, *reason;
    } none[] = {{"name", "name is text, \"world\": only a number goes"},
                {"plant", "plant is no number"},
                {"controllers.base.v3.u_max", "did you mean \"v1\"?"}};
    struct experiment e;
    double value;
    (void)state;
    load(&e, &(struct experiment_setting){"plant.parameters.A2", "uniform(20, 30)"}, 1);
    for (size_t i = 0; i < sizeof number / sizeof *number; i++) {
        if (experiment_value(&e, number[i].path, &value, &why) < 0)
            fail_msg("%s", why.text);
        if (fabs(value - number[i].value) > 0)
            fail_msg("%s: %g", number[i].path, value);
    }
    assert_int_equal(experiment_value(&e, "controllers.base.hold", &value, &why), 0);
    assert_true(isnan(value)); /* the file does not say it, nor does the law */
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        assert_true(experiment_value(&e, none[i].path, &value, &why) < 0);
        assert_has(why.text, none[i].reason);
    }
    experiment_free(&e);
}

/* All of what stands in the file for itself, so that it can be pasted there. */
static void what_holds_a_setting_is_told_as_a_line(void **state)
{
    static const struct {
        const char *path, *line;
    } of[] = {
        {"duration", "duration = 12.0;"},
        {"plant.period", "period = 0.5;"},
        {"controllers.base.period", "period = 2.0;"},
        {"controllers.base.v2.u_max", "tuning = ( { u_max = 10.0; }, { u_max = 9.0; } );"},
        {"controllers.base.operating_point.u", "operating_point = { u = [ 3.0, 3.0 ]; };"},
    };
    struct experiment e;
    char *line;
    (void)state;
    load(&e, NULL, 0);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        if (experiment_line(&e, of[i].path, &line, &why) < 0)
            fail_msg("%s", why.text);
        char plain[200] = "", *to = plain; /* however it is spaced */
        for (const char *from = line; *from; from++)
            if (*from != ' ' && *from != '\n')
                *to++ = *from;
        char expected[200] = "";
        to = expected;
        for (const char *from = of[i].line; *from; from++)
            if (*from != ' ')
                *to++ = *from;
        assert_string_equal(plain, expected);
        free(line);
    }
    assert_int_equal(experiment_line(&e, "plant.parameters.A1", &line, &why), APC_ENOTFOUND);
    assert_string_equal(why.text, "plant.parameters.A1: is not in the file");
    assert_null(line);
    assert_int_equal(experiment_line(&e, "controllers.bse.period", &line, &why), APC_ENOTFOUND);
    assert_has(why.text, "did you mean \"base\"?");
    experiment_free(&e);
}

/* The file is written anew, with one place changed; each change goes on from the one before. */
/* Promise(links/variable-fmu-name) */
static void what_is_set_goes_where_it_belongs(void **state)
{
    static const struct {
        const char *path, *value, *written;
    } changes[] = {
        {"controllers.c.y2.y_max", "7", "measurement_tuning = ({ }, { y_max = 7; });"},
        {"controllers.c.y1.y_max", "-8.5", "measurement_tuning = ({ y_max = -8.5; }, { y_max = 7; });"},
        {"controllers.c.y2.y_max", "9", "measurement_tuning = ({ y_max = -8.5; }, { y_max = 9; });"},
        {"controllers.c.u.du", "3", " tuning = ({ du = 3; });"},
        {"controllers.c.ru", "4", " tuning = ({ du = 3; ru = 4; });"}, /* there is one output only */
        {"controllers.[0].period", "2.0", "period = 2.0;"},
        {"title", "two words", "title = \"two words\";"},
        {"title", "\"a\\n\\\"b\\\\\"", "title = \"a\\x0a\\\"b\\\\\";"},
        {"seed", "5000000000", "seed = 5000000000"}, /* beyond 32 bits */
        {"seed", "5000000001L", "seed = 5000000001L;"},
        {"plant.external", "true", "plant = { external = true; };"},
        {"levels.[1]", "5", "levels = [1.5, 5.0];"}, /* of numbers with points */
        {"clients.[0]", "a", "clients = [\"a\", \"d\"];"},
        {"plant.parameters.K", "1e3", "parameters = { K = 1000.0; };"},
        {"plant.parameters.tank.x[1,2]", "2", /* a name that no member can have */
         "parameters = ({ name = \"K\"; value = 1000.0; }, { name = \"tank.x[1,2]\"; value = 2; });"},
        {"plant.parameters.tank.x[1,2]", "3.5", "{ name = \"tank.x[1,2]\"; value = 3.5; });"},
        {"plant.parameters.K", "4", "parameters = ({ name = \"K\"; value = 4; }, {"},
        {"plant.parameters.'a \"b\\c'", "1", "{ name = \"'a \\\"b\\\\c'\"; value = 1; });"},
        {"plant.parameters.value", "5", "{ name = \"value\"; value = 5; });"},
        {"plant.noise._h", "0.5", "noise = ({ name = \"_h\"; value = 0.5; });"},
        {"plant.noise", "{ }", "noise = { };"},
        {"plant.noise.2nd.h", "0.5", "noise = ({ name = \"2nd.h\"; value = 0.5; });"},
        {"controllers.c.operating_point.parameters.tank.K", "2",
         "operating_point = { parameters = ({ name = \"tank.K\"; value = 2; }); };"},
    };
    static const struct {
        const char *path, *reason;
    } none[] = {
        {"", "\"\": there is no \"\" in the file; there are title, levels, plant, clients"},
        {"levels.[2]", "levels.[2]: there is no \"[2]\" in levels; there are [0] to [1]"},
        {"clients.x", "clients.x: there is no \"x\" in clients; there are a, d"},
        {"controllers.d.period", "there is no \"d\" in controllers; there are c"},
        {"controllers.c.y3.y_max", "there is no \"y3\" in controllers.c; there are u"},
        {"controllers.c.y1.y max", "there is no"},
        {"plant.a b", "there is no \"a b\" in plant"},
        {"title.x", "there is no \"x\" in title"},
        {"controller.period", "there is no \"controller\" in the file"},
    };
    char *text = strdup("title = \"\"; levels = [ 1.5, 2.5 ]; plant = { };\n"
                        "clients = [\"c\", \"d\"];\n"
                        "controllers = ( { name = \"c\"; law = \"mpc\"; period = 1.0;\n"
                        "  measurements = [\"y1\", \"y2\"]; outputs = [\"u\"]; } );\n"),
         *next;
    (void)state;
    assert_non_null(text);
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        if (experiment_change(text, changes[i].path, changes[i].value, &next, &why) < 0)
            fail_msg("%s: %s", changes[i].path, why.text);
        assert_has(next, changes[i].written);
        free(text);
        text = next;
    }
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        if (experiment_change(text, none[i].path, "1", &next, &why) >= 0)
            fail_msg("%s is set", none[i].path);
        assert_null(next);
        assert_has(why.text, none[i].reason);
    }
    assert_int_equal(experiment_remove(text, "plant.noise", NULL, &next, &why), 0);
    assert_has(text, "noise = ");
    assert_null(strstr(next, "noise"));
    assert_has(next, "name = \"value\"; value = 5;");
    free(text);
    assert_int_equal(experiment_remove(next, "clients.[0]", NULL, &text, &why), 0);
    assert_has(text, "clients = [\"d\"];");
    free(next);
    assert_int_equal(experiment_remove(text, "plant.nothing", NULL, &next, &why), 0); /* there is none */
    assert_string_equal(next, text);
    free(next);
    assert_int_equal(experiment_remove(text, "title.x", NULL, &next, &why), APC_ENOTFOUND);
    assert_null(next);
    assert_has(why.text, "there is no \"x\" in title");
    free(text);
}

/* ---- Without memory ------------------------------------------------------------------------------- */

static bool no_stream;

/* In place of the C library's. */
__attribute__((visibility("default"))) FILE *open_memstream(char **text, size_t *size)
{
    FILE *(*own)(char **, size_t *);
    void *const found = dlsym(RTLD_NEXT, "open_memstream");
    memcpy(&own, &found, sizeof own);
    return no_stream ? NULL : own(text, size);
}

static void no_memory_for_a_text_is_said(void **state)
{
    static const char *const paths[] = {"duration", "controllers.base.v1.backup.Kp"};
    struct experiment e;
    double value;
    (void)state;
    load(&e, &(struct experiment_setting){"controllers.base.backup.law", "pid"}, 1);
    no_stream = true;
    for (size_t i = 0; i < 2; i++) {
        char *text = e.text;
        why.text[0] = '\0';
        assert_int_equal(experiment_line(&e, paths[i], &text, &why), APC_ENOMEM);
        assert_null(text);
        assert_string_equal(why.text, "out of memory");
        text = e.text;
        why.text[0] = '\0';
        assert_int_equal(experiment_change(e.text, paths[i], "1", &text, &why), APC_ENOMEM);
        assert_null(text);
        assert_string_equal(why.text, "out of memory");
    }
    why.text[0] = '\0';
    assert_int_equal(experiment_value(&e, paths[1], &value, &why), APC_ENOMEM);
    assert_string_equal(why.text, "out of memory");
    no_stream = false;
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_number_with_zeros_before_it_is_decimal_on_whatever_machine_it_was_written),
        cmocka_unit_test(later_settings_hold_over_former_ones_and_over_the_file),
        cmocka_unit_test(a_former_name_of_a_law_s_setting_is_taken_unless_the_present_one_is_there_too),
        cmocka_unit_test(the_backup_laws_tuning_is_set_by_the_name_of_its_output),
        cmocka_unit_test(what_is_wrong_is_said_of_what_was_set_or_of_the_file),
        cmocka_unit_test(a_setting_of_a_law_or_model_that_is_not_there_is_refused),
        cmocka_unit_test(what_begins_as_a_list_and_is_none_is_refused),
        cmocka_unit_test(a_parameter_is_drawn_for_each_seed_and_the_law_has_its_mean),
        cmocka_unit_test(the_plant_runs_with_what_was_drawn),
        cmocka_unit_test(a_draw_keeps_to_the_parameter_s_limits_or_is_refused),
        cmocka_unit_test(parameters_stand_in_a_group_or_a_list),
        cmocka_unit_test(process_noise_stands_in_a_list_as_well),
        cmocka_unit_test(the_number_that_is_there_is_told),
        cmocka_unit_test(what_holds_a_setting_is_told_as_a_line),
        cmocka_unit_test(what_is_set_goes_where_it_belongs),
        cmocka_unit_test(no_memory_for_a_text_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
