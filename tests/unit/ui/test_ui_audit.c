/* SPDX-License-Identifier: BSD-3-Clause */
/* Rows of what was done and of what was refused, on a store in memory. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc-ui/ui.h"
#include "check.h"

#define MOST 600

static struct ui *ui;
static struct apc_store *store;
static struct apc_event events[MOST];
static size_t n;

static int set_up(void **state)
{
    (void)state;
    ui = calloc(1, sizeof *ui);
    return ui && audit_init(&ui->audit) == 0 &&
                   apc_log_create(&ui->log, STDERR_FILENO, "test", APC_LOG_ERROR) == 0 &&
                   apc_store_open(&store, "mem:", NULL, NULL) == 0 && apc_store_init(store) >= 0
               ? 0
               : -1;
}

static int tear_down(void **state)
{
    (void)state;
    apc_store_close(store);
    apc_log_destroy(ui->log);
    audit_free(&ui->audit);
    free(ui);
    return 0;
}

static int take(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    assert_true(n < MOST);
    events[n++] = *event;
    return 0;
}

static size_t count(const char *source)
{
    size_t found = 0;
    n = 0;
    assert_true(apc_store_events(store, &(struct apc_range){0}, take, NULL) >= 0);
    for (size_t i = 0; i < n; i++)
        found += !strcmp(events[i].source, source);
    return found;
}

static struct apc_event event_of(const char *source)
{
    struct apc_event event = {
        .time = APC_NS_PER_S, .severity = APC_EVENT_INFO, .kind = "operator", .text = "x"};
    snprintf(event.source, sizeof event.source, "%s", source);
    return event;
}

static void what_the_store_does_not_take_waits_for_it(void **state)
{
    struct apc_event first = event_of("first"), second = event_of("second");
    (void)state;
    audit(ui, NULL, &first);
    audit(ui, store, &second);
    assert_int_equal(count("first"), 0);
    assert_int_equal(count("second"), 1);
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("first"), 1);
    assert_int_equal(audit_flush(ui, store), 0); /* once */
    assert_int_equal(count("first"), 1);
}

static void as_many_wait_as_there_is_room_for(void **state)
{
    struct apc_event event = event_of("many");
    (void)state;
    for (int i = 0; i < 300; i++)
        audit(ui, NULL, &event);
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("many"), 256);
    audit(ui, NULL, &event); /* there is room again */
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("many"), 257);
}

static void a_refusal_says_who_whence_what_and_why(void **state)
{
    (void)state;
    audit_refusal(ui, "otto", "10.0.0.7", "/api/setpoint", "otto is an observer");
    audit_refusal(ui, "", "10.0.0.8", "/api/mode", "please log in");
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("otto"), 1);
    assert_string_equal(events[0].text, "refused: /api/setpoint from 10.0.0.7: otto is an observer");
    assert_string_equal(events[0].kind, "access");
    assert_int_equal(events[0].severity, APC_EVENT_WARNING);
    assert_string_equal(events[1].source, "(stranger)");
    assert_string_equal(events[1].text, "refused: /api/mode from 10.0.0.8: please log in");
}

/* Promise(server/every-write-every) */
static void a_flood_of_refusals_leaves_a_few_rows_and_its_number(void **state)
{
    (void)state;
    for (int i = 0; i < 1000; i++)
        audit_refusal(ui, "otto", "10.0.0.7", "/api/setpoint", "no");
    audit_refusal(ui, "anna", "10.0.0.9", "/api/setpoint", "other"); /* is not hidden by it */
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("otto"), 5);
    assert_int_equal(count("anna"), 1);
    for (size_t i = 0; i < REFUSED; i++) /* as if it were later */
        ui->audit.refused[i].due = 0;
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("otto"), 6);
    assert_string_equal(events[n - 1].text, "refused: /api/setpoint from 10.0.0.7: no (994 more)");
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("otto"), 6);
}

/* Promise(server/every-write-every) */
static void strangers_of_any_number_push_no_user_out(void **state)
{
    char address[32], name[16];
    (void)state;
    for (int i = 0; i < 1000; i++) {
        snprintf(address, sizeof address, "10.0.%d.%d", i / 250, i % 250);
        audit_refusal(ui, "", address, "/api/setpoint", "please log in");
    }
    for (int i = 0; i < REFUSED + 8; i++) {
        snprintf(name, sizeof name, "user%d", i);
        audit_refusal(ui, name, "10.0.0.1", "/api/setpoint", "no");
    }
    assert_int_equal(audit_flush(ui, store), 0);
    assert_int_equal(count("(stranger)"), 5);
    assert_int_equal(count("user0"), 1);
    assert_int_equal(count(name), 1);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(what_the_store_does_not_take_waits_for_it), T(as_many_wait_as_there_is_room_for),
        T(a_refusal_says_who_whence_what_and_why),    T(a_flood_of_refusals_leaves_a_few_rows_and_its_number),
        T(strangers_of_any_number_push_no_user_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
