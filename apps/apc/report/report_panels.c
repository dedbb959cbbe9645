/* SPDX-License-Identifier: BSD-3-Clause */
/* The process variables of a run, and what happened, as report.gp draws them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "report_panels.h"

#define LINES_MAX 40    /* of warnings and alarms; more would be a curtain */
#define BINS      2000  /* of a long curve: more than the figure has pixels; of all curves 40 times that */
#define NONE      1e305 /* beyond all values */

/* The styles of vertical lines, in the order of report.gp. */
enum { LINE_PLANNED = 1, LINE_EXPECTED, LINE_WARNING, LINE_ALARM };

/* A text at its time. */
struct mark {
    double t;
    unsigned colour;
    char text[100];
};

int report_panels_create(struct report_panels **panels, const struct report_data *data,
                         const struct experiment *e)
{
    struct report_panels *p = calloc(1, sizeof *p);
    *panels = p;
    if (!p)
        return APC_ENOMEM;
    p->data = data;
    p->e = e;
    if (controllers_describe(e, &p->loops) < 0 || report_arrange(p) < 0) {
        report_panels_destroy(p);
        *panels = NULL;
        return APC_ENOMEM;
    }
    return 0;
}

void report_panels_destroy(struct report_panels *panels)
{
    if (!panels)
        return;
    loops_free(&panels->loops);
    free(panels->curve);
    free(panels->shadow);
    free(panels);
}

/* ---- Curves ------------------------------------------------------------------------------- */

static double finite_limit(double value)
{
    return fmax(-NONE, fmin(NONE, value));
}

static bool has_limited(const struct report_series *series)
{
    for (size_t k = 0; series && k < series->n; k++)
        if (series->points[k].limited)
            return true;
    return false;
}

static bool has_doubtful(const struct report_series *series)
{
    for (size_t k = 0; series && k < series->n; k++)
        if (series->points[k].severity != APC_SEVERITY_GOOD)
            return true;
    return false;
}

/* A point with what came before it, or NULL. Columns: t, value, value where a limit holds it back, value where
 * it is not Good. A Bad measurement (@p gap > 0) is none, a Bad output still went out. */
static void put_series_point(FILE *script, const struct report_point *at, const struct report_point *before,
                             double gap)
{
    const double doubtful = at->severity == APC_SEVERITY_GOOD ? (double)NAN : at->value;
    if (gap > 0 && at->severity == APC_SEVERITY_BAD) {
        fprintf(script, "%.9g NaN NaN %.9g\n", at->t, doubtful);
        return;
    }
    if (gap > 0 && before && at->t - before->t > gap)
        fputc('\n', script);
    fprintf(script, "%.9g %.9g %.9g %.9g\n", at->t, at->value,
            at->limited                 ? at->value
            : before && before->limited ? before->value
                                        : (double)NAN,
            doubtful);
}

/* Where the points end that the figure cannot show apart from point @p k: of one bin of time and one quality,
 * without a gap. */
static size_t end_of_bin(const struct report_series *series, size_t k, double bin, double gap)
{
    const struct report_point *first = &series->points[k], *at = first + 1;
    const struct report_point *end = series->points + series->n;
    while (at < end && at->t - first->t < bin && at->limited == first->limited &&
           at->severity == first->severity && (gap <= 0 || at->t - at[-1].t <= gap))
        at++;
    return (size_t)(at - series->points);
}

/* A table that report.gp names only where there is one: gnuplot takes long to find a name among thousands. Of a
 * long series the first, last, lowest and highest point of each bin. An output and a setpoint hold until
 * the next one (@p gap 0). Nobody knows what was between two measurements that are farther apart than @p gap,
 * in s. */
static void put_series(FILE *script, const char *name, size_t i, const struct report_series *series,
                       const struct report_panels *p, double gap)
{
    if (!series)
        return;
    const size_t n = series->n, bins = p->n_drawn > 40 ? (size_t)40 * BINS / p->n_drawn + 100 : BINS;
    const double bin = n > 4 * bins ? (series->points[n - 1].t - series->points[0].t) / (double)bins : 0;
    const struct report_point *before = NULL;
    fprintf(script, "$%s%zu << END\n", name, i + 1);
    for (size_t first = 0, next; first < n; first = next) {
        size_t low = first, high = first;
        next = end_of_bin(series, first, bin, gap);
        for (size_t k = first; k < next; k++) {
            low = series->points[k].value < series->points[low].value ? k : low;
            high = series->points[k].value > series->points[high].value ? k : high;
        }
        for (size_t k = first; k < next; k++)
            if (k == first || k == low || k == high || k == next - 1) {
                const struct report_point *at = &series->points[k];
                put_series_point(script, at, k == first ? before : at - 1, gap);
                before = gap > 0 && at->severity == APC_SEVERITY_BAD ? before : at;
            }
    }
    if (gap <= 0 && before)
        fprintf(script, "%.9g %.9g NaN NaN\n", p->data->end, before->value);
    fputs("END\n", script);
}

/* The last move holds for its step, too. */
static void put_expected(FILE *script, size_t i, const struct prediction_trajectory *c)
{
    if (!c)
        return;
    fprintf(script, "$e%zu << END\n", i + 1);
    for (size_t k = 0; k < c->n + (c->first == 0); k++)
        fprintf(script, "%.9g %.9g\n", apc_ns_to_s(c->made) + prediction_ahead(c, k),
                c->expected[k < c->n ? k : c->n - 1]);
    fputs("END\n", script);
}

static double gap_of(const struct report_panels *p, const struct curve_of *c)
{
    const struct wire wire = {APC_SENSOR, (size_t)c->signal->tag.id - 1};
    return c->signal->tag.table == APC_SENSOR ? apc_ns_to_s(module_horizon(p->e, wire)) : 0;
}

static void put_curve(FILE *script, const struct report_panels *p, size_t i)
{
    const struct curve_of *c = &p->curve[i];
    put_series(script, "v", i, c->series, p, gap_of(p, c));
    put_series(script, "r", i, c->wanted, p, 0);
    put_series(script, "a", i, c->wanted_above, p, 0);
    put_expected(script, i, c->expected);
    gnuplot_text(script, "name", i, c->signal->tag.name);
    gnuplot_text(script, "description", i, c->signal->tag.description);
    gnuplot_text(script, "unit_of", i, c->signal->tag.unit);
    if (!c->above)
        return;
    const struct wire moved = {APC_SETPOINT, (size_t)(c->setpoint - p->e->z)};
    const struct controller *above = controllers_above(p->e, moved).of;
    gnuplot_text(script, "setpoint", i, c->setpoint->tag.name);
    gnuplot_text(script, "setpoint_above", i, c->above->tag.name);
    gnuplot_text(script, "mover", i, above ? above->name : "above");
}

/* A line each, of the curves and the panels. */
static void put_tables(FILE *script, const struct report_panels *p)
{
    fputs("$curve << END\n", script);
    for (size_t i = 0; i < p->n_drawn; i++) {
        const struct curve_of *c = &p->curve[i];
        fprintf(script, "%#.9g %#.9g %#.9g %#.9g %zu %d %d %d %d %d\n", finite_limit(c->low),
                finite_limit(c->high), finite_limit(c->least), finite_limit(c->most),
                c->series ? c->series->n : 0, c->wanted != NULL, c->above != NULL,
                !c->expected              ? 0
                : c->expected->first == 0 ? 2
                                          : 1,
                has_limited(c->series), has_doubtful(c->series));
    }
    fputs("END\n$panel << END\n", script);
    for (size_t k = 0; k < p->n; k++)
        fprintf(script, "%zu %zu %d %d %zu\n", p->panel[k].first + 1, p->panel[k].n, p->panel[k].outputs,
                p->panel[k].bundle != NULL, p->panel[k].worst);
    fputs("END\n", script);
}

/* ---- What happened ------------------------------------------------------------------------ */

static bool is_time_shown(const struct report_panels *p, double t)
{
    return t >= p->data->begin && t <= p->data->end;
}

static int by_mark_time(const void *left, const void *right)
{
    const struct mark *a = left, *b = right;
    return (a->t > b->t) - (a->t < b->t);
}

/* What is planned: disturbances, and who is killed or started, by time; other actions show in setpoints and
 * modes. Returns how many. */
static size_t collect_planned(const struct report_panels *p, struct mark *mark)
{
    const struct experiment *e = p->e;
    size_t n = 0;
    for (size_t i = 0; e->plant.model && i < e->plant.n_disturbances; i++) {
        const struct apc_disturbance *d = &e->plant.disturbance[i];
        const struct apc_param *of = &e->plant.model->disturbance[d->k];
        const bool unit = of->unit && *of->unit && strcmp(of->unit, "1") != 0;
        mark[n].t = apc_ns_to_s(e->plant.rhythm.phase + d->at);
        snprintf(mark[n].text, sizeof mark->text, "%.40s = %.6g%s%.30s", of->name, d->value, unit ? " " : "",
                 unit ? of->unit : "");
        n += is_time_shown(p, mark[n].t);
    }
    for (size_t i = 0; i < e->n_actions; i++) {
        const struct action *a = &e->action[i];
        mark[n].t = apc_ns_to_s(a->at);
        if (a->kind == ACTION_WRITE || !is_time_shown(p, mark[n].t))
            continue;
        snprintf(mark[n++].text, sizeof mark->text, "%s %s", e->controllers[a->controller].name,
                 a->kind == ACTION_KILL ? "killed" : "started");
    }
    qsort(mark, n, sizeof *mark, by_mark_time);
    return n;
}

static void put_mark(FILE *script, double t, unsigned colour, const char *text)
{
    fprintf(script, "%#.9g %u ", t, colour);
    gnuplot_characters(script, text);
    fputc('\n', script);
}

/* By time, what is planned and what was out of the ordinary; of events of one kind in a row the first. */
static void put_marks(FILE *script, const struct report_panels *p, const struct mark *planned, size_t n)
{
    const struct report_data *data = p->data;
    fputs("$mark << END\n", script);
    for (size_t i = 0, k = 0; i < n || k < data->n_events;)
        if (k == data->n_events || (i < n && planned[i].t <= data->event[k].t)) {
            put_mark(script, planned[i].t, 0x555555, planned[i].text);
            i++;
        } else {
            const struct report_event *event = &data->event[k++];
            if (k < 2 || strcmp(event->kind, event[-1].kind) != 0)
                put_mark(script, event->t, event->alarm ? 0xB03A2E : 0xA87900, event->kind);
        }
    fputs("END\n$line << END\n", script);
    for (size_t i = 0; i < n; i++)
        fprintf(script, "%#.9g %d\n", planned[i].t, LINE_PLANNED);
    for (size_t i = 0; data->expected && i < data->expected->n; i++)
        fprintf(script, "%#.9g %d\n", apc_ns_to_s(data->expected->trajectory[i].made), LINE_EXPECTED);
    for (size_t i = 0; i < data->n_events && data->n_events <= LINES_MAX; i++)
        fprintf(script, "%#.9g %d\n", data->event[i].t, data->event[i].alarm ? LINE_ALARM : LINE_WARNING);
    fputs("END\n", script);
}

void report_panels_put(FILE *script, const struct report_panels *p)
{
    static const char *const arrays[] = {"name",     "description",    "unit_of",
                                         "setpoint", "setpoint_above", "mover"};
    const struct experiment *e = p->e;
    const size_t plans = (e->plant.model ? e->plant.n_disturbances : 0) + e->n_actions;
    struct mark *planned = calloc(plans + 1, sizeof *planned); /* without memory nothing is said of it */

    fprintf(script, "begin = %.9g\nend_of_run = %.9g\nstrip = %d\n", p->data->begin, p->data->end,
            p->data->n_events > 0 || plans > 0);
    fprintf(script, "panels = %zu\ndrawn = %zu\nvariables = %zu\narray controller[%zu]\n", p->n, p->n_drawn,
            p->n_curves, p->n + 1);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        fprintf(script, "array %s[%zu]\n", arrays[i], p->n_drawn + 1);
    put_tables(script, p);
    for (size_t i = 0; i < p->n_drawn; i++)
        put_curve(script, p, i);
    for (size_t k = 0; k < p->n; k++)
        gnuplot_text(script, "controller", k, p->panel[k].bundle ? p->panel[k].bundle->name : "");
    put_marks(script, p, planned, planned ? collect_planned(p, planned) : 0);
    free(planned);
    report_lanes_put(script, p->data, e, &p->loops);
}
