/* SPDX-License-Identifier: BSD-3-Clause */
/* Parameters and noises by maximum likelihood: the likelihood, the truth, and what cannot be told. */
#include "apcidentify.h"
#include "apcplant.h"
#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SAMPLES 400

/* dx/dt = a x + b u, y = x; a second state of which nothing is seen. */
static int slope(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    dx[0] = p[0] * x[0] + p[1] * u[0];
    dx[1] = -0.1 * x[1];
    return 0;
}

static void output(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)u;
    (void)p;
    y[0] = x[0];
}

static const struct apc_param parameters[] =
    {
        {.name = "a", .initial = -0.1, .low = -1.0, .high = 1.0},
        {.name = "b", .initial = 1.0, .low = -10.0, .high = 10.0},
        {.name = "idle", .initial = 1.0, .low = 0.0, .high = 10.0},
},
                              states[] = {
                                  {.name = "x", .initial = 0.0, .low = -1e6, .high = 1e6},
                                  {.name = "unseen", .initial = 0.0, .low = -1e6, .high = 1e6},
};
static const struct apc_model lag = {.abi = APC_MODEL_ABI,
                                     .name = "lag",
                                     .description = "",
                                     .nx = 2,
                                     .nu = 1,
                                     .ny = 1,
                                     .np = 3,
                                     .param = parameters,
                                     .state = states,
                                     .f = slope,
                                     .g = output};

struct simulated {
    struct apc_record record;
    double u[SAMPLES], y[SAMPLES], process, measured;
    size_t begin[2];
};

/* In half seconds, exactly as the equations have it; fed back where @p a is positive. */
static struct simulated *simulate(double a, double process, double measured, uint64_t seed)
{
    struct simulated *s = calloc(1, sizeof *s);
    const double Ts = 0.5, phi = exp(a * Ts), random_walk = process * sqrt((phi * phi - 1.0) / (2.0 * a));
    struct apc_random random;
    double x = 0.0;

    assert_non_null(s);
    apc_random_init(&random, seed, "likelihood");
    for (size_t k = 0; k < SAMPLES; k++) {
        s->y[k] = x + measured * apc_random_normal(&random);
        s->u[k] = (k / 15 % 2 ? 1.0 : -1.0) * (0.5 + apc_random_uniform(&random)) - (a > 0.0 ? s->y[k] : 0.0);
        x = phi * x + (phi - 1.0) / a * s->u[k] + random_walk * apc_random_normal(&random);
    }
    s->record = (struct apc_record){
        .size = sizeof s->record, .Ts = Ts, .n = SAMPLES, .nu = 1, .ny = 1, .u = s->u, .y = s->y};
    return s;
}

struct found {
    double value[2], error[2], x0[4], white;
    struct apc_noise process[2], measured;
    double log_likelihood;
};

/* What is asked beside which parameters: NULL or 0: nothing. */
static struct {
    const struct apc_model *model;
    const struct apc_prior *prior;
    struct apc_interval *profile;
    const double *p;
} beside;

static int find(const struct simulated *s, const size_t *which, size_t n, const size_t *noisy, size_t n_noisy,
                struct found *of, struct apc_error *why)
{
    const struct apc_plant_options rk4 = {.size = sizeof rk4, .integrator = "rk4", .steps = 4};
    const struct apc_parameters sought = {.size = sizeof sought,
                                          .model = beside.model ? beside.model : &lag,
                                          .plant = &rk4,
                                          .which = which,
                                          .n = n,
                                          .prior = beside.prior,
                                          .p = beside.p};
    struct apc_likelihood likelihood = {.size = sizeof likelihood,
                                        .noisy = noisy,
                                        .n_noisy = n_noisy,
                                        .process = of->process,
                                        .measured = &of->measured,
                                        .white = &of->white,
                                        .profile = beside.profile};
    int rc =
        apc_identify_likelihood(&s->record, &sought, &likelihood, of->value, of->error, of->x0, NULL, why);

    of->log_likelihood = likelihood.value;
    return rc;
}

static const size_t both[] = {0, 1}, first[] = {0};

/* The exact filter of the lag, a scalar, with the numbers that were found. */
static double exact_log_likelihood(const struct simulated *s, const struct found *of)
{
    const double a = of->value[0], b = of->value[1], phi = exp(a * 0.5), q = of->process[0].deviation,
                 r = of->measured.deviation, Q = q * q * (phi * phi - 1.0) / (2.0 * a);
    double sum = 0.0, x = 0.0, P = 0.0;

    for (size_t k = 0; k < SAMPLES; k++) {
        const bool begins = k == s->begin[0] || (s->record.runs == 2 && k == s->begin[1]);
        const double S = (P = begins ? Q : P) + r * r, v = s->y[k] - (x = begins ? of->x0[k > 0 ? 2 : 0] : x);

        if (isfinite(v)) {
            sum -= (log(2.0 * acos(-1.0) * S) + v * v / S) / 2.0;
            x += P / S * v;
            P = P * r * r / S;
        }
        x = phi * x + (phi - 1.0) / a * b * s->u[k];
        P = phi * phi * P + Q;
    }
    return sum;
}

/* Promise(identification/likelihood): Parameters and noises by maximum likelihood: the likelihood is that of an
 *   exact Kalman filter, also with missing samples and of several records; 95 % intervals hold the truth as
 *   often as they say; a plant may be unstable; noise that the record does not show is told apart.
 */
static void the_likelihood_is_that_of_an_exact_filter(void **state)
{
    struct simulated *s = simulate(-0.1, 0.3, 0.2, 1);
    struct found of = {.log_likelihood = 0.0};
    struct apc_error why;
    (void)state;

    for (size_t k = 50; k < 60; k++)
        s->y[k] = (double)NAN;
    s->begin[1] = 150;
    s->record.runs = 2;
    s->record.begin = s->begin;
    if (find(s, both, 2, first, 1, &of, &why))
        fail_msg("%s", why.text);
    print_message("%.12g, by the exact filter %.12g\n", of.log_likelihood, exact_log_likelihood(s, &of));
    assert_near(of.log_likelihood, exact_log_likelihood(s, &of), 1e-9 * fabs(of.log_likelihood));
    assert_near(of.value[0], -0.1, 4.0 * of.error[0]);
    assert_near(of.value[1], 1.0, 4.0 * of.error[1]);
    assert_near(log(of.process[0].deviation / 0.3), 0.0, 4.0 * of.process[0].error);
    assert_near(log(of.measured.deviation / 0.2), 0.0, 4.0 * of.measured.error);
    assert_true(of.error[0] < 0.02 && of.error[1] < 0.1 && of.process[0].error < 0.2 && of.white > 0.001);
    for (int side = -1; side < 2; side += 2) { /* and it is the greatest */
        struct found other = of;

        other.value[0] += side * 0.3 * of.error[0];
        assert_true(exact_log_likelihood(s, &other) < of.log_likelihood);
        other = of;
        other.process[0].deviation *= exp(side * 0.3 * of.process[0].error);
        assert_true(exact_log_likelihood(s, &other) < of.log_likelihood);
    }
    free(s);
}

/* dx/dt = -a sqrt(x) + b u, y = x. */
static int slope_of_tank(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    dx[0] = -p[0] * sqrt(fmax(x[0], 0.0)) + p[1] * u[0];
    return 0;
}

/* In steps so small that they do not count; the level is from 0.6 to 1.4 of the mean one. */
static struct simulated *simulate_tank(double process, double measured, uint64_t seed)
{
    enum { PARTS = 200 };
    struct simulated *s = simulate(-0.1, 0.0, 0.0, seed);
    const double h = s->record.Ts / PARTS, p[] = {0.3, 0.5};
    struct apc_random random;
    double x = 2.8, dx;

    apc_random_init(&random, seed, "tank");
    for (size_t k = 0; k < SAMPLES; k++) {
        s->y[k] = x + measured * apc_random_normal(&random);
        s->u[k] = k / 15 % 2 ? 0.4 + 0.4 * apc_random_uniform(&random) : 1.2;
        for (size_t i = 0; i < PARTS; i++) {
            slope_of_tank(0.0, &x, s->u + k, p, &dx);
            x += h * dx + process * sqrt(h) * apc_random_normal(&random);
        }
    }
    return s;
}

/* APC_IDENTIFY_SEEDS says over how many seeds. */
static void intervals_hold_what_they_say(void **state)
{
    static const struct apc_param of_tank[] = {{.name = "a", .initial = 0.3, .low = 0.01, .high = 3.0},
                                               {.name = "b", .initial = 0.5, .low = 0.01, .high = 5.0}};
    struct apc_model tank = lag;
    const char *given = getenv("APC_IDENTIFY_SEEDS");
    const unsigned long seeds = given ? strtoul(given, NULL, 10) : 4;
    unsigned long all = 0;
    (void)state;

    if (getenv("APC_SANITIZE"))
        skip(); /* over many seeds, without what takes ten times as long */

    tank.f = slope_of_tank;
    tank.nx = 1;
    tank.np = 2;
    tank.param = of_tank;
    for (size_t nonlinear = 0; nonlinear < 2; nonlinear++) {
        const double truth[2][4] = {{-0.1, 1.0, 0.3, 0.2}, {0.3, 0.5, 0.1, 0.05}}, *t = truth[nonlinear];
        unsigned long inside[4] = {0};

        beside.model = nonlinear ? &tank : NULL;
        for (unsigned long seed = 0; seed < seeds; seed++) {
            struct simulated *s =
                nonlinear ? simulate_tank(t[2], t[3], 100 + seed) : simulate(t[0], t[2], t[3], 100 + seed);
            struct found of = {.log_likelihood = 0.0};
            struct apc_error why;

            if (find(s, both, 2, first, 1, &of, &why))
                fail_msg("%s", why.text);
            inside[0] += fabs(of.value[0] - t[0]) <= 1.96 * of.error[0];
            inside[1] += fabs(of.value[1] - t[1]) <= 1.96 * of.error[1];
            inside[2] += fabs(log(of.process[0].deviation / t[2])) <= 1.96 * of.process[0].error;
            inside[3] += fabs(log(of.measured.deviation / t[3])) <= 1.96 * of.measured.error;
            free(s);
        }
        for (size_t k = 0; k < 4; k++) {
            static const char *const number[] = {"a", "b", "noise of the state", "of the measurement"};

            print_message("%s, %s: %lu of %lu intervals hold it\n", nonlinear ? "tank" : "lag", number[k],
                          inside[k], seeds);
            all += inside[k];
            if (seeds >= 500)
                assert_near((double)inside[k] / (double)seeds, 0.95, 0.03);
        }
    }
    beside.model = NULL;
    assert_true((double)all >= 0.7 * 8.0 * (double)seeds);
}

/* A free run of it leads nowhere. */
static void an_unstable_plant_is_found(void **state)
{
    struct simulated *s = simulate(0.2, 0.05, 0.1, 2);
    struct found of = {.log_likelihood = 0.0};
    struct apc_error why;
    (void)state;

    if (find(s, both, 2, first, 1, &of, &why))
        fail_msg("%s", why.text);
    print_message("a %g +- %g, b %g +- %g\n", of.value[0], of.error[0], of.value[1], of.error[1]);
    assert_near(of.value[0], 0.2, 4.0 * of.error[0]);
    assert_near(of.value[1], 1.0, 4.0 * of.error[1]);
    assert_true(of.error[0] < 0.1);
    free(s);
}

/*
 * Promise(identification/priors): With a prior, a normal distribution, of a parameter the most probable value is found: between prior and
 *   record, by their variances, and of a parameter that the record does not show the prior itself.
 */
static void a_prior_counts_as_its_variance_says(void **state)
{
    const size_t sought[] = {0, 2};
    struct simulated *s = simulate(-0.1, 0.3, 0.2, 5);
    struct found alone = {.log_likelihood = 0.0}, with = alone;
    struct apc_error why;
    (void)state;

    if (find(s, first, 1, first, 1, &alone, &why))
        fail_msg("%s", why.text);
    const struct apc_prior prior[] = {{alone.value[0] + 2.0 * alone.error[0], alone.error[0]}, {3.0, 0.5}};

    beside.prior = prior;
    if (find(s, sought, 2, first, 1, &with, &why))
        fail_msg("%s", why.text);
    print_message("%g +- %g, with a prior of %g +- %g: %g +- %g\n", alone.value[0], alone.error[0],
                  prior[0].mean, prior[0].deviation, with.value[0], with.error[0]);
    assert_near(with.value[0], alone.value[0] + alone.error[0], 0.1 * alone.error[0]);
    assert_near(with.error[0], alone.error[0] / sqrt(2.0), 0.05 * alone.error[0]);
    assert_near(with.value[1], 3.0, 1e-6);
    assert_near(with.error[1], 0.5, 1e-6);
    assert_true(with.log_likelihood < alone.log_likelihood); /* the prior has no part in it */
    assert_near(alone.log_likelihood - with.log_likelihood, 0.5, 0.1);
    beside.prior = NULL;
    free(s);
}

/* By least squares too, however much the record scatters and whether or not they agree. */
static void a_prior_is_as_sure_as_it_says_by_least_squares(void **state)
{
    const struct apc_plant_options rk4 = {.size = sizeof rk4, .integrator = "rk4", .steps = 4};
    const size_t sought[] = {1, 2};
    struct simulated *s = simulate(-0.1, 1e-9, 0.2, 7);
    struct apc_prior prior[2] = {{0.0, 0.0}, {3.0, 0.5}};
    double value[2], error[2], alone[2], its_error;
    const struct apc_parameters of = {
        .size = sizeof of, .model = &lag, .plant = &rk4, .which = sought, .n = 2, .prior = prior};
    struct apc_error why;
    (void)state;

    if (apc_identify_parameters(&s->record, &of, alone, error, NULL, NULL, &why))
        fail_msg("%s", why.text);
    its_error = error[0];
    assert_near(error[1], 0.5, 1e-9);
    for (double far = -40.0; far <= 40.0; far += 40.0) {
        prior[0] = (struct apc_prior){alone[0] + far * its_error, 0.01 * its_error};
        if (apc_identify_parameters(&s->record, &of, value, error, NULL, NULL, &why))
            fail_msg("%s", why.text);
        assert_near(error[0], prior[0].deviation, 0.01 * prior[0].deviation);
        assert_near(error[1], 0.5, 1e-9);
    }
    free(s);
}

/*
 * Promise(identification/profile): An interval of the profile likelihood ends where the likelihood's logarithm is 1.92 less, all other
 *   unknowns as suits best there.
 */
static void a_profile_ends_where_the_likelihood_has_fallen(void **state)
{
    struct simulated *s = simulate(-0.1, 0.3, 0.2, 6);
    struct apc_interval profile[2] = {{0.0, 0.0}};
    struct found best = {.log_likelihood = 0.0};
    struct apc_error why;
    (void)state;

    beside.profile = profile;
    if (find(s, both, 2, first, 1, &best, &why))
        fail_msg("%s", why.text);
    beside.profile = NULL;
    print_message("a %g +- %g: %g to %g\n", best.value[0], best.error[0], profile[0].low, profile[0].high);
    for (int end = 0; end < 2; end++) {
        const double at = end ? profile[0].high : profile[0].low, p[] = {at, 1.0, 1.0};
        struct found there = {.log_likelihood = 0.0};

        assert_near(fabs(at - best.value[0]), 1.96 * best.error[0], 0.3 * best.error[0]);
        beside.p = p;
        if (find(s, both + 1, 1, first, 1, &there, &why))
            fail_msg("%s", why.text);
        assert_near(best.log_likelihood - there.log_likelihood, 1.92, 0.03);
    }
    beside.p = NULL;
    free(s);
}

static int slope_of_saturation(double t, const double *x, const double *u, const double *p, double *dx)
{
    return slope(t, x, u, (const double[]){-0.1, 1.03 * tanh(p[0])}, dx);
}

/* Promise(identification/profile) */
static void where_the_likelihood_falls_no_further_a_profile_has_no_end(void **state)
{
    static const struct apc_param gain = {.name = "gain", .initial = 1.0, .low = 0.0, .high = HUGE_VAL};
    struct simulated *s = simulate(-0.1, 0.3, 0.2, 6);
    struct apc_interval profile = {0.0, 0.0};
    struct apc_model model = lag;
    struct found of = {.log_likelihood = 0.0};
    struct apc_error why;
    (void)state;

    model.f = slope_of_saturation;
    model.np = 1;
    model.param = &gain;
    beside.model = &model;
    beside.profile = &profile;
    if (find(s, first, 1, first, 1, &of, &why))
        fail_msg("%s", why.text);
    beside.model = NULL;
    beside.profile = NULL;
    print_message("gain %g +- %g: %g to %g\n", of.value[0], of.error[0], profile.low, profile.high);
    assert_true(profile.low > 0.0 && profile.low < of.value[0] && isnan(profile.high));
    free(s);
}

static void refused(const struct simulated *s, const size_t *which, size_t n, const size_t *noisy,
                    size_t n_noisy, int code, const char *reason)
{
    struct found of = {.log_likelihood = 0.0};
    struct apc_error why = {0};

    if (find(s, which, n, noisy, n_noisy, &of, &why) != code)
        fail_msg("expected %s, found %g: %s", reason, of.value[0], why.text);
    assert_has(why.text, reason);
}

static void what_cannot_be_told_is_named(void **state)
{
    struct simulated *s = simulate(-0.1, 1e-9, 0.2, 3);
    struct found of = {.log_likelihood = 0.0};
    struct apc_error why;
    (void)state;

    if (find(s, NULL, 0, first, 1, &of, &why)) /* there is none, and no parameter is sought */
        fail_msg("%s", why.text);
    print_message("%g +- %g, %g +- %g\n", of.process[0].deviation, of.process[0].error, of.measured.deviation,
                  of.measured.error);
    assert_true(isnan(of.process[0].error) && of.process[0].deviation < 0.05);
    assert_near(log(of.measured.deviation / 0.2), 0.0, 4.0 * of.measured.error);
    refused(s, both, 2, NULL, 0, APC_ESOLVER, "noise of unseen acts on nothing that was measured");
    refused(s, both, 2, (const size_t[]){0, 0}, 2, APC_EINVAL, "must be different ones of 2");
    beside.prior = &(const struct apc_prior){1.0, -1.0};
    refused(s, first, 1, first, 1, APC_EINVAL, "beforehand must be a number and a deviation from 0 on");
    beside.prior = &(const struct apc_prior){-1.5, 0.1};
    refused(s, first, 1, first, 1, APC_EINVAL,
            "a cannot be -1.5, as it is said to be beforehand: it must be from -1 to 1");
    beside.prior = NULL;
    refused(s, (const size_t[]){2}, 1, first, 1, APC_ESOLVER, "idle changes nothing that was measured");
    memset(s->u, 0, sizeof s->u); /* then nothing tells b */
    refused(s, both, 2, first, 1, APC_ESOLVER, "b changes nothing that was measured");
    for (size_t k = 0; k < SAMPLES; k++)
        s->y[k] = 3.0;
    refused(s, both, 2, first, 1, APC_EINVAL, "output 1 is the same all the time");
    free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_likelihood_is_that_of_an_exact_filter),
        cmocka_unit_test(intervals_hold_what_they_say),
        cmocka_unit_test(an_unstable_plant_is_found),
        cmocka_unit_test(a_prior_counts_as_its_variance_says),
        cmocka_unit_test(a_prior_is_as_sure_as_it_says_by_least_squares),
        cmocka_unit_test(a_profile_ends_where_the_likelihood_has_fallen),
        cmocka_unit_test(where_the_likelihood_falls_no_further_a_profile_has_no_end),
        cmocka_unit_test(what_cannot_be_told_is_named),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
