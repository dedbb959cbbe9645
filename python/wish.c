/* SPDX-License-Identifier: BSD-3-Clause */
/* What an operator writes, as `apc set`, `tune` and `mode` do it: who waits for what is Python's. */
#include <apcstore.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "columns.h"
#include "operate/operate.h"

_Static_assert((int)APC_FATE_WAITING == (int)OUTCOME_WAITING &&
                   (int)APC_FATE_APPLIED == (int)OUTCOME_APPLIED &&
                   (int)APC_FATE_SUPERSEDED == (int)OUTCOME_SUPERSEDED &&
                   (int)APC_FATE_REFUSED == (int)OUTCOME_REFUSED &&
                   (int)APC_FATE_NOBODY == (int)OUTCOME_NOBODY,
               "they are the same");

static int failed(struct apc_store *store, int rc, struct apc_error *why)
{
    return rc == APC_ENOMEM ? apc_fail(why, rc, "out of memory")
                            : apc_fail(why, rc, "%s", apc_store_error(store));
}

static int load(struct known_plant *plant, struct apc_store *store, struct apc_error *why)
{
    const int rc = known_load(plant, store);
    return rc < 0 ? failed(store, rc, why) : 0;
}

/* ---- What is meant ----------------------------------------------------------------------------- */

static int find(struct apc_wish *w, struct apc_store *store, const struct plant_view *p, const char *name,
                bool mode, double value, struct apc_error *why)
{
    struct change_target to;
    struct change_fault fault;
    int rc = change_find(p, name, mode ? CHANGE_MODE : CHANGE_SETPOINT | CHANGE_TUNING | CHANGE_OUTPUT, &to,
                         &fault);
    struct apc_sample target = {.table = APC_OPMODE, .id = to.loop ? to.loop->id : 0};

    if (rc == 0)
        rc = change_check(&to, value, &fault);
    if (rc == 0 && change_asks_mode(&to) && (rc = apc_store_read(store, &target, 1)) < 0)
        return failed(store, rc, why);
    if (rc >= 0)
        rc = change_now(p, &to, &target, &fault);
    if (rc < 0)
        return apc_fail(why, rc, "%s", fault.text);
    const struct loops_controller *const by = loops_taker(p->loops, plant_tag(p, to.table, to.id));

    if (!by)
        return apc_fail(why, APC_EPERM, "nobody applies it: %s belongs to no controller", to.name);
    *w = (struct apc_wish){.table = (int32_t)to.table,
                           .id = to.id,
                           .value = value,
                           .before = (double)NAN,
                           .number = by->number,
                           .period = by->period > 0 ? by->period : APC_NS_PER_S};
    snprintf(w->name, sizeof w->name, "%s", to.name);
    snprintf(w->controller, sizeof w->controller, "%s", by->name);
    return 0;
}

int apc_wish_find(struct apc_wish *wish, struct apc_store *store, const char *name, bool mode, double value,
                  struct apc_error *why)
{
    struct known_plant plant;
    int rc = load(&plant, store, why);

    if (rc == 0)
        rc = find(wish, store, &plant.view, name, mode, value, why);
    known_free(&plant);
    return rc;
}

/* ---- What is there ------------------------------------------------------------------------------- */

struct seen {
    struct apc_sample newest, actual;
    struct apc_vector tick;
};

static int see(struct apc_wish *w, struct apc_store *store, struct seen *s, struct apc_error *why)
{
    const enum apc_table table = (enum apc_table)w->table;
    struct apc_sample sample[2] = {{.table = table, .id = w->id},
                                   {.table = APC_ACTUAL, .id = apc_variable_number(table, w->id)}};

    s->tick = (struct apc_vector){.table = APC_TICK, .id = w->number};
    struct apc_rows rows = {
        .size = sizeof rows, .sample = sample, .n_samples = 2, .vector = &s->tick, .n_vectors = 1};
    const int rc = apc_store_read_rows(store, &rows);

    if (rc < 0)
        return failed(store, rc, why);
    s->newest = sample[0];
    s->actual = sample[1];
    w->tick = s->tick.seq > 0 ? s->tick.time : 0;
    w->tick_seq = s->tick.seq;
    w->force = s->actual.seq > 0 ? s->actual.value : (double)NAN;
    return 0;
}

struct stop {
    const char *controller;
    bool stopped;
};

static int take_event(void *ctx, const struct apc_event *event)
{
    struct stop *const s = ctx;

    s->stopped |= !strcmp(event->kind, "stop") &&
                  (!strcmp(event->source, "apc-controller") || strstr(event->source, s->controller));
    return 0;
}

int apc_wish_ticks(struct apc_wish *wish, struct apc_store *store, struct apc_error *why)
{
    struct seen seen;
    struct stop stop = {.controller = wish->controller};
    int rc = see(wish, store, &seen, why);
    const struct apc_range since = {.since = wish->tick};
    const apc_ns age = apc_clock_utc(NULL) - wish->tick;

    if (rc < 0 || wish->tick_seq == 0 || age < 0 || age > 3 * wish->period + 2 * APC_NS_PER_S)
        return rc < 0 ? rc : 0;
    rc = apc_store_events(store, &since, take_event, &stop);
    return rc < 0 ? failed(store, rc, why) : !stop.stopped;
}

/* ---- Writing ------------------------------------------------------------------------------------- */

static void text_of(const struct apc_wish *w, double value, char text[32])
{
    const char *const word = w->table == APC_OPMODE && value >= 0 ? apc_mode_name((int)value) : NULL;

    if (isnan(value) || word)
        snprintf(text, 32, "%s", word ? word : "none");
    else
        snprintf(text, 32, "%.10g", value);
}

static int record(const struct apc_wish *w, struct apc_store *store, const char *author,
                  const struct known_plant *p, const struct owner_rows *with)
{
    struct apc_event event[2] = {{.time = w->time, .severity = APC_EVENT_INFO, .kind = "operator"}};
    char before[32], after[32];
    size_t n = 1;

    snprintf(event[0].source, sizeof event[0].source, "%.31s", author);
    event[1] = event[0];
    text_of(w, w->before, before);
    text_of(w, w->value, after);
    snprintf(event[0].text, sizeof event[0].text, "%s%s: %s -> %s", w->name,
             w->table == APC_OPMODE ? " mode" : "", before, after);
    for (size_t i = 0; i < with->n && n < 2; i++)
        if (with->at[i].table == APC_OPMODE) {
            const struct apc_tag *const tag =
                plant_tag(&p->view, APC_SETPOINT, loops_owned(&p->loops, &with->at[i]));

            snprintf(event[n++].text, sizeof event[1].text, "%s taken Local, %s",
                     tag ? tag->name : "setpoint",
                     loops_is_owner(&with->at[i]) ? "the scheduler stands aside" : "cascade open");
        }
    return apc_store_append_events(store, event, n);
}

static int put(struct apc_wish *w, struct apc_store *store, const char *author, const struct known_plant *p)
{
    struct owner_rows with = {0};
    const int number = apc_store_author(store, author);
    struct apc_sample row = {.table = (enum apc_table)w->table,
                             .id = w->id,
                             .seq = APC_SEQ_ANY,
                             .time = apc_clock_utc(NULL),
                             .value = w->value,
                             .author = (uint32_t)number};
    int rc = number < 0 ? number : owner_put(store, &p->loops, &row, 1, &with);

    w->seq = row.seq;
    w->time = row.time;
    if (rc >= 0)
        rc = record(w, store, author, p, &with);
    free(with.at);
    return rc;
}

int apc_wish_write(struct apc_wish *wish, struct apc_store *store, const char *author, struct apc_error *why)
{
    struct known_plant plant;
    struct seen seen;
    int rc = load(&plant, store, why);

    if (rc == 0)
        rc = see(wish, store, &seen, why);
    if (rc == 0) {
        wish->before = seen.newest.seq > 0 ? seen.newest.value : (double)NAN;
        rc = put(wish, store, author, &plant);
        if (rc < 0)
            failed(store, rc, why);
    }
    known_free(&plant);
    return rc < 0 ? rc : 0;
}

/* ---- What became of it ------------------------------------------------------------------------------ */

int apc_wish_look(struct apc_wish *wish, struct apc_store *store, int64_t timeout, struct apc_error *why)
{
    struct seen seen;
    int rc = see(wish, store, &seen, why);
    const struct apc_sample write = {.table = (enum apc_table)wish->table,
                                     .id = wish->id,
                                     .seq = wish->seq,
                                     .time = wish->time,
                                     .value = wish->value};
    const struct outcome_seen of = {.write = &write,
                                    .actual = &seen.actual,
                                    .tick = &seen.tick,
                                    .period = wish->period,
                                    .now = apc_clock_utc(NULL)};

    if (rc < 0)
        return rc;
    const enum outcome outcome = outcome_of(&of);

    wish->text[0] = '\0';
    if (outcome == OUTCOME_REFUSED)
        (void)outcome_refusal(store, wish->name, wish->time, wish->text, sizeof wish->text);
    if (outcome == OUTCOME_WAITING || outcome == OUTCOME_NOBODY)
        rc = apc_store_wait(store, &seen.actual, 1, timeout);
    return rc < 0 ? failed(store, rc, why) : (int)outcome;
}
