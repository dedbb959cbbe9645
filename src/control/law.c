/* SPDX-License-Identifier: BSD-3-Clause */
/* The laws there are: built in, one file each, or the user's own from a shared object. */
#include "base/base_internal.h"
#include "control/control_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why)
{
    if (law->abi != APC_LAW_ABI)
        return apc_fail(why, APC_EINVAL,
                        "%s: made for version %u of struct apc_law, this is %u; compile it anew", from,
                        law->abi, APC_LAW_ABI);
    if (!law->name || !law->name[0])
        return apc_fail(why, APC_EINVAL, "%s: its apc_law has no name", from);
    if (!law->compute)
        return apc_fail(why, APC_EINVAL, "%s: law %s has no function compute", from, law->name);
    return apc_params_check(law->tuning, law->n_tuning, from, why);
}

int apc_law_check_settings(const struct apc_law *law, const struct apc_law_setup *setup,
                           struct apc_error *why)
{
    for (size_t i = 0; i < setup->n_setting; i++) {
        const char *const *known = law->settings;

        while (known && *known && strcmp(*known, setup->setting[i].name) != 0)
            known++;
        if (!known || !*known)
            return apc_fail(why, APC_EINVAL, "law %s has no setting \"%s\"", law->name,
                            setup->setting[i].name);
    }
    return 0;
}

int apc_law_pairing(const struct apc_law *law, const struct apc_law_setup *setup, struct apc_pair *pair,
                    struct apc_error *why)
{
    const struct apc_dim *d = &setup->dim;
    int rc;

    for (size_t i = 0; i < d->nu; i++)
        pair[i] = (struct apc_pair){.measurement = i < d->ny ? i + 1 : 1,
                                    .setpoint = i < d->nz ? i + 1 : d->nz > 0};
    rc = law->pairing ? law->pairing(setup, pair, why) : 0;
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < d->nu; i++) {
        if (pair[i].measurement < 1 || pair[i].measurement > d->ny || pair[i].setpoint > d->nz)
            return apc_fail(why, APC_EINVAL,
                            "law %s: output %zu would control measurement %zu to setpoint %zu, but there are "
                            "%zu and %zu",
                            law->name, i + 1, pair[i].measurement, pair[i].setpoint, d->ny, d->nz);
    }
    return 0;
}

int apc_law_check_tuning(const struct apc_law *law, const struct apc_dim *dim, const double *tuning,
                         struct apc_error *why)
{
    for (size_t i = 0; i < dim->nu * law->n_tuning; i++) {
        const struct apc_param *param = &law->tuning[i % law->n_tuning];

        if (!apc_param_accepts(param, tuning[i]))
            return apc_fail(why, APC_ERANGE, "%s of output %zu: %g is not within %g to %g", param->name,
                            i / law->n_tuning + 1, tuning[i], param->low, param->high);
    }
    return law->check ? law->check(dim, tuning, why) : 0;
}

int apc_law_check_order(const struct apc_law *law, const struct apc_dim *dim, const double *tuning,
                        size_t lower, size_t upper, struct apc_error *why)
{
    for (size_t i = 0; i < dim->nu; i++) {
        const double *p = tuning + i * law->n_tuning;

        if (p[lower] > p[upper])
            return apc_fail(why, APC_ERANGE, "output %zu: %s = %g is above %s = %g", i + 1,
                            law->tuning[lower].name, p[lower], law->tuning[upper].name, p[upper]);
    }
    return 0;
}

int apc_law_pairing_of(const struct apc_law *law, const struct apc_law_setup *setup, size_t measurement,
                       size_t setpoint, struct apc_pair *pair, struct apc_error *why)
{
    const size_t nu = setup->dim.nu;
    struct apc_law_size size;
    int rc = law->configure(setup, &size, NULL, why);
    double *k;

    if (rc < 0)
        return rc;
    k = calloc(size.constants, sizeof(*k));
    if (!k)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", law->name);
    rc = law->configure(setup, &size, k, why);
    for (size_t i = 0; i < nu && rc == 0; i++)
        pair[i] = (struct apc_pair){(size_t)k[measurement * nu + i], (size_t)k[setpoint * nu + i]};
    free(k);
    return rc;
}

const struct apc_setting *apc_setting_find(const struct apc_law_setup *setup, const char *name)
{
    for (size_t i = 0; i < setup->n_setting; i++) {
        if (strcmp(setup->setting[i].name, name) == 0)
            return &setup->setting[i];
    }
    return NULL;
}

/* Copy the setting, if it is there, when it has n numbers and each passes. */
static int take(const struct apc_law_setup *setup, const char *name, size_t n, double low, double high,
                bool whole, double *to, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, name);

    if (!s)
        return 0;
    if (s->n != n)
        return apc_fail(why, APC_EINVAL, "setting \"%s\" must be %zu numbers, not %zu", name, n, s->n);
    for (size_t i = 0; i < n; i++) {
        if (!(s->value[i] >= low && s->value[i] <= high) || (whole && s->value[i] != trunc(s->value[i])))
            return apc_fail(why, APC_EINVAL, "setting \"%s\": %g is no %s from %g to %g", name, s->value[i],
                            whole ? "whole number" : "number", low, high);
        to[i] = s->value[i];
    }
    return 0;
}

int apc_setting_indices(const struct apc_law_setup *setup, const char *name, size_t n, size_t least,
                        size_t most, double *to, struct apc_error *why)
{
    return take(setup, name, n, (double)least, (double)most, true, to, why);
}

int apc_setting_amounts(const struct apc_law_setup *setup, const char *name, size_t n, double *to,
                        struct apc_error *why)
{
    return take(setup, name, n, 0.0, APC_VALUE_MAX, false, to, why);
}

double apc_law_cut(double u, double low, double high, unsigned *limited)
{
    if (u < low) {
        u = low;
        *limited |= APC_LIMITED_LOW;
    }
    if (u > high) {
        u = high;
        *limited |= APC_LIMITED_HIGH;
    }
    return u;
}

static int check(const void *law, const char *from, struct apc_error *why)
{
    return apc_law_check(law, from, why);
}

int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why)
{
    static const struct apc_built_in built_in[] = {
        {"pi", &apc_law_pi}, {"pid", &apc_law_pid}, {"cascade", &apc_law_cascade}, {"lqg", &apc_law_lqg}};
    static const struct apc_plugin_kind kind = {.what = "law",
                                                .symbol = "apc_law",
                                                .built_in = built_in,
                                                .n_built_in = sizeof(built_in) / sizeof(built_in[0]),
                                                .check = check};
    const void *found;
    int rc;

    if (!law)
        return apc_fail(why, APC_EINVAL, "apc_law_find: law must not be NULL");
    rc = apc_plugin_find(&kind, name, &found, handle, why);
    *law = found;
    return rc;
}
