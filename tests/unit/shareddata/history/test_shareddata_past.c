/* SPDX-License-Identifier: BSD-3-Clause */
/* A store as it stood: every kind of store against a list of all rows, gone through from end to end. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/shareddata_internal.h"
#include "stores.h"

#define BEGIN    (INT64_C(1767225600) * APC_NS_PER_S) /* 2026-01-01 */
#define ROWS     250
#define INSTANTS 80

static const struct apc_sample variables[] = {
    {.table = APC_SENSOR, .id = 1}, {.table = APC_ACTUATOR, .id = 2}, {.table = APC_SETPOINT, .id = 1},
    {.table = APC_OPMODE, .id = 1}, {.table = APC_TUNING, .id = 3},   {.table = APC_ACTUAL, .id = 19},
    {.table = APC_ALARM, .id = 1},  {.table = APC_TICK, .id = 1},
};
#define VARIABLES (sizeof variables / sizeof *variables)

static struct apc_sample rows[VARIABLES][ROWS];
static uint32_t draw;

static int64_t below(int64_t n)
{
    draw = draw * 1664525u + 1013904223u;
    return (int64_t)(draw >> 8) % n;
}

/* @p sparse: hours and days lie between rows, and the clock goes on. Else it is set back now and then, and of
 * what comes with every tick rows are missing. */
static void make_rows(bool sparse)
{
    for (size_t v = 0; v < VARIABLES; v++) {
        apc_ns time = BEGIN + below(1000) * APC_NS_PER_MS;
        int64_t seq = 0;
        for (size_t i = 0; i < ROWS; i++) {
            const bool gap = !sparse && !apc_table_shared(variables[v].table) && below(40) == 0;
            time += sparse ? below(4 * 86400) * APC_NS_PER_S / (below(9) == 0 ? 1 : 100)
                           : below(200) * APC_NS_PER_MS;
            time -= !sparse && below(50) == 0 ? 2 * APC_NS_PER_S : 0;
            seq += gap ? 1 + below(5) + 1 : 1;
            rows[v][i] = variables[v];
            rows[v][i].seq = seq;
            rows[v][i].time = time / 1000 * 1000;
            rows[v][i].value = variables[v].table == APC_OPMODE ? (double)below(2) : (double)below(1000);
            rows[v][i].status = below(10) == 0 ? APC_BAD_NO_COMMUNICATION : APC_GOOD;
            rows[v][i].author = apc_table_shared(variables[v].table) ? 7 : 0;
        }
    }
}

/* @p n rows of each variable. */
static void store_rows(struct apc_store *store, size_t first, size_t n)
{
    for (size_t v = 0; v < VARIABLES; v++) {
        struct apc_vector vector[ROWS];
        for (size_t i = first; i < first + n; i++)
            vector[i] = (struct apc_vector){.table = rows[v][i].table,
                                            .id = rows[v][i].id,
                                            .seq = rows[v][i].seq,
                                            .time = rows[v][i].time,
                                            .status = rows[v][i].status,
                                            .n = 1,
                                            .value = &rows[v][i].value};
        const bool vectors = apc_table_vectors(variables[v].table);
        const struct apc_rows of = {
            .size = sizeof of, .vector = &vector[first], .n_vectors = vectors ? n : 0, .sample = NULL};
        ok(store, vectors ? apc_store_append_rows(store, &of) : apc_store_append(store, &rows[v][first], n));
    }
}

/* What was newest: the highest seq up to then. */
static struct apc_sample expected(size_t v, apc_ns at)
{
    struct apc_sample found = variables[v];
    const struct apc_sample *next = NULL;
    found.status = APC_BAD_NO_DATA;
    for (size_t i = 0; i < ROWS; i++)
        if (rows[v][i].time <= at) {
            found = rows[v][i];
            next = i + 1 < ROWS ? &rows[v][i + 1] : NULL;
        }
    if (next && next->seq != found.seq + 1 && found.status == APC_GOOD)
        found.status = APC_UNCERTAIN_LAST_USABLE;
    return found;
}

static struct apc_store *past(struct apc_store *store, apc_ns at)
{
    struct apc_error why = {""};
    struct apc_store *then = NULL;
    if (apc_store_past(&then, store, at, &why) != 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_now(then) == at);
    return then;
}

static void compare_row(const char *how, size_t v, apc_ns at, const struct apc_sample *is)
{
    const struct apc_sample want = expected(v, at);
    if (is->seq != want.seq || is->status != want.status ||
        (want.seq > 0 && (is->time != want.time || is->author != want.author ||
                          memcmp(&is->value, &want.value, sizeof want.value) != 0)))
        fail_msg("%s: %s %d at %lld: seq %lld, status %x, and expected %lld, %x", how,
                 apc_table_name(want.table), want.id, (long long)at, (long long)is->seq, is->status,
                 (long long)want.seq, want.status);
}

static void compare_instant(struct apc_store *store, apc_ns at)
{
    struct apc_store *then = past(store, at);
    struct apc_sample one[VARIABLES], all[VARIABLES];
    double value = 0;
    struct apc_vector tick = {.table = APC_TICK, .id = 1, .room = 1, .value = &value};
    struct apc_rows both = {
        .size = sizeof both, .sample = all, .n_samples = VARIABLES - 1, .vector = &tick, .n_vectors = 1};
    memcpy(one, variables, sizeof one);
    memcpy(all, variables, sizeof all);
    ok(then, apc_store_read(then, one, VARIABLES - 1));
    ok(then, apc_store_read_rows(then, &both));
    for (size_t v = 0; v < VARIABLES - 1; v++) {
        compare_row("read", v, at, &one[v]);
        compare_row("rows", v, at, &all[v]);
    }
    const struct apc_sample vector = {
        .seq = tick.seq, .time = tick.time, .status = tick.status, .value = value};
    compare_row("vector", VARIABLES - 1, at, &vector);
    assert_int_equal(tick.n, tick.seq > 0);
    apc_store_close(then);
}

static void compare_instants(struct apc_store *store, bool sparse)
{
    for (int i = 0; i < INSTANTS; i++) {
        const struct apc_sample *near = &rows[below(VARIABLES)][below(ROWS)];
        const apc_ns off[] = {0, -1000, 1, 999, below(86400) * APC_NS_PER_S};
        compare_instant(store, near->time + off[below(sparse ? 5 : 4)]);
    }
}

/* Promise(run/at-time-shows) */
static void test_at_any_instant_each_variable_has_the_row_that_was_newest(void **state)
{
    for (draw = 1; draw < 3; draw++) {
        const uint32_t seed = draw;
        apc_store_close(seed == 2 ? *state : NULL);
        if (seed == 2 && stores_set_up(state) != 0)
            fail_msg("no second store");
        make_rows(seed == 2);
        store_rows(*state, 0, ROWS / 2);
        const struct apc_retention packed = {.size = sizeof packed, .packed = 1};
        const bool packs = apc_store_maintain(*state, &packed) > 0;
        store_rows(*state, ROWS / 2, ROWS - ROWS / 2); /* which come late: rows beside chunks */
        compare_instants(*state, seed == 2);
        if (packs) {
            ok(*state, apc_store_maintain(*state, &packed));
            compare_instants(*state, seed == 2);
        }
        compare_instant(*state, BEGIN - APC_NS_PER_S);
        compare_instant(*state, apc_clock_utc(NULL));
        draw = seed;
    }
}

static void test_nobody_changes_the_past_nor_sees_the_future(void **state)
{
    struct apc_store *then = past(*state, BEGIN), *none = then;
    struct apc_error why = {""};
    struct apc_sample s = {.table = APC_SETPOINT, .id = 1, .seq = 1, .time = BEGIN, .value = 1};
    const struct apc_event event = {.time = BEGIN, .severity = APC_EVENT_INFO};
    const struct apc_timing_row timing = {.time = BEGIN, .quantity = "run"};
    const struct apc_rows of = {.size = sizeof of, .sample = &s, .n_samples = 1};
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    assert_int_equal(apc_store_append(then, &s, 1), APC_EPERM);
    assert_non_null(strstr(apc_store_error(then), "as of 2026-01-01T00:00:00"));
    assert_int_equal(apc_store_put(then, &s, 1), APC_EPERM);
    assert_int_equal(apc_store_swap(then, &s, 1), APC_EPERM);
    assert_int_equal(apc_store_append_rows(then, &of), APC_EPERM);
    assert_int_equal(apc_store_append_events(then, &event, 1), APC_EPERM);
    assert_int_equal(apc_store_append_timing(then, &timing, 1), APC_EPERM);
    assert_int_equal(apc_store_put_tags(then, &tag, 1), APC_EPERM);
    assert_int_equal(apc_store_claim_set(then, &s, 1), APC_EPERM);
    assert_int_equal(apc_store_release(then, &s, 1), APC_EPERM);
    assert_int_equal(apc_store_wait(then, &s, 1, 0), APC_EPERM);
    assert_int_equal(apc_store_author(then, "Ann"), APC_EPERM);
    assert_int_equal(apc_store_init(then), APC_EPERM);
    assert_int_equal(apc_store_maintain(then, NULL), APC_EPERM);
    assert_int_equal(apc_store_keep_history(then), APC_EPERM);
    assert_int_equal(apc_store_is_history(then), APC_EPERM);
    struct apc_store_stats own = {.size = sizeof own}, its = own;
    apc_store_stats(then, &own);
    apc_store_stats(*state, &its);
    assert_memory_equal(&own, &its, sizeof own); /* there, and how often it was not, as its store is */
    ok(then, apc_store_connect(then));
    assert_true(apc_store_connected(then));
    assert_int_equal(apc_store_tables_version(then), apc_store_version());
    apc_store_close(then);
    s.seq = 0;
    ok(*state, apc_store_read(*state, &s, 1));
    assert_int_equal(s.seq, 0);
    const apc_ns tomorrow = apc_clock_utc(NULL) + 86400 * APC_NS_PER_S;
    const bool virtual = strcmp(store_kind->name, "mem:") == 0; /* it has a clock of its own */
    assert_int_equal(apc_store_past(&none, *state, tomorrow, &why), virtual ? 0 : APC_EINVAL);
    assert_true(virtual || (!none && strstr(why.text, "is in the future")));
    apc_store_close(none);
    assert_int_equal(apc_store_past(&none, *state, INT64_MIN, &why), APC_EINVAL);
    assert_int_equal(apc_store_past(&none, NULL, BEGIN, &why), APC_EINVAL);
}

static int count_event(void *ctx, const struct apc_event *event)
{
    assert_true(event->time <= BEGIN);
    ++*(int *)ctx;
    return 0;
}

static int count_row(void *ctx, const struct apc_sample *row)
{
    assert_true(row->time <= BEGIN);
    ++*(int *)ctx;
    return 0;
}

static int count_vector(void *ctx, const struct apc_vector *row)
{
    assert_true(row->time <= BEGIN);
    ++*(int *)ctx;
    return 0;
}

static int count_window(void *ctx, const struct apc_timing_row *row)
{
    assert_true(row->time <= BEGIN);
    ++*(int *)ctx;
    return 0;
}

static int count_bin(void *ctx, const struct apc_history_bin *bin)
{
    *(int *)ctx += (int)bin->count;
    return 0;
}

static void test_what_is_streamed_ends_at_the_instant(void **state)
{
    double value = 1;
    for (int i = 1; i <= 10; i++) {
        const apc_ns time = BEGIN + (i - 6) * APC_NS_PER_S;
        const struct apc_sample s = {.table = APC_SENSOR, .id = 1, .seq = i, .time = time};
        struct apc_vector v = {.table = APC_TICK, .id = 1, .seq = i, .time = time, .n = 1, .value = &value};
        const struct apc_rows of = {.size = sizeof of, .vector = &v, .n_vectors = 1};
        const struct apc_event e = {.time = time, .severity = APC_EVENT_INFO, .source = "a", .kind = "b"};
        const struct apc_timing_row t = {.time = time, .task = "a", .quantity = "run", .count = 1};
        ok(*state, apc_store_append(*state, &s, 1));
        ok(*state, apc_store_append_rows(*state, &of));
        ok(*state, apc_store_append_events(*state, &e, 1));
        ok(*state, apc_store_append_timing(*state, &t, 1));
    }
    struct apc_store *then = past(*state, BEGIN);
    const struct apc_range ranges[] = {{.last = 3}, {.until = BEGIN + 9 * APC_NS_PER_S}};
    for (int i = 0; i < 2; i++) {
        const int n = i == 0 ? 3 : 6;
        int seen[4] = {0};
        ok(then, apc_store_history(then, APC_SENSOR, 1, &ranges[i], count_row, &seen[0]));
        ok(then, apc_store_vectors(then, APC_TICK, 1, &ranges[i], count_vector, &seen[1]));
        ok(then, apc_store_events(then, &ranges[i], count_event, &seen[2]));
        ok(then, apc_store_timing(then, &ranges[i], count_window, &seen[3]));
        for (int k = 0; k < 4; k++)
            assert_int_equal(seen[k], n);
    }
    int n = 0;
    ok(then, apc_store_history_bins(then, APC_SENSOR, 1, BEGIN - 60 * APC_NS_PER_S, BEGIN + 60 * APC_NS_PER_S,
                                    5, count_bin, &n));
    assert_int_equal(n, 6);
    assert_int_equal(apc_store_variables(then, NULL, 0), 2);
    apc_store_close(then);
}

static void test_what_the_record_cannot_tell_is_said(void **state)
{
    const struct apc_sample s[] = {{.table = APC_SENSOR, .id = 1, .seq = 5, .time = BEGIN},
                                   {.table = APC_SENSOR, .id = 1, .seq = 9, .time = BEGIN + APC_NS_PER_S}};
    ok(*state, apc_store_append(*state, s, 2));
    struct apc_sample now = s[0];
    for (int i = -1; i < 2; i++) {
        struct apc_store *then = past(*state, BEGIN + i * APC_NS_PER_S);
        ok(then, apc_store_read(then, &now, 1));
        assert_int_equal(now.seq, i < 0 ? 0 : s[i].seq);
        assert_int_equal(now.status, i < 0 ? APC_BAD_NO_DATA : i == 0 ? APC_UNCERTAIN_LAST_USABLE : APC_GOOD);
        assert_int_equal(
            strstr(apc_store_error(then), "sensor 1: rows are missing in the record from ") != NULL, i < 1);
        apc_store_close(then);
    }
}

static void test_ticks_at_which_nothing_is_published_are_not_missing(void **state)
{
    const struct apc_sample s[] = {{.table = APC_ESTIMATE, .id = 1, .seq = 5, .time = BEGIN},
                                   {.table = APC_ESTIMATE, .id = 1, .seq = 9, .time = BEGIN + APC_NS_PER_S}};
    struct apc_sample now = s[0];
    ok(*state, apc_store_append(*state, s, 2));
    struct apc_store *then = past(*state, BEGIN);
    ok(then, apc_store_read(then, &now, 1));
    assert_true(now.seq == 5 && now.status == APC_GOOD);
    assert_null(strstr(apc_store_error(then), "missing"));
    apc_store_close(then);
}

static void test_the_experiment_is_that_of_then_where_it_is_kept(void **state)
{
    const bool kept = strncmp(store_kind->name, "mem:", 4) != 0 && strncmp(store_kind->name, "shm:", 4) != 0;
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    char text[16];
    ok(*state, apc_store_describe(*state, &tag, 1, "first"));
    const apc_ns at = apc_clock_utc(NULL);
    while (apc_clock_utc(NULL) < at + 2000)
        ;
    ok(*state, apc_store_describe(*state, &tag, 1, "second"));
    const apc_ns instants[] = {BEGIN, at, apc_clock_utc(NULL)};
    for (int i = 0; i < 3; i++) {
        struct apc_store *then = past(*state, instants[i]);
        int64_t revision = 0;
        const bool former = kept && i < 2;
        ok(then, apc_store_catalogue(then, text, sizeof text, &revision));
        assert_string_equal(text, former ? "first" : "second");
        assert_int_equal(revision, former ? 1 : 2);
        ok(then, apc_store_get_tags(then, NULL, 0));
        assert_int_equal(strstr(apc_store_error(then), "described otherwise then") != NULL, former);
        apc_store_close(then);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_at_any_instant_each_variable_has_the_row_that_was_newest),
        T(test_nobody_changes_the_past_nor_sees_the_future),
        T(test_what_is_streamed_ends_at_the_instant),
        T(test_what_the_record_cannot_tell_is_said),
        T(test_ticks_at_which_nothing_is_published_are_not_missing),
        T(test_the_experiment_is_that_of_then_where_it_is_kept),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
