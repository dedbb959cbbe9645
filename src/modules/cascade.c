/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Loops above and below each other, in different controllers: what each reads of the other, and what it makes
 * of the setpoint between them. The rules are in loop.c, the handshake in docs/modes.md. All is judged by
 * what is read at this tick, in one snapshot; a row of the setpoint has an origin where a loop above wrote
 * it.
 */
#include "modules/controller.h"

#include <math.h>

/* ---- Rows --------------------------------------------------------------------------------- */

static struct apc_sample *name(struct apc_sample *at, enum apc_table table, int id)
{
    *at = (struct apc_sample){.table = table, .id = id, .status = APC_BAD_NO_DATA};
    return at + 1;
}

size_t apc_controller_cascade_rows(const struct apc_controller *c, size_t *vectors)
{
    size_t n = 0;

    *vectors = 0;
    for (size_t i = 0; i < c->dim.nu; i++) {
        const bool selected = apc_controller_is_selected(c, i);

        n += c->loop[i].setpoint ? 2 : selected ? 1 : 0;
        *vectors += c->loop[i].setpoint || selected ? 1 : 0;
    }
    for (size_t k = 0; k < c->dim.nz; k++)
        n += c->setpoint[k].above ? 1 : 0;
    return n;
}

void apc_controller_name_cascade(struct apc_controller *c, struct apc_sample *at)
{
    struct apc_vector *tick = c->in.vector;

    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_loop *l = &c->loop[i];

        if (!l->setpoint && !apc_controller_is_selected(c, i))
            continue;
        c->below[i] = (struct apc_controller_below){.rows = at, .tick = tick};
        if (l->setpoint)
            at = name(at, APC_OPMODE, l->below);
        at = name(at, APC_ACTUAL,
                  l->setpoint ? apc_variable_number(APC_SETPOINT, l->setpoint)
                              : apc_variable_number(APC_SENSOR, l->signal));
        *tick++ = (struct apc_vector){.table = APC_TICK, .id = l->below_tick, .status = APC_BAD_NO_DATA};
    }
    for (size_t k = 0; k < c->dim.nz; k++) {
        if (!c->setpoint[k].above)
            continue;
        c->above[k].mode = at;
        at = name(at, APC_ACTUAL, apc_variable_number(APC_OPMODE, c->setpoint[k].above));
    }
    for (size_t i = c->dim.nu; i-- > 0;) {
        const struct apc_law_ports *p = apc_instances_ports(c->law.instances, i);

        c->state[i].setpoint = p->nz ? p->z[0] : -1;
        for (size_t j = 0; j < p->nz; j++)
            c->above[p->z[j]].loop = i;
    }
}

bool apc_controller_is_below(const struct apc_controller *c, size_t i)
{
    const int k = c->state[i].setpoint;

    return k >= 0 && c->setpoint[k].above && c->above[k].loop == i;
}

/* ---- The loop below ------------------------------------------------------------------------ */

void apc_controller_find_in_force(struct apc_controller *c, size_t i, double value)
{
    struct apc_controller_state *l = &c->state[i];

    if (l->there && c->u[i] >= value && c->u[i] <= value)
        return;
    c->u[i] = value;
    l->there = true;
    if (l->loop.state == APC_LOOP_AUTO || l->loop.state == APC_LOOP_CAS)
        l->loop.state = APC_LOOP_INIT;
}

void apc_controller_look_below(struct apc_controller *c, size_t i, struct apc_now now)
{
    struct apc_controller_below *b = &c->below[i];
    const struct apc_sample *target = b->rows, *actual = b->rows + 1, *newest = apc_controller_output(c, i);
    const struct apc_loop_below seen = {.cascade = target->seq > 0 && target->value == (double)APC_MODE_CAS,
                                        .fresh =
                                            apc_freshness_dated(&b->fresh, b->tick->seq, b->tick->time, now,
                                                                apc_loss_limit(c->loop[i].below_period)),
                                        .status = actual->status,
                                        .value = actual->value,
                                        .newest = newest->value};

    b->taken = apc_loop_taken(&seen);
    b->invited = apc_loop_invited(&seen);
    c->blocked[i] = b->taken ? apc_loop_limited(actual->status) : 0u;
    if (b->taken)
        apc_controller_find_in_force(c, i, newest->value);
    else if (actual->seq > 0)
        apc_controller_find_in_force(c, i, actual->value);
}

/* ---- The loop above ------------------------------------------------------------------------ */

static void set(struct apc_controller *c, size_t k, double value)
{
    for (size_t row = 0; row < c->size.n_ahead; row++)
        c->z[row * c->dim.nz + k] = value;
}

/* In Man the setpoint is where the measurement is, so that nothing happens when the law has the output again.
 */
static void follow_measurement(struct apc_controller *c, size_t k)
{
    const struct apc_law_ports *p = apc_instances_ports(c->law.instances, c->above[k].loop);
    const struct apc_controller_setpoint *z = &c->setpoint[k];

    if (p->ny && c->ok[p->y[0]])
        set(c, k, fmin(fmax(c->y[p->y[0]], z->low), z->high));
}

bool apc_controller_look_above(struct apc_controller *c, size_t k, const struct apc_sample *newest,
                               struct apc_now now)
{
    struct apc_controller_above *a = &c->above[k];
    const struct apc_controller_state *l = &c->state[a->loop];
    const struct apc_loop_above seen = {
        .target = l->target,
        .theirs = newest->origin > 0,
        .fresh = apc_freshness_dated(&a->fresh, newest->seq, newest->time, now,
                                     apc_loss_limit(c->setpoint[k].above_period)),
        .able = a->mode->value != (double)APC_MODE_LO && a->mode->value != (double)APC_MODE_OOS,
        .origin = newest->origin,
        .value = newest->value,
        .working = c->z[k]};

    bool takes;

    a->remote = apc_loop_remote(&l->loop, &seen);
    takes = !c->z_seq[k] || apc_loop_takes(&l->loop, &seen);
    a->put = !takes && l->target != APC_MODE_OOS;
    return takes;
}

void apc_controller_own_setpoint(struct apc_controller *c, size_t k, const struct apc_sample *newest)
{
    struct apc_controller_above *a = &c->above[k];

    if (c->state[a->loop].target != APC_MODE_MAN || !newest->seq)
        return;
    follow_measurement(c, k);
    a->put |= c->z[k] < newest->value || c->z[k] > newest->value;
}

apc_status apc_controller_handshake(const struct apc_controller *c, size_t k)
{
    const size_t i = c->above[k].loop;
    const struct apc_law_ports *p = apc_instances_ports(c->law.instances, i);
    const struct apc_controller_state *l = &c->state[i];

    return apc_loop_status(&l->loop, l->target,
                           p->ny ? apc_loop_lacks(c->law.limited[i], c->z[k], c->y[p->y[0]])
                                 : c->law.limited[i]);
}
