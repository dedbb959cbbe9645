/* SPDX-License-Identifier: BSD-3-Clause */
/* What is allowed in an experiment, and hardly meant: said on stderr, once, by the command that starts it. */
#ifndef APC_WARN_H
#define APC_WARN_H

#include "cli.h"
#include "experiment/experiment.h"

void warn(const struct cli *cli, const struct experiment *e);

#endif
