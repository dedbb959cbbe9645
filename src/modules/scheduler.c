/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Whose a setpoint is, is read in the same moment as the setpoint itself, and what is written is written only
 * if nobody did since. Whoever changes the owner writes the setpoint as well: so a step that was on its way
 * is left out, and the row in force is its owner's, whatever the order was.
 *
 * With each step goes what is to come, of the same seq and time: by these a reader knows whether it is the
 * plan of the setpoint in force. If the step is left out, its plan is of no row that there is.
 */
#include "base/base_internal.h"
#include "base/parts.h"
#include "modules/modules_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PLAN_ROOM ((size_t)2 * APC_PLAN_PAIRS)

/** A setpoint. */
struct moved {
    bool written;  /* a step of it: */
    uint64_t step; /* this one, */
    int64_t owner; /* when this was the newest row of its switch */
    bool local;
};

struct apc_scheduler {
    struct apc_scheduler_options options;
    void *memory;                     /* of the arrays */
    struct apc_scheduler_setpoint *z; /* [nz] */
    struct moved *state;              /* [nz] */
    struct apc_sample *samples;       /* [3 nz] setpoints, switches; what is written */
    struct apc_vector *plans;         /* [nz] written with it */
    double *pairs;                    /* [nz * PLAN_ROOM] */
    size_t *of;                       /* [nz] whose row that is */
    uint64_t step;
    struct apc_rows in, out;
};

/* ---- Making ------------------------------------------------------------------------------- */

static int check_scheduler_options(const struct apc_scheduler_options *o, struct apc_error *why)
{
    if (!o->nz || o->nz > APC_VECTOR_MAX || !o->z || !o->steps || !o->sequence)
        return apc_fail(why, APC_EINVAL, "scheduler: setpoints (at most %d) and a sequence are required",
                        APC_VECTOR_MAX);
    if (!apc_period_ok(o->period))
        return apc_fail(why, APC_EINVAL, "scheduler: the period must be above 0 and not above 366 days");
    return 0;
}

static void name_scheduler_rows(struct apc_scheduler *s)
{
    const size_t nz = s->options.nz;

    for (size_t k = 0; k < nz; k++) {
        s->samples[k] =
            (struct apc_sample){.table = APC_SETPOINT, .id = s->z[k].id, .status = APC_BAD_NO_DATA};
        s->samples[nz + k] =
            (struct apc_sample){.table = APC_OPMODE, .id = s->z[k].owner, .status = APC_BAD_NO_DATA};
    }
    s->in = (struct apc_rows){.size = sizeof(s->in), .sample = s->samples, .n_samples = 2 * nz};
    s->out = (struct apc_rows){.size = sizeof(s->out), .sample = s->samples + 2 * nz, .vector = s->plans};
}

int apc_scheduler_create(struct apc_scheduler **scheduler, const struct apc_scheduler_options *options,
                         struct apc_error *why)
{
    struct apc_scheduler_options o = {0};
    struct apc_scheduler *new;
    int rc;

    if (!scheduler)
        return apc_fail(why, APC_EINVAL, "apc_scheduler_create: scheduler must not be NULL");
    *scheduler = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_scheduler_options", why);
    if (rc == 0)
        rc = check_scheduler_options(&o, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "scheduler: no memory");
    new->options = o;
    const struct apc_part parts[] = {
        APC_PART_COPY(new->z, o.nz, o.z), APC_PART(new->state, o.nz), APC_PART(new->samples, 3 * o.nz),
        APC_PART(new->of, o.nz),          APC_PART(new->plans, o.nz), APC_PART(new->pairs, PLAN_ROOM * o.nz)};
    new->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!new->memory) {
        apc_scheduler_destroy(new);
        return apc_fail(why, APC_ENOMEM, "scheduler: no memory");
    }
    name_scheduler_rows(new);
    *scheduler = new;
    return 0;
}

void apc_scheduler_destroy(struct apc_scheduler *s)
{
    if (!s)
        return;
    free(s->memory);
    free(s);
}

struct apc_rows *apc_scheduler_in(struct apc_scheduler *s)
{
    return &s->in;
}

struct apc_rows *apc_scheduler_out(struct apc_scheduler *s)
{
    return &s->out;
}

/* ---- Whose they are ----------------------------------------------------------------------- */

static const struct apc_sample *setpoint_of(const struct apc_scheduler *s, size_t k)
{
    return &s->in.sample[k];
}

static const struct apc_sample *owner_of_setpoint(const struct apc_scheduler *s, size_t k)
{
    return &s->in.sample[s->options.nz + k];
}

static bool is_local(const struct apc_sample *owner)
{
    return owner->seq > 0 && !(owner->value >= 1.0);
}

/* One notice tells of all of them. */
static void tell_of_setpoint(struct apc_notice *notice, const char *name, const char *what)
{
    const size_t used = notice && notice->kind != APC_NOTICE_NONE ? strlen(notice->text) : 0;

    if (!notice)
        return;
    notice->kind = APC_NOTICE_MODE;
    snprintf(notice->text + used, sizeof(notice->text) - used, "%s%s %s", used ? "; " : "", name, what);
}

static bool is_setpoint_due(const struct apc_scheduler *s, size_t k)
{
    const struct moved *m = &s->state[k];

    return !m->local && !(m->written && m->step == s->step && m->owner == owner_of_setpoint(s, k)->seq);
}

/* ---- Steps -------------------------------------------------------------------------------- */

static double setpoint_at_step(const struct apc_scheduler *s, size_t k, uint64_t step)
{
    const struct apc_scheduler_options *o = &s->options;
    const uint64_t row = step < o->steps ? step : o->repeat ? step % o->steps : o->steps - 1;

    return o->sequence[row * o->nz + k];
}

/* The steps to come that change it, from now on: of one round of a sequence that begins again. */
static uint32_t plan(const struct apc_scheduler *s, size_t k, apc_ns age, double *pair)
{
    const struct apc_scheduler_options *o = &s->options;
    const uint64_t left = o->repeat ? o->steps : s->step < o->steps ? o->steps - 1 - s->step : 0;
    double value = setpoint_at_step(s, k, s->step);
    uint32_t n = 0;

    pair[n++] = 0.0;
    pair[n++] = value;
    for (uint64_t i = 1; i <= left && n < PLAN_ROOM; i++) {
        const double next = setpoint_at_step(s, k, s->step + i);

        if (next >= value && next <= value)
            continue;
        pair[n++] = apc_ns_to_s((apc_ns)i * o->period - age);
        pair[n++] = value = next;
    }
    return n;
}

static void put_scheduled_setpoint(struct apc_scheduler *s, size_t k, apc_ns utc, apc_ns age)
{
    double *pair = s->pairs + PLAN_ROOM * s->out.n_vectors;
    const uint32_t n = plan(s, k, age, pair);

    s->out.vector[s->out.n_vectors++] = (struct apc_vector){.table = APC_PLAN,
                                                            .id = s->z[k].id,
                                                            .seq = apc_seq_last(setpoint_of(s, k)) + 1,
                                                            .time = utc,
                                                            .n = n,
                                                            .room = n,
                                                            .value = pair};
    s->of[s->out.n_samples] = k;
    s->out.sample[s->out.n_samples++] = (struct apc_sample){.table = APC_SETPOINT,
                                                            .id = s->z[k].id,
                                                            .seq = setpoint_of(s, k)->seq,
                                                            .time = utc,
                                                            .value = setpoint_at_step(s, k, s->step),
                                                            .status = APC_GOOD};
}

static void mark_written(struct apc_scheduler *s, size_t k)
{
    s->state[k].written = true;
    s->state[k].step = s->step;
    s->state[k].owner = owner_of_setpoint(s, k)->seq;
}

void apc_scheduler_resume(struct apc_scheduler *s, uint64_t step, apc_ns since)
{
    s->step = step;
    for (size_t k = 0; k < s->options.nz; k++) {
        const struct apc_sample *setpoint = setpoint_of(s, k), *owner = owner_of_setpoint(s, k);

        if (setpoint->seq > 0 && setpoint->time >= since && (owner->seq == 0 || setpoint->time > owner->time))
            mark_written(s, k);
    }
}

int apc_scheduler_compute(struct apc_scheduler *s, struct apc_now now, uint64_t step, apc_ns age,
                          struct apc_notice *notice)
{
    if (notice)
        notice->kind = APC_NOTICE_NONE;
    s->step = step;
    s->out.n_samples = s->out.n_vectors = 0;
    for (size_t k = 0; k < s->options.nz; k++) {
        const bool local = is_local(owner_of_setpoint(s, k));

        if (local != s->state[k].local)
            tell_of_setpoint(notice, s->z[k].name,
                             local ? "is Local: its steps are not written"
                                   : "is Remote: its steps are written again");
        s->state[k].local = local;
        if (is_setpoint_due(s, k))
            put_scheduled_setpoint(s, k, now.utc, age);
    }
    return (int)s->out.n_samples;
}

bool apc_scheduler_update(struct apc_scheduler *s, bool stored)
{
    bool all = stored;

    for (size_t i = 0; i < s->out.n_samples && stored; i++) {
        if (s->out.sample[i].seq > 0)
            mark_written(s, s->of[i]);
        else
            all = false;
    }
    return all;
}
