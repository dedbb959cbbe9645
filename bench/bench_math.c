/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The elementary functions of apcmath.h: their worst error against MPFR, and their time beside the C library's. Arguments
 * are ordinary ones, near 1, near a multiple of a quarter turn, small to large, and of every size, as many of each.
 */
#include <apcmath.h>

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <mpfr.h>
#include <stdlib.h>

#include "../tests/support/xorshift.h"
#include "bench.h"

#define ARGUMENTS                                                                                            \
    10000000 /* of which the worst is looked for: another number by ARGUMENTS of the environment */
#define TIMED     4096
#define KINDS     5
#define PRECISION 160

typedef double (*of_one)(double);
typedef double (*of_two)(double, double);
typedef int (*exact_one)(mpfr_t, const mpfr_t, mpfr_rnd_t);
typedef int (*exact_two)(mpfr_t, const mpfr_t, const mpfr_t, mpfr_rnd_t);

struct function {
    const char *name;
    bool positive; /* its argument, of two the first */
    of_one f, c_f;
    exact_one exact;
    of_two f2, c_f2; /* of two arguments */
    exact_two exact2;
};

static const struct function functions[] = {
    {.name = "exp", .f = apc_exp, .c_f = exp, .exact = mpfr_exp},
    {.name = "expm1", .f = apc_expm1, .c_f = expm1, .exact = mpfr_expm1},
    {.name = "log", .positive = true, .f = apc_log, .c_f = log, .exact = mpfr_log},
    {.name = "log2", .positive = true, .f = apc_log2, .c_f = log2, .exact = mpfr_log2},
    {.name = "log10", .positive = true, .f = apc_log10, .c_f = log10, .exact = mpfr_log10},
    {.name = "pow", .positive = true, .f2 = apc_pow, .c_f2 = pow, .exact2 = mpfr_pow},
    {.name = "sin", .f = apc_sin, .c_f = sin, .exact = mpfr_sin},
    {.name = "cos", .f = apc_cos, .c_f = cos, .exact = mpfr_cos},
    {.name = "atan", .f = apc_atan, .c_f = atan, .exact = mpfr_atan},
    {.name = "atan2", .f2 = apc_atan2, .c_f2 = atan2, .exact2 = mpfr_atan2},
    {.name = "hypot", .f2 = apc_hypot, .c_f2 = hypot, .exact2 = mpfr_hypot},
};

static uint64_t drawn;

/* Of either sign, with an exponent of @p low to @p high; subnormal below -1022. */
static double number(int low, int high)
{
    const double fraction = 1.0 + (double)(xorshift(&drawn) >> 12) * 0x1p-52;
    const int exponent = low + (int)(xorshift(&drawn) % (uint64_t)(high - low + 1));
    return copysign(ldexp(fraction, exponent), xorshift(&drawn) & 1 ? -1.0 : 1.0);
}

static double argument(uint64_t kind)
{
    switch (kind) {
    case 0:
        return number(-4, 4);
    case 1:
        return 1.0 + number(-40, -3);
    case 2:
        return (double)(int64_t)(xorshift(&drawn) % 2000001 - 1000000) * 1.57079632679489661923;
    case 3:
        return number(-40, 9);
    default:
        return number(-1073, 1023);
    }
}

/* What draws both arguments; @p y is of all kinds against all kinds of @p x. */
static void arguments(const struct function *f, uint64_t i, double *x, double *y)
{
    *x = argument(i % KINDS);
    *y = argument(i / KINDS % KINDS);
    if (f->positive)
        *x = fabs(*x);
}

/* In units of the last place of a result of this size. */
static double error_of(double result, const mpfr_t exact, mpfr_t difference)
{
    const long exponent = mpfr_get_exp(exact) - 53; /* MPFR's are of 0.5 to 1 */
    mpfr_sub_d(difference, exact, result, MPFR_RNDN);
    mpfr_mul_2si(difference, difference, -(exponent > -1074 ? exponent : -1074), MPFR_RNDN);
    return fabs(mpfr_get_d(difference, MPFR_RNDN));
}

static void print_worst(const struct function *f, uint64_t n)
{
    double worst = 0.0, worst_normal = 0.0, at = (double)NAN, at_y = (double)NAN, x, y;
    mpfr_t exact, of_x, of_y;
    mpfr_inits2(PRECISION, exact, of_x, of_y, (mpfr_ptr)NULL);
    drawn = UINT64_C(88172645463325252);
    for (uint64_t i = 0; i < n; i++) {
        arguments(f, i, &x, &y);
        const double result = f->f2 ? f->f2(x, y) : f->f(x);
        mpfr_set_d(of_x, x, MPFR_RNDN);
        mpfr_set_d(of_y, y, MPFR_RNDN);
        if (f->f2)
            f->exact2(exact, of_x, of_y, MPFR_RNDN);
        else
            f->exact(exact, of_x, MPFR_RNDN);
        const double rounded = mpfr_get_d(exact, MPFR_RNDN);
        if (!mpfr_regular_p(exact) || isinf(rounded) ||
            isinf(result)) { /* 0 and beyond the largest: as C has it */
            if (result != rounded || signbit(result) != signbit(rounded))
                die("%s(%a, %a) is %a, not %a", f->name, x, y, result, rounded);
            continue;
        }
        const double error = error_of(result, exact, of_x);
        if (fabs(rounded) >= DBL_MIN && error > worst_normal)
            worst_normal = error;
        if (error > worst) {
            worst = error;
            at = x;
            at_y = y;
        }
    }
    printf("%-6s %10.3f %10.3f   %a", f->name, worst, worst_normal, at);
    if (f->f2)
        printf(", %a", at_y);
    putchar('\n');
    fflush(stdout);
    mpfr_clears(exact, of_x, of_y, (mpfr_ptr)NULL);
}

struct call {
    const struct function *f;
    bool ours;
    double x[TIMED], y[TIMED], sum;
};

static void call_once(void *ctx)
{
    struct call *c = ctx;
    const of_one f = c->ours ? c->f->f : c->f->c_f;
    const of_two f2 = c->ours ? c->f->f2 : c->f->c_f2;
    double sum = 0.0;
    for (size_t i = 0; i < TIMED; i++)
        sum += f2 ? f2(c->x[i], c->y[i]) : f(c->x[i]);
    c->sum = sum; /* or the compiler would leave all of it out */
}

static void bench_function(struct bench *b, const struct function *f)
{
    struct call *calls = allocate(2, sizeof *calls);
    drawn = UINT64_C(88172645463325252);
    for (size_t i = 0; i < TIMED; i++) {
        const double x = argument(0);
        calls[0].x[i] = calls[1].x[i] = f->positive ? fabs(x) : x;
        calls[0].y[i] = calls[1].y[i] = argument(0);
    }
    calls[0].f = calls[1].f = f;
    calls[1].ours = true;
    struct bench_row rows[] = {{.name = "of the C library", .once = call_once, .ctx = &calls[0]},
                               {.name = "of libapc", .once = call_once, .ctx = &calls[1], .to = {&rows[0]}}};
    bench_run(b, f->name, TIMED, rows, sizeof rows / sizeof *rows);
    free(calls);
}

int main(int argc, char **argv)
{
    struct bench b = {
        .name = "math", .reference = {"C library"}, .calls = 200, .budget = 200 * APC_NS_PER_MS};
    const char *given = getenv("ARGUMENTS");
    const uint64_t n = given ? strtoull(given, NULL, 10) : ARGUMENTS;
    bench_begin(&b, argc, argv, "bench_math -- elementary functions: their error and their time");
    bench_describe(&b, NULL);
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++)
        bench_function(&b, &functions[i]);
    printf("\nworst error of %" PRIu64 " arguments, in units of the last place\n\n", n);
    printf("%-6s %10s %10s   %s\n", "", "all", "normal", "at");
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++)
        print_worst(&functions[i], n);
    bench_end(&b);
    return 0;
}
