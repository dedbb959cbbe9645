/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_SIMULATION_EXPORT_H
#define APC_SIMULATION_EXPORT_H

#include "simulation/simulation.h"

/* The run folder of what was simulated @p by a command, as `apc run` leaves one, with the samples since then,
 * UTC (0: all); folder_create() has made it. */
int simulation_export(const struct simulation *s, const char *dir, const char *by, apc_ns since,
                      struct apc_error *why);

#endif
