/* SPDX-License-Identifier: BSD-3-Clause */
/* The clock of a plant that is simulated: how fast it goes, and whether anybody simulates it still. */
#include "apc-ui/ui.h"

#include <stdio.h>
#include <stdlib.h>

#include "common/storeuri.h"

bool model_look_simulated(struct model *m, struct apc_store *store)
{
    struct simulated_plant now = {.state = 0};
    struct apc_error why = {""};
    now.state = store_simulated(store, &now.clock, &why);
    snprintf(now.why, sizeof now.why, "%.299s", now.state < 0 ? why.text : "");
    pthread_mutex_lock(&m->mutex);
    now.latest = now.state > 0 ? now.clock.now : m->simulated.latest;
    now.rewound = m->simulated.rewound || now.latest < m->simulated.latest;
    m->simulated = now;
    pthread_mutex_unlock(&m->mutex);
    return now.state < 0 && now.clock.reached < 0;
}

int model_simulated(struct model *m, struct apc_store *store, struct apc_store_clock *clock,
                    struct apc_error *why)
{
    const int rc = store_simulated(store, clock, why);
    pthread_mutex_lock(&m->mutex);
    const bool was = m->simulated.latest > 0;
    pthread_mutex_unlock(&m->mutex);
    return rc == 0 && was ? apc_fail(why, APC_ESTATE, STORE_BEGINS) : rc;
}

bool model_rewound(struct model *m)
{
    pthread_mutex_lock(&m->mutex);
    const bool rewound = m->simulated.rewound;
    pthread_mutex_unlock(&m->mutex);
    return rewound;
}

void simulated_json(const struct model *m, struct text *t)
{
    const struct simulated_plant *s = &m->simulated;
    if (s->state == 0 || s->clock.now == 0) /* or the store is away */
        json_add(t, "null");
    else
        json_add(t, "{t:%.6jd, asked:%g, reached:%g, steps:%ju, second:%i, error:%-s}", s->clock.now,
                 s->clock.asked, s->state > 0 && s->clock.asked != 0 ? s->clock.reached : 0.0,
                 (uintmax_t)s->clock.steps, getenv("APC_FORKED") != NULL, s->why);
}
