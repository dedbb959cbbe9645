/* SPDX-License-Identifier: BSD-3-Clause */
/* The shipped experiments of several controllers: what each of them is there to show. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "simulated.h"

#include <apcrun.h>

#define LOOPS 100

static const char layers[] = APC_SOURCE_DIR "/experiments/two-layers.conf";
static const char predictive[] = APC_SOURCE_DIR "/experiments/two-layers-mpc.conf";
static const char hundred[] = APC_SOURCE_DIR "/experiments/hundred-loops.conf";

/* ---- Runs --------------------------------------------------------------------------------- */

static struct apc_experiment *load(const char *file)
{
    struct apc_experiment *e;
    struct apc_error why;
    if (apc_experiment_load(&e, file, NULL, &why) < 0)
        fail_msg("%s", why.text);
    return e;
}

static void set(struct apc_experiment *e, const char *path, const char *value)
{
    struct apc_error why;
    if (apc_experiment_set(e, path, value, &why) < 0)
        fail_msg("%s", why.text);
}

static struct apc_simulation *create(const struct apc_experiment *e)
{
    struct apc_simulation *s;
    struct apc_error why;
    if (apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    return s;
}

/* Rows of a variable, as they came. */
struct rows {
    struct apc_sample *at;
    size_t n;
};

static int keep(void *ctx, const struct apc_sample *sample)
{
    struct rows *r = ctx;
    r->at = reallocarray(r->at, r->n + 1, sizeof *r->at);
    assert_non_null(r->at);
    r->at[r->n++] = *sample;
    return 0;
}

static struct rows history(struct apc_simulation *s, enum apc_table table, int id)
{
    struct rows r = {NULL, 0};
    assert_true(apc_store_history(apc_simulation_store(s), table, id, NULL, keep, &r) >= 0);
    return r;
}

/* Bit for bit. */
static bool same(const struct apc_sample *a, const struct apc_sample *b)
{
    return memcmp(&a->value, &b->value, sizeof a->value) == 0 && a->status == b->status && a->time == b->time;
}

/* ---- Two layers --------------------------------------------------------------------------- */

enum { V1 = 1, V2, UPPER_R1, UPPER_R2 }; /* loops */

/* The largest step of a variable between two rows of @p from <= t < until. */
static double largest_step(struct apc_simulation *s, enum apc_table table, int id, double from, double until)
{
    struct rows r = history(s, table, id);
    const apc_ns zero = r.at[0].time;
    double largest = 0;
    for (size_t i = 1; i < r.n; i++) {
        const double t = apc_ns_to_s(r.at[i].time - zero);
        if (t >= from && t < until)
            largest = fmax(largest, fabs(r.at[i].value - r.at[i - 1].value));
    }
    free(r.at);
    return largest;
}

/*
 * Promise(modes/cascade-closes-opens): A cascade closes, opens, sheds and is taken up again without a step;
 *   a loop in Man follows its operator.
 */
static void the_cascade_closes_without_a_step(void **state)
{
    struct apc_experiment *e = load(layers);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 4.9); /* nobody has answered yet */
    assert_int_equal(mode_of(s, V1), APC_MODE_AUTO);
    assert_int_equal(mode_of(s, UPPER_R1), APC_MODE_IMAN);
    run(s, 11); /* two periods of the one above */
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_CAS);
    for (int loop = UPPER_R1; loop <= UPPER_R2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    for (int k = 1; k <= 2; k++) {
        assert_true(largest_step(s, APC_SETPOINT, k, 0, 11) < 1e-9);
        assert_true(largest_step(s, APC_ACTUATOR, k, 1, 11) < 1e-4); /* the level is not quite at rest */
    }
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(modes/cascade-closes-opens) */
static void a_loop_in_man_follows_its_operator_and_comes_back_without_a_step(void **state)
{
    struct apc_experiment *e = load(layers);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 130);
    assert_int_equal(mode_of(s, V1), APC_MODE_CAS);
    assert_int_equal(mode_of(s, V2), APC_MODE_MAN);
    assert_int_equal(mode_of(s, UPPER_R2), APC_MODE_IMAN);
    assert_near(newest(s, APC_ACTUATOR, 2).value, 3.4, 0);
    /* its setpoint goes along with its measurement */
    assert_near(newest(s, APC_SETPOINT, 2).value, newest(s, APC_SENSOR, 2).value, 0.01);
    run(s, 195);
    assert_int_equal(mode_of(s, V2), APC_MODE_CAS);
    assert_int_equal(mode_of(s, UPPER_R2), APC_MODE_AUTO);
    assert_true(largest_step(s, APC_ACTUATOR, 2, 180.2, 195) < 0.1);
    assert_true(largest_step(s, APC_SETPOINT, 2, 180.2, 195) < 0.25 + 1e-9); /* 0.05 V/s, 5 s */
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(modes/cascade-closes-opens) */
static void a_controller_that_is_killed_is_shed_and_taken_up_again(void **state)
{
    struct apc_experiment *e = load(layers);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 382.1);
    assert_int_equal(mode_of(s, V1), APC_MODE_CAS);
    run(s, 380.031 + 15.1 + 0.51); /* its last row, 3 of its periods + 100 ms, one of the lower ones */
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    const struct apc_sample kept = newest(s, APC_SETPOINT, 2);
    run(s, 441.1); /* w2 stepped at 400 s, and nobody moved r2 */
    assert_near(newest(s, APC_SETPOINT, 4).value, 5.3915, 0);
    assert_near(newest(s, APC_SETPOINT, 2).value, kept.value, 0);
    assert_true(largest_step(s, APC_ACTUATOR, 1, 381, 441) < 0.05);
    run(s, 452);
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_CAS);
    assert_true(largest_step(s, APC_SETPOINT, 1, 441, 451) < 1e-9);
    assert_true(largest_step(s, APC_ACTUATOR, 2, 441, 450) < 0.05);
    run(s, 690); /* and goes where it is wanted */
    assert_near(newest(s, APC_SENSOR, 2).value, 5.3915, 0.1);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(modes/cascade-closes-opens) */
static void an_operator_takes_a_setpoint_and_gives_it_back(void **state)
{
    struct apc_experiment *e = load(layers);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 715);
    assert_near(newest(s, APC_OPMODE, V1).value, APC_MODE_AUTO, 0);
    assert_int_equal(mode_of(s, V1), APC_MODE_AUTO);
    assert_int_equal(mode_of(s, V2), APC_MODE_CAS);
    assert_near(newest(s, APC_SETPOINT, 1).value, 6.5, 0);
    assert_int_equal(newest(s, APC_SETPOINT, 1).origin, 0);
    run(s, 735);
    assert_int_equal(mode_of(s, V1), APC_MODE_CAS);
    assert_true(newest(s, APC_SETPOINT, 1).origin > 0);
    /* the library does what the file can */
    assert_int_equal(apc_simulation_mode(s, "base", APC_MODE_OOS), 0);
    assert_int_equal(apc_simulation_mode(s, "upper.r1", APC_MODE_CAS), APC_EINVAL);
    assert_int_equal(apc_simulation_do(s, "kill", "upper"), 0);
    assert_int_equal(apc_simulation_do(s, "kill", "upper"), 0); /* who is dead already */
    assert_int_equal(apc_simulation_do(s, "kill", "uper"), APC_ENOTFOUND);
    assert_int_equal(apc_simulation_do(s, "stop", "upper"), APC_EINVAL);
    run(s, 740);
    assert_int_equal(mode_of(s, V2), APC_MODE_OOS);
    assert_int_equal(apc_simulation_do(s, "start", "upper"), 0);
    assert_int_equal(apc_simulation_do(s, "start", "upper"), 0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Killed at any of these instants and started again within its period, nothing is other than if it had lived. */
/* Promise(modes/bad-measurement-leaves) */
static void a_restart_between_two_ticks_leaves_no_trace(void **state)
{
    static const double at[] = {0.01, 5.0, 12.0, 100.0, 200.5};
    (void)state;
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        struct apc_experiment *e = load(layers);
        struct apc_simulation *s[2] = {create(e), create(e)};
        for (int k = 0; k < 2; k++) {
            run(s[k], at[i]);
            for (int j = 0; j < k; j++) {
                assert_int_equal(apc_simulation_do(s[k], "kill", "upper"), 0);
                assert_int_equal(apc_simulation_do(s[k], "start", "upper"), 0);
                assert_int_equal(apc_simulation_do(s[k], "kill", "base"), 0);
                assert_int_equal(apc_simulation_do(s[k], "start", "base"), 0);
            }
            run(s[k], at[i] + 100);
        }
        for (int id = 1; id <= 2; id++) {
            struct rows a = history(s[0], APC_ACTUATOR, id), b = history(s[1], APC_ACTUATOR, id);
            assert_int_equal(a.n, b.n);
            for (size_t k = 0; k < a.n; k++)
                assert_true(same(&a.at[k], &b.at[k]));
            free(a.at);
            free(b.at);
        }
        apc_simulation_destroy(s[0]);
        apc_simulation_destroy(s[1]);
        apc_experiment_destroy(e);
    }
}

/* ---- Predictive control over two layers ---------------------------------------------------- */

#define FASTEST (0.1 * 5 + 1e-9) /* V a move: its rate, its period */

/* Both measurements where they are wanted. */
static void assert_no_offset(struct apc_simulation *s, double tolerance)
{
    for (int k = 1; k <= 2; k++)
        assert_near(newest(s, APC_SENSOR, k).value, newest(s, APC_SETPOINT, 2 + k).value, tolerance);
}

/*
 * Promise(laws/predictive-control-pid): Predictive control over PID loops takes up without a bump, knows
 *   what an operator holds below, is shed and comes back, keeps limits, leaves no offset.
 */
static void predictive_control_takes_up_without_a_bump(void **state)
{
    struct apc_experiment *e = load(predictive);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 80);
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_CAS);
    for (int loop = UPPER_R1; loop <= UPPER_R2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    for (int k = 1; k <= 2; k++) {
        assert_true(largest_step(s, APC_SETPOINT, k, 0, 80) < 1e-4);
        assert_true(largest_step(s, APC_ACTUATOR, k, 1, 80) < 1e-3);
    }
    assert_no_offset(s, 1e-4);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* What the operator does below is known above: the other level stays, and nothing has wound up. */
/* Also where what is wanted is not what is: while the loops below do not take its outputs, none is free. */
static void predictive_control_takes_up_wherever_it_is_wanted(void **state)
{
    struct apc_experiment *e = load(predictive);
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_experiment_set(e, "scheduler.sequence.[0].[0]", "7.0", &why), 0);
    struct apc_simulation *s = create(e);
    run(s, 80);
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_CAS);
    for (int loop = UPPER_R1; loop <= UPPER_R2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(laws/predictive-control-pid) */
static void predictive_control_knows_what_is_in_man_below(void **state)
{
    struct apc_experiment *e = load(predictive);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 150);
    assert_int_equal(mode_of(s, V2), APC_MODE_MAN);
    assert_int_equal(mode_of(s, UPPER_R1), APC_MODE_AUTO);
    assert_int_equal(mode_of(s, UPPER_R2), APC_MODE_IMAN);
    assert_true(newest(s, APC_SENSOR, 2).value > 6.8);
    assert_near(newest(s, APC_SENSOR, 1).value, 6.1315, 0.02);
    run(s, 169); /* in Cas again, and it has not moved yet */
    assert_int_equal(mode_of(s, V2), APC_MODE_CAS);
    assert_true(largest_step(s, APC_ACTUATOR, 2, 160, 169) < 0.1);
    assert_true(largest_step(s, APC_SETPOINT, 2, 160.2, 169) < 0.02);
    run(s, 195);
    assert_true(largest_step(s, APC_SETPOINT, 2, 169, 195) <= FASTEST);
    assert_no_offset(s, 0.02);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(laws/predictive-control-pid) */
static void predictive_control_that_is_killed_is_shed_and_takes_up_again(void **state)
{
    struct apc_experiment *e = load(predictive);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 561);
    assert_no_offset(s, 1e-3);
    run(s, 560.031 + 15.1 + 0.51);
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_AUTO);
    const struct apc_sample kept = newest(s, APC_SETPOINT, 2);
    run(s, 661); /* w2 stepped at 600 s */
    assert_near(newest(s, APC_SETPOINT, 4).value, 5.9, 0);
    assert_near(newest(s, APC_SETPOINT, 2).value, kept.value, 0);
    assert_true(largest_step(s, APC_ACTUATOR, 1, 561, 661) < 0.01);
    run(s, 669);
    for (int loop = V1; loop <= V2; loop++)
        assert_int_equal(mode_of(s, loop), APC_MODE_CAS);
    for (int k = 1; k <= 2; k++) {
        assert_true(largest_step(s, APC_SETPOINT, k, 661, 669) < 1e-9);
        assert_true(largest_step(s, APC_ACTUATOR, k, 661, 669) < 0.01);
    }
    run(s, 790);
    assert_no_offset(s, 1e-3);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* Promise(laws/predictive-control-pid) */
static void predictive_control_keeps_limits_and_leaves_no_offset(void **state)
{
    struct apc_experiment *e = load(predictive);
    struct apc_simulation *s = create(e);
    (void)state;
    run(s, 0); /* to the end: a load came in at 800 s */
    assert_no_offset(s, 2e-3);
    struct rows y = history(s, APC_SENSOR, 1);
    for (size_t i = 0; i < y.n; i++)
        assert_true(y.at[i].value <= 7.2);
    free(y.at);
    assert_true(largest_step(s, APC_SETPOINT, 1, 1, 1000) <= FASTEST);
    assert_true(largest_step(s, APC_SETPOINT, 2, 162, 1000) <= FASTEST); /* before, it followed its level */
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

/* ---- A hundred loops ---------------------------------------------------------------------- */

/*
 * Promise(modes/bad-measurement-leaves): A Bad measurement leaves all other loops' outputs bit for bit as
 *   they were; a restart between two ticks, too.
 */
static void a_bad_measurement_touches_its_own_loop_only(void **state)
{
    struct apc_experiment *e = load(hundred);
    struct apc_simulation *good = create(e), *bad;
    size_t differ = 0;
    (void)state;
    set(e, "measurements.y37.faults", "( { kind = \"dropout\"; at = 20.0; duration = 30.0; } )");
    bad = create(e);
    run(good, 100);
    run(bad, 100);
    for (int id = 1; id <= LOOPS; id++) {
        struct rows a = history(good, APC_ACTUATOR, id), b = history(bad, APC_ACTUATOR, id);
        bool all = a.n == b.n;
        for (size_t k = 0; all && k < a.n; k++)
            all = same(&a.at[k], &b.at[k]);
        differ += !all;
        if (!all && id != 38)
            fail_msg("output %d is another", id);
        free(a.at);
        free(b.at);
    }
    assert_int_equal(differ, 1);
    apc_simulation_destroy(good);
    apc_simulation_destroy(bad);
    apc_experiment_destroy(e);
}

static void all_of_them_are_where_they_are_wanted(void **state)
{
    struct apc_experiment *e = load(hundred);
    struct apc_simulation *s = create(e);
    struct apc_figure *f;
    size_t loops = 0;
    (void)state;
    run(s, 0);
    for (int id = 1; id <= LOOPS; id++) {
        assert_int_equal(mode_of(s, id), APC_MODE_AUTO);
        assert_near(newest(s, APC_SENSOR, id).value, newest(s, APC_SETPOINT, id).value, 0.2);
    }
    const int n = apc_simulation_figures(s, NULL, 0);
    assert_true(n > 0);
    if (!(f = calloc((size_t)n, sizeof *f)))
        abort();
    f->size = sizeof *f;
    assert_int_equal(apc_simulation_figures(s, f, (size_t)n), n);
    for (int i = 0; i < n; i++)
        loops += !strcmp(f[i].event, "all");
    assert_int_equal(loops, LOOPS);
    assert_string_equal(f[0].loop, "u00");
    free(f);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_cascade_closes_without_a_step),
        cmocka_unit_test(a_loop_in_man_follows_its_operator_and_comes_back_without_a_step),
        cmocka_unit_test(a_controller_that_is_killed_is_shed_and_taken_up_again),
        cmocka_unit_test(an_operator_takes_a_setpoint_and_gives_it_back),
        cmocka_unit_test(a_restart_between_two_ticks_leaves_no_trace),
        cmocka_unit_test(predictive_control_takes_up_without_a_bump),
        cmocka_unit_test(predictive_control_takes_up_wherever_it_is_wanted),
        cmocka_unit_test(predictive_control_knows_what_is_in_man_below),
        cmocka_unit_test(predictive_control_that_is_killed_is_shed_and_takes_up_again),
        cmocka_unit_test(predictive_control_keeps_limits_and_leaves_no_offset),
        cmocka_unit_test(a_bad_measurement_touches_its_own_loop_only),
        cmocka_unit_test(all_of_them_are_where_they_are_wanted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
