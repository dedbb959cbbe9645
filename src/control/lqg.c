/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * State feedback with an observer, for all outputs together, from the plant's linear model at an operating
 * point. Everything below is a deviation from that point. The plant is sampled with the law's period h and,
 * where setting `delay` says that u acts later by so much (below h), with the former u as further states:
 *
 *     x_{k+1} = A x_k + B u_k + E d_k,    d_{k+1} = d_k,    y_k = C x_k
 *
 * d are disturbances that add to u, one for each: the observer estimates them too, and that is the integral
 * action: no offset remains, and nothing winds up, because the observer is told what really went out. With
 * the estimate corrected by y_k (a steady-state Kalman filter, gain L),
 *
 *     (x, d)_k|k = (x, d)_k|k-1 + L (y_k - C x_k|k-1),
 *     u_k = -K (x_k|k - x*_k) + u*_k + bias_k
 *
 * where x*, u* is the steady state with the controlled measurements at z for the estimated d, and K the gain
 * of the linear-quadratic regulator. The bias is what a bumpless change needs; it dies out with tau_b.
 *
 * compute leaves the state as it is: u is linear in (x, d)_k|k-1, y and z. A measurement that is Bad is taken
 * to be what the estimate says of it, so it corrects nothing.
 *
 * Setting `preview` says how far ahead, in s, setpoints to come are looked at. They move x*, which is to the
 * regulator a disturbance known beforehand: with P of the Riccati equation it adds to u
 *
 *     sum over i of M ((A - B K)')^i P (x*_{k+i+1} - x*_{k+i}),    M = (R + B'PB)^-1 B'
 */
#include "apclinear.h"
#include "base/matrix.h"
#include "control/control_internal.h"
#include "predict/initial_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { U_MIN, U_MAX, TAU_B, DU_MAX, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    [U_MIN] = {"u_min", "", "output low limit", -1e9, -1e9, 1e9},
    [U_MAX] = {"u_max", "", "output high limit", 1e9, -1e9, 1e9},
    [TAU_B] = {"tau_b", "s", "time in which a bumpless change dies out", 10.0, 0.0, 1e9},
    [DU_MAX] = {"du_max", "1/s", "fastest change of the output; 0: any", 0.0, 0.0, 1e9},
};

static const char *const settings[] = {"measurement", "y_scale", "x_scale", "u_scale",          "y_noise",
                                       "x_noise",     "u_noise", "delay",   "setpoint_preview", NULL};

#define PREVIEW_MAX 10000.0 /* periods */

/* ---- The constants --------------------------------------------------------------------------- */

/* Estimates: ns of the states (nx, and nu former outputs where there is a delay), and nu of the disturbances.
 * Setpoints of `ahead` ticks to come. */
struct sizes {
    size_t nx, ns, n, nu, ny, nz, ahead;
};

/*
 * Where each matrix begins in the constants.
 *     u = u0 - F e - G (y - y0) + H (z - z0) + bias + sum of Preview_i (z_{i+1} - z_i),
 *     then   e = Next e + Gain (y - y0) + Drive (u - u0)
 * Of a measurement that is Bad, y - y0 = C e. After a gap the first nx of e are Start (y - y0).
 */
struct layout {
    size_t F, G, H, Next, Gain, Drive, Start, C, Preview, u0, y0, z0, end;
};

static struct layout lay_out_lqg(const struct sizes *s)
{
    struct layout at = {.F = 0};

    at.G = at.F + s->nu * s->n;
    at.H = at.G + s->nu * s->ny;
    at.Next = at.H + s->nu * s->nz;
    at.Gain = at.Next + s->n * s->n;
    at.Drive = at.Gain + s->n * s->ny;
    at.Start = at.Drive + s->n * s->nu;
    at.C = at.Start + s->nx * s->ny;
    at.Preview = at.C + s->ny * s->n;
    at.u0 = at.Preview + s->ahead * s->nu * s->nz;
    at.y0 = at.u0 + s->nu;
    at.z0 = at.y0 + s->ny;
    at.end = at.z0 + s->nz;
    return at;
}

/* An instance. */
struct lqg {
    struct sizes s;
    struct layout at;
    struct apc_linear *model; /* of a sampled plant, with the disturbances; else NULL, and so is rest */
    struct apc_initial_state *rest;
    double *whole;  /* [n] as rest has it, with x0 */
    double *before; /* [n] room for the estimates of the tick before */
    double *dy;     /* [ny] y - y0 of this call */
    double k[];     /* the constants */
};

/* ---- The design ------------------------------------------------------------------------------ */

struct design {
    const struct apc_law_setup *setup;
    struct sizes s;
    double delay;
    size_t named;          /* states that settings speak of */
    double *memory, *free; /* all the matrices, and where the next one goes */
    double *A, *B, *E, *C; /* [ns ns], [ns nu], [ns nu], [ny ns] */
    double *Ca;            /* [ny n] C, of all estimates */
    double *K, *P, *R;     /* [nu ns], [ns ns], [nu nu] of the regulator */
    double *Nx, *Nu;       /* [ns nu], [nu nu] x* and u* for each setpoint */
    double *L;             /* [n ny] */
    double *Aa, *Ba;       /* [n n], [n nu] A and B, of all estimates */
    size_t *controlled;    /* [nz] the measurement of each setpoint, from 1 */
};

/* A matrix of zeros, until the design is freed. */
static double *matrix(struct design *d, size_t rows, size_t columns)
{
    double *at = d->free;

    d->free += rows * columns;
    return at;
}

/* n amounts by name, squared or inversely squared; absent ones are `usual`. An amount of 0 gives 0. */
static int squares(struct design *d, const char *name, size_t n, double usual, bool inverse, double *to,
                   struct apc_error *why)
{
    int rc;

    for (size_t i = 0; i < n; i++)
        to[i] = usual;
    rc = apc_setting_amounts(d->setup, name, n, to, why);
    for (size_t i = 0; i < n; i++) {
        double square = to[i] * to[i];

        to[i] = !inverse ? square : square > 0.0 ? 1.0 / square : 0.0;
    }
    return rc;
}

static int all_positive(const char *name, const double *v, size_t n, struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        if (!(v[i] > 0.0))
            return apc_fail(why, APC_EINVAL, "setting \"%s\": each must be above 0", name);
    }
    return 0;
}

/* With a delay of tau in a period of h: x' = A(h) x + A(h - tau) B(tau) u_{k-1} + B(h - tau) u_k. */
static int sample_weights(struct design *d, struct apc_error *why)
{
    const struct apc_law_plant *plant = d->setup->plant;
    size_t nx = d->s.nx, nu = d->s.nu, ns = d->s.ns;
    double *A1 = matrix(d, nx, nx), *B1 = matrix(d, nx, nu), *A2 = matrix(d, nx, nx), *B2 = matrix(d, nx, nu);
    double *late = matrix(d, nx, nu), *whole = matrix(d, nx, nx);
    int rc = apc_linear_sample(nx, nu, plant->A, plant->B, d->setup->Ts - d->delay, A1, B1, why);

    if (rc == 0)
        rc = apc_linear_sample(nx, nu, plant->A, plant->B, d->delay, A2, B2, why);
    if (rc < 0)
        return rc;
    apc_matrix_multiply(nx, nx, nx, A1, A2, whole);
    apc_matrix_multiply(nx, nx, nu, A1, B2, late);
    apc_matrix_put(d->A, ns, 0, 0, nx, nx, whole);
    apc_matrix_put(d->B, nu, 0, 0, nx, nu, B1);
    for (size_t i = 0; i < nx * nu; i++)
        d->E[i] = B1[i] + late[i];
    if (ns > nx) {
        apc_matrix_put(d->A, ns, 0, nx, nx, nu, late);
        for (size_t i = 0; i < nu; i++)
            d->B[(nx + i) * nu + i] = 1.0;
    }
    apc_matrix_put(d->C, ns, 0, 0, d->s.ny, nx, plant->C);
    return 0;
}

/* A model that is sampled already, dead times and all: a disturbance adds to an input before its dead time. */
static int take_sampled(struct design *d, struct lqg *q, struct apc_error *why)
{
    const struct apc_linear *from = d->setup->plant->sampled;
    const struct sizes *s = &d->s;
    struct apc_linear_unknown *unknown = calloc(s->nu + 1, sizeof(*unknown));
    int rc = unknown ? 0 : apc_fail(why, APC_ENOMEM, "no memory");

    for (size_t j = 0; j < s->nu && rc == 0; j++) {
        unknown[j] = (struct apc_linear_unknown){.where = APC_AT_INPUT, .number = j};
        for (size_t i = 0; i < s->ns; i++)
            d->B[i * s->nu + j] = d->E[i * s->nu + j] = from->B[i * (s->nu + from->nd) + j];
    }
    apc_matrix_put(d->A, s->ns, 0, 0, s->ns, s->ns, from->A);
    apc_matrix_put(d->C, s->ns, 0, 0, s->ny, s->ns, from->C);
    if (rc == 0)
        rc = apc_linear_disturb(&q->model, from, unknown, s->nu, why);
    if (rc == 0)
        rc = apc_initial_state_create(&q->rest, q->model, why);
    free(unknown);
    return rc;
}

static int regulator(struct design *d, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    double *y = matrix(d, s->ny, 1), *x = matrix(d, s->nx, 1), *u = matrix(d, s->nu, 1);
    double *Q = matrix(d, s->ns, s->ns);
    int rc = squares(d, "y_scale", s->ny, 1.0, true, y, why);

    if (rc == 0)
        rc = squares(d, "x_scale", d->named, 0.0, true, x, why);
    if (rc == 0)
        rc = squares(d, "u_scale", s->nu, 1.0, true, u, why);
    if (rc == 0)
        rc = all_positive("u_scale", u, s->nu, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < s->nx; i++) {
        for (size_t j = 0; j < s->nx; j++) {
            for (size_t k = 0; k < s->ny; k++)
                Q[i * s->ns + j] += d->C[k * s->ns + i] * y[k] * d->C[k * s->ns + j];
        }
        Q[i * s->ns + i] += x[i];
    }
    for (size_t i = 0; i < s->nu; i++)
        d->R[i * s->nu + i] = u[i];
    return apc_riccati_solve(s->ns, s->nu, d->A, d->B, Q, d->R, d->P, d->K, why);
}

/* The steady state for each setpoint: x* = A x* + B u*, C x* = z. */
static int target(struct design *d, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    size_t n = s->ns + s->nu;
    double *M = matrix(d, n, n), *N = matrix(d, n, s->nz);

    apc_matrix_put(M, n, 0, 0, s->ns, s->ns, d->A);
    apc_matrix_put(M, n, 0, s->ns, s->ns, s->nu, d->B);
    for (size_t i = 0; i < s->ns; i++)
        M[i * n + i] -= 1.0;
    for (size_t i = 0; i < s->nz; i++) {
        apc_matrix_put(M, n, s->ns + i, 0, 1, s->ns, d->C + (d->controlled[i] - 1) * s->ns);
        N[(s->ns + i) * s->nz + i] = 1.0;
    }
    if (apc_matrix_solve(n, s->nz, M, N))
        return apc_fail(why, APC_ESOLVER,
                        "no steady state belongs to every setpoint: at rest the outputs do not determine the "
                        "controlled measurements one by one");
    memcpy(d->Nx, N, s->ns * s->nz * sizeof(*N));
    memcpy(d->Nu, N + s->ns * s->nz, s->nu * s->nz * sizeof(*N));
    return 0;
}

static int observer(struct design *d, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    size_t n = s->n, ny = s->ny;
    double *x = matrix(d, s->nx, 1), *u = matrix(d, s->nu, 1), *y = matrix(d, ny, 1);
    double *At = matrix(d, n, n), *Ct = matrix(d, n, ny), *Q = matrix(d, n, n), *R = matrix(d, ny, ny);
    double *P = matrix(d, n, n), *K = matrix(d, ny, n), *CP = matrix(d, ny, n), *S = matrix(d, ny, ny);
    double h = d->setup->Ts;
    int rc = squares(d, "x_noise", d->named, 0.0, false, x, why);

    if (rc == 0)
        rc = squares(d, "u_noise", s->nu, 1.0, false, u, why);
    if (rc == 0)
        rc = squares(d, "y_noise", ny, 1.0, false, y, why);
    if (rc == 0)
        rc = all_positive("u_noise", u, s->nu, why);
    if (rc == 0)
        rc = all_positive("y_noise", y, ny, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < s->nx; i++)
        Q[i * n + i] = h * x[i];
    for (size_t i = 0; i < s->nu; i++)
        Q[(s->ns + i) * n + s->ns + i] = h * u[i];
    for (size_t i = 0; i < ny; i++)
        R[i * ny + i] = y[i];
    apc_matrix_transpose(n, n, d->Aa, At);
    apc_matrix_transpose(ny, n, d->Ca, Ct);
    rc = apc_riccati_solve(n, ny, At, Ct, Q, R, P, K, why);
    if (rc < 0)
        return rc;
    apc_matrix_multiply(ny, n, n, d->Ca, P, CP);
    apc_matrix_multiply(ny, n, ny, CP, Ct, S);
    for (size_t i = 0; i < ny * ny; i++)
        S[i] += R[i];
    if (apc_matrix_solve(ny, n, S, CP))
        return apc_fail(why, APC_ESOLVER, "the observer's gain cannot be computed");
    apc_matrix_transpose(ny, n, CP, d->L);
    return 0;
}

static int design_start(struct design *d, double *Start, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    double *Ct = matrix(d, s->nx, s->ny), *CC = matrix(d, s->ny, s->ny), *X = matrix(d, s->ny, s->nx);
    double trace = 0.0;

    if (d->setup->plant->sampled)
        return 0; /* rest says */
    apc_matrix_transpose(s->ny, s->nx, d->setup->plant->C, Ct);
    apc_matrix_multiply(s->ny, s->nx, s->ny, d->setup->plant->C, Ct, CC);
    for (size_t i = 0; i < s->ny; i++)
        trace += CC[i * s->ny + i];
    for (size_t i = 0; i < s->ny; i++)
        CC[i * s->ny + i] += 1e-9 * trace; /* where two measurements say the same */
    memcpy(X, d->setup->plant->C, s->ny * s->nx * sizeof(*X));
    if (apc_matrix_solve(s->ny, s->nx, CC, X))
        return apc_fail(why, APC_ESOLVER, "the measurements do not depend on the states");
    apc_matrix_transpose(s->ny, s->nx, X, Start);
    return 0;
}

/* What setpoints to come add: Preview_i = M ((A - B K)')^i P Nx. */
static int preview(struct design *d, double *gain, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    const size_t ns = s->ns, nu = s->nu;
    double *Bt = matrix(d, nu, ns), *M = matrix(d, nu, ns), *S = matrix(d, nu, nu),
           *closed = matrix(d, ns, ns);
    double *closed_t = matrix(d, ns, ns), *X = matrix(d, ns, s->nz), *next = matrix(d, ns, s->nz);

    if (s->ahead == 0)
        return 0;
    apc_matrix_transpose(ns, nu, d->B, Bt);
    apc_matrix_multiply(nu, ns, ns, Bt, d->P, closed); /* B'P, for a moment */
    apc_matrix_multiply(nu, ns, nu, closed, d->B, S);
    for (size_t i = 0; i < nu * nu; i++)
        S[i] += d->R[i];
    memcpy(M, Bt, nu * ns * sizeof(*M));
    if (apc_matrix_solve(nu, ns, S, M))
        return apc_fail(why, APC_ESOLVER, "the gains of the preview cannot be computed");
    apc_matrix_multiply(ns, nu, ns, d->B, d->K, closed);
    for (size_t i = 0; i < ns * ns; i++)
        closed[i] = d->A[i] - closed[i];
    apc_matrix_transpose(ns, ns, closed, closed_t);
    apc_matrix_multiply(ns, ns, s->nz, d->P, d->Nx, X);
    for (size_t k = 0; k < s->ahead; k++) {
        apc_matrix_multiply(nu, ns, s->nz, M, X, gain + k * nu * s->nz);
        apc_matrix_multiply(ns, ns, s->nz, closed_t, X, next);
        memcpy(X, next, ns * s->nz * sizeof(*X));
    }
    return 0;
}

/* Gains of the estimates before y corrects them: (1 - L C) goes into F and Next. */
static void assemble(struct design *d, const struct layout *at, double *k)
{
    const struct sizes *s = &d->s;
    const struct apc_law_plant *plant = d->setup->plant;
    double *Ka = matrix(d, s->nu, s->n), *I_LC = matrix(d, s->n, s->n), *KN = matrix(d, s->nu, s->nz);

    /* Of d: u* is smaller by it, and so are the former outputs in x*. */
    apc_matrix_put(Ka, s->n, 0, 0, s->nu, s->ns, d->K);
    for (size_t i = 0; i < s->nu; i++) {
        for (size_t j = s->nx; j < s->ns; j++)
            Ka[i * s->n + s->ns + j - s->nx] = d->K[i * s->ns + j];
        Ka[i * s->n + s->ns + i] += 1.0;
    }
    apc_matrix_multiply(s->n, s->ny, s->n, d->L, d->Ca, I_LC);
    for (size_t i = 0; i < s->n * s->n; i++)
        I_LC[i] = (i % (s->n + 1) == 0 ? 1.0 : 0.0) - I_LC[i];
    apc_matrix_multiply(s->nu, s->n, s->n, Ka, I_LC, k + at->F);
    apc_matrix_multiply(s->nu, s->n, s->ny, Ka, d->L, k + at->G);
    apc_matrix_multiply(s->nu, s->ns, s->nz, d->K, d->Nx, KN);
    for (size_t i = 0; i < s->nu * s->nz; i++)
        k[at->H + i] = KN[i] + d->Nu[i];
    apc_matrix_multiply(s->n, s->n, s->n, d->Aa, I_LC, k + at->Next);
    apc_matrix_multiply(s->n, s->n, s->ny, d->Aa, d->L, k + at->Gain);
    memcpy(k + at->C, d->Ca, s->ny * s->n * sizeof(*k));
    memcpy(k + at->Drive, d->Ba, s->n * s->nu * sizeof(*k));
    memcpy(k + at->u0, plant->u0, s->nu * sizeof(*k));
    memcpy(k + at->y0, plant->y0, s->ny * sizeof(*k));
    for (size_t i = 0; i < s->nz; i++)
        k[at->z0 + i] = plant->y0[d->controlled[i] - 1];
}

/* The measurement of setpoint i, from 1. */
static int controlled_measurement(const struct apc_law_setup *setup, size_t i, size_t *to,
                                  struct apc_error *why)
{
    *to = i + 1;
    return apc_setting_index(setup, "measurement", setup->dim.nz, i, 1, setup->dim.ny, to, why);
}

static int make_lqg(struct design *d, struct lqg *q, struct apc_error *why)
{
    const struct sizes *s = &d->s;
    const struct layout *at = &q->at;
    double *k = q->k;
    int rc;

    d->A = matrix(d, s->ns, s->ns);
    d->B = matrix(d, s->ns, s->nu);
    d->E = matrix(d, s->ns, s->nu);
    d->C = matrix(d, s->ny, s->ns);
    d->Ca = matrix(d, s->ny, s->n);
    d->K = matrix(d, s->nu, s->ns);
    d->Nx = matrix(d, s->ns, s->nz);
    d->Nu = matrix(d, s->nu, s->nz);
    d->L = matrix(d, s->n, s->ny);
    d->Aa = matrix(d, s->n, s->n);
    d->Ba = matrix(d, s->n, s->nu);
    d->P = matrix(d, s->ns, s->ns);
    d->R = matrix(d, s->nu, s->nu);
    for (size_t i = 0; i < s->nz; i++) {
        rc = controlled_measurement(d->setup, i, &d->controlled[i], why);
        if (rc < 0)
            return rc;
    }
    rc = d->setup->plant->sampled ? take_sampled(d, q, why) : sample_weights(d, why);
    if (rc < 0)
        return rc;
    apc_matrix_put(d->Aa, s->n, 0, 0, s->ns, s->ns, d->A);
    apc_matrix_put(d->Aa, s->n, 0, s->ns, s->ns, s->nu, d->E);
    for (size_t i = s->ns; i < s->n; i++)
        d->Aa[i * s->n + i] = 1.0;
    apc_matrix_put(d->Ba, s->nu, 0, 0, s->ns, s->nu, d->B);
    apc_matrix_put(d->Ca, s->n, 0, 0, s->ny, s->ns, d->C);
    rc = regulator(d, why);
    if (rc == 0)
        rc = target(d, why);
    if (rc == 0)
        rc = observer(d, why);
    if (rc == 0)
        rc = design_start(d, k + at->Start, why);
    if (rc == 0)
        rc = preview(d, k + at->Preview, why);
    if (rc == 0)
        assemble(d, at, k);
    return rc;
}

static int check_lqg_settings(const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_dim *dim = &setup->dim;

    if (!setup->plant)
        return apc_fail(why, APC_EINVAL,
                        "law lqg needs the plant's linear model: an experiment file gives it with "
                        "operating_point or model");
    if (dim->nd)
        return apc_fail(why, APC_EINVAL, "law lqg: takes no measured disturbances");
    if (dim->nz != dim->nu || dim->ny < dim->nu)
        return apc_fail(
            why, APC_EINVAL,
            "law lqg: needs a setpoint for each output, and at least as many measurements; there are %zu "
            "outputs, %zu setpoints, %zu measurements",
            dim->nu, dim->nz, dim->ny);
    for (size_t i = 0; i < dim->ny * dim->nu; i++) {
        if (setup->plant->D[i] < 0.0 || setup->plant->D[i] > 0.0)
            return apc_fail(why, APC_EINVAL,
                            "law lqg: u acts on y at once (D is not zero); that is not provided for");
    }
    return 0;
}

/* Delay and preview from the settings; then the sizes. */
static int measure_lqg(struct design *d, struct apc_error *why)
{
    const struct apc_law_setup *setup = d->setup;
    const struct apc_dim *dim = &setup->dim;
    double ahead = 0.0;
    size_t nx;
    int rc = apc_setting_amounts(setup, "delay", 1, &d->delay, why);

    if (rc == 0)
        rc = apc_setting_amounts(setup, "setpoint_preview", 1, &ahead, why);
    if (rc < 0)
        return rc;
    ahead = round(ahead / setup->Ts);
    if (apc_setting_find(setup, "delay") && setup->plant->sampled)
        return apc_fail(why, APC_EINVAL,
                        "law lqg: setting \"delay\": a model of its own has its \"delay\" itself");
    if (d->delay >= setup->Ts)
        return apc_fail(why, APC_EINVAL, "law lqg: \"delay\" is %g s; it must be below the period, %g s",
                        d->delay, setup->Ts);
    if (ahead > PREVIEW_MAX)
        return apc_fail(why, APC_EINVAL, "law lqg: \"setpoint_preview\" is %g periods; %g at most", ahead,
                        PREVIEW_MAX);
    nx = setup->plant->sampled ? setup->plant->sampled->nx : setup->plant->nx;
    d->named = setup->plant->sampled ? setup->plant->sampled->nx_plant : nx;
    d->s = (struct sizes){.nx = nx,
                          .ns = nx + (d->delay > 0.0 ? dim->nu : 0),
                          .nu = dim->nu,
                          .ny = dim->ny,
                          .nz = dim->nz,
                          .ahead = (size_t)ahead};
    d->s.n = d->s.ns + dim->nu;
    return 0;
}

static struct lqg *allocate_lqg(struct design *d)
{
    const struct sizes *s = &d->s;
    const struct layout at = lay_out_lqg(s);
    const size_t span = s->n + s->ny + s->nz;
    struct lqg *q = calloc(1, sizeof(*q) + (at.end + 2 * s->n + s->ny) * sizeof(q->k[0]));

    d->memory = d->free = calloc(span + 1, 48 * (span + 1) * sizeof(*d->memory)); /* more than the matrices */
    d->controlled = calloc(s->nz + 1, sizeof(*d->controlled));
    if (!q || !d->memory || !d->controlled) {
        free(q);
        return NULL;
    }
    q->s = *s;
    q->at = at;
    q->before = q->k + at.end;
    q->dy = q->before + s->n;
    q->whole = q->dy + s->ny;
    return q;
}

static int lqg_create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                      struct apc_error *why)
{
    struct design d = {.setup = setup};
    struct apc_error reason = {""};
    struct lqg *q;
    int rc = check_lqg_settings(setup, why);

    if (rc == 0)
        rc = measure_lqg(&d, why);
    if (rc < 0)
        return rc;
    q = allocate_lqg(&d);
    rc = q ? make_lqg(&d, q, &reason) : apc_fail(&reason, APC_ENOMEM, "no memory");
    free(d.memory);
    free(d.controlled);
    *self = q;
    needs->states = d.s.n + 2 * d.s.nu;
    needs->n_ahead = 1 + d.s.ahead;
    return rc < 0 ? apc_fail(why, rc, "law lqg: %s", reason.text) : 0;
}

static void lqg_destroy(void *self)
{
    struct lqg *q = self;

    apc_initial_state_destroy(q->rest);
    apc_linear_destroy(q->model);
    free(q);
}

static int lqg_ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                     struct apc_error *why)
{
    size_t y;
    int rc = check_lqg_settings(setup, why);

    if (rc == 0)
        rc = controlled_measurement(setup, output, &y, why);
    if (rc == 0)
        *p = (struct apc_law_ports){.ny = 1, .nz = 1, .y = {(int)y - 1}, .z = {(int)output}};
    return rc;
}

/* ---- The tick -------------------------------------------------------------------------------- */

static double lqg_row_times(const double *M, size_t row, size_t n, const double *a)
{
    double sum = 0.0;

    for (size_t j = 0; j < n; j++)
        sum += M[row * n + j] * a[j];
    return sum;
}

/* y - y0; of what is Bad, what the estimates say of it. */
static void take_lqg_measurements(const struct apc_law_call *c, const struct lqg *q)
{
    for (size_t i = 0; i < q->s.ny; i++)
        q->dy[i] = apc_status_severity(c->y_status[i]) == APC_SEVERITY_BAD
                       ? lqg_row_times(q->k + q->at.C, i, q->s.n, c->x)
                       : c->y[i] - q->k[q->at.y0 + i];
}

/* H (z - z0), and what the preview adds. */
static double from_setpoints(const struct apc_law_call *c, const struct lqg *q, size_t i)
{
    const size_t nz = q->s.nz;
    const double *H = q->k + q->at.H + i * nz, *z = c->z;
    double sum = 0.0;

    for (size_t j = 0; j < nz; j++)
        sum += H[j] * (z[j] - q->k[q->at.z0 + j]);
    for (size_t k = 0; k < q->s.ahead; k++, z += nz) {
        const double *gain = q->k + q->at.Preview + (k * q->s.nu + i) * nz;

        for (size_t j = 0; j < nz; j++)
            sum += gain[j] * (z[nz + j] - z[j]);
    }
    return sum;
}

/* Output i without its bias. Always evaluated in this order: a law that resumes compares bits. */
static double unbiased(const struct apc_law_call *c, const struct lqg *q, size_t i)
{
    const double *k = q->k;

    return k[q->at.u0 + i] - lqg_row_times(k + q->at.F, i, q->s.n, c->x) -
           lqg_row_times(k + q->at.G, i, q->s.ny, q->dy) + from_setpoints(c, q, i);
}

static double *bias(const struct apc_law_call *c, const struct lqg *q)
{
    return c->x + q->s.n;
}

/* What went out last, for its rate: a restart must find it where the estimates are. */
static double *last_lqg_output(const struct apc_law_call *c, const struct lqg *q)
{
    return c->x + q->s.n + q->s.nu;
}

/* Begin the states from y alone; what is known of the disturbances stays. With a model of its own: at rest,
 * with
 * @p u. */
static void restart(const struct apc_law_call *c, const struct lqg *q, const double *u)
{
    if (q->rest) {
        apc_initial_state_find(q->rest, c->y, u, q->whole);
        for (size_t i = 0; i < q->s.n; i++)
            c->x[i] = q->whole[i] - q->model->x0[i];
        return;
    }
    for (size_t i = 0; i < q->s.ny; i++)
        q->dy[i] = c->y[i] - q->k[q->at.y0 + i];
    for (size_t i = 0; i < q->s.nx; i++)
        c->x[i] = lqg_row_times(q->k + q->at.Start, i, q->s.ny, q->dy);
}

static void lqg_reset(struct apc_law_call *c)
{
    const struct lqg *q = c->self;
    unsigned limited = 0;

    restart(c, q, q->k + q->at.u0);
    for (size_t i = 0; i < q->s.nu; i++) {
        const double *p = c->tuning + i * N_TUNING;

        last_lqg_output(c, q)[i] = apc_law_cut(q->k[q->at.u0 + i], p[U_MIN], p[U_MAX], &limited);
    }
}

static int lqg_compute(struct apc_law_call *c)
{
    const struct lqg *q = c->self;

    take_lqg_measurements(c, q);
    for (size_t i = 0; i < q->s.nu; i++) {
        const double *p = c->tuning + i * N_TUNING, step = p[DU_MAX] * c->Ts;
        double u = apc_law_cut(unbiased(c, q, i) + bias(c, q)[i], p[U_MIN], p[U_MAX], &c->limited[i]);

        c->u[i] = step > 0.0 ? apc_law_cut(u, last_lqg_output(c, q)[i] - step,
                                           last_lqg_output(c, q)[i] + step, &c->limited[i])
                             : u;
    }
    return APC_LAW_GOOD;
}

static void lqg_update(struct apc_law_call *c)
{
    const struct lqg *q = c->self;
    const double *k = q->k;

    take_lqg_measurements(c, q);
    memcpy(q->before, c->x, q->s.n * sizeof(*q->before));
    for (size_t i = 0; i < q->s.n; i++) {
        double driven = 0.0;

        for (size_t j = 0; j < q->s.nu; j++)
            driven += k[q->at.Drive + i * q->s.nu + j] * (c->u[j] - k[q->at.u0 + j]);
        c->x[i] = lqg_row_times(k + q->at.Next, i, q->s.n, q->before) +
                  lqg_row_times(k + q->at.Gain, i, q->s.ny, q->dy) + driven;
    }
    for (size_t i = 0; i < q->s.nu; i++) {
        double *b = &bias(c, q)[i], tau = c->tuning[i * N_TUNING + TAU_B];

        *b -= c->Ts < tau ? c->Ts / tau * *b : *b;
        last_lqg_output(c, q)[i] = c->u[i];
    }
}

static void lqg_track(struct apc_law_call *c)
{
    const struct lqg *q = c->self;

    if (c->gap) {
        restart(c, q, c->u);
        for (size_t i = q->s.nx; i < q->s.ns; i++)
            c->x[i] = c->u[i - q->s.nx] - q->k[q->at.u0 + i - q->s.nx];
    }
    take_lqg_measurements(c, q);
    for (size_t i = 0; i < q->s.nu; i++) {
        if (c->out[i] != APC_OUT_LAW)
            bias(c, q)[i] = c->u[i] - unbiased(c, q, i);
        last_lqg_output(c, q)[i] = c->u[i];
    }
}

static int lqg_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_lqg, setup, p, U_MIN, U_MAX, why);
}

const struct apc_law apc_law_lqg = {
    .abi = APC_LAW_ABI,
    .name = "lqg",
    .description = "state feedback with an observer that estimates disturbances, for all outputs together",
    .whole = true,
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .reset = lqg_reset,
    .compute = lqg_compute,
    .update = lqg_update,
    .track = lqg_track,
    .settings = settings,
    .ports = lqg_ports,
    .create = lqg_create,
    .destroy = lqg_destroy,
    .check = lqg_check_tuning,
};
