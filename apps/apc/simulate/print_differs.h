/* SPDX-License-Identifier: BSD-3-Clause */
/* Why a replayed tick differs, for people and for programs. */
#ifndef APC_PRINT_DIFFERS_H
#define APC_PRINT_DIFFERS_H

#include "files/files.h"
#include "simulation/simulation.h"

/* @p when: its time; "": it has been told. Returns 0 or APC_ENOMEM. */
int print_differs(const struct differs *d, const char *when, FILE *out);
void put_differs_json(const struct differs *d, struct text *t);

#endif
