/* SPDX-License-Identifier: BSD-3-Clause */
#include "outcome.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "apc/common/mode_reason.h"
#include "apc/common/print.h"
#include "base/base_internal.h"

#define GRACE       (2 * APC_NS_PER_S)   /* beyond three ticks */
#define LOOK        16                   /* ticks that a period is seen from that nobody says */
#define PAUSE       (50 * APC_NS_PER_MS) /* between two looks */
#define EVENT_DELAY (APC_NS_PER_S / 2)   /* by which an event may come after its tick */

static void pause_for(apc_ns duration)
{
    const struct timespec time = {duration / APC_NS_PER_S, duration % APC_NS_PER_S};
    nanosleep(&time, NULL);
}

/* ---- Whose it is -------------------------------------------------------------------------- */

/* NULL: no controller takes it. */
static const struct loops_controller *controller_of_change(const struct operation *o, const struct change *c)
{
    return loops_taker(&o->plant->loops, cli_tag(&o->plant->tags, c->after.table, c->after.id));
}

static const struct apc_vector *tick_of(const struct waiting *w, const struct loops_controller *c)
{
    return &w->tick[c - w->operation->plant->loops.controller];
}

/* "the controller", where there are several "controller base" */
static const char *name_of_controller(const struct waiting *w, const struct loops_controller *c,
                                      char text[PRINT_LEN])
{
    snprintf(text, PRINT_LEN,
             w->operation->plant->loops.n_controllers > 1 ? "controller %s" : "the controller", c->name);
    return text;
}

/* ---- Ticks -------------------------------------------------------------------------------- */

struct ticks {
    apc_ns last, period; /* the shortest of late; 0: not known */
};

static int take_outcome_tick(void *ctx, const struct apc_vector *v)
{
    struct ticks *t = ctx;
    const apc_ns apart = v->time - t->last;
    if (t->last && apart > 0 && (t->period == 0 || apart < t->period))
        t->period = apart;
    t->last = v->time;
    return 0;
}

static int find_controller_period(struct apc_store *store, const struct loops_controller *c, apc_ns *period)
{
    const struct apc_range last = {.last = LOOK};
    struct ticks ticks = {0};
    *period = c->period;
    int rc =
        c->period > 0 ? 0 : apc_store_vectors(store, APC_TICK, c->number, &last, take_outcome_tick, &ticks);
    *period = c->period > 0 ? c->period : ticks.period;
    return rc;
}

static int read_ticks(const struct waiting *w, struct apc_store *store)
{
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = w->actual,
                            .n_samples = w->operation->n,
                            .vector = w->tick,
                            .n_vectors = w->operation->plant->loops.n_controllers};
    return apc_store_read_rows(store, &rows);
}

struct stop {
    const struct loops *loops;
    const struct loops_controller *controller;
    bool stopped;
};

static int take_stop(void *ctx, const struct apc_event *event)
{
    struct stop *s = ctx;
    s->stopped |= !strcmp(event->kind, "stop") && reason_is_from(s->loops, s->controller, event->source);
    return 0;
}

/* Does it tick, as far as its last tick and its events say? */
static bool ticks_now(const struct waiting *w, struct apc_store *store, const struct loops_controller *c,
                      apc_ns patience)
{
    const struct apc_vector *tick = tick_of(w, c);
    const struct apc_range since = {.since = tick->time};
    struct stop stop = {.loops = &w->operation->plant->loops, .controller = c};
    apc_ns ago = apc_ns_since(apc_clock_utc(NULL), tick->time);
    return tick->seq > 0 && ago >= 0 && ago <= patience &&
           apc_store_events(store, &since, take_stop, &stop) >= 0 && !stop.stopped;
}

static int nobody(const struct waiting *w, const struct cli *cli, const struct loops_controller *c)
{
    char age[PRINT_LEN], name[PRINT_LEN];
    const struct apc_vector *tick = tick_of(w, c);
    if (tick->seq == 0)
        return cli_error(cli, APC_EPERM,
                         "nobody applies it: %s has %sticked in this store. Nothing was written; "
                         "--no-wait does in any case",
                         w->operation->plant->loops.n_controllers > 1 ? name_of_controller(w, c, name)
                                                                      : "no controller",
                         w->operation->plant->loops.n_controllers > 1 ? "never " : "");
    return cli_error(cli, APC_EPERM,
                     "nobody applies it: %s's last tick was %s ago. Nothing was written; --no-wait "
                     "does in any case",
                     name_of_controller(w, c, name),
                     print_age(apc_ns_since(apc_clock_utc(NULL), tick->time), age));
}

/* An age by the clocks of two hosts is no proof that nothing ticks: then a tick is waited for. */
static int look_for_ticks(struct waiting *w, const struct cli *cli, struct apc_store *store,
                          const struct loops_controller *c)
{
    apc_ns *period = &w->period[c - w->operation->plant->loops.controller];
    int rc = find_controller_period(store, c, period);
    const apc_ns patience = 3 * *period + GRACE, until = apc_clock_mono(NULL) + patience;
    const int64_t seen = tick_of(w, c)->seq;

    w->patience = patience > w->patience ? patience : w->patience;
    if (rc >= 0 && ticks_now(w, store, c, patience))
        return EXIT_OK;
    while (rc >= 0 && tick_of(w, c)->seq == seen && apc_clock_mono(NULL) < until) {
        pause_for(PAUSE);
        rc = read_ticks(w, store);
    }
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    return tick_of(w, c)->seq != seen ? EXIT_OK : nobody(w, cli, c);
}

/* ---- Before ------------------------------------------------------------------------------- */

static int prepare_waiting(struct waiting *w, const struct cli *cli)
{
    const struct operation *o = w->operation;
    const size_t n = o->plant->loops.n_controllers;
    w->actual = calloc(o->n + 1, sizeof *w->actual);
    w->tick = calloc(n + 1, sizeof *w->tick);
    w->period = calloc(n + 1, sizeof *w->period);
    if (!w->actual || !w->tick || !w->period)
        return cli_error(cli, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n; i++)
        w->tick[i] = (struct apc_vector){.table = APC_TICK, .id = o->plant->loops.controller[i].number};
    for (size_t i = 0; i < o->n; i++) {
        const struct apc_sample *after = &o->change[i].after;
        w->actual[i] =
            (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(after->table, after->id)};
        if (!controller_of_change(o, &o->change[i]))
            return cli_error(cli, APC_EPERM,
                             "nobody applies it: %s belongs to no controller. Nothing was written; "
                             "--no-wait does in any case",
                             o->change[i].name);
    }
    return EXIT_OK;
}

int outcome_prepare(struct waiting *w, const struct cli *cli, struct apc_store *store,
                    const struct operation *o)
{
    const struct loops_controller *looked = NULL;
    *w = (struct waiting){.operation = o};
    int rc = prepare_waiting(w, cli);
    if (rc != EXIT_OK)
        return rc;
    int read = read_ticks(w, store);
    if (read < 0)
        return cli_store_error(cli, read, store);
    for (size_t i = 0; i < o->n && rc == EXIT_OK; i++) {
        const struct loops_controller *c = controller_of_change(o, &o->change[i]);
        const struct loops_loop *loop =
            loops_of(&o->plant->loops, o->change[i].after.table, o->change[i].after.id);
        if (c != looked)
            rc = look_for_ticks(w, cli, store, c);
        looked = c;
        if (loop && loop->above >= 0 && o->change[i].after.table == APC_OPMODE) /* the two come together */
            w->patience += 4 * o->plant->loops.controller[o->plant->loops.at[loop->above].controller].period;
    }
    return rc;
}

void outcome_free(struct waiting *w)
{
    free(w->actual);
    free(w->tick);
    free(w->period);
}

/* ---- What became of it ---------------------------------------------------------------------- */

static struct outcome_seen outcome_of_change(const struct waiting *w, size_t i)
{
    const struct loops_controller *c = controller_of_change(w->operation, &w->operation->change[i]);
    const struct apc_vector *tick = tick_of(w, c);
    return (struct outcome_seen){.write = &w->operation->change[i].after,
                                 .actual = &w->actual[i],
                                 .tick = tick,
                                 .period = w->period[c - w->operation->plant->loops.controller],
                                 .now = apc_clock_utc(NULL)};
}

/* Returns whether all are settled. What waits, or has nobody, may still come. */
static bool settle_changes(const struct waiting *w)
{
    bool settled = true;
    for (size_t i = 0; i < w->operation->n; i++) {
        struct change *c = &w->operation->change[i];
        const struct outcome_seen seen = outcome_of_change(w, i);
        if (c->outcome != OUTCOME_APPLIED) /* it was in force: what came later is another's */
            c->outcome = outcome_of(&seen);
        settled &= c->outcome != OUTCOME_WAITING && c->outcome != OUTCOME_NOBODY;
    }
    return settled;
}

/* The event comes a little after its tick. */
static bool find_refusal(struct apc_store *store, const struct change *c, char *why, size_t size)
{
    const apc_ns until = apc_clock_mono(NULL) + EVENT_DELAY;
    bool found = outcome_refusal(store, c->name, c->after.time, why, size);
    while (!found && apc_clock_mono(NULL) < until) {
        pause_for(PAUSE);
        found = outcome_refusal(store, c->name, c->after.time, why, size);
    }
    return found;
}

static void say_refused(const struct waiting *w, struct apc_store *store, size_t i, char *why, size_t size)
{
    const struct change *c = &w->operation->change[i];
    const struct loops_loop *loop = loops_of(&w->operation->plant->loops, c->after.table, c->after.id);
    struct apc_sample target = {.table = APC_OPMODE, .id = loop ? loop->id : 0};
    char value[PRINT_LEN];
    if (c->after.table == APC_MANUAL && apc_store_read(store, &target, 1) >= 0 &&
        target.value != (double)APC_MODE_MAN)
        snprintf(why, size, "%s is in %s", loop ? loop->name : c->name, print_value(&target, value));
    else if (!find_refusal(store, c, why, size))
        snprintf(why, size, "%s stays in force", print_exact(w->actual[i].value, value));
}

static void say_waiting(const struct waiting *w, size_t i, char *why, size_t size)
{
    const struct change *c = &w->operation->change[i];
    const struct outcome_seen seen = outcome_of_change(w, i);
    const struct loops_loop *loop = loops_of(&w->operation->plant->loops, c->after.table, c->after.id);
    const struct apc_sample *actual = &w->actual[i];
    const bool looked = actual->seq > 0 && actual->origin == c->after.seq;
    char age[PRINT_LEN], name[PRINT_LEN];

    name_of_controller(w, controller_of_change(w->operation, c), name);
    if (c->outcome == OUTCOME_NOBODY)
        snprintf(why, size, "written, but nobody applies it: %s's last tick was %s ago", name,
                 print_age(outcome_age(&seen), age));
    else if (looked && c->after.table == APC_OPMODE)
        snprintf(why, size, "written, but %s is in %s: see apc status", loop ? loop->name : "the loop",
                 print_value(actual, age));
    else if (looked)
        snprintf(why, size, "written, but not applied yet: the loop has no input; see apc status");
    else
        snprintf(why, size, "written, but %s does not confirm it: see apc status", name);
}

/* What there is to say of change @p i, under this name. */
static int tell_change(const struct waiting *w, const struct cli *cli, struct apc_store *store, size_t i,
                       const char *name)
{
    const struct change *c = &w->operation->change[i];
    char text[192], why[256] = "", value[PRINT_LEN];
    operate_describe(c, name, text, sizeof text);
    switch (c->outcome) {
    case OUTCOME_APPLIED:
        print_clean(stdout, text);
        puts(" (applied)");
        return EXIT_OK;
    case OUTCOME_SUPERSEDED:
        return cli_error(cli, APC_EPERM, "%s: superseded: it is %s now", text,
                         print_value(&w->actual[i], value));
    case OUTCOME_REFUSED:
        say_refused(w, store, i, why, sizeof why);
        return cli_error(cli, APC_EPERM, "%s: refused: %s", text, why);
    default:
        say_waiting(w, i, why, sizeof why);
        return cli_error(cli, APC_ETIMEDOUT, "%s: %s", text, why);
    }
}

static int tell_all_changes(const struct waiting *w, const struct cli *cli, struct apc_store *store)
{
    const struct operation *o = w->operation;
    bool one = o->group && operate_is_one(o);
    int rc = EXIT_OK;
    for (size_t i = 1; i < o->n; i++)
        one &= o->change[i].outcome == o->change[0].outcome;
    if (one)
        return tell_change(w, cli, store, 0, o->group);
    for (size_t i = 0; i < o->n; i++) {
        int told = tell_change(w, cli, store, i, NULL);
        rc = told > rc ? told : rc;
    }
    return rc;
}

int outcome_await(struct waiting *w, const struct cli *cli, struct apc_store *store)
{
    const apc_ns until = apc_clock_mono(NULL) + w->patience;
    for (;;) {
        int rc = read_ticks(w, store);
        const apc_ns left = until - apc_clock_mono(NULL);
        if (rc >= 0 && (settle_changes(w) || left <= 0))
            return tell_all_changes(w, cli, store);
        if (rc >= 0)
            rc = apc_store_wait(store, w->actual, w->operation->n, left < APC_NS_PER_S ? left : APC_NS_PER_S);
        if (rc < 0)
            return cli_error(cli, rc, "written, but what became of it is not known: %s",
                             apc_store_error(store));
    }
}
