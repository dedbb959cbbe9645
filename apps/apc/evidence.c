/* SPDX-License-Identifier: BSD-3-Clause */
#include "evidence.h"

#include <stdlib.h>

#define GRACE (2 * APC_NS_PER_S) /* of a machine that has other things to do, for a daemon's first tick */

/* The mode that was wanted of a loop. */
struct turn {
    apc_ns time;
    size_t loop;
    bool out;
};

struct evidence {
    const struct experiment *e;
    struct control *control;
    struct turn *turns; /* in the order of time */
    size_t n, room, next;
    size_t loop;     /* whose turns are being read */
    bool full;       /* there is no memory for more */
    bool *out;       /* [loops] out of service */
    size_t *outputs; /* [loops] to which of the plant's outputs; dim.nu: to none */
};

static int take_mode(void *ctx, const struct apc_sample *row)
{
    struct evidence *v = ctx;

    if (v->n == v->room) {
        const size_t room = v->room ? 2 * v->room : 64;
        struct turn *turns = realloc(v->turns, room * sizeof *turns);
        if (!turns) {
            v->full = true;
            return 1;
        }
        v->turns = turns;
        v->room = room;
    }
    v->turns[v->n++] = (struct turn){row->time, v->loop, (int)row->value == APC_MODE_OOS};
    return 0;
}

static int by_time(const void *a, const void *b)
{
    const struct turn *p = a, *q = b;
    return (p->time > q->time) - (p->time < q->time);
}

/* An output has as many loops as controllers that may act on it. */
static bool any_output_out(const struct evidence *v, size_t loops)
{
    for (size_t i = 0; i < loops; i++) {
        size_t k = 0;
        while (v->outputs[i] < v->e->dim.nu && k < loops && (v->outputs[k] != v->outputs[i] || v->out[k]))
            k++;
        if (k == loops)
            return true;
    }
    return false;
}

static void turn_until(struct evidence *v, apc_ns time)
{
    const size_t loops = controllers_loops(v->e);

    for (; v->next < v->n && v->turns[v->next].time <= time; v->next++) {
        const struct turn *t = &v->turns[v->next];
        v->out[t->loop] = t->out;
        control_excuse(v->control, t->time, any_output_out(v, loops));
    }
}

static int take_event(void *ctx, const struct apc_event *event)
{
    struct evidence *v = ctx;

    turn_until(v, event->time);
    control_take(v->control, event);
    return 0;
}

/* What is said in the file, then what was there before, then what was written. */
static int read_modes(struct evidence *v, struct apc_store *store, const struct apc_range *range)
{
    const struct apc_range before = {.until = range->since, .last = 1};
    int rc = 0;

    for (size_t i = 0; i < v->e->n_controllers; i++) {
        const struct controller *c = &v->e->controllers[i];
        for (size_t k = 0; k < c->dim.nu && rc >= 0; k++) {
            const int id = c->first_loop + (int)k;
            v->loop = (size_t)id - 1;
            v->outputs[v->loop] = c->u[k].table == APC_ACTUATOR ? c->u[k].at : v->e->dim.nu;
            v->out[v->loop] = c->mode == APC_MODE_OOS;
            if (range->since > 0)
                rc = apc_store_history(store, APC_OPMODE, id, &before, take_mode, v);
            if (rc >= 0)
                rc = apc_store_history(store, APC_OPMODE, id, range, take_mode, v);
        }
    }
    if (v->n > 1)
        qsort(v->turns, v->n, sizeof *v->turns, by_time);
    return v->full ? APC_ENOMEM : rc;
}

static int note_time(void *ctx, const struct apc_vector *tick)
{
    *(apc_ns *)ctx = tick->time;
    return 1;
}

static bool commands_plant(const struct controller *c)
{
    size_t k = 0;
    while (k < c->dim.nu && c->u[k].table != APC_ACTUATOR)
        k++;
    return k < c->dim.nu;
}

int evidence_begin(struct apc_store *store, const struct experiment *e, apc_ns start, apc_ns *begin)
{
    const struct apc_range range = {.since = start};
    int rc = 0;

    *begin = start;
    for (size_t i = 0; i < e->n_controllers && rc >= 0; i++) {
        apc_ns first = start;
        if (commands_plant(&e->controllers[i]))
            rc = apc_store_vectors(store, APC_TICK, e->controllers[i].number, &range, note_time, &first);
        *begin = first > *begin ? first : *begin;
    }
    if (*begin > start + GRACE)
        *begin = start + GRACE;
    *begin += 3 * cores_command_period(e) + 100 * APC_NS_PER_MS;
    return rc < 0 ? rc : 0;
}

int evidence_take(struct apc_store *store, const struct experiment *e, const struct apc_range *range,
                  struct control *control)
{
    const size_t loops = controllers_loops(e);
    struct evidence v = {.e = e,
                         .control = control,
                         .out = calloc(loops, sizeof *v.out),
                         .outputs = calloc(loops, sizeof *v.outputs)};
    int rc = v.out && v.outputs ? read_modes(&v, store, range) : APC_ENOMEM;

    if (rc >= 0) {
        control_excuse(control, control->since, any_output_out(&v, loops));
        rc = apc_store_events(store, range, take_event, &v);
        turn_until(&v, range->until);
    }
    free(v.turns);
    free(v.out);
    free(v.outputs);
    return rc < 0 ? rc : 0;
}
