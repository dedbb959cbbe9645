/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The same record gives the same model wherever it is looked at: on each compiler, with or without
 * optimisation, today and tomorrow. That the models are right is asked of the other tests, in figures that
 * noise allows; a search that ends elsewhere than it used to, or one lag that is chosen otherwise, shows
 * here. Who changes an algorithm on purpose takes the new numbers from what this test says, and tells why
 * they are better.
 */
#include "apcexcite.h"
#include "apcplant.h"
#include "apctune.h"
#include "base/base_internal.h"
#include "check.h"
#include "identify/identify_internal.h"
#include "records.h"

#include <stdlib.h>
#include <string.h>

/* ---- One number of many ------------------------------------------------------------------------- */

static double sum;
static size_t n_numbers;

/* Each number counts by its leading digits, whatever its size. */
static void number(double value)
{
    const double weight = 1.0 + 0.618 * (double)(++n_numbers % 7);

    sum += weight * (!isfinite(value) ? 7.0 : asinh(1e3 * value));
}

static void numbers(const double *value, size_t n)
{
    for (size_t i = 0; i < n; i++)
        number(value[i]);
}

static void must(int rc, const struct apc_error *why)
{
    if (rc < 0)
        fail_msg("%s: %s", apc_err_name(rc), why->text);
}

/* ---- Records -------------------------------------------------------------------------------------- */

static const struct apc_transfer two[] = {{.gain = 2.0, .tau = {1.0}, .dead_time = 0.4},
                                          {.gain = -1.0, .tau = {0.5, 2.0}}},
                                 slow[] = {{.gain = 3.0, .tau = {4.0, 1.5}, .dead_time = 1.3}},
                                 level[] = {{.gain = 0.5, .integrating = true, .dead_time = 0.6}},
                                 square[] = {{.gain = 1.0, .tau = {1.0}},
                                             {.gain = 0.4, .tau = {0.6}, .dead_time = 0.2},
                                             {.gain = -0.3, .tau = {2.0}},
                                             {.gain = 2.0, .tau = {1.2}, .dead_time = 0.6}};
static const size_t hold[] = {15, 22};

static struct record_test *of_two(double noise, double colour)
{
    return record_simulate(two, 2, 1, 300, 0.2, hold, noise, colour, 1);
}

static struct record_test *of_slow(void)
{
    return record_simulate(slow, 1, 1, 260, 0.5, (const size_t[]){25}, 0.03, 0.0, 2);
}

static struct record_test *of_level(void)
{
    return record_simulate(level, 1, 1, 240, 0.2, hold, 0.02, 0.0, 3);
}

static struct record_test *of_square(void)
{
    return record_simulate(square, 2, 2, 400, 0.2, hold, 0.05, 0.0, 4);
}

/* Two inputs that move unlike far, around places far from 0: a level, and what does not integrate. */
static struct record_test *of_levels(void)
{
    static const struct apc_transfer g[] = {{.gain = 0.5, .integrating = true, .dead_time = 0.4},
                                            {.gain = -0.2, .integrating = true},
                                            {.gain = 1.0, .tau = {1.0}},
                                            {.gain = 0.4, .tau = {0.6}, .dead_time = 0.2}};
    struct record_test *t = record_simulate(g, 2, 2, 300, 0.2, hold, 0.01, 0.0, 7);

    for (size_t k = 0; k < t->record.n; k++) {
        t->u[2 * k] += 4.0;
        t->u[2 * k + 1] = 10.0 * t->u[2 * k + 1] - 70.0;
        t->y[2 * k] += 5.0;
    }
    return t;
}

/* Its second input stands still. */
static struct record_test *of_one_moving(void)
{
    struct record_test *t = of_two(0.05, 0.3);

    for (size_t k = 0; k < t->record.n; k++)
        t->u[2 * k + 1] = 3.0;
    return t;
}

/* Two runs at two operating points, with samples that are not there. */
static struct record_test *of_runs(void)
{
    struct record_test *t = record_simulate(two, 2, 1, 200, 0.2, hold, 0.05, 0.0, 5);

    record_append(t, record_simulate(two, 2, 1, 160, 0.2, hold, 0.05, 0.0, 6), 3.0, 10.0);
    return t;
}

/* Noise that swings: of an autoregression of order 2. */
static struct record_test *with_waves(struct record_test *t)
{
    struct apc_random random;
    double e[2] = {0, 0};

    apc_random_init(&random, 8, "waves");
    for (size_t k = 0; k < t->record.n; k++) {
        const double now = 1.4 * e[0] - 0.8 * e[1] + 0.05 * apc_random_normal(&random);

        t->y[k] += now;
        e[1] = e[0];
        e[0] = now;
    }
    return t;
}

static struct record_test *with_holes(struct record_test *t)
{
    for (size_t k = 40; k < t->record.n; k += 37)
        t->y[k] = (double)NAN;
    return t;
}

/* ---- What is made of them --------------------------------------------------------------------------- */

static void transfer(struct record_test *t, struct apc_identify_transfer_options o)
{
    const size_t inputs = t->record.nu + t->record.nd, runs = apc_record_runs(&t->record);
    struct apc_transfer g[4], error[4];
    double u0[8], y0[8];
    struct apc_transfer_fit fit[2];
    struct apc_error why;

    o.size = sizeof o;
    must(apc_identify_transfer(&t->record, &o, g, error, u0, y0, fit, &why), &why);
    for (size_t i = 0; i < inputs * t->record.ny; i++) {
        numbers((double[]){g[i].gain, g[i].tau[0], g[i].tau[1], g[i].dead_time, g[i].integrating}, 5);
        numbers((double[]){error[i].gain, error[i].tau[0], error[i].tau[1], error[i].dead_time}, 4);
    }
    numbers(u0, runs * inputs);
    numbers(y0, runs * t->record.ny);
    for (size_t i = 0; i < t->record.ny; i++)
        numbers((double[]){fit[i].deviation, fit[i].noise, fit[i].rest, (double)fit[i].n_parameters}, 4);
    free(t);
}

/* A state may be of any base: what its model does is not. */
static void behaviour(const struct apc_linear *m)
{
    const size_t inputs = m->nu + m->nd;
    double *x = calloc(2 * m->nx + inputs + m->ny, sizeof *x), *next = x + m->nx, *u = next + m->nx,
           *y = u + inputs;

    assert_non_null(x);
    for (int k = 0; k < 30; k++) {
        for (size_t j = 0; j < inputs; j++)
            u[j] = sin(0.3 * k * (double)(j + 1));
        apc_linear_output(m, x, u, y);
        numbers(y, m->ny);
        apc_linear_next(m, x, u, next);
        memcpy(x, next, m->nx * sizeof *x);
    }
    free(x);
}

static void judged(struct apc_identified *m, struct record_test *t)
{
    const size_t inputs = t->record.nu + t->record.nd, ny = t->record.ny, runs = apc_record_runs(&t->record);
    struct apc_validation v[2];
    struct apc_error why;

    behaviour(m->linear);
    numbers(m->u0, runs * inputs);
    numbers(m->y0, runs * ny);
    numbers(m->covariance, ny * ny);
    numbers((double[]){(double)m->na, (double)m->nb, (double)m->linear->nx}, 3);
    for (size_t i = 0; m->na + m->nb > 0 && i < inputs * ny; i++)
        number((double)m->delay[i]);
    for (size_t from = 0; from < 200; from += 60)
        number(apc_identified_misfit(m, &t->record, from));
    for (size_t from = 0; from < 2; from++) {
        must(apc_validate(m->linear, m->K, &t->record, 150 * from, v, NULL, &why), &why);
        for (size_t i = 0; i < ny; i++)
            numbers((double[]){v[i].fit, v[i].ahead, v[i].white, v[i].independent}, 4);
    }
    apc_identified_destroy(m);
    free(t);
}

static void arx(struct record_test *t, struct apc_identify_arx_options o)
{
    struct apc_identified *m;
    struct apc_error why;

    o.size = sizeof o;
    must(apc_identify_arx(&m, &t->record, &o, &why), &why);
    judged(m, t);
}

static void subspace(struct record_test *t, struct apc_identify_subspace_options o)
{
    struct apc_identified *m;
    struct apc_error why;

    o.size = sizeof o;
    must(apc_identify_subspace(&m, &t->record, &o, &why), &why);
    judged(m, t);
}

/* Where the tank's flows and time constant lie, and where it began. */
static void parameters(size_t until)
{
    static double u[240 * 4], y[240 * 4];
    const struct apc_model *model;
    struct apc_plant *plant;
    struct apc_random random;
    double p[20], x0[8], value[3], error[3], at[8];
    struct apc_error why;
    void *handle;

    must(apc_model_find("first-order", &model, &handle, &why), &why);
    for (size_t i = 0; i < model->np; i++)
        p[i] = model->param[i].initial * 1.4;
    for (size_t i = 0; i < model->nx; i++)
        x0[i] = 0.5;
    apc_random_init(&random, 9, "same");
    assert_int_equal(apc_plant_create(&plant, model, p, x0, NULL, &why), 0);
    for (size_t k = 0; k < 240; k++) {
        u[k] = k % 30 ? u[k - 1] : apc_random_normal(&random);
        apc_plant_output(plant, u + k, y + k);
        y[k] += 0.01 * apc_random_normal(&random);
        assert_int_equal(apc_plant_advance(plant, 0.5, u + k), 0);
    }
    apc_plant_destroy(plant);
    const struct apc_record r = {.size = sizeof r, .Ts = 0.5, .n = 240, .nu = 1, .ny = 1, .u = u, .y = y};
    const struct apc_parameters sought = {
        .size = sizeof sought, .model = model, .which = (const size_t[]){0, 1}, .n = 2, .until = until};
    must(apc_identify_parameters(&r, &sought, value, error, at, NULL, &why), &why);
    numbers(value, 2);
    numbers(error, 2);
    numbers(at, model->nx);
}

static void signals(void)
{
    double u[256], crest;
    struct apc_relay relay = {.hysteresis = 0.1};

    assert_int_equal(apc_excite_multisine(1, 20, 1, u, 256, &crest), 0);
    numbers(u, 256);
    number(crest);
    assert_int_equal(apc_excite_multisine(3, 27, 2, u, 200, &crest), 0);
    numbers(u, 200);
    number(crest);
    for (int k = 0; k < 200; k++)
        number(apc_relay_step(&relay, 0.1 * k, sin(0.05 * k * (1 + 0.001 * k))));
    numbers(relay.amplitude, 2);
    numbers(relay.period, 2);
    number(apc_relay_settled(&relay));
}

static void rules(void)
{
    const struct apc_transfer of[] = {two[0], two[1], slow[0], level[0]};
    struct apc_error why;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        for (int how = 0; how < 8; how++) {
            const enum apc_tune_rule rule = how & 1 && !of[i].integrating ? APC_TUNE_LAMBDA : APC_TUNE_SIMC;
            const double period = how & 4 ? 0.2 : 0.0;
            struct apc_margins m = {.size = sizeof m};
            struct apc_pid_tuning t;
            double gain, every;

            must(apc_tune_pid(&of[i], rule, how & 2, 1.1, period, &t, &why), &why);
            numbers((double[]){t.Kp, t.tau_i, t.tau_d}, 3);
            must(apc_tune_margins(&of[i], &t, period, &m, &why), &why);
            numbers((double[]){m.gain, m.phase, m.delay, m.sensitivity, m.stable}, 5);
            if (apc_tune_limit(&of[i], period, &gain, &every, &why) == 0) {
                numbers((double[]){gain, every}, 2);
                must(apc_tune_relay(gain, every, how & 2, &t, &why), &why);
                numbers((double[]){t.Kp, t.tau_i, t.tau_d}, 3);
            }
        }
    }
}

static void text(const struct apc_error *why)
{
    number((double)apc_hash(APC_HASH_BEGIN, why->text, strlen(why->text)) / 4294967296.0);
}

/* Transfer functions of every kind there is, with each rule, some of which are not for it: that is said. */
static void rules_of_any_kind(void)
{
    struct apc_random random;

    apc_random_init(&random, 10, "rules");
    for (int k = 0; k < 200; k++) {
        const double gain = apc_random_normal(&random), lag = exp(apc_random_normal(&random));
        const struct apc_transfer g = {
            .gain = gain,
            .tau = {k % 7 ? lag : 0.0, k % 3 ? 0.0 : 3.0 * apc_random_uniform(&random)},
            .zero = k % 4 ? 0.0 : 2.0 * apc_random_normal(&random),
            .dead_time = k % 5 ? apc_random_uniform(&random) : 0.0,
            .integrating = k % 6 == 0};
        const double tau_c = k % 8 ? 2.0 * apc_random_uniform(&random) : 0.0, period = k % 2 ? 0.3 : 0.0;
        struct apc_error why = {""};
        struct apc_margins m = {.size = sizeof m};
        struct apc_pid_tuning t = {0};
        double limit = 0, every = 0;

        number(apc_tune_pid(&g, k % 9 ? APC_TUNE_SIMC : APC_TUNE_LAMBDA, k & 4, tau_c, period, &t, &why));
        text(&why);
        numbers((double[]){t.Kp, t.tau_i, t.tau_d}, 3);
        if (k % 10 == 0)
            t.tau_i = 0.0; /* no integral */
        number(apc_tune_margins(&g, &t, period, &m, &why));
        text(&why);
        numbers((double[]){m.gain, m.phase, m.delay, m.sensitivity, m.stable}, 5);
        number(apc_tune_limit(&g, period, &limit, &every, &why));
        text(&why);
        numbers((double[]){limit, every}, 2);
        number(apc_tune_relay(limit, every, k & 1, &t, &why));
        text(&why);
        numbers((double[]){t.Kp, t.tau_i, t.tau_d}, 3);
    }
}

/* Lags and what goes with them: no order, one, two, an integrator; no dead time, whole periods, others. */
static void lags(void)
{
    static const double dead[] = {0.0, 0.3, 0.5, 0.75, 1.0, 2.6};
    double u[3 * 60], w[60], rate[60];

    for (size_t k = 0; k < 3 * 60; k++)
        u[k] = sin(0.2 * (double)k) + (double)(k % 13 > 6);
    for (unsigned order = 0; order <= 2; order++) {
        for (size_t i = 0; i < 2 * sizeof dead / sizeof *dead; i++) {
            const struct apc_lag lag = {
                .order = order, .integrating = i % 2 || !order, .tau = {1.3, 0.4}, .dead_time = dead[i / 2]};

            assert_int_equal(apc_lag_response(&lag, 0.5, u[i % 3], u + i % 3, 3, 55, w, i % 5 ? rate : NULL),
                             0);
            numbers(w, 55);
            if (i % 5)
                numbers(rate, 55);
        }
    }
}

/* What all of it is calculated with: columns that depend on others among them. */
static void parts(void)
{
    double Q[6 * 30], R[36], b[12], x[12], V[36], s[6], S[2 * 5 * 6], T[25], e[120], a[8], out[120];
    struct apc_random random;

    apc_random_init(&random, 11, "parts");
    for (size_t i = 0; i < 6 * 30; i++)
        Q[i] = apc_random_normal(&random);
    memcpy(Q + 4 * 30, Q + 30, 30 * sizeof *Q);
    memset(R, 0, sizeof R);
    apc_qr_extend(30, 0, 4, Q, R, 6);
    apc_qr_extend(30, 4, 6, Q, R, 6);
    numbers(R, 36);
    for (size_t i = 0; i < 6 * 30; i += 7)
        number(Q[i]);
    for (size_t i = 0; i < 6; i++)
        b[i] = 1.0 + (double)i;
    apc_qr_solve(6, R, 6, b, x);
    numbers(x, 6);
    number(apc_qr_variance(4, R, 6, b));
    numbers(b, 4);
    number(apc_qr_variance(6, R, 6, b));
    for (double damping = 0.01; damping < 20; damping *= 10) {
        apc_qr_damped(4, R, 6, x, damping, S, T, b);
        numbers(b, 4);
    }
    for (size_t i = 0; i < 5 * 20; i++)
        Q[i] = apc_random_normal(&random) / (1.0 + (double)(i / 20));
    apc_svd(20, 5, Q, s, V);
    numbers(s, 5);
    for (size_t i = 0; i < 25; i++)
        number(V[i] * V[i]);
    for (int k = 1; k < 40; k++)
        number(apc_chi2_above(0.37 * k * (1 + k % 4), 1 + k % 11));
    for (size_t k = 0; k < 120; k++) {
        e[k] =
            (k > 0 ? 0.5 * out[k - 1] : 0.0) - (k > 1 ? 0.4 * out[k - 2] : 0.0) + apc_random_normal(&random);
        out[k] = e[k];
    }
    e[50] = (double)NAN;
    const int order = apc_autoregression(e, 120, 8, a);
    number(order);
    numbers(a, (size_t)order);
    apc_whiten(e, 120, a, (size_t)order, out);
    numbers(out, 120);
}

/* A model that is not quite the plant's, by records of which one says nothing of an input. */
static void validated(struct record_test *t)
{
    struct apc_validation v;
    struct apc_linear *model;
    double run[400];
    struct apc_error why;

    must(apc_linear_from_transfer(&model, 1, 2, 0, (const struct apc_transfer[]){slow[0], two[1]}, NULL, NULL,
                                  0.2, &why),
         &why);
    for (size_t from = 0; from < 200; from += 90) {
        must(apc_validate(model, NULL, &t->record, from, &v, run, &why), &why);
        numbers((double[]){v.fit, v.ahead, v.white, v.independent}, 4);
        numbers(run, t->record.n);
    }
    apc_linear_destroy(model);
    free(t);
}

static void excited(struct record_test *t)
{
    for (size_t j = 0; j < t->record.nu; j++)
        number(apc_record_excitation(&t->record, j));
    free(t);
}

#define TRANSFER(...) ((struct apc_identify_transfer_options){__VA_ARGS__})
#define ARX(...)      ((struct apc_identify_arx_options){__VA_ARGS__})
#define SUBSPACE(...) ((struct apc_identify_subspace_options){__VA_ARGS__})

static void the_same_record_gives_the_same_model(void **state)
{
    size_t wrong = 0;

    (void)state;
#define SAME(what, expected)                                                                                 \
    do {                                                                                                     \
        sum = 0;                                                                                             \
        n_numbers = 0;                                                                                       \
        what;                                                                                                \
        if (!(fabs(sum - (expected)) <= 1e-6)) {                                                             \
            print_message("%s: %.9f of %zu numbers, not %.9f\n", #what, sum, n_numbers, expected);           \
            wrong++;                                                                                         \
        }                                                                                                    \
    } while (0)
    SAME(transfer(of_two(0.05, 0.5), TRANSFER(.order = 1, .dead_time_max = 1.0)), 242.529762617);
    SAME(transfer(of_two(0.02, 0.0), TRANSFER(.dead_time_max = 2.0)), 222.724454418);
    SAME(transfer(of_slow(), TRANSFER(.order = 2, .dead_time_max = 4.0)), 125.331698184);
    SAME(transfer(of_slow(), TRANSFER(.dead_time_max = 4.0, .integrating = APC_INTEGRATING_NO)),
         125.331698184);
    SAME(transfer(of_level(), TRANSFER(.dead_time_max = 2.0)), 118.832565963);
    SAME(transfer(of_level(), TRANSFER(.order = 1, .dead_time_max = 2.0, .integrating = APC_INTEGRATING_YES)),
         142.182390819);
    SAME(transfer(of_square(), TRANSFER(.order = 1, .dead_time_max = 1.2)), 521.515377584);
    SAME(transfer(of_runs(), TRANSFER(.order = 1, .dead_time_max = 1.0)), 274.092885793);
    SAME(transfer(with_holes(of_two(0.05, 0.0)), TRANSFER(.order = 1, .dead_time_max = 1.0)), 219.769760275);
    SAME(transfer(with_waves(of_two(0.0, 0.0)), TRANSFER(.order = 1, .dead_time_max = 1.0)), 228.578627070);
    SAME(transfer(of_levels(), TRANSFER(.order = 1, .dead_time_max = 1.0)), 435.080753283);
    SAME(validated(of_two(0.05, 0.0)), 16716.724736182);
    SAME(validated(of_one_moving()), 712.470959936);
    SAME(validated(of_runs()), 16540.659653869);
    SAME(arx(of_two(0.05, 0.5), ARX(.na = 0)), 584.541603835);
    SAME(arx(of_two(0.05, 0.0), ARX(.na = 2, .nb = 3, .delay_max = 4, .direct = true)), 497.509570174);
    SAME(arx(of_two(0.05, 0.0), ARX(.fir = true, .nb = 30)), 483.104265471);
    SAME(arx(of_square(), ARX(.delay_max = 6)), 1127.783947191);
    SAME(arx(of_runs(), ARX(.na = 2, .nb = 2)), 564.576804198);
    SAME(subspace(of_two(0.05, 0.0), SUBSPACE(.order = 0)), 500.615552792);
    SAME(subspace(of_square(), SUBSPACE(.order = 4, .rows = 8)), 994.367887192);
    SAME(subspace(of_square(), SUBSPACE(.order = 3, .direct = true, .deviations = true)), 705.561966189);
    SAME(subspace(of_runs(), SUBSPACE(.order = 3)), 222.741983790);
    SAME(parameters(0), 76.662116950);
    SAME(parameters(150), 77.624822438);
    SAME(excited(of_two(0.05, 0.0)), 44.370814742);
    SAME(excited(of_runs()), 43.510819496);
    SAME(signals(), 910.903198517);
    SAME(rules(), 7896.915318273);
    SAME(rules_of_any_kind(), 44541.237581969);
    SAME(lags(), 43197.196571611);
    SAME(parts(), 781.309144176);
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_record_gives_the_same_model),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
