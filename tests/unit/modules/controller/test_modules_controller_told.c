/* SPDX-License-Identifier: BSD-3-Clause */
/* What a controller tells its law of the tick, and people of the law and of what they want. */
#include "two_loops.h"

#include <stdio.h>

/* ---- A law that keeps what it is told ---------------------------------------------------------- */

static struct {
    apc_status status[LOOPS];
    double age[LOOPS], t, budget;
    bool new[LOOPS], may_say;
    uint64_t tick;
    apc_ns deadline;
} told;
static enum apc_law_result answer;
static const char *said;

static int keep_told(struct apc_law_call *c)
{
    memcpy(told.status, c->y_status, sizeof(told.status));
    memcpy(told.age, c->y_age, sizeof(told.age));
    memcpy(told.new, c->y_new, sizeof(told.new));
    told.t = c->t;
    told.tick = c->tick;
    told.budget = c->budget;
    told.deadline = c->deadline;
    told.may_say = c->say != NULL;
    if (said && c->say)
        snprintf(c->say, APC_LAW_SAY, "%s", said);
    if (answer != APC_LAW_GOOD)
        snprintf(c->why, APC_LAW_WHY, "has its reason");
    for (size_t i = 0; i < c->dim.nu; i++)
        c->u[i] = 0.25;
    return (int)answer;
}

static const struct apc_law keeps = {
    .abi = APC_LAW_ABI, .name = "keeps", .whole = true, .estimates = true, .compute = keep_told};

static int begin(void **state)
{
    (void)state;
    memset(&told, 0, sizeof(told));
    answer = APC_LAW_GOOD;
    said = NULL;
    return 0;
}

static void a_law_is_told_how_its_measurements_are(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &keeps);
    measured_tick(&r, 0.5, 0.5);
    assert_true(told.new[0] && told.new[1]);
    in_of(&r, APC_SENSOR, 2)->status = APC_BAD_SENSOR_FAILURE;
    set(&r, APC_SENSOR, 1, 0.6);
    in_of(&r, APC_SENSOR, 1)->status = APC_UNCERTAIN_LAST_USABLE;
    in_of(&r, APC_SENSOR, 1)->time -= S / 4;
    tick(&r, WRITTEN);
    assert_int_equal(told.status[0], APC_UNCERTAIN_LAST_USABLE);
    assert_int_equal(told.status[1], APC_BAD_SENSOR_FAILURE);
    assert_true(told.new[0] && !told.new[1]);
    assert_near(told.age[0], 0.25, 0);
    assert_near(told.age[1], 2, 0);
    assert_near(told.t, 2, 0);
    assert_int_equal(told.tick, 1);
    in_of(&r, APC_SENSOR, 2)->status = APC_GOOD; /* but it comes no more */
    for (int k = 0; k < 2; k++) {
        set(&r, APC_SENSOR, 1, 0.6);
        tick(&r, WRITTEN);
    }
    assert_int_equal(told.status[0], APC_GOOD);
    assert_int_equal(told.status[1], APC_BAD_NO_COMMUNICATION);
    assert_near(told.age[1], 6, 0);
    end(&r);
}

/* How long the output has been held stands in the tick row; -1: it is not. */
static void a_tick_row_says_for_how_long_an_output_is_held(void **state)
{
    static const double held[] = {-1, 0, 2, 4};
    const char *name;
    size_t at, length;
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    assert_true(apc_controller_tick_field(r.core, APC_TICK_HELD, &name, &at, &length));
    for (size_t k = 0; k < sizeof(held) / sizeof(held[0]); k++) {
        set(&r, APC_SENSOR, 1, 0.5);
        set(&r, APC_SENSOR, 2, 0.5);
        in_of(&r, APC_SENSOR, 1)->status = k ? APC_BAD : APC_GOOD;
        tick(&r, WRITTEN);
        assert_near(r.row[at], held[k], 0);
        assert_near(r.row[at + 1], -1, 0);
    }
    end(&r);
}

/* In virtual time computing takes none: there is no end to keep to. */
static void a_law_is_told_when_its_budget_ends(void **state)
{
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = &keeps,
                                             .dim = {LOOPS, LOOPS, LOOPS, 0},
                                             .period = PERIOD,
                                             .budget = PERIOD / 8,
                                             .real_time = true,
                                             .horizon = HORIZON};
    struct rig r;

    (void)state;
    make(&r, &keeps);
    measured_tick(&r, 0.5, 0.5);
    assert_near(told.budget, 1, 0); /* half the period */
    assert_int_equal(told.deadline, 0);
    apc_controller_destroy(r.core);
    assert_int_equal(apc_controller_create(&r.core, &o, NULL), 0);
    measured_tick(&r, 0.5, 0.5);
    assert_near(told.budget, 0.25, 0);
    assert_int_equal(told.deadline, r.mono + PERIOD / 8);
    end(&r);
}

/* ---- What people are told ------------------------------------------------------------------------ */

/* A law whose answer is poor says so as soon as nothing graver hides it, once, and not what it says meanwhile
 * twice either. */
static void what_graver_news_hides_is_told_at_the_next_tick(void **state)
{
    struct rig r;
    int n = 0;

    (void)state;
    make(&r, &keeps);
    measured_tick(&r, 0.5, 0.5);
    answer = APC_LAW_SUBOPTIMAL;
    said = "listen";
    for (int id = 1; id <= LOOPS; id++)
        set(&r, APC_OPMODE, id, 9); /* refused, of each loop */
    measured_tick(&r, 0.5, 0.5);
    assert_string_equal(r.notice.text, "target mode refused: 9 is none");
    assert_false(apc_controller_noticed(r.core, &r.notice));
    measured_tick(&r, 0.5, 0.5);
    assert_string_equal(r.notice.text, "law keeps: has its reason");
    said = NULL;
    for (int k = 0; k < 3; k++) {
        measured_tick(&r, 0.5, 0.5);
        n += r.notice.kind == APC_NOTICE_SAID && strstr(r.notice.text, "law keeps: listen");
        assert_int_not_equal(r.notice.kind, APC_NOTICE_POOR);
    }
    assert_int_equal(n, 1);
    end(&r);
}

/* An instance has one reason, whichever of its loops had graver news. */
static void graver_news_of_one_loop_does_not_make_the_law_tell_its_reason_twice(void **state)
{
    for (int of = 1; of <= LOOPS; of++) {
        struct rig r;
        int n = 0;

        assert_int_equal(begin(state), 0);
        make(&r, &keeps);
        measured_tick(&r, 0.5, 0.5);
        answer = APC_LAW_SUBOPTIMAL;
        set(&r, APC_OPMODE, of, 9); /* refused */
        for (int k = 0; k < 4; k++) {
            bool this_tick = false;

            measured_tick(&r, 0.5, 0.5);
            do
                this_tick |= r.notice.kind == APC_NOTICE_POOR;
            while (apc_controller_noticed(r.core, &r.notice));
            n += this_tick;
        }
        assert_int_equal(n, 1);
        end(&r);
    }
}

/* Neither does anybody have to be told that what is Bad is refused. */
static void a_target_that_is_bad_takes_the_loop_out_of_service(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    set(&r, APC_OPMODE, 1, APC_MODE_AUTO);
    in_of(&r, APC_OPMODE, 1)->status = APC_BAD;
    measured_tick(&r, 0.5, 0.5);
    assert_near(actual(&r, APC_OPMODE, 1)->value, APC_MODE_OOS, 0);
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->seq, 0);
    assert_near(actual(&r, APC_OPMODE, 2)->value, APC_MODE_AUTO, 0);
    assert_int_equal(r.notice.kind, APC_NOTICE_MODE);
    end(&r);
    make(&r, &apc_law_pid);
    *in_of(&r, APC_OPMODE, 1) = (struct apc_sample){.table = APC_OPMODE, .id = 1}; /* nobody wants anything */
    measured_tick(&r, 0.5, 0.5);
    assert_near(actual(&r, APC_OPMODE, 1)->value, APC_MODE_OOS, 0);
    assert_false(strstr(r.notice.text, "refused"));
    end(&r);
}

static void a_setpoint_that_is_bad_stops_its_loop_and_is_not_called_refused(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid);
    measured_tick(&r, 0.5, 0.5);
    set(&r, APC_SETPOINT, 1, 7);
    in_of(&r, APC_SETPOINT, 1)->status = APC_BAD;
    measured_tick(&r, 0.5, 0.5);
    assert_string_equal(r.notice.text, "v1: output held: setpoint 1 is Bad");
    assert_false(apc_controller_noticed(r.core, &r.notice));
    assert_int_equal(find(&r, APC_ACTUATOR, 1)->status, APC_UNCERTAIN_LAST_USABLE);
    assert_int_equal(find(&r, APC_ACTUATOR, 2)->status, APC_GOOD);
    end(&r);
}

/* ---- Calm ------------------------------------------------------------------------------------------ */

/* The tuning changes without a bump whenever it comes, also when the loop has had its output for one tick. */
static void tuning_gives_no_bump_however_soon_it_comes(void **state)
{
    (void)state;
    for (int after = 0; after < 4; after++) {
        struct rig r, same;

        for (int which = 0; which < 2; which++) {
            struct rig *of = which ? &r : &same;

            make(of, &apc_law_pi);
            set(of, APC_OPMODE, 1, APC_MODE_MAN);
            for (int k = 0; k < 3; k++)
                measured_tick(of, 0.5, 0.5);
            set(of, APC_OPMODE, 1, APC_MODE_AUTO);
            for (int k = 0; k < after; k++)
                measured_tick(of, 0.5, 0.5);
            if (which)
                set(of, APC_TUNING, 1, 3);
            measured_tick(of, 0.5, 0.5);
        }
        assert_near(u(&r, 1), u(&same, 1), 1e-12);
        measured_tick(&r, 0.4, 0.5);
        measured_tick(&same, 0.4, 0.5);
        assert_true(u(&r, 1) > u(&same, 1) + 0.05); /* and it is in force */
        end(&r);
        end(&same);
    }
}

#define T(test) cmocka_unit_test_setup(test, begin)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(a_law_is_told_how_its_measurements_are),
        T(a_law_is_told_when_its_budget_ends),
        T(a_tick_row_says_for_how_long_an_output_is_held),
        T(what_graver_news_hides_is_told_at_the_next_tick),
        T(graver_news_of_one_loop_does_not_make_the_law_tell_its_reason_twice),
        T(a_target_that_is_bad_takes_the_loop_out_of_service),
        T(a_setpoint_that_is_bad_stops_its_loop_and_is_not_called_refused),
        T(tuning_gives_no_bump_however_soon_it_comes),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
