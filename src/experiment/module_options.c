/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/parts.h"
#include "experiment.h"
#include "operate/operate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

struct apc_law_setup module_law_setup(const struct controller *c)
{
    const struct apc_dim *d = &c->dim;
    const struct apc_signal_view *v = c->view;
    return (struct apc_law_setup){.dim = c->dim,
                                  .y = v,
                                  .z = v ? v + d->ny : NULL,
                                  .u = v ? v + d->ny + d->nz : NULL,
                                  .d = v ? v + d->ny + d->nz + d->nu : NULL,
                                  .Ts = apc_ns_to_s(c->rhythm.period),
                                  .n_setting = c->n_setting,
                                  .setting = c->setting,
                                  .plant = c->linear || c->sampled ? &c->plant : NULL};
}

void module_outputs(const struct experiment *e, double *low, double *high, double *safe, double *fault)
{
    for (size_t i = 0; i < e->dim.nu; i++) {
        low[i] = e->u[i].tag.low;
        high[i] = e->u[i].tag.high;
        safe[i] = e->u[i].safe;
        fault[i] = e->u[i].fault;
    }
}

apc_ns module_command_period(const struct experiment *e)
{
    apc_ns period = 0;
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        for (size_t k = 0; k < c->dim.nu; k++)
            if (c->u[k].table == APC_ACTUATOR && c->rhythm.period > period)
                period = c->rhythm.period;
    }
    return period;
}

#define DRAWS 1000 /* until one lies within a parameter's limits */

int experiment_draw(const struct experiment *e, uint64_t seed, double *p, struct apc_error *why)
{
    const struct apc_model *m = e->plant.model;
    struct apc_random random;
    char name[EXPERIMENT_SETTING]; /* whole: two names that begin alike have streams of their own */

    for (size_t i = 0; i < m->np; i++) {
        const struct apc_distribution *spread = &e->plant.spread[i];
        const struct apc_param *param = &m->param[i];
        int draws = 0;
        p[i] = e->plant.p[i];
        if (!spread->kind)
            continue;
        snprintf(name, sizeof name, "plant.parameters.%s", param->name);
        apc_random_init(&random, seed, name);
        do
            p[i] = apc_distribution_draw(spread, &random);
        while (!(p[i] >= param->low && p[i] <= param->high) && ++draws < DRAWS);
        if (draws == DRAWS)
            return apc_fail(
                why, APC_ERANGE,
                "none of %d draws of the plant's parameter %s lay within its limits, %.15g to %.15g", DRAWS,
                param->name, param->low, param->high);
    }
    return 0;
}

int module_plant(const struct experiment *e, struct apc_plant **plant, struct apc_plantserver **server,
                 struct apc_error *why)
{
    struct apc_plant_options how = e->plant.options;
    double *limits, *initial, *p;
    bool runs = false; /* before the first command */
    int rc;

    *plant = NULL;
    *server = NULL;
    if (!e->plant.model)
        return apc_fail(why, APC_EINVAL,
                        "%s: the plant is external, and the file names no \"model\" of it: "
                        "there is nothing to simulate",
                        e->file);
    limits = calloc(5 * e->dim.nu + e->plant.model->np, sizeof *limits);
    if (!limits)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    module_outputs(e, limits, limits + e->dim.nu, limits + 2 * e->dim.nu, limits + 3 * e->dim.nu);
    initial = limits + 4 * e->dim.nu;
    p = initial + e->dim.nu;
    for (size_t i = 0; i < e->dim.nu; i++) {
        initial[i] = e->u[i].initial;
        runs |= initial[i] < e->u[i].safe || initial[i] > e->u[i].safe;
    }
    struct apc_plantserver_options options = {
        .size = sizeof options,
        .model = e->plant.model,
        .low = limits,
        .high = limits + e->dim.nu,
        .safe = limits + 2 * e->dim.nu,
        .link_period = e->client.rhythm.period,
        .command_period = module_command_period(e),
        .seed = e->seed,
        .noise = e->plant.noise,
        .disturbance = e->plant.disturbance,
        .n_disturbances = e->plant.n_disturbances,
        .sensor = e->sensor,
        .initial = runs ? initial : NULL,
        .actuator = e->actuator,
    };
    how.integrator = e->plant.integrator[0] ? e->plant.integrator : NULL;
    how.period = apc_ns_to_s(e->plant.rhythm.period);
    rc = experiment_draw(e, e->seed, p, why);
    if (rc == 0)
        rc = apc_plant_create(plant, e->plant.model, p, e->plant.x0, &how, why);
    options.plant = *plant;
    if (rc == 0)
        rc = apc_plantserver_create(server, &options, why);
    if (rc < 0) {
        apc_plant_destroy(*plant);
        *plant = NULL;
    }
    free(limits);
    return rc;
}

/* The parts of a controller's options that are arrays. */
struct wiring {
    void *memory; /* of the arrays */
    int *y, *d;
    apc_ns *y_horizon, *d_horizon;
    bool *told;
    struct apc_controller_setpoint *z;
    struct apc_controller_loop *loop;
    struct apc_controller_peer *peers; /* [n_peers] of all of them */
    size_t n_peers;
};

/* A neighbour with whom others take turns. */
struct turns {
    const struct experiment *e;
    const struct controller *first;
    struct controller_loop (*loop)(const struct controller *c, struct wire signal);
    struct wire signal;
};

static struct controller_loop loop_that_puts_out(const struct controller *c, struct wire output)
{
    size_t i = 0;
    while (i < c->dim.nu && (c->u[i].table != output.table || c->u[i].at != output.at))
        i++;
    return (struct controller_loop){i < c->dim.nu ? c : NULL, i};
}

/* Its first loop, whichever it is: of one that selects it is no matter. */
static struct controller_loop loop_that_selects(const struct controller *c, struct wire signal)
{
    size_t i = 0;
    while (i < c->dim.ny && (c->y[i].table != signal.table || c->y[i].at != signal.at))
        i++;
    return (struct controller_loop){c->law->selects && i < c->dim.ny ? c : NULL, 0};
}

/* The others, and in @p period the longest of all. */
static void find_peers(struct wiring *w, const struct turns *t, struct apc_controller_peers *peers,
                       apc_ns *period)
{
    struct apc_controller_peer *at = w->peers + w->n_peers;
    *peers = (struct apc_controller_peers){.acting = t->first->acting, .at = at};
    for (size_t i = 0; i < t->e->n_controllers; i++) {
        const struct controller *c = &t->e->controllers[i];
        const struct controller_loop loop = t->loop(c, t->signal);
        if (!loop.of || c == t->first || !c->acting || c->acting != t->first->acting)
            continue;
        at[peers->n++] = (struct apc_controller_peer){.number = c->number, .mode = controllers_loop_id(loop)};
        *period = c->rhythm.period > *period ? c->rhythm.period : *period;
    }
    w->n_peers += peers->n;
}

static void wire_setpoint(struct wiring *w, const struct experiment *e, struct wire wire,
                          struct apc_controller_setpoint *z)
{
    const struct apc_tag *tag = &e->z[wire.at].tag;
    const struct controller_loop above = controllers_above(e, wire);
    *z = (struct apc_controller_setpoint){
        .name = tag->name, .id = tag->id, .low = tag->low, .high = tag->high};
    if (!above.of)
        return;
    z->above = controllers_loop_id(above);
    z->above_number = above.of->number;
    z->above_period = above.of->rhythm.period;
    find_peers(w, &(struct turns){e, above.of, loop_that_puts_out, wire}, &z->above_peers, &z->above_period);
}

static void wire_loop(struct wiring *w, const struct experiment *e, struct controller_loop from,
                      struct apc_controller_loop *loop)
{
    const struct controller *c = from.of;
    const struct wire output = c->u[from.u];
    const struct apc_tag *tag = controllers_output(e, from);
    *loop = (struct apc_controller_loop){.name = tag->name,
                                         .mode = controllers_loop_id(from),
                                         .low = tag->low,
                                         .high = tag->high,
                                         .rate = c->rate[from.u],
                                         .hold = c->hold};
    if (output.table == APC_ACTUATOR) {
        loop->id = tag->id;
        loop->fault = e->u[output.at].fault;
        return;
    }
    if (output.table == APC_SENSOR) {
        const struct controller *by = controllers_selector(e, output);
        loop->signal = tag->id;
        loop->below_tick = by ? by->number : 0;
        loop->below_period = by ? by->rhythm.period : 0;
        loop->fault = fmin(fmax(0.0, tag->low), tag->high); /* what an operator begins with */
        if (by)
            find_peers(w, &(struct turns){e, by, loop_that_selects, output}, &loop->below_peers,
                       &loop->below_period);
        return;
    }
    const struct controller_loop below = controllers_below(e, output);
    loop->setpoint = tag->id;
    loop->fault = e->z[output.at].initial;
    loop->below = controllers_loop_id(below);
    loop->below_tick = below.of->number;
    loop->below_period = below.of->rhythm.period;
    find_peers(w, &(struct turns){e, below.of, controllers_below_in, output}, &loop->below_peers,
               &loop->below_period);
}

/* How long what comes every @p period may stay away. */
static apc_ns row_timeout(apc_ns period)
{
    return 3 * period + 100 * APC_NS_PER_MS;
}

apc_ns module_horizon(const struct experiment *e, struct wire wire)
{
    const apc_ns client = e->client.rhythm.period, plant = e->plant.rhythm.period;
    apc_ns by = 0; /* the longest of those that calculate it */
    for (size_t i = 0; i < e->n_controllers; i++)
        if (loop_that_puts_out(&e->controllers[i], wire).of && e->controllers[i].rhythm.period > by)
            by = e->controllers[i].rhythm.period;
    const apc_ns fast = client > plant ? client : plant, own = e->y[wire.at].period;
    return row_timeout(by ? by : own > fast ? own : fast);
}

/* Is it this one, or one of those that take turns with it? */
static bool selects_with(const struct controller *selector, const struct controller *c)
{
    return c == selector || (selector && c->acting && c->acting == selector->acting);
}

static int make_wiring(const struct experiment *e, const struct controller *c, struct wiring *w)
{
    const struct apc_part parts[] = {
        APC_PART(w->y, c->dim.ny),         APC_PART(w->d, c->dim.nd),
        APC_PART(w->y_horizon, c->dim.ny), APC_PART(w->d_horizon, c->dim.nd),
        APC_PART(w->told, c->dim.ny),      APC_PART(w->z, c->dim.nz),
        APC_PART(w->loop, c->dim.nu),      APC_PART(w->peers, (c->dim.nz + c->dim.nu) * e->n_controllers)};
    w->n_peers = 0;
    w->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!w->memory)
        return APC_ENOMEM;
    for (size_t i = 0; i < c->dim.ny; i++) {
        w->y[i] = (int)c->y[i].at + 1;
        w->y_horizon[i] = module_horizon(e, c->y[i]);
        w->told[i] = controllers_above(e, c->y[i]).of && selects_with(controllers_selector(e, c->y[i]), c);
    }
    for (size_t i = 0; i < c->dim.nd; i++) {
        w->d[i] = (int)c->d[i].at + 1;
        w->d_horizon[i] = module_horizon(e, c->d[i]);
    }
    for (size_t i = 0; i < c->dim.nz; i++)
        wire_setpoint(w, e, c->z[i], &w->z[i]);
    for (size_t i = 0; i < c->dim.nu; i++)
        wire_loop(w, e, (struct controller_loop){c, i}, &w->loop[i]);
    return 0;
}

int module_controller(const struct experiment *e, const struct controller *c, bool real_time,
                      struct apc_controller **controller, struct apc_error *why)
{
    const struct apc_law_setup setup = module_law_setup(c),
                               second = c->backup ? module_law_setup(c->backup) : setup;
    const struct apc_controller_backup backup = {.law = c->backup ? c->backup->law : NULL,
                                                 .n_setting = second.n_setting,
                                                 .setting = second.setting,
                                                 .plant = second.plant,
                                                 .param = c->backup ? c->backup->param : NULL,
                                                 .start = c->backup ? c->backup->tuning : NULL};
    struct wiring wiring;
    int rc = make_wiring(e, c, &wiring);
    const struct apc_controller_options options = {
        .size = sizeof options,
        .number = c->number,
        .law = c->law,
        .dim = c->dim,
        .period = c->rhythm.period,
        .budget = c->budget,
        .real_time = real_time,
        .horizon = row_timeout(e->client.rhythm.period),
        .y = wiring.y,
        .d = wiring.d,
        .y_horizon = wiring.y_horizon,
        .d_horizon = wiring.d_horizon,
        .told = wiring.told,
        .z = wiring.z,
        .loop = wiring.loop,
        .tuning = c->first_tuning,
        .estimate = c->first_estimate,
        .prediction = c->first_prediction,
        .acting = c->acting,
        .shadow = c->shadow,
        .output = c->first_output,
        .view = c->view,
        .n_setting = setup.n_setting,
        .setting = setup.setting,
        .plant = setup.plant,
        .param = c->param,
        .start = c->tuning,
        .shed_after = c->shed_after,
        .backup = c->backup ? &backup : NULL,
    };
    *controller = NULL;
    rc = rc < 0 ? apc_fail(why, rc, "out of memory") : apc_controller_create(controller, &options, why);
    free(wiring.memory);
    return rc;
}

int module_scheduler(const struct experiment *e, struct apc_scheduler **scheduler, struct apc_error *why)
{
    struct apc_scheduler_setpoint *z = calloc(e->scheduler.n + 1, sizeof *z);
    *scheduler = NULL;
    if (!z)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < e->scheduler.n; i++) {
        const struct apc_tag *tag = &e->z[e->scheduler.z[i].at].tag;
        z[i] =
            (struct apc_scheduler_setpoint){.name = tag->name, .id = tag->id, .owner = LOOPS_OWNER(tag->id)};
    }
    const struct apc_scheduler_options options = {.size = sizeof options,
                                                  .nz = e->scheduler.n,
                                                  .z = z,
                                                  .steps = e->scheduler.steps,
                                                  .sequence = e->scheduler.sequence,
                                                  .period = e->scheduler.rhythm.period,
                                                  .repeat = e->scheduler.repeat};
    const int rc = apc_scheduler_create(scheduler, &options, why);
    free(z);
    return rc;
}

int module_alarms_number(const struct experiment *e)
{
    return (int)e->n_controllers + 1;
}

int module_alarms(const struct experiment *e, struct apc_alarms **alarms, struct apc_error *why)
{
    struct apc_alarm *alarm = calloc(e->n_alarms + 1, sizeof *alarm);
    *alarms = NULL;
    if (!alarm)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < e->n_alarms; i++)
        alarm[i] = e->alarm[i].is;
    const struct apc_alarms_options options = {.size = sizeof options,
                                               .n = e->n_alarms,
                                               .alarm = alarm,
                                               .number = module_alarms_number(e),
                                               .shelve_max = e->alarms.shelve_max};
    const int rc = apc_alarms_create(alarms, &options, why);
    free(alarm);
    return rc;
}

int module_take_turns(const struct controller *c, struct apc_controller *core, struct apc_store *store,
                      bool *claimed)
{
    const bool named = apc_controller_named(core);
    if (!c->acting || named == *claimed)
        return 0;
    struct apc_sample *output = calloc(c->dim.nu, sizeof *output);
    if (!output)
        return APC_ENOMEM;
    for (size_t i = 0; i < c->dim.nu; i++)
        output[i] = (struct apc_sample){.table = c->u[i].table, .id = (int)c->u[i].at + 1};
    const int rc =
        named ? apc_store_claim_set(store, output, c->dim.nu) : apc_store_release(store, output, c->dim.nu);
    free(output);
    if (rc >= 0)
        *claimed = named;
    apc_controller_claimed(core, *claimed);
    return rc < 0 ? rc : 0;
}

/* ---- What there is at first ------------------------------------------------------------------ */

/* Cas where there is one above that moves the setpoint. */
static enum apc_mode first_mode(const struct experiment *e, struct controller_loop loop)
{
    return loop.of->mode != APC_MODE_CAS || controllers_is_below(e, loop) ? loop.of->mode : APC_MODE_AUTO;
}

struct apc_sample *module_first(const struct experiment *e, apc_ns time, size_t *n)
{
    const struct controller *last = &e->controllers[e->n_controllers - 1];
    const size_t loops = controllers_loops(e),
                 tunings = (size_t)last->first_tuning - 1 + controllers_parameters(last);
    struct apc_sample *first = calloc(loops + tunings + e->dim.nz, sizeof *first), *at = first;
    *n = 0;
    if (!first)
        return NULL;
    for (size_t i = 0; i < loops; i++)
        *at++ = (struct apc_sample){
            .table = APC_OPMODE, .id = (int)i + 1, .value = first_mode(e, controllers_loop(e, i))};
    for (const struct controller *c = e->controllers; c <= last; c++)
        for (const struct controller *law = c; law; law = law->backup)
            for (size_t i = 0; i < apc_law_parameters(law->law, &law->dim); i++)
                *at++ = (struct apc_sample){
                    .table = APC_TUNING, .id = law->first_tuning + (int)i, .value = law->tuning[i]};
    for (size_t k = 0; k < e->dim.nz; k++)
        if (!isnan(e->z[k].initial))
            *at++ = (struct apc_sample){.table = APC_SETPOINT, .id = (int)k + 1, .value = e->z[k].initial};
    *n = (size_t)(at - first);
    for (size_t i = 0; i < *n; i++)
        first[i].time = time;
    return first;
}

int module_client(const struct experiment *e, const int64_t *last, apc_ns since, struct apc_client **client,
                  struct apc_error *why)
{
    const size_t ny = e->dim.ny;
    const apc_ns fast =
        e->client.rhythm.period > e->plant.rhythm.period ? e->client.rhythm.period : e->plant.rhythm.period;
    double *low = calloc(2 * ny, sizeof *low), *high = low ? low + ny : NULL;
    apc_ns *apart = calloc(ny, sizeof *apart);
    int rc = APC_ENOMEM;

    for (size_t i = 0; low && apart && i < ny; i++) {
        low[i] = e->y[i].tag.low > -APC_VALUE_MAX ? e->y[i].tag.low : -HUGE_VAL;
        high[i] = e->y[i].tag.high < APC_VALUE_MAX ? e->y[i].tag.high : HUGE_VAL;
        apart[i] = e->y[i].period - 2 * fast; /* its looks lie a period of either more or less apart */
    }
    const struct apc_client_options options = {.size = sizeof options,
                                               .ny = e->dim.ny,
                                               .nu = e->dim.nu,
                                               .command_period = module_command_period(e),
                                               .last = last,
                                               .since = since,
                                               .low = low,
                                               .high = high,
                                               .apart = apart};
    if (low && apart)
        rc = apc_client_create(client, &options, why);
    else
        (void)apc_fail(why, rc, "out of memory");
    free(apart);
    free(low);
    return rc;
}

apc_ns module_patience(const struct experiment *e)
{
    apc_ns half = e->client.rhythm.period / 2;
    return half < APC_NS_PER_S ? half : APC_NS_PER_S;
}
