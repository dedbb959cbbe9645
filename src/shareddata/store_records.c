/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The public face of a store, for what stands beside samples and vectors: requests, tags and the catalogue,
 * events, timing. Arguments are checked here, once for all kinds of store.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/text.h"
#include "shareddata/shareddata_internal.h"

/* What others wrote into a database by SQL is cleaned where it is read. */
struct reading {
    apc_request_fn request;
    apc_event_fn event;
    apc_timing_fn timing;
    void *ctx;
};

static int give_request(void *ctx, const struct apc_request *request)
{
    const struct reading *to = (const struct reading *)ctx;
    struct apc_request clean = *request;
    text_clean(clean.author, request->author, sizeof clean.author);
    text_clean(clean.role, request->role, sizeof clean.role);
    text_clean(clean.reason, request->reason, sizeof clean.reason);
    return to->request(to->ctx, &clean);
}

int apc_store_requests(struct apc_store *store, apc_request_fn fn, void *ctx)
{
    struct reading to = {.request = fn, .ctx = ctx};
    int err = apc_store_enter(store, NULL, 0);
    if (!err && !fn) {
        err = apc_fail(&store->why, APC_EINVAL, "no function to give the requests to");
    }
    return err || !store->ops->requests ? err : store->ops->requests(store, give_request, &to);
}

int apc_store_answer(struct apc_store *store, int64_t id, int64_t seq, const char *outcome)
{
    char clean[192];
    int err = apc_store_enter(store, NULL, 0);
    if (!err && (id <= 0 || seq < 0 || seq > APC_SEQ_MAX || !store->ops->answer)) {
        err = apc_fail(&store->why, APC_EINVAL, "there is no request %lld to be answered", (long long)id);
    }
    return err ? err
               : store->ops->answer(store, id, seq,
                                    outcome ? text_clean(clean, outcome, sizeof clean) : NULL);
}

int apc_store_keep_history(struct apc_store *store)
{
    int err = apc_store_enter_change(store, NULL, 0);
    return err || !store->ops->keep_history ? err : store->ops->keep_history(store);
}

int apc_store_is_history(struct apc_store *store)
{
    int err = apc_store_enter_change(store, NULL, 0);
    return err || !store->ops->is_history ? err : store->ops->is_history(store);
}

int apc_store_ask(struct apc_store *store, struct apc_request *request)
{
    int err = apc_store_enter(store, request, 1);
    if (!err && (!store->ops->ask || !apc_table_shared(request->table) || request->variable < 0 ||
                 !(fabs(request->value) < APC_VALUE_MAX))) {
        err = apc_fail(&store->why, APC_EINVAL, "nobody can be asked for that here");
    }
    if (!err) {
        text_clean(request->author, request->author, sizeof request->author);
        text_clean(request->reason, request->reason, sizeof request->reason);
    }
    return err ? err : store->ops->ask(store, request);
}

int apc_store_asked(struct apc_store *store, int64_t id, char *outcome, size_t size)
{
    int err = apc_store_enter(store, outcome, size);
    if (!err && (id <= 0 || !store->ops->asked)) {
        err = apc_fail(&store->why, APC_EINVAL, "there is no request %lld", (long long)id);
    }
    if (!err && (err = store->ops->asked(store, id, outcome, size)) >= 0 && size > 0) {
        text_clean(outcome, outcome, size);
    }
    return err;
}

static bool is_range(double low, double high)
{
    return fabs(low) <= APC_VALUE_MAX && fabs(high) <= APC_VALUE_MAX && low <= high;
}

static bool is_while(double seconds)
{
    return seconds >= 0 && seconds <= APC_VALUE_MAX;
}

static int check_tag(struct apc_store *store, const struct apc_tag *t)
{
    int err = apc_store_check_variable(store, t->table, t->id);
    if (err) {
        return err;
    }
    const char *table = apc_table_name(t->table);
    if (!is_range(t->low, t->high)) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: limits %g and %g are no range", table, t->id, t->low,
                        t->high);
    }
    if (!is_range(t->display_low, t->display_high)) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: a scale from %g to %g is none", table, t->id,
                        t->display_low, t->display_high);
    }
    if (!is_while(t->period) || !is_while(t->step) || t->length < 0) {
        return apc_fail(&store->why, APC_EINVAL,
                        "%s %d: a period of %g s, a step of %g s and %d elements: expected 0 or more", table,
                        t->id, t->period, t->step, t->length);
    }
    return 0;
}

int apc_store_put_tags(struct apc_store *store, const struct apc_tag *tags, size_t n)
{
    return apc_store_describe(store, tags, n, NULL);
}

int apc_store_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    APC_STORE_PASS(store, describe, apc_store_describe(inner, tags, n, catalogue));
    const size_t length = catalogue ? strnlen(catalogue, APC_CATALOGUE_MAX + 1) : 0;
    char *text = NULL;
    int err = apc_store_enter_change(store, tags, n);
    for (size_t i = 0; !err && i < n; i++) {
        err = check_tag(store, &tags[i]);
    }
    if (!err && length > APC_CATALOGUE_MAX) {
        err = apc_fail(&store->why, APC_EINVAL, "a catalogue is %d bytes long at most", APC_CATALOGUE_MAX);
    }
    if (!err && catalogue && !(text = (char *)malloc(length + 1))) {
        err = apc_fail(&store->why, APC_ENOMEM, "out of memory for a catalogue of %zu bytes", length);
    }
    if (!err) {
        err = store->ops->describe(store, tags, n,
                                   text ? text_cleaned(text, catalogue, length + 1, true) : NULL);
    }
    free(text);
    return err;
}

static int enter_catalogue(struct apc_store *store, char *text, size_t size)
{
    if (text && size > 0) {
        text[0] = '\0';
    }
    return apc_store_enter(store, NULL, 0);
}

int apc_store_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    APC_STORE_PASS(store, catalogue, apc_store_catalogue(inner, text, size, revision));
    int64_t none;
    int err = enter_catalogue(store, text, size);
    return err ? err : store->ops->catalogue(store, text, text ? size : 0, revision ? revision : &none);
}

int apc_store_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision)
{
    APC_STORE_PASS(store, catalogue_at, apc_store_catalogue_at(inner, time, text, size, revision));
    if (store && !store->ops->catalogue_at) {
        return apc_store_catalogue(store, text, size, revision);
    }
    int err = enter_catalogue(store, text, size);
    return err ? err : store->ops->catalogue_at(store, time, text, size, revision);
}

int apc_store_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    APC_STORE_PASS(store, get_tags, apc_store_get_tags(inner, tags, capacity));
    int n = apc_store_enter(store, tags, capacity);
    n = n ? n : store->ops->get_tags(store, tags, capacity);
    for (int i = 0; i < n && (size_t)i < capacity; i++) {
        apc_tag_clean(&tags[i]);
    }
    return n;
}

int apc_store_behind(struct apc_store *store, struct apc_behind *behind)
{
    struct apc_behind all = {.size = 0};
    int err = apc_store_enter(store, behind, 1);
    if (!err && store->ops->behind) {
        err = store->ops->behind(store, &all);
    }
    apc_result_copy(behind, &all, sizeof all);
    return err;
}

int apc_store_room(struct apc_store *store, struct apc_store_room *room)
{
    APC_STORE_PASS(store, room, apc_store_room(inner, room));
    struct apc_store_room all = {.size = 0};
    int err = apc_store_enter(store, room, 1);
    if (!err && store->ops->room) {
        err = store->ops->room(store, &all);
    }
    apc_result_copy(room, &all, sizeof all);
    return err;
}

int apc_store_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    APC_STORE_PASS(store, append_events, apc_store_append_events(inner, events, n));
    int err = apc_store_enter_change(store, events, n);
    for (size_t i = 0; !err && i < n; i++) {
        if (events[i].severity < APC_EVENT_INFO || events[i].severity > APC_EVENT_ALARM) {
            err = apc_fail(&store->why, APC_EINVAL, "%d is no severity of an event", (int)events[i].severity);
        }
    }
    return err || n == 0 ? err : store->ops->append_events(store, events, n);
}

static int give_checked_event(void *ctx, const struct apc_event *event)
{
    const struct reading *to = (const struct reading *)ctx;
    struct apc_event clean = *event;
    text_clean(clean.source, event->source, sizeof clean.source);
    text_clean(clean.kind, event->kind, sizeof clean.kind);
    text_clean(clean.text, event->text, sizeof clean.text);
    return to->event(to->ctx, &clean);
}

int apc_store_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    APC_STORE_PASS(store, events, apc_store_events(inner, range, fn, ctx));
    struct reading to = {.event = fn, .ctx = ctx};
    int err = apc_store_enter(store, NULL, 0);
    if (!err) {
        err = apc_store_check_range(store, range, fn != NULL);
    }
    return err ? err
               : store->ops->events(store, range ? range : &(struct apc_range){0}, give_checked_event, &to);
}

static int check_timing(struct apc_store *store, const struct apc_timing_row *r)
{
    char quantity[sizeof r->quantity];
    if (r->n_bins > APC_STORE_SAMPLES_MAX ||
        (r->n_bins > 0 && !(r->bin_low && r->bin_high && r->bin_count))) {
        return apc_fail(&store->why, APC_EINVAL, "a timing row's buckets are missing or too many");
    }
    if (!isfinite(r->mean) || !isfinite(r->sd) || r->missed > INT64_MAX || r->count > INT64_MAX) {
        return apc_fail(&store->why, APC_EINVAL, "a timing row's figures are not finite or too large");
    }
    text_clean(quantity, r->quantity, sizeof quantity);
    if (strcmp(quantity, "lateness") != 0 && strcmp(quantity, "jitter") != 0 &&
        strcmp(quantity, "run") != 0) {
        return apc_fail(&store->why, APC_ESTORE, "\"%s\" is no quantity of a timing row", quantity);
    }
    return r->period < 0 ? apc_fail(&store->why, APC_ESTORE, "a timing row's period is negative") : 0;
}

int apc_store_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    APC_STORE_PASS(store, append_timing, apc_store_append_timing(inner, rows, n));
    int err = apc_store_enter_change(store, rows, n);
    for (size_t i = 0; !err && i < n; i++) {
        err = check_timing(store, &rows[i]);
    }
    return err || n == 0 ? err : store->ops->append_timing(store, rows, n);
}

static int give_checked_timing(void *ctx, const struct apc_timing_row *row)
{
    const struct reading *to = (const struct reading *)ctx;
    struct apc_timing_row clean = *row;
    text_clean(clean.task, row->task, sizeof clean.task);
    return to->timing(to->ctx, &clean);
}

int apc_store_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    APC_STORE_PASS(store, timing, apc_store_timing(inner, range, fn, ctx));
    struct reading to = {.timing = fn, .ctx = ctx};
    int err = apc_store_enter(store, NULL, 0);
    if (!err) {
        err = apc_store_check_range(store, range, fn != NULL);
    }
    return err ? err
               : store->ops->timing(store, range ? range : &(struct apc_range){0}, give_checked_timing, &to);
}
