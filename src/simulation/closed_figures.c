/* SPDX-License-Identifier: BSD-3-Clause */
/* A part of a run, as if it were one: what was in force when it begins is written then. */
#include "simulation.h"

int closed_window(struct samples *to, const struct samples *of, apc_ns from, apc_ns until)
{
    size_t before = 0;
    int rc = 0;
    while (before < of->n && of->at[before].time < from)
        before++;
    for (size_t i = before; i-- > 0 && rc == 0;) {
        struct apc_sample row = of->at[i];
        bool known = row.table == APC_SENSOR;
        for (size_t k = 0; k < to->n && !known; k++)
            known = to->at[k].table == row.table && to->at[k].id == row.id;
        row.time = from;
        rc = known ? 0 : samples_add(to, &row);
    }
    for (size_t i = before; i < of->n && of->at[i].time < until && rc == 0; i++)
        rc = samples_add(to, &of->at[i]);
    return rc;
}

int closed_figures(struct figures *f, const struct samples *of, const struct experiment *e, apc_ns from,
                   apc_ns until)
{
    struct samples part = {0};
    struct trajectory c = {.output = NULL};
    *f = (struct figures){0};
    int rc = closed_window(&part, of, from, until);
    if (rc == 0)
        rc = trajectory_of_samples(&c, &part, e, from);
    c.end = apc_ns_to_s(until - from);
    if (rc == 0)
        rc = figures_make(f, &c, e);
    trajectory_free(&c);
    samples_free(&part);
    return rc;
}
