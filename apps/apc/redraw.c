/* SPDX-License-Identifier: BSD-3-Clause */
#include <sys/stat.h>
#include <unistd.h>

#include "cli.h"
#include "common/experiment.h"
#include "common/storeuri.h"
#include "folder.h"
#include "provision.h"
#include "report.h"
#include "spools.h"

static const struct cli_spec spec = {
    .args_doc = "DIR",
    .doc =
        "Draw report.svg and report.png of the run folder DIR again, from its samples.csv and timing.csv. Of "
        "a run that was killed, and so has left none, they are first taken from its store: DIR/store.db or, "
        "where there is none, that of --store or APC_STORE.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .min_args = 1,
    .max_args = 1,
};

/* What the daemons could not store belongs to it as well, as at the end of a run. */
static int recover_from(const struct cli *cli, struct apc_store *store, const struct experiment *e,
                        struct apc_error *why)
{
    const char *dir = cli->args[0];
    char differs[PROVISION_TEXT];
    int rc = provision_check(store, e, differs);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_EPERM ? differs : apc_store_error(store));
    rc = spools_drain(dir, cli->store, cli->timeout, why);
    if (rc < 0 && rc != APC_EPROTO)
        return rc;
    apc_ns until = e->duration > 0 ? e->start + (apc_ns)(e->duration * 1e9) : 0;
    int err = folder_export(dir, store, e, e->start, 0, e->start, until, why);
    return err < 0 ? err : rc;
}

/* The record of a run that came to no end is in its store. */
static int recover(struct cli *cli, const struct experiment *e, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = cli->timeout};
    char path[600], uri[620];
    struct apc_store *store;

    snprintf(path, sizeof path, "%.580s/store.db", cli->args[0]);
    snprintf(uri, sizeof uri, "sqlite:%s", path);
    if (access(path, F_OK) == 0)
        cli->store = uri;
    if (!e->start || !cli->store)
        return apc_fail(
            why, APC_ENOTFOUND, "%.300s/samples.csv: there is none, %s", cli->args[0],
            e->start ? "nor a store.db: name the store of this run with --store"
                     : "and no record.conf says when the run began: apc history shows what is in its store");
    int rc = store_open(&store, cli->store, &options, why);
    if (rc == 0)
        rc = recover_from(cli, store, e, why);
    if (rc == 0)
        printf("samples: %s/samples.csv, from the store\n", cli->args[0]);
    apc_store_close(store);
    return rc;
}

int command_report(int argc, char **argv)
{
    struct cli cli;
    struct experiment e;
    struct apc_error why;
    char path[600];

    umask(077);
    cli_parse(&cli, &spec, NULL, argc, argv);
    int rc = experiment_load(&e, cli.args[0], EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why);
    snprintf(path, sizeof path, "%.580s/samples.csv", cli.args[0]);
    if (rc == 0 && access(path, F_OK) != 0)
        rc = recover(&cli, &e, &why);
    if (rc == 0)
        rc = report_write(cli.args[0], e.title, &why);
    experiment_free(&e);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    printf("report: %s/report.png, report.svg\n", cli.args[0]);
    return EXIT_OK;
}
