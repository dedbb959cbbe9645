/* SPDX-License-Identifier: BSD-3-Clause */
/* The paper's functions, called as its listings call them. */
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcshareddata.h"
#include "check.h"
#include "cluster.h"

static struct cluster *cluster;
static PGconn *db_conn;
static const char stamp[] = "2026-01-31 12:00:00.123456";

static int set_up(void **state)
{
    (void)state;
    cluster_query(cluster, "DROP SCHEMA IF EXISTS apc CASCADE");
    struct apc_store *store = NULL;
    int err = apc_store_open(&store, cluster_uri(cluster), NULL, NULL);
    err = err ? err : apc_store_init(store);
    apc_store_close(store);
    db_conn = cluster_connect(cluster);
    return err != 0;
}

static int tear_down(void **state)
{
    (void)state;
    PQfinish(db_conn);
    return 0;
}

static void test_a_stamp_is_26_characters_of_utc(void **state)
{
    (void)state;
    char room[29];
    memset(room, '#', sizeof room);
    apc_ns before = apc_clock_utc(NULL), at = 0;
    genTimeStampUTC(room + 1);
    apc_ns after = apc_clock_utc(NULL);
    assert_int_equal(room[0], '#');
    assert_int_equal(room[28], '#'); /* 27 bytes and no more */
    assert_int_equal(strlen(room + 1), 26);
    assert_int_equal(room[11], ' ');
    assert_int_equal(apc_time_parse(room + 1, &at), 0);
    assert_true(at >= before - 1000 && at <= after);
}

static void test_what_is_inserted_is_read(void **state)
{
    (void)state;
    char ts[27], status[APC_STATUS_NAME_LEN];
    double value = 0;
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "'ok'", -1.0 / 3.0), 0);
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, ts, status, &value), 0);
    assert_string_equal(ts, stamp);
    assert_string_equal(status, "Good");
    assert_near(value, -1.0 / 3.0, 0);
    assert_int_equal(
        insertIntoTableFloat(db_conn, "sensor", 1, "2026-01-31T13:00:00+01:00", "BadNoCommunication", 2), 0);
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, ts, status, &value), 0);
    assert_string_equal(ts, "2026-01-31 12:00:00.000000"); /* older, but newer by seq */
    assert_string_equal(status, "BadNoCommunication");
    assert_near(value, 2, 0);
    assert_string_equal(
        cluster_query(cluster, "SELECT string_agg(seq::text, ' ' ORDER BY seq) FROM apc.sensor"), "1 2");
}

static void test_stamp_and_status_may_be_null_on_reading(void **state)
{
    (void)state;
    int op_mode = 0;
    double value = 0;
    assert_int_equal(insertIntoTableInt(db_conn, "opmode", 0, stamp, "ok", 1), 0);
    assert_int_equal(readRecentValInt(db_conn, "opmode", 0, NULL, NULL, &op_mode), 0);
    assert_int_equal(op_mode, 1);
    assert_int_equal(readRecentValFloat(db_conn, "opmode", 0, NULL, NULL, &value), 0);
    assert_near(value, 1, 0);
    assert_int_equal(readMultiRecentValsInt(db_conn, "opmode", 0, NULL, NULL, &op_mode),
                     0); /* none asked, none read */
}

static void test_a_thousand_values_come_in_one_read(void **state)
{
    (void)state;
    enum { N = 1000 };
    static char ts[N][1024], status[N][1024];
    static double values[N];
    static int ints[N];
    cluster_query(
        cluster,
        "INSERT INTO apc.sensor SELECT id, seq, '2026-01-31 12:00:00Z'::timestamptz + id * interval '1 us',"
        " 0, id * seq FROM generate_series(1, 1000) id, generate_series(1, 3) seq");
    assert_int_equal(readMultiRecentValsFloat(db_conn, "sensor", N, ts, status, values), 0);
    assert_int_equal(readMultiRecentValsInt(db_conn, "sensor", N, NULL, NULL, ints), 0);
    for (int i = 0; i < N; i++) {
        assert_near(values[i], 3 * (i + 1), 0);
        assert_int_equal(ints[i], 3 * (i + 1));
        assert_string_equal(status[i], "Good");
    }
    assert_string_equal(ts[N - 1], "2026-01-31 12:00:00.001000");
}

static void test_one_missing_value_leaves_all_outputs_untouched(void **state)
{
    (void)state;
    double values[3] = {7, 7, 7};
    char ts[3][1024] = {"x", "x", "x"};
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, ts[0], NULL, values), APC_ENOTFOUND);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "ok", 1), 0);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 3, stamp, "ok", 1), 0);
    assert_int_equal(readMultiRecentValsFloat(db_conn, "sensor", 3, ts, NULL, values), APC_ENOTFOUND);
    assert_near(values[0], 7, 0);
    assert_string_equal(ts[0], "x");
}

static void test_an_int_function_refuses_what_is_no_int(void **state)
{
    (void)state;
    const double bad[] = {1.5, 2147483648.0, -2147483649.0, 1e299};
    int value = 7, values[2] = {7, 7};
    assert_int_equal(insertIntoTableInt(db_conn, "sensor", 1, stamp, "ok", INT_MIN), 0);
    assert_int_equal(readRecentValInt(db_conn, "sensor", 1, NULL, NULL, &value), 0);
    assert_int_equal(value, INT_MIN);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 2, stamp, "ok", bad[i]), 0);
        assert_int_equal(readRecentValInt(db_conn, "sensor", 2, NULL, NULL, &value), APC_ERANGE);
        assert_int_equal(readMultiRecentValsInt(db_conn, "sensor", 2, NULL, NULL, values), APC_ERANGE);
    }
    assert_int_equal(values[0], 7);
}

static void test_arguments_that_make_no_sense_are_refused(void **state)
{
    (void)state;
    double value = 0;
    int i = 0;
    assert_int_equal(insertIntoTableFloat(NULL, "sensor", 1, stamp, "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, NULL, 1, stamp, "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "event", 1, stamp, "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", -1, stamp, "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, NULL, "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, "today", "ok", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, NULL, 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "fine", 1), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "ok", (double)NAN), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "ok", -(double)INFINITY), APC_EINVAL);
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "ok", 1e300), APC_EINVAL);
    assert_int_equal(readRecentValFloat(NULL, "sensor", 1, NULL, NULL, &value), APC_EINVAL);
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(readRecentValInt(db_conn, "", 1, NULL, NULL, &i), APC_EINVAL);
    assert_int_equal(readMultiRecentValsFloat(db_conn, "sensor", -1, NULL, NULL, &value), APC_EINVAL);
    assert_int_equal(readMultiRecentValsFloat(db_conn, "sensor", INT_MAX, NULL, NULL, &value), APC_EINVAL);
    assert_int_equal(readMultiRecentValsInt(db_conn, "sensor", 1, NULL, NULL, NULL), APC_EINVAL);
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.sensor"), "0");
}

static void test_a_status_or_table_never_becomes_sql(void **state)
{
    (void)state;
    const char *const texts[] = {"'ok'); DROP TABLE apc.sensor; --", "sensor; DROP TABLE apc.sensor",
                                 "'ok' || pg_sleep(9)"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, texts[i], 1), APC_EINVAL);
        assert_int_equal(insertIntoTableFloat(db_conn, texts[i], 1, stamp, "ok", 1), APC_EINVAL);
        assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, texts[i], "ok", 1), APC_EINVAL);
    }
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.sensor"), "0");
}

static void test_the_servers_refusal_is_told_and_its_text_kept(void **state)
{
    (void)state;
    double value;
    assert_int_equal(insertIntoTableFloat(db_conn, "dim", 1, stamp, "ok", 1.5), APC_ESTORE);
    assert_non_null(strstr(PQerrorMessage(db_conn), "value_whole"));
    cluster_query(cluster, "DROP SCHEMA apc CASCADE");
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, NULL, NULL, &value), APC_ESTORE);
    cluster_query(cluster, "SELECT pg_terminate_backend(pid, 20000) FROM pg_stat_activity "
                           "WHERE datname = current_database() AND pid <> pg_backend_pid()");
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, NULL, NULL, &value), APC_ECONN);
}

static void test_a_table_of_another_make_is_no_crash(void **state)
{
    (void)state;
    double value = 7;
    cluster_query(
        cluster,
        "DROP SCHEMA apc CASCADE; CREATE SCHEMA apc; CREATE TABLE apc.sensor (id int, seq int, time text,"
        " status text, value real); INSERT INTO apc.sensor VALUES (1, 1, '', NULL, 1)");
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, NULL, NULL, &value), APC_ESTORE);
    assert_near(value, 7, 0);
}

enum { WRITERS = 2, ROWS = 100 };

static void *insert_many(void *arg)
{
    int *failed = arg;
    PGconn *conn = cluster_connect(cluster);
    for (int i = 0; i < ROWS && !*failed; i++) {
        int err = APC_ECONFLICT;
        for (int tries = 0; tries < 1000 && err == APC_ECONFLICT; tries++) {
            err = insertIntoTableFloat(conn, "setpoint", 1, stamp, "ok", i);
        }
        *failed = err != 0;
    }
    PQfinish(conn);
    return NULL;
}

static void test_two_writers_number_their_rows_without_gap_or_double(void **state)
{
    (void)state;
    pthread_t threads[WRITERS];
    int failed[WRITERS] = {0};
    for (int i = 0; i < WRITERS; i++) {
        assert_int_equal(pthread_create(&threads[i], NULL, insert_many, &failed[i]), 0);
    }
    for (int i = 0; i < WRITERS; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(failed[i], 0);
    }
    assert_string_equal(cluster_query(cluster, "SELECT count(*) || ' ' || max(seq) FROM apc.setpoint"),
                        "200 200");
}

static void *insert_second(void *arg)
{
    *(int *)arg = insertIntoTableFloat(db_conn, "sensor", 1, stamp, "'ok'", 2);
    return NULL;
}

/* The server undoes the statement that waited for another's row (SQLSTATE 40001), and wants it again. */
/* Promise(database/defaults-server-database) */
static void test_a_statement_that_the_server_wants_again_is_tried_again(void **state)
{
    (void)state;
    double value = 0;
    int err = 1;
    pthread_t thread;
    assert_int_equal(insertIntoTableFloat(db_conn, "sensor", 1, stamp, "'ok'", 1), 0);
    PQclear(PQexec(db_conn, "SET default_transaction_isolation TO serializable"));
    PGconn *other = cluster_connect(cluster);
    PQclear(PQexec(other, "BEGIN; UPDATE apc.sensor_newest SET value = value"));
    assert_int_equal(pthread_create(&thread, NULL, insert_second, &err), 0);
    const bool waits =
        cluster_await(cluster,
                      "SELECT count(*) > 0 FROM pg_stat_activity WHERE wait_event_type = 'Lock' "
                      "AND datname = current_database()",
                      "t");
    PQclear(PQexec(other, "COMMIT"));
    PQfinish(other);
    pthread_join(thread, NULL);
    assert_true(waits);
    assert_int_equal(err, 0);
    assert_int_equal(readRecentValFloat(db_conn, "sensor", 1, NULL, NULL, &value), 0);
    assert_true(value == 2);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_stamp_is_26_characters_of_utc),
        T(test_what_is_inserted_is_read),
        T(test_stamp_and_status_may_be_null_on_reading),
        T(test_a_thousand_values_come_in_one_read),
        T(test_one_missing_value_leaves_all_outputs_untouched),
        T(test_an_int_function_refuses_what_is_no_int),
        T(test_arguments_that_make_no_sense_are_refused),
        T(test_a_status_or_table_never_becomes_sql),
        T(test_the_servers_refusal_is_told_and_its_text_kept),
        T(test_a_table_of_another_make_is_no_crash),
        T(test_two_writers_number_their_rows_without_gap_or_double),
        T(test_a_statement_that_the_server_wants_again_is_tried_again),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
