/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * How far the history is behind the live store, where there are two. A history may make whoever asks it wait,
 * so nobody else does this thread's work, and it has none but this.
 */
#include <string.h>

#include "apc-ui/ui.h"

#define LOOK    (2 * APC_NS_PER_S)
#define TIMEOUT (2 * APC_NS_PER_S)

static int take_oldest_time(void *ctx, const struct apc_sample *sample)
{
    *(apc_ns *)ctx = sample->time;
    return 1;
}

/* When the oldest sample of memory is from; 0: it has none. */
static apc_ns oldest(struct ui *ui, struct apc_store *live)
{
    struct model *m = &ui->model;
    apc_ns time = 0;
    int id = 0;
    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i < m->plant.n && id == 0; i++)
        id = m->plant.tag[i].table == APC_SENSOR ? m->plant.tag[i].id : 0;
    pthread_mutex_unlock(&m->mutex);
    const struct apc_range all = {.since = 0};
    return id > 0 && apc_store_history(live, APC_SENSOR, id, &all, take_oldest_time, &time) > 0 ? time : 0;
}

void model_behind(struct model *m, const struct behind *now)
{
    pthread_mutex_lock(&m->mutex);
    const apc_ns before = m->looked.state > 0 && !m->looked.nothing ? m->looked.late : now->late;
    m->looked = m->behind = *now;
    m->behind.late = before < now->late ? before : now->late;
    pthread_mutex_unlock(&m->mutex);
}

void behind_json(const struct model *m, struct text *t)
{
    const struct behind *b = &m->behind;
    if (b->state == 0)
        json_add(t, "null");
    else
        json_add(t, "{behind:%jd, late:%.9jd, oldest:%.6jd, error:%-s}",
                 b->state > 0 ? (int64_t)b->rows : JSON_NONE,
                 b->state > 0 && !b->nothing ? b->late : JSON_NONE, json_some(b->oldest),
                 b->state < 0 ? b->why : "");
}

static void measure_history_lag(struct ui *ui, struct apc_store *both, struct apc_store *live)
{
    struct apc_behind behind = {.size = sizeof behind};
    struct behind now = {.state = apc_store_behind(both, &behind)};
    now.rows = behind.rows;
    now.late = behind.time;
    now.nothing = behind.nothing;
    now.oldest = oldest(ui, live);
    if (now.state < 0)
        snprintf(now.why, sizeof now.why, "%s", apc_store_error(both));
    model_behind(&ui->model, &now);
}

void *behind_thread(void *arg)
{
    struct ui *ui = arg;
    struct apc_store *both = NULL, *live = NULL;
    struct apc_error why;
    if (ui->options.store[apc_store_live(ui->options.store)] &&
        ui_open_store(ui, "apc-ui history", TIMEOUT, &both, &why) == 0 &&
        ui_open_store(ui, "apc-ui history", 0, &live, &why) == 0)
        while (!ui->stopping) {
            measure_history_lag(ui, both, live);
            ui_pause(ui, LOOK);
        }
    apc_store_close(live);
    apc_store_close(both);
    return NULL;
}
