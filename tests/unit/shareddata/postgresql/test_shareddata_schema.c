/* SPDX-License-Identifier: BSD-3-Clause */
/* The PostgreSQL store's tables: their partitions, who waits for them, how they are made and upgraded. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plants.h"

/* ---- Partitions --------------------------------------------------------------------------------- */

/* SQL in the plant's schema. */
static const char *ask(const char *sql)
{
    char path[100];
    snprintf(path, sizeof path, "SET search_path TO plant%d, pg_temp", plant);
    cluster_query(cluster, path);
    return cluster_query(cluster, sql);
}

#define WEEK (7 * 24 * 3600 * APC_NS_PER_S)

static void append_at(struct apc_store *store, int id, int64_t seq, apc_ns time)
{
    struct apc_sample s = sample(APC_SENSOR, id, seq, (double)seq);
    s.time = time;
    assert_int_equal(apc_store_append(store, &s, 1), 1);
}

static int count_sample(void *ctx, const struct apc_sample *s)
{
    (void)s;
    ++*(int *)ctx;
    return 0;
}

static int rows_of(struct apc_store *store, int id)
{
    int n = 0;
    ok(store, apc_store_history(store, APC_SENSOR, id, NULL, count_sample, &n));
    return n;
}

/* Promise(database/sql-hand-double) */
static void test_there_is_a_partition_for_now_and_for_the_weeks_to_come(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    apc_ns now = apc_clock_utc(NULL);
    for (int week = 0; week <= 4; week++) {
        append_at(store, 1, week + 1, now + week * WEEK);
    }
    assert_string_equal(ask("SELECT count(*) || ' ' || count(DISTINCT tableoid) FROM sensor"), "5 5");
    assert_string_equal(ask("SELECT count(*) FROM sensor_rest"), "0");
    append_at(store, 1, 6, now + 20 * WEEK); /* nobody has made that */
    assert_string_equal(ask("SELECT count(*) FROM sensor_rest"), "1");
    assert_int_equal(rows_of(store, 1), 6);
    apc_store_close(store);
}

/* Promise(database/sql-hand-double) */
static void test_a_week_made_late_takes_in_what_was_stored_elsewhere(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    apc_ns now = apc_clock_utc(NULL);
    append_at(store, 1, 1, now + 6 * WEEK);
    append_at(store, 1, 2, now + 30 * WEEK);
    ask("CALL maintain(now() + interval '3 weeks', NULL, NULL, NULL, NULL)");
    assert_string_equal(ask("SELECT count(*) FROM sensor_rest"), "1");
    /* The week that runs stays where it is while rows of it lie elsewhere; the next ones are made. */
    ask("CALL maintain(now() + interval '30 weeks', NULL, NULL, NULL, NULL)");
    assert_string_equal(ask("SELECT count(*) FROM sensor_rest"), "1");
    append_at(store, 1, 3, now + 31 * WEEK);
    append_at(store, 1, 4, now + 30 * WEEK);
    assert_string_equal(ask("SELECT count(*) FROM sensor_rest"), "2");
    assert_int_equal(rows_of(store, 1), 4);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 4);
    ask("CALL maintain(now() + interval '30 weeks', NULL, NULL, NULL, NULL)"); /* harmless to repeat */
    assert_int_equal(rows_of(store, 1), 4);
    apc_store_close(store);
}

static void make_old_weeks(struct apc_store *store)
{
    ask("SELECT make_week('sensor', date_trunc('week', now() AT TIME ZONE 'UTC')::date - 7 * w, current_date)"
        " FROM generate_series(1, 5) AS w");
    apc_ns now = apc_clock_utc(NULL);
    for (int week = 5; week >= 0; week--) {
        append_at(store, 1, 6 - week, now - week * WEEK);
    }
    append_at(store, 2, 1, now - 5 * WEEK); /* silent since */
    assert_string_equal(ask("SELECT count(DISTINCT tableoid) FROM sensor"), "6");
}

/* Promise(database/sql-hand-double) */
static void test_old_weeks_are_dropped_whole_but_not_the_newest_of_a_variable(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_old_weeks(store);
    struct apc_retention keep = {.size = sizeof keep, .samples = 3 * WEEK};
    int dropped = apc_store_maintain(store, &keep);
    assert_true(dropped == 2); /* 5 and 4 weeks ago; of 3 weeks ago a part is still to be kept */
    assert_int_equal(rows_of(store, 1), 4);
    assert_int_equal(rows_of(store, 2), 1);
    assert_int_equal(newest(store, APC_SENSOR, 2).seq, 1);
    append_at(store, 2, 2, apc_clock_utc(NULL));
    assert_int_equal(apc_store_maintain(store, &keep), 1); /* it is the newest no more */
    assert_int_equal(rows_of(store, 2), 1);
    apc_store_close(store);
}

struct maintaining {
    struct apc_store *store;
    int result;
};

static void *maintain(void *arg)
{
    struct maintaining *m = arg;
    struct apc_retention keep = {.size = sizeof keep, .samples = WEEK};
    m->result = apc_store_maintain(m->store, &keep);
    return NULL;
}

/* Promise(database/sql-hand-double) */
static void test_maintenance_waits_for_readers_without_holding_up_writers(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_old_weeks(store);
    PGconn *reader = cluster_connect(cluster);
    char sql[100];
    snprintf(sql, sizeof sql, "BEGIN; SELECT count(*) FROM plant%d.sensor", plant);
    PQclear(PQexec(reader, sql));
    struct maintaining m = {.store = open_direct(LONG)};
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, maintain, &m), 0);
    bool waits = cluster_await(cluster,
                               "SELECT count(*) > 0 FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND "
                               "query LIKE 'CALL maintain%' AND datname = current_database()",
                               "t");
    int appended = 0;
    for (int i = 1; i <= 50; i++) {
        struct apc_sample s = sample(APC_SENSOR, 3, i, i);
        s.time = apc_clock_utc(NULL);
        appended += apc_store_append(store, &s, 1);
    }
    PQclear(PQexec(reader, "COMMIT"));
    PQfinish(reader);
    pthread_join(thread, NULL);
    assert_true(waits);
    assert_int_equal(appended, 50);
    ok(m.store, m.result);
    assert_true(m.result > 0);
    assert_int_equal(rows_of(store, 1), 2);
    apc_store_close(m.store);
    apc_store_close(store);
}

enum { RACERS = 2, RACE = 150 };

struct racer {
    struct apc_store *store;
    apc_ns time; /* each in a partition of its own */
    int stored, failed;
};

static void *race(void *arg)
{
    struct racer *r = arg;
    for (int64_t seq = 1; seq <= RACE && !r->failed; seq++) {
        struct apc_sample s[2] = {sample(APC_SENSOR, 1, seq, 1), sample(APC_SENSOR, 2, seq, 2)};
        s[0].time = s[1].time = r->time;
        int n = apc_store_append(r->store, s, 2);
        r->stored += n;
        r->failed = n < 0;
    }
    return NULL;
}

static void test_a_key_is_taken_once_in_all_partitions_whoever_is_faster(void **state)
{
    (void)state;
    struct racer r[RACERS];
    pthread_t threads[RACERS];
    for (int i = 0; i < RACERS; i++) {
        r[i] = (struct racer){.store = open_direct(LONG), .time = apc_clock_utc(NULL) + i * WEEK};
        ok(r[i].store, apc_store_connect(r[i].store));
        assert_int_equal(pthread_create(&threads[i], NULL, race, &r[i]), 0);
    }
    int stored = 0;
    for (int i = 0; i < RACERS; i++) {
        pthread_join(threads[i], NULL);
        if (r[i].failed) {
            fail_msg("%s", apc_store_error(r[i].store));
        }
        stored += r[i].stored;
        apc_store_close(r[i].store);
    }
    assert_int_equal(stored, 2 * RACE);
    assert_string_equal(ask("SELECT count(*) || ' ' || count(DISTINCT (id, seq)) FROM sensor"), "300 300");
}

/*
 * Promise(database/sql-hand-double): SQL by hand cannot double a key or leave the newest behind;
 *   partitions, the default one, maintenance.
 */
static void test_sql_by_hand_cannot_take_a_key_twice_nor_leave_the_newest_behind(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    PGconn *conn = cluster_connect(cluster);
    char sql[200];
    snprintf(sql, sizeof sql, "INSERT INTO plant%d.sensor VALUES (1, 5, now(), 0, 1), (1, 4, now(), 0, 1)",
             plant);
    PGresult *result = PQexec(conn, sql);
    assert_int_equal(PQresultStatus(result), PGRES_COMMAND_OK);
    PQclear(result);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 5);
    static const char *const twice[] = {
        "(1, 5, now() + interval '1 week', 0, 1)",
        "(1, 4, now() + interval '1 week', 0, 1), (1, 6, now(), 0, 1)",
        "(1, 7, now(), 0, 1), (1, 7, now() + interval '1 week', 0, 1)",
        "(2, 1, now(), 0, 1), (1, 4, '1970-01-01', 0, 1)",
    };
    for (size_t i = 0; i < sizeof twice / sizeof twice[0]; i++) {
        snprintf(sql, sizeof sql, "INSERT INTO plant%d.sensor VALUES %s", plant, twice[i]);
        result = PQexec(conn, sql);
        const char *state_code = PQresultErrorField(result, PG_DIAG_SQLSTATE);
        assert_string_equal(state_code ? state_code : "none", "23505");
        PQclear(result);
    }
    PQfinish(conn);
    assert_int_equal(rows_of(store, 1), 2);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 5);
    assert_int_equal(newest(store, APC_SENSOR, 2).seq, 0);
    apc_store_close(store);
}

/* ---- Waiting ------------------------------------------------------------------------------------ */

struct operation {
    struct apc_store *store;
    int result;
};

static void *wait_long(void *arg)
{
    struct operation *a = arg;
    struct apc_sample seen = {.table = APC_SETPOINT, .id = 1};
    a->result = apc_store_wait(a->store, &seen, 1, 60 * APC_NS_PER_S);
    return NULL;
}

static void test_a_wait_ends_with_an_error_when_its_connection_does_and_the_next_one_works(void **state)
{
    (void)state;
    char uri[600], waiting[300]; /* the look was its last statement: before that, ending its connection makes
                                    it connect anew */
    snprintf(uri, sizeof uri, "%s&application_name=waiter#plant%d", cluster_uri(cluster), plant);
    struct operation a = {.store = open_uri(uri, LONG)};
    snprintf(waiting, sizeof waiting,
             "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'waiter' AND state = 'idle' AND "
             "query LIKE 'SELECT v.i%%FROM setpoint_newest%%' AND datname = '%s'",
             cluster_database(cluster));
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, wait_long, &a), 0);
    bool idle = cluster_await(cluster, waiting, "1");
    terminate(cluster, "waiter");
    pthread_join(thread, NULL);
    assert_true(idle);
    assert_int_equal(a.result, APC_ECONN);
    assert_says(a.store, "connection to the database lost");
    struct apc_sample s = sample(APC_SETPOINT, 1, 1, 1), seen = {.table = APC_SETPOINT, .id = 1};
    assert_int_equal(append_again(a.store, &s, 1), 1);
    int result = APC_ECONN;
    for (int i = 0; i < 100000 && result == APC_ECONN; i++) {
        result = apc_store_wait(a.store, &seen, 1, 0);
    }
    assert_int_equal(result, 1);
    apc_store_close(a.store);
}

/* The wait has a connection of its own: what befalls that is what the store says. */
static void test_a_wait_that_cannot_connect_says_why_and_where(void **state)
{
    (void)state;
    const struct apc_sample seen = {.table = APC_SETPOINT, .id = 1};
    struct apc_store *store = open_uri("postgresql://apc@/nowhere?host=/nonexistent", LONG);
    assert_int_equal(apc_store_wait(store, &seen, 1, 0), APC_ECONN);
    assert_says(store, "/nonexistent");
    apc_store_close(store);
    store = open_direct(LONG);
    ok(store, apc_store_connect(store)); /* its own connection is well */
    char sql[100];
    snprintf(sql, sizeof sql, "DROP TABLE plant%d.setpoint_newest", plant);
    cluster_query(cluster, sql);
    assert_int_equal(apc_store_wait(store, &seen, 1, 60 * APC_NS_PER_S), APC_ESCHEMA);
    assert_says(store, "setpoint_newest");
    assert_true(apc_store_connected(store));
    apc_store_close(store);
}

static void test_a_wait_sees_changes_of_all_its_tables_and_of_no_other(void **state)
{
    (void)state;
    struct apc_store *writer = open_direct(LONG), *store = open_direct(LONG);
    struct apc_sample seen[3] = {
        {.table = APC_SETPOINT, .id = 1}, {.table = APC_OPMODE, .id = 0}, {.table = APC_TUNING, .id = 2}};
    assert_int_equal(apc_store_wait(store, seen, 3, 0), 0);
    struct apc_sample other = {.table = APC_MANUAL, .id = 1};
    ok(writer, apc_store_put(writer, &other, 1));
    assert_int_equal(apc_store_wait(store, seen, 3, 0), 0);
    for (int i = 2; i >= 0; i--) {
        struct apc_sample s = {.table = seen[i].table, .id = seen[i].id};
        ok(writer, apc_store_put(writer, &s, 1));
        assert_int_equal(apc_store_wait(store, seen, 3, INT64_MAX), 1);
        seen[i].seq = s.seq;
        assert_int_equal(apc_store_wait(store, seen, 3, 0), 0);
    }
    apc_store_close(store);
    apc_store_close(writer);
}

/* ---- Schema ------------------------------------------------------------------------------------- */

/* Promise(database/apc-init-once) */
static void test_a_missing_schema_says_what_to_run(void **state)
{
    (void)state;
    char uri[600], expected[300];
    snprintf(uri, sizeof uri, "%s#nobody", cluster_uri(cluster));
    struct apc_store *store = open_uri(uri, LONG);
    struct apc_sample s = {.table = APC_SENSOR, .id = 1};
    assert_int_equal(apc_store_read(store, &s, 1), APC_ESCHEMA);
    snprintf(expected, sizeof expected, "schema \"nobody\" in database \"%s\" is missing: run apc init",
             cluster_database(cluster));
    assert_string_equal(apc_store_error(store), expected);
    assert_int_equal(apc_store_init(store), 0);
    ok(store, apc_store_read(store, &s, 1)); /* at once: init ends the pause */
    apc_store_close(store);
    cluster_query(cluster, "CREATE SCHEMA empty");
    snprintf(uri, sizeof uri, "%s#empty", cluster_uri(cluster));
    store = open_uri(uri, LONG);
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA); /* there, but not ours */
    assert_says(store, "apc init");
    apc_store_close(store);
    char sql[100];
    snprintf(sql, sizeof sql, "DELETE FROM plant%d.migration", plant);
    cluster_query(cluster, sql);
    store = open_direct(LONG);
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA); /* half made */
    snprintf(expected, sizeof expected, "schema plant%d is version 0, this library needs %d: run apc init",
             plant, apc_store_version());
    assert_string_equal(apc_store_error(store), expected);
    apc_store_close(store);
}

/* Promise(database/apc-init-once) */
static void test_a_newer_schema_is_left_alone(void **state)
{
    (void)state;
    char sql[200], expected[200];
    snprintf(sql, sizeof sql, "INSERT INTO plant%d.migration VALUES (%d, 'from the future')", plant,
             apc_store_version() + 8);
    cluster_query(cluster, sql);
    snprintf(
        expected, sizeof expected,
        "schema plant%d is version %d, for programs of version %d or newer; this library is of %d: upgrade "
        "libapc",
        plant, apc_store_version() + 8, apc_store_version() + 8, apc_store_version());
    struct apc_store *store = open_direct(LONG);
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
    assert_string_equal(apc_store_error(store), expected);
    assert_int_equal(apc_store_tables_version(store), 0);
    assert_int_equal(apc_store_init(store), APC_ESCHEMA);
    assert_string_equal(apc_store_error(store), expected);
    apc_store_close(store);
}

/* Promise(database/apc-init-once) */
static void test_a_newer_schema_that_says_it_is_compatible_is_worked_with(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    assert_int_equal(apc_store_tables_version(store), 0);
    ok(store, apc_store_connect(store));
    assert_int_equal(apc_store_tables_version(store), apc_store_version());
    apc_store_close(store);
    const int newer = apc_store_version() + 8;
    char sql[200];
    snprintf(sql, sizeof sql, "INSERT INTO plant%d.migration VALUES (%d, 'from the future', now(), %d)",
             plant, newer, apc_store_version());
    cluster_query(cluster, sql);
    store = open_direct(LONG);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    assert_int_equal(apc_store_tables_version(store), newer);
    assert_int_equal(apc_store_init(store), newer);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 1);
    apc_store_close(store);
    snprintf(sql, sizeof sql, "UPDATE plant%d.migration SET compatible_from = %d WHERE version = %d", plant,
             apc_store_version() + 1, newer);
    cluster_query(cluster, sql);
    store = open_direct(LONG);
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
    assert_says(store, "upgrade libapc");
    assert_int_equal(apc_store_init(store), APC_ESCHEMA);
    assert_says(store, "upgrade libapc");
    apc_store_close(store);
}

static const char *say(PGconn *conn, const char *sql)
{
    static char answer[300];
    PGresult *result = PQexec(conn, sql);
    if (PQresultStatus(result) == PGRES_COMMAND_OK) {
        snprintf(answer, sizeof answer, "%s", PQcmdTuples(result));
    } else {
        snprintf(answer, sizeof answer, "%s",
                 PQntuples(result) > 0 ? PQgetvalue(result, 0, PQnfields(result) - 1) : PQerrorMessage(conn));
    }
    PQclear(result);
    return answer;
}

static PGconn *connect_to_plant(void)
{
    PGconn *conn = cluster_connect(cluster);
    char sql[100];
    snprintf(sql, sizeof sql, "SET search_path TO plant%d, pg_temp", plant);
    say(conn, sql);
    return conn;
}

/* What a database of before the baseline says of its files; the tables are the same. */
static const char former[] =
    "DELETE FROM migration; INSERT INTO migration (version, name, compatible_from) VALUES "
    "(1, '0001-tables', NULL), (3, '0003-rows', 1), (4, '0004-loops', 4); INSERT INTO repair (name) VALUES "
    "('0002-repair-rights'), ('0005-repair-owner'), ('0006-repair-claims'), ('0007-repair-packed'), "
    "('0008-repair-plants'), ('0009-repair-once'), ('0010-repair-open'), ('0011-repair-trend'), "
    "('0012-repair-times')";

#define FILES                                                                                                \
    "SELECT string_agg(name, ' ' ORDER BY name) FROM (SELECT name FROM migration UNION ALL "                 \
    "SELECT name FROM repair) AS f"

/* Each row of each table. */
static void sum_up(char sum[64])
{
    snprintf(
        sum, 64, "%s",
        ask("SELECT md5(string_agg(query_to_xml(format('SELECT * FROM %I AS t ORDER BY t::text', relname), "
            "true, false, '')::text, '' ORDER BY relname)) FROM pg_class WHERE relkind = 'r' AND "
            "relnamespace = current_schema()::regnamespace AND relname NOT IN ('migration', 'repair', "
            "'event')"));
    assert_int_equal(strlen(sum), 32);
}

/*
 * Promise(database/before-baseline): A database of before the baseline is taken as it is when it has all
 *   repairs, and else refused and left alone.
 */
static void test_a_database_of_before_the_baseline_is_taken_as_it_is(void **state)
{
    (void)state;
    char before[64], after[64];
    struct apc_store *store = open_direct(LONG);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1), r = {.table = APC_SETPOINT, .id = 1, .value = 7};
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    ok(store, apc_store_put(store, &r, 1));
    apc_store_close(store);
    ask(former);
    sum_up(before);

    store = open_direct(LONG);
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
    assert_says(store, "run apc init");
    assert_int_equal(apc_store_init(store), apc_store_version());
    sum_up(after);
    assert_string_equal(after, before);
    assert_string_equal(ask(FILES), "0001-baseline");
    assert_string_equal(ask("SELECT version || ' ' || count(*) OVER () FROM migration"), "1 1");
    assert_string_equal(ask("SELECT source || ': ' || text FROM event"),
                        "apc init: the tables are those of 0001-baseline");
    s = sample(APC_SENSOR, 1, 2, 2);
    assert_int_equal(append_again(store, &s, 1), 1);
    assert_int_equal(newest(store, APC_SETPOINT, 1).seq, 1);
    assert_int_equal(apc_store_init(store), apc_store_version());
    assert_string_equal(ask("SELECT count(*) FROM event"), "1");
    apc_store_close(store);
}

/* Promise(database/before-baseline) */
static void test_a_database_that_lacks_a_repair_is_refused_and_left_alone(void **state)
{
    (void)state;
    static const char *const without[] = {
        "DELETE FROM repair WHERE name = '0012-repair-times'",
        "DELETE FROM repair; DELETE FROM migration WHERE version > 1",
        ("DROP TABLE repair; ALTER TABLE migration DROP COLUMN compatible_from; CREATE VIEW repair AS SELECT "
         "name FROM migration"),
    };
    char before[64], after[64], files[300];
    struct apc_store *store = open_direct(LONG);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    apc_store_close(store);
    ask(former);
    for (size_t i = 0; i < sizeof without / sizeof without[0]; i++) {
        ask(without[i]);
        snprintf(files, sizeof files, "%s", ask(FILES));
        sum_up(before);
        store = open_direct(LONG);
        assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
        assert_int_equal(apc_store_init(store), APC_ESCHEMA);
        assert_says(store, "lacks 0012-repair-times: run apc init of commit");
        assert_string_equal(ask(FILES), files);
        sum_up(after);
        assert_string_equal(after, before);
        apc_store_close(store);
    }
}

/* Promise(database/only-people-notify): Only what people write notifies. */
static void test_only_what_people_write_notifies(void **state)
{
    (void)state;
    PGconn *conn = connect_to_plant();
    for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
        if (table == APC_STATE) {
            continue;
        }
        const char *name = apc_table_name((enum apc_table)table);
        char sql[200];
        snprintf(sql, sizeof sql, "SELECT '%s'::regclass::oid", name);
        snprintf(sql, sizeof sql, "LISTEN apc_%s", say(conn, sql));
        say(conn, sql);
        snprintf(sql, sizeof sql, "INSERT INTO %s (id, seq, time, status, value) VALUES (2, 1, now(), 0, %s)",
                 name, apc_table_vectors((enum apc_table)table) ? "'{1}'" : "1");
        assert_string_equal(say(conn, sql), "1");
        say(conn, "SELECT 1");
        PGnotify *told = PQnotifies(conn);
        bool people =
            table == APC_SETPOINT || table == APC_OPMODE || table == APC_TUNING || table == APC_MANUAL;
        if ((told != NULL) != people) {
            fail_msg("%s: %s", name, told ? "notifies" : "is silent");
        }
        PQfreemem(told);
    }
    PQfinish(conn);
}

/* ---- Claims by set -------------------------------------------------------------------------------- */

#define NO_LOCKS                                                                                             \
    "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND database = (SELECT oid FROM pg_database " \
    "WHERE "                                                                                                 \
    "datname = current_database())"

/*
 * Promise(database/claim-single-variables): A claim of single variables is whole or none, names who has
 *   one, lives with its session, and comes back with the connection.
 */
static void test_a_set_is_claimed_wholly_or_not_at_all_and_ends_with_its_session(void **state)
{
    (void)state;
    ask("INSERT INTO actuator (id, seq, time, status, value) VALUES (2, 7, now(), 0, 1)");
    PGconn *a = connect_to_plant(), *b = connect_to_plant();
    say(a, "SET application_name TO 'upper'");
    assert_string_equal(say(a, "SELECT last FROM claim_set('{actuator,tick,actuator}', '{2,1,1}')"),
                        "{7,0,0}");
    assert_string_equal(say(b, "SELECT last FROM claim_set('{actuator,tick}', '{3,2}')"), "{0,0}");
    assert_string_equal(say(b, "SELECT at FROM claim_set('{actuator,actuator}', '{4,2}')"), "2");
    assert_memory_equal(say(b, "SELECT holder FROM claim_set('{actuator,actuator}', '{4,2}')"),
                        "upper (server process", 21);
    assert_string_equal(say(a, "SELECT last FROM claim_set('{actuator}', '{4}')"), "{0}"); /* b has it not */
    assert_string_equal(say(a, "SELECT last FROM claim_set('{actuator,actuator}', '{4,4}')"), "{0,0}");
    assert_string_equal(ask(NO_LOCKS " AND granted"), "2"); /* one a session, whatever it claims */

    /* A whole table is claimed by nobody while somebody has a variable of it, and the other way round. */
    assert_memory_equal(say(b, "SELECT holder FROM claim('actuator', 1)"), "upper (server process", 21);
    assert_string_equal(say(b, "SELECT last FROM claim('sensor', 1)"), "{0}");
    assert_string_equal(say(a, "SELECT at FROM claim_set('{estimate,sensor}', '{1,9}')"), "2");
    assert_string_equal(say(b, "SELECT last FROM claim_set('{sensor}', '{9}')"), "{0}"); /* its own table */

    /* What was given up or lost is another's. */
    assert_string_equal(say(b, "SELECT claim_release('{actuator,actuator}', '{2,3}')"), "1");
    assert_string_equal(say(a, "SELECT claim_release('{actuator}', '{2}')"), "1");
    assert_string_equal(say(b, "SELECT last FROM claim_set('{actuator}', '{2}')"), "{7}");
    PQfinish(a);
    assert_true(cluster_await(cluster, NO_LOCKS, "2"));
    assert_string_equal(say(b, "SELECT last FROM claim_set('{actuator,tick}', '{1,1}')"), "{0,0}");
    PQfinish(b);
    assert_true(cluster_await(cluster, NO_LOCKS, "0"));

    /* A later session of a number that an earlier one had is not it. */
    a = connect_to_plant();
    say(a, "INSERT INTO claim VALUES ('alarm', 1, 'ghost', pg_backend_pid(), '2001-01-01')");
    assert_string_equal(say(a, "SELECT last FROM claim_set('{tick}', '{1}')"), "{0}");
    b = connect_to_plant();
    assert_string_equal(say(b, "SELECT last FROM claim_set('{alarm}', '{1}')"), "{0}");
    PQfinish(b);
    PQfinish(a);
}

/* Promise(database/apc-init-once) */
static void test_init_by_a_superuser_makes_the_owners_tables(void **state)
{
    (void)state;
    char role[64], sql[900];
    snprintf(role, sizeof role, "o%d_%s", plant, cluster_database(cluster));
    snprintf(sql, sizeof sql,
             "CREATE ROLE %s; DROP SCHEMA plant%d CASCADE; CREATE SCHEMA plant%d AUTHORIZATION %s", role,
             plant, plant, role);
    cluster_query(cluster, sql);
    struct apc_store *store = open_direct(LONG);
    assert_int_equal(apc_store_init(store), 0);
    snprintf(sql, sizeof sql,
             "SELECT string_agg(DISTINCT relowner::regrole::text, ',') FROM pg_class WHERE relnamespace = "
             "'plant%d'::regnamespace",
             plant);
    assert_string_equal(cluster_query(cluster, sql), role);
    snprintf(sql, sizeof sql,
             "SELECT string_agg(DISTINCT proowner::regrole::text, ',') FROM pg_proc WHERE pronamespace = "
             "'plant%d'::regnamespace",
             plant);
    assert_string_equal(cluster_query(cluster, sql), role);

    /* What takes the role is the server's, whatever the schema has of the same name. */
    snprintf(sql, sizeof sql,
             "RESET search_path; CREATE TABLE loot%d (who name); CREATE FUNCTION plant%d.set_config(text, "
             "name, boolean) "
             "RETURNS text "
             "LANGUAGE sql AS $$ INSERT INTO public.loot%d VALUES (current_user) RETURNING 'x' $$",
             plant, plant, plant);
    cluster_query(cluster, sql);
    assert_int_equal(apc_store_init(store), apc_store_version());
    snprintf(sql, sizeof sql, "SELECT count(*) FROM loot%d", plant);
    assert_string_equal(cluster_query(cluster, sql), "0");
    apc_store_close(store);
    snprintf(sql, sizeof sql, "DROP SCHEMA plant%d CASCADE; DROP ROLE %s", plant, role);
    cluster_query(cluster, sql);
}

/* As by psql, whatever the session's style: another zone's abbreviation is none of this one's. */
static void test_maintenance_by_hand_makes_the_weeks_of_their_names(void **state)
{
    (void)state;
    ask("SET DateStyle TO 'SQL, DMY'; SET TimeZone TO 'Asia/Kolkata'");
    ask("CALL maintain(now() + interval '20 weeks', NULL, NULL, NULL, NULL)");
    ask("INSERT INTO sensor (id, seq, time, status, value) VALUES (1, 1, '2020-01-06 02:00:00+00', 0, 1), "
        "(1, 2, '2020-01-06 00:00:00+00', 0, 1), (1, 3, now(), 0, 1)");
    ask("CALL maintain(now(), '2020-01-06 01:00:00+00', NULL, NULL, NULL)");
    assert_string_equal(ask("SELECT string_agg(seq::text, ' ' ORDER BY seq) FROM sensor"),
                        "1 3"); /* before that time, and not before one some hours away */
    ask("SET TimeZone TO 'UTC'; SET DateStyle TO ISO");
    assert_string_equal(
        ask("SELECT count(*) FROM pg_inherits JOIN pg_class c ON c.oid = inhrelid WHERE c.relname ~ "
            "'[0-9]{8}$' AND "
            "inhparent = 'sensor'::regclass AND pg_get_expr(c.relpartbound, c.oid) !~ ('FROM ..' || "
            "to_char(to_date(right(c.relname, 8), 'YYYYMMDD'), 'YYYY-MM-DD') || ' 00:00:00')"),
        "0");
    ask("RESET TimeZone; RESET DateStyle");
}

static void test_a_schema_that_vanishes_is_noticed(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 0);
    char sql[100];
    snprintf(sql, sizeof sql, "DROP SCHEMA plant%d CASCADE", plant);
    cluster_query(cluster, sql);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ESCHEMA);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(append_again(store, &s, 1), 1);
    apc_store_close(store);
}

static void *init_one(void *arg)
{
    struct operation *a = arg;
    a->result = apc_store_init(a->store);
    return NULL;
}

/*
 * Promise(database/apc-init-once): `apc init` once or many times at once, owner's also by a superuser;
 *   newer versions.
 */
static void test_many_inits_at_once_make_one_schema(void **state)
{
    (void)state;
    enum { N = 4 };
    struct operation a[N];
    pthread_t threads[N];
    plant++; /* one that does not exist */
    for (int i = 0; i < N; i++) {
        a[i].store = open_direct(LONG);
        assert_int_equal(pthread_create(&threads[i], NULL, init_one, &a[i]), 0);
    }
    int made = 0;
    for (int i = 0; i < N; i++) {
        pthread_join(threads[i], NULL);
        if (a[i].result < 0) {
            fail_msg("%s", apc_store_error(a[i].store));
        }
        made += a[i].result == 0;
        apc_store_close(a[i].store);
    }
    assert_int_equal(made, 1);
}

static void test_every_table_and_column_says_what_it_is(void **state)
{
    (void)state;
    char sql[500];
    snprintf(
        sql, sizeof sql,
        "SELECT coalesce(string_agg(c.relname || '.' || coalesce(a.attname, ''), ' '), '') FROM pg_class c "
        "LEFT JOIN pg_attribute a ON a.attrelid = c.oid AND a.attnum >= 0 AND NOT a.attisdropped "
        "WHERE c.relkind = 'r' AND c.relnamespace = 'plant%d'::regnamespace AND "
        "(col_description(c.oid, a.attnum) IS NULL OR obj_description(c.oid, 'pg_class') IS NULL)",
        plant);
    assert_string_equal(cluster_query(cluster, sql), "");
}

/* What becomes of a variable stands in table actual under this number, in every store. */
static void test_a_variable_has_the_librarys_number_over_all_tables(void **state)
{
    (void)state;
    for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
        char sql[200], expected[16];
        snprintf(sql, sizeof sql,
                 "INSERT INTO tag (table_name, id, name, unit, description, low, high) "
                 "VALUES ('%s', 1003, 'x', '', '', 0, 1) RETURNING number",
                 apc_table_name((enum apc_table)table));
        snprintf(expected, sizeof expected, "%d", apc_variable_number((enum apc_table)table, 1003));
        assert_string_equal(ask(sql), expected);
    }
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_there_is_a_partition_for_now_and_for_the_weeks_to_come),
        T(test_a_week_made_late_takes_in_what_was_stored_elsewhere),
        T(test_old_weeks_are_dropped_whole_but_not_the_newest_of_a_variable),
        T(test_maintenance_waits_for_readers_without_holding_up_writers),
        T(test_a_key_is_taken_once_in_all_partitions_whoever_is_faster),
        T(test_sql_by_hand_cannot_take_a_key_twice_nor_leave_the_newest_behind),
        T(test_a_wait_ends_with_an_error_when_its_connection_does_and_the_next_one_works),
        T(test_a_wait_that_cannot_connect_says_why_and_where),
        T(test_a_wait_sees_changes_of_all_its_tables_and_of_no_other),
        T(test_a_missing_schema_says_what_to_run),
        T(test_a_newer_schema_is_left_alone),
        T(test_a_newer_schema_that_says_it_is_compatible_is_worked_with),
        T(test_a_database_of_before_the_baseline_is_taken_as_it_is),
        T(test_a_database_that_lacks_a_repair_is_refused_and_left_alone),
        T(test_only_what_people_write_notifies),
        T(test_a_set_is_claimed_wholly_or_not_at_all_and_ends_with_its_session),
        T(test_init_by_a_superuser_makes_the_owners_tables),
        T(test_maintenance_by_hand_makes_the_weeks_of_their_names),
        T(test_a_schema_that_vanishes_is_noticed),
        T(test_many_inits_at_once_make_one_schema),
        T(test_a_variable_has_the_librarys_number_over_all_tables),
        T(test_every_table_and_column_says_what_it_is),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
