/* SPDX-License-Identifier: BSD-3-Clause */
/* Vectors to and from the core, for those who serve it in another language. One thread at a time. */
#include <stdio.h>
#include <stdlib.h>

#include "plant.h"

/* Of Modbus's exceptions those that this plant gives itself. */
enum { ILLEGAL_VALUE = 3, DEVICE_FAILURE, DEVICE_BUSY = 6 };

/* One frame to the core: 0 or its refusal, with the values of its reply in samples. */
static int ask_core(struct shell *s, enum apc_frame_kind kind, size_t n)
{
    struct gateway *g = &s->gateway;
    struct apc_frame frame = {.kind = kind, .id = ++g->id, .n = n};
    int length = apc_frame_encode(g->request, g->room, &frame, g->samples);
    if (length > 0)
        length = on_plant_request(s, g->connection, g->request, (size_t)length, g->reply, g->room);
    return length > 0
               ? apc_frame_decode(g->reply, (size_t)length, &frame, g->samples, s->d->experiment.dim.ny)
               : length;
}

int gateway_command(void *ctx, const double *u, bool alive)
{
    struct shell *s = ctx;
    const struct experiment *e = &s->d->experiment;
    bool within = true;

    if (alive || !s->gateway.stamp)
        s->gateway.stamp = apc_clock_utc(NULL);
    for (size_t i = 0; i < e->dim.nu; i++) {
        s->gateway.samples[i] = (struct apc_sample){.time = s->gateway.stamp, .value = u[i]};
        within = within && u[i] >= e->u[i].tag.low && u[i] <= e->u[i].tag.high;
    }
    int rc = ask_core(s, APC_FRAME_COMMAND, e->dim.nu);
    if (rc == APC_EPERM)
        return DEVICE_BUSY;
    if (rc < 0 && rc != APC_EINVAL)
        return DEVICE_FAILURE;
    return within && rc == 0 ? 0 : ILLEGAL_VALUE;
}

unsigned gateway_measure(void *ctx, struct apc_value *y)
{
    struct shell *s = ctx;
    int rc = ask_core(s, APC_FRAME_QUERY, 0);

    for (size_t i = 0; i < s->d->experiment.dim.ny; i++) {
        const struct apc_sample *from = &s->gateway.samples[i];
        y[i] = rc == 0 ? (struct apc_value){.time = from->time, .status = from->status, .value = from->value}
                       : (struct apc_value){.status = APC_BAD_DEVICE_FAILURE};
    }
    pthread_mutex_lock(&s->mutex);
    const unsigned ticks = s->ticks;
    pthread_mutex_unlock(&s->mutex);
    return ticks;
}

int gateway_open(struct shell *s, struct apc_error *why)
{
    const struct experiment *e = &s->d->experiment;
    const size_t most = e->dim.nu > e->dim.ny ? e->dim.nu : e->dim.ny;
    struct gateway *g = &s->gateway;

    g->room = APC_FRAME_ROOM(most);
    g->samples = calloc(most, sizeof *g->samples);
    g->request = malloc(g->room);
    g->reply = malloc(g->room);
    if (g->samples && g->request && g->reply)
        return 0;
    snprintf(why->text, sizeof why->text, "out of memory");
    return APC_ENOMEM;
}

void gateway_close(struct shell *s)
{
    free(s->gateway.samples);
    free(s->gateway.request);
    free(s->gateway.reply);
}
