/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PRINT_KPIS_H
#define APC_PRINT_KPIS_H

#include <stdio.h>

#include "figures/figures.h"
#include "files/files.h"

/* Tables for people. Returns 0 or APC_ENOMEM. */
int kpis_print(const struct kpis *m, FILE *out);
/* Members "kpis" and "merits", its deprecated name, for programs; times in s since @p start. */
void kpis_members(const struct kpis *m, apc_ns start, struct text *t);

#endif
