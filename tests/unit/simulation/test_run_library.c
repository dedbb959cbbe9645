/* SPDX-License-Identifier: BSD-3-Clause */
/* apcrun.h: an experiment is loaded, changed and simulated, with an operator, by a program that knows no
 * more. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"

#include <apcrun.h>

#define EXAMPLE APC_EXAMPLES_DIR "/example_run"

static const char text[] = "# the paper's loop\n"
                           "name = \"first-order\"; duration = 600.0;\n"
                           "measurements = ( { name = \"y\"; } );\n"
                           "setpoints = ( { name = \"r\"; low = -100.0; high = 100.0; } );\n"
                           "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; } );\n"
                           "plant = { model = \"first-order\"; period = 0.2; };\n"
                           "client = { period = 0.5; };\n"
                           "controller = { law = \"pi\"; period = 2.0; };\n"
                           "scheduler = { period = 150.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };\n";

static struct apc_experiment *load(const char *more)
{
    char whole[2000];
    struct apc_experiment *e;
    struct apc_error why;
    snprintf(whole, sizeof whole, "%s%s", text, more);
    if (apc_experiment_load(&e, "here.conf", whole, &why) < 0)
        fail_msg("%s", why.text);
    return e;
}

static struct apc_simulation *simulate(const struct apc_experiment *e)
{
    struct apc_simulation *s;
    struct apc_error why;
    if (apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    return s;
}

static double value_of(const struct apc_simulation *s, const char *name)
{
    struct apc_value value;
    if (apc_simulation_read(s, name, &value) < 0)
        fail_msg("%s has no value", name);
    return value.value;
}

/* Of all samples; what differs in one bit differs here. */
static int mix(void *ctx, const struct apc_sample *sample)
{
    uint64_t *hash = ctx, bits;
    memcpy(&bits, &sample->value, sizeof bits);
    *hash = (*hash ^ bits ^ (uint64_t)sample->time) * UINT64_C(1099511628211);
    return 0;
}

static uint64_t hash_of(struct apc_simulation *s)
{
    static const enum apc_table tables[] = {APC_SETPOINT, APC_SENSOR, APC_ACTUATOR};
    uint64_t hash = UINT64_C(14695981039346656037);
    for (size_t i = 0; i < 3; i++)
        assert_true(apc_store_history(apc_simulation_store(s), tables[i], 1, NULL, mix, &hash) > 0);
    return hash;
}

/* ---- Experiments --------------------------------------------------------------------------- */

static void what_is_wrong_is_said_with_its_line(void **state)
{
    struct apc_experiment *e = (struct apc_experiment *)(void *)&e;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_experiment_load(&e, "here.conf", "name = \"x\";\nname = 3;", &why), APC_EINVAL);
    assert_null(e);
    assert_ptr_equal(strstr(why.text, "here.conf:2: "), why.text);
    assert_int_equal(apc_experiment_load(&e, "/nowhere.conf", NULL, &why), APC_ENOTFOUND);
    assert_null(e);
    apc_experiment_destroy(NULL);
    apc_simulation_destroy(NULL);
}

/* Promise(simulation/library-experiment) */
static void the_text_is_as_it_was_written_until_it_is_changed(void **state)
{
    struct apc_experiment *e = load(""), *again;
    char is[4000], twice[4000], small[8] = "1234567";
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_experiment_text(e, is, sizeof is), sizeof text - 1);
    assert_string_equal(is, text);
    assert_int_equal(apc_experiment_text(e, small, sizeof small), sizeof text - 1);
    assert_string_equal(small, "# the p");
    assert_int_equal(apc_experiment_set(e, "duration", "300.25", &why), 0);
    const int64_t length = apc_experiment_text(e, is, sizeof is);
    assert_int_equal(length, strlen(is));
    assert_non_null(strstr(is, "duration = 300.25;"));
    if (apc_experiment_load(&again, "here.conf", is, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_experiment_set(again, "duration", "300.25", &why), 0);
    apc_experiment_text(again, twice, sizeof twice);
    assert_string_equal(twice, is); /* what was written can be read, and is the same then */
    apc_experiment_destroy(again);
    apc_experiment_destroy(e);
}

/*
 * Promise(simulation/library-experiment): The library: an experiment is changed by path or left as it was;
 *   a simulation in steps, operated, is that at once, with the file's actions, bit for bit.
 */
static void a_setting_is_changed_by_its_path(void **state)
{
    static const struct {
        const char *path, *value, *seen;
    } change[] = {{"title", "A \"loop\" of mine", "title = \"A \\\"loop\\\" of mine\""},
                  {"title", "\"quoted\"", "title = \"quoted\""},
                  {"title", "7", "title = \"7\""}, /* text stays text */
                  {"seed", "9007199254740992L", "seed = 9007199254740992L"},
                  {"measurements.y.noise", "1e-3", "{ name = \"y\"; noise = 0.001; }"},
                  {"measurements.[0].noise", "0.25 # a quarter", "noise = 0.25"},
                  {"outputs.u.high", "9.5", "high = 9.5"},
                  {"controller.mode", "Man", "mode = \"Man\""},
                  {"controller.Kp", "0.3", "tuning = ({ Kp = 0.3; })"},
                  {"controller.u.tau_i", "12", "{ Kp = 0.3; tau_i = 12; }"},
                  {"controller.tuning.[0].Kp", "0.35", "Kp = 0.35"},
                  {"scheduler.sequence.[1].[0]", "21.5", "([10.0], [21.5], [5.0], [15.0])"},
                  {"scheduler.sequence.[2].[0]", "21",
                   "([10.0], [21.5], [21.0], [15.0])"}, /* one of an array of floats */
                  {"scheduler.sequence", "([1.0])", "sequence = ([1.0])"},
                  {"scheduler.repeat", "false", "repeat = false"},
                  {"plant.parameters", "{ tau = 5.0; }", "parameters = { tau = 5.0; }"},
                  {"plant.parameters.K", "3.0", "{ tau = 5.0; K = 3.0; }"},
                  {"network", "{ loss = 0.1; }", "network = { loss = 0.1; }"},
                  {"plant.noise.x", "0.5", "noise = { x = 0.5; }"}, /* groups that are not there are made */
                  {"controller.limits.Kp", "[0.0, 1.0]", "limits = { Kp = [0.0, 1.0]; }"},
                  {"plant.atol", "3000000000000", "atol = 3000000000000.0"},
                  {"plant.atol", "1e-9", "atol = 1e-09"},
                  {"plant.parameters.K", "normal(3, 0.1)", "K = \"normal(3, 0.1)\""},
                  {"plant.parameters.K", "3.5", "K = 3.5"}, /* a distribution is no text that stays one */
                  {"actions", "({ at = 1.0; set = \"r\"; value = 3.0; })",
                   "actions = ({ at = 1.0; set = \"r\"; value = 3.0; })"}};
    struct apc_experiment *e = load("");
    struct apc_error why;
    char is[4000];
    (void)state;
    for (size_t i = 0; i < sizeof change / sizeof *change; i++) {
        if (apc_experiment_set(e, change[i].path, change[i].value, &why) < 0)
            fail_msg("%s", why.text);
        apc_experiment_text(e, is, sizeof is);
        if (!strstr(is, change[i].seen))
            fail_msg("no \"%s\" after %s = %s: %s", change[i].seen, change[i].path, change[i].value, is);
    }
    apc_experiment_destroy(e);
}

/* Promise(simulation/library-experiment) */
static void a_controller_of_several_is_changed_by_name(void **state)
{
    static const char layers[] =
        "name = \"layers\"; measurements = ( { name = \"y1\"; }, { name = \"y2\"; } );"
        "setpoints = ( { name = \"r1\"; initial = 1.0; }, { name = \"r2\"; initial = 1.0; }, { name = "
        "\"w1\"; } );"
        "outputs = ( { name = \"v1\"; }, { name = \"v2\"; } );"
        "plant = { model = \"quadruple-tank\"; period = 0.1; }; client = { period = 0.1; };"
        "controllers = ( { name = \"base\"; law = \"pi\"; period = 0.5; measurements = [\"y1\", \"y2\"]; "
        "setpoints = "
        "[\"r1\", \"r2\"]; outputs = [\"v1\", \"v2\"]; }, { name = \"upper\"; law = \"pi\"; period = 5.0; "
        "measurements = [\"y1\"]; setpoints = [\"w1\"]; outputs = [\"r1\"]; } );"
        "scheduler = { period = 9.0; sequence = ( [1.0, 1.0] ); };";
    struct apc_experiment *e;
    struct apc_simulation *s;
    struct apc_error why;
    char is[4000];
    (void)state;
    if (apc_experiment_load(&e, "layers.conf", layers, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_experiment_set(e, "controllers.base.v2.Kp", "2.5", &why), 0);
    assert_int_equal(apc_experiment_set(e, "controllers.upper.Kp", "0.5", &why), 0);
    assert_int_equal(apc_experiment_set(e, "controllers.upper.outputs", "[\"r2\"]", &why), 0);
    assert_int_equal(apc_experiment_set(e, "controllers.upper.hold", "9", &why), 0);
    apc_experiment_text(e, is, sizeof is);
    assert_non_null(strstr(is, "tuning = ({ }, { Kp = 2.5; })"));
    assert_non_null(strstr(is, "outputs = [\"r2\"]; tuning = ({ Kp = 0.5; }); hold = 9; }"));
    assert_int_equal(apc_experiment_set(e, "controllers.upper.r1.Kp", "1", &why), APC_ENOTFOUND);
    assert_string_equal(why.text,
                        "controllers.upper.r1.Kp: there is no \"r1\" in controllers.upper; there are "
                        "r2: did you mean \"r2\"?");
    assert_int_equal(apc_experiment_set(e, "controllers.lower.Kp", "1", &why), APC_ENOTFOUND);
    assert_string_equal(why.text,
                        "controllers.lower.Kp: there is no \"lower\" in controllers; there are base, upper");
    assert_int_equal(apc_experiment_set(e, "controllers.base.Kp", "1", &why), APC_ENOTFOUND);
    assert_string_equal(why.text,
                        "controllers.base.Kp: there is no \"Kp\" in controllers.base; there are v1, v2");
    assert_int_equal(apc_experiment_set(e, "controllers.upper.outputs.[0]", "v1", &why), APC_EINVAL);
    assert_string_equal(
        why.text,
        "controllers.upper.outputs.[0] = v1: \"v1\" is an output of two controllers, base and upper");
    assert_int_equal(apc_simulation_create(&s, e, NULL, &why), 0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/*
 * Promise(simulation/set-file-would)
 * Promise(simulation/library-experiment)
 */
static void what_cannot_be_changed_leaves_all_as_it_was(void **state)
{
    static const struct {
        const char *path, *value;
        int rc;
        const char *reason;
    } mistake[] = {{"", "1", APC_ENOTFOUND, "\"\": there is no \"\" in the file; there are name, "},
                   {"nothing.at.all", "1", APC_EINVAL, "unknown setting \"nothing\" in the file"},
                   {"plnat.period", "1", APC_EINVAL, "did you mean \"plant\"?"},
                   {"plant.paramters.K", "1", APC_EINVAL, "did you mean \"parameters\"?"},
                   {"plant.bad name.K", "1", APC_ENOTFOUND, "there is no \"bad name\" in plant"},
                   {"plant..K", "1", APC_ENOTFOUND, "there is no \"\" in plant"},
                   {"controllers.base.Kp", "1", APC_ENOTFOUND,
                    "there is no \"controllers\" in the file; there are name, duration, measurements, "
                    "setpoints, outputs, plant, client, controller, scheduler: did you mean \"controller\"?"},
                   {"measurements.z.noise", "1", APC_ENOTFOUND,
                    "measurements.z.noise: there is no \"z\" in measurements; there are y"},
                   {"measurements.[1].noise", "1", APC_ENOTFOUND, "there is no \"[1]\" in measurements"},
                   {"scheduler.sequence.[7]", "1", APC_ENOTFOUND,
                    "there is no \"[7]\" in scheduler.sequence; there are [0] to [3]"},
                   {"controller.v.Kp", "1", APC_ENOTFOUND, "there is no \"v\" in controller"},
                   {"duration.x", "1", APC_ENOTFOUND, "duration.x: there is no \"x\" in duration"},
                   {"plant.parameters.K", "normal(3", APC_EINVAL, "normal("},
                   {"plant.parameters.tau", "normal(-5, 1)", APC_EINVAL, "\"tau\" has a mean of -5: must be"},
                   {"duration", "-1", APC_EINVAL, "duration = -1: \"duration\" is -1: must be from 0"},
                   {"duration", "long", APC_EINVAL, "must be a finite number"},
                   {"duration", "1; seed = 2", APC_EINVAL, "must be a finite number"},
                   {"duration", "", APC_EINVAL, "must be a finite number"},
                   {"plant.period", "0", APC_EINVAL, "plant.period = 0: \"period\" of plant"},
                   {"plant.perid", "1", APC_EINVAL, "did you mean \"period\"?"},
                   {"controller.Kb", "1", APC_EINVAL, "did you mean \"Kp\"?"},
                   {"controller.law", "nonsense", APC_ENOTFOUND, "nonsense"},
                   {"outputs", "( )", APC_EINVAL, "must name 1 to"}};
    struct apc_experiment *e = load("");
    struct apc_error why;
    char is[4000];
    (void)state;
    for (size_t i = 0; i < sizeof mistake / sizeof *mistake; i++) {
        int rc = apc_experiment_set(e, mistake[i].path, mistake[i].value, &why);
        if (rc >= 0 || !strstr(why.text, mistake[i].reason))
            fail_msg("%s = %s: %d, %s", mistake[i].path, mistake[i].value, rc, why.text);
        apc_experiment_text(e, is, sizeof is);
        assert_string_equal(is, text);
    }
    apc_experiment_destroy(e);
}

/*
 * Promise(laws/tuned-value-stays): A tuned value stays when a store is set up again, unless its number is
 *   another parameter now.
 */
static void a_store_is_described_once_and_is_no_other_s_then(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_store *store;
    struct apc_error why;
    struct apc_sample kp = {.table = APC_TUNING, .id = 1};
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:test-run", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0);
    if (apc_experiment_provision(e, store, 0, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_experiment_set(e, "controller.Kp", "0.7", &why), 0);
    assert_int_equal(apc_experiment_provision(e, store, 0, &why), 0);
    assert_true(apc_store_read(store, &kp, 1) >= 0);
    assert_int_equal(kp.seq, 1); /* what is there stays */
    assert_int_equal(apc_experiment_provision(e, store, 1, &why), 0);
    assert_true(apc_store_read(store, &kp, 1) >= 0);
    assert_near(kp.value, 0.7, 0);
    char in_force[4096], there[4096];
    int64_t revision;
    assert_true(apc_experiment_text(e, in_force, sizeof in_force) < (int64_t)sizeof in_force);
    assert_true(apc_store_catalogue(store, there, sizeof there, &revision) > 0);
    assert_string_equal(there, in_force);
    assert_int_equal(revision, 2); /* the third time nothing was new */
    assert_int_equal(apc_experiment_set(e, "measurements.y.name", "x", &why), 0);
    assert_int_equal(apc_experiment_provision(e, store, 1, &why), APC_EPERM);
    assert_non_null(strstr(why.text, "another experiment"));
    apc_store_close(store);
    apc_experiment_destroy(e);
}

/* Number 3 of pi is u_bar, of pid tau_d: what was tuned as the one is no value of the other. */
/* Promise(laws/tuned-value-stays) */
static void a_number_that_is_another_parameter_now_does_not_keep_its_value(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_store *store;
    struct apc_error why;
    struct apc_sample tuned[] = {{.table = APC_TUNING, .id = 1, .value = 0.9},
                                 {.table = APC_TUNING, .id = 3, .value = 1.5}};
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:test-renamed", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0);
    assert_int_equal(apc_experiment_provision(e, store, 0, &why), 0);
    assert_true(apc_store_put(store, tuned, 2) >= 0);
    if (apc_experiment_set(e, "controller.law", "pid", &why) < 0)
        fail_msg("%s", why.text);
    for (int again = 0; again < 2; again++) {
        if (apc_experiment_provision(e, store, 0, &why) < 0)
            fail_msg("%s", why.text);
        assert_true(apc_store_read(store, tuned, 2) >= 0);
        assert_near(tuned[0].value, 0.9, 0); /* Kp both times */
        assert_near(tuned[1].value, again ? 2.5 : 0.0, 0);
        tuned[1].value = 2.5; /* of tau_d: stays the next time */
        assert_true(again || apc_store_put(store, &tuned[1], 1) >= 0);
    }
    apc_store_close(store);
    apc_experiment_destroy(e);
}

/* ---- Simulations --------------------------------------------------------------------------- */

/* Promise(simulation/library-experiment) */
static void in_steps_it_is_the_same_as_at_once(void **state)
{
    struct apc_experiment *e = load("network = { loss = 0.2; };");
    struct apc_simulation *whole = simulate(e), *steps = simulate(e);
    (void)state;
    assert_int_equal(apc_simulation_run(whole, 0), 0);
    for (double t = 0.1; t < 600; t += 7.3)
        assert_int_equal(apc_simulation_run(steps, t), 0);
    assert_int_equal(apc_simulation_run(steps, 20), 0); /* past */
    assert_true(apc_simulation_time(steps) > 590);
    assert_int_equal(apc_simulation_run(steps, 600), 0);
    assert_true(apc_simulation_time(steps) == 600);
    assert_int_equal(hash_of(whole), hash_of(steps));
    apc_simulation_destroy(whole);
    apc_simulation_destroy(steps);
    apc_experiment_destroy(e);
}

/* Promise(simulation/library-experiment) */
static void a_simulation_keeps_the_experiment_it_began_with(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_simulation *a = simulate(e), *b;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_experiment_set(e, "controller.Kp", "0.9", &why), 0);
    b = simulate(e);
    apc_experiment_destroy(e);
    assert_int_equal(apc_simulation_run(a, 0), 0);
    assert_int_equal(apc_simulation_run(b, 0), 0);
    assert_near(value_of(a, "Kp"), 0.2, 0);
    assert_near(value_of(b, "Kp"), 0.9, 0);
    assert_true(hash_of(a) != hash_of(b));
    apc_simulation_destroy(a);
    apc_simulation_destroy(b);
}

/* The same by the library's calls and by the file's list, bit for bit. */
/* Promise(simulation/library-experiment) */
static void an_operator_does_what_the_file_s_actions_do(void **state)
{
    struct apc_experiment *plain = load(""),
                          *acting = load("actions = ( { at = 100.5; mode = \"u\"; value = \"Man\"; },\n"
                                         " { at = 110.5; set = \"u\"; value = 1.5; },\n"
                                         " { at = 120.5; set = \"r\"; value = 12.0; },\n"
                                         " { at = 120.5; set = \"Kp\"; value = 0.1; },\n"
                                         " { at = 120.5; mode = \"controller\"; value = \"Auto\"; } );");
    struct apc_simulation *s = simulate(plain), *listed = simulate(acting);
    (void)state;
    assert_int_equal(apc_simulation_run(s, 100.5), 0);
    assert_int_equal(apc_simulation_mode(s, "u", APC_MODE_MAN), 0);
    assert_int_equal(apc_simulation_run(s, 110.5), 0);
    const double held = value_of(s, "u");
    assert_int_equal(apc_simulation_write(s, "u", 1.5), 0);
    assert_int_equal(apc_simulation_run(s, 120.5), 0);
    assert_near(value_of(s, "u"), 1.5, 0);
    assert_true(fabs(held - 1.5) > 0.1);
    assert_int_equal(apc_simulation_write(s, "r", 12.0), 0);
    assert_int_equal(apc_simulation_write(s, "Kp", 0.1), 0);
    assert_int_equal(apc_simulation_mode(s, "controller", APC_MODE_AUTO), 0);
    assert_int_equal(apc_simulation_run(s, 149), 0);
    assert_near(value_of(s, "r"), 12, 0);
    assert_near(value_of(s, "y"), 12, 3);
    assert_int_equal(apc_simulation_run(s, 0), 0);
    assert_int_equal(apc_simulation_run(listed, 0), 0);
    assert_int_equal(hash_of(s), hash_of(listed));
    apc_simulation_destroy(s);
    apc_simulation_destroy(listed);
    apc_experiment_destroy(plain);
    apc_experiment_destroy(acting);
}

/* A segment whose descriptions or catalogue the experiment overflows is left as it was. */
static void refused_before_a_row(const struct apc_experiment *e, const char *reason)
{
    struct apc_store *store;
    struct apc_error why;
    char uri[60], path[60];
    snprintf(uri, sizeof uri, "shm:tiny-%d?size=1", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.tiny-%d", (int)getpid());
    assert_int_equal(apc_store_open(&store, uri, NULL, NULL), 0);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_experiment_provision(e, store, true, &why), APC_ESTORE);
    assert_non_null(strstr(why.text, reason));
    assert_int_equal(apc_store_variables(store, NULL, 0), 0);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), 0);
    apc_store_close(store);
    assert_int_equal(unlink(path), 0);
}

static void what_is_too_small_for_an_experiment_gets_none_of_it(void **state)
{
    static char remark[18000], whole[sizeof remark + sizeof text];
    struct apc_experiment *e;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/hundred-loops.conf", NULL, &why),
                     0);
    refused_before_a_row(e, "holds 64 tags at most");
    apc_experiment_destroy(e);
    memset(remark, '#', sizeof remark - 2);
    snprintf(whole, sizeof whole, "%s%s\n", text, remark);
    assert_int_equal(apc_experiment_load(&e, "here.conf", whole, &why), 0);
    refused_before_a_row(e, "holds a catalogue of less than");
    apc_experiment_destroy(e);
}

/* What an operator writes at the instant of a tick is there before anything else happens. */
/* Promise(experiment/actions-taken-time) */
static void an_operator_comes_before_the_tick_of_the_same_instant(void **state)
{
    struct apc_experiment *e = load("actions = ( { at = 0.03; set = \"r\"; value = 3.0; },\n"
                                    " { at = 150.0; set = \"r\"; value = 4.0; } );");
    struct apc_simulation *s = simulate(e);
    (void)state;
    assert_int_equal(apc_simulation_run(s, 0.031), 0); /* the controller's first tick */
    assert_near(value_of(s, "u"), 0.2 * 3.0, 1e-12);
    assert_int_equal(apc_simulation_run(s, 151), 0);
    assert_near(value_of(s, "r"), 4, 0); /* the scheduler, which came after, stands aside */
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* How often an event of this text was told. */
struct told {
    const char *text;
    int n;
};

static int count_event(void *ctx, const struct apc_event *event)
{
    struct told *t = ctx;
    t->n += strcmp(event->text, t->text) == 0;
    return 0;
}

static int times(struct apc_simulation *s, const char *event)
{
    struct told t = {event, 0};
    assert_true(apc_store_events(apc_simulation_store(s), NULL, count_event, &t) >= 0);
    return t.n;
}

/* Steps are 10, 20, 5 and 15, of 150 s each. */
/* Promise(modes/scheduled-setpoint) */
static void what_an_operator_sets_is_his_until_he_gives_it_back(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_simulation *s = simulate(e);
    (void)state;
    assert_int_equal(apc_simulation_run(s, 100.5), 0);
    assert_int_equal(apc_simulation_write(s, "r", 12), 0);
    assert_int_equal(times(s, "r is Local: its steps are not written"), 1);
    assert_int_equal(apc_simulation_run(s, 400), 0);
    assert_near(value_of(s, "r"), 12, 0);
    assert_int_equal(times(s, "r is Local: its steps are not written"), 1); /* said once */
    assert_int_equal(apc_simulation_write(s, "r", 13), 0);
    assert_int_equal(apc_simulation_do(s, "remote", "r"), 0);
    assert_near(value_of(s, "r"), 5, 0); /* the step that is due, at once */
    assert_int_equal(times(s, "r is Remote: its steps are written again"), 1);
    assert_int_equal(apc_simulation_do(s, "local", "setpoint.1"), 0);
    assert_int_equal(apc_simulation_run(s, 460), 0);
    assert_near(value_of(s, "r"), 5, 0);
    assert_int_equal(apc_simulation_do(s, "local", "r"), 0); /* it is already */
    assert_near(value_of(s, "r"), 5, 0);
    assert_int_equal(apc_simulation_do(s, "remote", "r"), 0);
    assert_near(value_of(s, "r"), 15, 0);
    assert_int_equal(apc_simulation_do(s, "remote", "q"), APC_ENOTFOUND);
    assert_int_equal(apc_simulation_do(s, "promote", "r"), APC_ENOTFOUND); /* no controller */
    assert_int_equal(apc_simulation_do(s, "elope", "r"), APC_EINVAL);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

#define TANKS                                                                                                \
    APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf" /* steps at 200, 400, 600 s, looks 15 s ahead */
#define REACTOR APC_SOURCE_DIR "/experiments/adiabatic-cstr-nmpc.conf"

/* Steps of its setpoints, and a law that looks ahead or does not. */
static struct apc_simulation *predicting(const char *file, const char *preview)
{
    struct apc_experiment *e;
    struct apc_error why;
    if (apc_experiment_load(&e, file, NULL, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.setpoint_preview", preview, &why) < 0)
        fail_msg("%s", why.text);
    struct apc_simulation *s = simulate(e);
    apc_experiment_destroy(e);
    return s;
}

static double iae_of(struct apc_simulation *s)
{
    struct apc_figure f[1] = {{.size = sizeof *f}};
    assert_int_equal(apc_simulation_run(s, 0), 0);
    assert_true(apc_simulation_figures(s, f, 1) > 0);
    return f->iae;
}

/* Promise(modes/law-looks-ahead) */
static void what_is_to_come_is_foreseen(void **state)
{
    struct apc_simulation *seeing = predicting(REACTOR, "1"), *blind = predicting(REACTOR, "0");
    (void)state;
    assert_true(iae_of(seeing) < 0.75 * iae_of(blind));
    apc_simulation_destroy(seeing);
    apc_simulation_destroy(blind);
}

/* A setpoint that is the operator's will stay as it is; given back, it has a future again. */
/* Promise(modes/law-looks-ahead) */
static void what_an_operator_took_has_no_future(void **state)
{
    struct apc_simulation *s = predicting(TANKS, "1"), *blind = predicting(TANKS, "0");
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct apc_simulation *one = i ? blind : s;
        assert_int_equal(apc_simulation_run(one, 100.5), 0);
        assert_int_equal(apc_simulation_do(one, "local", "r1"), 0);
        assert_int_equal(apc_simulation_do(one, "local", "r2"), 0);
        assert_int_equal(apc_simulation_run(one, 190.5), 0);
    }
    assert_near(value_of(s, "v1"), value_of(blind, "v1"), 0);
    assert_int_equal(apc_simulation_do(s, "remote", "r1"), 0);
    assert_int_equal(apc_simulation_do(blind, "remote", "r1"), 0);
    assert_int_equal(apc_simulation_run(s, 192.5), 0);
    assert_int_equal(apc_simulation_run(blind, 192.5), 0);
    assert_true(fabs(value_of(s, "v1") - value_of(blind, "v1")) > 0.01);
    apc_simulation_destroy(s);
    apc_simulation_destroy(blind);
}

/* Promise(modes/law-looks-ahead) */
static void a_restart_between_two_ticks_forgets_no_plan(void **state)
{
    struct apc_simulation *calm = predicting(TANKS, "1"), *restarted = predicting(TANKS, "1");
    (void)state;
    assert_int_equal(apc_simulation_run(calm, 195.5), 0);
    assert_int_equal(apc_simulation_run(restarted, 195.5), 0);
    assert_int_equal(apc_simulation_do(restarted, "kill", "controller"), 0);
    assert_int_equal(apc_simulation_do(restarted, "start", "controller"), 0);
    for (int k = 0; k < 20; k++) {
        assert_int_equal(apc_simulation_run(calm, 196.5 + k), 0);
        assert_int_equal(apc_simulation_run(restarted, 196.5 + k), 0);
        assert_near(value_of(restarted, "v1"), value_of(calm, "v1"), 0);
        assert_near(value_of(restarted, "v2"), value_of(calm, "v2"), 0);
    }
    apc_simulation_destroy(calm);
    apc_simulation_destroy(restarted);
}

static void before_its_first_step_a_scheduler_may_be_told_to_stand_aside(void **state)
{
    struct apc_experiment *e = load("actions = ( { at = 0.0; set = \"r\"; value = 3.0; },\n"
                                    " { at = 310.0; remote = \"r\"; }, { at = 320.0; local = \"r\"; } );");
    struct apc_simulation *s = simulate(e);
    (void)state;
    assert_int_equal(apc_simulation_run(s, 309), 0);
    assert_near(value_of(s, "r"), 3, 0);
    assert_int_equal(apc_simulation_run(s, 311), 0);
    assert_near(value_of(s, "r"), 5, 0);
    assert_int_equal(apc_simulation_run(s, 0), 0);
    assert_near(value_of(s, "r"), 5, 0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

static void what_an_operator_may_not_do_is_refused(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_simulation *s = simulate(e);
    struct apc_value value;
    (void)state;
    assert_int_equal(apc_simulation_read(s, "y", &value), APC_ENOTFOUND); /* nothing yet */
    assert_int_equal(apc_simulation_run(s, 10), 0);
    assert_int_equal(apc_simulation_write(s, "q", 1), APC_ENOTFOUND);
    assert_int_equal(apc_simulation_write(s, "y", 1), APC_ENOTFOUND);
    assert_non_null(strstr(apc_simulation_error(s), "\"y\""));
    assert_int_equal(apc_simulation_write(s, "r", 100.5), APC_ERANGE);
    assert_int_equal(apc_simulation_write(s, "r", (double)NAN), APC_EINVAL);
    assert_int_equal(apc_simulation_write(s, "u", -11), APC_ERANGE);
    assert_int_equal(apc_simulation_mode(s, "controller", APC_MODE_LO), APC_EINVAL);
    assert_int_equal(apc_simulation_mode(s, "controller", (enum apc_mode)99), APC_EINVAL);
    assert_int_equal(apc_simulation_mode(s, "v", APC_MODE_MAN), APC_ENOTFOUND);
    assert_int_equal(apc_simulation_read(s, "q", &value), APC_ENOTFOUND);
    assert_int_equal(apc_simulation_run(s, -1), APC_EINVAL);
    assert_int_equal(apc_simulation_run(s, (double)NAN), APC_EINVAL);
    assert_int_equal(apc_simulation_run(s, HUGE_VAL), APC_EINVAL);
    assert_int_equal(apc_simulation_run(s, 20), 0); /* none of it has ended the simulation */
    assert_near(value_of(s, "r"), 10, 0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

static void options_of_another_size_are_refused(void **state)
{
    struct apc_experiment *e = load("network = { loss = 0.3; };");
    struct apc_simulation_options options = {.seed = 5};
    struct apc_simulation *s, *other;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_simulation_create(&s, e, &options, &why), APC_EINVAL);
    assert_null(s);
    options.size = sizeof options;
    assert_int_equal(apc_simulation_create(&s, e, &options, &why), 0);
    other = simulate(e);
    assert_int_equal(apc_simulation_run(s, 60), 0);
    assert_int_equal(apc_simulation_run(other, 60), 0);
    assert_true(hash_of(s) != hash_of(other)); /* another seed */
    apc_simulation_destroy(s);
    apc_simulation_destroy(other);
    apc_experiment_destroy(e);
}

/* ---- Figures ------------------------------------------------------------------------------- */

/* Promise(simulation/library-experiment) */
static void figures_come_by_loop_and_event(void **state)
{
    struct apc_experiment *e = load("");
    struct apc_simulation *s = simulate(e);
    struct apc_figure f[8] = {{.size = sizeof *f}}, wrong[1] = {{.size = 8}};
    double sum = 0;
    (void)state;
    assert_int_equal(apc_simulation_run(s, 200.5), 0);
    assert_int_equal(apc_simulation_figures(s, NULL, 0), 3);
    assert_int_equal(apc_simulation_figures(s, wrong, 1), APC_EINVAL);
    assert_int_equal(apc_simulation_figures(s, f, 1), 3);
    assert_string_equal(f[0].event, "all");
    assert_int_equal(f[1].size, 0); /* no more than there is room for */
    f[0].size = sizeof *f;
    assert_int_equal(apc_simulation_figures(s, f, 8), 3);
    assert_string_equal(f[0].loop, "y");
    assert_near(f[0].until, 200.5, 0);
    assert_string_equal(f[1].event, "start-up");
    assert_string_equal(f[2].event, "r 10 -> 20");
    assert_near(f[2].from, 150, 1e-9);
    assert_true(isnan(f[2].peak) && f[2].settling > 0);
    for (int i = 1; i < 3; i++)
        sum += f[i].iae;
    assert_near(f[0].iae, sum, 1e-9);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(simulation/library-experiment) */
static void the_example_prints_its_figures(void **state)
{
    char line[200] = "", all[2000] = "";
    (void)state;
    FILE *out = popen(EXAMPLE " " APC_SOURCE_DIR "/experiments/first-order.conf", "r");
    assert_non_null(out);
    while (fgets(line, sizeof line, out))
        snprintf(all + strlen(all), sizeof all - strlen(all), "%s", line);
    assert_int_equal(pclose(out), 0);
    assert_non_null(strstr(all, "y  r 10 -> 12   from 120.5 s: IAE "));
    assert_null(strstr(all, "r 12 -> ")); /* it is Local from then on */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_wrong_is_said_with_its_line),
        cmocka_unit_test(the_text_is_as_it_was_written_until_it_is_changed),
        cmocka_unit_test(a_setting_is_changed_by_its_path),
        cmocka_unit_test(a_controller_of_several_is_changed_by_name),
        cmocka_unit_test(what_cannot_be_changed_leaves_all_as_it_was),
        cmocka_unit_test(a_store_is_described_once_and_is_no_other_s_then),
        cmocka_unit_test(a_number_that_is_another_parameter_now_does_not_keep_its_value),
        cmocka_unit_test(in_steps_it_is_the_same_as_at_once),
        cmocka_unit_test(a_simulation_keeps_the_experiment_it_began_with),
        cmocka_unit_test(an_operator_does_what_the_file_s_actions_do),
        cmocka_unit_test(what_is_too_small_for_an_experiment_gets_none_of_it),
        cmocka_unit_test(an_operator_comes_before_the_tick_of_the_same_instant),
        cmocka_unit_test(what_an_operator_sets_is_his_until_he_gives_it_back),
        cmocka_unit_test(what_is_to_come_is_foreseen),
        cmocka_unit_test(what_an_operator_took_has_no_future),
        cmocka_unit_test(a_restart_between_two_ticks_forgets_no_plan),
        cmocka_unit_test(before_its_first_step_a_scheduler_may_be_told_to_stand_aside),
        cmocka_unit_test(what_an_operator_may_not_do_is_refused),
        cmocka_unit_test(options_of_another_size_are_refused),
        cmocka_unit_test(figures_come_by_loop_and_event),
        cmocka_unit_test(the_example_prints_its_figures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
