/* SPDX-License-Identifier: BSD-3-Clause */
#include "apc/common/cli.h"
#include "apc/common/experiment_warnings.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"

static const struct option_spec own_options[] = {
    {"force", 'f', NULL, "Describe FILE even in a store of another experiment", OPTION_FLAG, .to = 0},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[FILE]",
    .doc = "Make the tables of the shared data, or bring those of an older version up to date. With an "
           "experiment FILE, also describe its variables and write its dimensions, and its tuning and mode "
           "where there are none yet. It may be run again at any time. It refuses a store of another "
           "experiment. A new live store of LIVE+HISTORY, as after a reboot, continues where the history "
           "ends: tuning, modes, setpoints and the controllers' states.",
    .takes = CLI_STORE | CLI_MAKES_STORE,
    .max_args = 1,
    .options = own_options,
};

static int init_store(const struct cli *cli, struct apc_store *store)
{
    int had = cli_init(cli, store);
    if (had < 0)
        return cli_store_error(cli, had, store);
    if (had > apc_store_version())
        printf("tables are of version %d, newer than this program's (%d), which works with them\n", had,
               apc_store_version());
    else if (had == apc_store_version())
        printf("tables are up to date (version %d, with all repairs)\n", had);
    else if (had == 0)
        printf("tables made (version %d)\n", apc_store_version());
    return EXIT_OK;
}

static int describe_in_store(const struct cli *cli, struct apc_store *store, const struct experiment *e,
                             bool force)
{
    char why[PROVISION_TEXT];
    int rc = cli_live(cli, store);
    if (rc != EXIT_OK)
        return rc;
    if (!force)
        rc = provision_check(store, e, why);
    if (rc == APC_EPERM)
        return cli_error(cli, rc, "the store is not described: %s; --force makes it this experiment's", why);
    if (rc < 0 || (rc = provision(store, e, PROVISION_KEEP)) < 0)
        return cli_store_error(cli, rc, store);
    printf("experiment %s described\n", e->name);
    return EXIT_OK;
}

static bool is_away(int rc)
{
    return rc == APC_ECONN || rc == APC_ETIMEDOUT;
}

/* A live store that is new, as after the host was started again, goes on where its history ends. */
static int take_over(const struct cli *cli, const struct experiment *e)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = cli->timeout};
    struct apc_store *live = NULL, *history = NULL;
    char room[256], differs[PROVISION_TEXT];
    struct apc_error why;
    int rc = store_open(&live, store_live(cli->store, room), &options, &why);
    if (rc == 0)
        rc = store_open(&history, cli->store + apc_store_live(cli->store) + 1, &options, &why);
    if (rc == 0 && e->n_controllers > 0 && provision_check(history, e, differs) == APC_EPERM)
        rc = apc_fail(&why, APC_EPERM, "the history: %s", differs);
    if (rc == 0)
        rc = apc_store_take_over(live, history, &why);
    if (rc > 0)
        printf("variables that go on from the history: %d\n", rc);
    if (is_away(rc))
        printf("%s: the live store begins empty, with numbers above its\n", why.text);
    apc_store_close(history);
    apc_store_close(live);
    return rc < 0 && !is_away(rc) && rc != APC_ESCHEMA ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

int command_init(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct experiment e = {0};
    struct apc_error why;
    struct cli cli;
    bool force = false;
    int rc;

    cli_parse(&cli, &spec, &force, argc, argv);
    if (cli.n_args > 0 && (rc = experiment_load(&e, cli.args[0], EXPERIMENT_LAW, NULL, &why)) < 0)
        return cli_error(&cli, rc, "%s", why.text);
    if (cli.n_args > 0)
        warn(&cli, &e);
    rc = cli_open(&cli, &store);
    if (rc < 0) {
        rc = exit_code_of(rc);
        goto out;
    }
    rc = init_store(&cli, store);
    if (rc == EXIT_OK && cli.store[apc_store_live(cli.store)])
        rc = take_over(&cli, &e);
    if (rc == EXIT_OK && cli.n_args > 0)
        rc = describe_in_store(&cli, store, &e, force);
out:
    apc_store_close(store);
    experiment_free(&e);
    return rc;
}
