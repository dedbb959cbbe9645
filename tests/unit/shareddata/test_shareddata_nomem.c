/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * No memory, at every place where some is asked for: an operation that says so has done nothing, and works
 * when it is asked again. Each store goes through the same steps again and again, and each time one
 * allocation later fails, once; those of libapc one after the other, of SQLite's many some. Sanitizers bring
 * their own allocator, so the tests are then skipped.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "nomem.h"

static char uri[200], file[150], spool[150];
static struct apc_store *store;
static const char *spooled;

/* ---- Steps: each returns what it should, or an error ------------------------------------------------ */

enum { VARIABLES = 150, ROWS = 300 };

static struct apc_sample sample(int id, int64_t seq)
{
    return (struct apc_sample){
        .table = APC_SENSOR, .id = id, .seq = seq, .time = seq * APC_NS_PER_S, .value = (double)seq};
}

static int open_it(void)
{
    const struct apc_store_options options = {.size = sizeof options,
                                              .name = "nomem",
                                              .timeout = 20 * APC_NS_PER_S,
                                              .backoff_min = 1,
                                              .backoff_max = 1,
                                              .spool = spooled};
    return apc_store_open(&store, uri, &options, NULL);
}

static int init(void)
{
    return apc_store_init(store);
}

static int put_tags(void)
{
    const struct apc_tag tags[] = {{.table = APC_SENSOR, .id = 2, .name = "b"},
                                   {.table = APC_SENSOR, .id = 1, .name = "a"}};
    return apc_store_describe(store, tags, 2, "name = \"a\";");
}

static int author(void)
{
    return apc_store_author(store, "anna");
}

static int author_name(void)
{
    char name[APC_AUTHOR_LEN];
    return apc_store_author_name(store, 1, name);
}

static int catalogue(void)
{
    char text[32];
    return apc_store_catalogue(store, text, sizeof text, NULL);
}

static int get_tags(void)
{
    struct apc_tag tags[2];
    int rc = apc_store_get_tags(store, tags, 2);
    return rc == 2 && strcmp(tags[0].name, "a") != 0 ? -100 : rc;
}

static int append_one_of_many(void)
{
    struct apc_sample s[VARIABLES];
    for (int i = 0; i < VARIABLES; i++) {
        s[i] = sample(i, 1);
    }
    return apc_store_append(store, s, VARIABLES);
}

static int append_many_of_one(void)
{
    static struct apc_sample s[ROWS];
    for (int i = 0; i < ROWS; i++) {
        s[i] = sample(1, i + 2);
    }
    return apc_store_append(store, s, ROWS);
}

static int append_late(void)
{
    static struct apc_sample s[2];
    s[0] = sample(VARIABLES, 7);
    s[1] = sample(VARIABLES, 3);
    return apc_store_append(store, s, 2);
}

static int put(void)
{
    struct apc_sample s = {.table = APC_TUNING, .id = 3, .value = 1};
    int rc = apc_store_put(store, &s, 1);
    return rc == 0 && s.seq != 1 ? -100 : rc;
}

static int swap(void)
{
    struct apc_sample s = {.table = APC_TUNING, .id = 3, .value = 2, .seq = 1};
    int rc = apc_store_swap(store, &s, 1);
    return rc == 0 && s.seq != 2 ? -100 : rc;
}

static int append_rows(void)
{
    static double value[40];
    struct apc_vector v[3];
    struct apc_sample s = sample(APC_ELEMENTS_MAX, 1);
    for (int i = 0; i < 3; i++) {
        v[i] = (struct apc_vector){.table = APC_TICK,
                                   .id = 1,
                                   .seq = i + 1,
                                   .time = i + 1,
                                   .n = 10 * (uint32_t)(i + 1),
                                   .value = value};
    }
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &s, .n_samples = 1, .vector = v, .n_vectors = 3};
    return apc_store_append_rows(store, &rows);
}

static int read_rows(void)
{
    double value[40];
    struct apc_vector v = {.table = APC_TICK, .id = 1, .room = 40, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    int rc = apc_store_read_rows(store, &rows);
    return rc == 0 && (v.seq != 3 || v.n != 30) ? -100 : rc;
}

static int any_vector(void *ctx, const struct apc_vector *v)
{
    (void)ctx;
    return v->n != 10 * (uint32_t)v->seq;
}

static int vectors(void)
{
    return apc_store_vectors(store, APC_TICK, 1, NULL, any_vector, NULL);
}

static int release(void)
{
    const struct apc_sample v = {.table = APC_SENSOR, .id = 2};
    return apc_store_release(store, &v, 1);
}

static int claim(void)
{
    int64_t last[2];
    int rc = apc_store_claim(store, APC_SENSOR, 2, last);
    return rc == 0 && (last[0] != ROWS + 1 || last[1] != 1) ? -100 : rc;
}

static int claim_after(void)
{
    int64_t last[2];
    int rc = apc_store_claim(store, APC_SENSOR, 2, last);
    return rc == 0 && last[0] != ROWS + 1 ? -100 : rc;
}

static int read_newest(void)
{
    struct apc_sample s = {.table = APC_SENSOR, .id = 1};
    int rc = apc_store_read(store, &s, 1);
    return rc == 0 && s.seq != ROWS + 1 ? -100 : rc;
}

static int look(void)
{
    const struct apc_sample seen = {.table = APC_SENSOR, .id = 1, .seq = ROWS};
    return apc_store_wait(store, &seen, 1, 0);
}

static int append_events(void)
{
    static struct apc_event events[20];
    for (int i = 0; i < 20; i++) {
        events[i] = (struct apc_event){.time = i, .severity = APC_EVENT_INFO, .kind = "operator"};
    }
    return apc_store_append_events(store, events, 20);
}

static int append_timing(void)
{
    static const int64_t bins[3] = {1, 2, 3};
    static struct apc_timing_row rows[8];
    for (int i = 0; i < 8; i++) {
        rows[i] = (struct apc_timing_row){.time = -i * APC_NS_PER_US,
                                          .task = "t",
                                          .quantity = "run",
                                          .bin_low = bins,
                                          .bin_high = bins,
                                          .bin_count = bins,
                                          .n_bins = i % 2 ? 3 : 0};
    }
    return apc_store_append_timing(store, rows, 8);
}

/* What was given before it failed is no matter. */
static int any_sample(void *ctx, const struct apc_sample *s)
{
    (void)ctx;
    (void)s;
    return 0;
}

static int any_bin(void *ctx, const struct apc_history_bin *bin)
{
    (void)ctx;
    (void)bin;
    return 0;
}

static int any_event(void *ctx, const struct apc_event *e)
{
    (void)ctx;
    (void)e;
    return 0;
}

static int any_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)ctx;
    return row->n_bins == 3 && row->bin_count[2] != 3;
}

static int history(void)
{
    return apc_store_history(store, APC_SENSOR, 1, NULL, any_sample, NULL);
}

static int bins(void)
{
    return apc_store_history_bins(store, APC_SENSOR, 1, 0, (ROWS + 2) * APC_NS_PER_S, 2, any_bin, NULL);
}

static int variables(void)
{
    struct apc_sample s[2];
    return apc_store_variables(store, s, 2);
}

static int events(void)
{
    return apc_store_events(store, NULL, any_event, NULL);
}

static int timing(void)
{
    return apc_store_timing(store, NULL, any_timing, NULL);
}

static int maintain(void)
{
    const struct apc_retention keep = {
        .size = sizeof keep, .samples = 1, .events = 1, .timing = 1, .ticks = 1};
    return apc_store_maintain(store, &keep);
}

static int close_it(void)
{
    apc_store_close(store);
    store = NULL;
    return 0;
}

static int drain(void)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    int rc = apc_store_connect(store);
    apc_store_stats(store, &stats);
    return rc < 0 ? rc : (int)(stats.spool.samples + stats.spool.events);
}

/* A store of its own makes the tables behind the spool's back. */
static int init_behind(void)
{
    struct apc_store *other = NULL;
    int rc = apc_store_open(&other, uri, NULL, NULL);
    rc = rc < 0 ? rc : apc_store_init(other);
    apc_store_close(other);
    return rc;
}

struct step {
    int (*run)(void);
    int result;
};

static const struct step whole[] = {
    {open_it, 0},
    {init, 0},
    {put_tags, 2},
    {put_tags, 2},
    {author, 1},
    {author_name, 0},
    {catalogue, 11},
    {append_one_of_many, VARIABLES},
    {append_many_of_one, ROWS},
    {append_late, 2},
    {put, 0},
    {swap, 0},
    {append_rows, 4},
    {read_rows, 0},
    {vectors, 3},
    {claim, 0},
    {release, 0},
    {read_newest, 0},
    {look, 1},
    {append_events, 20},
    {append_timing, 8},
    {get_tags, 2},
    {history, ROWS + 1},
    {bins, 2},
    {variables, VARIABLES + 4},
    {events, 20},
    {timing, 8},
    {maintain, ROWS + 2 + 2 + 20 + 8},
    {history, 1},
    {close_it, 0},
};

/* Records have no key: what was moved before it failed is not moved again. */
enum { RECORDS = 150 };
static struct apc_store *to;
static struct apc_replication *forwarder;

static int begin_forward(void)
{
    int rc = to ? 0 : apc_store_open(&to, "mem:", NULL, NULL);
    rc = rc < 0 ? rc : apc_store_init(to);
    return rc < 0 ? rc : apc_replication_create(&forwarder, store, to, NULL);
}

static int describe_from(const char *unit)
{
    struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    snprintf(tag.description, sizeof tag.description, "%s", unit);
    return apc_store_describe(store, &tag, 1, unit);
}

static int describe_one(void)
{
    return describe_from("one");
}

static int describe_two(void)
{
    return describe_from("two");
}

static int told(void)
{
    char text[8] = "";
    const int rc = apc_store_catalogue(to, text, sizeof text, NULL);
    return rc > 0 && strcmp(text, "two") != 0 ? -100 : rc;
}

/* A row of a tick and one that somebody else wrote, for two authors. */
static int put_by(const char *name, int64_t seq)
{
    double value[2] = {1, 2};
    struct apc_vector v = {.table = APC_TICK, .id = 1, .seq = seq, .time = seq, .n = 2, .value = value};
    struct apc_sample s = {.table = APC_TUNING, .id = 1, .seq = seq - 1};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &s, .n_samples = 1, .vector = &v, .n_vectors = 1};
    const int author = apc_store_author(store, name);
    s.author = (uint32_t)author;
    return author < 0 ? author : apc_store_append_rows(store, &rows);
}

static int put_by_anna(void)
{
    return put_by("anna", 1);
}

static int put_by_ben(void)
{
    return put_by("ben", 2);
}

static int tunings_moved(void)
{
    return apc_store_history(to, APC_TUNING, 1, NULL, any_sample, NULL);
}

static int has_two_elements(void *ctx, const struct apc_vector *v)
{
    (void)ctx;
    return v->n != 2 || v->value[1] < 2;
}

static int ticks_moved(void)
{
    return apc_store_vectors(to, APC_TICK, 1, NULL, has_two_elements, NULL);
}

static int append_from(int first)
{
    struct apc_timing_row rows[RECORDS];
    const int64_t bin = 1;
    for (int i = 0; i < RECORDS; i++) {
        rows[i] = (struct apc_timing_row){.time = (first + i) * APC_NS_PER_US,
                                          .task = "t",
                                          .quantity = "run",
                                          .bin_low = &bin,
                                          .bin_high = &bin,
                                          .bin_count = &bin,
                                          .n_bins = 1};
    }
    return apc_store_append_timing(store, rows, RECORDS);
}

static int append_records(void)
{
    return append_from(0);
}

static int append_more(void)
{
    return append_from(RECORDS);
}

static int step_forward(void)
{
    const int moved = apc_replication_step(forwarder, 20 * APC_NS_PER_S);
    return moved < 0 ? moved : 0;
}

static int timing_moved(void)
{
    return apc_store_timing(to, NULL, any_timing, NULL);
}

static int end_forward(void)
{
    apc_replication_destroy(forwarder);
    apc_store_close(to);
    to = NULL;
    return close_it();
}

static const struct step forwarded[] = {
    {open_it, 0},
    {init, 0},
    {begin_forward, 0},
    {describe_one, 1},
    {append_records, RECORDS},
    {put_by_anna, 2},
    {step_forward, 0},
    {timing_moved, RECORDS},
    {tunings_moved, 1},
    {ticks_moved, 1},
    {append_more, RECORDS},
    {put_by_ben, 2},
    {describe_two, 1},
    {step_forward, 0},
    {timing_moved, 2 * RECORDS},
    {tunings_moved, 2},
    {ticks_moved, 2},
    {told, 3},
    {end_forward, 0},
};

/* Away, with a spool; then another process finds what waits, and the store is there. */
static const struct step bridged[] = {
    {open_it, 0},
    {append_one_of_many, VARIABLES},
    {append_many_of_one, ROWS},
    {append_events, 20},
    {read_newest, 0},
    {close_it, 0},
    {open_it, 0},
    {init_behind, 0},
    {drain, 0},
    {claim_after, 0},
    {history, ROWS + 1},
    {events, 20},
    {close_it, 0},
};

/* ---- All steps, with the failure of one allocation --------------------------------------------------- */

static int attempt(const struct step *step)
{
    counting = true;
    int rc = step->run();
    counting = false;
    return rc;
}

/* Returns whether there was an allocation of that number. */
static bool go_through(const struct step *steps, size_t n, int number)
{
    until_failure = number;
    failed = false;
    unlink(file);
    for (size_t i = 0; i < n; i++) {
        bool before = failed;
        int rc = attempt(&steps[i]);
        if (rc < 0 && failed && !before && rc != -100) {
            if (rc != APC_ENOMEM) {
                fail_msg("%s: allocation %d, step %zu: %s: %s", uri, number, i, apc_err_name(rc),
                         apc_store_error(store));
            }
            rc = attempt(&steps[i]);
        }
        if (steps[i].run == maintain && !before && failed && rc >= 0) {
            rc = steps[i].result; /* it goes on in portions */
        }
        if (rc != steps[i].result) {
            fail_msg("%s: allocation %d, step %zu: %d instead of %d: %s", uri, number, i, rc, steps[i].result,
                     apc_store_error(store));
        }
    }
    until_failure = 0;
    return failed;
}

static void go_through_all(const struct step *steps, size_t n, int apart)
{
    if (!NOMEM) {
        skip();
    }
    int number = 1;
    long before = 0;
    foreign = apart > 1;
    unlink(spool);
    go_through(steps, n, 0); /* what is kept for good is there */
    before = alive;
    while (go_through(steps, n, number)) {
        number += apart;
        if (alive != before) {
            fail_msg("%s: allocation %d: %ld are left", uri, number - apart, alive - before);
        }
    }
    assert_true(number > apart); /* some did */
}

#define ALL(steps, apart) go_through_all(steps, sizeof steps / sizeof steps[0], apart)

static void test_memory(void **state)
{
    (void)state;
    snprintf(uri, sizeof uri, "mem:");
    ALL(whole, 1);
    ALL(forwarded, 1);
}

static void test_shared_memory(void **state)
{
    (void)state;
    snprintf(uri, sizeof uri, "shm:nomem-%d?size=2", (int)getpid());
    snprintf(file, sizeof file, "/dev/shm/apc.nomem-%d", (int)getpid());
    ALL(whole, 1);
    unlink(file);
}

static void test_sqlite(void **state)
{
    (void)state;
    snprintf(file, sizeof file, "/dev/shm/apc-nomem-%d.db", (int)getpid());
    snprintf(uri, sizeof uri, "sqlite:%s", file);
    ALL(whole, 1);
    ALL(whole, 397); /* of SQLite's many */
    unlink(file);
}

static void test_spool(void **state)
{
    (void)state;
    snprintf(file, sizeof file, "/dev/shm/apc-nomem-%d.db", (int)getpid());
    snprintf(spool, sizeof spool, "/dev/shm/apc-nomem-%d.spool", (int)getpid());
    snprintf(uri, sizeof uri, "sqlite:%s", file);
    spooled = spool;
    ALL(bridged, 1);
    spooled = NULL;
    unlink(file);
    unlink(spool);
}

static int remove_files(void **state)
{
    char command[400];
    (void)state;
    snprintf(command, sizeof command, "rm -f /dev/shm/apc-nomem-%d.* /dev/shm/apc.nomem-%d", (int)getpid(),
             (int)getpid());
    return system(command);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_shared_memory),
        cmocka_unit_test(test_sqlite),
        cmocka_unit_test(test_spool),
    };
    return cmocka_run_group_tests(tests, NULL, remove_files);
}
