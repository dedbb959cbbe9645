/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller as an FMU: its library, loaded as an importer does, beside the same controller in a run. */
#include "check.h"

#include <dlfcn.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "experiment/experiment.h"
#include "scratch.h"
#include "simulation/simulation.h"

#define TOKEN "0123"

/* ---- What an importer calls ------------------------------------------------------------------- */

typedef void log2_fn(void *environment, const char *name, int status, const char *category,
                     const char *message, ...);
struct callbacks {
    log2_fn *log;
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
};

static struct {
    void *(*make2)(const char *name, int type, const char *guid, const char *resources,
                   const struct callbacks *callbacks, int visible, int logging);
    int (*setup2)(void *c, int tolerant, double tolerance, double start, int stops, double stop);
    int (*enter2)(void *c);
    int (*leave2)(void *c);
    int (*get2)(void *c, const unsigned *reference, size_t n, double *value);
    int (*set2)(void *c, const unsigned *reference, size_t n, const double *value);
    int (*set_integer2)(void *c, const unsigned *reference, size_t n, const int *value);
    int (*step2)(void *c, double time, double step, int no_way_back);
    int (*state2)(void *c, void **state);
    int (*reset2)(void *c);
    int (*end2)(void *c);
    void (*free2)(void *c);
    void *(*make3)(const char *name, const char *token, const char *resources, bool visible, bool logging,
                   bool events, bool early, const unsigned *intermediate, size_t n, void *environment,
                   void (*log)(void *environment, int status, const char *category, const char *text),
                   void *update);
    int (*enter3)(void *c, bool tolerant, double tolerance, double start, bool stops, double stop);
    int (*leave3)(void *c);
    int (*get3)(void *c, const unsigned *reference, size_t n, double *value, size_t n_values);
    int (*set3)(void *c, const unsigned *reference, size_t n, const double *value, size_t n_values);
    int (*set_integer3)(void *c, const unsigned *reference, size_t n, const int *value, size_t n_values);
    int (*step3)(void *c, double time, double step, bool no_way_back, bool *event, bool *ends, bool *early,
                 double *last);
    void (*free3)(void *c);
} fmi;
static void *library;
static char said[1000]; /* the last sentence */

static int load(void **state)
{
    const struct {
        const char *name;
        void *at;
    } all[] = {{"fmi2Instantiate", &fmi.make2},
               {"fmi2SetupExperiment", &fmi.setup2},
               {"fmi2EnterInitializationMode", &fmi.enter2},
               {"fmi2ExitInitializationMode", &fmi.leave2},
               {"fmi2GetReal", &fmi.get2},
               {"fmi2SetReal", &fmi.set2},
               {"fmi2SetInteger", &fmi.set_integer2},
               {"fmi2DoStep", &fmi.step2},
               {"fmi2GetFMUstate", &fmi.state2},
               {"fmi2Reset", &fmi.reset2},
               {"fmi2Terminate", &fmi.end2},
               {"fmi2FreeInstance", &fmi.free2},
               {"fmi3InstantiateCoSimulation", &fmi.make3},
               {"fmi3EnterInitializationMode", &fmi.enter3},
               {"fmi3ExitInitializationMode", &fmi.leave3},
               {"fmi3GetFloat64", &fmi.get3},
               {"fmi3SetFloat64", &fmi.set3},
               {"fmi3SetInt32", &fmi.set_integer3},
               {"fmi3DoStep", &fmi.step3},
               {"fmi3FreeInstance", &fmi.free3}};

    library = dlopen(APC_FMU_CONTROLLER, RTLD_NOW | RTLD_LOCAL);
    (void)state;
    if (!library)
        print_error("%s\n", dlerror());
    for (size_t i = 0; library && i < sizeof all / sizeof *all; i++) {
        void *const found = dlsym(library, all[i].name);
        if (!found)
            return -1;
        memcpy(all[i].at, &found, sizeof found);
    }
    return library ? 0 : -1;
}

static void hear2(void *environment, const char *name, int status, const char *category, const char *message,
                  ...)
{
    va_list arguments;
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    va_start(arguments, message);
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
    vsnprintf(said, sizeof said, message,
              arguments); /* NOLINT(clang-diagnostic-format-nonliteral): it is the FMU's */
#pragma GCC diagnostic pop
    va_end(arguments);
}

static void hear3(void *environment, int status, const char *category, const char *text)
{
    (void)environment;
    (void)status;
    (void)category;
    snprintf(said, sizeof said, "%s", text);
}

static const struct callbacks callbacks = {.log = hear2, .allocate = calloc, .release = free};

/* An FMU's resources, as it is unpacked: of that file, or of a text. */
static const char *resources(const char *text, const char *controller)
{
    static char folder[400];
    char whose[200];

    snprintf(folder, sizeof folder, "%s/an FMU", scratch_folder());
    (void)mkdir(folder, 0700);
    scratch_write("an FMU/experiment.conf", text);
    snprintf(whose, sizeof whose, TOKEN "\n%s\n", controller);
    scratch_write("an FMU/controller", whose);
    return folder;
}

static void *make2(const char *folder)
{
    char uri[450];
    const char *const blank = strchr(folder, ' ');
    said[0] = '\0';
    snprintf(uri, sizeof uri, "file://%.*s%%20%s", (int)(blank - folder), folder, blank + 1);
    return fmi.make2("it", 1, TOKEN, uri, &callbacks, 0, 0);
}

static void *make3(const char *folder)
{
    said[0] = '\0';
    return fmi.make3("it", TOKEN, folder, false, false, false, false, NULL, 0, NULL, hear3, NULL);
}

static int step3(void *c, double time, double step)
{
    bool event, ends, early;
    double last;
    return fmi.step3(c, time, step, false, &event, &ends, &early, &last);
}

static void initialise(void *c2, void *c3, double start)
{
    assert_int_equal(fmi.setup2(c2, 0, 0, start, 0, 0), 0);
    assert_int_equal(fmi.enter2(c2), 0);
    assert_int_equal(fmi.leave2(c2), 0);
    assert_int_equal(fmi.enter3(c3, false, 0, start, false, 0), 0);
    assert_int_equal(fmi.leave3(c3), 0);
}

/* ---- The same outputs ------------------------------------------------------------------------- */

static void follow_schedule(void *c2, void *c3, unsigned reference)
{
    assert_int_equal(fmi.set_integer2(c2, &reference, 1, &(int){1}), 0);
    assert_int_equal(fmi.set_integer3(c3, &reference, 1, &(int){1}, 1), 0);
}

static double newest(struct apc_store *store, const struct apc_tag *tag)
{
    struct apc_sample row = {.table = tag->table, .id = tag->id};
    assert_int_equal(apc_store_read(store, &row, 1), 0);
    return row.seq > 0 && apc_status_severity(row.status) != APC_SEVERITY_BAD ? row.value : (double)NAN;
}

/* To the last bit. */
static bool is_same(double a, double b)
{
    uint64_t bits[2];
    memcpy(&bits[0], &a, sizeof a);
    memcpy(&bits[1], &b, sizeof b);
    return bits[0] == bits[1];
}

/* One tick later: with what the run's controller saw the FMUs give what it gave. */
static size_t compare_tick(struct simulation *s, void *c2, void *c3, double t, const struct standalone *alone)
{
    size_t n, outputs = 0;
    const struct standalone_variable *const v = standalone_variables(alone, &n);
    const double step = apc_ns_to_s(standalone_controller(alone)->rhythm.period);

    for (unsigned i = 0; i < n; i++) {
        const unsigned reference = i + 1;
        const double value = v[i].kind == STANDALONE_INPUT ? newest(s->store, &v[i].tag) : 0;
        if (v[i].kind != STANDALONE_INPUT || (isnan(value) && v[i].tag.table == APC_SETPOINT))
            continue;
        assert_int_equal(fmi.set2(c2, &reference, 1, &value), 0);
        assert_int_equal(fmi.set3(c3, &reference, 1, &value, 1), 0);
    }
    assert_int_equal(fmi.step2(c2, t, step, 1), 0);
    assert_int_equal(step3(c3, t, step), 0);
    for (unsigned i = 0; i < n; i++) {
        const unsigned reference = i + 1;
        double value[2], expected;
        if (v[i].kind != STANDALONE_OUTPUT || isnan(expected = newest(s->store, &v[i].tag)))
            continue;
        assert_int_equal(fmi.get2(c2, &reference, 1, &value[0]), 0);
        assert_int_equal(fmi.get3(c3, &reference, 1, &value[1], 1), 0);
        if (!is_same(value[0], expected) || !is_same(value[1], expected))
            fail_msg("%s at %g s: %.17g and %.17g, not %.17g", v[i].tag.name, t, value[0], value[1],
                     expected);
        outputs++;
    }
    return outputs;
}

static void compare_run(const char *file, const char *name, size_t ticks)
{
    struct experiment e;
    struct simulation s;
    struct standalone *alone = NULL;
    struct apc_error why = {""};
    char path[300];
    size_t n, outputs = 0;

    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, file);
    if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        standalone_create(&alone, &(struct experiment_source){.file = path, .text = e.text}, name, &why) <
            0 ||
        simulation_create(&s, &e, e.seed, &why) < 0)
        fail_msg("%s: %s", file, why.text);
    const struct rhythm *const rhythm = &standalone_controller(alone)->rhythm;
    const double phase = apc_ns_to_s(rhythm->phase);
    const char *const folder = resources(e.text, standalone_controller(alone)->name);
    void *const c2 = make2(folder), *const c3 = make3(folder);
    if (!c2 || !c3)
        fail_msg("%s: %s", file, said);
    const struct standalone_variable *const v = standalone_variables(alone, &n);
    initialise(c2, c3, phase);
    if (!strcmp(v[n - 1].tag.name, "follow.schedule"))
        follow_schedule(c2, c3, (unsigned)n);
    for (size_t k = 0; k < ticks; k++) {
        const double t = phase + (double)k * apc_ns_to_s(rhythm->period);
        if (simulation_run(&s, t + 1e-9) < 0)
            fail_msg("%s: %s", file, s.why.text);
        outputs += compare_tick(&s, c2, c3, t, alone);
    }
    assert_true(outputs >= ticks);
    fmi.free2(c2);
    fmi.free3(c3);
    simulation_destroy(&s);
    standalone_destroy(alone);
    experiment_free(&e);
}

/* Promise(links/fmu-controller): A controller that is exported as an FMU gives, of the same samples, the outputs that it
 *   gives in a run, bit for bit: pi, pid, cascade, lqg, mpc and nmpc, by FMI 2 and 3. */
static void a_controller_gives_what_it_gives_in_a_run(void **state)
{
    (void)state;
    compare_run("first-order", NULL, 300);
    compare_run("quadruple-tank-mpc", NULL, 500); /* with setpoints that it knows ahead */
    compare_run("four-tank", NULL, 300);
    compare_run("servo", NULL, 300);
    compare_run("pendulum", NULL, 100);
    compare_run("van-de-vusse-nmpc", NULL, 20);
    compare_run("qts/lmpc", NULL, 50);
    compare_run("double-tank", NULL, 100);             /* cascade */
    compare_run("double-tank-override", "smooth", 50); /* an output that is a signal */
    compare_run("double-tank-override", "choose", 50);
}

/* ---- What is refused -------------------------------------------------------------------------- */

static char *text_of(const char *file)
{
    struct experiment e;
    struct apc_error why;
    char path[300];
    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, file);
    assert_int_equal(experiment_load(&e, path, EXPERIMENT_LAW, NULL, &why), 0);
    char *const text = strdup(e.text);
    experiment_free(&e);
    return text;
}

static const char *first_order(void)
{
    char *const text = text_of("first-order");
    const char *const folder = resources(text, "controller");
    free(text);
    return folder;
}

/* Promise(links/fmu-controller-refuses): An FMU of a controller refuses, with a sentence, a step that is not the period or a
 *   multiple of it, one from another time, an unknown value reference, and a token that is another's; it goes on after that. */
static void what_is_wrong_is_said(void **state)
{
    const char *const folder = first_order();
    const unsigned y = 1, u = 3, mode = 4, none = 99;
    double value = 0;
    void *c2, *c3;

    (void)state;
    assert_null(fmi.make3("it", "other", folder, false, false, false, false, NULL, 0, NULL, hear3, NULL));
    assert_has(said, "other");
    assert_null(fmi.make3("it", NULL, folder, false, false, false, false, NULL, 0, NULL, hear3, NULL));
    assert_null(fmi.make3("it", TOKEN, folder, false, false, true, false, NULL, 0, NULL, hear3, NULL));
    assert_null(fmi.make3("it", TOKEN, NULL, false, false, false, false, NULL, 0, NULL, NULL, NULL));
    assert_null(fmi.make2("it", 1, TOKEN, "http://a/b", &callbacks, 0, 0));
    assert_null(fmi.make2("it", 0, TOKEN, NULL, &callbacks, 0, 0));
    assert_null(make3("/no folder"));
    assert_has(said, "/no folder");
    scratch_write("an FMU/experiment.conf", "name = ");
    assert_null(make3(folder));
    assert_has(said, "experiment.conf");
    c2 = make2(first_order());
    c3 = make3(folder);
    assert_int_equal(fmi.step2(c2, 0, 2, 1), 3);
    assert_has(said, "not initialised");
    initialise(c2, c3, 0);
    assert_int_equal(fmi.enter2(c2), 3);
    static const double steps[] = {1.0, 0.0, -2.0, 2.1, (double)NAN, HUGE_VAL, 1e300};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        assert_int_equal(fmi.step2(c2, 0, steps[i], 1), 3);
        assert_has(said, "the controller's period, 2 s");
    }
    assert_int_equal(fmi.step2(c2, 2, 2, 1), 3);
    assert_has(said, "from 2 s, but it stands at 0 s");
    assert_int_equal(fmi.get2(c2, &none, 1, &value), 3);
    assert_has(said, "99");
    assert_int_equal(fmi.get2(c2, &mode, 1, &value), 3);
    assert_int_equal(fmi.set_integer2(c2, &y, 1, &(int){1}), 3);
    assert_int_equal(fmi.set2(c2, &u, 1, &value), 3);
    assert_has(said, "u is an output");
    assert_int_equal(fmi.set3(c3, &y, 1, &value, 2), 3);
    assert_int_equal(fmi.state2(c2, NULL), 3);
    assert_has(said, "GetFMUstate");
    assert_int_equal(fmi.step2(c2, 0, 4, 1), 0);
    assert_int_equal(fmi.step2(c2, 4, 2, 1), 0);
    assert_int_equal(fmi.end2(c2), 0);
    assert_int_equal(fmi.step2(c2, 6, 2, 1), 3);
    fmi.free2(c2);
    fmi.free3(c3);
    fmi.free2(NULL);
}

/* ---- What it does not offer ------------------------------------------------------------------- */

typedef int refused_fn(void *c);
typedef int none2_fn(void *c, const unsigned *reference, size_t n, void *value);
typedef int none3_fn(void *c, const unsigned *reference, size_t n);

static void find_function(const char *name, void *function)
{
    void *const found = dlsym(library, name);
    if (!found)
        fail_msg("there is no %s, which an importer looks up", name);
    memcpy(function, &found, sizeof found);
}

static void refuses_all(const char *const *name, size_t n, void *c)
{
    for (size_t i = 0; i < n; i++) {
        refused_fn *function;
        find_function(name[i], &function);
        said[0] = '\0';
        assert_int_equal(function(c), 3);
        assert_has(said, name[i]);
    }
}

/* An importer looks up all functions of the standard; those that the description does not offer say so. */
static void what_is_not_offered_is_refused(void **state)
{
    static const char *const not_offered2[] = {"fmi2GetFMUstate",
                                               "fmi2SetFMUstate",
                                               "fmi2FreeFMUstate",
                                               "fmi2SerializedFMUstateSize",
                                               "fmi2SerializeFMUstate",
                                               "fmi2DeSerializeFMUstate",
                                               "fmi2GetDirectionalDerivative",
                                               "fmi2SetRealInputDerivatives",
                                               "fmi2GetRealOutputDerivatives",
                                               "fmi2CancelStep",
                                               "fmi2GetStatus",
                                               "fmi2GetRealStatus",
                                               "fmi2GetIntegerStatus",
                                               "fmi2GetBooleanStatus",
                                               "fmi2GetStringStatus"};
    static const char *const not_offered3[] = {"fmi3EnterEventMode",
                                               "fmi3GetNumberOfVariableDependencies",
                                               "fmi3GetVariableDependencies",
                                               "fmi3GetFMUState",
                                               "fmi3SetFMUState",
                                               "fmi3FreeFMUState",
                                               "fmi3SerializedFMUStateSize",
                                               "fmi3SerializeFMUState",
                                               "fmi3DeserializeFMUState",
                                               "fmi3GetDirectionalDerivative",
                                               "fmi3GetAdjointDerivative",
                                               "fmi3EnterConfigurationMode",
                                               "fmi3ExitConfigurationMode",
                                               "fmi3GetIntervalDecimal",
                                               "fmi3GetIntervalFraction",
                                               "fmi3GetShiftDecimal",
                                               "fmi3GetShiftFraction",
                                               "fmi3SetIntervalDecimal",
                                               "fmi3SetIntervalFraction",
                                               "fmi3SetShiftDecimal",
                                               "fmi3SetShiftFraction",
                                               "fmi3EvaluateDiscreteStates",
                                               "fmi3UpdateDiscreteStates",
                                               "fmi3EnterContinuousTimeMode",
                                               "fmi3CompletedIntegratorStep",
                                               "fmi3SetTime",
                                               "fmi3SetContinuousStates",
                                               "fmi3GetContinuousStateDerivatives",
                                               "fmi3GetEventIndicators",
                                               "fmi3GetContinuousStates",
                                               "fmi3GetNominalsOfContinuousStates",
                                               "fmi3GetNumberOfEventIndicators",
                                               "fmi3GetNumberOfContinuousStates",
                                               "fmi3EnterStepMode",
                                               "fmi3GetOutputDerivatives",
                                               "fmi3ActivateModelPartition"};
    static const char *const types2[] = {"fmi2GetBoolean", "fmi2SetBoolean", "fmi2GetString",
                                         "fmi2SetString"};
    static const char *const types3[] = {"fmi3GetFloat32", "fmi3SetFloat32", "fmi3GetInt8",   "fmi3SetInt8",
                                         "fmi3GetUInt8",   "fmi3SetUInt8",   "fmi3GetInt16",  "fmi3SetInt16",
                                         "fmi3GetUInt16",  "fmi3SetUInt16",  "fmi3GetUInt32", "fmi3SetUInt32",
                                         "fmi3GetInt64",   "fmi3SetInt64",   "fmi3GetUInt64", "fmi3SetUInt64",
                                         "fmi3GetBoolean", "fmi3SetBoolean", "fmi3GetString", "fmi3SetString",
                                         "fmi3GetBinary",  "fmi3SetBinary",  "fmi3GetClock",  "fmi3SetClock"};
    static const char *const kinds3[] = {"fmi3InstantiateModelExchange", "fmi3InstantiateScheduledExecution"};
    void *const c2 = make2(first_order()), *const c3 = make3(first_order());
    const unsigned y = 1;

    (void)state;
    refuses_all(not_offered2, sizeof not_offered2 / sizeof *not_offered2, c2);
    refuses_all(not_offered3, sizeof not_offered3 / sizeof *not_offered3, c3);
    for (size_t i = 0; i < sizeof types2 / sizeof *types2; i++) {
        none2_fn *function;
        find_function(types2[i], &function);
        assert_int_equal(function(c2, NULL, 0, NULL), 0);
        assert_int_equal(function(c2, &y, 1, NULL), 3);
        assert_has(said, types2[i]);
    }
    for (size_t i = 0; i < sizeof types3 / sizeof *types3; i++) {
        none3_fn *function;
        find_function(types3[i], &function);
        assert_int_equal(function(c3, NULL, 0), 0);
        assert_int_equal(function(c3, &y, 1), 3);
        assert_has(said, types3[i]);
    }
    for (size_t i = 0; i < 2; i++) {
        void *(*make)(void);
        find_function(kinds3[i], &make);
        assert_null(make());
    }
    fmi.free2(c2);
    fmi.free3(c3);
}

static void it_says_what_it_is(void **state)
{
    const char *(*version)(void);
    void *const c2 = make2(first_order()), *const c3 = make3(first_order());
    const unsigned mode = 4;
    int (*log_all)(void *c, int on, size_t n, const char *const *category),
        (*get2)(void *c, const unsigned *reference, size_t n, int *value),
        (*get3)(void *c, const unsigned *reference, size_t n, int32_t *value, size_t n_values),
        (*log_all3)(void *c, bool on, size_t n, const char *const *category);
    refused_fn *reset3, *end3;
    int value = 0;
    int32_t value3 = 0;

    (void)state;
    find_function("fmi2GetTypesPlatform", &version);
    assert_string_equal(version(), "default");
    find_function("fmi2GetVersion", &version);
    assert_string_equal(version(), "2.0");
    find_function("fmi3GetVersion", &version);
    assert_string_equal(version(), "3.0");
    find_function("fmi2SetDebugLogging", &log_all);
    find_function("fmi3SetDebugLogging", &log_all3);
    assert_int_equal(log_all(c2, 1, 0, NULL), 0);
    assert_int_equal(log_all3(c3, true, 0, NULL), 0);
    find_function("fmi2GetInteger", &get2);
    find_function("fmi3GetInt32", &get3);
    initialise(c2, c3, 0);
    assert_int_equal(fmi.set_integer2(c2, &mode, 1, &(int){APC_MODE_MAN}), 0);
    assert_int_equal(fmi.set_integer3(c3, &mode, 1, &(int){APC_MODE_MAN}, 1), 0);
    assert_int_equal(get2(c2, &mode, 1, &value), 0);
    assert_int_equal(get3(c3, &mode, 1, &value3, 1), 0);
    assert_true(value == APC_MODE_MAN && value3 == APC_MODE_MAN);
    assert_int_equal(get3(c3, &mode, 1, &value3, 2), 3);
    assert_has(said, "as many values as references");
    find_function("fmi3Terminate", &end3);
    find_function("fmi3Reset", &reset3);
    assert_int_equal(end3(c3), 0);
    assert_int_equal(step3(c3, 0, 2), 3);
    assert_int_equal(reset3(c3), 0);
    assert_int_equal(fmi.enter3(c3, false, 0, 0, false, 0), 0);
    assert_int_equal(fmi.leave3(c3), 0);
    assert_int_equal(step3(c3, 0, 2), 0);
    fmi.free2(c2);
    fmi.free3(c3);
}

/* ---- Its life --------------------------------------------------------------------------------- */

static double tick(void *c, double t, double measurement)
{
    const unsigned y = 1, u = 3;
    double value = (double)NAN;
    assert_int_equal(fmi.set2(c, &y, 1, &measurement), 0);
    assert_int_equal(fmi.step2(c, t, 2, 1), 0);
    assert_int_equal(fmi.get2(c, &u, 1, &value), 0);
    return value;
}

static void set_setpoint(void *c, double value)
{
    assert_int_equal(fmi.set2(c, &(unsigned){2}, 1, &value), 0);
}

/* Without a measurement it holds, and after its hold it gives the fault value; it goes on when there is one. */
static void a_measurement_that_is_no_number_is_bad(void **state)
{
    void *const c = make2(first_order()), *const other = make3(first_order());
    (void)state;
    initialise(c, other, 0);
    set_setpoint(c, 10);
    const double first = tick(c, 0, 0), held = tick(c, 2, (double)NAN);
    assert_true(first == 2.0 && held == first);
    (void)tick(c, 4, HUGE_VAL);
    (void)tick(c, 6, (double)NAN);
    assert_true(tick(c, 8, (double)NAN) == 0.0);
    assert_true(said[0]);
    (void)tick(c, 10, 1);
    assert_true(tick(c, 12, 1) != 0.0);
    set_setpoint(c, (double)NAN);
    assert_true(isfinite(tick(c, 14, 1)) != 0);
    set_setpoint(c, 1e6);
    (void)tick(c, 16, 1);
    assert_has(said, "setpoint r refused: 1000000");
    fmi.free2(c);
    fmi.free3(other);
}

/* Promise(links/fmu-controller-life): Instances of one FMU do not know each other; after a reset one gives again what it gave
 *   first; modes, tuning and the output in Man can be set between steps. */
static void instances_are_alone_and_reset(void **state)
{
    const char *const folder = first_order();
    void *const c = make2(folder), *const other = make2(folder), *const third = make3(folder);
    const unsigned mode = 4, manual = 5, gain = 6;
    double before[5];

    (void)state;
    initialise(c, third, 3.5);
    set_setpoint(c, 10);
    for (int k = 0; k < 5; k++)
        before[k] = tick(c, 3.5 + 2 * k, k);
    assert_int_equal(fmi.setup2(other, 0, 0, 0, 0, 0), 0);
    assert_int_equal(fmi.enter2(other), 0);
    assert_int_equal(fmi.leave2(other), 0);
    set_setpoint(other, 10);
    assert_int_equal(fmi.reset2(c), 0);
    assert_int_equal(fmi.setup2(c, 0, 0, 0, 0, 0), 0);
    assert_int_equal(fmi.enter2(c), 0);
    assert_int_equal(fmi.leave2(c), 0);
    set_setpoint(c, 10);
    for (int k = 0; k < 5; k++) {
        assert_true(tick(c, 2 * k, k) == before[k]);
        assert_true(tick(other, 2 * k, k) == before[k]);
    }
    assert_int_equal(fmi.set_integer2(c, &mode, 1, &(int){APC_MODE_MAN}), 0);
    (void)tick(c, 10, 5);
    assert_int_equal(fmi.set2(c, &manual, 1, &(double){-4.5}), 0);
    assert_true(tick(c, 12, 5) == -4.5);
    assert_int_equal(fmi.set_integer2(c, &mode, 1, &(int){APC_MODE_AUTO}), 0);
    (void)tick(c, 14, 5);
    (void)tick(c, 16, 5);
    assert_int_equal(fmi.set_integer2(c, &mode, 1, &(int){APC_MODE_MAN}), 0);
    assert_true(tick(c, 18, 5) != -4.5);
    assert_int_equal(fmi.set2(c, &manual, 1, &(double){-4.5}),
                     0); /* as before, and not as the output is now */
    assert_true(tick(c, 20, 5) == -4.5);
    assert_int_equal(fmi.set2(other, &gain, 1, &(double){0.4}), 0);
    assert_true(tick(other, 10, 2) != before[2]);
    fmi.free2(c);
    fmi.free2(other);
    fmi.free3(third);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_controller_gives_what_it_gives_in_a_run),
        cmocka_unit_test(what_is_wrong_is_said),
        cmocka_unit_test(what_is_not_offered_is_refused),
        cmocka_unit_test(it_says_what_it_is),
        cmocka_unit_test(a_measurement_that_is_no_number_is_bad),
        cmocka_unit_test(instances_are_alone_and_reset),
    };
    return cmocka_run_group_tests(tests, load, NULL);
}
