/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Timing that is random becomes schedules of a period with their probabilities: what counts of an execution
 * time is at which of the client's ticks its output goes, so the probabilities are exact, whatever the
 * distribution.
 */
#include "linear.h"

#include <apcmath.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FASTER    10  /* that often does the ideal tick in a period, at most */
#define LATE      200 /* values of a random begin of a tick */
#define SCHEDULES 2000
#define NEVER     1e-9 /* what is less probable is left out, in all no more than RARE */
#define RARE      1e-6

/* ---- Distributions --------------------------------------------------------------------------- */

/* The regularised lower incomplete gamma function, by its series: P(a, x) = x^a e^-x sum x^n / (a)_(n+1). */
static double gamma_below(double shape, double x)
{
    double term = 1.0 / shape, sum = term;

    if (!(x > 0.0))
        return 0.0;
    for (int n = 1; n < 10000 && term > 1e-17 * sum; n++)
        sum += term *= x / (shape + n);
    return fmin(1.0, sum * apc_exp(shape * apc_log(x) - x - apc_lgamma(shape)));
}

/* Of the standard normal distribution: by P(1/2, z^2 / 2), which is how probable |Z| < |z| is. */
static double normal_below(double z)
{
    return fabs(z) < 38.0 ? 0.5 + copysign(0.5 * gamma_below(0.5, 0.5 * z * z), z) : z > 0.0;
}

static double recorded_below(const struct apc_distribution *d, double x)
{
    double before = 0.0, sum = 0.0;

    for (size_t i = 0; i < d->n_shares; i++) {
        const struct apc_share *s = &d->shares[i];
        const double width = s->high - s->low, part = s->share - before;

        before = s->share;
        sum += x >= s->high ? part : x > s->low && width > 0.0 ? part * (x - s->low) / width : 0.0;
    }
    return sum;
}

double distribution_below(const struct apc_distribution *d, double x)
{
    switch (d->kind) {
    case APC_UNIFORM:
        return x <= d->a ? 0.0 : x >= d->b ? 1.0 : (x - d->a) / (d->b - d->a);
    case APC_NORMAL:
        return normal_below(d->b > 0.0 ? (x - d->a) / d->b : x >= d->a ? HUGE_VAL : -HUGE_VAL);
    case APC_EXPONENTIAL:
        return x > 0.0 ? -apc_expm1(-x / d->a) : 0.0;
    case APC_GAMMA:
        return gamma_below(d->a, x / d->b);
    case APC_RECORDED:
        return recorded_below(d, x);
    case APC_CONSTANT:
        return x >= d->a;
    }
    return x >= 0.0;
}

static bool is_random(const struct apc_distribution *d)
{
    return d->kind && d->kind != APC_CONSTANT;
}

/* The @p share quantile, not below 0. */
static double quantile(const struct apc_distribution *d, double share)
{
    double low = 0.0, high = 1e-6;

    if (!is_random(d))
        return d->kind ? fmax(0.0, d->a) : 0.0;
    while (distribution_below(d, high) < share && high < 1e6)
        high *= 2.0;
    for (int k = 0; k < 60; k++)
        *(distribution_below(d, (low + high) / 2.0) < share ? &low : &high) = (low + high) / 2.0;
    return high;
}

/* ---- Trajectories ---------------------------------------------------------------------------- */

struct schedules {
    const struct experiment *e;
    apc_ns period, dead_time;
    struct apc_loop_schedule schedule[SCHEDULES];
    struct apc_loop_tick tick[SCHEDULES];
    size_t n;
    double beyond; /* what would not end with its period, or was too rare */
};

static void add_schedule(struct schedules *c, const struct apc_loop_tick *tick, double probability)
{
    if (!(probability > 0.0))
        return;
    if (probability < NEVER || c->n == SCHEDULES) {
        c->beyond += probability;
        return;
    }
    for (size_t i = 0; i < c->n; i++)
        if (c->tick[i].sampled == tick->sampled && c->tick[i].acts == tick->acts) {
            c->schedule[i].probability += probability;
            return;
        }
    c->tick[c->n] = *tick;
    c->schedule[c->n] = (struct apc_loop_schedule){probability, 1, &c->tick[c->n]};
    c->n++;
}

/* From @p origin until the output acts on the plant; at the end of a period, just before the next one begins. */
static apc_ns until_act(const struct schedules *c, size_t i, apc_ns origin)
{
    const apc_ns until = c->tick[i].acts + c->dead_time - origin;
    return until - (until % c->period == 0);
}

static bool is_within(const struct schedules *c, size_t i, apc_ns origin, apc_ns turns)
{
    return c->tick[i].sampled >= origin && c->tick[i].computed < origin + c->period &&
           until_act(c, i, origin) / c->period == turns;
}

/*
 * The probability of what does not fit into periods that begin at @p origin, in each of which an output acts
 * once: those of all schedules as many periods later, *@p turns. Acting in a later one it is drawn by itself,
 * so that measurements must not depend on the draw.
 */
static double outside(const struct schedules *c, apc_ns origin, bool begins_late, apc_ns *turns)
{
    size_t likely = 0;
    double sum = 0.0;

    for (size_t i = 1; i < c->n; i++)
        likely = c->schedule[i].probability > c->schedule[likely].probability ? i : likely;
    *turns = until_act(c, likely, origin) / c->period;
    for (size_t i = 0; i < c->n; i++)
        if (!is_within(c, i, origin, *turns) ||
            (*turns > 0 && (begins_late || c->tick[i].sampled != c->tick[likely].sampled)))
            sum += c->schedule[i].probability;
    return sum;
}

/* Cut time into periods where least is cut apart, from @p origin back; schedules then count from there. */
static void cut_into_periods(struct schedules *c, apc_ns origin, bool begins_late)
{
    const apc_ns step = c->e->plant.rhythm.period;
    apc_ns best = origin, turns = 0;
    double least = outside(c, origin, begins_late, &turns);
    size_t n = 0;

    for (apc_ns at = origin - step; at > origin - c->period && least > 0.0; at -= step) {
        const double sum = outside(c, at, begins_late, &turns);
        best = sum < least ? at : best;
        least = fmin(sum, least);
    }
    c->beyond += outside(c, best, begins_late, &turns);
    for (size_t i = 0; i < c->n; i++) {
        struct apc_loop_tick *t = &c->tick[n];
        const double probability = c->schedule[i].probability;
        const apc_ns acts = until_act(c, i, best) - c->dead_time;

        if (!is_within(c, i, best, turns))
            continue;
        *t = c->tick[i];
        t->sampled -= best;
        t->computed -= best;
        t->written -= best;
        t->acts = acts;
        c->schedule[n++] = (struct apc_loop_schedule){probability, 1, t};
    }
    c->n = n;
}

/* Exchanges that fail: the output goes with a later one, the measurement came with one before. */
static void add_losses(struct schedules *c, const struct apc_loop_tick *tick, double probability, double loss)
{
    const apc_ns T = c->e->client.rhythm.period;
    const double in_vain = 1.0 - (1.0 - loss) * (1.0 - loss);
    double before = 1.0;

    for (int i = 0; i < 1000 && before > 0.0 && (i == 0 || probability * before > NEVER); i++) {
        struct apc_loop_tick t = *tick;
        double after = 1.0;
        t.sampled = linear_sampled(c->e, tick->computed - i * T);
        for (int k = 0; k < 1000 && after > 0.0 && (k == 0 || probability * before * after > NEVER); k++) {
            t.acts = linear_acts(c->e, tick->written + k * T);
            add_schedule(c, &t, probability * before * (1.0 - in_vain) * after * (1.0 - loss));
            after *= loss;
        }
        before *= in_vain;
    }
}

/* A tick that begins @p late s late. Each of the client's ticks gets the share of execution times whose
 * outputs wait for it. */
static void add_executions(struct schedules *c, const struct rhythm *r, apc_ns at, double late,
                           double probability, double loss)
{
    const apc_ns T = c->e->client.rhythm.period;
    struct apc_loop_tick tick = {.computed = at};
    apc_ns shift = 0, known;
    double below = 0.0;

    (void)apc_ns_from_s(late, &shift);
    tick.computed += shift;
    tick.sampled = linear_sampled(c->e, tick.computed);
    known = linear_acts(c->e, tick.computed);
    tick.written = tick.computed;
    for (int k = 0; k < 100000 && below < 1.0 - 1e-12 && tick.written < at + 2 * c->period; k++) {
        double here;
        /* the last instant at which what is written goes with the same tick */
        apc_ns last = tick.written;
        for (apc_ns step = T; step > 0; step /= 2)
            while (linear_acts(c->e, last + step) == known)
                last += step;
        here = distribution_below(&r->model.execution, apc_ns_to_s(last - tick.computed));
        tick.acts = known;
        add_losses(c, &tick, probability * (here - below), loss);
        below = fmax(below, here);
        tick.written = last + 1;
        known = linear_acts(c->e, tick.written);
    }
    c->beyond += probability * (1.0 - below);
}

static int schedule_cost(const struct experiment *e, const struct linear_loop *l, double loss, double *y,
                         double *u, bool *known, struct apc_error *why)
{
    const struct rhythm *r = &e->controllers[l->chosen[0]].rhythm;
    struct schedules *c = calloc(1, sizeof *c);
    const size_t late = is_random(&r->model.jitter) ? LATE : 1;
    int rc;

    if (!c)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    c->e = e;
    c->period = l->setup.period;
    c->dead_time = l->setup.plant.dead_time;
    const apc_ns at = c->period + r->phase - e->plant.rhythm.phase;
    for (size_t k = 0; k < late; k++)
        add_executions(c, r, at, quantile(&r->model.jitter, ((double)k + 0.5) / (double)late),
                       1.0 / (double)late, loss);
    if (c->n > 0)
        cut_into_periods(c, linear_sampled(e, at), late > 1);
    *known = c->beyond < RARE && c->n > 0;
    for (size_t i = 0; i < c->n; i++)
        c->schedule[i].probability /= 1.0 - c->beyond;
    rc = *known ? apc_loop_cost(l->loop, c->schedule, c->n, y, u, why) : 0;
    free(c);
    return rc;
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* What grows without bound is infinite, which is no error. */
static int bounded(int rc, double *y, size_t ny)
{
    for (size_t i = 0; i < ny && rc == APC_ESOLVER; i++)
        y[i] = HUGE_VAL;
    return rc == APC_ESOLVER ? 0 : rc;
}

static int other_loop(struct linear_cost *c, const struct experiment *e, const struct linear_how *how,
                      enum linear_cause cause, double *u, struct apc_error *why)
{
    struct linear_loop l;
    struct apc_error own;
    int rc = linear_loop_create(&l, e, how, &own);

    c->known[cause] = rc == 0;
    if (rc == 0)
        rc = bounded(apc_loop_cost(l.loop, NULL, 0, c->y[cause], u, why), c->y[cause], e->dim.ny);
    else
        rc = rc == APC_ENOMEM ? apc_fail(why, rc, "%s", own.text) : 0; /* a law that cannot tick so often */
    linear_loop_free(&l);
    return rc;
}

static double how_often(const struct experiment *e, const struct linear_loop *l)
{
    apc_ns least = INT64_MAX;
    int times = FASTER;

    for (size_t k = 0; k < l->setup.n_controllers; k++) {
        const apc_ns T = e->controllers[l->chosen[k]].rhythm.period;
        least = T < least ? T : least;
    }
    while (times > 1 && least % (times * e->plant.rhythm.period) != 0)
        times--;
    return times;
}

static bool jitters(const struct experiment *e, const struct linear_loop *l)
{
    bool any = false;
    for (size_t k = 0; k < l->setup.n_controllers; k++) {
        const struct task_model *m = &e->controllers[l->chosen[k]].rhythm.model;
        any |= is_random(&m->execution) || is_random(&m->jitter);
    }
    return any;
}

/* Why schedules of a period say nothing; "": they do. */
static const char *not_one_period(const struct experiment *e, const struct linear_loop *l)
{
    const struct apc_network_options *n = &e->models.network.options;
    if (l->setup.n_ticks != 1)
        return "several ticks before plant, client and controllers come together again: what jitter and loss "
               "cost is not known";
    if (is_random(&n->delay) || is_random(&n->jitter) || is_random(&e->client.rhythm.model.execution) ||
        is_random(&e->client.rhythm.model.jitter))
        return "delays of the network and the client count as constant, by their means";
    return "";
}

static int add_random(struct linear_cost *c, const struct experiment *e, const struct linear_loop *l,
                      double *u, struct apc_error *why)
{
    static const char long_ones[] =
        "some ticks take longer than the period has room for: what jitter and loss "
        "cost is not known";
    const double loss[] = {0.0, e->models.network.options.loss};
    const bool wanted[] = {jitters(e, l), loss[1] > 0.0};
    int rc = 0;

    snprintf(c->unknown, sizeof c->unknown, "%s", wanted[0] || wanted[1] ? not_one_period(e, l) : "");
    for (int k = 0; k < 2 && rc == 0; k++) {
        const enum linear_cause cause = k == 0 ? COST_JITTER : COST_LOSS;
        if (!wanted[k]) {
            memcpy(c->y[cause], c->y[cause - 1], e->dim.ny * sizeof *c->y[cause]);
            c->known[cause] = c->known[cause - 1];
        } else if (l->setup.n_ticks == 1) {
            rc = bounded(schedule_cost(e, l, loss[k], c->y[cause], u, &c->known[cause], why), c->y[cause],
                         e->dim.ny);
            if (!c->known[cause])
                snprintf(c->unknown, sizeof c->unknown, "%s", long_ones);
        }
    }
    return rc;
}

int linear_cost_create(struct linear_cost *c, const struct experiment *e, const struct linear_loop *l,
                       const struct linear_how *how, struct apc_error *why)
{
    struct linear_how other = *how;
    double *u;
    int rc;

    *c = (struct linear_cost){.faster = how_often(e, l)};
    c->memory = calloc(COST_CAUSES * e->dim.ny + apc_loop_outputs(l->loop), sizeof *c->memory);
    if (!c->memory)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (int k = 0; k < COST_CAUSES; k++)
        c->y[k] = c->memory + (size_t)k * e->dim.ny;
    u = c->memory + COST_CAUSES * e->dim.ny;
    other.prompt = true;
    rc = other_loop(c, e, &other, COST_PERIOD, u, why);
    other.faster = c->faster;
    if (rc == 0 && c->faster > 1.0)
        rc = other_loop(c, e, &other, COST_IDEAL, u, why);
    c->known[COST_LATENCY] = true;
    if (rc == 0)
        rc = bounded(apc_loop_cost(l->loop, NULL, 0, c->y[COST_LATENCY], u, why), c->y[COST_LATENCY],
                     e->dim.ny);
    return rc == 0 ? add_random(c, e, l, u, why) : rc;
}

void linear_cost_free(struct linear_cost *c)
{
    free(c->memory);
}
