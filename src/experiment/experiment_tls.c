/* SPDX-License-Identifier: BSD-3-Clause */
/* Who is who on a link tls:, as the experiment file says it. */
#include "experiment/experiment_parts.h"

#include <stdlib.h>
#include <string.h>

#define NAMES "\"clients\" must be names in double quotes, as in [\"client\"]"

bool experiment_is_tls(const char *address)
{
    return !strncmp(address, "tls:", 4);
}

void experiment_read_identity(struct settings *s, const config_setting_t *group, const char *address,
                              char path[EXPERIMENT_PATH])
{
    const config_setting_t *identity = config_setting_get_member(group, "identity");
    char name[EXPERIMENT_PATH] = "";

    settings_text(s, group, "identity", OPTIONAL, name, sizeof name);
    if (identity && !s->failed && !experiment_is_tls(address))
        settings_fail(s, identity, "\"identity\" needs a link tls:HOST:PORT; this one is \"%s\"", address);
    if (*name)
        experiment_resolve(s, name, path, EXPERIMENT_PATH);
}

/* The names in one piece of memory, behind the pointers to them. */
void experiment_read_clients(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    const config_setting_t *list = config_setting_get_member(group, "clients");
    const size_t n = list ? (size_t)config_setting_length(list) : 0;
    size_t length = 0;
    char *to;

    if (!list || s->failed)
        return;
    if (n == 0 || !config_setting_is_aggregate(list)) {
        settings_fail(s, list, NAMES);
        return;
    }
    for (size_t i = 0; i < n && !s->failed; i++) {
        const char *name = config_setting_get_string_elem(list, (int)i);
        if (!name || !*name)
            settings_fail(s, list, NAMES);
        else
            length += strlen(name) + 1;
    }
    if (s->failed)
        return;
    e->plant.clients = malloc(n * sizeof *e->plant.clients + length);
    if (!e->plant.clients) {
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return;
    }
    to = (char *)(e->plant.clients + n);
    for (size_t i = 0; i < n; i++) {
        e->plant.clients[i] = to;
        to = stpcpy(to, config_setting_get_string_elem(list, (int)i)) + 1;
    }
    e->plant.n_clients = n;
}
