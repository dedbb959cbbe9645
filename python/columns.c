/* SPDX-License-Identifier: BSD-3-Clause */
#include <apcstore.h>
#include <stdlib.h>
#include <time.h>

#include "columns.h"
#include "files/files.h"

enum { ROOM = 1024 }; /* rows, at first; then twice as many */

void *apc_columns_new(size_t size)
{
    return calloc(1, size);
}

/* ---- Samples ------------------------------------------------------------------------------- */

static bool widen(struct apc_columns *c)
{
    const size_t room = c->room ? 2 * c->room : ROOM;

    if (!apc_grow(&c->seq, room, sizeof *c->seq) || !apc_grow(&c->time, room, sizeof *c->time) ||
        !apc_grow(&c->value, room, sizeof *c->value) || !apc_grow(&c->status, room, sizeof *c->status) ||
        !apc_grow(&c->origin, room, sizeof *c->origin))
        return false;
    c->room = room;
    return true;
}

static int take_sample(void *ctx, const struct apc_sample *sample)
{
    struct apc_columns *const c = ctx;

    if ((c->most > 0 && c->n == c->most) || (c->n == c->room && !widen(c)))
        return 1;
    c->seq[c->n] = sample->seq;
    c->time[c->n] = sample->time;
    c->value[c->n] = sample->value;
    c->status[c->n] = sample->status;
    c->origin[c->n] = sample->origin;
    c->n++;
    return 0;
}

int apc_columns_read(struct apc_columns *columns, struct apc_store *store, int table, int id,
                     const struct apc_range *range)
{
    const int n = apc_store_history(store, (enum apc_table)table, id, range, take_sample, columns);

    return n >= 0 && (size_t)n != columns->n && columns->n != columns->most ? APC_ENOMEM : n;
}

void apc_columns_free(struct apc_columns *columns)
{
    free(columns->seq);
    free(columns->time);
    free(columns->value);
    free(columns->status);
    free(columns->origin);
    free(columns);
}

/* ---- Vectors ------------------------------------------------------------------------------- */

static bool lengthen(struct apc_ragged *r)
{
    const size_t room = r->room ? 2 * r->room : ROOM;

    if (!apc_grow(&r->seq, room, sizeof *r->seq) || !apc_grow(&r->time, room, sizeof *r->time) ||
        !apc_grow(&r->status, room, sizeof *r->status) || !apc_grow(&r->end, room, sizeof *r->end))
        return false;
    r->room = room;
    return true;
}

static bool make_space(struct apc_ragged *r, size_t n)
{
    size_t space = r->space ? r->space : ROOM;

    while (space < r->elements + n)
        space *= 2;
    if (space > r->space && !apc_grow(&r->value, space, sizeof *r->value))
        return false;
    r->space = space;
    return true;
}

static int take_vector(void *ctx, const struct apc_vector *vector)
{
    struct apc_ragged *const r = ctx;

    if ((r->n == r->room && !lengthen(r)) || !make_space(r, vector->n))
        return 1;
    for (size_t i = 0; i < vector->n; i++)
        r->value[r->elements++] = vector->value[i];
    r->seq[r->n] = vector->seq;
    r->time[r->n] = vector->time;
    r->status[r->n] = vector->status;
    r->end[r->n] = (int64_t)r->elements;
    r->n++;
    return 0;
}

int apc_ragged_read(struct apc_ragged *ragged, struct apc_store *store, int table, int id,
                    const struct apc_range *range)
{
    const int n = apc_store_vectors(store, (enum apc_table)table, id, range, take_vector, ragged);

    return n >= 0 && (size_t)n != ragged->n ? APC_ENOMEM : n;
}

void apc_ragged_free(struct apc_ragged *ragged)
{
    free(ragged->seq);
    free(ragged->time);
    free(ragged->status);
    free(ragged->end);
    free(ragged->value);
    free(ragged);
}

/* ---- Events -------------------------------------------------------------------------------- */

static int take_event(void *ctx, const struct apc_event *event)
{
    struct apc_events *const e = ctx;
    const size_t room = e->room ? 2 * e->room : ROOM / 16;

    if (e->n == e->room) {
        if (!apc_grow(&e->event, room, sizeof *e->event))
            return 1;
        e->room = room;
    }
    e->event[e->n++] = *event;
    return 0;
}

int apc_events_read(struct apc_events *events, struct apc_store *store, const struct apc_range *range)
{
    const int n = apc_store_events(store, range, take_event, events);

    return n >= 0 && (size_t)n != events->n ? APC_ENOMEM : n;
}

void apc_events_free(struct apc_events *events)
{
    free(events->event);
    free(events);
}

/* ---- Time ---------------------------------------------------------------------------------- */

int apc_sleep_until(int64_t time)
{
    const struct timespec at = {time / APC_NS_PER_S, time % APC_NS_PER_S};

    return clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == 0;
}
