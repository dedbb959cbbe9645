/* SPDX-License-Identifier: BSD-3-Clause */
/* Complex linear algebra of small matrices: eigenvalues by Francis' QR iteration with single shifts on a
 * Hessenberg matrix (Golub and van Loan, Matrix Computations, 4th ed., chapter 7), equations by Gauss. */
#include <apcmath.h>

#include <math.h>

#include "analyze/analyze_internal.h"

#define ITERATIONS 60 /* for one eigenvalue */

/* Plain products: what is not finite is found by its size. */
static inline double complex times(double complex a, double complex b)
{
    return apc_complex(creal(a) * creal(b) - cimag(a) * cimag(b), creal(a) * cimag(b) + cimag(a) * creal(b));
}

static inline double one_norm(double complex a)
{
    return fabs(creal(a)) + fabs(cimag(a));
}

/* Rows and columns to like sizes, by powers of 2: exact. */
static void balance(size_t n, double complex *A)
{
    bool more = true;

    for (int round = 0; more && round < 100; round++) {
        more = false;
        for (size_t i = 0; i < n; i++) {
            double row = 0.0, column = 0.0, by;
            int power;

            for (size_t j = 0; j < n; j++) {
                row += j == i ? 0.0 : one_norm(A[i * n + j]);
                column += j == i ? 0.0 : one_norm(A[j * n + i]);
            }
            if (!(row > 0.0 && column > 0.0 && isfinite(row + column)))
                continue;
            (void)frexp(sqrt(row / column), &power);
            by = ldexp(1.0, power - 1);
            if (by >= 0.5 && by <= 1.0)
                continue;
            more = true;
            for (size_t j = 0; j < n; j++) {
                A[i * n + j] /= by;
                A[j * n + i] *= by;
            }
        }
    }
}

static void swap_complex(double complex *a, double complex *b)
{
    const double complex keep = *a;

    *a = *b;
    *b = keep;
}

static void to_hessenberg(size_t n, double complex *A)
{
    for (size_t k = 1; k + 1 < n; k++) {
        size_t pivot = k;

        for (size_t i = k; i < n; i++)
            pivot = one_norm(A[i * n + k - 1]) > one_norm(A[pivot * n + k - 1]) ? i : pivot;
        if (!(one_norm(A[pivot * n + k - 1]) > 0.0))
            continue;
        for (size_t j = 0; j < n && pivot != k; j++)
            swap_complex(&A[pivot * n + j], &A[k * n + j]);
        for (size_t j = 0; j < n && pivot != k; j++)
            swap_complex(&A[j * n + pivot], &A[j * n + k]);
        for (size_t i = k + 1; i < n; i++) {
            const double complex share = apc_cdivide(A[i * n + k - 1], A[k * n + k - 1]);

            if (!(one_norm(share) > 0.0))
                continue;
            for (size_t j = k - 1; j < n; j++)
                A[i * n + j] -= times(share, A[k * n + j]);
            for (size_t j = 0; j < n; j++)
                A[j * n + k] += times(share, A[j * n + i]);
        }
    }
}

/* The eigenvalue of the last two rows that is nearer to the last element. */
static double complex wilkinson(size_t n, const double complex *H, size_t hi)
{
    const double complex a = H[(hi - 1) * n + hi - 1], b = H[(hi - 1) * n + hi], c = H[hi * n + hi - 1],
                         d = H[hi * n + hi], half = (a - d) / 2.0,
                         root = apc_csqrt(times(half, half) + times(b, c));
    const double complex one = d + half + root, other = d + half - root;

    return apc_cabs(one - d) < apc_cabs(other - d) ? one : other;
}

/* H - shift = Q R, then R Q + shift, between rows lo and hi. */
static void qr_sweep(size_t n, double complex *H, size_t lo, size_t hi, double complex shift)
{
    double complex c0 = 0.0, s0 = 0.0; /* the rotation before: its columns wait for the next rows */

    for (size_t i = lo; i <= hi; i++)
        H[i * n + i] -= shift;
    for (size_t k = lo; k <= hi; k++) {
        double complex c = 1.0, s = 0.0;

        if (k < hi) {
            const double complex a = H[k * n + k], b = H[(k + 1) * n + k];
            const double r = apc_hypot(apc_cabs(a), apc_cabs(b));

            if (r > 0.0) {
                c = a / r;
                s = b / r;
            }
            for (size_t j = k; j <= hi; j++) {
                const double complex x = H[k * n + j], y = H[(k + 1) * n + j];

                H[k * n + j] = times(conj(c), x) + times(conj(s), y);
                H[(k + 1) * n + j] = times(c, y) - times(s, x);
            }
        }
        if (k > lo) {
            for (size_t i = lo; i <= k; i++) {
                const double complex x = H[i * n + k - 1], y = H[i * n + k];

                H[i * n + k - 1] = times(x, c0) + times(y, s0);
                H[i * n + k] = times(y, conj(c0)) - times(x, conj(s0));
            }
        }
        c0 = c;
        s0 = s;
    }
    for (size_t i = lo; i <= hi; i++)
        H[i * n + i] += shift;
}

int eigenvalues(size_t n, double complex *A, double complex *value)
{
    double all = 0.0;
    int iteration = 0;

    for (size_t i = 0; i < n * n; i++)
        all += one_norm(A[i]);
    if (!isfinite(all))
        return APC_ESOLVER;
    balance(n, A);
    to_hessenberg(n, A);
    for (size_t hi = n; hi-- > 0;) {
        size_t lo = hi;

        while (lo > 0) {
            double near = one_norm(A[lo * n + lo]) + one_norm(A[(lo - 1) * n + lo - 1]);

            near = near > 0.0 ? near : all;
            if (one_norm(A[lo * n + lo - 1]) <= 0x1p-53 * near || one_norm(A[lo * n + lo - 1]) < 1e-290)
                break;
            lo--;
        }
        if (lo > 0)
            A[lo * n + lo - 1] = 0.0;
        if (lo == hi) {
            value[hi] = A[hi * n + hi];
            iteration = 0;
            continue;
        }
        if (++iteration > ITERATIONS)
            return APC_ESOLVER;
        qr_sweep(n, A, lo, hi,
                 iteration % 11 == 10 ? A[hi * n + hi] + 1.1 * one_norm(A[hi * n + hi - 1])
                                      : wilkinson(n, A, hi));
        hi++;
    }
    return 0;
}

int complex_solve(size_t n, size_t m, double complex *A, double complex *B)
{
    for (size_t k = 0; k < n; k++) {
        size_t pivot = k;

        for (size_t i = k + 1; i < n; i++)
            pivot = one_norm(A[i * n + k]) > one_norm(A[pivot * n + k]) ? i : pivot;
        if (!(one_norm(A[pivot * n + k]) > 0.0))
            return 1;
        for (size_t j = k; j < n && pivot != k; j++)
            swap_complex(&A[pivot * n + j], &A[k * n + j]);
        for (size_t j = 0; j < m && pivot != k; j++)
            swap_complex(&B[pivot * m + j], &B[k * m + j]);
        for (size_t i = k + 1; i < n; i++) {
            const double complex share = apc_cdivide(A[i * n + k], A[k * n + k]);

            if (!(one_norm(share) > 0.0))
                continue;
            for (size_t j = k + 1; j < n; j++)
                A[i * n + j] -= times(share, A[k * n + j]);
            for (size_t j = 0; j < m; j++)
                B[i * m + j] -= times(share, B[k * m + j]);
        }
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t j = 0; j < m; j++) {
            double complex sum = B[k * m + j];

            for (size_t i = k + 1; i < n; i++)
                sum -= times(A[k * n + i], B[i * m + j]);
            B[k * m + j] = apc_cdivide(sum, A[k * n + k]);
        }
    }
    return 0;
}
