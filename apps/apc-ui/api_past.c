/* SPDX-License-Identifier: BSD-3-Clause */
/* What was: history, events, timing. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/timing.h"
#include "http.h"

#define BINS_MAX    4000
#define SAMPLES_MAX 20000
#define EVENTS_MAX  5000
#define EVENTS_LOOK                                                                                          \
    1024 /* of which a filter takes some; eight times as many where these are not enough, and so on */
#define NAMES      32
#define NAMES_FEW  512 /* with no more than FEW_BINS */
#define FEW_BINS   150
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
        return fault_set(&r->fault, 400, "parameter", "since", "\"since\" must be before \"until\"");
    if (most > 0 && (*since < 0 || *until - *since > most))
        return fault_set(&r->fault, 400, "parameter", "since", "at most %.0f hours at once",
                         apc_ns_to_s(most) / 3600);
    return true;
}

void range_json(struct text *t, apc_ns since, apc_ns until)
{
    text_add(t, "\"t\":");
    json_time_add(t, apc_clock_utc(NULL));
    text_add(t, ",\"since\":");
    json_time_add(t, since);
    text_add(t, ",\"until\":");
    json_time_add(t, until);
}

/* ---- Columns ------------------------------------------------------------------------------ */

#define COLUMNS 8

/* A table told column by column. */
struct columns {
    const char *const *name; /* up to a NULL */
    struct text column[COLUMNS];
};

static void columns_end_row(struct columns *c)
{
    for (size_t i = 0; c->name[i]; i++)
        text_put(&c->column[i], ",", 1);
}

static void columns_json(struct columns *c, struct text *t)
{
    for (size_t i = 0; c->name[i]; i++) {
        text_chop(&c->column[i], ',');
        text_add(t, "%s\"%s\":[", i ? "," : "", c->name[i]);
        text_put(t, c->column[i].at ? c->column[i].at : "", c->column[i].n);
        text_put(t, "]", 1);
        t->failed |= c->column[i].failed;
        text_free(&c->column[i]);
    }
}

/* ---- History ------------------------------------------------------------------------------ */

static void add_status(struct text *t, apc_status status)
{
    char name[APC_STATUS_NAME_LEN];
    text_add(t, "\"%s\"", apc_status_format(status, name));
}

static const char *const bin_columns[] = {"from", "count", "bad",   "min", "max",
                                          "mean", "last",  "worst", NULL};

static int take_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct columns *c = ctx;
    const double values[] = {bin->min, bin->max, bin->mean, bin->last};
    json_time_add(&c->column[0], bin->from);
    text_add(&c->column[1], "%" PRIu64, bin->count);
    text_add(&c->column[2], "%" PRIu64, bin->bad);
    for (size_t i = 0; i < 4; i++)
        json_number_add(&c->column[3 + i], bin->count > 0 ? values[i] : (double)NAN);
    add_status(&c->column[7], bin->worst);
    columns_end_row(c);
    return 0;
}

static const char *const sample_columns[] = {"seq", "time", "value", "status", NULL};

static int take_sample(void *ctx, const struct apc_sample *s)
{
    struct columns *c = ctx;
    text_add(&c->column[0], "%" PRId64, s->seq);
    json_time_add(&c->column[1], s->time);
    json_number_add(&c->column[2], s->value);
    add_status(&c->column[3], s->status);
    columns_end_row(c);
    return 0;
}

static int take_before(void *ctx, const struct apc_sample *s)
{
    *(struct apc_sample *)ctx = *s;
    return 1;
}

/* A loop's target mode has the name of its output, or of nothing else. */
static size_t find_name(const struct plant *p, const char *name, bool modes, enum apc_table *table, int *id)
{
    size_t found = 0;
    for (size_t i = 0; i < p->n; i++)
        if ((p->tag[i].table == APC_OPMODE) == modes && !strcmp(p->tag[i].name, name)) {
            *table = p->tag[i].table;
            *id = p->tag[i].id;
            found++;
        }
    return found;
}

/* A variable by its ref, or by its name where only one has it. Returns how many there are. */
static size_t find_variable(struct ui *ui, const char *name, enum apc_table *table, int *id)
{
    const struct plant *p = &ui->model.plant;
    size_t found;
    pthread_mutex_lock(&ui->model.mutex);
    if (ref_parse(name, table, id))
        found = plant_find(p, *table, *id) >= 0;
    else if ((found = find_name(p, name, false, table, id)) == 0)
        found = find_name(p, name, true, table, id);
    pthread_mutex_unlock(&ui->model.mutex);
    return found;
}

static bool stands(enum apc_table table)
{
    return table_wanted(table) || table == APC_ACTUAL;
}

/* What stood already when the range begins. Returns 0 or the store's error. */
static int before_json(struct apc_store *store, enum apc_table table, int id, apc_ns since, struct text *t)
{
    const struct apc_range range = {.until = since, .last = 1};
    struct apc_sample before = {0};
    int rc = stands(table) ? apc_store_history(store, table, id, &range, take_before, &before) : 0;
    text_add(t, ",\"before\":");
    if (before.seq > 0)
        json_sample_add(t, &before);
    else
        text_add(t, "null");
    return rc < 0 ? rc : 0;
}

struct window {
    apc_ns since, until;
    int64_t bins, last; /* one of them is 0 */
};

/* `"before":...,"bins":{...}` or samples. Returns 0 or the store's error. */
static int history_json(struct apc_store *store, enum apc_table table, int id, const struct window *w,
                        struct text *t)
{
    struct columns c = {.name = w->bins > 0 ? bin_columns : sample_columns};
    const struct apc_range range = {.since = w->since, .until = w->until, .last = (size_t)w->last};
    int rc = before_json(store, table, id, w->since, t);
    if (rc == 0 && w->bins > 0)
        rc = apc_store_history_bins(store, table, id, w->since, w->until, (size_t)w->bins, take_bin, &c);
    else if (rc == 0)
        rc = apc_store_history(store, table, id, &range, take_sample, &c);
    if (w->bins > 0)
        text_add(t, ",\"bins\":{\"n\":%" PRId64 ",", w->bins);
    else
        text_add(t, ",\"samples\":{");
    columns_json(&c, t);
    text_add(t, "}");
    return rc < 0 ? rc : 0;
}

/* One of several: what is wrong with it is its own matter. */
static int named_json(struct ui *ui, struct apc_store *store, const char *name, const struct window *w,
                      struct text *t)
{
    char ref[REF_LEN];
    enum apc_table table = 0;
    int id = 0, rc = 0;
    size_t found = find_variable(ui, name, &table, &id);
    text_add(t, "{\"name\":");
    json_string_add(t, name);
    if (found == 1) {
        text_add(t, ",\"ref\":\"%s\"", ref_format(table, id, ref));
        rc = history_json(store, table, id, w, t);
    } else {
        text_add(t, ",\"error\":{\"code\":\"variable\",\"message\":\"%s\"}",
                 found ? "several variables have this name: give TABLE.ID" : "there is no such variable");
    }
    text_add(t, "},");
    return rc;
}

static size_t count_names(const char *names)
{
    size_t n = 1;
    for (; *names; names++)
        n += *names == ',';
    return n;
}

static int several_json(struct ui *ui, struct apc_store *store, const char *names, const struct window *w,
                        struct text *t)
{
    int rc = 0;
    for (const char *at = names, *end; at && rc == 0; at = *end ? end + 1 : NULL) {
        char name[APC_TAG_LEN + 1];
        end = strchrnul(at, ',');
        snprintf(name, sizeof name, "%.*s", (int)(end - at), at);
        rc = named_json(ui, store, name, w, t);
    }
    text_chop(t, ',');
    return rc;
}

static bool query_window(struct request *r, const char *names, struct window *w)
{
    if (!query_whole(r, "bins", 1, BINS_MAX, &w->bins) || !query_whole(r, "last", 1, SAMPLES_MAX, &w->last) ||
        !query_range(r, 3600 * APC_NS_PER_S, 0, &w->since, &w->until))
        return false;
    if ((w->bins > 0) == (w->last > 0))
        return fault_set(&r->fault, 400, "parameter", "bins", "give one of \"bins\" and \"last\"");
    size_t most = w->bins > 0 && w->bins <= FEW_BINS ? NAMES_FEW : NAMES;
    if (names && count_names(names) > most)
        return fault_set(&r->fault, 400, "parameter", "names",
                         "at most %d names at once, %d with up to %d bins", NAMES, NAMES_FEW, FEW_BINS);
    return true;
}

void get_history(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *ref = request_query(r, "var"), *names = request_query(r, "names");
    struct window w = {0};
    enum apc_table table = 0;
    int id = 0, rc;
    if (!ref == !names) {
        fault_set(&r->fault, 400, "parameter", "var",
                  "give \"var\", TABLE.ID or a name, or \"names\", several of them");
        return;
    }
    size_t found = ref ? find_variable(ui, ref, &table, &id) : 1;
    if (found != 1) {
        fault_set(&r->fault, 404, "variable", "var",
                  found ? "several variables are called %.60s: give TABLE.ID" : "there is no variable %.60s",
                  ref);
        return;
    }
    if (!query_window(r, names, &w))
        return;
    struct text *t = &r->reply;
    char own[REF_LEN];
    text_add(t, "{");
    if (ref)
        text_add(t, "\"ref\":\"%s\",", ref_format(table, id, own));
    range_json(t, w.since, w.until);
    if (ref) {
        rc = history_json(store, table, id, &w, t);
    } else {
        text_add(t, ",\"series\":[");
        rc = several_json(ui, store, names, &w, t);
        text_add(t, "]");
    }
    text_add(t, "}");
    if (rc < 0)
        fault_store(r, rc, store);
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

static int take_event(void *ctx, const struct apc_event *event)
{
    struct event_filter *f = ctx;
    if (event->severity < (enum apc_event_severity)f->severity ||
        (f->kind && strcmp(event->kind, f->kind) != 0) ||
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
        int rc = apc_store_events(store, &range, take_event, f);
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
    text_add(&r->reply, "{\"t\":");
    json_time_add(&r->reply, apc_clock_utc(NULL));
    text_add(&r->reply, ",\"events\":[");
    for (uint64_t i = f.matched > n ? f.matched - n : 0; i < f.matched; i++) {
        event_json(&f.ring[i % n], &r->reply);
        text_put(&r->reply, ",", 1);
    }
    text_chop(&r->reply, ',');
    text_add(&r->reply, "],\"more\":%s}", f.matched > n ? "true" : "false");
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

static void seconds_member(struct text *t, const char *name, apc_ns duration)
{
    text_add(t, ",\"%s\":", name);
    json_seconds_add(t, duration);
}

static void series_json(const struct timing_series *s, struct text *t)
{
    text_add(t, "{\"task\":");
    json_string_add(t, s->task);
    text_add(t, ",\"quantity\":\"%s\"", s->quantity);
    seconds_member(t, "period", s->period);
    text_add(t, ",\"count\":%" PRIu64 ",\"missed\":%" PRIu64 ",\"mean\":%.9g,\"sd\":%.9g", s->count,
             s->missed, s->mean / 1e9, s->sd / 1e9);
    seconds_member(t, "min", timing_min(s));
    seconds_member(t, "p50", s->p50);
    seconds_member(t, "p99", s->p99);
    seconds_member(t, "p999", s->p999);
    seconds_member(t, "max", s->max);
    text_add(t, ",\"bins\":[");
    for (size_t i = 0; i < s->n_bins; i++)
        text_add(t, "[%.9g,%.9g,%" PRIu64 "],", (double)s->bins[i].low / 1e9, (double)s->bins[i].high / 1e9,
                 s->bins[i].count);
    text_chop(t, ',');
    text_add(t, "]},");
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
    text_add(&r->reply, "{");
    range_json(&r->reply, range.since, range.until);
    text_add(&r->reply, ",\"timing\":[");
    for (size_t i = 0; i < timing.n; i++)
        if (!task || !strcmp(task, timing.series[i].task))
            series_json(&timing.series[i], &r->reply);
    text_chop(&r->reply, ',');
    text_add(&r->reply, "]}");
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

static int take_window(void *ctx, const struct apc_timing_row *row)
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
    static const char *const names[] = {"time", "count", "missed", "mean", "p50", "p99", "max", NULL};
    struct columns c = {.name = names};
    text_add(t, "{\"t\":");
    json_time_add(t, apc_clock_utc(NULL));
    text_add(t, ",\"task\":");
    json_string_add(t, a->task);
    text_add(t, ",\"quantity\":\"%s\",\"period\":", a->quantity);
    if (a->period > 0)
        json_seconds_add(t, a->period);
    else
        text_add(t, "null");
    text_add(t, ",\"series\":{");
    for (size_t i = 0; i < a->n; i++) {
        const struct interval *at = &a->at[i];
        if (at->count == 0)
            continue;
        json_time_add(&c.column[0], a->since + (apc_ns)(i + 1) * a->step);
        text_add(&c.column[1], "%" PRIu64, at->count);
        text_add(&c.column[2], "%" PRIu64, at->missed);
        text_add(&c.column[3], "%.9g", at->sum / (double)at->count / 1e9);
        json_seconds_add(&c.column[4], at->p50);
        json_seconds_add(&c.column[5], at->p99);
        json_seconds_add(&c.column[6], at->max);
        columns_end_row(&c);
    }
    columns_json(&c, t);
    text_add(t, "}}");
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
    int rc = a.at ? apc_store_timing(store, &range, take_window, &a) : APC_ENOMEM;
    if (rc < 0)
        fault_store(r, rc, store);
    else
        against_time_json(&a, &r->reply);
    free(a.at);
}
