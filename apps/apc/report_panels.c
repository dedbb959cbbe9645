/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The process variables over time. What has one unit, and is about as large, shares a panel: measurements
 * with their setpoints first, then outputs. Above them, what happened: disturbances, warnings, alarms.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "report_script.h"
#include "run/figures.h"

#define STRIP_HEIGHT 20.0 /* of what happened */
#define KEY_HEIGHT   24.0 /* above each panel */
#define PANEL_HEIGHT 112.0
#define FOOT_HEIGHT  52.0 /* numbers and name of the time axis */
#define PANELS_MAX   40
#define CURVES_NAMED 8    /* of a panel: more have no names in its legend */
#define LINES_MAX    40   /* of warnings and alarms; more would be a curtain */
#define SMALL        15   /* a curve moves at least by this part of what its panel shows */
#define NEAR         0.12 /* of the range: a limit so far beyond the data is shown */
#define LABEL_MAX    12   /* letters of names at the axis */
#define LETTER       6.6  /* width of one, on average */

static const unsigned colours[] = {0x0072B2, 0x009E73, 0xCC79A7, 0x56B4E9,
                                   0x7A5195, 0x000000, 0x999999, 0x8C6D31};
#define COLOURS (sizeof colours / sizeof *colours)

/* A variable that is drawn: a measurement, perhaps with its setpoint; or an output. */
struct curve_of {
    const struct signal *signal;
    const struct report_series *series, *wanted; /* wanted: of the setpoint; NULL: none */
    const struct signal *setpoint;
    double low, high; /* of all that is drawn of it; low > high: nothing */
};

struct panel {
    size_t first, n; /* of its curves */
    bool outputs;
    double low, high, scale, tick; /* range and ticks in units of the scale, 10^power */
    int power;
};

struct report_panels {
    const struct report_data *data;
    const struct experiment *e;
    struct curve_of *curve; /* [n_curves] in the order of the panels */
    size_t n_curves, n_drawn;
    struct panel panel[PANELS_MAX];
    size_t n, few;    /* few: curves that a panel may have */
    double end, unit; /* s: of the time axis; of its numbers */
    double gap; /* s: no line between measurements that are farther apart: nobody knows what was there */
    const char *unit_name;
};

/* ---- Which curve goes where --------------------------------------------------------------- */

static void widen(struct curve_of *c, const struct report_series *series, bool bad_too)
{
    for (size_t k = 0; series && k < series->n; k++) {
        const struct report_point *p = &series->points[k];
        if (!bad_too && p->severity == APC_SEVERITY_BAD)
            continue;
        c->low = fmin(c->low, p->value);
        c->high = fmax(c->high, p->value);
    }
}

static const struct report_series *series_of(const struct report_group *group, size_t i)
{
    return i < group->n && group->series[i].n > 0 ? &group->series[i] : NULL;
}

static int collect(struct report_panels *p)
{
    const struct experiment *e = p->e;
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    bool *shown = calloc(e->dim.nz + 1, sizeof *shown);
    p->curve = calloc(e->dim.ny + e->dim.nz + e->dim.nu + 1, sizeof *p->curve);
    if (!loop || !shown || !p->curve) {
        free(loop);
        free(shown);
        return APC_ENOMEM;
    }
    const size_t loops = metrics_loops(e, loop);
    for (size_t i = 0; i < e->dim.ny; i++) {
        struct curve_of c = {&e->y[i], series_of(&p->data->y, i), NULL, NULL, HUGE_VAL, -HUGE_VAL};
        for (size_t k = 0; k < loops; k++)
            if (loop[k].y == i && !shown[loop[k].z]) {
                c.wanted = series_of(&p->data->z, loop[k].z);
                c.setpoint = &e->z[loop[k].z];
                shown[loop[k].z] = true;
                break;
            }
        widen(&c, c.series, false);
        widen(&c, c.wanted, true);
        p->curve[p->n_curves++] = c;
    }
    for (size_t i = 0; i < e->dim.nz; i++)
        if (!shown[i]) {
            struct curve_of c = {&e->z[i], NULL, series_of(&p->data->z, i), &e->z[i], HUGE_VAL, -HUGE_VAL};
            widen(&c, c.wanted, true);
            p->curve[p->n_curves++] = c;
        }
    for (size_t i = 0; i < e->dim.nu; i++) {
        struct curve_of c = {&e->u[i], series_of(&p->data->u, i), NULL, NULL, HUGE_VAL, -HUGE_VAL};
        widen(&c, c.series, true);
        p->curve[p->n_curves++] = c;
    }
    free(loop);
    free(shown);
    return 0;
}

static bool is_output(const struct curve_of *c)
{
    return c->signal->tag.table == APC_ACTUATOR;
}

static double span(const struct curve_of *c)
{
    return c->high > c->low ? c->high - c->low : 0;
}

/* Would the panel still show how each of its curves moves? */
static bool fits(const struct report_panels *p, const struct panel *panel, const struct curve_of *c)
{
    const struct curve_of *first = &p->curve[panel->first];
    double low = c->low, high = c->high, least = span(c);
    if (panel->n >= p->few || panel->outputs != is_output(c) ||
        strcmp(first->signal->tag.unit, c->signal->tag.unit) != 0)
        return false;
    for (size_t i = 0; i < panel->n; i++) {
        low = fmin(low, first[i].low);
        high = fmax(high, first[i].high);
        least = fmin(least, span(&first[i]));
    }
    return !(high > low) || p->few > 4 || SMALL * least >= high - low;
}

/* Each curve to the first panel that it fits into, of those with at most @few curves; the curves are put in
 * the order of the panels. False when that takes more than @most panels. */
static bool arrange(struct report_panels *p, size_t few, size_t most)
{
    p->n = p->n_drawn = 0;
    p->few = few;
    for (size_t i = 0; i < p->n_curves; i++) {
        const struct curve_of c = p->curve[i];
        size_t k = 0;
        while (k < p->n && !fits(p, &p->panel[k], &c))
            k++;
        if (k == most)
            return false;
        if (k == p->n)
            p->panel[p->n++] = (struct panel){.first = i, .outputs = is_output(&c)};
        const size_t to = p->panel[k].first + p->panel[k].n++;
        memmove(&p->curve[to + 1], &p->curve[to], (i - to) * sizeof *p->curve);
        p->curve[to] = c;
        for (size_t next = k + 1; next < p->n; next++)
            p->panel[next].first++;
        p->n_drawn++;
    }
    return true;
}

/* ---- Ranges ------------------------------------------------------------------------------- */

/* A limit is shown where the curve comes near it. */
static bool near(const struct panel *panel, double limit)
{
    double room = NEAR * (panel->high - panel->low);
    return limit >= panel->low - room && limit <= panel->high + room;
}

/* Values of many digits are drawn in thousands, millionths, ...: the axis says so in its label. */
static void settle(const struct report_panels *p, struct panel *panel)
{
    static const double steps[] = {1, 2, 2.5, 5, 10};
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t i = panel->first; i < panel->first + panel->n; i++) {
        low = fmin(low, p->curve[i].low);
        high = fmax(high, p->curve[i].high);
    }
    if (low > high)
        low = high = 0;
    double most = fmax(fabs(low), fabs(high));
    panel->power =
        most >= 1e4 || (most > 0 && most < 1e-2) ? 3 * (int)floor(fmax(log10(most), -300) / 3 + 1e-9) : 0;
    panel->scale = pow(10, panel->power);
    panel->low = low;
    panel->high = high;
    for (size_t i = panel->first; i < panel->first + panel->n && high > low; i++) {
        const struct apc_tag *tag = &p->curve[i].signal->tag;
        if (near(panel, tag->low))
            low = fmin(low, tag->low);
        if (near(panel, tag->high))
            high = fmax(high, tag->high);
    }
    double room = 0.08 * (high - low);
    if (room <= 1e-6 * most)
        room = most > 0 ? 0.1 * most : 1;
    panel->low = (low - room) / panel->scale;
    panel->high = (high + room) / panel->scale;
    double range = panel->high - panel->low, decade = pow(10, floor(log10(range / 6)));
    size_t k = 0;
    while (k + 1 < sizeof steps / sizeof *steps && range / (steps[k] * decade) > 6)
        k++;
    panel->tick = steps[k] * decade;
}

static void settle_time(struct report_panels *p)
{
    static const struct {
        double from, unit;
        const char *name;
    } units[] = {{3 * 86400, 86400, "d"}, {5 * 3600, 3600, "h"}, {3000, 60, "min"}, {0, 1, "s"}};
    size_t k = 0;
    double end = p->data->end > 1e-3 ? p->data->end : 1, digit;
    while (end < units[k].from)
        k++;
    p->unit = units[k].unit;
    p->unit_name = units[k].name;
    end /= p->unit;
    digit = pow(10, floor(log10(end)) - 1); /* the axis ends on the second digit of the last time */
    p->end = p->unit * ceil(end / digit * (1 - 1e-9)) * digit;
}

int report_panels_create(struct report_panels **panels, const struct report_data *data,
                         const struct experiment *e)
{
    struct report_panels *p = calloc(1, sizeof *p);
    *panels = p;
    if (!p)
        return APC_ENOMEM;
    p->data = data;
    p->e = e;
    if (collect(p) < 0) {
        report_panels_destroy(p);
        *panels = NULL;
        return APC_ENOMEM;
    }
    /* few curves in a panel, unless that makes too many panels */
    (void)(arrange(p, 4, 16) || arrange(p, CURVES_NAMED, 24) ||
           arrange(p, (size_t)2 * CURVES_NAMED, PANELS_MAX));
    for (size_t i = 0; i < p->n; i++)
        settle(p, &p->panel[i]);
    settle_time(p);
    const apc_ns plant = e->plant.rhythm.period, client = e->client.rhythm.period;
    p->gap = 3 * apc_ns_to_s(client > plant ? client : plant) + 0.1;
    return 0;
}

void report_panels_destroy(struct report_panels *panels)
{
    if (!panels)
        return;
    free(panels->curve);
    free(panels);
}

static double strip_height(const struct report_panels *p)
{
    return p->data->n_events > 0 || (p->e->plant.model && p->e->plant.n_disturbances > 0) ? STRIP_HEIGHT : 0;
}

double report_panels_height(const struct report_panels *p)
{
    return strip_height(p) + (double)p->n * (KEY_HEIGHT + PANEL_HEIGHT) + FOOT_HEIGHT;
}

/* ---- Blocks ------------------------------------------------------------------------------- */

/* Columns: t, value, value where a limit holds it back. An output and a setpoint hold until the next one; a
 * Bad measurement is none, a Bad output still went out. */
static void put_series(FILE *script, const struct report_panels *p, const struct report_series *series,
                       double scale, bool holds)
{
    const struct report_point *before = NULL;
    for (size_t k = 0; series && k < series->n; k++) {
        const struct report_point *at = &series->points[k];
        if (!holds && at->severity == APC_SEVERITY_BAD) {
            fputc('\n', script);
            continue;
        }
        if (!holds && before && at->t - before->t > p->gap)
            fputc('\n', script);
        fprintf(script, "%.9g %.9g ", at->t / p->unit, at->value / scale);
        if (at->limited)
            fprintf(script, "%.9g\n", at->value / scale);
        else if (before && before->limited)
            fprintf(script, "%.9g\n", before->value / scale);
        else
            fputs("NaN\n", script);
        before = at;
    }
    if (holds && before)
        fprintf(script, "%.9g %.9g %s\n", p->data->end / p->unit, before->value / scale, "NaN");
}

static bool has_doubtful(const struct report_series *series)
{
    for (size_t k = 0; series && k < series->n; k++)
        if (series->points[k].severity != APC_SEVERITY_GOOD)
            return true;
    return false;
}

static bool has_limited(const struct report_series *series)
{
    for (size_t k = 0; series && k < series->n; k++)
        if (series->points[k].limited)
            return true;
    return false;
}

static void put_doubtful(FILE *script, const struct report_panels *p, const struct panel *panel,
                         const struct report_series *series)
{
    for (size_t k = 0; series && k < series->n; k++)
        if (series->points[k].severity != APC_SEVERITY_GOOD)
            fprintf(script, "%.9g %.9g\n", series->points[k].t / p->unit,
                    fmin(fmax(series->points[k].value / panel->scale, panel->low), panel->high));
}

void report_panels_blocks(FILE *script, const struct report_panels *p)
{
    for (size_t k = 0; k < p->n; k++)
        for (size_t i = p->panel[k].first; i < p->panel[k].first + p->panel[k].n; i++) {
            const struct curve_of *c = &p->curve[i];
            fprintf(script, "$v%zu << END\n", i);
            put_series(script, p, c->series, p->panel[k].scale, is_output(c));
            fprintf(script, "END\n$r%zu << END\n", i);
            put_series(script, p, c->wanted, p->panel[k].scale, true);
            fprintf(script, "END\n$d%zu << END\n", i);
            put_doubtful(script, p, &p->panel[k], c->series);
            fputs("END\n", script);
        }
}

/* ---- Panels ------------------------------------------------------------------------------- */

/* Units as one writes them. */
static void pretty(const char *unit, char *text, size_t size)
{
    static const struct {
        const char *from, *to;
    } of[] = {{"degC", "°C"}, {"m3", "m³"}, {"m2", "m²"}, {"ohm", "Ω"}};
    size_t used = 0;
    while (*unit && used + 8 < size) {
        size_t k = 0;
        while (k < sizeof of / sizeof *of && strncmp(unit, of[k].from, strlen(of[k].from)) != 0)
            k++;
        if (k < sizeof of / sizeof *of) {
            used += (size_t)snprintf(text + used, size - used, "%s", of[k].to);
            unit += strlen(of[k].from);
        } else {
            text[used++] = *unit++;
        }
    }
    text[used] = '\0';
}

static void put_margins(FILE *script, double top, double height, double of_panel)
{
    fprintf(script, "%sset tmargin at screen %.5f\nset bmargin at screen %.5f\n", report_panel_style,
            report_screen(top, height), report_screen(top + of_panel, height));
    fputs("set lmargin at screen 0.105\nset rmargin at screen 0.96\n", script);
}

/* What stands at the axis: "h1, h2  (cm)". */
static void put_label(FILE *script, const struct report_panels *p, const struct panel *panel)
{
    char text[200] = "", unit[2 * APC_TAG_LEN];
    const struct curve_of *first = &p->curve[panel->first];
    size_t used = 0, letters = 0;
    for (size_t i = 0; i < panel->n; i++)
        letters += strlen(first[i].signal->tag.name) + 2;
    for (size_t i = 0; i < panel->n && letters <= LABEL_MAX && used < sizeof text; i++)
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s", i ? ", " : "",
                                 first[i].signal->tag.name);
    if (used == 0)
        used = (size_t)snprintf(text, sizeof text, "%.20s%s%.20s", first->signal->tag.name,
                                panel->n > 1 ? " … " : "",
                                panel->n > 1 ? first[panel->n - 1].signal->tag.name : "");
    pretty(first->signal->tag.unit, unit, sizeof unit);
    if (panel->power != 0 && used < sizeof text)
        snprintf(text + used, sizeof text - used, " (10^%d%s%s)", panel->power, *unit ? " " : "", unit);
    else if (*unit && used < sizeof text)
        snprintf(text + used, sizeof text - used, " (%s)", unit);
    fputs("set label 6 ", script);
    report_quoted(script, text);
    fputs(" at screen 0.02, graph 0.5 center rotate noenhanced\n", script);
}

/* A loop has one colour in both its panels; a single output has another than a single measurement. */
static unsigned colour_of(const struct panel *panel, size_t i)
{
    return colours[panel->outputs && panel->n == 1 ? 1 : i % COLOURS];
}

/* Is a limit of a curve within the panel? One of a curve that does not move is no news. */
static bool shows(const struct panel *panel, const struct curve_of *c, double limit)
{
    double at = limit / panel->scale;
    return c->low < c->high && at >= panel->low && at <= panel->high;
}

/* The legend stands above the panel, one entry after another: gnuplot's own has columns as wide as its
 * widest. */
struct legend {
    double x, y; /* of the next entry: units from the left; fraction of the page */
};

static void put_entry(FILE *script, struct legend *l, const char *style, const char *text)
{
    const double begin = l->x / REPORT_WIDTH, line = 22 / REPORT_WIDTH;
    fprintf(script,
            "set arrow from screen %.5f, screen %.5f to screen %.5f, screen %.5f nohead %s\nset label ",
            begin, l->y, begin + line, l->y, style);
    report_quoted(script, text);
    fprintf(script, " at screen %.5f, screen %.5f left noenhanced\n", begin + line + 6 / REPORT_WIDTH, l->y);
    l->x += 22 + 6 + LETTER * (double)strlen(text) + 20;
}

static void put_doubtful_entry(FILE *script, const struct legend *l)
{
    fprintf(script,
            "set label '' at screen %.5f, screen %.5f point pt 6 ps 0.5 lc rgb mark\n"
            "set label 'not Good' at screen %.5f, screen %.5f left\n",
            (l->x + 4) / REPORT_WIDTH, l->y, (l->x + 14) / REPORT_WIDTH, l->y);
}

/* One curve is called by its description, several by their names as well; very many are not named at all. */
static void put_names(FILE *script, const struct panel *panel, const struct curve_of *c, struct legend *l)
{
    size_t letters = 0;
    for (size_t i = 0; i < panel->n; i++)
        letters += strlen(c[i].signal->tag.name) + strlen(c[i].signal->tag.description) + 8;
    const bool described = (double)letters * LETTER < 0.6 * REPORT_WIDTH;
    for (size_t i = 0; i < panel->n && panel->n <= CURVES_NAMED; i++) {
        const char *name = c[i].signal->tag.name, *description = c[i].signal->tag.description;
        char text[APC_TAG_LEN * 4], style[40];
        snprintf(style, sizeof style, "lw 1.7 lc rgb 0x%06X", colour_of(panel, i));
        if (panel->n == 1)
            snprintf(text, sizeof text, "%s", *description ? description : name);
        else
            snprintf(text, sizeof text, "%s%s%s", name, described && *description ? ": " : "",
                     described ? description : "");
        put_entry(script, l, style, text);
    }
}

static void put_legend(FILE *script, const struct panel *panel, const struct curve_of *c, double y)
{
    struct legend l = {0.105 * REPORT_WIDTH, y};
    bool limit = false, wanted = false, limited = false, doubtful = false;
    for (size_t i = 0; i < panel->n; i++) {
        wanted |= c[i].wanted != NULL;
        limited |= panel->outputs && has_limited(c[i].series);
        doubtful |= has_doubtful(c[i].series);
        limit |= shows(panel, &c[i], c[i].signal->tag.low) || shows(panel, &c[i], c[i].signal->tag.high);
    }
    put_names(script, panel, c, &l);
    if (wanted)
        put_entry(script, &l, "lw 1.2 dt (6,4) lc rgb 0x000000", "setpoint");
    if (limit)
        put_entry(script, &l, "lw 1 dt (2,3) lc rgb 0x777777", "limit");
    if (limited)
        put_entry(script, &l, "lw 3.2 lc rgb 0xE69F00", "held back by a limit");
    if (doubtful)
        put_doubtful_entry(script, &l);
}

static void put_limit(FILE *script, const struct panel *panel, const struct curve_of *c, double limit)
{
    if (shows(panel, c, limit))
        fprintf(script, "%.9g with lines lw 1 dt (2,3) lc rgb 0x777777, ", limit / panel->scale);
}

static void put_curves(FILE *script, const struct report_panels *p, const struct panel *panel)
{
    const struct curve_of *c = &p->curve[panel->first];
    fputs("plot ", script);
    for (size_t i = 0; i < panel->n; i++) {
        put_limit(script, panel, &c[i], c[i].signal->tag.low);
        put_limit(script, panel, &c[i], c[i].signal->tag.high);
    }
    for (size_t i = 0; i < panel->n; i++) {
        const size_t number = panel->first + i;
        const unsigned colour = colour_of(panel, i);
        if (c[i].series)
            fprintf(script, "$v%zu using 1:2 with %s lc rgb 0x%06X, ", number,
                    panel->outputs        ? "steps lw 1.7"
                    : c[i].series->n == 1 ? "points pt 7 ps 0.5"
                                          : "lines lw 1.7",
                    colour);
        if (c[i].wanted)
            fprintf(script, "$r%zu using 1:2 with steps lw 1.2 dt (6,4) lc rgb 0x%06X, ", number,
                    panel->n == 1 ? 0x000000 : colour);
        if (panel->outputs && has_limited(c[i].series))
            fprintf(script,
                    "$v%zu using 1:3 with steps lw 3.2 lc rgb 0xE69F00, $v%zu using 1:3 with points pt 7 ps "
                    "0.25 lc rgb "
                    "0xE69F00, ",
                    number, number);
        if (has_doubtful(c[i].series))
            fprintf(script, "$d%zu with points pt 6 ps 0.5 lc rgb mark, ", number);
    }
    fputs("NaN\n", script);
}

static double disturbed_at(const struct report_panels *p, size_t i)
{
    return apc_ns_to_s(p->e->plant.rhythm.phase + p->e->plant.disturbance[i].at);
}

/* Dotted where a disturbance changed; thin and coloured where something was out of the ordinary. */
static void put_times(FILE *script, const struct report_panels *p)
{
    const struct report_data *data = p->data;
    for (size_t i = 0; p->e->plant.model && i < p->e->plant.n_disturbances; i++)
        if (disturbed_at(p, i) <= data->end)
            fprintf(
                script,
                "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead back lw 1.2 dt (2,4) lc rgb 0x666666\n",
                disturbed_at(p, i) / p->unit, disturbed_at(p, i) / p->unit);
    for (size_t i = 0; i < data->n_events && data->n_events <= LINES_MAX; i++)
        fprintf(script, "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead back lw 0.6 lc rgb 0x%06X\n",
                data->event[i].t / p->unit, data->event[i].t / p->unit,
                data->event[i].alarm ? 0xE08A7A : 0xEBCB8B);
}

static void put_panel(FILE *script, const struct report_panels *p, size_t k, double top, double height)
{
    const struct panel *panel = &p->panel[k];
    bool any = false;
    put_margins(script, top + KEY_HEIGHT, height, PANEL_HEIGHT);
    fprintf(script, "set xrange [0:%.9g]\nset yrange [%.9g:%.9g]\nset ytics %.9g\n", p->end / p->unit,
            panel->low, panel->high, panel->tick);
    put_label(script, p, panel);
    put_times(script, p);
    fputs("unset key\n", script);
    put_legend(script, panel, &p->curve[panel->first], report_screen(top + KEY_HEIGHT - 9, height));
    if (k + 1 < p->n)
        fputs("set format x ''\n", script);
    else
        fprintf(script, "set xlabel 'time  (%s)' offset 0, 0.4\n", p->unit_name);
    for (size_t i = 0; i < panel->n; i++)
        any |= p->curve[panel->first + i].series || p->curve[panel->first + i].wanted;
    if (any)
        put_curves(script, p, panel);
    else
        report_blank(script);
}

/* ---- What happened ------------------------------------------------------------------------ */

/* A text at a time, unless it would stand on the one before. */
static void put_mark(FILE *script, const struct report_panels *p, double t, const char *text,
                     const char *colour, double *free_from)
{
    const double inner = 0.855 * REPORT_WIDTH, at = t / p->end * inner,
                 half = (double)strlen(text) * LETTER / 2;
    double middle = fmin(fmax(at, half), inner - half);
    if (middle - half < *free_from)
        return;
    *free_from = middle + half + LETTER;
    fputs("set label ", script);
    report_quoted(script, text);
    fprintf(script, " at graph %.5f, graph 0.35 center noenhanced textcolor rgb %s\n", middle / inner,
            colour);
}

static void put_strip(FILE *script, const struct report_panels *p, double top, double height)
{
    const struct report_data *data = p->data;
    const size_t changes = p->e->plant.model ? p->e->plant.n_disturbances : 0;
    double free_from = -1;
    size_t i = 0, k = 0;
    put_margins(script, top, height, STRIP_HEIGHT);
    fprintf(script, "unset border\nunset tics\nset xrange [0:%.9g]\nset yrange [0:1]\n", p->end / p->unit);
    while (i < changes || k < data->n_events) {
        if (k == data->n_events || (i < changes && disturbed_at(p, i) <= data->event[k].t)) {
            char text[100];
            const struct apc_disturbance *d = &p->e->plant.disturbance[i];
            snprintf(text, sizeof text, "%s = %.6g", p->e->plant.model->disturbance[d->k].name, d->value);
            if (disturbed_at(p, i) <= data->end)
                put_mark(script, p, disturbed_at(p, i), text, "quiet", &free_from);
            i++;
        } else {
            bool again = k > 0 && !strcmp(data->event[k].kind, data->event[k - 1].kind);
            if (!again)
                put_mark(script, p, data->event[k].t, data->event[k].kind,
                         data->event[k].alarm ? "0xB03A2E" : "0xA87900", &free_from);
            k++;
        }
    }
    fputs("plot NaN notitle\n", script);
}

void report_panels_draw(FILE *script, const struct report_panels *p, double top, double height)
{
    if (strip_height(p) > 0)
        put_strip(script, p, top, height);
    for (size_t k = 0; k < p->n; k++)
        put_panel(script, p, k, top + strip_height(p) + (double)k * (KEY_HEIGHT + PANEL_HEIGHT), height);
    if (p->n_drawn < p->n_curves)
        fprintf(script,
                "%sset label 1 '%zu of %zu variables are drawn; samples.csv has all' at screen 0.105, screen "
                "0.004 "
                "textcolor rgb quiet\nunset border\nunset tics\nset xrange [0:1]\nset yrange [0:1]\nplot NaN "
                "notitle\n",
                report_panel_style, p->n_drawn, p->n_curves);
}
