/* SPDX-License-Identifier: BSD-3-Clause */
/* The report of a run: the figure that a paper would show of it. */
#ifndef APC_REPORT_H
#define APC_REPORT_H

#include "apc/common/cli.h"
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

#endif
