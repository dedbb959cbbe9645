/* SPDX-License-Identifier: BSD-3-Clause */
/* The ring of the stream: who reads what, who is dropped, who may go on. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/server/stream.h"
#include "check.h"

struct reader {
    struct stream_reader *reader;
    bool resumed;
    int rests, wakes;
    char got[1 << 16];
};

static struct stream *stream;

static void on_rest(void *ctx)
{
    ((struct reader *)ctx)->rests++;
}

static void on_wake(void *ctx)
{
    ((struct reader *)ctx)->wakes++;
}

static int set_up(void **state)
{
    (void)state;
    return stream_create(&stream);
}

static int tear_down(void **state)
{
    (void)state;
    stream_destroy(stream);
    return 0;
}

static const struct stream_watcher watcher_operator = {.session = "", .privileged = true},
                                   observer = {.session = ""};

static void join(struct reader *r, const char *last)
{
    *r = (struct reader){0};
    assert_int_equal(
        stream_open(stream, &watcher_operator, last, on_rest, on_wake, r, &r->reader, &r->resumed), 0);
}

/* Returns the error. */
static int refused(const struct stream_watcher *watcher)
{
    struct stream_reader *reader = NULL;
    bool resumed;
    int rc = stream_open(stream, watcher, NULL, on_rest, on_wake, NULL, &reader, &resumed);
    assert_true(rc < 0);
    assert_null(reader);
    return rc;
}

static void publish(const char *data)
{
    stream_publish(stream, "values", data, strlen(data), true);
}

/* All there is, in pieces of `piece` bytes. Returns what the last read said. */
static long drain(struct reader *r, size_t piece)
{
    size_t n = 0;
    long got = 0;
    while (n + piece < sizeof r->got && (got = stream_read(r->reader, r->got + n, piece)) > 0)
        n += (size_t)got;
    r->got[n] = '\0';
    return got;
}

static void each_reader_gets_each_message_once(void **state)
{
    struct reader a, b;
    char id[STREAM_ID_LEN], expected[200];
    (void)state;
    join(&a, NULL);
    publish("{\"n\":1}");
    join(&b, NULL); /* from now on */
    publish("{\"n\":2}");
    stream_id(stream, id);
    assert_int_equal(drain(&a, 1000), STREAM_WAIT);
    assert_int_equal(drain(&b, 1000), STREAM_WAIT);
    snprintf(expected, sizeof expected, "id: %s\nevent: values\ndata: {\"n\":2}\n\n", id);
    assert_string_equal(b.got, expected);
    assert_non_null(strstr(a.got, "{\"n\":1}"));
    assert_string_equal(strstr(a.got, "\n\n") + 2, expected);
    assert_int_equal(drain(&a, 1000), STREAM_WAIT);
    assert_string_equal(a.got, "");
    stream_close(a.reader);
    stream_close(b.reader);
}

static void pieces_of_any_size_make_the_same_text(void **state)
{
    struct reader whole, part;
    (void)state;
    for (size_t piece = 1; piece < 40; piece += 3) {
        join(&whole, NULL);
        join(&part, NULL);
        stream_greet(part.reader, "hello", "{}", 2);
        stream_greet(whole.reader, "hello", "{}", 2);
        publish("{\"long\":\"enough to be cut\"}");
        stream_publish(stream, "beat", "{}", 2, false);
        drain(&whole, 1000);
        drain(&part, piece);
        assert_string_equal(part.got, whole.got);
        assert_int_equal(strncmp(whole.got, "event: hello\ndata: {}\n\nid: ", 27), 0);
        assert_non_null(strstr(whole.got, "\n\nevent: beat\n")); /* without an id */
        stream_close(whole.reader);
        stream_close(part.reader);
    }
}

static void a_reader_is_woken_once_when_there_is_something(void **state)
{
    struct reader r;
    (void)state;
    join(&r, NULL);
    publish("{}");
    assert_int_equal(r.wakes, 0); /* it has not been told to rest */
    drain(&r, 1000);
    assert_int_equal(r.rests, 1);
    publish("{}");
    publish("{}");
    assert_int_equal(r.wakes, 1);
    drain(&r, 1000);
    assert_int_equal(r.rests, 2);
    stream_close(r.reader);
}

static void who_comes_back_goes_on_after_the_last_message(void **state)
{
    struct reader r;
    char id[STREAM_ID_LEN], other[STREAM_ID_LEN];
    (void)state;
    publish("{\"n\":1}");
    stream_id(stream, id);
    publish("{\"n\":2}");
    publish("{\"n\":3}");
    join(&r, id);
    assert_true(r.resumed);
    drain(&r, 1000);
    assert_null(strstr(r.got, "{\"n\":1}"));
    assert_non_null(strstr(r.got, "{\"n\":2}"));
    assert_non_null(strstr(r.got, "{\"n\":3}"));
    stream_close(r.reader);

    stream_id(stream, id); /* nothing missed */
    join(&r, id);
    assert_true(r.resumed);
    drain(&r, 1000);
    assert_string_equal(r.got, "");
    stream_close(r.reader);

    snprintf(other, sizeof other, "%.9s%d", id, 999); /* not yet said */
    const char *const unknown[] = {"",    "x",  "00000000", "00000000.1",
                                   other, "-1", ".",        "99999999999999999999999999"};
    for (size_t i = 0; i < sizeof unknown / sizeof *unknown; i++) {
        join(&r, unknown[i]);
        assert_false(r.resumed);
        stream_close(r.reader);
    }
}

/* Promise(server/stream) */
static void what_the_ring_has_lost_is_not_resumed(void **state)
{
    struct reader r;
    char id[STREAM_ID_LEN];
    (void)state;
    publish("{}");
    stream_id(stream, id);
    for (int i = 0; i < STREAM_LAG - 1; i++)
        publish("{}");
    join(&r, id);
    assert_true(r.resumed);
    stream_close(r.reader);
    for (int i = 0; i < STREAM_RING; i++)
        publish("{}");
    join(&r, id);
    assert_false(r.resumed);
    stream_close(r.reader);
}

/* Promise(server/stream) */
static void the_slow_are_dropped_and_told_the_others_go_on(void **state)
{
    struct reader slow, quick;
    struct stream_stats stats;
    (void)state;
    join(&slow, NULL);
    join(&quick, NULL);
    publish("{\"first\":true}");
    assert_int_equal(stream_read(slow.reader, slow.got, 10), 10); /* in the middle of a message */
    for (int i = 0; i < 2 * STREAM_RING; i++) {
        publish("{}");
        drain(&quick, 1000);
    }
    assert_int_equal(drain(&slow, 1000), STREAM_END);
    const char *bye = strstr(slow.got, "event: bye\ndata: {\"reason\":\"slow\"");
    assert_non_null(bye);
    assert_int_equal(strncmp(bye - 2, "\n\n", 2), 0); /* what was begun was finished */
    assert_null(strstr(bye + 1, "event:"));
    publish("{\"still\":\"there\"}");
    drain(&quick, 1000);
    assert_non_null(strstr(quick.got, "still"));
    stream_stats(stream, &stats);
    assert_int_equal(stats.dropped, 1);
    stream_close(slow.reader);
    stream_close(quick.reader);
}

/* Promise(server/stream) */
static void many_bytes_are_too_many_as_well(void **state)
{
    struct reader slow;
    char *data = malloc(STREAM_BEHIND / 4);
    (void)state;
    assert_non_null(data);
    memset(data, ' ', STREAM_BEHIND / 4);
    join(&slow, NULL);
    for (int i = 0; i < 12;
         i++) /* far fewer messages than a ring; the ring itself keeps no more than STREAM_BYTES */
        stream_publish(stream, "values", data, STREAM_BEHIND / 4, true);
    while (stream_read(slow.reader, slow.got, 1000) > 0)
        continue;
    assert_int_equal(stream_read(slow.reader, slow.got, 1000), STREAM_END);
    stream_close(slow.reader);
    free(data);
}

static bool is_this(void *ctx, void *arg)
{
    return ctx == arg;
}

static void one_reader_can_be_sent_away(void **state)
{
    struct reader a, b;
    (void)state;
    join(&a, NULL);
    join(&b, NULL);
    drain(&a, 1000);
    drain(&b, 1000);
    stream_drop(stream, is_this, &a, "session", "please \"log\" in");
    stream_drop(stream, is_this, &a, "session", "twice is once");
    assert_int_equal(a.wakes, 1);
    assert_int_equal(b.wakes, 0);
    assert_int_equal(drain(&a, 7), STREAM_END);
    assert_string_equal(
        a.got, "event: bye\ndata: {\"reason\":\"session\",\"message\":\"please \\\"log\\\" in\"}\n\n");
    publish("{}");
    assert_int_equal(drain(&a, 1000), STREAM_END);
    assert_int_equal(drain(&b, 1000), STREAM_WAIT);
    stream_close(a.reader);
    stream_close(b.reader);
}

static void once_ended_nobody_rests_and_nobody_comes(void **state)
{
    struct reader r;
    (void)state;
    join(&r, NULL);
    drain(&r, 1000);
    stream_end(stream, "shutdown", "bye");
    assert_int_equal(r.wakes, 1);
    assert_int_equal(drain(&r, 1000), STREAM_END);
    publish("{}");
    assert_int_equal(drain(&r, 1000), STREAM_END);
    assert_int_equal(r.rests, 1);
    assert_int_equal(refused(&watcher_operator), APC_EBUSY);
    stream_close(r.reader);
}

static void there_are_no_more_readers_than_allowed(void **state)
{
    struct reader *r = calloc(STREAM_READERS + 1, sizeof *r);
    (void)state;
    assert_non_null(r);
    for (int i = 0; i < STREAM_READERS; i++)
        join(&r[i], NULL);
    assert_int_equal(refused(&watcher_operator), APC_EBUSY);
    stream_close(r[0].reader);
    join(&r[STREAM_READERS], NULL);
    for (int i = 1; i <= STREAM_READERS; i++)
        stream_close(r[i].reader);
    stream_close(NULL);
    free(r);
}

/* Promise(server/stream) */
static void observers_leave_room_for_operators(void **state)
{
    struct stream_reader *reader[STREAM_READERS];
    bool resumed;
    int n = 0;
    (void)state;
    while (n < STREAM_READERS - STREAM_RESERVE)
        assert_int_equal(stream_open(stream, &observer, NULL, on_rest, on_wake, NULL, &reader[n++], &resumed),
                         0);
    assert_int_equal(refused(&observer), APC_EBUSY);
    while (n < STREAM_READERS)
        assert_int_equal(
            stream_open(stream, &watcher_operator, NULL, on_rest, on_wake, NULL, &reader[n++], &resumed), 0);
    assert_int_equal(refused(&watcher_operator), APC_EBUSY);
    while (n > 0)
        stream_close(reader[--n]);
}

static void a_session_has_its_share_and_no_more(void **state)
{
    const struct stream_watcher one = {.session = "1"}, other = {.session = "2"},
                                own = {.session = "1", .privileged = true};
    struct stream_reader *reader[STREAM_SHARE], *others;
    bool resumed;
    (void)state;
    for (int i = 0; i < STREAM_SHARE; i++)
        assert_int_equal(stream_open(stream, &one, NULL, on_rest, on_wake, NULL, &reader[i], &resumed), 0);
    assert_int_equal(refused(&one), APC_EFULL);
    assert_int_equal(refused(&own), APC_EFULL);
    assert_int_equal(stream_open(stream, &other, NULL, on_rest, on_wake, NULL, &others, &resumed), 0);
    stream_close(reader[0]);
    assert_int_equal(stream_open(stream, &one, NULL, on_rest, on_wake, NULL, &reader[0], &resumed), 0);
    for (int i = 0; i < STREAM_SHARE; i++)
        stream_close(reader[i]);
    stream_close(others);
}

/* Data of this many bytes; as a message without an id it takes 22 more. */
static void publish_bytes(size_t n, bool with_id)
{
    char *data = malloc(n);
    assert_non_null(data);
    memset(data, ' ', n);
    stream_publish(stream, "values", data, n, with_id);
    free(data);
}

static void all_of_a_lag_is_kept_and_one_more_is_not(void **state)
{
    struct reader edge, beyond;
    struct stream_stats stats;
    (void)state;
    join(&beyond, NULL);
    publish("{}");
    join(&edge, NULL);
    for (int i = 0; i < STREAM_LAG; i++) {
        stream_stats(stream, &stats);
        assert_int_equal(stats.dropped, 0);
        publish("{}");
    }
    stream_stats(stream, &stats);
    assert_int_equal(stats.dropped, 1);
    assert_int_equal(drain(&edge, 1000), STREAM_WAIT);
    assert_int_equal(drain(&beyond, 1000), STREAM_END);
    stream_close(edge.reader);
    stream_close(beyond.reader);
}

static void bytes_behind_are_counted_to_the_last(void **state)
{
    for (size_t more = 0; more < 2; more++) {
        struct reader r;
        struct stream_stats before, after;
        (void)state;
        join(&r, NULL);
        stream_stats(stream, &before);
        publish_bytes(1000, false);
        publish_bytes(STREAM_BEHIND - 1022 - 22 + more, false);
        stream_stats(stream, &after);
        assert_int_equal(after.dropped - before.dropped, more);
        stream_close(r.reader);
    }
}

static void what_is_too_many_bytes_behind_is_not_resumed(void **state)
{
    for (size_t more = 0; more < 2; more++) {
        struct reader r;
        char id[STREAM_ID_LEN];
        (void)state;
        publish("{}");
        stream_id(stream, id);
        publish_bytes(1000, false);
        publish_bytes(STREAM_BEHIND - 1022 - 22 + more, false);
        join(&r, id);
        assert_int_equal(r.resumed, more == 0);
        stream_close(r.reader);
    }
}

static void what_was_missed_is_resumed_up_to_a_lag(void **state)
{
    struct reader r;
    char id[STREAM_ID_LEN], text[40];
    (void)state;
    for (int i = 0; i < STREAM_RING + 7; i++) /* the ring has gone round */
        publish("{}");
    stream_id(stream, id);
    for (int i = 1; i < STREAM_LAG; i++) {
        snprintf(text, sizeof text, "{\"n\":%d}", i);
        publish(text);
        if (i == 1 || i == STREAM_LAG - 1) {
            join(&r, id);
            assert_true(r.resumed);
            drain(&r, 100);
            assert_non_null(strstr(r.got, "data: {\"n\":1}\n\n"));
            stream_close(r.reader);
        }
    }
    publish("{}");
    join(&r, id);
    assert_false(r.resumed);
    publish("{\"after\":1}"); /* then he goes on from now */
    drain(&r, 100);
    assert_non_null(strstr(r.got, "after"));
    assert_null(strstr(strstr(r.got, "data:") + 1, "data:"));
    stream_close(r.reader);
}

static void an_id_is_of_the_last_message_that_has_one(void **state)
{
    struct reader r;
    char none[STREAM_ID_LEN], first[STREAM_ID_LEN], id[STREAM_ID_LEN], line[80];
    (void)state;
    stream_id(stream, none);
    assert_string_equal(none + 8, ".0");
    join(&r, none); /* nothing was ever said: nothing can be missed, and nothing be resumed */
    assert_false(r.resumed);
    publish("{}");
    stream_id(stream, first);
    stream_publish(stream, "beat", "{}", 2, false);
    stream_id(stream, id);
    assert_string_equal(id, first);
    stream_publish(stream, "plant", "{}", 2, true);
    stream_id(stream, id);
    assert_string_not_equal(id, first);
    drain(&r, 1000);
    snprintf(line, sizeof line, "id: %s\nevent: plant\n", id);
    assert_non_null(strstr(r.got, line));
    stream_close(r.reader);
}

static void who_is_sent_away_reads_first_what_was_his(void **state)
{
    struct reader r;
    (void)state;
    join(&r, NULL);
    stream_greet(r.reader, "hello", "{\"a\":1}", 7);
    publish("{}");
    assert_int_equal(stream_read(r.reader, r.got, 5), 5); /* of his greeting */
    stream_drop(stream, is_this, &r, "session", "over");
    stream_greet(r.reader, "state", "{}", 2); /* too late */
    assert_int_equal(drain(&r, 9), STREAM_END);
    assert_string_equal(r.got, ": hello\ndata: {\"a\":1}\n\nevent: bye\ndata: "
                               "{\"reason\":\"session\",\"message\":\"over\"}\n\n");
    stream_close(r.reader);
}

static void the_stream_is_counted(void **state)
{
    struct reader a, b;
    struct stream_stats stats;
    (void)state;
    join(&a, NULL);
    join(&b, NULL);
    publish("{}");
    stream_publish(stream, "beat", "{}", 2, false);
    stream_stats(stream, &stats);
    assert_int_equal(stats.readers, 2);
    assert_int_equal(stats.messages, 2);
    assert_int_equal(stats.dropped, 0);
    stream_close(b.reader); /* in any order */
    stream_end(stream, "shutdown", "bye");
    stream_stats(stream, &stats);
    assert_int_equal(stats.readers, 1);
    assert_int_equal(stats.dropped, 1);
    stream_close(a.reader);
    stream_stats(stream, &stats);
    assert_int_equal(stats.readers, 0);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(each_reader_gets_each_message_once),
        T(pieces_of_any_size_make_the_same_text),
        T(a_reader_is_woken_once_when_there_is_something),
        T(who_comes_back_goes_on_after_the_last_message),
        T(what_the_ring_has_lost_is_not_resumed),
        T(the_slow_are_dropped_and_told_the_others_go_on),
        T(many_bytes_are_too_many_as_well),
        T(one_reader_can_be_sent_away),
        T(once_ended_nobody_rests_and_nobody_comes),
        T(there_are_no_more_readers_than_allowed),
        T(observers_leave_room_for_operators),
        T(a_session_has_its_share_and_no_more),
        T(all_of_a_lag_is_kept_and_one_more_is_not),
        T(bytes_behind_are_counted_to_the_last),
        T(what_is_too_many_bytes_behind_is_not_resumed),
        T(what_was_missed_is_resumed_up_to_a_lag),
        T(an_id_is_of_the_last_message_that_has_one),
        T(who_is_sent_away_reads_first_what_was_his),
        T(the_stream_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
