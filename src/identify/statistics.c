/* SPDX-License-Identifier: BSD-3-Clause */
#include "identify/identify_internal.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The incomplete gamma function, by its series below a + 1 and Lentz' continued fraction above (Abramowitz
 * and Stegun, 6.5.29 and 6.5.31). */
double apc_chi2_above(double x, double k)
{
    const double a = k / 2.0, z = x / 2.0;
    double front, sum, term;

    if (!(z > 0.0))
        return 1.0;
    front = apc_exp(a * apc_log(z) - z - apc_lgamma(a));
    if (z < a + 1.0) {
        sum = term = 1.0 / a;
        for (int i = 1; term > 1e-16 * sum; i++)
            sum += term *= z / (a + i);
        return fmax(1.0 - front * sum, 0.0);
    }
    double b = z + 1.0 - a, c = 1e300, d = 1.0 / b, h = d, change = 0.0;
    for (int i = 1; i < 1000 && fabs(change - 1.0) > 1e-15; i++) {
        const double an = -i * (i - a);

        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        change = d * c;
        h *= change;
    }
    return front * h;
}

void apc_whiten(const double *x, size_t n, const double *a, size_t order, double *out)
{
    for (size_t k = n; k-- > order;) { /* from the end: out may be x */
        double sum = x[k];

        for (size_t i = 0; i < order; i++)
            sum -= a[i] * x[k - i - 1];
        out[k] = sum;
    }
    for (size_t k = 0; k < n && k < order; k++)
        out[k] = (double)NAN;
}

/* Each order on the same samples, so that what is left of them compares. */
int apc_autoregression(const double *e, size_t n, size_t most, double *a)
{
    double *Q = calloc(n * (most + 1) + (most + 1) * (most + 2) + 1, sizeof(*Q)), *R, *b, best = HUGE_VAL;
    size_t rows = 0;
    int order = 0;

    if (!Q)
        return APC_ENOMEM;
    R = Q + n * (most + 1);
    b = R + (most + 1) * (most + 1);
    for (size_t k = most; k < n; k++) {
        bool there = true;

        for (size_t i = 0; i <= most; i++)
            there &= isfinite(e[k - i]) != 0;
        for (size_t i = 0; i <= most && there; i++)
            Q[(i < most ? i : most) * n + rows] = e[i < most ? k - i - 1 : k];
        rows += there;
    }
    if (rows > 10 * (most + 1)) {
        for (size_t i = 1; i <= most; i++) { /* columns closed up, rows being fewer than n */
            for (size_t k = 0; k < rows; k++)
                Q[i * rows + k] = Q[i * n + k];
        }
        apc_qr_extend(rows, 0, most + 1, Q, R, most + 1);
        for (size_t p = 0; p <= most; p++) {
            double left = 0.0, score;

            for (size_t i = p; i <= most; i++)
                left += R[i * (most + 1) + most] * R[i * (most + 1) + most];
            score = (double)rows * apc_log(fmax(left, 1e-300)) + (double)p * apc_log((double)rows);
            if (score < best) {
                best = score;
                order = (int)p;
            }
        }
        for (size_t i = 0; i < most; i++)
            b[i] = R[i * (most + 1) + most];
        apc_qr_solve((size_t)order, R, most + 1, b, a);
    }
    free(Q);
    return order;
}
