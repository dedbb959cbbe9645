/* SPDX-License-Identifier: BSD-3-Clause */
/* Elementary functions: the same bits everywhere, near the truth, and special values as ISO C has them. */
#include <apcmath.h>

#include <float.h>
#include <math.h>
#include <string.h>

#include "check.h"
#include "xorshift.h"

#define N 20000

/* ---- Arguments -------------------------------------------------------------------------------- */

static uint64_t drawn;

static double of_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static uint64_t bits_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* A number of either sign with an exponent of @p low to @p high. */
static double number(int low, int high)
{
    const uint64_t exponent = (uint64_t)(low + (int)(xorshift(&drawn) % (uint64_t)(high - low + 1)) + 1023);
    return of_bits((xorshift(&drawn) & UINT64_C(0x800fffffffffffff)) | exponent << 52);
}

/* Of all kinds in turn: ordinary, near 1, small and large, far out. */
static double argument(int i)
{
    const double sign = number(0, 0);
    switch (i % 4) {
    case 0:
        return number(-4, 4);
    case 1:
        return copysign(1.0 + number(-20, -3), sign);
    case 2:
        return number(-40, 9);
    default:
        return number(-1022, 1023);
    }
}

/* ---- The same bits ---------------------------------------------------------------------------- */

typedef double (*function)(double x);

static double by_exponent(double x)
{
    return apc_pow(fabs(x), number(-6, 7));
}
static double by_angle(double x)
{
    return apc_atan2(x, argument((int)(xorshift(&drawn) % 4)));
}
static double by_side(double x)
{
    return apc_hypot(x, argument((int)(xorshift(&drawn) % 4)));
}
static double of_size(double x)
{
    return apc_log(fabs(x));
}
static double of_size2(double x)
{
    return apc_log2(fabs(x));
}
static double of_size10(double x)
{
    return apc_log10(fabs(x));
}
static double of_size_gamma(double x)
{
    return apc_lgamma(fabs(x));
}

/* What a change of these constants says: each record and simulation that uses the function is another one. */
static void the_bits_are_those_of_every_machine(void **state)
{
    static const struct {
        const char *name;
        function f;
        uint64_t digest;
    } functions[] = {
        {"exp", apc_exp, UINT64_C(0x4b2728a715ee9742)},
        {"expm1", apc_expm1, UINT64_C(0xe7cd00dee703574b)},
        {"log", of_size, UINT64_C(0x973ee14817a0a593)},
        {"log2", of_size2, UINT64_C(0xc22ffe4477afacb0)},
        {"log10", of_size10, UINT64_C(0x24dffc3cb532218f)},
        {"pow", by_exponent, UINT64_C(0x0133c38e8751ad4d)},
        {"sin", apc_sin, UINT64_C(0x85deac1ed61ab05d)},
        {"cos", apc_cos, UINT64_C(0x2a1f77b9ea375e6c)},
        {"atan", apc_atan, UINT64_C(0x4554a9c40c5a5f57)},
        {"atan2", by_angle, UINT64_C(0x890def5852f95d55)},
        {"hypot", by_side, UINT64_C(0xed7ef987fb8214bf)},
        {"lgamma", of_size_gamma, UINT64_C(0x9cd6bf7817bebc5c)},
    };
    bool alike = true;
    (void)state;
    for (size_t k = 0; k < sizeof functions / sizeof *functions; k++) {
        uint64_t digest = UINT64_C(0xcbf29ce484222325); /* FNV-1a, of words */
        drawn = UINT64_C(88172645463325252);
        for (int i = 0; i < N; i++) {
            const double y = functions[k].f(argument(i));
            digest = (digest ^ (isnan(y) ? 1 : bits_of(y))) * UINT64_C(0x100000001b3);
        }
        if (digest != functions[k].digest)
            print_error("%s: digest 0x%016llx\n", functions[k].name, (unsigned long long)digest);
        alike = alike && digest == functions[k].digest;
    }
    assert_true(alike);
}

/* ---- Near the truth --------------------------------------------------------------------------- */

#if LDBL_MANT_DIG >= 64
/* |got - truth| in units in the last place of the truth */
static double units(double got, long double truth)
{
    int exponent;
    if (fabsl(truth) > (long double)DBL_MAX || isnan(truth))
        return 0.0;
    (void)frexpl(truth, &exponent);
    return (double)(fabsl((long double)got - truth) / ldexpl(1.0L, exponent > -1021 ? exponent - 53 : -1074));
}

static void they_are_within_a_unit_of_the_truth(void **state)
{
    double worst[11] = {0};
    (void)state;
    drawn = 1;
    for (int i = 0; i < N; i++) {
        const double x = argument(i), size = fabs(x), z = argument(i / 4), angle = fmod(x, 1e4),
                     y = number(-6, 5);
        const long double lx = (long double)x, ly = (long double)y, lz = (long double)z,
                          ls = (long double)size, la = (long double)angle;
        const double error[] = {
            units(apc_exp(x), expl(lx)),
            units(apc_expm1(x), expm1l(lx)),
            units(apc_log(size), logl(ls)),
            units(apc_log2(size), log2l(ls)),
            units(apc_log10(size), log10l(ls)),
            units(apc_pow(size, y), powl(ls, ly)),
            units(apc_sin(angle), sinl(la)),
            units(apc_cos(angle), cosl(la)),
            units(apc_atan(x), atanl(lx)),
            units(apc_atan2(x, z), atan2l(lx, lz)),
            units(apc_hypot(x, z), hypotl(lx, lz)),
        };
        for (size_t k = 0; k < sizeof error / sizeof *error; k++)
            worst[k] = fmax(worst[k], error[k]);
    }
    for (size_t k = 0; k < sizeof worst / sizeof *worst; k++) {
        if (!(worst[k] < 1.0))
            print_error("function %zu is off by %g units\n", k, worst[k]);
        assert_true(worst[k] < 1.0);
    }
}
#endif

/* The nearest from below, by continued fractions of 2 / pi; the cosines are of 1400 bits. */
static void an_angle_just_short_of_a_quarter_turn_keeps_its_digits(void **state)
{
    static const double near[][3] = {
        /* angle, sine, cosine */
        {0x1.504cac51f1eafp+131, -1.0, -0x1.0cb604d34f341p-59},
        {0x1.e009c53148be1p+991, 1.0, 0x1.295a3b0a64b1dp-59},
        {0x1.cfe482285f8edp+860, -1.0, -0x1.d08f59c32bfa3p-59},
        {0x1.c45cd11154dfdp+295, 1.0, 0x1.01242876d7c1bp-58},
    };
    (void)state;
    for (size_t i = 0; i < sizeof near / sizeof *near; i++) {
        const double a = near[i][0], cosine = near[i][2], rounding = 0x1p-52 * fabs(cosine);
        assert_true(apc_sin(a) == near[i][1] && apc_sin(-a) == -near[i][1]);
        assert_true(fabs(apc_cos(a) - cosine) <= rounding && fabs(apc_cos(-a) - cosine) <= rounding);
    }
}

static void the_logarithm_of_the_gamma_function_is_near_the_truth(void **state)
{
    static const double x[] = {0x1p-1000, 1e-3, 0.1,  0.5,  1.0,   1.5, 2.0,  3.0,
                               4.5,       11.9, 12.0, 50.0, 171.5, 1e6, 1e300};
    (void)state;
    for (size_t i = 0; i < sizeof x / sizeof *x; i++)
        assert_true(fabs(apc_lgamma(x[i]) - lgamma(x[i])) <= 1e-14 * (1.0 + fabs(lgamma(x[i]))));
}

/* ---- Special values --------------------------------------------------------------------------- */

static void same(double got, double wanted)
{
    if (isnan(wanted)) {
        assert_true(isnan(got));
    } else if (bits_of(got) != bits_of(wanted)) {
        print_error("%a, expected %a\n", got, wanted);
        assert_true(false);
    }
}

static void special_values_are_as_iso_c_has_them(void **state)
{
    const double inf = (double)INFINITY, nan = (double)NAN;
    static const double each[] = {0.0,       -0.0,   1.0,           -1.0,    2.0,     -2.0,
                                  3.0,       -3.0,   0.5,           -0.5,    1e300,   -1e300,
                                  0x1p-1074, 0x1p53, -0x1p53 + 1.0, DBL_MAX, -DBL_MAX};
    double all[sizeof each / sizeof *each + 3];
    (void)state;
    memcpy(all, each, sizeof each);
    const size_t n = sizeof all / sizeof *all;
    all[n - 3] = inf;
    all[n - 2] = -inf;
    all[n - 1] = nan;
    for (size_t i = 0; i < n; i++) {
        const double x = all[i];
        if (x == 0.0 || isinf(x) || isnan(x)) { /* of others the value is looked at above */
            same(apc_exp(x), exp(x));
            same(apc_expm1(x), expm1(x));
            same(apc_sin(x), sin(x));
            same(apc_cos(x), cos(x));
            same(apc_atan(x), atan(x));
        }
        same(apc_lgamma(-fabs(x) - 0.5), nan);
        if (x <= 0.0 || isinf(x) || isnan(x) || x == 1.0) {
            same(apc_log(x), log(x));
            same(apc_log2(x), log2(x));
            same(apc_log10(x), log10(x));
        }
        for (size_t k = 0; k < n; k++) {
            const double y = all[k], power = pow(x, y), angle = atan2(x, y), side = hypot(x, y);
            if (isnan(power) || isinf(power) || power == 0.0 || fabs(power) == 1.0)
                same(apc_pow(x, y), power);
            if (isnan(angle) || angle == 0.0 || isinf(x) || isinf(y) || x == 0.0 || y == 0.0)
                same(apc_atan2(x, y), angle);
            if (isnan(side) || isinf(side) || x == 0.0 || y == 0.0)
                same(apc_hypot(x, y), side);
        }
    }
    same(apc_exp(710.0), inf);
    same(apc_exp(-746.0), 0.0);
    same(apc_exp(-745.0), 0x1p-1074);
    same(apc_log(0x1p-1074) / apc_log(2.0), -1074.0);
    same(apc_log2(0x1p-1074), -1074.0);
    same(apc_log2(0x1p1023), 1023.0);
    same(apc_log10(1000.0), 3.0);
    same(apc_pow(10.0, 22.0), 1e22);
    same(apc_pow(-2.0, 3.0), -8.0);
    same(apc_pow(2.0, -1074.0), 0x1p-1074);
    same(apc_hypot(3e307, 4e307), 5e307);
    same(apc_hypot(0x3p-1074, 0x4p-1074), 0x5p-1074);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_bits_are_those_of_every_machine),
#if LDBL_MANT_DIG >= 64
        cmocka_unit_test(they_are_within_a_unit_of_the_truth),
#endif
        cmocka_unit_test(an_angle_just_short_of_a_quarter_turn_keeps_its_digits),
        cmocka_unit_test(the_logarithm_of_the_gamma_function_is_near_the_truth),
        cmocka_unit_test(special_values_are_as_iso_c_has_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
