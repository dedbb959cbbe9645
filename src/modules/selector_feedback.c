/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What becomes of a calculated signal where it goes. A law that selects tells whoever calculates its inputs,
 * by a row of table actual, what went out in the end and which way an input cannot move that (external
 * reset). Whoever calculates one looks at that row before its next tick, and its law then goes on, in the
 * update of the tick before, from what was selected: so the law of a loop that lost neither winds up nor
 * follows so closely that it could never win.
 */
#include "modules/controller.h"

#include <math.h>

/* ---- The one that selects ------------------------------------------------------------------ */

/* The first loop that takes measurement @p k; false: none does. */
static bool find_taker(const struct apc_controller *c, size_t k, size_t *loop)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_law_ports *p = apc_instances_ports(c->law.instances, i);

        for (size_t j = 0; j < p->ny; j++) {
            if ((size_t)p->y[j] == k) {
                *loop = i;
                return true;
            }
        }
    }
    return false;
}

size_t apc_controller_find_inputs(struct apc_controller *c, const bool *told)
{
    for (size_t k = 0; told && c->law.definition->selects && k < c->dim.ny; k++) {
        struct apc_controller_input *in = &c->input[c->n_inputs];

        if (told[k] && find_taker(c, k, &in->loop)) {
            in->y = k;
            c->n_inputs++;
        }
    }
    return c->n_inputs;
}

void apc_controller_tell_inputs(struct apc_controller *c)
{
    for (size_t k = 0; k < c->n_inputs; k++) {
        const struct apc_controller_input *in = &c->input[k];
        const size_t i = in->loop;
        const struct apc_controller_state *l = &c->state[i];
        const bool acts = l->move.output == APC_PUT_LAW && c->law.instance[i].answered;
        struct apc_sample *s = &c->actual[c->n_wanted + k];

        /* what was selected of its own output holds for its inputs, too */
        s->value = acts && c->below[i].returned ? c->below[i].value : c->u[i];
        s->status =
            acts ? apc_controller_limited(c->law.limited[i] | c->y_limited[in->y]) : APC_GOOD_LOCAL_OVERRIDE;
        s->origin = l->there ? c->y_seq[in->y] : 0;
    }
}

/* ---- Those whose outputs are selected ------------------------------------------------------ */

void apc_controller_look_at_selected(struct apc_controller *c, bool have, struct apc_now now)
{
    for (size_t i = 0; c->selected && i < c->dim.nu; i++) {
        struct apc_controller_below *b = &c->below[i];
        const struct apc_sample *s = b->actual;
        const struct apc_vector *tick;
        bool fresh;

        if (!apc_controller_is_selected(c, i))
            continue;
        if (have && apc_controller_find_acting(&b->who))
            b->fresh = (struct apc_freshness){.seen = false};
        tick = &b->tick[b->who.now < b->who.n ? b->who.now : 0];
        fresh = have && b->who.now < b->who.n &&
                apc_freshness_dated(&b->fresh, tick->seq, tick->time, now,
                                    apc_loss_limit(c->loop[i].below_period));
        b->returned = fresh && s->seq > 0 && apc_status_severity(s->status) != APC_SEVERITY_BAD;
        b->taken = !b->returned || s->status != APC_GOOD_LOCAL_OVERRIDE;
        b->invited = !b->taken;
        b->value = fmin(fmax(s->value, c->low[i]), c->high[i]);
        c->blocked[i] = !b->taken     ? APC_LIMITED_LOW | APC_LIMITED_HIGH
                        : b->returned ? apc_loop_limited(s->status)
                                      : 0u;
    }
}
