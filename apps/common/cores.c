/* SPDX-License-Identifier: BSD-3-Clause */
#include "cores.h"

#include <stdlib.h>

/* Limits, safe and fault values of the outputs. */
struct outputs {
    double *low, *high, *safe, *fault; /* [nu] */
};

static int read_outputs(const struct experiment *e, struct outputs *o, struct apc_error *why)
{
    size_t nu = e->dim.nu;
    o->low = calloc(4 * nu, sizeof *o->low);
    if (!o->low)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    o->high = o->low + nu;
    o->safe = o->high + nu;
    o->fault = o->safe + nu;
    experiment_outputs(e, o->low, o->high, o->safe, o->fault);
    return 0;
}

int cores_plant(const struct experiment *e, uint64_t seed, struct apc_plant **plant,
                struct apc_plantserver **server, struct apc_error *why)
{
    struct outputs o;
    int rc = read_outputs(e, &o, why);
    if (rc < 0)
        return rc;
    rc = apc_plant_create(plant, e->plant.model, e->plant.p, e->plant.x0, NULL, why);
    if (rc == 0) {
        const struct apc_plantserver_options options = {
            .size = sizeof options,
            .plant = *plant,
            .model = e->plant.model,
            .safe = o.safe,
            .low = o.low,
            .high = o.high,
            .link_period = e->client.rhythm.period,
            .command_period = e->controller.rhythm.period,
            .seed = seed,
        };
        rc = apc_plantserver_create(server, &options, why);
    }
    free(o.low);
    return rc;
}

int cores_controller(const struct experiment *e, struct apc_controller **controller, struct apc_error *why)
{
    const apc_ns client = e->client.rhythm.period, plant = e->plant.rhythm.period;
    const struct apc_law_setup setup = experiment_law_setup(e);
    struct outputs o;
    int rc = read_outputs(e, &o, why);
    if (rc < 0)
        return rc;
    const struct apc_controller_options options = {
        .size = sizeof options,
        .law = e->controller.law,
        .dim = e->dim,
        .period = e->controller.rhythm.period,
        .horizon = 3 * (client > plant ? client : plant) + 100 * APC_NS_PER_MS,
        .hold = e->controller.hold,
        .fault = o.fault,
        .low = o.low,
        .high = o.high,
        .n_setting = e->controller.n_setting,
        .setting = e->controller.setting,
        .plant = setup.plant,
    };
    rc = apc_controller_create(controller, &options, why);
    free(o.low);
    return rc;
}

int cores_client(const struct experiment *e, const int64_t *last, apc_ns since, struct apc_client **client,
                 struct apc_error *why)
{
    const struct apc_client_options options = {.size = sizeof options,
                                               .ny = e->dim.ny,
                                               .nu = e->dim.nu,
                                               .command_period = e->controller.rhythm.period,
                                               .last = last,
                                               .since = since};
    return apc_client_create(client, &options, why);
}

apc_ns cores_patience(const struct experiment *e)
{
    apc_ns half = e->client.rhythm.period / 2;
    return half < APC_NS_PER_S ? half : APC_NS_PER_S;
}

size_t cores_frame_max(const struct experiment *e)
{
    return 256 + 96 * (e->dim.ny + e->dim.nu);
}
