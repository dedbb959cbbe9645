/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What is newest: wait in the store until one of the variables is newer, read all, tell the stream what
 * changed. The pause between two looks bounds what a fast loop costs; what comes within it comes together.
 */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ui.h"

#define PACE         (25 * APC_NS_PER_MS)
#define WAIT         (500 * APC_NS_PER_MS) /* also how long it takes to notice that it is time to stop */
#define RETRY        (100 * APC_NS_PER_MS)
#define BACKOFF_MOST (APC_NS_PER_S / 4) /* somebody sits there and waits */

struct live {
    struct ui *ui;
    struct apc_store *store;
    unsigned revision;       /* of the plant that `seen` is of */
    struct apc_sample *seen; /* [n + 1], the last is the controller's confirmation */
    size_t n;
};

void ui_pause(struct ui *ui, apc_ns pause)
{
    const struct timespec t = {pause / APC_NS_PER_S, pause % APC_NS_PER_S};
    if (!ui->stopping)
        nanosleep(&t, NULL);
}

int ui_open_store(struct ui *ui, const char *name, apc_ns timeout, struct apc_store **store,
                  struct apc_error *why)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = name, .timeout = timeout, .backoff_max = BACKOFF_MOST};
    return apc_store_open(store, ui->options.store, &options, why);
}

/* Follow the model when it was described anew. */
static int follow_model(struct live *l)
{
    struct model *m = &l->ui->model;
    struct text t = {0};
    int rc = 0;
    pthread_mutex_lock(&m->mutex);
    bool changed = m->plant.revision != l->revision;
    if (changed) {
        struct apc_sample *seen = calloc(m->plant.n + 1, sizeof *seen);
        if (seen && m->now) {
            memcpy(seen, m->now, (m->plant.n + 1) * sizeof *seen);
            free(l->seen);
            l->seen = seen;
            l->n = m->plant.n;
            l->revision = m->plant.revision;
        } else {
            free(seen);
            rc = seen ? 0 : APC_ENOMEM;
            changed = false;
        }
    }
    pthread_mutex_unlock(&m->mutex);
    if (changed) {
        text_add(&t, "{\"revision\":%u}", l->revision);
        if (!t.failed)
            stream_publish(l->ui->stream, "plant", t.at, t.n, true);
        text_free(&t);
    }
    return rc;
}

static void publish(struct live *l, const struct text *values, apc_ns newest)
{
    struct text t = {0};
    apc_ns now = apc_clock_utc(NULL);
    text_add(&t, "{\"t\":");
    json_time_add(&t, now);
    text_add(&t, ",\"values\":{");
    text_put(&t, values->at, values->n);
    text_chop(&t, ',');
    text_add(&t, "}}");
    if (!t.failed && !values->failed)
        stream_publish(l->ui->stream, "values", t.at, t.n, true);
    text_free(&t);
    if (newest > 0)
        meter_record(&l->ui->lag, now - newest);
}

/* What was read goes into the model; what of it is new, into text. Returns the newest source time among the
 * new, 0: nothing is new. */
static apc_ns take(struct live *l, struct text *values)
{
    struct model *m = &l->ui->model;
    const apc_ns mono = apc_clock_mono(NULL), utc = apc_clock_utc(NULL);
    apc_ns newest = 0;
    char ref[REF_LEN];

    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i <= l->n && m->plant.revision == l->revision; i++) {
        const struct apc_sample *s = &l->seen[i];
        if (s->seq <= m->now[i].seq)
            continue;
        /* Not seen before: its stamp says how old it is, if the clock can be believed. */
        m->moved[i] = m->now[i].seq == 0 && s->time < utc ? mono - (utc - s->time) : mono;
        m->now[i] = *s;
        if (i == l->n)
            continue;
        newest = s->time > newest ? s->time : newest;
        text_add(values, "\"%s\":", ref_format(s->table, s->id, ref));
        json_sample_add(values, s);
        text_put(values, ",", 1);
    }
    pthread_mutex_unlock(&m->mutex);
    return newest;
}

static void settle(struct live *l)
{
    struct model *m = &l->ui->model;
    pthread_mutex_lock(&m->mutex);
    apc_ns period = m->plant.rhythms.controller;
    pthread_mutex_unlock(&m->mutex);
    const struct apc_sample *taken = &l->seen[l->n];
    const struct seen seen = {.samples = l->seen,
                              .n = l->n,
                              .taken = taken->seq > 0 ? taken->value : -1,
                              .patience = 3 * (period > 0 ? period : 2 * APC_NS_PER_S) + 2 * APC_NS_PER_S};
    writes_settle(l->ui->writes, &seen, apc_clock_mono(NULL));
}

static int look(struct live *l)
{
    struct text values = {0};
    apc_ns began = apc_clock_mono(NULL);
    int rc = apc_store_read(l->store, l->seen, l->n + 1);
    if (rc < 0)
        return rc;
    meter_record(&l->ui->reads, apc_clock_mono(NULL) - began);
    apc_ns newest = take(l, &values);
    if (values.n > 0)
        publish(l, &values, newest);
    text_free(&values);
    return 0;
}

/* One round: returns 0, or why the store could not be asked. */
static int step(struct live *l)
{
    int rc = 0;
    if (!apc_store_connected(l->store)) {
        rc = apc_store_connect(l->store);
        if (rc >= 0)
            rc = model_load(&l->ui->model, l->store); /* later changes are the records thread's to find */
        l->revision = rc >= 0 && l->n == 0 ? 0 : l->revision;
    }
    if (rc >= 0)
        rc = follow_model(l);
    if (rc < 0 || !l->seen)
        return rc;
    rc = apc_store_wait(l->store, l->seen, l->n + 1, WAIT);
    if (rc > 0)
        rc = look(l);
    if (rc >= 0)
        settle(l);
    return rc;
}

void *live_thread(void *arg)
{
    struct live l = {.ui = arg};
    struct apc_error why;
    if (ui_open_store(l.ui, "apc-ui live", 0, &l.store, &why) < 0) {
        model_store(l.ui, false, why.text);
        return NULL;
    }
    while (!l.ui->stopping) {
        apc_ns began = apc_clock_mono(NULL);
        l.ui->round[0] = began;
        int rc = step(&l);
        model_store(l.ui, rc >= 0, rc < 0 ? apc_store_error(l.store) : "");
        apc_ns rest = (rc < 0 ? RETRY : PACE) - (apc_clock_mono(NULL) - began);
        if (rest > 0)
            ui_pause(l.ui, rest);
    }
    apc_store_close(l.store);
    free(l.seen);
    return NULL;
}
