/* SPDX-License-Identifier: BSD-3-Clause */
/* Plants with algebraic equations: x' = f(t, x, z, u, p), 0 = residual(t, x, z, u, p). */
#include "check.h"

#include "apcplant.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DAE(name_, nx_, nz_, f_, residual_, g_)                                                              \
    .abi = APC_MODEL_ABI, .name = (name_), .nx = (nx_), .nz = (nz_), .nu = 1, .ny = 1, .f = (f_),            \
    .residual = (residual_), .g = (g_)

static struct apc_plant *make_algebraic(const struct apc_model *model, double rtol, double atol)
{
    const struct apc_plant_options o = {.size = sizeof(o), .rtol = rtol, .atol = atol};
    struct apc_plant *plant = NULL;
    struct apc_error why = {""};

    if (apc_plant_create(&plant, model, NULL, NULL, &o, &why) < 0)
        fail_msg("%s", why.text);
    return plant;
}

/* ---- Models ----------------------------------------------------------------------------------- */

/* Robertson's kinetics, with the conservation of mass for the third species. */
static int robertson_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
    dx[1] = -dx[0] - 3e7 * x[1] * x[1];
    return 0;
}

static int mass_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[0] + x[1] + x[2] - 1.0;
    return 0;
}

static void third_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[2];
}

static const struct apc_param robertson_state[] = {{"a", "", "", 1.0, 0.0, 2.0},
                                                   {"b", "", "", 0.0, -1.0, 2.0}};
static const struct apc_model robertson = {DAE("robertson", 2, 1, robertson_f, mass_residual, third_g),
                                           .state = robertson_state};

/* A pendulum of 1 m in Cartesian coordinates: x, y, their speeds, and the rod's tension a kg and m. Its
 * constraint x^2 + y^2 = 1 is differentiated twice here, not at all in the one of index 3. */
static int rod_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = x[2];
    dx[1] = x[3];
    dx[2] = -x[4] * x[0];
    dx[3] = -x[4] * x[1] - 9.81;
    return 0;
}

static int rod_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[2] * x[2] + x[3] * x[3] - x[4] * (x[0] * x[0] + x[1] * x[1]) - 9.81 * x[1];
    return 0;
}

static int position_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[0] * x[0] + x[1] * x[1] - 1.0;
    return 0;
}

static void first_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
}

static const struct apc_param rod_state[] = {{"x", "m", "", 1.0, -2.0, 2.0},
                                             {"y", "m", "", 0.0, -2.0, 2.0},
                                             {"vx", "m/s", "", 0.0, -99.0, 99.0},
                                             {"vy", "m/s", "", 0.0, -99.0, 99.0}};

/* x' = -x + z1, 0 = z1 - 2 z2 + u, 0 = z2 + z1^3 - x, y = z2. */
static int mixed_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = -x[0] + x[1];
    return 0;
}

static int mixed_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)p;
    r[0] = x[1] - 2.0 * x[2] + u[0];
    r[1] = x[2] + x[1] * x[1] * x[1] - x[0];
    return 0;
}

static const struct apc_model mixed = {DAE("mixed", 1, 2, mixed_f, mixed_residual, third_g)};

/* x' = u, 0 = z^2 - (1 - x): no z beyond x = 1. */
static int rising_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)p;
    dx[0] = u[0];
    return 0;
}

static int root_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[1] * x[1] - (1.0 - x[0]);
    return 0;
}

static void second_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[1];
}

static const struct apc_param positive[] = {{"root", "", "", 0.5, 0.0, 10.0}};
static const struct apc_model rising = {DAE("rising", 1, 1, rising_f, root_residual, second_g),
                                        .algebraic = positive};

/* The second equation is NaN where x is above 0.5. */
static int lost_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[1] - x[0];
    r[1] = x[0] > 0.5 ? (double)NAN : x[2] - x[1];
    return 0;
}

/* 0 = z1 + z2 - x, and the same twice over. */
static int twice_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[1] + x[2] - x[0];
    r[1] = 2.0 * r[0];
    return 0;
}

/* No real solution. */
static int never_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)u, (void)p;
    r[0] = x[1] * x[1] + 3.0;
    return 0;
}

static int undefined_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)x, (void)u, (void)p;
    r[0] = 0.0;
    return 1;
}

/* ---- What must hold ------------------------------------------------------------------------- */

/* Reference values of the Test Set for IVP Solvers, release 2.4. */
static void robertsons_kinetics_reach_their_published_end_within_1e_8(void **state)
{
    struct apc_plant *plant = make_algebraic(&robertson, 1e-10, 1e-15);
    const double end[] = {0.2083340149701255e-07, 0.8333360770334713e-13, 0.9999999791665050}, u = 0.0;
    double y = 0.0;

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 1e11, &u), 0);
    apc_plant_output(plant, &u, &y);
    for (size_t i = 0; i < 3; i++)
        assert_near(apc_plant_state(plant)[i] / end[i], 1.0, 1e-8);
    assert_near(y, end[2], 1e-12);
    apc_plant_destroy(plant);
}

static void a_pendulum_on_a_rod_swings_as_its_angle_does(void **state)
{
    const struct apc_model pendulum = {DAE("rod", 4, 1, rod_f, rod_residual, first_g), .state = rod_state};
    struct apc_plant *plant = make_algebraic(&pendulum, 1e-11, 1e-12);
    double angle = acos(0.0), speed = 0.0, u = 0.0;
    const double h = 1e-4;

    (void)state;
    for (int k = 0; k < 20000; k++) { /* its angle from straight down, by Runge-Kutta */
        double a[4], s[4], at = angle, v = speed;
        static const double part[4] = {0.5, 0.5, 1.0, 0.0};

        for (size_t i = 0; i < 4; i++) {
            a[i] = v;
            s[i] = -9.81 * sin(at);
            at = angle + part[i] * h * a[i];
            v = speed + part[i] * h * s[i];
        }
        angle += h / 6.0 * (a[0] + 2.0 * (a[1] + a[2]) + a[3]);
        speed += h / 6.0 * (s[0] + 2.0 * (s[1] + s[2]) + s[3]);
    }
    for (int k = 0; k < 10; k++)
        assert_int_equal(apc_plant_advance(plant, 0.2, &u), 0);
    assert_near(apc_plant_state(plant)[0], sin(angle), 1e-8);
    assert_near(apc_plant_state(plant)[1], -cos(angle), 1e-8);
    assert_near(apc_plant_state(plant)[4], speed * speed + 9.81 * cos(angle), 1e-7);
    apc_plant_destroy(plant);
}

/* Promise(plants/algebraic-jump): What is algebraic follows a change of an input at once, in outputs as well. */
static void what_is_algebraic_follows_the_input_at_once(void **state)
{
    struct apc_plant *plant = make_algebraic(&mixed, 0.0, 0.0);
    double u = 0.0, y = -1.0;

    (void)state;
    apc_plant_output(plant, &u, &y);
    assert_near(y, 0.0, 1e-12);
    for (int k = 0; k < 50; k++) {
        const double *x = apc_plant_state(plant);

        u = 2.0 * sin(k);
        apc_plant_output(plant, &u, &y);
        assert_near(x[1] - 2.0 * y + u, 0.0, 1e-12);
        assert_near(y + x[1] * x[1] * x[1] - x[0], 0.0, 1e-12);
        assert_int_equal(apc_plant_advance(plant, 0.1, &u), 0);
        assert_int_equal(apc_plant_kick(plant, 0, 0.05), 0);
    }
    apc_plant_destroy(plant);
}

static void refused_with(const struct apc_model *model, int rc, const char *a, const char *b)
{
    struct apc_plant *plant;
    struct apc_error why;

    assert_int_equal(apc_plant_create(&plant, model, NULL, NULL, NULL, &why), rc);
    assert_null(plant);
    assert_has(why.text, a);
    assert_has(why.text, b);
}

/* Promise(plants/algebraic-refused): A start without a solution and an index above 1 are refused with the equation. */
static void a_start_without_a_solution_and_an_index_above_1_are_told_with_the_equation(void **state)
{
    const struct apc_model index_3 = {DAE("rod", 4, 1, rod_f, position_residual, first_g),
                                      .state = rod_state},
                           twice = {DAE("twice", 1, 2, mixed_f, twice_residual, first_g)},
                           never = {DAE("never", 1, 1, mixed_f, never_residual, first_g),
                                    .algebraic = positive},
                           undefined = {DAE("undefined", 1, 1, mixed_f, undefined_residual, first_g)},
                           none = {DAE("none", 1, 1, mixed_f, NULL, first_g)};
    static const struct apc_param beyond[] = {{"x", "", "", 0.6, -1.0, 1.0}};
    const struct apc_model lost = {DAE("lost", 1, 2, mixed_f, lost_residual, first_g), .state = beyond};

    (void)state;
    refused_with(&index_3, APC_ESOLVER, "rod cannot start: ", "equation 1 of 1");
    refused_with(&index_3, APC_ESOLVER, "index is above 1", "differentiate");
    refused_with(&twice, APC_ESOLVER, "index is above 1", "of 2");
    refused_with(&never, APC_ESOLVER, "equation 1 is off by ", "initial values");
    refused_with(&lost, APC_ESOLVER, "equation 2 is nan", "z1 = ");
    refused_with(&undefined, APC_ESOLVER, "undefined", "not defined");
    refused_with(&none, APC_EINVAL, "1 algebraic variables", "residual");
}

static void a_solution_that_ends_is_told_and_the_plant_goes_on_from_before(void **state)
{
    struct apc_plant *plant = make_algebraic(&rising, 0.0, 0.0);
    const double up = 1.0, down = -1.0;
    double before[2], y;

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 0.75, &up), 0);
    memcpy(before, apc_plant_state(plant), sizeof(before));
    assert_near(before[1], 0.5, 1e-7);
    assert_int_equal(apc_plant_advance(plant, 1.0, &up), APC_ESOLVER);
    assert_has(apc_plant_error(plant), "rising at t = 0.75 s, x1 = 0.75");
    assert_memory_equal(before, apc_plant_state(plant), sizeof(before));
    assert_int_equal(apc_plant_advance(plant, 0.5, &down), 0);
    assert_near(apc_plant_state(plant)[1], sqrt(0.75), 1e-7);
    assert_int_equal(apc_plant_kick(plant, 0, 2.0), 0);
    apc_plant_output(plant, &down, &y);
    assert_true(isnan(y));
    assert_has(apc_plant_error(plant), "equation 1 is off by");
    assert_int_equal(apc_plant_advance(plant, 0.5, &down), APC_ESOLVER);
    apc_plant_destroy(plant);
}

static void an_equation_that_is_no_number_is_named_by_its_place(void **state)
{
    const struct apc_model lost = {DAE("lost", 1, 2, rising_f, lost_residual, first_g)};
    struct apc_plant *plant = make_algebraic(&lost, 0.0, 0.0);
    const double u = 1.0;

    (void)state;
    assert_int_equal(apc_plant_advance(plant, 0.25, &u), 0);
    assert_int_equal(apc_plant_advance(plant, 1.0, &u), APC_ESOLVER);
    assert_has(apc_plant_error(plant), "lost at t = 0.25 s");
    assert_has(apc_plant_error(plant), "algebraic equation 2");
    apc_plant_destroy(plant);
}

static void two_plants_of_a_seed_are_the_same_bits(void **state)
{
    struct apc_plant *plant[2] = {make_algebraic(&mixed, 0.0, 0.0), make_algebraic(&mixed, 0.0, 0.0)};

    (void)state;
    for (int k = 0; k < 20; k++) {
        const double u = sin(k);

        for (size_t i = 0; i < 2; i++)
            assert_int_equal(apc_plant_advance(plant[i], 0.5, &u), 0);
        assert_memory_equal(apc_plant_state(plant[0]), apc_plant_state(plant[1]), 3 * sizeof(double));
    }
    apc_plant_destroy(plant[0]);
    apc_plant_destroy(plant[1]);
}

/* Promise(plants/algebraic-integrator): Algebraic equations have the integrator ida, and nothing else has it. */
static void algebraic_equations_have_ida_and_nothing_else_has(void **state)
{
    static const char *const others[] = {"cvode", "adams", "rk4", "exact"};
    struct apc_plant_options o = {.size = sizeof(o)};
    struct apc_plant *plant;
    struct apc_error why;

    (void)state;
    for (size_t i = 0; i < sizeof(others) / sizeof(*others); i++) {
        o.integrator = others[i];
        assert_int_equal(apc_plant_create(&plant, &mixed, NULL, NULL, &o, &why), APC_EINVAL);
        assert_has(why.text, "\"ida\"");
    }
    o.integrator = "ida";
    assert_int_equal(apc_plant_create(&plant, &apc_model_first_order, NULL, NULL, &o, &why), APC_EINVAL);
    assert_has(why.text, "no algebraic equations");
    assert_int_equal(apc_plant_create(&plant, &mixed, NULL, NULL, &o, &why), 0);
    apc_plant_destroy(plant);
}

/* Its struct ends before the algebraic variables. */
static void a_model_of_the_abi_before_still_works(void **state)
{
    const size_t size = offsetof(struct apc_model, nz);
    struct apc_model *former = malloc(size);
    const struct apc_model now = {
        .abi = 2, .name = "former", .nx = 1, .nu = 1, .ny = 1, .f = rising_f, .g = first_g};
    struct apc_plant *plant;
    const double u = 2.0;
    double y = 0.0, a = -1.0, b = 0.0;

    (void)state;
    assert_non_null(former);
    memcpy(former, &now, size);
    assert_int_equal(apc_plant_create(&plant, former, NULL, NULL, NULL, NULL), 0);
    assert_int_equal(apc_plant_advance(plant, 0.5, &u), 0);
    apc_plant_output(plant, &u, &y);
    assert_near(y, 1.0, 1e-7);
    assert_int_equal(apc_model_linearize(former, NULL, NULL, NULL, &a, &b, NULL, NULL, NULL), 0);
    assert_near(a, 0.0, 1e-9);
    assert_near(b, 1.0, 1e-9);
    former->abi = 1;
    assert_int_equal(apc_model_linearize(former, NULL, NULL, NULL, &a, &b, NULL, NULL, NULL), APC_EINVAL);
    apc_plant_destroy(plant);
    free(former);
}

/* ---- The linear model ----------------------------------------------------------------------- */

/* Promise(plants/algebraic-linear): The linear model of a plant with algebraic equations is that of its states. */
static void the_linear_model_is_that_of_the_states_alone(void **state)
{
    const double x = 1.5, u = 0.5;
    double a = 0.0, b = 0.0, c = 0.0, d = 0.0, dx = 0.0, y = 0.0, z1 = 0.0, slope;

    (void)state;
    for (int k = 0; k < 50; k++) /* (z1 + u) / 2 + z1^3 = x */
        z1 -= ((z1 + u) / 2.0 + z1 * z1 * z1 - x) / (0.5 + 3.0 * z1 * z1);
    slope = 1.0 / (0.5 + 3.0 * z1 * z1); /* dz1/dx, and dz1/du is -half of it */
    assert_int_equal(apc_model_linearize(&mixed, NULL, &x, &u, &a, &b, &c, &d, NULL), 0);
    assert_near(a, -1.0 + slope, 1e-9);
    assert_near(b, -0.5 * slope, 1e-9);
    assert_near(c, 0.5 * slope, 1e-9);
    assert_near(d, 0.5 - 0.25 * slope, 1e-9);
    assert_int_equal(apc_model_linearize(&mixed, NULL, &x, &u, &a, NULL, NULL, NULL, NULL), 0);
    assert_near(a, -1.0 + slope, 1e-9);
    assert_int_equal(apc_model_evaluate(&mixed, NULL, &x, &u, &dx, &y, NULL), 0);
    assert_near(dx, z1 - x, 1e-12);
    assert_near(y, (z1 + u) / 2.0, 1e-12);
}

static void a_steady_state_is_one_of_both_kinds_of_equations(void **state)
{
    static const struct apc_param start[] = {{"x", "", "", 0.3, -9.0, 9.0}};
    static const struct apc_param guess[] = {{"low", "", "", -1.0, -9.0, 9.0}};
    const struct apc_model two = {DAE("two", 1, 1, mixed_f, root_residual, second_g), .algebraic = guess};
    struct apc_model still = mixed;
    const double u = 1.0, root = (sqrt(5.0) - 1.0) / 2.0;
    double x = 0.9, dx;
    struct apc_error why;

    (void)state;
    still.state = start;
    assert_int_equal(apc_model_equilibrium(&still, NULL, &u, &x, NULL), 0);
    assert_near((x + u) / 2.0 + x * x * x - x, 0.0, 1e-10); /* z1 is x there */
    assert_int_equal(apc_model_evaluate(&still, NULL, &x, &u, &dx, NULL, NULL), 0);
    assert_near(dx, 0.0, 1e-10);
    x = -1.6; /* z = x, x^2 = 1 - x: with the initial value only the negative root is found again */
    assert_int_equal(apc_model_equilibrium(&two, NULL, &u, &x, NULL), 0);
    assert_near(x, -1.0 - root, 1e-9);
    x = 0.6;
    if (apc_model_equilibrium(&two, NULL, &u, &x, &why) == 0)
        assert_near(x, -1.0 - root, 1e-9); /* else it says that there are several */
    else
        assert_has(why.text, "several solutions");
    x = 2.0;
    assert_int_equal(apc_model_linearize(&two, NULL, &x, &u, &dx, NULL, NULL, NULL, &why), APC_ESOLVER);
    assert_has(why.text, "equation 1");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(robertsons_kinetics_reach_their_published_end_within_1e_8),
        cmocka_unit_test(a_pendulum_on_a_rod_swings_as_its_angle_does),
        cmocka_unit_test(what_is_algebraic_follows_the_input_at_once),
        cmocka_unit_test(a_start_without_a_solution_and_an_index_above_1_are_told_with_the_equation),
        cmocka_unit_test(a_solution_that_ends_is_told_and_the_plant_goes_on_from_before),
        cmocka_unit_test(an_equation_that_is_no_number_is_named_by_its_place),
        cmocka_unit_test(two_plants_of_a_seed_are_the_same_bits),
        cmocka_unit_test(algebraic_equations_have_ida_and_nothing_else_has),
        cmocka_unit_test(a_model_of_the_abi_before_still_works),
        cmocka_unit_test(the_linear_model_is_that_of_the_states_alone),
        cmocka_unit_test(a_steady_state_is_one_of_both_kinds_of_equations),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
