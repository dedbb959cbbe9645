/* SPDX-License-Identifier: BSD-3-Clause */
/* The figure of a run as a gnuplot script. */
#ifndef APC_REPORT_FIGURE_H
#define APC_REPORT_FIGURE_H

#include <stdio.h>

#include "experiment/experiment.h"
#include "record/record.h"

/* Write a script that makes report.svg and report.png in gnuplot's working directory. The calling
 * thread's locale must be "C.UTF-8". Returns 0 or APC_ENOMEM. */
int report_figure(FILE *script, const struct report_data *data, const struct experiment *e,
                  const char *title);

#endif
