/* SPDX-License-Identifier: BSD-3-Clause */
/* The plant as a Modbus server. */
#include <stdio.h>
#include <stdlib.h>

#include "plant.h"

int registers_answer(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                     size_t size)
{
    struct shell *s = ctx;
    s->gateway.connection = connection;
    return apc_modbus_unit_answer(s->registers.unit, request, length, reply, size);
}

/* Of a file that says nothing of registers: each vector in its order, in the type that holds any of it. */
static int plain_map(struct shell *s, struct apc_modbus_options *map)
{
    const struct experiment *e = &s->d->experiment;
    const size_t n = e->dim.nu + e->dim.ny;
    struct apc_modbus_point *p = calloc(n, sizeof *p);

    s->registers.points = p;
    if (!p)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        const bool output = i < e->dim.nu;
        p[i] = (struct apc_modbus_point){.area = output ? APC_MODBUS_HOLDING : APC_MODBUS_INPUT,
                                         .type = APC_MODBUS_F32,
                                         .address = 2 * (unsigned)(output ? i : i - e->dim.nu)};
    }
    *map = (struct apc_modbus_options){.size = sizeof *map, .unit = 1, .u = p, .y = p + e->dim.nu};
    apc_log_write(
        s->d->log, APC_LOG_INFO,
        "unit 1, float32, high word first: %s at holding:0 and every second register on, %s at input:0 "
        "and on",
        e->u[0].tag.name, e->y[0].tag.name);
    return 0;
}

int registers_open(struct shell *s, struct apc_error *why)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_modbus_options map = e->client.modbus;
    double *initial = calloc(e->dim.nu, sizeof *initial);
    int rc = gateway_open(s, why);

    if (rc == 0 && (!initial || (!map.size && plain_map(s, &map) < 0))) {
        snprintf(why->text, sizeof why->text, "out of memory");
        rc = APC_ENOMEM;
    }
    for (size_t i = 0; i < e->dim.nu && rc == 0; i++)
        initial[i] = e->u[i].initial;
    const struct apc_modbus_unit_options options = {.size = sizeof options,
                                                    .nu = e->dim.nu,
                                                    .ny = e->dim.ny,
                                                    .modbus = &map,
                                                    .initial = initial,
                                                    .command = gateway_command,
                                                    .measure = gateway_measure,
                                                    .ctx = s};
    if (rc == 0)
        rc = apc_modbus_unit_create(&s->registers.unit, &options, why);
    free(initial);
    return rc;
}

void registers_close(struct shell *s)
{
    apc_modbus_unit_destroy(s->registers.unit);
    free(s->registers.points);
}
