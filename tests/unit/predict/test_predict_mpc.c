/* SPDX-License-Identifier: BSD-3-Clause */
/* The problem of predictive control: against the regulator it must be without limits, against its own cost,
 * counted step by step, with them, and in closed loop. */
#include "check.h"
#include "predict/mpc.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define COUNTING 0 /* sanitizers bring their own allocator */
#else
#define COUNTING 1
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
#endif
static int allocations;

#if COUNTING
void *malloc(size_t size)
{
    allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    allocations++;
    return __libc_calloc(n, size);
}
#endif

#define SEED 20260813u

enum { N = 24, NU = 2, NY = 2, NX_MOST = 24, MOVES_MOST = N * NU };

static const unsigned each_sample[N] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
                                        1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
static const unsigned blocks[] = {1, 1, 2, 4, 8, 8};
static const bool yes[] = {true, true};

/* Two inputs that both move two outputs, one of them late; two unknown disturbances at the outputs; d moves
 * y1. */
static struct apc_linear *process(void)
{
    const struct apc_transfer g[] = {
        {.gain = 2.0, .tau = {6.0, 0.0}},  {.gain = 0.7, .tau = {9.0, 3.0}, .dead_time = 1.5},
        {.gain = -1.0, .tau = {4.0, 0.0}}, {.gain = 0.5, .tau = {8.0, 0.0}},
        {.gain = 1.5, .tau = {5.0, 0.0}},  {.gain = 0.0},
    };
    const struct apc_linear_unknown unknown[] = {{APC_AT_OUTPUT, 0}, {APC_AT_OUTPUT, 1}};
    const double u0[] = {5.0, 4.0, 0.0}, y0[] = {20.0, 30.0};
    struct apc_linear *from, *model;
    struct apc_error why;

    assert_int_equal(apc_linear_from_transfer(&from, NY, NU, 1, g, u0, y0, 1.0, &why), 0);
    assert_int_equal(apc_linear_disturb(&model, from, unknown, 2, &why), 0);
    apc_linear_destroy(from);
    assert_true(model->nx <= NX_MOST);
    return model;
}

/* Everything that a call needs, at rest at the operating point, within wide limits. */
struct scene {
    struct apc_linear *model;
    struct apc_mpc *mpc;
    double q[NY], s[NU], r[NU], zone[NY];
    double x[NX_MOST], w[(N + 1) * NY], d[N + 1], u_last[NU], reference[NU], low[NU], high[NU], step[NU],
        y_low[NY], y_high[NY];
    bool given[NU];
    struct apc_mpc_call call;
    size_t n;
};

static void begin(struct scene *s, const struct apc_mpc_options *options)
{
    struct apc_mpc_options o = *options;
    struct apc_error why;

    *s = (struct scene){.q = {1.0, 0.5},
                        .s = {2.0, 3.0},
                        .low = {-50.0, -50.0},
                        .high = {60.0, 60.0},
                        .step = {(double)INFINITY, (double)INFINITY},
                        .y_low = {-1e6, -1e6},
                        .y_high = {1e6, 1e6}};
    s->model = o.model ? NULL : process();
    if (s->model)
        o.model = s->model;
    else
        s->model = (struct apc_linear *)(uintptr_t)o.model;
    if (!o.horizon)
        o.horizon = N;
    if (apc_mpc_create(&s->mpc, &o, &why) != 0)
        fail_msg("%s", why.text);
    s->n = o.blocks * NU;
    memcpy(s->x, s->model->x0, s->model->nx * sizeof(double));
    for (size_t i = 0; i <= N; i++)
        memcpy(s->w + i * NY, s->model->y0, sizeof(double[NY]));
    memcpy(s->u_last, s->model->u0, sizeof s->u_last);
    memcpy(s->reference, s->model->u0, sizeof s->reference);
    s->call = (struct apc_mpc_call){.x = s->x,
                                    .w = s->w,
                                    .d = s->d,
                                    .u_last = s->u_last,
                                    .u_reference = s->reference,
                                    .low = s->low,
                                    .high = s->high,
                                    .step = s->step,
                                    .y_low = s->y_low,
                                    .y_high = s->y_high,
                                    .given = s->given};
}

static void tune(struct scene *s)
{
    const struct apc_mpc_weights weights = {.q = s->q, .s = s->s, .r = s->r, .zone = s->zone};
    struct apc_error why;

    if (apc_mpc_tune(s->mpc, &weights, &why) != 0)
        fail_msg("%s", why.text);
}

static void end(struct scene *s)
{
    apc_mpc_destroy(s->mpc);
    apc_linear_destroy(s->model);
}

static void set_point(struct scene *s, double w1, double w2)
{
    for (size_t i = 0; i <= N; i++) {
        s->w[i * NY] = w1;
        s->w[i * NY + 1] = w2;
    }
}

static struct apc_mpc_result solve(struct scene *s, double *plan)
{
    struct apc_mpc_result result;

    apc_mpc_solve(s->mpc, &s->call, plan, &result);
    if (result.rc != 0)
        fail_msg("not solved: %s", apc_err_name(result.rc));
    return result;
}

/* One sample on, with u. */
static void act(struct scene *s, const double *u)
{
    const double all[] = {u[0], u[1], s->d[0]};
    double next[NX_MOST];

    apc_linear_next(s->model, s->x, all, next);
    memcpy(s->x, next, s->model->nx * sizeof(double));
    memcpy(s->u_last, u, sizeof s->u_last);
}

static void measured(const struct scene *s, double *y)
{
    const double all[] = {s->u_last[0], s->u_last[1], s->d[0]};

    apc_linear_output(s->model, s->x, all, y);
}

/* ---- Against the regulator ----------------------------------------------------------------------- */

/* Promise(laws/mpc) */
static void without_limits_it_is_the_regulator_of_an_endless_horizon(void **state)
{
    const struct apc_mpc_options options = {.blocks = N, .block = each_sample, .terminal = true};
    struct apc_random random;
    struct scene s;
    struct apc_error why;
    (void)state;

    begin(&s, &options);
    s.r[1] = 0.3;
    tune(&s);
    const struct apc_linear *m = s.model;
    const size_t nc = m->nx_plant + m->nx_held, na = nc + NU;
    double *A = calloc(3 * na * na + 2 * na * NU, sizeof *A), *Q = A + na * na, *P = Q + na * na,
           *B = P + na * na, *K = B + na * NU, R[NU * NU] = {s.s[0], 0.0, 0.0, s.s[1]};
    for (size_t i = 0; i < nc; i++) {
        memcpy(A + i * na, m->A + i * m->nx, nc * sizeof *A);
        for (size_t j = 0; j < NU; j++)
            A[i * na + nc + j] = B[i * NU + j] = m->B[i * 3 + j];
        for (size_t k = 0; k < nc; k++) {
            for (size_t c = 0; c < NY; c++)
                Q[i * na + k] += s.q[c] * m->C[c * m->nx + i] * m->C[c * m->nx + k];
        }
    }
    for (size_t j = 0; j < NU; j++) {
        A[(nc + j) * na + nc + j] = B[(nc + j) * NU + j] = 1.0;
        Q[(nc + j) * na + nc + j] = s.r[j];
    }
    assert_int_equal(apc_riccati_solve(na, NU, A, B, Q, R, P, K, &why), 0);
    apc_random_init(&random, SEED, "regulator");
    for (int round = 0; round < 50; round++) {
        double plan[MOVES_MOST], target_y[NY], target_u[NU], at_rest[NX_MOST], expected[NU];
        struct apc_mpc_result result;

        for (size_t i = 0; i < m->nx; i++)
            s.x[i] = m->x0[i] + apc_random_normal(&random);
        for (size_t j = 0; j < NU; j++)
            s.u_last[j] = m->u0[j] + apc_random_normal(&random);
        set_point(&s, 20.0 + apc_random_normal(&random), 30.0 + apc_random_normal(&random));
        memcpy(s.reference, s.u_last, sizeof s.reference);
        result = solve(&s, plan);
        assert_true(result.reachable);
        apc_mpc_target(s.mpc, N, target_y, target_u);
        assert_near(target_y[0], s.w[0], 1e-8);
        assert_near(target_y[1], s.w[1], 1e-8);
        /* the steady state of that u, by waiting for it */
        memcpy(at_rest, m->x0, m->nx * sizeof *at_rest);
        for (int k = 0; k < 400; k++) {
            const double all[] = {target_u[0], target_u[1], 0.0};
            double next[NX_MOST];

            apc_linear_next(m, at_rest, all, next);
            memcpy(at_rest, next, m->nx * sizeof *at_rest);
        }
        for (size_t j = 0; j < NU; j++) {
            expected[j] = s.u_last[j];
            for (size_t i = 0; i < nc; i++)
                expected[j] -= K[j * na + i] * (s.x[i] - at_rest[i]);
            for (size_t i = 0; i < NU; i++)
                expected[j] -= K[j * na + nc + i] * (s.u_last[i] - target_u[i]);
            assert_near(plan[j], expected[j], 1e-7);
        }
        /* its cost is what is left of the regulator's, without that of the present */
        double away[NX_MOST], left = 0.0, predicted[N * NY];

        for (size_t i = 0; i < na; i++)
            away[i] = i < nc ? s.x[i] - at_rest[i] : s.u_last[i - nc] - target_u[i - nc];
        for (size_t i = 0; i < na * na; i++)
            left += 0.5 * away[i / na] * (P[i] - Q[i]) * away[i % na];
        assert_near(apc_mpc_predict(s.mpc, plan, predicted), left, 1e-8 * (1.0 + left));
    }
    free(A);
    end(&s);
}

/* ---- Against its own cost ------------------------------------------------------------------------ */

/* The sum that the header defines, counted along a simulation; infinite where a hard limit is broken. */
static double cost(const struct scene *s, const double *plan)
{
    const struct apc_linear *m = s->model;
    double x[NX_MOST], next[NX_MOST], y[NY], sum = 0.0;
    const double *before = s->u_last;

    memcpy(x, s->x, m->nx * sizeof *x);
    for (size_t i = 0; i <= N; i++) {
        const double *u = apc_mpc_move(s->mpc, plan, i < N ? i : N - 1);
        const double all[] = {u[0], u[1], s->d[i]};

        apc_linear_output(m, x, all, y);
        for (size_t c = 0; c < NY && i > 0; c++) {
            double target[NY], of_u[NU], beyond;

            apc_mpc_target(s->mpc, i, target, of_u);
            beyond = fmax(fabs(y[c] - s->w[i * NY + c]) - s->zone[c], 0.0);
            sum += s->q[c] / 2.0 *
                   (s->zone[c] > 0.0 ? beyond * beyond : (y[c] - target[c]) * (y[c] - target[c]));
            if (y[c] < s->y_low[c] - 1e-6 || y[c] > s->y_high[c] + 1e-6)
                return (double)INFINITY;
        }
        if (u != before) {
            double target[NY], of_u[NU];

            apc_mpc_target(s->mpc, i > 0 ? i : 1, target, of_u);
            for (size_t j = 0; j < NU; j++) {
                const double move = u[j] - before[j];

                sum += s->s[j] / 2.0 * move * move + s->r[j] / 2.0 * (u[j] - of_u[j]) * (u[j] - of_u[j]);
                if (u[j] < s->low[j] - 1e-9 || u[j] > s->high[j] + 1e-9 || fabs(move) > s->step[j] + 1e-9)
                    return (double)INFINITY;
            }
        }
        before = u;
        apc_linear_next(m, x, all, next);
        memcpy(x, next, m->nx * sizeof *x);
    }
    return sum;
}

/* Promise(laws/mpc) */
static void no_other_plan_costs_less(void **state)
{
    const struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .limits = yes, .zone = yes, .rate = yes};
    struct apc_random random;
    struct scene s;
    int limited = 0;
    (void)state;

    apc_random_init(&random, SEED, "plans");
    for (int round = 0; round < 60; round++) {
        double plan[MOVES_MOST], other[MOVES_MOST], predicted[N * NY], least;
        struct apc_mpc_result result;

        begin(&s, &options);
        s.zone[0] = round % 3 == 0 ? 0.5 : 0.0;
        s.r[0] = round % 2 ? 0.2 : 0.0;
        tune(&s);
        for (size_t j = 0; j < NU; j++) {
            s.low[j] = s.model->u0[j] - 2.0;
            s.high[j] = s.model->u0[j] + 2.0;
            s.step[j] = 0.5 + apc_random_uniform(&random);
        }
        set_point(&s, 20.0 + 3.0 * apc_random_normal(&random), 30.0 + 2.0 * apc_random_normal(&random));
        for (size_t c = 0; c < NY; c++) {
            s.y_low[c] = s.model->y0[c] - 2.5;
            s.y_high[c] = s.model->y0[c] + 2.5;
        }
        for (size_t i = N / 2; i <= N; i++)
            s.d[i] = 0.3 * apc_random_normal(&random);
        result = solve(&s, plan);
        assert_int_equal(result.given_up, 0);
        limited += result.iterations > 0;
        least = cost(&s, plan);
        assert_true(isfinite(least));
        assert_near(apc_mpc_predict(s.mpc, plan, predicted), least, 1e-9 * (1.0 + least));
        for (int trial = 0; trial < 400; trial++) {
            const double size = pow(10.0, -4.0 * apc_random_uniform(&random));

            for (size_t k = 0; k < s.n; k++) {
                const double low = s.low[k % NU], high = s.high[k % NU];

                other[k] = fmin(fmax(plan[k] + size * apc_random_normal(&random), low), high);
            }
            assert_true(cost(&s, other) >= least - 1e-7 * (1.0 + least));
        }
        end(&s);
    }
    assert_true(limited > 30); /* else this looked at nothing */
}

/* The limits of which apc_mpc_multipliers() tells, in its order, by rounds that it held a plan back in. */
enum { LOW_U, HIGH_U, FALLS, RISES, LOW_Y, HIGH_Y, LIMITS };

static double *limit_at(struct scene *s, int limit, size_t k)
{
    double *const all[LIMITS] = {s->low, s->high, s->step, s->step, s->y_low, s->y_high};
    return all[limit] + k;
}

/* What the best plan costs when a limit is by so much wider. */
static double cost_if_wider(struct scene *s, int limit, size_t k, double by)
{
    const double outwards = limit == LOW_U || limit == LOW_Y ? -by : by, before = *limit_at(s, limit, k);
    double plan[MOVES_MOST], predicted[N * NY];

    *limit_at(s, limit, k) = before + outwards;
    assert_true(solve(s, plan).reachable);
    *limit_at(s, limit, k) = before;
    return apc_mpc_predict(s->mpc, plan, predicted);
}

/*
 * Two ways, of which neither knows the solver: the cost's own gradient, in a plan that only limits of outputs hold
 * back, is what their multipliers add; and of each limit the multiplier is what the plan costs less when it gives
 * way, which includes rows of measurements and rates.
 */
static void a_multiplier_is_what_a_limit_costs(void **state)
{
    const struct apc_mpc_options free_rows = {.blocks = sizeof blocks / sizeof *blocks, .block = blocks};
    const struct apc_mpc_options all_rows = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .limits = yes, .rate = yes};
    struct apc_random random;
    struct scene s;
    int held[LIMITS] = {0};
    (void)state;

    apc_random_init(&random, SEED, "multipliers");
    for (int round = 0; round < 60; round++) {
        const bool rows = round % 2;
        double plan[MOVES_MOST], predicted[N * NY], u[4 * NU], y[2 * NY], slope[2 * NU] = {0.0};

        begin(&s, rows ? &all_rows : &free_rows);
        tune(&s);
        for (size_t j = 0; j < NU; j++) {
            s.low[j] = s.model->u0[j] - 2.0;
            s.high[j] = s.model->u0[j] + 2.0;
            s.step[j] = rows ? 0.5 + apc_random_uniform(&random) : (double)INFINITY;
        }
        set_point(&s, 20.0 + 2.5 * apc_random_normal(&random), 30.0 + 1.5 * apc_random_normal(&random));
        for (size_t c = 0; rows && c < NY; c++) {
            s.y_low[c] = fmin(s.w[c], s.model->y0[c]) - 0.05;
            s.y_high[c] = fmax(s.w[c], s.model->y0[c]) + 0.05;
        }
        const struct apc_mpc_result result = solve(&s, plan);
        apc_mpc_multipliers(s.mpc, u, y);
        for (size_t k = 0; k < s.n && !rows; k++) {
            double aside[MOVES_MOST];

            memcpy(aside, plan, sizeof aside);
            aside[k] = plan[k] + 1.0;
            const double more = apc_mpc_predict(s.mpc, aside, predicted);
            aside[k] = plan[k] - 1.0;
            const double gradient = (more - apc_mpc_predict(s.mpc, aside, predicted)) / 2.0;
            slope[gradient < 0.0 ? NU + k % NU : k % NU] += fabs(gradient);
        }
        for (size_t k = 0; k < sizeof slope / sizeof *slope && !rows; k++)
            assert_near(u[k], slope[k], 1e-6 * (1.0 + slope[k]));
        for (int limit = 0; limit < LIMITS && result.reachable && !result.given_up && rows; limit++)
            for (size_t k = 0; k < 2; k++) {
                const double told = limit < LOW_Y ? u[(size_t)limit * NU + k]
                                                  : y[(size_t)(limit - LOW_Y) * NY + k],
                             of_both = limit == FALLS || limit == RISES
                                           ? u[FALLS * NU + k] + u[RISES * NU + k]
                                           : told,
                             step = 1e-5;
                const double less =
                    (cost_if_wider(&s, limit, k, -step) - cost_if_wider(&s, limit, k, step)) / (2.0 * step);

                assert_near(of_both, less, 1e-3 * (1.0 + less));
                held[limit] += told > 1e-3;
            }
        end(&s);
    }
    for (int limit = 0; limit < LIMITS; limit++)
        assert_true(held[limit] > 0); /* else this looked at nothing */
}

/* Promise(laws/measured-disturbances) */
static void what_is_predicted_comes(void **state)
{
    const struct apc_mpc_options options = {.blocks = sizeof blocks / sizeof *blocks, .block = blocks};
    double plan[MOVES_MOST], predicted[N * NY], y[NY];
    struct scene s;
    (void)state;

    begin(&s, &options);
    tune(&s);
    set_point(&s, 23.0, 28.0);
    for (size_t i = 0; i <= N; i++)
        s.d[i] = 0.7;
    s.x[s.model->nx - 1] = 0.4;
    (void)solve(&s, plan);
    apc_mpc_predict(s.mpc, plan, predicted);
    for (size_t i = 0; i < N; i++) {
        act(&s, apc_mpc_move(s.mpc, plan, i));
        measured(&s, y);
        assert_near(predicted[i * NY], y[0], 1e-9);
        assert_near(predicted[i * NY + 1], y[1], 1e-9);
    }
    end(&s);
}

/* ---- Targets ------------------------------------------------------------------------------------- */

static void settle(struct scene *s, int ticks)
{
    double plan[MOVES_MOST];

    for (int k = 0; k < ticks; k++) {
        (void)solve(s, plan);
        act(s, plan);
    }
}

static void a_setpoint_that_can_be_reached_is_reached_whatever_disturbs(void **state)
{
    const struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .terminal = true, .rate = yes};
    struct scene s;
    double y[NY];
    (void)state;

    begin(&s, &options);
    s.r[0] = s.r[1] = 0.1;
    s.step[0] = s.step[1] = 0.4;
    tune(&s);
    set_point(&s, 22.0, 29.0);
    s.x[s.model->nx - 2] = 1.5; /* unknown, at y1 */
    for (size_t i = 0; i <= N; i++)
        s.d[i] = -0.5;
    settle(&s, 250);
    measured(&s, y);
    assert_near(y[0], 22.0, 1e-7);
    assert_near(y[1], 29.0, 1e-7);
    end(&s);
}

static void the_first_rank_keeps_its_setpoint_when_an_input_saturates(void **state)
{
    const unsigned ranks[][NY] = {{1, 2}, {2, 1}};
    (void)state;

    for (size_t first = 0; first < 2; first++) {
        const struct apc_mpc_options options = {
            .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .rank = ranks[first]};
        struct apc_mpc_result result;
        double plan[MOVES_MOST], y[NY];
        struct scene s;

        begin(&s, &options);
        tune(&s);
        s.high[0] = s.model->u0[0] + 0.5;
        set_point(&s, 24.0, 29.0); /* both at once would want more of u1 */
        settle(&s, 200);
        result = solve(&s, plan);
        assert_false(result.reachable);
        measured(&s, y);
        assert_near(y[first], s.w[first], 1e-6);
        assert_true(fabs(y[1 - first] - s.w[1 - first]) > 0.1);
        end(&s);
    }
}

static void a_setpoint_out_of_reach_is_approached(void **state)
{
    const struct apc_mpc_options options = {.blocks = sizeof blocks / sizeof *blocks, .block = blocks};
    struct scene s;
    double y[NY], u[NU];
    (void)state;

    begin(&s, &options);
    tune(&s);
    s.low[0] = s.low[1] = 3.0;
    s.high[0] = s.high[1] = 6.0;
    set_point(&s, 40.0, 30.0);
    settle(&s, 200);
    measured(&s, y);
    /* of all steady states within the limits none has a smaller weighted distance */
    for (u[0] = 3.0; u[0] <= 6.0; u[0] += 0.25) {
        for (u[1] = 3.0; u[1] <= 6.0; u[1] += 0.25) {
            const double y1 = 20.0 + 2.0 * (u[0] - 5.0) + 0.7 * (u[1] - 4.0),
                         y2 = 30.0 + 0.5 * (u[0] - 5.0) + 1.5 * (u[1] - 4.0);

            assert_true(s.q[0] * (y1 - 40.0) * (y1 - 40.0) + s.q[1] * (y2 - 30.0) * (y2 - 30.0) >=
                        s.q[0] * (y[0] - 40.0) * (y[0] - 40.0) + s.q[1] * (y[1] - 30.0) * (y[1] - 30.0) -
                            1e-6);
        }
    }
    end(&s);
}

static void an_integrating_output_is_held(void **state)
{
    const struct apc_transfer g[] = {{.gain = 0.2, .integrating = true, .dead_time = 2.0},
                                     {.gain = -0.1, .integrating = true},
                                     {.gain = 0.0},
                                     {.gain = 1.0, .tau = {3.0, 0.0}}};
    const struct apc_linear_unknown unknown[] = {{APC_AT_INPUT, 0}, {APC_AT_OUTPUT, 1}};
    struct apc_linear *from, *model;
    struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .terminal = true};
    struct scene s;
    struct apc_error why;
    double y[NY];
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&from, NY, NU, 0, g, NULL, NULL, 1.0, &why), 0);
    assert_int_equal(apc_linear_disturb(&model, from, unknown, 2, &why), 0);
    apc_linear_destroy(from);
    options.model = model;
    begin(&s, &options);
    tune(&s);
    set_point(&s, 3.0, -1.0);
    s.x[model->nx - 2] = 0.5;
    settle(&s, 200);
    measured(&s, y);
    assert_near(y[0], 3.0, 1e-6);
    assert_near(y[1], -1.0, 1e-6);
    end(&s);
}

/* ---- Limits of y, ranks, zones -------------------------------------------------------------------- */

static double worst(const struct scene *s, const double *y, size_t c)
{
    double most = 0.0;

    for (size_t i = 0; i < N; i++)
        most = fmax(most, fmax(s->y_low[c] - y[i * NY + c], y[i * NY + c] - s->y_high[c]));
    return most;
}

/* A disturbance lifts both outputs above their limits; u can help one of them only. */
/* Promise(laws/mpc) */
static void limits_are_given_up_by_rank_and_no_further_than_needed(void **state)
{
    const unsigned ranks[][NY] = {{1, 2}, {2, 1}};
    double alone[NY];
    (void)state;

    for (size_t first = 0; first < 2; first++) {
        for (int both = 0; both < 2; both++) {
            const bool one[] = {first == 0 || both, first == 1 || both};
            const struct apc_mpc_options options = {.blocks = sizeof blocks / sizeof *blocks,
                                                    .block = blocks,
                                                    .rank = ranks[first],
                                                    .limits = one};
            struct apc_mpc_result result;
            double plan[MOVES_MOST], y[N * NY];
            struct scene s;

            begin(&s, &options);
            tune(&s);
            s.given[0] = true; /* u2 alone is left: it moves both the same way */
            s.low[1] = s.model->u0[1] - 1.0;
            s.high[1] = s.model->u0[1] + 1.0;
            s.y_high[0] = 19.0;
            s.y_low[1] = 31.0;
            result = solve(&s, plan);
            apc_mpc_predict(s.mpc, plan, y);
            assert_int_not_equal(result.given_up, 0);
            if (!both)
                alone[first] = worst(&s, y, first);
            else
                assert_near(worst(&s, y, first), alone[first], 1e-4);
            for (size_t k = 0; k < s.n; k++)
                assert_true(plan[k] >= s.low[k % NU] && plan[k] <= s.high[k % NU]);
            end(&s);
        }
    }
}

/* A plan all the same, and of moves within their limits and rates, to the last one. */
/*
 * Promise(laws/limits-contradict-never): Limits that contradict each other never leave predictive control
 *   without a plan, nor with moves beyond limits and rates.
 */
static void limits_that_contradict_never_leave_it_without_a_plan(void **state)
{
    const struct apc_mpc_options options = {.blocks = sizeof blocks / sizeof *blocks,
                                            .block = blocks,
                                            .limits = yes,
                                            .rate = yes,
                                            .zone = yes,
                                            .rank = (const unsigned[]){1, 2},
                                            .terminal = true};
    struct apc_random random;
    struct scene s;
    int given_up = 0;
    (void)state;

    apc_random_init(&random, SEED, "contradict");
    begin(&s, &options);
    for (int k = 0; k < 400; k++) {
        const double size = pow(10.0, -4.0 + k % 7);
        double plan[MOVES_MOST] = {0};

        for (size_t i = 0; i < s.model->nx; i++)
            s.x[i] = s.model->x0[i] + size * apc_random_normal(&random);
        for (size_t j = 0; j < NU; j++) {
            s.u_last[j] = s.model->u0[j];
            s.low[j] = s.model->u0[j] - size;
            s.high[j] = s.model->u0[j] + 1e-3 * size;
            s.step[j] = k % 2 ? 0.1 * size : HUGE_VAL;
        }
        for (size_t c = 0; c < NY; c++) { /* of no width, somewhere */
            s.y_low[c] = s.y_high[c] = s.model->y0[c] + size * apc_random_normal(&random);
            s.zone[c] = k % 3 ? 0.0 : 0.1 * size;
        }
        tune(&s);
        given_up += solve(&s, plan).given_up != 0;
        for (size_t i = 0; i < s.n; i++) {
            const size_t j = i % NU;
            const double before = i < NU ? s.u_last[j] : plan[i - NU];

            assert_true(plan[i] >= s.low[j] && plan[i] <= s.high[j]);
            assert_true(fabs(plan[i] - before) <= s.step[j] + 1e-9 * (1.0 + size));
        }
    }
    assert_true(given_up > 300);
    end(&s);
}

static void a_limit_of_y_holds_as_long_as_there_is_a_way(void **state)
{
    const struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .limits = yes, .terminal = true};
    struct apc_mpc_result result;
    double plan[MOVES_MOST], y[NY];
    struct scene s;
    bool touched = false;
    (void)state;

    begin(&s, &options);
    tune(&s);
    s.y_high[0] = 22.0;
    set_point(&s, 25.0, 30.0); /* a setpoint beyond a limit: up to the limit */
    for (int k = 0; k < 60; k++) {
        result = solve(&s, plan);
        assert_int_equal(result.given_up, 0);
        act(&s, plan);
        measured(&s, y);
        assert_true(y[0] <= 22.0 + 1e-6);
        touched = touched || y[0] > 22.0 - 1e-3;
    }
    assert_true(touched);
    settle(&s, 200);
    result = solve(&s, plan);
    assert_false(result.reachable);
    measured(&s, y);
    assert_near(y[0], 22.0, 1e-6);
    assert_near(y[1], 30.0, 1e-6);
    end(&s);
}

static void within_its_zone_y_moves_nothing(void **state)
{
    const struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .zone = yes};
    double plan[MOVES_MOST], y[NY];
    struct scene s;
    (void)state;

    begin(&s, &options);
    s.zone[0] = 2.0;
    s.zone[1] = 1.0;
    tune(&s);
    set_point(&s, 21.5, 29.5);
    (void)solve(&s, plan);
    for (size_t k = 0; k < s.n; k++)
        assert_near(plan[k], s.u_last[k % NU], 1e-9);
    set_point(&s, 25.0, 29.5); /* 23 is near enough */
    for (int k = 0; k < 300; k++) {
        (void)solve(&s, plan);
        memcpy(s.reference, plan, sizeof s.reference);
        act(&s, plan);
    }
    measured(&s, y);
    assert_true(y[0] >= 23.0 - 1e-3 && y[0] <= 27.0 + 1e-3);
    assert_true(y[1] >= 28.5 - 1e-3 && y[1] <= 30.5 + 1e-3);
    end(&s);
}

/* ---- What is known beforehand --------------------------------------------------------------------- */

static void an_input_that_is_given_stays_and_the_other_one_makes_up(void **state)
{
    const struct apc_mpc_options options = {
        .blocks = sizeof blocks / sizeof *blocks, .block = blocks, .rank = (const unsigned[]){1, 2}};
    double plan[MOVES_MOST], y[NY];
    struct scene s;
    (void)state;

    begin(&s, &options);
    tune(&s);
    s.given[1] = true;
    s.u_last[1] = 4.7;
    set_point(&s, 23.0, 30.0);
    for (int k = 0; k < 200; k++) {
        (void)solve(&s, plan);
        for (size_t b = 0; b < s.n / NU; b++)
            assert_near(plan[b * NU + 1], 4.7, 1e-12);
        act(&s, plan);
    }
    measured(&s, y);
    assert_near(y[0], 23.0, 1e-6);
    end(&s);
}

static void a_step_that_is_announced_is_met_half_way(void **state)
{
    const struct apc_mpc_options options = {.blocks = N, .block = each_sample};
    double plan[MOVES_MOST], y[NY];
    struct scene s;
    (void)state;

    begin(&s, &options);
    tune(&s);
    for (size_t i = 8; i <= N; i++)
        s.w[i * NY] = 23.0;
    (void)solve(&s, plan);
    assert_true(fabs(plan[0] - s.u_last[0]) < 0.05); /* eight samples ahead there is time */
    for (size_t i = 1; i <= N; i++) {
        (void)solve(&s, plan);
        act(&s, plan);
        memmove(s.w, s.w + NY, N * NY * sizeof *s.w);
        measured(&s, y);
        if (i == 8)
            assert_true(y[0] > 21.0 && y[0] < 22.5);
    }
    end(&s);
}

/* ---- Every tick ----------------------------------------------------------------------------------- */

static void shake(struct scene *s, struct apc_random *random)
{
    for (size_t i = 0; i < s->model->nx; i++)
        s->x[i] = s->model->x0[i] + 3.0 * apc_random_normal(random);
    set_point(s, 20.0 + 4.0 * apc_random_normal(random), 30.0 + 4.0 * apc_random_normal(random));
    for (size_t j = 0; j < NU; j++)
        s->u_last[j] = s->model->u0[j] + 2.0 * apc_random_normal(random);
}

static void a_plan_depends_on_the_call_alone_and_allocates_nothing(void **state)
{
    const struct apc_mpc_options options = {.blocks = sizeof blocks / sizeof *blocks,
                                            .block = blocks,
                                            .limits = yes,
                                            .rate = yes,
                                            .rank = (const unsigned[]){2, 1},
                                            .terminal = true};
    struct apc_random random;
    struct scene s, fresh;
    int given_up = 0, counted;
    (void)state;

    apc_random_init(&random, SEED, "ticks");
    begin(&s, &options);
    tune(&s);
    for (int k = 0; k < 200; k++) {
        double plan[MOVES_MOST] = {0}, same[MOVES_MOST] = {0};
        struct apc_mpc_result result;

        shake(&s, &random);
        for (size_t j = 0; j < NU; j++) {
            s.low[j] = s.model->u0[j] - 3.0;
            s.high[j] = s.model->u0[j] + 3.0;
            s.step[j] = 0.7;
            s.y_low[j] = s.model->y0[j] - 4.0;
            s.y_high[j] = s.model->y0[j] + 4.0;
        }
        counted = allocations;
        result = solve(&s, plan);
        tune(&s);
        if (COUNTING)
            assert_int_equal(allocations, counted);
        given_up += result.given_up != 0;
        for (size_t j = 0; j < NU; j++) { /* within limits, or on the way there as fast as it may */
            const double least = fmin(s.low[j], s.u_last[j] + s.step[j]),
                         most = fmax(s.high[j], s.u_last[j] - s.step[j]);

            assert_true(plan[j] >= least - 1e-9 && plan[j] <= most + 1e-9);
            assert_true(fabs(plan[j] - s.u_last[j]) <= s.step[j] + 1e-9);
        }
        begin(&fresh, &options);
        tune(&fresh);
        apc_mpc_solve(fresh.mpc, &s.call, same, &result);
        assert_int_equal(result.rc, 0);
        for (size_t i = 0; i < s.n; i++)
            assert_near(same[i], plan[i], 1e-7);
        end(&fresh);
    }
    assert_true(given_up > 20);
    end(&s);
}

static void what_makes_no_sense_is_refused_with_a_sentence(void **state)
{
    const unsigned nothing[] = {1, 0}, long_ones[] = {20, 20, 1};
    const struct apc_transfer drifting[] = {
        {.gain = 1.0, .tau = {1.0, 0.0}}, {.gain = 1.0, .integrating = true}}; /* a disturbance integrates */
    const double one[] = {1.0}, zero[] = {0.0};
    const struct apc_linear_continuous wild = {.size = sizeof wild,
                                               .nx = 1,
                                               .nu = 1,
                                               .ny = 1,
                                               .A = one,
                                               .B = one,
                                               .C = one,
                                               .D = zero,
                                               .x0 = zero,
                                               .u0 = zero,
                                               .y0 = zero};
    struct apc_linear *model = process(), *drift;
    const struct apc_mpc_options refused[] = {
        {.horizon = N, .blocks = 1, .block = each_sample},
        {.model = model, .blocks = 1, .block = each_sample},
        {.model = model, .horizon = N, .blocks = 2, .block = nothing},
        {.model = model, .horizon = N, .blocks = 3, .block = long_ones},
    };
    const char *const says[] = {"required", "required", "block 2", "block 3"};
    struct apc_mpc_options options = {.horizon = N, .blocks = 1, .block = each_sample};
    struct apc_mpc *mpc;
    struct apc_error why;
    struct scene s;
    (void)state;

    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        assert_int_equal(apc_mpc_create(&mpc, &refused[i], &why), APC_EINVAL);
        assert_null(mpc);
        if (!strstr(why.text, says[i]))
            fail_msg("number %zu: \"%s\" does not say \"%s\"", i, why.text, says[i]);
    }
    assert_int_equal(apc_linear_from_transfer(&drift, 1, 1, 1, drifting, NULL, NULL, 1.0, &why), 0);
    options.model = drift;
    assert_int_equal(apc_mpc_create(&mpc, &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "no input"));
    apc_linear_destroy(drift);
    apc_linear_destroy(model);
    assert_int_equal(apc_linear_from_continuous(&model, &wild, 100.0, &why), 0);
    options.model = model;
    assert_int_equal(apc_mpc_create(&mpc, &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "grows beyond all numbers"));
    apc_linear_destroy(model);

    begin(&s, &(struct apc_mpc_options){.blocks = 1, .block = each_sample});
    const struct apc_mpc_weights none = {.q = s.r, .s = s.r, .r = s.r, .zone = s.r};
    assert_int_equal(apc_mpc_tune(s.mpc, &none, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "weight"));
    end(&s);
    apc_mpc_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_limits_it_is_the_regulator_of_an_endless_horizon),
        cmocka_unit_test(no_other_plan_costs_less),
        cmocka_unit_test(a_multiplier_is_what_a_limit_costs),
        cmocka_unit_test(what_is_predicted_comes),
        cmocka_unit_test(a_setpoint_that_can_be_reached_is_reached_whatever_disturbs),
        cmocka_unit_test(the_first_rank_keeps_its_setpoint_when_an_input_saturates),
        cmocka_unit_test(a_setpoint_out_of_reach_is_approached),
        cmocka_unit_test(an_integrating_output_is_held),
        cmocka_unit_test(limits_are_given_up_by_rank_and_no_further_than_needed),
        cmocka_unit_test(limits_that_contradict_never_leave_it_without_a_plan),
        cmocka_unit_test(a_limit_of_y_holds_as_long_as_there_is_a_way),
        cmocka_unit_test(within_its_zone_y_moves_nothing),
        cmocka_unit_test(an_input_that_is_given_stays_and_the_other_one_makes_up),
        cmocka_unit_test(a_step_that_is_announced_is_met_half_way),
        cmocka_unit_test(a_plan_depends_on_the_call_alone_and_allocates_nothing),
        cmocka_unit_test(what_makes_no_sense_is_refused_with_a_sentence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
