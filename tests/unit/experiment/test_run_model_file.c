/* SPDX-License-Identifier: BSD-3-Clause */
/* Models that people write for a controller: each number where the controller has it, whatever the file's
 * order; and the mistakes that there may be in one.
 */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "apclinear.h"
#include "experiment/experiment_parts.h"
#include "scratch.h"

enum { U1, U2, W, INPUTS, Y1 = 0, Y2, OUTPUTS };

#define TS 2.0

static struct apc_error why;

static int load(struct experiment *e, const char *model)
{
    char text[3000];
    snprintf(text, sizeof text,
             "name = \"model\";\n"
             "measurements = ( { name = \"y1\"; }, { name = \"y2\"; }, { name = \"w\"; } );\n"
             "setpoints = ( { name = \"r1\"; initial = 1.0; }, { name = \"r2\"; initial = 1.0; } );\n"
             "outputs = ( { name = \"u1\"; low = -9.0; high = 9.0; }, { name = \"u2\"; low = -9.0; high = "
             "9.0; } );\n"
             "plant = { external = true; period = 1.0; };\n"
             "client = { period = 1.0; };\n"
             "controllers = ( { name = \"c\"; law = \"mpc\"; period = 2.0; measurements = [\"y1\", \"y2\"];\n"
             "  setpoints = [\"r1\", \"r2\"]; outputs = [\"u1\", \"u2\"]; disturbances = [\"w\"];\n"
             "  model = %s; } );\n",
             model);
    scratch_write("model.conf", text);
    return experiment_load(e, scratch_path("model.conf"), EXPERIMENT_LAW, NULL, &why);
}

/* What comes out of @p output, s after a step of 1 into @p input. */
static double step_response(const struct apc_linear *m, size_t input, size_t output, double t)
{
    double *x = calloc(2 * m->nx + 1, sizeof *x), *next = x + m->nx, y = 0.0;
    const size_t inputs = m->nu + m->nd;
    assert_non_null(x);
    for (double now = 0.0; now < t - TS / 2.0; now += TS) {
        for (size_t i = 0; i < m->nx; i++) {
            next[i] = m->B[i * inputs + input];
            for (size_t j = 0; j < m->nx; j++)
                next[i] += m->A[i * m->nx + j] * x[j];
        }
        memcpy(x, next, m->nx * sizeof *x);
    }
    for (size_t j = 0; j < m->nx; j++)
        y += m->C[output * m->nx + j] * x[j];
    y += m->D[output * inputs + input];
    free(x);
    return y;
}

static void assert_point(const struct controller *c)
{
    static const double u0[] = {3.0, 5.0, 7.0}, y0[] = {10.0, 20.0};
    assert_near(c->plant.sampled->Ts, TS, 0.0);
    assert_int_equal(c->plant.sampled->nu, 2);
    assert_int_equal(c->plant.sampled->nd, 1);
    assert_int_equal(c->plant.sampled->ny, OUTPUTS);
    for (size_t i = 0; i < INPUTS; i++)
        assert_near(c->plant.u0[i], u0[i], 0.0);
    for (size_t i = 0; i < OUTPUTS; i++)
        assert_near(c->plant.y0[i], y0[i], 0.0);
}

#define POINT "operating_point = { u = [7.0, 5.0, 3.0]; y = [20.0, 10.0]; };"
#define ORDER "inputs = [\"w\", \"u2\", \"u1\"]; outputs = [\"y2\", \"y1\"]; "

static const char transfers[] =
    "{ " ORDER POINT " delay = 2.0; transfer = (\n"
    "{ from = \"u1\"; to = \"y1\"; gain = 2.0; tau = [10.0]; },\n"
    "{ from = \"u2\"; to = \"y1\"; gain = -1.0; tau = [5.0, 3.0]; dead_time = 4.0; },\n"
    "{ from = \"w\"; to = \"y2\"; gain = 0.5; tau = [4.0]; zero = 1.0; },\n"
    "{ from = \"u1\"; to = \"y2\"; gain = 0.25; integrating = true; } ); }";

/* Of each pair, as the formulary has it; after the dead time and the delay of all. */
static double expected(size_t input, size_t output, double t)
{
    const double s = t - 2.0;
    if (input == U1 && output == Y1)
        return s > 0 ? 2.0 * (1.0 - exp(-s / 10.0)) : 0.0;
    if (input == U2 && output == Y1)
        return s > 4.0 ? -1.0 + (5.0 * exp(-(s - 4.0) / 5.0) - 3.0 * exp(-(s - 4.0) / 3.0)) / 2.0 : 0.0;
    if (input == W && output == Y2)
        return s > 0 ? 0.5 * (1.0 + (1.0 / 4.0 - 1.0) * exp(-s / 4.0)) : 0.0;
    return input == U1 && output == Y2 && s > 0 ? 0.25 * s : 0.0;
}

static void a_transfer_function_is_of_the_pair_that_it_names(void **state)
{
    struct experiment e;
    (void)state;
    if (load(&e, transfers) < 0)
        fail_msg("%s", why.text);
    assert_point(e.controllers);
    for (size_t i = 0; i < INPUTS; i++)
        for (size_t o = 0; o < OUTPUTS; o++)
            for (double t = TS; t <= 40.0; t += TS) {
                const double y = step_response(e.controllers->plant.sampled, i, o, t);
                if (!(fabs(y - expected(i, o, t)) < 1e-9) && !(i == W && t <= 2.0 + 1e-9))
                    fail_msg("from %zu to %zu: %g after %g s, not %g", i, o, y, t, expected(i, o, t));
            }
    experiment_free(&e);
}

/* x1 is moved by u1 and u2, x2 by u2 and w; y1 is x1 and a little x2, y2 is x2. Rows and columns in the
 * file's order. */
#define SPACE "B = ( [0.0, 2.0, 1.0], [4.0, 3.0, 0.0] ); C = ( [0.0, 1.0], [1.0, 0.5] ); "

static void a_state_space_has_its_rows_and_columns_by_their_names(void **state)
{
    static const double B[2][INPUTS] = {{1.0, 2.0, 0.0}, {0.0, 3.0, 4.0}},
                        C[OUTPUTS][2] = {{1.0, 0.5}, {0.0, 1.0}}, dead[INPUTS] = {2.0, 4.0, 0.0},
                        a[] = {-0.1, -0.2}, z[] = {0.8, 0.5};
    static const char *const models[] = {
        "{ " ORDER POINT " state_space = { A = ( [-0.1, 0.0], [0.0, -0.2] ); " SPACE
        "dead_time = [0.0, 4.0, 2.0]; }; }",
        "{ " ORDER POINT " delay = 2.0; state_space = { A = ( [-0.1, 0.0], [0.0, -0.2] ); " SPACE
        "dead_time = [0.0, 4.0, 2.0]; }; }",
        "{ " ORDER POINT " delay = 4.0; state_space = { A = ( [-0.1, 0.0], [0.0, -0.2] ); " SPACE "}; }",
        "{ " ORDER POINT " state_space = { period = 2.0; A = ( [0.8, 0.0], [0.0, 0.5] ); " SPACE "}; }"};
    static const double delay[] = {0.0, 2.0, 4.0, 0.0};
    (void)state;
    for (size_t k = 0; k < sizeof models / sizeof *models; k++) {
        struct experiment e;
        if (load(&e, models[k]) < 0)
            fail_msg("%s", why.text);
        assert_point(e.controllers);
        for (size_t i = 0; i < INPUTS; i++)
            for (size_t o = 0; o < OUTPUTS; o++)
                for (double t = TS; t <= 40.0; t += TS) {
                    const double s = fmax(0.0, t - delay[k] - (k < 2 ? dead[i] : 0.0));
                    double should = 0.0;
                    for (size_t x = 0; x < 2; x++)
                        should += C[o][x] * B[x][i] *
                                  (k < 3 ? (1.0 - exp(a[x] * s)) / -a[x]
                                         : (1.0 - pow(z[x], s / TS)) / (1.0 - z[x]));
                    assert_near(step_response(e.controllers->plant.sampled, i, o, t), should, 1e-9);
                }
        experiment_free(&e);
    }
}

#define FILTERED(more)                                                                                       \
    "{ " ORDER "state_space = { period = 2.0; A = ( [0.8, 0.1], [0.0, 0.5] ); " SPACE                        \
    "K = ( [0.3, 0.4], [0.5, 0.6] ); error = [0.02, 0.01]; }; }; " more

static bool has_setting(const struct controller *c, const char *name)
{
    for (size_t i = 0; i < c->n_setting; i++)
        if (!strcmp(c->setting[i].name, name))
            return true;
    return false;
}

static void assert_setting(const struct controller *c, const char *name, const double *value, size_t n)
{
    size_t i = 0;
    assert_true(has_setting(c, name));
    while (strcmp(c->setting[i].name, name) != 0)
        i++;
    assert_int_equal(c->setting[i].rows * c->setting[i].columns, n);
    for (size_t k = 0; k < n; k++)
        assert_near(c->setting[i].value[k], value[k], 1e-15);
}

/* Errors are further states, of the controller's measurements in their order, and noise makes them. */
static void a_kalman_gain_is_what_the_law_estimates_with(void **state)
{
    static const double A[] = {0.8, 0.1, 0.4, 0.3, 0.0, 0.5, 0.6, 0.5},
                        C[] = {1.0, 0.5, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0}, error[] = {0.01, 0.02};
    struct experiment e;
    (void)state;
    if (load(&e, FILTERED("settings = { horizon = 7; y_scale = [1.0, 2.0]; }")) < 0)
        fail_msg("%s", why.text);
    const struct controller *c = e.controllers;
    const struct apc_linear *m = c->plant.sampled;
    assert_int_equal(m->nx, 4);
    for (size_t i = 0; i < 2; i++)
        for (size_t j = 0; j < 4; j++) {
            assert_near(m->A[i * 4 + j], A[i * 4 + j], 0.0);
            assert_near(m->A[(i + 2) * 4 + j], 0.0, 0.0);
            assert_near(m->C[i * 4 + j], C[i * 4 + j], 0.0);
        }
    for (size_t i = 0; i < 2; i++)
        for (size_t j = 0; j < INPUTS; j++)
            assert_near(m->B[(i + 2) * INPUTS + j], 0.0, 0.0);
    assert_setting(c, "x_noise", (const double[]){0.0, 0.0, error[0] / sqrt(TS), error[1] / sqrt(TS)}, 4);
    assert_setting(c, "y_noise", (const double[]){0.01 * error[0], 0.01 * error[1]}, 2);
    /* what the file sets stays beside it */
    assert_setting(c, "horizon", (const double[]){7.0}, 1);
    assert_setting(c, "y_scale", (const double[]){1.0, 2.0}, 2);
    experiment_free(&e);
    if (load(&e, FILTERED("settings = { y_noise = [0.1, 0.2]; }")) < 0) /* it says how it is disturbed */
        fail_msg("%s", why.text);
    assert_int_equal(e.controllers->plant.sampled->nx, 2);
    assert_false(has_setting(e.controllers, "x_noise"));
    experiment_free(&e);
}

static void without_names_the_order_is_the_controllers(void **state)
{
    struct experiment e;
    (void)state;
    if (load(&e, "{ transfer = ( { from = \"u2\"; to = \"y1\"; gain = 3.0; tau = [5.0]; },\n"
                 "  { from = \"u1\"; to = \"y2\"; gain = 2.0; tau = [5.0]; } );\n"
                 "  operating_point = { u = [3.0, 5.0, 7.0]; y = [10.0, 20.0]; }; }") < 0)
        fail_msg("%s", why.text);
    assert_point(e.controllers);
    assert_near(step_response(e.controllers->plant.sampled, U2, Y1, 200.0), 3.0, 1e-9);
    experiment_free(&e);
}

/* A run folder has the model with it: what is loaded from there is the same. */
static void a_model_of_a_file_goes_along_with_its_run(void **state)
{
    struct experiment e, again;
    char *text, model[sizeof transfers];
    (void)state;
    snprintf(model, sizeof model, "%s", transfers + 1);
    *strrchr(model, '}') = '\0'; /* its members */
    scratch_write("tanks.model", model);
    if (load(&e, "\"tanks.model\"") < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.controllers->model_file, scratch_path("tanks.model"));
    assert_int_equal(model_files_embed(&e, &text, &why), 0);
    assert_null(strstr(text, "tanks.model"));
    scratch_write("embedded.conf", text);
    if (experiment_load(&again, scratch_path("embedded.conf"), EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(again.controllers->model_file, "");
    assert_point(again.controllers);
    for (size_t i = 0; i < INPUTS; i++)
        for (size_t o = 0; o < OUTPUTS; o++)
            assert_near(step_response(again.controllers->plant.sampled, i, o, 20.0),
                        step_response(e.controllers->plant.sampled, i, o, 20.0), 0.0);
    free(text);
    experiment_free(&again);
    snprintf(e.controllers->model_file, sizeof e.controllers->model_file, "/no/such.model");
    assert_true(model_files_embed(&e, &text, &why) < 0);
    assert_null(text);
    assert_has(why.text, "/no/such.model");
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_transfer_function_is_of_the_pair_that_it_names),
        cmocka_unit_test(a_state_space_has_its_rows_and_columns_by_their_names),
        cmocka_unit_test(a_kalman_gain_is_what_the_law_estimates_with),
        cmocka_unit_test(without_names_the_order_is_the_controllers),
        cmocka_unit_test(a_model_of_a_file_goes_along_with_its_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
