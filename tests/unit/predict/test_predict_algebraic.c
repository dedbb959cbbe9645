/* SPDX-License-Identifier: BSD-3-Clause */
/* Nonlinear prediction and estimation by a model with algebraic equations: the same as by the model that is left when
 * these are solved by hand. */
#include "check.h"
#include "plant/plant_internal.h"
#include "predict/nested.h"
#include "predict/shooting.h"

#include "apcestimate.h"

#include <string.h>

enum { N = 8, NX = 2 };

/* x1' = u - sqrt(x1), x2' = z - x2 with z^2 = x1 + u; y1 = x2, y2 = z. */
static int by_hand_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = u[0] - sqrt(x[0]);
    dx[1] = sqrt(x[0] + u[0]) - x[1];
    return 0;
}

static void by_hand_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)p;
    y[0] = x[1];
    y[1] = sqrt(x[0] + u[0]);
}

static int implicit_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = u[0] - sqrt(x[0]);
    dx[1] = x[2] - x[1];
    return 0;
}

static int implicit_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)p;
    r[0] = x[2] * x[2] - x[0] - u[0];
    return 0;
}

static void implicit_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[1];
    y[1] = x[2];
}

static const struct apc_param positive[] = {{"z", "", "", 0.5, 0.0, 100.0}};
static const struct apc_model by_hand = {.abi = APC_MODEL_ABI,
                                         .name = "by hand",
                                         .nx = NX,
                                         .nu = 1,
                                         .ny = 2,
                                         .f = by_hand_f,
                                         .g = by_hand_g},
                              implicit = {.abi = APC_MODEL_ABI,
                                          .name = "implicit",
                                          .nx = NX,
                                          .nz = 1,
                                          .nu = 1,
                                          .ny = 2,
                                          .f = implicit_f,
                                          .residual = implicit_residual,
                                          .algebraic = positive,
                                          .g = implicit_g};
static const struct apc_model *const both[] = {&by_hand, &implicit};

static void assert_same(const double *a, const double *b, size_t n, double tolerance)
{
    for (size_t i = 0; i < n; i++)
        assert_near(a[i], b[i], tolerance);
}

/* Promise(plants/algebraic-predicted): Nonlinear control and estimation take algebraic equations. */
static void a_horizon_is_the_same(void **state)
{
    static const unsigned block[] = {2, 6};
    const double u0 = 1.0, x0[NX] = {1.2, 1.0}, plan[] = {1.3, 0.8};
    double end[2][NX], nodes[2][N * NX], G[2][N * 2 * 2], free_y[2][N * 2];

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        const struct apc_shooting_options o = {
            .model = both[k], .Ts = 0.5, .steps = 4, .horizon = N, .blocks = 2, .block = block, .u0 = &u0};
        struct apc_shooting *shoot;
        struct apc_error why;

        if (apc_shooting_create(&shoot, &o, &why) < 0)
            fail_msg("%s", why.text);
        memcpy(end[k], x0, sizeof x0);
        for (size_t i = 0; i < N; i++) {
            assert_int_equal(apc_shooting_advance(shoot, end[k], &plan[i >= 2], NULL, 0.5), 0);
            memcpy(nodes[k] + i * NX, end[k], sizeof end[k]);
        }
        assert_int_equal(apc_shooting_linearise(shoot, x0, NULL, plan, NULL, nodes[k], G[k], free_y[k]), 0);
        apc_shooting_destroy(shoot);
    }
    assert_same(nodes[1], nodes[0], sizeof nodes[0] / sizeof(double), 1e-11);
    assert_same(G[1], G[0], sizeof G[0] / sizeof(double), 1e-8);
    assert_same(free_y[1], free_y[0], sizeof free_y[0] / sizeof(double), 1e-8);
}

/* Promise(plants/algebraic-predicted) */
static void an_estimate_is_the_same_and_no_solution_is_told(void **state)
{
    const double q[NX] = {0.01, 0.02}, r[2] = {0.1, 0.05}, x0[NX] = {1.2, 1.0}, none[NX] = {-3.0, 1.0};
    double s[2][NX + NX * (NX + 1) / 2], y[2] = {0.0, 0.0};

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        const struct apc_estimator_options o = {.size = sizeof o,
                                                .kind = APC_KALMAN_EXTENDED,
                                                .model = both[k],
                                                .Ts = 0.5,
                                                .steps = 4,
                                                .q = q,
                                                .r = r};
        struct apc_estimator *e;
        struct apc_error why;

        if (apc_estimator_create(&e, &o, &why) < 0)
            fail_msg("%s", why.text);
        apc_estimator_reset(e, s[k], x0);
        for (int i = 0; i < 20; i++) {
            const double u = 1.0 + 0.3 * sin(i), seen[] = {1.4 + 0.1 * cos(i), 1.5};

            assert_int_equal(apc_estimator_correct(e, s[k], seen, NULL, &u), 2);
            assert_int_equal(apc_estimator_predict(e, s[k], &u), 0);
        }
        if (both[k]->nz) {
            double lost[NX + NX * (NX + 1) / 2];

            apc_estimator_reset(e, lost, none);
            apc_estimator_output(e, lost, &(double){1.0}, y);
            assert_true(isnan(y[0]) && isnan(y[1]));
            assert_int_equal(apc_estimator_predict(e, lost, &(double){1.0}), APC_ESOLVER);
        }
        apc_estimator_destroy(e);
    }
    assert_same(s[1], s[0], sizeof s[0] / sizeof *s[0], 1e-7);
}

static void loops_around_it_are_the_same(void **state)
{
    const struct apc_nested_loop loop = {.there = true, .y = 0, .gain = 0.5, .tau = 3.0};
    const double x[NX + 1] = {1.2, 1.0, 0.9}, setpoint = 1.3;
    double dx[2][NX + 1], y[2][2];

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct apc_nested *nested;

        assert_int_equal(apc_nested_create(&nested, both[k], NULL, &loop, NULL), 0);
        assert_int_equal(apc_nested_slope(nested, x, &setpoint, dx[k]), 0);
        apc_nested_output(nested, x, &setpoint, y[k]);
        apc_nested_destroy(nested);
    }
    assert_same(dx[1], dx[0], NX + 1, 1e-12);
    assert_same(y[1], y[0], 2, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_horizon_is_the_same),
        cmocka_unit_test(an_estimate_is_the_same_and_no_solution_is_told),
        cmocka_unit_test(loops_around_it_are_the_same),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
