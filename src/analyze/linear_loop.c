/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/parts.h"
#include "linear.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define TICKS_MAX 20000 /* of the plant or of controllers before all begins anew */

/* ---- The operating point --------------------------------------------------------------------- */

/* The output is at its controller's operating point, if that has one. */
static void take_controllers(const struct experiment *e, double *u)
{
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];

        for (size_t k = 0; k < c->dim.nu && (c->linear || c->sampled) && !c->shadow; k++)
            if (c->u[k].table == APC_ACTUATOR)
                u[c->u[k].at] = c->plant.u0[k];
    }
}

static int take_named(const struct experiment *e, const struct linear_how *how, double *u,
                      struct apc_error *why)
{
    const struct apc_model *m = e->plant.model;

    for (size_t k = 0; k < how->n_at; k++) {
        double *to = NULL;

        for (size_t i = 0; i < e->dim.nu; i++)
            to = !strcmp(e->u[i].tag.name, how->at[k].name) ? &u[i] : to;
        for (size_t i = 0; m->disturbance && i < m->nd; i++)
            to = !strcmp(m->disturbance[i].name, how->at[k].name) ? &u[m->nu + i] : to;
        if (!to)
            return apc_fail(why, APC_ENOTFOUND,
                            "--at %s: neither an output of the experiment nor a disturbance of %s",
                            how->at[k].name, m->name);
        *to = how->at[k].value;
    }
    return 0;
}

static int check_operating_point(const struct experiment *e, const double *u, struct apc_error *why)
{
    for (size_t i = 0; i < e->dim.nu; i++) {
        const struct apc_tag *tag = &e->u[i].tag;

        if (!(u[i] > tag->low && u[i] < tag->high))
            return apc_fail(
                why, APC_ERANGE,
                "%s is %g at the operating point, and may be %g to %g: at a limit nothing is linear; "
                "take another point: --at %s=VALUE",
                tag->name, u[i], tag->low, tag->high, tag->name);
    }
    return 0;
}

static int find_point(struct linear_loop *l, const struct experiment *e, const struct linear_how *how,
                      struct apc_error *why)
{
    const struct apc_model *m = l->model;
    struct apc_error own;
    int rc;

    for (size_t i = 0; i < m->nx; i++)
        l->x[i] = e->plant.x0 && m == e->plant.model ? e->plant.x0[i] : m->state ? m->state[i].initial : 0.0;
    for (size_t i = 0; i < m->nu; i++)
        l->u[i] = !isnan(e->u[i].initial) && e->u[i].initial > e->u[i].tag.low &&
                          e->u[i].initial < e->u[i].tag.high && e->u[i].initial != e->u[i].safe
                      ? e->u[i].initial
                  : m->input ? m->input[i].initial
                             : 0.0;
    for (size_t i = 0; i < m->nd; i++)
        l->u[m->nu + i] = m->disturbance ? m->disturbance[i].initial : 0.0;
    take_controllers(e, l->u);
    rc = take_named(e, how, l->u, why);
    if (rc == 0)
        rc = check_operating_point(e, l->u, why);
    if (rc < 0)
        return rc;
    rc = apc_model_equilibrium(m, e->plant.p, l->u, l->x, &own);
    if (rc < 0)
        return apc_fail(why, rc == APC_ENOMEM ? rc : APC_ESOLVER,
                        "%s: no steady state was found at these inputs (%s); name others: --at %s=VALUE",
                        m->name, own.text, e->u[0].tag.name);
    return apc_model_evaluate(m, e->plant.p, l->x, l->u, NULL, l->y, why);
}

/* ---- The plant ------------------------------------------------------------------------------- */

static int make_plant(struct linear_loop *l, const struct experiment *e, struct apc_error *why)
{
    const struct apc_model *m = l->model;
    const size_t nx = m->nx, n_in = m->nu + m->nd, ny = m->ny;
    struct apc_loop_plant *p = &l->setup.plant;
    double *A, *B, *C, *D, *b, *d, *noise, *sensor;
    const struct apc_part parts[] = {APC_PART(A, nx * nx),   APC_PART(b, nx * n_in), APC_PART(C, ny * nx),
                                     APC_PART(d, ny * n_in), APC_PART(B, nx * n_in), APC_PART(D, ny * n_in),
                                     APC_PART(noise, nx),    APC_PART(sensor, ny)};

    l->matrices = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!l->matrices)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    const int rc = apc_model_linearize(m, e->plant.p, l->x, l->u, A, b, C, d, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < nx; i++)
        memcpy(B + i * m->nu, b + i * n_in, m->nu * sizeof *B);
    for (size_t i = 0; i < ny; i++)
        memcpy(D + i * m->nu, d + i * n_in, m->nu * sizeof *D);
    for (size_t i = 0; i < nx; i++)
        noise[i] = e->plant.noise ? e->plant.noise[i] : 0.0;
    for (size_t i = 0; i < ny; i++)
        sensor[i] = apc_hypot(e->sensor[i].noise, e->sensor[i].quantum / sqrt(12.0));
    *p = (struct apc_loop_plant){.nx = nx,
                                 .nu = m->nu,
                                 .ny = ny,
                                 .A = A,
                                 .B = B,
                                 .C = C,
                                 .D = D,
                                 .period = e->plant.rhythm.period,
                                 .noise = noise,
                                 .sensor = sensor};
    return apc_ns_from_s(e->plant.options.dead_time, &p->dead_time);
}

/* ---- The laws -------------------------------------------------------------------------------- */

/* The measurement that a setpoint is for: of the loop that has it as its own. */
static double value_of_setpoint(const struct experiment *e, size_t z, const double *y)
{
    const struct controller_loop loop = controllers_below(e, (struct wire){APC_SETPOINT, z});
    const size_t measurement = loop.of ? loop.of->pair[loop.u].measurement : 0;
    if (measurement > 0)
        return y[loop.of->y[measurement - 1].at];
    return isnan(e->z[z].initial) ? 0.0 : e->z[z].initial;
}

/* The number among all outputs of what is above a setpoint and moves it; APC_LOOP_NOWHERE: nobody does. */
static size_t mover_of(const struct linear_loop *l, const struct experiment *e, const struct controller *c,
                       struct wire setpoint)
{
    const struct controller_loop above = controllers_above(e, setpoint);
    size_t first = 0;

    for (size_t i = 0; above.of && c->mode == APC_MODE_CAS && i < l->setup.n_controllers; i++) {
        const struct controller *of = &e->controllers[l->chosen[i]];
        if (of == above.of)
            return first + above.u;
        first += of->dim.nu;
    }
    return APC_LOOP_NOWHERE;
}

static void values_at(const struct linear_loop *l, const struct experiment *e, const struct controller *c,
                      double *y, double *z, double *d, double *u)
{
    for (size_t i = 0; i < c->dim.ny; i++)
        y[i] = l->y[c->y[i].at];
    for (size_t i = 0; i < c->dim.nd; i++)
        d[i] = l->y[c->d[i].at];
    for (size_t i = 0; i < c->dim.nz; i++)
        z[i] = value_of_setpoint(e, c->z[i].at, l->y);
    for (size_t i = 0; i < c->dim.nu; i++)
        u[i] = c->u[i].table == APC_ACTUATOR ? l->u[c->u[i].at] : value_of_setpoint(e, c->u[i].at, l->y);
}

static int make_linear_law(struct linear_loop *l, const struct experiment *e, size_t k,
                           const struct linear_how *how, struct apc_loop_source *source, size_t *to,
                           struct apc_error *why)
{
    const struct controller *c = &e->controllers[l->chosen[k]];
    const struct apc_dim *dim = &c->dim;
    struct apc_law_setup setup = module_law_setup(c);
    double *at = calloc(dim->ny + dim->nz + dim->nd + dim->nu + 1, sizeof *at);

    if (!at)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    double *y = at, *z = y + dim->ny, *d = z + dim->nz, *u = d + dim->nd;
    values_at(l, e, c, y, z, d, u);
    setup.size = sizeof setup;
    setup.Ts /= how->faster > 0 ? how->faster : 1.0;
    const int rc = apc_law_linearize(&l->law[k], c->law, &setup, c->tuning, y, z, d, u, why);
    free(at);
    if (rc < 0)
        return rc;
    const struct apc_law_linear *law = l->law[k];
    l->controller[k] =
        (struct apc_loop_controller){law->nx, law->n_in, law->nu, law->A, law->B, law->C, law->D, source, to};
    for (size_t i = 0; i < dim->ny; i++)
        *source++ = (struct apc_loop_source){APC_FROM_MEASUREMENT, c->y[i].at};
    for (size_t i = 0; i < dim->nz; i++) {
        const size_t mover = mover_of(l, e, c, c->z[i]);
        *source++ = mover == APC_LOOP_NOWHERE ? (struct apc_loop_source){APC_FROM_NONE, 0}
                                              : (struct apc_loop_source){APC_FROM_OUTPUT, mover};
    }
    for (size_t i = 0; i < dim->nd; i++)
        *source++ = (struct apc_loop_source){APC_FROM_MEASUREMENT, c->d[i].at};
    for (size_t i = 0; i < dim->nu; i++) {
        *source++ = (struct apc_loop_source){APC_FROM_OWN, i};
        to[i] = c->u[i].table == APC_ACTUATOR ? c->u[i].at : APC_LOOP_NOWHERE;
    }
    return 0;
}

static int check_controllers(const struct experiment *e, struct apc_error *why)
{
    if (!e->plant.model)
        return apc_fail(
            why, APC_EINVAL,
            "the plant is external, and the file names no \"model\" of it: there is nothing to make "
            "linear; apc identify makes a model from a record");
    if (e->n_signals > 0)
        return apc_fail(
            why, APC_EINVAL,
            "%s is calculated by a controller: selectors, split ranges and filters are choices, which "
            "no linear loop holds; analyse it with the loop that acts alone in its file",
            e->y[e->dim.ny].tag.name);
    for (size_t i = 0; i < e->dim.ny; i++)
        if (e->y[i].period > e->plant.rhythm.period)
            return apc_fail(
                why, APC_EINVAL,
                "%s comes every %g s by itself: a measurement of a laboratory is not taken; leave out "
                "its \"period\"",
                e->y[i].tag.name, apc_ns_to_s(e->y[i].period));
    for (size_t i = 0; i < e->n_controllers; i++)
        if (!strcmp(e->controllers[i].law->name, "nmpc"))
            return apc_fail(
                why, APC_EINVAL,
                "law nmpc is not linear: its estimator and its model change with the state; analyse the "
                "same loop with law mpc");
    return 0;
}

/* ---- The instants ---------------------------------------------------------------------------- */

static apc_ns mean_of_delay(const struct apc_distribution *d)
{
    apc_ns mean = 0;
    if (d->kind && apc_ns_from_s(fmax(0.0, apc_distribution_mean(d)), &mean) < 0)
        mean = 0;
    return mean;
}

static apc_ns floor_to(apc_ns at, apc_ns grid)
{
    const apc_ns down = at / grid * grid;
    return at < down ? down - grid : down;
}

/* A frame's way, once. */
static apc_ns way(const struct experiment *e)
{
    return mean_of_delay(&e->models.network.options.delay) + mean_of_delay(&e->models.network.options.jitter);
}

/* The client reads when its tick begins, and sends when that is over. */
static apc_ns client_offset(const struct experiment *e)
{
    return e->client.rhythm.phase + mean_of_delay(&e->client.rhythm.model.jitter) - e->plant.rhythm.phase;
}

apc_ns linear_acts(const struct experiment *e, apc_ns written)
{
    const apc_ns T = e->client.rhythm.period, h = e->plant.rhythm.period, off = client_offset(e);
    const apc_ns reads = floor_to(written - off, T) + T + off; /* at one instant the client comes first */
    const apc_ns arrives = reads + mean_of_delay(&e->client.rhythm.model.execution) + way(e);
    return floor_to(arrives - mean_of_delay(&e->plant.rhythm.model.execution), h) +
           h; /* and so does the plant */
}

apc_ns linear_sampled(const struct experiment *e, apc_ns at)
{
    const apc_ns T = e->client.rhythm.period, h = e->plant.rhythm.period, off = client_offset(e);
    const apc_ns execution = mean_of_delay(&e->client.rhythm.model.execution);
    const apc_ns began = floor_to(at - off - execution - 2 * way(e), T) + off;
    return floor_to(began + execution + way(e) - mean_of_delay(&e->plant.rhythm.model.execution), h);
}

static apc_ns common_divisor(apc_ns a, apc_ns b)
{
    while (b) {
        const apc_ns rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

static apc_ns period_of_linear_loop(const struct controller *c, const struct linear_how *how)
{
    const double faster = how->faster > 0 ? how->faster : 1.0;
    const apc_ns T = (apc_ns)llround((double)c->rhythm.period / faster);
    return T > 0 ? T : 1;
}

static int find_loop_period(struct linear_loop *l, const struct experiment *e, const struct linear_how *how,
                            struct apc_error *why)
{
    apc_ns all = e->plant.rhythm.period, shortest = all;
    for (size_t k = 0; k <= l->setup.n_controllers; k++) {
        const apc_ns next = k == l->setup.n_controllers
                                ? (how->prompt ? all : e->client.rhythm.period)
                                : period_of_linear_loop(&e->controllers[l->chosen[k]], how);
        if (next <= 0)
            continue;
        shortest = next < shortest ? next : shortest;
        if (all / common_divisor(all, next) > INT64_MAX / next / TICKS_MAX)
            all = INT64_MAX / TICKS_MAX;
        else
            all = all / common_divisor(all, next) * next;
        if (all / shortest > TICKS_MAX)
            return apc_fail(
                why, APC_ERANGE,
                "the periods of plant, client and controllers come together only after more than %d "
                "ticks; round them: --set client.period=... and so on",
                TICKS_MAX);
    }
    l->setup.period = all;
    return 0;
}

static int by_tick_time(const void *a, const void *b)
{
    const struct apc_loop_tick *x = a, *y = b;
    if (x->computed != y->computed)
        return x->computed < y->computed ? -1 : 1;
    return x->controller < y->controller ? -1 : x->controller > y->controller;
}

static int make_ticks(struct linear_loop *l, const struct experiment *e, const struct linear_how *how,
                      struct apc_error *why)
{
    const apc_ns all = l->setup.period, h = e->plant.rhythm.period;
    size_t n = 0;
    for (size_t k = 0; k < l->setup.n_controllers; k++)
        n += (size_t)(all / period_of_linear_loop(&e->controllers[l->chosen[k]], how));
    l->tick = calloc(n + 1, sizeof *l->tick);
    if (!l->tick)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < l->setup.n_controllers; k++) {
        const struct controller *c = &e->controllers[l->chosen[k]];
        const apc_ns T = period_of_linear_loop(c, how);
        for (apc_ns i = 0; i < all / T; i++) {
            struct apc_loop_tick *t = &l->tick[l->setup.n_ticks++];
            apc_ns at = c->rhythm.phase - e->plant.rhythm.phase + mean_of_delay(&c->rhythm.model.jitter);
            at = floor_to(at, T) < 0 || at >= T ? at - floor_to(at, T) : at;
            at = how->prompt ? floor_to(i * T, h) : at + i * T;
            *t = (struct apc_loop_tick){k, at, at, at, at};
            if (how->prompt)
                continue;
            t->sampled = linear_sampled(e, at);
            t->written = at + mean_of_delay(&c->rhythm.model.execution);
            t->acts = linear_acts(e, t->written);
        }
    }
    qsort(l->tick, l->setup.n_ticks, sizeof *l->tick, by_tick_time);
    l->setup.tick = l->tick;
    return 0;
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* Those that act, the ones above first, as they compute at one instant. */
static void choose_acting(struct linear_loop *l, const struct experiment *e)
{
    for (unsigned depth = 0; depth <= e->n_controllers; depth++)
        for (size_t i = 0; i < e->n_controllers; i++)
            if (!e->controllers[i].shadow && e->controllers[i].depth == depth)
                l->chosen[l->setup.n_controllers++] = i;
}

static int allocate_linear_loop(struct linear_loop *l, const struct experiment *e)
{
    const struct apc_model *m = l->model;
    size_t sources = 1, outputs = 1;

    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct apc_dim *dim = &e->controllers[i].dim;
        sources += dim->ny + dim->nz + dim->nd + dim->nu;
        outputs += dim->nu;
    }
    const struct apc_part parts[] = {APC_PART(l->x, m->nx),
                                     APC_PART(l->u, m->nu + m->nd),
                                     APC_PART(l->y, m->ny),
                                     APC_PART(l->scale, outputs),
                                     APC_PART(l->to, outputs),
                                     APC_PART(l->output, outputs),
                                     APC_PART(l->chosen, e->n_controllers),
                                     APC_PART(l->source, sources),
                                     {&l->law, e->n_controllers, sizeof(void *), NULL},
                                     APC_PART(l->controller, e->n_controllers)};
    l->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    return l->memory ? 0 : APC_ENOMEM;
}

static void name_output(struct linear_loop *l, const struct experiment *e, size_t o,
                        struct controller_loop loop)
{
    const struct apc_tag *tag = controllers_output(e, loop);
    const double width = tag->high - tag->low;

    l->output[o] = (size_t)controllers_loop_id(loop) - 1;
    l->scale[o] = isfinite(width) && width > 0.0 ? width : 1.0;
}

int linear_loop_create(struct linear_loop *l, const struct experiment *e, const struct linear_how *how,
                       struct apc_error *why)
{
    struct apc_loop_source *source;
    size_t o = 0;
    int rc = check_controllers(e, why);

    *l = (struct linear_loop){.setup = {.size = sizeof l->setup}};
    if (rc == 0)
        rc = apc_model_equations(e->plant.model, &l->model, why);
    if (rc < 0)
        return rc;
    if (allocate_linear_loop(l, e) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    choose_acting(l, e);
    l->setup.controller = l->controller;
    rc = find_loop_period(l, e, how, why);
    if (rc == 0)
        rc = find_point(l, e, how, why);
    if (rc == 0)
        rc = make_plant(l, e, why);
    source = l->source;
    for (size_t k = 0; k < l->setup.n_controllers && rc == 0; k++) {
        const struct controller *c = &e->controllers[l->chosen[k]];
        rc = make_linear_law(l, e, k, how, source, l->to + o, why);
        source += c->dim.ny + c->dim.nz + c->dim.nd + c->dim.nu;
        for (size_t i = 0; i < c->dim.nu; i++)
            name_output(l, e, o++, (struct controller_loop){c, i});
    }
    if (rc == 0)
        rc = make_ticks(l, e, how, why);
    return rc < 0 ? rc : apc_loop_create(&l->loop, &l->setup, why);
}

void linear_loop_free(struct linear_loop *l)
{
    apc_loop_destroy(l->loop);
    for (size_t k = 0; l->law && k < l->setup.n_controllers; k++)
        free(l->law[k]);
    free(l->memory);
    free(l->tick);
    free(l->matrices);
}
