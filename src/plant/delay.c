/* SPDX-License-Identifier: BSD-3-Clause */
#include "plant/plant_internal.h"

#include <stdlib.h>
#include <string.h>

int apc_delay_open(struct apc_delay *delay, double dead_time, size_t width)
{
    *delay = (struct apc_delay){.dead_time = dead_time, .width = width};
    if (!(dead_time > 0.0))
        return 0;
    delay->acts = calloc(APC_DELAY_MAX, sizeof(*delay->acts));
    delay->value = calloc(APC_DELAY_MAX * width, sizeof(*delay->value));
    return delay->acts && delay->value ? 0 : APC_ENOMEM;
}

void apc_delay_close(struct apc_delay *delay)
{
    free(delay->acts);
    free(delay->value);
}

static double *slot(const struct apc_delay *delay, size_t k)
{
    return delay->value + (delay->first + k) % APC_DELAY_MAX * delay->width;
}

bool apc_delay_put(struct apc_delay *delay, double t, const double *u, const double *now)
{
    size_t bytes = delay->width * sizeof(*u);
    const double *last = delay->n ? slot(delay, delay->n - 1) : now;

    if (memcmp(last, u, bytes) == 0)
        return true;
    if (delay->n == APC_DELAY_MAX)
        return false;
    delay->acts[(delay->first + delay->n) % APC_DELAY_MAX] = t + delay->dead_time;
    memcpy(slot(delay, delay->n), u, bytes);
    delay->n++;
    return true;
}

double apc_delay_take(struct apc_delay *delay, double t, double *now)
{
    while (delay->n && delay->acts[delay->first] <= t) {
        memcpy(now, slot(delay, 0), delay->width * sizeof(*now));
        delay->first = (delay->first + 1) % APC_DELAY_MAX;
        delay->n--;
    }
    return delay->n ? delay->acts[delay->first] : (double)INFINITY;
}
