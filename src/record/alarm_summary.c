/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROWS 7 /* of an alarm */

/* ---- Making ------------------------------------------------------------------------------- */

static int make_alarm_summary(struct alarm_summary *b, struct apc_error *why)
{
    const size_t n = b->e.n_alarms;
    b->at = calloc(n + 1, sizeof *b->at);
    b->coming = calloc(COMINGS * n + 1, sizeof *b->coming);
    b->memory = calloc(ROWS * n + 1, sizeof *b->memory);
    if (!b->at || !b->coming || !b->memory)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    struct apc_sample *sample = b->memory;
    for (size_t i = 0; i < n; i++) {
        b->at[i].row = sample;
        *sample++ = (struct apc_sample){.table = APC_ALARM, .id = (int)i + 1};
        for (int k = 0; k < 3; k++) {
            const int id = apc_alarm_switch_id((enum apc_alarm_switch)(APC_ALARM_ACK + k), (int)i + 1);
            b->at[i].request[k] = sample;
            *sample++ = (struct apc_sample){.table = APC_OPMODE, .id = id};
            b->at[i].actual[k] = sample;
            *sample++ = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, id)};
        }
    }
    b->tick = (struct apc_vector){.table = APC_TICK, .id = module_alarms_number(&b->e)};
    b->tick.room = APC_ALARMS_TICK;
    b->tick.value = b->numbers;
    b->rows = (struct apc_rows){.size = sizeof b->rows,
                                .sample = b->memory,
                                .n_samples = ROWS * n,
                                .vector = &b->tick,
                                .n_vectors = 1};
    return 0;
}

int alarm_summary_open(struct alarm_summary *b, struct apc_store *store, struct apc_error *why)
{
    int64_t revision;
    int rc = apc_store_catalogue(store, NULL, 0, &revision);
    if (rc < 0)
        return apc_fail(why, rc, "%s", apc_store_error(store));
    if (revision == 0 || revision != b->revision) {
        alarm_summary_close(b);
        if ((rc = experiment_stored(&b->e, store, &revision, why)) < 0 ||
            (rc = make_alarm_summary(b, why)) < 0)
            return rc;
        b->revision = revision;
    }
    return b->e.n_alarms > 0 ? 0
                             : apc_fail(why, APC_ENOTFOUND,
                                        "no alarms are described in this store: an experiment file has them "
                                        "as \"alarms\" of a signal");
}

void alarm_summary_close(struct alarm_summary *b)
{
    free(b->memory);
    free(b->coming);
    free(b->at);
    experiment_free(&b->e);
    memset(b, 0, sizeof *b);
}

int alarm_summary_read(struct alarm_summary *b, struct apc_store *store)
{
    const int rc = apc_store_read_rows(store, &b->rows);
    return rc < 0 ? rc : 0;
}

/* ---- How they stand ------------------------------------------------------------------------ */

const struct alarm_now *alarm_summary_find(const struct alarm_summary *b, const char *name)
{
    for (size_t i = 0; i < b->e.n_alarms; i++)
        if (!strcmp(b->e.alarm[i].name, name))
            return &b->at[i];
    return NULL;
}

const struct alarm *alarm_summary_alarm(const struct alarm_summary *b, const struct alarm_now *now)
{
    return &b->e.alarm[now - b->at];
}

enum apc_alarm_state alarm_summary_state(const struct alarm_now *now)
{
    const enum apc_alarm_state state = (enum apc_alarm_state)(int)now->row->value;
    return now->row->seq > 0 && apc_alarm_state_name(state) ? state : APC_ALARM_NORMAL;
}

apc_ns alarm_summary_shelved(const struct alarm_now *now)
{
    const struct apc_sample *actual = now->actual[ALARM_SWITCH(APC_ALARM_SHELF)];
    apc_ns until = 0;
    return actual->seq > 0 && apc_ns_from_s(fabs(actual->value), &until) == 0 ? until : 0;
}

/* ---- Which came first ---------------------------------------------------------------------- */

#define ROWS_BACK 64 /* of one alarm */

/* Rows of one alarm one after another. */
static int follow_raised(void *ctx, const struct apc_sample *row)
{
    struct alarm_raised *r = ctx;
    r->seq = row->seq;
    if ((int)row->value != APC_ALARM_UNACKED)
        return 0;
    if (r->last == 0 || row->time - r->last > ALARMS_BURST) {
        memmove(r->began + 1, r->began, (COMINGS - 1) * sizeof *r->began);
        r->began[0] = row->time;
    }
    r->last = row->time;
    return 0;
}

static int find_raised(struct alarm_now *now, struct apc_store *store)
{
    const struct apc_range range = {.last = ROWS_BACK};
    struct alarm_raised *r = &now->raised;
    int rc = 0;
    if (now->row->seq != r->seq + 1) {
        *r = (struct alarm_raised){0};
        rc = apc_store_history(store, APC_ALARM, now->row->id, &range, follow_raised, r);
    }
    if (rc < 0)
        *r = (struct alarm_raised){0};
    else if (r->seq < now->row->seq)
        (void)follow_raised(r, now->row);
    return rc < 0 ? rc : 0;
}

int alarm_summary_mark(struct alarm_summary *b, struct apc_store *store)
{
    apc_ns earliest = INT64_MAX;
    int rc = 0;
    for (size_t i = 0; i < b->e.n_alarms && rc == 0; i++) {
        struct alarm_now *now = &b->at[i];
        const enum apc_alarm_state state = alarm_summary_state(now);
        const int64_t seq = now->raised.seq;
        if (now->row->seq != seq && (state != APC_ALARM_NORMAL || now->row->seq == seq + 1))
            rc = find_raised(now, store);
        if (apc_alarm_is_standing(state) && now->raised.last > 0 && now->raised.began[0] < earliest)
            earliest = now->raised.began[0];
    }
    /* one that has gone may have come before them; before that it was not among theirs */
    for (size_t i = 0; i < b->e.n_alarms && rc == 0 && earliest < INT64_MAX; i++)
        if (b->at[i].row->seq != b->at[i].raised.seq && b->at[i].row->time >= earliest - ALARMS_BURST)
            rc = find_raised(&b->at[i], store);
    if (rc == 0)
        alarm_summary_first_out(b);
    return rc;
}

static int by_area_and_time(const void *x, const void *y)
{
    const struct alarm_coming *a = x, *b = y;
    const int other = strcmp(a->area, b->area);
    return other ? other : (a->time > b->time) - (a->time < b->time);
}

static void mark_burst(const struct alarm_coming *at, size_t n)
{
    const apc_ns first = at[0].time, last = at[n - 1].time;
    for (size_t i = 0; first < last && at[i].time == first; i++)
        at[i].of->first_out |= at[i].of->raised.began[0] <= last /* it has not come again since */
                               && apc_alarm_is_standing(alarm_summary_state(at[i].of));
}

void alarm_summary_first_out(struct alarm_summary *b)
{
    struct alarm_coming *at = b->coming;
    size_t n = 0;
    for (size_t i = 0; i < b->e.n_alarms; i++) {
        struct alarm_now *now = &b->at[i];
        now->first_out = false;
        for (size_t k = 0; k < COMINGS && now->raised.began[k] > 0; k++)
            at[n++] = (struct alarm_coming){b->e.alarm[i].area, now->raised.began[k], now};
    }
    if (n > 1)
        qsort(at, n, sizeof *at, by_area_and_time);
    for (size_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && strcmp(at[end].area, at[i].area) == 0 &&
                          at[end].time - at[end - 1].time <= ALARMS_BURST;)
            end++;
        mark_burst(at + i, end - i);
    }
}

static struct outcome_seen seen_of_alarm(const struct alarm_summary *b, apc_ns utc)
{
    return (struct outcome_seen){.tick = &b->tick, .period = b->e.alarms.rhythm.period, .now = utc};
}

bool alarm_summary_lives(const struct alarm_summary *b, apc_ns utc)
{
    const struct outcome_seen seen = seen_of_alarm(b, utc);
    return b->tick.seq > 0 && outcome_age(&seen) <= 3 * seen.period + 100 * APC_NS_PER_MS;
}

/* ---- What is wanted ------------------------------------------------------------------------ */

/* As it stands that makes no sense. */
static bool refuse_alarm_request(const struct alarm_summary *b, const struct alarm_now *now,
                                 const char *reason, struct apc_error *why)
{
    apc_fail(why, APC_EPERM, "%s: %s: it is %s", alarm_summary_alarm(b, now)->name, reason,
             apc_alarm_state_name(alarm_summary_state(now)));
    return false;
}

static bool may_ack(const struct alarm_summary *b, const struct alarm_now *now, struct apc_store *store,
                    struct apc_error *why)
{
    const struct apc_sample *ack = now->request[ALARM_SWITCH(APC_ALARM_ACK)],
                            *actual = now->actual[ALARM_SWITCH(APC_ALARM_ACK)];
    const enum apc_alarm_state state = alarm_summary_state(now);
    char name[APC_AUTHOR_LEN];
    if (!apc_alarm_is_unacked(state) && !apc_alarm_is_latched(state))
        return refuse_alarm_request(b, now, "there is nothing to acknowledge", why);
    if (ack->seq <= actual->origin || ack->value < (double)now->row->seq)
        return true;
    /* its evaluation has not come to that, so its state is the one before */
    const bool known = store && ack->author > 0 && apc_store_author_name(store, ack->author, name) == 0;
    apc_fail(why, APC_EPERM, "%s: %s has just acknowledged it", alarm_summary_alarm(b, now)->name,
             known ? name : "somebody");
    return false;
}

bool alarm_summary_may_shelve(const struct alarm_summary *b, const struct alarm_now *now, double value,
                              apc_ns utc, struct apc_error *why)
{
    static const struct {
        double s;
        const char *name;
    } units[] = {{3600, "h"}, {60, "min"}, {1, "s"}};
    const char *name = alarm_summary_alarm(b, now)->name;
    const double left = fabs(value) - apc_ns_to_s(utc), most = apc_ns_to_s(b->e.alarms.shelve_max);
    size_t k = 0;
    while (most < units[k].s && units[k].s > 1)
        k++;
    if (left <= 0)
        apc_fail(why, APC_EPERM, "%s: the end of shelving is in the past", name);
    else if (left > most + 1)
        apc_fail(why, APC_EPERM, "%s may be shelved for up to %.6g %s", name, most / units[k].s,
                 units[k].name);
    return left > 0 && left <= most + 1;
}

bool alarm_summary_want(const struct alarm_summary *b, const struct alarm_now *now, struct apc_store *store,
                        enum apc_alarm_switch which, double value, apc_ns utc, struct apc_sample *request,
                        struct apc_error *why)
{
    const bool on = value < 0 || value > 0;
    *request = *now->request[ALARM_SWITCH(which)];
    request->time = utc;
    request->status = APC_GOOD;
    request->value = which == APC_ALARM_ACK ? (double)now->row->seq : value;
    if (which == APC_ALARM_ACK)
        return may_ack(b, now, store, why);
    if (which == APC_ALARM_SHELF && on)
        return alarm_summary_may_shelve(b, now, value, utc, why);
    if (which == APC_ALARM_SHELF && alarm_summary_shelved(now) == 0)
        return refuse_alarm_request(b, now, "it is not shelved", why);
    return true;
}

enum outcome alarm_summary_outcome(const struct alarm_summary *b, const struct alarm_now *now,
                                   const struct apc_sample *request, apc_ns utc)
{
    struct outcome_seen seen = seen_of_alarm(b, utc);
    const int which = (request->id / 65536) - APC_ALARM_ACK;
    seen.write = request;
    seen.actual = now->actual[which];
    return outcome_of(&seen);
}

void alarm_summary_words(const char *name, const struct apc_sample *request, const char *reason, char *text,
                         size_t size)
{
    static const char *const done[][2] = {{"acknowledged", "acknowledged"},
                                          {"not shelved any more", "shelved until"},
                                          {"in service", "out of service"}};
    const int which = ALARM_SWITCH(request->id / 65536);
    const bool on = request->value < 0 || request->value > 0;
    char until[APC_TIME_LEN] = "";
    apc_ns ns;
    if (which == ALARM_SWITCH(APC_ALARM_SHELF) && on && apc_ns_from_s(fabs(request->value), &ns) == 0)
        apc_time_format(ns, until);
    snprintf(text, size, "%s: %s%s%.19s%s%s%s%s%s", name, done[which][on], *until ? " " : "", until,
             *until ? "Z" : "", request->value < 0 ? ", once" : "", reason && *reason ? " (" : "",
             reason ? reason : "", reason && *reason ? ")" : "");
}

/* ---- Why it was refused -------------------------------------------------------------------- */

struct refusal {
    const char *name;
    char *text;
    size_t size;
};

static int take_alarm_outcome(void *ctx, const struct apc_event *event)
{
    const struct refusal *r = ctx;
    const size_t n = strlen(r->name);
    if (strcmp(event->kind, "rejected") != 0 || strncmp(event->text, r->name, n) != 0 ||
        strncmp(event->text + n, ": ", 2) != 0)
        return 0;
    snprintf(r->text, r->size, "%s", event->text);
    return 1;
}

bool alarm_summary_refusal(const struct alarm_summary *b, const struct alarm_now *now,
                           const struct apc_sample *request, struct apc_store *store, char *text, size_t size)
{
    const struct apc_sample *actual = now->actual[ALARM_SWITCH(request->id / 65536)];
    const struct apc_range since = {.since = actual->time};
    struct refusal r = {.name = alarm_summary_alarm(b, now)->name, .text = text, .size = size};
    text[0] = '\0';
    return actual->origin == request->seq && apc_store_events(store, &since, take_alarm_outcome, &r) >= 0 &&
           text[0];
}
