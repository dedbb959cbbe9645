/* SPDX-License-Identifier: BSD-3-Clause */
/* How a controller goes on after a restart, after a lost answer, and with another law. */
#include <string.h>

#include "controller_rig.h"

/* ---- Restart --------------------------------------------------------------------------------- */

static double disturbed(int k)
{
    return sin(0.3 * k) + 0.1 * (k % 5);
}

/* What next, in place of r, finds in the store: r's newest rows. */
static void read_stored(const struct rig *next, const struct rig *r)
{
    struct apc_rows *former = apc_controller_former(next->controller);
    struct apc_vector *v = &former->vector[0];
    const struct apc_vector name = *v;

    for (size_t i = 0; i < former->n_samples; i++) {
        for (size_t k = 0; k < r->n_actual; k++) {
            if (r->actual[k].id == former->sample[i].id)
                former->sample[i] = r->actual[k];
        }
    }
    *v = r->tick;
    v->room = name.room;
    v->value = name.value;
    memcpy(v->value, r->row, (v->n < v->room ? v->n : v->room) * sizeof(*v->value));
}

/* next goes on in r's place. */
static int take_over(struct rig *next, const struct rig *r)
{
    const size_t mine = apc_controller_in(next->controller)->n_samples,
                 its = apc_controller_in(r->controller)->n_samples;

    next->mono = r->mono;
    next->index = r->index;
    memcpy(next->actual, r->actual, sizeof(next->actual));
    next->n_actual = r->n_actual;
    next->in[mine - 1] = r->in[its - 1];
    read_stored(next, r);
    return apc_controller_resume(next->controller, T0);
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
        assert_int_equal(r->tick.seq, next.tick.seq);
        assert_int_equal(r->tick.n, next.tick.n);
        assert_memory_equal(r->row, next.row, r->tick.n * sizeof(*r->row)); /* and all that it says */
    }
    apc_controller_destroy(next.controller);
}

/* Promise(run/restarted-controller): A restarted controller goes on bit for bit, with each law. */
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
/* Promise(run/set-hand-former): What was set by hand in a former run is never taken up. */
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

    measured_tick(r, 0.5);
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        struct rig next;

        make(&next, &apc_law_pi);
        assert_int_equal(apc_controller_resume(next.controller, of[i].since), 0); /* there is no tick row */
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
    compute(r, (struct apc_now){r->mono, T0 + r->mono}, true, written);
    apc_controller_update(r->controller, -1);
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
        assert_near(measured_tick(&next, 0.5)->value, u + 0.2 * 2.0 / 10.0 * 0.5, 1e-14); /* as had it run */
        assert_near(measured_tick(&next, 0.5)->value, u + (0.2 + gains[i]) * 2.0 / 10.0 * 0.5, 1e-14);
        apc_controller_destroy(next.controller);
    }
}

static void a_row_that_is_not_whole_or_another_runs_is_not_taken_but_seq_counts_on(void **state)
{
    struct rig *r = *state;

    for (int k = 0; k < 10; k++)
        measured_tick(r, 0.5);
    for (int what = 0; what < 7; what++) {
        struct rig next;
        struct apc_vector *v;

        make(&next, &apc_law_pi);
        memcpy(next.in, r->in, sizeof(next.in));
        next.mono = r->mono;
        memcpy(next.actual, r->actual, sizeof(next.actual));
        next.n_actual = r->n_actual;
        read_stored(&next, r);
        v = &apc_controller_former(next.controller)->vector[0];
        if (what == 0)
            v->status = APC_BAD;
        else if (what == 1)
            v->value[3] = (double)NAN;
        else if (what == 2)
            v->n = 3;
        else if (what == 3)
            v->value[0] += 1.0; /* of other dimensions */
        else if (what == 4)
            v->n = 0;
        else if (what == 5)
            v->value[v->n - 1] = HUGE_VAL;
        assert_int_equal(apc_controller_resume(next.controller, what == 6 ? r->tick.time + 1 : T0), 0);
        measured_tick(&next, 0.5);
        assert_near(find(&next, APC_ACTUATOR, 1)->value, 0.1, 1e-15);
        assert_int_equal(find(&next, APC_ACTUATOR, 1)->seq, 11);
        assert_int_equal(next.tick.seq, 11);
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

/* Promise(laws/state-law-settings) */
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
    assert_near(field(r, APC_TICK_X)[0], 0.5 + 7.0 - 0.2 * 0.7, 1e-14);
    make(&next, &other);
    assert_int_equal(take_over(&next, r), 1);
    set(&next, Z, 1.0);
    set(&next, MODE, APC_MODE_MAN);
    measured_tick(&next, 0.3);
    assert_near(field(&next, APC_TICK_X)[0], 0.0, 0.0);
    apc_controller_destroy(next.controller);
}

static void with_other_dimensions_it_starts_anew(void **state)
{
    const struct apc_law stateless = {.abi = APC_LAW_ABI, .name = "stateless", .compute = high_compute};
    struct rig *r = *state;
    struct rig next;

    measured_tick(r, 0.5);
    make_sized(&next, &stateless, (struct apc_dim){2, 1, 1, 0});
    read_stored(&next, r);
    assert_int_equal(apc_controller_resume(next.controller, T0), 0);
    apc_controller_destroy(next.controller);
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

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(an_output_is_followed_until_it_is_lost),
        T(restarted_with_the_clock_set_back_it_begins_from_the_last_output),
        T(only_an_operators_output_of_this_run_is_taken_up_at_the_start),
        T(after_a_restart_in_man_an_older_output_of_the_operator_stays_old),
        T(an_output_acts_when_it_was_written_whether_or_not_the_answer_came),
        T(a_restarted_controller_goes_on_bit_for_bit),
        T(a_controller_restarted_in_saturation_goes_on_bit_for_bit),
        T(a_controller_restarted_after_the_plant_went_safe_begins_from_the_last_output),
        T(tuning_changed_while_it_was_down_gives_no_bump),
        T(a_row_that_is_not_whole_or_another_runs_is_not_taken_but_seq_counts_on),
        T(another_law_goes_on_from_the_last_output_in_man_and_in_auto),
        T(a_law_of_as_many_states_but_another_name_does_not_take_the_state),
        T(with_other_dimensions_it_starts_anew),
        T(a_restart_while_the_measurement_is_lost_holds_the_old_output),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
