/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * State space. Rows of the record, each of them s samples of the future u, s past ones of u and y, and s of
 * the future y, give the triangle R; the part of the future y that hangs on the past and not on the future u
 * is the block of R whose singular vectors span what the states do to y (Verhaegen, Automatica 30, 1994).
 *
 * A and C follow from that. What is left is linear: where the state began, B, D, an offset, and K, where the
 * errors of the long autoregression that R holds as well stand for what disturbs the state.
 */
#include "identify/identify_internal.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"

#define ROWS_MOST  15
#define ORDER_MOST 10
#define BETTER     0.99 /* of the misfit of a lower order is what a higher one must reach */
#define PERFECT    1e-6 /* a misfit below which more states only follow the rounding */
#define STABLE     1.02 /* growth a sample above which the plant is unstable for good */

struct subspace {
    struct apc_record r;
    size_t inputs, runs, s, width, used; /* used: samples of r */
    bool offsets, direct;
    void *memory;                              /* of all the arrays */
    double *u, *y;                             /* [n * inputs], [n * ny], scaled */
    double *mean_u, *mean_y, *size_u, *size_y; /* the means of each run */
    struct apc_triangle rows;
    double *row;            /* [width] */
    double *Gamma, *weight; /* [s ny * s ny] by columns, [s ny] */
    double *e;              /* [n * ny] errors of the autoregression, scaled; 0 where there is none */
};

/* ---- Scaled numbers -------------------------------------------------------------------------------- */

static double u_at(const struct subspace *p, size_t k, size_t j)
{
    return p->u[k * p->inputs + j];
}

static double y_at(const struct subspace *p, size_t k, size_t i)
{
    return p->y[k * p->r.ny + i];
}

/* x [n * width] around the mean [runs * width] of each run, in units of its deviation from there [width]. */
static void scale_to_deviation(const struct subspace *p, const double *x, size_t width, double *mean,
                               double *size, double *to)
{
    for (size_t i = 0; i < width; i++) {
        double all = 0.0;

        for (size_t g = 0; g < p->runs; g++) {
            const size_t end = apc_record_end(&p->r, g), begin = end - apc_record_run(&p->r, g).n;
            double *m = &mean[g * width + i], there = 0.0;

            for (size_t k = begin; k < end; k++) {
                *m += isfinite(x[k * width + i]) ? x[k * width + i] : 0.0;
                there += isfinite(x[k * width + i]) != 0;
            }
            *m = there > 0.0 ? *m / there : 0.0;
            for (size_t k = begin; k < end; k++)
                size[i] += isfinite(x[k * width + i]) ? apc_pow(x[k * width + i] - *m, 2) : 0.0;
            all += there;
            if (!p->offsets)
                *m = 0.0;
        }
        size[i] = sqrt(size[i] / all);
    }
    for (size_t g = 0; g < p->runs; g++) {
        const size_t end = apc_record_end(&p->r, g), begin = end - apc_record_run(&p->r, g).n;

        for (size_t k = begin * width; k < end * width; k++)
            to[k] = (x[k] - mean[g * width + k % width]) / size[k % width];
    }
}

/* The samples of a run that are used: all but s at either end. */
static size_t first_used_sample(const struct subspace *p, size_t run, size_t *end)
{
    const struct apc_record one = apc_record_run(&p->r, run);
    const size_t begin = apc_record_end(&p->r, run) - one.n, share = apc_record_share(&p->r, &one, p->used);

    *end = share > p->s ? begin + share - p->s + 1 : 0;
    return begin + p->s;
}

/* ---- The triangle ---------------------------------------------------------------------------------- */

/* u of samples k..k+s-1, u and y of k-s..k-1, y of k..k+s-1. */
static bool fill_subspace_row(const struct subspace *p, size_t k)
{
    const size_t m = p->inputs, l = p->r.ny, s = p->s;
    double *at = p->row;
    bool there = true;

    for (size_t i = k; i < k + s; i++) {
        for (size_t j = 0; j < m; j++)
            *at++ = u_at(p, i, j);
    }
    for (size_t i = k - s; i < k; i++) {
        for (size_t j = 0; j < m; j++)
            *at++ = u_at(p, i, j);
    }
    for (size_t i = k - s; i < k + s; i++) {
        for (size_t j = 0; j < l; j++)
            *at++ = y_at(p, i, j);
    }
    for (size_t q = 0; q < p->width; q++)
        there &= isfinite(p->row[q]) != 0;
    return there;
}

/* Of samples 0..until-1: the triangle, and from it the directions of the states. */
static int gather_subspace(struct subspace *p, size_t until, struct apc_error *why)
{
    const size_t m = p->inputs, l = p->r.ny, s = p->s, past = s * (m + l), width = p->width;
    double *block, *V;

    p->used = until;
    apc_triangle_close(&p->rows);
    if (apc_triangle_open(&p->rows, width) < 0)
        return APC_ENOMEM;
    for (size_t g = 0; g < p->runs; g++) {
        size_t end;

        for (size_t k = first_used_sample(p, g, &end); k < end; k++) {
            if (fill_subspace_row(p, k))
                apc_triangle_add(&p->rows, p->row);
        }
    }
    apc_triangle_end(&p->rows);
    if (p->rows.n < width)
        return apc_fail(why, APC_EINVAL,
                        "subspace: only %zu stretches of %zu samples have no gap: %zu are needed", p->rows.n,
                        2 * s, width);
    block = calloc(past * s * l + s * l * s * l, sizeof(*block));
    if (!block)
        return APC_ENOMEM;
    V = block + past * s * l;
    for (size_t j = 0; j < s * l; j++) {
        for (size_t i = 0; i < past; i++)
            block[j * past + i] = p->rows.R[(s * m + i) * width + s * m + past + j];
    }
    apc_svd(past, s * l, block, p->weight, V);
    memcpy(p->Gamma, V, s * l * s * l * sizeof(*V));
    free(block);
    return 0;
}

/* The errors of y as it is expected from u of now and the past of both: its columns stand in R. */
static int find_errors(struct subspace *p)
{
    const size_t m = p->inputs, l = p->r.ny, s = p->s, past = s * (m + l), width = p->width, n = m + past;
    double *Q = calloc(width * (n + l) + width * width + n * (l + 1), sizeof(*Q)), *R, *b, *theta;

    if (!Q)
        return APC_ENOMEM;
    R = Q + width * (n + l);
    b = R + width * width;
    theta = b + n;
    for (size_t c = 0; c < n + l; c++) {
        const size_t column = c < m ? c : c < n ? s * m + c - m : s * m + past + c - n;

        for (size_t i = 0; i < width; i++)
            Q[c * width + i] = p->rows.R[i * width + column];
    }
    apc_qr_extend(width, 0, n, Q, R, width);
    for (size_t i = 0; i < l; i++) {
        for (size_t c = 0; c < n; c++)
            b[c] = apc_column_dot(Q + c * width, Q + (n + i) * width, width);
        apc_qr_solve(n, R, width, b, theta + i * n);
    }
    memset(p->e, 0, p->r.n * l * sizeof(*p->e));
    for (size_t g = 0; g < p->runs; g++) {
        size_t end;

        for (size_t k = first_used_sample(p, g, &end); k < end; k++) {
            if (!fill_subspace_row(p, k))
                continue;
            for (size_t i = 0; i < l; i++)
                p->e[k * l + i] = y_at(p, k, i) - apc_matrix_dot(theta + i * n, p->row, m) -
                                  apc_matrix_dot(theta + i * n + m, p->row + s * m, past);
        }
    }
    free(Q);
    return 0;
}

/* ---- A model of n states ---------------------------------------------------------------------------- */

/* C is the first block of the directions, A what takes each block to the next. A, C row after row. */
static int find_dynamics(const struct subspace *p, size_t n, double *A, double *C)
{
    const size_t l = p->r.ny, all = p->s * l, rows = all - l;
    double *Q = calloc(2 * rows * n + n * n + 2 * n, sizeof(*Q)), *next, *R, *b, *x;

    if (!Q)
        return APC_ENOMEM;
    next = Q + rows * n;
    R = next + rows * n;
    b = R + n * n;
    x = b + n;
    for (size_t j = 0; j < n; j++) {
        const double root = sqrt(p->weight[j]);

        for (size_t i = 0; i < rows; i++) {
            Q[j * rows + i] = p->Gamma[j * all + i] * root;
            next[j * rows + i] = p->Gamma[j * all + i + l] * root;
        }
        for (size_t i = 0; i < l; i++)
            C[i * n + j] = p->Gamma[j * all + i] * root;
    }
    apc_qr_extend(rows, 0, n, Q, R, n);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < n; i++)
            b[i] = apc_column_dot(Q + i * rows, next + j * rows, rows);
        apc_qr_solve(n, R, n, b, x);
        for (size_t i = 0; i < n; i++)
            A[i * n + j] = x[i];
    }
    free(Q);
    return 0;
}

/* Unknowns: the first state of each run, B, K by columns of A's size each, then D of each output and its
 * offset in each run. */
struct rest {
    size_t n, sources, states, unknowns; /* states: unknowns that make the state */
    double *state, *next;                /* [n * states] what a unit of each unknown has done to the state */
    double *row, *theta;                 /* [unknowns + 1], [unknowns] */
    struct apc_triangle rows;
};

static size_t d_column(const struct subspace *p, const struct rest *rest, size_t i, size_t j)
{
    return rest->states + i * (p->inputs + p->runs) + j;
}

static void add_sample(const struct subspace *p, struct rest *rest, const double *C, size_t run, size_t k)
{
    const size_t n = rest->n, m = p->inputs, states = rest->states;

    for (size_t i = 0; i < p->r.ny; i++) {
        memset(rest->row, 0, (rest->unknowns + 1) * sizeof(*rest->row));
        for (size_t c = 0; c < states; c++) {
            for (size_t q = 0; q < n; q++)
                rest->row[c] += C[i * n + q] * rest->state[q * states + c];
        }
        for (size_t j = 0; j < m; j++)
            rest->row[d_column(p, rest, i, j)] = p->direct ? u_at(p, k, j) : 0.0;
        rest->row[d_column(p, rest, i, m + run)] = p->offsets;
        rest->row[rest->unknowns] = y_at(p, k, i);
        if (isfinite(rest->row[rest->unknowns]))
            apc_triangle_add(&rest->rows, rest->row);
    }
}

/* The states that a unit of each unknown makes: [n, states]. */
static void advance_states(const struct subspace *p, struct rest *rest, const double *A, size_t k)
{
    const size_t n = rest->n, m = p->inputs, states = rest->states, first = p->runs * n;

    apc_matrix_multiply(n, n, states, A, rest->state, rest->next);
    for (size_t source = 0; source < rest->sources; source++) {
        const double drive = source < m ? u_at(p, k, source) : p->e[k * p->r.ny + source - m];

        for (size_t q = 0; q < n; q++)
            rest->next[q * states + first + source * n + q] += drive;
    }
    memcpy(rest->state, rest->next, n * states * sizeof(*rest->state));
}

static int find_rest(const struct subspace *p, struct rest *rest, const double *A, const double *C)
{
    const size_t n = rest->n, states = rest->states, all = rest->unknowns + 1;
    double *b;

    rest->state = calloc(2 * n * states + 3 * all, sizeof(*rest->state));
    if (!rest->state || apc_triangle_open(&rest->rows, all) < 0)
        return APC_ENOMEM;
    rest->next = rest->state + n * states;
    rest->row = rest->next + n * states;
    rest->theta = rest->row + all;
    b = rest->theta + all;
    for (size_t g = 0; g < p->runs; g++) {
        size_t end;

        memset(rest->state, 0, n * states * sizeof(*rest->state));
        for (size_t q = 0; q < n; q++)
            rest->state[q * states + g * n + q] = 1.0;
        for (size_t k = first_used_sample(p, g, &end); k < end; k++) {
            add_sample(p, rest, C, g, k);
            advance_states(p, rest, A, k);
        }
    }
    apc_triangle_end(&rest->rows);
    for (size_t i = 0; i < rest->unknowns; i++)
        b[i] = rest->rows.R[i * all + rest->unknowns];
    apc_qr_solve(rest->unknowns, rest->rows.R, all, b, rest->theta);
    return 0;
}

/* A K with which the expectation is stable: the Kalman filter's of the same spectrum, where it was not. */
static int mend_gain(size_t n, size_t l, const double *A, const double *C, const double *S, double *K)
{
    double *F, *Ft, *Q, *P, *Ct, *more;
    const struct apc_part parts[] = {APC_PART(F, n * n),     APC_PART(Ft, n * n), APC_PART(Q, n * n),
                                     APC_PART(P, 2 * n * n), APC_PART(Ct, n * l), APC_PART(more, n * l)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    int rc = 0;

    if (!memory)
        return APC_ENOMEM;
    apc_matrix_multiply(n, l, n, K, C, F);
    for (size_t i = 0; i < n * n; i++)
        F[i] = A[i] - F[i];
    if (apc_spectral_radius(n, F, P) >= 1.0) {
        apc_matrix_transpose(n, n, F, Ft);
        apc_matrix_transpose(l, n, C, Ct);
        for (size_t i = 0; i < n; i++)
            Q[i * n + i] = 1e-8;
        rc = apc_riccati_solve(n, l, Ft, Ct, Q, S, P, more, NULL);
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < l; j++)
                K[i * l + j] = rc == 0 ? K[i * l + j] + more[j * n + i] : 0.0;
        }
        rc = rc == APC_ENOMEM ? rc : 0;
    }
    free(memory);
    return rc;
}

/* In the units of the record. */
static void write_model(const struct subspace *p, const struct rest *rest, const double *A, const double *C,
                        struct apc_identified *to)
{
    const size_t n = rest->n, m = p->inputs, l = p->r.ny;
    const double *theta = rest->theta + p->runs * n;
    struct apc_linear *model = to->linear;

    model->nx_plant = n;
    memcpy(model->A, A, n * n * sizeof(*A));
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < m; j++)
            model->B[i * m + j] = theta[j * n + i] / p->size_u[j];
        for (size_t j = 0; j < l; j++)
            to->K[i * l + j] = theta[(m + j) * n + i];
    }
    for (size_t i = 0; i < l; i++) {
        for (size_t j = 0; j < n; j++)
            model->C[i * n + j] = C[i * n + j] * p->size_y[i];
        for (size_t j = 0; j < m; j++)
            model->D[i * m + j] = rest->theta[d_column(p, rest, i, j)] * p->size_y[i] / p->size_u[j];
        for (size_t g = 0; g < p->runs; g++)
            to->y0[g * l + i] =
                p->mean_y[g * l + i] + rest->theta[d_column(p, rest, i, m + g)] * p->size_y[i];
    }
    memcpy(to->u0, p->mean_u, p->runs * m * sizeof(*to->u0));
    memcpy(model->u0, to->u0, m * sizeof(*model->u0));
    memcpy(model->y0, to->y0, l * sizeof(*model->y0));
}

/* The covariance of what the autoregression leaves. Scaled. */
static void subspace_covariance(const struct subspace *p, double *S)
{
    const size_t l = p->r.ny;
    double n = 0.0;

    memset(S, 0, l * l * sizeof(*S));
    for (size_t k = 0; k < p->r.n; k++) {
        for (size_t i = 0; i < l; i++) {
            for (size_t j = 0; j < l; j++)
                S[i * l + j] += p->e[k * l + i] * p->e[k * l + j];
        }
        n += p->e[k * l] != 0.0;
    }
    for (size_t i = 0; i < l; i++) {
        for (size_t j = 0; j < l; j++)
            S[i * l + j] = S[i * l + j] / fmax(n, 1.0) + (i == j ? 1e-12 : 0.0);
    }
}

static int model_of_order(const struct subspace *p, size_t n, struct apc_identified **model,
                          struct apc_error *why)
{
    const size_t l = p->r.ny;
    struct rest rest = {.n = n, .sources = p->inputs + l};
    double *A = calloc(3 * n * n + n * l + l * l, sizeof(*A)), *C, *S, *work;
    int rc = A ? 0 : APC_ENOMEM;

    *model = NULL;
    rest.states = p->runs * n + rest.sources * n;
    rest.unknowns = rest.states + l * (p->inputs + p->runs);
    if (rc == 0) {
        work = A + n * n;
        C = work + 2 * n * n;
        S = C + n * l;
        rc = find_dynamics(p, n, A, C);
        if (rc == 0 && apc_spectral_radius(n, A, work) > STABLE)
            rc = apc_fail(
                why, APC_ESOLVER,
                "subspace: with %zu states the plant is unstable: identify it with arx, from a record "
                "under control",
                n);
        if (rc == 0)
            rc = find_rest(p, &rest, A, C);
        if (rc == 0)
            rc = apc_identified_create(model, &p->r, n, why);
        if (rc == 0) {
            write_model(p, &rest, A, C, *model);
            subspace_covariance(p, S);
            rc = mend_gain(n, l, A, C, S, (*model)->K);
            for (size_t i = 0; i < l; i++) {
                for (size_t q = 0; q < n; q++)
                    (*model)->K[q * l + i] /= p->size_y[i];
                for (size_t j = 0; j < l; j++)
                    (*model)->covariance[i * l + j] = S[i * l + j] * p->size_y[i] * p->size_y[j];
            }
        }
    }
    if (rc == APC_ENOMEM) {
        apc_fail(why, rc, "apc_identify_subspace: no memory");
        apc_identified_destroy(*model);
        *model = NULL;
    }
    apc_triangle_close(&rest.rows);
    free(rest.state);
    free(A);
    return rc;
}

/* ---- Order ------------------------------------------------------------------------------------------- */

static int find_order(struct subspace *p, size_t *order, struct apc_error *why)
{
    const size_t from = p->r.n * 2 / 3;
    double best = HUGE_VAL;
    int rc = gather_subspace(p, from, why), reason = APC_ESOLVER;

    if (rc == 0)
        rc = find_errors(p);
    if (rc < 0)
        return rc == APC_ENOMEM ? apc_fail(why, rc, "apc_identify_subspace: no memory") : rc;
    *order = 0;
    for (size_t n = 1; n <= ORDER_MOST && n + p->r.ny <= (p->s - 1) * p->r.ny && rc == 0; n++) {
        struct apc_identified *model;
        double misfit;

        rc = model_of_order(p, n, &model, why);
        if (rc == APC_ESOLVER) {
            rc = 0;
            continue;
        }
        if (rc < 0)
            break;
        misfit = apc_identified_misfit(model, &p->r, from);
        apc_identified_destroy(model);
        if (misfit < 0.0)
            return apc_fail(why, APC_ENOMEM, "apc_identify_subspace: no memory");
        if (misfit < best * (*order ? BETTER : 1.0) && best > PERFECT) {
            best = misfit;
            *order = n;
        }
    }
    return rc < 0 ? rc : *order ? 0 : reason;
}

static int open_subspace(struct subspace *p, const struct apc_identify_subspace_options *o,
                         struct apc_error *why)
{
    const size_t m = p->inputs, l = p->r.ny, shortest = apc_record_shortest(&p->r), most = shortest / 6,
                 all = p->r.n / (6 * (m + l) + 1), afford = all < most ? all : most;

    p->s = o->rows ? o->rows : afford < ROWS_MOST ? afford : ROWS_MOST;
    p->width = 2 * p->s * (m + l);
    if (p->s < 3 || p->s > 200 || 2 * p->s * p->runs + p->width > p->r.n || 4 * p->s > shortest ||
        o->order + l > (p->s - 1) * l)
        return apc_fail(
            why, APC_EINVAL,
            "apc_identify_subspace: %zu samples of %zu inputs and %zu outputs allow %zu rows, 3 are "
            "the least; the order must be below the rows times the outputs",
            p->r.n, m, l, afford);
    const struct apc_part parts[] = {
        APC_PART(p->mean_u, p->runs * m), APC_PART(p->size_u, m),     APC_PART(p->mean_y, p->runs * l),
        APC_PART(p->size_y, l),           APC_PART(p->row, p->width), APC_PART(p->Gamma, p->s * l * p->s * l),
        APC_PART(p->weight, p->s * l),    APC_PART(p->e, p->r.n * l), APC_PART(p->u, p->r.n * m),
        APC_PART(p->y, p->r.n * l)};
    p->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!p->memory)
        return apc_fail(why, APC_ENOMEM, "apc_identify_subspace: no memory");
    p->offsets = !o->deviations;
    p->direct = o->direct;
    scale_to_deviation(p, p->r.u, m, p->mean_u, p->size_u, p->u);
    scale_to_deviation(p, p->r.y, l, p->mean_y, p->size_y, p->y);
    return 0;
}

/* One that rests where the plant has been. */
static int take_stable_model(const struct subspace *p, size_t n, struct apc_identified **model,
                             struct apc_error *why)
{
    int rc = model_of_order(p, n, model, why);

    if (rc == 0 && p->offsets)
        rc = apc_record_check_point(&p->r, (*model)->u0, (*model)->y0, why);
    if (rc == APC_ESOLVER) {
        apc_identified_destroy(*model);
        *model = NULL;
    }
    return rc;
}

int apc_identify_subspace(struct apc_identified **model, const struct apc_record *record,
                          const struct apc_identify_subspace_options *options, struct apc_error *why)
{
    struct apc_identify_subspace_options o = {0};
    struct subspace p = {0};
    bool found = false;
    int rc = apc_record_check(record, why);

    *model = NULL;
    if (rc == 0)
        rc = apc_options_copy(&p.r, sizeof(p.r), record, "apc_record", why);
    if (rc == 0)
        rc = apc_options_copy(&o, sizeof(o), options, "apc_identify_subspace_options", why);
    if (rc < 0)
        return rc;
    p.inputs = p.r.nu + p.r.nd;
    p.runs = apc_record_runs(&p.r);
    found = o.order == 0;
    rc = open_subspace(&p, &o, why);
    if (rc == 0 && o.order == 0)
        rc = find_order(&p, &o.order, why);
    if (rc == 0) {
        rc = gather_subspace(&p, p.r.n, why);
        if (rc == 0)
            rc = find_errors(&p);
        if (rc == APC_ENOMEM)
            apc_fail(why, rc, "apc_identify_subspace: no memory");
    }
    if (rc == 0)
        rc = take_stable_model(&p, o.order, model, why);
    while (rc == APC_ESOLVER && found && o.order > 1) /* of a part of the record it was stable */
        rc = take_stable_model(&p, --o.order, model, why);
    apc_triangle_close(&p.rows);
    free(p.memory);
    return rc;
}
