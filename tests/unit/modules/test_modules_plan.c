/* SPDX-License-Identifier: BSD-3-Clause */
/* What a law that looks ahead is told of setpoints to come. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "rows.h"

#include "modules/controller.h"

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define PERIOD (2 * S)
#define AHEAD  4

/* ---- A law that puts out what it sees: a digit for each row, the present one last ---------- */

static double digits(const struct apc_law_call *c)
{
    double u = 0.0;
    for (size_t i = c->n_ahead; i-- > 0;)
        u = 10.0 * u + c->z[i];
    return u;
}

static int compute(struct apc_law_call *c)
{
    c->u[0] = digits(c);
    return APC_LAW_GOOD;
}

static void update(struct apc_law_call *c)
{
    c->x[0] = digits(c);
}

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    (void)setup;
    (void)self;
    (void)why;
    needs->n_ahead = AHEAD;
    needs->states = 1;
    return 0;
}

static void track(struct apc_law_call *c)
{
    (void)c;
}

static const struct apc_law law = {.abi = APC_LAW_ABI,
                                   .name = "digits",
                                   .create = create,
                                   .compute = compute,
                                   .update = update,
                                   .track = track};

/* One of two setpoints: the second in front of the decimal point. */
static int compute_both(struct apc_law_call *c)
{
    c->u[0] = 0.0;
    for (size_t i = c->n_ahead; i-- > 0;)
        c->u[0] = 10.0 * c->u[0] + c->z[2 * i + 1] + 1e-4 * c->z[2 * i];
    return APC_LAW_GOOD;
}

/* ---- A controller and what it reads --------------------------------------------------------- */

struct rig {
    struct apc_controller *core;
    struct apc_rows *in;
    struct apc_vector *plan;
    apc_ns now;
    uint64_t index;
};

static void make(struct rig *r, apc_ns now)
{
    static const struct apc_controller_setpoint z = {.name = "r", .id = 1, .low = 0, .high = 8};
    const struct apc_controller_options o = {
        .size = sizeof(o), .law = &law, .dim = {1, 1, 1, 0}, .period = PERIOD, .horizon = 10 * S, .z = &z};
    struct apc_error why;
    *r = (struct rig){.now = now};
    if (apc_controller_create(&r->core, &o, &why) < 0)
        fail_msg("%s", why.text);
    r->in = apc_controller_in(r->core);
    assert_int_equal(r->in->n_vectors, 1);
    r->plan = r->in->vector;
    assert_int_equal(r->plan->table, APC_PLAN);
    assert_int_equal(r->plan->id, 1);
    rows_feed(r->in, APC_OPMODE, 1, APC_MODE_AUTO, now);
    rows_feed(r->in, APC_SETPOINT, 1, 1, now);
}

/* One after @p later. */
static double tick(struct rig *r, apc_ns later)
{
    r->now += later;
    rows_feed(r->in, APC_SENSOR, 1, 0, r->now);
    apc_controller_compute(r->core, (struct apc_now){r->now - T0 + S, r->now}, r->index++, true, NULL);
    const double u = rows_at(apc_controller_out(r->core), APC_ACTUATOR, 1)->value;
    apc_controller_update(r->core, 1);
    return u;
}

/* The plan of the setpoint in force: 1 now, 2 in 3 s, 3 in 7 s. */
static void foresee(struct rig *r)
{
    static const double pairs[] = {0, 1, 3, 2, 7, 3};
    const struct apc_sample *z = rows_at(r->in, APC_SETPOINT, 1);
    r->plan->seq = z->seq;
    r->plan->time = z->time;
    r->plan->status = APC_GOOD;
    r->plan->n = 6;
    memcpy(r->plan->value, pairs, sizeof(pairs));
}

/* ---- Tests ---------------------------------------------------------------------------------- */

static void without_a_plan_it_stays_as_it_is(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    assert_near(tick(&r, 0), 1111, 0);
    apc_controller_destroy(r.core);
}

/*
 * Promise(modes/law-looks-ahead): A law that looks ahead is told the steps to come of a setpoint in force,
 *   and of no other; after a restart and in a replay the same.
 */
static void a_plan_is_told_at_the_times_of_the_ticks_to_come(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    foresee(&r);
    assert_near(tick(&r, 0), 2211, 0);     /* in 0, 2, 4, 6 s */
    assert_near(tick(&r, S), 3221, 0);     /* in 1, 3, 5, 7: what falls together is there */
    assert_near(tick(&r, S), 3221, 0);     /* in 2, 4, 6, 8 */
    assert_near(tick(&r, 2 * S), 3321, 0); /* the step at 3 is late */
    assert_near(tick(&r, 5 * S), 3331, 0); /* three periods and 0.1 s late */
    assert_near(tick(&r, S / 5), 1111, 0); /* nobody follows it */
    apc_controller_destroy(r.core);
}

static void each_setpoint_has_its_own_plan(void **state)
{
    static const struct apc_controller_setpoint z[] = {{.name = "r", .id = 1, .low = 0, .high = 8},
                                                       {.name = "q", .id = 2, .low = 0, .high = 8}};
    static const double pairs[] = {0, 5, 3, 6, 7, 7};
    struct apc_law both = law;
    const struct apc_controller_options o = {
        .size = sizeof(o), .law = &both, .dim = {1, 2, 1, 0}, .period = PERIOD, .horizon = 10 * S, .z = z};
    struct apc_error why;
    struct rig r = {.now = T0};
    (void)state;
    both.whole = true;
    both.compute = compute_both;
    if (apc_controller_create(&r.core, &o, &why) < 0)
        fail_msg("%s", why.text);
    r.in = apc_controller_in(r.core);
    r.plan = r.in->vector;
    assert_int_equal(r.in->n_vectors, 2);
    assert_int_equal(r.plan[1].id, 2);
    rows_feed(r.in, APC_OPMODE, 1, APC_MODE_AUTO, T0);
    rows_feed(r.in, APC_SETPOINT, 1, 1, T0);
    rows_feed(r.in, APC_SETPOINT, 2, 5, T0);
    foresee(&r);
    const struct apc_sample *second = rows_at(r.in, APC_SETPOINT, 2);
    r.plan[1].seq = second->seq;
    r.plan[1].time = second->time;
    r.plan[1].status = APC_GOOD;
    r.plan[1].n = 6;
    memcpy(r.plan[1].value, pairs, sizeof(pairs));
    assert_near(tick(&r, 0), 6655.2211, 1e-9);
    assert_near(tick(&r, S), 7665.3221, 1e-9);
    apc_controller_destroy(r.core);
}

/* Promise(modes/law-looks-ahead) */
static void a_plan_of_another_row_is_none(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    foresee(&r);
    rows_feed(r.in, APC_SETPOINT, 1, 4, T0 + 1); /* an operator's */
    assert_near(tick(&r, S), 4444, 0);
    foresee(&r);
    r.plan->value[1] = 4;
    assert_near(tick(&r, 0), 3224, 0);
    r.plan->time++;
    assert_near(tick(&r, 0), 4444, 0);
    r.plan->time--;
    r.plan->value[1] = 5;
    assert_near(tick(&r, 0), 4444, 0);
    apc_controller_destroy(r.core);
}

/* Promise(modes/law-looks-ahead) */
static void a_plan_that_is_damaged_is_none(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    foresee(&r);
    assert_near(tick(&r, S), 3221, 0);
    r.plan->n = 5;
    assert_near(tick(&r, 0), 1111, 0);
    r.plan->n = r.plan->room + 2; /* longer than there is room for */
    assert_near(tick(&r, 0), 1111, 0);
    foresee(&r);
    r.plan->value[4] = 3; /* not later than the one before */
    assert_near(tick(&r, 0), 1111, 0);
    r.plan->value[4] = (double)NAN;
    assert_near(tick(&r, 0), 1111, 0);
    r.plan->value[4] = 1e200;
    assert_near(tick(&r, 0), 1111, 0);
    foresee(&r);
    r.plan->status = APC_BAD;
    assert_near(tick(&r, 0), 1111, 0);
    r.plan->status = APC_GOOD;
    r.plan->value[5] = 9; /* beyond the setpoint's limits: it would be refused */
    assert_near(tick(&r, 0), 2221, 0);
    apc_controller_destroy(r.core);
}

static void a_setpoint_that_is_refused_has_no_plan(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    assert_near(tick(&r, 0), 1111, 0);
    rows_feed(r.in, APC_SETPOINT, 1, 9, T0);
    foresee(&r);
    r.plan->value[1] = 9;
    assert_near(tick(&r, S), 1111, 0);
    apc_controller_destroy(r.core);
}

static double field(const struct rig *r, enum apc_tick_field of)
{
    return r->core->row[r->core->offset[of]];
}

static void the_tick_row_says_which_plan_was_looked_at_and_whether_it_counted(void **state)
{
    struct rig r;
    (void)state;
    make(&r, T0);
    tick(&r, 0);
    assert_near(field(&r, APC_TICK_PLAN), 0, 0);
    foresee(&r);
    r.plan->seq = rows_at(r.in, APC_SETPOINT, 1)->seq;
    tick(&r, S);
    assert_near(field(&r, APC_TICK_PLAN), 1, 0);
    assert_near(field(&r, APC_TICK_PLANNED), 1, 0);
    rows_feed(r.in, APC_SETPOINT, 1, 4, r.now);
    tick(&r, S);
    assert_near(field(&r, APC_TICK_PLAN), 1, 0);
    assert_near(field(&r, APC_TICK_PLANNED), 0, 0);
    apc_controller_destroy(r.core);
}

/* x goes on by an update with what the tick before the restart foresaw. */
/* Promise(modes/law-looks-ahead) */
static void a_restart_goes_on_with_the_plan_of_the_tick_before(void **state)
{
    struct rig r, next;
    (void)state;
    for (int newer = 0; newer < 2; newer++) {
        make(&r, T0);
        foresee(&r);
        tick(&r, 0);
        tick(&r, PERIOD);
        const struct apc_vector *row = apc_controller_out(r.core)->vector;
        make(&next, T0);
        for (size_t i = 0; i < r.in->n_samples; i++)
            next.in->sample[i] = r.in->sample[i];
        foresee(&next);
        next.plan->seq += newer;
        next.now = r.now;
        next.index = r.index;
        struct apc_vector *former = apc_controller_former(next.core)->vector;
        former->seq = row->seq;
        former->time = row->time;
        former->status = APC_GOOD;
        former->n = row->n;
        memcpy(former->value, row->value, row->n * sizeof(double));
        assert_int_equal(apc_controller_resume(next.core, T0), 1);
        tick(&next, PERIOD);
        assert_near(field(&next, APC_TICK_X), newer ? 1111 : 3221, 0);
        apc_controller_destroy(next.core);
        apc_controller_destroy(r.core);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_a_plan_it_stays_as_it_is),
        cmocka_unit_test(a_plan_is_told_at_the_times_of_the_ticks_to_come),
        cmocka_unit_test(each_setpoint_has_its_own_plan),
        cmocka_unit_test(a_plan_of_another_row_is_none),
        cmocka_unit_test(a_plan_that_is_damaged_is_none),
        cmocka_unit_test(a_setpoint_that_is_refused_has_no_plan),
        cmocka_unit_test(the_tick_row_says_which_plan_was_looked_at_and_whether_it_counted),
        cmocka_unit_test(a_restart_goes_on_with_the_plan_of_the_tick_before),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
