/* SPDX-License-Identifier: BSD-3-Clause */
/* What there was at an instant: values, who wrote them, alarms. */
#include <stdlib.h>

#include "apc-ui/api/api.h"

struct apc_store *request_past(struct request *r, struct apc_store *store)
{
    struct apc_store *past = NULL;
    struct apc_error why;
    apc_ns at = 0;
    if (query_time(r, "at", apc_clock_utc(NULL), &at) && apc_store_past(&past, store, at, &why) < 0)
        fault_set(&r->fault, 422, "parameter", "at", "%.150s", why.text);
    return past;
}

void past_members(struct apc_store *past, struct text *t)
{
    (void)apc_store_connect(past); /* the last operation may have said something else */
    json_add(t, "t:%.6jd, as_of:%.6jd, note:%-s", apc_clock_utc(NULL), apc_store_now(past),
             apc_store_error(past));
}

/* What people see, and the ticks of its controllers, to be read. */
struct then {
    struct apc_rows rows;
    struct loops_controller *controller; /* with their periods */
};

static bool name_rows(struct model *m, struct then *then)
{
    pthread_mutex_lock(&m->mutex);
    const struct plant *p = &m->plant;
    then->rows = (struct apc_rows){.size = sizeof then->rows,
                                   .sample = calloc(p->n + 1, sizeof *then->rows.sample),
                                   .n_samples = p->n,
                                   .vector = calloc(p->loops.n_controllers + 1, sizeof *then->rows.vector),
                                   .n_vectors = p->loops.n_controllers};
    then->controller = calloc(p->loops.n_controllers + 1, sizeof *then->controller);
    const bool made = then->rows.sample && then->rows.vector && then->controller;
    for (size_t i = 0; made && i < p->n; i++)
        then->rows.sample[i] = (struct apc_sample){.table = p->tag[i].table, .id = p->tag[i].id};
    for (size_t i = 0; made && i < p->loops.n_controllers; i++) {
        then->controller[i] = p->loops.controller[i];
        then->controller[i].period = plant_tick_time(p, i);
        then->rows.vector[i] = (struct apc_vector){.table = APC_TICK, .id = p->loops.controller[i].number};
    }
    pthread_mutex_unlock(&m->mutex);
    return made;
}

static void free_rows(struct then *then)
{
    free(then->rows.sample);
    free(then->rows.vector);
    free(then->controller);
}

static void values_then_json(const struct then *then, struct apc_store *past, struct text *t)
{
    const struct apc_rows *rows = &then->rows;
    const apc_ns at = apc_store_now(past);
    char ref[REF_LEN], name[APC_AUTHOR_LEN];
    json_add(t, "values:{");
    for (size_t i = 0; i < rows->n_samples; i++) {
        json_add(t, "%s:", ref_format(rows->sample[i].table, rows->sample[i].id, ref));
        json_sample_add(t, &rows->sample[i]);
    }
    json_add(t, "}, ages:{");
    for (size_t i = 0; i < rows->n_samples; i++)
        json_add(t, "%s:%.9jd", ref_format(rows->sample[i].table, rows->sample[i].id, ref),
                 rows->sample[i].seq > 0 ? at - rows->sample[i].time : JSON_NONE);
    json_add(t, "}, authors:{");
    for (size_t i = 0; i < rows->n_samples; i++)
        if (rows->sample[i].author > 0 && apc_store_author_name(past, rows->sample[i].author, name) == 0)
            json_add(t, "%s:%s", ref_format(rows->sample[i].table, rows->sample[i].id, ref), name);
    json_add(t, "}, running:{");
    for (size_t i = 0; i < rows->n_vectors; i++) {
        const apc_ns period = then->controller[i].period, most = 3 * period;
        const bool ticks = rows->vector[i].seq > 0 &&
                           at - rows->vector[i].time <= (most > APC_NS_PER_S ? most : APC_NS_PER_S);
        json_add(t, "%s:%i", then->controller[i].name, period > 0 ? ticks : -1);
    }
    json_add(t, "}");
}

/* Those that had left Normal, as a state has them. Returns 0 or the store's error. */
static int alarms_then_json(struct apc_store *past, struct text *t)
{
    struct alarm_summary board = {0};
    struct apc_error why;
    int rc = alarm_summary_open(&board, past, &why);
    if (rc == 0)
        rc = alarm_summary_read(&board, past);
    if (rc == 0)
        rc = alarm_summary_mark(&board, past);
    json_add(t, "alarms:[");
    for (size_t i = 0; rc == 0 && i < board.e.n_alarms; i++)
        if (board.at[i].row->seq > 0)
            alarm_stands_json(&board.at[i], past, t);
    json_add(t, "]");
    alarm_summary_close(&board);
    return rc == APC_ENOTFOUND ? 0 : rc;
}

void state_then(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct apc_store *past = request_past(r, store);
    struct then then = {.controller = NULL};
    if (!past)
        return;
    int rc = name_rows(&ui->model, &then) ? apc_store_read_rows(past, &then.rows) : APC_ENOMEM;
    json_add(&r->reply, "{");
    if (rc == 0) {
        past_members(past, &r->reply);
        values_then_json(&then, past, &r->reply);
        rc = alarms_then_json(past, &r->reply);
    }
    json_add(&r->reply, "}");
    if (rc < 0)
        fault_store(r, rc, past);
    free_rows(&then);
    apc_store_close(past);
}
