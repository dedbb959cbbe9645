/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Loops above and below each other, in different controllers: what each reads of the other, and what it makes
 * of the setpoint between them. The rules are in loop.c, the handshake in docs/modes.md. All is judged by
 * what is read at this tick, in one snapshot; a row of the setpoint has an origin where a loop above wrote
 * it.
 */
#include "modules/controller.h"

#include <math.h>
#include <stdlib.h>

/* ---- Rows --------------------------------------------------------------------------------- */

static struct apc_sample *name(struct apc_sample *at, enum apc_table table, int id)
{
    *at = (struct apc_sample){.table = table, .id = id, .status = APC_BAD_NO_DATA};
    return at + 1;
}

static size_t with_switch(const struct apc_controller_peers *peers)
{
    return peers->n > 0 ? 1 : 0;
}

size_t apc_controller_cascade_rows(const struct apc_controller *c, size_t *vectors)
{
    size_t n = 0;

    *vectors = 0;
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_peers *peers = &c->loop[i].below_peers;
        const bool selected = apc_controller_is_selected(c, i);

        if (!c->loop[i].setpoint && !selected)
            continue;
        n += with_switch(peers) + (selected ? 1 : 2 + peers->n);
        *vectors += 1 + peers->n;
    }
    for (size_t k = 0; k < c->dim.nz; k++)
        n += c->setpoint[k].above
                 ? 1 + c->setpoint[k].above_peers.n + with_switch(&c->setpoint[k].above_peers)
                 : 0;
    return n;
}

bool apc_controller_find_acting(struct apc_controller_group *g)
{
    const size_t before = g->now;
    size_t i = 0;

    if (!g->choice || g->choice->seq == 0)
        return false;
    while (i < g->n && g->choice->value != (double)g->number[i])
        i++;
    g->now = i;
    return g->now != before;
}

/* The first of them, @p number, and its peers; the switch has its row @p at. */
static struct apc_controller_group group(const struct apc_controller_peers *peers, int number,
                                         struct apc_sample *at, int **numbers)
{
    struct apc_controller_group g = {.n = 1 + peers->n};

    if (!peers->n)
        return g;
    g.choice = at;
    g.number = *numbers;
    *(*numbers)++ = number;
    for (size_t j = 0; j < peers->n; j++)
        *(*numbers)++ = peers->at[j].number;
    (void)name(at, APC_OPMODE, peers->acting);
    return g;
}

static struct apc_sample *name_below(struct apc_controller *c, size_t i, struct apc_sample *at,
                                     struct apc_vector *tick, int **numbers)
{
    const struct apc_controller_loop *l = &c->loop[i];
    const struct apc_controller_peers *peers = &l->below_peers;
    struct apc_controller_below *b = &c->below[i];

    *b = (struct apc_controller_below){.who = group(peers, l->below_tick, at, numbers), .tick = tick};
    at += with_switch(peers);
    b->target = at;
    for (size_t j = 0; j < b->who.n; j++) {
        if (l->setpoint)
            at = name(at, APC_OPMODE, j ? peers->at[j - 1].mode : l->below);
        tick[j] = (struct apc_vector){
            .table = APC_TICK, .id = j ? peers->at[j - 1].number : l->below_tick, .status = APC_BAD_NO_DATA};
    }
    b->actual = at;
    return name(at, APC_ACTUAL,
                l->setpoint ? apc_variable_number(APC_SETPOINT, l->setpoint)
                            : apc_variable_number(APC_SENSOR, l->signal));
}

static struct apc_sample *name_above(struct apc_controller *c, size_t k, struct apc_sample *at, int **numbers)
{
    const struct apc_controller_setpoint *z = &c->setpoint[k];
    const struct apc_controller_peers *peers = &z->above_peers;
    struct apc_controller_above *a = &c->above[k];

    a->who = group(peers, z->above_number, at, numbers);
    at += with_switch(peers);
    a->mode = at;
    for (size_t j = 0; j < a->who.n; j++)
        at = name(at, APC_ACTUAL, apc_variable_number(APC_OPMODE, j ? peers->at[j - 1].mode : z->above));
    return at;
}

/* Who has which setpoint. */
static void pair(struct apc_controller *c)
{
    for (size_t i = c->dim.nu; i-- > 0;) {
        const struct apc_law_ports *p = apc_instances_ports(c->law.instances, i);

        c->state[i].setpoint = p->nz ? p->z[0] : -1;
        for (size_t j = 0; j < p->nz; j++)
            c->above[p->z[j]].loop = i;
    }
}

int apc_controller_name_cascade(struct apc_controller *c, struct apc_sample *at)
{
    struct apc_vector *tick = c->in.vector;
    size_t n = 1;
    int *numbers;

    for (size_t i = 0; i < c->dim.nu; i++)
        n += 1 + c->loop[i].below_peers.n;
    for (size_t k = 0; k < c->dim.nz; k++)
        n += 1 + c->setpoint[k].above_peers.n;
    numbers = c->numbers = calloc(n, sizeof(*numbers));
    if (!numbers)
        return APC_ENOMEM;
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (!c->loop[i].setpoint && !apc_controller_is_selected(c, i))
            continue;
        at = name_below(c, i, at, tick, &numbers);
        tick += c->below[i].who.n;
    }
    for (size_t k = 0; k < c->dim.nz; k++) {
        if (c->setpoint[k].above)
            at = name_above(c, k, at, &numbers);
    }
    pair(c);
    return 0;
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
    const struct apc_sample *actual = b->actual, *newest = apc_controller_output(c, i);
    struct apc_loop_below seen = {.status = actual->status, .value = actual->value, .newest = newest->value};

    if (apc_controller_find_acting(&b->who))
        b->fresh = (struct apc_freshness){.seen = false};
    if (b->who.now < b->who.n) {
        const struct apc_sample *target = &b->target[b->who.now];
        const struct apc_vector *tick = &b->tick[b->who.now];

        seen.cascade = target->seq > 0 && target->value == (double)APC_MODE_CAS;
        seen.fresh = apc_freshness_dated(&b->fresh, tick->seq, tick->time, now,
                                         apc_loss_limit(c->loop[i].below_period));
    }
    b->taken = apc_loop_taken(&seen);
    b->invited = apc_loop_invited(&seen);
    c->blocked[i] = b->taken ? apc_loop_limited(actual->status) : 0u;
    if (b->taken)
        apc_controller_find_in_force(c, i, newest->value);
    else if (actual->seq > 0)
        apc_controller_find_in_force(c, i, actual->value);
}

/* ---- The loop above ------------------------------------------------------------------------ */

static void set_lower_setpoint(struct apc_controller *c, size_t k, double value)
{
    for (size_t row = 0; row < c->size.n_ahead; row++)
        c->z[row * c->dim.nz + k] = value;
}

/* In Man the setpoint is where the measurement is, so that nothing happens when the law has the output again. */
static void follow_measurement(struct apc_controller *c, size_t k)
{
    const struct apc_law_ports *p = apc_instances_ports(c->law.instances, c->above[k].loop);
    const struct apc_controller_setpoint *z = &c->setpoint[k];

    if (p->ny && c->ok[p->y[0]])
        set_lower_setpoint(c, k, fmin(fmax(c->y[p->y[0]], z->low), z->high));
}

/* One that is in shadow says OOS, which nobody asked it for: until it acts, what the former one wrote holds. */
static bool is_able(const struct apc_controller_above *a)
{
    const struct apc_sample *mode = &a->mode[a->who.now];

    if (a->who.now == a->who.n)
        return false;
    return mode->value != (double)APC_MODE_LO &&
           (mode->value != (double)APC_MODE_OOS || (a->who.choice && mode->status == APC_UNCERTAIN));
}

/* In shadow what is in force is what whoever acts says. Returns whether that has said it. */
static bool go_along(struct apc_controller *c, size_t k, const struct apc_sample *newest)
{
    const struct apc_sample *told = &c->told[k];

    if (c->acting || !told->seq || !newest->seq)
        return false;
    set_lower_setpoint(c, k, told->value);
    c->z_seq[k] = newest->seq;
    return true;
}

bool apc_controller_look_above(struct apc_controller *c, size_t k, const struct apc_sample *newest,
                               struct apc_now now)
{
    struct apc_controller_above *a = &c->above[k];
    const struct apc_controller_state *l = &c->state[a->loop];
    struct apc_loop_above seen = {.target = l->target,
                                  .theirs = newest->seq > 0 && newest->origin > 0,
                                  .fresh = apc_freshness_dated(&a->fresh, newest->seq, newest->time, now,
                                                               apc_loss_limit(c->setpoint[k].above_period)),
                                  .origin = newest->origin,
                                  .value = newest->value,
                                  .working = c->z[k]};
    bool takes;

    (void)apc_controller_find_acting(&a->who);
    seen.able = is_able(a);
    a->remote = c->acting && apc_loop_remote(&l->loop, &seen);
    a->put = false;
    if (!c->acting)
        return !go_along(c, k, newest);
    takes = !c->z_seq[k] || apc_loop_takes(&l->loop, &seen);
    a->put = !takes && l->target != APC_MODE_OOS;
    return takes;
}

void apc_controller_own_setpoint(struct apc_controller *c, size_t k, const struct apc_sample *newest)
{
    struct apc_controller_above *a = &c->above[k];

    if (!c->acting || c->state[a->loop].target != APC_MODE_MAN || !newest->seq)
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
