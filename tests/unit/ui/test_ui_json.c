/* SPDX-License-Identifier: BSD-3-Clause */
/* JSON out and in, names of variables and hosts, the description of a plant, the files of the page. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <zlib.h>

#include "apc-ui/api/api.h"
#include "check.h"

static char *shown(struct text *t)
{
    static char buffer[4096];
    assert_false(t->failed);
    snprintf(buffer, sizeof buffer, "%.*s", (int)t->n, t->at ? t->at : "");
    text_free(t);
    return buffer;
}

static void strings_are_json_whatever_bytes_they_hold(void **state)
{
    static const char *const cases[][2] = {
        {"plain", "\"plain\""},
        {"a \"b\" \\c", "\"a \\\"b\\\" \\\\c\""},
        {"line\nline\x01\x7f", "\"line\\u000aline\\u0001\\u007f\""},
        {"\xc3\xa6\xe2\x82\xac\xf0\x9f\x98\x80", "\"\xc3\xa6\xe2\x82\xac\xf0\x9f\x98\x80\""},
        {"cut\xc3", "\"cut\xef\xbf\xbd\""},
        {"\xc2\x9b\xe2\x80\xae", "\"\\u009b\\u202e\""},
        {"\xc0\xaf", "\"\xef\xbf\xbd\xef\xbf\xbd\""},                 /* overlong */
        {"\xed\xa0\x80", "\"\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\""}, /* surrogate */
        {"</script>", "\"</script>\""}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct text t = {0};
        json_add(&t, "%s", cases[i][0]);
        assert_string_equal(shown(&t), cases[i][1]);
    }
    for (int c = 1; c < 256; c++) { /* and jansson, who is strict, can read it */
        char text[3] = {(char)c, 'x', '\0'};
        struct text t = {0};
        json_add(&t, "%s", text);
        json_t *read = json_loadb(t.at, t.n, JSON_DECODE_ANY, NULL);
        assert_non_null(read);
        json_decref(read);
        text_free(&t);
    }
}

static void numbers_read_back_the_same(void **state)
{
    static const double values[] = {0.1,    1.0 / 3.0,          1e300, -2.5e-300, 123456789.123456789,
                                    5e-324, 0.30000000000000004};
    (void)state;
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        struct text t = {0};
        json_add(&t, "%g", values[i]);
        assert_true(strtod(shown(&t), NULL) == values[i]);
    }
    struct text t = {0};
    json_add(&t, "%g", 0.1);
    assert_string_equal(shown(&t), "0.1");
    json_add(&t, "%g", 0.9750045514171948); /* by seventeen digits it is 0.97500455141719477 */
    assert_string_equal(shown(&t), "0.9750045514171948");
    json_add(&t, "%g %g %.3f %e", (double)NAN, (double)INFINITY, (double)-INFINITY, -APC_VALUE_MAX);
    assert_string_equal(shown(&t), "null,null,null,null");
    json_add(&t, "%.6jd %.6jd %.6jd", INT64_C(1763730125123456789), -APC_NS_PER_S / 2, INT64_C(0));
    assert_string_equal(shown(&t), "1763730125.123456,-0.500000,0.000000");
}

static void a_body_is_read_member_by_member(void **state)
{
    static const char *const members[] = {"a", "b", NULL};
    struct fault f = {0};
    double number;
    int64_t whole;
    const char *text;
    (void)state;
    json_t *body = body_parse("{\"a\":1.5,\"b\":\"x\"}", 17, members, &f);
    assert_non_null(body);
    assert_true(member_number(body, "a", &number, &f) && member_text(body, "b", &text, &f));
    assert_near(number, 1.5, 0);
    assert_false(member_whole(body, "a", 0, 9, &whole, &f));
    assert_int_equal(f.http, 400);
    assert_string_equal(f.field, "a");
    assert_false(member_number(body, "b", &number, &f)); /* the first fault sticks */
    assert_string_equal(f.field, "a");
    json_decref(body);

    static const char *const bad[] = {
        "", "{", "[]", "1", "{\"c\":1}", "{\"a\":1,\"a\":2}", "{\"a\":1}x", "{\"a\":NaN}", "{'a':1}"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct fault fault = {0};
        assert_null(body_parse(bad[i], strlen(bad[i]), members, &fault));
        assert_int_equal(fault.http, 400);
        assert_true(fault.message[0] != '\0');
    }
    static char deep[20000]; /* brackets without end */
    memset(deep, '[', sizeof deep - 1);
    struct fault fault = {0};
    assert_null(body_parse(deep, sizeof deep - 1, members, &fault));
}

/* Every length of UTF-8 at both ends of what is well-formed, and just beyond. */
static void what_is_utf8_stays_and_every_other_byte_is_replaced(void **state)
{
    static const char *const good[] = {
        "\xc2\xa0",         "\xdf\xbf",         "\xe0\xa0\x80",     "\xe0\xbf\xbf",
        "\xe1\x80\x80",     "\xec\xbf\xbf",     "\xed\x80\x80",     "\xed\x9f\xbf",
        "\xee\x80\x80",     "\xef\xbf\xbf",     "\xf0\x90\x80\x80", "\xf0\xbf\xbf\xbf",
        "\xf1\x80\x80\x80", "\xf3\xbf\xbf\xbf", "\xf4\x80\x80\x80", "\xf4\x8f\xbf\xbf"};
    static const char *const bad[] = {"\x80",
                                      "\xbf",
                                      "\xc0\x80",
                                      "\xc1\xbf",
                                      "\xc2",
                                      "\xdf",
                                      "\xe0\x9f\xbf",
                                      "\xed\xa0\x80",
                                      "\xe1\x80",
                                      "\xef\xbf",
                                      "\xf0\x8f\xbf\xbf",
                                      "\xf4\x90\x80\x80",
                                      "\xf1\x80\x80",
                                      "\xf5\x80\x80\x80",
                                      "\xff",
                                      "\xfe\x80"};
    char text[16], expected[40];
    struct text t = {0};
    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        snprintf(text, sizeof text, "a%sz", good[i]);
        snprintf(expected, sizeof expected, "\"%s\"", text);
        json_add(&t, "%s", text);
        assert_string_equal(shown(&t), expected);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        size_t n = (size_t)snprintf(expected, sizeof expected, "\"a");
        for (size_t k = 0; k < strlen(bad[i]); k++)
            n += (size_t)snprintf(expected + n, sizeof expected - n, "\xef\xbf\xbd");
        snprintf(expected + n, sizeof expected - n, "z\"");
        snprintf(text, sizeof text, "a%sz", bad[i]);
        json_add(&t, "%s", text);
        assert_string_equal(shown(&t), expected);
    }
    json_add(&t, "%s", "\xe2z\xe2\x82z\xf0\x9f\x98z"); /* what is cut short costs nothing behind it */
    assert_string_equal(shown(&t),
                        "\"\xef\xbf\xbdz\xef\xbf\xbd\xef\xbf\xbdz\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbdz\"");
    json_add(&t, "%s", "\x1f ~\x7f");
    assert_string_equal(shown(&t), "\"\\u001f ~\\u007f\"");
    const char *const none = getenv("none of this name");
    json_add(&t, "%s%s%-s%-s", none, "", "", "x");
    assert_string_equal(shown(&t), "null,\"\",null,\"x\"");
}

static void a_text_grows_with_what_is_put_into_it(void **state)
{
    struct text t = {0};
    char expected[8000] = "";
    size_t n = 0;
    (void)state;
    text_put(&t, "never", 0);
    assert_int_equal(t.n, 0);
    for (int i = 0; i < 700; i++) {
        text_add(&t, "%d,", i);
        text_put(&t, "ab", 2);
        n += (size_t)snprintf(expected + n, sizeof expected - n, "%d,ab", i);
        assert_true(t.n == n && t.n <= t.room);
    }
    assert_memory_equal(t.at, expected, n);
    text_free(&t);
    assert_true(!t.at && t.n == 0 && t.room == 0);
    text_add(&t, "%s", "once more");
    assert_string_equal(shown(&t), "once more");
}

static void samples_limits_and_times_are_shown(void **state)
{
    struct apc_sample s = {
        .seq = 3, .time = 2 * APC_NS_PER_S, .value = 0.5, .status = APC_UNCERTAIN_LAST_USABLE};
    struct text t = {0};
    (void)state;
    json_sample_add(&t, &s);
    s.status = APC_GOOD;
    s.value = -0.0;
    json_sample_add(&t, &s);
    s.seq = 0;
    json_sample_add(&t, &s);
    assert_string_equal(shown(&t), "[3,2.000000,0.5,\"UncertainLastUsableValue\"],[3,2.000000,0,\"Good\"],"
                                   "[0,null,null,\"BadNoData\"]");
    json_add(&t, "%e %e %e", APC_VALUE_MAX, -2.5, 0.99 * APC_VALUE_MAX);
    assert_int_equal(strncmp(shown(&t), "null,-2.5,9", 11), 0);
    json_add(&t, "%.9jd %.9jd %.9jd %.6jd %.6jd", 1500 * APC_NS_PER_MS, INT64_C(0), JSON_NONE,
             -3 * APC_NS_PER_S / 2, INT64_C(1999999));
    assert_string_equal(shown(&t), "1.5,0,null,-1.500000,0.001999");
}

static void what_is_drawn_becomes_json_with_its_commas(void **state)
{
    static const struct text empty;
    struct text part = {0}, t = {0};
    char *at = NULL;
    size_t n = 0;
    (void)state;
    json_add(&part, "{a:%i, b:[", true);
    for (int i = -1; i < 2; i++)
        json_add(&part, "%i", i);
    json_add(&part, "],\n%s:{", "a \"key\"");
    json_add(&part, "}, n:[%d, %jd, %jd, %u, %zu, %ju]", -3, INT64_MAX, JSON_NONE, 3u, SIZE_MAX, UINT64_MAX);
    json_add(&part, "x:%.3f, y:%.2g, z:null}\n", 0.5, 1.0 / 3);
    t.out = open_memstream(&at, &n); /* the same into a file, and nothing is allocated for it */
    json_add(&t, "[%.*s", (int)part.n - 1, part.at);
    json_text_add(&t, &empty);
    json_add(&t, "[], {}]");
    fclose(t.out);
    assert_null(t.at);
    assert_string_equal(
        at, "[{\"a\":true,\"b\":[null,false,true],\n\"a \\\"key\\\"\":{},\"n\":[-3,9223372036854775807,"
            "null,3,18446744073709551615,18446744073709551615],\"x\":0.500,\"y\":0.33,\"z\":null},"
            "null,[],{}]");
    free(at);
    text_free(&part);
}

static const char *wrong(const char *text, const char *const *members)
{
    static struct fault f;
    f = (struct fault){0};
    assert_null(body_parse(text, strlen(text), members, &f));
    assert_int_equal(f.http, 400);
    assert_string_equal(f.code, "json");
    return f.message;
}

static void what_is_wrong_with_a_body_is_said(void **state)
{
    static const char *const members[] = {"n", "w", "t", "b", NULL};
    struct fault f = {0};
    double number = 0;
    int64_t whole = 0;
    const char *text = NULL;
    (void)state;
    assert_non_null(strstr(wrong("", members), "is empty"));
    assert_non_null(strstr(wrong("{\n\n1}", members), "line 3"));
    assert_non_null(strstr(wrong("[1]", members), "must be a JSON object"));
    assert_string_equal(wrong("{\"n\":1,\"x\":2}", members), "\"x\" is not known here");
    static const char *const body_text = "{\"n\":2,\"w\":5,\"t\":\"x\",\"b\":true}";
    json_t *body = body_parse(body_text, strlen(body_text), members, &f);
    assert_non_null(body);
    assert_true(member_number(body, "n", &number, &f) && member_whole(body, "w", 5, 5, &whole, &f) &&
                member_text(body, "t", &text, &f));
    assert_true(number == 2 && whole == 5 && !strcmp(text, "x"));
    assert_int_equal(f.http, 0);
    static const struct {
        int http;
        const char *part;
    } expected[] = {{422, "\"t\": \"x\" is not a finite number"},
                    {422, "is not a finite number"},
                    {400, "is missing"},
                    {400, "is missing"},
                    {400, "is missing"},
                    {400, "must be a whole number from 6 to 9"},
                    {400, "must be a whole number"},
                    {400, "must be text in double quotes"}};
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        f = (struct fault){0};
        assert_false(i == 0   ? member_number(body, "t", &number, &f)
                     : i == 1 ? member_number(body, "b", &number, &f)
                     : i == 2 ? member_number(body, "none", &number, &f)
                     : i == 3 ? member_whole(body, "none", 0, 9, &whole, &f)
                     : i == 4 ? member_text(body, "none", &text, &f)
                     : i == 5 ? member_whole(body, "w", 6, 9, &whole, &f)
                     : i == 6 ? member_whole(body, "b", 0, 9, &whole, &f)
                              : member_text(body, "n", &text, &f));
        assert_int_equal(f.http, expected[i].http);
        assert_non_null(strstr(f.message, expected[i].part));
        assert_true(f.field[0]);
    }
    assert_true(number == 2 && whole == 5);
    json_decref(body);
}

/* Promise(server/client-made-openapi) */
static void a_whole_number_may_be_written_with_a_point(void **state)
{
    static const struct {
        const char *text;
        bool is;
        int64_t value;
    } cases[] = {{"5", true, 5},
                 {"5.0", true, 5},
                 {"5e0", true, 5},
                 {"0.0", true, 0},
                 {"9007199254740991", true, APC_SEQ_MAX},
                 {"9007199254740992", false, 0}, /* beyond what is declared */
                 {"9007199254740992.0", false, 0},
                 {"1e300", false, 0},
                 {"5.5", false, 0},
                 {"-1", false, 0},
                 {"-0.5", false, 0},
                 {"\"5\"", false, 0}};
    static const char *const members[] = {"w", NULL};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[64];
        struct fault f = {0};
        int64_t whole = 0;
        snprintf(text, sizeof text, "{\"w\":%s}", cases[i].text);
        json_t *body = body_parse(text, strlen(text), members, &f);
        assert_non_null(body);
        assert_int_equal(member_whole(body, "w", 0, APC_SEQ_MAX, &whole, &f), cases[i].is);
        assert_int_equal(f.http, cases[i].is ? 0 : 400);
        assert_int_equal(whole, cases[i].value);
        json_decref(body);
    }
}

static void times_are_absolute_or_before_now(void **state)
{
    const apc_ns now = INT64_C(1763730125) * APC_NS_PER_S;
    apc_ns t;
    (void)state;
    assert_true(time_parse("1763730000", now, &t));
    assert_int_equal(t, INT64_C(1763730000) * APC_NS_PER_S);
    assert_true(time_parse("-0.5", now, &t));
    assert_int_equal(t, now - APC_NS_PER_S / 2);
    assert_true(time_parse("2026-01-31T12:00:00Z", now, &t));
    static const char *const bad[] = {"", "now", "nan", "inf", "1e300", "-1e300", "12:00", "1763730000 "};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(time_parse(bad[i], now, &t));
}

static void variables_are_named_by_table_and_number(void **state)
{
    enum apc_table table;
    int id;
    (void)state;
    assert_true(ref_parse("sensor.12", &table, &id));
    assert_int_equal(table, APC_SENSOR);
    assert_int_equal(id, 12);
    static const char *const bad[] = {
        "",          "sensor",    "sensor.",   "sensor.-1",          "sensor.1x",
        "sensor. 1", "sensor.01", "sensors.1", "sensor.99999999999", "a.very.long.name.that.is.no.table.1",
        ".1"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(ref_parse(bad[i], &table, &id));
}

static void only_addresses_and_known_names_are_hosts(void **state)
{
    static const char *const names[] = {"plant.example", NULL};
    static const char *const good[] = {"localhost",  "LOCALHOST:8080", "127.0.0.1:80",     "10.1.2.3",
                                       "[::1]:8080", "[::1]",          "plant.example:443"};
    static const char *const bad[] = {"",
                                      "evil.example",
                                      "localhost.evil.example",
                                      "127.0.0.1.evil.example:80",
                                      ":80",
                                      "localhost:80@evil",
                                      "[::1",
                                      "[evil]",
                                      "localhost:80:90",
                                      "256.1.1.1"};
    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        assert_true(host_allowed(good[i], names));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(host_allowed(bad[i], names));
    assert_false(host_allowed(NULL, names));
    assert_true(origin_matches("http://localhost:8080", "localhost:8080", false, NULL));
    assert_true(origin_matches("https://Plant.example", "plant.example", true, NULL));
    /* TLS ends in front of it, or the page is of another server of that host */
    assert_true(origin_matches("https://plant.example", "plant.example", false, "same-origin"));
    assert_false(origin_matches("https://plant.example", "plant.example", false, "none"));
    assert_false(origin_matches("https://plant.example", "plant.example", false, NULL));
    assert_false(origin_matches("http://plant.example", "plant.example", true, "same-origin"));
    assert_false(origin_matches("ftp://localhost:8080", "localhost:8080", false, NULL));
    assert_false(origin_matches("http://localhost:8081", "localhost:8080", false, NULL));
    assert_false(origin_matches("null", "localhost:8080", false, NULL));
    assert_false(origin_matches("http://localhost:8080", NULL, false, NULL));
    /* Reported of Grafana: behind a proxy that writes the port into Host each write was refused. */
    assert_true(origin_matches("https://plant.example", "plant.example:443", false, "same-origin"));
    assert_true(origin_matches("https://plant.example", "plant.example:443", true, NULL));
    assert_true(origin_matches("http://[::1]:80", "[::1]", false, NULL));
    assert_false(origin_matches("https://plant.example", "plant.example:80", true, NULL));
    assert_false(origin_matches("http://plant.example", "plant.example:443", false, NULL));
    assert_false(origin_matches("https://plant.example:44", "plant.example:443", true, NULL));
    assert_false(origin_matches("https://plant.example", "plant.example.evil:443", true, NULL));
    assert_false(origin_matches("https://", "plant.example", true, NULL));
}

/* ---- The plant ---------------------------------------------------------------------------- */

static bool describe(struct plant *p, const struct apc_tag *tags, size_t n)
{
    struct apc_store *store;
    struct loops loops;
    assert_int_equal(apc_store_open(&store, "mem:plant", NULL, NULL), 0);
    assert_true(apc_store_init(store) >= 0);
    static const double pairs[] = {1, 1, 2, 0};
    for (int i = 0; i < 4; i++) {
        const struct apc_sample s = {.table = APC_DIM, .id = 4 + i, .seq = 1, .value = pairs[i]};
        assert_int_equal(apc_store_append(store, &s, 1), 1);
    }
    assert_int_equal(loops_load(&loops, store, tags, n), 0);
    apc_store_close(store);
    return plant_describe(p, tags, n, &loops);
}

static const char *texts(const json_t *array)
{
    static char text[200];
    text[0] = '\0';
    for (size_t i = 0; i < json_array_size(array); i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s%s", i ? " " : "",
                 json_string_value(json_array_get(array, i)));
    return text;
}

#define OF_BASE .high = 1, .controller = "base"

static void two_modes_make_two_loops(void **state)
{
    static const struct apc_tag tags[] = {
        {.table = APC_SENSOR,
         .id = 1,
         .name = "h1",
         .low = -APC_VALUE_MAX,
         .high = APC_VALUE_MAX,
         .period = 0.5},
        {.table = APC_SENSOR, .id = 2, .name = "h2", .high = 1},
        {.table = APC_SENSOR, .id = 3, .name = "T", .high = 1},
        {.table = APC_ACTUATOR, .id = 1, .name = "v1", OF_BASE},
        {.table = APC_ACTUATOR, .id = 2, .name = "v2", OF_BASE},
        {.table = APC_SETPOINT, .id = 1, .name = "r1", OF_BASE},
        {.table = APC_DIM, .id = 1, .name = "hidden"},
        {.table = APC_OPMODE, .id = 0, .name = "hidden too", .high = 1},
        {.table = APC_OPMODE, .id = 1, .name = "v1", OF_BASE},
        {.table = APC_OPMODE, .id = 2, .name = "v2", OF_BASE},
        {.table = APC_TUNING, .id = 1, .name = "v1.Kp", OF_BASE},
        {.table = APC_TUNING, .id = 2, .name = "v2.Kp", OF_BASE},
        {.table = APC_TUNING, .id = 3, .name = "horizon", OF_BASE},   /* the law's: of both */
        {.table = APC_TUNING, .id = 4, .name = "h2.weight", OF_BASE}, /* of whom its measurement is */
        {.table = APC_TUNING, .id = 5, .name = "v2.Kp", .high = 1, .controller = "another"},
        {.table = APC_STATE, .id = 1, .name = "hidden"},
        {.table = APC_TICK, .id = 1, .name = "base", .period = 2}};
    const size_t n = sizeof tags / sizeof *tags;
    struct plant p = {0};
    struct text t = {0};
    (void)state;
    assert_true(describe(&p, tags, n));
    assert_int_equal(p.revision, 1);
    assert_false(describe(&p, tags, n)); /* nothing new */
    struct apc_tag turned[sizeof tags / sizeof *tags];
    for (size_t i = 0; i < n; i++)
        turned[i] = tags[n - 1 - i];
    struct plant other = {0};
    assert_true(describe(&other, turned, n)); /* in whatever order */
    assert_int_equal(other.n, 13);
    for (size_t i = 0; i < p.n; i++) {
        assert_int_equal(find_plant_tag(&p, p.tag[i].table, p.tag[i].id), (int)i);
        assert_int_equal(find_plant_tag(&other, p.tag[i].table, p.tag[i].id), (int)i);
    }
    plant_free(&other);
    assert_int_equal(find_plant_tag(&p, APC_SENSOR, 0), -1);
    assert_int_equal(find_plant_tag(&p, APC_SENSOR, 4), -1);
    assert_int_equal(find_plant_tag(&p, APC_TICK, 1), -1);
    assert_int_equal(p.n, 13);
    assert_int_equal(plant_period(&p, APC_SENSOR, 1), APC_NS_PER_S / 2);
    assert_int_equal(plant_period(&p, APC_SENSOR, 2), 0);
    assert_int_equal(plant_period(&p, APC_ACTUATOR, 2), 2 * APC_NS_PER_S);
    assert_int_equal(plant_period(&p, APC_SETPOINT, 1), 0);
    assert_true(plant_rhythm(&p, "plant", 3 * APC_NS_PER_S)); /* as its tasks say counts more */
    assert_true(plant_rhythm(&p, "base", APC_NS_PER_S));
    assert_false(plant_rhythm(&p, "base", APC_NS_PER_S));
    assert_int_equal(p.revision, 3);
    assert_int_equal(plant_period(&p, APC_SENSOR, 1), 3 * APC_NS_PER_S);
    assert_int_equal(plant_period(&p, APC_ACTUATOR, 2), APC_NS_PER_S);
    json_add(&t, "{");
    plant_members(&p, &t);
    json_add(&t, "}");
    json_t *json = json_loadb(t.at, t.n, 0, NULL);
    assert_non_null(json);
    text_free(&t);
    const json_t *loops = json_object_get(json, "loops"), *first = json_array_get(loops, 0),
                 *second = json_array_get(loops, 1);
    assert_int_equal(json_array_size(loops), 2);
    assert_string_equal(json_string_value(json_object_get(first, "setpoint")), "setpoint.1");
    assert_string_equal(texts(json_object_get(first, "tuning")), "tuning.1 tuning.3");
    assert_string_equal(texts(json_object_get(first, "parameters")), "Kp horizon");
    assert_string_equal(json_string_value(json_object_get(second, "name")), "h2");
    assert_string_equal(json_string_value(json_object_get(second, "called")), "v2");
    assert_string_equal(json_string_value(json_object_get(second, "controller")), "base");
    assert_string_equal(json_string_value(json_object_get(second, "measurement")), "sensor.2");
    assert_true(json_is_null(json_object_get(second, "setpoint")));
    assert_string_equal(json_string_value(json_object_get(second, "output")), "actuator.2");
    assert_string_equal(texts(json_object_get(second, "tuning")), "tuning.2 tuning.3 tuning.4");
    assert_string_equal(texts(json_object_get(second, "parameters")), "Kp horizon h2.weight");
    assert_true(json_is_null(json_object_get(second, "above")));
    const json_t *variable = json_array_get(json_object_get(json, "variables"), 0);
    assert_true(json_is_null(json_object_get(variable, "low")));
    json_decref(json);

    struct apc_tag changed[sizeof tags / sizeof *tags];
    memcpy(changed, tags, sizeof tags);
    changed[1].high = 2;
    assert_true(describe(&p, changed, n));
    assert_int_equal(p.revision, 4);
    assert_true(describe(&p, tags, 0)); /* nothing is described any more */
    json_add(&t, "{");
    plant_members(&p, &t);
    json_add(&t, "}");
    json = json_loadb(t.at, t.n, 0, NULL);
    assert_int_equal(json_array_size(json_object_get(json, "loops")), 0);
    json_decref(json);
    text_free(&t);
    plant_free(&p);
}

/* ---- Files -------------------------------------------------------------------------------- */

static void write_file(const char *folder, const char *name, const char *text)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

/*
 * Promise(server/files): The page's files: only what is in the folder, revalidated or kept for a year,
 *   zipped; long answers are zipped as well.
 */
static void only_what_lies_in_the_folder_is_served(void **state)
{
    char folder[] = "/tmp/apc-files.XXXXXX", inner[64], text[2000], command[80];
    struct files *files;
    struct apc_error why;
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(inner, sizeof inner, "%s/assets", folder);
    assert_int_equal(mkdir(inner, 0700), 0);
    memset(text, 'a', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    write_file(folder, "index.html", "<p>");
    write_file(folder, ".secret", "no");
    write_file(inner, "app-1A2B3C4D.js", text);
    assert_int_equal(files_load(&files, folder, &why), 0);
    assert_int_equal(files_count(files), 2);
    const struct file *index = files_find(files, "/"), *script = files_find(files, "/assets/app-1A2B3C4D.js");
    assert_ptr_equal(index, files_find(files, "/index.html"));
    assert_string_equal(index->type, "text/html; charset=utf-8");
    assert_false(index->immutable);
    assert_null(index->zipped); /* too small to be worth it */
    assert_true(script->immutable);
    assert_true(script->zipped && script->n_zipped < script->n);
    assert_string_not_equal(index->etag, script->etag);
    static const char *const bad[] = {"",
                                      "/.secret",
                                      "/assets",
                                      "/assets/",
                                      "/../index.html",
                                      "/assets/../index.html",
                                      "//index.html",
                                      "/index.html/",
                                      "/INDEX.HTML"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_null(files_find(files, bad[i]));
    files_free(files);
    assert_int_equal(files_load(&files, "/no/such/folder", &why), APC_ENOTFOUND);
    files_free(files);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
}

static const char *folder_of(char name[32])
{
    snprintf(name, 32, "/tmp/apc-files.XXXXXX");
    assert_non_null(mkdtemp(name));
    return name;
}

static void remove_folder(const char *folder)
{
    char command[80];
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
}

/* One descriptor is left: for the folder, not for a file in it. */
static void a_file_that_cannot_be_opened_is_named(void **state)
{
    struct rlimit was, few;
    struct files *files;
    struct apc_error why;
    char folder[32];
    (void)state;
    write_file(folder_of(folder), "index.html", "<p>");
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &was), 0);
    const int next = dup(STDERR_FILENO);
    close(next);
    few = (struct rlimit){.rlim_cur = (rlim_t)next + 1, .rlim_max = was.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
    const int rc = files_load(&files, folder, &why);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &was), 0);
    assert_int_equal(rc, APC_ESYS);
    assert_has(why.text, "/index.html: cannot be read: Too many open files");
    assert_int_equal(files_count(files), 0);
    files_free(files);
    remove_folder(folder);
}

static void a_file_is_of_the_type_its_ending_says(void **state)
{
    static const char *const types[][2] = {{"a.html", "text/html; charset=utf-8"},
                                           {"a.min.js", "text/javascript; charset=utf-8"},
                                           {"a.css", "text/css; charset=utf-8"},
                                           {"a.json", "application/json"},
                                           {"a.svg", "image/svg+xml"},
                                           {"a.png", "image/png"},
                                           {"a.ico", "image/x-icon"},
                                           {"a.woff2", "font/woff2"},
                                           {"a.txt", "text/plain; charset=utf-8"},
                                           {"a.webmanifest", "application/manifest+json"},
                                           {"a.map", "application/json"},
                                           {"a.htm", "application/octet-stream"},
                                           {"plain", "application/octet-stream"}},
                             *const hashed[][2] = {
                                 {"app-1A2b3C4z.js", "y"}, {"app.00zzAA99.js", "y"},
                                 {"app-1A2b3C4.js", ""},   {"12345678.js", ""},
                                 {"app_12345678.js", ""},  {"app-1234_678.js", ""},
                                 {"app-12345678", ""},     {"app-long-123456789ab.css", "y"}};
    char folder[32], path[64];
    struct files *files;
    struct apc_error why;
    (void)state;
    folder_of(folder);
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        write_file(folder, types[i][0], "x");
    for (size_t i = 0; i < sizeof hashed / sizeof *hashed; i++)
        write_file(folder, hashed[i][0], "y");
    assert_int_equal(files_load(&files, folder, &why), 0);
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        snprintf(path, sizeof path, "/%s", types[i][0]);
        assert_string_equal(files_find(files, path)->type, types[i][1]);
        assert_true(files_find(files, path)->n == 1 && files_find(files, path)->data[0] == 'x');
        assert_string_equal(files_find(files, path)->etag, files_find(files, "/a.html")->etag);
    }
    for (size_t i = 0; i < sizeof hashed / sizeof *hashed; i++) {
        snprintf(path, sizeof path, "/%s", hashed[i][0]);
        if (files_find(files, path)->immutable != (hashed[i][1][0] == 'y'))
            fail_msg("%s", path);
    }
    const char *etag = files_find(files, "/plain")->etag;
    assert_true(etag[0] == '"' && etag[strlen(etag) - 1] == '"');
    assert_string_not_equal(etag, files_find(files, "/app-12345678")->etag);
    files_free(files);
    remove_folder(folder);
}

static void a_file_is_zipped_where_that_is_smaller(void **state)
{
    char folder[32], text[300], noise[300], plain[300];
    struct files *files;
    struct apc_error why;
    unsigned random = 1;
    (void)state;
    folder_of(folder);
    memset(text, 'a', sizeof text);
    text[256] = '\0';
    write_file(folder, "256", text);
    text[255] = '\0';
    write_file(folder, "255", text);
    for (size_t i = 0; i < sizeof noise; i++)
        noise[i] = (char)(1 + (random = random * 1103515245 + 12345) / 65536 % 255);
    noise[sizeof noise - 1] = '\0';
    write_file(folder, "noise", noise);
    assert_int_equal(files_load(&files, folder, &why), 0);
    const struct file *zipped = files_find(files, "/256");
    assert_null(files_find(files, "/255")->zipped);
    assert_null(files_find(files, "/noise")->zipped);
    assert_true(zipped->zipped && zipped->n_zipped < 256 && zipped->n == 256);
    z_stream z = {.next_in = (Bytef *)(uintptr_t)zipped->zipped,
                  .avail_in = (uInt)zipped->n_zipped,
                  .next_out = (Bytef *)plain,
                  .avail_out = sizeof plain};
    assert_int_equal(inflateInit2(&z, 15 + 16), Z_OK);
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    assert_int_equal(z.total_out, 256);
    inflateEnd(&z);
    assert_memory_equal(plain, zipped->data, 256);
    files_free(files);
    remove_folder(folder);
}

static void a_page_has_bounds(void **state)
{
    char folder[32], path[200], name[16];
    struct files *files;
    struct apc_error why;
    (void)state;
    folder_of(folder);
    size_t n = (size_t)snprintf(path, sizeof path, "%s", folder);
    for (int depth = 1; depth <= 5; depth++) {
        n += (size_t)snprintf(path + n, sizeof path - n, "/d");
        assert_int_equal(mkdir(path, 0700), 0);
        write_file(path, "f", "x");
    }
    snprintf(path, sizeof path, "%s/dangling", folder);
    assert_int_equal(symlink("/no/such/file", path), 0);
    for (int i = 0; i < 252; i++) {
        snprintf(name, sizeof name, "%d", i);
        write_file(folder, name, "");
    }
    assert_int_equal(files_load(&files, folder, &why), 0);
    assert_int_equal(files_count(files), 256);
    assert_non_null(files_find(files, "/d/d/d/d/f"));
    assert_null(files_find(files, "/d/d/d/d/d/f"));
    files_free(files);
    write_file(folder, "252", "");
    assert_int_equal(files_load(&files, folder, &why), APC_ERANGE);
    files_free(files);
    remove_folder(folder);
    folder_of(folder);
    write_file(folder, "large", "x");
    snprintf(path, sizeof path, "%s/large", folder);
    assert_int_equal(truncate(path, 8 << 20), 0);
    assert_int_equal(files_load(&files, folder, &why), 0);
    assert_int_equal(files_find(files, "/large")->n, 8 << 20);
    files_free(files);
    assert_int_equal(truncate(path, (8 << 20) + 1), 0);
    assert_int_equal(files_load(&files, folder, &why), APC_ERANGE);
    assert_non_null(strstr(why.text, "larger than 8 MiB"));
    files_free(files);
    remove_folder(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strings_are_json_whatever_bytes_they_hold),
        cmocka_unit_test(numbers_read_back_the_same),
        cmocka_unit_test(a_body_is_read_member_by_member),
        cmocka_unit_test(what_is_utf8_stays_and_every_other_byte_is_replaced),
        cmocka_unit_test(a_text_grows_with_what_is_put_into_it),
        cmocka_unit_test(what_is_drawn_becomes_json_with_its_commas),
        cmocka_unit_test(samples_limits_and_times_are_shown),
        cmocka_unit_test(what_is_wrong_with_a_body_is_said),
        cmocka_unit_test(a_whole_number_may_be_written_with_a_point),
        cmocka_unit_test(times_are_absolute_or_before_now),
        cmocka_unit_test(variables_are_named_by_table_and_number),
        cmocka_unit_test(only_addresses_and_known_names_are_hosts),
        cmocka_unit_test(two_modes_make_two_loops),
        cmocka_unit_test(only_what_lies_in_the_folder_is_served),
        cmocka_unit_test(a_file_is_of_the_type_its_ending_says),
        cmocka_unit_test(a_file_that_cannot_be_opened_is_named),
        cmocka_unit_test(a_file_is_zipped_where_that_is_smaller),
        cmocka_unit_test(a_page_has_bounds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
