/* SPDX-License-Identifier: BSD-3-Clause */
/* What belongs to what: ports of outputs, parameters of the law, of outputs, of measurements. */
#include "control/parts.h"

/* ---- Ports ----------------------------------------------------------------------------------- */

static int check_ports(const struct apc_law *law, size_t output, const char *what, const int *number,
                       size_t n, size_t there, struct apc_error *why)
{
    if (n > APC_LAW_PORTS)
        return apc_fail(why, APC_EINVAL, "law %s: output %zu would use %zu %ss; %d at most", law->name,
                        output + 1, n, what, APC_LAW_PORTS);
    for (size_t i = 0; i < n; i++) {
        if (number[i] < 0 || (size_t)number[i] >= there)
            return apc_fail(why, APC_EINVAL, "law %s: output %zu would use %s %d, but there are %zu",
                            law->name, output + 1, what, number[i] + 1, there);
    }
    return 0;
}

int apc_law_find_ports(const struct apc_law *law, const struct apc_law_setup *setup, size_t output,
                       struct apc_law_ports *p, struct apc_error *why)
{
    const struct apc_dim *d = &setup->dim;
    int rc;

    *p = (struct apc_law_ports){.ny = d->ny > 0, .nz = d->nz > 0, .nd = output < d->nd};
    p->y[0] = output < d->ny ? (int)output : 0;
    p->z[0] = output < d->nz ? (int)output : 0;
    p->d[0] = (int)output;
    rc = law->ports ? law->ports(setup, output, p, why) : 0;
    if (rc == 0)
        rc = check_ports(law, output, "measurement", p->y, p->ny, d->ny, why);
    if (rc == 0)
        rc = check_ports(law, output, "setpoint", p->z, p->nz, d->nz, why);
    return rc < 0 ? rc : check_ports(law, output, "disturbance", p->d, p->nd, d->nd, why);
}

int apc_law_pairing(const struct apc_law *law, const struct apc_law_setup *setup, struct apc_pair *pair,
                    struct apc_error *why)
{
    for (size_t i = 0; i < setup->dim.nu; i++) {
        struct apc_law_ports p;
        int rc = apc_law_find_ports(law, setup, i, &p, why);

        if (rc < 0)
            return rc;
        pair[i] = (struct apc_pair){.measurement = p.ny ? (size_t)p.y[0] + 1 : 0,
                                    .setpoint = p.nz ? (size_t)p.z[0] + 1 : 0};
    }
    return 0;
}

/* ---- Tuning ---------------------------------------------------------------------------------- */

static enum apc_law_scope scope_of(const struct apc_law *law, size_t number)
{
    return law->scope ? law->scope[number] : APC_OF_OUTPUT;
}

size_t apc_law_count(const struct apc_law *law, enum apc_law_scope scope)
{
    size_t n = 0;

    for (size_t j = 0; j < law->n_tuning; j++)
        n += scope_of(law, j) == scope;
    return n;
}

size_t apc_law_parameters(const struct apc_law *law, const struct apc_dim *dim)
{
    return apc_law_count(law, APC_OF_LAW) + dim->nu * apc_law_count(law, APC_OF_OUTPUT) +
           dim->ny * apc_law_count(law, APC_OF_MEASUREMENT);
}

/* Parameter number i among those of that scope. */
static struct apc_law_parameter law_parameter_at(const struct apc_law *law, enum apc_law_scope scope,
                                                 size_t each, size_t i)
{
    struct apc_law_parameter p = {.scope = scope, .of = each ? i / each : 0};
    size_t left = i - p.of * each;

    while (scope_of(law, p.number) != scope || left-- > 0)
        p.number++;
    return p;
}

struct apc_law_parameter apc_law_parameter_at(const struct apc_law *law, const struct apc_dim *dim, size_t i)
{
    const size_t own = apc_law_count(law, APC_OF_LAW), each = apc_law_count(law, APC_OF_OUTPUT);

    if (i < own)
        return law_parameter_at(law, APC_OF_LAW, own, i);
    if (i < own + dim->nu * each)
        return law_parameter_at(law, APC_OF_OUTPUT, each, i - own);
    return law_parameter_at(law, APC_OF_MEASUREMENT, apc_law_count(law, APC_OF_MEASUREMENT),
                            i - own - dim->nu * each);
}
