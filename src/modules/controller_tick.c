/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One tick of the controller.
 *
 * target mode  what goes out                                        actual mode
 * Auto         what the law computes                                Auto
 *              last output, while the measurement is unusable        Auto, "held"
 *              fault value, when that lasts longer than `hold`      Man
 * Man          the operator's output, else the last one             Man
 * OOS, none    nothing                                              OOS
 *
 * Every output that is not the law's takes the law off its track; before the law computes again it is
 * made to go on from the last output (track), so no change of mode, tuning or quality gives a bump.
 */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* ---- The law -------------------------------------------------------------------------------- */

static struct apc_law_call call(struct apc_controller *c, double *u, unsigned *limited,
                                enum apc_law_output who)
{
    struct apc_law_call law = c->call;

    for (size_t i = 0; i < c->dim.nu; i++)
        c->who[i] = who;
    law.u = u;
    law.limited = limited;
    law.gap = c->gap;
    return law;
}

void apc_controller_limit(const struct apc_controller *c, double *u)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (u[i] < c->low[i])
            u[i] = c->low[i];
        if (u[i] > c->high[i])
            u[i] = c->high[i];
    }
}

/* The law's state to what it is before the first tick. */
static void reset(struct apc_controller *c)
{
    struct apc_law_call law = call(c, c->u, c->held, APC_OUT_GIVEN);

    for (size_t k = 0; k < c->n_instances; k++)
        apc_instances_reset(c->instances, k, &law);
    c->begun = true;
    c->gap = true;
    c->on_track = false;
}

/* Ask the law for u, into trial, within the limits. Returns enum apc_law_result, the worst of all instances.
 */
static int compute(struct apc_controller *c)
{
    struct apc_law_call law = call(c, c->trial, c->limited, APC_OUT_LAW);
    int result = APC_LAW_GOOD;

    memcpy(c->trial, c->u, c->dim.nu * sizeof(*c->trial)); /* a law that leaves one out keeps it */
    memset(c->limited, 0, c->dim.nu * sizeof(*c->limited));
    for (size_t k = 0; k < c->n_instances && result <= APC_LAW_LATE; k++) {
        int one = apc_instances_compute(c->instances, k, &law);

        result = one > result ? one : result;
    }
    if (result > APC_LAW_LATE)
        return result;
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->trial[i] < c->low[i])
            c->limited[i] |= APC_LIMITED_LOW;
        if (c->trial[i] > c->high[i])
            c->limited[i] |= APC_LIMITED_HIGH;
    }
    apc_controller_limit(c, c->trial);
    return result;
}

static void track(struct apc_controller *c, double *u)
{
    struct apc_law_call law = call(c, u, c->held, APC_OUT_GIVEN);

    for (size_t k = 0; k < c->n_instances; k++)
        apc_instances_track(c->instances, k, &law);
    c->gap = false;
}

static void update(struct apc_controller *c)
{
    struct apc_law_call law = call(c, c->u, c->held, APC_OUT_LAW);

    for (size_t k = 0; k < c->n_instances; k++)
        apc_instances_update(c->instances, k, &law);
}

/*
 * Take over from a former run. When the plant still follows its last output, run the update that it ran,
 * or was killed before running: the law then goes on as if nothing had happened. If that output does not
 * follow from its x with the tuning of today (tuned meanwhile, or it was not the law's), the law tracks it
 * first. When the plant has meanwhile gone to its safe value, the process has moved: the law begins from
 * the last output, as after a lost measurement.
 */
static void settle(struct apc_controller *c, struct apc_now now)
{
    bool follows = compute(c) <= APC_LAW_LATE;
    apc_ns age = now.utc - c->resumed_at;

    c->resumed = false;
    c->on_track = age >= 0 && age <= c->loss; /* below 0 the clock was set back: nobody knows */
    c->gap = !c->on_track;
    if (!c->on_track)
        return;
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->trial[i] < c->u[i] || c->trial[i] > c->u[i])
            follows = false;
    }
    if (!follows)
        track(c, c->u);
    update(c);
}

/* ---- Inputs --------------------------------------------------------------------------------- */

/* Where each vector lies in the samples of apc_controller_inputs(). */
struct input {
    const struct apc_sample *y, *z, *mode, *tuning, *manual, *state;
};

static struct input locate(const struct apc_controller *c, const struct apc_sample *in)
{
    struct input at = {.y = in};

    at.z = at.y + c->dim.ny;
    at.mode = at.z + c->dim.nz;
    at.tuning = at.mode + 1;
    at.manual = at.tuning + c->n_tuning;
    at.state = at.manual + c->dim.nu;
    return at;
}

static bool usable(const struct apc_sample *s)
{
    return s->seq > 0 && apc_status_severity(s->status) != APC_SEVERITY_BAD && apc_value_ok(s->value);
}

static bool within(double value, double low, double high)
{
    return value >= low && value <= high;
}

/* A value that may not be taken: the last good one stays. Told once, when its row comes. */
static void refuse(struct apc_notice *notice, const struct apc_sample *s, int64_t seen, const char *what,
                   size_t i, double low, double high)
{
    if (s->seq != seen)
        apc_note(notice, APC_NOTICE_REJECTED, "%s %zu refused: %g is not within %g to %g", what, i + 1,
                 s->value, low, high);
}

static void take_target(struct apc_controller *c, const struct apc_sample *s, struct apc_notice *notice)
{
    if (s->seq == 0 || apc_status_severity(s->status) == APC_SEVERITY_BAD)
        c->target = APC_MODE_OOS;
    else if (s->value == (double)APC_MODE_MAN || s->value == (double)APC_MODE_AUTO ||
             s->value == (double)APC_MODE_OOS)
        c->target = (enum apc_mode)(int)s->value;
    else if (s->seq != c->target_seq)
        apc_note(notice, APC_NOTICE_REJECTED, "target mode refused: %g is none", s->value);
    c->target_seq = s->seq;
}

static void refuse_tuning(const struct apc_controller *c, size_t i, const struct apc_sample *s,
                          struct apc_notice *notice)
{
    const struct apc_law_parameter at = apc_instances_parameter(c->instances, i);
    const struct apc_param *param = &c->param[at.number];
    char what[64];

    snprintf(what, sizeof(what), "%s of output", param->name);
    refuse(notice, s, c->tuning_seq[i], what, at.of, param->low, param->high);
}

/* Returns true when what the operator wants differs from what is in force, and the law may have it. */
static bool take_tuning(struct apc_controller *c, const struct apc_sample *tuning, struct apc_notice *notice)
{
    bool moved = false, differs = false;
    struct apc_error why = {""};

    for (size_t i = 0; i < c->n_tuning; i++) {
        const struct apc_sample *s = &tuning[i];

        if (usable(s) &&
            apc_param_accepts(&c->param[apc_instances_parameter(c->instances, i).number], s->value))
            c->offered[i] = s->value;
        else
            refuse_tuning(c, i, s, notice);
        if (s->seq != c->tuning_seq[i])
            moved = true;
        c->tuning_seq[i] = s->seq;
        if (c->offered[i] < c->tuning[i] || c->offered[i] > c->tuning[i])
            differs = true;
    }
    if (moved) {
        c->offer_ok = apc_instances_check(c->instances, c->offered, &why) == 0;
        if (!c->offer_ok)
            apc_note(notice, APC_NOTICE_REJECTED, "tuning refused: %.120s", why.text);
    }
    return differs && c->offer_ok;
}

static void adopt_tuning(struct apc_controller *c)
{
    if (c->offer_ok)
        memcpy(c->tuning, c->offered, c->n_tuning * sizeof(*c->tuning));
}

static bool setpoint_accepted(const struct apc_controller *c, size_t i, const struct apc_sample *s)
{
    return usable(s) && within(s->value, c->z_low[i], c->z_high[i]);
}

/* Look at every one, so that freshness knows them all; y and z change only when all of them are usable, or
 * have been and are only refused now. */
static bool take_measurement(struct apc_controller *c, struct apc_now now, const struct input *in,
                             struct apc_notice *notice)
{
    c->trouble[0] = '\0';
    for (size_t i = 0; i < c->dim.ny; i++) {
        const struct apc_sample *s = &in->y[i];

        if (!apc_freshness_look(&c->fresh[i], s->seq, s->time, now, c->horizon))
            snprintf(c->trouble, sizeof(c->trouble), "measurement %zu is %s", i + 1,
                     s->seq ? "stale" : "missing");
        else if (!usable(s))
            snprintf(c->trouble, sizeof(c->trouble), "measurement %zu is Bad", i + 1);
    }
    for (size_t i = 0; i < c->dim.nz; i++) {
        const struct apc_sample *s = &in->z[i];
        bool bad = apc_status_severity(s->status) == APC_SEVERITY_BAD;

        if (s->seq && !bad && !setpoint_accepted(c, i, s)) {
            refuse(notice, s, c->setpoint_seq[i], "setpoint", i, c->z_low[i], c->z_high[i]);
            c->setpoint_seq[i] = s->seq;
        }
        if (bad || !s->seq || (!c->have_y && !setpoint_accepted(c, i, s)))
            snprintf(c->trouble, sizeof(c->trouble), "setpoint %zu is %s", i + 1,
                     !s->seq ? "missing"
                     : bad   ? "Bad"
                             : "refused");
    }
    if (c->trouble[0])
        return false;
    for (size_t i = 0; i < c->dim.ny; i++) {
        c->y_new[i] = in->y[i].seq != c->y_seq[i];
        c->y_status[i] = in->y[i].status;
        c->y_age[i] = apc_ns_to_s(now.utc - in->y[i].time);
        c->y[i] = in->y[i].value;
        c->y_seq[i] = in->y[i].seq;
    }
    for (size_t i = 0; i < c->dim.nz; i++) {
        if (!setpoint_accepted(c, i, &in->z[i]))
            continue;
        for (size_t k = 0; k < c->n_ahead; k++)
            c->z[k * c->dim.nz + i] = in->z[i].value;
        c->z_seq[i] = c->setpoint_seq[i] = in->z[i].seq;
    }
    c->have_y = true;
    if (!c->begun)
        reset(c);
    return true;
}

/* ---- Modes ---------------------------------------------------------------------------------- */

/* Keep the last output; after `hold`, the fault value. Returns the status of what goes out. */
static apc_status hold(struct apc_controller *c, struct apc_now now, struct apc_notice *notice)
{
    c->on_track = false;
    c->gap = true;
    if (!c->holding) {
        c->holding = true;
        c->faulted = false;
        c->hold_since = now.mono;
        apc_note(notice, APC_NOTICE_HOLD, "output held: %s", c->trouble);
    }
    if (now.mono - c->hold_since < c->hold) {
        c->mode = APC_MODE_AUTO;
        return APC_UNCERTAIN_LAST_USABLE;
    }
    if (!c->faulted)
        apc_note(notice, APC_NOTICE_FAULT, "output at its fault value: %s", c->trouble);
    c->faulted = true;
    memcpy(c->u, c->fault, c->dim.nu * sizeof(*c->u));
    c->have_u = true;
    c->by_law = false;
    c->mode = APC_MODE_MAN;
    return APC_UNCERTAIN_SUBSTITUTE;
}

/* The law's output with the tuning in force, then a state from which the new tuning gives the same. */
static void retune(struct apc_controller *c)
{
    bool bumpless = c->on_track && c->law->track && compute(c) <= APC_LAW_LATE;

    adopt_tuning(c);
    if (bumpless)
        track(c, c->trial);
}

/* An answer of the law that cannot go out. */
static apc_status refuse_answer(struct apc_controller *c, int result, struct apc_now now,
                                struct apc_notice *notice)
{
    c->failures++;
    if (!c->why[0])
        snprintf(c->why, sizeof(c->why), "%s",
                 result == APC_LAW_FAILED ? "failed" : "found nothing feasible");
    snprintf(c->trouble, sizeof(c->trouble), "law %.20s %s (%" PRIu64 ")", c->law->name, c->why, c->failures);
    if (!c->holding)
        apc_note(notice, APC_NOTICE_REJECTED, "output held: %s", c->trouble);
    if (result == APC_LAW_FAILED)
        reset(c);
    c->by_law = false;
    return hold(c, now, notice);
}

static apc_status automatic(struct apc_controller *c, struct apc_now now, struct apc_notice *notice)
{
    int result;

    if (!c->on_track && c->have_u)
        track(c, c->u);
    result = compute(c);
    if (result > APC_LAW_LATE)
        return refuse_answer(c, result, now, notice);
    if (c->holding)
        apc_note(notice, APC_NOTICE_RECOVERED, "inputs good again after %.3f s",
                 apc_ns_to_s(now.mono - c->hold_since));
    memcpy(c->u, c->trial, c->dim.nu * sizeof(*c->u));
    c->have_u = true;
    c->by_law = true;
    c->on_track = true;
    c->gap = false;
    c->holding = false;
    c->update_due = true;
    c->mode = APC_MODE_AUTO;
    return APC_GOOD;
}

/*
 * An output that the operator set counts once it is new: one that was already there in Auto, or before the
 * last output that was taken over, or before this run, is from another day, and taking it up at the change to
 * Man would be a bump.
 */
static bool fresh_manual(struct apc_controller *c, size_t i, apc_ns utc, const struct apc_sample *wanted)
{
    if (c->manual_seq[i] < 0)
        return wanted->time > c->manual_since && wanted->time <= utc + c->loss;
    return wanted->seq != c->manual_seq[i];
}

static void look_at_manual(struct apc_controller *c, const struct apc_sample *wanted)
{
    for (size_t i = 0; wanted && i < c->dim.nu; i++)
        c->manual_seq[i] = wanted[i].seq;
}

static void take_manual(struct apc_controller *c, apc_ns utc, const struct apc_sample *wanted,
                        struct apc_notice *notice)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_sample *s = &wanted[i];

        if (s->seq == 0 || apc_status_severity(s->status) == APC_SEVERITY_BAD || !fresh_manual(c, i, utc, s))
            continue;
        if (usable(s) && within(s->value, c->low[i], c->high[i]))
            c->u[i] = s->value;
        else
            refuse(notice, s, c->manual_seq[i], "manual output", i, c->low[i], c->high[i]);
    }
}

static apc_status manual(struct apc_controller *c, struct apc_now now, const struct apc_sample *wanted,
                         bool measured, struct apc_notice *notice)
{
    if (!c->have_u)
        memcpy(c->u, c->fault, c->dim.nu * sizeof(*c->u));
    if (wanted)
        take_manual(c, now.utc, wanted, notice);
    c->have_u = true;
    c->by_law = false;
    c->on_track = false;
    c->holding = false;
    c->mode = APC_MODE_MAN;
    if (measured)
        track(c, c->u);
    c->gap = !measured;
    c->update_due = measured && c->law->track; /* without it an integral would wind up */
    return APC_GOOD;
}

static void out_of_service(struct apc_controller *c)
{
    c->on_track = false;
    c->gap = true;
    c->holding = false;
    c->mode = APC_MODE_OOS;
}

/* ---- The tick ------------------------------------------------------------------------------- */

/* Read everything into c. Returns true when y and z may be used to control by. */
static bool take_inputs(struct apc_controller *c, struct apc_now now, const struct apc_sample *in,
                        struct apc_notice *notice)
{
    struct input at;
    bool retuned, measured;

    if (!in) {
        snprintf(c->trouble, sizeof(c->trouble), "the shared data cannot be read");
        return false;
    }
    at = locate(c, in);
    if (c->update_due && at.state->seq == c->state_seq)
        update(c); /* the last output was written after all: only the answer was lost */
    take_target(c, at.mode, notice);
    retuned = take_tuning(c, at.tuning, notice);
    if (c->resumed) {
        adopt_tuning(c);
        retuned = false;
        settle(c, now);
    }
    if (!c->begun)
        adopt_tuning(c); /* for reset, and because there is nothing yet to be bumpless to */
    measured = take_measurement(c, now, &at, notice);
    if (retuned && measured && c->target == APC_MODE_AUTO)
        retune(c);
    else
        adopt_tuning(c);
    return measured;
}

int apc_controller_compute(struct apc_controller *c, struct apc_now now, const struct apc_sample *in,
                           struct apc_sample *out, struct apc_notice *notice)
{
    const struct apc_sample *wanted = in ? locate(c, in).manual : NULL;
    enum apc_mode before = c->mode;
    apc_status status = APC_GOOD;
    bool measured;
    size_t n = 0;

    if (notice)
        notice->kind = APC_NOTICE_NONE;
    for (size_t i = 0; i < c->dim.nu && c->have_u; i++)
        c->u_last[i] = c->u[i];
    measured = take_inputs(c, now, in, notice);
    c->call.t = c->Ts * (double)c->call.tick++;
    c->update_due = false;
    if (c->target == APC_MODE_AUTO)
        status = measured ? automatic(c, now, notice) : hold(c, now, notice);
    else if (c->target == APC_MODE_MAN)
        status = manual(c, now, wanted, measured, notice);
    else
        out_of_service(c);
    look_at_manual(c, wanted);
    if (c->target != APC_MODE_OOS && c->have_u)
        n = apc_controller_put_output(c, now.utc, status, out);
    if (c->mode != before || !c->mode_written) {
        n += apc_controller_put_mode(c, now.utc, out + n);
        c->mode_written = false; /* until the shell has written it and says so */
    }
    if (c->mode != before)
        apc_note(notice, APC_NOTICE_MODE, "mode %s", apc_mode_name((int)c->mode));
    return (int)n;
}

void apc_controller_update(struct apc_controller *c)
{
    if (c->update_due)
        update(c);
    c->update_due = false;
    c->mode_written = true;
}

uint64_t apc_controller_failures(const struct apc_controller *c)
{
    return c->failures;
}
