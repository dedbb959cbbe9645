/* SPDX-License-Identifier: BSD-3-Clause */
/* PostgreSQL's binary values. What the server makes of them is shown by the other programs. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "shareddata/postgresql/postgresql.h"

static void test_an_array_comes_back_as_it_was_built(void **state)
{
    (void)state;
    const int64_t in[5] = {0, 1, -1, INT64_MAX, INT64_MIN};
    int64_t out[5] = {0};
    struct apc_pg_array a = {0};
    assert_int_equal(apc_pg_array_begin(&a, APC_PG_INT8, 5), 0);
    for (int i = 0; i < 5; i++) {
        apc_pg_array_int8(&a, in[i]);
    }
    assert_int_equal(a.length, APC_PG_ARRAY_SIZE(5, 8));
    assert_int_equal(apc_pg_get_int8_array(a.data, a.length, out, 5), 5);
    assert_memory_equal(in, out, sizeof in);
    out[2] = 77;
    assert_int_equal(apc_pg_get_int8_array(a.data, a.length, out, 2),
                     5); /* tells how many, writes what fits */
    assert_int_equal(out[2], 77);
    free(a.data);
}

static void test_memory_is_kept_and_only_grows(void **state)
{
    (void)state;
    struct apc_pg_array a = {0};
    assert_int_equal(apc_pg_array_begin(&a, APC_PG_FLOAT8, 100), 0);
    const char *data = a.data;
    for (size_t n = 0; n <= 100; n++) {
        assert_int_equal(apc_pg_array_begin(&a, APC_PG_INT4, n), 0);
        assert_ptr_equal(a.data, data);
    }
    free(a.data);
}

static void test_a_broken_array_is_refused(void **state)
{
    (void)state;
    struct apc_pg_array a = {0};
    int64_t out[4];
    assert_int_equal(apc_pg_array_begin(&a, APC_PG_INT8, 3), 0);
    for (int i = 0; i < 3; i++) {
        apc_pg_array_int8(&a, i);
    }
    char *exact = malloc(a.length); /* so that a sanitizer sees a read beyond it */
    assert_non_null(exact);
    for (size_t length = 0; length < a.length; length++) {
        char *cut = malloc(length ? length : 1);
        assert_non_null(cut);
        memcpy(cut, a.data, length);
        assert_int_equal(apc_pg_get_int8_array(cut, length, out, 4), APC_EPROTO);
        free(cut);
    }
    static const struct {
        size_t at;
        char byte;
    } wrong[] = {{3, 2}, {11, 23}, {12, (char)0x80}, {15, 4}, {15, 2}};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        memcpy(exact, a.data, a.length);
        exact[wrong[i].at] = wrong[i].byte;
        assert_int_equal(apc_pg_get_int8_array(exact, a.length, out, 4), APC_EPROTO);
    }
    free(exact);
    assert_int_equal(apc_pg_array_begin(&a, APC_PG_INT8, 2), 0);
    apc_pg_array_int8(&a, 1);
    apc_pg_array_null(&a);
    assert_int_equal(apc_pg_get_int8_array(a.data, a.length, out, 4), APC_EPROTO); /* NULL is no number */
    free(a.data);
}

static void test_times_are_whole_microseconds_rounded_down_and_clamped(void **state)
{
    (void)state;
    const int64_t origin = INT64_C(946684800) * APC_NS_PER_S; /* 2000-01-01 */
    assert_true(apc_pg_time(origin) == 0);
    assert_true(apc_pg_time(origin + 1999) == 1);
    assert_true(apc_pg_time(origin - 1) == -1);
    assert_true(apc_pg_time(0) == -INT64_C(946684800000000));
    assert_true(apc_pg_time(-1) == -INT64_C(946684800000001));
    assert_true(apc_pg_time_ns(0) == origin);
    assert_true(apc_pg_time_ns(apc_pg_time(INT64_MAX)) == INT64_MAX / 1000 * 1000);
    assert_true(apc_pg_time_ns(INT64_MAX) == INT64_MAX); /* infinity, 4000-01-01 and the like */
    assert_true(apc_pg_time_ns(INT64_MIN) == INT64_MIN);
    assert_true(apc_pg_time_ns(INT64_MIN / 1000) > INT64_MIN);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_an_array_comes_back_as_it_was_built),
        cmocka_unit_test(test_memory_is_kept_and_only_grows),
        cmocka_unit_test(test_a_broken_array_is_refused),
        cmocka_unit_test(test_times_are_whole_microseconds_rounded_down_and_clamped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
