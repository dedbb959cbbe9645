/* SPDX-License-Identifier: BSD-3-Clause */
/* Numbers of a table are read as the C library reads them, to the last bit, however they are written. */
#include "files/files.h"

#include <apcbase.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

/* Read up to what ends it, and no further. */
static void assert_read(const char *number)
{
    char line[400];
    const char *end = NULL;
    double value = 0, expected = strtod(number, NULL);

    for (const char *after = ",\n"; *after; after++) {
        memset(line, '7', sizeof line);
        const size_t n = (size_t)snprintf(line, sizeof line, "%s%c", number, *after) - 1;
        line[n + 1] = '7';
        if (!decimal_take(line, &end, &value))
            fail_msg("\"%s\" is not read", number);
        if (memcmp(&value, &expected, sizeof value) != 0)
            fail_msg("\"%s\" is read as %.17g", number, value);
        assert_ptr_equal(end, line + n);
    }
}

/* A number of up to so many digits before and behind the point, with zeros in front and at the end. */
static void write_any(struct apc_random *random, char *to, int before, int behind)
{
    char *at = to;

    if (apc_random_uniform(random) < 0.3)
        *at++ = '-';
    for (int i = 0; i < before; i++)
        *at++ = (char)('0' + (apc_random_uniform(random) < 0.2 ? 0 : apc_random_next(random) % 10));
    if (behind > 0)
        *at++ = '.';
    for (int i = 0; i < behind; i++)
        *at++ = (char)('0' + (apc_random_uniform(random) < 0.2 ? 0 : apc_random_next(random) % 10));
    *at = '\0';
}

static void any_number_of_digits_is_read_to_the_last_bit(void **state)
{
    struct apc_random random;
    char text[200];
    (void)state;

    apc_random_init(&random, 20261127, "decimal");
    for (int round = 0; round < 60; round++) {
        for (int before = 0; before <= 21; before++) {
            for (int behind = before ? 0 : 1; behind <= 29; behind += 1 + round % 2) {
                write_any(&random, text, before, behind);
                assert_read(text);
            }
        }
    }
    for (int i = 0; i < 20000; i++) {
        const uint64_t bits = apc_random_next(&random);
        double value;

        memcpy(&value, &bits, sizeof value);
        value = fabs(value) < 1e-250 || !(fabs(value) < APC_VALUE_MAX) ? (double)i : value;
        snprintf(text, sizeof text, i % 2 ? "%.17g" : "%.9g", value);
        assert_read(text);
    }
}

/* In the middle between two, just beside it, and where one more bit is needed. */
static void what_lies_between_two_goes_to_the_even_one(void **state)
{
    static const char *const of[] = {"9007199254740993",
                                     "9007199254740992.5",
                                     "9007199254740993.5",
                                     "4503599627370496.5",
                                     "4503599627370497.5",
                                     "4503599627370498.5",
                                     "2251799813685248.25",
                                     "2251799813685248.75",
                                     "1125899906842624.125",
                                     "1125899906842624.375",
                                     "562949953421312.0625",
                                     "562949953421312.1875",
                                     "9007199254740994.999",
                                     "9223372036854775807",
                                     "9999999999999999999",
                                     "18446744073709551615",
                                     "4503599627370496.500000000000000001",
                                     "0.000000000000000000000000001",
                                     "0.9999999999999999999",
                                     "1.9999999999999999",
                                     "0.99999999999999994449",
                                     "8388607.99999999999",
                                     "0",
                                     "-0",
                                     "0.0",
                                     "-0.000",
                                     "00000000000000000000000001.5",
                                     "1.50000000000000000000000000",
                                     "1e5",
                                     "-2.5e-3",
                                     "1E+2",
                                     "12345678",
                                     "123456789",
                                     "1234567.8",
                                     "0.12345678",
                                     "0.123456789"};
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_read(of[i]);
}

static void what_is_no_number_is_none(void **state)
{
    static const char *const of[] = {"",      "-",   ".",     "-.",  "x",    "1x",       "1 ",
                                     " 1",    "+-1", "1.2.3", "nan", "inf",  "0x10",     "1e",
                                     "1e400", "--1", "1-",    "1_0", "1.-2", "12345678:"};
    char line[100];
    const char *end;
    double value;
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        memset(line, '7', sizeof line);
        snprintf(line, sizeof line, "%s,", of[i]);
        if (decimal_take(line, &end, &value))
            fail_msg("\"%s\" is read as %g", of[i], value);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_number_of_digits_is_read_to_the_last_bit),
        cmocka_unit_test(what_lies_between_two_goes_to_the_even_one),
        cmocka_unit_test(what_is_no_number_is_none),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
