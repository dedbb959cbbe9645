/* SPDX-License-Identifier: BSD-3-Clause */
#include "laws.h"

#define KP    0.2
#define TAU_I 10.0

static double tuning[] = {KP, TAU_I, 0.0, -1e9, 1e9};

/* One loop: its y, z, x, u and a call that works on them. */
struct loop {
    double y, z, x, u;
    unsigned limited;
    struct apc_instances *law;
    struct apc_law_call c;
};

static const struct apc_law_setup one_loop = {.dim = {1, 1, 1, 0}, .Ts = 2.0};

static struct apc_law_call *begin(struct loop *l, const double *parameters)
{
    *l = (struct loop){0};
    l->c = (struct apc_law_call){.dim = {1, 1, 1, 0},
                                 .Ts = 2.0,
                                 .y = &l->y,
                                 .z = &l->z,
                                 .tuning = parameters,
                                 .x = &l->x,
                                 .u = &l->u,
                                 .limited = &l->limited};
    assert_int_equal(laws_make(&l->law, &apc_law_pi, &one_loop, NULL), 0);
    return &l->c;
}

/* Promise(laws/pi): `pi` is the paper's, with its anti-windup. */
static void the_papers_loop_follows_the_published_step_response(void **state)
{
    const double expected[] = {0.0, .36254, .60043, .75518, .85475, .91792};
    const double a = exp(-2.0 / 10.0);
    struct loop l;
    struct apc_law_call *c = begin(&l, tuning);
    double max = 0.0;

    (void)state;
    l.z = 1.0;
    for (int k = 0; k < 200; k++) {
        if (k < 6)
            assert_near(l.y, expected[k], 5e-6);
        max = fmax(max, l.y);
        laws_compute(l.law, c);
        laws_update(l.law, c);
        l.y = a * l.y + (1.0 - a) * 10.0 * l.u;
    }
    assert_near(max, 1.00859, 5e-6);
    assert_near(l.y, 1.0, 1e-9);
}

/* Promise(laws/order-of-calls) */
static void the_integral_moves_only_in_update(void **state)
{
    struct loop l;
    struct apc_law_call *c = begin(&l, tuning);

    (void)state;
    l.z = 3.0;
    l.x = 0.25;
    laws_compute(l.law, c);
    assert_near(l.u, KP * 3.0 + 0.25, 1e-15);
    assert_true(l.x == 0.25);
    laws_update(l.law, c);
    assert_near(l.x, 0.25 + KP * 2.0 / TAU_I * 3.0, 1e-15);
}

/* Promise(laws/pi) */
static void after_long_saturation_it_leaves_the_limit_at_once(void **state)
{
    const double limited[] = {KP, TAU_I, 0.0, -0.5, 0.5};

    (void)state;
    for (double sign = -1.0; sign <= 1.0; sign += 2.0) {
        struct loop l;
        struct apc_law_call *c = begin(&l, limited);

        l.z = sign * 100.0;
        for (int k = 0; k < 10000; k++) {
            laws_compute(l.law, c);
            assert_near(l.u, sign * 0.5, 0.0);
            assert_int_equal(l.limited, sign > 0.0 ? APC_LIMITED_HIGH : APC_LIMITED_LOW);
            laws_update(l.law, c);
        }
        l.z = sign * -0.1;
        laws_compute(l.law, c);
        assert_true(fabs(l.u) < 0.5);
    }
}

static void a_limit_set_elsewhere_stops_the_integral_as_well(void **state)
{
    struct loop l;
    struct apc_law_call *c = begin(&l, tuning);

    (void)state;
    l.z = 10.0;
    for (int k = 0; k < 1000; k++) {
        laws_compute(l.law, c);
        assert_true(l.u >= 2.0);
        l.u = 1.0; /* what went out */
        laws_update(l.law, c);
    }
    assert_true(l.x == 0.0);
    l.z = -10.0; /* the increment now leads back: it counts */
    l.u = 1.0;
    l.x = 5.0;
    laws_update(l.law, c);
    assert_true(l.x < 5.0);
}

static void after_track_compute_gives_the_tracked_output(void **state)
{
    struct loop l;
    struct apc_law_call *c = begin(&l, tuning);

    (void)state;
    l.y = 7.3;
    l.z = -2.1;
    l.x = 99.0;
    l.u = 1.234;
    laws_track(l.law, c);
    l.u = 0.0;
    laws_compute(l.law, c);
    assert_near(l.u, 1.234, 1e-14);
}

static void each_output_has_its_own_loop_and_tuning(void **state)
{
    const double both[] = {1.0, 2.0, 0.0, -1e9, 1e9, 3.0, 4.0, 10.0, -1e9, 11.0};
    const double y[] = {1.0, 2.0, 777.0};
    const double z[] = {2.0, 2.1};
    double x[2] = {0.0, 0.5};
    double u[2];
    unsigned limited[2] = {0};
    struct apc_law_call c = {
        .dim = {3, 2, 2, 0}, .Ts = 1.0, .y = y, .z = z, .tuning = both, .x = x, .u = u, .limited = limited};

    const struct apc_law_setup setup = {.dim = c.dim, .Ts = 1.0};
    struct apc_instances *law;

    (void)state;
    assert_int_equal(laws_make(&law, &apc_law_pi, &setup, NULL), 0);
    laws_compute(law, &c);
    assert_near(u[0], 1.0, 1e-12);
    assert_near(u[1], 10.8, 1e-12);
    laws_update(law, &c);
    assert_near(x[0], 0.5, 1e-12);
    assert_near(x[1], 0.575, 1e-12);
}

static void it_wants_one_setpoint_and_one_measurement_for_each_output(void **state)
{
    (void)state;
    assert_true(apc_law_pi.accepts(&(struct apc_dim){1, 1, 1, 0}));
    assert_true(apc_law_pi.accepts(&(struct apc_dim){3, 2, 2, 0}));
    assert_false(apc_law_pi.accepts(&(struct apc_dim){1, 2, 2, 0}));
    assert_false(apc_law_pi.accepts(&(struct apc_dim){2, 1, 2, 0}));
    assert_false(apc_law_pi.accepts(&(struct apc_dim){2, 2, 1, 0}));
    assert_int_equal(apc_law_pi.n_state(&(struct apc_dim){1, 1, 1, 0}), 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_papers_loop_follows_the_published_step_response, laws_end),
        cmocka_unit_test_teardown(the_integral_moves_only_in_update, laws_end),
        cmocka_unit_test_teardown(after_long_saturation_it_leaves_the_limit_at_once, laws_end),
        cmocka_unit_test_teardown(a_limit_set_elsewhere_stops_the_integral_as_well, laws_end),
        cmocka_unit_test_teardown(after_track_compute_gives_the_tracked_output, laws_end),
        cmocka_unit_test_teardown(each_output_has_its_own_loop_and_tuning, laws_end),
        cmocka_unit_test_teardown(it_wants_one_setpoint_and_one_measurement_for_each_output, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
