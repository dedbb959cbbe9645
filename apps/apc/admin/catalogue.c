/* SPDX-License-Identifier: BSD-3-Clause */
/* apc plants, apc laws: what there is to choose from, and what each consists of. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <apccontrol.h>
#include <apcplant.h>

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "files/files.h"

/* One table of a plant or a law. */
struct kind {
    const char *name, *names; /* "state", "states" */
    const struct apc_param *table;
    size_t n;
    char letter;
    bool named_only; /* it has no values */
    bool texts;      /* its values are texts */
};
#define KINDS         7
#define MOST_SETTINGS 64

/* A plant or a law as it is shown. */
struct entry {
    const char *name, *description;
    struct kind kinds[KINDS];
    size_t n_kinds;
    struct apc_param settings[MOST_SETTINGS];
};

/* What a command lists. */
struct catalogue {
    const char *what; /* "plant" */
    bool (*built_in)(size_t i, struct entry *to);
    /* A built-in one, or that of a file; *handle goes to apc_plugin_close() after the last use. */
    int (*find)(const char *name, struct entry *to, void **handle, struct apc_error *why);
    size_t first, last; /* the kinds whose names the list shows */
};

static void of_model(const struct apc_model *m, struct entry *to)
{
    const struct apc_model *by_states;

    if (apc_model_equations(m, &by_states, NULL) < 0)
        by_states = m; /* an FMU that shows none */
    *to = (struct entry){
        .name = m->name,
        .description = m->description,
        .kinds = {{"parameter", "parameters", m->param, m->np, 'p', false, false},
                  {"state", "states", by_states->state, by_states->nx, 'x', false, false},
                  {"input", "inputs", m->input, m->nu, 'u', false, false},
                  {"disturbance", "disturbances", m->disturbance, m->nd, 'd', false, false},
                  {"output", "outputs", m->output, m->ny, 'y', true, false}},
        .n_kinds = 5,
    };
    if (m->abi >= 3 && m->nz)
        to->kinds[to->n_kinds++] =
            (struct kind){"algebraic", "algebraic", m->algebraic, m->nz, 'z', false, false};
    struct kind *const texts = &to->kinds[to->n_kinds];
    *texts = (struct kind){"text", "texts", NULL, 0, 't', true, true};
    texts->table = apc_model_texts(m, &texts->n);
    to->n_kinds += texts->n > 0;
}

static bool plant_built_in(size_t i, struct entry *to)
{
    const struct apc_model *m = apc_model_built_in(i);
    if (m)
        of_model(m, to);
    return m;
}

static int find_plant_model(const char *name, struct entry *to, void **handle, struct apc_error *why)
{
    const struct apc_model *m;
    int rc = apc_model_find(name, &m, handle, why);
    if (rc == 0)
        of_model(m, to);
    return rc;
}

static void of_law(const struct apc_law *law, struct entry *to)
{
    size_t n = 0;

    *to = (struct entry){.name = law->name, .description = law->description, .n_kinds = 2};
    for (; law->settings && law->settings[n] && n < MOST_SETTINGS; n++)
        to->settings[n].name = law->settings[n];
    to->kinds[0] =
        (struct kind){"parameter", "tuning parameters", law->tuning, law->n_tuning, 'p', false, false};
    to->kinds[1] = (struct kind){"setting", "settings", to->settings, n, 's', true, false};
}

static bool law_built_in(size_t i, struct entry *to)
{
    const struct apc_law *law = apc_law_built_in(i);
    if (law)
        of_law(law, to);
    return law;
}

static int law_find(const char *name, struct entry *to, void **handle, struct apc_error *why)
{
    const struct apc_law *law;
    int rc = apc_law_find(name, &law, handle, why);
    if (rc == 0)
        of_law(law, to);
    return rc;
}

static const struct catalogue plants = {"plant", plant_built_in, find_plant_model, 1, 5},
                              laws = {"law", law_built_in, law_find, 0, 0};

static const char *text_of(const char *text)
{
    return text ? text : "";
}

/* A number in full; nothing for a limit that is none. */
static char *print_limit(double value, char text[PRINT_LEN])
{
    text[0] = '\0';
    return value > -APC_VALUE_MAX && value < APC_VALUE_MAX ? print_exact(value, text) : text;
}

static void entry_json(const struct entry *e)
{
    struct text t = {.out = stdout};
    json_add(&t, "{name:%s, description:%s", e->name, text_of(e->description));
    for (size_t k = 0; k < e->n_kinds; k++) {
        json_add(&t, ",\n  %s:[", e->kinds[k].names);
        for (size_t i = 0; e->kinds[k].table && i < e->kinds[k].n; i++) {
            const struct apc_param *p = &e->kinds[k].table[i];
            json_add(&t, ",\n    {name:%s, %s:%s, description:%s", p->name,
                     e->kinds[k].texts ? "initial" : "unit", text_of(p->unit), text_of(p->description));
            if (!e->kinds[k].named_only)
                json_add(&t, "initial:%e, low:%e, high:%e", p->initial, p->low, p->high);
            json_add(&t, "}");
        }
        json_add(&t, "]");
    }
    json_add(&t, "}");
}

static void entry_csv(const struct entry *e)
{
    char a[PRINT_LEN], b[PRINT_LEN], c[PRINT_LEN];
    for (size_t k = 0; k < e->n_kinds; k++)
        for (size_t i = 0; e->kinds[k].table && i < e->kinds[k].n; i++) {
            const struct apc_param *p = &e->kinds[k].table[i];
            csv_put(stdout, e->name);
            printf(",%s,", e->kinds[k].name);
            csv_put(stdout, p->name);
            putchar(',');
            csv_put_quoted(stdout, e->kinds[k].texts ? "" : text_of(p->unit));
            if (e->kinds[k].texts) {
                putchar(',');
                csv_put_quoted(stdout, text_of(p->unit));
                fputs(",,,", stdout);
            } else if (e->kinds[k].named_only)
                fputs(",,,,", stdout);
            else
                printf(",%s,%s,%s,", print_limit(p->initial, a), print_limit(p->low, b),
                       print_limit(p->high, c));
            csv_put_quoted(stdout, text_of(p->description));
            putchar('\n');
        }
}

static int entry_text(const struct entry *e)
{
    static const struct print_column columns[] = {
        {"", PRINT_LEFT},     {"NAME", PRINT_LEFT},  {"VALUE", PRINT_RIGHT},     {"UNIT", PRINT_LEFT},
        {"LOW", PRINT_RIGHT}, {"HIGH", PRINT_RIGHT}, {"DESCRIPTION", PRINT_LEFT}};
    struct print_table table;
    char text[PRINT_LEN];

    printf("%s: ", e->name);
    print_clean(stdout, text_of(e->description));
    fputs("\n\n", stdout);
    print_table_open(&table, columns, 7);
    for (size_t k = 0; k < e->n_kinds; k++)
        for (size_t i = 0; i < e->kinds[k].n; i++) {
            char name[24]; /* by which `apc linearize` knows one without */
            const struct apc_param unnamed = {name, "", "", 0, -APC_VALUE_MAX, APC_VALUE_MAX};
            const struct apc_param *p = e->kinds[k].table ? &e->kinds[k].table[i] : &unnamed;
            snprintf(name, sizeof name, "%c%zu", e->kinds[k].letter, i + 1);
            bool value = !e->kinds[k].named_only;
            print_cell(&table, PRINT_PLAIN, "%s", i ? "" : e->kinds[k].names);
            print_cell(&table, PRINT_PLAIN, "%s", p->name);
            print_cell(&table, PRINT_PLAIN, "%s",
                       e->kinds[k].texts ? text_of(p->unit)
                       : value           ? print_limit(p->initial, text)
                                         : "");
            print_cell(&table, PRINT_PLAIN, "%s", e->kinds[k].texts ? "" : text_of(p->unit));
            print_cell(&table, PRINT_PLAIN, "%s", value ? print_limit(p->low, text) : "");
            print_cell(&table, PRINT_PLAIN, "%s", value ? print_limit(p->high, text) : "");
            print_cell(&table, PRINT_PLAIN, "%s", text_of(p->description));
        }
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static int list_entries(const struct catalogue *list)
{
    struct print_column columns[KINDS + 2] = {{"NAME", PRINT_LEFT}};
    char heads[KINDS][16];
    struct print_table table;
    struct entry e;
    size_t n = 1;

    (void)list->built_in(0, &e);
    for (size_t k = list->first; k < list->last; k++, n++) {
        snprintf(heads[k], sizeof heads[k], "%s", e.kinds[k].names);
        for (char *c = heads[k]; *c; c++)
            *c = (char)toupper((unsigned char)*c);
        columns[n] = (struct print_column){heads[k], PRINT_LEFT};
    }
    columns[n++] = (struct print_column){"DESCRIPTION", PRINT_LEFT};
    print_table_open(&table, columns, n);
    for (size_t i = 0; list->built_in(i, &e); i++) {
        print_cell(&table, PRINT_PLAIN, "%s", e.name);
        for (size_t k = list->first; k < list->last; k++) {
            const struct kind *kind = &e.kinds[k];
            char names[48] = "";
            size_t used = 0, j = 0;
            for (; kind->table && j < kind->n && used + strlen(kind->table[j].name) < 30; j++)
                used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", j ? " " : "",
                                         kind->table[j].name);
            if (kind->table && j < kind->n)
                snprintf(names + used, sizeof names - used, " ... (%zu)", kind->n);
            print_cell(&table, PRINT_PLAIN, "%s", names);
        }
        print_cell(&table, PRINT_PLAIN, "%s", text_of(e.description));
    }
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static int show_entry(const struct cli *cli, const struct entry *e, bool first)
{
    int rc = 0;
    if (cli->format == CLI_JSON) {
        if (!first)
            puts(",");
        entry_json(e);
    } else if (cli->format == CLI_CSV) {
        entry_csv(e);
    } else {
        if (!first)
            putchar('\n');
        rc = entry_text(e);
    }
    return rc;
}

static int show_named(const struct cli *cli, const struct catalogue *list)
{
    int rc = 0;
    for (int i = 0; i < cli->n_args && rc == 0; i++) {
        struct entry e;
        void *handle;
        struct apc_error why;
        rc = list->find(cli->args[i], &e, &handle, &why);
        if (rc < 0)
            return cli_error(cli, rc, "%s", why.text);
        rc = show_entry(cli, &e, i == 0);
        apc_plugin_close(handle);
    }
    return rc;
}

static int command(const struct catalogue *list, const struct cli_spec *spec, int argc, char **argv)
{
    struct cli cli;
    struct entry e;
    int rc = 0;

    cli_parse(&cli, spec, NULL, argc, argv);
    if (cli.format == CLI_JSON)
        putchar('[');
    else if (cli.format == CLI_CSV)
        printf("%s,kind,name,unit,initial,low,high,description\n", list->what);
    if (cli.n_args > 0)
        rc = show_named(&cli, list);
    else if (cli.format == CLI_TEXT)
        rc = list_entries(list);
    for (size_t i = 0; cli.n_args == 0 && cli.format != CLI_TEXT && list->built_in(i, &e); i++)
        (void)show_entry(&cli, &e, i == 0);
    if (cli.format == CLI_JSON)
        puts("]");
    return cli_done(&cli, rc < 0 ? exit_code_of(rc) : rc);
}

int command_plants(int argc, char **argv)
{
    static const struct cli_spec spec = {
        .args_doc = "[PLANT...]",
        .doc = "List the built-in plants, or show the parameters, states, inputs, disturbances and outputs "
               "of each "
               "PLANT: a built-in one, or ./file.so.",
        .takes = CLI_FORMAT,
        .max_args = -1,
    };
    return command(&plants, &spec, argc, argv);
}

int command_laws(int argc, char **argv)
{
    static const struct cli_spec spec = {
        .args_doc = "[LAW...]",
        .doc = "List the built-in control laws, or show the tuning parameters and settings of each LAW: a "
               "built-in "
               "one, ./file.so or ./file.py.",
        .takes = CLI_FORMAT,
        .max_args = -1,
    };
    return command(&laws, &spec, argc, argv);
}
