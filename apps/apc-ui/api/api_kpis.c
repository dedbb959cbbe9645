/* SPDX-License-Identifier: BSD-3-Clause */
/* What the controllers were worth over a window of history. */
#include "apc-ui/api/api.h"
#include "figures/figures.h"

#define DAY  (86400 * APC_NS_PER_S)
#define MOST 1000000 /* rows that are held at once */

static void kpis_loop_json(const struct kpis_loop *l, struct text *t)
{
    json_add(
        t, "{id:%d, name:%s, service:%g, at_low:%g, at_high:%g, sd_in_service:%g, sd_without:%g, benefit:%g}",
        l->id, l->name, l->service, l->low, l->high, l->with, l->without, l->benefit);
}

static void put_predictions_body(const struct kpis_prediction *p, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, name:%s, step:%g, steps:%zu, rms_one_step:%g, rms_all_steps:%g}",
             ref_format(APC_SENSOR, p->measurement, ref), p->name, p->step, p->length, p->first, p->last);
}

static void plans_json(const struct kpis_limit *l, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, name:%s, plans:%ju, low:%g, high:%g, falls:%g, rises:%g}",
             ref_format(l->table, l->variable, ref), l->name, l->plans, l->low, l->high, l->falls, l->rises);
}

static void put_kpis_body(const struct kpis *m, struct text *t)
{
    json_add(t, "{");
    range_json(t, m->from, m->until);
    json_add(t, "loops:[");
    for (size_t i = 0; i < m->n_loops; i++)
        kpis_loop_json(&m->loop[i], t);
    json_add(t, "], predictions:[");
    for (size_t i = 0; i < m->n_predictions; i++)
        put_predictions_body(&m->prediction[i], t);
    json_add(t, "], plans:[");
    for (size_t i = 0; i < m->n_limits; i++)
        plans_json(&m->limit[i], t);
    json_add(t, "]}");
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
