/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * While an output waits for its new value the plant has the former one: that is a pulse added to its input,
 * as high as the output's move. With M of the plant's periods in one of the controller, each may hold a pulse
 * or not. Let T(w) [M] be what of a pulse in each comes back into the output: as long as |T(w)| |exp(i w) -
 * 1| sqrt(M J) < 1 at all frequencies no pattern of pulses feeds itself, J being, for delays up to N + g
 * periods, N^2 + 2 N g + g (Kao and Lincoln, 2004).
 */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "apclinear.h"
struct pulses {
    struct machine machine;
    size_t of, M, n;
    double *map;  /* [n * n] */
    double *Z;    /* [n * M] where a pulse in each of the plant's periods leads to at the end of the period */
    double *read; /* [n] what the output is to be, of the state at the beginning */
    double *direct;    /* [M] and of the pulses before it */
    double *to;        /* where it is read into */
    double complex *A; /* [n * (n + 1)] */
};

static void read_slot(void *ctx, const struct step *step, const double *slot, double *acting)
{
    struct pulses *p = ctx;

    if (step->number == p->of && p->to)
        memcpy(p->to, slot, (p->to == p->read ? p->n : p->M) * sizeof(*slot));
    memcpy(acting, slot, (p->to == p->read ? p->n : p->M) * sizeof(*slot));
}

/* All M pulses at once, each a column: the k-th in the plant's period that begins at a STEP_KICK. */
static int send_pulses(struct pulses *p, const double *kick)
{
    const struct apc_loop_plant *plant = &p->machine.loop->setup.plant;
    struct ride ride = {.Z = p->Z, .width = p->M, .cut = read_slot, .ctx = p};
    size_t k = 0;

    p->to = p->direct;
    for (size_t i = 0; i < p->machine.n_steps; i++) {
        const struct step *s = &p->machine.step[i];

        if (s->kind == STEP_KICK && k++ > 0) { /* the one before has ended */
            for (size_t j = 0; j < plant->nx; j++)
                p->Z[j * p->M + k - 2] += kick[j];
        }
        machine_step(&p->machine, s, &ride);
    }
    for (size_t j = 0; j < plant->nx && k == p->M; j++)
        p->Z[j * p->M + p->M - 1] += kick[j];
    return k == p->M ? 0 : APC_EINVAL;
}

static double pulse_gain(const struct pulses *p, double angle)
{
    double complex *A = p->A, *X = A + p->n * p->n;
    double sum = 0.0;

    for (size_t i = 0; i < p->n * p->n; i++) /* transposed: read (z - map)^-1 */
        A[i] = (i % (p->n + 1) == 0 ? apc_complex(apc_cos(angle), apc_sin(angle)) : 0.0) -
               p->map[i % p->n * p->n + i / p->n];
    for (size_t i = 0; i < p->n; i++)
        X[i] = p->read[i];
    if (complex_solve(p->n, 1, A, X))
        return HUGE_VAL;
    for (size_t k = 0; k < p->M; k++) {
        double complex t = p->direct[k];

        for (size_t i = 0; i < p->n; i++)
            t += X[i] * p->Z[i * p->M + k];
        sum += creal(t) * creal(t) + cimag(t) * cimag(t);
    }
    return 2.0 * fabs(apc_sin(angle / 2.0)) * sqrt(sum);
}

static int pulses_ready(struct pulses *p, const struct apc_loop *loop)
{
    const struct apc_loop_plant *plant = &loop->setup.plant;
    struct ride ride = {.width = p->n, .cut = read_slot, .ctx = p};
    double *A = calloc((plant->nx + p->n) * (plant->nx + plant->nu) + 1, sizeof(*A)), *B, *kick;
    int rc;

    if (!A)
        return APC_ENOMEM;
    B = A + plant->nx * plant->nx;
    kick = B + plant->nx * plant->nu;
    rc = plant->nx ? apc_linear_sample(plant->nx, plant->nu, plant->A, plant->B, apc_ns_to_s(plant->period),
                                       A, B, NULL)
                   : 0;
    for (size_t j = 0; j < plant->nx; j++)
        kick[j] = B[j * plant->nu + loop->to[p->of]];
    for (size_t i = 0; i < p->n; i++)
        p->map[i * p->n + i] = 1.0;
    ride.Z = p->map;
    p->to = p->read;
    if (rc == 0)
        rc = machine_ride(&p->machine, &ride);
    if (rc == 0)
        rc = machine_widen(&p->machine, p->M);
    if (rc == 0)
        rc = send_pulses(p, kick);
    free(A);
    return rc;
}

static int pulse_gain_at(void *ctx, double w, double *gain)
{
    const struct pulses *p = ctx;

    *gain = pulse_gain(p, w * apc_ns_to_s(p->machine.loop->setup.period));
    return 0;
}

static int worst_gain(struct pulses *p, const double complex *root, size_t n, double *worst)
{
    const double period = apc_ns_to_s(p->machine.loop->setup.period);
    double *gain = NULL, at;
    struct frequency_grid grid;
    int rc = frequency_grid_create(&grid, period, M_PI / period, root, n);

    if (rc == 0 && !(gain = calloc(grid.n, sizeof(*gain))))
        rc = APC_ENOMEM;
    for (size_t k = 0; k < grid.n && rc == 0; k++)
        rc = pulse_gain_at(p, grid.w[k], &gain[k]);
    if (rc == 0)
        rc = frequency_grid_top(&grid, gain, pulse_gain_at, p, worst, &at);
    free(gain);
    frequency_grid_free(&grid);
    return rc;
}

static double jitter_of(double allowed, size_t M, double T)
{
    const double J = allowed / (double)M, N = floor(sqrt(J));

    return allowed < HUGE_VAL ? (N + (J - N * N) / (2.0 * N + 1.0)) * T : HUGE_VAL;
}

int jitter_margin(const struct apc_loop *loop, size_t of, const double complex *root, size_t n,
                  double *jitter)
{
    const struct apc_loop_setup *s = &loop->setup;
    const struct schedule schedule = {.period = s->period, .n = s->n_ticks, .tick = s->tick, .kicks = true};
    struct pulses p = {.of = of, .M = (size_t)(s->period / s->plant.period)};
    double worst = 0.0;
    size_t ticks = 0;
    int rc;

    *jitter = (double)NAN;
    for (size_t k = 0; k < s->n_ticks; k++)
        ticks += s->tick[k].controller == loop->owner[of];
    if (ticks != 1 || loop->to[of] == APC_LOOP_NOWHERE || s->period % s->plant.period != 0)
        return 0;
    rc = machine_create(&p.machine, loop, &schedule, NULL);
    p.n = p.machine.n;
    p.map = rc == 0 ? calloc(p.n * p.n + p.n * p.M + p.n + p.M, sizeof(*p.map)) : NULL;
    p.A = rc == 0 ? calloc(p.n * (p.n + 1), sizeof(*p.A)) : NULL;
    if (rc == 0 && (!p.map || !p.A))
        rc = APC_ENOMEM;
    if (rc == 0) {
        p.Z = p.map + p.n * p.n;
        p.read = p.Z + p.n * p.M;
        p.direct = p.read + p.n;
        rc = pulses_ready(&p, loop);
    }
    if (rc == 0)
        rc = worst_gain(&p, root, n, &worst);
    if (rc == 0)
        *jitter = jitter_of(worst > 0.0 ? 1.0 / (worst * worst) : HUGE_VAL, p.M, apc_ns_to_s(s->period));
    free(p.A);
    free(p.map);
    machine_free(&p.machine);
    return rc == APC_EINVAL ? 0 : rc;
}
