/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A tick of law mpc beside the quadratic program within it: 2 inputs, 20 samples, a move each, limits and
 * rates, in closed loop with setpoint steps and noise. This program's apc_qp_solve stands before the
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

enum { NX = 4, NY = 2, NU = 2, TICKS = 4000, N = 20 };

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

static double quantile(double *v, double share)
{
    qsort(v, TICKS, sizeof *v, compare);
    return v[(size_t)(share * (TICKS - 1))];
}

int main(void)
{
    static const double A[NX * NX] = {-0.016, 0, 0.042,  0, 0, -0.011, 0, 0.033,
                                      0,      0, -0.042, 0, 0, 0,      0, -0.033};
    static const double B[NX * NU] = {0.083, 0, 0, 0.063, 0, 0.048, 0.031, 0};
    static const double C[NY * NX] = {0.5, 0, 0, 0, 0, 0.5, 0, 0}, D[NY * NU];
    static const double x0[NX] = {12.0, 13.0, 1.6, 1.4}, u0[NU] = {3.0, 3.0}, y0[NY] = {6.0, 6.5};
    const struct apc_law_plant plant = {
        .nx = NX, .A = A, .B = B, .C = C, .D = D, .x0 = x0, .u0 = u0, .y0 = y0};
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = NX,
                                               .nu = NU,
                                               .ny = NY,
                                               .A = A,
                                               .B = B,
                                               .C = C,
                                               .x0 = x0,
                                               .u0 = u0,
                                               .y0 = y0};
    double ones[N], horizon = N, noise[] = {0.01, 0.01};
    const struct apc_setting setting[] = {{.name = "horizon", .rows = 1, .columns = 1, .value = &horizon},
                                          {.name = "blocks", .rows = 1, .columns = N, .value = ones},
                                          {.name = "y_noise", .rows = 1, .columns = NY, .value = noise}};
    const struct apc_law *law = &apc_law_mpc;
    struct apc_law_setup setup = {.size = sizeof setup,
                                  .dim = {.ny = NY, .nz = NY, .nu = NU},
                                  .Ts = 1.0,
                                  .n_setting = 3,
                                  .setting = setting,
                                  .plant = &plant};
    struct apc_law_needs needs = {.size = sizeof needs};
    struct apc_linear *real;
    struct apc_random random;
    struct apc_error why;
    void *self;
    double state[NX], next[NX], y[NY], u[NU] = {3.0, 3.0}, last[NU] = {3.0, 3.0}, z[(N + 1) * NY], tuning[64];
    const double low[NU] = {0.0, 0.0}, high[NU] = {10.0, 10.0}, rate[NU] = {0.5, 0.5};
    const double none_low[NY] = {-HUGE_VAL, -HUGE_VAL}, none_high[NY] = {HUGE_VAL, HUGE_VAL};
    const apc_status good[NY] = {APC_GOOD, APC_GOOD};
    const bool new[NY] = {true, true};
    const enum apc_law_output out[NU] = {APC_OUT_LAW, APC_OUT_LAW};
    unsigned limited[NU];
    char text[APC_LAW_WHY];
    double *tick = allocate(TICKS, sizeof *tick), *part = allocate(TICKS, sizeof *part),
           *share = allocate(TICKS, sizeof *share), *published;

    for (size_t i = 0; i < N; i++)
        ones[i] = 1.0;
    if (apc_linear_from_continuous(&real, &from, 1.0, &why) < 0 ||
        law->create(&setup, &needs, &self, &why) < 0)
        die("%s", why.text);
    published = allocate(NY * N + NU * N + 64, sizeof *published);
    for (size_t i = 0; i < apc_law_parameters(law, &setup.dim); i++)
        tuning[i] = law->tuning[apc_law_parameter_at(law, &setup.dim, i).number].initial;
    struct apc_law_call c = {.size = sizeof c,
                             .dim = setup.dim,
                             .Ts = 1.0,
                             .y = y,
                             .z = z,
                             .tuning = tuning,
                             .x = allocate(needs.states, sizeof(double)),
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
    memcpy(state, x0, sizeof state);
    apc_linear_output(real, state, u, y);
    law->reset(&c);
    apc_random_init(&random, 1, "bench");
    for (size_t k = 0; k < TICKS; k++) {
        for (size_t i = 0; i <= N; i++) {
            z[i * NY] = (k + i) / 100 % 2 ? 7.0 : 6.0;
            z[i * NY + 1] = (k + i) / 150 % 2 ? 6.0 : 6.5;
        }
        y[0] += 0.01 * apc_random_normal(&random);
        y[1] += 0.01 * apc_random_normal(&random);
        memset(limited, 0, sizeof limited);
        inside = 0;
        const uint64_t begin = now();
        if (law->compute(&c) > APC_LAW_LATE)
            die("tick %zu: %s", k, text);
        law->update(&c);
        tick[k] = (double)(now() - begin) / 1e3;
        part[k] = (double)inside / 1e3;
        share[k] = tick[k] / part[k];
        apc_linear_next(real, state, u, next);
        memcpy(state, next, sizeof state);
        memcpy(last, u, sizeof last);
        apc_linear_output(real, state, u, y);
    }
    printf("mpc, 2 x 20, %d ticks    median us    p99 us\n", TICKS);
    printf("tick                     %9.1f %9.1f\n", quantile(tick, 0.5), quantile(tick, 0.99));
    printf("its QPs                  %9.1f %9.1f\n", quantile(part, 0.5), quantile(part, 0.99));
    printf("tick / QPs               %9.2f\n", quantile(share, 0.5));
    law->destroy(self);
    apc_linear_destroy(real);
    free(c.x);
    free(published);
    free(share);
    free(part);
    free(tick);
    return 0;
}
