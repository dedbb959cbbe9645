/* SPDX-License-Identifier: BSD-3-Clause */
/* apc drain: what was left in a folder, by daemons whose store was away or by a run that was killed. */
#include "apc/common/cli.h"
#include "apc/folder/run_recovery.h"
#include "apc/folder/spools.h"

static const struct cli_spec spec = {
    .args_doc = "DIR",
    .doc =
        "Store the rows that are left in the folder DIR. Daemons keep rows in spools (*.spool) while the "
        "store is offline, and store them at their next start as well. Rows in the shared memory of a killed "
        "run go to its history, and the memory is freed. --store names the history if the folder does not.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .min_args = 1,
    .max_args = 1,
};

int command_drain(int argc, char **argv)
{
    struct apc_error why;
    struct cli cli;
    cli_parse(&cli, &spec, NULL, argc, argv);
    const char *store = cli.store ? cli.store : "postgresql:";
    int rc = recovery_of_killed_run(cli.args[0], store, cli.timeout, &why);
    if (rc == 0)
        rc = spools_drain(cli.args[0], store, cli.timeout, &why);
    return rc < 0 ? cli_error(&cli, rc, "%s", why.text) : EXIT_OK;
}
