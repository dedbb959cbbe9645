/* SPDX-License-Identifier: BSD-3-Clause */
/* What a unit test of numbers takes of cmocka, for a processor that has none of it here. */
#ifndef APC_PLAIN_CHECK_H
#define APC_PLAIN_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct CMUnitTest {
    const char *name;
    void (*test)(void **state);
};

static bool plain_failed;

#define print_error(...) fprintf(stderr, __VA_ARGS__)
#define assert_true(c)                                                                                       \
    ((c) ? (void)0                                                                                           \
         : ((void)fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #c), (void)(plain_failed = true)))
#define cmocka_unit_test(f)                                                                                  \
    {                                                                                                        \
#f, f                                                                                                \
    }
#define cmocka_run_group_tests(t, a, b) plain_run(t, sizeof(t) / sizeof *(t))

static inline int plain_run(const struct CMUnitTest *tests, size_t n)
{
    size_t passed = 0;
    for (size_t i = 0; i < n; i++) {
        plain_failed = false;
        tests[i].test(NULL);
        passed += !plain_failed;
        if (plain_failed) {
            fprintf(stderr, "FAILED: %s\n", tests[i].name);
        }
    }
    printf("%zu of %zu passed\n", passed, n);
    return passed != n;
}

#endif
