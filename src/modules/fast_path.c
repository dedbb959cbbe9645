/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Loops with nothing to decide. A loop is on the fast path when its last tick was one in Auto, as the one
 * before, with a good answer of the law, and left nothing to say. As long as nothing but measurements is new to it, what is
 * to be decided would come out as it did: its inputs, its move, its mode, what is told of that and stands of
 * it in the tick row stay as they are. Such a tick asks the law and puts its answer; whatever else happens,
 * even in that answer, makes it one as any other. So it never matters that a loop is on the fast path:
 * test_modules_fast_path.c.
 *
 * Loops of a law that is whole or selects, with a backup, with others above or below, and those that take
 * turns with another controller's are never on it: more is decided of them at each tick.
 */
#include "modules/controller.h"

#include <string.h>

void apc_controller_stir(struct apc_controller *c)
{
    memset(c->fast_path, 0, c->dim.nu * sizeof(*c->fast_path));
    for (size_t k = 0; k < c->dim.nz; k++)
        c->open[k] = true;
    c->untold = c->looking = true;
}

/* Has loop @p i all its measurements and disturbances, and the setpoints that it had? */
static bool has_all_inputs(const struct apc_controller *c, size_t i)
{
    const struct apc_law_ports *p = apc_instances_ports(c->law.instances, i);
    bool has = true;

    for (size_t k = 0; k < p->ny; k++)
        has &= c->ok[p->y[k]];
    for (size_t k = 0; k < p->nd; k++)
        has &= c->ok[c->dim.ny + (size_t)p->d[k]];
    for (size_t k = 0; k < p->nz; k++)
        has &= !c->open[p->z[k]];
    return has;
}

void apc_controller_keep_fast_path(struct apc_controller *c)
{
    const size_t manual = apc_controller_wanted(c, APC_MANUAL);
    const struct apc_sample *const row = &c->in.sample[c->dim.ny + c->dim.nd + manual];
    const int64_t *const looked = c->looked + manual;
    const bool all = !memchr(c->ok, 0, c->dim.ny + c->dim.nd) && !memchr(c->open, 1, c->dim.nz);

    for (size_t i = 0; i < c->dim.nu; i++)
        c->fast_path[i] = c->fast_path[i] && row[i].seq == looked[i] && (all || has_all_inputs(c, i));
}

/* May its loops be on the fast path at all? */
static bool may_use_fast_path(const struct apc_controller *c)
{
    const struct apc_law *law = c->law.definition;

    return !law->whole && !law->selects && !c->backup.definition && !c->choice;
}

/* Does its state lead to itself, with nothing to tell? */
static bool goes_on(const struct apc_controller_state *l)
{
    return l->loop.state == APC_LOOP_AUTO && l->move.law == (APC_ASK_COMPUTE | APC_ASK_UPDATE) &&
           l->note.kind == APC_NOTICE_NONE;
}

static bool answers_well(const struct apc_controller_instance *of)
{
    return of->result == (int)APC_LAW_GOOD && !of->poor && !of->say[0];
}

static bool is_on_fast_path(const struct apc_controller *c, size_t i)
{
    return goes_on(&c->state[i]) && answers_well(&c->law.instance[i]) && !c->loop[i].setpoint &&
           !apc_controller_is_selected(c, i) &&
           apc_controller_is_quiet(c, apc_controller_wanted(c, APC_OPMODE) + i) &&
           apc_controller_is_quiet(c, apc_controller_wanted(c, APC_MANUAL) + i);
}

void apc_controller_leave_fast_path(struct apc_controller *c)
{
    const bool plain = may_use_fast_path(c);

    for (size_t i = 0; plain && i < c->dim.nu; i++) {
        if (!c->fast_path[i])
            c->fast_path[i] = is_on_fast_path(c, i);
    }
}
