/* SPDX-License-Identifier: BSD-3-Clause */
/* apc log: an entry in the log book, or the log book as a page. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "experiment/experiment.h"
#include "operate.h"

#define DAY (86400 * APC_NS_PER_S)

struct log_options {
    const char *signal, *since, *until;
    bool signs, html;
};

static const struct option_spec log_options[] = {
    {"of", 'f', "SIGNAL", "The signal that the entry is about; the entry begins with its name", OPTION_TEXT,
     .to = offsetof(struct log_options, signal)},
    {"sign", 0, NULL, "Sign the handover: you have read the previous shift's entries, and take over",
     OPTION_FLAG, .to = offsetof(struct log_options, signs)},
    {"html", 0, NULL, "Print the log book to stdout, as an HTML page for printing", OPTION_FLAG,
     .to = offsetof(struct log_options, html)},
    {"since", 0, "TIME", "With --html: only from TIME on, RFC 3339 or before now; default: -24h", OPTION_TEXT,
     .to = offsetof(struct log_options, since)},
    {"until", 0, "TIME", "With --html: only before TIME; default: now", OPTION_TEXT,
     .to = offsetof(struct log_options, until)},
    {0},
};

static const struct cli_spec log_spec = {
    .args_doc = "TEXT\n--html",
    .doc = "Enter TEXT in the log book of the plant under your name, one line of at most 180 bytes. The "
           "entry is an event: the screen Log book of the page and `apc history --events` show it. The same "
           "TEXT within a minute is one entry, except from programs that enter it at the same instant.",
    .takes = CLI_STORE,
    .max_args = 1,
    .options = log_options,
};

/* The name of the plant, of a store that has its experiment. */
static int name_of_plant(struct apc_store *store, char name[APC_TAG_LEN], struct apc_error *why)
{
    struct experiment e;
    int64_t revision;
    const int rc = experiment_stored(&e, store, &revision, why);
    snprintf(name, APC_TAG_LEN, "%s", rc > 0 ? e.name : "");
    experiment_free(&e);
    return rc < 0 ? rc : 0;
}

static char *log_time(const void *ctx, apc_ns utc, char text[PRINT_LEN])
{
    (void)ctx;
    return print_second(utc, text);
}

static int put_log_page(struct apc_store *store, const char *plant, const struct apc_range *range)
{
    char from[PRINT_LEN], to[PRINT_LEN];
    page_begin(stdout, "Log book", plant);
    printf("<p>From %s to %s, UTC</p>\n", print_second(range->since, from), print_second(range->until, to));
    const int n = page_events(stdout, store, range, logbook_is_entry, log_time, NULL, SIZE_MAX);
    printf("<p>Entries: %d</p>\n</body>\n</html>\n", n);
    return n;
}

static int show_log_page(const struct cli *cli, const struct log_options *own)
{
    struct apc_range range = {.until = apc_clock_utc(NULL)};
    struct apc_store *store = NULL;
    struct apc_error why;
    char name[APC_TAG_LEN];
    if (cli_time(cli, "until", own->until, &range.until) != EXIT_OK)
        return EXIT_USAGE;
    range.since = range.until - DAY;
    if (cli_time(cli, "since", own->since, &range.since) != EXIT_OK)
        return EXIT_USAGE;
    if (range.since >= range.until)
        return cli_usage(cli, "--since must be before --until");
    int rc = exit_code_of(cli_open(cli, &store)), n;
    if (rc == EXIT_OK && (rc = name_of_plant(store, name, &why)) < 0)
        rc = cli_error(cli, rc, "%s", why.text);
    if (rc == EXIT_OK && (n = put_log_page(store, name, &range)) < 0)
        rc = cli_store_error(cli, n, store);
    apc_store_close(store);
    return rc;
}

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
    if (own.html ? cli.n_args > 0 || own.signal || own.signs : cli.n_args == 0 || own.since || own.until)
        return cli_usage(&cli, "either TEXT or --html, with --since and --until");
    if (own.html)
        return cli_done(&cli, show_log_page(&cli, &own));
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
