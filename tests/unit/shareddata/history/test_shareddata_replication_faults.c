/* SPDX-License-Identifier: BSD-3-Clause */
/* From one store into another of which any call may fail, before it did anything or after: it is said which
 * of them failed and how, and what follows brings all of it there, once.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "shareddata/shareddata_internal.h"

#define FOREVER (60 * APC_NS_PER_S)

/* ---- Stores in memory that fail when they are told to ------------------------------------------------ */

static const struct apc_store_ops *real;
static struct apc_store *from, *to;
static int calls;    /* so many have been made, of both */
static int calls_to; /* of TO */
static int asked;    /* whose number, or which number, an author is */
static int fails_at; /* number of the one that fails; 0: none */
static bool done;    /* what it should do was done all the same: its answer is lost */
static const struct apc_store *failed;
static size_t largest; /* rows of one append */
static int appends;

static bool begins(const struct apc_store *store)
{
    calls++;
    calls_to += store == to;
    failed = calls == fails_at ? store : failed;
    return calls != fails_at || done;
}

static int ends(struct apc_store *store, int rc, int call)
{
    return call == fails_at ? apc_fail(&store->why, APC_ECONN, "call %d is lost", call) : rc;
}

/* What FROM has overwritten: rows, events and timing rows of these numbers. */
static int64_t overwritten, overwritten_until;

static bool is_left(const struct apc_store *store, int64_t number)
{
    return store != from || number < overwritten || number > overwritten_until;
}

struct left {
    const struct apc_store *store;
    apc_sample_fn sample;
    apc_vector_fn vector;
    apc_event_fn event;
    apc_timing_fn timing;
    void *ctx;
    int hidden;
};

#define LEFT(type, member, count)                                                                            \
    static int left_##member(void *ctx, const struct type *row)                                              \
    {                                                                                                        \
        struct left *l = ctx;                                                                                \
        const bool left = is_left(l->store, row->count);                                                     \
        l->hidden += !left;                                                                                  \
        return left ? l->member(l->ctx, row) : 0;                                                            \
    }
LEFT(apc_sample, sample, seq)
LEFT(apc_vector, vector, seq)
LEFT(apc_event, event, number)
LEFT(apc_timing_row, timing, number)

/* So many rows were given. */
static int less(int given, const struct left *l)
{
    return given < 0 ? given : given - l->hidden;
}

#define FAULTY(store, operation)                                                                             \
    do {                                                                                                     \
        const bool begun = begins(store);                                                                    \
        const int call = calls;                                                                              \
        return ends(store, begun ? (operation) : 0, call);                                                   \
    } while (0)

static int do_variables(struct apc_store *s, struct apc_sample *variables, size_t capacity)
{
    FAULTY(s, real->variables(s, variables, capacity));
}

static int do_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_sample_fn fn, void *ctx)
{
    struct left l = {.store = s, .sample = fn, .ctx = ctx};
    FAULTY(s, less(real->history(s, table, id, range, left_sample, &l), &l));
}

static int do_vectors(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_vector_fn fn, void *ctx)
{
    struct left l = {.store = s, .vector = fn, .ctx = ctx};
    FAULTY(s, less(real->vectors(s, table, id, range, left_vector, &l), &l));
}

static int do_get_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    FAULTY(s, real->get_tags(s, tags, capacity));
}

static int do_describe(struct apc_store *s, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    FAULTY(s, real->describe(s, tags, n, catalogue));
}

static int do_catalogue(struct apc_store *s, char *text, size_t size, int64_t *revision)
{
    FAULTY(s, real->catalogue(s, text, size, revision));
}

static int do_append(struct apc_store *s, const struct apc_sample *samples, size_t n)
{
    appends++;
    largest = n > largest ? n : largest;
    FAULTY(s, real->append(s, samples, n));
}

static int do_append_rows(struct apc_store *s, const struct apc_rows *rows)
{
    appends++;
    largest = rows->n_vectors > largest ? rows->n_vectors : largest;
    FAULTY(s, real->append_rows(s, rows));
}

static int do_read_rows(struct apc_store *s, struct apc_rows *rows)
{
    FAULTY(s, real->read_rows(s, rows));
}

static int do_claim(struct apc_store *s, struct apc_sample *variables, size_t n)
{
    FAULTY(s, real->claim_set(s, variables, n));
}

static int do_author(struct apc_store *s, const char *name)
{
    asked++;
    FAULTY(s, real->author(s, name));
}

static int do_author_name(struct apc_store *s, uint32_t number, char name[APC_AUTHOR_LEN])
{
    asked++;
    FAULTY(s, real->author_name(s, number, name));
}

/* TO refuses events and timing of that time, for good, and who comes along with them; 0: none. */
static apc_ns refused;

static int do_append_events(struct apc_store *s, const struct apc_event *events, size_t n)
{
    for (size_t i = 0; s == to && refused > 0 && i < n; i++) {
        if (events[i].time == refused) {
            return apc_fail(&s->why, APC_ERANGE, "refused");
        }
    }
    FAULTY(s, real->append_events(s, events, n));
}

static int do_events(struct apc_store *s, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct left l = {.store = s, .event = fn, .ctx = ctx};
    FAULTY(s, less(real->events(s, range, left_event, &l), &l));
}

static int do_append_timing(struct apc_store *s, const struct apc_timing_row *rows, size_t n)
{
    for (size_t i = 0; s == to && refused > 0 && i < n; i++) {
        if (rows[i].time == refused) {
            return apc_fail(&s->why, APC_ERANGE, "refused");
        }
    }
    FAULTY(s, real->append_timing(s, rows, n));
}

static int do_timing(struct apc_store *s, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct left l = {.store = s, .timing = fn, .ctx = ctx};
    FAULTY(s, less(real->timing(s, range, left_timing, &l), &l));
}

static struct apc_store *make(void)
{
    static struct apc_store_ops faulty;
    struct apc_store *store = NULL;
    assert_int_equal(apc_store_open(&store, "mem:", NULL, NULL), 0);
    assert_true(apc_store_init(store) >= 0);
    real = real ? real : store->ops;
    faulty = *real;
    faulty.variables = do_variables;
    faulty.history = do_history;
    faulty.vectors = do_vectors;
    faulty.get_tags = do_get_tags;
    faulty.describe = do_describe;
    faulty.catalogue = do_catalogue;
    faulty.append = do_append;
    faulty.append_rows = do_append_rows;
    faulty.read_rows = do_read_rows;
    faulty.claim_set = do_claim;
    faulty.author = do_author;
    faulty.author_name = do_author_name;
    faulty.append_events = do_append_events;
    faulty.events = do_events;
    faulty.append_timing = do_append_timing;
    faulty.timing = do_timing;
    faulty.numbers = true; /* as a store that overwrites what is old; this one does not */
    store->ops = &faulty;
    return store;
}

static int set_up(void **state)
{
    (void)state;
    fails_at = 0;
    overwritten = overwritten_until = 0;
    from = make();
    to = make();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    fails_at = 0;
    apc_store_close(from);
    apc_store_close(to);
    return 0;
}

/* ---- What there is ----------------------------------------------------------------------------------- */

static void described(const char *unit)
{
    struct apc_tag tags[2] = {{.table = APC_SENSOR, .id = 1, .name = "y"},
                              {.table = APC_TUNING, .id = 1, .name = "gain"}};
    snprintf(tags[1].unit, sizeof tags[1].unit, "%s", unit);
    assert_true(apc_store_describe(from, tags, 2, unit) >= 0);
}

static void appended(int64_t first, int64_t last)
{
    char name[40];
    for (int64_t seq = first; seq <= last; seq++) {
        double value[2] = {(double)seq, 1};
        struct apc_vector v = {
            .table = APC_TICK, .id = 1, .seq = seq, .time = seq * 1000, .n = 2, .value = value};
        struct apc_sample s[2] = {
            {.table = APC_SENSOR, .id = 1, .seq = seq, .time = seq * 1000, .value = (double)seq},
            {.table = APC_TUNING, .id = 1, .seq = APC_SEQ_ANY, .time = seq * 1000}};
        snprintf(name, sizeof name, "author %d", (int)seq % 3);
        s[1].author = (uint32_t)apc_store_author(from, name);
        const struct apc_rows rows = {
            .size = sizeof rows, .sample = s, .n_samples = 2, .vector = &v, .n_vectors = 1};
        assert_int_equal(apc_store_append_rows(from, &rows), 3);
        const struct apc_event event = {.time = seq * 1000, .severity = APC_EVENT_INFO, .kind = "start"};
        const int64_t bin = seq;
        const struct apc_timing_row row = {.time = seq * 1000,
                                           .task = "t",
                                           .quantity = "run",
                                           .n_bins = 1,
                                           .bin_low = &bin,
                                           .bin_high = &bin,
                                           .bin_count = &bin};
        assert_int_equal(apc_store_append_events(from, &event, 1), 1);
        assert_int_equal(apc_store_append_timing(from, &row, 1), 1);
    }
}

struct seen {
    struct apc_store *store;
    int64_t last, n;
};

static int see_sample(void *ctx, const struct apc_sample *s)
{
    struct seen *seen = ctx;
    assert_int_equal(s->seq, ++seen->n);
    assert_int_equal(s->time, seen->n * 1000);
    seen->last = s->author;
    return 0;
}

static int see_vector(void *ctx, const struct apc_vector *v)
{
    struct seen *seen = ctx;
    assert_int_equal(v->seq, ++seen->n);
    assert_int_equal(v->n, 2);
    assert_near(v->value[0], (double)seen->n, 0);
    assert_near(v->value[1], 1, 0);
    return 0;
}

static int see_event(void *ctx, const struct apc_event *e)
{
    struct seen *seen = ctx;
    assert_int_equal(e->time, ++seen->n * 1000);
    return 0;
}

static int see_timing(void *ctx, const struct apc_timing_row *row)
{
    struct seen *seen = ctx;
    assert_int_equal(row->time, ++seen->n * 1000);
    assert_true(row->n_bins == 1 && row->bin_low[0] == seen->n && row->bin_count[0] == seen->n);
    return 0;
}

/* It has all up to that one, once, in order, with its authors and descriptions. */
static void assert_whole(int64_t last, const char *unit)
{
    struct seen seen[5] = {{0}};
    struct apc_tag tags[3];
    char name[APC_AUTHOR_LEN], expected[40], text[16];
    assert_int_equal(real->history(to, APC_SENSOR, 1, &(struct apc_range){0}, see_sample, &seen[0]), last);
    assert_int_equal(real->history(to, APC_TUNING, 1, &(struct apc_range){0}, see_sample, &seen[1]), last);
    assert_int_equal(real->vectors(to, APC_TICK, 1, &(struct apc_range){0}, see_vector, &seen[2]), last);
    assert_int_equal(real->events(to, &(struct apc_range){0}, see_event, &seen[3]), last);
    assert_int_equal(real->timing(to, &(struct apc_range){0}, see_timing, &seen[4]), last);
    assert_int_equal(apc_store_author_name(to, (uint32_t)seen[1].last, name), 0);
    snprintf(expected, sizeof expected, "author %d", (int)last % 3);
    assert_string_equal(name, expected);
    assert_int_equal(apc_store_get_tags(to, tags, 3), 2);
    assert_string_equal(tags[1].unit, unit);
    assert_true(apc_store_catalogue(to, text, sizeof text, NULL) >= 0);
    assert_string_equal(text, unit);
}

/* ---- One call after the other fails ---------------------------------------------------------- */

static struct apc_replication *begin(void)
{
    struct apc_replication *f = NULL;
    assert_int_equal(apc_replication_create(&f, from, to, NULL), 0);
    return f;
}

/* It failed as it says, or no such call was made. */
static bool step_fails(struct apc_replication *f, int number)
{
    struct apc_replication_stats stats = {.size = sizeof stats};
    char expected[60];
    calls = 0;
    failed = NULL;
    fails_at = number;
    const int rc = apc_replication_step(f, FOREVER);
    fails_at = 0;
    if (!failed) {
        assert_true(rc >= 0);
        assert_string_equal(apc_replication_error(f), "");
        return false;
    }
    snprintf(expected, sizeof expected, "%s: call %d is lost", failed == to ? "writing" : "reading", number);
    if (rc != APC_ECONN)
        fail_msg("call %d: %s: %s", number, apc_err_name(rc), apc_replication_error(f));
    assert_string_equal(apc_replication_error(f), expected);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.away, failed == to);
    return true;
}

static int64_t stored(const struct apc_replication *f)
{
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_true(stats.gap.times == 0 && stats.lost.events == 0 && stats.lost.timing == 0 &&
                stats.behind == 0);
    return (int64_t)(stats.samples + stats.vectors + stats.events + stats.timing);
}

/* Promise(stores/store-holds-gets) */
static void test_whichever_call_fails_the_next_step_makes_up_for_it(void **state)
{
    bool more = true;
    tear_down(state);
    for (int number = 1; more; number++) {
        for (int kind = 0; kind < 4; kind++) { /* at the first step, or later; undone, or done */
            set_up(state);
            done = kind & 1;
            described("m");
            appended(1, 3);
            struct apc_replication *f = begin();
            if (kind & 2) {
                assert_int_equal(apc_replication_step(f, FOREVER), 3 * 5);
                described("V");
                appended(4, 5);
            }
            more = step_fails(f, number);
            const int64_t last = kind & 2 ? 5 : 3;
            assert_true(apc_replication_step(f, FOREVER) >= 0);
            assert_whole(last, kind & 2 ? "V" : "m");
            const int64_t before = stored(f);
            assert_true(done ? before <= 5 * last : before == 5 * last);
            appended(last + 1, last + 2);
            described("A");
            assert_int_equal(apc_replication_step(f, FOREVER), 2 * 5);
            assert_whole(last + 2, "A");
            assert_int_equal(apc_replication_step(f, FOREVER), 0);
            apc_replication_destroy(f);
            tear_down(state);
        }
        assert_true(number < 200);
    }
    set_up(state);
}

/* What was overwritten while nobody moved anything is told when it is begun again: once, and all of it. */
/* Promise(stores/store-holds-gets) */
static void test_whichever_call_fails_first_the_whole_gap_is_told_once(void **state)
{
    bool more = true;
    tear_down(state);
    for (int number = 1; more; number++) {
        for (int answered = 0; answered < 2; answered++) {
            struct apc_replication_stats stats = {.size = sizeof stats};
            set_up(state);
            done = answered;
            described("m");
            appended(1, 2);
            struct apc_replication *f = begin();
            assert_int_equal(apc_replication_step(f, FOREVER), 2 * 5);
            apc_replication_destroy(f);
            appended(3, 9);
            overwritten = 3;
            overwritten_until = 5;
            f = begin();
            more = step_fails(f, number);
            assert_true(apc_replication_step(f, FOREVER) >= 0);
            apc_replication_stats(f, &stats);
            if (stats.gap.times != 3 || stats.gap.rows != 9 || stats.lost.events != 3 ||
                stats.lost.timing != 3)
                fail_msg("call %d: %d times, %d rows, %d events, %d timing rows", number,
                         (int)stats.gap.times, (int)stats.gap.rows, (int)stats.lost.events,
                         (int)stats.lost.timing);
            assert_int_equal(stats.gap.since, 2 * 1000);
            assert_int_equal(stats.gap.until, 6 * 1000);
            apc_replication_destroy(f);
            tear_down(state);
        }
        assert_true(number < 200);
    }
    set_up(state);
}

static void test_two_failures_one_after_the_other_are_as_one(void **state)
{
    bool any = true;
    tear_down(state);
    for (int first = 1; any; first++) {
        any = false;
        for (int second = 1, more = 1; more; second++) {
            set_up(state);
            done = (first + second) % 2;
            described("m");
            appended(1, 2);
            struct apc_replication *f = begin();
            any = step_fails(f, first) || any;
            more = step_fails(f, second);
            assert_true(apc_replication_step(f, FOREVER) >= 0);
            assert_whole(2, "m");
            assert_true(stored(f) <= 10);
            apc_replication_destroy(f);
            tear_down(state);
        }
    }
    set_up(state);
}

/* ---- Batches --------------------------------------------------------------------------------- */

static void fill(enum apc_table table, int id, int n)
{
    for (int i = 1; i <= n; i++) {
        if (apc_table_known(table) && table != APC_TICK) {
            const struct apc_sample s = {.table = table, .id = id, .seq = i, .time = i * 1000};
            assert_int_equal(real->append(from, &s, 1), 1);
        } else {
            double value[2] = {i, 1};
            struct apc_vector v = {
                .table = table, .id = id, .seq = i, .time = i * 1000, .n = 2, .value = value};
            const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
            assert_int_equal(real->append_rows(from, &rows), 1);
        }
    }
}

static void test_a_batch_is_full_and_the_next_one_goes_on(void **state)
{
    static const int around[] = {-1, 0, 1};
    for (size_t i = 0; i < 3; i++) {
        for (int batches = 1; batches <= 2; batches++) {
            const int samples = batches * 16384 + around[i], ticks = batches * 1024 + around[i];
            fill(APC_SENSOR, 1, samples);
            fill(APC_SENSOR, 2, 3);
            fill(APC_TICK, 1, ticks);
            fill(APC_TICK, 2, 3);
            struct apc_replication *f = begin();
            largest = 0;
            assert_int_equal(apc_replication_step(f, FOREVER), samples + ticks + 6);
            assert_true(largest == 16384 || (batches == 1 && around[i] < 0));
            struct seen seen[4] = {{0}};
            assert_int_equal(apc_store_history(to, APC_SENSOR, 1, NULL, see_sample, &seen[0]), samples);
            assert_int_equal(apc_store_vectors(to, APC_TICK, 1, NULL, see_vector, &seen[1]), ticks);
            assert_int_equal(apc_store_history(to, APC_SENSOR, 2, NULL, see_sample, &seen[2]), 3);
            assert_int_equal(apc_store_vectors(to, APC_TICK, 2, NULL, see_vector, &seen[3]), 3);
            assert_int_equal(apc_replication_step(f, FOREVER), 0);
            apc_replication_destroy(f);
            tear_down(state);
            set_up(state);
        }
    }
}

static int count_elements(void *ctx, const struct apc_vector *v)
{
    *(size_t *)ctx += v->n;
    for (uint32_t i = 0; i < v->n; i++)
        assert_near(v->value[i], (double)v->seq + i, 0);
    return 0;
}

static void test_vectors_of_many_elements_share_a_batch_as_far_as_they_fit(void **state)
{
    enum { ROWS = 8 };
    static const uint32_t length[ROWS] = {65536, 65536, 65536, 0, 40000, 40000, 51072, 1};
    static double value[APC_ELEMENTS_MAX];
    size_t all = 0, got = 0;
    (void)state;
    for (int i = 0; i < ROWS; i++) {
        for (uint32_t k = 0; k < length[i]; k++)
            value[k] = i + 1 + (double)k;
        struct apc_vector v = {
            .table = APC_TICK, .id = 1, .seq = i + 1, .time = i, .n = length[i], .value = value};
        const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        assert_int_equal(apc_store_append_rows(from, &rows), 1);
        all += length[i];
    }
    struct apc_replication *f = begin();
    appends = 0;
    assert_int_equal(apc_replication_step(f, FOREVER), ROWS);
    assert_int_equal(apc_store_vectors(to, APC_TICK, 1, NULL, count_elements, &got), ROWS);
    assert_int_equal(got, all);
    apc_replication_destroy(f);
}

static void test_without_time_each_step_brings_something_and_all_have_their_turn(void **state)
{
    enum { VARIABLES = 3, ROWS = 17000 };
    (void)state;
    for (int id = 1; id <= VARIABLES; id++)
        fill(APC_SENSOR, id, ROWS);
    struct apc_replication *f = begin();
    int moved = 0, steps = 0;
    for (; moved < VARIABLES * ROWS; steps++) {
        const int now = apc_replication_step(f, 0);
        assert_true(now > 0 && now <= 2 * 16384);
        moved += now;
    }
    assert_int_equal(moved, VARIABLES * ROWS);
    assert_true(steps > 1);
    for (int id = 1; id <= VARIABLES; id++) {
        struct seen seen = {0};
        assert_int_equal(apc_store_history(to, APC_SENSOR, id, NULL, see_sample, &seen), ROWS);
    }
    assert_int_equal(apc_replication_step(f, 0), 0);
    apc_replication_destroy(f);
}

static void test_a_step_with_nothing_new_leaves_the_other_store_alone(void **state)
{
    (void)state;
    described("m");
    appended(1, 3);
    struct apc_replication *f = begin();
    assert_int_equal(apc_replication_step(f, FOREVER), 3 * 5);
    for (int i = 0; i < 3; i++) {
        calls_to = 0;
        assert_int_equal(apc_replication_step(f, FOREVER), 0);
        assert_int_equal(calls_to, 0);
    }
    described("m"); /* the same again is no news */
    assert_int_equal(apc_replication_step(f, FOREVER), 0);
    assert_int_equal(calls_to, 0);
    apc_replication_destroy(f);
}

static void test_who_an_author_is_is_asked_once(void **state)
{
    (void)state;
    appended(1, 9); /* of three */
    struct apc_replication *f = begin();
    asked = 0;
    assert_int_equal(apc_replication_step(f, FOREVER), 9 * 5);
    assert_int_equal(asked, 3 * 2);
    apc_replication_destroy(f);
}

static int count_event(void *ctx, const struct apc_event *e)
{
    assert_true(e->time != refused);
    ++*(int *)ctx;
    return 0;
}

static int count_timing(void *ctx, const struct apc_timing_row *row)
{
    assert_true(row->time != refused);
    ++*(int *)ctx;
    return 0;
}

/* Promise(database/role-writes-time) */
static void test_what_is_refused_for_good_keeps_no_other_back_and_is_counted(void **state)
{
    struct apc_replication_stats stats = {.size = sizeof stats};
    int n = 0;
    (void)state;
    appended(1, 5);
    struct apc_replication *f = begin();
    refused = 3 * 1000;
    assert_int_equal(apc_replication_step(f, FOREVER), 5 * 5 - 2);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.refused, 2);
    appended(6, 7);
    assert_int_equal(apc_replication_step(f, FOREVER), 2 * 5);
    assert_int_equal(real->events(to, &(struct apc_range){0}, count_event, &n), 6);
    assert_int_equal(real->timing(to, &(struct apc_range){0}, count_timing, &n), 6);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.refused, 2);
    assert_true(stats.lost.events == 0 && stats.lost.timing == 0);
    refused = 0;
    apc_replication_destroy(f);
}

static void test_all_the_room_is_left_where_nothing_is_overwritten(void **state)
{
    (void)state;
    appended(1, 3);
    struct apc_replication *f = begin();
    for (int i = 0; i < 3; i++) {
        assert_near(apc_replication_left(f), 1, 0);
        assert_true(apc_replication_step(f, FOREVER) >= 0);
        appended(4 + 10 * i, 13 + 10 * i);
    }
    calls = 0;
    fails_at = 1;
    assert_near(apc_replication_left(f), 1, 0); /* it is not known */
    apc_replication_destroy(f);
}

static void test_of_no_forward_there_is_nothing_to_tell(void **state)
{
    struct apc_replication_stats stats = {.size = sizeof stats, .samples = 7};
    (void)state;
    assert_string_equal(apc_replication_error(NULL), "nothing is forwarded");
    assert_near(apc_replication_left(NULL), 1, 0);
    apc_replication_stats(NULL, &stats);
    assert_int_equal(stats.samples, 0);
    apc_replication_destroy(NULL);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_whichever_call_fails_the_next_step_makes_up_for_it),
        T(test_whichever_call_fails_first_the_whole_gap_is_told_once),
        T(test_two_failures_one_after_the_other_are_as_one),
        T(test_a_step_with_nothing_new_leaves_the_other_store_alone),
        T(test_who_an_author_is_is_asked_once),
        T(test_what_is_refused_for_good_keeps_no_other_back_and_is_counted),
        T(test_all_the_room_is_left_where_nothing_is_overwritten),
        T(test_of_no_forward_there_is_nothing_to_tell),
        T(test_a_batch_is_full_and_the_next_one_goes_on),
        T(test_vectors_of_many_elements_share_a_batch_as_far_as_they_fit),
        T(test_without_time_each_step_brings_something_and_all_have_their_turn),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
