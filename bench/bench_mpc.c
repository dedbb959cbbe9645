/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A tick of law mpc beside the quadratic program within it: a move each sample, limits and rates, in closed
 * loop with setpoint steps and noise, of two inputs over 20 samples and of ten over 40. This program's apc_qp_solve stands before the
 * library's and takes its time.
 */
#include <dlfcn.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apccontrol.h>
#include <apclinear.h>
#include <apcqp.h>

#include "bench.h"

static uint64_t inside; /* ns of the QPs of this tick */

static uint64_t now(void)
{
    return (uint64_t)apc_clock_mono(NULL);
}

int apc_qp_solve(struct apc_qp *qp, const double *f, const double *low, const double *high, double *x,
                 struct apc_qp_result *result)
{
    static int (*solve)(struct apc_qp *, const double *, const double *, const double *, double *,
                        struct apc_qp_result *);

    if (!solve)
        *(void **)&solve = dlsym(RTLD_NEXT, "apc_qp_solve");
    const uint64_t begin = now();
    int rc = solve(qp, f, low, high, x, result);

    inside += now() - begin;
    return rc;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double quantile(double *v, size_t n, double share)
{
    qsort(v, n, sizeof *v, compare);
    return v[(size_t)(share * (double)(n - 1))];
}

/* A controller of a plant in closed loop. */
struct loop {
    const char *name;
    size_t nx, ny, nu, N, ticks;
    double *A, *B, *C, *D, *x0, *u0, *y0; /* continuous */
    double low, high, rate;
};

static double *repeat(size_t n, double value)
{
    double *v = allocate(n, sizeof *v);

    for (size_t i = 0; i < n; i++)
        v[i] = value;
    return v;
}

static void *copy(size_t n, const double *from)
{
    return memcpy(allocate(n, sizeof *from), from, n * sizeof *from);
}

/* The quadruple tank, linear. */
static struct loop of_tanks(void)
{
    static const double A[] = {-0.016, 0, 0.042, 0, 0, -0.011, 0, 0.033, 0, 0, -0.042, 0, 0, 0, 0, -0.033},
                        B[] = {0.083, 0, 0, 0.063, 0, 0.048, 0.031, 0}, C[] = {0.5, 0, 0, 0, 0, 0.5, 0, 0},
                        x0[] = {12.0, 13.0, 1.6, 1.4}, y0[] = {6.0, 6.5};

    return (struct loop){.name = "2 x 20",
                         .nx = 4,
                         .ny = 2,
                         .nu = 2,
                         .N = 20,
                         .ticks = 4000,
                         .A = copy(16, A),
                         .B = copy(8, B),
                         .C = copy(8, C),
                         .D = repeat(4, 0.0),
                         .x0 = copy(4, x0),
                         .u0 = repeat(2, 3.0),
                         .y0 = copy(2, y0),
                         .low = 0.0,
                         .high = 10.0,
                         .rate = 0.5};
}

/* Each output by two lags from its own input, and by less from all others. */
static struct loop of_area(size_t n, size_t N, const char *name)
{
    struct loop l = {.name = name,
                     .nx = 2 * n,
                     .ny = n,
                     .nu = n,
                     .N = N,
                     .ticks = 1000,
                     .A = repeat(4 * n * n, 0.0),
                     .B = repeat(2 * n * n, 0.0),
                     .C = repeat(2 * n * n, 0.0),
                     .D = repeat(n * n, 0.0),
                     .x0 = repeat(2 * n, 6.0),
                     .u0 = repeat(n, 5.0),
                     .y0 = repeat(n, 6.0),
                     .low = 0.0,
                     .high = 10.0,
                     .rate = 0.5};
    struct apc_random random;

    apc_random_init(&random, 2, "area");
    for (size_t i = 0; i < n; i++) {
        const double pole = 0.05 + 0.1 * apc_random_uniform(&random);

        l.A[i * 2 * n + i] = l.A[(n + i) * 2 * n + n + i] = -pole;
        l.A[i * 2 * n + n + i] = pole;
        l.C[i * 2 * n + i] = 1.0;
        for (size_t j = 0; j < n; j++)
            l.B[(n + i) * n + j] = pole * (i == j ? 1.0 : 0.3 * (apc_random_uniform(&random) - 0.5));
    }
    return l;
}

static void measure(struct loop *l)
{
    const size_t nx = l->nx, ny = l->ny, nu = l->nu, N = l->N;
    const struct apc_law_plant plant = {
        .nx = nx, .A = l->A, .B = l->B, .C = l->C, .D = l->D, .x0 = l->x0, .u0 = l->u0, .y0 = l->y0};
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = nx,
                                               .nu = nu,
                                               .ny = ny,
                                               .A = l->A,
                                               .B = l->B,
                                               .C = l->C,
                                               .x0 = l->x0,
                                               .u0 = l->u0,
                                               .y0 = l->y0};
    double horizon = (double)N, *const ones = repeat(N, 1.0), *const noise = repeat(ny, 0.01);
    const struct apc_setting setting[] = {{.name = "horizon", .rows = 1, .columns = 1, .value = &horizon},
                                          {.name = "blocks", .rows = 1, .columns = N, .value = ones},
                                          {.name = "y_noise", .rows = 1, .columns = ny, .value = noise}};
    const struct apc_law *law = &apc_law_mpc;
    struct apc_law_setup setup = {.size = sizeof setup,
                                  .dim = {.ny = ny, .nz = ny, .nu = nu},
                                  .Ts = 1.0,
                                  .n_setting = 3,
                                  .setting = setting,
                                  .plant = &plant};
    struct apc_law_needs needs = {.size = sizeof needs};
    struct apc_linear *real;
    struct apc_random random;
    struct apc_error why;
    void *self;
    double *const state = copy(nx, l->x0), *const next = repeat(nx, 0.0), *const y = repeat(ny, 0.0),
                  *const u = copy(nu, l->u0), *const last = copy(nu, l->u0),
                  *const z = repeat((N + 1) * ny, 0.0), *const low = repeat(nu, l->low),
                  *const high = repeat(nu, l->high), *const rate = repeat(nu, l->rate),
                  *const none_low = repeat(ny, -HUGE_VAL), *const none_high = repeat(ny, HUGE_VAL);
    apc_status *const good = allocate(ny, sizeof *good);
    bool *const new = allocate(ny, sizeof *new);
    enum apc_law_output *const out = allocate(nu, sizeof *out);
    unsigned *const limited = allocate(nu, sizeof *limited);
    char text[APC_LAW_WHY];
    double *tick = repeat(l->ticks, 0.0), *part = repeat(l->ticks, 0.0), *share = repeat(l->ticks, 0.0);

    for (size_t i = 0; i < ny; i++) {
        good[i] = APC_GOOD;
        new[i] = true;
    }
    for (size_t j = 0; j < nu; j++)
        out[j] = APC_OUT_LAW;
    if (apc_linear_from_continuous(&real, &from, 1.0, &why) < 0 ||
        law->create(&setup, &needs, &self, &why) < 0)
        die("%s", why.text);
    size_t n_published = 0;
    for (size_t i = 0; i < needs.n_published; i++)
        n_published += needs.published[i].length ? needs.published[i].length : 1;
    double *const published = repeat(n_published, 0.0),
                  *const tuning = repeat(apc_law_parameters(law, &setup.dim), 0.0),
                  *const x = repeat(needs.states, 0.0);
    for (size_t i = 0; i < apc_law_parameters(law, &setup.dim); i++)
        tuning[i] = law->tuning[apc_law_parameter_at(law, &setup.dim, i).number].initial;
    struct apc_law_call c = {.size = sizeof c,
                             .dim = setup.dim,
                             .Ts = 1.0,
                             .y = y,
                             .z = z,
                             .tuning = tuning,
                             .x = x,
                             .u = u,
                             .limited = limited,
                             .self = self,
                             .y_status = good,
                             .y_new = new,
                             .n_ahead = needs.n_ahead,
                             .low = low,
                             .high = high,
                             .rate = rate,
                             .y_low = none_low,
                             .y_high = none_high,
                             .u_last = last,
                             .out = out,
                             .published = published,
                             .why = text,
                             .budget = 1.0};
    apc_linear_output(real, state, u, y);
    law->reset(&c);
    apc_random_init(&random, 1, "bench");
    for (size_t k = 0; k < l->ticks; k++) {
        for (size_t i = 0; i <= N; i++) /* the outputs' steps come one after another */
            for (size_t j = 0; j < ny; j++)
                z[i * ny + j] = l->y0[j] + ((k + i) / (100 + 50 * j) % 2 ? (j % 2 ? -0.5 : 1.0) : 0.0);
        for (size_t i = 0; i < ny; i++)
            y[i] += 0.01 * apc_random_normal(&random);
        memset(limited, 0, nu * sizeof *limited);
        inside = 0;
        const uint64_t begin = now();
        if (law->compute(&c) > APC_LAW_LATE)
            die("tick %zu: %s", k, text);
        law->update(&c);
        tick[k] = (double)(now() - begin) / 1e3;
        part[k] = (double)inside / 1e3;
        share[k] = tick[k] / part[k];
        apc_linear_next(real, state, u, next);
        memcpy(state, next, nx * sizeof *state);
        memcpy(last, u, nu * sizeof *last);
        apc_linear_output(real, state, u, y);
    }
    printf("mpc, %s, %zu ticks   median us    p99 us\n", l->name, l->ticks);
    printf("tick                     %9.1f %9.1f\n", quantile(tick, l->ticks, 0.5),
           quantile(tick, l->ticks, 0.99));
    printf("its QPs                  %9.1f %9.1f\n", quantile(part, l->ticks, 0.5),
           quantile(part, l->ticks, 0.99));
    printf("%s: tick / QPs %.2f, p99 of a tick %.3f ms\n", l->name, quantile(share, l->ticks, 0.5),
           quantile(tick, l->ticks, 0.99) / 1e3);
    law->destroy(self);
    apc_linear_destroy(real);
    void *const all[] = {ones,      noise,    state,     next, y,    u,    last,    z,     low,   high,
                         rate,      none_low, none_high, good, new,  out,  limited, tick,  part,  share,
                         published, tuning,   x,         l->A, l->B, l->C, l->D,    l->x0, l->u0, l->y0};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
}

int main(void)
{
    struct loop loop[] = {of_tanks(), of_area(10, 40, "10 x 40")};

    for (size_t i = 0; i < sizeof loop / sizeof *loop; i++)
        measure(&loop[i]);
    return 0;
}
