/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller's rows in the shared data: what it reads and what it writes.
 *
 * With its outputs goes one tick row, in the same transaction: all that they were made from, and all that the
 * next tick goes on from. What is stored is so always one consistent tick. And for what somebody wants, a row
 * in table actual says what became of it, when that changes.
 */
#include "base/base_internal.h"
#include "modules/controller.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Layout ------------------------------------------------------------------------------- */

static const char *const names[APC_TICK_FIELDS] = {
    [APC_TICK_MARK] = "mark",
    [APC_TICK_INDEX] = "index",
    [APC_TICK_STATE] = "state",
    [APC_TICK_HELD] = "held",
    [APC_TICK_POOR] = "poor",
    [APC_TICK_LINKED] = "linked",
    [APC_TICK_ASKED] = "asked",
    [APC_TICK_U] = "u",
    [APC_TICK_THERE] = "u.there",
    [APC_TICK_LAST] = "u.last",
    [APC_TICK_BLOCKED] = "u.blocked",
    [APC_TICK_TARGET] = "target",
    [APC_TICK_MANUAL] = "manual",
    [APC_TICK_WANTED] = "wanted.seq",
    [APC_TICK_Y] = "y",
    [APC_TICK_Y_SEQ] = "y.seq",
    [APC_TICK_Y_STATUS] = "y.status",
    [APC_TICK_Y_AGE] = "y.age",
    [APC_TICK_Y_NEW] = "y.new",
    [APC_TICK_D] = "d",
    [APC_TICK_D_SEQ] = "d.seq",
    [APC_TICK_D_STATUS] = "d.status",
    [APC_TICK_Z] = "z",
    [APC_TICK_Z_SEQ] = "z.seq",
    [APC_TICK_ABOVE] = "above.seq",
    [APC_TICK_BELOW] = "below.seq",
    [APC_TICK_PEER] = "peer",
    [APC_TICK_TUNING] = "tuning",
    [APC_TICK_TUNING_SEQ] = "tuning.seq",
    [APC_TICK_PLAN] = "plan.seq",
    [APC_TICK_PLANNED] = "planned",
    [APC_TICK_BEGUN] = "x.begun",
    [APC_TICK_GAP] = "x.gap",
    [APC_TICK_UPDATING] = "x.updating",
    [APC_TICK_RESULT] = "result",
    [APC_TICK_X] = "x",
};

bool apc_controller_tick_field(const struct apc_controller *c, size_t field, const char **name,
                               size_t *offset, size_t *length)
{
    if (field >= APC_TICK_FIELDS)
        return false;
    *name = names[field];
    *offset = c->offset[field];
    *length = c->offset[field + 1] - c->offset[field];
    return true;
}

static void lay_out_tick(struct apc_controller *c, bool peers)
{
    const size_t ny = c->dim.ny, nz = c->dim.nz, nu = c->dim.nu, nd = c->dim.nd, n = c->size.instances;
    const size_t length[APC_TICK_FIELDS] = {
        [APC_TICK_MARK] = 2,
        [APC_TICK_INDEX] = 1,
        [APC_TICK_STATE] = nu,
        [APC_TICK_HELD] = nu,
        [APC_TICK_POOR] = nu,
        [APC_TICK_LINKED] = nu,
        [APC_TICK_ASKED] = nu,
        [APC_TICK_U] = nu,
        [APC_TICK_THERE] = nu,
        [APC_TICK_LAST] = nu,
        [APC_TICK_BLOCKED] = nu,
        [APC_TICK_TARGET] = nu,
        [APC_TICK_MANUAL] = nu,
        [APC_TICK_WANTED] = nz + 2 * nu,
        [APC_TICK_Y] = ny,
        [APC_TICK_Y_SEQ] = ny,
        [APC_TICK_Y_STATUS] = ny,
        [APC_TICK_Y_AGE] = ny,
        [APC_TICK_Y_NEW] = ny,
        [APC_TICK_D] = nd,
        [APC_TICK_D_SEQ] = nd,
        [APC_TICK_D_STATUS] = nd,
        [APC_TICK_Z] = nz,
        [APC_TICK_Z_SEQ] = nz,
        [APC_TICK_ABOVE] = nz,
        [APC_TICK_BELOW] = 4 * nu,
        [APC_TICK_PEER] = peers ? 2 * nz + nu : 0,
        [APC_TICK_TUNING] = c->size.tuning,
        [APC_TICK_TUNING_SEQ] = c->size.tuning,
        [APC_TICK_PLAN] = c->size.n_ahead > 1 ? nz : 0,
        [APC_TICK_PLANNED] = c->size.n_ahead > 1 ? nz : 0,
        [APC_TICK_BEGUN] = n,
        [APC_TICK_GAP] = n,
        [APC_TICK_UPDATING] = n,
        [APC_TICK_RESULT] = n,
        [APC_TICK_X] = c->size.states,
    };

    for (size_t f = 0; f < APC_TICK_FIELDS; f++)
        c->offset[f + 1] = c->offset[f] + length[f];
}

/* Has it a neighbour that has peers? */
static bool takes_turns(const struct apc_controller *c)
{
    bool any = false;

    for (size_t i = 0; i < c->dim.nu; i++)
        any |= c->loop[i].below_peers.n > 0;
    for (size_t k = 0; k < c->dim.nz; k++)
        any |= c->setpoint[k].above_peers.n > 0;
    return any;
}

/* Whose a row is: a number of the dimensions, and one of the law and all that it was made from. */
static void mark(struct apc_controller *c)
{
    const size_t of[] = {c->dim.ny, c->dim.nz, c->dim.nu, c->dim.nd};
    uint32_t hash = APC_HASH_BEGIN;

    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++)
        hash = apc_hash_number(hash, of[i]);
    c->mark[0] = hash >> 11; /* with that of the law it stands in one whole double */
    hash = apc_instances_mark(c->law.instances);
    if (c->backup.definition)
        hash = apc_hash_number(hash, apc_instances_mark(c->backup.instances));
    c->mark[1] = hash;
}

static struct apc_sample *name_loop_rows(struct apc_sample *at, enum apc_table table, const int *id, size_t n,
                                         int first)
{
    for (size_t i = 0; i < n; i++)
        *at++ =
            (struct apc_sample){.table = table, .id = id ? id[i] : first + (int)i, .status = APC_BAD_NO_DATA};
    return at;
}

/* What whoever acts tells. */
static void name_told(struct apc_controller *c, struct apc_sample *at)
{
    for (size_t k = 0; k < c->dim.nz; k++)
        at = name_loop_rows(at, APC_ACTUAL, NULL, 1, apc_variable_number(APC_SETPOINT, c->setpoint[k].id));
    for (size_t k = 0; k < c->n_inputs; k++)
        at = name_loop_rows(at, APC_ACTUAL, NULL, 1,
                            apc_variable_number(APC_SENSOR, c->in.sample[c->input[k].y].id));
}

static int name_inputs(struct apc_controller *c, const struct apc_controller_options *o)
{
    struct apc_sample *at = c->in.sample;

    at = name_loop_rows(at, APC_SENSOR, o->y, c->dim.ny, 1);
    at = name_loop_rows(at, APC_SENSOR, o->d, c->dim.nd, 1);
    for (size_t k = 0; k < c->dim.nz; k++)
        at = name_loop_rows(at, APC_SETPOINT, NULL, 1, c->setpoint[k].id);
    for (size_t i = 0; i < c->dim.nu; i++)
        at = name_loop_rows(at, APC_OPMODE, NULL, 1, c->loop[i].mode);
    for (size_t i = 0; i < c->dim.nu; i++)
        at = name_loop_rows(at, APC_MANUAL, NULL, 1, c->loop[i].manual);
    at = name_loop_rows(at, APC_TUNING, NULL, c->size.tuning, o->tuning ? o->tuning : 1);
    for (size_t i = 0; i < c->dim.nu; i++)
        at = c->loop[i].setpoint ? name_loop_rows(at, APC_SETPOINT, NULL, 1, c->loop[i].setpoint)
             : c->loop[i].signal ? name_loop_rows(at, APC_SENSOR, NULL, 1, c->loop[i].signal)
                                 : name_loop_rows(at, APC_ACTUATOR, NULL, 1, c->loop[i].id);
    if (o->acting) {
        c->choice = c->in.sample + c->in.n_samples - 1 - c->dim.nz - c->n_inputs;
        name_told(c, name_loop_rows(c->choice, APC_OPMODE, NULL, 1, o->acting));
    }
    return apc_controller_name_cascade(c, at);
}

static void name_actual(struct apc_controller *c)
{
    const struct apc_sample *wanted = c->in.sample + c->dim.ny + c->dim.nd;

    for (size_t k = 0; k < c->n_actual; k++) {
        const struct apc_sample *of =
            k < c->n_wanted ? &wanted[k] : &c->in.sample[c->input[k - c->n_wanted].y];

        c->actual[k] = (struct apc_sample){
            .table = APC_ACTUAL, .id = apc_variable_number(of->table, of->id), .status = APC_BAD_NO_DATA};
        c->told[k] = c->former.sample[k] = c->actual[k];
    }
}

/* What the law publishes and is to be written, one after another; zeroed at first. */
struct published {
    const struct apc_published *what;
    size_t instance, in;     /* which of its variables */
    size_t at, end;          /* where it begins in published; behind it */
    size_t numbers, vectors; /* up to this one */
};

static bool next_published(const struct apc_controller *c, struct published *p)
{
    while (p->instance < c->law.size.instances) {
        const struct apc_instance_part *part = apc_instances_part(c->law.instances, p->instance);
        const bool more = p->in < part->n_published;

        if (!more) {
            p->instance++;
            p->in = 0;
            continue;
        }
        p->what = part->what + p->in++;
        p->at = p->end;
        p->end += p->what->length ? p->what->length : 1;
        if (p->what->length ? !c->prediction : !c->estimate)
            continue;
        p->numbers += p->what->length == 0;
        p->vectors += p->what->length > 0;
        return true;
    }
    return false;
}

static void name_plans(struct apc_controller *c, struct apc_vector *plan)
{
    c->plan = plan;
    for (size_t k = 0; k < c->dim.nz; k++)
        plan[k] = (struct apc_vector){.table = APC_PLAN,
                                      .id = c->setpoint[k].id,
                                      .status = APC_BAD_NO_DATA,
                                      .room = 2 * APC_PLAN_PAIRS,
                                      .value = c->plan_values + (size_t)2 * APC_PLAN_PAIRS * k};
}

int apc_controller_lay_out(struct apc_controller *c, const struct apc_controller_options *o,
                           struct apc_error *why)
{
    struct published p = {0};
    size_t n, n_vectors;
    const size_t n_cascade = apc_controller_cascade_rows(c, &n_vectors),
                 n_in = c->dim.ny + c->dim.nd + c->n_wanted + c->dim.nu + n_cascade +
                        (o->acting ? 1 + c->dim.nz + c->n_inputs : 0),
                 n_ticks = n_vectors, n_plans = c->size.n_ahead > 1 ? c->dim.nz : 0,
                 n_told = o->output ? c->dim.nu : 0, n_out = c->dim.nz + c->dim.nu + c->n_actual + n_told;

    n_vectors += n_plans;
    lay_out_tick(c, o->acting || takes_turns(c));
    mark(c);
    n = c->offset[APC_TICK_FIELDS];
    if (n > APC_ELEMENTS_MAX)
        return apc_fail(
            why, APC_EINVAL,
            "controller: with %zu outputs, %zu tuning parameters and %zu states of its law a tick row "
            "would have %zu numbers; a store takes %d: give the outputs to several controllers",
            c->dim.nu, c->size.tuning, c->size.states, n, APC_ELEMENTS_MAX);
    c->estimate = o->estimate;
    c->prediction = o->prediction;
    c->output = o->output;
    while (next_published(c, &p))
        ;
    c->samples = calloc(n_in + n_out + 3 * c->n_actual + 2 * p.numbers + n_told, sizeof(*c->samples));
    c->vectors = calloc(n_vectors + 1 + p.vectors, sizeof(*c->vectors));
    c->row = calloc(n, sizeof(*c->row));
    c->former_values = calloc(n, sizeof(*c->former_values));
    c->plan_values = calloc((size_t)2 * APC_PLAN_PAIRS * n_plans + 1, sizeof(*c->plan_values));
    if (!c->samples || !c->vectors || !c->row || !c->former_values || !c->plan_values)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    c->out_row = c->vectors + n_vectors;
    *c->out_row = (struct apc_vector){.table = APC_TICK,
                                      .id = o->number ? o->number : 1,
                                      .n = (uint32_t)n,
                                      .room = (uint32_t)n,
                                      .value = c->row};
    c->former_row = *c->out_row;
    c->former_row.n = 0;
    c->former_row.status = APC_BAD_NO_DATA;
    c->former_row.value = c->former_values;
    c->in = (struct apc_rows){.size = sizeof(c->in),
                              .sample = c->samples,
                              .n_samples = n_in,
                              .vector = c->vectors,
                              .n_vectors = n_vectors};
    c->out = (struct apc_rows){.size = sizeof(c->out), .sample = c->samples + n_in, .vector = c->out_row};
    c->former = (struct apc_rows){.size = sizeof(c->former),
                                  .sample = c->samples + n_in + n_out + p.numbers,
                                  .n_samples = c->n_actual + p.numbers + n_told,
                                  .vector = &c->former_row,
                                  .n_vectors = 1};
    c->actual = c->former.sample + c->former.n_samples;
    c->told = c->actual + c->n_actual;
    if (n_plans)
        name_plans(c, c->vectors + n_ticks);
    if (name_inputs(c, o) < 0)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    name_actual(c);
    for (size_t k = 0; k < p.numbers; k++)
        c->former.sample[c->n_actual + k] =
            (struct apc_sample){.table = APC_ESTIMATE, .id = c->estimate + (int)k, .status = APC_BAD_NO_DATA};
    (void)name_loop_rows(c->former.sample + c->n_actual + p.numbers, APC_ESTIMATE, NULL, n_told, c->output);
    return 0;
}

/* ---- What it writes ------------------------------------------------------------------------ */

apc_status apc_controller_limited(unsigned limited)
{
    static const apc_status good[] = {APC_GOOD, APC_GOOD_LIMITED_LOW, APC_GOOD_LIMITED_HIGH,
                                      APC_GOOD_LIMITED_CONSTANT};

    return good[limited & (APC_LIMITED_LOW | APC_LIMITED_HIGH)];
}

/* A good output of the law says as well which way a limit holds it back. */
static apc_status status_of(const struct apc_controller *c, size_t i)
{
    const struct apc_loop_move *move = &c->state[i].move;

    if (move->output == APC_PUT_FAULT && c->loop[i].signal)
        return APC_BAD; /* nothing is a substitute for a measurement */
    if (move->output != APC_PUT_LAW && move->output != APC_PUT_BACKUP)
        return move->status;
    return apc_controller_limited((move->output == APC_PUT_LAW ? c->law : c->backup).limited[i]);
}

/* By swap: only if the newest row is still @p now. */
static void put_setpoint(struct apc_controller *c, const struct apc_sample *now, apc_ns utc, double value,
                         apc_status status, int64_t origin)
{
    c->out.sample[c->out.n_samples++] = (struct apc_sample){.table = APC_SETPOINT,
                                                            .id = now->id,
                                                            .seq = now->seq,
                                                            .time = utc,
                                                            .value = value,
                                                            .status = status,
                                                            .origin = origin};
}

static void put_output_row(struct apc_controller *c, size_t i, apc_ns utc)
{
    const struct apc_sample *now = apc_controller_output(c, i);
    struct apc_controller_state *l = &c->state[i];
    const apc_status status = c->fast_path[i] ? apc_controller_limited(c->law.limited[i]) : status_of(c, i);

    if (!c->fast_path[i]) {
        l->put = l->there && l->move.output != APC_PUT_NONE;
        if (!l->put)
            return;
        if (c->loop[i].setpoint) {
            put_setpoint(c, now, utc, c->u[i], status, c->below[i].actual->seq);
            return;
        }
    }
    l->seq = (apc_seq_last(now) > l->seq ? apc_seq_last(now) : l->seq) + 1;
    c->out.sample[c->out.n_samples++] = (struct apc_sample){.table = now->table,
                                                            .id = now->id,
                                                            .seq = l->seq,
                                                            .time = utc,
                                                            .value = c->u[i],
                                                            .status = status,
                                                            .origin = c->seq};
}

static bool is_told(const struct apc_sample *now, const struct apc_sample *told)
{
    return told->seq > 0 && now->status == told->status && now->origin == told->origin &&
           now->value >= told->value && now->value <= told->value;
}

bool apc_controller_is_quiet(const struct apc_controller *c, size_t k)
{
    const bool mode = k >= apc_controller_wanted(c, APC_OPMODE) && k < apc_controller_wanted(c, APC_MANUAL);

    return (!mode && !c->actual[k].origin) || is_told(&c->actual[k], &c->told[k]);
}

static void put_actual(struct apc_controller *c, size_t k, apc_ns utc)
{
    struct apc_sample *s = &c->actual[k];

    if (!c->acting && (k < c->dim.nz || k >= c->n_wanted)) /* whoever acts says it */
        return;
    if (apc_controller_is_quiet(c, k))
        return;
    s->seq++;
    s->time = utc;
    c->out.sample[c->out.n_samples++] = *s;
    c->telling = true;
}

/* A setpoint is open as long as it is not told, or may become another one without a new row. */
static void put_setpoints_told(struct apc_controller *c, apc_ns utc)
{
    for (size_t k = 0; k < c->dim.nz; k++) {
        if (!c->open[k])
            continue;
        put_actual(c, k, utc);
        c->open[k] = c->setpoint[k].above || c->choice || c->rests[k] || !apc_controller_is_quiet(c, k);
    }
}

/* Of loops on the fast path all is told. */
static void put_loops_told(struct apc_controller *c, enum apc_table table, apc_ns utc)
{
    const size_t first = apc_controller_wanted(c, table);

    for (size_t i = 0; i < c->dim.nu; i++) {
        if (!c->fast_path[i])
            put_actual(c, first + i, utc);
    }
}

static void put_seqs(double *at, const int64_t *seq, size_t n)
{
    for (size_t i = 0; i < n; i++)
        at[i] = (double)seq[i];
}

static void copy_values(double *at, const double *value, size_t n)
{
    memcpy(at, value, n * sizeof(*at));
}

/* As long as no row is new there is nothing to tell of the tuning, and in the tick row it stands. */
static void put_tuning(struct apc_controller *c, apc_ns utc)
{
    const size_t n = c->out.n_samples, first = apc_controller_wanted(c, APC_TUNING);

    if (!c->untold)
        return;
    for (size_t k = first; k < c->n_wanted; k++)
        put_actual(c, k, utc);
    copy_values(c->row + c->offset[APC_TICK_TUNING], c->tuning, c->size.tuning);
    put_seqs(c->row + c->offset[APC_TICK_TUNING_SEQ], c->looked + first, c->size.tuning);
    c->untold = c->out.n_samples > n;
}

static size_t one_of(const struct apc_controller_group *g)
{
    return g->now < g->n ? g->now : 0;
}

/* Of the one that acts: 0: there is no other, -1: none does. */
static double number_of_controller_acting(const struct apc_controller_group *g)
{
    return !g->choice ? 0.0 : g->now < g->n ? (double)g->number[g->now] : -1.0;
}

/* Setpoints, modes and manual outputs, and which of their rows were looked at: it stands as long as none is. */
static void put_wanted(struct apc_controller *c, double *row)
{
    const size_t *at = c->offset;

    if (!c->looking)
        return;
    copy_values(row + at[APC_TICK_Z], c->z, c->dim.nz);
    put_seqs(row + at[APC_TICK_Z_SEQ], c->z_seq, c->dim.nz);
    put_seqs(row + at[APC_TICK_WANTED], c->looked, apc_controller_wanted(c, APC_TUNING));
    c->looking = false;
}

static void put_disturbances(struct apc_controller *c, double *row)
{
    const size_t *at = c->offset;

    copy_values(row + at[APC_TICK_D], c->d, c->dim.nd);
    put_seqs(row + at[APC_TICK_D_SEQ], c->d_seq, c->dim.nd);
    for (size_t k = 0; k < c->dim.nd; k++) {
        const apc_status status = c->in.sample[c->dim.ny + k].status;
        const bool bad = apc_status_severity(status) == APC_SEVERITY_BAD;

        row[at[APC_TICK_D_STATUS] + k] = c->ok[c->dim.ny + k] || bad ? status : APC_BAD_NO_COMMUNICATION;
    }
}

/* What was looked at of loops above and below. */
static void put_seen(struct apc_controller *c, double *row)
{
    const size_t *at = c->offset;

    for (size_t k = 0; k < c->dim.nz; k++)
        row[at[APC_TICK_ABOVE] + k] =
            c->setpoint[k].above ? (double)c->above[k].mode[one_of(&c->above[k].who)].seq : 0.0;
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_below *b = &c->below[i];

        if (apc_controller_is_selected(c, i)) {
            row[at[APC_TICK_BELOW] + 4 * i + 1] = (double)b->actual->seq;
            row[at[APC_TICK_BELOW] + 4 * i + 3] = (double)b->tick[one_of(&b->who)].seq;
        }
        if (!c->loop[i].setpoint)
            continue;
        row[at[APC_TICK_BELOW] + 4 * i] = (double)apc_controller_output(c, i)->seq;
        row[at[APC_TICK_BELOW] + 4 * i + 1] = (double)b->actual->seq;
        row[at[APC_TICK_BELOW] + 4 * i + 2] = (double)b->target[one_of(&b->who)].seq;
        row[at[APC_TICK_BELOW] + 4 * i + 3] = (double)b->tick[one_of(&b->who)].seq;
    }
}

static void put_peers(const struct apc_controller *c, double *row)
{
    for (size_t k = 0; k < c->dim.nz; k++)
        *row++ = number_of_controller_acting(&c->above[k].who);
    for (size_t i = 0; i < c->dim.nu; i++)
        *row++ = number_of_controller_acting(&c->below[i].who);
    for (size_t k = 0; k < c->dim.nz; k++)
        *row++ = c->choice ? (double)c->choice[1 + k].seq : 0.0;
}

/* Are all numbers such that a store takes them? What is counted or timed always is, measurements and tuning
 * are when they are taken. */
static bool is_storable(const struct apc_controller *c, const double *row)
{
    static const enum apc_tick_field field[] = {APC_TICK_U, APC_TICK_LAST, APC_TICK_MANUAL, APC_TICK_Z,
                                                APC_TICK_X};
    bool storable = true;

    for (size_t f = 0; f < sizeof(field) / sizeof(field[0]); f++)
        storable &= apc_values_ok(row + c->offset[field[f]], c->offset[field[f] + 1] - c->offset[field[f]]);
    return storable;
}

static void put_tick(struct apc_controller *c, struct apc_now now)
{
    double *row = c->row;
    const size_t *at = c->offset;

    copy_values(row + at[APC_TICK_MARK], c->mark, 2);
    row[at[APC_TICK_INDEX]] = (double)c->index;
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_state *l = &c->state[i];

        row[at[APC_TICK_LAST] + i] = isnan(c->last[i]) ? c->u[i] : c->last[i];
        if (c->fast_path[i])
            continue;
        row[at[APC_TICK_STATE] + i] = l->loop.state;
        row[at[APC_TICK_HELD] + i] = l->loop.holding ? apc_ns_to_s(now.mono - l->loop.held) : -1.0;
        row[at[APC_TICK_POOR] + i] = l->loop.poor;
        row[at[APC_TICK_LINKED] + i] = l->loop.linked;
        row[at[APC_TICK_ASKED] + i] = (double)l->loop.asked;
        row[at[APC_TICK_THERE] + i] = l->there;
        row[at[APC_TICK_BLOCKED] + i] = c->blocked[i];
        row[at[APC_TICK_TARGET] + i] = l->target;
        row[at[APC_TICK_MANUAL] + i] = l->wanted;
    }
    for (size_t k = 0; k < c->size.instances; k++) {
        if (k < c->dim.nu && c->fast_path[k])
            continue;
        row[at[APC_TICK_BEGUN] + k] = c->instance[k].begun;
        row[at[APC_TICK_GAP] + k] = c->instance[k].gap;
        row[at[APC_TICK_UPDATING] + k] = c->instance[k].updating;
        row[at[APC_TICK_RESULT] + k] = c->instance[k].result;
    }
    copy_values(row + at[APC_TICK_U], c->u, c->dim.nu);
    for (size_t k = 0; k < c->dim.ny; k++) {
        row[at[APC_TICK_Y_STATUS] + k] = c->y_status[k];
        row[at[APC_TICK_Y_NEW] + k] = c->y_new[k];
    }
    copy_values(row + at[APC_TICK_Y_AGE], c->y_age, c->dim.ny);
    copy_values(row + at[APC_TICK_Y], c->y, c->dim.ny);
    put_seqs(row + at[APC_TICK_Y_SEQ], c->y_seq, c->dim.ny);
    put_disturbances(c, row);
    put_wanted(c, row);
    if (c->cascaded || c->selected)
        put_seen(c, row);
    if (at[APC_TICK_PEER] < at[APC_TICK_PEER + 1])
        put_peers(c, row + at[APC_TICK_PEER]);
    for (size_t k = 0; k < c->dim.nz && c->plan; k++) {
        row[at[APC_TICK_PLAN] + k] = (double)c->plan_seq[k];
        row[at[APC_TICK_PLANNED] + k] = c->planned[k];
    }
    copy_values(row + at[APC_TICK_X], c->x, c->size.states);
    c->out_row->seq = c->seq;
    c->out_row->time = now.utc;
    c->out.n_vectors = is_storable(c, row);
}

static void put_published(struct apc_controller *c, apc_ns utc)
{
    struct published p = {0};

    while (next_published(c, &p)) {
        const size_t n = p.what->length ? p.what->length : 1;

        const double *published = c->law.published + p.at;

        if (!c->law.instance[p.instance].answered || !apc_values_ok(published, n))
            continue;
        if (p.what->length)
            c->out.vector[c->out.n_vectors++] = (struct apc_vector){.table = APC_PREDICTION,
                                                                    .id = c->prediction + (int)p.vectors - 1,
                                                                    .seq = c->seq,
                                                                    .time = utc,
                                                                    .n = (uint32_t)n,
                                                                    .room = (uint32_t)n,
                                                                    .value = c->law.published + p.at};
        else
            c->out.sample[c->out.n_samples++] = (struct apc_sample){.table = APC_ESTIMATE,
                                                                    .id = c->estimate + (int)p.numbers - 1,
                                                                    .seq = c->seq,
                                                                    .time = utc,
                                                                    .value = *published,
                                                                    .origin = c->seq};
    }
}

/* What it puts out, or would. */
static void put_outputs(struct apc_controller *c, apc_ns utc)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_state *l = &c->state[i];
        const double u = l->put ? c->u[i] : l->would;

        if (apc_value_ok(u))
            c->out.sample[c->out.n_samples++] = (struct apc_sample){.table = APC_ESTIMATE,
                                                                    .id = c->output + (int)i,
                                                                    .seq = c->seq,
                                                                    .time = utc,
                                                                    .value = u,
                                                                    .origin = c->seq};
    }
}

void apc_controller_put(struct apc_controller *c, struct apc_now now)
{
    c->out.n_samples = 0;
    c->seq++;
    for (size_t i = 0; i < c->dim.nu; i++)
        put_output_row(c, i, now.utc);
    for (size_t k = 0; c->cascaded && k < c->dim.nz; k++) {
        if (c->above[k].put)
            put_setpoint(c, &c->in.sample[c->dim.ny + c->dim.nd + k], now.utc, c->z[k], APC_GOOD, 0);
    }
    apc_controller_confirm(c);
    apc_controller_tell_inputs(c);
    put_setpoints_told(c, now.utc);
    put_loops_told(c, APC_OPMODE, now.utc);
    put_loops_told(c, APC_MANUAL, now.utc);
    put_tuning(c, now.utc);
    for (size_t k = c->n_wanted; k < c->n_actual; k++)
        put_actual(c, k, now.utc);
    put_tick(c, now);
    if (c->out.n_vectors > 0 && c->law.size.published)
        put_published(c, now.utc);
    if (c->out.n_vectors > 0 && c->output)
        put_outputs(c, now.utc);
}
