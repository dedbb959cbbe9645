/* SPDX-License-Identifier: BSD-3-Clause */
#include "run_internal.h"

#include <stdlib.h>

struct apc_law_setup cores_law_setup(const struct controller *c)
{
    return (struct apc_law_setup){.dim = c->dim,
                                  .Ts = apc_ns_to_s(c->rhythm.period),
                                  .n_setting = c->n_setting,
                                  .setting = c->setting,
                                  .plant = c->linear || c->sampled ? &c->plant : NULL};
}

void cores_outputs(const struct experiment *e, double *low, double *high, double *safe, double *fault)
{
    for (size_t i = 0; i < e->dim.nu; i++) {
        low[i] = e->u[i].tag.low;
        high[i] = e->u[i].tag.high;
        safe[i] = e->u[i].safe;
        fault[i] = e->u[i].fault;
    }
}

apc_ns cores_command_period(const struct experiment *e)
{
    apc_ns period = 0;
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        for (size_t k = 0; k < c->dim.nu; k++)
            if (c->u[k].table == APC_ACTUATOR && c->rhythm.period > period)
                period = c->rhythm.period;
    }
    return period;
}

int cores_plant(const struct experiment *e, struct apc_plant **plant, struct apc_plantserver **server,
                struct apc_error *why)
{
    struct apc_plant_options how = e->plant.options;
    double *limits = calloc(5 * e->dim.nu, sizeof *limits), *initial;
    bool runs = false; /* before the first command */
    int rc;

    *plant = NULL;
    *server = NULL;
    if (!e->plant.model) {
        free(limits);
        return apc_fail(why, APC_EINVAL,
                        "%s: the plant is external, and the file names no \"model\" of it: "
                        "there is nothing to simulate",
                        e->file);
    }
    if (!limits)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    cores_outputs(e, limits, limits + e->dim.nu, limits + 2 * e->dim.nu, limits + 3 * e->dim.nu);
    initial = limits + 4 * e->dim.nu;
    for (size_t i = 0; i < e->dim.nu; i++) {
        initial[i] = e->u[i].initial;
        runs |= initial[i] < e->u[i].safe || initial[i] > e->u[i].safe;
    }
    struct apc_plantserver_options options = {
        .size = sizeof options,
        .model = e->plant.model,
        .low = limits,
        .high = limits + e->dim.nu,
        .safe = limits + 2 * e->dim.nu,
        .link_period = e->client.rhythm.period,
        .command_period = cores_command_period(e),
        .seed = e->seed,
        .noise = e->plant.noise,
        .disturbance = e->plant.disturbance,
        .n_disturbances = e->plant.n_disturbances,
        .sensor = e->sensor,
        .initial = runs ? initial : NULL,
    };
    how.integrator = e->plant.integrator[0] ? e->plant.integrator : NULL;
    rc = apc_plant_create(plant, e->plant.model, e->plant.p, e->plant.x0, &how, why);
    options.plant = *plant;
    if (rc == 0)
        rc = apc_plantserver_create(server, &options, why);
    if (rc < 0) {
        apc_plant_destroy(*plant);
        *plant = NULL;
    }
    free(limits);
    return rc;
}

int cores_controller(const struct experiment *e, struct apc_controller **controller, struct apc_error *why)
{
    const apc_ns client = e->client.rhythm.period, plant = e->plant.rhythm.period;
    const struct apc_law_setup setup = cores_law_setup(e->controllers);
    const size_t nu = e->dim.nu;
    const size_t nz = e->dim.nz;
    double *limits = calloc(4 * nu + 2 * nz, sizeof *limits);
    if (!limits)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    cores_outputs(e, limits, limits + nu, limits + 2 * nu, limits + 3 * nu);
    for (size_t i = 0; i < nz; i++) {
        limits[4 * nu + i] = e->z[i].tag.low;
        limits[4 * nu + nz + i] = e->z[i].tag.high;
    }
    const struct apc_controller_options options = {
        .size = sizeof options,
        .law = e->controllers->law,
        .dim = e->dim,
        .period = e->controllers->rhythm.period,
        .horizon = 3 * (client > plant ? client : plant) + 100 * APC_NS_PER_MS,
        .hold = e->controllers->hold,
        .fault = limits + 3 * nu,
        .low = limits,
        .high = limits + nu,
        .z_low = limits + 4 * nu,
        .z_high = limits + 4 * nu + nz,
        .param = e->controllers->param,
        .tuning = e->controllers->tuning,
        .n_setting = setup.n_setting,
        .setting = setup.setting,
        .plant = setup.plant,
    };
    int rc = apc_controller_create(controller, &options, why);
    free(limits);
    return rc;
}

int cores_client(const struct experiment *e, const int64_t *last, apc_ns since, struct apc_client **client,
                 struct apc_error *why)
{
    const struct apc_client_options options = {.size = sizeof options,
                                               .ny = e->dim.ny,
                                               .nu = e->dim.nu,
                                               .command_period = cores_command_period(e),
                                               .last = last,
                                               .since = since};
    return apc_client_create(client, &options, why);
}

apc_ns cores_patience(const struct experiment *e)
{
    apc_ns half = e->client.rhythm.period / 2;
    return half < APC_NS_PER_S ? half : APC_NS_PER_S;
}
