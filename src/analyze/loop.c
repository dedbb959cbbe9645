/* SPDX-License-Identifier: BSD-3-Clause */
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "base/base_internal.h"
#include "base/matrix.h"

#define STATES_MAX 600

/* ---- Checks ---------------------------------------------------------------------------------- */

static int check_controller(const struct apc_loop_setup *s, size_t outputs,
                            const struct apc_loop_controller *c, struct apc_error *why)
{
    bool good = c->nu && (!c->nx || (c->A && c->C)) && (!c->nx || !c->n_in || c->B) &&
                (!c->n_in || (c->D && c->in)) && c->to;

    for (size_t i = 0; good && i < c->n_in; i++) {
        const size_t n = c->in[i].number;

        good = c->in[i].from == APC_FROM_NONE || (c->in[i].from == APC_FROM_MEASUREMENT && n < s->plant.ny) ||
               (c->in[i].from == APC_FROM_OUTPUT && n < outputs) ||
               (c->in[i].from == APC_FROM_OWN && n < c->nu);
    }
    for (size_t k = 0; good && k < c->nu; k++)
        good = c->to[k] == APC_LOOP_NOWHERE || c->to[k] < s->plant.nu;
    good = good && apc_values_ok(c->A, c->nx * c->nx) && apc_values_ok(c->B, c->nx * c->n_in) &&
           apc_values_ok(c->C, c->nu * c->nx) && apc_values_ok(c->D, c->nu * c->n_in);
    return good ? 0
                : apc_fail(why, APC_EINVAL,
                           "loop: controller %zu: matrices, sources or targets are missing or out of range",
                           (size_t)(c - s->controller) + 1);
}

/* When the tick of the same controller before tick @p k was sampled. */
static apc_ns previous_sampling(const struct apc_loop_setup *s, size_t k)
{
    apc_ns turn = 0;
    size_t j = k;

    do {
        turn -= j == 0 ? s->period : 0;
        j = (j == 0 ? s->n_ticks : j) - 1;
    } while (s->tick[j].controller != s->tick[k].controller);
    return s->tick[j].sampled + turn;
}

static int check_ticks(const struct apc_loop_setup *s, struct apc_error *why)
{
    for (size_t k = 0; k < s->n_ticks; k++) {
        const struct apc_loop_tick *t = &s->tick[k];

        if (t->controller >= s->n_controllers || t->computed < (k ? t[-1].computed : 0) ||
            t->computed > s->period || t->sampled > t->computed ||
            t->computed - t->sampled > 1000 * s->period || t->sampled < previous_sampling(s, k) ||
            t->written < t->computed || t->acts < t->computed)
            return apc_fail(why, APC_EINVAL, "loop: tick %zu: its times are not in order", k + 1);
    }
    return 0;
}

static int check_loop_setup(const struct apc_loop_setup *s, struct apc_error *why)
{
    const struct apc_loop_plant *p = &s->plant;
    size_t outputs = 0;
    int rc;

    if (!p->nu || !p->ny || !s->n_controllers || !s->n_ticks || s->period <= 0 || p->period <= 0 ||
        p->dead_time < 0)
        return apc_fail(why, APC_EINVAL,
                        "loop: a plant with inputs and outputs, periods and ticks are required");
    if ((p->nx && (!p->A || !p->B || !p->C)) || !p->D)
        return apc_fail(why, APC_EINVAL, "loop: the plant's matrices are required");
    if (!apc_values_ok(p->A, p->nx * p->nx) || !apc_values_ok(p->B, p->nx * p->nu) ||
        !apc_values_ok(p->C, p->ny * p->nx) || !apc_values_ok(p->D, p->ny * p->nu))
        return apc_fail(why, APC_EINVAL, "loop: the plant's matrices must hold finite numbers");
    for (size_t c = 0; c < s->n_controllers; c++)
        outputs += s->controller[c].nu;
    rc = check_ticks(s, why);
    for (size_t c = 0; c < s->n_controllers && rc == 0; c++)
        rc = check_controller(s, outputs, &s->controller[c], why);
    return rc;
}

/* ---- The copy -------------------------------------------------------------------------------- */

static const double *copy_matrix(double **at, const double *from, size_t n)
{
    double *to = apc_carve(at, n);

    if (from && n)
        memcpy(to, from, n * sizeof(*to));
    return to;
}

static size_t count_loop_numbers(const struct apc_loop_setup *s)
{
    const struct apc_loop_plant *p = &s->plant;
    size_t n = (p->nx + p->ny) * (p->nx + p->nu + 1);

    for (size_t c = 0; c < s->n_controllers; c++)
        n += (s->controller[c].nx + s->controller[c].nu) * (s->controller[c].nx + s->controller[c].n_in);
    return n + 1;
}

static void copy_plant(struct apc_loop *l, double **at)
{
    struct apc_loop_plant *p = &l->setup.plant;

    p->A = copy_matrix(at, p->A, p->nx * p->nx);
    p->B = copy_matrix(at, p->B, p->nx * p->nu);
    p->C = copy_matrix(at, p->C, p->ny * p->nx);
    p->D = copy_matrix(at, p->D, p->ny * p->nu);
    p->noise = copy_matrix(at, p->noise, p->nx);
    p->sensor = copy_matrix(at, p->sensor, p->ny);
}

static void copy_controllers(struct apc_loop *l, struct apc_loop_controller *to, struct apc_loop_source *in,
                             double **at)
{
    const struct apc_loop_setup *s = &l->setup;
    size_t outputs = 0;

    for (size_t j = 0; j < s->plant.nu; j++)
        l->driver[j] = APC_LOOP_NOWHERE;
    for (size_t c = 0; c < s->n_controllers; c++) {
        const struct apc_loop_controller *from = &s->controller[c];

        to[c] = *from;
        to[c].A = copy_matrix(at, from->A, from->nx * from->nx);
        to[c].B = copy_matrix(at, from->B, from->nx * from->n_in);
        to[c].C = copy_matrix(at, from->C, from->nu * from->nx);
        to[c].D = copy_matrix(at, from->D, from->nu * from->n_in);
        to[c].in = in;
        to[c].to = l->to + outputs;
        l->first[c] = outputs;
        for (size_t i = 0; i < from->n_in; i++) {
            *in++ = from->in[i];
            l->measured[c] += from->in[i].from == APC_FROM_MEASUREMENT;
        }
        for (size_t k = 0; k < from->nu; k++, outputs++) {
            l->owner[outputs] = c;
            l->to[outputs] = from->to[k];
            if (from->to[k] != APC_LOOP_NOWHERE)
                l->driver[from->to[k]] = outputs;
        }
    }
    l->setup.controller = to;
}

int apc_loop_create(struct apc_loop **loop, const struct apc_loop_setup *setup, struct apc_error *why)
{
    struct apc_loop_setup s = {0};
    struct apc_loop *l;
    size_t sources = 1, outputs = 0;
    struct machine m;
    double *at;
    int rc;

    *loop = NULL;
    rc = apc_options_copy(&s, sizeof(s), setup, "apc_loop_setup", why);
    if (rc == 0)
        rc = check_loop_setup(&s, why);
    if (rc < 0)
        return rc;
    for (size_t c = 0; c < s.n_controllers; c++) {
        sources += s.controller[c].n_in;
        outputs += s.controller[c].nu;
    }
    l = calloc(1, sizeof(*l));
    if (!l)
        return apc_fail(why, APC_ENOMEM, "no memory");
    l->setup = s;
    l->n_out = outputs;
    l->numbers = at = calloc(count_loop_numbers(&s), sizeof(*at));
    l->indices = calloc(2 * s.n_controllers + 2 * outputs + s.plant.nu, sizeof(*l->indices));
    l->controllers = calloc(1, s.n_controllers * sizeof(*s.controller) + sources * sizeof(*s.controller->in));
    l->ticks = calloc(s.n_ticks, sizeof(*s.tick));
    if (!at || !l->indices || !l->controllers || !l->ticks) {
        apc_loop_destroy(l);
        return apc_fail(why, APC_ENOMEM, "no memory");
    }
    l->first = l->indices;
    l->measured = l->first + s.n_controllers;
    l->owner = l->measured + s.n_controllers;
    l->to = l->owner + outputs;
    l->driver = l->to + outputs;
    memcpy(l->ticks, s.tick, s.n_ticks * sizeof(*s.tick));
    l->setup.tick = l->ticks;
    copy_plant(l, &at);
    copy_controllers(
        l, l->controllers,
        (struct apc_loop_source *)((struct apc_loop_controller *)l->controllers + s.n_controllers), &at);
    rc = machine_create(&m, l, &(struct schedule){.period = s.period, .n = s.n_ticks, .tick = l->setup.tick},
                        why);
    if (rc == 0 && m.n > STATES_MAX)
        rc = apc_fail(why, APC_ERANGE, "loop: %zu states are more than %d", m.n, STATES_MAX);
    machine_free(&m);
    if (rc < 0)
        apc_loop_destroy(l);
    else
        *loop = l;
    return rc;
}

void apc_loop_destroy(struct apc_loop *loop)
{
    if (!loop)
        return;
    free(loop->numbers);
    free(loop->indices);
    free(loop->controllers);
    free(loop->ticks);
    free(loop);
}

size_t apc_loop_outputs(const struct apc_loop *loop)
{
    return loop->n_out;
}
