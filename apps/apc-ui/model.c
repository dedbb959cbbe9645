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

bool model_describe(struct model *m, const struct apc_tag *tags, size_t n)
{
    struct apc_sample *now = calloc(n + 1, sizeof *now);
    apc_ns *moved = calloc(n + 1, sizeof *moved);
    bool changed = false;
    pthread_mutex_lock(&m->mutex);
    if (now && moved && plant_describe(&m->plant, tags, n)) {
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

apc_ns model_age(const struct model *m, size_t i, apc_ns now)
{
    return m->now[i].seq > 0 ? now - m->moved[i] : -1;
}

bool model_stale(const struct model *m, size_t i, apc_ns now)
{
    apc_ns period = plant_period(&m->plant, m->now[i].table), age = model_age(m, i, now);
    return period > 0 && age > (3 * period > APC_NS_PER_S ? 3 * period : APC_NS_PER_S);
}

apc_ns model_task_period(const struct model *m, const char *name)
{
    for (size_t i = 0; i < m->tasks; i++)
        if (!strcmp(m->task[i].name, name))
            return m->task[i].period;
    return 0;
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
    text_add(t, "}}");
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
