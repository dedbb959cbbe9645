/* SPDX-License-Identifier: BSD-3-Clause */
/* apc_qp where H is singular: answers that are known, degenerate ones, and problems that have none. */
#include "apcqp.h"
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { VARIABLES = 24, RULES = 40, LIMITS = VARIABLES + RULES };

/* What a trial is made of. */
struct kind {
    size_t rank;       /* of H, at the most */
    double decades;    /* of the variables' units */
    double weak;       /* decades of H's eigenvalues */
    double degenerate; /* share of the rows that are at a limit: at 0.3 far more than there are variables */
};

struct flat {
    size_t n, m, rank;
    double H[VARIABLES * VARIABLES], A[RULES * VARIABLES], f[VARIABLES];
    double low[LIMITS], high[LIMITS];
    double unit[VARIABLES], x[VARIABLES], multiplier[LIMITS]; /* 1 / a variable's size; one of the answers */
    double objective, terms;
};

static double uniform(struct apc_random *random, double low, double high)
{
    return low + (high - low) * apc_random_uniform(random);
}

/** H = S G'G S of the rank, S being units. */
static void make_hessian(struct flat *p, struct apc_random *random, const struct kind *kind,
                         const double *unit)
{
    double G[VARIABLES * VARIABLES] = {0};

    for (size_t k = 0; k < p->rank; k++) {
        const double size = pow(10.0, -uniform(random, 0.0, kind->weak));

        for (size_t i = 0; i < p->n; i++)
            G[k * p->n + i] = size * apc_random_normal(random);
    }
    for (size_t i = 0; i < p->n; i++)
        for (size_t j = 0; j < p->n; j++) {
            double sum = 0.0;

            for (size_t k = 0; k < p->rank; k++)
                sum += G[k * p->n + i] * G[k * p->n + j];
            p->H[i * p->n + j] = sum * unit[i] * unit[j];
        }
}

/** Row i has an answer in its interval, or at a limit that pulls, or is an equation. */
static void make_limits(struct flat *p, struct apc_random *random, const struct kind *kind, size_t i,
                        double at, double size)
{
    const double which = apc_random_uniform(random) / kind->degenerate;

    p->low[i] = apc_random_uniform(random) < 0.3 ? -HUGE_VAL : at - size * uniform(random, 0.1, 1.1);
    p->high[i] = apc_random_uniform(random) < 0.3 ? HUGE_VAL : at + size * uniform(random, 0.1, 1.1);
    p->multiplier[i] = which < 1.1 ? uniform(random, 0.0, 1.0) / size : 0.0;
    if (which < 1.1 && which >= 1.0)
        p->low[i] = p->high[i] = at;
    else if (which < 0.5)
        p->high[i] = at;
    else if (which < 1.0)
        p->low[i] = at;
    if (which >= 0.5 && which < 1.0)
        p->multiplier[i] = -p->multiplier[i];
}

static void make_flat(struct flat *p, struct apc_random *random, const struct kind *kind)
{
    double *unit = p->unit;

    p->n = 2 + (size_t)uniform(random, 0.0, 22.0);
    p->m = (size_t)uniform(random, 0.0, (double)RULES);
    p->rank = (size_t)uniform(random, 0.0, (double)(kind->rank < p->n ? kind->rank + 1 : p->n));
    for (size_t i = 0; i < p->n; i++) {
        unit[i] = pow(10.0, kind->decades * uniform(random, -0.5, 0.5));
        p->x[i] = apc_random_normal(random) / unit[i];
    }
    make_hessian(p, random, kind, unit);
    for (size_t i = 0; i < p->m * p->n; i++)
        p->A[i] = apc_random_uniform(random) < 0.3 ? 0.0 : apc_random_normal(random) * unit[i % p->n];
    for (size_t i = 0; i < p->n + p->m; i++) {
        double at = i < p->n ? p->x[i] : 0.0;

        for (size_t j = 0; i >= p->n && j < p->n; j++)
            at += p->A[(i - p->n) * p->n + j] * p->x[j];
        make_limits(p, random, kind, i, at, i < p->n ? 1.0 / unit[i] : 1.0);
    }
    p->objective = p->terms = 0.0;
    for (size_t i = 0; i < p->n; i++) {
        double pull = p->multiplier[i], Hx = 0.0;

        for (size_t j = 0; j < p->n; j++)
            Hx += p->H[i * p->n + j] * p->x[j];
        for (size_t r = 0; r < p->m; r++)
            pull += p->A[r * p->n + i] * p->multiplier[p->n + r];
        p->f[i] = -Hx - pull;
        p->objective += p->x[i] * (0.5 * Hx + p->f[i]);
        p->terms += fabs(p->x[i] * Hx) + fabs(p->x[i] * p->f[i]);
    }
}

static struct apc_qp *make_qp(const struct flat *p, const struct apc_qp_options *options)
{
    struct apc_error why = {""};
    struct apc_qp *qp = NULL;

    if (apc_qp_create(&qp, p->n, p->m, options, &why) || apc_qp_set(qp, p->H, p->A, &why))
        fail_msg("%s", why.text);
    return qp;
}

/** The conditions of Karush, Kuhn and Tucker, the gradient over the largest of what it is made of in the variables'
 * own sizes; and no better and no worse than the answer that is known. */
static void assert_answer(const struct flat *p, const struct apc_qp *qp, const double *x,
                          const struct apc_qp_result *result)
{
    const double *pull = apc_qp_multipliers(qp);
    long double objective = 0.0L, worst = 0.0L, most = 0.0L;

    for (size_t i = 0; i < p->n; i++) {
        long double g = (long double)p->f[i] + (long double)pull[i], Hx = 0.0L;
        long double terms = fabsl((long double)p->f[i]) + fabsl((long double)pull[i]);

        for (size_t j = 0; j < p->n; j++) {
            Hx += (long double)p->H[i * p->n + j] * (long double)x[j];
            terms += fabsl((long double)p->H[i * p->n + j] * (long double)x[j]);
        }
        for (size_t r = 0; r < p->m; r++) {
            g += (long double)p->A[r * p->n + i] * (long double)pull[p->n + r];
            terms += fabsl((long double)p->A[r * p->n + i] * (long double)pull[p->n + r]);
        }
        assert_true(fabsl(g + Hx) <= (long double)result->dual + 1e-12L * (terms + 1.0L));
        worst = fmaxl(worst, fabsl(g + Hx) / (long double)p->unit[i]);
        most = fmaxl(most, terms / (long double)p->unit[i]);
        objective += (long double)x[i] * (0.5L * Hx + (long double)p->f[i]);
    }
    assert_true(worst <= 1e-8L * most + 1e-15L); /* f may be 0 */
    for (size_t i = 0; i < p->n + p->m; i++) {
        double at = i < p->n ? x[i] : 0.0;

        for (size_t j = 0; i >= p->n && j < p->n; j++)
            at += p->A[(i - p->n) * p->n + j] * x[j];
        assert_true(at <= p->high[i] + 2e-9 && at >= p->low[i] - 2e-9);
        assert_true(pull[i] <= 1e-9 || fabs(at - p->high[i]) <= 2e-9);
        assert_true(pull[i] >= -1e-9 || fabs(at - p->low[i]) <= 2e-9);
    }
    assert_near(result->objective, (double)objective, 1e-12 * (1.0 + p->terms));
    assert_near(result->objective, p->objective, 1e-7 * (1.0 + p->terms));
}

/* Promise(analysis/singular-programs): Of a convex quadratic program whose Hessian is singular, down to a linear
 *   program, the least value is found, and one x that has it. */
static void the_least_value_is_found_whatever_the_rank(void **state)
{
    static const struct {
        struct kind kind;
        int trials, unsolved;
    } of[] = {
        {{0, 0.0, 0.0, 0.1}, 1000, 0},         /* linear programs */
        {{VARIABLES, 0.0, 0.0, 0.1}, 1000, 0}, /* any rank below n */
        {{0, 0.0, 0.0, 0.3}, 500, 0},          /* and degenerate */
        {{VARIABLES, 0.0, 0.0, 0.3}, 500, 5},
        {{VARIABLES, 4.0, 0.0, 0.1}, 500, 5}, /* units that are 10 000 apart */
        {{VARIABLES, 0.0, 3.0, 0.1}, 500, 5}, /* and eigenvalues that are nearly 0 */
        {{VARIABLES, 0.0, 5.0, 0.1}, 500, 10},
    };
    struct apc_random random;

    (void)state;
    apc_random_init(&random, 31, "flat");
    for (size_t k = 0; k < sizeof of / sizeof of[0]; k++) {
        int unsolved = 0;
        unsigned most = 0;
        for (int trial = 0; trial < of[k].trials; trial++) {
            struct apc_qp_result result = {.size = sizeof result};
            struct flat p = {0};
            struct apc_qp *qp;
            double x[VARIABLES];

            make_flat(&p, &random, &of[k].kind);
            qp = make_qp(&p, NULL);
            if (apc_qp_solve(qp, p.f, p.low, p.high, x, &result) == 0)
                assert_answer(&p, qp, x, &result);
            else
                unsolved++;
            assert_true(result.status != APC_QP_UNBOUNDED);
            assert_true(result.steps > 0);
            most = result.steps > most ? result.steps : most;
            apc_qp_destroy(qp);
        }
        printf("kind %zu: %d of %d unsolved, at the most %u steps\n", k, unsolved, of[k].trials, most);
        assert_true(unsolved <= of[k].unsolved);
    }
}

/* Promise(analysis/singular-programs) */
static void an_objective_that_falls_for_ever_is_told_with_the_variables_that_run_off(void **state)
{
    static const struct {
        double H[9], A[3], f[3], low[4], high[4];
        signed char side[3];
    } of[] = {
        /* nothing holds x2 from below */
        {{1, 0, 0, 0, 0, 0, 0, 0, 1},
         {0, 0, 0},
         {1, 1, 1},
         {-9, -HUGE_VAL, -9, -HUGE_VAL},
         {9, 9, 9, 9},
         {0, -1, 0}},
        /* H sees x1 + x2 only, and the gradient their difference */
        {{1, 1, 0, 1, 1, 0, 0, 0, 1},
         {0, 0, 1},
         {-1, 1, 0},
         {-HUGE_VAL, -HUGE_VAL, 0, 0},
         {HUGE_VAL, HUGE_VAL, 9, 9},
         {1, -1, 0}},
        /* a linear program: the row holds x1 - x2 at 3, but not both */
        {{0}, {1, -1, 0}, {-1, -1, 0}, {0, 0, 0, 3}, {HUGE_VAL, HUGE_VAL, 1, 3}, {1, 1, 0}},
    };
    struct apc_error why = {""};

    (void)state;
    for (size_t k = 0; k < sizeof of / sizeof of[0]; k++) {
        struct apc_qp_result result = {.size = sizeof result};
        struct apc_qp *qp = NULL;
        double x[3], held[4];

        assert_int_equal(apc_qp_create(&qp, 3, 1, NULL, &why), 0);
        assert_int_equal(apc_qp_set(qp, of[k].H, of[k].A, &why), 0);
        for (int again = 0; again < 2; again++) {
            assert_int_equal(apc_qp_solve(qp, of[k].f, of[k].low, of[k].high, x, &result), APC_ERANGE);
            assert_int_equal(result.status, APC_QP_UNBOUNDED);
            assert_memory_equal(apc_qp_rows(qp), of[k].side, 3);
            for (size_t i = 0; i < 3; i++)
                assert_true(isfinite(x[i]));
            /* a limit, however far, and there is an answer at it */
            for (size_t i = 0; i < 4; i++)
                held[i] = of[k].high[i] == HUGE_VAL ? 1e6 : of[k].high[i];
            assert_int_equal(apc_qp_solve(qp, of[k].f,
                                          (const double[]){fmax(of[k].low[0], -1e6), fmax(of[k].low[1], -1e6),
                                                           of[k].low[2], of[k].low[3]},
                                          held, x, &result),
                             0);
            assert_near(fmax(fabs(x[0]), fabs(x[1])), 1e6, 1e-3);
        }
        apc_qp_destroy(qp);
    }
}

static void rows_that_contradict_are_told_from_an_objective_that_falls(void **state)
{
    const double H[4] = {0}, A[2] = {1.0, 1.0}, f[2] = {-1.0, 0.0};
    const double low[3] = {0.0, 0.0, -HUGE_VAL}, high[3] = {HUGE_VAL, HUGE_VAL, -1.0};
    struct apc_qp_result result = {.size = sizeof result};
    struct apc_error why;
    struct apc_qp *qp = NULL;
    double x[2];

    (void)state;
    assert_int_equal(apc_qp_create(&qp, 2, 1, NULL, &why), 0);
    assert_int_equal(apc_qp_set(qp, H, A, &why), 0);
    assert_int_equal(apc_qp_solve(qp, f, low, high, x, &result), APC_ERANGE);
    assert_int_equal(result.status, APC_QP_INFEASIBLE);
    assert_memory_equal(apc_qp_rows(qp), ((const signed char[]){-1, -1, 1}), 3);
    apc_qp_destroy(qp);
}

/* Also by little, beside what is large. */
static void an_indefinite_hessian_is_refused_in_words(void **state)
{
    static const double of[][4] = {
        {1.0, 0.0, 0.0, -1.0}, {1.0, 2.0, 2.0, 1.0}, {-1e-20, 0.0, 0.0, 0.0},
        {0.0, 1.0, 1.0, 0.0},  {0.0, 1.0, 1.0, 1.0}, {1.0, 1.0, 1.0, 1.0 - 1e-9},
    };
    const double flat[4] = {2.0, 0.0, 0.0, 0.0}, f[2] = {0.0}, low[2] = {-1.0, -1.0}, high[2] = {1.0, 1.0};
    const struct apc_qp_options strict = {.size = sizeof strict, .definite = true};
    struct apc_error why;
    struct apc_qp *qp = NULL;
    double x[2];

    (void)state;
    assert_int_equal(apc_qp_create(&qp, 2, 0, NULL, &why), 0);
    for (size_t k = 0; k < sizeof of / sizeof of[0]; k++) {
        assert_int_equal(apc_qp_set(qp, of[k], NULL, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "H of the QP is indefinite: pivot"));
        assert_int_equal(apc_qp_solve(qp, f, low, high, x, NULL), APC_EINVAL);
    }
    assert_int_equal(apc_qp_set(qp, flat, NULL, &why), 0);
    assert_int_equal(apc_qp_solve(qp, f, low, high, x, NULL), 0);
    apc_qp_destroy(qp);
    assert_int_equal(apc_qp_create(&qp, 2, 0, &strict, &why), 0);
    assert_int_equal(apc_qp_set(qp, flat, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "not positive definite: pivot 2 of 2"));
    apc_qp_destroy(qp);
}

/* minimise (x1 + x2 - 3)^2 / 2 + a softened x1 + x2 <= 1: the row gives way by its weights, as with any H. */
static void a_soft_row_gives_way_where_the_hessian_is_singular(void **state)
{
    static const struct {
        double linear, square, sum;
    } of[] = {{0.0, 0.0, 1.0}, {2.5, 0.0, 1.0}, {0.5, 0.0, 2.5}, {0.0, 1.0, 2.0}, {0.5, 1.0, 1.75}};
    const double H[4] = {1.0, 1.0, 1.0, 1.0}, A[2] = {1.0, 1.0}, f[2] = {-3.0, -3.0};
    const double low[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, high[3] = {HUGE_VAL, HUGE_VAL, 1.0};

    (void)state;
    for (size_t k = 0; k < sizeof of / sizeof of[0]; k++) {
        const double linear[3] = {0.0, 0.0, of[k].linear}, square[3] = {0.0, 0.0, of[k].square};
        struct apc_error why;
        struct apc_qp *qp = NULL;
        double x[2];

        assert_int_equal(apc_qp_create(&qp, 2, 1, NULL, &why), 0);
        assert_int_equal(apc_qp_set(qp, H, A, &why), 0);
        assert_int_equal(apc_qp_soft(qp, linear, square), 0);
        assert_int_equal(apc_qp_solve(qp, f, low, high, x, NULL), 0);
        assert_near(x[0] + x[1], of[k].sum, 1e-8);
        assert_near(x[0], x[1], 1e-8); /* of all of them that which is nearest to 0 */
        apc_qp_destroy(qp);
    }
}

/** FNV of the bits, of 50 problems of any rank. */
static uint64_t hash_answers(int solves)
{
    const struct kind kind = {VARIABLES, 0.0, 1.0, 0.1};
    uint64_t hash = UINT64_C(14695981039346656037);
    struct apc_random random;

    apc_random_init(&random, 32, "flat");
    for (int trial = 0; trial < 50; trial++) {
        struct flat p = {0};
        struct apc_qp *qp;
        double x[VARIABLES] = {0};
        unsigned char bytes[sizeof x];

        make_flat(&p, &random, &kind);
        qp = make_qp(&p, NULL);
        for (int again = 0; again < solves; again++)
            assert_int_equal(apc_qp_solve(qp, p.f, p.low, p.high, x, NULL), 0);
        memcpy(bytes, x, p.n * sizeof *x);
        for (size_t i = 0; i < p.n * sizeof *x; i++)
            hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
        apc_qp_destroy(qp);
    }
    return hash;
}

/* Promise(analysis/singular-programs) */
static void the_bits_of_one_of_several_answers_are_the_same_from_any_compiler_and_start(void **state)
{
    const uint64_t hash = hash_answers(1);

    (void)state;
    assert_true(hash == UINT64_C(0xb526ca7d5d9fc3c1));
    assert_true(hash_answers(2) == hash);
}

static void limits_of_iterations_hold_for_all_steps_together(void **state)
{
    const struct kind kind = {0, 0.0, 0.0, 0.1};
    struct apc_random random;
    int stopped = 0;

    (void)state;
    apc_random_init(&random, 33, "flat");
    for (int trial = 0; trial < 200; trial++) {
        const struct apc_qp_options few = {.size = sizeof few, .iterations = 5};
        struct apc_qp_result result = {.size = sizeof result};
        struct flat p = {0};
        struct apc_qp *qp;
        double x[VARIABLES];

        make_flat(&p, &random, &kind);
        qp = make_qp(&p, &few);
        if (apc_qp_solve(qp, p.f, p.low, p.high, x, &result) != 0) {
            assert_int_equal(result.status, APC_QP_LIMIT);
            assert_true(result.iterations < 10);
            stopped++;
        }
        for (size_t i = 0; i < p.n; i++)
            assert_true(isfinite(x[i]));
        apc_qp_destroy(qp);
    }
    assert_true(stopped > 50);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_least_value_is_found_whatever_the_rank),
        cmocka_unit_test(an_objective_that_falls_for_ever_is_told_with_the_variables_that_run_off),
        cmocka_unit_test(rows_that_contradict_are_told_from_an_objective_that_falls),
        cmocka_unit_test(an_indefinite_hessian_is_refused_in_words),
        cmocka_unit_test(a_soft_row_gives_way_where_the_hessian_is_singular),
        cmocka_unit_test(the_bits_of_one_of_several_answers_are_the_same_from_any_compiler_and_start),
        cmocka_unit_test(limits_of_iterations_hold_for_all_steps_together),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
