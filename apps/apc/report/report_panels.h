/* SPDX-License-Identifier: BSD-3-Clause */
/* The figure of a run: what of it is put into the script for gnuplot. */
#ifndef APC_REPORT_PANELS_H
#define APC_REPORT_PANELS_H

#include "experiment/experiment.h"
#include "gnuplot.h"
#include "operate/operate.h"
#include "record/record.h"

#define PANELS_MAX   40
#define CURVES_NAMED 8 /* of a panel: more have no names in its legend */

/* A variable that is drawn: a measurement, perhaps with its setpoint; or an output. */
struct curve_of {
    const struct signal *signal;
    const struct report_series *series, *wanted; /* wanted: of the setpoint; NULL: none */
    const struct signal *setpoint;
    double low, high;           /* of all that is drawn of it; low > high: nothing */
    double least, most;         /* its limits, or those within which its law keeps it */
    const struct signal *above; /* the setpoint of the controller that moves the setpoint; NULL: none */
    const struct report_series *wanted_above;
    const struct prediction_trajectory *expected; /* of the signal, or of the setpoint; NULL: none */
};

struct panel {
    size_t first, n; /* of its curves */
    bool outputs;
    const struct loops_controller *bundle; /* whose loops it shows, half a page wide; NULL: no bundle */
    size_t worst, loop;                    /* of a bundle: the curve that stands out, and its loop */
};

struct report_panels {
    const struct report_data *data;
    const struct experiment *e;
    struct curve_of *curve; /* [n_curves] in the order of the panels */
    struct signal *shadow;  /* [number of outputs in shadow] what each would put out, as a curve's signal */
    size_t n_curves, n_drawn;
    struct panel panel[PANELS_MAX];
    size_t n, few; /* few: curves that a panel may have */
    struct loops loops;
};

static inline bool is_output(const struct curve_of *c)
{
    /* NOLINTNEXTLINE(clang-analyzer-core.NullDereference): each curve was collected with its signal */
    return c->signal->tag.table == APC_ACTUATOR;
}

int report_panels_create(struct report_panels **panels, const struct report_data *data,
                         const struct experiment *e); /* 0 or APC_ENOMEM */
void report_panels_destroy(struct report_panels *panels);
void report_panels_put(FILE *script, const struct report_panels *panels);

/* Collect the curves and put them into panels. Returns 0 or APC_ENOMEM. */
int report_arrange(struct report_panels *p);

/* Modes that were not the same all the time. */
void report_lanes_put(FILE *script, const struct report_data *data, const struct experiment *e,
                      const struct loops *loops);

/* Histograms of the time increments; none where all ticks were exactly in time. */
struct report_histograms;
int report_histograms_create(struct report_histograms **histograms, const struct report_data *data,
                             const struct experiment *e); /* 0 or APC_ENOMEM */
void report_histograms_destroy(struct report_histograms *histograms);
void report_histograms_put(FILE *script, const struct report_histograms *histograms);

#endif
