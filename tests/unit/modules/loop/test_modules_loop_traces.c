/* SPDX-License-Identifier: BSD-3-Clause */
/* A cascade, step by step: for each clause of the rules the shortest story in which it is missed. */
#include "check.h"

#include "cascade.h"

#define UPPER_PERIOD (int)(TOP / BASE) /* in periods of the loop below */

static void tick(struct cascade *w, enum who who)
{
    cascade_reads(w, who);
    cascade_appends(w, who);
}

static enum apc_loop_state in(const struct cascade *w, enum who who)
{
    return w->side[who].now.loop.state;
}

/* In Cas, both loops act, a few periods after they began. */
static struct cascade in_cas(void)
{
    struct cascade w;

    cascade_init(&w, 1);
    w.w = 0.5;
    cascade_run(&w, 6 * UPPER_PERIOD);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    assert_int_equal(in(&w, UPPER), APC_LOOP_AUTO);
    return w;
}

static void request(struct cascade *w, int what, enum apc_mode mode, double value)
{
    w->operator.what = what;
    w->operator.mode = mode;
    w->operator.value = value;
    cascade_operator_reads(w);
}

static void put(struct cascade *w, double value)
{
    request(w, PUT, APC_MODE_AUTO, value);
    cascade_operator_appends(w);
}

static void mode(struct cascade *w, enum apc_mode target)
{
    request(w, MODE, target, 0);
    cascade_operator_appends(w);
}

/* The operator's value is in force and remains it, though all goes on. */
static void assert_local(struct cascade *w, double value)
{
    cascade_run(w, 6 * UPPER_PERIOD);
    assert_int_equal(w->store.target[LOWER], APC_MODE_AUTO);
    assert_int_equal(in(w, LOWER), APC_LOOP_AUTO);
    assert_int_equal(in(w, UPPER), APC_LOOP_INIT);
    assert_int_not_equal(w->store.setpoint.author, UPPER);
    assert_near(w->store.setpoint.value, value, 0);
    assert_near(w->side[LOWER].now.z, value, 0);
    cascade_check(w);
}

/* ---- The handshake ------------------------------------------------------------------------- */

/*
 * Promise(modes/down-a-cascade): A mode comes down a cascade in two periods and an answer, without a step,
 *   also where one answers late; a write between wins.
 */
static void test_two_periods_of_the_upper_loop_and_its_answer_lead_into_cas_without_a_step(void **state)
{
    struct cascade w;
    double r;

    (void)state;
    cascade_init(&w, 1);
    w.w = 1.5;
    r = w.store.setpoint.value;
    cascade_run(&w, 2); /* it asks, is answered */
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    assert_int_equal(in(&w, UPPER), APC_LOOP_INIT);
    assert_near(w.store.setpoint.value, r, 0);
    cascade_run(&w, UPPER_PERIOD); /* the upper loop sees it, tracks, computes */
    assert_int_equal(in(&w, UPPER), APC_LOOP_AUTO);
    assert_near(w.store.setpoint.value, r, 1e-15);
    cascade_run(&w, UPPER_PERIOD);
    assert_true(w.store.setpoint.value > r); /* and controls */
    cascade_check(&w);
}

/* It answers late in its period: the loop below has ticked thrice since it was read. */
/* Promise(modes/down-a-cascade) */
static void test_an_answer_later_than_a_tick_of_the_loop_below_is_taken(void **state)
{
    struct cascade w;

    (void)state;
    cascade_init(&w, 1);
    for (int period = 0; period < 4; period++) {
        cascade_reads(&w, UPPER);
        for (int i = 0; i < UPPER_PERIOD; i++) {
            tick(&w, LOWER);
            if (i == UPPER_PERIOD - 2)
                cascade_appends(&w, UPPER);
            w.now += BASE;
            cascade_process(&w);
        }
    }
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    cascade_check(&w);
}

/* Promise(modes/down-a-cascade) */
static void test_an_operator_s_write_during_the_handshake_wins(void **state)
{
    (void)state;
    for (int at = 0; at < 8; at++) {
        struct cascade w;

        cascade_init(&w, 1);
        for (int i = 0; i < 8; i++) { /* lower asks; upper answers; lower takes; upper computes */
            static const enum who who[] = {LOWER, LOWER, UPPER, UPPER, LOWER, LOWER, UPPER, UPPER};
            if (i == at)
                put(&w, -0.7);
            (i % 2 ? cascade_appends : cascade_reads)(&w, who[i]);
            w.now += BASE / 8;
        }
        w.now += BASE - (w.now - START) % BASE;
        assert_local(&w, -0.7);
    }
}

/* The operator puts a value, then says Cas: the loop below still says what it had before. */
/* Promise(modes/down-a-cascade) */
static void test_an_upper_loop_answers_only_what_is_still_in_force(void **state)
{
    struct cascade w;

    (void)state;
    cascade_init(&w, 1);
    tick(&w, LOWER);
    put(&w, -0.7);
    mode(&w, APC_MODE_CAS);
    tick(&w, UPPER);
    assert_int_equal(w.store.setpoint.author, OPERATOR);
    cascade_run(&w, 3 * UPPER_PERIOD);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    cascade_check(&w);
}

/* A wait is answered by its own answer only: a row that was made for an earlier one has seen another world. */
static void test_an_answer_to_an_earlier_wait_does_not_count(void **state)
{
    struct cascade w;

    (void)state;
    cascade_init(&w, 1);
    tick(&w, LOWER);
    tick(&w, UPPER);                       /* answers the first wait */
    w.store.target[LOWER] = APC_MODE_AUTO; /* by somebody who writes no setpoint with it */
    cascade_reads(&w, LOWER);              /* which will be put back, but not yet is */
    w.side[LOWER].lost = true;
    cascade_appends(&w, LOWER);
    w.side[LOWER].lost = false;
    w.store.target[LOWER] = APC_MODE_CAS;
    tick(&w, LOWER);
    assert_int_equal(in(&w, LOWER), APC_LOOP_AUTO);
    cascade_check(&w);
}

/* Promise(modes/down-a-cascade) */
static void test_an_upper_loop_in_man_answers_and_then_is_the_operator_s(void **state)
{
    struct cascade w;

    (void)state;
    cascade_init(&w, 1);
    w.store.target[UPPER] = APC_MODE_MAN;
    w.manual[UPPER] = (double)NAN;
    w.w = 2;
    cascade_run(&w, 6 * UPPER_PERIOD);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    assert_int_equal(in(&w, UPPER), APC_LOOP_MAN);
    assert_near(w.store.setpoint.value, 0.3, 0);
    w.manual[UPPER] = 0.9;
    cascade_run(&w, UPPER_PERIOD + 1);
    assert_near(w.side[LOWER].now.z, 0.9, 0);
    cascade_check(&w);
}

/* ---- Whose the setpoint is ------------------------------------------------------------------ */

/* Promise(modes/owner) */
static void test_a_put_between_the_upper_loop_s_look_and_its_write_leaves_that_out(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    cascade_reads(&w, UPPER);
    put(&w, -0.7);
    cascade_appends(&w, UPPER);
    assert_true(w.side[UPPER].missed);
    assert_local(&w, -0.7);
}

/* Promise(modes/owner) */
static void test_a_put_between_the_upper_loop_s_write_and_the_lower_s_look_is_in_force(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    tick(&w, UPPER);
    put(&w, -0.7);
    assert_local(&w, -0.7);
}

/* Written without a setpoint, as in a database by hand, while a row of the upper loop is there that the loop
 * below has not seen: it does not become the setpoint of Auto. */
/* Promise(modes/owner) */
static void test_a_row_from_above_does_not_count_once_the_target_is_auto(void **state)
{
    struct cascade w = in_cas();
    double z = w.side[LOWER].now.z;

    (void)state;
    w.w = -2;
    tick(&w, UPPER);
    w.store.target[LOWER] = APC_MODE_AUTO;
    assert_true(fabs(w.store.setpoint.value - z) > 0.1);
    assert_local(&w, z);
}

/* Promise(modes/owner) */
static void test_a_put_on_a_loop_in_man_is_written_over_by_its_measurement(void **state)
{
    struct cascade w = in_cas();
    double u;

    (void)state;
    w.manual[LOWER] = (double)NAN;
    mode(&w, APC_MODE_MAN);
    cascade_run(&w, UPPER_PERIOD);
    u = w.store.out.value;
    put(&w, -0.7);
    assert_int_equal(w.store.target[LOWER], APC_MODE_MAN);
    cascade_run(&w, UPPER_PERIOD);
    assert_near(w.store.setpoint.value, w.side[LOWER].now.y, 0);
    assert_near(w.store.out.value, u, 0);
    mode(&w, APC_MODE_AUTO);
    tick(&w, LOWER);
    assert_near(w.store.out.value, u, 1e-12);
    mode(&w, APC_MODE_CAS);
    cascade_run(&w, 5 * UPPER_PERIOD);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    cascade_check(&w);
}

/* ---- Shedding ------------------------------------------------------------------------------- */

/*
 * Promise(modes/shed): A loop is shed within three periods of the upper controller, 100 ms and a tick,
 *   without a step, and taken up again without one; a late row is put back.
 */
static void test_a_loop_sheds_in_time_and_takes_up_again_both_without_a_step(void **state)
{
    struct cascade w = in_cas();
    apc_ns last = w.store.setpoint.time;
    double z;

    (void)state;
    cascade_kill(&w, UPPER);
    z = w.side[LOWER].now.z;
    while (in(&w, LOWER) == APC_LOOP_CAS)
        cascade_run(&w, 1);
    assert_true(w.now - BASE - last > LOSS(TOP));
    assert_true(w.now - BASE - last <= LOSS(TOP) + BASE);
    assert_int_equal(in(&w, LOWER), APC_LOOP_AUTO);
    assert_string_equal(w.side[LOWER].move.reason, "no setpoint from above");
    assert_near(w.store.setpoint.value, z, 0);
    w.w = -2; /* meanwhile the world goes on */
    cascade_run(&w, 20 * UPPER_PERIOD);
    assert_near(w.store.setpoint.value, z, 0);
    cascade_start(&w, UPPER);
    while (in(&w, UPPER) != APC_LOOP_AUTO)
        cascade_run(&w, 1);
    assert_near(w.store.setpoint.value, z, 1e-12);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    cascade_check(&w);
}

/* The upper loop looked in time, but writes after the loop below has given it up, and before it said so. */
/* Promise(modes/shed) */
static void test_a_row_that_comes_after_the_shed_is_put_back(void **state)
{
    struct cascade w = in_cas();
    double z = w.side[LOWER].now.z;

    (void)state;
    w.w = -2;
    cascade_reads(&w, UPPER);
    w.side[UPPER].alive = false; /* it hangs */
    while (w.now - w.store.setpoint.time <= LOSS(TOP))
        cascade_run(&w, 1);
    cascade_reads(&w, LOWER);
    assert_int_equal(w.side[LOWER].move.state, APC_LOOP_AUTO);
    cascade_appends(&w, UPPER);
    assert_int_equal(w.store.setpoint.author, UPPER);
    cascade_appends(&w, LOWER); /* its own was left out */
    assert_int_equal(w.store.setpoint.author, UPPER);
    tick(&w, LOWER);
    assert_int_equal(w.store.setpoint.author, LOWER);
    assert_near(w.store.setpoint.value, z, 0);
    assert_near(w.side[LOWER].now.z, z, 0);
    cascade_check(&w);
}

/* Promise(modes/shed) */
static void test_an_upper_loop_at_its_end_or_out_of_service_is_left_at_once(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    w.store.target[UPPER] = APC_MODE_OOS;
    cascade_run(&w, UPPER_PERIOD + 1);
    assert_int_equal(in(&w, LOWER), APC_LOOP_AUTO);
    cascade_check(&w);
}

/* How often the loops change their state in so many periods of the upper one. */
static int changes(struct cascade *w, int periods)
{
    int n = 0;

    for (int i = 0; i < periods * UPPER_PERIOD; i++) {
        enum apc_loop_state before[2] = {in(w, LOWER), in(w, UPPER)};
        cascade_run(w, 1);
        n += (in(w, LOWER) != before[LOWER]) + (in(w, UPPER) != before[UPPER]);
    }
    return n;
}

/* Promise(modes/hold-and-shed-after) */
static void test_a_law_that_never_answers_well_is_shed_once_for_all(void **state)
{
    (void)state;
    for (int answer = LATE; answer <= FAILED; answer++) {
        struct cascade w = in_cas();

        w.side[UPPER].answers = (enum result)answer;
        /* Auto -> (Hold ->) Fault -> Init above, Cas -> Auto below */
        assert_in_range(changes(&w, 10), 3, 4);
        assert_int_equal(changes(&w, 100), 0);
        assert_int_equal(in(&w, LOWER), APC_LOOP_AUTO);
        assert_int_equal(in(&w, UPPER), APC_LOOP_INIT);
        w.side[UPPER].answers = GOOD;
        changes(&w, 6);
        assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
        assert_int_equal(in(&w, UPPER), APC_LOOP_AUTO);
        cascade_check(&w);
    }
}

/* Promise(modes/hold-and-shed-after) */
static void test_a_law_that_is_late_now_and_then_is_not_shed(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    for (int i = 0; i < 40; i++) {
        w.side[LOWER].answers = i % (int)SHED_AFTER ? LATE : GOOD;
        cascade_run(&w, 1);
        assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    }
    cascade_check(&w);
}

/* One good answer is no recovery: it takes as many as it took bad ones. */
/* Promise(modes/hold-and-shed-after) */
static void test_a_law_comes_back_after_as_many_good_answers_as_it_was_shed_after(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    w.side[LOWER].answers = LATE;
    cascade_run(&w, SHED_AFTER + 5);
    assert_int_equal(in(&w, LOWER), APC_LOOP_FAULT);
    for (int i = 0; i < 20; i++) {
        w.side[LOWER].answers = i % (int)SHED_AFTER ? GOOD : LATE;
        cascade_run(&w, 1);
        assert_int_equal(in(&w, LOWER), APC_LOOP_FAULT);
    }
    w.side[LOWER].answers = GOOD;
    w.side[LOWER].now.loop.poor = SHED_AFTER;
    cascade_run(&w, SHED_AFTER);
    assert_int_equal(in(&w, LOWER), APC_LOOP_FAULT);
    cascade_run(&w, 1);
    assert_int_not_equal(in(&w, LOWER), APC_LOOP_FAULT);
    cascade_check(&w);
}

/* Promise(modes/hold-and-shed-after) */
static void test_man_and_out_of_service_forgive_a_law(void **state)
{
    static const enum apc_mode modes[] = {APC_MODE_MAN, APC_MODE_OOS};

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct cascade w = in_cas();

        w.manual[LOWER] = (double)NAN;
        w.side[LOWER].answers = INFEASIBLE;
        cascade_run(&w, SHED_AFTER + 5);
        w.side[LOWER].answers = GOOD;
        mode(&w, modes[i]);
        cascade_run(&w, 1);
        mode(&w, APC_MODE_AUTO);
        cascade_run(&w, 1);
        assert_int_equal(in(&w, LOWER), APC_LOOP_AUTO);
        cascade_check(&w);
    }
}

/* ---- Holding -------------------------------------------------------------------------------- */

/*
 * Promise(modes/hold-and-shed-after): `hold` and `shed_after`: what counts, what ends them, what forgives.
 */
static void test_a_measurement_that_returns_when_the_hold_ends_is_in_time(void **state)
{
    struct cascade w = in_cas();
    int hold = (int)(w.side[LOWER].hold / BASE);

    (void)state;
    w.side[LOWER].measured = false;
    cascade_run(&w, hold);
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    w.side[LOWER].measured = true;
    cascade_run(&w, 1);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    w.side[LOWER].measured = false;
    cascade_run(&w, hold); /* begins anew */
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    cascade_run(&w, 1);
    assert_int_equal(in(&w, LOWER), APC_LOOP_FAULT);
    cascade_check(&w);
}

/* What was spent in another mode, or initialising, is no holding: the hold begins with Hold. */
/* Promise(modes/hold-and-shed-after) */
static void test_only_a_loop_that_holds_comes_to_its_hold_s_end(void **state)
{
    struct cascade w = in_cas();
    int hold = (int)(w.side[LOWER].hold / BASE);

    (void)state;
    w.manual[LOWER] = (double)NAN;
    w.side[LOWER].measured = false;
    cascade_run(&w, hold - 1);
    mode(&w, APC_MODE_MAN);
    cascade_run(&w, 5 * hold);
    mode(&w, APC_MODE_AUTO);
    cascade_run(&w, hold);
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    mode(&w, APC_MODE_OOS);
    cascade_run(&w, 5 * hold);
    mode(&w, APC_MODE_AUTO);
    cascade_run(&w, hold);
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    cascade_run(&w, 1);
    assert_int_equal(in(&w, LOWER), APC_LOOP_FAULT);

    w = in_cas();
    w.side[UPPER].measured = false;
    put(&w, 0.1); /* Init above, without a measurement, for long */
    cascade_run(&w, 20 * UPPER_PERIOD);
    w.side[UPPER].measured = true;
    mode(&w, APC_MODE_CAS);
    cascade_run(&w, 3 * UPPER_PERIOD);
    assert_int_equal(in(&w, UPPER), APC_LOOP_AUTO);
    w.side[UPPER].measured = false;
    cascade_run(&w, UPPER_PERIOD);
    assert_int_equal(in(&w, UPPER), APC_LOOP_HOLD);
    cascade_check(&w);
}

/*
 * Promise(modes/lower-loop-holds): A lower loop that holds goes back to Cas without a wait; at its limit,
 *   the setpoint does not run away, whatever its sign.
 */
static void test_a_held_loop_goes_back_to_cas_without_a_new_wait(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    w.side[LOWER].measured = false;
    cascade_run(&w, 2);
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    assert_int_equal(w.store.actual.status, APC_GOOD_LIMITED_CONSTANT);
    w.side[LOWER].measured = true;
    cascade_run(&w, 1);
    assert_int_equal(in(&w, LOWER), APC_LOOP_CAS);
    assert_int_equal(in(&w, UPPER), APC_LOOP_AUTO);
    cascade_check(&w);
}

/* Promise(modes/lower-loop-holds) */
static void test_a_held_loop_whose_upper_one_is_gone_asks_anew(void **state)
{
    struct cascade w = in_cas();

    (void)state;
    w.side[LOWER].hold = 100 * TOP;
    w.side[LOWER].measured = false;
    cascade_run(&w, 2);
    cascade_kill(&w, UPPER);
    cascade_run(&w, 6 * UPPER_PERIOD);
    assert_int_equal(in(&w, LOWER), APC_LOOP_HOLD);
    assert_int_equal(w.store.actual.status, APC_UNCERTAIN_INITIAL);
    assert_int_equal(w.store.setpoint.author, LOWER);
    cascade_check(&w);
}

/* ---- Windup --------------------------------------------------------------------------------- */

/* Promise(modes/lower-loop-holds) */
static void test_the_setpoint_does_not_run_away_while_the_loop_below_is_at_its_limit(void **state)
{
    (void)state;
    for (int sign = -1; sign <= 1; sign += 2) {
        for (int side = -1; side <= 1; side += 2) {
            struct cascade w;
            double r;

            cascade_init(&w, sign);
            w.side[UPPER].low = -1e6;
            w.side[UPPER].high = 1e6;
            cascade_run(&w, 6 * UPPER_PERIOD);
            w.w = side * 3; /* out of reach: the level ends at 1 */
            cascade_run(&w, 15 * UPPER_PERIOD);
            r = w.store.setpoint.value;
            cascade_run(&w, 1200); /* 600 s */
            assert_near(w.store.out.value, sign * side, 1e-9);
            assert_near(w.store.setpoint.value, side * 3, 3);
            assert_true(fabs(w.store.setpoint.value) <= fabs(r) + 0.1);
            w.w = 0; /* and comes back at once */
            cascade_run(&w, 8 * UPPER_PERIOD);
            assert_true(fabs(w.store.out.value) < 0.99);
            cascade_check(&w);
        }
    }
}

/* ---- What is remembered ----------------------------------------------------------------------- */

/* Hold without input begins a hold; input ends it, and where the loop does not hold for want of it. */
static void test_what_begins_a_hold_and_what_ends_it(void **state)
{
    (void)state;
    for (int to = APC_LOOP_OOS; to < APC_LOOP_END; to++) {
        const bool goes_on =
            to != APC_LOOP_OOS && to != APC_LOOP_MAN && to != APC_LOOP_INIT && to != APC_LOOP_SHADOW;

        for (int bits = 0; bits < 4 && to != APC_LOOP_BACKUP; bits++) {
            const struct apc_loop_inputs f = {.target = APC_MODE_AUTO, .input = bits & 1};
            struct apc_loop_memory l = {.state = APC_LOOP_HOLD, .holding = bits & 2, .held = 5};

            apc_loop_settle(&l, &f, (enum apc_loop_state)to, 9, 0);
            assert_int_equal(l.state, to);
            assert_int_equal(l.holding, !f.input && (to == APC_LOOP_HOLD || (bits & 2 && goes_on)));
            if (l.holding)
                assert_int_equal(l.held, bits & 2 ? 5 : 9);
            assert_false(apc_loop_expired(&l, f.input, 9, 5, 1));
            assert_int_equal(apc_loop_expired(&l, f.input, 10, 5, 1), l.holding && l.held == 5);
        }
    }
}

/* In Backup it is the backup law that may miss something, whatever the law proper does. */
/* Promise(modes/law-act-gives) */
static void test_in_backup_a_hold_is_of_the_backup_law(void **state)
{
    (void)state;
    for (int bits = 0; bits < 8; bits++) {
        const struct apc_loop_inputs f = {.target = APC_MODE_AUTO, .input = bits & 1, .bare = bits & 4};
        struct apc_loop_memory l = {.state = APC_LOOP_HOLD, .holding = bits & 2, .held = 5};

        assert_false(apc_loop_bridges(&l, 6, 5)); /* it does not act yet */
        apc_loop_settle(&l, &f, APC_LOOP_BACKUP, 9, 0);
        assert_int_equal(l.holding, f.bare);
        if (l.holding)
            assert_int_equal(l.held, bits & 2 ? 5 : 9);
        assert_true(apc_loop_bridges(&l, 9, 5));
        assert_int_equal(apc_loop_bridges(&l, 10, 5), !(f.bare && bits & 2));
    }
}

/* A loop asks from the first tick of Cas wanted and not there, but in Shadow, and until it is linked. */
static void test_who_asks_from_above_and_who_is_linked(void **state)
{
    (void)state;
    for (int to = APC_LOOP_OOS; to < APC_LOOP_END; to++)
        for (int bits = 0; bits < 16; bits++) {
            const struct apc_loop_inputs f = {
                .target = bits & 1 || to == APC_LOOP_CAS ? APC_MODE_CAS : APC_MODE_AUTO, .remote = bits & 2};
            struct apc_loop_memory l = {.linked = bits & 4, .asked = bits & 8 ? 7 : 0};
            const bool linked = to == APC_LOOP_CAS || (to == APC_LOOP_HOLD && f.remote && bits & 4),
                       asks = f.target == APC_MODE_CAS && to != APC_LOOP_SHADOW && !linked;

            apc_loop_settle(&l, &f, (enum apc_loop_state)to, 0, 9);
            assert_int_equal(l.linked, linked);
            assert_int_equal(l.asked, !asks ? 0 : bits & 8 ? 7 : 9);
            assert_int_equal(apc_loop_status(&l, APC_MODE_CAS, 0), !linked ? APC_UNCERTAIN_INITIAL
                                                                   : to == APC_LOOP_CAS
                                                                       ? APC_GOOD
                                                                       : APC_GOOD_LIMITED_CONSTANT);
        }
}

static void test_only_its_own_answer_lets_a_loop_into_cas(void **state)
{
    const struct apc_loop_memory l = {.asked = 7};
    const struct apc_loop_above good = {.target = APC_MODE_CAS,
                                        .theirs = true,
                                        .fresh = true,
                                        .able = true,
                                        .origin = 7,
                                        .value = 2,
                                        .working = 2};
    struct apc_loop_above a = good;

    (void)state;
    assert_true(apc_loop_remote(&l, &a) && apc_loop_takes(&l, &a));
    a.origin = 9; /* it asked again, for the same */
    assert_true(apc_loop_remote(&l, &a));
    a.origin = 6; /* the answer to an earlier question */
    assert_false(apc_loop_remote(&l, &a) || apc_loop_takes(&l, &a));
    for (int sign = -1; sign <= 1; sign += 2) {
        a = good;
        a.value += sign; /* a step */
        assert_false(apc_loop_remote(&l, &a) || apc_loop_takes(&l, &a));
    }
    a = good;
    a.theirs = false; /* an operator's: it is in force, but is no answer */
    assert_true(!apc_loop_remote(&l, &a) && apc_loop_takes(&l, &a));
    a = good;
    a.fresh = false;
    assert_false(apc_loop_remote(&l, &a) || apc_loop_takes(&l, &a));
    a = good;
    a.able = false;
    assert_false(apc_loop_remote(&l, &a) || apc_loop_takes(&l, &a));
    a = good;
    a.target = APC_MODE_AUTO;
    assert_false(apc_loop_remote(&l, &a) || apc_loop_takes(&l, &a));
}

/* Promise(modes/lower-loop-holds) */
static void test_a_measurement_cannot_follow_the_way_that_it_lacks(void **state)
{
    (void)state;
    for (unsigned limited = 0; limited < 4; limited++) {
        assert_int_equal(apc_loop_lacks(limited, 2, 1), limited ? APC_LIMITED_HIGH : 0);
        assert_int_equal(apc_loop_lacks(limited, 1, 2), limited ? APC_LIMITED_LOW : 0);
        assert_int_equal(apc_loop_lacks(limited, 1, 1), limited ? APC_LIMITED_LOW | APC_LIMITED_HIGH : 0);
    }
}

/* ---- Counting ------------------------------------------------------------------------------- */

static void test_the_bits_of_a_status_go_both_ways(void **state)
{
    struct apc_loop_memory loop = {.state = APC_LOOP_CAS, .linked = true};

    (void)state;
    for (unsigned limited = 0; limited < 4; limited++) {
        apc_status status = apc_loop_status(&loop, APC_MODE_CAS, limited);
        assert_int_equal(apc_loop_limited(status), limited);
        assert_int_equal(apc_loop_status(&loop, APC_MODE_AUTO, limited), APC_GOOD_LOCAL_OVERRIDE);
        assert_true(
            apc_loop_taken(&(struct apc_loop_below){.cascade = true, .fresh = true, .status = status}));
    }
    loop.state = APC_LOOP_HOLD;
    assert_int_equal(apc_loop_limited(apc_loop_status(&loop, APC_MODE_CAS, 0)),
                     APC_LIMITED_LOW | APC_LIMITED_HIGH);
    loop.linked = false;
    assert_int_equal(apc_loop_status(&loop, APC_MODE_CAS, 3), APC_UNCERTAIN_INITIAL);
    assert_int_equal(apc_loop_limited(APC_GOOD), 0);
    assert_int_equal(apc_loop_limited(APC_GOOD_LOCAL_OVERRIDE), 0);
}

/* A lower loop that says anything but Good, or does not tick, does not take; nor is it answered. */
static void test_only_a_living_loop_in_cas_takes(void **state)
{
    struct apc_loop_below b = {
        .cascade = true, .fresh = true, .status = APC_GOOD_LIMITED_HIGH, .value = 1, .newest = 1};

    (void)state;
    assert_true(apc_loop_taken(&b));
    assert_false(apc_loop_invited(&b));
    b.status = APC_UNCERTAIN_INITIAL;
    assert_false(apc_loop_taken(&b));
    assert_true(apc_loop_invited(&b));
    b.fresh = false;
    assert_false(apc_loop_invited(&b));
    b.status = APC_GOOD;
    assert_false(apc_loop_taken(&b));
    b.fresh = true;
    b.cascade = false;
    assert_false(apc_loop_taken(&b));
    b.status = APC_UNCERTAIN_INITIAL;
    assert_false(apc_loop_invited(&b));
    b.cascade = true;
    b.newest = 2;
    assert_false(apc_loop_invited(&b));
    b.newest = 0;
    assert_false(apc_loop_invited(&b));
    b.newest = 1;
    b.status = APC_GOOD_LOCAL_OVERRIDE;
    assert_false(apc_loop_taken(&b) || apc_loop_invited(&b));
    b.status = APC_BAD;
    assert_false(apc_loop_taken(&b) || apc_loop_invited(&b));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_two_periods_of_the_upper_loop_and_its_answer_lead_into_cas_without_a_step),
        cmocka_unit_test(test_an_answer_later_than_a_tick_of_the_loop_below_is_taken),
        cmocka_unit_test(test_an_operator_s_write_during_the_handshake_wins),
        cmocka_unit_test(test_an_upper_loop_answers_only_what_is_still_in_force),
        cmocka_unit_test(test_an_answer_to_an_earlier_wait_does_not_count),
        cmocka_unit_test(test_an_upper_loop_in_man_answers_and_then_is_the_operator_s),
        cmocka_unit_test(test_a_put_between_the_upper_loop_s_look_and_its_write_leaves_that_out),
        cmocka_unit_test(test_a_put_between_the_upper_loop_s_write_and_the_lower_s_look_is_in_force),
        cmocka_unit_test(test_a_row_from_above_does_not_count_once_the_target_is_auto),
        cmocka_unit_test(test_a_put_on_a_loop_in_man_is_written_over_by_its_measurement),
        cmocka_unit_test(test_a_loop_sheds_in_time_and_takes_up_again_both_without_a_step),
        cmocka_unit_test(test_a_row_that_comes_after_the_shed_is_put_back),
        cmocka_unit_test(test_an_upper_loop_at_its_end_or_out_of_service_is_left_at_once),
        cmocka_unit_test(test_a_law_that_never_answers_well_is_shed_once_for_all),
        cmocka_unit_test(test_a_law_that_is_late_now_and_then_is_not_shed),
        cmocka_unit_test(test_a_law_comes_back_after_as_many_good_answers_as_it_was_shed_after),
        cmocka_unit_test(test_man_and_out_of_service_forgive_a_law),
        cmocka_unit_test(test_a_measurement_that_returns_when_the_hold_ends_is_in_time),
        cmocka_unit_test(test_only_a_loop_that_holds_comes_to_its_hold_s_end),
        cmocka_unit_test(test_a_held_loop_goes_back_to_cas_without_a_new_wait),
        cmocka_unit_test(test_a_held_loop_whose_upper_one_is_gone_asks_anew),
        cmocka_unit_test(test_the_setpoint_does_not_run_away_while_the_loop_below_is_at_its_limit),
        cmocka_unit_test(test_what_begins_a_hold_and_what_ends_it),
        cmocka_unit_test(test_in_backup_a_hold_is_of_the_backup_law),
        cmocka_unit_test(test_who_asks_from_above_and_who_is_linked),
        cmocka_unit_test(test_only_its_own_answer_lets_a_loop_into_cas),
        cmocka_unit_test(test_a_measurement_cannot_follow_the_way_that_it_lacks),
        cmocka_unit_test(test_the_bits_of_a_status_go_both_ways),
        cmocka_unit_test(test_only_a_living_loop_in_cas_takes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
