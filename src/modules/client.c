/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Moves the newest u to the plant and the newest y back. It keeps no queue: what could not be sent at
 * one tick is replaced by what is newest at the next, and what is no longer fresh is not sent at all,
 * so that an old command can never reach the plant through it.
 */
#include "apcsockets.h"
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <stdlib.h>

struct sensor {
    int64_t seq;
    apc_ns time; /* source time of the row with that seq */
    bool seen;
};

struct apc_client {
    size_t ny, nu;
    apc_ns horizon, since;
    uint64_t id;                 /* of the last request */
    struct apc_freshness *fresh; /* [nu] */
    struct sensor *sensor;       /* [ny] */
    struct apc_sample *received; /* [ny] */
};

static int take_options(struct apc_client_options *o, const struct apc_client_options *options,
                        struct apc_error *why)
{
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_client_options", why);

    if (rc < 0)
        return rc;
    if (!o->ny || o->ny > APC_VECTOR_MAX || !o->nu || o->nu > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL, "client: ny is %zu, nu is %zu; each must be 1 to %d", o->ny, o->nu,
                        APC_VECTOR_MAX);
    if (!apc_period_ok(o->command_period))
        return apc_fail(why, APC_EINVAL, "client: command_period, that of the controller, must be above 0");
    return 0;
}

int apc_client_create(struct apc_client **client, const struct apc_client_options *options,
                      struct apc_error *why)
{
    struct apc_client_options o = {0};
    struct apc_client *new = NULL;
    int rc;

    if (!client)
        return apc_fail(why, APC_EINVAL, "apc_client_create: client must not be NULL");
    *client = NULL;
    rc = take_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        goto no_memory;
    new->fresh = calloc(o.nu, sizeof(*new->fresh));
    new->sensor = calloc(o.ny, sizeof(*new->sensor));
    new->received = calloc(o.ny, sizeof(*new->received));
    if (!new->fresh || !new->sensor || !new->received)
        goto no_memory;
    new->ny = o.ny;
    new->nu = o.nu;
    new->horizon = apc_loss_limit(o.command_period);
    new->since = o.since;
    for (size_t i = 0; o.last && i < o.ny; i++)
        new->sensor[i].seq = o.last[i];
    *client = new;
    return 0;

no_memory:
    apc_client_destroy(new);
    return apc_fail(why, APC_ENOMEM, "client: no memory");
}

void apc_client_destroy(struct apc_client *client)
{
    if (!client)
        return;
    free(client->received);
    free(client->sensor);
    free(client->fresh);
    free(client);
}

/*
 * Looks at every one, also after the first that will not do: freshness is judged by what was seen before.
 * The stamp counts at the first look only, so there a former run's is made as old as can be; from then on
 * the seq tells what is new, and a clock that steps back before `since` stops no command.
 */
static bool may_send(struct apc_client *client, struct apc_now now, const struct apc_sample *u)
{
    bool all = true;

    for (size_t i = 0; i < client->nu; i++) {
        apc_ns time = u[i].time < client->since ? INT64_MIN : u[i].time;
        bool fresh = apc_freshness_look(&client->fresh[i], u[i].seq, time, now, client->horizon);

        if (!fresh || apc_status_severity(u[i].status) == APC_SEVERITY_BAD || !apc_value_ok(u[i].value))
            all = false;
    }
    return all;
}

int apc_client_request(struct apc_client *client, struct apc_now now, const struct apc_sample *u, char *text,
                       size_t size)
{
    struct apc_frame frame = {.kind = APC_FRAME_QUERY, .id = ++client->id};

    if (u && may_send(client, now, u)) {
        frame.kind = APC_FRAME_COMMAND;
        frame.n = client->nu;
    }
    return apc_frame_encode(text, size, &frame, u);
}

int apc_client_reply(struct apc_client *client, const char *text, size_t length, struct apc_sample *y)
{
    struct apc_frame frame;
    int n = 0;

    if (apc_frame_decode(text, length, &frame, client->received, client->ny) < 0)
        return APC_EPROTO;
    if (frame.kind != APC_FRAME_VALUES || frame.n != client->ny || (frame.id && frame.id != client->id))
        return APC_EPROTO;
    for (size_t i = 0; i < client->ny; i++) {
        struct sensor *s = &client->sensor[i];
        const struct apc_sample *r = &client->received[i];

        if (s->seen && r->time == s->time)
            continue;
        s->seen = true;
        s->time = r->time;
        y[n++] = (struct apc_sample){.table = APC_SENSOR,
                                     .id = (int)i + 1,
                                     .seq = ++s->seq,
                                     .time = r->time, /* at which the plant acquired it */
                                     .value = r->value,
                                     .status = r->status};
    }
    return n;
}
