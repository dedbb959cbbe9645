/* SPDX-License-Identifier: BSD-3-Clause */
/* The loop cut open: what comes back at each frequency. */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"

/* ---- The frequency response ------------------------------------------------------------------ */

static void cut_dead(void *ctx, const struct step *step, const double *slot, double *acting)
{
    const struct open *o = ctx;
    const size_t w = o->machine.n;

    if (o->place[step->number] < o->m)
        memset(acting, 0, w * sizeof(*acting));
    else
        memcpy(acting, slot, w * sizeof(*acting));
}

/* What goes in is exp(i w t), t being when it was computed; what comes back is compared with that. */
static void cut_driven(void *ctx, const struct step *step, const double *slot, double *acting)
{
    struct open *o = ctx;
    const size_t k = o->place[step->number], m = o->m;
    const double angle = o->w * apc_ns_to_s(step->tick), c = apc_cos(angle), s = apc_sin(angle);

    if (k == m) {
        memcpy(acting, slot, 2 * m * sizeof(*acting));
        return;
    }
    for (size_t j = 0; j < m && o->listens; j++)
        o->L[k * m + j] -= apc_complex(slot[j], slot[m + j]) * apc_complex(c, -s) / (double)o->ticks[k];
    memset(acting, 0, 2 * m * sizeof(*acting));
    acting[k] = c;
    acting[m + k] = s;
}

/* What goes in is 1 whenever it is that one's turn in a period; what comes back is taken then. */
static void cut_lifted(void *ctx, const struct step *step, const double *slot, double *acting)
{
    struct open *o = ctx;
    const size_t k = o->slot[step - o->machine.step], m = o->m;

    if (k == m) {
        memcpy(acting, slot, 2 * m * sizeof(*acting));
        return;
    }
    for (size_t j = 0; j < m && o->listens; j++)
        o->L[k * m + j] -= apc_complex(slot[j], slot[m + j]);
    memset(acting, 0, 2 * m * sizeof(*acting));
    acting[k] = 1.0;
}

void open_free(struct open *o)
{
    machine_free(&o->machine);
    free(o->slot);
    free(o->of);
    free(o->map);
    free(o->A);
    free(o->Z);
}

static int lift(struct open *o)
{
    const size_t outputs = o->m;

    o->slot = calloc(o->machine.n_steps + 1, sizeof(*o->slot));
    if (!o->slot)
        return APC_ENOMEM;
    o->m = 0;
    for (size_t k = 0; k < outputs; k++)
        o->m += o->ticks[k];
    for (size_t i = 0, next = 0; i < o->machine.n_steps; i++) {
        const struct step *step = &o->machine.step[i];
        const bool cut = step->kind == STEP_ACT && o->place[step->number] < outputs;

        o->slot[i] = cut ? next++ : o->m;
    }
    for (size_t k = 0; k < o->loop->n_out; k++)
        o->place[k] = o->place[k] < outputs ? o->place[k] : o->m;
    return 0;
}

int open_create(struct open *o, const struct apc_loop *loop, size_t of, const double *delay)
{
    const struct apc_loop_setup *s = &loop->setup;
    const struct schedule schedule = {.period = s->period, .n = s->n_ticks, .tick = s->tick, .delay = delay};
    struct ride ride;
    size_t n;
    int rc;

    *o = (struct open){.loop = loop, .of = calloc(3 * loop->n_out, sizeof(*o->of))};
    rc = machine_create(&o->machine, loop, &schedule, NULL);
    n = o->machine.n;
    if (rc < 0 || !o->of)
        return rc < 0 ? rc : APC_ENOMEM;
    o->place = o->of + loop->n_out;
    o->ticks = o->place + loop->n_out;
    for (size_t k = 0; k < loop->n_out; k++) {
        if (of == APC_LOOP_WHOLE ? loop->to[k] != APC_LOOP_NOWHERE : of == k)
            o->of[o->m++] = k;
    }
    for (size_t k = 0; k < loop->n_out; k++)
        o->place[k] = o->m;
    for (size_t k = 0; k < o->m; k++)
        o->place[o->of[k]] = k;
    for (size_t i = 0; i < o->machine.n_steps; i++) {
        const struct step *step = &o->machine.step[i];

        if (step->kind == STEP_ACT && o->place[step->number] < o->m)
            o->ticks[o->place[step->number]]++;
    }
    if (delay && (rc = lift(o)) < 0)
        return rc;
    o->map = calloc(n * n + 1, sizeof(*o->map));
    o->A = calloc(n * n + n * o->m + o->m * o->m + 1, sizeof(*o->A));
    o->Z = calloc(2 * n * o->m + 1, sizeof(*o->Z));
    if (!o->map || !o->A || !o->Z)
        return APC_ENOMEM;
    o->X = o->A + n * n;
    o->L = o->X + n * o->m;
    for (size_t i = 0; i < n; i++)
        o->map[i * n + i] = 1.0;
    ride = (struct ride){.Z = o->map, .width = n, .cut = cut_dead, .ctx = o};
    return machine_ride(&o->machine, &ride);
}

static int drive_open_loop(struct open *o, bool listens)
{
    struct ride ride = {.Z = o->Z, .width = 2 * o->m, .cut = o->slot ? cut_lifted : cut_driven, .ctx = o};

    o->listens = listens;
    return machine_ride(&o->machine, &ride);
}

int loop_frequency_response(struct open *o, double w)
{
    const size_t n = o->machine.n, m = o->m;
    const double angle = w * apc_ns_to_s(o->loop->setup.period);
    int rc;

    o->w = w;
    memset(o->Z, 0, 2 * n * m * sizeof(*o->Z));
    memset(o->L, 0, m * m * sizeof(*o->L));
    rc = drive_open_loop(o, false);
    for (size_t i = 0; i < n * n; i++)
        o->A[i] = (i % (n + 1) == 0 ? apc_complex(apc_cos(angle), apc_sin(angle)) : 0.0) - o->map[i];
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < m; j++)
            o->X[i * m + j] = apc_complex(o->Z[i * 2 * m + j], o->Z[i * 2 * m + m + j]);
    }
    if (rc == 0 && complex_solve(n, m, o->A, o->X))
        rc = APC_ESOLVER; /* a pole of the open loop lies there */
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < m; j++) {
            o->Z[i * 2 * m + j] = creal(o->X[i * m + j]);
            o->Z[i * 2 * m + m + j] = cimag(o->X[i * m + j]);
        }
    }
    return rc < 0 ? rc : drive_open_loop(o, true);
}

int apc_loop_response(const struct apc_loop *loop, size_t of, size_t n, const double *w, double *re,
                      double *im)
{
    struct open o;
    int rc;

    if (of >= loop->n_out)
        return APC_EINVAL;
    rc = open_create(&o, loop, of, NULL);
    for (size_t k = 0; k < n && rc == 0; k++) {
        const bool there = loop_frequency_response(&o, w[k]) == 0 && o.ticks[0];

        re[k] = there ? creal(o.L[0]) : (double)NAN;
        im[k] = there ? cimag(o.L[0]) : (double)NAN;
    }
    open_free(&o);
    return rc;
}
