/* SPDX-License-Identifier: BSD-3-Clause */
/* Before the daemons of `apc run` start: its folder, its stores, whose they are. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/folder/folder.h"
#include "common/storeuri.h"
#include "run.h"
#include "simulation/simulation.h"

/* It may be described anew when it is this experiment's. */
static int check_store(struct run *r, struct apc_store *store, const char *uri)
{
    char why[PROVISION_TEXT], name[400];
    int rc = provision_check(store, &r->e, why);
    store_name(uri, name, sizeof name);
    if (rc == APC_EPERM)
        cli_error(&r->cli, rc, "the store %s cannot be taken: %s; give another --%s%s", name, why,
                  uri == r->history ? "history" : "store",
                  r->own_history[0] && uri == r->history
                      ? " or --out"
                      : ", or make it this experiment's with `apc init --force FILE`");
    else if (rc < 0)
        cli_store_error(&r->cli, rc, store);
    else if (uri != r->history && cli_live(&r->cli, store) != EXIT_OK)
        return APC_EPERM;
    return rc;
}

/* Is anybody running this plant? Then nothing of it may be touched. */
static int claim_all(const struct run *r, struct apc_store *guard)
{
    const struct {
        enum apc_table table;
        size_t n;
    } of[] = {{APC_SENSOR, r->e.dim.ny + r->e.n_signals},
              {APC_ACTUATOR, r->e.dim.nu},
              {APC_SETPOINT, r->e.dim.nz},
              {APC_TICK, r->e.n_controllers}};
    size_t n = 0;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        n += of[i].n;
    struct apc_sample *all = calloc(n, sizeof *all), *at = all;
    for (size_t i = 0; all && i < sizeof of / sizeof *of; i++)
        for (size_t k = 0; k < of[i].n; k++)
            *at++ = (struct apc_sample){.table = of[i].table, .id = (int)k + 1};
    int rc = all ? apc_store_claim_set(guard, all, n) : APC_ENOMEM;
    free(all);
    if (rc < 0)
        cli_store_error(&r->cli, rc, guard);
    return rc;
}

static void remove_own_history(const struct run *r)
{
    static const char *const names[] = {"store.db", "store.db-journal", "store.db-claims"};
    char path[sizeof r->dir + 32];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        snprintf(path, sizeof path, "%s/%s", r->dir, names[i]);
        remove(path);
    }
}

/* The times of a simulated run are those of any other one: it keeps nothing of the run whose place it takes. */
static int renew_history(struct run *r, struct cli *cli, struct apc_store **history)
{
    apc_store_close(*history);
    remove_own_history(r);
    int rc = cli_open(cli, history);
    if (rc >= 0 && ((rc = cli_init(cli, *history)) < 0))
        cli_store_error(cli, rc, *history);
    return rc < 0 ? rc : claim_all(r, *history);
}

/* The history, when it is there, is this experiment's and nobody's at the moment, and the live store goes on
 * from it. */
static int prepare_history(struct run *r)
{
    struct apc_store *history = NULL;
    struct cli cli = r->cli;
    struct apc_error why;
    cli.store = r->history;
    int rc = cli_open(&cli, &history);
    if (rc < 0)
        return rc;
    rc = cli_init(&cli, history);
    if (!r->own_history[0] && (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EFULL)) {
        fprintf(stderr, "the history is offline: %s; the record is kept in memory until it comes\n",
                apc_store_error(history));
        (void)apc_store_take_over(r->store, history, &why); /* numbers that lie above its */
        rc = 0;
    } else if (rc < 0) {
        cli_store_error(&cli, rc, history);
    } else if ((rc = claim_all(r, history)) >= 0 &&
               (!r->options.pace || r->made_store || (rc = renew_history(r, &cli, &history)) >= 0) &&
               (rc = check_store(r, history, cli.store)) == 0 &&
               (rc = apc_store_take_over(r->store, history, &why)) < 0) {
        cli_error(&cli, rc, "%s", why.text);
    }
    apc_store_close(history);
    return rc < 0 ? rc : 0;
}

/* Nobody is running the plant in this store. */
static int describe_run(struct run *r)
{
    int rc = check_store(r, r->store, r->cli.store);
    if (rc == 0 && r->history)
        rc = prepare_history(r);
    if (rc == 0 && (rc = provision(r->store, &r->e, PROVISION_RESET)) < 0)
        cli_store_error(&r->cli, rc, r->store);
    return rc;
}

/* As long as this process lives. */
static int claim_simulated(struct run *r)
{
    int64_t last;
    int rc = cli_open(&r->cli, &r->guard);
    if (rc == 0 && (rc = apc_store_claim(r->guard, APC_SENSOR, 1, &last)) < 0)
        cli_store_error(&r->cli, rc, r->guard);
    return rc;
}

/* As fast as it goes to where people go on. */
static double run_speed(const struct run *r)
{
    return r->options.from > 0 ? HUGE_VAL : r->options.speed;
}

int run_prepare_store(struct run *r)
{
    struct apc_store *guard = NULL;
    struct apc_error why;
    int rc = cli_open(&r->cli, &r->store);
    if (rc < 0)
        return rc;
    rc = cli_init(&r->cli, r->store);
    if (rc < 0) {
        cli_store_error(&r->cli, rc, r->store);
        return rc;
    }
    if (r->options.pace && ((rc = apc_store_end_tick(r->store, SIMULATION_BEGIN, -1)) < 0 ||
                            (rc = apc_store_set_speed(r->store, run_speed(r), 0)) < 0 ||
                            (rc = apc_store_follow(r->store)) < 0)) {
        cli_store_error(&r->cli, rc, r->store);
        return rc;
    }
    rc = cli_open(&r->cli, &guard);
    if (rc >= 0)
        rc = claim_all(r, guard);
    if (rc >= 0)
        rc = describe_run(r);
    if (rc >= 0 && r->segment.uri[0] && (rc = segment_own(&r->segment, r->dir, &why)) < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    apc_store_close(guard);
    if (rc >= 0 && r->options.pace)
        rc = claim_simulated(r);
    apc_store_close(r->store); /* while it runs, other processes use it */
    r->store = NULL;
    return rc;
}

int run_prepare_folder(struct run *r)
{
    struct apc_error why;
    if (r->options.out && strlen(r->options.out) >= sizeof r->dir) {
        cli_error(&r->cli, APC_EINVAL, "--out: the path is too long");
        return APC_EINVAL;
    }
    int rc = 0;
    if (r->options.out)
        snprintf(r->dir, sizeof r->dir, "%s", r->options.out);
    else
        rc = folder_choose(r->dir, sizeof r->dir, r->e.name, &why);
    if (rc == 0)
        rc = folder_create(r->dir, &r->e, r->options.force, &why);
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}

/* With a path that holds in any folder. */
int run_join_stores(struct run *r)
{
    const char *history = r->options.history;
    char here[PATH_MAX] = "";
    if (!history)
        return 0;
    const bool relative =
        !strncmp(history, "sqlite:", strlen("sqlite:")) && history[strlen("sqlite:")] != '/';
    if (relative && !getcwd(here, sizeof here))
        return cli_error(&r->cli, APC_ESYS, "the current folder cannot be found: %s", strerror(errno)),
               APC_ESYS;
    const size_t live = strcspn(r->cli.store, "?");
    if (asprintf(&r->both, "%.*s+%s%s%s%s", (int)live, r->cli.store, relative ? "sqlite:" : "", here,
                 relative ? "/" : "", relative ? history + strlen("sqlite:") : history) < 0) {
        r->both = NULL;
        return cli_error(&r->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    }
    r->history = r->both + live + 1;
    return 0;
}

const char *run_store(const struct run *r)
{
    return r->both && r->both[apc_store_live(r->both)] ? r->both : r->cli.store;
}

/* Every program then gets it from the environment. */
int run_embed_store(struct run *r)
{
    struct apc_error why;
    const int rc = segment_plan(&r->segment, &r->e, &why);
    if (rc < 0) {
        cli_error(&r->cli, rc, "%s", why.text);
        return rc;
    }
    r->cli.store = r->segment.uri;
    if (r->options.history)
        return 0;
    char dir[PATH_MAX];
    if (!realpath(r->dir, dir)) {
        cli_error(&r->cli, APC_ESYS, "%s: %s", r->dir, strerror(errno));
        return APC_ESYS;
    }
    const int scheme = snprintf(r->own_history, sizeof r->own_history, "sqlite:");
    snprintf(r->own_history + scheme, sizeof r->own_history - (size_t)scheme, "%s/store.db", dir);
    r->made_store = access(r->own_history + scheme, F_OK) != 0;
    r->options.history = r->own_history;
    return 0;
}

void run_discard(const struct run *r)
{
    if (r->made_store)
        remove_own_history(r);
    segment_remove(&r->segment);
    folder_discard(r->dir, &r->e);
}

static struct folder_metadata metadata_of(struct run *r)
{
    store_name(r->record, r->store_name, sizeof r->store_name);
    snprintf(r->live_name, sizeof r->live_name, "%.*s", (int)strcspn(r->cli.store, "?"), r->cli.store);
    gethostname(r->host, sizeof r->host - 1);
    return (struct folder_metadata){.by = "apc run",
                                    .timer = r->options.pace    ? "virtual"
                                             : r->options.timer ? r->options.timer
                                                                : "deadline",
                                    .store = r->store_name,
                                    .live = r->history ? r->live_name : NULL,
                                    .host = r->host,
                                    .start = r->start};
}

/* The daemons load run.conf there, and with it the record and the plug-ins: what they run is what is kept. */
int run_keep_folder(struct run *r)
{
    struct apc_error why;
    r->start = r->options.pace ? SIMULATION_BEGIN : apc_clock_utc(NULL); /* until the daemons are there */
    snprintf(r->config, sizeof r->config, "%s/run.conf", r->dir);
    const struct folder_metadata metadata = metadata_of(r);
    int rc = folder_keep(r->dir, &r->e, &metadata, &why);
    snprintf(r->e.past_dir, sizeof r->e.past_dir, "%.500s/" PAST_FOLDER, r->dir);
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}
