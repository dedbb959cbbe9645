/* SPDX-License-Identifier: BSD-3-Clause */
/* The engineer's workbench, asked on the loop of the paper in virtual time: gain 10, time constant 10 s, PI. */
#include "experiment/experiment.h"
#include "simulation/simulation.h"
#include "ui_plant.h"

#define RUN 650.0 /* s: five setpoints */

static struct experiment paper;
static struct simulation simulated;
static struct apc_store *own;
static char text[1 << 14];

/* The file, changed where @p former is; its record in `store`. */
static void simulate_paper(const char *former, const char *present)
{
    char rest[1 << 13];
    struct apc_error why;
    FILE *in = fopen(APC_SOURCE_DIR "/experiments/first-order.conf", "re");
    assert_non_null(in);
    text[fread(text, 1, sizeof text / 2, in)] = '\0';
    fclose(in);
    char *const at = strstr(text, former);
    assert_non_null(at);
    snprintf(rest, sizeof rest, "%s", at + strlen(former));
    snprintf(at, sizeof text - (size_t)(at - text), "%s%s", present, rest);
    const struct experiment_source source = {.file = "paper.conf", .text = text};
    if (experiment_parse(&paper, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(simulation_create(&simulated, &paper, 1, &why), 0);
    assert_int_equal(simulation_run(&simulated, RUN), 0);
    assert_int_equal(provision(simulated.store, &paper, PROVISION_KEEP), 0);
    own = store;
    store = simulated.store;
    assert_int_equal(model_load(&ui->model, store), 0);
}

static int simulated_down(void **state)
{
    if (own) {
        store = own;
        own = NULL;
        simulation_destroy(&simulated);
        experiment_free(&paper);
    }
    return tear_down(state);
}

static void ask_query(const char *const *q)
{
    memset(query, 0, sizeof query);
    for (size_t i = 0; q[i]; i++)
        query[i] = q[i];
}

static const char *since_begin(double s)
{
    static char at[2][32];
    static int next;
    next = !next;
    snprintf(at[next], sizeof at[next], "%.3f", apc_ns_to_s(SIMULATION_BEGIN) + s);
    return at[next];
}

static double number_in(const json_t *json, const char *name)
{
    assert_non_null(json_object_get(json, name));
    return json_number_value(json_object_get(json, name));
}

static json_t *answered(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    json_t *json = ask(handle);
    if (request.fault.http)
        fail_msg("%s", request.fault.message);
    assert_non_null(json);
    return json;
}

/* Promise(server/model): `GET /api/model` finds the plant's transfer functions in a window of its record, with
 *   intervals, and says what it cannot tell. */
static void the_model_of_the_paper_is_found_in_its_record(void **state)
{
    (void)state;
    simulate_paper("title", "title");
    ask_query((const char *[]){"inputs", "u", "outputs", "y", "since", since_begin(10), "until",
                               since_begin(RUN), NULL});
    json_t *json = answered(get_model);
    const json_t *cell = json_array_get(json_object_get(json, "cells"), 0),
                 *error = json_object_get(cell, "error");
    assert_near(number_in(cell, "gain"), 10.0, 0.1);
    assert_near(number_in(cell, "tau1"), 10.0, 0.1);
    assert_near(number_in(cell, "dead_time"), 0.75, 0.75); /* an output waits for the client, and the plant */
    assert_true(number_in(error, "gain") > 0.0 && number_in(error, "gain") < 0.1);
    assert_true(number_in(json_array_get(json_object_get(json, "outputs"), 0), "fit") > 90.0);
    const json_t *response = json_object_get(cell, "response"), *half = json_object_get(cell, "half");
    /* an interval is of all numbers, or there is none */
    assert_true(json_array_size(half) == json_array_size(response) ||
                (json_array_size(half) == 0 && json_is_null(json_object_get(error, "zero"))));
    assert_near(json_number_value(json_array_get(response, json_array_size(response) - 1)), 10.0, 0.2);
    const double samples = number_in(json, "samples");
    json_decref(json);
    /* a time that begins long before the record thins nothing */
    ask_query((const char *[]){"inputs", "u", "outputs", "y", "since", since_begin(10 - 7200), "until",
                               since_begin(RUN), NULL});
    json = answered(get_model);
    assert_true(number_in(json, "samples") >= samples);
    json_decref(json);
}

static const char *windows_of(const double (*of)[2], size_t n)
{
    static char all[512];
    size_t at = 0;
    for (size_t i = 0; i < n; i++)
        at += (size_t)snprintf(all + at, sizeof all - at, "%s%s..", i ? "," : "", since_begin(of[i][0])),
            at += (size_t)snprintf(all + at, sizeof all - at, "%s", since_begin(of[i][1]));
    return all;
}

/* A setpoint's step at 150, 300, 450 s; what lies between the windows has no part in it. */
/* Promise(server/model/windows): Several windows of a record are fitted together, each around a point of its own,
 *   with one or two lags if that is asked for. */
static void several_windows_are_fitted_together(void **state)
{
    static const double good[][2] = {{10, 290}, {310, 640}},
                        many[][2] = {{1, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 6}, {6, 7}, {7, 8}, {8, 9}, {9, 10}};
    static const double back[][2] = {{310, 640}, {10, 290}}, none[][2] = {{20, 10}};
    (void)state;
    simulate_paper("title", "title");
    ask_query(
        (const char *[]){"inputs", "u", "outputs", "y", "windows", windows_of(good, 2), "order", "1", NULL});
    json_t *json = answered(get_model);
    const json_t *cell = json_array_get(json_object_get(json, "cells"), 0);
    assert_near(number_in(json, "records"), 2, 0);
    assert_near(number_in(json, "samples"), (280 + 330) / number_in(json, "period"), 4);
    assert_near(number_in(cell, "gain"), 10.0, 0.2);
    assert_near(number_in(cell, "tau1"), 10.0, 0.5);
    assert_near(number_in(cell, "tau2"), 0.0, 0.0);
    assert_true(number_in(json_array_get(json_object_get(json, "outputs"), 0), "fit") > 90.0);
    json_decref(json);
    const struct {
        const double (*of)[2];
        size_t n;
    } refused[] = {{many, 9}, {back, 2}, {none, 1}, {NULL, 0}};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        ask_query((const char *[]){"inputs", "u", "outputs", "y", "windows",
                                   refused[i].n ? windows_of(refused[i].of, refused[i].n) : "now", NULL});
        json_decref(ask(get_model));
        assert_int_equal(request.fault.http, 422);
        assert_non_null(strstr(request.fault.message, "\"windows\" must be SINCE..UNTIL"));
    }
}

/* Promise(server/model/warnings): `GET /api/model` tells what makes the record doubtful, as `apc identify` does. */
static void what_makes_the_record_doubtful_is_told(void **state)
{
    (void)state;
    simulate_paper("high = 10.0;", "high = 1.6;");
    ask_query((const char *[]){"inputs", "u", "outputs", "y", "since", since_begin(10), "until",
                               since_begin(RUN), NULL});
    json_t *json = answered(get_model);
    const json_t *warnings = json_object_get(json, "warnings"), *warning = json_array_get(warnings, 0);
    assert_int_equal(json_array_size(warnings), 1);
    assert_string_equal(json_string_value(json_object_get(warning, "kind")), "limit");
    assert_string_equal(json_string_value(json_object_get(warning, "of")), "u");
    assert_true(json_is_null(json_object_get(warning, "with")));
    assert_true(number_in(warning, "value") > 0.05 && number_in(warning, "value") < 0.5);
    assert_non_null(
        strstr(json_string_value(json_object_get(warning, "text")), "u stands at its highest, 1.6,"));
    json_decref(json);
}

/* Promise(server/model) */
static void a_record_that_cannot_tell_is_refused_with_the_reason(void **state)
{
    static const struct {
        const char *inputs, *outputs;
        double since, until;
        const char *code, *words;
    } of[] = {
        {"u", "y", 600, 640, "record", "all the time"},
        {"u", "y", 5000, 6000, "record", "there is nothing to tell from"},
        {"u", "y", 600, 602, "record", "are the least for 1 inputs"},
        {"r", "u", 10, 600, "record", "there is no measurement \"u\""},
        {"u,u", "y", 10, 600, "record", "is named twice"},
        {"a,b,c", "d,e", 10, 600, "parameter", "at most 4 pairs"},
        {"a,b,c,d,e,f,g,h", "y", 10, 600, "parameter", "at most 4 pairs"},
        {"", "y", 10, 600, "parameter", "\"inputs\" is needed"},
        {"u", "y", 10, 9e6, "parameter", "ask for less time at once"},
        {"u", "y", 600, 10, "parameter", "must be before"},
    };
    (void)state;
    simulate_paper("sequence = ( [10.0], [20.0], [5.0], [15.0] );", "sequence = ( [10.0] );");
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        ask_query((const char *[]){"inputs", of[i].inputs, "outputs", of[i].outputs, "since",
                                   since_begin(of[i].since), "until", since_begin(of[i].until), NULL});
        json_decref(ask(get_model));
        if (request.fault.http != 422 || strcmp(request.fault.code, of[i].code) != 0 ||
            !strstr(request.fault.message, of[i].words))
            fail_msg("case %zu: %d %s", i, request.fault.http, request.fault.message);
    }
}

/* Promise(page/signals) */
static void figures_of_signals_are_of_the_window(void **state)
{
    static const struct {
        const char *names, *words;
        double until;
    } refused[] = {{"u", "must be a measurement", 600},
                   {"y,u,r,y,u", "at most 4 signals", 600},
                   {"", "\"names\" is needed", 600},
                   {"y,nobody", "there is no output, setpoint or measurement \"nobody\"", 600},
                   {"y,u,u", "is named twice", 600},
                   {"y", "ask for less time at once", 9e6}};
    (void)state;
    simulate_paper("title", "title");
    ask_query((const char *[]){"names", "r,u,y", "since", since_begin(10), "until", since_begin(RUN), NULL});
    json_t *json = answered(get_signals);
    assert_int_equal(json_array_size(json_object_get(json, "signals")), 3);
    assert_int_equal(json_array_size(json_object_get(json, "pairs")), 6);
    const json_t *y = json_array_get(json_object_get(json, "signals"), 0);
    assert_string_equal(json_string_value(json_object_get(y, "name")), "y");
    assert_true(number_in(y, "low") < 6.0 && number_in(y, "high") > 19.0);
    json_decref(json);
    ask_query((const char *[]){"names", "y", "since", since_begin(10), "until", since_begin(RUN), NULL});
    json = answered(get_signals);
    assert_int_equal(json_array_size(json_object_get(json, "pairs")), 1);
    json_decref(json);
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        ask_query((const char *[]){"names", refused[i].names, "since", since_begin(10), "until",
                                   since_begin(refused[i].until), NULL});
        json_decref(ask(get_signals));
        if (request.fault.http != 422 || !strstr(request.fault.message, refused[i].words))
            fail_msg("case %zu: %d %s", i, request.fault.http, request.fault.message);
    }
}

static double last_of(const json_t *curve)
{
    const json_t *v = json_object_get(curve, "v");
    return json_number_value(json_array_get(v, json_array_size(v) - 1));
}

/*
 * Promise(server/preview): `GET /api/preview` runs the loop's own controller on a model with the present and the
 *   proposed tuning, from rest to a setpoint step and a disturbance.
 * A PI loop that does not swing leaves an IAE of load tau_i / Kp behind a disturbance of its output.
 */
static void a_preview_is_what_the_loop_would_do(void **state)
{
    (void)state;
    simulate_paper("title", "title");
    ask_query((const char *[]){"loop", "1", "gain", "10", "tau1", "10", "dead_time", "1", "Kp", "0.4", NULL});
    json_t *json = answered(get_preview);
    const json_t *present = json_object_get(json, "present"), *proposed = json_object_get(json, "proposed"),
                 *suggested = json_object_get(json, "suggested");
    const double load = fabs(number_in(json, "step")) / 10.0;
    assert_near(number_in(present, "Kp"), 0.2, 1e-9);
    assert_near(number_in(present, "tau_i"), 10.0, 1e-9);
    assert_near(number_in(proposed, "Kp"), 0.4, 1e-9);
    assert_near(number_in(suggested, "Kp"), 10.0 / (10.0 * 4.0),
                1e-3); /* theta: 1 s and half a period of 2 s */
    assert_near(number_in(present, "iae_disturbance"), load * 10.0 / 0.2, 0.05 * load * 50.0);
    const json_t *y = json_object_get(proposed, "y"), *v = json_object_get(y, "v");
    const double rest = json_number_value(json_array_get(v, 0));
    assert_near(last_of(y), rest + number_in(json, "step"), 0.02 * fabs(number_in(json, "step")));
    assert_int_equal(json_array_size(v), json_array_size(json_object_get(y, "t")));
    /* the output goes back by the disturbance, from where the setpoint left it */
    assert_near(last_of(json_object_get(proposed, "u")),
                json_number_value(
                    json_array_get(json_object_get(json_object_get(present, "u"), "v"),
                                   json_array_size(json_object_get(json_object_get(present, "u"), "v")) - 1)),
                0.01);
    json_decref(json);
}

/* Promise(server/preview/worst): With standard errors of the model `GET /api/preview` shows the proposed tuning with the
 *   worst of the models that they allow. */
static void the_worst_of_the_models_is_shown(void **state)
{
    static const char *const errors[] = {"0.5", "4", "3e7"}, *const late[] = {"0.1", "-1", "1e9"};
    (void)state;
    simulate_paper("title", "title");
    for (size_t i = 0; i < sizeof errors / sizeof *errors;
         i++) { /* the last: of numbers the record does not tell */
        ask_query((const char *[]){"loop", "1", "gain", "10", "tau1", "10", "dead_time", "1",
                                   "dead_time_error", late[i], "gain_error", errors[i], "Kp", "0.5", NULL});
        json_t *json = answered(get_preview);
        const json_t *worst = json_object_get(json, "worst"), *proposed = json_object_get(json, "proposed");
        assert_near(number_in(json, "models"), 50, 0);
        assert_int_equal(json_array_size(json_object_get(json_object_get(worst, "y"), "v")) > 0, 1);
        if (i == 0) {
            assert_near(number_in(json, "unstable"), 0, 0);
            assert_true(number_in(worst, "sensitivity") > number_in(proposed, "sensitivity"));
            assert_true(number_in(worst, "gain_margin") < number_in(proposed, "gain_margin"));
        } else if (i == 1) {
            assert_true(number_in(json, "unstable") > 0);
            assert_true(json_is_false(json_object_get(worst, "stable")));
        }
        json_decref(json);
    }
    ask_query(
        (const char *[]){"loop", "1", "gain", "10", "tau1", "10", "Kp", "0.5", "gain_error", "-2", NULL});
    json_decref(ask(get_preview));
    assert_int_equal(request.fault.http, 400);
}

/* Promise(server/preview) */
static void what_cannot_be_previewed_is_refused(void **state)
{
    static const struct {
        const char *loop, *gain, *tau1, *more, *value, *words;
        int http;
    } of[] = {
        {"2", "10", "10", "Kp", "1", "there is no loop with the id 2", 404},
        {"0", "10", "10", "Kp", "1", "\"loop\" must be a whole number", 400},
        {"1", "0", "10", "tau_c", "1", "the gain must not be 0", 422},
        {"1", "10", "0", "tau_c", "1", "the plant has no lag", 422},
        {"1", "10", "-1", "tau_c", "1", "\"tau1\" must be a number from 0", 400},
        {"1", "ten", "10", "tau_c", "1", "\"gain\" must be a number", 400},
        {"1", "10", "10", "Kp", "nan", "\"Kp\" must be a number", 400},
        {"1", "10", "10", "Kp", "0", "Kp must not be 0", 422},
        {"1", "10", "10", "rule", "zn", "\"rule\" must be simc, lambda or relay", 400},
    };
    (void)state;
    simulate_paper("title", "title");
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        ask_query((const char *[]){"loop", of[i].loop, "gain", of[i].gain, "tau1", of[i].tau1, of[i].more,
                                   of[i].value, NULL});
        json_decref(ask(get_preview));
        if (request.fault.http != of[i].http || !strstr(request.fault.message, of[i].words))
            fail_msg("case %zu: %d %s", i, request.fault.http, request.fault.message);
    }
}

static void a_store_without_an_experiment_has_no_preview(void **state)
{
    (void)state;
    ask_query((const char *[]){"loop", "1", "gain", "10", "tau1", "10", NULL});
    json_decref(ask(get_preview));
    assert_int_equal(request.fault.http, 422);
    assert_non_null(strstr(request.fault.message, "the store has no experiment to try it with"));
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, simulated_down)
    const struct CMUnitTest tests[] = {
        TEST(the_model_of_the_paper_is_found_in_its_record),
        TEST(several_windows_are_fitted_together),
        TEST(figures_of_signals_are_of_the_window),
        TEST(what_makes_the_record_doubtful_is_told),
        TEST(a_record_that_cannot_tell_is_refused_with_the_reason),
        TEST(a_preview_is_what_the_loop_would_do),
        TEST(the_worst_of_the_models_is_shown),
        TEST(what_cannot_be_previewed_is_refused),
        TEST(a_store_without_an_experiment_has_no_preview),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
