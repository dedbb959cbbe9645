/* SPDX-License-Identifier: BSD-3-Clause */
/* What a daemon says of its records while the store is away. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "check.h"
#include "common/recorder.h"

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
    struct apc_store_stats stats;
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
    assert_int_equal(kept->count, 0); /* one row in all */
    *kept = *row;
    return 0;
}

static void test_what_is_measured_beside_the_task_is_stored_and_failures_wait_for_it(void **state)
{
    (void)state;
    const struct apc_task_options options = {.size = sizeof options, .name = "task", .period = APC_NS_PER_S};
    struct apc_executive *executive;
    struct apc_histogram *run;
    struct apc_store *store, *reader;
    struct apc_task *task;
    struct recorder *r;
    struct apc_error why;
    struct apc_timing_row row = {0};
    _Atomic uint64_t failed = 3;
    assert_int_equal(apc_store_open(&store, "mem:recorder", NULL, &why), 0);
    assert_int_equal(apc_store_open(&reader, "mem:recorder", NULL, &why), 0);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_executive_create(&executive, "virtual", NULL, &why), 0);
    assert_int_equal(apc_task_create(executive, &options, never, NULL, &task, &why), 0);
    assert_int_equal(apc_histogram_create(&run), 0);
    assert_int_equal(recorder_create(&r, store, "task"), 0);
    recorder_measure(r, TASK_EXCHANGE, run, &failed);
    assert_int_equal(recorder_flush(r, task, APC_NS_PER_S), 0);
    assert_int_equal(apc_store_timing(reader, &(struct apc_range){0}, keep, &row), 0);
    apc_histogram_record(run, 100);
    assert_int_equal(recorder_flush(r, task, APC_NS_PER_S), 0);
    assert_int_equal(recorder_flush(r, task, APC_NS_PER_S), 0); /* nothing new */
    assert_int_equal(apc_store_timing(reader, &(struct apc_range){0}, keep, &row), 1);
    assert_string_equal(row.task, "exchange");
    assert_string_equal(row.quantity, "run");
    assert_int_equal(row.count, 1);
    assert_int_equal(row.missed, 3);
    assert_int_equal(row.p50, 100);
    recorder_destroy(r);
    apc_store_close(reader);
    apc_histogram_destroy(run);
    apc_task_destroy(task);
    apc_executive_destroy(executive);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_flush_with_nothing_to_write_is_no_sign_of_a_store_that_is_away),
        cmocka_unit_test(test_events_go_into_the_spool_and_the_store_still_counts_as_away),
        cmocka_unit_test(test_what_is_measured_beside_the_task_is_stored_and_failures_wait_for_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
