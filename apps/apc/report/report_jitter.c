/* SPDX-License-Identifier: BSD-3-Clause */
/* How regularly the tasks ticked: a histogram of the time increments of each; of many controllers one of all. */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "report_script.h"

#define NS_PER_MS 1e6
#define BARS_MAX  41 /* of a panel; the middle one stands on the period */

#define APART 3     /* so many controllers have a panel each */
#define ROW   235.0 /* height */
#define BELOW 10.0  /* the last one */

/* A panel: the increments of one task, or of all controllers together. */
struct panel {
    char heading[APC_TAG_LEN + 16];
    struct report_jitter jitter; /* count 0: nothing is known of its task */
    bool several;                /* tasks of different periods: increments are shown as differences */
    bool wraps;                  /* a row begins behind it */
};

struct report_histograms {
    struct panel panel[2 + APART];
    int n, rows;
};

/* A histogram as it is drawn: bars of one width, and what lies off the chart. */
struct bars {
    double tick, width; /* ns: distance of the labelled ticks from the period; width of a bar */
    int reach;          /* bars to each side of the middle one */
    uint64_t count[BARS_MAX], peak, below, above;
};

static void put_duration(FILE *script, double ns)
{
    static const char *const units[] = {"ns", "µs", "ms", "s"};
    size_t i = 0;

    for (; ns >= 999.5 && i < 3; i++)
        ns /= 1e3;
    fprintf(script, "%.3g %s", ns, units[i]);
}

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
static double find_reach(const struct report_jitter *jitter)
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
static void make_bars(const struct report_jitter *jitter, struct bars *bars)
{
    int per_tick = jitter->count < 200 ? 8 : 16;

    *bars = (struct bars){.reach = per_tick * 5 / 4};
    if (jitter->n_bins == 0)
        return;
    bars->tick = report_round_up(fmax(find_reach(jitter) / 1.25, 1e3));
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

/* Where a row of panels stands. */
struct row {
    double top, height; /* of the row; of the page */
};

static double at(const struct row *row, double below_top)
{
    return report_screen(row->top + below_top, row->height);
}

static void put_heading(FILE *script, const struct row *row, const struct panel *panel)
{
    const struct report_jitter *jitter = &panel->jitter;

    fputs("set label 1 '{/:Bold ", script);
    for (const char *c = panel->heading; *c; c++) /* a name is no markup */
        fprintf(script, strchr("\\^_{}@&~", *c) ? "\\%c" : *c == '\'' ? "''" : "%c", *c);
    fprintf(script, "}' at graph 0, screen %.4f\n", at(row, 12));
    if (jitter->count == 0)
        return;
    if (panel->several) {
        fprintf(script, "set label 2 'mean period %s ", jitter->mean < 0 ? "−" : "+");
        put_duration(script, fabs(jitter->mean));
    } else {
        fprintf(script, "set label 2 'mean %.4f ms", (jitter->period + jitter->mean) / NS_PER_MS);
    }
    fprintf(script, "' at graph 0, screen %.4f textcolor rgb mark\n", at(row, 29));
    fputs("set label 3 '{/*0.9 sd ", script);
    put_duration(script, jitter->sd);
    fprintf(script, ", n = %.0f", (double)jitter->count);
    if (jitter->missed > 0)
        fprintf(script, ", %.0f missed", (double)jitter->missed);
    fprintf(script, "}' at graph 0, screen %.4f textcolor rgb quiet\n", at(row, 45));
}

/* Ticks at the period and to both sides of it; as differences where the times would get too many digits. */
static void put_increment_axis(FILE *script, const struct panel *panel, const struct bars *bars)
{
    const double period = panel->jitter.period;
    double end = (bars->reach + 0.5) * bars->width / NS_PER_MS, tick = bars->tick / NS_PER_MS;
    int decimals = (int)fmax(0, -floor(apc_log10(tick) + 1e-9));
    bool differences = panel->several || floor(apc_log10(period / NS_PER_MS)) + decimals > 5;
    double unit = differences && tick < 1 ? 1e3 : 1; /* of the labels, in 1/ms */

    fprintf(script, "set xrange [%.9g:%.9g]\nset xtics (", -end, end);
    for (int i = -1; i <= 1; i++) {
        if (differences)
            fprintf(script, "'%s%.4g' %.9g, ", i < 0 ? "−" : "", fabs(i * tick * unit), i * tick);
        else
            fprintf(script, "'%.*f' %.9g, ", decimals, period / NS_PER_MS + i * tick, i * tick);
    }
    fprintf(script, "'' %.9g 1, '' %.9g 1)\n", -0.5 * tick, 0.5 * tick);
    if (panel->several)
        fprintf(script, "set xlabel increment.' − period  (%s)' offset 0, 0.4\n", unit > 1 ? "µs" : "ms");
    else if (differences)
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

static void put_histogram(FILE *script, const struct row *row, int column, int number,
                          const struct panel *panel, const struct bars *bars, bool log_scale)
{
    const struct report_jitter *jitter = &panel->jitter;
    double left = 0.105 + 0.3 * column, top = (double)bars->peak, mean = jitter->mean / NS_PER_MS;

    fprintf(script, "%sset tmargin at screen %.4f\nset bmargin at screen %.4f\n", report_panel_style,
            at(row, 59), at(row, 183));
    fprintf(script, "set lmargin at screen %.4f\nset rmargin at screen %.4f\n", left, left + 0.255);
    if (column == 0) /* gnuplot knows labels of panels only */
        fputs("set label 6 'count' at screen 0.02, graph 0.5 center rotate\n", script);
    put_heading(script, row, panel);
    if (jitter->n_bins == 0 || jitter->count == 0) {
        fputs("unset xtics\nset xrange [0:1]\n", script);
        report_blank(script);
        return;
    }
    put_increment_axis(script, panel, bars);
    put_off_chart(script, bars);
    fputs("set grid noxtics\n", script);
    if (log_scale)
        fprintf(script, "set logscale y\nset format y '%%.0f'\nset yrange [0.6:%.9g]\n", 4 * fmax(10, top));
    else
        fprintf(script, "set ytics %.9g\nset yrange [0:%.9g]\n", fmax(1, report_round_up(top / 4)),
                1.25 * top);
    if (fabs(jitter->mean) < (bars->reach + 0.5) * bars->width)
        fprintf(script, "set arrow 1 from %.9g, graph 0 to %.9g, graph 1 nohead front lw 1.2 lc rgb mark\n",
                mean, mean);
    fprintf(script, "set boxwidth %.9g\nplot $jitter%d with boxes lc rgb 0x7FB2D6 notitle\n",
            0.92 * bars->width / NS_PER_MS, number);
}

/* ---- The panels --------------------------------------------------------------------------- */

/* @p to takes in what is known of one more task. Returns 0 or APC_ENOMEM. */
static int merge(struct report_jitter *to, const struct report_jitter *one)
{
    if (!one || one->count == 0)
        return 0;
    struct apc_bin *bins = reallocarray(to->bins, to->n_bins + one->n_bins + 1, sizeof *bins);
    if (!bins)
        return APC_ENOMEM;
    to->bins = bins;
    memcpy(bins + to->n_bins, one->bins, one->n_bins * sizeof *bins);
    to->n_bins += one->n_bins;
    const double n = (double)to->count, m = (double)one->count, apart = one->mean - to->mean;
    to->sd = sqrt((n * to->sd * to->sd + m * one->sd * one->sd + n * m / (n + m) * apart * apart) / (n + m));
    to->mean += m / (n + m) * apart;
    to->period = one->period;
    to->count += one->count;
    to->missed += one->missed;
    return 0;
}

static int add_histogram(struct report_histograms *h, const struct report_data *data, const char *heading,
                         const char *task)
{
    struct panel *panel = &h->panel[h->n++];
    *panel = (struct panel){0};
    snprintf(panel->heading, sizeof panel->heading, "%s", heading);
    return task ? merge(&panel->jitter, report_jitter_of(data, task)) : 0;
}

/* The controllers stand between simulator and client as in the paper's figure; those of a cascade in a row
 * below, to be compared; of very many it is how they do together that can be read. */
static int arrange_histograms(struct report_histograms *h, const struct report_data *data,
                              const struct experiment *e)
{
    const size_t n = e->n_controllers;
    const bool apart = n > 1 && n <= APART;
    char heading[APC_TAG_LEN + 16];
    int rc = add_histogram(h, data, "Simulator", "plant");
    if (n == 1 && rc == 0)
        rc = add_histogram(h, data, "Control module", e->controllers->name);
    if (n > APART && rc == 0) {
        snprintf(heading, sizeof heading, "%zu controllers", n);
        rc = add_histogram(h, data, heading, NULL);
        for (size_t i = 0; i < n && rc == 0; i++)
            rc = merge(&h->panel[1].jitter, report_jitter_of(data, e->controllers[i].name));
        h->panel[1].several = true;
    }
    if (rc == 0)
        rc = add_histogram(h, data, "Client module", "client");
    h->panel[1].wraps = apart;
    for (size_t i = 0; i < n && apart && rc == 0; i++) {
        snprintf(heading, sizeof heading, "Controller %s", e->controllers[i].name);
        rc = add_histogram(h, data, heading, e->controllers[i].name);
    }
    h->rows = apart ? 2 : 1;
    return rc;
}

/* Were all ticks exactly in time? Then there is nothing to show. */
static bool are_all_in_time(const struct report_histograms *h)
{
    bool ticked = false, exact = true;
    for (int i = 0; i < h->n; i++) {
        const struct report_jitter *jitter = &h->panel[i].jitter;
        ticked |= jitter->count > 0;
        for (size_t k = 0; k < jitter->n_bins; k++)
            exact &= jitter->bins[k].low <= 0 && jitter->bins[k].high >= 0;
    }
    return ticked && exact;
}

int report_histograms_create(struct report_histograms **histograms, const struct report_data *data,
                             const struct experiment *e)
{
    struct report_histograms *h = calloc(1, sizeof *h);
    *histograms = h;
    if (h && arrange_histograms(h, data, e) == 0) {
        h->n = are_all_in_time(h) ? 0 : h->n;
        return 0;
    }
    report_histograms_destroy(h);
    *histograms = NULL;
    return APC_ENOMEM;
}

void report_histograms_destroy(struct report_histograms *h)
{
    for (size_t i = 0; h && i < sizeof h->panel / sizeof *h->panel; i++)
        free(h->panel[i].jitter.bins);
    free(h);
}

double report_histograms_height(const struct report_histograms *h)
{
    return h->n > 0 ? h->rows * ROW + BELOW : 0;
}

void report_histograms_blocks(FILE *script, const struct report_histograms *h)
{
    struct bars bars;
    for (int i = 0; i < h->n; i++) {
        make_bars(&h->panel[i].jitter, &bars);
        put_bars(script, i, &bars);
    }
}

void report_histograms_draw(FILE *script, const struct report_histograms *h, double top, double height)
{
    struct row row = {top, height};
    struct bars bars[sizeof h->panel / sizeof *h->panel];
    bool log_scale = false; /* of the counts, the same for all: they are there to be compared */
    for (int i = 0; i < h->n; i++) {
        make_bars(&h->panel[i].jitter, &bars[i]);
        log_scale |= bars[i].peak > 60;
    }
    for (int i = 0, column = 0; i < h->n; i++) {
        put_histogram(script, &row, column++, i, &h->panel[i], &bars[i], log_scale);
        if (h->panel[i].wraps) {
            row.top += ROW;
            column = 0;
        }
    }
}
