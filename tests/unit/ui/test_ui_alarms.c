/* SPDX-License-Identifier: BSD-3-Clause */
/* What the API says of alarms, asked without a connection, on a store in memory in which they are evaluated. */
#include "experiment/experiment.h"
#include "ui_request.h"

static const char text[] =
    "name = \"alarms\"; title = \"alarms\"; duration = 10.0;\n"
    "measurements = ( { name = \"y\"; unit = \"m\"; low = -100.0; high = 100.0; area = \"left\";\n"
    "                   alarms = ( { kind = \"high\"; limit = 10.0; priority = 2; message = \"too much\"; "
    "},\n"
    "                              { kind = \"low\"; limit = -5.0; priority = 4; } ); } );\n"
    "setpoints = ( { name = \"r\"; unit = \"m\"; low = 0.0; high = 100.0; initial = 0.0; } );\n"
    "outputs = ( { name = \"u\"; low = -100.0; high = 100.0; } );\n"
    "plant = { model = \"first-order\"; period = 0.2; };\n"
    "client = { period = 0.5; };\n"
    "alarms = { period = 60.0; };\n"
    "controller = { law = \"pi\"; period = 2.0; tuning = ( { Kp = 0.2; tau_i = 10.0; } ); };\n";

static struct experiment e;
static struct apc_alarms *alarms;

/* The answer as JSON, to be given back; NULL when it is none. */
static json_t *ask(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    request.fault = (struct fault){0};
    text_free(&request.reply);
    text_free(&request.extra);
    handle(ui, &request, store);
    return json_loadb(request.reply.at ? request.reply.at : "", request.reply.n, 0, NULL);
}

static const char *ask_text(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    static char answer[1 << 16];
    json_decref(ask(handle));
    snprintf(answer, sizeof answer, "%.*s", (int)request.reply.n, request.reply.at ? request.reply.at : "");
    return answer;
}

static int set_up(void **state)
{
    const struct experiment_source source = {.file = "test", .text = text};
    struct apc_error why;
    (void)state;
    if (!ui_made("mem:ui-alarms"))
        return -1;
    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        provision(store, &e, PROVISION_KEEP) < 0 || module_alarms(&e, &alarms, &why) < 0)
        fail_msg("%s", why.text);
    if (model_load(&ui->model, store) < 0)
        return -1;
    ask_nothing();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    apc_alarms_destroy(alarms);
    alarms = NULL;
    experiment_free(&e);
    ui_gone();
    return 0;
}

/* As apc-alarms does it. */
static void evaluate(void)
{
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    assert_true(apc_store_read_rows(store, apc_alarms_in(alarms)) >= 0);
    (void)apc_alarms_compute(alarms, now, NULL);
    assert_true(apc_store_append_rows(store, apc_alarms_out(alarms)) >= 0);
    apc_alarms_stored(alarms);
}

static void measured(double y)
{
    struct apc_sample s = {.table = APC_SENSOR, .id = 1};
    assert_true(apc_store_read(store, &s, 1) >= 0);
    s = (struct apc_sample){
        .table = APC_SENSOR, .id = 1, .seq = s.seq + 1, .time = apc_clock_utc(NULL), .value = y};
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    evaluate();
}

/* A member of alarm number @p i of the list, to be given back. */
static json_t *alarm_member(size_t i, const char *name)
{
    json_t *all = ask(get_alarms);
    json_t *member = json_incref(json_object_get(json_array_get(json_object_get(all, "alarms"), i), name));
    json_decref(all);
    return member;
}

static void assert_state(size_t i, const char *state)
{
    json_t *member = alarm_member(i, "state");
    assert_string_equal(json_string_value(member), state);
    json_decref(member);
}

static void the_list_says_how_all_alarms_stand(void **state)
{
    (void)state;
    json_t *all = ask(get_alarms);
    assert_int_equal(json_array_size(json_object_get(all, "alarms")), 2);
    assert_true(json_is_false(json_object_get(all, "evaluated")));
    assert_true(json_is_null(json_object_get(all, "time")));
    json_decref(all);
    measured(20);
    assert_state(0, "Unacknowledged Active");
    assert_state(1, "Normal");
    const char *answer = ask_text(get_alarms);
    assert_non_null(strstr(answer, "\"evaluated\":true"));
    assert_non_null(strstr(answer, "\"alarm\":\"y.high\",\"id\":1,\"seq\":1,\"journal\":1,\"state\":"
                                   "\"Unacknowledged Active\",\"active\":true,\"unacknowledged\":true,"
                                   "\"standing\":true,\"time\":"));
    assert_non_null(strstr(answer, "\"author\":null,\"shelved_until\":null,\"kind\":\"high\",\"priority\":2,"
                                   "\"area\":\"left\",\"message\":\"too much\",\"consequence\":\"\","
                                   "\"response\":\"\"}"));
}

static void the_journal_gives_the_newest_in_their_order(void **state)
{
    (void)state;
    assert_non_null(strstr(ask_text(get_alarm_journal), "\"transitions\":[]"));
    measured(20);
    measured(1);
    measured(-20);
    const char *answer = ask_text(get_alarm_journal);
    const char *raised = strstr(answer, "{\"number\":1,"), *returned = strstr(answer, "{\"number\":2,"),
               *low = strstr(answer, "{\"number\":3,");
    assert_true(raised && raised < returned && returned < low);
    assert_non_null(strstr(raised, "\"alarm\":\"y.high\",\"priority\":2,\"raised\":true,\"state\":"
                                   "\"Unacknowledged Active\",\"before\":\"Normal\",\"author\":null}"));
    assert_non_null(strstr(low, "\"alarm\":\"y.low\""));
    query[0] = "last";
    query[1] = "1";
    answer = ask_text(get_alarm_journal);
    assert_null(strstr(answer, "{\"number\":2,"));
    assert_non_null(strstr(answer, "{\"number\":3,"));
    query[0] = "until";
    query[1] = "-1000";
    assert_non_null(strstr(ask_text(get_alarm_journal), "\"transitions\":[]"));
}

static const char *journal_answer;

/* The numbers of those that are found, as "1 2 3". */
static const char *found_in_journal(const char *name, const char *value, const char *other, const char *with)
{
    static char numbers[64];
    const char *const asked[] = {name, value, other, with};
    size_t n = 0;
    numbers[0] = '\0';
    memset(query, 0, sizeof query);
    memcpy(query, asked, sizeof asked);
    journal_answer = ask_text(get_alarm_journal);
    for (const char *at = journal_answer; (at = strstr(at, "{\"number\":")) != NULL; at++)
        n += (size_t)snprintf(numbers + n, sizeof numbers - n, "%s%ld", n ? " " : "",
                              strtol(at + strlen("{\"number\":"), NULL, 10));
    return numbers;
}

static void the_journal_is_searched_and_read_page_by_page(void **state)
{
    char until[32];
    (void)state;
    measured(20); /* y.high comes */
    measured(1);  /* and goes */
    measured(-20);
    measured(1);
    measured(20);
    assert_string_equal(found_in_journal(NULL, NULL, NULL, NULL), "1 2 3 4 5");
    assert_string_equal(found_in_journal("text", "MUCH  y", NULL, NULL), "1 2 5");
    assert_string_equal(found_in_journal("text", "much low", NULL, NULL), "");
    assert_string_equal(found_in_journal("text", "low", "last", "1"), "4");
    assert_string_equal(found_in_journal("area", "left", "priority", "1,2"), "1 2 5");
    assert_string_equal(found_in_journal("area", "lef", NULL, NULL), "");
    assert_string_equal(found_in_journal("state", "RTN Unacknowledged", NULL, NULL), "2 4");
    assert_string_equal(found_in_journal("state", "Unacknowledged Active", "last", "1"), "5");
    assert_string_equal(found_in_journal("state", "Shelved", NULL, NULL), "");
    /* an answer says how the page before it is asked for */
    assert_string_equal(found_in_journal("last", "2", NULL, NULL), "4 5");
    static const char page_before[] = "\"next\":{\"before\":4,\"until\":";
    const char *next = strstr(journal_answer, page_before);
    assert_non_null(next);
    next += sizeof page_before - 1;
    snprintf(until, sizeof until, "%.*s", (int)strcspn(next, "}"), next);
    assert_string_equal(found_in_journal("before", "4", "until", until), "1 2 3");
    assert_non_null(strstr(journal_answer, "\"next\":null}"));
    assert_string_equal(found_in_journal("before", "4", "last", "1"), "3");
}

static void what_is_no_range_is_refused(void **state)
{
    static const char *const wrong[][4] = {{"last", "0"},
                                           {"last", "1001"},
                                           {"since", "then"},
                                           {"priority", "1,"},
                                           {"priority", "5"},
                                           {"priority", ""},
                                           {"state", "Shelved, no"},
                                           {"state", ""},
                                           {"before", "0"},
                                           {"since", "-5", "until", "-10"}};
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        memset(query, 0, sizeof query);
        memcpy(query, wrong[i], sizeof wrong[i]);
        assert_string_equal(ask_text(get_alarm_journal), "");
        assert_int_equal(request.fault.http, wrong[i][3] ? 422 : 400); /* each is right, both are not */
        assert_string_equal(request.fault.code, "parameter");
    }
}

static void a_store_without_alarms_has_none(void **state)
{
    struct apc_store *empty = NULL, *own = store;
    (void)state;
    assert_int_equal(apc_store_open(&empty, "mem:", NULL, NULL), 0);
    assert_true(apc_store_init(empty) >= 0);
    store = empty;
    assert_non_null(strstr(ask_text(get_alarms), "\"evaluated\":false,\"time\":null,\"alarms\":[]}"));
    assert_non_null(strstr(ask_text(get_alarm_journal), "\"transitions\":[],\"next\":null}"));
    store = own;
    apc_store_close(empty);
}

/* Promise(page/alarm-acknowledged) */
static void figures_count_them(void **state)
{
    (void)state;
    measured(20);
    measured(1);
    measured(20);
    ui->model.plant.start = apc_clock_utc(NULL) - 2 * 86400 * APC_NS_PER_S;
    const char *answer = ask_text(get_alarm_figures);
    assert_non_null(
        strstr(answer, "\"hours\":24,\"raised\":2,\"by_priority\":[0,2,0,0],\"per_hour\":0.0833"));
    assert_non_null(strstr(answer, "\"most_in_ten_minutes\":2,\"floods\":0,\"windows\":144,"));
    assert_non_null(
        strstr(answer, "\"standing\":1,\"stale\":0,\"unacknowledged\":1,\"to_acknowledge\":null,"));
    assert_non_null(
        strstr(answer, "\"alarms\":[{\"id\":1,\"alarm\":\"y.high\",\"raised\":2,\"chatters\":false,"));
    assert_null(strstr(answer, "y.low")); /* it never came */
    /* Of the record, where that is shorter than what is asked for. */
    ui->model.plant.start = apc_clock_utc(NULL) - 3000 * APC_NS_PER_S;
    answer = ask_text(get_alarm_figures);
    assert_non_null(strstr(answer, "\"hours\":0.83"));
    assert_non_null(strstr(answer, "\"per_hour\":2.39"));
    assert_null(strstr(answer, "\"windows\":144,"));
    ui->model.plant.start = 0; /* nobody knows: since the first transition */
    answer = ask_text(get_alarm_figures);
    assert_null(strstr(answer, "\"hours\":24,"));
    assert_non_null(strstr(answer, "\"windows\":1,"));
    query[0] = "since";
    query[1] = "-2700000"; /* more than 31 days */
    assert_string_equal(ask_text(get_alarm_figures), "");
    assert_int_equal(request.fault.http, 422);
}

static void settings_are_tried_on_the_record(void **state)
{
    (void)state;
    measured(20);
    measured(1);
    assert_string_equal(ask_text(get_alarm_trial), "");
    assert_int_equal(request.fault.http, 400);
    query[0] = "alarm";
    query[1] = "y.hihg";
    assert_string_equal(ask_text(get_alarm_trial), "");
    assert_int_equal(request.fault.http, 404);
    query[1] = "y.high";
    const char *answer = ask_text(get_alarm_trial);
    assert_non_null(strstr(answer, "\"alarm\":\"y.high\",\"since\":"));
    assert_non_null(strstr(answer, "{\"setting\":\"on-delay\",\"value\":5,\"raised\":0,"));
}

static void metrics_count_them_while_they_are_evaluated(void **state)
{
    struct model *m = &ui->model;
    (void)state;
    const char *metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_alarms_evaluated 0\n"));
    assert_null(strstr(metrics, "\napc_alarms{"));
    m->alarms.seq = 1; /* as the live thread does it */
    m->alarms_ticked = apc_clock_mono(NULL);
    m->alarm_numbers[APC_ALARMS_JOURNAL] = 7;
    m->alarm_numbers[APC_ALARMS_ACTIVE] = 3;
    m->alarm_numbers[APC_ALARMS_UNACKED] = 2;
    m->alarm_numbers[APC_ALARMS_STANDING + 3] = 5;
    metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_alarms_evaluated 1\n"));
    assert_non_null(strstr(metrics, "\napc_alarms{state=\"active\"} 3\n"));
    assert_non_null(strstr(metrics, "\napc_alarms{state=\"unacknowledged\"} 2\n"));
    assert_non_null(strstr(metrics, "\napc_alarms{state=\"out_of_service\"} 0\n"));
    assert_non_null(strstr(metrics, "\napc_alarms_standing{priority=\"1\"} 0\n"));
    assert_non_null(strstr(metrics, "\napc_alarms_standing{priority=\"4\"} 5\n"));
    assert_non_null(strstr(metrics, "\napc_alarm_transitions_total 7\n"));
    m->alarms_ticked -= 3600 * S;
    metrics = ask_text(get_metrics);
    assert_non_null(strstr(metrics, "\napc_alarms_evaluated 0\n"));
    assert_null(strstr(metrics, "\napc_alarms{"));
}

/* ---- What is wanted ------------------------------------------------------------------------ */

/* The status of the answer; the write's state is in the reply. */
static int want(void (*handle)(struct ui *, struct request *, struct apc_store *), const char *name,
                const char *body)
{
    ask_nothing();
    snprintf(request.name, sizeof request.name, "%s", name);
    request.body = strdup(body);
    request.n = strlen(body);
    json_decref(ask(handle));
    return request.fault.http ? request.fault.http : 200;
}

static bool answered(const char *part)
{
    char answer[4096];
    snprintf(answer, sizeof answer, "%.*s", (int)request.reply.n, request.reply.at ? request.reply.at : "");
    return strstr(answer, part) != NULL;
}

static int acknowledge(const char *name, int seq)
{
    char body[64];
    snprintf(body, sizeof body, "{\"seq\":%d}", seq);
    return want(post_alarm_ack, name, body);
}

static int shelve(double ahead, const char *once, int seq)
{
    char body[128];
    snprintf(body, sizeof body, "{\"until\":%.0f,\"seq\":%d%s}",
             ahead > 0 || ahead < 0 ? floor(apc_ns_to_s(apc_clock_utc(NULL)) + ahead) : 0, seq, once);
    return want(post_alarm_shelve, "y.high", body);
}

/* As the live thread settles writes, where apc-alarms has just ticked. Returns all of them, as JSON. */
static const char *settled(void)
{
    static char all[1 << 14];
    struct apc_sample rows[WRITES_OPEN];
    struct text t = {0};
    struct refusal refusal = {0};
    int by[WRITES_OPEN] = {0};
    const apc_ns utc = apc_clock_utc(NULL);
    const struct apc_vector tick = {.table = APC_TICK, .seq = 1, .time = utc};
    const struct loops_controller of = {.name = "apc-alarms", .period = S};
    const size_t n = writes_open(ui->writes, rows);
    assert_int_equal(apc_store_read(store, rows, n), 0);
    const struct seen seen = {
        .samples = rows, .by = by, .n = n, .tick = &tick, .controller = &of, .utc = utc};
    if (writes_settle(ui->writes, &seen, apc_clock_mono(NULL), &refusal)) {
        snprintf(refusal.text, sizeof refusal.text, "look again");
        assert_false(writes_settle(ui->writes, &seen, apc_clock_mono(NULL), &refusal));
    }
    writes_json(ui->writes, NULL, &t);
    snprintf(all, sizeof all, "%.*s", (int)t.n, t.at);
    text_free(&t);
    return all;
}

static int last_event(void *ctx, const struct apc_event *event)
{
    memcpy(ctx, event, sizeof *event);
    return 0;
}

static void what_is_acknowledged_is_confirmed_and_on_record(void **state)
{
    struct apc_event event = {0};
    (void)state;
    measured(20);
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"key\":\"same-key\"}"), 200);
    assert_true(answered("\"kind\":\"ack\",\"user\":\"local\""));
    assert_true(answered("\"state\":\"accepted\",\"stored\":true"));
    assert_true(answered("\"name\":\"y.high\",\"from\":null,\"to\":1,\"seq\":1"));
    assert_non_null(strstr(settled(), "\"state\":\"accepted\""));
    evaluate();
    assert_non_null(strstr(settled(), "\"state\":\"applied\""));
    assert_int_equal(writes_open(ui->writes, (struct apc_sample[WRITES_OPEN]){{0}}), 0);
    assert_state(0, "Acknowledged Active");
    json_t *raised = alarm_member(0, "raised"), *time = alarm_member(0, "time");
    assert_true(json_number_value(raised) > 1e9); /* the row that raised it, not the newest one */
    assert_true(json_number_value(raised) < json_number_value(time));
    json_decref(raised);
    json_decref(time);
    json_t *author = alarm_member(0, "author");
    assert_string_equal(json_string_value(author), "local");
    json_decref(author);
    assert_true(apc_store_events(store, NULL, last_event, &event) >= 1);
    assert_string_equal(event.kind, "operator");
    assert_string_equal(event.source, "local");
    assert_string_equal(event.text, "y.high: acknowledged (from 10.0.0.7)");
    /* once more, with the same key: what became of it */
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"key\":\"same-key\"}"), 200);
    assert_true(answered("\"state\":\"applied\""));
}

/* The journal, once that is evaluated. */
static void acknowledged_because(const char *reason)
{
    struct alarm_journal journal;
    evaluate();
    assert_non_null(strstr(ask_text(get_alarm_journal), "Acknowledged Active"));
    assert_int_equal(alarm_journal_load(&journal, store, 2, NULL), 0);
    assert_int_equal(alarm_journal_reasons(&journal, store, &ui->desk[DESK_PAST].board.e), 0);
    assert_int_equal(journal.n, 2);
    assert_string_equal(journal.at[1].reason, reason);
    alarm_journal_free(&journal);
}

/* Promise(page/alarm-acknowledged) */
static void a_reason_is_on_record(void **state)
{
    struct apc_event event = {0};
    (void)state;
    measured(20);
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"reason\":\"valve 3 stuck\"}"), 200);
    assert_true(apc_store_events(store, NULL, last_event, &event) >= 1);
    assert_string_equal(event.text, "y.high: acknowledged (from 10.0.0.7): valve 3 stuck");
    acknowledged_because("valve 3 stuck");
}

/* As `apc alarm` records it, in brackets, whatever is in it. */
static void a_reason_may_look_like_an_address(void **state)
{
    const struct apc_event told = {.time = apc_clock_utc(NULL),
                                   .severity = APC_EVENT_INFO,
                                   .kind = "operator",
                                   .source = "local",
                                   .text = "y.high: acknowledged (as told (from Max): now)"};
    (void)state;
    measured(20);
    assert_int_equal(apc_store_append_events(store, &told, 1), 1);
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1}"), 200);
    acknowledged_because("as told (from Max): now");
}

/* Promise(alarms/acknowledge-once-told) */
static void of_two_who_acknowledge_one_does_and_the_other_is_told(void **state)
{
    (void)state;
    measured(20);
    assert_int_equal(acknowledge("y.high", 1), 200);
    assert_int_equal(acknowledge("y.high", 1), 409);
    assert_string_equal(request.fault.code, "alarm");
    assert_string_equal(request.fault.message, "y.high: local has just acknowledged it");
    evaluate();
    assert_int_equal(acknowledge("y.high", 2), 409);
    assert_non_null(strstr(request.fault.message, "there is nothing to acknowledge"));
}

static void who_acknowledges_acknowledges_what_he_saw(void **state)
{
    (void)state;
    measured(20);
    measured(1); /* it has only gone: the same one */
    assert_int_equal(acknowledge("y.high", 1), 200);
    evaluate();
    assert_state(0, "Normal");
    assert_non_null(strstr(settled(), "\"state\":\"applied\""));
    measured(20);
    assert_int_equal(acknowledge("y.high", 1), 200); /* it has come again */
    evaluate();
    assert_state(0, "Unacknowledged Active");
    assert_non_null(strstr(settled(), "\"state\":\"failed\",\"stored\":true,\"reason\":\"look again\""));
    assert_int_equal(acknowledge("y.high", 99), 409);
    assert_string_equal(request.fault.code, "stale");
}

static void shelving_has_an_end_and_is_of_what_was_seen(void **state)
{
    (void)state;
    measured(20);
    assert_int_equal(shelve(9 * 3600, "", 1), 422);
    assert_string_equal(request.fault.code, "limits");
    assert_string_equal(request.fault.message, "y.high may be shelved for up to 8 h");
    assert_int_equal(shelve(-10, "", 1), 422);
    assert_string_equal(request.fault.code, "limits");
    assert_string_equal(request.fault.message, "y.high: the end of shelving is in the past");
    assert_int_equal(shelve(0, "", 1), 409); /* it is not shelved */
    assert_string_equal(request.fault.code, "alarm");
    assert_int_equal(shelve(3600, "", 0), 409);
    assert_string_equal(request.fault.code, "stale");
    assert_int_equal(shelve(3600, "", 1), 200);
    assert_true(answered("\"kind\":\"shelve\""));
    evaluate();
    assert_state(0, "Shelved, Active");
    assert_non_null(strstr(settled(), "\"state\":\"applied\""));
    json_t *until = alarm_member(0, "shelved_until");
    assert_true(json_is_number(until));
    json_decref(until);
    assert_int_equal(shelve(3600, "", 1), 409); /* who saw it before */
    assert_string_equal(request.fault.code, "stale");
    assert_int_equal(shelve(0, "", 2), 200);
    evaluate();
    assert_state(0, "Unacknowledged Active");
    assert_int_equal(shelve(3600, ",\"once\":true", 3), 200);
    evaluate();
    assert_state(0, "One-shot Shelved, Active");
}

/* Promise(page/alarm-acknowledged) */
static void what_is_out_of_service_says_nothing_until_it_is_in_again(void **state)
{
    struct apc_event event = {0};
    (void)state;
    measured(20);
    assert_int_equal(want(post_alarm_service, "y.high", "{\"out\":1,\"seq\":1}"), 400);
    assert_int_equal(want(post_alarm_service, "y.high", "{\"seq\":1}"), 400);
    assert_int_equal(want(post_alarm_service, "y.high", "{\"out\":true,\"seq\":0}"), 409);
    assert_string_equal(request.fault.code, "stale");
    assert_int_equal(want(post_alarm_service, "y.high", "{\"out\":true,\"seq\":1,\"reason\":\"no sensor\"}"),
                     200);
    assert_true(answered("\"kind\":\"service\""));
    assert_true(apc_store_events(store, NULL, last_event, &event) >= 1);
    assert_string_equal(event.text, "y.high: out of service (from 10.0.0.7): no sensor");
    evaluate();
    assert_state(0, "Out of Service, Active");
    assert_int_equal(want(post_alarm_service, "y.high", "{\"out\":false,\"seq\":2}"), 200);
    evaluate();
    assert_state(0, "Unacknowledged Active");
}

/* Promise(page/reason-goes-write) */
static void what_makes_no_sense_writes_nothing(void **state)
{
    struct apc_sample wanted = {.table = APC_OPMODE, .id = apc_alarm_switch_id(APC_ALARM_ACK, 1)};
    char body[128];
    (void)state;
    assert_int_equal(acknowledge("y.high", 0), 409); /* nobody evaluates */
    assert_non_null(strstr(request.fault.message, "apc-alarms does not run"));
    measured(20);
    assert_int_equal(acknowledge("y.hihg", 1), 404);
    assert_string_equal(request.fault.code, "alarm");
    assert_int_equal(acknowledge("y.low", 0), 409);
    assert_int_equal(want(post_alarm_ack, "y.high", "{}"), 400);
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"until\":0}"), 400);
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"key\":\"x\"}"), 400);
    assert_int_equal(want(post_alarm_shelve, "y.high", "{\"seq\":1}"), 400);
    assert_int_equal(want(post_alarm_shelve, "y.high", "{\"until\":0,\"once\":1,\"seq\":1}"), 400);
    assert_int_equal(want(post_alarm_shelve, "y.high", "{\"until\":-5,\"seq\":1}"), 400);
    snprintf(body, sizeof body, "{\"until\":%.0f.5,\"seq\":1}", apc_ns_to_s(apc_clock_utc(NULL)) + 60);
    assert_int_equal(want(post_alarm_shelve, "y.high", body), 400);
    assert_string_equal(request.fault.field, "until");
    assert_int_equal(want(post_alarm_ack, "y.high", "{\"seq\":1,\"reason\":7}"), 400);
    snprintf(body, sizeof body, "{\"seq\":1,\"reason\":\"%081d\"}", 0);
    assert_int_equal(want(post_alarm_ack, "y.high", body), 422);
    assert_string_equal(request.fault.field, "reason");
    assert_int_equal(apc_store_read(store, &wanted, 1), 0);
    assert_int_equal(wanted.seq, 0);
}

/* ---- As they are followed ------------------------------------------------------------------ */

static void no_call(void *ctx)
{
    (void)ctx;
}

/* How many alarms the newest message tells of; 0: there is none. */
static size_t told(struct stream_reader *reader)
{
    char message[4096];
    const long length = stream_read(reader, message, sizeof message - 1);
    if (length <= 0)
        return 0;
    message[length] = '\0';
    const char *data = strstr(message, "event: alarms\ndata: ");
    assert_non_null(data);
    json_t *json = json_loads(strchr(data, '{'), JSON_DISABLE_EOF_CHECK, NULL);
    const size_t n = json_array_size(json_object_get(json, "alarms"));
    assert_true(n > 0);
    json_decref(json);
    return n;
}

/* As the live thread does it, when it has read the newest tick. Returns of how many alarms readers were told. */
static size_t follow(struct alarm_watch *watch)
{
    double numbers[APC_ALARMS_TICK] = {0};
    struct apc_vector tick = {
        .table = APC_TICK, .id = ui->model.alarms.id, .value = numbers, .room = APC_ALARMS_TICK};
    struct apc_rows rows = {.size = sizeof rows, .vector = &tick, .n_vectors = 1};
    const struct stream_watcher watcher = {.session = ""};
    struct stream_reader *reader;
    bool resumed;
    assert_true(apc_store_read_rows(store, &rows) >= 0);
    assert_int_equal(stream_open(ui->stream, &watcher, NULL, no_call, no_call, NULL, &reader, &resumed), 0);
    assert_int_equal(alarm_watch_look(watch, ui, store, &tick), 0);
    const size_t n = told(reader);
    assert_int_equal(told(reader), 0);
    stream_close(reader);
    return n;
}

/* Asked twice, as the second answer may be the first one, kept. */
static void is_the_same_zipped(const char *plain)
{
    size_t n = 0;
    char *want = zip(plain, strlen(plain), 1, &n);
    assert_non_null(want);
    encoding = "gzip";
    for (int i = 0; i < 2; i++) {
        ask_nothing();
        get_plant(ui, &request, store);
        assert_true(request.zipped);
        assert_int_equal(request.reply.n, n);
        assert_memory_equal(request.reply.at, want, n);
    }
    encoding = NULL;
    ask_nothing();
    free(want);
}

static void a_zipped_plant_is_the_one_there_is_now(void **state)
{
    struct alarm_watch watch = {0};
    (void)state;
    is_the_same_zipped(ask_text(get_plant));
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    assert_non_null(strstr(ask_text(get_plant), "\"alarm\":\"y.high\""));
    is_the_same_zipped(ask_text(get_plant));
    assert_true(plant_rhythm(&ui->model.plant, "controller", 77 * S));
    assert_non_null(strstr(ask_text(get_plant), "\"period\":77"));
    is_the_same_zipped(ask_text(get_plant));
    alarm_watch_free(&watch);
}

/*
 * Promise(alarms/alarms-every-screen): Alarms are on every screen as soon as they move, the most urgent
 *   first; how they stand is in the state of each stream, and nothing is told twice.
 */
static void what_moves_is_told_once_and_is_in_the_state(void **state)
{
    struct alarm_watch watch = {0};
    (void)state;
    assert_non_null(strstr(ask_text(get_plant), ",\"alarms\":null}"));
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    const char *plant = ask_text(get_plant);
    assert_non_null(strstr(plant, ",\"alarms\":{\"shelve_max\":28800,\"all\":[{\"id\":1,\"alarm\":\"y.high\","
                                  "\"ref\":\"sensor.1\",\"limit\":10,\"kind\":\"high\",\"priority\":2,"));
    assert_int_equal(follow(&watch), 0); /* nobody has ever evaluated them */
    assert_non_null(strstr(ask_text(get_state), "\"alarms\":[],"));
    measured(1);
    assert_int_equal(follow(&watch), 0);
    measured(20);
    assert_int_equal(follow(&watch), 1);
    assert_int_equal(follow(&watch), 0);
    assert_non_null(
        strstr(ask_text(get_state),
               "\"alarms\":[{\"id\":1,\"seq\":1,\"journal\":1,\"state\":\"Unacknowledged Active\","));
    evaluate(); /* a tick without a transition */
    assert_int_equal(follow(&watch), 0);
    measured(-20);
    assert_int_equal(follow(&watch), 2);
    const char *now = ask_text(get_state);
    assert_non_null(strstr(now, "\"id\":1,\"seq\":2,\"journal\":2,\"state\":\"RTN Unacknowledged\""));
    assert_non_null(strstr(now, "\"id\":2,\"seq\":1,\"journal\":3,\"state\":\"Unacknowledged Active\""));
    alarm_watch_free(&watch);
}

/* Promise(alarms/first-out) */
static void which_came_first_is_told_when_another_one_comes(void **state)
{
    static const char marked[] = "\"first_out\":true";
    struct apc_sample low = {.table = APC_ALARM, .id = 2, .seq = 1, .value = APC_ALARM_UNACKED};
    struct alarm_watch watch = {0};
    (void)state;
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    measured(20);
    assert_int_equal(follow(&watch), 1);
    assert_null(strstr(ask_text(get_alarms), marked));
    low.time = apc_clock_utc(NULL) + S;
    assert_int_equal(apc_store_append(store, &low, 1), 1);
    watch.looked = 0; /* as after its tick */
    assert_int_equal(follow(&watch), 2);
    json_t *high = alarm_member(0, "first_out"), *other = alarm_member(1, "first_out");
    assert_true(json_is_true(high) && json_is_false(other));
    json_decref(high);
    json_decref(other);
    assert_non_null(strstr(ask_text(get_state), marked));
    alarm_watch_free(&watch);
}

/* Promise(alarms/alarms-every-screen) */
static void the_end_of_shelving_may_move_without_a_transition(void **state)
{
    struct alarm_watch watch = {0};
    (void)state;
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    measured(20);
    assert_int_equal(shelve(3600, "", 1), 200);
    evaluate();
    assert_int_equal(follow(&watch), 1);
    assert_int_equal(shelve(7200, "", 2), 200);
    evaluate();
    assert_int_equal(follow(&watch), 1);
    const char *until = strstr(ask_text(get_state), "\"shelved_until\":");
    assert_true(until && strtod(until + 16, NULL) > apc_ns_to_s(apc_clock_utc(NULL)) + 3700);
    evaluate();
    assert_int_equal(follow(&watch), 0);
    alarm_watch_free(&watch);
}

/* Promise(alarms/alarms-every-screen) */
static void who_was_described_anew_is_told_anew(void **state)
{
    struct alarm_watch watch = {0};
    (void)state;
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    measured(20);
    assert_int_equal(follow(&watch), 1);
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0);
    assert_int_equal(follow(&watch), 1);
    const unsigned before = ui->model.plant.revision;
    assert_int_equal(model_load(&ui->model, store), 0);
    assert_int_equal(ui->model.plant.revision, before);
    assert_true(apc_store_describe(store, NULL, 0, "name = \"none\"; # no alarms, and no experiment\n") >= 0);
    assert_int_equal(model_load(&ui->model, store), 0);
    assert_true(ui->model.plant.revision > before);
    assert_int_equal(alarm_watch_describe(&watch, ui, store), 0); /* what cannot be read has none */
    assert_non_null(strstr(ask_text(get_plant), ",\"alarms\":null}"));
    alarm_watch_free(&watch);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(the_list_says_how_all_alarms_stand),
        T(the_journal_gives_the_newest_in_their_order),
        T(the_journal_is_searched_and_read_page_by_page),
        T(what_is_no_range_is_refused),
        T(a_store_without_alarms_has_none),
        T(figures_count_them),
        T(settings_are_tried_on_the_record),
        T(a_zipped_plant_is_the_one_there_is_now),
        T(what_moves_is_told_once_and_is_in_the_state),
        T(which_came_first_is_told_when_another_one_comes),
        T(the_end_of_shelving_may_move_without_a_transition),
        T(who_was_described_anew_is_told_anew),
        T(metrics_count_them_while_they_are_evaluated),
        T(what_is_acknowledged_is_confirmed_and_on_record),
        T(a_reason_is_on_record),
        T(a_reason_may_look_like_an_address),
        T(of_two_who_acknowledge_one_does_and_the_other_is_told),
        T(who_acknowledges_acknowledges_what_he_saw),
        T(shelving_has_an_end_and_is_of_what_was_seen),
        T(what_is_out_of_service_says_nothing_until_it_is_in_again),
        T(what_makes_no_sense_writes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
