/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Of interval i, from node x_i with u: F_i, and by central differences of the integrator itself A_i, B_i.
 * With what node i moves by, dx_i = e_i + S_i (u - plan), and the gap c_i = F_i - x_i+1, e_i+1 = A_i e_i +
 * c_i,    S_i+1 = A_i S_i + B_i in the columns of the interval's block.
 */
#include "predict/shoot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "plant/plant_internal.h"

struct apc_shoot {
    const struct apc_model *model;
    size_t nx, nu, ny, N, blocks, n, n_unknown;
    double Ts;
    unsigned steps;
    size_t *block_of; /* [N] the block that interval i is in */
    struct apc_linear_unknown *unknown;

    double *memory;
    double *p, *nominal, *u0;     /* [np], [nu + nd], [nu] */
    double *input, *moved;        /* [nu + nd]; [nu] */
    double *slope, *at, *sum, *x; /* [nx] */
    double *up, *down;            /* [nx]; also y [ny] */
    double *A, *B, *C;            /* [nx * nx], [nx * nu], [ny * nx] of an interval */
    double *e, *S;                /* [N * nx], [N * nx * n] */
    double *plan, *away;          /* [n] of the last linearisation; from u0 */
};

static int allocate(struct apc_shoot *s, const struct apc_shoot_options *o)
{
    const size_t nx = s->nx, nu = s->nu, ny = s->ny, n = s->n, all = nu + o->model->nd;
    double *at = calloc(o->model->np + 2 * all + 2 * nu + 4 * nx + 2 * (nx + ny) + nx * nx + nx * nu +
                            ny * nx + s->N * nx * (1 + n) + 2 * n,
                        sizeof(*at));

    s->memory = at;
    s->block_of = calloc(s->N, sizeof(*s->block_of));
    s->unknown = calloc(o->n_unknown + 1, sizeof(*s->unknown));
    if (!at || !s->block_of || !s->unknown)
        return APC_ENOMEM;
    s->p = apc_carve(&at, o->model->np);
    s->nominal = apc_carve(&at, all);
    s->input = apc_carve(&at, all);
    s->u0 = apc_carve(&at, nu);
    s->moved = apc_carve(&at, nu);
    s->slope = apc_carve(&at, nx);
    s->at = apc_carve(&at, nx);
    s->sum = apc_carve(&at, nx);
    s->x = apc_carve(&at, nx);
    s->up = apc_carve(&at, nx + ny);
    s->down = apc_carve(&at, nx + ny);
    s->A = apc_carve(&at, nx * nx);
    s->B = apc_carve(&at, nx * nu);
    s->C = apc_carve(&at, ny * nx);
    s->e = apc_carve(&at, s->N * nx);
    s->S = apc_carve(&at, s->N * nx * n);
    s->plan = apc_carve(&at, n);
    s->away = apc_carve(&at, n);
    return 0;
}

int apc_shoot_create(struct apc_shoot **shoot, const struct apc_shoot_options *o, struct apc_error *why)
{
    const struct apc_model *m = o->model;
    struct apc_shoot *s = calloc(1, sizeof(*s));
    int rc;

    *shoot = NULL;
    if (!s)
        return apc_fail(why, APC_ENOMEM, "shooting: no memory");
    *s = (struct apc_shoot){.model = m,
                            .nx = m->nx,
                            .nu = m->nu,
                            .ny = m->ny,
                            .N = o->horizon,
                            .blocks = o->blocks,
                            .n = m->nu * o->blocks,
                            .n_unknown = o->n_unknown,
                            .Ts = o->Ts,
                            .steps = o->steps};
    rc = allocate(s, o) < 0 ? apc_fail(why, APC_ENOMEM, "shooting: no memory")
                            : apc_model_take(m, s->p, o->p, m->param, m->np, "parameter", why);
    if (rc < 0) {
        apc_shoot_destroy(s);
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
    *shoot = s;
    return 0;
}

void apc_shoot_destroy(struct apc_shoot *shoot)
{
    if (!shoot)
        return;
    free(shoot->unknown);
    free(shoot->block_of);
    free(shoot->memory);
    free(shoot);
}

/* ---- The model ---------------------------------------------------------------------------------- */

static void disturb(struct apc_shoot *s, const double *u, const double *d)
{
    memcpy(s->input, s->nominal, (s->nu + s->model->nd) * sizeof(*s->input));
    memcpy(s->input, u, s->nu * sizeof(*u));
    for (size_t k = 0; k < s->n_unknown; k++) {
        if (s->unknown[k].where == APC_AT_INPUT)
            s->input[s->unknown[k].number] += d[k];
    }
}

/* x on by t in so many steps, with s->input. */
static int integrate(struct apc_shoot *s, double *x, double t)
{
    static const double reach[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
    const double h = t / s->steps;

    for (unsigned step = 0; step < s->steps; step++) {
        memset(s->sum, 0, s->nx * sizeof(*s->sum));
        for (int k = 0; k < 4; k++) {
            for (size_t i = 0; i < s->nx; i++)
                s->at[i] = x[i] + (k ? reach[k] * h * s->slope[i] : 0.0);
            if (s->model->f(0.0, s->at, s->input, s->p, s->slope) != 0)
                return APC_ESOLVER;
            for (size_t i = 0; i < s->nx; i++)
                s->sum[i] += weight[k] * s->slope[i];
        }
        for (size_t i = 0; i < s->nx; i++)
            x[i] += h / 6.0 * s->sum[i];
    }
    return apc_values_ok(x, s->nx) ? 0 : APC_ESOLVER;
}

void apc_shoot_measure(struct apc_shoot *s, const double *own)
{
    memcpy(s->nominal + s->nu, own, s->model->nd * sizeof(*own));
}

int apc_shoot_advance(struct apc_shoot *s, double *x, const double *u, const double *d, double t)
{
    int rc;

    memcpy(s->x, x, s->nx * sizeof(*x));
    disturb(s, u, d);
    rc = integrate(s, s->x, t);
    if (rc == 0)
        memcpy(x, s->x, s->nx * sizeof(*x));
    return rc;
}

/* ---- Derivatives -------------------------------------------------------------------------------- */

/* A step for central differences: about the cube root of the rounding error. */
static double small(double value)
{
    return 6e-6 * fmax(fabs(value), 1e-3);
}

/* The end of an interval from x, with state @p i (or nx: none) moved by @p dx and input @p j by @p du. */
static int end(struct apc_shoot *s, const double *x, const double *u, const double *d, size_t i, double dx,
               size_t j, double du, double *to)
{
    memcpy(to, x, s->nx * sizeof(*x));
    memcpy(s->moved, u, s->nu * sizeof(*u));
    if (i < s->nx)
        to[i] += dx;
    if (j < s->nu)
        s->moved[j] += du;
    disturb(s, s->moved, d);
    return integrate(s, to, s->Ts);
}

/* A and B of the interval from x. */
static int differentiate(struct apc_shoot *s, const double *x, const double *u, const double *d)
{
    for (size_t k = 0; k < s->nx + s->nu; k++) {
        const bool state = k < s->nx;
        const size_t i = state ? k : s->nx, j = state ? s->nu : k - s->nx;
        const double by = small(state ? x[i] : u[j]);
        double *column = state ? s->A + i : s->B + j;
        const size_t stride = state ? s->nx : s->nu;

        if (end(s, x, u, d, i, by, j, by, s->up) < 0 || end(s, x, u, d, i, -by, j, -by, s->down) < 0)
            return APC_ESOLVER;
        for (size_t r = 0; r < s->nx; r++)
            column[r * stride] = (s->up[r] - s->down[r]) / (2.0 * by);
    }
    return 0;
}

/* y at x, with unknown disturbances. */
static void measure(struct apc_shoot *s, const double *x, const double *u, const double *d, double *y)
{
    disturb(s, u, d);
    s->model->g(0.0, x, s->input, s->p, y);
    for (size_t k = 0; k < s->n_unknown; k++) {
        if (s->unknown[k].where == APC_AT_OUTPUT)
            y[s->unknown[k].number] += d[k];
    }
}

/* C at x */
static void look(struct apc_shoot *s, const double *x, const double *u, const double *d)
{
    double *up = s->up + s->nx, *down = s->down + s->nx;

    memcpy(s->at, x, s->nx * sizeof(*x));
    for (size_t j = 0; j < s->nx; j++) {
        const double by = small(x[j]);

        s->at[j] = x[j] + by;
        measure(s, s->at, u, d, up);
        s->at[j] = x[j] - by;
        measure(s, s->at, u, d, down);
        s->at[j] = x[j];
        for (size_t c = 0; c < s->ny; c++)
            s->C[c * s->nx + j] = (up[c] - down[c]) / (2.0 * by);
    }
}

/* ---- The horizon -------------------------------------------------------------------------------- */

/* e and S of the end of interval i. */
static void carry_on(struct apc_shoot *s, size_t i, const double *node)
{
    const size_t nx = s->nx, n = s->n;
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
        for (size_t j = 0; j < s->nu; j++)
            S[r * n + s->block_of[i] * s->nu + j] += s->B[r * s->nu + j];
    }
}

int apc_shoot_linearise(struct apc_shoot *s, const double *x, const double *d, const double *plan,
                        const double *nodes, double *G, double *free_y)
{
    const size_t nx = s->nx, ny = s->ny, n = s->n;

    memcpy(s->plan, plan, n * sizeof(*plan));
    for (size_t b = 0; b < s->blocks; b++) {
        for (size_t j = 0; j < s->nu; j++)
            s->away[b * s->nu + j] = plan[b * s->nu + j] - s->u0[j];
    }
    for (size_t i = 0; i < s->N; i++) {
        const double *from = i ? nodes + (i - 1) * nx : x, *to = nodes + i * nx,
                     *u = plan + s->block_of[i] * s->nu;
        double *y = free_y + i * ny;

        if (end(s, from, u, d, nx, 0.0, s->nu, 0.0, s->x) < 0 || differentiate(s, from, u, d) < 0)
            return APC_ESOLVER;
        carry_on(s, i, to);
        look(s, to, u, d);
        measure(s, to, u, d, y);
        apc_matrix_multiply(ny, nx, n, s->C, s->S + i * nx * n, G + i * ny * n);
        for (size_t c = 0; c < ny; c++) {
            y[c] += apc_matrix_dot(s->C + c * nx, s->e + i * nx, nx);
            y[c] -= apc_matrix_dot(G + (i * ny + c) * n, s->away, n);
        }
    }
    return apc_values_ok(G, s->N * ny * n) && apc_values_ok(free_y, s->N * ny) ? 0 : APC_ESOLVER;
}

void apc_shoot_move(const struct apc_shoot *s, const double *plan, double *nodes)
{
    for (size_t i = 0; i < s->N * s->nx; i++) {
        nodes[i] += s->e[i];
        for (size_t k = 0; k < s->n; k++)
            nodes[i] += s->S[i * s->n + k] * (plan[k] - s->plan[k]);
    }
}

void apc_shoot_end(const struct apc_shoot *s, const double *nodes, double *Gx, double *free_x)
{
    const size_t nx = s->nx, n = s->n, last = s->N - 1;

    memcpy(Gx, s->S + last * nx * n, nx * n * sizeof(*Gx));
    for (size_t i = 0; i < nx; i++)
        free_x[i] = nodes[last * nx + i] + s->e[last * nx + i] - apc_matrix_dot(Gx + i * n, s->away, n);
}

int apc_shoot_sample(struct apc_shoot *s, const double *x, const double *u, const double *d,
                     struct apc_linear *to, double *drift)
{
    const size_t nx = s->nx;

    if (end(s, x, u, d, nx, 0.0, s->nu, 0.0, s->x) < 0 || differentiate(s, x, u, d) < 0)
        return APC_ESOLVER;
    for (size_t i = 0; i < nx; i++)
        drift[i] = s->x[i] - x[i];
    look(s, x, u, d);
    memcpy(to->A, s->A, nx * nx * sizeof(*s->A));
    apc_matrix_put(to->B, s->nu + to->nd, 0, 0, nx, s->nu, s->B);
    for (size_t i = 0; i < nx; i++)
        memset(to->B + i * (s->nu + to->nd) + s->nu, 0, to->nd * sizeof(*to->B));
    memset(to->D, 0, s->ny * (s->nu + to->nd) * sizeof(*to->D));
    memcpy(to->C, s->C, s->ny * nx * sizeof(*s->C));
    memcpy(to->x0, x, nx * sizeof(*x));
    memcpy(to->u0, u, s->nu * sizeof(*u));
    measure(s, x, u, d, to->y0);
    return apc_values_ok(to->A, nx * nx) && apc_values_ok(to->B, nx * (s->nu + to->nd)) &&
                   apc_values_ok(to->C, s->ny * nx) && apc_values_ok(to->y0, s->ny)
               ? 0
               : APC_ESOLVER;
}
