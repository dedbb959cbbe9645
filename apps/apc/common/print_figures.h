/* SPDX-License-Identifier: BSD-3-Clause */
/* The figures of a run, for people and for programs. */
#ifndef APC_PRINT_FIGURES_H
#define APC_PRINT_FIGURES_H

#include <stdio.h>

#include "figures/figures.h"
#include "files/files.h"

/* A table of them for people, of whole runs and of their parts; at most @most rows (0: all). */
int figures_print(const struct figures *f, const struct trajectory *c, const struct experiment *e,
                  size_t most, FILE *out);
/* The members "of" and "loops" of a JSON object. */
void figures_members(const struct figures *f, const struct trajectory *c, const struct experiment *e,
                     struct text *t);

#endif
