/* SPDX-License-Identifier: BSD-3-Clause */
/* A live store, what is written to it, and what has arrived. */
#ifndef APC_TEST_REPLICATION_RIG_H
#define APC_TEST_REPLICATION_RIG_H

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "scratch.h"
#include "stores.h"

#define FOREVER (60 * APC_NS_PER_S)

static char live_uri[128];

static struct apc_store *open_uri(const char *uri, const char *name)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    const struct apc_store_options options = {
        .size = sizeof options, .name = name, .timeout = 20 * APC_NS_PER_S};
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

/* A live store of @p mib, new. */
static struct apc_store *live_make(int mib)
{
    static int number;
    snprintf(live_uri, sizeof live_uri, "shm:forward-%d-%d?size=%d", (int)getpid(), ++number, mib);
    struct apc_store *live = open_uri(live_uri, "live");
    ok(live, apc_store_init(live));
    return live;
}

static void live_drop(struct apc_store *live)
{
    char path[160];
    snprintf(path, sizeof path, "/dev/shm/apc.%.*s", (int)strcspn(live_uri + 4, "?"), live_uri + 4);
    apc_store_close(live);
    unlink(path);
}

static struct apc_replication *begin(struct apc_store *from, struct apc_store *to)
{
    struct apc_error why = {""};
    struct apc_replication *f = NULL;
    if (apc_replication_create(&f, from, to, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return f;
}

static int step(struct apc_replication *f)
{
    const int moved = apc_replication_step(f, FOREVER);
    if (moved < 0) {
        fail_msg("%s: %s", apc_err_name(moved), apc_replication_error(f));
    }
    return moved;
}

/* By a forward of its own, as after a restart. */
static int replication(struct apc_store *from, struct apc_store *to)
{
    struct apc_replication *f = begin(from, to);
    const int moved = step(f);
    assert_int_equal(step(f), 0);
    apc_replication_destroy(f);
    return moved;
}

static struct apc_event event(int n, const char *kind)
{
    struct apc_event e = {.time = n * APC_NS_PER_MS, .severity = APC_EVENT_INFO, .source = "test"};
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    snprintf(e.text, sizeof e.text, "event %d", n);
    return e;
}

static struct apc_timing_row timing(int n)
{
    static const int64_t low[2] = {1, 3}, high[2] = {2, 4}, count[2] = {5, 6};
    return (struct apc_timing_row){.time = n * APC_NS_PER_S,
                                   .task = "client",
                                   .quantity = "lateness",
                                   .count = 11,
                                   .bin_low = low,
                                   .bin_high = high,
                                   .bin_count = count,
                                   .n_bins = 2};
}

static void append(struct apc_store *store, int64_t from, int64_t to)
{
    for (int64_t seq = from; seq <= to; seq++) {
        double value[3] = {(double)seq, 0.5, -1};
        struct apc_sample s[2] = {sample(APC_SENSOR, 1, seq, (double)seq), sample(APC_ACTUATOR, 1, seq, 7)};
        struct apc_vector v = {
            .table = APC_TICK, .id = 1, .seq = seq, .time = s[0].time, .n = 3, .value = value};
        s[1].origin = seq;
        const struct apc_rows rows = {
            .size = sizeof rows, .sample = s, .n_samples = 2, .vector = &v, .n_vectors = 1};
        assert_int_equal(apc_store_append_rows(store, &rows), 3);
    }
}

struct seen {
    int64_t first, last;
    size_t n;
    bool ordered, whole;
    double value;
};

static void see(struct seen *s, int64_t seq)
{
    s->first = s->n == 0 ? seq : s->first;
    s->ordered = s->n == 0 || (s->ordered && seq > s->last);
    s->whole = s->n == 0 || (s->whole && seq == s->last + 1);
    s->last = seq;
    s->n++;
}

static int see_sample(void *ctx, const struct apc_sample *s)
{
    see(ctx, s->seq);
    ((struct seen *)ctx)->value = s->value;
    return 0;
}

static int see_vector(void *ctx, const struct apc_vector *v)
{
    see(ctx, v->seq);
    ((struct seen *)ctx)->value = v->n > 0 ? v->value[0] : -77;
    return 0;
}

static int see_event(void *ctx, const struct apc_event *e)
{
    int n = 0;
    assert_int_equal(sscanf(e->text, "event %d", &n), 1);
    see(ctx, n);
    return 0;
}

/* It holds all from 1 to @p last of the variable, once, in order. */
static void assert_whole(struct apc_store *store, enum apc_table table, int id, int64_t last)
{
    struct seen s = {0};
    if (apc_table_vectors(table)) {
        ok(store, apc_store_vectors(store, table, id, NULL, see_vector, &s));
    } else {
        ok(store, apc_store_history(store, table, id, NULL, see_sample, &s));
    }
    assert_int_equal(s.n, last);
    assert_true(last == 0 || (s.whole && s.first == 1 && s.last == last));
}

static void assert_events(struct apc_store *store, int last)
{
    struct seen s = {0};
    ok(store, apc_store_events(store, NULL, see_event, &s));
    assert_int_equal(s.n, last);
    assert_true(last == 0 || (s.whole && s.first == 1 && s.last == last));
}

static void append_event(struct apc_store *store, int n, const char *kind)
{
    const struct apc_event e = event(n, kind);
    ok(store, apc_store_append_events(store, &e, 1));
}

static void append_timing(struct apc_store *store, int n)
{
    const struct apc_timing_row row = timing(n);
    ok(store, apc_store_append_timing(store, &row, 1));
}

static void assert_no_hole(struct apc_store *store, int64_t base)
{
    const struct apc_range range = {.after = base};
    struct seen rows = {0}, ticks = {0};
    ok(store, apc_store_history(store, APC_SENSOR, 1, &range, see_sample, &rows));
    ok(store, apc_store_vectors(store, APC_TICK, 1, &range, see_vector, &ticks));
    assert_true(rows.n > 0 && rows.whole && rows.first == base + 1);
    assert_true(ticks.n > 0 && ticks.whole && ticks.first == base + 1);
}

#endif
