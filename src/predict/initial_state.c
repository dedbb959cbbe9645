/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * x = A x + B u and y = C x + D u, unknown disturbances being states, are as many equations as there are
 * states, or more: the least squares of those of y, each over the size of its row, with those of rest, which
 * hold, weighed much more. Where all can be met they are, whatever the weight.
 */
#include "predict/initial_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"

#define HOLDS 1e5

struct apc_initial_state {
    const struct apc_linear *model;
    size_t n, rows; /* states that something moves: all but the disturbances; equations */
    double *Q, *R;  /* [rows * rows], [rows * nx] */
    double *scale;  /* [rows] */
    double *side, *turned;
    double *memory;
};

static int solve_steady_state(struct apc_initial_state *r, struct apc_error *why)
{
    const struct apc_linear *m = r->model;

    for (size_t i = 0; i < r->rows; i++) {
        double *row = r->R + i * m->nx, size;

        memcpy(row, i < r->n ? m->A + i * m->nx : m->C + (i - r->n) * m->nx, m->nx * sizeof(*row));
        if (i < r->n)
            row[i] -= 1.0;
        size = sqrt(apc_matrix_dot(row, row, m->nx));
        r->scale[i] = (i < r->n ? HOLDS : 1.0) / (size > 0.0 ? size : 1.0);
        for (size_t j = 0; j < m->nx; j++)
            row[j] *= r->scale[i];
    }
    if (apc_matrix_decompose(r->rows, m->nx, r->R, r->Q, r->side))
        return apc_fail(why, APC_EINVAL, "at rest the measurements do not show every state of the model");
    return 0;
}

int apc_initial_state_create(struct apc_initial_state **rest, const struct apc_linear *model,
                             struct apc_error *why)
{
    const size_t n = model->nx_plant + model->nx_held, rows = n + model->ny;
    struct apc_initial_state *r = calloc(1, sizeof(*r));
    int rc = 0;

    *rest = NULL;
    if (!r)
        return apc_fail(why, APC_ENOMEM, "no memory");
    *r = (struct apc_initial_state){.model = model, .n = n, .rows = rows};
    const struct apc_part parts[] = {APC_PART(r->Q, rows * rows), APC_PART(r->R, rows * model->nx),
                                     APC_PART(r->scale, rows), APC_PART(r->side, rows),
                                     APC_PART(r->turned, rows)};

    r->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    rc = r->memory ? solve_steady_state(r, why) : apc_fail(why, APC_ENOMEM, "no memory");
    if (rc < 0)
        apc_initial_state_destroy(r);
    else
        *rest = r;
    return rc;
}

void apc_initial_state_destroy(struct apc_initial_state *rest)
{
    if (!rest)
        return;
    free(rest->memory);
    free(rest);
}

void apc_initial_state_find(struct apc_initial_state *r, const double *y, const double *u, double *x)
{
    const struct apc_linear *m = r->model;
    const size_t nx = m->nx, inputs = m->nu + m->nd;

    for (size_t i = 0; i < r->rows; i++) {
        const double *row = i < r->n ? m->B + i * inputs : m->D + (i - r->n) * inputs;
        double sum = i < r->n ? 0.0 : m->y0[i - r->n] - y[i - r->n];

        for (size_t j = 0; j < inputs; j++)
            sum += row[j] * (u[j] - m->u0[j]);
        r->side[i] = -sum * r->scale[i];
    }
    for (size_t j = 0; j < nx; j++) {
        r->turned[j] = 0.0;
        for (size_t i = 0; i < r->rows; i++)
            r->turned[j] += r->Q[i * r->rows + j] * r->side[i];
    }
    for (size_t j = nx; j-- > 0;) {
        double sum = r->turned[j];

        for (size_t k = j + 1; k < nx; k++)
            sum -= r->R[j * nx + k] * (x[k] - m->x0[k]);
        x[j] = m->x0[j] + sum / r->R[j * nx + j];
    }
}
