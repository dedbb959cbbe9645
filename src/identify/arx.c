/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Difference equations. One pass over the record gives the triangle R of all lags that there may be; each
 * structure is then a choice of R's columns, so that hundreds of them cost no more than a few passes.
 */
#include "identify/identify_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"

#define NA_MOST  8
#define FIR_MOST 100
#define BETTER   0.99 /* of the misfit of fewer coefficients is what more of them must reach */
#define PERFECT  1e-6 /* a misfit below which more coefficients only follow the rounding */

/* Columns: lags 1..na of each y, lags 0..lags-1 of each u, 1 in each run, and y itself. */
struct arx {
    struct apc_record r;
    size_t inputs, runs, na, lags, width;
    size_t first; /* delay that there may be */
    struct apc_triangle triangle;
    double *row;
    /* A structure, and its coefficients. */
    size_t p_na, p_nb, *delay, n_columns; /* delay [ny * inputs]: each y has its own */
    double *Q, *R;                        /* [width * width] */
    double *theta, *left; /* [ny * width] coefficients: lags of y, of u, of runs; errors, among R's rows */
};

static size_t y_column(const struct arx *a, size_t i, size_t lag)
{
    return i * a->na + lag - 1;
}

static size_t u_column(const struct arx *a, size_t j, size_t lag)
{
    return a->r.ny * a->na + j * a->lags + lag;
}

static size_t first_target(const struct arx *a)
{
    return a->width - a->r.ny;
}

static size_t run_column(const struct arx *a, size_t run)
{
    return first_target(a) - a->runs + run;
}

/* Row of sample @p k of a run; false where something is missing. */
static bool fill_arx_row(struct arx *a, const struct apc_record *r, size_t run, size_t k)
{
    bool there = true;

    for (size_t i = 0; i < r->ny; i++) {
        for (size_t lag = 1; lag <= a->na; lag++)
            a->row[y_column(a, i, lag)] = r->y[(k - lag) * r->ny + i];
        a->row[first_target(a) + i] = r->y[k * r->ny + i];
    }
    for (size_t j = 0; j < a->inputs; j++) {
        for (size_t lag = 0; lag < a->lags; lag++)
            a->row[u_column(a, j, lag)] = r->u[(k - lag) * a->inputs + j];
    }
    for (size_t g = 0; g < a->runs; g++)
        a->row[run_column(a, g)] = g == run;
    for (size_t i = 0; i < a->width; i++)
        there &= isfinite(a->row[i]) != 0;
    return there;
}

/* R of the samples before @p until. */
static int gather_arx_rows(struct arx *a, size_t until, struct apc_error *why)
{
    const size_t past = a->na > a->lags - 1 ? a->na : a->lags - 1;

    apc_triangle_close(&a->triangle);
    if (apc_triangle_open(&a->triangle, a->width) < 0)
        return APC_ENOMEM;
    for (size_t g = 0; g < a->runs; g++) {
        const struct apc_record run = apc_record_run(&a->r, g);
        const size_t end = apc_record_share(&a->r, &run, until);

        for (size_t k = past; k < end; k++) {
            if (fill_arx_row(a, &run, g, k))
                apc_triangle_add(&a->triangle, a->row);
        }
    }
    apc_triangle_end(&a->triangle);
    if (a->triangle.n < a->width)
        return apc_fail(why, APC_EINVAL, "arx: only %zu stretches of %zu samples have no gap: %zu are needed",
                        a->triangle.n, past + 1, a->width);
    return 0;
}

static void take_arx_column(const struct arx *a, size_t from, size_t to)
{
    for (size_t row = 0; row < a->width; row++)
        a->Q[to * a->width + row] = a->triangle.R[row * a->width + from];
}

/* Least squares of output @p i in the structure that p_na, p_nb and delay say. Returns the sum of squares
 * that is left. */
static double solve_arx_output(struct arx *a, size_t i)
{
    const size_t width = a->width;
    double *target = a->left + i * width, *b = a->row;
    size_t n = 0;

    for (size_t o = 0; o < a->r.ny; o++) {
        for (size_t lag = 1; lag <= a->p_na; lag++)
            take_arx_column(a, y_column(a, o, lag), n++);
    }
    for (size_t j = 0; j < a->inputs; j++) {
        for (size_t lag = 0; lag < a->p_nb; lag++)
            take_arx_column(a, u_column(a, j, a->delay[i * a->inputs + j] + lag), n++);
    }
    for (size_t g = 0; g < a->runs; g++)
        take_arx_column(a, run_column(a, g), n++);
    a->n_columns = n;
    for (size_t row = 0; row < width; row++)
        target[row] = a->triangle.R[row * width + first_target(a) + i];
    apc_qr_extend(width, 0, n, a->Q, a->R, width);
    for (size_t c = 0; c < n; c++) {
        b[c] = apc_column_dot(a->Q + c * width, target, width);
        for (size_t row = 0; row < width; row++)
            target[row] -= b[c] * a->Q[c * width + row];
    }
    apc_qr_solve(n, a->R, width, b, a->theta + i * width);
    return apc_column_dot(target, target, width);
}

/* ---- The model ------------------------------------------------------------------------------------ */

static double a_of(const struct arx *a, size_t i, size_t of, size_t lag)
{
    return lag >= 1 && lag <= a->p_na ? a->theta[i * a->width + of * a->p_na + lag - 1] : 0.0;
}

static double b_of(const struct arx *a, size_t i, size_t j, size_t lag)
{
    const size_t first = a->delay[i * a->inputs + j];

    return lag >= first && lag < first + a->p_nb
               ? a->theta[i * a->width + a->r.ny * a->p_na + j * a->p_nb + lag - first]
               : 0.0;
}

/* The lags at which input @p j may act on any output: from, until. */
static size_t first_lag(const struct arx *a, size_t j)
{
    size_t first = a->lags;

    for (size_t i = 0; i < a->r.ny; i++)
        first = a->delay[i * a->inputs + j] < first ? a->delay[i * a->inputs + j] : first;
    return first;
}

static size_t last_lag(const struct arx *a, size_t j)
{
    size_t last = 0;

    for (size_t i = 0; i < a->r.ny; i++)
        last = a->delay[i * a->inputs + j] > last ? a->delay[i * a->inputs + j] : last;
    return last + a->p_nb - 1;
}

/* For how long an input is held back: so that at most its first lag is missing, or, in an fir, all. */
static size_t hold_of(const struct arx *a, size_t j)
{
    const size_t first = first_lag(a, j);

    return a->p_na == 0 ? last_lag(a, j) : first - (first > 0);
}

/*
 * Of a run u0 the mean of the inputs; y0 where the equation then stands still: (I - sum A) y0 = sum B u0 + c.
 * Where that is no point, or none that was on record, the plant integrates: y0 is then the mean, u0 the
 * nearest that holds it.
 */
static int place_run_at_rest(const struct arx *a, size_t g, double *u0, double *y0)
{
    const struct apc_record r = apc_record_run(&a->r, g);
    const size_t ny = r.ny, inputs = a->inputs;
    double *I_A, *B, *rhs, *mean; /* column i of B is output i's */
    const struct apc_part parts[] = {APC_PART(I_A, ny * ny), APC_PART(B, ny * inputs), APC_PART(rhs, ny),
                                     APC_PART(mean, ny)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    bool far = false;

    if (!memory)
        return APC_ENOMEM;
    for (size_t k = 0; k < r.n; k++) {
        for (size_t j = 0; j < inputs; j++)
            u0[j] += r.u[k * inputs + j] / (double)r.n;
    }
    for (size_t i = 0; i < ny; i++) {
        double n = 0.0;

        for (size_t k = 0; k < r.n; k++) {
            const double y = r.y[k * ny + i];

            if (!isfinite(y))
                continue;
            mean[i] += y;
            n += 1.0;
        }
        mean[i] /= fmax(n, 1.0);
        rhs[i] = a->theta[i * a->width + a->n_columns - a->runs + g];
        for (size_t o = 0; o < ny; o++) {
            I_A[i * ny + o] = i == o;
            for (size_t lag = 1; lag <= a->p_na; lag++)
                I_A[i * ny + o] -= a_of(a, i, o, lag);
        }
        for (size_t j = 0; j < inputs; j++) {
            for (size_t lag = first_lag(a, j); lag <= last_lag(a, j); lag++)
                B[i * inputs + j] += b_of(a, i, j, lag);
            y0[i] += B[i * inputs + j] * u0[j];
        }
        y0[i] += rhs[i];
    }
    /* What c asks of u where y is at its mean, for the case that it integrates. */
    for (size_t i = 0; i < ny; i++) {
        for (size_t o = 0; o < ny; o++)
            rhs[i] -= I_A[i * ny + o] * mean[o];
        for (size_t j = 0; j < inputs; j++)
            rhs[i] += B[i * inputs + j] * u0[j];
        rhs[i] = -rhs[i];
    }
    far = apc_matrix_solve(ny, 1, I_A, y0) != 0;
    for (size_t i = 0; i < ny && !far; i++)
        far = !apc_record_near(&a->r, g, a->r.y + i, ny, y0[i]);
    if (far) {
        apc_qr_extend(inputs, 0, ny, B, I_A, ny);
        apc_qr_variance(ny, I_A, ny, rhs);
        for (size_t i = 0; i < ny; i++) {
            y0[i] = mean[i];
            for (size_t j = 0; j < inputs; j++)
                u0[j] += B[i * inputs + j] * rhs[i];
        }
    }
    free(memory);
    return 0;
}

/* The observer's form: x_m[k+1] = x_(m+1) + A_m y + B_m v, y = x_1 + B_0 v, v the inputs held back so long
 * that at most the first lag is missing; an fir is held inputs and nothing else. */
static int build(const struct arx *a, struct apc_identified **model, struct apc_error *why)
{
    const size_t ny = a->r.ny, inputs = a->inputs;
    size_t blocks = a->p_na, held = 0, at;
    struct apc_linear *m;
    int rc;

    for (size_t j = 0; j < inputs; j++) {
        const size_t hold = hold_of(a, j);

        held += hold;
        if (last_lag(a, j) - hold > blocks)
            blocks = last_lag(a, j) - hold;
    }
    rc = apc_identified_create(model, &a->r, ny * blocks + held, why);
    if (rc < 0)
        return rc;
    m = (*model)->linear;
    m->nx_plant = at = ny * blocks;
    m->nx_held = held;
    for (size_t i = 0; i < ny; i++) {
        for (size_t block = 1; block <= blocks; block++) {
            const size_t row = (block - 1) * ny + i;

            for (size_t o = 0; o < ny; o++)
                m->A[row * m->nx + o] = (*model)->K[row * ny + o] = a_of(a, i, o, block);
            if (block < blocks)
                m->A[row * m->nx + row + ny] += 1.0;
        }
        if (blocks > 0)
            m->C[i * m->nx + i] = 1.0;
    }
    for (size_t j = 0; j < inputs; j++) {
        const size_t hold = hold_of(a, j);
        double *into = hold ? m->A + at + hold - 1 : m->B + j;
        const size_t stride = hold ? m->nx : inputs;

        for (size_t i = 0; i < ny; i++) {
            for (size_t block = 1; block <= blocks; block++)
                into[((block - 1) * ny + i) * stride] += b_of(a, i, j, hold + block);
            m->D[i * inputs + j] = b_of(a, i, j, 0);
            for (size_t ago = 1; ago <= hold && blocks == 0; ago++)
                m->C[i * m->nx + at + ago - 1] = b_of(a, i, j, ago);
        }
        for (size_t i = 0; i < ny * blocks; i++) { /* what acts at once is in y, and y goes on */
            for (size_t o = 0; o < ny; o++)
                m->B[i * inputs + j] += (*model)->K[i * ny + o] * m->D[o * inputs + j];
        }
        for (size_t ago = 0; ago < hold; ago++)
            *(ago ? &m->A[(at + ago) * m->nx + at + ago - 1] : &m->B[at * inputs + j]) = 1.0;
        at += hold;
    }
    memcpy((*model)->delay, a->delay, ny * inputs * sizeof(*a->delay));
    (*model)->na = a->p_na;
    (*model)->nb = a->p_nb;
    for (size_t g = 0; g < a->runs && rc == 0; g++)
        rc = place_run_at_rest(a, g, (*model)->u0 + g * inputs, (*model)->y0 + g * ny);
    if (rc < 0) {
        apc_identified_destroy(*model);
        *model = NULL;
        return apc_fail(why, rc, "apc_identify_arx: no memory");
    }
    memcpy(m->u0, (*model)->u0, inputs * sizeof(*m->u0));
    memcpy(m->y0, (*model)->y0, ny * sizeof(*m->y0));
    for (size_t j = 0, x = m->nx_plant; j < inputs; j++) {
        const size_t hold = hold_of(a, j);

        for (size_t ago = 0; ago < hold; ago++)
            m->x0[x++] = m->u0[j];
    }
    return 0;
}

/* Of the errors a sample ahead. */
static void arx_error_covariance(const struct arx *a, double *covariance)
{
    const size_t ny = a->r.ny, width = a->width;
    const double n = fmax((double)a->triangle.n - (double)a->n_columns, 1.0);

    for (size_t i = 0; i < ny; i++) {
        for (size_t o = 0; o < ny; o++)
            covariance[i * ny + o] = apc_column_dot(a->left + i * width, a->left + o * width, width) / n;
    }
}

/* ---- Structure ------------------------------------------------------------------------------------- */

static void find_delay(struct arx *a, size_t i, size_t j, size_t most)
{
    size_t *delay = &a->delay[i * a->inputs + j], found = a->first;
    double best = HUGE_VAL;

    for (*delay = a->first; *delay <= most && *delay + a->p_nb <= a->lags; ++*delay) {
        const double left = solve_arx_output(a, i);

        if (left < best) {
            best = left;
            found = *delay;
        }
    }
    *delay = found;
}

/* One by one; where there are several inputs, once more. */
static void find_delays(struct arx *a, size_t most)
{
    for (size_t round = 0; round < (a->inputs > 1 ? 2 : 1); round++) {
        for (size_t i = 0; i < a->r.ny; i++) {
            for (size_t j = 0; j < a->inputs; j++)
                find_delay(a, i, j, most);
        }
    }
}

/* How badly it goes with what it was not fitted to. */
static double misfit(struct arx *a, size_t from, struct apc_error *why)
{
    struct apc_identified *model;
    double found;

    for (size_t i = 0; i < a->r.ny; i++)
        solve_arx_output(a, i);
    if (build(a, &model, why) < 0)
        return -1.0;
    found = apc_identified_misfit(model, &a->r, from);
    apc_identified_destroy(model);
    return found;
}

static int find_structure(struct arx *a, const struct apc_identify_arx_options *o, struct apc_error *why)
{
    const size_t from = a->r.n * 2 / 3, na_low = o->fir || o->na ? o->na : 1, na_high = o->fir ? 0 : a->na;
    const size_t nb_step = o->fir ? 5 : 1, nb_most = a->lags - o->delay_max, nb_low = o->nb ? o->nb : nb_step;
    double best = HUGE_VAL;
    size_t na = na_low, nb = nb_low;
    int rc = gather_arx_rows(a, from, why);

    a->p_na = na_low > 2 || o->na ? na_low : na_high < 2 ? na_high : 2;
    a->p_nb = o->nb ? o->nb : nb_most < 2 ? nb_most : 2;
    if (rc == 0 && o->delay_max > 0)
        find_delays(a, o->delay_max);
    for (size_t p = na_low; p <= na_high && rc == 0; p++) {
        for (size_t q = nb_low; q <= (o->nb ? o->nb : nb_most) && rc == 0; q += nb_step) {
            a->p_na = p;
            a->p_nb = q;
            const double found = misfit(a, from, why);

            rc = found < 0.0 ? APC_ENOMEM : 0;
            if (found < best * (p + q > na + nb ? BETTER : 1.0) && best > PERFECT) {
                best = found;
                na = p;
                nb = q;
            }
        }
    }
    a->p_na = na;
    a->p_nb = nb;
    if (rc == 0 && o->delay_max > 0)
        find_delays(a, o->delay_max);
    return rc;
}

/* Lags, where each takes @p of samples: they must fit in every run as well. */
static size_t afforded(const struct apc_record *r, size_t of)
{
    const size_t fit = apc_record_shortest(r) / 4;

    return r->n / of < fit ? r->n / of : fit;
}

static int take_arx_options(struct apc_identify_arx_options *o, const struct apc_record *r,
                            const struct apc_identify_arx_options *options, struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd, afford = afforded(r, 4 * (inputs + r->ny));
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_identify_arx_options", why);

    if (rc < 0)
        return rc;
    if (o->delay_max == 0 && !o->fir)
        o->delay_max = afford < 20 ? afford : 20;
    if (o->delay_max == 0 && !o->direct)
        o->delay_max = 1;
    if ((o->fir && o->na) || o->na > 50 || o->nb > 1000 || o->delay_max > 1000 ||
        o->na + o->nb + o->delay_max > apc_record_shortest(r) / 3)
        return apc_fail(
            why, APC_EINVAL,
            "apc_identify_arx: orders and delays together must be no more than a third of the %zu "
            "samples of a run, an fir has no na",
            apc_record_shortest(r));
    return 0;
}

static int open_arx(struct arx *a, const struct apc_identify_arx_options *o)
{
    const size_t afford = afforded(&a->r, 6 * (a->inputs + a->r.ny) + 1), least = o->fir ? FIR_MOST : NA_MOST;
    const size_t most = afford < 1 ? 1 : afford < least ? afford : least;

    a->na = o->fir ? 0 : o->na ? o->na : most;
    a->lags = o->delay_max + (o->nb ? o->nb : most);
    if (o->fir && a->lags < 6)
        a->lags = 6;
    a->runs = apc_record_runs(&a->r);
    a->width = a->r.ny * (a->na + 1) + a->inputs * a->lags + a->runs;
    a->delay = calloc(a->r.ny * a->inputs + 1, sizeof(*a->delay));
    a->row = calloc(a->width * (1 + 2 * a->width + 2 * a->r.ny), sizeof(*a->row));
    a->Q = a->row + a->width;
    a->R = a->Q + a->width * a->width;
    a->theta = a->R + a->width * a->width;
    a->left = a->theta + a->r.ny * a->width;
    a->first = o->direct ? 0 : 1;
    for (size_t i = 0; a->delay && i < a->r.ny * a->inputs; i++)
        a->delay[i] = a->first;
    return a->delay && a->row ? 0 : APC_ENOMEM;
}

int apc_identify_arx(struct apc_identified **model, const struct apc_record *record,
                     const struct apc_identify_arx_options *options, struct apc_error *why)
{
    struct apc_identify_arx_options o = {0};
    struct arx a = {0};
    int rc = apc_record_check(record, why);

    *model = NULL;
    if (rc == 0)
        rc = apc_options_copy(&a.r, sizeof(a.r), record, "apc_record", why);
    if (rc == 0)
        rc = take_arx_options(&o, &a.r, options, why);
    if (rc < 0)
        return rc;
    a.inputs = a.r.nu + a.r.nd;
    rc = open_arx(&a, &o);
    if (rc == 0)
        rc = find_structure(&a, &o, why);
    if (rc == 0)
        rc = gather_arx_rows(&a, a.r.n, why);
    if (rc == APC_ENOMEM)
        apc_fail(why, rc, "apc_identify_arx: no memory");
    if (rc == 0) {
        for (size_t i = 0; i < a.r.ny; i++)
            solve_arx_output(&a, i);
        rc = build(&a, model, why);
        if (rc == 0)
            arx_error_covariance(&a, (*model)->covariance);
        if (rc == 0)
            rc = apc_record_check_point(&a.r, (*model)->u0, (*model)->y0, why);
        if (rc == APC_ESOLVER) {
            apc_identified_destroy(*model);
            *model = NULL;
        }
    }
    apc_triangle_close(&a.triangle);
    free(a.delay);
    free(a.row);
    return rc;
}
