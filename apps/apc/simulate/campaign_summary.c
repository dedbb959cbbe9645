/* SPDX-License-Identifier: BSD-3-Clause */
#include "campaign_summary.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "files/files.h"

#define FAILURES 5 /* that are told of */

static const double none = (double)NAN;

struct trial *campaign_trial(const struct campaign *c, unsigned run)
{
    return (struct trial *)(void *)((char *)c->trials + run * c->stride);
}

/* ---- Over all runs ------------------------------------------------------------------------ */

struct statistic summary_of(const struct campaign *c, size_t loop, enum metric metric, const double *former,
                            struct column *column)
{
    const size_t at = loop * METRICS + (size_t)metric;
    column->n = 0;
    for (unsigned run = 0; run < c->options->runs; run++) {
        if (!trial_counts(campaign_trial(c, run)))
            continue;
        double value = campaign_trial(c, run)->figure[at];
        if (former) {
            double before = former[run * c->loops * METRICS + at];
            value = isinf(value) && isinf(before) ? 0 : value - before;
        }
        if (isnan(value))
            continue;
        column->value[column->n] = value;
        column->seed[column->n++] = c->options->seed + run;
    }
    return statistic_of(column->value, column->seed, column->n);
}

static const char *campaign_loop_name(const struct campaign *c, size_t loop)
{
    return c->loop[loop].name;
}

static void put_summary_row(struct print_table *table, const struct statistic *s)
{
    print_number(table, 5, s->mean);
    print_number(table, 3, s->half);
    print_number(table, 3, s->sd);
    print_number(table, 5, s->median);
    print_number(table, 5, s->p95);
    print_number(table, 5, s->p99);
    print_number(table, 5, s->worst);
    if (s->n > 0)
        print_cell(table, PRINT_PLAIN, "%llu", (unsigned long long)s->worst_seed);
    else
        print_cell(table, PRINT_PLAIN, "-");
}

static void put_difference(struct print_table *table, const struct statistic *s)
{
    print_number(table, 5, s->mean);
    print_number(table, 5, s->mean - s->half);
    print_number(table, 5, s->mean + s->half);
    print_cell(table, PRINT_PLAIN, "%s",
               isnan(s->half)          ? ""
               : s->mean - s->half > 0 ? "more"
               : s->mean + s->half < 0 ? "less"
                                       : "none to be seen");
}

static int print_table(const struct campaign *c, const struct print_column *columns, size_t n,
                       const double *former, struct column *column)
{
    struct print_table table;
    print_table_open(&table, columns, n);
    for (size_t loop = 0; loop < c->loops; loop++)
        for (int metric = 0; metric < METRICS; metric++) {
            const struct statistic s = summary_of(c, loop, (enum metric)metric, former, column);
            print_cell(&table, PRINT_PLAIN, "%s", campaign_loop_name(c, loop));
            print_cell(&table, PRINT_PLAIN, "%s", metric_name((enum metric)metric));
            print_cell(&table, PRINT_PLAIN, "%zu", s.n);
            if (former)
                put_difference(&table, &s);
            else
                put_summary_row(&table, &s);
        }
    return print_table_end(&table, c->options->talk, false, 0);
}

static void put_column_json(const struct campaign *c, const char *name, const double *former,
                            struct column *column, struct text *t)
{
    json_add(t, "%s:[", name);
    for (size_t loop = 0; loop < c->loops; loop++) {
        json_add(t, "{loop:%s", campaign_loop_name(c, loop));
        for (int metric = 0; metric < METRICS; metric++) {
            const struct statistic s = summary_of(c, loop, (enum metric)metric, former, column);
            const char *const keys[] = {metric_key((enum metric)metric),
                                        metric_former_key((enum metric)metric)};
            for (size_t k = 0; k < 2 && keys[k]; k++) {
                json_add(t, "%s:{runs:%zu, infinite:%zu, mean:%g, low95:%g, high95:%g, sd:%g", keys[k], s.n,
                         s.infinite, s.mean, s.mean - s.half, s.mean + s.half, s.sd);
                json_add(t, "median:%g, p95:%g, p99:%g, worst:%g", s.median, s.p95, s.p99, s.worst);
                if (s.n > 0)
                    json_add(t, "worst_seed:%ju", (uintmax_t)s.worst_seed);
                json_add(t, "}");
            }
        }
        json_add(t, "}");
    }
    json_add(t, "]");
}

static unsigned runs_made(const struct campaign *c)
{
    unsigned made = 0;
    for (unsigned run = 0; run < c->options->runs; run++)
        made += campaign_trial(c, run)->made;
    return made;
}

static void print_summary_json(const struct campaign *c, struct column *column)
{
    struct text t = {.out = stdout};
    json_add(&t, "{experiment:%s, runs:%u, seed:%ju, duration_s:%g", c->e->name, runs_made(c),
             (uintmax_t)c->options->seed, c->e->duration);
    put_column_json(c, "loops", NULL, column, &t);
    if (c->former)
        put_column_json(c, "differences", c->former, column, &t);
    json_add(&t, "}\n");
}

/* ---- What else is to be said -------------------------------------------------------------- */

static void print_endless(const struct campaign *c)
{
    static const struct {
        enum metric metric;
        const char *what;
    } of[] = {{METRIC_IAE, "ended early"},
              {METRIC_SETTLING, "did not settle"},
              {METRIC_RECOVERY, "did not recover"}};
    for (size_t loop = 0; loop < c->loops; loop++)
        for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
            unsigned n = 0, all = 0;
            for (unsigned run = 0; run < c->options->runs; run++) {
                double value = campaign_trial(c, run)->figure[loop * METRICS + (size_t)of[i].metric];
                bool has = trial_counts(campaign_trial(c, run)) && !isnan(value);
                all += has;
                n += has && isinf(value);
            }
            if (n > 0)
                fprintf(c->options->talk, "%s: %u of %u runs %s: they count as infinite\n",
                        campaign_loop_name(c, loop), n, all, of[i].what);
        }
}

/* What a single run tells of its controller. */
static void print_first_controller(const struct campaign *c)
{
    unsigned held = 0, failed = 0;
    for (unsigned run = 0; run < c->options->runs; run++) {
        held += campaign_trial(c, run)->held > 0;
        failed += campaign_trial(c, run)->failures > 0;
    }
    if (held > 0)
        fprintf(c->options->talk, "controller: output held or at its fault value in %u of %u runs\n", held,
                runs_made(c));
    if (failed > 0)
        fprintf(c->options->talk, "controller: law %s gave no usable output in %u of %u runs\n",
                c->e->n_controllers > 1 ? "of one" : c->e->controllers->law->name, failed, runs_made(c));
}

/* A campaign of one run many times over is a mistake, or should be known not to be one. */
static void print_equal(const struct campaign *c)
{
    const size_t size = c->loops * METRICS * sizeof(double);
    unsigned run = 1;
    while (run < c->options->runs && trial_counts(campaign_trial(c, run)) &&
           memcmp(campaign_trial(c, run)->figure, campaign_trial(c, 0)->figure, size) == 0)
        run++;
    if (run > 1 && run == c->options->runs)
        fprintf(
            c->options->talk,
            "all %u runs are the same: nothing in this experiment is random (noise, network, execution or "
            "jitter would be)\n",
            run);
}

int summary_print(const struct campaign *c, struct apc_error *why)
{
    static const struct print_column all[] = {
        {"loop", PRINT_LEFT},     {"", PRINT_LEFT},       {"runs", PRINT_RIGHT},    {"mean", PRINT_POINT},
        {"+- 95 %", PRINT_POINT}, {"sd", PRINT_POINT},    {"median", PRINT_POINT},  {"95 %", PRINT_POINT},
        {"99 %", PRINT_POINT},    {"worst", PRINT_POINT}, {"its seed", PRINT_RIGHT}};
    static const struct print_column paired[] = {{"loop", PRINT_LEFT},
                                                 {"", PRINT_LEFT},
                                                 {"pairs", PRINT_RIGHT},
                                                 {"mean difference", PRINT_POINT},
                                                 {"95 % from", PRINT_POINT},
                                                 {"to", PRINT_POINT},
                                                 {"", PRINT_LEFT}};
    const size_t runs = c->options->runs;
    struct column column = {calloc(runs, sizeof(double)), calloc(runs, sizeof(uint64_t)), 0};
    int rc = column.value && column.seed ? 0 : APC_ENOMEM;
    if (rc == 0 && c->options->json) {
        print_summary_json(c, &column);
    } else if (rc == 0) {
        rc = print_table(c, all, sizeof all / sizeof *all, NULL, &column);
        if (rc == 0 && c->former) {
            fprintf(c->options->talk, "compared with %s, seed by seed:\n", c->options->against);
            rc = print_table(c, paired, sizeof paired / sizeof *paired, c->former, &column);
        }
        print_endless(c);
        print_first_controller(c);
        print_equal(c);
    }
    free(column.value);
    free(column.seed);
    return rc < 0 ? apc_fail(why, rc, "out of memory") : 0;
}

int summary_failures(const struct campaign *c, struct apc_error *why)
{
    unsigned failed = 0, missing = 0;
    int first = 0;
    for (unsigned run = 0; run < c->options->runs; run++) {
        const struct trial *r = campaign_trial(c, run);
        missing += !r->made;
        if (!r->made || r->rc == 0)
            continue;
        if (failed++ < FAILURES)
            fprintf(c->options->talk, "seed %llu: %s\n", (unsigned long long)c->options->seed + run, r->why);
        if (first == 0)
            first = r->rc;
    }
    if (missing > 0)
        fprintf(c->options->talk, "%u of %u runs were not made\n", missing, c->options->runs);
    if (failed > 0)
        return apc_fail(why, first, "%u of %u runs ended early", failed, c->options->runs);
    if (missing == 0)
        return 0;
    return atomic_load(&c->pool->stop)
               ? apc_fail(why, APC_ESTATE, "ended by a signal: %u of %u runs were made",
                          c->options->runs - missing, c->options->runs)
               : apc_fail(why, APC_ESYS, "a process of the campaign ended: runs are missing");
}

/* ---- The file of the runs ----------------------------------------------------------------- */

/* @p former: with the names of files of the version before. */
static void put_header(FILE *out, bool former)
{
    fputs("seed,loop", out);
    for (int i = 0; i < METRICS; i++) {
        const char *key = metric_former_key((enum metric)i);
        fprintf(out, ",%s", former && key ? key : metric_key((enum metric)i));
    }
}

int summary_csv(const struct campaign *c, struct apc_error *why)
{
    const char *path = c->options->csv;
    FILE *out = !strcmp(path, "-") ? stdout : fopen(path, "we");
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    put_header(out, false);
    fputc('\n', out);
    for (unsigned run = 0; run < c->options->runs; run++)
        for (size_t loop = 0; loop < c->loops && trial_counts(campaign_trial(c, run)); loop++) {
            fprintf(out, "%llu,%zu", (unsigned long long)c->options->seed + run, loop + 1);
            for (int i = 0; i < METRICS; i++) {
                char value[40] = "";
                double figure = campaign_trial(c, run)->figure[loop * METRICS + (size_t)i];
                if (isfinite(figure))
                    apc_number_format(figure, value, sizeof value);
                fprintf(out, ",%s", isinf(figure) ? "inf" : value);
            }
            fputc('\n', out);
        }
    bool failed = ferror(out) != 0;
    failed |= out == stdout ? fflush(out) != 0 : fclose(out) != 0;
    return failed ? apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno)) : 0;
}

/* A row of it into c->former, if it is of one of our seeds. */
static int take_former_row(struct campaign *c, struct csv *csv, struct apc_error *why)
{
    char *end;
    double loop;
    const uint64_t seed = strtoull(csv_text(csv, 0), &end, 10);
    int rc = csv_number(csv, 1, &loop, why);

    if (*end || end == csv_text(csv, 0))
        return csv_refuse_field(csv, 0, why, "\"%.40s\" is no seed", csv_text(csv, 0));
    if (rc == 0 && !(loop >= 1 && loop <= (double)c->loops && loop == floor(loop)))
        return csv_refuse_field(csv, 1, why, "\"%.40s\": expected a campaign with %zu loops",
                                csv_text(csv, 1), c->loops);
    if (rc < 0 || seed < c->options->seed || seed - c->options->seed >= c->options->runs)
        return rc;
    double *figure = c->former + ((seed - c->options->seed) * c->loops + (size_t)loop - 1) * METRICS;
    for (size_t i = 0; i < METRICS && rc == 0; i++) {
        const bool endless = !strcmp(csv_text(csv, 2 + i), "inf");

        figure[i] = endless ? HUGE_VAL : none;
        if (!endless && !csv_missing(csv, 2 + i))
            rc = csv_number(csv, 2 + i, &figure[i], why);
    }
    return rc;
}

/* Has it the columns of such a file? Returns 0, APC_EPROTO or APC_ENOMEM. @p former: as the version before
 * wrote them. */
static int expect_header(const struct csv *csv, bool former, struct apc_error *why)
{
    char *header = NULL;
    size_t length = 0;
    FILE *expected = open_memstream(&header, &length);

    if (expected) {
        put_header(expected, former);
        fclose(expected);
    }
    const int rc = header ? csv_expect(csv, header, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    free(header);
    return rc;
}

int summary_read(struct campaign *c, struct apc_error *why)
{
    const size_t n = c->options->runs * c->loops * METRICS;
    struct csv *csv = NULL;

    c->former = calloc(n + 1, sizeof *c->former);
    if (!c->former)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n; i++)
        c->former[i] = none;
    int rc = csv_open(&csv, c->options->against, why);
    if (rc == 0 && expect_header(csv, false, why) < 0 && expect_header(csv, true, why) < 0)
        rc = csv_refuse(csv, why, "expected the file of another campaign (--runs N --csv FILE)");
    while (rc == 0 && (rc = csv_next(csv, why)) > 0)
        rc = take_former_row(c, csv, why);
    csv_close(csv);
    return rc;
}
