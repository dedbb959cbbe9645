/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive control publishes: its variables, and their values in the same order. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "control/mpc.h"

/* ---- Which variables -------------------------------------------------------------------------------- */

/* Number k: of this signal, or of number i, of which nothing is known. */
static void declare_published(struct apc_law_mpc *p, size_t k, const struct apc_signal_view *signal,
                              char letter, size_t i, const char *suffix, const char *description,
                              size_t length)
{
    struct apc_law_mpc_name *name = &p->name[k];
    const char *unit = signal && signal->unit ? signal->unit : "";

    if (signal && signal->name)
        snprintf(name->name, sizeof(name->name), "%s.%s", signal->name, suffix);
    else
        snprintf(name->name, sizeof(name->name), "%c%zu.%s", letter, i + 1, suffix);
    snprintf(name->unit, sizeof(name->unit), "%s", *unit ? unit : "1");
    p->published[k] = (struct apc_published){.name = name->name,
                                             .unit = name->unit,
                                             .description = description,
                                             .length = length,
                                             .step = length ? p->Ts : 0.0};
}

static const struct apc_signal_view *view_of_signal(const struct apc_signal_view *signal, size_t i)
{
    return signal ? signal + i : NULL;
}

/* Called by where it comes in. */
static void declare_disturbance(struct apc_law_mpc *p, size_t k, const struct apc_law_setup *setup, size_t i)
{
    static const char what[] = "disturbance that nobody measures, as it is estimated";
    const struct apc_linear_unknown *u = &p->unknown[i];

    if (u->where == APC_AT_OUTPUT) {
        declare_published(p, k, view_of_signal(setup->y, u->number), 'y', u->number, "disturbance", what, 0);
    } else if (u->number < p->dim.nu) {
        declare_published(p, k, view_of_signal(setup->u, u->number), 'u', u->number, "disturbance", what, 0);
    } else {
        const struct apc_param *own = &setup->plant->model->disturbance[u->number - p->dim.nu];

        declare_published(p, k, &(struct apc_signal_view){.name = own->name, .unit = own->unit}, 'd', 0,
                          "disturbance", what, 0);
    }
}

static void declare_states(struct apc_law_mpc *p, size_t k, const struct apc_law_setup *setup)
{
    const struct apc_model *model = setup->plant->model;

    for (size_t i = 0; i < p->disturbed->nx_plant; i++) {
        const bool named = model && model->nx == p->disturbed->nx_plant;
        const struct apc_signal_view state = {.name = named ? model->state[i].name : NULL,
                                              .unit = named ? model->state[i].unit : NULL};

        declare_published(p, k + i, &state, 'x', i, "estimate", "state of the model, estimated", 0);
    }
}

/* In the order in which apc_mpc_publish() fills them in. */
int apc_mpc_declare(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_law_needs *needs,
                    struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu, n_unknown = p->n_unknown,
                 n = 3 * ny + 3 * nu + n_unknown + 4 + p->disturbed->nx_plant;
    size_t k = 0;

    p->published = calloc(n, sizeof(*p->published));
    p->name = calloc(n, sizeof(*p->name));
    if (!p->published || !p->name)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t i = 0; i < ny; i++)
        declare_published(p, k++, view_of_signal(setup->y, i), 'y', i, "prediction",
                          "predicted from the next sample on", p->N);
    for (size_t j = 0; j < nu; j++)
        declare_published(p, k++, view_of_signal(setup->u, j), 'u', j, "plan", "moves from now on", p->N);
    for (size_t i = 0; i < ny; i++)
        declare_published(p, k++, view_of_signal(setup->y, i), 'y', i, "target", "steady-state target", 0);
    for (size_t j = 0; j < nu; j++)
        declare_published(p, k++, view_of_signal(setup->u, j), 'u', j, "target", "steady-state target", 0);
    for (size_t i = 0; i < n_unknown; i++)
        declare_disturbance(p, k++, setup, i);
    for (size_t i = 0; i < ny; i++)
        declare_published(p, k++, view_of_signal(setup->y, i), 'y', i, "limit",
                          "active constraints of the plan: 1 its low limit, 2 high", 0);
    for (size_t j = 0; j < nu; j++)
        declare_published(p, k++, view_of_signal(setup->u, j), 'u', j, "limit",
                          "active constraints of the plan: 1 low, 2 high, 4 low rate limit, 8 high", 0);
    for (size_t i = 2 * (ny + nu) + n_unknown; i < k; i++)
        snprintf(p->name[i].unit, sizeof(p->name[i].unit), "1");
    p->published[k++] = (struct apc_published){
        .name = "objective", .unit = "1", .description = "of the plan: what it expects to cost; 0 at rest"};
    p->published[k++] = (struct apc_published){
        .name = "solve_time", .unit = "s", .description = "that the plan took; 0 in virtual time"};
    p->published[k++] = (struct apc_published){
        .name = "result", .unit = "1", .description = "of this tick: 0 good, 1 sub-optimal, 2 late"};
    p->published[k++] = (struct apc_published){
        .name = "iterations", .unit = "1", .description = "changes of the working set at this tick"};
    declare_states(p, k, setup);
    needs->n_published = n;
    needs->published = p->published;
    return 0;
}

/* ---- Their values ----------------------------------------------------------------------------------- */

/* An output that is given, whose plan follows from that, is held back by nobody. */
static void publish_limits(const struct apc_law_mpc *p, double *at)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu;
    const double *limits = apc_mpc_limits_of(p, p->x);

    memcpy(at, limits + nu, ny * sizeof(*at));
    for (size_t j = 0; j < nu; j++)
        at[ny + j] = p->given[j] ? 0.0 : limits[j];
}

void apc_mpc_publish(struct apc_law_mpc *p, const struct apc_law_call *c, int result)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu, old = (size_t)*apc_mpc_age_of(p, p->x) - 1;
    double *at = c->published, cost;

    if (!at)
        return;
    apc_mpc_shift_plan(p, old);
    cost = apc_mpc_predict(p->mpc, p->shifted, p->prediction);
    for (size_t i = 0; i < ny; i++) {
        for (size_t k = 0; k < p->N; k++)
            *at++ = p->prediction[k * ny + i];
    }
    for (size_t k = 0; k < p->N; k++) {
        const double *move = apc_mpc_move(p->mpc, apc_mpc_plan_of(p, p->x), old + k);

        for (size_t j = 0; j < nu; j++)
            at[j * p->N + k] = move[j];
    }
    at += nu * p->N;
    apc_mpc_target(p->mpc, p->N, at, at + ny);
    at += ny + nu;
    for (size_t k = 0; k < p->n_unknown; k++)
        *at++ = p->x[p->nx - p->n_unknown + k];
    publish_limits(p, at);
    at += ny + nu;
    *at++ = cost;
    *at++ = p->took;
    *at++ = result;
    *at++ = p->result.iterations;
    memcpy(at, p->x, p->disturbed->nx_plant * sizeof(*at));
}
