/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * All alarms of a plant, in one order. At a tick first all conditions are judged; then each alarm, in the
 * order of its numbers, takes what people want of it, its suppression, and its condition. So what was
 * acknowledged was there before it comes again, and what is suppressed by another alarm is so from the same
 * tick on.
 *
 * What is made at a tick is stored before anything else is looked at: its rows carry their seqs, so a lost
 * answer is made up for by the same rows once more, and no transition is lost or written twice.
 */
#include "base/base_internal.h"
#include "base/parts.h"
#include "modules/alarm.h"
#include "modules/controller.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SHELVE_MAX (INT64_C(8) * 3600 * APC_NS_PER_S)
#define ELEMENTS   (APC_TICK_INDEX_AT + 1) /* that are read of a controller's tick row */
#define STEPS      3 /* most transitions of an alarm at a tick: acknowledged, masked, comes or goes */

enum { ACK, SHELF, SERVICE, SWITCHES };
static const enum apc_alarm_switch switches[SWITCHES] = {APC_ALARM_ACK, APC_ALARM_SHELF, APC_ALARM_SERVICE};

/** What somebody wants of an alarm, and what became of it. */
struct switch_request {
    const struct apc_sample *row; /* newest of the switch */
    int64_t looked;               /* the row that was looked at last */
    int64_t seq;                  /* of the newest row that says so, in table actual */
    double value;                 /* in force */
    uint32_t author;              /* of that */
};

struct watched {
    struct apc_alarm is;
    int number;
    struct apc_alarm_condition condition;
    struct apc_alarm_inputs inputs;
    const struct apc_sample *suppressor;
    struct switch_request request[SWITCHES];
    apc_ns shelved_until; /* mono */
    bool suppressed;
    apc_ns suppressed_until; /* mono */
    enum apc_alarm_state state;
    int64_t seq;   /* of the newest row */
    int64_t since; /* seq from which on it wants to be acknowledged, or reset */
};

struct apc_alarms {
    struct apc_alarms_options options;
    void *memory;       /* of the arrays */
    struct watched *at; /* [n] */
    struct apc_sample *samples;
    struct apc_vector *vectors, tick, former_tick;
    double *elements;
    double numbers[APC_ALARMS_TICK];
    struct apc_rows in, out, former;
    size_t transitions;         /* of out */
    struct apc_sample *settled; /* [n_settled] what became of requests at this tick */
    size_t n_settled;
    int64_t journal; /* number of the last transition */
};

/* ---- Making ------------------------------------------------------------------------------- */

static int refuse_alarm(const struct apc_alarm *a, struct apc_error *why, const char *what)
{
    return apc_fail(why, APC_EINVAL, "alarm %s: %s", a->name ? a->name : "?", what);
}

static bool is_delay(apc_ns delay)
{
    return delay >= 0 && delay <= INT64_C(366) * 86400 * APC_NS_PER_S;
}

/* Of several that suppress one another in a ring none would ever be shown. */
static bool is_in_a_ring(const struct apc_alarms_options *o, size_t i)
{
    int at = o->alarm[i].suppression.alarm;
    for (size_t n = 0; at > 0 && n < o->n; n++) {
        if ((size_t)at == i + 1)
            return true;
        at = o->alarm[at - 1].suppression.alarm;
    }
    return false;
}

static int check_alarm(const struct apc_alarms_options *o, size_t i, struct apc_error *why)
{
    const struct apc_alarm *a = &o->alarm[i];
    const bool lives = a->kind == APC_ALARM_BAD || a->kind == APC_ALARM_STOPPED;
    if (!a->name || !apc_alarm_kind_name(a->kind))
        return refuse_alarm(a, why, "a name and a kind are required");
    if (!apc_table_name(a->table) || a->id < 0 ||
        apc_table_vectors(a->table) != apc_alarm_is_of_controller(a->kind))
        return refuse_alarm(a, why, "no such signal");
    if (a->kind == APC_ALARM_DEVIATION &&
        (!apc_table_name(a->other_table) || apc_table_vectors(a->other_table)))
        return refuse_alarm(a, why, "a deviation is from another signal");
    if (!apc_value_ok(a->limit) || !apc_value_ok(a->deadband) || a->deadband < 0)
        return refuse_alarm(a, why, "limit and deadband must be numbers, the deadband not below 0");
    if (a->kind == APC_ALARM_AT_LIMIT && !(a->low < a->high))
        return refuse_alarm(a, why, "the limits must rise");
    if (!is_delay(a->on_delay) || !is_delay(a->off_delay) || !is_delay(a->horizon) ||
        !is_delay(a->suppression.hold) || (lives && a->horizon == 0))
        return refuse_alarm(a, why, "a delay or horizon must be from 0 to 366 days");
    if (a->priority < 1 || a->priority > APC_ALARM_PRIORITIES)
        return refuse_alarm(a, why, "the priority must be from 1 to 4");
    if (a->suppression.alarm < 0 || (size_t)a->suppression.alarm > o->n || is_in_a_ring(o, i))
        return refuse_alarm(a, why, "it is suppressed by itself, or by no alarm that there is");
    if (a->suppression.table &&
        (!apc_table_name(a->suppression.table) || apc_table_vectors(a->suppression.table)))
        return refuse_alarm(a, why, "it is suppressed by no signal that there is");
    return 0;
}

static int check_alarms_options(const struct apc_alarms_options *o, struct apc_error *why)
{
    int rc = 0;
    if (o->n < 1 || o->n > APC_ALARMS_MAX || !o->alarm || o->number < 1)
        return apc_fail(why, APC_EINVAL, "alarms: 1 to %d alarms and a number are required", APC_ALARMS_MAX);
    if (!is_delay(o->shelve_max))
        return apc_fail(why, APC_EINVAL, "alarms: the longest shelving must be above 0 and at most 366 days");
    for (size_t i = 0; i < o->n && rc == 0; i++)
        rc = check_alarm(o, i, why);
    return rc;
}

/* Rows of all that it reads: of each alarm its signal, another one, what suppresses it, the switches. */
static void wire(struct apc_alarms *a)
{
    struct apc_sample *sample = a->samples;
    struct apc_vector *vector = a->vectors;
    a->in = (struct apc_rows){.size = sizeof a->in, .sample = sample, .vector = vector};
    for (size_t i = 0; i < a->options.n; i++) {
        struct watched *w = &a->at[i];
        const struct apc_alarm *is = &w->is;
        if (apc_alarm_is_of_controller(is->kind)) {
            *vector = (struct apc_vector){
                .table = is->table, .id = is->id, .room = ELEMENTS, .value = a->elements + ELEMENTS * i};
            w->inputs.tick = vector++;
        } else {
            *sample = (struct apc_sample){.table = is->table, .id = is->id};
            w->inputs.signal = sample++;
        }
        if (is->kind == APC_ALARM_DEVIATION || is->kind == APC_ALARM_MODE) {
            *sample =
                is->kind == APC_ALARM_MODE
                    ? (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(is->table, is->id)}
                    : (struct apc_sample){.table = is->other_table, .id = is->other};
            w->inputs.other = sample++;
        }
        if (is->suppression.table) {
            *sample = (struct apc_sample){.table = is->suppression.table, .id = is->suppression.id};
            w->suppressor = sample++;
        }
        for (int k = 0; k < SWITCHES; k++) {
            *sample =
                (struct apc_sample){.table = APC_OPMODE, .id = apc_alarm_switch_id(switches[k], w->number)};
            w->request[k].row = sample++;
        }
    }
    a->in.n_samples = (size_t)(sample - a->in.sample);
    a->in.n_vectors = (size_t)(vector - a->in.vector);
    a->former = (struct apc_rows){
        .size = sizeof a->former, .sample = sample, .n_samples = (1 + SWITCHES) * a->options.n};
    for (size_t i = 0; i < a->options.n; i++) {
        *sample++ = (struct apc_sample){.table = APC_ALARM, .id = a->at[i].number};
        for (int k = 0; k < SWITCHES; k++)
            *sample++ = (struct apc_sample){
                .table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, a->at[i].request[k].row->id)};
    }
    a->tick = (struct apc_vector){.table = APC_TICK,
                                  .id = a->options.number,
                                  .n = APC_ALARMS_TICK,
                                  .room = APC_ALARMS_TICK,
                                  .value = a->numbers};
    a->former_tick = (struct apc_vector){
        .table = APC_TICK, .id = a->options.number, .room = APC_ALARMS_TICK, .value = a->numbers};
    a->former.vector = &a->former_tick;
    a->former.n_vectors = 1;
    a->out = (struct apc_rows){.size = sizeof a->out, .sample = sample, .vector = &a->tick};
    a->settled = sample + STEPS * a->options.n;
}

int apc_alarms_create(struct apc_alarms **alarms, const struct apc_alarms_options *options,
                      struct apc_error *why)
{
    struct apc_alarms_options o = {0};
    if (!alarms)
        return apc_fail(why, APC_EINVAL, "apc_alarms_create: alarms must not be NULL");
    *alarms = NULL;
    int rc = apc_options_copy(&o, sizeof o, options, "apc_alarms_options", why);
    if (rc == 0)
        rc = check_alarms_options(&o, why);
    if (rc < 0)
        return rc;
    if (o.shelve_max == 0)
        o.shelve_max = SHELVE_MAX;
    struct apc_alarms *new = calloc(1, sizeof *new);
    if (!new)
        return apc_fail(why, APC_ENOMEM, "alarms: no memory");
    const size_t in = 3 + SWITCHES, former = 1 + SWITCHES, out = STEPS + SWITCHES + 1;
    const struct apc_part parts[] = {APC_PART(new->at, o.n),
                                     APC_PART(new->samples, (in + former + out) * o.n),
                                     APC_PART(new->vectors, o.n), APC_PART(new->elements, ELEMENTS * o.n)};
    new->options = o;
    new->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!new->memory) {
        apc_alarms_destroy(new);
        return apc_fail(why, APC_ENOMEM, "alarms: no memory");
    }
    for (size_t i = 0; i < o.n; i++)
        new->at[i] = (struct watched){.is = o.alarm[i], .number = (int)i + 1, .state = APC_ALARM_NORMAL};
    wire(new);
    *alarms = new;
    return 0;
}

void apc_alarms_destroy(struct apc_alarms *a)
{
    if (!a)
        return;
    free(a->memory);
    free(a);
}

struct apc_rows *apc_alarms_in(struct apc_alarms *a)
{
    return &a->in;
}

struct apc_rows *apc_alarms_out(struct apc_alarms *a)
{
    return &a->out;
}

struct apc_rows *apc_alarms_former(struct apc_alarms *a)
{
    return &a->former;
}

/* ---- Going on from what is stored ---------------------------------------------------------- */

static bool wants_somebody(enum apc_alarm_state state)
{
    return apc_alarm_is_unacked(state) || apc_alarm_is_latched(state);
}

static void resume_alarm(struct apc_alarms *a, struct watched *w, const struct apc_sample *row)
{
    const enum apc_alarm_state state = (enum apc_alarm_state)(int)row->value;
    w->seq = apc_seq_last(row);
    w->state = row->seq > 0 && apc_alarm_state_name(state) ? state : APC_ALARM_NORMAL;
    w->since = row->seq;
    w->condition.is = w->condition.raw = apc_alarm_is_active(w->state);
    if (row->origin > a->journal)
        a->journal = row->origin;
    for (int k = 0; k < SWITCHES; k++) {
        const struct apc_sample *actual = row + 1 + k;
        w->request[k].looked = actual->seq > 0 ? actual->origin : 0;
        w->request[k].seq = apc_seq_last(actual);
        w->request[k].value = actual->seq > 0 ? actual->value : 0;
        w->request[k].author = actual->author;
    }
    w->shelved_until = INT64_MIN; /* as of the first tick */
}

void apc_alarms_resume(struct apc_alarms *a)
{
    a->tick.seq = a->former_tick.seq > 0 ? a->former_tick.seq : a->former.sample[0].origin;
    /* of an alarm that the file no longer has there may be newer transitions than of those that it has */
    if (a->former_tick.seq > 0 && a->former_tick.n > APC_ALARMS_JOURNAL && a->numbers[APC_ALARMS_JOURNAL] > 0)
        a->journal = (int64_t)a->numbers[APC_ALARMS_JOURNAL];
    for (size_t i = 0; i < a->options.n; i++)
        resume_alarm(a, &a->at[i], a->former.sample + (1 + SWITCHES) * i);
}

/* ---- What comes to pass -------------------------------------------------------------------- */

static void happen(struct apc_alarms *a, struct watched *w, enum apc_alarm_event event, apc_ns utc,
                   uint32_t author)
{
    const enum apc_alarm_state before = w->state;
    w->state = apc_alarm_next(before, event, w->is.latching);
    if (w->state == before)
        return;
    a->out.sample[a->transitions++] =
        (struct apc_sample){.table = APC_ALARM,
                            .id = w->number,
                            .seq = ++w->seq,
                            .time = utc,
                            .value = w->state,
                            .status = w->condition.poor ? APC_UNCERTAIN_LAST_USABLE : APC_GOOD,
                            .author = author,
                            .origin = ++a->journal};
    if (wants_somebody(w->state) &&
        (!wants_somebody(before) || (before == APC_ALARM_LATCHED_UNACKED && w->state == APC_ALARM_LATCHED)))
        w->since = w->seq;
}

/* ---- What people want ---------------------------------------------------------------------- */

/* What became of it. */
static void settle_switch(struct apc_alarms *a, struct watched *w, int which, double value, apc_status status,
                          apc_ns utc)
{
    struct switch_request *request = &w->request[which];
    request->value = value;
    a->settled[a->n_settled++] = (struct apc_sample){.table = APC_ACTUAL,
                                                     .id = apc_variable_number(APC_OPMODE, request->row->id),
                                                     .seq = ++request->seq,
                                                     .time = utc,
                                                     .value = value,
                                                     .status = status,
                                                     .author = request->author,
                                                     .origin = request->looked};
}

static const char *refuse_ack(const struct watched *w, double seen)
{
    if (!(seen <= (double)w->seq))
        return "it refers to a row that is not there";
    if (apc_alarm_is_masked(w->state))
        return "it is shelved, suppressed or out of service";
    if (!wants_somebody(w->state))
        return "there is nothing to acknowledge any more";
    if (seen < (double)w->since)
        return "it refers to an earlier state: look again";
    return NULL;
}

static const char *refuse_shelf(const struct apc_alarms *a, double until, apc_ns utc)
{
    const double left = fabs(until) - apc_ns_to_s(utc);
    if (!(until < 0 || until > 0))
        return NULL;
    if (left <= 0)
        return "its end is past";
    return left > apc_ns_to_s(a->options.shelve_max) + 1 ? "its end is later than shelving may last" : NULL;
}

static const char *refusal_of_switch(const struct apc_alarms *a, const struct watched *w, int which,
                                     apc_ns utc)
{
    const struct apc_sample *row = w->request[which].row;
    if (apc_status_severity(row->status) == APC_SEVERITY_BAD)
        return "its status is Bad";
    if (which == ACK)
        return refuse_ack(w, row->value);
    if (which == SHELF)
        return refuse_shelf(a, row->value, utc);
    return row->value < 0 || row->value > 1 ? "it is neither 0 nor 1" : NULL;
}

static apc_ns end_of_shelving(double value, struct apc_now now)
{
    const double left = fabs(value) - apc_ns_to_s(now.utc);
    apc_ns ns;
    return apc_ns_from_s(left, &ns) < 0 ? now.mono : now.mono + ns;
}

/* Look at a request that is new. One that is refused is told; where another was at this tick it waits. */
static void look_at_switch(struct apc_alarms *a, struct watched *w, int which, struct apc_now now,
                           struct apc_notice *notice)
{
    static const char *const what[SWITCHES] = {"not acknowledged", "not shelved", "service not changed"};
    struct switch_request *request = &w->request[which];
    const struct apc_sample *row = request->row;
    if (row->seq <= request->looked)
        return;
    const char *reason = refusal_of_switch(a, w, which, now.utc);
    if (reason && notice->kind != APC_NOTICE_NONE)
        return;
    request->looked = row->seq;
    if (reason) {
        apc_note(notice, APC_NOTICE_REJECTED, "%.63s: %s: %s", w->is.name, what[which], reason);
        settle_switch(a, w, which, request->value, APC_BAD_OUT_OF_RANGE, now.utc);
        return;
    }
    request->author = row->author;
    if (which == ACK)
        happen(a, w, w->state == APC_ALARM_LATCHED ? APC_ALARM_RESET : APC_ALARM_ACKNOWLEDGE, now.utc,
               row->author);
    if (which == SHELF)
        w->shelved_until = end_of_shelving(row->value, now);
    settle_switch(a, w, which, row->value, APC_GOOD, now.utc);
}

/* Shelving that is over is in force no more. */
static void expire_shelving(struct apc_alarms *a, struct watched *w, bool over, struct apc_now now)
{
    struct switch_request *shelf = &w->request[SHELF];
    const bool shelved = shelf->value < 0 || shelf->value > 0;
    if (shelved && w->shelved_until == INT64_MIN)
        w->shelved_until = end_of_shelving(shelf->value, now);
    if (shelved && (over || now.mono >= w->shelved_until)) {
        shelf->author = 0;
        settle_switch(a, w, SHELF, 0, APC_GOOD, now.utc);
    }
}

/* ---- Masks --------------------------------------------------------------------------------- */

static bool is_suppressed(struct apc_alarms *a, struct watched *w, apc_ns mono)
{
    const struct apc_alarm_suppression *by = &w->is.suppression;
    const struct apc_sample *s = w->suppressor;
    bool is = by->alarm && a->at[by->alarm - 1].condition.is;
    if (s && s->seq > 0 && apc_status_severity(s->status) != APC_SEVERITY_BAD)
        is |= s->value < by->below || s->value > by->above;
    if (is)
        w->suppressed_until = mono + by->hold;
    w->suppressed = is || (w->suppressed && mono < w->suppressed_until);
    return w->suppressed;
}

/* The mask that is wanted, the strongest first. */
static enum apc_alarm_event mask_of(struct apc_alarms *a, struct watched *w, apc_ns mono)
{
    const double shelf = w->request[SHELF].value;
    const bool suppressed = is_suppressed(a, w, mono);
    if (w->request[SERVICE].value > 0)
        return APC_ALARM_REMOVE;
    if (suppressed)
        return APC_ALARM_SUPPRESS;
    return shelf > 0 ? APC_ALARM_SHELVE : shelf < 0 ? APC_ALARM_SHELVE_ONCE : (enum apc_alarm_event)0;
}

/* That takes the mask away that it has. */
static enum apc_alarm_event unmask(enum apc_alarm_state state)
{
    return state >= APC_ALARM_OUT_OF_SERVICE ? APC_ALARM_RESTORE
           : state >= APC_ALARM_SUPPRESSED   ? APC_ALARM_UNSUPPRESS
                                             : APC_ALARM_UNSHELVE;
}

static uint32_t author_of_alarm(const struct watched *w, enum apc_alarm_event event)
{
    switch (event) {
    case APC_ALARM_REMOVE:
    case APC_ALARM_RESTORE:
        return w->request[SERVICE].author;
    case APC_ALARM_SHELVE:
    case APC_ALARM_SHELVE_ONCE:
    case APC_ALARM_UNSHELVE:
        return w->request[SHELF].author;
    default:
        return 0;
    }
}

/* ---- A tick -------------------------------------------------------------------------------- */

/* What goes, goes before a mask is taken away, and what comes, comes after it was put on: so nothing is
 * announced that was masked all the while. */
static void step_alarm(struct apc_alarms *a, struct watched *w, struct apc_now now, struct apc_notice *notice)
{
    for (int k = 0; k < SWITCHES; k++)
        look_at_switch(a, w, k, now, notice);
    const bool once = w->state == APC_ALARM_ONE_SHOT_ACTIVE;
    if (!w->condition.is && apc_alarm_is_active(w->state))
        happen(a, w, APC_ALARM_GOES, now.utc, 0);
    expire_shelving(a, w, once && w->state == APC_ALARM_NORMAL, now);
    enum apc_alarm_event event = mask_of(a, w, now.mono);
    if (!event && apc_alarm_is_masked(w->state))
        event = unmask(w->state);
    if (event)
        happen(a, w, event, now.utc, author_of_alarm(w, event));
    if (w->condition.is && !apc_alarm_is_active(w->state))
        happen(a, w, APC_ALARM_COMES, now.utc, 0);
}

static void count_transition(struct apc_alarms *a, apc_ns utc)
{
    double *n = a->numbers;
    memset(n, 0, sizeof a->numbers);
    n[APC_ALARMS_JOURNAL] = (double)a->journal;
    for (size_t i = 0; i < a->options.n; i++) {
        const enum apc_alarm_state state = a->at[i].state;
        if (state >= APC_ALARM_OUT_OF_SERVICE)
            n[APC_ALARMS_OUT_OF_SERVICE]++;
        else if (state >= APC_ALARM_SUPPRESSED)
            n[APC_ALARMS_SUPPRESSED]++;
        else if (state >= APC_ALARM_SHELVED)
            n[APC_ALARMS_SHELVED]++;
        if (!apc_alarm_is_standing(state))
            continue;
        n[APC_ALARMS_ACTIVE] += apc_alarm_is_active(state);
        n[APC_ALARMS_UNACKED] += apc_alarm_is_unacked(state);
        n[APC_ALARMS_STANDING + a->at[i].is.priority - 1]++;
    }
    a->tick.seq++;
    a->tick.time = utc;
    a->out.n_vectors = 1;
}

int apc_alarms_compute(struct apc_alarms *a, struct apc_now now, struct apc_notice *notice)
{
    struct apc_notice unheard;
    if (!notice)
        notice = &unheard;
    notice->kind = APC_NOTICE_NONE;
    if (apc_alarms_pending(a))
        return (int)a->transitions;
    for (size_t i = 0; i < a->options.n; i++)
        apc_alarm_judge(&a->at[i].condition, &a->at[i].is, &a->at[i].inputs, now);
    for (size_t i = 0; i < a->options.n; i++)
        step_alarm(a, &a->at[i], now, notice);
    memmove(a->out.sample + a->transitions, a->settled, a->n_settled * sizeof *a->settled);
    a->out.n_samples = a->transitions + a->n_settled;
    count_transition(a, now.utc);
    return (int)a->transitions;
}

bool apc_alarms_pending(const struct apc_alarms *a)
{
    return a->out.n_vectors > 0;
}

void apc_alarms_stored(struct apc_alarms *a)
{
    a->out.n_samples = a->out.n_vectors = a->transitions = a->n_settled = 0;
}
