/* SPDX-License-Identifier: BSD-3-Clause */
/* What apc replay --figure keeps of a season: little, and each spike. */
#include "check.h"

#include <math.h>

#include "apc/simulate/replay_curves.h"

#define TICKS   500000
#define DIFFERS 400000

static double recorded_at(long i)
{
    return i == 1234 ? 100.0 : i == 5678 ? -100.0 : i == 1230 ? (double)NAN : (double)(i % 7);
}

static bool has_point(const struct replay_curve *c, double t, double recorded)
{
    size_t i = 0;
    while (i < c->n && c->at[i].t < t)
        i++;
    return i < c->n && c->at[i].t <= t && c->at[i].recorded >= recorded && c->at[i].recorded <= recorded;
}

/* Promise(simulation/replay-figure) */
static void a_season_is_thinned_without_losing_a_spike(void **state)
{
    struct replay_curves k = {.n = 0};
    size_t most = 0;
    (void)state;
    for (long i = 0; i < TICKS; i++) {
        const double off = i >= DIFFERS && i % 1000 == 0 ? 1e-9 : 0;
        replay_curves_keep(&k, (double)i, "u", recorded_at(i), recorded_at(i) + off);
        most = k.of->n > most ? k.of->n : most;
    }
    assert_false(k.failed);
    assert_true(most < 100000);
    assert_true(has_point(k.of, 1234, 100.0) && has_point(k.of, 5678, -100.0));
    for (size_t i = 1; i < k.of->n; i++) /* as dense at its begin as later */
        assert_true(k.of->at[i - 1].t < k.of->at[i].t && k.of->at[i].t - k.of->at[i - 1].t < 150);
    assert_true(k.first >= DIFFERS && k.first <= DIFFERS);
    for (long i = DIFFERS - 100; i < DIFFERS + 100; i++) /* all around it are there */
        assert_true(has_point(k.of, (double)i, recorded_at(i)));
    replay_curves_free(&k);
}

/* Controllers that are replayed one after the other may differ earlier than the one before. */
static void a_run_as_a_whole_is_not_thinned(void **state)
{
    struct replay_curves k = {.whole = true};
    (void)state;
    for (long i = 0; i < 100000; i++)
        replay_curves_keep(&k, (double)i, "u", 0.0, 0.0);
    replay_curves_keep(&k, 50000.0, "v", 0.0, 1.0);
    assert_int_equal(k.n, 2);
    assert_int_equal(k.of[0].n, 100000);
    assert_true(k.first >= 50000.0 && k.first <= 50000.0);
    replay_curves_free(&k);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_season_is_thinned_without_losing_a_spike),
        cmocka_unit_test(a_run_as_a_whole_is_not_thinned),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
