/* SPDX-License-Identifier: BSD-3-Clause */
/* What a caller may ask of a store: what makes no sense is refused in a whole sentence before any kind of
 * store sees it, and what is just allowed gets there. The store behind counts what arrives, and does nothing.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "counting_store.h"

static struct apc_store_config configured;

#define MAX APC_STORE_SAMPLES_MAX

#define refused_as(err, call, sentence)                                                                      \
    do {                                                                                                     \
        reached = 0;                                                                                         \
        if ((call) != (err))                                                                                 \
            fail_msg("%s: not %s", #call, #err);                                                             \
        assert_string_equal(apc_store_error(&store), sentence);                                              \
        assert_int_equal(reached, 0);                                                                        \
    } while (0)
#define refused(call, sentence) refused_as(APC_EINVAL, call, sentence)
/* It arrives, and what becomes of it is told. */
#define taken(call)                                                                                          \
    do {                                                                                                     \
        for (answer = 6; answer >= -8; answer -= 14) {                                                       \
            reached = 0;                                                                                     \
            const int taken_rc = (call);                                                                     \
            if (taken_rc != answer || reached != 1)                                                          \
                fail_msg("%s: %d, arrived %d times: %s", #call, taken_rc, reached, apc_store_error(&store)); \
        }                                                                                                    \
    } while (0)
#define nothing_to_do(call)                                                                                  \
    do {                                                                                                     \
        reached = 0;                                                                                         \
        assert_int_equal(call, 0);                                                                           \
        assert_int_equal(reached, 0);                                                                        \
    } while (0)

static void test_each_function_needs_a_store_and_tells_what_it_says(void **state)
{
    (void)state;
    for (int i = 0; i < FUNCTIONS; i++) {
        reached = 0;
        assert_int_equal(call(i, NULL), APC_EINVAL);
        assert_int_equal(reached, 0);
        store.streaming = true;
        refused_as(APC_ESTATE, call(i, &store),
                   "a store may not be used from inside its own history function");
        store.streaming = false;
        answer = APC_ETIMEDOUT;
        assert_int_equal(call(i, &store), APC_ETIMEDOUT);
        assert_int_equal(reached, 1);
        assert_string_equal(apc_store_error(&store), ""); /* not what was said before */
        answer = 0;
        assert_int_equal(call(i, &store), 0);
    }
}

static void test_how_many_at_once_and_from_where(void **state)
{
    (void)state;
    struct apc_sample *many = calloc(MAX, sizeof *many);
    assert_non_null(many);
    for (size_t i = 0; i < MAX; i++)
        many[i] = (struct apc_sample){.table = APC_SENSOR, .id = (int)i, .seq = 1};
    const char *much = "1048577 at once are too many: at most 1048576",
               *none = "3 expected, but the array is NULL";
    taken(apc_store_read(&store, many, MAX));
    taken(apc_store_append(&store, many, MAX));
    taken(apc_store_variables(&store, many, MAX));
    refused(apc_store_read(&store, many, MAX + 1), much);
    refused(apc_store_append(&store, many, MAX + 1), much);
    refused(apc_store_claim_set(&store, many, MAX + 1), much);
    refused(apc_store_release(&store, many, MAX + 1), much);
    refused(apc_store_wait(&store, many, MAX + 1, 0), much);
    refused(apc_store_variables(&store, many, MAX + 1), much);
    refused(apc_store_put(&store, many, 4097), "4097 values at once are too many: at most 4096");
    refused(apc_store_swap(&store, many, 4097), "4097 values at once are too many: at most 4096");
    taken(apc_store_put(&store, many, 4096));
    refused(apc_store_read(&store, NULL, 3), none);
    refused(apc_store_append(&store, NULL, 3), none);
    refused(apc_store_put(&store, NULL, 3), none);
    refused(apc_store_swap(&store, NULL, 3), none);
    refused(apc_store_claim(&store, APC_SENSOR, 3, NULL), none);
    refused(apc_store_claim_set(&store, NULL, 3), none);
    refused(apc_store_release(&store, NULL, 3), none);
    refused(apc_store_wait(&store, NULL, 3, 0), none);
    refused(apc_store_variables(&store, NULL, 3), none);
    refused(apc_store_get_tags(&store, NULL, 3), none);
    refused(apc_store_put_tags(&store, NULL, 3), none);
    refused(apc_store_append_events(&store, NULL, 3), none);
    refused(apc_store_append_timing(&store, NULL, 3), none);
    refused(apc_store_asked(&store, 1, NULL, 3), none);
    refused(apc_store_author(&store, NULL), "1 expected, but the array is NULL");
    refused(apc_store_author_name(&store, 1, NULL), "1 expected, but the array is NULL");
    refused(apc_store_ask(&store, NULL), "1 expected, but the array is NULL");
    refused(apc_store_behind(&store, NULL), "1 expected, but the array is NULL");
    refused(apc_store_room(&store, NULL), "1 expected, but the array is NULL");
    refused(apc_store_read_rows(&store, NULL), "1 expected, but the array is NULL");
    refused(apc_store_append_rows(&store, NULL), "1 expected, but the array is NULL");
    nothing_to_do(apc_store_read(&store, NULL, 0));
    nothing_to_do(apc_store_append(&store, NULL, 0));
    nothing_to_do(apc_store_put(&store, NULL, 0));
    nothing_to_do(apc_store_swap(&store, NULL, 0));
    nothing_to_do(apc_store_claim(&store, APC_SENSOR, 0, NULL));
    nothing_to_do(apc_store_claim_set(&store, NULL, 0));
    nothing_to_do(apc_store_release(&store, NULL, 0));
    nothing_to_do(apc_store_wait(&store, NULL, 0, 0));
    nothing_to_do(apc_store_append_events(&store, NULL, 0));
    nothing_to_do(apc_store_append_timing(&store, NULL, 0));
    free(many);
}

/* ---- Variables and values ------------------------------------------------------------------------- */

static void test_a_row_is_of_a_table_of_its_kind_and_of_an_id(void **state)
{
    (void)state;
    struct apc_sample s = {.table = APC_TABLE_END, .id = 1, .seq = 1};
    struct apc_vector v = {.table = APC_SENSOR, .id = 1, .seq = 1};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    char text[40];
    snprintf(text, sizeof text, "%d is no table", (int)APC_TABLE_END);
    refused(apc_store_read(&store, &s, 1), text);
    refused(apc_store_append(&store, &s, 1), text);
    refused(apc_store_put(&store, &s, 1), text);
    refused(apc_store_claim_set(&store, &s, 1), text);
    refused(apc_store_release(&store, &s, 1), text);
    refused(apc_store_wait(&store, &s, 1, 0), text);
    refused(apc_store_history(&store, APC_TABLE_END, 1, NULL, any_sample, NULL), text);
    refused(apc_store_vectors(&store, APC_TABLE_END, 1, NULL, any_vector, NULL), text);
    refused(apc_store_claim(&store, (enum apc_table)0, 0, NULL), "0 is no table");
    refused(apc_store_history_bins(&store, (enum apc_table)40, 1, 0, 1, 1, any_bin, NULL), "40 is no table");
    s.table = APC_SENSOR;
    s.id = -1;
    refused(apc_store_read(&store, &s, 1), "sensor -1: an id must not be negative");
    refused(apc_store_claim_set(&store, &s, 1), "sensor -1: an id must not be negative");
    refused(apc_store_wait(&store, &s, 1, 0), "sensor -1: an id must not be negative");
    s.id = 0;
    taken(apc_store_read(&store, &s, 1));
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END; table++) {
        const bool of_vectors = table == APC_TICK || table == APC_PLAN || table == APC_PREDICTION;
        char samples[80], vectors[80];
        snprintf(samples, sizeof samples, "%s 0: the rows of this table are samples", apc_table_name(table));
        snprintf(vectors, sizeof vectors, "%s 0: the rows of this table are vectors", apc_table_name(table));
        s.table = v.table = table;
        v.id = 0;
        taken(apc_store_claim_set(&store, &s, 1));
        taken(apc_store_wait(&store, &s, 1, 0));
        s.seq = 1;
        if (of_vectors) {
            refused(apc_store_read(&store, &s, 1), vectors);
            refused(apc_store_history(&store, table, 0, NULL, any_sample, NULL), vectors);
            taken(apc_store_read_rows(&store, &rows));
            taken(apc_store_append_rows(&store, &rows));
            taken(apc_store_vectors(&store, table, 0, NULL, any_vector, NULL));
        } else {
            taken(apc_store_read(&store, &s, 1));
            taken(apc_store_history(&store, table, 0, NULL, any_sample, NULL));
            refused(apc_store_read_rows(&store, &rows), samples);
            refused(apc_store_append_rows(&store, &rows), samples);
            refused(apc_store_vectors(&store, table, 0, NULL, any_vector, NULL), samples);
        }
    }
}

static void test_of_many_rows_each_is_looked_at(void **state)
{
    (void)state;
    for (int bad = 0; bad < 3; bad++) {
        struct apc_sample s[3] = {{.table = APC_SETPOINT, .id = 1, .seq = 1},
                                  {.table = APC_SETPOINT, .id = 2, .seq = 1},
                                  {.table = APC_SETPOINT, .id = 3, .seq = 1}};
        struct apc_vector v[3] = {{.table = APC_TICK, .id = 1, .seq = 1},
                                  {.table = APC_TICK, .id = 2, .seq = 1},
                                  {.table = APC_TICK, .id = 3, .seq = 1}};
        struct apc_rows rows = {
            .size = sizeof rows, .sample = s, .n_samples = 3, .vector = v, .n_vectors = 3};
        struct apc_event e[3] = {
            {.severity = APC_EVENT_INFO}, {.severity = APC_EVENT_INFO}, {.severity = APC_EVENT_ALARM}};
        struct apc_timing_row r[3] = {{.quantity = "run"}, {.quantity = "jitter"}, {.quantity = "lateness"}};
        struct apc_tag t[3] = {{.table = APC_SENSOR}, {.table = APC_SENSOR}, {.table = APC_SENSOR}};
        taken(apc_store_append(&store, s, 3));
        taken(apc_store_append_events(&store, e, 3));
        taken(apc_store_append_timing(&store, r, 3));
        taken(apc_store_put_tags(&store, t, 3));
        taken(apc_store_read_rows(&store, &rows));
        v[bad].table = APC_SENSOR;
        char kind[64];
        snprintf(kind, sizeof kind, "sensor %d: the rows of this table are samples", bad + 1);
        refused(apc_store_read_rows(&store, &rows), kind);
        refused(apc_store_append_rows(&store, &rows), kind);
        v[bad].table = APC_TICK;
        s[bad].id = -7;
        const char *negative = "setpoint -7: an id must not be negative";
        refused(apc_store_read(&store, s, 3), negative);
        refused(apc_store_append(&store, s, 3), negative);
        refused(apc_store_put(&store, s, 3), negative);
        refused(apc_store_swap(&store, s, 3), negative);
        refused(apc_store_wait(&store, s, 3, 0), negative);
        refused(apc_store_claim_set(&store, s, 3), negative);
        refused(apc_store_release(&store, s, 3), negative);
        refused(apc_store_read_rows(&store, &rows), negative);
        refused(apc_store_append_rows(&store, &rows), negative);
        e[bad].severity = (enum apc_event_severity)(APC_EVENT_ALARM + 1);
        char text[64];
        snprintf(text, sizeof text, "%d is no severity of an event", (int)APC_EVENT_ALARM + 1);
        refused(apc_store_append_events(&store, e, 3), text);
        e[bad].severity = (enum apc_event_severity)0;
        refused(apc_store_append_events(&store, e, 3), "0 is no severity of an event");
        snprintf(r[bad].quantity, sizeof r[bad].quantity, "runs");
        refused_as(APC_ESTORE, apc_store_append_timing(&store, r, 3),
                   "\"runs\" is no quantity of a timing row");
        t[bad].length = -1;
        refused(apc_store_put_tags(&store, t, 3),
                "sensor 0: a period of 0 s, a step of 0 s and -1 elements: expected 0 or more");
    }
}

static void test_values_and_seqs_of_samples(void **state)
{
    (void)state;
    struct apc_sample s = {.table = APC_SENSOR, .id = 4, .seq = 1, .value = -9e299};
    struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1};
    taken(apc_store_append(&store, &s, 1));
    s.value = 1e300;
    const char *high = "sensor 4: value 1e+300 is not finite or not below 1e300";
    refused(apc_store_append(&store, &s, 1), high);
    refused(apc_store_put(&store, &s, 1), high);
    refused(apc_store_swap(&store, &s, 1), high);
    refused(apc_store_append_rows(&store, &rows), high);
    s.value = (double)NAN;
    refused(apc_store_append(&store, &s, 1), "sensor 4: value nan is not finite or not below 1e300");
    s.value = 0;
    s.seq = 0;
    refused(apc_store_append(&store, &s, 1), "sensor 4: seq counts from 1");
    refused(apc_store_append_rows(&store, &rows), "sensor 4: seq counts from 1");
    taken(apc_store_put(&store, &s, 1));
    taken(apc_store_swap(&store, &s, 1));
    s.seq = -1;
    refused(apc_store_swap(&store, &s, 1), "sensor 4: seq counts from 1");
    s.seq = 1;
    s.origin = -1;
    refused(apc_store_append(&store, &s, 1), "sensor 4: seq counts from 1");
    refused(apc_store_append_rows(&store, &rows), "sensor 4: seq counts from 1");
    s.origin = 0;
    s.table = APC_SETPOINT; /* many write it: from 0 on, or whatever is the newest */
    s.seq = 0;
    taken((s.seq = 0, apc_store_append_rows(&store, &rows)));
    taken((s.seq = APC_SEQ_ANY, apc_store_append_rows(&store, &rows)));
    s.seq = APC_SEQ_ANY - 1;
    refused(apc_store_append_rows(&store, &rows), "setpoint 4: seq counts from 1");
    s.seq = 3;
    s.origin = -1;
    refused(apc_store_append_rows(&store, &rows), "setpoint 4: seq counts from 1");
    s.origin = 0;
    s.value = (double)INFINITY;
    refused(apc_store_append_rows(&store, &rows), "setpoint 4: value inf is not finite or not below 1e300");
}

static void test_a_put_names_each_variable_once(void **state)
{
    (void)state;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < i; j++) {
            struct apc_sample s[3] = {{.table = APC_SETPOINT, .id = 1},
                                      {.table = APC_TUNING, .id = 1},
                                      {.table = APC_SETPOINT, .id = 2}};
            taken(apc_store_put(&store, s, 3));
            s[i] = s[j];
            char text[64];
            snprintf(text, sizeof text, "%s %d is given twice", apc_table_name(s[j].table), s[j].id);
            refused(apc_store_put(&store, s, 3), text);
            refused(apc_store_swap(&store, s, 3), text);
        }
    }
}

static void test_rows_say_their_size_and_what_they_point_to(void **state)
{
    (void)state;
    double value[2] = {1, 2};
    struct apc_vector v = {.table = APC_TICK, .id = 1, .seq = 1, .n = 2, .room = 2, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    char text[80];
    taken(apc_store_append_rows(&store, &rows));
    taken(apc_store_read_rows(&store, &rows));
    rows.size--;
    snprintf(text, sizeof text, "struct apc_rows must say its size, %zu bytes", sizeof rows);
    refused(apc_store_append_rows(&store, &rows), text);
    refused(apc_store_read_rows(&store, &rows), text);
    rows.size++;
    rows.n_samples = 2;
    refused(apc_store_append_rows(&store, &rows), "2 expected, but the array is NULL");
    rows.n_samples = 0;
    rows.vector = NULL;
    refused(apc_store_read_rows(&store, &rows), "1 expected, but the array is NULL");
    rows.n_vectors = 0;
    nothing_to_do(apc_store_read_rows(&store, &rows));
    nothing_to_do(apc_store_append_rows(&store, &rows));
    rows.vector = &v;
    rows.n_vectors = 1;
    v.value = NULL;
    refused(apc_store_read_rows(&store, &rows), "tick 1: its values are NULL");
    refused(apc_store_append_rows(&store, &rows), "tick 1: its 2 values are missing or more than 65536");
    v.n = v.room = 0;
    taken(apc_store_read_rows(&store, &rows));
    taken(apc_store_append_rows(&store, &rows));
    v.seq = 0;
    refused(apc_store_append_rows(&store, &rows), "tick 1: seq counts from 1");
    v.seq = 1;
    v.n = 2;
    v.value = value;
    value[1] = -1e300;
    refused(apc_store_append_rows(&store, &rows),
            "tick 1: element 1, -1e+300, is not finite or not below 1e300");
    value[1] = 2;
    value[0] = (double)NAN;
    refused(apc_store_append_rows(&store, &rows), "tick 1: element 0, nan, is not finite or not below 1e300");
    double *most = calloc(APC_ELEMENTS_MAX + 1, sizeof *most);
    assert_non_null(most);
    v.value = most;
    v.n = APC_ELEMENTS_MAX;
    taken(apc_store_append_rows(&store, &rows));
    v.n++;
    refused(apc_store_append_rows(&store, &rows), "tick 1: its 65537 values are missing or more than 65536");
    free(most);
}

static void test_rows_that_did_not_get_in_keep_their_seqs(void **state)
{
    (void)state;
    struct apc_sample s[20];
    for (size_t n = 1; n <= 20; n += n < 10 ? 9 : 10) { /* 1, 10, 20: each more than before */
        const struct apc_rows rows = {.size = sizeof rows, .sample = s, .n_samples = n};
        for (answer = -8; answer <= 1; answer++) {
            for (size_t i = 0; i < n; i++)
                s[i] = (struct apc_sample){.table = APC_SETPOINT, .id = (int)i, .seq = 5 + (int64_t)i};
            assert_int_equal(apc_store_append_rows(&store, &rows), answer);
            for (size_t i = 0; i < n; i++)
                assert_int_equal(s[i].seq, (answer < 0 ? 5 : 1000) + (int64_t)i);
        }
    }
    ops.spreads = false;
    n_described = APC_ETIMEDOUT; /* whose loops there are cannot be known */
    s[0] = (struct apc_sample){.table = APC_OPMODE, .id = 0, .seq = 5};
    const struct apc_rows rows = {.size = sizeof rows, .sample = s, .n_samples = 1};
    reached = 0;
    assert_int_equal(apc_store_append_rows(&store, &rows), APC_ETIMEDOUT);
    assert_int_equal(reached, 0);
    assert_int_equal(s[0].seq, 5);
}

/* ---- The mode of all ------------------------------------------------------------------------------- */

static struct apc_tag loop_tag(int id, const char *controller)
{
    struct apc_tag t = {.table = APC_OPMODE, .id = id};
    snprintf(t.controller, sizeof t.controller, "%s", controller);
    return t;
}

static void test_the_mode_of_all_is_for_each_loop_that_is_not_named(void **state)
{
    (void)state;
    struct apc_tag tags[] = {loop_tag(0, "all"),    loop_tag(1, "pi"),
                             loop_tag(2, "pi"),     loop_tag(3, ""),
                             loop_tag(65535, "x"),  loop_tag(4, "pi"),
                             loop_tag(65536, "pi"), {.table = APC_SENSOR, .id = 5, .controller = "pi"}};
    struct apc_sample s[3] = {
        {.table = APC_SETPOINT, .id = 1}, {.table = APC_OPMODE, .id = 2}, {.table = APC_OPMODE}};
    described = tags;
    n_described = sizeof tags / sizeof *tags;
    assert_int_equal(apc_store_put(&store, s, 3), 0);
    assert_int_equal(n_loops, 3);
    assert_true(loops[0] == 1 && loops[1] == 65535 && loops[2] == 4);
    assert_int_equal(apc_store_put(&store, s, 2), 0); /* each by itself */
    assert_int_equal(n_loops, 0);
    s[1].table = APC_SETPOINT; /* of another table is no name */
    s[1].id = 2;
    assert_int_equal(apc_store_swap(&store, s, 3), 0);
    assert_int_equal(n_loops, 4);
    ops.spreads = true; /* it does that by itself */
    assert_int_equal(apc_store_put(&store, s, 3), 0);
    assert_int_equal(n_loops, 0);
    ops.spreads = false;
    n_described = 1; /* fewer by now, and nothing of before */
    assert_int_equal(apc_store_put(&store, s, 3), 0);
    assert_int_equal(n_loops, 0);
    n_described = APC_ECONN;
    reached = 0;
    assert_int_equal(apc_store_put(&store, s, 3), APC_ECONN);
    assert_int_equal(apc_store_swap(&store, s, 3), APC_ECONN);
    assert_int_equal(reached, 0);
}

/* Between the two calls somebody describes more. */
static int get_more_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    (void)s;
    for (size_t i = 0; i < capacity; i++)
        tags[i] = described[i];
    return capacity == 0 ? 2 : n_described;
}

static void test_of_loops_there_are_no_more_than_were_asked_for(void **state)
{
    (void)state;
    struct apc_tag tags[] = {loop_tag(1, "pi"), loop_tag(2, "pi"), loop_tag(3, "pi")};
    struct apc_sample of_all = {.table = APC_OPMODE};
    described = tags;
    n_described = sizeof tags / sizeof *tags;
    ops.get_tags = get_more_tags;
    assert_int_equal(apc_store_put(&store, &of_all, 1), 0);
    assert_int_equal(n_loops, 2);
}

/* ---- Streams, bins, waits -------------------------------------------------------------------------- */

static void test_streams_have_bounds_and_a_function(void **state)
{
    (void)state;
    const struct apc_range many = {.last = (size_t)INT64_MAX + 1}, most = {.last = INT64_MAX},
                           before = {.after = -1};
    char text[60];
    snprintf(text, sizeof text, "the newest %zu rows are too many", many.last);
    const char *none = "no function to give the rows to", *one = "rows are counted from 1";
    refused(apc_store_history(&store, APC_SENSOR, 1, NULL, NULL, NULL), none);
    refused(apc_store_vectors(&store, APC_TICK, 1, NULL, NULL, NULL), none);
    refused(apc_store_events(&store, NULL, NULL, NULL), none);
    refused(apc_store_timing(&store, NULL, NULL, NULL), none);
    refused(apc_store_history(&store, APC_SENSOR, 1, &many, any_sample, NULL), text);
    refused(apc_store_vectors(&store, APC_TICK, 1, &many, any_vector, NULL), text);
    refused(apc_store_events(&store, &many, any_event, NULL), text);
    refused(apc_store_timing(&store, &many, any_timing, NULL), text);
    refused(apc_store_history(&store, APC_SENSOR, 1, &before, any_sample, NULL), one);
    refused(apc_store_vectors(&store, APC_TICK, 1, &before, any_vector, NULL), one);
    refused(apc_store_events(&store, &before, any_event, NULL), one);
    refused(apc_store_timing(&store, &before, any_timing, NULL), one);
    taken(apc_store_history(&store, APC_SENSOR, 1, &most, any_sample, NULL));
    taken(apc_store_vectors(&store, APC_TICK, 1, &most, any_vector, NULL));
    taken(apc_store_events(&store, &most, any_event, NULL));
    taken(apc_store_timing(&store, &most, any_timing, NULL));
    refused(apc_store_requests(&store, NULL, NULL), "no function to give the requests to");
    refused(apc_store_history_bins(&store, APC_SENSOR, 1, 0, 1, 1, NULL, NULL),
            "no function to give the bins to");
    refused(apc_store_history_bins(&store, APC_SENSOR, 1, 0, 1, 0, any_bin, NULL),
            "0 bins: expected 1 to 100000");
    refused(apc_store_history_bins(&store, APC_SENSOR, 1, 0, 1, 100001, any_bin, NULL),
            "100001 bins: expected 1 to 100000");
    refused(apc_store_history_bins(&store, APC_SENSOR, 1, 1, 1, 1, any_bin, NULL),
            "history must begin before it ends");
    taken(apc_store_history_bins(&store, APC_SENSOR, 1, 0, 1, 1, any_bin, NULL));
    taken(apc_store_history_bins(&store, APC_SENSOR, 1, 0, 1, 100000, any_bin, NULL));
    struct apc_sample s = {.table = APC_SENSOR};
    refused(apc_store_wait(&store, &s, 1, -1), "a wait must not be negative");
    refused(apc_store_wait(&store, NULL, 0, -1), "a wait must not be negative");
    taken(apc_store_wait(&store, &s, 1, 0));
}

/* ---- Descriptions ------------------------------------------------------------------------------------ */

static void test_a_tag_has_ranges_and_whiles(void **state)
{
    (void)state;
    static const struct {
        struct apc_tag tag;
        const char *sentence; /* NULL: it may be so */
    } cases[] = {
        {{.low = 1, .high = 0}, "sensor 7: limits 1 and 0 are no range"},
        {{.low = 0, .high = 2e300}, "sensor 7: limits 0 and 2e+300 are no range"},
        {{.low = -2e300, .high = 0}, "sensor 7: limits -2e+300 and 0 are no range"},
        {{.low = -1e300, .high = 1e300}, NULL},
        {{.low = 2, .high = 2}, NULL},
        {{.display_low = 1, .display_high = 0}, "sensor 7: a scale from 1 to 0 is none"},
        {{.display_low = 0, .display_high = 2e300}, "sensor 7: a scale from 0 to 2e+300 is none"},
        {{.display_low = -1e300, .display_high = 1e300}, NULL},
        {{.period = -1}, "sensor 7: a period of -1 s, a step of 0 s and 0 elements: expected 0 or more"},
        {{.period = 2e300},
         "sensor 7: a period of 2e+300 s, a step of 0 s and 0 elements: expected 0 or more"},
        {{.period = 1e300, .step = 1e300, .length = 1}, NULL},
        {{.step = -1}, "sensor 7: a period of 0 s, a step of -1 s and 0 elements: expected 0 or more"},
        {{.step = 2e300}, "sensor 7: a period of 0 s, a step of 2e+300 s and 0 elements: expected 0 or more"},
        {{.length = -1}, "sensor 7: a period of 0 s, a step of 0 s and -1 elements: expected 0 or more"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_tag tag = cases[i].tag;
        tag.table = APC_SENSOR;
        tag.id = 7;
        if (cases[i].sentence) {
            refused(apc_store_put_tags(&store, &tag, 1), cases[i].sentence);
            refused(apc_store_describe(&store, &tag, 1, "x"), cases[i].sentence);
        } else {
            taken(apc_store_put_tags(&store, &tag, 1));
        }
    }
    const struct apc_tag tag = {.table = APC_SENSOR, .id = -1};
    refused(apc_store_put_tags(&store, &tag, 1), "sensor -1: an id must not be negative");
}

static void test_a_catalogue_is_of_a_length(void **state)
{
    (void)state;
    char *text = malloc(APC_CATALOGUE_MAX + 2), small[4] = "abc";
    int64_t revision = 0;
    assert_non_null(text);
    memset(text, 'a', APC_CATALOGUE_MAX + 1);
    text[APC_CATALOGUE_MAX + 1] = '\0';
    refused(apc_store_describe(&store, NULL, 0, text), "a catalogue is 16777216 bytes long at most");
    text[APC_CATALOGUE_MAX] = '\0';
    taken(apc_store_describe(&store, NULL, 0, text));
    assert_string_equal(heard, "as it is");
    taken(apc_store_describe(&store, NULL, 0,
                             "a\xff"
                             "b"));
    assert_string_equal(heard, "clean");
    taken(apc_store_describe(&store, NULL, 0, NULL));
    assert_null(heard);
    taken(apc_store_catalogue(&store, small, sizeof small, &revision));
    assert_int_equal(revision, 3);
    assert_string_equal(small, ""); /* what was there before is no catalogue */
    taken(apc_store_catalogue(&store, NULL, 5, &revision));
    taken(apc_store_catalogue(&store, small, 0, NULL));
    free(text);
}

static void test_an_author_has_a_name(void **state)
{
    char name[APC_AUTHOR_LEN + 1], back[APC_AUTHOR_LEN];
    (void)state;
    memset(name, 'a', sizeof name);
    name[APC_AUTHOR_LEN] = '\0';
    refused(apc_store_author(&store, name), "an author's name has 1 to 63 bytes");
    refused(apc_store_author(&store, ""), "an author's name has 1 to 63 bytes");
    name[APC_AUTHOR_LEN - 1] = '\0';
    taken(apc_store_author(&store, name));
    taken(apc_store_author(&store, "a"));
    taken(apc_store_author(&store, "anna"));
    assert_string_equal(heard, "anna");
    memset(back, 'x', sizeof back);
    refused_as(APC_ENOTFOUND, apc_store_author_name(&store, 0, back), "there is no author 0");
    assert_string_equal(back, "");
    answer = APC_ENOTFOUND;
    assert_int_equal(apc_store_author_name(&store, 9, back), APC_ENOTFOUND);
    assert_string_equal(apc_store_error(&store), "there is no author 9");
}

/* ---- Timing, housekeeping, requests ------------------------------------------------------------------ */

static void test_a_timing_row_has_figures(void **state)
{
    static const int64_t bin[1] = {1};
    const char *buckets = "a timing row's buckets are missing or too many",
               *figures = "a timing row's figures are not finite or too large";
    (void)state;
    struct apc_timing_row good = {.quantity = "run",
                                  .missed = INT64_MAX,
                                  .count = INT64_MAX,
                                  .n_bins = 1,
                                  .bin_low = bin,
                                  .bin_high = bin,
                                  .bin_count = bin},
                          r = good;
    taken(apc_store_append_timing(&store, &r, 1));
    r.n_bins = MAX;
    taken(apc_store_append_timing(&store, &r, 1));
    r.n_bins = MAX + 1;
    refused(apc_store_append_timing(&store, &r, 1), buckets);
    for (int missing = 0; missing < 3; missing++) {
        r = good;
        *(missing == 0 ? &r.bin_low : missing == 1 ? &r.bin_high : &r.bin_count) = NULL;
        refused(apc_store_append_timing(&store, &r, 1), buckets);
        r.n_bins = 0;
        taken(apc_store_append_timing(&store, &r, 1));
    }
    r = good;
    r.mean = (double)NAN;
    refused(apc_store_append_timing(&store, &r, 1), figures);
    r = good;
    r.sd = (double)INFINITY;
    refused(apc_store_append_timing(&store, &r, 1), figures);
    r = good;
    r.missed++;
    refused(apc_store_append_timing(&store, &r, 1), figures);
    r = good;
    r.count++;
    refused(apc_store_append_timing(&store, &r, 1), figures);
    r = good;
    r.period = -1;
    refused_as(APC_ESTORE, apc_store_append_timing(&store, &r, 1), "a timing row's period is negative");
}

static void test_what_is_kept_is_kept_for_a_while(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct apc_retention keep = {.size = sizeof keep};
        taken(apc_store_maintain(&store, &keep));
        *(i == 0 ? &keep.samples : i == 1 ? &keep.events : i == 2 ? &keep.timing : &keep.ticks) = -1;
        refused(apc_store_maintain(&store, &keep), "a time to keep must not be negative");
    }
    refused(apc_store_forget(&store, 1), "only mem: forgets rows before they are old");
    const struct apc_retention keep = {.size = 3};
    refused(apc_store_maintain(&store, &keep), "apc_retention: size is 3: set it to sizeof the struct");
}

static int any_plant(void *ctx, const struct apc_store_plant *plant)
{
    (void)ctx;
    (void)plant;
    return 0;
}

static void test_requests_are_of_what_people_write(void **state)
{
    char text[8];
    const char *nobody = "nobody can be asked for that here";
    (void)state;
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END; table++) {
        struct apc_request r = {.table = table};
        if (table == APC_SETPOINT || table == APC_OPMODE || table == APC_TUNING || table == APC_MANUAL)
            taken(apc_store_ask(&store, &r));
        else
            refused(apc_store_ask(&store, &r), nobody);
    }
    refused(apc_store_ask(&store, &(struct apc_request){.table = APC_MANUAL, .variable = -1}), nobody);
    refused(apc_store_ask(&store, &(struct apc_request){.table = APC_MANUAL, .value = -1e300}), nobody);
    taken(apc_store_asked(&store, 1, text, sizeof text));
    refused(apc_store_asked(&store, 0, text, sizeof text), "there is no request 0");
    taken(apc_store_answer(&store, 1, APC_SEQ_MAX, "done"));
    assert_string_equal(heard, "text");
    taken(apc_store_answer(&store, 1, 0, NULL));
    assert_null(heard);
    refused(apc_store_answer(&store, 0, 1, NULL), "there is no request 0 to be answered");
    refused(apc_store_answer(&store, 2, -1, NULL), "there is no request 2 to be answered");
    refused(apc_store_answer(&store, 2, APC_SEQ_MAX + 1, NULL), "there is no request 2 to be answered");
    ops.ask = NULL;
    ops.asked = NULL;
    ops.answer = NULL;
    ops.requests = NULL;
    ops.keep_history = ops.is_history = NULL;
    ops.behind = NULL;
    refused(apc_store_ask(&store, &(struct apc_request){.table = APC_SETPOINT}), nobody);
    refused(apc_store_asked(&store, 1, text, sizeof text), "there is no request 1");
    refused(apc_store_answer(&store, 1, 0, NULL), "there is no request 1 to be answered");
    nothing_to_do(apc_store_requests(&store, any_request, NULL));
    nothing_to_do(apc_store_keep_history(&store));
    nothing_to_do(apc_store_is_history(&store));
    struct apc_behind behind = {.size = sizeof behind, .rows = 8};
    nothing_to_do(apc_store_behind(&store, &behind));
    assert_int_equal(behind.rows, 0);
    struct apc_store_room room = {.size = sizeof room, .refused = 8};
    nothing_to_do(apc_store_room(&store, &room));
    assert_int_equal(room.refused, 0);
    refused(apc_store_plants(&store, any_plant, NULL),
            "this store is of one plant: only a database has several");
    refused(apc_store_plants(&store, NULL, NULL), "no function to give the plants to");
}

/* ---- Of a handle ------------------------------------------------------------------------------------- */

static void test_a_handle_tells_of_itself(void **state)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    (void)state;
    apc_store_close(NULL);
    assert_string_equal(apc_store_error(NULL), "no store");
    assert_false(apc_store_connected(NULL));
    there = false;
    assert_false(apc_store_connected(&store));
    assert_int_equal(apc_store_tables_version(&store), 0);
    assert_int_equal(apc_store_tables_version(NULL), 0);
    there = true;
    assert_true(apc_store_connected(&store));
    assert_int_equal(apc_store_tables_version(&store), 77);
    ops.version = NULL;
    assert_int_equal(apc_store_tables_version(&store), apc_store_version());
    store.stats.round_trips = 12;
    apc_store_stats(&store, &stats);
    assert_int_equal(stats.round_trips, 12);
    apc_store_stats(NULL, &stats);
    assert_int_equal(stats.round_trips, 0);
    struct apc_behind behind = {.size = sizeof behind};
    assert_int_equal(apc_store_behind(&store, &behind), 0);
    assert_int_equal(behind.rows, 5);
    int64_t last[3] = {0};
    assert_int_equal(apc_store_claim(&store, APC_ACTUATOR, 3, last), 0);
    for (int i = 0; i < 3; i++)
        assert_int_equal(last[i], 10 * (i + 1) + (int)APC_ACTUATOR);
    answer = APC_EBUSY;
    assert_int_equal(apc_store_claim(&store, APC_ACTUATOR, 3, last), APC_EBUSY);
    reached = 0;
    apc_store_close(&store);
    assert_int_equal(reached, 1);
    store.seq = NULL;
    store.loop = NULL;
}

/* ---- Opening ------------------------------------------------------------------------------------------ */

#define not_opened(uri, options, sentence)                                                                   \
    do {                                                                                                     \
        struct apc_error not_why = {""};                                                                     \
        struct apc_store *not_store = &store;                                                                \
        assert_int_equal(apc_store_open(&not_store, uri, options, &not_why), APC_EINVAL);                    \
        assert_string_equal(not_why.text, sentence);                                                         \
        assert_null(not_store);                                                                              \
    } while (0)

static void test_what_is_opened_has_a_kind_and_options(void **state)
{
    const char *expected = "expected postgresql:, postgresql://..., sqlite:FILE, shm:NAME or mem:NAME";
    char text[200], scheme[80], uri[400];
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_store_open(NULL, "mem:", NULL, &why), APC_EINVAL);
    assert_string_equal(why.text, "nowhere to put the store");
    not_opened(NULL, NULL, "no store URI given; the simplest is sqlite:FILE");
    snprintf(text, sizeof text, "unknown store \"redis:\": %s", expected);
    not_opened("redis://host", NULL, text);
    snprintf(text, sizeof text, "unknown store \":\": %s", expected);
    not_opened(":x", NULL, text);
    memset(scheme, 'x', sizeof scheme);
    snprintf(scheme + 31, sizeof scheme - 31, ":y");
    snprintf(text, sizeof text, "unknown store \"%.32s\": %s", scheme, expected);
    not_opened(scheme, NULL, text);
    memset(scheme, 'x', sizeof scheme);
    snprintf(scheme + 32, sizeof scheme - 32, ":y");
    snprintf(text, sizeof text, "the name of a store does not begin with its kind: %s", expected);
    not_opened(scheme, NULL, text);
    not_opened("file.db", NULL, text);
    not_opened("joe@host:secret", NULL, text);
    not_opened("", NULL, text);
    not_opened("mem:a+redis", NULL, text);
    memset(uri, 'a', sizeof uri);
    memcpy(uri, "mem:", 4);
    snprintf(uri + 256, sizeof uri - 256, "+mem:b");
    not_opened(uri, NULL, "the live store's name before '+' is too long");
    const char *negative = "a store's timeout and pauses must not be negative";
    struct apc_store_options o = {.size = sizeof o, .timeout = -1};
    not_opened("mem:", &o, negative);
    o = (struct apc_store_options){.size = sizeof o, .backoff_min = -1};
    not_opened("mem:", &o, negative);
    o = (struct apc_store_options){.size = sizeof o, .backoff_max = -1};
    not_opened("mem:", &o, negative);
    o = (struct apc_store_options){.size = sizeof o, .backoff_min = 9, .backoff_max = 8};
    not_opened("mem:", &o, "the longest pause between connects is shorter than the first one");
    o = (struct apc_store_options){.size = sizeof o, .backoff_min = 6 * APC_NS_PER_S};
    not_opened("mem:", &o, "the longest pause between connects is shorter than the first one");
}

static void test_what_is_not_said_has_a_default(void **state)
{
    static const struct {
        struct apc_store_options given;
        struct apc_store_config got;
    } cases[] = {
        {{0}, {"libapc", 2 * APC_NS_PER_S, 100 * APC_NS_PER_MS, 5 * APC_NS_PER_S, false, false}},
        {{.name = ""}, {"libapc", 2 * APC_NS_PER_S, 100 * APC_NS_PER_MS, 5 * APC_NS_PER_S, false, false}},
        {{.name = "n",
          .timeout = 1,
          .backoff_min = 3,
          .backoff_max = 3,
          .chunks = true,
          .spool_or_memory = true},
         {"n", 1, 3, 3, true, true}},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_store_options o = cases[i].given;
        struct apc_store *s = NULL;
        o.size = sizeof o;
        assert_int_equal(apc_store_open(&s, "mem:", &o, NULL), 0);
        configured = s->config;
        assert_string_equal(configured.name, cases[i].got.name);
        assert_int_equal(configured.timeout, cases[i].got.timeout);
        assert_int_equal(configured.backoff_min, cases[i].got.backoff_min);
        assert_int_equal(configured.backoff_max, cases[i].got.backoff_max);
        assert_int_equal(configured.chunks, cases[i].got.chunks);
        assert_int_equal(configured.spool_or_memory, cases[i].got.spool_or_memory);
        apc_store_close(s);
    }
}

static void test_the_live_part_of_a_name_ends_at_the_plus(void **state)
{
    (void)state;
    assert_int_equal(apc_store_live("mem:a+sqlite:b"), 5);
    assert_int_equal(apc_store_live("shm:a+b"), 5);
    assert_int_equal(apc_store_live("mem:a"), 5);
    assert_int_equal(apc_store_live("sqlite:a+b"), 10);
    assert_int_equal(apc_store_live("postgresql:dbname=a+b"), 21);
    struct apc_store *s = NULL;
    char uri[300] = "mem:live+mem:history";
    assert_int_equal(apc_store_open(&s, uri, NULL, NULL), 0);
    apc_store_close(s);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_each_function_needs_a_store_and_tells_what_it_says),
        T(test_how_many_at_once_and_from_where),
        T(test_a_row_is_of_a_table_of_its_kind_and_of_an_id),
        T(test_of_many_rows_each_is_looked_at),
        T(test_values_and_seqs_of_samples),
        T(test_a_put_names_each_variable_once),
        T(test_rows_say_their_size_and_what_they_point_to),
        T(test_rows_that_did_not_get_in_keep_their_seqs),
        T(test_the_mode_of_all_is_for_each_loop_that_is_not_named),
        T(test_of_loops_there_are_no_more_than_were_asked_for),
        T(test_streams_have_bounds_and_a_function),
        T(test_a_tag_has_ranges_and_whiles),
        T(test_a_catalogue_is_of_a_length),
        T(test_an_author_has_a_name),
        T(test_a_timing_row_has_figures),
        T(test_what_is_kept_is_kept_for_a_while),
        T(test_requests_are_of_what_people_write),
        T(test_a_handle_tells_of_itself),
        T(test_what_is_opened_has_a_kind_and_options),
        T(test_what_is_not_said_has_a_default),
        T(test_the_live_part_of_a_name_ends_at_the_plus),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
