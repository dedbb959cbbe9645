/* SPDX-License-Identifier: BSD-3-Clause */
/* Every built-in model against published and independently computed values. */
#include "check.h"

#include "apcplant.h"

#include <stdlib.h>
#include <string.h>

#define N_MAX 110

static const struct apc_model *find(const char *name)
{
    const struct apc_model *model = NULL;
    void *handle;
    struct apc_error why = {""};

    if (apc_model_find(name, &model, &handle, &why) < 0)
        fail_msg("%s", why.text);
    return model;
}

static struct apc_plant *make(const char *name, const double *x0, const char *integrator)
{
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = integrator};
    struct apc_plant *plant = NULL;
    struct apc_error why = {""};

    if (apc_plant_create(&plant, find(name), NULL, x0, &o, &why) < 0)
        fail_msg("%s", why.text);
    return plant;
}

static void advance(struct apc_plant *plant, double dt, const double *u)
{
    if (apc_plant_advance(plant, dt, u) < 0)
        fail_msg("%s", apc_plant_error(plant));
}

static void equilibrium(const char *name, const double *u, double *x)
{
    struct apc_error why = {""};

    if (apc_model_equilibrium(find(name), NULL, u, x, &why) < 0)
        fail_msg("%s", why.text);
}

/* ---- Of all of them ------------------------------------------------------------------------ */

static void all_of_them_are_found_by_name_and_say_what_they_are(void **state)
{
    size_t n = 0;

    (void)state;
    for (const struct apc_model *m; (m = apc_model_built_in(n)) != NULL; n++) {
        assert_ptr_equal(find(m->name), m);
        assert_true(m->nx <= N_MAX && m->nu + m->nd <= N_MAX && m->ny <= N_MAX);
        assert_non_null(m->description);
        assert_non_null(m->state);
        assert_non_null(m->input);
        assert_non_null(m->output);
        assert_true(m->nd == 0 || m->disturbance != NULL);
    }
    assert_int_equal(n, 11);
}

/* At its nominal inputs a plant that begins in its steady state stays there, under every integrator. */
static void the_nominal_steady_state_is_kept(void **state)
{
    static const char *const integrators[] = {"cvode", "adams", "rk4"};

    (void)state;
    for (size_t i = 0; apc_model_built_in(i); i++) {
        const struct apc_model *m = apc_model_built_in(i);
        double x0[N_MAX], u[N_MAX];

        for (size_t k = 0; k < m->nx; k++)
            x0[k] = m->state[k].initial;
        for (size_t k = 0; k < m->nu; k++)
            u[k] = m->input[k].initial;
        equilibrium(m->name, NULL, x0);
        for (size_t n = 0; n < 3; n++) {
            struct apc_plant *plant = make(m->name, x0, integrators[n]);

            for (int k = 0; k < 50; k++)
                advance(plant, 0.5, u);
            for (size_t k = 0; k < m->nx; k++)
                assert_near(apc_plant_state(plant)[k], x0[k], 1e-7 * fmax(1.0, fabs(x0[k])));
            apc_plant_destroy(plant);
        }
    }
}

/* From a state and inputs off the nominal ones all integrators agree. */
static void the_integrators_agree(void **state)
{
    (void)state;
    for (size_t i = 0; apc_model_built_in(i); i++) {
        const struct apc_model *m = apc_model_built_in(i);
        double x0[N_MAX], u[N_MAX];
        struct apc_plant *plant[3];

        for (size_t k = 0; k < m->nx; k++)
            x0[k] = 1.02 * m->state[k].initial + 0.01;
        for (size_t k = 0; k < m->nu; k++)
            u[k] = 0.9 * m->input[k].initial + 0.1;
        plant[0] = make(m->name, x0, "cvode");
        plant[1] = make(m->name, x0, "adams");
        plant[2] = make(m->name, x0, "rk4");
        for (int k = 0; k < 40; k++) {
            for (size_t n = 0; n < 3; n++)
                advance(plant[n], 0.05, u);
        }
        for (size_t k = 0; k < m->nx; k++) {
            double x = apc_plant_state(plant[2])[k];

            assert_near(apc_plant_state(plant[0])[k], x, 2e-5 * fmax(1.0, fabs(x)));
            assert_near(apc_plant_state(plant[1])[k], x, 2e-5 * fmax(1.0, fabs(x)));
        }
        for (size_t n = 0; n < 3; n++)
            apc_plant_destroy(plant[n]);
    }
}

/* ---- One by one ---------------------------------------------------------------------------- */

/* Promise(plants/plant-column-checked): Each plant is as the column "checked against" says. */
static void the_servo_follows_its_closed_form(void **state)
{
    static const char *const integrators[] = {"cvode", "adams", "rk4", "exact"};
    static const double tolerance[] = {1e-2, 1e-2, 1e-8, 1e-9};
    const double u = 0.5;

    (void)state;
    for (size_t n = 0; n < 4; n++) {
        struct apc_plant *plant = make("servo", NULL, integrators[n]);

        for (int k = 0; k < 500; k++)
            advance(plant, 0.006, &u);
        assert_near(apc_plant_state(plant)[0], 500.0 * (3.0 - 1.0 + exp(-3.0)), tolerance[n]);
        assert_near(apc_plant_state(plant)[1], 500.0 * (1.0 - exp(-3.0)), tolerance[n]);
        apc_plant_destroy(plant);
    }
}

/* Promise(plants/plant-column-checked) */
static void the_double_tank_settles_at_its_levels(void **state)
{
    struct apc_plant *plant = make("double-tank", NULL, "cvode");
    double x[2] = {0.5, 0.5}, u = 10.0, y[2];

    (void)state;
    for (int k = 0; k < 3000; k++)
        advance(plant, 1.0, &u);
    apc_plant_output(plant, &u, y);
    assert_near(y[0], 0.17918, 1e-5);
    assert_near(y[1], 0.12707, 1e-5);
    equilibrium("double-tank", NULL, x);
    assert_near(x[0], pow(0.03 / 0.019, 2) / (2.0 * 9.81), 1e-12);
    assert_near(x[1], pow(0.03 / 0.016, 2) / (2.0 * 9.81), 1e-12);
    apc_plant_destroy(plant);
}

/* Torricelli: with the pump off sqrt(h) falls by a sqrt(2 g) / 2 A each second until the tank is empty. */
/* Promise(plants/plant-column-checked) */
static void a_tank_runs_empty_and_stays_so(void **state)
{
    static const char *const integrators[] = {"cvode", "adams", "rk4"};
    const double x0[] = {0.25, 0.0}, u = -1.0; /* a pump that does not run backwards */

    (void)state;
    for (size_t n = 0; n < 3; n++) {
        struct apc_plant *plant = make("double-tank", x0, integrators[n]);

        for (int k = 0; k < 20; k++)
            advance(plant, 0.2, &u);
        assert_near(apc_plant_state(plant)[0], pow(0.5 - 0.019 * sqrt(2.0 * 9.81) / (2.0 * 0.5) * 4.0, 2),
                    1e-5);
        for (int k = 0; k < 1000; k++)
            advance(plant, 0.2, &u);
        assert_near(apc_plant_state(plant)[0], 0.0, 1e-4);
        assert_near(apc_plant_state(plant)[1], 0.0, 1e-4);
        apc_plant_destroy(plant);
    }
}

/* Energy of the pendulum on a free cart without friction: kept. */
static double energy(const double *x, const double *p)
{
    double ml = p[1] * p[3];

    return 0.5 * (p[0] + p[1]) * x[1] * x[1] + 0.5 * (p[4] + ml * p[3]) * x[3] * x[3] -
           ml * cos(x[2]) * x[1] * x[3] + ml * p[5] * cos(x[2]);
}

/* Promise(plants/plant-column-checked) */
static void the_pendulum_falls_and_keeps_its_energy(void **state)
{
    const struct apc_model *m = find("pendulum");
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "rk4"};
    const double p[] = {0.5, 0.2, 0.0, 0.3, 0.006, 9.8}, x0[] = {0.0, 0.3, 0.1, 0.0}, u = 0.0;
    struct apc_plant *plant = NULL;
    double before = energy(x0, p), furthest = 0.0;

    (void)state;
    assert_int_equal(apc_plant_create(&plant, m, p, x0, &o, NULL), 0);
    for (int k = 0; k < 1000; k++) {
        advance(plant, 0.01, &u);
        assert_near(energy(apc_plant_state(plant), p), before, 1e-8);
        furthest = fmax(furthest, fabs(apc_plant_state(plant)[2]));
    }
    assert_true(furthest > 3.0);
    apc_plant_destroy(plant);
}

/* Promise(plants/plant-column-checked) */
static void the_quadruple_tank_settles_at_its_levels(void **state)
{
    static const double expected[4] = {12.263, 12.783, 1.634, 1.409};
    static const double published[4] = {12.6, 13.0, 4.8, 4.9};
    double x[4] = {5.0, 5.0, 5.0, 5.0};

    (void)state;
    equilibrium("quadruple-tank", NULL, x);
    for (size_t i = 0; i < 4; i++)
        assert_near(x[i], expected[i], 5e-4);
    equilibrium("quadruple-tank-nonminimum", NULL, x);
    for (size_t i = 0; i < 4; i++)
        assert_near(x[i], published[i], 0.4); /* rounded there to what was measured */
}

/* What went in is there, or has left through the outlets. */
/* Promise(plants/plant-column-checked) */
static void the_four_tanks_balance_their_mass(void **state)
{
    const struct apc_model *m = find("four-tank");
    struct apc_plant *plant = make("four-tank", NULL, "rk4");
    const double u[] = {320.0, 250.0};
    double out = 0.0, before = 0.0, after = 0.0, worst;

    (void)state;
    assert_int_equal(apc_plant_disturb(plant, 0, 130.0), 0);
    for (size_t i = 0; i < 4; i++)
        before += apc_plant_state(plant)[i];
    for (int k = 0; k < 20000; k++) { /* trapezoids */
        for (int side = 0; side < 2; side++) {
            for (size_t i = 0; i < 2; i++)
                out += 0.05 * 0.5 * 1.2272 * sqrt(2.0 * 981.0 * apc_plant_state(plant)[i] / 380.1327);
            if (side == 0)
                advance(plant, 0.05, u);
        }
    }
    for (size_t i = 0; i < 4; i++)
        after += apc_plant_state(plant)[i];
    worst = fabs(after - before - (1000.0 * (320.0 + 250.0 + 130.0 + 150.0) - out));
    assert_true(m->nd == 2);
    assert_near(worst, 0.0, 0.01);
    apc_plant_destroy(plant);
}

/* Promise(plants/plant-column-checked) */
static void the_modified_four_tank_settles_at_its_masses(void **state)
{
    static const double expected[4] = {17612.0124, 29640.6695, 4644.2195, 9378.4931};
    double x[4] = {1e4, 1e4, 1e4, 1e4};

    (void)state;
    equilibrium("four-tank", NULL, x);
    for (size_t i = 0; i < 4; i++)
        assert_near(x[i], expected[i], 5e-4);
}

/* Promise(plants/plant-column-checked) */
static void a_full_tank_runs_over(void **state)
{
    struct apc_plant *plant = make("quadruple-tank", NULL, "cvode");
    const double u[] = {10.0, 10.0};

    (void)state;
    for (int k = 0; k < 1000; k++)
        advance(plant, 1.0, u);
    for (size_t i = 0; i < 4; i++)
        assert_true(apc_plant_state(plant)[i] < 21.0);
    assert_true(apc_plant_state(plant)[0] > 20.0);
    apc_plant_destroy(plant);
}

/* Promise(plants/plant-column-checked) */
static void the_van_de_vusse_reactor_settles_at_its_point(void **state)
{
    static const double expected[4] = {2.1400, 1.0903, 114.194, 112.910};
    static const double tolerance[4] = {5e-5, 5e-5, 5e-4, 5e-4};
    const double x0[] = {1.0, 0.5, 100.0, 100.0}, u[] = {14.19, -1113.5};
    struct apc_plant *plant = make("van-de-vusse", x0, "cvode");
    double x[4] = {2.0, 1.0, 110.0, 110.0};

    (void)state;
    equilibrium("van-de-vusse", NULL, x);
    for (size_t i = 0; i < 4; i++)
        assert_near(x[i], expected[i], tolerance[i]);
    for (int k = 0; k < 2000; k++)
        advance(plant, 10.0, u);
    for (size_t i = 0; i < 4; i++)
        assert_near(apc_plant_state(plant)[i], x[i], 1e-5 * x[i]);
    apc_plant_destroy(plant);
}

/* With no reaction heat and no B in the feed, r is known from the balances: at rest cB = cBin - 2 (cAin -
 * cA). */
static double steady_temperature(double feed, double start)
{
    double u[4] = {feed, 0.8, 1.2, 0.5}, x[3] = {0.8 - (start - 0.5) / 133.779, 0.0, start};

    x[1] = 1.2 - 2.0 * (0.8 - x[0]);
    equilibrium("adiabatic-cstr", u, x);
    assert_near(x[0], 0.8 - (x[2] - 0.5) / 133.779, 1e-9);
    assert_near(x[1], 1.2 - 2.0 * (x[2] - 0.5) / 133.779, 1e-9);
    return x[2];
}

/* Promise(plants/plant-column-checked) */
static void the_adiabatic_reactor_has_three_steady_states_between_its_folds(void **state)
{
    double u[4] = {290.0, 0.8, 1.2, 0.5}, x[3] = {0.7, 1.0, 13.3};
    struct apc_error why = {""};

    (void)state;
    assert_near(steady_temperature(500.0, 3.0), 3.95, 5e-3);
    assert_near(steady_temperature(500.0, 38.0), 38.62, 5e-3);
    assert_near(steady_temperature(500.0, 70.0), 68.56, 5e-3);
    /* just within the folds, 292.81 at 13.29 and 636.80 at 56.30, two of them are close together */
    assert_near(steady_temperature(292.82, 12.8), 13.29, 0.25);
    assert_near(steady_temperature(292.82, 13.8), 13.29, 0.25);
    assert_near(steady_temperature(636.79, 55.8), 56.30, 0.25);
    assert_near(steady_temperature(636.79, 56.8), 56.30, 0.25);
    /* and beyond them these are gone */
    if (apc_model_equilibrium(find("adiabatic-cstr"), NULL, u, x, &why) == 0)
        assert_true(fabs(x[2] - 13.29) > 10.0);
}

static void the_hot_and_the_cold_state_of_the_reactor_are_stable_and_the_middle_one_is_not(void **state)
{
    const double u = 500.0, off = 0.5;
    const struct {
        double start, expected;
    } cases[] = {{3.95, 3.95}, {38.62 - off, 3.95}, {38.62 + off, 68.56}, {68.56, 68.56}};

    (void)state;
    for (size_t i = 0; i < 4; i++) {
        double conversion = (cases[i].start - 0.5) / 133.779;
        const double x0[] = {0.8 - conversion, 1.2 - 2.0 * conversion, cases[i].start};
        struct apc_plant *plant = make("adiabatic-cstr", x0, "cvode");

        for (int k = 0; k < 3000; k++)
            advance(plant, 1.0, &u);
        assert_near(apc_plant_state(plant)[2], cases[i].expected, 6e-3);
        apc_plant_destroy(plant);
    }
}

/* Promise(plants/plant-column-checked) */
static void the_temperature_lab_warms_as_it_should(void **state)
{
    static const char *const integrators[] = {"cvode", "rk4", "exact"};
    static const struct {
        int t;
        double T1;
    } expected[] = {{60, 28.790}, {120, 36.420}, {300, 46.946}, {600, 50.498}};
    const double u[] = {50.0, 0.0};

    (void)state;
    for (size_t n = 0; n < 3; n++) {
        struct apc_plant *plant = make("temperature-lab", NULL, integrators[n]);
        int t = 0;

        for (size_t i = 0; i < 4; i++) {
            for (; t < expected[i].t; t++)
                advance(plant, 1.0, u);
            assert_near(apc_plant_state(plant)[2], expected[i].T1, 5e-4);
        }
        apc_plant_destroy(plant);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_of_them_are_found_by_name_and_say_what_they_are),
        cmocka_unit_test(the_nominal_steady_state_is_kept),
        cmocka_unit_test(the_integrators_agree),
        cmocka_unit_test(the_servo_follows_its_closed_form),
        cmocka_unit_test(the_double_tank_settles_at_its_levels),
        cmocka_unit_test(a_tank_runs_empty_and_stays_so),
        cmocka_unit_test(the_pendulum_falls_and_keeps_its_energy),
        cmocka_unit_test(the_quadruple_tank_settles_at_its_levels),
        cmocka_unit_test(the_four_tanks_balance_their_mass),
        cmocka_unit_test(the_modified_four_tank_settles_at_its_masses),
        cmocka_unit_test(a_full_tank_runs_over),
        cmocka_unit_test(the_van_de_vusse_reactor_settles_at_its_point),
        cmocka_unit_test(the_adiabatic_reactor_has_three_steady_states_between_its_folds),
        cmocka_unit_test(the_hot_and_the_cold_state_of_the_reactor_are_stable_and_the_middle_one_is_not),
        cmocka_unit_test(the_temperature_lab_warms_as_it_should),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
