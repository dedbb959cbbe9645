/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Of interval i, from node x_i with u: F_i, and by central differences of the integrator itself A_i, B_i.
 * With what node i moves by, dx_i = e_i + S_i (u - plan), and the gap c_i = F_i - x_i+1,
 *
 *     e_i+1 = A_i e_i + c_i,    S_i+1 = A_i S_i + B_i in the columns of the interval's block.
 *
 * A delay of m periods and a bit r makes an input act m intervals later; in the first r of an interval the
 * one before it still does. So an interval has parts, as many as there are different r, and an input two
 * columns of B: of the newer and of the older one.
 */
#include "predict/shooting.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"
#include "plant/plant_internal.h"
#include "predict/predict_internal.h"

struct apc_shooting {
    const struct apc_model *model;
    struct apc_reduced reduced;
    struct apc_nested *nested;
    size_t nx, nu, ny, N, blocks, n, n_unknown;
    double Ts;
    unsigned steps;
    size_t *block_of; /* [N] the block that interval i is in */
    struct apc_linear_unknown *unknown;
    size_t *whole;        /* [nu] periods of its delay */
    double *bit, *begins; /* [nu] the rest of it; [parts + 1] of an interval, the last one its end */
    size_t parts;

    double *memory;
    double *p, *nominal, *u0;     /* [np], [nu + nd], [nu] */
    double *input, *moved;        /* [nu + nd]; [nu] */
    double *newer, *older;        /* [nu] of the interval */
    double *slope, *at, *sum, *x; /* [nx] */
    double *up, *down;            /* [nx]; also y [ny] */
    double *A, *B, *C, *D;        /* [nx * nx], [nx * 2 nu], [ny * nx], [ny * nu] of an interval */
    double *e, *S;                /* [N * nx], [N * nx * n] */
    double *plan, *away;          /* [n] of the last linearisation; from u0 */
    double *bent, *above, *from;  /* [n] moves, [n] sums, [nx], to see how a sum bends */
    double *slopes, *product; /* [(nx + ny) * (nx + nu + nd)], [nx * (nx + 2 nu)] where it derives itself */
};

static int allocate_shooting(struct apc_shooting *s, const struct apc_shooting_options *o)
{
    const size_t nx = s->nx, nu = s->nu, ny = s->ny, n = s->n, all = nu + o->model->nd,
                 own = apc_fmu_shown(o->model) ? nx : 0;
    const struct apc_part parts[] = {APC_PART(s->block_of, s->N),
                                     APC_PART(s->whole, nu),
                                     APC_PART(s->unknown, o->n_unknown),
                                     APC_PART(s->p, o->model->np),
                                     APC_PART(s->bit, nu),
                                     APC_PART(s->begins, nu + 2),
                                     APC_PART(s->newer, nu),
                                     APC_PART(s->older, nu),
                                     APC_PART(s->nominal, all),
                                     APC_PART(s->input, all),
                                     APC_PART(s->u0, nu),
                                     APC_PART(s->moved, nu),
                                     APC_PART(s->slope, nx),
                                     APC_PART(s->at, nx),
                                     APC_PART(s->sum, nx),
                                     APC_PART(s->x, nx),
                                     APC_PART(s->up, nx + ny),
                                     APC_PART(s->down, nx + ny),
                                     APC_PART(s->A, nx * nx),
                                     APC_PART(s->B, nx * 2 * nu),
                                     APC_PART(s->C, ny * nx),
                                     APC_PART(s->D, ny * nu),
                                     APC_PART(s->e, s->N * nx),
                                     APC_PART(s->S, s->N * nx * n),
                                     APC_PART(s->plan, n),
                                     APC_PART(s->away, n),
                                     APC_PART(s->bent, n),
                                     APC_PART(s->above, n),
                                     APC_PART(s->from, nx),
                                     APC_PART(s->product, own * (nx + 2 * nu)),
                                     APC_PART(s->slopes, (own + ny) * (nx + all))};

    s->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return s->memory ? 0 : APC_ENOMEM;
}

/* Delays, and the parts of an interval that they make. */
static void delay(struct apc_shooting *s, const double *by)
{
    s->begins[s->parts++] = 0.0;
    for (size_t j = 0; j < s->nu; j++) {
        size_t at = s->parts;

        s->whole[j] = apc_linear_whole(by ? by[j] : 0.0, s->Ts, &s->bit[j]);
        while (at > 0 && s->begins[at - 1] > s->bit[j])
            at--;
        if (s->begins[at - 1] == s->bit[j])
            continue;
        memmove(s->begins + at + 1, s->begins + at, (s->parts++ - at) * sizeof(*s->begins));
        s->begins[at] = s->bit[j];
    }
    s->begins[s->parts] = s->Ts;
}

int apc_shooting_create(struct apc_shooting **shoot, const struct apc_shooting_options *o,
                        struct apc_error *why)
{
    const struct apc_model *m = o->model;
    struct apc_shooting *s = calloc(1, sizeof(*s));
    int rc;

    *shoot = NULL;
    if (!s)
        return apc_fail(why, APC_ENOMEM, "shooting: no memory");
    *s = (struct apc_shooting){.model = m,
                               .nested = o->nested,
                               .nx = o->nested ? apc_nested_states(o->nested) : m->nx,
                               .nu = m->nu,
                               .ny = m->ny,
                               .N = o->horizon,
                               .blocks = o->blocks,
                               .n = m->nu * o->blocks,
                               .n_unknown = o->n_unknown,
                               .Ts = o->Ts,
                               .steps = o->steps};
    rc = allocate_shooting(s, o) < 0 ? apc_fail(why, APC_ENOMEM, "shooting: no memory")
                                     : apc_model_take(m, s->p, o->p, m->param, m->np, "parameter", why);
    if (rc == 0)
        rc = apc_reduced_open(&s->reduced, m, s->p, why);
    if (rc < 0) {
        apc_shooting_destroy(s);
        return rc;
    }
    apc_param_initials(m->input, m->nu, s->nominal);
    apc_param_initials(m->disturbance, m->nd, s->nominal + m->nu);
    memcpy(s->u0, o->u0, m->nu * sizeof(*s->u0));
    for (size_t i = 0; i < o->n_unknown; i++)
        s->unknown[i] = o->unknown[i];
    for (size_t i = 0, b = 0, left = o->block[0]; i < s->N; i++, left--) {
        if (left == 0 && b + 1 < s->blocks)
            left = o->block[++b];
        s->block_of[i] = b;
    }
    delay(s, o->delay);
    *shoot = s;
    return 0;
}

void apc_shooting_destroy(struct apc_shooting *shoot)
{
    if (!shoot)
        return;
    apc_reduced_close(&shoot->reduced);
    free(shoot->memory);
    free(shoot);
}

/* ---- The model ---------------------------------------------------------------------------------- */

static void disturb(struct apc_shooting *s, const double *u, const double *d)
{
    memcpy(s->input, s->nominal, (s->nu + s->model->nd) * sizeof(*s->input));
    memcpy(s->input, u, s->nu * sizeof(*u));
    for (size_t k = 0; k < s->n_unknown; k++) {
        if (s->unknown[k].where == APC_AT_INPUT)
            s->input[s->unknown[k].number] += d[k];
    }
}

/* x on by t in so many steps, with s->input. */
static int integrate_interval(struct apc_shooting *s, double *x, double t)
{
    static const double reach[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
    const double h = t / s->steps;

    for (unsigned step = 0; step < s->steps; step++) {
        memset(s->sum, 0, s->nx * sizeof(*s->sum));
        for (int k = 0; k < 4; k++) {
            for (size_t i = 0; i < s->nx; i++)
                s->at[i] = x[i] + (k ? reach[k] * h * s->slope[i] : 0.0);
            if ((s->nested ? apc_nested_slope(s->nested, s->at, s->input, s->slope)
                           : apc_reduced_f(&s->reduced, s->at, s->input, s->slope)) != 0)
                return APC_ESOLVER;
            for (size_t i = 0; i < s->nx; i++)
                s->sum[i] += weight[k] * s->slope[i];
        }
        for (size_t i = 0; i < s->nx; i++)
            x[i] += h / 6.0 * s->sum[i];
    }
    return apc_values_ok(x, s->nx) ? 0 : APC_ESOLVER;
}

bool apc_shooting_holds(const struct apc_shooting *s, const double *x)
{
    const struct apc_param *range = s->model->state;
    size_t i = 0;

    while (range && i < s->model->nx && x[i] >= range[i].low && x[i] <= range[i].high)
        i++;
    return !range || i == s->model->nx;
}

void apc_shooting_measure(struct apc_shooting *s, const double *own)
{
    memcpy(s->nominal + s->nu, own, s->model->nd * sizeof(*own));
}

int apc_shooting_advance(struct apc_shooting *s, double *x, const double *u, const double *d, double t)
{
    int rc;

    memcpy(s->x, x, s->nx * sizeof(*x));
    disturb(s, u, d);
    rc = integrate_interval(s, s->x, t);
    if (rc == 0)
        memcpy(x, s->x, s->nx * sizeof(*x));
    return rc;
}

const char *apc_shooting_error(const struct apc_shooting *s)
{
    return s->nested ? apc_nested_error(s->nested) : apc_reduced_error(&s->reduced);
}

/* ---- Derivatives -------------------------------------------------------------------------------- */

/* A step for central differences: about the cube root of the rounding error. */
static double small(double value)
{
    return 6e-6 * fmax(fabs(value), 1e-3);
}

/* The end of an interval from x, with number k moved by so much: of x, then of newer, then of older inputs. */
static int interval_end(struct apc_shooting *s, const double *x, const double *d, size_t k, double by,
                        double *to)
{
    int rc = 0;

    memcpy(to, x, s->nx * sizeof(*x));
    if (k < s->nx)
        to[k] += by;
    for (size_t part = 0; part < s->parts && rc == 0; part++) {
        for (size_t j = 0; j < s->nu; j++) {
            const bool newer = s->bit[j] <= s->begins[part];

            s->moved[j] = newer ? s->newer[j] : s->older[j];
            if (k == s->nx + j + (newer ? 0 : s->nu))
                s->moved[j] += by;
        }
        disturb(s, s->moved, d);
        rc = integrate_interval(s, to, s->begins[part + 1] - s->begins[part]);
    }
    return rc;
}

/* Nothing is moved. */
static int end_as_is(struct apc_shooting *s, const double *x, const double *d)
{
    return interval_end(s, x, d, s->nx + 2 * s->nu, 0.0, s->x);
}

/* The end of an interval from x, A and B, of a model that derives itself: those of its parts, one after the
 * other. */
static int derive_interval(struct apc_shooting *s, const double *x, const double *d)
{
    const size_t nx = s->nx, nu = s->nu, all = nx + nu + s->model->nd;

    memcpy(s->x, x, nx * sizeof(*x));
    memset(s->B, 0, nx * 2 * nu * sizeof(*s->B));
    memset(s->A, 0, nx * nx * sizeof(*s->A));
    for (size_t i = 0; i < nx; i++)
        s->A[i * nx + i] = 1.0;
    for (size_t part = 0; part < s->parts; part++) {
        double *B = s->product + nx * nx;

        for (size_t j = 0; j < nu; j++)
            s->moved[j] = s->bit[j] <= s->begins[part] ? s->newer[j] : s->older[j];
        disturb(s, s->moved, d);
        if (apc_reduced_interval(&s->reduced, s->x, s->input, s->begins[part + 1] - s->begins[part], s->steps,
                                 s->slopes) < 0)
            return APC_ESOLVER;
        memset(s->product, 0, nx * (nx + 2 * nu) * sizeof(*s->product));
        for (size_t i = 0; i < nx; i++) {
            const double *row = s->slopes + i * all;

            for (size_t k = 0; k < nx; k++) {
                for (size_t c = 0; c < nx; c++)
                    s->product[i * nx + c] += row[k] * s->A[k * nx + c];
                for (size_t c = 0; c < 2 * nu; c++)
                    B[i * 2 * nu + c] += row[k] * s->B[k * 2 * nu + c];
            }
            for (size_t j = 0; j < nu; j++)
                B[i * 2 * nu + j + (s->bit[j] <= s->begins[part] ? 0 : nu)] += row[nx + j];
        }
        memcpy(s->A, s->product, nx * nx * sizeof(*s->A));
        memcpy(s->B, B, nx * 2 * nu * sizeof(*s->B));
    }
    return apc_values_ok(s->x, nx) ? 0 : APC_ESOLVER;
}

/* The end of the interval from x, its A and B. */
static int linearize_interval(struct apc_shooting *s, const double *x, const double *d)
{
    const size_t nx = s->nx, nu = s->nu;

    if (apc_reduced_derives(&s->reduced) && !s->nested)
        return derive_interval(s, x, d);
    if (end_as_is(s, x, d) < 0)
        return APC_ESOLVER;
    for (size_t k = 0; k < nx + 2 * nu; k++) {
        const double by = small(k < nx ? x[k] : k < nx + nu ? s->newer[k - nx] : s->older[k - nx - nu]);
        double *column = k < nx ? s->A + k : s->B + (k - nx);
        const size_t stride = k < nx ? nx : 2 * nu;

        if (k >= nx + nu && s->bit[k - nx - nu] == 0.0)
            continue;
        if (interval_end(s, x, d, k, by, s->up) < 0 || interval_end(s, x, d, k, -by, s->down) < 0)
            return APC_ESOLVER;
        for (size_t r = 0; r < nx; r++)
            column[r * stride] = (s->up[r] - s->down[r]) / (2.0 * by);
    }
    return 0;
}

/* y at x, with unknown disturbances. */
static void predict_outputs(struct apc_shooting *s, const double *x, const double *u, const double *d,
                            double *y)
{
    disturb(s, u, d);
    if (s->nested)
        apc_nested_output(s->nested, x, s->input, y);
    else
        apc_reduced_g(&s->reduced, x, s->input, y);
    for (size_t k = 0; k < s->n_unknown; k++) {
        if (s->unknown[k].where == APC_AT_OUTPUT)
            y[s->unknown[k].number] += d[k];
    }
}

/* C and D at x, where all newer inputs act. */
static void linearize_outputs(struct apc_shooting *s, const double *x, const double *d)
{
    double *up = s->up + s->nx, *down = s->down + s->nx;
    const size_t nx = s->nx, all = nx + s->nu + s->model->nd;

    if (apc_reduced_derives(&s->reduced) && !s->nested) {
        disturb(s, s->newer, d);
        if (apc_reduced_slopes(&s->reduced, x, s->input, s->slopes) < 0)
            s->slopes[nx * all] = (double)NAN; /* which whoever uses it looks for */
        for (size_t c = 0; c < s->ny; c++) {
            memcpy(s->C + c * nx, s->slopes + (nx + c) * all, nx * sizeof(*s->C));
            memcpy(s->D + c * s->nu, s->slopes + (nx + c) * all + nx, s->nu * sizeof(*s->D));
        }
        return;
    }
    memcpy(s->at, x, s->nx * sizeof(*x));
    memcpy(s->moved, s->newer, s->nu * sizeof(*s->moved));
    for (size_t k = 0; k < s->nx + s->nu; k++) {
        double *at = k < s->nx ? s->at + k : s->moved + (k - s->nx);
        const double here = *at, by = small(here);

        *at = here + by;
        predict_outputs(s, s->at, s->moved, d, up);
        *at = here - by;
        predict_outputs(s, s->at, s->moved, d, down);
        *at = here;
        for (size_t c = 0; c < s->ny; c++)
            *(k < s->nx ? s->C + c * s->nx + k : s->D + c * s->nu + (k - s->nx)) =
                (up[c] - down[c]) / (2.0 * by);
    }
}

/* ---- The horizon -------------------------------------------------------------------------------- */

/* Input j of interval i, so many later: of the plan, or of those that went out before it. */
static double input_of(const struct apc_shooting *s, const double *plan, const double *past, size_t i,
                       size_t j, size_t later)
{
    return i >= later ? plan[s->block_of[i - later] * s->nu + j] : past[(later - i - 1) * s->nu + j];
}

/* The newer and older inputs of interval i. */
static void take_inputs(struct apc_shooting *s, const double *plan, const double *past, size_t i)
{
    for (size_t j = 0; j < s->nu; j++) {
        s->newer[j] = input_of(s, plan, past, i, j, s->whole[j]);
        s->older[j] = s->bit[j] > 0.0 ? input_of(s, plan, past, i, j, s->whole[j] + 1) : s->newer[j];
    }
}

/* What input j of interval i, so many later, does to row [n] of a sum of moves. */
static void add_move(const struct apc_shooting *s, size_t i, size_t j, size_t later, double by, double *row)
{
    if (i >= later)
        row[s->block_of[i - later] * s->nu + j] += by;
}

/* e and S of the end of interval i. */
static void carry_on(struct apc_shooting *s, size_t i, const double *node)
{
    const size_t nx = s->nx, nu = s->nu, n = s->n;
    double *e = s->e + i * nx, *S = s->S + i * nx * n;

    for (size_t r = 0; r < nx; r++) {
        e[r] = s->x[r] - node[r];
        if (i > 0)
            e[r] += apc_matrix_dot(s->A + r * nx, s->e + (i - 1) * nx, nx);
    }
    if (i > 0)
        apc_matrix_multiply(nx, nx, n, s->A, S - nx * n, S);
    else
        memset(S, 0, nx * n * sizeof(*S));
    for (size_t r = 0; r < nx; r++) {
        for (size_t j = 0; j < nu; j++) {
            add_move(s, i, j, s->whole[j], s->B[r * 2 * nu + j], S + r * n);
            if (s->bit[j] > 0.0)
                add_move(s, i, j, s->whole[j] + 1, s->B[r * 2 * nu + nu + j], S + r * n);
        }
    }
}

int apc_shooting_linearise(struct apc_shooting *s, const double *x, const double *d, const double *plan,
                           const double *past, const double *nodes, double *G, double *free_y)
{
    const size_t nx = s->nx, ny = s->ny, nu = s->nu, n = s->n;

    memcpy(s->plan, plan, n * sizeof(*plan));
    for (size_t b = 0; b < s->blocks; b++) {
        for (size_t j = 0; j < nu; j++)
            s->away[b * nu + j] = plan[b * nu + j] - s->u0[j];
    }
    for (size_t i = 0; i < s->N; i++) {
        const double *from = i ? nodes + (i - 1) * nx : x, *to = nodes + i * nx;
        double *y = free_y + i * ny;

        take_inputs(s, plan, past, i);
        if (linearize_interval(s, from, d) < 0)
            return APC_ESOLVER;
        carry_on(s, i, to);
        linearize_outputs(s, to, d);
        predict_outputs(s, to, s->newer, d, y);
        apc_matrix_multiply(ny, nx, n, s->C, s->S + i * nx * n, G + i * ny * n);
        for (size_t c = 0; c < ny; c++) {
            double *row = G + (i * ny + c) * n;

            for (size_t j = 0; j < nu; j++)
                add_move(s, i, j, s->whole[j], s->D[c * nu + j], row);
            y[c] += apc_matrix_dot(s->C + c * nx, s->e + i * nx, nx);
            y[c] -= apc_matrix_dot(row, s->away, n);
        }
    }
    return apc_values_ok(G, s->N * ny * n) && apc_values_ok(free_y, s->N * ny) ? 0 : APC_ESOLVER;
}

/* The sum of worth y, of a run from x with s->bent. APC_ESOLVER: it leads nowhere. */
static int run_worth(struct apc_shooting *s, const double *x, const double *d, const double *past,
                     const double *worth, double *sum)
{
    *sum = 0.0;
    memcpy(s->from, x, s->nx * sizeof(*x));
    for (size_t i = 0; i < s->N; i++) {
        double *y = s->up + s->nx;

        take_inputs(s, s->bent, past, i);
        if (end_as_is(s, s->from, d) < 0)
            return APC_ESOLVER;
        memcpy(s->from, s->x, s->nx * sizeof(*s->x));
        predict_outputs(s, s->x, s->newer, d, y);
        *sum += apc_matrix_dot(worth + i * s->ny, y, s->ny);
    }
    return isfinite(*sum) ? 0 : APC_ESOLVER;
}

int apc_shooting_bend(struct apc_shooting *s, const double *x, const double *d, const double *plan,
                      const double *past, const double *worth, const double *step, double *curve,
                      bool (*enough)(void *ctx), void *ctx)
{
    const size_t n = s->n;
    double here, below;
    int rc;

    memcpy(s->bent, plan, n * sizeof(*plan));
    rc = run_worth(s, x, d, past, worth, &here);
    for (size_t a = 0; a < n && rc == 0; a++) {
        const double h = step[a % s->nu];

        s->bent[a] = plan[a] - h;
        rc = run_worth(s, x, d, past, worth, &below);
        s->bent[a] = plan[a] + h;
        if (rc == 0)
            rc = run_worth(s, x, d, past, worth, &s->above[a]);
        curve[a * n + a] = (s->above[a] - 2.0 * here + below) / (h * h);
        for (size_t b = 0; b < a && rc == 0; b++) {
            double both = 0.0;

            s->bent[b] = plan[b] + step[b % s->nu];
            rc = enough(ctx) ? APC_ETIMEDOUT : run_worth(s, x, d, past, worth, &both);
            s->bent[b] = plan[b];
            curve[a * n + b] = (both - s->above[a] - s->above[b] + here) / (h * step[b % s->nu]);
        }
        s->bent[a] = plan[a];
    }
    return rc;
}

void apc_shooting_move(const struct apc_shooting *s, const double *plan, double *nodes)
{
    for (size_t i = 0; i < s->N * s->nx; i++) {
        nodes[i] += s->e[i];
        for (size_t k = 0; k < s->n; k++)
            nodes[i] += s->S[i * s->n + k] * (plan[k] - s->plan[k]);
    }
}

/* How many former inputs j stand in the state of the linear model, as apclinear.h has them. */
static size_t held_inputs(const struct apc_shooting *s, size_t j)
{
    return s->whole[j] + (s->bit[j] > 0.0);
}

void apc_shooting_end(const struct apc_shooting *s, const double *nodes, const double *past, double *Gx,
                      double *free_x)
{
    const size_t nx = s->nx, n = s->n, last = s->N - 1;

    memcpy(Gx, s->S + last * nx * n, nx * n * sizeof(*Gx));
    for (size_t i = 0; i < nx; i++)
        free_x[i] = nodes[last * nx + i] + s->e[last * nx + i] - apc_matrix_dot(Gx + i * n, s->away, n);
    for (size_t j = 0, row = nx; j < s->nu; j++) {
        for (size_t ago = 1; ago <= held_inputs(s, j); ago++, row++) {
            memset(Gx + row * n, 0, n * sizeof(*Gx));
            add_move(s, s->N, j, ago, 1.0, Gx + row * n);
            free_x[row] = s->N >= ago ? s->u0[j] : past[(ago - s->N - 1) * s->nu + j];
        }
    }
}

/* Where the input of so many periods ago acts on state i of the plant: as a state, or as the input itself. */
static double *input_gain_place(struct apc_linear *m, size_t first, size_t i, size_t j, size_t ago)
{
    return ago ? m->A + i * m->nx + first + ago - 1 : m->B + i * (m->nu + m->nd) + j;
}

int apc_shooting_sample(struct apc_shooting *s, const double *x, const double *u, const double *d,
                        struct apc_linear *to, double *drift)
{
    const size_t nx = s->nx, nu = s->nu, inputs = nu + to->nd;

    memcpy(s->newer, u, nu * sizeof(*u));
    memcpy(s->older, u, nu * sizeof(*u));
    if (linearize_interval(s, x, d) < 0)
        return APC_ESOLVER;
    memset(drift, 0, to->nx * sizeof(*drift));
    for (size_t i = 0; i < nx; i++)
        drift[i] = s->x[i] - x[i];
    linearize_outputs(s, x, d);
    memset(to->A, 0, nx * to->nx * sizeof(*to->A));
    memset(to->B, 0, nx * inputs * sizeof(*to->B));
    memset(to->C, 0, s->ny * to->nx * sizeof(*to->C));
    memset(to->D, 0, s->ny * inputs * sizeof(*to->D));
    apc_matrix_put(to->A, to->nx, 0, 0, nx, nx, s->A);
    apc_matrix_put(to->C, to->nx, 0, 0, s->ny, nx, s->C);
    apc_matrix_put(to->D, inputs, 0, 0, s->ny, nu, s->D);
    memcpy(to->x0, x, nx * sizeof(*x));
    memcpy(to->u0, u, nu * sizeof(*u));
    for (size_t j = 0, first = nx; j < nu; first += held_inputs(s, j++)) {
        for (size_t i = 0; i < nx; i++) {
            *input_gain_place(to, first, i, j, s->whole[j]) += s->B[i * 2 * nu + j];
            if (s->bit[j] > 0.0)
                *input_gain_place(to, first, i, j, s->whole[j] + 1) += s->B[i * 2 * nu + nu + j];
        }
        for (size_t k = 0; k < held_inputs(s, j); k++)
            to->x0[first + k] = u[j];
    }
    predict_outputs(s, x, u, d, to->y0);
    return apc_values_ok(to->A, nx * to->nx) && apc_values_ok(to->B, nx * inputs) &&
                   apc_values_ok(to->C, s->ny * to->nx) && apc_values_ok(to->D, s->ny * inputs) &&
                   apc_values_ok(to->y0, s->ny)
               ? 0
               : APC_ESOLVER;
}
