/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PRINT_MERITS_H
#define APC_PRINT_MERITS_H

#include <stdio.h>

#include "figures/figures.h"

/* Tables for people. Returns 0 or APC_ENOMEM. */
int kpis_print(const struct kpis *m, FILE *out);
/* Member "merits" for programs; times in s since @p start. */
void kpis_json(const struct kpis *m, apc_ns start, FILE *out);

#endif
