/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"

#define MOST       64                 /* at once */
#define EVENTS     200                /* so many are looked through for one's own */
#define EVENT_LATE (APC_NS_PER_S / 2) /* after the row that it tells of */

struct requests {
    struct apc_store *live;
    struct requests_source from;
    apc_ns most;
    struct apc_error why;
    struct apc_request at[MOST];
    size_t n;
    struct known_plant plant; /* of the live store, while there are requests */
    struct apc_sample mark[REQUESTS_MARKS];
};

/* What is known of one request. */
struct look {
    const struct apc_request *request;
    bool known; /* what it means; else why not */
    struct change_fault why;
    struct change change;
    struct operation operation;
    char note[64];
    struct apc_sample *mark; /* its own, or where its own goes */
    char said[256];
};

static int give_stored_requests(void *ctx, apc_request_fn fn, void *fn_ctx)
{
    return apc_store_requests(ctx, fn, fn_ctx);
}

static int answer_stored_request(void *ctx, int64_t id, int64_t seq, const char *outcome)
{
    return apc_store_answer(ctx, id, seq, outcome);
}

static const char *stored_requests_error(void *ctx)
{
    return apc_store_error(ctx);
}

int requests_create(struct requests **requests, struct apc_store *live, struct apc_store *history,
                    apc_ns most, struct apc_error *why)
{
    const struct requests_source from = {.ctx = history,
                                         .give = give_stored_requests,
                                         .answer = answer_stored_request,
                                         .error = stored_requests_error,
                                         .marks = REQUESTS_OF_HISTORY};
    return requests_create_of(requests, live, &from, most, why);
}

int requests_create_of(struct requests **requests, struct apc_store *live, const struct requests_source *from,
                       apc_ns most, struct apc_error *why)
{
    struct requests *r = *requests = calloc(1, sizeof *r);
    if (!r)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    r->live = live;
    r->from = *from;
    r->most = most;
    return 0;
}

void requests_destroy(struct requests *r)
{
    if (!r)
        return;
    known_free(&r->plant);
    free(r);
}

const char *requests_error(const struct requests *r)
{
    return r->why.text;
}

/* ---- What there is ------------------------------------------------------------------------- */

static int take_request(void *ctx, const struct apc_request *request)
{
    struct requests *r = ctx;
    r->at[r->n++] = *request;
    return r->n == MOST;
}

static int load_marks(struct requests *r)
{
    for (int i = 0; i < REQUESTS_MARKS; i++)
        r->mark[i] = (struct apc_sample){.table = APC_OPMODE, .id = r->from.marks + i};
    const int rc = apc_store_read(r->live, r->mark, REQUESTS_MARKS);
    return rc < 0 ? rc : 0;
}

static bool is_mark_of(const struct apc_sample *mark, const struct apc_request *q)
{
    return mark->seq > 0 && mark->value == (double)q->id && mark->time == q->time;
}

/* One that is free, or else of the earliest time. */
static bool goes_before(const struct apc_sample *a, const struct apc_sample *b)
{
    return b->seq > 0 && (a->seq == 0 || a->time < b->time);
}

static struct apc_sample *mark_of(struct requests *r, const struct apc_request *q)
{
    struct apc_sample *place = &r->mark[0];
    for (size_t i = 0; i < REQUESTS_MARKS; i++) {
        if (is_mark_of(&r->mark[i], q))
            return &r->mark[i];
        if (goes_before(&r->mark[i], place))
            place = &r->mark[i];
    }
    return place;
}

static int load_plant(struct requests *r)
{
    known_free(&r->plant);
    const int rc = known_load(&r->plant, r->live);
    return rc < 0 ? rc : load_marks(r);
}

/* What is of all, and what says whose something is, may have no description, and nobody confirms it. */
static bool is_switch(const struct apc_request *q)
{
    return q->table == APC_OPMODE && (q->variable == 0 || q->variable >= LOOPS_IDS);
}

static int look_at_request(struct requests *r, const struct apc_request *q, struct look *l)
{
    struct change_target to;
    *l = (struct look){.request = q, .mark = mark_of(r, q)};
    l->known = change_at(&r->plant.view, q->table, q->variable, &to, &l->why) == 0;
    if (!l->known && is_switch(q)) {
        to = (struct change_target){.name = "mode",
                                    .table = q->table,
                                    .id = q->variable,
                                    .low = -APC_VALUE_MAX,
                                    .high = APC_VALUE_MAX};
        l->known = true;
    }
    change_make(&r->plant.view, &to, q->value, &l->change);
    snprintf(l->note, sizeof l->note, " (request %lld of %.30s)", (long long)q->id, q->role);
    l->operation = (struct operation){.plant = &r->plant.view,
                                      .change = &l->change,
                                      .n = 1,
                                      .author = q->author,
                                      .note = l->note,
                                      .reason = q->reason};
    const int rc = operation_look(&l->operation, r->live);
    return rc < 0 ? apc_fail(&r->why, rc, "%s", apc_store_error(r->live)) : 0;
}

static int say_outcome(struct requests *r, const struct look *l, int64_t seq, const char *outcome)
{
    const int rc = r->from.answer(r->from.ctx, l->request->id, seq, outcome);
    return rc < 0 ? apc_fail(&r->why, rc, "%s", r->from.error(r->from.ctx)) : 0;
}

static bool APC_PRINTF(2, 3) note_outcome(struct look *l, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    vsnprintf(l->said, sizeof l->said, fmt, args);
    va_end(args);
    return true;
}

/* ---- May it be done? ------------------------------------------------------------------------ */

static bool is_past(struct look *l, apc_ns most, apc_ns most_ahead)
{
    const struct apc_request *q = l->request;
    const apc_ns ours = apc_ns_since(apc_clock_utc(NULL), q->time), age = ours > q->age ? ours : q->age;
    const apc_ns ahead = ours < q->age ? -ours : -q->age;
    if (age > most)
        return note_outcome(
            l, "refused: too late, it was requested %.1f s ago by %s clock, and %.0f s are allowed",
            apc_ns_to_s(age), ours > q->age ? "the loop's" : "the database's", apc_ns_to_s(most));
    if (q->left <= 0)
        return note_outcome(l, "refused: too late, it was to be done until %.1f s ago",
                            apc_ns_to_s(-q->left));
    if (ahead > most_ahead)
        return note_outcome(l, "refused: it comes from %.1f s ahead: a clock is wrong", apc_ns_to_s(ahead));
    if (l->mark->seq > 0 && l->mark->time >= q->time)
        return note_outcome(l, "refused: later requests were carried out, and whether this one was is not "
                               "known: look at the value, then ask again");
    return false;
}

static bool is_wrong(const struct requests *r, struct look *l)
{
    const struct apc_request *q = l->request;
    int rc = l->known ? 0 : l->why.err;
    if (q->table == APC_OPMODE && q->variable >= REQUESTS_OF_HISTORY)
        return note_outcome(l, "refused: %s %d is written by programs only", apc_table_name(q->table),
                            q->variable);
    if (rc == 0)
        rc = change_reason(q->reason, &l->why);
    if (rc == 0)
        rc = change_check(&l->change.to, q->value, &l->why);
    if (rc == 0)
        rc = change_now(&r->plant.view, &l->change.to, &l->change.mode, &l->why);
    if (rc == 0)
        rc = change_step(&l->change, &l->why);
    if (rc == 0)
        rc = operation_fits(&l->operation, "", &l->why);
    return rc < 0 && note_outcome(l, "refused: %s", l->why.text);
}

/* Nobody could approve the mode of all: it is asked for of each loop. */
static bool takes_two_of_all(const struct requests *r, struct look *l)
{
    const struct loops *loops = r->plant.view.loops;
    size_t i = l->request->table == APC_OPMODE && l->request->variable == 0 ? 0 : loops->n_controllers;
    while (i < loops->n_controllers && !(loops_second(loops, APC_TICK, loops->controller[i].number) > 0))
        i++;
    return i < loops->n_controllers &&
           note_outcome(l, "refused: the modes of %.60s take two persons: ask for one loop at a time",
                        loops->controller[i].name);
}

/* What is written for nobody comes into force later. */
static bool is_for_nobody(struct look *l)
{
    const struct change *c = &l->change;
    const apc_ns now = apc_clock_utc(NULL);
    if (is_switch(l->request) || (c->by && c->tick.seq > 0 && now - c->tick.time <= change_patience(c)))
        return false;
    (void)change_nobody(c, now, &l->why);
    return note_outcome(l, "refused: %s", l->why.text);
}

/* ---- Doing it -------------------------------------------------------------------------------- */

/* 1: it is still to be answered, or somebody was faster, so it is looked at again. */
static int do_it(struct requests *r, struct look *l)
{
    const struct apc_request *q = l->request;
    struct apc_sample mark = *l->mark;
    mark.time = q->time;
    mark.status = APC_GOOD;
    mark.value = (double)q->id;
    mark.origin = apc_seq_last(&l->change.newest) + 1;
    l->operation.mark = &mark;
    l->change.after.seq = l->change.newest.seq;
    int rc = operation_begin(&l->operation, r->live, &l->why);
    operation_end(&l->operation);
    if (rc == APC_ECONFLICT)
        return 1;
    if (rc < 0 && (rc == APC_EINVAL || !strcmp(l->why.code, "second"))) { /* done again it waits already */
        note_outcome(l, "refused: %s", l->why.text);
        return say_outcome(r, l, 0, l->said);
    }
    if (rc < 0)
        return apc_fail(&r->why, rc, "%s", l->why.text);
    rc = load_marks(r);
    if (rc < 0)
        return apc_fail(&r->why, rc, "%s", apc_store_error(r->live));
    rc = say_outcome(r, l, mark.origin, NULL);
    return rc < 0 ? rc : 1;
}

/* ---- What became of it ------------------------------------------------------------------------ */

struct own {
    const struct apc_request *request;
    char text[48];
    bool there;
};

static int is_own_event(void *ctx, const struct apc_event *e)
{
    struct own *own = ctx;
    own->there |= e->time >= own->request->time && strstr(e->text, own->text) != NULL;
    return own->there;
}

/* Whoever did it may have been killed before he said so. */
static int make_up(struct requests *r, struct look *l)
{
    const struct apc_range last = {.last = EVENTS};
    struct own own = {.request = l->request};
    snprintf(own.text, sizeof own.text, "(request %lld of ", (long long)l->request->id);
    int rc = apc_store_events(r->live, &last, is_own_event, &own);
    if (rc >= 0 && !own.there) { /* what it was before is not known any more */
        l->operation.time = apc_clock_utc(NULL);
        rc = operation_record(&l->operation, r->live, "");
    }
    return rc < 0 ? apc_fail(&r->why, rc, "%s", apc_store_error(r->live)) : 0;
}

/* Is there something to say, in l->said? The words of a refusal, and what has not come yet, are waited for. */
static bool is_request_settled(struct requests *r, struct look *l)
{
    struct change *c = &l->change;
    const apc_ns now = apc_clock_utc(NULL);
    bool settled = true;
    if (is_switch(l->request))
        return note_outcome(l, "written");
    c->after.seq = l->mark->origin;
    c->outcome = c->by ? change_judge(c, now) : OUTCOME_NOBODY;
    if (c->outcome == OUTCOME_REFUSED)
        settled = outcome_refusal(r->live, c->to.name, l->request->time, c->refusal, sizeof c->refusal) ||
                  now - c->actual.time > EVENT_LATE;
    else if (c->by && c->outcome != OUTCOME_APPLIED && c->outcome != OUTCOME_SUPERSEDED)
        settled = l->request->age > r->most + change_patience(c);
    (void)change_finish(c, now, &l->why);
    note_outcome(l, "%s", l->why.text);
    return settled;
}

static int settle_request(struct requests *r, struct look *l)
{
    int rc = l->request->seq < 0 ? make_up(r, l) : 0;
    if (rc < 0)
        return rc;
    if (is_request_settled(r, l)) {
        rc = say_outcome(r, l, l->mark->origin, l->said);
        return rc < 0 ? rc : 0;
    }
    if (l->request->seq < 0)
        rc = say_outcome(r, l, l->mark->origin, NULL);
    return rc < 0 ? rc : 1;
}

/* 1: it is still to be answered. */
static int handle(struct requests *r, const struct apc_request *request)
{
    struct look l;
    int rc = look_at_request(r, request, &l);
    if (rc < 0)
        return rc;
    if (is_mark_of(l.mark, request))
        return settle_request(r, &l);
    if ((rc = operation_read(&l.operation, r->live)) < 0)
        return apc_fail(&r->why, rc, "%s", apc_store_error(r->live));
    if (is_past(&l, r->most, r->from.ahead ? r->from.ahead : r->most) || is_wrong(r, &l) ||
        takes_two_of_all(r, &l) || is_for_nobody(&l))
        return say_outcome(r, &l, 0, l.said);
    return do_it(r, &l);
}

int requests_step(struct requests *r)
{
    int left = 0;
    r->n = 0;
    r->why.text[0] = '\0';
    int rc = r->from.give(r->from.ctx, take_request, r);
    if (rc < 0)
        return apc_fail(&r->why, rc, "%s", r->from.error(r->from.ctx));
    if (r->n > 0 && (rc = load_plant(r)) < 0)
        return apc_fail(&r->why, rc, "%s", apc_store_error(r->live));
    for (size_t i = 0; i < r->n && rc >= 0; i++) {
        rc = handle(r, &r->at[i]);
        left += rc > 0;
    }
    return rc < 0 ? rc : left;
}
