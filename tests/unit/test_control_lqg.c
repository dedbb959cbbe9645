/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apccontrol.h"

#include <string.h>

#define MAX_N    8
#define MAX_IO   2
#define H        0.1
#define CONSTANT 512

enum { U_MIN, U_MAX, TAU_B, PARAMS };

static const struct apc_law *const lqg = &apc_law_lqg;

/* A linear plant about an operating point, and the law on it. */
struct rig {
    struct apc_law_plant plant;
    double Ad[MAX_N * MAX_N], Bd[MAX_N * MAX_IO]; /* sampled */
    double xp[MAX_N];                             /* the plant's state, from the operating point */
    double load[MAX_IO];                          /* adds to u, unknown to the law */
    double y[MAX_IO], z[MAX_IO], u[MAX_IO], x[2 * MAX_N], tuning[PARAMS * MAX_IO], constant[CONSTANT];
    unsigned limited[MAX_IO];
    struct apc_law_call c;
};

/* A mass under a force, its position measured; the operating point is not zero. */
static const double mass_A[4] = {0, 1, 0, 0}, mass_B[2] = {0, 1}, mass_C[2] = {1, 0}, zeros[MAX_N] = {0};
static const double mass_u0 = 3.0, mass_y0 = 10.0;
static const struct apc_law_plant mass = {
    .nx = 2, .A = mass_A, .B = mass_B, .C = mass_C, .D = zeros, .x0 = zeros, .u0 = &mass_u0, .y0 = &mass_y0};

static int configure(struct rig *r, const struct apc_law_plant *plant, struct apc_dim dim,
                     const struct apc_setting *setting, size_t n, struct apc_error *why)
{
    const struct apc_law_setup setup = {
        .dim = dim, .Ts = H, .n_setting = n, .setting = setting, .plant = plant};
    struct apc_law_size size = {0, 0};
    int rc = lqg->configure(&setup, &size, NULL, why);

    if (rc < 0)
        return rc;
    assert_in_range(size.constants, 1, CONSTANT);
    assert_in_range(size.states, 1, 2 * MAX_N);
    return lqg->configure(&setup, &size, r->constant, why);
}

static void measure(struct rig *r)
{
    for (size_t i = 0; i < r->c.dim.ny; i++) {
        r->y[i] = r->plant.y0[i];
        for (size_t j = 0; j < r->plant.nx; j++)
            r->y[i] += r->plant.C[i * r->plant.nx + j] * r->xp[j];
    }
}

static void make(struct rig *r, const struct apc_law_plant *plant, size_t nu,
                 const struct apc_setting *setting, size_t n)
{
    struct apc_error why = {""};

    memset(r, 0, sizeof(*r));
    r->plant = *plant;
    assert_int_equal(apc_linear_sample(plant->nx, nu, plant->A, plant->B, H, r->Ad, r->Bd, NULL), 0);
    r->c = (struct apc_law_call){.dim = {nu, nu, nu},
                                 .Ts = H,
                                 .y = r->y,
                                 .z = r->z,
                                 .u = r->u,
                                 .x = r->x,
                                 .tuning = r->tuning,
                                 .constant = r->constant,
                                 .limited = r->limited};
    if (configure(r, plant, r->c.dim, setting, n, &why) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < nu * PARAMS; i++)
        r->tuning[i] = lqg->tuning[i % PARAMS].initial;
    memcpy(r->z, plant->y0, nu * sizeof(*r->z));
    measure(r);
    lqg->reset(&r->c);
}

static void advance(struct rig *r)
{
    size_t nx = r->plant.nx, nu = r->c.dim.nu;
    double next[MAX_N];

    for (size_t i = 0; i < nx; i++) {
        next[i] = 0.0;
        for (size_t j = 0; j < nx; j++)
            next[i] += r->Ad[i * nx + j] * r->xp[j];
        for (size_t j = 0; j < nu; j++)
            next[i] += r->Bd[i * nu + j] * (r->u[j] - r->plant.u0[j] + r->load[j]);
    }
    memcpy(r->xp, next, sizeof(next));
    measure(r);
}

static double tick(struct rig *r)
{
    double u;

    memset(r->limited, 0, sizeof(r->limited));
    lqg->compute(&r->c);
    u = r->u[0];
    lqg->update(&r->c);
    advance(r);
    return u;
}

static void at_its_operating_point_it_rests(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    for (int k = 0; k < 100; k++)
        assert_near(tick(&r), mass_u0, 1e-12);
    assert_near(r.y[0], mass_y0, 1e-12);
}

static void it_reaches_setpoints_without_offset_in_spite_of_a_load(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.z[0] = 11.0;
    r.load[0] = -2.0;
    for (int k = 0; k < 600; k++)
        tick(&r);
    assert_near(r.y[0], 11.0, 1e-9);
    assert_near(r.u[0], mass_u0 + 2.0, 1e-9);
    assert_near(r.x[2], -2.0, 1e-9); /* the estimate of the load */
}

/* Two coupled lags with gains that nearly hide one direction. */
static void two_outputs_are_controlled_together_without_offset(void **state)
{
    const double A[4] = {-1, 0.2, 0.1, -0.5}, B[4] = {1, 0.8, 0.7, 0.6}, C[4] = {1, 0, 0, 1};
    const double u0[2] = {5, 6}, y0[2] = {1, 2};
    const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = B, .C = C, .D = zeros, .x0 = zeros, .u0 = u0, .y0 = y0};
    struct rig r;

    (void)state;
    make(&r, &plant, 2, NULL, 0);
    r.z[0] = 1.5;
    r.z[1] = 1.0;
    r.load[0] = 0.3;
    r.load[1] = -0.4;
    for (int k = 0; k < 2000; k++)
        tick(&r);
    assert_near(r.y[0], 1.5, 1e-6);
    assert_near(r.y[1], 1.0, 1e-6);
}

/* A plant whose time constant is not the model's: the disturbance estimate takes the difference. */
static void an_error_of_the_model_leaves_no_offset(void **state)
{
    const double A = -1.0, B = 2.0, C = 1.0, other_B = 1.2;
    struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &B, .C = &C, .D = zeros, .x0 = zeros, .u0 = zeros, .y0 = zeros};
    struct rig r;

    (void)state;
    make(&r, &plant, 1, NULL, 0);
    assert_int_equal(apc_linear_sample(1, 1, &A, &other_B, H, r.Ad, r.Bd, NULL), 0);
    r.z[0] = 1.0;
    for (int k = 0; k < 500; k++)
        tick(&r);
    assert_near(r.y[0], 1.0, 1e-9);
}

static void weights_decide_how_hard_it_acts(void **state)
{
    double first[2], dev[2] = {10.0, 0.1};

    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct apc_setting setting = {"u_dev", 1, &dev[1 - i]};
        struct rig r;

        make(&r, &mass, 1, &setting, 1);
        r.z[0] = 11.0;
        first[i] = tick(&r) - mass_u0;
    }
    assert_true(first[0] > 0.0 && first[1] > 10.0 * first[0]);
}

static void nothing_winds_up_while_the_output_is_at_its_limit(void **state)
{
    struct rig r;
    double peak = 0.0;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.tuning[U_MIN] = mass_u0 - 0.5;
    r.tuning[U_MAX] = mass_u0 + 0.5;
    r.load[0] = -0.6; /* stronger than it: the mass runs away */
    r.z[0] = 10.0;
    for (int k = 0; k < 200; k++)
        tick(&r);
    assert_near(r.u[0], mass_u0 + 0.5, 0.0);
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    r.load[0] = 0.0;
    r.tuning[U_MIN] = mass_u0 - 500.0;
    r.tuning[U_MAX] = mass_u0 + 500.0;
    for (int k = 0; k < 600; k++) {
        tick(&r);
        peak = fmax(peak, r.y[0] - 10.0);
    }
    assert_near(r.y[0], 10.0, 1e-6);
    assert_true(peak < 40.0); /* it had fallen 120 below with speed -2 */
}

static void after_track_it_gives_the_tracked_output_which_dies_out_with_tau_b(void **state)
{
    (void)state;
    for (int gap = 0; gap <= 1; gap++) {
        struct rig r;

        make(&r, &mass, 1, NULL, 0);
        r.tuning[TAU_B] = 2.0;
        r.y[0] = 12.0;
        r.z[0] = 9.0;
        r.u[0] = 7.5;
        r.c.gap = gap != 0;
        lqg->track(&r.c);
        r.u[0] = 0.0;
        lqg->compute(&r.c);
        assert_near(r.u[0], 7.5, 1e-12);
        r.xp[0] = 2.0;
        for (int k = 0; k < 1000; k++)
            tick(&r);
        assert_near(r.y[0], 9.0, 1e-9);
    }
}

/* In mode Man the observer goes on with the operator's output: the load is known when Auto comes. */
static void in_man_the_estimates_follow_the_plant(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.load[0] = 1.25;
    for (int k = 0; k < 300; k++) {
        r.u[0] = mass_u0 - 1.25 - 0.05 * sin(0.1 * k);
        lqg->track(&r.c);
        lqg->update(&r.c);
        advance(&r);
    }
    assert_near(r.x[2], 1.25, 1e-3);
}

/* An unstable plant whose input acts nearly a period late. */
static void a_known_delay_is_allowed_for(void **state)
{
    const double A = 6.0, B = 1.0, C = 1.0, delay = 0.08;
    const struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &B, .C = &C, .D = zeros, .x0 = zeros, .u0 = zeros, .y0 = zeros};
    const double quick = 1e-3, sure = 1e-3;
    const struct apc_setting setting[] = {{"y_dev", 1, &quick}, {"y_noise", 1, &sure}, {"delay", 1, &delay}};
    double early_A, early_B, late_A, late_B;

    (void)state;
    assert_int_equal(apc_linear_sample(1, 1, &A, &B, delay, &early_A, &early_B, NULL), 0);
    assert_int_equal(apc_linear_sample(1, 1, &A, &B, H - delay, &late_A, &late_B, NULL), 0);
    for (int told = 0; told <= 1; told++) {
        const double load = 0.3;
        struct rig r;
        double x = 0.01, last = load;

        make(&r, &plant, 1, setting, told ? 3 : 2);
        r.z[0] = 0.05;
        for (int k = 0; k < 400 && fabs(x) < 1e6; k++) {
            r.y[0] = x;
            lqg->compute(&r.c);
            lqg->update(&r.c);
            x = late_A * (early_A * x + early_B * last) + late_B * (r.u[0] + load);
            last = r.u[0] + load;
        }
        if (!told) {
            assert_true(fabs(x) >= 1e6);
            continue;
        }
        assert_near(x, 0.05, 1e-9);
        assert_near(r.x[1], last - load, 1e-9); /* the estimates: of the output before, */
        assert_near(r.x[2], load, 1e-9);        /* and of the load */
        r.u[0] = 0.7;
        r.c.gap = true;
        lqg->track(&r.c);
        assert_near(r.x[0], x, 1e-6); /* of the state, from y alone */
        assert_near(r.x[1], 0.7, 0.0);
        assert_near(r.x[2], load, 1e-9);
    }
}

static void what_it_cannot_be_made_from_is_refused_with_the_reason(void **state)
{
    const double nothing = 0.0, late = H, one = 1.0, second = 2.0;
    const struct apc_setting noise = {"u_noise", 1, &nothing}, delay = {"delay", 1, &late},
                             dev = {"u_dev", 1, &nothing}, wrong = {"x_dev", 1, &one},
                             elsewhere = {"measurement", 1, &second};
    const struct apc_dim siso = {1, 1, 1};
    struct apc_law_plant plant = mass;
    struct apc_error why;
    struct rig r;

    (void)state;
    assert_int_equal(configure(&r, NULL, siso, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "linear model"));
    assert_int_equal(configure(&r, &mass, (struct apc_dim){1, 2, 1}, NULL, 0, &why), APC_EINVAL);
    assert_int_equal(configure(&r, &mass, siso, &noise, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "u_noise"));
    assert_int_equal(configure(&r, &mass, siso, &dev, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "u_dev"));
    assert_int_equal(configure(&r, &mass, siso, &delay, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "delay"));
    assert_int_equal(configure(&r, &mass, siso, &wrong, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "2 numbers"));
    assert_int_equal(configure(&r, &mass, siso, &elsewhere, 1, &why), APC_EINVAL);
    plant.D = &one;
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_EINVAL);
    plant.D = zeros;
    plant.C = (const double[]){0, 1}; /* the speed is measured: the position cannot be kept */
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_ESOLVER);
    plant.C = mass_C;
    plant.B = zeros; /* the force does nothing */
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_ESOLVER);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(at_its_operating_point_it_rests),
        cmocka_unit_test(it_reaches_setpoints_without_offset_in_spite_of_a_load),
        cmocka_unit_test(two_outputs_are_controlled_together_without_offset),
        cmocka_unit_test(an_error_of_the_model_leaves_no_offset),
        cmocka_unit_test(weights_decide_how_hard_it_acts),
        cmocka_unit_test(nothing_winds_up_while_the_output_is_at_its_limit),
        cmocka_unit_test(after_track_it_gives_the_tracked_output_which_dies_out_with_tau_b),
        cmocka_unit_test(in_man_the_estimates_follow_the_plant),
        cmocka_unit_test(a_known_delay_is_allowed_for),
        cmocka_unit_test(what_it_cannot_be_made_from_is_refused_with_the_reason),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
