/* SPDX-License-Identifier: BSD-3-Clause */
/* In the place of modbus.c and modbus_unit.c, in a libapc without Modbus. */
#include "base/base_internal.h"
#include "exchange/exchange_internal.h"

static int refuse_modbus(struct apc_error *why)
{
    return apc_fail(
        why, APC_ESTATE,
        "this libapc was built without Modbus (-DAPC_MODBUS=OFF), so there is no modbus:; build it "
        "again without that option");
}

static int open_exchange(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                         struct apc_error *why)
{
    (void)x, (void)uri, (void)options;
    return refuse_modbus(why);
}

const struct apc_exchange_ops apc_exchange_modbus = {.scheme = "modbus:", .open = open_exchange};

int apc_modbus_unit_create(struct apc_modbus_unit **unit, const struct apc_modbus_unit_options *options,
                           struct apc_error *why)
{
    (void)options;
    if (unit)
        *unit = NULL;
    return refuse_modbus(why);
}

void apc_modbus_unit_destroy(struct apc_modbus_unit *unit)
{
    (void)unit;
}

int apc_modbus_unit_answer(struct apc_modbus_unit *unit, const char *request, size_t length, char *reply,
                           size_t size)
{
    (void)unit, (void)request, (void)length, (void)reply, (void)size;
    return APC_ESTATE;
}
