/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Which variables of a model are the signals of an experiment, where the model names them: an FMU, or a plant
 * in Python. In place of Python stands this program itself, which speaks the same way.
 */
/* Promise(python/plant-python-gives) */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "check.h"
#include "experiment/experiment.h"
#include "nomem.h"
#include "plant/fmu.h"
#include "scratch.h"

/* ---- The process ----------------------------------------------------------------------------------- */

static const char *const says[] = {"model\tmixer\tof two streams",
                                   "input\tcold\tl/s\tfrom the well\t0\t0\t5",
                                   "input\thot\tl/s\tfrom the boiler\t0\t0\t5",
                                   "input\tleak\tl/s\tto the floor\t0\t0\t1",
                                   "output\tlevel\tm\tof water\t0.5\t0\t2",
                                   "output\ttemperature\tK\tof water\t300\t0\t400",
                                   "output\tflow\t\tthat leaves\t0\t0\t9",
                                   "parameter\tsize\tm\tof the tank\t2\t0\t10",
                                   "parameter\tsteps\t\tof the valve\t8\t-128\t127\twhole",
                                   "parameter\tseed\t\tof noise\t0\t-9e18\t9e18\twhole",
                                   "parameter\ton\t\tis it\t1\t0\t1\ttruth",
                                   "parameter\tmode\t\tof the valve\t1\t1\t4\tlabel",
                                   "label\tOff\t1",
                                   "label\tAuto\t4",
                                   "text\tnote\tto the tank\tnone",
                                   "fixed\ttable\tof sizes\tarray"};

static int keep(const char *file)
{
    char end[300];

    for (size_t i = 0; i < sizeof says / sizeof *says; i++)
        if (send(3, says[i], strlen(says[i]), 0) < 0)
            return 5;
    snprintf(end, sizeof end, "folder\t%.280s", file);
    if (send(3, end, strlen(end), 0) < 0)
        return 6;
    return recv(3, end, sizeof end, 0) == 0 ? 0 : 7;
}

/* Each output is its own number, but for the first one in a step of 0.25 s, that is none. */
static int answer(void)
{
    double number[100];
    size_t ny = 2;

    while (recv(3, number, sizeof number, 0) >= (ssize_t)sizeof(struct fmu_header)) {
        struct fmu_header h;
        memcpy(&h, number, sizeof h);
        double *const y = number + sizeof h / sizeof *number;
        const bool blind = h.request == FMU_STEP && y[1] > 0.24 && y[1] < 0.26;
        const double *const set = y + 5 + (size_t)y[0] + (size_t)y[1];
        if (h.request == FMU_BEGIN && y[2] > 0 && set[0] == 1 && set[1] == 77 &&
            (y[3] != 1 || set[2] != 0 || set[3] != 9 || strcmp((const char *)(set + 4), "as it is") != 0))
            return 8;
        if (h.request == FMU_BEGIN)
            ny = y[1] > 2 ? 3 : 2;
        for (size_t i = 0; i < ny; i++)
            y[i] = blind && i == 0 ? (double)NAN : (double)(i + 1);
        if (send(3, number, sizeof h + ny * sizeof *y, 0) < 0)
            return 5;
    }
    return 0;
}

/* ---- The experiment ---------------------------------------------------------------------------------- */

static struct experiment e;
static struct apc_error why;

/* @p y and @p u: the signals; @p plant: more of the plant. */
static int load(const char *y, const char *u, const char *plant, const struct experiment_overrides *overrides)
{
    char text[2000];

    setenv("APC_PYTHON", "/proc/self/exe", 1);
    snprintf(text, sizeof text,
             "name = \"mixer\"; duration = 10.0; measurements = ( %s );\n"
             "setpoints = ( { name = \"r1\"; }, { name = \"r2\"; } ); outputs = ( %s );\n"
             "plant = { model = \"mixer.py\"; period = 0.5; %s };\n"
             "client = { period = 1.0; }; controller = { law = \"pi\"; period = 1.0; };\n"
             "scheduler = { period = 10.0; sequence = ( [1.0, 2.0] ); };\n",
             y, u, plant);
    scratch_write("mixer.conf", text);
    scratch_write("mixer.py", "");
    why.text[0] = '\0';
    return experiment_load(&e, scratch_path("mixer.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, overrides,
                           &why);
}

#define Y_OTHER "{ name = \"y1\"; }, { name = \"y2\"; }"
#define WITHIN  "low = 0.0; high = 1.0; }"
#define U_OTHER "{ name = \"u1\"; " WITHIN ", { name = \"u2\"; " WITHIN
#define Y_NAMED "{ name = \"temperature\"; unit = \"K\"; }, { name = \"flow\"; unit = \"m3/s\"; }"
#define U_NAMED "{ name = \"leak\"; unit = \"l/s\"; " WITHIN ", { name = \"hot\"; " WITHIN

static void assert_chosen(const char *y1, const char *y2, const char *u1, const char *u2, const char *d)
{
    const struct apc_model *const m = e.plant.model;

    assert_non_null(m);
    assert_int_equal(m->ny, 2);
    assert_int_equal(m->nu, 2);
    assert_int_equal(m->nd, 1);
    assert_string_equal(m->output[0].name, y1);
    assert_string_equal(m->output[1].name, y2);
    assert_string_equal(m->input[0].name, u1);
    assert_string_equal(m->input[1].name, u2);
    assert_string_equal(m->disturbance[0].name, d);
    experiment_free(&e);
}

static void the_file_names_them_in_the_order_of_the_signals(void **state)
{
    (void)state;
    if (load(Y_OTHER, U_OTHER,
             "inputs = [\"hot\", \"cold\"]; outputs = [\"flow\", \"level\"];"
             "disturbances = ( { name = \"leak\"; at = 3.0; value = 0.5; } );",
             NULL) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(e.plant.n_disturbances, 1);
    assert_chosen("flow", "level", "hot", "cold", "leak");
}

static void else_they_have_the_names_of_the_signals(void **state)
{
    (void)state;
    if (load(Y_NAMED, U_NAMED, "", NULL) < 0)
        fail_msg("%s", why.text);
    assert_chosen("temperature", "flow", "leak", "hot", "cold");
    if (load(Y_NAMED, U_OTHER, "inputs = [\"cold\", \"leak\"];", NULL) < 0)
        fail_msg("%s", why.text);
    assert_chosen("temperature", "flow", "cold", "leak", "hot");
    if (load(Y_OTHER, U_NAMED, "outputs = [\"temperature\", \"level\"];", NULL) < 0)
        fail_msg("%s", why.text);
    assert_chosen("temperature", "level", "leak", "hot", "cold");
}

static void names_in_the_file_are_of_its_own_model(void **state)
{
    char file[300];
    const struct experiment_overrides other = {.model = file};
    (void)state;
    scratch_write("other.py", "");
    snprintf(file, sizeof file, "%s", scratch_path("other.py"));
    if (load(Y_NAMED, U_NAMED, "inputs = [\"nothing\"]; outputs = 7;", &other) < 0)
        fail_msg("%s", why.text);
    assert_chosen("temperature", "flow", "leak", "hot", "cold");
}

static void what_names_no_variables_of_it_is_refused_with_its_line(void **state)
{
    static const struct {
        const char *y, *u, *plant, *reason;
    } wrong[] = {
        {Y_NAMED, U_NAMED, "inputs = [\"hot\"];",
         "mixer.conf:3: \"inputs\" must name 2 variables of the model, in the order of the signals: "
         "[\"...\"]"},
        {Y_NAMED, U_NAMED, "inputs = [\"hot\", \"cold\", \"leak\"];", "\"inputs\" must name 2 variables"},
        {Y_NAMED, U_NAMED, "inputs = \"hot\";", "\"inputs\" must name 2 variables"},
        {Y_NAMED, U_NAMED, "outputs = [\"level\"];", "mixer.conf:3: \"outputs\" must name 2 variables"},
        {Y_NAMED, U_NAMED, "inputs = [1, 2];", "mixer.conf:3: \"inputs\" must hold names: [\"...\"]"},
        {Y_NAMED, U_NAMED, "outputs = ( \"level\", 2 );", "\"outputs\" must hold names: [\"...\"]"},
        {Y_NAMED, U_NAMED, "inputs = [\"hot\", \"hot\"];", "\"hot\" is named twice"},
        {Y_OTHER, U_NAMED, "",
         "has no output \"y1\"; there are: level, temperature, flow (in the file: \"inputs\" and \"outputs\" "
         "of "
         "the plant)"},
        {Y_NAMED, U_OTHER, "", "has no input \"u1\"; there are: cold, hot, leak"},
        {"{ name = \"temperature\"; unit = \"degC\"; }, { name = \"flow\"; }", U_NAMED, "",
         "temperature is in degC, and temperature of the model in K: nothing is converted"},
        {Y_OTHER, "{ name = \"u1\"; }, { name = \"u2\"; unit = \"m3/h\"; }",
         "inputs = [\"hot\", \"cold\"]; outputs = [\"flow\", \"level\"];",
         "u2 is in m3/h, and cold of the model in l/s: nothing is converted"},
        {Y_NAMED, "{ name = \"leak\"; low = 0.0; high = 1.5; }, { name = \"hot\"; " WITHIN, "",
         "leak may be 0 to 1.5, and leak of the model takes 0 to 1: give output leak \"low\" and \"high\" "
         "within"},
        {Y_NAMED, "{ name = \"leak\"; }, { name = \"hot\"; " WITHIN, "",
         "leak has no limits, and leak of the model takes 0 to 1"},
        {Y_NAMED, U_NAMED, "disturbances = ( { name = \"cold\"; at = 1.0; value = 6.0; } );",
         "\"cold\" is 6: must be from 0 to 5"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        if (load(wrong[i].y, wrong[i].u, wrong[i].plant, NULL) >= 0)
            fail_msg("taken: %s", wrong[i].plant);
        assert_has(why.text, wrong[i].reason);
        assert_null(e.plant.model);
    }
}

static const struct apc_model *model;

/* ---- What parameters take ----------------------------------------------------------------------------- */

/* Promise(links/parameter-input-fmu) */
static void a_parameter_has_a_value_of_its_kind_or_is_refused(void **state)
{
    static const struct {
        const char *parameter, *reason; /* NULL: it is taken, */
        size_t place;
        double value; /* as that */
    } of[] = {
        {"size = 2.5", NULL, 0, 2.5},
        {"steps = 100", NULL, 1, 100},
        {"steps = -128.0", NULL, 1, -128},
        {"steps = 2.5", "mixer.conf:3: \"steps\" is 2.5: must be a whole number", 1, 0},
        {"steps = 128", "\"steps\" is 128: must be from -128 to 127", 1, 0},
        {"steps = true", "\"steps\" is \"true\": must be a number", 1, 0},
        {"steps = \"uniform(0, 9)\"", "must be a whole number", 1, 0},
        {"seed = 9007199254740991L", NULL, 2, 9007199254740991.0},
        {"seed = 9007199254740993L", "must be a whole number, of 15 digits at most", 2, 0},
        {"on = false", NULL, 3, 0},
        {"on = 1", NULL, 3, 1},
        {"on = 0.5", "\"on\" is 0.5: must be true or false, or 1 or 0", 3, 0},
        {"on = \"off\"", "\"on\" is \"off\": must be true or false", 3, 0},
        {"mode = \"Auto\"", NULL, 4, 4},
        {"mode = 4", NULL, 4, 4},
        {"mode = 2", "\"mode\" is 2: must be one of 1 Off, 4 Auto", 4, 0},
        {"mode = 7", "\"mode\" is 7: must be one of 1 Off, 4 Auto", 4, 0},
        {"mode = \"Automatic\"", "\"mode\" is \"Automatic\": must be one of 1 Off, 4 Auto", 4, 0},
        {"mode = \"normal(1, 0)\"", "must be one of 1 Off, 4 Auto", 4, 0},
        {"note = 5", "\"note\" must be text in double quotes", 0, 0},
        {"noté = 5", "syntax error", 0, 0},
        {"nose = \"a\"", "has no parameter \"nose\": did you mean \"note\"?", 0, 0},
        {"table = 5", "\"table\" is of the type array, and stays as it is", 0, 0},
        {"size = [2.0, 3.0]", "\"size\" must be a finite number", 0, 0},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        char plant[200];
        snprintf(plant, sizeof plant, "parameters = { %s; };", of[i].parameter);
        const int rc = load(Y_NAMED, U_NAMED, plant, NULL);
        if ((rc == 0) != !of[i].reason)
            fail_msg("%s: %s", of[i].parameter, rc < 0 ? why.text : "is taken");
        if (rc < 0) {
            assert_has(why.text, of[i].reason);
        } else {
            assert_near(e.plant.p[of[i].place], of[i].value, 0);
            experiment_free(&e);
        }
    }
}

/* Also where no file is read. */
/* Promise(links/parameter-input-fmu) */
static void a_plant_is_not_made_of_what_does_not_fit(void **state)
{
    const struct apc_model *m = NULL;
    struct apc_plant *plant = NULL;
    void *handle = NULL;
    double p[] = {2, 8.5, 0, 1, 1};
    (void)state;
    scratch_write("mixer.py", "");
    assert_int_equal(apc_model_find(scratch_path("mixer.py"), &m, &handle, &why), 0);
    assert_int_equal(apc_plant_create(&plant, m, p, NULL, NULL, &why), APC_EINVAL);
    assert_has(why.text, "\"steps\" is 8.5: must be a whole number");
    p[1] = 9;
    assert_int_equal(apc_plant_create(&plant, m, p, NULL, NULL, &why), 0);
    apc_plant_destroy(plant);
    const struct apc_plant_options never = {.size = sizeof never, .period = -1};
    assert_int_equal(apc_plant_create(&plant, m, p, NULL, &never, &why), APC_EINVAL);
    assert_has(why.text, "period is -1 s");
    apc_plugin_close(handle);
}

/* It is what it was before, and the next step is one again, of the same process. */
/* Promise(links/fmu-says-step) */
static void a_step_to_no_number_is_none(void **state)
{
    const double u[] = {0, 0, 0};
    struct apc_plant *plant = NULL;
    void *handle = NULL;
    (void)state;
    scratch_write("mixer.py", "");
    assert_int_equal(apc_model_find(scratch_path("mixer.py"), &model, &handle, &why), 0);
    assert_int_equal(apc_plant_create(&plant, model, NULL, NULL, NULL, &why), 0);
    assert_int_equal(apc_plant_advance(plant, 0.5, u), 0);
    assert_int_equal(apc_plant_advance(plant, 0.25, u), APC_ESOLVER);
    assert_has(apc_plant_error(plant), "its output level is not a finite number");
    assert_near(apc_plant_state(plant)[0], 1, 0);
    assert_near(apc_plant_time(plant), 0.5, 0);
    assert_int_equal(apc_plant_advance(plant, 0.5, u), 0); /* in virtual time what has ended stays away */
    assert_near(apc_plant_time(plant), 1.0, 0);
    apc_plant_destroy(plant);
    apc_plugin_close(handle);
}

/* Promise(links/parameter-input-fmu) */
static void a_text_arrives_whole(void **state)
{
    (void)state;
    if (load(Y_NAMED, U_NAMED, "parameters = { note = \"\"; steps = 1; };", NULL) < 0)
        fail_msg("%s", why.text);
    experiment_free(&e);
    if (load(Y_NAMED, U_NAMED, "parameters = { note = \"as it is\"; steps = 77; };", NULL) <
        0) /* which answer() wants */
        fail_msg("%s", why.text);
    experiment_free(&e);
    assert_true(load(Y_NAMED, U_NAMED, "parameters = { note = \"as it was\"; steps = 77; };", NULL) < 0);
}

/* ---- No memory --------------------------------------------------------------------------------------- */

static int find(void)
{
    const struct apc_model *found = NULL;
    void *handle = NULL;
    const int rc = apc_model_find(scratch_path("mixer.py"), &found, &handle, &why);

    assert_int_equal(rc == 0, handle != NULL);
    apc_plugin_close(handle);
    return rc;
}

static int create(void)
{
    struct apc_plant *plant = NULL;
    const int rc = apc_plant_create(&plant, model, NULL, NULL, NULL, &why);

    assert_int_equal(rc == 0, plant != NULL);
    apc_plant_destroy(plant);
    return rc;
}

static void each_allocation_may_fail(void **state)
{
    static const struct nomem_step steps[] = {{"model", find, false}, {"plant", create, false}};
    void *handle;
    (void)state;
    scratch_write("mixer.py", "");
    if (apc_model_find(scratch_path("mixer.py"), &model, &handle, &why) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        nomem_each(&steps[i], 1, 1, &why);
    apc_plugin_close(handle);
}

#define T(name) cmocka_unit_test(name)

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        T(the_file_names_them_in_the_order_of_the_signals),
        T(else_they_have_the_names_of_the_signals),
        T(names_in_the_file_are_of_its_own_model),
        T(what_names_no_variables_of_it_is_refused_with_its_line),
        T(a_parameter_has_a_value_of_its_kind_or_is_refused),
        T(a_plant_is_not_made_of_what_does_not_fit),
        T(a_step_to_no_number_is_none),
        T(a_text_arrives_whole),
        T(each_allocation_may_fail),
    };

    if (argc == 5 && !strcmp(argv[2], "libapc.plant"))
        return strcmp(argv[3], "keep") == 0 ? keep(argv[4]) : answer();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
