/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The search. Every try is kept. Searches by NLopt's Sbplx (T. Rowan's subspace-searching simplex) run beside
 * each other, each a sequence of its own, so that which processor does it cannot be seen in the results:
 * first with effort weighted in several ways, which spreads the tries along the front of IAE against effort,
 * then with the weights that were asked for from the best tries of all. A search that comes to rest before
 * its share of the budget is used begins again elsewhere. What is left of the budget follows the best try of
 * all to its end, by Sbplx and by Powell's quadratic models (BOBYQA).
 */
#include "optimize.h"

#include <apcmath.h>

#include <math.h>
#include <nlopt.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/linear.h"

#define SEARCHES    6    /* beside each other, of the first part; the second has as many */
#define FOLLOWERS   2    /* of the last part */
#define SCATTERED   24   /* tries all over the bounds before them */
#define SHARE       0.3  /* of the budget is for the first part */
#define FOLLOW      0.4  /* of it is for the last one */
#define LIGHTEST    0.02 /* weight of effort there, of that of IAE; each other is four times that before it */
#define STEP        0.15 /* of a search at first, of the bounds */
#define POLISH_STEP 0.1  /* of one that follows */
#define REST        1e-3 /* of the bounds: a search that moves by less has come to rest */
#define POLISH_REST 1e-4 /* likewise of one that follows */
#define STEEP       100  /* cost on the way of a peak twice as high as it may be */
#define UNSTABLE    1e6  /* cost of a try whose plant diverges; the sooner the worse, by up to as much */

/* ---- Numbers -------------------------------------------------------------------------------- */

/* Five digits: what is printed is what was tried. */
static double rounded(double value)
{
    char text[40];
    snprintf(text, sizeof text, "%.5g", value);
    (void)apc_number_parse(text, &value);
    return value;
}

static double value_at(const struct number *n, double x)
{
    const double share = fmin(fmax(x, 0), 1);
    if (share <= 0 || share >= 1)
        return share <= 0 ? n->low : n->high;
    const double value = rounded(n->logarithmic ? n->low * apc_pow(n->high / n->low, share)
                                                : n->low + (n->high - n->low) * share);
    return fmin(fmax(value, n->low), n->high);
}

static double place_in_range(const struct number *n, double value)
{
    return n->logarithmic ? apc_log(value / n->low) / apc_log(n->high / n->low)
                          : (value - n->low) / (n->high - n->low);
}

/* Halton's sequence, which fills the bounds evenly: number @p k, from 1, of coordinate @p i. */
static double halton(unsigned k, size_t i)
{
    static const unsigned prime[OPTIMIZE_NUMBERS] = {2,  3,  5,  7,  11, 13, 17, 19,
                                                     23, 29, 31, 37, 41, 43, 47, 53};
    double x = 0, share = 1;
    for (; k > 0; k /= prime[i]) {
        share /= prime[i];
        x += share * (k % prime[i]);
    }
    return x;
}

/* ---- One try -------------------------------------------------------------------------------- */

struct attempt *optimization_attempt(const struct optimization *z, unsigned i)
{
    return (struct attempt *)(void *)((char *)z->attempts + i * z->stride);
}

int optimization_load(const struct optimization *z, const double *value, struct experiment *e,
                      struct apc_error *why)
{
    struct experiment_setting set[SETTINGS + OPTIMIZE_NUMBERS];
    char text[OPTIMIZE_NUMBERS][40];
    struct experiment_overrides overrides = {.set = set, .n_set = z->own.set.n};
    memcpy(set, z->own.set.at, z->own.set.n * sizeof *set);
    for (size_t i = 0; value && i < z->own.n; i++) {
        (void)apc_number_format(value[i], text[i], sizeof text[i]);
        set[overrides.n_set++] = (struct experiment_setting){z->own.number[i].path, text[i]};
    }
    int rc = experiment_load(e, z->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, why);
    if (rc == 0 && z->own.net && (rc = models_network(&e->models, z->own.net, why)) < 0)
        experiment_free(e);
    if (rc == 0 && z->own.duration > 0)
        e->duration = z->own.duration;
    return rc;
}

static double price(const struct attempt *a, const struct weights *w)
{
    return w->iae * a->iae + w->effort * a->effort + w->overshoot * a->overshoot / 100 +
           w->limits * a->beyond;
}

static double excess(const struct attempt *a, const struct weights *w)
{
    return w->peak > 0 ? fmax(0, a->peak / w->peak - 1) : 0;
}

double optimization_cost(const struct attempt *a, const struct weights *w)
{
    return a->made && a->stable && excess(a, w) <= 0 ? price(a, w) : HUGE_VAL;
}

int optimization_peak(const struct experiment *e, double *peak, struct apc_error *why)
{
    struct linear_loop l;
    struct apc_loop_margins m = {.size = sizeof m};
    int rc = linear_loop_create(&l, e, &(struct linear_how){0}, why);
    *peak = 0;
    for (size_t o = 0; rc == 0 && o < apc_loop_outputs(l.loop); o++)
        if ((rc = apc_loop_peaks(l.loop, o, NULL, &m, why)) == 0)
            *peak = m.stable ? fmax(*peak, m.sensitivity) : HUGE_VAL;
    linear_loop_free(&l);
    return rc;
}

static void relate(const struct optimization *z, struct attempt *a)
{
    a->iae = a->effort = a->overshoot = 0;
    for (size_t i = 0; i < z->loops && a->stable; i++) {
        a->iae += a->loop[3 * i] / z->reference[2 * i] / (double)z->loops;
        a->effort += a->loop[3 * i + 1] / z->reference[2 * i + 1] / (double)z->loops;
        a->overshoot += a->loop[3 * i + 2] / (double)z->loops;
    }
}

static void add_run(const struct optimization *z, const struct trial *t, double duration, struct attempt *a)
{
    const double share = 1.0 / z->own.runs;
    for (size_t i = 0; i < z->loops; i++) {
        const double *f = t->figure + i * METRICS;
        a->loop[3 * i] += share * f[METRIC_IAE];
        a->loop[3 * i + 1] += share * f[METRIC_EFFORT];
        a->loop[3 * i + 2] += share * (isnan(f[METRIC_OVERSHOOT]) ? 0 : f[METRIC_OVERSHOOT]);
        a->stable = a->stable && isfinite(f[METRIC_IAE]) && isfinite(f[METRIC_EFFORT]) &&
                    isfinite(a->loop[3 * i + 2]);
    }
    a->stable = a->stable && t->rc == 0;
    a->beyond += share * t->beyond;
    a->lasted = t->ended / duration;
}

/* The last place behind the attempts of a job is for its runs, one after another. */
static void make_attempt_trial(const struct optimization *z, struct attempt *a, struct trial *t)
{
    struct experiment e;
    struct apc_error why;
    a->made = true;
    a->stable = optimization_load(z, a->value, &e, &why) == 0;
    for (unsigned run = 0; run < z->own.runs && a->stable; run++) {
        memset(t, 0, sizeof *t);
        trial_make(t, &e, z->own.seed + run);
        add_run(z, t, e.duration, a);
        atomic_fetch_add(&z->pool->done, 1);
    }
    if (a->stable && z->own.weights.peak > 0)
        a->stable = optimization_peak(&e, &a->peak, &why) == 0 && isfinite(a->peak);
    experiment_free(&e);
    relate(z, a);
}

/* ---- Jobs ----------------------------------------------------------------------------------- */

/* A part of the search: jobs, each with tries of its own, from `first` on. */
struct stage {
    const struct optimization *z;
    unsigned first, each, jobs;
    struct weights weights[SEARCHES];
    double start[SEARCHES][OPTIMIZE_NUMBERS]; /* from 0 to 1 */
    char *trials;
    size_t trial;
};

static struct trial *trial_of(const struct stage *s, unsigned job)
{
    return (struct trial *)(void *)(s->trials + job * s->trial);
}

static void scatter(void *ctx, unsigned job)
{
    const struct stage *s = ctx;
    const struct optimization *z = s->z;
    struct attempt *a = optimization_attempt(z, job);
    for (size_t i = 0; i < z->own.n; i++)
        a->value[i] = job == 0 ? z->own.number[i].now : value_at(&z->own.number[i], halton(job, i));
    make_attempt_trial(z, a, trial_of(s, job));
}

/* One of NLopt's. */
struct pursuit {
    const struct stage *stage;
    unsigned job, used;
    nlopt_opt opt;
};

static double objective(unsigned n, const double *x, double *gradient, void *ctx)
{
    struct pursuit *p = ctx;
    const struct stage *s = p->stage;
    const struct optimization *z = s->z;
    struct attempt *a = optimization_attempt(z, s->first + p->job * s->each + p->used++);
    (void)gradient; /* none is asked for */
    for (unsigned i = 0; i < n; i++)
        a->value[i] = value_at(&z->own.number[i], x[i]);
    make_attempt_trial(z, a, trial_of(s, p->job));
    if (atomic_load(&z->pool->stop))
        nlopt_force_stop(p->opt);
    const struct weights *w = &s->weights[p->job];
    return a->stable ? price(a, w) + STEEP * excess(a, w) : UNSTABLE * (2 - a->lasted);
}

/* Until it moves by less than @p rest, or its share is used. False: it cannot go on. */
static bool run_local_search(struct pursuit *p, nlopt_algorithm how, double step, double rest, double *x)
{
    const struct stage *s = p->stage;
    const unsigned before = p->used;
    double cost;
    p->opt = nlopt_create(how, (unsigned)s->z->own.n);
    if (!p->opt)
        return false;
    nlopt_set_lower_bounds1(p->opt, 0);
    nlopt_set_upper_bounds1(p->opt, 1);
    nlopt_set_initial_step1(p->opt, step);
    nlopt_set_xtol_abs1(p->opt, rest);
    nlopt_set_maxeval(p->opt, (int)(s->each - p->used));
    nlopt_set_min_objective(p->opt, objective, p);
    nlopt_optimize(p->opt, x, &cost);
    nlopt_destroy(p->opt);
    return p->used > before && p->used < s->each && !atomic_load(&s->z->pool->stop);
}

static void pursue(void *ctx, unsigned job)
{
    const struct stage *s = ctx;
    struct pursuit p = {.stage = s, .job = job};
    double x[OPTIMIZE_NUMBERS];
    memcpy(x, s->start[job], sizeof x);
    for (unsigned again = 0; run_local_search(&p, NLOPT_LN_SBPLX, STEP, REST, x); again++)
        for (size_t i = 0; i < s->z->own.n; i++)
            x[i] = halton(SCATTERED + 1 + job + SEARCHES * again, i);
}

/* Again from where it has come to, ever shorter at first, until it does not move any more: then from there
 * as far as at first. BOBYQA is for two numbers or more. */
static void polish(void *ctx, unsigned job)
{
    const struct stage *s = ctx;
    const nlopt_algorithm how = job == 0 || s->z->own.n < 2 ? NLOPT_LN_SBPLX : NLOPT_LN_BOBYQA;
    struct pursuit p = {.stage = s, .job = job};
    double x[OPTIMIZE_NUMBERS], step = POLISH_STEP;
    memcpy(x, s->start[job], sizeof x);
    while (run_local_search(&p, how, step, POLISH_REST, x))
        step = step > 10 * POLISH_REST ? step / 4 : POLISH_STEP;
}

static int run_stage(struct stage *s, void (*work)(void *ctx, unsigned job), struct apc_error *why)
{
    struct worker_pool *pool = s->z->pool;
    atomic_store(&pool->next, 0);
    pool->jobs = s->jobs;
    return worker_pool_run(pool, s->z->own.jobs, work, s, why);
}

/* ---- What was found ------------------------------------------------------------------------- */

static double cost_of(const struct optimization *z, unsigned i)
{
    return optimization_cost(optimization_attempt(z, i), &z->own.weights);
}

static unsigned best_by(const struct optimization *z, const struct weights *w)
{
    unsigned best = 0;
    for (unsigned i = 1; i < z->tries; i++)
        if (optimization_cost(optimization_attempt(z, i), w) <
            optimization_cost(optimization_attempt(z, best), w))
            best = i;
    return best;
}

static void start_at(struct stage *s, unsigned k, unsigned i)
{
    for (size_t q = 0; q < s->z->own.n; q++)
        s->start[k][q] = place_in_range(&s->z->own.number[q], optimization_attempt(s->z, i)->value[q]);
}

/* The best tries of all, each somewhere else than those before it. */
static unsigned find_starts(const struct optimization *z, struct stage *s)
{
    unsigned found = 0;
    for (unsigned k = 0; k < SEARCHES; k++) {
        unsigned best = z->tries;
        for (unsigned i = 0; i < z->tries; i++) {
            const struct attempt *a = optimization_attempt(z, i);
            bool far = a->made && a->stable;
            for (unsigned other = 0; other < found && far; other++) {
                double apart = 0;
                for (size_t q = 0; q < z->own.n; q++)
                    apart = fmax(apart,
                                 fabs(place_in_range(&z->own.number[q], a->value[q]) - s->start[other][q]));
                far = apart > 0.1;
            }
            if (far && (best == z->tries || cost_of(z, i) < cost_of(z, best)))
                best = i;
        }
        if (best == z->tries)
            break;
        start_at(s, found++, best);
    }
    return found;
}

/* By what is not made last, then by less effort, then by less IAE. */
static int by_effort(const void *a, const void *b, void *ctx)
{
    const struct attempt *x = optimization_attempt(ctx, *(const unsigned *)a),
                         *y = optimization_attempt(ctx, *(const unsigned *)b);
    const double pair[3][2] = {
        {x->stable ? 0 : 1, y->stable ? 0 : 1}, {x->effort, y->effort}, {x->iae, y->iae}};
    for (size_t k = 0; k < 3; k++)
        if (pair[k][0] != pair[k][1])
            return pair[k][0] < pair[k][1] ? -1 : 1;
    return 0;
}

/* Who is worse in IAE than another one with no more effort is not of the front. */
static int find_front(struct optimization *z)
{
    double least = HUGE_VAL;
    z->best = best_by(z, &z->own.weights);
    z->front = calloc(z->tries, sizeof *z->front);
    if (!z->front)
        return APC_ENOMEM;
    for (unsigned i = 0; i < z->tries; i++)
        z->front[i] = i;
    qsort_r(z->front, z->tries, sizeof *z->front, by_effort, z);
    for (unsigned i = 0; i < z->tries; i++) {
        const struct attempt *a = optimization_attempt(z, z->front[i]);
        if (!a->stable || a->iae >= least || excess(a, &z->own.weights) > 0)
            continue;
        least = a->iae;
        z->front[z->n_front++] = z->front[i];
    }
    return 0;
}

static double iae_of(const struct optimization *z, unsigned i)
{
    double sum = 0;
    for (size_t k = 0; k < z->loops; k++)
        sum += optimization_attempt(z, i)->loop[3 * k];
    return optimization_attempt(z, i)->stable ? sum : HUGE_VAL;
}

/* What the present numbers give counts as 1; where they give nothing, what the try with the least IAE does. */
static int find_reference(struct optimization *z, struct apc_error *why)
{
    unsigned i = 0;
    for (unsigned k = 1; k <= SCATTERED && !optimization_attempt(z, 0)->stable; k++)
        i = iae_of(z, k) < iae_of(z, i) ? k : i;
    if (!optimization_attempt(z, i)->stable && atomic_load(&z->pool->stop))
        return apc_fail(why, APC_ESTATE, "ended by a signal before anything was found");
    if (!optimization_attempt(z, i)->stable)
        return apc_fail(why, APC_ERANGE,
                        "the plant diverges with the present numbers and with %d others within these bounds: "
                        "give bounds in which some are stable, or a file that begins with such numbers",
                        SCATTERED);
    for (size_t k = 0; k < z->loops; k++)
        for (size_t q = 0; q < 2; q++) {
            const double value = optimization_attempt(z, i)->loop[3 * k + q];
            z->reference[2 * k + q] = value > 0 ? value : 1;
        }
    for (unsigned k = 0; k <= SCATTERED; k++)
        relate(z, optimization_attempt(z, k));
    return 0;
}

static bool is_search_stopped(const struct optimization *z)
{
    return atomic_load(&z->pool->stop);
}

static int search(struct optimization *z, struct stage *s, struct apc_error *why)
{
    const unsigned left = z->tries - SCATTERED - 1;
    int rc;
    s->jobs = SCATTERED + 1;
    if ((rc = run_stage(s, scatter, why)) < 0 || (rc = find_reference(z, why)) < 0 || is_search_stopped(z))
        return rc;
    *s = (struct stage){.z = z,
                        .first = SCATTERED + 1,
                        .each = (unsigned)(SHARE * left) / SEARCHES,
                        .jobs = SEARCHES,
                        .trials = s->trials,
                        .trial = s->trial};
    for (unsigned k = 0; k < SEARCHES; k++) {
        s->weights[k] = z->own.weights;
        s->weights[k].iae = z->own.weights.iae > 0 ? z->own.weights.iae : 1;
        s->weights[k].effort =
            s->weights[k].iae * LIGHTEST * ldexp(1, (int)(2 * k)); /* to 20 times as heavy as IAE */
        start_at(s, k, best_by(z, &s->weights[k]));
    }
    if ((rc = run_stage(s, pursue, why)) < 0 || is_search_stopped(z))
        return rc;
    s->first += s->jobs * s->each;
    s->jobs = find_starts(z, s);
    s->each = (unsigned)(z->tries - s->first - FOLLOW * left) / s->jobs;
    for (unsigned k = 0; k < SEARCHES; k++)
        s->weights[k] = z->own.weights;
    if ((rc = run_stage(s, pursue, why)) < 0 || is_search_stopped(z))
        return rc;
    s->first += s->jobs * s->each;
    s->jobs = FOLLOWERS;
    s->each = (z->tries - s->first) / s->jobs;
    for (unsigned k = 0; k < s->jobs; k++)
        start_at(s, k, best_by(z, &z->own.weights));
    return run_stage(s, polish, why);
}

int optimization_search(struct optimization *z, struct apc_error *why)
{
    const int loops = metrics_loops(&z->e, z->loop);
    if (loops < 0)
        return apc_fail(why, loops, "no memory");
    z->loops = (size_t)loops;
    z->stride = sizeof(struct attempt) + 3 * z->loops * sizeof(double);
    z->stride = (z->stride + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE;
    z->tries = z->own.budget / z->own.runs;
    const size_t trial = trial_size(z->loops), trials = (SCATTERED + 1) * trial;
    z->size = z->tries * z->stride + trials;
    z->pool = worker_pool_create(z->size, &z->attempts);
    z->reference = calloc(2 * z->loops + 1, sizeof *z->reference);
    struct stage stage = {.z = z, .trial = trial};
    int rc = z->pool && z->reference ? 0 : apc_fail(why, APC_ENOMEM, "no memory for %u tries", z->tries);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < 2 * z->loops; i++)
        z->reference[i] = 1;
    stage.trials = (char *)z->attempts + z->tries * z->stride;
    z->pool->all = z->tries * z->own.runs;
    z->pool->what = "runs";
    if ((rc = search(z, &stage, why)) < 0)
        return rc;
    return find_front(z) < 0 ? apc_fail(why, APC_ENOMEM, "out of memory") : 0;
}
