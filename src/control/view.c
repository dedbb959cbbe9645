/* SPDX-License-Identifier: BSD-3-Clause */
/* What a law is made from: a controller's setup, as one output sees it, and as a mark. */
#include "control/parts.h"
#include "control/process/process.h"

#include "apcestimate.h"
#include "apclinear.h"
#include "base/base_internal.h"

#include <stdlib.h>
#include <string.h>

int apc_law_check_settings(const struct apc_law *law, const struct apc_law_setup *setup,
                           struct apc_error *why)
{
    for (size_t i = 0; i < setup->n_setting; i++) {
        const char *const *known = law->settings;

        while (known && *known && strcmp(*known, setup->setting[i].name) != 0)
            known++;
        if (!known || !*known)
            return apc_fail(why, APC_EINVAL, "law %s has no setting \"%s\"", law->name,
                            setup->setting[i].name);
    }
    return 0;
}

static const struct apc_signal_view *view_signals(const struct apc_signal_view *from, const int *number,
                                                  size_t n, struct apc_signal_view *to)
{
    for (size_t i = 0; from && i < n; i++)
        to[i] = from[number[i]];
    return from ? to : NULL;
}

/* Its rows of C and D, its columns of B and D. */
static int view_plant(struct apc_law_view *v, const struct apc_law_plant *whole, const struct apc_dim *dim,
                      size_t output, const struct apc_law_ports *p)
{
    const size_t nx = whole->nx, width = dim->nu + dim->nd, own = 1 + p->nd;
    double *B = calloc(nx * own + p->ny * (nx + own + 1) + own, sizeof(*B)), *C, *D, *u0, *y0;

    if (!B)
        return APC_ENOMEM;
    C = B + nx * own;
    D = C + p->ny * nx;
    u0 = D + p->ny * own;
    y0 = u0 + own;
    for (size_t j = 0; j < own; j++) {
        const size_t column = j == 0 ? output : dim->nu + (size_t)p->d[j - 1];

        for (size_t i = 0; i < nx; i++)
            B[i * own + j] = whole->B[i * width + column];
        for (size_t i = 0; i < p->ny; i++)
            D[i * own + j] = whole->D[(size_t)p->y[i] * width + column];
        u0[j] = whole->u0[column];
    }
    for (size_t i = 0; i < p->ny; i++) {
        memcpy(C + i * nx, whole->C + (size_t)p->y[i] * nx, nx * sizeof(*C));
        y0[i] = whole->y0[p->y[i]];
    }
    v->memory = B;
    v->plant = (struct apc_law_plant){
        .nx = nx, .A = whole->A, .B = B, .C = C, .D = D, .x0 = whole->x0, .u0 = u0, .y0 = y0};
    return 0;
}

int apc_law_view_setup(struct apc_law_view *v, const struct apc_law_setup *whole, size_t output,
                       const struct apc_law_ports *p)
{
    v->memory = NULL;
    v->setup = *whole;
    v->setup.dim = (struct apc_dim){p->ny, p->nz, 1, p->nd};
    v->setup.output = output;
    v->setup.y = view_signals(whole->y, p->y, p->ny, v->y);
    v->setup.z = view_signals(whole->z, p->z, p->nz, v->z);
    v->setup.d = view_signals(whole->d, p->d, p->nd, v->d);
    v->setup.u = whole->u ? whole->u + output : NULL;
    v->setup.plant = whole->plant && !whole->plant->sampled ? &v->plant : NULL;
    return v->setup.plant ? view_plant(v, whole->plant, &whole->dim, output, p) : 0;
}

uint32_t apc_law_mark(const struct apc_law *law, const struct apc_law_setup *setup, size_t states)
{
    const struct apc_dim *d = &setup->dim;
    const struct apc_law_plant *plant = setup->plant;
    const size_t ny = d->ny, width = d->nu + d->nd, nx = plant ? plant->nx : 0;
    const size_t number[] = {law->version, law->whole, ny, d->nz, d->nu, d->nd, states, nx};
    uint32_t hash = apc_hash(APC_HASH_BEGIN, law->name, strlen(law->name));

    hash = apc_hash_number(hash, apc_plugin_mark((uintptr_t)law->compute) ^ apc_law_process_mark(law));
    for (size_t i = 0; i < sizeof(number) / sizeof(number[0]); i++)
        hash = apc_hash_number(hash, number[i]);
    hash = apc_hash_values(hash, &setup->Ts, 1);
    for (size_t i = 0; i < setup->n_setting; i++) {
        const struct apc_setting *a = &setup->setting[i];

        hash = apc_hash(hash, a->name, strlen(a->name) + 1);
        if (a->text) {
            hash = apc_hash(hash, a->text, strlen(a->text) + 1);
        } else {
            hash = apc_hash_number(apc_hash_number(hash, a->rows), a->columns);
            hash = apc_hash_values(hash, a->value, a->rows * a->columns);
        }
    }
    if (!plant)
        return hash;
    if (plant->sampled) {
        const struct apc_linear *m = plant->sampled;

        hash = apc_hash_values(apc_hash_values(hash, m->A, m->nx * m->nx), m->B, m->nx * width);
        hash = apc_hash_values(apc_hash_values(hash, m->C, ny * m->nx), m->x0, m->nx);
    }
    if (plant->model && plant->p) {
        hash = apc_hash(hash, plant->model->name, strlen(plant->model->name));
        hash = apc_hash_values(hash, plant->p, plant->model->np);
    }
    hash = apc_hash_values(apc_hash_values(hash, plant->A, nx * nx), plant->B, nx * width);
    hash = apc_hash_values(apc_hash_values(hash, plant->C, ny * nx), plant->D, ny * width);
    hash = apc_hash_values(apc_hash_values(hash, plant->x0, nx), plant->u0, width);
    return apc_hash_values(hash, plant->y0, ny);
}
