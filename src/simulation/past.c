/* SPDX-License-Identifier: BSD-3-Clause */
/* An experiment that has a past begins as what was, and goes on by itself from there. */
#include <stdlib.h>

#include "simulation_internal.h"

int simulation_take_past(struct simulation *s, struct apc_error *why)
{
    const struct experiment *e = s->e;
    struct simulation_past *past = calloc(1, sizeof *past);
    apc_ns end = 0;
    if (!past)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    (void)apc_ns_from_s(e->past, &end);
    s->past = past;
    past->is = e;
    past->at = e->past;
    int rc = experiment_load(&past->was, e->past_dir, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    if (rc == 0 && !past->was.plant.model)
        rc = apc_fail(why, APC_EINVAL, "%s names no model of its plant: there is nothing to simulate",
                      e->past_dir);
    if (rc == 0)
        rc = playback_load(&past->playback, e->past_dir, &past->was, end, why);
    s->e = &past->was;
    s->seed = past->was.seed;
    s->playback = &past->playback;
    return rc;
}

void simulation_end_past(struct simulation *s)
{
    struct simulation_past *const past = s->past;
    char was[APC_TIME_LEN];
    struct apc_error why;
    past->over = true;
    if (simulation_branch(s, past->is, &why) < 0)
        return;
    simulation_tell(s, "apc-simulate", APC_EVENT_WARNING, "past",
                    "simulated from here on: so the plant was at %s",
                    apc_time_format(past->playback.end, was));
    if (past->written && simulation_repeat_writes(s, past->written) < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

void simulation_free_past(struct simulation_past *past)
{
    if (!past)
        return;
    playback_free(&past->playback);
    experiment_free(&past->was);
    free(past);
}
