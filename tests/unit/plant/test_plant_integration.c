/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apcplant.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

static struct apc_plant *make(const struct apc_model *model, const double *p, const double *x0)
{
    struct apc_plant *plant = NULL;
    struct apc_error why = {""};

    if (apc_plant_create(&plant, model, p, x0, NULL, &why) < 0)
        fail_msg("%s", why.text);
    return plant;
}

/* ---- Models that try it --------------------------------------------------------------------- */

/* Robertson's chemical kinetics, the classic stiff problem; u adds to nothing. */
static long evaluations;

static int robertson_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    evaluations++;
    dx[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
    dx[2] = 3e7 * x[1] * x[1];
    dx[1] = -dx[0] - dx[2];
    return 0;
}

static void first_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

static const struct apc_param robertson_state[] = {
    {"a", "", "", 1.0, 0.0, 2.0}, {"b", "", "", 0.0, -1.0, 2.0}, {"c", "", "", 0.0, -1.0, 2.0}};
static const struct apc_model robertson = {.abi = APC_MODEL_ABI,
                                           .name = "robertson",
                                           .nx = 3,
                                           .nu = 1,
                                           .ny = 1,
                                           .state = robertson_state,
                                           .f = robertson_f,
                                           .g = first_g};

/* x' = u, but undefined for x > 1; NaN for x < -1. */
static int bounded_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = x[0] < -1.0 ? (double)NAN : u[0];
    return x[0] > 1.0;
}

static const struct apc_model bounded = {
    .abi = APC_MODEL_ABI, .name = "bounded", .nx = 1, .nu = 1, .ny = 1, .f = bounded_f, .g = first_g};

/* x' = x^2: from 1 it is infinite at t = 1. */
static int explosive_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[0] * x[0];
    return 0;
}

static const struct apc_param one[] = {{"x", "", "", 1.0, -1e299, 1e299}};
static const struct apc_model explosive = {.abi = APC_MODEL_ABI,
                                           .name = "explosive",
                                           .nx = 1,
                                           .nu = 1,
                                           .ny = 1,
                                           .state = one,
                                           .f = explosive_f,
                                           .g = first_g};

/* x' = cos(t): sees the plant's own time. */
static int clocked_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)x, (void)u, (void)p;
    dx[0] = cos(t);
    return 0;
}

static const struct apc_model clocked = {
    .abi = APC_MODEL_ABI, .name = "clocked", .nx = 1, .nu = 1, .ny = 1, .f = clocked_f, .g = first_g};

/* x' jumps: where x passes a bound, as a valve that shuts; at a bound that it never leaves; with time. */
static int shutting_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[0] > 0.25 ? 0.0 : 0.1;
    return 0;
}

static int relay_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[0] > 0.25 ? -1.0 : 1.0;
    return 0;
}

static int saw_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)x, (void)u, (void)p;
    dx[0] = fmod(t, 1.0);
    return 0;
}

/* ---- What must hold ------------------------------------------------------------------------- */

/* Promise(plants/plant-column-checked) */
static void the_first_order_plant_follows_its_exact_solution_over_3000_steps(void **state)
{
    const double a = exp(-0.2 / 10.0);
    struct apc_plant *plant = make(&apc_model_first_order, NULL, NULL);
    double x = 0.0, worst = 0.0, y = -1.0;

    (void)state;
    for (int k = 0; k < 3000; k++) {
        double u = sin(0.05 * k) + (k / 750 % 2 ? 1.0 : -0.5);

        assert_int_equal(apc_plant_advance(plant, 0.2, &u), 0);
        x = a * x + (1.0 - a) * 10.0 * u;
        apc_plant_output(plant, &u, &y);
        worst = fmax(worst, fabs(y - x));
    }
    print_message("largest error %g\n", worst);
    assert_true(worst < 1e-5);
    assert_near(apc_plant_time(plant), 600.0, 1e-9);
    assert_string_equal(apc_plant_error(plant), "");
    apc_plant_destroy(plant);
}

static void a_stiff_reactor_is_solved(void **state)
{
    struct apc_plant *plant = make(&robertson, NULL, NULL);
    const double u = 0.0;
    const double *x = apc_plant_state(plant);

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 0.4, &u), 0);
    assert_near(x[0], 9.8517e-1, 1e-5); /* published */
    assert_near(x[1], 3.3864e-5, 1e-8);
    assert_near(x[2], 1.4794e-2, 1e-5);
    for (int k = 0; k < 100; k++)
        assert_int_equal(apc_plant_advance(plant, 0.396, &u), 0);
    assert_near(x[0], 7.1583e-1, 1e-5); /* at 40 */
    assert_near(x[1], 9.1855e-6, 1e-8);
    assert_near(x[2], 2.8416e-1, 1e-5);
    apc_plant_destroy(plant);
}

/* What a tick costs rests on the Jacobian: that it is right, and kept for as long as it will do. */
static void a_stiff_reactor_is_solved_with_few_evaluations(void **state)
{
    struct apc_plant *plant = make(&robertson, NULL, NULL);
    const double u = 0.0;

    (void)state;
    evaluations = 0;
    for (int k = 0; k < 100; k++)
        assert_int_equal(apc_plant_advance(plant, 0.4, &u), 0);
    print_message("%ld evaluations\n", evaluations);
    assert_in_range(evaluations, 1000, 3500);
    apc_plant_destroy(plant);
}

/* x' = -1000 sqrt(x - 1), undefined below 1: a trial step that goes there is tried again, shorter. */
static int walled_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = -x[0];
    dx[1] = -1e3 * sqrt(x[1] - 1.0);
    return 0;
}

static void next_to_where_a_model_is_not_defined_steps_get_shorter(void **state)
{
    static const struct apc_model walled = {
        .abi = APC_MODEL_ABI, .name = "walled", .nx = 2, .nu = 1, .ny = 1, .f = walled_f, .g = first_g};
    const double x0[] = {1.0, 1.5}, u = 0.0;
    struct apc_plant *plant = make(&walled, NULL, x0);

    (void)state;
    for (int k = 0; k < 10; k++)
        assert_int_equal(apc_plant_advance(plant, 1e-4, &u), 0);
    assert_near(apc_plant_state(plant)[0], exp(-1e-3), 1e-6);
    assert_near(apc_plant_state(plant)[1], 1.0 + pow(sqrt(0.5) - 0.5, 2), 1e-6);
    apc_plant_destroy(plant);
}

static void the_model_sees_the_plants_own_time(void **state)
{
    static const char *const integrators[] = {"cvode", "adams", "rk4"};
    const double u = 0.0;

    (void)state;
    for (size_t n = 0; n < 3; n++) {
        const struct apc_plant_options o = {.size = sizeof(o), .integrator = integrators[n]};
        struct apc_plant *plant = NULL;

        assert_int_equal(apc_plant_create(&plant, &clocked, NULL, NULL, &o, NULL), 0);
        for (int k = 1; k <= 50; k++) {
            assert_int_equal(apc_plant_advance(plant, 0.37, &u), 0);
            assert_near(apc_plant_state(plant)[0], sin(0.37 * k), 1e-6);
        }
        apc_plant_destroy(plant);
    }
}

/* Reported of CasADi (it never ends) and of SUNDIALS (a jump is stepped over, or no step is taken). */
static void what_jumps_is_integrated_or_refused_and_never_wrong(void **state)
{
    static const char *const integrators[] = {"cvode", "adams"};
    static const struct {
        int (*f)(double, const double *, const double *, const double *, double *);
        double dt, end;
        int rc;
    } cases[] = {{shutting_f, 1.0, 0.25, 0},
                 {saw_f, 10.0, 20.0, 0},
                 {saw_f, 0.37, 0.6152, 0},
                 {relay_f, 1.0, 0.0, APC_ESOLVER}}; /* it would switch for ever */
    const double u = 0.0;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (size_t n = 0; n < 2; n++) {
            const struct apc_model m = {.abi = APC_MODEL_ABI,
                                        .name = "jumping",
                                        .nx = 1,
                                        .nu = 1,
                                        .ny = 1,
                                        .f = cases[i].f,
                                        .g = first_g};
            const struct apc_plant_options o = {.size = sizeof(o), .integrator = integrators[n]};
            struct apc_plant *plant = NULL;

            assert_int_equal(apc_plant_create(&plant, &m, NULL, NULL, &o, NULL), 0);
            for (int k = 0; k < 4; k++)
                assert_int_equal(apc_plant_advance(plant, cases[i].dt, &u), cases[i].rc);
            assert_near(apc_plant_state(plant)[0], cases[i].end, 1e-3);
            apc_plant_destroy(plant);
        }
}

/* Each state by its number where it has no name; of very many as many as there is room for. */
static int hopeless_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)u, (void)p, (void)dx;
    return 1;
}

static void a_failure_names_every_state_that_there_is_room_for(void **state)
{
    struct apc_model m = {
        .abi = APC_MODEL_ABI, .name = "many", .nx = 3, .nu = 2, .ny = 1, .f = hopeless_f, .g = first_g};
    const double x0[1000] = {1.5, -2.5, 3.5}, u[] = {0.0, (double)NAN};
    const struct apc_plant_options o = {.size = sizeof(o), .integrator = "rk4"};
    struct apc_plant *plant = NULL;

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &m, NULL, x0, &o, NULL), 0);
    assert_int_equal(apc_plant_advance(plant, 1.0, x0), APC_ESOLVER);
    assert_non_null(strstr(apc_plant_error(plant), "many at t = 0 s, x1 = 1.5, x2 = -2.5, x3 = 3.5: "));
    assert_int_equal(apc_plant_advance(plant, 1.0, u), APC_ESOLVER);
    assert_non_null(strstr(apc_plant_error(plant), "input 2 is not a finite number"));
    assert_int_equal(apc_plant_kick(plant, 3, 1.0), APC_EINVAL);
    assert_non_null(strstr(apc_plant_error(plant), "state 4 of 3 cannot be moved by 1"));
    assert_int_equal(apc_plant_disturb(plant, 0, 1.0), APC_EINVAL);
    assert_non_null(strstr(apc_plant_error(plant), "disturbance 1 of 0 cannot be 1"));
    apc_plant_destroy(plant);
    m.nx = 1000;
    assert_int_equal(apc_plant_create(&plant, &m, NULL, x0, &o, NULL), 0);
    assert_int_equal(apc_plant_advance(plant, 1.0, x0), APC_ESOLVER);
    assert_non_null(strstr(apc_plant_error(plant), "x3 = 3.5, x4 = 0, "));
    assert_null(strstr(apc_plant_error(plant), "x999"));
    apc_plant_destroy(plant);
}

static void a_failure_leaves_the_state_as_it_was_and_says_why(void **state)
{
    const struct {
        const struct apc_model *model;
        double x0, dt, u;
    } cases[] = {
        {&bounded, 0.5, 10.0, 1.0},        /* f gives up on the way */
        {&bounded, 0.5, 10.0, -1.0},       /* f gives NaN on the way */
        {&bounded, 2.0, 1.0, 0.0},         /* f gives up at once */
        {&bounded, -2.0, 1.0, 0.0},        /* NaN at once */
        {&explosive, 1.0, 2.0, 0.0},       /* goes to infinity */
        {&bounded, 0.5, 1.0, (double)NAN}, /* input */
        {&bounded, 0.5, (double)NAN, 0.1}, /* interval */
        {&bounded, 0.5, -1.0, 0.1},        {&bounded, 0.5, (double)INFINITY, 0.1},
    };

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        struct apc_plant *plant = make(cases[i].model, NULL, &cases[i].x0);

        assert_int_equal(apc_plant_advance(plant, cases[i].dt, &cases[i].u), APC_ESOLVER);
        assert_true(apc_plant_state(plant)[0] == cases[i].x0);
        assert_true(apc_plant_time(plant) == 0.0);
        assert_true(strlen(apc_plant_error(plant)) > 10);
        print_message("%s\n", apc_plant_error(plant));
        apc_plant_destroy(plant);
    }
}

static void after_a_failure_it_goes_on(void **state)
{
    struct apc_plant *plant = make(&bounded, NULL, NULL);
    const double up = 1.0, gently = 0.1;

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 10.0, &up), APC_ESOLVER);
    assert_int_equal(apc_plant_advance(plant, 1.0, &gently), 0);
    assert_near(apc_plant_state(plant)[0], 0.1, 1e-9);
    apc_plant_destroy(plant);
}

static void a_solver_in_trouble_prints_nothing(void **state)
{
    FILE *caught = tmpfile();
    int own = dup(STDERR_FILENO);
    double x0 = 0.5, u = 1.0;
    struct apc_plant *plant = make(&bounded, NULL, &x0);
    int rc;

    (void)state;
    assert_non_null(caught);
    dup2(fileno(caught), STDERR_FILENO);
    rc = apc_plant_advance(plant, 10.0, &u);
    fflush(stderr);
    dup2(own, STDERR_FILENO);
    close(own);
    assert_int_equal(rc, APC_ESOLVER);
    assert_int_equal(lseek(fileno(caught), 0, SEEK_END), 0);
    fclose(caught);
    apc_plant_destroy(plant);
}

static void no_time_changes_nothing(void **state)
{
    const double x0 = 3.0, u = 1.0;
    struct apc_plant *plant = make(&apc_model_first_order, NULL, &x0);

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 0.0, &u), 0);
    assert_true(apc_plant_state(plant)[0] == 3.0);
    assert_int_equal(apc_plant_advance(plant, 1e-9, &u), 0);
    assert_near(apc_plant_state(plant)[0], 3.0 + 0.7e-9, 1e-12);
    apc_plant_destroy(plant);
}

static void what_cannot_be_integrated_is_refused_at_creation(void **state)
{
    const double too_slow[] = {10.0, 0.0}, nan_state[] = {(double)NAN};
    const struct apc_plant_options bad = {.size = sizeof(bad), .rtol = -1.0};
    const struct apc_plant_options unsized = {.rtol = 1e-6};
    struct apc_model half = bounded;
    struct apc_plant *plant = (void *)&half;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, too_slow, NULL, NULL, &why),
                     APC_EINVAL);
    assert_null(plant);
    assert_non_null(strstr(why.text, "tau"));
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, nan_state, NULL, &why),
                     APC_EINVAL);
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &bad, &why), APC_EINVAL);
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &unsized, &why),
                     APC_EINVAL);
    half.g = NULL;
    assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "f and g"));
    half = bounded;
    half.f = NULL;
    assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
    for (int what = 0; what < 3; what++) { /* without a state, an input, an output */
        half = bounded;
        *(what == 0 ? &half.nx : what == 1 ? &half.nu : &half.ny) = 0;
        assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "each must be at least 1"));
    }
    for (int what = 0; what < 2; what++) {
        half = bounded;
        half.name = what ? "" : NULL;
        assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "no name"));
    }
    half = bounded;
    half.abi++;
    assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "compile it again"));
    for (int what = 0; what < 5; what++) { /* a table with a variable that has no name, each of them */
        static const struct apc_param nameless[] = {{"x", "", "", 0.0, 0.0, 1.0},
                                                    {NULL, "", "", 0.0, 0.0, 1.0}};

        half = bounded;
        half.np = half.nx = half.nu = half.nd = half.ny = 2;
        *(what == 0   ? &half.param
          : what == 1 ? &half.state
          : what == 2 ? &half.input
          : what == 3 ? &half.disturbance
                      : &half.output) = nameless;
        if (what > 0)
            half.np = 0;
        assert_int_equal(apc_plant_create(&plant, &half, NULL, NULL, NULL, &why), APC_EINVAL);
        assert_null(plant);
    }
    assert_int_equal(apc_plant_create(NULL, &bounded, NULL, NULL, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_plant_create(&plant, NULL, NULL, NULL, NULL, &why), APC_EINVAL);
    apc_plant_destroy(NULL);
}

static void an_unknown_model_is_answered_with_the_names_there_are(void **state)
{
    const struct apc_model *model;
    void *handle;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_model_find("first-order", &model, &handle, &why), 0);
    assert_ptr_equal(model, &apc_model_first_order);
    assert_int_equal(apc_model_find("tank", &model, &handle, &why), APC_ENOTFOUND);
    assert_null(model);
    assert_non_null(strstr(why.text, "first-order"));
    assert_int_equal(apc_model_find("./no-such-plant.so", &model, &handle, &why), APC_ENOTFOUND);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_first_order_plant_follows_its_exact_solution_over_3000_steps),
        cmocka_unit_test(a_stiff_reactor_is_solved),
        cmocka_unit_test(a_stiff_reactor_is_solved_with_few_evaluations),
        cmocka_unit_test(next_to_where_a_model_is_not_defined_steps_get_shorter),
        cmocka_unit_test(the_model_sees_the_plants_own_time),
        cmocka_unit_test(what_jumps_is_integrated_or_refused_and_never_wrong),
        cmocka_unit_test(a_failure_names_every_state_that_there_is_room_for),
        cmocka_unit_test(a_failure_leaves_the_state_as_it_was_and_says_why),
        cmocka_unit_test(after_a_failure_it_goes_on),
        cmocka_unit_test(a_solver_in_trouble_prints_nothing),
        cmocka_unit_test(no_time_changes_nothing),
        cmocka_unit_test(what_cannot_be_integrated_is_refused_at_creation),
        cmocka_unit_test(an_unknown_model_is_answered_with_the_names_there_are),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
