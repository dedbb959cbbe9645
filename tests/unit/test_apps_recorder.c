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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_flush_with_nothing_to_write_is_no_sign_of_a_store_that_is_away),
        cmocka_unit_test(test_events_go_into_the_spool_and_the_store_still_counts_as_away),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
