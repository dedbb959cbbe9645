/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive laws expected at a time, and what came of it. */
#include <stdlib.h>

#include "apc-ui/api/api.h"
#include "record/record.h"

static void values_json(const char *name, const double *v, size_t n, struct text *t)
{
    json_add(t, "%s:[", name);
    for (size_t k = 0; k < n; k++)
        json_add(t, "%g", v[k]);
    json_add(t, "]");
}

static void trajectory_json(const struct prediction_trajectory *c, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, name:%s, made:%.6jd, first:%.9jd, step:%.9jd", ref_format(c->table, c->id, ref),
             c->name, c->made, c->first, c->step);
    values_json("expected", c->expected, c->n, t);
    values_json("came", c->came, c->n, t);
    json_add(t, "}");
}

/* The tags are read anew: those that the model keeps are the ones that people see. */
static int load_prediction(struct prediction *o, struct apc_store *store, apc_ns at, apc_ns now)
{
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tag);
    int rc = n < 0 ? n : tag ? apc_store_get_tags(store, tag, (size_t)n) : APC_ENOMEM;
    if (rc >= 0)
        rc = prediction_load(o, store, tag, (size_t)(rc < n ? rc : n), at, 0);
    if (rc == 0)
        rc = prediction_take_store(o, store, now);
    free(tag);
    return rc;
}

void get_prediction(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct prediction o = {0};
    struct text *t = &r->reply;
    const apc_ns now = apc_clock_utc(NULL);
    apc_ns at = now;
    (void)ui;
    if (!query_time(r, "at", now, &at))
        return;
    const int rc = load_prediction(&o, store, at, now);
    if (rc < 0)
        fault_store(r, rc, store);
    json_add(t, "{t:%.6jd, at:%.6jd, %s:[", now, at, r->former ? "outlook" : "predictions");
    for (size_t i = 0; i < o.n; i++)
        trajectory_json(&o.trajectory[i], t);
    json_add(t, "]}");
    prediction_free(&o);
}
