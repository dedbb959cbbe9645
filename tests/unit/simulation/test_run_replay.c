/* SPDX-License-Identifier: BSD-3-Clause */
/* A run is simulated, kept in a folder, and repeated from there: all of each tick comes out again. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <sqlite3.h>

#include "check.h"
#include "scratch.h"

#include "modules/controller.h"
#include "simulation/simulation.h"

static struct replay replay;
static struct apc_error why;
static const char *own_law, *own_duration, *own_tuning; /* instead of those of the file; NULL: none is */

/* ---- Runs --------------------------------------------------------------------------------- */

static char *text_of(const char *name, const char *more)
{
    char path[300], *text = NULL;
    size_t size = 0;
    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, name);
    FILE *in = fopen(path, "r"), *out = open_memstream(&text, &size);
    assert_non_null(in);
    assert_non_null(out);
    for (int c = fgetc(in); c != EOF; c = fgetc(in))
        fputc(c, out);
    fputs(more, out);
    fclose(in);
    assert_int_equal(fclose(out), 0);
    return text;
}

static char *change_setting(char *text, const char *path, const char *value)
{
    char *changed = NULL;
    if (experiment_change(text, path, value, &changed, &why) < 0)
        fail_msg("%s: %s", path, why.text);
    free(text);
    return changed;
}

/* Simulate it; from @p from to @p until the laws have no time, and are late if they ask for it. */
static void make_run(const char *name, const char *more, const char *net, double from, double until)
{
    struct experiment e;
    struct simulation s;
    char *text = text_of(name, more);
    if (own_law)
        text = change_setting(change_setting(text, "controller.law", own_law), "duration", own_duration);
    if (own_law && own_tuning)
        text = change_setting(text, "controller.tuning", own_tuning);
    scratch_write("run.conf", text);
    free(text);
    if (experiment_load(&e, scratch_path("run.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        models_network(&e.models, net, &why) < 0 || simulation_create(&s, &e, 3, &why) < 0)
        fail_msg("%s: %s", name, why.text);
    if (from > 0)
        assert_int_equal(simulation_run(&s, from), 0);
    for (size_t i = 0; i < e.n_controllers && from > 0; i++)
        s.controller[i].core->budget = 0;
    if (from > 0)
        assert_int_equal(simulation_run(&s, until), 0);
    for (size_t i = 0; i < e.n_controllers && from > 0; i++)
        s.controller[i].core->budget = apc_ns_to_s(e.controllers[i].budget);
    assert_int_equal(simulation_run(&s, e.duration), 0);
    if (ticks_keep(scratch_folder(), s.store, &e, &(struct apc_range){0}, &why) < 0)
        fail_msg("%s: %s", name, why.text);
    simulation_destroy(&s);
    experiment_free(&e);
}

static void load(void)
{
    replay_free(&replay);
    if (replay_load(&replay, scratch_folder(), NULL, &why) < 0)
        fail_msg("%s", why.text);
}

static void run(void)
{
    if (replay_run(&replay, &(struct replay_watch){.ctx = NULL}) < 0)
        fail_msg("%s", replay.why.text);
}

static void assert_exact(const char *name)
{
    for (size_t i = 0; i < replay.e.n_controllers; i++) {
        const struct replay_controller *c = &replay.controller[i];
        assert_true(c->ticks.n > 30);
        if (c->figures.first[0] || c->figures.same != c->ticks.n)
            fail_msg("%s, %s: %s", name, c->of->name, c->figures.first);
    }
}

static int end(void **state)
{
    (void)state;
    own_law = NULL;
    replay_free(&replay);
    memset(&replay, 0, sizeof replay);
    return 0;
}

/* ---- Tests -------------------------------------------------------------------------------- */

#define BAD "loss=0.2,delay=gamma(2,0.05),outage=20-28"

/*
 * Promise(modes/law-looks-ahead)
 * Promise(simulation/every-tick-every): Every tick of every controller comes out of its record again, bit
 *   for bit, also late, after restarts, over bad networks; else the first that does not is named with its
 *   cause; so in virtual time.
 */
static void every_tick_comes_out_again_whatever_happened(void **state)
{
    static const struct {
        const char *name, *more, *net;
    } of[] = {
        {"first-order", "", ""},
        {"first-order",
         "actions = ( { at = 30.1; mode = \"u\"; value = \"Man\"; }, { at = 33.1; set = \"u\"; value = 1.5; "
         "},"
         " { at = 60.1; mode = \"u\"; value = \"Auto\"; }, { at = 80.1; set = \"Kp\"; value = 0.3; },"
         " { at = 100.1; kill = \"controller\"; }, { at = 101.0; start = \"controller\"; },"
         " { at = 120.1; kill = \"controller\"; }, { at = 150.1; start = \"controller\"; },"
         " { at = 170.1; mode = \"u\"; value = \"OOS\"; }, { at = 180.1; mode = \"u\"; value = \"Auto\"; } "
         ");",
         BAD},
        {"first-order", "clock = ( { at = 50.0; step = -30.0; }, { at = 90.0; step = 40.0; } );", "loss=0.3"},
        {"two-layers", "", ""},
        {"two-layers", "", BAD},
        {"double-tank", "", "loss=0.2"},
        {"double-tank-override",
         "actions = ( { at = 30.2; mode = \"u\"; value = \"Man\"; }, { at = 33.2; set = \"u\"; value = 7.5; "
         "},"
         " { at = 50.2; mode = \"u\"; value = \"Auto\"; }, { at = 70.2; mode = \"want\"; value = \"Man\"; },"
         " { at = 80.2; mode = \"want\"; value = \"Auto\"; }, { at = 100.2; kill = \"levels\"; },"
         " { at = 104.3; start = \"levels\"; }, { at = 110.2; kill = \"choose\"; },"
         " { at = 110.9; start = \"choose\"; }, { at = 150.2; kill = \"choose\"; }, { at = 170.3; start = "
         "\"choose\"; } );",
         BAD},
        {"quadruple-tank-mpc", "", "loss=0.2"},
        {"quadruple-tank-mpc",
         "actions = ( { at = 130.1; set = \"r1\"; value = 6.5; }, { at = 170.1; remote = \"r1\"; },"
         " { at = 200.1; kill = \"controller\"; }, { at = 202.0; start = \"controller\"; },"
         " { at = 230.1; local = \"r2\"; }, { at = 250.1; kill = \"controller\"; },"
         " { at = 290.0; start = \"controller\"; } );",
         BAD},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        make_run(of[i].name, of[i].more, of[i].net, 0, 0);
        load();
        run();
        assert_exact(of[i].name);
    }
}

/* Promise(simulation/every-tick-every) */
static void a_law_that_was_late_is_late_again(void **state)
{
    size_t late = 0;
    (void)state;
    make_run("quadruple-tank-mpc", "", "", 10, 700);
    load();
    const struct ticks *t = &replay.controller->ticks;
    run();
    for (size_t k = 0; k < t->n; k++)
        late +=
            (int)t->value[t->at[k].first + replay.controller->core->offset[APC_TICK_RESULT]] == APC_LAW_LATE;
    assert_true(late > 0);
    assert_exact("mpc");
}

/*
 * Promise(modes): A replay compares the ticks that are on record and says since when they are, where the
 *   store had no room for all.
 * Promise(simulation/every-tick-every)
 */
static void the_first_tick_that_differs_is_named_with_its_cause(void **state)
{
    (void)state;
    make_run("two-layers", "", "", 0, 0);
    load();
    struct replay_controller *base = replay.controller;
    run();
    const size_t x = base->core->offset[APC_TICK_X], tuning = base->core->offset[APC_TICK_TUNING];
    /* a number in the middle of the record */
    load();
    base = replay.controller;
    base->ticks.value[base->ticks.at[100].first + x] += 1e-9;
    run();
    assert_has(base->figures.first, "tick 100 at 50.040 s: x was ");
    assert_has(base->figures.first, "from the same inputs");
    assert_int_equal(base->figures.same, base->ticks.n - 2); /* and the one that would have gone on from it */
    assert_int_equal(replay.controller[1].figures.same, replay.controller[1].ticks.n);
    /* the same, and the record names another build */
    load();
    base = replay.controller;
    base->ticks.value[base->ticks.at[100].first + x] += 1e-9;
    snprintf(replay.other_build, sizeof replay.other_build, "the run was made by another CVODE");
    run();
    assert_has(base->figures.first, ": the run was made by another CVODE");
    assert_null(strstr(base->figures.first, "damaged"));
    /* what a store without room has overwritten: the rest is compared all the same */
    load();
    base = replay.controller;
    base->ticks.n -= 100;
    memmove(base->ticks.at, base->ticks.at + 100, base->ticks.n * sizeof *base->ticks.at);
    const size_t later = base->ticks.at[50].first + x;
    run();
    assert_true(base->figures.begins > 0 && base->figures.begins == base->ticks.at[0].time);
    assert_string_equal(base->figures.first, "");
    assert_int_equal(base->figures.same, base->ticks.n - 1);
    load();
    base = replay.controller;
    base->ticks.n -= 100;
    memmove(base->ticks.at, base->ticks.at + 100, base->ticks.n * sizeof *base->ticks.at);
    base->ticks.value[later] += 1e-9;
    run();
    assert_has(base->figures.first, "tick 150 at 75.040 s: x was ");
    /* another law */
    load();
    base = replay.controller;
    for (size_t k = 0; k < base->ticks.n; k++)
        base->ticks.value[base->ticks.at[k].first + 1] += 1;
    run();
    assert_has(base->figures.first, "tick 0 at 0.040 s: mark was ");
    assert_has(base->figures.first, "not those that ran");
    /* a row that a tick names is gone */
    load();
    base = replay.controller;
    for (size_t i = 0; i < replay.samples.n; i++)
        if (replay.samples.at[i].table == APC_TUNING && replay.samples.at[i].id == 1)
            replay.samples.at[i].seq = 9;
    base->ticks.value[base->ticks.at[0].first + tuning] += 1;
    run();
    assert_has(base->figures.first, "tick 0 at 0.040 s: tuning was ");
    assert_has(base->figures.first, "tuning.1 seq 1 is not on record");
}

/*
 * Promise(simulation/every-tick-mutants): A law whose output, or one of whose parameters, is another in its last bit is
 *   found by a replay of its record.
 */
static void a_law_that_differs_in_one_bit_is_found(void **state)
{
    static const struct {
        const char *law, *name, *duration, *tuning;
    } of[] = {
        {"\"pi\"", "first-order", "200.0", NULL},
        {"\"pid\"", "quadruple-tank", "100.0", NULL},
        {"\"lqg\"", "van-de-vusse", "3000.0", NULL},
        {"\"mpc\"", "quadruple-tank-mpc", "100.0", NULL},
        {"\"nmpc\"", "adiabatic-cstr-nmpc", "200.0", NULL},
        {"\"" APC_EXAMPLES_DIR "/mylaw.so\"", "first-order", "200.0", "( { Kp = 0.2; tau_i = 10.0; } )"}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        own_law = of[i].law;
        own_duration = of[i].duration;
        own_tuning = of[i].tuning;
        make_run(of[i].name, "", "", 0, 0);
        load();
        const struct replay_controller *c = replay.controller;
        run();
        assert_exact(of[i].law);
        const size_t u = c->core->offset[APC_TICK_U], n = c->ticks.n, k = n / 2;
        load();
        c = replay.controller;
        double *output = &c->ticks.value[c->ticks.at[k].first + u];
        *output = nextafter(*output, HUGE_VAL);
        run();
        assert_has(c->figures.first, " u was ");
        assert_true(c->figures.same < n && c->figures.same + 3 > n);
        load();
        c = replay.controller;
        size_t tunings = 0;
        for (size_t q = 0; q < replay.samples.n && tunings == 0; q++)
            if (replay.samples.at[q].table == APC_TUNING && (tunings = 1))
                replay.samples.at[q].value = nextafter(replay.samples.at[q].value, HUGE_VAL);
        assert_int_equal(tunings, 1);
        run();
        assert_has(c->figures.first, "tick 0 ");
        assert_int_equal(c->figures.same, 0);
    }
}

/* Promise(simulation/every-tick-every) */
static void in_virtual_time_the_first_tick_that_differs_is_named(void **state)
{
    (void)state;
    make_run("two-layers", "", "", 0, 0);
    load();
    assert_int_equal(replay_virtual(&replay), 0);
    assert_exact("in virtual time");
    load();
    struct replay_controller *upper = &replay.controller[1];
    upper->ticks.value[upper->ticks.at[7].first + 2] += 1; /* its index */
    assert_int_equal(replay_virtual(&replay), 0);
    assert_has(upper->figures.first, "a tick before it is not on record: it was missed");
    assert_int_equal(upper->figures.same, 7);
    make_run("two-layers", "", "loss=0.3", 0, 0); /* which the folder does not say */
    load();
    assert_int_equal(replay_virtual(&replay), 0);
    assert_has(replay.controller->figures.first, ": a measurement was ");
}

/* Promise(simulation/every-tick-every) */
static void a_folder_without_ticks_is_of_a_former_version(void **state)
{
    (void)state;
    make_run("first-order", "", "", 0, 0);
    remove(scratch_path(TICKS_FILE));
    assert_int_equal(replay_load(&replay, scratch_folder(), NULL, &why), APC_ENOTFOUND);
    assert_has(why.text, "a run of a former version is replayed by that version");
    replay_free(&replay);
    scratch_write(TICKS_FILE,
                  "no database at all, but long enough to look like one, if nobody looks closely");
    assert_true(replay_load(&replay, scratch_folder(), NULL, &why) < 0);
    assert_has(why.text, TICKS_FILE);
}

/* A stall of the disk is a lock that somebody holds for longer than a tick may take. */
static void *let_go(void *ctx)
{
    const struct timespec stall = {.tv_sec = 2, .tv_nsec = 500000000};

    nanosleep(&stall, NULL);
    return sqlite3_exec(ctx, "ROLLBACK", NULL, NULL, NULL) == SQLITE_OK ? ctx : NULL;
}

static void a_disk_that_stalls_is_waited_for(void **state)
{
    sqlite3 *other;
    pthread_t holder;
    void *gone;
    (void)state;

    make_run("first-order", "", "", 0, 0);
    assert_int_equal(sqlite3_open(scratch_path(TICKS_FILE), &other), SQLITE_OK);
    assert_int_equal(sqlite3_exec(other, "BEGIN EXCLUSIVE", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(pthread_create(&holder, NULL, let_go, other), 0);
    load();
    assert_int_equal(pthread_join(holder, &gone), 0);
    assert_non_null(gone);
    assert_int_equal(sqlite3_close(other), SQLITE_OK);
    run();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(every_tick_comes_out_again_whatever_happened, end),
        cmocka_unit_test_teardown(a_law_that_was_late_is_late_again, end),
        cmocka_unit_test_teardown(the_first_tick_that_differs_is_named_with_its_cause, end),
        cmocka_unit_test_teardown(a_law_that_differs_in_one_bit_is_found, end),
        cmocka_unit_test_teardown(in_virtual_time_the_first_tick_that_differs_is_named, end),
        cmocka_unit_test_teardown(a_folder_without_ticks_is_of_a_former_version, end),
        cmocka_unit_test_teardown(a_disk_that_stalls_is_waited_for, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
