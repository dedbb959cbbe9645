/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The figures of a simulation are those of the plant: in random worlds, over random networks, with sensors
 * that are noisy, stuck or silent, they are computed here once more, from what the plant's own function g was
 * asked for, in another way.
 */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "figures/figures.h"
#include "scratch.h"
#include "simulation/simulation.h"

#define WORLDS 1000
#define STEPS  4

/* What the plant put out, each time that it was asked. */
static struct {
    double t[4000], z[4000];
    double every; /* s */
    size_t n;
} plant;

static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)u, (void)p;
    y[0] = x[0];
    plant.t[plant.n] = t;
    plant.z[plant.n++] = x[0];
}

static double chance(struct apc_random *random, double low, double high)
{
    return low + (high - low) * apc_random_uniform(random);
}

struct world {
    double setpoint[STEPS], every; /* s */
    double step, duration;         /* s, of the plant; of the run */
};

static void write_world(struct world *w, const char *path, uint64_t seed)
{
    struct apc_random random;
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    apc_random_init(&random, seed, "world");
    w->step = chance(&random, 0.05, 0.4);
    w->every = floor(chance(&random, 10, 30)) + 0.1;
    w->duration = floor(chance(&random, 2, 4) * w->every);
    for (int i = 0; i < STEPS; i++)
        w->setpoint[i] =
            floor(chance(&random, -30, 0)) + 40 * (i % 2); /* no two after each other are the same */
    fprintf(file, "name = \"world\"; title = \"a world\"; duration = %.17g;\n", w->duration);
    fprintf(file, "measurements = ( { name = \"y\"; noise = %.17g; quantum = %.17g; faults = ( ",
            chance(&random, 0, 1), chance(&random, 0, 1));
    fprintf(file, "{ kind = \"%s\"; at = %.17g; duration = %.17g; } ); } );\n",
            apc_random_uniform(&random) < 0.5 ? "stuck" : "dropout", chance(&random, 0, w->duration),
            chance(&random, 0.1, 20));
    fprintf(
        file,
        "setpoints = ( { name = \"r\"; } ); outputs = ( { name = \"u\"; low = -10.0; high = 10.0; } );\n");
    fprintf(file, "plant = { model = \"first-order\"; period = %.17g; noise = { x = %.17g; }; };\n", w->step,
            chance(&random, 0, 0.3));
    fprintf(file, "client = { period = %.17g; }; ", chance(&random, 0.1, 0.6));
    fprintf(file,
            "controller = { law = \"pi\"; period = %.17g; tuning = ( { Kp = %.17g; tau_i = %.17g; } ); };\n",
            chance(&random, 0.5, 3), chance(&random, 0.05, 0.4), chance(&random, 5, 20));
    fprintf(file, "scheduler = { period = %.17g; sequence = ( [%.1f], [%.1f], [%.1f], [%.1f] ); };\n",
            w->every, w->setpoint[0], w->setpoint[1], w->setpoint[2], w->setpoint[3]);
    fprintf(file, "network = { delay = \"exponential(%.17g)\"; loss = %.17g; duplication = 0.05; };\n",
            chance(&random, 0.001, 0.2), chance(&random, 0, 0.5));
    assert_int_equal(fclose(file), 0);
}

/* On the straight line from one tick to the next; after the last one as it was. */
static double z_at(double t)
{
    size_t k = (size_t)fmax(t / plant.every - 1, 0);
    while (k + 1 < plant.n && plant.t[k + 1] <= t)
        k++;
    if (k + 1 >= plant.n)
        return plant.z[plant.n - 1];
    double share = (t - plant.t[k]) / (plant.t[k + 1] - plant.t[k]);
    return (1 - share) * plant.z[k] + share * plant.z[k + 1];
}

/* Simpson's rule, exact for what is here: a piece without a tick or a change of sign within. */
static void add_piece(double sum[3], double since, double a, double b, double r)
{
    const double e[3] = {fabs(z_at(a) - r), fabs(z_at((a + b) / 2) - r), fabs(z_at(b) - r)},
                 t[3] = {a - since, (a + b) / 2 - since, b - since}, weight[3] = {1, 4, 1};
    for (int i = 0; i < 3; i++) {
        sum[0] += (b - a) / 6 * weight[i] * e[i];
        sum[1] += (b - a) / 6 * weight[i] * e[i] * e[i];
        sum[2] += (b - a) / 6 * weight[i] * e[i] * t[i];
    }
}

static void integrals(double sum[3], double from, double to, double r)
{
    double a = from;
    memset(sum, 0, 3 * sizeof *sum);
    for (size_t k = 0; k <= plant.n && a < to; k++) {
        double b = k < plant.n && plant.t[k] < to ? plant.t[k] : to;
        if (b <= a)
            continue;
        double ea = z_at(a) - r, eb = z_at(b) - r;
        if ((ea < 0) != (eb < 0)) {
            double zero = a + (b - a) * fabs(ea) / (fabs(ea) + fabs(eb));
            add_piece(sum, from, a, zero, r);
            add_piece(sum, from, zero, b, r);
        } else {
            add_piece(sum, from, a, b, r);
        }
        a = b;
    }
}

/* From the end backwards: the first tick after which none is outside. */
static double settling(double from, double to, double r, double step)
{
    double settled = HUGE_VAL;
    for (size_t k = plant.n; k-- > 0;) {
        if (plant.t[k] > to)
            continue;
        if (fabs(plant.z[k] - r) > 0.05 * fabs(step))
            return settled;
        if (plant.t[k] < from)
            return fabs(z_at(from) - r) > 0.05 * fabs(step) ? settled : 0;
        settled = plant.t[k] - from;
    }
    return settled;
}

static double overshoot(double from, double to, double r, double step)
{
    double most = fmax(0, (z_at(from) - r) / step);
    for (size_t k = 0; k < plant.n; k++)
        if (plant.t[k] >= from && plant.t[k] <= to)
            most = fmax(most, (plant.z[k] - r) / step);
    return 100 * most;
}

static void assert_same(uint64_t seed, const char *what, double actual, double expected)
{
    if (isinf(expected) ? actual != expected : !(fabs(actual - expected) <= 1e-9 * fmax(1, fabs(expected))))
        fail_msg("world %d: %s is %.17g, but it was %.17g", (int)seed, what, actual, expected);
}

/* Returns how many steps were looked at. */
static size_t check_world(const struct world *w, const struct figures *f, uint64_t seed)
{
    double largest = 0, all = 0;
    size_t steps = 0, n = 0;
    for (int i = 1; i * w->every < w->duration; i++)
        largest = fmax(largest, fabs(w->setpoint[i % STEPS] - w->setpoint[(i - 1) % STEPS]));
    for (int i = 0; i * w->every < w->duration; i++) {
        double from = i * w->every, to = fmin(from + w->every, w->duration), r = w->setpoint[i % STEPS],
               sum[3];
        double step = r - (i > 0 ? w->setpoint[(i - 1) % STEPS] : z_at(0));
        assert_true(n < f->n_parts);
        const double *figure = f->of[0].part[n++].figure;
        integrals(sum, from, to, r);
        assert_same(seed, "IAE", figure[METRIC_IAE], sum[0]);
        assert_same(seed, "ISE", figure[METRIC_ISE], sum[1]);
        assert_same(seed, "ITAE", figure[METRIC_ITAE], sum[2]);
        all += sum[0];
        if (fabs(step) <= 0.1 * largest)
            continue;
        assert_same(seed, "overshoot", figure[METRIC_OVERSHOOT], overshoot(from, to, r, step));
        assert_same(seed, "settling", figure[METRIC_SETTLING], settling(from, to, r, step));
        steps++;
    }
    assert_same(seed, "the whole IAE", f->of[0].figure[METRIC_IAE], all);
    return steps;
}

/*
 * Promise(simulation/figures-plant-true): Figures are the plant's true ones in any world, by hand, of each
 *   event, `-`, `never`, `inf` as stated.
 */
static void figures_are_the_plant_s_in_any_world(void **state)
{
    char path[300];
    size_t looked_at = 0;
    (void)state;
    snprintf(path, sizeof path, "%s/world.conf", scratch_folder());
    for (uint64_t seed = 1; seed <= WORLDS; seed++) {
        struct experiment e;
        struct simulation s;
        struct figures f;
        struct apc_error why;
        struct world w;
        write_world(&w, path, seed);
        if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
            fail_msg("world %d: %s", (int)seed, why.text);
        struct apc_model watched = *e.plant.model;
        watched.g = g;
        e.plant.model = &watched;
        plant.n = 0;
        if (simulation_create(&s, &e, seed, &why) < 0)
            fail_msg("world %d: %s", (int)seed, why.text);
        plant.n = 0;
        assert_int_equal(simulation_run(&s, e.duration), 0);
        /* t of the plant sums its intervals up; the instants are the grid's */
        plant.every = apc_ns_to_s(e.plant.rhythm.period);
        for (size_t k = 0; k < plant.n; k++)
            plant.t[k] = (double)k * plant.every;
        w.every = apc_ns_to_s(e.scheduler.rhythm.period);
        assert_int_equal(figures_make(&f, &s.trajectory, &e), 0);
        looked_at += check_world(&w, &f, seed);
        figures_free(&f);
        simulation_destroy(&s);
        experiment_free(&e);
    }
    assert_true(looked_at > WORLDS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(figures_are_the_plant_s_in_any_world)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
