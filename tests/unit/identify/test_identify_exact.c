/* SPDX-License-Identifier: BSD-3-Clause */
/* What must hold of identification to the last digits: of records without noise the plant is found, in
 * whatever units they are; and a validation is what its words say, written down here a second time.
 */
#include "apcidentify.h"
#include "check.h"
#include "identify/identify_internal.h"
#include "records.h"

#include <stdlib.h>
#include <string.h>

enum { STATES = 3, INPUTS = 2, OUTPUTS = 2, SAMPLES = 600 };

/* A plant of three states, two inputs of which one is a disturbance, two outputs; unstable is none of it. */
static const double A[] = {0.8, 0.1, 0.0, -0.2, 0.7, 0.1, 0.0, 0.3, 0.5};
static const double B[] = {0.5, 0.0, 0.1, -0.4, 0.0, 0.6};
static const double C[] = {1.0, 0.0, 0.5, 0.0, 2.0, -1.0};
static const double direct[] = {0.3, 0.0, 0.0, -0.7}, none[INPUTS * OUTPUTS];
static const double at_u[] = {4.0, -2.0}, at_y[] = {30.0, -7.0};

static double u[SAMPLES * INPUTS], y[SAMPLES * OUTPUTS], e[SAMPLES * OUTPUTS];

static struct apc_record record(void)
{
    return (struct apc_record){.size = sizeof(struct apc_record),
                               .Ts = 0.5,
                               .n = SAMPLES,
                               .nu = 1,
                               .nd = 1,
                               .ny = 2,
                               .u = u,
                               .y = y};
}

/* From a state that is not rest; @p K: errors of that size disturb the states as well. */
static struct apc_record simulate(const double *D, double noise, const double *K)
{
    double x[STATES] = {1.0, -2.0, 0.5}, next[STATES], level[INPUTS] = {0};
    struct apc_random random;

    apc_random_init(&random, 3, "exact");
    for (size_t k = 0; k < SAMPLES; k++) {
        for (size_t j = 0; j < INPUTS; j++) {
            if (k % (3 + 2 * j) == 0)
                level[j] = apc_random_normal(&random);
            u[k * INPUTS + j] = at_u[j] + level[j];
        }
        for (size_t i = 0; i < OUTPUTS; i++) {
            e[k * OUTPUTS + i] = noise * (double)(i + 1) * apc_random_normal(&random);
            y[k * OUTPUTS + i] = at_y[i] + e[k * OUTPUTS + i];
            for (size_t q = 0; q < STATES; q++)
                y[k * OUTPUTS + i] += C[i * STATES + q] * x[q];
            for (size_t j = 0; j < INPUTS; j++)
                y[k * OUTPUTS + i] += D[i * INPUTS + j] * level[j];
        }
        for (size_t q = 0; q < STATES; q++) {
            next[q] = 0.0;
            for (size_t p = 0; p < STATES; p++)
                next[q] += A[q * STATES + p] * x[p];
            for (size_t j = 0; j < INPUTS; j++)
                next[q] += B[q * INPUTS + j] * level[j];
            for (size_t i = 0; i < OUTPUTS && K; i++)
                next[q] += K[q * OUTPUTS + i] * e[k * OUTPUTS + i];
        }
        memcpy(x, next, sizeof x);
    }
    return record();
}

/* The plant itself, at rest at its operating point. */
static struct apc_linear *plant(const double *D)
{
    const struct apc_linear_continuous of = {.size = sizeof of,
                                             .nx = STATES,
                                             .nu = 1,
                                             .nd = 1,
                                             .ny = OUTPUTS,
                                             .A = A,
                                             .B = B,
                                             .C = C,
                                             .D = D,
                                             .u0 = at_u,
                                             .y0 = at_y};
    struct apc_linear *model;

    assert_int_equal(apc_linear_from_sampled(&model, &of, 0.5, NULL), 0);
    return model;
}

/* What a unit of input j does to output i, @p ago samples later. */
static double pulse(const struct apc_linear *m, size_t i, size_t j, size_t ago)
{
    const size_t inputs = m->nu + m->nd;
    double x[200] = {0}, next[200], sum = 0.0;

    assert_true(m->nx <= 200);
    if (ago == 0)
        return m->D[i * inputs + j];
    for (size_t q = 0; q < m->nx; q++)
        x[q] = m->B[q * inputs + j];
    for (size_t k = 1; k < ago; k++) {
        for (size_t q = 0; q < m->nx; q++) {
            next[q] = 0.0;
            for (size_t p = 0; p < m->nx; p++)
                next[q] += m->A[q * m->nx + p] * x[p];
        }
        memcpy(x, next, sizeof next);
    }
    for (size_t q = 0; q < m->nx; q++)
        sum += m->C[i * m->nx + q] * x[q];
    return sum;
}

static void assert_same_plant(const struct apc_linear *m, const double *D, double tolerance)
{
    struct apc_linear *truth = plant(D);

    for (size_t i = 0; i < OUTPUTS; i++) {
        for (size_t j = 0; j < INPUTS; j++) {
            for (size_t ago = 0; ago < 25; ago++)
                assert_near(pulse(m, i, j, ago), pulse(truth, i, j, ago), tolerance);
        }
    }
    apc_linear_destroy(truth);
}

/* ---- Without noise ------------------------------------------------------------------------------------ */

static void of_a_record_without_noise_each_method_finds_the_plant(void **state)
{
    struct apc_error why;
    (void)state;

    for (int at_once = 0; at_once < 2; at_once++) {
        const double *D = at_once ? direct : none;
        const struct apc_record r = simulate(D, 0.0, NULL);
        const struct apc_identify_arx_options arx = {
            .size = sizeof arx, .na = 3, .nb = 4, .delay_max = 1, .direct = at_once};
        const struct apc_identify_arx_options fir = {
            .size = sizeof fir, .fir = true, .nb = 60, .direct = at_once};
        const struct apc_identify_subspace_options subspace = {
            .size = sizeof subspace, .order = 4, .direct = at_once};
        struct apc_identified *m;
        struct apc_validation v[OUTPUTS];

        if (apc_identify_arx(&m, &r, &arx, &why) < 0)
            fail_msg("%s", why.text);
        assert_same_plant(m->linear, D, 1e-7);
        assert_int_equal(apc_validate(m->linear, m->K, &r, 100, v, NULL, NULL), 0);
        assert_true(v[0].ahead > 99.9999 && v[1].ahead > 99.9999);
        apc_identified_destroy(m);

        if (apc_identify_arx(&m, &r, &fir, &why) < 0)
            fail_msg("%s", why.text);
        assert_same_plant(m->linear, D, 0.02); /* a response of that length is nearly all of it */
        assert_int_equal(m->na, 0);
        assert_int_equal(m->linear->nx_plant, 0);
        apc_identified_destroy(m);

        if (apc_identify_subspace(&m, &r, &subspace, &why) < 0)
            fail_msg("%s", why.text);
        assert_same_plant(m->linear, D, 1e-7);
        assert_int_equal(apc_validate(m->linear, NULL, &r, 100, v, NULL, NULL), 0);
        assert_true(v[0].fit > 99.9999 && v[1].fit > 99.9999);
        apc_identified_destroy(m);
    }
}

/* Three, and one more for an operating point that is not the mean of the record. */
static void the_order_is_found(void **state)
{
    const struct apc_record r = simulate(none, 0.0, NULL);
    const struct apc_identify_subspace_options by_rows = {.size = sizeof by_rows, .rows = 6};
    struct apc_identified *m;
    (void)state;

    assert_int_equal(apc_identify_subspace(&m, &r, NULL, NULL), 0);
    assert_int_equal(m->linear->nx, 4);
    assert_same_plant(m->linear, none, 1e-6);
    apc_identified_destroy(m);
    assert_int_equal(apc_identify_subspace(&m, &r, &by_rows, NULL), 0);
    assert_int_equal(m->linear->nx, 4);
    assert_same_plant(m->linear, none, 1e-6);
    apc_identified_destroy(m);
}

static void deviations_need_no_operating_point(void **state)
{
    const struct apc_identify_subspace_options options = {
        .size = sizeof options, .order = 3, .direct = true, .deviations = true};
    const struct apc_record r = simulate(direct, 0.0, NULL);
    struct apc_identified *m;
    (void)state;

    for (size_t k = 0; k < 2 * (size_t)SAMPLES; k++) {
        u[k] -= at_u[k % 2];
        y[k] -= at_y[k % 2];
    }
    assert_int_equal(apc_identify_subspace(&m, &r, &options, NULL), 0);
    assert_same_plant(m->linear, direct, 1e-9);
    for (size_t i = 0; i < 2; i++)
        assert_true(m->linear->u0[i] == 0.0 && m->linear->y0[i] == 0.0);
    apc_identified_destroy(m);
}

/* A second lag that is asked for is there, though the plant has none. */
static void as_many_lags_as_are_asked_for(void **state)
{
    static const struct apc_transfer of = {.gain = 2.0, .tau = {3.0}, .dead_time = 1.0};
    struct record_test *t = record_simulate(&of, 1, 1, 300, 0.5, (const size_t[]){13}, 0.05, 0.0, 2);
    struct apc_transfer g, error;
    double mean[2];
    (void)state;

    for (unsigned order = 1; order <= 2; order++) {
        const struct apc_identify_transfer_options options = {
            .size = sizeof options, .order = order, .dead_time_max = 5.0, .integrating = APC_INTEGRATING_NO};

        assert_int_equal(apc_identify_transfer(&t->record, &options, &g, &error, mean, mean + 1, NULL, NULL),
                         0);
        assert_true(g.tau[0] > 0.0 && (g.tau[1] > 0.0) == (order == 2) && g.tau[0] >= g.tau[1]);
        assert_near(g.tau[0] + g.tau[1] + g.dead_time, 4.0, 0.5);
    }
    free(t);
}

/* ---- Of a disturbed plant -------------------------------------------------------------------- */

static void what_disturbs_the_plant_is_told(void **state)
{
    static const double K[] = {0.4, 0.0, 0.0, 0.1, 0.1, 0.0};
    const struct apc_record r = simulate(none, 0.05, K);
    const struct apc_identify_subspace_options options = {.size = sizeof options, .order = 3, .rows = 8};
    const struct apc_identify_arx_options lags = {.size = sizeof lags, .na = 4, .nb = 4, .delay_max = 1};
    struct apc_identified *m;
    struct apc_validation v[OUTPUTS];
    (void)state;

    for (int method = 0; method < 2; method++) {
        if (method == 0)
            assert_int_equal(apc_identify_subspace(&m, &r, &options, NULL), 0);
        else
            assert_int_equal(apc_identify_arx(&m, &r, &lags, NULL), 0);
        assert_near(m->covariance[0], 0.0025, 0.0006); /* of the errors a sample ahead */
        assert_near(m->covariance[3], 0.01, 0.0024);
        assert_near(m->covariance[1], 0.0, 0.0006);
        assert_near(m->covariance[1], m->covariance[2], 1e-15);
        assert_int_equal(apc_validate(m->linear, m->K, &r, 50, v, NULL, NULL), 0);
        assert_true(v[0].ahead > v[0].fit && v[1].ahead > v[1].fit && v[0].white > 0.001);
        assert_true(method == 1 || v[1].white > 0.001);
        apc_identified_destroy(m);
    }
}

/* ---- Units
 * ------------------------------------------------------------------------------------------------- */

static void units_and_operating_points_are_no_matter(void **state)
{
    static const double K[] = {0.4, 0.0, 0.0, 0.1, 0.1, 0.0}, of_u[] = {1024.0, 0.125},
                        of_y[] = {0.0625, 4096.0};
    struct apc_identified *m[2][2];
    (void)state;

    for (int scaled = 0; scaled < 2; scaled++) {
        const struct apc_record r = simulate(none, 0.05, K);

        for (size_t k = 0; k < SAMPLES * 2 && scaled; k++) {
            u[k] *= of_u[k % 2];
            y[k] *= of_y[k % 2];
        }
        for (size_t k = 50; k < SAMPLES; k += 100)
            y[2 * k] = (double)NAN;
        assert_int_equal(apc_identify_subspace(&m[0][scaled], &r, NULL, NULL), 0);
        assert_int_equal(apc_identify_arx(&m[1][scaled], &r, NULL, NULL), 0);
    }
    for (int method = 0; method < 2; method++) {
        const struct apc_identified *a = m[method][0], *b = m[method][1];

        assert_int_equal(a->linear->nx, b->linear->nx);
        assert_true(a->na == b->na && a->nb == b->nb);
        for (size_t i = 0; i < 2; i++) {
            for (size_t j = 0; j < 2; j++) {
                const double by = of_y[i] / of_u[j];

                assert_int_equal(a->delay[2 * i + j], b->delay[2 * i + j]);
                for (size_t ago = 0; ago < 10; ago++)
                    assert_near(pulse(b->linear, i, j, ago), by * pulse(a->linear, i, j, ago), 1e-6 * by);
                assert_near(b->covariance[2 * i + j], of_y[i] * of_y[j] * a->covariance[2 * i + j],
                            1e-6 * of_y[i] * of_y[j]);
            }
            assert_near(b->linear->u0[i], of_u[i] * a->linear->u0[i], 1e-6 * of_u[i]);
            assert_near(b->linear->y0[i], of_y[i] * a->linear->y0[i], 1e-6 * of_y[i]);
        }
        apc_identified_destroy(m[method][0]);
        apc_identified_destroy(m[method][1]);
    }
}

/* ---- Validation
 * --------------------------------------------------------------------------------------------- */

/* The plant's outputs from state @p begun on, with what K makes of the errors of the first @p corrected samples. */
static void run_plant(const double *K, size_t corrected, const double *begun, double *out)
{
    double x[STATES], next[STATES];

    memcpy(x, begun, sizeof x);
    for (size_t k = 0; k < SAMPLES; k++) {
        for (size_t i = 0; i < OUTPUTS; i++) {
            out[k * OUTPUTS + i] = at_y[i];
            for (size_t q = 0; q < STATES; q++)
                out[k * OUTPUTS + i] += C[i * STATES + q] * x[q];
            for (size_t j = 0; j < INPUTS; j++)
                out[k * OUTPUTS + i] += direct[i * INPUTS + j] * (u[k * INPUTS + j] - at_u[j]);
        }
        for (size_t q = 0; q < STATES; q++) {
            next[q] = 0.0;
            for (size_t p = 0; p < STATES; p++)
                next[q] += A[q * STATES + p] * x[p];
            for (size_t j = 0; j < INPUTS; j++)
                next[q] += B[q * INPUTS + j] * (u[k * INPUTS + j] - at_u[j]);
            for (size_t i = 0; i < OUTPUTS && k < corrected; i++) {
                const double error = y[k * OUTPUTS + i] - out[k * OUTPUTS + i];

                next[q] += isfinite(error) ? K[q * OUTPUTS + i] * error : 0.0;
            }
        }
        memcpy(x, next, sizeof x);
    }
}

static double fit(const double *out, size_t i, size_t from)
{
    double mean = 0.0, n = 0.0, error = 0.0, all = 0.0;

    for (size_t k = from; k < SAMPLES; k++) {
        if (isfinite(y[k * OUTPUTS + i])) {
            mean += y[k * OUTPUTS + i];
            n += 1.0;
        }
    }
    for (size_t k = from; k < SAMPLES; k++) {
        if (isfinite(y[k * OUTPUTS + i])) {
            error += pow(y[k * OUTPUTS + i] - out[k * OUTPUTS + i], 2);
            all += pow(y[k * OUTPUTS + i] - mean / n, 2);
        }
    }
    return 100.0 * (1.0 - sqrt(error / all));
}

/* The deviation of output @p i from its mean, from sample @p from on. */
static double deviation(size_t i, size_t from)
{
    double mean = 0.0, n = 0.0, all = 0.0;

    for (size_t k = from; k < SAMPLES; k++) {
        mean += isfinite(y[k * OUTPUTS + i]) ? y[k * OUTPUTS + i] : 0.0;
        n += isfinite(y[k * OUTPUTS + i]);
    }
    for (size_t k = from; k < SAMPLES; k++)
        all += isfinite(y[k * OUTPUTS + i]) ? pow(y[k * OUTPUTS + i] - mean / n, 2) : 0.0;
    return sqrt(all / n);
}

/* The state at the first sample whose errors a sample ahead are least: they are linear in it. */
static void best_start(const double *K, size_t from, double *x)
{
    static double out[STATES + 1][SAMPLES * OUTPUTS];
    double M[STATES][STATES + 1] = {{0}}, size[OUTPUTS];

    for (size_t i = 0; i < OUTPUTS; i++)
        size[i] = deviation(i, from);
    for (size_t q = 0; q <= STATES; q++) {
        double unit[STATES] = {0};
        if (q < STATES)
            unit[q] = 1.0;
        run_plant(K, SAMPLES, unit, out[q]);
    }
    for (size_t k = 0; k < SAMPLES * OUTPUTS; k++) {
        const double weight = 1.0 / size[k % OUTPUTS], base = out[STATES][k];
        for (size_t p = 0; p < STATES && isfinite(y[k]); p++) {
            for (size_t q = 0; q <= STATES; q++)
                M[p][q] +=
                    weight * weight * (out[p][k] - base) * (q < STATES ? out[q][k] - base : y[k] - base);
        }
    }
    for (size_t p = 0; p < STATES; p++) { /* Gauss and Jordan; M is positive definite */
        for (size_t r = 0; r < STATES; r++) {
            const double share = M[r][p] / M[p][p];
            for (size_t q = p; q <= STATES && r != p; q++)
                M[r][q] -= share * M[p][q];
        }
    }
    for (size_t p = 0; p < STATES; p++)
        x[p] = M[p][STATES] / M[p][p];
}

static void a_validation_is_what_its_words_say(void **state)
{
    static const double K[] = {0.4, 0.0, 0.0, 0.1, 0.1, 0.05};
    static double free_run[SAMPLES * OUTPUTS], ahead[SAMPLES * OUTPUTS], run[SAMPLES * OUTPUTS];
    const struct apc_record r = simulate(direct, 0.3, K);
    struct apc_linear *m = plant(direct);
    struct apc_validation v[OUTPUTS];
    (void)state;

    for (size_t k = 0; k < SAMPLES; k += 37) /* some were not measured */
        y[k * OUTPUTS + k % 2] = (double)NAN;
    for (size_t from = 0; from < 300; from += 130) {
        double begun[STATES];
        best_start(K, from, begun);
        run_plant(K, from, begun, free_run);
        run_plant(K, SAMPLES, begun, ahead);
        assert_int_equal(apc_validate(m, K, &r, from, v, run, NULL), 0);
        for (size_t i = 0; i < OUTPUTS; i++) {
            assert_near(v[i].fit, fit(free_run, i, from), 1e-8);
            assert_near(v[i].ahead, fit(ahead, i, from), 1e-8);
        }
        for (size_t k = 0; k < SAMPLES * OUTPUTS; k++) {
            if (k / OUTPUTS < from)
                assert_true(isnan(run[k]));
            else if (isfinite(y[k]))
                assert_near(run[k], free_run[k], 1e-9);
        }
    }
    apc_linear_destroy(m);
}

/* Without a filter the state where it begins is the one with which the run goes best. */
static void where_a_free_run_begins_is_found(void **state)
{
    static double run[SAMPLES * OUTPUTS], true_y[SAMPLES * OUTPUTS];
    const struct apc_record r = simulate(direct, 0.0, NULL);
    struct apc_linear *m = plant(direct);
    struct apc_validation v[OUTPUTS];
    (void)state;

    memcpy(true_y, y, sizeof true_y);
    for (size_t k = 1; k < SAMPLES; k += 3)
        y[k * OUTPUTS + k % 2] = (double)NAN;
    for (size_t from = 0; from < 3; from++) {
        assert_int_equal(apc_validate(m, NULL, &r, from, v, run, NULL), 0);
        assert_true(v[0].fit > 99.99999 && v[1].fit > 99.99999 && isnan(v[0].ahead) && isnan(v[1].ahead));
        for (size_t k = from * OUTPUTS; k < SAMPLES * OUTPUTS; k++) {
            if (isfinite(y[k]))
                assert_near(run[k], true_y[k], 1e-7);
        }
    }
    apc_linear_destroy(m);
}

static void what_is_validated_must_go_with_the_record(void **state)
{
    struct apc_record r = simulate(direct, 0.0, NULL);
    struct apc_linear *m = plant(direct);
    struct apc_validation v[OUTPUTS];
    struct apc_error why;
    (void)state;

    r.nu = 2;
    r.nd = 0;
    assert_int_equal(apc_validate(m, NULL, &r, 0, v, NULL, &why), APC_EINVAL);
    assert_string_equal(
        why.text, "validate: the model has 1 inputs, 1 disturbances and 2 outputs, the record 2, 0 and 2");
    r = record();
    r.ny = 1;
    assert_int_equal(apc_validate(m, NULL, &r, 0, v, NULL, &why), APC_EINVAL);
    assert_string_equal(
        why.text, "validate: the model has 1 inputs, 1 disturbances and 2 outputs, the record 1, 1 and 1");
    r = record();
    r.Ts = 0.50001;
    assert_int_equal(apc_validate(m, NULL, &r, 0, v, NULL, &why), APC_EINVAL);
    assert_string_equal(why.text, "validate: the model has a period of 0.5 s, the record one of 0.50001 s");
    r = record();
    assert_int_equal(apc_validate(m, NULL, &r, SAMPLES - 20, v, NULL, &why), 0);
    assert_int_equal(apc_validate(m, NULL, &r, SAMPLES - 19, v, NULL, &why), APC_EINVAL);
    assert_string_equal(why.text, "validate: 19 samples of output 1 to validate on; 20 are the least");
    y[SAMPLES * OUTPUTS - 1] = (double)NAN;
    assert_int_equal(apc_validate(m, NULL, &r, SAMPLES - 20, v, NULL, &why), APC_EINVAL);
    assert_string_equal(why.text, "validate: 19 samples of output 2 to validate on; 20 are the least");
    apc_linear_destroy(m);
}

/* Ljung and Box's number of 15 lags, and how improbable it is. */
static void how_white_errors_are_is_as_published(void **state)
{
    static double run[SAMPLES * OUTPUTS];
    struct apc_record r = simulate(direct, 0.3, NULL);
    struct apc_linear *m = plant(direct);
    struct apc_validation v[OUTPUTS];
    (void)state;

    assert_int_equal(apc_validate(m, NULL, &r, 100, v, run, NULL), 0);
    for (size_t i = 0; i < OUTPUTS; i++) {
        const double n = SAMPLES - 100;
        double all = 0.0, sum = 0.0;

        for (size_t k = 100; k < SAMPLES; k++)
            all += pow(y[k * OUTPUTS + i] - run[k * OUTPUTS + i], 2);
        for (size_t lag = 1; lag <= 15; lag++) {
            double product = 0.0;

            for (size_t k = 100 + lag; k < SAMPLES; k++)
                product += (y[k * OUTPUTS + i] - run[k * OUTPUTS + i]) *
                           (y[(k - lag) * OUTPUTS + i] - run[(k - lag) * OUTPUTS + i]);
            sum += pow(product / all, 2) / (n - (double)lag);
        }
        assert_near(v[i].white, apc_chi2_above(n * (n + 2.0) * sum, 15.0), 1e-9);
        assert_true(v[i].independent > 0.01);
    }
    apc_linear_destroy(m);
}

static void of_white_errors_nothing_is_expected(void **state)
{
    double white[2000], a[8];
    struct apc_random random;
    (void)state;

    apc_random_init(&random, 5, "white");
    for (size_t k = 0; k < 2000; k++)
        white[k] = apc_random_normal(&random);
    assert_int_equal(apc_autoregression(white, 2000, 8, a), 0);
}

static void the_spectral_radius_is_that_of_the_largest_eigenvalue(void **state)
{
    static const struct {
        size_t n;
        double A[9], radius;
    } of[] = {
        {1, {-0.7}, 0.7},
        {2, {0.5, 3.0, 0.0, -0.9}, 0.9},
        {2, {0.6, 0.8, -0.8, 0.6}, 1.0}, /* turns */
        {2, {0.3, 0.4, -0.4, 0.3}, 0.5}, /* turns, and dies out */
        {3, {2.0, 5.0, 7.0, 0.0, 1.0, 9.0, 0.0, 0.0, 0.1}, 2.0},
        {3, {0.0, 5.0, 7.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0}, 0.0}, /* nothing of it is left after three steps */
        {2, {0.0, 0.0, 0.0, 0.0}, 0.0}};
    double work[18];
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_near(apc_spectral_radius(of[i].n, of[i].A, work), of[i].radius, 3e-3 * of[i].radius);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_spectral_radius_is_that_of_the_largest_eigenvalue),
        cmocka_unit_test(of_a_record_without_noise_each_method_finds_the_plant),
        cmocka_unit_test(the_order_is_found),
        cmocka_unit_test(deviations_need_no_operating_point),
        cmocka_unit_test(as_many_lags_as_are_asked_for),
        cmocka_unit_test(of_white_errors_nothing_is_expected),
        cmocka_unit_test(what_disturbs_the_plant_is_told),
        cmocka_unit_test(units_and_operating_points_are_no_matter),
        cmocka_unit_test(a_validation_is_what_its_words_say),
        cmocka_unit_test(where_a_free_run_begins_is_found),
        cmocka_unit_test(what_is_validated_must_go_with_the_record),
        cmocka_unit_test(how_white_errors_are_is_as_published),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
