/* SPDX-License-Identifier: BSD-3-Clause */
/* The alarms as the live thread follows them: into the model, and what is new to the stream. */
#include <stdlib.h>

#include "apc-ui/ui.h"

static void forget_alarm_watch(struct alarm_watch *w)
{
    for (size_t i = 0; w->told && i < w->board.e.n_alarms; i++)
        text_free(&w->told[i].json);
    free(w->told);
    w->told = NULL;
    w->looked = 0;
}

void alarm_watch_free(struct alarm_watch *w)
{
    forget_alarm_watch(w);
    alarm_summary_close(&w->board);
}

/* The model's from here on. */
static void give_to_model(struct model *m, struct text *place, const struct text *t)
{
    pthread_mutex_lock(&m->mutex);
    struct text old = *place;
    *place = *t;
    text_free(&m->plant_zipped);
    pthread_mutex_unlock(&m->mutex);
    text_free(&old);
}

int alarm_watch_describe(struct alarm_watch *w, struct ui *ui, struct apc_store *store)
{
    struct text are = {0}, stand = {0};
    struct apc_error why;
    forget_alarm_watch(w);
    int rc = alarm_summary_open(&w->board, store, &why);
    if (rc < 0 && !apc_store_connected(store))
        return rc;
    if (rc < 0 && rc != APC_ENOTFOUND)
        apc_log_write(ui->log, APC_LOG_WARN, "the alarms are not known: %s", why.text);
    if (rc == 0) {
        if (!(w->told = calloc(w->board.e.n_alarms, sizeof *w->told)))
            return APC_ENOMEM;
        alarms_described_json(&w->board.e, &are);
    }
    give_to_model(&ui->model, &ui->model.alarms_are, &are);
    give_to_model(&ui->model, &ui->model.alarms_stand, &stand);
    return 0;
}

/* What stands otherwise than it was told: into the text. */
static void compare_alarms(struct alarm_watch *w, struct apc_store *store, struct text *news)
{
    for (size_t i = 0; i < w->board.e.n_alarms; i++) {
        const struct alarm_now *now = &w->board.at[i];
        struct alarm_told *told = &w->told[i];
        if (now->row->seq == told->seq && alarm_summary_shelved(now) == told->shelved &&
            now->first_out == told->first_out)
            continue;
        told->seq = now->row->seq;
        told->shelved = alarm_summary_shelved(now);
        told->first_out = now->first_out;
        text_free(&told->json);
        alarm_stands_json(now, store, &told->json);
        json_text_add(news, &told->json);
    }
}

static void tell_alarm_news(struct alarm_watch *w, struct ui *ui, const struct text *news)
{
    struct text all = {0}, t = {0};
    for (size_t i = 0; i < w->board.e.n_alarms; i++)
        if (w->told[i].json.n > 0)
            json_text_add(&all, &w->told[i].json);
    give_to_model(&ui->model, &ui->model.alarms_stand, &all);
    json_add(&t, "{t:%.6jd, alarms:[", apc_clock_utc(NULL));
    text_put(&t, news->at, news->n);
    json_add(&t, "]}");
    if (!t.failed && !news->failed)
        stream_publish(ui->stream, "alarms", t.at, t.n, true);
    text_free(&t);
}

/* A transition is stored together with the tick that counts it; only the end of shelving moves without one. */
int alarm_watch_look(struct alarm_watch *w, struct ui *ui, struct apc_store *store,
                     const struct apc_vector *tick)
{
    const double transitions = tick->value[APC_ALARMS_JOURNAL];
    const bool moved = w->looked == 0 || transitions < w->transitions || transitions > w->transitions,
               shelved = tick->value[APC_ALARMS_SHELVED] > 0;
    struct text news = {0};
    if (!w->told || tick->seq == w->looked || !(moved || shelved))
        return 0;
    int rc = alarm_summary_read(&w->board, store);
    if (rc == 0)
        rc = alarm_summary_mark(&w->board, store);
    if (rc < 0)
        return rc;
    w->looked = tick->seq;
    w->transitions = transitions;
    compare_alarms(w, store, &news);
    if (news.n > 0)
        tell_alarm_news(w, ui, &news);
    text_free(&news);
    return 0;
}
