/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The covariance of all that is under way, step by step: a linear step F makes F P F' of it, a step at which
 * noise enters adds to its diagonal.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "base/base_internal.h"

#define SETTLED 1e-12
#define PERIODS 200000
#define BEYOND  1e100

struct covariance {
    const struct apc_loop *loop;
    size_t n;
    double *P, *T; /* [n * n] */
    double *y, *u; /* sums of mean squares */
    double looks;  /* weight of them */
};

static void transpose(size_t n, double *P)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            const double keep = P[i * n + j];

            P[i * n + j] = P[j * n + i];
            P[j * n + i] = keep;
        }
    }
}

/* The variance of a row of C, D over x and what acts. */
static double seen(const struct apc_loop *l, const double *P, size_t n, size_t i)
{
    const struct apc_loop_plant *p = &l->setup.plant;
    double sum = 0.0;

    for (size_t a = 0; a < p->nx + p->nu; a++) {
        const size_t ra = a < p->nx ? a : p->nx + l->driver[a - p->nx];
        const double ca = a < p->nx ? p->C[i * p->nx + a] : p->D[i * p->nu + a - p->nx];

        if (ca == 0.0 || (a >= p->nx && l->driver[a - p->nx] == APC_LOOP_NOWHERE))
            continue;
        for (size_t b = 0; b < p->nx + p->nu; b++) {
            const size_t rb = b < p->nx ? b : p->nx + l->driver[b - p->nx];

            if (b < p->nx || l->driver[b - p->nx] != APC_LOOP_NOWHERE)
                sum += ca * (b < p->nx ? p->C[i * p->nx + b] : p->D[i * p->nu + b - p->nx]) * P[ra * n + rb];
        }
    }
    return sum;
}

/* As a run does: moved, disturbed, looked at. */
static void kick(struct covariance *c, double weight)
{
    const struct apc_loop_plant *p = &c->loop->setup.plant;

    for (size_t i = 0; i < p->nx; i++)
        c->P[i * (c->n + 1)] += p->noise[i] * p->noise[i] * apc_ns_to_s(p->period);
    c->looks += weight;
    for (size_t i = 0; i < p->ny && weight > 0.0; i++)
        c->y[i] += weight * seen(c->loop, c->P, c->n, i);
    for (size_t o = 0; o < c->loop->n_out && weight > 0.0; o++)
        c->u[o] += weight * c->P[(p->nx + o) * (c->n + 1)];
}

static void blur(struct covariance *c, const struct machine *m, size_t controller)
{
    const struct apc_loop_setup *s = &c->loop->setup;
    size_t row = m->of[controller].y;

    for (size_t k = 0; k < s->controller[controller].n_in; k++) {
        const struct apc_loop_source *in = &s->controller[controller].in[k];

        if (in->from == APC_FROM_MEASUREMENT) {
            c->P[row * (c->n + 1)] += s->plant.sensor[in->number] * s->plant.sensor[in->number];
            row++;
        }
    }
}

static void propagate_loop_covariance(struct covariance *c, struct machine *m, double weight)
{
    struct ride ride = {.Z = c->P, .width = c->n};

    for (size_t i = 0; i < m->n_steps; i++) {
        const struct step *s = &m->step[i];

        if (s->kind == STEP_KICK) {
            kick(c, weight);
            continue;
        }
        machine_step(m, s, &ride);
        transpose(c->n, c->P);
        machine_step(m, s, &ride);
        if (s->kind == STEP_SAMPLE)
            blur(c, m, s->number);
    }
}

/* ---- Several schedules ------------------------------------------------------------------------- */

/* All with the same rows: what one keeps for longer than another, all keep. */
static void level(struct machine *m, size_t n, size_t controllers)
{
    const struct apc_loop *l = m[0].loop;

    for (size_t c = 0; c < controllers; c++) {
        for (size_t k = 1; k < n; k++) {
            m[0].of[c].samples =
                m[k].of[c].samples > m[0].of[c].samples ? m[k].of[c].samples : m[0].of[c].samples;
            m[0].of[c].computed =
                m[k].of[c].computed > m[0].of[c].computed ? m[k].of[c].computed : m[0].of[c].computed;
        }
    }
    m[0].n = l->setup.plant.nx + l->n_out;
    for (size_t c = 0; c < controllers; c++) {
        struct schedule_of *of = &m[0].of[c];

        of->y = m[0].n;
        of->x = of->y + of->samples * l->measured[c];
        of->u = of->x + l->setup.controller[c].nx;
        m[0].n = of->u + of->computed * l->setup.controller[c].nu;
    }
    for (size_t k = 1; k < n; k++) {
        memcpy(m[k].of, m[0].of, controllers * sizeof(*m[k].of));
        m[k].n = m[0].n;
    }
}

static int covariance_create(struct covariance *c, const struct apc_loop *loop, size_t n)
{
    const size_t ny = loop->setup.plant.ny;

    *c = (struct covariance){.loop = loop, .n = n, .P = calloc(3 * n * n + ny + loop->n_out, sizeof(*c->P))};
    if (!c->P)
        return APC_ENOMEM;
    c->T = c->P + n * n;
    c->y = c->T + 2 * n * n;
    c->u = c->y + ny;
    return 0;
}

static void free_covariance(struct covariance *c)
{
    memset(c->y, 0, (c->loop->setup.plant.ny + c->loop->n_out) * sizeof(*c->y));
    c->looks = 0.0;
}

/* The covariance at the beginning of a period, until it stays. */
static int stationary_covariance(struct covariance *c, struct machine *m, const double *probability, size_t n)
{
    const size_t all = c->n * c->n;
    double *before = c->T, *next = c->T + all;

    for (int k = 0; k < PERIODS; k++) {
        double moved = 0.0, size = 0.0;

        memcpy(before, c->P, all * sizeof(*before));
        memset(next, 0, all * sizeof(*next));
        free_covariance(c);
        for (size_t j = 0; j < n; j++) {
            memcpy(c->P, before, all * sizeof(*before));
            propagate_loop_covariance(c, &m[j], probability[j]);
            for (size_t i = 0; i < all; i++)
                next[i] += probability[j] * c->P[i];
        }
        for (size_t i = 0; i < c->n; i++) {
            moved = fmax(moved, fabs(next[i * (c->n + 1)] - before[i * (c->n + 1)]) /
                                    fmax(next[i * (c->n + 1)], 1e-300));
            size = fmax(size, next[i * (c->n + 1)]);
        }
        memcpy(c->P, next, all * sizeof(*next));
        if (!(size < BEYOND))
            return APC_ESOLVER;
        if (moved < SETTLED)
            return 0;
    }
    return APC_ESOLVER;
}

static void report_variances(const struct covariance *c, double *y, double *u)
{
    for (size_t i = 0; i < c->loop->setup.plant.ny; i++)
        y[i] = c->y[i] / c->looks;
    for (size_t o = 0; o < c->loop->n_out; o++)
        u[o] = c->u[o] / c->looks;
}

static int explain_cost_failure(int rc, struct apc_error *why)
{
    if (rc == APC_ESOLVER)
        return apc_fail(why, rc, "cost: it grows without bound: the loop is not stable under this timing");
    return rc == 0 ? 0 : apc_fail(why, rc, "cost: %s", apc_err_text(rc));
}

static int settle_schedules(const struct apc_loop *loop, const struct apc_loop_schedule *schedule, size_t n,
                            struct machine *m, struct covariance *c)
{
    const struct apc_loop_setup *s = &loop->setup;
    double *probability = calloc(n, sizeof(*probability));
    int rc = probability ? 0 : APC_ENOMEM;

    for (size_t k = 0; k < n && rc == 0; k++) {
        const struct schedule one = {
            .period = s->period, .n = schedule[k].n_ticks, .tick = schedule[k].tick, .kicks = true};

        probability[k] = schedule[k].probability;
        rc = machine_create(&m[k], loop, &one, NULL);
    }
    if (rc == 0) {
        level(m, n, s->n_controllers);
        for (size_t k = 0; k < n && rc == 0; k++)
            rc = machine_widen(&m[k], m[k].n);
    }
    if (rc == 0)
        rc = covariance_create(c, loop, m[0].n);
    if (rc == 0)
        rc = stationary_covariance(c, m, probability, n);
    free(probability);
    return rc;
}

int apc_loop_cost(const struct apc_loop *loop, const struct apc_loop_schedule *schedule, size_t n, double *y,
                  double *u, struct apc_error *why)
{
    const struct apc_loop_schedule own = {1.0, loop->setup.n_ticks, loop->setup.tick};
    const size_t schedules = schedule ? n : 1;
    struct machine *m = calloc(schedules, sizeof(*m));
    struct covariance c = {0};
    int rc = m ? settle_schedules(loop, schedule ? schedule : &own, schedules, m, &c) : APC_ENOMEM;

    if (rc == 0)
        report_variances(&c, y, u);
    for (size_t k = 0; m && k < schedules; k++)
        machine_free(&m[k]);
    free(m);
    free(c.P);
    return explain_cost_failure(rc, why);
}
