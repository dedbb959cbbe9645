/* SPDX-License-Identifier: BSD-3-Clause */
/* Multiple shooting: what it predicts is what the model does, near where it was made linear, and exactly for
 * a linear model, wherever its nodes were. */
/* Promise(laws/nmpc) */
#include "check.h"
#include "plant/plant_internal.h"
#include "predict/shooting.h"

#include <string.h>

enum { N = 12, BLOCKS = 3, NX_MOST = 4, NU_MOST = 2, NY_MOST = 2, MOVES = BLOCKS * NU_MOST };

static const unsigned blocks[BLOCKS] = {1, 3, 4};
static const size_t block_of[N] = {0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2};

struct scene {
    struct apc_shooting *shoot;
    const struct apc_model *model;
    double u0[NU_MOST], G[N * NY_MOST * MOVES], free_y[N * NY_MOST];
};

static void make(struct scene *s, const struct apc_model *model, double Ts, const double *u0,
                 const struct apc_linear_unknown *unknown, size_t n_unknown)
{
    const struct apc_shooting_options options = {.model = model,
                                                 .Ts = Ts,
                                                 .steps = 10,
                                                 .horizon = N,
                                                 .blocks = BLOCKS,
                                                 .block = blocks,
                                                 .unknown = unknown,
                                                 .n_unknown = n_unknown,
                                                 .u0 = u0};
    struct apc_error why;

    s->model = model;
    memcpy(s->u0, u0, model->nu * sizeof *u0);
    if (apc_shooting_create(&s->shoot, &options, &why) < 0)
        fail_msg("%s", why.text);
}

/* What the model does with a plan: nodes, y of each end. */
static void simulate(struct scene *s, const double *x0, const double *d, const double *plan, double Ts,
                     double *nodes, double *y)
{
    const struct apc_model *m = s->model;
    double x[NX_MOST], u[NU_MOST + 4];

    memcpy(x, x0, m->nx * sizeof *x);
    apc_param_initials(m->disturbance, m->nd, u + m->nu);
    for (size_t i = 0; i < N; i++) {
        memcpy(u, plan + block_of[i] * m->nu, m->nu * sizeof *u);
        assert_int_equal(apc_shooting_advance(s->shoot, x, u, d, Ts), 0);
        memcpy(nodes + i * m->nx, x, m->nx * sizeof *x);
        m->g(0.0, x, u, NULL, y + i * m->ny);
    }
}

static double predicted(const struct scene *s, size_t row, const double *plan)
{
    const size_t n = BLOCKS * s->model->nu;
    double y = s->free_y[row];

    for (size_t k = 0; k < n; k++)
        y += s->G[row * n + k] * (plan[k] - s->u0[k % s->model->nu]);
    return y;
}

/* The greatest error of the prediction where all moves are larger by a share. */
static double error(struct scene *s, const double *x0, const double *plan, double share)
{
    double moved[MOVES], nodes[N * NX_MOST], y[N * NY_MOST], most = 0.0;

    for (size_t k = 0; k < MOVES; k++)
        moved[k] = plan[k] * (1.0 + share * (k % 2 ? 1.0 : -0.5));
    simulate(s, x0, NULL, moved, 20.0, nodes, y);
    for (size_t row = 0; row < N * 2; row++)
        most = fmax(most, fabs(predicted(s, row, moved) - y[row]));
    return most;
}

static void near_its_trajectory_the_prediction_is_right_to_second_order(void **state)
{
    const double x0[] = {1.61687, 1.02236, 113.137, 111.853}, u0[] = {8.0, -1113.5},
                 plan[] = {9.0, -1500.0, 12.0, -900.0, 7.0, -2000.0};
    double nodes[N * NX_MOST], y[N * NY_MOST], near, far;
    struct scene s;
    (void)state;

    make(&s, &apc_model_van_de_vusse, 20.0, u0, NULL, 0);
    simulate(&s, x0, NULL, plan, 20.0, nodes, y);
    assert_int_equal(apc_shooting_linearise(s.shoot, x0, NULL, plan, NULL, nodes, s.G, s.free_y), 0);
    for (size_t row = 0; row < N * 2; row++)
        assert_near(predicted(&s, row, plan), y[row], 1e-9);
    far = error(&s, x0, plan, 0.1);
    near = error(&s, x0, plan, 0.05);
    assert_true(far > 1e-6);
    assert_true(near < 0.35 * far && near > 0.15 * far); /* a quarter */
    apc_shooting_destroy(s.shoot);
}

static void of_a_linear_model_it_is_exact_wherever_the_nodes_were(void **state)
{
    const double x0 = 3.0, u0 = 1.0, d = 0.4, plan[] = {0.5, 2.0, -1.0}, other[] = {-2.0, 0.3, 1.7};
    const struct apc_linear_unknown at_input = {APC_AT_INPUT, 0};
    double nodes[N], wild[N], y[N];
    struct scene s;
    (void)state;

    make(&s, &apc_model_first_order, 0.7, &u0, &at_input, 1);
    for (size_t i = 0; i < N; i++)
        wild[i] = i % 2 ? 40.0 : -15.0;
    assert_int_equal(apc_shooting_linearise(s.shoot, &x0, &d, plan, NULL, wild, s.G, s.free_y), 0);
    simulate(&s, &x0, &d, other, 0.7, nodes, y);
    for (size_t i = 0; i < N; i++)
        assert_near(predicted(&s, i, other), y[i], 1e-8);
    apc_shooting_move(s.shoot, other, wild);
    for (size_t i = 0; i < N; i++)
        assert_near(wild[i], nodes[i], 1e-8);
    apc_shooting_destroy(s.shoot);
}

static int nowhere(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = -x[0];
    return x[0] < 0.0;
}

static void show(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

static void where_the_model_ends_it_says_so(void **state)
{
    static const struct apc_model half = {
        .abi = APC_MODEL_ABI, .name = "half", .nx = 1, .nu = 1, .ny = 1, .f = nowhere, .g = show};
    const double u0 = 0.0, plan[BLOCKS] = {0.0}, x0 = 1.0;
    double nodes[N], x = -1.0;
    struct scene s;
    (void)state;

    make(&s, &half, 1.0, &u0, NULL, 0);
    assert_int_equal(apc_shooting_advance(s.shoot, &x, &u0, NULL, 1.0), APC_ESOLVER);
    assert_true(x == -1.0);
    for (size_t i = 0; i < N; i++)
        nodes[i] = i == 5 ? -0.5 : 0.5;
    assert_int_equal(apc_shooting_linearise(s.shoot, &x0, NULL, plan, NULL, nodes, s.G, s.free_y),
                     APC_ESOLVER);
    nodes[5] = 0.5;
    assert_int_equal(apc_shooting_linearise(s.shoot, &x0, NULL, plan, NULL, nodes, s.G, s.free_y), 0);
    apc_shooting_destroy(s.shoot);
    apc_shooting_destroy(NULL);
}

static int decay(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = u[0] - x[0];
    dx[1] = u[1] - 2.0 * x[1];
    return 0;
}

static void cross(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0] * x[1];
}

/* A measurement that hangs on two states at once, and a disturbance that is not 0 when nothing is disturbed. */
static void what_is_measured_of_several_states_is_predicted(void **state)
{
    static const struct apc_param loaded = {"d", "", "", 3.0, 0.0, 10.0};
    static const struct apc_model crossed = {.abi = APC_MODEL_ABI,
                                             .name = "crossed",
                                             .nx = 2,
                                             .nu = 1,
                                             .nd = 1,
                                             .ny = 1,
                                             .disturbance = &loaded,
                                             .f = decay,
                                             .g = cross};
    const double u0 = 1.0, x0[] = {2.0, 5.0}, plan[] = {1.0, 1.5, 0.5}, Ts = 0.3;
    double nodes[2 * N], y[N], x[2] = {x0[0], x0[1]};
    struct scene s;
    (void)state;

    make(&s, &crossed, Ts, &u0, NULL, 0);
    for (size_t i = 0; i < N; i++) { /* by its closed form */
        const double u = plan[block_of[i]];

        x[0] = u + (x[0] - u) * exp(-Ts);
        x[1] = 1.5 + (x[1] - 1.5) * exp(-2.0 * Ts);
        nodes[2 * i] = x[0];
        nodes[2 * i + 1] = x[1];
        y[i] = x[0] * x[1];
    }
    assert_int_equal(apc_shooting_linearise(s.shoot, x0, NULL, plan, NULL, nodes, s.G, s.free_y), 0);
    for (size_t i = 0; i < N; i++) {
        const double moved[] = {plan[0] + 2.0, plan[1],
                                plan[2]}; /* y is linear in it: x[1] hangs on d only */
        double e = 0.0;

        assert_near(predicted(&s, i, plan), y[i], 1e-6);
        e = 2.0 * (exp(-Ts * (double)i) - exp(-Ts * (double)(i + 1)));
        assert_near(predicted(&s, i, moved) - predicted(&s, i, plan), e * nodes[2 * i + 1], 1e-6);
    }
    apc_shooting_destroy(s.shoot);
}

static int two_lags(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = u[0] - x[0];
    dx[1] = 3.0 * u[1] - 2.0 * x[1] + 0.5 * x[0];
    return 0;
}

static void see_both(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
    y[1] = x[1];
}

static void see_input(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)p;
    y[0] = x[0] + 2.0 * u[0];
    y[1] = x[1] - u[1];
}

static const struct apc_model lags = {
    .abi = APC_MODEL_ABI, .name = "lags", .nx = 2, .nu = 2, .ny = 2, .f = two_lags, .g = see_both};

/* Of `ticks` ticks from x0, by the plant's own integrator, with inputs as they act after their delays. */
static void play(const struct apc_model *m, const double *x0, const double *delay, const double *plan,
                 const double *past, double Ts, double *nodes, double *y)
{
    struct apc_plant *plant;
    struct apc_error why;
    double times[2 * N + 2];
    size_t n = 0;

    assert_int_equal(apc_plant_create(&plant, m, NULL, x0, NULL, &why), 0);
    for (size_t i = 0; i < N; i++) {
        times[n++] = (double)i * Ts;
        times[n++] = (double)i * Ts + fmod(delay[0], Ts); /* input 0 changes then */
    }
    times[n] = (double)N * Ts;
    for (size_t k = 0; k < n; k++) {
        double u[2];

        for (size_t j = 0; j < 2; j++) {
            const int at = (int)floor((times[k] - delay[j]) / Ts + 1e-6);

            u[j] = at < 0 ? past[(-at - 1) * 2 + (int)j] : plan[block_of[at] * 2 + j];
        }
        if (times[k + 1] - times[k] > 1e-12)
            assert_int_equal(apc_plant_advance(plant, times[k + 1] - times[k], u), 0);
        if (k % 2) {
            memcpy(nodes + k / 2 * 2, apc_plant_state(plant), 2 * sizeof *nodes);
            m->g(0.0, apc_plant_state(plant), u, NULL, y + k / 2 * 2);
        }
    }
    apc_plant_destroy(plant);
}

/*
 * Promise(laws/nmpc-outputs-act): `nmpc`: outputs act late, each by its own delay, of periods and parts of
 *   them; a search for steady states keeps to the budget; a measurement that an output acts on at once.
 */
static void inputs_that_act_late_are_predicted(void **state)
{
    static const double Ts = 0.5, delay[] = {2.7 * 0.5, 0.5}, x0[] = {0.3, -1.0}, u0[] = {0.1, 0.2},
                        plan[] = {1.0, -2.0, 0.5, 3.0, -1.0, 0.7}, other[] = {-1.0, 1.0, 2.5, 0.2, 0.4, -3.0},
                        past[] = {0.9, -0.4, 2.0, 7.0, -3.0, 5.0};
    double nodes[2 * N], wild[2 * N], y[2 * N], Gx[6 * MOVES], free_x[6];
    (void)state;

    for (int direct = 0; direct < 2; direct++) { /* what acts on y at once acts late, too */
        struct apc_model model = lags;
        struct apc_shooting_options options = {.model = &model,
                                               .Ts = Ts,
                                               .steps = 20,
                                               .horizon = N,
                                               .blocks = BLOCKS,
                                               .block = blocks,
                                               .u0 = u0,
                                               .delay = delay};
        struct apc_error why;
        struct scene s = {.model = &model, .u0 = {u0[0], u0[1]}};

        model.g = direct ? see_input : see_both;
        assert_int_equal(apc_shooting_create(&s.shoot, &options, &why), 0);
        for (size_t i = 0; i < 2 * N; i++)
            wild[i] = i % 3 ? 4.0 : -3.0;
        assert_int_equal(apc_shooting_linearise(s.shoot, x0, NULL, plan, past, wild, s.G, s.free_y), 0);
        play(&model, x0, delay, other, past, Ts, nodes, y);
        for (size_t i = 0; i < 2 * N; i++)
            assert_near(predicted(&s, i, other), y[i], 1e-6);
        /* and the state at the end: of the plant, and what is still to act, the youngest first */
        apc_shooting_end(s.shoot, wild, past, Gx, free_x);
        const double held[] = {other[4], other[4], other[4], other[5]};
        for (size_t i = 0; i < 2 + 4; i++) {
            double x = free_x[i];

            for (size_t k = 0; k < MOVES; k++)
                x += Gx[i * MOVES + k] * (other[k] - u0[k % 2]);
            assert_near(x, i < 2 ? nodes[2 * (N - 1) + i] : held[i - 2], 1e-6);
        }
        apc_shooting_destroy(s.shoot);
    }
}

/* At rest, an interval is what the sampled linear model with the same dead times says. */
/* Promise(laws/nmpc-outputs-act) */
static void a_sample_of_a_model_that_acts_late_is_the_linear_one(void **state)
{
    static const double Ts = 0.5, delay[] = {2.7 * 0.5, 0.5}, A[] = {-1.0, 0.0, 0.5, -2.0},
                        B[] = {1.0, 0.0, 0.0, 3.0}, C[] = {1.0, 0.0, 0.0, 1.0}, x0[] = {0.2, 0.35},
                        u0[] = {0.2, 0.2};
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = 2,
                                               .nu = 2,
                                               .ny = 2,
                                               .A = A,
                                               .B = B,
                                               .C = C,
                                               .x0 = x0,
                                               .u0 = u0,
                                               .y0 = x0,
                                               .dead_time = delay};
    const struct apc_shooting_options options = {.model = &lags,
                                                 .Ts = Ts,
                                                 .steps = 20,
                                                 .horizon = N,
                                                 .blocks = BLOCKS,
                                                 .block = blocks,
                                                 .u0 = u0,
                                                 .delay = delay};
    struct apc_linear *linear, *sampled;
    struct apc_shooting *shoot;
    struct apc_error why;
    double drift[6];
    (void)state;

    assert_int_equal(apc_linear_from_continuous(&linear, &from, Ts, &why), 0);
    assert_int_equal(apc_linear_from_continuous(&sampled, &from, Ts, &why), 0);
    assert_int_equal(linear->nx, 6);
    assert_int_equal(apc_shooting_create(&shoot, &options, &why), 0);
    for (size_t i = 0; i < 2 * 6; i++)
        sampled->A[i] = 99.0; /* the plant's rows are to be filled in */
    assert_int_equal(apc_shooting_sample(shoot, x0, u0, NULL, sampled, drift), 0);
    for (size_t i = 0; i < 6; i++) {
        assert_near(drift[i], 0.0, 1e-9);
        assert_near(sampled->x0[i], linear->x0[i], 1e-9);
        for (size_t k = 0; k < 6; k++)
            assert_near(sampled->A[i * 6 + k], linear->A[i * 6 + k], 1e-7);
        for (size_t k = 0; k < 2; k++)
            assert_near(sampled->B[i * 2 + k], linear->B[i * 2 + k], 1e-7);
    }
    for (size_t i = 0; i < 2 * 6; i++)
        assert_near(sampled->C[i], linear->C[i], 1e-9);
    apc_linear_destroy(linear);
    apc_linear_destroy(sampled);
    apc_shooting_destroy(shoot);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(near_its_trajectory_the_prediction_is_right_to_second_order),
        cmocka_unit_test(of_a_linear_model_it_is_exact_wherever_the_nodes_were),
        cmocka_unit_test(what_is_measured_of_several_states_is_predicted),
        cmocka_unit_test(where_the_model_ends_it_says_so),
        cmocka_unit_test(inputs_that_act_late_are_predicted),
        cmocka_unit_test(a_sample_of_a_model_that_acts_late_is_the_linear_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
