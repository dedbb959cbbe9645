/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apcmodules.h"

#include <stdio.h>
#include <string.h>

#define S       APC_NS_PER_S
#define T0      (INT64_C(1700000000) * S)
#define PERIOD  (2 * S)
#define HORIZON (5 * S)
#define HOLD    (6 * S)
#define FAULT   (-0.7)
#define MAX_OUT 32
#define STORED  8 /* what the PI goes on from: signature, y, z, u, rows taken, loop, x; the actual mode */

enum { Y, Z, MODE, KP, TAU_I, U_BAR, U_MIN, U_MAX, MANUAL, WRITTEN, INPUTS };

/* A controller, what the store would hold for it, and what it gave at the last tick. */
struct rig {
    struct apc_controller *controller;
    struct apc_sample in[INPUTS], out[MAX_OUT];
    int n;
    struct apc_sample mode; /* newest row of the actual mode */
    struct apc_notice notice;
    apc_ns mono, utc_step;
};

static const struct apc_sample none;

/* The row of the last tick; one with seq 0 when there was none. */
static const struct apc_sample *find(const struct rig *r, enum apc_table table, int id)
{
    for (int i = 0; i < r->n; i++) {
        if (r->out[i].table == table && r->out[i].id == id)
            return &r->out[i];
    }
    return &none;
}

static void set(struct rig *r, int which, double value)
{
    r->in[which].value = value;
    r->in[which].seq++;
    r->in[which].time = T0 + r->mono + r->utc_step;
    r->in[which].status = APC_GOOD;
}

/* One period later: read, compute, update. Returns the actuator row. */
static const struct apc_sample *blind_tick(struct rig *r, const struct apc_sample *in)
{
    struct apc_now now;

    r->mono += PERIOD;
    now = (struct apc_now){.mono = r->mono, .utc = T0 + r->mono + r->utc_step};
    r->n = apc_controller_compute(r->controller, now, in, r->out, &r->notice);
    assert_in_range(r->n, 0, (int)apc_controller_size(r->controller).out);
    apc_controller_update(r->controller);
    if (find(r, APC_STATE, 0)->seq)
        r->in[WRITTEN] = *find(r, APC_STATE, 0);
    if (find(r, APC_OPMODE, 1)->seq)
        r->mode = *find(r, APC_OPMODE, 1);
    return find(r, APC_ACTUATOR, 1);
}

static void assert_mode(const struct rig *r, enum apc_mode mode)
{
    assert_near(r->mode.value, (double)mode, 0.0);
}

static const struct apc_sample *tick(struct rig *r)
{
    return blind_tick(r, r->in);
}

static const struct apc_sample *measured_tick(struct rig *r, double y)
{
    set(r, Y, y);
    return tick(r);
}

static void make_sized(struct rig *r, const struct apc_law *law, struct apc_dim dim)
{
    static const double fault = FAULT, low = -1.0, high = 2.0, z_low[] = {-1e4, -1e4}, z_high[] = {1e4, 1e4};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = law,
                                             .dim = dim,
                                             .period = PERIOD,
                                             .horizon = HORIZON,
                                             .hold = HOLD,
                                             .fault = &fault,
                                             .low = &low,
                                             .high = &high,
                                             .z_low = z_low,
                                             .z_high = z_high};
    struct apc_error why = {""};

    *r = (struct rig){0};
    if (apc_controller_create(&r->controller, &o, &why) < 0)
        fail_msg("%s", why.text);
}

static void make(struct rig *r, const struct apc_law *law)
{
    make_sized(r, law, (struct apc_dim){1, 1, 1, 0});
}

static int set_up(void **state)
{
    static struct rig r;

    make(&r, &apc_law_pi);
    apc_controller_inputs(r.controller, r.in);
    set(&r, Z, 1.0);
    set(&r, MODE, APC_MODE_AUTO);
    *state = &r;
    return 0;
}

static int tear_down(void **state)
{
    apc_controller_destroy(((struct rig *)*state)->controller);
    return 0;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

#define TAKEN 4 /* id in table state of how many rows of the operator's were taken */

static double sum_of_seqs(const struct rig *r)
{
    int64_t sum = 0;

    for (int i = Z; i <= MANUAL; i++)
        sum += r->in[i].seq;
    return (double)sum;
}

static void each_tick_confirms_the_operators_rows_that_it_took(void **state)
{
    static const int operators[] = {Z, MODE, KP, U_MAX, MANUAL};
    struct rig *r = *state;

    for (size_t i = 0; i < sizeof(operators) / sizeof(operators[0]); i++) {
        set(r, operators[i], operators[i] == MODE ? APC_MODE_MAN : 1.0);
        measured_tick(r, 0.5);
        assert_near(find(r, APC_STATE, TAKEN)->value, sum_of_seqs(r), 0.0);
    }
    set(r, Z, 2.0); /* a setpoint counts once it is used: not while the output is held */
    r->in[Y].status = APC_BAD;
    tick(r);
    assert_near(find(r, APC_STATE, TAKEN)->value, sum_of_seqs(r) - 1, 0.0);
    measured_tick(r, 0.5);
    assert_near(find(r, APC_STATE, TAKEN)->value, sum_of_seqs(r), 0.0);
}

static void it_names_what_it_reads(void **state)
{
    struct rig *r = *state;
    const struct apc_controller_size size = apc_controller_size(r->controller);

    assert_int_equal(size.in, INPUTS);
    assert_int_equal(size.resume, STORED);
    assert_int_equal(size.out, 1 + 7 + 1);
    apc_controller_inputs(r->controller, r->in);
    assert_int_equal(r->in[Y].table, APC_SENSOR);
    assert_int_equal(r->in[Y].id, 1);
    assert_int_equal(r->in[Z].table, APC_SETPOINT);
    assert_int_equal(r->in[MODE].table, APC_OPMODE);
    assert_int_equal(r->in[MODE].id, 0);
    assert_int_equal(r->in[U_MAX].table, APC_TUNING);
    assert_int_equal(r->in[U_MAX].id, 5);
    assert_int_equal(r->in[MANUAL].table, APC_MANUAL);
    assert_int_equal(r->in[MANUAL].id, 1);
    assert_int_equal(r->in[WRITTEN].table, APC_STATE);
    assert_int_equal(r->in[WRITTEN].id, 0);
}

static void an_output_names_what_it_was_computed_from(void **state)
{
    struct rig *r = *state;
    const struct apc_sample *u, *mode;

    set(r, Y, 9.0);
    u = measured_tick(r, 0.5);
    assert_true(u->seq > 0);
    assert_near(u->value, 0.2 * 0.5, 1e-15);
    assert_int_equal(u->seq, 1);
    assert_int_equal(u->time, T0 + PERIOD);
    assert_int_equal(u->status, APC_GOOD);
    assert_int_equal(u->sensor_seq, 2);
    assert_int_equal(u->setpoint_seq, 1);
    mode = find(r, APC_OPMODE, 1);
    assert_true(mode->seq > 0);
    assert_int_equal(mode->seq, 1);
    assert_near(mode->value, APC_MODE_AUTO, 0.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_MODE);
    u = measured_tick(r, 0.5);
    assert_int_equal(u->seq, 2);
    assert_int_equal(find(r, APC_OPMODE, 1)->seq, 0);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

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
    assert_int_equal(find(r, APC_ACTUATOR, 1)->sensor_seq, 0);
    assert_near(blind_tick(r, NULL)->value, 1.25, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
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
    if (find(r, APC_STATE, TAKEN)->seq)
        assert_near(find(r, APC_STATE, TAKEN)->value, sum_of_seqs(r), 0.0);
    measured_tick(r, 0.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

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
        assert_int_equal(find(r, APC_ACTUATOR, 1)->setpoint_seq, 2);
        assert_mode(r, APC_MODE_AUTO);
    }
    for (double limit = -1e4; limit <= 1e4; limit += 2e4) { /* the limits themselves are within */
        set(r, Z, limit);
        assert_near(measured_tick(r, limit - 5.0)->value, 1.0, 1e-4);
        assert_int_equal(find(r, APC_ACTUATOR, 1)->setpoint_seq, r->in[Z].seq);
    }
}

static void where_there_was_no_good_setpoint_yet_a_wrong_one_starts_nothing(void **state)
{
    struct rig *r = *state;

    set(r, Z, 1e6);
    measured_tick(r, 0.0);
    assert_int_equal(r->n, 1); /* the mode, no output */
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    for (int k = 0; k < 4; k++)
        measured_tick(r, 0.0);
    assert_near(find(r, APC_ACTUATOR, 1)->value, FAULT, 0.0);
    set(r, Z, 5.0);
    measured_tick(r, 0.0);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_GOOD);
}

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
                                       .tuning = tuning};
    struct rig r = {0};
    struct apc_error why = {""};

    (void)state;
    memcpy(param, apc_law_pi.tuning, sizeof(param));
    param[0].high = 0.5;
    assert_int_equal(apc_controller_create(&r.controller, &o, NULL), 0);
    apc_controller_inputs(r.controller, r.in);
    set(&r, Z, 1.0);
    set(&r, MODE, APC_MODE_AUTO);
    set(&r, U_MIN, 5.0);
    set(&r, U_MAX, -5.0);
    assert_near(measured_tick(&r, 0.0)->value, 0.25, 1e-9);
    set(&r, U_MAX, 1e9);
    set(&r, U_MIN, -1e9);
    assert_refused(&r, KP, 0.6, "Kp of output 1 refused: 0.6 is not within -1e+06 to 0.5");
    assert_near(measured_tick(&r, -1.0)->value, 0.5, 1e-6);
    set(&r, KP, 0.5);
    measured_tick(&r, -1.0);
    assert_near(measured_tick(&r, -2.0)->value, 0.5 + 0.5, 1e-6);
    apc_controller_destroy(r.controller);
    for (int what = 0; what < 5; what++) {
        static const double wrong[][5] = {
            {0.6, 1, 0, 0, 1}, {0.1, 1, 0, 1, 0}, {0.1, 1, 0, 0, 1}, {0.1, 1, 0, 0, 1}, {0.1, 1, 0, 0, 1}};

        o.tuning = wrong[what];
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
    const struct apc_now now = {.mono = S, .utc = T0 + S};

    set(r, Y, 0);
    r->n = apc_controller_compute(r->controller, now, r->in, r->out, &r->notice);
    assert_int_equal(find(r, APC_OPMODE, 1)->seq, 1);
    measured_tick(r, 0); /* no update in between: the shell could not write */
    assert_int_equal(find(r, APC_OPMODE, 1)->seq, 2);
    measured_tick(r, 0);
    assert_int_equal(find(r, APC_OPMODE, 1)->seq, 0);
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
    assert_near(find(r, APC_OPMODE, 1)->value, APC_MODE_AUTO, 0.0);
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
        assert_int_equal(r->n, i == 0); /* the mode, once */
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

static void a_lost_measurement_holds_then_faults_then_recovers_without_a_bump(void **state)
{
    for (int way = 0; way <= 4; way++) {
        struct rig *r = *state;
        const struct apc_sample *u;
        int64_t seq;
        double held;

        tear_down(state);
        set_up(state);
        measured_tick(r, 0.5);
        held = measured_tick(r, 0.4)->value;
        seq = find(r, APC_ACTUATOR, 1)->sensor_seq;
        for (int k = 0; k < 3; k++) { /* 0, 2, 4 s after it began */
            set(r, Y, 0.1);
            lose(r, way);
            u = tick(r);
            assert_near(u->value, held, 0.0);
            assert_int_equal(u->status, APC_UNCERTAIN_LAST_USABLE);
            assert_int_equal(u->sensor_seq, seq);
            assert_int_equal(r->notice.kind, k == 0 ? APC_NOTICE_HOLD : APC_NOTICE_NONE);
            assert_mode(r, APC_MODE_AUTO);
        }
        for (int k = 0; k < 3; k++) { /* 6 s and on */
            u = tick(r);
            assert_near(u->value, FAULT, 0.0);
            assert_int_equal(u->status, APC_UNCERTAIN_SUBSTITUTE);
            assert_int_equal(u->sensor_seq, 0);
            assert_int_equal(r->notice.kind, k == 0 ? APC_NOTICE_FAULT : APC_NOTICE_NONE);
            assert_mode(r, APC_MODE_MAN);
        }
        r->in[Y].seq += 10;
        r->in[Z].seq += 10;
        set(r, Z, 1.0);
        u = measured_tick(r, 0.3);
        assert_near(u->value, FAULT, 1e-14);
        assert_int_equal(u->status, APC_GOOD);
        assert_int_equal(r->notice.kind, APC_NOTICE_RECOVERED);
        assert_near(find(r, APC_OPMODE, 1)->value, APC_MODE_AUTO, 0.0);
        assert_near(measured_tick(r, 0.3)->value, FAULT + 0.2 * 2.0 / 10.0 * 0.7, 1e-14);
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
        struct apc_sample in[32], out[MAX_OUT];
        const struct apc_now now = {.mono = S, .utc = T0 + S};
        struct apc_now later = now;
        struct rig r;

        make_sized(&r, &all_of_it, (struct apc_dim){2, 2, 1, 0});
        assert_in_range(apc_controller_size(r.controller).in, 5, 32);
        assert_in_range(apc_controller_size(r.controller).out, 1, MAX_OUT);
        apc_controller_inputs(r.controller, in);
        for (int k = 0; k < 5; k++) /* y, z, Auto */
            in[k] = (struct apc_sample){
                .table = in[k].table, .id = in[k].id, .seq = 1, .time = now.utc, .value = 1.0};
        assert_true(apc_controller_compute(r.controller, now, in, out, &r.notice) > 0);
        assert_int_equal(out[0].status, APC_GOOD);
        apc_controller_update(r.controller);
        if (strstr(lost[i].text, "Bad"))
            in[lost[i].which].status = APC_BAD;
        else if (strstr(lost[i].text, "missing"))
            in[lost[i].which].seq = 0;
        else
            later.mono += HORIZON + 1;
        in[!lost[i].which].seq += lost[i].which < 2; /* the other measurement is new */
        assert_true(apc_controller_compute(r.controller, later, in, out, &r.notice) > 0);
        assert_int_equal(r.notice.kind, APC_NOTICE_HOLD);
        if (!strstr(r.notice.text, lost[i].text))
            fail_msg("\"%s\" does not say \"%s\"", r.notice.text, lost[i].text);
        apc_controller_destroy(r.controller);
    }
}

static void a_measurement_that_is_no_longer_renewed_is_stale(void **state)
{
    struct rig *r = *state;

    assert_int_equal(measured_tick(r, 0.5)->status, APC_GOOD);
    assert_int_equal(tick(r)->status, APC_GOOD); /* 4 s old, of 5 */
    assert_int_equal(tick(r)->status, APC_UNCERTAIN_LAST_USABLE);
    assert_non_null(strstr(r->notice.text, "stale"));
    assert_int_equal(measured_tick(r, 0.5)->status, APC_GOOD);
}

static void the_integral_stands_still_while_the_output_is_held(void **state)
{
    struct rig *r = *state;
    double before = measured_tick(r, 0.0)->value;
    double after;

    before = measured_tick(r, 0.0)->value;
    blind_tick(r, NULL);
    assert_int_equal(r->notice.kind, APC_NOTICE_HOLD);
    assert_int_equal(find(r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    blind_tick(r, NULL);
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
    assert_int_equal(find(r, APC_STATE, 1)->seq, 0); /* nothing that a restart could go on from */
    assert_int_equal(r->n, 2);                       /* the output and the mode */
    tick(r);
    assert_int_equal(r->n, 1);
}

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

/* ---- Restart --------------------------------------------------------------------------------- */

static double disturbed(int k)
{
    return sin(0.3 * k) + 0.1 * (k % 5);
}

/* What next, in place of r, finds in the store: r's newest rows. */
static void read_stored(const struct rig *next, const struct rig *r, struct apc_sample *rows)
{
    apc_controller_resume_inputs(next->controller, rows);
    for (size_t i = 0; i < apc_controller_size(next->controller).resume; i++) {
        const struct apc_sample *newest =
            rows[i].table == APC_OPMODE ? &r->mode : find(r, rows[i].table, rows[i].id);

        if (newest->seq)
            rows[i] = *newest;
    }
}

/* next goes on in r's place. */
static int take_over(struct rig *next, const struct rig *r)
{
    const int64_t last[] = {find(r, APC_ACTUATOR, 1)->seq};
    struct apc_sample rows[MAX_OUT];

    next->mono = r->mono;
    next->mode = r->mode;
    read_stored(next, r, rows);
    return apc_controller_resume(next->controller, last, rows, T0);
}

/* A second controller takes over from the first's rows after ten ticks; both then see the same. */
static void resume_and_compare(struct rig *r)
{
    struct rig next;

    for (int k = 0; k < 10; k++)
        measured_tick(r, disturbed(k));
    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    for (int k = 10; k < 40; k++) {
        const struct apc_sample *a = measured_tick(r, disturbed(k));
        const struct apc_sample *b = measured_tick(&next, disturbed(k));

        assert_true(memcmp(&a->value, &b->value, sizeof(a->value)) == 0);
        assert_int_equal(a->seq, b->seq);
        assert_int_equal(find(r, APC_STATE, 1)->seq, find(&next, APC_STATE, 1)->seq);
    }
    apc_controller_destroy(next.controller);
}

static void a_restarted_controller_goes_on_bit_for_bit(void **state)
{
    resume_and_compare(*state);
}

static void a_controller_restarted_in_saturation_goes_on_bit_for_bit(void **state)
{
    struct rig *r = *state;

    set(r, Z, 50.0); /* the output stands at its limit */
    resume_and_compare(r);
}

static void a_controller_restarted_after_the_plant_went_safe_begins_from_the_last_output(void **state)
{
    struct rig *r = *state;
    struct rig next;
    double u;

    for (int k = 0; k < 10; k++)
        measured_tick(r, disturbed(k));
    u = find(r, APC_ACTUATOR, 1)->value;
    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    next.mono = r->mono + 4 * PERIOD;
    assert_near(measured_tick(&next, -1.0)->value, u, 1e-14); /* the process has moved far meanwhile */
    apc_controller_destroy(next.controller);
}

/* How long it was away nobody knows then: what the plant does meanwhile must not be taken for one period. */
static void begins_from_the_last_output(void **state, apc_ns away, bool lost)
{
    struct rig *r = *state;
    struct rig next;
    const struct apc_sample *b;
    double u;

    tear_down(state);
    set_up(state);
    for (int k = 0; k < 10; k++)
        measured_tick(r, disturbed(k));
    u = find(r, APC_ACTUATOR, 1)->value;
    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    next.mono = r->mono + away - PERIOD;
    b = measured_tick(&next, -1.0);
    if (lost)
        assert_near(b->value, u, 1e-14);
    else /* as a controller that was never away */
        assert_near(b->value, measured_tick(r, -1.0)->value, 0.0);
    apc_controller_destroy(next.controller);
}

/* The plant follows its last output for three periods and 100 ms, not a nanosecond longer. */
static void an_output_is_followed_until_it_is_lost(void **state)
{
    const apc_ns limit = 3 * PERIOD + 100 * APC_NS_PER_MS;

    begins_from_the_last_output(state, 0, false);
    begins_from_the_last_output(state, limit, false);
    begins_from_the_last_output(state, limit + 1, true);
    begins_from_the_last_output(state, -1, true);
}

static void restarted_with_the_clock_set_back_it_begins_from_the_last_output(void **state)
{
    struct rig *r = *state;
    struct rig next;
    double u;

    for (int k = 0; k < 10; k++)
        measured_tick(r, disturbed(k));
    u = find(r, APC_ACTUATOR, 1)->value;
    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    next.utc_step = -2 * PERIOD;
    assert_near(measured_tick(&next, -1.0)->value, u, 1e-14);
    apc_controller_destroy(next.controller);
}

/* The operator's output of another run; or of this one, set before the controller was there. */
static void only_an_operators_output_of_this_run_is_taken_up_at_the_start(void **state)
{
    static const struct {
        apc_ns since, set;
        bool taken;
    } of[] = {
        {T0 + S, T0, false},            /* a former run's */
        {0, T0, false},                 /* nobody knows when this run began */
        {T0 + S, T0 + 3600 * S, false}, /* of a clock that was set back since */
        {T0 + S, T0 + S, false},        /* at the very begin: who knows */
        {T0 + S, T0 + S + 1, true},     /* of this run */
        {T0 + S, T0 + S + S / 2, true},
        {T0 + S, T0 + PERIOD + 3 * PERIOD + 100 * APC_NS_PER_MS, true}, /* as far ahead as may be */
        {T0 + S, T0 + PERIOD + 3 * PERIOD + 100 * APC_NS_PER_MS + 1, false},
        {T0 + S, T0 + PERIOD + S / 2, true} /* the operator's clock is a little ahead */
    };
    struct rig *r = *state;
    struct apc_sample rows[STORED];
    const int64_t last[] = {10};

    measured_tick(r, 0.5);
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        struct rig next;

        make(&next, &apc_law_pi);
        read_stored(&next, r, rows);
        rows[0].seq = 0; /* no whole state */
        assert_int_equal(apc_controller_resume(next.controller, last, rows, of[i].since), 0);
        memcpy(next.in, r->in, sizeof(next.in));
        set(&next, MODE, APC_MODE_MAN);
        set(&next, MANUAL, 1.5);
        next.in[MANUAL].time = of[i].set;
        assert_near(measured_tick(&next, 0.5)->value, of[i].taken ? 1.5 : FAULT, 0.0);
        assert_near(measured_tick(&next, 0.5)->value, of[i].taken ? 1.5 : FAULT, 0.0);
        set(&next, MANUAL, 1.5); /* now he means it */
        assert_near(measured_tick(&next, 0.5)->value, 1.5, 0.0);
        apc_controller_destroy(next.controller);
    }
}

static void after_a_restart_in_man_an_older_output_of_the_operator_stays_old(void **state)
{
    struct rig *r = *state;
    struct rig next;
    double u;

    measured_tick(r, 0.1);
    set(r, MANUAL, -0.9); /* in this run, but in Auto */
    measured_tick(r, 0.2);
    u = measured_tick(r, 0.3)->value;
    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    set(&next, MODE, APC_MODE_MAN);
    assert_near(measured_tick(&next, 0.3)->value, u, 0.0);
    apc_controller_destroy(next.controller);
}

/* ---- An answer that was lost ------------------------------------------------------------------- */

/* A tick whose append failed; whether it was written all the same, the next read tells. */
static void unanswered_tick(struct rig *r, double y, bool written)
{
    set(r, Y, y);
    r->mono += PERIOD;
    r->n = apc_controller_compute(r->controller, (struct apc_now){r->mono, T0 + r->mono}, r->in, r->out,
                                  &r->notice);
    if (written)
        r->in[WRITTEN] = *find(r, APC_STATE, 0);
}

static void an_output_acts_when_it_was_written_whether_or_not_the_answer_came(void **state)
{
    for (int mode = APC_MODE_MAN; mode <= APC_MODE_AUTO; mode++) {
        struct rig *told = *state;
        struct rig lost, refused;

        tear_down(state);
        set_up(state);
        make(&lost, &apc_law_pi);
        make(&refused, &apc_law_pi);
        set(told, MODE, mode);
        memcpy(lost.in, told->in, sizeof(lost.in));
        memcpy(refused.in, told->in, sizeof(refused.in));
        for (int k = 0; k < 3; k++) {
            measured_tick(told, 0.5);
            measured_tick(&lost, 0.5);
            measured_tick(&refused, 0.5);
        }
        measured_tick(told, 0.2);
        unanswered_tick(&lost, 0.2, true);
        unanswered_tick(&refused, 0.2, false);
        set(told, MODE, APC_MODE_AUTO);
        set(&lost, MODE, APC_MODE_AUTO);
        set(&refused, MODE, APC_MODE_AUTO);
        assert_near(measured_tick(&lost, 0.4)->value, measured_tick(told, 0.4)->value, 0.0);
        if (mode == APC_MODE_AUTO) /* one increment less */
            assert_near(measured_tick(&refused, 0.4)->value,
                        find(told, APC_ACTUATOR, 1)->value - 0.2 * 2.0 / 10.0 * 0.8, 1e-14);
        for (int k = 0; k < 3; k++)
            assert_near(measured_tick(&lost, 0.1)->value, measured_tick(told, 0.1)->value, 0.0);
        apc_controller_destroy(lost.controller);
        apc_controller_destroy(refused.controller);
    }
}

static void tuning_changed_while_it_was_down_gives_no_bump(void **state)
{
    static const double gains[] = {1.0, 0.05, -1.0}; /* for which it would jump up, down, and far down */
    struct rig *r = *state;

    for (size_t i = 0; i < sizeof(gains) / sizeof(gains[0]); i++) {
        struct rig next;
        double u;

        tear_down(state);
        set_up(state);
        for (int k = 0; k < 10; k++)
            measured_tick(r, 0.5);
        u = find(r, APC_ACTUATOR, 1)->value;
        make(&next, &apc_law_pi);
        assert_int_equal(take_over(&next, r), 1);
        memcpy(next.in, r->in, sizeof(next.in));
        set(&next, KP, gains[i]);
        assert_near(measured_tick(&next, 0.5)->value, u + gains[i] * 2.0 / 10.0 * 0.5, 1e-14);
        apc_controller_destroy(next.controller);
    }
}

static void a_state_that_is_not_whole_or_another_runs_is_not_taken_but_seq_counts_on(void **state)
{
    struct rig *r = *state;
    struct apc_sample rows[STORED];
    const int64_t last[] = {10};

    for (int k = 0; k < 10; k++)
        measured_tick(r, 0.5);
    read_stored(r, r, rows);
    rows[STORED - 1].seq = 5; /* of the actual mode */
    for (int what = 0; what < 5; what++) {
        struct apc_sample broken[STORED];
        struct rig next;

        memcpy(broken, rows, sizeof(broken));
        if (what == 0)
            broken[2].seq = 0;
        else if (what == 1)
            broken[1].value = (double)NAN;
        else if (what == 2)
            broken[3].seq--; /* two ticks mixed */
        else if (what == 3)
            broken[0].seq = 0; /* whose it is nobody knows */
        make(&next, &apc_law_pi);
        assert_int_equal(
            apc_controller_resume(next.controller, last, broken, what == 4 ? rows[0].time + 1 : T0), 0);
        memcpy(next.in, r->in, sizeof(next.in));
        next.mono = r->mono;
        measured_tick(&next, 0.5);
        assert_near(find(&next, APC_ACTUATOR, 1)->value, 0.1, 1e-15);
        assert_int_equal(find(&next, APC_ACTUATOR, 1)->seq, 11);
        assert_int_equal(find(&next, APC_STATE, 6)->seq, 11);
        assert_int_equal(find(&next, APC_OPMODE, 1)->seq, 6);
        apc_controller_destroy(next.controller);
    }
}

/* u = 8 + x1, cut to the limit of 2; its second state is there to lie where others have something else. */
static size_t two_states(const struct apc_dim *dim)
{
    (void)dim;
    return 2;
}

static int high_compute(struct apc_law_call *c)
{
    c->u[0] = 8.0 + c->x[0];
    return APC_LAW_GOOD;
}

static void high_track(struct apc_law_call *c)
{
    c->x[0] = c->u[0] - 8.0;
    c->x[1] = 777.0;
}

static const struct apc_law high_law = {
    .abi = APC_LAW_ABI, .name = "high", .n_state = two_states, .compute = high_compute, .track = high_track};

static size_t one_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

static void another_law_goes_on_from_the_last_output_in_man_and_in_auto(void **state)
{
    for (int mode = APC_MODE_MAN; mode <= APC_MODE_AUTO; mode++) {
        struct rig *r = *state;
        struct rig high, back;

        tear_down(state);
        set_up(state);
        set(r, MODE, APC_MODE_MAN);
        set(r, MANUAL, 0.5);
        assert_near(measured_tick(r, 0.3)->value, 0.5, 0.0);

        make(&high, &high_law);
        assert_int_equal(take_over(&high, r), 1);
        apc_controller_inputs(high.controller, high.in); /* y, z, mode, manual: no tuning */
        set(&high, Z, 1.0);
        set(&high, MODE, mode);
        assert_near(measured_tick(&high, 0.3)->value, 0.5, 1e-14);
        assert_near(measured_tick(&high, 0.3)->value, 0.5, 1e-14);

        make(&back, &apc_law_pi);
        assert_int_equal(take_over(&back, &high), 1);
        memcpy(back.in, r->in, sizeof(back.in));
        set(&back, MODE, mode);
        assert_near(measured_tick(&back, 0.3)->value, 0.5, 1e-14);
        apc_controller_destroy(high.controller);
        apc_controller_destroy(back.controller);
    }
}

static void a_law_of_as_many_states_but_another_name_does_not_take_the_state(void **state)
{
    const struct apc_law other = {
        .abi = APC_LAW_ABI, .name = "other", .n_state = one_state, .compute = high_compute};
    struct rig *r = *state;
    struct rig next;

    set(r, U_BAR, -7.0); /* so that the PI's state is far from 0 */
    set(r, MODE, APC_MODE_MAN);
    set(r, MANUAL, 0.5);
    measured_tick(r, 0.3);
    assert_near(find(r, APC_STATE, 6)->value, 0.5 + 7.0 - 0.2 * 0.7, 1e-14);
    make(&next, &other);
    assert_int_equal(take_over(&next, r), 1);
    apc_controller_inputs(next.controller, next.in);
    set(&next, Z, 1.0);
    set(&next, MODE, APC_MODE_MAN);
    measured_tick(&next, 0.3);
    assert_near(find(&next, APC_STATE, 6)->value, 0.0, 0.0);
    apc_controller_destroy(next.controller);
}

/* {2, 1, 1} without states stores as many rows as the PI's {1, 1, 1}. */
static void with_other_dimensions_it_starts_anew(void **state)
{
    const struct apc_law stateless = {.abi = APC_LAW_ABI, .name = "stateless", .compute = high_compute};
    struct rig *r = *state;
    struct rig next;
    const int64_t last[] = {7};
    struct apc_sample rows[STORED];

    measured_tick(r, 0.5);
    make_sized(&next, &stateless, (struct apc_dim){2, 1, 1, 0});
    assert_int_equal(apc_controller_size(next.controller).resume, STORED);
    read_stored(&next, r, rows);
    assert_int_equal(apc_controller_resume(next.controller, last, rows, T0), 0);
    assert_int_equal(apc_controller_resume(next.controller, last, NULL, T0), 0);
    apc_controller_destroy(next.controller);
}

static void a_state_left_by_a_law_before_the_last_one_is_not_taken(void **state)
{
    struct rig *r = *state;
    struct rig next;
    const int64_t last[] = {10};
    struct apc_sample rows[STORED];

    for (int k = 0; k < 10; k++)
        measured_tick(r, 0.5);
    read_stored(r, r, rows);
    rows[6].seq--; /* x alone is older: a law without states wrote since */
    rows[6].value = 50.0;
    make(&next, &apc_law_pi);
    assert_int_equal(apc_controller_resume(next.controller, last, rows, T0), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    next.mono = r->mono;
    assert_near(measured_tick(&next, 0.5)->value, find(r, APC_ACTUATOR, 1)->value, 1e-14);
    apc_controller_destroy(next.controller);
}

static void the_signature_is_a_whole_number_that_a_double_holds_exactly(void **state)
{
    struct rig *r = *state;
    double signature;

    measured_tick(r, 0.5);
    signature = find(r, APC_STATE, 0)->value;
    assert_true(signature > 0.0 && signature < 0x1p53);
    assert_near(signature, trunc(signature), 0.0);
    measured_tick(r, 0.5);
    assert_near(find(r, APC_STATE, 0)->value, signature, 0.0);
}

/* FNV-1a; a number as eight bytes, the lowest first. */
static uint32_t marked(uint32_t mark, const void *data, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        mark ^= ((const unsigned char *)data)[i];
        mark *= 16777619u;
    }
    return mark;
}

static uint32_t marked_number(uint32_t mark, uint64_t number)
{
    for (int i = 0; i < 8; i++) {
        const unsigned char byte = (unsigned char)(number >> (8 * i) & 0xff);

        mark = marked(mark, &byte, 1);
    }
    return mark;
}

static uint32_t marked_value(uint32_t hash, double value)
{
    uint64_t bits;

    memcpy(&bits, &value, sizeof(bits));
    return marked_number(hash, bits);
}

/*
 * What is stored is known again by another build of the same law, and by no other: the mark is of the
 * dimensions, 21 bits, then the law's name, that it is built in, its version, that it is whole, the
 * dimensions, its number of states and of the model's, its period, and its settings.
 */
static void the_signature_is_of_dimensions_law_version_and_settings(void **state)
{
    static const double two = 2.0;
    static const struct apc_setting setting = {"feed_forward", NULL, 1, 1, &two};
    static const struct {
        const struct apc_law *law;
        struct apc_dim dim;
        size_t states, settings;
    } of[] = {{&apc_law_pi, {1, 1, 1, 0}, 1, 0},
              {&apc_law_pid, {2, 1, 1, 0}, 6, 0},
              {&apc_law_pid, {2, 1, 1, 0}, 6, 1},
              {&apc_law_pid, {1, 2, 1, 0}, 6, 0}};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        const struct apc_controller_options o = {.size = sizeof(o),
                                                 .law = of[i].law,
                                                 .dim = of[i].dim,
                                                 .period = PERIOD,
                                                 .horizon = HORIZON,
                                                 .n_setting = of[i].settings,
                                                 .setting = &setting};
        const size_t number[] = {of[i].law->version, 0, of[i].dim.ny, of[i].dim.nz, 1, 0, of[i].states, 0};
        uint32_t dim = marked_number(2166136261u, of[i].dim.ny), law = 2166136261u;
        struct apc_sample in[20], out[40];
        struct apc_controller *c;
        int n;

        dim = marked_number(marked_number(marked_number(dim, of[i].dim.nz), of[i].dim.nu), 0);
        law = marked_number(marked(law, of[i].law->name, strlen(of[i].law->name)), 0);
        for (size_t k = 0; k < sizeof(number) / sizeof(number[0]); k++)
            law = marked_number(law, number[k]);
        law = marked_value(law, (double)PERIOD / (double)S);
        if (of[i].settings) {
            law = marked(law, setting.name, strlen(setting.name) + 1);
            law = marked_value(marked_number(marked_number(law, 1), 1), two);
        }
        assert_int_equal(apc_controller_create(&c, &o, NULL), 0);
        assert_in_range(apc_controller_size(c).in, 1, 20);
        assert_in_range(apc_controller_size(c).out, 1, 40);
        apc_controller_inputs(c, in);
        for (size_t k = 0; k < of[i].dim.ny + of[i].dim.nz + 1; k++) {
            in[k].seq = 1;
            in[k].time = T0 + S;
            in[k].status = APC_GOOD;
            in[k].value = 1.0; /* the mode: Auto */
        }
        n = apc_controller_compute(c, (struct apc_now){.mono = S, .utc = T0 + S}, in, out, NULL);
        assert_in_range(n, 3, 40);
        assert_int_equal(out[1].table, APC_STATE);
        assert_int_equal(out[1].id, 0);
        assert_near(out[1].value, (double)(dim >> 11) * 4294967296.0 + law, 0.0);
        apc_controller_destroy(c);
    }
}

static void a_restart_while_the_measurement_is_lost_holds_the_old_output(void **state)
{
    struct rig *r = *state;
    struct rig next;
    double u = measured_tick(r, 0.5)->value;

    make(&next, &apc_law_pi);
    assert_int_equal(take_over(&next, r), 1);
    memcpy(next.in, r->in, sizeof(next.in));
    next.in[Y].status = APC_BAD;
    assert_near(tick(&next)->value, u, 0.0);
    assert_int_equal(find(&next, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    apc_controller_destroy(next.controller);
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

static void a_law_that_gives_no_finite_number_is_held_and_begins_anew(void **state)
{
    struct rig r;
    const struct apc_sample *u;
    struct apc_sample in[5];
    char count[16];

    (void)state;
    make(&r, &fragile);
    apc_controller_inputs(r.controller, in);
    memcpy(r.in, in, sizeof(in)); /* y, z, mode, manual: no tuning */
    set(&r, MODE, APC_MODE_AUTO);
    for (double z = 6.0; z <= 9.0; z += 1.0) {
        set(&r, Z, 1.0);
        assert_near(measured_tick(&r, 0.0)->value, 0.5, 0.0);
        set(&r, Z, z);
        u = measured_tick(&r, 0.0);
        assert_near(u->value, 0.5, 0.0);
        assert_int_equal(u->status, APC_UNCERTAIN_LAST_USABLE);
        assert_int_equal(u->sensor_seq, 0); /* computed from nothing that is there now */
        assert_int_equal(u->setpoint_seq, 0);
        assert_int_equal(r.notice.kind, APC_NOTICE_REJECTED);
        assert_int_equal(apc_controller_failures(r.controller), (int)z - 5);
        snprintf(count, sizeof(count), "(%d)", (int)z - 5);
        assert_non_null(strstr(r.notice.text, count));
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
    assert_non_null(strstr(why.text, "2 setpoints"));
    o = good;
    o.high = &high; /* zeros, the default fault value, lie outside */
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
    o.hold = -1;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_int_equal(apc_controller_create(NULL, &good, &why), APC_EINVAL);
    apc_controller_destroy(NULL);
}

static int free_compute(struct apc_law_call *c)
{
    (void)c;
    return APC_LAW_GOOD;
}

static size_t a_million(const struct apc_dim *dim)
{
    return 1000000 + (dim->nz == 1);
}

/* What a frame and a year hold; a setpoint is not needed. */
static void dimensions_and_periods_have_bounds_and_reach_them(void **state)
{
    static const struct apc_dim bad[] = {
        {0, 1, 1, 0}, {8193, 1, 1, 0}, {1, 8193, 1, 0}, {1, 1, 0, 0}, {1, 1, 8193, 0}};
    static const struct apc_dim fine[] = {{8192, 0, 1, 0}, {1, 8192, 1, 0}, {1, 1, 8192, 0}, {1, 0, 1, 0}};
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
        apc_controller_destroy(c);
    }
    o.dim = good.dim;
    for (int what = 0; what < 3; what++) {
        apc_ns *of = what == 0 ? &o.period : what == 1 ? &o.horizon : &o.hold;

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
    law.n_state = a_million;
    assert_int_equal(apc_controller_create(&c, &o, &why), 0);
    apc_controller_destroy(c);
    o.dim.nz = 1;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "wants 1000001 states"));
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(it_names_what_it_reads),
        T(each_tick_confirms_the_operators_rows_that_it_took),
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
        T(an_output_is_followed_until_it_is_lost),
        T(restarted_with_the_clock_set_back_it_begins_from_the_last_output),
        T(only_an_operators_output_of_this_run_is_taken_up_at_the_start),
        T(after_a_restart_in_man_an_older_output_of_the_operator_stays_old),
        T(an_output_acts_when_it_was_written_whether_or_not_the_answer_came),
        T(from_auto_to_man_an_old_output_of_the_operator_is_not_taken_up),
        T(an_output_set_right_after_the_change_to_man_is_taken_at_once),
        T(a_mode_that_could_not_be_written_is_written_again),
        T(from_man_to_auto_there_is_no_bump),
        T(a_change_of_tuning_in_auto_gives_no_bump),
        T(tuning_out_of_range_is_refused_once_and_the_last_good_one_kept),
        T(out_of_service_writes_no_output),
        T(a_lost_measurement_holds_then_faults_then_recovers_without_a_bump),
        cmocka_unit_test(what_the_output_is_held_for_is_said),
        T(a_measurement_that_is_no_longer_renewed_is_stale),
        T(the_integral_stands_still_while_the_output_is_held),
        T(without_any_measurement_yet_nothing_goes_out_until_the_fault_value),
        T(a_clock_step_of_an_hour_changes_nothing),
        T(a_restarted_controller_goes_on_bit_for_bit),
        T(a_controller_restarted_in_saturation_goes_on_bit_for_bit),
        T(a_controller_restarted_after_the_plant_went_safe_begins_from_the_last_output),
        T(tuning_changed_while_it_was_down_gives_no_bump),
        T(a_state_that_is_not_whole_or_another_runs_is_not_taken_but_seq_counts_on),
        T(another_law_goes_on_from_the_last_output_in_man_and_in_auto),
        T(a_law_of_as_many_states_but_another_name_does_not_take_the_state),
        T(with_other_dimensions_it_starts_anew),
        T(a_state_left_by_a_law_before_the_last_one_is_not_taken),
        T(the_signature_is_a_whole_number_that_a_double_holds_exactly),
        cmocka_unit_test(the_signature_is_of_dimensions_law_version_and_settings),
        T(a_restart_while_the_measurement_is_lost_holds_the_old_output),
        cmocka_unit_test(a_law_that_gives_no_finite_number_is_held_and_begins_anew),
        cmocka_unit_test(a_controller_that_could_not_work_is_refused),
        cmocka_unit_test(dimensions_and_periods_have_bounds_and_reach_them),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
