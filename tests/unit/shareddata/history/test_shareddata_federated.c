/* SPDX-License-Identifier: BSD-3-Clause */
/* A live store and its history as one: whatever is asked for, the answer is that of one store with
 * everything. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "scratch.h"
#include "shareddata/history/federated_internal.h"
#include "stores.h"

#define FOREVER (60 * APC_NS_PER_S)
#define BATCH   100

/* A live store of either kind, its history, both as one, and a store that has everything. */
struct world {
    struct apc_store *live, *history, *both, *all;
    struct apc_replication *replication;
    char uri[128];
    int64_t seq;
    int records;
};

static struct apc_store *open_uri(const char *uri)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    const struct apc_store_options options = {.size = sizeof options, .timeout = 20 * APC_NS_PER_S};
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s: %s", uri, why.text);
    }
    return store;
}

static void describe(struct apc_store *store, const char *experiment)
{
    struct apc_tag tags[2] = {{.table = APC_SENSOR, .id = 1, .name = "y", .unit = "m"},
                              {.table = APC_STATE, .id = 0, .name = "experiment"}};
    snprintf(tags[1].description, sizeof tags[1].description, "%s", experiment);
    ok(store, apc_store_put_tags(store, tags, 2));
}

static void world_begin(struct world *w, const char *scheme, const char *history)
{
    static int number;
    struct apc_error why = {""};
    char both[1024];
    *w = (struct world){.seq = 0};
    snprintf(w->uri, sizeof w->uri, "%sseam-%d-%d%s", scheme, (int)getpid(), ++number,
             strcmp(scheme, "shm:") == 0 ? "?size=1" : "");
    w->live = open_uri(w->uri);
    ok(w->live, apc_store_init(w->live));
    snprintf(both, sizeof both, "%.*s+%s", (int)strcspn(w->uri, "?"), w->uri, history);
    assert_int_equal(apc_store_live(both), strcspn(w->uri, "?"));
    w->both = open_uri(both);
    w->all = open_uri("mem:");
    ok(w->all, apc_store_init(w->all));
    w->history = open_uri(history);
    describe(w->live, "plant");
    if (apc_replication_create(&w->replication, w->live, w->history, &why) != 0) {
        fail_msg("%s", why.text);
    }
}

static void world_end(struct world *w)
{
    char path[160];
    apc_replication_destroy(w->replication);
    apc_store_close(w->both);
    apc_store_close(w->history);
    apc_store_close(w->live);
    apc_store_close(w->all);
    snprintf(path, sizeof path, "/dev/shm/apc.%.*s", (int)strcspn(w->uri + 4, "?"), w->uri + 4);
    unlink(path);
}

static void move(struct world *w)
{
    const int moved = apc_replication_step(w->replication, FOREVER);
    if (moved < 0) {
        fail_msg("%s", apc_replication_error(w->replication));
    }
}

/* The clock steps back by half a batch in each tenth. */
static apc_ns time_of(int64_t seq)
{
    return (1000000 + seq * 10 - (seq / (10 * BATCH)) * 5 * BATCH) * APC_NS_PER_MS;
}

static void append_record(struct apc_store *store, int n)
{
    struct apc_event e = {.time = time_of(n), .severity = APC_EVENT_INFO, .source = "test", .kind = "link"};
    snprintf(e.text, sizeof e.text, "event %d", n / 2); /* two are alike but for their time */
    ok(store, apc_store_append_events(store, &e, 1));
    const struct apc_timing_row row = {
        .time = n * APC_NS_PER_S, .task = "client", .quantity = "run", .count = 1, .mean = n};
    ok(store, apc_store_append_timing(store, &row, 1));
}

static void append_rows(struct apc_store *store, int64_t from, int64_t to)
{
    struct apc_sample s[BATCH];
    struct apc_vector v[BATCH];
    double value[BATCH];
    size_t n = 0;
    for (int64_t seq = from; seq <= to; seq++, n++) {
        value[n] = (double)(seq % 1024);
        s[n] = (struct apc_sample){.table = APC_SENSOR,
                                   .id = 1,
                                   .seq = seq,
                                   .time = time_of(seq),
                                   .value = value[n],
                                   .status = seq % 7 == 0 ? APC_BAD_NO_COMMUNICATION : APC_GOOD};
        v[n] = (struct apc_vector){
            .table = APC_TICK, .id = 1, .seq = seq, .time = s[n].time, .n = 1, .value = &value[n]};
    }
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = s, .n_samples = n, .vector = v, .n_vectors = n};
    const int stored = apc_store_append_rows(store, &rows);
    ok(store, stored);
    assert_int_equal(stored, 2 * n);
}

static void put(struct apc_store *store, const char *name, double value)
{
    struct apc_sample s = {.table = APC_SETPOINT, .id = 1, .value = value, .time = 5};
    s.author = (uint32_t)apc_store_author(store, name);
    ok(store, apc_store_put(store, &s, 1));
}

/* Some more of everything, for the live store and for the one that has all. */
static void grow(struct world *w, int batches)
{
    struct apc_store *stores[2] = {w->live, w->all};
    for (int i = 0; i < batches; i++, w->seq += BATCH, w->records++) {
        for (int k = 0; k < 2; k++) {
            append_rows(stores[k], w->seq + 1, w->seq + BATCH);
            append_record(stores[k], w->records + 1);
            put(stores[k], w->records % 3 ? "ada" : "bob", w->records);
        }
    }
}

/* What a store gave, in order. */
struct answer {
    uint64_t sum;
    int n;
    struct apc_store *store;
    struct apc_sample last;
    char author[APC_AUTHOR_LEN];
};

static void add(struct answer *a, const void *bytes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        a->sum = (a->sum ^ ((const unsigned char *)bytes)[i]) * UINT64_C(0x100000001b3) + 1;
    }
}

static int take_sample(void *ctx, const struct apc_sample *s)
{
    struct answer *a = ctx;
    const double row[] = {(double)s->seq, (double)s->time, s->value, s->status, (double)s->origin};
    add(a, row, sizeof row);
    a->last = *s;
    a->n++;
    return 0;
}

static int take_vector(void *ctx, const struct apc_vector *v)
{
    struct answer *a = ctx;
    const double row[] = {(double)v->seq, (double)v->time, v->value[0]};
    add(a, row, sizeof row);
    a->n++;
    return 0;
}

static int take_event(void *ctx, const struct apc_event *e)
{
    struct answer *a = ctx;
    add(a, &e->time, sizeof e->time);
    add(a, e->text, strlen(e->text));
    a->n++;
    return 0;
}

static int take_timing(void *ctx, const struct apc_timing_row *r)
{
    struct answer *a = ctx;
    add(a, &r->time, sizeof r->time);
    a->n++;
    return 0;
}

static int take_bin(void *ctx, const struct apc_history_bin *b)
{
    struct answer *a = ctx;
    const double row[] = {(double)b->from, (double)b->until, (double)b->count, (double)b->bad, b->min,
                          b->max,          b->last,          b->worst,         (double)b->seq};
    add(a, row, sizeof row);
    const int64_t mean = (int64_t)(b->mean * 1e6 + 0.5);
    add(a, &mean, sizeof mean);
    a->n++;
    return 0;
}

static struct answer ask(struct apc_store *store, int what, const struct apc_range *range)
{
    struct answer a = {.store = store};
    switch (what) {
    case 0:
        ok(store, apc_store_history(store, APC_SENSOR, 1, range, take_sample, &a));
        break;
    case 1:
        ok(store, apc_store_vectors(store, APC_TICK, 1, range, take_vector, &a));
        break;
    case 2:
        ok(store, apc_store_events(store, range, take_event, &a));
        break;
    case 3:
        ok(store, apc_store_timing(store, range, take_timing, &a));
        break;
    case 4:
        ok(store, apc_store_history(store, APC_SETPOINT, 1, range, take_sample, &a));
        if (a.last.author) {
            ok(store, apc_store_author_name(store, a.last.author, a.author));
        }
        break;
    default:
        ok(store, apc_store_history_bins(store, APC_SENSOR, 1, range->since ? range->since : 1,
                                         range->until > range->since + 1 ? range->until : time_of(100000), 37,
                                         take_bin, &a));
    }
    return a;
}

static unsigned random_below(unsigned *seed, unsigned n)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (*seed >> 8) % n;
}

static void assert_alike(struct world *w, const struct apc_range *range)
{
    for (int what = 0; what < 6; what++) {
        struct apc_range r = *range;
        r.after = what == 2 || what == 3 ? 0 : r.after; /* numbers are each store's own */
        const struct answer is = ask(w->both, what, &r), should = ask(w->all, what, &r);
        assert_string_equal(apc_store_error(w->both), "");
        if (is.n != should.n || is.sum != should.sum || strcmp(is.author, should.author) != 0) {
            fail_msg("question %d, since %lld until %lld last %zu after %lld: %d rows, expected %d (up to "
                     "seq %lld, %s and %s)",
                     what, (long long)r.since, (long long)r.until, r.last, (long long)r.after, is.n, should.n,
                     (long long)w->seq, is.author, should.author);
        }
    }
}

static void assert_any_window_alike(struct world *w)
{
    unsigned seed = 7;
    assert_alike(w, &(struct apc_range){0});
    for (int i = 0; i < 40; i++) {
        const unsigned to = (unsigned)w->seq + 200;
        struct apc_range range = {0};
        if (random_below(&seed, 2)) {
            range.since = time_of(random_below(&seed, to));
        }
        if (random_below(&seed, 2)) {
            range.until = time_of(random_below(&seed, to));
        }
        if (random_below(&seed, 3) == 0) {
            range.last = 1 + random_below(&seed, random_below(&seed, 2) ? to : 50);
        }
        if (random_below(&seed, 4) == 0) {
            range.after = random_below(&seed, to);
        }
        assert_alike(w, &range);
    }
}

/* What was newest at any instant. The live store's clock has its steps. */
static void assert_any_instant_alike(struct world *w)
{
    unsigned seed = 11;
    for (int i = 0; i < 60; i++) {
        const apc_ns at = time_of(random_below(&seed, (unsigned)w->seq + 200)) + (apc_ns)(i % 3 - 1) * 1000;
        struct apc_store *stores[2] = {w->both, w->all}, *then = NULL;
        struct apc_sample s[2][2] = {{{0}}};
        struct apc_vector v[2];
        double value[2] = {0};
        char author[2][APC_AUTHOR_LEN] = {"", ""};
        for (int k = 0; k < 2; k++) {
            s[k][0] = (struct apc_sample){.table = APC_SENSOR, .id = 1};
            s[k][1] = (struct apc_sample){.table = APC_SETPOINT, .id = 1};
            v[k] = (struct apc_vector){.table = APC_TICK, .id = 1, .room = 1, .value = &value[k]};
            struct apc_rows rows = {
                .size = sizeof rows, .sample = s[k], .n_samples = 2, .vector = &v[k], .n_vectors = 1};
            ok(stores[k], apc_store_past(&then, stores[k], at, NULL));
            ok(then, apc_store_read_rows(then, &rows));
            assert_string_equal(apc_store_error(then), "");
            if (s[k][1].author > 0) {
                ok(then, apc_store_author_name(then, s[k][1].author, author[k]));
            }
            apc_store_close(then);
            s[k][1].author = 0; /* a number of each store's own */
        }
        assert_memory_equal(s[0], s[1], sizeof s[0]);
        assert_true(v[0].seq == v[1].seq && v[0].time == v[1].time && v[0].status == v[1].status);
        assert_memory_equal(&value[0], &value[1], sizeof value[0]);
        assert_string_equal(author[0], author[1]);
    }
}

/* Of a ring, more than it holds. */
static void check_windows(const char *live, int batches)
{
    struct world w;
    world_begin(&w, live, store_uri);
    grow(&w, 1);
    move(&w); /* the history has it all */
    assert_any_window_alike(&w);
    for (int i = 0; i < batches; i++) {
        grow(&w, 1);
        move(&w);
    }
    grow(&w, 1); /* and then not the newest */
    assert_any_window_alike(&w);
    assert_any_instant_alike(&w);
    if (batches > 10) {
        const struct answer samples = ask(w.live, 0, &(struct apc_range){0});
        assert_true(samples.n < w.seq && ask(w.live, 1, &(struct apc_range){0}).n < w.seq);
    }
    world_end(&w);
}

static void test_any_window_over_memory_and_history_is_that_of_one_store(void **state)
{
    (void)state;
    check_windows("mem:", 3);
}

/*
 * Promise(stores/live-store-history): Live store and history read as one give every row once, in any
 *   window, while rows are moved and where the history is away or another's.
 */
static void test_any_window_over_a_ring_and_history_is_that_of_one_store(void **state)
{
    (void)state;
    if (strcmp(store_kind->name, "shm:") == 0) {
        skip(); /* as a history it would be no larger */
    }
    check_windows("shm:", 40);
}

static int take_while_it_moves(void *ctx, const struct apc_sample *s)
{
    struct world *w = ctx;
    if (s->seq == 50 || s->seq == 2550) {
        move(w);
    }
    assert_int_equal(s->seq, ++w->records);
    return 0;
}

/* Promise(stores/live-store-history) */
static void test_what_moves_meanwhile_is_given_once(void **state)
{
    (void)state;
    struct world w;
    world_begin(&w, "shm:", store_uri);
    for (int i = 0; i < 25; i++) {
        grow(&w, 1);
        move(&w);
    }
    grow(&w, 1);
    w.records = 0;
    assert_int_equal(apc_store_history(w.both, APC_SENSOR, 1, NULL, take_while_it_moves, &w), 26 * BATCH);
    world_end(&w);
}

static int use_it(void *ctx, const struct apc_sample *s)
{
    struct apc_sample again = {.table = APC_SENSOR, .id = s->id};
    assert_int_equal(apc_store_read(ctx, &again, 1), APC_ESTATE);
    return 1;
}

static void test_what_is_newest_and_every_write_is_the_live_stores(void **state)
{
    (void)state;
    struct world w;
    world_begin(&w, "shm:", store_uri);
    grow(&w, 1);
    move(&w);
    grow(&w, 1);
    assert_int_equal(newest(w.both, APC_SENSOR, 1).seq, 2 * BATCH);
    put(w.both, "eve", 77);
    assert_near(newest(w.live, APC_SETPOINT, 1).value, 77, 0);
    assert_near(newest(w.history, APC_SETPOINT, 1).value, 0, 0);
    assert_int_equal(apc_store_history(w.both, APC_SENSOR, 1, NULL, use_it, w.both), 1);
    struct apc_sample all[9];
    assert_int_equal(apc_store_variables(w.both, all, 9), 3);
    world_end(&w);
}

/* Promise(stores/live-store-history) */
static void test_how_far_the_history_is_behind_is_told(void **state)
{
    struct world w;
    struct apc_behind behind = {.size = sizeof behind};
    assert_int_equal(apc_store_behind(*state, &behind), 0);
    world_begin(&w, "shm:", store_uri);
    grow(&w, 1);
    assert_int_equal(apc_store_behind(w.both, &behind), 1);
    assert_true(behind.rows > 0 && behind.time == 0 && behind.nothing);
    move(&w);
    assert_int_equal(apc_store_behind(w.both, &behind), 1);
    assert_true(behind.rows == 0 && behind.time == 0 && !behind.nothing);
    grow(&w, 1); /* of a sensor, of a tick, and a setpoint */
    assert_int_equal(apc_store_behind(w.both, &behind), 1);
    assert_true(!behind.nothing && behind.rows == 2 * BATCH + 1 &&
                behind.time > apc_clock_utc(NULL) - 2 * time_of(2 * BATCH));
    world_end(&w);
    world_begin(&w, "shm:", "sqlite:/nonexistent/folder/history.db");
    append_rows(w.live, 1, BATCH);
    assert_int_equal(apc_store_behind(w.both, &behind), APC_ECONN);
    assert_non_null(strstr(apc_store_error(w.both), "the history is left out"));
    world_end(&w);
}

/* Promise(stores/live-store-history) */
static void test_without_its_history_it_gives_what_the_live_store_has(void **state)
{
    (void)state;
    struct world w;
    struct answer a = {0};
    world_begin(&w, "shm:", "sqlite:/nonexistent/folder/history.db");
    append_rows(w.live, 500, 500 + BATCH - 1);
    append_record(w.live, 1);
    ok(w.both, apc_store_history(w.both, APC_SENSOR, 1, NULL, take_sample, &a));
    assert_int_equal(a.n, BATCH);
    assert_non_null(strstr(apc_store_error(w.both), "the history is left out"));
    a.n = 0;
    ok(w.both, apc_store_events(w.both, NULL, take_event, &a));
    assert_int_equal(a.n, 1);
    assert_int_not_equal(apc_store_error(w.both)[0], '\0');
    assert_int_equal(newest(w.both, APC_SENSOR, 1).seq, 500 + BATCH - 1);
    assert_string_equal(apc_store_error(w.both), "");
    world_end(&w);
}

/* Promise(stores/live-store-history) */
static void test_another_experiments_history_is_left_out(void **state)
{
    struct world w;
    struct answer a = {0};
    describe(*state, "another");
    append_rows(*state, 1, BATCH);
    world_begin(&w, "shm:", store_uri);
    append_rows(w.live, 500, 500 + BATCH - 1);
    ok(w.both, apc_store_history(w.both, APC_SENSOR, 1, NULL, take_sample, &a));
    assert_int_equal(a.n, BATCH);
    assert_non_null(strstr(apc_store_error(w.both), "another experiment"));
    world_end(&w);
}

static void test_another_runs_history_is_left_out(void **state)
{
    struct world w;
    struct answer a = {0};
    append_rows(*state, 1000, 1000 + BATCH - 1);
    world_begin(&w, "shm:", store_uri);
    append_rows(w.live, 500, 500 + BATCH - 1);
    ok(w.both, apc_store_history(w.both, APC_SENSOR, 1, NULL, take_sample, &a));
    assert_int_equal(a.n, BATCH);
    assert_non_null(strstr(apc_store_error(w.both), "another run"));
    world_end(&w);
}

/* ---- A history that fails, or changes, between two calls ------------------------------------- */

static const struct apc_store_ops *real;
static const struct apc_store_ops *real_live;
static int calls, fails_at; /* the number of the one that fails; 0: none */
static struct world *grows; /* its live store, when the history's newest is asked for */

static bool fails(struct apc_store *s)
{
    if (++calls == fails_at) {
        apc_fail(&s->why, APC_ECONN, "call %d is lost", calls);
    }
    return calls == fails_at;
}

#define FAULTY(s, operation) return fails(s) ? APC_ECONN : (operation)

static int do_variables(struct apc_store *s, struct apc_sample *variables, size_t capacity)
{
    FAULTY(s, real->variables(s, variables, capacity));
}

static int do_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_sample_fn fn, void *ctx)
{
    FAULTY(s, real->history(s, table, id, range, fn, ctx));
}

static int do_vectors(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_vector_fn fn, void *ctx)
{
    FAULTY(s, real->vectors(s, table, id, range, fn, ctx));
}

static int do_bins(struct apc_store *s, enum apc_table table, int id, apc_ns since, apc_ns until, size_t n,
                   apc_history_bin_fn fn, void *ctx)
{
    FAULTY(s, real->history_bins(s, table, id, since, until, n, fn, ctx));
}

static int do_get_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    FAULTY(s, real->get_tags(s, tags, capacity));
}

static int do_read_rows(struct apc_store *s, struct apc_rows *rows)
{
    if (grows) {
        append_rows(grows->live, 600, 600);
        grows = NULL;
    }
    FAULTY(s, real->read_rows(s, rows));
}

static int do_events(struct apc_store *s, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    FAULTY(s, real->events(s, range, fn, ctx));
}

static int do_timing(struct apc_store *s, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    FAULTY(s, real->timing(s, range, fn, ctx));
}

/* The history has rows 300 to 399, the live store 500 to 599: a world whose history may fail. */
static struct apc_federated *two_parts(struct world *w)
{
    static struct apc_store_ops faulty;
    world_begin(w, "shm:", store_uri);
    struct apc_federated *s = (struct apc_federated *)w->both;
    describe(w->history, "plant");
    append_rows(w->history, 300, 399);
    append_rows(w->live, 500, 599);
    append_record(w->history, 1);
    append_record(w->live, 2);
    real = s->history->ops;
    faulty = *real;
    faulty.variables = do_variables;
    faulty.history = do_history;
    faulty.vectors = do_vectors;
    faulty.history_bins = do_bins;
    faulty.get_tags = do_get_tags;
    faulty.read_rows = do_read_rows;
    faulty.events = do_events;
    faulty.timing = do_timing;
    s->history->ops = &faulty;
    fails_at = 0;
    return s;
}

/* Whichever call fails, there is what the live store has, and no row of the history that comes back. */
/* Promise(stores/live-store-history) */
static void test_whichever_call_of_the_history_fails_it_is_left_out_whole(void **state)
{
    static const struct apc_range ranges[] = {{0}, {.last = 150}, {.last = 600}, {.after = 350}};
    struct world w;
    (void)state;
    struct apc_federated *s = two_parts(&w);
    for (int i = 0; i < 4 * 6; i++) {
        const int what = i / 4;
        const struct apc_range *range = &ranges[i % 4];
        if (what == 4 || ((what == 2 || what == 3) && range->after > 0)) {
            continue; /* nobody has set a setpoint; numbers are each store's own */
        }
        fails_at = 0;
        const struct answer whole = ask(w.both, what, range), live = ask(w.live, what, range);
        assert_string_equal(apc_store_error(w.both), "");
        assert_true(whole.sum != live.sum);
        bool failed = true;
        for (int k = 1; failed; k++) {
            s->checked = false;
            calls = 0;
            fails_at = k;
            const struct answer a = ask(w.both, what, range);
            failed = calls >= k;
            if (a.n != (failed ? live.n : whole.n) || a.sum != (failed ? live.sum : whole.sum)) {
                fail_msg("question %d, range %d, call %d: %d rows", what, i % 4, k, a.n);
            }
            assert_int_equal(strstr(apc_store_error(w.both), "the history is left out: ") != NULL, failed);
            const int asked = calls;
            s->quiet_until += failed ? 3600 * APC_NS_PER_S : 0; /* else it has passed on a busy machine */
            (void)ask(w.both, what, range);                     /* nor is it asked again at once */
            assert_int_equal(failed ? calls - asked : 0, 0);
            s->quiet_until = 0;
            assert_true(failed || k > 2);
        }
    }
    fails_at = 0;
    struct apc_sample variables[9];
    assert_int_equal(apc_store_variables(w.both, variables, 9), 2);
    world_end(&w);
}

static int live_calls; /* until the live store fails */

static int do_live_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                           apc_sample_fn fn, void *ctx)
{
    return live_calls-- == 0 ? apc_fail(&s->why, APC_ETIMEDOUT, "it is slow")
                             : real_live->history(s, table, id, range, fn, ctx);
}

static void test_what_fails_is_told_and_what_is_not_needed_is_not_asked(void **state)
{
    struct world w;
    struct answer a = {0};
    (void)state;
    struct apc_federated *s = two_parts(&w);
    const int before = calls;
    assert_int_equal(ask(w.both, 0, &(struct apc_range){.last = 1}).last.seq, 599);
    assert_int_equal(calls, before); /* the newest row is the live store's */
    fails_at = calls + 1;
    assert_int_equal(apc_store_history_bins(w.both, APC_SENSOR, 1, time_of(1), time_of(2), 3, take_bin, &a),
                     0);
    assert_has(apc_store_error(w.both), "the history is left out: "); /* also where there is nothing at all */
    s->quiet_until = 0;
    struct apc_store_ops slow = *s->base.inner->ops;
    real_live = s->base.inner->ops;
    slow.history = do_live_history;
    s->base.inner->ops = &slow;
    live_calls = 1; /* the first says how far back it reaches */
    assert_int_equal(
        apc_store_history_bins(w.both, APC_SENSOR, 1, time_of(300), time_of(590), 3, take_bin, &a),
        APC_ETIMEDOUT);
    assert_string_equal(apc_store_error(w.both), "it is slow");
    s->base.inner->ops = real_live;
    world_end(&w);
}

static void test_records_are_one_where_they_say_the_same(void **state)
{
    static const struct {
        const char *old, *new;
        int n;
    } of[] = {{"one", "two", 2}, {"one", "one", 1}, {"one", "onf", 2}, {"", "one", 2}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct world w;
        struct answer a = {0};
        world_begin(&w, "shm:", i == 0 ? store_uri : "mem:");
        struct apc_federated *s = (struct apc_federated *)w.both;
        ok(s->history, apc_store_init(s->history));
        describe(s->history, "plant");
        for (int k = 0; k < 2; k++) {
            struct apc_event e = {.time = time_of(5), .severity = APC_EVENT_INFO, .source = "x", .kind = "y"};
            snprintf(e.text, sizeof e.text, "%s", k ? of[i].new : of[i].old);
            ok(k ? w.live : s->history, apc_store_append_events(k ? w.live : s->history, &e, 1));
        }
        ok(w.both, apc_store_events(w.both, NULL, take_event, &a));
        assert_int_equal(a.n, of[i].n);
        world_end(&w);
    }
}

static int note_seq(void *ctx, const struct apc_sample *s)
{
    ((int64_t *)ctx)[0] += ((int64_t *)ctx)[0] == 0 ? s->seq : 0;
    ((int64_t *)ctx)[1] = s->seq;
    return 0;
}

/* The newest 101, of which the live store has 100, and 101 by the time that the history is asked. */
static void test_what_the_live_store_gets_meanwhile_makes_nothing_older_the_newest(void **state)
{
    struct world w;
    int64_t ends[2] = {0};
    (void)state;
    two_parts(&w);
    grows = &w;
    assert_int_equal(
        apc_store_history(w.both, APC_SENSOR, 1, &(struct apc_range){.last = 101}, note_seq, ends), 101);
    assert_int_equal(ends[0], 399);
    assert_int_equal(ends[1], 599);
    world_end(&w);
}

static int note_author(void *ctx, const struct apc_sample *s)
{
    ((uint32_t *)ctx)[s->seq] = s->author;
    return 0;
}

/* Promise(stores/live-store-history) */
static void test_who_set_something_is_told_by_the_store_that_has_it(void **state)
{
    static const char *const name[] = {NULL, "bob", NULL, "ada", NULL, "bob"};
    struct world w;
    uint32_t author[6] = {9, 9, 9, 9, 9, 9};
    char said[APC_AUTHOR_LEN];
    (void)state;
    world_begin(&w, "shm:", store_uri);
    describe(w.history, "plant");
    for (int seq = 1; seq <= 5; seq++) { /* they count them in another order */
        struct apc_store *const store = seq <= 2 ? w.history : w.live;
        struct apc_sample s = {.table = APC_SETPOINT, .id = 1, .seq = seq, .time = time_of(seq)};
        s.author = name[seq] ? (uint32_t)apc_store_author(store, name[seq]) : 0;
        assert_int_equal(apc_store_append(store, &s, 1), 1);
    }
    assert_int_equal(apc_store_history(w.both, APC_SETPOINT, 1, NULL, note_author, author), 5);
    for (int seq = 1; seq <= 5; seq++) {
        if (name[seq]) {
            assert_int_equal(apc_store_author_name(w.both, author[seq], said), 0);
            assert_string_equal(said, name[seq]);
        } else {
            assert_int_equal(author[seq], 0);
        }
    }
    world_end(&w);
}

static void test_of_one_variable_the_history_may_have_nothing(void **state)
{
    struct world w;
    struct apc_behind behind = {.size = sizeof behind};
    struct apc_sample s = {.table = APC_SENSOR, .id = 1, .time = time_of(1)};
    (void)state;
    world_begin(&w, "shm:", store_uri);
    for (s.seq = 1; s.seq <= 3; s.seq++) {
        assert_int_equal(apc_store_append(w.live, &s, 1), 1);
    }
    assert_int_equal(apc_store_behind(w.both, &behind), 1);
    assert_true(behind.nothing && behind.rows == 3 && behind.time == 0);
    world_end(&w);
    world_begin(&w, "shm:", store_uri); /* nor has the live store */
    assert_int_equal(apc_store_behind(w.both, &behind), 1);
    assert_true(!behind.nothing && behind.rows == 0 && behind.time == 0);
    world_end(&w);
}

static void test_variables_are_those_of_both_each_once(void **state)
{
    static const struct apc_sample only[] = {{.table = APC_SETPOINT, .id = 1, .seq = 1},
                                             {.table = APC_SETPOINT, .id = 2, .seq = 1},
                                             {.table = APC_MANUAL, .id = 1, .seq = 1},
                                             {.table = APC_MANUAL, .id = 7, .seq = 1}};
    struct world w;
    struct apc_sample all[20];
    (void)state;
    two_parts(&w);
    assert_int_equal(apc_store_append(w.history, only, 4), 4);
    assert_int_equal(apc_store_variables(w.both, all, 20), 6);
    for (int i = 0; i < 6; i++) {
        assert_true(i == 0 || all[i].table > all[i - 1].table ||
                    (all[i].table == all[i - 1].table && all[i].id > all[i - 1].id));
    }
    assert_int_equal(apc_store_variables(w.both, all, 3), 6); /* as many as there is room for */
    fails_at = calls + 1;
    assert_int_equal(apc_store_variables(w.both, all, 20), 2);
    world_end(&w);
}

static void test_what_is_waited_for_is_the_live_stores(void **state)
{
    struct world w;
    struct apc_sample seen = {.table = APC_SENSOR, .id = 1, .seq = 599};
    (void)state;
    two_parts(&w);
    assert_int_equal(apc_store_wait(w.both, &seen, 1, 0), 0);
    append_rows(w.live, 600, 600);
    assert_int_equal(apc_store_wait(w.both, &seen, 1, FOREVER), 1);
    world_end(&w);
}

static int tags_there; /* at the second look */

static int get_fewer_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    (void)s, (void)tags;
    return capacity == 0 ? 2 : tags_there;
}

static void test_descriptions_that_go_between_two_looks_are_none(void **state)
{
    struct apc_store *store = *state;
    const struct apc_store_ops *const own = store->ops;
    struct apc_store_ops ops = *own;
    struct apc_tag *tags = NULL;
    size_t n = 9;
    ops.get_tags = get_fewer_tags;
    store->ops = &ops;
    for (tags_there = 0; tags_there <= 3; tags_there++) {
        assert_int_equal(apc_tags_load(store, &tags, &n), 0);
        assert_int_equal(n, tags_there < 2 ? tags_there : 2);
        free(tags);
    }
    tags_there = APC_ECONN;
    assert_int_equal(apc_tags_load(store, &tags, &n), APC_ECONN);
    assert_int_equal(n, 0);
    free(tags);
    store->ops = own;
}

static void test_what_two_stores_say_alike_is_alike_and_nothing_else(void **state)
{
    static const struct apc_tag as = {.table = APC_SENSOR,
                                      .id = 1,
                                      .name = "y",
                                      .unit = "m",
                                      .description = "level",
                                      .controller = "base",
                                      .area = "left",
                                      .low = 1,
                                      .high = 2,
                                      .display_low = 3,
                                      .display_high = 4,
                                      .period = 5,
                                      .step = 6,
                                      .length = 7};
    struct apc_tag other[11];
    (void)state;
    for (size_t i = 0; i < 11; i++) {
        other[i] = as;
    }
    assert_true(apc_tags_alike(&as, &other[0]));
    other[0].name[0] = other[1].unit[0] = other[2].description[0] = other[3].controller[0] =
        other[4].area[0] = 'z';
    other[5].low = other[6].high = other[7].display_low = other[8].display_high = other[9].period = -1;
    other[10].step = -1;
    for (size_t i = 0; i < 11; i++) {
        assert_false(apc_tags_alike(&as, &other[i]));
        assert_false(apc_tags_alike(&other[i], &as));
    }
    other[10] = as;
    other[10].length = 8;
    assert_false(apc_tags_alike(&as, &other[10]));
}

/* ---- A live store that begins where its history ended
 * ------------------------------------------------------ */

static void test_what_nobody_known_has_set_is_taken_over_as_nobodys(void **state)
{
    struct world w;
    struct apc_error why = {""};
    struct apc_sample s[2] = {{.table = APC_SETPOINT, .id = 1, .seq = 4, .time = time_of(4), .value = 2},
                              {.table = APC_SETPOINT, .id = 2, .seq = 5, .time = time_of(5), .author = 77}};
    (void)state;
    world_begin(&w, "shm:", store_uri);
    assert_true(apc_store_author(w.live, "eve") > 0);
    assert_int_equal(apc_store_append(w.history, s, 2), 2);
    assert_int_equal(apc_store_take_over(w.live, w.history, &why), 2);
    for (int id = 1; id <= 2; id++) {
        const struct apc_sample now = newest(w.live, APC_SETPOINT, id);
        assert_int_equal(now.seq, 3 + id);
        assert_int_equal(now.author, 0);
    }
    world_end(&w);
}

static int no_count(struct apc_store *s, int64_t first)
{
    (void)first;
    return apc_fail(&s->why, APC_EFULL, "it cannot count");
}

static void test_whose_failure_keeps_a_live_store_from_going_on_is_said(void **state)
{
    struct world w;
    struct apc_error why = {""};
    (void)state;
    world_begin(&w, "shm:", store_uri);
    const struct apc_store_ops *const live = w.live->ops;
    struct apc_store_ops away = *w.history->ops, counts = *live;
    real = w.history->ops;
    away.variables = do_variables;
    w.history->ops = &away;
    counts.count_from = no_count;
    fails_at = calls + 1;
    assert_int_equal(apc_store_take_over(w.live, w.history, &why), APC_ECONN);
    assert_has(why.text, "the history: call ");
    w.live->ops = &counts;
    fails_at = calls + 1;
    assert_int_equal(apc_store_take_over(w.live, w.history, &why), APC_EFULL);
    assert_string_equal(why.text, "it cannot count");
    fails_at = 0;
    w.live->ops = live;
    w.history->ops = real;
    world_end(&w);
}

/* ---- Its name -------------------------------------------------------------------------------- */

static void test_a_uri_of_two_says_what_is_wrong_with_either(void **state)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:a+nonsense:b", NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "unknown store \"nonsense:\""));
    assert_int_equal(apc_store_open(&store, "shm:a/b+mem:", NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "shm:a/b"));
    assert_int_equal(apc_store_live("sqlite:a+b.db"), strlen("sqlite:a+b.db"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_any_window_over_memory_and_history_is_that_of_one_store),
        T(test_any_window_over_a_ring_and_history_is_that_of_one_store),
        T(test_what_moves_meanwhile_is_given_once),
        T(test_what_is_newest_and_every_write_is_the_live_stores),
        T(test_how_far_the_history_is_behind_is_told),
        T(test_without_its_history_it_gives_what_the_live_store_has),
        T(test_another_experiments_history_is_left_out),
        T(test_another_runs_history_is_left_out),
        T(test_a_uri_of_two_says_what_is_wrong_with_either),
        T(test_whichever_call_of_the_history_fails_it_is_left_out_whole),
        T(test_what_the_live_store_gets_meanwhile_makes_nothing_older_the_newest),
        T(test_who_set_something_is_told_by_the_store_that_has_it),
        T(test_of_one_variable_the_history_may_have_nothing),
        T(test_what_fails_is_told_and_what_is_not_needed_is_not_asked),
        T(test_records_are_one_where_they_say_the_same),
        T(test_variables_are_those_of_both_each_once),
        T(test_what_is_waited_for_is_the_live_stores),
        T(test_descriptions_that_go_between_two_looks_are_none),
        T(test_what_two_stores_say_alike_is_alike_and_nothing_else),
        T(test_what_nobody_known_has_set_is_taken_over_as_nobodys),
        T(test_whose_failure_keeps_a_live_store_from_going_on_is_said),
    };
    int failed = 0;
    while (stores_next()) {
        failed += store_kind->spooled ? 0 : cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    }
    return failed;
}
