/* SPDX-License-Identifier: BSD-3-Clause */
/* Tunings by rule, and the margins that they are known to have. */
#include "apctune.h"
#include "check.h"

#include <complex.h>
#include <string.h>

/* Skogestad 2003, table 1: tau_c = theta. */
/*
 * Promise(identification/simc-lambda-tunings): SIMC and lambda tunings of a transfer function, with the
 *   margins that theory says they have; `apc identify --suggest`.
 */
static void simc_has_the_margins_of_its_table(void **state)
{
    static const struct apc_transfer lag = {.gain = -2.5, .tau = {7.0}, .dead_time = 1.0},
                                     integrator = {.gain = 0.3, .integrating = true, .dead_time = 2.0};
    struct apc_pid_tuning t;
    struct apc_margins m = {.size = sizeof m};
    (void)state;

    assert_int_equal(apc_tune_pid(&lag, APC_TUNE_SIMC, false, 0.0, 0.0, &t, NULL), 0);
    assert_near(t.Kp, -7.0 / (2.5 * 2.0), 1e-12);
    assert_near(t.tau_i, 7.0, 1e-12);
    assert_near(t.tau_d, 0.0, 0.0);
    assert_int_equal(apc_tune_margins(&lag, &t, 0.0, &m, NULL), 0);
    assert_true(m.stable);
    assert_near(m.gain, 3.14, 0.005);
    assert_near(m.phase, 61.4, 0.05);
    assert_near(m.delay, 2.14, 0.01);
    assert_near(m.sensitivity, 1.59, 0.005);

    assert_int_equal(apc_tune_pid(&integrator, APC_TUNE_SIMC, false, 0.0, 0.0, &t, NULL), 0);
    assert_near(t.Kp, 1.0 / (0.3 * 4.0), 1e-12);
    assert_near(t.tau_i, 16.0, 1e-12);
    assert_int_equal(apc_tune_margins(&integrator, &t, 0.0, &m, NULL), 0);
    assert_true(m.stable);
    assert_near(m.gain, 2.96, 0.005);
    assert_near(m.phase, 46.9, 0.05);
    assert_near(m.delay, 2.0 * 1.59, 0.02);
    assert_near(m.sensitivity, 1.70, 0.005);
}

/* Promise(identification/simc-lambda-tunings) */
static void a_second_lag_is_for_the_derivative_or_counts_by_halves(void **state)
{
    static const struct apc_transfer g = {.gain = 2.0, .tau = {2.0, 10.0}, .dead_time = 1.0};
    struct apc_pid_tuning t;
    (void)state;

    assert_int_equal(apc_tune_pid(&g, APC_TUNE_SIMC, false, 3.0, 0.0, &t, NULL), 0);
    assert_near(t.Kp, 11.0 / (2.0 * 5.0), 1e-12); /* tau 10 + 1, theta 1 + 1 */
    assert_near(t.tau_i, 11.0, 1e-12);
    assert_int_equal(apc_tune_pid(&g, APC_TUNE_SIMC, true, 3.0, 0.0, &t, NULL), 0);
    assert_near(t.Kp, 10.0 / (2.0 * 4.0) * 1.2, 1e-12);
    assert_near(t.tau_i, 12.0, 1e-12);
    assert_near(t.tau_d, 2.0 / 1.2, 1e-12);
    /* The zeros of that PID are the plant's poles, so what is left is an integrator with dead time. */
    assert_near(t.tau_i * t.tau_d, 20.0, 1e-12);
}

/* What integrates has no lag for the rule but those behind it. */
static void a_lag_behind_an_integrator_is_a_second_one(void **state)
{
    static const struct apc_transfer level = {.gain = 0.5,
                                              .tau = {4.0, 0.0},
                                              .dead_time = 1.0,
                                              .integrating = true},
                                     late = {.gain = 0.5, .dead_time = 3.0, .integrating = true};
    struct apc_pid_tuning t, same;
    (void)state;

    assert_int_equal(apc_tune_pid(&level, APC_TUNE_SIMC, false, 3.0, 0.0, &t, NULL), 0);
    assert_int_equal(apc_tune_pid(&late, APC_TUNE_SIMC, false, 3.0, 0.0, &same, NULL), 0);
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_i, same.tau_i, 1e-12);
    assert_int_equal(apc_tune_pid(&level, APC_TUNE_SIMC, true, 3.0, 0.0, &t, NULL), 0);
    assert_near(t.Kp, 1.0 / (0.5 * 4.0) * 1.25, 1e-12); /* in series: tau_i 16, tau_d 4 */
    assert_near(t.tau_i, 20.0, 1e-12);
    assert_near(t.tau_d, 4.0 / 1.25, 1e-12);
}

/* A lead as long as a lag takes it away; a longer one makes the gain so much larger besides. */
static void a_lead_takes_the_lag_behind_an_integrator(void **state)
{
    static const struct {
        double tau, zero, gain, left;
    } of[] = {{0.5, 0.2, 1.0, 0.3},
              {0.5, 0.5, 1.0, 0.0},
              {0.5, 1.0, 2.0, 0.0},
              {4.0, 6.0, 1.5, 0.0},
              {0.0, 1.0, 1.0, 0.0}};
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct apc_transfer
            g = {.gain = 0.7, .tau = {of[i].tau}, .zero = of[i].zero, .dead_time = 2.0, .integrating = true},
            like = {.gain = 0.7 * of[i].gain, .tau = {of[i].left}, .dead_time = 2.0, .integrating = true};
        for (int derivative = 0; derivative < 2; derivative++) {
            struct apc_pid_tuning t, same;

            assert_int_equal(apc_tune_pid(&g, APC_TUNE_SIMC, derivative, 3.0, 0.0, &t, NULL), 0);
            assert_int_equal(apc_tune_pid(&like, APC_TUNE_SIMC, derivative, 3.0, 0.0, &same, NULL), 0);
            assert_near(t.Kp, same.Kp, 1e-12);
            assert_near(t.tau_i, same.tau_i, 1e-12);
            assert_near(t.tau_d, same.tau_d, 1e-12);
        }
    }
}

static void lambda_keeps_the_time_constant(void **state)
{
    static const struct apc_transfer slow = {.gain = 1.0, .tau = {100.0}, .dead_time = 1.0};
    struct apc_pid_tuning simc, lambda;
    (void)state;

    assert_int_equal(apc_tune_pid(&slow, APC_TUNE_SIMC, false, 0.0, 0.0, &simc, NULL), 0);
    assert_int_equal(apc_tune_pid(&slow, APC_TUNE_LAMBDA, false, 0.0, 0.0, &lambda, NULL), 0);
    assert_near(simc.tau_i, 8.0, 1e-12);
    assert_near(lambda.tau_i, 100.0, 1e-12);
    assert_near(simc.Kp, lambda.Kp, 1e-12);
    assert_int_equal(apc_tune_pid(&slow, APC_TUNE_LAMBDA, false, 0.0, 1.0, &lambda, NULL), 0);
    assert_near(lambda.Kp, 100.0 / 3.0, 1e-12); /* half a period of dead time, twice */
}

/* The loop of a lag and P control, where all can be written down: L = 4 e^(-s) / (s + 1). */
/* Promise(identification/simc-lambda-tunings) */
static void margins_are_where_the_loop_begins_to_oscillate(void **state)
{
    const struct apc_transfer g = {.gain = 1.0, .tau = {1.0}, .dead_time = 1.0};
    const struct apc_pid_tuning calm = {.Kp = 1.5}, wild = {.Kp = 4.0};
    struct apc_margins m = {.size = sizeof m};
    const double w = 2.0287578381, limit = sqrt(1.0 + w * w); /* tan w = -w; Kp may be that */
    const double crossing = sqrt(1.5 * 1.5 - 1.0);
    (void)state;

    assert_int_equal(apc_tune_margins(&g, &calm, 0.0, &m, NULL), 0);
    assert_true(m.stable);
    assert_near(m.gain, limit / 1.5, 1e-4);
    assert_near(m.delay, (M_PI - atan(crossing)) / crossing - 1.0, 1e-3);
    assert_int_equal(apc_tune_margins(&g, &wild, 0.0, &m, NULL), 0);
    assert_false(m.stable);
    assert_int_equal(apc_tune_margins(&g, &(struct apc_pid_tuning){.Kp = -1.5}, 0.0, &m, NULL), 0);
    assert_false(m.stable);

    m = (struct apc_margins){.size = offsetof(struct apc_margins, phase),
                             .phase = 7.0}; /* an older caller's */
    assert_int_equal(apc_tune_margins(&g, &calm, 0.0, &m, NULL), 0);
    assert_near(m.gain, limit / 1.5, 1e-4);
    assert_near(m.phase, 7.0, 0.0);
}

static struct apc_pid_tuning simc(struct apc_transfer g, bool derivative)
{
    struct apc_pid_tuning t;

    assert_int_equal(apc_tune_pid(&g, APC_TUNE_SIMC, derivative, 3.0, 0.0, &t, NULL), 0);
    return t;
}

/* An answer the wrong way is dead time. A lead is taken from the lag that is next to it; one that is slower
 * than all lags is gain. */
static void zeros_are_taken_for_dead_time_for_less_of_a_lag_or_for_gain(void **state)
{
    struct apc_pid_tuning t, same;
    (void)state;

    t = simc((struct apc_transfer){.gain = 2.0, .zero = -1.5, .tau = {10.0}, .dead_time = 1.0}, false);
    same = simc((struct apc_transfer){.gain = 2.0, .tau = {10.0}, .dead_time = 2.5}, false);
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_i, same.tau_i, 1e-12);
    t = simc((struct apc_transfer){.gain = 2.0, .zero = 3.0, .tau = {10.0, 4.0}, .dead_time = 1.0}, true);
    same = simc((struct apc_transfer){.gain = 2.0, .tau = {10.0, 1.0}, .dead_time = 1.0}, true);
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_d, same.tau_d, 1e-12);
    t = simc((struct apc_transfer){.gain = 2.0, .zero = 4.0, .tau = {10.0, 4.0}, .dead_time = 1.0}, true);
    same = simc((struct apc_transfer){.gain = 2.0, .tau = {10.0}, .dead_time = 1.0}, true); /* it cancels */
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_i, same.tau_i, 1e-12);
    assert_near(t.tau_d, 0.0, 1e-12);
    t = simc((struct apc_transfer){.gain = 2.0, .zero = 10.0, .tau = {10.0, 4.0}, .dead_time = 1.0}, true);
    same = simc((struct apc_transfer){.gain = 2.0, .tau = {4.0}, .dead_time = 1.0}, true);
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_i, same.tau_i, 1e-12);
    assert_near(t.tau_d, 0.0, 1e-12);
    t = simc((struct apc_transfer){.gain = 2.0, .zero = 20.0, .tau = {10.0, 4.0}, .dead_time = 1.0}, false);
    same =
        simc((struct apc_transfer){.gain = 4.0, .tau = {4.0}, .dead_time = 1.0}, false); /* twice the gain */
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_i, same.tau_i, 1e-12);
    t = simc(
        (struct apc_transfer){.gain = 0.5, .zero = 1.0, .tau = {4.0}, .dead_time = 1.0, .integrating = true},
        true);
    same =
        simc((struct apc_transfer){.gain = 0.5, .tau = {3.0}, .dead_time = 1.0, .integrating = true}, true);
    assert_near(t.Kp, same.Kp, 1e-12);
    assert_near(t.tau_d, same.tau_d, 1e-12);
    t = simc(
        (struct apc_transfer){.gain = 0.5, .zero = 5.0, .tau = {4.0}, .dead_time = 1.0, .integrating = true},
        true);
    same = simc((struct apc_transfer){.gain = 0.625, .dead_time = 1.0, .integrating = true}, true);
    assert_near(t.Kp, same.Kp, 1e-12);
    t = simc((struct apc_transfer){.gain = 0.5, .zero = 5.0, .dead_time = 1.0, .integrating = true}, true);
    same = simc((struct apc_transfer){.gain = 0.5, .dead_time = 1.0, .integrating = true}, true);
    assert_near(t.Kp, same.Kp, 1e-12);
}

static double complex loop(const struct apc_transfer *g, const struct apc_pid_tuning *t, double period,
                           double w)
{
    const double complex s = w * (double complex)I;
    double complex L = g->gain * (g->zero * s + 1.0) / ((g->tau[0] * s + 1.0) * (g->tau[1] * s + 1.0));

    L *= cexp(-(g->dead_time + period / 2.0) * s) * t->Kp *
         (1.0 + t->tau_d * s + (t->tau_i > 0.0 ? 1.0 / (t->tau_i * s) : 0.0));
    return g->integrating ? L / s : L;
}

/* Margins, looked for on the curve itself. */
static struct apc_margins look(const struct apc_transfer *g, const struct apc_pid_tuning *t, double period)
{
    struct apc_margins m = {.gain = HUGE_VAL, .phase = HUGE_VAL, .delay = HUGE_VAL};
    double complex before = loop(g, t, period, 1e-4);

    for (double w = 1e-4; w < 100.0; w *= 1.0001) {
        const double complex L = loop(g, t, period, w);
        const double angle = carg(-L), back = angle < 0.0 ? angle + 2.0 * M_PI : angle;

        m.sensitivity = fmax(m.sensitivity, 1.0 / cabs(1.0 + L));
        if ((cabs(L) < 1.0) != (cabs(before) < 1.0)) {
            m.phase = fmin(m.phase, fabs(angle) * 180.0 / M_PI);
            m.delay = fmin(m.delay, back / w);
        }
        if ((cimag(L) < 0.0) != (cimag(before) < 0.0) && creal(L) < 0.0 && cabs(L) < 1.0)
            m.gain = fmin(m.gain, 1.0 / cabs(L));
        before = L;
    }
    return m;
}

static void margins_are_those_of_the_curve_whatever_the_loop_is_made_of(void **state)
{
    static const struct {
        struct apc_transfer g;
        struct apc_pid_tuning t;
        double period;
    } of[] = {
        {{.gain = 2.0, .tau = {5.0, 2.0}, .zero = 1.0, .dead_time = 1.5}, {1.0, 6.0, 1.0}, 0.0},
        {{.gain = 2.0, .tau = {5.0, 2.0}, .zero = -1.0, .dead_time = 1.5}, {0.6, 6.0, 0.5}, 1.0},
        {{.gain = -2.0, .tau = {5.0, 2.0}, .dead_time = 0.5}, {-1.0, 4.0, 0.0}, 2.0},
        {{.gain = 0.3, .tau = {2.0, 0.0}, .dead_time = 1.0, .integrating = true}, {0.8, 20.0, 1.5}, 0.5},
        {{.gain = 0.3, .tau = {2.0, 0.5}, .dead_time = 1.0, .integrating = true}, {0.8, 0.0, 1.5}, 0.5},
        {{.gain = 1.0, .tau = {8.0}, .dead_time = 3.0}, {2.0, 0.0, 0.0}, 0.0},
    };
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct apc_margins is = look(&of[i].g, &of[i].t, of[i].period);
        struct apc_margins m = {.size = sizeof m};

        assert_int_equal(apc_tune_margins(&of[i].g, &of[i].t, of[i].period, &m, NULL), 0);
        assert_true(m.stable);
        assert_near(m.gain, is.gain, 1e-3 * is.gain);
        assert_near(m.phase, is.phase, 1e-3 * is.phase);
        assert_near(m.delay, is.delay, 1e-3 * is.delay);
        assert_near(m.sensitivity, is.sensitivity, 1e-3 * is.sensitivity);
    }
}

/* Twice the gain margin is not stable any more, nor is twice the delay that it can bear. */
static void beyond_its_margins_a_loop_is_not_stable(void **state)
{
    static const struct apc_transfer g = {
        .gain = 0.3, .tau = {2.0, 0.5}, .dead_time = 1.0, .integrating = true};
    struct apc_pid_tuning t = {0.5, 20.0, 1.5};
    struct apc_transfer late = g;
    struct apc_margins m = {.size = sizeof m}, beyond = m;
    (void)state;

    assert_int_equal(apc_tune_margins(&g, &t, 0.0, &m, NULL), 0);
    assert_true(m.stable);
    for (int i = 0; i < 2; i++) {
        const double by = i == 0 ? 0.99 : 1.01;
        const struct apc_pid_tuning more = {t.Kp * (1.0 + by * (m.gain - 1.0)), t.tau_i, t.tau_d};

        assert_int_equal(apc_tune_margins(&g, &more, 0.0, &beyond, NULL), 0);
        assert_int_equal(beyond.stable, i == 0);
        late.dead_time = g.dead_time + by * m.delay;
        assert_int_equal(apc_tune_margins(&late, &t, 0.0, &beyond, NULL), 0);
        assert_int_equal(beyond.stable, i == 0);
    }
}

static void what_has_no_margins_is_refused(void **state)
{
    static const struct apc_transfer g = {.gain = 1.0, .tau = {1.0}}, gain = {.gain = 1.0};
    static const struct apc_transfer wrong[] = {{.gain = 1.0, .tau = {-1.0}, .dead_time = 1.0},
                                                {.gain = 1.0, .tau = {1.0, -1.0}, .dead_time = 1.0},
                                                {.gain = 1.0, .tau = {1.0}, .dead_time = -1.0},
                                                {.gain = 0.0, .tau = {1.0}}};
    static const struct apc_pid_tuning p = {.Kp = 1.0}, bad[] = {{.Kp = 0.0},
                                                                 {.Kp = 1.0, .tau_i = -1.0},
                                                                 {.Kp = 1.0, .tau_d = -1.0},
                                                                 {.Kp = (double)INFINITY}};
    struct apc_margins m = {.size = sizeof m};
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_tune_margins(&g, &p, 0.0, &m, &why), 0);
    assert_int_equal(apc_tune_margins(&g, &p, -1.0, &m, &why), APC_EINVAL);
    assert_int_equal(apc_tune_margins(&gain, &p, 0.0, &m, &why), APC_EINVAL); /* nothing takes any time */
    assert_int_equal(apc_tune_margins(&gain, &p, 1.0, &m, &why), 0);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct apc_pid_tuning t;
        assert_int_equal(apc_tune_margins(&wrong[i], &p, 0.0, &m, &why), APC_EINVAL);
        assert_int_equal(apc_tune_pid(&wrong[i], APC_TUNE_SIMC, false, 1.0, 0.0, &t, &why), APC_EINVAL);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(apc_tune_margins(&g, &bad[i], 0.0, &m, &why), APC_EINVAL);
}

static void what_no_rule_is_for_is_refused(void **state)
{
    struct apc_pid_tuning t;
    struct apc_error why;
    const struct apc_transfer none = {.tau = {1.0}}, gain = {.gain = 1.0, .dead_time = 1.0},
                              prompt = {.gain = 1.0, .tau = {1.0}},
                              level = {.gain = 1.0, .integrating = true, .dead_time = 1.0},
                              broken = {.gain = (double)NAN, .tau = {1.0}, .dead_time = 1.0};
    (void)state;

    assert_int_equal(apc_tune_pid(&none, APC_TUNE_SIMC, false, 1.0, 0.0, &t, &why), APC_EINVAL);
    assert_int_equal(apc_tune_pid(&broken, APC_TUNE_SIMC, false, 1.0, 0.0, &t, &why), APC_EINVAL);
    assert_int_equal(apc_tune_pid(&gain, APC_TUNE_SIMC, false, 1.0, 0.0, &t, &why), APC_EINVAL);
    assert_has(why.text, "no lag");
    assert_int_equal(apc_tune_pid(&prompt, APC_TUNE_SIMC, false, 0.0, 0.0, &t, &why), APC_EINVAL);
    assert_has(why.text, "tau_c");
    assert_int_equal(apc_tune_pid(&prompt, APC_TUNE_SIMC, false, 0.0, 0.5, &t, &why), 0);
    assert_int_equal(apc_tune_pid(&level, APC_TUNE_LAMBDA, false, 0.0, 0.0, &t, &why), APC_EINVAL);
    assert_int_equal(apc_tune_pid(&level, APC_TUNE_SIMC, false, -1.0, 0.0, &t, &why), APC_EINVAL);
    assert_int_equal(apc_tune_pid(&level, APC_TUNE_SIMC, false, (double)NAN, 0.0, &t, &why), APC_EINVAL);
    assert_int_equal(apc_tune_pid(&level, APC_TUNE_SIMC, false, 1.0, -1.0, &t, &why), APC_EINVAL);
}

/* e^-s / (s + 1) to a gain: -180 degrees where tan w = -w, w 2.02876. */
/*
 * Promise(identification/apc-tune-suggest-tunings): `apc tune --suggest`: tunings by SIMC, lambda and from
 *   the loop's limit, of a run or of a model file, which do in simulation what is predicted; written only
 *   by `--apply`, as one write.
 */
static void a_relay_tuning_is_that_of_the_limit(void **state)
{
    static const struct apc_transfer g = {.gain = -2.0, .tau = {1.0}, .dead_time = 1.0},
                                     lag = {.gain = 2.0, .tau = {1.0}};
    struct apc_pid_tuning t;
    struct apc_margins m = {.size = sizeof m};
    double gain, every;
    (void)state;

    assert_int_equal(apc_tune_limit(&g, 0.0, &gain, &every, NULL), 0);
    assert_near(2.0 * M_PI / every, 2.028758, 1e-6);
    assert_near(gain, -sqrt(1.0 + 2.028758 * 2.028758) / 2.0, 1e-6);
    assert_int_equal(apc_tune_relay(gain, every, true, &t, NULL), 0);
    assert_int_equal(apc_tune_margins(&g, &t, 0.0, &m, NULL), 0);
    assert_true(m.stable);
    assert_true(m.phase <= 45.1); /* at the limit's frequency it is that, and it may be less at another one */
    assert_near(t.tau_i, 4.0 * t.tau_d, 1e-12);
    assert_int_equal(apc_tune_relay(gain, every, false, &t, NULL), 0);
    assert_near(t.Kp, gain / 3.2, 1e-12);
    assert_int_equal(apc_tune_margins(&g, &t, 0.0, &m, NULL), 0);
    assert_true(m.stable && m.phase > 45.0);
    assert_int_equal(apc_tune_limit(&lag, 0.0, &gain, &every, NULL), APC_EINVAL);
    assert_int_equal(apc_tune_relay(0.0, 1.0, true, &t, NULL), APC_EINVAL);
    assert_int_equal(apc_tune_relay(1.0, 0.0, true, &t, NULL), APC_EINVAL);
}

/* Time and units are the plant's own: what is a thousand times as fast, or as large, has the same tuning in
 * these. */
static void a_tuning_knows_no_unit_of_time_or_gain(void **state)
{
    static const struct apc_transfer plants[] = {
        {.gain = 2.0, .tau = {3.0, 1.0}, .dead_time = 0.5},
        {.gain = 0.4, .tau = {3.0, 2.0}, .zero = 0.7, .dead_time = 0.5},
        {.gain = 0.4, .tau = {5.0}, .zero = -0.6, .dead_time = 0.5},
        {.gain = 0.3, .tau = {2.0}, .integrating = true, .dead_time = 1.5}};
    static const double times[] = {1e-3, 1e3}, gains[] = {-1e-3, 1e3};
    (void)state;

    for (size_t i = 0; i < 4 * 2 * 2 * 2 * 2; i++) {
        const struct apc_transfer *g = &plants[i / 16];
        const double time = times[i / 8 % 2], gain = gains[i / 4 % 2];
        const bool derivative = i / 2 % 2;
        const enum apc_tune_rule rule = i % 2 && !g->integrating ? APC_TUNE_LAMBDA : APC_TUNE_SIMC;
        struct apc_transfer scaled = {.gain = g->integrating ? g->gain * gain / time : g->gain * gain,
                                      .tau = {g->tau[0] * time, g->tau[1] * time},
                                      .zero = g->zero * time,
                                      .dead_time = g->dead_time * time,
                                      .integrating = g->integrating};
        struct apc_pid_tuning a, b;
        struct apc_margins m = {.size = sizeof m}, n = {.size = sizeof n};
        double limit[2], every[2];

        assert_int_equal(apc_tune_pid(g, rule, derivative, 2.0, 0.2, &a, NULL), 0);
        assert_int_equal(apc_tune_pid(&scaled, rule, derivative, 2.0 * time, 0.2 * time, &b, NULL), 0);
        assert_near(b.Kp * gain, a.Kp, 1e-9 * fabs(a.Kp));
        assert_near(b.tau_i / time, a.tau_i, 1e-9 * a.tau_i);
        assert_near(b.tau_d / time, a.tau_d, 1e-9);
        assert_int_equal(apc_tune_margins(g, &a, 0.2, &m, NULL), 0);
        assert_int_equal(apc_tune_margins(&scaled, &b, 0.2 * time, &n, NULL), 0);
        assert_true(m.stable && n.stable);
        assert_near(n.gain, m.gain, 1e-6 * m.gain);
        assert_near(n.phase, m.phase, 1e-4);
        assert_near(n.delay / time, m.delay, 1e-6 * m.delay);
        assert_near(n.sensitivity, m.sensitivity, 1e-6);
        assert_int_equal(apc_tune_limit(g, 0.2, &limit[0], &every[0], NULL), 0);
        assert_int_equal(apc_tune_limit(&scaled, 0.2 * time, &limit[1], &every[1], NULL), 0);
        assert_near(limit[1] * gain, limit[0], 1e-6 * fabs(limit[0]));
        assert_near(every[1] / time, every[0], 1e-6 * every[0]);
        assert_int_equal(apc_tune_relay(limit[0], every[0], derivative, &a, NULL), 0);
        assert_int_equal(apc_tune_relay(limit[1], every[1], derivative, &b, NULL), 0);
        assert_near(b.Kp * gain, a.Kp, 1e-6 * fabs(a.Kp));
        assert_near(b.tau_i / time, a.tau_i, 1e-6 * a.tau_i);
        assert_near(b.tau_d / time, a.tau_d, 1e-6);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_tuning_knows_no_unit_of_time_or_gain),
        cmocka_unit_test(a_relay_tuning_is_that_of_the_limit),
        cmocka_unit_test(simc_has_the_margins_of_its_table),
        cmocka_unit_test(a_second_lag_is_for_the_derivative_or_counts_by_halves),
        cmocka_unit_test(a_lag_behind_an_integrator_is_a_second_one),
        cmocka_unit_test(a_lead_takes_the_lag_behind_an_integrator),
        cmocka_unit_test(lambda_keeps_the_time_constant),
        cmocka_unit_test(margins_are_where_the_loop_begins_to_oscillate),
        cmocka_unit_test(zeros_are_taken_for_dead_time_for_less_of_a_lag_or_for_gain),
        cmocka_unit_test(margins_are_those_of_the_curve_whatever_the_loop_is_made_of),
        cmocka_unit_test(beyond_its_margins_a_loop_is_not_stable),
        cmocka_unit_test(what_has_no_margins_is_refused),
        cmocka_unit_test(what_no_rule_is_for_is_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
