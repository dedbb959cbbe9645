/* SPDX-License-Identifier: BSD-3-Clause */
/* cmocka with what it needs before it, and what cmocka 1.1.5 has no assert for: doubles, and a text in
 * another. */
#ifndef APC_TEST_CHECK_H
#define APC_TEST_CHECK_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#ifdef main /* of one file of a room's program: unit/main.c */
int main(void);
#endif

#define assert_near(actual, expected, tolerance)                                                             \
    do {                                                                                                     \
        double near_a = (actual), near_e = (expected), near_t = (tolerance);                                 \
        if (!(fabs(near_a - near_e) <= near_t))                                                              \
            fail_msg("%s = %.17g, expected %.17g +- %g", #actual, near_a, near_e, near_t);                   \
    } while (0)

#define assert_has(text, part)                                                                               \
    do {                                                                                                     \
        const char *has_t = (text), *has_p = (part);                                                         \
        if (!strstr(has_t, has_p))                                                                           \
            fail_msg("no \"%s\" in \"%s\"", has_p, has_t);                                                   \
    } while (0)

#endif
