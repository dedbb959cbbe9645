/* SPDX-License-Identifier: BSD-3-Clause */
/* What becomes of a write, by what the newest samples say. */
#include <stdio.h>
#include <string.h>

#include "apc-ui/writes.h"
#include "check.h"

#define S APC_NS_PER_S

enum { Z, TARGET, ACTUAL, KP, TAU_I, MANUAL, SAMPLES };

static struct writes *writes;
static struct apc_sample newest[SAMPLES];
static double taken;
static char told[400]; /* states, as they were told */

static void on_told(void *ctx, const struct write *write)
{
    static const char *const names[] = {"", "begun", "accepted", "applied", "failed", "unknown"};
    size_t n = strlen(told);
    (void)ctx;
    snprintf(told + n, sizeof told - n, "%s%s", n ? " " : "", names[write->state]);
}

static int set_up(void **state)
{
    static const struct apc_sample at_first[SAMPLES] = {
        [Z] = {.table = APC_SETPOINT, .id = 1, .seq = 4, .value = 10},
        [TARGET] = {.table = APC_OPMODE, .id = 0, .seq = 2, .value = APC_MODE_AUTO},
        [ACTUAL] = {.table = APC_OPMODE, .id = 1, .seq = 9, .value = APC_MODE_AUTO},
        [KP] = {.table = APC_TUNING, .id = 1, .seq = 1, .value = 0.2},
        [TAU_I] = {.table = APC_TUNING, .id = 2, .seq = 1, .value = 10},
        [MANUAL] = {.table = APC_MANUAL, .id = 1}};
    (void)state;
    memcpy(newest, at_first, sizeof newest);
    taken = 4 + 2 + 1 + 1;
    told[0] = '\0';
    return writes_create(&writes, on_told, NULL);
}

static int tear_down(void **state)
{
    (void)state;
    writes_destroy(writes);
    return 0;
}

static void settle(apc_ns now)
{
    const struct seen seen = {.samples = newest, .n = SAMPLES, .taken = taken, .patience = 8 * S};
    writes_settle(writes, &seen, now);
}

static struct write_change change_of(int which, double value)
{
    struct write_change c = {.name = "x", .before = newest[which], .after = newest[which]};
    c.after.value = value;
    c.after.time = 77 * S;
    c.after.seq = newest[which].seq + 1;
    return c;
}

static void begin(const char *key, enum write_kind kind, struct write_change *change, size_t n)
{
    struct write write = {.kind = kind, .user = "anna", .n = n, .change = change};
    struct text t = {0};
    snprintf(write.key, sizeof write.key, "%s", key);
    assert_int_equal(writes_begin(writes, &write, &t), 0);
    text_free(&t);
}

static void end(const char *key, enum write_state state, int stored, const struct write_change *change)
{
    struct text t = {0};
    writes_end(writes, key, state, stored, "", change, 0, &t);
    assert_true(t.n > 0);
    text_free(&t);
}

/* It is in the store now. */
static void land(int which, const struct write_change *c)
{
    newest[which] = c->after;
}

static void it_is_applied_once_the_controller_has_taken_it(void **state)
{
    struct write_change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    settle(0);
    assert_string_equal(told, "");
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    settle(0); /* our own read is older than the commit */
    land(Z, &c);
    settle(S);
    assert_string_equal(told, "accepted");
    taken++;
    settle(2 * S);
    settle(3 * S);
    assert_string_equal(told, "accepted applied");
}

/* The controller took another row meanwhile: as many rows as ours is one of, but not ours. */
static void another_row_is_not_taken_for_it(void **state)
{
    struct write_change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(Z, &c);
    newest[KP].seq++; /* also in the read that shows ours first */
    taken++;          /* the controller has Kp only */
    settle(S);
    assert_string_equal(told, "accepted");
    taken++;
    settle(2 * S);
    assert_string_equal(told, "accepted applied");
}

static void a_mode_is_applied_when_it_is_the_actual_one(void **state)
{
    struct write_change c = change_of(TARGET, APC_MODE_MAN);
    (void)state;
    begin("key-0001", WRITE_MODE, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(TARGET, &c);
    settle(S);
    taken++;
    newest[ACTUAL].value = APC_MODE_MAN;
    settle(S);
    assert_string_equal(told, "accepted applied");
}

static void a_mode_that_the_controller_does_not_take_has_failed(void **state)
{
    struct write_change c = change_of(TARGET, APC_MODE_AUTO);
    struct text t = {0};
    (void)state;
    newest[ACTUAL].value = APC_MODE_MAN;
    begin("key-0001", WRITE_MODE, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(TARGET, &c);
    settle(S);
    taken++;
    settle(S);
    assert_string_equal(told, "accepted failed");
    assert_int_equal(writes_json(writes, "key-0001", &t), 1);
    text_put(&t, "", 1);
    assert_non_null(strstr(t.at, "the controller is in Man"));
    text_free(&t);
}

static void without_a_confirmation_it_is_unknown_and_may_still_be_applied(void **state)
{
    struct write_change c[2] = {change_of(KP, 0.3), change_of(TAU_I, 12)};
    (void)state;
    begin("key-0001", WRITE_TUNING, c, 2);
    end("key-0001", WRITE_ACCEPTED, 1, c);
    land(KP, &c[0]);
    land(TAU_I, &c[1]);
    settle(8 * S);
    assert_string_equal(told, "accepted");
    settle(8 * S + 1);
    settle(100 * S);
    assert_string_equal(told, "accepted unknown"); /* said once */
    taken += 2;
    settle(1000 * S);
    assert_string_equal(told, "accepted unknown applied");
}

static void a_controller_that_never_wrote_confirms_nothing(void **state)
{
    struct write_change c = change_of(Z, 12);
    (void)state;
    taken = -1;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(Z, &c);
    settle(S);
    settle(9 * S);
    assert_string_equal(told, "accepted unknown");
}

static void a_lost_answer_is_settled_by_the_row_itself(void **state)
{
    struct write_change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    settle(S);
    settle(100 * S);
    assert_string_equal(told, "unknown");
    land(Z, &c);
    taken++;
    settle(101 * S);
    assert_string_equal(told, "unknown accepted applied");
}

static void a_lost_answer_is_a_failure_when_the_row_is_somebody_elses(void **state)
{
    struct write_change c = change_of(Z, 12), other = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    other.after.time++; /* the same value, at another time */
    land(Z, &other);
    settle(S);
    assert_string_equal(told, "unknown failed");
}

static void final_is_final(void **state)
{
    struct write_change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_FAILED, 0, &c);
    land(Z, &c);
    taken++;
    settle(S);
    settle(100 * S);
    assert_string_equal(told, "failed");
}

static void a_key_names_one_write(void **state)
{
    struct write_change c = change_of(Z, 12);
    struct write again = {.key = "key-0001", .kind = WRITE_SETPOINT, .n = 1, .change = &c};
    struct text t = {0};
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    assert_int_equal(writes_begin(writes, &again, &t), APC_EBUSY);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    assert_int_equal(writes_begin(writes, &again, &t), 1);
    text_put(&t, "", 1);
    assert_non_null(strstr(t.at, "\"state\":\"accepted\""));
    text_free(&t);
    assert_int_equal(writes_json(writes, NULL, &t), 1);
    assert_int_equal(writes_json(writes, "key-0002", &t), 0);
    text_free(&t);
}

static void the_oldest_are_forgotten(void **state)
{
    struct write_change c = change_of(Z, 12);
    struct text t = {0};
    char key[20];
    (void)state;
    for (int i = 0; i < WRITES + 10; i++) {
        snprintf(key, sizeof key, "key-%05d", i);
        begin(key, WRITE_SETPOINT, &c, 1);
        end(key, WRITE_FAILED, 0, &c);
    }
    assert_int_equal(writes_json(writes, NULL, &t), WRITES);
    assert_int_equal(writes_json(writes, "key-00009", &t), 0);
    assert_int_equal(writes_json(writes, "key-00010", &t), 1);
    text_free(&t);
}

/* All of it, as the page reads it. */
static const char *shown(const char *key)
{
    static char text[2000];
    struct text t = {0};
    writes_json(writes, key, &t);
    snprintf(text, sizeof text, "%.*s", (int)t.n, t.at ? t.at : "");
    text_free(&t);
    return text;
}

static void what_is_known_of_a_write_is_shown(void **state)
{
    struct write_change c[2] = {change_of(KP, 0.3), change_of(MANUAL, 7)};
    struct write write = {
        .key = "key-0001", .kind = WRITE_TUNING, .user = "anna", .time = 5 * S, .n = 2, .change = c};
    struct text t = {0};
    (void)state;
    assert_int_equal(writes_begin(writes, &write, &t), 0);
    assert_string_equal(
        shown(NULL),
        "{\"key\":\"key-0001\",\"kind\":\"tuning\",\"user\":\"anna\",\"time\":5.000000,\"state\":"
        "\"unknown\",\"stored\":null,\"reason\":null,\"changes\":[{\"ref\":\"tuning.1\",\"name\":\"x\","
        "\"from\":0.2,\"to\":0.3,\"seq\":null},{\"ref\":\"manual.1\",\"name\":\"x\",\"from\":null,"
        "\"to\":7,\"seq\":null}]}");
    writes_end(writes, "key-0001", WRITE_ACCEPTED, 1, "", c, 0, &t);
    assert_non_null(strstr(shown(NULL), "\"state\":\"accepted\",\"stored\":true,\"reason\":null"));
    assert_non_null(strstr(shown(NULL), "\"to\":0.3,\"seq\":2}"));
    assert_non_null(strstr(shown(NULL), "\"to\":7,\"seq\":1}"));
    begin("key-0002", WRITE_MODE, c, 1);
    writes_end(writes, "key-0002", WRITE_FAILED, 0, "no \"reason\"", c, 0, &t);
    assert_non_null(strstr(shown("key-0002"), "\"kind\":\"mode\""));
    assert_non_null(strstr(shown("key-0002"), "\"stored\":false,\"reason\":\"no \\\"reason\\\"\""));
    assert_non_null(strstr(shown("key-0002"), "\"to\":0.3,\"seq\":null}"));
    assert_non_null(strstr(shown(NULL), "]},{\"key\":\"key-0002\"")); /* the oldest first */
    const size_t before = t.n;
    writes_end(writes, "key-none", WRITE_FAILED, 0, "", c, 0, &t);
    assert_int_equal(t.n, before);
    text_free(&t);
}

/* The controller counts the rows of all that it takes, and no other's. */
static void every_row_that_it_takes_counts(void **state)
{
    static const struct {
        int which;
        double more;
    } cases[] = {{Z, 1}, {TARGET, 1}, {KP, 1}, {TAU_I, 1}, {MANUAL, 1}, {ACTUAL, 0}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char key[20];
        told[0] = '\0';
        snprintf(key, sizeof key, "key-%05zu", i);
        struct write_change c = change_of(Z, 12);
        begin(key, WRITE_SETPOINT, &c, 1);
        end(key, WRITE_ACCEPTED, 1, &c);
        land(Z, &c);
        newest[cases[i].which].seq++;
        taken += 1;
        settle(S);
        assert_string_equal(told, cases[i].more > 0 ? "accepted" : "accepted applied");
        taken += cases[i].more;
        settle(S);
        assert_string_equal(told, "accepted applied");
    }
}

static void a_mode_fails_where_there_is_none_and_not_where_another_was_asked_for_since(void **state)
{
    struct write_change c = change_of(TARGET, APC_MODE_MAN);
    (void)state;
    newest[ACTUAL].seq = 0;
    begin("key-0001", WRITE_MODE, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(TARGET, &c);
    taken++;
    settle(S);
    assert_string_equal(told, "accepted failed");
    assert_non_null(strstr(shown("key-0001"), "\"stored\":true,\"reason\":\"the controller is in no mode\""));
    newest[ACTUAL].seq = 10;
    told[0] = '\0';
    c = change_of(TARGET, APC_MODE_MAN);
    begin("key-0002", WRITE_MODE, &c, 1);
    end("key-0002", WRITE_ACCEPTED, 1, &c);
    land(TARGET, &c);
    newest[TARGET].seq++; /* somebody else has asked for Auto meanwhile, which it is */
    taken += 2;
    settle(S);
    assert_string_equal(told, "accepted applied");
}

static void a_lost_answer_waits_for_its_own_row(void **state)
{
    struct write_change c = change_of(Z, 12), other = change_of(Z, 13);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    other.after.seq = c.after.seq;
    other.after.time = c.after.time; /* in the same microsecond, another value */
    land(Z, &other);
    settle(S);
    assert_string_equal(told, "unknown failed");
    assert_non_null(
        strstr(shown("key-0001"), "\"stored\":false,\"reason\":\"it was not written: somebody else"));
    told[0] = '\0';
    c = change_of(Z, 11); /* and one below */
    begin("key-0002", WRITE_SETPOINT, &c, 1);
    end("key-0002", WRITE_UNKNOWN, -1, &c);
    other = c;
    other.after.value = 10;
    land(Z, &other);
    settle(S);
    assert_string_equal(told, "unknown failed");
    told[0] = '\0';
    c = change_of(Z, 12);
    begin("key-0003", WRITE_SETPOINT, &c, 1);
    end("key-0003", WRITE_UNKNOWN, -1, &c);
    land(Z, &c);
    newest[Z].seq++; /* a row later than ours: what ours was cannot be seen any more */
    settle(S);
    assert_string_equal(told, "unknown");
}

static void keys_are_plain(void **state)
{
    (void)state;
    assert_true(key_ok("abcDEF-_0123"));
    assert_false(key_ok("short"));
    assert_false(key_ok("1234567"));
    assert_true(key_ok("12345678"));
    assert_true(key_ok("0123456789012345678901234567890123456789012345678901234567890123"));
    assert_false(key_ok("01234567890123456789012345678901234567890123456789012345678901234"));
    assert_false(key_ok("has space"));
    assert_false(key_ok("quote\"quote"));
    assert_false(key_ok("0123456789012345678901234567890123456789012345678901234567890123x"));
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(it_is_applied_once_the_controller_has_taken_it),
        T(another_row_is_not_taken_for_it),
        T(a_mode_is_applied_when_it_is_the_actual_one),
        T(a_mode_that_the_controller_does_not_take_has_failed),
        T(without_a_confirmation_it_is_unknown_and_may_still_be_applied),
        T(a_controller_that_never_wrote_confirms_nothing),
        T(a_lost_answer_is_settled_by_the_row_itself),
        T(a_lost_answer_is_a_failure_when_the_row_is_somebody_elses),
        T(final_is_final),
        T(a_key_names_one_write),
        T(the_oldest_are_forgotten),
        T(keys_are_plain),
        T(what_is_known_of_a_write_is_shown),
        T(every_row_that_it_takes_counts),
        T(a_mode_fails_where_there_is_none_and_not_where_another_was_asked_for_since),
        T(a_lost_answer_waits_for_its_own_row),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
