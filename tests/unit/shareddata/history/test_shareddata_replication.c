/* SPDX-License-Identifier: BSD-3-Clause */
/* From a live store into every kind of store: all of it, in order, each row once, whoever dies when. */
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "replication_rig.h"

/* What a plant is, with one variable of each sort. */
static const char catalogue[] = "name = \"plant\";";

static void describe(struct apc_store *store, const char *experiment, const char *unit)
{
    struct apc_tag tags[3] = {{.table = APC_SENSOR, .id = 1, .name = "y", .low = -5, .high = 5},
                              {.table = APC_STATE, .id = 0, .name = "experiment"},
                              {.table = APC_TICK, .id = 1, .name = "tick", .length = 3, .period = 2}};
    snprintf(tags[0].unit, sizeof tags[0].unit, "%s", unit);
    snprintf(tags[1].description, sizeof tags[1].description, "%s", experiment);
    ok(store, apc_store_describe(store, tags, 3, catalogue));
}

static int see_timing(void *ctx, const struct apc_timing_row *row)
{
    see(ctx, row->time / APC_NS_PER_S);
    assert_true(row->n_bins == 2 && row->bin_low[1] == 3 && row->bin_high[0] == 2 && row->bin_count[1] == 6);
    return 0;
}

static void assert_timing(struct apc_store *store, int last)
{
    struct seen s = {0};
    ok(store, apc_store_timing(store, NULL, see_timing, &s));
    assert_int_equal(s.n, last);
    assert_true(last == 0 || (s.whole && s.first == 1 && s.last == last));
}

/* ---- Tests ----------------------------------------------------------------------------------- */

/*
 * Promise(stores/store-holds-gets): What one store holds and gets is forwarded into another once and in
 *   order, whoever is killed when; what was overwritten before is told; not into the record of another.
 */
static void test_all_that_a_store_holds_and_gets_arrives_once(void **state)
{
    struct apc_store *live = live_make(4);
    describe(live, "plant", "m");
    append(live, 1, 40);
    append_event(live, 1, "start");
    append_event(live, 2, "operator");
    append_timing(live, 1);
    struct apc_replication *f = begin(live, *state);
    assert_int_equal(step(f), 3 * 40 + 2 + 1);
    assert_int_equal(step(f), 0);
    append(live, 41, 50);
    append_event(live, 3, "link");
    append_timing(live, 2);
    assert_int_equal(step(f), 3 * 10 + 1 + 1);
    assert_int_equal(step(f), 0);
    assert_whole(*state, APC_SENSOR, 1, 50);
    assert_whole(*state, APC_ACTUATOR, 1, 50);
    assert_whole(*state, APC_TICK, 1, 50);
    assert_events(*state, 3);
    assert_timing(*state, 2);
    assert_int_equal(newest(*state, APC_ACTUATOR, 1).origin, 50);
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_true(stats.samples == 100 && stats.vectors == 50 && stats.events == 3 && stats.timing == 2 &&
                stats.behind == 0 && stats.gap.times == 0 && !stats.away);
    apc_replication_destroy(f);
    live_drop(live);
}

static void test_descriptions_and_authors_go_along(void **state)
{
    struct apc_store *live = live_make(4);
    char name[APC_AUTHOR_LEN], text[64];
    struct apc_tag tag[4];
    describe(live, "plant", "m");
    ok(*state, apc_store_author(*state, "somebody else"));
    ok(*state, apc_store_put_tags(*state, &(struct apc_tag){.table = APC_ALARM, .id = 9, .name = "own"}, 1));
    struct apc_sample s = {.table = APC_SETPOINT, .id = 1, .value = 3};
    s.author = (uint32_t)apc_store_author(live, "ada");
    ok(live, apc_store_put(live, &s, 1));
    struct apc_replication *f = begin(live, *state);
    assert_int_equal(step(f), 1);
    s = newest(*state, APC_SETPOINT, 1);
    ok(*state, apc_store_author_name(*state, s.author, name));
    assert_string_equal(name, "ada");
    int64_t revision = 0;
    assert_int_equal(apc_store_catalogue(*state, text, sizeof text, &revision), sizeof catalogue - 1);
    assert_string_equal(text, catalogue);
    assert_int_equal(apc_store_get_tags(*state, tag, 4), 4); /* one of its own stays */
    assert_string_equal(tag[0].unit, "m");
    assert_int_equal(revision, 1);
    struct apc_tag changed = {.table = APC_SENSOR, .id = 1, .name = "y", .unit = "m", .high = 9};
    ok(live, apc_store_put_tags(live, &changed, 1));
    assert_int_equal(step(f), 0);
    assert_true(apc_store_get_tags(*state, tag, 4) == 4 && tag[0].high > 8 && tag[0].high < 10);
    assert_int_equal(apc_store_catalogue(*state, NULL, 0, &revision), sizeof catalogue - 1);
    assert_int_equal(revision, 1);
    apc_replication_destroy(f);
    live_drop(live);
}

static void test_a_restart_goes_on_where_it_was(void **state)
{
    struct apc_store *live = live_make(4);
    append(live, 1, 10);
    append_event(live, 1, "start");
    append_event(live, 2, "start");
    append_timing(live, 1);
    assert_int_equal(replication(live, *state), 33);
    assert_int_equal(replication(live, *state), 0);
    append(live, 11, 12);
    append_event(live, 3, "start");
    append_timing(live, 2);
    assert_int_equal(replication(live, *state), 8);
    assert_whole(*state, APC_TICK, 1, 12);
    assert_whole(*state, APC_SENSOR, 1, 12);
    assert_events(*state, 3);
    assert_timing(*state, 2);
    live_drop(live);
}

static struct apc_store *file_make(const char *name)
{
    char uri[300];
    snprintf(uri, sizeof uri, "sqlite:%s", scratch_path(name));
    unlink(scratch_path(name));
    struct apc_store *file = open_uri(uri, name);
    ok(file, apc_store_init(file));
    return file;
}

/* What people write, under names of their own. */
static void set_setpoint(struct apc_store *store, const char *name)
{
    const int author = apc_store_author(store, name);
    ok(store, author);
    struct apc_sample s = sample(APC_SETPOINT, 1, APC_SEQ_ANY, 5);
    s.author = (uint32_t)author;
    const struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1};
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
}

static int see_author(void *ctx, const struct apc_sample *s)
{
    ((uint32_t *)ctx)[s->seq] = s->author;
    return 0;
}

static void assert_author(struct apc_store *store, uint32_t number, const char *name)
{
    char found[APC_AUTHOR_LEN];
    ok(store, apc_store_author_name(store, number, found));
    assert_string_equal(found, name);
}

/* While the forward goes on, the file is put back as it was some time ago. */
/*
 * Promise(stores/history-comes-back): A history that comes back older, from a backup, is sent again what
 *   the live store still has, once, while the historian goes on.
 */
static void test_a_history_that_comes_back_older_gets_again_what_it_lost(void **state)
{
    (void)state;
    struct apc_store *live = live_make(4), *history = file_make("history"), *backup = file_make("backup");
    append(live, 1, 10);
    append_event(live, 1, "start");
    append_timing(live, 1);
    set_setpoint(live, "anna");
    replication(live, backup);
    apc_store_close(backup);
    struct apc_replication *f = begin(live, history);
    step(f);
    append(live, 11, 20);
    append_event(live, 2, "start");
    append_timing(live, 2);
    set_setpoint(live, "bert");
    step(f);
    assert_int_equal(rename(scratch_path("backup"), scratch_path("history")), 0);
    assert_whole(history, APC_SENSOR, 1, 10);
    append(live, 21, 21);
    set_setpoint(live, "bert");
    assert_int_equal(step(f), 3 * 11 + 2 + 2);
    assert_whole(history, APC_TICK, 1, 21);
    assert_whole(history, APC_SENSOR, 1, 21);
    assert_whole(history, APC_ACTUATOR, 1, 21);
    assert_whole(history, APC_SETPOINT, 1, 3);
    assert_events(history, 2);
    assert_timing(history, 2);
    uint32_t author[4] = {0};
    ok(history, apc_store_history(history, APC_SETPOINT, 1, NULL, see_author, author));
    assert_author(history, author[1], "anna");
    assert_author(history, author[2], "bert");
    assert_author(history, author[3], "bert");
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_true(stats.older == 1 && stats.gap.times == 0 && stats.lost.events == 0 &&
                stats.lost.timing == 0 && stats.behind == 0);
    append(live, 22, 22);
    assert_int_equal(step(f), 3);
    apc_replication_destroy(f);
    apc_store_close(history);
    live_drop(live);
}

/* As of an append that was committed while its answer was lost. */
static void test_what_is_there_already_is_not_stored_again(void **state)
{
    struct apc_store *live = live_make(4);
    append(live, 1, 10);
    for (int i = 1; i <= 5; i++) {
        append_event(live, i, "start");
        append_timing(live, i);
    }
    append(*state, 1, 4);
    append_event(*state, 1, "start");
    append_event(*state, 2, "start");
    append_timing(*state, 1);
    assert_int_equal(replication(live, *state), 3 * 6 + 3 + 4);
    assert_whole(*state, APC_ACTUATOR, 1, 10);
    assert_events(*state, 5);
    assert_timing(*state, 5);
    live_drop(live);
}

static void test_events_that_are_alike_are_all_moved(void **state)
{
    struct apc_store *live = live_make(4);
    struct apc_event e[3] = {event(1, "link"), event(1, "link"), event(1, "link")};
    ok(live, apc_store_append_events(live, e, 2));
    struct apc_replication *f = begin(live, *state);
    assert_int_equal(step(f), 2);
    ok(live, apc_store_append_events(live, e, 3));
    assert_int_equal(step(f), 3);
    apc_replication_destroy(f);
    live_drop(live);
}

/* What a law publishes, at the ticks at which it has an answer; and a plan, of the setpoints that are none of an
 * operator's. */
static void publish(struct apc_store *store, int64_t tick)
{
    double value[2] = {(double)tick, 1};
    struct apc_sample s = sample(APC_ESTIMATE, 1, tick, (double)tick);
    struct apc_vector v[] = {
        {.table = APC_PREDICTION, .id = 1, .seq = tick, .time = s.time, .n = 2, .value = value},
        {.table = APC_PLAN, .id = 1, .seq = tick, .time = s.time, .n = 2, .value = value}};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &s, .n_samples = 1, .vector = v, .n_vectors = 2};
    assert_int_equal(apc_store_append_rows(store, &rows), 3);
}

/* Promise(stores/warned-of-a-gap) */
static void test_ticks_without_an_answer_are_no_gap_and_what_was_overwritten_is(void **state)
{
    struct apc_store *live = live_make(1);
    struct apc_replication_stats stats = {.size = sizeof stats};
    for (int64_t tick = 1; tick <= 3; tick++) {
        publish(live, tick);
    }
    struct apc_replication *f = begin(live, *state);
    assert_int_equal(step(f), 9);
    publish(live, 9);
    assert_int_equal(step(f), 3);
    publish(live, 10);
    publish(live, 15);
    assert_int_equal(step(f), 6);
    assert_int_equal(step(f), 0);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.gap.times, 0);
    for (int64_t tick = 20; tick <= 60000; tick += 2) { /* more than it holds */
        publish(live, tick);
    }
    assert_true(step(f) > 0);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.gap.times, 3);
    assert_int_equal(stats.gap.since, 15 * 1000 * APC_NS_PER_US);
    apc_replication_destroy(f);
    live_drop(live);
}

/*
 * Promise(stores/store-holds-gets)
 * Promise(stores/warned-of-a-gap)
 */
static void test_what_was_overwritten_before_its_turn_is_told(void **state)
{
    struct apc_store *live = live_make(1);
    append(live, 1, 20);
    struct apc_replication *f = begin(live, *state);
    assert_int_equal(step(f), 60);
    append(live, 21, 20000); /* more than it holds */
    struct seen held = {0};
    ok(live, apc_store_history(live, APC_SENSOR, 1, NULL, see_sample, &held));
    assert_true(held.first > 21);
    assert_true(step(f) > 0);
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.gap.times, 3);
    assert_true(stats.gap.rows >= (uint64_t)(held.first - 21));
    assert_true(stats.gap.since == 20 * 1000 * APC_NS_PER_US && stats.gap.until > stats.gap.since);
    struct seen s = {0};
    ok(*state, apc_store_history(*state, APC_SENSOR, 1, NULL, see_sample, &s));
    assert_true(s.ordered && s.last == 20000 && s.n == held.n + 20);
    append(live, 20001, 20010);
    assert_int_equal(step(f), 30);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.gap.times, 3);
    apc_replication_destroy(f);
    live_drop(live);
}

/* Who is told of gaps. */
struct telling {
    struct apc_store *live, *history;
    int refuse, calls; /* the first ones fail */
    struct apc_replication_gap gap[8];
    int64_t newest; /* that the history had at the last call */
};

static int put_down(void *ctx, const struct apc_replication_gap *gap)
{
    struct telling *t = ctx;
    struct apc_sample s = {.table = APC_SENSOR, .id = 1};
    assert_int_equal(gap->size, sizeof *gap);
    ok(t->history, apc_store_read(t->history, &s, 1));
    t->newest = s.seq;
    assert_true(t->calls < 8);
    t->gap[t->calls++] = *gap;
    if (t->calls <= t->refuse) {
        return APC_ECONN;
    }
    append_event(t->live, t->calls, "history");
    return 0;
}

/* So whoever ends in between leaves no gap without a word. */
/*
 * Promise(stores/warned-of-a-gap): The historian warns before what the history has not got is overwritten,
 *   and tells of a gap before what follows it is on record, also after a restart and of a backup that is
 *   older than the live store.
 */
static void test_a_gap_is_on_record_before_what_follows_it(void **state)
{
    struct apc_store *live = live_make(1);
    struct telling t = {.live = live, .history = *state, .refuse = 1};
    append(live, 1, 20);
    struct apc_replication *f = begin(live, *state);
    apc_replication_tell(f, put_down, &t);
    assert_int_equal(step(f), 60);
    append(live, 21, 20000); /* more than it holds */
    assert_int_equal(apc_replication_step(f, FOREVER), APC_ECONN);
    assert_true(t.calls == 1 && t.newest == 20);
    assert_whole(*state, APC_SENSOR, 1, 20); /* nothing goes on before it is told */
    assert_whole(*state, APC_TICK, 1, 20);
    assert_true(step(f) > 0);
    assert_true(t.calls == 2 && t.newest == 20);
    assert_memory_equal(&t.gap[0], &t.gap[1], sizeof t.gap[0]);
    assert_int_equal(t.gap[1].variables, 3);
    assert_true(t.gap[1].since == 20 * APC_NS_PER_MS && t.gap[1].until > t.gap[1].since);
    struct seen e = {0};
    ok(*state, apc_store_events(*state, NULL, see_event, &e));
    assert_true(e.n == 1 && e.first == 2);
    append(live, 20001, 20010);
    assert_int_equal(step(f), 30);
    append(live, 20011, 40000);
    assert_true(step(f) > 0);
    assert_true(t.calls == 3 && t.gap[2].since == 20010 * APC_NS_PER_MS); /* of that gap alone */
    apc_replication_destroy(f);
    live_drop(live);
}

/* Of each kind a variable; of y2 there is none up to the tenth tick, and laws have an answer at each second. */
static void tick_all(struct apc_store *live, int64_t from, int64_t to)
{
    for (int64_t tick = from; tick <= to; tick++) {
        append(live, tick, tick);
        if (tick % 2 == 0) {
            publish(live, tick);
        }
        if (tick > 10) {
            struct apc_sample s = sample(APC_SENSOR, 2, tick - 10, 1);
            s.time = tick * APC_NS_PER_MS;
            assert_int_equal(apc_store_append(live, &s, 1), 1);
        }
    }
}

#define LAST_TICK 6000 /* more than it holds */

struct there {
    bool tick[LAST_TICK + 1];
};

static int mark_sample(void *ctx, const struct apc_sample *s)
{
    ((struct there *)ctx)->tick[s->time / APC_NS_PER_MS] = true;
    return 0;
}

static int mark_vector(void *ctx, const struct apc_vector *v)
{
    ((struct there *)ctx)->tick[v->time / APC_NS_PER_MS] = true;
    return 0;
}

static void assert_each_gap_is_told(const struct telling *t, struct apc_store *history)
{
    static const struct {
        enum apc_table table;
        int id, first, every;
    } rows[] = {{APC_SENSOR, 1, 1, 1},   {APC_ACTUATOR, 1, 1, 1},   {APC_TICK, 1, 1, 1},
                {APC_ESTIMATE, 1, 2, 2}, {APC_PREDICTION, 1, 2, 2}, {APC_PLAN, 1, 2, 2},
                {APC_SENSOR, 2, 11, 1}};
    uint64_t variables = 0;
    for (int k = 0; k < t->calls; k++) {
        variables += t->gap[k].variables;
    }
    assert_int_equal(variables, 7); /* each of them, and once */
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        static struct there there;
        there = (struct there){{false}};
        ok(history, apc_table_vectors(rows[r].table)
                        ? apc_store_vectors(history, rows[r].table, rows[r].id, NULL, mark_vector, &there)
                        : apc_store_history(history, rows[r].table, rows[r].id, NULL, mark_sample, &there));
        assert_true(there.tick[LAST_TICK]);
        for (int i = rows[r].first; i <= LAST_TICK; i += rows[r].every) {
            bool told = there.tick[i];
            for (int k = 0; k < t->calls && !told; k++) {
                told = i * APC_NS_PER_MS > t->gap[k].since && i * APC_NS_PER_MS < t->gap[k].until;
            }
            if (!told) {
                fail_msg("%s %d lacks tick %d, and nobody says so", apc_table_name(rows[r].table), rows[r].id,
                         i);
            }
        }
    }
}

/* A backup of before what the live store still has; the historian goes on, or begins anew. */
/* Promise(stores/warned-of-a-gap) */
static void test_of_a_history_that_is_older_than_the_live_store_each_gap_is_told(void **state)
{
    static bool done; /* it is not about the kind of store */
    (void)state;
    for (int restarted = 0; restarted < 2 && !done; restarted++) {
        struct apc_store *live = live_make(1), *history = file_make("history"), *backup = file_make("backup");
        struct telling t = {.live = live, .history = history};
        tick_all(live, 1, 10);
        replication(live, backup);
        apc_store_close(backup);
        struct apc_replication *f = begin(live, history);
        apc_replication_tell(f, put_down, &t);
        step(f);
        tick_all(live, 11, 20);
        step(f);
        if (restarted) {
            apc_replication_destroy(f);
        }
        assert_int_equal(t.calls, 0);
        assert_int_equal(rename(scratch_path("backup"), scratch_path("history")), 0);
        tick_all(live, 21, LAST_TICK);
        if (restarted) {
            f = begin(live, history);
            apc_replication_tell(f, put_down, &t);
        }
        step(f);
        assert_each_gap_is_told(&t, history);
        apc_replication_destroy(f);
        apc_store_close(history);
        live_drop(live);
    }
    done = true;
}

static int count_event(void *ctx, const struct apc_event *e)
{
    (void)e;
    return ++*(int *)ctx < 0;
}

static int count_row(void *ctx, const struct apc_timing_row *row)
{
    (void)row;
    return ++*(int *)ctx < 0;
}

/* Events of both kinds and timing rows, number @p from to @p to; more than a MiB holds. Returns how many it
 * holds. */
static int flood(struct apc_store *live, int from, int to, int *timing_rows)
{
    int events = 0;
    *timing_rows = 0;
    for (int i = from; i <= to; i++) {
        append_event(live, i, i % 3 == 0 ? "link" : "start");
        append_timing(live, i);
    }
    ok(live, apc_store_events(live, NULL, count_event, &events));
    ok(live, apc_store_timing(live, NULL, count_row, timing_rows));
    return events;
}

static void assert_lost(struct apc_replication *f, int events, int timing_rows)
{
    struct apc_replication_stats stats = {.size = sizeof stats};
    assert_true(step(f) >= 0);
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.lost.events, events);
    assert_int_equal(stats.lost.timing, timing_rows);
}

static void test_events_and_timing_that_were_overwritten_before_their_turn_are_counted(void **state)
{
    struct apc_store *live = live_make(1), *fresh = open_uri("mem:fresh", "fresh");
    int timing_rows, events;
    append_event(live, 1, "start");
    append_timing(live, 1);
    struct apc_replication *f = begin(live, *state);
    assert_lost(f, 0, 0);
    events = flood(live, 2, 101, &timing_rows);
    assert_true(events < 100 && timing_rows < 100);
    assert_lost(f, 100 - events, 100 - timing_rows);
    append_event(live, 102, "start");
    assert_lost(f, 100 - events, 100 - timing_rows);
    apc_replication_destroy(f);
    f = begin(live, *state); /* all that is there is known */
    assert_lost(f, 0, 0);
    apc_replication_destroy(f);

    events = flood(live, 103, 302, &timing_rows); /* while nobody moves anything */
    f = begin(live, *state); /* which of the others are there cannot be known: at most so many are not */
    assert_lost(f, 302 - events, 301 - timing_rows);
    assert_lost(f, 302 - events, 301 - timing_rows);
    apc_replication_destroy(f);

    ok(fresh, apc_store_init(fresh)); /* a history that begins here has no gap */
    f = begin(live, fresh);
    assert_lost(f, 0, 0);
    append_event(live, 303, "start");
    assert_lost(f, 0, 0);
    apc_replication_destroy(f);
    apc_store_close(fresh);
    live_drop(live);
}

/* Promise(stores/warned-of-a-gap) */
static void test_how_much_room_is_left_is_told_before_it_is_used_up(void **state)
{
    struct apc_store *live = live_make(1);
    append(live, 1, 10000);
    struct apc_replication *f = begin(live, *state);
    assert_near(apc_replication_left(f), 1, 0); /* it cannot know yet that anything is overwritten */
    step(f);
    append(live, 10001, 10010);
    const double most = apc_replication_left(f);
    assert_true(most > 0.9 && most < 1);
    append(live, 10011, 10100);
    const double less = apc_replication_left(f);
    assert_true(less > 0 && less < most);
    append(live, 10101, 20000);
    assert_near(apc_replication_left(f), 0, 0);
    step(f);
    append(live, 20001, 20001);
    assert_true(apc_replication_left(f) > most);
    apc_replication_destroy(f);
    live_drop(live);
}

/* Whichever it is of them. */
static void test_the_room_that_is_left_is_that_of_the_variable_with_the_least(void **state)
{
    for (int which = 0; which < 2; which++) {
        struct apc_store *live = live_make(1);
        struct apc_sample s[2] = {sample(APC_SENSOR, 1 + which, 1, 1), sample(APC_SENSOR, 2 - which, 1, 1)};
        ok(live, apc_store_append(live, s, 2));
        for (; s[0].seq <= 20000; s[0].seq++) {
            ok(live, apc_store_append(live, s, 1));
        }
        struct apc_replication *f = begin(live, *state);
        assert_near(apc_replication_left(f), 1, 0);
        for (; s[0].seq <= 20100; s[0].seq++) {
            ok(live, apc_store_append(live, s, 1));
        }
        const double left = apc_replication_left(f);
        assert_true(left >= 0 && left < 1);
        apc_replication_destroy(f);
        live_drop(live);
    }
}

static void assert_refused(struct apc_store *live, struct apc_store *to, int err, const char *text)
{
    struct apc_replication *f = begin(live, to);
    assert_int_equal(apc_replication_step(f, FOREVER), err);
    if (!strstr(apc_replication_error(f), text)) {
        fail_msg("\"%s\" does not say \"%s\"", apc_replication_error(f), text);
    }
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_true(stats.away && stats.samples + stats.vectors + stats.events + stats.timing == 0);
    apc_replication_destroy(f);
}

/* Promise(stores/store-holds-gets) */
static void test_another_experiments_record_is_left_alone(void **state)
{
    struct apc_store *live = live_make(4);
    append(live, 1, 5);
    describe(live, "plant", "m");
    describe(*state, "another", "m");
    assert_refused(live, *state, APC_EPERM, "\"another\"");
    describe(*state, "plant", "V");
    assert_refused(live, *state, APC_EPERM, "another experiment");
    assert_whole(*state, APC_SENSOR, 1, 0);
    describe(*state, "plant", "m"); /* the same one may go on, whoever described it */
    assert_true(replication(live, *state) > 0);
    live_drop(live);
}

/* Promise(stores/store-holds-gets) */
static void test_a_record_that_is_newer_is_left_alone(void **state)
{
    struct apc_store *live = live_make(4);
    append(live, 1, 5);
    append(*state, 1, 9);
    assert_refused(live, *state, APC_ECONFLICT, "newer");
    assert_whole(*state, APC_SENSOR, 1, 9);
    live_drop(live);
}

/* Promise(stores/file-history-nobody) */
static void test_another_runs_rows_under_the_same_numbers_are_no_record_of_this_one(void **state)
{
    struct apc_store *live = live_make(4);
    append(live, 1, 5);
    struct apc_sample other[3];
    for (int64_t seq = 1; seq <= 3; seq++) {
        other[seq - 1] = sample(APC_SENSOR, 1, seq, 77);
    }
    assert_int_equal(apc_store_append(*state, other, 3), 3);
    assert_refused(live, *state, APC_ECONFLICT, "another row of sensor 1 under seq 3");
    assert_whole(*state, APC_SENSOR, 1, 3);
    live_drop(live);
}

static void assert_other(struct apc_replication *f, int64_t seq)
{
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(f, &stats);
    assert_int_equal(stats.other.rows, 1);
    assert_true(stats.other.table == APC_SETPOINT && stats.other.id == 1 && stats.other.seq == seq);
}

/* Promise(stores/file-history-nobody) */
static void test_what_somebody_else_wrote_to_the_record_is_told_and_never_passed_over(void **state)
{
    struct apc_store *live = live_make(4);
    struct apc_sample ours = sample(APC_SETPOINT, 1, 1, 5), others = sample(APC_SETPOINT, 1, 2, 7);
    ok(live, apc_store_append(live, &ours, 1));
    struct apc_replication *f = begin(live, *state);
    step(f);
    ours.seq = 2;
    ok(live, apc_store_append(live, &ours, 1));
    assert_int_equal(apc_store_append(*state, &others, 1), 1);
    assert_int_equal(step(f), 0);
    assert_other(f, 2);
    step(f);
    assert_other(f, 2); /* once */
    apc_replication_destroy(f);
    f = begin(live, *state); /* and by one that comes later */
    step(f);
    assert_other(f, 2);
    ours.seq = 3; /* the record goes on */
    ok(live, apc_store_append(live, &ours, 1));
    assert_int_equal(step(f), 1);
    apc_replication_destroy(f);
    live_drop(live);
}

static void test_two_do_not_write_one_record(void **state)
{
    struct apc_store *live = live_make(4), *other = stores_open();
    append(live, 1, 5);
    struct apc_replication *f = begin(live, *state);
    step(f);
    struct apc_store *again = open_uri(live_uri, "again");
    assert_refused(again, other, APC_EBUSY, "test");
    append(live, 6, 7);
    assert_int_equal(step(f), 6);
    apc_replication_destroy(f);
    apc_store_close(again);
    apc_store_close(other);
    live_drop(live);
}

/* ---- Killed at random ------------------------------------------------------------------------ */

/* *@p done: all up to this seq was there when the last step that ended was begun. */
_Noreturn static void historian(_Atomic int64_t *done)
{
    struct apc_store *from = NULL, *to = NULL;
    struct apc_replication *f = NULL;
    struct apc_error why;
    const struct apc_store_options options = {.size = sizeof options, .name = "historian"};
    if (apc_store_open(&from, live_uri, &options, &why) != 0 ||
        apc_store_open(&to, store_uri, &options, &why) != 0 ||
        apc_replication_create(&f, from, to, &why) != 0) {
        _exit(1);
    }
    for (;;) {
        const int64_t there = newest(from, APC_SENSOR, 1).seq;
        if (apc_replication_step(f, FOREVER) >=
            0) { /* a dead predecessor's claim goes when the server notices */
            *done = there;
        }
    }
}

/* Promise(stores/store-holds-gets) */
static void test_kills_lose_and_double_nothing(void **state)
{
    enum { KILLS = 12, ROWS = 200 }; /* all of which the live store holds */
    static _Atomic int64_t done;
    struct apc_random random;
    if (strcmp(store_kind->name, "postgresql:") != 0 && strcmp(store_kind->name, "sqlite:") != 0) {
        skip(); /* nobody else would see it, or it is one of the others */
    }
    apc_random_init(&random, 12, "kills");
    struct apc_store *live = live_make(4);
    append(live, 1, 1);
    for (int k = 0; k < KILLS; k++) {
        const struct timespec pause = {.tv_nsec = (long)(50e6 * apc_random_uniform(&random))};
        const pid_t pid = fork();
        if (pid == 0) {
            historian(&done);
        }
        append(live, 2 + k * ROWS, 1 + (k + 1) * ROWS);
        append_event(live, k + 1, "start");
        append_timing(live, k + 1);
        while (k % 3 == 0 && newest(*state, APC_SENSOR, 1).seq <= k * ROWS) {
            nanosleep(&pause, NULL); /* it came to append */
        }
        nanosleep(&pause, NULL); /* for no condition: at whatever instant it dies, nothing is lost */
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
    }
    struct apc_replication *f = begin(live, *state);
    int rc = APC_EBUSY;
    while (rc == APC_EBUSY) { /* of the last one that was killed */
        rc = apc_replication_step(f, FOREVER);
    }
    assert_true(rc >= 0);
    apc_replication_destroy(f);
    const int64_t last = 1 + (int64_t)KILLS * ROWS;
    assert_whole(*state, APC_SENSOR, 1, last);
    assert_whole(*state, APC_ACTUATOR, 1, last);
    assert_whole(*state, APC_TICK, 1, last);
    assert_events(*state, KILLS);
    assert_timing(*state, KILLS);
    live_drop(live);
}

/* What came before the last batch was begun is there; what is there has no hole. */
/*
 * Promise(stores): A host that dies loses what came since the last batch was begun; there is no hole
 *   before.
 */
static void test_a_host_that_dies_loses_what_came_since_a_batch_was_begun(void **state)
{
    enum { RESETS = 20, APART = 1 << 20, ROWS = 500 }; /* all of which the live store holds */
    const struct timespec pause = {.tv_nsec = 50000};
    struct apc_random random;
    if (strcmp(store_kind->name, "postgresql:") != 0 && strcmp(store_kind->name, "sqlite:") != 0) {
        skip(); /* nobody else would see it, or it is one of the others */
    }
    apc_random_init(&random, 13, "resets");
    void *shared = mmap(NULL, sizeof(int64_t), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_ptr_not_equal(shared, MAP_FAILED);
    _Atomic int64_t *done = shared;
    for (int k = 1; k <= RESETS; k++) {
        struct apc_store *live = live_make(4);
        const apc_ns end = apc_clock_mono(NULL) + (apc_ns)(20e6 * apc_random_uniform(&random));
        const int64_t base = (int64_t)k * APART;
        *done = 0;
        append(live, base + 1, base + 1);
        const pid_t pid = fork();
        if (pid == 0) {
            historian(done);
        }
        for (int64_t seq = base + 2; apc_clock_mono(NULL) < end || *done == 0; seq += seq < base + ROWS) {
            if (seq < base + ROWS) {
                append(live, seq, seq);
            }
            nanosleep(&pause, NULL);
        }
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
        live_drop(live);
        assert_true(newest(*state, APC_SENSOR, 1).seq >= *done);
        assert_no_hole(*state, base);
    }
    munmap(shared, sizeof(int64_t));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_all_that_a_store_holds_and_gets_arrives_once),
        T(test_descriptions_and_authors_go_along),
        T(test_a_restart_goes_on_where_it_was),
        T(test_a_history_that_comes_back_older_gets_again_what_it_lost),
        T(test_what_is_there_already_is_not_stored_again),
        T(test_events_that_are_alike_are_all_moved),
        T(test_what_was_overwritten_before_its_turn_is_told),
        T(test_a_gap_is_on_record_before_what_follows_it),
        cmocka_unit_test(test_of_a_history_that_is_older_than_the_live_store_each_gap_is_told),
        T(test_ticks_without_an_answer_are_no_gap_and_what_was_overwritten_is),
        T(test_events_and_timing_that_were_overwritten_before_their_turn_are_counted),
        T(test_how_much_room_is_left_is_told_before_it_is_used_up),
        T(test_the_room_that_is_left_is_that_of_the_variable_with_the_least),
        T(test_another_experiments_record_is_left_alone),
        T(test_a_record_that_is_newer_is_left_alone),
        T(test_another_runs_rows_under_the_same_numbers_are_no_record_of_this_one),
        T(test_what_somebody_else_wrote_to_the_record_is_told_and_never_passed_over),
        T(test_two_do_not_write_one_record),
        T(test_kills_lose_and_double_nothing),
        T(test_a_host_that_dies_loses_what_came_since_a_batch_was_begun),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
