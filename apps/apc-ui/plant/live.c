/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What is newest: wait in the store until one of the variables is newer, read all, tell the stream what
 * changed. The pause between two looks bounds what a fast loop costs; what comes within it comes together.
 */
#include <stdlib.h>
#include <string.h>

#include "apc-ui/ui.h"
#include "operate/operate.h"

#define PACE        (25 * APC_NS_PER_MS)
#define WAIT        (500 * APC_NS_PER_MS) /* also how long it takes to notice that it is time to stop */
#define WAIT_ALARMS (125 * APC_NS_PER_MS) /* of what they did a tick tells */
#define RETRY       (100 * APC_NS_PER_MS)

struct live {
    struct ui *ui;
    struct apc_store *store;
    unsigned revision;       /* of the plant that all this is of */
    struct apc_sample *seen; /* [n] as the model's: the first `shown` are variables that people see; and
                                [open] behind them that tell what becomes of what is wanted of alarms */
    int *controller;         /* [n + open] index of who takes what is written there; -1: nobody */
    size_t n, shown, open;
    struct apc_vector *tick; /* [controllers], and behind them of who evaluates the alarms */
    struct loops_controller *of;
    size_t controllers;
    double alarm_numbers[APC_ALARMS_TICK];
    struct alarm_watch *watch;
};

static void let_go_live(struct live *l)
{
    free(l->seen);
    free(l->controller);
    free(l->tick);
    free(l->of);
}

static void find_controllers(struct live *l, const struct plant *p)
{
    for (size_t i = 0; i < l->n; i++)
        l->controller[i] = plant_controller(p, l->seen[i].table, l->seen[i].id);
}

/* The same as in the model, which is locked. False: no memory. */
static bool copy_live(struct live *to, const struct model *m)
{
    const struct plant *p = &m->plant;
    *to = (struct live){.ui = to->ui,
                        .store = to->store,
                        .watch = to->watch,
                        .revision = p->revision,
                        .seen = calloc(m->count + WRITES_OPEN, sizeof *to->seen),
                        .controller = calloc(m->count + WRITES_OPEN, sizeof *to->controller),
                        .n = m->count,
                        .shown = p->n,
                        .tick = calloc(p->loops.n_controllers + 1, sizeof *to->tick),
                        .of = calloc(p->loops.n_controllers + 1, sizeof *to->of),
                        .controllers = p->loops.n_controllers};
    if (!to->seen || !to->controller || !to->tick || !to->of || !m->now)
        return false;
    memcpy(to->seen, m->now, m->count * sizeof *to->seen);
    memcpy(to->tick, m->tick, p->loops.n_controllers * sizeof *to->tick);
    to->tick[to->controllers] = m->alarms;
    to->of[to->controllers] = (struct loops_controller){.name = "apc-alarms", .period = m->alarms_period};
    for (size_t i = 0; i < WRITES_OPEN; i++)
        to->controller[to->n + i] = (int)to->controllers;
    find_controllers(to, p);
    for (size_t i = 0; i < p->loops.n_controllers; i++) {
        to->of[i] = p->loops.controller[i];
        to->of[i].period = plant_tick_time(p, i);
    }
    return true;
}

/* Follow the model when it was described anew. */
static int follow_model(struct live *l)
{
    struct model *m = &l->ui->model;
    struct text t = {0};
    struct live next = *l;
    bool ok = true;
    pthread_mutex_lock(&m->mutex);
    const bool changed = m->plant.revision != l->revision;
    if (changed)
        ok = copy_live(&next, m);
    pthread_mutex_unlock(&m->mutex);
    const int rc = !ok ? APC_ENOMEM : changed ? alarm_watch_describe(l->watch, l->ui, l->store) : 0;
    if (rc < 0) {
        let_go_live(&next);
        return rc;
    }
    if (changed) {
        let_go_live(l);
        *l = next;
        json_add(&t, "{revision:%u}", l->revision);
        if (!t.failed)
            stream_publish(l->ui->stream, "plant", t.at, t.n, true);
        text_free(&t);
    }
    return 0;
}

static void publish_values(struct live *l, const struct text *values, apc_ns newest)
{
    struct text t = {0};
    apc_ns now = apc_clock_utc(NULL);
    json_add(&t, "{t:%.6jd, values:{", now);
    text_put(&t, values->at, values->n);
    json_add(&t, "}}");
    if (!t.failed && !values->failed)
        stream_publish(l->ui->stream, "values", t.at, t.n, true);
    text_free(&t);
    if (newest > 0)
        duration_stats_record(&l->ui->lag, now - newest);
}

struct now {
    apc_ns mono, utc;
};

/* When something was seen to move. Not seen before: its stamp says how old it is, if the clock can be
 * believed. */
static apc_ns moved(struct now now, apc_ns time, bool first)
{
    return first && time < now.utc ? now.mono - (now.utc - time) : now.mono;
}

/* What was read goes into the model; what of it is new and shown, into text. Returns the newest source time
 * among that, 0: nothing is new. */
static apc_ns take_live_values(struct live *l, struct text *values)
{
    struct model *m = &l->ui->model;
    const struct now now = {apc_clock_plant(), apc_clock_utc(NULL)};
    apc_ns newest = 0;
    char ref[REF_LEN];

    pthread_mutex_lock(&m->mutex);
    const bool same = m->plant.revision == l->revision;
    for (size_t i = 0; i < l->n && same; i++) {
        const struct apc_sample *s = &l->seen[i];
        if (s->seq <= m->now[i].seq)
            continue;
        m->moved[i] = moved(now, s->time, m->now[i].seq == 0);
        m->now[i] = *s;
        if (s->table == APC_OPMODE && s->id >= LOOPS_IDS) {
            const bool other = loops_choose(&m->plant.loops, s->id, s->value);
            find_controllers(l, &m->plant);
            m->plant.revision += other; /* who is above whom */
        }
        if (i >= l->shown)
            continue;
        newest = s->time > newest ? s->time : newest;
        json_add(values, "%s:", ref_format(s->table, s->id, ref));
        json_sample_add(values, s);
    }
    for (size_t i = 0; i < l->controllers && same; i++)
        if (l->tick[i].seq > m->tick[i].seq) {
            m->ticked[i] = moved(now, l->tick[i].time, m->tick[i].seq == 0);
            m->tick[i] = l->tick[i];
        }
    const struct apc_vector *alarms = &l->tick[l->controllers];
    if (same && alarms->seq > m->alarms.seq && alarms->n == APC_ALARMS_TICK) {
        m->alarms_ticked = moved(now, alarms->time, m->alarms.seq == 0);
        m->alarms.seq = alarms->seq;
        memcpy(m->alarm_numbers, l->alarm_numbers, sizeof m->alarm_numbers);
    }
    pthread_mutex_unlock(&m->mutex);
    return newest;
}

/* The controllers' ticks as old as they are by the clock that does not step. */
static void settle_ticks(struct live *l)
{
    struct model *m = &l->ui->model;
    const struct now now = {apc_clock_plant(), apc_clock_utc(NULL)};
    struct refusal refusal = {0};
    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i < l->controllers && m->plant.revision == l->revision; i++)
        l->tick[i].time = now.utc - (now.mono - m->ticked[i]);
    l->tick[l->controllers].time = now.utc - (now.mono - m->alarms_ticked);
    pthread_mutex_unlock(&m->mutex);
    const struct seen seen = {.samples = l->seen,
                              .by = l->controller,
                              .n = l->n + l->open,
                              .tick = l->tick,
                              .controller = l->of,
                              .utc = now.utc};
    while (writes_settle(l->ui->writes, &seen, now.mono, &refusal))
        (void)outcome_refusal(l->store, refusal.name, refusal.since, refusal.text, sizeof refusal.text);
}

static int look_for_changes(struct live *l)
{
    struct text values = {0};
    struct apc_vector *alarms = &l->tick[l->controllers];
    l->open = writes_open(l->ui->writes, l->seen + l->n);
    alarms->value = l->alarm_numbers;
    alarms->room = APC_ALARMS_TICK;
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = l->seen,
                            .n_samples = l->n + l->open,
                            .vector = l->tick,
                            .n_vectors = l->controllers + (alarms->id > 0)};
    apc_ns began = apc_clock_mono(NULL);
    int rc = apc_store_read_rows(l->store, &rows);
    if (rc < 0)
        return rc;
    duration_stats_record(&l->ui->reads, apc_clock_mono(NULL) - began);
    apc_ns newest = take_live_values(l, &values);
    if (values.n > 0)
        publish_values(l, &values, newest);
    text_free(&values);
    return alarm_watch_look(l->watch, l->ui, l->store, alarms);
}

/* One round: returns 0, or why the store could not be asked. */
static int live_step(struct live *l)
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
    struct stream_stats stream;
    stream_stats(l->ui->stream, &stream);
    rc = apc_store_wait(l->store, l->seen, l->n, l->watch->told && stream.readers > 0 ? WAIT_ALARMS : WAIT);
    if (rc >= 0) /* nothing waits for ticks, and out of service they are all there is */
        rc = look_for_changes(l);
    if (rc >= 0)
        settle_ticks(l);
    return rc;
}

void *live_thread(void *arg)
{
    struct alarm_watch watch = {0};
    struct live l = {.ui = arg, .watch = &watch};
    struct apc_error why;
    if (ui_open_store(l.ui, "apc-ui live", 0, &l.store, &why) < 0) {
        model_store(l.ui, false, why.text);
        return NULL;
    }
    while (!l.ui->stopping) {
        apc_ns began = apc_clock_mono(NULL);
        l.ui->round[0] = began;
        int rc = live_step(&l);
        model_store(l.ui, rc >= 0, rc < 0 ? apc_store_error(l.store) : "");
        apc_ns rest = (rc < 0 ? RETRY : PACE) - (apc_clock_mono(NULL) - began);
        if (rest > 0)
            ui_pause(l.ui, rest);
    }
    alarm_watch_free(&watch);
    apc_store_close(l.store);
    let_go_live(&l);
    return NULL;
}
