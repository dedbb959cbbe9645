/* SPDX-License-Identifier: BSD-3-Clause */
#include "predict/nested.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "plant/plant_internal.h"

struct apc_nested {
    const struct apc_model *model;
    struct apc_reduced reduced;
    size_t loops;
    struct apc_nested_loop *loop; /* [nu] */
    double *p, *y, *u;            /* [np], [ny], [nu + nd] */
};

int apc_nested_create(struct apc_nested **nested, const struct apc_model *model, const double *p,
                      const struct apc_nested_loop *loop, struct apc_error *why)
{
    struct apc_nested *n = calloc(1, sizeof(*n));
    int rc;

    *nested = n;
    if (!n)
        return apc_fail(why, APC_ENOMEM, "no memory");
    n->model = model;
    n->loop = calloc(model->nu, sizeof(*n->loop));
    n->p = calloc(model->np + model->ny + model->nu + model->nd + 1, sizeof(*n->p));
    if (!n->loop || !n->p) {
        rc = apc_fail(why, APC_ENOMEM, "no memory");
    } else {
        n->y = n->p + model->np;
        n->u = n->y + model->ny;
        for (size_t j = 0; j < model->nu; j++) {
            n->loop[j] = loop[j];
            n->loops += loop[j].there;
        }
        rc = apc_model_take(model, n->p, p, model->param, model->np, "parameter", why);
        if (rc == 0)
            rc = apc_reduced_open(&n->reduced, model, n->p, why);
    }
    if (rc < 0) {
        apc_nested_destroy(n);
        *nested = NULL;
    }
    return rc;
}

void apc_nested_destroy(struct apc_nested *nested)
{
    if (!nested)
        return;
    apc_reduced_close(&nested->reduced);
    free(nested->p);
    free(nested->loop);
    free(nested);
}

size_t apc_nested_states(const struct apc_nested *n)
{
    return n->model->nx + n->loops;
}

/* n->u of the model; what the loops see is of a model in which no input acts on a measurement at once. The
 * slopes of I, if wanted. */
static void close_loops(struct apc_nested *n, const double *x, const double *u, double *dI)
{
    const struct apc_model *m = n->model;
    const double *I = x + m->nx;

    memcpy(n->u, u, (m->nu + m->nd) * sizeof(*u));
    apc_reduced_g(&n->reduced, x, n->u, n->y);
    for (size_t j = 0, k = 0; j < m->nu; j++) {
        const struct apc_nested_loop *l = &n->loop[j];
        const double low = m->input ? m->input[j].low : -HUGE_VAL,
                     high = m->input ? m->input[j].high : HUGE_VAL;

        if (!l->there)
            continue;
        const double error = l->gain * (u[j] - n->y[l->y]), wanted = error + I[k];
        const bool waits = (wanted > high && error > 0.0) || (wanted < low && error < 0.0);

        n->u[j] = fmin(fmax(wanted, low), high);
        if (dI)
            dI[k] = waits ? 0.0 : error / l->tau;
        k++;
    }
}

int apc_nested_slope(struct apc_nested *n, const double *x, const double *u, double *dx)
{
    close_loops(n, x, u, dx + n->model->nx);
    return apc_reduced_f(&n->reduced, x, n->u, dx);
}

void apc_nested_output(struct apc_nested *n, const double *x, const double *u, double *y)
{
    close_loops(n, x, u, NULL);
    apc_reduced_g(&n->reduced, x, n->u, y);
}

const char *apc_nested_error(const struct apc_nested *n)
{
    return apc_reduced_error(&n->reduced);
}

int apc_nested_linearise(const struct apc_nested *n, const struct apc_linear_continuous *from, double *A,
                         double *B, double *C, double *x0, double *u0, struct apc_error *why)
{
    const size_t nx = from->nx, nu = from->nu, all = nu + from->nd, ny = from->ny, wide = nx + n->loops;
    size_t integral = nx;

    for (size_t k = 0; k < ny * all; k++) {
        if (k % all < nu && from->D[k] != 0.0)
            return apc_fail(
                why, APC_EINVAL,
                "setting \"lower\": output %zu acts on measurement %zu at once, which loops below "
                "cannot have",
                k % all + 1, k / all + 1);
    }
    memset(A, 0, wide * wide * sizeof(*A));
    memset(B, 0, wide * all * sizeof(*B));
    memset(C, 0, ny * wide * sizeof(*C));
    for (size_t i = 0; i < nx; i++) {
        memcpy(A + i * wide, from->A + i * nx, nx * sizeof(*A));
        memcpy(B + i * all, from->B + i * all, all * sizeof(*B));
    }
    for (size_t c = 0; c < ny; c++)
        memcpy(C + c * wide, from->C + c * nx, nx * sizeof(*C));
    memcpy(x0, from->x0, nx * sizeof(*x0));
    memcpy(u0, from->u0, all * sizeof(*u0));
    for (size_t j = 0; j < nu; j++) {
        const struct apc_nested_loop *l = &n->loop[j];
        const double *row = from->C + l->y * nx, *direct = from->D + l->y * all, rate = l->gain / l->tau;

        if (!l->there)
            continue;
        for (size_t i = 0; i < nx; i++) {
            const double b = from->B[i * all + j];

            for (size_t k = 0; k < nx; k++)
                A[i * wide + k] -= b * l->gain * row[k];
            for (size_t k = nu; k < all; k++)
                B[i * all + k] -= b * l->gain * direct[k];
            A[i * wide + integral] = b;
            B[i * all + j] = b * l->gain;
        }
        for (size_t k = 0; k < nx; k++)
            A[integral * wide + k] = -rate * row[k];
        for (size_t k = nu; k < all; k++)
            B[integral * all + k] = -rate * direct[k];
        B[integral * all + j] = rate;
        x0[integral++] = from->u0[j];
        u0[j] = from->y0[l->y];
    }
    return 0;
}
