/* SPDX-License-Identifier: BSD-3-Clause */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "ui.h"

/* ---- Meters ------------------------------------------------------------------------------- */

#define METER_TURN (60 * APC_NS_PER_S)

int meter_init(struct meter *m)
{
    m->since = apc_clock_mono(NULL);
    if (pthread_mutex_init(&m->mutex, NULL))
        return APC_ESYS;
    int rc = apc_histogram_create(&m->past);
    return rc < 0 ? rc : apc_histogram_create(&m->now);
}

void meter_free(struct meter *m)
{
    apc_histogram_destroy(m->past);
    apc_histogram_destroy(m->now);
    pthread_mutex_destroy(&m->mutex);
}

void meter_record(struct meter *m, apc_ns value)
{
    apc_ns now = apc_clock_mono(NULL);
    pthread_mutex_lock(&m->mutex);
    if (now - m->since > METER_TURN) {
        struct apc_histogram *old = m->past;
        m->past = m->now;
        m->now = old;
        m->since = now;
        apc_histogram_clear(m->now);
    }
    apc_histogram_record(m->now, value);
    m->count++;
    m->sum += apc_ns_to_s(value);
    pthread_mutex_unlock(&m->mutex);
}

void meter_summary(struct meter *m, struct apc_summary *summary)
{
    struct apc_histogram *both;
    *summary = (struct apc_summary){0};
    if (apc_histogram_create(&both) < 0)
        return;
    pthread_mutex_lock(&m->mutex);
    apc_histogram_merge(both, m->past);
    apc_histogram_merge(both, m->now);
    pthread_mutex_unlock(&m->mutex);
    apc_histogram_summary(both, summary);
    apc_histogram_destroy(both);
}

/* ---- Model -------------------------------------------------------------------------------- */

int model_init(struct model *m)
{
    m->since = apc_clock_utc(NULL);
    m->standing.safe = -1;
    snprintf(m->error, sizeof m->error, "not connected yet");
    return pthread_mutex_init(&m->mutex, NULL) ? APC_ESYS : 0;
}

void model_free(struct model *m)
{
    plant_free(&m->plant);
    free(m->now);
    free(m->moved);
    pthread_mutex_destroy(&m->mutex);
}

bool model_describe(struct model *m, const struct apc_tag *tags, size_t n, const struct apc_pair *pair)
{
    struct apc_sample *now = calloc(n + 1, sizeof *now);
    apc_ns *moved = calloc(n + 1, sizeof *moved);
    bool changed = false;
    pthread_mutex_lock(&m->mutex);
    if (now && moved && plant_describe(&m->plant, tags, n, pair)) {
        const struct plant *p = &m->plant;
        for (size_t i = 0; i < p->n; i++)
            now[i] = (struct apc_sample){.table = p->tag[i].table, .id = p->tag[i].id};
        now[p->n] = (struct apc_sample){.table = APC_STATE, .id = plant_confirmation(p)};
        free(m->now);
        free(m->moved);
        m->now = now;
        m->moved = moved;
        changed = true;
    }
    pthread_mutex_unlock(&m->mutex);
    if (!changed) {
        free(now);
        free(moved);
    }
    return changed;
}

/* Table dim, from id 4: measurement and setpoint of each output. */
static int read_pairs(struct apc_store *store, struct apc_pair *pair, size_t nu)
{
    struct apc_sample *dim = calloc(2 * nu + 1, sizeof *dim);
    if (!dim)
        return APC_ENOMEM;
    for (size_t i = 0; i < 2 * nu; i++)
        dim[i] = (struct apc_sample){.table = APC_DIM, .id = (int)i + 4};
    int rc = nu > 0 ? apc_store_read(store, dim, 2 * nu) : 0;
    for (size_t i = 0; i < nu && rc >= 0; i++) {
        const struct apc_sample *y = &dim[2 * i], *z = &dim[2 * i + 1];
        if (y->seq > 0 && z->seq > 0 && y->value >= 0 && y->value < 1e6 && z->value >= 0 && z->value < 1e6)
            pair[i] = (struct apc_pair){.measurement = (size_t)y->value, .setpoint = (size_t)z->value};
    }
    free(dim);
    return rc;
}

int model_load(struct model *m, struct apc_store *store)
{
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tags = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tags);
    if (n >= 0 && !tags)
        return APC_ENOMEM;
    int rc = n < 0 ? n : apc_store_get_tags(store, tags, (size_t)n);
    size_t kept = (size_t)(rc < n ? rc : n), nu = rc < 0 ? 0 : tags_count(tags, kept, APC_ACTUATOR);
    struct apc_pair *pair = calloc(nu + 1, sizeof *pair);
    if (rc >= 0)
        rc = pair ? read_pairs(store, pair, nu) : APC_ENOMEM;
    if (rc >= 0)
        model_describe(m, tags, kept, pair);
    free(pair);
    free(tags);
    return rc < 0 ? rc : 0;
}

apc_ns model_age(const struct model *m, size_t i, apc_ns now)
{
    return m->now[i].seq > 0 ? now - m->moved[i] : -1;
}

bool model_stale(const struct model *m, size_t i, apc_ns now)
{
    apc_ns period = plant_period(&m->plant, m->now[i].table), age = model_age(m, i, now);
    return period > 0 && (age < 0 || age > (3 * period > APC_NS_PER_S ? 3 * period : APC_NS_PER_S));
}

/* ---- What stands -------------------------------------------------------------------------- */

#define REPORT (5 * APC_NS_PER_S) /* between two windows of a task */

void model_take_event(struct model *m, const struct apc_event *event)
{
    const bool plant = !strcmp(event->source, "apc-plant"), good = event->severity == APC_EVENT_INFO;
    struct standing *s = &m->standing;
    pthread_mutex_lock(&m->mutex);
    if (plant && (!strcmp(event->kind, "watchdog") || !strcmp(event->kind, "start"))) {
        s->safe = !good || event->kind[0] == 's'; /* it starts there */
        s->safe_since = event->time;
    }
    if (!strcmp(event->source, "apc-controller") &&
        (!strcmp(event->kind, "measurement") || !strcmp(event->kind, "start")))
        snprintf(s->trouble, sizeof s->trouble, "%s", good ? "" : event->text);
    pthread_mutex_unlock(&m->mutex);
}

bool task_silent(const struct task *task, apc_ns now)
{
    return now - task->heard > 2 * REPORT + 3 * task->period;
}

static const struct task *find_task(const struct model *m, const char *name)
{
    for (size_t i = 0; i < m->tasks; i++)
        if (!strcmp(m->task[i].name, name))
            return &m->task[i];
    return NULL;
}

/* The newest mode of this id, by name; NULL: there is none. */
static const char *mode_of(const struct model *m, int id)
{
    int at = plant_find(&m->plant, APC_OPMODE, id);
    return at < 0 || m->now[at].seq == 0 || m->now[at].value < 0 ? NULL
                                                                 : apc_mode_name((int)m->now[at].value);
}

/* In OOS it writes no outputs: then its own reports tell. */
int model_controlled(const struct model *m, apc_ns now)
{
    const struct task *task = find_task(m, "controller");
    const char *actual = mode_of(m, 1);
    const int u = plant_find(&m->plant, APC_ACTUATOR, 1);
    if (actual && !strcmp(actual, "OOS"))
        return task ? !task_silent(task, now) : -1;
    return u < 0 || plant_period(&m->plant, APC_ACTUATOR) == 0 ? -1 : !model_stale(m, (size_t)u, now);
}

size_t model_silent(const struct model *m, apc_ns now, struct text *t)
{
    const char *actual = mode_of(m, 1);
    size_t n = 0;
    for (size_t i = 0; i < m->plant.n; i++) {
        if (!model_stale(m, i, now) || (m->now[i].table == APC_ACTUATOR && actual && !strcmp(actual, "OOS")))
            continue;
        apc_ns age = model_age(m, i, now);
        if (age < 0)
            text_add(t, "%s: no sample yet\n", m->plant.tag[i].name);
        else
            text_add(t, "%s: no sample for %.1f s\n", m->plant.tag[i].name, apc_ns_to_s(age));
        n++;
    }
    for (size_t i = 0; i < m->tasks; i++)
        if (task_silent(&m->task[i], now)) {
            text_add(t, "%s: no tick reported for %.1f s\n", m->task[i].name,
                     apc_ns_to_s(now - m->task[i].heard));
            n++;
        }
    return n;
}

/* Why the actual mode is not the target's; NULL: it is, or nobody has said. */
static const char *reason(const struct model *m, int controlled, const char *target, const char *actual)
{
    if (controlled == 0)
        return "the controller is not running";
    if (!target || !actual || !strcmp(target, actual) || !m->standing.trouble[0])
        return NULL;
    return m->standing.trouble;
}

void control_json(const struct model *m, apc_ns now, struct text *t)
{
    const char *target = mode_of(m, 0), *actual = mode_of(m, 1);
    const struct standing *s = &m->standing;
    int controlled = model_controlled(m, now);
    text_add(t, "{\"running\":%s,\"target\":", controlled < 0 ? "null" : controlled ? "true" : "false");
    json_string_add(t, target);
    text_add(t, ",\"actual\":");
    json_string_add(t, controlled == 0 ? NULL : actual);
    text_add(t, ",\"reason\":");
    json_string_add(t, reason(m, controlled, target, actual));
    text_add(t, ",\"safe\":%s,\"safe_since\":", s->safe < 0 ? "null" : s->safe ? "true" : "false");
    if (s->safe > 0)
        json_time_add(t, s->safe_since);
    else
        text_add(t, "null");
    text_add(t, "}");
}

apc_ns model_task_period(const struct model *m, const char *name)
{
    const struct task *task = find_task(m, name);
    return task ? task->period : 0;
}

void store_state_json(const struct model *m, struct text *t)
{
    text_add(t, "{\"connected\":%s,\"since\":", m->connected ? "true" : "false");
    json_time_add(t, m->since);
    text_add(t, ",\"error\":");
    json_string_add(t, m->connected ? NULL : m->error);
    text_add(t, "}");
}

void model_state_json(struct ui *ui, struct text *t)
{
    struct model *m = &ui->model;
    char ref[REF_LEN], id[STREAM_ID_LEN];
    stream_id(ui->stream, id); /* first: what comes meanwhile may be told twice, but is not left out */
    text_add(t, "{\"t\":");
    json_time_add(t, apc_clock_utc(NULL));
    text_add(t, ",\"id\":\"%s\",\"store\":", id);
    pthread_mutex_lock(&m->mutex);
    apc_ns now = apc_clock_mono(NULL);
    store_state_json(m, t);
    text_add(t, ",\"values\":{");
    for (size_t i = 0; i < m->plant.n; i++) {
        text_add(t, "\"%s\":", ref_format(m->now[i].table, m->now[i].id, ref));
        json_sample_add(t, &m->now[i]);
        text_put(t, ",", 1);
    }
    text_chop(t, ',');
    text_add(t, "},\"ages\":{");
    for (size_t i = 0; i < m->plant.n; i++) {
        apc_ns age = model_age(m, i, now);
        text_add(t, "\"%s\":", ref_format(m->now[i].table, m->now[i].id, ref));
        if (age >= 0)
            json_seconds_add(t, age);
        else
            text_add(t, "null");
        text_put(t, ",", 1);
    }
    text_chop(t, ',');
    text_add(t, "},\"control\":");
    control_json(m, now, t);
    text_add(t, "}");
    pthread_mutex_unlock(&m->mutex);
}

void model_store(struct ui *ui, bool connected, const char *error)
{
    struct model *m = &ui->model;
    struct text t = {0};
    pthread_mutex_lock(&m->mutex);
    bool changed = m->connected != connected;
    m->connected = connected;
    if (!connected)
        snprintf(m->error, sizeof m->error, "%s", error);
    if (changed) {
        m->since = apc_clock_utc(NULL);
        m->connects += connected;
        store_state_json(m, &t);
    }
    pthread_mutex_unlock(&m->mutex);
    if (!changed)
        return;
    apc_log_write(ui->log, connected ? APC_LOG_INFO : APC_LOG_WARN,
                  connected ? "store connected%s" : "store lost, trying again: %s", connected ? "" : error);
    if (!t.failed)
        stream_publish(ui->stream, "store", t.at, t.n, true);
    text_free(&t);
}
