/* SPDX-License-Identifier: BSD-3-Clause */
/* A store that does nothing but count what arrives, and answers as it is told. To be included by one file. */
#ifndef APC_TEST_COUNTING_STORE_H
#define APC_TEST_COUNTING_STORE_H

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "shareddata/shareddata_internal.h"

static int reached, answer;
static const char *heard; /* the text that came with it */
static bool there;
static struct apc_tag *described; /* the tags it has */
static int n_described;
static size_t n_loops;
static int loops[8];

static int arrive(void)
{
    reached++;
    return answer;
}

static void do_close(struct apc_store *s)
{
    (void)s;
    reached++;
}

static bool do_connected(const struct apc_store *s)
{
    (void)s;
    return there;
}

static int do_version(const struct apc_store *s)
{
    (void)s;
    return 77;
}

static int do_connect(struct apc_store *s)
{
    (void)s;
    return arrive();
}

static int do_read(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    (void)s, (void)samples, (void)n;
    return arrive();
}

static int do_append(struct apc_store *s, const struct apc_sample *samples, size_t n)
{
    (void)s, (void)samples, (void)n;
    return arrive();
}

static int do_put(struct apc_store *s, struct apc_sample *samples, size_t n)
{
    (void)samples, (void)n;
    n_loops = s->n_loops;
    for (size_t i = 0; i < n_loops && i < 8; i++)
        loops[i] = s->loop[i].id;
    return arrive();
}

static int do_wait(struct apc_store *s, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    (void)s, (void)seen, (void)n, (void)timeout;
    return arrive();
}

static int do_history(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_sample_fn fn, void *ctx)
{
    (void)s, (void)table, (void)id, (void)fn, (void)ctx;
    assert_non_null(range);
    return arrive();
}

static int do_vectors(struct apc_store *s, enum apc_table table, int id, const struct apc_range *range,
                      apc_vector_fn fn, void *ctx)
{
    (void)s, (void)table, (void)id, (void)fn, (void)ctx;
    assert_non_null(range);
    return arrive();
}

static int do_bins(struct apc_store *s, enum apc_table table, int id, apc_ns since, apc_ns until, size_t n,
                   apc_history_bin_fn fn, void *ctx)
{
    (void)s, (void)table, (void)id, (void)since, (void)until, (void)n, (void)fn, (void)ctx;
    return arrive();
}

static int do_get_tags(struct apc_store *s, struct apc_tag *tags, size_t capacity)
{
    (void)s;
    for (size_t i = 0; i < capacity && (int)i < n_described; i++)
        tags[i] = described[i];
    reached += capacity > 0;
    return n_described;
}

static int do_append_events(struct apc_store *s, const struct apc_event *events, size_t n)
{
    (void)s, (void)events, (void)n;
    return arrive();
}

static int do_events(struct apc_store *s, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    (void)s, (void)fn, (void)ctx;
    assert_non_null(range);
    return arrive();
}

static int do_append_timing(struct apc_store *s, const struct apc_timing_row *rows, size_t n)
{
    (void)s, (void)rows, (void)n;
    return arrive();
}

static int do_timing(struct apc_store *s, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    (void)s, (void)fn, (void)ctx;
    assert_non_null(range);
    return arrive();
}

static int do_read_rows(struct apc_store *s, struct apc_rows *rows)
{
    (void)s, (void)rows;
    return arrive();
}

static int do_append_rows(struct apc_store *s, const struct apc_rows *rows)
{
    (void)s;
    for (size_t i = 0; i < rows->n_samples; i++)
        rows->sample[i].seq = 1000 + (int64_t)i;
    return arrive();
}

static int do_claim(struct apc_store *s, struct apc_sample *variables, size_t n)
{
    (void)s;
    for (size_t i = 0; i < n; i++)
        variables[i].seq = 10 * variables[i].id + (int)variables[i].table;
    return arrive();
}

static int do_holder(struct apc_store *s, const struct apc_sample *variable, uint64_t *holder)
{
    (void)s, (void)variable;
    *holder = 5;
    return arrive();
}

static int do_seize(struct apc_store *s, struct apc_sample *variables, size_t n, uint64_t holder)
{
    (void)holder;
    return do_claim(s, variables, n);
}

static int do_author(struct apc_store *s, const char *name)
{
    (void)s;
    heard = strcmp(name, "anna") == 0 ? "anna" : "another";
    return arrive();
}

static int do_author_name(struct apc_store *s, uint32_t number, char name[APC_AUTHOR_LEN])
{
    (void)s, (void)number, (void)name;
    return arrive();
}

static int do_describe(struct apc_store *s, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    (void)s, (void)tags, (void)n;
    heard = !catalogue ? NULL : strcmp(catalogue, "a?b") == 0 ? "clean" : "as it is";
    return arrive();
}

static int do_catalogue(struct apc_store *s, char *text, size_t size, int64_t *revision)
{
    (void)s;
    assert_true(text || size == 0);
    *revision = 3;
    return arrive();
}

static int do_behind(struct apc_store *s, struct apc_behind *behind)
{
    (void)s;
    behind->rows = 5;
    return arrive();
}

static int do_requests(struct apc_store *s, apc_request_fn fn, void *ctx)
{
    (void)s, (void)fn, (void)ctx;
    return arrive();
}

static int do_answer(struct apc_store *s, int64_t id, int64_t seq, const char *outcome)
{
    (void)s, (void)id, (void)seq;
    heard = outcome ? "text" : NULL;
    return arrive();
}

static int do_ask(struct apc_store *s, struct apc_request *request)
{
    (void)s, (void)request;
    return arrive();
}

static int do_asked(struct apc_store *s, int64_t id, char *outcome, size_t size)
{
    (void)s, (void)id, (void)outcome, (void)size;
    return arrive();
}

static int do_maintain(struct apc_store *s, const struct apc_retention *keep)
{
    (void)s, (void)keep;
    return arrive();
}

static struct apc_store_ops ops;
static struct apc_store store;

static int set_up(void **state)
{
    *state = &store;
    ops = (struct apc_store_ops){.close = do_close,
                                 .connected = do_connected,
                                 .version = do_version,
                                 .connect = do_connect,
                                 .read = do_read,
                                 .append = do_append,
                                 .put = do_put,
                                 .swap = do_put,
                                 .wait = do_wait,
                                 .variables = do_read,
                                 .history = do_history,
                                 .history_bins = do_bins,
                                 .get_tags = do_get_tags,
                                 .append_events = do_append_events,
                                 .events = do_events,
                                 .append_timing = do_append_timing,
                                 .timing = do_timing,
                                 .read_rows = do_read_rows,
                                 .append_rows = do_append_rows,
                                 .vectors = do_vectors,
                                 .claim_set = do_claim,
                                 .release = do_append,
                                 .holder = do_holder,
                                 .seize = do_seize,
                                 .author = do_author,
                                 .author_name = do_author_name,
                                 .describe = do_describe,
                                 .catalogue = do_catalogue,
                                 .behind = do_behind,
                                 .requests = do_requests,
                                 .answer = do_answer,
                                 .keep_history = do_connect,
                                 .is_history = do_connect,
                                 .ask = do_ask,
                                 .asked = do_asked,
                                 .init = do_connect,
                                 .maintain = do_maintain};
    store = (struct apc_store){.ops = &ops};
    answer = n_described = reached = 0;
    heard = NULL;
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    free(store.seq);
    free(store.loop);
    return 0;
}

/* ---- Functions that are given -------------------------------------------------------------------- */

static int any_sample(void *ctx, const struct apc_sample *s)
{
    (void)ctx, (void)s;
    return 0;
}

static int any_vector(void *ctx, const struct apc_vector *v)
{
    (void)ctx, (void)v;
    return 0;
}

static int any_bin(void *ctx, const struct apc_history_bin *b)
{
    (void)ctx, (void)b;
    return 0;
}

static int any_event(void *ctx, const struct apc_event *e)
{
    (void)ctx, (void)e;
    return 0;
}

static int any_timing(void *ctx, const struct apc_timing_row *r)
{
    (void)ctx, (void)r;
    return 0;
}

static int any_request(void *ctx, const struct apc_request *r)
{
    (void)ctx, (void)r;
    return 0;
}

/* ---- Every function -------------------------------------------------------------------------------- */

enum { FUNCTIONS = 35 };

/* Call number @p i as one that is right, but for the store. */
static int call(int i, struct apc_store *s)
{
    struct apc_sample sample = {.table = APC_SETPOINT, .id = 1, .seq = 1}, *samples = &sample;
    struct apc_rows rows = {.size = sizeof rows, .sample = &sample, .n_samples = 1};
    struct apc_event event = {.severity = APC_EVENT_INFO};
    struct apc_timing_row row = {.quantity = "run"};
    struct apc_request request = {.table = APC_SETPOINT};
    struct apc_behind behind = {.size = sizeof behind};
    struct apc_tag tag = {.table = APC_SENSOR};
    int64_t last;
    uint64_t holder;
    char text[APC_AUTHOR_LEN];
    switch (i) {
    case 0:
        return apc_store_connect(s);
    case 1:
        return apc_store_read(s, samples, 1);
    case 2:
        return apc_store_append(s, samples, 1);
    case 3:
        return apc_store_claim(s, APC_SENSOR, 1, &last);
    case 4:
        return apc_store_claim_set(s, samples, 1);
    case 5:
        return apc_store_release(s, samples, 1);
    case 6:
        return apc_store_put(s, samples, 1);
    case 7:
        return apc_store_swap(s, samples, 1);
    case 8:
        return apc_store_author(s, "anna");
    case 9:
        return apc_store_author_name(s, 1, text);
    case 10:
        return apc_store_read_rows(s, &rows);
    case 11:
        return apc_store_append_rows(s, &rows);
    case 12:
        return apc_store_vectors(s, APC_TICK, 1, NULL, any_vector, NULL);
    case 13:
        return apc_store_requests(s, any_request, NULL);
    case 14:
        return apc_store_answer(s, 1, 0, NULL);
    case 15:
        return apc_store_keep_history(s);
    case 16:
        return apc_store_is_history(s);
    case 17:
        return apc_store_ask(s, &request);
    case 18:
        return apc_store_asked(s, 1, text, sizeof text);
    case 19:
        return apc_store_wait(s, samples, 1, 0);
    case 20:
        return apc_store_variables(s, samples, 1);
    case 21:
        return apc_store_history(s, APC_SENSOR, 1, NULL, any_sample, NULL);
    case 22:
        return apc_store_history_bins(s, APC_SENSOR, 1, 0, 1, 1, any_bin, NULL);
    case 23:
        return apc_store_put_tags(s, &tag, 1);
    case 24:
        return apc_store_describe(s, &tag, 1, "");
    case 25:
        return apc_store_catalogue(s, text, sizeof text, NULL);
    case 26:
        return apc_store_behind(s, &behind);
    case 27:
        return apc_store_append_events(s, &event, 1);
    case 28:
        return apc_store_events(s, NULL, any_event, NULL);
    case 29:
        return apc_store_append_timing(s, &row, 1);
    case 30:
        return apc_store_timing(s, NULL, any_timing, NULL);
    case 31:
        return apc_store_init(s);
    case 32:
        return apc_store_seize(s, samples, 1, 5);
    case 33:
        return apc_store_holder(s, samples, &holder);
    default:
        return apc_store_maintain(s, NULL);
    }
}

#endif
