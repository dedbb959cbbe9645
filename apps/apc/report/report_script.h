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

struct report_histograms;
int report_histograms_create(struct report_histograms **histograms, const struct report_data *data,
                             const struct experiment *e); /* 0 or APC_ENOMEM */
void report_histograms_destroy(struct report_histograms *histograms);
/* 0 where all ticks were exactly in time: there is nothing to show. */
double report_histograms_height(const struct report_histograms *histograms);
/* The bars as data blocks; then the panels, from @p top on. */
void report_histograms_blocks(FILE *script, const struct report_histograms *histograms);
void report_histograms_draw(FILE *script, const struct report_histograms *histograms, double top,
                            double height);

/* ---- Modes that were not the same all the time ---- */

struct loops;
struct report_lanes;
#define LANES_GAP 12.0 /* below them; part of their height */
int report_lanes_create(struct report_lanes **lanes, const struct report_data *data,
                        const struct experiment *e, const struct loops *loops); /* 0 or APC_ENOMEM */
void report_lanes_destroy(struct report_lanes *lanes);
/* 0: there are none. */
double report_lanes_height(const struct report_lanes *lanes);
/* Into a panel whose place and times are set: @p unit s to a number of its axis, @p length s, @p width wide. */
void report_lanes_draw(FILE *script, const struct report_lanes *lanes, double unit, double length,
                       double width);

/* ---- Panels of the process variables ---- */

struct report_panels;
int report_panels_create(struct report_panels **panels, const struct report_data *data,
                         const struct experiment *e); /* 0 or APC_ENOMEM */
void report_panels_destroy(struct report_panels *panels);
double report_panels_height(const struct report_panels *panels);
void report_panels_blocks(FILE *script, const struct report_panels *panels);
void report_panels_draw(FILE *script, const struct report_panels *panels, double top, double height);

#endif
