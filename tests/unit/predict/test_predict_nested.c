/* SPDX-License-Identifier: BSD-3-Clause */
/* Loops around a model: its linear model is that of its equations, and what its inputs cannot do they do not. */
/*
 * Promise(laws/nmpc-moves-setpoints): `nmpc` moves setpoints of loops below, with these in its prediction,
 *   at an end of an input's range as well.
 */
#include "check.h"
#include "plant/plant_internal.h"
#include "predict/nested.h"

#include <string.h>

enum { NX = 4, NU = 2, NY = 2, WIDE = 5, ALL_MOST = 8 };

static const struct apc_nested_loop second[] = {{.there = false},
                                                {.there = true, .y = 0, .gain = 2.7, .tau = 40.0}};

static struct apc_nested *make(const struct apc_nested_loop *loop)
{
    struct apc_nested *n;
    struct apc_error why;

    if (apc_nested_create(&n, &apc_model_quadruple_tank, NULL, loop, &why) < 0)
        fail_msg("%s", why.text);
    return n;
}

/* At 3 V on both pumps: x with I, u with the setpoint. */
static void at_rest(double *x, double *u, double *y)
{
    const struct apc_model *m = &apc_model_quadruple_tank;
    double v[ALL_MOST] = {3.0, 3.0};
    struct apc_error why;

    memcpy(x, (const double[]){12.263, 12.783, 1.634, 1.409}, NX * sizeof *x);
    apc_param_initials(m->disturbance, m->nd, v + NU);
    assert_int_equal(apc_model_equilibrium(m, NULL, v, x, &why), 0);
    assert_int_equal(apc_model_evaluate(m, NULL, x, v, NULL, y, &why), 0);
    memcpy(u, v, (NU + m->nd) * sizeof *u);
    x[NX] = 3.0;
    u[1] = y[0];
}

static void its_linear_model_is_that_of_its_equations(void **state)
{
    const struct apc_model *m = &apc_model_quadruple_tank;
    const size_t all = NU + m->nd;
    double x[WIDE], u[ALL_MOST], y[NY], v[ALL_MOST], A[NX * NX], B[NX * ALL_MOST], C[NY * NX],
        D[NY * ALL_MOST];
    double wide_A[WIDE * WIDE], wide_B[WIDE * ALL_MOST], wide_C[NY * WIDE], x0[WIDE], u0[ALL_MOST];
    struct apc_nested *n = make(second);
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_nested_states(n), WIDE);
    at_rest(x, u, y);
    memcpy(v, u, sizeof v);
    v[1] = 3.0;
    assert_int_equal(apc_model_linearize(m, NULL, x, v, A, B, C, D, &why), 0);
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = NX,
                                               .nu = NU,
                                               .nd = m->nd,
                                               .ny = NY,
                                               .A = A,
                                               .B = B,
                                               .C = C,
                                               .D = D,
                                               .x0 = x,
                                               .u0 = v,
                                               .y0 = y};
    assert_int_equal(apc_nested_linearise(n, &from, wide_A, wide_B, wide_C, x0, u0, &why), 0);
    for (size_t i = 0; i < WIDE; i++)
        assert_near(x0[i], x[i], 1e-12);
    for (size_t k = 0; k < all; k++)
        assert_near(u0[k], u[k], 1e-12);
    for (size_t k = 0; k < WIDE + all; k++) {
        double *at = k < WIDE ? x + k : u + (k - WIDE), up[WIDE], down[WIDE], y_up[NY], y_down[NY];
        const double here = *at, by = 1e-5;

        *at = here + by;
        assert_int_equal(apc_nested_slope(n, x, u, up), 0);
        apc_nested_output(n, x, u, y_up);
        *at = here - by;
        assert_int_equal(apc_nested_slope(n, x, u, down), 0);
        apc_nested_output(n, x, u, y_down);
        *at = here;
        for (size_t i = 0; i < WIDE; i++)
            assert_near(k < WIDE ? wide_A[i * WIDE + k] : wide_B[i * all + k - WIDE],
                        (up[i] - down[i]) / (2.0 * by), 1e-6);
        for (size_t c = 0; c < NY; c++)
            assert_near(k < WIDE ? wide_C[c * WIDE + k] : D[c * all + k - WIDE],
                        (y_up[c] - y_down[c]) / (2.0 * by), 1e-6);
    }
    D[1] = 1.0; /* the second input acts on a measurement at once */
    assert_int_equal(apc_nested_linearise(n, &from, wide_A, wide_B, wide_C, x0, u0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "output 2 acts on measurement 1 at once"));
    apc_nested_destroy(n);
    apc_nested_destroy(NULL);
}

static void beyond_the_range_of_an_input_its_integral_waits(void **state)
{
    const struct apc_model *m = &apc_model_quadruple_tank;
    double x[WIDE], u[ALL_MOST], y[NY], v[ALL_MOST], slope[WIDE], alone[NX];
    struct apc_nested *n = make(second);
    struct apc_error why;
    (void)state;

    at_rest(x, u, y);
    memcpy(v, u, sizeof v);
    for (double error = -10.0; error <= 10.0; error += 20.0) {
        u[1] = y[0] + error;
        v[1] = error > 0.0 ? m->input[1].high : m->input[1].low;
        assert_int_equal(apc_nested_slope(n, x, u, slope), 0);
        assert_int_equal(apc_model_evaluate(m, NULL, x, v, alone, NULL, &why), 0);
        for (size_t i = 0; i < NX; i++)
            assert_near(slope[i], alone[i], 1e-12);
        assert_near(slope[NX], 0.0, 0.0);
    }
    u[1] = y[0] + 0.5;
    assert_int_equal(apc_nested_slope(n, x, u, slope), 0);
    assert_near(slope[NX], 2.7 * 0.5 / 40.0, 1e-12);
    apc_nested_destroy(n);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(its_linear_model_is_that_of_its_equations),
        cmocka_unit_test(beyond_the_range_of_an_input_its_integral_waits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
