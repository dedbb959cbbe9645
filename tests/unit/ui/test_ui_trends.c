/* SPDX-License-Identifier: BSD-3-Clause */
/* Trends that people save: who sees which, two of the same name, a file that was cut or is full. */
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "scratch.h"
#include "ui_plant.h"

static void is_now(const char *user, enum role role)
{
    ui->sessions.local.writes_due = 0;
    request.session = ui->sessions.local;
    snprintf(request.session.user, sizeof request.session.user, "%s", user);
    request.session.role = role;
}

/* The status; the answer is in request.reply. */
static int save_trend_as(const char *user, enum role role, const char *body)
{
    is_now(user, role);
    request.body = (char *)(uintptr_t)body;
    request.n = strlen(body);
    json_decref(ask(post_trend));
    request.body = NULL;
    request.n = 0;
    return request.fault.http ? request.fault.http : 200;
}

/* "NAME FOR AUTHOR, ..." of what somebody sees. */
static const char *sees(const char *user, enum role role)
{
    static char text[1000];
    size_t n = 0;
    is_now(user, role);
    json_t *answer = ask(get_trends);
    assert_int_equal(request.fault.http, 0);
    text[0] = '\0';
    for (size_t i = 0; i < json_array_size(json_object_get(answer, "trends")); i++) {
        const json_t *one = json_array_get(json_object_get(answer, "trends"), i);
        n += (size_t)snprintf(text + n, sizeof text - n, "%s%s %s %s", n ? ", " : "",
                              json_string_value(json_object_get(one, "name")),
                              json_string_value(json_object_get(one, "for")),
                              json_string_value(json_object_get(one, "author")));
    }
    json_decref(answer);
    return text;
}

static double saved_at(void)
{
    json_t *answer = json_loadb(request.reply.at, request.reply.n, 0, NULL);
    const double time = json_number_value(json_object_get(answer, "time"));
    json_decref(answer);
    return time;
}

static void trends_file(char path[600])
{
    snprintf(path, 600, "%.500s/trends.jsonl", ui->displays);
}

static int set_up_folder(void **state)
{
    const int rc = set_up(state);
    char path[600];
    snprintf(ui->displays, sizeof ui->displays, "%s/displays", scratch_folder());
    trends_file(path);
    (void)unlink(path);
    return rc;
}

/* Promise(page/shared-trends) */
static void who_saves_says_who_sees_it(void **state)
{
    (void)state;
    assert_string_equal(sees("anna", ROLE_OPERATOR), "");
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"mine\",\"for\":\"user\",\"signals\":[\"y1\"],\"seen\":0}"),
                     200);
    assert_int_equal(
        save_trend_as("anna", ROLE_OPERATOR,
                      "{\"name\":\"shift \\u00e4\\n<b>\",\"for\":\"role\",\"signals\":[\"y1\"],\"seen\":0}"),
        200);
    assert_int_equal(
        save_trend_as("carl", ROLE_ENGINEER,
                      "{\"name\":\"mine\",\"for\":\"plant\",\"signals\":[\"y1\",\"u1\"],\"seen\":0}"),
        200);
    assert_string_equal(sees("anna", ROLE_OPERATOR),
                        "mine user anna, shift \u00e4\n<b> role anna, mine plant carl");
    assert_string_equal(sees("ben", ROLE_OPERATOR), "shift \u00e4\n<b> role anna, mine plant carl");
    assert_string_equal(sees("dora", ROLE_OBSERVER), "mine plant carl");
}

/* Promise(page/shared-trends) */
static void what_somebody_has_saved_meanwhile_is_not_lost(void **state)
{
    char body[200];
    (void)state;
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"day\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}"),
                     200);
    const double seen = saved_at();
    assert_int_equal(save_trend_as("ben", ROLE_OPERATOR,
                                   "{\"name\":\"day\",\"for\":\"plant\",\"signals\":[\"y2\"],\"seen\":0}"),
                     409);
    assert_string_equal(request.fault.message,
                        "anna has saved the trend \"day\" meanwhile: nothing was written");
    snprintf(body, sizeof body, "{\"name\":\"day\",\"for\":\"plant\",\"signals\":[\"y2\"],\"seen\":%.3f}",
             seen);
    assert_int_equal(save_trend_as("ben", ROLE_OPERATOR, body), 200);
    assert_true(saved_at() > seen);
    assert_int_equal(save_trend_as("carl", ROLE_ENGINEER, body), 409); /* twice at once */
    assert_string_equal(sees("anna", ROLE_OPERATOR), "day plant ben");
    snprintf(body, sizeof body, "{\"name\":\"day\",\"for\":\"plant\",\"signals\":[],\"seen\":%.3f}", seen);
    assert_int_equal(save_trend_as("carl", ROLE_ENGINEER, body), 409);
    assert_int_equal(save_trend_as("carl", ROLE_ENGINEER,
                                   "{\"name\":\"none\",\"for\":\"plant\",\"signals\":[],\"seen\":0}"),
                     404);
}

static void a_line_that_was_cut_costs_no_other(void **state)
{
    char path[600];
    (void)state;
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"a\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}"),
                     200);
    trends_file(path);
    FILE *out = fopen(path, "ae");
    assert_non_null(out);
    fputs("garbage\n{\"name\":\"b\",\"for\":7}\n[]\n"
          "{\"name\":\"e\",\"for\":\"team\",\"whose\":\"\",\"signals\":[\"y1\"],\"author\":\"ben\",\"time\":"
          "1}\n"
          "{\"name\":\"c\",\"fo",
          out);
    fclose(out);
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"d\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}"),
                     200);
    assert_string_equal(sees("ben", ROLE_OPERATOR), "a plant anna, d plant anna");
}

static void a_full_disk_leaves_what_was_there(void **state)
{
    char path[600];
    struct stat before, after;
    struct rlimit was;
    (void)state;
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"a\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}"),
                     200);
    trends_file(path);
    assert_int_equal(stat(path, &before), 0);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
    signal(SIGXFSZ, SIG_IGN);
    const struct rlimit little = {(rlim_t)before.st_size + 20, was.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &little), 0);
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"b\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}"),
                     503);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &was), 0);
    assert_int_equal(stat(path, &after), 0);
    assert_int_equal(after.st_size, before.st_size);
    assert_string_equal(sees("ben", ROLE_OPERATOR), "a plant anna");
}

static void a_file_that_cannot_be_read_says_so(void **state)
{
    const char *body = "{\"name\":\"a\",\"for\":\"plant\",\"signals\":[\"y1\"],\"seen\":0}";
    char path[600];
    (void)state;
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR, body), 200);
    trends_file(path);
    for (int pipe = 0; pipe < 2; pipe++) {
        (void)unlink(path);
        assert_int_equal(pipe ? mkfifo(path, 0600) : mkdir(path, 0700), 0);
        is_now("anna", ROLE_OPERATOR);
        json_decref(ask(get_trends));
        assert_int_equal(request.fault.http, pipe ? 0 : 503);
        assert_int_equal(save_trend_as("anna", ROLE_OPERATOR, body), 503);
        if (!pipe)
            (void)rmdir(path);
    }
    (void)unlink(path);
}

/* One name a line, as many as there is room for: each is found at once. */
static void a_file_that_is_full_is_read_and_takes_no_more(void **state)
{
    char path[600];
    (void)state;
    (void)mkdir(ui->displays, 0777);
    trends_file(path);
    FILE *out = fopen(path, "we");
    assert_non_null(out);
    size_t n = 0;
    while (ftell(out) < (4 << 20) - 100)
        fprintf(out,
                "{\"name\":\"%zu\",\"for\":\"plant\",\"whose\":\"\",\"signals\":[\"y1\"],\"author\":\"\","
                "\"time\":1}\n",
                ++n);
    fclose(out);
    is_now("anna", ROLE_OPERATOR);
    json_t *answer = ask(get_trends);
    assert_int_equal(json_array_size(json_object_get(answer, "trends")), n);
    json_decref(answer);
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"of a name that is no "
                                   "number\",\"for\":\"plant\",\"signals\":[\"y1\",\"y2\"],\"seen\":0}"),
                     409);
    assert_non_null(strstr(request.fault.message, "has 4 MiB: move it away, nothing was written"));
}

static void what_is_no_trend_is_refused(void **state)
{
    char body[300];
    (void)state;
    for (int n = 127; n <= 128; n++) { /* as openapi.json has it */
        snprintf(body, sizeof body, "{\"name\":\"a\",\"for\":\"user\",\"signals\":[\"%0*d\"],\"seen\":0}", n,
                 1);
        assert_int_equal(save_trend_as("otto", ROLE_OPERATOR, body), n == 127 ? 200 : 400);
    }
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"a\",\"for\":\"team\",\"signals\":[\"y1\"],\"seen\":0}"),
                     400);
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"\",\"for\":\"user\",\"signals\":[\"y1\"],\"seen\":0}"),
                     422);
    assert_int_equal(
        save_trend_as("anna", ROLE_OPERATOR, "{\"name\":\"a\",\"for\":\"user\",\"signals\":[1],\"seen\":0}"),
        400);
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"a\",\"for\":\"user\",\"signals\":[\"1\",\"2\",\"3\",\"4\","
                                   "\"5\",\"6\",\"7\",\"8\",\"9\",\"10\",\"11\",\"12\",\"13\"],\"seen\":0}"),
                     400);
    ui->displays[0] = '\0';
    assert_int_equal(save_trend_as("anna", ROLE_OPERATOR,
                                   "{\"name\":\"a\",\"for\":\"user\",\"signals\":[\"y1\"],\"seen\":0}"),
                     409);
    assert_string_equal(sees("anna", ROLE_OPERATOR), "");
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up_folder, tear_down)
    const struct CMUnitTest tests[] = {
        T(who_saves_says_who_sees_it),         T(what_somebody_has_saved_meanwhile_is_not_lost),
        T(a_line_that_was_cut_costs_no_other), T(a_full_disk_leaves_what_was_there),
        T(what_is_no_trend_is_refused),        T(a_file_that_is_full_is_read_and_takes_no_more),
        T(a_file_that_cannot_be_read_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
