/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Linear models for control. Everything comes down to terms: one input, delayed, times a vector that drives
 * the state. A dead time of d - 1 to d periods, tau = (d - 1) Ts + a, makes an input that was given d periods
 * ago act for the first a seconds of a period and the one after it for the rest.
 */
#include "apclinear.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "predict/predict_internal.h"

#define ELEMENTS_MAX 100000

/* Input j, dead_time later, times b [nx] into the state and d [ny] into the outputs. */
struct term {
    size_t j;
    double dead_time;
    const double *b, *d;
    size_t stride_b, stride_d; /* from one element of them to the next */
};

/* How many former inputs a dead time needs: those of 1..periods ago. */
static size_t periods(double dead_time, double Ts)
{
    double d = dead_time / Ts;

    return (size_t)ceil(d - 1e-9 * fmax(1.0, d)); /* 3 x 0.1 s are three periods of 0.1 s */
}

size_t apc_linear_whole(double dead_time, double Ts, double *bit)
{
    const size_t up = periods(dead_time, Ts);
    const double left = up ? dead_time - ((double)up - 1.0) * Ts : 0.0;
    const bool all = left >= Ts * (1.0 - 1e-9 * (double)up);

    *bit = all ? 0.0 : left;
    return up && !all ? up - 1 : up;
}

int apc_linear_allocate(struct apc_linear **model, size_t nx, size_t nu, size_t nd, size_t ny,
                        struct apc_error *why)
{
    const size_t n = nu + nd;
    struct apc_linear *m;
    double *at;

    if (!nx || nx > ELEMENTS_MAX || n > ELEMENTS_MAX || ny > ELEMENTS_MAX ||
        (nx + ny) * (nx + n) > ELEMENTS_MAX)
        return apc_fail(why, APC_EINVAL,
                        "linear model: %zu states, former inputs among them, %zu inputs and %zu outputs: it "
                        "must have a state, and no more than %d elements",
                        nx, n, ny, ELEMENTS_MAX);
    m = calloc(1, sizeof(*m) + ((nx + ny) * (nx + n) + nx + n + ny) * sizeof(double));
    if (!m)
        return apc_fail(why, APC_ENOMEM, "linear model: no memory");
    at = (double *)(m + 1);
    *m = (struct apc_linear){.nx = nx, .nu = nu, .nd = nd, .ny = ny, .A = at};
    m->B = m->A + nx * nx;
    m->C = m->B + nx * n;
    m->D = m->C + ny * nx;
    m->x0 = m->D + ny * n;
    m->u0 = m->x0 + nx;
    m->y0 = m->u0 + n;
    *model = m;
    return 0;
}

void apc_linear_destroy(struct apc_linear *model)
{
    free(model);
}

/* ---- Sampling ------------------------------------------------------------------------------------ */

/* Where the input of @p ago periods ago stands: in a state that holds it, or, ago being 0, in column j of B.
 * The states of input j begin at held[j], the youngest first. */
static double *coefficient(struct apc_linear *m, const size_t *held, size_t row, size_t j, size_t ago)
{
    return ago == 0 ? &m->B[row * (m->nu + m->nd) + j] : &m->A[row * m->nx + held[j] + ago - 1];
}

/* For how long, s, of a period the input of @p d periods ago still acts. */
static double acting_time(const struct term *term, size_t d, double Ts)
{
    double a = term->dead_time - ((double)d - 1.0) * Ts;

    return d == 0 || a >= Ts ? Ts : a;
}

/*
 * gamma(t) [n] = integral of exp(A s) b over s from 0 to t. With Phi = exp(A (Ts - a)) the input that acts
 * first, for a, gives Phi gamma(a) = gamma(Ts) - gamma(Ts - a), the one after it gamma(Ts - a).
 */
static int integrate_exponential(size_t n, const double *A, const struct term *term, double t, double *gamma,
                                 struct apc_error *why)
{
    double *memory = calloc(n * n + 2 * n + 1, sizeof(*memory)), *b;
    int rc;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "linear model: no memory");
    b = memory + n * n;
    for (size_t i = 0; i < n; i++)
        b[i] = term->b[i * term->stride_b];
    rc = apc_linear_sample(n, 1, A, b, t, memory, gamma, why);
    free(memory);
    return rc;
}

static int add_term(struct apc_linear *m, const size_t *held, const double *A, const struct term *term,
                    double *gamma, struct apc_error *why)
{
    const size_t n = m->nx_plant, d = periods(term->dead_time, m->Ts);
    const double a = acting_time(term, d, m->Ts);
    int rc = n ? integrate_exponential(n, A, term, m->Ts, gamma, why) : 0;

    if (rc == 0 && n)
        rc = integrate_exponential(n, A, term, m->Ts - a, gamma + n, why);
    for (size_t i = 0; i < n && rc == 0; i++) {
        if (d == 0)
            *coefficient(m, held, i, term->j, 0) += gamma[i];
        else {
            *coefficient(m, held, i, term->j, d) += gamma[i] - gamma[n + i];
            *coefficient(m, held, i, term->j, d - 1) += gamma[n + i];
        }
    }
    for (size_t i = 0; i < m->ny && rc == 0 && term->d; i++) {
        double direct = term->d[i * term->stride_d];

        if (d == 0)
            m->D[i * (m->nu + m->nd) + term->j] += direct;
        else
            m->C[i * m->nx + held[term->j] + d - 1] += direct;
    }
    return rc;
}

/* Sample x' = A x + the sum of the terms, y = C x + what is direct. */
static int sample_continuous(struct apc_linear **model, const struct apc_linear_continuous *from,
                             const struct term *term, size_t n_terms, double Ts, struct apc_error *why)
{
    const size_t n = from->nx, inputs = from->nu + from->nd;
    size_t nx = n, *held = calloc(2 * inputs + 1, sizeof(*held)), *length = held + inputs;
    double *gamma = calloc(n * n + 3 * n + 1, sizeof(*gamma));
    struct apc_linear *m = NULL;
    int rc = held && gamma ? 0 : apc_fail(why, APC_ENOMEM, "linear model: no memory");

    for (size_t k = 0; k < n_terms && rc == 0; k++) {
        size_t d = periods(term[k].dead_time, Ts);

        if (d > length[term[k].j])
            length[term[k].j] = d;
    }
    for (size_t j = 0; j < inputs && rc == 0; j++) {
        held[j] = nx;
        nx += length[j];
    }
    if (rc == 0)
        rc = apc_linear_allocate(&m, nx, from->nu, from->nd, from->ny, why);
    if (rc < 0)
        goto out;
    m->Ts = Ts;
    m->nx_plant = n;
    m->nx_held = nx - n;
    if (n) {
        double *zero = gamma + n, *phi = zero + n;

        rc = apc_linear_sample(n, 1, from->A, zero, Ts, phi, gamma, why);
        apc_matrix_put(m->A, nx, 0, 0, n, n, phi);
        apc_matrix_put(m->C, nx, 0, 0, from->ny, n, from->C);
        memset(gamma, 0, (n * n + 3 * n) * sizeof(*gamma));
    }
    for (size_t k = 0; k < n_terms && rc == 0; k++)
        rc = add_term(m, held, from->A, &term[k], gamma, why);
    for (size_t j = 0; j < inputs; j++) {
        for (size_t k = 0; k < length[j]; k++)
            *coefficient(m, held, held[j] + k, j, k) = 1.0;
    }
    for (size_t i = 0; i < n && from->x0; i++)
        m->x0[i] = from->x0[i];
    for (size_t j = 0; j < inputs && from->u0; j++) {
        m->u0[j] = from->u0[j];
        for (size_t k = 0; k < length[j]; k++)
            m->x0[held[j] + k] = from->u0[j];
    }
    for (size_t i = 0; i < from->ny && from->y0; i++)
        m->y0[i] = from->y0[i];
out:
    if (rc < 0)
        apc_linear_destroy(m);
    else
        *model = m;
    free(gamma);
    free(held);
    return rc;
}

static int check_dead_time(double dead_time, double Ts, size_t input, struct apc_error *why)
{
    if (dead_time >= 0.0 && dead_time / Ts <= ELEMENTS_MAX)
        return 0;
    return apc_fail(why, APC_EINVAL,
                    "linear model: dead time of input %zu is %g s; it must be from 0 to %d periods",
                    input + 1, dead_time, ELEMENTS_MAX);
}

static int check_period(struct apc_linear **model, double Ts, const char *function, struct apc_error *why)
{
    apc_ns period;

    if (!model)
        return apc_fail(why, APC_EINVAL, "%s: model must not be NULL", function);
    *model = NULL;
    return apc_period_from_s(Ts, &period, why);
}

static bool are_finite_numbers(const double *value, size_t n)
{
    return !value || apc_values_ok(value, n);
}

/* The options of both, and what they have in common. */
static int take_linear_options(struct apc_linear **model, const struct apc_linear_continuous *from, double Ts,
                               const char *function, struct apc_linear_continuous *o, struct apc_error *why)
{
    size_t inputs;
    int rc = check_period(model, Ts, function, why);

    if (rc == 0)
        rc = apc_options_copy(o, sizeof(*o), from, "apc_linear_continuous", why);
    if (rc < 0)
        return rc;
    inputs = o->nu + o->nd;
    if ((o->nx && (!o->A || !o->B || !o->C)) || inputs > ELEMENTS_MAX || o->nx > ELEMENTS_MAX ||
        o->ny > ELEMENTS_MAX)
        return apc_fail(why, APC_EINVAL,
                        "%s: A, B and C are required where there are states, of no more than %d elements",
                        function, ELEMENTS_MAX);
    if (!are_finite_numbers(o->A, o->nx * o->nx) || !are_finite_numbers(o->B, o->nx * inputs) ||
        !are_finite_numbers(o->C, o->ny * o->nx) || !are_finite_numbers(o->D, o->ny * inputs) ||
        !are_finite_numbers(o->x0, o->nx) || !are_finite_numbers(o->u0, inputs) ||
        !are_finite_numbers(o->y0, o->ny))
        return apc_fail(why, APC_EINVAL, "%s: an element of the model is no finite number", function);
    return 0;
}

int apc_linear_from_continuous(struct apc_linear **model, const struct apc_linear_continuous *from, double Ts,
                               struct apc_error *why)
{
    struct apc_linear_continuous o = {0};
    struct term *term;
    size_t inputs;
    int rc = take_linear_options(model, from, Ts, "apc_linear_from_continuous", &o, why);

    if (rc < 0)
        return rc;
    inputs = o.nu + o.nd;
    term = calloc(inputs + 1, sizeof(*term));
    if (!term)
        return apc_fail(why, APC_ENOMEM, "linear model: no memory");
    for (size_t j = 0; j < inputs && rc == 0; j++) {
        term[j] = (struct term){.j = j,
                                .dead_time = o.dead_time ? o.dead_time[j] : 0.0,
                                .b = o.B + j,
                                .stride_b = inputs,
                                .d = o.D ? o.D + j : NULL,
                                .stride_d = inputs};
        rc = check_dead_time(term[j].dead_time, Ts, j, why);
    }
    if (rc == 0)
        rc = sample_continuous(model, &o, term, inputs, Ts, why);
    free(term);
    return rc;
}

int apc_linear_from_sampled(struct apc_linear **model, const struct apc_linear_continuous *from, double Ts,
                            struct apc_error *why)
{
    struct apc_linear_continuous o = {0};
    size_t inputs;
    int rc = take_linear_options(model, from, Ts, "apc_linear_from_sampled", &o, why);

    if (rc < 0)
        return rc;
    inputs = o.nu + o.nd;
    for (size_t j = 0; o.dead_time && j < inputs; j++) {
        if (o.dead_time[j] != 0.0)
            return apc_fail(
                why, APC_EINVAL,
                "apc_linear_from_sampled: dead time of input %zu is %g s; in a sampled model it is "
                "states of A",
                j + 1, o.dead_time[j]);
    }
    rc = apc_linear_allocate(model, o.nx, o.nu, o.nd, o.ny, why);
    if (rc < 0)
        return rc;
    (*model)->Ts = Ts;
    (*model)->nx_plant = o.nx;
    memcpy((*model)->A, o.A, o.nx * o.nx * sizeof(*o.A));
    memcpy((*model)->B, o.B, o.nx * inputs * sizeof(*o.B));
    memcpy((*model)->C, o.C, o.ny * o.nx * sizeof(*o.C));
    if (o.D)
        memcpy((*model)->D, o.D, o.ny * inputs * sizeof(*o.D));
    if (o.x0)
        memcpy((*model)->x0, o.x0, o.nx * sizeof(*o.x0));
    if (o.u0)
        memcpy((*model)->u0, o.u0, inputs * sizeof(*o.u0));
    if (o.y0)
        memcpy((*model)->y0, o.y0, o.ny * sizeof(*o.y0));
    return 0;
}

/* ---- Transfer functions -------------------------------------------------------------------------- */

/* Lags of a pair. Integrators are an output's: two of them on one output would be two states of which only
 * the sum is ever seen. */
static size_t lags_of_pair(const struct apc_transfer *g)
{
    return g->gain == 0.0 ? 0 : (size_t)((g->tau[0] > 0.0) + (g->tau[1] > 0.0));
}

static bool has_integrator(const struct apc_transfer *g, size_t inputs)
{
    for (size_t j = 0; j < inputs; j++) {
        if (g[j].gain != 0.0 && g[j].integrating)
            return true;
    }
    return false;
}

static int check_transfer(const struct apc_transfer *g, size_t i, size_t j, double Ts, struct apc_error *why)
{
    const double number[] = {g->gain, g->zero, g->tau[0], g->tau[1]};

    if (!apc_values_ok(number, 4) || g->tau[0] < 0.0 || g->tau[1] < 0.0 ||
        (g->tau[1] > 0.0 && g->tau[0] == 0.0))
        return apc_fail(
            why, APC_EINVAL,
            "transfer function from input %zu to output %zu: gain, zero and time constants must be "
            "numbers, time constants not negative, the second one only beside the first",
            j + 1, i + 1);
    if (g->zero != 0.0 && g->tau[0] == 0.0)
        return apc_fail(why, APC_EINVAL,
                        "transfer function from input %zu to output %zu: a zero needs a time constant", j + 1,
                        i + 1);
    return check_dead_time(g->dead_time, Ts, j, why);
}

/* Where the states of a pair go, and what it leads to. */
struct pair {
    size_t nx, at;     /* states of all, of this one the first */
    size_t integrator; /* of its output */
    double *A, *b, *c; /* [nx * nx], [nx], [nx] */
    double *direct;    /* of its output */
};

/*
 * A chain of first-order lags, x1' = (u - x1)/tau1, x2' = (x1 - x2)/tau2, and maybe an integrator behind
 * them. The lead acts in the first: zero s + 1 over tau1 s + 1 is zero/tau1 u + (1 - zero/tau1) x1.
 */
static void realise_pair(const struct apc_transfer *g, const struct pair *to)
{
    double from_u = g->gain, from_x = 0.0; /* what goes into the next stage: of u, and of the state before */
    size_t before = to->at;

    for (size_t k = 0; k < lags_of_pair(g); k++) {
        const double rate = 1.0 / g->tau[k];
        const size_t state = to->at + k;

        to->b[state] = rate * from_u;
        to->A[state * to->nx + before] = rate * from_x;
        to->A[state * to->nx + state] = -rate;
        from_u = k == 0 ? g->gain * g->zero * rate : 0.0;
        from_x = k == 0 ? 1.0 - g->zero * rate : 1.0;
        before = state;
    }
    if (g->integrating) {
        to->b[to->integrator] = from_u;
        if (lags_of_pair(g))
            to->A[to->integrator * to->nx + before] = from_x;
    } else {
        *to->direct = from_u;
        if (lags_of_pair(g))
            to->c[before] = from_x;
    }
}

int apc_linear_from_transfer(struct apc_linear **model, size_t ny, size_t nu, size_t nd,
                             const struct apc_transfer *g, const double *u0, const double *y0, double Ts,
                             struct apc_error *why)
{
    struct apc_linear_continuous o = {.nu = nu, .nd = nd, .ny = ny, .u0 = u0, .y0 = y0};
    const size_t inputs = nu + nd;
    size_t integrator = 0;
    struct term *term = NULL;
    double *memory = NULL, *A, *C, *b, *d;
    int rc = check_period(model, Ts, "apc_linear_from_transfer", why);

    if (rc < 0)
        return rc;
    if (!ny || !inputs || ny > ELEMENTS_MAX || inputs > ELEMENTS_MAX || ny * inputs > ELEMENTS_MAX || !g)
        return apc_fail(why, APC_EINVAL,
                        "apc_linear_from_transfer: %zu outputs and %zu inputs; there must be one of each, no "
                        "more than %d pairs, and their transfer functions",
                        ny, inputs, ELEMENTS_MAX);
    if (!are_finite_numbers(u0, inputs) || !are_finite_numbers(y0, ny))
        return apc_fail(why, APC_EINVAL, "apc_linear_from_transfer: the operating point is no finite number");
    for (size_t k = 0; k < ny * inputs && rc == 0; k++) {
        rc = check_transfer(&g[k], k / inputs, k % inputs, Ts, why);
        o.nx += lags_of_pair(&g[k]) + (k % inputs == 0 && has_integrator(&g[k], inputs));
    }
    if (rc == 0 && (o.nx + ny) * (o.nx + ny * inputs) > ELEMENTS_MAX)
        rc = apc_fail(why, APC_EINVAL, "apc_linear_from_transfer: %zu states are too many", o.nx);
    if (rc < 0)
        return rc;
    term = calloc(ny * inputs + 1, sizeof(*term));
    memory = calloc(o.nx * o.nx + ny * o.nx + ny * inputs * (o.nx + ny) + 1, sizeof(*memory));
    if (!term || !memory) {
        rc = apc_fail(why, APC_ENOMEM, "linear model: no memory");
        goto out;
    }
    A = memory;
    C = A + o.nx * o.nx;
    b = C + ny * o.nx;
    d = b + ny * inputs * o.nx;
    for (size_t k = 0, at = 0; k < ny * inputs; k++) {
        const size_t i = k / inputs;
        struct pair to = {.nx = o.nx, .A = A, .b = b + k * o.nx, .c = C + i * o.nx, .direct = d + k * ny + i};

        term[k] = (struct term){.j = k % inputs,
                                .dead_time = g[k].dead_time,
                                .b = to.b,
                                .stride_b = 1,
                                .d = d + k * ny,
                                .stride_d = 1};
        if (k % inputs == 0 && has_integrator(&g[k], inputs)) {
            C[i * o.nx + at] = 1.0;
            integrator = at++;
        }
        to.integrator = integrator;
        to.at = at;
        if (g[k].gain != 0.0)
            realise_pair(&g[k], &to);
        at += lags_of_pair(&g[k]);
    }
    o.A = A;
    o.C = C;
    rc = sample_continuous(model, &o, term, ny * inputs, Ts, why);
out:
    free(memory);
    free(term);
    return rc;
}

/* ---- Unknown disturbances ------------------------------------------------------------------------ */

/*
 * The disturbances can be told apart when the steady states they lead to differ in the measurements: when
 * (A - I, B_d; C, C_d) has full column rank (Pannocchia and Rawlings). Columns are taken one after another
 * and made orthogonal to those before; what is left of a column is compared with what it was.
 */
static size_t dependent_column(size_t rows, size_t columns, double *M)
{
    for (size_t j = 0; j < columns; j++) {
        double before = 0.0, after = 0.0;

        for (size_t i = 0; i < rows; i++)
            before += M[i * columns + j] * M[i * columns + j];
        for (int pass = 0; pass < 2; pass++) { /* twice is enough (Giraud, Langou, Rozloznik 2005) */
            for (size_t k = 0; k < j; k++) {
                double dot = 0.0;

                for (size_t i = 0; i < rows; i++)
                    dot += M[i * columns + k] * M[i * columns + j];
                for (size_t i = 0; i < rows; i++)
                    M[i * columns + j] -= dot * M[i * columns + k];
            }
        }
        for (size_t i = 0; i < rows; i++)
            after += M[i * columns + j] * M[i * columns + j];
        if (!(after > 1e-20 * before))
            return j;
        for (size_t i = 0; i < rows; i++)
            M[i * columns + j] /= sqrt(after);
    }
    return columns;
}

static int check_distinct(const struct apc_linear *m, size_t nx_before,
                          const struct apc_linear_unknown *unknown, struct apc_error *why)
{
    const size_t rows = nx_before + m->ny, n = m->nx - nx_before;
    double *M = calloc(rows * m->nx, sizeof(*M));
    size_t column;

    if (!M)
        return apc_fail(why, APC_ENOMEM, "linear model: no memory");
    for (size_t i = 0; i < rows; i++) {
        const double *row = i < nx_before ? m->A + i * m->nx : m->C + (i - nx_before) * m->nx;

        memcpy(M + i * m->nx, row, m->nx * sizeof(*M));
        if (i < nx_before)
            M[i * m->nx + i] -= 1.0;
    }
    column = dependent_column(rows, m->nx, M);
    free(M);
    if (column == m->nx)
        return 0;
    if (column < nx_before)
        return apc_fail(
            why, APC_EINVAL,
            "unknown disturbances: state %zu of the model moves without the measurements showing it: "
            "measure more, or leave it out of the model",
            column + 1);
    column -= nx_before;
    return apc_fail(why, APC_EINVAL,
                    "unknown disturbances: the %zu measurements cannot tell number %zu, at %s %zu, from the "
                    "state and the %zu before it%s",
                    m->ny, column + 1, unknown[column].where == APC_AT_OUTPUT ? "output" : "input",
                    unknown[column].number + 1, column,
                    n > m->ny ? ": there may be no more of them than measurements"
                              : "; an integrating output wants its disturbance at the input");
}

int apc_linear_disturb(struct apc_linear **model, const struct apc_linear *from,
                       const struct apc_linear_unknown *unknown, size_t n, struct apc_error *why)
{
    struct apc_linear *m;
    size_t inputs;
    int rc;

    if (!model)
        return apc_fail(why, APC_EINVAL, "apc_linear_disturb: model must not be NULL");
    *model = NULL;
    if (!from || (n && !unknown) || n > ELEMENTS_MAX)
        return apc_fail(why, APC_EINVAL,
                        "apc_linear_disturb: a model and the unknown disturbances are required");
    inputs = from->nu + from->nd;
    for (size_t k = 0; k < n; k++) {
        size_t most = unknown[k].where == APC_AT_OUTPUT  ? from->ny
                      : unknown[k].where == APC_AT_INPUT ? inputs
                                                         : 0;

        if (unknown[k].number >= most)
            return apc_fail(why, APC_EINVAL, "unknown disturbance %zu: there is no such %s", k + 1,
                            unknown[k].where == APC_AT_OUTPUT ? "output" : "input");
    }
    rc = apc_linear_allocate(&m, from->nx + n, from->nu, from->nd, from->ny, why);
    if (rc < 0)
        return rc;
    m->Ts = from->Ts;
    m->nx_plant = from->nx_plant;
    m->nx_held = from->nx_held;
    apc_matrix_put(m->A, m->nx, 0, 0, from->nx, from->nx, from->A);
    apc_matrix_put(m->B, inputs, 0, 0, from->nx, inputs, from->B);
    apc_matrix_put(m->C, m->nx, 0, 0, from->ny, from->nx, from->C);
    memcpy(m->D, from->D, from->ny * inputs * sizeof(*m->D));
    memcpy(m->x0, from->x0, from->nx * sizeof(*m->x0));
    memcpy(m->u0, from->u0, inputs * sizeof(*m->u0));
    memcpy(m->y0, from->y0, from->ny * sizeof(*m->y0));
    for (size_t k = 0; k < n; k++) {
        size_t column = from->nx + k, number = unknown[k].number;

        m->A[column * m->nx + column] = 1.0;
        if (unknown[k].where == APC_AT_OUTPUT) {
            m->C[number * m->nx + column] = 1.0;
            continue;
        }
        for (size_t i = 0; i < from->nx; i++)
            m->A[i * m->nx + column] = from->B[i * inputs + number];
        for (size_t i = 0; i < from->ny; i++)
            m->C[i * m->nx + column] = from->D[i * inputs + number];
    }
    rc = check_distinct(m, from->nx, unknown, why);
    if (rc < 0)
        apc_linear_destroy(m);
    else
        *model = m;
    return rc;
}

/* ---- Use ----------------------------------------------------------------------------------------- */

static double linear_row_times(const double *a, const double *value, const double *origin, size_t n)
{
    double sum = 0.0;

    for (size_t j = 0; j < n; j++)
        sum += a[j] * (value[j] - origin[j]);
    return sum;
}

void apc_linear_next(const struct apc_linear *model, const double *x, const double *u, double *next)
{
    const size_t inputs = model->nu + model->nd;

    for (size_t i = 0; i < model->nx; i++)
        next[i] = model->x0[i] + (linear_row_times(model->A + i * model->nx, x, model->x0, model->nx) +
                                  linear_row_times(model->B + i * inputs, u, model->u0, inputs));
}

void apc_linear_output(const struct apc_linear *model, const double *x, const double *u, double *y)
{
    const size_t inputs = model->nu + model->nd;

    for (size_t i = 0; i < model->ny; i++)
        y[i] = model->y0[i] + (linear_row_times(model->C + i * model->nx, x, model->x0, model->nx) +
                               linear_row_times(model->D + i * inputs, u, model->u0, inputs));
}
