/* SPDX-License-Identifier: BSD-3-Clause */
/* The report of a run: the figure that a paper would show of it. */
#ifndef APC_REPORT_H
#define APC_REPORT_H

#include <apcbase.h>

/**
 * Draw report.svg and report.png in the run folder @p dir from its samples.csv, timing.csv and
 * timing-summary.csv: on top a histogram of the time increments t_{k+1} - t_k of simulator, controller
 * and client; below the measurements with their setpoints, and the manipulated variables. @p title may
 * be NULL. What a folder has no samples of is left blank and says so.
 *
 * Returns 0; APC_ENOTFOUND (a file is missing, or gnuplot is), APC_EPROTO (a malformed line; @p why
 * names file, line and column), APC_ENOMEM, APC_ESYS.
 */
int report_write(const char *dir, const char *title, struct apc_error *why);

#endif
