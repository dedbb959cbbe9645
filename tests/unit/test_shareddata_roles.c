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

static char *read_file(const char *path)
{
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    char *text = calloc(1, 65536);
    assert_non_null(text);
    assert_true(fread(text, 1, 65535, file) > 0);
    fclose(file);
    return text;
}

static const char *const roles[] = {"plant", "client", "controller", "scheduler", "operator", "nobody"};

static int set_up(void **state)
{
    (void)state;
    struct apc_store *store = NULL;
    int err = apc_store_open(&store, cluster_uri(cluster), NULL, NULL);
    err = err ? err : apc_store_init(store);
    apc_store_close(store);
    char *sql = read_file(APC_SQL_DIR "/roles.sql");
    cluster_query(cluster, "SET search_path TO apc");
    cluster_query(cluster, sql);
    cluster_query(cluster, sql); /* harmless to repeat */
    free(sql);
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
        snprintf(drop, sizeof drop, "DROP USER %s", name);
        cluster_query(cluster, drop);
    }
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

/* In the order of enum apc_table: sensor actuator setpoint dim opmode tuning manual state. */
static const struct {
    const char *role, *reads, *appends, *claims;
} rights[] = {
    {"plant", "...d....", "........", "........"},      {"client", ".a.d....", "s.......", "s......."},
    {"controller", "s.pdotms", ".a..o..s", ".a..o..s"}, {"scheduler", "..pd....", "..p.....", "..p....."},
    {"operator", "sapdotms", "..p.otm.", "........"},
};

static void test_each_role_may_do_what_it_needs_and_no_more(void **state)
{
    (void)state;
    int64_t seq = 0;
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        struct apc_store *store = open_as(rights[r].role);
        for (int table = APC_SENSOR; table < APC_TABLE_END; table++) {
            bool target = table == APC_OPMODE && strcmp(rights[r].role, "operator") == 0;
            struct apc_sample s = {
                .table = (enum apc_table)table, .id = target ? 0 : 1, .seq = ++seq, .value = 1};
            int64_t last[1];
            int expect_append = rights[r].appends[table - 1] == '.' ? APC_EPERM : 1;
            int expect_read = rights[r].reads[table - 1] == '.' ? APC_EPERM : 0;
            int expect_claim = rights[r].claims[table - 1] == '.' ? APC_EPERM : 0;
            int append = apc_store_append(store, &s, 1), read = apc_store_read(store, &s, 1),
                claim = apc_store_claim(store, s.table, 1, last);
            if (append != expect_append || read != expect_read || claim != expect_claim) {
                fail_msg("%s, table %s: append %d, read %d, claim %d: %s", rights[r].role,
                         apc_table_name(s.table), append, read, claim, apc_store_error(store));
            }
        }
        apc_store_close(store);
    }
}

static void test_the_controller_may_not_write_the_target_mode_nor_the_operator_the_actual_one(void **state)
{
    (void)state;
    struct apc_store *controller = open_as("controller"), *operator_store = open_as("operator");
    struct apc_sample target = {.table = APC_OPMODE, .id = 0, .seq = 1000, .value = 1},
                      actual = {.table = APC_OPMODE, .id = 1, .seq = 1000, .value = 1};
    assert_int_equal(apc_store_append(controller, &target, 1), APC_EPERM);
    assert_int_equal(apc_store_append(operator_store, &actual, 1), APC_EPERM);
    assert_int_equal(apc_store_put(operator_store, &actual, 1), APC_EPERM);
    assert_non_null(strstr(apc_store_error(operator_store), "opmode"));
    assert_int_equal(apc_store_put(operator_store, &target, 1), 0);
    assert_int_equal(apc_store_append(controller, &actual, 1), 1);
    assert_int_equal(apc_store_append(controller, &actual, 1), 0); /* repeated */
    assert_int_equal(apc_store_read(controller, &target, 1), 0);
    assert_true(target.seq > 0); /* each sees both */
    assert_int_equal(apc_store_read(operator_store, &actual, 1), 0);
    assert_int_equal(actual.seq, 1000);
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
        assert_int_equal(apc_store_wait(store, &seen, 1, 0), rights[r].reads[0] == 's' ? 0 : APC_EPERM);
        apc_store_close(store);
    }
}

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

static void test_everybody_tells_events_and_every_daemon_timing(void **state)
{
    (void)state;
    struct apc_event e = {.severity = APC_EVENT_INFO, .source = "test", .kind = "start", .text = "hello"};
    struct apc_timing_row t = {.task = "test", .quantity = "run"};
    for (size_t r = 0; r < sizeof rights / sizeof rights[0]; r++) {
        struct apc_store *store = open_as(rights[r].role);
        assert_int_equal(apc_store_append_events(store, &e, 1), 1);
        bool person = strcmp(rights[r].role, "operator") == 0;
        assert_int_equal(apc_store_append_timing(store, &t, 1), person ? APC_EPERM : 1);
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
        char name[64];
        user_name(name, roles[r]);
        const char *const keywords[] = {"host", "user", "dbname", NULL};
        const char *const values[] = {cluster_host(cluster), name, cluster_database(cluster), NULL};
        PGconn *conn = PQconnectdbParams(keywords, values, 0);
        assert_int_equal(PQstatus(conn), CONNECTION_OK);
        for (size_t i = 0; i < sizeof statements / sizeof statements[0]; i++) {
            PGresult *result = PQexec(conn, statements[i]);
            const char *sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
            if (!sqlstate || strcmp(sqlstate, "42501") != 0) {
                fail_msg("%s: %s: %s", roles[r], statements[i], sqlstate ? sqlstate : "allowed");
            }
            PQclear(result);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_role_may_do_what_it_needs_and_no_more),
        cmocka_unit_test(test_the_controller_may_not_write_the_target_mode_nor_the_operator_the_actual_one),
        cmocka_unit_test(test_everybody_tells_events_and_every_daemon_timing),
        cmocka_unit_test(test_nobody_but_the_owner_maintains_the_tables_but_waiting_is_for_readers),
        cmocka_unit_test(test_an_event_names_the_user_who_wrote_it),
        cmocka_unit_test(test_the_operator_puts_and_the_client_may_not),
        cmocka_unit_test(test_a_claim_is_refused_by_name_across_roles),
        cmocka_unit_test(test_nobody_updates_deletes_or_makes_tables),
        cmocka_unit_test(test_a_user_without_a_role_is_told_so),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, set_up, tear_down);
    cluster_destroy(cluster);
    return failed;
}
