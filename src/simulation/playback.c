/* SPDX-License-Identifier: BSD-3-Clause */
#include "simulation.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "record/record.h"

/* ---- What is played ------------------------------------------------------------------------- */

/* Setpoints under the numbers that tick rows name. */
static int take_recorded_setpoints(struct playback *p, const struct experiment *e)
{
    const struct apc_range before = {.until = p->start, .last = 1},
                           range = {.since = p->start, .until = p->end};
    int rc = 0;
    for (size_t k = 0; k < e->dim.nz && rc == 0; k++) {
        rc = samples_collect_one(&p->rows, p->ticks, APC_SETPOINT, (int)k + 1, &before);
        if (rc == 0)
            rc = samples_collect_one(&p->rows, p->ticks, APC_SETPOINT, (int)k + 1, &range);
    }
    for (size_t i = 0; i < p->rows.n; i++)
        p->rows.at[i].time += SIMULATION_BEGIN - p->start;
    return rc;
}

/* The plant's own measurements are made anew. */
static int take_outputs(struct playback *p, const struct experiment *e, const struct samples *process)
{
    int rc = 0;
    for (size_t i = 0; i < process->n && rc == 0; i++) {
        struct apc_sample row = process->at[i];
        const bool calculated = row.table == APC_SENSOR && (size_t)row.id > e->dim.ny;
        if ((row.table != APC_ACTUATOR && !calculated) || row.time >= p->end - p->start)
            continue;
        row.time += SIMULATION_BEGIN;
        rc = samples_add(&p->rows, &row);
    }
    return rc;
}

int playback_take(struct playback *p, const struct samples *process, const struct experiment *e)
{
    int rc = take_recorded_setpoints(p, e);
    if (rc == 0)
        rc = take_outputs(p, e, process);
    samples_sort(&p->rows);
    return rc;
}

int playback_load(struct playback *p, const char *dir, const struct experiment *e, apc_ns end,
                  struct apc_error *why)
{
    char path[600];
    struct samples process = {0};
    const apc_ns start = e->start ? e->start : SIMULATION_BEGIN;
    *p = (struct playback){.start = start, .end = start + end};
    snprintf(path, sizeof path, "%.580s/" TICKS_FILE, dir);
    if (access(path, R_OK) < 0)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    int rc = ticks_open(&p->ticks, path, why);
    if (rc == 0)
        rc = samples_read(&process, dir, "samples.csv", why);
    if (rc == 0 && (rc = playback_take(p, &process, e)) < 0)
        apc_fail(why, rc, "%s: %s", path, rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(p->ticks));
    samples_free(&process);
    return rc;
}

void playback_free(struct playback *p)
{
    apc_store_close(p->ticks);
    samples_free(&p->rows);
}

/* ---- What is gone on from ------------------------------------------------------------------- */

struct move {
    struct apc_store *to;
    apc_ns by;
    int failed;
};

static int move_sample(void *ctx, const struct apc_sample *sample)
{
    struct move *m = ctx;
    struct apc_sample row = *sample;
    row.time += m->by;
    const int rc = apc_store_append(m->to, &row, 1);
    return m->failed = rc < 0 ? rc : 0;
}

static int move_vector(void *ctx, const struct apc_vector *vector)
{
    struct move *m = ctx;
    struct apc_vector row = *vector;
    const struct apc_rows rows = {.size = sizeof rows, .vector = &row, .n_vectors = 1};
    row.time += m->by;
    row.room = row.n;
    const int rc = apc_store_append_rows(m->to, &rows);
    return m->failed = rc < 0 ? rc : 0;
}

int playback_end(const struct playback *p, struct apc_store *to)
{
    const struct apc_range newest = {.until = p->end, .last = 1};
    struct move m = {.to = to, .by = SIMULATION_BEGIN - p->start};
    int n = apc_store_variables(p->ticks, NULL, 0);
    struct apc_sample *variable = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *variable);
    if (!variable)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_variables(p->ticks, variable, (size_t)n);
    n = rc < n ? rc : n;
    for (int i = 0; i < n && rc >= 0 && m.failed == 0; i++)
        if (apc_table_vectors(variable[i].table))
            rc = apc_store_vectors(p->ticks, variable[i].table, variable[i].id, &newest, move_vector, &m);
        else if (ticks_name(variable[i].table) && variable[i].table != APC_SETPOINT)
            rc = apc_store_history(p->ticks, variable[i].table, variable[i].id, &newest, move_sample, &m);
    free(variable);
    return m.failed < 0 ? m.failed : rc < 0 ? rc : 0;
}
