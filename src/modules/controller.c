/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller's making, and its tick: take what the shared data say (inputs.c), find what each loop does
 * (loop.c), ask the law (law.c), put what came of it (rows.c).
 */
#include "modules/controller.h"
#include "base/base_internal.h"
#include "base/parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Making ------------------------------------------------------------------------------- */

static int take_controller_options(struct apc_controller_options *o,
                                   const struct apc_controller_options *options, struct apc_error *why)
{
    const struct apc_dim *d = &o->dim;
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_controller_options", why);

    if (rc < 0)
        return rc;
    if (!o->law)
        return apc_fail(why, APC_EINVAL, "controller: a law is required");
    if (!d->ny || d->ny > APC_VECTOR_MAX || d->nz > APC_VECTOR_MAX || !d->nu || d->nu > APC_VECTOR_MAX ||
        d->nd > APC_VECTOR_MAX)
        return apc_fail(
            why, APC_EINVAL,
            "controller: ny is %zu, nz %zu, nu %zu, nd %zu; none may exceed %d, ny and nu not be 0", d->ny,
            d->nz, d->nu, d->nd, APC_VECTOR_MAX);
    if (!apc_period_ok(o->period) || !apc_period_ok(o->horizon))
        return apc_fail(why, APC_EINVAL,
                        "controller: period and horizon must be above 0 and not above 366 days");
    if (o->budget < 0 || o->budget > o->period)
        return apc_fail(why, APC_EINVAL,
                        "controller: the law's budget of %g s must be above 0 and no longer than the period, "
                        "%g s",
                        apc_ns_to_s(o->budget), apc_ns_to_s(o->period));
    return 0;
}

/* What both laws have one behind the other. */
static void divide_law_arrays(struct apc_controller *c)
{
    c->law.instance = c->instance;
    c->backup.instance = c->instance + c->law.size.instances;
    c->law.x = c->x;
    c->backup.x = c->x + c->law.size.states;
    c->law.tuning = c->tuning;
    c->backup.tuning = c->tuning + c->backup.first;
    c->law.offered = c->offered;
    c->backup.offered = c->offered + c->backup.first;
}

static int allocate_controller(struct apc_controller *c)
{
    const size_t ny = c->dim.ny, nz = c->dim.nz, nu = c->dim.nu, nd = c->dim.nd, n_ahead = c->size.n_ahead;
    const size_t n_wanted = nz + 2 * nu + c->size.tuning;
    const struct apc_part parts[] = {APC_PART(c->input, ny),
                                     APC_PART(c->y_seq, ny),
                                     APC_PART(c->d_seq, nd),
                                     APC_PART(c->z_seq, nz),
                                     APC_PART(c->plan_seq, nz),
                                     APC_PART(c->looked, n_wanted),
                                     APC_PART(c->y_new, ny),
                                     APC_PART(c->ok, ny + nd),
                                     APC_PART(c->rests, nz),
                                     APC_PART(c->planned, nz),
                                     APC_PART(c->open, nz),
                                     APC_PART(c->fast_path, nu),
                                     APC_PART(c->refused, n_wanted),
                                     APC_PART(c->setpoint, nz),
                                     APC_PART(c->loop, nu),
                                     APC_PART(c->state, nu),
                                     APC_PART(c->instance, c->size.instances),
                                     APC_PART(c->below, nu),
                                     APC_PART(c->above, nz),
                                     APC_PART(c->y_status, ny),
                                     APC_PART(c->law.limited, nu),
                                     APC_PART(c->backup.limited, nu),
                                     APC_PART(c->blocked, nu),
                                     APC_PART(c->y_limited, ny),
                                     APC_PART(c->law.decides, nu),
                                     APC_PART(c->backup.decides, nu),
                                     APC_PART(c->given, nu),
                                     APC_PART(c->fresh, ny + nd),
                                     APC_PART(c->horizon, ny + nd),
                                     APC_PART(c->y, ny),
                                     APC_PART(c->y_age, ny),
                                     APC_PART(c->y_low, ny),
                                     APC_PART(c->y_high, ny),
                                     APC_PART(c->z, n_ahead * nz),
                                     APC_PART(c->d, n_ahead * nd),
                                     APC_PART(c->x, c->size.states),
                                     APC_PART(c->u, nu),
                                     APC_PART(c->last, nu),
                                     APC_PART(c->went, nu),
                                     APC_PART(c->law.trial, nu),
                                     APC_PART(c->backup.trial, nu),
                                     APC_PART(c->low, nu),
                                     APC_PART(c->high, nu),
                                     APC_PART(c->rate, nu),
                                     APC_PART(c->tuning, c->size.tuning),
                                     APC_PART(c->offered, c->size.tuning),
                                     APC_PART(c->law.published, c->law.size.published)};

    c->n_wanted = n_wanted;
    c->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!c->memory)
        return APC_ENOMEM;
    if (c->law.size.published == 0)
        c->law.published = NULL;
    divide_law_arrays(c);
    for (size_t i = 0; i < nu; i++)
        c->given[i] = APC_OUT_GIVEN;
    return 0;
}

/* The tuning that a law begins with. */
static int take_initial_tuning(struct apc_controller_law *law, const struct apc_param *param,
                               const double *start, struct apc_error *why)
{
    law->param = param ? param : law->definition->tuning;
    for (size_t i = 0; i < law->definition->n_tuning; i++) {
        const struct apc_param *narrow = &law->param[i], *own = &law->definition->tuning[i];

        if (!(narrow->low >= own->low && narrow->low <= narrow->high && narrow->high <= own->high))
            return apc_fail(why, APC_EINVAL,
                            "controller: limits of %s: %.15g to %.15g do not lie within %.15g to %.15g",
                            own->name, narrow->low, narrow->high, own->low, own->high);
    }
    for (size_t i = 0; i < law->size.tuning; i++) {
        const struct apc_law_parameter p = apc_instances_parameter(law->instances, i);
        const struct apc_param *narrow = &law->param[p.number];

        law->tuning[i] = start ? start[i] : narrow->initial;
        if (!apc_param_accepts(narrow, law->tuning[i]))
            return apc_fail(why, APC_EINVAL,
                            "controller: %s of output %zu begins with %.15g, not within %.15g to %.15g",
                            narrow->name, p.of + 1, law->tuning[i], narrow->low, narrow->high);
    }
    memcpy(law->offered, law->tuning, law->size.tuning * sizeof(*law->offered));
    law->offer_ok = true;
    return apc_instances_check(law->instances, law->tuning, why);
}

static int take_initial_setpoints(struct apc_controller *c, const struct apc_controller_options *o,
                                  struct apc_error *why)
{
    for (size_t k = 0; k < c->dim.nz; k++) {
        struct apc_controller_setpoint *z = &c->setpoint[k];

        *z = o->z ? o->z[k]
                  : (struct apc_controller_setpoint){.id = (int)k + 1, .low = -HUGE_VAL, .high = HUGE_VAL};
        c->cascaded |= z->above != 0;
        if (z->above && !apc_period_ok(z->above_period))
            return apc_fail(why, APC_EINVAL,
                            "setpoint %zu: the period of the controller above must be above 0 and not above "
                            "366 days",
                            k + 1);
        if (!(z->low <= z->high))
            return apc_fail(why, APC_EINVAL, "limits of setpoint %zu: low %.15g must not be above high %.15g",
                            k + 1, z->low, z->high);
    }
    return 0;
}

static int take_loop_options(struct apc_controller *c, size_t i, const struct apc_controller_options *o,
                             struct apc_error *why)
{
    struct apc_controller_loop *l = &c->loop[i];

    *l = o->loop ? o->loop[i]
                 : (struct apc_controller_loop){
                       .id = (int)i + 1, .mode = (int)i + 1, .low = -HUGE_VAL, .high = HUGE_VAL};
    if (!(l->low <= l->high))
        return apc_fail(why, APC_EINVAL, "limits of output %zu: low %.15g must not be above high %.15g",
                        i + 1, l->low, l->high);
    if (!apc_value_ok(l->fault) || l->fault < l->low || l->fault > l->high)
        return apc_fail(why, APC_EINVAL,
                        "fault value %zu is %.15g; it must lie within the limits, %.15g to %.15g", i + 1,
                        l->fault, l->low, l->high);
    if (!(l->rate >= 0.0) || (l->hold && !apc_period_ok(l->hold)))
        return apc_fail(why, APC_EINVAL,
                        "controller: output %zu: neither its rate, %g, nor its hold may be below 0, nor the "
                        "hold above 366 days",
                        i + 1, l->rate);
    if (l->setpoint && l->signal)
        return apc_fail(why, APC_EINVAL,
                        "controller: output %zu: it is a setpoint or a calculated signal, not both", i + 1);
    if ((l->setpoint || (l->signal && l->below_tick)) && !apc_period_ok(l->below_period))
        return apc_fail(why, APC_EINVAL,
                        "controller: output %zu: the period of the controller below must be above 0 and not "
                        "above 366 days",
                        i + 1);
    c->cascaded |= l->setpoint != 0;
    c->selected |= apc_controller_is_selected(c, i);
    c->low[i] = l->low;
    c->high[i] = l->high;
    l->hold = l->hold ? l->hold : 3 * o->period;
    l->manual = l->manual ? l->manual : l->mode;
    c->rate[i] = l->rate > 0.0 ? l->rate : HUGE_VAL;
    if (!o->shed_after && l->hold / o->period >= c->shed_after)
        c->shed_after = (unsigned)(l->hold / o->period < 1000000 ? l->hold / o->period : 1000000);
    c->state[i].target = c->state[i].actual = APC_MODE_OOS;
    return 0;
}

static int take_horizons(struct apc_controller *c, const struct apc_controller_options *o,
                         struct apc_error *why)
{
    for (size_t k = 0; k < c->dim.ny + c->dim.nd; k++) {
        const apc_ns *own = k < c->dim.ny ? o->y_horizon : o->d_horizon;
        const apc_ns horizon = own ? own[k < c->dim.ny ? k : k - c->dim.ny] : 0;

        c->horizon[k] = horizon ? horizon : o->horizon;
        if (!apc_period_ok(c->horizon[k]))
            return apc_fail(why, APC_EINVAL, "controller: horizons must be above 0 and not above 366 days");
    }
    return 0;
}

static int make_controller_law(struct apc_controller_law *law, const struct apc_law *definition,
                               const struct apc_law_setup *setup, struct apc_error *why)
{
    const int rc = apc_instances_create(&law->instances, definition, setup, why);

    if (rc < 0)
        return rc;
    law->definition = definition;
    law->size = apc_instances_size(law->instances);
    if (definition->n_tuning > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL, "controller: law %s wants %zu tuning parameters an output; too many",
                        definition->name, definition->n_tuning);
    return 0;
}

static int make_laws(struct apc_controller *c, const struct apc_controller_options *o, struct apc_error *why)
{
    const struct apc_controller_backup *b = o->backup;
    struct apc_law_setup setup = {.size = sizeof(setup),
                                  .dim = o->dim,
                                  .Ts = apc_ns_to_s(o->period),
                                  .y = o->view,
                                  .z = o->view ? o->view + o->dim.ny : NULL,
                                  .u = o->view ? o->view + o->dim.ny + o->dim.nz : NULL,
                                  .d = o->view ? o->view + o->dim.ny + o->dim.nz + o->dim.nu : NULL,
                                  .n_setting = o->n_setting,
                                  .setting = o->setting,
                                  .plant = o->plant};
    int rc = make_controller_law(&c->law, o->law, &setup, why);

    if (rc == 0 && b) {
        setup.n_setting = b->n_setting;
        setup.setting = b->setting;
        setup.plant = b->plant;
        rc = b->law ? make_controller_law(&c->backup, b->law, &setup, why)
                    : apc_fail(why, APC_EINVAL, "controller: a backup wants a law");
    }
    c->size = (struct apc_instances_size){.instances = c->law.size.instances + c->backup.size.instances,
                                          .states = c->law.size.states + c->backup.size.states,
                                          .tuning = c->law.size.tuning + c->backup.size.tuning,
                                          .n_ahead = c->law.size.n_ahead > c->backup.size.n_ahead
                                                         ? c->law.size.n_ahead
                                                         : c->backup.size.n_ahead};
    c->backup.first = c->law.size.tuning;
    return rc;
}

static int take_tunings(struct apc_controller *c, const struct apc_controller_options *o,
                        struct apc_error *why)
{
    const int rc = take_initial_tuning(&c->law, o->param, o->start, why);

    return rc < 0 || !o->backup ? rc
                                : take_initial_tuning(&c->backup, o->backup->param, o->backup->start, why);
}

static int fill_controller(struct apc_controller *c, const struct apc_controller_options *o,
                           struct apc_error *why)
{
    int rc = make_laws(c, o, why);

    if (rc < 0)
        return rc;
    c->dim = o->dim;
    c->Ts = apc_ns_to_s(o->period);
    c->budget = apc_ns_to_s(o->budget ? o->budget : o->period / 2);
    c->real_time = o->real_time;
    c->acting = !o->acting;
    c->shadow = o->shadow;
    c->loss = apc_loss_limit(o->period);
    c->shed_after = o->shed_after ? o->shed_after : 1;
    if (allocate_controller(c) < 0)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    for (size_t k = 0; k < c->dim.ny; k++) {
        c->y_low[k] = o->view ? o->view[k].soft_low : -HUGE_VAL;
        c->y_high[k] = o->view ? o->view[k].soft_high : HUGE_VAL;
    }
    for (size_t k = 0; k < c->n_wanted; k++)
        c->looked[k] = -1;
    for (size_t k = 0; k < c->size.instances; k++)
        c->instance[k].gap = true;
    apc_controller_stir(c);
    apc_controller_lay_out_calls(c);
    c->n_actual = c->n_wanted + apc_controller_find_inputs(c, o->told);
    rc = take_horizons(c, o, why);
    if (rc == 0)
        rc = take_tunings(c, o, why);
    if (rc == 0)
        rc = take_initial_setpoints(c, o, why);
    for (size_t i = 0; i < c->dim.nu && rc == 0; i++)
        rc = take_loop_options(c, i, o, why);
    return rc < 0 ? rc : apc_controller_lay_out(c, o, why);
}

int apc_controller_create(struct apc_controller **core, const struct apc_controller_options *options,
                          struct apc_error *why)
{
    struct apc_controller_options o = {0};
    struct apc_controller *new = NULL;
    int rc;

    if (!core)
        return apc_fail(why, APC_EINVAL, "apc_controller_create: controller must not be NULL");
    *core = NULL;
    rc = take_controller_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "controller: no memory");
    rc = fill_controller(new, &o, why);
    if (rc < 0) {
        apc_controller_destroy(new);
        return rc;
    }
    *core = new;
    return 0;
}

void apc_controller_destroy(struct apc_controller *c)
{
    if (!c)
        return;
    apc_instances_destroy(c->law.instances);
    apc_instances_destroy(c->backup.instances);
    free(c->former_values);
    free(c->row);
    free(c->plan_values);
    free(c->vectors);
    free(c->samples);
    free(c->numbers);
    free(c->memory);
    free(c);
}

struct apc_rows *apc_controller_in(struct apc_controller *c)
{
    return &c->in;
}

struct apc_rows *apc_controller_out(struct apc_controller *c)
{
    return &c->out;
}

struct apc_rows *apc_controller_former(struct apc_controller *c)
{
    return &c->former;
}

void apc_controller_claimed(struct apc_controller *c, bool claimed)
{
    c->claimed = claimed;
}

uint64_t apc_controller_failures(const struct apc_controller *c)
{
    return c->failures;
}

/* ---- Notices ------------------------------------------------------------------------------ */

void apc_controller_note(struct apc_controller *c, size_t i, struct apc_notice *notice,
                         enum apc_notice_kind kind, const char *fmt, ...)
{
    char text[sizeof(notice->text)];
    va_list args;

    if (!notice)
        return;
    va_start(args, fmt);
    vsnprintf(text, sizeof(text), fmt, args);
    va_end(args);
    (void)apc_note(&c->state[i].note, kind, "%s", text);
    if (apc_note(notice, kind, "%s", text)) {
        c->said = 1;
        c->said_of = i;
    } else if (notice->kind == kind && strcmp(notice->text, text) == 0) {
        c->said++;
    }
}

void apc_controller_note_refused(struct apc_controller *c, struct apc_notice *notice, const char *text)
{
    if (!notice)
        return;
    (void)apc_note(&c->note, APC_NOTICE_REJECTED, "%s", text);
    if (apc_note(notice, APC_NOTICE_REJECTED, "%s", text))
        c->said = 0;
}

static void name_loop(const struct apc_controller *c, size_t i, struct apc_notice *notice)
{
    char text[sizeof(notice->text)];
    const char *name = c->loop[i].name;

    memcpy(text, notice->text, sizeof(text));
    if (name)
        snprintf(notice->text, sizeof(notice->text), "%.40s: %.110s", name, text);
    else
        snprintf(notice->text, sizeof(notice->text), "output %zu: %.110s", i + 1, text);
}

static void forget_notes(struct apc_controller *c)
{
    c->said = 0;
    c->heard = 0;
    c->note.kind = APC_NOTICE_NONE;
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (!c->fast_path[i])
            c->state[i].note.kind = APC_NOTICE_NONE;
    }
}

/* The gravest is the tick's, without a name where it is so with all loops. What else there is, is kept. */
static void put_tick_notice(struct apc_controller *c, struct apc_notice *notice)
{
    if (c->said == c->dim.nu && c->said > 0) {
        for (size_t i = 0; i < c->dim.nu; i++)
            c->state[i].note.kind = APC_NOTICE_NONE;
    } else if (c->said > 0) {
        name_loop(c, c->said_of, notice);
        c->state[c->said_of].note.kind = APC_NOTICE_NONE;
    } else {
        c->note.kind = APC_NOTICE_NONE;
    }
}

bool apc_controller_noticed(struct apc_controller *c, struct apc_notice *notice)
{
    notice->kind = APC_NOTICE_NONE;
    if (c->note.kind != APC_NOTICE_NONE) {
        *notice = c->note;
        c->note.kind = APC_NOTICE_NONE;
        return true;
    }
    while (c->heard < c->dim.nu && notice->kind == APC_NOTICE_NONE)
        *notice = c->state[c->heard++].note;
    if (notice->kind == APC_NOTICE_NONE)
        return false;
    name_loop(c, c->heard - 1, notice);
    return true;
}

/* ---- The tick ----------------------------------------------------------------------------- */

enum fate { ACTED, DID_NOT, NO_SIGN };

/* Did what the last tick put go out after all? Its rows are there all or none: an output shows it. */
static enum fate find_fate(const struct apc_controller *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->state[i].put && !c->loop[i].setpoint)
            return apc_controller_output(c, i)->seq >= c->state[i].seq ? ACTED : DID_NOT;
    }
    return NO_SIGN;
}

static void take_up_record(struct apc_controller *c, bool told)
{
    apc_controller_update_laws(c, false);
    c->awaits = c->selected;
    for (size_t k = 0; c->telling && k < c->n_actual; k++) {
        if (c->actual[k].seq == c->told[k].seq)
            continue;
        if (told)
            c->told[k] = c->actual[k];
        else
            c->told[k].seq = 0; /* nobody knows which of the two is there */
    }
    c->telling = c->telling && !told;
}

/* The last tick's outputs did not go out: what did before is still out. */
static void take_back(struct apc_controller *c)
{
    apc_controller_stir(c);
    for (size_t i = 0; i < c->dim.nu; i++) {
        struct apc_controller_state *l = &c->state[i];

        if (!l->put)
            continue;
        l->there = !isnan(c->last[i]);
        c->u[i] = l->there ? c->last[i] : 0.0;
        l->put = false;
    }
}

int apc_controller_compute(struct apc_controller *c, struct apc_now now, uint64_t tick, bool have,
                           struct apc_notice *notice)
{
    if (notice)
        notice->kind = APC_NOTICE_NONE;
    forget_notes(c);
    c->failed = false;
    apc_controller_look_at_selected(c, have, now);
    if (c->pending && have) {
        const enum fate fate = find_fate(c);

        if (fate == DID_NOT)
            take_back(c);
        else
            take_up_record(c, fate == ACTED); /* with no sign what became of the wanted is told again */
    }
    c->pending = false;
    if (c->awaits)
        apc_controller_update_laws(c, true);
    c->awaits = false;
    c->index = tick;
    c->t = (double)tick * c->Ts;
    c->deadline = c->real_time ? now.mono + (apc_ns)(c->budget * 1e9) : 0;
    apc_controller_date_calls(c);
    for (size_t k = 0; k < c->size.instances; k++) {
        c->instance[k].updating = c->resumed_at && c->instance[k].updating;
        c->instance[k].answered = false;
        c->instance[k].result = -1;
    }
    if (have) {
        apc_controller_take_choice(c);
        apc_controller_take_wanted(c, notice);
    }
    if (c->resumed_at && have)
        apc_controller_recall_plans(c);
    if (c->resumed_at)
        apc_controller_settle(c, now);
    apc_controller_take_inputs(c, now, have, notice);
    apc_controller_keep_fast_path(c);
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->fast_path[i])
            c->last[i] = c->u[i];
        else
            apc_controller_gather(c, i, have, now);
    }
    apc_controller_retune(c);
    apc_controller_run(c, now, have, notice);
    apc_controller_put(c, now);
    apc_controller_leave_fast_path(c);
    if (notice)
        put_tick_notice(c, notice);
    return (int)(c->out.n_samples + c->out.n_vectors);
}

void apc_controller_update(struct apc_controller *c, int written)
{
    c->pending = written < 0;
    if (written > 0)
        take_up_record(c, true);
    else if (written == 0)
        take_back(c);
}
