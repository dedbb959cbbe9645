/* SPDX-License-Identifier: BSD-3-Clause */
/* What every store must do: tags, the catalogue, authors, events, timing. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "comma_locale.h"
#include "shareddata/shareddata_internal.h"
#include "stores.h"

/* ---- Tags, events, timing ---------------------------------------------------------------------- */

static void test_tags_come_back_in_order(void **state)
{
    struct apc_tag in[3] = {
        {.table = APC_SETPOINT, .id = 1, .name = "TIC-1", .unit = "K", .low = 0, .high = 20},
        {.table = APC_SENSOR,
         .id = 2,
         .name = "TT-2",
         .low = -APC_VALUE_MAX,
         .high = APC_VALUE_MAX,
         .controller = "upper",
         .area = "unit1/reactor",
         .display_low = -1.5,
         .display_high = 2.5,
         .period = APC_VALUE_MAX,
         .step = 0.5,
         .length = 40},
        {.table = APC_SENSOR,
         .id = 1,
         .name = "TIC-1",
         .unit = "\xc2\xb0"
                 "C",
         .description = "O'Brien's; \"tank\"",
         .low = -5,
         .high = 5},
    };
    assert_int_equal(apc_store_put_tags(*state, in, 3), 3);
    struct apc_tag out[2];
    assert_int_equal(apc_store_get_tags(*state, out, 2), 3); /* all in all */
    assert_int_equal(out[0].table, APC_SENSOR);
    assert_int_equal(out[0].id, 1);
    assert_string_equal(out[0].name, "TIC-1");
    assert_string_equal(out[0].unit, "\xc2\xb0"
                                     "C");
    assert_string_equal(out[0].description, "O'Brien's; \"tank\"");
    assert_int_equal(out[1].id, 2);
    assert_near(out[1].high, 1e300, 0);
    assert_string_equal(out[1].controller, "upper");
    assert_string_equal(out[1].area, "unit1/reactor");
    assert_near(out[1].display_low, -1.5, 0);
    assert_near(out[1].display_high, 2.5, 0);
    assert_near(out[1].period, APC_VALUE_MAX, 0);
    assert_near(out[1].step, 0.5, 0);
    assert_int_equal(out[1].length, 40);
    assert_string_equal(out[0].controller, "");
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 3);
}

static void test_tags_are_replaced_as_a_whole_and_may_change_names(void **state)
{
    struct apc_tag in[3] = {{.table = APC_SENSOR, .id = 1, .name = "A", .high = 1},
                            {.table = APC_SENSOR, .id = 2, .name = "B", .high = 2},
                            {.table = APC_SETPOINT, .id = 1, .name = "A", .high = 3}};
    assert_int_equal(apc_store_put_tags(*state, in, 3), 3);
    struct apc_tag swapped[2] = {in[0], in[1]}, out[3];
    swapped[0].id = 2;
    swapped[1].id = 1;
    assert_int_equal(apc_store_put_tags(*state, swapped, 2), 2);
    assert_int_equal(apc_store_get_tags(*state, out, 3), 2); /* the setpoint's has gone */
    assert_string_equal(out[0].name, "B");
    assert_near(out[0].high, 2, 0);
    assert_string_equal(out[1].name, "A");

    in[1].name[0] = 'A'; /* twice in one table */
    assert_int_equal(apc_store_put_tags(*state, in, 3), APC_ESTORE);
    in[1] = in[0]; /* the same variable twice */
    assert_int_equal(apc_store_put_tags(*state, in, 2), APC_ESTORE);
    in[0].low = 2; /* limits upside down */
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    in[0].low = 0;
    in[0].display_low = (double)NAN;
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    in[0].display_low = 0;
    in[0].period = -1;
    assert_int_equal(apc_store_put_tags(*state, in, 1), APC_EINVAL);
    assert_int_equal(apc_store_get_tags(*state, out, 3), 2); /* nothing half done */
    assert_string_equal(out[0].name, "B");

    assert_int_equal(apc_store_put_tags(*state, NULL, 0), 0);
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 0);
}

/* Of twelve, in three tables, in any order. */
static void test_a_name_is_found_twice_wherever_it_stands(void **state)
{
    static const enum apc_table tables[] = {APC_SENSOR, APC_ACTUATOR, APC_SETPOINT};
    struct apc_tag tag[12] = {{0}};
    for (int i = 0; i < 12; i++) {
        tag[i] = (struct apc_tag){.table = tables[i % 3], .id = 1 + i / 3, .high = 1};
        snprintf(tag[i].name, sizeof tag[i].name, "%c", 'a' + i / 3);
    }
    assert_int_equal(apc_store_put_tags(*state, tag, 12), 12); /* the same ones, each in its table */
    for (int i = 0; i < 12; i++) {
        for (int k = i % 3; k < i; k += 3) { /* of the same table */
            char kept = tag[i].name[0];
            tag[i].name[0] = tag[k].name[0];
            assert_int_equal(apc_store_put_tags(*state, tag, 12), APC_ESTORE);
            tag[i].name[0] = kept;
            int id = tag[i].id;
            tag[i].id = tag[k].id;
            assert_int_equal(apc_store_put_tags(*state, tag, 12), APC_ESTORE);
            tag[i].id = id;
        }
    }
    assert_int_equal(apc_store_get_tags(*state, NULL, 0), 12);
}

static int keep_event(void *ctx, const struct apc_event *e)
{
    struct apc_event **next = ctx;
    *(*next)++ = *e;
    return 0;
}

/*
 * Promise(stores/plant-stands-every): What the plant is stands in every store, each text a revision; a
 *   number says who wrote a row, and stays.
 */
static void test_the_catalogue_comes_with_the_tags_and_each_text_is_a_revision(void **state)
{
    struct apc_store *store = *state;
    const struct apc_tag tag[2] = {{.table = APC_SENSOR, .id = 1, .name = "A"},
                                   {.table = APC_SENSOR, .id = 2, .name = "A"}};
    static const char text[] = "name = \"tank\"; # 20 \xc2\xb0"
                               "C\n";
    char out[64];
    int64_t revision = 7;
    memset(out, 'x', sizeof out);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 0); /* none */
    assert_string_equal(out, "");
    assert_int_equal(revision, 0);
    assert_int_equal(apc_store_describe(store, tag, 1, text), 1);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), sizeof text - 1);
    assert_string_equal(out, text);
    assert_int_equal(revision, 1);
    assert_int_equal(apc_store_describe(store, tag, 1, text), 1); /* as it was */
    assert_int_equal(apc_store_put_tags(store, tag, 1), 1);
    assert_int_equal(apc_store_describe(store, tag, 2, "b"), APC_ESTORE); /* tags that are none: no text */
    assert_int_equal(apc_store_catalogue(store, NULL, 0, &revision), sizeof text - 1);
    assert_int_equal(revision, 1);

    for (size_t size = 1; size < sizeof text; size++) { /* as much as there is room for */
        memset(out, 'x', sizeof out);
        assert_int_equal(apc_store_catalogue(store, out, size, NULL), sizeof text - 1);
        assert_int_equal(strlen(out), size - 1);
        assert_memory_equal(out, text, size - 1);
        assert_int_equal(out[size], 'x');
    }
    assert_int_equal(apc_store_describe(store, NULL, 0,
                                        "\xff"
                                        "b"),
                     0);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 2);
    assert_string_equal(out, "?b"); /* a byte that is no character */
    assert_int_equal(revision, 2);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), 0);
    assert_int_equal(apc_store_describe(store, tag, 1, ""), 1);
    assert_int_equal(apc_store_catalogue(store, out, sizeof out, &revision), 0);
    assert_int_equal(revision, 3);

    struct apc_store *other = stores_open(); /* for all who use it */
    assert_int_equal(apc_store_catalogue(other, NULL, 0, &revision), 0);
    assert_int_equal(revision, 3);
    apc_store_close(other);
}

/* Promise(stores/plant-stands-every) */
static void test_a_catalogue_of_many_bytes_is_whole_or_refused(void **state)
{
    struct apc_store *store = *state;
    enum { LENGTH = 200001 };
    char *text = malloc(APC_CATALOGUE_MAX + 2), *out = malloc(LENGTH + 1);
    assert_true(text && out);
    memset(text, 'a', APC_CATALOGUE_MAX + 1);
    for (size_t i = 0; i < LENGTH; i++) {
        text[i] = (char)('a' + i % 26);
    }
    text[APC_CATALOGUE_MAX + 1] = '\0';
    assert_int_equal(apc_store_describe(store, NULL, 0, text), APC_EINVAL);
    text[LENGTH] = '\0';
    assert_int_equal(apc_store_describe(store, NULL, 0, text), 0);
    assert_int_equal(apc_store_catalogue(store, out, LENGTH + 1, NULL), LENGTH);
    assert_string_equal(out, text);
    free(text);
    free(out);
}

static int keep_first(void *ctx, const struct apc_sample *s)
{
    *(struct apc_sample *)ctx = *s;
    return 1;
}

/* Promise(stores/plant-stands-every) */
static void test_an_author_has_a_number_that_stays(void **state)
{
    struct apc_store *store = *state, *other = stores_open();
    char name[APC_AUTHOR_LEN], longest[APC_AUTHOR_LEN + 1];
    const int anna = apc_store_author(store, "anna"), bert = apc_store_author(other, "bert");
    assert_true(anna > 0 && bert > 0 && anna != bert);
    assert_int_equal(apc_store_author(other, "anna"), anna);
    ok(store, apc_store_author_name(store, (uint32_t)bert, name));
    assert_string_equal(name, "bert");
    assert_int_equal(apc_store_author_name(store, 0, name), APC_ENOTFOUND);
    assert_string_equal(name, "");
    assert_int_equal(apc_store_author_name(store, 2000000000, name), APC_ENOTFOUND);
    memset(longest, 'a', sizeof longest);
    longest[APC_AUTHOR_LEN] = '\0';
    assert_int_equal(apc_store_author(store, longest), APC_EINVAL);
    assert_int_equal(apc_store_author(store, ""), APC_EINVAL);
    assert_int_equal(apc_store_author(store, NULL), APC_EINVAL);
    longest[APC_AUTHOR_LEN - 1] = '\0';
    const int last = apc_store_author(store, longest);
    assert_true(last > 0);
    ok(other, apc_store_author_name(other, (uint32_t)last, name));
    assert_string_equal(name, longest);

    struct apc_sample s = sample(APC_SETPOINT, 1, 0, 3); /* and stands in what he writes */
    s.author = (uint32_t)anna;
    ok(store, apc_store_put(store, &s, 1));
    s.author = (uint32_t)bert;
    ok(store, apc_store_swap(store, &s, 1));
    assert_int_equal(newest(other, APC_SETPOINT, 1).author, bert);
    struct apc_sample first = {.seq = 0};
    assert_int_equal(apc_store_history(other, APC_SETPOINT, 1, NULL, keep_first, &first), 1);
    assert_int_equal(first.author, anna);
    apc_store_close(other);
}

static void test_events_come_back_in_order(void **state)
{
    const struct apc_event in[3] = {
        {.time = 1000,
         .severity = APC_EVENT_INFO,
         .source = "operator",
         .kind = "mode",
         .text = "Man -> Auto"},
        {.time = 3000,
         .severity = APC_EVENT_ALARM,
         .source = "apc-plant",
         .kind = "watchdog",
         .text = "it's \xc3\xa4 \xff cut"},
        {.time = 2000, .severity = APC_EVENT_WARNING, .source = "apc-client", .kind = "link", .text = ""},
    };
    assert_int_equal(apc_store_append_events(*state, in, 3), 3);
    struct apc_event out[3], *next = out;
    assert_int_equal(apc_store_events(*state, NULL, keep_event, &next), 3);
    assert_true(out[0].time == 1000 && out[1].time == 3000 && out[2].time == 2000);
    assert_int_equal(out[1].severity, APC_EVENT_ALARM);
    assert_string_equal(out[0].source, "operator");
    assert_string_equal(out[0].kind, "mode");
    assert_string_equal(out[0].text, "Man -> Auto");
    assert_string_equal(out[1].text, "it's \xc3\xa4 ? cut"); /* not lost for one bad byte */
    next = out;
    assert_int_equal(apc_store_events(*state, &(struct apc_range){.last = 2}, keep_event, &next), 2);
    assert_true(out[0].time == 3000 && out[1].time == 2000);
    next = out;
    assert_int_equal(
        apc_store_events(*state, &(struct apc_range){.since = 2000, .until = 3000}, keep_event, &next), 1);
    assert_string_equal(out[0].source, "apc-client");
    struct apc_event bad = {.severity = (enum apc_event_severity)9};
    assert_int_equal(apc_store_append_events(*state, &bad, 1), APC_EINVAL);
}

/* Every length of UTF-8 at both ends of what is well-formed, and just beyond. */
/* Promise(incoming/text-of-others) */
static void test_a_text_keeps_its_characters_and_no_other_byte(void **state)
{
    static const struct {
        const char *in, *out;
    } texts[] = {{"\x7e", "\x7e"},
                 {"\xc2\xa0", "\xc2\xa0"},
                 {"two\nlines\r\n\tthree\xe2\x80\xa8", "two lines   three "},
                 {"\x1b[2J\x7f", "?[2J?"},
                 {"\xc2\x9b[31m", "?[31m"},
                 {"a\xe2\x80\xae"
                  "b\xe2\x81\xa9"
                  "c\xd8\x9c",
                  "a?b?c?"},
                 {"\xdf\xbf", "\xdf\xbf"},
                 {"\xe0\xa0\x80", "\xe0\xa0\x80"},
                 {"\xed\x9f\xbf", "\xed\x9f\xbf"},
                 {"\xef\xbf\xbd", "\xef\xbf\xbd"},
                 {"\xf0\x90\x80\x80", "\xf0\x90\x80\x80"},
                 {"\xf4\x8f\xbf\xbd", "\xf4\x8f\xbf\xbd"},
                 {"\x80", "?"},
                 {"\xbf", "?"},
                 {"\xc0\x80", "??"},
                 {"\xc1\xbf", "??"},
                 {"\xc2", "?"},
                 {"\xc2z", "?z"},
                 {"\xe0\x9f\xbf", "???"},
                 {"\xed\xa0\x80", "???"},
                 {"\xe1\x80z", "??z"},
                 {"\xf0\x8f\xbf\xbf", "????"},
                 {"\xf4\x90\x80\x80", "????"},
                 {"\xf1\x80\x80", "???"},
                 {"\xf5\x80\x80\x80", "????"},
                 {"\xff\xfe", "??"}};
    enum { N = sizeof texts / sizeof texts[0] };
    struct apc_event in[N], out[N], *next = out;
    for (int i = 0; i < N; i++) {
        in[i] = (struct apc_event){.time = 1000, .severity = APC_EVENT_INFO, .source = "s", .kind = "k"};
        snprintf(in[i].text, sizeof in[i].text, "%s", texts[i].in);
    }
    assert_int_equal(apc_store_append_events(*state, in, N), N);
    assert_int_equal(apc_store_events(*state, NULL, keep_event, &next), N);
    for (int i = 0; i < N; i++) {
        assert_string_equal(out[i].text, texts[i].out);
    }
}

static int keep_task(void *ctx, const struct apc_timing_row *row)
{
    snprintf(ctx, sizeof row->task, "%s", row->task);
    return 0;
}

/* Who writes, what is described, and which task was measured is shown in one line too; a catalogue has its
 * lines. */
/* Promise(incoming/text-of-others) */
static void test_names_are_one_line_that_shows_as_it_is(void **state)
{
    struct apc_store *store = *state;
    const struct apc_tag tag = {.table = APC_SENSOR,
                                .id = 1,
                                .name = "y\n1",
                                .unit = "\x1b[2J",
                                .description = "level\xe2\x80\xae",
                                .controller = "\xc2\x9b",
                                .area = "a\tb",
                                .high = 1};
    const struct apc_timing_row row = {.time = 1000, .task = "client\n\x1b", .quantity = "run", .period = 1};
    struct apc_tag is;
    char name[APC_AUTHOR_LEN], text[40], task[sizeof row.task] = "";
    const int author = apc_store_author(store, "anna\n\x1b[31m");
    assert_true(author > 0);
    ok(store, apc_store_author_name(store, (uint32_t)author, name));
    assert_string_equal(name, "anna ?[31m");
    assert_int_equal(apc_store_author(store, "anna ?[31m"), author);
    ok(store, apc_store_describe(store, &tag, 1, "a = 1;\n\tb = \"\x1b\";\n"));
    assert_int_equal(apc_store_get_tags(store, &is, 1), 1);
    assert_string_equal(is.name, "y 1");
    assert_string_equal(is.unit, "?[2J");
    assert_string_equal(is.description, "level?");
    assert_string_equal(is.controller, "?");
    assert_string_equal(is.area, "a b");
    assert_true(apc_store_catalogue(store, text, sizeof text, NULL) > 0);
    assert_string_equal(text, "a = 1;\n\tb = \"?\";\n");
    ok(store, apc_store_append_timing(store, &row, 1));
    assert_int_equal(apc_store_timing(store, NULL, keep_task, task), 1);
    assert_string_equal(task, "client ?");
}

struct timings {
    struct apc_timing_row rows[4];
    int64_t bins[4][3];
    size_t n;
};

static int keep_timing(void *ctx, const struct apc_timing_row *row)
{
    struct timings *t = ctx;
    if (row->n_bins == 2) {
        t->bins[t->n][0] = row->bin_low[1];
        t->bins[t->n][1] = row->bin_high[1];
        t->bins[t->n][2] = row->bin_count[1];
    }
    t->rows[t->n++] = *row;
    return 0;
}

static void test_timing_rows_come_back_with_their_buckets(void **state)
{
    int64_t low[2] = {-5, 10}, high[2] = {10, 20}, count[2] = {3, 4};
    const struct apc_timing_row in[2] = {
        {.time = 5000,
         .task = "controller",
         .quantity = "jitter",
         .period = 2000000000,
         .missed = 1,
         .count = 7,
         .mean = -0.25,
         .sd = 1.5,
         .p50 = -3,
         .p99 = 15,
         .max = 19,
         .bin_low = low,
         .bin_high = high,
         .bin_count = count,
         .n_bins = 2},
        {.time = 4000, .task = "client", .quantity = "run"},
    };
    assert_int_equal(apc_store_append_timing(*state, in, 2), 2);
    low[1] = high[1] = count[1] = 0; /* the store has its own by now */
    struct timings t = {0};
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 2);
    assert_string_equal(t.rows[0].task, "client"); /* by time */
    assert_int_equal(t.rows[0].n_bins, 0);
    assert_string_equal(t.rows[1].quantity, "jitter");
    assert_true(t.rows[1].period == 2000000000 && t.rows[1].missed == 1 && t.rows[1].count == 7);
    assert_true(t.rows[1].p50 == -3 && t.rows[1].p99 == 15 && t.rows[1].max == 19);
    assert_near(t.rows[1].mean, -0.25, 0);
    assert_near(t.rows[1].sd, 1.5, 0);
    assert_true(t.bins[1][0] == 10 && t.bins[1][1] == 20 && t.bins[1][2] == 4);
    struct timings newest_one = {0};
    assert_int_equal(apc_store_timing(*state, &(struct apc_range){.last = 1}, keep_timing, &newest_one), 1);
    assert_string_equal(newest_one.rows[0].task, "controller");
}

static void test_a_timing_row_is_of_a_task_s_quantity_or_refused_with_all_the_others(void **state)
{
    const int64_t edge[1] = {1};
    const struct apc_timing_row
        good = {.time = 1000, .task = "t", .quantity = "lateness", .period = 1},
        bad[] = {
            {.task = "t", .quantity = "speed"},
            {.task = "t", .quantity = "latenes"},
            {.task = "t", .quantity = ""},
            {.task = "t", .quantity = "run", .period = -1},
            {.task = "t", .quantity = "run", .mean = (double)NAN},
            {.task = "t", .quantity = "run", .sd = HUGE_VAL},
            {.task = "t", .quantity = "run", .missed = UINT64_MAX},
            {.task = "t", .quantity = "run", .count = UINT64_MAX},
            {.task = "t", .quantity = "run", .missed = (uint64_t)INT64_MAX + 1},
            {.task = "t", .quantity = "run", .count = (uint64_t)INT64_MAX + 1},
            {.task = "t", .quantity = "run", .n_bins = 1},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_high = edge, .bin_count = edge},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_low = edge, .bin_count = edge},
            {.task = "t", .quantity = "run", .n_bins = 1, .bin_low = edge, .bin_high = edge},
        };
    struct timings t = {0};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        for (int at = 0; at < 3; at++) {
            struct apc_timing_row rows[3] = {good, good, good};
            rows[at] = bad[i];
            assert_true(apc_store_append_timing(*state, rows, 3) < 0);
            assert_true(apc_store_append_timing(*state, rows + at, 1) < 0);
        }
    }
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 0);
    assert_int_equal(apc_store_append_timing(*state, &good, 1), 1);
    const struct apc_timing_row most = {
        .task = "t", .quantity = "run", .missed = INT64_MAX, .count = INT64_MAX};
    assert_int_equal(apc_store_append_timing(*state, &most, 1), 1);
    assert_int_equal(apc_store_append_timing(*state, NULL, 0), 0);
    assert_int_equal(apc_store_append_timing(*state, NULL, 1), APC_EINVAL);
    assert_int_equal(apc_store_timing(*state, NULL, keep_timing, &t), 2);
    assert_true(t.rows[0].missed == INT64_MAX && t.rows[0].count == INT64_MAX); /* by time */
    assert_string_equal(t.rows[1].quantity, "lateness");
    assert_int_equal(t.rows[1].period, 1);
}

/* Row i of time i * 7 % N, but the last, which is of the same time as the one before it; i % 4 buckets. */
enum { TIMINGS = 150 };

static int timing_number(apc_ns time)
{
    for (int i = 0; i < TIMINGS - 1; i++) {
        if (i * 7 % TIMINGS == time / 1000) {
            return i;
        }
    }
    return -1;
}

struct walk {
    apc_ns last;
    int given, most, twins;
};

static int check_timing(void *ctx, const struct apc_timing_row *row)
{
    struct walk *w = ctx;
    const bool twin = w->given > 0 && row->time == w->last;
    const int i = twin ? TIMINGS - 1 : timing_number(row->time);
    assert_true(w->given == 0 || row->time >= w->last);
    w->last = row->time;
    w->twins += twin;
    assert_int_equal(row->count, i); /* of two of one time the one that came first is first */
    assert_int_equal(row->n_bins, i % 4);
    for (int b = 0; b < i % 4; b++) {
        assert_true(row->bin_low[b] == 10 * b + i && row->bin_high[b] == 10 * b + i + 9 &&
                    row->bin_count[b] == b + 1);
    }
    return ++w->given == w->most;
}

static void test_timing_rows_come_in_order_of_time_within_their_bounds(void **state)
{
    static int64_t low[TIMINGS][4], high[TIMINGS][4];
    static const int64_t count[4] = {1, 2, 3, 4};
    static struct apc_timing_row rows[TIMINGS];
    for (int i = 0; i < TIMINGS; i++) {
        for (int b = 0; b < 4; b++) {
            low[i][b] = 10 * b + i;
            high[i][b] = low[i][b] + 9;
        }
        const int k = i < TIMINGS - 1 ? i : i - 1;
        rows[i] = (struct apc_timing_row){.time = k * 7 % TIMINGS * 1000,
                                          .task = "t",
                                          .quantity = "run",
                                          .count = (uint64_t)i,
                                          .bin_low = low[i],
                                          .bin_high = high[i],
                                          .bin_count = count,
                                          .n_bins = (size_t)(i % 4)};
    }
    assert_int_equal(apc_store_append_timing(*state, rows, 40), 40);
    assert_int_equal(apc_store_append_timing(*state, rows + 40, TIMINGS - 40), TIMINGS - 40);
    struct walk w = {0};
    assert_int_equal(apc_store_timing(*state, NULL, check_timing, &w), TIMINGS);
    assert_int_equal(w.twins, 1);
    const struct {
        struct apc_range range;
        int given;
        apc_ns last;
    } cases[] = {
        {{.since = 5000, .until = 9000}, 4, 8000},
        {{.until = 9000, .last = 2}, 2, 8000},
        {{.since = 140000, .last = 99}, 9, 149000},
        {{.since = 150000}, 0, 0},
        {{.last = 1}, 1, 149000},
        {{.last = TIMINGS + 1}, TIMINGS, 149000},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        w = (struct walk){0};
        assert_int_equal(apc_store_timing(*state, &cases[i].range, check_timing, &w), cases[i].given);
        assert_int_equal(w.given, cases[i].given);
        assert_int_equal(w.last, cases[i].last);
    }
    w = (struct walk){.most = 3};
    assert_int_equal(apc_store_timing(*state, NULL, check_timing, &w), 3);
    assert_int_equal(w.given, 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_name_is_found_twice_wherever_it_stands),
        T(test_tags_come_back_in_order),
        T(test_tags_are_replaced_as_a_whole_and_may_change_names),
        T(test_the_catalogue_comes_with_the_tags_and_each_text_is_a_revision),
        T(test_a_catalogue_of_many_bytes_is_whole_or_refused),
        T(test_an_author_has_a_number_that_stays),
        T(test_events_come_back_in_order),
        T(test_a_text_keeps_its_characters_and_no_other_byte),
        T(test_names_are_one_line_that_shows_as_it_is),
        T(test_timing_rows_come_back_with_their_buckets),
        T(test_a_timing_row_is_of_a_task_s_quantity_or_refused_with_all_the_others),
        T(test_timing_rows_come_in_order_of_time_within_their_bounds),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
