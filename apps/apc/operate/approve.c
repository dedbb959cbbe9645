/* SPDX-License-Identifier: BSD-3-Clause */
/* apc approve: what waits for a second person, who approves or refuses it. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "operate.h"

struct approve_options {
    bool refuse;
};

static const struct option_spec approve_options[] = {
    {"refuse", 'r', NULL, "Refuse the write; the person who requested it may refuse it too", OPTION_FLAG,
     .to = offsetof(struct approve_options, refuse)},
    {0},
};

static const struct cli_spec approve_spec = {
    .args_doc = "[VARIABLE|ID]",
    .doc = "Approve a write that another person has requested, in an experiment whose file sets "
           "`second_person`; the writes of one request are approved together. VARIABLE, a name or TABLE.ID "
           "such as setpoint.1, means its waiting write. ID, the time of the request in the list, means that "
           "request and no later one. Without either, list all waiting writes.",
    .takes = CLI_STORE | CLI_WRITES,
    .max_args = 1,
    .options = approve_options,
};

static int list_waiting(const struct cli *cli, struct apc_store *store, const struct plant_view *view)
{
    static const struct print_column columns[] = {{"VARIABLE", PRINT_LEFT}, {"ASKED", PRINT_POINT},
                                                  {"BY", PRINT_LEFT},       {"AGE", PRINT_LEFT},
                                                  {"LEFT", PRINT_LEFT},     {"ID", PRINT_LEFT}};
    const apc_ns now = apc_clock_utc(NULL);
    char text[CHANGE_TEXT], id[APC_TIME_LEN];
    struct print_table table;
    struct waiting *waiting;
    const int n = waiting_load(&waiting, store, view);
    int rc = n < 0 ? cli_store_error(cli, n, store) : EXIT_OK, shown = 0;
    print_table_open(&table, columns, 6);
    for (int i = 0; i < n; i++) {
        const struct waiting *w = &waiting[i];
        struct apc_sample to = w->row;
        to.id = w->to.id;
        if (now > w->until)
            continue;
        print_cell(&table, PRINT_PLAIN, "%s%s", w->to.name,
                   w->to.table == APC_OPMODE && w->to.loop ? " mode" : "");
        print_cell(&table, PRINT_PLAIN, "%s", change_text(&to, text));
        print_cell(&table, PRINT_PLAIN, "%s", w->asker);
        print_cell(&table, PRINT_FAINT, "%s", change_age(now - w->row.time, text));
        print_cell(&table, PRINT_FAINT, "%s", change_age(w->until - now, text));
        print_cell(&table, PRINT_FAINT, "%s", apc_time_format(w->row.time, id));
        shown++;
    }
    if (rc == EXIT_OK && shown == 0)
        puts("nothing waits for a second person");
    else if (rc == EXIT_OK && print_table_end(&table, stdout, cli_colour(), 0) < 0)
        rc = cli_error(cli, APC_ENOMEM, "out of memory");
    free(waiting);
    return rc;
}

static int approve(const struct cli *cli, struct apc_store *store, const struct plant_view *view,
                   bool refuses)
{
    char who[APC_AUTHOR_LEN];
    struct change_fault why;
    struct approval approval = {0};
    struct operation o = {.plant = view, .author = who, .reason = cli->reason};
    apc_ns asked;
    operate_who(who, sizeof who);
    if (apc_time_parse(cli->args[0], &asked) < 0)
        asked = 0;
    int err = operation_approve(&o, store, asked, cli->args[0], refuses, &approval, &why);
    if (err == 0 && refuses && (err = operation_refuse(&o, store, &why)) == 0)
        printf("%s: refused, requested by %s\n", o.change[0].to.name, approval.asker);
    const int rc = err < 0 && strcmp(why.code, "store") == 0 ? cli_store_error(cli, err, store)
                   : err < 0                                 ? operate_fault(cli, &why)
                   : refuses                                 ? EXIT_OK
                                                             : operate(cli, store, &o);
    free(approval.row);
    free(o.change);
    return rc;
}

int command_approve(int argc, char **argv)
{
    struct approve_options own = {0};
    struct apc_store *store = NULL;
    struct cli_plant plant = {0};
    struct cli cli;

    cli_parse(&cli, &approve_spec, &own, argc, argv);
    if (own.refuse && cli.n_args == 0)
        return cli_usage(&cli, "expected --refuse VARIABLE");
    int rc = cli.n_args > 0 ? EXIT_OK : cli_only_shows(&cli);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = cli_live(&cli, store);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    const struct plant_view view = operate_view(&plant);
    if (rc == EXIT_OK)
        rc = cli.n_args == 0 ? list_waiting(&cli, store, &view) : approve(&cli, store, &view, own.refuse);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}
