/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller as the tables of version 1 know it: one target mode (opmode 0) for all its loops, one actual
 * one (opmode 1), and what a restart needs as rows of numbers in table state. core.c is the controller
 * itself; this brings its rows into those tables and back.
 *
 * Table state: id 0 whose it is; then y, z, u; the sum of the seqs of what was looked at; what each loop is
 * doing, packed; the law's x. All of one tick have one seq.
 */
#include "base/base_internal.h"
#include "modules/core.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct apc_controller {
    struct apc_core *core;
    size_t ny, nz, nu, n_tuning, n_x;
    int64_t *confirmed; /* [nz] seqs of the setpoints that were taken or refused */
    int64_t state_seq;  /* of the newest rows in state that were put */
    int64_t mode_seq;
    double dim_mark;
    enum apc_mode mode;
    bool mode_written; /* the actual mode stands in the store */
};

/* ---- Making ------------------------------------------------------------------------------- */

static int make_core(struct apc_core **core, const struct apc_controller_options *o, struct apc_error *why)
{
    const bool fits = o->dim.nz <= APC_VECTOR_MAX && o->dim.nu <= APC_VECTOR_MAX; /* else it is refused */
    const size_t nz = fits ? o->dim.nz : 0, nu = fits ? o->dim.nu : 0;
    struct apc_core_setpoint *z = calloc(nz + 1, sizeof(*z));
    struct apc_core_loop *loop = calloc(nu + 1, sizeof(*loop));
    const struct apc_core_options options = {.size = sizeof(options),
                                             .law = o->law,
                                             .dim = o->dim,
                                             .period = o->period,
                                             .horizon = o->horizon,
                                             .z = z,
                                             .loop = loop,
                                             .n_setting = o->n_setting,
                                             .setting = o->setting,
                                             .plant = o->plant,
                                             .param = o->param,
                                             .start = o->tuning};
    int rc;

    for (size_t k = 0; z && k < nz; k++)
        z[k] = (struct apc_core_setpoint){.id = (int)k + 1,
                                          .low = o->z_low ? o->z_low[k] : -HUGE_VAL,
                                          .high = o->z_high ? o->z_high[k] : HUGE_VAL};
    for (size_t i = 0; loop && i < nu; i++)
        loop[i] = (struct apc_core_loop){.id = (int)i + 1,
                                         .low = o->low ? o->low[i] : -HUGE_VAL,
                                         .high = o->high ? o->high[i] : HUGE_VAL,
                                         .fault = o->fault ? o->fault[i] : 0.0,
                                         .hold = o->hold};
    rc =
        z && loop ? apc_core_create(core, &options, why) : apc_fail(why, APC_ENOMEM, "controller: no memory");
    free(z);
    free(loop);
    return rc;
}

int apc_controller_create(struct apc_controller **controller, const struct apc_controller_options *options,
                          struct apc_error *why)
{
    struct apc_controller_options o = {0};
    struct apc_controller *new;
    int rc;

    if (!controller)
        return apc_fail(why, APC_EINVAL, "apc_controller_create: controller must not be NULL");
    *controller = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_controller_options", why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    rc = make_core(&new->core, &o, why);
    new->confirmed = rc < 0 ? NULL : calloc(o.dim.nz + 1, sizeof(*new->confirmed));
    if (rc == 0 && !new->confirmed)
        rc = apc_fail(why, APC_ENOMEM, "controller: no memory");
    if (rc < 0) {
        apc_controller_destroy(new);
        return rc;
    }
    new->ny = o.dim.ny;
    new->nz = o.dim.nz;
    new->nu = o.dim.nu;
    new->n_tuning = new->core->size.tuning;
    new->n_x = new->core->size.states;
    new->mode = APC_MODE_OOS;
    *controller = new;
    return 0;
}

void apc_controller_destroy(struct apc_controller *c)
{
    if (!c)
        return;
    apc_core_destroy(c->core);
    free(c->confirmed);
    free(c);
}

/* ---- What it reads ----------------------------------------------------------------------------- */

/* Rows of table state, the law's x excepted: they are the same for all laws of the same dimensions. */
static size_t outer_state(const struct apc_controller *c)
{
    return 2 + c->ny + c->nz + 2 * c->nu;
}

struct apc_controller_size apc_controller_size(const struct apc_controller *c)
{
    const size_t state = outer_state(c) + c->n_x;

    return (struct apc_controller_size){
        .in = c->ny + c->nz + 1 + c->n_tuning + c->nu + 1, .out = c->nu + state + 1, .resume = state + 1};
}

static struct apc_sample *name_vector(struct apc_sample *at, enum apc_table table, int first, size_t n)
{
    for (size_t i = 0; i < n; i++)
        *at++ = (struct apc_sample){.table = table, .id = first + (int)i, .status = APC_BAD_NO_DATA};
    return at;
}

void apc_controller_inputs(const struct apc_controller *c, struct apc_sample *in)
{
    in = name_vector(in, APC_SENSOR, 1, c->ny);
    in = name_vector(in, APC_SETPOINT, 1, c->nz);
    in = name_vector(in, APC_OPMODE, 0, 1);
    in = name_vector(in, APC_TUNING, 1, c->n_tuning);
    in = name_vector(in, APC_MANUAL, 1, c->nu);
    (void)name_vector(in, APC_STATE, 0, 1);
}

static struct apc_sample *copy(struct apc_sample *to, const struct apc_sample *from, size_t n)
{
    memcpy(to, from, n * sizeof(*to));
    return to + n;
}

/* @p in as the core has it. Its outputs are not read: that of their transaction's state shows whether they
 * are there. */
static void give(struct apc_controller *c, const struct apc_sample *in)
{
    const struct apc_sample *mode = in + c->ny + c->nz, *tuning = mode + 1, *manual = tuning + c->n_tuning,
                            *state = manual + c->nu;
    struct apc_sample *to = copy(apc_core_in(c->core)->sample, in, c->ny + c->nz);

    for (size_t i = 0; i < c->nu; i++)
        to = copy(to, mode, 1);
    to = copy(to, manual, c->nu);
    to = copy(to, tuning, c->n_tuning);
    for (size_t i = 0; i < c->nu; i++)
        to[i].seq = c->core->state[i].seq - (state->seq != c->state_seq);
}

/* ---- What it writes ---------------------------------------------------------------------------- */

/* How many rows of the operator's were looked at: the sum of the seqs of setpoints, target mode, tunings and
 * outputs. Seqs only rise, so whoever reads it knows whether a row of his is among them. One that was refused
 * counts as well; an event tells of it. A setpoint counts once it is used. */
static double taken(struct apc_controller *c)
{
    const struct apc_core *core = c->core;
    const size_t mode = apc_core_wanted(core, APC_OPMODE);
    int64_t sum = 0;

    for (size_t k = 0; k < core->n_wanted; k++) {
        const bool other_loop = k > mode && k < mode + c->nu; /* they have the same mode row */

        if (k < mode && core->actual[k].status != APC_UNCERTAIN)
            c->confirmed[k] = core->actual[k].origin;
        sum += other_loop ? 0 : k < mode ? c->confirmed[k] : core->looked[k] > 0 ? core->looked[k] : 0;
    }
    return (double)sum;
}

/* What a loop and its instance of the law are doing, as one whole number. */
enum { THERE = 16, BEGUN = 32, GAP = 64, UPDATING = 128, HOLDING = 256, HELD_MS = 512 };

static double pack(const struct apc_controller *c, size_t i, apc_ns mono)
{
    const struct apc_core_state *l = &c->core->state[i];
    const struct apc_core_instance *of = &c->core->instance[c->core->whole ? 0 : i];
    const int64_t held = l->loop.holding ? (mono - l->loop.held) / APC_NS_PER_MS : 0;

    return (double)((int64_t)l->loop.state + (l->there ? THERE : 0) + (of->begun ? BEGUN : 0) +
                    (of->gap ? GAP : 0) + (of->updating ? UPDATING : 0) + (l->loop.holding ? HOLDING : 0) +
                    held * HELD_MS);
}

static struct apc_sample *put_values(struct apc_sample *at, const double *value, size_t n)
{
    for (size_t i = 0; i < n; i++)
        (at++)->value = value[i];
    return at;
}

static bool has_begun(const struct apc_core *core)
{
    for (size_t k = 0; k < core->size.instances; k++) {
        if (core->instance[k].begun)
            return true;
    }
    return false;
}

static size_t put_state(struct apc_controller *c, struct apc_now now, struct apc_sample *out)
{
    const size_t n = outer_state(c) + c->n_x;
    struct apc_sample *at = out;

    if (!has_begun(c->core) || !apc_values_ok(c->core->x, c->n_x))
        return 0;
    c->state_seq = c->core->seq;
    (void)name_vector(out, APC_STATE, 0, n);
    (at++)->value = c->core->mark[0] * 0x1p32 + c->core->mark[1];
    at = put_values(at, c->core->y, c->ny);
    at = put_values(at, c->core->z, c->nz);
    at = put_values(at, c->core->u, c->nu);
    (at++)->value = taken(c);
    for (size_t i = 0; i < c->nu; i++)
        (at++)->value = pack(c, i, now.mono);
    (void)put_values(at, c->core->x, c->n_x);
    for (size_t i = 0; i < n; i++) {
        out[i].seq = c->state_seq;
        out[i].time = now.utc;
        out[i].status = APC_GOOD;
    }
    return n;
}

/* The one of all loops: Auto, where one of them is. */
static enum apc_mode mode_of(const struct apc_controller *c)
{
    enum apc_mode mode = APC_MODE_OOS;

    for (size_t i = 0; i < c->nu; i++) {
        if (c->core->state[i].actual == APC_MODE_AUTO)
            return APC_MODE_AUTO;
        if (c->core->state[i].actual != APC_MODE_OOS)
            mode = APC_MODE_MAN; /* LO as well: not the law's */
    }
    return mode;
}

static size_t put_mode(struct apc_controller *c, apc_ns utc, struct apc_sample *out)
{
    const enum apc_mode before = c->mode;

    c->mode = mode_of(c);
    if (c->mode == before && c->mode_written)
        return 0;
    c->mode_written = false; /* until the shell has written it and says so */
    *out = (struct apc_sample){.table = APC_OPMODE,
                               .id = 1,
                               .seq = ++c->mode_seq,
                               .time = utc,
                               .value = (double)c->mode,
                               .status = APC_GOOD};
    return 1;
}

int apc_controller_compute(struct apc_controller *c, struct apc_now now, const struct apc_sample *in,
                           struct apc_sample *out, struct apc_notice *notice)
{
    const struct apc_rows *rows = apc_core_out(c->core);
    size_t n = 0;

    if (in)
        give(c, in);
    apc_core_compute(c->core, now, c->core->index + 1, in, notice);
    apc_core_update(c->core, -1); /* until apc_controller_update() says that it was written */
    while (n < rows->n_samples && rows->sample[n].table == APC_ACTUATOR) {
        out[n] = rows->sample[n];
        out[n].setpoint_seq = out[n].setpoint_seq > 0 ? out[n].setpoint_seq : 0;
        out[n++].origin = 0;
    }
    if (n > 0)
        n += put_state(c, now, out + n);
    return (int)(n + put_mode(c, now.utc, out + n));
}

void apc_controller_update(struct apc_controller *c)
{
    apc_core_update(c->core, 1);
    c->mode_written = true;
}

uint64_t apc_controller_failures(const struct apc_controller *c)
{
    return apc_core_failures(c->core);
}

/* ---- Taking over from a former run -------------------------------------------------------------- */

void apc_controller_resume_inputs(const struct apc_controller *c, struct apc_sample *in)
{
    in = name_vector(in, APC_STATE, 0, outer_state(c) + c->n_x);
    (void)name_vector(in, APC_OPMODE, 1, 1);
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

static const struct apc_sample *take_values(double *to, const struct apc_sample *from, size_t n)
{
    for (size_t i = 0; i < n; i++)
        to[i] = from[i].value;
    return from + n;
}

static void unpack(const struct apc_controller *c, size_t i, double packed, double *row)
{
    const size_t *at = c->core->offset, k = c->core->whole ? 0 : i;
    const int64_t is = packed >= 0.0 && packed < 0x1p53 ? (int64_t)packed : 0, ms = is / HELD_MS;

    row[at[APC_TICK_STATE] + i] = (double)(is % THERE);
    row[at[APC_TICK_THERE] + i] = (is & THERE) != 0;
    row[at[APC_TICK_BEGUN] + k] = (is & BEGUN) != 0;
    row[at[APC_TICK_GAP] + k] = (is & GAP) != 0;
    row[at[APC_TICK_UPDATING] + k] = (is & UPDATING) != 0;
    row[at[APC_TICK_HELD] + i] = is & HOLDING ? (double)ms / 1e3 : -1.0;
}

/* The tick row that the core would have written. What version 1 does not keep is read anew: the target mode,
 * the tuning in force. */
static void fill_row(const struct apc_controller *c, const struct apc_sample *state, bool own, double *row)
{
    const size_t *at = c->core->offset, manual = at[APC_TICK_WANTED] + apc_core_wanted(c->core, APC_MANUAL);
    const struct apc_sample *s = state + 1;

    memset(row, 0, c->core->out_row.n * sizeof(*row));
    row[0] = c->core->mark[0];
    row[1] = own ? c->core->mark[1] : -1.0;
    s = take_values(row + at[APC_TICK_Y], s, c->ny);
    s = take_values(row + at[APC_TICK_Z], s, c->nz);
    s = take_values(row + at[APC_TICK_U], s, c->nu) + 1;
    for (size_t i = 0; i < c->nu; i++) {
        row[at[APC_TICK_TARGET] + i] = APC_MODE_OOS;
        row[at[APC_TICK_MANUAL] + i] = row[at[APC_TICK_LAST] + i] = row[at[APC_TICK_U] + i];
        row[manual + i] = -1.0;
        unpack(c, i, s[i].value, row);
    }
    for (size_t k = 0; k < c->nz; k++)
        row[at[APC_TICK_Z_SEQ] + k] = -1.0; /* there was one */
    memcpy(row + at[APC_TICK_TUNING], c->core->tuning, c->n_tuning * sizeof(*row));
    if (own)
        (void)take_values(row + at[APC_TICK_X], s + c->nu, c->n_x);
}

int apc_controller_resume(struct apc_controller *c, const int64_t *last, const struct apc_sample *in,
                          apc_ns since)
{
    const size_t outer = outer_state(c), n = outer + c->n_x;
    struct apc_vector *v = &apc_core_former(c->core)->vector[0];
    double dim;

    for (size_t i = 0; last && i < c->nu; i++)
        c->core->state[i].seq = last[i];
    v->seq = 0;
    for (size_t i = 0; in && i < n; i++)
        v->seq = in[i].seq > v->seq ? in[i].seq : v->seq;
    c->state_seq = v->seq;
    c->mode_seq = in ? in[n].seq : 0;
    dim = in ? floor(in[0].value / 0x1p32) : -1.0;
    if (in && whole(in, outer, since) && dim >= c->core->mark[0] && dim <= c->core->mark[0]) {
        const bool own = in[0].value - dim * 0x1p32 <= c->core->mark[1] &&
                         in[0].value - dim * 0x1p32 >= c->core->mark[1] && whole(in, n, since);

        fill_row(c, in, own, v->value);
        v->n = c->core->out_row.n;
        v->time = in[0].time;
        v->status = APC_GOOD;
    }
    c->core->adopts = true;
    if (!apc_core_resume(c->core, since))
        return 0;
    c->core->since = v->time;
    return 1;
}
