/* SPDX-License-Identifier: BSD-3-Clause */
/* Sampled linear models: they do what the plant does, integrated by others, dead times and all. */
#include "apclinear.h"
#include "apcplant.h"
#include "check.h"

#include <stdlib.h>
#include <string.h>

enum { SAMPLES = 60, STATES_MOST = 64 };

/* Steps up and down, never the same twice. */
static double input(size_t k, size_t j)
{
    return (double)((k * 7 + j * 3) % 11) - 4.0;
}

static void follow(const struct apc_linear *model, double y[][2])
{
    double x[STATES_MOST], next[STATES_MOST], u[2];

    assert_true(model->nx <= STATES_MOST);
    memcpy(x, model->x0, model->nx * sizeof(*x));
    for (size_t k = 0; k < SAMPLES; k++) {
        for (size_t j = 0; j < model->nu + model->nd; j++)
            u[j] = model->u0[j] + input(k, j);
        apc_linear_output(model, x, u, y[k]);
        apc_linear_next(model, x, u, next);
        memcpy(x, next, model->nx * sizeof(*x));
    }
}

/* The built-in plant number one is linear: K = 10, tau = 1 s. */
static void the_plant_with_dead_time(double dead_time, double Ts, double y[SAMPLES])
{
    const struct apc_plant_options options = {
        .size = sizeof options, .integrator = "exact", .dead_time = dead_time};
    struct apc_plant *plant;
    struct apc_error why;

    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &options, &why), 0);
    for (size_t k = 0; k < SAMPLES; k++) {
        double u = apc_model_first_order.input[0].initial + input(k, 0);

        apc_plant_output(plant, &u, &y[k]);
        assert_int_equal(apc_plant_advance(plant, Ts, &u), 0);
    }
    apc_plant_destroy(plant);
}

/*
 * Promise(analysis/linear-models-follow): Linear models follow the plant for any dead time, and tell when
 *   disturbances cannot be told apart.
 */
static void a_sampled_model_follows_the_plant_for_any_dead_time(void **state)
{
    const double dead_times[] = {0.0, 0.07, 0.1, 0.25, 0.3, 0.99};
    double A, B, C = 1.0, u0 = apc_model_first_order.input[0].initial;
    struct apc_error why;
    (void)state;

    assert_int_equal(
        apc_model_linearize(&apc_model_first_order, NULL, NULL, NULL, &A, &B, &C, &(double){0}, &why), 0);
    for (size_t i = 0; i < sizeof dead_times / sizeof *dead_times; i++) {
        const double x0 = -B / A * u0;
        const struct apc_linear_continuous from = {.size = sizeof from,
                                                   .nx = 1,
                                                   .nu = 1,
                                                   .ny = 1,
                                                   .A = &A,
                                                   .B = &B,
                                                   .C = &C,
                                                   .u0 = &u0,
                                                   .x0 = &x0,
                                                   .y0 = &x0,
                                                   .dead_time = &dead_times[i]};
        double expected[SAMPLES], y[SAMPLES][2];
        struct apc_linear *model;

        assert_int_equal(apc_linear_from_continuous(&model, &from, 0.1, &why), 0);
        assert_int_equal(model->nx, 1 + (size_t)ceil(dead_times[i] / 0.1 - 1e-9));
        follow(model, y);
        the_plant_with_dead_time(dead_times[i], 0.1, expected);
        for (size_t k = 0; k < SAMPLES; k++)
            assert_near(y[k][0], expected[k], 1e-9);
        apc_linear_destroy(model);
    }
}

static void a_model_that_is_sampled_already_stays_as_it_is(void **state)
{
    const double A = -0.5, B = 2.0, C = 1.0, u0 = 0.7, dead_time = 0.25, late[] = {0.1, 0.1, 0.1};
    struct apc_linear_continuous from = {.size = sizeof from,
                                         .nx = 1,
                                         .nu = 1,
                                         .ny = 1,
                                         .A = &A,
                                         .B = &B,
                                         .C = &C,
                                         .u0 = &u0,
                                         .x0 = &u0,
                                         .y0 = &u0,
                                         .dead_time = &dead_time};
    double expected[SAMPLES][2] = {{0.0}}, y[SAMPLES][2] = {{0.0}};
    struct apc_linear *model, *same;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_from_continuous(&model, &from, 0.1, &why), 0);
    from.nx = model->nx;
    from.A = model->A;
    from.B = model->B;
    from.C = model->C;
    from.D = model->D;
    from.x0 = model->x0;
    from.dead_time = NULL;
    assert_int_equal(apc_linear_from_sampled(&same, &from, 0.1, &why), 0);
    follow(model, expected);
    follow(same, y);
    assert_memory_equal(y, expected, sizeof y);
    assert_int_equal(same->nx_plant, model->nx);
    apc_linear_destroy(same);
    from.dead_time = late;
    assert_int_equal(apc_linear_from_sampled(&same, &from, 0.1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "states of A"));
    assert_null(same);
    apc_linear_destroy(model);
}

/* Of pairs with poles, zero and delay alone, by the sum over steps of their step responses. */
static double step_response(const struct apc_transfer *g, double t)
{
    const double a = g->tau[0], b = g->tau[1], z = g->zero;

    t -= g->dead_time;
    if (t < -1e-9)
        return 0.0;
    t = fmax(t, 0.0);
    if (a == 0.0)
        return g->gain * (g->integrating ? t : 1.0);
    if (g->integrating && b == 0.0)
        return g->gain * (t + (z - a) * (1.0 - exp(-t / a)));
    if (b == 0.0)
        return g->gain * (1.0 + (z - a) / a * exp(-t / a));
    assert_false(g->integrating);
    return g->gain * (1.0 + ((z - a) * exp(-t / a) - (z - b) * exp(-t / b)) / (a - b));
}

/* Promise(analysis/linear-models-follow) */
static void transfer_functions_give_their_step_responses(void **state)
{
    const struct apc_transfer g[] = {
        {.gain = 2.0, .tau = {3.0, 0.7}, .zero = -1.5, .dead_time = 0.35},
        {.gain = -0.4, .tau = {1.0, 0.0}, .zero = 0.4},
        {.gain = 0.3, .integrating = true, .dead_time = 1.0},
        {.gain = 5.0, .dead_time = 0.42},
    };
    const double y0[] = {7.0, -3.0}, u0[] = {1.0, 2.0};
    const double Ts = 0.2;
    double y[SAMPLES][2];
    struct apc_linear *model;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 2, 1, 1, g, u0, y0, Ts, &why), 0);
    assert_int_equal(model->nx_plant, 4);
    assert_int_equal(model->nx_held, 5 + 3); /* the longest dead time of each input */
    follow(model, y);
    for (size_t k = 0; k < SAMPLES; k++) {
        for (size_t i = 0; i < 2; i++) {
            double expected = y0[i];

            for (size_t j = 0; j < 2; j++) {
                for (size_t m = 0; m <= k; m++) {
                    double change = input(m, j) - (m ? input(m - 1, j) : 0.0);

                    expected += change * step_response(&g[i * 2 + j], (double)(k - m) * Ts);
                }
            }
            assert_near(y[k][i], expected, 1e-9);
        }
    }
    apc_linear_destroy(model);
}

static void an_integrator_behind_a_lag_with_a_lead(void **state)
{
    const struct apc_transfer g = {.gain = 0.5, .tau = {2.0, 0.0}, .zero = 3.0, .integrating = true};
    double y[SAMPLES][2];
    struct apc_linear *model;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &g, NULL, NULL, 0.2, &why), 0);
    follow(model, y);
    for (size_t k = 0; k < SAMPLES; k++) {
        double expected = 0.0;

        for (size_t m = 0; m <= k; m++)
            expected +=
                (input(m, 0) - (m ? input(m - 1, 0) : 0.0)) * step_response(&g, (double)(k - m) * 0.2);
        assert_near(y[k][0], expected, 1e-9);
    }
    apc_linear_destroy(model);
}

/* Two states of which only the sum is seen would leave an estimator nothing to hold on to. */
static void integrators_of_one_output_are_one_state(void **state)
{
    const struct apc_transfer g[] = {{.gain = 0.2, .integrating = true, .dead_time = 0.4},
                                     {.gain = -0.1, .tau = {1.0, 0.0}, .integrating = true}};
    double y[SAMPLES][2];
    struct apc_linear *model;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 2, 0, g, NULL, NULL, 0.2, &why), 0);
    assert_int_equal(model->nx_plant, 2);
    follow(model, y);
    for (size_t k = 0; k < SAMPLES; k++) {
        double expected = 0.0;

        for (size_t j = 0; j < 2; j++) {
            for (size_t m = 0; m <= k; m++)
                expected +=
                    (input(m, j) - (m ? input(m - 1, j) : 0.0)) * step_response(&g[j], (double)(k - m) * 0.2);
        }
        assert_near(y[k][0], expected, 1e-9);
    }
    apc_linear_destroy(model);
}

/* ---- Unknown disturbances ------------------------------------------------------------------------ */

static struct apc_linear *two_tanks(bool integrating)
{
    const struct apc_transfer g[] = {
        {.gain = 1.0, .tau = {5.0, 0.0}, .dead_time = 0.5, .integrating = integrating},
        {.gain = 0.5, .tau = {9.0, 2.0}},
        {.gain = 0.0},
        {.gain = 2.0, .tau = {4.0, 0.0}}};
    struct apc_linear *model;
    struct apc_error why;

    assert_int_equal(apc_linear_from_transfer(&model, 2, 2, 0, g, NULL, NULL, 0.5, &why), 0);
    return model;
}

static void a_disturbance_at_an_input_acts_as_the_input_does(void **state)
{
    const struct apc_linear_unknown unknown[] = {{APC_AT_INPUT, 0}, {APC_AT_OUTPUT, 1}};
    struct apc_linear *from = two_tanks(false), *model;
    double x[STATES_MOST], next[STATES_MOST], y[2], expected[SAMPLES][2], u[2];
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_disturb(&model, from, unknown, 2, &why), 0);
    assert_int_equal(model->nx, from->nx + 2);
    follow(from, expected);
    memcpy(x, model->x0, model->nx * sizeof(*x));
    x[from->nx + 1] = 0.25;
    for (size_t k = 0; k < SAMPLES; k++) {
        x[from->nx] = input(k, 0); /* all of input 0 comes as a disturbance */
        u[0] = 0.0;
        u[1] = input(k, 1);
        apc_linear_output(model, x, u, y);
        assert_near(y[0], expected[k][0], 1e-12);
        assert_near(y[1], expected[k][1] + 0.25, 1e-12);
        apc_linear_next(model, x, u, next);
        memcpy(x, next, model->nx * sizeof(*x));
    }
    apc_linear_destroy(model);
    apc_linear_destroy(from);
}

/* Promise(analysis/linear-models-follow) */
static void disturbances_that_nobody_could_tell_apart_are_refused(void **state)
{
    const struct apc_linear_unknown twice[] = {{APC_AT_OUTPUT, 0}, {APC_AT_OUTPUT, 0}},
                                    both[] = {{APC_AT_OUTPUT, 0}, {APC_AT_OUTPUT, 1}, {APC_AT_INPUT, 1}},
                                    absent = {APC_AT_INPUT, 2}, at_output = {APC_AT_OUTPUT, 0},
                                    at_input = {APC_AT_INPUT, 0};
    struct apc_linear *model, *stable = two_tanks(false), *integrating = two_tanks(true);
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_disturb(&model, stable, twice, 2, &why), APC_EINVAL);
    assert_null(model);
    assert_non_null(strstr(why.text, "number 2, at output 1"));
    assert_int_equal(apc_linear_disturb(&model, stable, both, 3, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "no more of them than measurements"));
    assert_int_equal(apc_linear_disturb(&model, stable, &absent, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "no such input"));
    assert_int_equal(apc_linear_disturb(&model, integrating, &at_output, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "integrating"));
    assert_int_equal(apc_linear_disturb(&model, integrating, &at_input, 1, &why), 0);
    apc_linear_destroy(model);
    integrating->C[0] = integrating->C[integrating->nx] = 0.0; /* what integrates is seen no more */
    assert_int_equal(apc_linear_disturb(&model, integrating, &at_input, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "state 1 of the model moves without the measurements showing it"));
    for (size_t i = 0; i < stable->nx; i++)
        stable->x0[i] = 1.0 + (double)i;
    assert_int_equal(apc_linear_disturb(&model, stable, &at_input, 1, &why), 0);
    assert_memory_equal(model->x0, stable->x0, stable->nx * sizeof(*model->x0));
    assert_near(model->x0[stable->nx], 0.0, 0.0);
    apc_linear_destroy(model);
    apc_linear_destroy(integrating);
    apc_linear_destroy(stable);
}

/* ---- What is refused ----------------------------------------------------------------------------- */

static void what_makes_no_sense_is_refused_with_a_sentence(void **state)
{
    const struct {
        struct apc_transfer g;
        double Ts;
        const char *says;
    } bad[] = {
        {{.gain = 1.0, .tau = {1.0, 0.0}}, 0.0, "period"},
        {{.gain = 1.0, .tau = {1.0, 0.0}}, (double)NAN, "period"},
        {{.gain = (double)NAN, .tau = {1.0, 0.0}}, 1.0, "must be numbers"},
        {{.gain = 1.0, .tau = {-1.0, 0.0}}, 1.0, "not negative"},
        {{.gain = 1.0, .tau = {0.0, 1.0}}, 1.0, "beside the first"},
        {{.gain = 1.0, .zero = 1.0}, 1.0, "a zero needs a time constant"},
        {{.gain = 1.0, .tau = {1.0, 0.0}, .dead_time = -0.1}, 1.0, "dead time of input 1"},
        {{.gain = 1.0, .tau = {1.0, 0.0}, .dead_time = 1e9}, 1e-3, "dead time of input 1"},
        {{.gain = 1.0, .tau = {1.0, 0.0}, .dead_time = 9.9e3}, 1.0, "no more than"},
    };
    struct apc_linear *model;
    struct apc_error why;
    (void)state;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &bad[i].g, NULL, NULL, bad[i].Ts, &why),
                         APC_EINVAL);
        assert_null(model);
        if (!strstr(why.text, bad[i].says))
            fail_msg("number %zu: \"%s\" does not say \"%s\"", i, why.text, bad[i].says);
    }
    assert_int_equal(apc_linear_from_transfer(&model, 0, 1, 0, &bad[0].g, NULL, NULL, 1.0, &why), APC_EINVAL);
    assert_int_equal(apc_linear_from_continuous(
                         &model,
                         &(struct apc_linear_continuous){
                             .size = sizeof(struct apc_linear_continuous), .nx = 1, .nu = 1, .ny = 1},
                         1.0, &why),
                     APC_EINVAL);
    apc_linear_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sampled_model_follows_the_plant_for_any_dead_time),
        cmocka_unit_test(a_model_that_is_sampled_already_stays_as_it_is),
        cmocka_unit_test(transfer_functions_give_their_step_responses),
        cmocka_unit_test(an_integrator_behind_a_lag_with_a_lead),
        cmocka_unit_test(integrators_of_one_output_are_one_state),
        cmocka_unit_test(a_disturbance_at_an_input_acts_as_the_input_does),
        cmocka_unit_test(disturbances_that_nobody_could_tell_apart_are_refused),
        cmocka_unit_test(what_makes_no_sense_is_refused_with_a_sentence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
