/* SPDX-License-Identifier: BSD-3-Clause */
#include "cores.h"

#include <stdlib.h>

int cores_controller(const struct experiment *e, struct apc_controller **controller, struct apc_error *why)
{
    const apc_ns client = e->client.rhythm.period, plant = e->plant.rhythm.period;
    const struct apc_law_setup setup = experiment_law_setup(e);
    const size_t nu = e->dim.nu;
    const size_t nz = e->dim.nz;
    double *limits = calloc(4 * nu + 2 * nz, sizeof *limits);
    if (!limits)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    experiment_outputs(e, limits, limits + nu, limits + 2 * nu, limits + 3 * nu);
    for (size_t i = 0; i < nz; i++) {
        limits[4 * nu + i] = e->z[i].tag.low;
        limits[4 * nu + nz + i] = e->z[i].tag.high;
    }
    const struct apc_controller_options options = {
        .size = sizeof options,
        .law = e->controller.law,
        .dim = e->dim,
        .period = e->controller.rhythm.period,
        .horizon = 3 * (client > plant ? client : plant) + 100 * APC_NS_PER_MS,
        .hold = e->controller.hold,
        .fault = limits + 3 * nu,
        .low = limits,
        .high = limits + nu,
        .z_low = limits + 4 * nu,
        .z_high = limits + 4 * nu + nz,
        .param = e->controller.param,
        .tuning = e->controller.tuning,
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
