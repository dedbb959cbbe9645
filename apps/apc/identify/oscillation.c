/* SPDX-License-Identifier: BSD-3-Clause */
#include "oscillation.h"

#include <math.h>

#include "base/complex.h"

#define ALIKE  0.15 /* two periods, of their length; a sample of a short one is as much */
#define LOOKED 5    /* switches, the last ones; 4 make a period of each direction */

/* Switches one after another between the same two values. */
struct chain {
    size_t n, at[LOOKED]; /* how many, and the samples of the last ones, the latest first */
};

static bool is_same_level(double a, double b)
{
    return fabs(a - b) <= 1e-9 * fmax(fabs(a), fabs(b));
}

static void add_crossing(struct chain *c, bool goes_on, size_t k)
{
    for (size_t i = LOOKED - 1; i > 0; i--)
        c->at[i] = c->at[i - 1];
    c->at[0] = k;
    c->n = goes_on ? c->n + 1 : 1;
}

/* The longest chain, the last of those that are as long. A sample between those beside it is no level: the input
 * switched in it. */
static struct chain find_chain(const struct apc_record *r, const double *u, size_t stride)
{
    struct chain best = {.n = 0}, now = {.n = 0};
    double before = (double)NAN, was = u[0];

    for (size_t k = 1; k < r->n; k++) {
        const double is = u[k * stride], next = k + 1 < r->n ? u[(k + 1) * stride] : is;

        if (is_same_level(was, is) || (was < is && is < next) || (was > is && is > next))
            continue;
        add_crossing(&now, is_same_level(is, before), k);
        before = was;
        was = is;
        best = now.n >= best.n ? now : best;
    }
    return best;
}

static bool alike(size_t a, size_t b)
{
    return fabs((double)a - (double)b) <= fmax(ALIKE * (double)a, 1.0);
}

/* The first harmonic of samples from..to - 1, @p whole periods. */
static double complex harmonic(const double *x, size_t stride, size_t from, size_t to, size_t whole)
{
    double complex sum = 0;

    for (size_t k = from; k < to; k++)
        sum += x[k * stride] *
               apc_cexp(-2.0 * M_PI * (double)(whole * (k - from)) / (double)(to - from) * (double complex)I);
    return sum;
}

bool oscillation_find(const struct apc_record *record, size_t j, size_t i, struct oscillation *found)
{
    const size_t inputs = record->nu + record->nd;
    const double *u = record->u + j, *y = record->y + i;
    const struct chain c = find_chain(record, u, inputs);

    if (c.n < 4 || !alike(c.at[0] - c.at[2], c.at[1] - c.at[3]))
        return false;
    found->whole = c.n > 4 && alike(c.at[0] - c.at[2], c.at[2] - c.at[4]) ? 2 : 1;
    const size_t to = c.at[0], from = c.at[2 * found->whole];
    const double complex answer = apc_cdivide(harmonic(y, record->ny, from, to, found->whole),
                                              harmonic(u, inputs, from, to, found->whole));

    found->gain = copysign(1.0 / apc_cabs(answer), -creal(answer));
    found->every = (double)(to - from) / (double)found->whole * record->Ts;
    return isfinite(found->gain) && found->gain != 0.0;
}
