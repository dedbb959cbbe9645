/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/matrix.h"

#include <float.h>
#include <math.h>
#include <string.h>

void apc_matrix_multiply(size_t rows, size_t inner, size_t columns, const double *A, const double *B,
                         double *C)
{
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++) {
            double sum = 0.0;

            for (size_t k = 0; k < inner; k++)
                sum += A[i * inner + k] * B[k * columns + j];
            C[i * columns + j] = sum;
        }
    }
}

double apc_matrix_dot(const double *a, const double *b, size_t n)
{
    double sum = 0.0;

    for (size_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

void apc_matrix_transpose(size_t rows, size_t columns, const double *A, double *T)
{
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++)
            T[j * rows + i] = A[i * columns + j];
    }
}

void apc_matrix_put(double *M, size_t width, size_t r, size_t c, size_t rows, size_t columns,
                    const double *block)
{
    for (size_t i = 0; i < rows; i++)
        memcpy(M + (r + i) * width + c, block + i * columns, columns * sizeof(*M));
}

static void swap_rows(double *M, size_t width, size_t a, size_t b)
{
    for (size_t j = 0; j < width; j++) {
        double kept = M[a * width + j];

        M[a * width + j] = M[b * width + j];
        M[b * width + j] = kept;
    }
}

/* NaN when an element is. */
static double row_magnitude(const double *row, size_t n)
{
    double magnitude = 0.0;

    for (size_t j = 0; j < n; j++)
        magnitude = fabs(row[j]) > magnitude || isnan(row[j]) ? fabs(row[j]) : magnitude;
    return magnitude;
}

/* Gaussian elimination; rows are first brought to magnitude 1, so that units do not choose the pivots. */
int apc_matrix_solve(size_t n, size_t m, double *A, double *B)
{
    for (size_t i = 0; i < n; i++) {
        double magnitude = row_magnitude(A + i * n, n);

        if (!(magnitude > 0.0 && magnitude < HUGE_VAL))
            return -1;
        for (size_t j = 0; j < n; j++)
            A[i * n + j] /= magnitude;
        for (size_t j = 0; j < m; j++)
            B[i * m + j] /= magnitude;
    }
    for (size_t k = 0; k < n; k++) {
        size_t pivot = k;

        for (size_t i = k + 1; i < n; i++) {
            if (fabs(A[i * n + k]) > fabs(A[pivot * n + k]))
                pivot = i;
        }
        if (!(fabs(A[pivot * n + k]) > (double)n * DBL_EPSILON))
            return -1;
        swap_rows(A, n, k, pivot);
        swap_rows(B, m, k, pivot);
        for (size_t i = k + 1; i < n; i++) {
            double factor = A[i * n + k] / A[k * n + k];

            for (size_t j = k; j < n; j++)
                A[i * n + j] -= factor * A[k * n + j];
            for (size_t j = 0; j < m; j++)
                B[i * m + j] -= factor * B[k * m + j];
        }
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t j = 0; j < m; j++) {
            for (size_t i = k + 1; i < n; i++)
                B[k * m + j] -= A[k * n + i] * B[i * m + j];
            B[k * m + j] /= A[k * n + k];
        }
    }
    return 0;
}

int apc_matrix_factor(size_t n, double *A, size_t *pivot)
{
    for (size_t k = 0; k < n; k++) {
        size_t best = k;

        for (size_t i = k + 1; i < n; i++) {
            if (fabs(A[i * n + k]) > fabs(A[best * n + k]))
                best = i;
        }
        pivot[k] = best;
        if (!(fabs(A[best * n + k]) >= DBL_MIN))
            return -1;
        swap_rows(A, n, k, best);
        for (size_t i = k + 1; i < n; i++) {
            double factor = A[i * n + k] /= A[k * n + k];

            for (size_t l = k + 1; l < n; l++)
                A[i * n + l] -= factor * A[k * n + l];
        }
    }
    return 0;
}

void apc_matrix_substitute(size_t n, const double *A, const size_t *pivot, double *v)
{
    for (size_t k = 0; k < n; k++) {
        double swap = v[pivot[k]];

        v[pivot[k]] = v[k];
        v[k] = swap;
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++)
            v[i] -= A[i * n + k] * v[k];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++)
            v[i] -= A[i * n + k] * v[k];
        v[i] /= A[i * n + i];
    }
}

double apc_matrix_norm(size_t n, const double *M)
{
    double norm = 0.0;

    for (size_t i = 0; i < n; i++) {
        double sum = 0.0;

        for (size_t j = 0; j < n; j++)
            sum += fabs(M[i * n + j]);
        norm = sum > norm || isnan(sum) ? sum : norm;
    }
    return norm;
}

/*
 * M is halved until its norm is below 1/2, the diagonal Pade approximation of degree 8 taken (its error is
 * then below that of rounding), and the result squared as often.
 */
int apc_matrix_exponential(size_t n, const double *M, double *E, double *work)
{
    enum { DEGREE = 8 };
    double *scaled = work, *power = scaled + n * n, *denominator = power + n * n,
           *product = denominator + n * n;
    double norm = apc_matrix_norm(n, M), coefficient = 1.0, sign = 1.0;
    int halvings = 0;

    if (!isfinite(norm))
        return -1;
    while (ldexp(norm, -halvings) > 0.5)
        halvings++;
    for (size_t i = 0; i < n * n; i++) {
        scaled[i] = ldexp(M[i], -halvings);
        E[i] = denominator[i] = power[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    }
    for (int k = 1; k <= DEGREE; k++) {
        coefficient *= (DEGREE - k + 1) / (double)(k * (2 * DEGREE - k + 1));
        sign = -sign;
        apc_matrix_multiply(n, n, n, scaled, power, product);
        memcpy(power, product, n * n * sizeof(*power));
        for (size_t i = 0; i < n * n; i++) {
            E[i] += coefficient * power[i];
            denominator[i] += sign * coefficient * power[i];
        }
    }
    if (apc_matrix_solve(n, n, denominator, E))
        return -1;
    for (; halvings > 0; halvings--) {
        apc_matrix_multiply(n, n, n, E, E, product);
        memcpy(E, product, n * n * sizeof(*E));
    }
    return isfinite(apc_matrix_norm(n, E)) ? 0 : -1;
}

/* Householder's. */
int apc_matrix_decompose(size_t rows, size_t columns, double *M, double *Q, double *v)
{
    double largest = 0.0;

    for (size_t i = 0; i < rows * rows; i++)
        Q[i] = i % (rows + 1) == 0 ? 1.0 : 0.0;
    for (size_t k = 0; k < columns; k++) {
        double norm = 0.0, square;

        for (size_t i = k; i < rows; i++)
            norm += M[i * columns + k] * M[i * columns + k];
        norm = sqrt(norm);
        largest = fmax(largest, norm);
        if (!(norm > 1e-11 * largest))
            return -1;
        for (size_t i = k; i < rows; i++)
            v[i] = M[i * columns + k];
        v[k] += v[k] < 0.0 ? -norm : norm;
        square = 0.0;
        for (size_t i = k; i < rows; i++)
            square += v[i] * v[i];
        for (size_t j = 0; j < columns; j++) {
            double dot = 0.0;

            for (size_t i = k; i < rows; i++)
                dot += v[i] * M[i * columns + j];
            for (size_t i = k; i < rows; i++)
                M[i * columns + j] -= 2.0 * dot / square * v[i];
        }
        for (size_t j = 0; j < rows; j++) {
            double dot = 0.0;

            for (size_t i = k; i < rows; i++)
                dot += Q[j * rows + i] * v[i];
            for (size_t i = k; i < rows; i++)
                Q[j * rows + i] -= 2.0 * dot / square * v[i];
        }
    }
    return 0;
}
