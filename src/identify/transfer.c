/* SPDX-License-Identifier: BSD-3-Clause */
/* First and second order with dead time, output by output, and what is told of them. */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/parts.h"
#include "identify/search.h"

#define INTERVAL 1.96 /* standard errors either way hold 95 % */

/* ---- What is told ----------------------------------------------------------------------------------- */

static double parameter_deviation(struct search *s, size_t width, double variance, size_t at, double weight,
                                  size_t other, double other_weight)
{
    double *g = s->small, found;

    memset(g, 0, width * sizeof(*g));
    g[at] = weight;
    g[other] += other_weight;
    found = sqrt(variance * apc_qr_variance(width, s->R, s->width, g));
    return isfinite(found) ? found : (double)NAN;
}

/* Two lags that the record makes one of: their mean is known, their difference is not. */
static bool twins(const struct arm *arm)
{
    return arm->lag.order == 2 && fabs(arm->lag.tau[0] - arm->lag.tau[1]) < 0.01 * arm->lag.tau[0];
}

/* An interval that is wider than what is between nothing and the number says nothing of it; and where a
 * search ended at its limit there is none. */
static void hide_untold(const struct search *s, const struct arm *arm, const struct apc_transfer *g,
                        struct apc_transfer *error)
{
    const double all = g->tau[0] + g->tau[1] + s->record->Ts;
    bool short_of_a_sample = false;

    for (size_t i = 0; i < arm->lag.order; i++) {
        if (!(INTERVAL * error->tau[i] < g->tau[i]) || !(g->tau[i] > 1.001 * search_shortest(s)) ||
            !(g->tau[i] < 0.999 * search_longest(s))) {
            error->tau[i] = (double)NAN;
            short_of_a_sample |= g->tau[i] < s->record->Ts;
        }
    }
    if (!(INTERVAL * error->dead_time < fmax(g->dead_time, all)) || short_of_a_sample ||
        (g->dead_time > 0.0 && g->dead_time > 0.999 * s->dead_time_max))
        error->dead_time = (double)NAN;
    if (!(INTERVAL * error->zero < fabs(g->zero)) && arm->zero)
        error->zero = (double)NAN;
}

/* The numbers of each arm, and their standard errors. Time constants the larger one first. */
static int report_transfer(struct search *s, struct apc_transfer *g, struct apc_transfer *error,
                           struct apc_transfer_fit *fit)
{
    struct shape *best = &s->best;
    const size_t linear = search_linear(s, best), all = linear + search_unknowns(s, best);
    size_t at = search_base(s, best), q = linear;
    double variance;
    int rc = search_evaluate(s, best);

    if (rc == 0)
        rc = search_differentiate(s, best);
    if (rc < 0)
        return rc;
    variance = best->left / (double)(s->rows > all ? s->rows - all : 1);
    for (size_t j = 0; j < s->inputs; j++) {
        const struct arm *arm = &best->arm[j];

        if (arm->none) {
            const double no = (double)NAN;

            g[j] = (struct apc_transfer){.gain = 0.0};
            error[j] = (struct apc_transfer){.gain = no, .tau = {no, no}, .zero = no, .dead_time = no};
            continue;
        }
        const bool turned = arm->lag.order == 2 && arm->lag.tau[1] > arm->lag.tau[0];
        const double gain = s->value[at], zero = arm->zero ? s->value[at + 1] / gain : 0.0;

        g[j] = (struct apc_transfer){
            .gain = gain, .zero = zero, .dead_time = arm->lag.dead_time, .integrating = best->integrating};
        error[j] = (struct apc_transfer){.gain = parameter_deviation(s, all, variance, at, 1.0, at, 0.0)};
        if (arm->zero)
            error[j].zero = parameter_deviation(s, all, variance, at + 1, 1.0 / gain, at, -zero / gain);
        for (size_t i = 0; i < arm->lag.order; i++) {
            const size_t place = turned ? 1 - i : i, mate = twins(arm) ? q + 1 - i : q + i;

            g[j].tau[place] = arm->lag.tau[i];
            error[j].tau[place] =
                arm->lag.tau[i] * parameter_deviation(s, all, variance, q + i, 0.5, mate, 0.5);
        }
        q += arm->lag.order;
        error[j].dead_time = s->record->Ts * parameter_deviation(s, all, variance, q, 1.0, q, 0.0);
        q++;
        at += search_arm(s, arm, best->rest);
        hide_untold(s, arm, &g[j], &error[j]);
    }
    *fit = (struct apc_transfer_fit){
        .deviation = sqrt(variance), .noise = (unsigned)s->n_noise, .rest = best->rest, .n_parameters = all};
    return 0;
}

/* Does any input matter? */
static int check_found(struct search *s, const struct apc_transfer *g, const struct apc_transfer *error,
                       struct apc_error *why)
{
    const double found = s->best.score;
    int rc;

    for (size_t j = 0; j < s->inputs; j++) {
        if (fabs(g[j].gain) > 3.0 * error[j].gain)
            return 0;
    }
    search_copy(s, &s->trial, &s->best);
    for (size_t j = 0; j < s->inputs; j++)
        s->trial.arm[j].none = true;
    rc = search_evaluate(s, &s->trial);
    if (rc < 0)
        return apc_fail(why, rc, "apc_identify_transfer: no memory");
    if (found < s->trial.score)
        return apc_fail(why, APC_ESOLVER,
                        "output %zu follows the inputs, but no gain can be found: none is above three times "
                        "its standard error. Record for longer, and hold the inputs until the output settles",
                        s->output + 1);
    return apc_fail(why, APC_ESOLVER,
                    "output %zu does not follow the inputs: no gain is above three times its standard error. "
                    "Move the inputs more, hold them longer than the dead time, or record for longer",
                    s->output + 1);
}

/* How far the output goes at a gain of 1. Of an integrating one all that was done within the record, else
 * what it comes to rest at. */
static int output_reach(struct search *s, size_t j, double *reach)
{
    const struct arm *arm = &s->best.arm[j];
    int rc = 0;

    *reach = apc_record_reach(s->record, s->record->u + j, s->inputs);
    if (arm->lag.integrating) {
        rc = search_respond(s, &arm->lag, j, s->plus, NULL);
        *reach = apc_record_reach(s->record, s->plus, 1);
    }
    return rc;
}

/* Does the answer to a step, as far as the longest run goes, have the sign of the gain? */
static int answers_in_sign(struct search *s, const struct arm *arm, const struct apc_transfer *g, bool *does)
{
    const size_t n = apc_record_longest(s->record);
    double *u = s->plus, *w = s->minus, *rate = s->minus + s->n;
    int rc;

    for (size_t k = 0; k < n; k++)
        u[k] = k > 0;
    rc = apc_lag_response(&arm->lag, s->record->Ts, 0.0, u, 1, n, w, rate);
    *does = rc == 0 && w[n - 1] + g->zero * rate[n - 1] > 0.0;
    return rc;
}

/* What the record does not tell of a gain would be nonsense as a model, whatever it fits. */
static int check_arm(struct search *s, size_t j, const struct apc_transfer *g,
                     const struct apc_transfer *error, struct apc_error *why)
{
    const struct apc_record *r = s->record;
    const struct arm *arm = &s->best.arm[j];
    const double half = INTERVAL * error->gain, all = apc_record_reach(r, r->y + s->output, r->ny);
    bool does = true;
    double reach;
    int rc = output_reach(s, j, &reach);

    if (rc == 0 && arm->zero)
        rc = answers_in_sign(s, arm, g, &does);
    if (rc < 0)
        return apc_fail(why, rc, "apc_identify_transfer: no memory");
    for (size_t i = 0; i < arm->lag.order; i++)
        if (!(g->tau[i] < 0.999 * search_longest(s)))
            return apc_fail(why, APC_ESOLVER,
                            "input %zu to output %zu: no end of a time constant: it is longer than %g times "
                            "the record of %g s. Record for longer, and hold the input until the output "
                            "comes to rest",
                            j + 1, s->output + 1, 50.0, (double)r->n * r->Ts);
    if (!(half < fabs(g->gain)) && !(half * reach < all / 2.0))
        return apc_fail(why, APC_ESOLVER,
                        "input %zu to output %zu: the gain would be %.3g, with a 95 %% interval as wide as "
                        "all that the record "
                        "shows. Record for longer, and hold the input until the output comes to rest",
                        j + 1, s->output + 1, g->gain);
    if (half < fabs(g->gain) && g->dead_time > 0.999 * s->dead_time_max && s->dead_time_max > 0.0)
        return apc_fail(why, APC_ESOLVER,
                        "input %zu to output %zu: no end of the dead time: it is %g s or more. Record for "
                        "longer, or let a longer one be sought",
                        j + 1, s->output + 1, s->dead_time_max);
    if (!does)
        return apc_fail(why, APC_ESOLVER,
                        "input %zu to output %zu: the gain would be %.3g, while the output goes the other "
                        "way for all of the record. Record for longer, and hold the input until the output "
                        "comes to rest",
                        j + 1, s->output + 1, g->gain);
    return 0;
}

static int check_arms(struct search *s, const struct apc_transfer *g, const struct apc_transfer *error,
                      struct apc_error *why)
{
    int rc = 0;

    for (size_t j = 0; j < s->inputs && rc == 0; j++)
        rc = s->best.arm[j].none ? 0 : check_arm(s, j, &g[j], &error[j], why);
    return rc;
}

/* ---- The operating point ------------------------------------------------------------------------------ */

/*
 * Where u0 and y0 are: at the mean of the inputs; or where an output that integrates stands still, and one
 * that would rest where it has never been is at its mean, as near as possible to where the run begins, in
 * units of how much each input moves.
 */
struct rest {
    double begin, slope; /* of an output of a run while all inputs stay as at first */
};

/* How much each input moves, within the runs. */
static void measure_inputs(const struct apc_record *r, double *size)
{
    const size_t inputs = r->nu + r->nd;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const struct apc_record one = apc_record_run(r, g);

        for (size_t j = 0; j < inputs; j++) {
            double mean = 0.0;

            for (size_t k = 0; k < one.n; k++)
                mean += one.u[k * inputs + j] / (double)one.n;
            for (size_t k = 0; k < one.n; k++)
                size[j] += apc_pow(one.u[k * inputs + j] - mean, 2) / (double)r->n;
        }
    }
    for (size_t j = 0; j < inputs; j++)
        size[j] = sqrt(size[j]);
}

/* An output integrates all of its inputs that do anything, or none. */
static bool integrating(const struct apc_transfer *g, size_t inputs)
{
    bool any = false;

    for (size_t j = 0; j < inputs; j++)
        any |= g[j].integrating;
    return any;
}

static double rest_of(const struct apc_record *r, const struct apc_transfer *g, const struct rest *rest,
                      const double *u0)
{
    const size_t inputs = r->nu + r->nd;
    double y = rest->begin;

    for (size_t j = 0; j < inputs && !integrating(g, inputs); j++)
        y += g[j].gain * (u0[j] - r->u[j]);
    return y;
}

static double mean_of_input(const struct apc_record *r, size_t i)
{
    double mean = 0.0, n = 0.0;

    for (size_t k = 0; k < r->n; k++) {
        const double y = r->y[k * r->ny + i];

        mean += isfinite(y) ? y : 0.0;
        n += isfinite(y) != 0;
    }
    return mean / n;
}

/* Of one run. Q [inputs * ny], R [ny * ny], b [ny] are room. */
static void rest_of_run(const struct apc_record *all, size_t run, const struct apc_transfer *g,
                        const struct rest *rest, const double *size, double *Q, double *R, double *b,
                        double *u0, double *y0)
{
    const struct apc_record one = apc_record_run(all, run), *r = &one;
    const size_t inputs = r->nu + r->nd;
    size_t n = 0;

    for (size_t j = 0; j < inputs; j++) {
        u0[j] = 0.0;
        for (size_t k = 0; k < r->n; k++)
            u0[j] += r->u[k * inputs + j] / (double)r->n;
    }
    for (size_t i = 0; i < r->ny; i++) {
        const bool integrates = integrating(g + i * inputs, inputs);

        y0[i] = rest_of(r, g + i * inputs, &rest[i], u0);
        if (!integrates && apc_record_near(all, run, all->y + i, r->ny, y0[i]))
            continue;
        b[n] = integrates ? -rest[i].slope : mean_of_input(r, i) - rest[i].begin;
        for (size_t j = 0; j < inputs; j++)
            Q[n * inputs + j] = g[i * inputs + j].gain * size[j];
        n++;
    }
    if (n == 0)
        return;
    /* The shortest z with (rows of Q) z = b: Q = Q1 R by columns, R'w = b, z = Q1 w. */
    apc_qr_extend(inputs, 0, n, Q, R, r->ny);
    apc_qr_variance(n, R, r->ny, b);
    for (size_t j = 0; j < inputs; j++) {
        u0[j] = r->u[j];
        for (size_t i = 0; i < n; i++)
            u0[j] += size[j] * Q[i * inputs + j] * b[i];
    }
    for (size_t i = 0; i < r->ny; i++)
        y0[i] = rest_of(r, g + i * inputs, &rest[i], u0);
}

/* rest [runs * ny] */
static int place_runs(const struct apc_record *r, const struct apc_transfer *g, const struct rest *rest,
                      double *u0, double *y0, struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd;
    double *size, *Q, *R, *b;
    const struct apc_part parts[] = {APC_PART(size, inputs), APC_PART(Q, inputs * r->ny),
                                     APC_PART(R, r->ny * r->ny), APC_PART(b, r->ny)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "apc_identify_transfer: no memory");
    measure_inputs(r, size);
    for (size_t run = 0; run < apc_record_runs(r); run++)
        rest_of_run(r, run, g, rest + run * r->ny, size, Q, R, b, u0 + run * inputs, y0 + run * r->ny);
    free(memory);
    return apc_record_check_point(r, u0, y0, why);
}

static int take_transfer_options(struct apc_identify_transfer_options *o, const struct apc_record *r,
                                 const struct apc_identify_transfer_options *options, struct apc_error *why)
{
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_identify_transfer_options", why);

    if (rc < 0)
        return rc;
    if (o->dead_time_max == 0.0)
        o->dead_time_max = fmin((double)apc_record_longest(r) / 4.0, 500.0) * r->Ts;
    if (o->order > 2 || !(o->dead_time_max >= 0.0 && o->dead_time_max <= (double)r->n / 2.0 * r->Ts) ||
        (unsigned)o->integrating > APC_INTEGRATING_YES)
        return apc_fail(
            why, APC_EINVAL,
            "apc_identify_transfer: the order must be 1, 2, or 0 to be found, the longest dead time "
            "no more than half of the record of %g s",
            (double)r->n * r->Ts);
    return 0;
}

int apc_identify_transfer(const struct apc_record *record,
                          const struct apc_identify_transfer_options *options, struct apc_transfer *g,
                          struct apc_transfer *error, double *u0, double *y0, struct apc_transfer_fit *fit,
                          struct apc_error *why)
{
    struct apc_identify_transfer_options o = {0};
    struct apc_record r = {0};
    struct rest *rest = NULL;
    size_t inputs = 0, runs = 0;
    int rc = apc_record_check(record, why);

    if (rc == 0)
        rc = apc_options_copy(&r, sizeof(r), record, "apc_record", why);
    if (rc == 0)
        rc = take_transfer_options(&o, &r, options, why);
    if (rc < 0)
        return rc;
    inputs = r.nu + r.nd;
    runs = apc_record_runs(&r);
    rest = calloc(runs * r.ny + 1, sizeof(*rest));
    if (!rest)
        return apc_fail(why, APC_ENOMEM, "apc_identify_transfer: no memory");
    for (size_t i = 0; i < r.ny && rc == 0; i++) {
        struct search s = {.record = &r, .n = r.n, .inputs = inputs, .output = i, .order = o.order};
        struct apc_transfer_fit told;

        s.dead_time_max = o.dead_time_max;
        rc = search_open(&s);
        if (rc == 0)
            rc = search_shape(&s, o.integrating);
        if (rc == 0)
            rc = report_transfer(&s, g + i * inputs, error + i * inputs, &told);
        if (rc < 0) {
            apc_fail(why, rc, "apc_identify_transfer: no memory");
        } else {
            for (size_t run = 0; run < runs; run++) {
                const double moved = search_moved(&s, &s.best, run),
                             all = (double)apc_record_run(&r, run).n * r.Ts;

                rest[run * r.ny + i] = (struct rest){s.value[run], moved};
                if (!s.best.integrating)
                    rest[run * r.ny + i] = (struct rest){s.value[run] + moved, 0.0};
                else if (!s.best.rest)
                    rest[run * r.ny + i].slope += s.value[runs + run] / all;
            }
            if (fit)
                fit[i] = told;
            rc = check_found(&s, g + i * inputs, error + i * inputs, why);
            if (rc == 0)
                rc = check_arms(&s, g + i * inputs, error + i * inputs, why);
        }
        search_close(&s);
    }
    if (rc == 0)
        rc = place_runs(&r, g, rest, u0, y0, why);
    free(rest);
    return rc;
}
