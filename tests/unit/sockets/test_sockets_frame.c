/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcsockets.h"
#include "check.h"
#include "comma_locale.h"
#include "xorshift.h"

#include <float.h>
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT 64

/* 2026-01-31T12:00:00.123456Z */
#define NOON (INT64_C(1769860800) * APC_NS_PER_S + 123456000)

/* A copy with nothing behind it: a read past the end is then a report of the address sanitizer. */
static int decode(const char *text, size_t length, struct apc_frame *frame, struct apc_sample *samples,
                  size_t capacity)
{
    char *copy = malloc(length ? length : 1);
    int err;
    assert_non_null(copy);
    memcpy(copy, text, length);
    err = apc_frame_decode(copy, length, frame, samples, capacity);
    free(copy);
    return err;
}

static const char golden[] = "apc1 command 17 2;2026-01-31T12:00:00.123456Z,Good,1.5;"
                             "2026-01-31T12:00:01.000000Z,UncertainLastUsableValue,-0.10000000000000001;\n";

static void a_frame_is_written_to_the_letter(void **state)
{
    struct apc_frame frame = {APC_FRAME_COMMAND, 17, 2};
    struct apc_sample samples[] = {
        {.time = NOON, .status = APC_GOOD, .value = 1.5},
        {.time = NOON - 123456000 + APC_NS_PER_S, .status = APC_UNCERTAIN_LAST_USABLE, .value = -0.1}};
    char text[512];
    (void)state;

    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, samples), strlen(golden));
    assert_memory_equal(text, golden, strlen(golden));

    frame = (struct apc_frame){APC_FRAME_QUERY, UINT64_MAX, 0};
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, NULL), 35);
    assert_memory_equal(text, "apc1 query 18446744073709551615 0;\n", 35);

    frame = (struct apc_frame){APC_FRAME_VALUES, 0, 1};
    samples[0].status = 0x12345678u;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, samples), 60);
    assert_memory_equal(text, "apc1 values 0 1;2026-01-31T12:00:00.123456Z,0x12345678,1.5;\n", 60);
}

static void a_frame_is_read_to_the_letter(void **state)
{
    struct apc_frame frame;
    struct apc_sample samples[2] = {{.id = 7, .seq = 9}};
    (void)state;

    assert_int_equal(decode(golden, strlen(golden), &frame, samples, 2), 0);
    assert_int_equal(frame.kind, APC_FRAME_COMMAND);
    assert_true(frame.id == 17 && frame.n == 2);
    assert_true(samples[0].time == NOON && samples[0].status == APC_GOOD);
    assert_near(samples[0].value, 1.5, 0);
    assert_true(samples[1].time == NOON - 123456000 + APC_NS_PER_S);
    assert_true(samples[1].status == APC_UNCERTAIN_LAST_USABLE);
    assert_near(samples[1].value, -0.1, 0);
    assert_true(samples[0].id == 7 && samples[0].seq == 9); /* not of a frame: stays */
}

static void what_is_encoded_fits_exactly_or_not_at_all(void **state)
{
    const struct apc_frame frame = {APC_FRAME_COMMAND, 17, 2};
    struct apc_frame back;
    struct apc_sample samples[2];
    char text[sizeof golden];
    (void)state;

    assert_int_equal(decode(golden, strlen(golden), &back, samples, 2), 0);
    assert_int_equal(apc_frame_encode(text, strlen(golden), &frame, samples), strlen(golden));
    for (size_t size = 0; size < strlen(golden); size++) {
        char *small = malloc(size + 1);
        assert_non_null(small);
        small[size] = '#';
        assert_int_equal(apc_frame_encode(small, size, &frame, samples), APC_ERANGE);
        assert_int_equal(small[size], '#');
        free(small);
    }
}

static void what_is_no_frame_is_not_written(void **state)
{
    struct apc_frame frame = {APC_FRAME_COMMAND, 1, 1};
    struct apc_sample s = {.time = NOON, .value = 1};
    static struct apc_sample many[APC_FRAME_COUNT + 1];
    static char text[APC_FRAME_MAX + 1];
    const double not_finite[] = {(double)NAN, (double)INFINITY, -(double)INFINITY};
    (void)state;

    for (size_t i = 0; i < 3; i++) {
        s.value = not_finite[i];
        assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    }
    s.value = 1;
    s.time = INT64_MIN;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    s.time = INT64_MAX;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    s.time = NOON;
    assert_int_equal(apc_frame_encode(NULL, 10, &frame, &s), APC_EINVAL);
    assert_int_equal(apc_frame_encode(text, sizeof text, NULL, &s), APC_EINVAL);
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, NULL), APC_EINVAL);
    frame.kind = APC_FRAME_QUERY;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    frame.kind = (enum apc_frame_kind)0;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    frame.kind = (enum apc_frame_kind)4;
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, &s), APC_EINVAL);
    frame = (struct apc_frame){APC_FRAME_VALUES, 1, APC_FRAME_COUNT + 1};
    assert_int_equal(apc_frame_encode(text, sizeof text, &frame, many), APC_ERANGE);
}

static void the_largest_frame_goes_both_ways(void **state)
{
    static struct apc_sample samples[APC_FRAME_COUNT], back[APC_FRAME_COUNT];
    static char text[APC_FRAME_MAX];
    struct apc_frame frame = {APC_FRAME_VALUES, UINT64_MAX, APC_FRAME_COUNT}, out;
    int length;
    (void)state;

    for (size_t i = 0; i < APC_FRAME_COUNT; i++)
        samples[i] = (struct apc_sample){.time = NOON - (apc_ns)i * APC_NS_PER_S,
                                         .status = APC_BAD_WAITING_FOR_INITIAL_DATA,
                                         .value = -1.2345678901234567e-300};
    length = apc_frame_encode(text, sizeof text, &frame, samples);
    assert_in_range(length, 600000, APC_FRAME_MAX);
    assert_int_equal(decode(text, (size_t)length, &out, back, APC_FRAME_COUNT), 0);
    assert_true(out.n == APC_FRAME_COUNT);
    assert_true(back[APC_FRAME_COUNT - 1].time == NOON - (APC_FRAME_COUNT - 1) * APC_NS_PER_S);
    assert_near(back[APC_FRAME_COUNT - 1].value, -1.2345678901234567e-300, 0);
}

static double random_double(uint64_t *seed)
{
    static const double special[] = {0.0,      -0.0,  DBL_MIN, DBL_TRUE_MIN, -DBL_TRUE_MIN, DBL_MAX,
                                     -DBL_MAX, 1e300, -1e300,  DBL_EPSILON,  0.1,           1.0 / 3};
    uint64_t bits = xorshift(seed);
    double value;
    if (bits % 8 == 0)
        return special[xorshift(seed) % (sizeof special / sizeof *special)];
    if (bits % 8 == 1)
        bits &= ~(UINT64_C(0x7FF) << 52); /* denormal */
    memcpy(&value, &bits, sizeof value);
    return isfinite(value) ? value : 1.0;
}

static void every_finite_value_survives_bit_for_bit(void **state)
{
    uint64_t seed = UINT64_C(0x9E3779B97F4A7C15);
    struct apc_sample samples[COUNT], back[COUNT];
    char text[8192], again[8192];
    (void)state;

    print_message("seed 0x%llX\n", (unsigned long long)seed);
    for (int round = 0; round < 3000; round++) {
        struct apc_frame frame = {APC_FRAME_VALUES, xorshift(&seed) >> xorshift(&seed) % 64,
                                  xorshift(&seed) % COUNT};
        struct apc_frame out;
        int length;
        for (size_t i = 0; i < frame.n; i++)
            samples[i] = (struct apc_sample){.time = (apc_ns)(xorshift(&seed) % UINT64_C(9000000000000000)) *
                                                     APC_NS_PER_US,
                                             .status = (apc_status)xorshift(&seed),
                                             .value = random_double(&seed)};
        length = apc_frame_encode(text, sizeof text, &frame, samples);
        assert_true(length > 0);
        assert_int_equal(decode(text, (size_t)length, &out, back, COUNT), 0);
        assert_true(out.kind == frame.kind && out.id == frame.id && out.n == frame.n);
        for (size_t i = 0; i < frame.n; i++) {
            assert_true(back[i].time == samples[i].time && back[i].status == samples[i].status);
            assert_memory_equal(&back[i].value, &samples[i].value, sizeof(double));
        }
        assert_int_equal(apc_frame_encode(again, sizeof again, &out, back), length);
        assert_memory_equal(text, again, (size_t)length);
    }
}

static void every_truncation_is_refused(void **state)
{
    struct apc_frame frame = {.n = 99};
    struct apc_sample samples[2];
    (void)state;

    for (size_t length = 0; length < strlen(golden); length++) {
        assert_int_equal(decode(golden, length, &frame, samples, 2), APC_EPROTO);
        assert_true(frame.n == 0 && frame.id == 0 && frame.kind == 0);
    }
}

/* Every byte at every place: what still decodes is a frame in its own right. */
/*
 * Promise(links/malformed-endless-slow): Malformed, endless or slow frames cost their sender the
 *   connection, and nothing else.
 */
static void every_mutation_is_a_frame_or_refused(void **state)
{
    char text[sizeof golden], again[sizeof golden + 64];
    size_t accepted = 0, length = strlen(golden);
    (void)state;

    for (size_t at = 0; at < length; at++)
        for (int byte = 0; byte < 256; byte++) {
            struct apc_frame frame, out;
            struct apc_sample samples[2], back[2];
            int err, n;
            memcpy(text, golden, sizeof text);
            text[at] = (char)byte;
            err = decode(text, length, &frame, samples, 2);
            if (err < 0) {
                assert_int_equal(err, APC_EPROTO);
                continue;
            }
            accepted++;
            n = apc_frame_encode(again, sizeof again, &frame, samples);
            assert_true(n > 0);
            assert_int_equal(decode(again, (size_t)n, &out, back, 2), 0);
            assert_true(out.kind == frame.kind && out.id == frame.id && out.n == frame.n);
            assert_true(back[0].time == samples[0].time && back[1].time == samples[1].time);
            assert_memory_equal(&back[1].value, &samples[1].value, sizeof(double));
        }
    assert_in_range(accepted, length, 2000); /* the unchanged one at each place, and other digits */
}

static void whatever_is_not_as_written_is_refused(void **state)
{
#define T "2026-01-31T12:00:00.123456Z"
    static const char *const bad[] = {
        "",
        "\n",
        "apc1\n",
        "apc2 query 1 0;\n",
        "apc1  query 1 0;\n",
        " apc1 query 1 0;\n",
        "apc1 Query 1 0;\n",
        "apc1 read 1 0;\n",
        "apc1 query 1 0\n",
        "apc1 query 1 0;;\n",
        "apc1 query 1 0; \n",
        "apc1 query 1 0;\r\n",
        "apc1 query 1 0;\n\n",
        "apc1 query 1 0;\nx",
        "apc1 query 1 0;",
        "apc1 query  1 0;\n",
        "apc1 query 01 0;\n",
        "apc1 query 1 00;\n",
        "apc1 query +1 0;\n",
        "apc1 query -1 0;\n",
        "apc1 query 0x1 0;\n",
        "apc1 query  0;\n",
        "apc1 query 1 ;\n",
        "apc1 query 18446744073709551616 0;\n",
        "apc1 query 99999999999999999999999 0;\n",
        "apc1 values 1 8193;\n",
        "apc1 values 1 1;\n",
        "apc1 query 1 1;" T ",Good,1;\n", /* a query has no values */
        "apc1 command 1 2;" T ",Good,1;\n",
        "apc1 command 1 0;" T ",Good,1;\n",
        "apc1 command 1 1;" T ",Good,1\n",
        "apc1 command 1 1;" T ",Good;\n",
        "apc1 command 1 1;" T ",Good,1,1;\n",
        "apc1 command 1 1;" T ",Good,;\n",
        "apc1 command 1 1;" T ",,1;\n",
        "apc1 command 1 1;" T ",good,1;\n",
        "apc1 command 1 1;" T ",Good ,1;\n",
        "apc1 command 1 1;" T ", Good,1;\n",
        "apc1 command 1 1;" T ",Good, 1;\n",
        "apc1 command 1 1;" T ",Good,1 ;\n",
        "apc1 command 1 1;" T ",0x123,1;\n",
        "apc1 command 1 1;" T ",GoodGoodGoodGoodGoodGoodGoodGoodGoodGood,1;\n",
        "apc1 command 1 1;" T ",Good,nan;\n",
        "apc1 command 1 1;" T ",Good,NaN;\n",
        "apc1 command 1 1;" T ",Good,inf;\n",
        "apc1 command 1 1;" T ",Good,-inf;\n",
        "apc1 command 1 1;" T ",Good,infinity;\n",
        "apc1 command 1 1;" T ",Good,1e999;\n",
        "apc1 command 1 1;" T ",Good,0x1p3;\n",
        "apc1 command 1 1;" T ",Good,1.5.5;\n",
        "apc1 command 1 1;" T ",Good,1e;\n",
        "apc1 command 1 1;" T ",Good,--1;\n",
        "apc1 command 1 1;" T ",Good,7123.46-123.456e;\n", /* hazard 10: one message over another */
        "apc1 command 1 1;" T ",Good,1;\0\n",
        "apc1 command 1 1;" T ",Good,000000000000000000000000000000001;\n", /* 33 digits: beyond the bound */
        "apc1 command 1 1;2026-01-31T12:00:00.12345Z,Good,1;\n",
        "apc1 command 1 1;2026-01-31T12:00:00Z,Good,1;\n",
        "apc1 command 1 1;2026-01-31 12:00:00.123456Z,Good,1;\n",
        "apc1 command 1 1;2026-01-31T12:00:00.123456,Good,1;\n",
        "apc1 command 1 1;2026-01-31T12:00:00.1+01:00,Good,1;\n",
        "apc1 command 1 1;2026-02-30T12:00:00.123456Z,Good,1;\n",
        "apc1 command 1 1;2026-01-31T24:00:00.123456Z,Good,1;\n",
        "apc1 command 1 1;,Good,1;\n"};
    static const char nul_inside[] = "apc1 command 1 1;" T ",Good\0x,1;\n";
    static const char eight_bit[] = "apc1 command 1 1;" T ",Good\xC3\xA9,1;\n";
    struct apc_frame frame;
    struct apc_sample samples[4];
    (void)state;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (decode(bad[i], strlen(bad[i]), &frame, samples, 4) != APC_EPROTO)
            fail_msg("not refused: %s", bad[i]);
    assert_int_equal(decode(nul_inside, sizeof nul_inside - 1, &frame, samples, 4), APC_EPROTO);
    assert_int_equal(decode(eight_bit, sizeof eight_bit - 1, &frame, samples, 4), APC_EPROTO);
    assert_int_equal(apc_frame_decode(NULL, 3, &frame, samples, 4), APC_EINVAL);
    assert_int_equal(apc_frame_decode(golden, 3, NULL, samples, 4), APC_EINVAL);
    assert_int_equal(apc_frame_decode(golden, 3, &frame, NULL, 4), APC_EINVAL);
}

static void too_many_values_are_told_from_a_malformed_frame(void **state)
{
    char text[sizeof golden];
    struct apc_frame frame;
    struct apc_sample samples[2] = {{.seq = 1}, {.time = 42, .seq = 1}};
    (void)state;

    assert_int_equal(decode(golden, strlen(golden), &frame, samples, 1), APC_ERANGE);
    assert_true(frame.n == 0 && samples[1].time == 42);
    assert_int_equal(decode(golden, strlen(golden), &frame, NULL, 0), APC_ERANGE);
    memcpy(text, golden, sizeof text);
    text[strlen(golden) - 3] = 'x';
    assert_int_equal(decode(text, strlen(golden), &frame, samples, 1), APC_EPROTO);
}

static void a_frame_beyond_the_limit_is_refused(void **state)
{
    static char text[APC_FRAME_MAX + 1];
    struct apc_frame frame;
    (void)state;

    memset(text, '0', sizeof text);
    memcpy(text, "apc1 query ", 11);
    memcpy(text + sizeof text - 4, " 0;\n", 4);
    assert_int_equal(decode(text, sizeof text, &frame, NULL, 0), APC_EPROTO);
}

/* Promise(run/numbers-frames-csv) */
static void frames_do_not_follow_the_locale(void **state)
{
    char text[512];
    struct apc_frame frame;
    struct apc_sample samples[2];
    (void)state;

    if (!comma_locale())
        skip();
    assert_string_equal(localeconv()->decimal_point, ",");
    int err = decode(golden, strlen(golden), &frame, samples, 2);
    int length = apc_frame_encode(text, sizeof text, &frame, samples);
    setlocale(LC_ALL, "C");
    assert_int_equal(err, 0);
    assert_near(samples[0].value, 1.5, 0);
    assert_int_equal(length, strlen(golden));
    assert_memory_equal(text, golden, strlen(golden));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_frame_is_written_to_the_letter),
        cmocka_unit_test(a_frame_is_read_to_the_letter),
        cmocka_unit_test(what_is_encoded_fits_exactly_or_not_at_all),
        cmocka_unit_test(what_is_no_frame_is_not_written),
        cmocka_unit_test(the_largest_frame_goes_both_ways),
        cmocka_unit_test(every_finite_value_survives_bit_for_bit),
        cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(every_mutation_is_a_frame_or_refused),
        cmocka_unit_test(whatever_is_not_as_written_is_refused),
        cmocka_unit_test(too_many_values_are_told_from_a_malformed_frame),
        cmocka_unit_test(a_frame_beyond_the_limit_is_refused),
        cmocka_unit_test(frames_do_not_follow_the_locale),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
