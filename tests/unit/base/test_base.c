/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"
#include "base/text.h"
#include "check.h"
#include "comma_locale.h"
#include "xorshift.h"

#include <dlfcn.h>
#include <locale.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

static int short_writes; /* so many bytes at once and no more, where it is not 0 */

ssize_t write(int fd, const void *data, size_t length)
{
    return syscall(SYS_write, fd, data,
                   short_writes > 0 && length > (size_t)short_writes ? (size_t)short_writes : length);
}

static void every_error_has_a_name_and_a_text(void **state)
{
    (void)state;
#define CHECK(name, number, text)                                                                            \
    assert_int_equal(name, number);                                                                          \
    assert_string_equal(apc_err_name(name), #name);                                                          \
    assert_string_equal(apc_err_text(name), text);
    APC_ERR_MAP(CHECK)
    for (int count = 0; count < 4; count++) {
        assert_string_equal(apc_err_name(count), "APC_OK");
        assert_string_equal(apc_err_text(count), "no error");
    }
    assert_string_equal(apc_err_name(-1000), "APC_E?");
    assert_string_equal(apc_err_text(-1000), "unknown error");
}

static void modes_and_levels_have_their_names_and_nothing_else_has(void **state)
{
    static const char *const levels[] = {"error", "warn", "info", "debug"};

    (void)state;
    assert_string_equal(apc_mode_name(APC_MODE_MAN), "Man");
    assert_string_equal(apc_mode_name(APC_MODE_AUTO), "Auto");
    assert_string_equal(apc_mode_name(APC_MODE_OOS), "OOS");
    assert_null(apc_mode_name(APC_MODE_MAN - 1));
    assert_string_equal(apc_mode_name(APC_MODE_CAS), "Cas");
    assert_string_equal(apc_mode_name(APC_MODE_IMAN), "IMan");
    assert_string_equal(apc_mode_name(APC_MODE_LO), "LO");
    assert_null(apc_mode_name(APC_MODE_LO + 1));
    for (int level = 0; level < 4; level++)
        assert_int_equal(apc_log_level_parse(levels[level]), APC_LOG_ERROR + level);
    assert_int_equal(apc_log_level_parse("Info"), 0);
    assert_int_equal(apc_log_level_parse(""), 0);
    assert_int_equal(apc_log_level_parse(NULL), 0);
}

static void status_severity_is_the_top_two_bits(void **state)
{
    (void)state;
    assert_int_equal(apc_status_severity(APC_GOOD), APC_SEVERITY_GOOD);
    assert_int_equal(apc_status_severity(APC_GOOD_LIMITED_HIGH), APC_SEVERITY_GOOD);
    assert_int_equal(apc_status_severity(APC_UNCERTAIN_LAST_USABLE), APC_SEVERITY_UNCERTAIN);
    assert_int_equal(apc_status_severity(APC_BAD_NO_COMMUNICATION), APC_SEVERITY_BAD);
    assert_int_equal(apc_status_severity(0xC0000000u), APC_SEVERITY_BAD);
}

static void status_text_goes_both_ways(void **state)
{
    const apc_status codes[] = {APC_GOOD,
                                APC_GOOD_LIMITED_LOW,
                                APC_GOOD_LIMITED_CONSTANT,
                                APC_UNCERTAIN_SUBSTITUTE,
                                APC_BAD_OUT_OF_SERVICE,
                                0x12345678u,
                                0x10203049u,
                                0xABCDEF00u,
                                0xFFFFFFFFu};
    char text[APC_STATUS_NAME_LEN];
    apc_status back;
    (void)state;
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        assert_int_equal(apc_status_parse(apc_status_format(codes[i], text), &back), 0);
        assert_int_equal(back, codes[i]);
    }
    assert_string_equal(apc_status_format(0x80310000u, text), "BadNoCommunication");
    assert_string_equal(apc_status_format(0x00000600u, text), "GoodLimitedHigh");
    assert_string_equal(apc_status_format(0x80740000u, text), "BadTypeMismatch"); /* of others' servers */
    assert_int_equal(apc_status_parse("BadNodeIdUnknown", &back), 0);
    assert_int_equal(back, 0x80340000u);
}

static void the_papers_ok_is_good(void **state)
{
    apc_status status = APC_BAD;
    (void)state;
    assert_int_equal(apc_status_parse("'ok'", &status), 0);
    assert_int_equal(status, APC_GOOD);
    assert_int_equal(apc_status_parse("ok", &status), 0);
    assert_int_equal(status, APC_GOOD);
}

static void an_unknown_status_is_refused_and_bad(void **state)
{
    const char *const texts[] = {"",          "good",        "Good ",      "0x",
                                 "0x1234567", "0x123456789", "0x1234567g", "'); DROP"};
    apc_status status;
    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        status = APC_GOOD;
        assert_int_equal(apc_status_parse(texts[i], &status), APC_EINVAL);
        assert_int_equal(status, APC_BAD);
    }
    assert_int_equal(apc_status_parse(NULL, &status), APC_EINVAL);
}

static void a_stamp_reads_as_it_was_written(void **state)
{
    char text[APC_TIME_LEN];
    apc_ns t;
    (void)state;
    assert_int_equal(apc_time_parse("2026-01-31T12:00:00.123456Z", &t), 0);
    assert_int_equal(t, INT64_C(1769860800123456000));
    assert_string_equal(apc_time_format(t, text), "2026-01-31T12:00:00.123456Z");
    assert_string_equal(apc_time_format(0, text), "1970-01-01T00:00:00.000000Z");
    assert_string_equal(apc_time_format(-1, text), "1969-12-31T23:59:59.999999Z");
    assert_string_equal(apc_time_format(INT64_MAX, text), "2262-04-11T23:47:16.854775Z");
    assert_string_equal(apc_time_format(INT64_MIN, text), "1677-09-21T00:12:43.145224Z");
}

static void random_stamps_go_both_ways(void **state)
{
    uint64_t seed = 20260131;
    char text[APC_TIME_LEN];
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 100000; i++) {
        apc_ns t = (apc_ns)(xorshift(&seed) % UINT64_C(9000000000000000)) * 1000, back;
        if (xorshift(&seed) & 1)
            t = -t;
        assert_int_equal(apc_time_parse(apc_time_format(t, text), &back), 0);
        assert_int_equal(back, t);
    }
}

static void a_zone_is_taken_off_and_no_zone_is_utc(void **state)
{
    apc_ns utc, t;
    (void)state;
    assert_int_equal(apc_time_parse("2026-01-31T12:00:00Z", &utc), 0);
    assert_int_equal(apc_time_parse("2026-01-31 12:00:00", &t), 0);
    assert_int_equal(t, utc);
    assert_int_equal(apc_time_parse("2026-01-31T13:30:00+01:30", &t), 0);
    assert_int_equal(t, utc);
    assert_int_equal(apc_time_parse("2026-01-31T06:30:00-05:30", &t), 0);
    assert_int_equal(t, utc);
    assert_int_equal(apc_time_parse("2026-02-01T11:59:00+23:59", &t), 0);
    assert_int_equal(t, utc);
}

static void anything_else_is_no_stamp(void **state)
{
    const char *const texts[] = {"",
                                 "now",
                                 "2026-1-31T12:00:00Z",
                                 "2026-01-31",
                                 "2026-01-31T12:00Z",
                                 "2026-02-29T00:00:00Z",
                                 "2026-13-01T00:00:00Z",
                                 "2026-00-01T00:00:00Z",
                                 "2026-01-00T00:00:00Z",
                                 "2026-01-32T00:00:00Z",
                                 "2026-04-31T00:00:00Z",
                                 "2100-02-29T00:00:00Z",
                                 "2026/01-31T12:00:00Z",
                                 "2026-01/31T12:00:00Z",
                                 "2026-01-31_12:00:00Z",
                                 "2026-01-31T12-00:00Z",
                                 "2026-01-31T12:00-00Z",
                                 "2026-01-31T12:00:00+01-00",
                                 "2026-01-31T12:00:00+01:60",
                                 "2026-01-31T12:00:00*01:00",
                                 "2026-01-31T12:60:00Z",
                                 "1677-12-31T23:59:59Z",
                                 "2262-01-01T00:00:00Z",
                                 "2026-01-31T24:00:00Z",
                                 "2026-01-31T12:00:00.Z",
                                 "2026-01-31T12:00:00.1234567890Z",
                                 "2026-01-31T12:00:00Z ",
                                 " 2026-01-31T12:00:00Z",
                                 "2026-01-31T12:00:00+1:00",
                                 "2026-01-31T12:00:00+24:00",
                                 "1600-01-01T00:00:00Z",
                                 "2026-01-31T12:00:60Z",
                                 "2026-01-31T23:58:60Z",
                                 "2026-01-31T23:59:60+01:00",
                                 "2026-01-31T23:59:61Z"};
    apc_ns t = 42;
    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        assert_int_equal(apc_time_parse(texts[i], &t), APC_EINVAL);
    assert_int_equal(apc_time_parse(NULL, &t), APC_EINVAL);
    assert_int_equal(apc_time_parse("2026-01-31T12:00:00Z", NULL), APC_EINVAL);
    assert_int_equal(t, 42);
    apc_ns midnight = 0; /* with which the Unix time of a leap second coincides, wherever its clock hangs */
    assert_int_equal(apc_time_parse("2017-01-01T00:00:00.25Z", &midnight), 0);
    assert_int_equal(apc_time_parse("2016-12-31T23:59:60.25Z", &t), 0);
    assert_int_equal(t, midnight);
    assert_int_equal(apc_time_parse("2017-01-01T00:59:60.25+01:00", &t), 0);
    assert_int_equal(t, midnight);
    assert_int_equal(apc_time_parse("2024-02-29T00:00:00Z", &t), 0);
    assert_int_equal(apc_time_parse("2000-02-29T23:59:59.123456789Z", &t), 0);
    assert_int_equal(apc_time_parse("1678-01-01T00:00:00Z", &t), 0);
    assert_int_equal(apc_time_parse("2261-12-31T23:59:59Z", &t), 0);
}

static void a_period_is_from_10_us_to_a_year(void **state)
{
    const double bad[] = {0, -1, 9.9e-6, 31622401, 1e300, (double)NAN, (double)INFINITY, -(double)INFINITY};
    struct apc_error why;
    apc_ns period = 42;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(apc_period_from_s(bad[i], &period, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "must be from"));
    }
    assert_int_equal(apc_period_from_s(0.2, NULL, &why), APC_EINVAL);
    assert_int_equal(period, 42);
    assert_int_equal(apc_period_from_s(0.2, &period, &why), 0);
    assert_int_equal(period, 200 * APC_NS_PER_MS);
    assert_int_equal(apc_period_from_s(1e-5, &period, NULL), 0);
    assert_int_equal(apc_period_from_s(31622400, &period, NULL), 0);
}

static void numbers_go_both_ways_exactly(void **state)
{
    uint64_t seed = 7;
    char text[40];
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 100000; i++) {
        uint64_t bits = xorshift(&seed);
        double value, back;
        memcpy(&value, &bits, sizeof value);
        if (!isfinite(value))
            continue;
        assert_true(apc_number_format(value, text, sizeof text) > 0);
        assert_int_equal(apc_number_parse(text, &back), 0);
        assert_memory_equal(&back, &value, sizeof value);
    }
    assert_int_equal(apc_number_format(0.1, text, 5), APC_ERANGE);
}

static double any_double(uint64_t *seed, int i)
{
    uint64_t bits = xorshift(seed);
    double value;

    switch (i % 4) {
    case 0: /* below 2, down to the least there is */
        bits &= ~(UINT64_C(1) << 62);
        memcpy(&value, &bits, sizeof value);
        return value;
    case 1: /* what a plant has: all digits, moderate magnitude */
        return ldexp((double)(int64_t)bits, (int)(bits % 64) - 70);
    case 2: /* few digits */
        return (double)((int64_t)(bits % 2000001) - 1000000) / 1000.0;
    default: /* about a power of ten, where the number of digits changes */
        return nextafter(pow(10.0, (int)(bits % 24) - 5), bits & 64 ? 0.0 : 1e300);
    }
}

static void numbers_are_what_libc_makes_of_them(void **state)
{
    uint64_t seed = UINT64_C(2463534242);
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 200000; i++) {
        char ours[40], libc[40], digits[24] = "";
        double value = any_double(&seed, i), back;
        snprintf(libc, sizeof libc, "%.17g", value);
        assert_int_equal(apc_number_format(value, ours, sizeof ours), strlen(libc));
        assert_string_equal(ours, libc);
        assert_int_equal(apc_number_parse(libc, &back), 0);
        assert_memory_equal(&back, &value, sizeof back);

        /* 1 to 20 digits with a point somewhere, so rounding has every chance */
        uint64_t n = 1 + xorshift(&seed) % 20, point = xorshift(&seed) % (n + 1);
        for (uint64_t k = 0; k <= n; k++)
            digits[k] = k == point ? '.' : (char)('0' + xorshift(&seed) % 10);
        assert_int_equal(apc_number_parse(digits, &back), 0);
        value = strtod(digits, NULL);
        assert_memory_equal(&back, &value, sizeof back);
    }
}

static void what_is_not_a_finite_decimal_is_no_number(void **state)
{
    const char *const texts[] = {"",   " 1", "1 ", "nan", "inf",   "-inf", "0x10",
                                 "1e", "e5", ".",  "1,5", "1e400", "--1",  "1.5.2"};
    double value = 42;
    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        assert_int_equal(apc_number_parse(texts[i], &value), APC_EINVAL);
    assert_near(value, 42, 0);
    assert_int_equal(apc_number_parse("-.5e+2", &value), 0);
    assert_near(value, -50, 0);
    assert_int_equal(apc_number_parse("+1.5", &value), 0);
    assert_near(value, 1.5, 0);
    assert_int_equal(apc_number_parse("-1.5", &value), 0);
    assert_near(value, -1.5, 0);
    assert_int_equal(apc_number_parse("+7.E-1", &value), 0);
    assert_near(value, 0.7, 0);
}

/*
 * Promise(run/numbers-frames-csv): Numbers, frames and CSV do not follow the locale; a log's lines are
 *   whole.
 */
static void numbers_do_not_follow_the_locale(void **state)
{
    char text[40], long_text[40];
    double value, comma_value, large;
    (void)state;
    if (!comma_locale())
        skip();
    assert_string_equal(localeconv()->decimal_point, ",");
    int plain = apc_number_parse("3.75", &value), comma = apc_number_parse("3,75", &comma_value);
    int exponent = apc_number_parse("3.75e300", &large), length = apc_number_format(3.75, text, sizeof text);
    int long_length = apc_number_format(3.75e-300, long_text, sizeof long_text);
    setlocale(LC_ALL, "C");
    assert_int_equal(plain, 0);
    assert_near(value, 3.75, 0);
    assert_int_equal(comma, APC_EINVAL);
    assert_int_equal(exponent, 0);
    assert_near(large, 3.75e300, 0);
    assert_int_equal(length, 4);
    assert_string_equal(text, "3.75");
    assert_int_equal(long_length, strlen(long_text));
    assert_non_null(strchr(long_text, '.'));
}

static void a_decimal_point_of_two_bytes_is_none_of_ours(void **state)
{
    char text[40];
    double value;
    (void)state;
    if (!wide_locale())
        skip();
    assert_int_equal(strlen(localeconv()->decimal_point), 2);
    int length = apc_number_format(-3.75e-300, text, sizeof text), parsed = apc_number_parse(text, &value);
    setlocale(LC_ALL, "C");
    assert_int_equal(length, strlen(text));
    assert_non_null(strchr(text, '.'));
    assert_int_equal(parsed, 0);
    assert_near(value, -3.75e-300, 0);
}

static void table_names_go_both_ways(void **state)
{
    (void)state;
    for (int table = 1; table < APC_TABLE_END; table++)
        assert_int_equal(apc_table_parse(apc_table_name((enum apc_table)table)), table);
    assert_int_equal(apc_table_parse("pg_class"), 0);
    assert_int_equal(apc_table_parse(NULL), 0);
    assert_null(apc_table_name((enum apc_table)0));
    assert_null(apc_table_name(APC_TABLE_END));
    for (int table = 1; table < APC_TABLE_END; table++)
        assert_int_equal(apc_table_vectors((enum apc_table)table),
                         table == APC_TICK || table == APC_PLAN || table == APC_PREDICTION);
}

/* Rows, peers and files may be of any time, and say any number of seconds. */
static void a_time_at_the_ends_does_not_wrap_around(void **state)
{
    (void)state;
    assert_int_equal(apc_ns_since(5, 3), 2);
    assert_int_equal(apc_ns_since(INT64_C(1800000000) * APC_NS_PER_S, INT64_MIN), INT64_MAX);
    assert_int_equal(apc_ns_since(-2, INT64_MAX), INT64_MIN);
    assert_int_equal(apc_ns_since(0, INT64_MAX), -INT64_MAX);
    assert_int_equal(apc_ns_read(-1.5), -1500000000);
    assert_int_equal(apc_ns_read(1e300), INT64_MAX);
    assert_int_equal(apc_ns_read((double)-INFINITY), INT64_MIN);
    assert_int_equal(apc_ns_read((double)NAN), 0);
}

/* ---- Text of others --------------------------------------------------------------------------- */

static const struct {
    uint32_t from, to;
    char instead;
} hidden[] = {{0x0001, 0x0008, '?'}, {0x0009, 0x000D, ' '}, {0x000E, 0x001F, '?'}, {0x007F, 0x0084, '?'},
              {0x0085, 0x0085, ' '}, {0x0086, 0x009F, '?'}, {0x061C, 0x061C, '?'}, {0x200E, 0x200F, '?'},
              {0x2028, 0x2029, ' '}, {0x202A, 0x202E, '?'}, {0x2066, 0x2069, '?'}};

static size_t encode(uint32_t code, char text[5])
{
    const size_t n = code < 0x80 ? 1 : code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
    static const unsigned char head[] = {0, 0, 0xC0, 0xE0, 0xF0};

    for (size_t i = n; i-- > 0; code >>= 6)
        text[i] = (char)(n == 1 ? code : i == 0 ? head[n] | code : 0x80 | (code & 0x3F));
    text[n] = '\0';
    return n;
}

/*
 * Promise(incoming/text-of-others): Text of others, on its way in and out, is one line that shows as it
 *   is: no control characters, marks of direction or broken UTF-8.
 */
static void each_character_shows_as_itself_or_not_at_all(void **state)
{
    size_t next = 0;

    (void)state;
    for (uint32_t code = 1; code < 0x110000; code = code == 0xD7FF ? 0xE000 : code + 1) {
        char text[5], instead, expected = '\0';
        const size_t n = encode(code, text);

        next += next + 1 < sizeof hidden / sizeof *hidden && code > hidden[next].to;
        if (code >= hidden[next].from && code <= hidden[next].to)
            expected = hidden[next].instead;
        if (text_step(text, &instead) != n || instead != expected || text_is_clean(text) != !expected ||
            text_code(text, n) != code)
            fail_msg("U+%04X: %d instead, not %d", (unsigned)code, instead, expected);
    }
}

static void a_text_is_cleaned_where_it_stands_and_as_far_as_there_is_room(void **state)
{
    char text[16] = "a\x1b\xe2\x80\xae"
                    "\xc3\xa4\xff\nb",
         cut[4];

    (void)state;
    assert_string_equal(text_clean(text, text, sizeof text), "a??\xc3\xa4? b");
    assert_string_equal(text_clean(cut, "ab\xc3\xa4", sizeof cut), "ab?"); /* in the middle of a character */
    assert_string_equal(text_cleaned(text, "a\n\tb\x1b\r", sizeof text, true), "a\n\tb?\r");
    for (size_t i = strlen(text); i < sizeof text; i++)
        assert_int_equal(text[i], 0);
}

/* Peers and files are quoted in it. */
/* Promise(incoming/text-of-others) */
static void an_error_is_one_line_that_shows_as_it_is(void **state)
{
    struct apc_error why;

    (void)state;
    assert_int_equal(apc_fail(&why, APC_EPROTO, "the peer says \"%s\"", "\x1b[2Jno\r\n\xc2\x9b"), APC_EPROTO);
    assert_string_equal(why.text, "the peer says \"?[2Jno  ?\"");
}

/* So that a reader of key=value sees where a name of several words ends. */
static void a_name_of_several_words_is_in_quotes(void **state)
{
    struct apc_log *log;
    char text[512] = "";
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-controller my \"base\"", APC_LOG_INFO), 0);
    apc_log_write(log, APC_LOG_INFO, "mode Auto");
    apc_log_destroy(log);
    close(fds[1]);
    assert_true(read(fds[0], text, sizeof text - 1) > 0);
    close(fds[0]);
    assert_non_null(strstr(text, " level=info name=\"apc-controller my \\\"base\\\"\" msg=\"mode Auto\"\n"));
}

/* Promise(run/numbers-frames-csv) */
static void the_log_writes_whole_escaped_lines(void **state)
{
    struct apc_log *log;
    char text[2048] = "";
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    apc_log_write(log, APC_LOG_INFO, "table \"%s\"\nof \\", "sensor");
    apc_log_write(log, APC_LOG_INFO, "\x1b[2J\xc2\x9b\xe2\x80\xae\xff\x7f\xc3\xa4");
    apc_log_write(log, APC_LOG_DEBUG, "not at this level");
    apc_log_write(NULL, APC_LOG_ERROR, "discarded");
    apc_log_destroy(log);
    close(fds[1]);
    ssize_t n = read(fds[0], text, sizeof text - 1);
    close(fds[0]);
    assert_true(n > 0);
    assert_non_null(strstr(text, " level=info name=apc-test msg=\"table \\\"sensor\\\" of \\\\\"\n"));
    assert_non_null(strstr(text, " msg=\"?[2J????\xc3\xa4\"\n"));
    assert_null(strstr(text, "not at this level"));
}

static void a_line_is_whole_also_when_it_is_taken_in_pieces(void **state)
{
    struct apc_log *log;
    char text[2048] = "";
    size_t length = 0;
    ssize_t n;
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    short_writes = 7;
    apc_log_write(log, APC_LOG_WARN, "%s", "the quick brown fox jumps over the lazy dog");
    apc_log_destroy(log);
    short_writes = 0;
    close(fds[1]);
    while (length < sizeof text - 1 && (n = read(fds[0], text + length, sizeof text - 1 - length)) > 0)
        length += (size_t)n;
    close(fds[0]);
    assert_memory_equal(text, "time=", 5);
    assert_non_null(
        strstr(text, " level=warn name=apc-test msg=\"the quick brown fox jumps over the lazy dog\"\n"));
    assert_ptr_equal(strchr(text, '\n'), text + length - 1); /* one line, and nothing of dropped ones */
}

static void a_full_log_drops_and_says_how_many(void **state)
{
    struct apc_log *log;
    static char text[1 << 20];
    size_t length = 0;
    ssize_t n;
    int fds[2], last = 0;
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    /* nobody reads: the pipe takes 64 KiB, the ring 256 messages; none of these calls may wait */
    for (last = 0; last < 3000; last++)
        apc_log_write(log, APC_LOG_INFO, "%0300d", last);
    pid_t reader = fork();
    if (reader == 0) {
        close(fds[1]);
        while (length < sizeof text && (n = read(fds[0], text + length, sizeof text - length)) > 0)
            length += (size_t)n;
        _exit(memmem(text, length, "messages were dropped", 21) ? 0 : 1);
    }
    apc_log_destroy(log);
    close(fds[1]);
    close(fds[0]);
    int status;
    assert_int_equal(waitpid(reader, &status, 0), reader);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

static void a_reader_that_has_stopped_reading_does_not_keep_a_log_from_ending(void **state)
{
    struct apc_log *log;
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    for (int i = 0; i < 1000; i++)
        apc_log_write(log, APC_LOG_INFO, "%0300d", i);
    apc_log_destroy(log); /* returns */
    close(fds[1]);
    close(fds[0]);
}

static void a_reader_that_has_gone_does_not_keep_a_log_from_ending(void **state)
{
    struct apc_log *log;
    int fds[2];
    (void)state;
    signal(SIGPIPE, SIG_IGN);
    assert_int_equal(pipe(fds), 0);
    close(fds[0]);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    apc_log_write(log, APC_LOG_INFO, "to nobody");
    apc_log_destroy(log); /* returns */
    close(fds[1]);
    signal(SIGPIPE, SIG_DFL);
}

static void a_log_that_has_nothing_to_write_ends(void **state)
{
    char text[200];
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    for (int i = 0; i < 50; i++) { /* each time its thread has come a bit further */
        struct apc_log *log;
        assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
        for (int line = 0; line < 2; line++) { /* what is written goes out at once */
            apc_log_write(log, APC_LOG_INFO, "one");
            assert_true(read(fds[0], text, sizeof text) > 0);
            for (int k = 0; k < i; k++)
                sched_yield();
        }
        apc_log_destroy(log); /* returns */
    }
    close(fds[1]);
    close(fds[0]);
}

static void on_alarm(int signal)
{
    (void)signal;
}

static void the_thread_of_a_log_takes_no_signals_of_the_application(void **state)
{
    const struct sigaction handler = {.sa_handler = on_alarm};
    struct apc_log *log;
    sigset_t set, pending;
    int fds[2];
    (void)state;
    assert_int_equal(pipe(fds), 0);
    assert_int_equal(sigaction(SIGUSR1, &handler, NULL), 0);
    assert_int_equal(apc_log_create(&log, fds[1], "apc-test", APC_LOG_INFO), 0);
    sigemptyset(&set);
    sigaddset(&set, SIGUSR1);
    assert_int_equal(pthread_sigmask(SIG_BLOCK, &set, NULL), 0);
    assert_int_equal(kill(getpid(), SIGUSR1), 0);
    sigpending(&pending);
    assert_int_equal(sigismember(&pending, SIGUSR1), 1); /* nobody has taken it */
    assert_int_equal(pthread_sigmask(SIG_UNBLOCK, &set, NULL), 0);
    apc_log_destroy(log);
    close(fds[1]);
    close(fds[0]);
}

static void a_plugin_that_is_not_there_is_named(void **state)
{
    struct apc_error why;
    const void *address;
    void *handle;
    (void)state;
    assert_int_equal(apc_plugin_open("./no-such.so", "apc_law", &handle, &address, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "./no-such.so"));
    assert_null(handle);
    assert_int_equal(apc_plugin_open("libm.so.6", "apc_law", &handle, &address, &why), APC_ENOTFOUND);
    assert_non_null(strstr(why.text, "apc_law"));
    assert_null(handle);
    apc_plugin_close(NULL);
}

/* The mark of a plug-in in the file @p to, whose text @p from is @p now instead, as many bytes. */
static uint32_t mark_of_copy(void **handle, const char *to, const char *from, const char *now)
{
    static char bytes[1 << 20];
    struct apc_error why;
    const void *law = NULL;
    FILE *file = fopen(APC_EXAMPLES_DIR "/mylaw.so", "re");
    assert_non_null(file);
    const size_t n = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    assert_in_range(n, 1, sizeof bytes - 1);
    char *at = memmem(bytes, n, from, strlen(from));
    assert_non_null(at);
    memcpy(at, now, strlen(now));
    assert_non_null(file = fopen(to, "we"));
    assert_int_equal(fwrite(bytes, 1, n, file), n);
    assert_int_equal(fclose(file), 0);
    if (apc_plugin_open(to, "apc_law", handle, &law, &why) < 0)
        fail_msg("%s", why.text);
    const uint32_t mark = apc_plugin_mark((uintptr_t)law);
    assert_int_equal(apc_plugin_mark((uintptr_t)law), mark);
    unlink(to);
    return mark;
}

static void a_mark_tells_plugins_apart_and_not_where_they_are(void **state)
{
    void *handle[3]; /* open at once: each is elsewhere */
    (void)state;
    const uint32_t mark = mark_of_copy(&handle[0], "./a-mark.so", "PI control", "PI control");
    assert_int_equal(mark_of_copy(&handle[1], "./b-mark.so", "PI control", "PI control"), mark);
    assert_int_not_equal(mark_of_copy(&handle[2], "./c-mark.so", "PI control", "PI-control"), mark);
    for (size_t i = 0; i < 3; i++)
        apc_plugin_close(handle[i]);
    assert_int_equal(apc_plugin_mark((uintptr_t)apc_plugin_mark), 0); /* built in: it is no plug-in */
    assert_int_equal(apc_plugin_mark(0), 0);
}

static int refuse(const void *plugin, const char *where, struct apc_error *why)
{
    assert_non_null(plugin);
    return apc_fail(why, APC_EINVAL, "%s: refused", where);
}

static void a_plugin_that_is_refused_is_none(void **state)
{
    const struct apc_plugin_kind kind = {.what = "law", .symbol = "apc_law", .check = refuse};
    const char *const path = APC_EXAMPLES_DIR "/mylaw.so";
    struct apc_error why;
    const void *plugin = &kind;
    void *handle = &why;
    (void)state;
    assert_int_equal(apc_plugin_find(&kind, path, &plugin, &handle, &why), APC_EINVAL);
    assert_has(why.text, "mylaw.so: refused");
    assert_null(plugin);
    assert_null(handle);
    assert_null(dlopen(path, RTLD_LAZY | RTLD_NOLOAD)); /* nothing of it stays */
}

static void finding_a_plugin_takes_a_name_and_a_place_for_its_handle(void **state)
{
    const struct apc_plugin_kind kind = {.what = "law", .symbol = "apc_law", .check = refuse};
    struct apc_error why;
    const void *plugin = &kind;
    void *handle = &why;
    (void)state;
    assert_int_equal(apc_plugin_find(&kind, NULL, &plugin, &handle, &why), APC_EINVAL);
    assert_null(plugin);
    assert_null(handle);
    plugin = &kind;
    assert_int_equal(apc_plugin_find(&kind, "pi", &plugin, NULL, &why), APC_EINVAL);
    assert_null(plugin);
    assert_has(why.text, "to find a law takes a name and a place for its handle");
}

static void values_are_those_that_can_be_stored(void **state)
{
    const double good[] = {0.0, -1.0, 9e299, -9e299}, bad[] = {1.0, 2.0, (double)NAN},
                 first[] = {HUGE_VAL, 1.0}, large[] = {1.0, -APC_VALUE_MAX};
    (void)state;
    assert_true(apc_values_ok(good, 4));
    assert_true(apc_values_ok(bad, 2));
    assert_false(apc_values_ok(bad, 3));
    assert_false(apc_values_ok(first, 2));
    assert_false(apc_values_ok(large, 2));
    assert_true(apc_values_ok(NULL, 0));
}

static void a_mutex_is_made_where_there_is_a_place_for_it(void **state)
{
    pthread_mutex_t mutex;
    (void)state;
    assert_int_equal(apc_mutex_init(&mutex), 0);
    assert_int_equal(pthread_mutex_trylock(&mutex), 0);
    pthread_mutex_unlock(&mutex);
    pthread_mutex_destroy(&mutex);
    assert_int_equal(apc_mutex_init(NULL), APC_EINVAL);
}

static void options_of_another_version_are_understood_or_refused(void **state)
{
    struct known {
        size_t size;
        int a, b;
    } ours = {0};
    struct newer {
        struct known known;
        int c, d;
    } theirs = {.known = {sizeof(theirs), 1, 2}};

    (void)state;
    assert_int_equal(apc_options_copy(&ours, sizeof(ours), &theirs, "options", NULL), 0);
    assert_int_equal(ours.b, 2);
    theirs.d = 1;
    assert_int_equal(apc_options_copy(&ours, sizeof(ours), &theirs, "options", NULL), APC_EINVAL);
    ours = (struct known){0};
    theirs.known.size = offsetof(struct known, b);
    assert_int_equal(apc_options_copy(&ours, sizeof(ours), &theirs, "options", NULL), 0);
    assert_int_equal(ours.a, 1);
    assert_int_equal(ours.b, 0);
    theirs.known.size = 0;
    assert_int_equal(apc_options_copy(&ours, sizeof(ours), &theirs, "options", NULL), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_error_has_a_name_and_a_text),
        cmocka_unit_test(modes_and_levels_have_their_names_and_nothing_else_has),
        cmocka_unit_test(status_severity_is_the_top_two_bits),
        cmocka_unit_test(status_text_goes_both_ways),
        cmocka_unit_test(the_papers_ok_is_good),
        cmocka_unit_test(an_unknown_status_is_refused_and_bad),
        cmocka_unit_test(a_stamp_reads_as_it_was_written),
        cmocka_unit_test(random_stamps_go_both_ways),
        cmocka_unit_test(a_zone_is_taken_off_and_no_zone_is_utc),
        cmocka_unit_test(anything_else_is_no_stamp),
        cmocka_unit_test(a_period_is_from_10_us_to_a_year),
        cmocka_unit_test(numbers_go_both_ways_exactly),
        cmocka_unit_test(numbers_are_what_libc_makes_of_them),
        cmocka_unit_test(what_is_not_a_finite_decimal_is_no_number),
        cmocka_unit_test(numbers_do_not_follow_the_locale),
        cmocka_unit_test(a_decimal_point_of_two_bytes_is_none_of_ours),
        cmocka_unit_test(table_names_go_both_ways),
        cmocka_unit_test(options_of_another_version_are_understood_or_refused),
        cmocka_unit_test(a_time_at_the_ends_does_not_wrap_around),
        cmocka_unit_test(each_character_shows_as_itself_or_not_at_all),
        cmocka_unit_test(a_text_is_cleaned_where_it_stands_and_as_far_as_there_is_room),
        cmocka_unit_test(an_error_is_one_line_that_shows_as_it_is),
        cmocka_unit_test(the_log_writes_whole_escaped_lines),
        cmocka_unit_test(a_name_of_several_words_is_in_quotes),
        cmocka_unit_test(a_line_is_whole_also_when_it_is_taken_in_pieces),
        cmocka_unit_test(a_full_log_drops_and_says_how_many),
        cmocka_unit_test(a_reader_that_has_stopped_reading_does_not_keep_a_log_from_ending),
        cmocka_unit_test(a_reader_that_has_gone_does_not_keep_a_log_from_ending),
        cmocka_unit_test(a_log_that_has_nothing_to_write_ends),
        cmocka_unit_test(the_thread_of_a_log_takes_no_signals_of_the_application),
        cmocka_unit_test(a_plugin_that_is_not_there_is_named),
        cmocka_unit_test(a_mark_tells_plugins_apart_and_not_where_they_are),
        cmocka_unit_test(a_plugin_that_is_refused_is_none),
        cmocka_unit_test(finding_a_plugin_takes_a_name_and_a_place_for_its_handle),
        cmocka_unit_test(values_are_those_that_can_be_stored),
        cmocka_unit_test(a_mutex_is_made_where_there_is_a_place_for_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
