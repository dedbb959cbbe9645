/* SPDX-License-Identifier: BSD-3-Clause */
/* Your own controller: cc -shared -fPIC -o mylaw.so mylaw.c, then apc-controller --law ./mylaw.so */
#include <apccontrol.h>

/* What the operator may tune:           name  unit  description          initial low    high */
static const struct apc_param tuning[] = {{"Kp", "", "proportional gain", 1.0, -100.0, 100.0}};

/* Called at each tick: measurements y and setpoints z in, outputs u out. */
static void compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]);
}

const struct apc_law apc_law = {
    .abi = APC_LAW_ABI,
    .name = "mylaw",
    .description = "proportional control",
    .n_tuning = 1,
    .tuning = tuning,
    .compute = compute,
};
