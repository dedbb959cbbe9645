/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_SIMULATION_EXPORT_H
#define APC_SIMULATION_EXPORT_H

#include "run/simulation.h"

/* The run folder of what was simulated, as `apc run` leaves one; folder_create() has made it. */
int simulation_export(const struct simulation *s, const char *dir, struct apc_error *why);

#endif
