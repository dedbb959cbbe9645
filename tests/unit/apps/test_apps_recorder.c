/* SPDX-License-Identifier: BSD-3-Clause */
/* What a daemon says of its records while the store is away. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "daemon/recorder.h"
#include "shareddata/shareddata_internal.h"

/* Of glibc, for programs that replace an allocator; sanitizers bring their own. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FAILING 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define FAILING 0
#endif
#endif
#ifndef FAILING
#define FAILING 1
#endif

static int allocations;
static int fail_at = -1; /* the allocation with this number fails */

#if FAILING
extern void *__libc_calloc(size_t n, size_t size);

void *calloc(size_t n, size_t size)
{
    return allocations++ == fail_at ? NULL : __libc_calloc(n, size);
}
#endif

static char folder[64], spool[100];

static struct recorder *away(bool spooled)
{
    char uri[200];
    struct apc_store *store;
    struct recorder *r;
    struct apc_error why = {""};
    snprintf(folder, sizeof folder, "/tmp/apc-recorder.XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(uri, sizeof uri, "postgresql://apc@/none?host=%s", folder);
    snprintf(spool, sizeof spool, "%s/events.spool", folder);
    const struct apc_store_options options = {
        .size = sizeof options, .backoff_min = 1, .backoff_max = 1, .spool = spooled ? spool : NULL};
    if (apc_store_open(&store, uri, &options, &why) != 0)
        fail_msg("%s", why.text);
    assert_int_equal(recorder_create(&r, store, "task"), 0);
    return r;
}

static uint64_t waiting(const struct recorder *r)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    apc_store_stats(recorder_store(r), &stats);
    return stats.spool.events;
}

static const struct apc_event event = {.time = 1, .severity = APC_EVENT_INFO, .text = "happened"};

static void test_a_flush_with_nothing_to_write_is_no_sign_of_a_store_that_is_away(void **state)
{
    (void)state;
    struct recorder *r = away(false);
    assert_int_equal(recorder_flush(r, NULL, 0), APC_ECONN);
    recorder_event(r, &event);
    assert_int_equal(recorder_flush(r, NULL, 0), APC_ECONN);
    recorder_destroy(r);
    rmdir(folder);
}

static void test_events_go_into_the_spool_and_the_store_still_counts_as_away(void **state)
{
    (void)state;
    struct recorder *r = away(true);
    recorder_event(r, &event);
    assert_int_equal(recorder_flush(r, NULL, 0), APC_ECONN);
    assert_int_equal(waiting(r), 1);
    assert_int_equal(recorder_flush(r, NULL, 0), APC_ECONN); /* once */
    assert_int_equal(waiting(r), 1);
    recorder_destroy(r);
    unlink(spool);
    rmdir(folder);
}

static int never(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    (void)tick;
    return 0;
}

static int keep(void *ctx, const struct apc_timing_row *row)
{
    struct apc_timing_row *kept = ctx;
    assert_int_equal(kept->count, 0); /* one row in all: twice 100, once 250 */
    assert_int_equal(row->n_bins, 2);
    assert_int_equal(row->bin_count[0], 2);
    assert_int_equal(row->bin_count[1], 1);
    assert_true(row->bin_low[0] <= 100 && row->bin_high[0] >= 100);
    assert_true(row->bin_low[1] <= 250 && row->bin_high[1] >= 250);
    *kept = *row;
    return 0;
}

/* A store, a task in virtual time that ticks when told, and their recorder. */
struct bench {
    struct apc_store *reader;
    struct apc_executive *executive;
    struct apc_task *task;
    struct recorder *r;
};

static void set_up(struct bench *b)
{
    const struct apc_task_options options = {.size = sizeof options, .name = "task", .period = APC_NS_PER_S};
    struct apc_store *store;
    struct apc_error why;
    assert_int_equal(apc_store_open(&store, "mem:recorder", NULL, &why), 0);
    assert_int_equal(apc_store_open(&b->reader, "mem:recorder", NULL, &why), 0);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_executive_create(&b->executive, "virtual", NULL, &why), 0);
    assert_int_equal(apc_task_create(b->executive, &options, never, NULL, &b->task, &why), 0);
    assert_int_equal(recorder_create(&b->r, store, "task"), 0);
}

static void tear_down(struct bench *b)
{
    recorder_destroy(b->r);
    apc_store_close(b->reader);
    apc_task_destroy(b->task);
    apc_executive_destroy(b->executive);
}

struct sums {
    uint64_t count[3], missed[3]; /* of lateness, jitter, run */
    int rows;
};

static int add(void *ctx, const struct apc_timing_row *row)
{
    struct sums *s = ctx;
    int i = !strcmp(row->quantity, "lateness") ? 0 : !strcmp(row->quantity, "jitter") ? 1 : 2;
    assert_string_equal(row->task, "task");
    assert_int_equal(row->period, APC_NS_PER_S);
    s->count[i] += row->count;
    s->missed[i] += row->missed;
    s->rows++;
    return 0;
}

static struct sums stored(const struct bench *b)
{
    struct sums s = {0};
    assert_true(apc_store_timing(b->reader, &(struct apc_range){0}, add, &s) >= 0);
    return s;
}

static void test_ticks_that_nobody_ran_are_recorded_as_missed_also_where_none_ran(void **state)
{
    struct bench b;
    (void)state;
    set_up(&b);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(stored(&b).rows, 0); /* nothing happened */
    recorder_absent(b.r, 7);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0); /* once */
    struct sums s = stored(&b);
    assert_int_equal(s.rows, 3);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(s.count[i], 0);
        assert_int_equal(s.missed[i], 7);
    }
    tear_down(&b);
}

static void test_every_tick_is_recorded_once(void **state)
{
    struct bench b;
    (void)state;
    set_up(&b);
    assert_int_equal(apc_task_start(b.task, NULL), 0);
    for (int i = 1; i <= 4; i++) {
        assert_true(apc_virtual_run(b.executive, i * 10 * APC_NS_PER_S) > 0);
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    }
    struct sums s = stored(&b);
    assert_int_equal(s.rows, 12);
    assert_int_equal(s.count[0], 40); /* from 1 s to 40 s */
    assert_int_equal(s.count[1], 39); /* between them */
    assert_int_equal(s.count[2], 40);
    assert_int_equal(s.missed[0], 0);
    tear_down(&b);
}

struct events {
    int n;
    struct apc_event first, second, last;
};

static int note(void *ctx, const struct apc_event *e)
{
    struct events *all = ctx;
    if (all->n == 0)
        all->first = *e;
    if (all->n++ == 1)
        all->second = *e;
    all->last = *e;
    return 0;
}

static void test_events_that_were_pushed_out_of_the_queue_are_counted_in_the_records(void **state)
{
    struct bench b;
    struct events all = {0};
    struct apc_event e = {.time = 1, .severity = APC_EVENT_INFO, .source = "apc-test", .kind = "start"};
    (void)state;
    set_up(&b);
    for (int i = 1; i <= 131; i++) {
        e.time = i;
        snprintf(e.text, sizeof e.text, "number %d", i);
        recorder_event(b.r, &e);
    }
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 129);
    assert_int_equal(strncmp(all.first.text, "3 events were lost", 18), 0);
    assert_string_equal(all.first.source, "apc-test");
    assert_string_equal(all.second.text, "number 4"); /* the oldest went */
    assert_int_equal(all.first.severity, APC_EVENT_WARNING);
    assert_string_equal(all.last.text, "number 131");
    recorder_event(b.r, &e); /* no more are lost: no more is said */
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 130);
    tear_down(&b);
}

/* Promise(stores/link-comes-goes) */
static void test_a_link_that_comes_and_goes_is_counted(void **state)
{
    struct bench b;
    struct events all = {0};
    struct apc_event e = {.severity = APC_EVENT_WARNING, .source = "apc-test", .kind = "link"};
    const struct apc_event stop = {.time = 1, .severity = APC_EVENT_INFO, .kind = "stop"};
    (void)state;
    set_up(&b);
    e.time = apc_clock_utc(NULL) + 50 * APC_NS_PER_S; /* no flush is so late that it tells by itself */
    for (int i = 1; i <= 1000; i++) {
        snprintf(e.text, sizeof e.text, "plant lost for the %dth time", i);
        recorder_event(b.r, &e);
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    }
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 6);
    assert_string_equal(all.last.text, "plant lost for the 6th time");
    e.time += 10 * APC_NS_PER_S; /* the next one: what was counted is told first */
    recorder_event(b.r, &e);
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    all.n = 0;
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 7);
    assert_non_null(strstr(all.last.text, "the 1000th time (994 such events in 0 s, the last one)"));
    recorder_event(b.r, &stop); /* nothing is kept back at the end */
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    all.n = 0;
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 9);
    assert_string_equal(all.last.kind, "stop");
    tear_down(&b);
}

/* The events of a link at these times, s from a time to come. How many of them are in the store after a
 * flush. */
static int listed(const apc_ns *at, size_t n, struct events *all)
{
    struct bench b;
    struct apc_event e = {.severity = APC_EVENT_WARNING, .source = "apc-test", .kind = "link"};
    const apc_ns base =
        apc_clock_utc(NULL) + 50 * APC_NS_PER_S; /* no flush is so late that it tells by itself */
    set_up(&b);
    for (size_t i = 0; i < n; i++) {
        e.time = base + at[i];
        snprintf(e.text, sizeof e.text, "number %zu", i);
        recorder_event(b.r, &e);
    }
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    *all = (struct events){0};
    const int stored = apc_store_events(b.reader, &(struct apc_range){0}, note, all);
    tear_down(&b);
    return stored;
}

#define SEC APC_NS_PER_S

static void test_of_a_minute_six_are_listed_and_of_ten_seconds_the_others_are_one(void **state)
{
    struct events all;
    (void)state;
    /* the seventh of a minute is counted, the first of the next one is listed again */
    assert_int_equal(
        listed((apc_ns[]){-60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -1}, 7, &all), 6);
    assert_int_equal(
        listed((apc_ns[]){-60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, 0}, 7, &all), 7);
    /* after which there are six more */
    assert_int_equal(listed((apc_ns[]){-60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, -60 * SEC, 0, 0,
                                       0, 0, 0, 0, 0},
                            13, &all),
                     12);
    /* so is one from before, where the clock has stepped */
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, -1}, 7, &all), 7);
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 0}, 7, &all), 6);
    /* what was counted is told by the first event of ten seconds later */
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 0, 10 * SEC - 1}, 8, &all), 6);
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 0, 5 * SEC, 10 * SEC}, 9, &all), 7);
    assert_string_equal(all.last.text, "number 7 (2 such events in 5 s, the last one)");
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 0, 10 * SEC}, 8, &all), 7);
    assert_string_equal(all.last.text, "number 6"); /* one stands for itself */
    /* and by one that is a minute earlier, as the clock has stepped */
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 9 * SEC, -51 * SEC + 1}, 8, &all), 6);
    assert_int_equal(listed((apc_ns[]){0, 0, 0, 0, 0, 0, 9 * SEC, -51 * SEC}, 8, &all), 8);
}

static void test_a_text_that_is_full_is_told_as_it_is(void **state)
{
    struct bench b;
    struct events all = {0};
    struct apc_event e = {.severity = APC_EVENT_WARNING, .source = "apc-test", .kind = "link"};
    (void)state;
    set_up(&b);
    e.time = apc_clock_utc(NULL) + 50 * APC_NS_PER_S;
    memset(e.text, 'x', sizeof e.text - 1);
    for (int i = 0; i < 9; i++)
        recorder_event(b.r, &e);
    e.time += 10 * APC_NS_PER_S;
    recorder_event(b.r, &e);
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 7);
    assert_string_equal(all.last.text, e.text);
    tear_down(&b);
}

/* A task that takes too long in virtual time misses ticks of its own, beside those that nobody ran. */
static void test_ticks_missed_before_and_after_the_start_add_up(void **state)
{
    const struct apc_virtual_model slow = {.size = sizeof slow,
                                           .execution = {.kind = APC_CONSTANT, .a = 2.5}};
    struct bench b;
    (void)state;
    set_up(&b);
    assert_int_equal(apc_virtual_set_model(b.task, &slow, NULL), 0);
    assert_int_equal(apc_task_start(b.task, NULL), 0);
    assert_true(apc_virtual_run(b.executive, 30 * APC_NS_PER_S) > 0);
    const uint64_t own = apc_task_missed(b.task);
    assert_true(own > 5);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    recorder_absent(b.r, 3);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    recorder_absent(b.r, 0); /* fewer than before: nothing is taken back */
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(stored(&b).missed[2], own + 3);
    tear_down(&b);
}

/* A store that takes its time: meanwhile more events come in. */
static struct {
    const struct apc_store_ops *real;
    struct recorder *r;
    int meanwhile; /* so many */
} slow;

static void number(struct recorder *r, int from, int n)
{
    struct apc_event e = {.severity = APC_EVENT_INFO, .source = "apc-test", .kind = "start"};
    for (int i = from; i < from + n; i++) {
        e.time = i;
        snprintf(e.text, sizeof e.text, "number %d", i);
        recorder_event(r, &e);
    }
}

static int append_slowly(struct apc_store *store, const struct apc_event *events, size_t n)
{
    const int more = slow.meanwhile;
    slow.meanwhile = 0;
    number(slow.r, 1000, more);
    return slow.real->append_events(store, events, n);
}

static int count_up(void *ctx, const struct apc_event *e)
{
    int *next = ctx;
    char text[40];
    snprintf(text, sizeof text, "number %d", *next);
    if (!strcmp(e->text, text))
        ++*next;
    return 0;
}

static void test_events_that_come_while_others_are_written_are_written_next_and_once(void **state)
{
    static const int meanwhile[] = {1, 3, 100, 125, 126, 128, 130};
    (void)state;
    for (size_t i = 0; i < sizeof meanwhile / sizeof *meanwhile; i++) {
        const int more = meanwhile[i], lost = more > 128 ? more - 128 : 0;
        struct apc_store_ops ops;
        struct bench b;
        int next = 1000 + lost;
        set_up(&b);
        struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
        ops = *store->ops;
        slow.real = store->ops;
        slow.r = b.r;
        ops.append_events = append_slowly;
        store->ops = &ops;
        number(b.r, 1, 3);
        slow.meanwhile = more;
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
        assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next), 3);
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
        assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next),
                         3 + more - lost + (lost > 0));
        assert_int_equal(next, 1000 + more);
        store->ops = slow.real;
        tear_down(&b);
    }
}

static int refuse(struct apc_store *store, const struct apc_event *events, size_t n)
{
    (void)store, (void)events, (void)n;
    return APC_ESTORE;
}

static struct {
    const struct apc_store_ops *real;
    apc_ns bound; /* later events are refused for their time, and with them who comes along */
} picky;

static int append_events_pickily(struct apc_store *store, const struct apc_event *events, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (events[i].time > picky.bound)
            return apc_fail(&store->why, APC_ERANGE, "far ahead");
    return picky.real->append_events(store, events, n);
}

/* One of a clock that was wrong keeps the others back no longer than itself, and is told of. */
/* Promise(database/role-writes-time) */
static void test_an_event_that_is_refused_for_good_keeps_no_other_back(void **state)
{
    struct apc_store_ops ops;
    struct bench b;
    struct events all = {0};
    (void)state;
    set_up(&b);
    struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
    picky.real = store->ops;
    picky.bound = apc_clock_utc(NULL) + 3600 * APC_NS_PER_S;
    ops = *picky.real;
    ops.append_events = append_events_pickily;
    store->ops = &ops;
    for (int i = 1; i <= 3; i++) {
        struct apc_event e = {
            .time = i == 2 ? 2 * picky.bound : i, .severity = APC_EVENT_INFO, .kind = "start"};
        snprintf(e.text, sizeof e.text, "number %d", i);
        recorder_event(b.r, &e);
    }
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, note, &all), 3);
    assert_string_equal(all.first.text, "number 1");
    assert_non_null(strstr(all.second.text, "(start) was refused: far ahead"));
    assert_string_equal(all.last.text, "number 3");
    store->ops = picky.real;
    tear_down(&b);
}

/* A store that is there, but takes no events: that is told, and they are kept. */
static void test_events_that_are_refused_are_told_and_written_later(void **state)
{
    struct apc_store_ops ops;
    struct bench b;
    int next = 1;
    (void)state;
    set_up(&b);
    struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
    const struct apc_store_ops *real = store->ops;
    ops = *real;
    ops.append_events = refuse;
    store->ops = &ops;
    number(b.r, 1, 3);
    assert_int_equal(recorder_flush(b.r, NULL, 0), APC_ESTORE);
    store->ops = real;
    assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next), 3);
    assert_int_equal(next, 4);
    tear_down(&b);
}

/* A store whose answers do not come: what it was given is there, or is not. */
static struct {
    const struct apc_store_ops *real;
    bool stores;
} mute;

static int append_events_mutely(struct apc_store *store, const struct apc_event *events, size_t n)
{
    return mute.stores && mute.real->append_events(store, events, n) < 0 ? APC_ESTORE : APC_ETIMEDOUT;
}

static int append_timing_mutely(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    return mute.stores && mute.real->append_timing(store, rows, n) < 0 ? APC_ESTORE : APC_ETIMEDOUT;
}

static int fail_to_look(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    (void)store, (void)range, (void)fn, (void)ctx;
    return APC_ECONN;
}

static int fail_to_look_at_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn,
                                  void *ctx)
{
    (void)store, (void)range, (void)fn, (void)ctx;
    return APC_ECONN;
}

/* Whether it was stored is not known yet: nothing is sent again. */
static void test_as_long_as_nobody_can_look_nothing_is_sent_again(void **state)
{
    struct apc_store_ops ops;
    struct bench b;
    int next = 1;
    (void)state;
    set_up(&b);
    struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
    ops = *store->ops;
    mute.real = store->ops;
    mute.stores = true;
    ops.append_events = append_events_mutely;
    ops.append_timing = append_timing_mutely;
    store->ops = &ops;
    assert_int_equal(apc_task_start(b.task, NULL), 0);
    assert_true(apc_virtual_run(b.executive, 10 * APC_NS_PER_S) > 0);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), APC_ETIMEDOUT); /* of the first quantity */
    number(b.r, 1, 3);
    assert_int_equal(recorder_flush(b.r, NULL, 0), APC_ETIMEDOUT);
    ops = *mute.real;
    ops.events = fail_to_look;
    for (int i = 0; i < 2; i++)
        assert_int_equal(recorder_flush(b.r, NULL, 0), APC_ECONN);
    ops = *mute.real;
    ops.timing = fail_to_look_at_timing;
    for (int i = 0; i < 2; i++)
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), APC_ECONN);
    store->ops = mute.real;
    for (int i = 0; i < 2; i++)
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next), 3);
    assert_int_equal(next, 4);
    assert_int_equal(stored(&b).count[0], 10);
    tear_down(&b);
}

/* What was sent is known again by all that it was: another of that time is another. */
static void test_another_event_of_that_time_is_another(void **state)
{
    static const struct apc_event sent = {
        .time = 1000, .severity = APC_EVENT_INFO, .source = "apc-test", .kind = "start", .text = "number 1"};
    (void)state;
    for (int i = 0; i < 4; i++) { /* the last one is the same */
        struct apc_store_ops ops;
        struct bench b;
        int next = 1;
        struct apc_event near = sent;
        snprintf(near.source, sizeof near.source, "%s", i == 0 ? "apc-other" : sent.source);
        snprintf(near.kind, sizeof near.kind, "%s", i == 1 ? "stop" : sent.kind);
        snprintf(near.text, sizeof near.text, "%s", i == 2 ? "number 2" : sent.text);
        mute.stores = false;
        set_up(&b);
        struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
        ops = *store->ops;
        mute.real = store->ops;
        ops.append_events = append_events_mutely;
        store->ops = &ops;
        recorder_event(b.r, &sent);
        assert_int_equal(recorder_flush(b.r, NULL, 0), APC_ETIMEDOUT);
        store->ops = mute.real;
        assert_int_equal(apc_store_append_events(b.reader, &near, 1), 1);
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
        assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next), i < 3 ? 2 : 1);
        tear_down(&b);
    }
}

static int count_rows(void *ctx, const struct apc_timing_row *row)
{
    (void)ctx, (void)row;
    return 0;
}

/* Kept as it was sent, and not stored. */
static struct apc_timing_row sent_row;

static int note_row(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    (void)store, (void)n;
    sent_row = rows[0];
    return APC_ETIMEDOUT;
}

/* So is a row of timing, whose time a store rounds. */
static void test_another_row_of_that_time_is_another(void **state)
{
    enum { TASK, QUANTITY, MISSED, COUNT, MAX, EARLIER, LATER, SAME };
    (void)state;
    for (int i = TASK; i <= SAME; i++) {
        struct apc_store_ops ops;
        struct bench b;
        set_up(&b);
        struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
        const struct apc_store_ops *real = store->ops;
        ops = *real;
        ops.append_timing = note_row;
        store->ops = &ops;
        assert_int_equal(apc_task_start(b.task, NULL), 0);
        assert_true(apc_virtual_run(b.executive, 10 * APC_NS_PER_S) > 0);
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), APC_ETIMEDOUT);
        store->ops = real;
        struct apc_timing_row near = sent_row;
        snprintf(near.task, sizeof near.task, "%s", i == TASK ? "other" : sent_row.task);
        snprintf(near.quantity, sizeof near.quantity, "%s", i == QUANTITY ? "run" : sent_row.quantity);
        near.missed += i == MISSED;
        near.count += i == COUNT;
        near.max += i == MAX;
        near.time += i == EARLIER ? -3 * APC_NS_PER_US : i == LATER ? 3 * APC_NS_PER_US : 0;
        assert_int_equal(apc_store_append_timing(b.reader, &near, 1), 1);
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
        assert_int_equal(apc_store_timing(b.reader, &(struct apc_range){0}, count_rows, NULL),
                         i == SAME ? 3 : 4);
        tear_down(&b);
    }
}

/* A role of before, which may write but not look up. */
static int hide_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    (void)store, (void)range, (void)fn, (void)ctx;
    return APC_EPERM;
}

static int hide_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    (void)store, (void)range, (void)fn, (void)ctx;
    return APC_EPERM;
}

static void test_what_may_have_been_stored_without_an_answer_is_stored_once(void **state)
{
    static const struct {
        bool stores;
        int meanwhile; /* from 126 on they push out some of those that were sent: these are not lost */
        bool hidden;
    } cases[] = {{false, 0, false}, {false, 125, false}, {false, 2, true},  {true, 0, false},
                 {true, 2, false},  {true, 126, false},  {true, 128, false}};
    static const struct apc_event another = {
        .time = 1, .severity = APC_EVENT_INFO, .source = "apc-test", .kind = "start", .text = "at that time"};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int all = 3 + cases[i].meanwhile;
        struct apc_store_ops ops, answers;
        struct bench b;
        int next = 1;
        mute.stores = cases[i].stores;
        set_up(&b);
        struct apc_store *store = (struct apc_store *)(uintptr_t)recorder_store(b.r);
        ops = *store->ops;
        mute.real = store->ops;
        answers = *store->ops;
        answers.events = cases[i].hidden ? hide_events : mute.real->events;
        answers.timing = cases[i].hidden ? hide_timing : mute.real->timing;
        ops.events = answers.events;
        ops.timing = answers.timing;
        ops.append_events = append_events_mutely;
        ops.append_timing = append_timing_mutely;
        assert_int_equal(apc_task_start(b.task, NULL), 0);
        assert_true(apc_virtual_run(b.executive, 10 * APC_NS_PER_S) > 0);
        number(b.r, 1, 3);
        assert_int_equal(mute.real->append_events(b.reader, &another, 1), 1);
        store->ops = &ops;
        assert_int_equal(recorder_flush(b.r, NULL, 0), APC_ETIMEDOUT);
        store->ops = &answers;
        number(b.r, 4, cases[i].meanwhile);
        assert_int_equal(recorder_flush(b.r, NULL, 0), 0);
        assert_int_equal(apc_store_events(b.reader, &(struct apc_range){0}, count_up, &next), 1 + all);
        assert_int_equal(next, all + 1);

        ops.append_events = mute.real->append_events;
        store->ops = &ops;
        for (int k = 0; k < 3; k++) /* where it stores, of one quantity after the other */
            assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), APC_ETIMEDOUT);
        recorder_absent(b.r, 4);
        assert_true(apc_virtual_run(b.executive, 20 * APC_NS_PER_S) > 0);
        store->ops = &answers;
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
        assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
        const struct sums s = stored(&b);
        assert_int_equal(s.count[0], 20);
        assert_int_equal(s.count[1], 19);
        assert_int_equal(s.count[2], 20);
        assert_int_equal(s.missed[0], 4);
        assert_int_equal(s.missed[2], 4);
        store->ops = mute.real;
        tear_down(&b);
    }
}

static void test_what_is_measured_beside_the_task_is_stored_and_so_are_its_failures(void **state)
{
    struct bench b;
    struct apc_histogram *run;
    struct apc_timing_row row = {0};
    _Atomic uint64_t failed = 0;
    (void)state;
    set_up(&b);
    assert_int_equal(apc_histogram_create(&run), 0);
    recorder_measure(b.r, TASK_EXCHANGE, run, &failed);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(apc_store_timing(b.reader, &(struct apc_range){0}, keep, &row), 0);
    apc_histogram_record(run, 100);
    apc_histogram_record(run, 100);
    apc_histogram_record(run, 250);
    failed = 3;
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0);
    assert_int_equal(recorder_flush(b.r, b.task, APC_NS_PER_S), 0); /* nothing new */
    assert_int_equal(apc_store_timing(b.reader, &(struct apc_range){0}, keep, &row), 1);
    assert_string_equal(row.task, "exchange");
    assert_string_equal(row.quantity, "run");
    assert_int_equal(row.count, 3);
    assert_int_equal(row.missed, 3);
    assert_near(row.mean, 150, 1e-9);
    assert_near(row.sd, 86.6025403784, 1e-6);
    assert_int_equal(row.p50, 100);
    assert_int_equal(row.p99, 250);
    assert_int_equal(row.max, 250);
    recorder_destroy(b.r);
    b.r = NULL;
    apc_histogram_destroy(run);
    tear_down(&b);
}

static void test_without_memory_nothing_is_made_and_nothing_lost(void **state)
{
    struct bench b;
    int rc = APC_ENOMEM;
    (void)state;
    if (!FAILING)
        skip();
    for (int k = 0; rc < 0; k++) {
        struct apc_store *store;
        struct recorder *r;
        assert_int_equal(apc_store_open(&store, "mem:", NULL, NULL), 0);
        allocations = 0;
        fail_at = k;
        rc = recorder_create(&r, store, "task"); /* it has the store in any case */
        fail_at = -1;
        assert_true(rc == 0 ? r != NULL && k > 0 : rc == APC_ENOMEM && !r);
        recorder_destroy(r);
    }
    set_up(&b);
    assert_int_equal(apc_task_start(b.task, NULL), 0);
    assert_true(apc_virtual_run(b.executive, 10 * APC_NS_PER_S) > 0);
    rc = APC_ENOMEM;
    for (int k = 0; rc < 0; k++) {
        allocations = 0;
        fail_at = k;
        rc = recorder_flush(b.r, b.task, APC_NS_PER_S);
        fail_at = -1;
        assert_true(rc == 0 ? k > 3 : rc == APC_ENOMEM);
    }
    assert_int_equal(stored(&b).count[2], 10);
    tear_down(&b);
}

static void test_without_a_store_nothing_is_recorded_and_nothing_fails(void **state)
{
    struct recorder *r;
    (void)state;
    assert_int_equal(recorder_create(&r, NULL, "task"), 0);
    recorder_event(r, &event);
    assert_int_equal(recorder_flush(r, NULL, 0), 0);
    assert_null(recorder_store(r));
    recorder_destroy(r);
    recorder_event(NULL, &event);
    recorder_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_flush_with_nothing_to_write_is_no_sign_of_a_store_that_is_away),
        cmocka_unit_test(test_events_go_into_the_spool_and_the_store_still_counts_as_away),
        cmocka_unit_test(test_ticks_that_nobody_ran_are_recorded_as_missed_also_where_none_ran),
        cmocka_unit_test(test_without_memory_nothing_is_made_and_nothing_lost),
        cmocka_unit_test(test_without_a_store_nothing_is_recorded_and_nothing_fails),
        cmocka_unit_test(test_every_tick_is_recorded_once),
        cmocka_unit_test(test_events_that_were_pushed_out_of_the_queue_are_counted_in_the_records),
        cmocka_unit_test(test_a_link_that_comes_and_goes_is_counted),
        cmocka_unit_test(test_of_a_minute_six_are_listed_and_of_ten_seconds_the_others_are_one),
        cmocka_unit_test(test_a_text_that_is_full_is_told_as_it_is),
        cmocka_unit_test(test_ticks_missed_before_and_after_the_start_add_up),
        cmocka_unit_test(test_as_long_as_nobody_can_look_nothing_is_sent_again),
        cmocka_unit_test(test_another_event_of_that_time_is_another),
        cmocka_unit_test(test_another_row_of_that_time_is_another),
        cmocka_unit_test(test_events_that_come_while_others_are_written_are_written_next_and_once),
        cmocka_unit_test(test_an_event_that_is_refused_for_good_keeps_no_other_back),
        cmocka_unit_test(test_events_that_are_refused_are_told_and_written_later),
        cmocka_unit_test(test_what_may_have_been_stored_without_an_answer_is_stored_once),
        cmocka_unit_test(test_what_is_measured_beside_the_task_is_stored_and_so_are_its_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
