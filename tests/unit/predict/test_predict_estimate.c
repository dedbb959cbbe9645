/* SPDX-License-Identifier: BSD-3-Clause */
/* Estimators: what they say is what all measurements together say, solved as one problem by least squares. */
#include "apcestimate.h"
#include "base/matrix.h"
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NX = 3, NY = 2, STEPS = 12, ALL = (STEPS + 1) * NX };

#define SEED 20260731u

/* A stable model with one input, about a point that is not the origin; filled at random. */
static struct apc_linear *random_model(struct apc_random *random)
{
    double g[NX * NX], B[NX], C[NY * NX], D[NY], x0[NX], y0[NY];
    const double u0 = 3.0;
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = NX,
                                               .nu = 1,
                                               .ny = NY,
                                               .A = g,
                                               .B = B,
                                               .C = C,
                                               .D = D,
                                               .x0 = x0,
                                               .u0 = &u0,
                                               .y0 = y0};
    struct apc_linear *model;
    struct apc_error why;

    for (size_t i = 0; i < NX * NX; i++)
        g[i] = 0.5 * apc_random_normal(random) - (i % (NX + 1) == 0 ? 2.0 : 0.0);
    for (size_t i = 0; i < NX; i++) {
        B[i] = apc_random_normal(random);
        x0[i] = apc_random_normal(random);
    }
    for (size_t i = 0; i < NY * NX; i++)
        C[i] = apc_random_normal(random);
    for (size_t i = 0; i < NY; i++) {
        D[i] = apc_random_normal(random);
        y0[i] = apc_random_normal(random);
    }
    assert_int_equal(apc_linear_from_continuous(&model, &from, 0.3, &why), 0);
    return model;
}

static struct apc_estimator *make(const struct apc_estimator_options *options)
{
    struct apc_estimator *estimator;
    struct apc_error why;

    if (apc_estimator_create(&estimator, options, &why) != 0)
        fail_msg("%s", why.text);
    return estimator;
}

/* H [ALL * ALL], f [ALL] += one square (a'(x) - b)^2 / variance, a over the states of samples k and k + 1. */
static void add_square(double *H, double *f, size_t k, const double *a, size_t n, double b, double variance)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            H[(k * NX + i) * ALL + k * NX + j] += a[i] * a[j] / variance;
        f[k * NX + i] += a[i] * b / variance;
    }
}

/*
 * Promise(analysis/estimators-least-squares): Estimators: the least-squares answer whatever is missing, the
 *   same bits after a restart, and they know how wrong they are.
 */
static void the_filter_is_the_least_squares_of_all_that_was_measured(void **state)
{
    const double q[] = {0.2, 0.05, 0.4}, r[] = {0.3, 0.1}, p0[] = {2.0, 1.0, 0.5};
    double *H = calloc(2 * ALL * ALL, sizeof *H), *inverse = H + ALL * ALL;
    struct apc_random random;
    (void)state;

    assert_non_null(H);
    apc_random_init(&random, SEED, "model");
    for (int round = 0; round < 20; round++) {
        struct apc_linear *m = random_model(&random);
        const struct apc_estimator_options options = {
            .size = sizeof options, .kind = APC_KALMAN, .linear = m, .q = q, .r = r, .p0 = p0};
        struct apc_estimator *e = make(&options);
        double s[NX + NX * (NX + 1) / 2], f[ALL] = {0};

        assert_int_equal(apc_estimator_size(e), sizeof s / sizeof *s);
        memset(H, 0, 2 * ALL * ALL * sizeof *H);
        apc_estimator_reset(e, s, NULL);
        for (size_t i = 0; i < NX; i++) {
            double a[NX] = {0};

            a[i] = 1.0;
            add_square(H, f, 0, a, NX, m->x0[i], p0[i]);
        }
        for (size_t k = 0; k <= STEPS; k++) {
            const double u = 3.0 + apc_random_normal(&random);
            double y[NY];
            bool usable[NY];
            int n = 0;

            for (size_t i = 0; i < NY; i++) {
                double b;

                y[i] = 5.0 * apc_random_normal(&random);
                usable[i] = apc_random_uniform(&random) < 0.6;
                n += usable[i];
                b = y[i] - m->y0[i] - m->D[i] * (u - m->u0[0]);
                for (size_t j = 0; j < NX; j++)
                    b += m->C[i * NX + j] * m->x0[j];
                if (usable[i])
                    add_square(H, f, k, m->C + i * NX, NX, b, r[i]);
            }
            assert_int_equal(apc_estimator_correct(e, s, y, usable, &u), n);
            if (k == STEPS)
                break;
            assert_int_equal(apc_estimator_predict(e, s, &u), 0);
            for (size_t i = 0; i < NX; i++) {
                double a[2 * NX] = {0}, b = m->x0[i] + m->B[i] * (u - m->u0[0]);

                a[NX + i] = 1.0;
                for (size_t j = 0; j < NX; j++) {
                    a[j] = -m->A[i * NX + j];
                    b -= m->A[i * NX + j] * m->x0[j];
                }
                add_square(H, f, k, a, 2 * NX, b, q[i]);
            }
        }
        for (size_t i = 0; i < ALL; i++)
            inverse[i * ALL + i] = 1.0;
        assert_int_equal(apc_matrix_solve(ALL, ALL, H, inverse), 0);
        for (size_t i = 0; i < NX; i++) {
            double x = 0.0;

            for (size_t j = 0; j < ALL; j++)
                x += inverse[(STEPS * NX + i) * ALL + j] * f[j];
            assert_near(s[i], x, 1e-8);
            for (size_t j = 0; j <= i; j++)
                assert_near(s[NX + i * (i + 1) / 2 + j], inverse[(STEPS * NX + i) * ALL + STEPS * NX + j],
                            1e-9);
            assert_near(apc_estimator_deviation(e, s, i),
                        sqrt(inverse[(STEPS * NX + i) * ALL + STEPS * NX + i]), 1e-9);
        }
        apc_estimator_destroy(e);
        apc_linear_destroy(m);
    }
    free(H);
}

static void the_steady_gain_is_where_the_other_one_ends(void **state)
{
    const double q[] = {0.2, 0.05, 0.4}, r[] = {0.3, 0.1};
    struct apc_random random;
    (void)state;

    apc_random_init(&random, SEED, "steady");
    for (int round = 0; round < 10; round++) {
        struct apc_linear *m = random_model(&random);
        struct apc_estimator_options options = {
            .size = sizeof options, .kind = APC_KALMAN, .linear = m, .q = q, .r = r};
        struct apc_estimator *varying = make(&options), *steady;
        double s[NX + NX * (NX + 1) / 2], t[NX];

        options.kind = APC_KALMAN_STEADY;
        steady = make(&options);
        assert_int_equal(apc_estimator_size(steady), NX);
        apc_estimator_reset(varying, s, NULL);
        apc_estimator_reset(steady, t, NULL);
        for (size_t k = 0; k < 200; k++) {
            const double u = 3.0 + apc_random_normal(&random);
            double y[NY] = {apc_random_normal(&random), apc_random_normal(&random)}, from_s[NY], from_t[NY];

            assert_int_equal(apc_estimator_correct(varying, s, y, NULL, &u), NY);
            assert_int_equal(apc_estimator_correct(steady, t, y, NULL, &u), NY);
            apc_estimator_output(varying, s, &u, from_s);
            apc_estimator_output(steady, t, &u, from_t);
            for (size_t i = 0; k > 150 && i < NX; i++) {
                assert_near(t[i], s[i], 1e-9);
                assert_near(apc_estimator_deviation(steady, t, i), apc_estimator_deviation(varying, s, i),
                            1e-9);
            }
            for (size_t i = 0; k > 150 && i < NY; i++)
                assert_near(from_t[i], from_s[i], 1e-9);
            assert_int_equal(apc_estimator_predict(varying, s, &u), 0);
            assert_int_equal(apc_estimator_predict(steady, t, &u), 0);
        }
        apc_estimator_destroy(steady);
        apc_estimator_destroy(varying);
        apc_linear_destroy(m);
    }
}

/* dx/dt = (-x + K u) / tau + noise of intensity q is sampled exactly by hand. */
static void the_extended_one_is_the_other_one_where_the_model_is_linear(void **state)
{
    const double p[] = {2.0, 0.8}, q = 0.3, r = 0.1, p0 = 4.0, Ts = 0.25;
    const double A = exp(-Ts / p[1]), B = p[0] * (1.0 - A), C = 1.0,
                 qd = q * p[1] / 2.0 * (1.0 - exp(-2.0 * Ts / p[1]));
    const struct apc_linear_continuous continuous = {.size = sizeof continuous,
                                                     .nx = 1,
                                                     .nu = 1,
                                                     .ny = 1,
                                                     .A = &(double){-1.0 / p[1]},
                                                     .B = &(double){p[0] / p[1]},
                                                     .C = &C};
    struct apc_estimator_options options = {.size = sizeof options, .r = &r, .p0 = &p0};
    struct apc_estimator *linear, *extended;
    struct apc_linear *m;
    struct apc_random random;
    struct apc_error why;
    double s[2], t[2];
    (void)state;

    assert_int_equal(apc_linear_from_continuous(&m, &continuous, Ts, &why), 0);
    assert_near(m->A[0], A, 1e-14);
    assert_near(m->B[0], B, 1e-14);
    options.kind = APC_KALMAN;
    options.linear = m;
    options.q = &qd;
    linear = make(&options);
    options.kind = APC_KALMAN_EXTENDED;
    options.model = &apc_model_first_order;
    options.p = p;
    options.q = &q;
    options.Ts = Ts;
    extended = make(&options);
    apc_estimator_reset(linear, s, &(double){1.0});
    apc_estimator_reset(extended, t, &(double){1.0});
    apc_random_init(&random, SEED, "first-order");
    for (int k = 0; k < 100; k++) {
        const double u = apc_random_normal(&random), y = apc_random_normal(&random);
        const bool usable = k % 3 != 0;

        assert_int_equal(apc_estimator_correct(linear, s, &y, &usable, &u), usable);
        assert_int_equal(apc_estimator_correct(extended, t, &y, &usable, &u), usable);
        assert_near(t[0], s[0], 1e-8);
        assert_near(t[1], s[1], 1e-8);
        assert_int_equal(apc_estimator_predict(linear, s, &u), 0);
        assert_int_equal(apc_estimator_predict(extended, t, &u), 0);
        assert_near(t[0], s[0], 1e-8);
        assert_near(t[1], s[1], 1e-8);
    }
    apc_estimator_destroy(extended);
    apc_estimator_destroy(linear);
    apc_linear_destroy(m);
}

/* ---- A nonlinear plant --------------------------------------------------------------------------- */

static const struct apc_model *tanks(void)
{
    const struct apc_model *model;
    void *handle;
    struct apc_error why;

    assert_int_equal(apc_model_find("quadruple-tank", &model, &handle, &why), 0);
    return model;
}

/* Four levels from two measurements; the errors are as large as the filter says, over all runs and times. */
/* Promise(analysis/estimators-least-squares) */
static void the_extended_one_knows_how_wrong_it_is(void **state)
{
    enum { RUNS = 60, TICKS = 120, TANKS = 4 };
    const struct apc_model *model = tanks();
    const double Ts = 2.0, q[TANKS] = {0.02, 0.02, 0.002, 0.002}, r[] = {0.01, 0.01},
                 p0[TANKS] = {4.0, 4.0, 0.1, 0.1};
    const struct apc_estimator_options options = {.size = sizeof options,
                                                  .kind = APC_KALMAN_EXTENDED,
                                                  .model = model,
                                                  .Ts = Ts,
                                                  .q = q,
                                                  .r = r,
                                                  .p0 = p0};
    struct apc_estimator *e = make(&options);
    double ratio[TANKS] = {0}, *s = calloc(apc_estimator_size(e), sizeof *s);
    struct apc_random random;
    (void)state;

    assert_non_null(s);
    apc_random_init(&random, SEED, "tanks");
    for (int run = 0; run < RUNS; run++) {
        struct apc_plant *plant;
        struct apc_error why;
        double u[16], y[2], x[TANKS];

        for (size_t j = 0; j < model->nu + model->nd; j++)
            u[j] = j < model->nu ? model->input[j].initial : model->disturbance[j - model->nu].initial;
        assert_int_equal(apc_plant_create(&plant, model, NULL, NULL, NULL, &why), 0);
        for (size_t i = 0; i < TANKS; i++)
            x[i] = apc_plant_state(plant)[i] + sqrt(p0[i]) * apc_random_normal(&random);
        apc_estimator_reset(e, s, x);
        for (int k = 0; k < TICKS; k++) {
            if (k % 20 == 0)
                u[0] = 2.0 + 2.0 * apc_random_uniform(&random);
            apc_plant_output(plant, u, y);
            for (size_t i = 0; i < 2; i++)
                y[i] += sqrt(r[i]) * apc_random_normal(&random);
            assert_int_equal(apc_estimator_correct(e, s, y, NULL, u), 2);
            for (size_t i = 0; i < TANKS; i++) {
                double error = (s[i] - apc_plant_state(plant)[i]) / apc_estimator_deviation(e, s, i);

                ratio[i] += error * error / (RUNS * TICKS);
            }
            assert_int_equal(apc_plant_advance(plant, Ts, u), 0);
            for (size_t i = 0; i < TANKS; i++)
                assert_int_equal(apc_plant_kick(plant, i, sqrt(q[i] * Ts) * apc_random_normal(&random)), 0);
            assert_int_equal(apc_estimator_predict(e, s, u), 0);
        }
        apc_plant_destroy(plant);
    }
    for (size_t i = 0; i < TANKS; i++) {
        printf("tank %zu: mean square of error over deviation %.3f\n", i + 1, ratio[i]);
        assert_near(ratio[i], 1.0, 0.2);
    }
    free(s);
    apc_estimator_destroy(e);
}

/* ---- What is missing, wrong, or taken over ------------------------------------------------------- */

/* A load at the input of the paper's plant, and an error of its measurement, one after the other: both are
 * found. */
/* Promise(laws/nmpc) */
static void the_extended_one_finds_what_nobody_measures(void **state)
{
    static const struct apc_linear_unknown at_input = {APC_AT_INPUT, 0}, at_output = {APC_AT_OUTPUT, 0};
    const double q[] = {0.0, 0.01}, r = 1e-4, u = 1.0, load = 0.3;
    struct apc_estimator_options options = {.size = sizeof options,
                                            .kind = APC_KALMAN_EXTENDED,
                                            .model = &apc_model_first_order,
                                            .Ts = 0.5,
                                            .q = q,
                                            .r = &r,
                                            .n_unknown = 1};
    struct apc_error why;
    (void)state;

    for (int where = APC_AT_OUTPUT; where <= APC_AT_INPUT; where++) {
        struct apc_estimator *e;
        double s[5], x = 4.0;

        options.unknown = where == APC_AT_INPUT ? &at_input : &at_output;
        e = make(&options);
        assert_int_equal(apc_estimator_size(e), 5);
        apc_estimator_reset(e, s, NULL);
        for (int k = 0; k < 400; k++) {
            const double y = where == APC_AT_OUTPUT ? x + load : x;

            assert_int_equal(apc_estimator_correct(e, s, &y, NULL, &u), 1);
            assert_int_equal(apc_estimator_predict(e, s, &u), 0);
            x += (1.0 - exp(-0.05)) * (10.0 * (where == APC_AT_INPUT ? u + load : u) - x);
        }
        assert_near(s[1], load, 1e-3);
        assert_near(s[0], x, 1e-2);
        apc_estimator_destroy(e);
    }
    options.unknown = &(struct apc_linear_unknown){APC_AT_INPUT, 1};
    struct apc_estimator *none;
    assert_int_equal(apc_estimator_create(&none, &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "there is no such input"));
}

static void what_is_not_usable_changes_nothing(void **state)
{
    const double q[] = {0.2, 0.05, 0.4}, r[] = {0.3, 0.1}, u = 1.0;
    const double bad[][NY] = {{(double)NAN, (double)INFINITY}, {1e301, -(double)INFINITY}, {5.0, 5.0}};
    const bool none[NY] = {false, false};
    struct apc_random random;
    struct apc_linear *m;
    (void)state;

    apc_random_init(&random, SEED, "bad");
    m = random_model(&random);
    for (enum apc_estimator_kind kind = APC_KALMAN_STEADY; kind <= APC_KALMAN; kind++) {
        const struct apc_estimator_options options = {
            .size = sizeof options, .kind = kind, .linear = m, .q = q, .r = r};
        struct apc_estimator *e = make(&options);
        double s[NX + NX * (NX + 1) / 2] = {0}, before[NX + NX * (NX + 1) / 2];

        apc_estimator_reset(e, s, NULL);
        assert_int_equal(apc_estimator_predict(e, s, &u), 0);
        memcpy(before, s, sizeof s);
        for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
            assert_int_equal(apc_estimator_correct(e, s, bad[i], i == 2 ? none : NULL, &u), 0);
            assert_memory_equal(s, before, sizeof s);
        }
        assert_int_equal(apc_estimator_correct(e, s, (double[]){(double)NAN, 5.0}, NULL, &u), 1);
        assert_memory_not_equal(s, before, sizeof s);
        apc_estimator_destroy(e);
    }
    apc_linear_destroy(m);
}

/* Promise(analysis/estimators-least-squares) */
static void a_restart_goes_on_bit_for_bit(void **state)
{
    const struct apc_model *model = tanks();
    const double q[] = {0.1, 0.1, 0.1, 0.1}, r[] = {0.01, 0.02};
    const struct apc_estimator_options options = {
        .size = sizeof options, .kind = APC_KALMAN_EXTENDED, .model = model, .Ts = 1.0, .q = q, .r = r};
    struct apc_estimator *one = make(&options);
    double s[14], t[14];
    (void)state;

    assert_int_equal(apc_estimator_size(one), 14);
    apc_estimator_reset(one, s, NULL);
    memcpy(t, s, sizeof s);
    for (int k = 0; k < 30; k++) {
        const double u[] = {3.0, 3.0, 0.0, 0.0}, y[] = {6.0 + 0.1 * k, 6.0};
        struct apc_estimator *other = make(&options); /* made anew at each tick */

        assert_int_equal(apc_estimator_correct(one, s, y, NULL, u), 2);
        assert_int_equal(apc_estimator_predict(one, s, u), 0);
        assert_int_equal(apc_estimator_correct(other, t, y, NULL, u), 2);
        assert_int_equal(apc_estimator_predict(other, t, u), 0);
        assert_memory_equal(s, t, sizeof s);
        apc_estimator_destroy(other);
    }
    apc_estimator_destroy(one);
}

/* An estimate from which the model, asked how it would move, says: not at all. A tank below empty, and a pump
 * that would run backwards, until both are found where a plant can be; so are they when of the covariance
 * only numbers are left that are none. */
static void an_estimate_that_no_plant_can_have_is_left(void **state)
{
    static const struct apc_linear_unknown pumps[] = {{APC_AT_INPUT, 0}, {APC_AT_INPUT, 1}};
    static const double load[] = {0.2, -0.3};
    const struct apc_model *model = tanks();
    const double q[] = {1e-4, 1e-4, 1e-4, 1e-4, 0.01, 0.01}, r[] = {1e-4, 1e-4}, u[] = {3.0, 3.0, 0.0, 0.0};
    const double nonsense[] = {12.0, 12.0, 6.0, -5.74, -6.11, 2.0};
    const struct apc_estimator_options options = {.size = sizeof options,
                                                  .kind = APC_KALMAN_EXTENDED,
                                                  .model = model,
                                                  .Ts = 1.0,
                                                  .q = q,
                                                  .r = r,
                                                  .unknown = pumps,
                                                  .n_unknown = 2};
    struct apc_estimator *e = make(&options);
    double s[6 + 21];
    (void)state;

    assert_int_equal(apc_estimator_size(e), sizeof s / sizeof *s);
    for (int broken = 0; broken < 2; broken++) {
        struct apc_plant *plant;
        struct apc_error why;

        assert_int_equal(apc_plant_create(&plant, model, NULL, NULL, NULL, &why), 0);
        apc_estimator_reset(e, s, nonsense);
        if (broken)
            s[6 + 12] = -4.36e281; /* of the covariance, off its diagonal */
        for (int k = 0; k < 1000; k++) {
            double y[2], acts[4];

            memcpy(acts, u, sizeof acts);
            for (size_t j = 0; j < 2; j++)
                acts[j] += load[j];
            apc_plant_output(plant, acts, y);
            assert_int_equal(apc_estimator_correct(e, s, y, NULL, u), 2);
            for (size_t i = 0; i < 4; i++)
                assert_true(s[i] >= model->state[i].low && s[i] <= model->state[i].high);
            assert_true(u[0] + s[4] >= model->input[0].low);
            assert_int_equal(apc_estimator_predict(e, s, u), 0);
            assert_int_equal(apc_plant_advance(plant, 1.0, acts), 0);
        }
        for (size_t i = 0; i < 4; i++)
            assert_near(s[i], apc_plant_state(plant)[i], 0.01);
        for (size_t j = 0; j < 2; j++)
            assert_near(s[4 + j], load[j], 0.01);
        apc_plant_destroy(plant);
    }
    apc_estimator_destroy(e);
}

static int beyond(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    (void)u;
    (void)p;
    dx[0] = 1.0;
    return x[0] > 2.5; /* it reaches the end of its world */
}

static void show(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)u;
    (void)p;
    y[0] = x[0];
}

static void where_the_model_ends_the_state_stays(void **state)
{
    const struct apc_model model = {.abi = APC_MODEL_ABI,
                                    .name = "end",
                                    .description = "",
                                    .nx = 1,
                                    .nu = 1,
                                    .ny = 1,
                                    .f = beyond,
                                    .g = show};
    const struct apc_estimator_options options = {.size = sizeof options,
                                                  .kind = APC_KALMAN_EXTENDED,
                                                  .model = &model,
                                                  .Ts = 1.0,
                                                  .q = &(double){0.1},
                                                  .r = &(double){0.1}};
    struct apc_estimator *e = make(&options);
    double s[2], before[2];
    (void)state;

    apc_estimator_reset(e, s, &(double){1.0});
    assert_int_equal(apc_estimator_predict(e, s, &(double){0.0}), 0);
    assert_near(s[0], 2.0, 1e-12);
    memcpy(before, s, sizeof s);
    assert_int_equal(apc_estimator_predict(e, s, &(double){0.0}), APC_ESOLVER);
    assert_memory_equal(s, before, sizeof s);
    apc_estimator_destroy(e);
}

static void what_makes_no_sense_is_refused_with_a_sentence(void **state)
{
    const double ones[] = {1.0, 1.0, 1.0}, zeros[] = {0.0, 0.0, 0.0}, bad[] = {1.0, (double)NAN, 1.0},
                 A[] = {0.0, 0.0, 0.0, 0.0}, B[] = {1.0, 1.0}, C[] = {1.0, 0.0};
    const struct apc_linear_continuous two = {
        .size = sizeof two, .nx = 2, .nu = 1, .ny = 1, .A = A, .B = B, .C = C};
    struct apc_random random;
    struct apc_linear *m, *unseen;
    struct apc_estimator *e;
    struct apc_error why;
    (void)state;

    apc_random_init(&random, SEED, "refused");
    m = random_model(&random);
    assert_int_equal(apc_linear_from_continuous(&unseen, &two, 1.0, &why), 0);
    const struct {
        struct apc_estimator_options o;
        int rc;
        const char *says;
    } refused[] = {
        {{.kind = APC_KALMAN, .q = ones, .r = ones}, APC_EINVAL, "linear model is required"},
        {{.kind = APC_KALMAN_EXTENDED, .linear = m, .q = ones, .r = ones, .Ts = 1.0},
         APC_EINVAL,
         "a model is"},
        {{.kind = (enum apc_estimator_kind)9, .linear = m, .q = ones, .r = ones}, APC_EINVAL, "kind 9"},
        {{.kind = APC_KALMAN, .linear = m, .r = ones}, APC_EINVAL, "q must be 3"},
        {{.kind = APC_KALMAN, .linear = m, .q = bad, .r = ones}, APC_EINVAL, "q must be 3"},
        {{.kind = APC_KALMAN, .linear = m, .q = ones, .r = zeros}, APC_EINVAL, "above 0"},
        {{.kind = APC_KALMAN, .linear = m, .q = ones, .r = ones, .p0 = bad}, APC_EINVAL, "p0 must"},
        {{.kind = APC_KALMAN_STEADY, .linear = unseen, .q = ones, .r = ones}, APC_ESOLVER, "measurements"},
        {{.kind = APC_KALMAN_EXTENDED,
          .model = &apc_model_first_order,
          .p = (const double[]){-1e300, -1.0},
          .q = ones,
          .r = ones,
          .Ts = 1.0},
         APC_EINVAL,
         "parameter"},
        {{.kind = APC_KALMAN_EXTENDED, .model = &apc_model_first_order, .q = ones, .r = ones},
         APC_EINVAL,
         "period"},
    };
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        struct apc_estimator_options o = refused[i].o;

        o.size = sizeof o;
        assert_int_equal(apc_estimator_create(&e, &o, &why), refused[i].rc);
        assert_null(e);
        if (!strstr(why.text, refused[i].says))
            fail_msg("number %zu: \"%s\" does not say \"%s\"", i, why.text, refused[i].says);
    }
    apc_estimator_destroy(NULL);
    apc_linear_destroy(unseen);
    apc_linear_destroy(m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_filter_is_the_least_squares_of_all_that_was_measured),
        cmocka_unit_test(the_steady_gain_is_where_the_other_one_ends),
        cmocka_unit_test(the_extended_one_is_the_other_one_where_the_model_is_linear),
        cmocka_unit_test(the_extended_one_knows_how_wrong_it_is),
        cmocka_unit_test(the_extended_one_finds_what_nobody_measures),
        cmocka_unit_test(what_is_not_usable_changes_nothing),
        cmocka_unit_test(a_restart_goes_on_bit_for_bit),
        cmocka_unit_test(an_estimate_that_no_plant_can_have_is_left),
        cmocka_unit_test(where_the_model_ends_the_state_stays),
        cmocka_unit_test(what_makes_no_sense_is_refused_with_a_sentence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
