/* SPDX-License-Identifier: BSD-3-Clause */
#include <string.h>

#include "controller_rig.h"

/* What became of a variable, at the last tick or before. */
static const struct apc_sample *actual(const struct rig *r, enum apc_table table, int id)
{
    for (size_t i = 0; i < r->n_actual; i++) {
        if (r->actual[i].id == apc_variable_number(table, id))
            return &r->actual[i];
    }
    return &none;
}

static void assert_mode(const struct rig *r, enum apc_mode mode)
{
    assert_near(actual(r, APC_OPMODE, 1)->value, (double)mode, 0.0);
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* The variable of a row of in. */
static const struct apc_sample *became(const struct rig *r, int which)
{
    return actual(r, r->in[which].table, r->in[which].id);
}

static void assert_became(const struct rig *r, int which, double value, apc_status status)
{
    assert_near(became(r, which)->value, value, 0.0);
    assert_int_equal(became(r, which)->status, status);
    assert_int_equal(became(r, which)->origin, r->in[which].seq);
}

static void what_became_of_each_row_is_told_when_it_changes(void **state)
{
    struct rig *r = *state;

    measured_tick(r, 0.5);
    assert_became(r, Z, 1.0, APC_GOOD);
    assert_became(r, MODE, APC_MODE_AUTO, APC_GOOD);
    assert_int_equal(r->n, 3); /* with the output */
    measured_tick(r, 0.5);
    assert_int_equal(r->n, 1);
    set(r, KP, 0.3);
    measured_tick(r, 0.5);
    assert_became(r, KP, 0.3, APC_GOOD);
    assert_int_equal(r->n, 2);
    set(r, KP, 0.3); /* the same value: another row all the same */
    measured_tick(r, 0.5);
    assert_became(r, KP, 0.3, APC_GOOD);
    set(r, MANUAL, 1.0); /* in Auto */
    measured_tick(r, 0.5);
    assert_int_equal(became(r, MANUAL)->status, APC_BAD);
    assert_int_equal(became(r, MANUAL)->origin, r->in[MANUAL].seq);
    set(r, MODE, APC_MODE_MAN);
    set(r, MANUAL, 1.5);
    measured_tick(r, 0.5);
    assert_became(r, MODE, APC_MODE_MAN, APC_GOOD);
    assert_became(r, MANUAL, 1.5, APC_GOOD);
    set(r, MODE, APC_MODE_AUTO);
    set(r, Z, 2.0); /* counts once it is used: not while the output is held */
    r->in[Y].status = APC_BAD;
    tick(r);
    assert_became(r, Z, 2.0, APC_UNCERTAIN);
    assert_became(r, MODE, APC_MODE_AUTO, APC_GOOD);
    measured_tick(r, 0.5);
    assert_became(r, Z, 2.0, APC_GOOD);
}

static void it_names_what_it_reads_and_writes(void **state)
{
    static const struct {
        enum apc_table table;
        int id;
    } of[INPUTS] = {{APC_SENSOR, 1}, {APC_SETPOINT, 1}, {APC_OPMODE, 1}, {APC_MANUAL, 1}, {APC_TUNING, 1},
                    {APC_TUNING, 2}, {APC_TUNING, 3},   {APC_TUNING, 4}, {APC_TUNING, 5}, {APC_ACTUATOR, 1}};
    struct rig *r = *state;
    const struct apc_rows *in = apc_controller_in(r->controller),
                          *former = apc_controller_former(r->controller);

    assert_int_equal(in->n_samples, INPUTS);
    assert_int_equal(in->n_vectors, 0);
    for (int i = 0; i < INPUTS; i++) {
        assert_int_equal(in->sample[i].table, of[i].table);
        assert_int_equal(in->sample[i].id, of[i].id);
    }
    assert_int_equal(former->n_vectors, 1);
    assert_int_equal(former->vector[0].table, APC_TICK);
    assert_int_equal(former->vector[0].id, 1);
    assert_int_equal(former->n_samples, INPUTS - 2); /* what is wanted */
    for (size_t i = 0; i < former->n_samples; i++) {
        assert_int_equal(former->sample[i].table, APC_ACTUAL);
        assert_int_equal(former->sample[i].id, apc_variable_number(of[Z + i].table, of[Z + i].id));
    }
}

static void a_tick_row_says_what_the_tick_was_made_from(void **state)
{
    struct rig *r = *state;

    set(r, Y, 9.0);
    for (int k = 0; k < 3; k++)
        measured_tick(r, 0.5);
    assert_int_equal(r->tick.table, APC_TICK);
    assert_int_equal(r->tick.seq, 3);
    assert_int_equal(r->tick.time, T0 + 3 * PERIOD);
    assert_int_equal(r->tick.status, APC_GOOD);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->origin, 3);
    assert_near(field(r, APC_TICK_INDEX)[0], 2.0, 0.0);
    assert_near(field(r, APC_TICK_STATE)[0], APC_LOOP_AUTO, 0.0);
    assert_near(field(r, APC_TICK_Y)[0], 0.5, 0.0);
    assert_near(field(r, APC_TICK_Y_SEQ)[0], 4.0, 0.0);
    assert_near(field(r, APC_TICK_Z)[0], 1.0, 0.0);
    assert_near(field(r, APC_TICK_Z_SEQ)[0], 1.0, 0.0);
    assert_near(field(r, APC_TICK_U)[0], find(r, APC_ACTUATOR, 1)->value, 0.0);
    assert_near(field(r, APC_TICK_WANTED)[0], 1.0, 0.0);
    assert_near(field(r, APC_TICK_X)[0], 0.2 * 2.0 / 10.0 * 0.5 * 2, 1e-15);
}

static void a_tick_row_names_the_disturbances_it_was_made_from(void **state)
{
    enum { D = Y + 1 };
    const char *name;
    size_t offset, length;
    struct rig r;

    (void)state;
    make_sized(&r, &apc_law_pi, (struct apc_dim){1, 1, 1, 1});
    assert_int_equal(r.in[D].table, APC_SENSOR);
    for (int k = 0; k < 3; k++) {
        set(&r, Y, 0.5);
        set(&r, D, 4.0 + k);
        any_tick(&r, true);
    }
    assert_near(field(&r, APC_TICK_D)[0], 6.0, 0.0);
    assert_near(field(&r, APC_TICK_D_SEQ)[0], 3.0, 0.0);
    assert_true(apc_controller_tick_field(r.controller, APC_TICK_INDEX, &name, &offset, &length));
    assert_int_equal(offset, APC_TICK_INDEX_AT); /* where alarms look for it */
    assert_true(apc_controller_tick_field(r.controller, APC_TICK_X, &name, &offset, &length));
    assert_int_equal(offset + length, r.tick.n);
    assert_false(apc_controller_tick_field(r.controller, APC_TICK_FIELDS, &name, &offset, &length));
    apc_controller_destroy(r.controller);
}

static void an_output_names_what_it_was_computed_from(void **state)
{
    struct rig *r = *state;
    const struct apc_sample *u;

    set(r, Y, 9.0);
    u = measured_tick(r, 0.5);
    assert_true(u->seq > 0);
    assert_near(u->value, 0.2 * 0.5, 1e-15);
    assert_int_equal(u->seq, 1);
    assert_int_equal(u->time, T0 + PERIOD);
    assert_int_equal(u->status, APC_GOOD);
    assert_near(field(r, APC_TICK_Y_SEQ)[0], 2.0, 0.0);
    assert_near(field(r, APC_TICK_Z_SEQ)[0], 1.0, 0.0);
    assert_int_equal(u->origin, r->tick.seq);
    assert_int_equal(actual(r, APC_OPMODE, 1)->seq, 1);
    assert_mode(r, APC_MODE_AUTO);
    assert_int_equal(r->notice.kind, APC_NOTICE_MODE);
    u = measured_tick(r, 0.5);
    assert_int_equal(u->seq, 2);
    assert_int_equal(actual(r, APC_OPMODE, 1)->seq, 1);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

/* Promise(laws/held-back-output-status): A held-back output has its status, whoever's the limit is. */
static void the_output_never_leaves_its_limits(void **state)
{
    struct rig *r = *state;

    set(r, Z, 1000.0);
    assert_near(measured_tick(r, 0.0)->value, 2.0, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_HIGH);
    set(r, Z, -1000.0);
    assert_near(measured_tick(r, 0.0)->value, -1.0, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_LOW);
    set(r, Z, 0.0);
    assert_int_equal(measured_tick(r, 0.0)->status, APC_GOOD);
}

/* Promise(laws/held-back-output-status) */
static void a_limit_of_the_law_is_told_as_well(void **state)
{
    struct rig *r = *state;

    set(r, U_MAX, 0.1);
    set(r, Z, 1000.0);
    assert_near(measured_tick(r, 0.0)->value, 0.1, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_HIGH);
    set(r, U_MAX, -5.0); /* below what the output may be: it cannot move at all */
    assert_near(measured_tick(r, 0.0)->value, -1.0, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_CONSTANT);
    set(r, MODE, APC_MODE_MAN); /* the operator's output is not the law's */
    assert_int_equal(measured_tick(r, 0.0)->status, APC_GOOD);
}

/* ---- Modes ----------------------------------------------------------------------------------- */

static void in_man_the_operators_output_goes_out(void **state)
{
    struct rig *r = *state;

    set(r, MODE, APC_MODE_MAN);
    assert_near(measured_tick(r, 0.0)->value, FAULT, 0.0); /* he gave none, and there is no last one */
    set(r, MANUAL, 1.25);
    assert_near(measured_tick(r, 0.0)->value, 1.25, 0.0);
    set(r, MANUAL, 1.5);
    assert_near(any_tick(r, false)->value, 1.25, 0.0); /* nothing was read: what lies there does not count */
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
    set(r, MANUAL, 1.25);
    assert_mode(r, APC_MODE_MAN);
}

/* ---- What must not be taken -------------------------------------------------------------------- */

/* Whoever wrote it: an event tells of it once, the last good value stays, and the row counts as looked at. */
static void assert_refused(struct rig *r, int which, double value, const char *what)
{
    set(r, which, value);
    measured_tick(r, 0.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    if (!strstr(r->notice.text, what))
        fail_msg("\"%s\" does not say \"%s\"", r->notice.text, what);
    assert_int_equal(became(r, which)->origin, r->in[which].seq);
    assert_int_equal(apc_status_severity(became(r, which)->status), APC_SEVERITY_BAD);
    assert_true(isfinite(became(r, which)->value)); /* the one in force */
    measured_tick(r, 0.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

/*
 * Promise(run/controller-refuses): The controller itself refuses setpoint, mode, output, tuning outside
 *   limits, says so, keeps the last good one.
 */
static void a_setpoint_outside_its_limits_is_refused_and_the_last_good_one_kept(void **state)
{
    static const double wrong[] = {1e6, -1e4 - 1.0, (double)NAN, (double)INFINITY};
    struct rig *r = *state;

    set(r, TAU_I, 1e9);
    set(r, Z, 5.0);
    assert_near(measured_tick(r, 0.0)->value, 1.0, 1e-6);
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        assert_refused(r, Z, wrong[i], "setpoint 1 refused");
        assert_near(find(r, APC_ACTUATOR, 1)->value, 1.0, 1e-6);
        assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
        assert_near(field(r, APC_TICK_Z)[0], 5.0, 0.0);
        assert_mode(r, APC_MODE_AUTO);
    }
    for (double limit = -1e4; limit <= 1e4; limit += 2e4) { /* the limits themselves are within */
        set(r, Z, limit);
        assert_near(measured_tick(r, limit - 5.0)->value, 1.0, 1e-4);
        assert_near(field(r, APC_TICK_Z_SEQ)[0], (double)r->in[Z].seq, 0.0);
    }
}

static void where_there_was_no_good_setpoint_yet_a_wrong_one_starts_nothing(void **state)
{
    struct rig *r = *state;

    set(r, Z, 1e6);
    measured_tick(r, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->seq, 0);
    assert_mode(r, APC_MODE_AUTO);
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    for (int k = 0; k < 4; k++)
        measured_tick(r, 0.0);
    assert_near(find(r, APC_ACTUATOR, 1)->value, FAULT, 0.0);
    set(r, Z, 5.0);
    measured_tick(r, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
}

/* Promise(run/controller-refuses) */
static void an_operators_output_outside_its_limits_is_refused_and_the_last_good_one_kept(void **state)
{
    static const double wrong[] = {99.0, -1.1, (double)NAN, (double)INFINITY};
    struct rig *r = *state;

    set(r, MODE, APC_MODE_MAN);
    assert_refused(r, MANUAL, 99.0, "manual output 1 refused: 99 is not within -1 to 2");
    assert_near(find(r, APC_ACTUATOR, 1)->value, FAULT, 0.0);
    set(r, MANUAL, 1.25);
    measured_tick(r, 0.0);
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        assert_refused(r, MANUAL, wrong[i], "manual output 1 refused");
        assert_near(find(r, APC_ACTUATOR, 1)->value, 1.25, 0.0);
    }
}

/* Both are in range; together they would put the output at -5. */
/* Promise(laws/tuning-taken-set): Tuning is taken as a set within its limits, narrowed by the file. */
static void contradictory_tuning_is_refused_and_the_set_before_stays(void **state)
{
    struct rig *r = *state;

    set(r, KP, 0.3);
    set(r, TAU_I, 1e9);
    measured_tick(r, 0.0);
    set(r, U_MIN, 0.5);
    assert_refused(r, U_MAX, -0.5, "output 1: u_min = 0.5 is above u_max = -0.5");
    assert_near(measured_tick(r, -1.0)->value, 0.3 * 2.0, 1e-6);
    set(r, KP, 0.4); /* not taken either: the set as a whole is refused */
    measured_tick(r, -1.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    assert_near(measured_tick(r, -2.0)->value, 0.3 * 3.0, 1e-6);
    set(r, U_MAX, 0.95); /* now they fit: all of it */
    measured_tick(r, -2.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
    assert_near(measured_tick(r, -3.0)->value, 0.95, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_HIGH);
}

/* An offer that is refused is no change of tuning: the law's state is not touched, in saturation neither. */
static void refused_tuning_touches_nothing(void **state)
{
    struct rig *r = *state;
    struct rig other;
    const struct apc_sample *a, *b;

    make(&other, &apc_law_pi);
    memcpy(other.in, r->in, sizeof(other.in));
    for (int k = 0; k < 20; k++) {
        double y = k < 10 ? -20.0 : 0.5;

        if (k == 5) {
            set(r, U_MIN, 5.0);
            set(r, U_MAX, -5.0);
        }
        a = measured_tick(r, y);
        b = measured_tick(&other, y);
        assert_near(a->value, b->value, 0.0);
        assert_int_equal(r->notice.kind == APC_NOTICE_REJECTED, k == 5);
    }
    apc_controller_destroy(other.controller);
}

/* A controller that finds contradictory or wrong rows at its start has the experiment's tuning, not the
 * law's. */
static void with_no_good_tuning_in_the_store_it_has_the_experiments(void **state)
{
    const double tuning[] = {0.25, 1e9, 0.0, -1e9, 1e9};
    struct apc_param param[5];
    struct apc_controller_options o = {.size = sizeof(o),
                                       .law = &apc_law_pi,
                                       .dim = {1, 1, 1, 0},
                                       .period = PERIOD,
                                       .horizon = HORIZON,
                                       .param = param,
                                       .start = tuning};
    struct rig r = {0};
    struct apc_error why = {""};

    (void)state;
    memcpy(param, apc_law_pi.tuning, sizeof(param));
    param[0].high = 0.5;
    assert_int_equal(apc_controller_create(&r.controller, &o, NULL), 0);
    memcpy(r.in, apc_controller_in(r.controller)->sample, INPUTS * sizeof(*r.in));
    set(&r, Z, 1.0);
    set(&r, MODE, APC_MODE_AUTO);
    set(&r, U_MIN, 5.0);
    set(&r, U_MAX, -5.0);
    assert_near(measured_tick(&r, 0.0)->value, 0.25, 1e-9);
    set(&r, U_MAX, 1e9);
    set(&r, U_MIN, -1e9);
    assert_refused(&r, KP, 0.6, "Kp of output 1 refused: 0.6 is not within -1000000 to 0.5");
    assert_near(measured_tick(&r, -1.0)->value, 0.5, 1e-6);
    set(&r, KP, 0.5);
    measured_tick(&r, -1.0);
    assert_near(measured_tick(&r, -2.0)->value, 0.5 + 0.5, 1e-6);
    apc_controller_destroy(r.controller);
    for (int what = 0; what < 5; what++) {
        static const double wrong[][5] = {
            {0.6, 1, 0, 0, 1}, {0.1, 1, 0, 1, 0}, {0.1, 1, 0, 0, 1}, {0.1, 1, 0, 0, 1}, {0.1, 1, 0, 0, 1}};

        o.start = wrong[what];
        if (what >= 2)
            param[2] = apc_law_pi.tuning[2];
        if (what == 2)
            param[2].high = 1e10; /* wider than the law's */
        if (what == 3)
            param[2].low = -1e10;
        if (what == 4)
            param[2].low = param[2].high + 1.0;
        assert_int_equal(apc_controller_create(&r.controller, &o, &why), what == 1 ? APC_ERANGE : APC_EINVAL);
        assert_non_null(strstr(why.text, what == 0 ? "Kp" : what == 1 ? "u_min" : "u_bar"));
    }
}

/* Promise(run/controller-refuses) */
static void a_target_mode_that_is_none_is_refused_and_the_last_one_kept(void **state)
{
    static const double wrong[] = {-1.0, 0.5, 3.0, 1e9, (double)NAN};
    struct rig *r = *state;

    measured_tick(r, 0.0);
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        assert_refused(r, MODE, wrong[i], "target mode refused");
        assert_mode(r, APC_MODE_AUTO);
        assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
    }
    set(r, MODE, APC_MODE_OOS);
    measured_tick(r, 0.0);
    assert_mode(r, APC_MODE_OOS);
}

static void from_auto_to_man_an_old_output_of_the_operator_is_not_taken_up(void **state)
{
    struct rig *r = *state;
    double u;

    set(r, MANUAL, -0.9);
    measured_tick(r, 0);
    u = measured_tick(r, 0.2)->value;
    set(r, MODE, APC_MODE_MAN);
    assert_near(measured_tick(r, 0.4)->value, u, 0);
    set(r, MANUAL, -0.9); /* the same value, but set now */
    assert_near(measured_tick(r, 0.4)->value, -0.9, 0);
    assert_near(measured_tick(r, 0.4)->value, -0.9, 0);
}

static void an_output_set_right_after_the_change_to_man_is_taken_at_once(void **state)
{
    struct rig *r = *state;

    set(r, MANUAL, -0.9);
    measured_tick(r, 0);
    set(r, MODE, APC_MODE_MAN);
    set(r, MANUAL, 0.3);
    assert_near(measured_tick(r, 0.2)->value, 0.3, 0);
}

static void a_mode_that_could_not_be_written_is_written_again(void **state)
{
    struct rig *r = *state;
    const int id = apc_variable_number(APC_OPMODE, 1);

    set(r, Y, 0);
    compute(r, (struct apc_now){.mono = S, .utc = T0 + S}, true, false);
    assert_int_equal(find(r, APC_ACTUAL, id)->seq, 1);
    apc_controller_update(r->controller, 0);
    measured_tick(r, 0);
    assert_int_equal(find(r, APC_ACTUAL, id)->seq, 2);
    measured_tick(r, 0);
    assert_int_equal(find(r, APC_ACTUAL, id)->seq, 0);
}

static void from_man_to_auto_there_is_no_bump(void **state)
{
    struct rig *r = *state;
    const struct apc_sample *u;

    set(r, MODE, APC_MODE_MAN);
    set(r, MANUAL, 1.25);
    measured_tick(r, 0.3);
    measured_tick(r, 0.4);
    set(r, MODE, APC_MODE_AUTO);
    u = measured_tick(r, 0.7);
    assert_near(u->value, 1.25, 1e-14);
    assert_mode(r, APC_MODE_AUTO);
    u = measured_tick(r, 0.7);
    assert_near(u->value, 1.25 + 0.2 * 2.0 / 10.0 * 0.3, 1e-14); /* and it controls */
}

static void a_change_of_tuning_in_auto_gives_no_bump(void **state)
{
    struct rig *r = *state;
    double before;

    measured_tick(r, 0.1);
    before = measured_tick(r, 0.2)->value; /* the next, untuned, is this: */
    before += 0.2 * 2.0 / 10.0 * 0.8 + 0.2 * (0.2 - 0.4);
    set(r, KP, 1.5);
    set(r, TAU_I, 30.0);
    set(r, U_BAR, 0.9);
    assert_near(measured_tick(r, 0.4)->value, before, 1e-14);
    assert_near(measured_tick(r, 0.4)->value, before + 1.5 * 2.0 / 30.0 * 0.6, 1e-14);
}

/* Promise(run/controller-refuses) */
static void tuning_out_of_range_is_refused_once_and_the_last_good_one_kept(void **state)
{
    struct rig *r = *state;
    const double wrong[] = {0.0, -3.0, (double)NAN, (double)INFINITY};

    measured_tick(r, 1.0);
    set(r, TAU_I, 5.0);
    measured_tick(r, 1.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        set(r, TAU_I, wrong[i]);
        measured_tick(r, 1.0);
        assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
        assert_non_null(strstr(r->notice.text, "tau_i"));
        measured_tick(r, 1.0);
        assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
    }
    measured_tick(r, 0.0);
    assert_near(measured_tick(r, 0.0)->value, 0.2 + 0.2 * 2.0 / 5.0, 1e-14);
}

static void out_of_service_writes_no_output(void **state)
{
    struct rig *r = *state;
    const double no_mode[] = {2.0, 0.5, -1.0, (double)NAN};
    double last = measured_tick(r, 0.5)->value;

    for (size_t i = 0; i < sizeof(no_mode) / sizeof(no_mode[0]); i++) {
        set(r, MODE, no_mode[i]);
        assert_int_equal(measured_tick(r, 0.5)->seq, 0);
        assert_int_equal(r->n, 1); /* what became of the target mode */
        assert_mode(r, APC_MODE_OOS);
    }
    r->in[MODE].seq = 0;
    assert_int_equal(measured_tick(r, 0.5)->seq, 0);
    set(r, MODE, APC_MODE_AUTO);
    assert_near(measured_tick(r, 0.1)->value, last, 1e-14);
}

/* ---- Loss of measurement --------------------------------------------------------------------- */

/* Lose the measurement at one tick in every way there is, to be undone by set(). */
static void lose(struct rig *r, int way)
{
    switch (way) {
    case 0:
        r->in[Y].status = APC_BAD_SENSOR_FAILURE;
        break;
    case 1:
        r->in[Y].value = (double)NAN;
        break;
    case 2:
        r->in[Y].seq = 0;
        break;
    case 3:
        r->in[Z].status = APC_BAD;
        break;
    default:
        r->in[Z].seq = 0;
        break;
    }
}

/*
 * Promise(run/lost-bad-measurement): A lost or Bad measurement is bridged, then the fault value; no bump on
 *   return; predictive control goes on by its estimate.
 */
static void a_lost_measurement_holds_then_faults_then_recovers_without_a_bump(void **state)
{
    for (int way = 0; way <= 4; way++) {
        struct rig *r = *state;
        const struct apc_sample *u;
        double held;

        tear_down(state);
        set_up(state);
        measured_tick(r, 0.5);
        held = measured_tick(r, 0.4)->value;
        for (int k = 0; k < 3; k++) { /* 0, 2, 4 s after it began */
            set(r, Y, 0.1);
            lose(r, way);
            u = tick(r);
            assert_near(u->value, held, 0.0);
            assert_int_equal(u->status, APC_UNCERTAIN_LAST_USABLE);
            assert_int_equal(r->notice.kind, k == 0 ? APC_NOTICE_HOLD : APC_NOTICE_NONE);
            assert_mode(r, APC_MODE_AUTO);
        }
        for (int k = 0; k < 3; k++) { /* 6 s and on */
            u = tick(r);
            assert_near(u->value, FAULT, 0.0);
            assert_int_equal(u->status, APC_UNCERTAIN_SUBSTITUTE);
            assert_int_equal(r->notice.kind, k == 0 ? APC_NOTICE_FAULT : APC_NOTICE_NONE);
            assert_mode(r, APC_MODE_LO);
        }
        r->in[Y].seq += 10;
        r->in[Z].seq += 10;
        set(r, Z, 1.0);
        u = measured_tick(r, 0.3);
        assert_near(u->value, FAULT, 1e-14);
        assert_int_equal(u->status, APC_GOOD);
        assert_int_equal(r->notice.kind, APC_NOTICE_RECOVERED);
        assert_mode(r, APC_MODE_AUTO);
        assert_near(measured_tick(r, 0.3)->value, FAULT + 0.2 * 2.0 / 10.0 * 0.7, 1e-14);
    }
}

/* The first tick of it is 100 ms late, those that follow are not: 6 s are three periods all the same. */
static void a_late_tick_does_not_lengthen_what_is_held(void **state)
{
    struct rig *r = *state;

    measured_tick(r, 0.5);
    r->mono += 100 * APC_NS_PER_MS;
    for (int k = 0; k < 4; k++) {
        set(r, Y, 0.1);
        lose(r, 0);
        assert_int_equal(tick(r)->status, k < 3 ? APC_UNCERTAIN_LAST_USABLE : APC_UNCERTAIN_SUBSTITUTE);
        r->mono -= k == 0 ? 100 * APC_NS_PER_MS : 0;
    }
}

static int compute_nothing(struct apc_law_call *c)
{
    (void)c;
    return APC_LAW_GOOD;
}

static const struct apc_law all_of_it = {
    .abi = APC_LAW_ABI, .name = "all", .whole = true, .compute = compute_nothing};

/* An operator reads which of them it is, and what is wrong with it. */
static void what_the_output_is_held_for_is_said(void **state)
{
    static const struct {
        int which;
        const char *text;
    } lost[] = {{0, "measurement 1 is Bad"},     {1, "measurement 2 is Bad"},
                {0, "measurement 1 is missing"}, {1, "measurement 2 is missing"},
                {0, "measurement 1 is stale"},   {1, "measurement 2 is stale"},
                {2, "setpoint 1 is Bad"},        {3, "setpoint 2 is Bad"},
                {2, "setpoint 1 is missing"},    {3, "setpoint 2 is missing"}};

    (void)state;
    for (size_t i = 0; i < sizeof(lost) / sizeof(lost[0]); i++) {
        const struct apc_now now = {.mono = S, .utc = T0 + S};
        struct apc_now later = now;
        struct rig r;

        make_sized(&r, &all_of_it, (struct apc_dim){2, 2, 1, 0});
        for (int k = 0; k < 5; k++) { /* y, z, Auto */
            r.in[k].seq = 1;
            r.in[k].time = now.utc;
            r.in[k].value = 1.0;
            r.in[k].status = APC_GOOD;
        }
        compute(&r, now, true, true);
        assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_GOOD);
        apc_controller_update(r.controller, 1);
        if (strstr(lost[i].text, "Bad"))
            r.in[lost[i].which].status = APC_BAD;
        else if (strstr(lost[i].text, "missing"))
            r.in[lost[i].which].seq = 0;
        else
            later.mono += HORIZON + 1;
        r.in[!lost[i].which].seq += lost[i].which < 2; /* the other measurement is new */
        compute(&r, later, true, true);
        assert_int_equal(r.notice.kind, APC_NOTICE_HOLD);
        if (!strstr(r.notice.text, lost[i].text))
            fail_msg("\"%s\" does not say \"%s\"", r.notice.text, lost[i].text);
        apc_controller_destroy(r.controller);
    }
}

/* Promise(experiment/measurement-stale) */
static void a_measurement_that_is_no_longer_renewed_is_stale(void **state)
{
    struct rig *r = *state;

    assert_int_equal(measured_tick(r, 0.5)->status, APC_GOOD);
    assert_int_equal(tick(r)->status, APC_GOOD); /* 4 s old, of 5 */
    assert_int_equal(tick(r)->status, APC_UNCERTAIN_LAST_USABLE);
    assert_non_null(strstr(r->notice.text, "stale"));
    assert_int_equal(measured_tick(r, 0.5)->status, APC_GOOD);
}

/* Promise(run/lost-bad-measurement) */
static void the_integral_stands_still_while_the_output_is_held(void **state)
{
    struct rig *r = *state;
    double before = measured_tick(r, 0.0)->value;
    double after;

    before = measured_tick(r, 0.0)->value;
    any_tick(r, false);
    assert_int_equal(r->notice.kind, APC_NOTICE_HOLD);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    any_tick(r, false);
    after = measured_tick(r, 0.0)->value;
    assert_near(after, before, 1e-14);
}

static void without_any_measurement_yet_nothing_goes_out_until_the_fault_value(void **state)
{
    struct rig *r = *state;

    for (int k = 0; k < 3; k++)
        assert_int_equal(tick(r)->seq, 0);
    assert_near(tick(r)->value, FAULT, 0.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_FAULT);
    assert_near(field(r, APC_TICK_BEGUN)[0], 0.0, 0.0); /* no x that a restart could go on from */
    assert_int_equal(r->n, 2);                          /* the output and the mode */
    tick(r);
    assert_int_equal(r->n, 1);
}

/* Promise(run/step-wall-clock) */
static void a_clock_step_of_an_hour_changes_nothing(void **state)
{
    struct rig *r = *state;
    struct rig steady;

    make(&steady, &apc_law_pi);
    memcpy(steady.in, r->in, sizeof(steady.in));
    for (int k = 0; k < 60; k++) {
        double y = sin(0.3 * k);
        const struct apc_sample *a, *b;

        r->utc_step = (k / 7 % 3 - 1) * 3600 * S;
        a = measured_tick(r, y);
        b = measured_tick(&steady, y);
        assert_true(a->seq && b->seq);
        assert_near(a->value, b->value, 0.0);
        assert_int_equal(apc_status_severity(a->status), APC_SEVERITY_GOOD);
    }
    apc_controller_destroy(steady.controller);
}

/* ---- A law that fails ------------------------------------------------------------------------ */

/* u = 0.5 + x; z = 6, 7: NaN, infinity; 8, 9: x spoilt for good, and u with it or not. */
static int fragile_compute(struct apc_law_call *c)
{
    if (c->z[0] >= 8.0)
        c->x[0] = (double)NAN;
    c->u[0] = 0.5 + (c->z[0] == 9.0 ? 0.0 : c->x[0]);
    if (c->z[0] == 6.0)
        c->u[0] = (double)NAN;
    if (c->z[0] == 7.0)
        c->u[0] = (double)INFINITY;
    return APC_LAW_GOOD;
}

static const struct apc_law fragile = {
    .abi = APC_LAW_ABI, .name = "fragile", .n_state = one_state, .compute = fragile_compute};

/*
 * Promise(laws/law-gives-finite): A law that gives no finite number keeps its last output, begins anew, is
 *   counted.
 */
static void a_law_that_gives_no_finite_number_is_held_and_begins_anew(void **state)
{
    struct rig r;
    const struct apc_sample *u;

    (void)state;
    make(&r, &fragile);
    set(&r, MODE, APC_MODE_AUTO);
    for (double z = 6.0; z <= 9.0; z += 1.0) {
        set(&r, Z, 1.0);
        assert_near(measured_tick(&r, 0.0)->value, 0.5, 0.0);
        set(&r, Z, z);
        u = measured_tick(&r, 0.0);
        assert_near(u->value, 0.5, 0.0);
        assert_int_equal(u->status, APC_UNCERTAIN_LAST_USABLE);
        assert_int_equal(r.notice.kind, APC_NOTICE_REJECTED);
        assert_int_equal(apc_controller_failures(r.controller), (int)z - 5);
        assert_non_null(strstr(r.notice.text, "law fragile: "));
        assert_null(strchr(r.notice.text, '(')); /* how often is told elsewhere */
        set(&r, Z, 1.0);
        u = measured_tick(&r, 0.0);
        assert_near(u->value, 0.5, 0.0);
        assert_int_equal(u->status, APC_GOOD);
        assert_int_equal(r.notice.kind, APC_NOTICE_RECOVERED);
    }
    apc_controller_destroy(r.controller);
}

static void a_controller_that_could_not_work_is_refused(void **state)
{
    const double high = -1.0;
    const struct apc_controller_options good = {
        .size = sizeof(good), .law = &apc_law_pi, .dim = {1, 1, 1, 0}, .period = PERIOD, .horizon = HORIZON};
    struct apc_controller_options o = good;
    struct apc_controller *c = NULL;
    struct apc_error why = {""};

    (void)state;
    o.dim.nz = 2;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "setpoints: 2"));
    o = good;
    o.loop = &(const struct apc_controller_loop){
        .id = 1, .mode = 1, .low = -HUGE_VAL, .high = high}; /* a fault value of 0 lies outside */
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o.loop = &(const struct apc_controller_loop){.id = 1, .mode = 1, .low = 1.0, .high = 2.0};
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o.loop = &(const struct apc_controller_loop){
        .id = 1, .mode = 1, .low = -1.0, .high = 2.0, .fault = (double)NAN};
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o = good;
    o.law = NULL;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o = good;
    o.n_setting = 1; /* the PI has none */
    o.setting = &(const struct apc_setting){"measurement", NULL, 1, 1, &high};
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "\"measurement\""));
    o.law = &apc_law_pid; /* has it, but there is no measurement -1 */
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o = good;
    o.law = &apc_law_lqg; /* needs a model */
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o = good;
    o.period = 0;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    o = good;
    o.horizon = -1;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_null(c);
    o = good;
    o.loop = &(const struct apc_controller_loop){.id = 1, .mode = 1, .low = -1.0, .high = 1.0, .hold = -1};
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_int_equal(apc_controller_create(NULL, &good, &why), APC_EINVAL);
    apc_controller_destroy(NULL);
}

static int free_compute(struct apc_law_call *c)
{
    (void)c;
    return APC_LAW_GOOD;
}

static size_t many(const struct apc_dim *dim)
{
    return 65000 + dim->nz;
}

static size_t a_million(const struct apc_dim *dim)
{
    return 1000000 + (dim->nz == 1);
}

/* What a frame and a year hold; a setpoint is not needed. */
static void dimensions_and_periods_have_bounds_and_reach_them(void **state)
{
    static const struct apc_dim bad[] = {{0, 1, 1, 0}, {8193, 1, 1, 0}, {1, 8193, 1, 0},
                                         {1, 1, 0, 0}, {1, 1, 8193, 0}, {1, 1, 1, 8193}};
    static const struct apc_dim fine[] = {
        {8192, 0, 1, 0}, {1, 8192, 1, 0}, {1, 1, 3000, 0}, {1, 0, 1, 0}, {1, 0, 1, 8192}};
    const apc_ns year = INT64_C(366) * 86400 * S;
    struct apc_law law = {.abi = APC_LAW_ABI, .name = "free", .compute = free_compute};
    const struct apc_controller_options good = {
        .size = sizeof(good), .law = &law, .dim = {1, 0, 1, 0}, .period = PERIOD, .horizon = HORIZON};
    struct apc_controller_options o = good;
    struct apc_controller *c = NULL;
    struct apc_error why = {""};

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        o.dim = bad[i];
        assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "none may exceed 8192, ny and nu not be 0"));
    }
    for (size_t i = 0; i < sizeof(fine) / sizeof(fine[0]); i++) {
        o.dim = fine[i];
        assert_int_equal(apc_controller_create(&c, &o, &why), 0);
        assert_true(apc_controller_out(c)->vector->n <= APC_ELEMENTS_MAX);
        apc_controller_destroy(c);
    }
    /* outputs are dearest in a tick row, which one store at least has to take */
    o.dim = (struct apc_dim){1, 1, 8192, 0};
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_null(c);
    assert_non_null(strstr(why.text, "a store takes 65536: give the outputs to several controllers"));
    o.dim = good.dim;
    for (int what = 0; what < 2; what++) {
        apc_ns *of = what == 0 ? &o.period : &o.horizon;

        o = good;
        *of = year + 1;
        assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "366 days"));
        *of = year;
        assert_int_equal(apc_controller_create(&c, &o, &why), 0);
        apc_controller_destroy(c);
        *of = 1;
        assert_int_equal(apc_controller_create(&c, &o, &why), 0);
        apc_controller_destroy(c);
    }
    o = good;
    law.n_state = many;
    assert_int_equal(apc_controller_create(&c, &o, &why), 0);
    apc_controller_destroy(c);
    law.n_state = a_million;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "1000000 states of its law"));
    o.dim.nz = 1;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "wants 1000001 states"));
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(it_names_what_it_reads_and_writes),
        T(what_became_of_each_row_is_told_when_it_changes),
        T(a_tick_row_says_what_the_tick_was_made_from),
        T(a_tick_row_names_the_disturbances_it_was_made_from),
        T(an_output_names_what_it_was_computed_from),
        T(the_output_never_leaves_its_limits),
        T(a_limit_of_the_law_is_told_as_well),
        T(in_man_the_operators_output_goes_out),
        T(a_setpoint_outside_its_limits_is_refused_and_the_last_good_one_kept),
        T(where_there_was_no_good_setpoint_yet_a_wrong_one_starts_nothing),
        T(an_operators_output_outside_its_limits_is_refused_and_the_last_good_one_kept),
        T(contradictory_tuning_is_refused_and_the_set_before_stays),
        T(refused_tuning_touches_nothing),
        T(with_no_good_tuning_in_the_store_it_has_the_experiments),
        T(a_target_mode_that_is_none_is_refused_and_the_last_one_kept),
        T(from_auto_to_man_an_old_output_of_the_operator_is_not_taken_up),
        T(an_output_set_right_after_the_change_to_man_is_taken_at_once),
        T(a_mode_that_could_not_be_written_is_written_again),
        T(from_man_to_auto_there_is_no_bump),
        T(a_change_of_tuning_in_auto_gives_no_bump),
        T(tuning_out_of_range_is_refused_once_and_the_last_good_one_kept),
        T(out_of_service_writes_no_output),
        T(a_lost_measurement_holds_then_faults_then_recovers_without_a_bump),
        T(a_late_tick_does_not_lengthen_what_is_held),
        cmocka_unit_test(what_the_output_is_held_for_is_said),
        T(a_measurement_that_is_no_longer_renewed_is_stale),
        T(the_integral_stands_still_while_the_output_is_held),
        T(without_any_measurement_yet_nothing_goes_out_until_the_fault_value),
        T(a_clock_step_of_an_hour_changes_nothing),
        cmocka_unit_test(a_law_that_gives_no_finite_number_is_held_and_begins_anew),
        cmocka_unit_test(a_controller_that_could_not_work_is_refused),
        cmocka_unit_test(dimensions_and_periods_have_bounds_and_reach_them),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
