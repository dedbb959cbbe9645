/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures are drawn by gnuplot, from a script that goes into its standard input. */
#ifndef APC_GNUPLOT_H
#define APC_GNUPLOT_H

#include <stdio.h>

#include <apcbase.h>

/*
 * Run gnuplot in folder @dir with what @write writes, which is called with the locale "C.UTF-8" and returns 0
 * or an error. @what is drawn, for messages. Returns 0, APC_ENOTFOUND (there is no gnuplot), or another
 * error.
 */
int gnuplot_draw(const char *dir, int (*write)(FILE *script, void *ctx), void *ctx, const char *what,
                 struct apc_error *why);

/*
 * Draw NAME.svg and NAME.png, @width wide in units of the SVG; the PNG has two pixels for each. @write puts
 * its panels, once for each of them, the @first time with what both need.
 */
int gnuplot_figure(const char *name, double width, double height,
                   void (*write)(FILE *script, void *ctx, bool first), void *ctx, struct apc_error *why);

#endif
