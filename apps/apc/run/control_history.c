/* SPDX-License-Identifier: BSD-3-Clause */
#include "control_history.h"

#include <stdlib.h>

#define GRACE (2 * APC_NS_PER_S) /* of a machine that has other things to do, for a daemon's first tick */

/* From then on it is so, or no more: the plant is commanded, a loop out of service, an output at its fault
 * value. */
struct transition {
    apc_ns time;
    enum { TRANSITION_NONE = 0, TRANSITION_COMMAND, TRANSITION_OUT, TRANSITION_FAULT } kind;
    size_t at; /* loop, or output */
    bool is;
    int64_t number; /* of an event */
};

struct control_history {
    const struct experiment *e;
    struct control *control;
    struct transition *transitions;
    size_t n, room;
    int failed;             /* there is no memory for more */
    struct transition next; /* as it is being read */
    bool *out;              /* [loops] out of service */
    bool *fault;            /* [nu] at its fault value */
    size_t *outputs;        /* [loops] to which of the plant's outputs; dim.nu: to none */
    struct missing *missing;
    uint64_t rows; /* of the variable that is being read */
    int64_t first, last;
};

static int add_transition(struct control_history *v, const struct transition *transition)
{
    if (v->n == v->room) {
        const size_t room = v->room ? 2 * v->room : 64;
        struct transition *transitions = realloc(v->transitions, room * sizeof *transitions);
        if (!transitions)
            return v->failed = APC_ENOMEM;
        v->transitions = transitions;
        v->room = room;
    }
    v->transitions[v->n++] = *transition;
    return 0;
}

/* A row that says no more than the one before it is none. */
static int add_turn(struct control_history *v, apc_ns time, bool is)
{
    if (is == v->next.is)
        return 0;
    v->next.time = time;
    v->next.is = is;
    return add_transition(v, &v->next);
}

static int take_mode(void *ctx, const struct apc_sample *row)
{
    return add_turn(ctx, row->time, (int)row->value == APC_MODE_OOS);
}

static int take_history_event(void *ctx, const struct apc_event *event)
{
    struct control_history *v = ctx;
    bool commanded;
    return control_hears(v->control, event, &commanded)
               ? add_transition(
                     v, &(struct transition){event->time, TRANSITION_COMMAND, 0, commanded, event->number})
               : 0;
}

/* An output has as many loops as controllers that may act on it. */
static bool any_output_out(const struct control_history *v)
{
    const size_t loops = controllers_loops(v->e);
    for (size_t i = 0; i < loops; i++) {
        size_t k = 0;
        while (v->outputs[i] < v->e->dim.nu && k < loops && (v->outputs[k] != v->outputs[i] || v->out[k]))
            k++;
        if (k == loops)
            return true;
    }
    return false;
}

static const char *at_fault(const struct control_history *v)
{
    size_t i = 0;
    while (i < v->e->dim.nu && !v->fault[i])
        i++;
    return i < v->e->dim.nu ? v->e->u[i].tag.name : NULL;
}

static int by_time(const void *a, const void *b)
{
    const struct transition *p = a, *q = b;
    return p->time != q->time ? (p->time > q->time) - (p->time < q->time)
                              : (p->number > q->number) - (p->number < q->number);
}

static void tell_output_status(struct control_history *v)
{
    if (v->n > 1)
        qsort(v->transitions, v->n, sizeof *v->transitions, by_time);
    control_excuse(v->control, v->control->begin, any_output_out(v));
    for (const struct transition *f = v->transitions; f < v->transitions + v->n; f++) {
        if (f->kind == TRANSITION_COMMAND) {
            control_command(v->control, f->time, f->is);
        } else if (f->kind == TRANSITION_OUT) {
            v->out[f->at] = f->is;
            control_excuse(v->control, f->time, any_output_out(v));
        } else {
            v->fault[f->at] = f->is;
            control_fault(v->control, f->time, at_fault(v));
        }
    }
}

/* What is said in the file, then what was there before, then what was written. */
static int read_mode_transitions(struct control_history *v, struct apc_store *store,
                                 const struct apc_range *range)
{
    const struct apc_range before = {.until = range->since, .last = 1};
    int rc = 0;

    for (size_t i = 0; i < v->e->n_controllers; i++) {
        const struct controller *c = &v->e->controllers[i];
        for (size_t k = 0; k < c->dim.nu && rc >= 0; k++) {
            const int id = c->first_loop + (int)k;
            v->next = (struct transition){.kind = TRANSITION_OUT, .at = (size_t)id - 1};
            v->outputs[v->next.at] = c->u[k].table == APC_ACTUATOR ? c->u[k].at : v->e->dim.nu;
            v->out[v->next.at] = v->next.is = c->mode == APC_MODE_OOS;
            if (range->since > 0)
                rc = apc_store_history(store, APC_OPMODE, id, &before, take_mode, v);
            if (rc >= 0)
                rc = apc_store_history(store, APC_OPMODE, id, range, take_mode, v);
        }
    }
    return rc;
}

static int take_history_row(void *ctx, const struct apc_sample *row)
{
    struct control_history *v = ctx;
    v->first = v->rows++ ? v->first : row->seq;
    v->last = row->seq;
    return v->next.kind == TRANSITION_FAULT
               ? add_turn(v, row->time, (row->status ^ APC_UNCERTAIN_SUBSTITUTE) >> 16 == 0)
               : 0;
}

static int count_row(void *ctx, const struct apc_sample *row)
{
    struct control_history *v = ctx;
    v->rows += row->seq <= v->last;
    return row->seq >= v->last;
}

/* A measurement is counted without a gap, from the first of the run to its last, whatever a clock that was
 * stepped says of those between. An output that could not be stored never was one. */
static int count_measurement(struct control_history *v, struct apc_store *store, size_t i)
{
    struct missing *m = v->missing;
    const char *name = v->e->y[i].tag.name;
    const uint64_t of = v->rows ? (uint64_t)(v->last - v->first) + 1 : 0;
    int rc = 0;
    if (v->rows == 0 && !m->empty)
        m->empty = name;
    if (of > v->rows) {
        v->rows = 0;
        rc = apc_store_history(store, APC_SENSOR, (int)i + 1, &(struct apc_range){.after = v->first - 1},
                               count_row, v);
    }
    if (rc >= 0 && of > v->rows && of - v->rows > m->rows)
        *m = (struct missing){m->empty, name, of - v->rows, of};
    return rc;
}

static int read_rows(struct control_history *v, struct apc_store *store, const struct apc_range *range,
                     enum apc_table table, size_t i)
{
    v->rows = 0;
    v->next = (struct transition){.kind = table == APC_SENSOR ? TRANSITION_NONE : TRANSITION_FAULT, .at = i};
    int rc = apc_store_history(store, table, (int)i + 1, range, take_history_row, v);
    return rc >= 0 && table == APC_SENSOR ? count_measurement(v, store, i) : rc;
}

static int read_all_rows(struct control_history *v, struct apc_store *store, const struct apc_range *range)
{
    int rc = 0;
    *v->missing = (struct missing){0};
    for (size_t i = 0; i < v->e->dim.ny && rc >= 0; i++)
        rc = read_rows(v, store, range, APC_SENSOR, i);
    for (size_t i = 0; i < v->e->dim.nu && rc >= 0; i++)
        rc = read_rows(v, store, range, APC_ACTUATOR, i);
    return rc;
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

int control_history_begin(struct apc_store *store, const struct experiment *e, apc_ns start, apc_ns *begin)
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
    *begin += 3 * module_command_period(e) + 100 * APC_NS_PER_MS;
    return rc < 0 ? rc : 0;
}

int control_history_read(struct apc_store *store, const struct experiment *e, const struct apc_range *range,
                         struct control *control, struct missing *missing)
{
    const size_t loops = controllers_loops(e);
    struct control_history v = {.e = e,
                                .control = control,
                                .missing = missing,
                                .out = calloc(loops, sizeof *v.out),
                                .fault = calloc(e->dim.nu, sizeof *v.fault),
                                .outputs = calloc(loops, sizeof *v.outputs)};
    int rc = v.out && v.fault && v.outputs ? read_mode_transitions(&v, store, range) : APC_ENOMEM;

    if (rc >= 0)
        rc = read_all_rows(&v, store, range);
    if (rc >= 0)
        rc = apc_store_events(store, range, take_history_event, &v);
    rc = rc >= 0 && v.failed ? v.failed : rc;
    if (rc >= 0)
        tell_output_status(&v);
    free(v.transitions);
    free(v.out);
    free(v.fault);
    free(v.outputs);
    return rc < 0 ? rc : 0;
}
