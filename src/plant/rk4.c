/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The classical Runge-Kutta method of fourth order with a fixed number of steps in each interval. Nothing
 * controls its error: it suits a plant that is not stiff and whose interval is short against it.
 */
#include "plant/plant_internal.h"

#include <stdlib.h>
#include <string.h>

struct solver {
    const struct apc_model *model;
    const double *p;
    unsigned steps;
    double *k1, *k2, *k3, *k4, *x, *at; /* [nx] */
};

static void rk4_destroy(void *self)
{
    struct solver *s = self;

    if (!s)
        return;
    free(s->k1);
    free(s);
}

static int rk4_create(void **self, const struct apc_model *model, const double *p,
                      const struct apc_plant_options *options, struct apc_error *why)
{
    size_t nx = model->nx;
    struct solver *s = calloc(1, sizeof(*s));
    double *memory = calloc(6 * nx, sizeof(*memory));

    if (!s || !memory) {
        free(s);
        free(memory);
        return apc_fail(why, APC_ENOMEM, "integrator rk4: no memory");
    }
    *s = (struct solver){.model = model,
                         .p = p,
                         .steps = options->steps,
                         .k1 = memory,
                         .k2 = memory + nx,
                         .k3 = memory + 2 * nx,
                         .k4 = memory + 3 * nx,
                         .x = memory + 4 * nx,
                         .at = memory + 5 * nx};
    *self = s;
    return 0;
}

/* k = f at x + h k0 */
static bool rk4_slope(struct solver *s, double t, const double *u, double h, const double *k0, double *k)
{
    for (size_t i = 0; i < s->model->nx; i++)
        s->at[i] = s->x[i] + h * k0[i];
    return s->model->f(t, s->at, u, s->p, k) == 0;
}

static int rk4_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;
    size_t nx = s->model->nx;
    double h = dt / s->steps;

    memcpy(s->x, x, nx * sizeof(*x));
    for (unsigned n = 0; n < s->steps; n++) {
        double at = t + n * h;

        if (s->model->f(at, s->x, u, s->p, s->k1) || !rk4_slope(s, at + h / 2, u, h / 2, s->k1, s->k2) ||
            !rk4_slope(s, at + h / 2, u, h / 2, s->k2, s->k3) || !rk4_slope(s, at + h, u, h, s->k3, s->k4))
            return apc_fail(why, APC_ESOLVER, "the model is not defined there");
        for (size_t i = 0; i < nx; i++)
            s->x[i] += h / 6 * (s->k1[i] + 2 * (s->k2[i] + s->k3[i]) + s->k4[i]);
    }
    for (size_t i = 0; i < nx; i++) {
        if (!isfinite(s->x[i]))
            return apc_fail(why, APC_ESOLVER, "state %zu is no longer a finite number after %u steps of %g s",
                            i + 1, s->steps, h);
    }
    memcpy(x, s->x, nx * sizeof(*x));
    return 0;
}

const struct apc_integrator apc_integrator_rk4 = {
    .name = "rk4", .create = rk4_create, .step = rk4_step, .destroy = rk4_destroy};
