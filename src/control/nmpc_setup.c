/* SPDX-License-Identifier: BSD-3-Clause */
/* What nonlinear predictive control has in the place of a linear model: the plant's equations, an extended
 * Kalman filter for each part of a period, shooting. */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"
#include "control/mpc.h"
#include "predict/predict_internal.h"

#define SHORTEST 1e-5 /* s, of a part of a period */
enum { STEPS_MOST = 1000, SQUARINGS = 16, LATE_MOST = 1000 /* periods */ };

const char *const apc_nmpc_settings[] = {
    "horizon", "blocks", "measurement", "rank",     "terminal",  "setpoint_preview",
    "steady",  "delay",  "y_scale",     "u_scale",  "x_noise",   "d_noise",
    "y_noise", "hold",   "critical",    "at_input", "at_output", "iterations",
    "steps",   "newton", "lower",       "economic", NULL};

/* ---- Loops below ------------------------------------------------------------------------------------ */

/* Setting "lower": of each output the measurement that the loop below holds, its gain, its integral time; 0:
 * there is none, the output is the plant's. */
static int take_lower(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, "lower");
    const size_t nu = p->dim.nu;
    struct apc_nested_loop *loop;
    int rc = 0;

    if (!s)
        return 0;
    if (s->text || s->rows != nu || s->columns != 3)
        return apc_fail(
            why, APC_EINVAL,
            "setting \"lower\": %zu rows, of each output [measurement, gain, integral time] of the "
            "loop below; [0, 0, 0]: it has none",
            nu);
    loop = calloc(nu, sizeof(*loop));
    if (!loop)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t j = 0; j < nu && rc == 0; j++) {
        const double *row = s->value + 3 * j;

        if (!(row[0] >= 0.0) || row[0] > (double)p->dim.ny || row[0] != floor(row[0]))
            rc = apc_fail(why, APC_EINVAL, "setting \"lower\": output %zu: there is no measurement %g", j + 1,
                          row[0]);
        else if (row[0] > 0.0 && (row[1] == 0.0 || !(row[2] > 0.0)))
            rc = apc_fail(
                why, APC_EINVAL,
                "setting \"lower\": output %zu: the loop below has a gain of %g and an integral time "
                "of %g s; the first must not be 0, the second above",
                j + 1, row[1], row[2]);
        else if (row[0] > 0.0)
            loop[j] = (struct apc_nested_loop){
                .there = true, .y = (size_t)row[0] - 1, .gain = row[1], .tau = row[2]};
    }
    if (rc == 0)
        rc = apc_nested_create(&p->nested, setup->plant->model, setup->plant->p, loop, why);
    free(loop);
    return rc;
}

/* ---- The model, linear ------------------------------------------------------------------------------ */

/* At the operating point, with its loops: of all its inputs, since its own disturbances may be unknown ones,
 * and of those alone that the law has. */
struct linear_view {
    struct apc_linear_continuous all;
    struct apc_law_plant plant;
    double *memory, *A, *B, *C, *D, *x0, *u0, *B_u, *D_u, *u0_u;
};

static void choose_columns(size_t rows, const double *from, size_t all, const size_t *disturbance, size_t nu,
                           size_t nd, double *to)
{
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = 0; k < nu + nd; k++)
            to[i * (nu + nd) + k] = from[i * all + (k < nu ? k : nu + disturbance[k - nu])];
    }
}

static int linearise_all(struct linear_view *v, const struct apc_law_mpc *p,
                         const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_law_plant *plant = setup->plant;
    const struct apc_model *m = plant->model;
    const size_t nx = m->nx, ny = m->ny, nu = m->nu, all = nu + m->nd, nd = setup->dim.nd,
                 wide = p->nested ? apc_nested_states(p->nested) : nx;
    const size_t own = p->nested ? 1 : 0; /* how many more of A, B, C and u0: of the plant without loops */
    double *A, *B, *C, *u0;
    const struct apc_part parts[] = {
        APC_PART(v->A, wide * wide),  APC_PART(v->B, wide * all),  APC_PART(v->C, ny * wide),
        APC_PART(v->D, ny * all),     APC_PART(v->x0, wide),       APC_PART(v->u0, all),
        APC_PART(v->B_u, wide * all), APC_PART(v->D_u, ny * all),  APC_PART(v->u0_u, all),
        APC_PART(A, own * nx * nx),   APC_PART(B, own * nx * all), APC_PART(C, own * ny * nx),
        APC_PART(u0, own * all)};
    int rc;

    v->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!v->memory)
        return apc_fail(why, APC_ENOMEM, "no memory");
    if (!p->nested) {
        A = v->A;
        B = v->B;
        C = v->C;
        u0 = v->u0;
    }
    memcpy(u0, plant->u0, nu * sizeof(*u0));
    for (size_t k = 0; k < m->nd; k++)
        u0[nu + k] = m->disturbance ? m->disturbance[k].initial : 0.0;
    rc = apc_model_linearize(m, plant->p, plant->x0, u0, A, B, C, v->D, why);
    v->all = (struct apc_linear_continuous){.size = sizeof(v->all),
                                            .nx = nx,
                                            .nu = nu,
                                            .nd = m->nd,
                                            .ny = ny,
                                            .A = A,
                                            .B = B,
                                            .C = C,
                                            .D = v->D,
                                            .x0 = plant->x0,
                                            .u0 = u0,
                                            .y0 = plant->y0};
    v->plant = *plant;
    if (rc < 0 || !p->nested)
        return rc;
    rc = apc_nested_linearise(p->nested, &v->all, v->A, v->B, v->C, v->x0, v->u0, why);
    v->all.nx = v->plant.nx = wide;
    v->all.A = v->plant.A = v->A;
    v->all.B = v->B;
    v->all.C = v->plant.C = v->C;
    v->all.x0 = v->plant.x0 = v->x0;
    v->all.u0 = v->u0;
    choose_columns(wide, v->B, all, plant->disturbance, nu, nd, v->B_u);
    choose_columns(ny, v->D, all, plant->disturbance, nu, nd, v->D_u);
    choose_columns(1, v->u0, all, plant->disturbance, nu, nd, v->u0_u);
    v->plant.B = v->B_u;
    v->plant.D = v->D_u;
    v->plant.u0 = v->u0_u;
    return rc;
}

/* Standard deviations as make_estimator() has them; what a filter gains is counted in 1 s here. */
static int make_filters(struct apc_law_mpc *p, const struct apc_law_setup *setup,
                        const struct apc_linear_unknown *unknown, unsigned steps, struct apc_error *why)
{
    const size_t nx = setup->plant->model->nx, n = setup->plant->nx; /* without and with loops below */
    double *q = calloc(p->nx + p->dim.ny + 1, sizeof(*q)), *r;
    struct apc_estimator_options options = {.size = sizeof(options),
                                            .kind = APC_KALMAN_EXTENDED,
                                            .model = setup->plant->model,
                                            .p = setup->plant->p,
                                            .steps = steps,
                                            .unknown = unknown,
                                            .n_unknown = p->n_unknown};
    int rc;

    if (!q)
        return apc_fail(why, APC_ENOMEM, "no memory");
    r = q + p->nx;
    for (size_t k = 0; k < p->n_unknown; k++)
        q[n + k] = 1.0;
    for (size_t i = 0; i < p->dim.ny; i++)
        r[i] = 1.0;
    rc = apc_setting_amounts(setup, "x_noise", nx, q, why);
    if (rc == 0)
        rc = apc_setting_amounts(setup, "d_noise", p->n_unknown, q + n, why);
    if (rc == 0)
        rc = apc_mpc_take_y_noise(setup, r, why);
    for (size_t i = 0; i < p->nx; i++)
        q[i] *= q[i];
    for (size_t i = 0; i < p->dim.ny; i++)
        r[i] *= r[i];
    options.q = q;
    options.r = r;
    for (size_t k = 0; k < p->parts && rc == 0; k++) {
        const bool last = k + 1 == p->parts;

        options.Ts = (last ? p->Ts : p->begins[k + 1]) - p->begins[k];
        rc = apc_estimator_create_nested(last ? &p->estimator : &p->part[k], &options, p->nested, why);
    }
    if (rc == 0)
        rc = apc_mpc_check_detectable(p->disturbed, r, why);
    free(q);
    return rc;
}

static int make_shoot(struct apc_law_mpc *p, const struct apc_law_setup *setup,
                      const struct apc_linear_unknown *unknown, unsigned steps, const double *delay,
                      struct apc_error *why)
{
    const struct apc_shooting_options options = {.model = setup->plant->model,
                                                 .p = setup->plant->p,
                                                 .nested = p->nested,
                                                 .Ts = p->Ts,
                                                 .steps = steps,
                                                 .horizon = p->N,
                                                 .blocks = p->blocks,
                                                 .block = p->block,
                                                 .unknown = unknown,
                                                 .n_unknown = p->n_unknown,
                                                 .u0 = setup->plant->u0,
                                                 .delay = delay};

    return apc_shooting_create(&p->shoot, &options, why);
}

int apc_nmpc_linearise(void *self, const double *x, const double *u, struct apc_linear *to, double *drift)
{
    const struct apc_law_mpc *p = self;

    return apc_shooting_sample(p->shoot, x, u, p->x + p->model->nx_plant, to, drift);
}

/* ---- Steps ------------------------------------------------------------------------------------------ */

/* The logarithm of M's spectral radius, whatever the units of its rows; M is destroyed; work [n * n]. */
static double growth(size_t n, double *M, double *work)
{
    double sum = 0.0, share = 1.0;

    for (int k = 0; k < SQUARINGS; k++) {
        const double norm = apc_matrix_norm(n, M);

        if (norm == 0.0 || !isfinite(norm))
            return norm == 0.0 ? -HUGE_VAL : HUGE_VAL;
        sum += share * apc_log(norm);
        for (size_t i = 0; i < n * n; i++)
            M[i] /= norm;
        apc_matrix_multiply(n, n, n, M, M, work);
        memcpy(M, work, n * n * sizeof(*M));
        share /= 2.0;
    }
    return sum;
}

/* What a step of h does to deviations of the linear model A, of Runge and Kutta: 1 + hA (1 + hA/2 (1 + hA/3
 * (1 + hA/4))); to [n * n], work [n * n]. */
static void step_matrix(size_t n, const double *A, double h, double *to, double *work)
{
    memset(to, 0, n * n * sizeof(*to));
    for (size_t i = 0; i < n; i++)
        to[i * n + i] = 1.0;
    for (int k = 4; k > 0; k--) {
        apc_matrix_multiply(n, n, n, A, to, work);
        for (size_t i = 0; i < n * n; i++)
            to[i] = h / k * work[i] + (i % (n + 1) == 0 ? 1.0 : 0.0);
    }
}

/* Does a step of h make more of a deviation than the model itself does, or than stays? */
static bool blows_up(size_t n, const double *A, double h, double *work)
{
    double *M = work, *scratch = work + n * n, explicit_growth, own;

    step_matrix(n, A, h, M, scratch);
    explicit_growth = growth(n, M, scratch);
    for (size_t i = 0; i < n * n; i++)
        work[5 * n * n + i] = h * A[i];
    own = apc_matrix_exponential(n, work + 5 * n * n, M, work + n * n) ? 0.0 : growth(n, M, scratch);
    return explicit_growth > fmax(own, 0.0) + 1e-3;
}

/* Formulas that are explicit cannot take long steps where the model has a fast mode: at the operating point
 * that is seen before anything moves. */
static int check_steps(const struct apc_law_setup *setup, size_t steps, struct apc_error *why)
{
    const size_t n = setup->plant->nx;
    const double *A = setup->plant->A;
    double *work = calloc(6 * n * n, sizeof(*work));
    size_t least = steps;
    int rc = 0;

    if (!work)
        return apc_fail(why, APC_ENOMEM, "no memory");
    while (least <= STEPS_MOST && blows_up(n, A, setup->Ts / (double)least, work))
        least = least < 8 ? least + 1 : least + least / 8;
    if (least > STEPS_MOST)
        rc =
            apc_fail(why, APC_EINVAL,
                     "setting \"steps\": the model is too stiff for the period of %g s: not even %d steps of "
                     "the integration are enough for its fastest mode; leave that mode out of the model, as "
                     "one that is always at rest, or take a shorter period",
                     setup->Ts, STEPS_MOST);
    else if (least > steps)
        rc =
            apc_fail(why, APC_EINVAL,
                     "setting \"steps\": with %zu in a period of %g s the integration blows up, as the model "
                     "has a mode that is faster; take %zu or more",
                     steps, setup->Ts, least);
    free(work);
    return rc;
}

/* ---- All of it -------------------------------------------------------------------------------------- */

static int check_nonlinear(const struct apc_law_setup *setup, struct apc_error *why)
{
    if (!setup->plant->model)
        return apc_fail(
            why, APC_EINVAL,
            "the plant's equations are not known; give group plant a model, and the controller an "
            "operating_point");
    if (setup->dim.nd && !setup->plant->disturbance)
        return apc_fail(why, APC_EINVAL,
                        "which of the model's disturbances the measured ones are is not known");
    return 0;
}

static int take_nmpc_measured(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    const size_t nd = p->dim.nd;

    p->measured = calloc(nd + 1, sizeof(*p->measured));
    if (!p->measured)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t k = 0; k < nd; k++) {
        p->measured[k] = setup->plant->disturbance[k];
        if (p->measured[k] >= setup->plant->model->nd)
            return apc_fail(why, APC_EINVAL, "measured disturbance %zu is none of the model's", k + 1);
    }
    return 0;
}

/* The delays, with the parts of a period that they make: it begins with the output before where none acts at
 * once. delay [nu] is what is left of them beyond `late`. */
static int take_delays(struct apc_law_mpc *p, const struct apc_law_setup *setup, double *delay,
                       struct apc_error *why)
{
    const size_t nu = p->dim.nu;
    int rc = apc_mpc_take_delay(setup, delay, why);

    p->whole = calloc(nu, sizeof(*p->whole));
    p->bit = calloc(2 * nu + 1, sizeof(*p->bit));
    p->part = calloc(nu + 1, sizeof(struct apc_estimator *));
    if (!p->whole || !p->bit || !p->part)
        return apc_fail(why, APC_ENOMEM, "no memory");
    p->begins = p->bit + nu;
    p->parts = 1;
    p->late = p->Ts;
    for (size_t j = 0; j < nu && rc == 0; j++) {
        size_t at = p->parts;

        if (delay[j] > (double)LATE_MOST * p->Ts)
            return apc_fail(why, APC_EINVAL,
                            "setting \"delay\": %g s of output %zu; it must be from 0 to %d periods of %g s",
                            delay[j], j + 1, LATE_MOST, p->Ts);
        p->whole[j] = apc_linear_whole(delay[j], p->Ts, &p->bit[j]);
        for (size_t k = 0; k < p->parts; k++) {
            if (fabs(p->bit[j] - p->begins[k]) <= SHORTEST)
                p->bit[j] = p->begins[k];
        }
        if (p->Ts - p->bit[j] <= SHORTEST) {
            p->whole[j]++;
            p->bit[j] = 0.0;
        }
        p->late_most = p->whole[j] > p->late_most ? p->whole[j] : p->late_most;
        p->late = fmin(p->late, p->bit[j]);
        while (p->begins[at - 1] > p->bit[j])
            at--;
        if (p->begins[at - 1] == p->bit[j])
            continue;
        memmove(p->begins + at + 1, p->begins + at, (p->parts++ - at) * sizeof(*p->begins));
        p->begins[at] = p->bit[j];
    }
    for (size_t j = 0; j < nu; j++)
        delay[j] = (double)p->whole[j] * p->Ts + (p->bit[j] - p->late);
    return rc;
}

/* All that is made from the model, whose linear one setup has. */
static int take_nmpc_parts(struct apc_law_mpc *p, const struct apc_law_setup *setup,
                           const struct apc_linear_continuous *linear, double *delay, struct apc_error *why)
{
    struct apc_linear *all = NULL;
    size_t steps = 10;
    int rc = apc_mpc_count(setup, "steps", 1, STEPS_MOST, &steps, why);

    if (rc == 0)
        rc = check_steps(setup, steps, why);
    if (rc == 0)
        rc = apc_mpc_count(setup, "newton", 1, 100, &p->newton, why);
    if (rc == 0)
        rc = take_delays(p, setup, delay, why);
    if (rc == 0)
        rc = apc_linear_from_continuous(&all, linear, setup->Ts, why);
    if (rc == 0)
        rc = apc_mpc_disturb(p, setup, all, p->unknown, why);
    if (rc == 0)
        rc = apc_mpc_sample(setup, delay, &p->model, why);
    if (rc == 0)
        rc = make_filters(p, setup, p->unknown, (unsigned)steps, why);
    if (rc == 0)
        rc = make_shoot(p, setup, p->unknown, (unsigned)steps, delay, why);
    if (rc == 0)
        p->nc = p->model->nx;
    apc_linear_destroy(all);
    return rc;
}

int apc_nmpc_take_model(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    struct linear_view view = {.memory = NULL};
    struct apc_law_setup of = *setup;
    double *delay = calloc(p->dim.nu + p->dim.nd, sizeof(*delay));
    int rc;

    p->newton = 1;
    p->unknown = calloc(p->dim.ny + 1, sizeof(*p->unknown));
    rc = p->unknown && delay ? check_nonlinear(setup, why) : apc_fail(why, APC_ENOMEM, "no memory");
    if (rc == 0)
        rc = take_nmpc_measured(p, setup, why);
    if (rc == 0)
        rc = take_lower(p, setup, why);
    if (rc == 0)
        rc = linearise_all(&view, p, setup, why);
    of.plant = &view.plant;
    if (rc == 0)
        rc = take_nmpc_parts(p, &of, &view.all, delay, why);
    free(view.memory);
    free(delay);
    return rc;
}
