/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The journal -------------------------------------------------------------------------- */

struct loading {
    struct alarm_journal *journal;
    size_t room, looked;
    const struct alarm_search *search;
    size_t last; /* the newest so many alone; 0: all */
    struct apc_sample former;
    int rc;
};

static int by_number(const void *x, const void *y)
{
    const struct alarm_transition *a = x, *b = y;
    return a->number < b->number ? -1 : a->number > b->number;
}

static void keep_last(struct alarm_journal *j, size_t last)
{
    if (j->n > 1)
        qsort(j->at, j->n, sizeof *j->at, by_number);
    if (last == 0 || j->n <= last)
        return;
    memmove(j->at, j->at + j->n - last, last * sizeof *j->at);
    j->n = last;
}

static bool is_looked_for(const struct alarm_search *s, const struct apc_sample *row)
{
    return (s->states == 0 || (row->value >= 0 && row->value < 32 && s->states >> (int)row->value & 1)) &&
           (s->before == 0 || row->origin < s->before);
}

static int take_alarm_row(void *ctx, const struct apc_sample *row)
{
    struct loading *l = ctx;
    struct alarm_journal *j = l->journal;
    const struct apc_sample former = l->former;
    l->former = *row;
    if (l->search && l->search->states && ++l->looked > ALARM_SEARCH_MOST) {
        l->rc = APC_ERANGE;
        return 1;
    }
    if (l->search && !is_looked_for(l->search, row))
        return 0;
    if (j->n == l->room && l->search && l->last > 0 && j->n > 2 * l->last)
        keep_last(j, l->last);
    if (j->n == l->room) {
        struct alarm_transition *at = reallocarray(j->at, 2 * l->room + 64, sizeof *at);
        if (!at) {
            l->rc = APC_ENOMEM;
            return 1;
        }
        j->at = at;
        l->room = 2 * l->room + 64;
    }
    enum apc_alarm_state before = row->seq == 1 ? APC_ALARM_NORMAL : (enum apc_alarm_state)0;
    if (former.id == row->id && former.seq == row->seq - 1)
        before = (enum apc_alarm_state)(int)former.value;
    j->at[j->n++] = (struct alarm_transition){.number = row->origin,
                                              .seq = row->seq,
                                              .time = row->time,
                                              .alarm = row->id,
                                              .before = before,
                                              .state = (enum apc_alarm_state)(int)row->value,
                                              .status = row->status,
                                              .author = row->author};
    return 0;
}

#define SET_BACK (86400 * APC_NS_PER_S) /* of a clock: a newest row may be so much older than one before it */

#define AT_ONE_TIME 16 /* transitions of one alarm */

/* Of most alarms the newest row says that there is nothing. */
static bool may_have_moved(const struct apc_sample *newest, const struct apc_range *range)
{
    return newest->seq > (range ? range->after : 0) &&
           (!range || range->since == 0 || newest->time >= range->since - SET_BACK);
}

/* Those without a number first, of former releases: they may be any. */
static int by_newest(const void *x, const void *y)
{
    const struct apc_sample *a = x, *b = y;
    if (a->origin == 0 || b->origin == 0)
        return (a->origin != 0) - (b->origin != 0);
    return a->origin > b->origin ? -1 : a->origin < b->origin;
}

/* As many as are wanted, of which none is older than all of this alarm. */
static bool has_enough(const struct loading *l, const struct apc_sample *newest)
{
    if (l->last == 0 || l->journal->n < l->last)
        return false;
    keep_last(l->journal, l->last);
    return newest->origin > 0 && newest->origin < l->journal->at[0].number;
}

int alarm_journal_load(struct alarm_journal *journal, struct apc_store *store, size_t n,
                       const struct apc_range *range)
{
    return alarm_journal_find(journal, store, n, range, NULL);
}

int alarm_journal_find(struct alarm_journal *journal, struct apc_store *store, size_t n,
                       const struct apc_range *range, const struct alarm_search *search)
{
    struct loading l = {.journal = journal, .search = search, .last = range ? range->last : 0};
    struct apc_range of = range ? *range : (struct apc_range){0};
    struct apc_sample *newest = calloc(n + 1, sizeof *newest);
    *journal = (struct alarm_journal){0};
    if (!newest)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++)
        newest[i] = (struct apc_sample){.table = APC_ALARM, .id = (int)i + 1};
    int rc = n > 0 ? apc_store_read(store, newest, n) : 0;
    if (search) /* the last that are looked for may be any */
        of.last = search->states ? 0 : of.last + (search->before ? AT_ONE_TIME : 0);
    if (rc >= 0 && n > 1)
        qsort(newest, n, sizeof *newest, by_newest);
    for (size_t i = 0; i < n && rc >= 0 && l.rc == 0 && !has_enough(&l, &newest[i]); i++)
        if ((!search || search->of[newest[i].id - 1]) && may_have_moved(&newest[i], range))
            rc = apc_store_history(store, APC_ALARM, newest[i].id, range ? &of : NULL, take_alarm_row, &l);
    free(newest);
    keep_last(journal, l.last);
    return l.rc ? l.rc : rc < 0 ? rc : 0;
}

#define EARLY APC_NS_PER_S        /* two clocks may differ by that */
#define LATE  (60 * APC_NS_PER_S) /* what comes later was somebody else's */

struct explaining {
    struct alarm_journal *journal;
    const struct experiment *e;
    bool failed;
};

static size_t transition_at(const struct alarm_journal *j, apc_ns time)
{
    size_t first = 0, last = j->n;
    while (first < last) {
        const size_t middle = (first + last) / 2;
        if (j->at[middle].time < time)
            first = middle + 1;
        else
            last = middle;
    }
    return first;
}

/* "NAME: shelved until TIME (REASON)", as alarm_summary_words() says it, or, of the page, "... (from ADDRESS)" with
 * ": REASON" behind it; NULL: out of memory. */
static char *reason_of_words(const char *words)
{
    static const char from[] = " (from ";
    const char *begin = strstr(words, " ("), *end;
    const size_t n = strlen(words);
    if (!begin)
        return strdup("");
    if (strncmp(begin, from, sizeof from - 1) == 0) {
        end = begin + sizeof from - 1 + strcspn(begin + sizeof from - 1, " )"); /* an address has no blank */
        if (strcmp(end, ")") == 0 || strncmp(end, "): ", 3) == 0)
            return strdup(end[1] ? end + 3 : "");
    }
    return words[n - 1] == ')' ? strndup(begin + 2, (size_t)(words + n - 1 - begin - 2)) : strdup("");
}

/* What it led to is the alarm's next transition by a person. */
static int take_reason(void *ctx, const struct apc_event *event)
{
    struct explaining *x = ctx;
    const char *colon = strstr(event->text, ": ");
    const size_t named = colon ? (size_t)(colon - event->text) : 0;
    size_t i = transition_at(x->journal, event->time - EARLY);
    if (strcmp(event->kind, "operator") != 0 || !colon)
        return 0;
    for (; i < x->journal->n && x->journal->at[i].time < event->time + LATE; i++) {
        struct alarm_transition *t = &x->journal->at[i];
        const char *name = x->e->alarm[t->alarm - 1].name;
        if (t->author == 0 || t->reason || strlen(name) != named || strncmp(event->text, name, named) != 0)
            continue;
        t->reason = reason_of_words(colon);
        x->failed = !t->reason;
        break;
    }
    return x->failed;
}

int alarm_journal_reasons(struct alarm_journal *journal, struct apc_store *store, const struct experiment *e)
{
    struct explaining x = {.journal = journal, .e = e};
    if (journal->n == 0)
        return 0;
    const struct apc_range range = {.since = journal->at[0].time - 60 * APC_NS_PER_S,
                                    .until = journal->at[journal->n - 1].time + EARLY};
    const int rc = apc_store_events(store, &range, take_reason, &x);
    return x.failed ? APC_ENOMEM : rc < 0 ? rc : 0;
}

void alarm_journal_free(struct alarm_journal *journal)
{
    for (size_t i = 0; i < journal->n; i++)
        free(journal->at[i].reason);
    free(journal->at);
    *journal = (struct alarm_journal){0};
}

bool alarm_is_raised(const struct alarm_transition *t)
{
    return t->state == APC_ALARM_UNACKED;
}

bool alarm_event(const struct experiment *e, const struct apc_sample *row, struct apc_event *event)
{
    if (row->table != APC_ALARM || (int)row->value != APC_ALARM_UNACKED || row->id < 1 ||
        (size_t)row->id > e->n_alarms)
        return false;
    const struct alarm *alarm = &e->alarm[row->id - 1];
    const int priority = alarm->is.priority;
    *event = (struct apc_event){.severity = priority <= 2   ? APC_EVENT_ALARM
                                            : priority == 3 ? APC_EVENT_WARNING
                                                            : APC_EVENT_INFO,
                                .kind = "alarm"};
    snprintf(event->text, sizeof event->text, "%.62s%s%.126s", alarm->name, alarm->message[0] ? ": " : "",
             alarm->message);
    return true;
}

/* ---- Figures ------------------------------------------------------------------------------ */

/* What is known of one alarm on the way through the journal. */
struct track {
    apc_ns active; /* since; 0: it is not */
    apc_ns raised[ALARMS_CHATTER],
        waits; /* the last times; since when for somebody to acknowledge it; 0: not */
};

static void raise_one(struct alarm_figures *f, struct alarm_figure *of, struct track *t, int priority,
                      apc_ns time)
{
    memmove(t->raised, t->raised + 1, (ALARMS_CHATTER - 1) * sizeof *t->raised);
    t->raised[ALARMS_CHATTER - 1] = time;
    if (of->raised++ == 0)
        of->first = time;
    if (of->raised >= ALARMS_CHATTER && time - t->raised[0] <= ALARMS_CHATTER_WINDOW)
        of->chatters = true;
    if (t->waits == 0)
        t->waits = time;
    f->raised++;
    f->by_priority[priority - 1]++;
}

static void follow_alarm(struct alarm_figures *f, struct track *t, const struct alarm_transition *at,
                         int priority, double *waited)
{
    struct alarm_figure *of = &f->alarm[at->alarm - 1];
    const bool active = apc_alarm_is_active(at->state), standing = apc_alarm_is_standing(at->state);
    if (alarm_is_raised(at))
        raise_one(f, of, t, priority, at->time);
    else if (t->waits > 0 && !apc_alarm_is_unacked(at->state)) {
        if (!apc_alarm_is_masked(at->state)) {
            *waited += apc_ns_to_s(at->time - t->waits);
            f->acknowledged++;
        }
        t->waits = 0;
    }
    if (t->active > 0 && !active) {
        of->active += at->time - t->active;
        t->active = 0;
    } else if (t->active == 0 && active) {
        t->active = at->time;
    }
    of->since = !standing ? 0 : of->since ? of->since : at->time;
    of->state = at->state;
}

/* Those that are raised, by windows of ten minutes. */
static void count_windows(struct alarm_figures *f, const struct alarm_journal *j, apc_ns since, apc_ns until)
{
    apc_ns from = since;
    size_t i = 0;
    while (from < until) {
        size_t n = 0;
        for (; i < j->n && j->at[i].time < from + ALARMS_WINDOW; i++)
            n += alarm_is_raised(&j->at[i]);
        f->windows++;
        f->floods += n > ALARMS_FLOOD;
        f->peak = n > f->peak ? n : f->peak;
        from += ALARMS_WINDOW;
    }
}

static void conclude(struct alarm_figures *f, struct track *track, apc_ns until)
{
    for (size_t i = 0; i < f->n; i++) {
        struct alarm_figure *of = &f->alarm[i];
        if (track[i].active > 0)
            of->active += until - track[i].active;
        f->chattering += of->chatters;
        f->standing += of->since > 0;
        f->stale += of->since > 0 && until - of->since > ALARMS_STALE;
        f->unacked += apc_alarm_is_unacked(of->state);
    }
}

int alarm_figures_make(struct alarm_figures *f, const struct alarm_journal *journal,
                       const struct experiment *e, apc_ns since, apc_ns until)
{
    struct track *track = calloc(e->n_alarms + 1, sizeof *track);
    double waited = 0;
    *f = (struct alarm_figures){.alarm = calloc(e->n_alarms + 1, sizeof *f->alarm), .n = e->n_alarms};
    if (!track || !f->alarm) {
        free(track);
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < f->n; i++)
        f->alarm[i].state = APC_ALARM_NORMAL;
    for (size_t i = 0; i < journal->n; i++) {
        const struct alarm_transition *at = &journal->at[i];
        if (at->alarm >= 1 && (size_t)at->alarm <= f->n)
            follow_alarm(f, &track[at->alarm - 1], at, e->alarm[at->alarm - 1].is.priority, &waited);
    }
    f->hours = apc_ns_to_s(until - since) / 3600;
    f->per_hour = f->hours > 0 ? (double)f->raised / f->hours : 0;
    f->to_acknowledge = f->acknowledged > 0 ? waited / (double)f->acknowledged : (double)NAN;
    count_windows(f, journal, since, until);
    conclude(f, track, until);
    free(track);
    return 0;
}

void alarm_figures_free(struct alarm_figures *f)
{
    free(f->alarm);
    *f = (struct alarm_figures){0};
}
