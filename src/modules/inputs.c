/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the shared data say to the controller, and what is the case with each loop. A value that must not be
 * taken is told of once, when its row comes, and the last good one stays.
 */
#include "base/base_internal.h"
#include "modules/controller.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- Where it stands ---------------------------------------------------------------------- */

/* The row of number @p k of what is wanted. */
static const struct apc_sample *row_of_wanted(const struct apc_controller *c, size_t k)
{
    return &c->in.sample[c->dim.ny + c->dim.nd + k];
}

/* ---- What must not be taken ---------------------------------------------------------------- */

static bool is_bad_sample(const struct apc_sample *s)
{
    return apc_status_severity(s->status) == APC_SEVERITY_BAD;
}

static bool is_usable_sample(const struct apc_sample *s)
{
    return s->seq > 0 && !is_bad_sample(s) && apc_value_ok(s->value);
}

static bool is_in_range(double value, double low, double high)
{
    return value >= low && value <= high;
}

/* Is the row of number @p k of what is wanted another one than when it was looked at? */
static bool is_new(const struct apc_controller *c, size_t k)
{
    return row_of_wanted(c, k)->seq != c->looked[k];
}

static void look_at_wanted(struct apc_controller *c, size_t k, bool refused)
{
    c->looked[k] = row_of_wanted(c, k)->seq;
    c->refused[k] = refused;
    c->looking = true;
    if (k < c->dim.nz)
        c->open[k] = true;
}

/* A variable as people call it. */
struct called {
    char text[48];
};

static struct called called(const char *name, int number)
{
    struct called c;

    if (name)
        snprintf(c.text, sizeof(c.text), "%.47s", name);
    else
        snprintf(c.text, sizeof(c.text), "%d", number);
    return c;
}

static void refuse_wanted(struct apc_controller *c, struct apc_notice *notice, const char *what,
                          const char *who, double value, double low, double high)
{
    char text[256]; /* a notice takes what fits */

    snprintf(text, sizeof(text), "%s %s refused: %.15g is not within %.15g to %.15g", what, who, value, low,
             high);
    apc_controller_note_refused(c, notice, text);
}

/* ---- What is wanted ------------------------------------------------------------------------ */

static void take_target(struct apc_controller *c, size_t i, struct apc_notice *notice)
{
    const size_t k = apc_controller_wanted(c, APC_OPMODE) + i;
    const struct apc_sample *s = row_of_wanted(c, k);
    struct apc_controller_state *l = &c->state[i];
    bool is_none = false;

    c->fast_path[i] = false;

    if (s->seq == 0 || is_bad_sample(s))
        l->target = APC_MODE_OOS;
    else if (s->value == (double)APC_MODE_MAN || s->value == (double)APC_MODE_AUTO ||
             s->value == (double)APC_MODE_OOS ||
             (s->value == (double)APC_MODE_CAS && apc_controller_is_below(c, i)))
        l->target = (enum apc_mode)(int)s->value;
    else
        is_none = true;
    look_at_wanted(c, k, is_none);
    if (is_none)
        apc_controller_note(c, i, notice, APC_NOTICE_REJECTED, "target mode refused: %g is none", s->value);
}

static void refuse_tuning(struct apc_controller *c, const struct apc_controller_law *law, size_t i,
                          double value, struct apc_notice *notice)
{
    static const char *const of[] = {
        [APC_OF_OUTPUT] = "output", [APC_OF_LAW] = "law", [APC_OF_MEASUREMENT] = "measurement"};
    const struct apc_law_parameter p = apc_instances_parameter(law->instances, i);
    const struct apc_param *param = &law->param[p.number];
    const char *backup = law == &c->backup ? "backup." : "";
    const char *loop = p.scope == APC_OF_OUTPUT ? c->loop[p.of].name : NULL;
    const struct called who =
        called(loop, p.scope == APC_OF_MEASUREMENT ? c->in.sample[p.of].id : (int)p.of + 1);
    char what[64];

    if (loop)
        snprintf(what, sizeof(what), "%s%.40s of", backup, param->name);
    else
        snprintf(what, sizeof(what), "%s%.40s of %s", backup, param->name, of[p.scope]);
    refuse_wanted(c, notice, what, p.scope == APC_OF_LAW ? law->definition->name : who.text, value,
                  param->low, param->high);
}

static void take_parameter(struct apc_controller *c, size_t i, struct apc_notice *notice)
{
    const size_t k = apc_controller_wanted(c, APC_TUNING) + i;
    const struct apc_controller_law *law = apc_controller_tuned(c, i);
    const struct apc_sample *s = row_of_wanted(c, k);
    const struct apc_param *param =
        &law->param[apc_instances_parameter(law->instances, i - law->first).number];
    const bool good = is_usable_sample(s) && apc_param_accepts(param, s->value);

    look_at_wanted(c, k, s->seq > 0 && !good);
    if (good)
        c->offered[i] = s->value;
    else if (s->seq > 0)
        refuse_tuning(c, law, i - law->first, s->value, notice);
}

/* May all that is offered be in force together? */
static void take_offer(struct apc_controller *c, struct apc_controller_law *law, struct apc_notice *notice)
{
    struct apc_error why = {""};
    char text[sizeof(notice->text)];

    law->offer_ok = apc_instances_check(law->instances, law->offered, &why) == 0;
    law->offer_new = c->untold = true;
    snprintf(text, sizeof(text), "tuning refused: %.120s", why.text);
    if (!law->offer_ok)
        apc_controller_note_refused(c, notice, text);
}

static void take_wanted_tuning(struct apc_controller *c, struct apc_controller_law *law,
                               struct apc_notice *notice)
{
    const size_t first = apc_controller_wanted(c, APC_TUNING), end = law->first + law->size.tuning;
    const struct apc_sample *const row = row_of_wanted(c, first);
    const int64_t *const looked = c->looked + first;
    bool new = false;

    for (size_t i = law->first; i < end; i++) {
        if (row[i].seq == looked[i])
            continue;
        take_parameter(c, i, notice);
        new = true;
    }
    if (new)
        take_offer(c, law, notice);
}

void apc_controller_take_wanted(struct apc_controller *c, struct apc_notice *notice)
{
    const size_t mode = apc_controller_wanted(c, APC_OPMODE);
    const struct apc_sample *const row = row_of_wanted(c, mode);
    const int64_t *const looked = c->looked + mode;

    for (size_t i = 0; i < c->dim.nu; i++) {
        if (row[i].seq != looked[i])
            take_target(c, i, notice);
    }
    take_wanted_tuning(c, &c->law, notice);
    take_wanted_tuning(c, &c->backup, notice);
}

/*
 * An output that the operator set counts once it is new: one that was already there in another mode, or
 * before the tick that was taken over, or before this run, is from another day, and taking it up at the
 * change to Man would be a bump.
 */
void apc_controller_take_manual(struct apc_controller *c, size_t i, apc_ns utc, struct apc_notice *notice)
{
    const size_t k = apc_controller_wanted(c, APC_MANUAL) + i;

    if (!is_new(c, k))
        return;

    const struct apc_sample *s = row_of_wanted(c, k);
    const struct apc_controller_loop *l = &c->loop[i];
    const bool new = c->looked[k] >= 0 || (s->seq > 0 && s->time > c->since && s->time <= utc + c->loss),
               takes = c->state[i].move.output == APC_PUT_OPERATOR,
               good = is_usable_sample(s) && is_in_range(s->value, l->low, l->high);

    if (new &&takes && good)
        c->state[i].wanted = s->value;
    else if (new &&takes && !is_bad_sample(s))
        refuse_wanted(c, notice, "manual output", called(l->name, (int)i + 1).text, s->value, l->low,
                      l->high);
    look_at_wanted(c, k, !(new &&takes &&good));
}

/* ---- Inputs -------------------------------------------------------------------------------- */

/* Take number @p k of measurements and disturbances, if it is usable, into *@p value and *@p seq. */
static void take_value(struct apc_controller *c, size_t k, struct apc_now now, double *value, int64_t *seq)
{
    const struct apc_sample *s = &c->in.sample[k];
    const bool fresh = apc_freshness_look(&c->fresh[k], s->seq, s->time, now, c->horizon[k]);

    c->ok[k] = fresh && is_usable_sample(s);
    if (!c->ok[k])
        return;
    *value = s->value;
    *seq = s->seq;
}

static void take_measurements(struct apc_controller *c, struct apc_now now)
{
    for (size_t k = 0; k < c->dim.ny; k++) {
        const struct apc_sample *s = &c->in.sample[k];
        const int64_t before = c->y_seq[k];

        take_value(c, k, now, &c->y[k], &c->y_seq[k]);
        c->y_new[k] = c->y_seq[k] != before;
        c->y_status[k] = c->ok[k] || is_bad_sample(s) ? s->status : APC_BAD_NO_COMMUNICATION;
        c->y_age[k] =
            (double)(((long double)now.utc - (long double)s->time) / APC_NS_PER_S); /* of any time */
    }
    for (size_t k = 0; k < c->dim.nd; k++)
        take_value(c, c->dim.ny + k, now, &c->d[k], &c->d_seq[k]);
    for (size_t k = c->dim.nd; k < c->dim.nd * c->size.n_ahead; k++)
        c->d[k] = c->d[k - c->dim.nd];
}

static void take_setpoint(struct apc_controller *c, size_t k, struct apc_notice *notice)
{
    const struct apc_sample *s = row_of_wanted(c, k);
    const struct apc_controller_setpoint *z = &c->setpoint[k];
    const bool good = is_usable_sample(s) && is_in_range(s->value, z->low, z->high);

    if (is_new(c, k) && s->seq > 0 && !good && !is_bad_sample(s))
        refuse_wanted(c, notice, "setpoint", called(z->name, z->id).text, s->value, z->low, z->high);
    look_at_wanted(c, k, s->seq > 0 && !good);
    if (!good)
        return;
    c->z_seq[k] = s->seq;
    for (size_t row = 0; row < c->size.n_ahead; row++)
        c->z[row * c->dim.nz + k] = s->value;
}

/* ---- What is to come ----------------------------------------------------------------------- */

#define TOGETHER (APC_NS_PER_MS / 2) /* a step and a tick that lie no further apart fall together */

static apc_ns due_at(const struct apc_vector *plan, uint32_t i)
{
    return (apc_ns)llround(plan->value[i] * 1e9);
}

/* Is it what is to come of this row? Not so if a step should have come long ago: then nobody follows it. */
static bool is_plan_of(const struct apc_vector *plan, const struct apc_sample *s, apc_ns utc, apc_ns loss)
{
    const uint32_t n = plan->n;

    if (plan->seq <= 0 || plan->seq != s->seq || plan->time != s->time || n < 2 || n % 2 || n > plan->room ||
        apc_status_severity(plan->status) == APC_SEVERITY_BAD || !apc_values_ok(plan->value, n) ||
        plan->value[1] > s->value || plan->value[1] < s->value)
        return false;
    for (uint32_t i = 0; i < n; i += 2) {
        if (!(fabs(plan->value[i]) < 1e9) || (i > 0 && !(plan->value[i] > plan->value[i - 2])))
            return false;
    }
    return n == 2 ||
           (utc >= plan->time && apc_ns_since(apc_ns_since(utc, plan->time), due_at(plan, 2)) <= loss);
}

/* Setpoint @p k over the horizon: as it is now or, by a plan, as it will be. Beyond what must not be taken
 * nothing is known. */
static void fill_setpoint_horizon(struct apc_controller *c, size_t k, const struct apc_vector *plan,
                                  apc_ns utc)
{
    const struct apc_controller_setpoint *z = &c->setpoint[k];
    double value = c->z[k];
    uint32_t i = 2;

    for (size_t row = 1; row < c->size.n_ahead; row++) {
        const apc_ns ahead = (apc_ns)llround((double)row * c->Ts * 1e9) + TOGETHER;
        const apc_ns at = plan ? apc_ns_since(utc + ahead, plan->time) : 0;

        while (plan && i < plan->n && due_at(plan, i) <= at &&
               is_in_range(plan->value[i + 1], z->low, z->high)) {
            value = plan->value[i + 1];
            i += 2;
        }
        c->z[row * c->dim.nz + k] = value;
    }
}

static void take_setpoint_plan(struct apc_controller *c, size_t k, apc_ns utc)
{
    const struct apc_vector *plan = &c->plan[k];
    const struct apc_sample *s = row_of_wanted(c, k);

    c->plan_seq[k] = plan->seq;
    c->planned[k] = c->z_seq[k] == s->seq && is_plan_of(plan, s, utc, c->loss);
    fill_setpoint_horizon(c, k, c->planned[k] ? plan : NULL, utc);
}

void apc_controller_recall_plans(struct apc_controller *c)
{
    for (size_t k = 0; k < c->dim.nz && c->plan; k++) {
        if (c->planned[k] && c->plan[k].seq == c->plan_seq[k] && c->plan[k].n <= c->plan[k].room)
            fill_setpoint_horizon(c, k, &c->plan[k], c->resumed_at);
    }
}

static void take_one_setpoint(struct apc_controller *c, size_t k, struct apc_now now,
                              struct apc_notice *notice)
{
    const bool above = c->setpoint[k].above;

    if (!above || apc_controller_look_above(c, k, row_of_wanted(c, k), now))
        take_setpoint(c, k, notice);
    else
        look_at_wanted(c, k, false);
    if (above)
        apc_controller_own_setpoint(c, k, row_of_wanted(c, k));
    if (c->plan)
        take_setpoint_plan(c, k, now.utc);
}

static void take_wanted_setpoints(struct apc_controller *c, struct apc_now now, struct apc_notice *notice)
{
    const struct apc_sample *const row = row_of_wanted(c, 0);

    for (size_t k = 0; k < c->dim.nz; k++) {
        if (c->open[k] || c->plan || row[k].seq != c->looked[k] || !is_usable_sample(&row[k]))
            take_one_setpoint(c, k, now, notice);
    }
}

void apc_controller_take_inputs(struct apc_controller *c, struct apc_now now, bool have,
                                struct apc_notice *notice)
{
    if (have) {
        take_measurements(c, now);
        take_wanted_setpoints(c, now, notice);
        return;
    }
    for (size_t k = 0; k < c->dim.ny; k++) {
        c->y_new[k] = false;
        c->y_status[k] = APC_BAD_NO_COMMUNICATION;
    }
    memset(c->ok, 0, (c->dim.ny + c->dim.nd) * sizeof(*c->ok));
}

/* ---- Who acts ------------------------------------------------------------------------------ */

bool apc_controller_named(const struct apc_controller *c)
{
    if (!c->choice)
        return true;
    return c->choice->seq > 0 ? c->choice->value == (double)c->out_row->id : !c->shadow;
}

void apc_controller_take_told(struct apc_controller *c, size_t k, const struct apc_sample *newest)
{
    c->telling = true;
    c->told[k] = c->actual[k] = *newest;
    if (newest->seq == 0) {
        c->actual[k].seq = newest->origin;
        c->actual[k].origin = c->told[k].origin = 0;
    }
}

/* What another one told of the setpoints and inputs, which are its as well. */
static void take_told(struct apc_controller *c)
{
    for (size_t k = 0; k < c->dim.nz; k++)
        apc_controller_take_told(c, k, &c->choice[1 + k]);
    for (size_t k = 0; k < c->n_inputs; k++)
        apc_controller_take_told(c, c->n_wanted + k, &c->choice[1 + c->dim.nz + k]);
}

void apc_controller_take_choice(struct apc_controller *c)
{
    const bool acted = c->acting;

    if (!c->choice)
        return;
    c->acting = c->claimed && apc_controller_named(c);
    if (!acted)
        take_told(c);
}

/* What goes out is another controller's. */
static void take_output(struct apc_controller *c, size_t i)
{
    const struct apc_sample *s = apc_controller_output(c, i);

    if (!is_usable_sample(s))
        return;
    c->u[i] = fmin(fmax(s->value, c->low[i]), c->high[i]);
    c->state[i].there = true;
}

/* ---- Inputs of the loop states ------------------------------------------------------------- */

static void say_of_loop(struct apc_controller_state *l, const char *what, const char *who, const char *how)
{
    snprintf(l->trouble, sizeof(l->trouble), "%s %s is %s", what, who, how);
}

static bool has_measurement(struct apc_controller *c, size_t i, size_t k, bool disturbance)
{
    const size_t at = disturbance ? c->dim.ny + k : k;
    const struct apc_sample *s = &c->in.sample[at];

    if (!c->ok[at])
        say_of_loop(&c->state[i], disturbance ? "disturbance" : "measurement", called(NULL, s->id).text,
                    !s->seq               ? "missing"
                    : is_usable_sample(s) ? "stale"
                                          : "Bad");
    return c->ok[at];
}

static bool has_setpoint(struct apc_controller *c, size_t i, size_t k)
{
    const struct apc_sample *s = row_of_wanted(c, k);
    const bool there = s->seq && !is_bad_sample(s) && c->z_seq[k];

    if (!there)
        say_of_loop(&c->state[i], "setpoint", called(c->setpoint[k].name, s->id).text,
                    !s->seq            ? "missing"
                    : is_bad_sample(s) ? "Bad"
                                       : "refused");
    return there;
}

/* What a law that is whole needs: all measurements or, where it estimates those that are missing, one at
 * least. */
static bool has_all_of_law(struct apc_controller *c, const struct apc_law *law, size_t i)
{
    bool has = true, any = false;

    for (size_t k = 0; k < c->dim.ny; k++) {
        any |= c->ok[k];
        has &= has_measurement(c, i, k, false) || law->estimates;
    }
    for (size_t k = 0; k < c->dim.nd; k++)
        has &= has_measurement(c, i, k, true);
    for (size_t k = 0; k < c->dim.nz; k++)
        has &= has_setpoint(c, i, k);
    return has && any;
}

static bool has_input(struct apc_controller *c, const struct apc_controller_law *law, size_t i)
{
    const struct apc_law_ports *p = apc_instances_ports(law->instances, i);
    const bool selects = law->definition->selects;
    bool has = true, any = !selects;

    if (law->definition->whole)
        return has_all_of_law(c, law->definition, i);
    for (size_t k = 0; k < p->ny; k++) {
        const bool one = has_measurement(c, i, (size_t)p->y[k], false);

        has &= one || selects;
        any |= one;
    }
    for (size_t k = 0; k < p->nd; k++)
        has &= has_measurement(c, i, (size_t)p->d[k], true);
    for (size_t k = 0; k < p->nz; k++)
        has &= has_setpoint(c, i, (size_t)p->z[k]);
    return has && any;
}

static bool are_same_loop_inputs(const struct apc_loop_inputs *a, const struct apc_loop_inputs *b)
{
    return a->target == b->target && a->acting == b->acting && a->setpoint == b->setpoint &&
           a->taken == b->taken && a->invited == b->invited && a->input == b->input && a->law == b->law &&
           a->expired == b->expired && a->backup == b->backup && a->bare == b->bare && a->remote == b->remote;
}

/* How late two ticks are neither lengthens nor shortens by a tick what lies between them. */
apc_ns apc_controller_punctual(const struct apc_controller *c, size_t i, apc_ns mono)
{
    const apc_ns held = c->state[i].loop.held;
    apc_ns period;

    if (apc_ns_from_s(c->Ts, &period) < 0 || period <= 0 || mono < held)
        return mono;
    return held + (mono - held + period / 2) / period * period;
}

void apc_controller_gather(struct apc_controller *c, size_t i, bool have, struct apc_now now)
{
    const bool below = c->loop[i].setpoint, selected = apc_controller_is_selected(c, i),
               cascade = apc_controller_is_below(c, i);
    const bool backup = c->backup.definition && !below;
    const bool ready = backup && have && has_input(c, &c->backup, i);
    struct apc_controller_state *l = &c->state[i];
    bool input;

    l->trouble[0] = '\0';
    input = have && has_input(c, &c->law, i);
    if (!have)
        snprintf(l->trouble, sizeof(l->trouble), "the shared data cannot be read");
    if (have && below)
        apc_controller_look_below(c, i, now);
    if (selected && !c->below[i].taken)
        apc_controller_find_in_force(c, i, c->below[i].value);
    if (have && c->choice && !below && (!c->acting || l->loop.state == APC_LOOP_SHADOW))
        take_output(c, i);
    const apc_ns punctual = apc_controller_punctual(c, i, now.mono);
    const struct apc_loop_inputs inputs = {
        .target = l->target,
        .acting = c->acting,
        .setpoint = below,
        .taken = !(below || selected) || c->below[i].taken,
        .invited = have && (below || selected) && c->below[i].invited,
        .input = input,
        .law = true,
        .expired = apc_loop_expired(&l->loop, input, punctual, c->loop[i].hold, c->shed_after),
        .backup = backup && (ready || apc_loop_bridges(&l->loop, punctual, c->loop[i].hold)),
        .bare = backup && !ready,
        .remote = cascade && c->above[l->setpoint].remote};
    if (l->loop.state != l->from || !are_same_loop_inputs(&inputs, &l->inputs)) {
        l->from = l->loop.state;
        l->inputs = inputs;
        l->move = apc_loop_next(l->loop.state, &inputs);
    }
    c->last[i] = l->there ? c->u[i] : (double)NAN;
    if (l->inputs.expired && input)
        snprintf(l->trouble, sizeof(l->trouble), "law %.20s gave no good answer %u times in a row",
                 c->law.definition->name, c->shed_after);
}

/* ---- What became of it ---------------------------------------------------------------------- */

static void confirm_output(struct apc_controller *c, size_t k, double force, apc_status status)
{
    struct apc_sample *s = &c->actual[k];

    s->value = force;
    s->status = status;
    s->origin = c->looked[k] > 0 ? c->looked[k] : 0;
}

/* A setpoint is not in force yet in a loop that has no input. */
static void find_rests(struct apc_controller *c)
{
    memset(c->rests, 0, c->dim.nz * sizeof(*c->rests));
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_law_ports *p;
        const bool whole = c->law.definition->whole;

        if (c->fast_path[i] || c->state[i].inputs.input)
            continue;
        p = apc_instances_ports(c->law.instances, i);
        for (size_t j = 0; j < (whole ? c->dim.nz : p->nz); j++) {
            const size_t k = whole ? j : (size_t)p->z[j];

            c->rests[k] = c->open[k] = true;
        }
    }
}

void apc_controller_confirm(struct apc_controller *c)
{
    const size_t mode = apc_controller_wanted(c, APC_OPMODE), tuning = apc_controller_wanted(c, APC_TUNING),
                 manual = apc_controller_wanted(c, APC_MANUAL);

    find_rests(c);
    for (size_t k = 0; k < mode; k++) {
        if (c->open[k])
            confirm_output(c, k, c->z[k],
                           c->setpoint[k].above ? apc_controller_handshake(c, k)
                           : c->refused[k]      ? APC_BAD
                           : c->rests[k]        ? APC_UNCERTAIN
                                                : APC_GOOD);
    }
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct apc_controller_state *l = &c->state[i];

        if (c->fast_path[i])
            continue;
        confirm_output(c, mode + i, (double)l->actual,
                       c->refused[mode + i]               ? APC_BAD
                       : l->actual != l->target           ? APC_UNCERTAIN
                       : l->loop.state == APC_LOOP_BACKUP ? APC_GOOD_LOCAL_OVERRIDE
                                                          : APC_GOOD);
        if (c->looked[manual + i] != c->actual[manual + i].origin)
            confirm_output(c, manual + i, c->u[i], c->refused[manual + i] ? APC_BAD : APC_GOOD);
    }
    for (size_t i = 0; c->untold && i < c->size.tuning; i++) {
        const bool taken = c->tuning[i] >= c->offered[i] && c->tuning[i] <= c->offered[i];

        confirm_output(c, tuning + i, c->tuning[i], c->refused[tuning + i] || !taken ? APC_BAD : APC_GOOD);
    }
}
