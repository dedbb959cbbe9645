/* SPDX-License-Identifier: BSD-3-Clause */
/* What the controllers were worth over a window of history. */
#include <inttypes.h>

#include "apc-ui/api/api.h"
#include "figures/figures.h"

#define DAY  (86400 * APC_NS_PER_S)
#define MOST 1000000 /* rows that are held at once */

static void figure(const char *name, double value, struct text *t)
{
    text_add(t, ",\"%s\":", name);
    json_number_add(t, value);
}

static void kpis_loop_json(const struct kpis_loop *l, struct text *t)
{
    text_add(t, "{\"id\":%d,\"name\":", l->id);
    json_string_add(t, l->name);
    figure("service", l->service, t);
    figure("at_low", l->low, t);
    figure("at_high", l->high, t);
    figure("sd_in_service", l->with, t);
    figure("sd_without", l->without, t);
    figure("benefit", l->benefit, t);
    text_add(t, "},");
}

static void kpis_variable_json(enum apc_table table, int id, const char *name, struct text *t)
{
    char ref[REF_LEN];
    text_add(t, "{\"ref\":\"%s\",\"name\":", ref_format(table, id, ref));
    json_string_add(t, name);
}

static void put_predictions_body(const struct kpis_prediction *p, struct text *t)
{
    kpis_variable_json(APC_SENSOR, p->measurement, p->name, t);
    figure("step", p->step, t);
    text_add(t, ",\"steps\":%zu", p->length);
    figure("rms_one_step", p->first, t);
    figure("rms_all_steps", p->last, t);
    text_add(t, "},");
}

static void plans_json(const struct kpis_limit *l, struct text *t)
{
    kpis_variable_json(l->table, l->variable, l->name, t);
    text_add(t, ",\"plans\":%" PRIu64, l->plans);
    figure("low", l->low, t);
    figure("high", l->high, t);
    figure("falls", l->falls, t);
    figure("rises", l->rises, t);
    text_add(t, "},");
}

static void put_kpis_body(const struct kpis *m, struct text *t)
{
    text_put(t, "{", 1);
    range_json(t, m->from, m->until);
    text_add(t, ",\"loops\":[");
    for (size_t i = 0; i < m->n_loops; i++)
        kpis_loop_json(&m->loop[i], t);
    text_chop(t, ',');
    text_add(t, "],\"predictions\":[");
    for (size_t i = 0; i < m->n_predictions; i++)
        put_predictions_body(&m->prediction[i], t);
    text_chop(t, ',');
    text_add(t, "],\"plans\":[");
    for (size_t i = 0; i < m->n_limits; i++)
        plans_json(&m->limit[i], t);
    text_chop(t, ',');
    text_add(t, "]}");
}

void get_kpis(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct kpis m = {0};
    apc_ns since, until;
    (void)ui;
    if (!query_range(r, DAY, 0, &since, &until))
        return;
    const int rc = kpis_of_store(&m, store, since, until, MOST);
    if (rc == APC_ERANGE)
        fault_set(&r->fault, 422, "parameter", "since", "more than %d rows: ask for less time at once", MOST);
    else if (rc < 0 && rc != APC_ENOTFOUND)
        fault_store(r, rc, store);
    put_kpis_body(&m, &r->reply);
    kpis_free(&m);
}
