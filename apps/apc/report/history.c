/* SPDX-License-Identifier: BSD-3-Clause */
/* apc history: rows of one variable, or events, given out as they come from the store; or their statistics. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"

#define LAST_DEFAULT 20

struct history_options {
    const char *since, *until;
    bool events, statistics;
    size_t last; /* 0: not given */
};

#define AT(member) .to = offsetof(struct history_options, member)
static const struct option_spec own_options[] = {
    {"since", 0, "TIME",
     "Only from TIME on: UTC as 2026-01-31T12:00:00Z, 2026-01-31T12:00 or 2026-01-31, or before now as 30s, "
     "10m, 2h, 1d; seconds alone as -600",
     OPTION_TEXT, AT(since)},
    {"until", 0, "TIME", "Only before TIME, in the same format", OPTION_TEXT, AT(until)},
    {"last", 'n', "N", "Only the newest N; default 20, or all when a time or --statistics is given",
     OPTION_WHOLE, AT(last), .low = 1, .high = 1e15, .must = "be a whole number from 1"},
    {"events", 0, NULL, "Show events instead of values", OPTION_FLAG, AT(events)},
    {"statistics", 0, NULL,
     "Show number, minimum, mean, maximum and standard deviation instead of the values; Bad values are only "
     "counted",
     OPTION_FLAG, AT(statistics)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[VARIABLE...]",
    .doc = "Show past values of each VARIABLE, oldest first, with the author of values that people wrote; or "
           "show events. Times are UTC.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = -1,
    .options = own_options,
};

/* ---- Rows --------------------------------------------------------------------------------- */

struct rows {
    enum cli_format format;
    bool colour;
    size_t n;
    const struct cli *cli;
    struct apc_store *names; /* the store once more, for who is asked while it streams; NULL: not yet */
    uint32_t author;         /* whose name is known */
    char name[APC_AUTHOR_LEN];
};

/* Who wrote a row; "": nobody said, or no name can be had. Who writes once often writes again. */
static const char *author_of_row(struct rows *r, uint32_t author)
{
    if (author == 0)
        return "";
    if (author != r->author && (r->names || cli_open(r->cli, &r->names) >= 0)) {
        (void)apc_store_author_name(r->names, author, r->name);
        r->author = author;
    }
    return author == r->author ? r->name : "";
}

static void begin_rows(const struct rows *r, const char *csv, const char *heading)
{
    if (r->format == CLI_CSV)
        puts(csv);
    else if (r->format == CLI_TEXT)
        printf(r->colour ? "\033[1m%s\033[0m\n" : "%s\n", heading);
}

static void next(struct rows *r)
{
    if (r->format == CLI_JSON)
        fputs(r->n == 0 ? "[\n" : ",\n", stdout);
    r->n++;
}

/* After a failure in the middle too: what stands there is JSON. */
static void end_rows(const struct rows *r)
{
    if (r->format == CLI_JSON)
        puts(r->n == 0 ? "[]" : "\n]");
}

static int put_sample(void *ctx, const struct apc_sample *s)
{
    struct rows *r = ctx;
    char time[APC_TIME_LEN], status[APC_STATUS_NAME_LEN], value[PRINT_LEN];

    next(r);
    if (r->format == CLI_CSV) {
        print_sample_csv(stdout, s);
        return ferror(stdout);
    }
    const char *author = author_of_row(r, s->author);
    if (r->format == CLI_JSON) {
        struct text t = {.out = stdout};
        json_add(&t, "{");
        print_sample_members(&t, s, NULL, 0);
        if (*author)
            json_add(&t, "author:%s", author);
        json_add(&t, "}");
    } else {
        printf("%s  %12s  %s", apc_time_format(s->time, time), print_value(s, value),
               apc_status_format(s->status, status));
        if (*author) {
            fputs("  by ", stdout);
            print_clean(stdout, author);
        }
        putchar('\n');
    }
    return ferror(stdout);
}

static void put_csv_text(const char *text, int width)
{
    print_clean(stdout, text);
    printf("%*s", (int)strlen(text) < width ? width - (int)strlen(text) + 2 : 2, "");
}

static int put_event(void *ctx, const struct apc_event *e)
{
    struct rows *r = ctx;
    char time[APC_TIME_LEN];

    next(r);
    if (r->format == CLI_JSON)
        print_event_json(&(struct text){.out = stdout}, e);
    else if (r->format == CLI_CSV)
        print_event_csv(stdout, e);
    else {
        printf("%s  %-8s  ", apc_time_format(e->time, time), print_severity(e->severity));
        put_csv_text(e->source, 14);
        put_csv_text(e->kind, 8);
        print_clean(stdout, e->text);
        putchar('\n');
    }
    return ferror(stdout);
}

static int show_variable(const struct cli *cli, struct apc_store *store, const struct apc_sample *variable,
                         const char *name, const struct apc_range *range, struct rows *rows)
{
    if (cli->format == CLI_TEXT && cli->n_args > 1)
        printf("%s%s\n", rows->n > 0 ? "\n" : "", name);
    if (cli->format == CLI_TEXT)
        begin_rows(rows, "", "TIME                                VALUE  STATUS");
    int rc = apc_store_history(store, variable->table, variable->id, range, put_sample, rows);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    if (rc == 0)
        cli_error(cli, 0, "%s has no sample%s", name, range->since || range->until ? " in that time" : "");
    return EXIT_OK;
}

static int show_variables(const struct cli *cli, struct apc_store *store, const struct apc_range *range,
                          struct rows *rows)
{
    struct cli_tags tags;
    struct apc_sample *variables = NULL;
    int rc = cli_tags_load(cli, store, &tags);
    if (rc < 0)
        return exit_code_of(rc);
    int n = cli_variables(cli, &tags, NULL, &variables);
    rc = exit_code_of(n);
    if (cli->format == CLI_CSV && rc == EXIT_OK)
        puts(PRINT_SAMPLE_HEADER);
    for (int i = 0; i < n && rc == EXIT_OK; i++)
        rc = show_variable(cli, store, &variables[i], cli->args[i], range, rows);
    if (n > 0)
        end_rows(rows);
    free(variables);
    cli_tags_free(&tags);
    return rc;
}

/* ---- Statistics --------------------------------------------------------------------------- */

struct statistics {
    size_t n, bad;
    double min, max, mean, square; /* square: sum of squared distances from the mean */
};

static int take_statistics(void *ctx, const struct apc_sample *s)
{
    struct statistics *of = ctx;
    if (apc_status_severity(s->status) == APC_SEVERITY_BAD) {
        of->bad++;
        return 0;
    }
    const double off = s->value - of->mean;
    of->mean += off / (double)++of->n;
    of->square += off * (s->value - of->mean);
    of->min = of->n == 1 ? s->value : fmin(of->min, s->value);
    of->max = of->n == 1 ? s->value : fmax(of->max, s->value);
    return 0;
}

static void show_statistics_of(struct rows *rows, struct print_table *table, const struct cli_tags *tags,
                               const struct apc_sample *variable, const struct statistics *of)
{
    const double none = (double)NAN, sd = of->n > 1 ? sqrt(of->square / (double)(of->n - 1)) : none;
    const double figure[] = {of->n ? of->min : none, of->n ? of->mean : none, of->n ? of->max : none, sd};
    const struct apc_tag *tag = cli_tag(tags, variable->table, variable->id);
    char name[PRINT_LEN];
    print_name(tags, variable, name);
    if (rows->format == CLI_JSON) {
        next(rows);
        json_add(&(struct text){.out = stdout},
                 "{name:%s, table:%s, id:%d, unit:%s, samples:%zu, bad:%zu, min:%g, mean:%g, max:%g, sd:%g}",
                 name, apc_table_name(variable->table), variable->id, tag ? tag->unit : "", of->n, of->bad,
                 figure[0], figure[1], figure[2], figure[3]);
        return;
    }
    print_cell(table, PRINT_PLAIN, "%s", name);
    print_cell(table, PRINT_PLAIN, "%zu", of->n);
    print_cell(table, PRINT_PLAIN, "%zu", of->bad);
    for (size_t i = 0; i < 4; i++)
        print_number(table, 6, figure[i]);
    print_cell(table, PRINT_FAINT, "%s", tag ? tag->unit : "");
}

static int show_statistics(const struct cli *cli, struct apc_store *store, const struct apc_range *range,
                           struct rows *rows)
{
    static const struct print_column columns[] = {
        {"NAME", PRINT_LEFT},  {"SAMPLES", PRINT_POINT}, {"BAD", PRINT_POINT}, {"MIN", PRINT_POINT},
        {"MEAN", PRINT_POINT}, {"MAX", PRINT_POINT},     {"SD", PRINT_POINT},  {"UNIT", PRINT_LEFT}};
    struct print_table table;
    struct cli_tags tags;
    struct apc_sample *variables = NULL;
    int rc = cli_tags_load(cli, store, &tags);
    if (rc < 0)
        return exit_code_of(rc);
    const int n = cli_variables(cli, &tags, NULL, &variables);
    rc = exit_code_of(n);
    print_table_open(&table, columns, 8);
    for (int i = 0; i < n && rc == EXIT_OK; i++) {
        struct statistics of = {0};
        const int got =
            apc_store_history(store, variables[i].table, variables[i].id, range, take_statistics, &of);
        if (got < 0)
            rc = cli_store_error(cli, got, store);
        else
            show_statistics_of(rows, &table, &tags, &variables[i], &of);
    }
    if (rows->format == CLI_JSON && n > 0)
        end_rows(rows);
    if (rows->format == CLI_TEXT && rc == EXIT_OK && print_table_end(&table, stdout, rows->colour, 0) < 0)
        rc = cli_error(cli, APC_ENOMEM, "out of memory");
    else
        print_table_close(&table);
    free(variables);
    cli_tags_free(&tags);
    return rc;
}

static int show_event_history(const struct cli *cli, struct apc_store *store, const struct apc_range *range,
                              struct rows *rows)
{
    begin_rows(rows, PRINT_EVENT_HEADER,
               "TIME                         SEVERITY  SOURCE          KIND      TEXT");
    int rc = apc_store_events(store, range, put_event, rows);
    end_rows(rows);
    return rc < 0 ? cli_store_error(cli, rc, store) : EXIT_OK;
}

int command_history(int argc, char **argv)
{
    struct history_options options = {0};
    struct apc_range range = {0};
    struct apc_store *store = NULL;
    struct cli cli;

    cli_parse(&cli, &spec, &options, argc, argv);
    if (options.events && (cli.n_args > 0 || options.statistics))
        return cli_usage(&cli, "expected a variable or --events, not both");
    if (options.statistics && cli.format == CLI_CSV)
        return cli_usage(&cli, "--statistics has no CSV: use --json");
    if (!options.events && cli.n_args == 0)
        return cli_usage(&cli, "expected a variable, or --events");
    if (cli_time(&cli, "since", options.since, &range.since) ||
        cli_time(&cli, "until", options.until, &range.until))
        return EXIT_USAGE;
    const bool all = options.since || options.until || options.statistics;
    range.last = options.last || all ? options.last : LAST_DEFAULT;

    struct rows rows = {.format = cli.format, .colour = cli_colour(), .cli = &cli};
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK && options.events)
        rc = show_event_history(&cli, store, &range, &rows);
    else if (rc == EXIT_OK && options.statistics)
        rc = show_statistics(&cli, store, &range, &rows);
    else if (rc == EXIT_OK)
        rc = show_variables(&cli, store, &range, &rows);
    if (rc == EXIT_OK && apc_store_error(store)[0])
        cli_error(&cli, 0, "%s", apc_store_error(store)); /* there may be more than was given */
    apc_store_close(rows.names);
    apc_store_close(store);
    return cli_done(&cli, rc);
}
