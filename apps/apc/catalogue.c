/* SPDX-License-Identifier: BSD-3-Clause */
/* apc plants: the models there are, and what they consist of. */
#include <stdlib.h>

#include <apcplant.h>

#include "cli.h"
#include "print.h"

static const struct cli_spec spec = {
    .args_doc = "[PLANT...]",
    .doc =
        "List the built-in plants, or show the parameters, states, inputs, disturbances and outputs of each "
        "PLANT: a built-in one, or ./file.so.",
    .takes = CLI_FORMAT,
    .max_args = -1,
};

/* One table of a model. */
struct kind {
    const char *name, *names; /* "state", "states" */
    const struct apc_param *table;
    size_t n;
    char letter;
    bool named_only; /* it has no values */
};
#define KINDS 5

static void kinds_of(const struct apc_model *m, struct kind kinds[KINDS])
{
    const struct apc_model *by_states;

    if (apc_model_equations(m, &by_states, NULL) < 0)
        by_states = m; /* an FMU that shows none */
    kinds[0] = (struct kind){"parameter", "parameters", m->param, m->np, 'p', false};
    kinds[1] = (struct kind){"state", "states", by_states->state, by_states->nx, 'x', false};
    kinds[2] = (struct kind){"input", "inputs", m->input, m->nu, 'u', false};
    kinds[3] = (struct kind){"disturbance", "disturbances", m->disturbance, m->nd, 'd', false};
    kinds[4] = (struct kind){"output", "outputs", m->output, m->ny, 'y', true};
}

static const char *text_of(const char *text)
{
    return text ? text : "";
}

/* A number in full; nothing for a limit that is none. */
static char *number(double value, char text[PRINT_LEN])
{
    text[0] = '\0';
    return value > -APC_VALUE_MAX && value < APC_VALUE_MAX ? print_exact(value, text) : text;
}

static void show_json(const struct apc_model *m)
{
    struct kind kinds[KINDS];
    kinds_of(m, kinds);
    putchar('{');
    print_json_text(stdout, "name", m->name);
    putchar(',');
    print_json_text(stdout, "description", text_of(m->description));
    for (size_t k = 0; k < KINDS; k++) {
        printf(",\n  \"%s\":[", kinds[k].names);
        for (size_t i = 0; kinds[k].table && i < kinds[k].n; i++) {
            const struct apc_param *p = &kinds[k].table[i];
            fputs(i ? ",\n    {" : "\n    {", stdout);
            print_json_text(stdout, "name", p->name);
            putchar(',');
            print_json_text(stdout, "unit", text_of(p->unit));
            putchar(',');
            print_json_text(stdout, "description", text_of(p->description));
            if (!kinds[k].named_only) {
                putchar(',');
                print_json_limit(stdout, "initial", p->initial);
                putchar(',');
                print_json_limit(stdout, "low", p->low);
                putchar(',');
                print_json_limit(stdout, "high", p->high);
            }
            putchar('}');
        }
        putchar(']');
    }
    putchar('}');
}

static void csv_text(const char *text)
{
    putchar('"');
    for (text = text_of(text); *text; text++)
        *text == '"' ? fputs("\"\"", stdout) : putchar(*text);
    putchar('"');
}

static void show_csv(const struct apc_model *m)
{
    struct kind kinds[KINDS];
    char a[PRINT_LEN], b[PRINT_LEN], c[PRINT_LEN];
    kinds_of(m, kinds);
    for (size_t k = 0; k < KINDS; k++)
        for (size_t i = 0; kinds[k].table && i < kinds[k].n; i++) {
            const struct apc_param *p = &kinds[k].table[i];
            printf("%s,%s,%s,", m->name, kinds[k].name, p->name);
            csv_text(p->unit);
            if (kinds[k].named_only)
                fputs(",,,,", stdout);
            else
                printf(",%s,%s,%s,", number(p->initial, a), number(p->low, b), number(p->high, c));
            csv_text(p->description);
            putchar('\n');
        }
}

static int show_text(const struct apc_model *m)
{
    static const struct print_column columns[] = {
        {"", PRINT_LEFT},     {"NAME", PRINT_LEFT},  {"VALUE", PRINT_RIGHT},     {"UNIT", PRINT_LEFT},
        {"LOW", PRINT_RIGHT}, {"HIGH", PRINT_RIGHT}, {"DESCRIPTION", PRINT_LEFT}};
    struct kind kinds[KINDS];
    struct print_table table;
    char text[PRINT_LEN];

    printf("%s: ", m->name);
    print_clean(stdout, text_of(m->description));
    fputs("\n\n", stdout);
    kinds_of(m, kinds);
    print_table_open(&table, columns, 7);
    for (size_t k = 0; k < KINDS; k++)
        for (size_t i = 0; i < kinds[k].n; i++) {
            char name[24]; /* by which `apc linearize` knows one without */
            const struct apc_param unnamed = {name, "", "", 0, -APC_VALUE_MAX, APC_VALUE_MAX};
            const struct apc_param *p = kinds[k].table ? &kinds[k].table[i] : &unnamed;
            snprintf(name, sizeof name, "%c%zu", kinds[k].letter, i + 1);
            bool value = !kinds[k].named_only;
            print_cell(&table, PRINT_PLAIN, "%s", i ? "" : kinds[k].names);
            print_cell(&table, PRINT_PLAIN, "%s", p->name);
            print_cell(&table, PRINT_PLAIN, "%s", value ? number(p->initial, text) : "");
            print_cell(&table, PRINT_PLAIN, "%s", text_of(p->unit));
            print_cell(&table, PRINT_PLAIN, "%s", value ? number(p->low, text) : "");
            print_cell(&table, PRINT_PLAIN, "%s", value ? number(p->high, text) : "");
            print_cell(&table, PRINT_PLAIN, "%s", text_of(p->description));
        }
    int rc = print_table_show(&table, stdout, cli_colour(), 0, "\n");
    print_table_close(&table);
    return rc;
}

static int list_text(void)
{
    static const struct print_column columns[] = {{"NAME", PRINT_LEFT},    {"STATES", PRINT_LEFT},
                                                  {"INPUTS", PRINT_LEFT},  {"DISTURBANCES", PRINT_LEFT},
                                                  {"OUTPUTS", PRINT_LEFT}, {"DESCRIPTION", PRINT_LEFT}};
    struct print_table table;

    print_table_open(&table, columns, 6);
    for (size_t i = 0; apc_model_built_in(i); i++) {
        const struct apc_model *m = apc_model_built_in(i);
        struct kind kinds[KINDS];
        kinds_of(m, kinds);
        print_cell(&table, PRINT_PLAIN, "%s", m->name);
        for (size_t k = 1; k < KINDS; k++) {
            char names[120] = "";
            size_t used = 0;
            for (size_t j = 0; kinds[k].table && j < kinds[k].n && used < sizeof names; j++)
                used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", j ? " " : "",
                                         kinds[k].table[j].name);
            print_cell(&table, PRINT_PLAIN, "%s", names);
        }
        print_cell(&table, PRINT_PLAIN, "%s", m->description);
    }
    int rc = print_table_show(&table, stdout, cli_colour(), 0, "\n");
    print_table_close(&table);
    return rc;
}

static int show(const struct cli *cli, const struct apc_model *m, bool first)
{
    int rc = 0;
    if (cli->format == CLI_JSON) {
        if (!first)
            puts(",");
        show_json(m);
    } else if (cli->format == CLI_CSV) {
        show_csv(m);
    } else {
        if (!first)
            putchar('\n');
        rc = show_text(m);
    }
    return rc;
}

static int show_named(const struct cli *cli)
{
    int rc = 0;
    for (int i = 0; i < cli->n_args && rc == 0; i++) {
        const struct apc_model *model;
        void *handle;
        struct apc_error why;
        rc = apc_model_find(cli->args[i], &model, &handle, &why);
        if (rc < 0)
            return cli_error(cli, rc, "%s", why.text);
        rc = show(cli, model, i == 0);
        apc_plugin_close(handle);
    }
    return rc;
}

int command_plants(int argc, char **argv)
{
    struct cli cli;
    int rc = 0;

    cli_parse(&cli, &spec, NULL, argc, argv);
    if (cli.format == CLI_JSON)
        putchar('[');
    else if (cli.format == CLI_CSV)
        puts("plant,kind,name,unit,initial,low,high,description");
    if (cli.n_args > 0)
        rc = show_named(&cli);
    else if (cli.format == CLI_TEXT)
        rc = list_text();
    for (size_t i = 0; cli.n_args == 0 && cli.format != CLI_TEXT && apc_model_built_in(i); i++)
        (void)show(&cli, apc_model_built_in(i), i == 0);
    if (cli.format == CLI_JSON)
        puts("]");
    return cli_done(&cli, rc < 0 ? exit_code_of(rc) : rc);
}
