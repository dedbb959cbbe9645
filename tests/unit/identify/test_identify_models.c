/* SPDX-License-Identifier: BSD-3-Clause */
/* Difference equations and state space from records: of plants that are known, and of the hair dryer that
 * others have identified before. */
#include "apcidentify.h"
#include "base/matrix.h"
#include "check.h"
#include "identify/identify_internal.h"
#include "records.h"

#include <complex.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The hair dryer ------------------------------------------------------------------------------ */

/* Air temperature over the voltage of the heater, 1000 samples of 0.08 s (Ljung, System Identification,
 * 1987): Debian's octave-control brings it along as a test of its own. */
struct dryer {
    struct apc_record record;
    double u[1000], y[1000];
};

/* The numbers of one matrix, which stand row by row, ten in each; they go down its columns. */
static bool read_numbers(FILE *in, const char *name, double *out)
{
    char line[400], begin[40];
    size_t row = 0;

    snprintf(begin, sizeof begin, "%%! %s = [", name);
    while (fgets(line, sizeof line, in)) {
        char *at = line + 3, *end;

        if (row == 0 && strncmp(line, begin, strlen(begin)) != 0)
            continue;
        at = row == 0 ? line + strlen(begin) : at;
        for (size_t column = 0; column < 10 && row < 100; column++, at = end) {
            out[column * 100 + row] = strtod(at, &end);
            if (end == at)
                return false;
        }
        if (++row == 100)
            return true;
    }
    return false;
}

static FILE *open_octave(void)
{
    const char *given = getenv("APC_OCTAVE_CONTROL");
    FILE *in = NULL;
    glob_t found;

    if (glob(given ? given : "/usr/share/octave/packages/control-*/moen4.m", 0, NULL, &found) == 0) {
        in = fopen(found.gl_pathv[0], "r");
        globfree(&found);
    }
    return in;
}

static struct dryer *dryer(void)
{
    struct dryer *d;
    FILE *in = open_octave();

    if (!in) {
        print_message(
            "skipped: no moen4.m of Debian's octave-control; APC_OCTAVE_CONTROL says where it is\n");
        skip();
    }
    d = calloc(1, sizeof *d);
    assert_non_null(d);
    assert_true(read_numbers(in, "Y", d->y) && read_numbers(in, "U", d->u));
    fclose(in);
    d->record = (struct apc_record){
        .size = sizeof d->record, .Ts = 0.08, .n = 1000, .nu = 1, .ny = 1, .u = d->u, .y = d->y};
    return d;
}

static double gain_of(const struct apc_linear *m)
{
    double I_A[400], b[20], gain = m->D[0];

    assert_true(m->nx <= 20 && m->nu == 1 && m->ny == 1);
    for (size_t i = 0; i < m->nx; i++) {
        b[i] = m->B[i];
        for (size_t j = 0; j < m->nx; j++)
            I_A[i * m->nx + j] = (i == j) - m->A[i * m->nx + j];
    }
    assert_int_equal(apc_matrix_solve(m->nx, 1, I_A, b), 0);
    return gain + apc_matrix_dot(m->C, b, m->nx);
}

/* A matrix of the same file, in Octave's rows. Returns how many numbers. */
static size_t read_matrix(FILE *in, const char *name, double *out, size_t most)
{
    char line[400], begin[40];
    size_t n = 0;
    bool on = false;

    rewind(in);
    snprintf(begin, sizeof begin, "%%! %s = [", name);
    while (n < most && fgets(line, sizeof line, in)) {
        char *at = line + 2, *end;

        if (!on && strncmp(line, begin, strlen(begin)) != 0)
            continue;
        if (!on)
            at = line + strlen(begin);
        on = true;
        while (n < most) {
            const double value = strtod(at, &end);

            if (end == at)
                break;
            out[n++] = value;
            at = end;
        }
        if (strchr(line, ']'))
            break;
    }
    return n;
}

/* det(z I - A) = z^n + c[n-1] z^(n-1) + ..., by Faddeev and LeVerrier. */
static void characteristic(size_t n, const double *A, double *c)
{
    double M[64] = {0}, AM[64];

    c[n] = 1.0;
    for (size_t k = 1; k <= n; k++) {
        double trace = 0.0;

        for (size_t i = 0; i < n; i++)
            M[i * n + i] += c[n - k + 1];
        apc_matrix_multiply(n, n, n, A, M, AM);
        for (size_t i = 0; i < n; i++)
            trace += AM[i * n + i];
        c[n - k] = -trace / (double)k;
        memcpy(M, AM, sizeof M);
    }
}

/* By Durand and Kerner; each of one set is near one of the other. */
static void poles(size_t n, const double *A, double complex *root)
{
    double c[9];

    characteristic(n, A, c);
    for (size_t i = 0; i < n; i++)
        root[i] = cpow(0.4 + 0.9 * (double complex)I, (double)i);
    for (int iteration = 0; iteration < 500; iteration++) {
        for (size_t i = 0; i < n; i++) {
            double complex value = 1.0, apart = 1.0;

            for (size_t k = n; k-- > 0;)
                value = value * root[i] + c[k];
            for (size_t k = 0; k < n; k++)
                apart *= k == i ? 1.0 : root[i] - root[k];
            root[i] -= value / apart;
        }
    }
}

/* The gain that A and C have with the B, D and first state of which the free run over the record fits best. */
static double gain_by_free_run(const struct apc_record *r, const double *A, const double *C)
{
    enum { UNKNOWN = 9 }; /* first state, B, D */
    double state[4 * 8] = {0}, next[4 * 8], row[UNKNOWN + 1], theta[UNKNOWN], b[UNKNOWN], I_A[16];
    struct apc_triangle rows;

    assert_int_equal(apc_triangle_open(&rows, UNKNOWN + 1), 0);
    for (size_t i = 0; i < 4; i++)
        state[i * 8 + i] = 1.0;
    for (size_t k = 0; k < r->n; k++) {
        apc_matrix_multiply(1, 4, 8, C, state, row);
        row[8] = r->u[k];
        row[9] = r->y[k];
        apc_triangle_add(&rows, row);
        apc_matrix_multiply(4, 4, 8, A, state, next);
        for (size_t i = 0; i < 4; i++)
            next[i * 8 + 4 + i] += r->u[k];
        memcpy(state, next, sizeof state);
    }
    apc_triangle_end(&rows);
    for (size_t i = 0; i < UNKNOWN; i++)
        b[i] = rows.R[i * (UNKNOWN + 1) + UNKNOWN];
    apc_qr_solve(UNKNOWN, rows.R, UNKNOWN + 1, b, theta);
    apc_triangle_close(&rows);
    for (size_t i = 0; i < 16; i++)
        I_A[i] = (i % 5 == 0) - A[i];
    assert_int_equal(apc_matrix_solve(4, 1, I_A, theta + 4), 0);
    return theta[8] + apc_matrix_dot(C, theta + 4, 4);
}

/* Octave states its matrices to four digits, of numbers that are no deviations: its gain is then that of the
 * means, which B and D of N4SID's projection give back 2 % differently, unlike the poles;
 * those of the best free run, upon Octave's A and C, have our gain. */
/* Promise(identification/difference-equations) */
static void state_space_of_the_hair_dryer_is_octaves(void **state)
{
    struct dryer *d = dryer();
    const struct apc_identify_subspace_options options = {
        .size = sizeof options, .order = 4, .direct = true, .deviations = true};
    double A[16], B[4], C[4], D, I_A[16], gain;
    double complex theirs[4], ours[4];
    struct apc_identified *m;
    FILE *in = open_octave();
    (void)state;

    assert_non_null(in);
    assert_true(read_matrix(in, "Ae", A, 16) == 16 && read_matrix(in, "Be", B, 4) == 4);
    assert_true(read_matrix(in, "Ce", C, 4) == 4 && read_matrix(in, "De", &D, 1) == 1);
    fclose(in);
    poles(4, A, theirs);
    for (size_t i = 0; i < 16; i++)
        I_A[i] = (i % 5 == 0) - A[i];
    assert_int_equal(apc_matrix_solve(4, 1, I_A, B), 0);
    gain = D + apc_matrix_dot(C, B, 4);

    assert_int_equal(apc_identify_subspace(&m, &d->record, &options, NULL), 0);
    poles(4, m->linear->A, ours);
    for (size_t i = 0; i < 4; i++) {
        double nearest = HUGE_VAL;

        for (size_t k = 0; k < 4; k++)
            nearest = fmin(nearest, cabs(ours[k] - theirs[i]));
        assert_near(nearest, 0.0, 0.001 * cabs(theirs[i]));
    }
    assert_near(gain_of(m->linear), gain, 0.03 * gain);
    assert_near(gain_of(m->linear), gain_by_free_run(&d->record, A, C), 0.005 * gain);
    apc_identified_destroy(m);
    free(d);
}

/* Fitted to the first half, run freely over the second. */
/* Promise(identification/difference-equations) */
static void the_hair_dryer_is_predicted(void **state)
{
    struct dryer *d = dryer();
    struct apc_record half = d->record;
    struct apc_identified *m;
    struct apc_transfer g, error;
    struct apc_linear *linear;
    struct apc_validation v;
    double u0, y0;
    (void)state;
    half.n = 500;

    assert_int_equal(apc_identify_arx(&m, &half, NULL, NULL), 0);
    assert_int_equal(apc_validate(m->linear, m->K, &d->record, 500, &v, NULL, NULL), 0);
    print_message("arx(%zu, %zu, %zu): fit %.2f %%, gain %.3f\n", m->na, m->nb, m->delay[0], v.fit,
                  gain_of(m->linear));
    assert_true(v.fit > 85.0 && v.ahead > 94.0);
    apc_identified_destroy(m);

    assert_int_equal(apc_identify_subspace(&m, &half, NULL, NULL), 0);
    assert_int_equal(apc_validate(m->linear, m->K, &d->record, 500, &v, NULL, NULL), 0);
    print_message("subspace(%zu): fit %.2f %%, gain %.3f\n", m->linear->nx, v.fit, gain_of(m->linear));
    assert_true(v.fit > 85.0 && v.ahead > 94.0);
    apc_identified_destroy(m);

    assert_int_equal(apc_identify_transfer(&half, NULL, &g, &error, &u0, &y0, NULL, NULL), 0);
    assert_int_equal(apc_linear_from_transfer(&linear, 1, 1, 0, &g, &u0, &y0, 0.08, NULL), 0);
    assert_int_equal(apc_validate(linear, NULL, &d->record, 500, &v, NULL, NULL), 0);
    print_message("lags %.3f and %.3f s, dead time %.3f s: fit %.2f %%, gain %.3f\n", g.tau[0], g.tau[1],
                  g.dead_time, v.fit, g.gain);
    assert_true(v.fit > 85.0);
    apc_linear_destroy(linear);
    free(d);
}

/* ---- Plants that are known ------------------------------------------------------------------------- */

static const struct apc_transfer two_by_two[] = {
    {.gain = 10.0, .tau = {1.0}, .dead_time = 0.6},
    {.gain = -4.0, .tau = {2.5}, .dead_time = 1.0},
    {.gain = 2.0, .tau = {0.6}},
    {.gain = 3.0, .tau = {1.2, 0.5}, .dead_time = 0.4},
};

static struct record_test *of_two_by_two(double noise, uint64_t seed)
{
    return record_simulate(two_by_two, 2, 2, 3000, 0.2, (const size_t[]){5, 7}, noise, 0.0, seed);
}

/* y of the truth, without noise, on other inputs than the model was made from. */
static void predicts(const struct apc_identified *m, double least)
{
    struct record_test *t = of_two_by_two(0.0, 77);
    struct apc_validation v[2];

    assert_int_equal(apc_validate(m->linear, m->K, &t->record, 100, v, NULL, NULL), 0);
    if (!(v[0].fit > least && v[1].fit > least))
        fail_msg("fits %.3f and %.3f %%, expected %g", v[0].fit, v[1].fit, least);
    free(t);
}

/* Promise(identification/difference-equations) */
static void difference_equations_find_delays_and_orders(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {1.0, 0.5}, .dead_time = 0.8};
    struct record_test *t = record_simulate(&g, 1, 1, 1000, 0.2, (const size_t[]){5}, 0.0, 0.0, 1);
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    for (size_t k = 0; k < 1000; k++) { /* an operating point that is not 0 */
        t->u[k] += 5.0;
        t->y[k] -= 40.0;
    }
    if (apc_identify_arx(&m, &t->record, NULL, &why))
        fail_msg("%s", why.text);
    assert_int_equal(m->delay[0], 5); /* 0.8 s are four samples; what acts then is seen one later */
    assert_int_equal(m->na, 2);
    assert_int_equal(m->nb, 2);
    assert_near(gain_of(m->linear), 2.0, 1e-6);
    assert_near(m->linear->y0[0] + 2.0 * (5.0 - m->linear->u0[0]), -40.0, 1e-6);
    assert_int_equal(m->linear->nx_held, 4);
    assert_near(m->linear->D[0], 0.0, 0.0);
    apc_identified_destroy(m);
    free(t);
}

static void an_integrator_stands_still_at_its_operating_point(void **state)
{
    static const struct apc_transfer g = {.gain = 0.3, .integrating = true};
    struct record_test *t = record_simulate(&g, 1, 1, 1000, 0.2, (const size_t[]){5}, 0.0, 0.0, 1);
    struct apc_identified *m;
    (void)state;

    for (size_t k = 0; k < 1000; k++)
        t->u[k] += 5.0;
    assert_int_equal(apc_identify_arx(&m, &t->record, NULL, NULL), 0);
    assert_near(m->linear->u0[0], 5.0, 1e-6);
    apc_identified_destroy(m);
    free(t);
}

/*
 * Promise(identification/difference-equations): Difference equations and state space, of any number of
 *   inputs and outputs, predict what they have not seen; the hair dryer as well as others identify it.
 */
static void multivariable_models_predict_what_they_have_not_seen(void **state)
{
    struct record_test *t = of_two_by_two(0.02, 1);
    const struct apc_identify_arx_options fir = {.size = sizeof fir, .fir = true};
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    if (apc_identify_arx(&m, &t->record, NULL, &why))
        fail_msg("%s", why.text);
    predicts(m, 95.0);
    apc_identified_destroy(m);

    if (apc_identify_arx(&m, &t->record, &fir, &why))
        fail_msg("%s", why.text);
    assert_int_equal(m->na, 0);
    predicts(m, 93.0);
    apc_identified_destroy(m);

    if (apc_identify_subspace(&m, &t->record, NULL, &why))
        fail_msg("%s", why.text);
    predicts(m, 95.0);
    apc_identified_destroy(m);
    free(t);
}

/* Runs around points of their own, that have nothing to do with each other, make the models of one plant. */
/* Promise(identification/several-records-windows) */
static void several_runs_make_one_model(void **state)
{
    static const double du[] = {0.0, 30.0, -20.0};
    (void)state;

    for (int kind = 0; kind < 3; kind++) {
        struct record_test *t =
            record_simulate(two_by_two, 2, 2, 1500, 0.2, (const size_t[]){5, 7}, 0.02, 0.0, 1);
        const struct apc_identify_arx_options arx = {.size = sizeof arx, .fir = kind == 1};
        struct apc_identified *m;
        struct apc_validation v[2];
        struct apc_error why;

        for (uint64_t run = 1; run < 3; run++)
            record_append(
                t, record_simulate(two_by_two, 2, 2, 900, 0.2, (const size_t[]){5, 7}, 0.02, 0.0, run + 3),
                du[run], -20.0 * du[run]);
        if (kind < 2 ? apc_identify_arx(&m, &t->record, &arx, &why)
                     : apc_identify_subspace(&m, &t->record, NULL, &why))
            fail_msg("%s", why.text);
        predicts(m, 93.0);
        for (size_t run = 0; run < 3; run++) { /* each where its point is */
            const double u = m->u0[2 * run] - du[run], w = m->u0[2 * run + 1] - du[run];

            assert_near(m->y0[2 * run] + 20.0 * du[run], 10.0 * u - 4.0 * w, 0.5);
            assert_near(m->y0[2 * run + 1] + 20.0 * du[run], 2.0 * u + 3.0 * w, 0.5);
        }
        for (size_t k = 1500; k < 3300; k++) { /* brought to the point of the first */
            const size_t run = k < 2400 ? 1 : 2;

            for (size_t i = 0; i < 2; i++) {
                t->u[2 * k + i] += m->u0[i] - m->u0[2 * run + i];
                t->y[2 * k + i] += m->y0[i] - m->y0[2 * run + i];
            }
        }
        assert_int_equal(apc_validate(m->linear, m->K, &t->record, 1100, v, NULL, NULL), 0);
        assert_true(v[0].fit > 88.0 && v[1].fit > 88.0);
        apc_identified_destroy(m);
        free(t);
    }
}

static void missing_samples_bias_nothing(void **state)
{
    struct record_test *t = of_two_by_two(0.0, 1);
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    for (size_t k = 0; k < 3000; k++) {
        if (k / 20 % 5 == 0)
            t->y[2 * k] = (double)NAN;
    }
    if (apc_identify_arx(&m, &t->record, NULL, &why))
        fail_msg("%s", why.text);
    predicts(m, 98.0);
    apc_identified_destroy(m);
    free(t);
}

/* What the expectation of a model of a disturbed plant leaves is white, and nothing of the inputs is in it. */
/* Promise(identification/validation-tells-right) */
static void the_filter_of_a_state_space_model_leaves_white_errors(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {1.0}};
    struct record_test *t = record_simulate(&g, 1, 1, 4000, 0.2, (const size_t[]){5}, 0.1, 0.9, 1);
    const struct apc_identify_subspace_options options = {.size = sizeof options, .order = 2};
    struct apc_record first = t->record;
    struct apc_identified *m;
    struct apc_validation v;
    (void)state;
    first.n = 3000;

    assert_int_equal(apc_identify_subspace(&m, &first, &options, NULL), 0);
    assert_int_equal(apc_validate(m->linear, m->K, &t->record, 3000, &v, NULL, NULL), 0);
    assert_true(v.white > 0.01 && v.independent > 0.01 && v.ahead > v.fit + 1.0);
    assert_near(gain_of(m->linear), 2.0, 0.1);
    apc_identified_destroy(m);
    free(t);
}

/* ---- Validation -------------------------------------------------------------------------------------- */

/* Promise(identification/validation-tells-right): Validation tells a right model from a wrong one. */
static void validation_tells_a_right_model_from_a_wrong_one(void **state)
{
    static const struct apc_transfer g[] = {{.gain = 2.0, .tau = {1.0, 0.6}, .dead_time = 0.4},
                                            {.gain = 2.0, .tau = {1.5}, .dead_time = 0.4}};
    struct record_test *t = record_simulate(g, 1, 1, 1500, 0.2, (const size_t[]){9}, 0.05, 0.0, 1);
    (void)state;

    for (int i = 0; i < 2; i++) {
        struct apc_linear *model;
        struct apc_validation v;

        assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &g[i], NULL, NULL, 0.2, NULL), 0);
        assert_int_equal(apc_validate(model, NULL, &t->record, 500, &v, NULL, NULL), 0);
        assert_true(isnan(v.ahead));
        if (i == 0)
            assert_true(v.fit > 90.0 && v.white > 0.01 && v.independent > 0.01);
        else
            assert_true(v.independent < 1e-6);
        apc_linear_destroy(model);
    }
    free(t);
}

/* A controller makes the input of the error of the same sample: that is no answer of the plant. */
/* Promise(identification/validation-tells-right) */
static void feedback_in_the_same_row_is_no_dependence(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {4.0}, .dead_time = 1.0};
    struct record_test *t = record_simulate(&g, 1, 1, 1500, 0.5, (const size_t[]){9}, 0.0, 0.0, 1);
    double x[2][16] = {{0.0}};
    struct apc_linear *model;
    struct apc_random random;
    struct apc_validation v;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &g, NULL, NULL, 0.5, NULL), 0);
    assert_true(model->nx <= 16);
    apc_random_init(&random, 5, "feedback");
    for (size_t k = 0; k < t->record.n; k++) {
        apc_linear_output(model, x[k % 2], t->u + k, &t->y[k]);
        t->y[k] += 0.05 * apc_random_normal(&random);
        t->u[k] = 0.5 * ((k / 50 % 2 ? 1.0 : -1.0) - t->y[k]);
        apc_linear_next(model, x[k % 2], t->u + k, x[(k + 1) % 2]);
    }
    assert_int_equal(apc_validate(model, NULL, &t->record, 500, &v, NULL, NULL), 0);
    assert_true(v.white > 0.01 && v.independent > 0.01);
    apc_linear_destroy(model);
    free(t);
}

/* @p n samples of one input and one output from @p begin on. */
static struct apc_record part_of(const struct apc_record *r, size_t begin, size_t n)
{
    struct apc_record part = *r;

    part.u += begin;
    part.y += begin;
    part.n = n;
    return part;
}

/* What the inputs were before the record acts for as long as the dead time, and is found like the state. */
/* Promise(identification/validation-tells-right) */
static void what_came_before_the_record_is_found(void **state)
{
    static const struct apc_transfer g[] = {{.gain = 2.0, .tau = {3.0}, .dead_time = 6.3},
                                            {.gain = -1.0, .tau = {1.0}, .dead_time = 4.0}};
    struct record_test *t = record_simulate(g, 2, 1, 600, 0.2, (const size_t[]){60, 30}, 0.0, 0.0, 1);
    struct apc_linear *model;
    struct apc_validation v;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 2, 0, g, NULL, NULL, 0.2, NULL), 0);
    for (size_t from = 0; from < 40; from += 10) { /* the first row is the first move of the first input */
        struct apc_record late = t->record;

        late.u += 2 * 60;
        late.y += 60;
        late.n -= 60;
        assert_int_equal(apc_validate(model, NULL, &late, from, &v, NULL, NULL), 0);
        assert_true(v.fit > 99.99);
    }
    apc_linear_destroy(model);
    free(t);
}

/* So it is of a model with a K, whose past is the record's: where that begins the plant moved, and its inputs
 * were others. Of a K as good as 0, of noise of the sensor, the past of a slow plant is never forgotten. */
/* Promise(identification/validation-tells-right) */
static void a_model_with_a_gain_knows_nothing_of_what_came_before(void **state)
{
    static const struct apc_transfer late = {.gain = 2.0, .tau = {3.0}, .dead_time = 3.0},
                                     slow = {.gain = 2.0, .tau = {40.0}};
    struct record_test *t = record_simulate(&late, 1, 1, 600, 0.2, (const size_t[]){60}, 0.0, 0.0, 1),
                       *noisy = record_simulate(&slow, 1, 1, 1500, 0.2, (const size_t[]){120}, 0.05, 0.0, 1);
    struct apc_identified *model;
    struct apc_record part;
    struct apc_validation v;
    struct apc_error why;
    (void)state;

    if (apc_identify_arx(&model, &t->record,
                         &(struct apc_identify_arx_options){
                             .size = sizeof(struct apc_identify_arx_options), .na = 1, .nb = 1},
                         &why))
        fail_msg("%s", why.text);
    assert_true(model->linear->nx_held > 10);
    for (size_t from = 0; from < 15; from += 5) {
        part = part_of(&t->record, 60, 400); /* the first row is the move */
        assert_int_equal(apc_validate(model->linear, model->K, &part, from, &v, NULL, NULL), 0);
        assert_true(v.fit > 99.99);
    }
    apc_identified_destroy(model);

    if (apc_identify_subspace(&model, &noisy->record,
                              &(struct apc_identify_subspace_options){
                                  .size = sizeof(struct apc_identify_subspace_options), .order = 1},
                              &why))
        fail_msg("%s", why.text);
    for (size_t begin = 600; begin < 1000; begin += 70) {
        part = part_of(&noisy->record, begin, 400);
        assert_int_equal(apc_validate(model->linear, model->K, &part, 40, &v, NULL, NULL), 0);
        assert_true(v.fit > 75.0);
    }
    apc_identified_destroy(model);
    free(noisy);
    free(t);
}

/* Where the record begins is found, and in which units it is does not matter. */
static void validation_begins_anywhere_and_knows_no_units(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {3.0}}, wrong = {.gain = 2.0, .tau = {3.5}};
    struct record_test *t = record_simulate(&g, 1, 1, 1500, 0.2, (const size_t[]){9}, 0.0, 0.0, 1),
                       *noisy = record_simulate(&g, 1, 1, 1500, 0.2, (const size_t[]){9}, 0.05, 0.0, 1);
    struct apc_transfer scaled = wrong;
    struct apc_linear *model;
    struct apc_validation v, w;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &g, NULL, NULL, 0.2, NULL), 0);
    for (size_t begin = 300; begin < 330; begin += 7) { /* while the plant moves */
        struct apc_record late = t->record;

        late.u += begin;
        late.y += begin;
        late.n -= begin;
        assert_int_equal(apc_validate(model, NULL, &late, 0, &v, NULL, NULL), 0);
        assert_true(v.fit > 99.9);
    }
    apc_linear_destroy(model);
    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &wrong, NULL, NULL, 0.2, NULL), 0);
    assert_int_equal(apc_validate(model, NULL, &noisy->record, 500, &v, NULL, NULL), 0);
    apc_linear_destroy(model);
    for (size_t k = 0; k < 1500; k++)
        noisy->u[k] *= 1e-4;
    scaled.gain *= 1e4;
    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &scaled, NULL, NULL, 0.2, NULL), 0);
    assert_int_equal(apc_validate(model, NULL, &noisy->record, 500, &w, NULL, NULL), 0);
    assert_true(v.independent < 0.5);
    assert_near(w.independent, v.independent, 1e-6 * v.independent);
    assert_near(w.white, v.white, 1e-6 * v.white);
    assert_near(w.fit, v.fit, 1e-6);
    apc_linear_destroy(model);
    free(noisy);
    free(t);
}

static void a_variance_is_that_of_the_inverse(void **state)
{
    const double R[] = {2.0, 1.0, 0.0, 3.0}, singular[] = {2.0, 1.0, 0.0, 0.0};
    double g[] = {4.0, 5.0}, beyond[] = {4.0, 5.0}, within[] = {4.0, 2.0};
    (void)state;

    assert_near(apc_qr_variance(2, R, 2, g), 5.0, 1e-14); /* g' (R'R)^-1 g */
    assert_true(apc_qr_variance(2, singular, 2, beyond) == HUGE_VAL);
    assert_near(apc_qr_variance(2, singular, 2, within), 4.0, 1e-14);
}

static void of_a_plant_that_runs_away_there_is_no_state_space(void **state)
{
    enum { SAMPLES = 400 };
    static double u[SAMPLES], y[SAMPLES];
    const struct apc_record record = {
        .size = sizeof record, .Ts = 1.0, .n = SAMPLES, .nu = 1, .ny = 1, .u = u, .y = y};
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    for (size_t k = 0; k < SAMPLES; k++) {
        u[k] = k / 7 % 2 ? 1.0 : -1.0;
        if (k > 0)
            y[k] = 1.05 * y[k - 1] + u[k - 1];
    }
    assert_int_equal(apc_identify_subspace(&m, &record, NULL, &why), APC_ESOLVER);
    assert_null(m);
}

/* One input, one disturbance, two outputs. */
static void a_record_that_tells_nothing_is_refused_with_its_reason(void **state)
{
    enum { SAMPLES = 400 };
    static double u[2 * SAMPLES], y[2 * SAMPLES];
    static const struct {
        double *at; /* of these values all, or one */
        size_t from, step, count;
        double value;
        const char *reason;
    } of[] = {
        {u, 0, 2, SAMPLES, 3.0, "input 1 is 3 all the time"},
        {u, 1, 2, SAMPLES, 3.0, "input 2 is 3 all the time"},
        {y, 0, 2, SAMPLES, 5.0, "output 1 is 5 all the time"},
        {y, 1, 2, SAMPLES, 5.0, "output 2 is 5 all the time"},
        {u, 0, 1, 1, (double)NAN, "input 1 is no number at sample 1:"},
        {u, 9, 1, 1, (double)NAN, "input 2 is no number at sample 5:"},
        {u, 2 * SAMPLES - 1, 1, 1, (double)INFINITY, "input 2 is no number at sample 400:"},
        {y, 4, 1, 1, 1e301, "output 1 is 1e+301 at sample 3:"},
        {y, 2 * SAMPLES - 1, 1, 1, -1e301, "output 2 is -1e+301 at sample 400:"},
        {y, 1, 2, SAMPLES - 20, (double)NAN, "output 2 has 20 good samples of 400: a tenth of them"},
    };
    const struct apc_record good = {
        .size = sizeof good, .Ts = 1.0, .n = SAMPLES, .nu = 1, .nd = 1, .ny = 2, .u = u, .y = y};
    struct apc_record shape[] = {good, good, good, good, good, good, good};
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        for (size_t k = 0; k < 2 * (size_t)SAMPLES; k++) {
            u[k] = sin(0.37 * (double)k * (double)(1 + k % 2));
            y[k] = k < 2 ? 0.0 : 0.5 * y[k - 2] + u[k - 2];
        }
        for (size_t k = 0; k < of[i].count; k++)
            of[i].at[of[i].from + k * of[i].step] = of[i].value;
        assert_int_equal(apc_identify_arx(&m, &good, NULL, &why), APC_EINVAL);
        assert_has(why.text, of[i].reason);
        assert_null(m);
    }
    shape[0].u = NULL;
    shape[1].y = NULL;
    shape[2].nu = shape[2].nd = 0;
    shape[3].ny = 0;
    shape[4].nu = 1000;
    shape[5].ny = 1001;
    shape[6].n = 20;
    for (size_t i = 0; i < sizeof shape / sizeof *shape; i++) {
        assert_int_equal(apc_identify_arx(&m, &shape[i], NULL, &why), APC_EINVAL);
        assert_has(why.text,
                   i < 6 ? "it must have inputs and measurements, 1000 of each at most" : "20 samples; ");
    }
}

static void what_does_not_fit_together_is_refused(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {1.0}};
    struct record_test *t = record_simulate(&g, 1, 1, 500, 0.2, (const size_t[]){9}, 0.05, 0.0, 1);
    const struct apc_identify_arx_options both = {.size = sizeof both, .fir = true, .na = 2},
                                          long_one = {.size = sizeof long_one, .nb = 200};
    struct apc_identify_subspace_options rows = {.size = sizeof rows, .rows = 150};
    struct apc_linear *model;
    struct apc_validation v;
    struct apc_identified *m;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_linear_from_transfer(&model, 1, 1, 0, &g, NULL, NULL, 0.1, NULL), 0);
    assert_int_equal(apc_validate(model, NULL, &t->record, 0, &v, NULL, &why), APC_EINVAL);
    assert_has(why.text, "period");
    model->Ts = 0.2;
    assert_int_equal(apc_validate(model, NULL, &t->record, 490, &v, NULL, &why), APC_EINVAL);
    assert_has(why.text, "10 samples of output 1");
    assert_int_equal(apc_identify_arx(&m, &t->record, &both, &why), APC_EINVAL);
    assert_null(m);
    assert_int_equal(apc_identify_arx(&m, &t->record, &long_one, &why), APC_EINVAL);
    assert_int_equal(apc_identify_subspace(&m, &t->record, &rows, &why), APC_EINVAL);
    rows.order = 1;
    rows.rows = 84; /* as many unknowns as samples at most: 6 of a row here */
    assert_int_equal(apc_identify_subspace(&m, &t->record, &rows, &why), APC_EINVAL);
    rows.rows = 83;
    if (apc_identify_subspace(&m, &t->record, &rows, &why) < 0)
        fail_msg("%s", why.text);
    apc_identified_destroy(m);
    for (size_t k = 0; k < 500; k += 3)
        t->y[k] = (double)NAN;
    assert_int_equal(apc_identify_arx(&m, &t->record, NULL, &why), APC_EINVAL);
    assert_has(why.text, "have no gap");
    assert_int_equal(apc_identify_subspace(&m, &t->record, NULL, &why), APC_EINVAL);
    assert_has(why.text, "have no gap");
    apc_linear_destroy(model);
    free(t);
}

static void excitation_counts_frequencies(void **state)
{
    struct record_test *t = of_two_by_two(0.0, 1);
    (void)state;

    t->record.n = 1000;
    for (size_t k = 0; k < 1000; k++)
        t->u[2 * k] = sin(0.7 * (double)k) + sin(1.9 * (double)k);
    assert_int_equal(apc_record_excitation(&t->record, 0), 4);
    assert_int_equal(apc_record_excitation(&t->record, 1), 50);
    free(t);
}

/* ---- Decompositions and probabilities ----------------------------------------------------------------- */

static void singular_values_put_the_matrix_together(void **state)
{
    enum { M = 7, N = 5 };
    double A[M * N], U[M * N + M] = {0}, s[N + 1], V[N * N + 1];
    struct apc_random random;
    (void)state;

    apc_random_init(&random, 1, "svd");
    for (size_t i = 0; i < M * N; i++)
        A[i] = U[i] =
            i / M == 3 ? A[i - M] : apc_random_normal(&random); /* column 3 is column 2: of rank 4 */
    U[M * N + 1] = 1.0;
    U[M * N] = s[N] = V[N * N] = 7.0; /* what lies behind is left alone */
    apc_svd(M, N, U, s, V);
    assert_true(U[M * N] == 7.0 && s[N] == 7.0 && V[N * N] == 7.0);
    assert_near(s[N - 1], 0.0, 1e-14);
    for (size_t j = 0; j < N; j++) {
        assert_true(j == 0 || s[j] <= s[j - 1]);
        for (size_t k = 0; k < N; k++) {
            assert_near(apc_matrix_dot(V + j * N, V + k * N, N), j == k, 1e-13);
            if (j < 4 && k < 4)
                assert_near(apc_matrix_dot(U + j * M, U + k * M, M), j == k, 1e-13);
        }
        for (size_t i = 0; i < M; i++) {
            double sum = 0.0;

            for (size_t k = 0; k < N; k++)
                sum += U[k * M + i] * s[k] * V[k * N + j];
            assert_near(sum, A[j * M + i], 1e-13);
        }
    }
}

/* Rows that come one by one make the triangle that they make together. */
static void a_triangle_is_that_of_all_rows(void **state)
{
    enum { ROWS = 1000, WIDTH = 4 };
    struct apc_triangle t;
    double *Q = calloc(ROWS * WIDTH, sizeof *Q), R[WIDTH * WIDTH];
    struct apc_random random;
    (void)state;

    assert_non_null(Q);
    assert_int_equal(apc_triangle_open(&t, WIDTH), 0);
    apc_random_init(&random, 1, "rows");
    for (size_t k = 0; k < ROWS; k++) {
        double row[WIDTH];

        for (size_t j = 0; j < WIDTH; j++)
            Q[j * ROWS + k] = row[j] = j == 2 ? row[0] - row[1] : apc_random_normal(&random);
        apc_triangle_add(&t, row);
    }
    apc_triangle_end(&t);
    apc_qr_extend(ROWS, 0, WIDTH, Q, R, WIDTH);
    for (size_t i = 0; i < WIDTH; i++) {
        for (size_t j = i; j < WIDTH; j++)
            assert_near(t.R[i * WIDTH + j], R[i * WIDTH + j], 1e-9);
    }
    assert_near(R[2 * WIDTH + 2], 0.0, 0.0);
    assert_int_equal(t.n, ROWS);
    apc_triangle_close(&t);
    free(Q);
}

/* Abramowitz and Stegun, table 26.8. */
static void probabilities_are_those_of_the_tables(void **state)
{
    (void)state;

    assert_near(apc_chi2_above(3.84146, 1.0), 0.05, 1e-6);
    assert_near(apc_chi2_above(18.3070, 10.0), 0.05, 1e-6);
    assert_near(apc_chi2_above(29.1413, 14.0), 0.01, 1e-6);
    for (int k = 2; k <= 40; k += 2) { /* where it is that of fewer than k / 2 events of x / 2 */
        for (double x = 0.25; x < 80.0; x *= 1.7) {
            double sum = 0.0, term = exp(-x / 2.0);

            for (int i = 0; i < k / 2; i++) {
                sum += term;
                term *= x / 2.0 / (i + 1);
            }
            assert_near(apc_chi2_above(x, k), sum, 1e-12);
        }
    }
    assert_near(apc_chi2_above(1.0, 1.0), 0.31731050786, 1e-10);
    assert_near(apc_chi2_above(0.0, 3.0), 1.0, 0.0);
    assert_near(apc_chi2_above(2000.0, 15.0), 0.0, 1e-100);
}

static void an_autoregression_is_found_with_its_order(void **state)
{
    double e[4000], a[8];
    struct apc_random random;
    (void)state;

    apc_random_init(&random, 2, "noise");
    for (size_t k = 0; k < 4000; k++)
        e[k] = k < 2 ? 0.0 : 1.2 * e[k - 1] - 0.5 * e[k - 2] + apc_random_normal(&random);
    for (size_t k = 100; k < 4000; k += 50)
        e[k] = (double)NAN;
    assert_int_equal(apc_autoregression(e, 4000, 8, a), 2);
    assert_near(a[0], 1.2, 0.05);
    assert_near(a[1], -0.5, 0.05);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_hair_dryer_is_predicted),
        cmocka_unit_test(state_space_of_the_hair_dryer_is_octaves),
        cmocka_unit_test(difference_equations_find_delays_and_orders),
        cmocka_unit_test(an_integrator_stands_still_at_its_operating_point),
        cmocka_unit_test(multivariable_models_predict_what_they_have_not_seen),
        cmocka_unit_test(several_runs_make_one_model),
        cmocka_unit_test(missing_samples_bias_nothing),
        cmocka_unit_test(the_filter_of_a_state_space_model_leaves_white_errors),
        cmocka_unit_test(validation_tells_a_right_model_from_a_wrong_one),
        cmocka_unit_test(validation_begins_anywhere_and_knows_no_units),
        cmocka_unit_test(feedback_in_the_same_row_is_no_dependence),
        cmocka_unit_test(what_came_before_the_record_is_found),
        cmocka_unit_test(a_model_with_a_gain_knows_nothing_of_what_came_before),
        cmocka_unit_test(a_variance_is_that_of_the_inverse),
        cmocka_unit_test(of_a_plant_that_runs_away_there_is_no_state_space),
        cmocka_unit_test(a_record_that_tells_nothing_is_refused_with_its_reason),
        cmocka_unit_test(what_does_not_fit_together_is_refused),
        cmocka_unit_test(excitation_counts_frequencies),
        cmocka_unit_test(singular_values_put_the_matrix_together),
        cmocka_unit_test(a_triangle_is_that_of_all_rows),
        cmocka_unit_test(probabilities_are_those_of_the_tables),
        cmocka_unit_test(an_autoregression_is_found_with_its_order),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
