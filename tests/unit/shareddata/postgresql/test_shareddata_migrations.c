/* SPDX-License-Identifier: BSD-3-Clause */
/* How `apc init` brings a database along, with files of this test's own in the place of those of sql/. */
#include "plants.h"
#include "shareddata/migrations.h"

/* The linker takes these, and leaves the library's in its archive. */
const struct apc_migration apc_migrations[] = {
    {1, false, "0001-baseline",
     "CREATE TABLE migration (version integer PRIMARY KEY, name text, applied_at timestamptz DEFAULT now(), "
     "compatible_from integer); CREATE TABLE repair (name text PRIMARY KEY, applied_at timestamptz DEFAULT "
     "now()); CREATE TABLE event (time timestamptz, severity integer, source text, kind text, text text); "
     "CREATE TABLE thing (id integer)"},
    {2, true, "0002-repair-thing",
     "INSERT INTO thing SELECT 1 / (1 - count(*)::integer) FROM thing WHERE id = 7"},
    {3, false, "0003-more",
     "ALTER TABLE thing ADD COLUMN more integer DEFAULT 3; "
     "INSERT INTO migration (version, name, compatible_from) VALUES (3, '0003-more', 1)"},
    {4, true, "0004-repair-more", "INSERT INTO thing VALUES (2, 2)"},
};
const int apc_migration_count = 4;

static const char *ask(const char *sql)
{
    char path[100];
    snprintf(path, sizeof path, "SET search_path TO plant%d, pg_temp", plant);
    cluster_query(cluster, path);
    return cluster_query(cluster, sql);
}

#define VERSIONS                                                                                             \
    "SELECT string_agg(version || ' ' || name || coalesce(' ' || compatible_from, ''), ', ' ORDER BY "       \
    "version) FROM migration"
#define REPAIRS "SELECT coalesce(string_agg(name, ' ' ORDER BY name), '') FROM repair"
#define EVENTS  "SELECT coalesce(string_agg(text, ', ' ORDER BY text), '') FROM event"

static int set_up_nothing(void **state)
{
    plant++;
    *state = open_direct(LONG);
    return 0;
}

static int tear_down(void **state)
{
    apc_store_close(*state);
    return 0;
}

/* As a library that knew the first so many files left it. */
static void make_former(size_t n)
{
    char sql[200];
    snprintf(sql, sizeof sql, "CREATE SCHEMA plant%d", plant);
    cluster_query(cluster, sql);
    for (size_t i = 0; i < n; i++) {
        const struct apc_migration *m = &apc_migrations[i];
        ask(m->sql);
        snprintf(sql, sizeof sql,
                 m->repair ? "INSERT INTO repair (name) VALUES ('%s')"
                           : "INSERT INTO migration (name, version) VALUES ('%s', %d) ON CONFLICT DO NOTHING",
                 m->name, m->number);
        ask(sql);
    }
}

/*
 * Promise(database/later-versions): Later versions and repairs are applied in their order, each once, wholly
 *   or not at all.
 */
static void test_a_new_database_gets_all_files_and_no_event(void **state)
{
    assert_int_equal(apc_store_version(), 3);
    assert_int_equal(apc_store_init(*state), 0);
    for (int again = 0; again < 2; again++) {
        assert_string_equal(ask(VERSIONS), "1 0001-baseline, 3 0003-more 1");
        assert_string_equal(ask(REPAIRS), "0002-repair-thing 0004-repair-more");
        assert_string_equal(ask(EVENTS), "");
        assert_string_equal(ask("SELECT string_agg(id || ' ' || more, ', ' ORDER BY id) FROM thing"),
                            "1 3, 2 2");
        assert_int_equal(apc_store_init(*state), 3);
    }
}

/* Promise(database/later-versions) */
static void test_a_database_gets_what_it_lacks_and_repairs_are_events(void **state)
{
    static const char *const events[] = {
        "repair 0002-repair-thing of the tables applied, repair 0004-repair-more of the tables applied",
        "repair 0004-repair-more of the tables applied",
        "repair 0004-repair-more of the tables applied",
        "",
    };
    for (size_t n = 1; n <= 4; n++) {
        if (n > 1) {
            tear_down(state);
            set_up_nothing(state);
        }
        make_former(n);
        assert_int_equal(apc_store_init(*state), n < 3 ? 1 : 3);
        assert_string_equal(ask(VERSIONS), "1 0001-baseline, 3 0003-more 1");
        assert_string_equal(ask(REPAIRS), "0002-repair-thing 0004-repair-more");
        assert_string_equal(ask(EVENTS), events[n - 1]);
        assert_string_equal(ask("SELECT count(*) FROM thing"), "2");
    }
}

/* Promise(database/later-versions) */
static void test_a_file_that_fails_leaves_all_as_it_was_and_is_named(void **state)
{
    make_former(1);
    ask("INSERT INTO thing VALUES (7)"); /* what the repair cannot bear */
    assert_true(apc_store_init(*state) < 0);
    assert_says(*state, "0002-repair-thing: ");
    assert_string_equal(ask(VERSIONS), "1 0001-baseline");
    assert_string_equal(ask(REPAIRS), "");
    assert_string_equal(ask("SELECT count(*) FROM thing"), "1");
    ask("DELETE FROM thing");
    assert_int_equal(apc_store_init(*state), 1);
    assert_string_equal(ask(REPAIRS), "0002-repair-thing 0004-repair-more");
}

/* Promise(database/later-versions) */
static void test_a_newer_database_is_given_nothing(void **state)
{
    make_former(1);
    ask("INSERT INTO migration VALUES (9, '0009-future', now(), 3)");
    assert_int_equal(apc_store_init(*state), 9);
    assert_string_equal(ask(REPAIRS), "");
    ask("UPDATE migration SET compatible_from = 4 WHERE version = 9");
    assert_int_equal(apc_store_init(*state), APC_ESCHEMA);
    assert_says(*state, "upgrade libapc");
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up_nothing, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_new_database_gets_all_files_and_no_event),
        T(test_a_database_gets_what_it_lacks_and_repairs_are_events),
        T(test_a_file_that_fails_leaves_all_as_it_was_and_is_named),
        T(test_a_newer_database_is_given_nothing),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
