/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A controller by itself: who has its measurements asks it tick by tick. There is no store: rows that it reads are the
 * newest ones, and the outcome of each tick is stored at once.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "experiment.h"

#define BEGIN (INT64_C(946684800) * APC_NS_PER_S) /* UTC of the first tick, as in virtual time */

/* A row that the controller reads, by its variable. */
struct slot {
    enum apc_table table;
    int id;
    struct apc_sample *row;
};

struct standalone {
    struct experiment e, alone; /* alone: e with no other controller */
    struct apc_controller *core;
    struct apc_client *client;
    struct apc_scheduler *scheduler;            /* NULL: there is none */
    const struct standalone_variable *schedule; /* whether its setpoints are followed */
    struct apc_value *answer;                   /* [e.dim.ny] */
    struct apc_sample *arrived;
    struct slot *slot; /* in order of variables */
    size_t n_slots;
    struct standalone_variable *variable;
    size_t n;
    uint64_t tick;
};

/* ---- What can be by itself -------------------------------------------------------------------- */

static const struct controller *pick_controller(const struct experiment *e, const char *name)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (name ? !strcmp(e->controllers[i].name, name) : e->n_controllers == 1)
            return &e->controllers[i];
    return NULL;
}

int standalone_find(const struct experiment *e, const char *name, const struct controller **found,
                    struct apc_error *why)
{
    const struct controller *const c = *found = pick_controller(e, name);
    if (!c && name)
        return apc_fail(why, APC_ENOTFOUND, "%s: there is no controller \"%s\"", e->file, name);
    if (!c)
        return apc_fail(why, APC_EINVAL, "%s: there are %zu controllers: name one, as \"%s\"", e->file,
                        e->n_controllers, e->controllers[0].name);
    for (size_t i = 0; i < c->dim.nu; i++)
        if (c->u[i].table == APC_SETPOINT)
            return apc_fail(why, APC_EINVAL,
                            "controller %s: its output %s is a setpoint of a controller below, and the two "
                            "agree on more than values: take the one below, or the cascade as one law (law = "
                            "\"cascade\")",
                            c->name, e->z[c->u[i].at].tag.name);
    for (const struct controller *any = e->controllers; any < e->controllers + e->n_controllers; any++) {
        const bool backs = any->backup && is_of_user(any->backup->law_name);
        if (backs || is_of_user(any->law_name))
            return apc_fail(why, APC_EINVAL,
                            "controller %s: its law %s is not built in, but a file or process of its own",
                            any->name, (backs ? any->backup : any)->law_name);
        if (any->plugin.chosen)
            return apc_fail(
                why, APC_EINVAL,
                "controller %s: the run was given its law, %s, on the command line: write it into a copy "
                "of the experiment file",
                any->name, any->plugin.name);
    }
    return e->plant.model && is_of_user(e->plant.name)
               ? apc_fail(why, APC_EINVAL,
                          "controller %s: a law takes the model of the plant, %s, which is a file or process "
                          "of its "
                          "own: take a model file of it (`apc linearize`)",
                          c->name, e->plant.name)
               : 0;
}

/* ---- Rows ------------------------------------------------------------------------------------- */

static int compare_variables(enum apc_table table, int id, const struct slot *slot)
{
    return table != slot->table ? (table < slot->table ? -1 : 1) : id < slot->id ? -1 : id > slot->id;
}

static int compare_slots(const void *a, const void *b)
{
    const struct slot *const slot = a;
    return compare_variables(slot->table, slot->id, b);
}

static void add_slots(struct standalone *s, const struct apc_rows *in)
{
    for (size_t i = 0; i < in->n_samples; i++)
        s->slot[s->n_slots++] = (struct slot){in->sample[i].table, in->sample[i].id, &in->sample[i]};
}

static int make_slots(struct standalone *s)
{
    const struct apc_rows *const in = apc_controller_in(s->core), *const scheduled =
                                                                      s->scheduler
                                                                          ? apc_scheduler_in(s->scheduler)
                                                                          : NULL;
    s->slot = calloc(in->n_samples + (scheduled ? scheduled->n_samples : 0), sizeof *s->slot);
    if (!s->slot)
        return APC_ENOMEM;
    add_slots(s, in);
    if (scheduled)
        add_slots(s, scheduled);
    qsort(s->slot, s->n_slots, sizeof *s->slot, compare_slots);
    return 0;
}

/* The newest row of a variable; where several may write it, the next one. Returns its seq. */
static int64_t put_row(struct standalone *s, struct apc_sample row)
{
    size_t low = 0, high = s->n_slots;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (compare_variables(row.table, row.id, &s->slot[middle]) > 0)
            low = middle + 1;
        else
            high = middle;
    }
    for (; low < s->n_slots && compare_variables(row.table, row.id, &s->slot[low]) == 0; low++) {
        struct apc_sample *const at = s->slot[low].row;
        const bool counted = row.table == APC_SETPOINT || row.table == APC_OPMODE ||
                             row.table == APC_TUNING || row.table == APC_MANUAL;
        if (counted)
            row.seq = at->seq + 1; /* the same in each copy */
        *at = row;
    }
    return row.seq;
}

static void put_plan(struct standalone *s, const struct apc_vector *plan)
{
    const struct apc_rows *const in = apc_controller_in(s->core);
    for (size_t i = 0; i < in->n_vectors; i++) {
        struct apc_vector *const at = &in->vector[i];
        if (at->table != plan->table || at->id != plan->id || plan->n > at->room)
            continue;
        const struct apc_vector kept = *at;
        *at = *plan;
        at->room = kept.room;
        at->value = kept.value;
        memcpy(at->value, plan->value, plan->n * sizeof *at->value);
    }
}

/* ---- Variables -------------------------------------------------------------------------------- */

static double start_within(double value, double low, double high)
{
    return isnan(value) ? fmin(fmax(0.0, low), high) : value;
}

/* In an FMU each is called something else, and one of FMI 3 is the time. */
static bool is_name_taken(const struct standalone *s, const char *name)
{
    bool taken = strcmp(name, "time") == 0;
    for (size_t i = 0; i < s->n && !taken; i++)
        taken = strcmp(s->variable[i].tag.name, name) == 0;
    return taken;
}

static struct standalone_variable *add_variable(struct standalone *s, enum standalone_kind kind,
                                                const struct apc_tag *tag, double start)
{
    struct standalone_variable *const v = &s->variable[s->n];
    for (size_t i = 0; i < s->n; i++) /* a disturbance may be a measurement as well */
        if (s->variable[i].tag.table == tag->table && s->variable[i].tag.id == tag->id)
            return &s->variable[i];
    *v = (struct standalone_variable){.kind = kind, .tag = *tag};
    if (is_name_taken(s, tag->name))
        snprintf(v->tag.name, sizeof v->tag.name, "%.40s.%s%zu", tag->name, apc_table_name(tag->table),
                 s->n + 1);
    v->start = v->value = start_within(start, tag->low, tag->high);
    s->n++;
    return v;
}

static void add_operated(struct standalone *s, const struct controller *c, size_t i)
{
    const struct apc_tag *const output = controllers_output(&s->e, (struct controller_loop){c, i});
    const int loop = controllers_loop_id((struct controller_loop){c, i});
    struct apc_tag mode = {.table = APC_OPMODE, .id = loop, .low = APC_MODE_MAN, .high = APC_MODE_OOS},
                   manual = {.table = APC_MANUAL, .id = loop, .low = output->low, .high = output->high};

    snprintf(mode.name, sizeof mode.name, "%.50s.mode", output->name);
    snprintf(mode.description, sizeof mode.description, "target mode: 0 Man, 1 Auto, 2 OOS");
    add_variable(s, STANDALONE_MODE, &mode, c->mode == APC_MODE_CAS ? APC_MODE_AUTO : c->mode);
    snprintf(manual.name, sizeof manual.name, "%.50s.manual", output->name);
    snprintf(manual.unit, sizeof manual.unit, "%s", output->unit);
    snprintf(manual.description, sizeof manual.description, "output in mode Man, from when it is set there");
    add_variable(s, STANDALONE_PARAMETER, &manual,
                 c->u[i].table == APC_ACTUATOR ? s->e.u[c->u[i].at].initial : (double)NAN);
}

static void add_parameters(struct standalone *s, const struct controller *c, const struct apc_tag *tag,
                           size_t n)
{
    for (const struct controller *law = c; law; law = law->backup)
        for (size_t i = 0; i < n; i++) {
            const int k = tag[i].id - law->first_tuning;
            if (tag[i].table == APC_TUNING && k >= 0 && (size_t)k < apc_law_parameters(law->law, &law->dim))
                add_variable(s, STANDALONE_PARAMETER, &tag[i], law->tuning[k]);
        }
}

static void offer_schedule(struct standalone *s)
{
    struct apc_tag tag = {.table = APC_DIM, .low = 0, .high = 1};
    snprintf(tag.name, sizeof tag.name, "follow.schedule");
    snprintf(tag.description, sizeof tag.description,
             "1: setpoints are those of the experiment's scheduler, known ahead; 0: the inputs");
    s->schedule = add_variable(s, STANDALONE_MODE, &tag, 0);
}

static int make_variables(struct standalone *s, const struct controller *c)
{
    const struct experiment *const e = &s->e;
    const struct apc_dim *const d = &c->dim;
    size_t n;
    struct apc_tag *const tag = provision_tags(e, &n);

    s->variable =
        tag ? calloc(d->ny + d->nd + d->nz + 3 * d->nu + controllers_parameters(c) + 1, sizeof *s->variable)
            : NULL;
    if (!s->variable) {
        free(tag);
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < d->ny; i++)
        add_variable(s, STANDALONE_INPUT, &e->y[c->y[i].at].tag, (double)NAN);
    for (size_t i = 0; i < d->nd; i++)
        add_variable(s, STANDALONE_INPUT, &e->y[c->d[i].at].tag, (double)NAN);
    for (size_t k = 0; k < d->nz; k++) {
        const struct signal *const z = &e->z[c->z[k].at];
        add_variable(s, STANDALONE_INPUT, &z->tag, z->initial)->changed = isnan(z->initial);
    }
    for (size_t i = 0; i < d->nu; i++) {
        const struct wire u = c->u[i];
        add_variable(s, STANDALONE_OUTPUT, controllers_output(e, (struct controller_loop){c, i}),
                     u.table == APC_ACTUATOR ? e->u[u.at].initial : (double)NAN);
    }
    for (size_t i = 0; i < d->nu; i++)
        add_operated(s, c, i);
    add_parameters(s, c, tag, n);
    if (s->scheduler)
        offer_schedule(s);
    free(tag);
    return 0;
}

/* ---- Making one ------------------------------------------------------------------------------- */

static int put_first_rows(struct standalone *s, const struct controller *c)
{
    size_t n;
    struct apc_sample *const first = module_first(&s->e, BEGIN, &n);
    for (size_t i = 0; first && i < n; i++) {
        if (first[i].table == APC_OPMODE && c->mode == APC_MODE_CAS)
            first[i].value = APC_MODE_AUTO;
        put_row(s, first[i]);
    }
    free(first);
    return first ? 0 : APC_ENOMEM;
}

static bool moves_setpoint(const struct experiment *e, size_t setpoint)
{
    for (size_t k = 0; k < e->scheduler.n && e->scheduler.steps > 0; k++)
        if (e->scheduler.z[k].at == setpoint)
            return true;
    return false;
}

static bool moves_any(const struct experiment *e, const struct controller *c)
{
    bool any = false;
    for (size_t k = 0; k < c->dim.nz; k++)
        any = any || moves_setpoint(e, c->z[k].at);
    return any;
}

static int make_standalone(struct standalone *s, const char *name, struct apc_error *why)
{
    const struct controller *found;
    int rc = standalone_find(&s->e, name, &found, why);
    if (rc < 0)
        return rc;
    struct controller *const c = &s->e.controllers[found - s->e.controllers];
    c->acting = c->first_output = 0; /* nobody takes turns with it */
    c->shadow = false;
    s->alone = s->e;
    s->alone.controllers = c;
    s->alone.n_controllers = 1;
    if ((rc = module_controller(&s->alone, c, false, &s->core, why)) < 0 ||
        (rc = module_client(&s->e, NULL, BEGIN, &s->client, why)) < 0 ||
        (moves_any(&s->e, c) && (rc = module_scheduler(&s->e, &s->scheduler, why)) < 0))
        return rc;
    s->answer = calloc(s->e.dim.ny, sizeof *s->answer);
    s->arrived = calloc(s->e.dim.ny, sizeof *s->arrived);
    if (!s->answer || !s->arrived || make_slots(s) < 0 || make_variables(s, c) < 0 ||
        put_first_rows(s, c) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    apc_controller_resume(s->core, BEGIN - 1);
    return 0;
}

int standalone_create(struct standalone **standalone, const struct experiment_source *from, const char *name,
                      struct apc_error *why)
{
    struct standalone *const s = calloc(1, sizeof *s);
    int rc = s ? experiment_parse(&s->e, from, EXPERIMENT_LAW, NULL, why)
               : apc_fail(why, APC_ENOMEM, "out of memory");

    if (rc == 0)
        rc = make_standalone(s, name, why);
    if (rc < 0)
        standalone_destroy(s);
    *standalone = rc < 0 ? NULL : s;
    return rc;
}

void standalone_destroy(struct standalone *s)
{
    if (!s)
        return;
    apc_controller_destroy(s->core);
    apc_client_destroy(s->client);
    apc_scheduler_destroy(s->scheduler);
    free(s->answer);
    free(s->arrived);
    free(s->slot);
    free(s->variable);
    experiment_free(&s->e);
    free(s);
}

const struct experiment *standalone_experiment(const struct standalone *s)
{
    return &s->e;
}

const struct controller *standalone_controller(const struct standalone *s)
{
    return s->alone.controllers;
}

const struct standalone_variable *standalone_variables(const struct standalone *s, size_t *n)
{
    *n = s->n;
    return s->variable;
}

void standalone_set(struct standalone *s, size_t i, double value)
{
    struct standalone_variable *const v = &s->variable[i];
    /* of Man, each time that it is set counts: the output may have moved since */
    v->changed = v->changed || v->tag.table == APC_MANUAL || !(v->value >= value && v->value <= value);
    v->value = value;
}

/* ---- A tick ----------------------------------------------------------------------------------- */

static void take_measurement(struct standalone *s, const struct standalone_variable *v, apc_ns now)
{
    const size_t i = (size_t)v->tag.id - 1;
    const bool is_number = apc_value_ok(v->value);

    if (i < s->e.dim.ny)
        s->answer[i] = (struct apc_value){
            .value = is_number ? v->value : 0.0, .status = is_number ? APC_GOOD : APC_BAD, .time = now};
    else /* another one calculates it */
        put_row(s, (struct apc_sample){.table = APC_SENSOR,
                                       .id = v->tag.id,
                                       .seq = (int64_t)s->tick + 1,
                                       .time = now,
                                       .value = is_number ? v->value : 0.0,
                                       .status = is_number ? APC_GOOD : APC_BAD});
}

/* Its steps that are due at a tick @p since the first one. */
static void schedule_setpoints(struct standalone *s, struct apc_now now, apc_ns since)
{
    const apc_ns period = s->e.scheduler.rhythm.period,
                 begun = since + s->alone.controllers->rhythm.phase - s->e.scheduler.rhythm.phase;
    if (begun < 0 ||
        apc_scheduler_compute(s->scheduler, now, (uint64_t)(begun / period), begun % period, NULL) <= 0)
        return;
    const struct apc_rows *const out = apc_scheduler_out(s->scheduler);
    for (size_t i = 0; i < out->n_samples; i++)
        out->sample[i].seq = put_row(s, out->sample[i]);
    for (size_t i = 0; i < out->n_vectors; i++)
        put_plan(s, &out->vector[i]);
    (void)apc_scheduler_update(s->scheduler, true);
}

static void take_standalone_inputs(struct standalone *s, apc_ns now)
{
    const bool follows = s->schedule && s->schedule->value >= 1;

    for (size_t i = 0; i < s->e.dim.ny; i++)
        s->answer[i] = (struct apc_value){.status = APC_BAD_NO_DATA, .time = now};
    for (size_t i = 0; i < s->n; i++) {
        struct standalone_variable *const v = &s->variable[i];
        if (v->tag.table == APC_SENSOR && v->kind == STANDALONE_INPUT)
            take_measurement(s, v, now);
        else if (v->tag.table == APC_SETPOINT && follows && moves_setpoint(&s->e, (size_t)v->tag.id - 1))
            continue; /* changed until it is followed no more */
        else if (v->changed)
            put_row(s, (struct apc_sample){
                           .table = v->tag.table, .id = v->tag.id, .time = now, .value = v->value});
        v->changed = false;
    }
    const size_t n = apc_client_measurements(s->client, s->answer, s->arrived);
    for (size_t i = 0; i < n; i++)
        put_row(s, s->arrived[i]);
}

/* A signal that is Bad is no number, as it was when it came in. */
static void give_output(struct standalone *s, const struct apc_sample *row)
{
    for (size_t i = 0; i < s->n; i++) {
        struct standalone_variable *const v = &s->variable[i];
        if (v->kind == STANDALONE_OUTPUT && v->tag.table == row->table && v->tag.id == row->id)
            v->value = row->table == APC_SENSOR && apc_status_severity(row->status) == APC_SEVERITY_BAD
                           ? (double)NAN
                           : row->value;
    }
}

void standalone_tick(struct standalone *s, standalone_tell_fn *tell, void *ctx)
{
    const apc_ns since = (apc_ns)s->tick * s->alone.controllers->rhythm.period;
    const struct apc_now now = {.mono = since, .utc = BEGIN + since};
    struct apc_notice notice;

    take_standalone_inputs(s, now.utc);
    if (s->schedule && s->schedule->value >= 1)
        schedule_setpoints(s, now, since);
    apc_controller_compute(s->core, now, s->tick, true, &notice);
    do
        if (notice.kind != APC_NOTICE_NONE)
            tell(ctx, &notice);
    while (apc_controller_noticed(s->core, &notice));
    const struct apc_rows *const out = apc_controller_out(s->core);
    for (size_t i = 0; i < out->n_samples; i++) {
        put_row(s, out->sample[i]);
        if (out->sample[i].table == APC_ACTUATOR || out->sample[i].table == APC_SENSOR)
            give_output(s, &out->sample[i]);
    }
    apc_controller_update(s->core, 1);
    s->tick++;
}
