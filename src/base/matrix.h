/* SPDX-License-Identifier: BSD-3-Clause */
/* Small dense matrices, stored row after row, for linear models and laws. [tick] */
#ifndef APC_MATRIX_H
#define APC_MATRIX_H

#include <stddef.h>

/* C [rows * columns] = A [rows * inner] B [inner * columns] */
void apc_matrix_multiply(size_t rows, size_t inner, size_t columns, const double *A, const double *B,
                         double *C);
/* The next @p n numbers of a block of memory that several share. */
static inline double *apc_carve(double **at, size_t n)
{
    double *p = *at;

    *at += n;
    return p;
}
/* The sum of a[i] b[i]. */
double apc_matrix_dot(const double *a, const double *b, size_t n);
/* T [columns * rows] = A' */
void apc_matrix_transpose(size_t rows, size_t columns, const double *A, double *T);
/* Copy block [rows * columns] to where its first element is at row r, column c of M, which has width columns. */
void apc_matrix_put(double *M, size_t width, size_t r, size_t c, size_t rows, size_t columns,
                    const double *block);
/* X [n * m] = A^-1 B, in place of B; A is destroyed. Returns 0, or nonzero where A is singular. */
int apc_matrix_solve(size_t n, size_t m, double *A, double *B);
/* A [n * n] becomes its LU decomposition, rows exchanged for the largest pivot: by pivot [n]. Returns 0, or
 * nonzero where a pivot is as good as zero. */
int apc_matrix_factor(size_t n, double *A, size_t *pivot);
/* v = A^-1 v, with the A and pivot of apc_matrix_factor(). */
void apc_matrix_substitute(size_t n, const double *A, const size_t *pivot, double *v);
/* M [rows * columns] = Q R: M becomes R, Q is [rows * rows]; work [rows]. Returns 0, or nonzero where the
 * columns are not independent. */
int apc_matrix_decompose(size_t rows, size_t columns, double *M, double *Q, double *work);
/* E = exp(M) [n * n]; work [4 * n * n]. Returns 0, or nonzero where M or E is not finite. */
int apc_matrix_exponential(size_t n, const double *M, double *E, double *work);
/* The greatest sum of magnitudes of a row: a norm. */
double apc_matrix_norm(size_t n, const double *M);

#endif
