/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Split range: one demand y moves several outputs, each over a part of its range:
 *
 *     u = u_from + (u_to - u_from) s,    s = (y - from) / (to - from) within 0 and 1
 *
 * Parts may overlap, or leave a gap; an output that falls as the demand rises has u_from above u_to. The
 * demand is measurement 1, or the one that setting `input` names for each output.
 */
#include "control/control_internal.h"

enum { FROM, TO, U_FROM, U_TO, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    [FROM] = {"from", "", "demand at which the output begins to move", 0.0, -1e9, 1e9},
    [TO] = {"to", "", "demand at which it has moved all the way", 100.0, -1e9, 1e9},
    [U_FROM] = {"u_from", "", "output up to there", 0.0, -1e9, 1e9},
    [U_TO] = {"u_to", "", "output from there on", 100.0, -1e9, 1e9},
};
static const char *const settings[] = {"input", NULL};

static int split_ports(const struct apc_law_setup *s, size_t output, struct apc_law_ports *p,
                       struct apc_error *why)
{
    size_t y = 1;
    int rc = apc_setting_index(s, "input", s->dim.nu, output, 1, s->dim.ny, &y, why);

    *p = (struct apc_law_ports){.ny = 1, .y = {(int)y - 1}};
    return rc;
}

static int split_compute(struct apc_law_call *c)
{
    const double *p = c->tuning;
    const double share = (c->y[0] - p[FROM]) / (p[TO] - p[FROM]);
    unsigned limited = 0;
    double s = apc_law_cut(share, 0.0, 1.0, &limited);

    c->u[0] = p[U_FROM] + (p[U_TO] - p[U_FROM]) * s;
    c->limited[0] |= p[U_TO] < p[U_FROM] ? apc_law_mirrored(limited) : limited;
    return APC_LAW_GOOD;
}

static int split_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    if (p[FROM] < p[TO])
        return 0;
    return apc_fail(why, APC_ERANGE, "output %zu: from = %.15g is not below to = %.15g", setup->output + 1,
                    p[FROM], p[TO]);
}

const struct apc_law apc_law_split = {
    .abi = APC_LAW_ABI,
    .name = "split",
    .description = "split range: one demand moves several outputs, each over a part of its range",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .compute = split_compute,
    .settings = settings,
    .ports = split_ports,
    .check = split_check_tuning,
};
