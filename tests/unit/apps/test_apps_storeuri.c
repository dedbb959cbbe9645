/* SPDX-License-Identifier: BSD-3-Clause */
/* What programs say of the store they were given, which may have a password in it; what they end with. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "common/exitcode.h"
#include "common/storeuri.h"

static const char *const environment[] = {"PGSERVICE", "PGHOST", "PGPORT", "PGDATABASE", "PGUSER"};

static int no_environment(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof environment / sizeof *environment; i++)
        unsetenv(environment[i]);
    return 0;
}

static void assert_named(const char *uri, const char *expected)
{
    char name[300];
    store_name(uri, name, sizeof name);
    assert_string_equal(name, expected);
}

/* Promise(stores/password-shown) */
static void a_password_is_not_shown(void **state)
{
    static const char *const of[][2] = {
        {"postgresql://apc:secret@host/db#plant", "postgresql://apc:***@host/db#plant"},
        {"postgresql://apc:se:cr@et@host:5432/db", "postgresql://apc:***@host:5432/db"},
        {"postgresql://:secret@/db", "postgresql://:***@/db"},
        {"postgresql:apc:secret@host", "postgresql:***"},
        {"postgresql:host=h password=secret", "postgresql:***"},
        {"host=h password=secret", "***"},
        {"postgres//apc:secret@host", "***"},
        {"postgresql://apc:secret", "postgresql://***"},
        {"postgresql://apc:sec/ret@host/db", "postgresql://apc:***@host/db"},
        {"postgresql://host/db&password=secret", "postgresql://host***"},
        {"postgresql://host/db;password=secret", "postgresql://host***"},
        {"postgresql://host/db?host=x?password=secret", "postgresql://host/db?host=***"},
        {"postgresql://host/db?user=u password=secret", "postgresql://host/db?user=***"},
        {"postgresql://host/db?password=sec&ret", "postgresql://host/db?password=***&***"},
        {"postgresql://host/db#sec ret", "postgresql://host/db***"},
        {"shm:plant+postgresql://apc:secret@host:1x/db", "shm:plant+postgresql://apc:***@***/db"},
        {"postgresql:///db?password=secret", "postgresql:///db?password=***"},
        {"postgresql:///db?password=secret#plant", "postgresql:///db?password=***#plant"},
        {"postgresql:///db?host=/run&sslpassword=secret&port=5433",
         "postgresql:///db?host=/run&sslpassword=***&port=5433"},
        {"postgresql:///db?password=a=b&password=c", "postgresql:///db?password=***&password=***"},
        {"postgresql:///db?passfile=/a&hostx=1&hos=2&=3",
         "postgresql:///db?passfile=***&hostx=***&hos=***&=***"},
        {"postgresql://a:b@h/?password=c", "postgresql://a:***@h/?password=***"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_named(of[i][0], of[i][1]);
}

static void what_is_no_secret_is_shown(void **state)
{
    static const char *const of[] = {
        "postgresql://host/db#plant",
        "postgresql://host:5432/db",
        "postgresql://apc@host:5432/db",
        "postgresql://apc@[::1]:5432,host2:1/db",
        "shm:plant+sqlite:runs/a b/store.db",
        "postgresql:///db?host=/run&hostaddr=::1&port=1&dbname=d&user=u&service=s&sslmode=require#plant",
        "postgresql:///db?",
        "postgresql:",
        "sqlite:/home/me/runs/store.db",
        "shm:plant",
        "",
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_named(of[i], of[i]);
}

static void where_the_uri_says_nothing_the_environment_does(void **state)
{
    (void)state;
    setenv("PGUSER", "apc", 1);
    assert_named("postgresql:", "postgresql: (PGUSER=apc)");
    setenv("PGHOST", "/run", 1);
    setenv("PGPORT", "", 1);
    assert_named("postgresql:", "postgresql: (PGHOST=/run PGUSER=apc)");
    assert_named("postgresql:#plant", "postgresql:#plant (PGHOST=/run PGUSER=apc)");
    assert_named("postgresql://host", "postgresql://host");
    assert_named("sqlite:", "sqlite:");
    setenv("PGSERVICE", "s", 1);
    setenv("PGPORT", "1", 1);
    setenv("PGDATABASE", "d", 1);
    assert_named("postgresql:", "postgresql: (PGSERVICE=s PGHOST=/run PGPORT=1 PGDATABASE=d PGUSER=apc)");
}

static void a_name_that_is_too_long_is_cut(void **state)
{
    static const char whole[] = "postgresql://apc:***@host/db?password=***";
    (void)state;
    for (size_t size = 1; size <= sizeof whole; size++) {
        char *name = malloc(size); /* so that a sanitizer sees a byte beyond it */
        assert_non_null(name);
        store_name("postgresql://apc:secret@host/db?password=secret", name, size);
        assert_int_equal(strlen(name), size - 1);
        assert_int_equal(strncmp(name, whole, size - 1), 0);
        free(name);
    }
}

static void memory_of_one_process_is_no_store_of_a_program(void **state)
{
    struct apc_store *store = NULL;
    struct apc_error why;
    (void)state;
    assert_int_equal(store_open(&store, "mem:plant", NULL, &why), APC_EINVAL);
    assert_has(why.text, "\"mem:plant\" is the memory of one process");
    assert_null(store);
    assert_int_equal(store_open(&store, "sqlite:/nowhere/at.all", NULL, &why), 0); /* it may come */
    apc_store_close(store);
    assert_true(store_open(&store, "memory:plant", NULL, &why) < 0);
    assert_null(strstr(why.text, "one process"));
}

static void a_task_writes_into_the_live_store_alone(void **state)
{
    static const char *const of[][2] = {
        {"shm:plant+sqlite:/home/me/one.db", "shm:plant"}, {"mem:+postgresql:", "mem:"}, {"shm:a+", "shm:a"}};
    static const char *const whole[] = {"shm:plant", "postgresql://host/a+b", "sqlite:/home/a+b.db", ""};
    char room[256];
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_string_equal(store_live(of[i][0], room), of[i][1]);
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++)
        assert_ptr_equal(store_live(whole[i], room), whole[i]);
    char name[400] = "shm:";
    memset(name + 4, 'x', 300);
    snprintf(name + 304, sizeof name - 304, "+sqlite:/a");
    memset(room, '#', sizeof room);
    assert_ptr_equal(store_live(name, room), room);
    assert_int_equal(strlen(room),
                     255); /* as much of it as there is room for, which no store has for a name */
    assert_int_equal(strncmp(name, room, 255), 0);
}

static void an_outcome_has_its_exit_code(void **state)
{
    static const int of[][2] = {{0, 0},
                                {7, 0},
                                {APC_ECONN, 3},
                                {APC_ERANGE, 4},
                                {APC_EBUSY, 4},
                                {APC_ECONFLICT, 4},
                                {APC_EPERM, 4},
                                {APC_ETIMEDOUT, 5},
                                {APC_EOVERRUN, 5},
                                {APC_EINVAL, 1},
                                {APC_ESYS, 1},
                                {APC_ESCHEMA, 1},
                                {-1000000, 1}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_int_equal(exit_code_of(of[i][0]), of[i][1]);
}

#define T(name) cmocka_unit_test_setup(name, no_environment)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(a_password_is_not_shown),
        T(what_is_no_secret_is_shown),
        T(where_the_uri_says_nothing_the_environment_does),
        T(a_name_that_is_too_long_is_cut),
        T(memory_of_one_process_is_no_store_of_a_program),
        T(a_task_writes_into_the_live_store_alone),
        T(an_outcome_has_its_exit_code),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
