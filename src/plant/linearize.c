/* SPDX-License-Identifier: BSD-3-Clause */
/* Steady states of a model, and its linear model at a point. */
#include "base/base_internal.h"
#include "base/matrix.h"
#include "plant/fmu.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

/* A point of a model, and room for what is computed there. */
struct point {
    const struct apc_model *model;
    size_t nx, n, nu; /* n with the algebraic variables, nu with the disturbances */
    double *memory;
    double *p, *x,
        *u; /* x and f are [n]: behind the states the algebraic variables, behind x' the residuals */
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
    size_t n, nu, ny;
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
    n = model->nx + apc_model_nz(model);
    nu = model->nu + model->nd;
    ny = model->ny;
    m = calloc(model->np + nu + 8 * n + 5 * ny + n * n, sizeof(*m));
    *at = (struct point){.model = model,
                         .nx = model->nx,
                         .n = n,
                         .nu = nu,
                         .memory = m,
                         .pivot = calloc(n, sizeof(*at->pivot))};
    if (!m || !at->pivot) {
        close_point(at);
        return apc_fail(why, APC_ENOMEM, "%s: no memory for its linear model", model->name);
    }
    at->p = m;
    at->u = at->p + model->np;
    at->x = at->u + nu;
    at->dx = at->x + n;
    at->trial = at->dx + n;
    at->dx_trial = at->trial + n;
    at->f[0] = at->dx_trial + n;
    at->g[0] = at->f[0] + 4 * n;
    at->y = at->g[0] + 4 * ny;
    at->jacobian = at->y + ny;
    for (size_t k = 1; k < 4; k++) {
        at->f[k] = at->f[0] + k * n;
        at->g[k] = at->g[0] + k * ny;
    }
    rc = apc_model_take(model, at->p, p, model->param, model->np, "parameter", why);
    if (rc == 0)
        rc = apc_model_take(model, at->x, x, model->state, at->nx, "state", why);
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
    if (n > at->nx)
        apc_param_initials(model->algebraic, n - at->nx, at->x + at->nx);
    if (apc_fmu_shown(model))
        rc = apc_fmu_look_open(&at->look, model, at->p, false, why);
    if (rc < 0)
        close_point(at);
    return rc;
}

/* The algebraic variables that fit the point's states and inputs, from their initial values. */
static int solve_point(struct point *at, struct apc_error *why)
{
    struct apc_algebraic *a;
    struct apc_error cause;
    int rc;

    if (at->n == at->nx)
        return 0;
    rc = apc_algebraic_create(&a, at->model, at->p, 1e-2);
    if (rc < 0)
        return apc_fail(why, rc, "%s: no memory for its algebraic equations", at->model->name);
    apc_param_initials(at->model->algebraic, at->n - at->nx, at->x + at->nx);
    rc = apc_algebraic_solve(a, 0.0, at->x, at->u, &cause);
    if (rc == 0)
        rc = apc_algebraic_check(a, 0.0, at->x, at->u, &cause);
    apc_algebraic_destroy(a);
    return rc < 0 ? apc_fail(why, rc, "%s: %s", at->model->name, cause.text) : 0;
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
    for (size_t i = 0; df && i < at->n && rc == 0; i++)
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

/* With F = (f, residual) and w = (x, u): from dF/dw, dF/dz and dg/dw, dg/dz, to those of the states alone, where
 * dz = -(d residual/d z)^-1 (d residual/d w) dw. */
static int reduce_jacobians(const struct point *at, const double *F, const double *G, double *const to[4])
{
    const size_t nx = at->nx, nz = at->n - nx, ny = at->model->ny, nw = nx + at->nu, width = at->n + at->nu;
    double *Rz = calloc(nz * (nz + nw), sizeof(*Rz)), *S = Rz + nz * nz;
    int rc = Rz ? 0 : APC_ENOMEM;

    for (size_t i = 0; i < nz && rc == 0; i++) {
        const double *row = F + (nx + i) * width;

        memcpy(Rz + i * nz, row + nx, nz * sizeof(*row));
        memcpy(S + i * nw, row, nx * sizeof(*row));
        memcpy(S + i * nw + nx, row + at->n, at->nu * sizeof(*row));
    }
    if (rc == 0 && apc_matrix_solve(nz, nw, Rz, S))
        rc = APC_ESOLVER;
    for (size_t half = 0; half < 2 && rc == 0; half++) {
        for (size_t i = 0; i < (half ? ny : nx); i++) {
            const double *row = (half ? G : F) + i * width;

            for (size_t j = 0; j < nw; j++) {
                double *out = to[2 * half + (j >= nx)], slope = row[j < nx ? j : j + nz];

                for (size_t k = 0; k < nz; k++)
                    slope -= row[nx + k] * S[k * nw + j];
                if (out)
                    out[j < nx ? i * nx + j : i * at->nu + j - nx] = slope;
            }
        }
    }
    free(Rz);
    return rc;
}

static int linearize_algebraic(struct point *at, double *const to[4], struct apc_error *why)
{
    const size_t width = at->n + at->nu;
    double *F = calloc((at->n + at->model->ny) * width, sizeof(*F)), *G = F + at->n * width;
    int rc = F ? solve_point(at, why) : apc_fail(why, APC_ENOMEM, "%s: out of memory", at->model->name);

    for (size_t j = 0; j < width && rc == 0; j++)
        rc = differentiate_model(at, j < at->n ? &at->x[j] : &at->u[j - at->n], F, G, j, width, why);
    if (rc == 0 && (rc = reduce_jacobians(at, F, G, to)) < 0)
        (void)apc_fail(why, rc, "%s: its algebraic equations: %s", at->model->name,
                       rc == APC_ENOMEM ? "out of memory" : "d residual/d z is singular");
    free(F);
    return rc;
}

int apc_model_linearize(const struct apc_model *model, const double *p, const double *x, const double *u,
                        double *a, double *b, double *c, double *d, struct apc_error *why)
{
    double *const to[4] = {a, b, c, d};
    struct point at;
    int rc = open_point(&at, model, p, x, u, why);

    if (rc < 0)
        return rc;
    if (at.n > at.nx) {
        rc = linearize_algebraic(&at, to, why);
        close_point(&at);
        return rc;
    }
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
    rc = solve_point(&at, why);
    if (rc == 0)
        rc = evaluate_model(&at, at.x, at.dx, at.y, why);
    if (rc == 0 && dx)
        memcpy(dx, at.dx, at.nx * sizeof(*dx));
    if (rc == 0 && y)
        memcpy(y, at.y, model->ny * sizeof(*y));
    close_point(&at);
    return rc;
}

/* ---- Steady states -------------------------------------------------------------------------- */

/* The largest component of @p step against its state. */
static double relative(const struct point *at, const double *step)
{
    double norm = 0.0;

    for (size_t i = 0; i < at->n; i++)
        norm = fmax(norm, fabs(step[i]) / fmax(fabs(at->x[i]), 1e-3));
    return norm;
}

static bool within_ranges(const struct point *at, const double *x)
{
    const struct apc_param *state = at->model->state;
    const struct apc_param *algebraic = at->n > at->nx ? at->model->algebraic : NULL;

    for (size_t i = 0; state && i < at->nx; i++) {
        if (!apc_param_accepts(&state[i], x[i]))
            return false;
    }
    for (size_t i = at->nx; algebraic && i < at->n; i++) {
        if (!apc_param_accepts(&algebraic[i - at->nx], x[i]))
            return false;
    }
    return apc_values_ok(x, at->n);
}

/* One damped step. The step is halved until the next Newton step with this Jacobian would be shorter, a test
 * that does not depend on the units (Deuflhard, Newton Methods for Nonlinear Problems, 3.3). Returns 1 when
 * the steady state is reached. */
static int damped_newton_step(struct point *at, struct apc_error *why)
{
    double size;
    int rc = evaluate_model(at, at->x, at->dx, NULL, why);
    bool at_rest = true;

    for (size_t i = 0; i < at->n && rc == 0; i++)
        at_rest &= fabs(at->dx[i]) <= 4.0 * DBL_EPSILON * fabs(at->x[i]);
    if (rc < 0 || at_rest) /* also where there are many, as with an integrator */
        return rc < 0 ? rc : 1;
    for (size_t j = 0; j < at->n && rc == 0; j++)
        rc = differentiate_model(at, &at->x[j], at->jacobian, NULL, j, at->n, why);
    if (rc < 0)
        return rc;
    if (apc_matrix_factor(at->n, at->jacobian, at->pivot))
        return apc_fail(why, APC_ESOLVER,
                        "%s: no steady state found: the Jacobian is singular; an integrating plant has one "
                        "only at the inputs that balance it",
                        at->model->name);
    apc_matrix_substitute(at->n, at->jacobian, at->pivot, at->dx);
    size = relative(at, at->dx);
    for (int halvings = 0; halvings < 27; halvings++) {
        const double damping = ldexp(1.0, -halvings);
        for (size_t i = 0; i < at->n; i++)
            at->trial[i] = at->x[i] - damping * at->dx[i];
        if (!within_ranges(at, at->trial) || evaluate_model(at, at->trial, at->dx_trial, NULL, NULL) < 0)
            continue;
        apc_matrix_substitute(at->n, at->jacobian, at->pivot, at->dx_trial);
        if (relative(at, at->dx_trial) < size || size < 1e-9) {
            memcpy(at->x, at->trial, at->n * sizeof(*at->x));
            return size < 1e-9;
        }
    }
    return apc_fail(why, APC_ESOLVER, "%s: no steady state found from there; try another start",
                    at->model->name);
}

/* The other functions solve the algebraic equations from the variables' initial values: do they get to the same?
 * Returns 1, as above. */
static int check_same_solution(struct point *at, struct apc_error *why)
{
    int rc;

    memcpy(at->trial, at->x, at->n * sizeof(*at->x));
    rc = solve_point(at, why);
    for (size_t i = at->nx; i < at->n && rc == 0; i++) {
        if (!(fabs(at->x[i] - at->trial[i]) <= 1e-6 * fmax(fabs(at->x[i]), 1e-3)))
            return apc_fail(
                why, APC_ESOLVER,
                "%s: algebraic variable %zu is %g at the steady state, but %g when it is sought from "
                "its initial value: its equations have several solutions; an initial value nearer to "
                "the one that is meant decides",
                at->model->name, i - at->nx + 1, at->trial[i], at->x[i]);
    }
    return rc < 0 ? rc : 1;
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
    if (rc == 1 && at.n > at.nx)
        rc = check_same_solution(&at, why);
    if (rc == 1)
        memcpy(x, at.x, at.nx * sizeof(*x));
    else if (rc == 0)
        rc = apc_fail(why, APC_ESOLVER, "%s: no steady state found in 200 steps", model->name);
    close_point(&at);
    return rc < 0 ? rc : 0;
}
