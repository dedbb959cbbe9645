/* SPDX-License-Identifier: BSD-3-Clause */
/* A live store and its history, both in memory: each call of either fails in turn, each bound is met exactly. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "shareddata/history/federated_internal.h"

/* ---- Two stores of which one fails ------------------------------------------------------------ */

static struct apc_store *both, *live, *old;
static struct apc_federated *federated;

/* Of each of the two: its own functions, how often they were called, and which call fails. */
struct side {
    struct apc_store *store;
    const struct apc_store_ops *real;
    struct apc_store_ops ops;
    int calls, fails_at;
};
static struct side sides[2]; /* the live one, the history */

static struct side *side_of(const struct apc_store *s)
{
    return s == sides[0].store ? &sides[0] : &sides[1];
}

static bool fails(struct apc_store *s)
{
    struct side *x = side_of(s);
    const bool it_does = ++x->calls == x->fails_at;
    if (it_does)
        apc_fail(&s->why, APC_ETIMEDOUT, "%s call %d is lost", x == &sides[0] ? "live" : "old", x->calls);
    return it_does;
}

#define FAULTY(s, call) return fails(s) ? APC_ETIMEDOUT : side_of(s)->real->call

static int do_variables(struct apc_store *s, struct apc_sample *v, size_t capacity)
{
    FAULTY(s, variables(s, v, capacity));
}

static int do_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_sample_fn fn, void *ctx)
{
    FAULTY(s, history(s, table, id, range, fn, ctx));
}

static int do_vectors(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_vector_fn fn, void *ctx)
{
    FAULTY(s, vectors(s, table, id, range, fn, ctx));
}

static int do_bins(struct apc_store *s, enum apc_table table, int id, apc_ns since, apc_ns until, size_t n,
                   apc_history_bin_fn fn, void *ctx)
{
    FAULTY(s, history_bins(s, table, id, since, until, n, fn, ctx));
}

static int do_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    FAULTY(s, get_tags(s, tags, capacity));
}

static int do_read_rows(struct apc_store *s, struct apc_rows *rows)
{
    FAULTY(s, read_rows(s, rows));
}

static int do_events(struct apc_store *s, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    FAULTY(s, events(s, range, fn, ctx));
}

static int do_timing(struct apc_store *s, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    FAULTY(s, timing(s, range, fn, ctx));
}

static int do_author_name(struct apc_store *s, uint32_t number, char name[APC_AUTHOR_LEN])
{
    FAULTY(s, author_name(s, number, name));
}

static int do_read(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    FAULTY(s, read(s, samples, n));
}

static int do_append(struct apc_store *s, const struct apc_sample *samples, size_t n)
{
    FAULTY(s, append(s, samples, n));
}

static int do_append_rows(struct apc_store *s, const struct apc_rows *rows)
{
    FAULTY(s, append_rows(s, rows));
}

static int do_append_events(struct apc_store *s, const struct apc_event *events, size_t n)
{
    FAULTY(s, append_events(s, events, n));
}

static int do_author(struct apc_store *s, const char *name)
{
    FAULTY(s, author(s, name));
}

static void watch(struct side *x, struct apc_store *s)
{
    *x = (struct side){.store = s, .real = s->ops, .ops = *s->ops};
    x->ops.variables = do_variables;
    x->ops.history = do_history;
    x->ops.vectors = do_vectors;
    x->ops.history_bins = do_bins;
    x->ops.get_tags = do_tags;
    x->ops.read_rows = do_read_rows;
    x->ops.events = do_events;
    x->ops.timing = do_timing;
    x->ops.author = do_author;
    x->ops.author_name = do_author_name;
    x->ops.read = do_read;
    x->ops.append = do_append;
    x->ops.append_rows = do_append_rows;
    x->ops.append_events = do_append_events;
    s->ops = &x->ops;
}

static void must(struct apc_store *s, int rc)
{
    if (rc < 0)
        fail_msg("%s: %s", apc_err_name(rc), apc_store_error(s));
}

static int set_up(void **state)
{
    struct apc_error why;
    (void)state;
    if (apc_store_open(&both, "mem:+mem:", NULL, &why) < 0)
        fail_msg("%s", why.text);
    federated = (struct apc_federated *)both;
    live = federated->base.inner;
    old = federated->history;
    must(live, apc_store_init(live));
    must(old, apc_store_init(old));
    watch(&sides[0], live);
    watch(&sides[1], old);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    live->ops = sides[0].real;
    old->ops = sides[1].real;
    apc_store_close(both);
    return 0;
}

static void begin_counting(int live_fails_at, int old_fails_at)
{
    sides[0].calls = sides[1].calls = 0;
    sides[0].fails_at = live_fails_at;
    sides[1].fails_at = old_fails_at;
    federated->checked = false;
    federated->quiet_until = 0;
}

/* ---- Rows ------------------------------------------------------------------------------------- */

#define TIME(seq) ((seq)*APC_NS_PER_S)

static void sample(struct apc_store *s, enum apc_table table, int id, int64_t from, int64_t to)
{
    for (int64_t seq = from; seq <= to; seq++) {
        const struct apc_sample row = {
            .table = table, .id = id, .seq = seq, .time = TIME(seq), .value = (double)seq};
        must(s, apc_store_append(s, &row, 1));
    }
}

static void vector(struct apc_store *s, int64_t from, int64_t to)
{
    for (int64_t seq = from; seq <= to; seq++) {
        double value[2] = {(double)seq, 2};
        struct apc_vector v = {
            .table = APC_TICK, .id = 1, .seq = seq, .time = TIME(seq), .n = 2, .value = value};
        const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        must(s, apc_store_append_rows(s, &rows));
    }
}

static void event(struct apc_store *s, int64_t n)
{
    struct apc_event e = {.time = TIME(n), .severity = APC_EVENT_INFO, .source = "x", .kind = "y"};
    snprintf(e.text, sizeof e.text, "event %d", (int)n);
    must(s, apc_store_append_events(s, &e, 1));
}

static void timing(struct apc_store *s, int64_t n)
{
    const struct apc_timing_row r = {.time = TIME(n), .task = "t", .quantity = "run", .count = 1};
    must(s, apc_store_append_timing(s, &r, 1));
}

/* The history has 1 to 10 of everything, the live store 5 to 14. */
static void fill(void)
{
    sample(old, APC_SENSOR, 1, 1, 10);
    sample(live, APC_SENSOR, 1, 5, 14);
    vector(old, 1, 10);
    vector(live, 5, 14);
    for (int i = 1; i <= 14; i++)
        for (int k = 0; k < 2; k++)
            if (k ? i >= 5 : i <= 10) {
                event(k ? live : old, i);
                timing(k ? live : old, i);
            }
}

/* What was given: the times of the rows, and when the caller has enough. */
struct given {
    int n, enough; /* 0: never */
    apc_ns first, last;
    bool in_order;
};

static int give(struct given *g, apc_ns time)
{
    g->in_order = g->n == 0 || (g->in_order && time == g->last + TIME(1));
    g->first = g->n++ ? g->first : time;
    g->last = time;
    return g->n == g->enough;
}

static int give_sample(void *ctx, const struct apc_sample *s)
{
    assert_near(s->value, (double)s->seq, 0);
    return give(ctx, s->time);
}

static int give_vector(void *ctx, const struct apc_vector *v)
{
    assert_int_equal(v->n, 2);
    return give(ctx, v->time);
}

static int give_event(void *ctx, const struct apc_event *e)
{
    return give(ctx, e->time);
}

static int give_timing(void *ctx, const struct apc_timing_row *r)
{
    return give(ctx, r->time);
}

static int give_bin(void *ctx, const struct apc_history_bin *b)
{
    struct given *g = ctx;
    g->n += (int)b->count;
    return 0;
}

enum { SAMPLES, VECTORS, EVENTS, TIMING, BINS, QUESTIONS };

static int ask(int what, const struct apc_range *range, struct given *g)
{
    const int enough = g->enough;
    *g = (struct given){.enough = enough};
    return what == SAMPLES   ? apc_store_history(both, APC_SENSOR, 1, range, give_sample, g)
           : what == VECTORS ? apc_store_vectors(both, APC_TICK, 1, range, give_vector, g)
           : what == EVENTS  ? apc_store_events(both, range, give_event, g)
           : what == TIMING
               ? apc_store_timing(both, range, give_timing, g)
               : apc_store_history_bins(both, APC_SENSOR, 1, TIME(1), TIME(14) + 1, 4, give_bin, g);
}

static void any_window_is_that_of_fourteen_rows(void **state)
{
    (void)state;
    fill();
    for (int what = SAMPLES; what <= TIMING; what++)
        for (int since = 0; since <= 15; since++)
            for (int until = 0; until <= 16; until++)
                for (size_t last = 0; last <= 15; last++) {
                    const struct apc_range range = {
                        .since = since ? TIME(since) : 0, .until = until ? TIME(until) : 0, .last = last};
                    const int from = since ? since : 1, to = until && until < 15 ? until - 1 : 14,
                              all = to >= from ? to - from + 1 : 0,
                              n = last > 0 && (int)last < all ? (int)last : all;
                    struct given g = {0};
                    const int rc = ask(what, &range, &g);
                    if (rc != n || g.n != n || (n > 0 && (!g.in_order || g.last != TIME(to))))
                        fail_msg(
                            "question %d, since %d until %d last %zu: %d rows, the last of %lld; expected %d",
                            what, since, until, last, rc, (long long)g.last, n);
                }
}

static void who_has_enough_gets_no_more(void **state)
{
    (void)state;
    fill();
    for (int what = SAMPLES; what <= TIMING; what++)
        for (int enough = 1; enough <= 14; enough++)
            for (size_t last = 0; last <= 14; last += 7) {
                struct given g = {.enough = enough};
                const int all = last ? (int)last : 14, n = enough < all ? enough : all;
                assert_int_equal(ask(what, &(struct apc_range){.last = last}, &g), n);
                assert_int_equal(g.n, n);
                assert_int_equal(g.first, TIME(15 - all));
            }
}

static void the_history_is_asked_where_the_live_store_does_not_reach_and_only_there(void **state)
{
    static const struct {
        struct apc_range range;
        bool asked;
    } of[] = {{{.after = 4}, false},
              {{.after = 3}, true},
              {{.after = 14}, false},
              {{.since = TIME(5)}, true}, /* there may be more of that time */
              {{.since = TIME(5) + 1}, false},
              {{.last = 10}, false},
              {{.last = 9}, false},
              {{.last = 11}, true},
              {{.last = 3, .until = TIME(8)}, false},
              {{.last = 4, .until = TIME(8)}, true},
              {{0}, true}};
    (void)state;
    fill();
    for (int what = SAMPLES; what <= VECTORS; what++)
        for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
            struct given g = {0};
            begin_counting(0, 0);
            must(both, ask(what, &of[i].range, &g));
            if ((sides[1].calls > 0) != of[i].asked)
                fail_msg("question %d, case %zu: %d calls", what, i, sides[1].calls);
        }
    sample(live, APC_SENSOR, 2, 1, 3); /* from its very first row on */
    begin_counting(0, 0);
    struct given g = {0};
    assert_int_equal(apc_store_history(both, APC_SENSOR, 2, NULL, give_sample, &g), 3);
    assert_int_equal(sides[1].calls, 0);
}

/* What the live store cannot give is its failure; what it cannot say of the history leaves that out, and says
 * so. */
static void whichever_call_of_the_live_store_fails_it_is_told(void **state)
{
    static const struct apc_range ranges[] = {{0}, {.last = 3}, {.last = 12}, {.since = TIME(7)}};
    (void)state;
    fill();
    for (int what = 0; what < QUESTIONS; what++)
        for (size_t i = 0; i < 4; i++) {
            struct given whole = {0}, g = {0};
            begin_counting(0, 0);
            must(both, ask(what, &ranges[i], &whole));
            const int calls = sides[0].calls;
            for (int k = 1; k <= calls; k++) {
                char text[40];
                begin_counting(k, 0);
                const int rc = ask(what, &ranges[i], &g);
                snprintf(text, sizeof text, "live call %d is lost", k);
                if (!strstr(apc_store_error(both), text))
                    fail_msg("question %d, range %zu: \"%s\", expected \"%s\"", what, i,
                             apc_store_error(both), text);
                if (rc < 0)
                    assert_int_equal(rc, APC_ETIMEDOUT);
                else
                    assert_has(apc_store_error(both), "the history is left out: ");
                assert_true(rc < 0 || g.n <= whole.n);
                assert_false(both->streaming);
            }
        }
}

static void a_history_that_fails_again_and_again_is_counted_until_it_answers(void **state)
{
    struct given g = {0};
    (void)state;
    fill();
    for (unsigned times = 1; times <= 3; times++) {
        begin_counting(0, 1);
        assert_int_equal(ask(SAMPLES, &(struct apc_range){0}, &g), 10);
        assert_int_equal(federated->away, times);
        assert_int_equal(federated->failed, APC_ETIMEDOUT);
        assert_true(federated->quiet_until > apc_clock_mono(NULL) - 60 * APC_NS_PER_S);
    }
    begin_counting(0, 0);
    assert_int_equal(ask(SAMPLES, &(struct apc_range){0}, &g), 14);
    assert_int_equal(federated->away, 0);
}

static void a_history_may_have_as_much_as_the_live_store_and_no_more(void **state)
{
    struct given g = {0};
    (void)state;
    sample(old, APC_SENSOR, 1, 1, 9);
    assert_int_equal(ask(SAMPLES, &(struct apc_range){0}, &g), 9); /* the live store has nothing yet */
    assert_string_equal(apc_store_error(both), "");
    sample(live, APC_SENSOR, 1, 5, 9);
    assert_int_equal(ask(SAMPLES, &(struct apc_range){0}, &g), 9);
    assert_string_equal(apc_store_error(both), "");
    sample(old, APC_SENSOR, 1, 10, 10);
    assert_int_equal(ask(SAMPLES, &(struct apc_range){0}, &g), 5);
    assert_has(
        apc_store_error(both),
        "the history is left out: it has sensor 1 up to seq 10, newer than 9 here: it is another run's");
}

/* ---- Variables, and how far the history is behind ----------------------------------------------- */

static void variables_are_those_of_the_live_store_where_the_history_fails(void **state)
{
    struct apc_sample v[9];
    (void)state;
    sample(live, APC_SENSOR, 1, 1, 1);
    sample(old, APC_SENSOR, 1, 1, 1);
    sample(old, APC_SENSOR, 2, 1, 1);
    sample(old, APC_ACTUATOR, 1, 1, 1);
    begin_counting(0, 0);
    assert_int_equal(apc_store_variables(both, v, 9), 3);
    const int calls[2] = {sides[0].calls, sides[1].calls};
    for (int k = 1; k <= calls[1]; k++) {
        begin_counting(0, k);
        const int n = apc_store_variables(both, v, 9);
        assert_int_equal(n, 1);
        assert_true(v[0].table == APC_SENSOR && v[0].id == 1);
    }
    int failures = 0;
    for (int k = 1; k <= calls[0]; k++) {
        begin_counting(k, 0);
        const int n = apc_store_variables(both, v, 9);
        assert_true(n == APC_ETIMEDOUT || n == 1); /* what belongs together cannot be compared */
        assert_has(apc_store_error(both), "live call ");
        failures += n < 0;
    }
    assert_int_equal(failures, 2);
}

/* As of now, since it is at @p since. */
static void assert_behind(uint64_t rows, apc_ns since)
{
    const apc_ns before = apc_clock_utc(NULL), some = APC_NS_PER_MS;
    struct apc_behind behind = {.size = sizeof behind};
    assert_int_equal(apc_store_behind(both, &behind), 1);
    assert_int_equal(behind.rows, rows);
    assert_true(behind.time >= before - since - some && behind.time <= apc_clock_utc(NULL) - since + some);
    assert_false(behind.nothing);
}

/* Promise(stores/live-store-history) */
static void a_row_that_comes_once_an_hour_is_not_an_hour_late(void **state)
{
    const apc_ns now = apc_clock_utc(NULL);
    struct apc_sample row = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = now - TIME(3600)};
    (void)state;
    must(live, apc_store_append(live, &row, 1));
    must(old, apc_store_append(old, &row, 1));
    row.seq = 2;
    row.time = now;
    must(live, apc_store_append(live, &row, 1));
    assert_behind(1, now);
}

/* Promise(stores/live-store-history) */
static void what_comes_by_a_clock_that_is_ahead_is_late_all_the_same(void **state)
{
    const apc_ns ahead = apc_clock_utc(NULL) + TIME(3600);
    struct apc_behind behind = {.size = sizeof behind};
    struct apc_sample row = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = ahead};
    (void)state;
    must(old, apc_store_append(old, &row, 1));
    for (; row.seq <= 61; row.seq++, row.time += TIME(1))
        must(live, apc_store_append(live, &row, 1));
    assert_int_equal(apc_store_behind(both, &behind), 1);
    assert_int_equal(behind.rows, 60);
    assert_in_range(behind.time, TIME(59) - APC_NS_PER_MS, TIME(59) + APC_NS_PER_MS);
}

static void what_the_history_has_not_got_is_counted_and_the_longest_told(void **state)
{
    struct apc_behind behind = {.size = sizeof behind};
    (void)state;
    sample(live, APC_SENSOR, 1, 1, 10);
    sample(old, APC_SENSOR, 1, 1, 4);
    sample(live, APC_SENSOR, 2, 1, 3);
    sample(old, APC_SENSOR, 2, 1, 3);
    vector(live, 1, 9);
    vector(old, 1, 2);
    sample(live, APC_ACTUATOR, 1, 1, 5);
    sample(old, APC_ACTUATOR, 1, 1, 4);
    assert_behind(6 + 7 + 1, TIME(3));
    sample(live, APC_SENSOR, 3, 1, 20); /* of one it has nothing: as long as the newest, at least */
    assert_behind(14 + 20, TIME(3));
    begin_counting(0, 0);
    assert_int_equal(apc_store_behind(both, &behind), 1);
    const int calls[2] = {sides[0].calls, sides[1].calls};
    for (int side = 0; side < 2; side++)
        for (int k = 1; k <= calls[side]; k++) {
            begin_counting(side == 0 ? k : 0, side == 1 ? k : 0);
            assert_int_equal(apc_store_behind(both, &behind), APC_ETIMEDOUT);
            assert_has(apc_store_error(both), side == 0 ? "live call " : "old call ");
        }
    sides[0].fails_at = sides[1].fails_at = 0;
    federated->quiet_until = apc_clock_mono(NULL) + 3600 * APC_NS_PER_S;
    assert_int_equal(apc_store_behind(both, &behind), APC_ETIMEDOUT); /* as it was the last time */
    assert_has(apc_store_error(both), "the history is left out: ");
}

static void the_rows_between_two_begin_where_the_store_does(void **state)
{
    static const int64_t of[][4] = {/* first, stored, newest: rows */
                                    {0, 0, 5, 5},     {0, 3, 5, 2},       {0, 5, 5, 0},
                                    {0, 7, 5, 0},     {100, 3, 105, 5},   {100, 3, 100, 0},
                                    {100, 3, 99, 96}, {100, 100, 104, 4}, {100, 102, 104, 2}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_int_equal(apc_rows_between(of[i][0], of[i][1], of[i][2]), of[i][3]);
}

/* ---- Records ------------------------------------------------------------------------------------ */

static void an_event_is_another_if_it_says_anything_else(void **state)
{
    (void)state;
    for (int i = 0; i < 6; i++) {
        struct apc_event a = {
            .time = TIME(5), .severity = APC_EVENT_INFO, .source = "ab", .kind = "c", .text = "text"};
        struct given g = {0};
        assert_int_equal(set_up(NULL), 0);
        must(old, apc_store_append_events(old, &a, 1));
        a.time += i == 1 ? APC_NS_PER_S : 0;
        a.severity = i == 2 ? APC_EVENT_ALARM : a.severity;
        snprintf(a.source, sizeof a.source, "%s", i == 3 ? "a" : "ab");
        snprintf(a.kind, sizeof a.kind, "%s",
                 i == 3   ? "bc"
                 : i == 4 ? "d"
                          : "c"); /* the same letters in all */
        snprintf(a.text, sizeof a.text, "%s", i == 5 ? "texT" : "text");
        must(live, apc_store_append_events(live, &a, 1));
        assert_int_equal(ask(EVENTS, &(struct apc_range){0}, &g), i == 0 ? 1 : 2);
        tear_down(NULL);
    }
}

static void a_timing_row_is_another_if_it_says_anything_else(void **state)
{
    (void)state;
    for (int i = 0; i < 7; i++) {
        struct apc_timing_row a = {
            .time = TIME(5), .task = "ab", .quantity = "run", .missed = 1, .count = 2, .max = 3};
        struct given g = {0};
        assert_int_equal(set_up(NULL), 0);
        must(old, apc_store_append_timing(old, &a, 1));
        a.time += i == 1 ? APC_NS_PER_S : 0;
        a.missed = i == 2 ? 2 : a.missed;
        a.count = i == 3 || i == 2 ? 1 : a.count; /* the same sum */
        a.max = i == 4 ? 4 : a.max;
        snprintf(a.task, sizeof a.task, "%s", i == 5 ? "abc" : "ab");
        snprintf(a.quantity, sizeof a.quantity, "%s", i == 6 ? "jitter" : "run");
        must(live, apc_store_append_timing(live, &a, 1));
        assert_int_equal(ask(TIMING, &(struct apc_range){0}, &g), i == 0 ? 1 : 2);
        tear_down(NULL);
    }
}

static void two_alike_in_the_live_store_are_two_if_the_history_has_one(void **state)
{
    struct given g = {0};
    (void)state;
    event(old, 3);
    event(live, 3);
    event(live, 3);
    assert_int_equal(ask(EVENTS, &(struct apc_range){0}, &g), 2);
    event(old, 3);
    assert_int_equal(ask(EVENTS, &(struct apc_range){0}, &g), 2);
    event(old, 3); /* one more than the live store has */
    assert_int_equal(ask(EVENTS, &(struct apc_range){0}, &g), 3);
}

static void many_records_are_given_each_once(void **state)
{
    struct given g = {0};
    (void)state;
    for (int i = 1; i <= 1700; i++) { /* more than the room is made for at first, and at second */
        if (i <= 900)
            event(old, i);
        if (i > 300)
            event(live, i);
    }
    assert_int_equal(ask(EVENTS, &(struct apc_range){0}, &g), 1700);
    assert_true(g.in_order);
    assert_int_equal(ask(EVENTS, &(struct apc_range){.last = 1500}, &g), 1500);
    assert_true(g.in_order && g.last == TIME(1700));
}

static void who_set_it_is_asked_where_it_was_set(void **state)
{
    char name[APC_AUTHOR_LEN] = "";
    (void)state;
    const int ada = apc_store_author(old, "ada"), bob = apc_store_author(live, "bob");
    assert_true(ada > 0 && bob > 0);
    assert_int_equal(apc_store_author_name(both, (uint32_t)ada | APC_SEAM_AUTHOR, name), 0);
    assert_string_equal(name, "ada");
    assert_int_equal(apc_store_author_name(both, (uint32_t)bob, name), 0);
    assert_string_equal(name, "bob");
    begin_counting(0, 1);
    assert_int_equal(apc_store_author_name(both, (uint32_t)ada | APC_SEAM_AUTHOR, name), APC_ETIMEDOUT);
    assert_has(apc_store_error(both), "old call 1");
    begin_counting(1, 0);
    assert_int_equal(apc_store_author_name(both, (uint32_t)bob, name), APC_ETIMEDOUT);
    assert_has(apc_store_error(both), "live call 1");
}

/* ---- Descriptions ------------------------------------------------------------------------------- */

static void another_experiment_is_one_of_another_name_or_other_signals(void **state)
{
    static const struct apc_tag here[] = {
        {.table = APC_STATE, .id = 0, .name = "experiment", .description = "one"},
        {.table = APC_SENSOR, .id = 1, .name = "y", .unit = "m"},
        {.table = APC_SETPOINT, .id = 1, .name = "r", .unit = "m"},
        {.table = APC_MANUAL, .id = 1, .name = "u", .unit = "V"}};
    (void)state;
    for (int i = 0; i < 12; i++) {
        struct apc_tag other[4];
        struct apc_error why = {""};
        memcpy(other, here, sizeof other);
        if (i < 4)
            snprintf(other[i].name, sizeof other[i].name, "another");
        else if (i < 8)
            snprintf(other[i - 4].unit, sizeof other[i - 4].unit, "ft");
        else
            snprintf(other[i - 8].description, sizeof other[i - 8].description, "two");
        const bool refused = i == 1 || i == 2 || i == 5 || i == 6 || i == 8;
        const int rc = apc_tags_compare(here, 4, other, 4, &why);
        if (rc != (refused ? APC_EPERM : 0))
            fail_msg("case %d: %s", i, why.text);
        if (i == 1)
            assert_has(why.text,
                       "it belongs to another experiment: its sensor.1 is \"another\" [m], here it is "
                       "\"y\" [m]");
        if (i == 8)
            assert_has(why.text, ".0 is \"two\" [], here it is \"one\" []");
        assert_int_equal(apc_tags_compare(here, 4, other, 0, &why), 0); /* what is not there is no other */
        assert_int_equal(apc_tags_compare(here, 0, other, 4, &why), 0);
    }
    assert_ptr_equal(apc_tag_of(here, 4, &here[2]), &here[2]);
    assert_null(apc_tag_of(here, 2, &here[2]));
    assert_null(apc_tag_of(here, 4, &(struct apc_tag){.table = APC_SENSOR, .id = 2}));
    assert_null(apc_tag_of(here, 4, &(struct apc_tag){.table = APC_ACTUATOR, .id = 1}));
}

/* ---- Going on from a history ---------------------------------------------------------------------- */

static int64_t counted_from; /* -1: nobody said so */

static int count_from(struct apc_store *s, int64_t first)
{
    (void)s;
    counted_from = first;
    return 0;
}

static int64_t seq_of(enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    must(live, apc_store_read(live, &s, 1));
    return s.seq;
}

static int keep_event(void *ctx, const struct apc_event *e)
{
    *(struct apc_event *)ctx = *e;
    return 0;
}

/* The history has two sensors, an actuator that is newest, a setpoint that is newer still, and ticks. */
static void fill_history(void)
{
    sample(old, APC_SENSOR, 1, 1, 6);
    sample(old, APC_SENSOR, 2, 1, 4);
    sample(old, APC_ACTUATOR, 1, 1, 8);
    sample(old, APC_SETPOINT, 1, 1, 9);
    vector(old, 1, 7);
}

static void a_live_store_goes_on_with_the_newest_of_what_it_has_not(void **state)
{
    struct apc_error why;
    struct apc_event gap = {.time = 0};
    struct given g = {0};
    char time[APC_TIME_LEN], text[100];
    (void)state;
    fill_history();
    sample(live, APC_SENSOR, 2, 1, 1);
    const apc_ns before = apc_clock_utc(NULL);
    assert_int_equal(apc_store_take_over(live, old, &why), 4);
    assert_int_equal(seq_of(APC_SENSOR, 1), 6);
    assert_int_equal(seq_of(APC_SENSOR, 2), 1); /* its own */
    assert_int_equal(seq_of(APC_ACTUATOR, 1), 8);
    assert_int_equal(seq_of(APC_SETPOINT, 1), 9);
    assert_int_equal(apc_store_vectors(live, APC_TICK, 1, NULL, give_vector, &g), 1);
    assert_int_equal(g.last, TIME(7));
    assert_int_equal(apc_store_events(live, NULL, keep_event, &gap), 1);
    snprintf(text, sizeof text, "nothing is known between %s and ", apc_time_format(TIME(8), time));
    assert_has(gap.text, text);
    assert_int_equal(gap.severity, APC_EVENT_WARNING);
    assert_string_equal(gap.kind, "history");
    assert_true(gap.time >= before && gap.time <= apc_clock_utc(NULL));
    assert_int_equal(apc_store_take_over(live, old, &why), 0); /* it has them all */
    assert_int_equal(apc_store_events(live, NULL, keep_event, &gap), 1);
}

static void whichever_call_fails_while_it_goes_on_whose_it_was_is_said(void **state)
{
    int calls[2] = {1, 1};
    (void)state;
    for (int side = 0; side < 2; side++)
        for (int k = 1; k <= calls[side]; k++) {
            struct apc_error why = {""};
            struct apc_sample set = {.table = APC_SETPOINT, .id = 2, .seq = 3, .time = TIME(3)};
            char text[40];
            assert_int_equal(set_up(NULL), 0);
            fill_history();
            set.author = (uint32_t)apc_store_author(old, "ada");
            must(old, apc_store_append(old, &set, 1));
            sides[0].ops.count_from = count_from;
            counted_from = -1;
            begin_counting(side == 0 ? k : 0, side == 1 ? k : 0);
            const int rc = apc_store_take_over(live, old, &why);
            calls[side] = sides[side].calls > calls[side] ? sides[side].calls : calls[side];
            if (sides[side].calls < k) { /* nothing failed */
                assert_int_equal(rc, 6);
                assert_int_equal(counted_from, -1);
            } else if (rc < 0) {
                snprintf(text, sizeof text,
                         side == 0 ? "live call %d is lost" : "the history: old call %d is lost", k);
                assert_int_equal(rc, APC_ETIMEDOUT);
                assert_string_equal(why.text, text);
                const int there = apc_store_variables(live, NULL, 0);
                assert_int_equal(counted_from >= 0, side == 1 && there == 0); /* only where it has nothing */
                if (counted_from >= 0) /* more than a million for each second since 2020 */
                    assert_true(counted_from % (1 << 20) == 0 && counted_from / (1 << 20) > 150000000 &&
                                counted_from / (1 << 20) < INT64_C(10000000000));
            } else {
                fail_msg("%s call %d: nothing is said of it", side ? "old" : "live", k);
            }
            tear_down(NULL);
        }
}

static void it_goes_on_from_another_store_than_itself(void **state)
{
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_store_take_over(NULL, old, &why), APC_EINVAL);
    assert_int_equal(apc_store_take_over(live, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_store_take_over(live, live, &why), APC_EINVAL);
    assert_has(why.text, "which store takes over");
    assert_int_equal(apc_store_take_over(live, old, &why), 0); /* of nothing, and says nothing of it */
    assert_int_equal(apc_store_events(live, NULL, keep_event, NULL), 0);
}

#define T(name)    cmocka_unit_test_setup_teardown(name, set_up, tear_down)
#define EACH(name) cmocka_unit_test(name) /* a pair of stores for each case */

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(any_window_is_that_of_fourteen_rows),
        T(who_has_enough_gets_no_more),
        T(the_history_is_asked_where_the_live_store_does_not_reach_and_only_there),
        T(whichever_call_of_the_live_store_fails_it_is_told),
        T(a_history_that_fails_again_and_again_is_counted_until_it_answers),
        T(a_history_may_have_as_much_as_the_live_store_and_no_more),
        T(variables_are_those_of_the_live_store_where_the_history_fails),
        T(a_row_that_comes_once_an_hour_is_not_an_hour_late),
        T(what_comes_by_a_clock_that_is_ahead_is_late_all_the_same),
        T(what_the_history_has_not_got_is_counted_and_the_longest_told),
        T(the_rows_between_two_begin_where_the_store_does),
        EACH(an_event_is_another_if_it_says_anything_else),
        EACH(a_timing_row_is_another_if_it_says_anything_else),
        T(two_alike_in_the_live_store_are_two_if_the_history_has_one),
        T(many_records_are_given_each_once),
        T(who_set_it_is_asked_where_it_was_set),
        T(another_experiment_is_one_of_another_name_or_other_signals),
        T(a_live_store_goes_on_with_the_newest_of_what_it_has_not),
        EACH(whichever_call_fails_while_it_goes_on_whose_it_was_is_said),
        T(it_goes_on_from_another_store_than_itself),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
