/* SPDX-License-Identifier: BSD-3-Clause */
/* The laws there are: built in, one file each, or the user's own from a shared object. */
#include "base/base_internal.h"
#include "control/process/process.h"

#include <math.h>
#include <string.h>

int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why)
{
    if (law->abi != APC_LAW_ABI)
        return apc_fail(why, APC_EINVAL,
                        "%s: compiled for version %u of struct apc_law, this is version %u: compile it again "
                        "with this library's <apccontrol.h> (since version 3 its compute returns an int)",
                        from, law->abi, APC_LAW_ABI);
    if (!law->name || !law->name[0])
        return apc_fail(why, APC_EINVAL, "%s: its apc_law has no name", from);
    if (!law->compute)
        return apc_fail(why, APC_EINVAL, "%s: law %s has no function compute", from, law->name);
    if (law->whole && law->selects)
        return apc_fail(why, APC_EINVAL, "%s: law %s is whole, so it cannot be one that selects", from,
                        law->name);
    if (law->estimates && !law->whole)
        return apc_fail(why, APC_EINVAL, "%s: law %s is not whole, so it cannot be one that estimates", from,
                        law->name);
    for (size_t j = 0; law->scope && j < law->n_tuning; j++) {
        if (law->scope[j] != APC_OF_OUTPUT && law->scope[j] != APC_OF_LAW &&
            law->scope[j] != APC_OF_MEASUREMENT)
            return apc_fail(why, APC_EINVAL, "%s: parameter %zu of law %s is of nothing: scope %d", from,
                            j + 1, law->name, (int)law->scope[j]);
    }
    return apc_params_check(law->tuning, law->n_tuning, from, why);
}

int apc_law_check_order(const struct apc_law *law, const struct apc_law_setup *setup, const double *tuning,
                        size_t lower, size_t upper, struct apc_error *why)
{
    for (size_t i = 0; i < setup->dim.nu; i++) {
        const double *p = tuning + i * law->n_tuning;

        if (p[lower] > p[upper])
            return apc_fail(why, APC_ERANGE, "output %zu: %s = %.15g is above %s = %.15g",
                            setup->output + i + 1, law->tuning[lower].name, p[lower], law->tuning[upper].name,
                            p[upper]);
    }
    return 0;
}

double apc_law_left(const struct apc_law_call *c)
{
    return c->deadline ? apc_ns_to_s(c->deadline - apc_clock_mono(NULL)) : c->budget;
}

const struct apc_setting *apc_setting_find(const struct apc_law_setup *setup, const char *name)
{
    for (size_t i = 0; i < setup->n_setting; i++) {
        if (strcmp(setup->setting[i].name, name) == 0)
            return &setup->setting[i];
    }
    return NULL;
}

/* The setting of that name, if it is there, which must be n numbers. Returns 0 or APC_EINVAL. */
static int take_setting(const struct apc_law_setup *setup, const char *name, size_t n, const double **value,
                        struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, name);

    *value = s ? s->value : NULL;
    if (s && s->text)
        return apc_fail(why, APC_EINVAL, "setting \"%s\" must be %zu numbers, not a text", name, n);
    if (s && s->rows * s->columns != n)
        return apc_fail(why, APC_EINVAL, "setting \"%s\" must be %zu numbers, not %zu", name, n,
                        s->rows * s->columns);
    return 0;
}

int apc_setting_index(const struct apc_law_setup *setup, const char *name, size_t n, size_t i, size_t least,
                      size_t most, size_t *to, struct apc_error *why)
{
    const double *value;
    int rc = take_setting(setup, name, n, &value, why);

    if (rc < 0 || !value)
        return rc;
    if (!(value[i] >= (double)least && value[i] <= (double)most) || value[i] != trunc(value[i]))
        return apc_fail(why, APC_EINVAL, "setting \"%s\": %.15g is no whole number from %zu to %zu", name,
                        value[i], least, most);
    *to = (size_t)value[i];
    return 0;
}

int apc_setting_amounts(const struct apc_law_setup *setup, const char *name, size_t n, double *to,
                        struct apc_error *why)
{
    const double *value;
    int rc = take_setting(setup, name, n, &value, why);

    for (size_t i = 0; rc == 0 && value && i < n; i++) {
        if (!(value[i] >= 0.0 && value[i] <= APC_VALUE_MAX))
            return apc_fail(why, APC_EINVAL, "setting \"%s\": %g is no number from 0 to %g", name, value[i],
                            APC_VALUE_MAX);
        to[i] = value[i];
    }
    return rc;
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

static const struct apc_built_in laws[] = {
    {"pi", &apc_law_pi},           {"pid", &apc_law_pid},      {"cascade", &apc_law_cascade},
    {"lqg", &apc_law_lqg},         {"mpc", &apc_law_mpc},      {"nmpc", &apc_law_nmpc},
    {"select", &apc_law_select},   {"split", &apc_law_split},  {"ramp", &apc_law_ramp},
    {"leadlag", &apc_law_leadlag}, {"filter", &apc_law_filter}};
#define N_LAWS (sizeof laws / sizeof *laws)

const struct apc_law *apc_law_built_in(size_t i)
{
    return i < N_LAWS ? laws[i].plugin : NULL;
}

static int check_law_plugin(const void *law, const char *from, struct apc_error *why)
{
    return apc_law_check(law, from, why);
}

int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why)
{
    static const struct apc_plugin_kind kind = {.what = "law",
                                                .symbol = "apc_law",
                                                .built_in = laws,
                                                .n_built_in = N_LAWS,
                                                .check = check_law_plugin};
    const void *found;
    int rc;

    if (!law)
        return apc_fail(why, APC_EINVAL, "apc_law_find: law must not be NULL");
    *law = NULL;
    if (name && handle && strchr(name, '/') && apc_law_is_process(name)) {
        *handle = NULL;
        return apc_law_process_open(name, law, handle, why);
    }
    rc = apc_plugin_find(&kind, name, &found, handle, why);
    *law = found;
    return rc;
}
