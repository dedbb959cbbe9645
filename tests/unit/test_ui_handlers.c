/* SPDX-License-Identifier: BSD-3-Clause */
/* What the API answers, asked without a connection, on a store in memory: the plant as it stands, what was,
 * and what becomes of writes. */
#include <sys/stat.h>
#include <unistd.h>

#include "run/merits.h"
#include "ui_request.h"

#define TUNINGS WRITE_CHANGES

static struct apc_tag tags[40 + TUNINGS];
static size_t n_tags;

/* The answer as JSON, to be given back; NULL when it is none. */
static json_t *ask(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    request.fault = (struct fault){0};
    text_free(&request.reply);
    request.status = 0;
    handle(ui, &request, store);
    return json_loadb(request.reply.at ? request.reply.at : "", request.reply.n, 0, NULL);
}

static const char *ask_text(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    static char text[1 << 16];
    json_decref(ask(handle));
    snprintf(text, sizeof text, "%.*s", (int)request.reply.n, request.reply.at ? request.reply.at : "");
    return text;
}

static void tag(enum apc_table table, int id, const char *name, double low, double high)
{
    struct apc_tag *t = &tags[n_tags++];
    *t = (struct apc_tag){.table = table, .id = id, .unit = "m", .low = low, .high = high};
    snprintf(t->name, sizeof t->name, "%s", name);
}

/* Those from here on are a controller's. */
static void tags_of(const char *controller, size_t first)
{
    for (size_t i = first; i < n_tags; i++)
        snprintf(tags[i].controller, sizeof tags[i].controller, "%s", controller);
}

static void tag_loop(int id, const char *name, const char *controller)
{
    const size_t first = n_tags;
    char text[APC_TAG_LEN];
    tag(APC_OPMODE, id, name, 0, 3);
    snprintf(text, sizeof text, "%s.mode.actual", name);
    tag(APC_ACTUAL, apc_variable_number(APC_OPMODE, id), text, 0, 5);
    snprintf(text, sizeof text, "%s.manual", name);
    tag(APC_MANUAL, id, text, 0, 10);
    tags_of(controller, first);
}

static int by_table(const void *a, const void *b)
{
    const struct apc_tag *one = a, *other = b;
    return one->table != other->table ? (int)one->table - (int)other->table : one->id - other->id;
}

static int append_dim(int id, double value)
{
    static int64_t seq;
    struct apc_sample s = {.table = APC_DIM, .id = id, .seq = ++seq, .time = S, .value = value};
    return apc_store_append(store, &s, 1);
}

/* Two of each with controller "base", and one loop above, which moves r1; as many tunings as one write may
 * change. */
static int set_up(void **state)
{
    (void)state;
    n_tags = 0;
    tag(APC_SENSOR, 1, "y1", -APC_VALUE_MAX, APC_VALUE_MAX);
    tag(APC_SENSOR, 2, "y2", 0, 1);
    tag(APC_OPMODE, 0, "mode", 0, 3);
    tag(APC_TICK, 1, "base", 0, 0);
    tag(APC_TICK, 2, "upper", 0, 0);
    const size_t first = n_tags;
    tag(APC_ACTUATOR, 1, "u1", 0, 10);
    tag(APC_ACTUATOR, 2, "u2", 0, 10);
    tag(APC_SETPOINT, 1, "r1", -100, 100);
    tag(APC_SETPOINT, 2, "r2", -100, 100);
    for (int i = 1; i <= TUNINGS; i++) {
        char name[16];
        snprintf(name, sizeof name, "k%d", i);
        tag(APC_TUNING, i, name, -1000, 1000);
    }
    tags_of("base", first);
    tag_loop(1, "u1", "base");
    tag_loop(2, "u2", "base");
    tag_loop(3, "upper.r1", "upper");
    qsort(tags, n_tags, sizeof *tags, by_table);
    if (!ui_made("mem:handlers") || apc_store_put_tags(store, tags, n_tags) < 0)
        return -1;
    static const double pairs[] = {1, 1, 2, 2, 1, 0};
    for (int i = 0; i < 6; i++)
        if (append_dim(4 + i, pairs[i]) < 0)
            return -1;
    if (model_load(&ui->model, store) < 0)
        return -1;
    ui->began = apc_clock_mono(NULL);
    ui->round[0] = ui->round[1] = ui->began;
    ui->model.connected = true;
    ask_nothing();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    ui_gone();
    return 0;
}

/* ---- The model ---------------------------------------------------------------------------- */

static struct apc_sample *now_of(enum apc_table table, int id)
{
    int at = plant_find(&ui->model.plant, table, id);
    assert_true(at >= 0);
    return &ui->model.now[at];
}

/* As the live thread does it: this value came so long ago. */
static void came(enum apc_table table, int id, double value, apc_ns age)
{
    struct apc_sample *s = now_of(table, id);
    *s = (struct apc_sample){.table = table, .id = id, .seq = s->seq + 1, .time = S, .value = value};
    ui->model.moved[s - ui->model.now] = apc_clock_mono(NULL) - age;
}

static void ticked(size_t controller, apc_ns age)
{
    ui->model.tick[controller].seq++;
    ui->model.ticked[controller] = apc_clock_mono(NULL) - age;
}

static void actual(int loop, enum apc_mode mode)
{
    came(APC_ACTUAL, apc_variable_number(APC_OPMODE, loop), mode, 0);
}

static void period(apc_ns controller, apc_ns client)
{
    plant_rhythm(&ui->model.plant, "base", controller);
    plant_rhythm(&ui->model.plant, "upper", 10 * controller);
    plant_rhythm(&ui->model.plant, "client", client);
    plant_rhythm(&ui->model.plant, "plant", client);
}

static void all_came(apc_ns age)
{
    for (int id = 1; id <= 2; id++) {
        came(APC_SENSOR, id, 0.5, age);
        came(APC_ACTUATOR, id, 1.25, age);
        ticked((size_t)id - 1, age);
    }
    for (int id = 1; id <= 3; id++) {
        came(APC_OPMODE, id, APC_MODE_AUTO, age);
        actual(id, APC_MODE_AUTO);
    }
}

static void an_event(const char *source, const char *kind, enum apc_event_severity severity, const char *text)
{
    struct apc_event e = {.time = 1763730000 * S, .severity = severity};
    snprintf(e.source, sizeof e.source, "%s", source);
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    snprintf(e.text, sizeof e.text, "%s", text);
    model_take_event(&ui->model, &e);
}

/* A member of `control`, as JSON text. */
static const char *control(const char *member)
{
    static char text[300];
    json_t *state = ask(get_state);
    assert_non_null(state);
    char *dump = json_dumps(json_object_get(json_object_get(state, "control"), member), JSON_ENCODE_ANY);
    snprintf(text, sizeof text, "%s", dump ? dump : "(missing)");
    free(dump);
    json_decref(state);
    return text;
}

static bool stale(const char *ref)
{
    json_t *all = ask(get_diagnostics);
    const json_t *signal;
    size_t i;
    int found = -1;
    assert_non_null(all);
    json_array_foreach(json_object_get(all, "signals"), i,
                       signal) if (!strcmp(json_string_value(json_object_get(signal, "ref")), ref)) found =
        json_is_true(json_object_get(signal, "stale"));
    json_decref(all);
    assert_true(found >= 0);
    return found;
}

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
}

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
    assert_string_equal(ask_text(get_readyz), "1 signals or tasks do not tick\n");
    request.session = ui->sessions.local;
    all_came(0);
    now_of(APC_SENSOR, 2)->seq = 0;
    assert_string_equal(ask_text(get_readyz), "y2: no sample yet\n");
    ui->model.connected = false;
    assert_string_equal(ask_text(get_readyz), "the database is away\n");
    assert_int_equal(request.status, 503);
}

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
    assert_true(atof(age + strlen(of_y1)) >= 10 && atof(age + strlen(of_y1)) < 600);
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
        task->last[q] = (struct figures){.time = 1763730000 * S,
                                         .count = 5,
                                         .mean = 1e6 * (q + 1),
                                         .p50 = 1000000,
                                         .p99 = 2000000,
                                         .max = 4000000};
        task->total[q] = (struct figures){.count = 50, .sum = 0.5};
    }
    ui->model.tasks = i + 1;
    return task;
}

static void has(const char *text, const char *part)
{
    if (!strstr(text, part))
        fail_msg("\"%s\" is not in: %s", part, text);
}

static size_t times_in(const char *text, const char *part)
{
    size_t n = 0;
    for (const char *at = text; (at = strstr(at, part)) != NULL; at++)
        n++;
    return n;
}

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
                 "apc_task_jitter_seconds_sum{task=\"odd\\\"name\\\\?\"} 0.5\n");
    assert_int_equal(times_in(metrics, "apc_task_exec_seconds{"), 6);
    has(metrics, "apc_task_overruns_total{task=\"controller\"} 7\n");
    has(metrics, "apc_task_age_seconds{task=\"controller\"} 4");
    assert_int_equal(times_in(metrics, "apc_link_round_trip_seconds"), 0); /* nobody measures one */
    ui->model.exchange.last[RUN] = (struct figures){.count = 2, .p50 = 3000000, .p99 = 5000000};
    ui->model.exchange.total[RUN] = (struct figures){.count = 9, .sum = 0.25};
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
        meter_record(&ui->stores, i * APC_NS_PER_MS);
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
    assert_near(atof(strchr(median, ' ')), 0.05, 0.001); /* to the width of a bucket */
    has(metrics, "apc_ui_requests_total{status=\"2xx\"} 12\n");
    has(metrics, "apc_ui_requests_total{status=\"5xx\"} 1\n");
    assert_int_equal(times_in(metrics, "apc_ui_requests_total{"), 5);
    has(metrics, "apc_ui_clients 0\n");
}

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

static void a_meter_forgets_what_is_old_and_keeps_its_sum(void **state)
{
    struct apc_summary summary;
    (void)state;
    meter_record(&ui->reads, 5 * APC_NS_PER_MS);
    ui->reads.since -= 61 * S;
    meter_record(&ui->reads, APC_NS_PER_MS);
    meter_summary(&ui->reads, &summary);
    assert_int_equal(summary.count, 2); /* the last turn is still known */
    ui->reads.since -= 61 * S;
    meter_record(&ui->reads, APC_NS_PER_MS);
    meter_summary(&ui->reads, &summary);
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

/* Trial has the output u1 together with base, and goes along. */
static void describe_a_shadow(void)
{
    const struct apc_sample choice = {
        .table = APC_OPMODE, .id = LOOPS_ACTING(APC_ACTUATOR, 1), .seq = 1, .time = S, .value = 1};
    size_t first = n_tags;
    tag(APC_ESTIMATE, 1, "u1.output", 0, 10);
    tags_of("base", first);
    first = n_tags;
    tag(APC_ESTIMATE, 2, "trial.u1.output", 0, 10);
    tag(APC_TICK, 3, "trial", 0, 0);
    tags_of("trial", first);
    tag_loop(4, "trial.u1", "trial");
    tag(APC_OPMODE, choice.id, "u1.acting", 1, 3);
    qsort(tags, n_tags, sizeof *tags, by_table);
    assert_int_equal(apc_store_put_tags(store, tags, n_tags), n_tags);
    assert_int_equal(apc_store_append(store, &choice, 1), 1);
    assert_int_equal(append_dim(10, 1), 1);
    assert_int_equal(append_dim(11, 1), 1);
    assert_int_equal(model_load(&ui->model, store), 0);
}

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
    json_decref(plant);
    text_free(&ui->graphic);
}

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

static void history_is_asked_for_in_one_way(void **state)
{
    char many[4000] = "y1";
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
    for (int i = 1; i < 33; i++)
        strcat(many, ",y1");
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        memset(query, 0, sizeof query);
        memcpy(query, bad[i], sizeof bad[i]);
        json_decref(ask(get_history));
        if (request.fault.http != 400)
            fail_msg("case %zu: %d %s", i, request.fault.http, request.fault.message);
    }
    ask_history("names", many, "bins", "150"); /* few bins of many are as good as many of few */
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
    for (int i = 33; i < 512; i++)
        strcat(many, ",y1");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
    strcat(many, ",y1");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 400);
    many[3 * 32 - 1] = '\0'; /* 32 of them */
    ask_history("names", many, "last", "1");
    json_decref(ask(get_history));
    assert_int_equal(request.fault.http, 0);
}

static void put_events(int n, const char *kind)
{
    static apc_ns time = 2000 * S; /* no two are the same */
    struct apc_event *e = calloc((size_t)n, sizeof *e);
    assert_non_null(e);
    for (int i = 0; i < n; i++) {
        e[i] = (struct apc_event){.time = time += S, .severity = APC_EVENT_INFO, .source = "x"};
        snprintf(e[i].kind, sizeof e[i].kind, "%s", kind);
        snprintf(e[i].text, sizeof e[i].text, "%d", i);
    }
    assert_int_equal(apc_store_append_events(store, e, (size_t)n), n);
    free(e);
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

/* One window of a task: n ticks around this. */
static void put_window(const char *task, const char *quantity, apc_ns time, uint64_t n, apc_ns value,
                       uint64_t missed)
{
    const int64_t low = value - 100, high = value + 100, count = (int64_t)n;
    struct apc_timing_row row = {.time = time,
                                 .period = 2 * S,
                                 .missed = missed,
                                 .count = n,
                                 .mean = (double)value,
                                 .p50 = value,
                                 .p99 = value + 50,
                                 .max = value + 90,
                                 .bin_low = &low,
                                 .bin_high = &high,
                                 .bin_count = &count,
                                 .n_bins = 1};
    snprintf(row.task, sizeof row.task, "%s", task);
    snprintf(row.quantity, sizeof row.quantity, "%s", quantity);
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
}

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
        assert_int_equal(request.fault.http, 400);
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
    json_t *json = ask(get_outlook);
    const json_t *list = json_object_get(json, "outlook"), *y = json_array_get(list, 0);
    assert_int_equal(json_array_size(list), 1);
    assert_string_equal(json_string_value(json_object_get(y, "ref")), "sensor.1");
    assert_near(json_number_value(json_object_get(y, "made")), 1000, 0);
    assert_near(json_number_value(json_object_get(y, "first")), 2, 0);
    assert_near(json_number_value(json_array_get(json_object_get(y, "expected"), 1)), 2.5, 0);
    assert_near(json_number_value(json_array_get(json_object_get(y, "came"), 1)), 4, 0);
    assert_true(json_is_null(json_array_get(json_object_get(y, "came"), 2))); /* nothing newer was measured */
    json_decref(json);
    memcpy(query, before, sizeof before);
    json = ask(get_outlook);
    assert_int_equal(json_array_size(json_object_get(json, "outlook")), 0);
    json_decref(json);
    memcpy(query, soon, sizeof soon);
    json_decref(ask(get_outlook));
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

static void what_the_controllers_were_worth_is_told(void **state)
{
    static const char *const day[10] = {"since", "1000", "until", "87400"},
                             *const before[10] = {"since", "10", "until", "20"},
                             *const backwards[10] = {"since", "20", "until", "10"};
    struct merits m;
    (void)state;
    record_service();
    memcpy(query, day, sizeof day);
    json_t *json = ask(get_merits);
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
    json = ask(get_merits);
    assert_int_equal(request.fault.http, 0);
    assert_int_equal(json_array_size(json_object_get(json, "loops")), 0);
    json_decref(json);
    memcpy(query, backwards, sizeof backwards);
    json_decref(ask(get_merits));
    assert_int_equal(request.fault.http, 400);
    assert_int_equal(merits_of_store(&m, store, 1000 * S, 1010 * S, 20), APC_ERANGE);
    merits_free(&m);
    assert_int_equal(merits_of_store(&m, store, 1000 * S, 1010 * S, 21), 0); /* the setpoint before as well */
    merits_free(&m);
}

static void what_cannot_be_read_is_no_empty_answer(void **state)
{
    static const char *const series[10] = {"task", "controller", "quantity", "run"};
    void (*const ask_past[])(struct ui *, struct request *, struct apc_store *) = {
        get_events, get_timing, get_timing_series, get_history, get_outlook, get_merits};
    struct apc_store *there = store;
    (void)state;
    assert_int_equal(apc_store_open(&store, "sqlite:/no/such/folder/store.db", NULL, NULL), 0);
    for (size_t i = 0; i < sizeof ask_past / sizeof *ask_past; i++) {
        memset(query, 0, sizeof query);
        if (ask_past[i] == get_timing_series)
            memcpy(query, series, sizeof series);
        if (ask_past[i] == get_history)
            ask_history("var", "sensor.1", "last", "3");
        json_decref(ask(ask_past[i]));
        assert_int_equal(request.fault.http, 503);
        assert_string_equal(request.fault.code, "store");
    }
    apc_store_close(store);
    store = there;
}

/* ---- Writes ------------------------------------------------------------------------------- */

static void put(enum apc_table table, int id, double value)
{
    struct apc_sample s = {.table = table, .id = id, .time = S, .value = value};
    assert_int_equal(apc_store_put(store, &s, 1), 0);
}

static json_t *post(void (*handle)(struct ui *, struct request *, struct apc_store *), const char *body)
{
    free(request.body);
    request.body = strdup(body);
    request.n = strlen(body);
    text_free(&request.extra);
    return ask(handle);
}

static int refused(void (*handle)(struct ui *, struct request *, struct apc_store *), const char *body)
{
    json_decref(post(handle, body));
    return request.fault.http;
}

static double in_force(enum apc_table table, int id, int64_t *seq)
{
    struct apc_sample s = {.table = table, .id = id};
    assert_int_equal(apc_store_read(store, &s, 1), 0);
    *seq = s.seq;
    return s.value;
}

static struct apc_event newest;

static int take_newest(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    newest = *event;
    return 0;
}

static const char *newest_text(void)
{
    newest = (struct apc_event){0};
    assert_true(apc_store_events(store, &(struct apc_range){.last = 1}, take_newest, NULL) >= 0);
    return newest.text;
}

static void the_record_shows_every_digit(void **state)
{
    static const struct {
        const char *body, *text;
    } cases[] = {
        {"{\"id\":1,\"value\":12.3456789,\"seq\":1}", "r1: 5 -> 12.3456789 (from 10.0.0.7)"},
        {"{\"id\":1,\"value\":0.1,\"seq\":2}", "r1: 12.3456789 -> 0.1 (from 10.0.0.7)"},
        {"{\"id\":1,\"value\":0.30000000000000004,\"seq\":3}",
         "r1: 0.1 -> 0.30000000000000004 (from 10.0.0.7)"},
        {"{\"id\":1,\"value\":99.99999,\"seq\":4}", "r1: 0.30000000000000004 -> 99.99999 (from 10.0.0.7)"}};
    (void)state;
    put(APC_SETPOINT, 1, 5);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        json_decref(post(post_setpoint, cases[i].body));
        assert_int_equal(request.fault.http, 0);
        assert_string_equal(newest_text(), cases[i].text);
        assert_string_equal(newest.kind, "operator");
        assert_string_equal(newest.source, "local");
    }
}

static void a_reason_is_on_record_with_every_kind_of_write(void **state)
{
    static const struct {
        void (*how)(struct ui *, struct request *, struct apc_store *);
        const char *body, *text;
    } cases[] = {
        {post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"reason\":\"pump 2 is tested\"}",
         "r1: 5 -> 6 (from 10.0.0.7): pump 2 is tested"},
        {post_mode, "{\"id\":2,\"mode\":\"Man\",\"seq\":1,\"reason\":\"as well\"}",
         "u2: Auto -> Man (from 10.0.0.7): as well"},
        {post_output, "{\"id\":2,\"value\":1,\"seq\":0,\"reason\":\"by hand\"}",
         "u2: none -> 1 (from 10.0.0.7): by hand"},
        {post_setpoint, "{\"id\":1,\"value\":7,\"seq\":2,\"reason\":\"\"}", "r1: 6 -> 7 (from 10.0.0.7)"}};
    char body[200];
    (void)state;
    put(APC_SETPOINT, 1, 5);
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        json_decref(post(cases[i].how, cases[i].body));
        assert_int_equal(request.fault.http, 0);
        assert_string_equal(newest_text(), cases[i].text);
    }
    snprintf(body, sizeof body, "{\"id\":1,\"value\":8,\"seq\":3,\"reason\":\"%081d\"}", 0);
    assert_int_equal(refused(post_setpoint, body), 422);
    assert_string_equal(request.fault.field, "reason");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":8,\"seq\":3,\"reason\":1}"), 400);
}

static void what_had_no_value_and_what_is_a_mode_are_recorded_in_words(void **state)
{
    (void)state;
    json_decref(post(post_setpoint, "{\"id\":2,\"value\":-3,\"seq\":0}"));
    assert_string_equal(newest_text(), "r2: none -> -3 (from 10.0.0.7)");
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    json_decref(post(post_mode, "{\"id\":2,\"mode\":\"Man\",\"seq\":1}"));
    assert_string_equal(newest_text(), "u2: Auto -> Man (from 10.0.0.7)");
}

static void limits_are_inclusive_and_their_refusal_names_them(void **state)
{
    int64_t seq;
    (void)state;
    put(APC_OPMODE, 1, APC_MODE_MAN);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":100,\"seq\":0}"), 0);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":-100,\"seq\":1}"), 0);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":100.001,\"seq\":2}"), 422);
    assert_string_equal(request.fault.message, "r1 = 100.001 lies above its limit 100");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":-100.001,\"seq\":2}"), 422);
    assert_string_equal(request.fault.message, "r1 = -100.001 lies below its limit -100");
    assert_near(in_force(APC_SETPOINT, 1, &seq), -100, 0);
    assert_int_equal(seq, 2);
    /* an output has the limits of its actuator */
    ui->model.plant.tag[plant_find(&ui->model.plant, APC_MANUAL, 1)].high = 1e6;
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":10.5,\"seq\":0}"), 422);
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":10,\"seq\":0}"), 0);
    /* and where there is none, what no store takes */
    ui->model.plant.tag[plant_find(&ui->model.plant, APC_SETPOINT, 2)].high = APC_VALUE_MAX;
    assert_int_equal(refused(post_setpoint, "{\"id\":2,\"value\":1e300,\"seq\":0}"), 422);
}

static void an_output_is_the_operators_in_man_only(void **state)
{
    int64_t seq;
    (void)state;
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":1,\"seq\":0}"), 409); /* there is no mode */
    put(APC_OPMODE, 1, APC_MODE_AUTO);
    put(APC_OPMODE, 2, APC_MODE_MAN); /* which is another loop's */
    struct apc_sample lo = {.table = APC_ACTUAL, .id = 21, .seq = 1, .time = S, .value = APC_MODE_LO};
    assert_int_equal(apc_store_append(store, &lo, 1), 1);
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":1,\"seq\":0}"), 409);
    assert_string_equal(request.fault.code, "mode");
    assert_non_null(strstr(request.fault.message, "target"));
    in_force(APC_MANUAL, 1, &seq);
    assert_int_equal(seq, 0);
    assert_int_equal(refused(post_output, "{\"id\":2,\"value\":1,\"seq\":0}"), 0);
    put(APC_OPMODE, 3, APC_MODE_MAN); /* its output is a setpoint, and has the limits of that */
    assert_int_equal(refused(post_output, "{\"id\":3,\"value\":-100,\"seq\":0}"), 0);
    assert_string_equal(newest_text(), "r1: none -> -100 (from 10.0.0.7)");
    assert_int_equal(refused(post_output, "{\"id\":3,\"value\":-101,\"seq\":1}"), 422);
}

static void a_mode_is_written_to_its_loop_and_no_other(void **state)
{
    static const char *const wrong[] = {"{\"id\":0,\"mode\":\"Man\",\"seq\":0}",
                                        "{\"id\":4,\"mode\":\"Man\",\"seq\":0}",
                                        "{\"id\":4294967297,\"mode\":\"Man\",\"seq\":0}"};
    int64_t seq;
    (void)state;
    assert_int_equal(refused(post_mode, "{\"id\":2,\"mode\":\"Man\",\"seq\":0}"), 0);
    in_force(APC_OPMODE, 1, &seq);
    assert_int_equal(seq, 0);
    assert_near(in_force(APC_OPMODE, 2, &seq), APC_MODE_MAN, 0);
    assert_int_equal(seq, 1);
    assert_int_equal(refused(post_mode, "{\"id\":2,\"mode\":\"OOS\",\"seq\":1}"), 0);
    assert_int_equal(refused(post_mode, "{\"id\":2,\"mode\":\"Auto\",\"seq\":1}"), 409);
    assert_string_equal(request.fault.message, "u2 was changed meanwhile: it is OOS now");
    assert_int_equal(refused(post_mode, "{\"id\":2,\"mode\":\"Cas\",\"seq\":2}"), 422);
    assert_string_equal(request.fault.message, "u2 cannot be in Cas: no loop moves its setpoint");
    assert_int_equal(refused(post_mode, "{\"id\":1,\"mode\":\"Cas\",\"seq\":0}"), 0);
    assert_int_equal(refused(post_mode, "{\"id\":1,\"mode\":\"IMan\",\"seq\":1}"),
                     422); /* nobody can ask for it */
    assert_int_equal(refused(post_mode, "{\"mode\":\"Man\",\"seq\":0}"), 400);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_true(refused(post_mode, wrong[i]) >= 400);
}

static void a_setpoint_that_the_loop_above_moves_is_taken_local_and_that_is_said(void **state)
{
    int64_t seq;
    (void)state;
    put(APC_SETPOINT, 1, 5);
    put(APC_OPMODE, 1, APC_MODE_CAS);
    put(APC_SETPOINT, 1, 6); /* which it did since the operator looked */
    json_t *write = post(post_setpoint, "{\"id\":1,\"value\":7,\"seq\":1}");
    assert_int_equal(request.fault.http, 0);
    const json_t *changes = json_object_get(write, "changes");
    char *said = json_dumps(changes, 0);
    assert_string_equal(said,
                        "[{\"ref\": \"setpoint.1\", \"name\": \"r1\", \"from\": 6, \"to\": 7, \"seq\": 3}, "
                        "{\"ref\": \"opmode.1\", \"name\": \"u1\", \"from\": 3, \"to\": 1, \"seq\": 2}]");
    free(said);
    json_decref(write);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 7, 0);
    assert_near(in_force(APC_OPMODE, 1, &seq), APC_MODE_AUTO, 0);
    assert_string_equal(newest_text(), "u1: Cas -> Auto, the setpoint is Local now (from 10.0.0.7)");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":8,\"seq\":2}"),
                     409); /* it is his: he has to look */
    put(APC_OPMODE, 1, APC_MODE_MAN);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":8,\"seq\":3}"), 0);
    assert_near(in_force(APC_OPMODE, 1, &seq), APC_MODE_MAN, 0);      /* which stays */
    write = post(post_mode, "{\"id\":1,\"mode\":\"Cas\",\"seq\":3}"); /* takes what is in force along */
    changes = json_object_get(write, "changes");
    assert_int_equal(json_array_size(changes), 2);
    assert_string_equal(json_string_value(json_object_get(json_array_get(changes, 1), "ref")), "setpoint.1");
    json_decref(write);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 8, 0);
    assert_int_equal(seq, 5);
}

/* r2 is the scheduler's. */
static void a_setpoint_that_was_taken_is_given_back_to_the_scheduler(void **state)
{
    const int owner = LOOPS_OWNER(2);
    char body[80];
    int64_t seq;
    (void)state;
    tag(APC_OPMODE, owner, "r2.owner", 0, 1);
    qsort(tags, n_tags, sizeof *tags, by_table);
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    assert_int_equal(model_load(&ui->model, store), 0);
    json_t *plant = ask(get_plant);
    const json_t *loops = json_object_get(plant, "loops");
    assert_true(json_is_null(json_object_get(json_array_get(loops, 0), "owner")));
    snprintf(body, sizeof body, "opmode.%d", owner);
    assert_string_equal(json_string_value(json_object_get(json_array_get(loops, 1), "owner")), body);
    json_decref(plant);

    put(APC_SETPOINT, 2, 5);
    assert_int_equal(refused(post_owner, "{\"id\":2,\"owner\":\"me\",\"seq\":0}"), 422);
    assert_int_equal(refused(post_owner, "{\"id\":1,\"owner\":\"Remote\",\"seq\":0}"), 422);
    assert_has(request.fault.message, "in mode Cas"); /* a loop moves that one */
    assert_int_equal(refused(post_owner, "{\"id\":3,\"owner\":\"Remote\",\"seq\":0}"), 404);
    assert_int_equal(refused(post_setpoint, "{\"id\":2,\"value\":7,\"seq\":1}"), 0); /* which takes it */
    assert_near(in_force(APC_OPMODE, owner, &seq), 0, 0);
    assert_int_equal(refused(post_owner, "{\"id\":2,\"owner\":\"Remote\",\"seq\":0}"), 409); /* look first */
    snprintf(body, sizeof body, "{\"id\":2,\"owner\":\"Remote\",\"seq\":%d}", (int)seq);
    json_t *write = post(post_owner, body);
    assert_int_equal(request.fault.http, 0);
    char *said = json_dumps(json_object_get(write, "changes"), 0);
    assert_string_equal(
        said, "[{\"ref\": \"opmode.65571\", \"name\": \"r2.owner\", \"from\": 0, \"to\": 1, \"seq\": "
              "2}, {\"ref\": \"setpoint.2\", \"name\": \"r2\", \"from\": 7, \"to\": 7, \"seq\": 3}]");
    free(said);
    json_decref(write);
    assert_near(in_force(APC_SETPOINT, 2, &seq), 7, 0); /* until the scheduler moves it */
    assert_has(newest_text(), "r2");
}

static const char *tuning_body(int n, int64_t seq, double value)
{
    static char body[8192];
    int at = snprintf(body, sizeof body, "{\"values\":[");
    for (int i = 1; i <= n; i++)
        at += snprintf(body + at, sizeof body - (size_t)at, "%s{\"id\":%d,\"value\":%g,\"seq\":%d}",
                       i > 1 ? "," : "", (i - 1) % TUNINGS + 1, value + i, (int)seq);
    snprintf(body + at, sizeof body - (size_t)at, "]}");
    return body;
}

static void as_many_tunings_as_there_are_go_at_once(void **state)
{
    int64_t seq;
    (void)state;
    assert_int_equal(refused(post_tuning, tuning_body(TUNINGS, 0, 0.5)), 0);
    for (int i = 1; i <= TUNINGS; i++)
        assert_near(in_force(APC_TUNING, i, &seq), 0.5 + i, 0);
    assert_int_equal(refused(post_tuning, tuning_body(TUNINGS, 1, 7)), 0);
    assert_int_equal(refused(post_tuning, tuning_body(TUNINGS, 1, 9)), 409); /* all of them or none */
    assert_string_equal(request.fault.code, "stale");
    assert_int_equal(refused(post_tuning, tuning_body(TUNINGS + 1, 2, 0)), 400);
    assert_int_equal(
        refused(post_tuning,
                "{\"values\":[{\"id\":3,\"value\":1,\"seq\":2},{\"id\":3,\"value\":1,\"seq\":2}]}"),
        400);
    assert_non_null(strstr(request.fault.message, "k3 is given twice"));
    assert_near(in_force(APC_TUNING, TUNINGS, &seq), 7 + TUNINGS, 0);
    assert_int_equal(seq, 2);
}

static void a_stale_write_is_told_what_is_newer(void **state)
{
    (void)state;
    put(APC_TUNING, 1, 1.5);
    put(APC_TUNING, 2, 2.5);
    put(APC_TUNING, 2, 3.5);
    assert_int_equal(
        refused(post_tuning,
                "{\"values\":[{\"id\":1,\"value\":1,\"seq\":1},{\"id\":2,\"value\":1,\"seq\":1}]}"),
        409);
    assert_string_equal(request.fault.message, "k2 was changed meanwhile: it is 3.5 now");
    char extra[300];
    snprintf(extra, sizeof extra, "%.*s", (int)request.extra.n, request.extra.at);
    assert_non_null(
        strstr(extra, "\"tuning.1\":[1,1.000000,1.5,\"Good\"],\"tuning.2\":[2,1.000000,3.5,\"Good\"]}"));
}

static void what_became_of_a_write_is_known_by_its_key(void **state)
{
    (void)state;
    json_t *first = post(post_setpoint, "{\"id\":1,\"value\":3,\"seq\":0,\"key\":\"one-two-three\"}");
    assert_string_equal(json_string_value(json_object_get(first, "state")), "accepted");
    assert_true(json_is_true(json_object_get(first, "stored")));
    const json_t *change = json_array_get(json_object_get(first, "changes"), 0);
    assert_true(json_is_null(json_object_get(change, "from")));
    assert_int_equal(json_integer_value(json_object_get(change, "seq")), 1);
    json_decref(first);
    json_t *again = post(post_setpoint, "{\"id\":1,\"value\":4,\"seq\":1,\"key\":\"one-two-three\"}");
    change = json_array_get(json_object_get(again, "changes"), 0);
    assert_near(json_number_value(json_object_get(change, "to")), 3, 0);
    json_decref(again);
    int64_t seq;
    in_force(APC_SETPOINT, 1, &seq);
    assert_int_equal(seq, 1);
    query[0] = "key";
    query[1] = "one-two-three";
    json_t *found = ask(get_writes);
    assert_int_equal(json_array_size(json_object_get(found, "writes")), 1);
    json_decref(found);
    query[1] = "no-such-key";
    json_decref(ask(get_writes));
    assert_int_equal(request.fault.http, 404);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":3,\"seq\":1,\"key\":\"short\"}"), 400);
}

static void too_many_writes_at_once_have_to_wait(void **state)
{
    char body[100];
    int n = 0;
    (void)state;
    do
        snprintf(body, sizeof body, "{\"id\":1,\"value\":%d,\"seq\":%d}", n, n);
    while (refused(post_setpoint, body) == 0 && ++n < 1000);
    assert_int_equal(request.fault.http, 429);
    assert_true(n >= 2 * WRITE_RATE && n < 100);
    assert_true(request.retry_after > 0 && request.retry_after <= S / WRITE_RATE);
}

/* ---- The threads -------------------------------------------------------------------------- */

static void nothing(void *ctx)
{
    (void)ctx;
}

/* Read the stream until this was in it; what was read is added to all. */
static void read_until(struct stream_reader *reader, struct text *all, const char *what)
{
    char part[4096];
    for (long n;;) {
        while ((n = stream_read(reader, part, sizeof part)) > 0)
            text_put(all, part, (size_t)n);
        if (all->n > 0 && memmem(all->at, all->n, what, strlen(what)))
            return;
        usleep(10000);
    }
}

/* Wait until what is asked has this in it. */
static void until_says(void (*handle)(struct ui *, struct request *, struct apc_store *), const char *part)
{
    while (!strstr(ask_text(handle), part))
        usleep(10000);
}

static void what_daemons_report_is_known_within_a_look(void **state)
{
    pthread_t thread;
    const apc_ns now = apc_clock_utc(NULL);
    struct apc_event link = {
        .time = now, .severity = APC_EVENT_WARNING, .source = "apc-client", .kind = "link", .text = "away"};
    (void)state;
    assert_int_equal(pthread_create(&thread, NULL, records_thread, ui), 0);
    plant_rhythm(&ui->model.plant, "base", 7 * S);
    put_window("base", "run", now - 2 * S, 3, 1000000, 5);
    until_says(get_diagnostics, "\"task\":\"base\",\"period\":2");
    put_window("base", "run", now - S, 4, 2000000, 6);
    put_window("exchange", "run", now, 4, 7000000, 2);
    until_says(get_diagnostics, "\"missed\":6");
    json_t *all = ask(get_diagnostics);
    assert_int_equal(json_array_size(json_object_get(all, "tasks")),
                     1); /* what a client measures is no task */
    json_decref(all);
    until_says(get_metrics, "apc_link_round_trip_seconds_count{link=\"apc-client\"} 4\n");
    has(ask_text(get_metrics), "apc_task_exec_seconds_count{task=\"base\"} 7\n");
    assert_int_equal(apc_store_append_events(store, &link, 1), 1);
    until_says(get_diagnostics, "\"text\":\"away\",\"changes\":1");
    has(ask_text(get_metrics), "apc_link_up{link=\"apc-client\"} 0\n");
    link.time++;
    link.severity = APC_EVENT_INFO;
    assert_int_equal(apc_store_append_events(store, &link, 1), 1);
    until_says(get_diagnostics, "\"text\":\"away\",\"changes\":2");
    has(ask_text(get_metrics), "apc_link_up{link=\"apc-client\"} 1\n");
    /* the periods that tasks report count more than what a file said */
    until_says(get_plant, "\"name\":\"base\",\"period\":2}");
    /* and what is described anew is found */
    tags[0].high = 7;
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    until_says(get_plant, "\"high\":7");
    ui->stopping = true;
    assert_int_equal(pthread_join(thread, NULL), 0);
}

static void newest_values_reach_the_stream_and_settle_writes(void **state)
{
    const struct stream_watcher watcher = {.session = ""};
    struct stream_reader *reader;
    struct text all = {0};
    bool resumed;
    pthread_t thread;
    (void)state;
    assert_int_equal(stream_open(ui->stream, &watcher, NULL, nothing, nothing, NULL, &reader, &resumed), 0);
    assert_int_equal(pthread_create(&thread, NULL, live_thread, ui), 0);
    put(APC_SETPOINT, 1, 41);
    read_until(reader, &all, "\"setpoint.1\":[1,1.000000,41,\"Good\"]");
    until_says(get_state, "\"setpoint.1\":[1,1.000000,41,\"Good\"]");
    json_decref(post(post_setpoint, "{\"id\":1,\"value\":42,\"seq\":1,\"key\":\"settled-one\"}"));
    assert_int_equal(request.fault.http, 0);
    until_says(get_state, ",42,\"Good\"]");
    /* the controller says that it has taken the second row of r1 */
    double none = 0;
    struct apc_sample taken = {.table = APC_ACTUAL,
                               .id = apc_variable_number(APC_SETPOINT, 1),
                               .seq = 1,
                               .time = S,
                               .value = 42,
                               .origin = 2};
    struct apc_vector tick = {
        .table = APC_TICK, .id = 1, .seq = 1, .time = apc_clock_utc(NULL), .n = 1, .room = 1, .value = &none};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &taken, .n_samples = 1, .vector = &tick, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(store, &rows), 2);
    until_says(get_writes, "\"state\":\"applied\"");
    /* and of the mode that it does not take it, and why a little later */
    json_decref(post(post_mode, "{\"id\":1,\"mode\":\"Man\",\"seq\":0,\"key\":\"refused-one\"}"));
    assert_int_equal(request.fault.http, 0);
    taken = (struct apc_sample){.table = APC_ACTUAL,
                                .id = apc_variable_number(APC_OPMODE, 1),
                                .seq = 1,
                                .time = S,
                                .value = APC_MODE_AUTO,
                                .status = APC_BAD,
                                .origin = 1};
    tick.seq = 2;
    assert_int_equal(apc_store_append_rows(store, &rows), 2);
    until_says(get_state, "\"actual.21\":[1,");
    struct apc_event why = {.time = apc_clock_utc(NULL),
                            .severity = APC_EVENT_WARNING,
                            .source = "apc-controller",
                            .kind = "rejected",
                            .text = "u1: not today"};
    assert_int_equal(apc_store_append_events(store, &why, 1), 1);
    until_says(get_writes, "\"state\":\"failed\",\"stored\":true,\"reason\":\"u1: not today\"");
    ui->stopping = true;
    assert_int_equal(pthread_join(thread, NULL), 0);
    stream_close(reader);
    text_free(&all);
}

static void every_event_of_a_flood_reaches_the_stream_in_order(void **state)
{
    const struct stream_watcher watcher = {.session = ""};
    struct stream_reader *reader;
    struct text all = {0};
    bool resumed;
    pthread_t thread;
    char text[32];
    (void)state;
    put_events(1, "before");
    assert_int_equal(stream_open(ui->stream, &watcher, NULL, nothing, nothing, NULL, &reader, &resumed), 0);
    assert_int_equal(pthread_create(&thread, NULL, records_thread, ui), 0);
    while (1) { /* its first look is over: what comes now is new */
        struct text probe = {0};
        put_events(1, "probe");
        usleep(50000);
        char part[4096];
        long n = stream_read(reader, part, sizeof part);
        if (n > 0)
            text_put(&probe, part, (size_t)n);
        bool seen = probe.n > 0 && memmem(probe.at, probe.n, "\"probe\"", 7);
        text_free(&probe);
        if (seen)
            break;
    }
    put_events(3000, "flood");
    read_until(reader, &all, "\"kind\":\"flood\",\"text\":\"2999\"");
    const char *at = all.at;
    for (int i = 0; i < 3000; i++) {
        snprintf(text, sizeof text, "\"flood\",\"text\":\"%d\"", i);
        at = memmem(at, all.n - (size_t)(at - all.at), text, strlen(text));
        if (!at)
            fail_msg("event %d of 3000 did not reach the stream", i);
    }
    ui->stopping = true;
    assert_int_equal(pthread_join(thread, NULL), 0);
    stream_close(reader);
    text_free(&all);
}

static pthread_t start(void *(*thread)(void *))
{
    pthread_t started;
    assert_int_equal(pthread_create(&started, NULL, thread, ui), 0);
    return started;
}

static void stop(pthread_t thread)
{
    ui->stopping = true;
    assert_int_equal(pthread_join(thread, NULL), 0);
}

/* Wait until the records thread has looked at everything once more. */
static void another_look(void)
{
    for (int i = 0; i < 2; i++) {
        const apc_ns round = ui->round[1];
        while (ui->round[1] == round)
            usleep(10000);
    }
}

struct sought {
    const char *part;
    enum apc_event_severity severity;
    int n;
};

static int take_sought(void *ctx, const struct apc_event *event)
{
    struct sought *s = ctx;
    s->n += !strcmp(event->kind, "access") && event->severity == s->severity && strstr(event->text, s->part);
    return 0;
}

static int accesses(enum apc_event_severity severity, const char *part)
{
    struct sought s = {.part = part, .severity = severity};
    assert_true(apc_store_events(store, &(struct apc_range){.last = 1000}, take_sought, &s) >= 0);
    return s.n;
}

/* In the look after the one that found it. */
static void until_recorded(enum apc_event_severity severity, const char *part, int n)
{
    while (accesses(severity, part) < n)
        usleep(10000);
    assert_int_equal(accesses(severity, part), n);
}

static void files_of_users_are_followed(void **state)
{
    char folder[] = "/tmp/apc-handlers.XXXXXX", tokens[4096], secret[SECRET_LEN], command[80];
    struct apc_error why;
    struct session anna, otto, machine, found;
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(ui->users_path, sizeof ui->users_path, "%s/users", folder);
    tokens_path(ui->users_path, tokens);
    pthread_t thread = start(records_thread);
    another_look();
    assert_true(ui->open); /* there is no file, and never was one */
    assert_int_equal(accesses(APC_EVENT_WARNING, ""), 0);
    assert_int_equal(users_add(ui->users_path, "anna", ROLE_OPERATOR, "operator123", &why), 0);
    until_recorded(APC_EVENT_WARNING, "users has changed", 1);
    assert_false(ui->open);
    assert_int_equal(session_open(&ui->sessions, &ui->users.user[0], apc_clock_mono(NULL), &anna), 0);
    assert_int_equal(users_add(ui->users_path, "otto", ROLE_OBSERVER, "observer123", &why), 0);
    assert_int_equal(tokens_add(tokens, "grafana", ROLE_OBSERVER, 0, secret, &why), 0);
    until_recorded(APC_EVENT_WARNING, "users has changed", 2);
    until_recorded(APC_EVENT_WARNING, "users.tokens has changed", 1);
    assert_true(
        session_find(&ui->sessions, anna.token, apc_clock_mono(NULL), &found)); /* she is who she was */
    assert_int_equal(session_open(&ui->sessions, users_find(&ui->users, "otto"), apc_clock_mono(NULL), &otto),
                     0);
    assert_int_equal(session_machine(&ui->sessions, &ui->tokens.user[0], apc_clock_mono(NULL), &machine), 0);

    assert_int_equal(chmod(ui->users_path, 0644), 0); /* what it said stays in force, and that is said once */
    until_recorded(APC_EVENT_ALARM, "what it said before stays in force", 1);
    another_look();
    assert_int_equal(accesses(APC_EVENT_ALARM, ""), 1);
    assert_int_equal(ui->users.n, 2);
    assert_int_equal(chmod(ui->users_path, 0600), 0);
    another_look();
    assert_int_equal(chmod(ui->users_path, 0644), 0);
    until_recorded(APC_EVENT_ALARM, "what it said before stays in force", 2); /* and when it happens again */
    assert_int_equal(chmod(ui->users_path, 0600), 0);

    assert_int_equal(users_remove(ui->users_path, "otto", &why), 0);
    until_recorded(APC_EVENT_WARNING, "users has changed", 3);
    assert_false(session_find(&ui->sessions, otto.token, apc_clock_mono(NULL), &found));
    assert_true(session_find(&ui->sessions, anna.token, apc_clock_mono(NULL), &found));
    assert_int_equal(unlink(tokens), 0);
    until_recorded(APC_EVENT_WARNING, "users.tokens is gone: nobody in it may log in", 1);
    assert_false(session_find(&ui->sessions, machine.token, apc_clock_mono(NULL), &found));
    assert_true(session_find(&ui->sessions, anna.token, apc_clock_mono(NULL), &found));
    assert_int_equal(unlink(ui->users_path), 0);
    until_recorded(APC_EVENT_WARNING, "users is gone: nobody in it may log in", 1);
    assert_false(session_find(&ui->sessions, anna.token, apc_clock_mono(NULL), &found));
    assert_false(ui->open); /* without users it is nobody's, until it is started again */
    stop(thread);
    users_free(&ui->users);
    users_free(&ui->tokens);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
}

/* A spool with n samples, the first of this time, and an event. */
static void leave(const char *folder, const char *name, int n, apc_ns time)
{
    char path[128];
    const struct apc_event event = {
        .time = time + 7 * S, .severity = APC_EVENT_INFO, .source = "x", .kind = "x"};
    snprintf(path, sizeof path, "%s/%s", folder, name);
    const struct apc_store_options options = {
        .size = sizeof options, .name = name, .spool = path, .backoff_min = 1, .backoff_max = 1};
    struct apc_store *away;
    assert_int_equal(apc_store_open(&away, "sqlite:/no/such/folder/store.db", &options, NULL), 0);
    for (int i = 0; i < n; i++) {
        const struct apc_sample s = {.table = APC_SENSOR, .id = 1, .seq = i + 1, .time = time + i * S};
        assert_int_equal(apc_store_append(away, &s, 1), 1);
    }
    assert_int_equal(apc_store_append_events(away, &event, 1), 1);
    apc_store_close(away);
}

static void what_waits_in_all_spools_is_counted(void **state)
{
    char folder[] = "/tmp/apc-handlers.XXXXXX", command[80];
    const apc_ns now = apc_clock_utc(NULL);
    (void)state;
    assert_non_null(mkdtemp(folder));
    ui->options.spool = folder;
    pthread_t thread = start(records_thread);
    another_look();
    has(ask_text(get_diagnostics), "\"spool\":{\"depth\":0,\"age\":0}");
    leave(folder, "client.spool", 3, now - 500 * S);
    leave(folder, "controller.spool", 2, now - 900 * S);
    leave(folder, "plant.spool", 1, now - 100 * S);
    leave(folder, "set-aside", 1, now - 5000 * S); /* is no spool of a daemon */
    until_says(get_diagnostics, "\"spool\":{\"depth\":9,\"age\":9");
    assert_int_equal(ui->model.spool.samples, 6);
    assert_int_equal(ui->model.spool.events, 3);
    stop(thread);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
}

static void what_was_there_before_the_server_stands_and_is_no_news(void **state)
{
    const struct stream_watcher watcher = {.session = ""};
    const apc_ns now = apc_clock_utc(NULL);
    const struct apc_event old[] = {{.time = now - 90 * S,
                                     .severity = APC_EVENT_INFO,
                                     .source = "apc-client",
                                     .kind = "link",
                                     .text = "there"},
                                    {.time = now - 80 * S,
                                     .severity = APC_EVENT_ALARM,
                                     .source = "apc-plant",
                                     .kind = "watchdog",
                                     .text = "old"},
                                    {.time = now - 70 * S,
                                     .severity = APC_EVENT_INFO,
                                     .source = "apc-other",
                                     .kind = "link",
                                     .text = "too"}};
    struct stream_reader *reader;
    struct text all = {0};
    bool resumed;
    (void)state;
    assert_int_equal(apc_store_append_events(store, old, 3), 3);
    put_window("controller", "run", now - 30 * S, 3, 1000000, 5);
    assert_int_equal(stream_open(ui->stream, &watcher, NULL, nothing, nothing, NULL, &reader, &resumed), 0);
    pthread_t thread = start(records_thread);
    another_look();
    assert_string_equal(control("safe"), "true");
    json_t *json = ask(get_diagnostics);
    const json_t *task = json_array_get(json_object_get(json, "tasks"), 0),
                 *links = json_object_get(json, "links"), *other = json_array_get(links, 1);
    assert_near(json_number_value(json_object_get(task, "age")), 30, 20); /* it was heard when it spoke */
    assert_int_equal(json_integer_value(json_object_get(task, "missed")), 5);
    assert_int_equal(json_integer_value(json_object_get(task, "missed_total")),
                     0); /* since this server began */
    assert_int_equal(json_array_size(links), 2);
    assert_true(json_is_true(json_object_get(other, "up")));
    assert_string_equal(json_string_value(json_object_get(other, "text")), "too");
    assert_near(json_number_value(json_object_get(other, "since")), (double)(now - 70 * S) / 1e9, 1);
    json_decref(json);
    put_window("plant", "lateness", now - S, 2, 4000, 1);
    put_window("plant", "run", now - S, 2, 4000, 1);
    put_events(1, "news");
    read_until(reader, &all, "\"news\"");
    read_until(reader, &all, "\"task\":\"plant\"");
    text_put(&all, "", 1);
    assert_null(strstr(all.at, "watchdog"));
    has(all.at, "event: event\n");
    const char *tasks = strstr(all.at, "data: {\"tasks\":[{\"task\":\"plant\""); /* only who has reported */
    assert_non_null(tasks);
    assert_int_equal(times_in(all.at, "\"task\":\"controller\""), 1); /* at the first look */
    until_says(get_diagnostics, "\"task\":\"plant\"");
    json = ask(get_diagnostics);
    task = json_array_get(json_object_get(json, "tasks"), 1);
    assert_int_equal(json_integer_value(json_object_get(task, "missed_total")), 1); /* once for a window */
    assert_int_equal(json_integer_value(json_object_get(json_object_get(task, "lateness"), "count")), 2);
    json_decref(json);
    stop(thread);
    stream_close(reader);
    text_free(&all);
}

static double age_of(const char *ref)
{
    json_t *json = ask(get_state);
    const json_t *age = json_object_get(json_object_get(json, "ages"), ref);
    double value = json_is_null(age) ? -1 : json_number_value(age);
    json_decref(json);
    return value;
}

static void the_age_of_what_was_there_already_is_that_of_its_stamp(void **state)
{
    const apc_ns now = apc_clock_utc(NULL);
    struct apc_sample y = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = now - 1000 * S, .value = 1},
                      ahead = {.table = APC_SENSOR, .id = 2, .seq = 1, .time = now + 5000 * S, .value = 1};
    const struct stream_watcher watcher = {.session = ""};
    struct stream_reader *reader;
    struct text all = {0};
    bool resumed;
    char expected[60];
    (void)state;
    assert_int_equal(stream_open(ui->stream, &watcher, NULL, nothing, nothing, NULL, &reader, &resumed), 0);
    assert_int_equal(apc_store_append(store, &y, 1), 1);
    assert_int_equal(apc_store_append(store, &ahead, 1), 1);
    pthread_t thread = start(live_thread);
    until_says(get_state, "\"sensor.1\":[1,");
    until_says(get_state, "\"sensor.2\":[1,");
    assert_near(age_of("sensor.1"), 1000, 500);
    assert_near(age_of("sensor.2"), 0, 500); /* a clock that is ahead is not believed */
    assert_near(age_of("actuator.1"), -1, 0);
    y.seq = 2; /* as old as before by its stamp, but it came now */
    assert_int_equal(apc_store_append(store, &y, 1), 1);
    until_says(get_state, "\"sensor.1\":[2,");
    assert_near(age_of("sensor.1"), 0, 500);
    read_until(reader, &all, "\"sensor.1\":[2,");
    text_put(&all, "", 1);
    snprintf(expected, sizeof expected, "event: plant\ndata: {\"revision\":%u}\n", ui->model.plant.revision);
    has(all.at, expected); /* what it is all about comes first */
    assert_true(strstr(all.at, expected) < strstr(all.at, "event: values"));
    json_t *json = ask(get_diagnostics);
    const json_t *lag = json_object_get(json_object_get(json, "stream"), "lag"),
                 *reads = json_object_get(json_object_get(json, "store"), "read");
    assert_true(json_integer_value(json_object_get(lag, "count")) > 0);
    assert_near(json_number_value(json_object_get(lag, "max")), 1000,
                500); /* from its stamp to its message */
    assert_true(json_integer_value(json_object_get(reads, "count")) >= 2);
    json_decref(json);
    assert_true(ui->model.connected);

    tags[1].high = 7; /* described anew */
    assert_true(apc_store_put_tags(store, tags, n_tags) >= 0);
    assert_int_equal(model_load(&ui->model, store), 0);
    snprintf(expected, sizeof expected, "event: plant\ndata: {\"revision\":%u}\n", ui->model.plant.revision);
    read_until(reader, &all, expected);
    until_says(get_state, "\"sensor.1\":[2,");
    until_says(get_state, "\"actuator.1\":[0,null,null,\"BadNoData\"]");
    stop(thread);
    stream_close(reader);
    text_free(&all);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(what_never_came_but_should_is_stale),
        T(a_controller_is_judged_by_its_own_ticks),
        T(out_of_service_writes_nothing_and_runs_all_the_same),
        T(why_the_mode_is_not_the_target_is_said_of_its_loop_while_it_lasts),
        T(the_plant_at_its_safe_value_stands_until_it_takes_commands),
        T(ready_is_what_ticks),
        T(a_thread_that_goes_round_no_more_is_not_alive),
        T(a_link_is_there_before_it_ever_changed),
        T(how_far_the_history_is_behind_is_said_where_there_is_one),
        T(process_values_are_in_the_metrics),
        T(what_tasks_report_is_in_the_metrics),
        T(what_the_server_does_itself_is_in_the_metrics),
        T(diagnostics_say_how_each_part_is),
        T(a_meter_forgets_what_is_old_and_keeps_its_sum),
        T(timing_is_put_together_by_task_and_against_time),
        T(timing_is_asked_for_in_one_way),
        T(what_stood_before_the_window_is_told),
        T(a_bad_sample_is_counted_and_not_averaged),
        T(what_was_expected_stands_beside_what_came),
        T(what_the_controllers_were_worth_is_told),
        T(what_cannot_be_read_is_no_empty_answer),
        T(what_daemons_report_is_known_within_a_look),
        T(newest_values_reach_the_stream_and_settle_writes),
        T(a_loop_is_what_the_law_pairs),
        T(each_loop_has_its_controller_its_modes_and_the_loop_above),
        T(who_goes_along_is_said_and_what_it_would_put_out),
        T(what_a_law_does_not_publish_now_is_old_and_no_alarm),
        T(history_is_given_by_name_for_several_at_once),
        T(history_comes_as_csv_of_all_that_was_asked_for),
        T(history_comes_as_binary_columns),
        T(the_drawing_is_given_as_it_is_and_must_not_run),
        T(a_drawing_has_at_most_a_mebibyte),
        T(a_name_that_two_have_is_nobodys),
        T(history_is_asked_for_in_one_way),
        T(the_newest_events_are_found_however_many_lie_on_top),
        T(exactly_as_many_events_as_asked_for_are_all),
        T(the_record_shows_every_digit),
        T(a_reason_is_on_record_with_every_kind_of_write),
        T(what_had_no_value_and_what_is_a_mode_are_recorded_in_words),
        T(limits_are_inclusive_and_their_refusal_names_them),
        T(an_output_is_the_operators_in_man_only),
        T(a_mode_is_written_to_its_loop_and_no_other),
        T(a_setpoint_that_the_loop_above_moves_is_taken_local_and_that_is_said),
        T(a_setpoint_that_was_taken_is_given_back_to_the_scheduler),
        T(as_many_tunings_as_there_are_go_at_once),
        T(a_stale_write_is_told_what_is_newer),
        T(what_became_of_a_write_is_known_by_its_key),
        T(too_many_writes_at_once_have_to_wait),
        T(every_event_of_a_flood_reaches_the_stream_in_order),
        T(files_of_users_are_followed),
        T(what_waits_in_all_spools_is_counted),
        T(what_was_there_before_the_server_stands_and_is_no_news),
        T(the_age_of_what_was_there_already_is_that_of_its_stamp),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
