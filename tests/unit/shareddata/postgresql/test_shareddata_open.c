/* SPDX-License-Identifier: BSD-3-Clause */
/* Chunks that are written as they come into PostgreSQL (apc-historian --pack): the same history as of rows,
 * each sample once, and what becomes of them when their week is packed. */
#include <math.h>

#include "plants.h"
#include "xorshift.h"

#define US APC_NS_PER_US

/* SQL in the plant's schema. */
static const char *ask(const char *sql)
{
    char path[100];
    snprintf(path, sizeof path, "SET search_path TO plant%d, pg_temp", plant);
    cluster_query(cluster, path);
    return cluster_query(cluster, sql);
}

static struct apc_store *open_chunks(void)
{
    char uri[600];
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options,
                                        .name = "test",
                                        .timeout = LONG,
                                        .backoff_min = 1,
                                        .backoff_max = 1,
                                        .chunks = true};
    snprintf(uri, sizeof uri, "%s#plant%d", cluster_uri(cluster), plant);
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

/* ---- What comes ------------------------------------------------------------------------------------ */

static const struct {
    enum apc_table table;
    int id;
} all[] = {{APC_SENSOR, 1},   {APC_SENSOR, 2},   {APC_SENSOR, 3}, {APC_SENSOR, 4},    {APC_ACTUATOR, 1},
           {APC_SETPOINT, 1}, {APC_ESTIMATE, 7}, {APC_ACTUAL, 3}, {APC_OPMODE, 65601}};
enum { VARIABLES = sizeof all / sizeof all[0], MOST = 4000 };

struct list {
    struct apc_sample at[MOST];
    size_t n;
};

static uint64_t draw(uint64_t below)
{
    static uint64_t x = 88172645463325252U;
    return xorshift(&x) % below;
}

/* 0: noise, jitter, statuses; 1: now and then a gap; 2: a clock that steps; 3: constant, seldom. */
static struct apc_sample next_sample(size_t v, int64_t *seq, apc_ns now)
{
    *seq += 1 + (v == 1 && draw(9) == 0 ? (int64_t)draw(50) : 0);
    struct apc_sample s = {.table = all[v].table, .id = all[v].id, .seq = *seq};
    s.time = (now / US + (apc_ns)draw(900)) * US - (v == 2 && draw(3) == 0 ? 3600 * APC_NS_PER_S : 0);
    s.value = v == 3 ? -0.0 : v == 8 ? 1 : ldexp((double)draw(1U << 30) - 5e8, (int)draw(60) - 30);
    s.status = v == 0 && draw(10) == 0 ? APC_BAD_NO_DATA : v == 0 && draw(10) == 0 ? 0x40920000U : 0;
    s.origin = v == 4 && draw(4) > 0 ? *seq * 2 : 0;
    return s;
}

/* A batch as a historian's: variable by variable, of each some rows, which begin anywhere. */
static size_t next_batch(struct apc_sample *batch, int64_t seq[VARIABLES], apc_ns now)
{
    const size_t first = draw(VARIABLES);
    size_t n = 0;
    for (size_t i = 0; i < VARIABLES; i++) {
        const size_t v = (first + i) % VARIABLES;
        const uint64_t rows = v == 3 ? draw(2) : draw(14);
        for (uint64_t k = 0; k < rows; k++) {
            batch[n++] = next_sample(v, &seq[v], now + (apc_ns)k * APC_NS_PER_S);
        }
    }
    return n;
}

static int add(void *ctx, const struct apc_sample *s)
{
    struct list *l = ctx;
    assert_in_range(l->n, 0, MOST - 1);
    l->at[l->n++] = *s;
    return 0;
}

static struct list *history(struct apc_store *store, size_t v, const struct apc_range *range)
{
    struct list *l = calloc(1, sizeof *l);
    assert_non_null(l);
    const int n = apc_store_history(store, all[v].table, all[v].id, range, add, l);
    ok(store, n);
    assert_int_equal(n, l->n);
    return l;
}

static void assert_sample(const struct apc_sample *x, const struct apc_sample *y)
{
    assert_int_equal(x->seq, y->seq);
    assert_int_equal(x->time, y->time);
    assert_int_equal(x->status, y->status);
    assert_int_equal(x->origin, y->origin);
    assert_int_equal(x->author, y->author);
    assert_memory_equal(&x->value, &y->value, sizeof x->value);
}

static void assert_same(struct apc_store *a, struct apc_store *b, const struct apc_range *range)
{
    for (size_t v = 0; v < VARIABLES; v++) {
        struct list *x = history(a, v, range), *y = history(b, v, range);
        assert_int_equal(x->n, y->n);
        for (size_t i = 0; i < x->n; i++) {
            assert_sample(&x->at[i], &y->at[i]);
        }
        free(x);
        free(y);
    }
}

/* The same batches into a memory, which is what has to be there, and as chunks into the database. */
static void fill(struct apc_store *want, struct apc_store *chunks, int batches)
{
    static struct apc_sample batch[VARIABLES * 14];
    int64_t seq[VARIABLES] = {0};
    apc_ns now = apc_clock_utc(NULL) - 8 * batches * APC_NS_PER_S;
    for (int i = 0; i < batches; i++, now += 8 * APC_NS_PER_S) {
        const size_t n = next_batch(batch, seq, now);
        assert_int_equal(apc_store_append(want, batch, n), n);
        const int stored = apc_store_append(chunks, batch, n);
        ok(chunks, stored);
        assert_int_equal(stored, n);
    }
}

static struct apc_store *memory(void)
{
    struct apc_store *store = open_uri("mem:", LONG);
    ok(store, apc_store_init(store));
    return store;
}

/* ---- The same history ------------------------------------------------------------------------------- */

/*
 * Promise(stores/several-samples-signal): Several samples of a signal that a historian writes as one row
 *   (`--pack`) are the same history, newest values and bins, each once also when they come again, and large
 *   chunks when their week is packed; who may not write rows may not write these.
 */
static void test_what_comes_as_chunks_is_the_same_history(void **state)
{
    (void)state;
    struct apc_store *want = memory(), *store = open_chunks();
    fill(want, store, 40);
    assert_same(want, store, NULL);
    assert_string_equal(
        ask("SELECT count(*) > 20 AND sum(last - first + 1) >= 4 * count(*) FROM sensor_packed"), "t");
    assert_string_equal(ask("SELECT count(*) > 10 FROM actuator_packed"), "t");
    assert_string_equal(ask("SELECT count(*) > 10 FROM estimate_packed"), "t");
    assert_string_equal(ask("SELECT count(*) > 10 FROM actual_packed"), "t");
    assert_string_equal(ask("SELECT count(*) FROM setpoint_packed"), "0");            /* people write it */
    assert_string_equal(ask("SELECT count(*) FROM sensor_packed WHERE id = 4"), "0"); /* one at a time */
    assert_string_equal(ask("SELECT count(*) FROM ONLY sensor_packed"), "0");
    assert_string_equal(ask("SELECT count(*) = count(DISTINCT (id, seq)) FROM sensor_all"), "t");
    for (size_t v = 0; v < VARIABLES; v++) {
        const struct apc_sample x = newest(want, all[v].table, all[v].id),
                                y = newest(store, all[v].table, all[v].id);
        assert_sample(&x, &y);
    }
    for (int i = 0; i < 40; i++) {
        struct list *some = history(want, draw(3), NULL);
        struct apc_range range = {.since = some->at[draw(some->n)].time, .after = (int64_t)draw(100)};
        range.until = i % 2 ? some->at[draw(some->n)].time : 0;
        range.last = i % 3 ? 0 : 1 + draw(50);
        free(some);
        assert_same(want, store, &range);
    }
    apc_store_close(store);
    apc_store_close(want);
}

struct bins {
    struct apc_history_bin at[50];
    size_t n;
};

static int add_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct bins *b = ctx;
    b->at[b->n++] = *bin;
    return 0;
}

/* Promise(stores/several-samples-signal) */
static void test_bins_of_chunks_are_those_of_the_rows(void **state)
{
    (void)state;
    struct apc_store *want = memory(), *store = open_chunks();
    fill(want, store, 20);
    const apc_ns until = apc_clock_utc(NULL) + 60 * APC_NS_PER_S, since = until - 300 * APC_NS_PER_S;
    for (size_t v = 0; v < VARIABLES - 1; v++) {
        static struct bins x, y;
        x.n = y.n = 0;
        ok(want, apc_store_history_bins(want, all[v].table, all[v].id, since, until, 50, add_bin, &x));
        ok(store, apc_store_history_bins(store, all[v].table, all[v].id, since, until, 50, add_bin, &y));
        assert_int_equal(x.n, y.n);
        for (size_t i = 0; i < x.n; i++) {
            assert_near(y.at[i].mean, x.at[i].mean, 1e-12 * fmax(fabs(x.at[i].min), fabs(x.at[i].max)));
            y.at[i].mean = x.at[i].mean;
            assert_memory_equal(&x.at[i], &y.at[i], sizeof x.at[i]);
        }
    }
    apc_store_close(store);
    apc_store_close(want);
}

/* ---- Once ------------------------------------------------------------------------------------------- */

static void make_run(struct apc_sample *s, size_t n, int id, int64_t first)
{
    const apc_ns now = apc_clock_utc(NULL) / US * US;
    for (size_t i = 0; i < n; i++) {
        s[i] = sample(APC_SENSOR, id, first + (int64_t)i, (double)i);
        s[i].time = now + (apc_ns)i * US;
    }
}

/* Promise(stores/several-samples-signal) */
static void test_chunks_whose_answer_was_lost_are_stored_once(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks();
    struct apc_sample s[40];
    make_run(s, 10, 1, 1);
    make_run(s + 10, 10, 2, 1);
    assert_int_equal(apc_store_append(store, s, 20), 20);
    assert_int_equal(apc_store_append(store, s, 20), 0); /* sent again */
    make_run(s + 20, 10, 1, 6); /* half of it is there: the rest comes, and as what it was */
    make_run(s + 30, 10, 2, 11);
    assert_int_equal(apc_store_append(store, s + 20, 20), 15);
    assert_int_equal(apc_store_append(store, s + 20, 20), 0);
    struct list *first = history(store, 0, NULL), *second = history(store, 1, NULL);
    assert_int_equal(first->n, 15);
    assert_int_equal(second->n, 20);
    for (size_t i = 0; i < 15; i++) {
        assert_sample(&first->at[i], i < 10 ? &s[i] : &s[20 + i - 5]);
    }
    assert_string_equal(ask("SELECT count(*) = 35 AND count(DISTINCT (id, seq)) = 35 FROM sensor_all"), "t");
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 15);
    free(first);
    free(second);
    apc_store_close(store);
}

/* Promise(stores/several-samples-signal) */
static void test_a_seq_of_a_chunk_is_taken_and_a_free_one_is_not(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks(), *rows = open_direct(LONG);
    struct apc_sample s[20], late[8];
    make_run(s, 10, 1, 1);
    make_run(s + 10, 10, 1, 101);
    assert_int_equal(apc_store_append(store, s, 10), 10);
    assert_int_equal(apc_store_append(store, s + 10, 10), 10);
    assert_int_equal(apc_store_append(rows, s + 14, 1), 0);
    assert_int_equal(apc_store_append(rows, s, 20), 0);
    make_run(late, 8, 1, 41); /* of a spool, older than the newest: rows, which are looked for one by one */
    assert_int_equal(apc_store_append(store, late, 8), 8);
    assert_int_equal(apc_store_append(store, late, 8), 0);
    assert_int_equal(newest(store, APC_SENSOR, 1).seq, 110);
    assert_string_equal(ask("SELECT count(*) FROM sensor"), "8");
    assert_string_equal(ask("SELECT string_agg(seq::text, ' ' ORDER BY seq) FROM sensor_all WHERE seq < 50"),
                        "1 2 3 4 5 6 7 8 9 10 41 42 43 44 45 46 47 48");
    apc_store_close(rows);
    apc_store_close(store);
}

/* What needs a closer look goes as rows. */
static void test_what_is_ahead_or_has_an_author_comes_as_rows(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks();
    struct apc_sample s[8];
    make_run(s, 8, 1, 1);
    for (size_t i = 0; i < 8; i++) {
        s[i].time += 20 * 366 * 24 * 3600 * APC_NS_PER_S; /* a clock wrong by years */
    }
    assert_int_equal(apc_store_append(store, s, 8), 8);
    make_run(s, 8, 2, 9007199254740000);
    assert_int_equal(apc_store_append(store, s, 8), 8);
    const int author = apc_store_author(store, "anna");
    ok(store, author);
    make_run(s, 8, 3, 1);
    for (size_t i = 0; i < 8; i++) {
        s[i].author = (uint32_t)author;
    }
    assert_int_equal(apc_store_append(store, s, 8), 8);
    assert_string_equal(ask("SELECT count(*) FROM sensor"), "24");
    assert_string_equal(ask("SELECT count(*) FROM sensor_packed"), "0");
    apc_store_close(store);
}

static void test_tables_that_know_no_chunks_say_what_to_do(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks();
    struct apc_sample s[8];
    make_run(s, 8, 1, 1);
    ask("DO $$ BEGIN EXECUTE (SELECT format('DROP FUNCTION %s', oid::regprocedure) FROM pg_proc WHERE "
        "proname ="
        " 'append_chunks' AND pronamespace = current_schema()::regnamespace); END $$");
    assert_int_equal(apc_store_append(store, s, 8), APC_ESCHEMA);
    assert_int_equal(apc_store_append(store, s, 3), 3); /* which are rows */
    apc_store_close(store);
}

/* ---- Packing ---------------------------------------------------------------------------------------- */

/* As if it had been five weeks ago. */
static void age(void)
{
    ask("DO $$ DECLARE t text; BEGIN FOR t IN SELECT c.relname FROM pg_inherits JOIN pg_class AS c ON c.oid "
        "= inhrelid"
        " WHERE relnamespace = current_schema()::regnamespace AND relname ~ '_open_' LOOP"
        " EXECUTE format('ALTER TABLE %I RENAME TO %I', t, regexp_replace(t, '[0-9]+$', "
        "to_char(date_trunc('week',"
        " now() AT TIME ZONE 'UTC') - interval '35 days', 'YYYYMMDD'))); END LOOP; END $$");
}

static int pack(struct apc_store *store)
{
    const struct apc_retention keep = {.size = sizeof keep, .packed = 1};
    return apc_store_maintain(store, &keep);
}

/* Promise(stores/several-samples-signal) */
static void test_small_chunks_become_large_ones(void **state)
{
    (void)state;
    struct apc_store *want = memory(), *store = open_chunks();
    fill(want, store, 100);
    assert_int_equal(pack(store), 0); /* the week goes on */
    const long small = strtol(ask("SELECT count(*) FROM sensor_packed"), NULL, 10);
    age();
    assert_string_equal(ask("SELECT count(*) FROM packable(now())"), "0"); /* which older programs ask */
    assert_int_equal(pack(store), 4);
    assert_int_equal(pack(store), 0);
    assert_string_equal(ask("SELECT count(*) FROM pg_inherits WHERE inhparent = 'sensor_packed'::regclass"),
                        "0");
    assert_in_range(strtol(ask("SELECT count(*) FROM sensor_packed"), NULL, 10), 3, small / 2);
    assert_string_equal(ask("SELECT count(*) = count(DISTINCT (id, seq)) FROM sensor_all"), "t");
    assert_string_equal(ask("SELECT count(*) FROM event WHERE text LIKE 'sensor_open_% packed: %'"), "1");
    assert_same(want, store, NULL);
    for (size_t v = 0; v < VARIABLES; v++) {
        const struct apc_sample x = newest(want, all[v].table, all[v].id),
                                y = newest(store, all[v].table, all[v].id);
        assert_sample(&x, &y);
    }
    struct apc_sample s[10];
    make_run(s, 10, 9, 1); /* a new table for what comes from now on */
    assert_int_equal(apc_store_append(store, s, 10), 10);
    assert_string_equal(ask("SELECT count(*) FROM pg_inherits WHERE inhparent = 'sensor_packed'::regclass"),
                        "1");
    apc_store_close(store);
    apc_store_close(want);
}

static void test_chunks_that_come_while_they_are_packed_make_it_stay_as_it_is(void **state)
{
    (void)state;
    struct apc_store *want = memory(), *store = open_chunks();
    fill(want, store, 20);
    const char *partition =
        "(SELECT relname::text FROM pg_inherits JOIN pg_class AS c ON c.oid = inhrelid WHERE inhparent = "
        "'sensor_packed'::regclass)";
    char sql[400];
    snprintf(sql, sizeof sql, "SELECT pack_begin(%s)", partition);
    ask(sql);
    struct apc_sample s[10];
    make_run(s, 10, 9, 1);
    assert_int_equal(apc_store_append(store, s, 10), 10);
    snprintf(sql, sizeof sql,
             "DO $$ BEGIN PERFORM pack_end('sensor', %s, '{}', '{}', '{}'); RAISE 'packed';"
             " EXCEPTION WHEN serialization_failure THEN NULL; END $$",
             partition);
    ask(sql);
    assert_string_equal(ask("SELECT count(*) FROM late"), "1");
    age();
    assert_int_equal(pack(store), 4); /* begins anew */
    assert_same(want, store, NULL);
    assert_string_equal(ask("SELECT count(*) FROM sensor_all WHERE id = 9"), "10");
    apc_store_close(store);
    apc_store_close(want);
}

static void test_a_chunk_that_is_damaged_keeps_its_week_as_it_is(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks();
    struct apc_sample s[20];
    make_run(s, 10, 1, 1);
    make_run(s + 10, 10, 2, 1);
    assert_int_equal(apc_store_append(store, s, 20), 20);
    ask("UPDATE sensor_packed SET data = substring(data FOR 12) WHERE id = 2");
    age();
    assert_int_equal(pack(store), 0);
    assert_string_equal(
        ask("SELECT count(*) FROM event WHERE text LIKE 'sensor_open_% is not packed: a chunk of variable "
            "2 in it is damaged'"),
        "1");
    struct list *whole = history(store, 0, NULL);
    assert_int_equal(whole->n, 10);
    free(whole);
    ask("UPDATE sensor_packed SET data = '' WHERE id = 1"); /* the first one that is read */
    assert_int_equal(pack(store), 0);
    assert_string_equal(
        ask("SELECT count(*) FROM event WHERE text LIKE 'sensor_open_% is not packed: a chunk of variable "
            "1 in it is damaged'"),
        "1");
    apc_store_close(store);
}

static void test_small_chunks_are_dropped_but_not_the_newest_of_a_variable(void **state)
{
    (void)state;
    struct apc_store *store = open_chunks();
    struct apc_sample s[20];
    make_run(s, 20, 1, 1);
    for (size_t i = 0; i < 20; i++) {
        s[i].time -= 3 * 3600 * APC_NS_PER_S;
    }
    assert_int_equal(apc_store_append(store, s, 10), 10);
    assert_int_equal(apc_store_append(store, s + 10, 10), 10);
    const struct apc_retention keep = {.size = sizeof keep, .samples = 3600 * APC_NS_PER_S};
    ok(store, apc_store_maintain(store, &keep));
    struct list *whole = history(store, 0, NULL);
    assert_int_equal(whole->n, 1);
    assert_sample(&whole->at[0], &s[19]);
    free(whole);
    apc_store_close(store);
}

/* ---- Who may ---------------------------------------------------------------------------------------- */

#define FRAME(target, id, last, value, data)                                                                 \
    "SELECT append_chunks('" target "', '{" id "}', '{1}', '{" last                                          \
    "}', '{2026-01-01}', '{2026-01-01}', '{4}', '{0}', '{" value                                             \
    "}', '{1}', '{1}', '{1}', '{4}', '{1}', '{10}', " data ", '{2026-01-01}', '{0}', '{1}', '{NULL}')"
#define DATA "'\\x01000400000000000000'"

static const char *state_of(PGconn *conn, const char *sql)
{
    static char code[8];
    PGresult *result = PQexec(conn, sql);
    snprintf(code, sizeof code, "%s",
             PQresultErrorField(result, PG_DIAG_SQLSTATE) ? PQresultErrorField(result, PG_DIAG_SQLSTATE)
                                                          : "");
    PQclear(result);
    return code;
}

/* Promise(stores/several-samples-signal) */
static void test_only_the_historian_of_a_history_writes_chunks(void **state)
{
    (void)state;
    char sql[100];
    snprintf(sql, sizeof sql, "SET search_path TO plant%d", plant);
    cluster_query(cluster, sql);
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    assert_string_equal(
        ask("SELECT string_agg(rolname, ' ') FROM pg_roles, pg_proc WHERE rolname ~ '^apc_' AND proname ~"
            " '^(append_chunks|make_open)$' AND pronamespace = current_schema()::regnamespace AND"
            " has_function_privilege(rolname, pg_proc.oid, 'EXECUTE')"),
        "apc_historian");
    PGconn *conn = cluster_connect(cluster);
    assert_string_equal(state_of(conn, sql), "");
    PQclear(PQexec(conn, "DROP ROLE IF EXISTS chunk_writer"));
    assert_string_equal(state_of(conn, "CREATE ROLE chunk_writer IN ROLE apc_historian"), "");
    assert_string_equal(state_of(conn, "SET SESSION AUTHORIZATION chunk_writer"), "");
    assert_string_equal(state_of(conn, FRAME("sensor", "1", "4", "1", DATA)),
                        "42501"); /* it is a live store */
    assert_string_equal(state_of(conn, "RESET SESSION AUTHORIZATION"), "");
    ask("INSERT INTO catalogue (revision, kind, text) VALUES (1, 'history', '')");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    assert_string_equal(state_of(conn, "SET SESSION AUTHORIZATION chunk_writer"), "");
    assert_string_equal(state_of(conn, FRAME("sensor", "1", "4", "1", DATA)), "");
    assert_string_equal(state_of(conn, FRAME("sensor", "1", "4", "1", DATA)), "23505");
    assert_string_equal(state_of(conn, FRAME("setpoint", "1", "4", "1", DATA)), "22023");
    assert_string_equal(state_of(conn, FRAME("tag", "1", "4", "1", DATA)), "42P01");
    assert_string_equal(state_of(conn, FRAME("sensor", "-1", "4", "1", DATA)), "23514");
    assert_string_equal(state_of(conn, FRAME("sensor", "2", "5", "1", DATA)), "23514"); /* four are in it */
    assert_string_equal(state_of(conn, FRAME("sensor", "2", "4", "NaN", DATA)), "23514");
    assert_string_equal(state_of(conn, FRAME("sensor", "2", "4", "NULL", DATA)), "23514");
    assert_string_equal(state_of(conn, FRAME("sensor", "2", "4", "1", "'\\x010004'")), "23514");
    assert_string_equal(state_of(conn, FRAME("sensor", "2", "4", "1", "NULL")), "23514");
    assert_string_equal(state_of(conn, "SELECT make_open('sensor', 'sensor_open_20200101')"), "42501");
    assert_string_equal(state_of(conn, "DELETE FROM sensor_packed"), "42501");
    assert_string_equal(state_of(conn, "RESET SESSION AUTHORIZATION"), "");
    assert_string_equal(ask("SELECT count(*) FROM sensor_packed"), "1");
    assert_string_equal(ask("SELECT count(*) FROM sensor_newest"), "1");
    assert_string_equal(state_of(conn, "DROP ROLE chunk_writer"), "");
    PQfinish(conn);
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_what_comes_as_chunks_is_the_same_history),
        T(test_bins_of_chunks_are_those_of_the_rows),
        T(test_chunks_whose_answer_was_lost_are_stored_once),
        T(test_a_seq_of_a_chunk_is_taken_and_a_free_one_is_not),
        T(test_what_is_ahead_or_has_an_author_comes_as_rows),
        T(test_tables_that_know_no_chunks_say_what_to_do),
        T(test_small_chunks_become_large_ones),
        T(test_chunks_that_come_while_they_are_packed_make_it_stay_as_it_is),
        T(test_a_chunk_that_is_damaged_keeps_its_week_as_it_is),
        T(test_small_chunks_are_dropped_but_not_the_newest_of_a_variable),
        T(test_only_the_historian_of_a_history_writes_chunks),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
