/* SPDX-License-Identifier: BSD-3-Clause */
/* What was identified, and how well it goes with a record. */
#include "identify/identify_internal.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "predict/predict_internal.h"

#define VALIDATE_LEAST 20
#define LAGS           15    /* over which errors must be white and independent */
#define AWAY           1e6   /* of a free run's deviations: it has run away */
#define NOTHING        1e-12 /* of what a state began with: it has been forgotten */

int apc_identified_create(struct apc_identified **model, const struct apc_record *r, size_t nx,
                          struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd,
                 numbers = nx * r->ny + r->ny * r->ny + apc_record_runs(r) * (inputs + r->ny);
    struct apc_identified *m =
        calloc(1, sizeof(*m) + numbers * sizeof(double) + r->ny * inputs * sizeof(size_t));
    double *at;
    int rc;

    *model = NULL;
    if (!m)
        return apc_fail(why, APC_ENOMEM, "identify: no memory");
    at = (double *)(m + 1);
    m->u0 = apc_carve(&at, apc_record_runs(r) * inputs);
    m->y0 = apc_carve(&at, apc_record_runs(r) * r->ny);
    m->K = apc_carve(&at, nx * r->ny);
    m->covariance = apc_carve(&at, r->ny * r->ny);
    m->delay = (size_t *)(void *)at;
    rc = apc_linear_allocate(&m->linear, nx, r->nu, r->nd, r->ny, why);
    if (rc < 0) {
        free(m);
        return rc;
    }
    m->linear->Ts = r->Ts;
    *model = m;
    return 0;
}

void apc_identified_destroy(struct apc_identified *model)
{
    if (model)
        apc_linear_destroy(model->linear);
    free(model);
}

double *apc_record_gather(struct apc_record *r, const double *u0, const double *y0)
{
    const size_t inputs = r->nu + r->nd;
    double *u = calloc(r->n * (inputs + r->ny) + 1, sizeof(*u)), *y = u ? u + r->n * inputs : NULL;

    for (size_t g = 0; g < apc_record_runs(r) && u; g++) {
        const struct apc_record run = apc_record_run(r, g);
        const size_t begin = apc_record_end(r, g) - run.n;

        for (size_t k = 0; k < run.n * inputs; k++)
            u[begin * inputs + k] = run.u[k] + (u0[k % inputs] - u0[g * inputs + k % inputs]);
        for (size_t k = 0; k < run.n * r->ny; k++)
            y[begin * r->ny + k] = run.y[k] + (y0[k % r->ny] - y0[g * r->ny + k % r->ny]);
    }
    r->u = u;
    r->y = y;
    return u;
}

double apc_spectral_radius(size_t n, const double *A, double *work)
{
    double *power = work, *square = work + n * n, root = 1.0, log_radius = 0.0;

    memcpy(power, A, n * n * sizeof(*A));
    for (int i = 0; i < 12; i++) { /* A^(2^i), kept at norm 1 */
        const double norm = apc_matrix_norm(n, power);

        if (!(norm > 0.0))
            return 0.0;
        log_radius += root * apc_log(norm);
        root /= 2.0;
        for (size_t k = 0; k < n * n; k++)
            power[k] /= norm;
        apc_matrix_multiply(n, n, n, power, power, square);
        memcpy(power, square, n * n * sizeof(*A));
    }
    return apc_exp(log_radius);
}

/* ---- Running -------------------------------------------------------------------------------------- */

struct run {
    const struct apc_linear *model;
    const double *K;
    const struct apc_record *r;
    size_t inputs;
    double *x, *next, *y; /* [nx], [nx], [ny] */
    double *size;         /* [ny] deviation of what is measured from where the model arrived on */
};

static int open_run(struct run *run)
{
    const size_t nx = run->model->nx;

    run->inputs = run->r->nu + run->r->nd;
    run->x = calloc(2 * nx + 2 * run->r->ny, sizeof(*run->x));
    run->next = run->x + nx;
    run->y = run->next + nx;
    run->size = run->y + run->r->ny;
    return run->x ? 0 : APC_ENOMEM;
}

/* One sample on; where there is a K and @p corrected, with what was measured. */
static void step_run(struct run *run, size_t k, bool corrected)
{
    const struct apc_linear *m = run->model;
    const double *u = run->r->u + k * run->inputs;

    apc_linear_output(m, run->x, u, run->y);
    apc_linear_next(m, run->x, u, run->next);
    for (size_t i = 0; i < m->ny && run->K && corrected; i++) {
        const double error = run->r->y[k * m->ny + i] - run->y[i];

        for (size_t j = 0; j < m->nx && isfinite(error); j++)
            run->next[j] += run->K[j * m->ny + i] * error;
    }
    memcpy(run->x, run->next, m->nx * sizeof(*run->x));
}

static double deviation_of(const struct apc_record *r, size_t i, size_t from)
{
    double mean = 0.0, sum = 0.0, n = 0.0;

    for (size_t k = from; k < r->n; k++) {
        if (isfinite(r->y[k * r->ny + i])) {
            mean += r->y[k * r->ny + i];
            n += 1.0;
        }
    }
    for (size_t k = from; k < r->n; k++) {
        const double d = r->y[k * r->ny + i] - mean / n;

        sum += isfinite(d) ? d * d : 0.0;
    }
    return sqrt(sum / n);
}

/* errors[k * ny + i] from @p from on, of a free run or a sample ahead. */
static void errors(struct run *run, const double *x, size_t from, bool ahead, double *e)
{
    const size_t ny = run->r->ny;

    memcpy(run->x, x, run->model->nx * sizeof(*x));
    for (size_t k = from; k < run->r->n; k++) {
        step_run(run, k, ahead);
        for (size_t i = 0; i < ny; i++)
            e[k * ny + i] = run->r->y[k * ny + i] - run->y[i];
    }
}

/* x [nx]: at sample @p from what is still held of an input @p j that was larger by 1 before the record. */
static void held_before(struct run *run, size_t j, size_t from, double *x)
{
    const struct apc_linear *m = run->model;

    memset(x, 0, m->nx * sizeof(*x));
    for (size_t k = 0; k < m->nx_held + from; k++) {
        apc_matrix_multiply(m->nx, m->nx, 1, m->A, x, run->next);
        for (size_t i = m->nx_plant; i < m->nx; i++)
            x[i] = run->next[i] + (k < m->nx_held ? m->B[i * run->inputs + j] : 0.0);
    }
}

/* Unknowns of where a run is at sample @p from: the states of the plant, and what each input was before the
 * record, where that still acts. */
static size_t begun_by(const struct run *run, size_t from)
{
    return run->model->nx_plant + (from < run->model->nx_held ? run->inputs : 0);
}

/* A direction of the state a sample on, as the errors of step_run() take it with them. @p out [ny] */
static void propagate_direction(struct run *run, size_t k, double *x, double *out)
{
    const struct apc_linear *m = run->model;

    apc_matrix_multiply(m->ny, m->nx, 1, m->C, x, out);
    apc_matrix_multiply(m->nx, m->nx, 1, m->A, x, run->next);
    for (size_t i = 0; i < m->ny && run->K; i++)
        for (size_t j = 0; j < m->nx && isfinite(run->r->y[k * m->ny + i]); j++)
            run->next[j] -= run->K[j * m->ny + i] * out[i];
    memcpy(x, run->next, m->nx * sizeof(*x));
}

/* One row of an output and sample: what each of the @p n unknowns does to its error, and the error; until
 * none of them does anything any more. to [n * nx] are their directions, row [ny * (n + 1)]. */
static void gather_initial_rows(struct run *run, size_t from, size_t n, double *to, const double *e,
                                double *row, struct apc_triangle *rows)
{
    const size_t nx = run->model->nx, ny = run->model->ny;
    bool acts = true;

    for (size_t k = from; k < run->r->n && acts; k++) {
        acts = false;
        for (size_t j = 0; j < n; j++) {
            propagate_direction(run, k, to + j * nx, run->y);
            for (size_t i = 0; i < ny; i++)
                row[i * (n + 1) + j] = run->y[i] / run->size[i];
        }
        for (size_t i = 0; i < ny; i++) {
            row[i * (n + 1) + n] = e[k * ny + i] / run->size[i];
            if (isfinite(row[i * (n + 1) + n]))
                apc_triangle_add(rows, row + i * (n + 1));
        }
        for (size_t i = 0; i < n * nx; i++)
            acts |= fabs(to[i]) > NOTHING;
    }
    apc_triangle_end(rows);
}

/* x becomes what fits best from sample @p from on: a sample ahead where there is a K, else running freely. */
static int fit_state(struct run *run, size_t from, double *x)
{
    const struct apc_linear *m = run->model;
    const size_t n = begun_by(run, from), ny = m->ny;
    struct apc_triangle rows = {0};
    double *to = calloc(2 * n * m->nx + (ny + 1) * (n + 1) + run->r->n * ny, sizeof(*to)), *found, *row, *e,
           *b;

    if (!to || apc_triangle_open(&rows, n + 1) < 0) {
        free(to);
        return APC_ENOMEM;
    }
    found = to + n * m->nx;
    row = found + n * m->nx;
    b = row + ny * (n + 1);
    e = b + n + 1;
    errors(run, x, from, run->K != NULL, e);
    for (size_t j = 0; j < n; j++) {
        if (j < m->nx_plant)
            to[j * m->nx + j] = 1.0;
        else
            held_before(run, j - m->nx_plant, from, to + j * m->nx);
    }
    memcpy(found, to, n * m->nx * sizeof(*to));
    gather_initial_rows(run, from, n, to, e, row, &rows);
    for (size_t j = 0; j < n; j++)
        b[j] = rows.R[j * (n + 1) + n];
    apc_qr_solve(n, rows.R, n + 1, b, b);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < m->nx; i++)
            x[i] += b[j] * found[j * m->nx + i];
    }
    apc_triangle_close(&rows);
    free(to);
    return 0;
}

/*
 * x [nx]: where the run is at sample @p from. With a K what was measured until then says so, from where the
 * record begins; without one, what is measured from there on. Neither knows how the plant came to where the
 * record begins, nor what the inputs were: both are what fits best.
 */
static int initial_state_of(struct run *run, size_t from, double *x)
{
    const struct apc_linear *m = run->model;
    const size_t begin = run->K ? 0 : from;
    int rc;

    for (size_t i = 0; i < m->ny; i++)
        run->size[i] = deviation_of(run->r, i, from);
    memcpy(run->x, m->x0, m->nx * sizeof(*run->x));
    for (size_t i = 0; i < m->nx_held; i++) {
        apc_linear_next(m, run->x, run->r->u, run->next);
        memcpy(run->x + m->nx_plant, run->next + m->nx_plant, m->nx_held * sizeof(*run->x));
    }
    for (size_t k = 0; k < begin; k++)
        step_run(run, k, false);
    memcpy(x, run->x, m->nx * sizeof(*x));
    rc = fit_state(run, begin, x);
    memcpy(run->x, x, m->nx * sizeof(*x));
    for (size_t k = begin; k < from && rc == 0; k++)
        step_run(run, k, true);
    memcpy(x, run->x, m->nx * sizeof(*x));
    return rc;
}

/* The sum of the squares of a run's relative errors, and how many there are; negative: no memory.
 * e [n * ny + nx] */
static double misfit_of(struct run *run, size_t from, double *e, double *n)
{
    const struct apc_record *r = run->r;
    double *x = e + r->n * r->ny, sum = 0.0;

    if (initial_state_of(run, from, x) < 0)
        return -1.0;
    errors(run, x, from, false, e);
    for (size_t k = from * r->ny; k < r->n * r->ny; k++) {
        const double relative = e[k] / run->size[k % r->ny];

        if (isfinite(r->y[k])) {
            sum += isfinite(relative) && fabs(relative) < AWAY ? relative * relative : HUGE_VAL;
            *n += 1.0;
        }
    }
    return sum;
}

double apc_identified_misfit(const struct apc_identified *model, const struct apc_record *record, size_t from)
{
    struct apc_record r = *record;
    struct run run = {.model = model->linear, .K = model->K, .r = &r};
    double sum = 0.0, n = 0.0, of = 0.0, *e = calloc(r.n * r.ny + model->linear->nx, sizeof(*e)),
           *moved = apc_record_gather(&r, model->u0, model->y0);

    if (!e || !moved || open_run(&run) < 0) {
        free(e);
        free(moved);
        return -1.0;
    }
    for (size_t g = 0; g < apc_record_runs(&r) && of >= 0.0; g++) {
        const struct apc_record one = apc_record_run(&r, g);

        run.r = &one;
        of = misfit_of(&run, apc_record_share(&r, &one, from), e, &n);
        sum += of;
    }
    free(run.x);
    free(e);
    free(moved);
    return of < 0.0 ? of : sqrt(sum / n);
}

/* ---- What the errors tell --------------------------------------------------------------------------- */

/* Sums of squares over all runs, of one output. */
struct score {
    double n, all, free, ahead;
};

static void add_scores(const struct run *run, const double *run_free, const double *ahead, size_t from,
                       struct score *score)
{
    const size_t ny = run->r->ny;

    for (size_t k = from * ny; k < run->r->n * ny; k++) {
        struct score *s = &score[k % ny];

        if (!isfinite(run->r->y[k]))
            continue;
        s->n += 1.0;
        s->all += run->size[k % ny] * run->size[k % ny];
        s->free += run_free[k] * run_free[k];
        s->ahead += ahead[k] * ahead[k];
    }
}

/* Ljung and Box, Biometrika 65, 1978. */
double apc_white_probability(const double *e, size_t n)
{
    double sum = 0.0, all = 0.0, there = 0.0;

    for (size_t k = 0; k < n; k++) {
        all += isfinite(e[k]) ? e[k] * e[k] : 0.0;
        there += isfinite(e[k]) != 0;
    }
    for (size_t lag = 1; lag <= LAGS; lag++) {
        double product = 0.0;

        for (size_t k = lag; k < n; k++)
            product += isfinite(e[k] * e[k - lag]) ? e[k] * e[k - lag] : 0.0;
        sum += apc_pow(product / all, 2) / (there - (double)lag);
    }
    return all > 0.0 ? apc_chi2_above(there * (there + 2.0) * sum, LAGS) : (double)NAN;
}

/* Errors e [n] of an output, and u [inputs * n], each input in one piece; behind each run there are LAGS of
 * NAN. */
struct aligned_output {
    size_t n, inputs;
    const double *direct; /* [inputs] what each does at once */
    double *e, *u;
};

/* How much of the errors, whitened, the inputs of the last samples explain, filtered as the errors are; the
 * same sample's only where the model has it act at once: else a controller makes it of that very error. The
 * smallest probability, times the number of inputs, as the inputs are so many chances. */
static int independent_of(const struct aligned_output *of, double *least)
{
    const size_t n = of->n, rows = n - LAGS;
    double a[8], *Q = calloc((size_t)(LAGS + 2) * n + 2 * n + (size_t)(LAGS + 2) * (LAGS + 2), sizeof(*Q)),
                 *w, *u, *R;
    int order = Q ? apc_autoregression(of->e, n, 8, a) : APC_ENOMEM;

    *least = 1.0;
    if (order < 0) {
        free(Q);
        return order;
    }
    w = Q + (LAGS + 2) * n;
    u = w + n;
    R = u + n;
    apc_whiten(of->e, n, a, (size_t)order, w);
    for (size_t j = 0; j < of->inputs; j++) {
        const size_t first = of->direct[j] == 0.0;
        double all = 0.0, there = 0.0, explained = 0.0, rank = 0.0;

        apc_whiten(of->u + j * n, n, a, (size_t)order, u);
        for (size_t k = LAGS; k < n; k++) {
            const bool use = isfinite(w[k]) && isfinite(u[k - LAGS + 1 - first]);

            Q[k - LAGS] = use;
            for (size_t lag = 0; lag < LAGS; lag++)
                Q[(1 + lag) * rows + k - LAGS] = use ? u[k - lag - first] : 0.0;
            Q[(1 + LAGS) * rows + k - LAGS] = use ? w[k] : 0.0;
            there += use;
        }
        apc_qr_extend(rows, 0, LAGS + 2, Q, R, LAGS + 2);
        for (size_t i = 1; i < LAGS + 2; i++) {
            const double part = R[i * (LAGS + 2) + LAGS + 1];

            all += part * part;
            explained += i <= LAGS ? part * part : 0.0;
            rank += i <= LAGS && R[i * (LAGS + 2) + i] > 0.0;
        }
        if (all > 0.0 && rank > 0.0)
            *least = fmin(*least, (double)of->inputs * apc_chi2_above(there * explained / all, rank));
    }
    free(Q);
    return 0;
}

/* Of each run the share from @p from on. */
static void align_output(const struct apc_record *r, const double *ahead, size_t i, size_t from,
                         struct aligned_output *to)
{
    size_t at = 0;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const struct apc_record run = apc_record_run(r, g);
        const size_t end = apc_record_end(r, g), begin = end - run.n + apc_record_share(r, &run, from);

        for (size_t k = begin; k < end + (g + 1 < apc_record_runs(r) ? LAGS : 0); k++, at++) {
            to->e[at] = k < end ? ahead[k * r->ny + i] : (double)NAN;
            for (size_t j = 0; j < to->inputs; j++)
                to->u[j * to->n + at] = k < end ? r->u[k * to->inputs + j] : (double)NAN;
        }
    }
}

static int score_record(const struct apc_linear *m, const struct apc_record *r, size_t from,
                        const struct score *score, const double *ahead, bool filtered,
                        struct apc_validation *of)
{
    struct aligned_output all = {.inputs = r->nu + r->nd};
    int rc = 0;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const struct apc_record run = apc_record_run(r, g);

        all.n += run.n - apc_record_share(r, &run, from) + (g > 0 ? LAGS : 0);
    }
    all.e = calloc(all.n * (1 + all.inputs) + 1, sizeof(*all.e));
    if (!all.e)
        return APC_ENOMEM;
    all.u = all.e + all.n;
    for (size_t i = 0; i < r->ny && rc == 0; i++) {
        const struct score *s = &score[i];
        double independent = 1.0;

        all.direct = m->D + i * all.inputs;
        align_output(r, ahead, i, from, &all);
        rc = independent_of(&all, &independent);
        of[i] =
            (struct apc_validation){.fit = 100.0 * (1.0 - sqrt(s->free / s->all)),
                                    .ahead = filtered ? 100.0 * (1.0 - sqrt(s->ahead / s->all)) : (double)NAN,
                                    .white = apc_white_probability(all.e, all.n),
                                    .independent = independent};
    }
    free(all.e);
    return rc;
}

static int check_validation(const struct apc_linear *m, const struct apc_record *r, size_t from,
                            struct apc_error *why)
{
    if (m->ny != r->ny || m->nu != r->nu || m->nd != r->nd)
        return apc_fail(why, APC_EINVAL,
                        "validate: the model has %zu inputs, %zu disturbances and %zu outputs, the record "
                        "%zu, %zu and %zu",
                        m->nu, m->nd, m->ny, r->nu, r->nd, r->ny);
    if (fabs(m->Ts - r->Ts) > 1e-6 * r->Ts)
        return apc_fail(why, APC_EINVAL, "validate: the model has a period of %g s, the record one of %g s",
                        m->Ts, r->Ts);
    for (size_t i = 0; i < r->ny; i++) {
        size_t there = 0;

        for (size_t g = 0; g < apc_record_runs(r); g++) {
            const struct apc_record run = apc_record_run(r, g);

            for (size_t k = apc_record_share(r, &run, from); k < run.n; k++)
                there += isfinite(run.y[k * r->ny + i]) != 0;
        }
        if (there < VALIDATE_LEAST)
            return apc_fail(why, APC_EINVAL,
                            "validate: %zu samples of output %zu to validate on; %d are the least", there,
                            i + 1, VALIDATE_LEAST);
    }
    return 0;
}

/* Of one run. e, ahead [n * ny]; x [nx] */
static int validate_run(struct run *run, size_t from, double *x, double *e, double *ahead,
                        struct score *score)
{
    const int rc = initial_state_of(run, from, x);

    if (rc < 0)
        return rc;
    if (run->K)
        errors(run, x, from, true, ahead);
    errors(run, x, from, false, e);
    if (!run->K)
        memcpy(ahead, e, run->r->n * run->r->ny * sizeof(*e));
    add_scores(run, e, ahead, from, score);
    return 0;
}

int apc_validate(const struct apc_linear *model, const double *K, const struct apc_record *record,
                 size_t from, struct apc_validation *of, double *free_run, struct apc_error *why)
{
    struct apc_record r = {0};
    struct run run = {.model = model, .K = K, .r = &r};
    struct score *score = NULL;
    double *memory = NULL, *e, *ahead, *x;
    int rc = apc_options_copy(&r, sizeof(r), record, "apc_record", why);

    if (rc == 0)
        rc = check_validation(model, &r, from, why);
    if (rc < 0)
        return rc;
    memory = calloc(2 * r.n * r.ny + model->nx + 1, sizeof(*memory));
    score = calloc(r.ny + 1, sizeof(*score));
    rc = memory && score ? open_run(&run) : APC_ENOMEM;
    if (rc < 0)
        goto out;
    e = memory;
    ahead = e + r.n * r.ny;
    x = ahead + r.n * r.ny;
    for (size_t g = 0; g < apc_record_runs(&r) && rc == 0; g++) {
        const struct apc_record one = apc_record_run(&r, g);
        const size_t begin = (apc_record_end(&r, g) - one.n) * r.ny, share = apc_record_share(&r, &one, from);

        run.r = &one;
        rc = validate_run(&run, share, x, e + begin, ahead + begin, score);
        for (size_t i = 0; i < one.n * r.ny && free_run && rc == 0; i++)
            free_run[begin + i] = i / r.ny < share ? (double)NAN : one.y[i] - e[begin + i];
    }
    if (rc == 0)
        rc = score_record(model, &r, from, score, ahead, K != NULL, of);
out:
    if (rc < 0)
        apc_fail(why, rc, "validate: no memory");
    free(run.x);
    free(score);
    free(memory);
    return rc;
}
