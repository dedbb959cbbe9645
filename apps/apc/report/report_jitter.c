/* SPDX-License-Identifier: BSD-3-Clause */
/* How regularly the tasks ticked: a histogram of the time increments of each; of many controllers one of all. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apcmath.h>

#include "report_panels.h"

#define NS_PER_MS 1e6
#define BARS_MAX  41 /* of a panel; the middle one stands on the period */

#define APART 3 /* so many controllers have a panel each */

/* A panel: the increments of one task, or of all controllers together. */
struct histogram {
    char heading[APC_TAG_LEN + 16];
    struct report_jitter jitter; /* count 0: nothing is known of its task */
    bool several;                /* tasks of different periods: increments are shown as differences */
    bool wraps;                  /* a row begins behind it */
};

struct report_histograms {
    struct histogram of[2 + APART];
    int n, rows;
};

/* A histogram as it is drawn: bars of one width, and what lies off the chart. */
struct bars {
    double tick, width; /* ns: distance of the labelled ticks from the period; width of a bar */
    int reach;          /* bars to each side of the middle one */
    uint64_t count[BARS_MAX], peak, below, above;
};

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

/* The smallest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below @p value > 0. */
static double round_up(double value)
{
    const double decade = apc_pow(10.0, floor(apc_log10(value) + 1e-9)), digit = value / decade * (1 - 1e-9);
    return decade * (digit <= 6 ? ceil(digit) : digit <= 8 ? 8 : 10);
}

/* The buckets are far narrower than a bar, so each goes as a whole to the bar that its middle lies in. */
static void make_bars(const struct report_jitter *jitter, struct bars *bars)
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
    struct histogram *panel = &h->of[h->n++];
    *panel = (struct histogram){0};
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
            rc = merge(&h->of[1].jitter, report_jitter_of(data, e->controllers[i].name));
        h->of[1].several = true;
    }
    if (rc == 0)
        rc = add_histogram(h, data, "Client module", "client");
    h->of[1].wraps = apart;
    for (size_t i = 0; i < n && apart && rc == 0; i++) {
        snprintf(heading, sizeof heading, "Controller %s", e->controllers[i].name);
        rc = add_histogram(h, data, heading, e->controllers[i].name);
    }
    h->rows = apart ? 2 : 1;
    return rc;
}

/* Was no tick other than exactly in time? Then there is nothing to show. */
static bool are_all_in_time(const struct report_histograms *h)
{
    bool exact = true;
    for (int i = 0; i < h->n; i++) {
        const struct report_jitter *jitter = &h->of[i].jitter;
        for (size_t k = 0; k < jitter->n_bins; k++)
            exact &= jitter->bins[k].low <= 0 && jitter->bins[k].high >= 0;
    }
    return exact;
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
    for (size_t i = 0; h && i < sizeof h->of / sizeof *h->of; i++)
        free(h->of[i].jitter.bins);
    free(h);
}

void report_histograms_put(FILE *script, const struct report_histograms *h)
{
    struct bars bars[sizeof h->of / sizeof *h->of];
    fprintf(script, "histograms = %d\nrows = %d\narray heading[%zu]\n", h->n, h->rows,
            sizeof h->of / sizeof *h->of);
    for (int i = 0; i < h->n; i++) {
        make_bars(&h->of[i].jitter, &bars[i]);
        gnuplot_text(script, "heading", (size_t)i, h->of[i].heading);
        fprintf(script, "$jitter%d << END\n", i + 1);
        for (int k = 0; k <= 2 * bars[i].reach; k++)
            if (bars[i].count[k] > 0)
                fprintf(script, "%.9g %.9g\n", (k - bars[i].reach) * bars[i].width / NS_PER_MS,
                        (double)bars[i].count[k]);
        fputs("END\n", script);
    }
    fputs("$histogram << END\n", script);
    for (int i = 0; i < h->n; i++) {
        const struct report_jitter *j = &h->of[i].jitter;
        fprintf(script, "%#.12g %#.9g %#.9g %#.12g %#.12g %d %d ", j->period, j->mean, j->sd,
                (double)j->count, (double)j->missed, h->of[i].several, h->of[i].wraps);
        fprintf(script, "%#.9g %#.9g %d %#.9g %#.9g %#.9g\n", bars[i].tick, bars[i].width, bars[i].reach,
                (double)bars[i].peak, (double)bars[i].below, (double)bars[i].above);
    }
    fputs("END\n", script);
}
