/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcbase.h"

#include <string.h>

static const char *const table_names[APC_TABLE_END] = {
    [APC_SENSOR] = "sensor",     [APC_ACTUATOR] = "actuator",     [APC_SETPOINT] = "setpoint",
    [APC_DIM] = "dim",           [APC_OPMODE] = "opmode",         [APC_TUNING] = "tuning",
    [APC_MANUAL] = "manual",     [APC_STATE] = "state",           [APC_ACTUAL] = "actual",
    [APC_ESTIMATE] = "estimate", [APC_ALARM] = "alarm",           [APC_TICK] = "tick",
    [APC_PLAN] = "plan",         [APC_PREDICTION] = "prediction",
};

const char *apc_table_name(enum apc_table table)
{
    return (int)table > 0 && table < APC_TABLE_END ? table_names[table] : NULL;
}

enum apc_table apc_table_parse(const char *name)
{
    for (int table = 1; name && table < APC_TABLE_END; table++)
        if (!strcmp(table_names[table], name))
            return (enum apc_table)table;
    return (enum apc_table)0;
}

bool apc_table_vectors(enum apc_table table)
{
    return table == APC_TICK || table == APC_PLAN || table == APC_PREDICTION;
}

int apc_variable_number(enum apc_table table, int id)
{
    return id * 16 + (int)table;
}

const char *apc_mode_name(int mode)
{
    static const char *const names[] = {
        [APC_MODE_MAN] = "Man", [APC_MODE_AUTO] = "Auto", [APC_MODE_OOS] = "OOS",
        [APC_MODE_CAS] = "Cas", [APC_MODE_IMAN] = "IMan", [APC_MODE_LO] = "LO"};
    return mode >= APC_MODE_MAN && mode <= APC_MODE_LO ? names[mode] : NULL;
}
