/* SPDX-License-Identifier: BSD-3-Clause */
/* The run folder of a simulation is made by what makes that of a run, from the simulation's own store. */
#include "simulation_export.h"

#include <string.h>

#include "apc/folder/folder.h"
#include "daemon/recorder.h"

static int fill_timing(const struct simulation *s)
{
    int rc = 0;
    for (size_t i = 0; i < s->n_tasks && rc >= 0; i++) {
        const struct simulation_task *t = &s->task[i];
        struct apc_store *store = NULL;
        struct recorder *recorder = NULL;
        rc = apc_store_open(&store, s->uri, NULL, NULL);
        if (rc >= 0)
            rc = recorder_create(&recorder, store, t->name);
        if (rc >= 0 && !strcmp(t->name, "client"))
            recorder_measure(recorder, TASK_EXCHANGE, s->round_trip, &s->in_vain);
        if (rc >= 0)
            rc = recorder_flush(recorder, t->task, t->period);
        recorder_destroy(recorder);
    }
    return rc;
}

int simulation_export(const struct simulation *s, const char *dir, const char *by, apc_ns since,
                      struct apc_error *why)
{
    const struct folder_metadata metadata = {.by = by, .start = SIMULATION_BEGIN};
    int rc = folder_keep(dir, s->e, &metadata, why);
    if (rc < 0)
        return rc;
    if ((rc = fill_timing(s)) < 0)
        return apc_fail(why, rc, "%s: timing: %s", dir, apc_err_text(rc));
    rc = folder_export(dir, s->store, s->e, SIMULATION_BEGIN, s->ended, since, 0, why);
    return rc < 0 ? rc : trajectory_write(&s->trajectory, dir, why);
}
