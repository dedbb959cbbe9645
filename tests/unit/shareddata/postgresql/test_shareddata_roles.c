/* SPDX-License-Identifier: BSD-3-Clause */
/* sql/roles.sql: what each kind of program may do, and that it may do nothing else. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "roles_rig.h"

static const char *expected(const char *may, int table)
{
    return strchr(may, letters[table - 1]) ? "" : "42501";
}

static void check_rights(const struct right *r, int64_t seq[APC_TABLE_END][2])
{
    PGconn *conn = connect_as(r->role);
    for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
        if (table == APC_STATE) {
            continue;
        }
        const bool target = table == APC_OPMODE;
        int64_t *next = &seq[table][target ? 0 : 1];
        const char *name = apc_table_name((enum apc_table)table);
        char sql[4][200];
        snprintf(sql[0], sizeof sql[0], "SELECT count(*) FROM apc.%s", name);
        snprintf(sql[1], sizeof sql[1], "SELECT count(*) FROM apc.%s_newest", name);
        snprintf(sql[2], sizeof sql[2],
                 "INSERT INTO apc.%s (id, seq, time, status, value) VALUES (%d, %lld, now(), 0, %s)", name,
                 target ? 0 : 1, (long long)*next + 1,
                 apc_table_vectors((enum apc_table)table) ? "'{1}'" : "1");
        snprintf(sql[3], sizeof sql[3], "SELECT * FROM apc.claim_set(ARRAY['%s'], ARRAY[1])", name);
        const char *const may[4] = {r->reads, r->reads, r->appends, r->claims};
        for (size_t i = 0; i < 4; i++) {
            const char *said = attempt(conn, sql[i]);
            *next += i == 2 && said[0] == '\0';
            if (strcmp(said, expected(may[i], table)) != 0) {
                fail_msg("%s: %s: \"%s\"", r->role, sql[i], said);
            }
        }
    }
    PQfinish(conn);
}

/*
 * Promise(database/role-row-says): Each role may do what its row says and no more; nobody gets at the
 *   owner's rights.
 * Promise(database/trend-gives-rows)
 */
static void test_each_role_may_do_what_it_needs_and_no_more(void **state)
{
    (void)state;
    int64_t seq[APC_TABLE_END][2] = {{0}};
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        check_rights(&rights[r], seq);
    }
}

static const char *value_of(PGconn *conn, const char *sql)
{
    static char value[200];
    PGresult *result = PQexec(conn, sql);
    snprintf(value, sizeof value, "%s",
             PQntuples(result) > 0 ? PQgetvalue(result, 0, 0) : PQerrorMessage(conn));
    PQclear(result);
    return value;
}

/* A history has one writer, and people ask it. It is live again afterwards. */
/*
 * Promise(database/role-writes-time)
 * Promise(database/people-rows-bear)
 */
static void test_of_a_history_only_the_historian_writes_and_people_ask(void **state)
{
    (void)state;
    int64_t seq[APC_TABLE_END][2];
    for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
        if (table == APC_STATE) {
            continue;
        }
        seq[table][0] = seq[table][1] = 3000;
        char sql[300];
        snprintf(sql, sizeof sql,
                 "INSERT INTO apc.%s (id, seq, time, status, value) SELECT id, 3000, now(), 0, %s "
                 "FROM generate_series(0, 1) AS id",
                 apc_table_name((enum apc_table)table),
                 apc_table_vectors((enum apc_table)table) ? "'{1}'::float8[]" : "1");
        cluster_query(cluster, sql);
    }
    cluster_query(cluster, "INSERT INTO apc.catalogue (revision, kind, text) VALUES (1, 'history', '')");
    cluster_query(cluster, "SET search_path TO apc");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    for (size_t r = 0; r < sizeof rights_of_history / sizeof rights_of_history[0]; r++) {
        check_rights(&rights_of_history[r], seq);
    }
    static const char ask[] =
        "INSERT INTO apc.request (table_name, variable, value, author) VALUES ('setpoint', 1, "
        "3, 'joe')";
    for (size_t r = 0; r < sizeof roles / sizeof roles[0]; r++) {
        PGconn *conn = connect_as(roles[r]);
        bool person = strcmp(roles[r], "operator") == 0 || strcmp(roles[r], "engineer") == 0;
        assert_string_equal(attempt(conn, ask), person ? "" : "42501");
        assert_string_equal(attempt(conn,
                                    "INSERT INTO apc.request (table_name, variable, value, role) VALUES "
                                    "('setpoint', 1, 3, 'apc')"),
                            "42501");
        assert_string_equal(attempt(conn,
                                    "INSERT INTO apc.request (table_name, variable, value, outcome) VALUES "
                                    "('setpoint', 1, 3, 'applied')"),
                            "42501");
        assert_string_equal(attempt(conn, "UPDATE apc.request SET outcome = 'applied', seq = 7 WHERE id = 1"),
                            strcmp(roles[r], "historian") == 0 ? "" : "42501");
        assert_string_equal(attempt(conn, "UPDATE apc.request SET value = 4"), "42501");
        assert_string_equal(attempt(conn, "DELETE FROM apc.request"), "42501");
        if (person) {
            assert_string_equal(attempt(conn,
                                        "INSERT INTO apc.request (table_name, variable, value, time, until) "
                                        "VALUES ('setpoint', 1, 3, '2200-01-01', '2200-01-01')"),
                                "23514");
            assert_string_equal(attempt(conn, "INSERT INTO apc.request (table_name, variable, value) VALUES "
                                              "('sensor', 1, 3)"),
                                "23514");
            assert_string_equal(attempt(conn,
                                        "INSERT INTO apc.request (table_name, variable, value, until) VALUES "
                                        "('setpoint', 1, 3, now() + interval '1 day')"),
                                "23514");
        }
        PQfinish(conn);
    }
    cluster_query(cluster, "INSERT INTO apc.catalogue (revision, kind, text) VALUES (2, 'live', '')");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    PGconn *conn = connect_as("operator");
    assert_string_equal(attempt(conn, ask), "42501");
    PQfinish(conn);
}

/* Promise(database/people-rows-bear) */
static void test_the_engineer_sets_limits_and_nobody_else_does(void **state)
{
    (void)state;
    cluster_query(cluster, "INSERT INTO apc.tag (table_name, id, name) VALUES ('sensor', 99, 'limited')");
    for (size_t r = 0; r < sizeof roles / sizeof roles[0]; r++) {
        PGconn *conn = connect_as(roles[r]);
        const char *may = strcmp(roles[r], "engineer") == 0 ? "" : "42501";
        assert_string_equal(attempt(conn, "UPDATE apc.tag SET low = 1, high = 2 WHERE id = 99"), may);
        assert_string_equal(
            attempt(conn, "UPDATE apc.tag SET display_low = 1, display_high = 2 WHERE id = 99"), may);
        assert_string_equal(attempt(conn, "UPDATE apc.tag SET controller = 'x'"), "42501");
        assert_string_equal(attempt(conn, "UPDATE apc.tag SET id = 98"), "42501");
        assert_string_equal(
            attempt(conn, "INSERT INTO apc.catalogue (revision, kind, text) VALUES (9, 'live', '')"),
            "42501");
        assert_string_equal(attempt(conn, "INSERT INTO apc.claim VALUES ('sensor', 1, 'me', 1, now())"),
                            "42501");
        assert_string_equal(attempt(conn, "INSERT INTO apc.author (name, role) VALUES ('me', 'apc')"),
                            "42501");
        assert_string_equal(attempt(conn, "DELETE FROM apc.claim"), "42501");
        PQfinish(conn);
    }
    cluster_query(cluster, "DELETE FROM apc.tag WHERE id = 99");
}

/*
 * Promise(database/people-rows-bear): People's rows bear their names; the mode of all is each loop's; a
 *   person's setpoint opens a cascade; a history is asked.
 */
static void test_a_row_bears_its_writers_own_name_and_no_other(void **state)
{
    (void)state;
    PGconn *person = connect_as("operator"), *other = connect_as("engineer");
    char joe[20], sql[200], user[64];
    snprintf(joe, sizeof joe, "%s", value_of(other, "SELECT apc.author_number('joe')"));
    assert_string_equal(value_of(other, "SELECT apc.author_number('joe')"), joe);
    snprintf(sql, sizeof sql,
             "INSERT INTO apc.tuning (id, seq, time, status, value, author) VALUES (80, 1, now(), 0, 1, %s)",
             joe);
    assert_string_equal(attempt(person, sql), "42501");
    assert_string_equal(attempt(other, sql), "");
    snprintf(sql, sizeof sql,
             "INSERT INTO apc.event (time, severity, source, kind, text, author) VALUES (now(), 1, '', '', "
             "'', %s)",
             joe);
    assert_string_equal(attempt(person, sql), "23503");
    assert_string_equal(attempt(other, sql), "");
    /* By SQL the user himself is named, and by the paper's functions. */
    user_name(user, "operator");
    assert_string_equal(attempt(person, "INSERT INTO apc.tuning VALUES (80, 2, now(), 0, 1)"), "");
    static const char who[] =
        "SELECT name FROM apc.tuning_newest AS n JOIN apc.author AS a ON a.number = n.author "
        "WHERE n.id = 80";
    assert_string_equal(cluster_query(cluster, who), user);
    user_name(user, "engineer");
    assert_int_equal(insertIntoTableFloat(other, "tuning", 80, "2026-01-31 12:00:00", "ok", 1), 0);
    assert_string_equal(cluster_query(cluster, who), user);
    assert_string_equal(attempt(person, "SELECT apc.author_number('')"), "23514");
    assert_string_equal(attempt(person, "SELECT apc.number_of('joe')"), "42501");
    PQfinish(other);
    PQfinish(person);
}

/* A plant of two loops: the first has setpoint 1, the second 2. */
static void make_loops(void)
{
    cluster_query(
        cluster,
        "DELETE FROM apc.tag; INSERT INTO apc.tag (table_name, id, name, controller) VALUES "
        "('opmode', 1, 'u1', 'base'), ('opmode', 2, 'u2', 'base'), ('setpoint', 1, 'r1', ''); "
        "INSERT INTO apc.dim (id, seq, time, status, value) SELECT id, coalesce((SELECT seq FROM "
        "apc.dim_newest AS n WHERE n.id = v.id), 0) + 1, now(), 0, value FROM (VALUES (4, 1), (5, 1), (6, "
        "2), (7, 2)) AS v (id, value)");
}

static const char *target_of(int loop)
{
    char sql[100];
    snprintf(sql, sizeof sql, "SELECT value FROM apc.opmode_newest WHERE id = %d", loop);
    return cluster_query(cluster, sql);
}

static int put_as(const char *role, enum apc_table table, int id, double value)
{
    PGconn *conn = connect_as(role);
    int err = insertIntoTableFloat(conn, apc_table_name(table), id, "2026-01-31 12:00:00", "ok", value);
    PQfinish(conn);
    return err;
}

/* Promise(database/people-rows-bear) */
static void test_the_mode_of_all_is_written_to_each_loop_and_a_person_opens_a_cascade(void **state)
{
    (void)state;
    make_loops();
    assert_int_equal(put_as("operator", APC_OPMODE, 0, 3), 0);
    assert_string_equal(target_of(1), "3");
    assert_string_equal(target_of(2), "3");
    assert_int_equal(put_as("operator", APC_OPMODE, 1, 0), 0); /* a loop's own */
    assert_int_equal(put_as("operator", APC_OPMODE, 65537, 1), 0);
    assert_int_equal(put_as("operator", APC_OPMODE, 3, 0), APC_ESTORE); /* there is no such loop */
    assert_string_equal(target_of(2), "3");

    /* Programs that write setpoints by themselves leave the mode alone; a person takes it Local, unless it
     * is. */
    static const char taken[] = "SELECT count(*) FROM apc.event WHERE text LIKE '%taken Local, cascade open'";
    assert_int_equal(put_as("scheduler", APC_SETPOINT, 2, 1), 0);
    assert_int_equal(put_as("controller", APC_SETPOINT, 2, 1), 0);
    assert_int_equal(put_as("operator", APC_SETPOINT, 1, 1), 0); /* in Man */
    assert_int_equal(put_as("operator", APC_SETPOINT, 9, 1), 0); /* of no loop */
    assert_string_equal(target_of(1), "0");
    assert_string_equal(target_of(2), "3");
    assert_string_equal(cluster_query(cluster, taken), "0");
    assert_int_equal(put_as("operator", APC_SETPOINT, 2, 1), 0);
    assert_string_equal(target_of(2), "1");
    assert_string_equal(cluster_query(cluster, taken), "1");
    assert_int_equal(put_as("operator", APC_OPMODE, 1, 3), 0);
    assert_int_equal(put_as("engineer", APC_SETPOINT, 1, 1), 0);
    assert_string_equal(target_of(1), "1");
    assert_string_equal(cluster_query(cluster, "SELECT text FROM apc.event ORDER BY id DESC LIMIT 1"),
                        "r1 taken Local, cascade open");

    /* When the transaction ends; and not, where the person has said something else in it. */
    assert_int_equal(put_as("operator", APC_OPMODE, 0, 3), 0);
    PGconn *person = connect_as("operator");
    assert_string_equal(attempt(person, "BEGIN"), "");
    assert_int_equal(insertIntoTableFloat(person, "setpoint", 1, "2026-01-31 12:00:00", "ok", 2), 0);
    assert_int_equal(insertIntoTableFloat(person, "setpoint", 2, "2026-01-31 12:00:00", "ok", 2), 0);
    assert_int_equal(insertIntoTableFloat(person, "opmode", 2, "2026-01-31 12:00:00", "ok", 0), 0);
    assert_string_equal(target_of(1), "3");
    assert_string_equal(attempt(person, "COMMIT"), "");
    assert_string_equal(target_of(1), "1");
    assert_string_equal(target_of(2), "0");
    PQfinish(person);

    /* What somebody makes in his own session does not tell what the loops are. */
    cluster_query(cluster, "DELETE FROM apc.tag");
    person = connect_as("operator");
    attempt(person, "CREATE TEMP TABLE tag (table_name text, id int, controller text)");
    attempt(person, "INSERT INTO tag VALUES ('opmode', 1, 'x')");
    attempt(person, "SET search_path TO pg_temp, apc");
    assert_int_equal(insertIntoTableFloat(person, "opmode", 1, "2026-01-31 12:00:00", "ok", 0), APC_ESTORE);
    PQfinish(person);
}

/* ---- Whose a setpoint is ---------------------------------------------------------------- */

#define OWNER (65536 + 16 * 2 + APC_SETPOINT) /* of setpoint 2, which the scheduler moves */

static const char *owner_now(void)
{
    char sql[200];
    snprintf(sql, sizeof sql, "SELECT seq || ':' || value FROM apc.opmode_newest WHERE id = %d AND seq > 0",
             OWNER);
    return cluster_query(cluster, sql);
}

static void make_scheduled(void)
{
    char sql[400];
    snprintf(
        sql, sizeof sql,
        "DELETE FROM apc.tag; DELETE FROM apc.opmode WHERE id = %d; DELETE FROM apc.opmode_newest WHERE id = "
        "%d; INSERT INTO apc.tag (table_name, id, name) VALUES ('setpoint', 1, 'r1'), ('setpoint', 2, "
        "'r2'), ('opmode', %d, 'r2.owner')",
        OWNER, OWNER, OWNER);
    cluster_query(cluster, sql);
}

/* Promise(modes/scheduled-setpoint) */
static void test_what_a_person_writes_to_a_scheduled_setpoint_makes_it_local(void **state)
{
    (void)state;
    make_scheduled();
    assert_int_equal(put_as("scheduler", APC_SETPOINT, 2, 1), 0);
    assert_int_equal(put_as("operator", APC_SETPOINT, 1, 1), 0); /* nobody else moves it */
    assert_string_equal(owner_now(), "");
    assert_int_equal(put_as("operator", APC_SETPOINT, 2, 5), 0); /* without a row it is Remote */
    assert_string_equal(owner_now(), "1:0");
    assert_string_equal(cluster_query(cluster, "SELECT text FROM apc.event ORDER BY id DESC LIMIT 1"),
                        "r2 taken Local, the scheduler stands aside");
    assert_int_equal(put_as("engineer", APC_SETPOINT, 2, 6), 0);
    assert_string_equal(owner_now(), "1:0"); /* it is already */
    assert_int_equal(put_as("operator", APC_OPMODE, OWNER, 1), 0);
    assert_string_equal(owner_now(), "2:1");
    assert_int_equal(put_as("engineer", APC_SETPOINT, 2, 6), 0);
    assert_string_equal(owner_now(), "3:0");
}

/* Written together, as programs do it: what is said of the owner is what holds. */
/* Promise(modes/scheduled-setpoint) */
static void test_who_gives_a_setpoint_away_is_not_taken_at_his_own_row_of_it(void **state)
{
    (void)state;
    struct apc_store *store = open_as("operator");
    struct apc_sample rows[2] = {{.table = APC_OPMODE, .id = OWNER, .value = 1},
                                 {.table = APC_SETPOINT, .id = 2, .value = 6}};
    make_scheduled();
    assert_int_equal(put_as("operator", APC_SETPOINT, 2, 5), 0);
    assert_int_equal(apc_store_read(store, rows, 2), 0);
    rows[0].value = 1;
    assert_int_equal(apc_store_swap(store, rows, 2), 0);
    assert_string_equal(owner_now(), "2:1");
    make_loops();
    struct apc_sample cas[2] = {{.table = APC_OPMODE, .id = 1}, {.table = APC_SETPOINT, .id = 1}};
    assert_int_equal(apc_store_read(store, cas, 2), 0);
    cas[0].value = 3;
    assert_int_equal(apc_store_swap(store, cas, 2), 0);
    assert_string_equal(target_of(1), "3");
    apc_store_close(store);
    cluster_query(cluster, "DELETE FROM apc.tag");
}

static void test_a_target_is_the_operators_and_of_a_loop_that_there_is(void **state)
{
    (void)state;
    struct apc_store *controller = open_as("controller"), *operator_store = open_as("operator");
    struct apc_sample target = {.table = APC_OPMODE, .id = 0, .value = 1},
                      none = {.table = APC_OPMODE, .id = 1, .value = 1};
    assert_int_equal(apc_store_put(controller, &target, 1), APC_EPERM);
    assert_int_equal(apc_store_put(operator_store, &none, 1), APC_EPERM);
    assert_non_null(strstr(apc_store_error(operator_store), "opmode"));
    assert_int_equal(apc_store_put(operator_store, &target, 1), 0);
    assert_int_equal(apc_store_read(controller, &none, 1), 0);
    assert_int_equal(none.seq, 0);
    assert_int_equal(apc_store_read(controller, &target, 1), 0);
    assert_true(target.seq > 0); /* each sees it */
    apc_store_close(operator_store);
    apc_store_close(controller);
}

static void test_nobody_but_the_owner_maintains_the_tables_but_waiting_is_for_readers(void **state)
{
    (void)state;
    struct apc_sample seen = {.table = APC_SENSOR, .id = 1, .seq = INT64_MAX};
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        struct apc_store *store = open_as(rights[r].role);
        struct apc_retention keep = {.size = sizeof keep, .samples = 1};
        assert_int_equal(apc_store_maintain(store, NULL), APC_EPERM);
        assert_int_equal(apc_store_maintain(store, &keep), APC_EPERM);
        assert_int_equal(apc_store_wait(store, &seen, 1, 0), strchr(rights[r].reads, 's') ? 0 : APC_EPERM);
        apc_store_close(store);
    }
}

/*
 * Promise(database/event-names-user): Each event names the user who wrote it; no seq far ahead, no time of
 *   tomorrow; there is room for the next.
 */
static void test_an_event_names_the_user_who_wrote_it(void **state)
{
    (void)state;
    struct apc_store *store = open_as("client");
    struct apc_event e = {.severity = APC_EVENT_INFO, .source = "operator", .kind = "mode", .text = "forged"};
    assert_int_equal(apc_store_append_events(store, &e, 1), 1);
    apc_store_close(store);
    char name[64];
    user_name(name, "client");
    assert_string_equal(cluster_query(cluster, "SELECT role FROM apc.event WHERE text = 'forged'"), name);
}

static int find_one(void *ctx, const struct apc_event *e)
{
    (void)ctx, (void)e;
    return 1;
}

static int find_a_row(void *ctx, const struct apc_timing_row *row)
{
    (void)ctx, (void)row;
    return 1;
}

static void test_everybody_tells_events_and_every_daemon_timing(void **state)
{
    const struct apc_range all = {0};
    (void)state;
    struct apc_event e = {.severity = APC_EVENT_INFO, .source = "test", .kind = "start", .text = "hello"};
    struct apc_timing_row t = {.task = "test", .quantity = "run"};
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        struct apc_store *store = open_as(rights[r].role);
        const bool observer = strcmp(rights[r].role, "observer") == 0; /* who only looks */
        assert_int_equal(apc_store_append_events(store, &e, 1), observer ? APC_EPERM : 1);
        const bool person =
            observer || strcmp(rights[r].role, "operator") == 0 || strcmp(rights[r].role, "engineer") == 0;
        assert_int_equal(apc_store_append_timing(store, &t, 1), person ? APC_EPERM : 1);
        assert_int_equal(apc_store_events(store, &all, find_one, NULL), 1); /* was it stored? */
        assert_int_equal(apc_store_timing(store, &all, find_a_row, NULL), 1);
        assert_int_equal(apc_store_get_tags(store, NULL, 0), 0);
        struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "x", .high = 1};
        assert_int_equal(apc_store_put_tags(store, &tag, 1), APC_EPERM);
        apc_store_close(store);
    }
}

static void test_the_operator_puts_and_the_client_may_not(void **state)
{
    (void)state;
    struct apc_sample s = {.table = APC_TUNING, .id = 1, .value = 0.2};
    struct apc_store *operator_store = open_as("operator"), *client = open_as("client");
    assert_int_equal(apc_store_put(operator_store, &s, 1), 0);
    assert_int_equal(apc_store_put(client, &s, 1), APC_EPERM);
    assert_non_null(strstr(apc_store_error(client), "tuning"));
    apc_store_close(client);
    apc_store_close(operator_store);
}

/*
 * Promise(database/no-superuser): A database whose owner of the tables is no superuser has all of it:
 *   claims by name over roles, after the end of a session, history.
 */
static void test_a_claim_is_refused_by_name_across_roles(void **state)
{
    (void)state;
    int64_t last[1];
    struct apc_store *first = open_as("client"), *second = open_as("client");
    assert_int_equal(apc_store_claim(first, APC_SENSOR, 1, last), 0);
    assert_int_equal(apc_store_claim(second, APC_SENSOR, 1, last), APC_EBUSY);
    assert_non_null(strstr(apc_store_error(second), "already written by client"));
    apc_store_close(second);
    apc_store_close(first);
}

/* A process of the server may have the number of one that is gone, with its claims left in the table. */
/* Promise(database/no-superuser) */
static void test_claims_of_a_session_that_is_gone_are_not_those_of_a_later_one_of_its_number(void **state)
{
    (void)state;
    PGconn *conn = connect_as("controller");
    char sql[300];
    snprintf(
        sql, sizeof sql,
        "INSERT INTO apc.claim SELECT 'tick', 70 + i, 'gone', %d, '2001-01-01' FROM generate_series(1, 2) "
        "AS i",
        PQbackendPID(conn));
    cluster_query(cluster, sql);
    static const char left[] = "SELECT string_agg(id || ' ' || (name = 'gone'), ', ' ORDER BY id) FROM "
                               "apc.claim WHERE table_name = 'tick' AND id > 70";
    assert_string_equal(attempt(conn, "BEGIN"), "");
    assert_string_equal(attempt(conn, "SELECT apc.claim_set('{tick}', '{73}')"), "");
    assert_string_equal(attempt(conn, "ROLLBACK"), ""); /* the session's lock stays */
    assert_string_equal(cluster_query(cluster, left), "71 true, 72 true");
    assert_string_equal(attempt(conn, "SELECT apc.claim_set('{tick}', '{71}')"), "");
    assert_string_equal(cluster_query(cluster, left), "71 false");
    assert_string_equal(attempt(conn, "SELECT apc.claim_set('{tick}', '{73}')"), "");
    assert_string_equal(cluster_query(cluster, left), "71 false, 73 false");
    PQfinish(conn);
}

/* Promise(database/role-row-says) */
static void test_nobody_updates_deletes_or_makes_tables(void **state)
{
    (void)state;
    static const char *const statements[] = {"UPDATE apc.sensor SET value = 0",
                                             "DELETE FROM apc.sensor",
                                             "TRUNCATE apc.sensor",
                                             "UPDATE apc.event SET text = ''",
                                             "INSERT INTO apc.event (role) VALUES ('apc')",
                                             "DELETE FROM apc.event",
                                             "DROP TABLE apc.sensor",
                                             "CREATE TABLE apc.mine (x int)",
                                             "ALTER TABLE apc.sensor ADD x int",
                                             "INSERT INTO apc.migration VALUES (9, '')",
                                             "UPDATE apc.actuator SET value = 0",
                                             "DELETE FROM apc.setpoint",
                                             "DELETE FROM apc.tag"};
    for (size_t r = 0; r < sizeof roles / sizeof roles[0]; r++) {
        PGconn *conn = connect_as(roles[r]);
        for (size_t i = 0; i < sizeof statements / sizeof statements[0]; i++) {
            const char *said = attempt(conn, statements[i]);
            if (strcmp(said, "42501") != 0) {
                fail_msg("%s: %s: %s", roles[r], statements[i], said[0] ? said : "allowed");
            }
        }
        PQfinish(conn);
    }
}

static int keep_none(void *ctx, const struct apc_sample *row)
{
    (void)ctx, (void)row;
    return 0;
}

static void test_who_may_not_see_a_variable_does_not_see_its_past(void **state)
{
    (void)state;
    cluster_query(cluster,
                  "INSERT INTO apc.actuator (id, seq, time, status, value) SELECT 91, s, now() - "
                  "interval '2 hours' + s * interval '20 seconds', 0, s FROM generate_series(1, 9) AS s");
    cluster_query(cluster,
                  "INSERT INTO apc.sensor (id, seq, time, status, value) SELECT id, seq, time, status, "
                  "value FROM apc.actuator WHERE id = 91");
    const char *const time = cluster_query(
        cluster,
        "SELECT (extract(epoch FROM time) * 1e6)::bigint FROM apc.actuator WHERE id = 91 AND seq = 4");
    const apc_ns at = strtoll(time, NULL, 10) * 1000 + APC_NS_PER_S;
    struct apc_store *store = open_as("client"), *past = NULL;
    struct apc_sample seen = {.table = APC_ACTUATOR, .id = 91}, hidden = {.table = APC_SENSOR, .id = 91};
    assert_int_equal(apc_store_past(&past, store, at, NULL), 0);
    assert_int_equal(apc_store_read(past, &seen, 1), 0);
    assert_int_equal(seen.seq, 4);
    assert_int_equal(apc_store_read(past, &hidden, 1), APC_EPERM);
    assert_int_equal(hidden.seq, 0);
    assert_string_equal(apc_store_error(past),
                        "what was then is history, which this role may not read: the database does not "
                        "permit it: permission denied for table sensor_newest");
    assert_int_equal(apc_store_history(past, APC_SENSOR, 91, NULL, keep_none, NULL), APC_EPERM);
    apc_store_close(past);
    apc_store_close(store);
}

static void test_a_user_without_a_role_is_told_so(void **state)
{
    (void)state;
    struct apc_store *store = open_as("nobody");
    assert_int_equal(apc_store_connect(store), APC_EPERM);
    assert_non_null(strstr(apc_store_error(store), "may not use schema \"apc\""));
    assert_int_equal(apc_store_init(store), APC_EPERM);
    apc_store_close(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_role_may_do_what_it_needs_and_no_more),
        cmocka_unit_test(test_a_target_is_the_operators_and_of_a_loop_that_there_is),
        cmocka_unit_test(test_of_a_history_only_the_historian_writes_and_people_ask),
        cmocka_unit_test(test_the_engineer_sets_limits_and_nobody_else_does),
        cmocka_unit_test(test_a_row_bears_its_writers_own_name_and_no_other),
        cmocka_unit_test(test_the_mode_of_all_is_written_to_each_loop_and_a_person_opens_a_cascade),
        cmocka_unit_test(test_what_a_person_writes_to_a_scheduled_setpoint_makes_it_local),
        cmocka_unit_test(test_who_gives_a_setpoint_away_is_not_taken_at_his_own_row_of_it),
        cmocka_unit_test(test_everybody_tells_events_and_every_daemon_timing),
        cmocka_unit_test(test_nobody_but_the_owner_maintains_the_tables_but_waiting_is_for_readers),
        cmocka_unit_test(test_an_event_names_the_user_who_wrote_it),
        cmocka_unit_test(test_the_operator_puts_and_the_client_may_not),
        cmocka_unit_test(test_a_claim_is_refused_by_name_across_roles),
        cmocka_unit_test(test_claims_of_a_session_that_is_gone_are_not_those_of_a_later_one_of_its_number),
        cmocka_unit_test(test_nobody_updates_deletes_or_makes_tables),
        cmocka_unit_test(test_who_may_not_see_a_variable_does_not_see_its_past),
        cmocka_unit_test(test_a_user_without_a_role_is_told_so),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, set_up, tear_down);
    cluster_destroy(cluster);
    return failed;
}
