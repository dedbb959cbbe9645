/* SPDX-License-Identifier: BSD-3-Clause */
/* How early a task that spins wakes up, learned from how late its wake-ups were. */
#include "check.h"
#include "timer/timer_internal.h"
#include "timer_test.h"

#define US APC_NS_PER_US
#define MS APC_NS_PER_MS

static void learn(struct apc_margin *m, apc_ns lateness, unsigned times)
{
    for (unsigned i = 0; i < times; i++)
        apc_margin_learn(m, lateness);
}

static void at_first_the_margin_is_as_long_as_it_may_be(void **state)
{
    struct apc_margin m;
    (void)state;
    apc_margin_init(&m, MS);
    assert_int_equal(m.margin, MS / 8);
    apc_margin_init(&m, 10 * APC_NS_PER_S);
    assert_int_equal(m.margin, 500 * US);
    apc_margin_init(&m, 10 * US);
    assert_int_equal(m.margin, 10 * US / 8);
}

static void the_level_is_the_percentile_of_the_last_thousand(void **state)
{
    enum { N = 5000 };
    static unsigned us[N];
    struct apc_margin m;
    uint64_t random = seed();
    (void)state;

    apc_margin_init(&m, APC_NS_PER_S);
    for (unsigned i = 0; i < N; i++) {
        unsigned scale = 1 + i / 10 % 400; /* the distribution changes all the time, up and down */
        us[i] = (unsigned)(xorshift(&random) % (xorshift(&random) % 100 ? scale : 100 * scale));
        apc_margin_learn(&m, us[i] * US + (apc_ns)(xorshift(&random) % 1000));

        unsigned first = i < APC_MARGIN_WINDOW ? 0 : i + 1 - APC_MARGIN_WINDOW, n = i + 1 - first;
        unsigned above = 0, not_below = 0;
        for (unsigned k = first; k <= i; k++) {
            unsigned value = us[k] < APC_MARGIN_BINS ? us[k] : APC_MARGIN_BINS - 1;
            above += value > m.level;
            not_below += value >= m.level;
        }
        assert_int_equal(m.n, n);
        assert_int_equal(m.above, above);
        assert_true(above <= n / 500);
        assert_true(m.level == 0 || not_below > n / 500); /* a smaller level would not do */
    }
}

static void the_margin_covers_the_level_and_little_more(void **state)
{
    struct apc_margin m;
    (void)state;
    apc_margin_init(&m, APC_NS_PER_S);
    learn(&m, 40 * US, 1);
    assert_true(m.margin >= 80 * US && m.margin < 90 * US); /* of the tail nothing is known yet */
    learn(&m, 40 * US, 2000);
    assert_true(m.margin >= 41 * US && m.margin < 50 * US);
    learn(&m, 15 * US, 1000);
    assert_true(m.margin >= 16 * US && m.margin < 20 * US);
    learn(&m, 90 * US, 10);
    assert_true(m.margin >= 90 * US && m.margin < 110 * US);
}

static void a_hiccup_does_not_count_and_many_stay_within_the_bounds(void **state)
{
    struct apc_margin m;
    (void)state;
    apc_margin_init(&m, MS);
    learn(&m, 20 * US, 1000);
    apc_ns quiet = m.margin;
    learn(&m, 5 * MS, 2);
    assert_int_equal(m.margin, quiet);
    learn(&m, INT64_MAX, 998);
    assert_int_equal(m.margin, MS / 8);
    apc_margin_learn(&m, -1); /* woken up too early: no lateness */
    learn(&m, 20 * US, 999);
    assert_int_equal(m.margin, quiet);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(at_first_the_margin_is_as_long_as_it_may_be),
        cmocka_unit_test(the_level_is_the_percentile_of_the_last_thousand),
        cmocka_unit_test(the_margin_covers_the_level_and_little_more),
        cmocka_unit_test(a_hiccup_does_not_count_and_many_stay_within_the_bounds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
