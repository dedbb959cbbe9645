/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "base/matrix.h"
#include "base/parts.h"

static void a_product_and_a_transpose_have_their_shapes(void **state)
{
    const double A[6] = {1, 2, 3, 4, 5, 6}, B[3] = {1, 0, -1};
    double C[2], T[6], M[8] = {0};

    (void)state;
    apc_matrix_multiply(2, 3, 1, A, B, C);
    assert_near(C[0], -2.0, 0.0);
    assert_near(C[1], -2.0, 0.0);
    apc_matrix_transpose(2, 3, A, T);
    assert_near(T[1], 4.0, 0.0);
    assert_near(T[4], 3.0, 0.0);
    apc_matrix_put(M, 4, 0, 1, 2, 3, A);
    assert_near(M[0], 0.0, 0.0);
    assert_near(M[1], 1.0, 0.0);
    assert_near(M[7], 6.0, 0.0);
}

/* Hilbert's matrix of order 5, with its right hand side for ones; and rows in units 1e20 apart. */
static void equations_are_solved_whatever_the_units_of_the_rows(void **state)
{
    double A[25], B[5], U[4] = {1e20, 1e20, 1e-20, -1e-20}, V[2] = {3e20, 1e-20};

    (void)state;
    for (int i = 0; i < 5; i++) {
        B[i] = 0.0;
        for (int j = 0; j < 5; j++)
            B[i] += A[i * 5 + j] = 1.0 / (i + j + 1);
    }
    assert_int_equal(apc_matrix_solve(5, 1, A, B), 0);
    for (int i = 0; i < 5; i++)
        assert_near(B[i], 1.0, 1e-10);
    assert_int_equal(apc_matrix_solve(2, 1, U, V), 0);
    assert_near(V[0], 2.0, 1e-14);
    assert_near(V[1], 1.0, 1e-14);
}

static void a_first_pivot_of_zero_is_no_obstacle(void **state)
{
    double A[4] = {0, 2, 1, 0}, B[4] = {6, 2, 5, 1};

    (void)state;
    assert_int_equal(apc_matrix_solve(2, 2, A, B), 0);
    assert_near(B[0], 5.0, 1e-15);
    assert_near(B[1], 1.0, 1e-15);
    assert_near(B[2], 3.0, 1e-15);
    assert_near(B[3], 1.0, 1e-15);
}

static void what_is_singular_or_no_number_is_not_solved(void **state)
{
    double dependent[4] = {1, 2, 0.1, 0.2}, zero[4] = {1, 2, 0, 0}, bad[4] = {1, (double)NAN, 0, 1},
           B[2] = {1, 1};

    (void)state;
    assert_int_not_equal(apc_matrix_solve(2, 1, dependent, B), 0);
    assert_int_not_equal(apc_matrix_solve(2, 1, zero, B), 0);
    assert_int_not_equal(apc_matrix_solve(2, 1, bad, B), 0);
}

/* exp of a nilpotent matrix is a polynomial; of a rotation a rotation, also many times round. */
static void the_exponential_is_exact_where_it_is_known(void **state)
{
    const double shift[9] = {0, 2, 0, 0, 0, 3, 0, 0, 0}, turn[4] = {0, -100, 100, 0};
    double E[9], work[36];

    (void)state;
    assert_int_equal(apc_matrix_exponential(3, shift, E, work), 0);
    assert_near(E[0], 1.0, 1e-15);
    assert_near(E[1], 2.0, 1e-14);
    assert_near(E[2], 3.0, 1e-14);
    assert_near(E[5], 3.0, 1e-14);
    assert_near(E[6], 0.0, 1e-15);
    assert_int_equal(apc_matrix_exponential(2, turn, E, work), 0);
    assert_near(E[0], cos(100.0), 1e-12);
    assert_near(E[2], sin(100.0), 1e-12);
}

static void an_exponential_that_is_not_finite_is_said_so(void **state)
{
    const double large = 1000.0, infinite = (double)INFINITY, bad = (double)NAN;
    double E, work[4];

    (void)state;
    assert_int_not_equal(apc_matrix_exponential(1, &large, &E, work), 0);
    assert_int_not_equal(apc_matrix_exponential(1, &infinite, &E, work), 0);
    assert_int_not_equal(apc_matrix_exponential(1, &bad, &E, work), 0);
}

/* ---- Arrays of one block ------------------------------------------------------------------- */

static void arrays_of_one_block_are_apart_aligned_and_zero_or_copied(void **state)
{
    const double three[3] = {1, 2, 3};
    double *a, *copy, *none;
    char *flag;
    const struct apc_part parts[] = {APC_PART(flag, 3), APC_PART_COPY(copy, 3, three), APC_PART(none, 0),
                                     APC_PART(a, 5)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));

    (void)state;
    assert_non_null(memory);
    assert_int_equal((uintptr_t)a % alignof(max_align_t), 0);
    assert_int_equal((uintptr_t)copy % alignof(max_align_t), 0);
    memset(flag, 1, 3);
    assert_memory_equal(copy, three, sizeof(three));
    assert_true(none >= copy + 3 && a > none);
    for (size_t i = 0; i < 5; i++)
        assert_near(a[i], 0.0, 0.0);
    free(memory);
}

static void a_decomposition_is_orthogonal_and_a_triangle_or_refused(void **state)
{
    const double M[6] = {3, 1, 4, -1, 0, 2}; /* 3 x 2, its columns 5 and the square root of 6 long */
    double R[6], Q[9], product[6], T[9], one[9], work[3];

    (void)state;
    memcpy(R, M, sizeof R);
    assert_int_equal(apc_matrix_decompose(3, 2, R, Q, work), 0);
    apc_matrix_multiply(3, 3, 2, Q, R, product);
    apc_matrix_transpose(3, 3, Q, T);
    apc_matrix_multiply(3, 3, 3, Q, T, one);
    for (size_t i = 0; i < 6; i++)
        assert_near(product[i], M[i], 1e-14);
    for (size_t i = 0; i < 9; i++)
        assert_near(one[i], i % 4 == 0 ? 1.0 : 0.0, 1e-14);
    assert_near(fabs(R[0]), 5.0, 1e-14);
    for (size_t i = 2; i < 6; i++) /* below the diagonal */
        if (i != 3)
            assert_near(R[i], 0.0, 1e-14);

    const double alike[4] = {1, 2, 2, 4}, zero[4] = {0}, none[4] = {1, (double)NAN, 2, 1},
                 nearly[4] = {1, 1, 0, 1e-10}, too_nearly[4] = {1, 1, 0, 1e-12};
    const double *const dependent[] = {alike, zero, none, too_nearly};
    for (size_t i = 0; i < sizeof dependent / sizeof *dependent; i++) {
        memcpy(R, dependent[i], sizeof alike);
        assert_int_not_equal(apc_matrix_decompose(2, 2, R, Q, work), 0);
    }
    memcpy(R, nearly, sizeof nearly);
    assert_int_equal(apc_matrix_decompose(2, 2, R, Q, work), 0);
}

/* Their sizes come from what a user asks for: a sum that wraps would be a small block. */
static void arrays_beyond_counting_are_no_memory(void **state)
{
    double *a = NULL, *b = NULL, *c = NULL;
    const size_t most = SIZE_MAX / 4 / sizeof(*a);
    const struct apc_part one[] = {APC_PART(a, most + 1)},
                          sum[] = {APC_PART(a, most), APC_PART(b, most), APC_PART(c, most)};

    (void)state;
    assert_null(apc_parts_allocate(one, 1));
    assert_null(apc_parts_allocate(sum, 3));
    assert_null(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_product_and_a_transpose_have_their_shapes),
        cmocka_unit_test(equations_are_solved_whatever_the_units_of_the_rows),
        cmocka_unit_test(a_first_pivot_of_zero_is_no_obstacle),
        cmocka_unit_test(what_is_singular_or_no_number_is_not_solved),
        cmocka_unit_test(the_exponential_is_exact_where_it_is_known),
        cmocka_unit_test(an_exponential_that_is_not_finite_is_said_so),
        cmocka_unit_test(a_decomposition_is_orthogonal_and_a_triangle_or_refused),
        cmocka_unit_test(arrays_of_one_block_are_apart_aligned_and_zero_or_copied),
        cmocka_unit_test(arrays_beyond_counting_are_no_memory),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
