/* SPDX-License-Identifier: BSD-3-Clause */
/* Poles, zeros and gains of linear systems, and of the plants, against what is known of them. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "apc/identify/linear.h"
#include "apcplant.h"

#define MAX 8

static int by_real_part(const void *a, const void *b)
{
    double x = creal(*(const double complex *)a), y = creal(*(const double complex *)b);

    return (x > y) - (x < y);
}

/* Zeros, sorted. */
static int zeros(size_t nx, size_t nu, size_t ny, double *a, double *b, double *c, double *d,
                 double complex *zero)
{
    const struct linear sys = {nx, nu, ny, a, b, c, d};
    int n = linear_zeros(&sys, zero);

    if (n > 0)
        qsort(zero, (size_t)n, sizeof *zero, by_real_part);
    return n;
}

static void assert_root(double complex root, double re, double im, double tolerance)
{
    assert_near(creal(root), re, tolerance);
    assert_near(fabs(cimag(root)), im, tolerance);
}

/* ---- Systems with known zeros --------------------------------------------------------------- */

/* (s + 3)(s - 2) / (s^4 + 10 s^3 + 35 s^2 + 50 s + 24), controller form: two zeros at infinity. */
static void the_zeros_of_a_transfer_function_are_its_numerators(void **state)
{
    double a[16] = {0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -24, -50, -35, -10};
    double b[4] = {0, 0, 0, 1}, c[4] = {-6, 1, 1, 0}, d[1] = {0};
    double complex root[MAX];
    const struct linear sys = {4, 1, 1, a, b, c, d};
    double gain;

    (void)state;
    assert_int_equal(zeros(4, 1, 1, a, b, c, d, root), 2);
    assert_root(root[0], -3, 0, 1e-9);
    assert_root(root[1], 2, 0, 1e-9);
    assert_int_equal(linear_poles(&sys, root), 0);
    qsort(root, 4, sizeof *root, by_real_part);
    for (int i = 0; i < 4; i++)
        assert_root(root[i], i - 4, 0, 1e-9);
    assert_int_equal(linear_gain(&sys, &gain), 0);
    assert_near(gain, -6.0 / 24.0, 1e-12);
}

static void scales_do_not_matter(void **state)
{
    double a[16] = {0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -24, -50, -35, -10};
    double b[4] = {0, 0, 0, 1e-7}, c[4] = {-6e5, 1e5, 1e5, 0}, d[1] = {0};
    double complex root[MAX];

    (void)state;
    for (size_t i = 0; i < 16; i++)
        a[i] *= 1e3;
    assert_int_equal(zeros(4, 1, 1, a, b, c, d, root), 2);
    assert_root(root[0], -3e3, 0, 1e-5);
    assert_root(root[1], 2e3, 0, 1e-5);
}

static void complex_zeros_and_those_of_a_feedthrough_are_found(void **state)
{
    /* 1 + (s - 1) / (s^2 + 1) = (s^2 + s) / (s^2 + 1); and (s^2 + 2 s + 5) / (s + 1)^3 */
    double a[4] = {0, 1, -1, 0}, b[2] = {0, 1}, c[2] = {-1, 1}, d[1] = {1};
    double a3[9] = {0, 1, 0, 0, 0, 1, -1, -3, -3}, b3[3] = {0, 0, 1}, c3[3] = {5, 2, 1}, d3[1] = {0};
    double complex root[MAX];

    (void)state;
    assert_int_equal(zeros(2, 1, 1, a, b, c, d, root), 2);
    assert_root(root[0], -1, 0, 1e-9);
    assert_root(root[1], 0, 0, 1e-9);
    assert_int_equal(zeros(3, 1, 1, a3, b3, c3, d3, root), 2);
    assert_root(root[0], -1, 2, 1e-9);
    assert_root(root[1], -1, 2, 1e-9);
}

/* A mode that no output sees is a zero, wherever inputs and outputs are. */
static void systems_that_are_not_square_have_zeros_too(void **state)
{
    double a[9] = {-1, 0, 0, 0, -2, 0, 0, 0, -3};
    double b[3] = {1, 1, 1}, c[6] = {1, 0, 0, 0, 1, 0}, d[2] = {0, 0};
    double wide[6] = {1, 0, 0, 1, 0, 0}, row[3] = {1, 1, 1};
    double complex root[MAX];

    (void)state;
    assert_int_equal(zeros(3, 1, 2, a, b, c, d, root), 1);
    assert_root(root[0], -3, 0, 1e-9);
    assert_int_equal(zeros(3, 2, 1, a, wide, row, d, root), 1);
    assert_root(root[0], -3, 0, 1e-9);
}

static void inputs_that_do_the_same_are_degenerate(void **state)
{
    double a[4] = {-1, 0, 0, -2}, b[4] = {1, 2, 1, 2}, c[4] = {1, 0, 0, 1}, d[4] = {0}, rga[4];
    double complex root[MAX];

    (void)state;
    assert_int_equal(zeros(2, 2, 2, a, b, c, d, root), APC_ESTATE);
    assert_int_equal(linear_rga(b, 2, rga), APC_ESTATE);
}

/* ---- Plants -------------------------------------------------------------------------------- */

struct plant {
    const struct apc_model *model;
    struct linear sys; /* of the manipulated inputs */
    double x[MAX], a[MAX * MAX], b[MAX * MAX], c[MAX * MAX], d[MAX * MAX], all[MAX * MAX];
};

static void linearise(struct plant *p, const char *name)
{
    void *handle;

    assert_int_equal(apc_model_find(name, &p->model, &handle, NULL), 0);
    for (size_t i = 0; i < p->model->nx; i++)
        p->x[i] = p->model->state[i].initial;
    assert_int_equal(apc_model_equilibrium(p->model, NULL, NULL, p->x, NULL), 0);
    assert_int_equal(apc_model_linearize(p->model, NULL, p->x, NULL, p->a, p->all, p->c, p->d, NULL), 0);
    for (size_t i = 0; i < p->model->nx; i++)
        for (size_t j = 0; j < p->model->nu; j++)
            p->b[i * p->model->nu + j] = p->all[i * (p->model->nu + p->model->nd) + j];
    p->sys = (struct linear){p->model->nx, p->model->nu, p->model->ny, p->a, p->b, p->c, p->d};
}

/* Promise(plants/plant-column-checked) */
static void the_pendulum_has_its_poles(void **state)
{
    struct plant p;
    double complex root[MAX];
    double gain[MAX];

    (void)state;
    linearise(&p, "pendulum");
    assert_int_equal(linear_poles(&p.sys, root), 0);
    qsort(root, 4, sizeof *root, by_real_part);
    assert_root(root[0], -5.6041, 0, 5e-5);
    assert_root(root[1], -0.14283, 0, 5e-6);
    assert_root(root[2], 0, 0, 1e-9);
    assert_root(root[3], 5.5651, 0, 5e-5);
    assert_int_equal(linear_zeros(&p.sys, root), 0);
    assert_int_equal(linear_gain(&p.sys, gain), APC_ESTATE);
}

/* Johansson (2000): det G(s) = 0 at the roots of (1 + s T3)(1 + s T4) = eta, eta = (1 - g1)(1 - g2) / (g1
 * g2). */
static void assert_quadruple_tank(const char *name, double g1, double g2, double published0,
                                  double published1)
{
    const double outlet[4] = {0.071, 0.057, 0.071, 0.057}, area[4] = {28, 32, 28, 32};
    double T3, T4, eta = (1 - g1) * (1 - g2) / (g1 * g2), sum, root0, root1, gain[4], rga[4];
    double complex root[MAX];
    struct plant p;

    linearise(&p, name);
    T3 = area[2] / outlet[2] * sqrt(2 * p.x[2] / 981);
    T4 = area[3] / outlet[3] * sqrt(2 * p.x[3] / 981);
    sum = (T3 + T4) / (2 * T3 * T4);
    root0 = -sum - sqrt(sum * sum - (1 - eta) / (T3 * T4));
    root1 = -sum + sqrt(sum * sum - (1 - eta) / (T3 * T4));
    assert_int_equal(linear_zeros(&p.sys, root), 2);
    qsort(root, 2, sizeof *root, by_real_part);
    assert_root(root[0], root0, 0, 1e-9);
    assert_root(root[1], root1, 0, 1e-9);
    assert_near(root0, published0, 2e-3);
    assert_near(root1, published1, 2e-3);
    assert_int_equal(linear_gain(&p.sys, gain), 0);
    assert_int_equal(linear_rga(gain, 2, rga), 0);
    assert_near(rga[0], g1 * g2 / (g1 + g2 - 1), 1e-9);
    assert_near(rga[0] + rga[1], 1, 1e-9);
    assert_near(rga[1], rga[2], 1e-9);
}

/* Promise(plants/plant-column-checked) */
static void the_quadruple_tanks_zeros_lie_where_its_valves_put_them(void **state)
{
    (void)state;
    assert_quadruple_tank("quadruple-tank", 0.70, 0.60, -0.060, -0.018);
    assert_quadruple_tank("quadruple-tank-nonminimum", 0.43, 0.34, -0.057, 0.013);
}

int main(void)
{
    struct apc_error why;
    if (linear_load(&why) < 0) {
        fprintf(stderr, "%s\n", why.text);
        return 1;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_zeros_of_a_transfer_function_are_its_numerators),
        cmocka_unit_test(scales_do_not_matter),
        cmocka_unit_test(complex_zeros_and_those_of_a_feedthrough_are_found),
        cmocka_unit_test(systems_that_are_not_square_have_zeros_too),
        cmocka_unit_test(inputs_that_do_the_same_are_degenerate),
        cmocka_unit_test(the_pendulum_has_its_poles),
        cmocka_unit_test(the_quadruple_tanks_zeros_lie_where_its_valves_put_them),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
