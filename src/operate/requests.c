/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"

#define MOST   64  /* at once */
#define EVENTS 200 /* so many are looked through for one's own */
#define PATIENCE                                                                                             \
    (2 * APC_NS_PER_S)                /* beyond three periods, for what a controller that ticks does in time \
                                       */
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
    const struct apc_tag *tag; /* of its variable; NULL: it has none */
    const struct loops_controller *by;
    struct change_target to;
    struct apc_sample newest, actual, mode; /* mode: the target of its loop */
    struct apc_sample *mark;                /* its own, or where its own goes */
    struct apc_vector tick;
    char said[192];
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

static int look_at_request(struct requests *r, const struct apc_request *request, struct look *l)
{
    const enum apc_table table = request->table;
    const int id = request->variable;
    *l = (struct look){.request = request, .tag = plant_tag(&r->plant.view, table, id)};
    l->by = l->tag ? loops_taker(&r->plant.loops, l->tag) : NULL;
    const struct loops_loop *loop = loops_of(&r->plant.loops, table, id);
    struct apc_sample sample[3] = {
        {.table = table, .id = id},
        {.table = APC_ACTUAL, .id = apc_variable_number(table, id)},
        {.table = APC_OPMODE, .id = loop ? loop->id : 0},
    };
    struct apc_vector tick = {.table = APC_TICK, .id = l->by ? l->by->number : 0};
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = sample,
                            .n_samples = table == APC_OPMODE ? 2 : 3,
                            .vector = &tick,
                            .n_vectors = l->by ? 1 : 0};
    const int rc = apc_store_read_rows(r->live, &rows);
    l->newest = sample[0];
    l->mark = mark_of(r, request);
    l->actual = sample[1];
    l->mode = sample[2];
    l->tick = tick;
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
            l, "refused: too late, it was asked for %.1f s ago by %s clock, and %.0f s are allowed",
            apc_ns_to_s(age), ours > q->age ? "the loop's" : "the database's", apc_ns_to_s(most));
    if (q->left <= 0)
        return note_outcome(l, "refused: too late, it was to be done until %.1f s ago",
                            apc_ns_to_s(-q->left));
    if (ahead > most_ahead)
        return note_outcome(l, "refused: it comes from %.1f s ahead: a clock is wrong", apc_ns_to_s(ahead));
    if (l->mark->seq > 0 && l->mark->time >= q->time)
        return note_outcome(l, "refused: later ones have been done, and whether this one was is not known");
    return false;
}

static bool is_switch(const struct apc_request *q)
{
    return q->table == APC_OPMODE && (q->variable == 0 || q->variable >= LOOPS_IDS);
}

static bool is_wrong(const struct requests *r, struct look *l)
{
    const struct apc_request *q = l->request;
    struct change_fault why;
    if (q->table == APC_OPMODE && q->variable >= REQUESTS_OF_HISTORY)
        return note_outcome(l, "refused: %s %d is not for people", apc_table_name(q->table), q->variable);
    int rc = change_at(&r->plant.view, q->table, q->variable, &l->to, &why);
    if (rc < 0 &&
        is_switch(q)) { /* what is of all, and what says whose something is, may have no description */
        l->to = (struct change_target){
            .table = q->table, .id = q->variable, .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX};
        rc = 0;
    }
    if (rc == 0)
        rc = change_reason(q->reason, &why);
    if (rc == 0)
        rc = change_check(&l->to, q->value, &why);
    if (rc == 0)
        rc = change_now(&r->plant.view, &l->to, &l->mode, &why);
    return rc < 0 && note_outcome(l, "refused: %s", why.text);
}

static struct outcome_seen seen_of_request(const struct look *l, const struct apc_sample *write)
{
    return (struct outcome_seen){.write = write,
                                 .actual = &l->actual,
                                 .tick = &l->tick,
                                 .period = l->by ? l->by->period : 0,
                                 .now = apc_clock_utc(NULL)};
}

/* What is written for nobody comes into force later. */
static bool is_for_nobody(struct look *l)
{
    const struct apc_sample next = {
        .table = l->newest.table, .id = l->newest.id, .seq = apc_seq_last(&l->newest) + 1};
    const struct outcome_seen seen = seen_of_request(l, &next);
    if (is_switch(l->request))
        return false;
    if (!l->by)
        return note_outcome(l, "refused: nobody applies it: %s belongs to no controller", l->tag->name);
    if (l->tick.seq == 0)
        return note_outcome(l, "refused: nobody applies it: %s has never ticked", l->by->name);
    if (outcome_of(&seen) == OUTCOME_NOBODY && outcome_age(&seen) > 3 * l->by->period + PATIENCE)
        return note_outcome(l, "refused: nobody applies it: %s's last tick was %.1f s ago", l->by->name,
                            apc_ns_to_s(outcome_age(&seen)));
    return false;
}

/* ---- Doing it -------------------------------------------------------------------------------- */

static void describe_request(const struct look *l, char *text, size_t size)
{
    const struct apc_request *q = l->request;
    char before[32] = "none";
    if (l->newest.seq > 0)
        snprintf(before, sizeof before, "%.12g", l->newest.value);
    snprintf(text, size, "%.40s: %s -> %.12g (request %lld of %.30s%s%.40s)", l->tag ? l->tag->name : "mode",
             before, q->value, (long long)q->id, q->role, q->reason[0] ? ": " : "", q->reason);
}

static int record_request(struct requests *r, const struct look *l, const struct owner_rows *with)
{
    struct apc_event event[2] = {
        {.time = apc_clock_utc(NULL), .severity = APC_EVENT_INFO, .kind = "operator"}};
    size_t n = 1;
    snprintf(event[0].source, sizeof event[0].source, "%.31s", l->request->author);
    event[1] = event[0];
    describe_request(l, event[0].text, sizeof event[0].text);
    for (size_t i = 0; i < with->n; i++) {
        if (n == 1 && with->at[i].table == APC_OPMODE) {
            const int id = loops_owned(&r->plant.loops, &with->at[i]);
            const struct apc_tag *tag = plant_tag(&r->plant.view, APC_SETPOINT, id);
            snprintf(event[n++].text, sizeof event[1].text, "%s taken Local, %s",
                     tag ? tag->name : "setpoint",
                     loops_is_owner(&with->at[i]) ? "the scheduler stands aside" : "cascade open");
        }
    }
    const int rc = apc_store_append_events(r->live, event, n);
    return rc < 0 ? apc_fail(&r->why, rc, "%s", apc_store_error(r->live)) : 0;
}

/* 1: somebody was faster, so it is looked at again. */
static int write_request_row(struct requests *r, struct look *l, struct owner_rows *with)
{
    const struct apc_request *q = l->request;
    const int author = apc_store_author(r->live, q->author);
    if (author < 0)
        return apc_fail(&r->why, author, "%s", apc_store_error(r->live));
    struct apc_sample rows[2] = {
        {.table = q->table,
         .id = q->variable,
         .seq = l->newest.seq,
         .time = apc_clock_utc(NULL),
         .value = q->value,
         .author = (uint32_t)author},
        *l->mark,
    };
    rows[1].time = q->time;
    rows[1].status = APC_GOOD;
    rows[1].value = (double)q->id;
    rows[1].origin = apc_seq_last(&l->newest) + 1;
    rows[1].author = (uint32_t)author;
    int rc = owner_put(r->live, &r->plant.loops, rows, 2, with);
    if (rc == APC_ECONFLICT)
        return 1;
    if (rc >= 0)
        rc = load_marks(r);
    return rc < 0 ? apc_fail(&r->why, rc, "%s", apc_store_error(r->live)) : 0;
}

static int do_it(struct requests *r, struct look *l)
{
    struct owner_rows with = {0};
    int rc = write_request_row(r, l, &with);
    if (rc == 0)
        rc = record_request(r, l, &with);
    if (rc == 0)
        rc = say_outcome(r, l, apc_seq_last(&l->newest) + 1, NULL);
    free(with.at);
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
    if (rc >= 0 && !own.there) {
        l->newest.seq = 0; /* what it was before is not known any more */
        return record_request(r, l, &(struct owner_rows){0});
    }
    return rc < 0 ? apc_fail(&r->why, rc, "%s", apc_store_error(r->live)) : 0;
}

static bool is_told_why(struct requests *r, struct look *l, apc_ns since)
{
    char why[160];
    const bool found = outcome_refusal(r->live, l->tag->name, since, why, sizeof why);
    if (found)
        note_outcome(l, "refused: %s", why);
    else if (l->request->table == APC_MANUAL)
        note_outcome(l, "refused: its loop is not in Man");
    else
        note_outcome(l, "refused: %g stays in force", l->actual.value);
    return found || apc_clock_utc(NULL) - l->actual.time > EVENT_LATE;
}

/* Is there something to say, in l->said? */
static bool is_request_settled(struct requests *r, struct look *l)
{
    const struct apc_sample write = {.table = l->request->table,
                                     .id = l->request->variable,
                                     .seq = l->mark->origin,
                                     .value = l->request->value};
    const struct outcome_seen seen = seen_of_request(l, &write);
    if (is_switch(l->request))
        return note_outcome(l, "written");
    if (!l->by)
        return note_outcome(l, "written, but it belongs to no controller");
    switch (outcome_of(&seen)) {
    case OUTCOME_APPLIED:
        return note_outcome(l, "applied");
    case OUTCOME_SUPERSEDED:
        return note_outcome(l, "superseded: it is %g now", l->actual.value);
    case OUTCOME_REFUSED:
        return is_told_why(r, l, l->request->time);
    default:
        note_outcome(l, "written, but %s does not confirm it", l->by->name);
        return l->request->age > r->most + 3 * l->by->period + PATIENCE;
    }
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
    if (is_past(&l, r->most, r->from.ahead ? r->from.ahead : r->most) || is_wrong(r, &l) || is_for_nobody(&l))
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
