/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller goes on from the newest tick row of the run before. */
#include "base/base_internal.h"
#include "modules/controller.h"

#include <math.h>
#include <string.h>

/* A row of this run, of a controller of the same dimensions? It has all fields before those of the law. */
static bool row_fits_controller(const struct apc_controller *c, const struct apc_vector *v, apc_ns since)
{
    const uint32_t n = v->n < v->room ? v->n : v->room;

    return v->seq > 0 && n >= c->offset[APC_TICK_TUNING] && v->time >= since &&
           apc_status_severity(v->status) != APC_SEVERITY_BAD && apc_values_ok(v->value, n) &&
           v->value[0] >= c->mark[0] && v->value[0] <= c->mark[0];
}

static bool is_of_this_law(const struct apc_controller *c, const struct apc_vector *v)
{
    return v->n == c->out_row->n && v->value[1] >= c->mark[1] && v->value[1] <= c->mark[1];
}

static void take_seqs(int64_t *seq, const double *at, size_t n)
{
    for (size_t i = 0; i < n; i++)
        seq[i] = at[i] >= -1.0 && at[i] <= (double)APC_SEQ_MAX ? (int64_t)at[i] : 0;
}

static void take_values(double *value, const double *at, size_t n)
{
    memcpy(value, at, n * sizeof(*value));
}

static void resume_loop(struct apc_controller *c, size_t i, const double *row)
{
    const size_t *at = c->offset;
    const double state = row[at[APC_TICK_STATE] + i], held = row[at[APC_TICK_HELD] + i],
                 target = row[at[APC_TICK_TARGET] + i];
    struct apc_controller_state *l = &c->state[i];

    l->there = row[at[APC_TICK_THERE] + i] > 0.0;
    c->u[i] = fmin(fmax(row[at[APC_TICK_U] + i], c->low[i]), c->high[i]);
    c->last[i] = row[at[APC_TICK_LAST] + i];
    c->blocked[i] =
        (unsigned)fmin(fmax(row[at[APC_TICK_BLOCKED] + i], 0.0), APC_LIMITED_LOW | APC_LIMITED_HIGH);
    l->wanted = row[at[APC_TICK_MANUAL] + i];
    l->loop.state =
        state > 0.0 && state < (double)APC_LOOP_END ? (enum apc_loop_state)(int)state : APC_LOOP_OOS;
    l->target = target >= (double)APC_MODE_MAN && target <= (double)APC_MODE_CAS ? (enum apc_mode)(int)target
                                                                                 : APC_MODE_OOS;
    l->loop.poor = (unsigned)fmin(fmax(row[at[APC_TICK_POOR] + i], 0.0), 2.0 * c->shed_after);
    l->loop.linked = row[at[APC_TICK_LINKED] + i] > 0.0;
    take_seqs(&l->loop.asked, row + at[APC_TICK_ASKED] + i, 1);
    l->loop.holding = apc_ns_from_s(held, &l->loop.held) == 0 && held >= 0.0;
    if (!l->loop.holding)
        l->loop.held = 0;
}

/* What every law of these dimensions can go on from. */
static void take_common(struct apc_controller *c, const double *row)
{
    const size_t *at = c->offset, manual = apc_controller_wanted(c, APC_MANUAL);

    for (size_t i = 0; i < c->dim.nu; i++)
        resume_loop(c, i, row);
    take_seqs(c->looked + manual, row + at[APC_TICK_WANTED] + manual, c->dim.nu);
    for (size_t k = 0; k < c->dim.ny; k++) {
        const double status = row[at[APC_TICK_Y_STATUS] + k];

        c->y_status[k] = status >= 0.0 && status <= UINT32_MAX ? (apc_status)status : APC_BAD;
        c->y_new[k] = row[at[APC_TICK_Y_NEW] + k] > 0.0;
    }
    take_values(c->y_age, row + at[APC_TICK_Y_AGE], c->dim.ny);
    take_values(c->y, row + at[APC_TICK_Y], c->dim.ny);
    take_seqs(c->y_seq, row + at[APC_TICK_Y_SEQ], c->dim.ny);
    take_seqs(c->d_seq, row + at[APC_TICK_D_SEQ], c->dim.nd);
    take_seqs(c->z_seq, row + at[APC_TICK_Z_SEQ], c->dim.nz);
    for (size_t k = 0; k < c->size.n_ahead; k++) {
        take_values(c->d + k * c->dim.nd, row + at[APC_TICK_D], c->dim.nd);
        take_values(c->z + k * c->dim.nz, row + at[APC_TICK_Z], c->dim.nz);
    }
}

/* The tuning that was in force, where the file still allows it. */
static void resume_tuning(struct apc_controller_law *law, const double *tuning)
{
    for (size_t i = 0; i < law->size.tuning; i++) {
        if (!apc_param_accepts(&law->param[apc_instances_parameter(law->instances, i).number], tuning[i]))
            return;
    }
    if (law->definition && apc_instances_check(law->instances, tuning, NULL) < 0)
        return;
    take_values(law->tuning, tuning, law->size.tuning);
    take_values(law->offered, tuning, law->size.tuning);
}

static void take_law(struct apc_controller *c, const double *row)
{
    const size_t *at = c->offset;

    resume_tuning(&c->law, row + at[APC_TICK_TUNING]);
    resume_tuning(&c->backup, row + at[APC_TICK_TUNING] + c->backup.first);
    for (size_t k = 0; k < c->size.instances; k++)
        c->instance[k] = (struct apc_controller_instance){.begun = row[at[APC_TICK_BEGUN] + k] > 0.0,
                                                          .gap = row[at[APC_TICK_GAP] + k] > 0.0,
                                                          .updating = row[at[APC_TICK_UPDATING] + k] > 0.0};
    for (size_t k = 0; k < c->dim.nz && c->plan; k++) {
        take_seqs(&c->plan_seq[k], row + at[APC_TICK_PLAN] + k, 1);
        c->planned[k] = row[at[APC_TICK_PLANNED] + k] > 0.0;
    }
    take_values(c->x, row + at[APC_TICK_X], c->size.states);
}

/* Another law begins from the last output. */
static void begin_law(struct apc_controller *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const enum apc_loop_state state = c->state[i].loop.state;

        if (state == APC_LOOP_AUTO || state == APC_LOOP_CAS || state == APC_LOOP_BACKUP)
            c->state[i].loop.state = APC_LOOP_INIT;
    }
}

/* What this run has told is not told again. */
static void take_actual(struct apc_controller *c)
{
    const size_t mode = apc_controller_wanted(c, APC_OPMODE);

    for (size_t k = 0; k < c->n_actual; k++)
        apc_controller_take_told(c, k, &c->former.sample[k]);
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_sample *s = &c->told[mode + i];

        if (s->seq > 0 && s->value >= (double)APC_MODE_MAN && s->value <= (double)APC_MODE_LO)
            c->state[i].actual = (enum apc_mode)(int)s->value;
    }
}

int apc_controller_resume(struct apc_controller *c, apc_ns since)
{
    const struct apc_vector *v = &c->former_row;

    c->since = since > 0 ? since : INT64_MAX;
    take_actual(c);
    c->seq = v->seq;
    for (size_t k = c->n_actual; k < c->former.n_samples; k++)
        c->seq = c->former.sample[k].seq > c->seq ? c->former.sample[k].seq : c->seq;
    if (c->seq == 0 && c->former.sample[0].seq == 0)
        c->seq = c->former.sample[0].origin;
    if (!row_fits_controller(c, v, since))
        return 0;
    take_common(c, v->value);
    if (is_of_this_law(c, v))
        take_law(c, v->value);
    else
        begin_law(c);
    c->resumed_at = v->time;
    return 1;
}
