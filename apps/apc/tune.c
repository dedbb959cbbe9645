/* SPDX-License-Identifier: BSD-3-Clause */
/* apc mode, apc tune: how the controller works, shown or changed. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "operate.h"
#include "print.h"

/* ---- mode --------------------------------------------------------------------------------- */

static const struct cli_spec mode_spec = {
    .args_doc = "[man|auto]",
    .doc =
        "Show the target mode and the actual one, or change the target. Auto: the law controls. Man: the "
        "outputs are the operator's; they stay where they are until `apc set` changes them. Waits until the "
        "controller is in it.",
    .takes = CLI_STORE | CLI_FORMAT | CLI_WRITES,
    .max_args = 1,
};

static const char *mode_text(const struct apc_sample *mode)
{
    return mode->seq > 0 && mode->value >= 0 ? apc_mode_name((int)mode->value) : NULL;
}

static void show_mode(const struct cli *cli, const struct apc_sample mode[2])
{
    static const char *const names[] = {"target", "actual"};
    char age[PRINT_LEN];

    if (cli->format == CLI_JSON) {
        for (int i = 0; i < 2; i++) {
            putchar(i == 0 ? '{' : ',');
            print_json_text(stdout, names[i], mode_text(&mode[i]));
        }
        puts("}");
        return;
    }
    if (cli->format == CLI_CSV)
        puts(PRINT_SAMPLE_HEADER);
    for (int i = 0; i < 2; i++) {
        const char *text = mode_text(&mode[i]);
        if (cli->format == CLI_CSV && mode[i].seq > 0)
            print_sample_csv(stdout, &mode[i]);
        else if (cli->format == CLI_TEXT && text)
            printf("%s  %-4s  for %s\n", names[i], text, print_age(apc_clock_utc(NULL) - mode[i].time, age));
        else if (cli->format == CLI_TEXT)
            printf("%s  none\n", names[i]);
    }
}

static int change_mode(const struct cli *cli, struct apc_store *store, const struct apc_sample now[2],
                       enum apc_mode mode)
{
    struct change change = {
        .name = "mode", .before = now[0], .after = {.table = APC_OPMODE, .id = 0, .value = (double)mode}};
    if (now[0].seq == 0 || now[0].value != (double)mode)
        return operate(cli, store, &change, 1);
    if (now[1].seq > 0 && now[1].value != (double)mode && !cli->no_wait)
        return cli_error(cli, APC_EPERM,
                         "the target is %s already, but the controller is in %s: see apc status",
                         apc_mode_name((int)mode), mode_text(&now[1]));
    printf("mode: %s already\n", apc_mode_name((int)mode));
    return EXIT_OK;
}

int command_mode(int argc, char **argv)
{
    struct apc_sample mode[2] = {{.table = APC_OPMODE, .id = 0}, {.table = APC_OPMODE, .id = 1}};
    struct apc_store *store = NULL;
    struct cli cli;

    cli_parse(&cli, &mode_spec, NULL, argc, argv);
    const char *wanted = cli.n_args > 0 ? cli.args[0] : NULL;
    if (wanted && strcasecmp(wanted, "man") != 0 && strcasecmp(wanted, "auto") != 0)
        return cli_usage(&cli, "mode \"%s\": must be man or auto", wanted);
    if (wanted && cli.format != CLI_TEXT)
        return cli_usage(&cli, "--json and --csv show the mode; they do not go with a change");
    int rc = cli_open(&cli, &store);
    if (rc < 0)
        return exit_code_of(rc);
    rc = apc_store_read(store, mode, 2);
    if (rc < 0)
        rc = cli_store_error(&cli, rc, store);
    else if (wanted)
        rc = change_mode(&cli, store, mode, strcasecmp(wanted, "man") ? APC_MODE_AUTO : APC_MODE_MAN);
    else
        show_mode(&cli, mode);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

/* ---- tune --------------------------------------------------------------------------------- */

static const struct cli_spec tune_spec = {
    .args_doc = "[NAME=VALUE...]",
    .doc = "Show the tuning of the control law, or change it; several parameters in one transaction. "
           "Waits until the controller has it.",
    .takes = CLI_STORE | CLI_FORMAT | CLI_WRITES,
    .max_args = -1,
};

static char *limit_text(double limit, char text[PRINT_LEN])
{
    if (limit > -APC_VALUE_MAX && limit < APC_VALUE_MAX)
        return print_exact(limit, text);
    text[0] = '\0';
    return text;
}

static int tuning_text(const struct cli_tags *tags, const struct apc_sample *samples, int n)
{
    static const struct print_column columns[] = {{"NAME", PRINT_LEFT},  {"VALUE", PRINT_POINT},
                                                  {"UNIT", PRINT_LEFT},  {"LOW", PRINT_POINT},
                                                  {"HIGH", PRINT_POINT}, {"DESCRIPTION", PRINT_LEFT}};
    char text[PRINT_LEN];
    struct print_table table;

    print_table_open(&table, columns, 6);
    for (int i = 0; i < n; i++) {
        const struct apc_tag *tag = cli_tag(tags, APC_TUNING, samples[i].id);
        print_cell(&table, PRINT_PLAIN, "%s", tag->name);
        print_cell(&table, PRINT_PLAIN, "%s", samples[i].seq ? print_exact(samples[i].value, text) : "-");
        print_cell(&table, PRINT_PLAIN, "%s", tag->unit);
        print_cell(&table, PRINT_PLAIN, "%s", limit_text(tag->low, text));
        print_cell(&table, PRINT_PLAIN, "%s", limit_text(tag->high, text));
        print_cell(&table, PRINT_PLAIN, "%s", tag->description);
    }
    int rc = print_table_show(&table, stdout, cli_colour(), 0, "\n");
    print_table_close(&table);
    return rc;
}

static void tuning_json(const struct cli_tags *tags, const struct apc_sample *samples, int n)
{
    char value[PRINT_LEN];
    for (int i = 0; i < n; i++) {
        const struct apc_tag *tag = cli_tag(tags, APC_TUNING, samples[i].id);
        fputs(i == 0 ? "[\n{" : ",\n{", stdout);
        print_json_text(stdout, "name", tag->name);
        apc_number_format(samples[i].value, value, sizeof value);
        printf(",\"id\":%d,\"value\":%s,", samples[i].id, samples[i].seq ? value : "null");
        print_json_text(stdout, "unit", tag->unit);
        putchar(',');
        print_json_limit(stdout, "low", tag->low);
        putchar(',');
        print_json_limit(stdout, "high", tag->high);
        putchar(',');
        print_json_text(stdout, "description", tag->description);
        putchar('}');
    }
    puts("\n]");
}

static int show_tuning(const struct cli *cli, struct apc_store *store, const struct cli_tags *tags)
{
    static const enum apc_table shown[] = {APC_TUNING, (enum apc_table)0};
    struct apc_sample *samples;
    int n = cli_variables(cli, tags, shown, &samples);
    if (n < 0) {
        free(samples);
        return exit_code_of(n);
    }
    int err = apc_store_read(store, samples, (size_t)n);
    int rc = EXIT_OK;
    if (err < 0)
        rc = cli_store_error(cli, err, store);
    else if (cli->format == CLI_JSON)
        tuning_json(tags, samples, n);
    else if (cli->format == CLI_TEXT && (err = tuning_text(tags, samples, n)) < 0)
        rc = cli_error(cli, err, "out of memory");
    else if (cli->format == CLI_CSV) {
        puts(PRINT_SAMPLE_HEADER);
        for (int i = 0; i < n; i++)
            if (samples[i].seq > 0)
                print_sample_csv(stdout, &samples[i]);
    }
    free(samples);
    return rc;
}

/* NAME=VALUE, cut in place: the name becomes the argument. */
static int parse_tunings(const struct cli *cli, struct change *changes)
{
    for (int i = 0; i < cli->n_args; i++) {
        char *equals = strchr(cli->args[i], '=');
        if (!equals || equals == cli->args[i])
            return cli_usage(cli, "\"%s\" is not NAME=VALUE", cli->args[i]);
        *equals = '\0';
        if (apc_number_parse(equals + 1, &changes[i].after.value) < 0)
            return cli_usage(cli, "%s: \"%s\" is not a finite number", cli->args[i], equals + 1);
    }
    return EXIT_OK;
}

static int find_tuning(const struct cli *cli, const struct cli_tags *tags, const char *name, struct change *c)
{
    for (size_t i = 0; i < tags->n && !c->tag; i++)
        if (tags->tag[i].table == APC_TUNING && !strcmp(tags->tag[i].name, name))
            c->tag = &tags->tag[i];
    for (size_t i = 0; i < tags->n && !c->tag; i++) {
        char address[32];
        snprintf(address, sizeof address, "tuning.%d", tags->tag[i].id);
        if (tags->tag[i].table == APC_TUNING && !strcmp(address, name))
            c->tag = &tags->tag[i];
    }
    if (!c->tag)
        return exit_code_of(cli_unknown(cli, tags, name, APC_TUNING));
    snprintf(c->name, sizeof c->name, "%s", c->tag->name);
    c->after.table = APC_TUNING;
    c->after.id = c->tag->id;
    c->before = c->after;
    return operate_check(cli, c);
}

static int tune(const struct cli *cli, struct apc_store *store, const struct cli_tags *tags,
                struct change *changes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        int rc = find_tuning(cli, tags, cli->args[i], &changes[i]);
        if (rc != EXIT_OK)
            return rc;
        for (size_t j = 0; j < i; j++)
            if (changes[j].after.id == changes[i].after.id)
                return cli_usage(cli, "%s is given twice", changes[i].name);
    }
    int err = operate_read(store, changes, n);
    return err < 0 ? cli_store_error(cli, err, store) : operate(cli, store, changes, n);
}

int command_tune(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct cli_tags tags = {0};
    struct cli cli;

    cli_parse(&cli, &tune_spec, NULL, argc, argv);
    if (cli.n_args > 0 && cli.format != CLI_TEXT)
        return cli_usage(&cli, "--json and --csv show the tuning; they do not go with a change");
    size_t n = (size_t)cli.n_args;
    struct change *changes = calloc(n + 1, sizeof *changes);
    if (!changes)
        return cli_error(&cli, APC_ENOMEM, "out of memory");
    int rc = parse_tunings(&cli, changes);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_tags_load(&cli, store, &tags));
    if (rc == EXIT_OK)
        rc = n > 0 ? tune(&cli, store, &tags, changes, n) : show_tuning(&cli, store, &tags);
    free(changes);
    cli_tags_free(&tags);
    apc_store_close(store);
    return cli_done(&cli, rc);
}
