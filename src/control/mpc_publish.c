/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive control tells: variables that it publishes, with their values in the same order, and what a plan
 * comes from. */
#include <math.h>
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
        snprintf(name->of, sizeof(name->of), "%s", signal->name);
    else
        snprintf(name->of, sizeof(name->of), "%c%zu", letter, i + 1);
    snprintf(name->name, sizeof(name->name), "%.50s.%s", name->of, suffix);
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
    static const char what[] = "unmeasured disturbance, as it is estimated";
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

/* ---- What a plan comes from ------------------------------------------------------------------------- */

/* By how much the plan differs from what is left of the former one, where that is most; NAN: there was none. */
static double plan_change(const struct apc_law_mpc *p, const struct apc_law_call *c, size_t j)
{
    const size_t before = (size_t)*apc_mpc_age_of(p, c->x), now = (size_t)*apc_mpc_age_of(p, p->x);
    double most = 0.0;

    if (!before || !now)
        return (double)NAN;
    for (size_t i = 0; i < p->N; i++) {
        const double change = apc_mpc_move(p->mpc, apc_mpc_plan_of(p, p->x), i + now - 1)[j] -
                              apc_mpc_move(p->mpc, apc_mpc_plan_of(p, c->x), i + before)[j];

        most = fabs(change) > fabs(most) ? change : most;
    }
    return most;
}

static double multiplier_of_limit(const struct apc_law_mpc *p, size_t limit, size_t j)
{
    const size_t nu = p->dim.nu;
    const bool of_rate = limit >= 2 && limit < 4, of_y = limit >= 4;

    if (p->result.rc < 0 || p->result.waits)
        return (double)NAN;
    if (!of_y && p->given[j])
        return 0.0;
    return (of_rate ? p->Ts : 1.0) *
           p->multiplier[of_y ? 4 * nu + (limit - 4) * p->dim.ny + j : limit * nu + j];
}

static void tell_term(struct apc_law_term *term, size_t most, size_t *n, const char *name, const char *of,
                      double value)
{
    if (*n < most)
        term[*n] = (struct apc_law_term){.name = name, .of = of, .value = value};
    ++*n;
}

size_t apc_mpc_terms(const struct apc_law_call *c, size_t i, struct apc_law_term *term, size_t most)
{
    static const char *const limits[] = {"low limit",   "high limit", "falling rate",
                                         "rising rate", "low limit",  "high limit"};
    const struct apc_law_mpc *p = c->self;
    const size_t ny = p->dim.ny, nu = p->dim.nu;
    const struct apc_law_mpc_name *y = p->name, *u = y + ny, *disturbed = u + nu + ny + nu;
    size_t n = 0;

    apc_mpc_multipliers(p->mpc, p->multiplier, p->multiplier + 4 * nu);
    for (size_t limit = 0; limit < sizeof(limits) / sizeof(*limits); limit++)
        for (size_t k = 0; k < (limit < 4 ? nu : ny); k++)
            tell_term(term, most, &n, limits[limit], limit < 4 ? u[k].of : y[k].of,
                      multiplier_of_limit(p, limit, k));
    for (size_t k = 0; k < p->n_unknown; k++)
        tell_term(term, most, &n, "disturbance", disturbed[k].of, p->x[p->nx - p->n_unknown + k]);
    tell_term(term, most, &n, "plan change", u[i].of, plan_change(p, c, i));
    tell_term(term, most, &n, "rank given up", NULL,
              p->result.rc < 0 ? (double)NAN : (double)p->result.given_up);
    return n;
}
