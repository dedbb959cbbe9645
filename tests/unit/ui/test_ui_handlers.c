/* SPDX-License-Identifier: BSD-3-Clause */
/* What the API answers of the plant as it stands, asked without a connection, on a store in memory. */
#include <sys/stat.h>
#include <unistd.h>

#include "figures/figures.h"
#include "ui_plant.h"

/*
 * Promise(server/stale-running): Stale, running, reason and safe are judged by ticks and events, not by
 *   what was written last.
 */
static void what_never_came_but_should_is_stale(void **state)
{
    (void)state;
    assert_false(stale("sensor.1")); /* how often it should come is not known */
    period(S, S);
    assert_true(stale("sensor.1"));
    assert_true(stale("actuator.2"));
    assert_false(stale("setpoint.1"));
    came(APC_SENSOR, 1, 1, 0);
    assert_false(stale("sensor.1"));
    came(APC_SENSOR, 1, 1, 3 * S + S / 2);
    assert_true(stale("sensor.1"));
    came(APC_SENSOR, 1, 1, 2 * S + S / 2);
    assert_false(stale("sensor.1"));
}

/* Promise(server/stale-running) */
static void a_controller_is_judged_by_its_own_ticks(void **state)
{
    (void)state;
    all_came(0);
    assert_string_equal(control("running"),
                        "{\"base\": null, \"upper\": null}"); /* nobody has said how often */
    period(S, S);
    assert_string_equal(control("running"), "{\"base\": true, \"upper\": true}");
    assert_string_equal(control("reasons"), "{}");
    all_came(10 * S); /* many periods of one, one of the other */
    assert_string_equal(control("running"), "{\"base\": false, \"upper\": true}");
    actual(1, APC_MODE_LO);
    assert_string_equal(control("reasons"), "{}"); /* what it says is no news any more */
    came(APC_SENSOR, 1, 0.5, 0);
    came(APC_SENSOR, 2, 0.5, 0);
    const char *ready = ask_text(get_readyz);
    assert_non_null(strstr(ready, "base: no tick for 10."));
    assert_null(strstr(ready, "u1")); /* said once */
    assert_null(strstr(ready, "upper"));
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_control_running{controller=\"base\"} 0\n"));
    assert_non_null(strstr(metrics, "\napc_control_running{controller=\"upper\"} 1\n"));
    ticked(0, 0);
    ui->model.tick[1].seq = 0;
    assert_string_equal(control("running"), "{\"base\": true, \"upper\": false}");
    assert_non_null(strstr(ask_text(get_readyz), "upper: no tick yet\n"));
}

static void out_of_service_writes_nothing_and_runs_all_the_same(void **state)
{
    struct task *task = &ui->model.task[0];
    (void)state;
    period(S, S);
    all_came(0);
    came(APC_ACTUATOR, 2, 1.25, 100 * S);
    assert_non_null(strstr(ask_text(get_readyz), "u2: no sample for 100."));
    actual(2, APC_MODE_OOS);
    assert_string_equal(ask_text(get_readyz), "ok\n");
    came(APC_ACTUATOR, 1, 1.25, 100 * S); /* the other loop is not */
    assert_non_null(strstr(ask_text(get_readyz), "u1: no sample for 100."));
    came(APC_ACTUATOR, 1, 1.25, 0);
    snprintf(task->name, sizeof task->name, "scheduler");
    task->period = S;
    task->heard = apc_clock_mono(NULL) - 5 * S;
    ui->model.tasks = 1;
    assert_string_equal(ask_text(get_readyz), "ok\n");
    task->heard -= 10 * S;
    assert_non_null(strstr(ask_text(get_readyz), "scheduler: no tick reported for 15."));
}

/* Promise(server/stale-running) */
static void why_the_mode_is_not_the_target_is_said_of_its_loop_while_it_lasts(void **state)
{
    (void)state;
    period(S, S);
    all_came(0);
    actual(2, APC_MODE_LO);
    assert_string_equal(control("reasons"),
                        "{\"2\": \"output at its fault value\"}"); /* it was not told why */
    an_event("apc-controller", "measurement", APC_EVENT_ALARM, "u2: output at its fault value: y2 is stale");
    an_event("apc-client", "measurement", APC_EVENT_WARNING, "something else");
    an_event("apc-controller", "mode", APC_EVENT_INFO, "u1: mode Man");
    assert_string_equal(control("reasons"), "{\"2\": \"output at its fault value: y2 is stale\"}");
    actual(1, APC_MODE_LO); /* of it nothing of the kind was said */
    assert_string_equal(
        control("reasons"),
        "{\"1\": \"output at its fault value\", \"2\": \"output at its fault value: y2 is stale\"}");
    actual(1, APC_MODE_AUTO);
    actual(2, APC_MODE_AUTO);
    assert_string_equal(control("reasons"), "{}"); /* it is what was asked for */
    actual(2, APC_MODE_LO);
    an_event("apc-controller", "measurement", APC_EVENT_INFO, "u2: inputs good again after 3 s");
    assert_string_equal(control("reasons"), "{\"2\": \"output at its fault value\"}");
    an_event("apc-controller", "measurement", APC_EVENT_ALARM, "all of them"); /* which names none */
    assert_string_equal(control("reasons"), "{\"2\": \"all of them\"}");
    an_event("apc-controller", "start", APC_EVENT_INFO, "running every 1 s");
    assert_string_equal(control("reasons"), "{\"2\": \"output at its fault value\"}");
    actual(2, APC_MODE_AUTO);
    came(APC_OPMODE, 1, APC_MODE_CAS, 0);
    assert_string_equal(control("reasons"), "{\"1\": \"no setpoint from above\"}");
    came(APC_OPMODE, 1, APC_MODE_AUTO, 0);
    actual(3, APC_MODE_IMAN);
    an_event("apc-controller", "mode", APC_EVENT_INFO,
             "upper.r1: mode IMan: the loop below does not take the output");
    assert_string_equal(control("reasons"), "{\"3\": \"the loop below does not take the output\"}");
    an_event("apc-controller", "mode", APC_EVENT_INFO, "upper.r1: mode Auto");
    assert_string_equal(control("reasons"), "{\"3\": \"what takes its output is not ready for it\"}");
}

/* Promise(modes/entry-note) */
static void what_stands_between_an_entry_and_its_effect_is_told_of_its_loop(void **state)
{
    (void)state;
    period(S, S);
    all_came(0);
    assert_string_equal(control("entries"), "{}");
    now_of(APC_ACTUATOR, 1)->status = APC_GOOD_LIMITED_HIGH;
    actual(2, APC_MODE_LO);
    assert_string_equal(control("entries"),
                        "{\"1\": {\"code\": \"high\", \"text\": \"the output is at its high limit\"}, "
                        "\"2\": {\"code\": \"fault\", \"text\": \"the output is at its fault value\"}}");
    ticked(0, 10 * S);
    assert_non_null(strstr(control("entries"), "\"1\": {\"code\": \"stopped\""));
    all_came(0);
    actual(2, APC_MODE_AUTO);
    an_event("apc-plant", "watchdog", APC_EVENT_ALARM, "no new command for 3 s: plant at its safe value");
    assert_non_null(strstr(control("entries"), "\"2\": {\"code\": \"safe\""));
    assert_null(strstr(control("entries"), "\"3\"")); /* into a setpoint */
}

/* Promise(server/stale-running) */
static void the_plant_at_its_safe_value_stands_until_it_takes_commands(void **state)
{
    (void)state;
    assert_string_equal(control("safe"), "null");
    assert_null(strstr(ask_text(get_metrics), "\napc_plant_safe "));
    an_event("apc-plant", "start", APC_EVENT_INFO, "running every 1 s");
    assert_string_equal(control("safe"), "true"); /* it starts there */
    an_event("apc-plant", "watchdog", APC_EVENT_INFO, "plant begins with its initial input"); /* or not */
    assert_string_equal(control("safe"), "false");
    an_event("apc-plant", "start", APC_EVENT_INFO, "running every 1 s");
    an_event("apc-plant", "watchdog", APC_EVENT_INFO, "plant takes commands");
    assert_string_equal(control("safe"), "false");
    assert_string_equal(control("safe_since"), "null");
    an_event("apc-controller", "watchdog", APC_EVENT_ALARM, "somebody else's");
    an_event("apc-plant", "rejected", APC_EVENT_WARNING, "a command");
    assert_string_equal(control("safe"), "false");
    an_event("apc-plant", "watchdog", APC_EVENT_ALARM, "no new command for 3 s: plant at its safe value");
    assert_string_equal(control("safe"), "true");
    assert_string_equal(control("safe_since"), "1763730000.0");
    assert_non_null(strstr(ask_text(get_metrics), "\napc_plant_safe 1\n"));
    period(S, S);
    all_came(0);
    assert_string_equal(ask_text(get_readyz), "the plant is given no command\n");
    assert_int_equal(request.status, 503);
}

static void of_an_external_plant_its_client_says_whether_it_is_commanded(void **state)
{
    (void)state;
    an_event("apc-client", "start", APC_EVENT_INFO, "running every 1 s");
    assert_string_equal(control("safe"), "null"); /* it may be ours */
    an_event("apc-client", "command", APC_EVENT_INFO, "the plant is given its commands");
    assert_string_equal(control("safe"), "false");
    an_event("apc-client", "link", APC_EVENT_WARNING, "plant lost, trying again");
    an_event("apc-plant", "watchdog", APC_EVENT_ALARM, "somebody else's");
    assert_string_equal(control("safe"), "false");
    an_event("apc-client", "command", APC_EVENT_WARNING, "the plant is given no command");
    assert_string_equal(control("safe"), "true");
    an_event("apc-client", "command", APC_EVENT_INFO, "the plant is given its commands");
    an_event("apc-client", "start", APC_EVENT_INFO, "running every 1 s");
    assert_string_equal(control("safe"), "true");
}

/* Promise(server/stale-running) */
static void ready_is_what_ticks(void **state)
{
    (void)state;
    period(S, S);
    all_came(0);
    assert_string_equal(ask_text(get_readyz), "ok\n");
    assert_int_equal(request.status, 200);
    came(APC_ACTUATOR, 2, 1, 12 * S);
    assert_non_null(strstr(ask_text(get_readyz), "u2: no sample for 12."));
    assert_int_equal(request.status, 503);
    request.session = (struct session){0}; /* names are not for strangers */
    assert_string_equal(ask_text(get_readyz), "signals or tasks that do not tick: 1\n");
    request.session = ui->sessions.local;
    all_came(0);
    now_of(APC_SENSOR, 2)->seq = 0;
    assert_string_equal(ask_text(get_readyz), "y2: no sample yet\n");
    ui->model.connected = false;
    assert_string_equal(ask_text(get_readyz), "the database is offline\n");
    assert_int_equal(request.status, 503);
}

/* Promise(server/stale-running) */
static void a_thread_that_goes_round_no_more_is_not_alive(void **state)
{
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        assert_string_equal(ask_text(get_livez), "ok\n");
        assert_int_equal(request.status, 200);
        ui->round[i] = apc_clock_mono(NULL) - 31 * S;
        assert_non_null(
            strstr(ask_text(get_livez), i ? "reads events has stopped" : "reads values has stopped"));
        assert_int_equal(request.status, 503);
        ui->round[i] = apc_clock_mono(NULL) - 20 * S;
    }
}

/* Promise(server/metrics) */
static void a_link_is_there_before_it_ever_changed(void **state)
{
    (void)state;
    period(S, S);
    assert_non_null(strstr(ask_text(get_metrics), "apc_link_up{link=\"apc-client\"} 0\n"));
    all_came(0);
    assert_non_null(strstr(ask_text(get_metrics), "apc_link_up{link=\"apc-client\"} 1\n"));
    assert_non_null(strstr(ask_text(get_metrics), "apc_link_reconnects_total{link=\"apc-client\"} 0\n"));
    json_t *all = ask(get_diagnostics);
    const json_t *link = json_array_get(json_object_get(all, "links"), 0);
    assert_true(json_is_true(json_object_get(link, "up")));
    assert_true(json_is_null(json_object_get(link, "since")));
    json_decref(all);
    snprintf(ui->model.link[0].name, sizeof ui->model.link[0].name, "apc-client");
    ui->model.link[0].changes = 3;
    ui->model.links = 1;
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "apc_link_up{link=\"apc-client\"} 0\n"));
    assert_non_null(strstr(metrics, "apc_link_reconnects_total{link=\"apc-client\"} 3\n"));
    assert_null(strstr(strstr(metrics, "apc_link_up{") + 1, "apc_link_up{")); /* once */
}

static json_t *history_of_state(json_t **whole)
{
    *whole = ask(get_state);
    return json_object_get(*whole, "history");
}

/* Promise(stores/memory-full) */
static void shared_memory_that_is_full_is_told_as_long_as_it_is(void **state)
{
    struct apc_store_room room = {.cells_max = 100, .cells = 100, .table = APC_SENSOR, .id = 2};
    json_t *whole = ask(get_state);
    (void)state;
    period(S, S);
    all_came(0);
    assert_true(json_is_null(json_object_get(json_object_get(whole, "store"), "full")));
    json_decref(whole);
    assert_null(strstr(ask_text(get_metrics), "apc_store_")); /* it is no memory */
    model_room(ui, &(struct apc_store_room){.cells_max = 100, .cells = 9});
    assert_string_equal(ask_text(get_readyz), "ok\n");
    assert_non_null(strstr(ask_text(get_metrics), "\napc_store_full 0\n"));
    room.full = true;
    room.refused = 7;
    model_room(ui, &room);
    assert_non_null(strstr(ask_text(get_readyz), "the store is full: it has no room for sensor 2 (y2): "));
    assert_int_equal(request.status, 503);
    request.session = (struct session){0}; /* names are not for strangers */
    assert_string_equal(ask_text(get_readyz), "the store is full\n");
    assert_int_equal(request.status, 503);
    request.session = ui->sessions.local;
    whole = ask(get_state);
    assert_non_null(strstr(json_string_value(json_object_get(json_object_get(whole, "store"), "full")),
                           "no room for sensor 2 (y2)"));
    json_decref(whole);
    assert_non_null(strstr(ask_text(get_metrics), "\napc_store_full 1\n"));
    assert_non_null(strstr(ask_text(get_metrics), "\napc_store_refused_rows_total 7\n"));
    came(APC_ACTUATOR, 2, 1, 12 * S); /* neither hides the other */
    assert_non_null(strstr(ask_text(get_readyz), "u2: no sample for 12."));
    assert_non_null(strstr(ask_text(get_readyz), "the store is full"));
    came(APC_ACTUATOR, 2, 1, 0);
    model_room(ui, &(struct apc_store_room){.cells_max = 100, .cells = 100, .refused = 7});
    assert_string_equal(ask_text(get_readyz), "ok\n");
    assert_non_null(strstr(ask_text(get_metrics), "\napc_store_full 0\n"));
}

/*
 * Promise(page/how-far-history): How far the history is behind the live store, or that it is away: state,
 *   stream, metrics, and quietly on the page.
 */
static void how_far_the_history_is_behind_is_said_where_there_is_one(void **state)
{
    json_t *whole, *history = history_of_state(&whole);
    (void)state;
    assert_true(json_is_null(history));
    json_decref(whole);
    assert_null(strstr(ask_text(get_metrics), "apc_history_"));

    struct behind now = {.state = 1, .rows = 9, .nothing = true, .oldest = 7 * S};
    model_behind(&ui->model, &now);
    history = history_of_state(&whole);
    assert_int_equal(json_integer_value(json_object_get(history, "behind")), 9);
    assert_true(json_is_null(json_object_get(history, "late")));
    assert_true(json_is_null(json_object_get(history, "error")));
    json_decref(whole);
    assert_non_null(strstr(ask_text(get_metrics), "\napc_history_behind_rows 9\n"));
    assert_null(strstr(ask_text(get_metrics), "apc_history_behind_seconds"));

    /* what is seldom written is late for a moment: nothing is, until the next look says so, too */
    now = (struct behind){.state = 1, .rows = 1, .late = 0, .oldest = 7 * S};
    model_behind(&ui->model, &now);
    now.late = 150 * S;
    model_behind(&ui->model, &now);
    assert_near(json_number_value(json_object_get(history_of_state(&whole), "late")), 0, 0);
    json_decref(whole);
    now.rows = 42;
    now.late = 152 * S;
    model_behind(&ui->model, &now);
    history = history_of_state(&whole);
    assert_int_equal(json_integer_value(json_object_get(history, "behind")), 42);
    assert_near(json_number_value(json_object_get(history, "late")), 150, 0);
    assert_near(json_number_value(json_object_get(history, "oldest")), 7, 0);
    assert_true(json_is_null(json_object_get(history, "error")));
    json_decref(whole);
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_history_up 1\n"));
    assert_non_null(strstr(metrics, "\napc_history_behind_rows 42\n"));
    assert_non_null(strstr(metrics, "\napc_history_behind_seconds 150\n"));

    now = (struct behind){.state = APC_ECONN, .why = "no server \"there\""};
    model_behind(&ui->model, &now);
    history = history_of_state(&whole);
    assert_true(json_is_null(json_object_get(history, "behind")));
    assert_true(json_is_null(json_object_get(history, "late")));
    assert_true(json_is_null(json_object_get(history, "oldest")));
    assert_string_equal(json_string_value(json_object_get(history, "error")), "no server \"there\"");
    json_decref(whole);
    metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_history_up 0\n"));
    assert_null(strstr(metrics, "apc_history_behind"));
}

/* Promise(server/metrics): Metrics and diagnostics say what they are said to say. */
static void process_values_are_in_the_metrics(void **state)
{
    (void)state;
    period(S, S);
    assert_null(strstr(ask_text(get_metrics), "apc_signal_value{"));
    assert_null(strstr(ask_text(get_metrics), "apc_signal_age_seconds{"));
    assert_non_null(
        strstr(ask_text(get_metrics), "apc_signal_good{table=\"sensor\",name=\"y1\",unit=\"m\"} 0\n"));
    all_came(0);
    came(APC_SENSOR, 1, 9.875, 0);
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "apc_signal_value{table=\"sensor\",name=\"y1\",unit=\"m\"} 9.875\n"));
    assert_non_null(strstr(metrics, "apc_signal_good{table=\"sensor\",name=\"y1\",unit=\"m\"} 1\n"));
    assert_non_null(strstr(metrics, "apc_signal_value{table=\"opmode\",name=\"u1\",unit=\"m\"} 1\n"));
    assert_non_null(
        strstr(metrics, "apc_signal_value{table=\"actual\",name=\"u1.mode.actual\",unit=\"m\"} 1\n"));
    now_of(APC_SENSOR, 1)->status = APC_UNCERTAIN_LAST_USABLE;
    assert_non_null(
        strstr(ask_text(get_metrics), "apc_signal_good{table=\"sensor\",name=\"y1\",unit=\"m\"} 0\n"));
    came(APC_SENSOR, 1, 9.875, 10 * S);
    assert_non_null(
        strstr(ask_text(get_metrics), "apc_signal_good{table=\"sensor\",name=\"y1\",unit=\"m\"} 0\n"));
    static const char of_y1[] = "apc_signal_age_seconds{table=\"sensor\",name=\"y1\",unit=\"m\"} ";
    const char *age = strstr(ask_text(get_metrics), of_y1);
    assert_non_null(age);
    assert_true(strtod(age + strlen(of_y1), NULL) >= 10 && strtod(age + strlen(of_y1), NULL) < 600);
}

static struct task *a_task(size_t i, const char *name)
{
    struct task *task = &ui->model.task[i];
    snprintf(task->name, sizeof task->name, "%s", name);
    task->period = 2 * S;
    task->heard = apc_clock_mono(NULL) - 4 * S;
    task->missed = 3;
    task->missed_total = 7;
    for (int q = 0; q < QUANTITIES; q++) {
        task->last[q] = (struct task_figures){.time = 1763730000 * S,
                                              .count = 5,
                                              .mean = 1e6 * (q + 1),
                                              .p50 = 1000000,
                                              .p99 = 2000000,
                                              .max = 4000000};
        task->total[q] = (struct task_figures){.count = 50, .sum = 0.5};
    }
    ui->model.tasks = i + 1;
    return task;
}

/* Promise(server/metrics) */
static void what_tasks_report_is_in_the_metrics(void **state)
{
    (void)state;
    a_task(0, "controller");
    a_task(1, "odd\"name\\\n")->last[JITTER].count = 0; /* its window was empty */
    const char *metrics = ask_text(get_metrics);
    has(metrics, "# TYPE apc_task_jitter_seconds summary\n");
    has(metrics, "apc_task_jitter_seconds{task=\"controller\",quantile=\"0.5\"} 0.001\n"
                 "apc_task_jitter_seconds{task=\"controller\",quantile=\"0.99\"} 0.002\n"
                 "apc_task_jitter_seconds{task=\"controller\",quantile=\"1\"} 0.004\n"
                 "apc_task_jitter_seconds_sum{task=\"controller\"} 0.5\n"
                 "apc_task_jitter_seconds_count{task=\"controller\"} 50\n"
                 "apc_task_jitter_seconds_sum{task=\"odd\\\"name\\\\ \"} 0.5\n");
    assert_int_equal(times_in(metrics, "apc_task_exec_seconds{"), 6);
    has(metrics, "apc_task_overruns_total{task=\"controller\"} 7\n");
    has(metrics, "apc_task_age_seconds{task=\"controller\"} 4");
    assert_int_equal(times_in(metrics, "apc_link_round_trip_seconds"), 0); /* nobody measures one */
    ui->model.exchange.last[RUN] = (struct task_figures){.count = 2, .p50 = 3000000, .p99 = 5000000};
    ui->model.exchange.total[RUN] = (struct task_figures){.count = 9, .sum = 0.25};
    ui->model.exchange.missed_total = 4;
    metrics = ask_text(get_metrics);
    has(metrics, "apc_link_round_trip_seconds{link=\"apc-client\",quantile=\"0.5\"} 0.003\n"
                 "apc_link_round_trip_seconds{link=\"apc-client\",quantile=\"0.99\"} 0.005\n"
                 "apc_link_round_trip_seconds_sum{link=\"apc-client\"} 0.25\n"
                 "apc_link_round_trip_seconds_count{link=\"apc-client\"} 9\n");
    has(metrics, "apc_link_failed_total{link=\"apc-client\"} 4\n");
}

static void what_the_server_does_itself_is_in_the_metrics(void **state)
{
    (void)state;
    has(ask_text(get_metrics), "apc_db_up 1\n");
    assert_int_equal(times_in(ask_text(get_metrics), "apc_db_write_seconds{"), 0);
    for (int i = 1; i <= 100; i++)
        duration_stats_record(&ui->stores, i * APC_NS_PER_MS);
    ui->requests[2] = 12;
    ui->requests[5] = 1;
    ui->model.connected = false;
    ui->model.spool.samples = 30;
    ui->model.spool.events = 4;
    const char *metrics = ask_text(get_metrics);
    has(metrics, "apc_db_up 0\n");
    has(metrics, "apc_spool_depth 34\n");
    has(metrics, "apc_db_write_seconds_count 100\n");
    has(metrics, "apc_db_write_seconds_sum 5.05\n");
    const char *median = strstr(metrics, "apc_db_write_seconds{quantile=\"0.5\"} ");
    assert_non_null(median);
    assert_near(strtod(strchr(median, ' '), NULL), 0.05, 0.001); /* to the width of a bucket */
    has(metrics, "apc_ui_requests_total{status=\"2xx\"} 12\n");
    has(metrics, "apc_ui_requests_total{status=\"5xx\"} 1\n");
    assert_int_equal(times_in(metrics, "apc_ui_requests_total{"), 5);
    has(metrics, "apc_ui_clients 0\n");
}

/* Promise(server/metrics) */
static void diagnostics_say_how_each_part_is(void **state)
{
    (void)state;
    a_task(0, "controller")->last[LATENESS].count = 0;
    period(S, S);
    all_came(S / 2);
    json_t *all = ask(get_diagnostics);
    const json_t *task = json_array_get(json_object_get(all, "tasks"), 0);
    assert_string_equal(json_string_value(json_object_get(task, "task")), "controller");
    assert_near(json_number_value(json_object_get(task, "period")), 2, 0);
    assert_near(json_number_value(json_object_get(task, "time")), 1763730000, 0);
    assert_near(json_number_value(json_object_get(task, "age")), 4, 1);
    assert_int_equal(json_integer_value(json_object_get(task, "missed")), 3);
    assert_int_equal(json_integer_value(json_object_get(task, "missed_total")), 7);
    assert_true(json_is_null(json_object_get(task, "lateness")));
    const json_t *run = json_object_get(task, "run");
    assert_int_equal(json_integer_value(json_object_get(run, "count")), 5);
    assert_near(json_number_value(json_object_get(run, "mean")), 0.003, 1e-12);
    assert_near(json_number_value(json_object_get(run, "p99")), 0.002, 1e-12);
    const json_t *signal = json_array_get(json_object_get(all, "signals"), 0);
    assert_near(json_number_value(json_object_get(signal, "age")), 0.5, 0.4);
    assert_near(json_number_value(json_object_get(signal, "period")), 1, 0);
    assert_string_equal(json_string_value(json_object_get(signal, "status")), "Good");
    const json_t *kept = json_object_get(all, "store");
    assert_true(json_is_true(json_object_get(kept, "connected")));
    assert_true(json_is_null(json_object_get(kept, "error")));
    assert_true(json_is_null(json_object_get(kept, "spool"))); /* it was told no folder */
    json_decref(all);
    ui->options.spool = "/nowhere";
    ui->model.spool.samples = 30;
    ui->model.spool.events = 4;
    ui->model.spool.oldest = apc_clock_utc(NULL) - 50 * S;
    model_store(ui, false, "gone");
    all = ask(get_diagnostics);
    kept = json_object_get(all, "store");
    assert_false(json_is_true(json_object_get(kept, "connected")));
    assert_string_equal(json_string_value(json_object_get(kept, "error")), "gone");
    assert_int_equal(json_integer_value(json_object_get(json_object_get(kept, "spool"), "depth")), 34);
    assert_near(json_number_value(json_object_get(json_object_get(kept, "spool"), "age")), 50, 5);
    json_decref(all);
    model_store(ui, true, "");
    all = ask(get_diagnostics);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(all, "store"), "connects")), 1);
    json_decref(all);
}

static void statistics_of_durations_forget_what_is_old_and_keep_their_sum(void **state)
{
    struct apc_summary summary;
    (void)state;
    duration_stats_record(&ui->reads, 5 * APC_NS_PER_MS);
    ui->reads.since -= 61 * S;
    duration_stats_record(&ui->reads, APC_NS_PER_MS);
    duration_stats_summary(&ui->reads, &summary);
    assert_int_equal(summary.count, 2); /* the last turn is still known */
    ui->reads.since -= 61 * S;
    duration_stats_record(&ui->reads, APC_NS_PER_MS);
    duration_stats_summary(&ui->reads, &summary);
    assert_int_equal(summary.count, 2);
    assert_true(summary.max < 2 * APC_NS_PER_MS);
    assert_int_equal(ui->reads.count, 3);
    assert_near(ui->reads.sum, 0.007, 1e-12);
}

/* ---- Loops -------------------------------------------------------------------------------- */

static void put_dim(int id, double value)
{
    assert_int_equal(append_dim(id, value), 1);
}

static const char *loop(size_t i, const char *member)
{
    static char text[100];
    json_t *plant = ask(get_plant);
    assert_non_null(plant);
    const char *value =
        json_string_value(json_object_get(json_array_get(json_object_get(plant, "loops"), i), member));
    snprintf(text, sizeof text, "%s", value ? value : "null");
    json_decref(plant);
    return text;
}

static void a_loop_is_what_the_law_pairs(void **state)
{
    (void)state;
    assert_string_equal(loop(0, "measurement"), "sensor.1");
    put_dim(4, 2);
    put_dim(5, 1);
    put_dim(6, 1);
    put_dim(7, 0);
    put_dim(8, 2);
    unsigned revision = ui->model.plant.revision;
    assert_int_equal(model_load(&ui->model, store), 0);
    assert_int_equal(ui->model.plant.revision, revision + 1);
    assert_string_equal(loop(0, "measurement"), "sensor.2");
    assert_string_equal(loop(0, "setpoint"), "setpoint.1");
    assert_string_equal(loop(0, "output"), "actuator.1");
    assert_string_equal(loop(0, "name"), "y2");
    assert_string_equal(loop(1, "measurement"), "sensor.1");
    assert_string_equal(loop(1, "setpoint"), "null");
    assert_string_equal(loop(1, "name"), "y1");
    assert_string_equal(loop(2, "name"), "upper.r1"); /* the second of y2 */
    assert_int_equal(model_load(&ui->model, store), 0);
    assert_int_equal(ui->model.plant.revision, revision + 1); /* nothing new */
}

/* What the page is told of a loop: JSON text of a member. */
static const char *loop_json(size_t i, const char *member)
{
    static char text[300];
    json_t *plant = ask(get_plant);
    char *dump = json_dumps(json_object_get(json_array_get(json_object_get(plant, "loops"), i), member),
                            JSON_ENCODE_ANY);
    snprintf(text, sizeof text, "%s", dump ? dump : "(missing)");
    free(dump);
    json_decref(plant);
    return text;
}

/*
 * Promise(server/loops-their-controllers): Loops, their controllers, modes and the loop above; a mode goes
 *   to its loop; a setpoint is taken from the loop above and that is said, before and after.
 */
static void each_loop_has_its_controller_its_modes_and_the_loop_above(void **state)
{
    (void)state;
    assert_string_equal(loop(0, "controller"), "base");
    assert_string_equal(loop(0, "called"), "u1");
    assert_string_equal(loop_json(0, "above"), "3");
    assert_string_equal(
        loop_json(0, "mode"),
        "{\"target\": \"opmode.1\", \"actual\": \"actual.21\", \"targets\": [\"OOS\", \"Man\", "
        "\"Auto\", \"Cas\"]}");
    assert_string_equal(loop_json(1, "above"), "null");
    assert_string_equal(
        loop_json(1, "mode"),
        "{\"target\": \"opmode.2\", \"actual\": \"actual.37\", \"targets\": [\"OOS\", \"Man\", "
        "\"Auto\"]}");
    assert_string_equal(loop(2, "controller"), "upper");
    assert_string_equal(loop(2, "output"), "setpoint.1");
    assert_string_equal(loop(2, "setpoint"), "null");
    assert_string_equal(loop(2, "manual"), "manual.3");
    assert_string_equal(loop_json(2, "tuning"), "[]"); /* they are the other controller's */
    period(S, S);
    json_t *plant = ask(get_plant);
    char *controllers = json_dumps(json_object_get(plant, "controllers"), 0);
    assert_string_equal(controllers, "[{\"number\": 1, \"name\": \"base\", \"period\": 1}, {\"number\": 2, "
                                     "\"name\": \"upper\", \"period\": 10}]");
    free(controllers);
    json_decref(plant);
    assert_null(strstr(ask_text(get_plant), "opmode.0")); /* the mode of all is no loop's */
}

/* Promise(modes/record-figure-run) */
static void who_goes_along_is_said_and_what_it_would_put_out(void **state)
{
    (void)state;
    assert_string_equal(control("shadow"), "[]");
    assert_string_equal(loop_json(0, "would"), "null");
    describe_a_shadow();
    assert_string_equal(control("shadow"), "[\"trial\"]");
    assert_string_equal(loop_json(0, "would"), "\"estimate.1\"");
    assert_string_equal(loop_json(1, "would"), "null");
    assert_string_equal(loop_json(3, "would"), "\"estimate.2\"");
    assert_string_equal(loop_json(3, "output"), "\"actuator.1\"");
    assert_true(loops_choose(&ui->model.plant.loops, LOOPS_ACTING(APC_ACTUATOR, 1), 3));
    assert_string_equal(control("shadow"), "[\"base\"]");
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(what_never_came_but_should_is_stale),
        T(a_controller_is_judged_by_its_own_ticks),
        T(out_of_service_writes_nothing_and_runs_all_the_same),
        T(why_the_mode_is_not_the_target_is_said_of_its_loop_while_it_lasts),
        T(what_stands_between_an_entry_and_its_effect_is_told_of_its_loop),
        T(the_plant_at_its_safe_value_stands_until_it_takes_commands),
        T(of_an_external_plant_its_client_says_whether_it_is_commanded),
        T(ready_is_what_ticks),
        T(a_thread_that_goes_round_no_more_is_not_alive),
        T(a_link_is_there_before_it_ever_changed),
        T(shared_memory_that_is_full_is_told_as_long_as_it_is),
        T(how_far_the_history_is_behind_is_said_where_there_is_one),
        T(process_values_are_in_the_metrics),
        T(what_tasks_report_is_in_the_metrics),
        T(what_the_server_does_itself_is_in_the_metrics),
        T(diagnostics_say_how_each_part_is),
        T(statistics_of_durations_forget_what_is_old_and_keep_their_sum),
        T(a_loop_is_what_the_law_pairs),
        T(each_loop_has_its_controller_its_modes_and_the_loop_above),
        T(who_goes_along_is_said_and_what_it_would_put_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
