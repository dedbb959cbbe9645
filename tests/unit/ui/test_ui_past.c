/* SPDX-License-Identifier: BSD-3-Clause */
/* What the API answers of what was, asked without a connection, on a store in memory. */
#include <sys/stat.h>
#include <unistd.h>

#include "experiment/experiment.h"
#include "figures/figures.h"
#include "simulation/simulation.h"
#include "ui_plant.h"

static json_t *answer;

/* ---- What was ----------------------------------------------------------------------------- */

static void put_samples(enum apc_table table, int id, int n)
{
    struct apc_sample s[200];
    assert_true(n <= 200);
    for (int i = 0; i < n; i++)
        s[i] =
            (struct apc_sample){.table = table, .id = id, .seq = i + 1, .time = (1000 + i) * S, .value = i};
    assert_int_equal(apc_store_append(store, s, (size_t)n), n);
}

static void ask_history(const char *what, const char *value, const char *how, const char *n)
{
    const char *const q[] = {what, value, how, n, "since", "1000", "until", "1010"};
    memcpy(query, q, sizeof q);
}

static void what_a_law_does_not_publish_now_is_old_and_no_alarm(void **state)
{
    (void)state;
    describe_a_shadow();
    period(S, S);
    plant_rhythm(&ui->model.plant, "trial", S);
    all_came(0);
    ticked(2, 0);
    came(APC_OPMODE, 4, APC_MODE_AUTO, 0);
    actual(4, APC_MODE_OOS);
    came(APC_ESTIMATE, 1, 2.5, 0);
    came(APC_ESTIMATE, 2, 2.75, 10 * S);
    assert_false(stale("estimate.1"));
    assert_true(stale("estimate.2"));
    assert_string_equal(ask_text(get_readyz), "ok\n");
    assert_non_null(
        strstr(ask_text(get_metrics),
               "apc_signal_value{table=\"estimate\",name=\"trial.u1.output\",unit=\"m\"} 2.75\n"));
    put_samples(APC_ESTIMATE, 2, 10);
    ask_history("names", "trial.u1.output", "last", "3");
    json_t *all = ask(get_history);
    const json_t *one = json_array_get(json_object_get(all, "series"), 0);
    assert_string_equal(json_string_value(json_object_get(one, "ref")), "estimate.2");
    assert_int_equal(json_array_size(json_object_get(json_object_get(one, "samples"), "value")), 3);
    json_decref(all);
}

/* Promise(run/at-time-shows) */
static void state_and_alarms_are_told_as_of_a_time(void **state)
{
    (void)state;
    const char *const future[] = {"at", "2200-01-01T00:00:00Z"}, *const then[] = {"at", "1004.5"},
                      *const never[] = {"at", "then"};
    put_samples(APC_SENSOR, 1, 10);
    struct apc_sample r = {.table = APC_SETPOINT, .id = 1, .time = 1002 * S, .value = 0.25};
    r.author = (uint32_t)apc_store_author(store, "ann");
    assert_int_equal(apc_store_put(store, &r, 1), 0);
    r.time = 1005 * S;
    assert_int_equal(apc_store_put(store, &r, 1), 0);
    memcpy(query, then, sizeof then);
    json_t *all = ask(get_state);
    const json_t *values = json_object_get(all, "values"), *y = json_object_get(values, "sensor.1"),
                 *sp = json_object_get(values, "setpoint.1");
    assert_int_equal(request.fault.http, 0);
    assert_true(json_number_value(json_object_get(all, "as_of")) == 1004.5);
    assert_true(json_is_null(json_object_get(all, "note")));
    assert_int_equal(json_integer_value(json_array_get(y, 0)), 5);
    assert_true(json_number_value(json_array_get(y, 2)) == 4);
    assert_true(json_number_value(json_object_get(json_object_get(all, "ages"), "sensor.1")) == 0.5);
    assert_int_equal(json_integer_value(json_array_get(sp, 0)), 1);
    assert_string_equal(json_string_value(json_object_get(json_object_get(all, "authors"), "setpoint.1")),
                        "ann");
    assert_true(json_is_null(json_array_get(json_object_get(values, "actuator.2"), 1)));
    json_decref(all);
    json_t *alarms = ask(get_alarms);
    assert_int_equal(request.fault.http, 0);
    assert_true(json_number_value(json_object_get(alarms, "as_of")) == 1004.5);
    assert_int_equal(json_array_size(json_object_get(alarms, "alarms")), 0);
    json_decref(alarms);
    for (int i = 0; i < 2; i++) {
        memcpy(query, i ? never : future, sizeof never);
        json_decref(ask(get_state));
        /* the store is in memory, whose clock is its own */
        assert_int_equal(request.fault.http, i ? 400 : 0);
        json_decref(ask(get_alarms));
        assert_int_equal(request.fault.http, i ? 400 : 0);
    }
    memset(query, 0, sizeof query);
}

/*
 * Promise(server/history-events-timing): History, events and timing: limits, `before`, bins, several at
 *   once, filters.
 */
static void history_is_given_by_name_for_several_at_once(void **state)
{
    (void)state;
    put_samples(APC_SENSOR, 1, 10);
    put_samples(APC_ACTUATOR, 2, 5);
    ask_history("var", "y1", "last", "100");
    json_t *one = ask(get_history);
    assert_string_equal(json_string_value(json_object_get(one, "ref")), "sensor.1");
    assert_int_equal(json_array_size(json_object_get(json_object_get(one, "samples"), "value")), 10);
    json_decref(one);
    ask_history("names", "y1,nonsense,actuator.2", "last", "3");
    json_t *all = ask(get_history);
    assert_int_equal(request.fault.http, 0);
    const json_t *series = json_object_get(all, "series"), *y = json_array_get(series, 0),
                 *none = json_array_get(series, 1), *u = json_array_get(series, 2);
    assert_int_equal(json_array_size(series), 3);
    assert_string_equal(json_string_value(json_object_get(y, "ref")), "sensor.1");
    assert_int_equal(json_array_size(json_object_get(json_object_get(y, "samples"), "value")), 3);
    assert_string_equal(json_string_value(json_object_get(none, "name")), "nonsense");
    assert_string_equal(json_string_value(json_object_get(json_object_get(none, "error"), "code")),
                        "variable");
    assert_null(json_object_get(none, "samples"));
    assert_string_equal(json_string_value(json_object_get(u, "ref")), "actuator.2");
    assert_near(json_number_value(json_array_get(json_object_get(json_object_get(u, "samples"), "value"), 2)),
                4, 0);
    json_decref(all);
    ask_history("names", "y1,u2", "bins", "5");
    all = ask(get_history);
    y = json_object_get(json_array_get(json_object_get(all, "series"), 0), "bins");
    assert_int_equal(json_integer_value(json_object_get(y, "n")), 5);
    assert_int_equal(json_array_size(json_object_get(y, "mean")), 5);
    assert_near(json_number_value(json_array_get(json_object_get(y, "mean"), 4)), 8.5, 1e-12);
    json_decref(all);
}

/* Promise(page/drawing-shows-signals) */
static void the_drawing_is_given_as_it_is_and_must_not_run(void **state)
{
    const char *text = "<svg onload=\"alert(1)\"/>";
    json_t *plant;
    (void)state;
    json_decref(ask(get_graphic));
    assert_int_equal(request.fault.http, 404);
    assert_string_equal(request.fault.code, "graphic");
    plant = ask(get_plant);
    assert_true(json_is_false(json_object_get(plant, "graphic")));
    json_decref(plant);
    text_put(&ui->graphic, text, strlen(text));
    assert_string_equal(ask_text(get_graphic), text);
    assert_int_equal(request.fault.http, 0);
    assert_string_equal(request.type, "image/svg+xml");
    assert_true(request.sandbox);
    plant = ask(get_plant);
    assert_true(json_is_true(json_object_get(plant, "graphic")));
    assert_true(json_is_false(json_object_get(plant, "displays")));
    json_decref(plant);
    text_free(&ui->graphic);
}

/* Promise(page/drawing-shows-signals) */
static void a_drawing_has_at_most_a_mebibyte(void **state)
{
    char path[] = "/tmp/apc-graphic.XXXXXX", part[1 << 16];
    struct text graphic = {0};
    struct apc_error why;
    const int fd = mkstemp(path);
    (void)state;
    assert_true(fd >= 0);
    assert_int_equal(graphic_load(&graphic, "/nowhere/drawing.svg", &why), APC_ENOTFOUND);
    assert_int_equal(graphic_load(&graphic, "/tmp", &why), APC_ESYS); /* a folder */
    assert_int_equal(graphic_load(&graphic, path, &why), APC_ESYS);   /* empty */
    memset(part, ' ', sizeof part);
    for (int i = 0; i < 16; i++)
        assert_int_equal(write(fd, part, sizeof part), sizeof part);
    assert_int_equal(graphic_load(&graphic, path, &why), 0);
    assert_int_equal(graphic.n, 1 << 20);
    text_free(&graphic);
    assert_int_equal(write(fd, part, 1), 1);
    assert_int_equal(graphic_load(&graphic, path, &why), APC_ERANGE);
    assert_non_null(strstr(why.text, "at most 1 MiB"));
    assert_int_equal(graphic.n, 0);
    close(fd);
    unlink(path);
}

/* Promise(server/history-events-timing) */
static void a_name_that_two_have_is_nobodys(void **state)
{
    (void)state;
    ask_history("var", "u1", "last", "3"); /* a loop's mode is called as its output, which is meant */
    json_t *output = ask(get_history);
    assert_string_equal(json_string_value(json_object_get(output, "ref")), "actuator.1");
    json_decref(output);
    ask_history("var", "upper.r1", "last", "3"); /* and where there is no such output, it is the mode */
    output = ask(get_history);
    assert_string_equal(json_string_value(json_object_get(output, "ref")), "opmode.3");
    json_decref(output);
    snprintf(ui->model.plant.tag[0].name, APC_TAG_LEN, "u1");
    ask_history("var", "u1", "last", "3");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 404);
    assert_non_null(strstr(request.fault.message, "several"));
    ask_history("names", "u1", "last", "3");
    json_t *all = ask(get_history);
    const json_t *error = json_object_get(json_array_get(json_object_get(all, "series"), 0), "error");
    assert_non_null(strstr(json_string_value(json_object_get(error, "message")), "several"));
    json_decref(all);
}

/* `name,...` lines as they were answered, without a fault. */
static const char *history_lines(void)
{
    const char *text = ask_text(get_history);
    assert_int_equal(request.fault.http, 0);
    assert_string_equal(request.type, "text/csv; charset=utf-8");
    return text;
}

static void in_form(const char *form)
{
    query[8] = "format";
    query[9] = form;
}

/* Promise(server/past-values-csv): Past values as CSV and as binary columns, of what JSON gives. */
static void history_comes_as_csv_of_all_that_was_asked_for(void **state)
{
    struct apc_sample bad = {.table = APC_SENSOR,
                             .id = 2,
                             .seq = 1,
                             .time = 1001 * S + 500000,
                             .value = 0,
                             .status = APC_BAD_NO_DATA};
    (void)state;
    put_samples(APC_SENSOR, 1, 4);
    assert_int_equal(apc_store_append(store, &bad, 1), 1);
    snprintf(ui->model.plant.tag[0].name, APC_TAG_LEN, "say \"y\"");
    ask_history("names", "say \"y\",sensor.2", "last", "2");
    in_form("csv");
    assert_string_equal(history_lines(), "name,seq,time,value,status\n"
                                         "\"say \"\"y\"\"\",3,1002.000000,2,Good\n"
                                         "\"say \"\"y\"\"\",4,1003.000000,3,Good\n"
                                         "sensor.2,1,1001.000500,0,BadNoData\n");
    ask_history("names", "sensor.1,y2", "bins", "5");
    in_form("csv");
    assert_string_equal(history_lines(), "name,from,count,bad,min,max,mean,last,worst\n"
                                         "sensor.1,1000.000000,2,0,0,1,0.5,1,Good\n"
                                         "sensor.1,1002.000000,2,0,2,3,2.5,3,Good\n"
                                         "y2,1000.000000,0,1,,,,,BadNoData\n");
    ask_history("var", "sensor.1", "last", "1");
    in_form("csv");
    assert_string_equal(history_lines(), "name,seq,time,value,status\nsensor.1,4,1003.000000,3,Good\n");
    ask_history("names", "y2,nonsense", "last", "2"); /* no file that lacks what was asked for */
    in_form("csv");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 404);
    assert_non_null(strstr(request.fault.message, "nonsense"));
}

/* What the header says of a column is where it says. */
static const unsigned char *column_data(const unsigned char *data, size_t n_data, const json_t *columns,
                                        const char *name, const char *type, size_t n)
{
    const json_t *column = json_object_get(columns, name);
    const size_t at = (size_t)json_integer_value(json_object_get(column, "at")),
                 size = !strcmp(type, "f64") ? 8 : 4;
    assert_string_equal(json_string_value(json_object_get(column, "type")), type);
    assert_int_equal(json_integer_value(json_object_get(column, "n")), n);
    assert_int_equal(at % 8, 0);
    assert_true(at + n * size <= n_data);
    return data + at;
}

static double f64(const unsigned char *at)
{
    uint64_t bits = 0;
    double value;
    for (int i = 7; i >= 0; i--)
        bits = bits << 8 | at[i];
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t u32(const unsigned char *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* The answer in binary columns, taken apart; the header is to be given back. */
static json_t *take_apart(const unsigned char **data, size_t *n_data)
{
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
    assert_string_equal(request.type, "application/vnd.apc.columns");
    const unsigned char *reply = (const unsigned char *)request.reply.at;
    const size_t n = u32(reply);
    assert_int_equal((4 + n) % 8, 0);
    assert_true(4 + n <= request.reply.n);
    *data = reply + 4 + n;
    *n_data = request.reply.n - 4 - n;
    return json_loadb((const char *)reply + 4, n, 0, NULL);
}

/* Promise(server/past-values-csv) */
static void history_comes_as_binary_columns(void **state)
{
    const unsigned char *data;
    size_t n;
    (void)state;
    put_samples(APC_SENSOR, 1, 5);
    put_samples(APC_ACTUATOR, 2, 3);
    ask_history("names", "y1,nonsense,u2", "last", "100");
    in_form("columns");
    json_t *header = take_apart(&data, &n);
    const json_t *series = json_object_get(header, "series"),
                 *y = json_object_get(json_array_get(series, 0), "samples"),
                 *u = json_object_get(json_array_get(series, 2), "samples");
    assert_non_null(json_object_get(json_array_get(series, 1), "error"));
    for (size_t i = 0; i < 5; i++) {
        assert_near(f64(column_data(data, n, y, "seq", "f64", 5) + 8 * i), (double)i + 1, 0);
        assert_near(f64(column_data(data, n, y, "time", "f64", 5) + 8 * i), 1000 + (double)i, 0);
        assert_near(f64(column_data(data, n, y, "value", "f64", 5) + 8 * i), (double)i, 0);
        assert_int_equal(u32(column_data(data, n, y, "status", "u32", 5) + 4 * i), APC_GOOD);
    }
    assert_near(f64(column_data(data, n, u, "value", "f64", 3) + 16), 2, 0);
    json_decref(header);
    ask_history("var", "y2", "bins", "5"); /* nothing in it */
    in_form("columns");
    header = take_apart(&data, &n);
    assert_int_equal(n, 0);
    column_data(data, n, json_object_get(header, "bins"), "worst", "u32", 0);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(header, "bins"), "n")), 5);
    json_decref(header);
    struct apc_sample bad = {
        .table = APC_SENSOR, .id = 2, .seq = 1, .time = 1001 * S, .value = 0, .status = APC_BAD_NO_DATA};
    assert_int_equal(apc_store_append(store, &bad, 1), 1);
    ask_history("var", "y2", "bins", "5");
    in_form("columns");
    header = take_apart(&data, &n);
    const json_t *bins = json_object_get(header, "bins");
    assert_true(isnan(f64(column_data(data, n, bins, "mean", "f64", 1))));
    assert_near(f64(column_data(data, n, bins, "bad", "f64", 1)), 1, 0);
    assert_int_equal(u32(column_data(data, n, bins, "worst", "u32", 1)), APC_BAD_NO_DATA);
    json_decref(header);
}

/* 400: it cannot be read; 422: what it asks for does not go together. */
static void assert_refused(void)
{
    if (request.fault.http != 400 && request.fault.http != 422)
        fail_msg("%d %s", request.fault.http, request.fault.message);
}

/* y1,y1,... */
static void name_often(char *names, size_t n)
{
    for (size_t i = 0; i < n; i++)
        memcpy(names + 3 * i, "y1,", 3);
    names[3 * n - 1] = '\0';
}

static void history_is_asked_for_in_one_way(void **state)
{
    char many[4000];
    (void)state;
    const char *const bad[][8] = {{"since", "1", "last", "3"},
                                  {"var", "y1", "names", "y1", "last", "3"},
                                  {"var", "y1"},
                                  {"var", "y1", "last", "3", "bins", "3"},
                                  {"names", many, "last", "3"},
                                  {"names", many, "bins", "151"},
                                  {"var", "y1", "last", "0"},
                                  {"var", "y1", "last", "20001"},
                                  {"var", "y1", "bins", "4001"},
                                  {"var", "y1", "last", "3", "format", "xml"},
                                  {"var", "y1", "last", "3", "format", ""},
                                  {"var", "y1", "last", "3", "until", "5", "since", "5"}};
    name_often(many, 33);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        memset(query, 0, sizeof query);
        memcpy(query, bad[i], sizeof bad[i]);
        json_decref(ask(get_history));
        assert_refused();
    }
    ask_history("names", many, "bins", "150"); /* few bins of many are as good as many of few */
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
    name_often(many, 512);
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
    name_often(many, 513);
    json_decref(ask(get_history));
    assert_refused();
    name_often(many, 32);
    ask_history("names", many, "last", "1");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
}

/* Their number, the first one's text, and whether there are more. */
static size_t events(const char *const *q, size_t n, char first[32], bool *more)
{
    memset(query, 0, sizeof query);
    memcpy(query, q, n * sizeof *q);
    query[n] = "since";
    query[n + 1] = "0";
    json_t *json = ask(get_events);
    assert_non_null(json);
    const json_t *list = json_object_get(json, "events");
    const char *text = json_string_value(json_object_get(json_array_get(list, 0), "text"));
    size_t found = json_array_size(list);
    snprintf(first, 32, "%s", text ? text : "");
    *more = json_is_true(json_object_get(json, "more"));
    json_decref(json);
    return found;
}

/* Promise(server/history-events-timing) */
static void the_newest_events_are_found_however_many_lie_on_top(void **state)
{
    char first[32];
    bool more;
    (void)state;
    put_events(10, "rare");
    put_events(20000, "common");
    static const char *const newest[] = {"last", "8"}, *const rare[] = {"last", "8", "kind", "rare"},
                             *const all_rare[] = {"last", "10", "kind", "rare"},
                             *const none[] = {"kind", "none"}, *const text[] = {"last", "3", "text", "19999"},
                             *const source[] = {"last", "2", "source", "y"};
    assert_int_equal(events(newest, 2, first, &more), 8);
    assert_string_equal(first, "19992");
    assert_true(more);
    assert_int_equal(events(rare, 4, first, &more), 8);
    assert_string_equal(first, "2");
    assert_true(more);
    assert_int_equal(events(all_rare, 4, first, &more), 10);
    assert_string_equal(first, "0");
    assert_false(more);
    assert_int_equal(events(none, 2, first, &more), 0);
    assert_false(more);
    assert_int_equal(events(text, 4, first, &more), 1);
    assert_int_equal(events(source, 4, first, &more), 0);
}

static void exactly_as_many_events_as_asked_for_are_all(void **state)
{
    static const char *const five[] = {"last", "5"}, *const four[] = {"last", "4"},
                             *const grave[] = {"severity", "2"};
    char first[32];
    bool more;
    (void)state;
    put_events(5, "x");
    assert_int_equal(events(five, 2, first, &more), 5);
    assert_false(more);
    assert_int_equal(events(four, 2, first, &more), 4);
    assert_string_equal(first, "1");
    assert_true(more);
    assert_int_equal(events(grave, 2, first, &more), 0);
}

/* Promise(server/history-events-timing) */
static void timing_is_put_together_by_task_and_against_time(void **state)
{
    (void)state;
    put_window("controller", "run", 1005 * S, 2, 1000000, 1);
    put_window("controller", "run", 1010 * S, 6, 2000000, 2);
    put_window("controller", "jitter", 1010 * S, 4, -3000, 0);
    put_window("client", "run", 1010 * S, 3, 5000, 0);
    static const char *const one[] = {"since", "1000",       "until",    "1020",
                                      "task",  "controller", "quantity", "run"};
    memcpy(query, one, sizeof one);
    json_t *json = ask(get_timing);
    const json_t *list = json_object_get(json, "timing"), *run = json_array_get(list, 0);
    assert_int_equal(json_array_size(list), 1);
    assert_int_equal(json_integer_value(json_object_get(run, "count")), 8);
    assert_int_equal(json_integer_value(json_object_get(run, "missed")), 3);
    assert_near(json_number_value(json_object_get(run, "mean")), 0.00175, 1e-9);
    assert_int_equal(json_array_size(json_object_get(run, "bins")), 2);
    const json_t *bin = json_array_get(json_object_get(run, "bins"), 1);
    assert_near(json_number_value(json_array_get(bin, 0)), 0.0019999, 1e-12);
    assert_near(json_number_value(json_array_get(bin, 1)), 0.0020001, 1e-12);
    assert_int_equal(json_integer_value(json_array_get(bin, 2)), 6);
    json_decref(json);
    query[4] = NULL;
    json = ask(get_timing);
    assert_int_equal(json_array_size(json_object_get(json, "timing")), 3);
    json_decref(json);

    static const char *const series[] = {"since",      "1000",     "until", "1020",   "task",
                                         "controller", "quantity", "run",   "points", "4"};
    memcpy(query, series, sizeof series);
    json = ask(get_timing_series);
    const json_t *columns = json_object_get(json, "series");
    assert_near(json_number_value(json_object_get(json, "period")), 2, 0);
    assert_int_equal(json_array_size(json_object_get(columns, "time")), 2); /* empty intervals are left out */
    assert_near(json_number_value(json_array_get(json_object_get(columns, "time"), 0)), 1005, 1e-6);
    assert_int_equal(json_integer_value(json_array_get(json_object_get(columns, "count"), 1)), 6);
    assert_near(json_number_value(json_array_get(json_object_get(columns, "mean"), 0)), 0.001, 1e-12);
    json_decref(json);
    query[9] = "1"; /* both windows in one: the worst of them */
    json = ask(get_timing_series);
    columns = json_object_get(json, "series");
    assert_int_equal(json_array_size(json_object_get(columns, "time")), 1);
    assert_int_equal(json_integer_value(json_array_get(json_object_get(columns, "count"), 0)), 8);
    assert_int_equal(json_integer_value(json_array_get(json_object_get(columns, "missed"), 0)), 3);
    assert_near(json_number_value(json_array_get(json_object_get(columns, "mean"), 0)), 0.00175, 1e-12);
    assert_near(json_number_value(json_array_get(json_object_get(columns, "p50"), 0)), 0.002, 1e-12);
    assert_near(json_number_value(json_array_get(json_object_get(columns, "max"), 0)), 0.00200009, 1e-12);
    json_decref(json);
}

static void timing_is_asked_for_in_one_way(void **state)
{
    static const char *const bad[][10] = {{"quantity", "nonsense"},
                                          {"since", "0", "until", "86401"},
                                          {"since", "5", "until", "5"}},
                             *const bad_series[][10] = {
                                 {"task", "controller"},
                                 {"quantity", "run"},
                                 {"task", "controller", "quantity", "x"},
                                 {"task", "controller", "quantity", "run", "points", "0"},
                                 {"task", "controller", "quantity", "run", "points", "2001"}};
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        memcpy(query, bad[i], sizeof bad[i]);
        json_decref(ask(get_timing));
        assert_refused();
    }
    for (size_t i = 0; i < sizeof bad_series / sizeof *bad_series; i++) {
        memcpy(query, bad_series[i], sizeof bad_series[i]);
        json_decref(ask(get_timing_series));
        assert_int_equal(request.fault.http, 400);
    }
    static const char *const day[10] = {"since", "0", "until", "86400"};
    memcpy(query, day, sizeof day);
    json_decref(ask(get_timing));
    assert_int_equal(request.fault.http, 0);
}

/* Promise(server/history-events-timing) */
static void what_stood_before_the_window_is_told(void **state)
{
    (void)state;
    put_samples(APC_SETPOINT, 1, 5); /* from 1000 s on */
    put_samples(APC_SENSOR, 1, 5);
    ask_history("var", "setpoint.1", "last", "10");
    query[5] = "1002";
    json_t *json = ask(get_history);
    assert_near(json_number_value(json_array_get(json_object_get(json, "before"), 2)), 1, 0);
    assert_int_equal(json_array_size(json_object_get(json_object_get(json, "samples"), "seq")), 3);
    json_decref(json);
    query[5] = "1000";
    json = ask(get_history);
    assert_true(json_is_null(json_object_get(json, "before")));
    json_decref(json);
    query[1] = "sensor.1";
    query[5] = "1002";
    json = ask(get_history);
    assert_true(json_is_null(json_object_get(json, "before"))); /* it does not stand */
    json_decref(json);
}

/* Promise(server/history-events-timing) */
static void a_bad_sample_is_counted_and_not_averaged(void **state)
{
    struct apc_sample s[] = {{.table = APC_SENSOR, .id = 1, .seq = 1, .time = 1000 * S, .value = 4},
                             {.table = APC_SENSOR, .id = 1, .seq = 2, .time = 1001 * S, .value = 8},
                             {.table = APC_SENSOR,
                              .id = 1,
                              .seq = 3,
                              .time = 1002 * S,
                              .value = 99,
                              .status = APC_BAD_NO_COMMUNICATION},
                             {.table = APC_SENSOR,
                              .id = 1,
                              .seq = 4,
                              .time = 1006 * S,
                              .value = 99,
                              .status = APC_BAD_NO_COMMUNICATION}};
    (void)state;
    assert_int_equal(apc_store_append(store, s, 4), 4);
    ask_history("var", "sensor.1", "bins", "2");
    json_t *json = ask(get_history);
    const json_t *bins = json_object_get(json, "bins");
    static const struct {
        const char *name;
        double first;
    } of[] = {{"count", 2}, {"bad", 1}, {"min", 4}, {"max", 8}, {"mean", 6}, {"last", 8}, {"from", 1000}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_near(json_number_value(json_array_get(json_object_get(bins, of[i].name), 0)), of[i].first, 0);
    assert_true(json_is_null(json_array_get(json_object_get(bins, "mean"), 1))); /* nothing but Bad */
    assert_string_equal(json_string_value(json_array_get(json_object_get(bins, "worst"), 0)),
                        "BadNoCommunication");
    json_decref(json);
}

/* Promise(laws/predictive-law-expected) */
static void what_was_expected_stands_beside_what_came(void **state)
{
    double value[] = {1.5, 2.5, 3.5};
    struct apc_vector v = {
        .table = APC_PREDICTION, .id = 1, .seq = 1, .time = 1000 * S, .n = 3, .room = 3, .value = value};
    (void)state;
    tags[n_tags++] =
        (struct apc_tag){.table = APC_PREDICTION, .id = 1, .name = "y1.prediction", .step = 2, .length = 3};
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    assert_true(
        apc_store_append_rows(
            store, &(struct apc_rows){.size = sizeof(struct apc_rows), .vector = &v, .n_vectors = 1}) >= 0);
    put_samples(APC_SENSOR, 1, 5); /* 0 to 4 from 1000 s on */
    static const char *const at[10] = {"at", "1001"}, *const before[10] = {"at", "999"},
                             *const soon[10] = {"at", "soon"};
    memcpy(query, at, sizeof at);
    json_t *json = ask(get_prediction);
    const json_t *list = json_object_get(json, "predictions"), *y = json_array_get(list, 0);
    assert_int_equal(json_array_size(list), 1);
    assert_string_equal(json_string_value(json_object_get(y, "ref")), "sensor.1");
    assert_near(json_number_value(json_object_get(y, "made")), 1000, 0);
    assert_near(json_number_value(json_object_get(y, "first")), 2, 0);
    assert_near(json_number_value(json_array_get(json_object_get(y, "expected"), 1)), 2.5, 0);
    assert_near(json_number_value(json_array_get(json_object_get(y, "came"), 1)), 4, 0);
    assert_true(json_is_null(json_array_get(json_object_get(y, "came"), 2))); /* nothing newer was measured */
    json_decref(json);
    memcpy(query, before, sizeof before);
    json = ask(get_prediction);
    assert_int_equal(json_array_size(json_object_get(json, "predictions")), 0);
    json_decref(json);
    memcpy(query, soon, sizeof soon);
    json_decref(ask(get_prediction));
    assert_int_equal(request.fault.http, 400);
}

static void record(enum apc_table table, int id, int64_t t, apc_status status, double value)
{
    const struct apc_sample s = {
        .table = table, .id = id, .seq = t, .time = t * S, .status = status, .value = value};
    assert_int_equal(apc_store_append(store, &s, 1), 1);
}

/* 10 s of loop u1 in Auto, from before the window on; y1 is 1 above and 1 below its setpoint in turn. */
static void record_service(void)
{
    double value[] = {10.5, 0, 13};
    struct apc_vector v = {
        .table = APC_PREDICTION, .id = 1, .seq = 1, .time = 1002 * S, .n = 3, .room = 3, .value = value};
    for (size_t i = 0; i < n_tags; i++)
        if (tags[i].table == APC_TICK || (tags[i].table == APC_SENSOR && tags[i].id == 1))
            tags[i].period = 1;
    tags[n_tags++] =
        (struct apc_tag){.table = APC_PREDICTION, .id = 1, .name = "y1.prediction", .step = 2, .length = 3};
    tag(APC_ESTIMATE, 1, "y1.limit", 0, 3);
    tag(APC_ESTIMATE, 2, "base.u1.limit", 0, 15);
    tags_of("base", n_tags - 1);
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    record(APC_ACTUAL, apc_variable_number(APC_OPMODE, 1), 990, APC_GOOD, APC_MODE_AUTO);
    record(APC_SETPOINT, 1, 990, APC_GOOD, 10);
    for (int64_t t = 1000; t < 1010; t++) {
        record(APC_SENSOR, 1, t, APC_GOOD, t % 2 ? 9 : 11);
        record(APC_ACTUATOR, 1, t, t >= 1004 && t < 1007 ? APC_GOOD_LIMITED_HIGH : APC_GOOD, 5);
    }
    assert_true(
        apc_store_append_rows(
            store, &(struct apc_rows){.size = sizeof(struct apc_rows), .vector = &v, .n_vectors = 1}) >= 0);
    record(APC_ESTIMATE, 2, 1002, APC_GOOD, 2);
    record(APC_ESTIMATE, 2, 1004, APC_GOOD, 0);
}

static double figure_of(const json_t *json, const char *list, const char *name)
{
    return json_number_value(json_object_get(json_array_get(json_object_get(json, list), 0), name));
}

/* Promise(laws/time-service-limits) */
static void what_the_controllers_were_worth_is_told(void **state)
{
    static const char *const day[10] = {"since", "1000", "until", "87400"},
                             *const before[10] = {"since", "10", "until", "20"},
                             *const backwards[10] = {"since", "20", "until", "10"};
    struct kpis m;
    (void)state;
    record_service();
    memcpy(query, day, sizeof day);
    json_t *json = ask(get_kpis);
    assert_near(json_number_value(json_object_get(json, "since")), 1000, 0);
    assert_near(json_number_value(json_object_get(json, "until")), 1009, 1e-3); /* of what is on record */
    assert_int_equal(json_array_size(json_object_get(json, "loops")), 3);
    assert_near(figure_of(json, "loops", "service"), 1, 1e-6);
    assert_near(figure_of(json, "loops", "at_high"), 3.0 / 9, 1e-6);
    assert_near(figure_of(json, "loops", "sd_in_service"), sqrt(10.0 / 9), 1e-12);
    const json_t *u2 = json_array_get(json_object_get(json, "loops"), 1);
    assert_string_equal(json_string_value(json_object_get(u2, "name")), "u2");
    assert_true(json_is_null(json_object_get(u2, "service"))); /* nobody said in which mode it is */
    assert_near(figure_of(json, "predictions", "rms_one_step"), 0.5, 1e-12);
    assert_near(figure_of(json, "predictions", "rms_all_steps"), 2, 1e-12);
    const json_t *plans = json_array_get(json_object_get(json, "plans"), 1);
    assert_string_equal(json_string_value(json_object_get(plans, "ref")), "actuator.1");
    assert_int_equal(json_integer_value(json_object_get(plans, "plans")), 2);
    assert_near(json_number_value(json_object_get(plans, "high")), 0.5, 0);
    json_decref(json);
    memcpy(query, before, sizeof before);
    json = ask(get_kpis);
    assert_int_equal(request.fault.http, 0);
    assert_int_equal(json_array_size(json_object_get(json, "loops")), 0);
    json_decref(json);
    memcpy(query, backwards, sizeof backwards);
    json_decref(ask(get_kpis));
    assert_int_equal(request.fault.http, 422);
    assert_int_equal(kpis_of_store(&m, store, 1000 * S, 1010 * S, 20), APC_ERANGE);
    kpis_free(&m);
    assert_int_equal(kpis_of_store(&m, store, 1000 * S, 1010 * S, 21), 0); /* the setpoint before as well */
    kpis_free(&m);
}

/* Of the store of a simulation of that shipped experiment. */
static void ask_why_of(const char *name, const char *const q[10])
{
    char path[300], text[1 << 14];
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    struct apc_store *there = store;
    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, name);
    FILE *in = fopen(path, "r");
    assert_non_null(in);
    const size_t n = fread(text, 1, sizeof text - 1, in);
    fclose(in);
    text[n] = '\0';
    const struct experiment_source source = {.file = path, .text = text};
    assert_int_equal(experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why), 0);
    assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
    assert_int_equal(simulation_run(&s, 40), 0);
    assert_int_equal(provision(s.store, &e, PROVISION_KEEP), 0);
    memset(query, 0, sizeof query);
    memcpy(query, q, 10 * sizeof *q);
    store = s.store;
    json_t *json = ask(get_why);
    store = there;
    simulation_destroy(&s);
    experiment_free(&e);
    answer = json;
}

static void why_an_output_moved_is_told(void **state)
{
    static const char *const tick[10] = {"output", "u"}, *const move[10] = {"output", "u", "over", "30"},
                             *const soon[10] = {"output", "u", "at", "soon"},
                             *const other[10] = {"output", "v"};
    double parts = 0;
    size_t i;
    const json_t *cause;
    (void)state;
    ask_why_of("first-order", tick);
    assert_int_equal(request.fault.http, 0);
    assert_string_equal(json_string_value(json_object_get(answer, "output")), "u");
    json_decref(answer);
    ask_why_of("first-order", move);
    json_array_foreach(json_object_get(answer, "inputs"), i, cause) parts +=
        json_number_value(json_object_get(cause, "effect"));
    for (i = 0; i < 2; i++)
        parts += json_number_value(json_object_get(answer, i ? "earlier" : "together"));
    assert_near(parts,
                json_number_value(json_object_get(answer, "now")) -
                    json_number_value(json_object_get(answer, "before")),
                1e-9);
    json_decref(answer);
    ask_why_of("first-order", other);
    json_decref(answer);
    assert_int_equal(request.fault.http, 404);
    assert_string_equal(request.fault.message, "there is no loop \"v\"");
    ask_why_of("first-order", soon);
    json_decref(answer);
    assert_int_equal(request.fault.http, 400);
}

static void what_cannot_be_read_is_no_empty_answer(void **state)
{
    static const char *const series[10] = {"task", "controller", "quantity", "run"}, *const loop[10] = {
                                                                                         "output", "u1"};
    void (*const ask_past[])(struct ui *, struct request *, struct apc_store *) = {
        get_events, get_timing, get_timing_series, get_history, get_prediction, get_kpis, get_why};
    struct apc_store *there = store;
    (void)state;
    assert_int_equal(apc_store_open(&store, "sqlite:/no/such/folder/store.db", NULL, NULL), 0);
    for (size_t i = 0; i < sizeof ask_past / sizeof *ask_past; i++) {
        memset(query, 0, sizeof query);
        if (ask_past[i] == get_timing_series)
            memcpy(query, series, sizeof series);
        if (ask_past[i] == get_why)
            memcpy(query, loop, sizeof loop);
        if (ask_past[i] == get_history)
            ask_history("var", "sensor.1", "last", "3");
        json_decref(ask(ask_past[i]));
        assert_int_equal(request.fault.http, 503);
        assert_string_equal(request.fault.code, "store");
    }
    apc_store_close(store);
    store = there;
}

static void plants_that_could_not_be_listed_are_not_asked_for_at_once_again(void **state)
{
    struct apc_store *there = store;
    (void)state;
    assert_int_equal(apc_store_open(&store, "postgresql://127.0.0.1:1/nothing", NULL, NULL), 0);
    json_decref(ask(get_plants));
    assert_int_equal(request.fault.http, 503);
    apc_store_close(store);
    store = there;
    ui->listing.made = apc_clock_mono(NULL) + 1000 * S; /* within its second, however long that takes here */
    json_decref(ask(get_plants));
    assert_int_equal(request.fault.http, 503);
    assert_string_equal(request.fault.code, "store");
    assert_non_null(strstr(request.fault.message, "the database is offline: "));
    ui->listing.made = apc_clock_mono(NULL) - S;
    json_t *json = ask(get_plants);
    assert_int_equal(request.fault.http, 0);
    assert_int_equal(json_array_size(json_object_get(json, "plants")), 0); /* this store is of one */
    json_decref(json);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(timing_is_put_together_by_task_and_against_time),
        T(timing_is_asked_for_in_one_way),
        T(what_stood_before_the_window_is_told),
        T(a_bad_sample_is_counted_and_not_averaged),
        T(what_was_expected_stands_beside_what_came),
        T(what_the_controllers_were_worth_is_told),
        T(why_an_output_moved_is_told),
        T(what_cannot_be_read_is_no_empty_answer),
        T(plants_that_could_not_be_listed_are_not_asked_for_at_once_again),
        T(what_a_law_does_not_publish_now_is_old_and_no_alarm),
        T(state_and_alarms_are_told_as_of_a_time),
        T(history_is_given_by_name_for_several_at_once),
        T(history_comes_as_csv_of_all_that_was_asked_for),
        T(history_comes_as_binary_columns),
        T(the_drawing_is_given_as_it_is_and_must_not_run),
        T(a_drawing_has_at_most_a_mebibyte),
        T(a_name_that_two_have_is_nobodys),
        T(history_is_asked_for_in_one_way),
        T(the_newest_events_are_found_however_many_lie_on_top),
        T(exactly_as_many_events_as_asked_for_are_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
