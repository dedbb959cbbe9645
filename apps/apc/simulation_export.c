/* SPDX-License-Identifier: BSD-3-Clause */
/* The run folder of a simulation is made by what makes that of a run, from the simulation's own store. */
#include "simulation_export.h"

#include "common/recorder.h"
#include "folder.h"

static int fill_timing(const struct simulation *s)
{
    const struct experiment *e = s->e;
    const apc_ns period[SIM_TASKS] = {
        [SIM_SCHEDULER] = e->scheduler.rhythm.period,
        [SIM_PLANT] = e->plant.rhythm.period,
        [SIM_CLIENT] = e->client.rhythm.period,
        [SIM_CONTROLLER] = e->controllers->rhythm.period,
    };
    int rc = 0;
    for (int i = 0; i < SIM_TASKS && rc >= 0; i++) {
        struct apc_store *store = NULL;
        struct recorder *recorder = NULL;
        rc = apc_store_open(&store, s->uri, NULL, NULL);
        if (rc >= 0)
            rc = recorder_create(&recorder, store, simulation_task_name((enum simulation_task)i));
        if (rc >= 0 && i == SIM_CLIENT)
            recorder_measure(recorder, TASK_EXCHANGE, s->round_trip, &s->in_vain);
        if (rc >= 0)
            rc = recorder_flush(recorder, s->task[i], period[i]);
        recorder_destroy(recorder);
    }
    return rc;
}

int simulation_export(const struct simulation *s, const char *dir, struct apc_error *why)
{
    const struct folder_facts facts = {.by = "apc simulate", .start = SIMULATION_BEGIN};
    int rc = folder_keep(dir, s->e, &facts, why);
    if (rc < 0)
        return rc;
    if ((rc = fill_timing(s)) < 0)
        return apc_fail(why, rc, "%s: timing: %s", dir, apc_err_text(rc));
    rc = folder_export(dir, s->store, s->e, SIMULATION_BEGIN, s->ended, 0, 0, why);
    return rc < 0 ? rc : course_write(&s->course, dir, why);
}
