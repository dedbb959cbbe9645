/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The samples of a run on their way out, so that a long one needs no more memory than a short one. A sample is
 * final once no older one can come: no task that has begun, no exchange that is under way and no later step of
 * the wall clock can bring one. The store refuses one that came nevertheless (apc_store_forget()).
 */
#include "simulation.h"

#include <math.h>

#define ROWS 32768 /* about as many are taken out at once */

static apc_ns earlier(apc_ns a, apc_ns b)
{
    return a < b ? a : b;
}

/* All that is to come is stamped with this time of the wall clock or a later one. */
static apc_ns earliest_to_come(const struct simulation *s)
{
    const apc_ns now = apc_clock_mono(s->clock) - s->zero;
    apc_ns time = apc_clock_utc(s->clock);
    for (size_t i = 0; i < s->e->models.n_clock; i++)
        if (s->e->models.clock[i].at >= now)
            time += earlier(s->e->models.clock[i].step, 0);
    time = earlier(time, earlier(s->answered, earlier(s->plant_now.utc, apc_plantserver_oldest(s->server))));
    for (size_t i = 0; i < s->e->n_controllers; i++) {
        const struct simulated *c = &s->controller[i];
        const struct apc_rows *out = c->ticks ? apc_controller_out(c->core) : NULL;
        for (size_t k = 0; out && k < out->n_samples; k++)
            time = earlier(time, out->sample[k].time);
    }
    return time / APC_NS_PER_US * APC_NS_PER_US; /* as the store has it */
}

/* s: in which about ROWS of them come. */
static double slice_of(const struct simulation *s)
{
    const struct experiment *e = s->e;
    apc_ns period = s->task[0].period;
    for (size_t i = 1; i < s->n_tasks; i++)
        period = earlier(period, s->task[i].period);
    return apc_ns_to_s(period) * ceil(ROWS / (double)(e->dim.ny + e->dim.nu + e->dim.nz + e->n_signals));
}

struct stream {
    struct simulation *s;
    simulation_take_fn *take;
    void *ctx;
    apc_ns from;         /* what is older has gone */
    struct samples rows; /* of the piece that goes just now */
};

/* What is older than @p before, or 0, all, goes. */
static int let_samples_go(struct stream *out, apc_ns before)
{
    struct simulation *s = out->s;
    const struct apc_range range = {.since = out->from, .until = before};
    int rc = 0;
    out->rows.n = 0;
    if (out->take)
        rc = samples_collect(&out->rows, s->store, s->e, &range);
    if (rc == 0 && out->take)
        rc = out->take(out->ctx, &out->rows);
    if (rc == 0 && before > 0 && apc_store_forget(s->store, before) < 0)
        rc = APC_ESTORE;
    out->from = before;
    if (rc < 0 && s->rc == 0)
        s->rc = apc_fail(&s->why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(s->store));
    return rc;
}

int simulation_stream(struct simulation *s, double until, simulation_take_fn *take, void *ctx)
{
    struct stream out = {.s = s, .take = take, .ctx = ctx};
    const double slice = slice_of(s);
    apc_ns before;
    int rc = 0;
    while (rc == 0 && !s->interrupted && s->ended + slice < until) {
        rc = simulation_run(s, s->ended + slice);
        before = rc == 0 ? earliest_to_come(s) : 0;
        if (before > out.from)
            rc = let_samples_go(&out, before);
    }
    if (rc == 0)
        (void)simulation_run(s, until); /* why it ended early stays with it */
    let_samples_go(&out, 0);
    samples_free(&out.rows);
    return s->rc;
}
