/* SPDX-License-Identifier: BSD-3-Clause */
/* The report of a run: the figure that a paper would show of it. */
#ifndef APC_REPORT_H
#define APC_REPORT_H

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "experiment/experiment.h"
#include "record/record.h"

/**
 * Draw report.svg and report.png in the run folder @p dir from its CSV files: on top a histogram of the time
 * increments t_{k+1} - t_k of simulator, controller and client, unless all of them were exact, as they are in
 * virtual time; below the modes that changed, and a panel for each unit of the measurements with their
 * setpoints, and of the outputs, or of very many loops a row for each controller, with the names, units and
 * limits of @p e; the disturbances, and what was out of the ordinary. @p expected, or NULL: laid over that.
 *
 * Returns 1; 0: it could not be drawn, as where gnuplot is missing, which stderr is told and which is no
 * failure of the command; or a negative error, and @p why: its files cannot be read, so the record is none.
 */
int report_leave(const struct cli *cli, const char *dir, const struct experiment *e, const char *title,
                 const struct prediction *expected, struct apc_error *why);
/** The same of what happened from `begin` to `end`, in s, as NAME.svg and NAME.png there. Returns 0 or an error. */
struct report_part {
    const char *name;
    double begin, end;
};
int report_leave_part(const char *dir, const struct experiment *e, const char *title,
                      const struct report_part *part, struct apc_error *why);

/* ---- A page of a window ---------------------------------------------------------------------- */

#define PAGE_ROWS  10000 /* of a table */
#define PAGE_LOOPS 50    /* that are drawn */

struct page_window {
    apc_ns from, until;        /* UTC */
    const char *plant, *title; /* "": it has none */
    bool folder;               /* of a run folder's files: without the alarms' journal */
    apc_ns zero;               /* of a simulation: times are s since then; 0: local */
};

/* What a store recorded in a window, as a page for paper: figures, loops, outages, alarms, what people wrote and entered,
 * what else happened. Returns 0 or a negative error. */
int report_page(FILE *out, struct apc_store *store, const struct page_window *window, struct apc_error *why);
/* A loop's measurement, setpoint and output there, as SVG. Returns 0 or the store's error. */
int report_trend(FILE *out, struct apc_store *store, const struct known_plant *plant,
                 const struct loops_loop *loop, const struct page_window *window);
/* Local time to the second, or s since the start; @p window is a struct page_window. */
char *report_time(const void *window, apc_ns utc, char text[PRINT_LEN]);

#endif
