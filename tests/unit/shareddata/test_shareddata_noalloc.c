/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Steady ticks allocate nothing, in any store: every allocation of the process goes through the functions
 * below, which count those that libapc makes itself. What libpq and SQLite take is theirs: they are told
 * apart by where the call comes from, which is this program for libapc, linked into it, and another object
 * for them. Sanitizers bring their own allocator, so the tests are then skipped.
 */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "cluster.h"
#include "scratch.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define COUNTING 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define COUNTING 0
#endif
#endif
#ifndef COUNTING
#define COUNTING 1
#endif

static int allocations;

#if COUNTING
/* Where this program lies. */
extern const char __executable_start, _end;

static void count(const void *caller)
{
    const char *from = (const char *)caller;
    allocations += from >= &__executable_start && from < &_end;
}

/* glibc's own, for programs that replace malloc. */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);

void *malloc(size_t size)
{
    count(__builtin_return_address(0));
    return __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    count(__builtin_return_address(0));
    return __libc_calloc(n, size);
}

void *realloc(void *p, size_t size)
{
    count(__builtin_return_address(0));
    return __libc_realloc(p, size);
}
#endif

enum { N = 10, WARM = 20, TICKS = 150 };

/* What a controller does in a tick, and a client in an outage. Returns the allocations of the later ticks. */
static int tick(struct apc_store *store, bool away)
{
    struct apc_sample s[2 * N], newest[2 * N];
    int64_t last[N];
    int before = allocations;
    assert_int_equal(apc_store_claim(store, APC_SENSOR, N, last), 0);
    for (int64_t seq = last[0] + 1; seq <= last[0] + TICKS; seq++) {
        if (seq == last[0] + WARM) {
            before = allocations;
        }
        for (int i = 0; i < 2 * N; i++) {
            s[i] = (struct apc_sample){.table = i < N ? APC_SENSOR : APC_MANUAL,
                                       .id = i % N + 1,
                                       .seq = seq,
                                       .time = seq * APC_NS_PER_MS,
                                       .value = (double)seq};
            newest[i] = s[i];
        }
        if (apc_store_append(store, s, 2 * N) != 2 * N) {
            fail_msg("%s", apc_store_error(store));
        }
        assert_int_equal(apc_store_read(store, newest, 2 * N), 0);
        double value[4 * N] = {0};
        struct apc_sample setpoint = {.table = APC_SETPOINT, .id = 1, .seq = APC_SEQ_ANY};
        struct apc_vector v = {
            .table = APC_TICK, .id = 1, .seq = seq, .n = 4 * N, .room = 4 * N, .value = value};
        struct apc_rows rows = {
            .size = sizeof rows, .sample = &setpoint, .n_samples = 1, .vector = &v, .n_vectors = 1};
        const int n = apc_store_append_rows(store, &rows), err = apc_store_read_rows(store, &rows);
        assert_int_equal(n, away ? APC_ECONN : 2); /* a command is not spooled */
        assert_int_equal(err, away ? APC_ECONN : 0);
    }
    return allocations - before;
}

static struct apc_store *open_store(const char *uri, const char *spool)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    const struct apc_store_options options = {.size = sizeof options,
                                              .timeout = 20 * APC_NS_PER_S,
                                              .backoff_min = 1,
                                              .backoff_max = 1,
                                              .spool = spool};
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static void assert_steady(const char *uri, const char *spool)
{
    if (!COUNTING) {
        skip();
    }
    struct apc_store *store = open_store(uri, spool);
    assert_int_equal(apc_store_init(store), 0);
    assert_true(allocations > 0); /* it does count */
    assert_int_equal(tick(store, false), 0);
    apc_store_close(store);
}

/* Promise(links/nothing-tick-allocates) */
static void test_steady_ticks_allocate_nothing_on_postgresql(void **state)
{
    (void)state;
    assert_steady(cluster_uri(cluster_start()), NULL);
}

/* Promise(links/nothing-tick-allocates) */
static void test_steady_ticks_allocate_nothing_on_sqlite(void **state)
{
    char uri[300];
    (void)state;
    snprintf(uri, sizeof uri, "sqlite:%s/a.db", scratch_folder());
    assert_steady(uri, NULL);
}

/* Promise(links/nothing-tick-allocates) */
static void test_steady_ticks_allocate_nothing_in_shm(void **state)
{
    char uri[64], file[80];
    (void)state;
    snprintf(uri, sizeof uri, "shm:test-noalloc-%d?size=8", (int)getpid());
    snprintf(file, sizeof file, "/dev/shm/apc.test-noalloc-%d", (int)getpid());
    assert_steady(uri, NULL);
    unlink(file);
}

static void test_steady_ticks_allocate_nothing_before_a_spool(void **state)
{
    char uri[300], spool[300];
    (void)state;
    snprintf(uri, sizeof uri, "sqlite:%s/b.db", scratch_folder());
    snprintf(spool, sizeof spool, "%s/b.spool", scratch_folder());
    assert_steady(uri, spool);
}

static void test_an_outage_allocates_nothing_more(void **state)
{
    char file[300], aside[300], uri[320], spool[300];
    (void)state;
    if (!COUNTING) {
        skip();
    }
    snprintf(file, sizeof file, "%s/c.db", scratch_folder());
    snprintf(aside, sizeof aside, "%s/c.aside", scratch_folder());
    snprintf(uri, sizeof uri, "sqlite:%s", file);
    snprintf(spool, sizeof spool, "%s/c.spool", scratch_folder());
    struct apc_store *store = open_store(uri, spool);
    int64_t last[N];
    struct apc_sample s = {.table = APC_SENSOR, .id = 1, .seq = 1};
    struct apc_store_stats stats = {.size = sizeof stats};
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_store_claim(store, APC_SENSOR, N, last), 0);
    assert_int_equal(rename(file, aside), 0);
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    assert_int_equal(tick(store, true), 0);
    apc_store_stats(store, &stats);
    assert_int_equal(stats.spool.samples, 1 + 2 * N * TICKS);
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steady_ticks_allocate_nothing_on_postgresql),
        cmocka_unit_test(test_steady_ticks_allocate_nothing_on_sqlite),
        cmocka_unit_test(test_steady_ticks_allocate_nothing_in_shm),
        cmocka_unit_test(test_steady_ticks_allocate_nothing_before_a_spool),
        cmocka_unit_test(test_an_outage_allocates_nothing_more),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
