/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <math.h>
#include <pwd.h>
#include <stdlib.h>
#include <unistd.h>

#include "outcome.h"
#include "print.h"

int operate_check(const struct cli *cli, const struct change *c)
{
    char value[PRINT_LEN], low[PRINT_LEN], high[PRINT_LEN];
    const struct apc_tag *tag = c->tag;
    double v = c->after.value;

    if (fabs(v) < APC_VALUE_MAX && v >= tag->low && v <= tag->high)
        return EXIT_OK;
    print_exact(v, value);
    print_exact(tag->low, low);
    print_exact(tag->high, high);
    if (tag->low > -APC_VALUE_MAX && tag->high < APC_VALUE_MAX)
        return cli_error(cli, APC_ERANGE, "%s = %s lies outside its limits %s to %s", c->name, value, low,
                         high);
    if (v > 0)
        return cli_error(cli, APC_ERANGE, "%s = %s lies above its limit %s", c->name, value, high);
    return cli_error(cli, APC_ERANGE, "%s = %s lies below its limit %s", c->name, value, low);
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

/* Who is at the terminal, not as whom: a name that su and sudo keep. */
static void operator_name(char *name, size_t size)
{
    const char *login = getlogin();
    const struct passwd *user = login ? NULL : getpwuid(getuid());
    if (login || user)
        snprintf(name, size, "%s", login ? login : user->pw_name);
    else
        snprintf(name, size, "uid %u", (unsigned)getuid());
}

/* Modes by their names; none where there was no value yet. */
static char *in_words(const struct apc_sample *s, bool there, char text[PRINT_LEN])
{
    if (!there)
        snprintf(text, PRINT_LEN, "none");
    else if (s->table == APC_OPMODE)
        print_value(s, text);
    else
        print_exact(s->value, text);
    return text;
}

void operate_describe(const struct change *c, char *text, size_t size)
{
    char before[PRINT_LEN], after[PRINT_LEN];
    snprintf(text, size, "%s: %.40s -> %.40s", c->name, in_words(&c->before, c->before.seq > 0, before),
             in_words(&c->after, true, after));
}

static int write_changes(struct apc_store *store, struct change *changes, size_t n, apc_ns now)
{
    struct apc_sample *samples = calloc(n + 1, sizeof *samples);
    if (!samples)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        samples[i] = changes[i].after;
        samples[i].time = now;
        samples[i].status = APC_GOOD;
    }
    int rc = apc_store_put(store, samples, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        changes[i].after = samples[i];
    free(samples);
    return rc;
}

static int record(struct apc_store *store, const struct change *changes, size_t n, apc_ns now)
{
    struct apc_event *events = calloc(n + 1, sizeof *events);
    if (!events)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        struct apc_event *event = &events[i];
        *event = (struct apc_event){.time = now, .severity = APC_EVENT_INFO, .kind = "operator"};
        operator_name(event->source, sizeof event->source);
        operate_describe(&changes[i], event->text, sizeof event->text);
    }
    int rc = apc_store_append_events(store, events, n);
    free(events);
    return rc;
}

static int write_and_record(const struct cli *cli, struct apc_store *store, struct change *changes, size_t n)
{
    apc_ns now = apc_clock_utc(NULL);
    int rc = write_changes(store, changes, n, now);

    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return cli_error(cli, rc, "the store did not answer, so whether it was written is not known: %s",
                         apc_store_error(store));
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    rc = record(store, changes, n, now);
    if (rc < 0)
        return cli_error(cli, rc, "the change was made, but not recorded as an event: %s",
                         apc_store_error(store));
    return EXIT_OK;
}

int operate(const struct cli *cli, struct apc_store *store, struct change *changes, size_t n)
{
    struct outcome outcome = {0};
    char text[192];
    int rc = cli->no_wait ? EXIT_OK : outcome_prepare(&outcome, cli, store);

    if (rc == EXIT_OK)
        rc = write_and_record(cli, store, changes, n);
    if (rc == EXIT_OK && !cli->no_wait)
        rc = outcome_await(&outcome, cli, store, changes, n);
    for (size_t i = 0; i < n && rc == EXIT_OK && cli->no_wait; i++) {
        operate_describe(&changes[i], text, sizeof text);
        print_clean(stdout, text);
        putchar('\n');
    }
    outcome_free(&outcome);
    return rc;
}
