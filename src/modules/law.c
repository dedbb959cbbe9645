/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the law is asked, and what goes out. Every output that is not the law's takes the law off its track;
 * before the law's goes out again it is made to go on from the last one (track), so no change of mode, tuning
 * or quality gives a bump.
 */
#include "base/base_internal.h"
#include "modules/controller.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- Asking ------------------------------------------------------------------------------- */

static struct apc_law_call call(struct apc_controller *c, size_t k, double *u, unsigned *limited)
{
    return (struct apc_law_call){.size = sizeof(struct apc_law_call),
                                 .dim = c->dim,
                                 .Ts = c->Ts,
                                 .y = c->y,
                                 .z = c->z,
                                 .tuning = c->tuning,
                                 .x = c->x,
                                 .u = u,
                                 .limited = limited,
                                 .gap = c->instance[k].gap,
                                 .tick = c->index,
                                 .t = c->t,
                                 .y_status = c->y_status,
                                 .y_age = c->y_age,
                                 .y_new = c->y_new,
                                 .d = c->d,
                                 .n_ahead = c->size.n_ahead,
                                 .low = c->low,
                                 .high = c->high,
                                 .rate = c->rate,
                                 .y_low = c->y_low,
                                 .y_high = c->y_high,
                                 .u_last = c->last,
                                 .out = c->decides,
                                 .published = c->size.published ? c->published : NULL,
                                 .budget = c->budget,
                                 .deadline = c->deadline};
}

/* x to what it is before the first tick. */
static void reset(struct apc_controller *c, size_t k)
{
    const struct apc_law_call law = call(c, k, c->u, c->blocked);

    apc_instances_reset(c->law, k, &law);
    c->instance[k].begun = true;
    c->instance[k].gap = true;
}

/* The law goes on from @p u of all outputs, where @p decides does not say that it is its own. */
static void track(struct apc_controller *c, size_t k, double *u, const enum apc_law_output *decides)
{
    struct apc_law_call law = call(c, k, u, c->blocked);

    law.out = decides;
    apc_instances_track(c->law, k, &law);
    c->instance[k].gap = false;
}

void apc_controller_update_instance(struct apc_controller *c, size_t k)
{
    const struct apc_law_call law = call(c, k, c->u, c->blocked);

    apc_instances_update(c->law, k, &law);
    c->instance[k].updating = false;
}

/* @p u within the limits of output @p i, and as near to them as its rate lets it come from the last one.
 * Returns enum apc_limited. */
static unsigned limit(const struct apc_controller *c, size_t i, double *u)
{
    const bool last = c->state[i].there;
    const double least = last ? fmax(c->low[i], c->u[i] - c->rate[i] * c->Ts) : c->low[i],
                 most = last ? fmin(c->high[i], c->u[i] + c->rate[i] * c->Ts) : c->high[i];
    unsigned limited = 0;

    if (*u < least) {
        *u = least;
        limited |= APC_LIMITED_LOW;
    }
    if (*u > most) {
        *u = most;
        limited |= APC_LIMITED_HIGH;
    }
    return limited;
}

/* Ask the law for u, into trial, within the limits. */
static enum apc_law_result compute(struct apc_controller *c, size_t k, char why[APC_LAW_WHY])
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);
    const size_t end = part.u + part.nu;
    struct apc_law_call law = call(c, k, c->trial, c->limited);
    int result;

    law.why = why;
    for (size_t i = part.u; i < end; i++) {
        c->trial[i] = c->u[i]; /* a law that leaves one out keeps it */
        c->limited[i] = c->blocked[i];
    }
    result = apc_instances_compute(c->law, k, &law);
    for (size_t i = part.u; i < end; i++) {
        if (c->decides[i] == APC_OUT_LAW || result > APC_LAW_LATE)
            c->limited[i] |= limit(c, i, &c->trial[i]);
        else
            c->trial[i] = c->u[i];
    }
    return (enum apc_law_result)result;
}

/* ---- Tuning ------------------------------------------------------------------------------- */

static bool differs(const struct apc_controller *c, size_t i)
{
    return c->offered[i] < c->tuning[i] || c->offered[i] > c->tuning[i];
}

/* Is parameter @p i one that instance @p k has? */
static bool concerns(const struct apc_controller *c, size_t i, size_t k)
{
    const struct apc_law_parameter p = apc_instances_parameter(c->law, i);
    const struct apc_law_ports *ports = apc_instances_ports(c->law, k);

    if (c->whole || p.scope == APC_OF_LAW)
        return true;
    for (size_t j = 0; p.scope == APC_OF_MEASUREMENT && j < ports->ny; j++) {
        if ((size_t)ports->y[j] == p.of)
            return true;
    }
    return p.scope == APC_OF_OUTPUT && p.of == k;
}

/* Goes the law's output on from its last one, in some loop of instance @p k? */
static bool on_track(const struct apc_controller *c, size_t k)
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);

    for (size_t i = part.u; i < part.u + part.nu; i++) {
        const struct apc_loop_move *move = &c->state[i].move;

        if (move->output == APC_PUT_LAW && !(move->law & APC_ASK_TRACK_FIRST))
            return c->instance[k].begun;
    }
    return false;
}

/* The law's output with the tuning in force, then a state from which the new tuning gives the same. */
void apc_controller_retune(struct apc_controller *c)
{
    char why[APC_LAW_WHY];
    bool any = false;

    for (size_t i = 0; c->offer_ok && i < c->size.tuning; i++) {
        if (!differs(c, i))
            continue;
        any = true;
        for (size_t k = 0; k < c->size.instances; k++)
            c->instance[k].retuned |= concerns(c, i, k);
    }
    if (!any)
        return;
    for (size_t k = 0; k < c->size.instances; k++)
        c->instance[k].retuned = c->instance[k].retuned && c->definition->track && on_track(c, k) &&
                                 compute(c, k, why) <= APC_LAW_LATE;
    memcpy(c->tuning, c->offered, c->size.tuning * sizeof(*c->tuning));
    for (size_t k = 0; k < c->size.instances; k++) {
        if (c->instance[k].retuned)
            track(c, k, c->trial, c->given);
        c->instance[k].retuned = false;
    }
}

/* ---- Going on from a former run ----------------------------------------------------------- */

/*
 * When the plant still follows the last output, run the update that the former run ran, or was killed before
 * running: the law then goes on as if nothing had happened. If that output does not follow from its x with
 * the tuning of today (tuned meanwhile), the law tracks it first.
 */
static void settle_instance(struct apc_controller *c, size_t k)
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);
    double *const u = c->u;
    char why[APC_LAW_WHY];
    bool law = false, follows = true;

    for (size_t i = part.u; i < part.u + part.nu; i++) {
        const bool own = c->state[i].loop.state == APC_LOOP_AUTO || c->state[i].loop.state == APC_LOOP_CAS;

        c->decides[i] = own ? APC_OUT_LAW : APC_OUT_GIVEN;
        law |= own;
    }
    c->u = c->last; /* as it was when the law was asked */
    if (law)
        follows = compute(c, k, why) <= APC_LAW_LATE;
    c->u = u;
    for (size_t i = part.u; i < part.u + part.nu; i++)
        follows &= c->decides[i] != APC_OUT_LAW || (c->trial[i] >= u[i] && c->trial[i] <= u[i]);
    if (!follows)
        track(c, k, c->u, c->given);
    apc_controller_update_instance(c, k);
}

void apc_controller_settle(struct apc_controller *c, struct apc_now now)
{
    const apc_ns age = now.utc - c->resumed_at;
    const bool follows = age >= 0 && age <= c->loss; /* below 0 the clock was set back: nobody knows */

    c->resumed_at = 0;
    for (size_t i = 0; i < c->dim.nu; i++) {
        struct apc_controller_state *l = &c->state[i];

        if (!follows && (l->loop.state == APC_LOOP_AUTO || l->loop.state == APC_LOOP_CAS))
            l->loop.state = APC_LOOP_INIT;
        if (!follows) {
            l->loop.linked = false;
            l->loop.asked = 0;
        }
        l->loop.held = l->since = now.mono - l->loop.held - (age > 0 ? age : 0);
    }
    for (size_t k = 0; k < c->size.instances; k++) {
        if (!follows)
            c->instance[k].gap = true;
        else if (c->instance[k].updating)
            settle_instance(c, k);
        c->instance[k].updating = false;
    }
}

/* ---- What goes out ------------------------------------------------------------------------ */

static void put_out(struct apc_controller *c, size_t i, double u)
{
    c->u[i] = u;
    c->state[i].there = true;
}

/* The outputs that are not the law's. */
static void place(struct apc_controller *c, size_t i, apc_ns utc, bool have, struct apc_notice *notice)
{
    struct apc_controller_state *l = &c->state[i];
    double u;

    if (l->move.output == APC_PUT_OPERATOR) {
        if (!l->there)
            put_out(c, i, c->loop[i].fault);
        if (l->loop.state != APC_LOOP_MAN)
            l->wanted = c->u[i];
    }
    if (have)
        apc_controller_take_manual(c, i, utc, notice);
    if (l->move.output == APC_PUT_OPERATOR) {
        u = l->wanted;
        (void)limit(c, i, &u);
        put_out(c, i, u);
    } else if (l->move.output == APC_PUT_FAULT) {
        put_out(c, i, c->loop[i].fault);
    }
}

/* The law failed, or found nothing: then it is held, and begins anew. */
static void refuse_answer(struct apc_controller *c, size_t k, enum apc_law_result result, const char *why)
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);

    if (!c->failed)
        c->failures++;
    c->failed = true;
    if (result == APC_LAW_FAILED)
        reset(c, k);
    for (size_t i = part.u; i < part.u + part.nu; i++) {
        struct apc_controller_state *l = &c->state[i];

        if (!l->facts.input)
            continue;
        l->facts.law = false;
        l->move = apc_loop_next(l->loop.state, &l->facts);
        l->move.law &= ~(unsigned)APC_ASK_COMPUTE;
        c->decides[i] = APC_OUT_GIVEN;
        snprintf(l->trouble, sizeof(l->trouble), "law %.20s %.95s (%" PRIu64 ")", c->definition->name,
                 why[0]                     ? why
                 : result == APC_LAW_FAILED ? "failed"
                                            : "found nothing feasible",
                 c->failures);
    }
}

/* Ask the law, and count how good its answers are. Returns whether this one can be used. */
static bool ask(struct apc_controller *c, size_t k)
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);
    char why[APC_LAW_WHY] = "";
    const enum apc_law_result result = compute(c, k, why);

    c->instance[k].result = (int)result;
    for (size_t i = part.u; i < part.u + part.nu; i++) {
        if (c->state[i].move.law & APC_ASK_COMPUTE)
            apc_loop_answered(&c->state[i].loop, result <= APC_LAW_SUBOPTIMAL, c->shed_after);
    }
    c->instance[k].answered = result <= APC_LAW_LATE;
    if (c->instance[k].answered)
        return true;
    refuse_answer(c, k, result, why);
    return false;
}

/* ---- What came to pass --------------------------------------------------------------------- */

static bool is_away(enum apc_loop_state state)
{
    return state == APC_LOOP_HOLD || state == APC_LOOP_BACKUP || state == APC_LOOP_FAULT;
}

static void tell(struct apc_controller *c, size_t i, apc_ns now, struct apc_notice *notice)
{
    struct apc_controller_state *l = &c->state[i];
    const enum apc_loop_state before = l->loop.state, state = l->move.state;

    if (is_away(state) && !is_away(before))
        l->since = now;
    if (state == APC_LOOP_FAULT && before != APC_LOOP_FAULT)
        apc_controller_note(c, i, notice, APC_NOTICE_FAULT, "%s: %s", l->move.reason, l->trouble);
    else if (state == APC_LOOP_HOLD && before != APC_LOOP_HOLD)
        apc_controller_note(c, i, notice, l->facts.law ? APC_NOTICE_HOLD : APC_NOTICE_REJECTED, "%s: %s",
                            l->move.reason, l->trouble);
    else if (is_away(before) && l->move.output == APC_PUT_LAW)
        apc_controller_note(c, i, notice, APC_NOTICE_RECOVERED, "inputs good again after %.3f s",
                            apc_ns_to_s(now - l->since));
    if (l->move.actual != l->actual || (state == APC_LOOP_SHADOW && before != APC_LOOP_SHADOW))
        apc_controller_note(c, i, notice, APC_NOTICE_MODE, "mode %s%s%s", apc_mode_name((int)l->move.actual),
                            l->move.reason ? ": " : "", l->move.reason ? l->move.reason : "");
    l->actual = l->move.actual;
}

/* ---- An instance and its loops --------------------------------------------------------------- */

/* What any of its loops asks of the law. */
static unsigned asked(const struct apc_controller *c, struct apc_instance_part part)
{
    unsigned all = 0;

    for (size_t i = part.u; i < part.u + part.nu; i++)
        all |= c->state[i].move.law;
    return all & ~(unsigned)APC_ASK_PREDICT;
}

static bool any_there(const struct apc_controller *c, struct apc_instance_part part)
{
    for (size_t i = part.u; i < part.u + part.nu; i++) {
        if (c->state[i].there)
            return true;
    }
    return false;
}

static bool in_shadow(const struct apc_controller *c, size_t i)
{
    return c->state[i].move.state == APC_LOOP_SHADOW;
}

/* The law after what goes out is known. */
static void follow(struct apc_controller *c, size_t k, struct apc_instance_part part, bool answered)
{
    struct apc_controller_instance *of = &c->instance[k];
    const unsigned all = asked(c, part);

    if ((all & APC_ASK_TRACK) && of->begun && any_there(c, part))
        track(c, k, c->u, c->decides);
    if (answered)
        of->gap = false;
    if (!(all & (APC_ASK_TRACK | APC_ASK_COMPUTE)))
        of->gap = true;
    /* A law that cannot track would wind up where its output does not go out. */
    of->updating = (all & APC_ASK_UPDATE) && of->begun && (!(all & APC_ASK_TRACK) || c->definition->track);
}

void apc_controller_run(struct apc_controller *c, size_t k, struct apc_now now, bool have,
                        struct apc_notice *notice)
{
    const struct apc_instance_part part = apc_instances_part(c->law, k);
    const unsigned all = asked(c, part);
    bool answered = false;

    for (size_t i = part.u; i < part.u + part.nu; i++)
        place(c, i, now.utc, have, notice);
    if (all && !c->instance[k].begun)
        reset(c, k);
    if ((all & APC_ASK_TRACK_FIRST) && any_there(c, part))
        track(c, k, c->u, c->decides);
    for (size_t i = part.u; i < part.u + part.nu; i++) {
        if (c->state[i].move.output == APC_PUT_LAW || in_shadow(c, i))
            c->decides[i] = APC_OUT_LAW;
    }
    if (all & APC_ASK_COMPUTE)
        answered = ask(c, k);
    for (size_t i = part.u; i < part.u + part.nu; i++) {
        struct apc_controller_state *l = &c->state[i];

        l->would = answered ? c->trial[i] : (double)NAN;
        if (in_shadow(c, i))
            c->decides[i] = APC_OUT_GIVEN;
        if (l->move.output == APC_PUT_LAW)
            put_out(c, i, c->trial[i]);
        if (l->move.output == APC_PUT_FAULT) /* only after the answer was refused */
            put_out(c, i, c->loop[i].fault);
        tell(c, i, now.mono, notice);
        apc_loop_settle(&l->loop, &l->facts, l->move.state, now.mono,
                        apc_controller_is_below(c, i) ? c->actual[l->setpoint].seq + 1 : 0);
    }
    follow(c, k, part, answered);
}
