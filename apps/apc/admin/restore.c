/* SPDX-License-Identifier: BSD-3-Clause */
/* apc restore: a backup in the place of a record that is a file. */
#include <string.h>

#include "apc/common/cli.h"

static const struct cli_spec spec = {
    .args_doc = "BACKUP STORE",
    .doc = "Replace the content of STORE, a file (sqlite:FILE) or the store of a run folder, by that of the "
           "file BACKUP, in one step. The former content is kept beside it, as FILE.replaced-TIME. Nobody "
           "may write to STORE meanwhile. Do not copy a file over it by hand: the FILE-journal of the former "
           "one may damage it. For a schema of PostgreSQL use pg_restore.",
    .min_args = 2,
    .max_args = 2,
};

static const char *file_of(const char *store)
{
    const size_t scheme = strlen("sqlite:");
    return strncmp(store, "sqlite:", scheme) ? store : store + scheme;
}

int command_restore(int argc, char **argv)
{
    struct cli cli;
    struct apc_store *store = NULL;
    char kept[4200];
    cli_parse(&cli, &spec, NULL, argc, argv);
    const char *from = file_of(cli.args[0]);
    cli.store = cli.args[1];
    cli_find_store(&cli);
    int rc = cli_open(&cli, &store);
    if (rc >= 0 && (rc = apc_store_restore(store, from, kept, sizeof kept)) < 0)
        cli_error(&cli, rc, "%s", apc_store_error(store));
    if (rc >= 0) {
        printf("%s restored from %s\n", cli.args[1], from);
        if (*kept)
            printf("what was there is kept in %s\n", kept);
    }
    apc_store_close(store);
    return cli_done(&cli, exit_code_of(rc));
}
