/* SPDX-License-Identifier: BSD-3-Clause */
/* What was: events, timing. */
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "apc-ui/plant/columns.h"
#include "common/timing.h"

#define EVENTS_MAX 5000
#define EVENTS_LOOK                                                                                          \
    1024 /* of which a filter takes some; eight times as many where these are not enough, and so on */
#define POINTS_MAX 2000
#define DAY        (86400 * APC_NS_PER_S)

/* ---- Ranges ------------------------------------------------------------------------------- */

bool query_range(struct request *r, apc_ns back, apc_ns most, apc_ns *since, apc_ns *until)
{
    apc_ns now = apc_clock_utc(NULL);
    *until = now;
    if (!query_time(r, "until", now, until))
        return false;
    *since = *until - back;
    if (!query_time(r, "since", now, since))
        return false;
    if (*since >= *until)
        return fault_set(&r->fault, 422, "parameter", "since", "\"since\" must be before \"until\"");
    if (most > 0 && (*since < 0 || *until - *since > most))
        return fault_set(&r->fault, 422, "parameter", "since", "at most %.0f hours at once",
                         apc_ns_to_s(most) / 3600);
    return true;
}

void range_json(struct text *t, apc_ns since, apc_ns until)
{
    json_add(t, "t:%.6jd, since:%.6jd, until:%.6jd", apc_clock_utc(NULL), since, until);
}

/* ---- Events ------------------------------------------------------------------------------- */

struct event_filter {
    int64_t severity, last;
    const char *kind, *source, *text;
    struct apc_event *ring; /* [last]: the newest that match */
    uint64_t matched;
};

static bool contains(const char *text, const char *word)
{
    return strcasestr(text, word) != NULL;
}

/* Of several kinds, with commas between them. */
static bool is_of_kinds(const char *kinds, const char *kind)
{
    const size_t n = strlen(kind);
    for (const char *at = kinds; at; at = strchr(at, ',')) {
        at += *at == ',';
        if (!strncmp(at, kind, n) && (at[n] == ',' || at[n] == '\0'))
            return true;
    }
    return false;
}

static int take_past_event(void *ctx, const struct apc_event *event)
{
    struct event_filter *f = ctx;
    if (event->severity < (enum apc_event_severity)f->severity ||
        (f->kind && !is_of_kinds(f->kind, event->kind)) ||
        (f->source && strcmp(event->source, f->source) != 0) || (f->text && !contains(event->text, f->text)))
        return 0;
    f->ring[f->matched++ % (uint64_t)f->last] = *event;
    return 0;
}

/* The newest that match, without reading all there are. Returns 0 or the store's error. */
static int filter_events(struct event_filter *f, struct apc_store *store, struct apc_range range)
{
    const size_t wanted = (size_t)f->last + 1; /* one more tells whether there are more */
    bool all = f->severity == 1 && !f->kind && !f->source && !f->text;
    for (range.last = all || wanted > EVENTS_LOOK ? wanted : EVENTS_LOOK;; range.last *= 8) {
        f->matched = 0;
        int rc = apc_store_events(store, &range, take_past_event, f);
        if (rc < 0)
            return rc;
        if ((size_t)rc < range.last || f->matched >= wanted)
            return 0;
    }
}

void get_events(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct event_filter f = {.severity = 1,
                             .last = 200,
                             .kind = request_query(r, "kind"),
                             .source = request_query(r, "source"),
                             .text = request_query(r, "text")};
    apc_ns since, until;
    (void)ui;
    if (!query_whole(r, "severity", 1, 3, &f.severity) || !query_whole(r, "last", 1, EVENTS_MAX, &f.last) ||
        !query_range(r, 7 * DAY, 0, &since, &until))
        return;
    f.ring = calloc((size_t)f.last, sizeof *f.ring);
    if (!f.ring) {
        fault_store(r, APC_ENOMEM, store);
        return;
    }
    /* An event of this very moment is not to be missed for want of a microsecond. */
    const struct apc_range range = {.since = since, .until = request_query(r, "until") ? until : 0};
    int rc = filter_events(&f, store, range);
    if (rc < 0)
        fault_store(r, rc, store);
    uint64_t n = (uint64_t)f.last;
    json_add(&r->reply, "{t:%.6jd, events:[", apc_clock_utc(NULL));
    for (uint64_t i = f.matched > n ? f.matched - n : 0; i < f.matched; i++)
        event_json(&f.ring[i % n], &r->reply);
    json_add(&r->reply, "], more:%i}", f.matched > n);
    free(f.ring);
}

/* ---- Timing ------------------------------------------------------------------------------- */

static bool known_quantity(struct request *r, const char *quantity)
{
    for (int q = 0; q < QUANTITIES; q++)
        if (!quantity || !strcmp(quantity, quantity_names[q]))
            return true;
    return fault_set(&r->fault, 400, "parameter", "quantity", "\"quantity\" must be lateness, jitter or run");
}

static void series_json(const struct timing_series *s, struct text *t)
{
    json_add(t, "{task:%s, quantity:%s, period:%.9jd, count:%ju, missed:%ju, mean:%.9g, sd:%.9g", s->task,
             s->quantity, s->period, s->count, s->missed, s->mean / 1e9, s->sd / 1e9);
    json_add(t, "min:%.9jd, p50:%.9jd, p99:%.9jd, p999:%.9jd, max:%.9jd, bins:[", timing_min(s), s->p50,
             s->p99, s->p999, s->max);
    for (size_t i = 0; i < s->n_bins; i++)
        json_add(t, "[%.9g, %.9g, %ju]", (double)s->bins[i].low / 1e9, (double)s->bins[i].high / 1e9,
                 s->bins[i].count);
    json_add(t, "]}");
}

void get_timing(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *task = request_query(r, "task"), *quantity = request_query(r, "quantity");
    struct timing timing = {0};
    struct apc_range range = {0};
    (void)ui;
    if (!known_quantity(r, quantity) || !query_range(r, 60 * APC_NS_PER_S, DAY, &range.since, &range.until))
        return;
    int rc = timing_load(&timing, store, &range, quantity);
    if (rc < 0)
        fault_store(r, rc, store);
    json_add(&r->reply, "{");
    range_json(&r->reply, range.since, range.until);
    json_add(&r->reply, "timing:[");
    for (size_t i = 0; i < timing.n; i++)
        if (!task || !strcmp(task, timing.series[i].task))
            series_json(&timing.series[i], &r->reply);
    json_add(&r->reply, "]}");
    timing_free(&timing);
}

/* Windows put together to intervals of equal length. */
struct against_time {
    const char *task, *quantity;
    apc_ns since, step, period;
    struct interval {
        uint64_t count, missed;
        double sum;
        apc_ns p50, p99, max;
    } * at;
    size_t n;
};

static apc_ns larger(apc_ns a, apc_ns b)
{
    return a > b ? a : b;
}

static int take_timing_window(void *ctx, const struct apc_timing_row *row)
{
    struct against_time *a = ctx;
    if (strcmp(row->task, a->task) != 0 || strcmp(row->quantity, a->quantity) != 0 || row->count == 0)
        return 0;
    size_t i = (size_t)((row->time - a->since) / a->step);
    struct interval *at = &a->at[i < a->n ? i : a->n - 1];
    bool first = at->count == 0;
    at->count += row->count;
    at->missed += row->missed;
    at->sum += row->mean * (double)row->count;
    at->p50 = first ? row->p50 : larger(at->p50, row->p50);
    at->p99 = first ? row->p99 : larger(at->p99, row->p99);
    at->max = first ? row->max : larger(at->max, row->max);
    a->period = row->period;
    return 0;
}

static void against_time_json(const struct against_time *a, struct text *t)
{
    static const struct column columns[] = {
        {"time", CELL_TIME},  {"count", CELL_WHOLE}, {"missed", CELL_WHOLE}, {"mean", CELL_NUMBER},
        {"p50", CELL_NUMBER}, {"p99", CELL_NUMBER},  {"max", CELL_NUMBER},   {0}};
    struct columns c = {.column = columns};
    json_add(t, "{t:%.6jd, task:%s, quantity:%s, period:%.9jd, series:{", apc_clock_utc(NULL), a->task,
             a->quantity, json_some(a->period));
    for (size_t i = 0; i < a->n; i++) {
        const struct interval *at = &a->at[i];
        if (at->count == 0)
            continue;
        const union cell row[] = {{.time = a->since + (apc_ns)(i + 1) * a->step},
                                  {.whole = (int64_t)at->count},
                                  {.whole = (int64_t)at->missed},
                                  {.number = at->sum / (double)at->count / 1e9},
                                  {.number = apc_ns_to_s(at->p50)},
                                  {.number = apc_ns_to_s(at->p99)},
                                  {.number = apc_ns_to_s(at->max)}};
        columns_row(&c, row);
    }
    columns_end(&c, t);
    json_add(t, "}}");
}

void get_timing_series(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct against_time a = {.task = request_query(r, "task"), .quantity = request_query(r, "quantity")};
    struct apc_range range = {0};
    int64_t points = 500;
    (void)ui;
    if (!a.task || !a.quantity) {
        fault_set(&r->fault, 400, "parameter", a.task ? "quantity" : "task",
                  "\"task\" and \"quantity\" are needed");
        return;
    }
    if (!known_quantity(r, a.quantity) || !query_whole(r, "points", 1, POINTS_MAX, &points) ||
        !query_range(r, 3600 * APC_NS_PER_S, DAY, &range.since, &range.until))
        return;
    a.since = range.since;
    a.n = (size_t)points;
    a.step = (range.until - range.since) / points + 1;
    a.at = calloc(a.n, sizeof *a.at);
    int rc = a.at ? apc_store_timing(store, &range, take_timing_window, &a) : APC_ENOMEM;
    if (rc < 0)
        fault_store(r, rc, store);
    else
        against_time_json(&a, &r->reply);
    free(a.at);
}
