/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Everything that needs judgement (ranges, bars, ticks, names) is decided here; gnuplot only draws. The
 * data stands in the script once, as named blocks, and is drawn twice, as SVG and as PNG of the same
 * layout, which is given in fractions of the page so that the time axes stand exactly above each other.
 */
#include "report_figure.h"

#include <math.h>
#include <stdlib.h>
#include <wchar.h>

#define NS_PER_MS 1e6

/* Colours by Okabe and Ito, which the colour-blind can tell apart; grey in place of their yellow. Texts that
 * change their font have two blanks together somewhere: only then the SVG keeps any of their blanks. */
static const char prologue[] =
    "set encoding utf8\n"
    "mark = 0xD55E00\n"
    "quiet = 0x555555\n"
    "array colour[8] = [0x0072B2, 0xD55E00, 0x009E73, 0xCC79A7, 0xE69F00, 0x56B4E9, 0x000000, 0x999999]\n"
    "increment = '{/:Italic t_{k+1} − t_k}'\n";

static const char panel_style[] = "reset\n"
                                  "set border 3 lw 0.7 lc rgb 0x333333\n"
                                  "set tics nomirror out scale 0.5, 0.25 textcolor rgb 0x222222\n"
                                  "set grid lt 1 lw 0.5 lc rgb 0xE2E2E2\n"
                                  "set style fill solid noborder\n"
                                  "set minussign\n"
                                  "set format '%.7g'\n";

/* The same figure for each; the PNG has two pixels where the SVG has one unit. */
static const char *const terminals[] = {
    "set terminal svg size 800,720 dynamic enhanced font 'DejaVu Sans,Helvetica,sans-serif,12' "
    "background rgb 'white'\nset output 'report.svg'\ntitle_font = ',14'\n",
    "set terminal pngcairo size 1600,1440 enhanced font 'DejaVu Sans,9.2' fontscale 2 linewidth 2 "
    "pointscale 3 dashlength 2\nset output 'report.png'\ntitle_font = ',10.7'\n",
};

#define BARS_MAX 41 /* of a panel; the middle one stands on the period */

/* A histogram as it is drawn: bars of one width, and what lies off the chart. */
struct bars {
    double tick, width; /* ns: distance of the labelled ticks from the period; width of a bar */
    int reach;          /* bars to each side of the middle one */
    uint64_t count[BARS_MAX], peak, below, above;
};

/* The range of a panel's values, in units of scale = 10^power. */
struct span {
    double low, high, scale;
    int power;
};

/* What is drawn, and what was decided about it. */
struct figure {
    struct report_data *data;
    const char *title; /* may be NULL */
    struct bars bars[REPORT_TASKS];
    bool log_scale;           /* of the counts, the same for all three: they are there to be compared */
    struct span upper, lower; /* of measurements and setpoints; of outputs */
    double end;               /* of the run, s */
};

/* ---- Text and numbers --------------------------------------------------------------------- */

/* Text of a user as a gnuplot string, in which only the single quote is special. What is no UTF-8 would
 * make the SVG unreadable. */
static void put_quoted(FILE *script, const char *text)
{
    mbstate_t state = {0};

    fputc('\'', script);
    while (*text) {
        size_t length = mbrlen(text, MB_CUR_MAX, &state);
        if (length > MB_CUR_MAX) {
            state = (mbstate_t){0};
            length = 1;
            fputc('?', script);
        } else if (*text == '\'') {
            fputs("''", script);
        } else if ((unsigned char)*text < ' ') {
            fputc(' ', script);
        } else {
            fwrite(text, 1, length, script);
        }
        text += length;
    }
    fputc('\'', script);
}

static void put_duration(FILE *script, double ns)
{
    static const char *const units[] = {"ns", "µs", "ms", "s"};
    size_t i = 0;

    for (; ns >= 999.5 && i < 3; i++)
        ns /= 1e3;
    fprintf(script, "%.3g %s", ns, units[i]);
}

/* The smallest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below @p value > 0. */
static double round_up(double value)
{
    static const double digits[] = {1, 2, 3, 4, 5, 6, 8};
    double decade = pow(10.0, floor(log10(value) + 1e-9));

    for (size_t i = 0; i < sizeof digits / sizeof *digits; i++)
        if (digits[i] * decade >= value * (1 - 1e-9))
            return digits[i] * decade;
    return 10.0 * decade;
}

/* A panel without data; its x axis is the caller's. */
static void put_blank(FILE *script)
{
    fputs("unset ytics\nset yrange [0:1]\n"
          "set label 9 'no samples' at graph 0.5, 0.5 center textcolor rgb quiet\nplot NaN notitle\n",
          script);
}

/* ---- Histograms --------------------------------------------------------------------------- */

static double middle(const struct apc_bin *bin)
{
    return 0.5 * ((double)bin->low + (double)bin->high);
}

static int by_distance(const void *a, const void *b)
{
    double p = fabs(middle(a)), q = fabs(middle(b));

    return (p > q) - (p < q);
}

/*
 * How far from the period the chart must reach: to the last sample, unless that is far beyond where
 * 99 % of them lie. A few outliers would then squeeze all others into one bar, so it ends where the
 * tail of a normal distribution has ended, at 1.6 * 2.6 standard deviations.
 */
static double find_reach(struct report_jitter *jitter)
{
    uint64_t all = 0, seen = 0;
    size_t i = 0;
    double most, last;

    qsort(jitter->bins, jitter->n_bins, sizeof *jitter->bins, by_distance);
    for (size_t k = 0; k < jitter->n_bins; k++)
        all += jitter->bins[k].count;
    while (i + 1 < jitter->n_bins && (double)(seen + jitter->bins[i].count) < 0.99 * (double)all)
        seen += jitter->bins[i++].count;
    most = fabs(middle(&jitter->bins[i]));
    last = fabs(middle(&jitter->bins[jitter->n_bins - 1]));
    return last <= 2.5 * most ? last : 1.6 * most;
}

/* The buckets are far narrower than a bar, so each goes as a whole to the bar that its middle lies in. */
static void make_bars(struct report_jitter *jitter, struct bars *bars)
{
    int per_tick = jitter->count < 200 ? 8 : 16;

    *bars = (struct bars){.reach = per_tick * 5 / 4};
    if (jitter->n_bins == 0)
        return;
    bars->tick = round_up(fmax(find_reach(jitter) / 1.25, 1e3));
    bars->width = bars->tick / per_tick;
    for (size_t i = 0; i < jitter->n_bins; i++) {
        double k = round(middle(&jitter->bins[i]) / bars->width);
        uint64_t n = jitter->bins[i].count;

        if (k < -bars->reach) {
            bars->below += n;
        } else if (k > bars->reach) {
            bars->above += n;
        } else {
            uint64_t *count = &bars->count[bars->reach + (int)k];
            *count += n;
            if (*count > bars->peak)
                bars->peak = *count;
        }
    }
}

static void put_bars(FILE *script, int panel, const struct bars *bars)
{
    fprintf(script, "$jitter%d << END\n", panel);
    for (int k = -bars->reach; k <= bars->reach; k++)
        if (bars->count[bars->reach + k] > 0)
            fprintf(script, "%.9g %.9g\n", k * bars->width / NS_PER_MS, (double)bars->count[bars->reach + k]);
    fputs("END\n", script);
}

static void put_heading(FILE *script, int panel, const struct report_jitter *jitter)
{
    static const char *const names[REPORT_TASKS] = {"Simulator", "Control module", "Client module"};

    fprintf(script, "set label 1 '{/:Bold %s}' at graph 0, screen 0.927\n", names[panel]);
    if (jitter->count == 0)
        return;
    fprintf(script, "set label 2 'mean %.4f ms' at graph 0, screen 0.903 textcolor rgb mark\n",
            (jitter->period + jitter->mean) / NS_PER_MS);
    fputs("set label 3 '{/*0.9 sd ", script);
    put_duration(script, jitter->sd);
    fprintf(script, ", n = %.0f", (double)jitter->count);
    if (jitter->missed > 0)
        fprintf(script, ", %.0f missed", (double)jitter->missed);
    fputs("}' at graph 0, screen 0.881 textcolor rgb quiet\n", script);
}

/* Ticks at the period and to both sides of it; as differences where the times would get too many digits. */
static void put_increment_axis(FILE *script, double period, const struct bars *bars)
{
    double end = (bars->reach + 0.5) * bars->width / NS_PER_MS, tick = bars->tick / NS_PER_MS;
    int decimals = (int)fmax(0, -floor(log10(tick) + 1e-9));
    bool differences = floor(log10(period / NS_PER_MS)) + decimals > 5;
    double unit = differences && tick < 1 ? 1e3 : 1; /* of the labels, in 1/ms */

    fprintf(script, "set xrange [%.9g:%.9g]\nset xtics (", -end, end);
    for (int i = -1; i <= 1; i++) {
        if (differences)
            fprintf(script, "'%s%.4g' %.9g, ", i < 0 ? "−" : "", fabs(i * tick * unit), i * tick);
        else
            fprintf(script, "'%.*f' %.9g, ", decimals, period / NS_PER_MS + i * tick, i * tick);
    }
    fprintf(script, "'' %.9g 1, '' %.9g 1)\n", -0.5 * tick, 0.5 * tick);
    if (differences)
        fprintf(script, "set xlabel increment.' − %.10g s  (%s)' offset 0, 0.4\n", period / 1e9,
                unit > 1 ? "µs" : "ms");
    else
        fputs("set xlabel increment.'  (ms)' offset 0, 0.4\n", script);
}

/* Off the chart is not out of the world: how many lie there stands at its edges. */
static void put_off_chart(FILE *script, const struct bars *bars)
{
    if (bars->below > 0)
        fprintf(script, "set label 4 '{/*0.9 ← %.0f off-chart}' at graph 0.01, 0.95 textcolor rgb quiet\n",
                (double)bars->below);
    if (bars->above > 0)
        fprintf(script,
                "set label 5 '{/*0.9 %.0f off-chart →}' at graph 0.99, 0.95 right textcolor rgb quiet\n",
                (double)bars->above);
}

/* What stands beside the histograms goes with the first: gnuplot knows labels of panels only. */
static void put_page_labels(FILE *script, const struct figure *figure)
{
    fputs("set label 6 'count' at screen 0.02, graph 0.5 center rotate\n", script);
    if (!figure->title)
        return;
    fputs("set label 7 ", script);
    put_quoted(script, figure->title);
    fputs(" at graph 0, screen 0.972 noenhanced font title_font\n", script);
}

static void put_histogram(FILE *script, const struct figure *figure, int panel)
{
    const struct report_jitter *jitter = &figure->data->jitter[panel];
    const struct bars *bars = &figure->bars[panel];
    double left = 0.09 + 0.3075 * panel, top = (double)bars->peak, mean = jitter->mean / NS_PER_MS;

    fprintf(script, "%sset tmargin at screen 0.862\nset bmargin at screen 0.69\n", panel_style);
    fprintf(script, "set lmargin at screen %.4f\nset rmargin at screen %.4f\n", left, left + 0.255);
    if (panel == 0)
        put_page_labels(script, figure);
    put_heading(script, panel, jitter);
    if (jitter->n_bins == 0 || jitter->count == 0) {
        fputs("unset xtics\nset xrange [0:1]\n", script);
        put_blank(script);
        return;
    }
    put_increment_axis(script, jitter->period, bars);
    put_off_chart(script, bars);
    fputs("set grid noxtics\n", script);
    if (figure->log_scale)
        fprintf(script, "set logscale y\nset format y '%%.0f'\nset yrange [0.6:%.9g]\n", 4 * fmax(10, top));
    else
        fprintf(script, "set ytics %.9g\nset yrange [0:%.9g]\n", fmax(1, round_up(top / 4)), 1.25 * top);
    if (fabs(jitter->mean) < (bars->reach + 0.5) * bars->width)
        fprintf(script, "set arrow 1 from %.9g, graph 0 to %.9g, graph 1 nohead front lw 1.2 lc rgb mark\n",
                mean, mean);
    fprintf(script, "set boxwidth %.9g\nplot $jitter%d with boxes lc rgb 0x7FB2D6 notitle\n",
            0.92 * bars->width / NS_PER_MS, panel);
}

/* ---- Process variables -------------------------------------------------------------------- */

/* A Bad measurement is none: it sets no range and interrupts the line. A Bad output still went out. */
static bool is_gap(char kind, const struct report_point *point)
{
    return kind == 'y' && point->severity == APC_SEVERITY_BAD;
}

static void widen(struct span *span, char kind, const struct report_group *group)
{
    for (size_t i = 0; i < REPORT_SHOWN; i++)
        for (size_t k = 0; k < group->series[i].n; k++) {
            const struct report_point *point = &group->series[i].points[k];
            if (is_gap(kind, point))
                continue;
            span->low = fmin(span->low, point->value);
            span->high = fmax(span->high, point->value);
        }
}

/* Values of many digits are drawn in thousands, millionths, ...: the axis says so in its label. */
static void settle(struct span *span)
{
    double room, most;

    if (span->low > span->high)
        *span = (struct span){.low = 0, .high = 0};
    most = fmax(fabs(span->low), fabs(span->high));
    if (most >= 1e5 || (most > 0 && most < 1e-2))
        span->power = 3 * (int)floor(fmax(log10(most), -300) / 3 + 1e-9);
    span->scale = pow(10.0, span->power);
    span->low /= span->scale;
    span->high /= span->scale;
    room = 0.06 * (span->high - span->low);
    if (room <= 1e-6 * most / span->scale)
        room = most > 0 ? 0.1 * most / span->scale : 1;
    span->low -= room;
    span->high += room;
}

/* Blocks $<kind><id> of the line and $<kind><id>_bad of the samples that are not Good. Setpoints and
 * outputs hold until the next one: the last one until the end of the run. */
static void put_series(FILE *script, char kind, size_t id, const struct report_series *series, double end,
                       const struct span *span)
{
    const struct report_point *points = series->points;

    fprintf(script, "$%c%zu << END\n", kind, id);
    for (size_t k = 0; k < series->n; k++) {
        if (is_gap(kind, &points[k]))
            fputc('\n', script);
        else
            fprintf(script, "%.9g %.9g\n", points[k].t, points[k].value / span->scale);
    }
    if (kind != 'y' && series->n > 0)
        fprintf(script, "%.9g %.9g\n", end, points[series->n - 1].value / span->scale);
    fprintf(script, "END\n$%c%zu_bad << END\n", kind, id);
    for (size_t k = 0; k < series->n; k++)
        if (points[k].severity != APC_SEVERITY_GOOD)
            fprintf(script, "%.9g %.9g\n", points[k].t,
                    fmin(fmax(points[k].value / span->scale, span->low), span->high));
    fputs("END\n", script);
}

static void put_group(FILE *script, char kind, const struct report_group *group, double end,
                      const struct span *span)
{
    for (size_t i = 0; i < REPORT_SHOWN; i++)
        put_series(script, kind, i + 1, &group->series[i], end, span);
}

/* Add the lines of a group to a plot command. A single variable goes by its name, a single output by that
 * of the axis; setpoints of several variables have the colours of these and one entry for all. */
static void put_lines(FILE *script, char kind, const struct report_group *group, const char *name)
{
    for (size_t i = 0; i < REPORT_SHOWN; i++) {
        size_t n = group->series[i].n;

        if (n == 0)
            continue;
        fprintf(script, "$%c%zu with ", kind, i + 1);
        if (kind == 'y')
            fputs(n == 1 ? "points pt 7 ps 0.5 " : "lines lw 1.7 ", script);
        else
            fputs(kind == 'u' ? "steps lw 1.7 " : "steps lw 1.1 dt (7,5) ", script);
        if (kind == 'z' && group->n == 1)
            fputs("lc rgb 0x000000 ", script);
        else
            fprintf(script, "lc rgb colour[%zu] ", i + 1);
        if (group->n == 1 && kind != 'u')
            fprintf(script, "title '%s'", name);
        else if (group->n > 1 && kind != 'z')
            fprintf(script, "title '{/:Italic %c}_%zu'", kind, i + 1);
        fputs(", ", script);
    }
    if (kind == 'z' && group->n > 1)
        fprintf(script, "keyentry with lines lw 1.1 dt (7,5) lc rgb 0x000000 title '%ss', ", name);
}

static bool has_bad(const struct report_series *series)
{
    for (size_t k = 0; k < series->n; k++)
        if (series->points[k].severity != APC_SEVERITY_GOOD)
            return true;
    return false;
}

/* Add hollow marks on the samples that are not Good, with one entry of the legend for all. */
static void put_marks(FILE *script, char kind, const struct report_group *group)
{
    bool named = false;

    for (size_t i = 0; i < REPORT_SHOWN; i++) {
        if (!has_bad(&group->series[i]))
            continue;
        fprintf(script, "$%c%zu_bad with points pt 6 ps 0.6 lc rgb colour[%zu] notitle, ", kind, i + 1,
                i + 1);
        named = true;
    }
    if (named)
        fputs("keyentry with points pt 6 ps 0.6 lc rgb 0x000000 title 'not Good', ", script);
}

/* Where a panel on the time axis stands, and what its axes say. */
struct place {
    double top, bottom;
    const char *label;
    bool last; /* the lowest: it has the numbers of the time axis */
};

static void put_time_axes(FILE *script, const struct place *place, double end, const struct span *span, int n)
{
    double digit = pow(10.0, floor(log10(end)) - 1); /* the axis ends on the second digit of the last time */

    fprintf(script, "%sset tmargin at screen %.3f\nset bmargin at screen %.3f\n", panel_style, place->top,
            place->bottom);
    fputs("set lmargin at screen 0.09\nset rmargin at screen 0.96\n", script);
    fprintf(script,
            "set xrange [0:%.9g]\nset yrange [%.9g:%.9g]\n"
            "set label 6 '%s",
            ceil(end / digit * (1 - 1e-9)) * digit, span->low, span->high, place->label);
    if (span->power != 0)
        fprintf(script, "  (10^{%d})", span->power);
    fputs("' at screen 0.02, graph 0.5 center rotate\n", script);
    fprintf(script, "set key at graph 1, screen %.3f bottom right horizontal noautotitle samplen 2\n",
            place->top + 0.004);
    if (place->last)
        fputs("set xlabel 'time  (s)' offset 0, 0.4\n", script);
    else
        fputs("set format x ''\n", script);
    if (n > REPORT_SHOWN)
        fprintf(script, "set label 1 'the first %d of %d' at graph 0, screen %.3f textcolor rgb quiet\n",
                REPORT_SHOWN, n, place->top + 0.015);
}

/* ---- The figure --------------------------------------------------------------------------- */

static void decide(struct figure *figure)
{
    struct report_data *data = figure->data;

    for (size_t i = 0; i < REPORT_TASKS; i++) {
        make_bars(&data->jitter[i], &figure->bars[i]);
        figure->log_scale = figure->log_scale || figure->bars[i].peak > 60;
    }
    figure->upper = figure->lower = (struct span){.low = HUGE_VAL, .high = -HUGE_VAL};
    widen(&figure->upper, 'y', &data->y);
    widen(&figure->upper, 'z', &data->z);
    widen(&figure->lower, 'u', &data->u);
    settle(&figure->upper);
    settle(&figure->lower);
    figure->end = data->end > 1e-3 ? data->end : 1;
}

static void put_page(FILE *script, const struct figure *figure)
{
    const struct report_data *data = figure->data;
    static const struct place upper = {0.575, 0.355, "measurement, setpoint", false},
                              lower = {0.295, 0.075, "manipulated variable", true};

    fputs("set multiplot\n", script);
    for (int i = 0; i < REPORT_TASKS; i++)
        put_histogram(script, figure, i);

    put_time_axes(script, &upper, figure->end, &figure->upper, data->y.n > data->z.n ? data->y.n : data->z.n);
    if (data->y.n == 0 && data->z.n == 0) {
        put_blank(script);
    } else {
        fputs("plot ", script);
        put_lines(script, 'y', &data->y, "measurement");
        put_lines(script, 'z', &data->z, "setpoint");
        put_marks(script, 'y', &data->y);
        fputs("NaN notitle\n", script);
    }
    put_time_axes(script, &lower, figure->end, &figure->lower, data->u.n);
    if (data->u.n == 0) {
        put_blank(script);
    } else {
        fputs("plot ", script);
        put_lines(script, 'u', &data->u, "output");
        put_marks(script, 'u', &data->u);
        fputs("NaN notitle\n", script);
    }
    fputs("unset multiplot\nunset output\n", script);
}

void report_figure(FILE *script, struct report_data *data, const char *title)
{
    struct figure figure = {.data = data, .title = title};

    decide(&figure);
    fputs(prologue, script);
    for (int i = 0; i < REPORT_TASKS; i++)
        put_bars(script, i, &figure.bars[i]);
    put_group(script, 'y', &data->y, figure.end, &figure.upper);
    put_group(script, 'z', &data->z, figure.end, &figure.upper);
    put_group(script, 'u', &data->u, figure.end, &figure.lower);
    for (size_t i = 0; i < sizeof terminals / sizeof *terminals; i++) {
        fputs(terminals[i], script);
        put_page(script, &figure);
    }
}
