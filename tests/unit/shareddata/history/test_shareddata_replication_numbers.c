/* SPDX-License-Identifier: BSD-3-Clause */
/* A new live store goes on from its history, and rows are numbered as they came. */
#include "replication_rig.h"

/* ---- A new live store ------------------------------------------------------------------------- */

static int keep_event(void *ctx, const struct apc_event *e)
{
    *(struct apc_event *)ctx = *e;
    return 0;
}

/* The one event that it has. */
static void assert_gap_is_told(struct apc_store *store, const char *since)
{
    struct apc_event e = {0};
    assert_int_equal(apc_store_events(store, NULL, keep_event, &e), 1);
    assert_string_equal(e.kind, "history");
    assert_has(e.text, "the record has a gap");
    assert_has(e.text, since);
}

/* Promise(stores/host-comes-up) */
static void test_a_new_live_store_goes_on_from_its_history(void **state)
{
    struct apc_error why;
    struct apc_store *live = live_make(4);
    append(live, 1, 5);
    struct apc_sample wanted = {.table = APC_TUNING, .id = 1, .time = 7 * APC_NS_PER_S, .value = 0.25};
    wanted.author = (uint32_t)apc_store_author(live, "anna");
    ok(live, apc_store_put(live, &wanted, 1));
    replication(live, *state);
    live_drop(live);
    live = live_make(4);
    assert_int_equal(apc_store_take_over(live, *state, &why), 4);
    assert_int_equal(apc_store_take_over(live, *state, &why), 0);
    assert_gap_is_told(live, "nothing is known between 1970-01-01T00:00:00.005000Z and 20");
    char author[APC_AUTHOR_LEN];
    struct apc_sample there = newest(live, APC_TUNING, 1);
    assert_true(there.seq == 1 && there.value == 0.25 && there.time == wanted.time);
    assert_int_equal(apc_store_author_name(live, there.author, author), 0);
    assert_string_equal(author, "anna");
    append(live, 6, 8);
    assert_int_equal(replication(live, *state), 9 + 1);
    assert_whole(*state, APC_SENSOR, 1, 8);
    assert_whole(*state, APC_TICK, 1, 8);
    assert_gap_is_told(*state, "1970-01-01T00:00:00.005000Z");
    live_drop(live);
}

/* Promise(stores/host-comes-up) */
static void test_a_history_of_the_future_leaves_the_end_of_the_gap_open(void **state)
{
    struct apc_error why;
    struct apc_store *live = live_make(4);
    const struct apc_sample s = {
        .table = APC_SENSOR, .id = 1, .seq = 1, .time = INT64_C(4102444800) * APC_NS_PER_S};
    ok(*state, apc_store_append(*state, &s, 1));
    assert_int_equal(apc_store_take_over(live, *state, &why), 1);
    assert_gap_is_told(live, "nothing is known from 2100-01-01T00:00:00.000000Z on");
    live_drop(live);
}

/* Promise(stores/host-comes-up) */
static void test_of_a_history_where_nothing_ran_no_gap_is_told(void **state)
{
    struct apc_error why;
    struct apc_store *live = live_make(4);
    assert_int_equal(apc_store_take_over(live, *state, &why), 0);
    struct apc_sample described = {.table = APC_TUNING, .id = 1, .value = 0.25};
    ok(*state, apc_store_put(*state, &described, 1));
    assert_int_equal(apc_store_take_over(live, *state, &why), 1);
    assert_events(live, 0);
    append_event(live, 1, "start"); /* nor of one that comes while the loop runs */
    append(*state, 1, 5);
    assert_int_equal(apc_store_take_over(live, *state, &why), 3);
    assert_events(live, 1);
    live_drop(live);
}

/* Whoever is the first to write a variable, and however. */
static int64_t assert_numbers_begin_anew(struct apc_store *live)
{
    int64_t last = 0;
    ok(live, apc_store_claim(live, APC_SENSOR, 1, &last));
    assert_true(last > INT64_C(1) << 40 && last % (1 << 20) == 0);
    struct apc_sample s = newest(live, APC_TUNING, 1);
    assert_true(s.seq == 0 && s.origin == last && apc_seq_last(&s) == last);
    struct apc_sample put[2] = {{.table = APC_TUNING, .id = 1, .value = 2}, {.table = APC_MANUAL, .id = 1}};
    ok(live, apc_store_put(live, put, 1));
    ok(live, apc_store_swap(live, put + 1, 1));
    struct apc_sample in_tick = {.table = APC_SETPOINT, .id = 1, .value = 3};
    const struct apc_rows rows = {.size = sizeof rows, .sample = &in_tick, .n_samples = 1};
    assert_int_equal(apc_store_append_rows(live, &rows), 1);
    assert_true(put[0].seq == last + 1 && put[1].seq == last + 1 && in_tick.seq == last + 1);
    ok(live, apc_store_put(live, put, 1));
    assert_true(put[0].seq == last + 2);
    return last;
}

/* Promise(stores/host-comes-up) */
static void test_where_the_history_is_away_numbers_begin_above_it(void **state)
{
    struct apc_error why;
    struct apc_store *live = live_make(4);
    append(live, 1, 5);
    replication(live, *state);
    live_drop(live);
    live = live_make(4);
    struct apc_store *away = open_uri("sqlite:/nonexistent/folder/history.db", "away");
    assert_int_equal(apc_store_take_over(live, away, &why), APC_ECONN);
    assert_has(why.text, "the history: ");
    apc_store_close(away);
    const int64_t last = assert_numbers_begin_anew(live);
    append(live, last + 1, last + 3);
    struct apc_replication *f = begin(live, *state);
    struct apc_replication_stats stats = {.size = sizeof stats};
    assert_int_equal(apc_replication_step(f, 0), 13);
    apc_replication_stats(f, &stats);
    assert_true(stats.gap.times == 3 && stats.gap.rows == 0 && stats.behind == 0);
    append(live, last + 4, last + 4);
    assert_true(apc_replication_left(f) >= 1);
    assert_int_equal(step(f), 3);
    apc_replication_destroy(f);
    assert_no_hole(*state, last);
    live_drop(live);
}

static void test_what_takes_over_from_what_is_said(void **state)
{
    struct apc_error why;
    assert_int_equal(apc_store_take_over(*state, *state, &why), APC_EINVAL);
    assert_int_equal(apc_store_take_over(NULL, *state, &why), APC_EINVAL);
    assert_int_equal(apc_store_take_over(*state, NULL, &why), APC_EINVAL);
    assert_has(why.text, "which store");
}

/* ---- From where on --------------------------------------------------------------------------- */

struct numbers {
    int64_t number[8];
    size_t n;
};

static int note_event(void *ctx, const struct apc_event *e)
{
    struct numbers *s = ctx;
    s->number[s->n++ % 8] = e->number;
    return 0;
}

static int note_timing(void *ctx, const struct apc_timing_row *row)
{
    struct numbers *s = ctx;
    s->number[s->n++ % 8] = row->number;
    return 0;
}

static void test_what_lies_behind_a_row_is_given_alone(void **state)
{
    append(*state, 1, 9);
    const struct {
        struct apc_range range;
        int64_t first, last;
    } cases[] = {{{.after = 6}, 7, 9},
                 {{.after = 9}, 0, 0},
                 {{.after = APC_SEQ_MAX}, 0, 0},
                 {{.after = 2, .last = 3}, 7, 9},
                 {{.after = 7, .last = 5}, 8, 9},
                 {{.after = 2, .until = 6 * 1000 * APC_NS_PER_US}, 3, 5},
                 {{.after = 4, .until = 6 * 1000 * APC_NS_PER_US, .last = 4}, 5, 5}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct seen s = {0}, v = {0};
        ok(*state, apc_store_history(*state, APC_SENSOR, 1, &cases[i].range, see_sample, &s));
        ok(*state, apc_store_vectors(*state, APC_TICK, 1, &cases[i].range, see_vector, &v));
        assert_true(s.first == cases[i].first && s.last == cases[i].last && (s.n == 0 || s.whole));
        assert_true(v.first == s.first && v.last == s.last && v.n == s.n);
    }
    assert_int_equal(
        apc_store_history(*state, APC_SENSOR, 1, &(struct apc_range){.after = -1}, see_sample, NULL),
        APC_EINVAL);
}

static void test_events_and_timing_are_numbered_as_they_came(void **state)
{
    for (int i = 1; i <= 4; i++) {
        append_event(*state, 5 - i, i == 2 ? "operator" : "start"); /* the clock stepped */
        append_timing(*state, 5 - i);
    }
    struct numbers e = {0}, t = {0}, some = {0};
    ok(*state, apc_store_events(*state, NULL, note_event, &e));
    ok(*state, apc_store_timing(*state, NULL, note_timing, &t)); /* these come by time */
    assert_true(e.n == 4 && t.n == 4 && e.number[0] > 0 && t.number[3] > 0);
    for (int i = 0; i < 3; i++) {
        assert_true(e.number[i] < e.number[i + 1] && t.number[i] > t.number[i + 1]);
    }
    struct apc_range after = {.after = e.number[1]};
    ok(*state, apc_store_events(*state, &after, note_event, &some));
    assert_true(some.n == 2 && some.number[0] == e.number[2]);
    after.last = 1;
    some.n = 0;
    ok(*state, apc_store_events(*state, &after, note_event, &some));
    assert_true(some.n == 1 && some.number[0] == e.number[3]);
    after = (struct apc_range){.after = t.number[2]}; /* the second that came */
    some.n = 0;
    ok(*state, apc_store_timing(*state, &after, note_timing, &some));
    assert_true(some.n == 2 && some.number[0] == t.number[0] && some.number[1] == t.number[1]);
}

static void test_what_is_no_pair_of_stores_is_refused(void **state)
{
    struct apc_store *live = live_make(1);
    struct apc_replication *f = (struct apc_replication *)live;
    struct apc_error why;
    assert_int_equal(apc_replication_create(NULL, live, *state, &why), APC_EINVAL);
    assert_int_equal(apc_replication_create(&f, NULL, *state, &why), APC_EINVAL);
    assert_null(f);
    assert_int_equal(apc_replication_create(&f, live, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_replication_create(&f, live, live, &why), APC_EINVAL);
    assert_has(why.text, "which other one");
    apc_replication_destroy(NULL);
    assert_int_equal(apc_replication_step(NULL, FOREVER), APC_EINVAL);
    f = begin(live, *state);
    assert_int_equal(apc_replication_step(f, -1), APC_EINVAL);
    apc_replication_destroy(f);
    live_drop(live);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_what_is_no_pair_of_stores_is_refused),
        T(test_a_new_live_store_goes_on_from_its_history),
        T(test_a_history_of_the_future_leaves_the_end_of_the_gap_open),
        T(test_of_a_history_where_nothing_ran_no_gap_is_told),
        T(test_where_the_history_is_away_numbers_begin_above_it),
        T(test_what_takes_over_from_what_is_said),
        T(test_what_lies_behind_a_row_is_given_alone),
        T(test_events_and_timing_are_numbered_as_they_came),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
