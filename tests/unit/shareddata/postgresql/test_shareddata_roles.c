/* SPDX-License-Identifier: BSD-3-Clause */
/* sql/roles.sql: what each kind of program may do, and that it may do nothing else. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcshareddata.h"
#include "check.h"
#include "cluster.h"

static struct cluster *cluster;

/* Users are the whole server's, which other tests may share: this program's have its number in them. */
static void user_name(char name[64], const char *role)
{
    snprintf(name, 64, "u_%s_%s", role, cluster_database(cluster));
}

static const char *const roles[] = {"plant",     "client",   "controller", "scheduler", "alarms",
                                    "historian", "operator", "engineer",   "observer",  "nobody"};

/* The tables belong to a role that is no superuser, as docker-compose.yml and a hosted PostgreSQL have it. */
static int set_up(void **state)
{
    (void)state;
    char owner[64], own[300];
    user_name(owner, "owner");
    snprintf(own, sizeof own, "CREATE ROLE %s; CREATE SCHEMA apc AUTHORIZATION %s", owner, owner);
    cluster_query(cluster, own);
    struct apc_store *store = NULL;
    int err = apc_store_open(&store, cluster_uri(cluster), NULL, NULL);
    err = err ? err : apc_store_init(store);
    apc_store_close(store);
    cluster_query(cluster, "SET search_path TO apc");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql"); /* harmless to repeat */
    snprintf(own, sizeof own, "CREATE TABLE loot (who name); ALTER TABLE loot OWNER TO %s", owner);
    cluster_query(cluster, own);
    for (size_t i = 0; i < sizeof roles / sizeof roles[0]; i++) {
        char name[64], create[200];
        user_name(name, roles[i]);
        snprintf(create, sizeof create, "CREATE USER %s", name);
        cluster_query(cluster, create);
        if (strcmp(roles[i], "nobody") != 0) {
            snprintf(create, sizeof create, "GRANT apc_%s TO %s", roles[i], name);
            cluster_query(cluster, create);
        }
    }
    return err != 0;
}

static int tear_down(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof roles / sizeof roles[0]; i++) {
        char name[64], drop[200];
        user_name(name, roles[i]);
        snprintf(drop, sizeof drop, "DROP OWNED BY %s; DROP USER %s", name, name);
        cluster_query(cluster, drop);
    }
    char owner[64], drop[200];
    user_name(owner, "owner");
    snprintf(drop, sizeof drop, "DROP SCHEMA apc CASCADE; DROP OWNED BY %s; DROP ROLE %s", owner, owner);
    cluster_query(cluster, drop);
    return 0;
}

static struct apc_store *open_as(const char *role)
{
    char name[64], uri[600];
    user_name(name, role);
    snprintf(uri, sizeof uri, "postgresql://%s@/%s?host=%s", name, cluster_database(cluster),
             cluster_host(cluster));
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .name = role, .timeout = 30 * APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

static PGconn *connect_as(const char *role)
{
    char name[64];
    user_name(name, role);
    const char *const keywords[] = {"host", "user", "dbname", NULL};
    const char *const values[] = {cluster_host(cluster), name, cluster_database(cluster), NULL};
    PGconn *conn = PQconnectdbParams(keywords, values, 0);
    assert_int_equal(PQstatus(conn), CONNECTION_OK);
    return conn;
}

/* The SQLSTATE, "" when it was done. */
static const char *attempt(PGconn *conn, const char *sql)
{
    static char state[6];
    PGresult *result = PQexec(conn, sql);
    const char *said = PQresultErrorField(result, PG_DIAG_SQLSTATE);
    snprintf(state, sizeof state, "%s", said ? said : "");
    PQclear(result);
    return state;
}

/*
 * In the order of enum apc_table: sensor actuator setpoint dim opmode tuning manual state, actual estimate
 * alarm tick plan prediction.
 */
static const char letters[] = "sapdotm?cerlnh"; /* there is no table state */
struct right {
    const char *role, *reads, *appends, *claims;
};
static const struct right rights[] = {
    {"plant", "d", "", ""},
    {"client", "ad", "s", "s"},
    {"controller", "sapdotmceln", "sapmcelnh", "sapmcelnh"},
    {"scheduler", "pdo", "pn", "pn"},
    {"alarms", "sapdotmcerl", "crl", "crl"},
    {"historian", "sapdotmcerlnh", "potml", "potml"},
    {"operator", "sapdotmcerlnh", "potm", ""},
    {"engineer", "sapdotmcerlnh", "potm", ""},
    {"observer", "sapdotmcerlnh", "", ""},
};
/* Of a store that is a history. */
static const struct right rights_of_history[] = {
    {"plant", "d", "", ""},
    {"client", "ad", "", ""},
    {"controller", "sapdotmceln", "", ""},
    {"scheduler", "pdo", "", ""},
    {"alarms", "sapdotmcerl", "", ""},
    {"historian", "sapdotmcerlnh", "sapdotmcerlnh", "sapdotmcerlnh"},
    {"operator", "sapdotmcerlnh", "", ""},
    {"engineer", "sapdotmcerlnh", "", ""},
    {"observer", "sapdotmcerlnh", "", ""},
};

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

static void test_a_user_without_a_role_is_told_so(void **state)
{
    (void)state;
    struct apc_store *store = open_as("nobody");
    assert_int_equal(apc_store_connect(store), APC_EPERM);
    assert_non_null(strstr(apc_store_error(store), "may not use schema \"apc\""));
    assert_int_equal(apc_store_init(store), APC_EPERM);
    apc_store_close(store);
}

/* ---- Nobody becomes the owner ------------------------------------------------------------------- */

/*
 * Each is a way by which code or names of a caller's own might come into hands with the owner's rights.
 * loot() takes what only the owner may; it is called from wherever PostgreSQL lets a function stand. A
 * statement that is refused does not end an attack.
 */
#define STEPS 12
static const struct {
    const char *by;
    const char *steps[STEPS];
} attacks[] = {
    {"a temporary view that absent() reads",
     {"CREATE TEMP TABLE x (id int, seq bigint)", "INSERT INTO x VALUES (1, 1)",
      "CREATE TEMP VIEW x_newest AS SELECT id FROM x WHERE pg_temp.loot()",
      "GRANT ALL ON x, x_newest TO PUBLIC", "SELECT apc.absent('x', ARRAY[1], ARRAY[1::bigint])",
      "SELECT * FROM apc.claim('x', 1)", "SELECT * FROM apc.claim_set(ARRAY['x'], ARRAY[1])"}},
    {"a temporary table of the name of ours, before it in the search_path",
     {"CREATE TEMP TABLE sensor (id int, seq bigint)", "INSERT INTO sensor VALUES (1, 1)",
      "CREATE TEMP VIEW sensor_newest AS SELECT id, seq FROM sensor WHERE pg_temp.loot()",
      "CREATE TEMP TABLE setpoint (id int, seq bigint)",
      "CREATE TEMP VIEW setpoint_newest AS SELECT id, seq FROM sensor WHERE pg_temp.loot()",
      "GRANT ALL ON sensor, sensor_newest, setpoint, setpoint_newest TO PUBLIC",
      "SET search_path TO pg_temp, apc", "SELECT apc.absent('sensor', ARRAY[1], ARRAY[1::bigint])",
      "SELECT apc.absent('setpoint', ARRAY[1], ARRAY[1::bigint])", "SELECT * FROM apc.claim('sensor', 1)",
      "SELECT * FROM apc.claim('setpoint', 1)"}},
    {"a temporary table of the name of what our functions read",
     {"CREATE TEMP TABLE x (number int, name text, role name)",
      "CREATE TEMP VIEW author AS SELECT * FROM x WHERE pg_temp.loot()",
      "CREATE TEMP VIEW claim AS SELECT 1 AS pid FROM x WHERE pg_temp.loot()",
      "CREATE TEMP VIEW tag AS SELECT 'opmode' AS table_name, 1 AS id, 'c' AS controller WHERE "
      "pg_temp.loot()",
      "CREATE TEMP VIEW setpoint_newest AS SELECT 1 AS id, 1::bigint AS seq WHERE pg_temp.loot()",
      "GRANT ALL ON x, author, claim, tag, setpoint_newest TO PUBLIC", "SET search_path TO pg_temp, apc",
      "SELECT apc.author_number('x')", "SELECT * FROM apc.setpoint_vacant(ARRAY[1], ARRAY[-1]::bigint[])",
      "SELECT * FROM apc.claim_set(ARRAY['setpoint', 'sensor'], ARRAY[1, 1])",
      "SELECT apc.claim_release(ARRAY['setpoint'], ARRAY[1])",
      "INSERT INTO apc.opmode VALUES (0, 1, now(), 0, 3)"}},
    {"our row triggers on a temporary table of such a name",
     {"CREATE TEMP TABLE setpoint (LIKE apc.setpoint)",
      "CREATE TEMP VIEW setpoint_newest AS SELECT 1 AS id, 1::bigint AS seq WHERE pg_temp.loot()",
      "GRANT ALL ON setpoint, setpoint_newest TO PUBLIC",
      "CREATE TRIGGER t BEFORE INSERT ON setpoint FOR EACH ROW EXECUTE FUNCTION apc.setpoint_held()",
      "CREATE TRIGGER u AFTER INSERT ON setpoint FOR EACH ROW EXECUTE FUNCTION apc.setpoint_local()",
      "CREATE TRIGGER v AFTER INSERT ON setpoint FOR EACH ROW EXECUTE FUNCTION apc.request_made()",
      "INSERT INTO pg_temp.setpoint VALUES (1, 1, now(), 0, 666)"}},
    {"functions of the names of the server's",
     {"CREATE FUNCTION pg_temp.format(text, text) RETURNS text LANGUAGE plpgsql AS 'BEGIN PERFORM "
      "pg_temp.loot(); "
      "RETURN ''SELECT''; END'",
      "CREATE FUNCTION pg_temp.has_table_privilege(name, oid, text) RETURNS boolean LANGUAGE sql AS "
      "'SELECT pg_temp.loot()'",
      "CREATE FUNCTION pg_temp.pg_notify(text, text) RETURNS void LANGUAGE plpgsql AS 'BEGIN PERFORM "
      "pg_temp.loot(); "
      "END'",
      "SET search_path TO pg_temp, pg_catalog, apc",
      "SELECT apc.absent('sensor', ARRAY[1], ARRAY[1::bigint])",
      "SELECT apc.absent('setpoint', ARRAY[1], ARRAY[1::bigint])",
      "SELECT apc.absent('actuator', ARRAY[1], ARRAY[1::bigint])", "SELECT * FROM apc.claim('sensor', 1)",
      "INSERT INTO apc.tuning VALUES (90, 1, now(), 0, 0)"}},
    {"operators of the names of the server's",
     {"CREATE FUNCTION pg_temp.eq(int, int) RETURNS boolean LANGUAGE sql AS 'SELECT pg_temp.loot()'",
      "CREATE OPERATOR pg_temp.= (LEFTARG = int, RIGHTARG = int, FUNCTION = pg_temp.eq)",
      "SET search_path TO pg_temp, pg_catalog, apc",
      "SELECT apc.absent('sensor', ARRAY[1], ARRAY[1::bigint])",
      "SELECT apc.absent('setpoint', ARRAY[1], ARRAY[1::bigint])",
      "INSERT INTO apc.setpoint VALUES (90, 1, now(), 0, 0)",
      "INSERT INTO apc.sensor VALUES (90, 1, now(), 0, 0)"}},
    {"a type with a cast, in a temporary table with our trigger",
     {"CREATE TYPE pg_temp.evil AS (i int)",
      "CREATE FUNCTION pg_temp.cast_evil(pg_temp.evil) RETURNS int LANGUAGE plpgsql AS 'BEGIN PERFORM "
      "pg_temp.loot(); "
      "RETURN 90; END'",
      "CREATE CAST (pg_temp.evil AS int) WITH FUNCTION pg_temp.cast_evil(pg_temp.evil) AS ASSIGNMENT",
      "CREATE TEMP TABLE t (id pg_temp.evil, seq bigint, time timestamptz, status bigint, value float8)",
      "CREATE TRIGGER t AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.sensor_appended()",
      "CREATE TRIGGER u AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.setpoint_appended()",
      "CREATE TRIGGER v AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.tuning_appended()",
      "CREATE TRIGGER w AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.opmode_appended()",
      "INSERT INTO t VALUES (ROW(1), 1, now(), 0, 1)"}},
    {"our trigger on a temporary table: rows that were never appended",
     {"CREATE TEMP TABLE t (id int, seq bigint, time timestamptz, status bigint, value float8, sensor_seq "
      "bigint, "
      "setpoint_seq bigint)",
      "CREATE TRIGGER t AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.sensor_appended()",
      "INSERT INTO t VALUES (1, 500, now(), 0, 666)", "DROP TRIGGER t ON t",
      "CREATE TRIGGER t AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
      "apc.actuator_appended()",
      "INSERT INTO t VALUES (1, 500, now(), 0, 666)", "DROP TRIGGER t ON t",
      "CREATE TRIGGER t AFTER INSERT ON t REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION apc.dim_appended()",
      "INSERT INTO t VALUES (1, 500, now(), 0, 666)", "SELECT apc.sensor_appended()"}},
    {"a domain whose check runs in an argument",
     {"CREATE DOMAIN pg_temp.d AS int CHECK (pg_temp.loot())",
      "CREATE DOMAIN pg_temp.e AS text CHECK (pg_temp.loot())",
      "SELECT apc.absent('sensor', ARRAY[1::pg_temp.d]::int[], ARRAY[1::bigint])",
      "SELECT apc.absent('setpoint'::pg_temp.e, ARRAY[1::pg_temp.d]::int[], ARRAY[1::bigint])",
      "SELECT * FROM apc.claim('sensor'::pg_temp.e, 1::pg_temp.d)"}},
    {"quoted names",
     {"SELECT apc.absent('sensor_newest\" WHERE pg_temp.loot() --', ARRAY[1], ARRAY[1::bigint])",
      "SELECT * FROM apc.claim('sensor\"; SELECT pg_temp.loot(); --', 1)",
      "SELECT * FROM apc.claim_set(ARRAY['sensor\"; SELECT pg_temp.loot(); --'], ARRAY[1])",
      "SELECT * FROM apc.claim_set(ARRAY['loot', NULL], ARRAY[1, 1])",
      "SELECT apc.absent('pg_temp.x', ARRAY[1], ARRAY[1::bigint])",
      "SELECT * FROM apc.claim('\"sensor\"', 1)", "SELECT apc.absent('loot', ARRAY[1], ARRAY[1::bigint])",
      "SELECT apc.absent(NULL, ARRAY[1], ARRAY[1::bigint])", "SELECT * FROM apc.claim(NULL, 1)",
      "SELECT apc.absent('migration', NULL, NULL)"}},
    {"partitions and heirs of our tables",
     {"CREATE TEMP TABLE p PARTITION OF apc.sensor FOR VALUES FROM ('2001-01-01') TO ('2001-01-08')",
      "CREATE TEMP TABLE q (LIKE apc.sensor)",
      "ALTER TABLE apc.sensor ATTACH PARTITION q FOR VALUES FROM ('2001-01-01') "
      "TO ('2001-01-08')",
      "CREATE TEMP TABLE h () INHERITS (apc.tuning)",
      "ALTER TABLE apc.sensor DETACH PARTITION apc.sensor_rest", "SELECT apc.make_partition('sensor', 'x')",
      "SELECT apc.make_week('sensor', '2001-01-01', '2001-01-01')",
      "SELECT apc.drop_week('sensor', 'sensor_rest')",
      "CALL apc.maintain(now(), now(), now(), now(), NULL)"}},
    {"event triggers, and triggers, rules and policies on our tables",
     {"CREATE FUNCTION pg_temp.fire() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN PERFORM pg_temp.loot(); "
      "RETURN NEW; "
      "END'",
      "CREATE FUNCTION pg_temp.event() RETURNS event_trigger LANGUAGE plpgsql AS 'BEGIN PERFORM "
      "pg_temp.loot(); END'",
      "CREATE EVENT TRIGGER mine ON ddl_command_start EXECUTE FUNCTION pg_temp.event()",
      "CREATE TRIGGER mine BEFORE INSERT ON apc.event FOR EACH ROW EXECUTE FUNCTION pg_temp.fire()",
      "CREATE TRIGGER mine BEFORE INSERT ON apc.sensor_newest FOR EACH ROW EXECUTE FUNCTION pg_temp.fire()",
      "CREATE RULE mine AS ON INSERT TO apc.event DO ALSO SELECT pg_temp.loot()",
      "CREATE POLICY mine ON apc.opmode USING (pg_temp.loot())", "ALTER TABLE apc.sensor DISABLE TRIGGER ALL",
      "ALTER TABLE apc.opmode DISABLE ROW LEVEL SECURITY", "SET session_replication_role TO replica"}},
    {"default privileges and memberships",
     {"ALTER DEFAULT PRIVILEGES FOR ROLE apc GRANT ALL ON TABLES TO PUBLIC",
      "ALTER DEFAULT PRIVILEGES IN SCHEMA apc GRANT ALL ON TABLES TO PUBLIC", "GRANT apc TO CURRENT_USER",
      "ALTER ROLE CURRENT_USER SUPERUSER", "SET ROLE apc", "SELECT pg_temp.loot()",
      "SET SESSION AUTHORIZATION apc", "SELECT pg_temp.loot()", "GRANT ALL ON apc.loot TO PUBLIC",
      "GRANT INSERT ON apc.sensor TO CURRENT_USER", "SELECT set_config('role', 'apc', false)"}},
    {"our functions made anew, or their settings changed",
     {"CREATE OR REPLACE FUNCTION apc.writable(target text) RETURNS oid LANGUAGE sql AS 'SELECT 1::oid'",
      "ALTER FUNCTION apc.absent(text, int[], bigint[]) SET search_path TO pg_temp",
      "ALTER FUNCTION apc.claim(text, int) RESET ALL",
      "ALTER FUNCTION apc.sensor_appended() SECURITY INVOKER", "ALTER FUNCTION pg_temp.loot() OWNER TO apc",
      "ALTER FUNCTION pg_temp.loot() SECURITY DEFINER", "SELECT pg_temp.loot()",
      "CREATE FUNCTION apc.mine() RETURNS int LANGUAGE sql AS 'SELECT 1'",
      "CREATE TABLE apc.sensor_20010101 (LIKE apc.sensor)", "CREATE SCHEMA mine",
      "SELECT apc.writable('sensor')"}},
    {"what the owner's maintenance might run",
     {"CREATE FUNCTION pg_temp.index(int) RETURNS int IMMUTABLE LANGUAGE plpgsql AS 'BEGIN PERFORM "
      "pg_temp.loot(); "
      "RETURN 1; END'",
      "CREATE TEMP TABLE sensor_20010101 (id int, seq bigint)",
      "CREATE INDEX ON sensor_20010101 (pg_temp.index(id))", "INSERT INTO sensor_20010101 VALUES (1, 1)",
      "CREATE TABLE public.event (time timestamptz)",
      "CREATE OPERATOR CLASS mine FOR TYPE int USING btree AS STORAGE int",
      "COPY (SELECT 1) TO PROGRAM 'true'", "CREATE EXTENSION dblink", "CREATE LANGUAGE mine HANDLER loot"}},
};

/* Promise(database/role-row-says) */
static void test_nobody_becomes_the_owner(void **state)
{
    (void)state;
    int successes = 0;
    for (size_t r = 0; r < sizeof roles / sizeof roles[0]; r++) {
        for (size_t a = 0; a < sizeof attacks / sizeof attacks[0]; a++) {
            PGconn *conn = connect_as(roles[r]);
            attempt(conn, "SET client_min_messages TO error");
            assert_string_equal(
                attempt(
                    conn,
                    "CREATE FUNCTION pg_temp.loot() RETURNS boolean LANGUAGE plpgsql AS 'BEGIN INSERT INTO "
                    "apc.loot VALUES (current_user); RETURN true; EXCEPTION WHEN OTHERS THEN RETURN true; "
                    "END'"),
                "");
            for (size_t s = 0; s < STEPS && attacks[a].steps[s]; s++) {
                attempt(conn, attacks[a].steps[s]);
            }
            struct apc_store *owner = NULL;
            assert_int_equal(apc_store_open(&owner, cluster_uri(cluster), NULL, NULL), 0);
            assert_true(apc_store_maintain(owner, NULL) >= 0); /* while its session is there */
            apc_store_close(owner);
            PQfinish(conn);
            const char *taken = cluster_query(
                cluster,
                "SELECT (SELECT count(*) FROM apc.loot) + (SELECT count(*) FROM apc.sensor_newest WHERE "
                "value = "
                "666) + (SELECT count(*) FROM apc.actuator_newest WHERE value = 666) + (SELECT count(*) FROM "
                "apc.dim_newest WHERE value = 666) + (SELECT count(*) FROM pg_roles WHERE rolsuper AND "
                "rolname "
                "LIKE 'u\\_%')");
            if (strcmp(taken, "0") != 0) {
                print_error("%s took %s with the owner's rights, by %s\n", roles[r], taken, attacks[a].by);
                successes++;
                cluster_query(cluster,
                              "DELETE FROM apc.loot; DELETE FROM apc.sensor_newest WHERE value = 666; "
                              "DELETE FROM apc.actuator_newest WHERE value = 666; DELETE FROM "
                              "apc.dim_newest WHERE value = 666");
            }
        }
    }
    assert_int_equal(successes, 0);
}

/* An attack that has made its objects already, before the tables were repaired. */
static void test_a_trigger_function_refuses_every_table_but_its_own(void **state)
{
    (void)state;
    cluster_query(cluster,
                  "CREATE TABLE mine (id int, seq bigint, time timestamptz, status bigint, value float8); "
                  "CREATE TRIGGER t AFTER INSERT ON mine REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION "
                  "apc.sensor_appended(); GRANT INSERT ON mine TO apc_plant");
    PGconn *conn = connect_as("plant");
    assert_string_equal(attempt(conn, "INSERT INTO apc.mine VALUES (77, 1, now(), 0, 1)"), "42501");
    PQfinish(conn);
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.sensor_newest WHERE id = 77"), "0");
    cluster_query(cluster, "DROP TABLE mine");
}

/* Promise(database/role-row-says) */
static void test_every_function_with_the_owners_rights_has_its_search_path_and_no_public(void **state)
{
    (void)state;
    assert_string_equal(
        cluster_query(cluster,
                      "SELECT string_agg(proname, ' ') FROM pg_proc WHERE pronamespace = 'apc'::regnamespace "
                      "AND (has_function_privilege('public', oid, 'EXECUTE') OR prosecdef AND "
                      "(proconfig @> ARRAY['search_path=apc, pg_temp']) IS NOT TRUE)"),
        "");
    assert_string_equal(cluster_query(cluster,
                                      "SELECT count(*) FROM pg_proc WHERE pronamespace = 'apc'::regnamespace "
                                      "AND prosecdef"),
                        "30");
}

static void test_in_a_database_of_its_own_nobody_makes_temporary_tables_or_takes_locks(void **state)
{
    (void)state;
    static const char *const refused[] = {
        "CREATE TEMP TABLE t (i int)",
        "CREATE FUNCTION pg_temp.f() RETURNS int LANGUAGE sql AS 'SELECT 1'",
        "SELECT pg_advisory_lock(1)",
        "SELECT pg_try_advisory_lock_shared(6385763, 1)",
        "SELECT pg_advisory_xact_lock(1)",
        "CREATE TABLE public.t (i int)"};
    cluster_query_file(cluster, APC_SQL_DIR "/database.sql");
    cluster_query_file(cluster, APC_SQL_DIR "/database.sql"); /* harmless to repeat */
    for (size_t r = 0; r + 1 < sizeof roles / sizeof roles[0]; r++) {
        PGconn *conn = connect_as(roles[r]);
        for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
            const char *said = attempt(conn, refused[i]);
            if (strcmp(said, "42501") != 0) {
                fail_msg("%s: %s: %s", roles[r], refused[i], said[0] ? said : "allowed");
            }
        }
        PQfinish(conn);
    }
    int64_t last[1];
    struct apc_store *client = open_as("client"), *nobody = open_as("nobody");
    assert_int_equal(apc_store_claim(client, APC_SENSOR, 1, last), 0);
    assert_int_equal(apc_store_connect(nobody), APC_ECONN);
    assert_non_null(strstr(apc_store_error(nobody), "permission denied for database"));
    apc_store_close(nobody);
    apc_store_close(client);
}

/* ---- Nobody spoils what others count on --------------------------------------------------------------- */

/* Promise(database/event-names-user) */
static void test_a_persons_value_is_the_successor_of_the_newest(void **state)
{
    (void)state;
    static const struct {
        const char *table;
        int id;
    } values[] = {{"setpoint", 60}, {"tuning", 60}, {"manual", 60}, {"opmode", 0}};
    static const char *const writers[] = {"operator", "scheduler"};
    for (size_t w = 0; w < 2; w++) {
        PGconn *conn = connect_as(writers[w]);
        struct apc_store *store = open_as(writers[w]);
        for (size_t v = 0; v < (w == 0 ? sizeof values / sizeof values[0] : 1); v++) {
            struct apc_sample s = {.table = apc_table_parse(values[v].table), .id = values[v].id, .value = 1};
            assert_int_equal(apc_store_put(store, &s, 1), 0);
            int64_t newest = s.seq;
            const int64_t wrong[] = {INT64_MAX,
                                     (INT64_C(1) << 62) - 1,
                                     (INT64_C(1) << 53) - 1,
                                     newest + 1000,
                                     newest + 2,
                                     newest - 1,
                                     0};
            for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
                char sql[200];
                snprintf(sql, sizeof sql, "INSERT INTO apc.%s VALUES (%d, %lld, now(), 0, 1)",
                         values[v].table, values[v].id, (long long)wrong[i]);
                const char *said = attempt(conn, sql);
                if (strcmp(said, "23514") != 0 && !(wrong[i] == newest - 1 && strcmp(said, "23505") == 0)) {
                    fail_msg("%s: %s: %s", writers[w], sql, said[0] ? said : "taken");
                }
            }
            assert_int_equal(apc_store_put(store, &s, 1), 0);
            assert_int_equal(s.seq, newest + 1);
            assert_int_equal(apc_store_swap(store, &s, 1), 0);
            assert_int_equal(s.seq, newest + 2);
            assert_int_equal(
                insertIntoTableFloat(conn, values[v].table, values[v].id, "2026-01-31 12:00:00", "ok", 1), 0);
            s.seq = newest + 4;
            assert_int_equal(apc_store_append(store, &s, 1), 1);
        }
        apc_store_close(store);
        PQfinish(conn);
    }
    PGconn *conn = connect_as("operator"); /* two of one variable in one command */
    assert_string_equal(
        attempt(conn, "INSERT INTO apc.tuning VALUES (61, 1, now(), 0, 1), (61, 2, now(), 0, 1)"), "23514");
    assert_string_equal(
        attempt(conn, "INSERT INTO apc.tuning VALUES (61, 1, now(), 0, 1), (62, 1, now(), 0, 1)"), "");
    PQfinish(conn);
}

/* A daemon's count has gaps, where samples were lost; what it cannot be is ahead of every count. */
/* Promise(database/event-names-user) */
static void test_whatever_a_role_wrote_there_is_room_for_the_next_sample(void **state)
{
    (void)state;
    static const struct {
        const char *role;
        enum apc_table table;
    } writers[] = {{"client", APC_SENSOR},
                   {"controller", APC_ACTUATOR},
                   {"controller", APC_ACTUAL},
                   {"controller", APC_ESTIMATE}};
    for (size_t w = 0; w < sizeof writers / sizeof writers[0]; w++) {
        struct apc_store *store = open_as(writers[w].role);
        struct apc_sample s = {.table = writers[w].table, .id = 1, .seq = 5000};
        assert_int_equal(apc_store_append(store, &s, 1), 1);
        s.seq += 4000000;
        assert_int_equal(apc_store_append(store, &s, 1), 1);
        const int64_t seconds = apc_clock_utc(NULL) / APC_NS_PER_S - 1577836800;
        const int64_t ahead[] = {INT64_MAX, (INT64_C(1) << 62) - 1, (INT64_C(1) << 53) - 1,
                                 (seconds + 86400) << 20};
        for (size_t i = 0; i < sizeof ahead / sizeof ahead[0]; i++) {
            s.seq = ahead[i];
            assert_int_equal(apc_store_append(store, &s, 1), APC_ESTORE);
            assert_non_null(strstr(apc_store_error(store), "seq_in_range"));
        }
        s.seq = (seconds - 2) << 20; /* as far ahead as it goes */
        assert_int_equal(apc_store_append(store, &s, 1), 1);
        for (int i = 0; i < 3; i++) {
            s.seq++;
            assert_int_equal(apc_store_append(store, &s, 1), 1);
        }
        apc_store_close(store);
    }
}

/* Whatever table it is: a row of 2200, or with a number that no count has reached, is nobody's to write. */
/*
 * Promise(database/role-writes-time): No role writes a time or number that is far ahead, into whatever
 *   table; what is refused so keeps no other event back and is told; a row of timing names its writer.
 */
static void test_nobody_writes_far_ahead_into_any_table(void **state)
{
    (void)state;
    static const char *const far[] = {"'2200-01-01'", "now() + interval '2 days'"};
    char sql[400];
    cluster_query(cluster, "DELETE FROM apc.sensor_newest WHERE time > now()"); /* of a clock that is wrong */
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        PGconn *conn = connect_as(rights[r].role);
        for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
            if (table == APC_STATE) {
                continue;
            }
            const char *name = apc_table_name((enum apc_table)table);
            const char *value = apc_table_vectors((enum apc_table)table) ? "'{1}'" : "1";
            const char *may = strchr(rights[r].appends, letters[table - 1]) ? "23514" : "42501";
            const int id = table == APC_OPMODE ? 0 : 77;
            for (size_t i = 0; i < 3; i++) {
                snprintf(sql, sizeof sql,
                         "INSERT INTO apc.%s (id, seq, time, status, value) VALUES (%d, %s, %s, 0, %s)", name,
                         id, i < 2 ? "1" : "9007199254740991", i < 2 ? far[i] : "now()", value);
                if (strcmp(attempt(conn, sql), may) != 0 && strcmp(attempt(conn, sql), "23505") != 0) {
                    fail_msg("%s: %s: \"%s\"", rights[r].role, sql, attempt(conn, sql));
                }
            }
        }
        const bool observer = strcmp(rights[r].role, "observer") == 0;
        const char *event = observer ? "42501" : "23514";
        const char *timing = observer || strchr("oe", rights[r].role[0]) ? "42501" : "23514";
        for (size_t i = 0; i < 2; i++) {
            snprintf(sql, sizeof sql,
                     "INSERT INTO apc.event (time, severity, source, kind, text) VALUES (%s, 3, 'x', "
                     "'alarm', 'far')",
                     far[i]);
            assert_string_equal(attempt(conn, sql), event);
            snprintf(sql, sizeof sql,
                     "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, "
                     "p99, max, "
                     "bin_low, bin_high, bin_count) VALUES (%s, 'controller', 'run', 1, 0, 0, 0, 0, 0, 0, 0, "
                     "'{}', "
                     "'{}', '{}')",
                     far[i]);
            assert_string_equal(attempt(conn, sql), timing);
        }
        assert_string_equal(attempt(conn,
                                    "INSERT INTO apc.event (time, severity, source, kind, text, seq) VALUES "
                                    "(now(), 3, 'x', 'alarm', 'far', 9007199254740991)"),
                            event);
        PQfinish(conn);
    }
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.event WHERE text = 'far'"), "0");
    cluster_query(cluster,
                  "INSERT INTO apc.event (time, severity, source, kind, text) VALUES ('2200-01-01', 1, 'x', "
                  "'x', 'the owner''s')"); /* who may */
    cluster_query(cluster, "DELETE FROM apc.event WHERE time > now()");
}

/* task is what a program says; role is what it is. */
/* Promise(database/role-writes-time) */
static void test_a_row_of_timing_names_the_user_who_wrote_it(void **state)
{
    (void)state;
    char name[64];
    struct apc_store *store = open_as("client");
    const struct apc_timing_row t = {.task = "controller", .quantity = "run", .time = 12345000};
    assert_int_equal(apc_store_append_timing(store, &t, 1), 1);
    struct apc_timing_row late = {
        .task = "controller", .quantity = "run", .time = INT64_C(7258118400) * APC_NS_PER_S};
    assert_int_equal(apc_store_append_timing(store, &late, 1), APC_ERANGE);
    const struct apc_event e = {
        .severity = APC_EVENT_INFO, .source = "t", .kind = "t", .text = "t", .time = late.time};
    assert_int_equal(apc_store_append_events(store, &e, 1), APC_ERANGE);
    assert_non_null(strstr(apc_store_error(store), "more than a day ahead"));
    apc_store_close(store);
    user_name(name, "client");
    assert_string_equal(cluster_query(cluster, "SELECT role FROM apc.timing ORDER BY id DESC LIMIT 1"), name);
    PGconn *conn = connect_as("client");
    assert_string_equal(
        attempt(conn, "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, "
                      "p50, p99, max, bin_low, bin_high, bin_count, role) VALUES (now(), 'x', 'run', "
                      "1, 0, 0, 0, 0, 0, 0, 0, '{}', '{}', '{}', 'somebody')"),
        "42501");
    PQfinish(conn);
}

static void
test_no_role_writes_a_time_that_is_far_ahead_but_old_ones_and_stepped_clocks_are_taken(void **state)
{
    (void)state;
    const apc_ns now = apc_clock_utc(NULL), day = 86400 * APC_NS_PER_S;
    static const struct {
        const char *role;
        enum apc_table table;
        int id;
    } writers[] = {{"client", APC_SENSOR, 70},     {"controller", APC_ACTUATOR, 70},
                   {"controller", APC_ACTUAL, 70}, {"scheduler", APC_SETPOINT, 70},
                   {"operator", APC_TUNING, 70},   {"operator", APC_MANUAL, 70}};
    struct apc_store *owner = NULL;
    assert_int_equal(apc_store_open(&owner, cluster_uri(cluster), NULL, NULL), 0);
    for (size_t w = 0; w < sizeof writers / sizeof writers[0]; w++) {
        struct apc_store *store = open_as(writers[w].role);
        struct apc_sample s = {.table = writers[w].table, .id = writers[w].id, .seq = 1, .time = now};
        const apc_ns good[] = {now, now + day / 2, now - day / 24, now + day / 24, 0, now - 400 * day};
        for (size_t i = 0; i < sizeof good / sizeof good[0]; i++, s.seq++) {
            s.time = good[i];
            assert_int_equal(apc_store_append(store, &s, 1), 1);
        }
        const apc_ns bad[] = {now + 2 * day, now + 365 * day, INT64_C(7258118400) * APC_NS_PER_S /* 2200 */};
        for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
            s.time = bad[i];
            assert_int_equal(apc_store_append(store, &s, 1), APC_ESTORE);
            assert_non_null(strstr(apc_store_error(store), "more than a day ahead"));
        }
        /* As it is for this server when its own clock went back: the samples go on as they did. */
        s.time = now + 365 * day;
        assert_int_equal(apc_store_append(owner, &s, 1), 1);
        s.seq++;
        s.time += APC_NS_PER_S;
        assert_int_equal(apc_store_append(store, &s, 1), 1);
        apc_store_close(store);
    }
    apc_store_close(owner);
}

/* Promise(database/event-names-user) */
static void test_an_operator_who_leaves_a_transaction_open_holds_up_no_controller(void **state)
{
    (void)state;
    PGconn *person = connect_as("operator");
    struct apc_store *controller = open_as("controller");
    struct apc_sample actual = {.table = APC_ACTUAL, .id = 1}, u = {.table = APC_ACTUATOR, .id = 1};
    assert_int_equal(apc_store_read(controller, &actual, 1), 0);
    assert_string_equal(attempt(person, "BEGIN"), "");
    static const char *const locks[] = {"SELECT apc.absent('opmode', ARRAY[0, 1], ARRAY[1, 1]::bigint[])",
                                        "SELECT * FROM apc.actual_newest FOR UPDATE",
                                        "SELECT * FROM apc.actual_newest FOR KEY SHARE",
                                        "LOCK TABLE apc.actuator, apc.opmode IN SHARE MODE",
                                        "SELECT * FROM apc.opmode, apc.sensor, apc.actuator, apc.actual"};
    for (size_t i = 0; i < sizeof locks / sizeof locks[0]; i++) {
        attempt(person, "SAVEPOINT s");
        if (attempt(person, locks[i])[0]) { /* what was allowed keeps its locks */
            attempt(person, "ROLLBACK TO s");
        }
    }
    actual.seq++;
    u.seq = (int64_t)1 << 46;
    struct apc_sample both[2] = {actual, u};
    assert_int_equal(apc_store_append(controller, both, 2), 2);
    apc_store_close(controller);
    PQfinish(person);
}

/* Promise(database/event-names-user) */
static void test_nobody_takes_the_numbers_of_rows_to_come(void **state)
{
    (void)state;
    for (size_t r = 0; r < sizeof roles / sizeof roles[0]; r++) {
        PGconn *conn = connect_as(roles[r]);
        assert_string_equal(
            attempt(conn, "INSERT INTO apc.timing (id, time, task, quantity, period, missed, count, mean, "
                          "sd, p50, p99, max, bin_low, bin_high, bin_count) OVERRIDING SYSTEM VALUE VALUES "
                          "(1000, now(), 'x', 'run', 1, 0, 0, 0, 0, 0, 0, 0, '{}', '{}', '{}')"),
            "42501");
        assert_string_equal(
            attempt(conn, "INSERT INTO apc.event (id, time, severity, source, kind, text) OVERRIDING "
                          "SYSTEM VALUE VALUES (1000, now(), 1, '', '', '')"),
            "42501");
        PQfinish(conn);
    }
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
        cmocka_unit_test(test_a_user_without_a_role_is_told_so),
        cmocka_unit_test(test_nobody_becomes_the_owner),
        cmocka_unit_test(test_a_trigger_function_refuses_every_table_but_its_own),
        cmocka_unit_test(test_every_function_with_the_owners_rights_has_its_search_path_and_no_public),
        cmocka_unit_test(test_a_persons_value_is_the_successor_of_the_newest),
        cmocka_unit_test(test_whatever_a_role_wrote_there_is_room_for_the_next_sample),
        cmocka_unit_test(test_nobody_writes_far_ahead_into_any_table),
        cmocka_unit_test(test_a_row_of_timing_names_the_user_who_wrote_it),
        cmocka_unit_test(
            test_no_role_writes_a_time_that_is_far_ahead_but_old_ones_and_stepped_clocks_are_taken),
        cmocka_unit_test(test_an_operator_who_leaves_a_transaction_open_holds_up_no_controller),
        cmocka_unit_test(test_nobody_takes_the_numbers_of_rows_to_come),
        cmocka_unit_test(
            test_in_a_database_of_its_own_nobody_makes_temporary_tables_or_takes_locks), /* for good */
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, set_up, tear_down);
    cluster_destroy(cluster);
    return failed;
}
