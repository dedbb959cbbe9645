/* SPDX-License-Identifier: BSD-3-Clause */
#include "apctune.h"

#include <apcmath.h>
#include <complex.h>

#include <math.h>

#include "base/base_internal.h"

#define POINTS 4000 /* of frequency, 7 decades */

/* ---- Rules --------------------------------------------------------------------------------------------- */

/* What is left of a plant for a rule: gain e^(-theta s) / ((tau1 s + 1) (tau2 s + 1)); integrating: tau1 is
 * 1/s. */
struct reduced {
    double gain, tau1, tau2, theta;
};

static int check_tuning_request(const struct apc_transfer *g, double period, struct apc_error *why)
{
    const double number[] = {g->gain, g->zero, g->tau[0], g->tau[1], g->dead_time, period};

    if (!apc_values_ok(number, 6) || g->gain == 0.0 || g->tau[0] < 0.0 || g->tau[1] < 0.0 ||
        g->dead_time < 0.0 || period < 0.0)
        return apc_fail(why, APC_EINVAL,
                        "tune: the gain must not be 0, time constants, dead time and period not negative");
    return 0;
}

/* Half of a lag that is neglected counts as dead time, half goes to the one before it; an answer the wrong
 * way is dead time; a lead takes from the lag that is nearest to it, or makes the gain larger. */
static struct reduced reduce_half_rule(const struct apc_transfer *g, bool derivative, double period)
{
    struct reduced r = {g->gain, fmax(g->tau[0], g->tau[1]), fmin(g->tau[0], g->tau[1]),
                        g->dead_time + period / 2.0};

    if (g->integrating) {
        r.tau2 = r.tau1;
        r.tau1 = 0.0;
    }
    if (g->zero < 0.0) {
        r.theta -= g->zero;
    } else if (g->zero > 0.0) {
        double *lag = r.tau2 >= g->zero || r.tau1 == 0.0 ? &r.tau2 : &r.tau1;

        if (*lag > g->zero) {
            *lag -= g->zero;
        } else if (*lag > 0.0) {
            r.gain *= g->zero / *lag;
            *lag = 0.0;
        }
        if (!g->integrating && r.tau2 > r.tau1) { /* what is left of the two comes first */
            const double shorter = r.tau1;

            r.tau1 = r.tau2;
            r.tau2 = shorter;
        }
    }
    if (!derivative) {
        r.theta += r.tau2 / 2.0;
        r.tau1 += g->integrating ? 0.0 : r.tau2 / 2.0;
        r.tau2 = 0.0;
    }
    return r;
}

int apc_tune_pid(const struct apc_transfer *g, enum apc_tune_rule rule, bool derivative, double tau_c,
                 double period, struct apc_pid_tuning *tuning, struct apc_error *why)
{
    struct reduced r;
    double speed, Kp, tau_i;

    if (check_tuning_request(g, period, why) < 0)
        return APC_EINVAL;
    r = reduce_half_rule(g, derivative, period);
    speed = r.theta + (tau_c > 0.0 ? tau_c : r.theta);
    if (!(tau_c >= 0.0 && tau_c < APC_VALUE_MAX) || !(speed > 0.0))
        return apc_fail(why, APC_EINVAL,
                        "tune: the plant has no dead time: tau_c must say how fast the loop is to be");
    if (!g->integrating && !(r.tau1 > 0.0))
        return apc_fail(why, APC_EINVAL, "tune: the plant has no lag: an integrator alone controls it");
    if (g->integrating && rule == APC_TUNE_LAMBDA)
        return apc_fail(why, APC_EINVAL,
                        "tune: there is no lambda tuning for an integrating plant: use SIMC");
    Kp = (g->integrating ? 1.0 : r.tau1) / (r.gain * speed);
    tau_i = rule == APC_TUNE_LAMBDA ? r.tau1 : g->integrating ? 4.0 * speed : fmin(r.tau1, 4.0 * speed);
    /* SIMC is of the series form (1 + 1/(tau_i s)) (1 + tau_d s). */
    *tuning = (struct apc_pid_tuning){
        .Kp = Kp * (1.0 + r.tau2 / tau_i), .tau_i = tau_i + r.tau2, .tau_d = r.tau2 / (1.0 + r.tau2 / tau_i)};
    return 0;
}

/* ---- Margins ------------------------------------------------------------------------------------------- */

/* Magnitude, and phase in rad, which goes on where complex numbers would begin anew. */
static void loop_at(const struct apc_transfer *g, const struct apc_pid_tuning *t, double period, double w,
                    double *magnitude, double *phase)
{
    const double real = 1.0 - (t->tau_i > 0.0 ? t->tau_d * t->tau_i * w * w : 0.0),
                 imaginary = w * (t->tau_i > 0.0 ? t->tau_i : t->tau_d);

    *magnitude = fabs(g->gain * t->Kp) * apc_hypot(real, imaginary) * apc_hypot(1.0, g->zero * w) /
                 (apc_hypot(1.0, g->tau[0] * w) * apc_hypot(1.0, g->tau[1] * w));
    *phase = apc_atan2(imaginary, real) + apc_atan(g->zero * w) - apc_atan(g->tau[0] * w) -
             apc_atan(g->tau[1] * w) - w * (g->dead_time + period / 2.0);
    if (t->tau_i > 0.0) {
        *magnitude /= t->tau_i * w;
        *phase -= M_PI_2;
    }
    if (g->integrating) {
        *magnitude /= w;
        *phase -= M_PI_2;
    }
    if (g->gain * t->Kp < 0.0)
        *phase -= M_PI;
}

int apc_tune_limit(const struct apc_transfer *g, double period, double *gain, double *every,
                   struct apc_error *why)
{
    const struct apc_pid_tuning alone = {.Kp = g->gain < 0.0 ? -1.0 : 1.0};
    const double all = g->tau[0] + g->tau[1] + g->dead_time + period;
    double low = 1e-6 / all, high = 1e6 / all, m, p;

    if (check_tuning_request(g, period, why) < 0)
        return APC_EINVAL;
    loop_at(g, &alone, period, high, &m, &p);
    if (!(p < -M_PI))
        return apc_fail(why, APC_EINVAL, "tune: no gain makes this loop oscillate: it has no dead time");
    for (int i = 0; i < 200; i++) {
        const double w = sqrt(low * high);
        loop_at(g, &alone, period, w, &m, &p);
        *(p < -M_PI ? &high : &low) = w;
    }
    *gain = alone.Kp / m;
    *every = 2.0 * M_PI / low;
    return 0;
}

int apc_tune_relay(double gain, double every, bool derivative, struct apc_pid_tuning *t,
                   struct apc_error *why)
{
    const double number[] = {gain, every};

    if (!apc_values_ok(number, 2) || gain == 0.0 || !(every > 0.0))
        return apc_fail(why, APC_EINVAL, "tune: the limit's gain must not be 0, its period above 0");
    *t = (struct apc_pid_tuning){.Kp = gain / 3.2, .tau_i = 2.2 * every};
    if (derivative) { /* tan 45 = 1: w tau_d - 1 / (w tau_i) = 1 where w is the limit's frequency */
        const double tau_d = (1.0 + sqrt(2.0)) / 2.0 * every / (2.0 * M_PI);
        *t = (struct apc_pid_tuning){.Kp = gain * sqrt(0.5), .tau_i = 4.0 * tau_d, .tau_d = tau_d};
    }
    return 0;
}

/* How often the curve has gone round -1 so far, in rad, and what was met on the way. */
struct sweep {
    double turned, last; /* 1 + L, since frequency 0; its angle */
    struct apc_margins *margins;
};

static void meet(struct sweep *s, double w0, double m0, double p0, double w1, double m1, double p1)
{
    const double back = p0 + M_PI, turns0 = floor(back / (2.0 * M_PI)),
                 turns1 = floor((p1 + M_PI) / (2.0 * M_PI));

    if (turns0 != turns1) { /* -180 degrees, or a turn away from it */
        const double at = 2.0 * M_PI * fmax(turns0, turns1) - M_PI, share = (p0 - at) / (p0 - p1),
                     m = apc_exp(apc_log(m0) + share * (apc_log(m1) - apc_log(m0)));

        if (m < 1.0)
            s->margins->gain = fmin(s->margins->gain, 1.0 / m);
    }
    if ((m0 >= 1.0) != (m1 >= 1.0)) {
        const double share = apc_log(m0) / (apc_log(m0) - apc_log(m1)), p = p0 + share * (p1 - p0),
                     w = w0 * apc_pow(w1 / w0, share),
                     phase = p + M_PI - 2.0 * M_PI * floor((p + M_PI) / (2.0 * M_PI));

        s->margins->phase = fmin(s->margins->phase, fmin(phase, 2.0 * M_PI - phase) * 180.0 / M_PI);
        s->margins->delay = fmin(s->margins->delay, phase / w);
    }
}

static void follow_phase(struct sweep *s, double magnitude, double phase)
{
    const double re = 1.0 + magnitude * apc_cos(phase), im = magnitude * apc_sin(phase),
                 angle = apc_atan2(im, re);
    double step = angle - s->last;

    step -= 2.0 * M_PI * round(step / (2.0 * M_PI));
    s->turned += step;
    s->last = angle;
    s->margins->sensitivity = fmax(s->margins->sensitivity, 1.0 / apc_hypot(re, im));
}

/*
 * From far below to far above all there is. The plant has no pole to the right, so the loop is stable where 1
 * + L has turned by nothing in all, the quarter turn to the right that each integrator makes at first among
 * it.
 */
int apc_tune_margins(const struct apc_transfer *g, const struct apc_pid_tuning *tuning, double period,
                     struct apc_margins *margins, struct apc_error *why)
{
    const double number[] = {tuning->Kp, tuning->tau_i, tuning->tau_d};
    const double late = g->dead_time + period / 2.0,
                 all = g->tau[0] + g->tau[1] + late + tuning->tau_i + tuning->tau_d,
                 integrators = (double)g->integrating + (tuning->tau_i > 0.0);
    struct apc_margins found = {.gain = HUGE_VAL, .phase = HUGE_VAL, .delay = HUGE_VAL};
    struct sweep s = {.margins = &found};
    double m0 = 0.0, p0 = 0.0, w0 = 0.0, lowest, shortest = HUGE_VAL;
    const double times[] = {g->tau[0], g->tau[1], late, tuning->tau_i, tuning->tau_d};

    if (check_tuning_request(g, period, why) < 0)
        return APC_EINVAL;
    if (!apc_values_ok(number, 3) || tuning->Kp == 0.0 || tuning->tau_i < 0.0 || tuning->tau_d < 0.0 ||
        !(all > 0.0))
        return apc_fail(why, APC_EINVAL, "tune: Kp must not be 0, tau_i and tau_d not negative");
    for (size_t i = 0; i < sizeof times / sizeof *times; i++)
        shortest = times[i] > 0.0 ? fmin(shortest, times[i]) : shortest;
    lowest = 1e-4 / all;
    for (int i = 0; i <= POINTS; i++) {
        const double w = lowest * apc_pow(100.0 / shortest / lowest, (double)i / POINTS);
        double m, p;

        loop_at(g, tuning, period, w, &m, &p);
        if (i == 0) {
            s.last = apc_atan2(m * apc_sin(p), 1.0 + m * apc_cos(p));
            s.turned = -integrators * M_PI_2;
        } else {
            meet(&s, w0, m0, p0, w, m, p);
        }
        follow_phase(&s, m, p);
        m0 = m;
        p0 = p;
        w0 = w;
    }
    found.stable = fabs(s.turned) < M_PI_2;
    apc_result_copy(margins, &found, sizeof found);
    return 0;
}
