/* SPDX-License-Identifier: BSD-3-Clause */
/* apc maintain: the store's housekeeping. */
#include "apc/common/all_plants.h"

#include <stdlib.h>

#define DAY (86400 * APC_NS_PER_S)

struct options {
    const char *keep, *events, *ticks, *pack;
    bool all;
};

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"keep", 0, "DURATION",
     "Drop samples and timing older than that, as 90d or 36h; default: keep them for ever", OPTION_TEXT,
     AT(keep)},
    {"keep-events", 0, "DURATION", "Drop events older than that; default: keep them for ever", OPTION_TEXT,
     AT(events)},
    {"keep-ticks", 0, "DURATION",
     "Drop ticks and predictions older than that; default: 1d, or what --keep says if that is shorter",
     OPTION_TEXT, AT(ticks)},
    {"pack", 0, "DURATION",
     "Pack samples that are older than that, as 14d (PostgreSQL: whole weeks), to a quarter to a tenth of "
     "the disk space, with the same history; default: none",
     OPTION_TEXT, AT(pack)},
    {"all", 0, NULL, "All plants in the database whose tables you own, one after the other", OPTION_FLAG,
     AT(all)},
    {0},
};

static const struct cli_spec spec = {
    .doc = "Make the partitions of the coming weeks, and drop or pack old rows as the options say. Only the "
           "owner of the tables may do so. Run it once a day; programs may keep running. Samples are dropped "
           "by the week where tables are partitioned, ticks and predictions by the day; the newest sample of "
           "each variable always stays.",
    .takes = CLI_STORE,
    .options = own_options,
};

/* Of one plant, whose name is NULL where there is one only. Returns 0, or an error already said. */
static int maintain(const struct cli *cli, const char *plant, const struct apc_retention *keep)
{
    struct apc_store *store = NULL;
    int rc = cli_open(cli, &store);
    if (rc < 0)
        return rc;
    rc = apc_store_maintain(store, keep);
    if (rc < 0)
        cli_error(cli, rc, "%s%s%s", plant ? plant : "", plant ? ": " : "", apc_store_error(store));
    else
        printf("%s%srows and partitions dropped%s: %d\n", plant ? plant : "", plant ? ": " : "",
               keep->packed > 0 ? " or packed" : "", rc);
    apc_store_close(store);
    return rc < 0 ? rc : 0;
}

/* What fails in one plant is said, and the others have their turn. */
static int maintain_all(const struct cli *cli, const struct apc_retention *keep)
{
    struct all_plants all;
    size_t n = 0;
    int failed = all_plants_load(&all, cli);
    for (size_t i = 0; i < all.n; i++) {
        if (!all.plant[i].owned)
            continue;
        struct cli one = *cli;
        char *uri = all_plants_store(cli, all.plant[i].schema);
        one.store = uri;
        int rc = uri ? maintain(&one, all.plant[i].schema, keep) : APC_ENOMEM;
        failed = failed ? failed : rc;
        free(uri);
        n++;
    }
    if (!failed && n == 0)
        cli_error(cli, failed = APC_ENOTFOUND, "the database has no plant whose tables are yours");
    all_plants_free(&all);
    return failed;
}

int command_maintain(int argc, char **argv)
{
    struct options options = {0};
    struct apc_retention keep = {.size = sizeof keep};
    struct cli cli;

    cli_parse(&cli, &spec, &options, argc, argv);
    if (cli_duration(&cli, "keep", options.keep, &keep.samples) != EXIT_OK ||
        cli_duration(&cli, "keep-events", options.events, &keep.events) != EXIT_OK ||
        cli_duration(&cli, "keep-ticks", options.ticks, &keep.ticks) != EXIT_OK ||
        cli_duration(&cli, "pack", options.pack, &keep.packed) != EXIT_OK)
        return EXIT_USAGE;
    keep.timing = keep.samples;
    if (!options.ticks)
        keep.ticks = keep.samples > 0 && keep.samples < DAY ? keep.samples : DAY;
    int rc = options.all ? maintain_all(&cli, &keep) : maintain(&cli, NULL, &keep);
    return cli_done(&cli, exit_code_of(rc));
}
