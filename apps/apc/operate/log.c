/* SPDX-License-Identifier: BSD-3-Clause */
/* apc log: an entry in the log book. */
#include <stddef.h>
#include <string.h>

#include "apc/common/print.h"
#include "operate.h"

struct log_options {
    const char *signal;
    bool signs;
};

static const struct option_spec log_options[] = {
    {"of", 'f', "SIGNAL", "The signal that it is about; the entry begins with its name", OPTION_TEXT,
     .to = offsetof(struct log_options, signal)},
    {"sign", 0, NULL, "You have read what the shift before left, and take over", OPTION_FLAG,
     .to = offsetof(struct log_options, signs)},
    {0},
};

static const struct cli_spec log_spec = {
    .args_doc = "TEXT",
    .doc =
        "Enter TEXT in the log book of the plant under your name, one line of at most 180 bytes. It stands "
        "among the events: the page shows it on the screen Log book, and `apc history --events` as well. The "
        "same TEXT within a minute is one entry.",
    .takes = CLI_STORE,
    .min_args = 1,
    .max_args = 1,
    .options = log_options,
};

int command_log(int argc, char **argv)
{
    char who[APC_AUTHOR_LEN];
    struct apc_store *store = NULL;
    struct cli_plant plant = {0};
    struct log_options own = {0};
    struct apc_event event;
    struct change_fault why;
    struct cli cli;

    cli_parse(&cli, &log_spec, &own, argc, argv);
    operate_who(who, sizeof who);
    const struct logbook_entry entry = {
        .author = who, .signal = own.signal, .text = cli.args[0], .signs = own.signs};
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = cli_live(&cli, store);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    if (rc == EXIT_OK) {
        const struct plant_view view = operate_view(&plant);
        int err = logbook_make(&view, &entry, &event, &why);
        if (err == 0)
            err = logbook_add(store, -1, &event, &why);
        if (err < 0)
            rc = operate_fault(&cli, &why);
        else {
            print_clean(stdout, event.text);
            puts(err > 0 ? " (entered)" : " (entered already)");
        }
    }
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}
