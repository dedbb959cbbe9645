/* SPDX-License-Identifier: BSD-3-Clause */
/* Loops small enough for their poles, margins, peaks and costs to be written down. */
#include <complex.h>
#include <stdlib.h>

#include "check.h"

#include "apcanalysis.h"
#include "apcbase.h"

#define MS ((apc_ns)1000000)
#define J  ((double complex)I)

/* ---- Integrators, and what moves them every second ----------------------------------------------------- */

static const double zero[4], eye[4] = {1.0, 0.0, 0.0, 1.0};
static const struct apc_loop_source measured[2] = {{APC_FROM_MEASUREMENT, 0}, {APC_FROM_MEASUREMENT, 1}};
static const size_t to[2] = {0, 1};

static struct apc_loop_setup setup_of(const struct apc_loop_controller *c, size_t n,
                                      const struct apc_loop_tick *tick, size_t n_ticks)
{
    return (struct apc_loop_setup){
        .size = sizeof(struct apc_loop_setup),
        .plant = {.nx = 1, .nu = 1, .ny = 1, .A = zero, .B = eye, .C = eye, .D = zero, .period = 100 * MS},
        .n_controllers = n,
        .controller = c,
        .period = 1000 * MS,
        .n_ticks = n_ticks,
        .tick = tick};
}

static struct apc_loop *made(const struct apc_loop_setup *setup)
{
    struct apc_loop *loop;
    struct apc_error why;

    if (apc_loop_create(&loop, setup, &why) < 0)
        fail_msg("%s", why.text);
    return loop;
}

/* u = -K (x + its sensor's error), noise in both. */
static struct apc_loop *noisy(double K, apc_ns acts, double noise, double sensor)
{
    const double D = -K;
    const struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = measured, .to = to};
    const struct apc_loop_tick tick = {0, 0, 0, 0, acts};
    struct apc_loop_setup setup = setup_of(&c, 1, &tick, 1);

    setup.plant.noise = &noise;
    setup.plant.sensor = &sensor;
    return made(&setup);
}

/* ---- Poles --------------------------------------------------------------------------------------------- */

/* Those of a polynomial, its highest coefficient first; the rest are 0. The largest comes first. */
static void assert_poles(const struct apc_loop_setup *setup, const double *polynomial, size_t degree)
{
    struct apc_loop *loop = made(setup);
    const size_t n = apc_loop_states(loop);
    double re[40], im[40];

    assert_true(n <= 40);
    assert_int_equal(apc_loop_poles(loop, re, im), 0);
    for (size_t k = 0; k < n; k++) {
        double complex p = 0.0;

        for (size_t i = 0; i <= degree; i++)
            p = p * (re[k] + im[k] * J) + polynomial[i];
        assert_near(k < degree ? cabs(p) : hypot(re[k], im[k]), 0.0, 1e-6);
        assert_true(k == 0 || hypot(re[k], im[k]) <= hypot(re[k - 1], im[k - 1]) + 1e-12);
    }
    apc_loop_destroy(loop);
}

static void what_a_controller_did_before_counts(void **state)
{
    const double a = 0.3, K = 0.6, D[2] = {-K, a};
    const struct apc_loop_source in[2] = {{APC_FROM_MEASUREMENT, 0}, {APC_FROM_OWN, 0}};
    const struct apc_loop_controller c = {.n_in = 2, .nu = 1, .D = D, .in = in, .to = to};
    struct apc_loop_tick tick = {0, 0, 0, 0, 0};
    struct apc_loop_setup setup = setup_of(&c, 1, &tick, 1);
    (void)state;

    /* u = a u' - K x */
    assert_poles(&setup, (const double[]){1.0, K - 1.0 - a, a}, 2);
    tick.acts = 1000 * MS; /* a period later: z (z - 1) (z - a) + K z */
    assert_poles(&setup, (const double[]){1.0, -1.0 - a, a + K}, 2);
    tick.acts = 2500 * MS; /* z^2 (z - 1) (z - a) + K (z + 1) / 2 */
    assert_poles(&setup, (const double[]){1.0, -1.0 - a, a, K / 2.0, K / 2.0}, 4);
    tick.acts = 0;
    setup.plant.dead_time = 2500 * MS;
    assert_poles(&setup, (const double[]){1.0, -1.0 - a, a, K / 2.0, K / 2.0}, 4);
    setup.plant.dead_time = 0;
    tick.sampled = -1000 * MS; /* of the period before */
    assert_poles(&setup, (const double[]){1.0, -1.0 - a, a + K}, 2);
}

/* The one above adds up y and moves what the one below holds against it. */
static void one_controller_reads_what_another_has_written(void **state)
{
    const double K = 0.8, k2 = 0.1, one = 1.0, above = -k2, none = 0.0, D[2] = {-K, 1.0};
    const struct apc_loop_source in[2] = {{APC_FROM_MEASUREMENT, 0}, {APC_FROM_OUTPUT, 0}};
    const size_t nowhere = APC_LOOP_NOWHERE;
    const struct apc_loop_controller c[2] = {{.nx = 1,
                                              .n_in = 1,
                                              .nu = 1,
                                              .A = &one,
                                              .B = &one,
                                              .C = &above,
                                              .D = &none,
                                              .in = in,
                                              .to = &nowhere},
                                             {.n_in = 2, .nu = 1, .D = D, .in = in, .to = to}};
    struct apc_loop_tick tick[2] = {{0, 0, 0, 0, 0}, {1, 0, 0, 0, 0}};
    struct apc_loop_setup setup = setup_of(c, 2, tick, 2);
    (void)state;

    /* (z - 1 + K) (z - 1) + k2 */
    assert_poles(&setup, (const double[]){1.0, K - 2.0, 1.0 - K + k2}, 2);
    tick[0].written = 500 * MS; /* read a period later */
    assert_poles(&setup, (const double[]){1.0, K - 2.0, 1.0 - K, k2}, 3);
    tick[0].acts = 5000 * MS; /* of what goes to no plant it does not matter */
    assert_poles(&setup, (const double[]){1.0, K - 2.0, 1.0 - K, k2}, 3);
}

/* ---- Two inputs that act on both ----------------------------------------------------------------------- */

static const double coupling[4] = {1.0, 0.5, -0.3, 0.8}, gains[4] = {-0.4, -0.1, -0.2, -0.6};

static struct apc_loop *coupled(void)
{
    static const struct apc_loop_controller c = {.n_in = 2, .nu = 2, .D = gains, .in = measured, .to = to};
    static const struct apc_loop_tick tick = {0, 0, 0, 0, 0};
    struct apc_loop_setup setup = setup_of(&c, 1, &tick, 1);

    setup.plant = (struct apc_loop_plant){
        .nx = 2, .nu = 2, .ny = 2, .A = zero, .B = coupling, .C = eye, .D = zero, .period = 100 * MS};
    return made(&setup);
}

/* I + B diag(f) D: its trace, determinant and largest eigenvalue. */
static double map_of(const double complex f[2], double complex *trace, double complex *determinant)
{
    double complex M[4], root;

    for (int i = 0; i < 4; i++)
        M[i] = eye[i] + coupling[i / 2 * 2] * f[0] * gains[i % 2] +
               coupling[i / 2 * 2 + 1] * f[1] * gains[2 + i % 2];
    *trace = M[0] + M[3];
    *determinant = M[0] * M[3] - M[1] * M[2];
    root = csqrt(*trace * *trace - 4.0 * *determinant);
    return fmax(cabs(*trace + root), cabs(*trace - root)) / 2.0;
}

static bool is_stable(size_t of, double complex f)
{
    double complex trace, determinant;

    return map_of((const double complex[2]){of == 1 ? 1.0 : f, of == 0 ? 1.0 : f}, &trace, &determinant) <
           1.0;
}

static double limit(size_t of, bool angle)
{
    double good = angle ? 0.0 : 1.0, bad = good;

    while (is_stable(of, angle ? cexp(-J * bad) : bad))
        bad += 0.01;
    while (bad - good > 1e-9) {
        const double middle = (good + bad) / 2.0;

        *(is_stable(of, angle ? cexp(-J * middle) : middle) ? &good : &bad) = middle;
    }
    return good;
}

static void margins_of_coupled_loops_are_those_of_their_map(void **state)
{
    const size_t which[] = {0, 1, APC_LOOP_WHOLE};
    struct apc_loop *loop = coupled();
    (void)state;

    assert_int_equal(apc_loop_outputs(loop), 2);
    for (size_t k = 0; k < 3; k++) {
        struct apc_loop_margins m = {.size = sizeof m};

        assert_int_equal(apc_loop_margins(loop, which[k], NULL, &m, NULL), 0);
        assert_true(m.stable);
        assert_near(m.gain, limit(which[k], false), 1e-4);
        assert_near(m.phase, limit(which[k], true) * 180.0 / M_PI, 1e-2);
        assert_near(m.gain_low, 0.0, 0.0);
        assert_true(isnan(m.jitter) == (which[k] == APC_LOOP_WHOLE));
    }
    apc_loop_destroy(loop);
}

/* 1 + L at an output is det(z - M) over that with the output cut. */
static void a_response_is_that_of_the_loop_cut_open_there(void **state)
{
    const double w[] = {0.01, 0.3, 1.0, 3.0};
    struct apc_loop *loop = coupled();
    double re[4], im[4];
    (void)state;

    for (size_t of = 0; of < 2; of++) {
        assert_int_equal(apc_loop_response(loop, of, 4, w, re, im), 0);
        for (int k = 0; k < 4; k++) {
            const double complex z = cexp(J * w[k]), cut[2] = {of == 0 ? 0.0 : 1.0, of == 1 ? 0.0 : 1.0};
            double complex t, d, t_cut, d_cut, L;

            (void)map_of((const double complex[2]){1.0, 1.0}, &t, &d);
            (void)map_of(cut, &t_cut, &d_cut);
            L = (z * z - t * z + d) / (z * z - t_cut * z + d_cut) - 1.0;
            assert_near(re[k], creal(L), 1e-9 * cabs(L));
            assert_near(im[k], cimag(L), 1e-9 * cabs(L));
        }
    }
    assert_int_equal(apc_loop_response(loop, 2, 4, w, re, im), APC_EINVAL);
    apc_loop_destroy(loop);
}

static double largest_of(const double complex S[4])
{
    double sum = 0.0;

    for (int i = 0; i < 4; i++)
        sum += creal(S[i] * conj(S[i]));
    return sqrt((sum + sqrt(sum * sum - 4.0 * pow(cabs(S[0] * S[3] - S[1] * S[2]), 2.0))) / 2.0);
}

/* Of 1 / (1 + L), L = -D B / (z - 1), the outputs in these units; @p T: of L / (1 + L). */
static double peak_at(double w, const double scale[2], double *T)
{
    const double complex z = cexp(J * w);
    double complex R[4], S[4], d;

    for (int i = 0; i < 4; i++)
        R[i] = eye[i] - (gains[i / 2 * 2] * coupling[i % 2] + gains[i / 2 * 2 + 1] * coupling[2 + i % 2]) /
                            (z - 1.0) * scale[i % 2] / scale[i / 2];
    d = R[0] * R[3] - R[1] * R[2];
    S[0] = R[3] / d;
    S[1] = -R[1] / d;
    S[2] = -R[2] / d;
    S[3] = R[0] / d;
    const double peak = largest_of(S);
    for (int i = 0; i < 4; i++)
        S[i] = eye[i] - S[i];
    *T = largest_of(S);
    return peak;
}

static void peaks_of_all_outputs_are_largest_singular_values(void **state)
{
    const double scales[2][2] = {{1.0, 1.0}, {1.0, 5.0}};
    struct apc_loop *loop = coupled();
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct apc_loop_margins m = {.size = sizeof m};
        double S = 0.0, T = 0.0, t;

        for (double w = 0.01; w <= M_PI; w += 0.0005) {
            S = fmax(S, peak_at(w, scales[k], &t));
            T = fmax(T, t);
        }
        assert_int_equal(apc_loop_margins(loop, APC_LOOP_WHOLE, k ? scales[k] : NULL, &m, NULL), 0);
        assert_near(m.sensitivity, S, 1e-3 * S);
        assert_near(peak_at(m.at, scales[k], &t), m.sensitivity, 1e-4);
        assert_near(m.complementary, T, 0.01 * T);
    }
    apc_loop_destroy(loop);
}

/* ---- Peaks of one ------------------------------------------------------------------------------------- */

static void peaks_and_crossover_of_an_integrator(void **state)
{
    const struct {
        double K;
        apc_ns acts;
    } of[] = {{0.5, 0}, {1.5, 0}, {0.5, 1000 * MS}, {0.9, 1000 * MS}};
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct apc_loop *loop = noisy(of[i].K, of[i].acts, 0.0, 0.0);
        struct apc_loop_margins m = {.size = sizeof m};
        double S = 0.0, T = 0.0, at = 0.0;

        for (double w = 0.001; w <= M_PI; w += 0.00005) {
            const double complex z = cexp(J * w), L = of[i].K / (z - 1.0) / (of[i].acts ? z : 1.0);

            if (cabs(1.0 / (1.0 + L)) > S) {
                S = cabs(1.0 / (1.0 + L));
                at = w;
            }
            T = fmax(T, cabs(L / (1.0 + L)));
        }
        assert_int_equal(apc_loop_margins(loop, 0, NULL, &m, NULL), 0);
        assert_near(m.sensitivity, S, 1e-4 * S);
        assert_near(m.at, at, 1e-3);
        assert_near(m.complementary, T, 0.01 * T);
        assert_near(m.crossover, 2.0 * asin(of[i].K / 2.0), 0.04 * m.crossover);
        struct apc_loop_margins peaks = {.size = sizeof peaks};
        assert_int_equal(apc_loop_peaks(loop, 0, NULL, &peaks, NULL), 0);
        assert_true(peaks.stable && isnan(peaks.gain) && isnan(peaks.gain_low) && isnan(peaks.phase) &&
                    isnan(peaks.delay) && isnan(peaks.jitter));
        assert_near(peaks.sensitivity, m.sensitivity, 0.0);
        assert_near(peaks.complementary, m.complementary, 0.0);
        apc_loop_destroy(loop);
    }
}

/* 2 / (s (s + 1) (s + 2)), held for 50 ms: reported of python-control, which said 31.5 and infinite for what
 * MATLAB says is 2.79 and 31.5 degrees at 0.749 rad/s. */
static void margins_of_a_sampled_loop_are_the_published_ones(void **state)
{
    const double A[] = {0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -2.0, -3.0}, B[] = {0.0, 0.0, 1.0}, D = -1.0;
    const double C[] = {2.0, 0.0, 0.0};
    const struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = measured, .to = to};
    const struct apc_loop_tick tick = {0, 0, 0, 0, 0};
    struct apc_loop_setup setup = setup_of(&c, 1, &tick, 1);
    struct apc_loop_margins m = {.size = sizeof m};
    (void)state;

    setup.plant.nx = 3;
    setup.plant.A = A, setup.plant.B = B, setup.plant.C = C;
    setup.plant.period = setup.period = 50 * MS;
    struct apc_loop *loop = made(&setup);
    assert_int_equal(apc_loop_margins(loop, 0, NULL, &m, NULL), 0);
    assert_true(m.stable);
    assert_near(m.gain, 2.79, 0.005);
    assert_near(m.gain_low, 0.0, 0.0);
    assert_near(m.phase, 31.5, 0.05);
    assert_near(m.crossover, 0.749, 0.0005);
    assert_near(m.delay, m.phase * M_PI / 180.0 / m.crossover, 0.01 * m.delay);
    apc_loop_destroy(loop);
}

static void nothing_else_is_said_of_a_loop_that_is_not_stable(void **state)
{
    struct apc_loop *loop = noisy(2.5, 0, 0.0, 0.0);
    struct apc_loop_margins m = {.size = sizeof m};
    (void)state;

    assert_int_equal(apc_loop_margins(loop, 0, NULL, &m, NULL), 0);
    assert_false(m.stable);
    assert_near(fabs(m.gain) + fabs(m.phase) + fabs(m.delay) + fabs(m.jitter), 0.0, 0.0);
    assert_near(fabs(m.sensitivity) + fabs(m.at) + fabs(m.complementary) + fabs(m.crossover), 0.0, 0.0);
    apc_loop_destroy(loop);
}

static void what_jitter_allows_is_told_of_one_tick_a_period(void **state)
{
    const double D = -0.2;
    const struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = measured, .to = to};
    const struct apc_loop_tick tick[2] = {{0, 0, 0, 0, 0}, {0, 500 * MS, 500 * MS, 500 * MS, 500 * MS}};
    struct apc_loop_setup setup = setup_of(&c, 1, tick, 2);
    struct apc_loop_margins m = {.size = sizeof m};
    struct apc_loop *loop = made(&setup);
    (void)state;

    assert_int_equal(apc_loop_margins(loop, 0, NULL, &m, NULL), 0);
    assert_true(m.stable && isnan(m.jitter) && m.delay > 0.0);
    apc_loop_destroy(loop);
    setup.n_ticks = 1;
    setup.plant.period = 300 * MS; /* does not go into the period */
    loop = made(&setup);
    assert_int_equal(apc_loop_margins(loop, 0, NULL, &m, NULL), 0);
    assert_true(m.stable && isnan(m.jitter));
    apc_loop_destroy(loop);
}

/* ---- Costs -------------------------------------------------------------------------------------------- */

enum { LOOKS = 10 };

static void noise_costs_what_its_recursion_says(void **state)
{
    const double K = 0.5, noise = 2.0, sensor = 0.3, q = noise * noise, e = sensor * sensor,
                 P = (q + K * K * e) / (1.0 - (1.0 - K) * (1.0 - K));
    struct apc_loop *loop = noisy(K, 0, noise, sensor);
    double y, u, expected = 0.0;
    (void)state;

    for (int j = 0; j < LOOKS; j++) {
        const double t = 0.1 * j;

        expected += ((1.0 - K * t) * (1.0 - K * t) * P + q * t + K * K * t * t * e) / (double)LOOKS;
    }
    assert_int_equal(apc_loop_cost(loop, NULL, 0, &y, &u, NULL), 0);
    assert_near(y, expected, 1e-9);
    assert_near(u, K * K * (P + e), 1e-9);
    apc_loop_destroy(loop);

    loop = noisy(2.5, 0, noise, sensor);
    struct apc_error why = {""};
    assert_int_equal(apc_loop_cost(loop, NULL, 0, &y, &u, &why), APC_ESOLVER);
    assert_has(why.text, "not stable under this timing");
    apc_loop_destroy(loop);
}

/* Of the covariance of x and of the u that is held, once a period. */
static void lost_commands_cost_what_their_recursion_says(void **state)
{
    const double K = 0.7, lost = 0.2, kept = 1.0 - lost, noise = 1.5, q = noise * noise;
    const struct apc_loop_tick tick[2] = {{0, 0, 0, 0, 0}, {0, 0, 0, 0, INT64_MAX}};
    const struct apc_loop_schedule schedule[3] = {
        {kept, 1, tick}, {lost / 4.0, 1, tick + 1}, {lost * 0.75, 0, NULL}};
    struct apc_loop *loop = noisy(K, 0, noise, 0.0);
    double X = 0.0, Y = 0.0, U = 0.0, y, u, expected = 0.0;
    (void)state;

    for (int k = 0; k < 1000; k++) {
        const double x = X, xy = Y, uu = U;

        X = kept * (1.0 - K) * (1.0 - K) * x + lost * (x + 2.0 * xy + uu) + q;
        Y = -kept * K * (1.0 - K) * x + lost * (xy + uu);
        U = kept * K * K * x + lost * uu;
    }
    for (int j = 0; j < LOOKS; j++) {
        const double t = 0.1 * j;

        expected +=
            (kept * (1.0 - K * t) * (1.0 - K * t) * X + lost * (X + 2.0 * t * Y + t * t * U) + q * t) /
            (double)LOOKS;
    }
    assert_int_equal(apc_loop_cost(loop, schedule, 3, &y, &u, NULL), 0);
    assert_near(y, expected, 1e-8);
    assert_near(u, U, 1e-8);
    apc_loop_destroy(loop);
}

/* y = x + u / 4, of which the measurement knows the u that acts when it is taken. */
static void what_goes_straight_through_costs_too(void **state)
{
    const double K = 0.5, direct = 0.25, noise = 1.0, D = -K;
    const struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = measured, .to = to};
    const struct apc_loop_tick tick = {0, 0, 0, 0, 0};
    struct apc_loop_setup setup = setup_of(&c, 1, &tick, 1);
    double X = 0.0, Y = 0.0, U = 0.0, y, u, expected = 0.0;
    (void)state;

    setup.plant.D = &direct;
    setup.plant.noise = &noise;
    struct apc_loop *loop = made(&setup);
    for (int k = 0; k < 1000; k++) { /* u' = -K (x + d u), x' = x + u' */
        const double x = X, xy = Y, uu = U, a = -K, b = -K * direct;

        X = (1.0 + a) * (1.0 + a) * x + 2.0 * (1.0 + a) * b * xy + b * b * uu + noise;
        Y = (1.0 + a) * a * x + ((1.0 + a) * b + a * b) * xy + b * b * uu;
        U = a * a * x + 2.0 * a * b * xy + b * b * uu;
    }
    for (int j = 0; j < LOOKS; j++) {
        /* x' - (1 - t) u', u'; at the beginning the former u still acts */
        const double t = 0.1 * j, x = X - noise + noise * t - 2.0 * (1.0 - t) * Y + (1.0 - t) * (1.0 - t) * U,
                     xy = Y - (1.0 - t) * U;

        expected += (j == 0 ? X + 2.0 * direct * Y + direct * direct * U
                            : x + 2.0 * direct * xy + direct * direct * U) /
                    (double)LOOKS;
    }
    assert_int_equal(apc_loop_cost(loop, NULL, 0, &y, &u, NULL), 0);
    assert_near(y, expected, 1e-8);
    assert_near(u, U, 1e-8);
    apc_loop_destroy(loop);
}

/* ---- Refused ------------------------------------------------------------------------------------------ */

static void what_is_missing_or_out_of_range_is_refused_and_what_is_just_within_is_not(void **state)
{
    const double D = -0.5, bad = (double)NAN;
    const struct apc_loop_source sources[] = {
        {APC_FROM_MEASUREMENT, 1}, {APC_FROM_OUTPUT, 1}, {APC_FROM_OWN, 1}};
    const size_t one = 1;
    struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = measured, .to = to};
    struct apc_loop_tick tick[2] = {{0, 0, 0, 0, 0}, {0, 500 * MS, 500 * MS, 500 * MS, 500 * MS}};
    const struct apc_loop_setup good = setup_of(&c, 1, tick, 1);
    struct apc_loop_setup s = good;
    struct apc_loop *loop;
    struct apc_error why;
    (void)state;

#define REFUSED(reason)                                                                                      \
    do {                                                                                                     \
        assert_int_equal(apc_loop_create(&loop, &s, &why), APC_EINVAL);                                      \
        assert_null(loop);                                                                                   \
        assert_has(why.text, reason);                                                                        \
        s = good;                                                                                            \
    } while (0)
#define TAKEN()                                                                                              \
    do {                                                                                                     \
        apc_loop_destroy(made(&s));                                                                          \
        s = good;                                                                                            \
    } while (0)
    TAKEN();
    s.plant.nu = 0;
    REFUSED("are required");
    s.plant.ny = 0;
    REFUSED("are required");
    s.n_controllers = 0;
    REFUSED("are required");
    s.n_ticks = 0;
    REFUSED("are required");
    s.period = 0;
    REFUSED("are required");
    s.plant.period = 0;
    REFUSED("are required");
    s.plant.dead_time = -1;
    REFUSED("are required");
    s.plant.A = NULL;
    REFUSED("matrices are required");
    s.plant.B = NULL;
    REFUSED("matrices are required");
    s.plant.C = NULL;
    REFUSED("matrices are required");
    s.plant.D = NULL;
    REFUSED("matrices are required");
    s.plant.A = &bad;
    REFUSED("finite");
    s.plant.B = &bad;
    REFUSED("finite");
    s.plant.C = &bad;
    REFUSED("finite");
    s.plant.D = &bad;
    REFUSED("finite");
    for (size_t i = 0; i < 3; i++) {
        c.in = &sources[i];
        REFUSED("controller 1");
    }
    c.in = NULL;
    REFUSED("controller 1");
    c.in = measured;
    c.D = NULL;
    REFUSED("controller 1");
    c.D = &bad;
    REFUSED("controller 1");
    c.D = &D;
    c.nx = 1; /* of which it has nothing */
    REFUSED("controller 1");
    c.nx = 0;
    c.to = NULL;
    REFUSED("controller 1");
    c.to = &one;
    REFUSED("controller 1");
    c.to = to;
    c.nu = 0;
    REFUSED("controller 1");
    c.nu = 1;
    tick[0].controller = 1;
    REFUSED("tick 1");
    tick[0].controller = 0;
    tick[0].computed = tick[0].written = tick[0].acts = 1000 * MS;
    TAKEN();
    tick[0].computed = tick[0].written = tick[0].acts = 1000 * MS + 1;
    REFUSED("tick 1");
    tick[0].computed = -1;
    tick[0].sampled = -1;
    REFUSED("tick 1");
    tick[0] = (struct apc_loop_tick){0, 1, 0, 0, 0};
    REFUSED("tick 1");
    tick[0] = (struct apc_loop_tick){0, 0, 10, 9, 10};
    REFUSED("tick 1");
    tick[0] = (struct apc_loop_tick){0, 0, 10, 10, 9};
    REFUSED("tick 1");
    tick[0] = (struct apc_loop_tick){0, 0, 500 * MS, 500 * MS, 500 * MS};
    s.n_ticks = 2;
    tick[1].computed = 500 * MS - 1;
    tick[1].sampled = 0;
    REFUSED("tick 2");
    tick[0] = (struct apc_loop_tick){0, -200 * MS, 0, 0, 0}; /* each is as new as the one before, at least */
    tick[1] = (struct apc_loop_tick){0, -200 * MS, 500 * MS, 500 * MS, 500 * MS};
    s.n_ticks = 2;
    TAKEN();
    tick[1].sampled = -201 * MS;
    s.n_ticks = 2;
    REFUSED("tick 2");
    tick[0].sampled = -600 * MS;
    tick[1].sampled = 400 * MS;
    s.n_ticks = 2;
    TAKEN();
    tick[1].sampled = 401 * MS;
    s.n_ticks = 2;
    REFUSED("tick 1");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_a_controller_did_before_counts),
        cmocka_unit_test(one_controller_reads_what_another_has_written),
        cmocka_unit_test(margins_of_coupled_loops_are_those_of_their_map),
        cmocka_unit_test(a_response_is_that_of_the_loop_cut_open_there),
        cmocka_unit_test(peaks_of_all_outputs_are_largest_singular_values),
        cmocka_unit_test(peaks_and_crossover_of_an_integrator),
        cmocka_unit_test(margins_of_a_sampled_loop_are_the_published_ones),
        cmocka_unit_test(nothing_else_is_said_of_a_loop_that_is_not_stable),
        cmocka_unit_test(what_jitter_allows_is_told_of_one_tick_a_period),
        cmocka_unit_test(noise_costs_what_its_recursion_says),
        cmocka_unit_test(lost_commands_cost_what_their_recursion_says),
        cmocka_unit_test(what_goes_straight_through_costs_too),
        cmocka_unit_test(what_is_missing_or_out_of_range_is_refused_and_what_is_just_within_is_not),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
