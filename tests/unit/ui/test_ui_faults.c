/* SPDX-License-Identifier: BSD-3-Clause */
/* What the API answers, and what is on record, when the store does not do what it is asked for: asked without
 * a connection, on a store in memory of which one call fails.
 */
#include "experiment/experiment.h"
#include "shareddata/shareddata_internal.h"
#include "ui_request.h"

static const char text[] =
    "name = \"faults\"; duration = 10.0;\n"
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0;\n"
    "                   alarms = ( { kind = \"high\"; limit = 10.0; priority = 2; } ); } );\n"
    "setpoints = ( { name = \"r\"; low = 0.0; high = 100.0; initial = 5.0; } );\n"
    "outputs = ( { name = \"u\"; low = -100.0; high = 100.0; } );\n"
    "plant = { model = \"first-order\"; period = 0.2; };\n"
    "client = { period = 0.5; };\n"
    "alarms = { period = 60.0; };\n"
    "controller = { law = \"pi\"; period = 2.0; tuning = ( { Kp = 0.2; tau_i = 10.0; } ); };\n";

static struct apc_alarms *alarms;

typedef void (*handler)(struct ui *, struct request *, struct apc_store *);

/* The status of the answer. */
static int ask(handler handle, const char *body)
{
    ask_nothing();
    snprintf(request.name, sizeof request.name, "y.high");
    request.body = strdup(body);
    request.n = strlen(body);
    handle(ui, &request, store);
    return request.fault.http ? request.fault.http : 200;
}

static bool is_in(const struct text *t, const char *part)
{
    return t->n > 0 && memmem(t->at, t->n, part, strlen(part)) != NULL;
}

/* ---- A store of which a call fails --------------------------------------------------------------------- */

static const struct apc_store_ops *real;
static struct apc_store_ops faulty;
static int error;

static int fails(struct apc_store *s)
{
    return apc_fail(&s->why, error, "as it was told to");
}

static int fail_plain(struct apc_store *s)
{
    return fails(s);
}

static int fail_samples(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    (void)samples, (void)n;
    return fails(s);
}

static int fail_rows(struct apc_store *s, struct apc_rows *rows)
{
    (void)rows;
    return fails(s);
}

static int fail_author(struct apc_store *s, const char *name)
{
    (void)name;
    return fails(s);
}

static int fail_name(struct apc_store *s, uint32_t number, char name[APC_AUTHOR_LEN])
{
    (void)number;
    memcpy(name, "half", 5);
    return fails(s);
}

static int fail_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                        apc_sample_fn fn, void *ctx)
{
    (void)table, (void)id, (void)range, (void)fn, (void)ctx;
    return fails(s);
}

static int fail_catalogue(struct apc_store *s, char *to, size_t size, int64_t *revision)
{
    (void)to, (void)size, (void)revision;
    return fails(s);
}

static int is_one(struct apc_store *s)
{
    (void)s;
    return 1;
}

enum call { CONNECT = 1, READ, SWAP, ROWS, AUTHOR, NAME, HISTORY, CATALOGUE, IS_HISTORY, ONE };

static void let_fail(enum call call, int with)
{
    faulty = *real;
    error = with;
    switch (call) {
    case CONNECT:
        faulty.connect = fail_plain;
        break;
    case READ:
        faulty.read = fail_samples;
        break;
    case SWAP:
        faulty.swap = faulty.put = fail_samples;
        break;
    case ROWS:
        faulty.read_rows = fail_rows;
        break;
    case AUTHOR:
        faulty.author = fail_author;
        break;
    case NAME:
        faulty.author_name = fail_name;
        break;
    case HISTORY:
        faulty.history = fail_history;
        break;
    case CATALOGUE:
        faulty.catalogue = fail_catalogue;
        break;
    case IS_HISTORY:
        faulty.is_history = fail_plain;
        break;
    case ONE:
        faulty.is_history = is_one;
    }
    store->ops = &faulty;
}

/* ---- The plant ------------------------------------------------------------------------------- */

/* As apc-alarms does it. */
static void evaluate(double y)
{
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    struct apc_sample s = {.table = APC_SENSOR, .id = 1};
    assert_true(apc_store_read(store, &s, 1) >= 0);
    s = (struct apc_sample){.table = APC_SENSOR, .id = 1, .seq = s.seq + 1, .time = now.utc, .value = y};
    assert_int_equal(apc_store_append(store, &s, 1), 1);
    assert_true(apc_store_read_rows(store, apc_alarms_in(alarms)) >= 0);
    (void)apc_alarms_compute(alarms, now, NULL);
    assert_true(apc_store_append_rows(store, apc_alarms_out(alarms)) >= 0);
    apc_alarms_stored(alarms);
}

static int set_up(void **state)
{
    const struct experiment_source source = {.file = "test", .text = text};
    struct experiment e;
    struct apc_error why;
    (void)state;
    if (!ui_made("mem:ui-faults"))
        return -1;
    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        provision(store, &e, PROVISION_KEEP) < 0 || module_alarms(&e, &alarms, &why) < 0)
        fail_msg("%s", why.text);
    experiment_free(&e);
    if (model_load(&ui->model, store) < 0)
        return -1;
    ui->model.tick[0].seq = 1;
    ui->model.ticked[0] = apc_clock_mono(NULL);
    evaluate(20);
    real = store->ops;
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    store->ops = real;
    apc_alarms_destroy(alarms);
    ui_gone();
    return 0;
}

/* ---- Writes ---------------------------------------------------------------------------------- */

static char shelving[64];
static const struct writing {
    handler post;
    const char *body, *name; /* body: but for its key */
} writings[] = {{post_setpoint, "\"id\":1,\"value\":6,\"seq\":1", "r"},
                {post_mode, "\"id\":1,\"mode\":\"Man\",\"seq\":1", "u"},
                {post_tuning, "\"values\":[{\"id\":1,\"value\":0.3,\"seq\":1}]", "Kp"},
                {post_alarm_ack, "\"seq\":1", "y.high"},
                {post_alarm_shelve, shelving, "y.high"}};

/* With a key of its own each time. */
static int write_one(const struct writing *w)
{
    static int number;
    char body[200];
    snprintf(shelving, sizeof shelving, "\"until\":%.0f,\"seq\":1", apc_ns_to_s(apc_clock_utc(NULL)) + 3600);
    snprintf(body, sizeof body, "{%s,\"key\":\"key-%05d\"}", w->body, ++number);
    ui->sessions.local.writes_due = 0;
    return ask(w->post, body);
}

static int last_event(void *ctx, const struct apc_event *event)
{
    memcpy(ctx, event, sizeof *event);
    return 0;
}

static int count(void *ctx, const struct apc_event *event)
{
    (void)event;
    ++*(size_t *)ctx;
    return 0;
}

static size_t on_record(void)
{
    const struct apc_range all = {.since = 0};
    size_t n = 0;
    assert_true(apc_store_events(store, &all, count, &n) >= 0);
    return n;
}

/* Promise(server/status-codes) */
static void what_the_store_does_not_do_is_said_and_nothing_more_is_known_than_it_says(void **state)
{
    static const struct {
        enum call call;
        int error, http, alarm_http;
        const char *code, *message, *state; /* of the write, where it had begun */
    } cases[] = {
        {CONNECT, APC_ECONN, 503, 0, "store", "the database is offline: as it was told to", "failed"},
        {READ, APC_ECONN, 503, 0, "store", "the database is offline: as it was told to", "failed"},
        {AUTHOR, APC_ECONN, 503, 503, "store", "the database is offline: as it was told to", "failed"},
        {AUTHOR, APC_ENOMEM, 503, 503, "store", "the database is offline: out of memory", "failed"},
        {IS_HISTORY, APC_ECONN, 503, 503, "store", "the database is offline: as it was told to", "failed"},
        {ONE, 0, 503, 503, "store", "the database is a history, which no loop reads", "failed"},
        {SWAP, APC_ECONN, 504, 504, "unknown", "whether it was written is not known", "unknown"},
        {SWAP, APC_ETIMEDOUT, 504, 504, "unknown", "whether it was written is not known", "unknown"},
        {SWAP, APC_EPERM, 503, 503, "store", "the database refused it: as it was told to", "failed"},
        {SWAP, APC_ECONFLICT, 409, 409, "stale", "", "failed"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for (size_t k = 0; k < sizeof writings / sizeof *writings; k++) {
            const bool alarm = k >= 3, unknown = !strcmp(cases[i].state, "unknown");
            const int expected = alarm ? cases[i].alarm_http : cases[i].http;
            const size_t before = on_record(), waiting = ui->audit.waiting;
            struct text all = {0};
            char is[64];
            if (!expected)
                continue;
            let_fail(cases[i].call, cases[i].error);
            const int http = write_one(&writings[k]);
            store->ops = real;
            if (http != expected || strcmp(request.fault.code, cases[i].code) != 0 ||
                !strstr(request.fault.message, cases[i].message))
                fail_msg("case %zu of %zu: %d %s: %s", i, k, http, request.fault.code, request.fault.message);
            /* the newest of all writes is this one, and how it ended */
            writes_json(ui->writes, NULL, &all);
            text_put(&all, "", 1);
            snprintf(is, sizeof is, "\"state\":\"%s\",\"stored\":%s,", cases[i].state,
                     unknown ? "null" : "false");
            const char *newest = all.at;
            for (const char *next; (next = strstr(newest + 1, "{\"key\":")) != NULL;)
                newest = next;
            assert_has(newest, is);
            assert_has(newest, request.fault.message);
            text_free(&all);
            /* its outcome goes along where it is not known, and only then it is put on record */
            assert_int_equal(is_in(&request.extra, "\"write\":{\"key\":"), unknown);
            assert_int_equal(on_record(), before);
            assert_int_equal(ui->audit.waiting, waiting + unknown);
            if (unknown) {
                assert_has(ui->audit.event[waiting].text, writings[k].name);
                assert_has(ui->audit.event[waiting].text, ", outcome unknown (from 10.0.0.7)");
            }
            assert_int_equal(audit_flush(ui, store), 0);
        }
    }
}

static void who_was_slower_is_told_what_is_there(void **state)
{
    (void)state;
    let_fail(SWAP, APC_ECONFLICT);
    assert_int_equal(write_one(&writings[2]), 409);
    assert_string_equal(request.fault.message, "Kp was changed meanwhile: it is 0.2 now");
    assert_true(is_in(&request.extra, "\"current\":{\"tuning.1\":"));
    assert_int_equal(write_one(&writings[3]), 409);
    assert_string_equal(request.fault.message,
                        "y.high: another user changed it first, and nothing was written: look again");
}

static void the_seq_of_a_write_is_told_when_it_has_one(void **state)
{
    (void)state;
    assert_int_equal(write_one(&writings[0]), 200);
    assert_true(is_in(&request.reply, "\"from\":5,\"to\":6,\"seq\":2}"));
    assert_int_equal(on_record(), 1);
    struct apc_event event = {.severity = APC_EVENT_ALARM};
    assert_true(apc_store_events(store, &(struct apc_range){.last = 1}, last_event, &event) >= 0);
    assert_string_equal(event.text, "r: 5 -> 6 (from 10.0.0.7)");
}

static void a_write_that_is_under_way_is_not_begun_again(void **state)
{
    struct change change = {.after = {.table = APC_SETPOINT, .id = 1}};
    const struct write same = {.key = "same-key", .n = 1, .change = &change};
    struct text t = {0};
    (void)state;
    assert_int_equal(writes_begin(ui->writes, &same, &t), 0);
    for (size_t k = 0; k < sizeof writings / sizeof *writings; k++) {
        char body[200];
        snprintf(body, sizeof body, "{%s,\"key\":\"same-key\"}", writings[k].body);
        assert_int_equal(ask(writings[k].post, body), 503);
        assert_string_equal(request.fault.code, "busy");
        assert_string_equal(request.fault.field, "key");
        assert_string_equal(request.fault.message,
                            "this very write is under way already: ask what becomes of it");
    }
    text_free(&t);
}

/* A second is as long as it takes for WRITE_RATE of them. */
static void who_writes_too_often_is_told_when_to_come_back(void **state)
{
    (void)state;
    for (size_t k = 0; k < sizeof writings / sizeof *writings; k++) {
        char body[200];
        const size_t before = on_record();
        snprintf(body, sizeof body, "{%s}", writings[k].body);
        ui->sessions.local.writes_due = apc_clock_mono(NULL) + 3600 * S;
        assert_int_equal(ask(writings[k].post, body), 429);
        assert_string_equal(request.fault.code, "rate");
        assert_true(request.retry_after > 3000 * S && request.retry_after <= 3600 * S);
        assert_int_equal(on_record(), before);
    }
}

static void a_tuning_is_a_list_of_values_each_once(void **state)
{
    static const struct {
        const char *body, *message;
        int http;
    } cases[] = {{"{}", "\"values\" must be an array that is not empty", 400},
                 {"{\"values\":[]}", "\"values\" must be an array that is not empty", 400},
                 {"{\"values\":[1]}", "\"values\" must hold objects", 400},
                 {"{\"values\":[{\"id\":1,\"value\":0.3,\"seq\":1},{\"id\":1,\"value\":0.4,\"seq\":1}]}",
                  "Kp is given twice", 422},
                 {"{\"values\":[{\"id\":99,\"value\":0.3,\"seq\":1}]}",
                  "tuning.99 is not described, so its limits are not known", 404},
                 {"{\"values\":[{\"id\":4294967297,\"value\":0.3,\"seq\":1}]}",
                  "\"id\" must be a whole number from 0 to 2147483647", 400},
                 {"{\"values\":[{\"id\":1,\"value\":0.3,\"seq\":1,\"mode\":1}]}", "mode", 400},
                 {"{\"values\":[{\"id\":1,\"value\":0.3}]}", "seq", 400}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(ask(post_tuning, cases[i].body), cases[i].http);
        assert_has(request.fault.message, cases[i].message);
    }
}

/* ---- Reads ----------------------------------------------------------------------------------- */

static void alarms_that_cannot_be_read_are_not_answered(void **state)
{
    static const handler reads[] = {get_alarms, get_alarm_journal, get_alarm_figures};
    (void)state;
    for (size_t i = 0; i < sizeof reads / sizeof *reads; i++) {
        assert_int_equal(ask(reads[i], ""), 200);
        let_fail(ROWS, APC_ECONN);
        assert_int_equal(ask(reads[i], ""), 503);
        assert_string_equal(request.fault.message, "the database is offline: as it was told to");
        let_fail(ROWS, APC_EPERM);
        assert_int_equal(ask(reads[i], ""), 503);
        assert_string_equal(request.fault.message, "as it was told to");
        assert_int_equal(request.reply.n, 0);
        let_fail(CATALOGUE, APC_ECONN);
        assert_int_equal(ask(reads[i], ""), 503);
        assert_int_equal(request.reply.n, 0);
        let_fail(HISTORY, APC_ECONN);
        assert_int_equal(ask(reads[i], ""), reads[i] == get_alarms ? 200 : 503);
        store->ops = real;
    }
}

static void who_is_not_known_by_name_has_none(void **state)
{
    (void)state;
    snprintf(ui->sessions.local.user, sizeof ui->sessions.local.user, "ann");
    assert_int_equal(write_one(&writings[3]), 200);
    evaluate(20);
    assert_int_equal(ask(get_alarms, ""), 200);
    assert_true(is_in(&request.reply, "\"author\":\"ann\""));
    let_fail(NAME, APC_ECONN);
    assert_int_equal(ask(get_alarms, ""), 200);
    assert_true(is_in(&request.reply, "\"author\":null"));
    assert_false(is_in(&request.reply, "half"));
}

static void a_plant_that_nobody_has_read_yet_is_not_described(void **state)
{
    (void)state;
    assert_int_equal(ask(get_plant, ""), 200);
    ui->model.plant.revision = 0;
    assert_int_equal(ask(get_plant, ""), 503);
    assert_string_equal(request.fault.message, "the database has not been reached yet");
    assert_int_equal(request.reply.n, 0);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(what_the_store_does_not_do_is_said_and_nothing_more_is_known_than_it_says),
        T(who_was_slower_is_told_what_is_there),
        T(the_seq_of_a_write_is_told_when_it_has_one),
        T(a_write_that_is_under_way_is_not_begun_again),
        T(who_writes_too_often_is_told_when_to_come_back),
        T(a_tuning_is_a_list_of_values_each_once),
        T(alarms_that_cannot_be_read_are_not_answered),
        T(who_is_not_known_by_name_has_none),
        T(a_plant_that_nobody_has_read_yet_is_not_described),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
