/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A loop with other tuning, on a model of what it moves: its controller's own module in virtual time. Nothing
 * else of the plant is there, and a loop of another output of the same controller rests.
 */
#include "simulation.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAN_TICKS 3 /* that it is held at its operating point before it begins */

struct previewing {
    const struct loop_preview *p;
    const struct controller *c;
    struct apc_sample measured, setpoint, mode, manual; /* what is written to the store */
    int output;
    struct apc_store *store;
    struct apc_controller *core;
    struct apc_linear *plant; /* without the whole periods of the dead time */
    double *x, *held;         /* [2 * nx]; [late] outputs that are on their way */
    size_t late;
};

static int put_preview(const struct previewing *z, struct apc_sample *s, double value, apc_ns now)
{
    s->seq++;
    s->time = now;
    s->value = value;
    return s->table == APC_SENSOR ? apc_store_append(z->store, s, 1) : apc_store_put(z->store, s, 1);
}

static int make_preview_plant(struct previewing *z, struct apc_error *why)
{
    const double Ts = apc_ns_to_s(z->c->rhythm.period);
    struct apc_transfer g = z->p->g;
    int rc;

    z->late = (size_t)(g.dead_time / Ts);
    g.dead_time -= (double)z->late * Ts;
    rc = apc_linear_from_transfer(&z->plant, 1, 1, 0, &g, NULL, NULL, Ts, why);
    if (rc < 0)
        return rc;
    z->x = calloc(2 * z->plant->nx + 1, sizeof *z->x);
    z->held = calloc(z->late + 1, sizeof *z->held);
    return z->x && z->held ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
}

static int open_preview(struct previewing *z, struct apc_error *why)
{
    char uri[64];
    size_t n = 0;
    struct apc_sample *first = module_first(z->p->e, SIMULATION_BEGIN, &n);
    int rc = first ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    snprintf(uri, sizeof uri, "mem:apc-preview-%p", (void *)z);
    if (rc == 0)
        rc = apc_store_open(&z->store, uri, NULL, why);
    if (rc == 0 && ((rc = apc_store_init(z->store)) < 0 || (rc = apc_store_put(z->store, first, n)) < 0))
        apc_fail(why, rc, "%s", apc_store_error(z->store));
    free(first);
    if (rc >= 0)
        rc = module_controller(z->p->e, z->c, false, &z->core, why);
    if (rc == 0)
        (void)apc_controller_resume(z->core, 0);
    return rc;
}

/* What the controller puts out at tick @p k, of a plant that measures @p y. Returns 0 or the store's error. */
static int tick_preview(struct previewing *z, size_t k, double y, double *u)
{
    const struct loop_preview *p = z->p;
    const apc_ns now = SIMULATION_BEGIN + (apc_ns)(k + 1) * z->c->rhythm.period;
    const bool begins = k == MAN_TICKS;
    struct apc_rows *rows;
    int rc = put_preview(z, &z->measured, y, now);

    if (rc >= 0 && (k == 0 || begins))
        rc = put_preview(z, &z->mode, begins ? APC_MODE_AUTO : APC_MODE_MAN, now);
    if (rc >= 0 && k == 1) /* once it is in Man */
        rc = put_preview(z, &z->manual, p->u0, now);
    if (rc >= 0 && (k == 0 || begins))
        rc = put_preview(z, &z->setpoint, begins ? p->y0 + p->step : p->y0, now);
    if (rc >= 0)
        rc = apc_store_read_rows(z->store, apc_controller_in(z->core));
    if (rc < 0)
        return rc;
    apc_controller_compute(z->core, (struct apc_now){.mono = now, .utc = now}, k, true, NULL);
    rows = apc_controller_out(z->core);
    rc = apc_store_append_rows(z->store, rows);
    apc_controller_update(z->core, rc < 0 ? -1 : 1);
    for (size_t i = 0; i < rows->n_samples; i++)
        if (rows->sample[i].table == APC_ACTUATOR && rows->sample[i].id == z->output)
            *u = rows->sample[i].value;
    return rc < 0 ? rc : 0;
}

static int run_preview(struct previewing *z, struct loop_preview *p, struct apc_error *why)
{
    double u = p->u0, y = 0.0;

    for (size_t k = 0; k < MAN_TICKS + p->n; k++) {
        double *now = z->x + (k % 2) * z->plant->nx, *next = z->x + ((k + 1) % 2) * z->plant->nx;
        double in = 0.0, former;
        int rc;

        apc_linear_output(z->plant, now, &in, &y); /* there is no way from u to y of the same sample */
        rc = tick_preview(z, k, p->y0 + y, &u);
        if (rc < 0)
            return apc_fail(why, rc, "%s", apc_store_error(z->store));
        if (k >= MAN_TICKS) {
            p->y[k - MAN_TICKS] = p->y0 + y;
            p->u[k - MAN_TICKS] = u;
        }
        in = k < MAN_TICKS ? 0.0 : u - p->u0 + (k >= MAN_TICKS + p->n / 2 ? p->load : 0.0);
        former = z->late ? z->held[k % z->late] : in;
        if (z->late)
            z->held[k % z->late] = in;
        apc_linear_next(z->plant, now, &former, next);
    }
    return 0;
}

int loop_preview_run(struct loop_preview *p, struct apc_error *why)
{
    const struct controller_loop loop = controllers_loop(p->e, p->loop);
    const struct controller *c = loop.of;
    struct previewing z = {.p = p,
                           .c = c,
                           .output = controllers_output(p->e, loop)->id,
                           .mode = {.table = APC_OPMODE, .id = controllers_loop_id(loop)},
                           .manual = {.table = APC_MANUAL, .id = controllers_loop_id(loop)}};
    int rc;

    p->Ts = apc_ns_to_s(c->rhythm.period);
    z.measured = (struct apc_sample){.table = APC_SENSOR,
                                     .id = p->e->y[c->y[c->pair[loop.u].measurement - 1].at].tag.id};
    z.setpoint = (struct apc_sample){.table = APC_SETPOINT,
                                     .id = p->e->z[c->z[c->pair[loop.u].setpoint - 1].at].tag.id};
    p->y = calloc(2 * p->n + 1, sizeof *p->y);
    p->u = p->y ? p->y + p->n : NULL;
    rc = p->y ? make_preview_plant(&z, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = open_preview(&z, why);
    if (rc == 0)
        rc = run_preview(&z, p, why);
    apc_controller_destroy(z.core);
    apc_store_close(z.store);
    apc_linear_destroy(z.plant);
    free(z.x);
    free(z.held);
    return rc;
}

void loop_preview_free(struct loop_preview *p)
{
    free(p->y);
    p->y = p->u = NULL;
}
