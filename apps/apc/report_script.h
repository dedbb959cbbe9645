/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the parts of a figure have in common. The page is laid out in units of the SVG, from its top; gnuplot
 * wants fractions of its height, from the bottom.
 */
#ifndef APC_REPORT_SCRIPT_H
#define APC_REPORT_SCRIPT_H

#include "report_figure.h"

#define REPORT_WIDTH 800.0

/* At the begin of each panel. */
extern const char report_panel_style[];

/* The fraction for gnuplot of @p at units from the top of a page of @p height. */
double report_screen(double at, double height);
/* Text of a user as a gnuplot string. */
void report_quoted(FILE *script, const char *text);
/* The smallest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below @p value > 0. */
double report_round_up(double value);
/* A panel without data; its x axis is the caller's. */
void report_blank(FILE *script);

/* ---- Histograms of the time increments ---- */

/* Were all ticks exactly in time? Then there is nothing to show. */
bool report_jitter_none(const struct report_data *data);
/* Height that they take. */
#define REPORT_JITTER_HEIGHT 245.0
/* The bars as data blocks; then the panels, from @p top on. Sorts the bins of the data. */
void report_jitter_blocks(FILE *script, struct report_data *data);
void report_jitter_panels(FILE *script, struct report_data *data, double top, double height);

/* ---- Panels of the process variables ---- */

struct report_panels;
int report_panels_create(struct report_panels **panels, const struct report_data *data,
                         const struct experiment *e); /* 0 or APC_ENOMEM */
void report_panels_destroy(struct report_panels *panels);
double report_panels_height(const struct report_panels *panels);
void report_panels_blocks(FILE *script, const struct report_panels *panels);
void report_panels_draw(FILE *script, const struct report_panels *panels, double top, double height);

#endif
