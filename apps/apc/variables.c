/* SPDX-License-Identifier: BSD-3-Clause */
#include "variables.h"

#include <stdlib.h>
#include <string.h>

void variables_free(struct variables *v)
{
    for (int table = 0; table < APC_TABLE_END; table++)
        free(v->newest[table]);
    samples_free(&v->history);
    *v = (struct variables){0};
}

void variables_read(const struct variables *v, struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        struct apc_sample *s = &samples[i];
        size_t id = (size_t)s->id;
        if (id < v->n[s->table] && v->newest[s->table][id].seq > 0)
            *s = v->newest[s->table][id];
        else
            *s = (struct apc_sample){.table = s->table, .id = s->id, .status = APC_BAD_NO_DATA};
    }
}

/* Where the newest sample of that variable is kept, or NULL: no memory. */
static struct apc_sample *place(struct variables *v, enum apc_table table, int id)
{
    size_t wanted = (size_t)id + 1, n = v->n[table];
    if (wanted > n) {
        wanted += n;
        struct apc_sample *grown = reallocarray(v->newest[table], wanted, sizeof *grown);
        if (!grown)
            return NULL;
        memset(grown + n, 0, (wanted - n) * sizeof *grown);
        v->newest[table] = grown;
        v->n[table] = wanted;
    }
    return &v->newest[table][id];
}

int variables_append(struct variables *v, const struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &samples[i];
        struct apc_sample *newest = place(v, s->table, s->id);
        if (!newest)
            return APC_ENOMEM;
        *newest = *s;
        newest->time -= newest->time % 1000; /* a store keeps microseconds */
        if ((s->table == APC_SENSOR || s->table == APC_ACTUATOR || s->table == APC_SETPOINT) &&
            samples_add(&v->history, newest) < 0)
            return APC_ENOMEM;
    }
    return 0;
}

int variables_put(struct variables *v, struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *newest = place(v, samples[i].table, samples[i].id);
        if (!newest)
            return APC_ENOMEM;
        samples[i].seq = newest->seq + 1;
    }
    return variables_append(v, samples, n);
}
