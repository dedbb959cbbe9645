/* SPDX-License-Identifier: BSD-3-Clause */
#include "outcome.h"

#include <stdlib.h>
#include <string.h>

#include "print.h"

#define GRACE       (2 * APC_NS_PER_S) /* beyond three ticks */
#define LOOK        16                 /* ticks that the period is seen from */
#define TICKS       1000               /* at most so many are searched for an output */
#define EVENT_DELAY (APC_NS_PER_S / 2) /* by which an event may come after its tick */

/* ---- Ticks -------------------------------------------------------------------------------- */

struct ticks {
    struct apc_sample newest;
    apc_ns period; /* the shortest of late; 0: not known */
};

static int take_tick(void *ctx, const struct apc_sample *s)
{
    struct ticks *t = ctx;
    apc_ns apart = s->time - t->newest.time;
    if (t->newest.seq > 0 && apart > 0 && (t->period == 0 || apart < t->period))
        t->period = apart;
    t->newest = *s;
    return 0;
}

static int take_stop(void *ctx, const struct apc_event *event)
{
    bool *stopped = ctx;
    *stopped |= !strcmp(event->kind, "stop") && !strcmp(event->source, "apc-controller");
    return 0;
}

/* Does it tick, as far as its last tick and its events say? */
static bool ticks_now(struct apc_store *store, const struct ticks *t, apc_ns patience)
{
    const struct apc_range since = {.since = t->newest.time};
    apc_ns ago = apc_clock_utc(NULL) - t->newest.time;
    bool stopped = false;
    return t->newest.seq > 0 && ago >= 0 && ago <= patience &&
           apc_store_events(store, &since, take_stop, &stopped) >= 0 && !stopped;
}

/* An age by the clocks of two hosts is no proof that nothing ticks: then a tick is waited for. */
static int look_for_ticks(struct outcome *o, const struct cli *cli, struct apc_store *store)
{
    const struct apc_range last = {.last = LOOK};
    struct ticks ticks = {.newest = {.table = APC_ACTUATOR, .id = 1}};
    char age[PRINT_LEN];
    int rc = apc_store_history(store, APC_ACTUATOR, 1, &last, take_tick, &ticks);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    o->patience = 3 * ticks.period + GRACE;
    if (ticks_now(store, &ticks, o->patience))
        return EXIT_OK;
    rc = apc_store_wait(store, &ticks.newest, 1, o->patience);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    if (rc > 0)
        return EXIT_OK;
    if (ticks.newest.seq == 0)
        return cli_error(cli, APC_EPERM,
                         "nobody applies it: no controller has ticked in this store. Nothing was written; "
                         "--no-wait does in any case");
    return cli_error(
        cli, APC_EPERM,
        "nobody applies it: the controller's last tick was %s ago. Nothing was written; --no-wait "
        "does in any case",
        print_age(apc_clock_utc(NULL) - ticks.newest.time, age));
}

/* ---- What there is to look at ------------------------------------------------------------- */

static bool is_operators(const struct apc_tag *tag)
{
    return tag->table == APC_SETPOINT || tag->table == APC_TUNING || tag->table == APC_MANUAL ||
           (tag->table == APC_OPMODE && tag->id == 0);
}

static int gather(struct outcome *o, const struct cli *cli)
{
    int loop = 0; /* measurements, setpoints, outputs: what stands before the sum in the controller's state */
    o->row = calloc(2 * o->tags.n + 2, sizeof *o->row);
    if (!o->row)
        return cli_error(cli, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < o->tags.n; i++) {
        const struct apc_tag *tag = &o->tags.tag[i];
        loop += tag->table == APC_SENSOR || tag->table == APC_SETPOINT || tag->table == APC_ACTUATOR;
        if (is_operators(tag))
            o->row[o->n++] = (struct apc_sample){.table = tag->table, .id = tag->id};
    }
    o->operators = o->taken = o->n;
    o->row[o->n++] = (struct apc_sample){.table = APC_STATE, .id = 1 + loop};
    o->row[o->n++] = (struct apc_sample){.table = APC_OPMODE, .id = 1};
    for (size_t i = 0; i < o->tags.n; i++)
        if (o->tags.tag[i].table == APC_ACTUATOR)
            o->row[o->n++] = (struct apc_sample){.table = APC_ACTUATOR, .id = o->tags.tag[i].id};
    return EXIT_OK;
}

int outcome_prepare(struct outcome *o, const struct cli *cli, struct apc_store *store)
{
    *o = (struct outcome){0};
    int rc = exit_code_of(cli_tags_load(cli, store, &o->tags));
    if (rc == EXIT_OK)
        rc = gather(o, cli);
    return rc == EXIT_OK ? look_for_ticks(o, cli, store) : rc;
}

void outcome_free(struct outcome *o)
{
    cli_tags_free(&o->tags);
    free(o->row);
}

/* ---- What became of it ---------------------------------------------------------------------- */

static double total(const struct outcome *o)
{
    double sum = 0;
    for (size_t i = 0; i < o->operators; i++)
        sum += (double)o->row[i].seq;
    return sum;
}

static const struct apc_sample *newest(const struct outcome *o, enum apc_table table, int id)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->row[i].table == table && o->row[i].id == id)
            return &o->row[i];
    return NULL;
}

struct search {
    const struct change *change;
    bool found;
};

static int look_at_output(void *ctx, const struct apc_sample *s)
{
    struct search *search = ctx;
    double wanted = search->change->after.value;
    search->found |= s->seq > search->change->before.seq && !(s->value < wanted) && !(s->value > wanted);
    return 0;
}

/* Did it go out, in a tick since? */
static bool went_out(struct apc_store *store, const struct change *c)
{
    const struct apc_range last = {.last = TICKS};
    struct search search = {.change = c};
    return apc_store_history(store, APC_ACTUATOR, c->after.id, &last, look_at_output, &search) >= 0 &&
           search.found;
}

struct refusal {
    apc_ns since;
    char text[192];
};

static int take_refusal(void *ctx, const struct apc_event *event)
{
    struct refusal *r = ctx;
    if (event->time >= r->since && !strcmp(event->kind, "rejected"))
        snprintf(r->text, sizeof r->text, "%s", event->text);
    return 0;
}

/* The controller counts what it refuses as looked at, and tells in an event, which comes a little later. */
static bool refused(struct apc_store *store, const struct change *c, struct refusal *r)
{
    const struct timespec pause = {0, 50 * APC_NS_PER_MS};
    const struct apc_range last = {.last = 50};
    apc_ns until = apc_clock_mono(NULL) + EVENT_DELAY;
    r->since = c->after.time;
    while (apc_store_events(store, &last, take_refusal, r) >= 0 && !r->text[0] &&
           apc_clock_mono(NULL) < until)
        nanosleep(&pause, NULL);
    return r->text[0];
}

enum verdict { APPLIED, SUPERSEDED, REFUSED };

/* Of a change that the controller has looked at, or one that came after it. */
static enum verdict judge(const struct outcome *o, struct apc_store *store, const struct change *c,
                          bool exactly, char *why, size_t size)
{
    const struct apc_sample *own = newest(o, c->after.table, c->after.id), *actual = &o->row[o->taken + 1];
    char value[PRINT_LEN];
    struct refusal refusal = {0};
    bool done = exactly || (own && own->seq == c->after.seq);

    if (c->after.table == APC_OPMODE)
        done = actual->seq > 0 && !(actual->value < c->after.value) && !(actual->value > c->after.value);
    else if (c->after.table == APC_MANUAL)
        done = went_out(store, c);
    else if (done && c->after.table == APC_TUNING && refused(store, c, &refusal)) {
        snprintf(why, size, "%s", refusal.text);
        return REFUSED;
    }
    if (done)
        return APPLIED;
    if (own && own->seq > c->after.seq) {
        snprintf(why, size, "it is %s now", print_value(own, value));
        return SUPERSEDED;
    }
    snprintf(why, size, "the controller is in %s", actual->seq > 0 ? print_value(actual, value) : "no mode");
    return REFUSED;
}

static int tell(const struct outcome *o, const struct cli *cli, struct apc_store *store,
                const struct change *changes, size_t n, double wanted)
{
    static const char *const words[] = {"applied", "superseded", "refused"};
    char text[192], why[192] = "";
    int rc = EXIT_OK;
    for (size_t i = 0; i < n; i++) {
        /* The sum of when this change was the newest, and no more: it was this one that was taken. */
        bool exactly = changes[i].newest && !(o->row[o->taken].value > wanted);
        enum verdict verdict = judge(o, store, &changes[i], exactly, why, sizeof why);
        operate_describe(&changes[i], text, sizeof text);
        if (verdict != APPLIED) {
            rc = cli_error(cli, APC_EPERM, "%s: %s: %s", text, words[verdict], why);
            continue;
        }
        print_clean(stdout, text);
        puts(" (applied)");
    }
    return rc;
}

/* Written it is; that it is in force nobody says. */
static int tell_unconfirmed(const struct outcome *o, const struct cli *cli, int64_t ticks)
{
    const struct apc_sample *u = newest(o, APC_ACTUATOR, 1);
    char age[PRINT_LEN], status[APC_STATUS_NAME_LEN];
    print_age(apc_clock_utc(NULL) - (u ? u->time : 0), age);
    if (!u || u->seq == ticks)
        return cli_error(cli, APC_ETIMEDOUT,
                         "written, but nobody applies it: the controller's last tick was %s ago", age);
    if (apc_status_severity(u->status) != APC_SEVERITY_GOOD)
        return cli_error(cli, APC_ETIMEDOUT, "written, but not applied yet: the output is %s; see apc status",
                         apc_status_format(u->status, status));
    return cli_error(cli, APC_ETIMEDOUT, "written, but the controller does not confirm it: see apc status");
}

int outcome_await(struct outcome *o, const struct cli *cli, struct apc_store *store, struct change *changes,
                  size_t n)
{
    const apc_ns until = apc_clock_mono(NULL) + o->patience;
    double wanted = -1;
    int64_t ticks = 0;

    for (;;) {
        int rc = apc_store_read(store, o->row, o->n);
        if (rc < 0)
            return cli_error(cli, rc, "written, but what became of it is not known: %s",
                             apc_store_error(store));
        const struct apc_sample *taken = &o->row[o->taken], *u = newest(o, APC_ACTUATOR, 1);
        if (wanted < 0) {
            wanted = total(o);
            for (size_t i = 0; i < n; i++) {
                const struct apc_sample *own = newest(o, changes[i].after.table, changes[i].after.id);
                changes[i].newest = own && own->seq == changes[i].after.seq;
            }
            ticks = u ? u->seq : 0;
        }
        if (taken->seq > 0 && taken->value >= wanted)
            return tell(o, cli, store, changes, n, wanted);
        apc_ns left = until - apc_clock_mono(NULL);
        if (left <= 0)
            return tell_unconfirmed(o, cli, ticks);
        rc = apc_store_wait(store, &o->row[o->taken], o->n - o->taken, left);
        if (rc < 0)
            return cli_error(cli, rc, "written, but what became of it is not known: %s",
                             apc_store_error(store));
    }
}
