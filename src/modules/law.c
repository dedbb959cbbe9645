/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the law is asked, and what goes out. Every output that is not the law's takes the law off its track;
 * before the law's goes out again it is made to go on from the last one (track), so no change of mode, tuning
 * or quality gives a bump.
 */
#include "base/base_internal.h"
#include "modules/controller.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { QUIET = 20 }; /* good answers in a row until an episode of others is over */

/* ---- Asking ------------------------------------------------------------------------------- */

static bool is_backup_law(const struct apc_controller *c, const struct apc_controller_law *law)
{
    return law == &c->backup;
}

/* Of what stays and is not of one instance or call. */
static struct apc_law_call lay_out_law_call(const struct apc_controller *c,
                                            const struct apc_controller_law *law)
{
    return (struct apc_law_call){.size = sizeof(struct apc_law_call),
                                 .dim = c->dim,
                                 .Ts = c->Ts,
                                 .y = c->y,
                                 .z = c->z,
                                 .tuning = law->tuning,
                                 .x = law->x,
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
                                 .published = law->published};
}

void apc_controller_lay_out_calls(struct apc_controller *c)
{
    c->law.call = lay_out_law_call(c, &c->law);
    apc_instances_keep(c->law.instances, &c->law.call);
    if (!c->backup.definition)
        return;
    c->backup.call = lay_out_law_call(c, &c->backup);
    apc_instances_keep(c->backup.instances, &c->backup.call);
}

static void date_law_call(const struct apc_controller *c, struct apc_law_call *call)
{
    call->tick = c->index;
    call->t = c->t;
    call->budget = c->budget;
    call->deadline = c->deadline;
}

void apc_controller_date_calls(struct apc_controller *c)
{
    date_law_call(c, &c->law.call);
    date_law_call(c, &c->backup.call);
}

/* To be used before the next one. */
static struct apc_law_call *instance_law_call(struct apc_controller_law *law, size_t k, double *u,
                                              unsigned *limited)
{
    struct apc_law_call *asked = &law->call;

    asked->u = u;
    asked->limited = limited;
    asked->gap = law->instance[k].gap;
    asked->out = law->decides;
    return asked;
}

/* x to what it is before the first tick. */
static void reset_law_instance(struct apc_controller *c, struct apc_controller_law *law, size_t k)
{
    apc_instances_reset(law->instances, k, instance_law_call(law, k, c->u, c->blocked));
    law->instance[k].begun = true;
    law->instance[k].gap = true;
}

/* The law goes on from @p u of all outputs, where @p decides does not say that it is its own. */
static void track_law_instance(struct apc_controller *c, struct apc_controller_law *law, size_t k, double *u,
                               const enum apc_law_output *decides)
{
    struct apc_law_call *asked = instance_law_call(law, k, u, c->blocked);

    asked->out = decides;
    apc_instances_track(law->instances, k, asked);
    law->instance[k].gap = false;
}

/* Is the law asked what it would do in @p state, were the output its own? In Backup and Fault that says
 * whether it can act again: what is given makes its problem another one, which may be easy. */
static bool is_tried(const struct apc_controller *c, const struct apc_controller_law *law,
                     enum apc_loop_state state)
{
    return !is_backup_law(c, law) &&
           (state == APC_LOOP_SHADOW || state == APC_LOOP_BACKUP || state == APC_LOOP_FAULT);
}

/* Was the output of loop @p i the law's at the tick before? */
static bool put_by(const struct apc_controller *c, const struct apc_controller_law *law, size_t i)
{
    const enum apc_loop_state state = c->state[i].loop.state;

    return is_backup_law(c, law) ? state == APC_LOOP_BACKUP : state == APC_LOOP_AUTO || state == APC_LOOP_CAS;
}

/* Of a signal of which something else was selected, the law goes on from that. */
static inline void update_of(struct apc_controller *c, struct apc_controller_law *law, size_t k, size_t first,
                             size_t nu)
{
    for (size_t i = first; i < first + nu; i++)
        c->went[i] = c->selected && c->below[i].returned && put_by(c, law, i) ? c->below[i].value : c->u[i];
    apc_instances_update(law->instances, k, instance_law_call(law, k, c->went, c->blocked));
    law->instance[k].updating = false;
}

static void update_law_instance(struct apc_controller *c, struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    update_of(c, law, k, part->u, part->nu);
}

/* Does it wait for what is selected of its outputs? */
static bool awaits(const struct apc_controller *c, const struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (apc_controller_is_selected(c, i))
            return true;
    }
    return false;
}

static void update_all(struct apc_controller *c, struct apc_controller_law *law, bool selected)
{
    for (size_t k = 0; k < law->size.instances; k++) {
        if (!law->instance[k].updating)
            continue;
        if (!is_backup_law(c, law) && c->fast_path[k])
            update_of(c, law, k, k, 1);
        else if (selected || !awaits(c, law, k))
            update_law_instance(c, law, k);
    }
}

void apc_controller_update_laws(struct apc_controller *c, bool selected)
{
    update_all(c, &c->law, selected);
    update_all(c, &c->backup, selected);
}

/* @p u within the limits of output @p i, and as near to them as its rate lets it come from the last one.
 * Returns enum apc_limited. */
static unsigned limit(const struct apc_controller *c, size_t i, double *u)
{
    const bool last = c->state[i].there;
    const double low = c->low[i], high = c->high[i], step = c->rate[i] * c->Ts,
                 least = last && !(low > c->u[i] - step) ? c->u[i] - step : low,
                 most = last && !(high < c->u[i] + step) ? c->u[i] + step : high;
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

/* Ask the law for u of @p nu outputs from number @p first on, into trial, within the limits. */
static inline enum apc_law_result compute_of(struct apc_controller *c, struct apc_controller_law *law,
                                             size_t k, size_t first, size_t nu, char why[APC_LAW_WHY])
{
    struct apc_law_call *asked = instance_law_call(law, k, law->trial, law->limited);
    int result;

    asked->budget = law->instance[k].gone ? -1.0 : c->budget;
    asked->why = why;
    asked->say = law->instance[k].say[0] ? NULL : law->instance[k].say;
    asked->y_limited = law->definition->selects && !is_backup_law(c, law) ? c->y_limited : NULL;
    for (size_t i = first; i < first + nu; i++) {
        law->trial[i] = c->u[i]; /* a law that leaves one out keeps it */
        law->limited[i] = c->blocked[i];
    }
    result = apc_instances_compute(law->instances, k, asked);
    asked->budget = c->budget;
    asked->why = asked->say = NULL;
    asked->y_limited = NULL;
    for (size_t i = first; i < first + nu; i++) {
        if (law->decides[i] == APC_OUT_LAW || result > APC_LAW_LATE)
            law->limited[i] |= limit(c, i, &law->trial[i]);
        else
            law->trial[i] = c->u[i];
    }
    return (enum apc_law_result)result;
}

static enum apc_law_result compute_law_instance(struct apc_controller *c, struct apc_controller_law *law,
                                                size_t k, char why[APC_LAW_WHY])
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    return compute_of(c, law, k, part->u, part->nu, why);
}

/* What loop @p i asks of the law, and whether it puts that law's output out. */
static unsigned loop_asks(const struct apc_controller *c, const struct apc_controller_law *law, size_t i)
{
    const struct apc_loop_move *move = &c->state[i].move;

    return is_backup_law(c, law) ? move->backup : move->law;
}

size_t apc_controller_terms(struct apc_controller *c, size_t i, struct apc_law_term *term, size_t most)
{
    const enum apc_loop_output put = c->state[i].move.output;
    struct apc_controller_law *law = put == APC_PUT_BACKUP ? &c->backup : &c->law;

    if (put != APC_PUT_LAW && put != APC_PUT_BACKUP)
        return 0;
    return apc_instances_terms(law->instances, i, &law->call, term, most);
}

static bool goes_out(const struct apc_controller *c, const struct apc_controller_law *law, size_t i)
{
    return c->state[i].move.output == (is_backup_law(c, law) ? APC_PUT_BACKUP : APC_PUT_LAW);
}

/* Which outputs the law decides on, as long as it did not track. One that rested goes on as one that did not
 * act. */
static void decide(struct apc_controller *c, struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    for (size_t i = part->u; i < part->u + part->nu; i++) {
        struct apc_loop_move *move = &c->state[i].move;

        if (is_backup_law(c, law) && goes_out(c, law, i) && law->instance[k].gap) {
            move->backup |= APC_ASK_TRACK_FIRST;
            c->state[i].from = 0; /* at this tick only */
        }
        law->decides[i] = move->state == APC_LOOP_OOS                                          ? APC_OUT_OFF
                          : !goes_out(c, law, i) || loop_asks(c, law, i) & APC_ASK_TRACK_FIRST ? APC_OUT_GIVEN
                                                                                               : APC_OUT_LAW;
    }
}

/* ---- Tuning ------------------------------------------------------------------------------- */

static bool output_differs(const struct apc_controller_law *law, size_t i)
{
    return law->offered[i] < law->tuning[i] || law->offered[i] > law->tuning[i];
}

/* Is parameter @p i one that instance @p k has? */
static bool concerns(const struct apc_controller_law *law, size_t i, size_t k)
{
    const struct apc_law_parameter p = apc_instances_parameter(law->instances, i);
    const struct apc_law_ports *ports = apc_instances_ports(law->instances, k);

    if (law->definition->whole || p.scope == APC_OF_LAW)
        return true;
    for (size_t j = 0; p.scope == APC_OF_MEASUREMENT && j < ports->ny; j++) {
        if ((size_t)ports->y[j] == p.of)
            return true;
    }
    return p.scope == APC_OF_OUTPUT && p.of == k;
}

/* Goes the law's output on from its last one, in some loop of instance @p k? */
static bool on_track(const struct apc_controller *c, const struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (goes_out(c, law, i) && !(loop_asks(c, law, i) & APC_ASK_TRACK_FIRST))
            return law->instance[k].begun;
    }
    return false;
}

static void retune(struct apc_controller *c, struct apc_controller_law *law)
{
    char why[APC_LAW_WHY];
    bool any = false;

    if (!law->offer_new)
        return;
    law->offer_new = false;
    for (size_t i = 0; law->offer_ok && i < law->size.tuning; i++) {
        if (!output_differs(law, i))
            continue;
        any = true;
        for (size_t k = 0; k < law->size.instances; k++)
            law->instance[k].retuned |= concerns(law, i, k);
    }
    if (!any)
        return;
    for (size_t k = 0; k < law->size.instances; k++) {
        decide(c, law, k);
        law->instance[k].retuned = law->instance[k].retuned && law->definition->track &&
                                   on_track(c, law, k) &&
                                   compute_law_instance(c, law, k, why) <= APC_LAW_LATE;
    }
    memcpy(law->tuning, law->offered, law->size.tuning * sizeof(*law->tuning));
    for (size_t k = 0; k < law->size.instances; k++) {
        if (law->instance[k].retuned)
            track_law_instance(c, law, k, law->trial, c->given);
        law->instance[k].retuned = false;
    }
}

/* The law's output with the tuning in force, then a state from which the new tuning gives the same. */
void apc_controller_retune(struct apc_controller *c)
{
    retune(c, &c->law);
    retune(c, &c->backup);
}

/* ---- Going on from a former run ----------------------------------------------------------- */

/*
 * When the plant still follows the last output, run the update that the former run ran, or was killed before
 * running: the law then goes on as if nothing had happened. If that output does not follow from its x with
 * the tuning of today (tuned meanwhile), the law tracks it first.
 */
static void settle_instance(struct apc_controller *c, struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);
    double *const u = c->u;
    char why[APC_LAW_WHY];
    bool any = false, own = false, follows = true;

    for (size_t i = part->u; i < part->u + part->nu; i++) {
        const bool asked = put_by(c, law, i) || is_tried(c, law, c->state[i].loop.state);

        law->decides[i] = asked ? APC_OUT_LAW : APC_OUT_GIVEN;
        any |= asked;
        own |= put_by(c, law, i);
    }
    c->u = c->last; /* as it was when the law was asked */
    if (any)
        follows = compute_law_instance(c, law, k, why) <= APC_LAW_LATE || !own;
    c->u = u;
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        follows &= !put_by(c, law, i) || (law->trial[i] >= u[i] && law->trial[i] <= u[i]);
        if (!put_by(c, law, i))
            law->decides[i] = APC_OUT_GIVEN;
    }
    if (!follows)
        track_law_instance(c, law, k, c->u, c->given);
    update_law_instance(c, law, k);
}

static void settle_law(struct apc_controller *c, struct apc_controller_law *law, bool follows)
{
    for (size_t k = 0; k < law->size.instances; k++) {
        if (!follows)
            law->instance[k].gap = true;
        else if (law->instance[k].updating)
            settle_instance(c, law, k);
        law->instance[k].updating = false;
    }
}

void apc_controller_settle(struct apc_controller *c, struct apc_now now)
{
    const apc_ns age = now.utc - c->resumed_at;
    const bool follows = age >= 0 && age <= c->loss; /* below 0 the clock was set back: nobody knows */

    c->resumed_at = 0;
    for (size_t i = 0; i < c->dim.nu; i++) {
        struct apc_controller_state *l = &c->state[i];

        if (!follows && (put_by(c, &c->law, i) || put_by(c, &c->backup, i)))
            l->loop.state = APC_LOOP_INIT;
        if (!follows) {
            l->loop.linked = false;
            l->loop.asked = 0;
        }
        l->loop.held = l->since = now.mono - l->loop.held - (age > 0 ? age : 0);
    }
    settle_law(c, &c->law, follows);
    settle_law(c, &c->backup, follows);
}

/* ---- What goes out ------------------------------------------------------------------------ */

static void put_out(struct apc_controller *c, size_t i, double u)
{
    c->u[i] = u;
    c->state[i].there = true;
}

/* A calculated signal stays where it is, and is Bad. */
static void put_fault(struct apc_controller *c, size_t i)
{
    if (!c->loop[i].signal)
        put_out(c, i, c->loop[i].fault);
}

/* The outputs that are not the law's. */
static void place_outputs(struct apc_controller *c, size_t i, apc_ns utc, bool have,
                          struct apc_notice *notice)
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
        put_fault(c, i);
    }
}

/* The law failed, or found nothing: then the output is held. */
static void refuse_answer(struct apc_controller *c, size_t i, enum apc_law_result result, const char *why)
{
    struct apc_controller_state *l = &c->state[i];

    if (!l->inputs.input)
        return;
    l->inputs.law = false;
    l->move = apc_loop_next(l->loop.state, &l->inputs);
    l->move.law &= ~(unsigned)APC_ASK_COMPUTE;
    snprintf(l->trouble, sizeof(l->trouble), "law %.20s%s %.95s", c->law.definition->name, why[0] ? ":" : "",
             why[0]                     ? why
             : result == APC_LAW_FAILED ? "failed"
                                        : "found nothing feasible");
}

/* So did the backup law: for a while that is bridged, too. */
static void refuse_backup(struct apc_controller *c, size_t i, struct apc_now now)
{
    struct apc_controller_state *l = &c->state[i];

    if (!(l->move.backup & APC_ASK_COMPUTE))
        return;
    l->inputs.bare = true;
    l->inputs.backup = apc_loop_bridges(&l->loop, apc_controller_punctual(c, i, now.mono), c->loop[i].hold);
    l->move = apc_loop_next(l->loop.state, &l->inputs);
    snprintf(l->trouble, sizeof(l->trouble), "backup law %.20s gave no output", c->backup.definition->name);
}

/* An answer of instance @p k that cannot be used. */
static void refuse_all(struct apc_controller *c, struct apc_controller_law *law, size_t k,
                       enum apc_law_result result, struct apc_now now)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    if (!is_backup_law(c, law) && !c->failed) {
        c->failures++;
        c->failed = true;
    }
    if (result == APC_LAW_FAILED)
        reset_law_instance(c, law, k);
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        law->decides[i] = APC_OUT_GIVEN;
        if (is_backup_law(c, law))
            refuse_backup(c, i, now);
        else
            refuse_answer(c, i, result, law->instance[k].why);
    }
}

/* Ask the law, and count how good its answers are. Returns whether this one can be used. */
static inline bool ask_of(struct apc_controller *c, struct apc_controller_law *law, size_t k, size_t first,
                          size_t nu, struct apc_now now)
{
    struct apc_controller_instance *of = &law->instance[k];
    const enum apc_law_result result = compute_of(c, law, k, first, nu, of->why);

    of->result = (int)result;
    of->answered = result <= APC_LAW_LATE;
    of->good = result == APC_LAW_GOOD ? of->good + 1 : 0;
    for (size_t i = first; i < first + nu && !is_backup_law(c, law); i++) {
        if (c->fast_path[i] && result == APC_LAW_GOOD) /* none was poor, and none is */
            continue;
        if (c->state[i].move.law & APC_ASK_COMPUTE)
            apc_loop_answered(&c->state[i].loop, result <= APC_LAW_SUBOPTIMAL, c->shed_after);
    }
    if (!of->answered)
        refuse_all(c, law, k, result, now);
    return of->answered;
}

static bool ask_law(struct apc_controller *c, struct apc_controller_law *law, size_t k, struct apc_now now)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);

    return ask_of(c, law, k, part->u, part->nu, now);
}

/* ---- What came to pass --------------------------------------------------------------------- */

static bool is_out_of_service(enum apc_loop_state state)
{
    return state == APC_LOOP_HOLD || state == APC_LOOP_BACKUP || state == APC_LOOP_FAULT;
}

static void tell_of_loop(struct apc_controller *c, size_t i, apc_ns now, struct apc_notice *notice)
{
    struct apc_controller_state *l = &c->state[i];
    const enum apc_loop_state before = l->loop.state, state = l->move.state;

    if (is_out_of_service(state) && !is_out_of_service(before))
        l->since = now;
    if (state == APC_LOOP_FAULT && before != APC_LOOP_FAULT)
        apc_controller_note(c, i, notice, APC_NOTICE_FAULT, "%s: %s", l->move.reason, l->trouble);
    else if ((state == APC_LOOP_HOLD || state == APC_LOOP_BACKUP) && state != before)
        apc_controller_note(c, i, notice, l->inputs.law ? APC_NOTICE_HOLD : APC_NOTICE_REJECTED, "%s: %s",
                            l->move.reason, l->trouble);
    else if (is_out_of_service(before) && l->move.output == APC_PUT_LAW)
        apc_controller_note(c, i, notice, APC_NOTICE_RECOVERED,
                            before == APC_LOOP_BACKUP ? "the law acts again after %.6g s"
                                                      : "inputs good again after %.6g s",
                            apc_ns_to_s(now - l->since));
    if (l->move.actual != l->actual || (state == APC_LOOP_SHADOW && before != APC_LOOP_SHADOW))
        apc_controller_note(c, i, notice, APC_NOTICE_MODE, "mode %s%s%s", apc_mode_name((int)l->move.actual),
                            l->move.reason ? ": " : "", l->move.reason ? l->move.reason : "");
    l->actual = l->move.actual;
}

/* An answer that is usable but not good is told once, and its end when it has been good for a while, which is
 * no shorter than what ends a shedding: at the edge of what can be reached it goes to and fro. */
static void tell_answer(struct apc_controller *c, size_t k, struct apc_notice *notice)
{
    const unsigned a_while = c->shed_after > QUIET ? c->shed_after : QUIET;
    const struct apc_instance_part *part = apc_instances_part(c->law.instances, k);
    struct apc_controller_instance *of = &c->law.instance[k];
    const bool poor = of->result == (int)APC_LAW_SUBOPTIMAL || of->result == (int)APC_LAW_LATE;

    if (!notice || poor == of->poor || (!poor && of->good < a_while))
        return;
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        apc_controller_note(c, i, notice, APC_NOTICE_POOR, "law %.20s: %s", c->law.definition->name,
                            poor ? of->why : "good again");
        if (c->state[part->u].note.kind != APC_NOTICE_POOR)
            return; /* the first had graver news: the next tick tells this, of all */
    }
    of->poor = poor;
}

/* As soon as there is no graver news. */
static void tell_law_said(struct apc_controller *c, struct apc_controller_law *law, size_t k,
                          struct apc_notice *notice)
{
    const size_t i = apc_instances_part(law->instances, k)->u;
    char *const say = law->instance[k].say;

    if (!notice || !say[0])
        return;
    apc_controller_note(c, i, notice, APC_NOTICE_SAID, "law %.20s: %s", law->definition->name, say);
    if (c->state[i].note.kind == APC_NOTICE_SAID)
        say[0] = '\0';
}

/* ---- An instance and its loops --------------------------------------------------------------- */

/* What any of its loops asks of the law. */
static unsigned asked(const struct apc_controller *c, const struct apc_controller_law *law,
                      const struct apc_instance_part *part)
{
    unsigned all = 0;

    for (size_t i = part->u; i < part->u + part->nu; i++)
        all |= loop_asks(c, law, i);
    return all & ~(unsigned)APC_ASK_PREDICT;
}

static bool any_there(const struct apc_controller *c, const struct apc_instance_part *part)
{
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (c->state[i].there)
            return true;
    }
    return false;
}

/* Is it known of each of its outputs what acts? A cascade says so with its first answer. */
static bool all_there(const struct apc_controller *c, const struct apc_instance_part *part)
{
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (!c->state[i].there)
            return false;
    }
    return true;
}

/* Ask instance @p k for what its loops want of it. */
static void run_law_instance(struct apc_controller *c, struct apc_controller_law *law, size_t k,
                             struct apc_now now)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);
    unsigned all;
    bool answered = false;

    decide(c, law, k);
    all = asked(c, law, part);
    if (all && !law->instance[k].begun)
        reset_law_instance(c, law, k);
    if ((all & APC_ASK_TRACK_FIRST) && any_there(c, part))
        track_law_instance(c, law, k, c->u, law->decides);
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (goes_out(c, law, i) || is_tried(c, law, c->state[i].move.state))
            law->decides[i] = APC_OUT_LAW;
    }
    if (all & APC_ASK_COMPUTE)
        answered = ask_law(c, law, k, now);
    for (size_t i = part->u; i < part->u + part->nu; i++) {
        if (!is_backup_law(c, law))
            c->state[i].would = answered ? law->trial[i] : (double)NAN;
        if (is_tried(c, law, c->state[i].move.state))
            law->decides[i] = APC_OUT_GIVEN;
    }
}

/* Ask the law of loop @p i, on the fast path, which is its instance as well, and put out what it says.
 * Returns whether that is all there is to it: else the answer is to be dealt with as any other. */
static bool run_fast_path(struct apc_controller *c, size_t i, struct apc_now now)
{
    struct apc_controller_instance *of = &c->law.instance[i];

    if (!ask_of(c, &c->law, i, i, 1, now) || of->result != (int)APC_LAW_GOOD || of->say[0])
        return false;
    c->u[i] = c->law.trial[i];
    of->updating = true;
    return true;
}

/* What goes out of loop @p i is known, and with it its state. */
static void finish_loop(struct apc_controller *c, size_t i, struct apc_now now, struct apc_notice *notice)
{
    struct apc_controller_state *l = &c->state[i];

    if (goes_out(c, &c->law, i))
        put_out(c, i, c->law.trial[i]);
    if (goes_out(c, &c->backup, i))
        put_out(c, i, c->backup.trial[i]);
    if (l->move.output == APC_PUT_FAULT) /* also where an answer was refused */
        put_fault(c, i);
    tell_of_loop(c, i, now.mono, notice);
    apc_loop_settle(&l->loop, &l->inputs, l->move.state, now.mono,
                    apc_controller_is_below(c, i) ? c->actual[l->setpoint].seq + 1 : 0);
}

/* The law after what goes out is known. */
static void follow_outputs(struct apc_controller *c, struct apc_controller_law *law, size_t k)
{
    const struct apc_instance_part *part = apc_instances_part(law->instances, k);
    struct apc_controller_instance *of = &law->instance[k];
    const unsigned all = asked(c, law, part);
    const bool known = all_there(c, part);

    if ((all & APC_ASK_TRACK) && of->begun && any_there(c, part))
        track_law_instance(c, law, k, c->u, law->decides);
    if (of->answered && known)
        of->gap = false;
    if (!(all & (APC_ASK_TRACK | APC_ASK_COMPUTE)))
        of->gap = true;
    /* A law that cannot track would wind up where its output does not go out. */
    of->updating =
        (all & APC_ASK_UPDATE) && of->begun && known && (!(all & APC_ASK_TRACK) || law->definition->track);
}

/* All that is told of loops and answers, but for those on the fast path. */
static void tell_all_loops(struct apc_controller *c, struct apc_notice *notice)
{
    for (size_t k = 0; k < c->law.size.instances; k++) {
        if (!c->fast_path[k])
            tell_answer(c, k, notice);
    }
    for (size_t k = 0; k < c->law.size.instances; k++) {
        if (!c->fast_path[k])
            tell_law_said(c, &c->law, k, notice);
    }
    for (size_t k = 0; k < c->backup.size.instances; k++)
        tell_law_said(c, &c->backup, k, notice);
}

void apc_controller_run(struct apc_controller *c, struct apc_now now, bool have, struct apc_notice *notice)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (!c->fast_path[i])
            place_outputs(c, i, now.utc, have, notice);
    }
    for (size_t k = 0; k < c->law.size.instances; k++) {
        if (c->fast_path[k])
            c->fast_path[k] = run_fast_path(c, k, now);
        else
            run_law_instance(c, &c->law, k, now);
    }
    for (size_t k = 0; k < c->backup.size.instances; k++)
        run_law_instance(c, &c->backup, k, now);
    if (!memchr(c->fast_path, 0, c->dim.nu))
        return;
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (!c->fast_path[i])
            finish_loop(c, i, now, notice);
    }
    tell_all_loops(c, notice);
    for (size_t k = 0; k < c->law.size.instances; k++) {
        if (!c->fast_path[k])
            follow_outputs(c, &c->law, k);
    }
    for (size_t k = 0; k < c->backup.size.instances; k++)
        follow_outputs(c, &c->backup, k);
}
