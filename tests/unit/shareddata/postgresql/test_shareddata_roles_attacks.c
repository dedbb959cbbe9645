/* SPDX-License-Identifier: BSD-3-Clause */
/* sql/roles.sql: nobody becomes the owner, nobody spoils what others count on. */
#include <stdio.h>
#include <string.h>

#include "roles_rig.h"

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
