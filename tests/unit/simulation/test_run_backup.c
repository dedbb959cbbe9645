/* SPDX-License-Identifier: BSD-3-Clause */
/* A predictive law that has no time gives way to its backup law, in the shipped experiment, and comes back. */
/* Promise(modes/law-act-gives) */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "scratch.h"

#include "modules/controller.h"
#include "simulation/simulation.h"

#include <apcrun.h>

#define MOST (20.0 * 5.0 * (1.0 + 1e-12)) /* a pump moves in a tick */

static const char tanks[] = APC_SOURCE_DIR "/experiments/four-tank-mpc.conf";
static struct apc_error why;

/* ---- Without time ------------------------------------------------------------------------------- */

static int find_event(void *ctx, const struct apc_event *event)
{
    const char **wanted = ctx; /* in this order; found ones go */
    if (*wanted[0] && strstr(event->text, wanted[0]))
        memmove(wanted, wanted + 1, 2 * sizeof *wanted);
    return 0;
}

/* From 900 s to 1200 s it is given no time, which it wants from the step of setpoint 2 on. */
static void it_gives_way_to_pid_and_comes_back_and_the_levels_follow(void **state)
{
    const char *wanted[] = {"the backup law acts: law mpc", "the law acts again", ""};
    struct experiment e;
    struct simulation s;
    double before[2] = {300, 300};
    unsigned backup = 0;
    (void)state;
    if (experiment_load(&e, tanks, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&s, &e, 1, &why) < 0)
        fail_msg("%s", why.text);
    for (double t = 5; t <= 1500; t += 5) {
        struct apc_controller *c = s.controller[0].core;
        c->budget = t > 900 && t <= 1200 ? 0 : 2.5;
        assert_int_equal(simulation_run(&s, t), 0);
        for (size_t i = 0; i < 2; i++) {
            const enum apc_loop_state is = c->state[i].loop.state;
            assert_true(is == APC_LOOP_AUTO || is == APC_LOOP_BACKUP);
            assert_true(fabs(c->u[i] - before[i]) <= MOST);
            before[i] = c->u[i];
            backup += is == APC_LOOP_BACKUP;
            if (t > 1020 && t <= 1060)
                assert_int_equal(is, APC_LOOP_BACKUP);
            if (t <= 900 || t > 1230)
                assert_int_equal(is, APC_LOOP_AUTO);
        }
    }
    assert_true(backup >= 16);
    assert_near(s.controller[0].core->y[0], 60, 0.3);
    assert_near(s.controller[0].core->y[1], 95, 0.3);
    assert_true(apc_store_events(s.store, NULL, find_event, wanted) > 0);
    assert_string_equal(wanted[0], "");
    simulation_destroy(&s);
    experiment_free(&e);
}

static void a_run_with_its_backup_law_is_replayed_bit_for_bit(void **state)
{
    struct experiment e;
    struct simulation s;
    struct replay replay;
    char *text = NULL;
    (void)state;
    assert_int_equal(experiment_load(&e, tanks, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why), 0);
    text = e.text;
    scratch_write("run.conf", text);
    assert_int_equal(simulation_create(&s, &e, e.seed, &why), 0);
    assert_int_equal(simulation_run(&s, 900), 0);
    s.controller[0].core->budget = 0;
    assert_int_equal(simulation_run(&s, 1200), 0);
    s.controller[0].core->budget = 2.5;
    assert_int_equal(simulation_run(&s, 1500), 0);
    assert_int_equal(ticks_keep(scratch_folder(), s.store, &e, &(struct apc_range){0}, &why), 0);
    simulation_destroy(&s);
    experiment_free(&e);
    if (replay_load(&replay, scratch_folder(), NULL, &why) < 0 ||
        replay_run(&replay, &(struct replay_watch){.ctx = NULL}) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(replay.controller->figures.first, "");
    assert_int_equal(replay.controller->ticks.n, 300);
    assert_int_equal(replay.controller->figures.same, 300);
    replay_free(&replay);
}

/* ---- As a library has it -------------------------------------------------------------------------- */

static struct apc_experiment *load(void)
{
    struct apc_experiment *e;
    if (apc_experiment_load(&e, tanks, NULL, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.iterations", "1", &why) < 0 ||
        apc_experiment_set(e, "controller.settings.setpoint_preview", "0", &why) <
            0 || /* it is surprised by steps */
        apc_experiment_set(e, "controller.shed_after", "2", &why) < 0)
        fail_msg("%s", why.text);
    return e;
}

static struct apc_simulation *simulate(const struct apc_experiment *e, double until)
{
    struct apc_simulation *s;
    if (apc_simulation_create(&s, e, NULL, &why) < 0 || apc_simulation_run(s, until) < 0)
        fail_msg("%s", why.text);
    return s;
}

static bool in_backup(struct apc_simulation *s)
{
    struct apc_sample mode = {.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, 1)};
    assert_int_equal(apc_store_read(apc_simulation_store(s), &mode, 1), 0);
    assert_near(mode.value, APC_MODE_AUTO, 0);
    return mode.status == APC_GOOD_LOCAL_OVERRIDE;
}

static int mix(void *ctx, const struct apc_sample *sample)
{
    uint64_t *hash = ctx, bits;
    memcpy(&bits, &sample->value, sizeof bits);
    *hash = (*hash ^ bits ^ (uint64_t)sample->seq) * UINT64_C(1099511628211);
    return 0;
}

static uint64_t hash_of(struct apc_simulation *s)
{
    uint64_t hash = UINT64_C(14695981039346656037);
    for (int id = 1; id <= 2; id++)
        assert_true(apc_store_history(apc_simulation_store(s), APC_ACTUATOR, id, NULL, mix, &hash) > 0);
    return hash;
}

static void a_restart_between_two_ticks_in_backup_leaves_no_trace(void **state)
{
    struct apc_experiment *e = load();
    struct apc_simulation *whole = simulate(e, 521), *killed = simulate(e, 521);
    (void)state;
    assert_true(in_backup(killed));
    assert_int_equal(apc_simulation_do(killed, "kill", "controller"), 0);
    assert_int_equal(apc_simulation_do(killed, "start", "controller"), 0);
    assert_int_equal(apc_simulation_run(whole, 1300), 0);
    assert_int_equal(apc_simulation_run(killed, 1300), 0);
    assert_true(hash_of(whole) == hash_of(killed));
    apc_simulation_destroy(whole);
    apc_simulation_destroy(killed);
    apc_experiment_destroy(e);
}

static void its_parameters_have_names_of_their_own(void **state)
{
    struct apc_experiment *e = load();
    struct apc_simulation *s = simulate(e, 521), *tuned = simulate(e, 521);
    struct apc_value value;
    (void)state;
    assert_int_equal(apc_simulation_read(s, "F2.backup.Kp", &value), 0);
    assert_near(value.value, 18, 0);
    assert_int_equal(apc_simulation_write(tuned, "F1.backup.Kp", 10), 0);
    assert_int_equal(apc_simulation_run(s, 560), 0);
    assert_int_equal(apc_simulation_run(tuned, 560), 0);
    assert_true(in_backup(s));
    assert_true(hash_of(s) != hash_of(tuned));
    apc_simulation_destroy(s);
    apc_simulation_destroy(tuned);
    apc_experiment_destroy(e);
}

/* ---- What is refused -------------------------------------------------------------------------------- */

static void must_fail(const char *path, const char *value, const char *text)
{
    struct apc_experiment *e;
    if (apc_experiment_load(&e, tanks, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_experiment_set(e, path, value, &why) < 0);
    if (!strstr(why.text, text))
        fail_msg("%s = %s: %s", path, value, why.text);
    apc_experiment_destroy(e);
}

static void what_makes_no_sense_is_refused_with_a_sentence(void **state)
{
    struct apc_experiment *e;
    (void)state;
    must_fail("controller.backup", "{ tuning = ( { }, { } ); }", "\"law\" is missing");
    must_fail("controller.backup.law", "\"./mine.so\"", "must be a built-in one, such as \"pid\"");
    must_fail("controller.backup.law", "\"pdi\"", "pdi");
    must_fail("controller.backup.hold", "3.0", "hold");
    must_fail("controller.backup.tuning", "( { Kp = 1.0; } )", "one group for each of the 2 outputs");
    must_fail("controller.backup.limits", "{ Kp = [0.0, 1.0]; }", "outside its \"limits\"");
    must_fail("controller.backup.settings", "{ nonsense = 1.0; }", "nonsense");
    must_fail("controller.backup.law", "\"lqg\"", "lqg");
    must_fail("controller.shed_after", "0", "shed_after");
    must_fail("controller.shed_after", "1.5", "shed_after");
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/two-layers.conf", NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_experiment_set(e, "controllers.upper.backup", "{ law = \"pid\"; }", &why) < 0);
    assert_non_null(strstr(why.text, "what upper moves are setpoints of loops that go on by themselves"));
    apc_experiment_destroy(e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_gives_way_to_pid_and_comes_back_and_the_levels_follow),
        cmocka_unit_test(a_run_with_its_backup_law_is_replayed_bit_for_bit),
        cmocka_unit_test(a_restart_between_two_ticks_in_backup_leaves_no_trace),
        cmocka_unit_test(its_parameters_have_names_of_their_own),
        cmocka_unit_test(what_makes_no_sense_is_refused_with_a_sentence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
