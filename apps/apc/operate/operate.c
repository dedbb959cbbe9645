/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "apc/common/print.h"
#include "apc/folder/runstore.h"
#include "common/storeuri.h"
#include "files/files.h"

#define PAUSE (50 * APC_NS_PER_MS) /* between two looks */

static void pause_for(apc_ns duration)
{
    const struct timespec time = {duration / APC_NS_PER_S, duration % APC_NS_PER_S};
    nanosleep(&time, NULL);
}

struct plant_view operate_view(const struct cli_plant *plant)
{
    return (struct plant_view){plant->tags.tag, plant->tags.n, &plant->loops};
}

int operate_fault(const struct cli *cli, const struct change_fault *why)
{
    return cli_error(cli, why->err, "%s", why->text);
}

int operate_find_any(const struct cli *cli, const struct plant_view *plant, const char *name, unsigned kinds,
                     struct change *c)
{
    struct change_target to;
    struct change_fault why;
    if (change_find(plant, name, kinds, &to, &why) < 0)
        return operate_fault(cli, &why);
    if (former_is(name, to.name))
        cli_former(cli, name, to.name);
    change_make(plant, &to, 0, c);
    return EXIT_OK;
}

int operate_find(const struct cli *cli, const struct plant_view *plant, const char *name, unsigned kinds,
                 double value, struct change *c)
{
    struct change_fault why;
    const int rc = operate_find_any(cli, plant, name, kinds, c);
    if (rc != EXIT_OK)
        return rc;
    c->after.value = value;
    return change_check(&c->to, value, &why) < 0 ? operate_fault(cli, &why) : EXIT_OK;
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

/* ---- Of a history alone ---------------------------------------------------------------------- */

#define PATIENCE (12 * APC_NS_PER_S) /* a request is good for ten */

static int await_answer(const struct cli *cli, struct apc_store *store, const struct change *c,
                        const struct apc_request *request)
{
    const apc_ns end = apc_clock_mono(NULL) + PATIENCE;
    char outcome[192], text[192];
    int rc;
    while ((rc = apc_store_asked(store, request->id, outcome, sizeof outcome)) == 0 &&
           apc_clock_mono(NULL) < end)
        pause_for(2 * PAUSE);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    if (rc == 0)
        return cli_error(cli, APC_ETIMEDOUT, "%s: nobody has answered request %lld: does apc-historian run?",
                         c->to.name, (long long)request->id);
    if (strcmp(outcome, "applied") != 0)
        return cli_error(cli, APC_EPERM, "%s: %s", c->to.name, outcome);
    print_clean(stdout, change_words(c, NULL, text, sizeof text));
    puts(" (applied)");
    return EXIT_OK;
}

/* What is written there nobody applies: its historian brings what is asked for to the loop. */
static int ask_history(const struct cli *cli, struct apc_store *store, const struct operation *o)
{
    int rc = EXIT_OK;
    for (size_t i = 0; i < o->n && rc == EXIT_OK; i++) {
        const struct change *c = &o->change[i];
        if (c->over > 0 || c->stop)
            return cli_error(cli, APC_EPERM, "%s: a history passes no ramp on: ask the live store",
                             c->to.name);
        struct apc_request request = {
            .table = c->after.table, .variable = c->after.id, .value = c->after.value};
        snprintf(request.author, sizeof request.author, "%.31s", o->author);
        snprintf(request.reason, sizeof request.reason, "%s", cli->reason ? cli->reason : "");
        const int asked = apc_store_ask(store, &request);
        if (asked < 0)
            return cli_store_error(cli, asked, store);
        if (cli->no_wait)
            printf("%s: request %lld\n", c->to.name, (long long)request.id);
        else
            rc = await_answer(cli, store, c, &request);
    }
    return rc;
}

/* ---- At the loop ----------------------------------------------------------------------------- */

static void show_change(const struct operation *o, size_t i, const char *group, const char *also)
{
    char text[192];
    print_clean(stdout, change_words(&o->change[i], group, text, sizeof text));
    puts(also);
}

static const char *group_of(const struct operation *o)
{
    return o->group && operation_is_one(o) ? o->group : NULL;
}

int operate_again(const struct cli *cli, struct apc_store **store, struct apc_store_clock *clock,
                  struct apc_error *why)
{
    const bool back = cli->stores && !runstore_gone(cli->stores);
    const char *uri = back ? cli->stores : cli->store;
    int rc;
    apc_store_close(*store);
    *store = NULL;
    rc = store_open(store, uri, NULL, why);
    return rc < 0 ? rc : store_simulated(*store, clock, why);
}

int operate_simulated(const struct cli *cli, struct apc_store **store, struct apc_store_clock *clock,
                      struct apc_error *why)
{
    const apc_ns began = apc_clock_mono(NULL);
    int rc = store_simulated(*store, clock, why);
    while (rc <= 0 && clock->reached >= 0 && apc_clock_mono(NULL) - began < APC_NS_PER_S) {
        pause_for(10 * APC_NS_PER_MS);
        rc = operate_again(cli, store, clock, why);
    }
    if (rc > 0 && cli->stores)
        (void)store_follow(cli->stores);
    return rc != 0 ? rc : apc_fail(why, APC_ESTATE, "the plant is not simulated: its time is real");
}

int operate_still(struct apc_store *store, struct apc_error *why)
{
    struct apc_store_clock clock;
    const int rc = store_simulated(store, &clock, why);
    return rc > 0 ? clock.asked == 0 && clock.steps == 0 : rc;
}

int operate_ready(const struct cli *cli, struct apc_store *store, struct operation *o)
{
    struct change_fault why;
    struct apc_error ended;
    int rc, still = 0;
    while ((rc = operation_ready(o, store, &why)) == 0 && (still = operate_still(store, &ended)) == 0)
        pause_for(PAUSE);
    if (rc == 0 && still < 0)
        return cli_error(cli, still, "%s", ended.text);
    if (rc >= 0)
        return EXIT_OK;
    return strcmp(why.code, "nobody") == 0
               ? cli_error(cli, rc, "%s; --no-wait writes it all the same", why.text)
               : cli_store_error(cli, rc, store);
}

/* What there is to say of change @p i, under this name. */
static int tell_change(const struct cli *cli, const struct operation *o, size_t i, const char *group)
{
    struct change_fault said;
    const struct change *c = &o->change[i];
    char text[192], value[PRINT_LEN];
    const int rc = operation_finish(o, i, &said);
    snprintf(text, sizeof text, loops_is_owner(&c->after) ? " (applied): it is %s now" : " (applied)",
             print_value(&c->actual, value));
    if (rc == 0)
        show_change(o, i, group, text);
    return rc == 0 ? EXIT_OK
                   : cli_error(cli, rc, "%s: %s%s", change_words(c, group, text, sizeof text), said.text,
                               rc == APC_ETIMEDOUT ? ": see apc status" : "");
}

static int tell_all_changes(const struct cli *cli, const struct operation *o)
{
    const char *group = group_of(o);
    int rc = EXIT_OK;
    for (size_t i = 1; i < o->n; i++)
        if (o->change[i].outcome != o->change[0].outcome)
            group = NULL;
    for (size_t i = 0; i < (group ? 1 : o->n); i++) {
        const int told = tell_change(cli, o, i, group);
        rc = told > rc ? told : rc;
    }
    return rc;
}

static void show_written(const struct operation *o, const char *also)
{
    const char *group = group_of(o);
    for (size_t i = 0; i < (group ? 1 : o->n); i++)
        show_change(o, i, group, also);
}

static int await_outcome(const struct cli *cli, struct apc_store *store, struct operation *o)
{
    struct apc_error ended;
    int rc, still = 0;
    while ((rc = operation_poll(o, store)) == 0 && (still = operate_still(store, &ended)) == 0 &&
           (rc = operation_wait(o, store, APC_NS_PER_S)) == 0)
        ;
    if (rc == 0 && still < 0)
        return cli_error(cli, still, "written, but %s", ended.text);
    if (rc == 0) {
        show_written(o, OPERATE_PAUSED);
        return EXIT_OK;
    }
    return rc < 0 ? cli_error(cli, rc, "written, but the outcome is not known: %s", apc_store_error(store))
                  : tell_all_changes(cli, o);
}

static int carry_out(const struct cli *cli, struct apc_store *store, struct operation *o)
{
    struct change_fault why;
    char text[APC_TAG_LEN + 32];
    int rc = cli->no_wait ? EXIT_OK : operate_ready(cli, store, o);
    if (rc != EXIT_OK)
        return rc;
    if (operation_begin(o, store, &why) < 0)
        return strcmp(why.code, "store") == 0     ? cli_store_error(cli, why.err, store)
               : strcmp(why.code, "confirm") == 0 ? cli_error(cli, why.err, "%s; --confirm does so", why.text)
                                                  : operate_fault(cli, &why);
    if (cli->no_wait)
        show_written(o, "");
    else
        rc = await_outcome(cli, store, o);
    for (size_t i = 0; i < o->with.n; i++)
        if (operation_taken(o, &o->with.at[i], text, sizeof text)) {
            print_clean(stdout, text);
            putchar('\n');
        }
    return rc;
}

int operate(const struct cli *cli, struct apc_store *store, struct operation *o)
{
    char who[APC_AUTHOR_LEN];
    const int history = apc_store_is_history(store);
    const int read = history < 0 ? history : operation_read(o, store);
    if (read < 0)
        return cli_store_error(cli, read, store);
    operate_who(who, sizeof who);
    o->author = who;
    o->reason = cli->reason;
    const int rc = history ? ask_history(cli, store, o) : carry_out(cli, store, o);
    operation_end(o);
    return rc;
}
