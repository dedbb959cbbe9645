/* SPDX-License-Identifier: BSD-3-Clause */
/* Two controllers on one store: the one above moves the setpoint of the one below, a PI over a PI. */
#include "check.h"

#include "modules/controller.h"

#include <math.h>
#include <string.h>

#define S       APC_NS_PER_S
#define MS      APC_NS_PER_MS
#define T0      (INT64_C(1700000000) * S)
#define STEP    (100 * MS) /* of the plant and its measurement */
#define BELOW   5          /* steps in a period of the controller below */
#define ABOVE   50         /* of the one above */
#define FRESH   (3 * ABOVE * STEP + 100 * MS)
#define ROOM    64
#define MAX_ROW 64

enum { BASE, UPPER, CORES };
enum { R = 1, W = 2 }; /* setpoints: below, above */

/* What is stored: the newest row of each variable, the newest tick row of each controller. */
struct world {
    struct apc_controller *core[CORES]; /* NULL: killed */
    struct apc_sample row[ROOM];
    size_t n;
    struct apc_vector tick[CORES];
    double values[CORES][MAX_ROW], y, gain;
    apc_ns t;
    uint64_t step;
    struct apc_notice notice[CORES]; /* the last one that said something */
    bool away, hasty; /* the plant's measurement is lost; an operator writes while the one above computes */
};

static struct apc_sample *row(struct world *w, enum apc_table table, int id)
{
    size_t i = 0;

    while (i < w->n && (w->row[i].table != table || w->row[i].id != id))
        i++;
    assert_in_range(i, 0, ROOM - 1);
    if (i == w->n)
        w->row[w->n++] = (struct apc_sample){.table = table, .id = id, .status = APC_BAD_NO_DATA};
    return &w->row[i];
}

static void put(struct world *w, enum apc_table table, int id, double value)
{
    struct apc_sample *s = row(w, table, id);

    *s = (struct apc_sample){.table = table, .id = id, .seq = s->seq + 1, .time = T0 + w->t, .value = value};
}

static double setpoint(struct world *w)
{
    return row(w, APC_SETPOINT, R)->value;
}

static enum apc_mode actual(struct world *w, int loop)
{
    return (enum apc_mode)(int)row(w, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop))->value;
}

static void start(struct world *w, int which)
{
    const struct apc_controller_setpoint z = {.id = which == BASE ? R : W,
                                              .low = -100.0,
                                              .high = 100.0,
                                              .above = which == BASE ? 2 : 0,
                                              .above_period = ABOVE * STEP};
    const struct apc_controller_loop base = {.name = "v", .id = 1, .mode = 1, .low = -2.0, .high = 2.0},
                                     upper = {.name = "r",
                                              .id = 2,
                                              .mode = 2,
                                              .low = -100.0,
                                              .high = 100.0,
                                              .setpoint = R,
                                              .below = 1,
                                              .below_tick = 1,
                                              .below_period = BELOW * STEP};
    double tuning[] = {which == BASE ? w->gain : 0.5, which == BASE ? 3.0 : 15.0, 0.0, -1e9, 1e9};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .number = 1 + which,
                                             .law = &apc_law_pi,
                                             .dim = {1, 1, 1, 0},
                                             .period = (which == BASE ? BELOW : ABOVE) * STEP,
                                             .horizon = 3 * STEP + 100 * MS,
                                             .z = &z,
                                             .loop = which == BASE ? &base : &upper,
                                             .tuning = 1 + 10 * which,
                                             .start = tuning};
    struct apc_rows *former;
    struct apc_error why = {""};

    if (apc_controller_create(&w->core[which], &o, &why) < 0)
        fail_msg("%s", why.text);
    former = apc_controller_former(w->core[which]);
    for (size_t i = 0; i < former->n_samples; i++)
        former->sample[i] = *row(w, former->sample[i].table, former->sample[i].id);
    if (w->tick[which].seq > 0) {
        former->vector[0].seq = w->tick[which].seq;
        former->vector[0].time = w->tick[which].time;
        former->vector[0].status = APC_GOOD;
        former->vector[0].n = w->tick[which].n;
        memcpy(former->vector[0].value, w->values[which], w->tick[which].n * sizeof(double));
    }
    assert_int_equal(apc_controller_resume(w->core[which], T0), w->tick[which].seq > 0);
}

static void end(struct world *w, int which)
{
    apc_controller_destroy(w->core[which]);
    w->core[which] = NULL;
}

static void make(struct world *w, double gain)
{
    *w = (struct world){.gain = gain};
    put(w, APC_SETPOINT, R, 0.5);
    put(w, APC_SETPOINT, W, 0.5);
    put(w, APC_OPMODE, 1, APC_MODE_AUTO);
    put(w, APC_OPMODE, 2, APC_MODE_AUTO);
    start(w, BASE);
    start(w, UPPER);
}

/* As a store does it: a setpoint only where the row knows the newest. */
static void append(struct world *w, int which)
{
    struct apc_rows *out = apc_controller_out(w->core[which]);

    for (size_t i = 0; i < out->n_samples; i++) {
        struct apc_sample *s = &out->sample[i], *to = row(w, s->table, s->id);

        if (s->table == APC_SETPOINT) {
            s->seq = s->seq == to->seq ? to->seq + 1 : 0;
            if (s->seq == 0)
                continue;
        }
        assert_true(s->seq > to->seq);
        *to = *s;
    }
    w->tick[which] = out->vector[0];
    assert_in_range(w->tick[which].n, 1, MAX_ROW);
    memcpy(w->values[which], out->vector[0].value, w->tick[which].n * sizeof(double));
}

static void tick(struct world *w, int which)
{
    struct apc_rows *in = apc_controller_in(w->core[which]);
    struct apc_notice notice;

    for (size_t i = 0; i < in->n_samples; i++)
        in->sample[i] = *row(w, in->sample[i].table, in->sample[i].id);
    for (size_t i = 0; i < in->n_vectors; i++) {
        in->vector[i].seq = w->tick[in->vector[i].id - 1].seq;
        in->vector[i].time = w->tick[in->vector[i].id - 1].time;
    }
    apc_controller_compute(w->core[which], (struct apc_now){w->t, T0 + w->t},
                           w->step / (which == BASE ? BELOW : ABOVE), true, &notice);
    if (notice.kind != APC_NOTICE_NONE)
        w->notice[which] = notice;
    if (which == UPPER && w->hasty)
        put(w, APC_SETPOINT, R, 0.75);
    append(w, which);
    apc_controller_update(w->core[which], 1);
}

/* One step of the plant, y' = (u - y) / 2 s, and the ticks that are due; those below come first. */
static void run_step(struct world *w)
{
    w->t += STEP;
    w->step++;
    w->y += 0.05 * ((w->gain > 0.0 ? 1.0 : -1.0) * row(w, APC_ACTUATOR, 1)->value - w->y);
    if (!w->away)
        put(w, APC_SENSOR, 1, w->y);
    if (w->step % BELOW == 0 && w->core[BASE])
        tick(w, BASE);
    if (w->step % ABOVE == 2 && w->core[UPPER])
        tick(w, UPPER);
}

static void run(struct world *w, double seconds)
{
    for (int k = 0; k < (int)(seconds * 10.0 + 0.5); k++)
        run_step(w);
}

/* Until the loop below is in Cas; returns the seconds that it took. */
static double run_to_cas(struct world *w)
{
    const apc_ns since = w->t;

    while (actual(w, 1) != APC_MODE_CAS) {
        const double before = setpoint(w);

        if (w->t - since > 60 * S)
            fail_msg("it is not in Cas after a minute");
        run_step(w);
        assert_near(setpoint(w), before, 1e-12);
    }
    return apc_ns_to_s(w->t - since);
}

/* ---- Stories ----------------------------------------------------------------------------------- */

static void a_loop_goes_into_cas_without_a_step_and_follows(void **state)
{
    struct world w;

    (void)state;
    for (double gain = -1.0; gain <= 1.0; gain += 2.0) {
        make(&w, gain);
        run(&w, 30.0);
        assert_int_equal(actual(&w, 1), APC_MODE_AUTO);
        assert_int_equal(actual(&w, 2), APC_MODE_IMAN);
        put(&w, APC_SETPOINT, W, 1.0);
        put(&w, APC_OPMODE, 1, APC_MODE_CAS);
        assert_true(run_to_cas(&w) <= 2 * 5.0 + 0.5);
        run(&w, 10.0);
        assert_int_equal(actual(&w, 2), APC_MODE_AUTO);
        run(&w, 200.0);
        assert_near(w.y, 1.0, 0.01);
        assert_true(row(&w, APC_SETPOINT, R)->origin > 0);
        end(&w, BASE);
        end(&w, UPPER);
    }
}

static void without_the_one_above_it_is_shed_in_time_and_taken_again_without_a_bump(void **state)
{
    struct world w;
    apc_ns last;
    double sp;

    (void)state;
    make(&w, 1.0);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    run(&w, 100.0);
    assert_int_equal(actual(&w, 1), APC_MODE_CAS);
    put(&w, APC_SETPOINT, W, 0.9);
    run(&w, 7.0);
    end(&w, UPPER);
    sp = setpoint(&w);
    last = row(&w, APC_SETPOINT, R)->time - T0;
    while (actual(&w, 1) == APC_MODE_CAS) {
        run_step(&w);
        assert_true(w.t - last <= FRESH + BELOW * STEP);
    }
    assert_true(w.t - last > FRESH - BELOW * STEP);
    assert_int_equal(actual(&w, 1), APC_MODE_AUTO);
    assert_string_equal(w.notice[BASE].text, "mode Auto: no setpoint from above");
    run(&w, 30.0);
    assert_near(setpoint(&w), sp, 0.0);
    start(&w, UPPER);
    assert_true(run_to_cas(&w) <= 3 * 5.0 + 0.5);
    run(&w, 200.0);
    assert_near(w.y, 0.9, 0.01);
    end(&w, BASE);
    end(&w, UPPER);
}

static void both_are_killed_and_go_on_where_they_were(void **state)
{
    struct world whole, killed;

    (void)state;
    make(&whole, 1.0);
    make(&killed, 1.0);
    for (int k = 0; k < 3000; k++) {
        if (k == 100)
            put(&whole, APC_OPMODE, 1, APC_MODE_CAS);
        if (k == 100)
            put(&killed, APC_OPMODE, 1, APC_MODE_CAS);
        if (k % 700 == 0)
            put(&whole, APC_SETPOINT, W, 0.1 * (k % 9));
        if (k % 700 == 0)
            put(&killed, APC_SETPOINT, W, 0.1 * (k % 9));
        run_step(&whole);
        run_step(&killed);
        for (int which = BASE; which < CORES && k % 13 == 5 * which; which++) {
            end(&killed, which);
            start(&killed, which);
        }
        assert_int_equal(actual(&whole, 1), actual(&killed, 1));
        assert_memory_equal(&row(&whole, APC_SETPOINT, R)->value, &row(&killed, APC_SETPOINT, R)->value,
                            sizeof(double));
        assert_memory_equal(&whole.y, &killed.y, sizeof(double));
    }
    assert_int_equal(actual(&killed, 1), APC_MODE_CAS);
    end(&whole, BASE);
    end(&whole, UPPER);
    end(&killed, BASE);
    end(&killed, UPPER);
}

static void a_setpoint_that_an_operator_takes_is_his(void **state)
{
    struct world w;

    (void)state;
    make(&w, 1.0);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    run(&w, 60.0);
    put(&w, APC_SETPOINT, R, 0.25); /* both, as a store writes it */
    put(&w, APC_OPMODE, 1, APC_MODE_AUTO);
    run(&w, 60.0);
    assert_near(setpoint(&w), 0.25, 0.0);
    assert_near(w.y, 0.25, 1e-3);
    assert_int_equal(actual(&w, 1), APC_MODE_AUTO);
    assert_int_equal(actual(&w, 2), APC_MODE_IMAN);
    assert_string_equal(w.notice[UPPER].text, "mode IMan: the loop below does not take the output");
    assert_int_equal(row(&w, APC_ACTUAL, apc_variable_number(APC_SETPOINT, R))->status,
                     APC_GOOD_LOCAL_OVERRIDE);
    end(&w, BASE);
    end(&w, UPPER);
}

static void in_man_the_setpoint_follows_the_measurement_and_there_is_no_bump_back(void **state)
{
    struct world w;
    double u;

    (void)state;
    make(&w, 1.0);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    run(&w, 60.0);
    put(&w, APC_OPMODE, 1, APC_MODE_MAN);
    put(&w, APC_MANUAL, 1, 1.5);
    run(&w, 60.0);
    assert_near(w.y, 1.5, 1e-6);
    assert_near(setpoint(&w), w.y, 1e-6);
    assert_int_equal(actual(&w, 2), APC_MODE_IMAN);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    u = row(&w, APC_ACTUATOR, 1)->value;
    (void)run_to_cas(&w);
    assert_near(row(&w, APC_ACTUATOR, 1)->value, u, 1e-6);
    end(&w, BASE);
    end(&w, UPPER);
}

/* The actuator stands at its limit for ten minutes: what the one above wants does not run away. */
static void above_a_loop_at_its_limit_nothing_winds_up(void **state)
{
    struct world w;

    (void)state;
    for (double gain = -1.0; gain <= 1.0; gain += 2.0) {
        make(&w, gain);
        put(&w, APC_OPMODE, 1, APC_MODE_CAS);
        run(&w, 60.0);
        put(&w, APC_SETPOINT, W, 5.0); /* 2 is all that can be had */
        run(&w, 600.0);
        assert_near(w.y, 2.0, 1e-3);
        assert_true(setpoint(&w) < 8.0);
        put(&w, APC_SETPOINT, W, 1.0);
        run(&w, 120.0);
        assert_near(w.y, 1.0, 0.05);
        end(&w, BASE);
        end(&w, UPPER);
    }
}

/* Somebody writes the setpoint between the read of the one above and its write: that is left out. */
static void who_was_faster_has_the_setpoint_and_the_law_goes_on_from_it(void **state)
{
    struct world w;

    (void)state;
    make(&w, 1.0);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    run(&w, 60.0);
    while (w.step % ABOVE != 1)
        run_step(&w);
    w.hasty = true;
    run_step(&w);
    w.hasty = false;
    assert_near(setpoint(&w), 0.75, 0.0);
    run(&w, 4.9);
    assert_near(setpoint(&w), 0.75, 1e-12);
    run(&w, 0.2); /* the next tick above */
    assert_true(row(&w, APC_SETPOINT, R)->origin > 0);
    assert_near(setpoint(&w), 0.75, 0.1); /* not back to 0.5, from which it came */
    end(&w, BASE);
    end(&w, UPPER);
}

static void with_the_measurement_lost_both_hold_and_come_back(void **state)
{
    struct world w;

    (void)state;
    make(&w, 1.0);
    put(&w, APC_OPMODE, 1, APC_MODE_CAS);
    run(&w, 60.0);
    w.away = true;
    run(&w, 30.0);
    assert_int_equal(actual(&w, 1), APC_MODE_LO);
    assert_int_equal(apc_status_severity(row(&w, APC_SETPOINT, R)->status), APC_SEVERITY_GOOD);
    w.away = false;
    assert_true(run_to_cas(&w) <= 4 * 5.0);
    run(&w, 200.0);
    assert_near(w.y, 0.5, 1e-3);
    end(&w, BASE);
    end(&w, UPPER);
}

/* ---- Chance ------------------------------------------------------------------------------------ */

static struct apc_random chance;

static bool one_in(unsigned n)
{
    return apc_random_next(&chance) % n == 0;
}

static void happen(struct world *w)
{
    static const enum apc_mode modes[] = {APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_CAS, APC_MODE_CAS,
                                          APC_MODE_OOS};
    const int which = one_in(2) ? BASE : UPPER;

    if (one_in(600))
        put(w, APC_OPMODE, 1, modes[apc_random_next(&chance) % 5]);
    if (one_in(1500)) /* above there is nothing to be in Cas with: refused */
        put(w, APC_OPMODE, 2, modes[apc_random_next(&chance) % 5]);
    if (one_in(300))
        put(w, APC_SETPOINT, W, 2.0 * apc_random_uniform(&chance));
    if (one_in(400) && row(w, APC_OPMODE, 1)->value != (double)APC_MODE_CAS)
        put(w, APC_SETPOINT, R, 2.0 * apc_random_uniform(&chance));
    if (one_in(400))
        put(w, APC_MANUAL, 1 + which, 2.0 * apc_random_uniform(&chance));
    if (one_in(w->away ? 50 : 1000))
        w->away = !w->away;
    w->hasty = one_in(50);
    if (one_in(w->core[which] ? 1500 : 60)) {
        if (w->core[which])
            end(w, which);
        else
            start(w, which);
    }
}

/* What holds at every step, whatever happens. */
static void look(struct world *w, const struct apc_sample *before)
{
    const struct apc_sample *r = row(w, APC_SETPOINT, R), *v = row(w, APC_ACTUATOR, 1);
    const double mine = row(w, APC_ACTUAL, apc_variable_number(APC_SETPOINT, R))->value;
    const bool ticked = w->core[BASE] && w->step % BELOW == 0;

    assert_true(v->seq == 0 || (v->value >= -2.0 && v->value <= 2.0));
    assert_int_equal(apc_status_severity(r->status) == APC_SEVERITY_BAD, 0);
    if (ticked && actual(w, 1) == APC_MODE_CAS) {
        assert_int_equal(row(w, APC_OPMODE, 1)->value, APC_MODE_CAS);
        assert_true(r->origin > 0);
        assert_true(w->t - (r->time - T0) <= FRESH);
        if (before->status ==
            APC_UNCERTAIN_INITIAL) /* it entered; out of Hold it goes on where the one above is */
            assert_near(mine, before->value, 1e-12);
    }
}

static void whatever_happens_to_two_layers_what_must_hold_holds(void **state)
{
    unsigned entries = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 30; seed++) {
        struct world w;

        apc_random_init(&chance, seed, "cascade");
        make(&w, 1.0);
        for (int k = 0; k < 20000; k++) {
            const enum apc_mode before = actual(&w, 1);
            const struct apc_sample said = *row(&w, APC_ACTUAL, apc_variable_number(APC_SETPOINT, R));

            happen(&w);
            run_step(&w);
            look(&w, &said);
            entries += before == APC_MODE_AUTO && actual(&w, 1) == APC_MODE_CAS;
        }
        w.away = w.hasty = false;
        for (int which = BASE; which < CORES; which++) {
            if (!w.core[which])
                start(&w, which);
        }
        put(&w, APC_OPMODE, 1, APC_MODE_CAS);
        put(&w, APC_OPMODE, 2, APC_MODE_AUTO);
        run(&w, 60.0); /* it always finds back */
        assert_int_equal(actual(&w, 1), APC_MODE_CAS);
        assert_int_equal(actual(&w, 2), APC_MODE_AUTO);
        end(&w, BASE);
        end(&w, UPPER);
    }
    assert_true(entries > 300);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_loop_goes_into_cas_without_a_step_and_follows),
        cmocka_unit_test(without_the_one_above_it_is_shed_in_time_and_taken_again_without_a_bump),
        cmocka_unit_test(both_are_killed_and_go_on_where_they_were),
        cmocka_unit_test(a_setpoint_that_an_operator_takes_is_his),
        cmocka_unit_test(in_man_the_setpoint_follows_the_measurement_and_there_is_no_bump_back),
        cmocka_unit_test(above_a_loop_at_its_limit_nothing_winds_up),
        cmocka_unit_test(who_was_faster_has_the_setpoint_and_the_law_goes_on_from_it),
        cmocka_unit_test(with_the_measurement_lost_both_hold_and_come_back),
        cmocka_unit_test(whatever_happens_to_two_layers_what_must_hold_holds),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
