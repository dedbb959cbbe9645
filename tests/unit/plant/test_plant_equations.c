/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The equations of every built-in model a second time, as their sources write them down, each tank, reaction
 * and heater with parameters of its own; and what an experiment has that says nothing of a variable.
 */
#include "check.h"

#include "apcplant.h"

#include <stdio.h>
#include <string.h>

#define N_MAX 15

/* ---- The equations -------------------------------------------------------------------------- */

typedef void equations_fn(const double *x, const double *u, const double *p, double *dx, double *y);

/* A pump or a feed that is told to go backwards stands still. */
static double forwards(double flow)
{
    return flow < 0.0 ? 0.0 : flow;
}

static double torricelli(double hole, double g, double level)
{
    return level < 0.0 ? 0.0 : hole * sqrt(2.0 * g) * sqrt(level);
}

static void first_order(const double *x, const double *u, const double *p, double *dx, double *y)
{
    dx[0] = p[0] / p[1] * u[0] - x[0] / p[1];
    y[0] = x[0];
}

static void servo(const double *x, const double *u, const double *p, double *dx, double *y)
{
    dx[0] = x[1];
    dx[1] = p[0] / p[1] * (u[0] + u[1]) - x[1] / p[1];
    y[0] = x[0];
}

/* What is drawn from an empty tank is nothing. */
static void double_tank(const double *x, const double *u, const double *p, double *dx, double *y)
{
    const double between = torricelli(p[2], p[5], x[0]), leak = x[1] > 0.0 ? u[1] : 0.0;

    dx[0] = p[4] / p[0] * forwards(u[0]) - between / p[0];
    dx[1] = between / p[1] - torricelli(p[3], p[5], x[1]) / p[1] - leak / p[1];
    y[0] = x[1];
    y[1] = x[0];
}

/* The angular momentum's equation put into that of the cart. */
static void pendulum(const double *x, const double *u, const double *p, double *dx, double *y)
{
    const double M = p[0], m = p[1], b = p[2], l = p[3], g = p[5], J = p[4] + m * l * l;
    const double c = cos(x[2]), s = sin(x[2]);

    dx[0] = x[1];
    dx[1] = (u[0] + u[1] - b * x[1] - m * l * x[3] * x[3] * s + m * l * c * m * g * l * s / J) /
            (M + m - pow(m * l * c, 2) / J);
    dx[2] = x[3];
    dx[3] = (m * l * c * dx[1] + m * g * l * s) / J;
    y[0] = x[0];
    y[1] = x[2];
}

static void quadruple_tank(const double *x, const double *u, const double *p, double *dx, double *y)
{
    const double *A = p, *a = p + 4, g1 = p[8], g2 = p[9], kc = p[12], g = p[13], brim = p[14];
    const double v1 = p[10] * forwards(u[0]), v2 = p[11] * forwards(u[1]);
    const double in[4] = {g1 * v1 + torricelli(a[2], g, x[2]), g2 * v2 + torricelli(a[3], g, x[3]),
                          v2 - g2 * v2 + u[2], v1 - g1 * v1 + u[3]};

    for (int i = 0; i < 4; i++)
        dx[i] = (in[i] - torricelli(a[i], g, x[i])) / A[i] - (x[i] > brim ? x[i] - brim : 0.0);
    y[0] = kc * x[0];
    y[1] = kc * x[1];
}

static void four_tank(const double *m, const double *u, const double *p, double *dx, double *y)
{
    const double a = p[0], A = p[1], g = p[2], rho = p[3], g1 = p[4], g2 = p[5];
    double q[4];

    for (int i = 0; i < 4; i++)
        q[i] = torricelli(a, g, m[i] / rho / A);
    dx[0] = rho * g1 * forwards(u[0]) + rho * q[2] - rho * q[0];
    dx[1] = rho * g2 * forwards(u[1]) + rho * q[3] - rho * q[1];
    dx[2] = rho * (1.0 - g2) * forwards(u[1]) + rho * forwards(u[2]) - rho * q[2];
    dx[3] = rho * (1.0 - g1) * forwards(u[0]) + rho * forwards(u[3]) - rho * q[3];
    y[0] = m[0] / rho / A;
    y[1] = m[1] / rho / A;
}

static void van_de_vusse(const double *x, const double *u, const double *p, double *dx, double *y)
{
    const double K = 273.15 + x[2], k1 = p[0] * exp(-p[1] / K), k3 = p[2] * exp(-p[3] / K),
                 F = forwards(u[0]);
    const double heat = k1 * x[0] * p[4] + k1 * x[1] * p[5] + k3 * x[0] * x[0] * p[6];
    const double rho_cp = p[7] * p[8], through = p[9] * p[10] * (x[3] - x[2]);

    dx[0] = (F * u[2] - F * x[0] - k1 * x[0] - k3 * x[0] * x[0]) / 3600.0;
    dx[1] = (k1 * x[0] - k1 * x[1] - F * x[1]) / 3600.0;
    dx[2] = (F * (u[3] - x[2]) + through / rho_cp / p[11] - heat / rho_cp) / 3600.0;
    dx[3] = (u[1] - through) / p[12] / p[13] / 3600.0;
    y[0] = x[1];
    y[1] = x[2];
}

/* Feed in mL/min, volume in L. */
static void adiabatic_cstr(const double *x, const double *u, const double *p, double *dx, double *y)
{
    const double r = exp(p[0]) * exp(-p[1] / (273.15 + x[2])) * x[0] * x[1];
    const double F = forwards(u[0]) / 1000.0 / 60.0;

    dx[0] = F / p[3] * (u[1] - x[0]) - r;
    dx[1] = F / p[3] * (u[2] - x[1]) - r - r;
    dx[2] = F / p[3] * (u[3] - x[2]) + p[2] * r;
    y[0] = x[2];
}

static void temperature_lab(const double *x, const double *u, const double *p, double *dx, double *y)
{
    dx[0] = p[0] / 5720.0 * u[0] + 0.05 * (u[2] - x[0]) + 0.01 * (x[1] - x[0]);
    dx[1] = p[1] / 5720.0 * u[1] + 0.05 * (u[2] - x[1]) + 0.01 * (x[0] - x[1]);
    dx[2] = (x[0] - x[2]) / 140.0;
    dx[3] = (x[1] - x[3]) / 140.0;
    y[0] = x[2];
    y[1] = x[3];
}

/* Where they are compared: beyond what is physical as well, an integrator's trial step may be there. */
static const struct {
    const char *name;
    equations_fn *equations;
    double x_from, x_to, u_from, u_to;
} models[] = {
    {"first-order", first_order, -9, 9, -9, 9},
    {"servo", servo, -9, 9, -9, 9},
    {"double-tank", double_tank, -0.3, 1, -5, 20},
    {"pendulum", pendulum, -3, 3, -9, 9},
    {"quadruple-tank", quadruple_tank, -5, 30, -3, 10},
    {"quadruple-tank-nonminimum", quadruple_tank, -5, 30, -3, 10},
    {"four-tank", four_tank, -5e3, 5e4, -100, 400},
    {"van-de-vusse", van_de_vusse, 0.1, 150, -10, 50},
    {"adiabatic-cstr", adiabatic_cstr, 0.1, 90, -200, 900},
    {"temperature-lab", temperature_lab, -50, 150, 0, 100},
};
#define N_MODELS (sizeof(models) / sizeof(models[0]))

static double between(uint32_t *seed, double from, double to)
{
    *seed = *seed * 1664525u + 1013904223u;
    return from + (to - from) * (*seed / 4294967295.0);
}

static void assert_close(const char *name, const char *what, size_t i, double actual, double expected)
{
    if (!(fabs(actual - expected) <= 1e-9 * fmax(fabs(expected), 1e-3)))
        fail_msg("%s: %s %zu = %.17g, expected %.17g", name, what, i + 1, actual, expected);
}

static void every_model_has_the_equations_of_its_source(void **state)
{
    uint32_t seed = 1;

    (void)state;
    for (size_t k = 0; k < N_MODELS; k++) {
        const struct apc_model *m = apc_model_built_in(k);

        assert_string_equal(m->name, models[k].name);
        assert_in_range(m->np, 0, N_MAX);
        for (int trial = 0; trial < 300; trial++) {
            double p[N_MAX], x[4], u[4], dx[4], y[4], expected_dx[4], expected_y[4];

            for (size_t i = 0; i < m->np; i++)
                p[i] = m->param[i].initial * between(&seed, 0.7, 1.3);
            for (size_t i = 0; i < m->nx; i++)
                x[i] = between(&seed, models[k].x_from, models[k].x_to);
            for (size_t i = 0; i < m->nu + m->nd; i++)
                u[i] = between(&seed, models[k].u_from, models[k].u_to);
            models[k].equations(x, u, p, expected_dx, expected_y);
            assert_int_equal(m->f(between(&seed, 0.0, 1e6), x, u, p, dx), 0);
            m->g(between(&seed, 0.0, 1e6), x, u, p, y);
            for (size_t i = 0; i < m->nx; i++)
                assert_close(m->name, "derivative", i, dx[i], expected_dx[i]);
            for (size_t i = 0; i < m->ny; i++)
                assert_close(m->name, "output", i, y[i], expected_y[i]);
        }
    }
}

static void an_empty_tank_gives_nothing_however_much_is_drawn(void **state)
{
    const struct apc_model *m = apc_model_built_in(2);
    const double p[] = {0.5, 0.25, 0.019, 0.016, 0.003, 9.81}, empty[] = {0.0, 0.0}, u[] = {0.0, 0.5};
    double dx[2];

    (void)state;
    assert_string_equal(m->name, "double-tank");
    assert_int_equal(m->f(0.0, empty, u, p, dx), 0);
    assert_near(dx[0], 0.0, 0.0);
    assert_near(dx[1], 0.0, 0.0);
}

static void reactions_are_not_defined_at_absolute_zero_and_below(void **state)
{
    (void)state;
    for (size_t k = 7; k <= 8; k++) {
        const struct apc_model *m = apc_model_built_in(k);
        const double u[4] = {1.0, 1.0, 1.0, 1.0};
        double p[N_MAX], x[4] = {1.0, 1.0, -273.15, 0.0}, dx[4];

        for (size_t i = 0; i < m->np; i++)
            p[i] = m->param[i].initial;
        assert_int_not_equal(m->f(0.0, x, u, p, dx), 0);
        x[2] = -300.0;
        assert_int_not_equal(m->f(0.0, x, u, p, dx), 0);
        x[2] = -272.9;
        assert_int_equal(m->f(0.0, x, u, p, dx), 0);
    }
}

/* ---- Initial values and ranges ------------------------------------------------------------------- */

/* Experiments rest on them: what one does that leaves a value out must not change with a new version. */
static const char *const tables[N_MODELS] = {
    "K 10 (-1000000 to 1000000)\n"
    "tau 10 (1e-06 to 1000000000)\n"
    "x 0 (-1e+300 to 1e+300)\n"
    "u 0 (-10 to 10)\n",
    "K 1000 (-1000000 to 1000000)\n"
    "tau 1 (1e-06 to 1000000)\n"
    "angle 0 (-1e+300 to 1e+300)\n"
    "speed 0 (-1e+300 to 1e+300)\n"
    "u 0 (-10 to 10)\n"
    "load 0 (-10 to 10)\n",
    "A1 0.5 (1e-06 to 1000000)\n"
    "A2 0.25 (1e-06 to 1000000)\n"
    "a1 0.019 (0 to 1000)\n"
    "a2 0.016 (0 to 1000)\n"
    "k 0.003 (0 to 1000)\n"
    "g 9.81 (0 to 1000)\n"
    "h1 0 (0 to 1e+300)\n"
    "h2 0 (0 to 1e+300)\n"
    "u 10 (0 to 20)\n"
    "leak 0 (0 to 1)\n",
    "M 0.5 (1e-06 to 1000000)\n"
    "m 0.2 (1e-06 to 1000000)\n"
    "b 0.1 (0 to 1000000)\n"
    "l 0.3 (1e-06 to 1000000)\n"
    "I 0.006 (0 to 1000000)\n"
    "g 9.8 (0 to 1000)\n"
    "s 0 (-1e+300 to 1e+300)\n"
    "v 0 (-1e+300 to 1e+300)\n"
    "phi 0 (-1e+300 to 1e+300)\n"
    "omega 0 (-1e+300 to 1e+300)\n"
    "F 0 (-100 to 100)\n"
    "push 0 (-1000 to 1000)\n",
    "A1 28 (0.001 to 1000000)\n"
    "A2 32 (0.001 to 1000000)\n"
    "A3 28 (0.001 to 1000000)\n"
    "A4 32 (0.001 to 1000000)\n"
    "a1 0.071 (0 to 1000)\n"
    "a2 0.057 (0 to 1000)\n"
    "a3 0.071 (0 to 1000)\n"
    "a4 0.057 (0 to 1000)\n"
    "g1 0.7 (0 to 1)\n"
    "g2 0.6 (0 to 1)\n"
    "k1 3.33 (0 to 1000)\n"
    "k2 3.35 (0 to 1000)\n"
    "kc 0.5 (1e-06 to 1000000)\n"
    "g 981 (0 to 100000)\n"
    "h_max 20 (0.001 to 1000000)\n"
    "h1 12.4 (0 to 1000000)\n"
    "h2 12.7 (0 to 1000000)\n"
    "h3 1.8 (0 to 1000000)\n"
    "h4 1.4 (0 to 1000000)\n"
    "v1 3 (0 to 10)\n"
    "v2 3 (0 to 10)\n"
    "d3 0 (0 to 100)\n"
    "d4 0 (0 to 100)\n",
    "A1 28 (0.001 to 1000000)\n"
    "A2 32 (0.001 to 1000000)\n"
    "A3 28 (0.001 to 1000000)\n"
    "A4 32 (0.001 to 1000000)\n"
    "a1 0.071 (0 to 1000)\n"
    "a2 0.057 (0 to 1000)\n"
    "a3 0.071 (0 to 1000)\n"
    "a4 0.057 (0 to 1000)\n"
    "g1 0.43 (0 to 1)\n"
    "g2 0.34 (0 to 1)\n"
    "k1 3.14 (0 to 1000)\n"
    "k2 3.29 (0 to 1000)\n"
    "kc 0.5 (1e-06 to 1000000)\n"
    "g 981 (0 to 100000)\n"
    "h_max 20 (0.001 to 1000000)\n"
    "h1 12.6 (0 to 1000000)\n"
    "h2 13 (0 to 1000000)\n"
    "h3 4.8 (0 to 1000000)\n"
    "h4 4.9 (0 to 1000000)\n"
    "v1 3.15 (0 to 10)\n"
    "v2 3.15 (0 to 10)\n"
    "d3 0 (0 to 100)\n"
    "d4 0 (0 to 100)\n",
    "a 1.2272 (0 to 1000)\n"
    "A 380.1327 (0.001 to 1000000)\n"
    "g 981 (0 to 100000)\n"
    "rho 1 (1e-06 to 1000)\n"
    "g1 0.6 (0 to 1)\n"
    "g2 0.7 (0 to 1)\n"
    "m1 17612.0124 (0 to 1000000000)\n"
    "m2 29640.6695 (0 to 1000000000)\n"
    "m3 4644.2195 (0 to 1000000000)\n"
    "m4 9378.4931 (0 to 1000000000)\n"
    "F1 300 (0 to 500)\n"
    "F2 300 (0 to 500)\n"
    "F3 100 (0 to 500)\n"
    "F4 150 (0 to 500)\n",
    "k0 1287000000000 (0 to 1e+20)\n"
    "E1 9758.3 (0 to 1000000)\n"
    "k03 9043000000 (0 to 1e+20)\n"
    "E3 8560 (0 to 1000000)\n"
    "dH1 4.2 (-10000 to 10000)\n"
    "dH2 -11 (-10000 to 10000)\n"
    "dH3 -41.85 (-10000 to 10000)\n"
    "rho 0.9342 (1e-06 to 1000)\n"
    "Cp 3.01 (1e-06 to 1000)\n"
    "Kw 4032 (0 to 1000000000)\n"
    "AR 0.215 (0 to 1000000)\n"
    "VR 10.01 (1e-06 to 1000000000)\n"
    "mK 5 (1e-06 to 1000000000)\n"
    "CpK 2 (1e-06 to 1000)\n"
    "cA 2.14 (0 to 1000)\n"
    "cB 1.0903 (0 to 1000)\n"
    "T 114.194 (-273.15 to 10000)\n"
    "TK 112.91 (-273.15 to 10000)\n"
    "F 14.19 (0 to 50)\n"
    "Q -1113.5 (-9000 to 0)\n"
    "cA0 5.1 (0 to 20)\n"
    "Tin 104.9 (-50 to 300)\n",
    "ln_k0 24.6 (-100 to 100)\n"
    "E 8500 (0 to 1000000)\n"
    "beta 133.779 (-1000000 to 1000000)\n"
    "V 0.105 (1e-09 to 1000000000)\n"
    "cA 0.8 (0 to 1000)\n"
    "cB 1.2 (0 to 1000)\n"
    "T 0.5 (-273.15 to 10000)\n"
    "F 500 (0 to 1000)\n"
    "cAin 0.8 (0 to 10)\n"
    "cBin 1.2 (0 to 10)\n"
    "Tin 0.5 (-50 to 100)\n",
    "P1 200 (0 to 1000000)\n"
    "P2 100 (0 to 1000000)\n"
    "H1 21 (-273.15 to 10000)\n"
    "H2 21 (-273.15 to 10000)\n"
    "T1 21 (-273.15 to 10000)\n"
    "T2 21 (-273.15 to 10000)\n"
    "Q1 0 (0 to 100)\n"
    "Q2 0 (0 to 100)\n"
    "Ta 21 (-50 to 100)\n",
};

static size_t describe(char *to, size_t size, const struct apc_param *table, size_t n)
{
    size_t used = 0;

    for (size_t i = 0; i < n && used < size; i++)
        used += (size_t)snprintf(to + used, size - used, "%s %.15g (%.15g to %.15g)\n", table[i].name,
                                 table[i].initial, table[i].low, table[i].high);
    return used;
}

static void a_variable_of_which_nothing_is_said_has_its_initial_value_and_range(void **state)
{
    (void)state;
    for (size_t k = 0; k < N_MODELS; k++) {
        const struct apc_model *m = apc_model_built_in(k);
        char text[2000];
        size_t used = describe(text, sizeof(text), m->param, m->np);

        used += describe(text + used, sizeof(text) - used, m->state, m->nx);
        used += describe(text + used, sizeof(text) - used, m->input, m->nu);
        used += describe(text + used, sizeof(text) - used, m->disturbance, m->nd);
        assert_in_range(used, 1, sizeof(text) - 1);
        assert_string_equal(text, tables[k]);
        for (size_t i = 0; i < m->ny; i++) { /* an output has neither */
            const struct apc_param *y = &m->output[i];

            assert_true(y->name[0] && y->initial == 0.0 && y->low == 0.0 && y->high == 0.0);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_model_has_the_equations_of_its_source),
        cmocka_unit_test(an_empty_tank_gives_nothing_however_much_is_drawn),
        cmocka_unit_test(reactions_are_not_defined_at_absolute_zero_and_below),
        cmocka_unit_test(a_variable_of_which_nothing_is_said_has_its_initial_value_and_range),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
