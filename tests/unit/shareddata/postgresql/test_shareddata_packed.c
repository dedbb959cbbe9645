/* SPDX-License-Identifier: BSD-3-Clause */
/* Packed weeks of the PostgreSQL store: the same history, in less room, whatever happens meanwhile. */
#include <pthread.h>

#include "packed_rig.h"

#define WEEK (7 * 24 * 3600 * APC_NS_PER_S)

static void assert_same(const struct list *a, const struct list *b, const char *what, size_t v)
{
    bool same = a->n == b->n;
    for (size_t i = 0; i < a->n && same; i++) {
        const struct apc_sample *x = &a->at[i], *y = &b->at[i];
        same = x->seq == y->seq && x->time == y->time && x->status == y->status && x->origin == y->origin &&
               x->author == y->author && memcmp(&x->value, &y->value, sizeof x->value) == 0 &&
               x->id == y->id && x->table == y->table;
    }
    if (!same) {
        fail_msg("%s: the history of variable %zu differs: %zu and %zu rows", what, v, a->n, b->n);
    }
}

struct record {
    struct list of[VARIABLES];
};

static struct record record(struct apc_store *store)
{
    struct record r;
    for (size_t v = 0; v < VARIABLES; v++) {
        r.of[v] = history(store, v, NULL, 0);
    }
    return r;
}

static void free_record(struct record *r)
{
    for (size_t v = 0; v < VARIABLES; v++) {
        free(r->of[v].at);
    }
}

static void assert_recorded(struct apc_store *store, const struct record *r, const char *what)
{
    for (size_t v = 0; v < VARIABLES; v++) {
        struct list now = history(store, v, NULL, 0);
        assert_same(&r->of[v], &now, what, v);
        free(now.at);
    }
}

#define ROWS                                                                                                 \
    "SELECT md5(string_agg(concat_ws(' ', id, seq, extract(epoch FROM time), status, float8send(value), "    \
    "origin,"

/* ---- The same history ------------------------------------------------------------------------------- */

/*
 * Promise(database/packed-weeks-history): Packed weeks are the same history, whole, in part, in bins and in
 *   the views.
 */
static void test_packed_weeks_are_the_same_history(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    struct record before = record(store);
    assert_int_equal(before.of[0].n, 9000);
    const int packed = pack(store);
    ok(store, packed);
    assert_int_equal(packed, 20); /* four weeks of five tables */
    assert_string_equal(ask("SELECT count(*) FROM packable(now())"), "0");
    assert_string_equal(
        ask("SELECT count(*) FROM sensor WHERE time < at(0) AND tableoid <> 'sensor_rest'::regclass"), "0");
    assert_string_equal(ask("SELECT sum(last - first + 1) > 20 * count(*) FROM sensor_packed"), "t");
    assert_recorded(store, &before, "packed");
    assert_int_equal(pack(store), 0);
    assert_recorded(store, &before, "packed twice");
    assert_string_equal(
        ask("SELECT count(*) FROM event WHERE source = 'apc maintain' AND text LIKE '% packed: %'"), "20");
    assert_int_equal(newest(store, APC_SENSOR, 7).seq, 77);
    free_record(&before);
    apc_store_close(store);
}

/* Promise(database/packed-weeks-history) */
static void test_views_show_packed_rows_bit_for_bit(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    char sensors[40], actuators[40], setpoints[40];
    snprintf(sensors, sizeof sensors, "%s", ask(ROWS " author), ';' ORDER BY id, seq)) FROM sensor"));
    snprintf(
        actuators, sizeof actuators, "%s",
        ask(ROWS
            " coalesce(sensor_seq, -1), coalesce(setpoint_seq, -1)), ';' ORDER BY id, seq)) FROM actuator"));
    snprintf(setpoints, sizeof setpoints, "%s",
             ask(ROWS " coalesce(author, -1)), ';' ORDER BY id, seq)) FROM setpoint"));
    ok(store, pack(store));
    assert_string_equal(ask(ROWS " author), ';' ORDER BY id, seq)) FROM sensor_all"), sensors);
    assert_string_equal(ask(ROWS " coalesce(sensor_seq, -1), coalesce(setpoint_seq, -1)), ';' ORDER BY id, "
                                 "seq)) FROM actuator_all"),
                        actuators);
    assert_string_equal(ask(ROWS " coalesce(author, -1)), ';' ORDER BY id, seq)) FROM setpoint_all"),
                        setpoints);
    apc_store_close(store);
}

/* ---- Trends, for people and their tools ------------------------------------------------------------- */

static void name_signals(void)
{
    ask("INSERT INTO tag (table_name, id, name) VALUES ('sensor', 1, 'noise'), ('sensor', 3, 'bad'), "
        "('sensor', "
        "5, 'stepped'), ('setpoint', 1, 'noise'), ('estimate', 1, 'twice'), ('actual', 1, 'twice')");
}

/* What a trend has to give, of table sensor_all; and what it gives. */
#define GIVEN                                                                                                \
    "SELECT count(*) || ' ' || md5(string_agg(concat_ws(' ', seq, extract(epoch FROM time), status, CASE "   \
    "WHEN status < 2147483648 THEN encode(float8send(value), 'hex') END), ';' ORDER BY seq)) FROM "

static void assert_trends_are_the_rows(const char *what)
{
    static const struct {
        const char *signal, *since, *until;
        int id;
    } asked[] = {{"noise", "at(3) + interval '1 hour'", "at(3) + interval '2 days'", 1},
                 {"sensor.1", "at(4)", "now()", 1},
                 {"bad", "at(2.5)", "at(2.4)", 3},
                 {"stepped", "at(3.9)", "at(3.6)", 5},
                 {"stepped", "at(0)", "at(1)", 5}};
    for (size_t i = 0; i < sizeof asked / sizeof asked[0]; i++) {
        char sql[700], want[100];
        snprintf(sql, sizeof sql, GIVEN "sensor_all WHERE id = %d AND time >= %s AND time < %s", asked[i].id,
                 asked[i].since, asked[i].until);
        snprintf(want, sizeof want, "%s", ask(sql));
        snprintf(sql, sizeof sql, GIVEN "trend(%s, %s, '%s')", asked[i].since, asked[i].until,
                 asked[i].signal);
        if (strcmp(ask(sql), want) != 0) {
            fail_msg("%s: trend %zu gives \"%s\", wanted \"%s\"", what, i, ask(sql), want);
        }
    }
    assert_string_equal(
        ask("SELECT count(*) FROM trend(at(2.5), at(2.4), 'bad') WHERE value IS NULL AND status "
            ">= 2147483648"),
        ask("SELECT count(*) FROM sensor_all WHERE id = 3 AND time >= at(2.5) AND time < at(2.4)"
            " AND status >= 2147483648"));
}

/* A chunk whose data are spoiled is one that must not be read. */
/*
 * Promise(database/trend-gives-rows): `trend()` gives the rows of a time by name, and reads the chunks of
 *   that time only; `trend_bins()` sums them up exactly and unpacks no chunk that is short; who only looks
 *   writes nothing.
 */
static void test_a_trend_is_the_rows_and_reads_the_chunks_of_its_time_only(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    name_signals();
    assert_trends_are_the_rows("rows");
    ok(store, pack(store));
    assert_trends_are_the_rows("packed");
    char want[100];
    snprintf(want, sizeof want, "%s", ask(GIVEN "trend(at(2.7), at(2.5), 'noise')"));
    ask("UPDATE sensor_packed SET data = '\\x09' WHERE id = 1 AND NOT (until >= at(2.7) AND since < "
        "at(2.5))");
    assert_string_equal(
        ask("SELECT count(*) BETWEEN 1 AND 3 FROM sensor_packed WHERE id = 1 AND length(data) > 1"), "t");
    assert_string_equal(ask(GIVEN "trend(at(2.7), at(2.5), 'noise')"), want);
    apc_store_close(store);
}

#define SUMS(signal)                                                                                         \
    "SELECT concat_ws(' ', sum(samples), sum(bad), min(lowest), max(highest), min(time), max(till), "        \
    "count(*) <= 20) FROM trend_bins(at(4), now(), 20, '" signal "')"

/* Promise(database/trend-gives-rows) */
static void test_a_trend_in_bins_is_the_rows_and_reads_no_chunk_that_is_short(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    char noise[200], bad[200];
    make_history();
    name_signals();
    snprintf(noise, sizeof noise, "%s", ask(SUMS("noise")));
    snprintf(bad, sizeof bad, "%s", ask(SUMS("bad")));
    ok(store, pack(store));
    assert_string_equal(ask(SUMS("noise")), noise);
    assert_string_equal(ask(SUMS("bad")), bad);
    /* Each row is exact for the time that it names. */
    assert_string_equal(
        ask("SELECT count(*) > 5 AND bool_and(b.samples = r.n AND b.bad = r.bad AND b.lowest = r.lowest AND "
            "b.highest = r.highest AND abs(b.mean - r.mean) <= 1e-12 * greatest(abs(r.lowest), "
            "abs(r.highest))) "
            "FROM trend_bins(at(4), now(), 20, 'noise') AS b CROSS JOIN LATERAL (SELECT count(*) AS n, "
            "count(*) "
            "FILTER (WHERE status >= 2147483648) AS bad, min(value) AS lowest, max(value) AS highest, "
            "avg(value) "
            "AS mean FROM sensor_all WHERE id = 1 AND time BETWEEN b.time AND b.till) AS r"),
        "t");
    ask("UPDATE sensor_packed SET data = '\\x09' WHERE since >= at(4) AND until - since < (now() - at(4)) / "
        "5");
    assert_string_equal(ask("SELECT count(*) > 20 FROM sensor_packed WHERE length(data) = 1"), "t");
    assert_string_equal(ask(SUMS("noise")), noise);
    assert_string_equal(ask(SUMS("bad")), bad);
    apc_store_close(store);
}

static void refused(const char *call, const char *state)
{
    char sql[400];
    snprintf(sql, sizeof sql,
             "DO $$ BEGIN PERFORM FROM %s; ASSERT false, 'it was given'; EXCEPTION WHEN %s THEN NULL; END $$",
             call, state);
    ask(sql);
}

/* Promise(database/trend-gives-rows) */
static void test_a_signal_of_a_trend_is_named_as_for_apc_history(void **state)
{
    (void)state;
    name_signals();
    ask("INSERT INTO tag (table_name, id, name, controller) VALUES ('opmode', 1, 'noise', 'c')");
    assert_string_equal(ask("SELECT target || variable FROM signal_called('noise')"), "sensor1");
    assert_string_equal(ask("SELECT target || variable FROM signal_called('setpoint.1')"), "setpoint1");
    assert_string_equal(ask("SELECT target || variable FROM signal_called('noise.mode')"), "opmode1");
    assert_string_equal(ask("SELECT target || variable FROM signal_called('actual.1')"), "actual1");
    refused("trend(now(), now(), 'nothing')", "undefined_object");
    refused("trend(now(), now(), 'noise', 'twice')", "undefined_object");
    refused("trend(now(), now(), NULL)", "undefined_object OR null_value_not_allowed");
    refused("trend_bins(now(), now(), 5, 'noise')", "invalid_parameter_value");
    refused("trend_bins('-infinity', now(), 5, 'noise')", "invalid_parameter_value");
    refused("trend_bins(now() - interval '1 day', now(), 0, 'noise')", "invalid_parameter_value");
}

static struct apc_range some_range(const struct list *l, unsigned round)
{
    static uint32_t x = 12345;
    struct apc_range r = {0};
    uint64_t draw[4];
    for (size_t i = 0; i < 4; i++) {
        x = x * 1664525U + 1013904223U;
        draw[i] = x >> 8;
    }
    if (round & 1) {
        r.since = l->at[draw[0] % l->n].time - (apc_ns)(draw[3] % 3);
    }
    if (round & 2) {
        r.until = l->at[draw[1] % l->n].time + (apc_ns)(draw[3] % 3);
    }
    if (round & 4) {
        r.last = 1 + draw[2] % 1500;
    }
    if (round & 8) {
        r.after = l->at[draw[3] % l->n].seq;
    }
    return r;
}

/* Promise(database/packed-weeks-history) */
static void test_parts_of_a_packed_history_are_those_of_the_rows(void **state)
{
    (void)state;
    enum { ROUNDS = 32 };
    static struct list want[VARIABLES][ROUNDS];
    static struct apc_range range[VARIABLES][ROUNDS];
    struct apc_store *store = open_direct(LONG);
    make_history();
    for (size_t v = 0; v < VARIABLES; v++) {
        struct list whole = history(store, v, NULL, 0);
        for (unsigned k = 0; k < ROUNDS; k++) {
            range[v][k] = some_range(&whole, k);
            want[v][k] = history(store, v, &range[v][k], k >= 16 ? 100 : 0);
        }
        free(whole.at);
    }
    ok(store, pack(store));
    for (size_t v = 0; v < VARIABLES; v++) {
        for (unsigned k = 0; k < ROUNDS; k++) {
            struct list now = history(store, v, &range[v][k], k >= 16 ? 100 : 0);
            assert_same(&want[v][k], &now, "a part", v);
            free(now.at);
            free(want[v][k].at);
        }
    }
    apc_store_close(store);
}

enum { BINS = 70 };

struct bins {
    struct apc_history_bin at[BINS];
    size_t n;
};

static int add_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct bins *b = ctx;
    b->at[b->n++] = *bin;
    return 0;
}

/* Promise(database/packed-weeks-history) */
static void test_bins_of_a_packed_history_are_those_of_the_rows(void **state)
{
    (void)state;
    static struct bins want[VARIABLES][3], now;
    struct apc_store *store = open_direct(LONG);
    make_history();
    const apc_ns end = apc_clock_utc(NULL),
                 begin[3] = {end - 5 * WEEK, end - 3 * WEEK - 12345, end - 40 * WEEK};
    static const size_t n[3] = {BINS, 7, 1};
    for (int packed = 0; packed < 2; packed++) {
        for (size_t v = 0; v < VARIABLES; v++) {
            for (size_t k = 0; k < 3; k++) {
                struct bins *b = packed ? &now : &want[v][k];
                b->n = 0;
                ok(store,
                   apc_store_history_bins(store, all[v].table, all[v].id, begin[k], end, n[k], add_bin, b));
                assert_true(!packed || b->n == want[v][k].n);
                for (size_t i = 0; packed && i < b->n; i++) {
                    struct apc_history_bin *x = &want[v][k].at[i], *y = &b->at[i];
                    assert_near(y->mean, x->mean, 1e-12 * fmax(fabs(x->min), fabs(x->max)));
                    y->mean = x->mean;
                    assert_memory_equal(x, y, sizeof *x);
                }
            }
        }
        if (!packed) {
            ok(store, pack(store));
        }
    }
    apc_store_close(store);
}

/* The rows behind the one that failed are still on their way then. */
/* Promise(database): A chunk that is damaged is said, and what is asked next is answered. */
static void test_a_damaged_chunk_is_told_and_what_is_asked_next_is_answered(void **state)
{
    (void)state;
    static struct bins before, now;
    struct apc_store *store = open_direct(LONG);
    make_history();
    ok(store, pack(store));
    const apc_ns end = apc_clock_utc(NULL), begin = end - 5 * WEEK;
    ok(store, apc_store_history_bins(store, APC_SENSOR, 2, begin, end, BINS, add_bin, &before));
    ask("UPDATE sensor_packed SET data = substr(data, 1, 40) WHERE id = 1");
    assert_int_equal(apc_store_history_bins(store, APC_SENSOR, 1, begin, end, BINS, add_bin, &now),
                     APC_ESTORE);
    assert_int_equal(now.n, 0);
    assert_non_null(strstr(apc_store_error(store), "is damaged"));
    ok(store, apc_store_history_bins(store, APC_SENSOR, 2, begin, end, BINS, add_bin, &now));
    assert_memory_equal(&now, &before, sizeof now);
    apc_store_close(store);
}

/* ---- What comes late -------------------------------------------------------------------------------- */

/*
 * Promise(database/comes-late-two): What comes late, two maintainers, a kill: each sample once, a week
 *   packed or as it was.
 */
static void test_a_packed_seq_is_taken_and_a_free_one_is_not(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    ok(store, pack(store));
    struct list whole = history(store, 1, NULL, 0);
    struct apc_sample again = whole.at[1500], free_seq = again;
    again.value = 1;
    assert_int_equal(apc_store_append(store, &again, 1), 0); /* it is there already */
    PGconn *by_hand = cluster_connect(cluster);
    char sql[200];
    snprintf(sql, sizeof sql,
             "INSERT INTO plant%d.sensor (id, seq, time, status, value) VALUES (2, %lld, now(), 0, 1)", plant,
             (long long)again.seq);
    PGresult *result = PQexec(by_hand, sql);
    assert_string_equal(PQresultErrorField(result, PG_DIAG_SQLSTATE), "23505");
    PQclear(result);
    PQfinish(by_hand);
    size_t gap = 1;
    while (whole.at[gap].seq == whole.at[gap - 1].seq + 1 || whole.at[gap].seq < 2100) {
        gap++;
    }
    free_seq.seq = whole.at[gap].seq - 1; /* of a packed week, and later than what is in it */
    assert_int_equal(apc_store_append(store, &free_seq, 1), 1);
    assert_int_equal(apc_store_append(store, &free_seq, 1), 0);
    struct list now = history(store, 1, NULL, 0);
    assert_int_equal(now.n, whole.n + 1);
    assert_int_equal(now.at[gap].seq, free_seq.seq);
    assert_int_equal(now.at[gap].time, free_seq.time);
    ok(store, pack(store));
    free(now.at);
    free(whole.at);
    apc_store_close(store);
}

/* Promise(database/comes-late-two) */
static void test_a_week_that_is_written_to_while_it_is_packed_stays_as_it_is(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    const char *week = "(SELECT partition FROM packable(now()) WHERE target = 'sensor' LIMIT 1)";
    char sql[400];
    snprintf(sql, sizeof sql, "SELECT pack_begin(%s)", week);
    ask(sql);
    ask("INSERT INTO sensor (id, seq, time, status, value) VALUES (9, 1, at(3.9), 0, 9)");
    snprintf(sql, sizeof sql,
             "DO $$ BEGIN PERFORM pack_end('sensor', %s, '{}', '{}', '{}'); RAISE 'packed';"
             " EXCEPTION WHEN serialization_failure THEN NULL; END $$",
             week);
    ask(sql);
    assert_string_equal(ask("SELECT count(*) FROM late"), "1");
    struct record before = record(store);
    assert_int_equal(pack(store), 20); /* begins anew */
    assert_recorded(store, &before, "packed after all");
    assert_string_equal(ask("SELECT count(*) FROM sensor WHERE id = 9"), "1");
    free_record(&before);
    apc_store_close(store);
}

/* ---- Others meanwhile ------------------------------------------------------------------------------- */

struct maintainer {
    struct apc_store *store;
    int result;
};

static void *maintain(void *arg)
{
    struct maintainer *m = arg;
    m->result = pack(m->store);
    return NULL;
}

/* Promise(database/comes-late-two) */
static void test_two_maintainers_pack_each_week_once(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    struct record before = record(store);
    struct maintainer m[2];
    pthread_t thread[2];
    for (size_t i = 0; i < 2; i++) {
        m[i].store = open_direct(LONG);
        assert_int_equal(pthread_create(&thread[i], NULL, maintain, &m[i]), 0);
    }
    for (size_t i = 0; i < 2; i++) {
        pthread_join(thread[i], NULL);
        ok(m[i].store, m[i].result);
        apc_store_close(m[i].store);
    }
    const long left = strtol(ask("SELECT count(*) FROM packable(now())"), NULL, 10);
    assert_int_equal(m[0].result + m[1].result + left, 20);
    assert_recorded(store, &before, "packed by two");
    ok(store, pack(store));
    assert_recorded(store, &before, "packed again");
    free_record(&before);
    apc_store_close(store);
}

static void *enter_times(void *arg)
{
    struct maintainer *m = arg;
    m->result = apc_store_maintain(m->store, &(struct apc_retention){.size = sizeof(struct apc_retention)});
    return NULL;
}

static void test_an_index_that_is_dropped_meanwhile_ends_no_maintenance(void **state)
{
    (void)state;
    char waiting[200];
    ask("CREATE TABLE goes (time timestamptz)");
    ask("CREATE INDEX ON goes USING brin (time)");
    snprintf(waiting, sizeof waiting, "SELECT count(*) FROM pg_locks WHERE NOT granted AND relation = %s",
             ask("SELECT 'goes'::regclass::oid"));
    struct maintainer m = {.store = open_direct(SHORT)};
    pthread_t thread;
    ask("BEGIN");
    ask("DROP TABLE goes");
    assert_int_equal(pthread_create(&thread, NULL, enter_times, &m), 0);
    while (strcmp(ask(waiting), "0") == 0)
        ;
    ask("COMMIT");
    pthread_join(thread, NULL);
    ok(m.store, m.result);
    apc_store_close(m.store);
}

/* The server's process ends wherever it is: after each of the first statements of a week, and then here and
 * there. */
/* Promise(database/comes-late-two) */
static void test_a_maintainer_that_is_killed_leaves_rows_or_chunks(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    struct record before = record(store);
    static const char *const at[] = {"SELECT pack_begin%", "SELECT pack_lock%",
                                     "FETCH FORWARD%",     "INSERT INTO sensor_packed%",
                                     "SELECT pack_end%",   "COMMIT",
                                     "FETCH FORWARD%"};
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        struct maintainer m = {.store = open_direct(LONG)};
        pthread_t thread;
        char sql[300];
        snprintf(sql, sizeof sql,
                 "SELECT count(pg_terminate_backend(pid)) > 0 FROM pg_stat_activity WHERE application_name = "
                 "'test' AND "
                 "datname = current_database() AND query LIKE '%s' AND state <> 'idle'",
                 at[k]);
        assert_int_equal(pthread_create(&thread, NULL, maintain, &m), 0);
        for (int i = 0; i < 300 && strcmp(ask(sql), "t") != 0; i++) { /* or it was too fast */
        }
        pthread_join(thread, NULL);
        apc_store_close(m.store);
        assert_recorded(store, &before, at[k]);
        ask(k % 2 == 0 ? "SELECT 1" : "DELETE FROM late");
    }
    ok(store, pack(store));
    assert_string_equal(ask("SELECT count(*) FROM packable(now())"), "0");
    assert_recorded(store, &before, "packed in the end");
    free_record(&before);
    apc_store_close(store);
}

/* ---- What else is done with them -------------------------------------------------------------------- */

/* Promise(database/packing-gives-nobody) */
static void test_packed_weeks_are_dropped_but_not_the_newest_of_a_variable(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    ok(store, pack(store));
    const struct apc_retention keep = {.size = sizeof keep, .samples = 60 * 3600 * APC_NS_PER_S, .packed = 1};
    ok(store, apc_store_maintain(store, &keep));
    assert_string_equal(ask("SELECT count(*) FROM sensor_packed WHERE until < now() - interval '60 hours'"),
                        "0");
    for (size_t v = 0; v < VARIABLES; v++) {
        struct list l = history(store, v, NULL, 0);
        assert_true(l.n >= 1);
        assert_int_equal(l.at[l.n - 1].seq, newest(store, all[v].table, all[v].id).seq);
        free(l.at);
    }
    apc_store_close(store);
}

/*
 * Promise(database/packing-gives-nobody): Packing gives nobody a right; what is packed can be dropped, but
 *   not the newest of a variable.
 */
static void test_who_reads_the_rows_reads_them_packed_and_nobody_writes_them(void **state)
{
    (void)state;
    char path[100];
    snprintf(path, sizeof path, "SET search_path TO plant%d", plant);
    cluster_query(cluster, path);
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    assert_string_equal(
        ask("SELECT coalesce(string_agg(r || ' ' || t, ', '), '') FROM unnest(ARRAY['sensor', 'actuator', "
            "'setpoint',"
            " 'actual', 'estimate']) AS t, unnest(ARRAY['apc_plant', 'apc_client', 'apc_controller', "
            "'apc_scheduler',"
            " 'apc_alarms', 'apc_historian', 'apc_operator', 'apc_engineer', 'apc_observer']) AS r, "
            "unnest(ARRAY['_packed', "
            "'_all']) AS x"
            " WHERE has_table_privilege(r, t, 'SELECT') <> has_table_privilege(r, t || x, 'SELECT') OR"
            " has_table_privilege(r, t || x, 'INSERT, UPDATE, DELETE, TRUNCATE, TRIGGER')"),
        "");
    assert_string_equal(
        ask("SELECT string_agg(proname, ' ' ORDER BY proname) FROM pg_proc WHERE pronamespace ="
            " current_schema()::regnamespace AND proname ~ 'pack|late|_of$' AND"
            " has_function_privilege('apc_operator', oid, 'EXECUTE')"),
        "bits_of double_of unpack unpack_column");
    assert_string_equal(
        ask("SELECT count(*) FROM pg_proc, unnest(ARRAY['apc_observer', 'apc_operator', 'apc_client', "
            "'apc_plant'])"
            " AS r WHERE pronamespace = current_schema()::regnamespace AND proname ~ 'trend|called' AND"
            " has_function_privilege(r, oid, 'EXECUTE') = (r <> 'apc_plant')"),
        "12");
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_packed_weeks_are_the_same_history),
        T(test_views_show_packed_rows_bit_for_bit),
        T(test_parts_of_a_packed_history_are_those_of_the_rows),
        T(test_bins_of_a_packed_history_are_those_of_the_rows),
        T(test_a_trend_is_the_rows_and_reads_the_chunks_of_its_time_only),
        T(test_a_trend_in_bins_is_the_rows_and_reads_no_chunk_that_is_short),
        T(test_a_signal_of_a_trend_is_named_as_for_apc_history),
        T(test_a_damaged_chunk_is_told_and_what_is_asked_next_is_answered),
        T(test_a_packed_seq_is_taken_and_a_free_one_is_not),
        T(test_a_week_that_is_written_to_while_it_is_packed_stays_as_it_is),
        T(test_two_maintainers_pack_each_week_once),
        T(test_an_index_that_is_dropped_meanwhile_ends_no_maintenance),
        T(test_a_maintainer_that_is_killed_leaves_rows_or_chunks),
        T(test_packed_weeks_are_dropped_but_not_the_newest_of_a_variable),
        T(test_who_reads_the_rows_reads_them_packed_and_nobody_writes_them),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
