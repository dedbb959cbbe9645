/* SPDX-License-Identifier: BSD-3-Clause */
/* Rows in PostgreSQL: beside people's open transactions, in one round trip, and claims of single variables. */
#include <string.h>

#include "plants.h"
#include "shareddata/shareddata_internal.h"

/* A tick of an upper controller: two setpoints by compare and set, an output, what became of it, its row. */
struct tick {
    struct apc_sample s[4];
    double x[40];
    struct apc_vector v;
    struct apc_rows rows;
};

static void make_tick(struct tick *t, int64_t seq, int64_t known)
{
    memset(t, 0, sizeof *t);
    t->s[0] = sample(APC_SETPOINT, 1, known, (double)seq);
    t->s[1] = sample(APC_ACTUATOR, 1, seq, (double)seq);
    t->s[2] = sample(APC_SETPOINT, 2, known, (double)seq);
    t->s[3] = sample(APC_ACTUAL, 1, seq, (double)seq);
    for (int i = 0; i < 40; i++) {
        t->x[i] = (double)seq;
    }
    t->v = (struct apc_vector){.table = APC_TICK, .id = 1, .seq = seq, .n = 40, .room = 40, .value = t->x};
    t->rows = (struct apc_rows){
        .size = sizeof t->rows, .sample = t->s, .n_samples = 4, .vector = &t->v, .n_vectors = 1};
}

static void say(PGconn *conn, const char *sql)
{
    PGresult *result = PQexec(conn, sql);
    ExecStatusType status = PQresultStatus(result);
    if (status != PGRES_COMMAND_OK && status != PGRES_TUPLES_OK && status != PGRES_COPY_IN) {
        fail_msg("%s: %s", sql, PQerrorMessage(conn));
    }
    PQclear(result);
}

/* As somebody's psql. */
static PGconn *open_person(void)
{
    PGconn *conn = cluster_connect(cluster);
    char sql[80];
    snprintf(sql, sizeof sql, "SET search_path TO plant%d", plant);
    say(conn, sql);
    return conn;
}

static void await_ended(void)
{
    static const char others[] =
        "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND "
        "xact_start IS NOT NULL AND pid <> pg_backend_pid()";
    assert_true(cluster_await(cluster, others, "0"));
}

/* With @p begin a person holds setpoint 1. Whatever it is, the tick is stored without it. */
static void check_held(const char *begin, const char *data, bool committed)
{
    struct apc_store *store = open_direct(LONG);
    struct tick t;
    make_tick(&t, 1, 0);
    assert_int_equal(apc_store_append_rows(store, &t.rows), 5);
    PGconn *person = open_person();
    say(person, "BEGIN");
    say(person, begin);
    if (data) {
        assert_int_equal(PQputCopyData(person, data, (int)strlen(data)), 1);
        assert_int_equal(PQflush(person), 0);
        assert_true(cluster_await(cluster, "SELECT tuples_processed FROM pg_stat_progress_copy", "1"));
    }
    for (int64_t seq = 2; seq <= 4; seq++) {
        make_tick(&t, seq, seq - 1);
        t.s[0].seq = seq < 4 ? 1 : APC_SEQ_ANY;
        assert_int_equal(apc_store_append_rows(store, &t.rows), 4);
        assert_true(t.s[0].seq == 0 && t.s[2].seq == seq);
    }
    assert_near(newest(store, APC_SETPOINT, 1).value, 1, 0);
    if (committed) {
        if (data) {
            assert_int_equal(PQputCopyEnd(person, NULL), 1);
            PQclear(PQgetResult(person));
            PQclear(PQgetResult(person));
        }
        say(person, "COMMIT");
    }
    PQfinish(person); /* or it is lost */
    await_ended();
    make_tick(&t, 5, 4);
    t.s[0].seq = 1;
    assert_int_equal(apc_store_append_rows(store, &t.rows), committed ? 4 : 5);
    assert_int_equal(t.s[0].seq, committed ? 0 : 2);
    assert_near(newest(store, APC_SETPOINT, 1).value, committed ? 99 : 5, 0);
    apc_store_close(store);
}

/*
 * Promise(database/person-open-transaction): A person's open transaction, a hanging COPY included, neither
 *   blocks nor fails a tick; a tick is one round trip each way.
 */
static void test_a_persons_open_insert_neither_blocks_nor_fails_a_tick(void **state)
{
    (void)state;
    check_held("INSERT INTO setpoint VALUES (1, 2, now(), 0, 99)", NULL, true);
}

static void test_nor_does_one_that_is_rolled_back(void **state)
{
    (void)state;
    check_held("INSERT INTO setpoint VALUES (1, 2, now(), 0, 99)", NULL, false);
}

/* Promise(database/person-open-transaction) */
static void test_nor_does_a_copy_that_hangs_in_its_middle(void **state)
{
    (void)state;
    check_held("COPY setpoint (id, seq, time, status, value) FROM STDIN", "1\t2\t2026-01-31\t0\t99\n", false);
}

static void test_nor_does_a_copy_that_ends_later(void **state)
{
    (void)state;
    check_held("COPY setpoint (id, seq, time, status, value) FROM STDIN", "1\t2\t2026-01-31\t0\t99\n", true);
}

static void test_nor_does_one_that_locks_the_row_of_newest_values(void **state)
{
    (void)state;
    check_held("SELECT * FROM setpoint_vacant(ARRAY[1], ARRAY[-1]::bigint[])", NULL, false);
}

/* There is no row yet that could be held. */
/* Promise(database/person-open-transaction) */
static void test_nor_does_an_open_transaction_with_a_variables_first_row(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    PGconn *person = open_person();
    say(person, "BEGIN");
    say(person, "INSERT INTO setpoint VALUES (1, 1, now(), 0, 99)");
    struct tick t;
    make_tick(&t, 1, 0);
    assert_int_equal(apc_store_append_rows(store, &t.rows), 4);
    assert_true(t.s[0].seq == 0 && t.s[2].seq == 1);
    struct apc_sample variables[9];
    assert_int_equal(apc_store_variables(store, variables, 9), 4);
    say(person, "COMMIT");
    PQfinish(person);
    assert_int_equal(apc_store_variables(store, variables, 9), 5);
    make_tick(&t, 2, 1);
    assert_int_equal(apc_store_append_rows(store, &t.rows), 5);
    assert_int_equal(t.s[0].seq, 2);
    apc_store_close(store);
}

/* A hold that ends without a row leaves nothing that anybody sees. */
static void test_a_variable_that_was_only_held_has_no_row(void **state)
{
    (void)state;
    PGconn *person = open_person();
    say(person, "SELECT * FROM tuning_vacant(ARRAY[1], ARRAY[0]::bigint[])");
    PQfinish(person);
    struct apc_store *store = open_direct(LONG);
    struct apc_sample s = newest(store, APC_TUNING, 1);
    assert_true(s.seq == 0 && s.time == 0 && s.status == APC_BAD_NO_DATA);
    assert_int_equal(apc_store_variables(store, &s, 1), 0);
    s = sample(APC_TUNING, 1, 0, 5);
    assert_int_equal(apc_store_swap(store, &s, 1), 0);
    assert_int_equal(s.seq, 1);
    apc_store_close(store);
}

/* Promise(database/person-open-transaction) */
static void test_a_tick_is_one_round_trip_each_way(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    struct apc_store_stats before = {.size = sizeof before}, after = before;
    struct tick t;
    for (int64_t seq = 1; seq <= 3; seq++) {
        make_tick(&t, seq, seq - 1);
        assert_int_equal(apc_store_append_rows(store, &t.rows), 5);
        apc_store_stats(store, &before);
        assert_int_equal(apc_store_read_rows(store, &t.rows), 0);
        apc_store_stats(store, &after);
        assert_int_equal(after.round_trips - before.round_trips, 1);
        make_tick(&t, seq + 100, seq);
        t.s[0].seq = t.s[2].seq = 77; /* left out: no round trip for that either */
        assert_int_equal(apc_store_append_rows(store, &t.rows), 3);
        apc_store_stats(store, &before);
        assert_int_equal(before.round_trips - after.round_trips, 1);
    }
    apc_store_close(store);
}

/* A refused read must not leave the session in a transaction. */
static void test_a_read_that_fails_leaves_the_store_usable(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    struct tick t;
    make_tick(&t, 1, 0);
    assert_int_equal(apc_store_append_rows(store, &t.rows), 5);
    char sql[200];
    snprintf(sql, sizeof sql, "ALTER TABLE plant%d.tick_newest ALTER COLUMN value TYPE text", plant);
    cluster_query(cluster, sql);
    assert_true(apc_store_read_rows(store, &t.rows) < 0);
    assert_near(newest(store, APC_ACTUATOR, 1).value, 1, 0);
    apc_store_close(store);
}

/* ---- Claims of single variables ------------------------------------------------------------------- */

static int claim(struct apc_store *store, struct apc_sample *s, size_t n)
{
    return store->ops->claim_set(store, s, n);
}

static void test_a_claim_of_a_set_is_refused_by_variable_and_holder(void **state)
{
    (void)state;
    char uri[600];
    snprintf(uri, sizeof uri, "%s&application_name=upper#plant%d", cluster_uri(cluster), plant);
    struct apc_store *a = open_uri(uri, LONG), *b = open_direct(LONG);
    struct tick t;
    make_tick(&t, 7, 0);
    assert_int_equal(apc_store_append_rows(a, &t.rows), 5);
    struct apc_sample mine[3] = {{.table = APC_TICK, .id = 1},
                                 {.table = APC_ACTUATOR, .id = 2},
                                 {.table = APC_ACTUATOR, .id = 1}},
                      theirs[2] = {{.table = APC_TICK, .id = 2}, {.table = APC_ACTUATOR, .id = 1}};
    assert_int_equal(claim(a, mine, 3), 0);
    assert_true(mine[0].seq == 7 && mine[1].seq == 0 && mine[2].seq == 7);
    assert_int_equal(claim(b, theirs, 2), APC_EBUSY);
    assert_says(b, "actuator 1 of schema plant");
    assert_says(b, "is already written by upper (server process");
    assert_int_equal(claim(b, theirs, 1), 0);
    int64_t last[1];
    assert_int_equal(apc_store_claim(b, APC_ACTUATOR, 1, last), APC_EBUSY);
    assert_int_equal(a->ops->release(a, &mine[2], 1), 0);
    assert_int_equal(claim(b, theirs, 2), 0);
    assert_int_equal(claim(a, &mine[2], 1), APC_EBUSY);
    apc_store_close(b);
    apc_store_close(a);
}

/* Promise(database/claim-single-variables) */
static void test_a_set_is_claimed_anew_with_each_connection_or_the_other_writer_is_named(void **state)
{
    (void)state;
    char uri[600];
    snprintf(uri, sizeof uri, "%s&application_name=goes_on#plant%d", cluster_uri(cluster), plant);
    struct apc_store *a = open_uri(uri, LONG), *b = open_direct(LONG);
    struct apc_sample mine[2] = {{.table = APC_TICK, .id = 1}, {.table = APC_ACTUATOR, .id = 1}}, s;
    assert_int_equal(claim(a, mine, 2), 0);
    s = sample(APC_ACTUATOR, 1, 1, 1);
    terminate(cluster, "goes_on");
    assert_int_equal(append_again(a, &s, 1), 1);
    assert_int_equal(claim(b, mine, 1), APC_EBUSY); /* it has it again */
    assert_int_equal(a->ops->release(a, &mine[0], 1), 0);
    terminate(cluster, "goes_on");
    assert_int_equal(claim(b, &mine[0], 1), 0);
    assert_int_equal(claim(b, &mine[1], 1), 0); /* another was faster */
    s.seq = 2;
    int err = APC_ECONN;
    for (int i = 0; i < 100000 && err == APC_ECONN; i++) {
        err = apc_store_append(a, &s, 1);
    }
    assert_int_equal(err, APC_EBUSY);
    assert_says(a, "actuator 1 of schema plant");
    apc_store_close(b);
    assert_int_equal(append_again(a, &s, 1), 1);
    apc_store_close(a);
}

/* ---- What the plant is, and who writes ------------------------------------------------------------- */

static void test_a_name_has_a_number_and_the_number_its_name(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG), *other = open_direct(LONG);
    char name[APC_AUTHOR_LEN], longest[APC_AUTHOR_LEN];
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    int joe = store->ops->author(store, "joe"), ann = store->ops->author(store, longest);
    assert_true(joe > 0 && ann > 0 && joe != ann);
    assert_int_equal(other->ops->author(other, "joe"), joe);
    assert_int_equal(other->ops->author_name(other, (uint32_t)ann, name), 0);
    assert_string_equal(name, longest);
    assert_int_equal(store->ops->author_name(store, 4000000000u, name), APC_ENOTFOUND);
    assert_int_equal(store->ops->author(store, ""), APC_ESTORE);
    apc_store_close(other);
    apc_store_close(store);
}

static void test_a_plant_is_described_wholly_and_a_new_text_is_a_new_revision(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    struct apc_tag tag[2] = {{.table = APC_SENSOR, .id = 1, .name = "y", .high = 1},
                             {.table = APC_TICK, .id = 1, .name = "base", .high = 1}};
    char text[20];
    int64_t revision = -1;
    assert_int_equal(store->ops->catalogue(store, text, sizeof text, &revision), 0);
    assert_int_equal(revision, 0);
    assert_int_equal(store->ops->describe(store, tag, 2, "name = \"a\";"), 2);
    assert_int_equal(store->ops->catalogue(store, text, sizeof text, &revision), 11);
    assert_string_equal(text, "name = \"a\";");
    assert_int_equal(revision, 1);
    assert_int_equal(store->ops->describe(store, tag, 2, "name = \"a\";"), 2); /* the same */
    assert_int_equal(store->ops->catalogue(store, NULL, 0, &revision), 11);
    assert_int_equal(revision, 1);
    tag[1].name[0] = '\0';
    assert_int_equal(store->ops->describe(store, tag, 2, "other"), APC_ESTORE); /* neither is changed */
    assert_int_equal(store->ops->catalogue(store, text, 5, &revision), 11);
    assert_string_equal(text, "name"); /* cut */
    assert_int_equal(revision, 1);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), 2);
    assert_int_equal(store->ops->describe(store, tag, 1, "other"), 1);
    assert_int_equal(store->ops->catalogue(store, text, sizeof text, &revision), 5);
    assert_int_equal(revision, 2);
    char sql[100];
    snprintf(sql, sizeof sql, "SELECT string_agg(kind, ' ') FROM plant%d.catalogue", plant);
    assert_string_equal(cluster_query(cluster, sql), "live live");
    apc_store_close(store);
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_persons_open_insert_neither_blocks_nor_fails_a_tick),
        T(test_nor_does_one_that_is_rolled_back),
        T(test_nor_does_a_copy_that_hangs_in_its_middle),
        T(test_nor_does_a_copy_that_ends_later),
        T(test_nor_does_one_that_locks_the_row_of_newest_values),
        T(test_nor_does_an_open_transaction_with_a_variables_first_row),
        T(test_a_variable_that_was_only_held_has_no_row),
        T(test_a_tick_is_one_round_trip_each_way),
        T(test_a_read_that_fails_leaves_the_store_usable),
        T(test_a_claim_of_a_set_is_refused_by_variable_and_holder),
        T(test_a_name_has_a_number_and_the_number_its_name),
        T(test_a_plant_is_described_wholly_and_a_new_text_is_a_new_revision),
        T(test_a_set_is_claimed_anew_with_each_connection_or_the_other_writer_is_named),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
