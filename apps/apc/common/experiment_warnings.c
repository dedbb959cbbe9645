/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment_warnings.h"

#include <stdlib.h>
#include <string.h>

#include "experiment/experiment.h"
#include "files/files.h"

/* Another host may forward to the plant; the ports of one host are one and the same. */
static void warn_link(const struct cli *cli, const struct experiment *e)
{
    const char *listen = strrchr(e->plant.listen, ':'), *link = strrchr(e->client.link, ':');
    if (!e->plant.external && strcmp(listen, link) != 0 && strcmp(listen, ":0") != 0)
        cli_error(
            cli, 0,
            "warning: link of client is \"%s\", listen of plant \"%s\": the client will not find the plant",
            e->client.link, e->plant.listen);
}

static void warn_rhythm(const struct cli *cli, const struct experiment *e)
{
    const apc_ns client = e->client.rhythm.period;
    for (size_t i = 0; i < e->n_controllers; i++)
        if (client > e->controllers[i].rhythm.period)
            cli_error(
                cli, 0,
                "warning: the client's period is %g s, that of %s %g s: it controls by measurements that "
                "it has seen before",
                apc_ns_to_s(client), e->controllers[i].name, apc_ns_to_s(e->controllers[i].rhythm.period));
}

/* The lower one has not answered yet when the next setpoint comes. */
static void warn_cascade(const struct cli *cli, const struct experiment *e)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        for (size_t k = 0; k < e->controllers[i].dim.nu; k++) {
            const struct controller *upper = &e->controllers[i], *lower = controllers_taker(e, upper->u[k]);
            if (lower && upper->rhythm.period < lower->rhythm.period)
                cli_error(cli, 0,
                          "warning: controller %s, with a period of %g s, moves setpoints of %s, with %g s: "
                          "an upper one should not be faster",
                          upper->name, apc_ns_to_s(upper->rhythm.period), lower->name,
                          apc_ns_to_s(lower->rhythm.period));
        }
}

/* One name for a measurement and what may be set is allowed: a command says which it means. A loop is called
 * as its output, and what its controller has been doing by the controller's name: nobody asks for these. */
static bool may_share(const struct apc_tag *a, const struct apc_tag *b)
{
    return (a->table == APC_SENSOR && (b->table == APC_SETPOINT || b->table == APC_ACTUATOR)) ||
           cli_is_loop(a) || cli_is_loop(b) || apc_table_vectors(a->table) || apc_table_vectors(b->table);
}

static void warn_names(const struct cli *cli, const struct experiment *e)
{
    size_t n = 0;
    struct apc_tag *tags = provision_tags(e, &n);
    for (size_t k = 0; tags && k < n * n; k++) {
        const struct apc_tag *a = &tags[k / n], *b = &tags[k % n];
        bool before = a->table < b->table || (a->table == b->table && a < b); /* each pair once */
        if (before && !strcmp(a->name, b->name) && !may_share(a, b))
            cli_error(cli, 0, "warning: \"%s\" names two things: call them %s.%d and %s.%d", a->name,
                      apc_table_name(a->table), a->id, apc_table_name(b->table), b->id);
    }
    free(tags);
}

static void warn_former(const struct cli *cli, const struct controller *c)
{
    if (c && c->former)
        cli_former(cli, c->former, former_name(c->former));
}

void warn(const struct cli *cli, const struct experiment *e)
{
    struct apc_error why;
    if (e->plant.model && experiment_check_steps(e, &why) < 0)
        cli_error(cli, 0, "warning: %s", why.text);
    for (size_t i = 0; i < e->n_controllers; i++) {
        warn_former(cli, &e->controllers[i]);
        warn_former(cli, e->controllers[i].backup);
    }
    warn_link(cli, e);
    warn_rhythm(cli, e);
    warn_cascade(cli, e);
    warn_names(cli, e);
}
