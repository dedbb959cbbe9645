/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PRINT_PREDICTION_H
#define APC_PRINT_PREDICTION_H

#include "files/files.h"
#include "record/record.h"

#include <stdio.h>

/* A table of what was expected and what came, at steps that double. Returns 0 or APC_ENOMEM. */
int prediction_print(const struct prediction *o, FILE *out);
/* "expectations":[...], all of them. */
void prediction_member(const struct prediction *o, struct text *t);

#endif
