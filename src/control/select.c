/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A selector: u is the least, or the greatest, of its inputs. Setting `select` is "low" or "high", setting
 * `inputs` names the measurements of each output, a row for each (by default all). A Bad input is left out.
 *
 * Override control is several loops into one selector. Each is told what was selected, and the losers that
 * they are limited (external reset), which keeps them from winding up.
 */
#include "control/control_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const settings[] = {"select", "inputs", NULL};
static const struct apc_published published[] = {
    {.name = "selected", .description = "which of its inputs is selected, from 1"}};

/* Row @output of setting inputs, numbers of measurements from 1. */
static int select_ports(const struct apc_law_setup *s, size_t output, struct apc_law_ports *p,
                        struct apc_error *why)
{
    const struct apc_setting *inputs = apc_setting_find(s, "inputs");
    const size_t ny = inputs ? inputs->columns : s->dim.ny;

    if (inputs && (inputs->text || inputs->rows != s->dim.nu))
        return apc_fail(why, APC_EINVAL,
                        "law select: \"inputs\" must be a row of measurements for each of the %zu outputs",
                        s->dim.nu);
    if (ny < 1 || ny > APC_LAW_PORTS)
        return apc_fail(why, APC_EINVAL, "law select: output %zu has %zu inputs; from 1 to %d", output + 1,
                        ny, APC_LAW_PORTS);
    *p = (struct apc_law_ports){.ny = ny};
    for (size_t i = 0; i < ny; i++) {
        size_t number = i + 1;
        int rc = inputs ? apc_setting_index(s, "inputs", s->dim.nu * ny, output * ny + i, 1, s->dim.ny,
                                            &number, why)
                        : 0;

        if (rc < 0)
            return rc;
        p->y[i] = (int)number - 1;
    }
    return 0;
}

static int select_create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                         struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, "select");
    const char *which = s && s->text ? s->text : "";
    double *sign;

    if (strcmp(which, "low") != 0 && strcmp(which, "high") != 0)
        return apc_fail(why, APC_EINVAL, "law select: needs settings = { select = \"low\"; }, or \"high\"");
    sign = malloc(sizeof(*sign));
    if (!sign)
        return apc_fail(why, APC_ENOMEM, "law select: no memory");
    *sign = which[0] == 'l' ? -1.0 : 1.0;
    *self = sign;
    needs->n_published = 1;
    needs->published = published;
    return 0;
}

static int select_compute(struct apc_law_call *c)
{
    const double sign = *(const double *)c->self;
    size_t best = c->dim.ny;

    for (size_t i = 0; i < c->dim.ny; i++) {
        if (apc_status_severity(c->y_status[i]) == APC_SEVERITY_BAD)
            continue;
        if (best == c->dim.ny || sign * c->y[i] > sign * c->y[best])
            best = i;
    }
    if (best == c->dim.ny) {
        (void)snprintf(c->why, APC_LAW_WHY, "has no good input");
        return APC_LAW_INFEASIBLE;
    }
    c->u[0] = c->y[best];
    for (size_t i = 0; c->y_limited && i < c->dim.ny; i++)
        c->y_limited[i] = i == best ? 0u : sign < 0.0 ? APC_LIMITED_HIGH : APC_LIMITED_LOW;
    if (c->published)
        c->published[0] = (double)best + 1.0;
    return APC_LAW_GOOD;
}

const struct apc_law apc_law_select = {
    .abi = APC_LAW_ABI,
    .name = "select",
    .description = "the least or the greatest of several inputs",
    .selects = true,
    .compute = select_compute,
    .settings = settings,
    .ports = select_ports,
    .create = select_create,
    .destroy = free,
};
