/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The algebraic equations of a model, 0 = residual(t, x, z, u, p), solved for z at given x: Newton's method
 * with a Jacobian by forward differences that is kept as long as the steps become much shorter. A step is
 * halved until the next one with the same Jacobian would be shorter, which does not depend on the units
 * (Deuflhard, Newton Methods for Nonlinear Problems, 3.3).
 */
#include "base/base_internal.h"
#include "base/matrix.h"
#include "plant/fmu.h"

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_STEPS    50
#define MAX_HALVINGS 20
#define SOLVED       1e-13 /* of the next step, relative: then z is as exact as numbers are */
#define ROUNDED      1e-7  /* where steps become no shorter, rounding is why */
#define SINGULAR     1e-9  /* of a pivot, in equations and variables of magnitude 1 */

struct apc_algebraic {
    const struct apc_model *model;
    const double *p;
    size_t n; /* nz */
    double zero_scale;
    size_t *pivot;
    double *x;                         /* [nx + nz] a place beside the one at hand */
    double *r, *moved, *step, *former; /* [nz] */
    double *kept;                      /* [nz] where a search began */
    double *jacobian, *slopes;         /* [nz * nz] */
    double memory[];
};

int apc_algebraic_create(struct apc_algebraic **algebraic, const struct apc_model *model, const double *p,
                         double zero_scale)
{
    const size_t n = model->nz;
    struct apc_algebraic *a = calloc(1, sizeof(*a) + (model->nx + 6 * n + 2 * n * n) * sizeof(double));

    *algebraic = a;
    if (!a)
        return APC_ENOMEM;
    *a = (struct apc_algebraic){.model = model, .p = p, .n = n, .zero_scale = zero_scale};
    a->pivot = calloc(n, sizeof(*a->pivot));
    a->x = a->memory;
    a->r = a->x + model->nx + n;
    a->moved = a->r + n;
    a->step = a->moved + n;
    a->former = a->step + n;
    a->kept = a->former + n;
    a->jacobian = a->kept + n;
    a->slopes = a->jacobian + n * n;
    if (a->pivot)
        return 0;
    free(a);
    *algebraic = NULL;
    return APC_ENOMEM;
}

void apc_algebraic_destroy(struct apc_algebraic *algebraic)
{
    if (algebraic)
        free(algebraic->pivot);
    free(algebraic);
}

/* Nothing is wrong: 0. Else the number of the equation that is no finite number; n + 1: not defined at all. */
static size_t evaluate_equations(const struct apc_algebraic *a, double t, const double *x, const double *u,
                                 double *r)
{
    if (a->model->residual(t, x, u, a->p, r))
        return a->n + 1;
    for (size_t i = 0; i < a->n; i++) {
        if (!apc_value_ok(r[i]))
            return i + 1;
    }
    return 0;
}

static double variable_scale(const struct apc_algebraic *a, const double *z, size_t j)
{
    return fmax(fabs(z[j]), a->zero_scale);
}

/* d r/d z at @p x, where r is. False where the model is not defined beside it. */
static bool differentiate_equations(struct apc_algebraic *a, double t, const double *x, const double *u)
{
    const size_t nx = a->model->nx, n = a->n;

    memcpy(a->x, x, (nx + n) * sizeof(*x));
    for (size_t j = 0; j < n; j++) {
        const double own = x[nx + j];
        double h = sqrt(DBL_EPSILON) * fmax(variable_scale(a, x + nx, j), APC_ALGEBRAIC_SCALE);

        a->x[nx + j] = own + h;
        if (evaluate_equations(a, t, a->x, u, a->moved)) {
            a->x[nx + j] = own - h; /* from a bound to the other side */
            if (evaluate_equations(a, t, a->x, u, a->moved))
                return false;
        }
        h = a->x[nx + j] - own; /* what was really added */
        a->x[nx + j] = own;
        for (size_t i = 0; i < n; i++)
            a->jacobian[i * n + j] = (a->moved[i] - a->r[i]) / h;
    }
    return true;
}

/* The largest component of @p step against its variable. */
static double step_size(const struct apc_algebraic *a, const double *z, const double *step)
{
    double size = 0.0;

    for (size_t j = 0; j < a->n; j++) {
        if (!isfinite(step[j]))
            return HUGE_VAL;
        size = fmax(size, fabs(step[j]) / variable_scale(a, z, j));
    }
    return size;
}

/* Rounding may lead a little beyond a bound that the solution lies on. */
static bool within_bounds(const struct apc_algebraic *a, const double *z)
{
    const struct apc_param *range = a->model->algebraic;

    for (size_t j = 0; range && j < a->n; j++) {
        const double slack = 1e-9 * variable_scale(a, z, j);

        if (z[j] < range[j].low - slack || z[j] > range[j].high + slack)
            return false;
    }
    return true;
}

/* To the place that a part of the step leads to, its residuals to r and the next step, with the same Jacobian,
 * to step. Returns the size of that, or HUGE_VAL where there is no such place. */
static double try_step(struct apc_algebraic *a, double t, const double *x, const double *u, double part)
{
    const size_t nx = a->model->nx;

    for (size_t j = 0; j < a->n; j++)
        a->x[nx + j] = x[nx + j] - part * a->former[j];
    if (!within_bounds(a, a->x + nx) || evaluate_equations(a, t, a->x, u, a->moved))
        return HUGE_VAL;
    memcpy(a->step, a->moved, a->n * sizeof(*a->step));
    apc_matrix_substitute(a->n, a->jacobian, a->pivot, a->step);
    return step_size(a, x + nx, a->step);
}

/* From @p x, whose residuals are r. Returns whether it came to the solution. */
static bool iterate_newton(struct apc_algebraic *a, double t, double *x, const double *u)
{
    const size_t nx = a->model->nx, bytes = a->n * sizeof(double);
    bool anew = true;

    for (int k = 0; k < MAX_STEPS; k++) {
        double size, next = HUGE_VAL, part = 1.0;

        if (anew) {
            if (!differentiate_equations(a, t, x, u) || apc_matrix_factor(a->n, a->jacobian, a->pivot))
                return false;
            memcpy(a->step, a->r, bytes);
            apc_matrix_substitute(a->n, a->jacobian, a->pivot, a->step);
        }
        memcpy(a->former, a->step, bytes);
        size = step_size(a, x + nx, a->former);
        for (int halvings = 0; halvings < MAX_HALVINGS; halvings++) {
            part = ldexp(1.0, -halvings);
            next = try_step(a, t, x, u, part);
            if (next < size || next <= SOLVED)
                break;
        }
        if (!(next < size || next <= SOLVED)) {
            if (size <= ROUNDED)
                return true;
            if (anew)
                return false;
            anew = true;
            continue;
        }
        memcpy(x + nx, a->x + nx, bytes);
        memcpy(a->r, a->moved, bytes);
        if (next <= SOLVED) {
            for (size_t j = 0; j < a->n; j++)
                x[nx + j] -= a->step[j];
            return true;
        }
        anew = part < 1.0 || next > 0.1 * size;
    }
    return false;
}

static int report_equations(struct apc_algebraic *a, double t, const double *x, const double *u,
                            struct apc_error *why)
{
    const size_t nx = a->model->nx, undefined = evaluate_equations(a, t, x, u, a->r);
    size_t worst = 0, used = 0;
    char where[160] = "";

    for (size_t j = 0; j < a->n && used < sizeof(where); j++)
        used += (size_t)(a->model->algebraic ? snprintf(where + used, sizeof(where) - used, "%s%s = %g",
                                                        j ? ", " : "", a->model->algebraic[j].name, x[nx + j])
                                             : snprintf(where + used, sizeof(where) - used, "%sz%zu = %g",
                                                        j ? ", " : "", j + 1, x[nx + j]));
    for (size_t i = 0; i < a->n; i++) {
        if (fabs(a->r[i]) > fabs(a->r[worst]))
            worst = i;
    }
    if (undefined > a->n)
        return apc_fail(why, APC_ESOLVER, "its algebraic equations are not defined at %s", where);
    if (undefined)
        return apc_fail(why, APC_ESOLVER, "algebraic equation %zu is %g, no finite number, at %s", undefined,
                        a->r[undefined - 1], where);
    return apc_fail(
        why, APC_ESOLVER,
        "no solution of its algebraic equations was found near %s, where equation %zu is off by %g; "
        "other initial values of these variables may lead to one",
        where, worst + 1, a->r[worst]);
}

int apc_algebraic_solve(struct apc_algebraic *algebraic, double t, double *x, const double *u,
                        struct apc_error *why)
{
    struct apc_algebraic *a = algebraic;
    double *z = x + a->model->nx;
    int rc = 0;

    memcpy(a->kept, z, a->n * sizeof(*z));
    if (!evaluate_equations(a, t, x, u, a->r) && iterate_newton(a, t, x, u))
        return 0;
    apc_param_initials(a->model->algebraic, a->n, z);
    if (!evaluate_equations(a, t, x, u, a->r) && iterate_newton(a, t, x, u))
        return 0;
    memcpy(a->former, z, a->n * sizeof(*z));
    memcpy(z, a->kept, a->n * sizeof(*z));
    rc = apc_algebraic_check(a, t, x, u, why);
    if (rc < 0)
        return rc;
    memcpy(z, a->former, a->n * sizeof(*z));
    rc = report_equations(a, t, x, u, why);
    memcpy(z, a->kept, a->n * sizeof(*z));
    return rc;
}

/* d r/d z to slopes, by central differences of fourth order. False where the model is not defined beside x. */
static bool differentiate_exactly(struct apc_algebraic *a, double t, const double *x, const double *u)
{
    static const double offset[4] = {1.0, -1.0, 2.0, -2.0}, weight[4] = {8.0, -8.0, -1.0, 1.0};
    const size_t nx = a->model->nx, n = a->n;

    memcpy(a->x, x, (nx + n) * sizeof(*x));
    memset(a->slopes, 0, n * n * sizeof(*a->slopes));
    for (size_t j = 0; j < n; j++) {
        const double h = 1e-3 * variable_scale(a, x + nx, j);

        for (size_t k = 0; k < 4; k++) {
            a->x[nx + j] = x[nx + j] + offset[k] * h;
            if (evaluate_equations(a, t, a->x, u, a->moved))
                return false;
            for (size_t i = 0; i < n; i++)
                a->slopes[i * n + j] += weight[k] * a->moved[i] / (12.0 * h);
        }
        a->x[nx + j] = x[nx + j];
    }
    return true;
}

/* Columns, then rows of slopes to magnitude 1, so that units do not count. */
static void equilibrate(struct apc_algebraic *a)
{
    const size_t n = a->n;

    for (size_t rows = 0; rows < 2; rows++) {
        for (size_t i = 0; i < n; i++) {
            double *first = a->slopes + (rows ? i * n : i), most = 0.0;
            const size_t stride = rows ? 1 : n;

            for (size_t j = 0; j < n; j++)
                most = fmax(most, fabs(first[j * stride]));
            for (size_t j = 0; j < n && most > 0.0; j++)
                first[j * stride] /= most;
        }
    }
}

int apc_algebraic_check(struct apc_algebraic *algebraic, double t, const double *x, const double *u,
                        struct apc_error *why)
{
    struct apc_algebraic *a = algebraic;
    const size_t n = a->n;

    if (!differentiate_exactly(a, t, x, u))
        return 0;
    equilibrate(a);
    for (size_t i = 0; i < n; i++)
        a->pivot[i] = i; /* the equation that a row is of */
    for (size_t k = 0; k < n; k++) {
        size_t row = k, column = 0;
        const double *best;

        for (size_t i = k; i < n; i++) {
            for (size_t j = 0; j < n; j++) {
                if (fabs(a->slopes[i * n + j]) > fabs(a->slopes[row * n + column])) {
                    row = i;
                    column = j;
                }
            }
        }
        if (fabs(a->slopes[row * n + column]) < SINGULAR)
            return apc_fail(
                why, APC_ESOLVER,
                "its algebraic equation %zu of %zu determines no algebraic variable that the others do not: "
                "d "
                "residual/d z is singular, the index is above 1; differentiate that equation by time, or "
                "leave it out with a variable of its own",
                a->pivot[k] + 1, n);
        for (size_t j = 0; j < n; j++) {
            double swap = a->slopes[k * n + j];

            a->slopes[k * n + j] = a->slopes[row * n + j];
            a->slopes[row * n + j] = swap;
        }
        const size_t equation = a->pivot[k];
        a->pivot[k] = a->pivot[row];
        a->pivot[row] = equation;
        best = a->slopes + k * n;
        for (size_t i = k + 1; i < n; i++) {
            const double factor = a->slopes[i * n + column] / best[column];

            for (size_t j = 0; j < n; j++)
                a->slopes[i * n + j] -= factor * best[j];
            a->slopes[i * n + column] = 0.0;
        }
    }
    return 0;
}

void apc_algebraic_rate(struct apc_algebraic *algebraic, double t, const double *x, const double *u,
                        double *rate)
{
    struct apc_algebraic *a = algebraic;
    const size_t nx = a->model->nx;
    double fastest = 0.0, e;

    memset(rate + nx, 0, a->n * sizeof(*rate));
    for (size_t i = 0; i < nx; i++)
        fastest = fmax(fastest, fabs(rate[i]) / fmax(fabs(x[i]), a->zero_scale));
    e = sqrt(DBL_EPSILON) / fmax(fastest, 1e-3);
    for (size_t i = 0; i < nx; i++)
        a->x[i] = x[i] + e * rate[i];
    memcpy(a->x + nx, x + nx, a->n * sizeof(*x));
    if (evaluate_equations(a, t, x, u, a->r) || evaluate_equations(a, t + e, a->x, u, a->moved))
        return;
    for (size_t j = 0; j < a->n; j++)
        a->step[j] = (a->r[j] - a->moved[j]) / e;
    apc_matrix_substitute(a->n, a->jacobian, a->pivot, a->step);
    if (step_size(a, x + nx, a->step) < HUGE_VAL)
        memcpy(rate + nx, a->step, a->n * sizeof(*rate));
}

/* ---- A model as of its states alone --------------------------------------------------------- */

int apc_reduced_open(struct apc_reduced *reduced, const struct apc_model *model, const double *p,
                     struct apc_error *why)
{
    const size_t nz = apc_model_nz(model);

    *reduced = (struct apc_reduced){.model = model, .p = p};
    if (apc_fmu_shown(model))
        return apc_fmu_look_open(&reduced->look, model, p, true, why);
    reduced->plain = !nz;
    if (!nz)
        return 0;
    reduced->x = calloc(model->nx + nz, sizeof(*reduced->x));
    if (reduced->x && apc_algebraic_create(&reduced->algebraic, model, p, 1e-2) == 0)
        return 0;
    apc_reduced_close(reduced);
    return apc_fail(why, APC_ENOMEM, "%s: no memory for its algebraic equations", model->name);
}

void apc_reduced_close(struct apc_reduced *reduced)
{
    apc_algebraic_destroy(reduced->algebraic);
    apc_fmu_look_close(reduced->look);
    free(reduced->x);
    *reduced = (struct apc_reduced){0};
}

/* x with the algebraic variables behind it; NULL where the equations have no solution. */
static const double *complete(const struct apc_reduced *reduced, const double *x, const double *u)
{
    const struct apc_model *m = reduced->model;

    memcpy(reduced->x, x, m->nx * sizeof(*x));
    apc_param_initials(m->algebraic, m->nz, reduced->x + m->nx);
    return apc_algebraic_solve(reduced->algebraic, 0.0, reduced->x, u, NULL) == 0 ? reduced->x : NULL;
}

int apc_reduced_solve_f(const struct apc_reduced *reduced, const double *x, const double *u, double *dx)
{
    if (reduced->look)
        return apc_fmu_look_at(reduced->look, x, u, dx, NULL, NULL);
    const double *whole = complete(reduced, x, u);

    return whole ? reduced->model->f(0.0, whole, u, reduced->p, dx) : -1;
}

void apc_reduced_solve_g(const struct apc_reduced *reduced, const double *x, const double *u, double *y)
{
    const double *whole = reduced->look ? NULL : complete(reduced, x, u);

    if (reduced->look && apc_fmu_look_at(reduced->look, x, u, NULL, y, NULL) == 0)
        return;
    for (size_t i = 0; !whole && i < reduced->model->ny; i++)
        y[i] = (double)NAN;
    if (whole)
        reduced->model->g(0.0, whole, u, reduced->p, y);
}

int apc_reduced_slopes(const struct apc_reduced *reduced, const double *x, const double *u, double *slopes)
{
    return apc_fmu_look_slopes(reduced->look, x, u, slopes);
}

int apc_reduced_interval(const struct apc_reduced *reduced, double *x, const double *u, double t,
                         unsigned steps, double *slopes)
{
    return apc_fmu_look_interval(reduced->look, x, u, t, steps, slopes);
}

const char *apc_reduced_error(const struct apc_reduced *reduced)
{
    return reduced->look ? apc_fmu_look_error(reduced->look) : "";
}
