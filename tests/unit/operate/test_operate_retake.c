/* SPDX-License-Identifier: BSD-3-Clause */
/* What people had set at a past instant, written once more, over every kind of store. */
#include <stdlib.h>
#include <string.h>

#include "experiment/experiment.h"
#include "operate/operate.h"
#include "stores.h"

/* r is moved by the loop above, or by people; w is the scheduler's, or people's. */
static const char plant_text[] =
    "name = \"taken\"; duration = 10.0;\n"
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0; } );\n"
    "setpoints = ( { name = \"r\"; low = -50.0; high = 50.0; initial = 1.0; },\n"
    "              { name = \"w\"; low = -50.0; high = %s; initial = 5.0; confirm = 10.0; } );\n"
    "outputs = ( { name = \"u\"; low = -20.0; high = 20.0; } );\n"
    "plant = { model = \"first-order\"; period = 0.1; };\n"
    "client = { period = 0.1; };\n"
    "scheduler = { period = 10.0; setpoints = [\"w\"]; sequence = ( [5.0], [6.0] ); };\n"
    "controllers = (\n"
    "  { name = \"base\"; law = \"%s\"; period = 0.5; mode = \"Cas\"; measurements = [\"y\"];\n"
    "    setpoints = [\"r\"]; outputs = [\"u\"]; tuning = ( { Kp = 0.2; tau_i = 1.0; %s } ); },\n"
    "  { name = \"upper\"; law = \"pi\"; period = 1.0; measurements = [\"y\"]; setpoints = [\"w\"];\n"
    "    outputs = [\"r\"]; tuning = ( { Kp = 0.3; tau_i = 2.0; } ); } );\n";

enum { LOOP_U = 1, SET_R = 1, SET_W = 2, KP = 1, TAU_I = 2 };

static struct apc_store *store;
static struct known_plant plant;
static struct change_fault why;
static struct operation taken;

static void describe(const char *high, const char *law, const char *more)
{
    char text[sizeof plant_text + 100];
    struct apc_error error;
    struct experiment e;
    snprintf(text, sizeof text, plant_text, high, law, more);
    const struct experiment_source source = {.file = "test", .text = text};
    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &error) < 0)
        fail_msg("%s", error.text);
    ok(store, provision(store, &e, PROVISION_KEEP));
    experiment_free(&e);
    known_free(&plant);
    ok(store, known_load(&plant, store));
}

static int begin_plant(void **state)
{
    const int rc = stores_set_up(state);
    store = *state;
    if (rc == 0)
        describe("50.0", "pi", "");
    return rc;
}

static int end_plant(void **state)
{
    operation_end(&taken);
    free(taken.change);
    taken = (struct operation){.plant = NULL};
    known_free(&plant);
    return stores_tear_down(state);
}

/* An instant at which nothing happens, and behind which what comes is later. */
static apc_ns instant(void)
{
    const apc_ns at = apc_clock_utc(NULL);
    while (apc_clock_utc(NULL) < at + 20000)
        ;
    return at + 10000;
}

static void wrote(const char *name, unsigned kind, double value)
{
    struct change change;
    struct change_target to;
    if (change_find(&plant.view, name, kind, &to, &why) < 0)
        fail_msg("%s", why.text);
    change_make(&plant.view, &to, value, &change);
    struct operation o = {
        .plant = &plant.view, .change = &change, .n = 1, .author = "anna", .confirmed = true};
    ok(store, operation_read(&o, store));
    if (operation_begin(&o, store, &why) < 0)
        fail_msg("%s", why.text);
    operation_end(&o);
}

static bool keeps_descriptions(void)
{
    return strncmp(store_kind->name, "mem:", 4) != 0 && strncmp(store_kind->name, "shm:", 4) != 0;
}

/* Returns "", or the code of why not, with the sentence in why; the changes in `taken`. */
static const char *take(apc_ns at, const char *name)
{
    struct apc_store *past = NULL;
    struct apc_error error;
    struct apc_tag *then = NULL;
    size_t n = 0;
    if (apc_store_past(&past, store, at, &error) < 0 ||
        experiment_tags_then(past, store, NULL, &then, &n, &error) < 0)
        fail_msg("%s", error.text);
    free(taken.change);
    taken = (struct operation){.plant = &plant.view, .author = "otto", .note = " (as of)"};
    why = (struct change_fault){.code = ""};
    const struct retake of = {.past = past, .tag = then, .n = n, .name = &name, .n_names = name ? 1 : 0};
    const int rc = operation_retake(&taken, store, &of, &why);
    assert_true((rc < 0) == (why.code[0] != '\0') && rc == why.err);
    free(then);
    apc_store_close(past);
    return why.code;
}

static const char *put(void)
{
    ok(store, operation_read(&taken, store));
    (void)operation_begin(&taken, store, &why);
    operation_end(&taken);
    return why.code;
}

static double value_of(enum apc_table table, int id)
{
    return newest(store, table, id).value;
}

static bool is_of(const char *name, double now, double then)
{
    for (size_t i = 0; i < taken.n; i++)
        if (!strcmp(taken.change[i].to.name, name))
            return taken.change[i].before.value == now && taken.change[i].after.value == then;
    return false;
}

static int take_last_event(void *ctx, const struct apc_event *event)
{
    snprintf(ctx, 256, "%s: %s", event->source, event->text);
    return 0;
}

/* Promise(run/values-taken-again): Tuning, modes and setpoints of a past instant are shown beside those of now and written
 *   again in one transaction, under the name of who does, or not at all. */
static void test_what_was_set_is_shown_and_written_again_as_one(void **state)
{
    (void)state;
    wrote("u", CHANGE_MODE, APC_MODE_AUTO);
    wrote("r", CHANGE_SETPOINT, 12);
    wrote("u.Kp", CHANGE_TUNING, 0.4);
    const apc_ns at = instant();
    assert_string_equal(take(at, NULL), "");
    assert_int_equal(taken.n, 0); /* nothing differs */
    wrote("u.Kp", CHANGE_TUNING, 0.9);
    wrote("r", CHANGE_SETPOINT, 3);
    wrote("u", CHANGE_MODE, APC_MODE_MAN);
    assert_string_equal(take(at, NULL), "");
    assert_int_equal(taken.n, 3);
    assert_true(is_of("u.Kp", 0.9, 0.4) && is_of("r", 3, 12) && is_of("u", APC_MODE_MAN, APC_MODE_AUTO));
    assert_true(value_of(APC_TUNING, KP) == 0.9);
    assert_string_equal(put(), "");
    assert_true(value_of(APC_TUNING, KP) == 0.4 && value_of(APC_SETPOINT, SET_R) == 12.0 &&
                value_of(APC_OPMODE, LOOP_U) == (double)APC_MODE_AUTO);
    const struct apc_sample kp = newest(store, APC_TUNING, KP), r = newest(store, APC_SETPOINT, SET_R);
    char name[APC_AUTHOR_LEN], event[256] = "";
    ok(store, apc_store_author_name(store, kp.author, name));
    assert_string_equal(name, "otto");
    assert_true(kp.time == r.time);
    const struct apc_range last = {.last = 1};
    ok(store, apc_store_events(store, &last, take_last_event, event));
    assert_non_null(strstr(event, "otto: "));
    assert_non_null(strstr(event, " (as of)"));
    assert_string_equal(take(at, NULL), "");
    assert_int_equal(taken.n, 0);
}

/* Promise(run/values-taken-again) */
static void test_what_others_moved_then_is_theirs_again(void **state)
{
    (void)state;
    const apc_ns at = instant(); /* r is that of the loop above, w the scheduler's */
    wrote("r", CHANGE_SETPOINT, 12);
    wrote("w", CHANGE_SETPOINT, 8);
    const apc_ns local = instant();
    assert_string_equal(take(at, NULL), "");
    assert_int_equal(taken.n, 2);
    assert_true(is_of("u", APC_MODE_AUTO, APC_MODE_CAS) && is_of("w.owner", 0, 1));
    assert_string_equal(put(), "");
    const struct apc_sample owner = newest(store, APC_OPMODE, LOOPS_OWNER(SET_W));
    assert_false(loops_is_local(&owner));
    assert_true(value_of(APC_SETPOINT, SET_R) == 12.0 && value_of(APC_SETPOINT, SET_W) == 8.0);
    assert_string_equal(take(local, NULL), ""); /* and people's once more, whatever they have moved it to */
    assert_true(is_of("r", 12, 12) && is_of("w", 8, 8) && is_of("u", APC_MODE_CAS, APC_MODE_AUTO));
    assert_string_equal(put(), "");
    assert_true(value_of(APC_OPMODE, LOOP_U) == (double)APC_MODE_AUTO);
}

/* Promise(run/values-taken-again) */
static void test_of_some_alone_nothing_else_is_written(void **state)
{
    (void)state;
    wrote("u.Kp", CHANGE_TUNING, 0.4);
    wrote("upper.r.Kp", CHANGE_TUNING, 0.5);
    const apc_ns at = instant();
    wrote("u.Kp", CHANGE_TUNING, 0.6);
    wrote("u.tau_i", CHANGE_TUNING, 9);
    wrote("upper.r.Kp", CHANGE_TUNING, 0.7);
    static const struct {
        const char *name;
        size_t n;
    } of[] = {{"u.Kp", 1}, {"u", 2}, {"base", 2}, {"upper", 1}, {"upper.r", 1}, {"w", 0}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        assert_string_equal(take(at, of[i].name), "");
        if (taken.n != of[i].n)
            fail_msg("%s: %zu differ instead of %zu", of[i].name, taken.n, of[i].n);
    }
    assert_string_equal(take(at, "v"), "variable");
    assert_non_null(strstr(why.text, "there is no loop or controller \"v\""));
}

/* Promise(run/values-taken-again) */
static void test_what_cannot_be_written_now_is_named_and_nothing_is(void **state)
{
    (void)state;
    wrote("u", CHANGE_MODE, APC_MODE_AUTO);
    wrote("w", CHANGE_SETPOINT, 40);
    const apc_ns at = instant();
    wrote("w", CHANGE_SETPOINT, 5);
    wrote("u.Kp", CHANGE_TUNING, 0.6);
    assert_string_equal(take(at, NULL), "");
    assert_string_equal(put(), "confirm"); /* a great step */
    assert_true(value_of(APC_TUNING, KP) == 0.6);
    assert_string_equal(take(at, NULL), "");
    wrote("u.Kp", CHANGE_TUNING, 0.7);
    taken.confirmed = true;
    assert_string_equal(put(), "stale");
    assert_string_equal(why.text, "u.Kp was changed meanwhile: it is 0.7 now");
    assert_true(value_of(APC_SETPOINT, SET_W) == 5.0);
    assert_string_equal(take(1000 * APC_NS_PER_S, NULL), "value");
    assert_non_null(strstr(why.text, "nothing that people set is on record as of 1970-01-01T00:16:40"));
    if (!keeps_descriptions())
        return;
    describe("20.0", "pi", "");
    assert_string_equal(take(at, NULL), "limits");
    assert_string_equal(why.text, "w = 40 lies outside its limits -50 to 20");
    assert_int_equal(taken.n == 0 || value_of(APC_TUNING, KP) == 0.7, 1);
}

/* Promise(run/values-taken-again) */
static void test_a_setpoint_alone_waits_for_its_mode(void **state)
{
    (void)state;
    wrote("u", CHANGE_MODE, APC_MODE_AUTO);
    wrote("r", CHANGE_SETPOINT, 12);
    const apc_ns at = instant();
    wrote("r", CHANGE_SETPOINT, 3);
    wrote("u", CHANGE_MODE, APC_MODE_MAN);
    assert_string_equal(take(at, "r"), "mode");
    assert_string_equal(why.text, "r follows y while u is in Man");
}

/* By its name, not by its number: other parameters have that now. */
static void test_a_parameter_that_is_gone_is_named(void **state)
{
    (void)state;
    if (!keeps_descriptions())
        return;
    describe("50.0", "pid", "tau_d = 3.0;");
    wrote("u.tau_d", CHANGE_TUNING, 4);
    const apc_ns at = instant();
    describe("50.0", "pi", "");
    wrote("u.Kp", CHANGE_TUNING, 0.7);
    assert_string_equal(take(at, NULL), "variable");
    assert_non_null(strstr(why.text, " was described as of "));
    assert_non_null(strstr(why.text, ", and is not any more: leave it out"));
    assert_string_equal(take(at, "u.Kp"), "");
    assert_true(taken.n == 1 && is_of("u.Kp", 0.7, 0.2));
}

/* A store in memory does not know what a number was before it was described anew, so it writes none. */
static void test_without_its_description_an_instant_is_refused(void **state)
{
    (void)state;
    if (keeps_descriptions())
        return;
    struct apc_store *past = NULL;
    struct apc_error error;
    struct apc_tag *then = NULL;
    size_t n = 0;
    describe("50.0", "pid", "tau_d = 3.0;");
    wrote("u.tau_d", CHANGE_TUNING, 4);
    const apc_ns at = instant();
    describe("50.0", "pi", "");
    ok(store, apc_store_past(&past, store, at, &error));
    assert_int_equal(experiment_tags_then(past, store, NULL, &then, &n, &error), APC_ENOTFOUND);
    assert_non_null(strstr(error.text, "how the experiment was described then is not on record"));
    assert_null(then);
    apc_store_close(past);
}

#undef T
#define T(name) cmocka_unit_test_setup_teardown(name, begin_plant, end_plant)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_what_was_set_is_shown_and_written_again_as_one),
        T(test_what_others_moved_then_is_theirs_again),
        T(test_of_some_alone_nothing_else_is_written),
        T(test_what_cannot_be_written_now_is_named_and_nothing_is),
        T(test_a_setpoint_alone_waits_for_its_mode),
        T(test_a_parameter_that_is_gone_is_named),
        T(test_without_its_description_an_instant_is_refused),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
