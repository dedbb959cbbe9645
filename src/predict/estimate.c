/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Kalman filters. What is remembered is x [nx] and, but for the steady one, the lower triangle of the
 * covariance P, row after row.
 *
 * The extended one predicts over substeps h: x by two Runge-Kutta steps of h/2; P with the Jacobian J in the
 * middle of the substep and M = exp(J h/2) to the fourth order,
 *     P <- M M P M'M' + h/6 (Q + 4 M Q M' + M M Q M'M'),
 * which is a sum of squares: P cannot lose its sign, however large h.
 */
#include "apcestimate.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"
#include "plant/plant_internal.h"
#include "predict/predict_internal.h"

#define ROUNDING 1e-6 /* of a covariance, at most */

struct apc_estimator {
    enum apc_estimator_kind kind;
    size_t nx, n_inputs, ny; /* nx with unknown disturbances */
    size_t n_unknown;
    struct apc_linear_unknown *unknown;
    const double *A, *B, *C, *D, *x0, *u0, *y0; /* of the linear model; its own copy */
    double *q, *r, *p0;
    double *gain;      /* [nx * ny] steady; of the extended one the measurement's Jacobian C [ny * nx] */
    double *deviation; /* [nx] steady */
    const struct apc_model *model;
    struct apc_reduced reduced; /* the same, of its states alone */
    struct apc_nested *nested;  /* its loops; NULL: none */
    size_t n_model;             /* its states, with theirs */
    double *p, h;
    unsigned steps;
    double *P, *T, *J, *M;                         /* [nx * nx] */
    double *x, *next, *slope, *column, *y, *moved; /* [nx], y and moved [ny] */
    struct apc_innovation *innovation;             /* [ny] of the last correction */
    double *input;                                 /* [n_inputs] with what disturbs it */
    double *slopes; /* [(n_model + ny) * (n_model + n_inputs)] of a model that derives itself */
    double *memory;
};

static size_t triangle(size_t n)
{
    return n * (n + 1) / 2;
}

/* ---- Making ------------------------------------------------------------------------------------- */

static int check_estimated_model(const struct apc_estimator_options *o, struct apc_error *why)
{
    apc_ns period;

    if (o->linear)
        return 0;
    if (apc_model_check(o->model, "estimator", why) < 0)
        return APC_EINVAL;
    return apc_period_from_s(o->Ts, &period, why);
}

static int check_variances(const double *value, size_t n, double least, const char *what,
                           struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        if (!value || !apc_value_ok(value[i]) || value[i] < least)
            return apc_fail(why, APC_EINVAL, "estimator: %s must be %zu variances, each %s", what, n,
                            least > 0.0 ? "above 0" : "0 or above");
    }
    return 0;
}

static int allocate_estimator(struct apc_estimator *e, const struct apc_estimator_options *o)
{
    const size_t nx = e->nx, ny = e->ny, n = e->n_inputs, np = o->model ? o->model->np : 0,
                 m = o->model && apc_fmu_shown(o->model) ? e->n_model + ny : 0;
    static const struct apc_linear none;
    const struct apc_linear *linear = o->linear ? o->linear : &none;
    const struct apc_part parts[] = {APC_PART_COPY(e->A, nx * nx, linear->A),
                                     APC_PART_COPY(e->B, nx * n, linear->B),
                                     APC_PART_COPY(e->C, ny * nx, linear->C),
                                     APC_PART_COPY(e->D, ny * n, linear->D),
                                     APC_PART_COPY(e->x0, nx, linear->x0),
                                     APC_PART_COPY(e->u0, n, linear->u0),
                                     APC_PART_COPY(e->y0, ny, linear->y0),
                                     APC_PART(e->q, nx),
                                     APC_PART(e->r, ny),
                                     APC_PART(e->p0, nx),
                                     APC_PART(e->gain, nx * ny),
                                     APC_PART(e->deviation, nx),
                                     APC_PART(e->p, np),
                                     APC_PART(e->P, nx * nx),
                                     APC_PART(e->T, nx * nx),
                                     APC_PART(e->J, nx * nx),
                                     APC_PART(e->M, nx * nx),
                                     APC_PART(e->x, nx),
                                     APC_PART(e->next, nx),
                                     APC_PART(e->slope, nx),
                                     APC_PART(e->column, nx),
                                     APC_PART(e->y, ny),
                                     APC_PART(e->moved, ny),
                                     APC_PART(e->innovation, ny),
                                     APC_PART(e->input, n),
                                     APC_PART(e->slopes, m * (e->n_model + n))};

    e->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return e->memory ? 0 : APC_ENOMEM;
}

/* The filter's gain K = P C'(C P C' + R)^-1 with P the covariance before a correction: the Riccati equation
 * of the transposed model gives P, and A K. */
static int steady(struct apc_estimator *e, struct apc_error *why)
{
    const size_t nx = e->nx, ny = e->ny;
    double *At, *Ct, *Q, *R, *CP, *S, *AK;
    const struct apc_part parts[] = {APC_PART(At, nx * nx), APC_PART(Q, nx * nx),  APC_PART(Ct, nx * ny),
                                     APC_PART(CP, nx * ny), APC_PART(AK, nx * ny), APC_PART(R, ny * ny),
                                     APC_PART(S, ny * ny)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    int rc;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "estimator: no memory");
    apc_matrix_transpose(nx, nx, e->A, At);
    apc_matrix_transpose(ny, nx, e->C, Ct);
    for (size_t i = 0; i < nx; i++)
        Q[i * nx + i] = e->q[i];
    for (size_t i = 0; i < ny; i++)
        R[i * ny + i] = e->r[i];
    rc = apc_riccati_solve(nx, ny, At, Ct, Q, R, e->P, AK, why);
    if (rc == 0) {
        apc_matrix_multiply(ny, nx, nx, e->C, e->P, CP);
        apc_matrix_multiply(ny, nx, ny, CP, Ct, S);
        for (size_t i = 0; i < ny; i++)
            S[i * ny + i] += e->r[i];
        memcpy(AK, CP, nx * ny * sizeof(*AK));
        if (apc_matrix_solve(ny, nx, S, AK)) /* K' */
            rc = apc_fail(why, APC_ESOLVER, "estimator: the measurements' covariance is singular");
    }
    for (size_t i = 0; i < nx && rc == 0; i++) {
        double variance = e->P[i * nx + i];

        for (size_t k = 0; k < ny; k++) {
            e->gain[i * ny + k] = AK[k * nx + i];
            variance -= AK[k * nx + i] * CP[k * nx + i];
        }
        e->deviation[i] = sqrt(fmax(variance, 0.0));
    }
    free(memory);
    return rc;
}

static int take_unknown_disturbances(struct apc_estimator *e, const struct apc_estimator_options *o,
                                     struct apc_error *why)
{
    if (o->linear || o->n_unknown == 0)
        return 0;
    e->unknown = calloc(o->n_unknown, sizeof(*e->unknown));
    if (!e->unknown)
        return apc_fail(why, APC_ENOMEM, "estimator: no memory");
    for (size_t k = 0; k < o->n_unknown; k++) {
        const size_t most = o->unknown[k].where == APC_AT_OUTPUT  ? e->ny
                            : o->unknown[k].where == APC_AT_INPUT ? e->n_inputs
                                                                  : 0;

        if (o->unknown[k].number >= most)
            return apc_fail(why, APC_EINVAL, "estimator: unknown disturbance %zu: there is no such %s", k + 1,
                            o->unknown[k].where == APC_AT_OUTPUT ? "output" : "input");
        e->unknown[k] = o->unknown[k];
    }
    e->n_unknown = o->n_unknown;
    return 0;
}

static int fill_estimator(struct apc_estimator *e, const struct apc_estimator_options *o,
                          struct apc_nested *nested, struct apc_error *why)
{
    const struct apc_model *model = o->model;
    const struct apc_linear *linear = o->linear;
    int rc;

    e->kind = o->kind;
    e->nested = nested;
    e->n_model = nested ? apc_nested_states(nested) : model ? model->nx : 0;
    e->nx = linear ? linear->nx : e->n_model + o->n_unknown;
    e->ny = linear ? linear->ny : model->ny;
    e->n_inputs = linear ? linear->nu + linear->nd : model->nu + model->nd;
    rc = take_unknown_disturbances(e, o, why);
    if (rc == 0)
        rc = check_variances(o->q, e->nx, 0.0, "q", why);
    if (rc == 0)
        rc = check_variances(o->r, e->ny, DBL_MIN, "r", why);
    if (rc == 0 && o->p0)
        rc = check_variances(o->p0, e->nx, 0.0, "p0", why);
    if (rc < 0)
        return rc;
    if (allocate_estimator(e, o) < 0)
        return apc_fail(why, APC_ENOMEM, "estimator: no memory");
    memcpy(e->q, o->q, e->nx * sizeof(*e->q));
    memcpy(e->r, o->r, e->ny * sizeof(*e->r));
    for (size_t i = 0; i < e->nx; i++)
        e->p0[i] = o->p0 ? o->p0[i] : e->q[i] > 0.0 ? e->q[i] : 1.0;
    if (e->kind == APC_KALMAN_STEADY)
        return steady(e, why);
    if (linear)
        return 0;
    e->model = model;
    e->steps = o->steps ? o->steps : 10;
    e->h = o->Ts / e->steps;
    rc = apc_model_take(model, e->p, o->p, model->param, model->np, "parameter", why);
    return rc < 0 ? rc : apc_reduced_open(&e->reduced, model, e->p, why);
}

int apc_estimator_create(struct apc_estimator **estimator, const struct apc_estimator_options *options,
                         struct apc_error *why)
{
    return apc_estimator_create_nested(estimator, options, NULL, why);
}

int apc_estimator_create_nested(struct apc_estimator **estimator, const struct apc_estimator_options *options,
                                struct apc_nested *nested, struct apc_error *why)
{
    struct apc_estimator_options o = {0};
    struct apc_estimator *new;
    int rc;

    if (!estimator)
        return apc_fail(why, APC_EINVAL, "apc_estimator_create: estimator must not be NULL");
    *estimator = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_estimator_options", why);
    if (rc < 0)
        return rc;
    if (o.kind < APC_KALMAN_STEADY || o.kind > APC_KALMAN_EXTENDED)
        return apc_fail(why, APC_EINVAL, "estimator: kind %d is none", (int)o.kind);
    if (o.kind == APC_KALMAN_EXTENDED)
        o.linear = NULL;
    else
        o.model = NULL;
    if (!o.linear && !o.model)
        return apc_fail(why, APC_EINVAL, "estimator: a %s is required",
                        o.kind == APC_KALMAN_EXTENDED ? "model" : "linear model");
    rc = check_estimated_model(&o, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "estimator: no memory");
    rc = fill_estimator(new, &o, nested, why);
    if (rc < 0)
        apc_estimator_destroy(new);
    else
        *estimator = new;
    return rc;
}

void apc_estimator_destroy(struct apc_estimator *estimator)
{
    if (!estimator)
        return;
    apc_reduced_close(&estimator->reduced);
    free(estimator->unknown);
    free(estimator->memory);
    free(estimator);
}

size_t apc_estimator_size(const struct apc_estimator *e)
{
    return e->nx + (e->kind == APC_KALMAN_STEADY ? 0 : triangle(e->nx));
}

void apc_estimator_reset(const struct apc_estimator *e, double *s, const double *x)
{
    memset(s, 0, apc_estimator_size(e) * sizeof(*s));
    for (size_t i = 0; i < e->nx; i++) {
        s[i] = x                                     ? x[i]
               : !e->model                           ? e->x0[i]
               : i < e->model->nx && e->model->state ? e->model->state[i].initial
                                                     : 0.0;
        if (e->kind != APC_KALMAN_STEADY)
            s[e->nx + triangle(i) + i] = e->p0[i];
    }
}

/* ---- Covariance ---------------------------------------------------------------------------------- */

static void unpack_estimates(struct apc_estimator *e, const double *s)
{
    const double *at = s + e->nx;

    for (size_t i = 0; i < e->nx; i++) {
        for (size_t j = 0; j <= i; j++)
            e->P[i * e->nx + j] = e->P[j * e->nx + i] = *at++;
    }
}

static void pack_estimates(const struct apc_estimator *e, double *s)
{
    double *at = s + e->nx;

    for (size_t i = 0; i < e->nx; i++) {
        for (size_t j = 0; j <= i; j++)
            *at++ = (e->P[i * e->nx + j] + e->P[j * e->nx + i]) / 2.0;
    }
}

/* Is P one, in which no correlation is beyond 1 by more than rounding leaves of what there was? A model that
 * answers nonsense once, or a state far from any that it was made for, may leave numbers beside which the
 * others are lost. */
static bool is_covariance(const struct apc_estimator *e)
{
    const size_t n = e->nx;

    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++) {
            const double a = e->P[i * n + i], b = e->P[j * n + j],
                         most = sqrt(fmax(a, 0.0)) * sqrt(fmax(b, 0.0)),
                         scale = sqrt(fmax(a, e->p0[i])) * sqrt(fmax(b, e->p0[j]));

            if (!(fabs(e->P[i * n + j]) <= most + ROUNDING * scale))
                return false;
        }
    }
    return true;
}

static void forget_covariance(struct apc_estimator *e)
{
    memset(e->P, 0, e->nx * e->nx * sizeof(*e->P));
    for (size_t i = 0; i < e->nx; i++)
        e->P[i * e->nx + i] = e->p0[i];
}

/* to [nx * nx] += factor F diag(q) F' */
static void add_process_noise(const struct apc_estimator *e, const double *F, double factor, double *to)
{
    for (size_t i = 0; i < e->nx; i++) {
        for (size_t j = 0; j <= i; j++) {
            double sum = 0.0;

            for (size_t k = 0; k < e->nx; k++)
                sum += F[i * e->nx + k] * e->q[k] * F[j * e->nx + k];
            to[i * e->nx + j] += factor * sum;
            if (j < i)
                to[j * e->nx + i] = to[i * e->nx + j];
        }
    }
}

/* P = F P F', by way of T */
static void propagate_covariance(struct apc_estimator *e, const double *F)
{
    const size_t n = e->nx;

    apc_matrix_multiply(n, n, n, F, e->P, e->T);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++) {
            double sum = 0.0;

            for (size_t k = 0; k < n; k++)
                sum += e->T[i * n + k] * F[j * n + k];
            e->P[i * n + j] = e->P[j * n + i] = sum;
        }
    }
}

/*
 * One measurement of row c and variance r, innovation v. With k = P c / (c P c' + r), Joseph's form
 *     P <- (I - k c) P (I - k c)' + k r k'
 * from left to right: W = P - k (P c)', then W - (W c) k' + k r k'. Returns c P c' + r.
 */
static double measurement_update(struct apc_estimator *e, const double *c, double r, double v, double *x)
{
    const size_t n = e->nx;
    double *Pc = e->column, *k = e->slope, *Wc = e->next, total = r;

    for (size_t i = 0; i < n; i++)
        Pc[i] = apc_matrix_dot(e->P + i * n, c, n);
    total += apc_matrix_dot(c, Pc, n);
    for (size_t i = 0; i < n; i++) {
        k[i] = Pc[i] / total;
        x[i] += k[i] * v;
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            e->P[i * n + j] -= k[i] * Pc[j];
        Wc[i] = apc_matrix_dot(e->P + i * n, c, n);
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            e->P[i * n + j] += (r * k[i] - Wc[i]) * k[j];
    }
    return total;
}

/* ---- The nonlinear model, disturbed ---------------------------------------------------------------- */

static const double *disturbed(struct apc_estimator *e, const double *x, const double *u)
{
    if (e->n_unknown == 0)
        return u;
    memcpy(e->input, u, e->n_inputs * sizeof(*u));
    for (size_t k = 0; k < e->n_unknown; k++) {
        if (e->unknown[k].where == APC_AT_INPUT)
            e->input[e->unknown[k].number] += x[e->n_model + k];
    }
    return e->input;
}

static int state_derivative(struct apc_estimator *e, const double *x, const double *u, double *dx)
{
    memset(dx + e->n_model, 0, e->n_unknown * sizeof(*dx));
    return e->nested ? apc_nested_slope(e->nested, x, disturbed(e, x, u), dx)
                     : apc_reduced_f(&e->reduced, x, disturbed(e, x, u), dx);
}

static void measured(struct apc_estimator *e, const double *x, const double *u, double *y)
{
    if (e->nested)
        apc_nested_output(e->nested, x, disturbed(e, x, u), y);
    else
        apc_reduced_g(&e->reduced, x, disturbed(e, x, u), y);
    for (size_t k = 0; k < e->n_unknown; k++) {
        if (e->unknown[k].where == APC_AT_OUTPUT)
            y[e->unknown[k].number] += x[e->n_model + k];
    }
}

/* ---- Measurements -------------------------------------------------------------------------------- */

void apc_estimator_output(struct apc_estimator *e, const double *s, const double *u, double *y)
{
    if (e->model) {
        measured(e, s, u, y);
        return;
    }
    for (size_t i = 0; i < e->ny; i++) {
        double sum = 0.0;

        for (size_t j = 0; j < e->nx; j++)
            sum += e->C[i * e->nx + j] * (s[j] - e->x0[j]);
        for (size_t j = 0; j < e->n_inputs; j++)
            sum += e->D[i * e->n_inputs + j] * (u[j] - e->u0[j]);
        y[i] = e->y0[i] + sum;
    }
}

/* A step for central differences at @p x. */
static double small_step(double x)
{
    return 6e-6 * fmax(fabs(x), 1e-3); /* about the cube root of the rounding error */
}

/* Does the model give its own derivatives? Those of its loops nobody gives. */
static bool derives(const struct apc_estimator *e)
{
    return apc_reduced_derives(&e->reduced) && !e->nested;
}

/* Of the model's own derivatives at x the @p n rows from @p first on, with unknown disturbances, to [n * nx]. */
static int own_slopes(struct apc_estimator *e, const double *x, const double *u, size_t first, size_t n,
                      double *to)
{
    const int rc = apc_reduced_slopes(&e->reduced, x, disturbed(e, x, u), e->slopes);

    for (size_t i = 0; i < n; i++) {
        const double *row = e->slopes + (first + i) * (e->n_model + e->n_inputs);

        memcpy(to + i * e->nx, row, e->n_model * sizeof(*to));
        for (size_t k = 0; k < e->n_unknown; k++)
            to[i * e->nx + e->n_model + k] =
                e->unknown[k].where == APC_AT_INPUT ? row[e->n_model + e->unknown[k].number]
                : first && e->unknown[k].where == APC_AT_OUTPUT && e->unknown[k].number == i ? 1.0
                                                                                             : 0.0;
    }
    for (size_t i = 0; rc < 0 && i < n * e->nx; i++)
        to[i] = (double)NAN;
    return rc;
}

/* The measurement's Jacobian at x into gain [ny * nx]. */
static void measurement_jacobian(struct apc_estimator *e, const double *x, const double *u)
{
    if (derives(e)) {
        (void)own_slopes(e, x, u, e->n_model, e->ny, e->gain);
        return;
    }
    memcpy(e->next, x, e->nx * sizeof(*x));
    for (size_t j = 0; j < e->nx; j++) {
        double step = small_step(x[j]), up = x[j] + step, down = x[j] - step;

        e->next[j] = up;
        measured(e, e->next, u, e->moved);
        for (size_t i = 0; i < e->ny; i++)
            e->gain[i * e->nx + j] = e->moved[i];
        e->next[j] = down;
        measured(e, e->next, u, e->moved);
        for (size_t i = 0; i < e->ny; i++)
            e->gain[i * e->nx + j] = (e->gain[i * e->nx + j] - e->moved[i]) / (up - down);
        e->next[j] = x[j];
    }
}

static int correct_steady(const struct apc_estimator *e, double *s, const double *y, const bool *usable)
{
    int n = 0;

    for (size_t k = 0; k < e->ny; k++) {
        if ((usable && !usable[k]) || !apc_value_ok(y[k]))
            continue;
        n++;
        for (size_t i = 0; i < e->nx; i++)
            s[i] += e->gain[i * e->ny + k] * (y[k] - e->y[k]);
    }
    return n;
}

static double clamp_to_range(double value, const struct apc_param *range)
{
    return fmin(fmax(value, range->low), range->high);
}

/* Does any state move otherwise when unknown disturbance @p k is another? */
static bool is_felt(struct apc_estimator *e, const double *s, const double *u, size_t k)
{
    const size_t i = e->n_model + k;
    const double by = small_step(s[i]);
    int rc;

    memcpy(e->x, s, e->nx * sizeof(*s));
    e->x[i] = s[i] + by;
    rc = state_derivative(e, e->x, u, e->slope);
    e->x[i] = s[i] - by;
    return rc != 0 || state_derivative(e, e->x, u, e->column) != 0 ||
           memcmp(e->slope, e->column, e->n_model * sizeof(*s)) != 0;
}

/*
 * The state stays where the model holds. So does an input with its unknown disturbance, where beyond that the
 * model does not feel it, as a pump that would run backwards: from there nothing would lead it back.
 */
static void keep_in_range(struct apc_estimator *e, double *s, const double *u)
{
    const struct apc_model *m = e->model;

    for (size_t i = 0; i < m->nx && m->state; i++)
        s[i] = clamp_to_range(s[i], &m->state[i]);
    for (size_t k = 0; k < e->n_unknown && !e->nested; k++) {
        const size_t j = e->unknown[k].number;
        const struct apc_param *range = j < m->nu ? m->input : m->disturbance;
        double *d = &s[e->n_model + k];

        if (e->unknown[k].where != APC_AT_INPUT || !range)
            continue;
        range += j < m->nu ? j : j - m->nu;
        if (clamp_to_range(u[j] + *d, range) != u[j] + *d && !is_felt(e, s, u, k))
            *d = clamp_to_range(u[j] + *d, range) - u[j];
    }
}

/* What follows from the measurements before is known to those after: c (x - x before) is taken off. */
static int correct_one_by_one(struct apc_estimator *e, double *s, const double *y, const bool *usable,
                              const double *u)
{
    const double *C = e->C;
    int n = 0;

    memset(e->innovation, 0, e->ny * sizeof(*e->innovation));
    if (e->model) {
        measurement_jacobian(e, s, u);
        C = e->gain;
        if (!apc_values_ok(C, e->nx * e->ny))
            return 0;
    }
    unpack_estimates(e, s);
    memcpy(e->x, s, e->nx * sizeof(*s));
    for (size_t k = 0; k < e->ny; k++) {
        const double *c = C + k * e->nx;
        double v = y[k] - e->y[k];

        if ((usable && !usable[k]) || !apc_value_ok(y[k]) || !apc_value_ok(e->y[k]))
            continue;
        for (size_t j = 0; j < e->nx; j++)
            v -= c[j] * (e->x[j] - s[j]);
        e->innovation[k] = (struct apc_innovation){v, measurement_update(e, c, e->r[k], v, e->x)};
        n++;
    }
    memcpy(s, e->x, e->nx * sizeof(*s));
    if (!is_covariance(e)) {
        forget_covariance(e);
        if (e->ny > 0)
            e->innovation[0].variance = (double)NAN;
    }
    pack_estimates(e, s);
    return n;
}

int apc_estimator_correct(struct apc_estimator *e, double *s, const double *y, const bool *usable,
                          const double *u)
{
    int n;

    apc_estimator_output(e, s, u, e->y);
    if (e->kind == APC_KALMAN_STEADY)
        return correct_steady(e, s, y, usable);
    n = correct_one_by_one(e, s, y, usable, u);
    if (e->model)
        keep_in_range(e, s, u);
    return n;
}

const struct apc_innovation *apc_estimator_innovations(const struct apc_estimator *e)
{
    return e->innovation;
}

double apc_estimator_deviation(const struct apc_estimator *e, const double *s, size_t i)
{
    return e->kind == APC_KALMAN_STEADY ? e->deviation[i] : sqrt(s[e->nx + triangle(i) + i]);
}

/* ---- Prediction ---------------------------------------------------------------------------------- */

static void predict_linear(struct apc_estimator *e, double *s, const double *u)
{
    for (size_t i = 0; i < e->nx; i++) {
        double sum = 0.0;

        for (size_t j = 0; j < e->nx; j++)
            sum += e->A[i * e->nx + j] * (s[j] - e->x0[j]);
        for (size_t j = 0; j < e->n_inputs; j++)
            sum += e->B[i * e->n_inputs + j] * (u[j] - e->u0[j]);
        e->next[i] = e->x0[i] + sum;
    }
    memcpy(s, e->next, e->nx * sizeof(*s));
    if (e->kind == APC_KALMAN_STEADY)
        return;
    unpack_estimates(e, s);
    propagate_covariance(e, e->A);
    for (size_t i = 0; i < e->nx; i++)
        e->P[i * e->nx + i] += e->q[i];
    pack_estimates(e, s);
}

/* x on by h, the classical Runge-Kutta formula. */
static int runge_kutta_step(struct apc_estimator *e, double *x, const double *u, double h)
{
    static const double reach[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
    double *sum = e->column;

    memset(sum, 0, e->nx * sizeof(*sum));
    for (int k = 0; k < 4; k++) {
        for (size_t i = 0; i < e->nx; i++)
            e->next[i] = x[i] + (k ? reach[k] * h * e->slope[i] : 0.0);
        if (state_derivative(e, e->next, u, e->slope) != 0)
            return APC_ESOLVER;
        for (size_t i = 0; i < e->nx; i++)
            sum[i] += weight[k] * e->slope[i];
    }
    for (size_t i = 0; i < e->nx; i++)
        x[i] += h / 6.0 * sum[i];
    return apc_values_ok(x, e->nx) ? 0 : APC_ESOLVER;
}

static int jacobian(struct apc_estimator *e, const double *x, const double *u)
{
    if (derives(e)) {
        memset(e->J, 0, e->nx * e->nx * sizeof(*e->J));
        return own_slopes(e, x, u, 0, e->n_model, e->J);
    }
    memcpy(e->next, x, e->nx * sizeof(*x));
    for (size_t j = 0; j < e->nx; j++) {
        double by = small_step(x[j]), up = x[j] + by, down = x[j] - by;

        e->next[j] = up;
        if (state_derivative(e, e->next, u, e->slope) != 0)
            return APC_ESOLVER;
        e->next[j] = down;
        if (state_derivative(e, e->next, u, e->column) != 0)
            return APC_ESOLVER;
        for (size_t i = 0; i < e->nx; i++)
            e->J[i * e->nx + j] = (e->slope[i] - e->column[i]) / (up - down);
        e->next[j] = x[j];
    }
    return apc_values_ok(e->J, e->nx * e->nx) ? 0 : APC_ESOLVER;
}

/* M = I + Z (I + Z/2 (I + Z/3 (I + Z/4))) with Z = J h */
static void short_exponential(struct apc_estimator *e, double h)
{
    const size_t n = e->nx;

    for (size_t i = 0; i < n * n; i++)
        e->M[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    for (int k = 4; k > 0; k--) {
        apc_matrix_multiply(n, n, n, e->J, e->M, e->T);
        for (size_t i = 0; i < n * n; i++)
            e->M[i] = (i % (n + 1) == 0 ? 1.0 : 0.0) + h / k * e->T[i];
    }
}

static int substep(struct apc_estimator *e, const double *u)
{
    const size_t n = e->nx;
    int rc = runge_kutta_step(e, e->x, u, e->h / 2.0);

    if (rc == 0)
        rc = jacobian(e, e->x, u);
    if (rc == 0)
        rc = runge_kutta_step(e, e->x, u, e->h / 2.0);
    if (rc < 0)
        return rc;
    short_exponential(e, e->h / 2.0);
    propagate_covariance(e, e->M);
    propagate_covariance(e, e->M);
    apc_matrix_multiply(n, n, n, e->M, e->M, e->T);
    add_process_noise(e, e->M, 4.0 * e->h / 6.0, e->P);
    add_process_noise(e, e->T, e->h / 6.0, e->P);
    for (size_t i = 0; i < n; i++)
        e->P[i * n + i] += e->h / 6.0 * e->q[i];
    return apc_values_ok(e->P, n * n) ? 0 : APC_ESOLVER;
}

int apc_estimator_predict(struct apc_estimator *e, double *s, const double *u)
{
    if (!e->model) {
        predict_linear(e, s, u);
        return 0;
    }
    unpack_estimates(e, s);
    memcpy(e->x, s, e->nx * sizeof(*s));
    for (unsigned k = 0; k < e->steps; k++) {
        int rc = substep(e, u);

        if (rc < 0)
            return rc;
    }
    memcpy(s, e->x, e->nx * sizeof(*s));
    pack_estimates(e, s);
    return 0;
}
