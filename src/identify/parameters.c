/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Parameters of a model of differential equations, with where each run begins, so that its free run goes best
 * with what was measured: Gauss and Newton's iteration, damped as Marquardt did. How y moves with each
 * unknown is had from two runs beside the present one; y itself by the plant's own integrator. Errors count
 * as they scatter, output by output, whitened by an autoregression.
 */
#include <apcmath.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"
#include "identify/parameters.h"

#define STEP     1e-4  /* of an unknown's size, to either side */
#define ROUNDS   3     /* of what errors are expected to be like */
#define APART    1e-3  /* of what an unknown does that nothing else does, at least */
#define TOGETHER 0.1   /* of it that another does which is named with it */
#define NONE     1e-12 /* variance, of errors that are none */
#define REACH    9.0   /* of a noise's logarithm, to either side of what could be expected */

/* ---- Running -------------------------------------------------------------------------------------- */

void fit_put(struct fit *f, size_t q, double value)
{
    const struct unknown *of = &f->unknown[q];

    if (of->kind == STATE)
        f->x0[of->run * f->model->nx + of->at] = value;
    else if (of->kind == BEFORE)
        f->before[of->run * LEVELS * f->inputs + of->at] = value;
    else if (of->kind == PROCESS)
        f->process[of->at] = apc_exp(value);
    else if (of->kind == MEASURED)
        f->measured[of->at] = apc_exp(value);
    else if (of->kind == PARAMETER)
        f->p[of->at] = value;
    else
        f->dead_time = value;
}

/* The inputs of sample @p k of run @p g; of one before it the level that is known of, the last one of all
 * that are older. */
static const double *inputs_of(const struct fit *f, size_t g, const struct apc_record *run, double k)
{
    const double ago = fmin(-k, (double)f->levels);

    if (k >= 0.0 || f->levels == 0)
        return run->u + (k > 0.0 ? (size_t)k : 0) * f->inputs;
    return f->before + (g * LEVELS + (size_t)ago - 1) * f->inputs;
}

/* Do inputs act that were before a run? */
bool fit_acts_late(const struct fit *f)
{
    bool late = f->plant.dead_time > 0.0 || f->dead_time > 0.0;

    for (size_t i = 0; i < f->s.n; i++)
        late |= f->s.which[i] == f->model->np;
    return late;
}

void fit_take_inputs(struct fit *f, size_t g, const struct apc_record *run, double k)
{
    const double *u = inputs_of(f, g, run, k);

    for (size_t j = 0; j < f->inputs; j++)
        f->u[f->s.input ? f->s.input[j] : j] = u[j];
}

static int drive_fit(struct fit *f, struct apc_plant *plant, size_t g, const struct apc_record *run, double k)
{
    int rc = 0;

    fit_take_inputs(f, g, run, k);
    for (size_t j = 0; j < f->model->nd && rc == 0; j++)
        rc = apc_plant_disturb(plant, j, f->u[f->model->nu + j]);
    return rc;
}

/* A sample on: the input changes within it, where it acts a part of a period late. */
static int advance_fit(struct fit *f, struct apc_plant *plant, size_t g, const struct apc_record *run,
                       size_t k)
{
    const double late = f->dead_time / run->Ts, whole = floor(late + 1e-9), part = late - whole;
    int rc = 0;

    if (part > 1e-9) {
        rc = drive_fit(f, plant, g, run, (double)k - whole - 1.0);
        if (rc == 0)
            rc = apc_plant_advance(plant, part * run->Ts, f->u);
    }
    if (rc == 0)
        rc = drive_fit(f, plant, g, run, (double)k - whole);
    return rc == 0 ? apc_plant_advance(plant, fmin(1.0 - part, 1.0) * run->Ts, f->u) : rc;
}

/* y [n * ny] as the numbers in p, x0 and dead_time say. APC_ESOLVER: they have no answer. */
int fit_run(struct fit *f, double *y, struct apc_error *why)
{
    const size_t ny = f->r.ny;
    int rc = 0;

    apc_param_initials(f->model->input, f->model->nu, f->u);
    apc_param_initials(f->model->disturbance, f->model->nd, f->u + f->model->nu);
    if (f->filtered)
        return fit_filter(f, y, why);
    for (size_t g = 0; g < f->runs && rc == 0; g++) {
        const struct apc_record run = apc_record_run(&f->r, g);
        double *to = y + (apc_record_end(&f->r, g) - run.n) * ny;
        struct apc_plant *plant = NULL;

        rc = apc_plant_create(&plant, f->model, f->p, f->x0 + g * f->model->nx, &f->plant, why);
        for (size_t k = 0; k < run.n && rc == 0; k++) {
            rc = drive_fit(f, plant, g, &run, (double)k - floor(f->dead_time / run.Ts + 1e-9));
            apc_plant_output(plant, f->u, f->out);
            for (size_t i = 0; i < ny; i++)
                to[k * ny + i] = f->out[f->s.output ? f->s.output[i] : i];
            if (rc == 0 && k + 1 < run.n)
                rc = advance_fit(f, plant, g, &run, k);
        }
        if (rc == APC_ESOLVER && plant)
            apc_fail(why, rc, "parameters: %s", apc_plant_error(plant));
        apc_plant_destroy(plant);
    }
    return rc;
}

/* ---- Errors --------------------------------------------------------------------------------------- */

/* The samples of a run that are fitted to, and where they begin. */
static size_t fitted_of(const struct fit *f, size_t g, size_t *begin)
{
    const struct apc_record run = apc_record_run(&f->r, g);

    *begin = apc_record_end(&f->r, g) - run.n;
    return apc_record_share(&f->r, &run, f->s.until);
}

/* Column [rows], in units of what errors scatter by and whitened as they are; 0 where none counts. It becomes
 * output after output. */
static void weigh_residuals(const struct fit *f, double *column)
{
    const size_t ny = f->r.ny;
    double *room = f->room;

    memset(room, 0, f->samples * sizeof(*room));
    for (size_t i = 0; i < ny; i++) {
        double *to = room + i * f->r.n;

        for (size_t g = 0; g < f->runs; g++) {
            size_t begin, n = fitted_of(f, g, &begin);

            for (size_t k = 0; k < n; k++) {
                const size_t at = (begin + k) * ny + i;

                to[begin + k] = isfinite(f->r.y[at]) ? column[at] / f->deviation[i] : (double)NAN;
            }
            apc_whiten(to + begin, n, f->noise + i * NOISE_MOST, (size_t)f->order[i], to + begin);
        }
    }
    for (size_t k = 0; k < f->samples; k++)
        column[k] = isfinite(room[k]) ? room[k] : 0.0;
}

static const struct apc_prior *prior_of(const struct fit *f, size_t i)
{
    return f->s.prior && f->s.prior[i].deviation > 0.0 ? &f->s.prior[i] : NULL;
}

double fit_prior_misfit(const struct fit *f, double *e)
{
    for (size_t i = 0; i < f->s.n; i++) {
        const struct apc_prior *prior = prior_of(f, i);
        const size_t at = f->s.which[i];

        e[i] = prior ? (prior->mean - (at < f->model->np ? f->p[at] : f->dead_time)) / prior->deviation : 0.0;
    }
    return apc_matrix_dot(e, e, f->s.n);
}

double fit_misfit(const struct fit *f, const double *y, double *e)
{
    const double prior = fit_prior_misfit(f, e + f->samples);

    if (f->filtered)
        return fit_surprise(f, y, e) + prior / 2.0;
    for (size_t k = 0; k < f->samples; k++)
        e[k] = isfinite(f->r.y[k]) ? f->r.y[k] - y[k] : 0.0;
    weigh_residuals(f, e);
    return apc_matrix_dot(e, e, f->samples) + prior;
}

/* From what is left of y: how it scatters, and by which autoregression. Returns 0 or APC_ENOMEM. */
static int expect(struct fit *f, const double *y)
{
    const size_t n = f->r.n, ny = f->r.ny;

    for (size_t i = 0; i < ny; i++) {
        double *e = f->room, *a = f->noise + i * NOISE_MOST, sum = 0.0, there = 0.0;

        for (size_t k = 0; k < n; k++)
            e[k] = (double)NAN;
        for (size_t g = 0; g < f->runs; g++) {
            size_t begin, share = fitted_of(f, g, &begin);

            for (size_t k = g > 0; k < share; k++) /* none hangs on those of the run before */
                e[begin + k] = f->r.y[(begin + k) * ny + i] - y[(begin + k) * ny + i];
        }
        f->order[i] = apc_autoregression(e, n, NOISE_MOST, a);
        if (f->order[i] < 0)
            return f->order[i];
        apc_whiten(e, n, a, (size_t)f->order[i], e);
        for (size_t k = 0; k < n; k++) {
            sum += isfinite(e[k]) ? e[k] * e[k] : 0.0;
            there += isfinite(e[k]) != 0;
        }
        f->deviation[i] = fmax(sqrt(sum / fmax(there, 1.0)), 1e-9 * f->deviation[i]);
    }
    return 0;
}

/* How many errors count. */
size_t fit_counted(const struct fit *f)
{
    size_t rows = 0;

    for (size_t g = 0; g < f->runs; g++) {
        size_t begin, n = fitted_of(f, g, &begin);

        for (size_t k = begin * f->r.ny; k < (begin + n) * f->r.ny; k++)
            rows += isfinite(f->r.y[k]) != 0;
    }
    return rows;
}

/* Rows of Q where priors are: minus the derivative of e, as in all of its rows. */
static void differentiate_priors(const struct fit *f, size_t q, double *out)
{
    const struct unknown *of = &f->unknown[q];

    for (size_t i = 0; i < f->s.n; i++) {
        const struct apc_prior *prior =
            of->kind == PARAMETER || of->kind == DEAD_TIME ? prior_of(f, i) : NULL;

        out[i] = prior && f->s.which[i] == of->at ? f->scatter * of->size / prior->deviation : 0.0;
    }
}

/* Q R = how y moves with each unknown. */
int fit_differentiate(struct fit *f, struct apc_error *why)
{
    int rc = 0;

    for (size_t q = 0; q < f->m && rc == 0; q++) {
        const struct unknown *of = &f->unknown[q];
        const double at = f->value[q], up = fmin(at + STEP * of->size, of->high),
                     down = fmax(at - STEP * of->size, of->low);
        double *out = f->Q + q * f->rows;

        fit_put(f, q, up);
        rc = fit_run(f, f->plus, why);
        fit_put(f, q, down);
        if (rc == 0)
            rc = fit_run(f, f->minus, why);
        fit_put(f, q, at);
        for (size_t k = 0; k < f->samples && rc == 0; k++)
            out[k] = (f->plus[k] - f->minus[k]) / (up - down) * of->size;
        if (f->filtered)
            fit_weigh_filtered(f, out);
        else
            weigh_residuals(f, out);
        differentiate_priors(f, q, out + f->samples);
    }
    if (rc == 0)
        apc_qr_extend(f->rows, 0, f->m, f->Q, f->R, f->m);
    return rc;
}

/* ---- What cannot be told --------------------------------------------------------------------- */

static const char *name_of_unknown(const struct fit *f, size_t q, char *room, size_t size)
{
    const struct unknown *of = &f->unknown[q];

    if (of->kind == DEAD_TIME)
        return "dead_time";
    if (of->kind == PARAMETER)
        return f->model->param[of->at].name;
    if (of->kind == PROCESS)
        snprintf(room, size, "the noise of state %zu", of->at + 1);
    else if (of->kind == MEASURED)
        snprintf(room, size, "the noise of output %zu", of->at + 1);
    else if (of->kind == BEFORE)
        snprintf(room, size, "what input %zu was before", of->at % f->inputs + 1);
    else if (f->model->state)
        snprintf(room, size, "where %s begins", f->model->state[of->at].name);
    else
        snprintf(room, size, "where state %zu begins", of->at + 1);
    return room;
}

/* A sought-for number that does nothing, or nothing that others do not do as well: those are named. */
int fit_check_apart(const struct fit *f, struct apc_error *why)
{
    double *share = f->small;

    for (size_t q = f->first; q < f->m; q++) {
        char list[160] = "", room[60];
        double length = 0.0;
        int n = 0;

        for (size_t i = 0; i <= q; i++)
            length += f->R[i * f->m + q] * f->R[i * f->m + q];
        length = sqrt(length);
        if (!(length > 0.0))
            return apc_fail(
                why, APC_ESOLVER,
                "parameters: %s changes nothing that was measured: it cannot be found from this record. "
                "Measure what it acts on, or leave it as it is",
                name_of_unknown(f, q, room, sizeof room));
        if (f->R[q * f->m + q] > APART * length)
            continue;
        for (size_t i = 0; i < q; i++)
            share[i] = f->R[i * f->m + q];
        apc_qr_solve(q, f->R, f->m, share, share);
        for (size_t i = 0; i < q; i++) {
            double other = 0.0;

            for (size_t k = 0; k <= i; k++)
                other += f->R[k * f->m + i] * f->R[k * f->m + i];
            if (fabs(share[i]) * sqrt(other) > TOGETHER * length && n >= 0 && (size_t)n < sizeof list - 1)
                n += snprintf(list + n, sizeof list - (size_t)n, "%s%s", n ? ", " : "",
                              name_of_unknown(f, i, room, sizeof room));
        }
        return apc_fail(
            why, APC_ESOLVER,
            "parameters: what %s does to the measurements, %s does as well: one cannot be told from "
            "the other by this record. Leave one of them as it is, or move the inputs otherwise",
            name_of_unknown(f, q, room, sizeof room), list);
    }
    return 0;
}

/* ---- Unknowns -------------------------------------------------------------------------------------- */

static double longest_dead_time(const struct fit *f)
{
    return (double)apc_record_shortest(&f->r) / 4.0 * f->r.Ts;
}

static void set_unknown(struct fit *f, size_t q, enum kind kind, size_t run, size_t at)
{
    const size_t j = kind == BEFORE ? at % f->inputs : 0, to = f->s.input ? f->s.input[j] : j,
                 nu = f->model->nu;
    const struct apc_param *table = kind == STATE       ? f->model->state
                                    : kind == PARAMETER ? f->model->param
                                    : to < nu           ? f->model->input
                                                        : f->model->disturbance;
    const size_t row = kind != BEFORE ? at : to < nu ? to : to - nu;
    struct unknown *of = &f->unknown[q];
    double usual = 0.0;

    *of = (struct unknown){.kind = kind, .run = run, .at = at, .low = -HUGE_VAL, .high = HUGE_VAL};
    if (kind == DEAD_TIME) {
        of->low = 0.0;
        of->high = longest_dead_time(f);
        of->size = f->r.Ts;
        f->value[q] = f->dead_time;
        return;
    }
    if (kind == PROCESS || kind == MEASURED) { /* of logarithms */
        f->value[q] = apc_log(kind == PROCESS ? f->process[at] : f->measured[at]);
        usual = apc_log(kind == PROCESS ? f->scale[at] : f->deviation[at]);
        of->low = usual - REACH;
        of->high = usual + REACH;
        of->size = 1.0;
        return;
    }
    if (table) {
        of->low = table[row].low;
        of->high = table[row].high;
        usual = 0.01 * fabs(table[row].initial);
    }
    if (kind == BEFORE) {
        f->value[q] = f->before[run * LEVELS * f->inputs + at];
        of->low = fmin(of->low, f->value[q]); /* what was on record was there */
        of->high = fmax(of->high, f->value[q]);
        of->size = apc_record_reach(&f->r, f->r.u + j, f->inputs);
    } else {
        f->value[q] = kind == STATE ? f->x0[run * f->model->nx + at] : f->p[at];
        of->size = fmax(fabs(f->value[q]), usual);
    }
    of->size = of->size > 0.0 ? of->size : 1.0;
}

/* The unknowns, where they are now: states, levels, noises, and what is sought. */
void fit_set_unknowns(struct fit *f)
{
    const size_t nx = f->model->nx, each = f->levels * f->inputs, states = f->runs * nx,
                 noises = states + f->runs * each, process = f->filtered ? f->n_noisy : 0;

    f->first = noises + process + (f->filtered ? f->r.ny : 0);
    f->m = f->first + f->s.n;
    for (size_t q = 0; q < states; q++)
        set_unknown(f, q, STATE, q / nx, q % nx);
    for (size_t q = states; q < noises; q++)
        set_unknown(f, q, BEFORE, (q - states) / each, (q - states) % each);
    for (size_t q = noises; q < f->first; q++)
        if (q - noises < process)
            set_unknown(f, q, PROCESS, 0, f->noisy[q - noises]);
        else
            set_unknown(f, q, MEASURED, 0, q - noises - process);
    for (size_t q = 0; q < f->s.n; q++)
        set_unknown(f, f->first + q, f->s.which[q] < f->model->np ? PARAMETER : DEAD_TIME, 0, f->s.which[q]);
}

/* Of each run where the model stands still with its first inputs, where that goes better with it. */
static int begin_fit(struct fit *f, struct apc_error *why)
{
    const size_t nx = f->model->nx, inputs = f->r.nu + f->r.nd;
    double *x = calloc(f->runs * nx + f->model->nu + f->model->nd + 1, sizeof(*x)), *u = x + f->runs * nx;
    int rc = x ? fit_run(f, f->y, why) : APC_ENOMEM;

    if (rc == APC_ENOMEM) {
        free(x);
        return rc;
    }
    const bool lost = rc < 0;
    memcpy(x, f->x0, f->runs * nx * sizeof(*x));
    for (size_t g = 0; g < f->runs; g++) {
        const struct apc_record run = apc_record_run(&f->r, g);
        double *still = f->x0 + g * nx;

        apc_param_initials(f->model->input, f->model->nu, u);
        apc_param_initials(f->model->disturbance, f->model->nd, u + f->model->nu);
        for (size_t j = 0; j < inputs; j++)
            u[f->s.input ? f->s.input[j] : j] = run.u[j];
        if (apc_model_equilibrium(f->model, f->p, u, still, NULL) < 0)
            continue; /* it stays as it was */
        for (size_t i = 0; i < nx && f->model->state; i++)
            still[i] = fmin(fmax(still[i], f->model->state[i].low), f->model->state[i].high);
    }
    rc = fit_run(f, f->plus, lost ? why : NULL);
    for (size_t g = 0; g < f->runs; g++) {
        size_t first, n = fitted_of(f, g, &first);
        double given = 0.0, found = 0.0;

        for (size_t k = first * f->r.ny; k < (first + n) * f->r.ny; k++) {
            const double d = f->deviation[k % f->r.ny];

            given += isfinite(f->r.y[k]) ? apc_pow((f->r.y[k] - f->y[k]) / d, 2) : 0.0;
            found += isfinite(f->r.y[k]) ? apc_pow((f->r.y[k] - f->plus[k]) / d, 2) : 0.0;
        }
        if (rc < 0 || (!lost && !(found < given)))
            memcpy(f->x0 + g * nx, x + g * nx, nx * sizeof(*x));
    }
    free(x);
    if (rc < 0 && !lost)
        rc = 0;
    return rc == 0 ? fit_run(f, f->y, why) : rc;
}

/* ---- What is told ------------------------------------------------------------------------------------ */

/* The standard error of unknown @p q, and behind it in small R'^-1 of its unit. */
double fit_standard_error(struct fit *f, double variance, size_t q, double *g)
{
    memset(g, 0, f->m * sizeof(*g));
    g[q] = 1.0;
    return f->unknown[q].size * sqrt(variance * apc_qr_variance(f->m, f->R, f->m, g));
}

static int check_known(struct fit *f, double variance, size_t q, double error, struct apc_error *why)
{
    const struct unknown *of = &f->unknown[q];
    const bool late = of->kind == DEAD_TIME; /* it may be none, and is then known as any other */
    double *mine = f->small, *others = f->small + f->m;
    char list[160] = "", room[60];
    int n = 0;

    if ((f->value[q] <= of->low && !late) || f->value[q] >= of->high)
        return apc_fail(
            why, APC_ESOLVER,
            "parameters: %s goes to its limit %g: is it a record of this plant, with these inputs, in "
            "these units?",
            name_of_unknown(f, q, room, sizeof room), f->value[q]);
    if (1.96 * error < fmax(fabs(f->value[q]), late ? of->high : of->size))
        return 0;
    fit_standard_error(f, variance, q, mine);
    for (size_t i = 0; i < f->m; i++) {
        fit_standard_error(f, variance, i, others);
        const double alike = apc_matrix_dot(mine, others, f->m) /
                             sqrt(apc_matrix_dot(mine, mine, f->m) * apc_matrix_dot(others, others, f->m));

        if (i != q && fabs(alike) > 0.9 && (size_t)n < sizeof list - 1)
            n +=
                snprintf(list + n, sizeof list - (size_t)n, "%s%s",
                         n ? ", " : ", as it does what these do: ", name_of_unknown(f, i, room, sizeof room));
    }
    return apc_fail(
        why, APC_ESOLVER,
        "parameters: %s cannot be found from this record: %.3g +- %.2g%s. Leave it as it is, record for "
        "longer, or move the inputs more",
        name_of_unknown(f, q, room, sizeof room), f->value[q], 1.96 * error, list);
}

static int report_parameters(struct fit *f, double left, double *value, double *error, struct apc_error *why)
{
    const size_t rows = fit_counted(f);
    const double of_record = left - fit_prior_misfit(f, f->e + f->samples),
                 variance = f->filtered ? 1.0 : of_record / (double)(rows > f->m ? rows - f->m : 1);

    f->scatter = sqrt(fmax(variance, NONE));
    int rc = fit_differentiate(f, why);

    if (rc == 0)
        rc = fit_check_apart(f, why);
    for (size_t q = f->first; q < f->m && rc == 0; q++) {
        value[q - f->first] = f->value[q];
        error[q - f->first] = fit_standard_error(f, variance, q, f->small);
        rc = check_known(f, variance, q, error[q - f->first], why);
    }
    return rc;
}

/* ---- The whole -------------------------------------------------------------------------------------- */

static int check_prior(const struct fit *f, size_t i, struct apc_error *why)
{
    const struct apc_prior *prior = prior_of(f, i);
    const struct apc_param *of = f->s.which[i] < f->model->np ? &f->model->param[f->s.which[i]] : NULL;
    const double low = of ? of->low : 0.0, high = of ? of->high : longest_dead_time(f);

    if (!prior || (prior->mean >= low && prior->mean <= high))
        return 0;
    return apc_fail(why, APC_EINVAL,
                    "parameters: %s cannot be %g, as it is said to be beforehand: it must be from %g to %g",
                    of ? of->name : "dead_time", prior->mean, low, high);
}

static int check_sought(const struct fit *f, struct apc_error *why)
{
    const struct apc_model *m = f->model;
    int rc = 0;

    if (apc_model_is_fmu(m))
        return apc_fail(why, APC_EINVAL, "parameters: %s is an FMU, that takes parameters as it starts only",
                        m->name);
    if (f->s.n == 0 ? !f->noisy : !f->s.which)
        return apc_fail(why, APC_EINVAL, "parameters: none is sought");
    for (size_t i = 0; i < f->s.n && rc == 0; i++) {
        for (size_t k = 0; k < i; k++)
            if (f->s.which[i] == f->s.which[k])
                return apc_fail(why, APC_EINVAL, "parameters: one is sought twice");
        if (f->s.which[i] > m->np || (f->s.which[i] < m->np && !m->param))
            return apc_fail(why, APC_EINVAL, "parameters: %s has no parameter %zu", m->name,
                            f->s.which[i] + 1);
        if (f->s.which[i] < m->np && !(m->param[f->s.which[i]].high > m->param[f->s.which[i]].low))
            return apc_fail(why, APC_EINVAL, "parameters: %s can be nothing but %g",
                            m->param[f->s.which[i]].name, m->param[f->s.which[i]].low);
        if (f->s.prior && !(isfinite(f->s.prior[i].mean) && f->s.prior[i].deviation >= 0.0 &&
                            isfinite(f->s.prior[i].deviation)))
            return apc_fail(
                why, APC_EINVAL,
                "parameters: what is known beforehand must be a number and a deviation from 0 on");
        rc = check_prior(f, i, why);
    }
    if (rc < 0)
        return rc;
    for (size_t j = 0; j < f->r.nu + f->r.nd; j++)
        if ((f->s.input ? f->s.input[j] : j) >= m->nu + m->nd)
            return apc_fail(why, APC_EINVAL, "parameters: %s has no input %zu", m->name, j + 1);
    for (size_t i = 0; i < f->r.ny; i++)
        if ((f->s.output ? f->s.output[i] : i) >= m->ny)
            return apc_fail(why, APC_EINVAL, "parameters: %s has no output %zu", m->name, i + 1);
    return 0;
}

static int open_fit(struct fit *f)
{
    const struct apc_model *m = f->model;
    const size_t ny = f->r.ny, runs = apc_record_runs(&f->r), inputs = f->r.nu + f->r.nd,
                 states = runs * m->nx, before = fit_acts_late(f) ? runs * LEVELS * inputs : 0,
                 most = states + before + (f->noisy ? f->n_noisy + ny : 0) + f->s.n;
    const size_t rows = f->r.n * ny * (f->noisy ? 2 : 1) + f->s.n;
    const struct apc_part parts[] = {APC_PART(f->unknown, most),
                                     APC_PART(f->order, ny),
                                     APC_PART(f->y, rows),
                                     APC_PART(f->plus, rows),
                                     APC_PART(f->minus, rows),
                                     APC_PART(f->e, rows),
                                     APC_PART(f->room, rows),
                                     APC_PART(f->Q, rows * most),
                                     APC_PART(f->R, most * most),
                                     APC_PART(f->small, 2 * most * (most + 1)),
                                     APC_PART(f->small_R, most * most),
                                     APC_PART(f->value, most),
                                     APC_PART(f->trial, most),
                                     APC_PART(f->step, 2 * most),
                                     APC_PART(f->along, most),
                                     APC_PART(f->deviation, ny),
                                     APC_PART(f->noise, ny * NOISE_MOST),
                                     APC_PART(f->p, m->np + states + before),
                                     APC_PART(f->process, m->nx),
                                     APC_PART(f->scale, m->nx),
                                     APC_PART(f->measured, ny),
                                     APC_PART(f->u, m->nu + m->nd),
                                     APC_PART(f->out, m->ny)};

    f->runs = runs;
    f->inputs = inputs;
    f->samples = f->r.n * ny;
    f->rows = f->samples + f->s.n;
    f->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!f->memory)
        return APC_ENOMEM;
    f->x0 = f->p + m->np; /* one behind the other: they are kept and restored together */
    f->before = f->x0 + states;
    return 0;
}

/* How far each output goes from its mean in each run. */
static void measure_deviations(struct fit *f)
{
    const size_t ny = f->r.ny;

    for (size_t i = 0; i < ny; i++) {
        double sum = 0.0, there = 0.0;

        for (size_t g = 0; g < f->runs; g++) {
            size_t begin, n = fitted_of(f, g, &begin);
            double mean = 0.0, of = 0.0;

            for (size_t k = begin; k < begin + n; k++) {
                const double y = f->r.y[k * ny + i];

                of += isfinite(y) != 0;
                mean += isfinite(y) ? y : 0.0;
            }
            for (size_t k = begin; k < begin + n; k++)
                sum += isfinite(f->r.y[k * ny + i]) ? apc_pow(f->r.y[k * ny + i] - mean / of, 2) : 0.0;
            there += of;
        }
        f->deviation[i] = sqrt(sum / fmax(there, 1.0));
    }
}

static int prepare_fit(struct fit *f, struct apc_error *why)
{
    const struct apc_model *m = f->model;
    int rc = apc_model_take(m, f->p, f->s.p, m->param, m->np, "parameter", why);

    for (size_t g = 0; g < f->runs && rc == 0; g++)
        rc = apc_model_take(m, f->x0 + g * m->nx, f->s.x0, m->state, m->nx, "state", why);
    if (rc < 0)
        return rc;
    f->dead_time = f->plant.dead_time;
    f->plant.dead_time = 0.0;
    measure_deviations(f);
    for (size_t i = 0; i < f->r.ny; i++)
        if (!(f->deviation[i] > 0.0))
            return apc_fail(why, APC_EINVAL,
                            "output %zu is the same all the time, or not there: leave it out", i + 1);
    rc = begin_fit(f, why);
    fit_set_unknowns(f);
    return rc;
}

/* Least squares of free runs. */
static int fit_squares(struct fit *f, double *left, struct apc_error *why)
{
    int rc = 0;

    for (int round = 0; round < ROUNDS && rc == 0; round++) {
        rc = round ? expect(f, f->y) : 0;
        if (rc == 0)
            rc = round ? fit_search(f, left, why) : fit_find(f, left, why);
    }
    return rc;
}

/* It begins where free runs fit best; where there are none, as of an unstable plant, where it was told to. */
static int fit_likelihood(struct fit *f, int rc, double dead_time, double *left, struct apc_error *why)
{
    if (rc == APC_ESOLVER) {
        f->plant.dead_time = dead_time;
        f->levels = 0;
        rc = prepare_fit(f, NULL);
        rc = rc == APC_ESOLVER ? 0 : rc;
    }
    if (rc == 0)
        rc = fit_begin_filter(f, why);
    return rc == 0 ? fit_search(f, left, why) : rc;
}

/* The free run from what was found; nothing, where it runs away. */
static int run_freely(struct fit *f, double *run)
{
    int rc;

    f->filtered = false;
    rc = fit_run(f, f->plus, NULL);
    for (size_t k = 0; k < f->r.n * f->r.ny; k++)
        run[k] = rc == 0 ? f->plus[k] : (double)NAN;
    return rc == APC_ESOLVER ? 0 : rc;
}

static int identify_parameters(const struct apc_record *record, const struct apc_parameters *sought,
                               struct apc_likelihood *of, double *value, double *error, double *x0,
                               double *run, struct apc_error *why)
{
    struct fit f = {.plant = {.size = sizeof f.plant},
                    .scatter = 1.0,
                    .noisy = of ? of->noisy : NULL,
                    .n_noisy = of ? of->n_noisy : 0};
    double left = 0.0;
    int rc = apc_options_copy(&f.r, sizeof(f.r), record, "apc_record", why);

    if (rc == 0)
        rc = apc_options_copy(&f.s, sizeof(f.s), sought, "apc_parameters", why);
    if (rc == 0)
        rc = apc_options_copy(&f.plant, sizeof(f.plant), f.s.plant, "apc_plant_options", why);
    if (rc == 0)
        rc = apc_record_check_shape(&f.r, why);
    if (rc < 0)
        return rc;
    f.plant.size = sizeof f.plant;
    f.model = f.s.model;
    f.s.until = f.s.until ? f.s.until : f.r.n;
    rc = check_sought(&f, why);
    if (rc < 0)
        return rc;
    const double dead_time = f.plant.dead_time;
    rc = open_fit(&f);
    if (rc == 0)
        rc = prepare_fit(&f, why);
    if (rc == 0)
        rc = fit_squares(&f, &left, why);
    if (of && (rc == 0 || rc == APC_ESOLVER))
        rc = fit_likelihood(&f, rc, dead_time, &left, why);
    if (rc == 0)
        rc = report_parameters(&f, left, value, error, why);
    if (rc == 0 && of)
        rc = fit_report_likelihood(&f, left, of, why);
    if (rc == 0 && of && of->profile)
        rc = fit_profile(&f, left, error, of->profile, why);
    if (rc == 0 && x0)
        memcpy(x0, f.x0, f.runs * f.model->nx * sizeof(*x0));
    if (rc == 0 && run)
        rc = run_freely(&f, run);
    if (rc == APC_ENOMEM)
        apc_fail(why, rc, "apc_identify_parameters: no memory");
    free(f.memory);
    return rc;
}

int apc_identify_parameters(const struct apc_record *record, const struct apc_parameters *sought,
                            double *value, double *error, double *x0, double *run, struct apc_error *why)
{
    return identify_parameters(record, sought, NULL, value, error, x0, run, why);
}

int apc_identify_likelihood(const struct apc_record *record, const struct apc_parameters *sought,
                            struct apc_likelihood *of, double *value, double *error, double *x0, double *run,
                            struct apc_error *why)
{
    struct apc_likelihood own = {.size = sizeof own};
    size_t *all = NULL;
    int rc = of ? apc_options_copy(&own, sizeof own, of, "apc_likelihood", why)
                : apc_fail(why, APC_EINVAL, "apc_identify_likelihood: nowhere to put noises");

    if (rc == 0)
        rc = fit_check_noisy(sought ? sought->model : NULL, &own, &all, why);
    if (rc == 0)
        rc = identify_parameters(record, sought, &own, value, error, x0, run, why);
    if (rc == 0)
        of->value = own.value;
    free(all);
    return rc;
}
