/* SPDX-License-Identifier: BSD-3-Clause */
#include "statistic.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>

static const double none = (double)NAN;

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Nearest rank. */
static double percentile_of_sorted(const double *sorted, size_t n, unsigned percent)
{
    return n > 0 ? sorted[(n * percent + 99) / 100 - 1] : none;
}

/* 95 % of Student's distribution with @df degrees of freedom lie within it, to both sides of 0. Beyond the
 * table by its expansion around the normal distribution, good to 2e-4. */
static double student(size_t df)
{
    static const double table[] = {12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060};
    const double z = 1.959964, n = (double)df;
    if (df <= sizeof table / sizeof *table)
        return table[df - 1];
    return z + (apc_pow(z, 3) + z) / (4 * n) +
           (5 * apc_pow(z, 5) + 16 * apc_pow(z, 3) + 3 * z) / (96 * n * n) +
           (3 * apc_pow(z, 7) + 19 * apc_pow(z, 5) + 17 * apc_pow(z, 3) - 15 * z) / (384 * n * n * n);
}

struct statistic statistic_of(double *values, const uint64_t *seed, size_t n)
{
    struct statistic s = {.n = n, .mean = none, .sd = none, .half = none, .worst = none};
    double mean = 0, squares = 0, beyond = 0;
    for (size_t i = 0; i < n; i++) {
        if (i == 0 || values[i] > s.worst) {
            s.worst = values[i];
            s.worst_seed = seed[i];
        }
        s.infinite += isinf(values[i]) != 0;
        beyond += isinf(values[i]) ? values[i] : 0;
        double apart = values[i] - mean;
        mean += apart / (double)(i + 1);
        squares += apart * (values[i] - mean);
    }
    if (n > 0)
        s.mean = s.infinite > 0 ? beyond : mean;
    if (n > 1 && s.infinite == 0) {
        s.sd = sqrt(squares / (double)(n - 1));
        s.half = student(n - 1) * s.sd / sqrt((double)n);
    }
    qsort(values, n, sizeof *values, by_value);
    s.median = percentile_of_sorted(values, n, 50);
    s.p95 = percentile_of_sorted(values, n, 95);
    s.p99 = percentile_of_sorted(values, n, 99);
    return s;
}
