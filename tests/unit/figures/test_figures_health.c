/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Loops whose trouble is known: a first-order plant with dead time under pi (SIMC), noise on the measurement and
 * filtered noise as a load, each of them drawn anew; and one thing wrong. APC_TEST_LOOPS=90: a thousand of them.
 */
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <apcbase.h>
#include <apcmath.h>

#include "figures/figures.h"

enum { TICKS = 4000, SETTLE = 100, PIPE = 64 };

enum trouble {
    WELL,
    TIGHT,
    SLUGGISH,
    STICKS_1, /* by so much, in units of the output */
    STICKS_2,
    STICKS_4,
    STICKS_8,
    BACKLASH,
    SINE,
    LOAD,
    STANDS_STILL,
    STEPS,
    JUMPS,
    TROUBLES
};

static const char *const names[] = {"well",         "tight",    "sluggish", "sticks 1", "sticks 2",
                                    "sticks 4",     "sticks 8", "backlash", "sine",     "load",
                                    "stands still", "steps",    "jumps"};

struct plant {
    double Ts, tau, gain, Kc, Ti, noise, load, load_pole, size, jump, amplitude, omega;
    size_t dead;
};

struct ticks_record {
    double y[TICKS], r[TICKS], u[TICKS];
};

static double between(struct apc_random *random, double low, double high)
{
    return low + (high - low) * apc_random_uniform(random);
}

/* Does a gain @p times as large still let the error of a step die down? */
static bool dies_down(const struct plant *p, double times)
{
    const double a = apc_exp(-p->Ts / p->tau);
    double pipe[PIPE] = {0}, x = 0, integral = 0, early = 0, late = 0;

    for (size_t k = 0; k < 3000; k++) {
        x = a * x + p->gain * (1 - a) * pipe[(k + PIPE - p->dead) % PIPE];
        const double e = 1 - x;
        integral += times * p->Kc * p->Ts / p->Ti * e;
        pipe[(k + 1) % PIPE] = times * p->Kc * e + integral;
        if (fabs(e) > 1e3)
            return false;
        if (k >= 500 && k < 1000)
            early = fmax(early, fabs(e));
        if (k >= 2500)
            late = fmax(late, fabs(e));
    }
    return late < early;
}

static struct plant draw(struct apc_random *random, enum trouble trouble)
{
    struct plant p = {.tau = 10 * apc_pow(10, between(random, 0, 0.7))};

    p.Ts = p.tau * (apc_random_uniform(random) < 0.5 ? 0.05 : 0.1);
    p.dead = (size_t)round(p.tau * between(random, 0.05, 0.8) / p.Ts);
    p.gain = (apc_random_uniform(random) < 0.5 ? -1 : 1) * apc_pow(10, between(random, -0.3, 0.3));
    const double dead = (double)p.dead * p.Ts;
    p.Kc = p.tau / (p.gain * (fmax(dead, p.Ts) + dead + p.Ts));
    p.Ti = fmin(p.tau, 4 * (fmax(dead, p.Ts) + dead));
    p.noise = 0.1 * between(random, 0.3, 1.5);
    p.load = 0.15 * between(random, 0.5, 1.5);
    p.load_pole = apc_exp(-p.Ts / (p.tau * between(random, 0.5, 3)));
    if (trouble == TIGHT) {
        double low = 1, high = 50;
        for (int i = 0; i < 14; i++) {
            const double middle = sqrt(low * high);
            *(dies_down(&p, middle) ? &low : &high) = middle;
        }
        p.Kc *= low * between(random, 0.8, 0.97);
    }
    if (trouble == SLUGGISH)
        p.Kc *= between(random, 0.05, 0.2);
    if (trouble >= STICKS_1 && trouble <= STICKS_8) {
        p.size = (double)(1 << (trouble - STICKS_1));
        p.jump = p.size * between(random, 0.2, 1);
    }
    if (trouble == BACKLASH)
        p.size = between(random, 1, 5);
    if (trouble == SINE) {
        p.amplitude = between(random, 1, 4);
        p.omega = 2 * 3.14159265358979 / ((dead + p.tau) * between(random, 1.5, 12));
    }
    if (trouble == LOAD)
        p.load *= between(random, 3, 6);
    return p;
}

static double disturbed(enum trouble trouble, size_t k, double y, double before, struct apc_random *random)
{
    if (trouble == STANDS_STILL && k % 400 > 250)
        return before;
    if (trouble == STEPS)
        return round(y / 0.8) * 0.8;
    if (trouble == JUMPS && apc_random_uniform(random) < 0.01)
        return y + (apc_random_uniform(random) < 0.5 ? -10 : 10);
    return y;
}

static void run(struct ticks_record *to, const struct plant *p, enum trouble trouble,
                struct apc_random *random)
{
    const double a = apc_exp(-p->Ts / p->tau);
    double pipe[PIPE] = {0}, x = 0, integral = 0, position = 0, load = 0, y = 0;

    for (size_t k = 0; k < TICKS; k++) {
        const double command = pipe[(k + PIPE - p->dead) % PIPE];
        load =
            p->load_pole * load + sqrt(1 - p->load_pole * p->load_pole) * p->load * apc_random_normal(random);
        if (fabs(command - position) > (p->size + p->jump) / 2 || p->size <= 0)
            position = command - (command > position ? 1 : -1) * (p->size - p->jump) / 2;
        x = a * x +
            (1 - a) * (p->gain * position + load + p->amplitude * apc_sin(p->omega * (double)k * p->Ts));
        y = disturbed(trouble, k, x + p->noise * apc_random_normal(random), y, random);
        integral = fmin(fmax(integral - p->Kc * p->Ts / p->Ti * y, -50), 50);
        pipe[(k + 1) % PIPE] = fmin(fmax(integral - p->Kc * y, -50), 50);
        to->y[k] = 50 + y;
        to->r[k] = 50;
        to->u[k] = 50 + pipe[(k + 1) % PIPE];
    }
}

static void judge(struct health *h, enum trouble trouble, int seed, struct plant *p)
{
    static struct ticks_record record;
    struct apc_random random;

    apc_random_init(&random, (uint64_t)seed, names[trouble]);
    *p = draw(&random, trouble);
    run(&record, p, trouble, &random);
    const struct health_series s = {.y = record.y + SETTLE,
                                    .r = record.r + SETTLE,
                                    .u = record.u + SETTLE,
                                    .n = TICKS - SETTLE,
                                    .period = p->Ts,
                                    .measured = record.y + SETTLE,
                                    .n_measured = TICKS - SETTLE,
                                    .horizon = (double)(p->dead + 1) * p->Ts};
    assert_int_equal(health_judge(h, &s), 0);
}

/*
 * Promise(simulation): `apc monitor` blames a valve that is well in at most 5 % of a thousand simulated loops of
 *   known trouble, and tells the rest as the table in tests/reports/monitor.md says.
 */
static void a_valve_that_is_well_is_hardly_ever_blamed(void **state)
{
    const char *const asked = getenv("APC_TEST_LOOPS");
    const int each = asked ? (int)strtol(asked, NULL, 10) : 6;
    int seen[TROUBLES][HEALTH_GOOD + 1] = {0}, wrong = 0, well = 0;

    (void)state;
    for (int t = 0; t < TROUBLES; t++)
        for (int seed = 1; seed <= each; seed++) {
            struct health h;
            struct plant p;
            judge(&h, (enum trouble)t, seed, &p);
            seen[t][h.verdict]++;
            if (t < STICKS_1 || t > BACKLASH) {
                well++;
                wrong += h.verdict == HEALTH_VALVE;
            }
        }
    printf("%-12s", "");
    for (int v = 1; v <= HEALTH_GOOD; v++)
        printf(" %9s", health_name((enum health_verdict)v));
    for (int t = 0; t < TROUBLES; t++) {
        printf("\n%-12s", names[t]);
        for (int v = 1; v <= HEALTH_GOOD; v++)
            printf(" %9d", seen[t][v]);
    }
    printf("\nvalves blamed that are well: %d of %d\n", wrong, well);
    assert_true(20 * wrong <= well);
    assert_true(3 * (seen[STICKS_2][HEALTH_VALVE] + seen[STICKS_4][HEALTH_VALVE]) > 2 * each);
    assert_true(2 * seen[TIGHT][HEALTH_TIGHT] > each);
    assert_true(10 * (seen[SINE][HEALTH_PERIODIC] + seen[SINE][HEALTH_SWINGS]) > 9 * each);
    for (int t = STANDS_STILL; t <= JUMPS; t++)
        assert_true(4 * seen[t][HEALTH_SENSOR] > 3 * each);
}

/* e(t) = pole e(t - 1) + noise: of it 1 - pole^2d is the least that a controller of dead time d - 1 could leave. */
static void the_index_is_that_of_theory(void **state)
{
    enum { LONG = 43200 };
    static double y[LONG], r[LONG], u[LONG];
    static const double pole[] = {0, 0.5, 0.9, -0.7};
    struct apc_random random;
    struct health h;

    (void)state;
    apc_random_init(&random, 1, "harris");
    for (size_t i = 0; i < sizeof pole / sizeof *pole; i++)
        for (int d = 1; d <= 4; d *= 4) {
            for (size_t t = 1; t < LONG; t++) {
                y[t] = pole[i] * y[t - 1] + apc_random_normal(&random);
                u[t] = apc_random_normal(&random);
            }
            const struct health_series s = {.y = y, .r = r, .u = u, .n = LONG, .period = 2, .horizon = 2 * d};
            assert_int_equal(health_judge(&h, &s), 0);
            const double theory = 1 - apc_pow(pole[i] * pole[i], d);
            assert_true(fabs(h.index - theory) < 0.02 * theory || pole[i] == 0);
            assert_true(pole[i] != 0 || h.index > 0.98);
        }
}

static void too_few_ticks_are_not_judged(void **state)
{
    static double v[HEALTH_TICKS];
    struct health h;

    (void)state;
    const struct health_series few = {.y = v, .r = v, .u = v, .n = HEALTH_TICKS - 1, .period = 1},
                               still = {.y = v, .r = v, .u = v, .n = HEALTH_TICKS, .period = 1};
    assert_int_equal(health_judge(&h, &few), 0);
    assert_int_equal(h.verdict, HEALTH_UNKNOWN);
    assert_int_equal(health_judge(&h, &still), 0); /* nothing moves */
    assert_int_equal(h.verdict, HEALTH_UNKNOWN);
    assert_true(isnan(h.index));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_valve_that_is_well_is_hardly_ever_blamed),
        cmocka_unit_test(the_index_is_that_of_theory),
        cmocka_unit_test(too_few_ticks_are_not_judged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
