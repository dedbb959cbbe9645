/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PRINT_PREDICTION_H
#define APC_PRINT_PREDICTION_H

#include "files/files.h"
#include "record/record.h"

#include <stdio.h>

struct print_table;

/* A table of what was expected and what came, at steps that double; to be ended by print_table_end() or page_table(). */
void prediction_table(const struct prediction *o, struct print_table *table);
/* The same as text. Returns 0 or APC_ENOMEM. */
int prediction_print(const struct prediction *o, FILE *out);
/* "expectations":[...], all of them. */
void prediction_member(const struct prediction *o, struct text *t);

#endif
