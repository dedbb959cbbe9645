/* SPDX-License-Identifier: BSD-3-Clause */
/* The PostgreSQL store against a network and a server that fail. */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "plants.h"
#include "proxy.h"
/* A store behind a proxy whose socket stands beside the server's. */
static struct proxy *new_proxy(char directory[256])
{
    char listening[400], server[400];
    snprintf(directory, 256, "%s/proxyXXXXXX", getenv("APC_TEST_PGHOST") ? "/tmp" : cluster_host(cluster));
    assert_non_null(mkdtemp(directory));
    snprintf(listening, sizeof listening, "unix:%s/.s.PGSQL.5432", directory);
    snprintf(server, sizeof server, "unix:%s", cluster_socket(cluster));
    return proxy_start(listening, server);
}

static struct apc_store *open_through(const char *directory, apc_ns timeout)
{
    char uri[800];
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s#plant%d", cluster_database(cluster), directory,
             plant);
    return open_uri(uri, timeout);
}

/* ---- Round trips ----------------------------------------------------------------------------- */

/* On a busy machine an answer may begin before all of its request is through, and that looks like two trips. */
enum { TRIES = 20 };

/* Promise(run): A tick costs two round trips to the database. */
static void test_a_tick_reads_in_one_round_trip_and_writes_in_one(void **state)
{
    (void)state;
    char directory[256];
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, LONG);
    ok(store, apc_store_connect(store));
    static struct apc_sample s[5000];
    static const enum apc_table tables[5] = {APC_SENSOR, APC_SETPOINT, APC_OPMODE, APC_TUNING, APC_MANUAL};
    static const enum apc_table written[3] = {APC_ACTUATOR, APC_ESTIMATE, APC_OPMODE};
    for (int n = 1; n <= 1000; n *= 10) {
        struct apc_store_stats before = {.size = sizeof before}, after = before;
        for (int i = 0; i < 5 * n; i++) {
            s[i] = (struct apc_sample){.table = tables[i / n], .id = i % n + 1};
        }
        apc_store_stats(store, &before);
        uint64_t trips = 0, asked = 0;
        for (int try = 0; try < TRIES && trips != 1; try++, asked++) {
            trips = proxy_round_trips(proxy);
            ok(store, apc_store_read(store, s, (size_t)(5 * n)));
            trips = proxy_round_trips(proxy) - trips;
        }
        assert_int_equal(trips, 1);
        for (int i = 0; i < 3 * n; i++) {
            s[i] = sample(written[i / n], i % n + 1, n, i);
        }
        trips = 0;
        for (int try = 0; try < TRIES && trips != 1; try++, asked++) {
            trips = proxy_round_trips(proxy);
            assert_int_equal(apc_store_append(store, s, (size_t)(3 * n)), 3 * n);
            trips = proxy_round_trips(proxy) - trips;
        }
        assert_int_equal(trips, 1);
        apc_store_stats(store, &after);
        assert_int_equal(after.round_trips - before.round_trips, asked); /* the library's own count agrees */
    }
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

/* ---- Network faults ---------------------------------------------------------------------------- */

/*
 * Promise(stores/postgresql-deadlines): PostgreSQL: deadlines; several hosts and failover; an asynchronous
 *   commit is no acknowledgement; each refusal has its answer.
 */
static void test_a_stalled_server_costs_the_timeout_and_the_next_call_works(void **state)
{
    (void)state;
    char directory[256];
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, SHORT), *direct = open_direct(LONG);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1), out = {.table = APC_SENSOR, .id = 1};
    assert_int_equal(append_again(direct, &s, 1), 1);
    assert_int_equal(append_again(store, &s, 1), 0);
    proxy_set(proxy, PROXY_STALL);
    assert_int_equal(apc_store_read(store, &out, 1), APC_ETIMEDOUT);
    assert_says(store, "no answer from the database");
    assert_false(apc_store_connected(store)); /* a late answer can never be taken for another's */
    assert_int_equal(apc_store_connect(store), APC_ETIMEDOUT);
    proxy_set(proxy, PROXY_PASS);
    assert_int_equal(append_again(store, &s, 1), 0); /* there already */
    assert_int_equal(newest(direct, APC_SENSOR, 1).seq, 1);
    apc_store_close(store);
    apc_store_close(direct);
    proxy_stop(proxy);
    rmdir(directory);
}

static void test_a_write_that_the_server_does_not_take_ends_at_the_timeout(void **state)
{
    (void)state;
    enum { N = 200000 }; /* more than the sockets hold: the store has to wait to write */
    char directory[256];
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, SHORT);
    struct apc_sample *s = malloc(N * sizeof *s);
    assert_non_null(s);
    for (int i = 0; i < N; i++) {
        s[i] = sample(APC_SENSOR, i, 1, 1);
    }
    connect_again(store);
    proxy_set(proxy, PROXY_STALL);
    int result = apc_store_append(store, s, N);
    proxy_set(proxy, PROXY_CUT);
    free(s);
    assert_int_equal(result, APC_ETIMEDOUT);
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

/* Promise(stores/postgresql-deadlines) */
static void test_a_lost_answer_to_commit_is_retried_without_a_duplicate(void **state)
{
    (void)state;
    char directory[256];
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, LONG);
    ok(store, apc_store_connect(store));
    struct apc_sample s[2] = {sample(APC_SENSOR, 1, 1, 1), sample(APC_SENSOR, 2, 1, 2)};
    proxy_arm(proxy, PROXY_TO_CLIENT, 0, PROXY_CUT); /* the server has answered, the client never learns */
    assert_int_equal(apc_store_append(store, s, 2), APC_ECONN);
    assert_int_equal(proxy_await_armed(proxy), 0);
    char sql[128];
    snprintf(sql, sizeof sql, "SELECT count(*) FROM plant%d.sensor", plant);
    assert_string_equal(cluster_query(cluster, sql), "2"); /* it had taken place */
    assert_int_equal(append_again(store, s, 2), 0);
    assert_string_equal(cluster_query(cluster, sql), "2");
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

static void test_an_answer_cut_anywhere_is_an_error_and_never_half_a_result(void **state)
{
    (void)state;
    char directory[256];
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, LONG);
    struct apc_sample s[20];
    for (int i = 0; i < 20; i++) {
        s[i] = sample(APC_SENSOR, i, 1, i);
    }
    assert_int_equal(append_again(store, s, 20), 20);
    bool whole = false;
    for (uint64_t bytes = 0; !whole && bytes < 20000; bytes += 37) {
        ok(store, apc_store_connect(store));
        proxy_arm(proxy, PROXY_TO_CLIENT, bytes, PROXY_CUT);
        int err = apc_store_read(store, s, 20);
        whole = err == 0;
        assert_true(err == 0 || err == APC_ECONN);
        proxy_set(proxy, PROXY_PASS);
    }
    assert_true(whole); /* in the end the trap lay behind the answer */
    for (int i = 0; i < 20; i++) {
        assert_near(s[i].value, i, 0);
    }
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

static void test_after_a_failed_connect_it_answers_at_once_until_the_pause_is_over(void **state)
{
    (void)state;
    char directory[256], uri[800];
    struct proxy *proxy = new_proxy(directory);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s#plant%d", cluster_database(cluster), directory,
             plant);
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options,
                                        .timeout = LONG,
                                        .backoff_min = 3600 * APC_NS_PER_S,
                                        .backoff_max = 7200 * APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    proxy_set(proxy, PROXY_REFUSE);
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    proxy_set(proxy, PROXY_PASS);
    assert_int_equal(apc_store_connect(store), APC_ECONN); /* it could, but does not try */
    assert_says(store, "next try in ");
    assert_says(store, "cannot connect to the database");
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

static double next_try(const struct apc_store *store)
{
    const char *says = strstr(apc_store_error(store), "next try in ");
    return says ? strtod(says + strlen("next try in "), NULL) : 0;
}

/* Promise(run/growing-pauses) */
static void test_the_pauses_of_many_clients_are_not_the_same(void **state)
{
    (void)state;
    enum { N = 8 };
    double pauses[N], lowest = 1e9, highest = 0;
    for (int i = 0; i < N; i++) {
        struct apc_store *store = NULL;
        struct apc_store_options options = {.size = sizeof options,
                                            .timeout = LONG,
                                            .backoff_min = 3600 * APC_NS_PER_S,
                                            .backoff_max = 7200 * APC_NS_PER_S};
        assert_int_equal(
            apc_store_open(&store, "postgresql://apc@/nowhere?host=/nonexistent", &options, NULL), 0);
        assert_int_equal(apc_store_connect(store), APC_ECONN);
        assert_int_equal(apc_store_connect(store), APC_ECONN);
        pauses[i] = next_try(store);
        lowest = fmin(lowest, pauses[i]);
        highest = fmax(highest, pauses[i]);
        apc_store_close(store);
    }
    assert_true(lowest > 1700 && highest <= 3600.1); /* half is certain; less what has passed since */
    assert_true(highest - lowest > 1);
}

/*
 * Promise(run/growing-pauses): A peer or store that goes away is tried again after growing, jittered
 *   pauses, and that is said once.
 */
static void test_the_pauses_grow_up_to_the_longest(void **state)
{
    (void)state;
    struct apc_store *store = NULL;
    struct apc_store_options options = {
        .size = sizeof options, .timeout = LONG, .backoff_min = 1, .backoff_max = APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, "postgresql://apc@/nowhere?host=/nonexistent", &options, NULL),
                     0);
    for (int tried = 0; tried < 5;) { /* with the longest pause; the first ones are over at once */
        int err = apc_store_connect(store);
        assert_int_equal(err, APC_ECONN);
        assert_says(store, "/nonexistent");
        bool long_one = next_try(store) > 0.6;
        assert_true(next_try(store) <= 1.0);
        while (next_try(store) > 0) { /* until it has tried again */
            apc_store_connect(store);
        }
        tried += long_one;
    }
    apc_store_close(store);
}

static void test_a_server_that_did_not_answer_is_not_there_until_the_pause_is_over(void **state)
{
    (void)state;
    char directory[256], uri[800];
    struct proxy *proxy = new_proxy(directory);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s#plant%d", cluster_database(cluster), directory,
             plant);
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options,
                                        .timeout = SHORT,
                                        .backoff_min = 3600 * APC_NS_PER_S,
                                        .backoff_max = 7200 * APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    proxy_set(proxy, PROXY_STALL);
    assert_int_equal(apc_store_connect(store), APC_ETIMEDOUT);
    assert_says(store, "no answer from the database at ");
    assert_says(store, " within 300 ms");
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    assert_says(store, " within 300 ms; next try in ");
    assert_true(next_try(store) > 1700 && next_try(store) <= 3600.1);
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

static void test_an_unreachable_server_is_named(void **state)
{
    (void)state;
    struct apc_store *store = open_uri("postgresql://apc@/nowhere?host=/nonexistent", LONG);
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    assert_says(store, "/nonexistent");
    apc_store_close(store);
    char uri[600];
    snprintf(uri, sizeof uri, "postgresql://apc@/no_such_db?host=%s", cluster_host(cluster));
    store = open_uri(uri, LONG);
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    assert_says(store, "database \"no_such_db\" does not exist");
    apc_store_close(store);
}

static void test_of_several_hosts_the_next_is_tried_when_one_swallows_packets(void **state)
{
    (void)state;
    char directory[256], uri[900];
    struct proxy *proxy = new_proxy(directory);
    proxy_set(proxy, PROXY_STALL);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s,%s#plant%d", cluster_database(cluster), directory,
             cluster_host(cluster), plant);
    struct apc_store *store = open_uri(uri, SHORT);
    assert_int_equal(apc_store_connect(store), APC_ETIMEDOUT);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    ok(store, append_again(store, &s, 1));
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

static void test_hosts_of_a_service_file_take_turns_as_well(void **state)
{
    (void)state;
    char directory[256], path[300], uri[64];
    struct proxy *proxy = new_proxy(directory);
    proxy_set(proxy, PROXY_STALL);
    snprintf(path, sizeof path, "%s/services", directory);
    FILE *services = fopen(path, "w");
    assert_non_null(services);
    fprintf(services, "[plant]\nhost=%s,%s\ndbname=%s\nuser=apc\n", directory, cluster_host(cluster),
            cluster_database(cluster));
    fclose(services);
    setenv("PGSERVICEFILE", path, 1);
    snprintf(uri, sizeof uri, "postgresql:///?service=plant#plant%d", plant);
    struct apc_store *store = open_uri(uri, SHORT);
    int stalled = apc_store_connect(store);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    int appended = append_again(store, &s, 1);
    unsetenv("PGSERVICEFILE");
    unlink(path);
    assert_int_equal(stalled, APC_ETIMEDOUT);
    assert_in_range(appended, 0, 1); /* 0: an earlier try had taken place, its answer was late */
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

/* Promise(stores/postgresql-deadlines) */
static void test_only_a_host_that_can_be_written_to_is_used(void **state)
{
    (void)state;
    char sql[200], uri[900];
    struct apc_store *only = open_direct(LONG);
    snprintf(sql, sizeof sql, "ALTER DATABASE %s SET default_transaction_read_only = on",
             cluster_database(cluster));
    cluster_query(cluster, sql);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s,%s#plant%d", cluster_database(cluster),
             cluster_host(cluster), cluster_host(cluster), plant);
    struct apc_store *store = open_uri(uri, LONG);
    int err = apc_store_connect(store), alone = apc_store_connect(only);
    snprintf(sql, sizeof sql, "ALTER DATABASE %s RESET default_transaction_read_only",
             cluster_database(cluster));
    cluster_query(cluster, sql);
    assert_int_equal(err, APC_ECONN);
    assert_says(store, "read-only");
    apc_store_close(store);
    assert_int_equal(alone, APC_ECONN); /* nor when there is no other */
    assert_says(only, "read-only");
    apc_store_close(only);
}

static void test_a_server_that_became_read_only_is_left(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    ok(store, apc_store_connect(store));
    char sql[300];
    snprintf(sql, sizeof sql,
             "CREATE FUNCTION plant%d.refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RAISE "
             "read_only_sql_transaction; END $$; CREATE TRIGGER t BEFORE INSERT ON plant%d.sensor EXECUTE "
             "FUNCTION "
             "plant%d.refuse()",
             plant, plant, plant);
    cluster_query(cluster, sql);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN);
    assert_false(apc_store_connected(store)); /* the next call looks for another host */
    apc_store_close(store);
}

/* ---- Commits that are none ---------------------------------------------------------------------- */

static void test_a_commit_refused_at_its_very_end_is_not_acknowledged(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    char sql[400];
    snprintf(sql, sizeof sql,
             "CREATE FUNCTION plant%d.late() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RAISE 'too late'; "
             "END $$; "
             "CREATE CONSTRAINT TRIGGER t AFTER INSERT ON plant%d.sensor DEFERRABLE INITIALLY DEFERRED FOR "
             "EACH ROW "
             "EXECUTE FUNCTION plant%d.late()",
             plant, plant, plant);
    cluster_query(cluster, sql);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ESTORE);
    assert_says(store, "too late");
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 0);
    apc_store_close(store);
}

/* Of tuning: the server says no as value tells it to. */
static void make_refusing(void)
{
    char sql[700];
    snprintf(
        sql, sizeof sql,
        "CREATE TABLE plant%d.code (n int, sqlstate text); CREATE FUNCTION plant%d.refuse() RETURNS trigger "
        "LANGUAGE plpgsql AS $$ DECLARE c text; BEGIN SELECT sqlstate INTO c FROM code WHERE n = NEW.value; "
        "IF FOUND THEN RAISE 'it says no' USING ERRCODE = c, DETAIL = E'for\n a reason'; END IF; RETURN NEW; "
        "END $$; CREATE TRIGGER t BEFORE INSERT ON plant%d.tuning FOR EACH ROW EXECUTE FUNCTION "
        "plant%d.refuse()",
        plant, plant, plant, plant);
    cluster_query(cluster, sql);
}

/* Promise(stores/postgresql-deadlines) */
static void test_each_refusal_of_the_server_is_told_apart(void **state)
{
    (void)state;
    static const struct {
        const char *sqlstate;
        int err;
        bool stays; /* connected */
        const char *says;
    } refusals[] = {
        {"42501", APC_EPERM, true, "the database does not permit it: it says no: for a reason"},
        {"42P01", APC_ESCHEMA, false, "schema is not libapc's (run apc init): it says no: for a reason"},
        {"42883", APC_ESCHEMA, false, "schema is not libapc's (run apc init): it says no: for a reason"},
        {"3F000", APC_ESCHEMA, false, "schema is not libapc's (run apc init): it says no: for a reason"},
        {"25006", APC_ECONN, false, "the database server ended the connection: it says no: for a reason"},
        {"57P03", APC_ECONN, false, "the database server ended the connection: it says no: for a reason"},
        {"53100", APC_EFULL, true, "the database refused it: it says no: for a reason"},
        {"53200", APC_ECONN, false, "the database server ended the connection: it says no: for a reason"},
        {"53300", APC_ECONN, false, "the database server ended the connection: it says no: for a reason"},
        {"08006", APC_ECONN, false, "the database server ended the connection: it says no: for a reason"},
        {"42703", APC_ESTORE, true, "has tables that are not libapc's (name another behind a #): it says no"},
        {"42P07", APC_ESTORE, true, "has tables that are not libapc's (name another behind a #): it says no"},
        {"22012", APC_ESTORE, true, "the database refused it: it says no: for a reason"},
        {"23514", APC_ESTORE, true, "the database refused it: it says no: for a reason"},
    };
    make_refusing();
    struct apc_store *store = open_direct(LONG);
    for (int i = 0; i < (int)(sizeof refusals / sizeof refusals[0]); i++) {
        char sql[100];
        snprintf(sql, sizeof sql, "INSERT INTO plant%d.code VALUES (%d, '%s')", plant, i,
                 refusals[i].sqlstate);
        cluster_query(cluster, sql);
        connect_again(store);
        struct apc_sample s = sample(APC_TUNING, 1, 1, i);
        assert_int_equal(apc_store_append(store, &s, 1), refusals[i].err);
        assert_says(store, refusals[i].says);
        assert_int_equal(apc_store_connected(store), refusals[i].stays);
        connect_again(store);
        assert_int_equal(apc_store_put(store, &s, 1), refusals[i].err);
        assert_says(store, refusals[i].says);
        connect_again(store);
        assert_int_equal(newest(store, APC_TUNING, 1).seq, 0);
    }
    apc_store_close(store);
}

static void test_a_race_that_is_always_lost_is_given_up_after_ten_tries(void **state)
{
    (void)state;
    static const char *const lost[] = {"40P01", "40001", "23505"};
    make_refusing();
    struct apc_store *store = open_direct(LONG);
    ok(store, apc_store_connect(store));
    for (int i = 0; i < 3; i++) {
        char sql[100];
        snprintf(sql, sizeof sql, "INSERT INTO plant%d.code VALUES (%d, '%s')", plant, i, lost[i]);
        cluster_query(cluster, sql);
        struct apc_sample s = sample(APC_TUNING, 1, 1, i);
        struct apc_store_stats before = {.size = sizeof before}, after = before;
        apc_store_stats(store, &before);
        assert_int_equal(apc_store_put(store, &s, 1), APC_ECONFLICT);
        apc_store_stats(store, &after);
        assert_int_equal(after.round_trips - before.round_trips, 10);
        assert_says(store, "it says no");
        assert_int_equal(apc_store_append(store, &s, 1), APC_ESTORE); /* nobody's value won */
        apc_store_stats(store, &before);
        assert_int_equal(before.round_trips - after.round_trips, 1 + 10);
        assert_says(store, "it says no");
        assert_true(apc_store_connected(store));
        assert_int_equal(newest(store, APC_TUNING, 1).seq, 0);
    }
    apc_store_close(store);
}

struct appender {
    struct apc_store *store;
    int64_t seq;
    int result;
};

/* Until one is not acknowledged: the server's processes take note of the standby one by one. */
static void *append_on(void *arg)
{
    struct appender *a = arg;
    a->result = 1;
    for (a->seq = 0; a->result == 1 && a->seq < 1000000;) {
        struct apc_sample s = sample(APC_SENSOR, 1, ++a->seq, 1);
        a->result = apc_store_append(a->store, &s, 1);
    }
    return NULL;
}

/* Promise(stores/postgresql-deadlines) */
static void test_a_commit_that_no_standby_has_is_not_acknowledged(void **state)
{
    (void)state;
    struct cluster *own = cluster_start_private();
    char uri[600];
    snprintf(uri, sizeof uri, "%s#p", cluster_uri(own));
    struct appender a = {.store = open_uri(uri, LONG)};
    assert_int_equal(apc_store_init(a.store), 0);
    ok(a.store, apc_store_connect(a.store));
    cluster_query(own, "SET synchronous_commit = local");
    assert_true(cluster_need_standby(own, "ghost"));
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, append_on, &a), 0);
    bool waits =
        cluster_await(own, "SELECT count(*) FROM pg_stat_activity WHERE wait_event = 'SyncRep'", "1");
    cluster_query(own, "SELECT pg_cancel_backend(pid) FROM pg_stat_activity WHERE wait_event = 'SyncRep'");
    pthread_join(thread, NULL);
    assert_true(waits);
    assert_int_equal(a.result, APC_ETIMEDOUT); /* unknown, as it is */
    assert_says(a.store, "standby");
    assert_int_equal(atoll(cluster_query(own, "SELECT max(seq) FROM p.sensor")),
                     a.seq); /* though it is there */
    apc_store_close(a.store);
    cluster_destroy(own);
}

/* ---- The server dies ---------------------------------------------------------------------------- */

/* Promise(stores/acknowledged-survives) */
static void test_after_kill_9_of_the_server_nothing_acknowledged_is_lost(void **state)
{
    (void)state;
    struct cluster *own = cluster_start_private();
    char uri[600];
    snprintf(uri, sizeof uri, "%s#p", cluster_uri(own));
    struct apc_store *store = open_uri(uri, LONG);
    assert_int_equal(apc_store_init(store), 0);
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    for (int64_t seq = 1; seq <= 20; seq++) {
        struct apc_sample s = sample(APC_SENSOR, 1, seq, (double)seq);
        if (seq == 11) {
            cluster_kill(own);
            assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN);
            cluster_run(own);
        }
        assert_int_equal(append_again(store, &s, 1), 1);
    }
    assert_string_equal(cluster_query(own, "SELECT count(*) || ' ' || max(seq) FROM p.sensor"), "20 20");
    struct apc_store *other = open_uri(uri, LONG);
    assert_int_equal(apc_store_claim(other, APC_SENSOR, 1, last), APC_EBUSY); /* the claim was renewed */
    apc_store_close(other);
    apc_store_close(store);
    cluster_destroy(own);
}

/* ---- A standby takes over ------------------------------------------------------------------------ */

/*
 * Promise(stores/postgresql-deadlines)
 * Promise(database/leader-killed-patroni)
 */
static void test_of_two_servers_the_primary_is_used_and_after_a_failover_the_other_one(void **state)
{
    (void)state;
    struct cluster *first = cluster_start_private(), *second = cluster_start_standby(first);
    assert_true(cluster_need_standby(first, "*"));
    assert_true(
        cluster_await(first, "SELECT count(*) FROM pg_stat_replication WHERE sync_state = 'sync'", "1"));
    char uri[700];
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s,%s#p", cluster_database(first),
             cluster_host(second), cluster_host(first));
    struct apc_store *store = open_uri(uri, LONG);
    assert_int_equal(apc_store_init(store), 0); /* not on the standby, though it comes first */
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    for (int64_t seq = 1; seq <= 40; seq++) {
        struct apc_sample s = sample(APC_SENSOR, 1, seq, (double)seq);
        if (seq == 21) {
            cluster_kill(first);
            assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN);
            assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN); /* the standby is none to write to */
            assert_says(store, "no server takes writes");
            cluster_query(second, "SELECT pg_promote(true, 60)");
            cluster_query(second, "ALTER SYSTEM RESET synchronous_standby_names");
            cluster_query(second, "SELECT pg_reload_conf()");
        }
        assert_int_equal(append_again(store, &s, 1), 1);
    }
    /* Nothing that was acknowledged is missing. */
    assert_string_equal(cluster_query(second, "SELECT count(*) || ' ' || max(seq) FROM p.sensor"), "40 40");
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 40);
    apc_store_close(store);
    cluster_destroy(second);
    cluster_destroy(first);
}

static void append_all(struct apc_store *store, int64_t from, int64_t to)
{
    for (int64_t seq = from; seq <= to; seq++) {
        struct apc_sample s = sample(APC_SENSOR, 1, seq, (double)seq);
        assert_int_equal(append_again(store, &s, 1), 1);
    }
}

/*
 * Promise(database): A program that has been at a promoted standby does not go back to the former leader,
 *   and says what to do with it.
 */
static void test_who_was_with_a_promoted_standby_goes_not_back_to_the_former_leader(void **state)
{
    (void)state;
    static const char rows[] = "SELECT count(*) || ' ' || max(seq) FROM p.sensor";
    struct cluster *first = cluster_start_private(), *second = cluster_start_standby(first);
    char uri[700];
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s,%s#p", cluster_database(first),
             cluster_host(first), cluster_host(second));
    struct apc_store *store = open_uri(uri, LONG);
    assert_int_equal(apc_store_init(store), 0);
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    append_all(store, 1, 10);
    assert_true(cluster_await(second, "SELECT count(*) FROM pg_class WHERE relname = 'sensor'", "1"));
    assert_true(cluster_await(second, rows, "10 10"));
    cluster_query(second, "SELECT pg_promote(true, 60)");
    append_all(store, 11, 20); /* who is with the first one stays there */
    assert_string_equal(cluster_query(first, rows), "20 20");

    cluster_kill(first);
    struct apc_sample s = sample(APC_SENSOR, 1, 21, 21);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN);
    append_all(store, 11, 20); /* what the new one has not got */
    assert_string_equal(cluster_query(second, rows), "20 20");

    cluster_run(first); /* and writes, as if nothing had been */
    cluster_stop(second);
    int refused = 0;
    for (int i = 0; i < 100000 && !refused; i++) {
        assert_int_equal(apc_store_append(store, &s, 1), APC_ECONN);
        refused = strstr(apc_store_error(store), "is a former leader") != NULL;
    }
    assert_true(refused);
    cluster_run(second);
    append_all(store, 21, 30);
    assert_string_equal(cluster_query(second, rows), "30 30");
    assert_string_equal(cluster_query(first, rows), "20 20");
    apc_store_close(store);

    /* A server that is named alone is taken as it is. */
    store = open_uri(cluster_uri(second), LONG);
    assert_int_equal(apc_store_init(store), 0);
    apc_store_close(store);
    cluster_destroy(second);
    cluster_destroy(first);
}

/* ---- Claims ------------------------------------------------------------------------------------- */

/* Promise(stores/postgresql-deadlines) */
static void test_a_dead_writers_claim_goes_to_the_next_and_the_dead_one_gets_it_not_back(void **state)
{
    (void)state;
    char uri[600];
    snprintf(uri, sizeof uri, "%s&application_name=first#plant%d", cluster_uri(cluster), plant);
    struct apc_store *first = open_uri(uri, LONG), *second = open_direct(LONG);
    int64_t last[1];
    ok(first, apc_store_claim(first, APC_ACTUATOR, 1, last));
    assert_int_equal(apc_store_claim(second, APC_ACTUATOR, 1, last), APC_EBUSY);
    assert_says(second, "already written by first (server process ");
    struct apc_sample s = sample(APC_ACTUATOR, 1, 1, 1);
    assert_int_equal(apc_store_append(first, &s, 1), 1);

    terminate(cluster, "first");
    ok(second, apc_store_claim(second, APC_ACTUATOR, 1, last));
    assert_int_equal(last[0], 1); /* and it knows where to go on */
    s.seq = 2;
    assert_int_equal(apc_store_append(first, &s, 1), APC_ECONN); /* finds its connection dead */
    assert_int_equal(apc_store_append(first, &s, 1), APC_EBUSY);
    assert_says(first, "already written by test");
    assert_int_equal(newest(second, APC_ACTUATOR, 1).seq, 1); /* two writers never took turns */

    apc_store_close(second);
    assert_int_equal(append_again(first, &s, 1), 1); /* free again */
    apc_store_close(first);
}

/* The process of the session that has a claim, when one has. */
static const char claimant[] = "SELECT l.pid FROM pg_locks l JOIN pg_class c ON c.oid = l.classid"
                               " WHERE l.locktype = 'advisory' AND c.relname = 'claim'";

static void test_a_stopped_former_session_is_waited_for_and_is_no_other_writer(void **state)
{
    (void)state;
    struct cluster *own = cluster_start_private();
    char uri[600];
    snprintf(uri, sizeof uri, "%s#p", cluster_uri(own));
    struct apc_store *store = open_uri(uri, APC_NS_PER_S), *other = open_uri(uri, LONG);
    assert_int_equal(apc_store_init(store), 0);
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    const pid_t pid = (pid_t)strtol(cluster_query(own, claimant), NULL, 10);
    assert_true(pid > 1);

    assert_int_equal(kill(pid, SIGSTOP), 0);
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    int stalled = apc_store_append(store, &s, 1), waiting = APC_ETIMEDOUT, told = 0;
    for (int i = 0; i < 1000 && told < 3 && (waiting == APC_ECONN || waiting == APC_ETIMEDOUT); i++) {
        waiting = apc_store_append(store, &s, 1);
        told += strstr(apc_store_error(store), "our former session (server process ") != NULL;
    }
    int taken = apc_store_claim(other, APC_SENSOR, 1, last);
    kill(pid, SIGCONT); /* before any assertion: the server cannot be stopped without it */

    assert_int_equal(stalled, APC_ETIMEDOUT);
    assert_int_equal(waiting, APC_ECONN);
    assert_int_equal(told, 3);
    assert_int_equal(taken, APC_EBUSY); /* for another store it is another writer */
    assert_true(append_again(store, &s, 1) >= 0);
    assert_string_equal(cluster_query(own, "SELECT count(*) FROM p.sensor"), "1");
    assert_int_not_equal(strtol(cluster_query(own, claimant), NULL, 10), pid);
    assert_int_equal(apc_store_claim(other, APC_SENSOR, 1, last), APC_EBUSY); /* renewed */
    apc_store_close(other);
    apc_store_close(store);
    cluster_destroy(own);
}

static void test_a_former_session_behind_a_half_open_connection_is_ended(void **state)
{
    (void)state;
    char directory[256], uri[900], sql[200];
    struct proxy *proxy = new_proxy(directory);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s,%s#plant%d", cluster_database(cluster), directory,
             cluster_host(cluster), plant);
    struct apc_store *store = open_uri(uri, APC_NS_PER_S);
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    proxy_set(proxy, PROXY_STALL); /* for good: the server never learns that the client has gone */
    struct apc_sample s = sample(APC_SENSOR, 1, 1, 1);
    assert_int_equal(apc_store_append(store, &s, 1), APC_ETIMEDOUT);
    int result = APC_ECONN; /* then by the other way */
    for (int i = 0; i < 1000 && (result == APC_ECONN || result == APC_ETIMEDOUT); i++) {
        result = apc_store_append(store, &s, 1);
    }
    assert_int_equal(result, 1);
    snprintf(sql, sizeof sql,
             "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'test' AND datname = '%s'",
             cluster_database(cluster));
    assert_true(cluster_await(cluster, sql, "1"));
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

/* ---- URIs, secrets, injection --------------------------------------------------------------------- */

static void test_uris_that_cannot_be_are_refused_when_opening(void **state)
{
    (void)state;
    const char *const bad[] = {"",
                               "postgresql",
                               "mysql://x",
                               "postgresql:db",
                               "postgresql:/x",
                               "postgresql:#",
                               "postgresql:#9lives",
                               "postgresql:#Apc",
                               "postgresql:#a-b",
                               "postgresql:#a;drop",
                               "postgresql:#a\"b",
                               "postgresql:#aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
                               "postgresql://host:port/db?nonsense",
                               "postgresql://host/db?no_such_option=1"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct apc_store *store = (struct apc_store *)&plant;
        struct apc_error why = {""};
        assert_int_equal(apc_store_open(&store, bad[i], NULL, &why), APC_EINVAL);
        assert_null(store);
        assert_true(why.text[0] != '\0');
    }
    struct apc_store *store = NULL;
    assert_int_equal(apc_store_open(&store, NULL, NULL, NULL), APC_EINVAL);
    const char *const good[] = {"postgresql:", "postgres:", "postgresql:#plant_2", "postgres://h/d#user",
                                "postgresql://u@h1:1,h2:2/d?target_session_attrs=any#p"};
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(apc_store_open(&store, good[i], NULL, NULL), 0);
        assert_false(apc_store_connected(store));
        apc_store_close(store);
    }
}

static void test_a_schema_may_be_named_like_a_word_of_sql(void **state)
{
    (void)state;
    char uri[600];
    snprintf(uri, sizeof uri, "%s#select", cluster_uri(cluster));
    struct apc_store *store = open_uri(uri, LONG);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 0);
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    apc_store_close(store);
}

/* The vector ends where a page does that nobody may touch. */
static void test_rows_of_a_table_that_has_none_are_refused_and_no_other_is_looked_at(void **state)
{
    (void)state;
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    char *const pages = mmap(NULL, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_true(pages != MAP_FAILED);
    assert_int_equal(mprotect(pages + page, page, PROT_NONE), 0);
    struct apc_vector *const vector = (struct apc_vector *)(void *)(pages + page) - 1;
    *vector = (struct apc_vector){.table = APC_TICK, .id = 1};
    enum { MANY = 200 };
    struct apc_sample sample[MANY];
    for (int i = 0; i < MANY; i++)
        sample[i] = (struct apc_sample){.table = i < MANY - 1 ? APC_SETPOINT : APC_SENSOR, .id = i + 1};
    struct apc_store *store = open_direct(LONG);
    ok(store, apc_store_read(store, sample, MANY));
    sample[1] = (struct apc_sample){.table = APC_STATE};
    struct apc_rows rows = {
        .size = sizeof rows, .sample = sample, .n_samples = 2, .vector = vector, .n_vectors = 1};
    assert_int_equal(apc_store_read_rows(store, &rows), APC_ESCHEMA);
    assert_string_equal(apc_store_error(store), "there is no table state");
    rows.n_samples = 1;
    ok(store, apc_store_read_rows(store, &rows));
    apc_store_close(store);
    munmap(pages, 2 * page);
}

static void test_postgresql_alone_means_the_environments_database(void **state)
{
    (void)state;
    char uri[64], *saved[3] = {NULL, NULL, NULL};
    const char *const name[3] = {"PGHOST", "PGUSER", "PGDATABASE"};
    const char *const value[3] = {cluster_host(cluster), "apc", cluster_database(cluster)};
    for (int i = 0; i < 3; i++) {
        saved[i] = getenv(name[i]) ? strdup(getenv(name[i])) : NULL;
        setenv(name[i], value[i], 1);
    }
    snprintf(uri, sizeof uri, "postgresql:#plant%d", plant);
    struct apc_store *store = open_uri(uri, LONG);
    int err = apc_store_connect(store);
    for (int i = 0; i < 3; i++) {
        if (saved[i]) {
            setenv(name[i], saved[i], 1);
        } else {
            unsetenv(name[i]);
        }
        free(saved[i]);
    }
    ok(store, err);
    apc_store_close(store);
}

/* Promise(stores/password-shown): No password is shown. */
static void test_a_password_is_never_shown(void **state)
{
    (void)state;
    const char *const bad[] = {"postgresql://u:s3cr3t@h:x%zz/d", "postgresql://u:s3cr3t%zz@h/d",
                               "s3cr3t@postgres", "postgresql://h/d?password=s3cr3t&x"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct apc_error why = {""};
        struct apc_store *store;
        assert_int_equal(apc_store_open(&store, bad[i], NULL, &why), APC_EINVAL);
        assert_null(strstr(why.text, "s3cr3t"));
    }
    /* libpq's error names the socket's directory, here also the password. */
    struct apc_store *store = open_uri("postgresql://apc:s3cr3t@/d?host=/nonexistent/s3cr3t", LONG);
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    assert_says(store, "/nonexistent/***");
    assert_null(strstr(apc_store_error(store), "s3cr3t"));
    apc_store_close(store);
}

static void test_text_never_becomes_sql(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    char text[100];
    snprintf(text, sizeof text, "'); DROP TABLE plant%d.sensor; --", plant);
    struct apc_event e = {.severity = APC_EVENT_INFO, .kind = "operator"};
    snprintf(e.text, sizeof e.text, "%s", text);
    ok(store, apc_store_append_events(store, &e, 1));
    struct apc_tag t = {.table = APC_SENSOR, .id = 1, .high = 1};
    snprintf(t.name, sizeof t.name, "%.60s", text);
    ok(store, apc_store_put_tags(store, &t, 1));
    char sql[100];
    snprintf(sql, sizeof sql, "SELECT count(*) FROM plant%d.sensor", plant);
    assert_string_equal(cluster_query(cluster, sql), "0");
    snprintf(sql, sizeof sql, "SELECT text FROM plant%d.event", plant);
    assert_string_equal(cluster_query(cluster, sql), text);
    apc_store_close(store);
}

/* ---- Much data ------------------------------------------------------------------------------------ */

/* The largest message that libpq ever has to hold tells whether memory is bounded: watch it at the proxy. */
struct flood {
    struct proxy *proxy;
    uint64_t trips;
    int count, in_order;
};

static int watch(void *ctx, const struct apc_sample *s)
{
    struct flood *f = ctx;
    f->in_order += s->seq == ++f->count;
    return 0;
}

static void test_a_long_history_streams_in_pieces(void **state)
{
    (void)state;
    char directory[256], sql[200];
    snprintf(sql, sizeof sql,
             "INSERT INTO plant%d.sensor SELECT 1, s, 'epoch'::timestamptz + s * interval '1 us', 0, s "
             "FROM generate_series(1, 100000) s",
             plant);
    cluster_query(cluster, sql);
    struct proxy *proxy = new_proxy(directory);
    struct apc_store *store = open_through(directory, LONG);
    ok(store, apc_store_connect(store));
    struct flood f = {.proxy = proxy};
    uint64_t trips = proxy_round_trips(proxy);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, watch, &f), 100000);
    assert_int_equal(f.in_order, 100000);
    /* At most 512 rows were under way at any time: each round trip asked for the next ones. */
    assert_in_range(proxy_round_trips(proxy) - trips, 100000 / 512, 100000 / 512 + 3);
    apc_store_close(store);
    proxy_stop(proxy);
    rmdir(directory);
}

/* ---- Whatever the server's defaults are ----------------------------------------------------------- */

/* What the sessions of this database have, unless they say otherwise; and what a store's sessions need. */
static const struct {
    const char *name, *by_default, *needed;
} settings[] = {
    {"default_transaction_isolation", "serializable", "read committed"},
    {"default_transaction_deferrable", "on", "off"},
    {"statement_timeout", "'1h'", "0"},
    {"lock_timeout", "'1ms'", "0"},
    {"idle_in_transaction_session_timeout", "'1h'", "0"},
    {"idle_session_timeout", "'1h'", "0"},
    {"search_path", "nowhere", NULL},
    {"\"DateStyle\"", "'SQL, DMY'", "ISO, YMD"},
    {"\"IntervalStyle\"", "sql_standard", "postgres"},
    {"\"TimeZone\"", "'Asia/Kolkata'", "UTC"},
    {"extra_float_digits", "-15", "1"},
    {"bytea_output", "escape", "hex"},
    {"standard_conforming_strings", "off", "on"},
    {"escape_string_warning", "off", NULL},
    {"client_encoding", "latin1", "UTF8"},
    {"row_security", "off", "on"},
    {"client_min_messages", "error", "warning"},
};
#define N_SETTINGS (sizeof settings / sizeof settings[0])

static void alter_database(const char *name, const char *value)
{
    char sql[300];
    snprintf(sql, sizeof sql, "ALTER DATABASE %s %s %s%s%s", cluster_database(cluster),
             value ? "SET" : "RESET", name, value ? " TO " : "", value ? value : "");
    cluster_query(cluster, sql);
}

static int reset_database(void **state)
{
    (void)state;
    alter_database("ALL", NULL);
    return 0;
}

struct appending {
    struct apc_store *store;
    struct apc_sample sample;
    int result;
};

static void *append_one(void *arg)
{
    struct appending *a = arg;
    a->result = apc_store_append(a->store, &a->sample, 1);
    return NULL;
}

/* A writer that is behind another's open transaction waits for it, and then goes on. */
static void append_behind(struct apc_store *store)
{
    PGconn *other = cluster_connect(cluster);
    char sql[200];
    snprintf(sql, sizeof sql, "BEGIN; UPDATE plant%d.sensor_newest SET value = value WHERE id = 1", plant);
    PQclear(PQexec(other, sql));
    struct appending a = {.store = store, .sample = sample(APC_SENSOR, 1, 2, 2)};
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, append_one, &a), 0);
    const bool waits = cluster_await(cluster,
                                     "SELECT count(*) > 0 FROM pg_stat_activity WHERE wait_event_type = "
                                     "'Lock' AND datname = current_database()",
                                     "t");
    PQclear(PQexec(other, "COMMIT"));
    PQfinish(other);
    pthread_join(thread, NULL);
    assert_true(waits);
    assert_int_equal(a.result, 1);
}

/*
 * Promise(database/defaults-server-database): Defaults of a server, database or role change nothing for a
 *   store: isolation, time-outs, formats, time zone; the paper's functions try again what the server wants
 *   again; a database that is read-only by default is named as such.
 */
static void test_a_session_has_what_the_store_relies_on_whatever_the_defaults_are(void **state)
{
    char sql[800];
    for (size_t i = 0; i < N_SETTINGS; i++) {
        alter_database(settings[i].name, settings[i].by_default);
    }
    assert_int_equal(set_up(state), 0); /* the tables are made under them as well */
    snprintf(
        sql, sizeof sql,
        "SET search_path TO plant%d; CREATE TABLE seen (name text, setting text);"
        "CREATE FUNCTION see() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN INSERT INTO seen SELECT name, "
        "current_setting(name) FROM pg_settings; RETURN NEW; END $$;"
        "CREATE TRIGGER see BEFORE INSERT ON event FOR EACH ROW EXECUTE FUNCTION see()",
        plant);
    cluster_query(cluster, sql);
    struct apc_store *store = open_direct(LONG);
    const struct apc_event event = {
        .time = apc_clock_utc(NULL), .severity = APC_EVENT_INFO, .source = "t", .kind = "start", .text = "t"};
    assert_int_equal(apc_store_append_events(store, &event, 1), 1);
    for (size_t i = 0; i < N_SETTINGS; i++) {
        snprintf(sql, sizeof sql, "SELECT max(setting) FROM plant%d.seen WHERE name = btrim('%s', '\"')",
                 plant, settings[i].name);
        if (settings[i].needed) {
            assert_string_equal(cluster_query(cluster, sql), settings[i].needed);
        }
    }
    int64_t last[1];
    ok(store, apc_store_claim(store, APC_SENSOR, 1, last));
    const struct apc_sample first = sample(APC_SENSOR, 1, 1, 0.1);
    assert_int_equal(apc_store_append(store, &first, 1), 1);
    assert_true(newest(store, APC_SENSOR, 1).value == 0.1);
    append_behind(store);
    ok(store, apc_store_maintain(store, &(struct apc_retention){.size = sizeof(struct apc_retention)}));
    snprintf(
        sql, sizeof sql,
        "SELECT count(*) FROM pg_inherits JOIN pg_class c ON c.oid = inhrelid WHERE inhparent = "
        "'plant%d.sensor'::regclass AND c.relname ~ '[0-9]{8}$' AND pg_get_expr(c.relpartbound, c.oid) !~ "
        "('FROM ..' || to_char(to_date(right(c.relname, 8), 'YYYYMMDD'), 'YYYY-MM-DD') || ' 00:00:00')",
        plant);
    PGconn *plain = cluster_connect(cluster);
    PQclear(
        PQexec(plain, "SET TimeZone TO 'UTC'; SET DateStyle TO ISO; SET standard_conforming_strings TO on"));
    PGresult *wrong = PQexec(plain, sql);
    assert_string_equal(PQgetvalue(wrong, 0, 0), "0"); /* weeks that are not those of their names */
    PQclear(wrong);
    PQfinish(plain);
    apc_store_close(store);
}

/* Promise(database/defaults-server-database) */
static void test_a_database_that_is_for_reading_only_by_default_is_named_as_such(void **state)
{
    (void)state;
    alter_database("default_transaction_read_only", "on");
    struct apc_store *store = open_direct(LONG);
    assert_int_equal(apc_store_connect(store), APC_ECONN);
    assert_says(store, "default_transaction_read_only is on");
    apc_store_close(store);
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_rows_of_a_table_that_has_none_are_refused_and_no_other_is_looked_at),
        T(test_a_tick_reads_in_one_round_trip_and_writes_in_one),
        T(test_a_stalled_server_costs_the_timeout_and_the_next_call_works),
        T(test_a_write_that_the_server_does_not_take_ends_at_the_timeout),
        T(test_a_lost_answer_to_commit_is_retried_without_a_duplicate),
        T(test_an_answer_cut_anywhere_is_an_error_and_never_half_a_result),
        T(test_after_a_failed_connect_it_answers_at_once_until_the_pause_is_over),
        T(test_the_pauses_of_many_clients_are_not_the_same),
        T(test_the_pauses_grow_up_to_the_longest),
        T(test_a_server_that_did_not_answer_is_not_there_until_the_pause_is_over),
        T(test_an_unreachable_server_is_named),
        T(test_of_several_hosts_the_next_is_tried_when_one_swallows_packets),
        T(test_hosts_of_a_service_file_take_turns_as_well),
        T(test_only_a_host_that_can_be_written_to_is_used),
        T(test_a_server_that_became_read_only_is_left),
        T(test_a_commit_refused_at_its_very_end_is_not_acknowledged),
        T(test_each_refusal_of_the_server_is_told_apart),
        T(test_a_race_that_is_always_lost_is_given_up_after_ten_tries),
        T(test_a_commit_that_no_standby_has_is_not_acknowledged),
        T(test_after_kill_9_of_the_server_nothing_acknowledged_is_lost),
        T(test_of_two_servers_the_primary_is_used_and_after_a_failover_the_other_one),
        T(test_who_was_with_a_promoted_standby_goes_not_back_to_the_former_leader),
        T(test_a_dead_writers_claim_goes_to_the_next_and_the_dead_one_gets_it_not_back),
        T(test_a_stopped_former_session_is_waited_for_and_is_no_other_writer),
        T(test_a_former_session_behind_a_half_open_connection_is_ended),
        T(test_uris_that_cannot_be_are_refused_when_opening),
        T(test_a_schema_may_be_named_like_a_word_of_sql),
        T(test_postgresql_alone_means_the_environments_database),
        T(test_a_password_is_never_shown),
        T(test_text_never_becomes_sql),
        T(test_a_long_history_streams_in_pieces),
        cmocka_unit_test_teardown(test_a_session_has_what_the_store_relies_on_whatever_the_defaults_are,
                                  reset_database),
        cmocka_unit_test_setup_teardown(test_a_database_that_is_for_reading_only_by_default_is_named_as_such,
                                        set_up, reset_database),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
