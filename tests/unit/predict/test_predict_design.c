/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apclinear.h"

#include <string.h>

/* ---- Sampling ----------------------------------------------------------------------------------- */

static void a_sampled_first_order_model_is_the_known_one(void **state)
{
    const double a = -0.1, b = 1.0;
    double ad, bd;

    (void)state;
    assert_int_equal(apc_linear_sample(1, 1, &a, &b, 2.0, &ad, &bd, NULL), 0);
    assert_near(ad, exp(-0.2), 1e-15);
    assert_near(bd, (1.0 - exp(-0.2)) / 0.1, 1e-14);
}

static void an_integrator_and_an_oscillator_are_sampled_exactly(void **state)
{
    const double integrator[4] = {0, 1, 0, 0}, oscillator[4] = {0, 5, -5, 0}, b[2] = {0, 1};
    double ad[4], bd[2];

    (void)state;
    assert_int_equal(apc_linear_sample(2, 1, integrator, b, 3.0, ad, bd, NULL), 0);
    assert_near(ad[1], 3.0, 1e-14);
    assert_near(bd[0], 4.5, 1e-14);
    assert_near(bd[1], 3.0, 1e-14);
    assert_int_equal(apc_linear_sample(2, 1, oscillator, b, 7.0, ad, bd, NULL), 0);
    assert_near(ad[0], cos(35.0), 1e-12);
    assert_near(ad[1], sin(35.0), 1e-12);
    assert_near(bd[0], (1.0 - cos(35.0)) / 5.0, 1e-12);
}

/* Modes nine decades apart, as a fast sensor on a slow tank. */
static void fast_modes_do_not_spoil_slow_ones(void **state)
{
    const double a[4] = {-1e-4, 0, 0, -1e5}, b[2] = {1, 1};
    double ad[4], bd[2];

    (void)state;
    assert_int_equal(apc_linear_sample(2, 1, a, b, 1.0, ad, bd, NULL), 0);
    assert_near(ad[0], exp(-1e-4), 1e-9);
    assert_near(ad[3], 0.0, 1e-12);
    assert_near(bd[1], 1e-5, 1e-14);
}

static void a_model_with_a_number_that_is_none_is_refused(void **state)
{
    const double a = (double)NAN, b = 1.0;
    double ad, bd;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_linear_sample(1, 1, &a, &b, 1.0, &ad, &bd, &why), APC_EINVAL);
    assert_true(why.text[0] != '\0');
}

/* ---- The Riccati equation -------------------------------------------------------------------------- */

/* p = a^2 p r / (r + b^2 p) + q, whose positive root is known. */
static void a_scalar_equation_has_its_known_solution(void **state)
{
    const double cases[][4] = {
        {0.5, 1, 1, 1}, {2, 1, 1, 1}, {1.1, 0.1, 3, 0.01}, {-3, 2, 1e-4, 10}, {1, 1, 1, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const double a = cases[i][0], b = cases[i][1], q = cases[i][2], r = cases[i][3];
        const double half = (r * (1.0 - a * a) - b * b * q) / 2.0;
        const double p = (sqrt(half * half + b * b * q * r) - half) / (b * b);
        double P, K;

        assert_int_equal(apc_riccati_solve(1, 1, &a, &b, &q, &r, &P, &K, NULL), 0);
        assert_near(P / p, 1.0, 1e-12);
        assert_near(K, a * b * p / (r + b * b * p), 1e-12);
    }
}

/* Does P solve the equation, to a share of its greatest element? */
static void residual(size_t n, size_t m, const double *A, const double *B, const double *Q, const double *P,
                     const double *K, double tolerance)
{
    double F[64], PF[64], scale = 0.0;

    for (size_t i = 0; i < n * n; i++)
        scale = fmax(scale, fabs(P[i]));
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            F[i * n + j] = A[i * n + j];
            for (size_t k = 0; k < m; k++)
                F[i * n + j] -= B[i * m + k] * K[k * n + j];
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            PF[i * n + j] = 0.0;
            for (size_t k = 0; k < n; k++)
                PF[i * n + j] += P[i * n + k] * F[k * n + j];
        }
    }
    for (size_t i = 0; i < n; i++) { /* P = A' P (A - B K) + Q */
        for (size_t j = 0; j < n; j++) {
            double sum = Q[i * n + j];

            for (size_t k = 0; k < n; k++)
                sum += A[k * n + i] * PF[k * n + j];
            assert_near(sum / scale, P[i * n + j] / scale, tolerance);
            assert_near(P[i * n + j] / scale, P[j * n + i] / scale, 1e-15);
        }
    }
}

static void an_unstable_system_with_two_inputs_is_solved(void **state)
{
    const double A[9] = {1.2, 0.3, 0, -0.1, 0.9, 0.5, 0, 0, 1.5}, B[6] = {1, 0, 0, 0.2, 0, 1};
    const double Q[9] = {1, 0, 0, 0, 2, 0, 0, 0, 0.5}, R[4] = {0.1, 0.02, 0.02, 0.3};
    double P[9], K[6];

    (void)state;
    assert_int_equal(apc_riccati_solve(3, 2, A, B, Q, R, P, K, NULL), 0);
    residual(3, 2, A, B, Q, P, K, 1e-12);
}

/* Weight only on an output, slow and fast modes, units that differ by 1e6. */
static void a_badly_scaled_system_is_solved(void **state)
{
    const double A[9] = {0.999999, 1e-6, 0, 0, 0.9, 10, 0, 0, 0.001}, B[3] = {0, 0, 1e3};
    const double Q[9] = {1e6, 0, 0, 0, 0, 0, 0, 0, 0}, R = 1e-3;
    double P[9], K[3];

    (void)state;
    assert_int_equal(apc_riccati_solve(3, 1, A, B, Q, &R, P, K, NULL), 0);
    residual(3, 1, A, B, Q, P, K, 1e-9);
}

static double next_random(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return 2.0 * *seed / 4294967295.0 - 1.0;
}

/* Most of them unstable, weights over six decades: some are as hard as they come. */
static void whatever_can_be_stabilised_is_solved(void **state)
{
    uint32_t seed = 1;

    (void)state;
    for (int trial = 0; trial < 500; trial++) {
        const size_t n = 1 + (size_t)trial % 8, m = 1 + (size_t)trial % 3;
        double A[64], B[24], Q[64] = {0}, R[9] = {0}, P[64], K[24];

        for (size_t i = 0; i < n * n; i++)
            A[i] = 1.2 * next_random(&seed);
        for (size_t i = 0; i < n * m; i++)
            B[i] = next_random(&seed);
        for (size_t i = 0; i < n; i++)
            Q[i * n + i] = pow(10.0, 3.0 * next_random(&seed));
        for (size_t i = 0; i < m; i++)
            R[i * m + i] = pow(10.0, 3.0 * next_random(&seed));
        assert_int_equal(apc_riccati_solve(n, m, A, B, Q, R, P, K, NULL), 0);
        residual(n, m, A, B, Q, P, K, 1e-6);
    }
}

static void what_cannot_be_stabilised_is_an_error_with_a_reason(void **state)
{
    const double A[4] = {1.5, 0, 0, 0.5}, unreached[2] = {0, 1}, Q[4] = {1, 0, 0, 1}, R = 1.0, none = 0.0;
    double P[4], K[2];
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_riccati_solve(2, 1, A, unreached, Q, &R, P, K, &why), APC_ESOLVER);
    assert_non_null(strstr(why.text, "not reached"));
    assert_int_equal(apc_riccati_solve(2, 1, A, unreached, Q, &none, P, K, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "R must be"));
}

static void an_unstable_mode_without_a_weight_is_an_error(void **state)
{
    const double A[4] = {1.5, 0, 0, 0.5}, B[2] = {1, 1}, Q[4] = {0, 0, 0, 1}, R = 1.0;
    double P[4], K[2];

    (void)state;
    assert_int_equal(apc_riccati_solve(2, 1, A, B, Q, &R, P, K, NULL), APC_ESOLVER);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sampled_first_order_model_is_the_known_one),
        cmocka_unit_test(an_integrator_and_an_oscillator_are_sampled_exactly),
        cmocka_unit_test(fast_modes_do_not_spoil_slow_ones),
        cmocka_unit_test(a_model_with_a_number_that_is_none_is_refused),
        cmocka_unit_test(a_scalar_equation_has_its_known_solution),
        cmocka_unit_test(an_unstable_system_with_two_inputs_is_solved),
        cmocka_unit_test(a_badly_scaled_system_is_solved),
        cmocka_unit_test(whatever_can_be_stabilised_is_solved),
        cmocka_unit_test(what_cannot_be_stabilised_is_an_error_with_a_reason),
        cmocka_unit_test(an_unstable_mode_without_a_weight_is_an_error),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
