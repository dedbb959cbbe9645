/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Events and timing rows of a live store and its history. They have a number in their own store only; those
 * of the live store that the history gave as well, alike in all that they say, are left out.
 */
#include <stdlib.h>

#include "shareddata/history/federated_internal.h"

/* One of the live store's, and by what it is known elsewhere. */
struct mark {
    int64_t number;
    apc_ns time;
    uint64_t says;
    bool there; /* the history has it */
};

struct records {
    apc_event_fn event;
    apc_timing_fn timing; /* one of the two */
    void *ctx;
    enum turn { NOTE, FIND, GIVE_OLD, GIVE_NEW } turn;
    struct mark *mark; /* [n] of the live store's */
    size_t n, capacity, cursor, skip, count;
    apc_ns oldest;
    bool ended, failed;
};

static uint64_t add_number(uint64_t sum, uint64_t number)
{
    sum = (sum ^ number) * UINT64_C(0x9e3779b97f4a7c15);
    return sum ^ sum >> 32;
}

static uint64_t add_text(uint64_t sum, const char *text)
{
    for (; *text; text++) {
        sum = add_number(sum, (unsigned char)*text);
    }
    return add_number(sum, 0);
}

static void note_record(struct records *x, int64_t number, apc_ns time, uint64_t says)
{
    if (x->n == x->capacity) {
        const size_t capacity = 2 * x->capacity + 256;
        struct mark *grown = (struct mark *)realloc(x->mark, capacity * sizeof *grown);
        if (!grown) {
            x->failed = true;
            return;
        }
        x->mark = grown;
        x->capacity = capacity;
    }
    x->oldest = x->n == 0 || time < x->oldest ? time : x->oldest;
    x->mark[x->n++] = (struct mark){number, time, says, false};
}

/* They come in one order in both, so that it is mostly the next one. */
static struct mark *next_mark(struct records *x, bool (*is)(const struct mark *m, const struct mark *like),
                              const struct mark *like)
{
    for (size_t i = 0; i < x->n; i++) {
        const size_t at = (x->cursor + i) % x->n;
        if (is(&x->mark[at], like)) {
            x->cursor = (at + 1) % x->n;
            return &x->mark[at];
        }
    }
    return NULL;
}

static bool is_alike(const struct mark *m, const struct mark *like)
{
    return !m->there && m->time == like->time && m->says == like->says;
}

static bool is_number(const struct mark *m, const struct mark *like)
{
    return m->number == like->number;
}

/* Is the caller to have it, in this turn? */
static bool is_record_due(struct records *x, int64_t number, apc_ns time, uint64_t says)
{
    const struct mark like = {number, time, says, false};
    struct mark *m = NULL;
    switch (x->turn) {
    case NOTE:
        note_record(x, number, time, says);
        return false;
    case FIND:
    case GIVE_OLD:
        m = time >= x->oldest ? next_mark(x, is_alike, &like) : NULL;
        if (m) {
            m->there = true;
        }
        return x->turn == GIVE_OLD;
    default: /* what has come since is not marked: it has its turn the next time */
        m = next_mark(x, is_number, &like);
        if (!m || m->there) {
            return false;
        }
        x->skip -= x->skip > 0;
        return x->skip == 0;
    }
}

static int on_event(void *ctx, const struct apc_event *e)
{
    struct records *x = (struct records *)ctx;
    const uint64_t says = add_text(add_text(add_text((uint64_t)e->severity, e->source), e->kind), e->text);
    if (is_record_due(x, e->number, e->time, says)) {
        x->count++;
        x->ended = x->event(x->ctx, e) != 0;
    }
    return x->ended || x->failed;
}

static int on_timing(void *ctx, const struct apc_timing_row *r)
{
    struct records *x = (struct records *)ctx;
    uint64_t says = add_text(add_text(0, r->task), r->quantity);
    says = add_number(add_number(add_number(says, r->missed), r->count), (uint64_t)r->max);
    if (is_record_due(x, r->number, r->time, says)) {
        x->count++;
        x->ended = x->timing(x->ctx, r) != 0;
    }
    return x->ended || x->failed;
}

static int go(struct records *x, struct apc_store *store, const struct apc_range *range, enum turn turn)
{
    x->turn = turn;
    return x->event ? apc_store_events(store, range, on_event, x)
                    : apc_store_timing(store, range, on_timing, x);
}

static size_t count_new(const struct records *x)
{
    size_t n = 0;
    for (size_t i = 0; i < x->n; i++) {
        n += !x->mark[i].there;
    }
    return n;
}

/* The history's, of the newest as many as the live store has no newer ones of. */
static int give_old(struct apc_federated *s, struct records *x, const struct apc_range *asked)
{
    struct apc_range range = *asked;
    const apc_ns began = apc_clock_mono(NULL);
    int rc = 0;
    if (asked->last > 0) {
        range.last = 0;
        range.since = x->n > 0 && x->oldest > asked->since ? x->oldest : asked->since;
        rc = x->n > 0 ? go(x, s->history, &range, FIND) : 0;
        range = *asked;
        range.last = asked->last - (count_new(x) < asked->last ? count_new(x) : asked->last);
    }
    if (rc >= 0 && (asked->last == 0 || range.last > 0)) {
        rc = go(x, s->history, &range, GIVE_OLD);
    }
    return apc_federated_answered(s, rc, began, s->history->why.text);
}

/* What lies behind a number is the live store's: it is one of its own. */
static int records(struct apc_federated *s, struct records *x, const struct apc_range *asked)
{
    struct apc_range range = *asked;
    range.last = 0;
    s->base.streaming = true;
    int rc = go(x, s->base.inner, &range, NOTE);
    if (rc >= 0 && x->failed) {
        rc = apc_fail(&s->base.why, APC_ENOMEM, "out of memory for %zu records", x->n);
    } else if (rc < 0) {
        s->base.why = s->base.inner->why;
    }
    if (rc >= 0 && range.after == 0 && apc_federated_has_history(s)) {
        give_old(s, x, asked);
    }
    if (rc >= 0 && !x->ended) {
        const size_t new = count_new(x);
        x->skip = asked->last > 0 && new > asked->last ? new - asked->last + 1 : 0;
        rc = go(x, s->base.inner, &range, GIVE_NEW);
        s->base.why = rc < 0 ? s->base.inner->why : s->base.why;
    }
    s->base.streaming = false;
    free(x->mark);
    return rc < 0 ? rc : (int)x->count;
}

int apc_federated_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct records x = {.event = fn, .ctx = ctx};
    return records((struct apc_federated *)store, &x, range);
}

int apc_federated_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct records x = {.timing = fn, .ctx = ctx};
    return records((struct apc_federated *)store, &x, range);
}
