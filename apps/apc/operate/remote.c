/* SPDX-License-Identifier: BSD-3-Clause */
/* Setpoints that the scheduler moves, and an operator has taken, are given back to it. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "apc/common/print.h"
#include "operate.h"
#include "operate/operate.h"

#define PATIENCE (3 * APC_NS_PER_S) /* the scheduler looks four times a second */

struct remote {
    const struct cli *cli;
    struct apc_store *store;
    const struct cli_plant *plant;
    size_t n;
    struct apc_sample *owner, *setpoint; /* [n] newest */
    int64_t *given;                      /* [n] seq of the setpoint when it was given back */
};

static int look_at_setpoints(struct remote *r)
{
    struct apc_sample *rows = calloc(2 * r->n, sizeof *rows);
    if (!rows)
        return cli_error(r->cli, APC_ENOMEM, "out of memory");
    memcpy(rows, r->owner, r->n * sizeof *rows);
    memcpy(rows + r->n, r->setpoint, r->n * sizeof *rows);
    int rc = apc_store_read(r->store, rows, 2 * r->n);
    if (rc >= 0) {
        memcpy(r->owner, rows, r->n * sizeof *rows);
        memcpy(r->setpoint, rows + r->n, r->n * sizeof *rows);
    }
    free(rows);
    return rc < 0 ? cli_store_error(r->cli, rc, r->store) : EXIT_OK;
}

static const char *name_of_setpoint(const struct remote *r, size_t i)
{
    return cli_tag(&r->plant->tags, APC_SETPOINT, r->setpoint[i].id)->name;
}

static int record_remote(const struct remote *r, apc_ns now)
{
    struct apc_event *events = calloc(r->n, sizeof *events);
    if (!events)
        return APC_ENOMEM;
    for (size_t i = 0; i < r->n; i++) {
        events[i] = (struct apc_event){.time = now, .severity = APC_EVENT_INFO, .kind = "operator"};
        operate_who(events[i].source, sizeof events->source);
        snprintf(events[i].text, sizeof events->text, "%s: Local -> Remote", name_of_setpoint(r, i));
    }
    int rc = apc_store_append_events(r->store, events, r->n);
    free(events);
    return rc;
}

/* The switches, and with them the setpoints as they stand. */
static int give_to_scheduler(struct remote *r)
{
    struct apc_sample *rows = calloc(r->n, sizeof *rows);
    struct owner_rows with = {0};
    char name[APC_AUTHOR_LEN];
    const apc_ns now = apc_clock_utc(NULL);
    operate_who(name, sizeof name);
    int rc = rows ? apc_store_author(r->store, name) : APC_ENOMEM;
    for (size_t i = 0; i < r->n && rc >= 0; i++)
        rows[i] = (struct apc_sample){.table = APC_OPMODE,
                                      .id = r->owner[i].id,
                                      .seq = APC_SEQ_ANY,
                                      .time = now,
                                      .value = 1,
                                      .author = (uint32_t)rc};
    if (rc >= 0)
        rc = owner_put(r->store, &r->plant->loops, rows, r->n, &with);
    for (size_t i = 0; i < r->n; i++) {
        r->given[i] = 0;
        for (size_t k = 0; k < with.n; k++)
            if (with.at[k].table == APC_SETPOINT && with.at[k].id == r->setpoint[i].id)
                r->given[i] = with.at[k].seq;
    }
    free(with.at);
    free(rows);
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return cli_error(r->cli, rc, "the store did not answer, so whether it was written is not known: %s",
                         apc_store_error(r->store));
    if (rc < 0)
        return rc == APC_ENOMEM ? cli_error(r->cli, rc, "out of memory")
                                : cli_store_error(r->cli, rc, r->store);
    rc = record_remote(r, now);
    return rc < 0 ? cli_error(r->cli, rc, "the change was made, but not recorded as an event: %s",
                              apc_store_error(r->store))
                  : EXIT_OK;
}

/* The scheduler has written, or somebody took it again. */
static bool is_setpoint_settled(const struct remote *r, size_t i)
{
    return r->setpoint[i].seq > r->given[i] || loops_is_local(&r->owner[i]);
}

static int await_scheduler(struct remote *r)
{
    const apc_ns until = apc_clock_mono(NULL) + PATIENCE;
    for (;;) {
        size_t settled = 0;
        int rc = look_at_setpoints(r);
        for (size_t i = 0; i < r->n && rc == EXIT_OK; i++)
            settled += is_setpoint_settled(r, i);
        if (rc != EXIT_OK || settled == r->n || apc_clock_mono(NULL) > until)
            return rc;
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
    }
}

static int tell_setpoint(const struct remote *r, size_t i)
{
    char value[PRINT_LEN];
    if (loops_is_local(&r->owner[i]))
        return cli_error(r->cli, APC_EPERM, "%s: Local -> Remote: superseded: it is Local again",
                         name_of_setpoint(r, i));
    if (!is_setpoint_settled(r, i))
        return cli_error(r->cli, APC_ETIMEDOUT,
                         "%s: Local -> Remote: written, but no scheduler moves it: see apc status",
                         name_of_setpoint(r, i));
    print_clean(stdout, name_of_setpoint(r, i));
    printf(": Local -> Remote (applied): it is %s now\n", print_value(&r->setpoint[i], value));
    return EXIT_OK;
}

static int tell_all_setpoints(const struct remote *r)
{
    int rc = EXIT_OK;
    for (size_t i = 0; i < r->n; i++) {
        const int told = r->cli->no_wait ? EXIT_OK : tell_setpoint(r, i);
        rc = told > rc ? told : rc;
        if (r->cli->no_wait) {
            print_clean(stdout, name_of_setpoint(r, i));
            puts(": Local -> Remote");
        }
    }
    return rc;
}

static int change_to_remote(struct remote *r)
{
    size_t remote = 0;
    int rc = look_at_setpoints(r);
    for (size_t i = 0; i < r->n && rc == EXIT_OK; i++)
        remote += !loops_is_local(&r->owner[i]);
    if (rc == EXIT_OK && remote == r->n) {
        for (size_t i = 0; i < r->n; i++) {
            print_clean(stdout, name_of_setpoint(r, i));
            puts(": Remote already");
        }
        return EXIT_OK;
    }
    if (rc == EXIT_OK)
        rc = give_to_scheduler(r);
    if (rc == EXIT_OK && !r->cli->no_wait)
        rc = await_scheduler(r);
    if (rc == EXIT_OK)
        rc = tell_all_setpoints(r);
    return rc;
}

int operate_remote(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                   const int *setpoint, size_t n)
{
    struct remote r = {.cli = cli,
                       .store = store,
                       .plant = plant,
                       .n = n,
                       .owner = calloc(n, sizeof *r.owner),
                       .setpoint = calloc(n, sizeof *r.setpoint),
                       .given = calloc(n, sizeof *r.given)};
    const bool room = r.owner && r.setpoint && r.given;
    int rc = room ? cli_live(cli, store) : cli_error(cli, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n && room; i++) {
        r.owner[i] = (struct apc_sample){.table = APC_OPMODE, .id = LOOPS_OWNER(setpoint[i])};
        r.setpoint[i] = (struct apc_sample){.table = APC_SETPOINT, .id = setpoint[i]};
    }
    if (room && rc == EXIT_OK)
        rc = change_to_remote(&r);
    free(r.given);
    free(r.setpoint);
    free(r.owner);
    return rc;
}
