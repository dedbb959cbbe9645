/* SPDX-License-Identifier: BSD-3-Clause */
#include "laws.h"

#include <string.h>

enum { KP, TAU_I, TAU_D, N, B, C, TAU_T, U_BAR, U_MIN, U_MAX, DU_MAX, LOOP };
enum { OUTER, INNER = LOOP, PARAMS = 2 * LOOP, STATES = 12 };
#define H 0.1

static const struct apc_law *const cascade = &apc_law_cascade;

/* y[1]' = (-y[1] + u + load) / 0.5, y[0]' = (-y[0] + y[1]) / 5, by the law's period. */
struct rig {
    double y[4], z[2], u[2], x[2 * STATES], tuning[2 * PARAMS], load;
    unsigned limited[2];
    struct apc_instances *law;
    struct apc_law_call c;
};

static int configure(struct rig *r, struct apc_dim dim, const struct apc_setting *setting, size_t n,
                     struct apc_error *why)
{
    const struct apc_law_setup setup = {.dim = dim, .Ts = H, .n_setting = n, .setting = setting};
    int rc = laws_make(&r->law, cascade, &setup, why);

    if (rc == 0)
        assert_int_equal(apc_instances_size(r->law).states, STATES * dim.nu);
    return rc;
}

static void make(struct rig *r)
{
    memset(r, 0, sizeof(*r));
    r->c = (struct apc_law_call){.dim = {2, 1, 1, 0},
                                 .Ts = H,
                                 .y = r->y,
                                 .z = r->z,
                                 .u = r->u,
                                 .x = r->x,
                                 .tuning = r->tuning,
                                 .limited = r->limited};
    for (size_t i = 0; i < 2 * PARAMS; i++)
        r->tuning[i] = cascade->tuning[i % PARAMS].initial;
    r->tuning[OUTER + KP] = 3.0;
    r->tuning[OUTER + TAU_I] = 5.0;
    r->tuning[INNER + KP] = 2.0;
    r->tuning[INNER + TAU_I] = 0.5;
    assert_int_equal(configure(r, r->c.dim, NULL, 0, NULL), 0);
    laws_reset(r->law, &r->c);
}

static double tick(struct rig *r)
{
    double a = exp(-H / 0.5), b = exp(-H / 5.0), u;

    memset(r->limited, 0, sizeof(r->limited));
    laws_compute(r->law, &r->c);
    u = r->u[0];
    laws_update(r->law, &r->c);
    r->y[0] = b * r->y[0] + (1.0 - b) * r->y[1];
    r->y[1] = a * r->y[1] + (1.0 - a) * (u + r->load);
    return u;
}

static void the_outer_loop_reaches_its_setpoint_through_the_inner_one(void **state)
{
    struct rig r;

    (void)state;
    make(&r);
    r.z[0] = 2.0;
    r.load = -0.7;
    for (int k = 0; k < 1000; k++)
        tick(&r);
    assert_near(r.y[0], 2.0, 1e-9);
    assert_near(r.y[1], 2.0, 1e-9);
    assert_near(r.u[0], 2.7, 1e-9);
}

/* The first output by hand: outer P, limited, into inner P. */
/* Promise(laws/cascade): `cascade`: limits of the inner setpoint, no windup, at rest after Man, pairs. */
static void the_inner_setpoint_is_the_outer_output_within_its_limits(void **state)
{
    struct rig r;

    (void)state;
    make(&r);
    r.z[0] = 4.0;
    r.y[1] = 0.5;
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], 2.0 * (3.0 * 4.0 - 0.5), 1e-12);
    r.tuning[OUTER + U_MAX] = 5.0;
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], 2.0 * (5.0 - 0.5), 1e-12);
}

/* A load on the inner loop hardly reaches the outer measurement; without the inner loop it does. */
static void the_inner_loop_takes_disturbances_before_they_reach_the_outer_one(void **state)
{
    struct rig r;
    double worst = 0.0;

    (void)state;
    make(&r);
    r.load = 1.0;
    for (int k = 0; k < 300; k++) {
        tick(&r);
        worst = fmax(worst, fabs(r.y[0]));
    }
    assert_true(worst > 0.0 && worst < 0.06);
}

/* Promise(laws/cascade) */
static void neither_integral_winds_up_while_the_output_is_cut(void **state)
{
    struct rig r;
    double before, peak = 0.0;

    (void)state;
    make(&r);
    r.tuning[INNER + U_MAX] = 1.0;
    r.z[0] = 2.0; /* out of reach: u ends at 1, and so does y */
    for (int k = 0; k < 200; k++)
        tick(&r);
    before = r.x[0];
    for (int k = 0; k < 2000; k++)
        assert_near(tick(&r), 1.0, 0.0);
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    assert_near(r.x[0], before, 0.0);
    r.z[0] = 0.5;
    for (int k = 0; k < 600; k++) {
        tick(&r);
        peak = fmax(peak, 0.5 - r.y[0]);
    }
    assert_near(r.y[0], 0.5, 1e-3);
    assert_true(peak < 0.3);
}

/* The same with the smallest errors: both integrals stand still at the limit, and go back from it. */
static void at_the_limit_neither_integral_takes_the_smallest_step_outwards(void **state)
{
    (void)state;
    for (double gain = -2.0; gain <= 2.0; gain += 2.0) {
        for (double error = 1e-6; error < 10.0; error *= 10.0) {
            const double to =
                gain < 0.0 ? -1.0 : 1.0; /* the outer loop pushes to where the inner one opens */
            struct rig r;

            make(&r);
            r.tuning[INNER + KP] = gain;
            r.tuning[INNER + U_BAR] = 1.0;
            r.tuning[INNER + U_MAX] = 1.0 - error;
            r.z[0] = to * error;
            laws_reset(r.law, &r.c);
            for (int away = 0; away <= 1; away++) {
                const double before[] = {r.x[0], r.x[STATES / 2]};
                bool outwards;

                r.z[0] = (away ? -1e-3 : 1.0) * to * error;
                laws_compute(r.law, &r.c);
                assert_near(r.u[0], 1.0 - error, 0.0);
                laws_update(r.law, &r.c);
                outwards = !away && gain != 0.0; /* an inner loop without gain is in nobody's way */
                assert_int_equal(r.x[0] == before[0], outwards);
                if (!away)
                    assert_near(r.x[STATES / 2], before[1], 0.0);
            }
        }
    }
}

/* Every pair: the outer output where the inner measurement is, and so the inner one at u_bar. */
static void at_rest_every_pair_begins_with_its_u_bar(void **state)
{
    const struct apc_dim dim = {4, 2, 2, 0};
    struct rig r;

    (void)state;
    make(&r);
    r.c.dim = dim;
    assert_int_equal(configure(&r, dim, NULL, 0, NULL), 0);
    for (int i = 0; i < 2; i++) {
        double *p = r.tuning + i * PARAMS;

        r.y[i] = r.z[i] = 10.0 + i;  /* outer */
        r.y[2 + i] = 100.0 + 10 * i; /* inner */
        p[OUTER + KP] = 3.0;
        p[OUTER + TAU_I] = p[INNER + TAU_I] = 5.0;
        p[OUTER + B] = p[INNER + B] = 0.5;
        p[OUTER + TAU_D] = p[INNER + TAU_D] = 2.0;
        p[OUTER + C] = p[INNER + C] = 1.0;
        p[OUTER + U_BAR] = r.y[2 + i];
        p[INNER + U_BAR] = 1000.0 + i;
    }
    laws_reset(r.law, &r.c);
    for (int k = 0; k < 3; k++) {
        laws_compute(r.law, &r.c);
        assert_near(r.u[0], 1000.0, 1e-9);
        assert_near(r.u[1], 1001.0, 1e-9);
        laws_update(r.law, &r.c);
    }
}

/* Promise(laws/cascade) */
static void after_track_it_gives_the_tracked_output_and_the_inner_loop_is_at_rest(void **state)
{
    (void)state;
    for (int gap = 0; gap <= 1; gap++) {
        struct rig r;

        make(&r);
        r.z[0] = 2.0;
        tick(&r);
        r.y[0] = 1.0;
        r.y[1] = 7.0;
        r.u[0] = -3.0;
        r.c.gap = gap != 0;
        laws_track(r.law, &r.c);
        r.u[0] = 0.0;
        laws_compute(r.law, &r.c);
        assert_near(r.u[0], -3.0, 1e-12);
        assert_near(3.0 * (2.0 - 1.0) + r.x[0], 7.0, 1e-12); /* the inner setpoint is the inner measurement */
    }
}

/* Promise(laws/cascade) */
static void pairs_are_made_at_will(void **state)
{
    const double outer[] = {4.0, 3.0}, inner[] = {1.0, 2.0}, setpoint[] = {2.0, 1.0}, beyond[] = {5.0, 1.0};
    const struct apc_setting good[] = {
        {"outer", NULL, 1, 2, outer}, {"inner", NULL, 1, 2, inner}, {"setpoint", NULL, 1, 2, setpoint}};
    const struct apc_setting bad = {"inner", NULL, 1, 2, beyond};
    const struct apc_dim dim = {4, 2, 2, 0};
    struct apc_error why;
    struct rig r;

    (void)state;
    make(&r);
    r.c.dim = dim;
    for (int i = 0; i < 2; i++) { /* u = z - outer - inner */
        r.tuning[i * PARAMS + OUTER + KP] = r.tuning[i * PARAMS + INNER + KP] = 1.0;
        r.tuning[i * PARAMS + OUTER + TAU_I] = r.tuning[i * PARAMS + INNER + TAU_I] = 0.0;
    }
    r.y[0] = 1.0;
    r.y[1] = 20.0;
    r.y[2] = 300.0;
    r.y[3] = 4000.0;
    r.z[1] = 50000.0;
    assert_int_equal(configure(&r, dim, good, 3, NULL), 0);
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], 50000.0 - 4000.0 - 1.0, 1e-9);
    assert_near(r.u[1], 0.0 - 300.0 - 20.0, 1e-9);
    for (size_t k = 0; k < 2; k++) { /* of others each sees nothing */
        assert_int_equal(apc_instances_ports(r.law, k)->ny, 2);
        assert_int_equal(apc_instances_ports(r.law, k)->nz, 1);
    }
    const struct apc_setting shared = {"inner", NULL, 1, 2, setpoint}; /* each measurement is in both pairs */
    assert_int_equal(configure(&r, (struct apc_dim){2, 2, 2, 0}, &shared, 1, NULL), 0);
    assert_int_equal(configure(&r, dim, &bad, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "inner"));
    for (size_t i = 0; i < 3; i++) {
        const struct apc_dim few[] = {{1, 1, 1, 0}, {2, 1, 3, 0}, {2, 0, 1, 0}};
        const struct apc_law_setup setup = {.dim = few[i], .Ts = 1.0};
        assert_int_equal(laws_make(&r.law, cascade, &setup, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "an outer and an inner measurement and a setpoint for each output"));
    }
    assert_int_equal(configure(&r, (struct apc_dim){3, 2, 2, 0}, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "\"inner\" of output 2 would be 4, but there are 3"));
    assert_int_equal(configure(&r, (struct apc_dim){2, 2, 2, 0}, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "\"inner\" of output 1 would be 3, but there are 2"));
    assert_int_equal(configure(&r, (struct apc_dim){4, 1, 2, 0}, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "\"setpoint\" of output 2 would be 2, but there are 1"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_outer_loop_reaches_its_setpoint_through_the_inner_one, laws_end),
        cmocka_unit_test_teardown(the_inner_setpoint_is_the_outer_output_within_its_limits, laws_end),
        cmocka_unit_test_teardown(the_inner_loop_takes_disturbances_before_they_reach_the_outer_one,
                                  laws_end),
        cmocka_unit_test_teardown(neither_integral_winds_up_while_the_output_is_cut, laws_end),
        cmocka_unit_test_teardown(at_the_limit_neither_integral_takes_the_smallest_step_outwards, laws_end),
        cmocka_unit_test_teardown(at_rest_every_pair_begins_with_its_u_bar, laws_end),
        cmocka_unit_test_teardown(after_track_it_gives_the_tracked_output_and_the_inner_loop_is_at_rest,
                                  laws_end),
        cmocka_unit_test_teardown(pairs_are_made_at_will, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
