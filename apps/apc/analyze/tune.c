/* SPDX-License-Identifier: BSD-3-Clause */
/* apc tune: the tuning of the laws, shown or changed. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/operate/operate.h"
#include "tune.h"

static void check_tune_options(void *input, const struct argp_state *state)
{
    const struct suggest_options *o = input;
    if (!o->run && (o->apply || o->rule || o->tau_c > 0.0 || o->model || o->figure || o->force || o->closed))
        argp_error(state,
                   "--closed, --model, --figure, --force, --rule, --tau-c and --apply go with --suggest RUN");
    if (o->rule == SUGGEST_RELAY && o->tau_c > 0.0)
        argp_error(state, "--tau-c goes with --rule simc or lambda");
}

static const char *const rules[SUGGEST_RULES + 1] = {"simc", "lambda", "relay", NULL};

#define AT(member) .to = offsetof(struct suggest_options, member)
static const struct option_spec own_options[] = {
    {"suggest", 0, "RUN",
     "Suggest tunings of the PI and PID loops of run folder RUN, best that of an `apc test`, and compare "
     "them with the present ones",
     OPTION_TEXT, AT(run)},
    {"model", 0, "FILE",
     "Take the plant from this model file of transfer functions; RUN may then be an experiment file",
     OPTION_TEXT, AT(model)},
    {"figure", 0, "NAME", "Draw NAME.svg and NAME.png: a setpoint step of each loop, present and suggested",
     OPTION_TEXT, AT(figure)},
    {"force", 0, NULL, "Overwrite these files", OPTION_FLAG, AT(force)},
    {"rule", 0, "RULE",
     "simc (the default), lambda or relay; relay takes the stability limit of the loop from the oscillation "
     "in RUN if that is a relay test, else from the model",
     OPTION_CHOICE, AT(rule), .choices = rules, .must = "be simc, lambda or relay"},
    {"tau-c", 0, "S",
     "Closed-loop time constant, in s, that simc and lambda aim at; default: the dead time. Longer is slower "
     "and gentler",
     OPTION_NUMBER, AT(tau_c), .must = "be s, above 0"},
    {"closed", 0, NULL,
     "Also replay RUN in closed loop with the suggested tuning and the recorded disturbances, as "
     "`apc replay --closed` does",
     OPTION_FLAG, AT(closed)},
    {"apply", 0, NULL, "Write the suggested tuning, as one change", OPTION_FLAG, AT(apply)},
    {0},
};

static const struct cli_spec tune_spec = {
    .args_doc = "[NAME=VALUE...]",
    .doc = "Show the tuning of the control laws, or change it; several parameters in one transaction. With "
           "several loops a parameter is LOOP.NAME. The command waits until the controller has taken the "
           "change. With --suggest show better tunings.",
    .takes = CLI_STORE | CLI_FORMAT | CLI_WRITES,
    .max_args = -1,
    .options = own_options,
    .check = check_tune_options,
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
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static void tuning_json(const struct cli_tags *tags, const struct apc_sample *samples, int n)
{
    struct text t = {.out = stdout};
    json_add(&t, "[\n");
    for (int i = 0; i < n; i++) {
        const struct apc_tag *tag = cli_tag(tags, APC_TUNING, samples[i].id);
        json_add(&t, i == 0 ? "{" : ",\n{");
        json_add(&t, "name:%s, id:%d, value:%g, unit:%s, low:%e, high:%e, description:%s}", tag->name,
                 samples[i].id, samples[i].seq ? samples[i].value : (double)NAN, tag->unit, tag->low,
                 tag->high, tag->description);
    }
    json_add(&t, "\n]\n");
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
    struct change_fault why;
    for (int i = 0; i < cli->n_args; i++) {
        char *equals = strchr(cli->args[i], '=');
        if (!equals || equals == cli->args[i])
            return cli_usage(cli, "\"%s\" is not NAME=VALUE", cli->args[i]);
        *equals = '\0';
        if (change_number(equals + 1, &changes[i].after.value, &why) < 0)
            return cli_usage(cli, "%s: %s", cli->args[i], why.text);
    }
    return EXIT_OK;
}

static int tune(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                struct change *changes, size_t n)
{
    const struct plant_view view = operate_view(plant);
    struct operation o = {.plant = &view, .change = changes, .n = n};
    for (size_t i = 0; i < n; i++) {
        int rc = operate_find(cli, &view, cli->args[i], CHANGE_TUNING, changes[i].after.value, &changes[i]);
        if (rc != EXIT_OK)
            return rc;
        for (size_t j = 0; j < i; j++)
            if (changes[j].to.id == changes[i].to.id)
                return cli_usage(cli, "%s is given twice: give each once", changes[i].to.name);
    }
    return operate(cli, store, &o);
}

static int change_tuning(struct cli *cli, const struct suggestion *suggested)
{
    struct apc_store *store = NULL;
    struct cli_plant plant = {0};
    const size_t n = suggested->n ? suggested->n : (size_t)cli->n_args;
    struct change *changes = calloc(n + 1, sizeof *changes);
    char **names = calloc(n + 1, sizeof *names);
    int rc;

    if (!changes || !names) {
        free(changes);
        free(names);
        return cli_error(cli, APC_ENOMEM, "out of memory");
    }
    for (size_t i = 0; i < suggested->n; i++) {
        names[i] = suggested->name[i];
        changes[i].after.value = suggested->value[i];
    }
    if (suggested->n)
        cli->args = names;
    rc = suggested->n ? EXIT_OK : parse_tunings(cli, changes);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(cli, &store));
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(cli, store, &plant));
    if (rc == EXIT_OK)
        rc = n > 0 ? tune(cli, store, &plant, changes, n) : show_tuning(cli, store, &plant.tags);
    free(names);
    free(changes);
    cli_plant_free(&plant);
    apc_store_close(store);
    return rc;
}

int command_tune(int argc, char **argv)
{
    struct suggest_options options = {.run = NULL};
    struct suggestion suggested = {.n = 0};
    struct apc_error why;
    struct cli cli;

    cli_parse(&cli, &tune_spec, &options, argc, argv);
    if (options.run && (cli.n_args > 0 || cli.format != CLI_TEXT))
        return cli_usage(&cli, "--suggest finds the numbers: no NAME=VALUE, --json or --csv with it");
    if (cli.n_args > 0 && cli.format != CLI_TEXT)
        return cli_usage(&cli, "--json and --csv show the tuning; they do not go with a change");
    int rc = options.apply || (!options.run && cli.n_args > 0) ? EXIT_OK : cli_only_shows(&cli);
    if (rc == EXIT_OK && options.run) {
        const int found = suggest(&options, &suggested, &why);
        rc = found < 0 ? cli_error(&cli, found, "%s", why.text) : EXIT_OK;
    }
    if (rc == EXIT_OK && (!options.run || options.apply))
        rc = change_tuning(&cli, &suggested);
    suggestion_free(&suggested);
    return cli_done(&cli, rc);
}
