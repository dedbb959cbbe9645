/* SPDX-License-Identifier: BSD-3-Clause */
/* The backup law acts while the law proper cannot: into it and out of it nothing moves that it does not move. */
/*
 * Promise(modes/law-act-gives): A law that cannot act gives way to its backup law and comes back, and
 *   nothing moves that the acting law does not move; a restart in between goes on bit for bit.
 */
#include "two_loops.h"

/* ---- Laws ------------------------------------------------------------------------------------- */

enum { KP, INTEGRAL, MOOD, N_TUNING };

/* PI; mood is the result of its answer. */
static const struct apc_param tuning[] = {{"Kp", "", "", 0.5, -10.0, 10.0},
                                          {"integral", "", "", 0.125, -10.0, 10.0},
                                          {"mood", "", "", 0.0, 0.0, 4.0}};

static size_t one_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

static double error_of(const struct apc_law_call *c)
{
    return c->z[0] - c->y[0];
}

static int compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[KP] * error_of(c) + c->x[0];
    return (int)c->tuning[MOOD];
}

static void track(struct apc_law_call *c)
{
    c->x[0] = c->u[0] - c->tuning[KP] * error_of(c);
}

static void update(struct apc_law_call *c)
{
    track(c);
    c->x[0] += c->tuning[INTEGRAL] * error_of(c);
}

static const struct apc_law moody = {.abi = APC_LAW_ABI,
                                     .name = "moody",
                                     .n_tuning = N_TUNING,
                                     .tuning = tuning,
                                     .n_state = one_state,
                                     .compute = compute,
                                     .update = update,
                                     .track = track};

/* One law of both outputs, which wants both measurements; u are x. */
static size_t two_states(const struct apc_dim *dim)
{
    return dim->nu;
}

static int compute_all(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++)
        c->u[i] = c->x[i] + 0.125 * c->y[i];
    return (int)c->tuning[0];
}

static void track_all(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->out[i] != APC_OUT_LAW)
            c->x[i] = c->u[i] - 0.125 * c->y[i];
    }
}

static const struct apc_param whole_tuning[] = {{"mood", "", "", 0.0, 0.0, 4.0}};
static const enum apc_law_scope whole_scope[] = {APC_OF_LAW};
static const struct apc_law moody_whole = {.abi = APC_LAW_ABI,
                                           .name = "whole",
                                           .whole = true,
                                           .n_tuning = 1,
                                           .tuning = whole_tuning,
                                           .scope = whole_scope,
                                           .n_state = two_states,
                                           .compute = compute_all,
                                           .track = track_all};

/* Half as lively, and with the other's parameters behind those of the law. */
static const double calm[LOOPS * N_TUNING] = {0.25, 0.0625, 0.0, 0.25, 0.0625, 0.0};
static const struct apc_controller_backup backup = {.law = &moody, .start = calm};

static int tuning_of(bool of_backup, int loop, int number)
{
    return (of_backup ? LOOPS * N_TUNING : 0) + (loop - 1) * N_TUNING + number + 1;
}

static void mood(struct rig *r, int loop, enum apc_law_result result)
{
    set(r, APC_TUNING, tuning_of(false, loop, MOOD), result);
}

static enum apc_loop_state state_of(const struct rig *r, int loop)
{
    return r->core->state[loop - 1].loop.state;
}

static void begin(struct rig *r, const struct apc_law *law)
{
    rate_of = 0.0;
    backup_of = &backup;
    make(r, law);
}

/* ---- Into it, and back -------------------------------------------------------------------------- */

static void shed_by(enum apc_law_result result)
{
    const bool usable = result <= APC_LAW_LATE;
    struct rig r;
    double last;

    begin(&r, &moody);
    measured_tick(&r, 0.5, 0.5);
    measured_tick(&r, 0.5, 0.5);
    mood(&r, 1, result);
    for (int k = 0; k < 3; k++) {
        last = u(&r, 1);
        measured_tick(&r, 0.5, 0.5);
        assert_near(u(&r, 1), last + (usable ? 0.0625 : 0.0), 0.0);
        assert_int_equal(state_of(&r, 1), usable ? APC_LOOP_AUTO : APC_LOOP_HOLD);
    }
    last = u(&r, 1);
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    assert_near(u(&r, 1), last, 0.0);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_GOOD);
    assert_int_equal(actual(&r, APC_OPMODE, 1)->status, APC_GOOD_LOCAL_OVERRIDE);
    assert_near(actual(&r, APC_OPMODE, 1)->value, APC_MODE_AUTO, 0.0);
    assert_non_null(strstr(r.notice.text, "v1: the backup law acts: law moody "));
    measured_tick(&r, 0.5, 0.5);
    assert_near(u(&r, 1), last + 0.03125, 0.0); /* by its own tuning */
    assert_int_equal(state_of(&r, 2), APC_LOOP_AUTO);

    mood(&r, 1, APC_LAW_GOOD);
    for (int k = 0; k < 3; k++) {
        measured_tick(&r, 0.5, 0.5);
        assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    }
    last = u(&r, 1);
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_AUTO);
    assert_near(u(&r, 1), last, 0.0);
    assert_int_equal(r.notice.kind, APC_NOTICE_RECOVERED);
    assert_int_equal(actual(&r, APC_OPMODE, 1)->status, APC_GOOD);
    measured_tick(&r, 0.5, 0.5);
    assert_near(u(&r, 1), last + 0.0625, 0.0);
    end(&r);
}

static void a_law_without_good_answers_gives_way_and_comes_back_without_a_bump(void **state)
{
    (void)state;
    shed_by(APC_LAW_LATE);
    shed_by(APC_LAW_INFEASIBLE);
    shed_by(APC_LAW_FAILED);
}

static void one_that_misses_a_measurement_gives_way_to_one_that_does_without(void **state)
{
    struct rig r;

    (void)state;
    begin(&r, &moody_whole);
    measured_tick(&r, 0.5, 0.5);
    for (int k = 0; k < 4; k++) {
        set(&r, APC_SENSOR, 1, 0.5);
        in_of(&r, APC_SENSOR, 1)->status = APC_BAD;
        set(&r, APC_SENSOR, 2, 0.5);
        tick(&r, WRITTEN);
    }
    assert_int_equal(state_of(&r, 2), APC_LOOP_BACKUP);
    assert_int_equal(state_of(&r, 1), APC_LOOP_FAULT); /* its own is missing there, too */
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_AUTO);
    assert_int_equal(state_of(&r, 2), APC_LOOP_AUTO);
    end(&r);
}

static void an_operator_takes_the_output_from_it_as_from_any_law(void **state)
{
    struct rig r;

    (void)state;
    begin(&r, &moody);
    mood(&r, 1, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 6; k++)
        measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    set(&r, APC_OPMODE, 1, APC_MODE_MAN);
    set(&r, APC_MANUAL, 1, -0.5);
    measured_tick(&r, 0.5, 0.5);
    assert_near(u(&r, 1), -0.5, 0.0);
    set(&r, APC_OPMODE, 1, APC_MODE_AUTO); /* and the count begins anew */
    for (int k = 0; k < 3; k++) {
        measured_tick(&r, 0.5, 0.5);
        assert_int_equal(state_of(&r, 1), APC_LOOP_HOLD);
    }
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    assert_near(u(&r, 1), -0.5, 0.0);
    end(&r);
}

/* ---- While it cannot act either ------------------------------------------------------------------- */

static void bad_tick(struct rig *r)
{
    set(r, APC_SENSOR, 1, 0.5);
    in_of(r, APC_SENSOR, 1)->status = APC_BAD;
    set(r, APC_SENSOR, 2, 0.5);
    tick(r, WRITTEN);
}

static void its_own_lost_measurement_is_bridged_for_as_long_as_any(void **state)
{
    struct rig r;
    double last;

    (void)state;
    begin(&r, &moody);
    mood(&r, 1, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 6; k++)
        measured_tick(&r, 0.5, 0.5);
    last = u(&r, 1);
    for (int k = 0; k < 2; k++) { /* some Bad ones */
        bad_tick(&r);
        assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
        assert_near(u(&r, 1), last, 0.0);
        assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    }
    measured_tick(&r, 0.75, 0.5);
    assert_near(u(&r, 1), last, 0.0); /* it tracks first */
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_GOOD);
    measured_tick(&r, 0.75, 0.5);
    assert_near(u(&r, 1), last + 0.0625 * 0.25, 0.0);
    for (int k = 0; k < 3; k++) {
        bad_tick(&r);
        assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    }
    bad_tick(&r);
    assert_int_equal(state_of(&r, 1), APC_LOOP_FAULT);
    assert_near(u(&r, 1), fault[0], 0.0);
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    assert_near(u(&r, 1), fault[0], 0.0);
    end(&r);
}

static void must_stay_at_fault(struct rig *r)
{
    for (int k = 0; k < 10; k++) {
        assert_int_equal(state_of(r, 1), APC_LOOP_FAULT);
        assert_near(u(r, 1), fault[0], 0.0);
        measured_tick(r, 0.5, 0.5);
        assert_int_not_equal(r->notice.kind, APC_NOTICE_FAULT); /* it was said */
    }
}

static void one_that_fails_as_well_ends_at_the_fault_value_and_stays_there(void **state)
{
    const int its = tuning_of(true, 1, MOOD);
    struct rig r;
    double last;

    (void)state;
    begin(&r, &moody);
    measured_tick(&r, 0.5, 0.5);
    mood(&r, 1, APC_LAW_INFEASIBLE);
    set(&r, APC_TUNING, its, APC_LAW_FAILED);
    for (int k = 0; k < 3; k++)
        measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_HOLD);
    measured_tick(&r, 0.5, 0.5); /* long enough held for the law */
    assert_int_equal(r.notice.kind, APC_NOTICE_FAULT);
    must_stay_at_fault(&r);
    set(&r, APC_TUNING, its, APC_LAW_GOOD);
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
    assert_near(u(&r, 1), fault[0], 0.0);
    measured_tick(&r, 0.5, 0.5);
    last = u(&r, 1);
    set(&r, APC_TUNING, its, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 3; k++) { /* and as long for the one in its place */
        measured_tick(&r, 0.5, 0.5);
        assert_int_equal(state_of(&r, 1), APC_LOOP_BACKUP);
        assert_near(u(&r, 1), last, 0.0);
        assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    }
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(r.notice.kind, APC_NOTICE_FAULT);
    assert_non_null(strstr(r.notice.text, "backup law moody gave no output"));
    must_stay_at_fault(&r);
    end(&r);
}

/* ---- Tuning -------------------------------------------------------------------------------------- */

static void it_is_tuned_like_a_law_and_without_a_bump(void **state)
{
    const int Kp = tuning_of(true, 1, KP);
    struct rig r;
    double last;

    (void)state;
    begin(&r, &moody);
    mood(&r, 1, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 6; k++)
        measured_tick(&r, 0.5, 0.5);
    last = u(&r, 1);
    set(&r, APC_TUNING, Kp, 2.0);
    measured_tick(&r, 0.5, 0.5);
    assert_near(u(&r, 1), last + 0.03125, 0.0);
    assert_near(actual(&r, APC_TUNING, Kp)->value, 2.0, 0.0);
    measured_tick(&r, 0.25, 0.5);
    assert_near(u(&r, 1), last + 0.0625 + 2.0 * 0.25, 0.0);
    set(&r, APC_TUNING, Kp, 20.0);
    measured_tick(&r, 0.25, 0.5);
    assert_int_equal(actual(&r, APC_TUNING, Kp)->status, APC_BAD);
    assert_string_equal(r.notice.text, "backup.Kp of v1 refused: 20 is not within -10 to 10");
    end(&r);
}

/* ---- Chance -------------------------------------------------------------------------------------- */

/* What of a loop is to be compared with the next tick. */
struct before {
    enum apc_loop_state state;
    enum apc_loop_output output;
    double u, e;
    bool there;
};

static void stir(struct rig *r, int id)
{
    static const double modes[] = {APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_AUTO, APC_MODE_AUTO, APC_MODE_OOS};

    if (one_in(40))
        set(r, APC_OPMODE, id, modes[apc_random_next(&random_of) % 5]);
    if (one_in(9))
        set(r, APC_MANUAL, id, 2.0 * number());
    if (one_in(9))
        set(r, APC_SETPOINT, id, 2.0 * number());
    if (one_in(7))
        mood(r, id, (enum apc_law_result)(one_in(2) ? 0 : apc_random_next(&random_of) % 5));
    if (one_in(25))
        set(r, APC_TUNING, tuning_of(true, id, MOOD), one_in(3) ? APC_LAW_FAILED : APC_LAW_GOOD);
    if (!one_in(6))
        set(r, APC_SENSOR, id, number());
    if (one_in(12))
        in_of(r, APC_SENSOR, id)->status = APC_BAD_SENSOR_FAILURE;
}

static double error_now(const struct rig *r, int id)
{
    return r->core->z[id - 1] - r->core->y[id - 1];
}

/* The law's integral is where the output is, but for what its own last update added. */
static void must_track(const struct rig *r, const struct apc_controller_law *law, int id, bool acts)
{
    const double *k = law->tuning + (id - 1) * N_TUNING, e = error_now(r, id);
    const double apart = fabs(law->x[id - 1] - (r->core->u[id - 1] - k[KP] * e));

    if (apart > fabs(k[INTEGRAL] * e) + 1e-12)
        fail_msg("tick %d: an integral is %g off (%d)", (int)r->index, apart, acts);
}

static void must_hold(const struct rig *r, const struct before *b, int id, unsigned *entered)
{
    const struct apc_controller_state *l = &r->core->state[id - 1];
    const bool by_backup = l->move.output == APC_PUT_BACKUP, by_law = l->move.output == APC_PUT_LAW;
    const struct apc_controller_law *law = by_backup ? &r->core->backup : &r->core->law;
    const double *k = law->tuning + (id - 1) * N_TUNING, now = r->core->u[id - 1];
    const double own = fabs(k[KP] * (error_now(r, id) - b->e)) + fabs(k[INTEGRAL] * b->e);

    assert_true(isfinite(now) && now >= -1.0 && now <= 2.0);
    if (!b->there || !l->there)
        return;
    if (rate_of > 0.0 && l->move.output != APC_PUT_FAULT)
        assert_true(fabs(now - b->u) <= rate_of * 2.0 * (1 + 1e-12));
    if (l->move.output == APC_PUT_LAST)
        assert_near(now, b->u, 0.0);
    if (!by_backup && !by_law)
        return;
    if (l->move.output != b->output)
        assert_near(now, b->u, 1e-12); /* nothing moves where one takes over */
    else if (fabs(now - b->u) > own + 1e-12)
        fail_msg("tick %d: it moved by %g, the law by %g", (int)r->index, fabs(now - b->u), own);
    entered[by_backup] += l->move.output != b->output;
}

static void whatever_happens_no_output_moves_by_more_than_the_acting_law(void **state)
{
    unsigned entered[2] = {0, 0}, faulted = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 40; seed++) {
        struct rig r;
        struct before before[LOOPS] = {{.there = false}};

        apc_random_init(&random_of, seed, "backup");
        begin(&r, &moody);
        apc_controller_destroy(r.core);
        rate_of = seed % 2 ? 0.0 : 0.05;
        make(&r, &moody);
        for (int k = 0; k < 2500; k++) {
            for (int id = 1; id <= LOOPS; id++)
                stir(&r, id);
            tick(&r, WRITTEN);
            for (int id = 1; id <= LOOPS; id++) {
                const struct apc_controller_state *l = &r.core->state[id - 1];

                must_hold(&r, &before[id - 1], id, entered);
                if (l->inputs.input && l->there && l->move.law & APC_ASK_UPDATE)
                    must_track(&r, &r.core->law, id, l->move.output == APC_PUT_LAW);
                if (l->move.backup & APC_ASK_UPDATE)
                    must_track(&r, &r.core->backup, id, true);
                if (l->loop.state == APC_LOOP_BACKUP)
                    assert_true(l->inputs.expired || before[id - 1].state == APC_LOOP_BACKUP);
                faulted += l->loop.state == APC_LOOP_FAULT && before[id - 1].state == APC_LOOP_BACKUP;
                before[id - 1] = (struct before){l->loop.state, l->move.output, r.core->u[id - 1],
                                                 error_now(&r, id), l->there};
            }
        }
        end(&r);
    }
    assert_true(entered[0] > 1000 && entered[1] > 1000);
    assert_true(faulted > 100);
}

/* ---- Restarts -------------------------------------------------------------------------------------- */

static void a_restart_in_backup_goes_on_bit_for_bit(void **state)
{
    unsigned restarts = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct rig whole, killed;

        apc_random_init(&random_of, seed, "backup restarts");
        begin(&whole, &moody);
        begin(&killed, &moody);
        for (int k = 0; k < 800; k++) {
            for (int id = 1; id <= LOOPS; id++)
                stir(&whole, id);
            memcpy(killed.in, whole.in, (whole.n_in - LOOPS) * sizeof(*killed.in));
            tick(&whole, WRITTEN);
            tick(&killed, WRITTEN);
            assert_int_equal(whole.n_out, killed.n_out);
            assert_memory_equal(whole.row, killed.row, whole.tick.n * sizeof(double));
            if (one_in(4)) {
                restarts += state_of(&killed, 1) == APC_LOOP_BACKUP;
                restart(&killed, &moody);
            }
        }
        end(&whole);
        end(&killed);
    }
    assert_true(restarts > 200);
}

static void with_another_backup_law_it_goes_on_from_the_output(void **state)
{
    static const struct apc_controller_backup other = {.law = &apc_law_pi};
    struct rig r;
    double last;

    (void)state;
    begin(&r, &moody);
    mood(&r, 1, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 7; k++)
        measured_tick(&r, 0.5, 0.5);
    last = u(&r, 1);
    backup_of = &other;
    {
        struct rig next;
        struct apc_rows *former;

        make(&next, &moody);
        former = apc_controller_former(next.core);
        former->vector[0].seq = r.tick.seq;
        former->vector[0].time = r.tick.time;
        former->vector[0].status = APC_GOOD;
        former->vector[0].n = r.tick.n;
        memcpy(former->vector[0].value, r.row,
               (r.tick.n < former->vector[0].room ? r.tick.n : former->vector[0].room) * sizeof(double));
        next.mono = r.mono;
        for (int id = 1; id <= LOOPS; id++)
            *in_of(&next, APC_ACTUATOR, id) = *in_of(&r, APC_ACTUATOR, id);
        mood(&next, 1, APC_LAW_INFEASIBLE);
        assert_int_equal(apc_controller_resume(next.core, T0), 1);
        measured_tick(&next, 0.5, 0.5);
        assert_int_equal(state_of(&next, 1), APC_LOOP_BACKUP);
        assert_near(u(&next, 1), last, 1e-12);
        end(&next);
    }
    end(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_law_without_good_answers_gives_way_and_comes_back_without_a_bump),
        cmocka_unit_test(one_that_misses_a_measurement_gives_way_to_one_that_does_without),
        cmocka_unit_test(an_operator_takes_the_output_from_it_as_from_any_law),
        cmocka_unit_test(its_own_lost_measurement_is_bridged_for_as_long_as_any),
        cmocka_unit_test(one_that_fails_as_well_ends_at_the_fault_value_and_stays_there),
        cmocka_unit_test(it_is_tuned_like_a_law_and_without_a_bump),
        cmocka_unit_test(whatever_happens_no_output_moves_by_more_than_the_acting_law),
        cmocka_unit_test(a_restart_in_backup_goes_on_bit_for_bit),
        cmocka_unit_test(with_another_backup_law_it_goes_on_from_the_output),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
