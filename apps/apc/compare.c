/* SPDX-License-Identifier: BSD-3-Clause */
#include "compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "print.h"
#include "run/run_internal.h"
#include "run/simulation.h"

static const double none = (double)NAN;

/* The samples of one variable. */
struct trace {
    double *t, *value;
    size_t n;
};

static int extract(const struct samples *s, apc_ns start, const struct apc_tag *tag, struct trace *trace)
{
    *trace = (struct trace){.t = calloc(s->n + 1, sizeof(double)), .value = calloc(s->n + 1, sizeof(double))};
    if (!trace->t || !trace->value)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].table == tag->table && s->at[i].id == tag->id) {
            trace->t[trace->n] = apc_ns_to_s(s->at[i].time - start);
            trace->value[trace->n++] = s->at[i].value;
        }
    return 0;
}

static void release(struct trace *trace)
{
    free(trace->t);
    free(trace->value);
}

/* The sample next to @t in time; there is one. */
static double next_to(const struct trace *trace, double t)
{
    size_t low = 0, high = trace->n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (trace->t[middle] < t)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == trace->n || (low > 0 && t - trace->t[low - 1] < trace->t[low] - t))
        low--;
    return trace->value[low];
}

static double span(const struct trace *trace)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t i = 0; i < trace->n; i++) {
        low = fmin(low, trace->value[i]);
        high = fmax(high, trace->value[i]);
    }
    return high > low ? high - low : none;
}

/* The largest step of setpoint @id, the first one from where measurement @id begins. */
static double step_of(const struct samples *s, int id)
{
    double step = none, before = none;
    for (size_t i = 0; i < s->n && isnan(before); i++)
        if (s->at[i].table == APC_SENSOR && s->at[i].id == id)
            before = s->at[i].value;
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].table == APC_SETPOINT && s->at[i].id == id) {
            step = fmax(step, fabs(s->at[i].value - before)); /* which is the other one when step is NAN */
            before = s->at[i].value;
        }
    return step > 0 ? step : none;
}

static void print_variable(const struct samples *simulated, const struct trace *sim, const struct trace *rec,
                           const struct apc_tag *tag, struct print_table *table)
{
    double scale = tag->table == APC_SENSOR ? step_of(simulated, tag->id) : span(sim);
    double worst = 0, at = 0, sum = 0;
    for (size_t i = 0; i < rec->n; i++) {
        double apart = fabs(rec->value[i] - next_to(sim, rec->t[i]));
        sum += apart / (double)rec->n;
        if (apart > worst) {
            worst = apart;
            at = rec->t[i];
        }
    }
    print_cell(table, PRINT_PLAIN, "%s", tag->name);
    print_cell(table, PRINT_PLAIN, "%zu", rec->n);
    print_cell(table, PRINT_PLAIN, "%zu", sim->n);
    print_cell(table, PRINT_PLAIN, "%.3g", sum);
    print_cell(table, PRINT_PLAIN, "%.3g", worst);
    print_cell(table, PRINT_PLAIN, isnan(scale) ? "-" : "%.4f", 100 * worst / scale);
    print_cell(table, PRINT_PLAIN, "%.3f", at);
}

static int compare_variable(const struct samples *simulated, const struct samples *recorded,
                            const struct apc_tag *tag, struct print_table *table)
{
    struct trace sim, rec = {0};
    int rc = extract(simulated, SIMULATION_BEGIN, tag, &sim);
    if (rc == 0)
        rc = extract(recorded, 0, tag, &rec);
    if (rc == 0 && sim.n > 0 && rec.n > 0)
        print_variable(simulated, &sim, &rec, tag, table);
    release(&sim);
    release(&rec);
    return rc;
}

/* Has the run the same signals? Another name is only said: a copy of an experiment is called otherwise. */
static int check_experiment(const struct experiment *e, const char *dir, FILE *out, struct apc_error *why)
{
    struct experiment other;
    char differs[PROVISION_TEXT];
    size_t n;
    int rc = experiment_load(&other, dir, EXPERIMENT_LAW, NULL, why);
    if (rc < 0)
        return rc;
    struct apc_tag *tag = provision_tags(&other, &n);
    if (!tag)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    else if (provision_compare(e, tag, n, differs) < 0)
        rc = apc_fail(why, APC_EINVAL, "%s: %s", dir, differs);
    else if (strcmp(e->name, other.name) != 0)
        fprintf(out, "%s is a run of %s, this is %s\n", dir, other.name, e->name);
    free(tag);
    experiment_free(&other);
    return rc;
}

int compare_run(const struct samples *simulated, const struct experiment *e, const char *dir, FILE *out,
                struct apc_error *why)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},           {"recorded", PRINT_RIGHT},
                                                  {"simulated", PRINT_RIGHT}, {"mean apart", PRINT_POINT},
                                                  {"at most", PRINT_POINT},   {"% of step", PRINT_POINT},
                                                  {"at s", PRINT_POINT}};
    struct samples recorded;
    struct print_table table;
    int rc = samples_read(&recorded, dir, "samples.csv", why);

    if (rc == 0)
        rc = check_experiment(e, dir, out, why);
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; rc == 0 && i < e->dim.ny; i++)
        rc = compare_variable(simulated, &recorded, &e->y[i].tag, &table);
    for (size_t i = 0; rc == 0 && i < e->dim.nu; i++)
        rc = compare_variable(simulated, &recorded, &e->u[i].tag, &table);
    if (rc == APC_ENOMEM || (rc == 0 && print_table_show(&table, out, false, 0, "\n") < 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    print_table_close(&table);
    samples_free(&recorded);
    return rc;
}
