/* SPDX-License-Identifier: BSD-3-Clause */
#include "compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/report/gnuplot.h"
#include "experiment/experiment.h"
#include "simulation/simulation.h"

static const double none = (double)NAN;

int trace_take(struct trace *trace, const struct samples *s, apc_ns start, const struct apc_tag *tag)
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

void trace_free(struct trace *trace)
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

/* Of several, all from the lowest to the highest. */
static double traces_span(const struct trace *const *trace, size_t n)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t k = 0; k < n; k++)
        for (size_t i = 0; i < trace[k]->n; i++) {
            low = fmin(low, trace[k]->value[i]);
            high = fmax(high, trace[k]->value[i]);
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

static void print_variable(const struct compare *c, const struct trace *sim, const struct trace *rec,
                           const struct apc_tag *tag, struct print_table *table)
{
    double scale = tag->table == APC_SENSOR ? step_of(c->simulated, tag->id) : traces_span(&sim, 1);
    double worst = 0, at = 0, sum = 0;
    size_t n = 0, simulated = 0;
    for (size_t i = 0; i < sim->n; i++)
        simulated += sim->t[i] >= c->from;
    for (size_t i = 0; i < rec->n; i++) {
        if (rec->t[i] < c->from)
            continue;
        double apart = fabs(rec->value[i] - next_to(sim, rec->t[i]));
        sum += apart;
        n++;
        if (apart > worst) {
            worst = apart;
            at = rec->t[i];
        }
    }
    print_cell(table, PRINT_PLAIN, "%s", tag->name);
    print_cell(table, PRINT_PLAIN, "%zu", n);
    print_cell(table, PRINT_PLAIN, "%zu", simulated);
    print_cell(table, PRINT_PLAIN, n ? "%.3g" : "-", sum / (double)n);
    print_cell(table, PRINT_PLAIN, "%.3g", worst);
    print_cell(table, PRINT_PLAIN, isnan(scale) ? "-" : "%.4f", 100 * worst / scale);
    print_cell(table, PRINT_PLAIN, "%.3f", at);
}

struct comparison {
    const struct compare *c;
    const struct experiment *e;
    struct compare_variable *of; /* [n] */
    size_t n;
    double end; /* s */
};

static int take_compared_variable(struct comparison *z, const struct samples *recorded,
                                  const struct apc_tag *tag, const struct apc_tag *setpoint)
{
    const struct samples *simulated = z->c->simulated, *unchanged = z->c->unchanged;
    struct compare_variable *v = &z->of[z->n++];
    v->tag = tag;
    int rc = trace_take(&v->simulated, simulated, SIMULATION_BEGIN, tag);
    if (rc == 0)
        rc = trace_take(&v->recorded, recorded, 0, tag);
    if (rc == 0 && unchanged)
        rc = trace_take(&v->unchanged, unchanged, SIMULATION_BEGIN, tag);
    if (rc == 0 && setpoint)
        rc = trace_take(&v->setpoint, simulated, SIMULATION_BEGIN, setpoint);
    return rc;
}

static bool is_difference_shown(const struct compare_variable *v)
{
    return v->simulated.n > 0 && v->recorded.n > 0;
}

/* ---- The figure ----------------------------------------------------------------------------- */

#define PANELS 12
#define POINTS 4000 /* of a curve; more are no longer told apart */

static size_t panels_of(const struct compare_figure *f)
{
    size_t n = 0;
    for (size_t i = 0; i < f->n && n < PANELS; i++)
        n += is_difference_shown(&f->of[i]);
    return n;
}

/* 0: it is flat. */
static double panel_span(const struct compare_variable *v)
{
    enum { TRACES = 4 };
    const struct trace *const all[TRACES] = {&v->recorded, &v->simulated, &v->unchanged, &v->setpoint};
    const double span = traces_span(all, TRACES);
    return span > 0 ? span : 0;
}

/* Of these rows the least and the greatest, as they come; of none but NAN the first. */
static void put_extremes(FILE *script, const struct trace *trace, size_t from, size_t until)
{
    size_t low = from, high = from;
    for (size_t k = from; k < until; k++) {
        low = trace->value[k] < trace->value[low] || isnan(trace->value[low]) ? k : low;
        high = trace->value[k] > trace->value[high] || isnan(trace->value[high]) ? k : high;
    }
    const size_t first = low < high ? low : high, last = low < high ? high : low;
    fprintf(script, "%.9g %.9g\n", trace->t[first], trace->value[first]);
    if (last > first)
        fprintf(script, "%.9g %.9g\n", trace->t[last], trace->value[last]);
}

/* A value holds until the next one, the last one to the end. */
static void put_trace(FILE *script, const char *name, size_t i, const struct trace *trace, double end)
{
    const size_t step = trace->n / POINTS + 1;
    fprintf(script, "$%s%zu << END\n", name, i);
    for (size_t k = 0; k < trace->n; k += step)
        put_extremes(script, trace, k, k + step < trace->n ? k + step : trace->n);
    if (trace->n > 0)
        fprintf(script, "%.9g %.9g\n", fmax(end, trace->t[trace->n - 1]), trace->value[trace->n - 1]);
    fputs("END\n", script);
}

static void put_comparison(FILE *script, void *ctx)
{
    static const char *const arrays[] = {"name", "how", "setpoint", "unchanged", "span"};
    const struct compare_figure *f = ctx;
    size_t row = 0;
    fprintf(script, "panels = %zu\nbegin = %.9g\nfrom = %.9g\nend = %.9g\n", panels_of(f), f->begin, f->from,
            f->end);
    gnuplot_string(script, "title", f->title);
    gnuplot_string(script, "label", f->label);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        fprintf(script, "array %s[panels]\n", arrays[i]);
    for (size_t i = 0; i < f->n && row < PANELS; i++) {
        const struct compare_variable *v = &f->of[i];
        if (!is_difference_shown(v))
            continue;
        gnuplot_text(script, "name", row, v->tag->name);
        gnuplot_text(script, "how", row++, v->tag->table == APC_SENSOR ? "lines" : "steps");
        fprintf(script, "setpoint[%zu] = %d\nunchanged[%zu] = %d\nspan[%zu] = %.9g\n", row, v->setpoint.n > 0,
                row, v->unchanged.n > 0, row, panel_span(v));
        put_trace(script, "was", row, &v->recorded, f->end);
        put_trace(script, "set", row, &v->setpoint, f->end);
        put_trace(script, "else", row, &v->unchanged, f->end);
        put_trace(script, "is", row, &v->simulated, f->end);
    }
}

int compare_draw(const struct compare_figure *f, const char *name, FILE *out, struct apc_error *why)
{
    struct compare_figure figure = *f;
    if (panels_of(f) == 0)
        return apc_fail(why, APC_ENOTFOUND,
                        "%s.svg and %s.png are not drawn: no signal is there both on record and anew", name,
                        name);
    if (!(figure.end > figure.begin)) /* of one instant */
        figure.end = figure.begin + 1;
    const int rc = gnuplot_figure(name, figure_compare, put_comparison, &figure, why);
    if (rc == 0)
        fprintf(out, "figure:  %s.svg, %s.png\n", name, name);
    return rc;
}

/* ---- All of it ------------------------------------------------------------------------------ */

/* Has the run the same signals? Another name is only said: a copy of an experiment is called otherwise. */
static int check_same_signals(const struct experiment *e, const char *dir, FILE *out, struct apc_error *why)
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

static int print_comparison(const struct comparison *z, bool unchanged, FILE *out)
{
    static const struct print_column columns[] = {
        {"", PRINT_LEFT},           {"recorded", PRINT_RIGHT},
        {"simulated", PRINT_RIGHT}, {"mean difference", PRINT_POINT},
        {"largest", PRINT_POINT},   {"% of step", PRINT_POINT},
        {"at s", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < z->n; i++)
        if (is_difference_shown(&z->of[i]))
            print_variable(z->c, unchanged ? &z->of[i].unchanged : &z->of[i].simulated, &z->of[i].recorded,
                           z->of[i].tag, &table);
    const int rc = print_table_end(&table, out, false, 0);
    return rc < 0 ? APC_ENOMEM : 0;
}

static int print_all(const struct comparison *z, FILE *out)
{
    int rc = 0;
    if (z->c->unchanged) {
        fprintf(out,
                "unchanged, simulated from %g s on, compared with the record: so far the model explains the "
                "run\n",
                z->c->from);
        rc = print_comparison(z, true, out);
    }
    if (rc == 0 && z->c->from > 0)
        fprintf(out, "changed from %g s on, compared with the record\n", z->c->from);
    return rc < 0 ? rc : print_comparison(z, false, out);
}

int compare_run(const struct compare *c, const struct experiment *e, FILE *out, struct apc_error *why)
{
    struct comparison z = {
        .c = c, .e = e, .of = calloc(e->dim.ny + e->dim.nu, sizeof *z.of), .end = e->duration};
    struct samples recorded = {0};
    int rc = z.of ? samples_read(&recorded, c->dir, "samples.csv", why)
                  : apc_fail(why, APC_ENOMEM, "out of memory");

    if (rc == 0)
        rc = check_same_signals(e, c->dir, out, why);
    for (size_t i = 0; rc == 0 && i < e->dim.ny; i++)
        rc = take_compared_variable(&z, &recorded, &e->y[i].tag, i < e->dim.nz ? &e->z[i].tag : NULL);
    for (size_t i = 0; rc == 0 && i < e->dim.nu; i++)
        rc = take_compared_variable(&z, &recorded, &e->u[i].tag, NULL);
    if (rc == 0)
        rc = print_all(&z, out);
    if (rc == APC_ENOMEM)
        apc_fail(why, rc, "out of memory");
    if (rc == 0 && c->figure)
        rc = compare_draw(&(struct compare_figure){.title = e->title,
                                                   .label = c->from > 0 ? "otherwise" : "simulated",
                                                   .of = z.of,
                                                   .n = z.n,
                                                   .from = c->from,
                                                   .end = z.end},
                          c->figure, out, why);
    for (size_t i = 0; i < z.n; i++) {
        trace_free(&z.of[i].simulated);
        trace_free(&z.of[i].recorded);
        trace_free(&z.of[i].unchanged);
        trace_free(&z.of[i].setpoint);
    }
    free(z.of);
    samples_free(&recorded);
    return rc;
}
