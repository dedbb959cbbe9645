/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Every answer of the API, to the last letter but for what the clock is: each question that can be asked of
 * one plant, right and wrong ones, each write, what is recorded of it, and what is told afterwards. Who
 * changes an answer on purpose takes the new mark from what this test says, which also shows the answer.
 */
#include "base/base_internal.h"
#include "ui_plant.h"

#include <ctype.h>

typedef void answerer(struct ui *ui, struct request *request, struct apc_store *store);

static void put_all(enum apc_table table, int id, int n, double value)
{
    for (int i = 0; i < n; i++) {
        const struct apc_sample s = {.table = table,
                                     .id = id,
                                     .seq = i + 1,
                                     .time = (1000 + i) * S,
                                     .status = i % 5 == 3 ? APC_BAD_SENSOR_FAILURE : APC_GOOD,
                                     .value = value + 0.25 * i};

        assert_int_equal(apc_store_append(store, &s, 1), 1);
    }
}

static int describe(void **state)
{
    static const struct apc_event events[] = {{.time = 1001 * S,
                                               .severity = APC_EVENT_INFO,
                                               .source = "apc-client",
                                               .kind = "start",
                                               .text = "one"},
                                              {.time = 1002 * S,
                                               .severity = APC_EVENT_WARNING,
                                               .source = "apc-plant",
                                               .kind = "overrun",
                                               .text = "two \"2\""},
                                              {.time = 1003 * S,
                                               .severity = APC_EVENT_ALARM,
                                               .source = "apc-client",
                                               .kind = "store",
                                               .text = "three, too"}};

    if (set_up(state) < 0)
        return -1;
    describe_a_shadow();
    period(S, S / 2);
    put_all(APC_SENSOR, 1, 12, 0.5);
    put_all(APC_SENSOR, 2, 9, -1.5);
    put_all(APC_ACTUATOR, 1, 12, 2.0);
    put_all(APC_SETPOINT, 1, 3, 5.0);
    put_all(APC_OPMODE, 1, 1, APC_MODE_AUTO);
    put_all(APC_OPMODE, 2, 1, APC_MODE_MAN);
    put_all(APC_MANUAL, 2, 2, 1.0);
    put_all(APC_TUNING, 1, 2, 10.0);
    put_all(APC_ESTIMATE, 1, 4, 1.0);
    assert_int_equal(apc_store_append_events(store, events, 3), 3);
    for (int i = 0; i < 4; i++) {
        put_window("base", "run", (1000 + 60 * i) * S, (uint64_t)(10 + i), 5000 + 1000 * i, (uint64_t)i);
        put_window("client", "jitter", (1010 + 60 * i) * S, 20, -300 + 200 * i, 0);
    }
    return 0;
}

/* Times of now are one word, so are keys and ids, which are drawn, and the version; the rest is what it is. */
static uint32_t mark_of(const char *text, size_t n, char *shown, size_t size)
{
    size_t used = 0;

    for (size_t i = 0; i < n && used + 8 < size;) {
        size_t digits = 0, hex = 0;

        while (i + digits < n && isdigit((unsigned char)text[i + digits]))
            digits++;
        while (i + hex < n && isxdigit((unsigned char)text[i + hex]))
            hex++;
        if (digits == 10) {
            memcpy(shown + used, "NOW", 3);
            used += 3;
            i += digits;
            if (i < n && text[i] == '.')
                for (i++; i < n && isdigit((unsigned char)text[i]);)
                    i++;
        } else if (hex >= 32 || (hex == 8 && text[i + hex] == '.')) {
            memcpy(shown + used, "KEY", 3);
            used += 3;
            i += hex;
        } else if (strncmp(text + i, apc_version(), strlen(apc_version())) == 0) {
            memcpy(shown + used, "VERSION", 7);
            used += 7;
            i += strlen(apc_version());
        } else {
            const size_t whole = hex ? hex : 1;

            for (size_t k = 0; k < whole && used + 8 < size; k++)
                shown[used++] = text[i++];
        }
    }
    shown[used] = '\0';
    return apc_hash(APC_HASH_BEGIN, shown, used);
}

static const struct asked {
    answerer *how;
    const char *query[10], *body;
    uint32_t mark;
} questions[] = {
    {get_session, {NULL}, NULL, 0x83911216},
    {get_plant, {NULL}, NULL, 0x7921eb28},
    {get_graphic, {NULL}, NULL, 0xef527b92},
    {get_state, {NULL}, NULL, 0x8885285d},
    {get_livez, {NULL}, NULL, 0x806db533},
    {get_readyz, {NULL}, NULL, 0xfcb5c7af},
    {get_history, {"var", "y1", "since", "1000", "until", "1020", "last", "50"}, NULL, 0xc5e7ef56},
    {get_history,
     {"names", "y1,u1,none,r1", "since", "1002", "until", "1009", "last", "4"},
     NULL,
     0xa23d1d12},
    {get_history, {"names", "y1,y2", "since", "1000", "until", "1016", "bins", "4"}, NULL, 0xeac5bd30},
    {get_history, {"var", "sensor.2", "last", "5", "until", "1020", "format", "csv"}, NULL, 0x5ce1e87c},
    {get_history,
     {"names", "y1,u1", "since", "1000", "until", "1020", "bins", "3", "format", "csv"},
     NULL,
     0xb794ccc4},
    {get_history, {"var", "u1", "last", "2", "since", "1000", "until", "1020"}, NULL, 0x17568127},
    {get_history, {NULL}, NULL, 0xa5862193},
    {get_history, {"var", "y1", "names", "y2"}, NULL, 0xa5862193},
    {get_history, {"var", "none"}, NULL, 0x7613633b},
    {get_history, {"var", "y1", "last", "0"}, NULL, 0xfb875fd1},
    {get_history, {"var", "y1", "bins", "100000"}, NULL, 0xc0eecf81},
    {get_history, {"var", "y1", "bins", "5", "last", "5"}, NULL, 0x62f9ed15},
    {get_history, {"var", "y1", "since", "yesterday"}, NULL, 0xe651a620},
    {get_history, {"var", "y1", "since", "1010", "until", "1000"}, NULL, 0x5f0e2d75},
    {get_history, {"var", "y1", "since", "1000", "until", "1020", "format", "xml"}, NULL, 0xe2ed558c},
    {get_events, {"since", "1000", "until", "1020"}, NULL, 0xd453c1d9},
    {get_events, {"since", "1000", "until", "1020", "severity", "2"}, NULL, 0x2cdc61b6},
    {get_events, {"since", "1000", "until", "1020", "kind", "store"}, NULL, 0x78153e4c},
    {get_events, {"since", "1000", "until", "1020", "source", "apc-client", "last", "1"}, NULL, 0xe189c999},
    {get_events, {"since", "1000", "until", "1020", "text", "2"}, NULL, 0xa23ff9b8},
    {get_events, {"severity", "4"}, NULL, 0xc8226d0c},
    {get_events, {"last", "100001"}, NULL, 0x1c32910a},
    {get_timing, {"since", "900", "until", "2000"}, NULL, 0x7e8ba8e2},
    {get_timing, {"since", "900", "until", "2000", "task", "base"}, NULL, 0x976166dc},
    {get_timing, {"since", "900", "until", "2000", "quantity", "jitter"}, NULL, 0xc3d125da},
    {get_timing, {"quantity", "haste"}, NULL, 0x1aafdccd},
    {get_timing_series,
     {"task", "base", "quantity", "run", "since", "900", "until", "2000"},
     NULL,
     0xb5bc7647},
    {get_timing_series,
     {"task", "base", "quantity", "run", "since", "900", "until", "2000", "points", "2"},
     NULL,
     0x9e47fbe3},
    {get_timing_series, {"task", "base"}, NULL, 0xe49e8edf},
    {get_timing_series, {"task", "base", "quantity", "run", "points", "0"}, NULL, 0xeb20821f},
    {get_prediction, {NULL}, NULL, 0x95ab4636},
    {get_prediction, {"at", "1005"}, NULL, 0x2ace9d86},
    {get_prediction, {"at", "soon"}, NULL, 0xfde356dc},
    {get_alarms, {NULL}, NULL, 0x95bc46bb},
    {get_alarm_journal, {"since", "1000", "until", "1020"}, NULL, 0xec5ec0eb},
    {get_alarm_figures, {"since", "1000", "until", "1020"}, NULL, 0xfd6c926d},
    {get_kpis, {"since", "1000", "until", "1012"}, NULL, 0xf9f370aa},
    {get_kpis, {"since", "1012", "until", "1000"}, NULL, 0x5f0e2d75},
    {get_writes, {NULL}, NULL, 0x0d5678ef},
    {get_writes, {"key", "not a key"}, NULL, 0x71edd16f},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":7.5,\"seq\":3,\"key\":\"a-key-of-mine-1\"}", 0xa122bc1f},
    {get_writes, {"key", "a-key-of-mine-1"}, NULL, 0x2d19ae4d},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":7.5,\"seq\":3,\"key\":\"a-key-of-mine-2\"}", 0x053bbf7f},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":101,\"seq\":4}", 0x18f9df1e},
    {post_setpoint, {NULL}, "{\"id\":9,\"value\":1,\"seq\":0}", 0xe14a8f07},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":\"much\",\"seq\":4}", 0x16833bf1},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":1}", 0xa68843cf},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":1,\"seq\":4,\"more\":1}", 0x3ca3efd3},
    {post_setpoint, {NULL}, "[1,2]", 0x8e50c447},
    {post_setpoint, {NULL}, "{\"id\":1,", 0x9370235a},
    {post_setpoint, {NULL}, "{\"id\":1,\"value\":8,\"seq\":4,\"key\":\"a key\"}", 0x00e69bce},
    {post_output,
     {NULL},
     "{\"id\":2,\"value\":3,\"seq\":2,\"key\":\"a-key-of-mine-3\",\"reason\":\"to see\"}",
     0xd06368be},
    {post_output, {NULL}, "{\"id\":1,\"value\":3,\"seq\":0}", 0x4f163c3b},
    {post_output, {NULL}, "{\"id\":2,\"value\":11,\"seq\":3}", 0x2792c4f0},
    {post_mode, {NULL}, "{\"id\":2,\"mode\":\"Auto\",\"seq\":1,\"key\":\"a-key-of-mine-4\"}", 0x5583f981},
    {post_mode, {NULL}, "{\"id\":2,\"mode\":\"Fast\",\"seq\":2}", 0x77da68e1},
    {post_mode, {NULL}, "{\"id\":2,\"mode\":\"LO\",\"seq\":2}", 0xf24226ee},
    {post_mode, {NULL}, "{\"id\":7,\"mode\":\"Man\",\"seq\":0}", 0xe25722f3},
    {post_owner, {NULL}, "{\"id\":1,\"owner\":\"remote\",\"seq\":0}", 0x68f35ece},
    {post_owner, {NULL}, "{\"id\":1,\"remote\":true,\"seq\":0}", 0xff605853},
    {post_tuning,
     {NULL},
     "{\"values\":[{\"id\":1,\"value\":11,\"seq\":2},{\"id\":2,\"value\":-5,\"seq\":0}],\"key\":\"a-key-of-"
     "mine-5\"}",
     0x5adadf2b},
    {post_tuning, {NULL}, "{\"values\":[{\"id\":1,\"value\":1001,\"seq\":3}]}", 0x7a053f49},
    {post_tuning, {NULL}, "{\"values\":[]}", 0x3f5c052c},
    {post_tuning,
     {NULL},
     "{\"values\":[{\"id\":1,\"value\":1,\"seq\":3},{\"id\":1,\"value\":2,\"seq\":3}]}",
     0xe25cc048},
    {post_alarm_ack, {NULL}, "{\"seq\":0}", 0x1fb6fc88},
    {post_alarm_shelve, {NULL}, "{\"seq\":0,\"until\":60}", 0x1fb6fc88},
    {post_alarm_service, {NULL}, "{\"seq\":0,\"out\":true}", 0x1fb6fc88},
    {get_writes, {NULL}, NULL, 0x6d86e753},
    {get_state, {NULL}, NULL, 0x8885285d},
    {get_events, {"kind", "operator"}, NULL, 0x3effc31b},
};

static void each_answer_is_the_same_to_the_last_letter(void **state)
{
    static char shown[1 << 16], all[1 << 16];
    size_t wrong = 0;
    (void)state;

    for (size_t i = 0; i < sizeof questions / sizeof *questions; i++) {
        const struct asked *q = &questions[i];
        const struct fault *f = &request.fault;
        size_t n;

        ask_nothing();
        snprintf(request.name, sizeof request.name, "y1.high");
        memcpy(query, q->query, sizeof q->query);
        if (q->body) {
            request.body = strdup(q->body);
            request.n = strlen(q->body);
        }
        ui->model.tick[0].seq =
            q->body ? 1 : 0; /* who writes finds that it ticks; who looks, that nobody ever did */
        ui->model.ticked[0] = apc_clock_mono(NULL);
        json_decref(ask(q->how));
        n = (size_t)snprintf(all, sizeof all, "%d %d %s %s %s %s %.*s\n", request.status, f->http, f->code,
                             f->field, f->message, request.type ? request.type : "", (int)request.extra.n,
                             request.extra.at ? request.extra.at : "");
        if (request.reply.n > 0 && n + request.reply.n < sizeof all) {
            memcpy(all + n, request.reply.at, request.reply.n);
            n += request.reply.n;
        }
        const uint32_t mark = mark_of(all, n, shown, sizeof shown);
        if (mark != q->mark) {
            print_message("number %zu: 0x%08x: %.900s\n", i, mark, shown);
            wrong++;
        }
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(each_answer_is_the_same_to_the_last_letter, describe, tear_down),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
