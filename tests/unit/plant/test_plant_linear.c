/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apcplant.h"

#include <string.h>

static const struct apc_model *find(const char *name)
{
    const struct apc_model *model = NULL;
    void *handle;

    assert_int_equal(apc_model_find(name, &model, &handle, NULL), 0);
    return model;
}

static void the_pendulum_is_linear_about_upright_as_in_the_books(void **state)
{
    const double M = 0.5, m = 0.2, b = 0.1, l = 0.3, I = 0.006, g = 9.8;
    const double q = I * (M + m) + M * m * l * l;
    const double expected[16] = {0,
                                 1,
                                 0,
                                 0, /* Control Tutorials, state space */
                                 0,
                                 -(I + m * l * l) * b / q,
                                 m * m * g * l * l / q,
                                 0,
                                 0,
                                 0,
                                 0,
                                 1,
                                 0,
                                 -m * l * b / q,
                                 m * g * l * (M + m) / q,
                                 0};
    const double expected_b[4] = {0, (I + m * l * l) / q, 0, m * l / q};
    double A[16], B[8], C[8], D[4];

    (void)state;
    assert_int_equal(apc_model_linearize(find("pendulum"), NULL, NULL, NULL, A, B, C, D, NULL), 0);
    for (size_t i = 0; i < 16; i++)
        assert_near(A[i], expected[i], 1e-9 * fmax(1.0, fabs(expected[i])));
    for (size_t i = 0; i < 4; i++) {
        assert_near(B[2 * i], expected_b[i], 1e-9);
        assert_near(B[2 * i + 1], expected_b[i], 1e-9); /* the push, a disturbance */
        assert_near(D[i], 0.0, 0.0);
    }
    for (size_t i = 0; i < 8; i++)
        assert_near(C[i], i == 0 || i == 6 ? 1.0 : 0.0, 1e-12);
}

/* Johansson: A = diag(-1/Ti) with the coupling of the upper tanks, Ti = Ai/ai sqrt(2 hi/g). */
static void the_quadruple_tank_is_linear_about_its_levels_as_published(void **state)
{
    const double area[] = {28, 32, 28, 32}, outlet[] = {0.071, 0.057, 0.071, 0.057};
    double x[4] = {12.4, 12.7, 1.8, 1.4}, T[4], A[16], B[16];

    (void)state;
    assert_int_equal(apc_model_linearize(find("quadruple-tank"), NULL, x, NULL, A, B, NULL, NULL, NULL), 0);
    for (size_t i = 0; i < 4; i++) {
        T[i] = area[i] / outlet[i] * sqrt(2.0 * x[i] / 981.0);
        assert_near(A[5 * i], -1.0 / T[i], 1e-10);
    }
    assert_near(T[0], 62.0, 1.0); /* published: 62, 90, 23, 30 s */
    assert_near(T[1], 90.0, 1.0);
    assert_near(T[2], 23.0, 1.0);
    assert_near(T[3], 30.0, 1.0);
    assert_near(A[2], area[2] / (area[0] * T[2]), 1e-10);
    assert_near(A[7], area[3] / (area[1] * T[3]), 1e-10);
    assert_near(A[1], 0.0, 0.0);
    assert_near(B[0], 0.70 * 3.33 / 28.0, 1e-9);
    assert_near(B[12], 0.30 * 3.33 / 32.0, 1e-9);
    assert_near(B[2 * 4 + 2], 1.0 / 28.0, 1e-9); /* disturbance d3 into tank 3 */
}

static void a_linear_model_is_found_whatever_the_scale(void **state)
{
    static const double at[] = {0.0, 1e-9, 1.0, -1e6};

    (void)state;
    for (size_t i = 0; i < 4; i++) {
        double A, B, C, D, x = at[i], u = -at[i];

        assert_int_equal(apc_model_linearize(&apc_model_first_order, NULL, &x, &u, &A, &B, &C, &D, NULL), 0);
        assert_near(A, -0.1, 1e-10);
        assert_near(B, 1.0, 1e-9);
        assert_near(C, 1.0, 1e-10);
        assert_near(D, 0.0, 0.0);
    }
}

static void an_integrating_plant_rests_only_where_its_inputs_balance(void **state)
{
    double x[2] = {3.0, 0.0}, off[2] = {0.1, 0.0}, balanced[2] = {0.1, -0.1};
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_equilibrium(find("servo"), NULL, NULL, x, &why), 0);
    assert_near(x[0], 3.0, 0.0); /* any angle will do, so the given one */
    assert_int_equal(apc_model_equilibrium(find("servo"), NULL, off, x, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "singular"));
    assert_near(x[0], 3.0, 0.0);
    assert_int_equal(apc_model_equilibrium(find("servo"), NULL, balanced, x, &why), 0);
}

/* From empty tanks: the Jacobian of sqrt is infinite there; from overfull ones. */
static void a_steady_state_is_found_from_afar(void **state)
{
    double near_empty[4] = {1e-3, 1e-3, 1e-3, 1e-3}, full[4] = {1e6, 1e6, 1e6, 1e6};

    (void)state;
    assert_int_equal(apc_model_equilibrium(find("four-tank"), NULL, NULL, near_empty, NULL), 0);
    assert_int_equal(apc_model_equilibrium(find("four-tank"), NULL, NULL, full, NULL), 0);
    for (size_t i = 0; i < 4; i++)
        assert_near(near_empty[i], full[i], 1e-7);
}

static int nowhere_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[0] * x[0] + 1.0;
    return 0;
}

static int undefined_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)u, (void)p;
    dx[0] = (double)NAN;
    return 0;
}

static void copy_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

/* A root of the thousandth order: each step is a thousandth of the way. */
static int flat_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = pow(x[0], 1001.0);
    return 0;
}

static void a_steady_state_that_is_approached_for_ever_is_given_up(void **state)
{
    const struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "flat", .nx = 1, .nu = 1, .ny = 1, .f = flat_f, .g = copy_g};
    double x = 1.5;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_equilibrium(&m, NULL, NULL, &x, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "flat: no steady state found in 200 steps"));
    assert_near(x, 1.5, 0.0);
}

/* x* = (2, 3) from (1, 1): rows must be exchanged, and the second step needs what the first one left. */
static int crossed_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = 1e-9 * x[0] + x[1] - 3.0 - 2e-9;
    dx[1] = x[0] - u[0];
    dx[2] = x[2] * x[2] * x[2] - x[0] * x[1] * 36.0;
    return 0;
}

static void equations_in_any_order_are_solved(void **state)
{
    const struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "crossed", .nx = 3, .nu = 1, .ny = 1, .f = crossed_f, .g = copy_g};
    double x[3] = {1.0, 1.0, 1.0}, u = 2.0;

    (void)state;
    assert_int_equal(apc_model_equilibrium(&m, NULL, &u, x, NULL), 0);
    assert_near(x[0], 2.0, 1e-12);
    assert_near(x[1], 3.0, 1e-12);
    assert_near(x[2], 6.0, 1e-11);
}

/* A feedthrough that is bent, and a gain that depends on the point: derivatives where they are asked for. */
static int bent_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = sin(x[1]) * u[0];
    dx[1] = x[0] * x[0] * x[0] - u[1];
    return 0;
}

static void bent_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)p;
    y[0] = exp(x[0]) * u[1];
    y[1] = x[1] / u[0];
    y[2] = x[0] * x[1];
}

static void every_derivative_is_taken_at_the_point(void **state)
{
    const struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "bent", .nx = 2, .nu = 1, .nd = 1, .ny = 3, .f = bent_f, .g = bent_g};
    const double x[] = {0.7, -1.2}, u[] = {2.5, 0.3};
    const double a[] = {0.0, cos(-1.2) * 2.5, 3.0 * 0.49, 0.0}, b[] = {sin(-1.2), 0.0, 0.0, -1.0};
    const double c[] = {exp(0.7) * 0.3, 0.0, 0.0, 1.0 / 2.5, -1.2, 0.7};
    const double d[] = {0.0, exp(0.7), 1.2 / (2.5 * 2.5), 0.0, 0.0, 0.0};
    double A[4], B[4], C[6], D[6], only[6];

    (void)state;
    assert_int_equal(apc_model_linearize(&m, NULL, x, u, A, B, C, D, NULL), 0);
    for (size_t i = 0; i < 4; i++) {
        assert_near(A[i], a[i], 1e-10);
        assert_near(B[i], b[i], 1e-10);
    }
    for (size_t i = 0; i < 6; i++) {
        assert_near(C[i], c[i], 1e-10);
        assert_near(D[i], d[i], 1e-10);
    }
    assert_int_equal(apc_model_linearize(&m, NULL, x, u, NULL, NULL, NULL, only, NULL), 0);
    assert_memory_equal(only, D, sizeof(D)); /* any of the four alone */
}

static void infinite_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = y[1] = x[0];
    y[2] = 1.0 / (x[1] - x[1]);
}

static void an_output_that_is_no_number_is_named(void **state)
{
    const struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "odd", .nx = 2, .nu = 2, .ny = 3, .f = bent_f, .g = infinite_g};
    double C[6];
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_linearize(&m, NULL, NULL, NULL, NULL, NULL, C, NULL, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "odd: output 3 is not a finite number"));
}

static int half_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = -x[0];
    dx[1] = (double)INFINITY;
    return x[0] > 1.0;
}

static void a_derivative_that_is_no_number_is_named(void **state)
{
    const struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "half", .nx = 2, .nu = 1, .ny = 1, .f = half_f, .g = copy_g};
    const double beyond[] = {2.0, 0.0}, u[] = {(double)NAN};
    double A[4];
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_linearize(&m, NULL, NULL, NULL, A, NULL, NULL, NULL, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "half: the derivative of state 2 is not a finite number"));
    assert_int_equal(apc_model_linearize(&m, NULL, beyond, NULL, A, NULL, NULL, NULL, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "half: the model is not defined there"));
    assert_int_equal(apc_model_linearize(&m, NULL, u, NULL, A, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "half: state 1 is not a finite number"));
}

static void what_has_no_steady_state_or_no_derivative_is_said_so(void **state)
{
    struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "nowhere", .nx = 1, .nu = 1, .ny = 1, .f = nowhere_f, .g = copy_g};
    double x = 2.0, A, u = (double)INFINITY, slow[] = {10.0, 0.0};
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_equilibrium(&m, NULL, NULL, &x, &why), APC_ESOLVER);
    assert_near(x, 2.0, 0.0);
    assert_non_null(strstr(why.text, "nowhere"));
    m.f = undefined_f;
    assert_int_equal(apc_model_equilibrium(&m, NULL, NULL, &x, &why), APC_ESOLVER);
    assert_int_equal(apc_model_linearize(&m, NULL, &x, NULL, &A, NULL, NULL, NULL, &why), APC_ESOLVER);
    assert_int_equal(apc_model_linearize(&m, NULL, &x, &u, &A, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_model_linearize(NULL, NULL, &x, &u, &A, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_model_equilibrium(&m, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_model_equilibrium(&apc_model_first_order, slow, NULL, &x, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "tau"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_pendulum_is_linear_about_upright_as_in_the_books),
        cmocka_unit_test(the_quadruple_tank_is_linear_about_its_levels_as_published),
        cmocka_unit_test(a_linear_model_is_found_whatever_the_scale),
        cmocka_unit_test(an_integrating_plant_rests_only_where_its_inputs_balance),
        cmocka_unit_test(a_steady_state_is_found_from_afar),
        cmocka_unit_test(a_steady_state_that_is_approached_for_ever_is_given_up),
        cmocka_unit_test(equations_in_any_order_are_solved),
        cmocka_unit_test(every_derivative_is_taken_at_the_point),
        cmocka_unit_test(an_output_that_is_no_number_is_named),
        cmocka_unit_test(a_derivative_that_is_no_number_is_named),
        cmocka_unit_test(what_has_no_steady_state_or_no_derivative_is_said_so),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
