/* SPDX-License-Identifier: BSD-3-Clause */
/* JSON out and in, names of variables and hosts, the description of a plant, the files of the page. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "apc-ui/http.h"
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
        {"\xc0\xaf", "\"\xef\xbf\xbd\xef\xbf\xbd\""},                 /* overlong */
        {"\xed\xa0\x80", "\"\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\""}, /* surrogate */
        {"</script>", "\"</script>\""}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct text t = {0};
        json_string_add(&t, cases[i][0]);
        assert_string_equal(shown(&t), cases[i][1]);
    }
    for (int c = 1; c < 256; c++) { /* and jansson, who is strict, can read it */
        char text[3] = {(char)c, 'x', '\0'};
        struct text t = {0};
        json_string_add(&t, text);
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
        json_number_add(&t, values[i]);
        assert_true(strtod(shown(&t), NULL) == values[i]);
    }
    struct text t = {0};
    json_number_add(&t, 0.1);
    assert_string_equal(shown(&t), "0.1");
    json_number_add(&t, (double)NAN);
    json_number_add(&t, (double)INFINITY);
    json_limit_add(&t, -APC_VALUE_MAX);
    assert_string_equal(shown(&t), "nullnullnull");
    json_time_add(&t, INT64_C(1763730125123456789));
    text_add(&t, " ");
    json_time_add(&t, -APC_NS_PER_S / 2);
    text_add(&t, " ");
    json_time_add(&t, 0);
    assert_string_equal(shown(&t), "1763730125.123456 -0.500000 0.000000");
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
    assert_false(member_whole(body, "a", 0, &whole, &f));
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
    assert_true(origin_matches("http://localhost:8080", "localhost:8080", false));
    assert_true(origin_matches("https://Plant.example", "plant.example", true));
    assert_true(
        origin_matches("https://plant.example", "plant.example", false)); /* TLS ends in front of it */
    assert_false(origin_matches("http://plant.example", "plant.example", true));
    assert_false(origin_matches("ftp://localhost:8080", "localhost:8080", false));
    assert_false(origin_matches("http://localhost:8081", "localhost:8080", false));
    assert_false(origin_matches("null", "localhost:8080", false));
    assert_false(origin_matches("http://localhost:8080", NULL, false));
}

/* ---- The plant ---------------------------------------------------------------------------- */

static void two_outputs_make_two_loops(void **state)
{
    static const struct apc_tag tags[] = {
        {.table = APC_SENSOR, .id = 1, .name = "h1", .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX},
        {.table = APC_SENSOR, .id = 2, .name = "h2", .high = 1},
        {.table = APC_SENSOR, .id = 3, .name = "T", .high = 1},
        {.table = APC_ACTUATOR, .id = 1, .name = "v1", .high = 1},
        {.table = APC_ACTUATOR, .id = 2, .name = "v2", .high = 1},
        {.table = APC_SETPOINT, .id = 1, .name = "r1", .high = 1},
        {.table = APC_TUNING, .id = 1, .name = "v1.Kp", .high = 1},
        {.table = APC_TUNING, .id = 2, .name = "v2.Kp", .high = 1},
        {.table = APC_STATE, .id = 1, .name = "hidden"},
        {.table = APC_DIM, .id = 1, .name = "hidden too"}};
    const size_t n = sizeof tags / sizeof *tags;
    struct plant p = {0};
    struct text t = {0};
    (void)state;
    assert_true(plant_describe(&p, tags, n, NULL));
    assert_int_equal(p.revision, 1);
    assert_false(plant_describe(&p, tags, n, NULL)); /* nothing new */
    assert_int_equal(p.n, 8);
    assert_int_equal(plant_confirmation(&p), 1 + 3 + 1 + 2);
    plant_json(&p, &t);
    json_t *json = json_loadb(t.at, t.n, 0, NULL);
    assert_non_null(json);
    text_free(&t);
    const json_t *loops = json_object_get(json, "loops"), *second = json_array_get(loops, 1);
    assert_int_equal(json_array_size(loops), 2);
    assert_string_equal(json_string_value(json_object_get(second, "name")), "h2");
    assert_string_equal(json_string_value(json_object_get(second, "measurement")), "sensor.2");
    assert_string_equal(json_string_value(json_object_get(second, "setpoint")),
                        "setpoint.1"); /* there is but one */
    assert_string_equal(json_string_value(json_array_get(json_object_get(second, "tuning"), 0)), "tuning.2");
    assert_string_equal(json_string_value(json_array_get(json_object_get(second, "parameters"), 0)), "Kp");
    const json_t *first = json_array_get(json_object_get(json, "variables"), 0);
    assert_true(json_is_null(json_object_get(first, "low")));
    json_decref(json);

    struct apc_tag changed[sizeof tags / sizeof *tags];
    memcpy(changed, tags, sizeof tags);
    changed[1].high = 2;
    assert_true(plant_describe(&p, changed, n, NULL));
    assert_int_equal(p.revision, 2);
    assert_true(plant_describe(&p, tags, 0, NULL)); /* nothing is described any more */
    plant_json(&p, &t);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strings_are_json_whatever_bytes_they_hold),
        cmocka_unit_test(numbers_read_back_the_same),
        cmocka_unit_test(a_body_is_read_member_by_member),
        cmocka_unit_test(times_are_absolute_or_before_now),
        cmocka_unit_test(variables_are_named_by_table_and_number),
        cmocka_unit_test(only_addresses_and_known_names_are_hosts),
        cmocka_unit_test(two_outputs_make_two_loops),
        cmocka_unit_test(only_what_lies_in_the_folder_is_served),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
