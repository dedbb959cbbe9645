/* SPDX-License-Identifier: BSD-3-Clause */
#include "samples.h"

#include <stdlib.h>

int samples_add(struct samples *s, const struct apc_sample *sample)
{
    if (s->n == s->room) {
        size_t room = s->room ? 2 * s->room : 4096;
        struct apc_sample *at = reallocarray(s->at, room, sizeof *at);
        if (!at)
            return APC_ENOMEM;
        s->at = at;
        s->room = room;
    }
    s->at[s->n++] = *sample;
    return 0;
}

void samples_free(struct samples *s)
{
    free(s->at);
    *s = (struct samples){0};
}

static int by_time(const void *left, const void *right)
{
    static const int rank[APC_TABLE_END] = {[APC_SETPOINT] = 1, [APC_SENSOR] = 2, [APC_ACTUATOR] = 3};
    const struct apc_sample *a = left, *b = right;
    if (a->time != b->time)
        return a->time < b->time ? -1 : 1;
    if (a->table != b->table)
        return rank[a->table] - rank[b->table];
    if (a->id != b->id)
        return a->id - b->id;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

void samples_sort(struct samples *s)
{
    if (s->n > 0)
        qsort(s->at, s->n, sizeof *s->at, by_time);
}

void samples_write(const struct samples *s, apc_ns start, FILE *out)
{
    fputs("time,table,id,status,value\n", out);
    for (size_t i = 0; i < s->n; i++) {
        const struct apc_sample *at = &s->at[i];
        char status[APC_STATUS_NAME_LEN], value[40];
        apc_number_format(at->value, value, sizeof value);
        fprintf(out, "%.6f,%s,%d,%s,%s\n", apc_ns_to_s(at->time - start), apc_table_name(at->table), at->id,
                apc_status_format(at->status, status), value);
    }
}
