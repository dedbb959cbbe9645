/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The process variables over time. Above them, what happened: disturbances, warnings, alarms, and the modes
 * that were not the same all the time.
 */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "report_panels.h"

#define STRIP_HEIGHT   20.0 /* of what happened */
#define KEY_HEIGHT     24.0 /* above each panel */
#define PANEL_HEIGHT   112.0
#define BUNDLE_KEY     20.0
#define BUNDLE_HEIGHT  62.0
#define FOOT_HEIGHT    52.0 /* numbers and name of the time axis */
#define LINES_MAX      40   /* of warnings and alarms; more would be a curtain */
#define NEAR           0.12 /* of the range: a limit so far beyond the data is shown */
#define LABEL_MAX      12   /* letters of names at the axis */
#define SETPOINT_STYLE "lw 1.2 dt (6,4)"
#define ABOVE_STYLE    "lw 1.4 dt (10,3,2,3) lc rgb 0xD55E00"
#define EXPECTED_STYLE "lw 2 dt (3,2) lc rgb mark"
#define LETTER         6.6   /* width of one, on average */
#define LEFT           0.105 /* of all panels; fraction of the page, as the next ones */
#define RIGHT          0.96
#define LEFT_END       0.505 /* of the left one of a row of two */
#define RIGHT_BEGIN    0.575

static const unsigned colours[] = {0x0072B2, 0x009E73, 0xCC79A7, 0x56B4E9,
                                   0x7A5195, 0x000000, 0x999999, 0x8C6D31};
#define COLOURS (sizeof colours / sizeof *colours)

/* Where a panel stands: units from the first one's top, fractions of the page. */
struct frame {
    double top, height, left, right;
};

/* ---- Ranges ------------------------------------------------------------------------------- */

/* A limit is shown where the curve comes near it. */
static bool near(const struct panel *panel, double limit)
{
    double room = NEAR * (panel->high - panel->low);
    return limit >= panel->low - room && limit <= panel->high + room;
}

/* Values of many digits are drawn in thousands, millionths, ...: the axis says so in its label. */
static void settle_panel_unit(const struct report_panels *p, struct panel *panel)
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
        most >= 1e4 || (most > 0 && most < 1e-2) ? 3 * (int)floor(fmax(apc_log10(most), -300) / 3 + 1e-9) : 0;
    panel->scale = apc_pow(10, panel->power);
    panel->low = low;
    panel->high = high;
    for (size_t i = panel->first; i < panel->first + panel->n && high > low; i++) {
        const struct curve_of *c = &p->curve[i];
        if (near(panel, c->least))
            low = fmin(low, c->least);
        if (near(panel, c->most))
            high = fmax(high, c->most);
    }
    double room = 0.08 * (high - low);
    if (room <= 1e-6 * most)
        room = most > 0 ? 0.1 * most : 1;
    panel->low = (low - room) / panel->scale;
    panel->high = (high + room) / panel->scale;
    double range = panel->high - panel->low, most_ticks = panel->bundle ? 3 : 6,
           decade = apc_pow(10, floor(apc_log10(range / most_ticks)));
    size_t k = 0;
    while (k + 1 < sizeof steps / sizeof *steps && range / (steps[k] * decade) > most_ticks)
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
    p->begin = p->data->begin;
    while (end < units[k].from)
        k++;
    p->unit = units[k].unit;
    p->unit_name = units[k].name;
    end /= p->unit;
    digit = apc_pow(10, floor(apc_log10(end)) - 1); /* the axis ends on the second digit of the last time */
    if (p->begin > 0)
        p->end = p->data->end;
    else
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
    if (controllers_describe(e, &p->loops) < 0 || report_arrange(p) < 0 ||
        report_lanes_create(&p->lanes, data, e, &p->loops) < 0) {
        report_panels_destroy(p);
        *panels = NULL;
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < p->n; i++)
        settle_panel_unit(p, &p->panel[i]);
    settle_time(p);
    return 0;
}

void report_panels_destroy(struct report_panels *panels)
{
    if (!panels)
        return;
    report_lanes_destroy(panels->lanes);
    loops_free(&panels->loops);
    free(panels->curve);
    free(panels->shadow);
    free(panels);
}

/* Where a panel begins below the first one, and how high it is. */
static struct frame frame_of(const struct report_panels *p, size_t k)
{
    const bool bundle = p->panel[k].bundle;
    const double key = bundle ? BUNDLE_KEY : KEY_HEIGHT, height = bundle ? BUNDLE_HEIGHT : PANEL_HEIGHT;
    return (struct frame){.top = (double)(bundle ? k / 2 : k) * (key + height) + key,
                          .height = height,
                          .left = bundle && p->panel[k].outputs ? RIGHT_BEGIN : LEFT,
                          .right = bundle && !p->panel[k].outputs ? LEFT_END : RIGHT};
}

/* The last panel of its column: the time stands below it. */
static bool is_last(const struct report_panels *p, size_t k)
{
    return k + (p->panel[k].bundle ? 2 : 1) >= p->n;
}

/* What stands above all panels has the time axis of the left ones. */
static double strip_end(const struct report_panels *p)
{
    return p->n > 0 ? frame_of(p, 0).right : RIGHT;
}

static double strip_height(const struct report_panels *p)
{
    return p->data->n_events > 0 || p->e->n_actions > 0 ||
                   (p->e->plant.model && p->e->plant.n_disturbances > 0)
               ? STRIP_HEIGHT
               : 0;
}

static double panels_top(const struct report_panels *p)
{
    return strip_height(p) + report_lanes_height(p->lanes);
}

double report_panels_height(const struct report_panels *p)
{
    const struct frame last = p->n > 0 ? frame_of(p, p->n - 1) : (struct frame){0};
    return panels_top(p) + last.top + last.height + FOOT_HEIGHT;
}

/* ---- Blocks ------------------------------------------------------------------------------- */

/* Columns: t, value, value where a limit holds it back. An output and a setpoint hold until the next one (@p
 * gap 0); a Bad measurement is none, a Bad output still went out. Nobody knows what was between two
 * measurements that are farther apart than @p gap, in s. */
static void put_series(FILE *script, const struct report_panels *p, const struct report_series *series,
                       double scale, double gap)
{
    const bool holds = gap <= 0;
    const struct report_point *before = NULL;
    for (size_t k = 0; series && k < series->n; k++) {
        const struct report_point *at = &series->points[k];
        if (!holds && at->severity == APC_SEVERITY_BAD) {
            fputc('\n', script);
            continue;
        }
        if (!holds && before && at->t - before->t > gap)
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

/* The last move holds for its step, too. */
static void put_expected(FILE *script, const struct report_panels *p, const struct prediction_trajectory *c,
                         double scale)
{
    for (size_t k = 0; c && k < c->n; k++)
        fprintf(script, "%.9g %.9g\n", (apc_ns_to_s(c->made) + prediction_ahead(c, k)) / p->unit,
                c->expected[k] / scale);
    if (c && c->first == 0)
        fprintf(script, "%.9g %.9g\n", (apc_ns_to_s(c->made) + prediction_ahead(c, c->n)) / p->unit,
                c->expected[c->n - 1] / scale);
}

static double gap_of(const struct report_panels *p, const struct curve_of *c)
{
    const struct wire wire = {APC_SENSOR, (size_t)c->signal->tag.id - 1};
    return c->signal->tag.table == APC_SENSOR ? apc_ns_to_s(module_horizon(p->e, wire)) : 0;
}

void report_panels_blocks(FILE *script, const struct report_panels *p)
{
    for (size_t k = 0; k < p->n; k++)
        for (size_t i = p->panel[k].first; i < p->panel[k].first + p->panel[k].n; i++) {
            const struct curve_of *c = &p->curve[i];
            fprintf(script, "$v%zu << END\n", i);
            put_series(script, p, c->series, p->panel[k].scale, gap_of(p, c));
            fprintf(script, "END\n$r%zu << END\n", i);
            put_series(script, p, c->wanted, p->panel[k].scale, 0);
            fprintf(script, "END\n$a%zu << END\n", i);
            put_series(script, p, c->wanted_above, p->panel[k].scale, 0);
            fprintf(script, "END\n$d%zu << END\n", i);
            put_doubtful(script, p, &p->panel[k], c->series);
            fprintf(script, "END\n$e%zu << END\n", i);
            put_expected(script, p, c->expected, p->panel[k].scale);
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

static void put_panel_frame(FILE *script, const struct frame *f, double top, double height)
{
    fprintf(script, "%sset tmargin at screen %.5f\nset bmargin at screen %.5f\n", report_panel_style,
            report_screen(top + f->top, height), report_screen(top + f->top + f->height, height));
    fprintf(script, "set lmargin at screen %.5f\nset rmargin at screen %.5f\n", f->left, f->right);
}

/* What stands at the axis: "h1, h2  (cm)". */
static void put_label(FILE *script, const struct report_panels *p, const struct panel *panel)
{
    char text[200] = "", unit[2 * APC_TAG_LEN];
    const struct curve_of *first = &p->curve[panel->first];
    size_t used = 0, letters = 0;
    for (size_t i = 0; i < panel->n; i++)
        letters += strlen(first[i].signal->tag.name) + 2;
    for (size_t i = 0; i < panel->n && letters <= LABEL_MAX && !panel->bundle; i++)
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s", i ? ", " : "",
                                 first[i].signal->tag.name);
    if (panel->bundle)
        used = (size_t)snprintf(text, sizeof text, "%.20s", panel->outputs ? "" : panel->bundle->name);
    else if (used == 0)
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
    fprintf(script, " at screen %.3f, graph 0.5 center rotate noenhanced\n",
            panel->bundle && panel->outputs ? RIGHT_BEGIN - 0.045 : 0.02);
}

/* A loop has one colour in both its panels; a single output has another than a single measurement. */
static unsigned colour_of(const struct panel *panel, size_t i)
{
    if (panel->bundle)
        return i == panel->worst ? colours[panel->outputs] : panel->outputs ? 0xA6D8C7 : 0xA9CCE3;
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
static void put_curve_names(FILE *script, const struct panel *panel, const struct curve_of *c,
                            struct legend *l)
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

/* What the bundle is, and which of it stands out. */
static void put_bundle_names(FILE *script, const struct panel *panel, const struct curve_of *c,
                             struct legend *l)
{
    char text[APC_TAG_LEN + 40], style[40];
    snprintf(style, sizeof style, "lw 1.7 lc rgb 0x%06X", colour_of(panel, panel->worst));
    snprintf(text, sizeof text, "%s%s", c[panel->worst].signal->tag.name,
             panel->outputs || panel->n == 1 ? "" : ", largest error");
    put_entry(script, l, style, text);
    if (panel->n == 1 || panel->outputs) /* the same loops as on the left */
        return;
    snprintf(style, sizeof style, "lw 1.7 lc rgb 0x%06X", colour_of(panel, panel->worst + 1));
    snprintf(text, sizeof text, "%zu others", panel->n - 1);
    put_entry(script, l, style, text);
}

/* A setpoint that a controller above moves, and that one's own. */
static void put_cascade_entries(FILE *script, const struct report_panels *p, const struct curve_of *c,
                                struct legend *l)
{
    char text[3 * APC_TAG_LEN];
    const struct controller_loop above =
        controllers_above(p->e, (struct wire){APC_SETPOINT, (size_t)(c->setpoint - p->e->z)});
    snprintf(text, sizeof text, "setpoint %s, moved by %s", c->setpoint->tag.name,
             above.of ? above.of->name : "above");
    put_entry(script, l, SETPOINT_STYLE " lc rgb 0x000000", text);
    snprintf(text, sizeof text, "setpoint %s of %s", c->above->tag.name, above.of ? above.of->name : "above");
    put_entry(script, l, ABOVE_STYLE, text);
}

static void put_legend(FILE *script, const struct report_panels *p, const struct panel *panel, double left,
                       double y)
{
    const struct curve_of *c = &p->curve[panel->first];
    struct legend l = {left * REPORT_WIDTH, y};
    bool limit = false, wanted = false, limited = false, doubtful = false;
    const struct prediction_trajectory *expected = NULL;
    for (size_t i = 0; i < panel->n; i++) {
        expected = c[i].expected ? c[i].expected : expected;
        wanted |= c[i].wanted && !c->above;
        limited |= panel->outputs && has_limited(c[i].series);
        doubtful |= has_doubtful(c[i].series);
        limit |= shows(panel, &c[i], c[i].least) || shows(panel, &c[i], c[i].most);
    }
    if (panel->bundle)
        put_bundle_names(script, panel, c, &l);
    else
        put_curve_names(script, panel, c, &l);
    if (c->above)
        put_cascade_entries(script, p, c, &l);
    if (wanted)
        put_entry(script, &l, SETPOINT_STYLE " lc rgb 0x000000", "setpoint");
    if (limit)
        put_entry(script, &l, "lw 1 dt (2,3) lc rgb 0x777777", "limit");
    if (limited)
        put_entry(script, &l, "lw 3.2 lc rgb 0xE69F00", "held back by a limit");
    if (expected)
        put_entry(script, &l, EXPECTED_STYLE, "expected");
    if (doubtful)
        put_doubtful_entry(script, &l);
}

static void put_limit_line(FILE *script, const struct panel *panel, const struct curve_of *c, double limit)
{
    if (shows(panel, c, limit))
        fprintf(script, "%.9g with lines lw 1 dt (2,3) lc rgb 0x777777, ", limit / panel->scale);
}

static void put_curve(FILE *script, const struct panel *panel, const struct curve_of *c, size_t i)
{
    const size_t number = panel->first + i;
    const unsigned colour = colour_of(panel, i);
    const bool quiet = panel->bundle && i != panel->worst;
    if (c->above)
        fprintf(script, "$a%zu using 1:2 with steps " ABOVE_STYLE ", ", number);
    if (c->series)
        fprintf(script, "$v%zu using 1:2 with %s lw %g lc rgb 0x%06X, ", number,
                panel->outputs      ? "steps"
                : c->series->n == 1 ? "points pt 7 ps 0.5"
                                    : "lines",
                quiet ? 1.0 : 1.7, colour);
    if (c->wanted && !quiet)
        fprintf(script, "$r%zu using 1:2 with steps " SETPOINT_STYLE " lc rgb 0x%06X, ", number,
                panel->n == 1 || panel->bundle ? 0x000000 : colour);
    if (panel->outputs && has_limited(c->series) && !quiet)
        fprintf(script,
                "$v%zu using 1:3 with steps lw 3.2 lc rgb 0xE69F00, $v%zu using 1:3 with points pt 7 ps 0.25 "
                "lc rgb 0xE69F00, ",
                number, number);
    if (c->expected && !quiet)
        fprintf(script, "$e%zu using 1:2 with %s " EXPECTED_STYLE ", ", number,
                c->expected->first == 0 ? "steps" : "lines");
    if (has_doubtful(c->series))
        fprintf(script, "$d%zu with points pt 6 ps 0.5 lc rgb mark, ", number);
}

static void put_panel_curves(FILE *script, const struct report_panels *p, const struct panel *panel)
{
    const struct curve_of *c = &p->curve[panel->first];
    fputs("plot ", script);
    for (size_t i = 0; i < panel->n; i++) {
        put_limit_line(script, panel, &c[i], c[i].least);
        put_limit_line(script, panel, &c[i], c[i].most);
    }
    for (size_t i = 0; i < panel->n; i++)
        if (!panel->bundle || i != panel->worst)
            put_curve(script, panel, &c[i], i);
    if (panel->bundle)
        put_curve(script, panel, &c[panel->worst], panel->worst);
    fputs("NaN\n", script);
}

static bool is_time_shown(const struct report_panels *p, double t)
{
    return t >= p->begin && t <= p->data->end;
}

static double disturbed_at(const struct report_panels *p, size_t i)
{
    return apc_ns_to_s(p->e->plant.rhythm.phase + p->e->plant.disturbance[i].at);
}

static double acted_at(const struct report_panels *p, size_t i)
{
    return apc_ns_to_s(p->e->action[i].at);
}

/* Is it an action that leaves its mark: who is killed or started? Others show in setpoints and modes. */
static bool is_marked(const struct report_panels *p, size_t i)
{
    return p->e->action[i].kind != ACTION_WRITE && is_time_shown(p, acted_at(p, i));
}

static void put_dotted(FILE *script, const struct report_panels *p, double t)
{
    fprintf(script,
            "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead back lw 1.2 dt (2,4) lc rgb 0x666666\n",
            t / p->unit, t / p->unit);
}

/* Dotted where a disturbance changed, or a controller was killed or started; thin and coloured where
 * something was out of the ordinary. */
static void put_times(FILE *script, const struct report_panels *p)
{
    const struct report_data *data = p->data;
    for (size_t i = 0; p->e->plant.model && i < p->e->plant.n_disturbances; i++)
        if (is_time_shown(p, disturbed_at(p, i)))
            put_dotted(script, p, disturbed_at(p, i));
    for (size_t i = 0; i < p->e->n_actions; i++)
        if (is_marked(p, i))
            put_dotted(script, p, acted_at(p, i));
    for (size_t i = 0; data->expected && i < data->expected->n; i++)
        fprintf(script, "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead back lw 1 lc rgb mark\n",
                apc_ns_to_s(data->expected->trajectory[i].made) / p->unit,
                apc_ns_to_s(data->expected->trajectory[i].made) / p->unit);
    for (size_t i = 0; i < data->n_events && data->n_events <= LINES_MAX; i++)
        fprintf(script, "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead back lw 0.6 lc rgb 0x%06X\n",
                data->event[i].t / p->unit, data->event[i].t / p->unit,
                data->event[i].alarm ? 0xE08A7A : 0xEBCB8B);
}

static void put_report_panel(FILE *script, const struct report_panels *p, size_t k, double top, double height)
{
    const struct panel *panel = &p->panel[k];
    const struct frame frame = frame_of(p, k);
    bool any = false;
    put_panel_frame(script, &frame, top, height);
    fprintf(script, "set xrange [%.9g:%.9g]\nset yrange [%.9g:%.9g]\nset ytics %.9g\n", p->begin / p->unit,
            p->end / p->unit, panel->low, panel->high, panel->tick);
    put_label(script, p, panel);
    put_times(script, p);
    fputs("unset key\n", script);
    put_legend(script, p, panel, frame.left, report_screen(top + frame.top - 9, height));
    if (!is_last(p, k))
        fputs("set format x ''\n", script);
    else
        fprintf(script, "set xlabel 'time  (%s)' offset 0, 0.4\n", p->unit_name);
    for (size_t i = 0; i < panel->n; i++)
        any |= p->curve[panel->first + i].series || p->curve[panel->first + i].wanted;
    if (any)
        put_panel_curves(script, p, panel);
    else
        report_blank(script);
}

/* ---- What happened ------------------------------------------------------------------------ */

/* A text at a time; beside the one before, as long as it still stands above its time. */
static void put_mark(FILE *script, const struct report_panels *p, double t, const char *text,
                     const char *colour, double *free_from)
{
    const double inner = (strip_end(p) - LEFT) * REPORT_WIDTH,
                 at = (t - p->begin) / (p->end - p->begin) * inner, half = (double)strlen(text) * LETTER / 2;
    const double middle = fmax(fmin(fmax(at, half), inner - half), *free_from + half);
    if (middle - half > at || middle + half > inner)
        return;
    *free_from = middle + half + LETTER;
    fputs("set label ", script);
    report_quoted(script, text);
    fprintf(script, " at graph %.5f, graph 0.35 center noenhanced textcolor rgb %s\n", middle / inner,
            colour);
}

/* What is planned: disturbances, and who is killed or started, by time. */
struct planned {
    double t;
    char text[100];
};

static int by_planned_time(const void *left, const void *right)
{
    const struct planned *a = left, *b = right;
    return (a->t > b->t) - (a->t < b->t);
}

/* NULL without memory: then nothing is said of it. */
static struct planned *collect_planned(const struct report_panels *p, size_t *n)
{
    const struct experiment *e = p->e;
    const size_t changes = e->plant.model ? e->plant.n_disturbances : 0;
    struct planned *all = calloc(changes + e->n_actions + 1, sizeof *all);
    *n = 0;
    for (size_t i = 0; all && i < changes; i++) {
        const struct apc_disturbance *d = &e->plant.disturbance[i];
        const struct apc_param *of = &e->plant.model->disturbance[d->k];
        struct planned *to = &all[*n];
        char unit[2 * APC_TAG_LEN];
        pretty(of->unit && strcmp(of->unit, "1") != 0 ? of->unit : "", unit, sizeof unit);
        to->t = disturbed_at(p, i);
        snprintf(to->text, sizeof to->text, "%.40s = %.6g%s%.30s", of->name, d->value, *unit ? " " : "",
                 unit);
        *n += is_time_shown(p, to->t);
    }
    for (size_t i = 0; all && i < e->n_actions; i++) {
        if (!is_marked(p, i))
            continue;
        struct planned *to = &all[(*n)++];
        to->t = acted_at(p, i);
        snprintf(to->text, sizeof to->text, "%s %s", e->controllers[e->action[i].controller].name,
                 e->action[i].kind == ACTION_KILL ? "killed" : "started");
    }
    if (all)
        qsort(all, *n, sizeof *all, by_planned_time);
    return all;
}

static void put_strip(FILE *script, const struct report_panels *p, double top, double height)
{
    const struct report_data *data = p->data;
    const struct frame frame = {0, STRIP_HEIGHT, LEFT, strip_end(p)};
    size_t planned;
    struct planned *all = collect_planned(p, &planned);
    double free_from = -1;
    put_panel_frame(script, &frame, top, height);
    fprintf(script, "unset border\nunset tics\nset xrange [%.9g:%.9g]\nset yrange [0:1]\n",
            p->begin / p->unit, p->end / p->unit);
    for (size_t i = 0, k = 0; i < planned || k < data->n_events;) {
        if (k == data->n_events || (i < planned && all[i].t <= data->event[k].t)) {
            put_mark(script, p, all[i].t, all[i].text, "quiet", &free_from);
            i++;
        } else {
            bool again = k > 0 && !strcmp(data->event[k].kind, data->event[k - 1].kind);
            if (!again)
                put_mark(script, p, data->event[k].t, data->event[k].kind,
                         data->event[k].alarm ? "0xB03A2E" : "0xA87900", &free_from);
            k++;
        }
    }
    free(all);
    fputs("plot NaN notitle\n", script);
}

void report_panels_draw(FILE *script, const struct report_panels *p, double top, double height)
{
    if (strip_height(p) > 0)
        put_strip(script, p, top, height);
    const struct frame lanes = {strip_height(p), report_lanes_height(p->lanes) - LANES_GAP, LEFT,
                                strip_end(p)};
    if (report_lanes_height(p->lanes) > 0) {
        put_panel_frame(script, &lanes, top, height);
        fprintf(script, "set xrange [%.9g:%.9g]\n", p->begin / p->unit, p->end / p->unit);
        report_lanes_draw(script, p->lanes, p->unit, p->end - p->begin,
                          (lanes.right - lanes.left) * REPORT_WIDTH);
    }
    for (size_t k = 0; k < p->n; k++)
        put_report_panel(script, p, k, top + panels_top(p), height);
    if (p->n_drawn < p->n_curves)
        fprintf(script,
                "%sset label 1 '%zu of %zu variables are drawn; samples.csv has all' at screen 0.105, screen "
                "0.004 "
                "textcolor rgb quiet\nunset border\nunset tics\nset xrange [0:1]\nset yrange [0:1]\nplot NaN "
                "notitle\n",
                report_panel_style, p->n_drawn, p->n_curves);
}
