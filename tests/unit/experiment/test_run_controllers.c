/* SPDX-License-Identifier: BSD-3-Clause */
/* Several controllers in one file: who has which signals, and what cannot be, with its line. */
#include <glob.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#include "experiment/experiment.h"
#include "figures/figures.h"
#include "operate/operate.h"
#include "record/record.h"

/* Two layers over the quadruple tank, as lines 1 to 9. */
static const char *const good[] = {
    "name = \"layers\"; duration = 60.0;",
    "measurements = ( { name = \"y1\"; }, { name = \"y2\"; } );",
    "setpoints = ( { name = \"r1\"; low = 0.0; high = 10.0; initial = 6.0; }, "
    "{ name = \"r2\"; initial = 6.5; }, { name = \"w1\"; initial = 6.0; }, { name = \"w2\"; }, { name = "
    "\"w3\"; } );",
    "outputs = ( { name = \"v1\"; low = 0.0; high = 10.0; }, { name = \"v2\"; low = 0.0; high = 10.0; } );",
    "plant = { model = \"quadruple-tank\"; period = 0.1; }; client = { period = 0.1; };",
    "controllers = (",
    " { name = \"base\"; law = \"pi\"; period = 0.5; mode = \"Cas\"; measurements = [\"y1\", \"y2\"]; "
    "setpoints = "
    "[\"r1\", \"r2\"]; outputs = [\"v1\", \"v2\"]; },",
    " { name = \"upper\"; law = \"pi\"; period = 5.0; measurements = [\"y2\", \"y1\"]; setpoints = [\"w2\", "
    "\"w1\"]; "
    "outputs = [\"r2\", \"r1\"]; } );",
    "scheduler = { period = 20.0; sequence = ( [6.0, 6.5, 1.0], [7.0, 6.5, 1.0] ); };"};
#define LINES (sizeof good / sizeof *good)

static int parse_with(struct experiment *e, size_t line, const char *instead, const char *law,
                      struct apc_error *why)
{
    const struct experiment_overrides overrides = {.law = law};
    char text[4000] = "";
    for (size_t i = 0; i < LINES; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s\n", i + 1 == line ? instead : good[i]);
    return experiment_parse(e, &(struct experiment_source){.file = "layers.conf", .text = text},
                            EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, why);
}

static int parse(struct experiment *e, size_t line, const char *instead, struct apc_error *why)
{
    return parse_with(e, line, instead, NULL, why);
}

static void assert_wire(struct wire w, enum apc_table table, size_t at)
{
    assert_int_equal(w.table, table);
    assert_int_equal(w.at, at);
}

/*
 * Promise(experiment/several-controllers): Several controllers: the signals of each, one owner of an
 *   output, no circles, each mistake with its line; one in either form; `--law` says whose.
 */
static void each_controller_has_its_own_signals(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.n_controllers, 2);
    const struct controller *base = &e.controllers[0], *upper = &e.controllers[1];
    assert_string_equal(base->name, "base");
    assert_string_equal(upper->name, "upper");
    assert_int_equal(base->rhythm.period, APC_NS_PER_S / 2);
    assert_int_equal(upper->rhythm.period, 5 * APC_NS_PER_S);
    assert_int_equal(base->dim.ny + base->dim.nz + base->dim.nu, 6);
    assert_wire(base->y[1], APC_SENSOR, 1);
    assert_wire(base->z[0], APC_SETPOINT, 0);
    assert_wire(base->u[1], APC_ACTUATOR, 1);
    assert_wire(upper->y[0], APC_SENSOR, 1);
    assert_wire(upper->z[0], APC_SETPOINT, 3);
    assert_wire(upper->u[0], APC_SETPOINT, 1);
    assert_ptr_equal(controllers_taker(&e, upper->u[0]), base);
    assert_null(controllers_taker(&e, (struct wire){APC_SETPOINT, 9}));
    /* the scheduler moves what no controller does */
    assert_int_equal(e.scheduler.n, 3);
    assert_wire(e.scheduler.z[0], APC_SETPOINT, 2);
    assert_wire(e.scheduler.z[2], APC_SETPOINT, 4);
    assert_near(e.z[0].initial, 6.0, 0);
    assert_true(isnan(e.z[3].initial));
    experiment_free(&e);
}

static const struct apc_tag *tag_of(const struct apc_tag *tags, size_t n, enum apc_table table, int id)
{
    for (size_t i = 0; i < n; i++)
        if (tags[i].table == table && tags[i].id == id)
            return &tags[i];
    fail_msg("%s %d is not described", apc_table_name(table), id);
    return NULL;
}

static void assert_tag(const struct apc_tag *tags, size_t n, enum apc_table table, int id, const char *name,
                       const char *controller)
{
    assert_string_equal(tag_of(tags, n, table, id)->name, name);
    assert_string_equal(tag_of(tags, n, table, id)->controller, controller);
}

/* One that a drawing may mean: a signal by its name, or TABLE.ID. */
static bool is_tagged(const struct apc_tag *t, size_t n, const char *name)
{
    char number[APC_TAG_LEN];
    for (size_t i = 0; i < n; i++) {
        snprintf(number, sizeof number, "%s.%d", apc_table_name(t[i].table), t[i].id);
        if (!strcmp(t[i].name, name) || !strcmp(number, name))
            return true;
    }
    return false;
}

static void check_drawing(const char *svg, const struct apc_tag *t, size_t n)
{
    static char text[100000];
    FILE *file = fopen(svg, "r");
    assert_non_null(file);
    text[fread(text, 1, sizeof text - 1, file)] = '\0';
    fclose(file);
    size_t named = 0;
    for (char *at = text; (at = strstr(at, "data-apc=\"")); named++) {
        at += strlen("data-apc=\"");
        char *end = strchr(at, '"');
        assert_non_null(end);
        *end = '\0';
        if (!is_tagged(t, n, at))
            fail_msg("%s names \"%s\", which its experiment has not", svg, at);
        at = end + 1;
    }
    assert_true(named > 5);
}

static void the_drawings_that_come_along_name_signals_of_their_experiments(void **state)
{
    glob_t found;
    (void)state;
    assert_int_equal(glob(APC_SOURCE_DIR "/experiments/*.svg", 0, NULL, &found), 0);
    assert_int_equal(glob(APC_SOURCE_DIR "/experiments/alarms/*.svg", GLOB_APPEND, NULL, &found), 0);
    for (size_t i = 0; i < found.gl_pathc; i++) {
        const char *svg = found.gl_pathv[i];
        struct experiment e;
        struct apc_error why;
        char path[500];
        size_t n = 0;
        snprintf(path, sizeof path, "%.*s.conf", (int)(strlen(svg) - strlen(".svg")), svg);
        if (experiment_load(&e, path, EXPERIMENT_LAW, NULL, &why) < 0)
            fail_msg("%s", why.text);
        struct apc_tag *t = provision_tags(&e, &n);
        assert_non_null(t);
        check_drawing(svg, t, n);
        free(t);
        experiment_free(&e);
    }
    assert_true(found.gl_pathc > 10);
    globfree(&found);
}

static void assert_units(const char *y_unit, const char *u_unit, const char *const expected[12])
{
    static const char *const name[] = {
        "move_suppression", "reference_weight", "reference", "cost",    "u_min",   "u_max",
        "du_max",           "y.weight",         "y.zone",    "y.y_min", "y.y_max", "y.service"};
    struct experiment e;
    struct apc_error why;
    char text[800];
    size_t n = 0;
    snprintf(text, sizeof text,
             "name = \"units\"; measurements = ( { name = \"y\"; unit = \"%s\"; } ); setpoints = ( { name = "
             "\"r\"; } ); outputs = ( { name = \"u\"; unit = \"%s\"; low = 0.0; high = 10.0; } );\n"
             "plant = { model = \"first-order\"; period = 0.2; }; client = { period = 0.5; };\n"
             "controller = { law = \"mpc\"; period = 2.0; operating_point = { u = [1.0]; }; };\n",
             y_unit, u_unit);
    if (experiment_parse(&e, &(struct experiment_source){.file = "units.conf", .text = text}, EXPERIMENT_LAW,
                         NULL, &why) < 0)
        fail_msg("%s", why.text);
    struct apc_tag *t = provision_tags(&e, &n);
    assert_non_null(t);
    for (size_t i = 0; i < sizeof name / sizeof *name; i++) {
        const struct apc_tag *tag = tag_of(t, n, APC_TUNING, 1 + (int)i);
        assert_string_equal(tag->name, name[i]);
        assert_string_equal(tag->unit, expected[i]);
    }
    free(t);
    experiment_free(&e);
}

static void tuning_has_the_units_of_the_signals_that_it_is_for(void **state)
{
    (void)state;
    assert_units("cm", "V",
                 (const char *const[]){"1", "1", "V", "1/V", "V", "V", "V/s", "1", "cm", "cm", "cm", "1"});
    assert_units("", "", (const char *const[]){"1", "1", "1", "1", "1", "1", "1/s", "1", "1", "1", "1", "1"});
    assert_units("cm", "cm3/s",
                 (const char *const[]){"1", "1", "cm3/s", "1/(cm3/s)", "cm3/s", "cm3/s", "cm3/s/s", "1", "cm",
                                       "cm", "cm", "1"});
}

static void loops_are_described_by_their_controllers_and_numbered_in_the_order_of_the_file(void **state)
{
    struct experiment e;
    struct apc_error why;
    size_t n = 0;
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    struct apc_tag *t = provision_tags(&e, &n);
    assert_non_null(t);
    assert_tag(t, n, APC_OPMODE, 1, "v1", "base");
    assert_tag(t, n, APC_OPMODE, 2, "v2", "base");
    assert_tag(t, n, APC_OPMODE, 3, "upper.r2", "upper");
    assert_tag(t, n, APC_OPMODE, 4, "upper.r1", "upper");
    assert_tag(t, n, APC_OPMODE, 0, "mode", "");
    assert_tag(t, n, APC_ACTUAL, apc_variable_number(APC_OPMODE, 3), "upper.r2.mode.actual", "upper");
    assert_tag(t, n, APC_MANUAL, 1, "v1.manual", "base");
    assert_tag(t, n, APC_MANUAL, 3, "upper.r2.manual", "upper");
    assert_near(tag_of(t, n, APC_MANUAL, 4)->high, 10.0, 0); /* as its output's */
    assert_tag(t, n, APC_TUNING, 1, "v1.Kp", "base");
    assert_tag(t, n, APC_TICK, 1, "base", "base");
    assert_tag(t, n, APC_TICK, 2, "upper", "upper");
    assert_near(tag_of(t, n, APC_TICK, 2)->period, 5.0, 0);
    const int upper = 1 + (int)apc_law_parameters(e.controllers[0].law, &e.controllers[0].dim);
    assert_tag(t, n, APC_TUNING, upper, "upper.r2.Kp", "upper");
    assert_tag(t, n, APC_SENSOR, 1, "y1", "");
    assert_near(tag_of(t, n, APC_SENSOR, 1)->period, 0.1, 0);
    assert_tag(t, n, APC_SETPOINT, 1, "r1", "base");
    assert_tag(t, n, APC_SETPOINT, 3, "w1", "upper");
    assert_tag(t, n, APC_SETPOINT, 5, "w3", "");
    assert_tag(t, n, APC_ACTUATOR, 1, "v1", "base");
    free(t);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void a_law_instead_of_the_files_says_whose_it_is(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (parse_with(&e, 0, NULL, "upper=pid", &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.controllers[1].law->name, "pid");
    assert_true(e.controllers[1].plugin.chosen);
    assert_false(e.controllers[0].plugin.chosen);
    experiment_free(&e);
    assert_int_equal(parse_with(&e, 0, NULL, "pid", &why), APC_EINVAL);
    assert_string_equal(why.text,
                        "--law pid: there are several controllers: say whose law it is, as in --law "
                        "base=pid (base, upper)");
    assert_int_equal(parse_with(&e, 0, NULL, "bse=./my.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "--law base=./my.so"));
    assert_int_equal(parse_with(&e, 0, NULL, "base=magic", &why), APC_ENOTFOUND);
}

static void assert_newest(struct apc_store *store, enum apc_table table, int id, double value, int64_t seq)
{
    struct apc_sample s = {.table = table, .id = id};
    assert_int_equal(apc_store_read(store, &s, 1), 0);
    assert_near(s.value, value, 0);
    assert_int_equal(s.seq, seq);
}

static void each_loop_gets_its_own_target_and_what_it_controls(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct apc_store *store = NULL;
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0 || apc_store_open(&store, "mem:", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_init(store) >= 0);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    assert_newest(store, APC_SETPOINT, 1, 6.0, 1);
    const double mode[] = {APC_MODE_CAS, APC_MODE_CAS, APC_MODE_CAS, APC_MODE_AUTO, APC_MODE_AUTO};
    for (int i = 0; i < 5; i++)
        assert_newest(store, APC_OPMODE, i, mode[i], 1);
    /* loop 4, upper.r1, controls y1 to w1 */
    assert_newest(store, APC_DIM, 3, 2, 1);
    assert_newest(store, APC_DIM, 10, 1, 1);
    assert_newest(store, APC_DIM, 11, 3, 1);
    /* what is there stays, unless it is to be as in the file */
    struct apc_sample man = {.table = APC_OPMODE, .id = 4, .value = APC_MODE_MAN};
    assert_int_equal(apc_store_put(store, &man, 1), 0);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    assert_newest(store, APC_OPMODE, 4, APC_MODE_MAN, 2);
    assert_int_equal(provision(store, &e, PROVISION_RESET), 0);
    assert_newest(store, APC_OPMODE, 4, APC_MODE_AUTO, 3);
    assert_newest(store, APC_OPMODE, 3, APC_MODE_AUTO, 1);
    apc_store_close(store);
    experiment_free(&e);
}

/* Who has the file and who has its store see the same loops. */
static void what_the_file_says_of_its_loops_is_what_its_store_says(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct apc_store *store = NULL;
    struct apc_tag tag[100];
    struct loops file, stored;
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0 || apc_store_open(&store, "mem:", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_init(store) >= 0);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    const int n = apc_store_get_tags(store, tag, 100);
    assert_in_range(n, 1, 100);
    assert_int_equal(controllers_describe(&e, &file), 0);
    assert_int_equal(loops_load(&stored, store, tag, (size_t)n), 0);
    assert_int_equal(file.n, 4);
    assert_int_equal(stored.n, 4);
    assert_int_equal(file.n_controllers, 2);
    for (size_t i = 0; i < 4; i++) {
        assert_string_equal(file.at[i].name, stored.at[i].name);
        assert_int_equal(file.at[i].id, stored.at[i].id);
        assert_int_equal(file.at[i].manual, stored.at[i].manual);
        assert_int_equal(file.at[i].controller, stored.at[i].controller);
        assert_int_equal(file.at[i].table, stored.at[i].table);
        assert_int_equal(file.at[i].output, stored.at[i].output);
        assert_int_equal(file.at[i].measurement, stored.at[i].measurement);
        assert_int_equal(file.at[i].setpoint, stored.at[i].setpoint);
        assert_int_equal(file.at[i].above, stored.at[i].above);
    }
    assert_int_equal(file.at[0].above, 3); /* r1 is upper's second output */
    assert_int_equal(file.at[3].above, -1);
    loops_free(&file);
    loops_free(&stored);
    apc_store_close(store);
    experiment_free(&e);
}

/* Where nobody has its law, outputs go with measurements and setpoints in order, as far as there are some. */
static void loops_of_a_law_that_is_not_there_are_paired_in_order(void **state)
{
    struct experiment e;
    struct apc_error why;
    struct loops loops;
    char text[4000] = "";
    (void)state;
    for (size_t i = 0; i < LINES; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s\n",
                 i + 1 == 7
                     ? " { name = \"base\"; law = \"./gone.so\"; period = 0.5; measurements = [\"y2\"]; "
                       "setpoints = [\"r1\", \"r2\"]; outputs = [\"v1\", \"v2\"]; },"
                     : good[i]);
    if (experiment_parse(&e, &(struct experiment_source){.file = "layers.conf", .text = text}, 0, NULL,
                         &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(controllers_describe(&e, &loops), 0);
    assert_int_equal(loops.at[0].measurement, 2);
    assert_int_equal(loops.at[0].setpoint, 1);
    assert_int_equal(loops.at[1].measurement, 0);
    assert_int_equal(loops.at[1].setpoint, 2);
    loops_free(&loops);
    experiment_free(&e);
}

/* What two outputs do for one thing is judged once. */
static void what_is_controlled_twice_is_judged_once(void **state)
{
    struct experiment e;
    struct loop loop[4];
    struct apc_error why;
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(metrics_loops(&e, loop), 4);
    experiment_free(&e);
    if (parse(
            &e, 8,
            " { name = \"upper\"; law = \"pid\"; period = 5.0; measurements = [\"y2\", \"y1\"]; setpoints = "
            "[\"w2\", \"w1\"]; outputs = [\"r2\", \"r1\"]; settings = { measurement = [1, 1]; setpoint = "
            "[1, 1]; }; } );",
            &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(metrics_loops(&e, loop), 3);
    assert_string_equal(loop[2].name, "upper.r2");
    experiment_free(&e);
}

/* Measurements stay away for longer than the plant bears it: from then on there was no control. */
static void without_measurements_there_was_no_control(void **state)
{
    static const double measured[] = {0.0, 0.1, 0.2, 0.3, 1.5}, put_out[] = {0.0, 0.5, 1.0, 1.5};
    struct apc_sample at[20];
    struct samples samples = {.at = at};
    struct experiment e;
    struct apc_error why;
    struct trajectory c = {0};
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    for (int ms = 0; ms <= 1500; ms += 100) {
        const double t = 0.001 * ms;
        for (size_t i = 0; i < sizeof measured / sizeof *measured; i++)
            if (fabs(measured[i] - t) < 1e-9)
                at[samples.n++] = (struct apc_sample){
                    .table = APC_SENSOR, .id = 1, .time = ms * APC_NS_PER_MS, .seq = ms / 100 + 1};
        for (size_t i = 0; i < 2 * sizeof put_out / sizeof *put_out; i++)
            if (fabs(put_out[i / 2] - t) < 1e-9)
                at[samples.n++] = (struct apc_sample){.table = APC_ACTUATOR,
                                                      .id = (int)(i % 2) + 1,
                                                      .time = ms * APC_NS_PER_MS,
                                                      .seq = ms / 100 + 1};
    }
    assert_int_equal(trajectory_of_samples(&c, &samples, &e, 0), 0);
    assert_int_equal(c.without.n, 4); /* the first two are of the beginning */
    assert_near(c.without.at[2].t, 0.3 + 0.4, 1e-9);
    assert_near(c.without.at[2].value, 1.0, 0.0);
    assert_near(c.without.at[3].t, 1.5, 1e-9);
    assert_near(c.without.at[3].value, 0.0, 0.0);
    trajectory_free(&c);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void each_controller_has_a_law_of_its_own(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (parse(&e, 8,
              " { name = \"upper\"; law = \"pid\"; period = 5.0; phase = 0.5; mode = \"Man\"; hold = 30.0; "
              "measurements = [\"y2\", \"y1\"]; setpoints = [\"w2\", \"w1\"]; outputs = [\"r2\", \"r1\"]; "
              "tuning = ( { Kp = 7.0; }, { } ); limits = { Kp = [0.0, 9.0]; }; settings = { measurement = "
              "[2.0, "
              "1.0]; }; } );",
              &why) < 0)
        fail_msg("%s", why.text);
    const struct controller *base = &e.controllers[0], *upper = &e.controllers[1];
    assert_string_equal(base->law->name, "pi");
    assert_string_equal(upper->law->name, "pid");
    assert_int_equal(base->mode, APC_MODE_CAS);
    assert_int_equal(upper->mode, APC_MODE_MAN);
    assert_int_equal(upper->hold, 30 * APC_NS_PER_S);
    assert_int_equal(base->hold, 3 * APC_NS_PER_S / 2);
    assert_int_equal(upper->rhythm.phase, APC_NS_PER_S / 2);
    assert_near(upper->tuning[0], 7.0, 0);
    assert_near(base->tuning[0], base->law->tuning[0].initial, 0);
    assert_near(upper->param[0].high, 9.0, 0);
    assert_int_equal(upper->n_setting, 1);
    assert_int_equal(base->n_setting, 0);
    assert_int_equal(module_command_period(&e), APC_NS_PER_S / 2); /* upper commands nobody */
    experiment_free(&e);
}

static void assert_loop(struct controller_loop loop, const struct controller *of, size_t u)
{
    assert_ptr_equal(loop.of, of);
    assert_int_equal(loop.u, u);
}

static void loops_and_tuning_are_numbered_over_all_controllers(void **state)
{
    struct experiment e;
    struct apc_error why;
    char name[APC_TAG_LEN];
    (void)state;
    if (parse(&e, 0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    const struct controller *base = &e.controllers[0], *upper = &e.controllers[1];
    assert_int_equal(base->number, 1);
    assert_int_equal(upper->number, 2);
    assert_int_equal(base->first_loop, 1);
    assert_int_equal(upper->first_loop, 3);
    assert_int_equal(base->first_tuning, 1);
    assert_int_equal(upper->first_tuning, 1 + apc_law_parameters(base->law, &base->dim));
    assert_int_equal(controllers_loops(&e), 4);
    assert_loop(controllers_loop(&e, 1), base, 1);
    assert_loop(controllers_loop(&e, 2), upper, 0);
    /* upper moves r2 first, by its outputs; base has r1 first, by its law */
    assert_loop(controllers_above(&e, (struct wire){APC_SETPOINT, 1}), upper, 0);
    assert_loop(controllers_below(&e, (struct wire){APC_SETPOINT, 1}), base, 1);
    assert_null(controllers_above(&e, (struct wire){APC_SETPOINT, 2}).of);
    assert_true(controllers_is_below(&e, controllers_loop(&e, 0)));
    assert_false(controllers_is_below(&e, controllers_loop(&e, 2)));
    assert_int_equal(controllers_loop_id(controllers_loop(&e, 3)), 4);
    controllers_loop_name(&e, controllers_loop(&e, 1), name);
    assert_string_equal(name, "v2");
    controllers_loop_name(&e, controllers_loop(&e, 2), name);
    assert_string_equal(name, "upper.r2");
    /* who stands above ticks before */
    assert_int_equal(base->depth, 1);
    assert_int_equal(upper->depth, 0);
    assert_int_equal(upper->rhythm.phase, 30 * APC_NS_PER_MS);
    assert_int_equal(base->rhythm.phase, 40 * APC_NS_PER_MS);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void a_controller_may_calculate_what_another_one_measures(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (parse(&e, 8,
              " { name = \"sum\"; law = \"pi\"; period = 1.0; measurements = [\"y1\"]; setpoints = [\"w1\"]; "
              "outputs = "
              "[\"x\"]; }, { name = \"upper\"; law = \"pi\"; period = 5.0; measurements = [\"x\", \"y1\"]; "
              "setpoints = "
              "[\"w2\", \"w3\"]; outputs = [\"r2\", \"r1\"]; disturbances = [\"y2\"]; } ); signals = ( { "
              "name = "
              "\"x\"; } );",
              &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.dim.ny, 2);
    assert_int_equal(e.n_signals, 1);
    assert_int_equal(e.y[2].tag.table, APC_SENSOR);
    assert_int_equal(e.y[2].tag.id, 3); /* behind the measurements */
    assert_wire(e.controllers[1].u[0], APC_SENSOR, 2);
    assert_wire(e.controllers[2].y[0], APC_SENSOR, 2);
    assert_int_equal(e.controllers[2].dim.nd, 1);
    assert_wire(e.controllers[2].d[0], APC_SENSOR, 1);
    struct apc_store *store = NULL;
    char whose[PROVISION_TEXT] = "";
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0);
    assert_int_equal(provision(store, &e, PROVISION_KEEP), 0);
    if (provision_check(store, &e, whose) != 0) /* its own store, what is calculated and all */
        fail_msg("%s", whose);
    e.n_signals = 0;
    assert_int_equal(provision_check(store, &e, whose), APC_EPERM);
    assert_non_null(strstr(whose, "its sensor.3 is \"x\" []"));
    e.n_signals = 1;
    apc_store_close(store);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void the_short_form_is_one_controller_of_all(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (experiment_load(&e, APC_SOURCE_DIR "/experiments/quadruple-tank.conf", EXPERIMENT_LAW, NULL, &why) <
        0)
        fail_msg("%s", why.text);
    assert_int_equal(e.n_controllers, 1);
    assert_string_equal(e.controllers[0].name, "controller");
    assert_int_equal(e.controllers[0].dim.ny, e.dim.ny);
    assert_wire(e.controllers[0].u[1], APC_ACTUATOR, 1);
    assert_int_equal(e.controllers[0].rhythm.period, e.controllers->rhythm.period);
    assert_int_equal(e.scheduler.n, e.dim.nz);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void one_in_the_long_form_is_the_same(void **state)
{
    struct experiment e;
    struct apc_error why;
    char text[2000];
    (void)state;
    static const char *const orders[] = {"[\"y1\", \"y2\"]", "[\"y2\", \"y1\"]"};
    for (int k = 0; k < 2; k++) {
        snprintf(
            text, sizeof text,
            "name = \"one\"; measurements = ( { name = \"y1\"; }, { name = \"y2\"; } );"
            "setpoints = ( { name = \"r1\"; }, { name = \"r2\"; } ); outputs = ( { name = \"v1\"; }, { name "
            "= "
            "\"v2\"; } ); plant = { model = \"quadruple-tank\"; period = 0.1; }; client = { period = 0.1; };"
            "controllers = ( { name = \"only\"; law = \"pi\"; period = 1.0; measurements = %s; setpoints = "
            "[\"r1\", \"r2\"]; outputs = [\"v1\", \"v2\"]; tuning = ( { Kp = 3.0; }, { Kp = 4.0; } ); } );"
            "scheduler = { period = 20.0; sequence = ( [1.0] ); setpoints = [\"r2\"]; };"
            "actions = ( { at = 1.0; mode = \"only\"; value = \"Man\"; } );",
            orders[k]);
        if (experiment_parse(&e, &(struct experiment_source){.file = "one.conf", .text = text},
                             EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(e.n_controllers, 1);
        assert_int_equal(e.scheduler.n, 1);
        assert_wire(e.scheduler.z[0], APC_SETPOINT, 1);
        if (k == 0) {
            assert_near(e.controllers->tuning[0], 3.0, 0);
            assert_int_equal(e.n_actions, 1);
        }
        experiment_free(&e);
    }
}

/* The second sensor of the plant measures what disturbs it: the law's model says how that acts. */
/* Promise(laws/measured-disturbances) */
static void a_measured_disturbance_is_the_plants_of_the_same_name(void **state)
{
    static const char text[] =
        "name = \"tanks\"; duration = 20.0;\n"
        "measurements = ( { name = \"y1\"; }, { name = \"d4\"; } ); setpoints = ( { name = \"r1\"; } );\n"
        "outputs = ( { name = \"v1\"; low = 0.0; high = 10.0; }, { name = \"v2\"; low = 0.0; high = 10.0; } "
        ");\n"
        "plant = { model = \"quadruple-tank\"; period = 0.1; }; client = { period = 0.1; };\n"
        "controllers = ( { name = \"one\"; law = \"mpc\"; period = 2.0; measurements = [\"y1\", \"d4\"]; "
        "setpoints "
        "= [\"r1\"]; outputs = [\"v1\", \"v2\"]; disturbances = [\"d4\"]; operating_point = { }; } );\n"
        "scheduler = { period = 20.0; sequence = ( [6.0] ); };\n";
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (experiment_parse(&e, &(struct experiment_source){.file = "tanks.conf", .text = text},
                         EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    const struct apc_law_plant *p = &e.controllers[0].plant;
    double A[16], B[4 * 4], C[8], D[2 * 4];
    assert_int_equal(apc_model_linearize(p->model, NULL, p->x0, NULL, A, B, C, D, &why), 0);
    assert_int_equal(p->disturbance[0], 1);
    for (size_t i = 0; i < 4; i++) {
        for (size_t k = 0; k < 3; k++)
            assert_near(p->B[3 * i + k], B[4 * i + (k < 2 ? k : 3)], 0);
    }
    assert_true(fabs(p->B[3 * 3 + 2]) > 1e-3); /* d4 flows into tank 4 */
    assert_near(p->u0[1], 3.0, 0);
    assert_near(p->u0[2], 0.0, 0);
    experiment_free(&e);
}

/* Promise(experiment/several-controllers) */
static void nobody_waits_for_himself_in_the_end(void **state)
{
    struct experiment e;
    struct apc_error why;
    (void)state;
    /* base <- upper <- top, whose measurement x is upper's other output */
    assert_int_equal(parse(&e, 8,
                           " { name = \"upper\"; law = \"pi\"; period = 5.0; measurements = [\"y1\"]; "
                           "setpoints = [\"w1\"]; outputs = "
                           "[\"r1\", \"x\"]; }, { name = \"top\"; law = \"pi\"; period = 9.0; measurements = "
                           "[\"x\"]; setpoints = "
                           "[\"w2\"]; outputs = [\"w1\"]; } ); signals = ( { name = \"x\"; } );",
                           &why),
                     APC_EINVAL);
    assert_string_equal(why.text,
                        "layers.conf:8: controllers wait for each other in a circle: upper for w1 of "
                        "top, top for x of upper");
    /* of signals alone, and of one controller; base only waits for it */
    assert_int_equal(
        parse(&e, 8,
              " { name = \"a\"; law = \"select\"; period = 1.0; measurements = [\"p\", \"y1\"]; "
              "outputs = [\"q\"]; }, { name = \"b\"; law = \"select\"; period = 1.0; "
              "measurements = [\"q\"]; outputs = [\"p\"]; } ); signals = ( { name = \"p\"; }, { name "
              "= \"q\"; } );",
              &why),
        APC_EINVAL);
    assert_string_equal(why.text,
                        "layers.conf:8: controllers wait for each other in a circle: a for p of b, b "
                        "for q of a");
    assert_int_equal(parse(&e, 8,
                           " { name = \"a\"; law = \"select\"; period = 1.0; measurements = [\"y1\", \"p\"]; "
                           "outputs = [\"p\"]; } ); signals = ( { name = \"p\"; } );",
                           &why),
                     APC_EINVAL);
    assert_string_equal(why.text, "layers.conf:8: controllers wait for each other in a circle: a for p of a");
    /* without that it is a chain of three; r2, w2 and w3 are free */
    if (parse(
            &e, 8,
            " { name = \"upper\"; law = \"pi\"; period = 5.0; measurements = [\"y1\"]; setpoints = [\"w1\"]; "
            "outputs = "
            "[\"r1\"]; }, { name = \"top\"; law = \"pi\"; period = 9.0; measurements = [\"y2\"]; setpoints = "
            "[\"w2\"]; outputs = [\"w1\"]; } );",
            &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.scheduler.n, 3);
    assert_wire(e.scheduler.z[0], APC_SETPOINT, 1);
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_controller_has_its_own_signals),
        cmocka_unit_test(the_drawings_that_come_along_name_signals_of_their_experiments),
        cmocka_unit_test(a_law_instead_of_the_files_says_whose_it_is),
        cmocka_unit_test(loops_are_described_by_their_controllers_and_numbered_in_the_order_of_the_file),
        cmocka_unit_test(tuning_has_the_units_of_the_signals_that_it_is_for),
        cmocka_unit_test(each_loop_gets_its_own_target_and_what_it_controls),
        cmocka_unit_test(what_the_file_says_of_its_loops_is_what_its_store_says),
        cmocka_unit_test(loops_of_a_law_that_is_not_there_are_paired_in_order),
        cmocka_unit_test(what_is_controlled_twice_is_judged_once),
        cmocka_unit_test(without_measurements_there_was_no_control),
        cmocka_unit_test(each_controller_has_a_law_of_its_own),
        cmocka_unit_test(loops_and_tuning_are_numbered_over_all_controllers),
        cmocka_unit_test(a_controller_may_calculate_what_another_one_measures),
        cmocka_unit_test(the_short_form_is_one_controller_of_all),
        cmocka_unit_test(one_in_the_long_form_is_the_same),
        cmocka_unit_test(a_measured_disturbance_is_the_plants_of_the_same_name),
        cmocka_unit_test(nobody_waits_for_himself_in_the_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
