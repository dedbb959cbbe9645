/* SPDX-License-Identifier: BSD-3-Clause */
/* Transfer functions of a model file, for apc tune --suggest. */
#include <libconfig.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tune.h"

/* Signal @p name among those there are, which it joins; @p most of them, else -1. */
static int place(char signal[][APC_TAG_LEN], size_t *n, const char *name)
{
    for (size_t i = 0; i < *n; i++)
        if (!strcmp(signal[i], name))
            return (int)i;
    if (*n == IDENTIFY_SIGNALS || strlen(name) >= APC_TAG_LEN)
        return -1;
    snprintf(signal[*n], APC_TAG_LEN, "%s", name);
    return (int)(*n)++;
}

static double number(const config_setting_t *group, const char *name)
{
    double value = 0.0;

    (void)config_setting_lookup_float(group, name, &value);
    return value;
}

static bool is_transfer(const struct apc_transfer *g)
{
    return isfinite(g->gain) && isfinite(g->zero) && isfinite(g->dead_time) && g->dead_time >= 0.0 &&
           isfinite(g->tau[0]) && g->tau[0] >= 0.0 && isfinite(g->tau[1]) && g->tau[1] >= 0.0;
}

static int read_pair(const struct suggest_options *o, const config_setting_t *pair, double delay,
                     struct suggest_model *m, struct apc_error *why)
{
    const config_setting_t *tau = config_setting_get_member(pair, "tau");
    const char *from = NULL, *to = NULL;
    struct apc_transfer g = {.gain = number(pair, "gain"),
                             .zero = number(pair, "zero"),
                             .dead_time = number(pair, "dead_time") + delay};
    int integrating = 0, i, j;

    if (!config_setting_is_group(pair) || !config_setting_lookup_string(pair, "from", &from) ||
        !config_setting_lookup_string(pair, "to", &to))
        return apc_fail(why, APC_EPROTO, "%s:%u: expected { from = \"...\"; to = \"...\"; gain = 1.0; ... }",
                        o->model, config_setting_source_line(pair));
    for (unsigned k = 0; k < 2 && tau && (int)k < config_setting_length(tau); k++)
        g.tau[k] = config_setting_get_float_elem(tau, (int)k);
    (void)config_setting_lookup_bool(pair, "integrating", &integrating);
    g.integrating = integrating != 0;
    j = place(m->input, &m->inputs, from);
    i = place(m->output, &m->outputs, to);
    if (i < 0 || j < 0 || !is_transfer(&g))
        return apc_fail(why, APC_EPROTO, "%s:%u: this is no transfer function from one signal to another",
                        o->model, config_setting_source_line(pair));
    m->g[i * IDENTIFY_SIGNALS + j] = g;
    return 0;
}

int suggest_read_model(const struct suggest_options *o, struct suggest_model *m, struct apc_error *why)
{
    const config_setting_t *list;
    double delay = 0.0;
    config_t file;
    int rc = 0;

    config_init(&file);
    config_set_auto_convert(&file, CONFIG_TRUE);
    if (!config_read_file(&file, o->model))
        rc = config_error_type(&file) == CONFIG_ERR_FILE_IO
                 ? apc_fail(why, APC_ENOTFOUND, "%s: cannot be read", o->model)
                 : apc_fail(why, APC_EPROTO, "%s:%d: %s", o->model, config_error_line(&file),
                            config_error_text(&file));
    (void)config_lookup_float(&file, "delay", &delay);
    list = rc == 0 ? config_lookup(&file, "transfer") : NULL;
    if (rc == 0 && !list)
        rc = apc_fail(
            why, APC_EINVAL,
            "%s has no \"transfer\": the rules are of transfer functions, as apc identify --model transfer "
            "writes them",
            o->model);
    for (int k = 0; list && k < config_setting_length(list) && rc == 0; k++)
        rc = read_pair(o, config_setting_get_elem(list, (unsigned)k), delay, m, why);
    config_destroy(&file);
    return rc;
}
