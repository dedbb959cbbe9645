/* SPDX-License-Identifier: BSD-3-Clause */
/* A simulation's records go through a store in memory, so that its folder is made by what makes that of a
 * run. */
#include "common/recorder.h"
#include "folder.h"
#include "simulation.h"

#define STORE "mem:apc-simulate"
#define CHUNK 4096

static int fill(const struct simulation *s, struct apc_store *store)
{
    const struct samples *history = &s->variables.history;
    int rc = apc_store_init(store);
    for (size_t i = 0; i < history->n && rc >= 0; i += CHUNK)
        rc = apc_store_append(store, history->at + i, history->n - i < CHUNK ? history->n - i : CHUNK);
    for (size_t i = 0; i < s->n_events && rc >= 0; i += CHUNK)
        rc = apc_store_append_events(store, s->events + i, s->n_events - i < CHUNK ? s->n_events - i : CHUNK);
    return rc;
}

static int fill_timing(const struct simulation *s)
{
    const struct experiment *e = s->e;
    const apc_ns period[SIM_TASKS] = {
        [SIM_SCHEDULER] = e->scheduler.rhythm.period,
        [SIM_PLANT] = e->plant.rhythm.period,
        [SIM_CLIENT] = e->client.rhythm.period,
        [SIM_CONTROLLER] = e->controller.rhythm.period,
    };
    int rc = 0;
    for (int i = 0; i < SIM_TASKS && rc >= 0; i++) {
        struct apc_store *store = NULL;
        struct recorder *recorder = NULL;
        rc = apc_store_open(&store, STORE, NULL, NULL);
        if (rc >= 0)
            rc = recorder_create(&recorder, store, simulation_task_name((enum simulation_task)i));
        if (rc >= 0)
            rc = recorder_flush(recorder, s->task[i], period[i]);
        recorder_destroy(recorder);
    }
    return rc;
}

int simulation_export(const struct simulation *s, const char *dir, const char *experiment_file,
                      struct apc_error *why)
{
    struct apc_store *store = NULL;
    int rc = folder_create(dir, experiment_file, why);
    if (rc < 0)
        return rc;
    rc = apc_store_open(&store, STORE, NULL, why);
    if (rc >= 0 && ((rc = fill(s, store)) < 0 || (rc = fill_timing(s)) < 0))
        apc_fail(why, rc, "%s: %s", dir, apc_store_error(store));
    if (rc >= 0)
        rc = folder_export(dir, store, s->e, SIMULATION_BEGIN, 0, 0, why);
    apc_store_close(store);
    return rc < 0 ? rc : 0;
}
