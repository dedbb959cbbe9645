/* SPDX-License-Identifier: BSD-3-Clause */
/* One figure over many runs, or its difference between two campaigns. */
#ifndef APC_STATISTIC_H
#define APC_STATISTIC_H

#include <stddef.h>
#include <stdint.h>

/* An infinite value counts as what it is: in the percentiles, and the mean is infinite then. NAN: there is no
 * such number. */
struct statistic {
    size_t n, infinite; /* values; infinite ones among them */
    double mean, sd;    /* sd: of one value */
    double half;        /* the 95 % interval of the mean is this far to both sides of it */
    double median, p95, p99, worst;
    uint64_t worst_seed;
};

/* Of @values [n] and the seed of each. The values are in order of size afterwards. */
struct statistic statistic_of(double *values, const uint64_t *seed, size_t n);

#endif
