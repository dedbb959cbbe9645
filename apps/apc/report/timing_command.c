/* SPDX-License-Identifier: BSD-3-Clause */
/* apc timing: how well the tasks keep time, of a running loop or from history. */
#include <inttypes.h>
#include <string.h>

#include "apc/common/print.h"
#include "common/timing.h"

#define LIVE (60 * APC_NS_PER_S)

static const struct option_spec own_options[] = {
    {"since", 0, "TIME",
     "From TIME on: RFC 3339, or before now, as -30s, -10m, -2h, -1d; default -1m: the present timing",
     OPTION_TEXT, .to = 0},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[TASK...]",
    .doc = "Show for each task how late its ticks began (lateness), by how much the time between two ticks "
           "differed from the period (jitter), how long they took (run), and how many were missed. For "
           "\"exchange\", run is how long apc-client waited for the plant's replies, and missed counts "
           "failed exchanges. --json adds the histograms.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = -1,
    .options = own_options,
};

static bool wanted(const struct cli *cli, const char *task)
{
    for (int i = 0; i < cli->n_args; i++)
        if (!strcmp(cli->args[i], task))
            return true;
    return cli->n_args == 0;
}

/* Tasks that have not reported are an error only where they were asked for. */
static int check_wanted(const struct cli *cli, const struct timing *timing)
{
    for (int i = 0; i < cli->n_args; i++) {
        bool known = false;
        for (size_t k = 0; k < timing->n && !known; k++)
            known = !strcmp(timing->series[k].task, cli->args[i]);
        if (!known)
            return cli_error(cli, APC_ENOTFOUND, "task \"%s\" has reported no timing in that time",
                             cli->args[i]);
    }
    return EXIT_OK;
}

static void show_row(struct print_table *table, const struct timing_series *s)
{
    const apc_ns durations[] = {(apc_ns)s->mean, (apc_ns)s->sd, s->p50, s->p99, s->p999, s->max};
    char text[PRINT_LEN];

    print_cell(table, PRINT_PLAIN, "%s", s->quantity);
    print_cell(table, PRINT_PLAIN, "%s", s->task);
    print_cell(table, PRINT_PLAIN, "%" PRIu64, s->count);
    print_cell(table, s->missed ? PRINT_WARN : PRINT_PLAIN, "%" PRIu64, s->missed);
    for (size_t i = 0; i < sizeof durations / sizeof *durations; i++)
        print_cell(table, PRINT_PLAIN, "%s", print_duration(durations[i], text));
}

static int show_timing_table(const struct cli *cli, const struct timing *timing)
{
    static const struct print_column columns[] = {
        {"QUANTITY", PRINT_LEFT}, {"TASK", PRINT_LEFT}, {"TICKS", PRINT_RIGHT}, {"MISSED", PRINT_RIGHT},
        {"MEAN", PRINT_RIGHT},    {"SD", PRINT_RIGHT},  {"p50", PRINT_RIGHT},   {"p99", PRINT_RIGHT},
        {"p99.9", PRINT_RIGHT},   {"MAX", PRINT_RIGHT}};
    struct print_table table;

    if (timing->n == 0) {
        puts("no task has reported its timing in that time");
        return 0;
    }
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < timing->n; i++)
        if (wanted(cli, timing->series[i].task))
            show_row(&table, &timing->series[i]);
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static void show_timing_csv(const struct cli *cli, const struct timing *timing)
{
    puts(TIMING_HEADER);
    for (size_t i = 0; i < timing->n; i++)
        if (wanted(cli, timing->series[i].task))
            timing_csv(stdout, &timing->series[i]);
}

static void json_series(const struct timing_series *s, struct text *t)
{
    json_add(t, ",\n{task:%s, quantity:%s, period_ns:%jd, count:%ju, missed:%ju, mean_ns:%.1f, sd_ns:%.1f",
             s->task, s->quantity, s->period, s->count, s->missed, s->mean, s->sd);
    json_add(t, "min_ns:%jd, p50_ns:%jd, p99_ns:%jd, p999_ns:%jd, max_ns:%jd,\n bins:[", timing_min(s),
             s->p50, s->p99, s->p999, s->max);
    for (size_t i = 0; i < s->n_bins; i++)
        json_add(t, "[%jd, %jd, %ju]", s->bins[i].low, s->bins[i].high, s->bins[i].count);
    json_add(t, "]}");
}

static void show_timing_json(const struct cli *cli, const struct timing *timing)
{
    struct text t = {.out = stdout};
    json_add(&t, "[");
    for (size_t i = 0; i < timing->n; i++)
        if (wanted(cli, timing->series[i].task))
            json_series(&timing->series[i], &t);
    json_add(&t, t.last == '[' ? "]\n" : "\n]\n");
}

static int give_out(const struct cli *cli, const struct timing *timing)
{
    int rc = check_wanted(cli, timing);
    if (rc != EXIT_OK)
        return rc;
    if (cli->format == CLI_JSON)
        show_timing_json(cli, timing);
    else if (cli->format == CLI_CSV)
        show_timing_csv(cli, timing);
    else if (show_timing_table(cli, timing) < 0)
        return cli_error(cli, APC_ENOMEM, "out of memory");
    return EXIT_OK;
}

int command_timing(int argc, char **argv)
{
    apc_ns from = apc_clock_utc(NULL) - LIVE;
    const char *since = NULL;
    struct apc_store *store = NULL;
    struct timing timing = {0};
    struct cli cli;

    cli_parse(&cli, &spec, &since, argc, argv);
    if (cli_time(&cli, "since", since, &from) != EXIT_OK)
        return EXIT_USAGE;
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK) {
        int loaded = timing_load(&timing, store, &(struct apc_range){.since = from}, NULL);
        rc = loaded == 0 ? give_out(&cli, &timing) : cli_store_error(&cli, loaded, store);
    }
    timing_free(&timing);
    apc_store_close(store);
    return cli_done(&cli, rc);
}
