/* SPDX-License-Identifier: BSD-3-Clause */
#include "compare.h"

#include <math.h>
#include <stdlib.h>

#include "print.h"
#include "report_data.h"
#include "simulation.h"

static const double none = (double)NAN;

/* The simulated samples of one variable. */
struct trace {
    double *t, *value;
    size_t n;
};

static int extract(const struct samples *s, enum apc_table table, int id, struct trace *trace)
{
    *trace = (struct trace){.t = calloc(s->n + 1, sizeof(double)), .value = calloc(s->n + 1, sizeof(double))};
    if (!trace->t || !trace->value)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].table == table && s->at[i].id == id) {
            trace->t[trace->n] = apc_ns_to_s(s->at[i].time - SIMULATION_BEGIN);
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

/* Of the setpoint of measurement @p id; the first from where the measurement begins. */
static double largest_step(const struct samples *s, int id)
{
    double step = none, before = none;
    for (size_t i = 0; i < s->n; i++) {
        const struct apc_sample *at = &s->at[i];
        if (at->id != id || (at->table != APC_SETPOINT && !(at->table == APC_SENSOR && isnan(before))))
            continue;
        if (!isnan(before))
            step = fmax(isnan(step) ? 0 : step, fabs(at->value - before));
        before = at->value;
    }
    return step > 0 ? step : none;
}

static int compare_variable(const struct samples *simulated, const struct report_series *recorded,
                            const struct apc_tag *tag, struct print_table *table)
{
    struct trace trace;
    double worst = 0, at = 0, sum = 0;
    int rc = extract(simulated, tag->table, tag->id, &trace);
    if (rc == 0 && trace.n > 0 && recorded->n > 0) {
        double scale = tag->table == APC_SENSOR ? largest_step(simulated, tag->id) : span(&trace);
        for (size_t i = 0; i < recorded->n; i++) {
            double apart = fabs(recorded->points[i].value - next_to(&trace, recorded->points[i].t));
            sum += apart / (double)recorded->n;
            if (apart > worst) {
                worst = apart;
                at = recorded->points[i].t;
            }
        }
        print_cell(table, PRINT_PLAIN, "%s", tag->name);
        print_cell(table, PRINT_PLAIN, "%zu", recorded->n);
        print_cell(table, PRINT_PLAIN, "%zu", trace.n);
        print_cell(table, PRINT_PLAIN, "%.3g", sum);
        print_cell(table, PRINT_PLAIN, "%.3g", worst);
        print_cell(table, PRINT_PLAIN, isnan(scale) ? "-" : "%.4f", 100 * worst / scale);
        print_cell(table, PRINT_PLAIN, "%.3f", at);
    }
    release(&trace);
    return rc;
}

int compare_run(const struct samples *simulated, const struct experiment *e, const char *dir, FILE *out,
                struct apc_error *why)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},           {"recorded", PRINT_RIGHT},
                                                  {"simulated", PRINT_RIGHT}, {"mean apart", PRINT_POINT},
                                                  {"at most", PRINT_POINT},   {"% of step", PRINT_POINT},
                                                  {"at s", PRINT_POINT}};
    struct report_data data;
    struct print_table table;
    int rc = report_read(&data, dir, why);

    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; rc == 0 && i < e->dim.ny && i < REPORT_SHOWN; i++)
        rc = compare_variable(simulated, &data.y.series[i], &e->y[i].tag, &table);
    for (size_t i = 0; rc == 0 && i < e->dim.nu && i < REPORT_SHOWN; i++)
        rc = compare_variable(simulated, &data.u.series[i], &e->u[i].tag, &table);
    if (rc == APC_ENOMEM || (rc == 0 && print_table_show(&table, out, false, 0, "\n") < 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    print_table_close(&table);
    report_free(&data);
    return rc;
}
