/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The state of a loop, and what it remembers. docs/modes.md has the rules in words and why they are these.
 *
 * A loop asks for its state anew at each tick, of what is the case then. Nothing here waits for an event, so
 * one that was missed, doubled or came in another order cannot leave a wrong state behind.
 */
#include "modules/modules_internal.h"

/* ---- Rules -------------------------------------------------------------------------------- */

enum {
    ACTING = 1 << 0,
    WANTED = 1 << 1, /* there is a target mode that is not OOS */
    MAN = 1 << 2,
    CAS = 1 << 3,
    TAKEN = 1 << 4,
    INPUT = 1 << 5,
    LAW = 1 << 6,
    ANSWER = 1 << 7, /* INPUT and LAW */
    EXPIRED = 1 << 8,
    BACKUP = 1 << 9,
    REMOTE = 1 << 10
};

static const struct rule {
    enum apc_loop_state from; /* 0: any */
    unsigned has, lacks;
    enum apc_loop_state to;
    const char *reason;
} rules[] = {
    {0, 0, ACTING, APC_LOOP_SHADOW, "in shadow: another controller acts"},
    {0, 0, WANTED, APC_LOOP_OOS, NULL},
    {0, 0, TAKEN, APC_LOOP_INIT, "the loop below does not take the output"},
    {0, MAN, 0, APC_LOOP_MAN, NULL},
    {0, EXPIRED | BACKUP, 0, APC_LOOP_BACKUP, "the backup law acts"},
    {0, EXPIRED, 0, APC_LOOP_FAULT, "output at its fault value"},
    {APC_LOOP_BACKUP, BACKUP, ANSWER, APC_LOOP_BACKUP, "the backup law acts"},
    {APC_LOOP_FAULT, 0, ANSWER, APC_LOOP_FAULT, "output at its fault value"},
    {0, 0, INPUT, APC_LOOP_HOLD, "output held"},
    {0, 0, LAW, APC_LOOP_HOLD, "output held"},
    {0, CAS | REMOTE, 0, APC_LOOP_CAS, NULL},
    {0, CAS, 0, APC_LOOP_AUTO, "no setpoint from above"},
    {0, 0, 0, APC_LOOP_AUTO, NULL},
};

#define FOLLOWS (APC_ASK_COMPUTE | APC_ASK_TRACK | APC_ASK_UPDATE)

/* What a loop does in a state, where its inputs are there. */
static const struct {
    enum apc_mode actual;
    enum apc_loop_output output;
    unsigned law, backup;
    apc_status status;
} states[] = {
    [APC_LOOP_OOS] = {APC_MODE_OOS, APC_PUT_NONE, 0, 0, APC_GOOD},
    [APC_LOOP_MAN] = {APC_MODE_MAN, APC_PUT_OPERATOR, APC_ASK_TRACK | APC_ASK_UPDATE, 0, APC_GOOD},
    [APC_LOOP_AUTO] = {APC_MODE_AUTO, APC_PUT_LAW, APC_ASK_COMPUTE | APC_ASK_UPDATE, 0, APC_GOOD},
    [APC_LOOP_CAS] = {APC_MODE_CAS, APC_PUT_LAW, APC_ASK_COMPUTE | APC_ASK_UPDATE, 0, APC_GOOD},
    [APC_LOOP_INIT] = {APC_MODE_IMAN, APC_PUT_BELOW, FOLLOWS, 0, APC_UNCERTAIN_INITIAL},
    [APC_LOOP_HOLD] = {APC_MODE_AUTO, APC_PUT_LAST, FOLLOWS, 0, APC_UNCERTAIN_LAST_USABLE},
    [APC_LOOP_BACKUP] = {APC_MODE_AUTO, APC_PUT_BACKUP, FOLLOWS, APC_ASK_COMPUTE | APC_ASK_UPDATE, APC_GOOD},
    [APC_LOOP_FAULT] = {APC_MODE_LO, APC_PUT_FAULT, FOLLOWS, 0, APC_UNCERTAIN_SUBSTITUTE},
    [APC_LOOP_SHADOW] = {APC_MODE_OOS, APC_PUT_NONE, FOLLOWS, 0, APC_GOOD},
};

static unsigned bits(const struct apc_loop_inputs *f)
{
    bool wanted = f->target == APC_MODE_MAN || f->target == APC_MODE_AUTO || f->target == APC_MODE_CAS;

    return (f->acting ? ACTING : 0u) | (wanted ? WANTED : 0u) | (f->target == APC_MODE_MAN ? MAN : 0u) |
           (f->target == APC_MODE_CAS ? CAS : 0u) | (f->taken ? TAKEN : 0u) | (f->input ? INPUT : 0u) |
           (f->law ? LAW : 0u) | (f->input && f->law ? ANSWER : 0u) | (f->expired ? EXPIRED : 0u) |
           (f->backup ? BACKUP : 0u) | (f->remote ? REMOTE : 0u);
}

/* A loop that asks to be initialised is answered only by one that could act on it then: else it would go to
 * Cas, be shed at once, and ask again, for ever. */
static bool answers_initialisation(const struct apc_loop_inputs *f)
{
    return f->invited && (f->target == APC_MODE_MAN || f->backup || (f->input && f->law && !f->expired));
}

struct apc_loop_move apc_loop_next(enum apc_loop_state state, const struct apc_loop_inputs *inputs)
{
    const struct rule *rule = rules;
    unsigned is = bits(inputs);
    struct apc_loop_move move;

    while ((rule->from && rule->from != state) || (is & rule->has) != rule->has || (is & rule->lacks))
        rule++;
    move = (struct apc_loop_move){.state = rule->to,
                                  .actual = states[rule->to].actual,
                                  .output = states[rule->to].output,
                                  .law = states[rule->to].law,
                                  .backup = states[rule->to].backup,
                                  .status = states[rule->to].status,
                                  .reason = rule->reason};
    if (move.law && !inputs->input)
        move.law = APC_ASK_PREDICT;
    if (move.output == APC_PUT_LAW && state != APC_LOOP_AUTO && state != APC_LOOP_CAS)
        move.law |= APC_ASK_TRACK_FIRST;
    if (move.output == APC_PUT_BACKUP && state != APC_LOOP_BACKUP)
        move.backup |= APC_ASK_TRACK_FIRST;
    if (move.output == APC_PUT_BACKUP && inputs->bare) {
        move.output = APC_PUT_LAST;
        move.backup = 0;
        move.status = APC_UNCERTAIN_LAST_USABLE;
    }
    if ((move.output == APC_PUT_BELOW && !answers_initialisation(inputs)) ||
        (move.output == APC_PUT_FAULT && inputs->setpoint))
        move.output = APC_PUT_NONE;
    return move;
}

/* ---- What a loop remembers ---------------------------------------------------------------- */

bool apc_loop_expired(const struct apc_loop_memory *l, bool input, apc_ns now, apc_ns hold,
                      unsigned shed_after)
{
    return (!input && l->holding && now - l->held >= hold) || l->poor >= shed_after;
}

bool apc_loop_bridges(const struct apc_loop_memory *l, apc_ns now, apc_ns hold)
{
    return l->state == APC_LOOP_BACKUP && !(l->holding && now - l->held >= hold);
}

void apc_loop_answered(struct apc_loop_memory *l, bool good, unsigned shed_after)
{
    bool shed = l->poor >= shed_after;

    if (!good)
        l->poor = shed ? shed_after : l->poor + 1;
    else
        l->poor = shed && l->poor + 1 - shed_after < shed_after ? l->poor + 1 : 0;
}

void apc_loop_settle(struct apc_loop_memory *l, const struct apc_loop_inputs *inputs,
                     enum apc_loop_state state, apc_ns now, int64_t next)
{
    bool cascade = inputs->target == APC_MODE_CAS && state != APC_LOOP_SHADOW;

    if (state == APC_LOOP_BACKUP) {
        if (inputs->bare && !l->holding)
            l->held = now;
        l->holding = inputs->bare;
    } else if (inputs->input || state == APC_LOOP_INIT || state == APC_LOOP_MAN || state == APC_LOOP_OOS ||
               state == APC_LOOP_SHADOW) {
        l->holding = false;
    } else if (state == APC_LOOP_HOLD && !l->holding) {
        l->holding = true;
        l->held = now;
    }
    if (state == APC_LOOP_MAN || state == APC_LOOP_OOS)
        l->poor = 0;
    l->linked = state == APC_LOOP_CAS || (state == APC_LOOP_HOLD && l->linked && inputs->remote);
    if (!cascade || l->linked)
        l->asked = 0;
    else if (!l->asked)
        l->asked = next;
    l->state = state;
}

/* ---- Down a cascade ----------------------------------------------------------------------- */

#define LIMIT_BITS (APC_GOOD_LIMITED_CONSTANT)

bool apc_loop_taken(const struct apc_loop_below *b)
{
    return b->cascade && b->fresh && (b->status & ~LIMIT_BITS) == APC_GOOD;
}

bool apc_loop_invited(const struct apc_loop_below *b)
{
    return b->cascade && b->fresh && (b->status & ~LIMIT_BITS) == APC_UNCERTAIN_INITIAL &&
           b->newest >= b->value && b->newest <= b->value;
}

static bool is_initialisation_answered(const struct apc_loop_memory *l, const struct apc_loop_above *a)
{
    return l->asked && a->origin >= l->asked && a->value >= a->working && a->value <= a->working;
}

bool apc_loop_remote(const struct apc_loop_memory *l, const struct apc_loop_above *a)
{
    return a->target == APC_MODE_CAS && a->theirs && a->fresh && a->able &&
           (l->linked || is_initialisation_answered(l, a));
}

bool apc_loop_takes(const struct apc_loop_memory *l, const struct apc_loop_above *a)
{
    return !a->theirs || apc_loop_remote(l, a);
}

apc_status apc_loop_status(const struct apc_loop_memory *l, enum apc_mode target, unsigned limited)
{
    if (target != APC_MODE_CAS)
        return APC_GOOD_LOCAL_OVERRIDE;
    if (!l->linked)
        return APC_UNCERTAIN_INITIAL;
    if (l->state != APC_LOOP_CAS)
        return APC_GOOD_LIMITED_CONSTANT;
    return (limited & APC_LIMITED_LOW ? APC_GOOD_LIMITED_LOW : APC_GOOD) |
           (limited & APC_LIMITED_HIGH ? APC_GOOD_LIMITED_HIGH : APC_GOOD);
}

unsigned apc_loop_lacks(unsigned limited, double setpoint, double measurement)
{
    if (!limited)
        return 0;
    return measurement < setpoint   ? APC_LIMITED_HIGH
           : measurement > setpoint ? APC_LIMITED_LOW
                                    : APC_LIMITED_LOW | APC_LIMITED_HIGH;
}

unsigned apc_loop_limited(apc_status status)
{
    return ((status & APC_GOOD_LIMITED_LOW) == APC_GOOD_LIMITED_LOW ? APC_LIMITED_LOW : 0u) |
           ((status & APC_GOOD_LIMITED_HIGH) == APC_GOOD_LIMITED_HIGH ? APC_LIMITED_HIGH : 0u);
}
