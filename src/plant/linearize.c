/* SPDX-License-Identifier: BSD-3-Clause */
/* Steady states of a model, and its linear model at a point. */
#include "base/base_internal.h"
#include "plant/fmu.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

/* A point of a model, and room for what is computed there. */
struct point {
    const struct apc_model *model;
    size_t nx, nu; /* nu with the disturbances */
    double *memory;
    double *p, *x, *u;
    double *f[4], *g[4];
    double *jacobian, *dx, *trial, *dx_trial, *y;
    size_t *pivot;
    struct apc_fmu_look *look; /* of an FMU, which is asked instead of f and g */
};

static void close_point(struct point *at)
{
    free(at->memory);
    free(at->pivot);
    apc_fmu_look_close(at->look);
}

/* f at @p x into @p dx, and g, unless @p y is NULL; both with the point's u. */
static int evaluate_model(struct point *at, const double *x, double *dx, double *y, struct apc_error *why)
{
    const struct apc_model *m = at->model;
    int rc;

    if (at->look)
        return apc_fmu_look_at(at->look, x, at->u, dx, y ? y : at->y, why);
    rc = apc_model_derivative(m, 0.0, x, at->u, at->p, dx, why);
    if (rc == 0 && y)
        m->g(0.0, x, at->u, at->p, y);
    return rc;
}

static int open_point(struct point *at, const struct apc_model *model, const double *p, const double *x,
                      const double *u, struct apc_error *why)
{
    size_t nx, nu, ny;
    double *m;
    int rc;

    *at = (struct point){0};
    if (!model)
        return apc_fail(why, APC_EINVAL, "linear model: model must not be NULL");
    rc = apc_model_check(model, "linear model", why);
    if (rc < 0)
        return rc;
    if (apc_model_is_fmu(model))
        return apc_fail(why, APC_EINVAL, "%s: take what apc_model_equations() makes of it", model->name);
    nx = model->nx;
    nu = model->nu + model->nd;
    ny = model->ny;
    m = calloc(model->np + nu + 8 * nx + 5 * ny + nx * nx, sizeof(*m));
    *at = (struct point){
        .model = model, .nx = nx, .nu = nu, .memory = m, .pivot = calloc(nx, sizeof(*at->pivot))};
    if (!m || !at->pivot) {
        close_point(at);
        return apc_fail(why, APC_ENOMEM, "%s: no memory for its linear model", model->name);
    }
    at->p = m;
    at->u = at->p + model->np;
    at->x = at->u + nu;
    at->dx = at->x + nx;
    at->trial = at->dx + nx;
    at->dx_trial = at->trial + nx;
    at->f[0] = at->dx_trial + nx;
    at->g[0] = at->f[0] + 4 * nx;
    at->y = at->g[0] + 4 * ny;
    at->jacobian = at->y + ny;
    for (size_t k = 1; k < 4; k++) {
        at->f[k] = at->f[0] + k * nx;
        at->g[k] = at->g[0] + k * ny;
    }
    rc = apc_model_take(model, at->p, p, model->param, model->np, "parameter", why);
    if (rc == 0)
        rc = apc_model_take(model, at->x, x, model->state, nx, "state", why);
    if (rc == 0 && u && !apc_values_ok(u, nu))
        rc = apc_fail(why, APC_EINVAL, "%s: an input of the point is not a finite number", model->name);
    if (rc < 0) {
        close_point(at);
        return rc;
    }
    apc_param_initials(model->input, model->nu, at->u);
    apc_param_initials(model->disturbance, model->nd, at->u + model->nu);
    if (u)
        memcpy(at->u, u, nu * sizeof(*u));
    if (apc_fmu_shown(model))
        rc = apc_fmu_look_open(&at->look, model, at->p, why);
    if (rc < 0)
        close_point(at);
    return rc;
}

/* ---- Jacobians ------------------------------------------------------------------------------ */

/*
 * Derivatives of f and g by *@p value, one of x or u, into column @p column of @p df and @p dg (each may be
 * NULL), matrices of @p width columns: (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h.
 */
static int differentiate_model(struct point *at, double *value, double *df, double *dg, size_t column,
                               size_t width, struct apc_error *why)
{
    static const double offset[4] = {1.0, -1.0, 2.0, -2.0};
    const struct apc_model *m = at->model;
    const double own = *value;
    volatile double ahead = own + 1e-4 * fmax(fabs(own), 1e-2);
    const double h = ahead - own; /* a step that own takes without rounding */
    int rc = 0;

    for (size_t k = 0; k < 4 && rc == 0; k++) {
        *value = own + offset[k] * h;
        rc = evaluate_model(at, at->x, at->f[k], at->g[k], why);
    }
    *value = own;
    for (size_t i = 0; df && i < at->nx && rc == 0; i++)
        df[i * width + column] =
            (8.0 * (at->f[0][i] - at->f[1][i]) - (at->f[2][i] - at->f[3][i])) / (12.0 * h);
    for (size_t i = 0; dg && i < m->ny && rc == 0; i++) {
        double slope = (8.0 * (at->g[0][i] - at->g[1][i]) - (at->g[2][i] - at->g[3][i])) / (12.0 * h);

        if (!apc_value_ok(slope))
            return apc_fail(why, APC_ESOLVER, "%s: output %zu is not a finite number there", m->name, i + 1);
        dg[i * width + column] = slope;
    }
    return rc;
}

static bool all_zero(const double *value, size_t n)
{
    while (n > 0 && fpclassify(*value) == FP_ZERO)
        value++, n--;
    return n == 0;
}

int apc_model_linearize(const struct apc_model *model, const double *p, const double *x, const double *u,
                        double *a, double *b, double *c, double *d, struct apc_error *why)
{
    struct point at;
    int rc = open_point(&at, model, p, x, u, why);

    if (rc < 0)
        return rc;
    for (size_t j = 0; j < at.nx && rc == 0; j++)
        rc = differentiate_model(&at, &at.x[j], a, c, j, at.nx, why);
    for (size_t j = 0; j < at.nu && rc == 0; j++)
        rc = differentiate_model(&at, &at.u[j], b, d, j, at.nu, why);
    if (rc == 0 && at.look && a && b && all_zero(a, at.nx * at.nx) && all_zero(b, at.nx * at.nu))
        rc =
            apc_fail(why, APC_ESOLVER,
                     "%s: the derivatives that it shows stay as they are, whatever its states and inputs are "
                     "set to; a step test of it and a model of that do instead: apc test, apc identify",
                     model->name);
    close_point(&at);
    return rc;
}

int apc_model_evaluate(const struct apc_model *model, const double *p, const double *x, const double *u,
                       double *dx, double *y, struct apc_error *why)
{
    struct point at;
    int rc = open_point(&at, model, p, x, u, why);

    if (rc < 0)
        return rc;
    rc = evaluate_model(&at, at.x, at.dx, at.y, why);
    if (rc == 0 && dx)
        memcpy(dx, at.dx, at.nx * sizeof(*dx));
    if (rc == 0 && y)
        memcpy(y, at.y, model->ny * sizeof(*y));
    close_point(&at);
    return rc;
}

/* ---- Steady states -------------------------------------------------------------------------- */

/* The Jacobian to its LU decomposition, rows exchanged for the largest pivot. False when it is singular. */
static bool decompose_jacobian(struct point *at)
{
    size_t n = at->nx;
    double *j = at->jacobian;

    for (size_t k = 0; k < n; k++) {
        size_t best = k;

        for (size_t i = k + 1; i < n; i++) {
            if (fabs(j[i * n + k]) > fabs(j[best * n + k]))
                best = i;
        }
        at->pivot[k] = best;
        if (fabs(j[best * n + k]) < DBL_MIN)
            return false;
        for (size_t l = 0; best != k && l < n; l++) {
            double swap = j[k * n + l];

            j[k * n + l] = j[best * n + l];
            j[best * n + l] = swap;
        }
        for (size_t i = k + 1; i < n; i++) {
            double factor = j[i * n + k] /= j[k * n + k];

            for (size_t l = k + 1; l < n; l++)
                j[i * n + l] -= factor * j[k * n + l];
        }
    }
    return true;
}

/* v = J^-1 v */
static void solve_jacobian(const struct point *at, double *v)
{
    size_t n = at->nx;
    const double *j = at->jacobian;

    for (size_t k = 0; k < n; k++) {
        double swap = v[at->pivot[k]];

        v[at->pivot[k]] = v[k];
        v[k] = swap;
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++)
            v[i] -= j[i * n + k] * v[k];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++)
            v[i] -= j[i * n + k] * v[k];
        v[i] /= j[i * n + i];
    }
}

/* The largest component of @p step against its state. */
static double relative(const struct point *at, const double *step)
{
    double norm = 0.0;

    for (size_t i = 0; i < at->nx; i++)
        norm = fmax(norm, fabs(step[i]) / fmax(fabs(at->x[i]), 1e-3));
    return norm;
}

static bool within_ranges(const struct point *at, const double *x)
{
    const struct apc_param *state = at->model->state;

    for (size_t i = 0; state && i < at->nx; i++) {
        if (!apc_param_accepts(&state[i], x[i]))
            return false;
    }
    return apc_values_ok(x, at->nx);
}

/* One damped step. The step is halved until the next Newton step with this Jacobian would be shorter, a test
 * that does not depend on the units (Deuflhard, Newton Methods for Nonlinear Problems, 3.3). Returns 1 when
 * the steady state is reached. */
static int damped_newton_step(struct point *at, struct apc_error *why)
{
    double size;
    int rc = evaluate_model(at, at->x, at->dx, NULL, why);
    bool at_rest = true;

    for (size_t i = 0; i < at->nx && rc == 0; i++)
        at_rest &= fabs(at->dx[i]) <= 4.0 * DBL_EPSILON * fabs(at->x[i]);
    if (rc < 0 || at_rest) /* also where there are many, as with an integrator */
        return rc < 0 ? rc : 1;
    for (size_t j = 0; j < at->nx && rc == 0; j++)
        rc = differentiate_model(at, &at->x[j], at->jacobian, NULL, j, at->nx, why);
    if (rc < 0)
        return rc;
    if (!decompose_jacobian(at))
        return apc_fail(why, APC_ESOLVER,
                        "%s: no steady state found: the Jacobian is singular; an integrating plant has one "
                        "only at the inputs that balance it",
                        at->model->name);
    solve_jacobian(at, at->dx);
    size = relative(at, at->dx);
    for (int halvings = 0; halvings < 27; halvings++) {
        const double damping = ldexp(1.0, -halvings);
        for (size_t i = 0; i < at->nx; i++)
            at->trial[i] = at->x[i] - damping * at->dx[i];
        if (!within_ranges(at, at->trial) || evaluate_model(at, at->trial, at->dx_trial, NULL, NULL) < 0)
            continue;
        solve_jacobian(at, at->dx_trial);
        if (relative(at, at->dx_trial) < size || size < 1e-9) {
            memcpy(at->x, at->trial, at->nx * sizeof(*at->x));
            return size < 1e-9;
        }
    }
    return apc_fail(why, APC_ESOLVER, "%s: no steady state found from there; try another start",
                    at->model->name);
}

int apc_model_equilibrium(const struct apc_model *model, const double *p, const double *u, double *x,
                          struct apc_error *why)
{
    struct point at;
    int rc;

    if (!x)
        return apc_fail(why, APC_EINVAL, "apc_model_equilibrium: x must not be NULL");
    rc = open_point(&at, model, p, x, u, why);
    if (rc < 0)
        return rc;
    for (int k = 0; k < 200 && rc == 0; k++)
        rc = damped_newton_step(&at, why);
    if (rc == 1)
        memcpy(x, at.x, at.nx * sizeof(*x));
    else if (rc == 0)
        rc = apc_fail(why, APC_ESOLVER, "%s: no steady state found in 200 steps", model->name);
    close_point(&at);
    return rc < 0 ? rc : 0;
}
