/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Disturbances that are measured: what a law is told of them, over its whole horizon, and that a loop rests
 * without those that its law takes, calm or not, while its neighbour, which takes others, goes on.
 */
#include "check.h"

#include "modules/controller.h"

#include "rows.h"

#include <string.h>

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define PERIOD (2 * S)

enum { LOOPS = 2, ND = 2, AHEAD = 3, FIRST = 11 /* id of the first disturbance */ };

/* ---- A law that looks ------------------------------------------------------------------------ */

static double seen[LOOPS][AHEAD * ND], updated[LOOPS][AHEAD * ND];
static size_t number[LOOPS], rows, ahead; /* ahead: rows that it wants */

/* The first loop takes the first disturbance, the second one both. */
static int ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                 struct apc_error *why)
{
    (void)setup;
    (void)why;
    p->nd = 1 + output;
    p->d[0] = 0;
    p->d[1] = 1;
    return 0;
}

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    (void)why;
    needs->n_ahead = ahead;
    *self = &number[setup->output];
    return 0;
}

static void destroy(void *self)
{
    (void)self;
}

static void keep(double *to, const struct apc_law_call *c)
{
    rows = c->n_ahead;
    memcpy(to, c->d, c->n_ahead * c->dim.nd * sizeof(*to));
}

static int compute(struct apc_law_call *c)
{
    keep(seen[*(size_t *)c->self], c);
    for (size_t i = 0; i < c->dim.nu; i++)
        c->u[i] = c->d[0];
    return APC_LAW_GOOD;
}

static void update(struct apc_law_call *c)
{
    keep(updated[*(size_t *)c->self], c);
}

static const struct apc_law looks = {.abi = APC_LAW_ABI,
                                     .name = "looks",
                                     .ports = ports,
                                     .create = create,
                                     .destroy = destroy,
                                     .compute = compute,
                                     .update = update},
                            whole = {.abi = APC_LAW_ABI,
                                     .name = "whole",
                                     .whole = true,
                                     .compute = compute,
                                     .create = create,
                                     .destroy = destroy};

/* ---- A controller ------------------------------------------------------------------------------ */

struct rig {
    const struct apc_law *law;
    struct apc_controller *core;
    struct apc_now now;
    uint64_t index;
    struct apc_notice notice;
    bool frozen[ND];
};

static void make(struct rig *r, const struct apc_law *law, size_t n_ahead)
{
    static const int d[ND] = {FIRST, FIRST + 1};
    const struct apc_controller_options o = {
        .size = sizeof(o),
        .law = law,
        .dim = {law->whole ? 1 : LOOPS, law->whole ? 1 : LOOPS, LOOPS, ND},
        .period = PERIOD,
        .horizon = PERIOD + S,
        .d = d};

    ahead = n_ahead;
    *r = (struct rig){.law = law, .now = {.mono = S, .utc = T0}};
    assert_int_equal(apc_controller_create(&r->core, &o, NULL), 0);
    for (int i = 1; i <= LOOPS; i++)
        rows_feed(apc_controller_in(r->core), APC_OPMODE, i, APC_MODE_AUTO, T0);
    for (int i = 1; i <= (law->whole ? 1 : LOOPS); i++)
        rows_feed(apc_controller_in(r->core), APC_SETPOINT, i, 1, T0);
}

/* One period later, with new rows of all that is measured. */
static void tick(struct rig *r, double d1, double d2)
{
    struct apc_rows *in = apc_controller_in(r->core);
    const struct apc_rows *out = apc_controller_out(r->core);

    r->now.mono += PERIOD;
    r->now.utc += PERIOD;
    for (int i = 1; i <= (r->law->whole ? 1 : LOOPS); i++)
        rows_feed(in, APC_SENSOR, i, 0, r->now.utc);
    if (!r->frozen[0])
        rows_feed(in, APC_SENSOR, FIRST, d1, r->now.utc);
    if (!r->frozen[1])
        rows_feed(in, APC_SENSOR, FIRST + 1, d2, r->now.utc);
    if (isnan(d2))
        rows_at(in, APC_SENSOR, FIRST + 1)->status = APC_BAD_SENSOR_FAILURE;
    apc_controller_compute(r->core, r->now, r->index++, true, &r->notice);
    for (size_t i = 0; i < out->n_samples; i++) {
        if (out->sample[i].table == APC_ACTUATOR)
            *rows_at(in, APC_ACTUATOR, out->sample[i].id) = out->sample[i];
    }
    apc_controller_update(r->core, 1);
}

static enum apc_loop_state state_of(const struct rig *r, size_t i)
{
    return r->core->state[i].loop.state;
}

static const double *field(const struct rig *r, enum apc_tick_field which)
{
    const char *name;
    size_t offset, length;

    assert_true(apc_controller_tick_field(r->core, which, &name, &offset, &length));
    assert_int_equal(length, ND);
    return apc_controller_out(r->core)->vector->value + offset;
}

static void assert_rows(double at[LOOPS][AHEAD * ND], double d1, double d2)
{
    assert_int_equal(rows, AHEAD);
    for (size_t i = 0; i < LOOPS; i++) {
        for (size_t k = 0; k < AHEAD; k++) {
            assert_near(at[i][k * (i + 1)], d1, 0);
            assert_near(at[i][k * (i + 1) + i], i == 0 ? d1 : d2, 0);
        }
    }
}

static void a_law_is_told_of_disturbances_as_if_they_stayed(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &looks, AHEAD);
    for (int k = 0; k < 5; k++) {
        tick(&r, 0.5 + k, 7 - k);
        assert_rows(seen, 0.5 + k, 7 - k);
        assert_rows(updated, 0.5 + k, 7 - k);
        assert_near(field(&r, APC_TICK_D)[0], 0.5 + k, 0);
        assert_near(field(&r, APC_TICK_D)[1], 7 - k, 0);
        assert_near(field(&r, APC_TICK_D_SEQ)[1], k + 1, 0);
        assert_near(field(&r, APC_TICK_D_STATUS)[1], APC_GOOD, 0);
    }
    apc_controller_destroy(r.core);
}

/* Also in the tick row: Bad as it is, no communication where it stopped coming. */
static void a_loop_rests_without_its_disturbances_and_its_neighbour_goes_on(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &looks, 1);
    for (int k = 0; k < 5; k++)
        tick(&r, 0.5, 7);
    assert_true(r.core->fast_path[0] && r.core->fast_path[1]);
    tick(&r, 0.6, (double)NAN);
    assert_int_equal(state_of(&r, 0), APC_LOOP_AUTO);
    assert_int_equal(state_of(&r, 1), APC_LOOP_HOLD);
    assert_true(r.core->fast_path[0] && !r.core->fast_path[1]);
    assert_has(r.notice.text, "disturbance 12 is Bad");
    assert_near(field(&r, APC_TICK_D)[1], 7, 0);
    assert_near(field(&r, APC_TICK_D_SEQ)[1], 5, 0);
    assert_near(field(&r, APC_TICK_D_STATUS)[0], APC_GOOD, 0);
    assert_near(field(&r, APC_TICK_D_STATUS)[1], APC_BAD_SENSOR_FAILURE, 0);
    tick(&r, 0.7, 8);
    assert_int_equal(state_of(&r, 1), APC_LOOP_AUTO);
    assert_has(r.notice.text, "output 2: inputs good again after 2 s");
    r.frozen[0] = true;
    tick(&r, 0, 8); /* not for longer than the horizon yet */
    assert_int_equal(state_of(&r, 0), APC_LOOP_AUTO);
    tick(&r, 0, 8);
    assert_int_equal(state_of(&r, 0), APC_LOOP_HOLD);
    assert_int_equal(state_of(&r, 1), APC_LOOP_HOLD);
    assert_has(r.notice.text, "disturbance 11 is stale");
    assert_near(field(&r, APC_TICK_D_STATUS)[0], APC_BAD_NO_COMMUNICATION, 0);
    assert_near(field(&r, APC_TICK_D)[0], 0.7, 0);
    apc_controller_destroy(r.core);
}

static void a_law_that_is_whole_takes_them_all(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &whole, 1);
    tick(&r, 0.5, 7);
    assert_int_equal(state_of(&r, 0), APC_LOOP_AUTO);
    tick(&r, 0.5, (double)NAN);
    for (size_t i = 0; i < LOOPS; i++)
        assert_int_equal(state_of(&r, i), APC_LOOP_HOLD);
    apc_controller_destroy(r.core);
    make(&r, &whole, 1);
    r.frozen[0] = true;
    tick(&r, 0.5, 7);
    for (size_t i = 0; i < LOOPS; i++)
        assert_int_not_equal(state_of(&r, i), APC_LOOP_AUTO);
    assert_has(r.core->state[0].trouble, "disturbance 11 is missing");
    apc_controller_destroy(r.core);
}

/* The update that it was ended before, with the disturbances of then, in all rows. */
static void a_restart_goes_on_from_the_disturbances_that_there_were(void **state)
{
    static double values[256];
    struct rig r, next;
    struct apc_vector row;

    (void)state;
    make(&r, &looks, AHEAD);
    for (int k = 0; k < 3; k++)
        tick(&r, 0.5 + k, 7 - k);
    row = *apc_controller_out(r.core)->vector;
    memcpy(values, row.value, row.n * sizeof(*values));
    make(&next, &looks, AHEAD);
    struct apc_vector *former = apc_controller_former(next.core)->vector;
    former->seq = row.seq;
    former->time = row.time;
    former->status = row.status;
    former->n = row.n;
    memcpy(former->value, values, row.n * sizeof(*values));
    assert_int_equal(apc_controller_resume(next.core, T0), 1);
    memcpy(apc_controller_in(next.core)->sample, apc_controller_in(r.core)->sample,
           apc_controller_in(r.core)->n_samples * sizeof(struct apc_sample));
    next.now = r.now;
    memset(updated, 0, sizeof(updated));
    next.frozen[0] = next.frozen[1] = true; /* they stand */
    next.now.mono += PERIOD;
    next.now.utc += PERIOD;
    apc_controller_compute(next.core, next.now, r.index, true, &next.notice);
    assert_rows(updated, 2.5, 5);
    assert_rows(seen, 2.5, 5);
    apc_controller_destroy(next.core);
    apc_controller_destroy(r.core);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_law_is_told_of_disturbances_as_if_they_stayed),
        cmocka_unit_test(a_loop_rests_without_its_disturbances_and_its_neighbour_goes_on),
        cmocka_unit_test(a_law_that_is_whole_takes_them_all),
        cmocka_unit_test(a_restart_goes_on_from_the_disturbances_that_there_were),
    };

    for (size_t i = 0; i < LOOPS; i++)
        number[i] = i;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
