/* SPDX-License-Identifier: BSD-3-Clause */
/* How the alarms of some time look: what was raised, and figures of how many. */
#ifndef APC_PRINT_ALARMS_H
#define APC_PRINT_ALARMS_H

#include <stdio.h>

#include "files/files.h"
#include "record/record.h"

/* Times are in s since @p start. Returns 0 or APC_ENOMEM. */
int alarms_print(const struct alarm_figures *figures, const struct experiment *e, apc_ns start, FILE *out);
/* ,"alarms":{...} */
void alarms_member_json(const struct alarm_figures *figures, const struct experiment *e, apc_ns start,
                        struct text *t);

#endif
