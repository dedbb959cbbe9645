/* SPDX-License-Identifier: BSD-3-Clause */
/* What becomes of writes, and what the threads beside them do, asked without a connection, on a store in
 * memory. */
#include <sys/stat.h>
#include <unistd.h>

#include "figures/figures.h"
#include "ui_plant.h"

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

/*
 * Promise(page/reason-goes-write): A reason goes with a write into the record, and with no other; one too
 *   long is refused before anything is written.
 */
static void a_reason_is_on_record_with_every_kind_of_write(void **state)
{
    static const struct {
        void (*how)(struct ui *, struct request *, struct apc_store *);
        const char *body, *text;
    } cases[] = {
        {post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"reason\":\"pump 2 is tested\"}",
         "r1: 5 -> 6 (from 10.0.0.7): pump 2 is tested"},
        {post_mode, "{\"id\":2,\"mode\":\"Man\",\"seq\":1,\"reason\":\"as well\"}",
         "u2 mode: Auto -> Man (from 10.0.0.7): as well"},
        {post_output, "{\"id\":2,\"value\":1,\"seq\":0,\"reason\":\"by hand\"}",
         "u2: no value yet -> 1 (from 10.0.0.7): by hand"},
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
    assert_string_equal(newest_text(), "r2: no value yet -> -3 (from 10.0.0.7)");
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    json_decref(post(post_mode, "{\"id\":2,\"mode\":\"Man\",\"seq\":1}"));
    assert_string_equal(newest_text(), "u2 mode: Auto -> Man (from 10.0.0.7)");
}

static void limits_are_inclusive_and_their_refusal_names_them(void **state)
{
    int64_t seq;
    (void)state;
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":100,\"seq\":0}"), 0);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":-100,\"seq\":1}"), 0);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":100.001,\"seq\":2}"), 422);
    assert_string_equal(request.fault.message, "r1 = 100.001 lies outside its limits -100 to 100");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":-100.001,\"seq\":2}"), 422);
    assert_string_equal(request.fault.message, "r1 = -100.001 lies outside its limits -100 to 100");
    assert_near(in_force(APC_SETPOINT, 1, &seq), -100, 0);
    assert_int_equal(seq, 2);
    put(APC_OPMODE, 1, APC_MODE_MAN);
    /* an output has the limits of its actuator */
    ui->model.plant.tag[find_plant_tag(&ui->model.plant, APC_MANUAL, 1)].high = 1e6;
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":10.5,\"seq\":0}"), 422);
    assert_int_equal(refused(post_output, "{\"id\":1,\"value\":10,\"seq\":0}"), 0);
    /* and where there is none, what no store takes */
    ui->model.plant.tag[find_plant_tag(&ui->model.plant, APC_SETPOINT, 2)].high = APC_VALUE_MAX;
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
    assert_string_equal(newest_text(), "r1: no value yet -> -100 (from 10.0.0.7)");
    assert_int_equal(refused(post_output, "{\"id\":3,\"value\":-101,\"seq\":1}"), 422);
}

/* Promise(server/loops-their-controllers) */
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
    assert_string_equal(request.fault.message, "u2 cannot be in Cas: no controller moves its setpoint");
    assert_int_equal(refused(post_mode, "{\"id\":1,\"mode\":\"Cas\",\"seq\":0}"), 0);
    assert_int_equal(refused(post_mode, "{\"id\":1,\"mode\":\"IMan\",\"seq\":1}"),
                     422); /* nobody can ask for it */
    assert_int_equal(refused(post_mode, "{\"mode\":\"Man\",\"seq\":0}"), 400);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_true(refused(post_mode, wrong[i]) >= 400);
}

/* Promise(server/loops-their-controllers) */
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
    assert_string_equal(newest_text(), "r1 taken Local, cascade open (from 10.0.0.7)");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":8,\"seq\":2}"),
                     409); /* it is his: he has to look */
    put(APC_OPMODE, 1, APC_MODE_MAN);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":8,\"seq\":3}"), 409);
    assert_string_equal(request.fault.message, "r1 follows y1 while u1 is in Man");
    assert_near(in_force(APC_OPMODE, 1, &seq), APC_MODE_MAN, 0);      /* which stays */
    write = post(post_mode, "{\"id\":1,\"mode\":\"Cas\",\"seq\":3}"); /* takes what is in force along */
    changes = json_object_get(write, "changes");
    assert_int_equal(json_array_size(changes), 2);
    assert_string_equal(json_string_value(json_object_get(json_array_get(changes, 1), "ref")), "setpoint.1");
    json_decref(write);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 7, 0);
    assert_int_equal(seq, 4);
}

/* r2 is the scheduler's. */
/*
 * Promise(server/setpoint-operator-took): A setpoint that an operator took from the scheduler is Local on
 *   the page, and given back there; it is applied once the scheduler has written the step that is due.
 */
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
    ticked(0, 0);
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

/* Promise(modes/undo) */
static void ones_last_write_is_undone_by_its_time_once(void **state)
{
    char body[200];
    int64_t seq;
    (void)state;
    put(APC_SETPOINT, 1, 5);
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    assert_int_equal(refused(post_undo, "{}"), 400);
    assert_int_equal(refused(post_undo, "{\"time\":-1}"), 422);
    assert_int_equal(refused(post_undo, "{\"time\":77.5}"), 409);
    assert_string_equal(request.fault.code, "undo");
    json_t *write = post(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1}");
    snprintf(body, sizeof body, "{\"time\":%.6f,\"key\":\"a-key-of-undo\",\"reason\":\"too much\"}",
             json_number_value(json_object_get(write, "time")));
    json_decref(write);
    for (int i = 0; i < 2; i++) { /* asked twice it is done once, and told twice */
        write = post(post_undo, body);
        assert_int_equal(request.fault.http, 0);
        assert_string_equal(json_string_value(json_object_get(write, "kind")), "undo");
        assert_near(in_force(APC_SETPOINT, 1, &seq), 5, 0);
        assert_int_equal(seq, 3);
        json_decref(write);
    }
    assert_string_equal(newest_text(), "r1: 6 -> 5 (undo) (from 10.0.0.7): too much");
    put(APC_TUNING, 1, 10);
    write = post(post_tuning, "{\"values\":[{\"id\":1,\"value\":11,\"seq\":1}]}");
    snprintf(body, sizeof body, "{\"time\":%.6f}", json_number_value(json_object_get(write, "time")));
    json_decref(write);
    request.session.role = ROLE_OPERATOR; /* who is no engineer any more */
    assert_int_equal(refused(post_undo, body), 403);
    request.session.role = ROLE_ENGINEER;
    assert_int_equal(refused(post_undo, body), 0);
    assert_near(in_force(APC_TUNING, 1, &seq), 10, 0);
}

/* Promise(run/values-taken-again) */
static void what_was_set_then_is_shown_and_written_as_it_was_shown(void **state)
{
    static const char shown[] =
        "{\"at\":2.5,\"seen\":{\"setpoint.1\":2,\"tuning.1\":2},\"key\":\"a-key-of-then\"}";
    int64_t seq;
    (void)state;
    put(APC_SETPOINT, 1, 5);
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    put(APC_TUNING, 1, 10);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1}"), 0);
    assert_int_equal(refused(post_tuning, "{\"values\":[{\"id\":1,\"value\":11,\"seq\":1}]}"), 0);
    const char *const then[] = {"at", "2.5", "names", "r1,u1"};
    memcpy(query, then, sizeof then);
    json_t *differs = ask(get_retake);
    char *said = json_dumps(json_object_get(differs, "changes"), 0);
    assert_has(said, "\"from\": 6, \"to\": 5, \"seq\": 2}");
    free(said);
    json_decref(differs);
    memset(query, 0, sizeof query);
    assert_int_equal(refused(get_retake, ""), 400);
    assert_int_equal(refused(post_retake, "{\"seen\":{}}"), 400);
    assert_int_equal(refused(post_retake, "{\"at\":2.5}"), 400);
    assert_int_equal(refused(post_retake, "{\"at\":-1,\"seen\":{}}"), 422);
    assert_int_equal(refused(post_retake, "{\"at\":0.5,\"seen\":{}}"), 422);
    assert_has(request.fault.message, "nothing that people set is on record");
    assert_int_equal(refused(post_retake, "{\"at\":2.5,\"names\":\"q\",\"seen\":{}}"), 404);
    assert_int_equal(refused(post_retake, "{\"at\":2.5,\"seen\":{\"setpoint.1\":2}}"), 409);
    assert_int_equal(refused(post_retake, "{\"at\":2.5,\"seen\":{\"setpoint.1\":2,\"tuning.1\":1}}"), 409);
    assert_string_equal(request.fault.code, "stale");
    request.session.role = ROLE_OPERATOR;
    assert_int_equal(refused(post_retake, shown), 403); /* tuning is among it */
    assert_near(in_force(APC_SETPOINT, 1, &seq), 6, 0);
    request.session.role = ROLE_ENGINEER;
    for (int i = 0; i < 2; i++) { /* asked twice it is done once, and told twice */
        json_t *write = post(post_retake, shown);
        assert_int_equal(request.fault.http, 0);
        assert_string_equal(json_string_value(json_object_get(write, "kind")), "retake");
        assert_int_equal(json_array_size(json_object_get(write, "changes")), 2);
        json_decref(write);
        assert_near(in_force(APC_SETPOINT, 1, &seq), 5, 0);
        assert_int_equal(seq, 3);
        assert_near(in_force(APC_TUNING, 1, &seq), 10, 0);
    }
    assert_has(newest_text(), ": 11 -> 10 (as of 1970-01-01T00:00:02.5");
    assert_has(newest_text(), " (from 10.0.0.7)");
    assert_int_equal(refused(post_retake, "{\"at\":2.5,\"seen\":{}}"), 422);
    assert_has(request.fault.message, "nothing differs");
}

/* Promise(page/log-book) */
static void what_is_entered_in_the_log_book_is_an_event(void **state)
{
    char body[200];
    (void)state;
    for (int i = 0; i < 2; i++) { /* pressed twice */
        json_t *entry = post(post_log, "{\"text\":\"cleaned\",\"signal\":\"r1\"}");
        assert_int_equal(request.fault.http, 0);
        assert_string_equal(json_string_value(json_object_get(entry, "text")), "r1: cleaned");
        json_decref(entry);
    }
    assert_string_equal(newest_text(), "r1: cleaned");
    assert_string_equal(newest.kind, "log");
    assert_string_equal(newest.source, "local");
    assert_int_equal(refused(post_log, "{}"), 400);
    assert_int_equal(refused(post_log, "{\"text\":\"\"}"), 422);
    assert_int_equal(refused(post_log, "{\"text\":\"x\",\"signal\":\"q\"}"), 404);
    assert_int_equal(refused(post_log, "{\"text\":\"x\",\"seen\":0}"), 400);
    assert_int_equal(refused(post_log, "{\"text\":\"x\",\"sign\":true}"), 400);
    assert_int_equal(refused(post_log, "{\"text\":\"x\",\"sign\":true,\"seen\":-1}"), 422);
    assert_int_equal(refused(post_log, "{\"text\":\"x\",\"sign\":true,\"seen\":0}"), 409);
    assert_string_equal(request.fault.code, "stale");
    snprintf(body, sizeof body, "{\"text\":\"taken over\",\"sign\":true,\"seen\":%.6f}",
             (double)newest.time / 1e9);
    assert_int_equal(refused(post_log, body), 0);
    assert_string_equal(newest_text(), "taken over");
    assert_string_equal(newest.kind, "handover");
}

static void a_plant_whose_time_is_real_has_no_speed(void **state)
{
    (void)state;
    assert_int_equal(refused(post_speed, "{\"speed\":10}"), 409);
    assert_string_equal(request.fault.code, "simulation");
    assert_int_equal(refused(post_speed, "{\"speed\":null}"), 409);
    assert_int_equal(refused(post_speed, "{\"speed\":0,\"steps\":1}"), 409);
    assert_int_equal(refused(post_speed, "{\"speed\":1000.5}"), 422);
    assert_int_equal(refused(post_speed, "{\"speed\":1,\"steps\":1}"), 422);
    assert_int_equal(refused(post_speed, "{\"speed\":\"max\"}"), 422);
    assert_int_equal(refused(post_speed, "{\"speed\":0,\"steps\":1001}"), 400);
    assert_int_equal(refused(post_speed, "{}"), 400);
}

/* Promise(modes/ramp) */
static void a_ramp_begins_where_it_is_and_is_stopped(void **state)
{
    int64_t seq;
    (void)state;
    put(APC_SETPOINT, 1, 5);
    put(APC_OPMODE, 2, APC_MODE_AUTO);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"over\":0}"), 422);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"over\":\"long\"}"), 422);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"stop\":false}"), 400);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"stop\":true,\"value\":6}"), 400);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"stop\":true}"), 409);
    assert_string_equal(request.fault.code, "ramp");
    assert_string_equal(request.fault.message, "r1 is on no ramp: there is nothing to stop");
    json_t *write =
        post(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"over\":10,\"key\":\"a-key-of-a-ramp\"}");
    const json_t *change = json_array_get(json_object_get(write, "changes"), 0);
    assert_near(json_number_value(json_object_get(change, "to")), 6, 0);
    assert_near(json_number_value(json_object_get(change, "over")), 10, 0);
    json_decref(write);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 5, 0);
    assert_int_equal(seq, 2);
    assert_near(in_force(APC_SETPOINT, LOOPS_RAMP(1), &seq), 6, 0);
    assert_near(in_force(APC_SETPOINT, LOOPS_RATE(1), &seq), 0.1, 1e-15);
    assert_has(newest_text(), "r1: 5 -> 6 over 10 s");
    assert_int_equal(
        refused(post_setpoint, "{\"id\":1,\"value\":6,\"seq\":1,\"over\":11,\"key\":\"a-key-of-a-ramp\"}"),
        422);
    put(APC_SETPOINT, 1, 5.5); /* by its mover */
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"stop\":true}"), 0);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 5.5, 0);
    assert_near(in_force(APC_SETPOINT, LOOPS_RATE(1), &seq), 0, 0);
    assert_has(newest_text(), "r1: stopped at 5.5");
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":9,\"seq\":4,\"over\":10}"), 0);
    put(APC_SETPOINT, 1, 6); /* while it moves there is no newest row that an operator could know */
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":7,\"seq\":4}"), 0);
    assert_near(in_force(APC_SETPOINT, 1, &seq), 7, 0);
    assert_near(in_force(APC_SETPOINT, LOOPS_RATE(1), &seq), 0, 0);
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
        422);
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

/*
 * Promise(server/key-stands-write)
 * Promise(page/write-not-come)
 */
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
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":4,\"seq\":1,\"key\":\"one-two-three\"}"),
                     422);
    assert_string_equal(request.fault.field, "key"); /* it is not what was asked for with it */
    json_t *again = post(post_setpoint, "{\"id\":1,\"value\":3,\"seq\":1,\"key\":\"one-two-three\"}");
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
    ui->writing = 1; /* it may be the one that waits */
    json_decref(ask(get_writes));
    assert_int_equal(request.fault.http, 503);
    ui->writing = 0;
    json_decref(ask(get_writes));
    assert_int_equal(request.fault.http, 404);
    assert_int_equal(refused(post_setpoint, "{\"id\":1,\"value\":3,\"seq\":1,\"key\":\"short\"}"), 400);
}

/* Promise(server/status-codes) */
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
    ui_stop(ui);
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
    ui_stop(ui);
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
    ui_stop(ui);
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
    ui_stop(ui);
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

static int set_up_ticking(void **state)
{
    const int rc = set_up(state);
    if (rc == 0) {
        ticked(0, 0);
        ticked(1, 0);
    }
    return rc;
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up_ticking, tear_down)
    const struct CMUnitTest tests[] = {
        T(what_daemons_report_is_known_within_a_look),
        T(newest_values_reach_the_stream_and_settle_writes),
        T(the_record_shows_every_digit),
        T(a_reason_is_on_record_with_every_kind_of_write),
        T(what_had_no_value_and_what_is_a_mode_are_recorded_in_words),
        T(limits_are_inclusive_and_their_refusal_names_them),
        T(an_output_is_the_operators_in_man_only),
        T(a_mode_is_written_to_its_loop_and_no_other),
        T(a_setpoint_that_the_loop_above_moves_is_taken_local_and_that_is_said),
        T(a_setpoint_that_was_taken_is_given_back_to_the_scheduler),
        T(ones_last_write_is_undone_by_its_time_once),
        T(what_was_set_then_is_shown_and_written_as_it_was_shown),
        T(what_is_entered_in_the_log_book_is_an_event),
        T(a_plant_whose_time_is_real_has_no_speed),
        T(a_ramp_begins_where_it_is_and_is_stopped),
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
