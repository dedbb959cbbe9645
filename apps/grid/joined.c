/* SPDX-License-Identifier: BSD-3-Clause */
/* Several records of one plant: all of them, or a part of each. */
#include <stdlib.h>
#include <string.h>

#include "grid.h"

int grid_join(struct identify_data *to, const struct identify_data *data, size_t n)
{
    const size_t inputs = data[0].record.nu + data[0].record.nd, ny = data[0].record.ny;
    size_t samples = 0;
    double *u, *y;

    for (size_t i = 0; i < n; i++)
        samples += data[i].record.n;
    *to = data[0];
    to->memory = calloc(samples * (inputs + ny) + 1, sizeof *to->memory);
    to->runs = calloc(n + 1, sizeof *to->runs);
    if (!to->memory || !to->runs)
        return APC_ENOMEM;
    u = to->memory;
    y = u + samples * inputs;
    to->record.u = u;
    to->record.y = y;
    to->record.n = 0;
    to->record.runs = n;
    to->record.begin = to->runs;
    for (size_t i = 0; i < n; i++) {
        const struct apc_record *r = &data[i].record;

        memcpy(u + to->record.n * inputs, r->u, r->n * inputs * sizeof *u);
        memcpy(y + to->record.n * ny, r->y, r->n * ny * sizeof *y);
        to->runs[i] = to->record.n;
        to->record.n += r->n;
        for (size_t k = 0; k < ny && i > 0; k++) {
            const struct identify_gaps *gaps = &data[i].gaps[k];

            to->gaps[k].missing += gaps->missing;
            to->gaps[k].longest = gaps->longest > to->gaps[k].longest ? gaps->longest : to->gaps[k].longest;
        }
    }
    return 0;
}

int grid_first(const struct apc_record *all, size_t until, struct apc_record *first, void **memory)
{
    const size_t inputs = all->nu + all->nd, runs = apc_record_runs(all);
    double *u = calloc(all->n * (inputs + all->ny) + runs + 1, sizeof *u), *y;
    size_t *begin;

    *memory = u;
    *first = *all;
    if (!u)
        return APC_ENOMEM;
    y = u + all->n * inputs;
    begin = (size_t *)(void *)(y + all->n * all->ny);
    first->u = u;
    first->y = y;
    first->begin = begin;
    first->n = 0;
    for (size_t g = 0; g < runs; g++) {
        const struct apc_record run = apc_record_run(all, g);
        const size_t n = apc_record_share(all, &run, until);

        begin[g] = first->n;
        memcpy(u + first->n * inputs, run.u, n * inputs * sizeof *u);
        memcpy(y + first->n * all->ny, run.y, n * all->ny * sizeof *y);
        first->n += n;
    }
    return 0;
}
