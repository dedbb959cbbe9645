/* SPDX-License-Identifier: BSD-3-Clause */
/* The way to the parameters that fit best: downhill, from several beginnings, and with what was before. */
#include "identify/parameters.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/matrix.h"

#define STARTS 6     /* of a search, beside the first */
#define ASIDE  0.3   /* by so much of each parameter */
#define ALIKE  1e-3  /* of what is left: two searches that have come to the same end */
#define WHITE  1e-16 /* of an output's variance: what rounding leaves */

/* ---- Searching -------------------------------------------------------------------------------------- */

static void take_unknowns(struct fit *f, const double *value)
{
    for (size_t q = 0; q < f->m; q++)
        fit_put(f, q, value[q]);
}

/* Of a noise's logarithm no step is long: where all is noise nothing leads back. */
static double limit_noise(const struct unknown *of, double step)
{
    return of->kind == PROCESS || of->kind == MEASURED ? fmin(fmax(step, -1.0), 1.0) : step;
}

/* A step to the better, *left becoming less; *better: there was one. */
static int improve(struct fit *f, double *left, double *damping, bool *better, struct apc_error *why)
{
    int rc = fit_differentiate(f, why);

    if (rc == 0)
        rc = fit_check_apart(f, why);
    for (size_t q = 0; q < f->m; q++)
        f->along[q] = apc_matrix_dot(f->Q + q * f->rows, f->e, f->rows);
    *better = false;
    while (!*better && *damping < 1e6 && rc == 0) {
        double found = HUGE_VAL;

        apc_qr_damped(f->m, f->R, f->m, f->along, *damping, f->small, f->small_R, f->step);
        for (size_t q = 0; q < f->m; q++)
            f->trial[q] =
                fmin(fmax(f->value[q] + limit_noise(&f->unknown[q], f->step[q]) * f->unknown[q].size,
                          f->unknown[q].low),
                     f->unknown[q].high);
        take_unknowns(f, f->trial);
        rc = fit_run(f, f->plus, why);
        if (rc == 0)
            found = fit_misfit(f, f->plus, f->minus);
        rc = rc == APC_ENOMEM ? rc : 0; /* where the model has no answer is no way to go */
        *better = found < *left;
        *damping *= *better ? 0.1 : 10.0;
        if (*better) {
            memcpy(f->value, f->trial, f->m * sizeof(*f->value));
            memcpy(f->y, f->plus, f->rows * sizeof(*f->y));
            memcpy(f->e, f->minus, f->rows * sizeof(*f->e));
            *left = found;
        }
    }
    take_unknowns(f, f->value);
    *damping = fmax(*damping, 1e-9);
    return rc;
}

int fit_search(struct fit *f, double *left, struct apc_error *why)
{
    double damping = 1e-3;
    bool better = true;
    int rc = 0;

    *left = fit_misfit(f, f->y, f->e);
    for (int iteration = 0, idle = 0; iteration < 50 && idle < 2 && better && rc == 0; iteration++) {
        const double before = *left;

        rc = improve(f, left, &damping, &better, why);
        idle = before - *left < 1e-6 * (f->filtered ? 1.0 : before) ? idle + 1 : 0;
    }
    return rc;
}

/* The parameters start @p k aside of @p from, by turns to either side; states begin as they did. */
static int step_aside(struct fit *f, const double *from, unsigned k)
{
    memcpy(f->trial, from, f->m * sizeof(*f->trial));
    for (size_t q = f->first; q < f->m; q++) {
        const struct unknown *of = &f->unknown[q];
        const double by = ((q - f->first) >> (k / 2) ^ k) & 1 ? -ASIDE : ASIDE;

        f->trial[q] = fmin(fmax(from[q] + by * of->size, of->low), of->high);
    }
    memcpy(f->value, f->trial, f->m * sizeof(*f->value));
    take_unknowns(f, f->value);
    return fit_run(f, f->y, NULL);
}

/*
 * A search goes downhill, and may end in a valley of its own. So it begins again beside its first start,
 * until two of them end alike, and the lowest end counts.
 */
static int search_around(struct fit *f, double *left, struct apc_error *why)
{
    double *from = calloc(2 * f->m + 1, sizeof(*from)), *best = from ? from + f->m : NULL, other = 0.0;
    bool alike = false;
    int rc;

    if (!from)
        return APC_ENOMEM;
    memcpy(from, f->value, f->m * sizeof(*from));
    rc = fit_search(f, left, why);
    memcpy(best, f->value, f->m * sizeof(*best));
    for (unsigned k = 0; k < STARTS && rc == 0 && !alike; k++) {
        int again = step_aside(f, from, k);

        if (again == 0)
            again = fit_search(f, &other, NULL);
        rc = again == APC_ENOMEM ? again : 0;
        if (again < 0)
            continue;
        alike = fabs(other - *left) <= ALIKE * *left;
        if (other < *left) {
            *left = other;
            memcpy(best, f->value, f->m * sizeof(*best));
        }
    }
    memcpy(f->value, best, f->m * sizeof(*best));
    take_unknowns(f, f->value);
    if (rc == 0)
        rc = fit_run(f, f->y, why);
    free(from);
    return rc;
}

/* Schwarz' criterion, as each output scatters by itself; the less the better. */
static double score_of_fit(const struct fit *f, const double *errors)
{
    const size_t n = f->r.n;
    const double *priors = errors + f->samples;
    double score = (double)f->m * apc_log((double)fit_counted(f)) + apc_matrix_dot(priors, priors, f->s.n);

    for (size_t i = 0; i < f->r.ny; i++) {
        const double *e = errors + i * n;
        double there = 0.0;

        for (size_t k = 0; k < n; k++)
            there += e[k] != 0.0;
        score += there * apc_log(fmax(apc_matrix_dot(e, e, n) / fmax(there, 1.0), WHITE));
    }
    return score;
}

/* All numbers that are sought or known; behind them how many levels there are. */
static size_t count_fit_numbers(const struct fit *f)
{
    return f->model->np + f->runs * (f->model->nx + LEVELS * f->inputs) + 2;
}

static void keep_unknowns(const struct fit *f, double *to)
{
    const size_t n = count_fit_numbers(f);

    memcpy(to, f->p, (n - 2) * sizeof(*to));
    to[n - 2] = f->dead_time;
    to[n - 1] = (double)f->levels;
}

/* As they were kept, with @p levels: those that are more are as the last one is. */
static void restore_unknowns(struct fit *f, const double *from, size_t levels)
{
    const size_t n = count_fit_numbers(f), had = (size_t)from[n - 1], row = f->inputs;

    memcpy(f->p, from, (n - 2) * sizeof(*from));
    f->dead_time = from[n - 2];
    f->levels = levels;
    for (size_t g = 0; g < f->runs; g++) {
        double *first = f->before + g * LEVELS * row;

        for (size_t i = had; i < levels; i++)
            memcpy(first + i * row, i ? first + (i - 1) * row : apc_record_run(&f->r, g).u,
                   row * sizeof(*first));
    }
    fit_set_unknowns(f);
}

/* Where it is now: *score becomes what a step to all sides would make of it, were all linear. */
static int look_ahead_of_step(struct fit *f, double *score)
{
    int rc = fit_run(f, f->y, NULL);

    if (rc == 0) {
        fit_misfit(f, f->y, f->e);
        rc = fit_differentiate(f, NULL);
    }
    for (size_t q = 0; q < f->m && rc == 0; q++) {
        const double *column = f->Q + q * f->rows, along = apc_matrix_dot(column, f->e, f->rows);

        for (size_t k = 0; k < f->rows; k++)
            f->e[k] -= along * column[k];
    }
    *score = rc == 0 ? score_of_fit(f, f->e) : HUGE_VAL;
    return rc;
}

/*
 * What inputs were before a run acts for as long as the dead time. They need not have been what they are at
 * first: the record may begin with a move, or soon after one. How many levels there are is told by the
 * criterion, none to begin with. Levels that would not help, were all linear, are not searched; a dead time
 * that was found to be none without them may be one, so searches begin where the first did as well.
 * @p rc: how the search without ended.
 */
static int settle_fit(struct fit *f, const double *start, int rc, double *left, struct apc_error *why)
{
    const size_t n = count_fit_numbers(f);
    double *best = calloc(n, sizeof(*best)), least = rc == 0 ? score_of_fit(f, f->e) : HUGE_VAL;

    if (!best)
        return APC_ENOMEM;
    keep_unknowns(f, best);
    for (size_t levels = 1; levels > 0 && rc != APC_ENOMEM;
         levels = apc_record_more_levels(levels, best[n - 2] / f->r.Ts)) {
        const double dead_time = best[n - 2];
        bool doubtful = rc < 0 || (dead_time < f->r.Ts && start[n - 2] > 0.0);
        double promised;

        restore_unknowns(f, best, levels);
        int again = look_ahead_of_step(f, &promised);

        doubtful |= promised < least;
        for (int from = 0; from < 2 && doubtful && again != APC_ENOMEM; from++) {
            restore_unknowns(f, from == 0 ? best : start, levels);
            again = fit_run(f, f->y, NULL);
            if (again == 0)
                again = fit_search(f, left, NULL);
            if (again == 0 && score_of_fit(f, f->e) < least) {
                least = score_of_fit(f, f->e);
                keep_unknowns(f, best);
                rc = 0;
            }
        }
        rc = again == APC_ENOMEM ? again : rc;
    }
    restore_unknowns(f, best, (size_t)best[n - 1]);
    if (rc == 0)
        rc = fit_run(f, f->y, why);
    if (rc == 0)
        *left = fit_misfit(f, f->y, f->e);
    free(best);
    return rc;
}

/* The first search of all. */
int fit_find(struct fit *f, double *left, struct apc_error *why)
{
    double *start = fit_acts_late(f) ? calloc(count_fit_numbers(f), sizeof(*start)) : NULL;
    int rc;

    if (!start)
        return fit_acts_late(f) ? APC_ENOMEM : search_around(f, left, why);
    keep_unknowns(f, start);
    rc = search_around(f, left, why);
    if (rc != APC_ENOMEM)
        rc = settle_fit(f, start, rc, left, why);
    free(start);
    return rc;
}
