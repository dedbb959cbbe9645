/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures are drawn by gnuplot, from data and a script that go into its standard input. */
#ifndef APC_GNUPLOT_H
#define APC_GNUPLOT_H

#include <stdio.h>

#include <apcbase.h>

/* The scripts, report/NAME.gp each. */
extern const char figure_common[], figure_report[], figure_bode[], figure_front[], figure_steps[],
    figure_fit[], figure_compare[], figure_sweep[];

/*
 * Draw NAME.svg and NAME.png by @script. @put writes the data for it; it is called with the locale "C.UTF-8".
 * Returns 0, APC_ENOTFOUND (there is no gnuplot), or another error.
 */
int gnuplot_figure(const char *name, const char *script, void (*put)(FILE *script, void *ctx), void *ctx,
                   struct apc_error *why);

/* For @put: a text of a user's as it is to be shown; as a variable; as element @i, from 0 on, of an array. */
void gnuplot_characters(FILE *script, const char *text);
void gnuplot_string(FILE *script, const char *variable, const char *text);
void gnuplot_text(FILE *script, const char *array, size_t i, const char *text);

#endif
