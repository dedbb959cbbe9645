/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Random numbers that repeat: the generator is xoshiro256++ (D. Blackman, S. Vigna, "Scrambled linear
 * pseudorandom number generators", 2019), its state filled by splitmix64 from the seed and the FNV-1a hash of
 * the stream's name. The distributions use nothing but log, sqrt and pow of libm, so that they agree between
 * compilers; draws by rejection take as many numbers as they need, which no other stream notices.
 */
#include "apcbase.h"

#include <apcmath.h>

#include <math.h>
#include <string.h>

static uint64_t splitmix(uint64_t *state)
{
    uint64_t z = *state += UINT64_C(0x9e3779b97f4a7c15);

    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

void apc_random_init(struct apc_random *random, uint64_t seed, const char *name)
{
    uint64_t hash = UINT64_C(0xcbf29ce484222325), state = seed;

    for (const char *c = name ? name : ""; *c; c++)
        hash = (hash ^ (unsigned char)*c) * UINT64_C(0x100000001b3);
    state = splitmix(&state) ^ hash; /* neighbouring seeds far apart before the name comes in */
    for (size_t i = 0; i < 4; i++)
        random->state[i] = splitmix(&state);
}

static uint64_t rotate_bits(uint64_t x, int by)
{
    return (x << by) | (x >> (64 - by));
}

uint64_t apc_random_next(struct apc_random *random)
{
    uint64_t *s = random->state;
    uint64_t result = rotate_bits(s[0] + s[3], 23) + s[0], t = s[1] << 17;

    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate_bits(s[3], 45);
    return result;
}

double apc_random_uniform(struct apc_random *random)
{
    return (double)(apc_random_next(random) >> 11) * 0x1p-53;
}

/* Marsaglia's polar method. Its second number is thrown away: a stream is its four words, nothing kept back. */
double apc_random_normal(struct apc_random *random)
{
    double x, y, square;

    do {
        x = 2.0 * apc_random_uniform(random) - 1.0;
        y = 2.0 * apc_random_uniform(random) - 1.0;
        square = x * x + y * y;
    } while (square >= 1.0 || square == 0.0);
    return x * sqrt(-2.0 * apc_log(square) / square);
}

/* G. Marsaglia, W. W. Tsang, "A simple method for generating gamma variables", 2000; scale 1. */
static double gamma_of(double shape, struct apc_random *random)
{
    const double boost = shape < 1.0 ? apc_pow(1.0 - apc_random_uniform(random), 1.0 / shape) : 1.0;
    const double d = (shape < 1.0 ? shape + 1.0 : shape) - 1.0 / 3.0, c = 1.0 / sqrt(9.0 * d);

    for (;;) {
        double x = apc_random_normal(random), v = 1.0 + c * x;

        if (v <= 0.0)
            continue;
        v = v * v * v;
        if (apc_log(1.0 - apc_random_uniform(random)) < 0.5 * x * x + d - d * v + d * apc_log(v))
            return boost * d * v;
    }
}

static double recorded_of(const struct apc_distribution *distribution, struct apc_random *random)
{
    double at = apc_random_uniform(random);
    size_t low = 0, high = distribution->n_shares - 1;

    while (low < high) { /* the first whose share is above */
        size_t middle = low + (high - low) / 2;

        if (distribution->shares[middle].share > at)
            high = middle;
        else
            low = middle + 1;
    }
    const struct apc_share *in = &distribution->shares[low];
    return in->low + (in->high - in->low) * apc_random_uniform(random);
}

double apc_distribution_draw(const struct apc_distribution *distribution, struct apc_random *random)
{
    const double a = distribution->a, b = distribution->b;

    switch (distribution->kind) {
    case APC_UNIFORM:
        return a + (b - a) * apc_random_uniform(random);
    case APC_NORMAL:
        return a + b * apc_random_normal(random);
    case APC_EXPONENTIAL:
        return -a * apc_log(1.0 - apc_random_uniform(random));
    case APC_GAMMA:
        return b * gamma_of(a, random);
    case APC_RECORDED:
        return recorded_of(distribution, random);
    case APC_CONSTANT:
        break;
    }
    return a;
}

double apc_distribution_low(const struct apc_distribution *distribution)
{
    switch (distribution->kind) {
    case APC_NORMAL:
        return distribution->b > 0.0 ? -HUGE_VAL : distribution->a;
    case APC_EXPONENTIAL:
    case APC_GAMMA:
        return 0.0;
    case APC_RECORDED:
        return distribution->shares[0].low;
    case APC_CONSTANT:
    case APC_UNIFORM:
        break;
    }
    return distribution->a;
}

double apc_distribution_mean(const struct apc_distribution *distribution)
{
    const double a = distribution->a, b = distribution->b;
    double mean = 0.0, before = 0.0;

    switch (distribution->kind) {
    case APC_UNIFORM:
        return a + (b - a) / 2.0;
    case APC_GAMMA:
        return a * b;
    case APC_RECORDED:
        for (size_t i = 0; i < distribution->n_shares; i++) {
            const struct apc_share *s = &distribution->shares[i];

            mean += (s->share - before) * (s->low + (s->high - s->low) / 2.0);
            before = s->share;
        }
        return mean;
    case APC_CONSTANT:
    case APC_NORMAL:
    case APC_EXPONENTIAL:
        break;
    }
    return a;
}

/* ---- As text ------------------------------------------------------------------------------- */

static const struct form {
    const char *name;
    enum apc_distribution_kind kind;
    int n;
    const char *what; /* what the numbers are, and must be */
} forms[] = {
    {"constant", APC_CONSTANT, 1, "constant(value)"},
    {"uniform", APC_UNIFORM, 2, "uniform(low, high), low not above high"},
    {"normal", APC_NORMAL, 2, "normal(mean, sd), sd not below 0"},
    {"exponential", APC_EXPONENTIAL, 1, "exponential(mean), mean above 0"},
    {"gamma", APC_GAMMA, 2, "gamma(shape, scale), both above 0"},
};

/* The numbers between the parentheses into @values. False when there are not exactly @n. */
static bool read_numbers(const char *from, int n, double *values)
{
    char part[64];

    for (int i = 0; i < n; i++) {
        from += strspn(from, " ");
        size_t length = strcspn(from, ",) ");

        if (length >= sizeof part)
            return false;
        memcpy(part, from, length);
        part[length] = '\0';
        if (apc_number_parse(part, &values[i]) < 0)
            return false;
        from += length;
        from += strspn(from, " ");
        if (*from++ != (i + 1 < n ? ',' : ')'))
            return false;
    }
    return *from == '\0';
}

static bool numbers_fit(const struct apc_distribution *d)
{
    switch (d->kind) {
    case APC_UNIFORM:
        return d->a <= d->b;
    case APC_NORMAL:
        return d->b >= 0.0;
    case APC_EXPONENTIAL:
        return d->a > 0.0;
    case APC_GAMMA:
        return d->a > 0.0 && d->b > 0.0;
    case APC_CONSTANT:
    case APC_RECORDED:
        break;
    }
    return true;
}

int apc_distribution_parse(const char *text, struct apc_distribution *distribution, struct apc_error *why)
{
    struct apc_distribution d = {.kind = APC_CONSTANT};
    double values[2] = {0.0, 0.0};

    if (!text || !distribution)
        return apc_fail(why, APC_EINVAL, "a distribution must not be NULL");
    *distribution = d;
    if (apc_number_parse(text, &distribution->a) == 0)
        return 0;
    size_t length = strcspn(text, "(");
    for (size_t i = 0; i < sizeof forms / sizeof *forms; i++) {
        const struct form *form = &forms[i];

        if (strlen(form->name) != length || memcmp(form->name, text, length) != 0)
            continue;
        d.kind = form->kind;
        if (text[length] != '(' || !read_numbers(text + length + 1, form->n, values))
            return apc_fail(why, APC_EINVAL, "'%.80s': expected %s", text, form->what);
        d.a = values[0];
        d.b = values[1];
        if (!numbers_fit(&d))
            return apc_fail(why, APC_EINVAL, "'%.80s': expected %s", text, form->what);
        *distribution = d;
        return 0;
    }
    return apc_fail(why, APC_EINVAL,
                    "no distribution is called '%.80s': expected a number, uniform(low, high), "
                    "normal(mean, sd), exponential(mean) or gamma(shape, scale)",
                    text);
}
