/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Moves the newest u to the plant and the newest y back. It keeps no queue: what could not be sent at
 * one tick is replaced by what is newest at the next, and what is no longer fresh is not sent at all,
 * so that an old command can never reach the plant through it.
 *
 * A number beyond what its sensor can show is no measurement: a transmitter that fails, or has no value, says
 * so by such a one. How far beyond is as NAMUR NE 43 has it for 4 to 20 mA: a failure below 3.6 and above 21
 * mA, a measurement again from 3.8 to 20.5 mA. So a level of 0 with its noise is still measured.
 */
#include "base/base_internal.h"
#include "base/parts.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdlib.h>

#define FAILS_LOW  0.025  /* of the span, below its low end */
#define FAILS_HIGH 0.0625 /* above its high end */
#define BACK_LOW   0.0125 /* no farther, and it counts again */
#define BACK_HIGH  0.03125

struct sensor {
    int64_t seq;
    struct apc_value last; /* of the row with that seq */
    apc_ns apart;          /* what says the same is not new within this time of it */
    bool seen, outside;
};

struct apc_client {
    size_t ny, nu;
    apc_ns horizon, since;
    void *memory;                /* of the arrays */
    struct apc_freshness *fresh; /* [nu] */
    struct sensor *sensor;       /* [ny] */
    double *low, *high;          /* [ny] */
};

static int take_client_options(struct apc_client_options *o, const struct apc_client_options *options,
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
    rc = take_client_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "client: no memory");
    const struct apc_part parts[] = {APC_PART(new->fresh, o.nu), APC_PART(new->sensor, o.ny),
                                     APC_PART(new->low, o.ny), APC_PART(new->high, o.ny)};
    new->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    rc = new->memory ? apc_limits_copy(new->low, new->high, o.low, o.high, o.ny, why)
                     : apc_fail(why, APC_ENOMEM, "client: no memory");
    if (rc < 0) {
        apc_client_destroy(new);
        return rc;
    }
    new->ny = o.ny;
    new->nu = o.nu;
    new->horizon = apc_loss_limit(o.command_period);
    new->since = o.since;
    for (size_t i = 0; i < o.ny; i++)
        new->sensor[i] = (struct sensor){.seq = o.last ? o.last[i] : 0,
                                         .apart = o.apart && o.apart[i] > 1 ? o.apart[i] : 1};
    *client = new;
    return 0;
}

void apc_client_destroy(struct apc_client *client)
{
    if (!client)
        return;
    free(client->memory);
    free(client);
}

/*
 * The stamp counts at the first look only, so there a former run's is made as old as can be; from then on the
 * seq tells what is new, and a clock that steps back before `since` stops no command.
 */
static apc_status may_send(struct apc_client *client, struct apc_now now, size_t i,
                           const struct apc_sample *u)
{
    apc_ns time = u->time < client->since ? INT64_MIN : u->time;

    if (!apc_freshness_look(&client->fresh[i], u->seq, time, now, client->horizon))
        return APC_BAD_NO_DATA;
    return apc_value_ok(u->value) ? u->status : APC_BAD_OUT_OF_RANGE;
}

size_t apc_client_command(struct apc_client *client, struct apc_now now, const struct apc_sample *u,
                          struct apc_value *out)
{
    size_t n = 0;

    for (size_t i = 0; i < client->nu; i++) {
        out[i] = u ? (struct apc_value){u[i].value, may_send(client, now, i, &u[i]), u[i].time}
                   : (struct apc_value){.status = APC_BAD_NO_DATA};
        n += apc_status_severity(out[i].status) != APC_SEVERITY_BAD;
    }
    return n;
}

/* Where one end is open there is no span, and nothing beyond the other one counts. */
static bool is_outside(double value, double low, double high, bool before)
{
    const double span = isfinite(low) && isfinite(high) ? high - low : 0.0;

    return value < low - span * (before ? BACK_LOW : FAILS_LOW) ||
           value > high + span * (before ? BACK_HIGH : FAILS_HIGH);
}

/* A status that is Bad already says more, and its value nothing. */
static apc_status judge_measurement(struct apc_client *client, size_t i, const struct apc_value *y)
{
    struct sensor *s = &client->sensor[i];

    if (apc_status_severity(y->status) == APC_SEVERITY_BAD)
        return y->status;
    s->outside = is_outside(y->value, client->low[i], client->high[i], s->outside);
    return s->outside ? APC_BAD_OUT_OF_RANGE : y->status;
}

bool apc_client_outside(const struct apc_client *client, size_t i)
{
    return i < client->ny && client->sensor[i].outside;
}

/*
 * The plant's time says when it looked, so the same sample twice is one. Whatever else has changed is news
 * under the same time too: a plant whose times are those of the last change must not hide that a sensor has
 * failed.
 */
static bool repeats(const struct sensor *s, const struct apc_value *y)
{
    return s->seen && y->value == s->last.value && y->status == s->last.status && y->time >= s->last.time &&
           (uint64_t)y->time - (uint64_t)s->last.time < (uint64_t)s->apart;
}

size_t apc_client_measurements(struct apc_client *client, const struct apc_value *y, struct apc_sample *out)
{
    size_t n = 0;

    for (size_t i = 0; i < client->ny; i++) {
        struct sensor *s = &client->sensor[i];

        if (repeats(s, &y[i]))
            continue;
        s->seen = true;
        s->last = y[i];
        out[n++] = (struct apc_sample){.table = APC_SENSOR,
                                       .id = (int)i + 1,
                                       .seq = ++s->seq,
                                       .time = y[i].time, /* at which the plant acquired it */
                                       .value = y[i].value,
                                       .status = judge_measurement(client, i, &y[i])};
    }
    return n;
}
