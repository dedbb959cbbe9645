/* SPDX-License-Identifier: BSD-3-Clause */
/* Integrators by name, the exact step of linear models, dead time. */
#include "check.h"

#include "apcplant.h"

#include <string.h>

static struct apc_plant *make(const char *name, const struct apc_plant_options *o)
{
    const struct apc_model *model = NULL;
    struct apc_plant *plant = NULL;
    struct apc_error why = {""};
    void *handle;

    if (apc_model_find(name, &model, &handle, &why) < 0 ||
        apc_plant_create(&plant, model, NULL, NULL, o, &why) < 0)
        fail_msg("%s", why.text);
    return plant;
}

static double input(int k)
{
    return sin(0.05 * k) + (k / 750 % 2 ? 1.0 : -0.5);
}

/* ---- Exactness ----------------------------------------------------------------------------- */

static double worst_error(const char *integrator)
{
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = integrator};
    struct apc_plant *plant = make("first-order", &o);
    const double a = exp(-0.02);
    double x = 0.0, worst = 0.0;

    for (int k = 0; k < 3000; k++) {
        double u = input(k);

        assert_int_equal(apc_plant_advance(plant, 0.2, &u), 0);
        x = a * x + (1.0 - a) * 10.0 * u;
        worst = fmax(worst, fabs(apc_plant_state(plant)[0] - x));
    }
    apc_plant_destroy(plant);
    print_message("%s: largest error %g\n", integrator, worst);
    return worst;
}

/*
 * Promise(plants/integrators-exact-say): Integrators are as exact as they say; `exact` refuses what is not
 *   linear; a failure is told with time and state.
 */
static void each_integrator_is_as_exact_as_it_says(void **state)
{
    (void)state;
    assert_true(worst_error("exact") < 1e-12);
    assert_true(worst_error("rk4") < 1e-11);
    assert_true(worst_error("cvode") < 1e-5);
    assert_true(worst_error("adams") < 1e-5);
}

/* A matrix exponential against a rotation: fast against the interval, so that it has to be scaled. */
static int rotation_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = -100.0 * x[1] + u[0] + 3.0;
    dx[1] = 100.0 * x[0];
    return 0;
}

static void copy_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

static void the_exact_step_turns_a_rotation_by_any_angle(void **state)
{
    static const struct apc_model rotation = {
        .abi = APC_MODEL_ABI, .name = "rotation", .nx = 2, .nu = 1, .ny = 1, .f = rotation_f, .g = copy_g};
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "exact"};
    const double x0[] = {1.0, 0.0}, dt[] = {0.5, 0.5, 0.001, 7.0}, u = -3.0;
    struct apc_plant *plant = NULL;
    double t = 0.0;

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &rotation, NULL, x0, &o, NULL), 0);
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(apc_plant_advance(plant, dt[i], &u), 0);
        t += dt[i];
        assert_near(apc_plant_state(plant)[0], cos(100.0 * t), 1e-11);
        assert_near(apc_plant_state(plant)[1], sin(100.0 * t), 1e-11);
    }
    apc_plant_destroy(plant);
}

static int timed_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)p;
    dx[0] = -x[0] + u[0] + 0.001 * t;
    return 0;
}

static int bent_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = -x[0] + fabs(u[0]);
    return 0;
}

/* Promise(plants/integrators-exact-say) */
static void what_is_not_linear_is_refused_by_the_exact_step(void **state)
{
    static const struct apc_model timed = {
        .abi = APC_MODEL_ABI, .name = "timed", .nx = 1, .nu = 1, .ny = 1, .f = timed_f, .g = copy_g};
    static const struct apc_model bent = {
        .abi = APC_MODEL_ABI, .name = "bent", .nx = 1, .nu = 1, .ny = 1, .f = bent_f, .g = copy_g};
    static const char *const linear[] = {"first-order", "servo", "temperature-lab", "hundred"};
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "exact"};
    struct apc_plant *plant;
    struct apc_error why;
    size_t n_linear = 0;

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &timed, NULL, NULL, &o, &why), APC_EINVAL);
    assert_int_equal(apc_plant_create(&plant, &bent, NULL, NULL, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "not linear"));
    for (size_t i = 0; apc_model_built_in(i); i++) {
        int rc = apc_plant_create(&plant, apc_model_built_in(i), NULL, NULL, &o, &why);
        bool is_linear = false;

        for (size_t k = 0; k < sizeof(linear) / sizeof(linear[0]); k++)
            is_linear |= strcmp(linear[k], apc_model_built_in(i)->name) == 0;
        assert_int_equal(rc, is_linear ? 0 : APC_EINVAL);
        n_linear += is_linear;
        apc_plant_destroy(plant);
    }
    assert_int_equal(n_linear, sizeof(linear) / sizeof(linear[0]));
}

/* ---- Dead time ----------------------------------------------------------------------------- */

/* x after a step of the input from 0 to 1 at t = 0 that acts theta later. */
/* Promise(experiment/dead-time-process): Dead time, process noise, disturbances at their instants. */
static void a_step_acts_after_the_dead_time_and_not_before(void **state)
{
    static const char *const integrators[] = {"exact", "rk4", "cvode", "adams"};
    static const double tolerance[] = {1e-12, 1e-9, 1e-5, 1e-5};
    static const double thetas[] = {0.2, 1.0, 0.05, 0.33, 3.14159};
    const double u = 1.0;

    (void)state;
    for (size_t n = 0; n < 4; n++) {
        for (size_t i = 0; i < 5; i++) {
            const struct apc_plant_options o = {
                .size = sizeof(o), .integrator = integrators[n], .dead_time = thetas[i]};
            struct apc_plant *plant = make("first-order", &o);

            for (int k = 1; k <= 100; k++) {
                double since = 0.2 * k - thetas[i];

                assert_int_equal(apc_plant_advance(plant, 0.2, &u), 0);
                assert_near(apc_plant_state(plant)[0], since > 1e-9 ? 10.0 * (1.0 - exp(-0.1 * since)) : 0.0,
                            tolerance[n]);
            }
            apc_plant_destroy(plant);
        }
    }
}

/* An input that changes all the time, through a dead time that is no multiple of the interval: the same as
 * the plant without one, looked at later. */
static void dead_time_shifts_the_response_and_changes_nothing_else(void **state)
{
    const struct apc_plant_options late = {.size = sizeof(late), .integrator = "exact", .dead_time = 1.07};
    const struct apc_plant_options prompt = {.size = sizeof(prompt), .integrator = "exact"};
    struct apc_plant *a = make("first-order", &late), *b = make("first-order", &prompt);
    double u;

    (void)state;
    for (int k = 0; k < 1000; k++) {
        u = input(k);
        assert_int_equal(apc_plant_advance(a, 0.2, &u), 0);
    }
    for (int k = 0; k < 994;
         k++) { /* at 200 s a has felt what there was by 198.93: 994 intervals and 0.13 s */
        u = input(k);
        assert_int_equal(apc_plant_advance(b, 0.2, &u), 0);
    }
    u = input(994);
    assert_int_equal(apc_plant_advance(b, 0.13, &u), 0);
    assert_near(apc_plant_state(a)[0], apc_plant_state(b)[0], 1e-10);
    apc_plant_destroy(a);
    apc_plant_destroy(b);
}

static void more_changes_than_can_be_under_way_are_an_error_that_changes_nothing(void **state)
{
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "exact", .dead_time = 1e6};
    struct apc_plant *plant = make("first-order", &o);
    double u = 0.0, t;
    int rc = 0, k;

    (void)state;
    for (k = 1; k < 10000 && rc == 0; k++) {
        u = k;
        t = apc_plant_time(plant);
        rc = apc_plant_advance(plant, 0.1, &u);
    }
    assert_int_equal(rc, APC_ESOLVER);
    assert_int_equal(k, 8192 + 2);
    assert_non_null(strstr(apc_plant_error(plant), "dead time"));
    assert_true(apc_plant_time(plant) == t);
    u = k - 2; /* the one before: no change */
    assert_int_equal(apc_plant_advance(plant, 0.1, &u), 0);
    apc_plant_destroy(plant);
}

/* ---- Disturbances, kicks, errors ----------------------------------------------------------- */

static void a_disturbance_acts_from_then_on(void **state)
{
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "exact", .dead_time = 5.0};
    struct apc_plant *plant = make("servo", &o);
    const double u = 0.0;

    (void)state;
    assert_int_equal(apc_plant_disturb(plant, 0, 0.001), 0); /* no dead time for it */
    assert_int_equal(apc_plant_advance(plant, 1.0, &u), 0);
    assert_near(apc_plant_state(plant)[1], 1.0 - exp(-1.0), 1e-12);
    assert_int_equal(apc_plant_disturb(plant, 1, 0.0), APC_EINVAL);
    assert_int_equal(apc_plant_disturb(plant, 0, (double)NAN), APC_EINVAL);
    apc_plant_destroy(plant);
}

static void a_kick_moves_a_state_within_its_range(void **state)
{
    struct apc_plant *plant = make("double-tank", NULL);

    (void)state;
    assert_int_equal(apc_plant_kick(plant, 1, 0.25), 0);
    assert_near(apc_plant_state(plant)[1], 0.25, 0.0);
    assert_int_equal(apc_plant_kick(plant, 1, -1.0), 0);
    assert_near(apc_plant_state(plant)[1], 0.0, 0.0);
    assert_int_equal(apc_plant_kick(plant, 2, 1.0), APC_EINVAL);
    assert_int_equal(apc_plant_kick(plant, 0, (double)INFINITY), APC_EINVAL);
    apc_plant_destroy(plant);
}

/* Two inputs of which now one, now the other changes: the plant without dead time, three intervals later. */
static void each_input_comes_as_late_as_the_other(void **state)
{
    const struct apc_plant_options late = {.size = sizeof(late), .integrator = "exact", .dead_time = 0.3};
    const struct apc_plant_options prompt = {.size = sizeof(prompt), .integrator = "exact"};
    struct apc_plant *a = make("temperature-lab", &late), *b = make("temperature-lab", &prompt);

    (void)state;
    for (int k = 0; k < 20000; k++) { /* in all more changes than can be under way at a time */
        const double now[] = {k % 3 ? 40.0 : 10.0 * (k % 7), 5.0 * (k % 11)};
        const int then = k - 3;
        const double before[] = {then % 3 ? 40.0 : 10.0 * (then % 7), 5.0 * (then % 11)}, none[] = {0.0, 0.0};

        assert_int_equal(apc_plant_advance(a, 0.1, now), 0);
        assert_int_equal(apc_plant_advance(b, 0.1, k < 3 ? none : before), 0);
        for (size_t i = 0; i < 4; i++)
            assert_near(apc_plant_state(a)[i], apc_plant_state(b)[i], 1e-8);
    }
    apc_plant_destroy(a);
    apc_plant_destroy(b);
}

/* x' = u, not defined above 1; y is x and the input that acts. */
static int ceiling_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = u[0];
    return x[0] > 1.0;
}

static void through_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)p;
    y[0] = x[0];
    y[1] = u[0];
}

static const struct apc_model ceiling = {
    .abi = APC_MODEL_ABI, .name = "ceiling", .nx = 1, .nu = 1, .ny = 2, .f = ceiling_f, .g = through_g};

static void after_a_failure_the_input_is_still_under_way(void **state)
{
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "rk4", .dead_time = 0.5};
    const double up = 10.0;
    struct apc_plant *plant = NULL;
    double y[2];

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &ceiling, NULL, NULL, &o, NULL), 0);
    assert_int_equal(apc_plant_advance(plant, 0.4, &up), 0);
    assert_int_equal(apc_plant_advance(plant, 0.4, &up), APC_ESOLVER);
    assert_near(apc_plant_time(plant), 0.4, 0.0);
    apc_plant_output(plant, &up, y);
    assert_near(y[1], 0.0, 0.0); /* it does not act yet */
    assert_int_equal(apc_plant_advance(plant, 0.15, &up), 0);
    assert_near(apc_plant_state(plant)[0], 0.5, 1e-9);
    apc_plant_output(plant, &up, y);
    assert_near(y[1], 10.0, 0.0);
    apc_plant_destroy(plant);
}

static void without_dead_time_an_output_sees_the_input_at_once(void **state)
{
    const double one = 1.0, u = 0.25;
    struct apc_plant *plant = NULL;
    double y[2];

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &ceiling, NULL, NULL, NULL, NULL), 0);
    assert_int_equal(apc_plant_advance(plant, 0.5, &one), 0);
    apc_plant_output(plant, &u, y);
    assert_near(y[0], 0.5, 1e-9);
    assert_near(y[1], 0.25, 0.0);
    apc_plant_destroy(plant);
}

static void bad_options_are_refused_with_the_reason(void **state)
{
    static const struct {
        struct apc_plant_options o;
        const char *says;
    } cases[] = {
        {{.size = sizeof(struct apc_plant_options), .integrator = "euler"}, "cvode, adams, rk4, exact"},
        {{.size = sizeof(struct apc_plant_options), .dead_time = -1.0}, "dead time"},
        {{.size = sizeof(struct apc_plant_options), .dead_time = (double)INFINITY}, "dead time"},
        {{.size = sizeof(struct apc_plant_options), .steps = 1000001}, "steps"},
        {{.size = sizeof(struct apc_plant_options), .rtol = 1.0}, "rtol is 1"},
        {{.size = sizeof(struct apc_plant_options), .rtol = (double)NAN}, "rtol"},
        {{.size = sizeof(struct apc_plant_options), .atol = -1e-9}, "atol is -1e-09"},
        {{.size = sizeof(struct apc_plant_options), .atol = (double)INFINITY}, "atol"},
    };
    const struct apc_plant_options most = {
        .size = sizeof(most), .steps = 1000000, .rtol = 0.5, .atol = 2.0, .dead_time = 1e9};
    const double negative[] = {-0.1, 0.0};
    const struct apc_model *tank = NULL;
    struct apc_plant *plant;
    struct apc_error why;
    void *handle;

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &cases[i].o, &why),
                         APC_EINVAL);
        assert_null(plant);
        assert_non_null(strstr(why.text, cases[i].says));
    }
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &most, &why), 0);
    apc_plant_destroy(plant);
    assert_int_equal(apc_model_find("double-tank", &tank, &handle, NULL), 0);
    assert_int_equal(apc_plant_create(&plant, tank, NULL, negative, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "h1 is -0.1"));
}

/* x' = x^2 under Runge-Kutta's fixed steps runs into infinity as well. */
static int explosive_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[0] * x[0];
    return 0;
}

/* Promise(plants/integrators-exact-say) */
static void a_diverging_plant_is_told_with_time_and_state_under_every_integrator(void **state)
{
    static const struct apc_param table[] = {{"hotness", "", "", 1.0, -1e299, 1e299}};
    static const struct apc_model explosive = {.abi = APC_MODEL_ABI,
                                               .name = "explosive",
                                               .nx = 1,
                                               .nu = 1,
                                               .ny = 1,
                                               .state = table,
                                               .f = explosive_f,
                                               .g = copy_g};
    static const char *const integrators[] = {"cvode", "adams", "rk4"};

    (void)state;
    for (size_t n = 0; n < 3; n++) {
        const struct apc_plant_options o = {.size = sizeof(o), .integrator = integrators[n]};
        struct apc_plant *plant = NULL;
        const double u = 0.0;
        double before;

        assert_int_equal(apc_plant_create(&plant, &explosive, NULL, NULL, &o, NULL), 0);
        assert_int_equal(apc_plant_advance(plant, 0.5, &u), 0);
        before = apc_plant_state(plant)[0];
        assert_near(before, 2.0, 1e-3);
        assert_int_equal(apc_plant_advance(plant, 1000.0, &u), APC_ESOLVER);
        assert_true(apc_plant_state(plant)[0] == before);
        assert_non_null(strstr(apc_plant_error(plant), "explosive at t = 0.5 s, hotness = "));
        apc_plant_destroy(plant);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_integrator_is_as_exact_as_it_says),
        cmocka_unit_test(the_exact_step_turns_a_rotation_by_any_angle),
        cmocka_unit_test(what_is_not_linear_is_refused_by_the_exact_step),
        cmocka_unit_test(a_step_acts_after_the_dead_time_and_not_before),
        cmocka_unit_test(dead_time_shifts_the_response_and_changes_nothing_else),
        cmocka_unit_test(more_changes_than_can_be_under_way_are_an_error_that_changes_nothing),
        cmocka_unit_test(each_input_comes_as_late_as_the_other),
        cmocka_unit_test(after_a_failure_the_input_is_still_under_way),
        cmocka_unit_test(without_dead_time_an_output_sees_the_input_at_once),
        cmocka_unit_test(a_disturbance_acts_from_then_on),
        cmocka_unit_test(a_kick_moves_a_state_within_its_range),
        cmocka_unit_test(bad_options_are_refused_with_the_reason),
        cmocka_unit_test(a_diverging_plant_is_told_with_time_and_state_under_every_integrator),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
