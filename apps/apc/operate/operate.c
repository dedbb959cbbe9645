/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "apc/common/print.h"
#include "operate/operate.h"
#include "outcome.h"

struct plant_view operate_view(const struct cli_plant *plant)
{
    return (struct plant_view){plant->tags.tag, plant->tags.n, &plant->loops};
}

int operate_fault(const struct cli *cli, const struct change_fault *why)
{
    return cli_error(cli, why->err, "%s", why->text);
}

int operate_find(const struct cli *cli, const struct cli_plant *plant, const char *name, unsigned kinds,
                 struct change *c)
{
    const struct plant_view view = operate_view(plant);
    struct change_fault why;
    if (change_find(&view, name, kinds, &c->to, &why) < 0 || change_check(&c->to, c->after.value, &why) < 0)
        return operate_fault(cli, &why);
    snprintf(c->name, sizeof c->name, "%s", c->to.name);
    c->after.table = c->to.table;
    c->after.id = c->to.id;
    c->before = c->to.table == APC_MANUAL
                    ? (struct apc_sample){.table = c->to.loop->table, .id = c->to.loop->output}
                    : (struct apc_sample){.table = c->to.table, .id = c->to.id};
    return EXIT_OK;
}

int operate_read(struct apc_store *store, struct change *changes, size_t n)
{
    struct apc_sample *samples = calloc(n + 1, sizeof *samples);
    if (!samples)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++)
        samples[i] = changes[i].before;
    int rc = apc_store_read(store, samples, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        changes[i].before = samples[i];
    free(samples);
    return rc;
}

void operate_who(char *name, size_t size)
{
    const char *login = getlogin();
    const struct passwd *user = login ? NULL : getpwuid(getuid());
    if (login || user)
        snprintf(name, size, "%s", login ? login : user->pw_name);
    else
        snprintf(name, size, "uid %u", (unsigned)getuid());
}

void operate_describe(const struct change *c, const char *name, char *text, size_t size)
{
    char before[CHANGE_TEXT], after[CHANGE_TEXT];
    struct apc_sample to = c->after;
    to.seq = 1;
    snprintf(text, size, "%s: %s -> %s", name ? name : c->name, change_text(&c->before, before),
             change_text(&to, after));
}

bool operate_is_one(const struct operation *o)
{
    for (size_t i = 1; i < o->n; i++)
        if (o->change[i].before.value != o->change[0].before.value ||
            (o->change[i].before.seq > 0) != (o->change[0].before.seq > 0))
            return false;
    return true;
}

/* ---- Writing ------------------------------------------------------------------------------ */

/* All modes of the plant are written as one, as the paper knows it. */
static bool is_all(const struct operation *o)
{
    return o->group && o->n == o->plant->loops.n;
}

/* Which rows the mode of all has become: the newest, unless somebody else was faster with another mode. */
static int find_rows(struct apc_store *store, const struct operation *o)
{
    struct apc_sample *rows = calloc(o->n + 1, sizeof *rows);
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < o->n; i++)
        rows[i] = (struct apc_sample){.table = APC_OPMODE, .id = o->change[i].after.id};
    int rc = apc_store_read(store, rows, o->n);
    for (size_t i = 0; i < o->n && rc >= 0; i++) {
        const double wanted = o->change[i].after.value;
        o->change[i].after.seq = rows[i].seq - (rows[i].value < wanted || rows[i].value > wanted);
    }
    free(rows);
    return rc;
}

static int write_changes(struct apc_store *store, const struct operation *o, apc_ns now,
                         struct owner_rows *with)
{
    const size_t n = is_all(o) ? 1 : o->n;
    struct apc_sample *samples = calloc(n + 1, sizeof *samples);
    if (!samples)
        return APC_ENOMEM;
    for (size_t i = 0; i < o->n; i++) {
        o->change[i].after.time = now;
        o->change[i].after.status = APC_GOOD;
        o->change[i].after.seq = APC_SEQ_ANY;
        samples[is_all(o) ? 0 : i] = o->change[i].after;
    }
    if (is_all(o))
        samples[0].id = 0;
    char name[APC_AUTHOR_LEN];
    operate_who(name, sizeof name);
    int rc = apc_store_author(store, name);
    for (size_t i = 0; i < n && rc >= 0; i++)
        samples[i].author = (uint32_t)rc;
    if (rc >= 0)
        rc = owner_put(store, &o->plant->loops, samples, n, with);
    for (size_t i = 0; i < n && rc >= 0; i++)
        o->change[i].after.seq = samples[i].seq;
    free(samples);
    return rc >= 0 && is_all(o) ? find_rows(store, o) : rc;
}

static const char *taken_local(const struct operation *o, const struct apc_sample *owner, char *text,
                               size_t size)
{
    const struct apc_tag *tag = cli_tag(&o->plant->tags, APC_SETPOINT, loops_owned(&o->plant->loops, owner));
    snprintf(text, size, "%s taken Local, %s", tag ? tag->name : "setpoint",
             loops_is_owner(owner) ? "the scheduler stands aside" : "cascade open");
    return text;
}

static int record_operation(struct apc_store *store, const struct operation *o, const struct owner_rows *with,
                            apc_ns now)
{
    struct apc_event *events = calloc(o->n + with->n + 1, sizeof *events);
    size_t n = 0;
    if (!events)
        return APC_ENOMEM;
    for (size_t i = 0; i < (o->group && operate_is_one(o) ? 1 : o->n); i++)
        operate_describe(&o->change[i], o->group && operate_is_one(o) ? o->group : NULL, events[n++].text,
                         sizeof events->text);
    for (size_t i = 0; i < with->n; i++)
        if (with->at[i].table == APC_OPMODE)
            taken_local(o, &with->at[i], events[n++].text, sizeof events->text);
    for (size_t i = 0; i < n; i++) {
        events[i].time = now;
        events[i].severity = APC_EVENT_INFO;
        snprintf(events[i].kind, sizeof events->kind, "operator");
        operate_who(events[i].source, sizeof events->source);
    }
    int rc = apc_store_append_events(store, events, n);
    free(events);
    return rc;
}

static int write_and_record(const struct cli *cli, struct apc_store *store, const struct operation *o,
                            struct owner_rows *with)
{
    apc_ns now = apc_clock_utc(NULL);
    int rc = write_changes(store, o, now, with);

    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return cli_error(cli, rc, "the store did not answer, so whether it was written is not known: %s",
                         apc_store_error(store));
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    rc = record_operation(store, o, with, now);
    if (rc < 0)
        return cli_error(cli, rc, "the change was made, but not recorded as an event: %s",
                         apc_store_error(store));
    return EXIT_OK;
}

static void show_written(const struct operation *o)
{
    const bool one = o->group && operate_is_one(o);
    char text[192];
    for (size_t i = 0; i < (one ? 1 : o->n); i++) {
        operate_describe(&o->change[i], one ? o->group : NULL, text, sizeof text);
        print_clean(stdout, text);
        putchar('\n');
    }
}

/* ---- Of a history alone ---------------------------------------------------------------------- */

#define PATIENCE (12 * APC_NS_PER_S) /* a request is good for ten */

static int await_answer(const struct cli *cli, struct apc_store *store, const struct change *c,
                        const struct apc_request *request)
{
    static const struct timespec pause = {0, APC_NS_PER_S / 10};
    const apc_ns end = apc_clock_mono(NULL) + PATIENCE;
    char outcome[192], text[192];
    int rc;
    while ((rc = apc_store_asked(store, request->id, outcome, sizeof outcome)) == 0 &&
           apc_clock_mono(NULL) < end)
        nanosleep(&pause, NULL);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    if (rc == 0)
        return cli_error(cli, APC_ETIMEDOUT, "%s: nobody has answered request %lld: does apc-historian run?",
                         c->name, (long long)request->id);
    if (strcmp(outcome, "applied") != 0)
        return cli_error(cli, APC_EPERM, "%s: %s", c->name, outcome);
    operate_describe(c, NULL, text, sizeof text);
    print_clean(stdout, text);
    puts(" (applied)");
    return EXIT_OK;
}

/* What is written there nobody applies: its historian brings what is asked for to the loop. */
static int ask_history(const struct cli *cli, struct apc_store *store, const struct operation *o)
{
    int rc = EXIT_OK;
    for (size_t i = 0; i < o->n && rc == EXIT_OK; i++) {
        const struct change *c = &o->change[i];
        struct apc_request request = {
            .table = c->after.table, .variable = c->after.id, .value = c->after.value};
        operate_who(request.author, sizeof request.author);
        const int asked = apc_store_ask(store, &request);
        if (asked < 0)
            return cli_store_error(cli, asked, store);
        if (cli->no_wait)
            printf("%s: request %lld\n", c->name, (long long)request.id);
        else
            rc = await_answer(cli, store, c, &request);
    }
    return rc;
}

int operate(const struct cli *cli, struct apc_store *store, const struct operation *o)
{
    struct waiting waiting = {0};
    struct owner_rows with = {0};
    char text[APC_TAG_LEN + 32];
    const int history = apc_store_is_history(store);
    if (history != 0)
        return history < 0 ? cli_store_error(cli, history, store) : ask_history(cli, store, o);
    int rc = cli->no_wait ? EXIT_OK : outcome_prepare(&waiting, cli, store, o);

    if (rc == EXIT_OK)
        rc = write_and_record(cli, store, o, &with);
    if (rc == EXIT_OK && cli->no_wait)
        show_written(o);
    else if (rc == EXIT_OK)
        rc = outcome_await(&waiting, cli, store);
    for (size_t i = 0; i < with.n; i++)
        if (with.at[i].table == APC_OPMODE) {
            print_clean(stdout, taken_local(o, &with.at[i], text, sizeof text));
            putchar('\n');
        }
    free(with.at);
    outcome_free(&waiting);
    return rc;
}
