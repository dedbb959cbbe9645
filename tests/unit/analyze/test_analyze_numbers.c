/* SPDX-License-Identifier: BSD-3-Clause */
/* Eigenvalues and equations of matrices whose solutions are known. */
#include <complex.h>
#include <stdlib.h>

#include "check.h"

#include "analyze/analyze_internal.h"

#define N 12
#define J ((double complex)I)

static double drawn(void)
{
    return (double)rand() / RAND_MAX * 2.0 - 1.0; // NOLINT
}

static void draw(size_t n, double complex *A)
{
    for (size_t i = 0; i < n; i++)
        A[i] = apc_complex(drawn(), drawn());
}

/* Each of those that should be there is there, once. */
static void assert_same(size_t n, const double complex *should, double complex *is, double within)
{
    for (size_t i = 0; i < n; i++) {
        size_t best = 0;

        for (size_t j = 0; j < n; j++)
            best = cabs(is[j] - should[i]) < cabs(is[best] - should[i]) ? j : best;
        if (!(cabs(is[best] - should[i]) < within))
            fail_msg("no %g %+gi among %zu eigenvalues", creal(should[i]), cimag(should[i]), n);
        is[best] = HUGE_VAL;
    }
}

/* T diag(should) T^-1, rows and columns then scaled by powers of @p ratio. */
static void similar(size_t n, const double complex *should, double ratio, double complex *A)
{
    double complex T[N * N], turned[N * N], X[N * N];

    draw(n * n, T);
    for (size_t i = 0; i < n * n; i++)
        T[i] += i % (n + 1) == 0 ? 3.0 : 0.0;
    /* A T = T D, so T' A' = (T D)' */
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            turned[j * n + i] = T[i * n + j];
            X[j * n + i] = T[i * n + j] * should[j];
        }
    }
    assert_int_equal(complex_solve(n, n, turned, X), 0);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            A[i * n + j] = X[j * n + i] * pow(ratio, (double)i - (double)j);
    }
}

static void eigenvalues_are_those_that_the_matrix_was_made_with(void **state)
{
    (void)state;
    srand(5);
    for (int k = 0; k < 200; k++) {
        const size_t n = 1 + (size_t)k % N;
        double complex should[N], is[N], A[N * N];

        draw(n, should);
        similar(n, should, k % 3 == 2 ? 100.0 : 1.0, A);
        assert_int_equal(eigenvalues(n, A, is), 0);
        assert_same(n, should, is, 1e-9);
    }
}

static void eigenvalues_of_what_needs_no_search_or_a_long_one(void **state)
{
    double complex triangle[9] = {1.0, 5.0, 7.0, 0.0, 2.0, 9.0, 0.0, 0.0, 3.0};
    double complex shift[16] = {[1] = 1.0, [6] = 1.0, [11] = 1.0};            /* nilpotent */
    double complex ring[16] = {[1] = 1.0, [6] = 1.0, [11] = 1.0, [12] = 1.0}; /* roots of 1 */
    double complex turn[4] = {0.6, 0.8, -0.8, 0.6}, nothing[4] = {0.0};
    double complex far[4] = {1.0, 1e9, 1e-9, 2.0};
    double complex is[4];
    (void)state;

    assert_int_equal(eigenvalues(3, triangle, is), 0);
    assert_same(3, (const double complex[]){1.0, 2.0, 3.0}, is, 1e-14);
    assert_int_equal(eigenvalues(4, shift, is), 0);
    assert_same(4, (const double complex[]){0.0, 0.0, 0.0, 0.0}, is, 1e-14);
    assert_int_equal(eigenvalues(4, ring, is), 0);
    assert_same(4, (const double complex[]){1.0, J, -1.0, -J}, is, 1e-12);
    assert_int_equal(eigenvalues(2, turn, is), 0);
    assert_same(2, (const double complex[]){0.6 + 0.8 * J, 0.6 - 0.8 * J}, is, 1e-14);
    assert_int_equal(eigenvalues(2, nothing, is), 0);
    assert_same(2, (const double complex[]){0.0, 0.0}, is, 1e-300);
    assert_int_equal(eigenvalues(2, far, is), 0); /* z^2 - 3 z + 1 */
    assert_same(2, (const double complex[]){(3.0 + sqrt(5.0)) / 2.0, (3.0 - sqrt(5.0)) / 2.0}, is, 1e-13);
    turn[2] = (double)NAN;
    assert_int_equal(eigenvalues(2, turn, is), APC_ESOLVER);
    turn[2] = HUGE_VAL;
    assert_int_equal(eigenvalues(2, turn, is), APC_ESOLVER);
}

static void equations_are_solved_or_singular(void **state)
{
    double complex A[N * N], B[N * 3], X[N * 3], keep[N * N];
    (void)state;

    srand(6);
    for (int k = 0; k < 100; k++) {
        const size_t n = 1 + (size_t)k % N, m = 1 + (size_t)k % 3;

        draw(n * n, A);
        draw(n * m, X);
        if (k % 2) /* a pivot has to be looked for */
            A[0] = 0.0;
        if (n == 1)
            A[0] = 0.5 * J;
        memcpy(keep, A, sizeof keep);
        for (size_t i = 0; i < n * m; i++) {
            B[i] = 0.0;
            for (size_t j = 0; j < n; j++)
                B[i] += A[i / m * n + j] * X[j * m + i % m];
        }
        assert_int_equal(complex_solve(n, m, A, B), 0);
        for (size_t i = 0; i < n * m; i++)
            assert_true(cabs(B[i] - X[i]) < 1e-9);
        for (size_t i = 0; i < n && n > 1; i++) /* one column is another's double */
            keep[i * n + n - 1] = 2.0 * keep[i * n];
        if (n == 1)
            keep[0] = 0.0;
        if (n <= 2)
            assert_true(complex_solve(n, m, keep, B));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(eigenvalues_are_those_that_the_matrix_was_made_with),
        cmocka_unit_test(eigenvalues_of_what_needs_no_search_or_a_long_one),
        cmocka_unit_test(equations_are_solved_or_singular),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
