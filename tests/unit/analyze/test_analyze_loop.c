/* SPDX-License-Identifier: BSD-3-Clause */
/* Loops as they tick: margins that theory gives, and those at which a simulation begins to swing. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#include <apccontrol.h>
#include <apcrun.h>

#include "analyze/linear.h"

#define MS ((apc_ns)1000000)

/* ---- An integrator under proportional control: x' = u, u = -K x every second --------------------------- */

/* The same, said as a pattern of @p n ticks, at most 2. */
static struct apc_loop *integrator_of(double K, apc_ns acts, size_t n)
{
    static const double zero = 0.0, one = 1.0;
    static const struct apc_loop_source source = {APC_FROM_MEASUREMENT, 0};
    static const size_t to = 0;
    const double D = -K;
    const struct apc_loop_controller c = {.n_in = 1, .nu = 1, .D = &D, .in = &source, .to = &to};
    const apc_ns second = 1000 * MS;
    const struct apc_loop_tick tick[] = {{0, 0, 0, 0, acts}, {0, second, second, second, second + acts}};
    const struct apc_loop_setup setup = {
        .size = sizeof setup,
        .plant =
            {.nx = 1, .nu = 1, .ny = 1, .A = &zero, .B = &one, .C = &one, .D = &zero, .period = 100 * MS},
        .n_controllers = 1,
        .controller = &c,
        .period = (apc_ns)n * second,
        .n_ticks = n,
        .tick = tick};
    struct apc_loop *loop;
    struct apc_error why;

    if (apc_loop_create(&loop, &setup, &why) < 0)
        fail_msg("%s", why.text);
    return loop;
}

static struct apc_loop *integrator(double K, apc_ns acts)
{
    return integrator_of(K, acts, 1);
}

static struct apc_loop_margins margins_of(const struct apc_loop *loop, size_t of)
{
    struct apc_loop_margins m = {.size = sizeof m};
    struct apc_error why;

    if (apc_loop_margins(loop, of, NULL, &m, &why) < 0)
        fail_msg("%s", why.text);
    return m;
}

/*
 * Promise(analysis/margins-loop-ticks): Margins of a loop as it ticks are those of theory, and those at
 *   which a simulation begins to swing, within 1 %; a law is made linear as its equations say.
 */
static void an_integrator_has_the_margins_of_theory(void **state)
{
    struct apc_loop *loop = integrator(0.5, 0);
    struct apc_loop_margins m = margins_of(loop, 0);
    const double w = 0.7;
    double re, im;
    (void)state;

    assert_true(m.stable);
    assert_near(m.gain, 2.0 / 0.5, 1e-5); /* z - 1 + K, unstable at z = -1 */
    assert_near(m.gain_low, 0.0, 1e-9);
    /* |z - 1| = K where the loop's gain is 1 */
    assert_near(m.phase, (M_PI / 2.0 - asin(0.25)) * 180.0 / M_PI, 1e-4);
    /* with a delay of d + g periods: z^(d+1) (z - 1) + K ((1 - g) z + g), on the circle */
    assert_true(m.delay > 2.5 && m.delay < 3.0);
    /* A pulse in a tenth comes back as K h / (z - 1 + K), ten of them sqrt(10) times that; with |z - 1| most
     * at z = -1, 2 / 3 of a move: J = 1.5^2 = 1 + 3 g */
    assert_near(m.jitter, 1.0 + 1.25 / 3.0, 1e-6);
    assert_int_equal(apc_loop_response(loop, 0, 1, &w, &re, &im), 0);
    assert_near(hypot(re, im), 0.5 / (2.0 * sin(w / 2.0)), 1e-12);
    apc_loop_destroy(loop);

    loop = integrator(0.5, 1000 * MS); /* acts a period later: z (z - 1) + K, unstable at K = 1 */
    m = margins_of(loop, APC_LOOP_WHOLE);
    assert_near(m.gain, 2.0, 1e-5);
    apc_loop_destroy(loop);

    loop = integrator(2.5, 0);
    assert_false(margins_of(loop, 0).stable);
    apc_loop_destroy(loop);
}

static void a_delay_at_the_margin_puts_a_pole_on_the_circle(void **state)
{
    struct apc_loop *loop = integrator(0.5, 0);
    const double delay = margins_of(loop, 0).delay;
    double re[8], im[8];
    (void)state;

    apc_loop_destroy(loop);
    loop = integrator(0.5, (apc_ns)(delay * 1e9));
    assert_true(apc_loop_states(loop) <= 8);
    assert_int_equal(apc_loop_poles(loop, re, im), 0);
    assert_near(hypot(re[0], im[0]), 1.0, 1e-6);
    apc_loop_destroy(loop);
}

/* A pole for each period of it would be slow, and beyond a thousand hopeless. */
/* Promise(analysis/margins-loop-ticks) */
static void a_long_delay_is_found_as_well_however_long_and_in_any_pattern_of_ticks(void **state)
{
    static const double gain[] = {0.1, 0.03, 1e-4};
    double re[80], im[80];
    (void)state;

    for (size_t i = 0; i < sizeof gain / sizeof *gain; i++) {
        struct apc_loop *loop = integrator(gain[i], 0), *twice = integrator_of(gain[i], 0, 2);
        const double delay = margins_of(loop, 0).delay, w = 2.0 * asin(gain[i] / 2.0);

        /* |z - 1| = K where the loop's gain is 1; on top comes half a period that each output is held */
        assert_near(delay, (M_PI / 2.0 - w / 2.0) / w, 0.1);
        assert_near(margins_of(twice, 0).delay, delay, 1e-5 * delay);
        assert_near(margins_of(twice, APC_LOOP_WHOLE).delay, delay, 1e-5 * delay);
        apc_loop_destroy(twice);
        apc_loop_destroy(loop);
        if (delay > 70.0)
            continue;
        loop = integrator(gain[i], (apc_ns)(delay * 1e9));
        assert_true(apc_loop_states(loop) <= 80);
        assert_int_equal(apc_loop_poles(loop, re, im), 0);
        assert_near(hypot(re[0], im[0]), 1.0, 1e-6);
        apc_loop_destroy(loop);
    }
}

static void what_cannot_be_a_loop_is_refused(void **state)
{
    const struct apc_loop_setup nothing = {.size = sizeof nothing};
    struct apc_loop *loop;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_loop_create(&loop, &nothing, &why), APC_EINVAL);
    assert_null(loop);
    assert_has(why.text, "are required");
    loop = integrator(0.5, 0);
    assert_int_equal(apc_loop_margins(loop, 1, NULL, &(struct apc_loop_margins){0}, &why), APC_EINVAL);
    apc_loop_destroy(loop);
    apc_loop_destroy(NULL);
}

/* ---- Found again by bisection in simulation -------------------------------------------------- */

static const char text[] =
    "name = \"swing\"; duration = 1000.0;\n"
    "measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; } ); outputs = ( { name = \"u\"; } "
    ");\n"
    "plant = { model = \"first-order\"; integrator = \"exact\"; period = 0.05; dead_time = 0.0;\n"
    "          parameters = { K = 10.0; tau = 1.0; }; };\n"
    "client = { period = 0.05; phase = 0.02; };\n"
    "controller = { law = \"pid\"; period = 0.2; phase = 0.03; execution = 0.06;\n"
    "               tuning = ( { Kp = 0.1; tau_i = 0.7; tau_d = 0.05; } ); };\n"
    "scheduler = { period = 1000.0; sequence = ( [1.0] ); };\n";

static double farthest(struct apc_simulation *s, double from, double to)
{
    double most = 0.0;
    struct apc_value y;

    for (double t = from; t < to; t += 0.7) {
        if (apc_simulation_run(s, t) < 0)
            return HUGE_VAL;
        if (apc_simulation_read(s, "y", &y) == 0)
            most = fmax(most, fabs(y.value - 1.0));
    }
    return most;
}

/* Does it still swing wider at the end? */
static bool swings(const char *path, double value)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    char number[40];
    double early, late;

    snprintf(number, sizeof number, "%.9f", value);
    if (apc_experiment_load(&e, "here.conf", text, &why) < 0 ||
        apc_experiment_set(e, path, number, &why) < 0 || apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    early = farthest(s, 100.0, 140.0);
    late = farthest(s, 300.0, 340.0);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
    return late > early || !(late < 1e9);
}

static double simulated_margin(const char *path, double stable, double unstable)
{
    assert_false(swings(path, stable));
    assert_true(swings(path, unstable));
    while (unstable - stable > 0.002 * unstable) {
        const double middle = (stable + unstable) / 2.0;

        *(swings(path, middle) ? &unstable : &stable) = middle;
    }
    return (stable + unstable) / 2.0;
}

/* Promise(analysis/margins-loop-ticks) */
static void margins_are_where_a_simulation_begins_to_swing(void **state)
{
    const struct experiment_source source = {.file = "here.conf", .text = text};
    const struct linear_how how = {0};
    struct linear_loop l;
    struct experiment e;
    struct apc_error why = {""};
    struct apc_loop_margins m;
    (void)state;

    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        linear_loop_create(&l, &e, &how, &why) < 0)
        fail_msg("%s", why.text);
    m = margins_of(l.loop, 0);
    assert_true(m.stable);
    assert_near(simulated_margin("plant.parameters.K", 10.0, 20.0 * m.gain) / 10.0, m.gain, 0.01 * m.gain);
    assert_near(simulated_margin("plant.dead_time", 0.0, 2.0 * m.delay), m.delay, 0.01 * m.delay);
    assert_true(m.jitter > 0.0 && m.jitter < m.delay);
    linear_loop_free(&l);
    experiment_free(&e);
}

/* ---- Under noise ----------------------------------------------------------------------------- */

static const char noisy[] =
    "name = \"noise\"; duration = 10000.0; seed = 7;\n"
    "measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; initial = 0.0; } );\n"
    "outputs = ( { name = \"u\"; } );\n"
    "plant = { model = \"first-order\"; integrator = \"exact\"; period = 0.05; noise = { x = 1.0; };\n"
    "          parameters = { K = 10.0; tau = 1.0; }; };\n"
    "client = { period = 0.05; phase = 0.02; };\n"
    "controller = { law = \"pid\"; period = 0.4; phase = 0.03; execution = \"uniform(0.0, 0.3)\";\n"
    "               tuning = ( { Kp = 0.15; tau_i = 1.0; } ); };\n";

/* Means of parts of the run that hardly know of each other: their mean, and its standard error. */
static double simulated_square(const char *experiment, double *error)
{
    enum { PARTS = 100, PART = 2000 };
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    struct apc_value y;
    double sum = 0.0, squares = 0.0;

    if (apc_experiment_load(&e, "here.conf", experiment, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    for (int part = 0; part < PARTS; part++) {
        double mean = 0.0;

        for (int k = 0; k < PART; k++) {
            assert_int_equal(apc_simulation_run(s, (part * PART + k + 1) * 0.05 - 0.01), 0);
            assert_int_equal(apc_simulation_read(s, "y", &y), 0);
            mean += y.value * y.value / (double)PART;
        }
        sum += mean;
        squares += mean * mean;
    }
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
    *error = sqrt((squares - sum * sum / (double)PARTS) / (double)(PARTS - 1) / (double)PARTS);
    return sum / (double)PARTS;
}

/* What the recursion says of it; 0: it is not known, as of a loop that is not stable. */
static double expected_square(const char *experiment, struct linear_cost *c)
{
    const struct experiment_source source = {.file = "here.conf", .text = experiment};
    const struct linear_how how = {0};
    struct linear_loop l;
    struct experiment e;
    struct apc_error why = {""};
    double square = 0.0;

    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    if (linear_loop_create(&l, &e, &how, &why) == 0 && margins_of(l.loop, 0).stable &&
        linear_cost_create(c, &e, &l, &how, &why) == 0 && c->known[COST_LOSS])
        square = c->y[COST_LOSS][0];
    linear_loop_free(&l);
    experiment_free(&e);
    return square;
}

/*
 * Promise(analysis/noise-costs-timing): What noise costs under a timing is what simulations have on
 *   average, and four known numbers to four digits; of a run's timing, too; what is not known says why.
 */
static void the_cost_is_what_simulations_have_on_average(void **state)
{
    struct linear_cost c = {0};
    double error, mean = simulated_square(noisy, &error), expected = expected_square(noisy, &c);
    (void)state;

    assert_true(expected > 0.0);
    assert_near(mean, expected, 2.0 * error);
    assert_true(error < 0.04 * mean);
    assert_true(c.y[COST_IDEAL][0] < c.y[COST_PERIOD][0] && c.y[COST_PERIOD][0] < c.y[COST_LATENCY][0]);
    linear_cost_free(&c);
}

static double between(double low, double high)
{
    return low + (high - low) * drand48(); // NOLINT(cert-msc30-c,cert-msc50-cpp)
}

/* A plant, a law, and how long it takes: by chance. */
static void draw_loop(char *experiment, size_t size)
{
    const double K = between(2.0, 20.0), tau = between(0.6, 3.0), period = 0.05 * floor(between(4.0, 13.0));
    const double Kp = between(0.2, 0.9) / K, tau_i = between(0.8, 4.0),
                 dead_time = 0.05 * floor(between(0.0, 4.0));
    char takes[60];

    switch ((int)between(0.0, 4.0)) {
    case 0:
        snprintf(takes, sizeof takes, "%.3f", between(0.0, 0.8) * period);
        break;
    case 1:
        snprintf(takes, sizeof takes, "\"uniform(0.0, %.3f)\"", between(0.2, 0.8) * period);
        break;
    case 2:
        snprintf(takes, sizeof takes, "\"gamma(2, %.4f)\"", between(0.02, 0.06) * period);
        break;
    default:
        snprintf(takes, sizeof takes, "\"normal(%.4f, %.4f)\"", 0.4 * period, 0.08 * period);
    }
    snprintf(
        experiment, size,
        "name = \"drawn\"; duration = 10000.0; seed = %ld;\n"
        "measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; initial = 0.0; } );\n"
        "outputs = ( { name = \"u\"; } );\n"
        "plant = { model = \"first-order\"; integrator = \"exact\"; period = 0.05; noise = { x = 1.0; };\n"
        "          parameters = { K = %.6f; tau = %.6f; }; dead_time = %.2f; };\n"
        "client = { period = 0.05; phase = 0.02; };\n"
        "controller = { law = \"pid\"; period = %.2f; phase = 0.03; execution = %s;\n"
        "               tuning = ( { Kp = %.6f; tau_i = %.6f; } ); };\n",
        (long)between(1.0, 1e6), K, tau, dead_time, period, takes, Kp, tau_i);
}

/* Of ten, at 95 %, one may lie outside; none far. */
/* Promise(analysis/noise-costs-timing) */
static void the_cost_of_ten_loops_drawn_by_chance_is_that_of_their_simulations(void **state)
{
    char experiment[1200];
    int loops = 0, within = 0;
    (void)state;

    srand48(11);
    for (int tries = 0; loops < 10; tries++) {
        struct linear_cost c = {0};
        double error, mean, expected;

        assert_true(tries < 30);
        draw_loop(experiment, sizeof experiment);
        expected = expected_square(experiment, &c);
        linear_cost_free(&c);
        if (!(expected > 0.0))
            continue;
        mean = simulated_square(experiment, &error);
        print_message("%.5f expected, %.5f +- %.5f simulated\n", expected, mean, 1.98 * error);
        assert_true(error < 0.04 * mean);
        assert_near(mean, expected, 4.0 * error);
        within += fabs(mean - expected) <= 1.98 * error; /* Student, 99 degrees of freedom */
        loops++;
    }
    assert_true(within >= 9);
}

/* What they are beside the means of simulations, to nine digits, and what is said where they are not known.
 * Who changes that on purpose takes the new number from here, and tells why it is better. */
static void drawn_loops_have_the_same_costs_and_margins(void **state)
{
    static const char *const also[] = {"", "network = { loss = 0.1; };\n",
                                       "network = { loss = 0.05; delay = 0.03; };\n"};
    const double expected = 9133.461234909;
    double sum = 0.0;
    size_t n = 0;
    (void)state;

    srand48(12);
    for (int i = 0; i < 18; i++) {
        struct experiment_source source = {.file = "here.conf"};
        struct linear_loop l = {0};
        struct linear_cost c = {0};
        struct experiment e;
        struct apc_error why = {""};
        char experiment[1500];

        draw_loop(experiment, sizeof experiment);
        const size_t drawn = strlen(experiment), room = sizeof experiment - drawn;
        assert_true(snprintf(experiment + drawn, room, "%s", also[i % 3]) < (int)room);
        source.text = experiment;
        if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
            fail_msg("%s", why.text);
        const struct linear_how how = {.faster = i % 4 == 3 ? 5.0 : 0.0, .prompt = i % 5 == 4};
        if (linear_loop_create(&l, &e, &how, &why) < 0)
            fail_msg("%s", why.text);
        const struct apc_loop_margins m = margins_of(l.loop, 0);
        const double margin[] = {m.stable, m.gain_low, m.gain,        m.phase,
                                 m.delay,  m.jitter,   m.sensitivity, m.complementary};
        for (size_t k = 0; k < sizeof margin / sizeof *margin; k++)
            sum += asinh(1e3 * (isfinite(margin[k]) ? margin[k] : 7.0)) * (1.0 + 0.618 * (double)(++n % 7));
        const int rc = m.stable ? linear_cost_create(&c, &e, &l, &how, &why) : 0;
        if (rc < 0)
            print_message("%d: %s\n", i, why.text);
        for (size_t k = 0; k < COST_CAUSES && m.stable && rc == 0; k++) {
            const double cost = c.known[k] && isfinite(c.y[k][0]) ? c.y[k][0] : 5.0 + c.known[k];

            sum += asinh(1e3 * cost) * (1.0 + 0.618 * (double)(++n % 7));
        }
        sum += c.faster;
        for (const char *at = c.unknown; *at; at++)
            sum += 0.01 * *at * (double)(1 + (at - c.unknown) % 5);
        linear_cost_free(&c);
        linear_loop_free(&l);
        experiment_free(&e);
    }
    if (!(fabs(sum - expected) <= 1e-7 * (double)n))
        fail_msg("%.9f of %zu numbers, not %.9f", sum, n, expected);
}

/* Promise(analysis/noise-costs-timing) */
static void shares_are_those_of_the_distribution(void **state)
{
    const struct apc_share shares[] = {{0.0, 1.0, 0.25}, {2.0, 2.0, 0.75}, {3.0, 5.0, 1.0}};
    const struct {
        struct apc_distribution d;
        double x, below;
    } of[] = {{{APC_UNIFORM, 1.0, 3.0, NULL, 0}, 1.5, 0.25},
              {{APC_NORMAL, 1.0, 2.0, NULL, 0}, 3.0, 0.841344746068543},
              {{APC_EXPONENTIAL, 2.0, 0.0, NULL, 0}, 2.0, 0.632120558828558},
              {{APC_GAMMA, 1.0, 2.0, NULL, 0}, 2.0, 0.632120558828558},
              {{APC_GAMMA, 3.0, 0.5, NULL, 0}, 1.0, 0.323323583816936},
              {{APC_CONSTANT, 1.0, 0.0, NULL, 0}, 0.9, 0.0},
              {{APC_RECORDED, 0.0, 0.0, shares, 3}, 0.5, 0.125},
              {{APC_RECORDED, 0.0, 0.0, shares, 3}, 2.0, 0.75},
              {{APC_RECORDED, 0.0, 0.0, shares, 3}, 4.0, 0.875}};
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_near(distribution_below(&of[i].d, of[i].x), of[i].below, 1e-12);
}

/* ---- Laws ------------------------------------------------------------------------------------ */

/* Promise(analysis/margins-loop-ticks) */
static void a_law_is_what_its_equations_say(void **state)
{
    const struct apc_law_setup setup = {.dim = {.ny = 1, .nz = 1, .nu = 1}, .Ts = 2.0};
    const struct apc_law *law = &apc_law_pi;
    const double y = 10.0, u = 1.0;
    double tuning[16];
    struct apc_law_linear *l;
    struct apc_error why = {""};
    (void)state;

    for (size_t i = 0; i < law->n_tuning; i++)
        tuning[i] = law->tuning[i].initial;
    tuning[0] = 0.2; /* Kp, tau_i */
    tuning[1] = 10.0;
    assert_string_equal(law->tuning[0].name, "Kp");
    assert_string_equal(law->tuning[1].name, "tau_i");
    assert_int_equal(apc_law_linearize(&l, law, &setup, tuning, &y, &y, NULL, &u, &why), 0);
    assert_int_equal(l->nx, 1);
    assert_near(l->A[0], 1.0, 1e-9);
    assert_near(l->B[0], -0.2 * 2.0 / 10.0, 1e-9);
    assert_near(l->B[1], 0.2 * 2.0 / 10.0, 1e-9);
    assert_near(l->C[0], 1.0, 1e-9);
    assert_near(l->D[0], -0.2, 1e-9);
    assert_near(l->D[1], 0.2, 1e-9);
    free(l);

    for (size_t i = 0; i < law->n_tuning; i++) /* where it is cut */
        tuning[i] = !strcmp(law->tuning[i].name, "u_max") ? 1.0 : tuning[i];
    assert_int_equal(apc_law_linearize(&l, law, &setup, tuning, &y, &y, NULL, &u, &why), APC_ESOLVER);
    assert_null(l);
    assert_has(why.text, "not linear at this point");
}

/* x: moved by z, and moves u; moved by that, and moves u; moved by y alone, and moves nothing; moved by
 * nothing. */
static size_t four(const struct apc_dim *dim)
{
    (void)dim;
    return 4;
}

static int compute_four(struct apc_law_call *c)
{
    c->u[0] = c->x[0] + 2.0 * c->x[1] + 3.0 * c->y[0] - c->z[0] - (c->n_ahead > 2 ? 0.5 * c->z[2] : 0.0) +
              c->x[3] + 0.25 * c->u_last[0];
    c->u[1] = 4.0 * c->x[1] - c->y[0];
    return APC_LAW_GOOD;
}

static void update_four(struct apc_law_call *c)
{
    const double x0 = c->x[0];

    c->x[0] = 0.5 * x0 + 0.1 * c->z[0];
    c->x[1] = 0.25 * x0 + 0.75 * c->x[1];
    c->x[2] = 0.9 * c->x[2] + c->y[0];
}

static int create_four(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                       struct apc_error *why)
{
    (void)setup;
    (void)self;
    (void)why;
    needs->n_ahead = 3;
    return 0;
}

static void states_that_nothing_moves_or_that_move_nothing_are_left_out(void **state)
{
    const struct apc_law_setup setup = {.dim = {.ny = 1, .nz = 1, .nu = 2}, .Ts = 2.0};
    struct apc_law law = {.abi = APC_LAW_ABI,
                          .name = "four",
                          .whole = true,
                          .n_state = four,
                          .compute = compute_four,
                          .update = update_four};
    const double y = 10.0, u[2] = {1.0, 2.0};
    (void)state;

    for (int ahead = 0; ahead < 2; ahead++) {
        struct apc_law_linear *l;
        struct apc_error why = {""};

        law.create = ahead ? create_four : NULL;
        if (apc_law_linearize(&l, &law, &setup, NULL, &y, &y, NULL, u, &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(l->nx, 2);
        assert_int_equal(l->n_in, 4);
        const double A[] = {0.5, 0.0, 0.25, 0.75}, B[8] = {0.0, 0.1}, C[] = {1.0, 2.0, 0.0, 4.0},
                     D[8] = {3.0, ahead ? -1.5 : -1.0, 0.25, 0.0, -1.0};
        for (size_t i = 0; i < 4; i++)
            assert_near(l->A[i], A[i], 1e-9);
        for (size_t i = 0; i < 8; i++)
            assert_near(l->B[i], B[i], 1e-9);
        for (size_t i = 0; i < 4; i++)
            assert_near(l->C[i], C[i], 1e-9);
        for (size_t i = 0; i < 8; i++)
            assert_near(l->D[i], D[i], 1e-9);
        free(l);
    }
}

/* Whatever moves a little to be differentiated by, each array is its own: nothing is limited, all is good and
 * stays as it is for all the time ahead. */
enum { WIDE = 3, AHEAD = 4 };

static int create_wide(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                       struct apc_error *why)
{
    (void)setup;
    (void)self;
    (void)why;
    needs->n_ahead = AHEAD;
    return 0;
}

static int compute_wide(struct apc_law_call *c)
{
    for (size_t i = 0; i < WIDE; i++) {
        assert_near(c->y[i], 10.0 + (double)i, 0.5);
        assert_true(c->y_status[i] == APC_GOOD && c->y_new[i] && c->y_age[i] == 0.0);
        assert_true(c->y_low[i] == -HUGE_VAL && c->y_high[i] == HUGE_VAL);
        assert_true(c->low[i] == -HUGE_VAL && c->high[i] == HUGE_VAL && c->rate[i] == HUGE_VAL);
        assert_near(c->u_last[i], 40.0 + (double)i, 0.5);
        for (size_t k = 0; k < AHEAD; k++) {
            assert_near(c->z[k * WIDE + i], 20.0 + (double)i, 0.5);
            assert_near(c->d[k * WIDE + i], 30.0 + (double)i, 0.5);
            assert_true(c->z[k * WIDE + i] == c->z[i] && c->d[k * WIDE + i] == c->d[i]);
        }
        c->u[i] = (double)(i + 1) * c->y[i] + 2.0 * c->z[i] - 3.0 * c->d[i];
    }
    return APC_LAW_GOOD;
}

static void a_law_is_asked_with_all_that_a_call_has(void **state)
{
    const struct apc_law_setup setup = {.dim = {.ny = WIDE, .nz = WIDE, .nu = WIDE, .nd = WIDE}, .Ts = 2.0};
    const struct apc_law law = {
        .abi = APC_LAW_ABI, .name = "wide", .whole = true, .create = create_wide, .compute = compute_wide};
    const double y[] = {10.0, 11.0, 12.0}, z[] = {20.0, 21.0, 22.0}, d[] = {30.0, 31.0, 32.0},
                 u[] = {40.0, 41.0, 42.0};
    struct apc_law_linear *l;
    struct apc_error why = {""};
    (void)state;

    if (apc_law_linearize(&l, &law, &setup, NULL, y, z, d, u, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(l->nx, 0);
    assert_int_equal(l->n_in, 4 * WIDE);
    for (size_t i = 0; i < WIDE; i++) {
        for (size_t j = 0; j < 4 * WIDE; j++) {
            const double own[] = {(double)(i + 1), 2.0, -3.0, 0.0};

            assert_near(l->D[i * l->n_in + j], j % WIDE == i ? own[j / WIDE] : 0.0, 1e-8);
        }
    }
    free(l);
}

/* Promise(analysis/margins-of-a-model): The margins that `apc tune --suggest` and `apc identify --suggest` tell are those of the loop as it
 *   ticks. */
static void a_tuning_of_a_model_has_the_margins_of_its_ticks(void **state)
{
    const struct apc_transfer integrator = {.gain = 1.0, .integrating = true},
                              plant = {.gain = -2.0, .zero = -1.0, .tau = {8.0, 3.0}, .dead_time = 2.5},
                              late = {.gain = 1.0, .tau = {8.0}, .dead_time = 61.0};
    const struct apc_pid_tuning K = {.Kp = 0.5}, pid = {.Kp = -1.0, .tau_i = 9.0, .tau_d = 1.0};
    struct apc_margins m, half = {.size = sizeof half};
    struct apc_error why;
    (void)state;

    assert_int_equal(linear_margins_of_pid(&integrator, &K, 1.0, &m, &why), 0);
    assert_true(m.stable);
    assert_near(m.gain, 2.0 / 0.5, 1e-5);
    assert_near(m.phase, (M_PI / 2.0 - asin(0.25)) * 180.0 / M_PI, 1e-4);
    assert_int_equal(linear_margins_of_pid(&integrator, &K, 5.0, &m, &why), 0);
    assert_false(m.stable);

    /* of a short period half of it is dead time */
    assert_int_equal(linear_margins_of_pid(&plant, &pid, 0.05, &m, &why), 0);
    assert_int_equal(apc_tune_margins(&plant, &pid, 0.05, &half, &why), 0);
    assert_true(m.stable && half.stable);
    assert_near(m.gain, half.gain, 0.03 * half.gain);
    assert_near(m.phase, half.phase, 0.02 * half.phase);
    assert_near(m.delay, half.delay, 0.02 * half.delay);
    assert_near(m.sensitivity, half.sensitivity, 0.02 * half.sensitivity);

    assert_int_equal(linear_margins_of_pid(&late, &K, 1.0, &m, &why), 0);
    assert_int_equal(apc_tune_margins(&late, &K, 1.0, &half, &why), 0);
    assert_memory_equal(&m, &half, sizeof m);

    /* Promise(analysis/margins-of-a-gain): So are those of a plant that is a gain alone, with a dead time and without. */
    const struct apc_transfer gain = {.gain = 2.0}, late_gain = {.gain = 2.0, .dead_time = 2.5};
    const struct apc_pid_tuning P = {.Kp = 0.25}, I = {.Kp = 0.1, .tau_i = 1.0},
                                D = {.Kp = 0.1, .tau_i = 1.0, .tau_d = 1.0};

    assert_int_equal(linear_margins_of_pid(&gain, &P, 1.0, &m, &why), 0); /* L = 0.5 / z */
    assert_true(m.stable && m.phase == HUGE_VAL && m.delay == HUGE_VAL);
    assert_near(m.gain, 2.0, 1e-6);
    assert_near(m.sensitivity, 2.0, 1e-6);
    assert_int_equal(linear_margins_of_pid(&gain, &I, 1.0, &m, &why), 0); /* L = 0.2 / (z - 1) */
    assert_true(m.stable);
    assert_near(m.gain, 10.0, 1e-5);
    assert_near(m.phase, 90.0 - asin(0.1) * 180.0 / M_PI, 1e-4);
    assert_near(m.delay, 8.0, 1e-6); /* of 7.3 samples the loop would swing */
    assert_near(m.sensitivity, 2.0 / 1.8, 1e-6);
    assert_int_equal(linear_margins_of_pid(&gain, &D, 1.0, &m, &why), 0); /* and 0.2 (z - 1) / z^2 */
    assert_near(m.gain, 2.0, 1e-6);
    assert_int_equal(linear_margins_of_pid(&late_gain, &I, 1.0, &m, &why), 0); /* L = 0.2 / (z - 1) / z^2 */
    assert_near(m.gain, 2.0 * sin(M_PI / 10.0) / 0.2, 1e-5);
    assert_near(m.delay, 5.5, 1e-6);
    assert_int_equal(linear_margins_of_pid(&gain, &(const struct apc_pid_tuning){.Kp = 0.6}, 1.0, &m, &why),
                     0);
    assert_false(m.stable);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_integrator_has_the_margins_of_theory),
        cmocka_unit_test(a_tuning_of_a_model_has_the_margins_of_its_ticks),
        cmocka_unit_test(a_delay_at_the_margin_puts_a_pole_on_the_circle),
        cmocka_unit_test(a_long_delay_is_found_as_well_however_long_and_in_any_pattern_of_ticks),
        cmocka_unit_test(what_cannot_be_a_loop_is_refused),
        cmocka_unit_test(margins_are_where_a_simulation_begins_to_swing),
        cmocka_unit_test(the_cost_is_what_simulations_have_on_average),
        cmocka_unit_test(the_cost_of_ten_loops_drawn_by_chance_is_that_of_their_simulations),
        cmocka_unit_test(drawn_loops_have_the_same_costs_and_margins),
        cmocka_unit_test(shares_are_those_of_the_distribution),
        cmocka_unit_test(a_law_is_what_its_equations_say),
        cmocka_unit_test(a_law_is_asked_with_all_that_a_call_has),
        cmocka_unit_test(states_that_nothing_moves_or_that_move_nothing_are_left_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
