/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The exact step of a linear model x' = A x + B u + c under a constant input: with the matrix exponential
 * of [A B c; 0 0 0] dt, x at t + dt is its upper rows times (x, u, 1). It is worked out anew only when dt
 * is another one than last time.
 *
 * Whether a model is linear, and A, B, c, are found by asking f: no model needs to say so.
 */
#include "base/matrix.h"
#include "plant/plant_internal.h"

#include <stdlib.h>
#include <string.h>

struct solver {
    const struct apc_model *model;
    size_t nx, n; /* n = nx + nu + nd + 1 */
    double dt;    /* of phi */
    double *m;    /* [nx * n]: A, B, c */
    double *phi;  /* [n * n] */
    double *generator, *work;
    double *x;
};

/* ---- Is it linear? -------------------------------------------------------------------------- */

/* f at (x, u) = z, its matrix times (z, 1) being @expected: within rounding? */
static bool agrees(const struct solver *s, const double *p, double t, const double *z, double *dx)
{
    if (s->model->f(t, z, z + s->nx, p, dx))
        return false;
    for (size_t i = 0; i < s->nx; i++) {
        const double *row = s->m + i * s->n;
        double sum = row[s->n - 1], size = fabs(sum);

        for (size_t j = 0; j + 1 < s->n; j++) {
            sum += row[j] * z[j];
            size += fabs(row[j] * z[j]);
        }
        if (!(fabs(dx[i] - sum) <= 1e-9 * size))
            return false;
    }
    return true;
}

static bool find_matrix(struct solver *s, const double *p)
{
    double *z = s->work, *dx = s->x;

    memset(z, 0, s->n * sizeof(*z));
    if (s->model->f(0.0, z, z + s->nx, p, dx))
        return false;
    for (size_t i = 0; i < s->nx; i++)
        s->m[i * s->n + s->n - 1] = dx[i];
    for (size_t j = 0; j + 1 < s->n; j++) {
        z[j] = 1.0;
        if (s->model->f(0.0, z, z + s->nx, p, dx))
            return false;
        z[j] = 0.0;
        for (size_t i = 0; i < s->nx; i++)
            s->m[i * s->n + j] = dx[i] - s->m[i * s->n + s->n - 1];
    }
    for (int k = 0; k < 24; k++) { /* small and large, both signs, other times */
        for (size_t j = 0; j + 1 < s->n; j++)
            z[j] = apc_pow(10.0, k % 6 - 2) * apc_sin(1.7 * k + 2.3 * (double)j + 1.0);
        if (!agrees(s, p, 1234.5 * (k % 3), z, dx))
            return false;
    }
    return true;
}

/* ---- Matrix exponential --------------------------------------------------------------------- */

/* phi = exp([m; 0] dt). Returns nonzero where it is not finite. */
static int exponentiate(struct solver *s, double dt)
{
    memset(s->generator, 0, s->n * s->n * sizeof(double));
    for (size_t i = 0; i < s->nx * s->n; i++)
        s->generator[i] = s->m[i] * dt;
    s->dt = 0.0;
    if (apc_matrix_exponential(s->n, s->generator, s->phi, s->work))
        return -1;
    s->dt = dt;
    return 0;
}

/* ---- Integrator ----------------------------------------------------------------------------- */

static void exact_destroy(void *self)
{
    struct solver *s = self;

    if (!s)
        return;
    free(s->m);
    free(s);
}

static int exact_create(void **self, const struct apc_model *model, const double *p,
                        const struct apc_plant_options *options, struct apc_error *why)
{
    size_t nx = model->nx, n = nx + model->nu + model->nd + 1;
    struct solver *s = calloc(1, sizeof(*s));
    double *memory = calloc(nx * n + 6 * n * n + nx, sizeof(*memory));

    (void)options;
    if (!s || !memory) {
        free(s);
        free(memory);
        return apc_fail(why, APC_ENOMEM, "integrator exact: no memory");
    }
    *s = (struct solver){.model = model,
                         .nx = nx,
                         .n = n,
                         .m = memory,
                         .phi = memory + nx * n,
                         .generator = memory + nx * n + n * n,
                         .work = memory + nx * n + 2 * n * n,
                         .x = memory + nx * n + 6 * n * n};
    if (!find_matrix(s, p)) {
        exact_destroy(s);
        return apc_fail(why, APC_EINVAL,
                        "integrator exact: %s is not linear in its states and inputs; use cvode or rk4",
                        model->name);
    }
    *self = s;
    return 0;
}

static int exact_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;

    (void)t;
    if (dt != s->dt && exponentiate(s, dt))
        return apc_fail(why, APC_ESOLVER, "the matrix exponential over %g s is not finite", dt);
    for (size_t i = 0; i < s->nx; i++) {
        const double *row = s->phi + i * s->n;
        double sum = row[s->n - 1];

        for (size_t j = 0; j < s->nx; j++)
            sum += row[j] * x[j];
        for (size_t j = s->nx; j + 1 < s->n; j++)
            sum += row[j] * u[j - s->nx];
        if (!isfinite(sum))
            return apc_fail(why, APC_ESOLVER, "state %zu is no longer a finite number", i + 1);
        s->x[i] = sum;
    }
    memcpy(x, s->x, s->nx * sizeof(*x));
    return 0;
}

const struct apc_integrator apc_integrator_exact = {
    .name = "exact", .create = exact_create, .step = exact_step, .destroy = exact_destroy};
