/* SPDX-License-Identifier: BSD-3-Clause */
/* Loops of one controller stand each by itself; restarts go on bit for bit, whatever state a loop is in. */
#include "two_loops.h"

/* An operator who does what he likes to loop @p id. */
static void meddle(struct rig *r, int id)
{
    static const double modes[] = {APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_AUTO, APC_MODE_OOS, 7.0};

    if (one_in(9))
        set(r, APC_OPMODE, id, modes[apc_random_next(&random_of) % 5]);
    if (one_in(9))
        set(r, APC_MANUAL, id, 2.0 * number());
    if (one_in(9))
        set(r, APC_SETPOINT, id, 2.0 * number());
    if (one_in(20) && r->core->size.tuning > 0) {
        const int first = (id - 1) * (int)apc_law_pid.n_tuning + 1;

        set(r, APC_TUNING, first, number());
        set(r, APC_TUNING, first + 1, 5.0 + 4.0 * number());
    }
}

static void measure(struct rig *r, int id)
{
    if (!one_in(4))
        set(r, APC_SENSOR, id, number());
    if (one_in(6))
        in_of(r, APC_SENSOR, id)->status = APC_BAD_SENSOR_FAILURE;
    if (one_in(50))
        in_of(r, APC_SETPOINT, id)->status = APC_BAD;
}

/* ---- Loops by themselves ---------------------------------------------------------------------- */

/* Whatever befalls loop 1, loop 2 is bit for bit as it is beside a loop 1 that nothing befalls. */
/*
 * Promise(run/befalls-loop-controller): What befalls one loop of a controller does not touch another, to
 *   the last bit.
 */
static void what_befalls_one_loop_does_not_touch_another(void **state)
{
    struct rig calm, troubled;
    unsigned held = 0, faulted = 0;

    (void)state;
    apc_random_init(&random_of, 1, "loops");
    make(&calm, &apc_law_pid);
    make(&troubled, &apc_law_pid);
    for (int k = 0; k < 5000; k++) {
        struct apc_sample *const mine = in_of(&calm, APC_SENSOR, 2), *const its =
                                                                         in_of(&troubled, APC_SENSOR, 2);

        set(&calm, APC_SENSOR, 1, sin(0.1 * k));
        measure(&troubled, 1);
        meddle(&troubled, 1);
        if (!one_in(3))
            set(&calm, APC_SENSOR, 2, sin(0.05 * k));
        if (one_in(30))
            mine->status = APC_BAD;
        *its = *mine;
        tick(&calm, WRITTEN);
        tick(&troubled, WRITTEN);
        held += find(&troubled, APC_ACTUATOR, 1)->status == APC_UNCERTAIN_LAST_USABLE;
        faulted += find(&troubled, APC_ACTUATOR, 1)->status == APC_UNCERTAIN_SUBSTITUTE;
        assert_int_equal(find(&calm, APC_ACTUATOR, 2)->seq, find(&troubled, APC_ACTUATOR, 2)->seq);
        assert_int_equal(find(&calm, APC_ACTUATOR, 2)->status, find(&troubled, APC_ACTUATOR, 2)->status);
        if (u(&calm, 2) < u(&troubled, 2) || u(&calm, 2) > u(&troubled, 2))
            fail_msg("tick %d: %.17g is not %.17g", k, u(&troubled, 2), u(&calm, 2));
    }
    assert_true(held > 200);
    assert_true(faulted > 50);
    end(&calm);
    end(&troubled);
}

/* Promise(run/befalls-loop-controller) */
static void a_bad_measurement_holds_its_own_loop_and_says_which(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    set(&r, APC_SENSOR, 2, 0.4);
    in_of(&r, APC_SENSOR, 1)->status = APC_BAD;
    tick(&r, WRITTEN);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    assert_int_equal(find(&r, APC_ACTUATOR, 2)->status, APC_GOOD);
    assert_int_equal(r.notice.kind, APC_NOTICE_HOLD);
    assert_string_equal(r.notice.text, "v1: output held: measurement 1 is Bad");
    in_of(&r, APC_SENSOR, 2)->status = APC_BAD;
    tick(&r, WRITTEN);
    assert_string_equal(r.notice.text, "v2: output held: measurement 2 is Bad");
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(r.notice.kind, APC_NOTICE_RECOVERED);
    end(&r);
}

/*
 * Promise(modes): What befalls several loops of a controller at one tick is an event of each; where it is
 *   the same with all, one.
 */
static void what_befalls_two_loops_at_a_tick_is_told_of_both(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    assert_false(apc_controller_noticed(r.core, &r.notice)); /* of both the same, and told */
    in_of(&r, APC_SENSOR, 1)->status = APC_BAD;
    in_of(&r, APC_SENSOR, 2)->status = APC_BAD;
    set(&r, APC_TUNING, 1, (double)NAN);
    tick(&r, WRITTEN);
    assert_has(r.notice.text, "Kp of v1 refused");
    assert_true(apc_controller_noticed(r.core, &r.notice));
    assert_string_equal(r.notice.text, "v1: output held: measurement 1 is Bad");
    assert_true(apc_controller_noticed(r.core, &r.notice));
    assert_int_equal(r.notice.kind, APC_NOTICE_HOLD);
    assert_string_equal(r.notice.text, "v2: output held: measurement 2 is Bad");
    assert_false(apc_controller_noticed(r.core, &r.notice));
    measured_tick(&r, 0.5, 0.5);
    set(&r, APC_OPMODE, 1, APC_MODE_MAN); /* no loop's news hides another's, however light it is */
    in_of(&r, APC_SENSOR, 2)->status = APC_BAD;
    set(&r, APC_SENSOR, 1, 0.5);
    tick(&r, WRITTEN);
    assert_string_equal(r.notice.text, "v2: output held: measurement 2 is Bad");
    assert_true(apc_controller_noticed(r.core, &r.notice));
    assert_string_equal(r.notice.text, "v1: mode Man");
    assert_false(apc_controller_noticed(r.core, &r.notice));
    end(&r);
}

static void each_loop_has_its_own_mode(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    assert_string_equal(r.notice.text, "mode Auto"); /* both */
    set(&r, APC_OPMODE, 2, APC_MODE_MAN);
    set(&r, APC_MANUAL, 2, 1.5);
    measured_tick(&r, 0.5, 0.5);
    assert_string_equal(r.notice.text, "v2: mode Man");
    assert_near(u(&r, 2), 1.5, 0.0);
    assert_near(actual(&r, APC_OPMODE, 1)->value, APC_MODE_AUTO, 0.0);
    assert_near(actual(&r, APC_OPMODE, 2)->value, APC_MODE_MAN, 0.0);
    set(&r, APC_OPMODE, 1, APC_MODE_OOS);
    measured_tick(&r, 0.5, 0.5);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->seq, 0);
    assert_int_equal(find(&r, APC_ACTUATOR, 2)->seq, 3);
    assert_int_equal(r.tick.id, 7);
    assert_int_equal(r.tick.seq, 3);
    end(&r);
}

/* ---- Rates ------------------------------------------------------------------------------------- */

static void no_output_moves_faster_than_its_rate_but_to_its_fault_value(void **state)
{
    const double rate = 0.05, most = rate * 2.0 * (1.0 + 1e-12);
    struct rig r;
    double last;

    (void)state;
    apc_random_init(&random_of, 2, "rates");
    make_so(&r, &apc_law_pid, rate);
    measured_tick(&r, 0.9, 0.9);
    last = u(&r, 1);
    set(&r, APC_SETPOINT, 1, 50.0);
    measured_tick(&r, 0.9, 0.9);
    assert_near(u(&r, 1), last + 0.1, 1e-15);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_GOOD_LIMITED_HIGH);
    set(&r, APC_OPMODE, 1, APC_MODE_MAN);
    set(&r, APC_MANUAL, 1, -1.0);
    measured_tick(&r, 0.9, 0.9);
    assert_near(u(&r, 1), last, 1e-15);
    measured_tick(&r, 0.9, 0.9);
    assert_near(u(&r, 1), last - 0.1, 1e-15); /* it goes there */
    for (int k = 0; k < 2000; k++) {
        const double before = u(&r, 1);
        const bool was = find(&r, APC_ACTUATOR, 1)->seq > 0;

        measure(&r, 1);
        measure(&r, 2);
        meddle(&r, 1);
        tick(&r, WRITTEN);
        if (was && find(&r, APC_ACTUATOR, 1)->seq &&
            find(&r, APC_ACTUATOR, 1)->status != APC_UNCERTAIN_SUBSTITUTE)
            assert_true(fabs(u(&r, 1) - before) <= most);
    }
    end(&r);
}

/* ---- What a law answers ------------------------------------------------------------------------ */

/* u of each output is its x, 0 at first; z[0] says what becomes of the answer. */
static size_t a_state_each(const struct apc_dim *dim)
{
    return dim->nu;
}

static int answer(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++)
        c->u[i] = c->x[i];
    if (c->z[0] == 3.0)
        memcpy(c->why, "no way out", 11);
    return (int)c->z[0];
}

static void count_up(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++)
        c->x[i] = c->u[i] + (c->out[i] == APC_OUT_LAW ? 0.125 : 0.0);
}

static void follow(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->out[i] != APC_OUT_LAW)
            c->x[i] = c->u[i];
    }
}

static const struct apc_law answering = {.abi = APC_LAW_ABI,
                                         .name = "answering",
                                         .whole = true,
                                         .n_state = a_state_each,
                                         .compute = answer,
                                         .update = count_up,
                                         .track = follow};

static void good_answers_and_those_of_need_go_out_and_others_are_held(void **state)
{
    static const struct {
        enum apc_law_result result;
        bool usable;
    } of[] = {{APC_LAW_SUBOPTIMAL, true},
              {APC_LAW_LATE, true},
              {APC_LAW_INFEASIBLE, false},
              {APC_LAW_FAILED, false}};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        struct rig r;

        make(&r, &answering);
        set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
        measured_tick(&r, 0.0, 0.0);
        measured_tick(&r, 0.0, 0.0);
        assert_near(u(&r, 1), 0.125, 0.0);
        set(&r, APC_SETPOINT, 1, of[i].result);
        measured_tick(&r, 0.0, 0.0);
        assert_near(u(&r, 1), of[i].usable ? 0.25 : 0.125, 0.0);
        assert_near(u(&r, 2), of[i].usable ? 0.25 : 0.125, 0.0);
        assert_int_equal(find(&r, APC_ACTUATOR, 2)->status,
                         of[i].usable ? APC_GOOD : APC_UNCERTAIN_LAST_USABLE);
        assert_int_equal(r.notice.kind, of[i].usable ? APC_NOTICE_POOR : APC_NOTICE_REJECTED);
        if (of[i].result == APC_LAW_INFEASIBLE)
            assert_non_null(strstr(r.notice.text, "law answering: no way out"));
        assert_int_equal(apc_controller_failures(r.core), !of[i].usable);
        set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
        measured_tick(&r, 0.0, 0.0);
        assert_near(u(&r, 1), of[i].usable ? 0.375 : 0.125, 0.0); /* from where it was held */
        end(&r);
    }
}

/* Three of its answers fail: the fault value; three good ones in a row: it has the output again. */
static void a_law_that_goes_on_failing_is_shed_and_must_show_that_it_is_well(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &answering);
    set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
    measured_tick(&r, 0.0, 0.0);
    set(&r, APC_SETPOINT, 1, APC_LAW_INFEASIBLE);
    for (int k = 0; k < 3; k++) {
        measured_tick(&r, 0.0, 0.0);
        assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    }
    measured_tick(&r, 0.0, 0.0);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_SUBSTITUTE);
    assert_int_equal(r.notice.kind, APC_NOTICE_FAULT);
    assert_near(u(&r, 1), fault[0], 0.0);
    assert_near(u(&r, 2), fault[1], 0.0);
    assert_near(actual(&r, APC_OPMODE, 1)->value, APC_MODE_LO, 0.0);
    assert_int_equal(actual(&r, APC_OPMODE, 1)->status, APC_UNCERTAIN); /* not what is wanted, yet */
    set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
    for (int k = 0; k < 3; k++) {
        measured_tick(&r, 0.0, 0.0);
        assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_SUBSTITUTE);
    }
    measured_tick(&r, 0.0, 0.0);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_GOOD);
    assert_near(u(&r, 1), fault[0], 0.0); /* no bump */
    assert_int_equal(r.notice.kind, APC_NOTICE_RECOVERED);
    end(&r);
}

static void a_change_of_tuning_gives_no_bump_in_whichever_loop(void **state)
{
    (void)state;
    for (int id = 1; id <= LOOPS; id++) {
        const int kp = (id - 1) * (int)apc_law_pid.n_tuning + 1;
        struct rig r;
        double before, after;

        make(&r, &apc_law_pid);
        set(&r, APC_TUNING, kp, 0.2);
        set(&r, APC_TUNING, kp + 1, 1000.0);
        for (int k = 0; k < 5; k++)
            measured_tick(&r, 0.0, 0.0);
        before = u(&r, id);
        set(&r, APC_TUNING, kp, 1.0);
        measured_tick(&r, 0.0, 0.0);
        after = u(&r, id);
        assert_near(after, before, 0.01);
        set(&r, APC_SETPOINT, id, 1.1);
        measured_tick(&r, 0.0, 0.0);
        assert_near(u(&r, id), after + 0.1, 0.01); /* it is in force */
        end(&r);
    }
}

static void a_law_of_all_outputs_leaves_those_alone_that_are_the_operators(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &answering);
    set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
    measured_tick(&r, 0.0, 0.0);
    set(&r, APC_OPMODE, 2, APC_MODE_MAN);
    set(&r, APC_MANUAL, 2, -0.5);
    for (int k = 1; k < 5; k++) {
        measured_tick(&r, 0.0, 0.0);
        assert_near(u(&r, 1), 0.125 * k, 0.0);
        assert_near(u(&r, 2), -0.5, 0.0);
    }
    set(&r, APC_OPMODE, 2, APC_MODE_AUTO);
    measured_tick(&r, 0.0, 0.0);
    assert_near(u(&r, 1), 0.125 * 5, 0.0);
    assert_near(u(&r, 2), -0.5, 0.0); /* no bump, and no hole in the other */
    measured_tick(&r, 0.0, 0.0);
    assert_near(u(&r, 2), -0.375, 0.0);
    end(&r);
}

static void a_law_of_all_outputs_goes_on_without_a_measurement_if_it_estimates(void **state)
{
    struct apc_law estimating = answering;
    struct rig r;

    (void)state;
    estimating.estimates = true;
    make(&r, &estimating);
    set(&r, APC_SETPOINT, 1, APC_LAW_GOOD);
    measured_tick(&r, 0.0, 0.0);
    in_of(&r, APC_SENSOR, 2)->status = APC_BAD;
    set(&r, APC_SENSOR, 1, 0.0);
    tick(&r, WRITTEN);
    assert_int_equal(find(&r, APC_ACTUATOR, 2)->status, APC_GOOD);
    in_of(&r, APC_SENSOR, 1)->status = APC_BAD;
    tick(&r, WRITTEN);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    assert_int_equal(find(&r, APC_ACTUATOR, 2)->status, APC_UNCERTAIN_LAST_USABLE);
    end(&r);
}

/* ---- Restarts ---------------------------------------------------------------------------------- */

/* Does the next read show whether the last tick's rows are there? */
static bool shows(const struct rig *r)
{
    return find(r, APC_ACTUATOR, 1)->seq > 0 || find(r, APC_ACTUATOR, 2)->seq > 0;
}

static int look_ahead(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                      struct apc_error *why)
{
    (void)setup, (void)self, (void)why;
    needs->n_ahead = 3;
    return 0;
}

/* All that a law may see of its measurements, setpoints and outputs moves its state: a restart has to know
 * it. */
static void see(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double last = isnan(c->u_last[i]) ? 0.0 : c->u_last[i];

        c->x[i] = 0.5 * c->x[i] + 0.1 * c->u[i] + 0.1 * last + 0.01 * c->y_age[i] +
                  (c->y_new[i] ? 0.2 : 0.0) +
                  (apc_status_severity(c->y_status[i]) == APC_SEVERITY_BAD ? 0.3 : 0.0) - 0.05 * c->y[i] +
                  0.05 * c->z[(c->n_ahead - 1) * c->dim.nz + i];
    }
}

static int show(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++)
        c->u[i] = c->x[i] + (isnan(c->u_last[i]) ? 0.0 : 0.1 * c->u_last[i]);
    return APC_LAW_GOOD;
}

static const struct apc_law seeing = {.abi = APC_LAW_ABI,
                                      .name = "seeing",
                                      .whole = true,
                                      .n_state = a_state_each,
                                      .compute = show,
                                      .update = see,
                                      .track = follow,
                                      .create = look_ahead};

/*
 * Two controllers see the same; one is killed and started again, at any instant: after a tick whose rows are
 * there, whether or not it had its answer. Both put out the same, to the last bit, and confirm the same.
 */
/* Promise(run/restarted-controller) */
static void a_controller_that_is_killed_at_any_tick_goes_on_bit_for_bit(void **state)
{
    unsigned restarts = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 40; seed++) {
        const struct apc_law *law = seed % 2 ? &apc_law_pid : &seeing;
        struct rig whole, killed;

        apc_random_init(&random_of, seed, "restarts");
        rate_of = seed % 4 < 2 ? 0.0 : 0.05;
        make(&whole, law);
        make(&killed, law);
        for (int k = 0; k < 500; k++) {
            for (int id = 1; id <= LOOPS; id++) {
                measure(&whole, id);
                meddle(&whole, id);
            }
            memcpy(killed.in, whole.in, (whole.n_in - LOOPS) * sizeof(*killed.in));
            tick(&whole, WRITTEN);
            tick(&killed, shows(&whole) && one_in(2) ? UNANSWERED : WRITTEN);
            assert_int_equal(whole.n_out, killed.n_out);
            for (size_t i = 0; i < whole.n_out; i++) {
                assert_int_equal(whole.out[i].table, killed.out[i].table);
                assert_int_equal(whole.out[i].id, killed.out[i].id);
                assert_int_equal(whole.out[i].seq, killed.out[i].seq);
                assert_int_equal(whole.out[i].status, killed.out[i].status);
                assert_int_equal(whole.out[i].origin, killed.out[i].origin);
                if (memcmp(&whole.out[i].value, &killed.out[i].value, sizeof(double)) != 0)
                    fail_msg("seed %u, tick %d: %s %d: %.17g is not %.17g", (unsigned)seed, k,
                             apc_table_name(whole.out[i].table), whole.out[i].id, killed.out[i].value,
                             whole.out[i].value);
            }
            assert_memory_equal(whole.row, killed.row, whole.tick.n * sizeof(double));
            if (one_in(5)) {
                restart(&killed, law);
                restarts++;
            }
        }
        end(&whole);
        end(&killed);
    }
    rate_of = 0.0;
    assert_true(restarts > 2000);
}

/* A tick that was not written did not act: x stays, and the next one says what it said again. */
static void a_tick_that_is_not_there_did_not_act_whoever_knows(void **state)
{
    struct rig told, wondering;

    (void)state;
    apc_random_init(&random_of, 3, "lost");
    make(&told, &apc_law_pid);
    make(&wondering, &apc_law_pid);
    for (int k = 0; k < 1000; k++) {
        const bool lost = one_in(4);

        for (int id = 1; id <= LOOPS; id++) {
            measure(&told, id);
            meddle(&told, id);
        }
        memcpy(wondering.in, told.in, (told.n_in - LOOPS) * sizeof(*told.in));
        tick(&told, lost ? REFUSED : WRITTEN);
        tick(&wondering, lost ? LOST : one_in(2) ? WRITTEN : UNANSWERED);
        for (int id = 1; id <= LOOPS; id++) {
            assert_memory_equal(find(&told, APC_ACTUATOR, id), find(&wondering, APC_ACTUATOR, id),
                                sizeof(none));
            assert_near(actual(&told, APC_OPMODE, id)->value, actual(&wondering, APC_OPMODE, id)->value, 0.0);
            assert_int_equal(actual(&told, APC_OPMODE, id)->origin,
                             actual(&wondering, APC_OPMODE, id)->origin);
        }
    }
    end(&told);
    end(&wondering);
}

static void a_loop_at_its_fault_value_stays_there_through_a_restart(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    in_of(&r, APC_SENSOR, 1)->status = APC_BAD;
    tick(&r, WRITTEN);
    tick(&r, WRITTEN);
    restart(&r, &apc_law_pid);
    tick(&r, WRITTEN);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    tick(&r, WRITTEN); /* 6 s after it began, two of them before the restart */
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_SUBSTITUTE);
    restart(&r, &apc_law_pid);
    tick(&r, WRITTEN);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_SUBSTITUTE);
    assert_near(u(&r, 1), fault[0], 0.0);
    end(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_befalls_one_loop_does_not_touch_another),
        cmocka_unit_test(a_bad_measurement_holds_its_own_loop_and_says_which),
        cmocka_unit_test(what_befalls_two_loops_at_a_tick_is_told_of_both),
        cmocka_unit_test(each_loop_has_its_own_mode),
        cmocka_unit_test(no_output_moves_faster_than_its_rate_but_to_its_fault_value),
        cmocka_unit_test(good_answers_and_those_of_need_go_out_and_others_are_held),
        cmocka_unit_test(a_law_that_goes_on_failing_is_shed_and_must_show_that_it_is_well),
        cmocka_unit_test(a_change_of_tuning_gives_no_bump_in_whichever_loop),
        cmocka_unit_test(a_law_of_all_outputs_leaves_those_alone_that_are_the_operators),
        cmocka_unit_test(a_law_of_all_outputs_goes_on_without_a_measurement_if_it_estimates),
        cmocka_unit_test(a_controller_that_is_killed_at_any_tick_goes_on_bit_for_bit),
        cmocka_unit_test(a_tick_that_is_not_there_did_not_act_whoever_knows),
        cmocka_unit_test(a_loop_at_its_fault_value_stays_there_through_a_restart),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
