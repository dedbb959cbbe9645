/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"

#define GRACE       (2 * APC_NS_PER_S) /* beyond three ticks */
#define PERIOD      (2 * APC_NS_PER_S) /* of one that does not say, and cannot be seen */
#define SCHEDULER   APC_NS_PER_S       /* it looks four times as often */
#define LOOK        16                 /* ticks that a period is seen from that nobody says */
#define EVENT_DELAY (APC_NS_PER_S / 2) /* by which an event may come after its tick */
#define PAUSE       (50 * APC_NS_PER_MS)

enum { ABSENCE_LEN = 2 * APC_TAG_LEN }; /* of a controller's name, and since when it is gone */

/* ---- A change ------------------------------------------------------------------------------ */

/* Whose a setpoint is that the scheduler moves. */
static bool is_owner_switch(const struct change *c)
{
    return c->to.table == APC_OPMODE && loops_is_owner_id(c->to.id);
}

void change_make(const struct plant_view *plant, const struct change_target *to, double value,
                 struct change *c)
{
    const struct apc_tag *tag = plant_tag(plant, to->table, to->id);
    *c = (struct change){.to = *to,
                         .by = tag ? loops_taker(plant->loops, tag) : NULL,
                         .before = {.table = to->table, .id = to->id},
                         .after = {.table = to->table, .id = to->id, .seq = APC_SEQ_ANY, .value = value}};
    c->period = c->by ? c->by->period : is_owner_switch(c) ? SCHEDULER : 0;
    c->newest = c->before;
    c->actual = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(to->table, to->id)};
    if (is_owner_switch(c))
        c->actual = (struct apc_sample){.table = APC_SETPOINT, .id = loops_owned(plant->loops, &c->after)};
    if (change_asks_mode(to))
        c->mode = (struct apc_sample){.table = APC_OPMODE, .id = to->loop->id};
    if (to->table == APC_MANUAL && to->loop)
        c->before = (struct apc_sample){.table = to->loop->table, .id = to->loop->output};
}

int change_step(const struct change *c, struct change_fault *why)
{
    char before[CHANGE_TEXT], after[CHANGE_TEXT], most[CHANGE_TEXT];
    const struct apc_sample *was = &c->before;
    if (!(c->to.step > 0) || (was->seq > 0 && fabs(c->after.value - was->value) <= c->to.step))
        return 0;
    decimal_shortest(c->after.value, 6, after);
    decimal_shortest(c->to.step, 6, most);
    return change_fail(why, APC_EPERM, "confirm",
                       "%.60s: %s -> %s is a step of more than %s, which has to be confirmed", c->to.name,
                       change_text(was, before), after, most);
}

int change_over(double over, struct change_fault *why)
{
    return over > 0 && over <= 366 * 86400
               ? 0
               : change_fail(why, APC_ERANGE, "value",
                             "a ramp must take above 0 s and at most 366 days, not %g s", over);
}

char *change_words(const struct change *c, const char *group, char *text, size_t size)
{
    char before[CHANGE_TEXT], after[CHANGE_TEXT], over[CHANGE_TEXT];
    struct apc_sample to = c->after;
    to.seq = 1;
    if (c->stop)
        snprintf(text, size, "%.70s: stopped at %s", c->to.name, change_text(&to, after));
    else
        snprintf(text, size, "%.70s%s: %s -> %s%s%s%s", group ? group : c->to.name,
                 !group && c->to.table == APC_OPMODE && c->to.loop ? " mode" : "",
                 change_text(&c->before, before), change_text(&to, after), c->over > 0 ? " over " : "",
                 c->over > 0 ? decimal_shortest(c->over, 6, over) : "", c->over > 0 ? " s" : "");
    return text;
}

apc_ns change_patience(const struct change *c)
{
    return 3 * (c->period > 0 ? c->period : PERIOD) + GRACE;
}

static struct outcome_seen seen_of_change(const struct change *c, apc_ns utc)
{
    return (struct outcome_seen){
        .write = &c->after, .actual = &c->actual, .tick = &c->tick, .period = c->period, .now = utc};
}

/* Local it is with the row itself. Given back, it is the scheduler's once that has written the step that is
 * due over the setpoint, which went along. */
static enum outcome judge_switch(const struct change *c)
{
    if (c->newest.seq != c->after.seq)
        return c->newest.seq < c->after.seq ? OUTCOME_WAITING : OUTCOME_SUPERSEDED;
    return loops_is_local(&c->after) || c->along == 0 || c->actual.seq > c->along ? OUTCOME_APPLIED
                                                                                  : OUTCOME_WAITING;
}

/* A ramp is in force as soon as the row that it begins with, or one that it was moved to, is. */
static enum outcome judge_ramp(const struct change *c, apc_ns utc)
{
    struct change begin = *c;
    begin.after.value = c->before.value;
    const struct outcome_seen seen = seen_of_change(&begin, utc);
    const enum outcome outcome = outcome_of(&seen);
    return outcome == OUTCOME_SUPERSEDED ? OUTCOME_APPLIED : outcome;
}

enum outcome change_judge(const struct change *c, apc_ns utc)
{
    const struct outcome_seen seen = seen_of_change(c, utc);
    return is_owner_switch(c) ? judge_switch(c) : c->over > 0 ? judge_ramp(c, utc) : outcome_of(&seen);
}

/* ---- In words ------------------------------------------------------------------------------ */

/* "the controller"; one that has a name of its own: "controller base"; what has no number is none:
 * "apc-alarms" */
static char *name_of_taker(const struct loops_controller *by, char text[APC_TAG_LEN + 16])
{
    if (!strcmp(by->name, "controller"))
        snprintf(text, APC_TAG_LEN + 16, "the controller");
    else
        snprintf(text, APC_TAG_LEN + 16, "%s%s", by->number > 0 ? "controller " : "", by->name);
    return text;
}

/* What is in force; a mode by its name. */
static char *text_of_force(const struct change *c, char text[CHANGE_TEXT])
{
    struct apc_sample force = is_owner_switch(c) ? c->newest : c->actual;
    force.table = c->to.table;
    force.id = c->to.id;
    return change_text(&force, text);
}

static bool is_out_of_man(const struct change *c)
{
    return c->to.table == APC_MANUAL && c->mode.seq > 0 && c->mode.value != (double)APC_MODE_MAN;
}

static int finish_refused(const struct change *c, struct change_fault *said)
{
    char value[CHANGE_TEXT];
    if (is_out_of_man(c))
        return change_fail(said, APC_EPERM, "refused", "refused: %s is in %s", c->to.name,
                           change_text(&c->mode, value));
    if (c->refusal[0])
        return change_fail(said, APC_EPERM, "refused", "refused: %s", c->refusal);
    return c->to.table == APC_MANUAL
               ? change_fail(said, APC_EPERM, "refused", "refused: its loop is not in Man")
               : change_fail(said, APC_EPERM, "refused", "refused: %s stays in force",
                             text_of_force(c, value));
}

/* "controller base has never ticked", "the controller's last tick was 5 min ago" */
static char *absence_of_taker(const struct change *c, apc_ns utc, char text[ABSENCE_LEN])
{
    const struct outcome_seen seen = seen_of_change(c, utc);
    char age[CHANGE_TEXT], name[APC_TAG_LEN + 16];
    name_of_taker(c->by, name);
    if (c->tick.seq == 0)
        snprintf(text, ABSENCE_LEN, "%s has never ticked", name);
    else
        snprintf(text, ABSENCE_LEN, "%s's last tick was %.20s ago", name,
                 change_age(outcome_age(&seen), age));
    return text;
}

static int finish_open(const struct change *c, apc_ns utc, struct change_fault *said)
{
    const bool looked = c->actual.seq > 0 && c->actual.origin == c->after.seq;
    char text[ABSENCE_LEN];

    if (is_owner_switch(c))
        return change_fail(said, APC_ETIMEDOUT, "unconfirmed", "written, but no scheduler moves it");
    if (!c->by)
        return change_fail(said, APC_ETIMEDOUT, "nobody", "written, but it belongs to no controller");
    if (c->outcome == OUTCOME_NOBODY)
        return change_fail(said, APC_ETIMEDOUT, "nobody", "written, but no controller applies it: %s",
                           absence_of_taker(c, utc, text));
    if (looked && c->to.table == APC_OPMODE)
        return change_fail(said, APC_ETIMEDOUT, "unconfirmed", "written, but %s is in %s", c->to.name,
                           text_of_force(c, text));
    return looked ? change_fail(said, APC_ETIMEDOUT, "unconfirmed",
                                "written, but not applied yet: the loop has no input")
                  : change_fail(said, APC_ETIMEDOUT, "unconfirmed", "written, but %s does not confirm it",
                                name_of_taker(c->by, text));
}

int change_finish(const struct change *c, apc_ns utc, struct change_fault *said)
{
    char value[CHANGE_TEXT];
    switch (c->outcome) {
    case OUTCOME_APPLIED:
        return change_fail(said, 0, "applied", "applied");
    case OUTCOME_SUPERSEDED:
        return change_fail(said, APC_ECONFLICT, "superseded", "superseded: it is %s now",
                           text_of_force(c, value));
    case OUTCOME_REFUSED:
        return finish_refused(c, said);
    default:
        return finish_open(c, utc, said);
    }
}

int change_nobody(const struct change *c, apc_ns utc, struct change_fault *why)
{
    char text[ABSENCE_LEN];
    return c->by
               ? change_fail(why, APC_EPERM, "nobody", "no controller applies it: %s. Nothing was written",
                             absence_of_taker(c, utc, text))
               : change_fail(why, APC_EPERM, "nobody",
                             "no controller applies it: %s belongs to none. Nothing was written", c->to.name);
}

int change_takes(const struct change *c, apc_ns age, apc_ns utc, struct change_fault *why)
{
    return is_owner_switch(c) || (c->by && age >= 0 && age <= change_patience(c))
               ? 0
               : change_nobody(c, utc, why);
}

/* ---- What is seen -------------------------------------------------------------------------- */

static int fail_of_store(const struct apc_store *store, int rc, struct change_fault *why)
{
    return change_fail(why, rc, "store", "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(store));
}

int operation_read(struct operation *o, struct apc_store *store)
{
    struct apc_sample *rows = calloc(o->n + 1, sizeof *rows);
    int rc = rows ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < o->n && rows; i++)
        rows[i] = o->change[i].before;
    if (rows)
        rc = apc_store_read(store, rows, o->n);
    for (size_t i = 0; i < o->n && rc >= 0; i++)
        o->change[i].before = rows[i];
    free(rows);
    return rc < 0 ? rc : 0;
}

struct ticks {
    apc_ns last, period; /* the shortest of late; 0: not known */
};

static int take_operation_tick(void *ctx, const struct apc_vector *v)
{
    struct ticks *t = ctx;
    const apc_ns apart = v->time - t->last;
    if (t->last && apart > 0 && (t->period == 0 || apart < t->period))
        t->period = apart;
    t->last = v->time;
    return 0;
}

/* Of a controller that does not say. */
static int see_period(struct change *c, struct apc_store *store)
{
    const struct apc_range last = {.last = LOOK};
    struct ticks ticks = {0};
    if (!c->by || c->period > 0)
        return 0;
    const int rc = apc_store_vectors(store, APC_TICK, c->by->number, &last, take_operation_tick, &ticks);
    c->period = ticks.period;
    return rc < 0 ? rc : 0;
}

#define SEEN 3 /* rows of a change */

static int look_at_rows(struct operation *o, struct apc_store *store, struct apc_sample *row,
                        struct apc_vector *tick)
{
    const struct loops *loops = o->plant->loops;
    struct apc_rows rows = {.size = sizeof rows, .sample = row, .vector = tick};
    for (size_t i = 0; i < o->n; i++) {
        const struct change *c = &o->change[i];
        row[rows.n_samples++] = c->newest;
        row[rows.n_samples++] = c->actual;
        if (c->mode.table)
            row[rows.n_samples++] = c->mode;
    }
    for (; rows.n_vectors < loops->n_controllers; rows.n_vectors++)
        tick[rows.n_vectors] =
            (struct apc_vector){.table = APC_TICK, .id = loops->controller[rows.n_vectors].number};
    const int rc = apc_store_read_rows(store, &rows);
    for (size_t i = 0; i < o->n && rc >= 0; i++) {
        struct change *c = &o->change[i];
        c->newest = *row++;
        c->actual = *row++;
        if (c->mode.table)
            c->mode = *row++;
        if (c->by)
            c->tick = tick[c->by - loops->controller];
    }
    return rc < 0 ? rc : 0;
}

int operation_look(struct operation *o, struct apc_store *store)
{
    struct apc_sample *row = calloc(SEEN * o->n + 1, sizeof *row);
    struct apc_vector *tick = calloc(o->plant->loops->n_controllers + 1, sizeof *tick);
    int rc = row && tick ? look_at_rows(o, store, row, tick) : APC_ENOMEM;
    for (size_t i = 0; i < o->n && rc == 0; i++)
        rc = see_period(&o->change[i], store);
    free(tick);
    free(row);
    return rc;
}

/* ---- Before -------------------------------------------------------------------------------- */

struct stop {
    const struct loops *loops;
    const struct loops_controller *controller;
    bool stopped;
};

static int take_stop(void *ctx, const struct apc_event *event)
{
    struct stop *s = ctx;
    s->stopped |= !strcmp(event->kind, "stop") && loops_is_from(s->loops, s->controller, event->source);
    return 0;
}

/* Does it tick, as far as its last tick and its events say? */
static bool ticks_now(const struct operation *o, const struct change *c, struct apc_store *store)
{
    const struct apc_range since = {.since = c->tick.time};
    struct stop stop = {.loops = o->plant->loops, .controller = c->by};
    const apc_ns age = apc_ns_since(apc_clock_utc(NULL), c->tick.time);
    return c->tick.seq > 0 && age >= 0 && age <= change_patience(c) &&
           apc_store_events(store, &since, take_stop, &stop) >= 0 && !stop.stopped;
}

/* 1, 0: it may still tick, or an error. */
static int is_change_ready(const struct operation *o, struct change *c, struct apc_store *store, bool first,
                           struct change_fault *why)
{
    if (is_owner_switch(c) || (o->followed && c->ticks))
        return 1;
    if (!c->by)
        return change_nobody(c, apc_clock_utc(NULL), why);
    if (first)
        c->ticked = c->tick.seq;
    const bool is_known = c->ticked > 0 || !o->followed;
    if ((is_known && c->tick.seq != c->ticked) || ticks_now(o, c, store))
        return 1;
    const bool may_wait = !o->followed && apc_clock_plant() - o->asked < change_patience(c);
    return may_wait ? 0 : change_nobody(c, apc_clock_utc(NULL), why);
}

int operation_ready(struct operation *o, struct apc_store *store, struct change_fault *why)
{
    const bool first = o->asked == 0 && !o->followed;
    int rc = operation_look(o, store), ready = 1;
    if (rc < 0)
        return fail_of_store(store, rc, why);
    if (first)
        o->asked = apc_clock_plant();
    for (size_t i = 0; i < o->n && rc >= 0; i++) {
        rc = is_change_ready(o, &o->change[i], store, first, why);
        ready &= rc;
    }
    return rc < 0 ? rc : ready;
}

/* ---- Writing ------------------------------------------------------------------------------- */

bool operation_is_one(const struct operation *o)
{
    for (size_t i = 1; i < o->n; i++)
        if (o->change[i].before.value != o->change[0].before.value ||
            (o->change[i].before.seq > 0) != (o->change[0].before.seq > 0))
            return false;
    return true;
}

/* All modes of the plant are written as one, as the paper knows it. */
static bool is_all(const struct operation *o)
{
    return o->group && o->n == o->plant->loops->n;
}

/* Which rows the mode of all has become: the newest, unless somebody else was faster with another mode. */
static int find_rows(struct operation *o, struct apc_store *store)
{
    const int rc = operation_look(o, store);
    for (size_t i = 0; i < o->n && rc >= 0; i++) {
        struct change *c = &o->change[i];
        c->after.seq = c->newest.seq - (c->newest.value != c->after.value);
    }
    return rc;
}

/* What the rows have become, or what stands in their way. */
static void take_rows(struct operation *o, const struct apc_sample *rows, int rc)
{
    for (size_t i = 0; i < o->n && !is_all(o); i++) {
        struct change *c = &o->change[i];
        if (rc == APC_ECONFLICT)
            c->newest = rows[i];
        else if (rc >= 0 || rows[i].seq == APC_SEQ_ANY)
            c->after.seq = rows[i].seq;
        else
            c->after.seq++; /* what it would have been given */
        for (size_t k = 0; k < o->with.n && is_owner_switch(c); k++)
            if (o->with.at[k].table == APC_SETPOINT &&
                o->with.at[k].id == loops_owned(o->plant->loops, &c->after))
                c->along = o->with.at[k].seq;
    }
}

/* It begins in row @p at, where it is now. Returns how many rows there are. */
static size_t add_ramp(const struct change *c, struct apc_sample *at, struct apc_sample *rows, size_t n)
{
    struct apc_sample row = *at;
    row.seq = APC_SEQ_ANY;
    row.id = LOOPS_RAMP(at->id);
    rows[n++] = row;
    row.id = LOOPS_RATE(at->id);
    row.value = fabs(c->after.value - c->before.value) / c->over;
    rows[n++] = row;
    at->value = c->before.value;
    return n;
}

/* What a stop stops, and whether a ramp has where to begin. */
static int look_at_ramps(struct operation *o, struct apc_store *store, struct change_fault *why)
{
    int rc = 0;
    for (size_t i = 0; i < o->n && rc == 0; i++) {
        struct change *c = &o->change[i];
        struct apc_sample rate = {.table = c->after.table, .id = LOOPS_RATE(c->after.id)};
        if (c->over > 0 && c->before.seq == 0)
            rc = change_fail(why, APC_EPERM, "ramp",
                             "%.60s has no value that a ramp could begin at: set it first", c->to.name);
        if (!c->stop)
            continue;
        if (apc_store_read(store, &rate, 1) < 0)
            rc = fail_of_store(store, APC_ESTORE, why);
        else if (rate.seq == 0 || !(rate.value > 0))
            rc = change_fail(why, APC_EPERM, "ramp", "%.60s is on no ramp: there is nothing to stop",
                             c->to.name);
        c->after.value = c->before.value;
    }
    return rc;
}

static int put_operation(struct operation *o, struct apc_store *store, uint32_t author)
{
    const size_t approved = o->approval ? o->approval->n : 0;
    struct apc_sample *rows = calloc(3 * o->n + approved + 1, sizeof *rows);
    size_t n = is_all(o) ? 1 : o->n;
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < o->n; i++) {
        struct apc_sample *after = &o->change[i].after;
        after->time = o->time;
        after->status = APC_GOOD;
        after->author = author;
        rows[is_all(o) ? 0 : i] = *after;
    }
    if (is_all(o))
        rows[0].id = 0;
    for (size_t i = 0; i < o->n; i++)
        if (o->change[i].over > 0)
            n = add_ramp(&o->change[i], &rows[i], rows, n);
    if (o->mark) {
        rows[n] = *o->mark;
        rows[n++].author = author;
    }
    for (size_t i = 0; i < approved; i++) {
        rows[n] = o->approval->row[i];
        rows[n].author = author;
        rows[n].time = o->time;
        rows[n++].status = APC_BAD_NO_DATA;
    }
    const int rc = owner_put(store, o->plant->loops, rows, n, &o->with);
    take_rows(o, rows, rc);
    free(rows);
    return rc >= 0 && is_all(o) ? find_rows(o, store) : rc;
}

char *operation_taken(const struct operation *o, const struct apc_sample *row, char *text, size_t size)
{
    const int setpoint = row->table == APC_OPMODE ? loops_owned(o->plant->loops, row) : 0;
    const struct apc_tag *tag = plant_tag(o->plant, APC_SETPOINT, setpoint);
    if (!setpoint) /* the setpoint itself, or the end of its ramp */
        return NULL;
    snprintf(text, size, "%s taken Local, %s", tag ? tag->name : "setpoint",
             loops_is_owner(row) ? "the scheduler stands aside" : "cascade open");
    return text;
}

/* As snprintf(). */
static int event_words(const struct operation *o, const char *what, const char *also, const char *reason,
                       char *text, size_t size)
{
    return snprintf(text, size, "%s%s%s%s%s", what, also, o->note ? o->note : "", reason[0] ? ": " : "",
                    reason);
}

int operation_fits(const struct operation *o, const char *also, struct change_fault *why)
{
    const bool one = o->group && operation_is_one(o);
    char what[192], none[1];
    for (size_t i = 0; i < (one ? 1 : o->n) && o->reason; i++) {
        change_words(&o->change[i], one ? o->group : NULL, what, sizeof what);
        const int room = (int)sizeof what - 1 - event_words(o, what, also, "", none, sizeof none) - 2;
        if (o->reason[0] && (int)strlen(o->reason) > room)
            return change_fail(why, APC_EINVAL, "value",
                               "\"reason\" must have at most %d bytes beside the other words of its event, "
                               "%.90s: shorten it",
                               room > 0 ? room : 0, what);
    }
    return 0;
}

static size_t words_of_events(const struct operation *o, struct apc_event *event, const char *also)
{
    const bool one = o->group && operation_is_one(o);
    const char *reason = o->reason ? o->reason : "";
    char text[192];
    size_t n = 0;
    for (size_t i = 0; i < (one ? 1 : o->n); i++)
        event_words(o, change_words(&o->change[i], one ? o->group : NULL, text, sizeof text), also, reason,
                    event[n++].text, sizeof event->text);
    for (size_t i = 0; i < o->with.n; i++)
        if (operation_taken(o, &o->with.at[i], text, sizeof text)) {
            char *to = event[n++].text;
            if (event_words(o, text, "", reason, to, sizeof event->text) >= (int)sizeof event->text)
                event_words(o, text, "", "", to, sizeof event->text); /* that of the change has it */
        }
    for (size_t i = 0; i < n; i++) {
        event[i].time = o->time;
        event[i].severity = APC_EVENT_INFO;
        snprintf(event[i].kind, sizeof event->kind, "operator");
        snprintf(event[i].source, sizeof event->source, "%.31s", o->author);
    }
    return n;
}

int operation_record(const struct operation *o, struct apc_store *store, const char *also)
{
    struct apc_event *event = calloc(o->n + o->with.n + 1, sizeof *event);
    if (!event)
        return APC_ENOMEM;
    const size_t n = words_of_events(o, event, also);
    const int rc = o->record ? o->record(o->ctx, store, event, n) : apc_store_append_events(store, event, n);
    free(event);
    return rc < 0 ? rc : 0;
}

int change_approved(struct change_fault *why)
{
    return change_fail(why, APC_ECONFLICT, "second", "another user has approved or refused it just now");
}

static int fail_stale(const struct operation *o, struct change_fault *why)
{
    size_t i = 0;
    while (i + 1 < o->n &&
           (o->change[i].after.seq == APC_SEQ_ANY || o->change[i].after.seq == o->change[i].newest.seq))
        i++;
    if (o->approval &&
        (o->change[i].after.seq == APC_SEQ_ANY || o->change[i].after.seq == o->change[i].newest.seq))
        return change_approved(why);
    return change_stale(o->change[i].to.name, &o->change[i].newest, why);
}

int operation_begin(struct operation *o, struct apc_store *store, struct change_fault *why)
{
    int rc = change_in_past(store, why);
    if (rc == 0)
        rc = look_at_ramps(o, store, why);
    for (size_t i = 0; i < o->n && rc == 0 && !o->confirmed; i++)
        rc = change_step(&o->change[i], why);
    char asked[APC_AUTHOR_LEN + 16] = "";
    if (o->approval)
        snprintf(asked, sizeof asked, " (requested by %s)", o->approval->asker);
    if (rc == 0)
        rc = operation_fits(o, asked, why);
    if (rc < 0)
        return rc;
    rc = o->author[0] ? apc_store_author(store, o->author) : 0;
    if (rc < 0)
        return fail_of_store(store, rc, why);
    const uint32_t author = (uint32_t)rc;
    o->time = o->time > 0 ? o->time : apc_clock_utc(NULL);
    rc = o->approval ? 0 : operation_ask(o, store, author, why);
    if (rc < 0)
        return rc;
    rc = put_operation(o, store, author);
    o->begun = apc_clock_plant();
    if (rc == APC_ECONFLICT)
        return fail_stale(o, why);
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT) {
        if (o->record) /* who keeps them until the store is back */
            (void)operation_record(o, NULL, ", outcome unknown");
        return change_fail(why, rc, "unknown",
                           "the store did not answer, so whether it was written is not known: %s",
                           apc_store_error(store));
    }
    if (rc < 0)
        return fail_of_store(store, rc, why);
    rc = operation_record(o, store, asked);
    return rc < 0 ? change_fail(why, rc, "record", "the change was made, but not recorded as an event: %s",
                                apc_store_error(store))
                  : 0;
}

void operation_end(struct operation *o)
{
    free(o->with.at);
    o->with = (struct owner_rows){0};
}

/* ---- After --------------------------------------------------------------------------------- */

/* Of a loop that another one moves both come together. */
static apc_ns patience_of_operation(const struct operation *o)
{
    const struct loops *loops = o->plant->loops;
    apc_ns longest = 0, together = 0;
    for (size_t i = 0; i < o->n; i++) {
        const struct change *c = &o->change[i];
        const apc_ns own = change_patience(c);
        longest = own > longest ? own : longest;
        if (c->to.loop && c->to.loop->above >= 0 && c->to.table == APC_OPMODE)
            together += 4 * loops->controller[loops->at[c->to.loop->above].controller].period;
    }
    return longest + together;
}

/* It was refused, and the words may still come. */
static bool wants_words(struct operation *o, struct change *c, struct apc_store *store)
{
    if (c->outcome != OUTCOME_REFUSED || c->refusal[0] || is_out_of_man(c) ||
        outcome_refusal(store, c->to.name, o->time, c->refusal, sizeof c->refusal))
        return false;
    o->refused = o->refused > 0 ? o->refused : apc_clock_mono(NULL);
    return apc_clock_mono(NULL) - o->refused < EVENT_DELAY;
}

int operation_poll(struct operation *o, struct apc_store *store)
{
    /* Before the look: a simulated plant may get far between the two. */
    const bool late = apc_clock_plant() - o->begun >= patience_of_operation(o);
    const int rc = operation_look(o, store);
    bool settled = true;
    for (size_t i = 0; i < o->n && rc == 0; i++) {
        struct change *c = &o->change[i];
        if (c->outcome != OUTCOME_APPLIED) /* it was in force: what came later is another's */
            c->outcome = change_judge(c, apc_clock_utc(NULL));
        settled &= (late || (c->outcome != OUTCOME_WAITING && c->outcome != OUTCOME_NOBODY)) &&
                   !wants_words(o, c, store);
    }
    return rc < 0 ? rc : settled;
}

int operation_wait(const struct operation *o, struct apc_store *store, apc_ns most)
{
    struct apc_sample *seen = calloc(o->n + 1, sizeof *seen);
    const apc_ns left = o->begun + patience_of_operation(o) - apc_clock_plant();
    apc_ns pause = o->refused > 0 ? PAUSE : most;
    int rc = seen ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < o->n && seen; i++) {
        seen[i] = o->change[i].actual;
        pause = is_owner_switch(&o->change[i]) ? PAUSE : pause; /* another one may take it back */
    }
    if (seen && left > 0)
        rc = apc_store_wait(store, seen, o->n, pause < left ? pause : left);
    else if (seen)
        rc = apc_store_wait(store, seen, o->n, PAUSE); /* for words */
    free(seen);
    return rc < 0 ? rc : 0;
}

int operation_finish(const struct operation *o, size_t i, struct change_fault *said)
{
    return change_finish(&o->change[i], apc_clock_utc(NULL), said);
}
