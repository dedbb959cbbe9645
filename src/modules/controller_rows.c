/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller's rows in the shared data: what it reads, what it writes, what a restart goes on from.
 * With each output go the rows that a restart needs: y, z, u, x, from which the next x follows. They are
 * written in the transaction of u itself, so that what is stored is always one consistent tick.
 */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <string.h>

/* ---- Whose rows they are ----------------------------------------------------------------------- */

/*
 * State id 0 tells whose state it is, so that a law never takes another's x for its own: the mark of the
 * dimensions times 2^32 plus that of the law, a whole number below 2^53, which a double holds exactly.
 */
#define LAW_MARKS 0x1p32
#define DIM_BITS  21

void apc_controller_mark(struct apc_controller *c)
{
    uint32_t dim = apc_hash_number(apc_hash_number(APC_HASH_BEGIN, c->dim.ny), c->dim.nz);

    c->dim_mark = (double)(apc_hash_number(dim, c->dim.nu) >> (32 - DIM_BITS));
    c->law_mark = (double)apc_instances_mark(c->instances);
}

/* ---- What it reads ----------------------------------------------------------------------------- */

/* Samples of table state, the law's x excepted: they are the same for all laws of the same dimensions. */
static size_t outer_state(const struct apc_controller *c)
{
    return 2 + c->dim.ny + c->dim.nz + c->dim.nu;
}

struct apc_controller_size apc_controller_size(const struct apc_controller *c)
{
    size_t state = outer_state(c) + c->n_x;

    return (struct apc_controller_size){.in = c->dim.ny + c->dim.nz + 1 + c->n_tuning + c->dim.nu + 1,
                                        .out = c->dim.nu + state + 1,
                                        .resume = state + 1};
}

static struct apc_sample *name_vector(struct apc_sample *at, enum apc_table table, size_t n)
{
    for (size_t i = 0; i < n; i++)
        *at++ = (struct apc_sample){.table = table, .id = (int)i + 1, .status = APC_BAD_NO_DATA};
    return at;
}

void apc_controller_inputs(const struct apc_controller *c, struct apc_sample *in)
{
    in = name_vector(in, APC_SENSOR, c->dim.ny);
    in = name_vector(in, APC_SETPOINT, c->dim.nz);
    *in++ = (struct apc_sample){.table = APC_OPMODE, .id = 0, .status = APC_BAD_NO_DATA};
    in = name_vector(in, APC_TUNING, c->n_tuning);
    in = name_vector(in, APC_MANUAL, c->dim.nu);
    *in = (struct apc_sample){.table = APC_STATE, .id = 0, .status = APC_BAD_NO_DATA};
}

/* ---- Taking over from a former run ---------------------------------------------------------- */

void apc_controller_resume_inputs(const struct apc_controller *c, struct apc_sample *in)
{
    *in++ = (struct apc_sample){.table = APC_STATE, .id = 0, .status = APC_BAD_NO_DATA};
    in = name_vector(in, APC_STATE, outer_state(c) - 1 + c->n_x);
    *in = (struct apc_sample){.table = APC_OPMODE, .id = 1, .status = APC_BAD_NO_DATA};
}

/* Rows of one and the same tick, all there, all usable, of this run? */
static bool whole(const struct apc_sample *state, size_t n, apc_ns since)
{
    for (size_t i = 0; i < n; i++) {
        if (state[i].seq == 0 || state[i].seq != state[0].seq || state[i].time < since ||
            !apc_value_ok(state[i].value) || apc_status_severity(state[i].status) == APC_SEVERITY_BAD)
            return false;
    }
    return true;
}

static const struct apc_sample *take_vector(double *to, size_t n, const struct apc_sample *from)
{
    for (size_t i = 0; i < n; i++)
        to[i] = from[i].value;
    return from + n;
}

int apc_controller_resume(struct apc_controller *c, const int64_t *last, const struct apc_sample *in,
                          apc_ns since)
{
    size_t outer = outer_state(c), n = outer + c->n_x;
    const struct apc_sample *at;
    double dim;

    for (size_t i = 0; last && i < c->dim.nu; i++)
        c->u_seq[i] = last[i];
    c->manual_since = since > 0 ? since : INT64_MAX;
    if (!in)
        return 0;
    for (size_t i = 0; i < n; i++) {
        if (in[i].seq > c->state_seq)
            c->state_seq = in[i].seq;
    }
    c->mode_seq = in[n].seq;
    dim = floor(in[0].value / LAW_MARKS);
    if (!whole(in, outer, since) || dim != c->dim_mark)
        return 0;
    at = take_vector(c->y, c->dim.ny, in + 1);
    at = take_vector(c->z, c->dim.nz, at);
    at = take_vector(c->u, c->dim.nu, at);
    apc_controller_limit(c, c->u);
    c->resumed_at = c->manual_since = in[0].time;
    c->have_u = true;
    c->have_y = true;
    c->resumed = in[0].value - dim * LAW_MARKS == c->law_mark && whole(in, n, since);
    c->begun = c->resumed;
    if (c->resumed)
        (void)take_vector(c->x, c->n_x, at + 1);
    return 1;
}

/* ---- What it writes -------------------------------------------------------------------------------- */

/* A good output says as well, with OPC UA's limit bits, which way a limit holds it back. */
static apc_status limit_status(unsigned limited)
{
    static const apc_status status[] = {APC_GOOD, APC_GOOD_LIMITED_LOW, APC_GOOD_LIMITED_HIGH,
                                        APC_GOOD_LIMITED_CONSTANT};

    return status[limited & (APC_LIMITED_LOW | APC_LIMITED_HIGH)];
}

static size_t put_actuators(struct apc_controller *c, apc_ns utc, apc_status status, struct apc_sample *out)
{
    const struct apc_dim *d = &c->dim;

    for (size_t i = 0; i < d->nu; i++) {
        out[i] = (struct apc_sample){.table = APC_ACTUATOR,
                                     .id = (int)i + 1,
                                     .seq = ++c->u_seq[i],
                                     .time = utc,
                                     .value = c->u[i],
                                     .status = status};
        if (c->by_law) {
            if (status == APC_GOOD)
                out[i].status = limit_status(c->limited[i]);
            const struct apc_law_ports *ports = apc_instances_ports(c->instances, i);

            out[i].sensor_seq = ports->ny ? c->y_seq[ports->y[0]] : 0;
            out[i].setpoint_seq = ports->nz ? c->z_seq[ports->z[0]] : 0;
        }
    }
    return d->nu;
}

/*
 * How many rows of the operator's were looked at: the sum of the seqs of setpoints, target mode, tunings and
 * outputs. Seqs only rise, so whoever reads it knows whether a row of his is among them. One that was refused
 * counts as well, or the sum would never again reach that of what is stored; an event tells of it.
 */
static double taken(const struct apc_controller *c)
{
    int64_t sum = c->target_seq;

    for (size_t i = 0; i < c->dim.nz; i++)
        sum += c->setpoint_seq[i];
    for (size_t i = 0; i < c->n_tuning; i++)
        sum += c->tuning_seq[i];
    for (size_t i = 0; i < c->dim.nu; i++)
        sum += c->manual_seq[i] > 0 ? c->manual_seq[i] : 0;
    return (double)sum;
}

static size_t put_state(struct apc_controller *c, apc_ns utc, struct apc_sample *out)
{
    const double signature = c->dim_mark * LAW_MARKS + c->law_mark;
    const double sum = taken(c);
    const double *part[] = {&signature, c->y, c->z, c->u, &sum, c->x};
    const size_t length[] = {1, c->dim.ny, c->dim.nz, c->dim.nu, 1, c->n_x};
    size_t n = 0;

    if (!c->begun || !apc_values_ok(c->x, c->n_x))
        return 0;
    c->state_seq++;
    for (size_t k = 0; k < sizeof(part) / sizeof(part[0]); k++) {
        for (size_t i = 0; i < length[k]; i++, n++)
            out[n] = (struct apc_sample){.table = APC_STATE,
                                         .id = (int)n,
                                         .seq = c->state_seq,
                                         .time = utc,
                                         .value = part[k][i],
                                         .status = APC_GOOD};
    }
    return n;
}

size_t apc_controller_put_output(struct apc_controller *c, apc_ns utc, apc_status status,
                                 struct apc_sample *out)
{
    size_t n = put_actuators(c, utc, status, out);

    return n + put_state(c, utc, out + n);
}

size_t apc_controller_put_mode(struct apc_controller *c, apc_ns utc, struct apc_sample *out)
{
    *out = (struct apc_sample){.table = APC_OPMODE,
                               .id = 1,
                               .seq = ++c->mode_seq,
                               .time = utc,
                               .value = (double)c->mode,
                               .status = APC_GOOD};
    return 1;
}
