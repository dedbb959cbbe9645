/* SPDX-License-Identifier: BSD-3-Clause */
/* Which loops need somebody, as the API tells it, on stores in memory. */
#include "experiment/experiment.h"
#include "figures/figures.h"
#include "simulation/simulation.h"
#include "ui_plant.h"

#define TICKS 600
#define BEGIN 100000 /* s */

static void record_row(enum apc_table table, int id, int64_t seq, int64_t t, double value)
{
    const struct apc_sample s = {.table = table, .id = id, .seq = seq, .time = t * S, .value = value};
    assert_int_equal(apc_store_append(store, &s, 1), 1);
}

/* Loop u1 is well, the sensor of u2 stands still after 100 s, and nobody said in which mode the loop above is. */
static void record_loops(void)
{
    struct apc_random random;
    double y = 0;
    for (size_t i = 0; i < n_tags; i++)
        if (tags[i].table == APC_TICK || tags[i].table == APC_SENSOR)
            tags[i].period = 1;
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    assert_int_equal(model_load(&ui->model, store), 0);
    apc_random_init(&random, 1, "health");
    for (int id = 1; id <= 2; id++) {
        record_row(APC_ACTUAL, apc_variable_number(APC_OPMODE, id), 1, BEGIN - 1, APC_MODE_AUTO);
        record_row(APC_SETPOINT, id, 1, BEGIN - 1, 10);
    }
    for (int64_t i = 0; i < TICKS; i++) {
        y = 0.8 * y + 0.2 * -0.5 * y + 0.1 * apc_random_normal(&random);
        for (int id = 1; id <= 2; id++) {
            record_row(APC_SENSOR, id, i + 1, BEGIN + i, id == 2 && i > 100 ? 10 : 10 + y);
            record_row(APC_ACTUATOR, id, i + 1, BEGIN + i, 5 - 0.5 * y);
        }
    }
}

static void ask_window(const char *since, const char *until)
{
    const char *const q[10] = {"since", since, "until", until};
    memcpy(query, q, sizeof q);
}

/* However many requests it takes. */
static json_t *ask_health(void)
{
    json_t *json = ask(get_health);
    while (request.fault.http == 0 && json_integer_value(json_object_get(json, "left")) > 0) {
        json_decref(json);
        json = ask(get_health);
    }
    return json;
}

static const json_t *loop_at(const json_t *json, size_t i)
{
    return json_array_get(json_object_get(json, "loops"), i);
}

static const char *text_of(const json_t *json, const char *name)
{
    return json_string_value(json_object_get(json, name));
}

/*
 * Promise(server/health): `GET /api/health` judges each loop as `apc monitor --json` does, the worst first,
 *   and keeps what it judged of a window.
 */
static void the_loop_that_needs_somebody_is_told_first(void **state)
{
    (void)state;
    record_loops();
    ask_window("100000", "100600");
    json_t *json = ask_health();
    assert_int_equal(request.fault.http, 0);
    assert_int_equal(json_array_size(json_object_get(json, "loops")), 3);
    const json_t *first = loop_at(json, 0), *unknown = loop_at(json, 1), *last = loop_at(json, 2);
    assert_string_equal(text_of(first, "loop"), "u2");
    assert_string_equal(text_of(first, "health"), "sensor");
    assert_string_equal(text_of(first, "words"), health_words(HEALTH_SENSOR));
    assert_non_null(strstr(text_of(first, "evidence"), "did not change"));
    assert_string_equal(text_of(unknown, "health"), "unknown");
    assert_non_null(strstr(text_of(unknown, "evidence"), " ticks can be judged, 500 take "));
    assert_true(json_is_null(json_object_get(unknown, "index")));
    assert_string_equal(text_of(last, "loop"), "u1");
    assert_string_equal(text_of(last, "health"), "good");
    assert_near(json_number_value(json_object_get(last, "service")), 1, 1e-6);
    assert_near(json_number_value(json_object_get(last, "since")), BEGIN, 0);
    assert_near(json_number_value(json_object_get(last, "until")), BEGIN + TICKS - 1, 1e-3);
    json_decref(json);
}

/* Promise(server/health) */
static void a_window_is_judged_once(void **state)
{
    (void)state;
    record_loops();
    for (int i = 0; i < 12; i++) { /* more windows than are kept */
        char since[16];
        snprintf(since, sizeof since, "%d", BEGIN - i);
        ask_window(since, "100600");
        json_decref(ask_health());
        assert_int_equal(request.fault.http, 0);
    }
    for (int64_t t = BEGIN + TICKS - 100; t < BEGIN + TICKS; t++)
        record_row(APC_ACTUATOR, 1, t, t, 5);
    for (int i = 0; i < 2; i++) { /* the newest of them, and the oldest, which is gone */
        ask_window(i == 0 ? "99989" : "100000", "100600");
        json_t *json = ask_health();
        const json_t *u1 = loop_at(json, 2);
        assert_string_equal(text_of(u1, "loop"), "u1");
        assert_true((json_integer_value(json_object_get(u1, "ticks")) == TICKS - TICKS / 10) == (i == 0));
        json_decref(json);
    }
}

static void the_verdicts_are_metrics_once_somebody_has_asked(void **state)
{
    (void)state;
    assert_null(strstr(ask_text(get_metrics), "apc_loop_health"));
    record_loops();
    ask_window("100000", "100600");
    json_decref(ask_health());
    ask_window("99000", "100500"); /* of an earlier end */
    json_decref(ask_health());
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_loop_health{loop=\"u2\",health=\"sensor\"} 1\n"));
    assert_non_null(strstr(metrics, "\napc_loop_health_time_seconds 100600\n"));
}

/* Promise(server/health-refused): A window without a record, too short or too long to judge is refused with the reason. */
static void a_window_that_cannot_be_judged_is_refused(void **state)
{
    static const struct {
        const char *since, *until;
        int http;
        const char *code, *words;
    } of[] = {
        {"100600", "100000", 422, "parameter", "\"since\" must be before \"until\""},
        {"100000", "100400", 422, "parameter",
         "a loop is judged by 500 ticks or more: ask for at least 500 s"},
        {"100000", "2800000", 422, "parameter", "at most 744 hours at once"},
        {"soon", "100600", 400, "parameter", "\"since\" must be Unix seconds"},
        {"200000", "201000", 422, "record",
         "no loop is on record from 1970-01-03T07:33:20.000000Z to 1970-01-03T07:50:00.000000Z"},
    };
    (void)state;
    record_loops();
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        ask_window(of[i].since, of[i].until);
        json_decref(ask_health());
        assert_int_equal(request.fault.http, of[i].http);
        assert_string_equal(request.fault.code, of[i].code);
        if (!strstr(request.fault.message, of[i].words))
            fail_msg("case %zu: %s", i, request.fault.message);
    }
    ask_window("100000", "100600");
    json_decref(ask_health());
    assert_int_equal(request.fault.http, 0);
}

static void loops_are_judged_one_after_another_of_their_newest_rows(void **state)
{
    struct health_asked asked = {.newest = 200, .give_up = 0};
    struct kpis m = {.from = BEGIN * S, .until = (BEGIN + TICKS) * S};
    (void)state;
    record_loops();
    for (int left = 2; left >= 0; left--) /* its time is over, and there is one more each time */
        assert_int_equal(health_of_store(&m, store, &asked), left);
    assert_int_equal(m.n_loops, 3);
    assert_true(m.loop[0].from == (BEGIN + TICKS - 200) * S);
    kpis_free(&m);
}

/* Promise(server/health) */
static void a_valve_that_sticks_is_found_in_a_record(void **state)
{
    static const struct {
        const char *former, *present;
    } changes[] = {
        {"period = 150.0;", "period = 4000.0;"},
        {"name = \"y\"; description = \"measurement\";", "name = \"y\"; noise = 0.1;"},
        {"safe = 0.0; }",
         "safe = 0.0; faults = ( { kind = \"stiction\"; at = 100.0; size = 0.2; jump = 0.1; } ); }"},
    };
    char text[1 << 14], since[32], until[32];
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    struct apc_store *there = store;
    (void)state;
    FILE *in = fopen(APC_SOURCE_DIR "/experiments/first-order.conf", "re");
    assert_non_null(in);
    text[fread(text, 1, sizeof text / 2, in)] = '\0';
    fclose(in);
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        char *const at = strstr(text, changes[i].former), rest[1 << 14];
        assert_non_null(at);
        snprintf(rest, sizeof rest, "%s", at + strlen(changes[i].former));
        snprintf(at, sizeof text - (size_t)(at - text), "%s%s", changes[i].present, rest);
    }
    const struct experiment_source source = {.file = "sticks.conf", .text = text};
    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
    assert_int_equal(simulation_run(&s, 3500), 0);
    assert_int_equal(provision(s.store, &e, PROVISION_KEEP), 0);
    const double begin = apc_ns_to_s(SIMULATION_BEGIN);
    snprintf(since, sizeof since, "%.0f", begin);
    snprintf(until, sizeof until, "%.0f", begin + 3500);
    ask_window(since, until);
    store = s.store;
    json_t *json = ask_health();
    store = there;
    if (request.fault.http)
        fail_msg("%s", request.fault.message);
    const json_t *u = loop_at(json, 0);
    assert_string_equal(text_of(u, "health"), "valve");
    assert_near(json_number_value(json_object_get(u, "friction")), 0.2, 0.1);
    json_decref(json);
    simulation_destroy(&s);
    experiment_free(&e);
}

static void a_store_that_is_away_is_no_empty_answer(void **state)
{
    struct apc_store *there = store;
    (void)state;
    assert_int_equal(apc_store_open(&store, "sqlite:/no/such/folder/store.db", NULL, NULL), 0);
    json_decref(ask_health());
    assert_int_equal(request.fault.http, 503);
    assert_string_equal(request.fault.code, "store");
    apc_store_close(store);
    store = there;
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(the_loop_that_needs_somebody_is_told_first),
        T(a_window_is_judged_once),
        T(the_verdicts_are_metrics_once_somebody_has_asked),
        T(a_window_that_cannot_be_judged_is_refused),
        T(loops_are_judged_one_after_another_of_their_newest_rows),
        T(a_valve_that_sticks_is_found_in_a_record),
        T(a_store_that_is_away_is_no_empty_answer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
