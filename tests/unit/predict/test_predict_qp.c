/* SPDX-License-Identifier: BSD-3-Clause */
/* apc_qp: whatever it calls optimal satisfies the optimality conditions, summed anew in long double. */
#include "apcqp.h"
#include "check.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define COUNTING 0 /* sanitizers bring their own allocator */
#else
#define COUNTING 1
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
#endif
static int allocations;

#if COUNTING
void *malloc(size_t size)
{
    allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    allocations++;
    return __libc_calloc(n, size);
}
#endif

enum { N_MOST = 24, M_MOST = 48, ROWS_MOST = N_MOST + M_MOST };

struct problem {
    size_t n, m;
    double H[N_MOST * N_MOST], A[M_MOST * N_MOST], f[N_MOST];
    double low[ROWS_MOST], high[ROWS_MOST], linear[ROWS_MOST], square[ROWS_MOST];
};

static double between(struct apc_random *random, double low, double high)
{
    return low + (high - low) * apc_random_uniform(random);
}

/** H = S (G'G + eps) S: @p spread decades of scale among the variables. */
static void make_cost(struct problem *p, struct apc_random *random, double spread)
{
    double G[N_MOST * N_MOST], scale[N_MOST];

    for (size_t i = 0; i < p->n; i++) {
        scale[i] = pow(10.0, between(random, -0.5, 0.5) * spread);
        for (size_t j = 0; j < p->n; j++)
            G[i * p->n + j] = apc_random_normal(random);
    }
    for (size_t i = 0; i < p->n; i++) {
        for (size_t j = 0; j < p->n; j++) {
            double sum = i == j ? 0.1 : 0.0;

            for (size_t k = 0; k < p->n; k++)
                sum += G[k * p->n + i] * G[k * p->n + j];
            p->H[i * p->n + j] = sum * scale[i] * scale[j];
        }
        p->f[i] = 10.0 * apc_random_normal(random) * scale[i];
    }
}

/** Limits around a point that satisfies them, some on one side only, some equations, a third of the rows
 * soft. */
static void make_rows(struct problem *p, struct apc_random *random, bool softness)
{
    double inside[N_MOST];
    size_t equations = 0;

    for (size_t i = 0; i < p->n; i++)
        inside[i] = apc_random_normal(random);
    for (size_t i = 0; i < p->n + p->m; i++) {
        double at = 0.0, kind = apc_random_uniform(random);

        if (i < p->n)
            at = inside[i];
        for (size_t j = 0; i >= p->n && j < p->n; j++) {
            double a = apc_random_uniform(random) < 0.3 ? 0.0 : apc_random_normal(random);

            p->A[(i - p->n) * p->n + j] = a;
            at += a * inside[j];
        }
        p->low[i] = kind < 0.3 ? -HUGE_VAL : at - between(random, 0.0, 0.5);
        p->high[i] = kind > 0.7 ? HUGE_VAL : at + between(random, 0.0, 0.5);
        if (kind > 0.45 && kind < 0.5 && equations < p->n / 4) {
            p->low[i] = p->high[i] = at;
            equations++;
        }
        p->linear[i] = p->square[i] = 0.0;
        if (softness && apc_random_uniform(random) < 0.4) {
            double much = between(random, -0.5, 0.5), which = apc_random_uniform(random);

            p->low[i] += much; /* it may be that it cannot be kept */
            p->high[i] += much;
            p->linear[i] = which < 0.7 ? between(random, 0.0, 20.0) : 0.0;
            p->square[i] = which > 0.4 ? between(random, 0.1, 100.0) : 0.0;
        }
    }
}

static long double row_at(const struct problem *p, size_t i, const double *x)
{
    long double sum = 0.0L;

    if (i < p->n)
        return (long double)x[i];
    for (size_t j = 0; j < p->n; j++)
        sum += (long double)p->A[(i - p->n) * p->n + j] * (long double)x[j];
    return sum;
}

/** How far row i is beyond a limit: < 0 within. */
static long double excess_of(const struct problem *p, size_t i, const double *x)
{
    long double at = row_at(p, i, x), above = at - (long double)p->high[i],
                below = (long double)p->low[i] - at;

    return above > below ? above : below;
}

/** Element i of Hx + f + (I, A')multiplier; *@p scale the sum of what it is made of. */
static long double gradient_of(const struct problem *p, size_t i, const double *x, const double *multiplier,
                               long double *scale)
{
    long double g = (long double)p->f[i] + (long double)multiplier[i];

    *scale = fabsl((long double)p->f[i]) + fabsl((long double)multiplier[i]) + 1e-12L;
    for (size_t j = 0; j < p->n; j++) {
        long double term = (long double)p->H[i * p->n + j] * (long double)x[j];

        g += term;
        *scale += fabsl(term);
    }
    for (size_t r = 0; r < p->m; r++) {
        long double term = (long double)p->A[r * p->n + i] * (long double)multiplier[p->n + r];

        g += term;
        *scale += fabsl(term);
    }
    return g;
}

/** The conditions of Karush, Kuhn and Tucker; with soft rows: |multiplier| = linear + square e where e > 0. */
static void assert_optimal(const struct problem *p, const double *x, const double *multiplier)
{
    for (size_t i = 0; i < p->n; i++) {
        long double scale, g = gradient_of(p, i, x, multiplier, &scale);

        assert_true(fabsl(g) <= 1e-9L * scale);
    }
    for (size_t i = 0; i < p->n + p->m; i++) {
        long double excess = excess_of(p, i, x), pull = fabsl((long double)multiplier[i]);
        long double linear = (long double)p->linear[i], square = (long double)p->square[i];
        bool soft = linear > 0.0L || square > 0.0L, violated = excess > 2e-9L;

        assert_true(soft || !violated);
        if (soft && violated)
            assert_true(fabsl(pull - linear - square * excess) <= 1e-6L * (1.0L + pull));
        if (soft && !violated)
            assert_true(pull <= linear + 1e-6L * (1.0L + pull));
        if (pull > 1e-7L) { /* it pulls from the limit that it is at, or beyond */
            long double limit = (long double)(multiplier[i] > 0.0 ? p->high[i] : p->low[i]);

            assert_true((multiplier[i] > 0.0 ? limit - row_at(p, i, x) : row_at(p, i, x) - limit) <= 2e-9L);
        }
    }
}

static struct apc_qp *make(const struct problem *p, struct apc_qp_options *options)
{
    struct apc_error why = {""};
    struct apc_qp *qp = NULL;

    options->size = sizeof *options;
    options->linear = p->linear;
    options->square = p->square;
    if (apc_qp_create(&qp, p->n, p->m, options, &why) || apc_qp_set(qp, p->H, p->A, &why))
        fail_msg("%s", why.text);
    return qp;
}

/*
 * Promise(analysis/quadratic-programs): Quadratic programs: optimal where it says so, the same bits from
 *   anywhere, contradictions by name, no allocation.
 */
static void what_is_called_optimal_is(void **state)
{
    struct apc_random random;
    struct problem p;

    (void)state;
    apc_random_init(&random, 7, "qp");
    for (int trial = 0; trial < 3000; trial++) {
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp;
        double x[N_MOST];

        p.n = 1 + (size_t)between(&random, 0.0, N_MOST);
        p.m = (size_t)between(&random, 0.0, M_MOST);
        make_cost(&p, &random, trial % 3 == 0 ? 4.0 : 0.0);
        make_rows(&p, &random, trial % 2);
        qp = make(&p, &(struct apc_qp_options){0});
        /* Each was made around a point that its hard rows allow. */
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, &result), 0);
        assert_int_equal(result.status, APC_QP_OPTIMAL);
        assert_optimal(&p, x, apc_qp_multipliers(qp));
        apc_qp_destroy(qp);
    }
}

/* Rows that stand there twice, with the same limits and weights of their own: one of them can be changed for
 * the other for ever, and nothing is gained. */
/* Promise(analysis/quadratic-programs) */
static void rows_that_stand_there_twice_do_not_take_turns(void **state)
{
    struct apc_random random;
    struct problem p;

    (void)state;
    apc_random_init(&random, 8, "qp twice");
    for (int trial = 0; trial < 10000; trial++) {
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp;
        double x[N_MOST];

        p.n = 1 + (size_t)between(&random, 0.0, 10.0);
        p.m = 2 + (size_t)between(&random, 0.0, 18.0);
        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, true);
        for (size_t r = 1; r < p.m; r++) {
            const size_t like = (size_t)between(&random, 0.0, (double)r);

            if (apc_random_uniform(&random) < 0.6)
                continue;
            memcpy(p.A + r * p.n, p.A + like * p.n, p.n * sizeof *p.A);
            p.low[p.n + r] = p.low[p.n + like];
            p.high[p.n + r] = p.high[p.n + like];
            p.linear[p.n + r] = p.linear[p.n + like] * (trial % 2 ? 1.0 : 0.5);
            p.square[p.n + r] = p.square[p.n + like];
        }
        qp = make(&p, &(struct apc_qp_options){0});
        for (int again = 0; again < 3; again++) {
            assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, &result), 0);
            assert_optimal(&p, x, apc_qp_multipliers(qp));
            for (size_t i = 0; i < p.n; i++)
                p.f[i] += 5.0 * apc_random_normal(&random);
        }
        apc_qp_destroy(qp);
    }
}

/* Variables whose units are up to a million apart: the answer may be "limit" or "numbers", never a wrong one. */
static void what_rounding_has_spoiled_is_not_called_optimal(void **state)
{
    struct apc_random random;
    struct problem p;
    int solved = 0;

    (void)state;
    apc_random_init(&random, 8, "qp");
    for (int trial = 0; trial < 1000; trial++) {
        struct apc_qp *qp;
        double x[N_MOST];

        p.n = 1 + (size_t)between(&random, 0.0, N_MOST);
        p.m = (size_t)between(&random, 0.0, M_MOST);
        make_cost(&p, &random, 6.0);
        make_rows(&p, &random, trial % 2);
        qp = make(&p, &(struct apc_qp_options){0});
        if (apc_qp_solve(qp, p.f, p.low, p.high, x, NULL) == 0) {
            assert_optimal(&p, x, apc_qp_multipliers(qp));
            solved++;
        }
        for (size_t i = 0; i < p.n; i++)
            assert_true(isfinite(x[i]));
        apc_qp_destroy(qp);
    }

    assert_true(solved > 900);
}

static void the_figures_that_come_back_are_those_of_x(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 12, .m = 20};

    (void)state;
    apc_random_init(&random, 9, "qp");
    for (int trial = 0; trial < 200; trial++) {
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp;
        const double *multiplier;
        double x[N_MOST];
        long double objective = 0.0L, soft = 0.0L, primal = 0.0L, dual = 0.0L;
        unsigned active = 0;

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, true);
        qp = make(&p, &(struct apc_qp_options){.iterations = trial % 2 ? 0 : 3});
        (void)apc_qp_solve(qp, p.f, p.low, p.high, x, &result);
        multiplier = apc_qp_multipliers(qp);
        for (size_t i = 0; i < p.n; i++) {
            long double scale, g = fabsl(gradient_of(&p, i, x, multiplier, &scale)), Hx = 0.0L;

            for (size_t j = 0; j < p.n; j++)
                Hx += (long double)p.H[i * p.n + j] * (long double)x[j];
            objective += (long double)x[i] * (0.5L * Hx + (long double)p.f[i]);
            dual = g > dual ? g : dual;
        }
        for (size_t i = 0; i < p.n + p.m; i++) {
            long double e = excess_of(&p, i, x);
            bool is_soft = p.linear[i] > 0.0 || p.square[i] > 0.0;

            active += apc_qp_rows(qp)[i] != 0;
            if (e > 0.0L && is_soft)
                soft += (long double)p.linear[i] * e + 0.5L * (long double)p.square[i] * e * e;
            if (e > primal && !is_soft)
                primal = e;
        }
        assert_near(result.objective, (double)objective, 1e-9 * (1.0 + fabs(result.objective)));
        assert_near(result.soft, (double)soft, 1e-9 * (1.0 + result.soft));
        assert_near(result.primal, (double)primal, 1e-11);
        assert_near(result.dual, (double)dual, 1e-9);
        assert_int_equal(result.active, active);
        apc_qp_destroy(qp);
    }
}

/* Alone, the rows that are named still contradict; without any one of them they no longer do. */
/* Promise(analysis/quadratic-programs) */
static void rows_that_contradict_are_named_and_no_others(void **state)
{
    struct apc_random random;
    struct problem p;
    int found = 0;

    (void)state;
    apc_random_init(&random, 10, "qp");
    for (int trial = 0; trial < 400; trial++) {
        double low[ROWS_MOST], high[ROWS_MOST], x[N_MOST];
        signed char side[ROWS_MOST];
        struct apc_qp *qp;
        size_t rows;
        int err;

        p.n = 1 + (size_t)between(&random, 0.0, 8.0);
        p.m = 1 + (size_t)between(&random, 0.0, 20.0);
        rows = p.n + p.m;
        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, false);
        for (size_t i = p.n; i < rows; i++)
            if (apc_random_uniform(&random) < 0.2)
                p.low[i] += 3.0, p.high[i] += 3.0;
        qp = make(&p, &(struct apc_qp_options){0});
        err = apc_qp_solve(qp, p.f, p.low, p.high, x, NULL);
        assert_true(err == 0 || err == APC_ERANGE);
        memcpy(side, apc_qp_rows(qp), rows);
        for (size_t left_out = 0; err && left_out <= rows; left_out++) {
            if (left_out < rows && !side[left_out])
                continue;
            for (size_t i = 0; i < rows; i++) {
                low[i] = side[i] < 0 && i != left_out ? p.low[i] : -HUGE_VAL;
                high[i] = side[i] > 0 && i != left_out ? p.high[i] : HUGE_VAL;
            }
            assert_int_equal(apc_qp_solve(qp, p.f, low, high, x, NULL), left_out < rows ? 0 : APC_ERANGE);
            found++;
        }
        apc_qp_destroy(qp);
    }
    assert_true(found > 100);
}

/* Reported of LinearMPC.jl: after one problem without a solution all that followed were called solved, with
 * NaN. */
static void without_a_solution_each_solve_says_so_and_the_next_problem_is_solved(void **state)
{
    const double H[] = {2.0, 0.0, 0.0, 1.0}, A[] = {1.0, 1.0}, f[] = {1.0, 1.0};
    const double low[] = {-1.0, -1.0, -1.0}, high[] = {1.0, 1.0, 1.0}, above[] = {-1.0, -1.0, 5.0};
    const double far_high[] = {1.0, 1.0, 9.0};
    struct apc_qp *qp = NULL;
    struct apc_error why;

    (void)state;
    assert_int_equal(apc_qp_create(&qp, 2, 1, NULL, &why), 0);
    assert_int_equal(apc_qp_set(qp, H, A, &why), 0);
    for (int k = 0; k < 5; k++) {
        struct apc_qp_result result = {.size = sizeof result};
        double x[2] = {7.0, 7.0};

        assert_int_equal(apc_qp_solve(qp, f, above, far_high, x, &result), APC_ERANGE);
        assert_int_equal(result.status, APC_QP_INFEASIBLE);
        assert_true(isfinite(x[0]) && isfinite(x[1]));
        if (k % 2 == 0)
            continue;
        assert_int_equal(apc_qp_solve(qp, f, low, high, x, &result), 0);
        assert_near(x[0], -1.0 / 3.0, 1e-9);
        assert_near(x[1], -2.0 / 3.0, 1e-9);
    }
    apc_qp_destroy(qp);
}

/* A row that multiplies nothing, whose limits 0 breaks: no other is in its way, whatever was solved before. */
/* Promise(analysis/quadratic-programs) */
static void a_row_of_zeros_contradicts_alone(void **state)
{
    struct apc_random random;
    struct problem p;

    (void)state;
    apc_random_init(&random, 15, "qp");
    for (int trial = 0; trial < 200; trial++) {
        double x[N_MOST];
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp;
        size_t zeros;

        p.n = 2 + (size_t)between(&random, 0.0, 8.0);
        p.m = 2 + (size_t)between(&random, 0.0, 20.0);
        zeros = p.n + p.m - 1;
        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, false);
        memset(p.A + (p.m - 1) * p.n, 0, p.n * sizeof(*p.A));
        p.low[zeros] = -1.0;
        p.high[zeros] = 1.0;
        qp = make(&p, &(struct apc_qp_options){0});
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        p.low[zeros] = 0.5;
        for (size_t i = 0; i < p.n; i++)
            p.f[i] *= 0.5; /* some of the working set leave */
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, &result), APC_ERANGE);
        assert_int_equal(result.status, APC_QP_INFEASIBLE);
        for (size_t i = 0; i < p.n + p.m; i++)
            assert_int_equal(apc_qp_rows(qp)[i], i == zeros ? -1 : 0);
        p.low[zeros] = -1.0;
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        apc_qp_destroy(qp);
    }
}

/* Promise(analysis/quadratic-programs) */
static void the_bits_do_not_depend_on_where_the_search_began(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 20, .m = 30};

    (void)state;
    apc_random_init(&random, 11, "qp");
    for (int trial = 0; trial < 100; trial++) {
        struct apc_qp *warm, *cold;

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, trial % 2);
        warm = make(&p, &(struct apc_qp_options){0});
        cold = make(&p, &(struct apc_qp_options){0});
        for (int step = 0; step < 20; step++) {
            double x[N_MOST], y[N_MOST];
            signed char rows[ROWS_MOST];
            size_t begin = (size_t)step % 3;

            for (size_t i = 0; i < p.n; i++)
                p.f[i] += apc_random_normal(&random);
            for (size_t i = 0; i < p.n + p.m; i++)
                rows[i] = (signed char)((int)between(&random, 0.0, 3.0) - 1);
            assert_int_equal(apc_qp_solve(warm, p.f, p.low, p.high, x, NULL), 0);
            apc_qp_start(cold, begin == 0 ? NULL : begin == 1 ? apc_qp_rows(warm) : rows);
            assert_int_equal(apc_qp_solve(cold, p.f, p.low, p.high, y, NULL), 0);
            assert_memory_equal(x, y, p.n * sizeof *x);
            assert_memory_equal(apc_qp_rows(warm), apc_qp_rows(cold), p.n + p.m);
        }
        apc_qp_destroy(warm);
        apc_qp_destroy(cold);
    }
}

/* Whoever compiled it: .ci/run has this test from gcc, with and without sanitizers, and from clang. */
static void the_bits_do_not_depend_on_the_compiler(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 23, .m = 37};
    uint64_t hash = UINT64_C(14695981039346656037);

    (void)state;
    apc_random_init(&random, 12, "qp");
    for (int trial = 0; trial < 50; trial++) {
        struct apc_qp *qp;
        double x[N_MOST];
        unsigned char bytes[sizeof x];

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, trial % 2);
        qp = make(&p, &(struct apc_qp_options){0});
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        memcpy(bytes, x, p.n * sizeof *x);
        for (size_t i = 0; i < p.n * sizeof *x; i++)
            hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
        apc_qp_destroy(qp);
    }
    assert_true(hash == UINT64_C(0x1b91e524a1d44186));
}

static void a_solve_that_was_stopped_is_of_its_multipliers_and_goes_on(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 24, .m = 40};
    int stopped = 0;

    (void)state;
    apc_random_init(&random, 13, "qp");
    for (int trial = 0; trial < 100; trial++) {
        struct apc_qp_result best = {.size = sizeof best}, result = {.size = sizeof result};
        struct apc_qp *whole, *cut;
        double x[N_MOST], y[N_MOST];
        int err;

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, trial % 2);
        whole = make(&p, &(struct apc_qp_options){0});
        cut = make(&p, &(struct apc_qp_options){.iterations = 4});
        assert_int_equal(apc_qp_solve(whole, p.f, p.low, p.high, x, &best), 0);
        for (int round = 0; (err = apc_qp_solve(cut, p.f, p.low, p.high, y, &result)) != 0; round++) {
            assert_int_equal(err, APC_ETIMEDOUT);
            assert_int_equal(result.status, APC_QP_LIMIT);
            assert_true(result.primal + result.soft > 0.0);
            /* x is that of multipliers which are allowed: x = -H^-1 (f + A' multipliers) */
            for (size_t i = 0; i < p.n; i++) {
                long double scale, g = gradient_of(&p, i, y, apc_qp_multipliers(cut), &scale);

                assert_true(fabsl(g) <= 1e-9L * scale);
            }
            for (size_t i = 0; i < p.n + p.m; i++) {
                bool soft = p.linear[i] > 0.0 || p.square[i] > 0.0;

                assert_true(apc_qp_multipliers(cut)[i] <= 0.0 || isfinite(p.high[i]));
                assert_true(apc_qp_multipliers(cut)[i] >= 0.0 || isfinite(p.low[i]));
                assert_true(!soft || p.square[i] > 0.0 ||
                            fabs(apc_qp_multipliers(cut)[i]) <= p.linear[i] * (1.0 + 1e-12));
            }
            assert_true(round < 100);
            stopped++;
        }
        assert_memory_equal(x, y, p.n * sizeof *x);
        apc_qp_destroy(whole);
        apc_qp_destroy(cut);
    }
    assert_true(stopped > 100);
}

static bool after_two(void *ctx)
{
    return ++*(int *)ctx >= 2;
}

static void whoever_has_had_enough_is_asked_at_each_change(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 24, .m = 40};
    struct apc_qp_result result = {.size = sizeof result};
    struct apc_qp *qp;
    double x[N_MOST];
    int asked = 0;

    (void)state;
    apc_random_init(&random, 14, "qp");
    make_cost(&p, &random, 0.0);
    make_rows(&p, &random, false);
    qp = make(&p, &(struct apc_qp_options){.enough = after_two, .ctx = &asked});
    assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, &result), APC_ETIMEDOUT);
    assert_int_equal(result.status, APC_QP_LIMIT);
    assert_int_equal(asked, 2);
    apc_qp_destroy(qp);
}

/* minimise x^2 / 2 - 3 x with x <= 1: the pull of the limit is 2. */
static void a_soft_row_gives_way_by_its_weights(void **state)
{
    static const struct {
        double linear, square, x, multiplier;
    } of[] = {
        {0.0, 0.0, 1.0, 2.0},   /* hard */
        {2.5, 0.0, 1.0, 2.0},   /* exact: worth more than it pulls */
        {2.5, 7.0, 1.0, 2.0},   /* the square does not matter then */
        {0.5, 0.0, 2.5, 0.5},   /* pulls no more than its price */
        {0.0, 1.0, 2.0, 1.0},   /* x - 3 + (x - 1) = 0 */
        {0.5, 1.0, 1.75, 1.25}, /* x - 3 + 0.5 + (x - 1) = 0 */
        {0.0, 1e6, 1.000001999998, 1.999998000002},
    };
    const double H = 1.0, f = -3.0, low = -HUGE_VAL, high = 1.0, none = HUGE_VAL;

    (void)state;
    for (size_t k = 0; k < sizeof of / sizeof of[0]; k++) {
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp;
        double x;

        assert_int_equal(apc_qp_create(&qp, 1, 0, NULL, NULL), 0);
        assert_int_equal(apc_qp_set(qp, &H, NULL, NULL), 0);
        assert_int_equal(apc_qp_soft(qp, &of[k].linear, &of[k].square), 0);
        assert_int_equal(apc_qp_solve(qp, &f, &low, &high, &x, &result), 0);
        assert_near(x, of[k].x, 1e-9);
        /* the row comes in, and where it has a price that is paid, gives way */
        assert_int_equal(result.iterations, of[k].linear > 0.0 && of[k].x > 1.0 ? 2 : 1);
        assert_near(apc_qp_multipliers(qp)[0], of[k].multiplier, 1e-9);
        assert_int_equal(apc_qp_rows(qp)[0], 1);
        assert_near(result.soft, of[k].linear * (x - 1.0) + 0.5 * of[k].square * (x - 1.0) * (x - 1.0), 1e-9);
        assert_int_equal(apc_qp_soft(qp, NULL, NULL), 0); /* weights are tuning: hard from now on */
        assert_int_equal(apc_qp_solve(qp, &f, &low, &high, &x, NULL), 0);
        assert_near(x, 1.0, 1e-9);
        assert_int_equal(apc_qp_solve(qp, &f, &low, &none, &x, NULL), 0); /* and none at all */
        assert_near(x, 3.0, 1e-9);
        assert_int_equal(apc_qp_rows(qp)[0], 0);
        apc_qp_destroy(qp);
    }
}

static void another_cost_keeps_the_working_set(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 10, .m = 15};

    (void)state;
    apc_random_init(&random, 15, "qp");
    for (int trial = 0; trial < 50; trial++) {
        struct apc_error why;
        struct apc_qp *qp;
        double x[N_MOST];

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, trial % 2);
        qp = make(&p, &(struct apc_qp_options){0});
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        for (size_t i = 0; i < p.n; i++)
            p.H[i * p.n + i] *= 1.5;
        assert_int_equal(apc_qp_set(qp, p.H, p.A, &why), 0);
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        assert_optimal(&p, x, apc_qp_multipliers(qp));
        apc_qp_destroy(qp);
    }
}

/* What held as an equation pulls either way; as a limit it may not any more. */
/* Promise(analysis/quadratic-programs) */
static void limits_may_become_equations_and_limits_again(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 12};

    (void)state;
    apc_random_init(&random, 21, "qp");
    for (int trial = 0; trial < 100; trial++) {
        struct problem now;
        struct apc_qp *qp;

        make_cost(&p, &random, 0.0);
        make_rows(&p, &random, trial % 2);
        now = p;
        qp = make(&p, &(struct apc_qp_options){0});
        for (int step = 0; step < 20; step++) {
            double x[N_MOST];

            for (size_t i = 0; i < p.n; i++) {
                const bool equation = apc_random_uniform(&random) < 0.3;
                const double at = isfinite(p.high[i]) ? p.high[i] : isfinite(p.low[i]) ? p.low[i] : 0.0;

                now.low[i] = equation ? at : p.low[i];
                now.high[i] = equation ? at : p.high[i];
                now.f[i] += 5.0 * apc_random_normal(&random);
            }
            assert_int_equal(apc_qp_solve(qp, now.f, now.low, now.high, x, NULL), 0);
            assert_optimal(&now, x, apc_qp_multipliers(qp));
        }
        apc_qp_destroy(qp);
    }
}

static void bad_input_is_refused_and_leaves_x_finite(void **state)
{
    const double H[] = {2.0, 0.0, 0.0, 1.0}, A[] = {1.0, 1.0}, f[] = {1.0, 1.0}, nan2[] = {0.0, (double)NAN};
    const double low[] = {-1.0, -1.0, -1.0}, high[] = {1.0, 1.0, 1.0}, crossed[] = {1.0, 2.0, 1.0};
    const double broken[] = {-1.0, (double)NAN, -1.0}, never[] = {-1.0, HUGE_VAL, -1.0};
    const double saddle[] = {2.0, 3.0, 3.0, 1.0}, minus[] = {0.0, 0.0, -1.0}, huge[] = {1e200, 1e200};
    struct apc_qp_result result = {.size = sizeof result};
    struct apc_qp *qp = NULL;
    struct apc_error why;
    double x[2] = {7.0, 7.0};

    (void)state;
    assert_int_equal(apc_qp_create(NULL, 1, 0, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_qp_create(&qp, 0, 1, NULL, &why), APC_EINVAL);
    assert_null(qp);
    assert_int_equal(apc_qp_create(&qp, 16000, 16000, NULL, &why), APC_EINVAL);
    assert_int_equal(
        apc_qp_create(&qp, 2, 1,
                      &(struct apc_qp_options){.size = sizeof(struct apc_qp_options), .linear = minus}, &why),
        APC_EINVAL);
    assert_int_equal(
        apc_qp_create(&qp, 2, 1,
                      &(struct apc_qp_options){.size = sizeof(struct apc_qp_options), .tolerance = -1.0},
                      &why),
        APC_EINVAL);
    assert_int_equal(apc_qp_create(&qp, 2, 1, NULL, &why), 0);
    assert_int_equal(apc_qp_solve(qp, f, low, high, x, &result), APC_EINVAL); /* no H yet */
    assert_int_equal(result.status, APC_QP_NUMBERS);
    assert_true(isfinite(x[0]) && isfinite(x[1]));
    assert_int_equal(apc_qp_set(qp, NULL, A, &why), APC_EINVAL);
    assert_int_equal(apc_qp_set(qp, H, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_qp_set(qp, saddle, A, &why), APC_EINVAL);
    assert_int_equal(apc_qp_set(qp, H, nan2, &why), APC_EINVAL);
    assert_int_equal(apc_qp_solve(qp, f, low, high, x, &result), APC_EINVAL); /* the last one was refused */
    assert_int_equal(apc_qp_set(qp, H, A, &why), 0);
    assert_int_equal(apc_qp_solve(qp, nan2, low, high, x, &result), APC_EINVAL);
    assert_int_equal(apc_qp_solve(qp, f, broken, high, x, &result), APC_EINVAL);
    assert_int_equal(apc_qp_solve(qp, f, never, high, x, &result), APC_EINVAL);
    assert_int_equal(apc_qp_solve(qp, f, crossed, high, x, &result), APC_ERANGE);
    assert_int_equal(result.status, APC_QP_INFEASIBLE);
    assert_true(apc_qp_rows(qp)[1] != 0 && apc_qp_rows(qp)[0] == 0);
    assert_int_equal(apc_qp_solve(qp, huge, low, high, x, &result), 0); /* the row holds it */
    assert_near(x[0], -1.0 / 3.0, 1e-9);
    assert_int_equal(apc_qp_soft(qp, minus, NULL), APC_EINVAL);
    assert_int_equal(apc_qp_soft(NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_qp_solve(qp, f, low, high, x, NULL), 0); /* and after all that */
    assert_near(x[0], -1.0 / 3.0, 1e-9);
    apc_qp_destroy(qp);
    apc_qp_destroy(NULL);
}

/* Promise(analysis/quadratic-programs) */
static void a_solve_allocates_nothing(void **state)
{
    struct apc_random random;
    struct problem p = {.n = 24, .m = 40};
    struct apc_qp *qp;
    double x[N_MOST];
    int before;

    (void)state;
    if (!COUNTING)
        skip();
    apc_random_init(&random, 16, "qp");
    make_cost(&p, &random, 0.0);
    make_rows(&p, &random, true);
    qp = make(&p, &(struct apc_qp_options){0});
    before = allocations;
    for (int k = 0; k < 20; k++) {
        for (size_t i = 0; i < p.n; i++)
            p.f[i] += apc_random_normal(&random);
        assert_int_equal(apc_qp_set(qp, p.H, p.A, NULL), 0);
        assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
    }
    for (size_t i = 0; i < p.n; i++)
        p.H[i * p.n] = p.H[i] = 0.0; /* singular */
    assert_int_equal(apc_qp_set(qp, p.H, p.A, NULL), 0);
    (void)apc_qp_solve(qp, p.f, p.low, p.high, x, NULL);
    assert_int_equal(allocations, before);
    apc_qp_destroy(qp);
}

/* Soft rows that repeat hard ones, and want something else: their multipliers cancel each other, and are far
 * larger than all that x itself weighs. */
/* Promise(laws): A row that a limit pulls against is no doubt about a quadratic program's answer. */
static void a_soft_row_against_a_hard_one_is_no_doubt_about_the_answer(void **state)
{
    const double linear[6] = {0}, square[6] = {0, 0, 0, 0, 1e4, 1e4}, f[2] = {0};
    const struct apc_qp_options options = {.size = sizeof options, .linear = linear, .square = square};
    struct apc_random random;
    (void)state;

    apc_random_init(&random, 7, "against");
    for (int k = 0; k < 300; k++) {
        const double low[6] = {-HUGE_VAL, -HUGE_VAL, 0, 0, 1, 0}, high[6] = {HUGE_VAL, HUGE_VAL, 0, 0, 1, 0};
        double A[8], H[4] = {0}, x[2];
        struct apc_qp *qp;
        struct apc_error why;

        for (int i = 0; i < 4; i++) {
            A[i] = (i % 3 ? 0.05 : 1.0) * (0.1 + apc_random_uniform(&random));
            A[4 + i] = A[i] * (1 + (apc_random_uniform(&random) - 0.5) * 1e-15);
        }
        for (int i = 0; i < 4; i++)
            H[i] = A[i / 2] * A[i % 2] + A[2 + i / 2] * A[2 + i % 2];
        assert_int_equal(apc_qp_create(&qp, 2, 4, &options, &why), 0);
        assert_int_equal(apc_qp_set(qp, H, A, &why), 0);
        assert_int_equal(apc_qp_solve(qp, f, low, high, x, NULL), 0);
        assert_near(x[0], 0, 1e-9);
        assert_near(x[1], 0, 1e-9);
        apc_qp_destroy(qp);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_called_optimal_is),
        cmocka_unit_test(rows_that_stand_there_twice_do_not_take_turns),
        cmocka_unit_test(what_rounding_has_spoiled_is_not_called_optimal),
        cmocka_unit_test(the_figures_that_come_back_are_those_of_x),
        cmocka_unit_test(rows_that_contradict_are_named_and_no_others),
        cmocka_unit_test(without_a_solution_each_solve_says_so_and_the_next_problem_is_solved),
        cmocka_unit_test(a_row_of_zeros_contradicts_alone),
        cmocka_unit_test(the_bits_do_not_depend_on_where_the_search_began),
        cmocka_unit_test(the_bits_do_not_depend_on_the_compiler),
        cmocka_unit_test(a_solve_that_was_stopped_is_of_its_multipliers_and_goes_on),
        cmocka_unit_test(whoever_has_had_enough_is_asked_at_each_change),
        cmocka_unit_test(a_soft_row_gives_way_by_its_weights),
        cmocka_unit_test(a_soft_row_against_a_hard_one_is_no_doubt_about_the_answer),
        cmocka_unit_test(another_cost_keeps_the_working_set),
        cmocka_unit_test(limits_may_become_equations_and_limits_again),
        cmocka_unit_test(bad_input_is_refused_and_leaves_x_finite),
        cmocka_unit_test(a_solve_allocates_nothing),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
