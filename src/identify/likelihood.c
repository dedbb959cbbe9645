/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Parameters by maximum likelihood. With an innovation v of variance S, minus the logarithm of the likelihood
 * is (log(2 pi S) + v^2/S)/2. An unknown that moves v by dv and S by dS has the gradient
 *     dv v/S + dS (1 - v^2/S)/(2 S)   and the information   dv^2/S + dS^2/(2 S^2).
 * These are those of least squares with two rows for each measurement: dv/sqrt(S) against v/sqrt(S), and
 * dS/(sqrt(2) S) against (v^2/S - 1)/sqrt(2). So the search of least squares is that of likelihood, by
 * Fisher's scoring, and its R'R is the information.
 */
#include <apcestimate.h>
#include <apcmath.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/parts.h"
#include "identify/parameters.h"
#include "predict/predict_internal.h"

#define FINE   0.01 /* of the fastest mode's time is a step of integration, if that are not more than */
#define STEPS  100
#define MOST   1000 /* steps a period */
#define SHORT  1e-5 /* s: no part of a period is */
#define TWO_PI 6.283185307179586
#define KNOWN  1.0               /* standard error of the logarithm of a noise, at most */
#define NORMAL 1.959963984540054 /* standard deviations to the end of a 95 % interval */
#define NEAR   0.005             /* of them is near enough to the end of an interval */
#define LEAP   10.0              /* times as far is the next try, at most */
#define BETTER 0.01 /* of a likelihood's logarithm: two searches that came to the same end differ by less */
#define TRIES  12   /* to find it */

/* ---- The filter ----------------------------------------------------------------------------------- */

struct filter {
    struct apc_estimator *part, *rest; /* over a period: until an input that is late changes, and after */
    size_t whole;                      /* periods by which it is late, */
    double bit;                        /* and s more */
    double *s, *y;                     /* memory, [model's ny] */
    double *q, *r, *p0;
    void *memory;
};

static void close_filter(struct filter *of)
{
    apc_estimator_destroy(of->part);
    apc_estimator_destroy(of->rest);
    free(of->memory);
}

static int open_estimator(const struct fit *f, const struct filter *of, double period,
                          struct apc_estimator **estimator, struct apc_error *why)
{
    const struct apc_estimator_options options = {.size = sizeof options,
                                                  .kind = APC_KALMAN_EXTENDED,
                                                  .model = f->model,
                                                  .p = f->p,
                                                  .Ts = period,
                                                  .steps = (unsigned)ceil(f->steps * period / f->r.Ts),
                                                  .q = of->q,
                                                  .r = of->r,
                                                  .p0 = of->p0};

    return apc_estimator_create(estimator, &options, why);
}

static int open_filter(const struct fit *f, struct filter *of, struct apc_error *why)
{
    const struct apc_model *m = f->model;
    const size_t nx = m->nx;
    const struct apc_part parts[] = {APC_PART(of->q, nx), APC_PART(of->p0, nx), APC_PART(of->r, m->ny),
                                     APC_PART(of->y, m->ny), APC_PART(of->s, nx + nx * (nx + 1) / 2)};
    int rc = 0;

    of->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!of->memory)
        return APC_ENOMEM;
    of->whole = apc_linear_whole(f->dead_time, f->r.Ts, &of->bit);
    if (of->bit > 0.0 && f->r.Ts - of->bit < SHORT)
        of->whole++;
    if (of->bit < SHORT || f->r.Ts - of->bit < SHORT)
        of->bit = 0.0;
    for (size_t i = 0; i < nx; i++)
        of->q[i] = apc_pow(f->process[i], 2);
    for (size_t i = 0; i < m->ny; i++)
        of->r[i] = 1.0; /* of what is not on record */
    for (size_t i = 0; i < f->r.ny; i++)
        of->r[f->s.output ? f->s.output[i] : i] = apc_pow(f->measured[i], 2);
    if (of->bit > 0.0)
        rc = open_estimator(f, of, of->bit, &of->part, why);
    return rc == 0 ? open_estimator(f, of, f->r.Ts - of->bit, &of->rest, why) : rc;
}

/* Run @p g begins at x0, uncertain by what process noise makes of it in a period. */
static int begin_filter(struct fit *f, const struct filter *of, size_t g, const struct apc_record *run)
{
    const size_t nx = f->model->nx;
    int rc;

    memset(of->s, 0, apc_estimator_size(of->rest) * sizeof(*of->s));
    memcpy(of->s, f->x0 + g * nx, nx * sizeof(*of->s));
    fit_take_inputs(f, g, run, -(double)of->whole);
    rc = apc_estimator_predict(of->rest, of->s, f->u);
    memcpy(of->s, f->x0 + g * nx, nx * sizeof(*of->s));
    return rc;
}

/* y, and its variances behind all y, of sample @p at; a variance of 0: it does not count. */
static int correct_filter(struct fit *f, const struct filter *of, size_t at, bool counts, double *y)
{
    const size_t ny = f->r.ny;
    const struct apc_innovation *v = apc_estimator_innovations(of->rest);

    apc_estimator_output(of->rest, of->s, f->u, f->out);
    for (size_t i = 0; i < f->model->ny; i++)
        of->y[i] = (double)NAN;
    for (size_t i = 0; i < ny; i++)
        of->y[f->s.output ? f->s.output[i] : i] = f->r.y[at * ny + i];
    apc_estimator_correct(of->rest, of->s, of->y, NULL, f->u);
    if (isnan(v[0].variance))
        return APC_ESOLVER;
    for (size_t i = 0; i < ny; i++) {
        const size_t from = f->s.output ? f->s.output[i] : i;
        const bool there = isfinite(of->y[from]) != 0;

        if (there && !(v[from].variance > 0.0 && isfinite(v[from].value)))
            return APC_ESOLVER;
        y[at * ny + i] = there ? of->y[from] - v[from].value : f->out[from];
        y[(f->r.n + at) * ny + i] = there && counts ? v[from].variance : 0.0;
    }
    return 0;
}

static int predict_filter(struct fit *f, const struct filter *of, size_t g, const struct apc_record *run,
                          double k)
{
    int rc = 0;

    if (of->part) {
        fit_take_inputs(f, g, run, k - 1.0);
        rc = apc_estimator_predict(of->part, of->s, f->u);
    }
    fit_take_inputs(f, g, run, k);
    return rc == 0 ? apc_estimator_predict(of->rest, of->s, f->u) : rc;
}

int fit_filter(struct fit *f, double *y, struct apc_error *why)
{
    struct filter of = {.memory = NULL};
    int rc = open_filter(f, &of, why);

    for (size_t g = 0; g < f->runs && rc == 0; g++) {
        const struct apc_record run = apc_record_run(&f->r, g);
        const size_t begin = apc_record_end(&f->r, g) - run.n,
                     share = apc_record_share(&f->r, &run, f->s.until);
        size_t k = 0;

        rc = begin_filter(f, &of, g, &run);
        for (; k < run.n && rc == 0; k++) {
            fit_take_inputs(f, g, &run, (double)k - (double)of.whole);
            rc = correct_filter(f, &of, begin + k, k < share, y);
            if (rc == 0 && k + 1 < run.n)
                rc = predict_filter(f, &of, g, &run, (double)k - (double)of.whole);
        }
        if (rc == APC_ESOLVER)
            apc_fail(why, rc,
                     "likelihood: %s has no answer at sample %zu of record %zu, with the parameters as they "
                     "begin: begin with others, or record where the model holds",
                     f->model->name, k, g + 1);
    }
    close_filter(&of);
    return rc;
}

/* ---- The search ------------------------------------------------------------------------------------ */

double fit_surprise(const struct fit *f, const double *y, double *e)
{
    const size_t n = f->r.n * f->r.ny;
    const double *S = y + n;
    double sum = 0.0;

    memset(e, 0, f->samples * sizeof(*e));
    for (size_t k = 0; k < n; k++) {
        const double v = f->r.y[k] - y[k];

        if (!(S[k] > 0.0))
            continue;
        e[k] = v / sqrt(S[k]);
        e[n + k] = (v * v / S[k] - 1.0) / sqrt(2.0);
        sum += (apc_log(TWO_PI * S[k]) + v * v / S[k]) / 2.0;
    }
    return sum;
}

void fit_weigh_filtered(const struct fit *f, double *column)
{
    const size_t n = f->r.n * f->r.ny;
    const double *S = f->y + n;

    for (size_t k = 0; k < n; k++) {
        const bool counts = S[k] > 0.0;

        column[k] = counts ? column[k] / sqrt(S[k]) : 0.0;
        column[n + k] = counts ? column[n + k] / (sqrt(2.0) * S[k]) : 0.0;
    }
}

/* How much of a measurement's variance, beside that of its own noise, is due to what was before: the mean. */
static int measure_growth(struct fit *f, double *growth, struct apc_error *why)
{
    const size_t n = f->r.n * f->r.ny;
    double counted = 0.0;
    int rc = fit_run(f, f->plus, why);

    *growth = 0.0;
    for (size_t k = 0; k < n && rc == 0; k++) {
        *growth += f->plus[n + k] > 0.0 ? f->plus[n + k] / apc_pow(f->measured[k % f->r.ny], 2) - 1.0 : 0.0;
        counted += f->plus[n + k] > 0.0;
    }
    *growth /= fmax(counted, 1.0);
    return rc;
}

/* The noise of state @p i that doubles the variance of what is measured. */
static int scale_noise(struct fit *f, size_t i, struct apc_error *why)
{
    const double usual = f->model->state ? 0.01 * fabs(f->model->state[i].initial) : 0.0,
                 size = fmax(fabs(f->x0[i]), usual);
    double low = -21.0, high = 14.0, growth = 0.0;
    char number[40];
    int rc = 0;

    snprintf(number, sizeof number, "state %zu", i + 1);
    for (int k = 0; k < 8 && rc != APC_ENOMEM; k++) {
        const double middle = (low + high) / 2.0;

        f->process[i] = apc_exp(middle) * (size > 0.0 ? size : 1.0) / sqrt(f->r.Ts);
        rc = measure_growth(f, &growth, NULL);
        if (rc < 0 || growth > 1.0)
            high = middle;
        else
            low = middle;
    }
    f->scale[i] = f->process[i];
    f->process[i] = 0.0;
    if (rc == APC_ENOMEM || high < 14.0)
        return rc == APC_ENOMEM ? rc : 0;
    return apc_fail(
        why, APC_ESOLVER,
        "likelihood: noise of %s acts on nothing that was measured: name the states that have some",
        f->model->state ? f->model->state[i].name : number);
}

/* Steps of integration that the fastest mode wants, at the steady state near where the first run begins. */
static int choose_steps(struct fit *f, struct apc_error *why)
{
    const size_t nx = f->model->nx;
    double *A = calloc(3 * nx * nx + nx + 1, sizeof(*A)), *x = A ? A + 3 * nx * nx : NULL;
    int rc = A ? 0 : APC_ENOMEM;

    if (rc == 0) {
        memcpy(x, f->x0, nx * sizeof(*x));
        rc = apc_model_equilibrium(f->model, f->p, NULL, x, NULL); /* else x is as it was */
    }
    if (rc != APC_ENOMEM)
        rc = apc_model_linearize(f->model, f->p, x, NULL, A, NULL, NULL, NULL, why);
    const double fast = rc == 0 ? f->r.Ts * apc_spectral_radius(nx, A, A + nx * nx) : 0.0;

    free(A);
    f->steps = (unsigned)fmin(fmax(fmin(ceil(fast / FINE), STEPS), ceil(fast)), MOST) + 1;
    if (rc == 0 && fast > MOST)
        return apc_fail(why, APC_ESOLVER,
                        "likelihood: something in %s takes %.3g s, and samples are %g s apart: sample more "
                        "often, or take a model without it",
                        f->model->name, f->r.Ts / fast, f->r.Ts);
    return rc;
}

int fit_begin_filter(struct fit *f, struct apc_error *why)
{
    int rc = choose_steps(f, why);

    f->filtered = true;
    f->samples = 2 * f->r.n * f->r.ny;
    f->rows = f->samples + f->s.n;
    for (size_t i = 0; i < f->r.ny; i++)
        f->measured[i] = 0.7 * f->deviation[i];
    for (size_t i = 0; i < f->n_noisy && rc == 0; i++)
        rc = scale_noise(f, f->noisy[i], why);
    for (size_t i = 0; i < f->n_noisy; i++)
        f->process[f->noisy[i]] = 0.3 * f->scale[f->noisy[i]];
    fit_set_unknowns(f);
    return rc == 0 ? fit_run(f, f->y, why) : rc;
}

/* ---- What is told ---------------------------------------------------------------------------------- */

int fit_check_noisy(const struct apc_model *model, struct apc_likelihood *of, size_t **all,
                    struct apc_error *why)
{
    if (!model || !of->process || !of->measured)
        return apc_fail(why, APC_EINVAL, "likelihood: a model, process and measured are required");
    for (size_t i = 0; i < of->n_noisy && of->noisy; i++)
        for (size_t k = 0; k <= i; k++)
            if (of->noisy[i] >= model->nx || (k < i && of->noisy[i] == of->noisy[k]))
                return apc_fail(why, APC_EINVAL, "likelihood: noisy states must be different ones of %zu",
                                model->nx);
    if (of->n_noisy > 0 && of->noisy)
        return 0;
    *all = calloc(model->nx + 1, sizeof(**all));
    if (!*all)
        return apc_fail(why, APC_ENOMEM, "likelihood: no memory");
    for (size_t i = 0; i < model->nx; i++)
        (*all)[i] = i;
    of->noisy = *all;
    of->n_noisy = model->nx;
    return 0;
}

int fit_report_likelihood(struct fit *f, double left, struct apc_likelihood *of, struct apc_error *why)
{
    const size_t ny = f->r.ny, n = f->r.n;
    int rc = 0;

    of->value = fit_prior_misfit(f, f->room) / 2.0 - left;
    for (size_t q = 0; q < f->first && rc == 0; q++) {
        const struct unknown *u = &f->unknown[q];
        const bool process = u->kind == PROCESS;
        struct apc_noise *noise = process ? of->process : of->measured;

        if (!process && u->kind != MEASURED)
            continue;
        for (size_t i = 0; process && f->noisy[i] != u->at; i++)
            noise++;
        noise += process ? 0 : u->at;
        noise->error = fit_standard_error(f, 1.0, q, f->small);
        noise->deviation = f->value[q] > u->low ? apc_exp(f->value[q]) : 0.0;
        if (!(noise->error <= KNOWN) || f->value[q] <= u->low)
            noise->error = (double)NAN;
        if (f->value[q] >= u->high)
            rc = apc_fail(why, APC_ESOLVER,
                          "likelihood: noise goes to its limit %g: is it a record of this plant, with these "
                          "inputs, in these units?",
                          apc_exp(f->value[q]));
    }
    for (size_t i = 0; i < ny && of->white && rc == 0; i++) {
        for (size_t k = 0; k < n; k++)
            f->room[k] = f->y[(n + k) * ny + i] > 0.0 ? f->e[k * ny + i] : (double)NAN;
        of->white[i] = apc_white_probability(f->room, n);
    }
    return rc;
}

/* ---- The profile ----------------------------------------------------------------------------------- */

/* How much worse all is with the last unknown, which is none now, at @p value, and the others as suits best: in standard
 * deviations, as the normal distribution has them. HUGE_VAL: the model has no answer there. APC_ESOLVER: it is better. */
static int profile_depth(struct fit *f, const double *best, double left, double value, double *depth,
                         struct apc_error *why)
{
    const struct unknown *of = &f->unknown[f->m];
    double there = 0.0;
    int rc;

    memcpy(f->value, best, f->m * sizeof(*best));
    for (size_t q = 0; q < f->m; q++)
        fit_put(f, q, f->value[q]);
    fit_put(f, f->m, value);
    rc = fit_run(f, f->y, NULL);
    if (rc == 0)
        rc = fit_search(f, &there, NULL);
    *depth = rc == 0 ? sqrt(2.0 * fmax(there - left, 0.0)) : HUGE_VAL;
    if (rc == 0 && there < left - BETTER)
        return apc_fail(why, APC_ESOLVER,
                        "likelihood: with another %s, %.6g, all fits better than where the search ended: let "
                        "it begin there, "
                        "with priors that agree with the record",
                        of->kind == DEAD_TIME ? "dead_time" : f->model->param[of->at].name, value);
    return rc == APC_ENOMEM ? rc : 0;
}

/* Where the last unknown's interval ends towards @p limit. The depth is nearly linear, so the next try is where a line from
 * the best value through the last one leads, between what is known to be too near and too far. */
static int end_profile(struct fit *f, const double *best, double left, double error, double limit,
                       double *end, struct apc_error *why)
{
    const double at = best[f->m], side = limit > at ? 1.0 : -1.0;
    double near = at, far = limit, next = at + side * NORMAL * error;
    bool ends = false;
    int rc = 0;

    *end = (double)NAN;
    for (int k = 0; k < TRIES && rc == 0; k++) {
        double depth;

        next = side * next < side * far ? next : far;
        rc = profile_depth(f, best, left, next, &depth, why);
        *end = next;
        if (rc < 0 || fabs(depth - NORMAL) <= NEAR * NORMAL)
            return rc;
        if (depth < NORMAL && next == limit) {
            *end = (double)NAN;
            return rc;
        }
        ends = ends || depth > NORMAL;
        if (depth < NORMAL)
            near = next;
        else
            far = next;
        next = at + (next - at) * fmin(NORMAL / depth, LEAP);
        if (!(side * next > side * near) || (far != limit && !(side * next < side * far)))
            next = isfinite(far) ? near + (far - near) / 2.0 : near + 2.0 * (near - at);
    }
    if (!ends) /* no limit either: the likelihood falls no further */
        *end = (double)NAN;
    return rc;
}

static void swap_unknowns(struct fit *f, size_t a, size_t b)
{
    const struct unknown u = f->unknown[a];
    const double value = f->value[a];

    f->unknown[a] = f->unknown[b];
    f->unknown[b] = u;
    f->value[a] = f->value[b];
    f->value[b] = value;
}

int fit_profile(struct fit *f, double left, const double *error, struct apc_interval *interval,
                struct apc_error *why)
{
    const size_t last = f->m - 1;
    double *best = calloc(f->m + 1, sizeof(*best));
    int rc = best ? 0 : APC_ENOMEM;

    for (size_t i = 0; i < f->s.n && rc == 0; i++) {
        const size_t q = f->first + i;
        const struct unknown of = f->unknown[q];

        swap_unknowns(f, q, last);
        memcpy(best, f->value, f->m * sizeof(*best));
        f->m = last;
        rc = end_profile(f, best, left, error[i], of.low, &interval[i].low, why);
        if (rc == 0)
            rc = end_profile(f, best, left, error[i], of.high, &interval[i].high, why);
        f->m = last + 1;
        memcpy(f->value, best, f->m * sizeof(*best));
        for (size_t k = 0; k < f->m; k++)
            fit_put(f, k, f->value[k]);
        swap_unknowns(f, q, last);
    }
    free(best);
    return rc == 0 ? fit_run(f, f->y, why) : rc;
}
