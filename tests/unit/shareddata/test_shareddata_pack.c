/* SPDX-License-Identifier: BSD-3-Clause */
/* Packed samples: what comes out is what went in, in how many bytes; and bytes that are anything else. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcbase.h"
#include "check.h"
#include "shareddata/pack.h"
#include "xorshift.h"

static uint64_t seed = 88172645463325252U;

static struct apc_pack in, out;
static uint8_t bytes[APC_PACK_BYTES];

static size_t packed(void)
{
    const size_t length = apc_pack(&in, bytes);
    assert_true(length > 0 && length <= APC_PACK_BYTES);
    uint8_t *exact = malloc(length); /* so that a reading beyond is seen by a sanitizer */
    assert_non_null(exact);
    memcpy(exact, bytes, length);
    memset(&out, 0xa5, sizeof out);
    assert_int_equal(apc_unpack(exact, length, &out), 0);
    free(exact);
    assert_int_equal(out.n, in.n);
    for (size_t c = 0; c < APC_PACK_COLUMNS; c++) {
        assert_memory_equal(out.at[c], in.at[c], in.n * sizeof in.at[c][0]);
    }
    return length;
}

static void fill(size_t n, double (*value)(size_t i), int64_t (*jitter)(void))
{
    memset(&in, 0, sizeof in);
    in.n = n;
    in.first = 1;
    for (size_t i = 0; i < n; i++) {
        in.at[APC_PACK_TIME][i] = 822873600000000 + (int64_t)i * 1000000 + (jitter ? jitter() : 0);
        in.at[APC_PACK_VALUE][i] = apc_pack_bits(value(i));
    }
}

static int64_t a_byte(void)
{
    return (int64_t)(xorshift(&seed) % 256);
}

static double noise(size_t i)
{
    (void)i;
    const double v = apc_pack_value((int64_t)(xorshift(&seed) >> 1));
    return fabs(v) < 1e300 ? v : 1.5;
}

static double constant(size_t i)
{
    (void)i;
    return 20.3;
}

static double converter(size_t i)
{
    return -10 +
           nearbyint(32768 + 20000 * sin((double)i * 0.001) + (double)(xorshift(&seed) % 5)) * (20 / 65535.0);
}

static double any_code(size_t i)
{
    (void)i;
    return 4 + (double)(xorshift(&seed) % 65536) * (16 / 65535.0);
}

static double tenths(size_t i)
{
    return nearbyint(200 + 30 * sin((double)i * 0.01)) * 0.1;
}

/* The bytes of a sample: 8 of noise, its time's jitter, and what blocks and columns begin with. */
/* Promise(database/chunk-gives-back) */
static void test_samples_take_the_bytes_that_they_hold(void **state)
{
    (void)state;
    static const struct {
        const char *what;
        double (*value)(size_t i);
        int64_t (*jitter)(void);
        double most;
    } kinds[] = {
        {"noise", noise, a_byte, 9.4},
        {"constant", constant, NULL, 0.1},
        {"constant, jitter", constant, a_byte, 1.25},
        {"converter", converter, a_byte, 2.8},
        {"any code", any_code, a_byte, 3.7},
        {"tenths", tenths, a_byte, 2.6},
    };
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        fill(APC_PACK_MAX, kinds[k].value, kinds[k].jitter);
        const double each = (double)packed() / APC_PACK_MAX;
        print_message("%s: %.3f bytes a sample\n", kinds[k].what, each);
        assert_true(each <= kinds[k].most);
    }
}

/*
 * Promise(database/chunk-gives-back): A chunk gives back each bit, in few bytes; bytes that are no chunk,
 *   or one of whose bits has turned, are refused within their bounds.
 */
static void test_any_number_in_any_column_comes_back(void **state)
{
    (void)state;
    static const int64_t edges[] = {0,
                                    1,
                                    -1,
                                    INT64_MAX,
                                    INT64_MIN,
                                    INT64_MAX - 1,
                                    INT64_MIN + 1,
                                    (int64_t)1 << 61,
                                    -((int64_t)1 << 61),
                                    ((int64_t)1 << 61) + 1,
                                    4503599627370496,
                                    127,
                                    128};
    static const size_t lengths[] = {1, 2, 3, 7, 127, 128, 129, 255, 1023, APC_PACK_MAX};
    for (unsigned round = 0; round < 400; round++) {
        memset(&in, 0, sizeof in);
        in.n = lengths[round % 10];
        for (size_t c = 0; c < APC_PACK_COLUMNS; c++) {
            const uint64_t kind = xorshift(&seed) % 6;
            const unsigned shift = xorshift(&seed) % 64;
            int64_t x = (int64_t)xorshift(&seed) >> shift;
            for (size_t i = 0; i < in.n; i++) {
                switch (kind) {
                case 0:
                    x = edges[xorshift(&seed) % 13];
                    break;
                case 1:
                    x = (int64_t)xorshift(&seed);
                    break;
                case 2: /* steps, some large, that wrap */
                    x = (int64_t)((uint64_t)x + (xorshift(&seed) >> shift));
                    break;
                case 3:
                    x = xorshift(&seed) % 50 ? x : (int64_t)xorshift(&seed) >> shift;
                    break;
                case 4:
                    x = (int64_t)((uint64_t)x + (uint64_t)shift);
                    break;
                default:
                    x = apc_pack_bits((double)(int64_t)(xorshift(&seed) % 4000) * 0.1 - 200);
                    break;
                }
                in.at[c][i] = x;
            }
        }
        packed();
    }
}

static void test_values_that_doubles_tell_apart_stay_apart(void **state)
{
    (void)state;
    const double few[] = {0.0, -0.0, 5e-324,           -5e-324,    2.2250738585072014e-308, 1e299, -1e299,
                          0.1, -0.1, (double)INFINITY, (double)NAN};
    memset(&in, 0, sizeof in);
    in.n = 700;
    for (size_t i = 0; i < in.n; i++) {
        in.at[APC_PACK_VALUE][i] = apc_pack_bits(few[xorshift(&seed) % (i < 350 ? 9 : 11)]);
    }
    packed();
    for (size_t i = 0; i < in.n; i++) { /* a grid that goes through zero, with either sign of it */
        in.at[APC_PACK_VALUE][i] = apc_pack_bits((double)((int64_t)(xorshift(&seed) % 9) - 4) * 0.3);
        in.at[APC_PACK_VALUE][i] += i % 50 == 0;
    }
    packed();
}

/* Promise(database/chunk-gives-back) */
static void test_what_is_no_chunk_is_refused(void **state)
{
    (void)state;
    fill(300, converter, a_byte);
    in.at[APC_PACK_STATUS][7] = 0x80000000;
    const size_t length = packed();
    for (size_t n = 0; n < length; n++) {
        uint8_t *cut = malloc(n ? n : 1);
        assert_non_null(cut);
        memcpy(cut, bytes, n);
        assert_int_equal(apc_unpack(cut, n, &out), n + 5 == length ? 0 : APC_EPROTO);
        free(cut);
    }
    bytes[length] = 0;
    assert_int_equal(apc_unpack(bytes, length + 1, &out), APC_EPROTO);
    bytes[0] = 2;
    assert_int_equal(apc_unpack(bytes, length, &out), APC_EPROTO);
}

/* Promise(database/chunk-gives-back) */
static void test_a_bit_that_has_turned_is_noticed(void **state)
{
    (void)state;
    static double (*const kinds[])(size_t i) = {noise, constant, converter, any_code, tenths};
    static const size_t lengths[] = {1, 4, 8, 32, 130, 300};
    for (size_t k = 0; k < 5 * 6; k++) {
        fill(lengths[k / 5], kinds[k % 5], k % 2 ? a_byte : NULL);
        for (size_t i = 0; i < in.n && k % 3; i++) {
            in.at[APC_PACK_ORIGIN][i] = (int64_t)(k % 3 == 1 ? i : xorshift(&seed) % 1000);
            in.at[APC_PACK_SETPOINT_SEQ][i] = (int64_t)(xorshift(&seed) % 40);
        }
        const size_t length = packed();
        for (size_t bit = 0; bit < 8 * length; bit++) {
            bytes[bit / 8] ^= (uint8_t)(1U << bit % 8);
            assert_int_equal(apc_unpack(bytes, length, &out), APC_EPROTO);
            bytes[bit / 8] ^= (uint8_t)(1U << bit % 8);
        }
    }
}

/* Promise(database/chunk-gives-back) */
static void test_bytes_of_any_kind_are_read_within_their_bounds(void **state)
{
    (void)state;
    fill(260, any_code, a_byte);
    const size_t length = apc_pack(&in, bytes) - 5; /* with its sum nearly all would end there */
    for (unsigned round = 0; round < 20000; round++) {
        uint8_t *wrong = malloc(length);
        assert_non_null(wrong);
        memcpy(wrong, bytes, length);
        for (uint64_t k = xorshift(&seed) % 4; k < 4; k++) {
            wrong[xorshift(&seed) % (k == 3 ? length : 64)] = (uint8_t)xorshift(&seed);
        }
        const int rc = apc_unpack(wrong, length, &out);
        assert_true(rc == APC_EPROTO || (rc == 0 && out.n >= 1 && out.n <= APC_PACK_MAX));
        free(wrong);
    }
}

static void test_a_summary_is_that_of_the_samples(void **state)
{
    (void)state;
    fill(5, tenths, NULL);
    const double value[5] = {3, 1e9, -2, 7, 4};
    for (size_t i = 0; i < 5; i++) {
        in.at[APC_PACK_VALUE][i] = apc_pack_bits(value[i]);
    }
    in.first = 100;
    in.at[APC_PACK_TIME][3] = 5; /* the clock was wrong */
    in.at[APC_PACK_STATUS][1] = APC_BAD_NO_DATA;
    in.at[APC_PACK_STATUS][4] = APC_BAD_NO_DATA;
    struct apc_pack_summary s;
    apc_pack_summarize(&in, &s);
    assert_int_equal(s.since, 5);
    assert_int_equal(s.until, in.at[APC_PACK_TIME][4]);
    assert_int_equal(s.good, 3);
    assert_int_equal(s.final, 103);
    assert_int_equal(s.worst, (int64_t)APC_BAD_NO_DATA);
    assert_true(s.lowest == -2 && s.highest == 7 && s.last == 7);
    assert_near(s.mean, 8.0 / 3, 1e-15);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_samples_take_the_bytes_that_they_hold),
        cmocka_unit_test(test_any_number_in_any_column_comes_back),
        cmocka_unit_test(test_values_that_doubles_tell_apart_stay_apart),
        cmocka_unit_test(test_what_is_no_chunk_is_refused),
        cmocka_unit_test(test_a_bit_that_has_turned_is_noticed),
        cmocka_unit_test(test_bytes_of_any_kind_are_read_within_their_bounds),
        cmocka_unit_test(test_a_summary_is_that_of_the_samples),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
