/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A file of which one row is not as it should be: what goes through that row is refused as damaged, and
 * nothing is made up. And chains of samples out of the middle of which housekeeping takes rows, and how many
 * writers a file has room for.
 */
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "apcstore.h"
#include "check.h"
#include "scratch.h"

#define SECOND APC_NS_PER_S

enum { N = 200, WRITERS = 256 };

static char path[200], uri[220];

static struct apc_store *open_store(void)
{
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .name = "test", .timeout = 20 * SECOND};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

static int set_up(void **state)
{
    static int number;
    snprintf(path, sizeof path, "%s/%d.db", scratch_folder(), ++number);
    snprintf(uri, sizeof uri, "sqlite:%s", path);
    *state = open_store();
    return apc_store_init(*state) != 0;
}

static int tear_down(void **state)
{
    apc_store_close(*state);
    return 0;
}

static void raw(const char *sql)
{
    sqlite3 *db = NULL;
    char *said = NULL;
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    if (sqlite3_exec(db, sql, NULL, NULL, &said) != SQLITE_OK) {
        fail_msg("%s: %s", sql, said);
    }
    sqlite3_close(db);
}

static struct apc_sample sample(int64_t seq, apc_ns time)
{
    return (struct apc_sample){.table = APC_SENSOR, .id = 1, .seq = seq, .time = time, .value = (double)seq};
}

static int see(void *ctx, const struct apc_sample *s)
{
    int64_t *last = ctx;
    assert_true(s->seq > last[0]); /* each once, in order */
    assert_near(s->value, (double)s->seq, 0.0);
    last[0] = s->seq;
    last[1] += s->seq;
    return 0;
}

static int see_vector(void *ctx, const struct apc_vector *v)
{
    (void)ctx;
    assert_int_equal(v->n, 3);
    return 0;
}

static int history(struct apc_store *store, int64_t *sum)
{
    int64_t last[2] = {0, 0};
    const int n = apc_store_history(store, APC_SENSOR, 1, NULL, see, last);
    *sum = last[1];
    return n;
}

/* Two hundred samples, in three full blocks and one that grows, and a vector. */
static void fill(struct apc_store *store)
{
    double element[] = {1, 2, 3};
    struct apc_vector v = {
        .table = APC_TICK, .id = 1, .seq = 1, .time = 1, .n = 3, .room = 3, .value = element};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    struct apc_sample s[N];
    int64_t sum;
    for (int i = 0; i < N; i++) {
        s[i] = sample(i + 1, 1000 * (i + 1));
    }
    assert_int_equal(apc_store_append(store, s, N), N);
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
    assert_int_equal(history(store, &sum), N);
    assert_int_equal(sum, N * (N + 1) / 2);
}

static void test_a_row_that_is_not_as_it_should_be_is_called_damaged(void **state)
{
    static const char *const damage[] = {
        "UPDATE block SET count = 0 WHERE variable = 17 AND seq = 64",
        "UPDATE block SET count = 130 WHERE variable = 17 AND seq = 192",
        "UPDATE block SET count = 65 WHERE variable = 17 AND seq = 64", /* there is no row before the first */
        "UPDATE block SET pos = 100000 WHERE variable = 17 AND seq = 128",
        "UPDATE sample SET seq = 11 WHERE variable = 17 AND seq = 10",
        "UPDATE sample SET seq = 300 WHERE variable = 17 AND seq = 10",
        "UPDATE sample SET previous = 0 WHERE variable = 17 AND seq = 20",
        "UPDATE sample SET variable = 33 WHERE variable = 17 AND seq = 30",
        "DELETE FROM sample WHERE variable = 17 AND seq = 195",
    };
    for (size_t i = 0; i < sizeof damage / sizeof *damage; i++) {
        int64_t sum;
        fill(*state);
        apc_store_close(*state);
        raw(damage[i]);
        *state = open_store();
        const int n = history(*state, &sum);
        if (n != APC_ESTORE || !strstr(apc_store_error(*state), "is damaged: copy what can be read")) {
            fail_msg("%s: %d, %s", damage[i], n, apc_store_error(*state));
        }
        apc_store_close(*state);
        assert_int_equal(set_up(state), 0);
    }
}

static void test_a_late_sample_finds_no_place_among_damaged_ones(void **state)
{
    struct apc_sample late = sample(65, 1);
    fill(*state);
    apc_store_close(*state);
    raw("UPDATE block SET seq = 65 WHERE variable = 17 AND seq = 64");
    *state = open_store();
    assert_int_equal(apc_store_append(*state, &late, 1), APC_ESTORE);
    assert_has(apc_store_error(*state), "is damaged");
    late = sample(N + 1, 1); /* the newest goes another way */
    assert_int_equal(apc_store_append(*state, &late, 1), 1);
}

static void test_a_vector_of_broken_elements_is_called_damaged(void **state)
{
    static const char *const damage[] = {"UPDATE sample SET value = x'010203' WHERE variable = 28",
                                         "UPDATE sample SET value = zeroblob(8 * 65537) WHERE variable = 28"};
    for (size_t i = 0; i < sizeof damage / sizeof *damage; i++) {
        double element[3] = {0};
        struct apc_vector v = {.table = APC_TICK, .id = 1, .room = 3, .value = element};
        struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        fill(*state);
        assert_int_equal(apc_store_read_rows(*state, &rows), 0);
        assert_near(element[2], 3, 0);
        raw(damage[i]);
        assert_int_equal(apc_store_read_rows(*state, &rows), APC_ESTORE);
        assert_has(apc_store_error(*state), "is damaged");
        assert_int_equal(apc_store_vectors(*state, APC_TICK, 1, NULL, see_vector, NULL), APC_ESTORE);
        apc_store_close(*state);
        assert_int_equal(set_up(state), 0);
    }
}

/* Of every three samples one is old: what stays is read as before, and a late one finds its place. */
static void test_rows_taken_out_of_the_middle_leave_a_whole_chain(void **state)
{
    const struct apc_retention keep = {.size = sizeof keep, .samples = SECOND};
    const apc_ns future = (apc_ns)time(NULL) * SECOND + 3600 * SECOND;
    struct apc_sample s[N], late;
    int64_t sum, expected = 0;
    int n = 0;
    for (int i = 0; i < N; i++) {
        const bool old = i % 3 == 0 || (i > 70 && i < 90);
        s[i] = sample(i + 1, old ? 1000 : future + i);
        n += !old;
        expected += old ? 0 : i + 1;
    }
    assert_int_equal(apc_store_append(*state, s, N), N);
    assert_int_equal(apc_store_maintain(*state, &keep), N - n);
    assert_int_equal(history(*state, &sum), n);
    assert_int_equal(sum, expected);
    assert_int_equal(apc_store_maintain(*state, &keep), 0);
    apc_store_close(*state);
    *state = open_store();
    assert_int_equal(history(*state, &sum), n);
    assert_int_equal(sum, expected);
    for (int64_t seq = 4; seq <= 82; seq += 39) {
        late = sample(seq, future);
        assert_int_equal(apc_store_append(*state, &late, 1), 1);
        assert_int_equal(history(*state, &sum), ++n);
        assert_int_equal(sum, expected += seq);
    }
}

static void test_as_many_writers_may_claim_as_there_is_room_for(void **state)
{
    static struct apc_store *writer[WRITERS];
    struct apc_sample own = {.table = APC_SENSOR, .id = 1000};
    for (int i = 0; i < WRITERS; i++) {
        struct apc_sample variable = {.table = APC_SENSOR, .id = i};
        writer[i] = open_store();
        if (apc_store_claim_set(writer[i], &variable, 1) < 0) {
            fail_msg("%s", apc_store_error(writer[i]));
        }
    }
    assert_int_equal(apc_store_claim_set(*state, &own, 1), APC_ESTORE);
    assert_has(apc_store_error(*state), "has 256 writers, and no room for more");
    apc_store_close(writer[17]); /* who goes leaves his place, and what was his */
    assert_int_equal(apc_store_claim_set(*state, &own, 1), 0);
    own.id = 17;
    assert_int_equal(apc_store_claim_set(*state, &own, 1), 0);
    own.id = 18;
    assert_int_equal(apc_store_claim_set(*state, &own, 1), APC_EBUSY);
    for (int i = 0; i < WRITERS; i++) {
        if (i != 17) {
            apc_store_close(writer[i]);
        }
    }
}

#define T(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_row_that_is_not_as_it_should_be_is_called_damaged),
        T(test_a_late_sample_finds_no_place_among_damaged_ones),
        T(test_a_vector_of_broken_elements_is_called_damaged),
        T(test_rows_taken_out_of_the_middle_leave_a_whole_chain),
        T(test_as_many_writers_may_claim_as_there_is_room_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
