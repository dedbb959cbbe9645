/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"

#include "apcmodules.h"

size_t apc_scheduler_step(const struct apc_scheduler_options *options, uint64_t index, struct apc_now now,
                          struct apc_sample *out)
{
    struct apc_scheduler_options o = {0};
    const double *step;

    if (apc_options_copy(&o, sizeof(o), options, "apc_scheduler_options", NULL) < 0 || !o.steps ||
        !o.sequence)
        return 0;
    if (index >= o.steps)
        index = o.repeat ? index % o.steps : o.steps - 1;
    step = o.sequence + index * o.nz;
    for (size_t i = 0; i < o.nz; i++) {
        out[i] = (struct apc_sample){
            .table = APC_SETPOINT, .id = (int)i + 1, .time = now.utc, .value = step[i], .status = APC_GOOD};
    }
    return o.nz;
}
