/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Which variables of a model are the signals of an experiment, where the model names them: an FMU, or a plant
 * in Python. In place of Python stands this program itself, which speaks the same way.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "check.h"
#include "nomem.h"
#include "plant/fmu.h"
#include "run/run_internal.h"
#include "scratch.h"

/* ---- The process ----------------------------------------------------------------------------------- */

static const char *const says[] = {"model\tmixer\tof two streams",
                                   "input\tcold\tl/s\tfrom the well\t0\t0\t5",
                                   "input\thot\tl/s\tfrom the boiler\t0\t0\t5",
                                   "input\tleak\tl/s\tto the floor\t0\t0\t1",
                                   "output\tlevel\tm\tof water\t0.5\t0\t2",
                                   "output\ttemperature\tK\tof water\t300\t0\t400",
                                   "output\tflow\t\tthat leaves\t0\t0\t9"};

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

/* Each output is its own number. */
static int answer(void)
{
    double number[100];

    while (recv(3, number, sizeof number, 0) >= (ssize_t)sizeof(struct fmu_header)) {
        struct fmu_header h;
        memcpy(&h, number, sizeof h);
        double *const y = number + sizeof h / sizeof *number;
        const size_t ny = number[sizeof h / sizeof *number + 1] > 2 ? 3 : 2;
        for (size_t i = 0; i < ny; i++)
            y[i] = (double)(i + 1);
        if (h.request == FMU_BEGIN && send(3, number, sizeof h + ny * sizeof *y, 0) < 0)
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
#define U_OTHER "{ name = \"u1\"; }, { name = \"u2\"; }"
#define Y_NAMED "{ name = \"temperature\"; unit = \"K\"; }, { name = \"flow\"; unit = \"m3/s\"; }"
#define U_NAMED "{ name = \"leak\"; unit = \"l/s\"; }, { name = \"hot\"; }"

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
    };
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        if (load(wrong[i].y, wrong[i].u, wrong[i].plant, NULL) >= 0)
            fail_msg("taken: %s", wrong[i].plant);
        assert_has(why.text, wrong[i].reason);
        assert_null(e.plant.model);
    }
}

/* ---- No memory --------------------------------------------------------------------------------------- */

static const struct apc_model *model;

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
        T(each_allocation_may_fail),
    };

    if (argc == 5 && !strcmp(argv[2], "libapc.plant"))
        return strcmp(argv[3], "keep") == 0 ? keep(argv[4]) : answer();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
