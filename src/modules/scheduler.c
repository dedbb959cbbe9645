/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcmodules.h"

size_t apc_scheduler_step(const struct apc_scheduler_options *options, uint64_t index, struct apc_now now,
                          struct apc_sample *out)
{
    const double *step;

    if (!options->steps || !options->sequence)
        return 0;
    if (index >= options->steps)
        index = options->repeat ? index % options->steps : options->steps - 1;
    step = options->sequence + index * options->nz;
    for (size_t i = 0; i < options->nz; i++) {
        out[i] = (struct apc_sample){
            .table = APC_SETPOINT, .id = (int)i + 1, .time = now.utc, .value = step[i], .status = APC_GOOD};
    }
    return options->nz;
}
