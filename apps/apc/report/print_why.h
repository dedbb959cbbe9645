/* SPDX-License-Identifier: BSD-3-Clause */
/* Why an output moved, for people. */
#ifndef APC_PRINT_WHY_H
#define APC_PRINT_WHY_H

#include <stdio.h>

#include "simulation/simulation.h"

/* As why_ask(); and upwards, from loop to loop. */
int print_why(const struct why_question *q, FILE *out, struct apc_error *why);

#endif
