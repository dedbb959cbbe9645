/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the store has no wake-up for: each second the newest events and timing rows, now and then the
 * descriptions and the files of users and tokens; and the audit rows that could not be written when they were
 * due.
 */
#include <glob.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/ui.h"
#include "base/base_internal.h"
#include "daemon/recorder.h"

#define LOOK       APC_NS_PER_S
#define SOON       (50 * APC_NS_PER_MS) /* people wait for a plant that goes back */
#define RECENT     64 /* events that are asked for first; more where the newest known is not among them ... */
#define MOST       65536               /* ... up to these */
#define FIRST      8192                /* of the first look, for what stands */
#define TOGETHER   500                 /* in one message */
#define BACK       (15 * APC_NS_PER_S) /* timing rows may come this late */
#define FIRST_BACK (60 * APC_NS_PER_S)
#define TAGS_EACH  10 /* looks */

const char *const quantity_names[QUANTITIES] = {"lateness", "jitter", "run"};

struct records {
    struct ui *ui;
    struct apc_store *store;
    struct apc_event *event; /* [room]: of this look, oldest first */
    size_t n, room;
    struct apc_event last; /* newest event known */
    bool know_last;
    bool reported[TASKS]; /* tasks with news in this look */
    bool started;
    struct known_plant plant; /* as it was described at revision ramps_of; 0: not yet */
    struct ramps ramps;
    unsigned ramps_of;
};

/* ---- Events ------------------------------------------------------------------------------- */

void event_json(const struct apc_event *event, struct text *t)
{
    json_add(t, "{time:%.6jd, severity:%d, source:%s, kind:%s, text:%s}", event->time, (int)event->severity,
             event->source, event->kind, event->text);
}

static int take_recent_event(void *ctx, const struct apc_event *event)
{
    struct records *r = ctx;
    if (r->n < r->room)
        r->event[r->n++] = *event;
    return 0;
}

static bool is_same_recent_event(const struct apc_event *a, const struct apc_event *b)
{
    return a->time == b->time && a->severity == b->severity && !strcmp(a->source, b->source) &&
           !strcmp(a->kind, b->kind) && !strcmp(a->text, b->text);
}

/* Who lost or found his connection says so by an event of kind link: a warning, an information. */
static void take_link(struct model *m, const struct apc_event *event)
{
    size_t i = 0;
    pthread_mutex_lock(&m->mutex);
    while (i < m->links && strcmp(m->link[i].name, event->source) != 0)
        i++;
    if (i == m->links && i < LINKS)
        m->links++;
    if (i < LINKS) {
        struct link_state *link = &m->link[i];
        memcpy(link->name, event->source, sizeof link->name);
        memcpy(link->text, event->text, sizeof link->text);
        link->up = event->severity == APC_EVENT_INFO;
        link->since = event->time;
        link->changes++;
    }
    pthread_mutex_unlock(&m->mutex);
}

static void tell_events(struct records *r, size_t from, size_t to)
{
    struct text t = {0};
    json_add(&t, "{events:[");
    for (size_t i = from; i < to; i++)
        event_json(&r->event[i], &t);
    json_add(&t, "]}");
    if (!t.failed)
        stream_publish(r->ui->stream, "event", t.at, t.n, true);
    text_free(&t);
}

/* The newest `last` events. Returns 0 or an error. */
static int read_events(struct records *r, size_t last)
{
    const struct apc_range range = {.last = last};
    if (last > r->room) {
        struct apc_event *more = realloc(r->event, last * sizeof *more);
        if (!more)
            return APC_ENOMEM;
        r->event = more;
        r->room = last;
    }
    r->n = 0;
    int rc = apc_store_events(r->store, &range, take_recent_event, r);
    return rc < 0 ? rc : 0;
}

/* Events have no number: the new ones are those behind the newest that is known. */
static size_t first_new(const struct records *r)
{
    size_t from = r->n;
    while (from > 0 && !(r->know_last && is_same_recent_event(&r->event[from - 1], &r->last)))
        from--;
    return from;
}

static int look_events(struct records *r)
{
    size_t last = r->started ? RECENT : FIRST;
    int rc = read_events(r, last);
    while (rc == 0 && r->know_last && r->n == last && last < MOST && first_new(r) == 0)
        rc = read_events(r, last *= 8);
    if (rc < 0)
        return rc;
    size_t from = first_new(r);
    for (size_t i = from; i < r->n; i++) {
        if (!strcmp(r->event[i].kind, "link"))
            take_link(&r->ui->model, &r->event[i]);
        model_take_event(&r->ui->model, &r->event[i]);
    }
    for (size_t i = from, to; r->started && i < r->n; i = to) {
        to = i + TOGETHER < r->n ? i + TOGETHER : r->n;
        tell_events(r, i, to);
    }
    if (r->n > 0) {
        r->last = r->event[r->n - 1];
        r->know_last = true;
    }
    return 0;
}

/* ---- Timing ------------------------------------------------------------------------------- */

void summary_json(const struct apc_summary *s, struct text *t)
{
    json_add(t, "{count:%ju, mean:%.9g, p50:%.9jd, p99:%.9jd, max:%.9jd}", s->count, s->mean / 1e9, s->p50,
             s->p99, s->max);
}

void window_json(const struct task_figures *f, struct text *t)
{
    if (f && f->count > 0)
        summary_json(
            &(struct apc_summary){
                .count = f->count, .mean = f->mean, .p50 = f->p50, .p99 = f->p99, .max = f->max},
            t);
    else
        json_add(t, "null");
}

void task_json(const struct task *task, apc_ns now, struct text *t)
{
    json_add(t, "{task:%s, period:%.9jd, time:%.6jd, age:%.9jd, count:%ju, missed:%ju, missed_total:%ju",
             task->name, task->period, task->last[RUN].time, now - task->heard, task->last[RUN].count,
             task->missed, task->missed_total);
    for (int q = 0; q < QUANTITIES; q++) {
        json_add(t, "%s:", quantity_names[q]);
        window_json(&task->last[q], t);
    }
    json_add(t, "}");
}

static struct task *task_of(struct model *m, const char *name)
{
    size_t i = 0;
    while (i < m->tasks && strcmp(m->task[i].name, name) != 0)
        i++;
    if (i == m->tasks && i < TASKS) {
        m->tasks++;
        memcpy(m->task[i].name, name, sizeof m->task[i].name);
    }
    return i < TASKS ? &m->task[i] : NULL;
}

static int quantity_of(const char *name)
{
    int q = 0;
    while (q < QUANTITIES && strcmp(name, quantity_names[q]) != 0)
        q++;
    return q;
}

/* A row is new when it is later than what its task said last about this quantity. */
static int take_newest_timing(void *ctx, const struct apc_timing_row *row)
{
    struct records *r = ctx;
    struct model *m = &r->ui->model;
    int q = quantity_of(row->quantity);
    pthread_mutex_lock(&m->mutex);
    const bool exchange = !strcmp(row->task, TASK_EXCHANGE);
    struct task *task = q == QUANTITIES ? NULL : exchange ? &m->exchange : task_of(m, row->task);
    if (task && row->time > task->last[q].time) {
        task->last[q] = (struct task_figures){.time = row->time,
                                              .count = row->count,
                                              .mean = row->mean,
                                              .p50 = row->p50,
                                              .p99 = row->p99,
                                              .max = row->max};
        task->total[q].count += row->count;
        task->total[q].sum += row->mean * (double)row->count / 1e9;
        task->period = row->period;
        task->heard = apc_clock_plant() - (r->started ? 0 : apc_ns_since(apc_clock_utc(NULL), row->time));
        if (q == RUN) { /* all quantities of a window have the same */
            task->missed = row->missed;
            task->missed_total += r->started ? row->missed : 0;
        }
        if (!exchange)
            r->reported[task - m->task] = true;
    }
    pthread_mutex_unlock(&m->mutex);
    return 0;
}

static void tell_tasks(struct records *r)
{
    struct model *m = &r->ui->model;
    struct text t = {0};
    apc_ns now = apc_clock_plant();
    json_add(&t, "{tasks:[");
    size_t empty = t.n;
    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i < m->tasks; i++)
        if (r->reported[i])
            task_json(&m->task[i], now, &t);
    for (size_t i = 0; i < m->tasks; i++) /* they count more than what a file said */
        plant_rhythm(&m->plant, m->task[i].name, m->task[i].period);
    pthread_mutex_unlock(&m->mutex);
    bool news = t.n > empty;
    json_add(&t, "]}");
    if (news && !t.failed)
        stream_publish(r->ui->stream, "tasks", t.at, t.n, true);
    text_free(&t);
}

static int look_timing(struct records *r)
{
    const struct apc_range range = {.since = apc_clock_utc(NULL) - (r->started ? BACK : FIRST_BACK)};
    memset(r->reported, 0, sizeof r->reported);
    int rc = apc_store_timing(r->store, &range, take_newest_timing, r);
    tell_tasks(r);
    return rc < 0 ? rc : 0;
}

/* ---- Room ---------------------------------------------------------------------------------- */

static int look_room(struct records *r)
{
    struct apc_store_room room = {.size = sizeof room};
    const int rc = apc_store_room(r->store, &room);
    if (rc >= 0)
        model_room(r->ui, &room);
    return rc < 0 ? rc : 0;
}

/* ---- Ramps --------------------------------------------------------------------------------- */

static int describe_ramps(struct records *r)
{
    pthread_mutex_lock(&r->ui->model.mutex);
    const unsigned revision = r->ui->model.plant.revision;
    pthread_mutex_unlock(&r->ui->model.mutex);
    if (revision == r->ramps_of)
        return 0;
    ramps_free(&r->ramps);
    known_free(&r->plant);
    int rc = known_load(&r->plant, r->store);
    if (rc >= 0)
        rc = ramps_init(&r->ramps, &r->plant.view, NULL);
    r->ramps_of = rc < 0 ? 0 : revision;
    return rc;
}

static int look_ramps(struct records *r)
{
    struct model *m = &r->ui->model;
    struct text t = {0};
    char ref[REF_LEN];
    int rc = describe_ramps(r);
    if (rc >= 0)
        rc = ramps_read(&r->ramps, r->store);
    for (size_t i = 0; i < r->ramps.n && rc > 0; i++) {
        const struct ramp *ramp = &r->ramps.at[i];
        if (ramp->rate.value > 0)
            json_add(&t, "%s:{target:%g, rate:%g, to_go:%.3f}",
                     ref_format(ramp->now.table, ramp->now.id, ref), ramp->target.value, ramp->rate.value,
                     ramp_to_go(ramp));
    }
    pthread_mutex_lock(&m->mutex);
    text_free(&m->ramps);
    m->ramps = t;
    pthread_mutex_unlock(&m->mutex);
    return rc < 0 ? rc : 0;
}

/* ---- Spools ------------------------------------------------------------------------------- */

/* What daemons of this host keep back, all together. */
static void look_spools(struct ui *ui)
{
    struct apc_spool_stats all = {0};
    struct apc_spool_info info = {.size = sizeof info};
    char pattern[4096];
    glob_t found = {0};
    if (!ui->options.spool)
        return;
    snprintf(pattern, sizeof pattern, "%s/*.spool", ui->options.spool);
    if (glob(pattern, GLOB_NOSORT, NULL, &found) != 0)
        found.gl_pathc = 0;
    for (size_t i = 0; i < found.gl_pathc; i++) {
        if (apc_spool_look(found.gl_pathv[i], &info, NULL) < 0)
            continue;
        all.samples += info.stats.samples;
        all.events += info.stats.events;
        if (info.stats.oldest > 0 && (all.oldest == 0 || info.stats.oldest < all.oldest))
            all.oldest = info.stats.oldest;
    }
    globfree(&found);
    pthread_mutex_lock(&ui->model.mutex);
    ui->model.spool = all;
    pthread_mutex_unlock(&ui->model.mutex);
}

/* ---- Descriptions ------------------------------------------------------------------------- */

static bool is_described(struct ui *ui)
{
    pthread_mutex_lock(&ui->model.mutex);
    bool any = ui->model.plant.n > 0;
    pthread_mutex_unlock(&ui->model.mutex);
    return any;
}

/* ------------------------------------------------------------------------------------------- */

static int look_for_records(struct records *r, unsigned looks, apc_ns *rest)
{
    int rc = audit_flush(r->ui, r->store);
    *rest = model_look_simulated(&r->ui->model, r->store) ? SOON : LOOK;
    if (rc >= 0)
        rc = look_events(r);
    if (rc >= 0)
        rc = look_timing(r);
    if (rc >= 0)
        rc = look_room(r);
    if (rc >= 0)
        rc = look_ramps(r);
    if (rc >= 0 && (looks % TAGS_EACH == 0 || !is_described(r->ui)))
        rc = model_load(&r->ui->model, r->store);
    if (rc >= 0)
        r->started = true;
    return rc;
}

void *records_thread(void *arg)
{
    struct records r = {.ui = arg};
    struct apc_error why;
    bool said = false, users_damaged[2] = {false};
    if (ui_open_store(r.ui, "apc-ui records", 0, &r.store, &why) < 0)
        return NULL;
    for (unsigned looks = 1; !r.ui->stopping; looks++) {
        r.ui->round[1] = apc_clock_mono(NULL);
        apc_ns rest;
        int rc = look_for_records(&r, looks, &rest);
        if (rc < 0 && rc != APC_ECONN && rc != APC_ETIMEDOUT && !said)
            apc_log_write(r.ui->log, APC_LOG_WARN, "events and timing cannot be read: %s",
                          apc_store_error(r.store));
        said = rc < 0;
        look_spools(r.ui);
        ui_look_users(r.ui, users_damaged);
        ui_pause(r.ui, rest);
    }
    audit_flush(r.ui, r.store);
    apc_store_close(r.store);
    ramps_free(&r.ramps);
    known_free(&r.plant);
    free(r.event);
    return NULL;
}
