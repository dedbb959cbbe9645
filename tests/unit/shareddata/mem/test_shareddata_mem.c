/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in memory beyond what every store must do: whose it is, and what it allocates. Every allocation
 * of the process goes through the functions below; sanitizers bring their own allocator, so what counts
 * them is then skipped.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcstore.h"
#include "check.h"

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
static int fail_at = -1; /* the allocation with this number fails */

#if COUNTING
/* glibc's own, for programs that replace malloc. */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);

void *malloc(size_t size)
{
    return allocations++ == fail_at ? NULL : __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    return allocations++ == fail_at ? NULL : __libc_calloc(n, size);
}

void *realloc(void *p, size_t size)
{
    return allocations++ == fail_at ? NULL : __libc_realloc(p, size);
}
#endif

static struct apc_store *open_store(const char *uri)
{
    struct apc_store *store = NULL;
    assert_int_equal(apc_store_open(&store, uri, NULL, NULL), 0);
    return store;
}

static struct apc_sample sample(int id, int64_t seq)
{
    return (struct apc_sample){.table = APC_SENSOR, .id = id, .seq = seq, .value = (double)seq};
}

static int64_t newest(struct apc_store *store, int id)
{
    struct apc_sample s = sample(id, 0);
    assert_int_equal(apc_store_read(store, &s, 1), 0);
    return s.seq;
}

static void test_without_a_name_it_is_its_handles_own(void **state)
{
    (void)state;
    struct apc_store *one = open_store("mem:"), *other = open_store("mem:");
    struct apc_sample s = sample(1, 1);
    assert_int_equal(apc_store_init(one), 0);
    assert_int_equal(apc_store_init(other), 0);
    assert_int_equal(apc_store_append(one, &s, 1), 1);
    assert_int_equal(newest(one, 1), 1);
    assert_int_equal(newest(other, 1), 0);
    apc_store_close(one);
    apc_store_close(other);
}

/* Promise(stores/mem-names-doubling): `mem:`: names, and the doubling that is its only allocation. */
static void test_a_name_is_shared_and_gone_with_its_last_handle(void **state)
{
    (void)state;
    struct apc_store *one = open_store("mem:a"), *two = open_store("mem:a"), *b = open_store("mem:b");
    struct apc_sample s = sample(1, 7);
    assert_int_equal(apc_store_init(one), 0);
    assert_int_equal(apc_store_append(two, &s, 1), 1);
    apc_store_close(two);
    assert_int_equal(newest(one, 1), 7);
    assert_int_equal(apc_store_init(b), 0);
    assert_int_equal(newest(b, 1), 0);
    apc_store_close(one);
    apc_store_close(b);
    one = open_store("mem:a");
    assert_int_equal(apc_store_init(one), 0);
    assert_int_equal(newest(one, 1), 0);
    apc_store_close(one);
}

static int no_vector(void *ctx, const struct apc_vector *v)
{
    (void)ctx;
    fail_msg("a vector of table %d before there are tables", (int)v->table);
    return 1;
}

static void test_before_init_there_are_no_tables(void **state)
{
    (void)state;
    struct apc_store *store = open_store("mem:");
    struct apc_sample s = sample(1, 1);
    int64_t last[1];
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
    assert_int_equal(apc_store_read(store, &s, 1), APC_ESCHEMA);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ESCHEMA);
    assert_int_equal(apc_store_claim(store, APC_SENSOR, 1, last), APC_ESCHEMA);
    assert_int_equal(apc_store_wait(store, &s, 1, 0), APC_ESCHEMA);
    assert_non_null(strstr(apc_store_error(store), "apc_store_init"));
    assert_int_equal(apc_store_vectors(store, APC_TICK, 1, NULL, no_vector, NULL), APC_ESCHEMA);
    assert_int_equal(apc_store_author(store, "joe"), APC_ESCHEMA);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), APC_ESCHEMA);
    assert_int_equal(apc_store_catalogue(store, NULL, 0, NULL), APC_ESCHEMA);
    assert_int_equal(apc_store_variables(store, NULL, 0), APC_ESCHEMA);
    apc_store_close(store);
}

static void test_a_store_of_no_kind_is_named_without_what_may_be_secret(void **state)
{
    struct apc_store *store;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_store_open(&store, "postgres-ql://joe:secret@host/db", NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "unknown store \"postgres-ql:\": expected"));
    assert_int_equal(apc_store_open(&store, "joe/secret:x", NULL, &why), APC_EINVAL);
    assert_null(strstr(why.text, "joe"));
    assert_non_null(strstr(why.text, "does not begin with its kind: expected"));
}

static void test_a_name_too_long_is_refused(void **state)
{
    (void)state;
    char uri[4 + 64 + 1] = "mem:";
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    memset(uri + 4, 'x', 64);
    assert_int_equal(apc_store_open(&store, uri, NULL, &why), APC_EINVAL);
    assert_null(store);
    assert_non_null(strstr(why.text, "63"));
}

static void test_no_byte_of_a_tag_is_anything_but_of_a_character(void **state)
{
    (void)state;
    struct apc_store *store = open_store("mem:");
    const struct apc_tag tag = {.table = APC_SENSOR,
                                .id = 1,
                                .name = "n\xff",
                                .unit = "u\xff",
                                .description = "d\xff",
                                .controller = "c\xff",
                                .area = "a\xff"};
    struct apc_tag got;
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_store_put_tags(store, &tag, 1), 1);
    assert_int_equal(apc_store_get_tags(store, &got, 1), 1);
    assert_string_equal(got.name, "n?");
    assert_string_equal(got.unit, "u?");
    assert_string_equal(got.description, "d?");
    assert_string_equal(got.controller, "c?");
    assert_string_equal(got.area, "a?");
    apc_store_close(store);
}

/* Everything that allocates, once. */
static int use(struct apc_store *store)
{
    struct apc_sample s[200];
    for (int i = 0; i < 200; i++) {
        s[i] = sample(i, 1);
    }
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    const struct apc_event event = {.severity = APC_EVENT_INFO};
    const int64_t bin[1] = {1};
    const struct apc_timing_row row = {
        .quantity = "run", .bin_low = bin, .bin_high = bin, .bin_count = bin, .n_bins = 1};
    int err = apc_store_init(store);
    err = err < 0 ? err : apc_store_append(store, s, 200);
    err = err < 0 ? err : apc_store_put_tags(store, &tag, 1);
    err = err < 0 ? err : apc_store_append_events(store, &event, 1);
    return err < 0 ? err : apc_store_append_timing(store, &row, 1);
}

static int count_event(void *ctx, const struct apc_event *event)
{
    (void)event;
    return ++*(int *)ctx < 0;
}

static int count_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)row;
    return ++*(int *)ctx < 0;
}

static void test_any_allocation_may_fail_and_nothing_is_half_done(void **state)
{
    (void)state;
    if (!COUNTING) {
        skip();
    }
    int err = APC_ENOMEM, failed = 0;
    for (int n = 0; err == APC_ENOMEM; n++, failed++) {
        struct apc_store *store = NULL;
        fail_at = allocations + n;
        err = apc_store_open(&store, "mem:", NULL, NULL);
        assert_true((err == 0) == (store != NULL));
        if (!err) {
            err = use(store);
        }
        fail_at = -1;
        if (store && apc_store_connected(store)) {
            int64_t first = newest(store, 0);
            for (int i = 1; i < 200; i++) {
                assert_int_equal(newest(store, i), first); /* all or none */
            }
            assert_true(err != 1 || first == 1);
            int events = 0, rows = 0;
            apc_store_events(store, NULL, count_event, &events);
            apc_store_timing(store, NULL, count_timing, &rows);
            assert_true(rows == (err == 1) && (events == 1 || rows == 0));
            assert_true(use(store) >= 0); /* and it goes on */
        }
        apc_store_close(store);
    }
    assert_int_equal(err, 1);
    assert_true(failed > 6);
}

/* Promise(stores/mem-names-doubling) */
static void test_ticks_allocate_nothing_but_the_doubling_of_what_is_full(void **state)
{
    (void)state;
    if (!COUNTING) {
        skip();
    }
    enum { N = 10, TICKS = 1 << 14 };
    struct apc_store *store = open_store("mem:");
    assert_int_equal(apc_store_init(store), 0);
    struct apc_sample s[N];
    for (int i = 0; i < N; i++) {
        s[i] = sample(i, 1);
    }
    assert_int_equal(apc_store_append(store, s, N), N);
    const int before = allocations;
    for (int tick = 2; tick <= TICKS; tick++) {
        for (int i = 0; i < N; i++) {
            s[i].seq = tick;
        }
        assert_int_equal(apc_store_append(store, s, N), N);
        assert_int_equal(apc_store_read(store, s, N), 0);
    }
    assert_int_equal(allocations - before, N * 10); /* 16, 32, ..., 16384 samples of each */
    apc_store_close(store);
}

static int count_older(void *ctx, const struct apc_sample *row)
{
    int *n = ctx;
    *n += row->time < 5000;
    return 0;
}

static void test_what_is_forgotten_has_gone_but_the_newest_and_does_not_come_back(void **state)
{
    struct apc_store *store = open_store("mem:");
    struct apc_sample s = {.table = APC_ACTUATOR, .id = 1, .seq = 1, .time = 1000};
    struct apc_sample alarm = {.table = APC_ALARM, .id = 1, .seq = 1, .time = 1000};
    double value[2] = {0};
    struct apc_vector tick = {.table = APC_TICK, .id = 1, .n = 2, .value = value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &tick, .n_vectors = 1};
    int older = 0;
    (void)state;
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_store_append(store, &s, 1), 1); /* the only one */
    for (int i = 1; i <= 9; i++) {
        s = sample(1, i);
        s.time = tick.time = alarm.time = i * APC_NS_PER_US;
        tick.seq = alarm.seq = i;
        assert_int_equal(apc_store_append(store, &s, 1), 1);
        assert_int_equal(apc_store_append(store, &alarm, 1), 1);
        assert_int_equal(apc_store_append_rows(store, &rows), 1);
    }
    assert_int_equal(apc_store_forget(store, 5000), 8);
    assert_int_equal(apc_store_forget(store, 5000), 0);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, count_older, &older), 5);
    assert_int_equal(apc_store_history(store, APC_ACTUATOR, 1, NULL, count_older, &older), 1);
    assert_int_equal(apc_store_history(store, APC_ALARM, 1, NULL, count_older, &older), 9);
    assert_int_equal(older, 5);
    s = sample(1, 10);
    s.time = 4999;
    assert_int_equal(apc_store_append(store, &s, 1), APC_ESTATE);
    assert_non_null(strstr(apc_store_error(store), "sensor 1"));
    s.time = 5000;
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_without_a_name_it_is_its_handles_own),
        cmocka_unit_test(test_a_name_is_shared_and_gone_with_its_last_handle),
        cmocka_unit_test(test_before_init_there_are_no_tables),
        cmocka_unit_test(test_a_store_of_no_kind_is_named_without_what_may_be_secret),
        cmocka_unit_test(test_a_name_too_long_is_refused),
        cmocka_unit_test(test_no_byte_of_a_tag_is_anything_but_of_a_character),
        cmocka_unit_test(test_what_is_forgotten_has_gone_but_the_newest_and_does_not_come_back),
        cmocka_unit_test(test_any_allocation_may_fail_and_nothing_is_half_done),
        cmocka_unit_test(test_ticks_allocate_nothing_but_the_doubling_of_what_is_full),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
