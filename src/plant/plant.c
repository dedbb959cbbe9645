/* SPDX-License-Identifier: BSD-3-Clause */
/* A model with its parameters and its state; which integrator moves it is this file's choice alone. */
#include "base/base_internal.h"
#include "plant/plant_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct apc_plant {
    const struct apc_model *model;
    const struct apc_integrator *integrator;
    void *solver;
    struct apc_plant_options options; /* of the solver */
    struct apc_delay delay;
    double t;
    double *memory;         /* all the doubles below */
    double *p;              /* [np] */
    double *x, *x_before;   /* [nx + nz] */
    double *in, *in_before; /* [nu + nd] what acts: manipulated inputs, disturbances */
    double *given;          /* [nu + nd] scratch for outputs */
    struct apc_error error;
};

/* ---- Set-up --------------------------------------------------------------------------------- */

static int take_plant_options(struct apc_plant_options *ours, const struct apc_plant_options *theirs,
                              const struct apc_model *model, struct apc_error *why)
{
    int rc = apc_options_copy(ours, sizeof(*ours), theirs, "apc_plant_options", why);

    if (rc < 0)
        return rc;
    if (!ours->integrator)
        ours->integrator = apc_model_nz(model) ? apc_integrator_ida.name : "cvode";
    if (ours->rtol == 0.0)
        ours->rtol = 1e-8;
    if (ours->atol == 0.0)
        ours->atol = 1e-10;
    if (ours->steps == 0)
        ours->steps = 10;
    if (!(ours->rtol > 0.0 && ours->rtol < 1.0 && ours->atol > 0.0 && isfinite(ours->atol)))
        return apc_fail(why, APC_EINVAL,
                        "integrator: rtol is %g, must lie in 0 to 1; atol is %g, must be above 0", ours->rtol,
                        ours->atol);
    if (!(ours->patience >= 0.0 && isfinite(ours->patience)))
        return apc_fail(why, APC_EINVAL, "patience is %g s; it must be a finite number, 0 or above",
                        ours->patience);
    if (!(ours->period >= 0.0 && isfinite(ours->period)))
        return apc_fail(why, APC_EINVAL, "period is %g s; it must be a finite number, 0 or above",
                        ours->period);
    if (ours->steps > 1000000)
        return apc_fail(why, APC_EINVAL, "integrator: %u steps in each interval; at most 1000000",
                        ours->steps);
    if (!(ours->dead_time >= 0.0 && isfinite(ours->dead_time)))
        return apc_fail(why, APC_EINVAL, "dead time is %g s; it must be a finite number, 0 or above",
                        ours->dead_time);
    return 0;
}

static int find_integrator(const struct apc_integrator **integrator, const char *name,
                           const struct apc_model *model, struct apc_error *why)
{
    static const struct apc_integrator *const all[] = {&apc_integrator_cvode, &apc_integrator_adams,
                                                       &apc_integrator_rk4, &apc_integrator_exact,
                                                       &apc_integrator_ida};
    const size_t nz = apc_model_nz(model);
    size_t i = 0;

    *integrator = &apc_integrator_fmu;
    if (name == apc_integrator_fmu.name) /* nobody else can name it */
        return 0;
    while (i < sizeof(all) / sizeof(all[0]) && strcmp(all[i]->name, name) != 0)
        i++;
    if (i == sizeof(all) / sizeof(all[0]))
        return apc_fail(why, APC_EINVAL, "no integrator \"%s\"; there are: cvode, adams, rk4, exact, ida",
                        name);
    *integrator = all[i];
    if (nz && all[i] != &apc_integrator_ida)
        return apc_fail(
            why, APC_EINVAL,
            "%s has algebraic equations (%zu): its integrator is \"ida\", the default, not \"%s\"",
            model->name, nz, name);
    if (!nz && all[i] == &apc_integrator_ida)
        return apc_fail(why, APC_EINVAL,
                        "%s has no algebraic equations: integrator \"ida\" is for those; take \"cvode\"",
                        model->name);
    return 0;
}

static int check_fmu(const struct apc_model *model, const double *x0, const char *integrator,
                     struct apc_plant_options *ours, struct apc_error *why)
{
    if (integrator)
        return apc_fail(
            why, APC_EINVAL,
            "%s runs by itself, as FMUs and plants in Python do: it has its own integrator, not \"%s\"",
            model->name, integrator);
    if (x0)
        return apc_fail(
            why, APC_EINVAL,
            "%s runs by itself, as FMUs and plants in Python do: its parameters say where it starts, no x0",
            model->name);
    ours->integrator = apc_integrator_fmu.name;
    return 0;
}

static int allocate_plant(struct apc_plant *plant)
{
    const struct apc_model *m = plant->model;
    size_t n_in = m->nu + m->nd, n = m->nx + apc_model_nz(m);
    double *at = calloc(m->np + 2 * n + 3 * n_in, sizeof(*at));

    plant->memory = at;
    if (!at)
        return APC_ENOMEM;
    plant->p = at;
    plant->x = at + m->np;
    plant->x_before = plant->x + n;
    plant->in = plant->x_before + n;
    plant->in_before = plant->in + n_in;
    plant->given = plant->in_before + n_in;
    return 0;
}

static int set_up_solver(struct apc_plant *plant, const double *p, const double *x0,
                         const struct apc_plant_options *o, struct apc_error *why)
{
    const struct apc_model *m = plant->model;
    struct apc_error cause;
    int rc = find_integrator(&plant->integrator, o->integrator, m, why);

    if (rc == 0 && (allocate_plant(plant) < 0 || apc_delay_open(&plant->delay, o->dead_time, m->nu) < 0))
        rc = apc_fail(why, APC_ENOMEM, "no memory for plant %s", m->name);
    if (rc == 0)
        rc = apc_model_take(m, plant->p, p, m->param, m->np, "parameter", why);
    if (rc == 0)
        rc = apc_model_take(m, plant->x, x0, m->state, m->nx, "state", why);
    if (rc < 0)
        return rc;
    if (apc_model_nz(m))
        apc_param_initials(m->algebraic, m->nz, plant->x + m->nx);
    apc_param_initials(m->input, m->nu, plant->in);
    apc_param_initials(m->disturbance, m->nd, plant->in + m->nu);
    plant->options = *o;
    rc = plant->integrator->create(&plant->solver, m, plant->p, o, why);
    if (rc < 0 || !plant->integrator->start)
        return rc;
    rc = plant->integrator->start(plant->solver, plant->in, plant->x, &cause);
    return rc < 0 ? apc_fail(why, rc, "%s cannot start: %s", m->name, cause.text) : 0;
}

int apc_plant_create(struct apc_plant **plant, const struct apc_model *model, const double *p,
                     const double *x0, const struct apc_plant_options *options, struct apc_error *why)
{
    struct apc_plant_options o = {0};
    struct apc_plant *new;
    int rc;

    if (!plant)
        return apc_fail(why, APC_EINVAL, "apc_plant_create: plant must not be NULL");
    *plant = NULL;
    if (!model)
        return apc_fail(why, APC_EINVAL, "apc_plant_create: model must not be NULL");
    rc = apc_model_check(model, "apc_plant_create", why);
    if (rc == 0)
        rc = take_plant_options(&o, options, model, why);
    if (rc == 0 && apc_model_is_fmu(model))
        rc = check_fmu(model, x0, options ? options->integrator : NULL, &o, why);
    if (rc != 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "no memory for plant %s", model->name);
    new->model = model;
    rc = set_up_solver(new, p, x0, &o, why);
    if (rc < 0)
        apc_plant_destroy(new);
    else
        *plant = new;
    return rc;
}

int apc_plant_change(struct apc_plant *plant, const double *p, struct apc_error *why)
{
    const struct apc_model *m = plant->model;
    double *former = calloc(m->np + 1, sizeof(*former));
    void *solver = NULL;
    int rc;

    if (apc_model_is_fmu(m)) {
        free(former);
        return apc_fail(
            why, APC_EINVAL,
            "%s runs by itself, as FMUs and plants in Python do: it takes its parameters as it starts",
            m->name);
    }
    if (!former)
        return apc_fail(why, APC_ENOMEM, "no memory for plant %s", m->name);
    memcpy(former, plant->p, m->np * sizeof(*former));
    rc = apc_model_take(m, plant->p, p, m->param, m->np, "parameter", why);
    if (rc == 0)
        rc = plant->integrator->create(&solver, m, plant->p, &plant->options, why);
    if (rc == 0) {
        plant->integrator->destroy(plant->solver);
        plant->solver = solver;
    } else {
        memcpy(plant->p, former, m->np * sizeof(*former));
    }
    free(former);
    return rc;
}

void apc_plant_destroy(struct apc_plant *plant)
{
    if (!plant)
        return;
    if (plant->solver)
        plant->integrator->destroy(plant->solver);
    apc_delay_close(&plant->delay);
    free(plant->memory);
    free(plant);
}

/* ---- Running -------------------------------------------------------------------------------- */

/* What failed, and where: the time and the state from which it could not go on. */
static int report_solver_failure(struct apc_plant *plant, int rc, const char *what)
{
    const struct apc_model *m = plant->model;
    char where[300] = "";
    size_t used = 0;

    for (size_t i = 0; i < m->nx && used < sizeof(where); i++) {
        char number[24];
        const char *name = m->state ? m->state[i].name : number;

        (void)snprintf(number, sizeof(number), "x%zu", i + 1);
        used += (size_t)snprintf(where + used, sizeof(where) - used, "%s%s = %g", i ? ", " : "", name,
                                 plant->x[i]);
    }
    return apc_fail(&plant->error, rc, "%s at t = %g s, %s: %s", m->name, plant->t, where, what);
}

/* Piece by piece between the delayed changes of the input. Pieces of less than a billionth of dt come of
 * rounding and are no pieces. */
static int advance_delayed(struct apc_plant *plant, double dt, const double *u, struct apc_error *why)
{
    const double sliver = 1e-9 * dt, end = plant->t + dt;
    double at = plant->t;

    if (!apc_delay_put(&plant->delay, at, u, plant->in))
        return apc_fail(why, APC_ESOLVER, "more than %d changes of the input within its dead time of %g s",
                        APC_DELAY_MAX, plant->delay.dead_time);
    while (at < end) {
        double next = apc_delay_take(&plant->delay, at + sliver, plant->in);
        int rc;

        if (next > end - sliver)
            next = end;
        rc = plant->integrator->step(plant->solver, at, next - at, plant->in, plant->x, why);
        if (rc < 0)
            return rc;
        at = next;
    }
    return 0;
}

int apc_plant_advance(struct apc_plant *plant, double dt, const double *u)
{
    const struct apc_model *m = plant->model;
    const struct apc_delay delay = plant->delay;
    const size_t x_bytes = (m->nx + apc_model_nz(m)) * sizeof(double),
                 in_bytes = (m->nu + m->nd) * sizeof(double);
    struct apc_error why;
    int rc;

    why.text[0] = '\0';
    if (!(dt >= 0.0) || !isfinite(dt)) {
        (void)apc_fail(&why, APC_ESOLVER, "cannot advance by %g s", dt);
        return report_solver_failure(plant, APC_ESOLVER, why.text);
    }
    for (size_t i = 0; i < m->nu; i++) {
        if (!isfinite(u[i])) {
            (void)apc_fail(&why, APC_ESOLVER, "input %zu is not a finite number", i + 1);
            return report_solver_failure(plant, APC_ESOLVER, why.text);
        }
    }
    if (dt == 0.0)
        return 0;
    memcpy(plant->x_before, plant->x, x_bytes);
    memcpy(plant->in_before, plant->in, in_bytes);
    if (delay.dead_time > 0.0) {
        rc = advance_delayed(plant, dt, u, &why);
    } else {
        memcpy(plant->in, u, m->nu * sizeof(*u));
        rc = plant->integrator->step(plant->solver, plant->t, dt, plant->in, plant->x, &why);
    }
    if (rc == 0) {
        plant->t += dt;
        return 0;
    }
    memcpy(plant->x, plant->x_before, x_bytes);
    memcpy(plant->in, plant->in_before, in_bytes);
    plant->delay = delay;
    return report_solver_failure(plant, rc, why.text);
}

int apc_plant_disturb(struct apc_plant *plant, size_t k, double value)
{
    if (k >= plant->model->nd || !apc_value_ok(value))
        return apc_fail(&plant->error, APC_EINVAL, "%s: disturbance %zu of %zu cannot be %g",
                        plant->model->name, k + 1, plant->model->nd, value);
    plant->in[plant->model->nu + k] = value;
    return 0;
}

int apc_plant_kick(struct apc_plant *plant, size_t k, double by)
{
    const struct apc_model *m = plant->model;

    if (apc_model_is_fmu(m))
        return apc_fail(&plant->error, APC_EINVAL,
                        "%s runs by itself, as FMUs and plants in Python do: its states cannot be moved",
                        m->name);
    if (k >= m->nx || !apc_value_ok(by))
        return apc_fail(&plant->error, APC_EINVAL, "%s: state %zu of %zu cannot be moved by %g", m->name,
                        k + 1, m->nx, by);
    plant->x[k] += by;
    if (m->state)
        plant->x[k] = fmin(fmax(plant->x[k], m->state[k].low), m->state[k].high);
    return 0;
}

void apc_plant_output(struct apc_plant *plant, const double *u, double *y)
{
    const struct apc_model *m = plant->model;
    struct apc_error why;

    memcpy(plant->given, plant->in, (m->nu + m->nd) * sizeof(*u));
    if (!(plant->delay.dead_time > 0.0))
        memcpy(plant->given, u, m->nu * sizeof(*u));
    if (apc_model_is_fmu(m)) {
        memcpy(y, plant->x, m->ny * sizeof(*y));
        return;
    }
    if (plant->integrator->settle) {
        const int rc = plant->integrator->settle(plant->solver, plant->t, plant->given, plant->x, &why);

        for (size_t i = 0; rc < 0 && i < m->ny; i++)
            y[i] = (double)NAN;
        if (rc < 0) {
            (void)report_solver_failure(plant, rc, why.text);
            return;
        }
    }
    m->g(plant->t, plant->x, plant->given, plant->p, y);
}

const double *apc_plant_state(const struct apc_plant *plant)
{
    return plant->x;
}

double apc_plant_time(const struct apc_plant *plant)
{
    return plant->t;
}

const char *apc_plant_error(const struct apc_plant *plant)
{
    return plant->error.text;
}
