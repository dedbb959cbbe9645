/* SPDX-License-Identifier: BSD-3-Clause */
/* What becomes of a write, by what the newest samples say. */
#include <stdio.h>
#include <string.h>

#include "apc-ui/plant/writes.h"
#include "check.h"

#define S   APC_NS_PER_S
#define NOW (1000 * S) /* UTC; controllers tick just now */

/* What is wanted of one loop, each with what became of it behind it; and of another loop, whose controller is
 * another, and of nobody. */
enum {
    Z,
    Z_ACTUAL,
    TARGET,
    T_ACTUAL,
    KP,
    KP_ACTUAL,
    TAU_I,
    TI_ACTUAL,
    MANUAL,
    M_ACTUAL,
    OTHER,
    O_ACTUAL,
    LOST,
    OWNER,
    SAMPLES
};

static struct writes *writes;
static struct apc_sample newest[SAMPLES];
static struct apc_vector tick[2];
static struct refusal refusal;
static char told[400]; /* states, as they were told */

static void on_told(void *ctx, const struct write *write)
{
    static const char *const names[] = {"",           "begun",  "accepted", "applied",
                                        "superseded", "failed", "unknown"};
    size_t n = strlen(told);
    (void)ctx;
    snprintf(told + n, sizeof told - n, "%s%s", n ? " " : "", names[write->state]);
}

static int set_up(void **state)
{
    static const struct {
        enum apc_table table;
        int id;
        int64_t seq;
        double value;
    } wanted[] = {{APC_SETPOINT, 1, 4, 10}, {APC_OPMODE, 1, 2, APC_MODE_AUTO},
                  {APC_TUNING, 1, 1, 0.2},  {APC_TUNING, 2, 1, 10},
                  {APC_MANUAL, 1, 0, 0},    {APC_OPMODE, 2, 7, APC_MODE_AUTO}};
    (void)state;
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        newest[2 * i] = (struct apc_sample){
            .table = wanted[i].table, .id = wanted[i].id, .seq = wanted[i].seq, .value = wanted[i].value};
        newest[2 * i + 1] = (struct apc_sample){.table = APC_ACTUAL,
                                                .id = apc_variable_number(wanted[i].table, wanted[i].id),
                                                .seq = wanted[i].seq > 0,
                                                .origin = wanted[i].seq,
                                                .value = wanted[i].value};
    }
    newest[LOST] = (struct apc_sample){.table = APC_SETPOINT, .id = 9, .seq = 1, .value = 1};
    newest[OWNER] = (struct apc_sample){
        .table = APC_OPMODE, .id = LOOPS_OWNER(9), .seq = 3}; /* LOST was taken from the scheduler */
    for (int i = 0; i < 2; i++)
        tick[i] = (struct apc_vector){.table = APC_TICK, .id = i + 1, .seq = 1, .time = NOW};
    refusal = (struct refusal){0};
    told[0] = '\0';
    return writes_create(&writes, on_told, NULL);
}

static int tear_down(void **state)
{
    (void)state;
    writes_destroy(writes);
    return 0;
}

/* Returns whether it asks why something was refused. */
static bool settle(apc_ns now)
{
    static const struct loops_controller controllers[] = {{.name = "base", .number = 1, .period = 2 * S},
                                                          {.name = "upper", .number = 2, .period = 0}};
    int by[SAMPLES] = {[OTHER] = 1, [LOST] = -1, [OWNER] = -1};
    const struct seen seen = {
        .samples = newest, .by = by, .n = SAMPLES, .tick = tick, .controller = controllers, .utc = NOW};
    return writes_settle(writes, &seen, now, &refusal);
}

static struct change change_of(int which, double value)
{
    static int scheduled = 9;
    static const struct loops loops = {.scheduled = &scheduled, .n_scheduled = 1};
    const struct plant_view plant = {.loops = &loops};
    const struct change_target to = {.name = "x", .table = newest[which].table, .id = newest[which].id};
    struct change c;
    change_make(&plant, &to, value, &c);
    c.before = newest[which];
    c.after.time = 77 * S;
    c.after.seq = newest[which].seq + 1;
    return c;
}

static void begin(const char *key, enum write_kind kind, struct change *change, size_t n)
{
    struct write write = {.kind = kind, .user = "anna", .time = 77 * S, .n = n, .change = change};
    struct text t = {0};
    snprintf(write.key, sizeof write.key, "%s", key);
    assert_int_equal(writes_begin(writes, &write, &t), 0);
    text_free(&t);
}

static void end_n(const char *key, enum write_state state, int stored, struct change *change, size_t n)
{
    const struct write ended = {.state = state, .stored = stored, .n = n, .change = change};
    struct text t = {0};
    writes_end(writes, key, &ended, "", 0, &t);
    assert_true(t.n > 0);
    text_free(&t);
}

static void end(const char *key, enum write_state state, int stored, struct change *change)
{
    end_n(key, state, stored, change, 1);
}

/* It is in the store now. */
static void land(int which, const struct change *c)
{
    newest[which] = c->after;
}

/* Its controller has looked at it. */
static void took(int which, double value, apc_status status)
{
    struct apc_sample *actual = &newest[which + 1];
    actual->seq++;
    actual->origin = newest[which].seq;
    actual->value = value;
    actual->status = status;
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

static void shows(const char *key, const char *part)
{
    if (!strstr(shown(key), part))
        fail_msg("%s is not in %s", part, shown(key));
}

/* Promise(server/states-of-a-write): A write's states, its key, the seq that was seen. */
static void it_is_applied_once_its_controller_has_taken_it(void **state)
{
    struct change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    assert_false(settle(0));
    assert_string_equal(told, "");
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    settle(0); /* our own read is older than the commit */
    land(Z, &c);
    settle(S);
    assert_string_equal(told, "accepted");
    took(Z, 12, APC_GOOD);
    settle(2 * S);
    settle(3 * S);
    assert_string_equal(told, "accepted applied");
}

static void all_of_one_write_has_to_be_in_force(void **state)
{
    struct change c[2] = {change_of(KP, 0.3), change_of(TAU_I, 12)};
    (void)state;
    begin("key-0001", WRITE_TUNING, c, 2);
    end_n("key-0001", WRITE_ACCEPTED, 1, c, 2);
    land(KP, &c[0]);
    land(TAU_I, &c[1]);
    took(KP, 0.3, APC_GOOD);
    settle(S);
    assert_string_equal(told, "accepted");
    took(TAU_I, 12, APC_GOOD);
    settle(S);
    assert_string_equal(told, "accepted applied");
}

/* Promise(server/states-of-a-write) */
static void a_newer_one_that_was_taken_supersedes_it(void **state)
{
    struct change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(Z, &c);
    newest[Z].seq++; /* somebody else's */
    settle(S);
    assert_string_equal(told, "accepted");
    took(Z, 15, APC_GOOD);
    settle(S);
    assert_string_equal(told, "accepted superseded");
    shows("key-0001", "\"state\":\"superseded\",\"stored\":true,\"reason\":\"it is 15 now\"");
}

/* Promise(server/states-of-a-write) */
static void a_mode_is_applied_when_the_loop_is_in_it(void **state)
{
    struct change c = change_of(TARGET, APC_MODE_CAS);
    (void)state;
    begin("key-0001", WRITE_MODE, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(TARGET, &c);
    newest[OTHER].seq++; /* of another loop, which is in it */
    took(OTHER, APC_MODE_CAS, APC_GOOD);
    settle(S);
    took(TARGET, APC_MODE_AUTO, APC_UNCERTAIN); /* it waits for the loop above */
    settle(8 * S);
    assert_string_equal(told, "accepted");
    settle(8 * S + 1);
    settle(9 * S);
    assert_string_equal(told, "accepted unknown");
    shows("key-0001", "\"stored\":true,\"reason\":\"written, but x is in Auto\"");
    took(TARGET, APC_MODE_CAS, APC_GOOD);
    settle(10 * S);
    assert_string_equal(told, "accepted unknown applied");
}

/* Promise(server/setpoint-operator-took) */
static void what_is_given_back_is_applied_when_the_scheduler_has_written_it(void **state)
{
    struct change c[] = {change_of(OWNER, 1), change_of(LOST, 1)}, none = change_of(OWNER, 1);
    (void)state;
    c[0].along = c[1].after.seq;
    begin("key-0001", WRITE_OWNER, c, 1);
    end_n("key-0001", WRITE_ACCEPTED, 1, c, 2);
    settle(S);
    assert_string_equal(told, "accepted"); /* the rows were read before it was stored */
    land(OWNER, &c[0]);
    land(LOST, &c[1]);
    settle(5 * S);
    assert_string_equal(told, "accepted");
    settle(5 * S + 1);
    assert_string_equal(told, "accepted unknown");
    shows("key-0001", "\"stored\":true,\"reason\":\"written, but no scheduler moves it\"");
    newest[LOST].seq++;
    settle(9 * S);
    assert_string_equal(told, "accepted unknown applied");

    none = change_of(OWNER, 0); /* taken as it stands */
    begin("key-0002", WRITE_OWNER, &none, 1);
    end("key-0002", WRITE_ACCEPTED, 1, &none);
    land(OWNER, &none);
    newest[OWNER].seq++; /* and given back at once */
    settle(10 * S);
    assert_string_equal(told, "accepted unknown applied accepted superseded");
}

/* Promise(server/states-of-a-write) */
static void what_is_refused_has_failed_with_the_reason_of_its_event(void **state)
{
    struct change c = change_of(KP, 0.3), other = change_of(TAU_I, 5);
    (void)state;
    begin("key-0001", WRITE_TUNING, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    begin("key-0002", WRITE_TUNING, &other, 1);
    end("key-0002", WRITE_ACCEPTED, 1, &other);
    land(KP, &c);
    land(TAU_I, &other);
    took(KP, 0.2, APC_BAD);
    took(TAU_I, 10, APC_BAD);
    assert_true(settle(S));
    assert_string_equal(refusal.key, "key-0001");
    assert_string_equal(refusal.name, "x");
    assert_int_equal(refusal.since, c.after.time);
    assert_true(settle(S)); /* not found yet: and the other one? */
    assert_string_equal(refusal.key, "key-0002");
    snprintf(refusal.text, sizeof refusal.text, "x is too large");
    assert_false(settle(S)); /* each once a round */
    assert_string_equal(told, "accepted accepted failed");
    shows("key-0002", "\"stored\":true,\"reason\":\"x is too large\"");
    refusal = (struct refusal){0};
    assert_true(settle(2 * S));
    assert_string_equal(refusal.key, "key-0001");
    assert_false(settle(2 * S));
    refusal = (struct refusal){0};
    assert_true(settle(2 * S + 1)); /* nor does it come any more */
    assert_false(settle(2 * S + 1));
    assert_string_equal(told, "accepted accepted failed failed");
    shows("key-0001", "\"reason\":\"0.2 stays in force\"");
}

/* Promise(server/states-of-a-write) */
static void without_a_confirmation_it_is_unknown_and_may_still_be_applied(void **state)
{
    struct change c = change_of(KP, 0.3);
    (void)state;
    begin("key-0001", WRITE_TUNING, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(KP, &c);
    settle(8 * S); /* 3 periods and 2 s */
    assert_string_equal(told, "accepted");
    settle(8 * S + 1);
    settle(100 * S);
    assert_string_equal(told, "accepted unknown"); /* said once */
    shows("key-0001", "controller base");
    took(KP, 0.3, APC_GOOD);
    settle(1000 * S);
    assert_string_equal(told, "accepted unknown applied");
}

/* Promise(server/states-of-a-write) */
static void nobody_applies_it_when_its_own_controller_does_not_tick(void **state)
{
    struct change c = change_of(Z, 12), other = change_of(OTHER, APC_MODE_MAN);
    (void)state;
    tick[0].time = NOW - 7 * S;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    begin("key-0002", WRITE_MODE, &other, 1);
    end("key-0002", WRITE_ACCEPTED, 1, &other);
    land(Z, &c);
    land(OTHER, &other);
    settle(0);
    assert_string_equal(told, "accepted accepted unknown"); /* at once, and the other's does */
    shows("key-0001", "written, but no controller applies it: controller base's last tick was 7.0 s ago");
    tick[0].time = NOW;
    took(Z, 12, APC_GOOD);
    tick[1].seq = 0; /* it never did */
    settle(S);
    assert_string_equal(told, "accepted accepted unknown applied unknown");
    shows("key-0002", "no controller applies it: controller upper has never ticked");
}

static void what_no_controller_has_is_taken_by_nobody(void **state)
{
    struct change c = change_of(LOST, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    land(LOST, &c);
    settle(0);
    assert_string_equal(told, "accepted unknown");
    shows("key-0001", "written, but it belongs to no controller");
}

static void what_was_written_after_the_look_waits_for_the_next_one(void **state)
{
    struct change c = change_of(Z, 4);
    (void)state;
    c.after.table = APC_OPMODE;
    c.newest.table = APC_OPMODE;
    c.newest.id = c.after.id = 99; /* of an alarm: looked at only while it is wanted */
    begin("key-0001", WRITE_ACK, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    settle(0);
    settle(8 * S);
    assert_string_equal(told, "accepted");
    settle(8 * S + 1); /* it never was */
    assert_string_equal(told, "accepted unknown");
    shows("key-0001", "written, but it belongs to no controller");
}

/* Promise(server/loops-their-controllers) */
static void what_was_taken_along_is_told_and_not_waited_for(void **state)
{
    struct change c[2] = {change_of(Z, 12), change_of(TARGET, APC_MODE_AUTO)};
    (void)state;
    begin("key-0001", WRITE_SETPOINT, c, 1);
    end_n("key-0001", WRITE_ACCEPTED, 1, c, 2);
    shows("key-0001", "\"ref\":\"opmode.1\"");
    land(Z, &c[0]);
    land(TARGET, &c[1]);
    took(TARGET, APC_MODE_AUTO, APC_GOOD);
    settle(S);
    assert_string_equal(told, "accepted");
    took(Z, 12, APC_GOOD_LOCAL_OVERRIDE);
    newest[TARGET].seq++; /* somebody has changed that since */
    took(TARGET, APC_MODE_CAS, APC_UNCERTAIN);
    settle(S);
    assert_string_equal(told, "accepted applied");
}

/* Promise(server/states-of-a-write) */
static void a_lost_answer_is_settled_by_the_row_itself(void **state)
{
    struct change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    settle(S);
    settle(100 * S);
    assert_string_equal(told, "unknown");
    land(Z, &c);
    took(Z, 12, APC_GOOD);
    settle(101 * S);
    assert_string_equal(told, "unknown accepted applied");
}

static void where_the_seq_was_the_stores_to_give_only_the_row_itself_tells(void **state)
{
    struct change c = change_of(Z, 12), other = change_of(Z, 11);
    (void)state;
    c.after.seq = APC_SEQ_ANY;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    land(Z, &other); /* the loop above's, which says nothing of ours */
    settle(S);
    assert_string_equal(told, "unknown");
    newest[Z].seq++;
    newest[Z].time = c.after.time;
    newest[Z].value = c.after.value;
    settle(S);
    assert_string_equal(told, "unknown accepted");
    shows("key-0001", "\"to\":12,\"seq\":6}");
}

static void a_lost_answer_is_a_failure_when_the_row_is_somebody_elses(void **state)
{
    struct change c = change_of(Z, 12), other = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    other.after.time++; /* the same value, at another time */
    land(Z, &other);
    settle(S);
    assert_string_equal(told, "unknown failed");
}

/* Promise(server/states-of-a-write) */
static void final_is_final(void **state)
{
    struct change c = change_of(Z, 12);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_FAILED, 0, &c);
    land(Z, &c);
    took(Z, 12, APC_GOOD);
    settle(S);
    settle(100 * S);
    assert_string_equal(told, "failed");
}

static void a_key_names_one_write(void **state)
{
    struct change c = change_of(Z, 12);
    struct write again = {.key = "key-0001", .kind = WRITE_SETPOINT, .user = "anna", .n = 1, .change = &c};
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

/*
 * Promise(server/key-stands-write): A `key` stands for one write, and another request with it writes
 *   nothing.
 */
static void a_key_of_another_write_answers_nothing(void **state)
{
    struct change c = change_of(Z, 12), value = change_of(Z, 13), row = change_of(MANUAL, 12),
                  two[2] = {change_of(Z, 12), change_of(KP, 1)};
    const struct write same = {
        .key = "key-0001", .kind = WRITE_SETPOINT, .user = "anna", .n = 1, .change = &c};
    struct write others[5] = {same, same, same, same, same};
    struct text t = {0};
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_ACCEPTED, 1, &c);
    others[0].kind = WRITE_OUTPUT;
    others[1].user[0] = 'A';
    others[2].change = &value;
    others[3].change = &row;
    others[4].change = two;
    others[4].n = 2;
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        assert_int_equal(writes_begin(writes, &others[i], &t), APC_ECONFLICT);
    assert_int_equal(t.n, 0);
    assert_int_equal(writes_begin(writes, &same, &t), 1);
    text_free(&t);
}

/* Promise(server/states-of-a-write) */
static void the_oldest_are_forgotten(void **state)
{
    struct change c = change_of(Z, 12);
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

static void what_is_known_of_a_write_is_shown(void **state)
{
    struct change c[2] = {change_of(KP, 0.3), change_of(MANUAL, 7)};
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
    end_n("key-0001", WRITE_ACCEPTED, 1, c, 2);
    assert_non_null(strstr(shown(NULL), "\"state\":\"accepted\",\"stored\":true,\"reason\":null"));
    assert_non_null(strstr(shown(NULL), "\"to\":0.3,\"seq\":2}"));
    assert_non_null(strstr(shown(NULL), "\"to\":7,\"seq\":1}"));
    begin("key-0002", WRITE_MODE, c, 1);
    writes_end(writes, "key-0002",
               &(struct write){.state = WRITE_FAILED, .confirm = true, .n = 1, .change = c}, "no \"reason\"",
               0, &t);
    assert_non_null(strstr(shown("key-0002"), "\"kind\":\"mode\""));
    assert_non_null(
        strstr(shown("key-0002"), "\"stored\":false,\"reason\":\"no \\\"reason\\\"\",\"confirm\":true,"));
    assert_non_null(strstr(shown("key-0002"), "\"to\":0.3,\"seq\":null}"));
    assert_non_null(strstr(shown(NULL), "]},{\"key\":\"key-0002\"")); /* the oldest first */
    const size_t before = t.n;
    writes_end(writes, "key-none", &(struct write){.state = WRITE_FAILED, .n = 1, .change = c}, "", 0, &t);
    assert_int_equal(t.n, before);
    text_free(&t);
}

static void a_lost_answer_waits_for_its_own_row(void **state)
{
    struct change c = change_of(Z, 12), other = change_of(Z, 13);
    (void)state;
    begin("key-0001", WRITE_SETPOINT, &c, 1);
    end("key-0001", WRITE_UNKNOWN, -1, &c);
    other.after.seq = c.after.seq;
    other.after.time = c.after.time; /* in the same microsecond, another value */
    land(Z, &other);
    settle(S);
    assert_string_equal(told, "unknown failed");
    assert_non_null(strstr(shown("key-0001"),
                           "\"stored\":false,\"reason\":\"it was not written: another write came first"));
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
        T(it_is_applied_once_its_controller_has_taken_it),
        T(all_of_one_write_has_to_be_in_force),
        T(a_newer_one_that_was_taken_supersedes_it),
        T(a_mode_is_applied_when_the_loop_is_in_it),
        T(what_is_given_back_is_applied_when_the_scheduler_has_written_it),
        T(what_is_refused_has_failed_with_the_reason_of_its_event),
        T(without_a_confirmation_it_is_unknown_and_may_still_be_applied),
        T(nobody_applies_it_when_its_own_controller_does_not_tick),
        T(what_no_controller_has_is_taken_by_nobody),
        T(what_was_written_after_the_look_waits_for_the_next_one),
        T(what_was_taken_along_is_told_and_not_waited_for),
        T(where_the_seq_was_the_stores_to_give_only_the_row_itself_tells),
        T(a_lost_answer_is_settled_by_the_row_itself),
        T(a_lost_answer_is_a_failure_when_the_row_is_somebody_elses),
        T(final_is_final),
        T(a_key_names_one_write),
        T(a_key_of_another_write_answers_nothing),
        T(the_oldest_are_forgotten),
        T(keys_are_plain),
        T(what_is_known_of_a_write_is_shown),
        T(a_lost_answer_waits_for_its_own_row),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
