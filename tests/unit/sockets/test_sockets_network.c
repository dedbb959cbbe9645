/* SPDX-License-Identifier: BSD-3-Clause */
/* The modelled network: delays, order, loss, duplication, outages, bandwidth; streams of their own. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include <apcsockets.h>

#define MS    APC_NS_PER_MS
#define S     APC_NS_PER_S
#define EVERY (10 * MS) /* between two frames of the runs below */
#define N     20000

static struct apc_network *make(struct apc_network_options options)
{
    struct apc_network *n = NULL;
    struct apc_error why = {""};
    options.size = sizeof options;
    if (apc_network_create(&n, &options, &why) != 0)
        fail_msg("%s", why.text);
    return n;
}

static struct apc_distribution of(const char *text)
{
    struct apc_distribution d;
    assert_int_equal(apc_distribution_parse(text, &d, NULL), 0);
    return d;
}

static void a_perfect_network_delivers_at_once(void **state)
{
    struct apc_network *n = make((struct apc_network_options){0});
    apc_ns at[2];
    (void)state;
    for (int i = 0; i < 100; i++) {
        assert_int_equal(apc_network_send(n, i * S, 1000, at), 1);
        assert_int_equal(at[0], i * S);
    }
    apc_network_destroy(n);
}

/* Promise(simulation/network-models-delay) */
static void a_constant_delay_and_jitter_add_up(void **state)
{
    struct apc_network *n = make((struct apc_network_options){.delay = of("0.004"), .jitter = of("-0.001")});
    struct apc_network *never = make((struct apc_network_options){.delay = of("0.001"), .jitter = of("-2")});
    apc_ns at[2];
    (void)state;
    assert_int_equal(apc_network_send(n, S, 10, at), 1);
    assert_int_equal(at[0], S + 3 * MS);
    assert_int_equal(apc_network_send(never, S, 10, at), 1);
    assert_int_equal(at[0], S); /* nothing arrives before it was sent */
    apc_network_destroy(n);
    apc_network_destroy(never);
}

/* A number of seconds that no time can hold is no delay of 0. */
static void what_takes_for_ever_does_not_arrive_at_once(void **state)
{
    struct apc_network *late = make((struct apc_network_options){.delay = of("exponential(1e300)")});
    struct apc_network *slow = make((struct apc_network_options){.bandwidth = 1e-300});
    apc_ns at[2];
    (void)state;
    for (int i = 1; i <= 100; i++) {
        assert_int_equal(apc_network_send(late, i * S, 10, at), 1);
        assert_true(at[0] > 1000000 * S);
        assert_int_equal(apc_network_send(slow, i * S, 10, at), 1);
        assert_true(at[0] > 1000000 * S);
    }
    apc_network_destroy(late);
    apc_network_destroy(slow);
}

/*
 * Promise(simulation/network-models-delay): The network's models: delay, jitter, loss, duplication,
 *   reordering, bandwidth, outages.
 */
static void random_delays_have_their_mean(void **state)
{
    static const struct {
        const char *text;
        double mean, sd;
    } cases[] = {{"uniform(0.001, 0.003)", 2e6, 5.77e5},
                 {"normal(0.004, 0.0005)", 4e6, 5e5},
                 {"exponential(0.0005)", 5e5, 5e5},
                 {"gamma(2, 0.0005)", 1e6, 7.07e5}};
    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct apc_network *n = make((struct apc_network_options){.delay = of(cases[k].text), .seed = 5});
        double sum = 0, squares = 0;
        for (apc_ns i = 0; i < N; i++) {
            apc_ns at[2];
            assert_int_equal(apc_network_send(n, i * EVERY, 10, at), 1);
            double d = (double)(at[0] - i * EVERY);
            assert_true(d >= 0);
            sum += d / N;
            squares += d * d / N;
        }
        assert_near(sum, cases[k].mean, 0.02 * cases[k].mean);
        assert_near(sqrt(squares - sum * sum), cases[k].sd, 0.03 * cases[k].sd);
        apc_network_destroy(n);
    }
}

/* Promise(simulation/network-models-delay) */
static void frames_keep_their_order_unless_they_overtake(void **state)
{
    struct apc_network *kept =
        make((struct apc_network_options){.delay = of("exponential(0.05)"), .seed = 1});
    struct apc_network *mixed =
        make((struct apc_network_options){.delay = of("exponential(0.05)"), .reordering = 0.25, .seed = 1});
    struct apc_network_stats stats = {.size = sizeof stats};
    apc_ns newest[2] = {0, 0}, at[2];
    uint64_t overtook = 0;
    (void)state;
    for (apc_ns i = 0; i < N; i++) {
        assert_int_equal(apc_network_send(kept, i * EVERY, 10, at), 1);
        assert_true(at[0] >= newest[0]);
        newest[0] = at[0];
        assert_int_equal(apc_network_send(mixed, i * EVERY, 10, at), 1);
        overtook += at[0] < newest[1];
        newest[1] = at[0] > newest[1] ? at[0] : newest[1];
    }
    apc_network_stats(mixed, &stats);
    assert_near((double)stats.reordered, 0.25 * N, 5 * sqrt(0.25 * 0.75 * N));
    assert_in_range(overtook, N / 10, stats.reordered);
    apc_network_destroy(kept);
    apc_network_destroy(mixed);
}

/* Promise(simulation/network-models-delay) */
static void loss_and_duplication_have_their_share(void **state)
{
    struct apc_network *n =
        make((struct apc_network_options){.loss = 0.1, .duplication = 0.05, .delay = of("0.001"), .seed = 2});
    struct apc_network_stats stats = {.size = sizeof stats};
    uint64_t arrived[3] = {0};
    apc_ns at[2];
    (void)state;
    for (apc_ns i = 0; i < N; i++)
        arrived[apc_network_send(n, i * EVERY, 10, at)]++;
    apc_network_stats(n, &stats);
    assert_int_equal(stats.sent, N);
    assert_int_equal(stats.lost, arrived[0]);
    assert_int_equal(stats.duplicated, arrived[2]);
    assert_near((double)arrived[0], 0.1 * N, 5 * sqrt(0.1 * 0.9 * N));
    assert_near((double)arrived[2], 0.9 * 0.05 * N, 5 * sqrt(0.05 * 0.95 * N));
    apc_network_destroy(n);
}

static void certain_loss_and_none_are_exact(void **state)
{
    struct apc_network *all = make((struct apc_network_options){.loss = 1});
    struct apc_network *none = make((struct apc_network_options){.duplication = 1});
    apc_ns at[2];
    (void)state;
    for (int i = 0; i < 1000; i++) {
        assert_int_equal(apc_network_send(all, i, 1, at), 0);
        assert_int_equal(apc_network_send(none, i, 1, at), 2);
    }
    apc_network_destroy(all);
    apc_network_destroy(none);
}

/* Promise(simulation/network-models-delay) */
static void an_outage_loses_what_is_sent_in_it(void **state)
{
    const struct apc_outage outages[] = {{2 * S, 3 * S}, {5 * S, 5 * S + 1}};
    struct apc_network *n = make((struct apc_network_options){.outages = outages, .n_outages = 2});
    const struct {
        apc_ns at;
        int arrives;
    } cases[] = {{2 * S - 1, 1}, {2 * S, 0}, {3 * S - 1, 0}, {3 * S, 1}, {5 * S, 0}, {5 * S + 1, 1}};
    apc_ns at[2];
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_int_equal(apc_network_send(n, cases[i].at, 1, at), cases[i].arrives);
    apc_network_destroy(n);
}

/* As seen from a wall clock, a monotonic clock, and before their zero. */
static void a_line_is_as_slow_at_every_time(void **state)
{
    static const apc_ns begins[] = {0, INT64_C(1700000000) * APC_NS_PER_S, INT64_MAX / 2, -INT64_MAX / 2};
    (void)state;

    for (size_t i = 0; i < sizeof begins / sizeof *begins; i++) {
        struct apc_network *n = make((struct apc_network_options){.bandwidth = 8});
        apc_ns at[2];
        for (int k = 1; k <= 3; k++) {
            assert_int_equal(apc_network_send(n, begins[i], 1, at), 1);
            assert_int_equal(at[0] - begins[i], k * APC_NS_PER_S);
        }
        apc_network_destroy(n);
    }
}

/* Promise(simulation/network-models-delay) */
static void bandwidth_makes_frames_wait_for_each_other(void **state)
{
    struct apc_network *n = make((struct apc_network_options){.bandwidth = 8000, .delay = of("0.5")});
    apc_ns at[2];
    (void)state;
    assert_int_equal(apc_network_send(n, 0, 1000, at), 1);
    assert_int_equal(at[0], S + 500 * MS);
    assert_int_equal(apc_network_send(n, 0, 500, at), 1);
    assert_int_equal(at[0], 2 * S);
    assert_int_equal(apc_network_send(n, 10 * S, 500, at), 1);
    assert_int_equal(at[0], 11 * S);
    apc_network_destroy(n);
}

/* What arrives of N frames, and when, of those that both networks deliver once. */
static void same_delays(struct apc_network_options a, struct apc_network_options b)
{
    struct apc_network *x = make(a), *y = make(b);
    int both = 0;
    for (apc_ns i = 0; i < N; i++) {
        apc_ns p[2], q[2];
        int n = apc_network_send(x, i * S, 10, p), m = apc_network_send(y, i * S, 10, q);
        if (n > 0 && m > 0) {
            assert_int_equal(p[0], q[0]);
            both++;
        }
    }
    assert_true(both > N / 2);
    apc_network_destroy(x);
    apc_network_destroy(y);
}

/* Promise(simulation/seed-run-last) */
static void changing_one_model_changes_no_other(void **state)
{
    const struct apc_network_options plain = {.delay = of("gamma(0.7, 0.01)"), .seed = 11};
    struct apc_network_options with = plain;
    (void)state;
    same_delays(plain, with);
    with.loss = 0.3;
    same_delays(plain, with);
    with.duplication = 0.3;
    same_delays(plain, with);
    with.outages = &(struct apc_outage){0, 100 * S};
    with.n_outages = 1;
    same_delays(plain, with);
}

static void directions_of_one_seed_differ(void **state)
{
    struct apc_network_options a = {.delay = of("exponential(1)"), .seed = 3, .name = "to"}, b = a;
    b.name = "from";
    struct apc_network *x = make(a), *y = make(b);
    int same = 0;
    (void)state;
    for (apc_ns i = 0; i < 1000; i++) {
        apc_ns p[2], q[2];
        apc_network_send(x, i * 1000 * S, 10, p);
        apc_network_send(y, i * 1000 * S, 10, q);
        same += p[0] == q[0];
    }
    assert_int_equal(same, 0);
    apc_network_destroy(x);
    apc_network_destroy(y);
}

static void what_no_network_can_do_is_refused(void **state)
{
    static const struct apc_share early[] = {{-1, 0, 1}};
    const struct {
        struct apc_network_options options;
        const char *says;
    } cases[] = {
        {{.delay = {APC_CONSTANT, -0.001, 0, NULL, 0}}, "delay"},
        {{.delay = {APC_UNIFORM, -0.001, 1, NULL, 0}}, "delay"},
        {{.delay = {APC_NORMAL, -0.001, 1, NULL, 0}}, "delay"},
        {{.delay = {APC_RECORDED, 0, 0, early, 1}}, "delay"},
        {{.loss = 1.01}, "loss"},
        {{.loss = -0.1}, "loss"},
        {{.loss = (double)NAN}, "loss"},
        {{.duplication = 2}, "duplication"},
        {{.reordering = -1}, "reordering"},
        {{.bandwidth = -1}, "bandwidth"},
        {{.outages = &(const struct apc_outage){2, 1}, .n_outages = 1}, "outage 1"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_network_options options = cases[i].options;
        struct apc_network *n;
        struct apc_error why = {""};
        options.size = sizeof options;
        assert_int_equal(apc_network_create(&n, &options, &why), APC_EINVAL);
        assert_null(n);
        assert_non_null(strstr(why.text, cases[i].says));
    }
}

/* A caller who was compiled when the struct was shorter has no room behind it, one who was when it is longer
 * has. */
/* Promise(docs/struct-library-fills) */
static void counts_fill_no_more_than_the_caller_has_room_for(void **state)
{
    struct apc_network *network = make((struct apc_network_options){.seed = 1});
    struct {
        struct apc_network_stats known;
        uint64_t behind;
    } longer = {.known = {.size = sizeof longer}, .behind = 9};
    struct apc_network_stats older = {.size = offsetof(struct apc_network_stats, lost),
                                      .lost = 7,
                                      .reordered = 7},
                             none = {.size = 0, .sent = 7};
    apc_ns at[2];
    (void)state;
    assert_int_equal(apc_network_send(network, 0, 10, at), 1);
    apc_network_stats(network, &older);
    assert_int_equal(older.sent, 1);
    assert_int_equal(older.lost, 7);
    assert_int_equal(older.reordered, 7);
    assert_int_equal(older.size, offsetof(struct apc_network_stats, lost));
    apc_network_stats(network, &longer.known);
    assert_int_equal(longer.known.sent, 1);
    assert_int_equal(longer.known.reordered, 0);
    assert_int_equal(longer.known.size, sizeof longer);
    assert_int_equal(longer.behind, 9);
    apc_network_stats(network, &none);
    assert_int_equal(none.sent, 7);
    apc_network_destroy(network);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_perfect_network_delivers_at_once),
        cmocka_unit_test(a_constant_delay_and_jitter_add_up),
        cmocka_unit_test(what_takes_for_ever_does_not_arrive_at_once),
        cmocka_unit_test(random_delays_have_their_mean),
        cmocka_unit_test(frames_keep_their_order_unless_they_overtake),
        cmocka_unit_test(loss_and_duplication_have_their_share),
        cmocka_unit_test(certain_loss_and_none_are_exact),
        cmocka_unit_test(an_outage_loses_what_is_sent_in_it),
        cmocka_unit_test(bandwidth_makes_frames_wait_for_each_other),
        cmocka_unit_test(a_line_is_as_slow_at_every_time),
        cmocka_unit_test(changing_one_model_changes_no_other),
        cmocka_unit_test(directions_of_one_seed_differ),
        cmocka_unit_test(what_no_network_can_do_is_refused),
        cmocka_unit_test(counts_fill_no_more_than_the_caller_has_room_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
