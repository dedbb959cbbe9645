/* SPDX-License-Identifier: BSD-3-Clause */
/* Random numbers: known answers, independence of streams, moments of the distributions, their text. */
#include "check.h"

#include <string.h>

#include <apcbase.h>

#define N 200000

/* Worked out from the published recurrence, apart from this code. */
static void generator_is_xoshiro256pp(void **state)
{
    struct apc_random r = {{1, 2, 3, 4}};
    (void)state;
    assert_int_equal(apc_random_next(&r), UINT64_C(41943041));
    assert_int_equal(apc_random_next(&r), UINT64_C(58720359));
    assert_int_equal(apc_random_next(&r), UINT64_C(3588806011781223));
    assert_int_equal(apc_random_next(&r), UINT64_C(3591011842654386));
}

static void same_seed_and_name_give_the_same_numbers(void **state)
{
    struct apc_random a, b;
    (void)state;
    apc_random_init(&a, 7, "network.delay");
    apc_random_init(&b, 7, "network.delay");
    for (int i = 0; i < 1000; i++)
        assert_int_equal(apc_random_next(&a), apc_random_next(&b));
}

static void other_names_and_seeds_give_uncorrelated_numbers(void **state)
{
    static const struct {
        uint64_t seed;
        const char *name;
    } other[] = {{1, "b"}, {2, "a"}, {0, "a"}, {UINT64_MAX, "a"}, {1, NULL}};
    (void)state;
    for (size_t k = 0; k < sizeof other / sizeof *other; k++) {
        struct apc_random a, b;
        double sum = 0;
        apc_random_init(&a, 1, "a");
        apc_random_init(&b, other[k].seed, other[k].name);
        for (int i = 0; i < N; i++)
            sum += (apc_random_uniform(&a) - 0.5) * (apc_random_uniform(&b) - 0.5);
        assert_near(sum / N * 12, 0.0, 5.0 / sqrt(N));
    }
}

struct moments {
    double mean, sd, skewness, low, high;
};

static struct moments moments_of(const struct apc_distribution *d)
{
    struct apc_random r;
    struct moments m = {.low = HUGE_VAL, .high = -HUGE_VAL};
    static double x[N];
    double second = 0, third = 0;

    apc_random_init(&r, 3, "moments");
    for (int i = 0; i < N; i++) {
        x[i] = apc_distribution_draw(d, &r);
        m.mean += x[i] / N;
        m.low = fmin(m.low, x[i]);
        m.high = fmax(m.high, x[i]);
    }
    for (int i = 0; i < N; i++) {
        second += (x[i] - m.mean) * (x[i] - m.mean) / N;
        third += pow(x[i] - m.mean, 3) / N;
    }
    m.sd = sqrt(second);
    m.skewness = second > 1e-20 ? third / pow(second, 1.5) : 0;
    return m;
}

/* Promise(simulation/distributions): Delays have the distributions that are stated, also recorded ones. */
static void draws_have_the_moments_of_their_distribution(void **state)
{
    static const struct {
        const char *text;
        double mean, sd, skewness, low;
    } cases[] = {
        {"0.004", 0.004, 0, 0, 0.004},
        {"constant(-2)", -2, 0, 0, -2},
        {"uniform(1, 3)", 2, 0.57735, 0, 1},
        {"uniform(2,2)", 2, 0, 0, 2},
        {"normal(5, 2)", 5, 2, 0, -HUGE_VAL},
        {"normal( 5 , 0 )", 5, 0, 0, 5},
        {"exponential(0.25)", 0.25, 0.25, 2, 0},
        {"gamma(4, 0.5)", 2, 1, 1, 0},
        {"gamma(0.5, 2)", 1, 1.41421, 2.82843, 0},
        {"gamma(1.5, 2)", 3, 2.44949, 1.63299, 0},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_distribution d;
        assert_int_equal(apc_distribution_parse(cases[i].text, &d, NULL), 0);
        struct moments m = moments_of(&d);
        assert_near(m.mean, cases[i].mean, 0.005 * (fabs(cases[i].mean) + cases[i].sd));
        assert_near(m.sd, cases[i].sd, 0.01 * cases[i].sd + 1e-10);
        assert_near(m.skewness, cases[i].skewness, 0.1);
        assert_true(m.low >= cases[i].low);
        assert_true(apc_distribution_low(&d) == cases[i].low);
        assert_near(apc_distribution_mean(&d), cases[i].mean, 0);
    }
}

/* Promise(simulation/distributions) */
static void recorded_draws_follow_their_histogram(void **state)
{
    static const struct apc_share shares[] = {{0, 1, 0.25}, {2, 2, 0.75}, {4, 6, 1.0}};
    const struct apc_distribution d = {.kind = APC_RECORDED, .shares = shares, .n_shares = 3};
    struct apc_random r;
    int in[3] = {0};
    (void)state;
    apc_random_init(&r, 1, "recorded");
    for (int i = 0; i < N; i++) {
        double x = apc_distribution_draw(&d, &r);
        int k = x < 1 ? 0 : x == 2 ? 1 : 2;
        assert_true(x >= shares[k].low && x <= shares[k].high);
        in[k]++;
    }
    assert_near((double)in[0] / N, 0.25, 0.005);
    assert_near((double)in[1] / N, 0.50, 0.005);
    assert_true(apc_distribution_low(&d) == 0);
    assert_near(apc_distribution_mean(&d), 0.25 * 0.5 + 0.5 * 2 + 0.25 * 5, 0);
}

/* Recorded runs are made again from their seed, on any machine and by any later version. */
static void a_seed_and_a_name_stand_for_the_same_numbers_for_ever(void **state)
{
    static const uint64_t noise[] = {UINT64_C(0xfae2e739bfd36c0e), UINT64_C(0xda9537a4b199e2f9),
                                     UINT64_C(0xab500197020ac0c6)};
    struct apc_random random;
    (void)state;
    apc_random_init(&random, 1, "plant.noise.1");
    for (size_t i = 0; i < sizeof noise / sizeof *noise; i++)
        assert_true(apc_random_next(&random) == noise[i]);
    apc_random_init(&random, 2, NULL);
    assert_true(apc_random_next(&random) == UINT64_C(0xf03dff56ee8d0b36));
    /* which of its tries are thrown away, and so where the stream is after them */
    const struct apc_distribution gamma = {.kind = APC_GAMMA, .a = 0.5, .b = 2.0};
    apc_random_init(&random, 1, "gamma");
    for (int i = 0; i < N; i++)
        apc_distribution_draw(&gamma, &random);
    assert_true(apc_random_next(&random) == UINT64_C(0x836e23877bdb14a7));
}

/* Promise(simulation/distributions) */
static void what_is_no_distribution_is_refused(void **state)
{
    static const char *const bad[] = {"",
                                      "cauchy(1)",
                                      "normal",
                                      "normal(1)",
                                      "normal(1,2",
                                      "normal(1,2,3)",
                                      "normal(1,2) x",
                                      "normal(1,-2)",
                                      "normal(a,2)",
                                      "uniform(2,1)",
                                      "exponential(0)",
                                      "exponential(-1)",
                                      "gamma(0,1)",
                                      "gamma(1,0)",
                                      "nan",
                                      "uniform(0,inf)",
                                      "normal()",
                                      "normal(1,,2)",
                                      "(1)",
                                      "1 2"};
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct apc_distribution d;
        struct apc_error why = {""};
        assert_int_equal(apc_distribution_parse(bad[i], &d, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "expected"));
    }
    struct apc_distribution d;
    assert_int_equal(apc_distribution_parse(NULL, &d, NULL), APC_EINVAL);
    assert_int_equal(apc_distribution_parse("1", NULL, NULL), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(generator_is_xoshiro256pp),
        cmocka_unit_test(same_seed_and_name_give_the_same_numbers),
        cmocka_unit_test(other_names_and_seeds_give_uncorrelated_numbers),
        cmocka_unit_test(draws_have_the_moments_of_their_distribution),
        cmocka_unit_test(recorded_draws_follow_their_histogram),
        cmocka_unit_test(a_seed_and_a_name_stand_for_the_same_numbers_for_ever),
        cmocka_unit_test(what_is_no_distribution_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
